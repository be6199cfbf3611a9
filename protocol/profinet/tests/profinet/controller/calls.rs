//! Calls to the controller in fragments, from several stations at the same time.

use profinet::Uuid;
use profinet::rpc::{ENDPOINT_MAPPER_INTERFACE, LOOKUP_HANDLE_FREE, Operation, flags};

use super::*;

/// Delivers a third of a call to the endpoint mapper from one of several stations, and returns what it gets at once.
fn third(cell: &mut Cell, station: u8, fragment: u16, more_flags: u8) -> Option<(Kind, u16)> {
    let operation = Operation::Unknown(LOOKUP_HANDLE_FREE);
    let call = Header::request(operation, Uuid::NIL, ENDPOINT_MAPPER_INTERFACE, Uuid([station; 16]), 0);
    let last = if fragment == 2 { flags::LAST_FRAGMENT } else { 0 };
    let header = Header { flags: flags::FRAGMENT | last | more_flags, fragment, ..call };
    let mut buf = [0; FRAME_CAPACITY];
    let len = header.emit(&[0; 8], &mut buf).unwrap();
    let from = SocketAddrV4::new(Ipv4Addr::new(192, 168, 64, 100 + station), 50_000);
    cell.controller.handle_frame(
        cell.now,
        Source { port: Port::Udp(RPC_PORT), peer: Some(from) },
        &buf[..len],
    );
    let transmit = cell.poll(&mut buf)?;
    assert_eq!(transmit.to, Some(from));
    let (answer, _) = Header::parse(&buf[..transmit.len]).unwrap();
    assert!(answer.is_same_call(&header));
    Some((answer.kind, answer.fragment))
}

fn idle() -> Cell {
    let mut cell = Cell::new(Transport::Rt1, PeerScript { silent: true, ..PeerScript::default() });
    cell.run(10);
    cell
}

const ANSWER: Option<(Kind, u16)> = Some((Kind::Response, 0));

#[test]
fn a_fragment_is_acknowledged_by_its_number_unless_its_sender_wants_no_acknowledgement() {
    let mut cell = idle();
    assert_eq!(third(&mut cell, 1, 0, 0), Some((Kind::FragmentAck, 0)));
    assert_eq!(third(&mut cell, 1, 1, 0), Some((Kind::FragmentAck, 1)));
    assert_eq!(third(&mut cell, 1, 2, 0), ANSWER);
    let silent = [0, 1, 2].map(|fragment| third(&mut cell, 2, fragment, flags::NO_FRAGMENT_ACK));
    assert_eq!(silent, [None, None, ANSWER]);
}

#[test]
fn calls_of_four_stations_may_mix_and_a_fifth_takes_the_place_of_the_one_that_is_silent_longest() {
    let mut cell = idle();
    let mut third = |station, fragment| third(&mut cell, station, fragment, flags::NO_FRAGMENT_ACK);
    for fragment in 0..3 {
        for station in 0..4 {
            let expected = if fragment == 2 { ANSWER } else { None };
            assert_eq!(third(station, fragment), expected, "station {station}, fragment {fragment}");
        }
    }
    for (station, fragment) in [(0, 0), (1, 0), (2, 0), (3, 0), (1, 1), (2, 1), (3, 1), (4, 0), (4, 1)] {
        assert_eq!(third(station, fragment), None);
    }
    for station in 1..=4 {
        assert_eq!(third(station, 2), ANSWER, "station {station}");
    }
    let rest = [1, 2].map(|fragment| third(0, fragment));
    assert_eq!((rest, cell.controller.counters().malformed), ([None, None], 2));
}
