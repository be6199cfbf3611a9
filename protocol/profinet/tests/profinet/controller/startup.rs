//! From an unknown station to data both ways, and what may go wrong on the way.

use profinet::alarm::{FRAME_ID_HIGH, FRAME_ID_LOW};
use profinet::connect::{ArProperties, DiffModule, DiffSubmodule, ModuleState, RtClass, SubmoduleState};
use profinet::dcp;
use profinet::rpc::flags;
use profinet::rt::UDP_PORT;
use profinet::status::{Service, Violation};

use super::peer::ethernet;
use super::*;
use crate::samples::LEN;
#[test]
fn the_connection_is_up_within_a_few_cycles_on_either_transport() {
    for transport in [Transport::Rt1, Transport::Udp] {
        let mut cell = Cell::new(transport, PeerScript::default());
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
    let mut cell = Cell::new(Transport::Udp, PeerScript::default());
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
fn all_outputs_are_set_at_once() {
    let mut cell = Cell::new(Transport::Udp, PeerScript::default());
    cell.run(10);
    cell.ar().set_outputs(|slot, subslot, data| {
        assert_eq!((slot, subslot, data.len()), (1, 1, LEN));
        data.fill(7);
    });
    cell.run(2);
    let last = cell.peer.outputs.last().unwrap();
    assert_eq!((last[4], last[259], last[260]), (7, 7, 0x80));
}

#[test]
fn inputs_that_the_device_calls_bad_are_not_handed_out() {
    let mut cell = Cell::new(Transport::Rt1, PeerScript { bad_input: true, ..PeerScript::default() });
    assert_eq!(cell.run(10), [LinkEvent::Up]);
    assert_eq!(cell.input(), None);
    cell.peer.script.bad_input = false;
    cell.run(2);
    assert!(cell.input().is_some());
}

#[test]
fn a_silent_device_is_reported_once_after_3_s_and_found_when_it_comes() {
    let mut cell = Cell::new(Transport::Udp, PeerScript { silent: true, ..PeerScript::default() });
    assert_eq!(cell.run(2_799), []);
    cell.goes_down(2, &[(DownCause::NoAnswer, 0, "no station answers")]);
    assert_eq!(cell.run(20_000), []);
    cell.peer.script.silent = false;
    assert_eq!(cell.run(500), [LinkEvent::Up]);
}

#[test]
fn a_device_that_answers_by_dcp_only_is_reported_with_what_to_check() {
    let mut cell = Cell::new(Transport::Udp, PeerScript { deaf_to_rpc: true, ..PeerScript::default() });
    cell.goes_down(3_000, &[(DownCause::NoAnswer, 0, "the device is there but does not answer calls")]);
    assert_eq!(cell.run(20_000), []);
}

#[test]
fn a_device_whose_object_has_another_instance_is_found_without_a_report() {
    for instance in [0, 1, 100, 0x1064] {
        let script = PeerScript { instances: vec![instance], ..PeerScript::default() };
        let mut cell = Cell::new(Transport::Rt1, script);
        assert_eq!(cell.run(10), [LinkEvent::Up], "{instance}");
    }
    // It has none of them.
    let script = PeerScript { instances: vec![7, 0], ..PeerScript::default() };
    let mut cell = Cell::new(Transport::Rt1, script);
    assert_eq!(cell.run(10), [LinkEvent::Up]);
    let script = PeerScript { instances: vec![7], reports_no_instance: true, ..PeerScript::default() };
    let mut cell = Cell::new(Transport::Rt1, script);
    cell.goes_down(10_000, &[(DownCause::Refused, 0x1C01_0003, "the device rejected the call")]);
}

#[test]
fn a_device_whose_address_another_station_has_is_reported_and_used_when_that_one_is_gone() {
    let script = PeerScript { deaf_to_rpc: true, address_conflict: true, ..PeerScript::default() };
    let mut cell = Cell::new(Transport::Rt1, script);
    cell.goes_down(
        10_000,
        &[(DownCause::NoAnswer, 0, "the device does not answer calls, and reports by DCP")],
    );
    cell.peer.script = PeerScript { has_address: true, ..PeerScript::default() };
    assert_eq!(cell.run(8_000), [LinkEvent::Up]);
}

#[test]
fn a_device_with_an_old_stack_is_asked_for_what_it_knows() {
    let mut cell = Cell::new(Transport::Rt1, PeerScript { is_old: true, ..PeerScript::default() });
    assert_eq!(cell.run(10), [LinkEvent::Up]);
    let connect = cell.peer.connect.as_ref().unwrap();
    assert!(!connect.ar.properties.has(ArProperties::ADVANCED_STARTUP));
    let classes: Vec<_> = connect.iocrs.iter().map(|iocr| (iocr.rt_class, iocr.frame_id)).collect();
    assert_eq!(classes, [(RtClass::Legacy1, 0xC000), (RtClass::Legacy1, 0xC001)]);
    let session = connect.ar.session;
    cell.peer.script.silent = true;
    cell.run(50);
    cell.peer.script.silent = false;
    assert_eq!(cell.run(500), [LinkEvent::Up]);
    let again = cell.peer.connect.as_ref().unwrap().ar.session;
    assert_eq!(again, session + 1, "the next connection begins with what it knows");
}

#[test]
fn a_connect_that_is_refused_in_every_form_is_reported_once() {
    for violation in [Violation::ArProperties, Violation::IocrProperties] {
        let status = violation.status(Service::Connect);
        let script = PeerScript { refuses_connect: Some(status), ..PeerScript::default() };
        let mut cell = Cell::new(Transport::Rt1, script);
        cell.goes_down(10_000, &[(DownCause::Refused, status.0, violation.text())]);
    }
}

#[test]
fn a_refused_connect_is_reported_once_with_its_status_in_words() {
    let status = Violation::OutOfArResources.status(Service::Connect);
    let script = PeerScript { refuses_connect: Some(status), ..PeerScript::default() };
    let mut cell = Cell::new(Transport::Udp, script);
    let text = "the device has no AR left";
    cell.goes_down(10_000, &[(DownCause::Refused, 0xDB81_4004, text)]);
    cell.peer.script.refuses_connect = None;
    assert_eq!(cell.run(2_000), [LinkEvent::Up]);
}

#[test]
fn a_wrong_module_is_reported_with_its_slot_and_the_ar_is_aborted() {
    let wrong = DiffModule { slot: 1, ident: 0x99, state: ModuleState::WrongModule, submodules: Vec::new() };
    let mut cell =
        Cell::new(Transport::Udp, PeerScript { diff: vec![wrong.clone()], ..PeerScript::default() });
    cell.goes_down(50, &[(DownCause::Refused, 0x0001_0000, "the device has another module")]);
    assert_eq!(cell.ar().module_diff(), [wrong]);
    assert_eq!(cell.peer.partings, [Violation::ArRemoved.status(Service::Abort)]);
}

#[test]
fn a_submodule_that_is_missing_is_refused_in_either_format_and_a_substitute_is_driven() {
    let with = |state| {
        let submodules = vec![DiffSubmodule { subslot: 1, ident: 0, state: SubmoduleState(state) }];
        let diff = vec![DiffModule { slot: 1, ident: 0x100, state: ModuleState::ProperModule, submodules }];
        Cell::new(Transport::Udp, PeerScript { diff, ..PeerScript::default() })
    };
    for state in [0x9800, 0x9000, 0, 1] {
        with(state).goes_down(50, &[(DownCause::Refused, 0x0001_0001, "the device has another submodule")]);
    }
    for state in [0x8800, 7] {
        assert_eq!(with(state).run(50), [LinkEvent::Up], "0x{state:04X}");
    }
}

#[test]
fn what_a_device_says_of_its_modules_when_it_is_ready_counts() {
    let with = |state| {
        let submodules = vec![DiffSubmodule { subslot: 1, ident: 0x101, state: SubmoduleState(state) }];
        vec![DiffModule { slot: 1, ident: 0x100, state: ModuleState::ProperModule, submodules }]
    };
    // Of the right kind, but not ready yet.
    let pending = with(0x8080);
    let script = PeerScript { diff_when_ready: pending.clone(), ..PeerScript::default() };
    let mut cell = Cell::new(Transport::Rt1, script);
    assert_eq!(cell.run(50), [LinkEvent::Up]);
    assert_eq!((cell.peer.answered_ready, cell.ar().module_diff()), (1, &pending[..]));

    // Pulled since Connect.
    let script = PeerScript { diff_when_ready: with(0x9800), ..PeerScript::default() };
    let mut cell = Cell::new(Transport::Rt1, script);
    cell.goes_down(50, &[(DownCause::Refused, 0x0001_0001, "the device has another submodule")]);
    assert_eq!(cell.peer.partings, [Violation::ArRemoved.status(Service::Abort)]);
}

#[test]
fn a_frame_id_that_is_not_one_of_cyclic_data_is_refused_and_nothing_is_sent_with_it() {
    for frame_id in [0, 0x7FFF, 0xBC00, 0xFBFF, FRAME_ID_HIGH, FRAME_ID_LOW, 0xFEFD] {
        let script = PeerScript { output_frame_id: Some(frame_id), ..PeerScript::default() };
        let mut cell = Cell::new(Transport::Udp, script);
        cell.goes_down(50, &[(DownCause::Refused, frame_id.into(), "the device gave cyclic data a FrameID")]);
        assert_eq!((cell.ar().counters().sent, cell.peer.outputs.len()), (0, 0));
    }
}

#[test]
fn a_device_that_says_it_is_a_group_of_stations_gets_no_data() {
    let script = PeerScript { responder_mac: Some(Mac([0xFF; 6])), ..PeerScript::default() };
    let mut cell = Cell::new(Transport::Rt1, script);
    cell.goes_down(50, &[(DownCause::Refused, 0, "the device's answer does not fit")]);
    assert_eq!(cell.peer.outputs.len(), 0);
}

#[test]
fn data_and_alarms_over_udp_go_to_the_port_that_the_device_names() {
    for (named, expected) in [
        (None, UDP_PORT),
        (Some(50_000), 50_000),
        (Some(0), UDP_PORT),
        (Some(0x3FF), UDP_PORT),
        (Some(0x400), 0x400),
    ] {
        let script = PeerScript { responder_rt_port: named, ..PeerScript::default() };
        let mut cell = Cell::new(Transport::Udp, script);
        assert_eq!(cell.run(50), [LinkEvent::Up]);
        cell.peer.script.no_cyclic = true;
        cell.run(50);
        assert_eq!(cell.peer.partings.len(), 1, "an error PDU, too");
        assert_eq!(cell.peer.rt_ports, [expected].into());
    }
}

#[test]
fn a_device_may_choose_any_frame_id_of_cyclic_data() {
    for frame_id in [0x8000, 0xBBFF, 0xC0FF, 0xF7FF] {
        let script = PeerScript { output_frame_id: Some(frame_id), ..PeerScript::default() };
        let mut cell = Cell::new(Transport::Udp, script);
        assert_eq!(cell.run(50), [LinkEvent::Up]);
    }
}

#[test]
fn a_refused_parameter_is_reported_with_its_status() {
    let status = Violation::WriteLength.status(Service::Write);
    let script = PeerScript { refuses_write: Some(status), ..PeerScript::default() };
    let mut cell = Cell::new(Transport::Udp, script);
    cell.goes_down(50, &[(DownCause::Refused, status.0, "the record has another length")]);
}

#[test]
fn application_ready_may_overtake_the_answer_to_prm_end() {
    let mut cell =
        Cell::new(Transport::Udp, PeerScript { ready_before_prm_end: true, ..PeerScript::default() });
    assert_eq!(cell.run(5), [LinkEvent::Up]);
}

#[test]
fn a_device_that_is_ready_needs_no_answer_to_prm_end() {
    let conflict = Violation::StateConflict.status(Service::Control);
    for (refusal, millis) in [(Some(conflict), 300), (None, 3_100)] {
        let script = PeerScript { prm_end_lost: Some(refusal), ..PeerScript::default() };
        let mut cell = Cell::new(Transport::Rt1, script);
        assert_eq!(cell.run(millis).last(), Some(&LinkEvent::Up), "{refusal:?}");
        assert_eq!(cell.run(10_000), []);
    }
}

#[test]
fn a_device_that_takes_seconds_for_each_call_is_waited_for() {
    let config = ArConfig { cycle: Duration::from_millis(64), ..ar(Transport::Udp) };
    let script = PeerScript { slow: Duration::from_millis(4_500), ..PeerScript::default() };
    let mut cell = Cell::with(config, script);
    let events = cell.run(40_000);
    assert_eq!(events.last(), Some(&LinkEvent::Up), "{events:?}");
}

/// Returns a cell with a device that does not get ready by itself, at a cycle of 64 ms.
fn unready(script: PeerScript) -> Cell {
    let config = ArConfig { cycle: Duration::from_millis(64), ..ar(Transport::Udp) };
    Cell::with(config, PeerScript { never_ready: true, ..script })
}

#[test]
fn a_device_that_sends_data_may_take_five_minutes_to_get_ready() {
    let mut cell = unready(PeerScript::default());
    cell.goes_down(3_000, &[(DownCause::NoAnswer, 0, "the device took its parameters but")]);
    assert_eq!(cell.run(296_000), []);
    let ready = cell.peer.application_ready();
    cell.deliver(ready);
    assert_eq!(cell.run(200), [LinkEvent::Up]);
    assert_eq!(cell.peer.partings, []);
}

/// Cuts a call into two fragments, whose sender waits for an acknowledgement of the first.
fn fragments((source, call): (Source, Vec<u8>)) -> [(Source, Vec<u8>); 2] {
    let (header, body) = Header::parse(&call).unwrap();
    let (first, second) = body.split_at(40);
    [(0, flags::FRAGMENT, first), (1, flags::FRAGMENT | flags::LAST_FRAGMENT, second)].map(
        |(fragment, flags, part)| {
            let header = Header { fragment, flags, ..header };
            let mut buf = [0; 200];
            let len = header.emit(part, &mut buf).unwrap();
            (source, buf[..len].to_vec())
        },
    )
}

#[test]
fn an_application_ready_in_fragments_is_taken_when_it_is_whole() {
    let mut cell = unready(PeerScript::default());
    cell.goes_down(3_000, &[(DownCause::NoAnswer, 0, "the device took its parameters but")]);
    let [first, second] = fragments(cell.peer.application_ready());
    let mut buf = [0; FRAME_CAPACITY];
    cell.controller.handle_frame(cell.now, first.0, &first.1);
    let transmit = cell.poll(&mut buf).expect("an acknowledgement");
    let (acknowledgement, _) = Header::parse(&buf[..transmit.len]).unwrap();
    assert_eq!((acknowledgement.kind, acknowledgement.fragment), (Kind::FragmentAck, 0));
    assert_eq!((cell.run(100), cell.peer.answered_ready), (Vec::new(), 0));
    // The second one alone, of a call that began twice, is no call.
    let [_, stray] = fragments(cell.peer.application_ready());
    let before = cell.controller.counters().malformed;
    cell.deliver(stray);
    assert_eq!((cell.controller.counters().malformed, cell.peer.answered_ready), (before + 1, 0));
    for fragment in [first, second] {
        cell.deliver(fragment);
    }
    assert_eq!((cell.run(200), cell.peer.answered_ready), (vec![LinkEvent::Up], 1));
}

#[test]
fn a_device_that_never_gets_ready_is_given_up_after_five_minutes_and_without_data_after_20_s() {
    for (no_cyclic, millis) in [(false, 300_000), (true, 20_000)] {
        let mut cell = unready(PeerScript { no_cyclic, ..PeerScript::default() });
        cell.goes_down(3_000, &[(DownCause::NoAnswer, 0, "the device took its parameters but")]);
        cell.goes_down(millis - 3_010, &[]);
        assert_eq!(cell.peer.partings, []);
        cell.goes_down(110, &[]);
        assert_eq!(cell.peer.partings, [Violation::ApplicationReadyTimeout.status(Service::Abort)]);
    }
}

#[test]
fn a_device_whose_data_stop_while_it_prepares_itself_is_missed_after_the_watchdog_time() {
    let mut cell = Cell::new(Transport::Rt1, PeerScript { never_ready: true, ..PeerScript::default() });
    assert_eq!(cell.run(1_000), []);
    cell.peer.script.no_cyclic = true;
    cell.goes_down(30, &[(DownCause::Watchdog, 0xCF81_FD05, "no cyclic frame came within")]);
    assert_eq!(cell.peer.partings, [Violation::ConsumerExpired.status(Service::Abort)]);
    cell.peer.script = PeerScript::default();
    assert_eq!(cell.run(400), [LinkEvent::Up]);
}

#[test]
fn a_device_that_connects_but_sends_no_data_is_told_apart() {
    let mut cell = Cell::new(Transport::Udp, PeerScript { no_cyclic: true, ..PeerScript::default() });
    cell.goes_down(50, &[(DownCause::Watchdog, 0xCF81_FD05, "the device is connected but sends no cyclic")]);
}

#[test]
fn a_hello_of_the_device_ends_a_long_pause_and_that_of_another_station_does_not() {
    let hello = |name: &[u8]| {
        let blocks = [dcp::Content::NameOfStation(name).into()];
        let (source, mut frame) = ethernet(|w| dcp::emit(w, dcp::Service::Hello, 1, 0, blocks));
        frame[..6].copy_from_slice(&dcp::HELLO_MULTICAST.0);
        (source, frame)
    };
    // Attempts at 0, 0.3, 0.7, 1.3 and 2.3 s, each with a search of 0.2 s; the next one would be at 4.1 s.
    let refusal = Some(Violation::OutOfArResources.status(Service::Connect));
    for (name, up_after) in [(&b"device"[..], 300), (b"Device", 300), (b"other", 900)] {
        let mut cell =
            Cell::new(Transport::Rt1, PeerScript { refuses_connect: refusal, ..PeerScript::default() });
        cell.run(3_200);
        cell.peer.script.refuses_connect = None;
        for _ in 0..100 {
            cell.deliver(hello(name));
        }
        assert_eq!(cell.run(up_after - 20), [], "{name:?}");
        assert_eq!(cell.run(40), [LinkEvent::Up], "{name:?}");
        // While data are exchanged, a Hello changes nothing.
        cell.deliver(hello(name));
        assert_eq!(cell.run(100), []);
    }
}

#[test]
fn a_device_without_the_record_of_its_interface_is_connected_all_the_same() {
    for (violation, is_up) in
        [(Violation::InvalidIndex, true), (Violation::AccessDenied, true), (Violation::ArUuidUnknown, false)]
    {
        let config = ArConfig { parameters: vec![Parameter::interface_adjust()], ..ar(Transport::Rt1) };
        let refuses_write = Some(violation.status(Service::Write));
        let mut cell = Cell::with(config, PeerScript { refuses_write, ..PeerScript::default() });
        let events = cell.run(10);
        assert_eq!(events == [LinkEvent::Up], is_up, "{violation:?}: {events:?}");
    }
}
