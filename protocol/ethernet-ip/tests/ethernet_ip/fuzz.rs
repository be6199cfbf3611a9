//! Unexpected bytes: well-formed messages with arbitrary changes, and arbitrary bytes.

use std::net::Ipv4Addr;

use ethernet_ip::connection::ConnectionType;
use ethernet_ip::encapsulation::{Command, Header};
use ethernet_ip::{ENCAPSULATION_PORT, IO_PORT};
use machine::{Duration, Machine};
use proptest::prelude::*;

use crate::cell::{PLC, ROBOT};
use crate::client::{
    INPUT_ONLY_PATH, Rig, close_message, connected, explicit, heartbeat, message, open_message, owner,
    parameters, peer, unconnected,
};
use crate::hostile::{VENDOR, rig};

/// Returns the messages that a fuzzer starts from: well-formed ones of every kind.
fn seeds(session: u32) -> Vec<Vec<u8>> {
    let rr = |cip: &[u8]| message(Command::SendRRData, session, &unconnected(cip));
    let mut null = owner(9);
    (null.o_t, null.t_o) = (parameters(ConnectionType::Null, 0), parameters(ConnectionType::Null, 0));
    vec![
        message(Command::RegisterSession, 0, &[1, 0, 0, 0]),
        message(Command::ListIdentity, 0, &[]),
        message(Command::ListServices, 0, &[]),
        message(Command::UnRegisterSession, session, &[]),
        message(Command::Nop, session, &[1, 2, 3]),
        rr(VENDOR),
        rr(&[1, 2, 0x20, 0xF5, 0x24, 1]),
        rr(&[3, 2, 0x20, 1, 0x24, 1, 3, 0, 1, 0, 2, 0, 7, 0]),
        rr(b"\x0A\x02\x20\x02\x24\x01\x02\0\x06\0\x0E\0\x0E\x03\x20\x01\x24\x01\x30\x01\x0E\x03\x20\x01\x24\x01\x30\x02"),
        rr(b"\x52\x02\x20\x06\x24\x01\x0A\xF0\x08\0\x0E\x03\x20\x01\x24\x01\x30\x01\0\0"),
        rr(&open_message(&owner(7), false)),
        rr(&open_message(&heartbeat(8, INPUT_ONLY_PATH), true)),
        rr(&open_message(&explicit(9), false)),
        rr(&open_message(&null, false)),
        rr(&close_message(owner(8).triad, INPUT_ONLY_PATH)),
        message(Command::SendUnitData, session, &connected(0x0100_0002, 1, VENDOR)),
    ]
}

/// Generates a well-formed message with some bytes changed, removed or added; or arbitrary bytes.
fn hostile_bytes() -> impl Strategy<Value = (usize, Vec<(usize, u8)>, usize, Vec<u8>)> {
    (
        0..20_usize,
        prop::collection::vec((0..160_usize, any::<u8>()), 0..4),
        0..200_usize,
        prop::collection::vec(any::<u8>(), 0..300),
    )
}

fn mutate(session: u32, (seed, changes, cut, tail): (usize, Vec<(usize, u8)>, usize, Vec<u8>)) -> Vec<u8> {
    let Some(mut bytes) = seeds(session).into_iter().nth(seed) else { return tail };
    for (at, value) in changes {
        let len = bytes.len();
        bytes[at % len] = value;
    }
    if cut < bytes.len() && cut % 3 == 0 {
        bytes.truncate(cut);
    }
    bytes
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, ..ProptestConfig::default() })]

    #[test]
    fn no_bytes_on_any_port_make_the_adapter_panic_or_stall(
        inputs in prop::collection::vec((0..3_u8, hostile_bytes()), 1..12),
    ) {
        let (mut rig, bad) = rig();
        for (port, bytes) in inputs {
            let bytes = mutate(bad.session, bytes);
            match port {
                0 => rig.datagram(IO_PORT, peer(Ipv4Addr::new(192, 168, 64, 9), 5_000), &bytes),
                1 => rig.datagram(ENCAPSULATION_PORT, peer(ROBOT, 5_000), &bytes),
                _ => rig.send(bad.stream, &bytes),
            }
            rig.advance(Duration::from_micros(300));
            prop_assert!(rig.adapter.poll_timeout().is_some_and(|at| at >= rig.now), "a deadline that is not met");
        }
        // The bad client may open connections of its own; the good one's must not be affected.
        rig.assert_good_scanner_is_served_beside(rig.adapter.connections().0);
    }

    #[test]
    fn after_each_bad_input_the_good_scanners_next_frame_is_on_time(
        inputs in prop::collection::vec((0..4_u8, hostile_bytes()), 1..12),
    ) {
        let (mut rig, bad) = rig();
        let opened = rig.open(bad, &explicit(0x55));
        for (port, bytes) in inputs {
            let bytes = mutate(bad.session, bytes);
            match port {
                0 => rig.datagram(IO_PORT, peer(PLC, IO_PORT), &bytes),
                1 => rig.broadcast(ENCAPSULATION_PORT, peer(ROBOT, 5_000), &bytes),
                2 => rig.send(bad.stream, &bytes),
                // Any other message, over an open class 3 connection.
                _ => {
                    let bytes = &bytes[..bytes.len().min(500)];
                    let data = connected(opened.o_t_id, 1, bytes);
                    rig.send(bad.stream, &message(Command::SendUnitData, bad.session, &data));
                }
            }
            // After each one, not only at the end.
            rig.assert_good_scanner_is_served_beside(rig.adapter.connections().0);
        }
    }

    #[test]
    fn no_bytes_keep_an_adapter_without_connections_from_serving_the_next_client(
        inputs in prop::collection::vec((0..4_u8, hostile_bytes()), 1..12),
    ) {
        let mut rig = Rig::new();
        let (silent, registered) = (rig.connect_from(ROBOT), rig.client_from(ROBOT));
        for (port, bytes) in inputs {
            let bytes = mutate(registered.session, bytes);
            match port {
                0 => rig.datagram(IO_PORT, peer(ROBOT, IO_PORT), &bytes),
                1 => rig.datagram(ENCAPSULATION_PORT, peer(ROBOT, 5_000), &bytes),
                2 => rig.send(silent, &bytes),
                _ => rig.send(registered.stream, &bytes),
            }
            rig.advance(Duration::from_micros(300));
            prop_assert!(rig.adapter.poll_timeout().is_none_or(|at| at >= rig.now), "a deadline that is not met");
        }
        // A mutation may have opened the owner's connection. It closes it, or it lasts until its first timeout: at
        // most 512 packet intervals of 10 s.
        rig.hang_up(registered.stream);
        rig.advance(Duration::from_secs(512 * 10));
        prop_assert_eq!(rig.adapter.connections().0, 0);
        rig.start_good_scanner();
        rig.assert_good_scanner_is_served();
    }

    #[test]
    fn no_cyclic_datagram_from_the_owners_address_makes_the_adapter_panic_or_lose_its_grid(
        frames in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..300), 1..20),
    ) {
        let (mut rig, _) = rig();
        for frame in frames {
            rig.datagram(IO_PORT, peer(PLC, IO_PORT), &frame);
        }
        rig.assert_good_scanner_is_served();
    }
}

#[test]
fn every_reply_to_a_hostile_message_is_itself_well_formed() {
    let mut rig = Rig::new();
    let bad = rig.client();
    for seed in seeds(bad.session) {
        for at in 0..seed.len() {
            for value in [0, 1, 0x7F, 0xFF] {
                let mut bytes = seed.clone();
                bytes[at] = value;
                let client = rig.client();
                bytes[4..8].copy_from_slice(&client.session.to_le_bytes());
                rig.send(client.stream, &bytes);
                while let Some((header, data)) = rig.read(client.stream) {
                    assert_eq!(usize::from(header.length), data.len());
                    assert!(Header::parse(&[0; 24]).is_ok() && header.options == 0);
                }
                rig.hang_up(client.stream);
            }
        }
    }
}
