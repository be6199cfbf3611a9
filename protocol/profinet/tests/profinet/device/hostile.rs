//! No bytes on any port make the device panic, and after any of them a good controller still connects.

use super::*;
use crate::captured;
use proptest::prelude::*;

/// Returns frames of every kind that the device accepts, to be altered.
fn seeds() -> Vec<(Port, Vec<u8>)> {
    let mut rig = DeviceRig::new();
    let mut seeds = Vec::new();
    for rt_class in [RtClass::Class1, RtClass::Udp] {
        rig.rt_class = rt_class;
        let connect = emitted(|w| connect_request(rt_class, true).emit(w));
        seeds.push((Port::Udp(RPC_PORT), rig.datagram(Operation::Connect, &connect)));
        seeds.push(rig.cyclic(&[1; LEN], 0x80, DataStatus::RUNNING));
    }
    for (operation, command) in
        [(Operation::Control, Command::PrmEnd), (Operation::Release, Command::Release)]
    {
        let blocks = emitted(|w| control(command).emit_request(w));
        seeds.push((Port::Udp(RPC_PORT), rig.datagram(operation, &blocks)));
    }
    for text in [captured::CONNECT_REQ, captured::WRITE_REQ, captured::IM0_READ_REQ, captured::APPREADY_RES] {
        seeds.push((Port::Udp(RPC_PORT), captured::datagram(text)));
    }
    for text in [captured::DCP_SET_REQ, captured::ALARM_ACK_HIGH_CPU, captured::ALARM_ERR_RTA_CPU] {
        let mut frame = captured::frame(text);
        frame[..6].copy_from_slice(&MAC.0);
        frame[6..12].copy_from_slice(&CONTROLLER_MAC.0);
        seeds.push((Port::Ethernet, frame));
    }
    // The announcement of a neighbour.
    let mut rig = DeviceRig::new();
    rig.advance(Duration::ZERO);
    let (_, mut frame) = rig.announced.remove(0);
    frame[6..12].copy_from_slice(&CONTROLLER_MAC.0);
    seeds.push((Port::Ethernet, frame));
    seeds
}

const PORTS: &[Port] = &[Port::Ethernet, Port::Udp(RPC_PORT), Port::Udp(UDP_PORT), Port::Udp(1)];

/// Generates a bad frame: noise, or a good frame with some bytes changed, cut off or added.
fn bad_frame() -> impl Strategy<Value = (Port, Vec<u8>)> {
    let noise = (prop::sample::select(PORTS), prop::collection::vec(any::<u8>(), 0..400));
    let spoilt = (
        prop::sample::select(seeds()),
        prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..4),
        prop::option::of(any::<prop::sample::Index>()),
        0..20_usize,
    );
    let spoilt = spoilt.prop_map(|((port, mut frame), changes, cut, more)| {
        for (place, value) in changes {
            let place = place.index(frame.len());
            frame[place] = value;
        }
        if let Some(cut) = cut {
            frame.truncate(cut.index(frame.len()));
        }
        frame.extend(core::iter::repeat_n(0xFF, more));
        (port, frame)
    });
    prop_oneof![1 => noise, 4 => spoilt]
}

/// Connects a good controller, with an activity, session and AR of its own, after an old AR has timed out.
fn a_good_controller_connects(mut rig: DeviceRig) {
    rig.advance(Duration::from_secs(200));
    rig.events();
    rig.device.address_set(rig.now, false);
    rig.drain();
    rig.activity = Uuid([0xEE; 16]);
    rig.sequence = 0;
    let mut request = connect_request(RtClass::Udp, true);
    request.ar.session = 77;
    rig.rt_class = RtClass::Udp;
    let (status, response) = rig.connect(&request);
    assert_eq!(status, Status::OK);
    assert_eq!(response.unwrap().diff, []);
    let blocks = Control { session: 77, ..control(Command::PrmEnd) };
    let (status, sent) = rig.control(Operation::Control, blocks);
    assert_eq!(status, Status::OK);
    rig.confirm(&sent[0].1);
    rig.send_data(&[3; LEN]);
    assert_eq!(rig.device.output(1, 1), Some(&[3; LEN][..]));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn no_frames_stop_a_device_without_a_connection(frames in prop::collection::vec(bad_frame(), 0..12)) {
        let mut rig = DeviceRig::new();
        for (port, frame) in &frames {
            rig.receive(*port, frame);
            rig.advance(Duration::from_micros(500));
        }
        a_good_controller_connects(rig);
    }

    #[test]
    fn no_frames_stop_a_device_with_a_connection(frames in prop::collection::vec(bad_frame(), 0..12)) {
        let mut rig = DeviceRig::connected(RtClass::Class1);
        for (port, frame) in &frames {
            rig.receive(*port, frame);
            rig.advance(Duration::from_micros(500));
        }
        a_good_controller_connects(rig);
    }

    #[test]
    fn good_requests_in_any_order_and_number_leave_the_device_fit(order in prop::collection::vec(0..64_usize, 0..40)) {
        let mut rig = DeviceRig::new();
        let seeds = seeds();
        for index in order {
            let (port, frame) = &seeds[index % seeds.len()];
            rig.receive(*port, frame);
            rig.advance(Duration::from_micros(300));
        }
        a_good_controller_connects(rig);
    }
}

#[test]
fn every_cut_of_every_request_is_counted_and_answered_or_dropped() {
    for (port, frame) in seeds() {
        for len in 0..frame.len() {
            let mut rig = DeviceRig::connected(RtClass::Class1);
            rig.receive(port, &frame[..len]);
            let counters = rig.device.counters();
            let taken = counters.malformed + counters.foreign + counters.late;
            // Zeros behind the PDU of an Ethernet frame are padding, which may be missing.
            assert!(taken == 1 || port == Port::Ethernet, "{port:?} {len}: {counters:?}");
            assert!(rig.device.output(1, 1).is_some() || port == Port::Ethernet);
        }
    }
}

#[test]
fn an_unsolicited_confirmation_is_foreign() {
    let mut rig = DeviceRig::connected(RtClass::Class1);
    rig.receive(Port::Udp(RPC_PORT), &captured::datagram(captured::APPREADY_RES));
    assert_eq!(rig.device.counters().foreign, 1);
    assert_eq!(rig.events(), []);
}

#[test]
fn fragments_that_never_end_do_not_keep_others_out() {
    let mut rig = DeviceRig::new();
    for sequence in 0..100 {
        let header = Header { flags: flags::FRAGMENT, sequence, ..rig.header(Operation::Connect) };
        let mut buf = [0; 1500];
        let len = header.emit(&[0; 1300], &mut buf).unwrap();
        rig.receive(Port::Udp(RPC_PORT), &buf[..len]);
    }
    a_good_controller_connects(rig);
}
