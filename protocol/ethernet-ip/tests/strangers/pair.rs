//! A scanner and an adapter on a switch, watched: alone, or beside a stranger.

use std::net::Ipv4Addr;

use ethernet_ip::{Adapter, AdapterConfig, ConnectionConfig, ConnectionId, Scanner, ScannerConfig};
use machine::ethernet::Mac;
use machine::{Allowed, Instant, Peer};
use virtual_time::hostile::{Choices, PairRun, PairStation, StationPair};

use super::samples::{CONSUMED, DEVICE, LEN, PRODUCED};

/// MAC and IP addresses of the pair.
pub(crate) const STATIONS: [(Mac, Ipv4Addr); 2] = [
    (Mac([2, 0, 0, 0, 0, 1]), Ipv4Addr::new(192, 168, 64, 1)),
    (Mac([2, 0, 0, 0, 0, 2]), Ipv4Addr::new(192, 168, 64, 2)),
];

/// A scanner and its adapter, by their connection.
pub(crate) struct ScannerAndAdapter(ConnectionId);

impl ScannerAndAdapter {
    /// Creates a pair whose adapter lists its scanner if `listed`.
    pub(crate) fn new<C: Choices>(listed: bool, allocations: fn() -> u64) -> PairRun<Self, C> {
        let [(scanner_mac, plc), (adapter_mac, robot)] = STATIONS;
        let mut scanner =
            Scanner::new(ScannerConfig { vendor: 0xFFFF, serial_number: 1, first_id: 0x5C00_0000 });
        let config = ConnectionConfig::exclusive_owner(robot, &DEVICE, 1_000);
        let connection = scanner.connect(config, Instant::ZERO).unwrap();
        let listed_peer = Peer { address: Some(plc), mac: None, serial_number: Some(1) };
        let adapter = Adapter::new(AdapterConfig {
            description: &DEVICE,
            serial_number: 0x1234_5678,
            address: robot,
            mask: Ipv4Addr::new(255, 255, 255, 0),
            gateway: Ipv4Addr::UNSPECIFIED,
            mac: adapter_mac.0,
            first_id: 0x0100_0000,
            originators: Allowed(if listed { vec![listed_peer] } else { Vec::new() }),
        });
        let scanner = PairStation { machine: scanner, mac: scanner_mac, address: Some(plc) };
        let adapter = PairStation { machine: adapter, mac: adapter_mac, address: Some(robot) };
        PairRun::new(Self(connection), scanner, adapter, allocations)
    }
}

impl StationPair for ScannerAndAdapter {
    type Id = ConnectionId;
    type A = Scanner;
    type B = Adapter;
    const NAMES: [&'static str; 2] = ["scanner", "adapter"];

    fn exchange_a(&self, scanner: &mut Scanner, value: u8) -> Option<u8> {
        let connection = scanner.connection_mut(self.0)?;
        connection.set_output(&[value; LEN]).unwrap();
        connection.input().map(|data| data[0])
    }

    fn exchange_b(&self, adapter: &mut Adapter, value: u8) -> Option<u8> {
        adapter.set_produced(PRODUCED, &[value; LEN]).unwrap();
        adapter.consumed(CONSUMED).map(|data| data[0])
    }

    fn disconnect(&self, scanner: &mut Scanner, now: Instant) {
        if let Some(connection) = scanner.connection_mut(self.0) {
            connection.disconnect(now);
        }
    }
}
