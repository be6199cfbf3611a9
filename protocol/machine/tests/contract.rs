//! What a machine asks its driver for, and what it is told, where it says nothing about it itself.

use core::net::Ipv4Addr;

use machine::ethernet::Mac;
use machine::{Instant, Machine, Port, PortRequest, Source, StreamRequest, Transmit};

const FROM: Source = Source { port: Port::Udp(7), peer: None };

/// A machine that implements nothing but what it must.
#[derive(Default)]
struct Least {
    frames: Vec<Vec<u8>>,
}

impl Machine for Least {
    type Event = ();

    fn handle_frame(&mut self, _now: Instant, _from: Source, frame: &[u8]) {
        self.frames.push(frame.to_vec());
    }
    fn ports(&self) -> &[PortRequest] {
        &[PortRequest::Udp(7)]
    }
    fn handle_timeout(&mut self, _now: Instant) {}
    fn poll_transmit(&mut self, _now: Instant, _buf: &mut [u8]) -> Option<Transmit> {
        None
    }
    fn poll_event(&mut self) -> Option<()> {
        None
    }
    fn poll_timeout(&self) -> Option<Instant> {
        None
    }
}

#[test]
fn a_broadcast_is_a_frame_to_a_machine_that_makes_no_difference() {
    let mut least = Least::default();
    least.handle_broadcast(Instant::ZERO, FROM, &[1, 2, 3]);
    assert_eq!(least.frames, [[1, 2, 3]]);
}

#[test]
fn a_machine_asks_by_default_for_no_connection_no_priority_and_no_group() {
    let mut least = Least::default();
    assert_eq!(
        (least.listen_port(), least.dscp(Port::Udp(7)), least.group(Port::Udp(7), 0)),
        (None, 0, None)
    );
    assert_eq!(least.poll_stream(), None::<StreamRequest>);
    assert_eq!(None::<Ipv4Addr>, least.group(Port::Ethernet, 1));
}

#[test]
fn an_address_is_one_of_a_group_if_the_lowest_bit_of_its_first_byte_is_set() {
    // IEEE 802, clause 8.2.2: the I/G bit. Multicast of PROFINET DCP, broadcast, IPv4 multicast.
    for group in [[0x01, 0x0E, 0xCF, 0, 0, 0], [0xFF; 6], [0x01, 0, 0x5E, 0, 0, 1]] {
        assert!(Mac(group).is_group(), "{}", Mac(group));
    }
    // A manufacturer's address, a locally administered one, and one with all bits but I/G.
    for station in [
        [0xEC, 0x1C, 0x5D, 0x61, 0xE7, 0x3F],
        [2, 0, 0, 0, 0, 1],
        [0xFE, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF],
        [0; 6],
    ] {
        assert!(!Mac(station).is_group(), "{}", Mac(station));
    }
}
