//! What others send to the controller.

use machine::ethernet::EthernetHeader;
use profinet::RPC_PORT;
use profinet::dcp::{self, Pdu};
use profinet::rt::UDP_PORT;
use proptest::prelude::*;

use super::peer::{ETHERNET, ethernet, udp};
use super::*;
#[test]
fn an_engineering_system_finds_the_controller_but_cannot_rename_it() {
    let script = PeerScript { silent: true, ..PeerScript::default() };
    let mut cell = Cell::new(Transport::Udp, script);
    let mut ask = |service, blocks: &[dcp::Block<'_>]| {
        let frame = ethernet(|w| dcp::emit(w, service, 77, 1, blocks.iter().copied()));
        let mut answers = Vec::new();
        cell.controller.handle_frame(cell.now, frame.0, &frame.1);
        let mut buf = [0; FRAME_CAPACITY];
        while let Some(transmit) = cell.poll(&mut buf) {
            let (header, payload) = EthernetHeader::parse(&buf[..transmit.len]).unwrap();
            let pdu = Pdu::parse(payload).unwrap();
            if header.destination == DEVICE && pdu.xid == 77 {
                answers.push(payload.to_vec());
            }
        }
        assert_eq!(answers.len(), 1);
        answers.remove(0)
    };
    let found = ask(dcp::Service::IdentifyRequest, &[dcp::Content::All.into()]);
    let pdu = Pdu::parse(&found).unwrap();
    let station = dcp::Station::from_pdu(&pdu).unwrap();
    assert_eq!((station.name, station.roles), (&b"controller"[..], 2));
    assert_eq!(station.ip.unwrap().address, CONTROLLER_ADDRESS);

    let refused = ask(dcp::Service::SetRequest, &[dcp::Content::NameOfStation(b"other").into()]);
    let blocks: Vec<_> = Pdu::parse(&refused).unwrap().blocks().collect();
    let response =
        dcp::Content::Response { code: dcp::Code::NAME_OF_STATION, error: dcp::BlockError::NotPossible };
    assert_eq!(blocks, [Ok(response.into())]);
}

#[test]
fn a_configuration_that_cannot_work_is_refused_with_what_to_change() {
    let refused = |change: fn(&mut ArConfig)| {
        let mut config = ar(Transport::Rt1);
        change(&mut config);
        controller().connect(config, Instant::ZERO).unwrap_err().to_string()
    };
    assert!(refused(|config| config.cycle = Duration::from_micros(700)).contains("no cycle of 700 µs"));
    let short = refused(|config| config.cycle = Duration::from_micros(500));
    assert!(short.contains("500 µs is shorter than the 1000 µs that the device serves"), "{short}");
    assert!(refused(|config| config.watchdog_cycles = 0).contains("choose 1 to 1920 cycles"));
    assert!(refused(|config| config.watchdog_cycles = 2_000).contains("at most 1920 ms"));
    let long = refused(|config| (config.transport, config.watchdog_cycles) = (Transport::Udp, 10_000));
    assert!(long.contains("10000 cycles is 10000 ms; choose 1 to 7680 cycles"), "{long}");
    assert!(refused(|config| config.address = Ipv4Addr::new(10, 0, 0, 1)).contains("not in one subnet"));
    assert!(refused(|config| config.station_name.clear()).contains("station name"));
    assert!(refused(|config| config.parameters[0].data = vec![0; 70_000]).contains("shorten it"));
}

/// Generates bytes that resemble frames often enough to pass the first checks.
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
        let mut script = PeerScript::default();
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
        cell.peer.script = PeerScript::default();
        let ready = cell.peer.connect.is_some().then(|| cell.peer.application_ready());
        if let Some(ready) = ready.filter(|_| phase == 2) {
            cell.deliver(ready);
        }
        cell.run(23_000);
        prop_assert!(cell.input().is_some());
    }

    /// A device's answer with one byte changed leads to a connection, or to none, but never to a panic or a stall.
    #[test]
    fn a_damaged_answer_does_no_harm(nth in 0_usize..7, at in any::<proptest::sample::Index>(), value in any::<u8>()) {
        let mut cell = Cell::new(Transport::Udp, PeerScript::default());
        let mut buf = [0; FRAME_CAPACITY];
        let mut seen = 0;
        while seen <= nth {
            let at_time = cell.controller.poll_timeout().unwrap();
            cell.now = at_time;
            cell.controller.handle_timeout(at_time);
            while let Some(transmit) = cell.poll(&mut buf) {
                for (source, mut frame) in cell.peer.receive(cell.now, &transmit, &buf[..transmit.len]) {
                    if seen == nth {
                        let index = at.index(frame.len());
                        frame[index] = value;
                    }
                    seen += 1;
                    cell.controller.handle_frame(cell.now, source, &frame);
                }
            }
        }
        cell.run(1_000);
        if cell.peer.answered_ready == 0 && cell.peer.connect.is_some() {
            // A device repeats the call until it is answered.
            let again = cell.peer.application_ready();
            cell.deliver(again);
        }
        cell.run(40_000);
        prop_assert!(cell.input().is_some());
    }
}
