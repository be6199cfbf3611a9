//! The way of a frame along a line of EtherCAT devices, each a node of its own.

#![expect(clippy::unwrap_used, reason = "a test fails by a panic")]

use machine::{Instant, InterfaceId, Machine, Port, PortRequest, Source, Transmit};
use virtual_time::{CableId, Clock, Impairment, Network, NodeId, Plug};

const ETHER_TYPE: u16 = 0x88A4;

/// Sends a frame if it has one. A device adds its number to each frame and sends it back.
struct LineStation {
    number: Option<u8>,
    frame: Option<Vec<u8>>,
    received: Vec<Vec<u8>>,
}

impl Machine for LineStation {
    type Event = ();

    fn ports(&self) -> &[PortRequest] {
        &[PortRequest::AnyEthernet { ether_type: ETHER_TYPE }]
    }

    fn handle_frame(&mut self, _now: Instant, _from: Source, frame: &[u8]) {
        self.received.push(frame.to_vec());
        if let Some(number) = self.number {
            self.frame = Some([frame, &[number]].concat());
        }
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

/// A MainDevice and devices 1, 2 and 3 in line, each with its cable.
fn line() -> (Network<LineStation>, Vec<NodeId>, Vec<CableId>) {
    let mut network = Network::new(1);
    let line = network.add_line();
    let mut nodes = Vec::new();
    let mut cables = Vec::new();
    for number in [None, Some(1), Some(2), Some(3)] {
        let station = LineStation { number, frame: None, received: Vec::new() };
        let node = network.add_node("station", station, Clock::default());
        let nic = network.add_nic(node, &[InterfaceId::FIRST], None, None);
        let plugs = [Plug::Switch(line), Plug::Nic(nic)];
        cables.push(network.connect(plugs, [Impairment::default(); 2]).unwrap());
        nodes.push(node);
    }
    (network, nodes, cables)
}

/// Sends a frame of the MainDevice and returns which devices it passed, if it came back.
fn passed(network: &mut Network<LineStation>, nodes: &[NodeId]) -> Option<Vec<u8>> {
    let frame = [&[0xFF; 6][..], &[2, 0, 0, 0, 0, 1], &ETHER_TYPE.to_be_bytes(), &[0; 46]].concat();
    let (len, main) = (frame.len(), nodes[0]);
    network.command(main, |station, _| station.frame = Some(frame));
    assert_eq!(network.next_event(network.now() + machine::Duration::from_millis(1)), None);
    let back = network.command(main, |station, _| station.received.pop()).unwrap();
    back.map(|frame| frame[len..].to_vec())
}

#[test]
fn a_frame_passes_the_devices_in_order_and_comes_back() {
    let (mut network, nodes, _) = line();
    assert_eq!(passed(&mut network, &nodes), Some(vec![1, 2, 3]));
}

#[test]
fn no_device_is_reached_behind_a_cut_until_it_is_mended() {
    let (mut network, nodes, cables) = line();
    network.set_cut(cables[2], true);
    assert_eq!(passed(&mut network, &nodes), Some(vec![1]));
    network.set_cut(cables[2], false);
    assert_eq!(passed(&mut network, &nodes), Some(vec![1, 2, 3]));
    network.set_cut(cables[0], true);
    assert_eq!(passed(&mut network, &nodes), None);
}

#[test]
fn no_device_is_reached_behind_one_without_power() {
    let (mut network, nodes, _) = line();
    network.kill(nodes[3]);
    assert_eq!(passed(&mut network, &nodes), Some(vec![1, 2]));
}
