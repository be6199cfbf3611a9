//! The time that the controller has for its next step, and what counts as one.

use machine::PortRequest;

use super::life::cyclic_frames;
use super::*;

/// Sends data every 5 ms, which feeds the watchdog of 10 ms, for this time.
fn send_for(rig: &mut DeviceRig, millis: u32) {
    for _ in 0..millis / 5 {
        rig.advance(Duration::from_millis(5));
        rig.send_data(&[1; LEN]);
    }
}

fn gave_up(rig: &mut DeviceRig) -> (DownCause, u32) {
    let events = rig.events();
    let [LinkEvent::Down(down)] = events[..] else { panic!("{events:?}") };
    (down.cause, down.code)
}

const NO_STEP: (DownCause, u32) = (DownCause::Watchdog, 0xCF81_FD06);

#[test]
fn data_before_prm_end_do_not_replace_it() {
    let mut rig = DeviceRig::new();
    rig.connect(&connect_request(RtClass::Class1, true));
    send_for(&mut rig, 1_990);
    assert_eq!(rig.events(), []);
    send_for(&mut rig, 20);
    assert_eq!(gave_up(&mut rig), NO_STEP);
}

#[test]
fn while_data_go_no_step_is_missing() {
    let mut rig = DeviceRig::connected(RtClass::Class1);
    send_for(&mut rig, 5_000);
    assert_eq!(rig.events(), []);
    assert!(rig.device.output(1, 1).is_some());
}

#[test]
fn a_controller_that_confirms_and_sends_no_data_is_given_up() {
    let mut rig = DeviceRig::new();
    rig.connect(&connect_request(RtClass::Class1, true));
    let (_, sent) = rig.prm_end();
    rig.confirm(&sent[0].1);
    rig.advance(Duration::from_millis(1_999));
    assert_eq!(rig.events(), []);
    rig.advance(Duration::from_millis(1));
    assert_eq!(gave_up(&mut rig), NO_STEP);
}

#[test]
fn data_that_came_before_the_confirmation_are_enough_after_it() {
    let mut rig = DeviceRig::new();
    let mut request = connect_request(RtClass::Udp, true);
    // 7.68 s, longer than the step of 2 s.
    request.iocrs[1].data_hold_factor = 0x1E00;
    rig.rt_class = RtClass::Udp;
    rig.connect(&request);
    let (_, sent) = rig.prm_end();
    rig.send_data(&[1; LEN]);
    rig.confirm(&sent[0].1);
    rig.advance(Duration::from_secs(5));
    assert_eq!(rig.events(), [LinkEvent::Up]);
}

#[test]
fn the_watchdog_is_on_time_also_if_the_device_itself_sends_rarely() {
    let mut rig = DeviceRig::new();
    let mut request = connect_request(RtClass::Class1, true);
    let input = &mut request.iocrs[0];
    (input.reduction_ratio, input.watchdog_factor, input.data_hold_factor) = (512, 3, 3);
    rig.establish(&request);
    assert_eq!(rig.device.poll_timeout(), Some(rig.now + Duration::from_millis(10)));
    rig.advance(Duration::from_millis(10));
    assert_eq!(gave_up(&mut rig), (DownCause::Watchdog, 0xCF81_FD05));
}

#[test]
fn inputs_that_are_set_all_at_once_are_in_the_next_frame() {
    let mut rig = DeviceRig::connected(RtClass::Class1);
    let mut places = Vec::new();
    rig.device.set_inputs(|slot, subslot, data| {
        places.push((slot, subslot, data.len()));
        data.fill(0x44);
    });
    assert_eq!(places.iter().filter(|(.., len)| *len > 0).collect::<Vec<_>>(), [&(1, 1, LEN)]);
    let frames = cyclic_frames(&rig.advance(Duration::from_millis(2)), RtClass::Class1);
    assert_eq!(CyclicFrame::parse(&frames[0], 261).unwrap().c_sdu[..LEN], [0x44; LEN]);
}

#[test]
fn the_device_asks_for_the_ports_of_profinet_lldp_and_arp() {
    let ports = [
        profinet::ETHERNET,
        PortRequest::Udp(34_964),
        PortRequest::Udp(34_962),
        profinet::lldp::ETHERNET,
        machine::arp::ETHERNET,
    ];
    assert_eq!(device().ports(), ports);
}

#[test]
fn every_call_has_an_activity_of_its_own_made_of_its_number_the_start_and_the_address() {
    let start = Instant::from_micros(0x1234_5678_9ABC);
    let mut rig = DeviceRig { now: start, ..DeviceRig::around(Device::new(config(), start)) };
    rig.establish(&connect_request(RtClass::Class1, true));
    assert!(rig.control(Operation::Control, control(Command::PrmBegin)).0.is_ok());
    let (_, sent) = rig.prm_end();
    let (header, _) = Header::parse(&sent[0].1).unwrap();
    let activity = [0, 0, 0, 2, 0x56, 0x78, 0x19, 0xBC, 0x80, 0, 2, 0, 0, 0, 0, 2];
    assert_eq!(header.activity, Uuid(activity), "the second call");
}
