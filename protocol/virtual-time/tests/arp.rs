//! What the hosts of stations do with ARP, and to which of two stations with one IP address a datagram goes.

use std::net::{Ipv4Addr, SocketAddrV4};

use machine::arp::{self, AddressClaim, ArpPacket, ClaimEvent};
use machine::ethernet::Mac;
use machine::{Duration, Instant, InterfaceId, Machine, Port, PortRequest, Source, Transmit};
use virtual_time::{
    Clock, Event, Impairment, Network, Pair, PairConfig, StationConfig, SwitchConfig, SwitchId,
};

/// Delay of the cable of each station: between two a frame takes twice as long.
const CABLE: Duration = Duration::from_nanos(500);

const MACS: [Mac; 3] = [Mac([2, 0, 0, 0, 0, 1]), Mac([2, 0, 0, 0, 0, 2]), Mac([2, 0, 0, 0, 0, 3])];
const FIRST: Ipv4Addr = Ipv4Addr::new(10, 0, 0, 1);
const SECOND: Ipv4Addr = Ipv4Addr::new(10, 0, 0, 2);
const UDP: u16 = 4_900;

fn at(ms: u64) -> Instant {
    Instant::from_millis(ms)
}

#[test]
fn the_host_of_a_pair_answers_for_its_address_and_no_fault_of_the_cable_hides_that() {
    for (address, is_taken) in [(Some(SECOND), true), (Some(FIRST), false), (None, false)] {
        let mut probing = AddressClaim::new(MACS[0]);
        let mut using = AddressClaim::new(MACS[1]);
        // Its first frame shows its host's MAC address.
        using.claim(Instant::ZERO, Ipv4Addr::new(10, 0, 0, 9));
        probing.probe(Instant::ZERO, SECOND);
        let cable =
            Impairment { loss_ppm: 900_000, delay: Duration::from_micros(30), ..Impairment::default() };
        let (links, clocks) = ([cable; 2], [Clock::default(); 2]);
        let config = PairConfig { seed: 1, clocks, links, addresses: [None, address] };
        let mut pair = Pair::new(probing, using, config);
        let event = pair.next_event(at(100)).unwrap();
        let taken = matches!(event, Event::A(ClaimEvent::Taken(conflict)) if conflict.mac == MACS[1]);
        assert_eq!((taken, event == Event::A(ClaimEvent::Free(SECOND))), (is_taken, !is_taken), "{event:?}");
    }
}

/// Sends a datagram to [`SECOND`] at each command, and counts what it receives.
#[derive(Default)]
struct Talker {
    send: Option<Vec<u8>>,
    wanted: Option<Mac>,
    datagrams: usize,
    wrong: Vec<Mac>,
}

impl Machine for Talker {
    type Event = ();

    fn ports(&self) -> &[PortRequest] {
        const PORTS: &[PortRequest] = &[arp::ETHERNET, PortRequest::Udp(UDP)];
        PORTS
    }

    fn handle_frame(&mut self, _now: Instant, from: Source, _frame: &[u8]) {
        self.datagrams += usize::from(from.port == Port::Udp(UDP));
    }

    fn neighbour(&self, _address: Ipv4Addr) -> Option<Mac> {
        self.wanted
    }

    fn handle_wrong_neighbour(&mut self, _now: Instant, _address: Ipv4Addr, found: Mac) {
        self.wrong.push(found);
    }

    fn handle_timeout(&mut self, _now: Instant) {}

    fn poll_transmit(&mut self, _now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        let frame = self.send.take()?;
        buf[..frame.len()].copy_from_slice(&frame);
        let is_arp = frame.len() > 1;
        let (port, to) = if is_arp {
            (Port::Ethernet, None)
        } else {
            (Port::Udp(UDP), Some(SocketAddrV4::new(SECOND, UDP)))
        };
        Some(Transmit { port, to, len: frame.len() })
    }

    fn poll_event(&mut self) -> Option<()> {
        None
    }

    fn poll_timeout(&self) -> Option<Instant> {
        None
    }
}

#[test]
fn of_two_stations_with_one_address_the_one_in_the_table_of_neighbours_gets_the_datagram() {
    let mut network = Network::with_switch(1, SwitchConfig::IDEAL);
    let addresses = [FIRST, SECOND, SECOND];
    let stations = [0, 1, 2].map(|index: usize| {
        network.add_station(
            SwitchId::FIRST,
            "talker",
            Talker::default(),
            StationConfig::new(MACS[index], Some(addresses[index]), CABLE),
        )
    });
    let mut now = 0;
    let mut sent = |network: &mut Network<Talker>, by: usize, frame: &[u8], wanted| {
        network.command(stations[by], |talker, _| {
            (talker.send, talker.wanted) = (Some(frame.to_vec()), wanted);
        });
        now += 1;
        assert_eq!(network.next_event(at(now)), None);
        [1, 2].map(|index| network.machine(stations[index]).unwrap().datagrams)
    };
    let mut announcement = [0; 60];
    ArpPacket::announcement(MACS[2], SECOND).emit_frame(&mut announcement).unwrap();
    assert_eq!(sent(&mut network, 0, b"x", None), [1, 0]);
    sent(&mut network, 2, &announcement, None);
    assert_eq!(sent(&mut network, 0, b"x", None), [1, 1], "an announcement changes the table");
    assert_eq!(sent(&mut network, 0, b"x", Some(MACS[1])), [2, 1], "the driver corrects it");
    network.set_may_correct(stations[0], InterfaceId::FIRST, false);
    assert_eq!(sent(&mut network, 0, b"x", Some(MACS[2])), [2, 1], "or sends nothing");
    assert_eq!(network.machine(stations[0]).unwrap().wrong, [MACS[1]]);
}
