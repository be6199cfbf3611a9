//! Which stations of a switch a frame of raw Ethernet reaches.

#![expect(clippy::unwrap_used, reason = "a test fails by a panic")]

use machine::ethernet::Mac;
use machine::{Duration, Instant, Machine, Port, PortRequest, Source, Transmit};
use virtual_time::{Network, StationConfig, SwitchConfig, SwitchId};

/// Delay of the cable of each station: between two a frame takes twice as long.
const CABLE: Duration = Duration::from_nanos(500);

const ETHER_TYPE: u16 = 0x88A4;
const SENDER: Mac = Mac([2, 0, 0, 0, 0, 1]);

/// Sends a frame if it has one, and counts what it receives.
struct Station {
    ports: &'static [PortRequest],
    frame: Option<Vec<u8>>,
    received: usize,
}

impl Machine for Station {
    type Event = ();

    fn ports(&self) -> &[PortRequest] {
        self.ports
    }

    fn handle_frame(&mut self, _now: Instant, _from: Source, _frame: &[u8]) {
        self.received += 1;
    }

    fn handle_timeout(&mut self, _now: Instant) {}

    fn poll_transmit(&mut self, _now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        let frame = self.frame.take()?;
        buf[..frame.len()].copy_from_slice(&frame);
        Some(Transmit { port: Port::Ethernet, to: None, len: frame.len() })
    }

    fn poll_event(&mut self) -> Option<()> {
        None
    }

    fn poll_timeout(&self) -> Option<Instant> {
        None
    }
}

/// Returns which of three stations receive a frame: one for its own address, one for any address, and one for any address
/// and frames of another EtherType.
fn receivers(destination: [u8; 6]) -> [usize; 3] {
    const PORTS: [&[PortRequest]; 3] = [
        &[PortRequest::Ethernet { ether_type: ETHER_TYPE, groups: &[] }],
        &[PortRequest::AnyEthernet { ether_type: ETHER_TYPE }],
        &[PortRequest::AnyEthernet { ether_type: 0x88B5 }],
    ];
    let mut network = Network::with_switch(1, SwitchConfig::IDEAL);
    let stations = [0, 1, 2].map(|index: u8| {
        let station = Station { ports: PORTS[usize::from(index)], frame: None, received: 0 };
        network.add_station(
            SwitchId::FIRST,
            "station",
            station,
            StationConfig::new(Mac([2, 0, 0, 0, 0, 2 + index]), None, CABLE),
        )
    });
    let sender = network.add_station(
        SwitchId::FIRST,
        "station",
        Station { ports: &[], frame: None, received: 0 },
        StationConfig::new(SENDER, None, CABLE),
    );
    let frame = [&destination[..], &SENDER.0, &ETHER_TYPE.to_be_bytes(), &[0; 46]].concat();
    network.command(sender, |station, _| station.frame = Some(frame));
    assert_eq!(network.next_event(Instant::from_millis(1)), None);
    stations.map(|station| network.machine(station).unwrap().received)
}

#[test]
fn a_frame_to_another_station_reaches_who_asks_for_any_address_of_its_ethertype() {
    assert_eq!(receivers([2, 0, 0, 0, 0, 2]), [1, 1, 0]);
    assert_eq!(receivers([2, 0, 0, 0, 0, 0x77]), [0, 1, 0]);
}
