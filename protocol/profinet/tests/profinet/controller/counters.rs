//! What the controller counts: frames that belong to no AR, and the frames of each AR.

use machine::Counters;
use profinet::Uuid;
use profinet::alarm::FRAME_ID_LOW;
use profinet::dcp;
use profinet::rpc::{CONTROLLER_INTERFACE, ENDPOINT_MAPPER_INTERFACE, Operation, flags};
use profinet::rt::{CyclicFrame, DataStatus, UDP_PORT, cycle_counter};

use super::peer::{ethernet, udp};
use super::*;

const STRANGER: Mac = Mac([2, 0, 0, 0, 0, 9]);
const STRANGERS_ADDRESS: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 9);

const MALFORMED: (u64, u64) = (1, 0);
const FOREIGN: (u64, u64) = (0, 1);

type Frame = (Source, Vec<u8>);

fn connected(transport: Transport) -> Cell {
    let mut cell = Cell::new(transport, PeerScript::default());
    assert_eq!(cell.run(50), [LinkEvent::Up]);
    cell
}

/// Delivers each frame twice and compares what the controller counts each time as malformed and foreign; nothing is answered.
fn counts(cell: &mut Cell, cases: Vec<(&str, Frame, (u64, u64))>) {
    let (ars, frames) = (cell.ar().counters(), cell.frames);
    for (name, frame, (malformed, foreign)) in cases {
        for round in 0..2 {
            let before = cell.controller.counters();
            cell.deliver(frame.clone());
            let expected = Counters {
                malformed: before.malformed + malformed,
                foreign: before.foreign + foreign,
                ..before
            };
            assert_eq!(cell.controller.counters(), expected, "{name}, {round}");
        }
        assert_eq!((cell.frames, cell.ar().counters()), (frames, ars), "{name}");
    }
    assert_eq!(cell.run(50), []);
}

fn cut(len: usize) -> Frame {
    let (source, mut frame) = ethernet(|w| w.bytes(&[0x80; 40]));
    frame.truncate(len);
    (source, frame)
}

/// Returns the same frame of another station, at the same port.
fn strangers((mut source, mut frame): Frame) -> Frame {
    match &mut source.peer {
        Some(peer) => peer.set_ip(STRANGERS_ADDRESS),
        None => frame[6..12].copy_from_slice(&STRANGER.0),
    }
    (source, frame)
}

/// Returns a cyclic frame of the device.
fn cyclic(cell: &Cell, sent_at: Instant, transfer_status: u8) -> Frame {
    let input = &cell.peer.connect.as_ref().unwrap().iocrs[0];
    let frame = CyclicFrame {
        frame_id: input.frame_id,
        c_sdu: &vec![0; usize::from(input.data_length)],
        cycle_counter: cycle_counter(sent_at),
        data_status: DataStatus::RUNNING,
        transfer_status,
    };
    cell.peer.rt(|w| frame.emit(w))
}

/// Returns a PDU of RPC from the device.
fn rpc(change: impl FnOnce(&mut Header)) -> Frame {
    let mut header = Header::request(Operation::Control, Uuid::NIL, CONTROLLER_INTERFACE, Uuid([9; 16]), 0);
    change(&mut header);
    peer::datagram(&header, |_| 0)
}

#[test]
fn raw_ethernet_frames_that_belong_to_no_ar_are_counted_and_ignored() {
    let mut cell = connected(Transport::Rt1);
    let next = cyclic(&cell, cell.now + Duration::from_millis(1), 0);
    let dcp_answer = ethernet(|w| dcp::emit(w, dcp::Service::IdentifyResponse, 77, 0, []));
    let frame_id = |id: u16| ethernet(|w| w.u16(id));
    counts(
        &mut cell,
        vec![
            ("no header", cut(13), MALFORMED),
            ("no FrameID", cut(14), MALFORMED),
            ("half a FrameID", cut(15), MALFORMED),
            ("a FrameID of no AR", frame_id(0x9000), FOREIGN),
            ("the FrameID of the AR from another station", strangers(next), FOREIGN),
            ("an alarm of another station", strangers(frame_id(FRAME_ID_LOW)), FOREIGN),
            ("an answer to a DCP request of others", dcp_answer, FOREIGN),
            ("an unknown service of DCP", ethernet(|w| w.bytes(&[0xFE, 0xFF, 9, 9])), MALFORMED),
            ("half a DCP PDU", ethernet(|w| w.bytes(&[0xFE, 0xFD, 3, 0, 0, 0, 0, 0, 0, 0, 9, 9])), MALFORMED),
            ("another port", (Source { port: Port::Udp(1), ..udp(1, 1) }, vec![0; 60]), FOREIGN),
            ("no sender", (Source { peer: None, ..udp(RPC_PORT, 1) }, vec![4; 100]), FOREIGN),
        ],
    );
}

#[test]
fn an_ar_takes_cyclic_data_of_its_transport_only() {
    for (transport, other) in [(Transport::Rt1, Transport::Udp), (Transport::Udp, Transport::Rt1)] {
        let mut cell = connected(transport);
        let (_, frame) = cyclic(&cell, cell.now + Duration::from_millis(1), 0);
        let payload = if transport == Transport::Rt1 { frame[14..].to_vec() } else { frame };
        let frame = match other {
            Transport::Rt1 => ethernet(|w| w.bytes(&payload)),
            Transport::Udp => (udp(UDP_PORT, UDP_PORT), payload),
        };
        counts(&mut cell, vec![("the other transport", frame, FOREIGN)]);
    }
}

#[test]
fn datagrams_of_cyclic_data_that_belong_to_no_ar_are_counted_and_ignored() {
    let mut cell = connected(Transport::Udp);
    let next = cyclic(&cell, cell.now + Duration::from_millis(1), 0);
    let datagram = |bytes: &[u8]| (udp(UDP_PORT, UDP_PORT), bytes.to_vec());
    counts(
        &mut cell,
        vec![
            ("empty", datagram(&[]), MALFORMED),
            ("half a FrameID", datagram(&[0xC0]), MALFORMED),
            ("an empty one of another station", strangers(datagram(&[])), FOREIGN),
            ("a FrameID of no AR", datagram(&[0xC1, 0]), FOREIGN),
            ("the FrameID of the AR from another station", strangers(next), FOREIGN),
        ],
    );
}

#[test]
fn pdus_of_rpc_that_belong_to_no_ar_are_counted_and_not_answered() {
    let mut cell = connected(Transport::Udp);
    let short = (udp(RPC_PORT, 1), vec![4; 79]);
    let ready = cell.peer.application_ready();
    counts(
        &mut cell,
        vec![
            ("half a header", short.clone(), MALFORMED),
            ("half a header of another station", strangers(short), FOREIGN),
            ("a call of another station", strangers(ready), FOREIGN),
            ("an answer to no call", rpc(|header| header.kind = Kind::Response), FOREIGN),
            ("an answer of another station", strangers(rpc(|header| header.kind = Kind::Response)), FOREIGN),
            (
                "an answer of another station's endpoint mapper",
                strangers(rpc(|header| {
                    (header.kind, header.interface) = (Kind::Response, ENDPOINT_MAPPER_INTERFACE);
                })),
                FOREIGN,
            ),
            ("a call that wants no answer", rpc(|header| header.flags |= flags::MAYBE), FOREIGN),
            (
                "a fragment without the one before",
                rpc(|header| (header.flags, header.fragment) = (flags::FRAGMENT, 1)),
                MALFORMED,
            ),
        ],
    );
}

#[test]
fn a_call_that_breaks_the_format_is_counted_and_answered_with_its_fault() {
    let mut cell = connected(Transport::Udp);
    for round in 1..=2 {
        let frames = cell.frames;
        cell.deliver(rpc(|header| header.sequence = round));
        assert_eq!((cell.controller.counters().malformed, cell.frames), (round.into(), frames + 1));
    }
}

#[test]
fn damaged_frames_of_a_device_are_counted_by_its_ar() {
    for transport in [Transport::Rt1, Transport::Udp] {
        let mut cell = connected(transport);
        let next = cell.now + Duration::from_millis(1);
        let of_controller = cell.controller.counters();
        for round in 1..=2 {
            cell.deliver(cyclic(&cell, next, 1));
            assert_eq!(cell.ar().counters().malformed, 2 * round - 1);
            let alarm = cell.peer.rt(|w| w.bytes(&[0xFE, 0x01, 0, 0]));
            cell.deliver(alarm);
            assert_eq!(cell.ar().counters().malformed, 2 * round);
        }
        assert_eq!((cell.run(50), cell.controller.counters()), (Vec::new(), of_controller));
    }
}

#[test]
fn lost_late_and_skipped_frames_are_counted_across_connections() {
    let mut cell = connected(Transport::Rt1);
    let counted = |cell: &mut Cell| {
        let Counters { skipped, lost, late, .. } = cell.ar().counters();
        (skipped, lost, late)
    };
    assert_eq!(counted(&mut cell), (0, 0, 0));
    cell.peer.script.no_cyclic = true;
    cell.run(5);
    cell.peer.script.no_cyclic = false;
    cell.run(5);
    assert_eq!(counted(&mut cell), (0, 5, 0));
    for _ in 0..2 {
        let earlier = cell.now - Duration::from_millis(3);
        cell.deliver(cyclic(&cell, earlier, 0));
    }
    assert_eq!(counted(&mut cell), (0, 5, 2));
    // Nobody calls the controller for four cycles, so it sends nothing, and the peer does not answer.
    cell.now = cell.controller.poll_timeout().unwrap() + Duration::from_millis(4);
    let now = cell.now;
    cell.controller.handle_timeout(now);
    cell.run(5);
    assert_eq!(counted(&mut cell), (4, 9, 2));

    for _ in 0..2 {
        cell.peer.script.silent = true;
        cell.run(50);
        cell.peer.script.silent = false;
        assert_eq!(cell.run(500).last(), Some(&LinkEvent::Up));
        assert_eq!(counted(&mut cell), (4, 9, 2));
    }
}

#[test]
fn a_controller_has_4096_ars_at_most_and_a_removed_one_makes_room() {
    let mask = Ipv4Addr::new(255, 255, 0, 0);
    let mut controller = Controller::new(ControllerConfig { mask, ..controller_config() }).unwrap();
    let connect = |controller: &mut Controller, device: u16| {
        let [high, low] = device.to_be_bytes();
        let [a, b, ..] = DEVICE_ADDRESS.octets();
        let config = ArConfig {
            station_name: format!("device-{device}"),
            address: Ipv4Addr::new(a, b, high + 100, low),
            ..ar(Transport::Rt1)
        };
        controller.connect(config, Instant::ZERO)
    };
    let ids: Vec<ArId> = (0..4096).map(|device| connect(&mut controller, device).unwrap()).collect();
    let refused = connect(&mut controller, 5_000).unwrap_err();
    assert_eq!(refused.to_string(), "a controller has 4096 ARs at most: remove one first");
    assert!(controller.remove(ids[7]).is_some());
    assert_eq!(connect(&mut controller, 5_000), Ok(ids[7]));
    assert!(connect(&mut controller, 5_001).is_err());
}

#[test]
fn two_devices_with_one_name_or_one_address_are_refused_and_named() {
    let mut controller = controller();
    let first = ar(Transport::Rt1);
    let id = controller.connect(first.clone(), Instant::ZERO).unwrap();
    let mut refusal = |config: ArConfig| controller.connect(config, Instant::ZERO).unwrap_err().to_string();
    assert_eq!(
        refusal(first.clone()),
        "two devices have the station name \"device\": give one of them another name"
    );
    assert_eq!(
        refusal(ArConfig { station_name: "other".into(), ..first.clone() }),
        format!(
            "the devices \"device\" and \"other\" have the address {DEVICE_ADDRESS}: give one of them another address"
        )
    );
    assert_eq!(
        refusal(ArConfig { station_name: "other".into(), address: CONTROLLER_ADDRESS, ..first.clone() }),
        format!(
            "the device \"other\" has the controller's address {CONTROLLER_ADDRESS}: give one of them another address"
        )
    );
    assert!(controller.remove(id).is_some());
    assert!(controller.connect(first, Instant::ZERO).is_ok(), "the name and the address are free again");
}
