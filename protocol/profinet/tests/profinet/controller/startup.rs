//! From an unknown station to data both ways, and what may go wrong on the way.

use profinet::alarm::{FRAME_ID_HIGH, FRAME_ID_LOW};
use profinet::connect::{DiffModule, ModuleState};
use profinet::status::{Service, Violation};

use super::*;
use crate::samples::LEN;
#[test]
fn the_connection_is_up_within_a_few_cycles_on_either_transport() {
    for transport in [Transport::Rt1, Transport::Udp] {
        let mut cell = Cell::new(transport, Script::default());
        assert_eq!(cell.run(5), [LinkEvent::Up], "{transport:?}");
        assert_eq!(cell.peer.written, [[1, 2, 3, 4]]);
        assert_eq!(cell.peer.answered_ready, 1);
        assert_eq!(cell.input(), Some(0x42));
        cell.run(100);
        let counters = cell.ar().counters();
        assert!(counters.sent > 100 && counters.received > 100, "{counters:?}");
        assert_eq!((counters.lost, counters.late, counters.malformed, counters.foreign), (0, 0, 0, 0));
    }
}

#[test]
fn outputs_are_bad_until_they_are_set() {
    let mut cell = Cell::new(Transport::Udp, Script::default());
    cell.run(10);
    // Three IOCS of slot 0, one of slot 1, 256 bytes and their IOPS.
    let last = cell.peer.outputs.last().unwrap();
    assert_eq!(last[..5], [0x80, 0x80, 0x80, 0x80, 0]);
    assert_eq!(last[260] & 0x80, 0);
    cell.ar().set_output(1, 1, &[7; LEN]).unwrap();
    cell.run(2);
    let last = cell.peer.outputs.last().unwrap();
    assert_eq!((last[4], last[259], last[260], last.len()), (7, 7, 0x80, 261));
}

#[test]
fn inputs_that_the_device_calls_bad_are_not_handed_out() {
    let mut cell = Cell::new(Transport::Rt1, Script { bad_input: true, ..Script::default() });
    assert_eq!(cell.run(10), [LinkEvent::Up]);
    assert_eq!(cell.input(), None);
    cell.peer.script.bad_input = false;
    cell.run(2);
    assert!(cell.input().is_some());
}

#[test]
fn a_silent_device_is_reported_once_after_3_s_and_found_when_it_comes() {
    let mut cell = Cell::new(Transport::Udp, Script { silent: true, ..Script::default() });
    assert_eq!(cell.run(2_999), []);
    cell.goes_down(1, &[(DownCause::NoAnswer, 0, "no station answers")]);
    assert_eq!(cell.run(20_000), []);
    cell.peer.script.silent = false;
    assert_eq!(cell.run(500), [LinkEvent::Up]);
}

#[test]
fn a_device_that_answers_by_dcp_only_is_reported_with_what_to_check() {
    let mut cell = Cell::new(Transport::Udp, Script { deaf_to_rpc: true, ..Script::default() });
    cell.goes_down(3_000, &[(DownCause::NoAnswer, 0, "the device is there but does not answer calls")]);
    assert_eq!(cell.run(20_000), []);
}

#[test]
fn a_refused_connect_is_reported_once_with_its_status_in_words() {
    let status = Violation::OutOfArResources.status(Service::Connect);
    let script = Script { refuses_connect: Some(status), ..Script::default() };
    let mut cell = Cell::new(Transport::Udp, script);
    let text = "the device has no AR left";
    cell.goes_down(10_000, &[(DownCause::Refused, 0xDB81_4004, text)]);
    cell.peer.script.refuses_connect = None;
    assert_eq!(cell.run(2_000), [LinkEvent::Up]);
}

#[test]
fn a_wrong_module_is_reported_with_its_slot_and_the_ar_is_aborted() {
    let wrong = DiffModule { slot: 1, ident: 0x99, state: ModuleState::WrongModule, submodules: Vec::new() };
    let mut cell = Cell::new(Transport::Udp, Script { diff: vec![wrong.clone()], ..Script::default() });
    cell.goes_down(50, &[(DownCause::Refused, 0x0001_0000, "the device has another module")]);
    assert_eq!(cell.ar().module_diff(), [wrong]);
    assert_eq!(cell.peer.partings, [Violation::ArRemoved.status(Service::Abort)]);
}

#[test]
fn a_frame_id_that_is_not_one_of_cyclic_data_is_refused_and_nothing_is_sent_with_it() {
    for frame_id in [0, 0x7FFF, 0xBC00, 0xFBFF, FRAME_ID_HIGH, FRAME_ID_LOW, 0xFEFD] {
        let script = Script { output_frame_id: Some(frame_id), ..Script::default() };
        let mut cell = Cell::new(Transport::Udp, script);
        cell.goes_down(50, &[(DownCause::Refused, frame_id.into(), "the device gave cyclic data a FrameID")]);
        assert_eq!((cell.ar().counters().sent, cell.peer.outputs.len()), (0, 0));
    }
}

#[test]
fn a_device_that_says_it_is_a_group_of_stations_gets_no_data() {
    let script = Script { responder_mac: Some(Mac([0xFF; 6])), ..Script::default() };
    let mut cell = Cell::new(Transport::Rt1, script);
    cell.goes_down(50, &[(DownCause::Refused, 0, "the device's answer does not fit")]);
    assert_eq!(cell.peer.outputs.len(), 0);
}

#[test]
fn a_device_may_choose_any_frame_id_of_cyclic_data() {
    for frame_id in [0x8000, 0xBBFF, 0xC0FF, 0xF7FF] {
        let script = Script { output_frame_id: Some(frame_id), ..Script::default() };
        let mut cell = Cell::new(Transport::Udp, script);
        assert_eq!(cell.run(50), [LinkEvent::Up]);
    }
}

#[test]
fn a_refused_parameter_is_reported_with_its_status() {
    let status = Violation::WriteLength.status(Service::Write);
    let script = Script { refuses_write: Some(status), ..Script::default() };
    let mut cell = Cell::new(Transport::Udp, script);
    cell.goes_down(50, &[(DownCause::Refused, status.0, "the record has another length")]);
}

#[test]
fn application_ready_may_overtake_the_answer_to_prm_end() {
    let mut cell = Cell::new(Transport::Udp, Script { ready_before_prm_end: true, ..Script::default() });
    assert_eq!(cell.run(5), [LinkEvent::Up]);
}

#[test]
fn a_device_that_never_gets_ready_is_given_up_after_20_s() {
    let mut cell = Cell::new(Transport::Udp, Script { never_ready: true, ..Script::default() });
    cell.goes_down(3_000, &[(DownCause::NoAnswer, 0, "the device took its parameters but")]);
    assert_eq!(cell.peer.partings, []);
    cell.goes_down(17_100, &[]);
    assert_eq!(cell.peer.partings, [Violation::ApplicationReadyTimeout.status(Service::Abort)]);
}

#[test]
fn a_device_that_connects_but_sends_no_data_is_told_apart() {
    let mut cell = Cell::new(Transport::Udp, Script { no_cyclic: true, ..Script::default() });
    cell.goes_down(50, &[(DownCause::Watchdog, 0xCF81_FD05, "the device is connected but sends no cyclic")]);
}
