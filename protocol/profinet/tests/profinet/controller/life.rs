//! A connection that data go over, and its end.

use machine::wire::{BigEndian, Writer};
use profinet::alarm::{Alarm, AlarmHead, FRAME_ID_LOW, Notification, PduType, Rta};
use profinet::connect::ConnectRequest;
use profinet::description::{Description, Module, Submodule};
use profinet::status::{Service, Status, Violation};

use super::*;
#[test]
fn the_watchdog_ends_the_ar_tells_the_device_and_the_controller_reconnects() {
    let mut cell = Cell::new(Transport::Rt1, PeerScript::default());
    assert_eq!(cell.run(50), [LinkEvent::Up]);
    let first = cell.peer.connect.clone().unwrap();
    cell.peer.script.no_cyclic = true;
    cell.goes_down(30, &[(DownCause::Watchdog, 0xCF81_FD05, "no cyclic frame came within")]);
    assert_eq!(cell.input(), None);
    assert_eq!(cell.peer.partings, [Status(0xCF81_FD05)]);
    cell.peer.script.no_cyclic = false;
    assert_eq!(cell.run(400), [LinkEvent::Up]);
    let second = cell.peer.connect.as_ref().unwrap();
    assert_eq!((first.ar.session, second.ar.session), (1, 2), "another connection ...");
    assert_eq!(first.ar.uuid, second.ar.uuid, "... of the same AR ...");
    let endpoint = |request: &ConnectRequest| request.alarm_cr.map(|alarm_cr| alarm_cr.local_reference);
    assert_eq!(endpoint(&first), endpoint(second), "... which keeps its alarm endpoint");
}

#[test]
fn an_error_pdu_of_the_device_ends_the_ar_and_is_told_in_words() {
    for transport in [Transport::Rt1, Transport::Udp] {
        let mut cell = Cell::new(transport, PeerScript::default());
        cell.run(50);
        let rta = Rta {
            destination: 0,
            source: 9,
            pdu_type: PduType::Error,
            flags: Rta::WINDOW_1,
            send_sequence: 0xFFFE,
            ack_sequence: 0xFFFE,
        };
        let status = Violation::ConsumerExpired.status(Service::Abort);
        let pdu = |w: &mut Writer<'_, BigEndian>, rta: Rta| {
            w.u16(FRAME_ID_LOW);
            rta.emit_error(status, w);
        };
        let stale = cell.peer.rt(|w| pdu(w, Rta { destination: 1, ..rta }));
        cell.deliver(stale);
        assert_eq!(cell.events, [], "an error PDU for another endpoint ends nothing");
        let frame = cell.peer.rt(|w| pdu(w, rta));
        cell.deliver(frame);
        cell.goes_down(0, &[(DownCause::ClosedByPeer, status.0, status.text())]);
        assert_eq!(cell.run(400), [LinkEvent::Up]);
    }
}

#[test]
fn an_alarm_is_acknowledged_and_data_go_on() {
    let mut cell = Cell::new(Transport::Udp, PeerScript::default());
    cell.run(50);
    let rta = Rta {
        destination: 0,
        source: 9,
        pdu_type: PduType::Data,
        flags: Rta::WINDOW_1_TACK,
        send_sequence: 0xFFFF,
        ack_sequence: 0xFFFE,
    };
    let notification = Alarm::Notification(samples::DIAGNOSIS);
    let alarm = cell.peer.rt(|w| {
        w.u16(FRAME_ID_LOW);
        rta.emit(w, |w| notification.emit(w));
    });
    cell.deliver(alarm);
    assert_eq!(cell.peer.alarm_pdus, [PduType::Ack, PduType::Data]);
    let ack = Rta { pdu_type: PduType::Ack, ack_sequence: 0xFFFF, ..rta };
    let ack = cell.peer.rt(|w| {
        w.u16(FRAME_ID_LOW);
        ack.emit(w, |_| {});
    });
    cell.deliver(ack);
    assert_eq!(cell.run(1_000), [LinkEvent::Health]);
}

/// Delivers a low alarm of slot 1, subslot 1, and the acknowledgement of its AlarmAck.
pub(super) fn alarm(cell: &mut Cell, alarm_type: u16, specifier: u16, send_sequence: u16) {
    alarm_of(cell, (1, 1), alarm_type, specifier, send_sequence);
}

/// Delivers a low alarm of a slot and subslot, and the acknowledgement of its AlarmAck.
fn alarm_of(
    cell: &mut Cell,
    (slot, subslot): (u16, u16),
    alarm_type: u16,
    specifier: u16,
    send_sequence: u16,
) {
    let head = AlarmHead { alarm_type, slot, subslot, ..samples::DIAGNOSIS.head };
    deliver(cell, Notification { head, specifier, ..samples::DIAGNOSIS }, send_sequence);
}

/// Delivers an alarm twice, and the acknowledgement of its AlarmAck.
pub(super) fn deliver(cell: &mut Cell, notification: Notification<'_>, send_sequence: u16) {
    let rta = Rta {
        destination: 0,
        source: 9,
        pdu_type: PduType::Data,
        flags: Rta::WINDOW_1_TACK,
        send_sequence,
        ack_sequence: send_sequence.wrapping_sub(1),
    };
    let notification = Alarm::Notification(notification);
    for repetition in [false, true] {
        let frame = cell.peer.rt(|w| {
            w.u16(FRAME_ID_LOW);
            rta.emit(w, |w| notification.emit(w));
        });
        cell.deliver(frame);
        assert_eq!(cell.peer.plug_ends, [], "AlarmAck first, repetition: {repetition}");
    }
    let ack = Rta { pdu_type: PduType::Ack, ack_sequence: send_sequence, ..rta };
    let frame = cell.peer.rt(|w| {
        w.u16(FRAME_ID_LOW);
        ack.emit(w, |_| {});
    });
    cell.deliver(frame);
}

#[test]
fn a_submodule_that_is_plugged_gets_its_parameters_while_data_go_on() {
    const PLUG: u16 = 4;
    const RELEASED: u16 = 9;
    for transport in [Transport::Rt1, Transport::Udp] {
        for alarm_type in [PLUG, RELEASED] {
            let mut cell = Cell::new(transport, PeerScript::default());
            cell.run(50);
            cell.peer.written.clear();
            alarm(&mut cell, alarm_type, 0xA123, 0xFFFF);
            assert_eq!(cell.peer.written, [[1, 2, 3, 4]]);
            assert_eq!(cell.peer.plug_ends, [0x123]);
            assert_eq!(cell.peer.answered_ready, 2, "the one at the start, and that of the submodule");
            assert_eq!(cell.run(1_000), []);
            assert_eq!((cell.peer.plug_ends.len(), cell.ar().counters().malformed), (1, 0));
        }
    }
}

#[test]
fn alarms_of_other_kinds_write_no_parameters() {
    // Diagnosis, process, pull, update, plug of a wrong submodule, return, diagnosis disappears, pull of a module.
    for alarm_type in [1, 2, 3, 6, 0xA, 0xB, 0xC, 0x1F] {
        let mut cell = Cell::new(Transport::Udp, PeerScript::default());
        cell.run(50);
        alarm(&mut cell, alarm_type, 0, 0xFFFF);
        assert!(cell.run(100).iter().all(|event| *event == LinkEvent::Health), "{alarm_type}");
        assert_eq!((cell.peer.written.len(), &cell.peer.plug_ends[..]), (1, &[][..]), "{alarm_type}");
    }
}

#[test]
fn a_device_that_refuses_or_ignores_the_parameters_of_a_plugged_submodule_keeps_its_ar() {
    let conflict = Violation::StateConflict.status(Service::Control);
    let mut cell =
        Cell::new(Transport::Udp, PeerScript { refuses_plug: Some(conflict), ..PeerScript::default() });
    cell.run(50);
    alarm(&mut cell, 4, 1, 0xFFFF);
    assert_eq!(cell.run(10_000), []);
    assert_eq!(cell.peer.plug_ends, [1]);

    cell.peer.plug_ends.clear();
    cell.peer.script.deaf_to_rpc = true;
    alarm(&mut cell, 4, 2, 0);
    assert_eq!(cell.run(10_000), []);
    assert_eq!(cell.peer.plug_ends, []);
    cell.peer.script = PeerScript::default();
    alarm(&mut cell, 4, 3, 1);
    assert_eq!(cell.peer.plug_ends, [3], "the next one is served again");
}

/// Delivers plug alarms of these submodules, numbered from 1, to a controller that gets no answer to its calls meanwhile.
fn plug_at_the_same_time(cell: &mut Cell, places: &[(u16, u16)]) {
    cell.peer.script.deaf_to_rpc = true;
    let mut sequence = 0xFFFE_u16;
    for (place, number) in places.iter().zip(1..) {
        sequence = sequence.wrapping_add(1);
        alarm_of(cell, *place, 4, number, sequence);
    }
    cell.peer.script.deaf_to_rpc = false;
    assert_eq!(cell.run(1_000), []);
}

#[test]
fn all_submodules_that_are_plugged_at_the_same_time_get_their_parameters_one_after_the_other() {
    let with_data = samples::DEVICE.modules[1].submodules[0];
    let without = |subslot| Submodule { subslot, input_len: 0, output_len: 0, ..with_data };
    let submodules: Vec<_> = core::iter::once(with_data).chain((2..=34).map(without)).collect();
    let module = Module { submodules: submodules.leak(), ..samples::DEVICE.modules[1] };
    let modules = vec![samples::DEVICE.modules[0], module].leak();
    let description = Description { modules, ..samples::DEVICE };
    let parameter = |subslot| Parameter { slot: 1, subslot, index: 1, data: vec![subslot as u8] };
    let parameters = (1..=34).map(parameter).collect();
    let config = ArConfig { description, parameters, ..ar(Transport::Udp) };
    let mut cell = Cell::with(config, PeerScript::default());
    cell.run(50);
    cell.peer.written.clear();
    plug_at_the_same_time(&mut cell, &(1..=34).map(|subslot| (1, subslot)).collect::<Vec<_>>());
    assert_eq!(cell.peer.plug_ends, (1..=34).collect::<Vec<_>>());
    assert_eq!(cell.peer.written, (1..=34).map(|subslot| vec![subslot]).collect::<Vec<_>>());
}

#[test]
fn a_submodule_that_is_plugged_again_before_its_turn_gets_its_parameters_once() {
    let mut cell = Cell::new(Transport::Udp, PeerScript::default());
    cell.run(50);
    // The first alarm is served while the others come.
    plug_at_the_same_time(&mut cell, &[(1, 1); 34]);
    assert_eq!(cell.peer.plug_ends, [1, 34]);
}

#[test]
fn a_plugged_submodule_that_is_not_of_the_ar_gets_nothing() {
    let mut cell = Cell::new(Transport::Udp, PeerScript::default());
    cell.run(50);
    plug_at_the_same_time(&mut cell, &[(1, 7), (77, 1), (1, 1)]);
    assert_eq!(cell.peer.plug_ends, [3]);
}

#[test]
fn a_submodule_that_was_plugged_before_the_connection_ended_is_not_served_by_the_next_one() {
    let mut cell = Cell::new(Transport::Udp, PeerScript::default());
    cell.run(50);
    cell.peer.script.deaf_to_rpc = true;
    alarm(&mut cell, 4, 1, 0xFFFF);
    alarm(&mut cell, 4, 2, 0);
    cell.peer.script.silent = true;
    cell.run(50);
    cell.peer.script = PeerScript::default();
    assert_eq!(cell.run(500), [LinkEvent::Up]);
    assert_eq!(cell.peer.plug_ends, []);
    alarm(&mut cell, 4, 3, 0xFFFF);
    assert_eq!(cell.peer.plug_ends, [3]);
}

#[test]
fn a_repeated_application_ready_is_answered_again_while_data_go() {
    let mut cell = Cell::new(Transport::Udp, PeerScript::default());
    cell.run(50);
    let again = cell.peer.application_ready();
    cell.deliver(again);
    assert_eq!(cell.peer.answered_ready, 2);
    assert_eq!(cell.run(50), []);
}

#[test]
fn disconnect_releases_the_ar_and_nothing_is_sent_afterwards() {
    let mut cell = Cell::new(Transport::Udp, PeerScript::default());
    cell.run(50);
    let now = cell.now;
    cell.ar().disconnect(now);
    cell.drain();
    assert!(cell.peer.released);
    cell.goes_down(0, &[(DownCause::ClosedHere, 0, "")]);
    let frames = cell.frames;
    assert_eq!(cell.run(10_000), []);
    assert_eq!(cell.frames, frames);
}

#[test]
fn a_device_that_refuses_the_release_or_answers_late_is_left_all_the_same() {
    let mut cell = Cell::new(Transport::Udp, PeerScript::default());
    cell.run(50);
    cell.peer.script.deaf_to_rpc = true;
    let now = cell.now;
    cell.ar().disconnect(now);
    assert_eq!(cell.run(500), []);
    cell.peer.script.deaf_to_rpc = false;
    cell.goes_down(200, &[(DownCause::ClosedHere, 0, "")]);
    assert!(cell.peer.released, "by the repetition after 0.6 s");

    let refusal = Violation::ReleaseSessionKey.status(Service::Release);
    let mut cell =
        Cell::new(Transport::Udp, PeerScript { refuses_release: Some(refusal), ..PeerScript::default() });
    cell.run(50);
    let now = cell.now;
    cell.ar().disconnect(now);
    cell.goes_down(0, &[(DownCause::ClosedHere, 0, "")]);
    let frames = cell.frames;
    assert_eq!((cell.run(10_000), cell.frames), (Vec::new(), frames));
}

#[test]
fn disconnect_ends_within_a_second_without_an_answer() {
    let mut cell = Cell::new(Transport::Udp, PeerScript::default());
    cell.run(50);
    cell.peer.script.silent = true;
    let now = cell.now;
    cell.ar().disconnect(now);
    let frames = cell.frames;
    assert_eq!(cell.run(999), []);
    assert_eq!(cell.frames - frames, 3, "Release at once, after 0.2 s and after 0.6 s");
    cell.goes_down(1, &[(DownCause::ClosedHere, 0, "")]);
    let frames = cell.frames;
    assert_eq!((cell.run(10_000), cell.frames), (Vec::new(), frames), "it only announces itself");
}
