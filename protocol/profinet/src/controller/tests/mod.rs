//! The controller against a scripted peer: one that does what a device does, or leaves out what the script says.

mod peer;

use super::*;
use crate::alarm::{Alarm, AlarmHead, Notification, PduType, Priority, Rta};
use crate::connect::{ConnectRequest, ModuleState};
use crate::description;
use crate::status::{Service, Violation};
use core::net::Ipv4Addr;
use machine::ethernet::Mac;
use machine::wire::{BigEndian, FRAME_CAPACITY, Writer};
use peer::{ETHERNET, Peer, Script, ethernet, udp};
use proptest::prelude::*;

const PLC: Mac = Mac([2, 0, 0, 0, 0, 1]);
const ROBOT: Mac = Mac([2, 0, 0, 0, 0, 2]);
const PLC_ADDRESS: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 1);
const ROBOT_ADDRESS: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 2);

fn config(transport: Transport) -> ControllerConfig {
    ControllerConfig {
        mac: PLC,
        station_name: "plc".into(),
        address: PLC_ADDRESS,
        mask: Ipv4Addr::new(255, 255, 255, 0),
        device_station_name: "robot".into(),
        device_address: ROBOT_ADDRESS,
        description: description::ROBOT,
        parameters: vec![Parameter { slot: 1, subslot: 1, index: 1, data: vec![1, 2, 3, 4] }],
        transport,
        cycle: Duration::from_millis(1),
        watchdog_cycles: 20,
        seed: 1,
    }
}

/// Controller and peer on a cable without delay.
struct Cell {
    controller: Controller,
    peer: Peer,
    now: Instant,
    events: Vec<LinkEvent>,
    frames: usize,
}

impl Cell {
    fn new(transport: Transport, script: Script) -> Self {
        let controller = Controller::new(config(transport), Instant::ZERO).unwrap();
        Self { controller, peer: Peer::new(script), now: Instant::ZERO, events: Vec::new(), frames: 0 }
    }

    fn deliver(&mut self, (source, frame): (Source, Vec<u8>)) {
        self.controller.handle_frame(self.now, source, &frame);
        self.drain();
    }

    fn drain(&mut self) {
        let mut buf = [0; FRAME_CAPACITY];
        for round in 0.. {
            assert!(round < 100, "the controller sends without end");
            let Some(transmit) = self.controller.poll_transmit(self.now, &mut buf) else { break };
            self.frames += 1;
            for answer in self.peer.hear(self.now, &transmit, &buf[..transmit.len]) {
                self.controller.handle_frame(self.now, answer.0, &answer.1);
            }
        }
        self.events.extend(core::iter::from_fn(|| self.controller.poll_event()));
    }

    fn run_until(&mut self, until: Instant) {
        self.drain();
        while let Some(at) = self.controller.poll_timeout().filter(|at| *at <= until) {
            assert!(at > self.now || self.now == Instant::ZERO, "{at:?} is not after {:?}", self.now);
            self.now = at;
            self.controller.handle_timeout(at);
            self.drain();
        }
        self.now = until;
    }

    /// Runs for so many ms and returns the events of that time.
    fn run(&mut self, millis: u64) -> Vec<LinkEvent> {
        self.run_until(self.now + Duration::from_millis(millis));
        core::mem::take(&mut self.events)
    }

    fn downs(&mut self, millis: u64) -> Vec<(DownCause, u32, &'static str)> {
        let down = |event| match event {
            LinkEvent::Down(down) => (down.cause, down.code, down.text),
            other => panic!("{other:?}"),
        };
        self.run(millis).into_iter().map(down).collect()
    }
}

#[test]
fn the_connection_is_up_within_a_few_cycles_on_either_transport() {
    for transport in [Transport::Rt1, Transport::Udp] {
        let mut cell = Cell::new(transport, Script::default());
        assert_eq!(cell.run(5), [LinkEvent::Up], "{transport:?}");
        assert_eq!(cell.peer.written, [[1, 2, 3, 4]]);
        assert_eq!(cell.peer.answered_ready, 1);
        assert_eq!(cell.controller.input().map(|image| image[0]), Some(0x42));
        cell.run(100);
        let counters = cell.controller.counters();
        assert!(counters.sent > 100 && counters.received > 100, "{counters:?}");
        assert_eq!((counters.lost, counters.late, counters.malformed, counters.foreign), (0, 0, 0, 0));
    }
}

#[test]
fn outputs_are_bad_until_there_is_an_image() {
    let mut cell = Cell::new(Transport::Udp, Script::default());
    cell.run(10);
    // Three IOCS of slot 0, one of slot 1, 256 bytes and their IOPS.
    let last = cell.peer.outputs.last().unwrap();
    assert_eq!(last[..5], [0x80, 0x80, 0x80, 0x80, 0]);
    assert_eq!(last[260] & 0x80, 0);
    cell.controller.set_output(&[7; IO_DATA_LEN]);
    cell.run(2);
    let last = cell.peer.outputs.last().unwrap();
    assert_eq!((last[4], last[259], last[260], last.len()), (7, 7, 0x80, 261));
}

#[test]
fn inputs_that_the_device_calls_bad_are_not_handed_out() {
    let mut cell = Cell::new(Transport::Rt1, Script { bad_input: true, ..Script::default() });
    assert_eq!(cell.run(10), [LinkEvent::Up]);
    assert_eq!(cell.controller.input(), None);
    cell.peer.script.bad_input = false;
    cell.run(2);
    assert!(cell.controller.input().is_some());
}

#[test]
fn a_silent_device_is_reported_once_after_3_s_and_found_when_it_comes() {
    let mut cell = Cell::new(Transport::Udp, Script { silent: true, ..Script::default() });
    assert_eq!(cell.run(2_999), []);
    assert_eq!(cell.downs(1), [(DownCause::NoAnswer, 0, words::NO_STATION)]);
    assert_eq!(cell.run(20_000), []);
    cell.peer.script.silent = false;
    assert_eq!(cell.run(500), [LinkEvent::Up]);
}

#[test]
fn a_device_that_answers_by_dcp_only_is_reported_with_what_to_check() {
    let mut cell = Cell::new(Transport::Udp, Script { deaf_to_rpc: true, ..Script::default() });
    assert_eq!(cell.downs(3_000), [(DownCause::NoAnswer, 0, words::NO_RPC)]);
    assert_eq!(cell.run(20_000), []);
}

#[test]
fn a_refused_connect_is_reported_once_with_its_status_in_words() {
    let status = Violation::OutOfArResources.status(Service::Connect);
    let script = Script { refuses_connect: Some(status), ..Script::default() };
    let mut cell = Cell::new(Transport::Udp, script);
    let text = "the device has no AR left";
    assert_eq!(cell.downs(10_000), [(DownCause::Refused, 0xDB81_4004, text)]);
    cell.peer.script.refuses_connect = None;
    assert_eq!(cell.run(2_000), [LinkEvent::Up]);
}

#[test]
fn a_wrong_module_is_reported_with_its_slot_and_the_ar_is_aborted() {
    let wrong = DiffModule { slot: 1, ident: 0x99, state: ModuleState::WrongModule, submodules: Vec::new() };
    let mut cell = Cell::new(Transport::Udp, Script { diff: vec![wrong.clone()], ..Script::default() });
    assert_eq!(cell.downs(50), [(DownCause::Refused, 0x0001_0000, words::WRONG_MODULE)]);
    assert_eq!(cell.controller.module_diff(), [wrong]);
    assert_eq!(cell.peer.partings, [Violation::ArRemoved.status(Service::Abort)]);
}

#[test]
fn a_frame_id_that_is_not_one_of_cyclic_data_is_refused_and_nothing_is_sent_with_it() {
    for frame_id in [0, 0x7FFF, 0xBC00, 0xFBFF, FRAME_ID_HIGH, FRAME_ID_LOW, 0xFEFD] {
        let script = Script { output_frame_id: Some(frame_id), ..Script::default() };
        let mut cell = Cell::new(Transport::Udp, script);
        assert_eq!(cell.downs(50), [(DownCause::Refused, frame_id.into(), words::WRONG_FRAME_ID)]);
        assert_eq!((cell.controller.counters().sent, cell.peer.outputs.len()), (0, 0));
    }
}

#[test]
fn a_device_that_says_it_is_a_group_of_stations_gets_no_data() {
    let script = Script { responder_mac: Some(Mac([0xFF; 6])), ..Script::default() };
    let mut cell = Cell::new(Transport::Rt1, script);
    assert_eq!(cell.downs(50), [(DownCause::Refused, 0, words::UNFIT_ANSWER)]);
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
    assert_eq!(cell.downs(50), [(DownCause::Refused, status.0, "the record has another length")]);
}

#[test]
fn application_ready_may_overtake_the_answer_to_prm_end() {
    let mut cell = Cell::new(Transport::Udp, Script { ready_before_prm_end: true, ..Script::default() });
    assert_eq!(cell.run(5), [LinkEvent::Up]);
}

#[test]
fn a_device_that_never_gets_ready_is_given_up_after_20_s() {
    let mut cell = Cell::new(Transport::Udp, Script { never_ready: true, ..Script::default() });
    assert_eq!(cell.downs(3_000), [(DownCause::NoAnswer, 0, words::NOT_READY)]);
    assert_eq!(cell.peer.partings, []);
    assert_eq!(cell.downs(17_100), []);
    assert_eq!(cell.peer.partings, [Violation::ApplicationReadyTimeout.status(Service::Abort)]);
}

#[test]
fn a_device_that_connects_but_sends_no_data_is_told_apart() {
    let mut cell = Cell::new(Transport::Udp, Script { no_cyclic: true, ..Script::default() });
    assert_eq!(cell.downs(50), [(DownCause::Watchdog, 0xCF81_FD05, words::NO_CYCLIC)]);
}

#[test]
fn the_watchdog_ends_the_ar_tells_the_device_and_the_controller_reconnects() {
    let mut cell = Cell::new(Transport::Rt1, Script::default());
    assert_eq!(cell.run(50), [LinkEvent::Up]);
    let first = cell.peer.connect.clone().unwrap();
    cell.peer.script.no_cyclic = true;
    assert_eq!(cell.downs(30), [(DownCause::Watchdog, 0xCF81_FD05, words::WATCHDOG)]);
    assert_eq!(cell.controller.input(), None);
    assert_eq!(cell.peer.partings, [Status(0xCF81_FD05)]);
    cell.peer.script.no_cyclic = false;
    assert_eq!(cell.run(200), [LinkEvent::Up]);
    let second = cell.peer.connect.as_ref().unwrap();
    assert_eq!((first.ar.session, second.ar.session), (1, 2), "another connection ...");
    assert_eq!(first.ar.uuid, second.ar.uuid, "... of the same AR ...");
    let endpoint = |request: &ConnectRequest| request.alarm_cr.map(|alarm_cr| alarm_cr.local_reference);
    assert_eq!(endpoint(&first), endpoint(second), "... which keeps its alarm endpoint");
}

#[test]
fn an_error_pdu_of_the_device_ends_the_ar_and_is_told_in_words() {
    for transport in [Transport::Rt1, Transport::Udp] {
        let mut cell = Cell::new(transport, Script::default());
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
        assert_eq!(cell.downs(0), [(DownCause::ClosedByPeer, status.0, status.text())]);
        assert_eq!(cell.run(200), [LinkEvent::Up]);
    }
}

#[test]
fn an_alarm_is_acknowledged_and_data_go_on() {
    let mut cell = Cell::new(Transport::Udp, Script::default());
    cell.run(50);
    let rta = Rta {
        destination: 0,
        source: 9,
        pdu_type: PduType::Data,
        flags: Rta::WINDOW_1_TACK,
        send_sequence: 0xFFFF,
        ack_sequence: 0xFFFE,
    };
    let notification = Alarm::Notification(Notification {
        priority: Priority::Low,
        head: AlarmHead { alarm_type: 1, api: 0, slot: 1, subslot: 1 },
        module_ident: 0x100,
        submodule_ident: 0x101,
        specifier: 0,
        items: &[],
    });
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
    assert_eq!(cell.run(1_000), []);
}

#[test]
fn a_repeated_application_ready_is_answered_again_while_data_go() {
    let mut cell = Cell::new(Transport::Udp, Script::default());
    cell.run(50);
    let again = cell.peer.application_ready();
    cell.deliver(again);
    assert_eq!(cell.peer.answered_ready, 2);
    assert_eq!(cell.run(50), []);
}

#[test]
fn disconnect_releases_the_ar_and_nothing_is_sent_afterwards() {
    let mut cell = Cell::new(Transport::Udp, Script::default());
    cell.run(50);
    cell.controller.disconnect(cell.now);
    cell.drain();
    assert!(cell.peer.released);
    assert_eq!(cell.downs(0), [(DownCause::ClosedHere, 0, "")]);
    let frames = cell.frames;
    assert_eq!(cell.run(10_000), []);
    assert_eq!((cell.frames, cell.controller.poll_timeout()), (frames, None));
}

#[test]
fn disconnect_ends_within_a_second_without_an_answer() {
    let mut cell = Cell::new(Transport::Udp, Script::default());
    cell.run(50);
    cell.peer.script.silent = true;
    cell.controller.disconnect(cell.now);
    assert_eq!(cell.downs(1_000), [(DownCause::ClosedHere, 0, "")]);
    assert_eq!(cell.controller.poll_timeout(), None);
}

#[test]
fn an_engineering_system_finds_the_controller_but_cannot_rename_it() {
    let script = Script { silent: true, ..Script::default() };
    let mut cell = Cell::new(Transport::Udp, script);
    let mut ask = |service, blocks: &[dcp::Block<'_>]| {
        let frame = ethernet(|w| dcp::emit(w, service, 77, 1, blocks.iter().copied()));
        let mut answers = Vec::new();
        cell.controller.handle_frame(cell.now, frame.0, &frame.1);
        let mut buf = [0; FRAME_CAPACITY];
        while let Some(transmit) = cell.controller.poll_transmit(cell.now, &mut buf) {
            let (header, payload) = EthernetHeader::parse(&buf[..transmit.len]).unwrap();
            let pdu = Pdu::parse(payload).unwrap();
            if header.destination == ROBOT && pdu.xid == 77 {
                answers.push(payload.to_vec());
            }
        }
        assert_eq!(answers.len(), 1);
        answers.remove(0)
    };
    let found = ask(dcp::Service::IdentifyRequest, &[dcp::Content::All.into()]);
    let pdu = Pdu::parse(&found).unwrap();
    let station = dcp::Station::from_pdu(&pdu).unwrap();
    assert_eq!((station.name, station.roles), (&b"plc"[..], 2));
    assert_eq!(station.ip.unwrap().address, PLC_ADDRESS);

    let refused = ask(dcp::Service::SetRequest, &[dcp::Content::NameOfStation(b"other").into()]);
    let blocks: Vec<_> = Pdu::parse(&refused).unwrap().blocks().collect();
    let response =
        dcp::Content::Response { code: dcp::Code::NAME_OF_STATION, error: dcp::BlockError::NotPossible };
    assert_eq!(blocks, [Ok(response.into())]);
}

#[test]
fn a_configuration_that_cannot_work_is_refused_with_what_to_change() {
    let refused = |change: fn(&mut ControllerConfig)| {
        let mut config = config(Transport::Rt1);
        change(&mut config);
        Controller::new(config, Instant::ZERO).map(|_| ()).unwrap_err().to_string()
    };
    assert!(refused(|config| config.cycle = Duration::from_micros(700)).contains("a cycle of 700 µs"));
    assert!(refused(|config| config.watchdog_cycles = 0).contains("choose 1 cycle or more"));
    assert!(refused(|config| config.watchdog_cycles = 2_000).contains("at most 1920 ms"));
    assert!(refused(|config| config.address = Ipv4Addr::new(10, 0, 0, 1)).contains("not in one subnet"));
    assert!(refused(|config| config.device_station_name.clear()).contains("station name"));
    assert!(refused(|config| config.parameters[0].data = vec![0; 5_000]).contains("shorten it"));
}

/// Bytes that are like frames often enough to get past the first checks.
fn frames() -> impl Strategy<Value = (u8, Vec<u8>)> {
    (any::<u8>(), proptest::collection::vec(any::<u8>(), 0..300))
}

fn framed(kind: u8, bytes: &[u8], transport: Transport) -> (Source, Vec<u8>) {
    let with_head = |head: &[u8]| [head, bytes].concat();
    match (kind % 8, transport) {
        (0, _) => (ETHERNET, bytes.to_vec()),
        (1, _) => ethernet(|w| w.bytes(&with_head(&[0xFE, 0xFF, 5, 1]))),
        (2, _) => (udp(RPC_PORT, 1), bytes.to_vec()),
        (3 | 4, _) => {
            let mut pdu = with_head(&[4, kind / 8 % 12, kind, 0, 0x10 * (kind & 1)]);
            pdu.resize(pdu.len().max(100), 0);
            (udp(RPC_PORT, 1), pdu)
        }
        (5, _) => (udp(kind.into(), 1), bytes.to_vec()),
        (6, Transport::Rt1) => ethernet(|w| w.bytes(&with_head(&[0x80, 0x00]))),
        (6, Transport::Udp) => (udp(UDP_PORT, 1), with_head(&[0xC0, 0x00])),
        (_, Transport::Rt1) => ethernet(|w| w.bytes(&with_head(&[0xFE, 0x01, 0, 1, 0, 9]))),
        (_, Transport::Udp) => (udp(UDP_PORT, 1), with_head(&[0xFE, 0x01, 0, 1, 0, 9])),
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn no_bytes_on_any_port_in_any_phase_make_it_panic_or_stall(
        strangers in proptest::collection::vec(frames(), 1..20),
        phase in 0..6_u8,
        over_udp in any::<bool>(),
    ) {
        let transport = if over_udp { Transport::Udp } else { Transport::Rt1 };
        let mut script = Script::default();
        match phase {
            0 => script.silent = true,
            1 => script.deaf_to_rpc = true,
            2 => script.never_ready = true,
            3 => script.no_cyclic = true,
            _ => {}
        }
        let mut cell = Cell::new(transport, script);
        cell.run(10);
        for (kind, bytes) in &strangers {
            let frame = framed(*kind, bytes, transport);
            cell.deliver(frame);
            cell.run(1);
        }
        cell.peer.script = Script::default();
        cell.run(23_000);
        prop_assert!(cell.controller.input().is_some());
    }

    /// A device's answer with one byte changed leads to a connection, or to none, but never to a panic or a stall.
    #[test]
    fn a_damaged_answer_does_no_harm(nth in 0_usize..7, at in any::<proptest::sample::Index>(), value in any::<u8>()) {
        let mut cell = Cell::new(Transport::Udp, Script::default());
        let mut buf = [0; FRAME_CAPACITY];
        let mut seen = 0;
        while seen <= nth {
            let at_time = cell.controller.poll_timeout().unwrap();
            cell.now = at_time;
            cell.controller.handle_timeout(at_time);
            while let Some(transmit) = cell.controller.poll_transmit(cell.now, &mut buf) {
                for (source, mut frame) in cell.peer.hear(cell.now, &transmit, &buf[..transmit.len]) {
                    if seen == nth {
                        let index = at.index(frame.len());
                        frame[index] = value;
                    }
                    seen += 1;
                    cell.controller.handle_frame(cell.now, source, &frame);
                }
            }
        }
        cell.run(40_000);
        prop_assert!(cell.controller.input().is_some());
    }
}
