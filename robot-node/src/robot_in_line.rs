//! A robot between two others in an EtherCAT line: its SubDevice has a cable towards the MainDevice and one to the next SubDevice.

use core::net::Ipv4Addr;

use ethercat_subdevice::SegmentEnd;
use machine::ethernet::Mac;
use machine::{
    Instant, InterfaceId, Machine, Multihomed, Port, PortRequest, Source, StreamChange, StreamId,
    StreamRequest, Transmit,
};
use protocol::buses::EthercatSubDevice;

use crate::{RobotEvent, RobotNode};

/// The interface to the next SubDevice; the first one leads towards the MainDevice.
pub(crate) const ONWARD: InterfaceId = InterfaceId(1);

/// A robot with both ports of its SubDevice. A frame is processed on its way out and passes once more, unchanged, on its way back
/// (ETG.1000.4). Without a link to the next SubDevice the loop closes at that port.
#[derive(Debug)]
pub struct RobotInLine(RobotNode<EthercatSubDevice>);

impl RobotInLine {
    /// Puts a robot into a line. Until [`set_link`](Self::set_link) it is the last one.
    #[must_use]
    pub fn new(mut robot: RobotNode<EthercatSubDevice>) -> Self {
        robot.bus_mut().set_onward_link(false);
        Self(robot)
    }

    /// Sets whether there is a link to the next SubDevice.
    pub fn set_link(&mut self, is_up: bool) {
        self.0.bus_mut().set_onward_link(is_up);
    }

    /// Returns the robot.
    #[must_use]
    pub const fn robot(&self) -> &RobotNode<EthercatSubDevice> {
        &self.0
    }

    /// Returns the robot, for commands to it.
    pub const fn robot_mut(&mut self) -> &mut RobotNode<EthercatSubDevice> {
        &mut self.0
    }
}

impl Multihomed for RobotInLine {
    type Event = RobotEvent;

    fn interfaces(&self) -> u8 {
        2
    }

    fn handle_frame(&mut self, now: Instant, on: InterfaceId, from: Source, frame: &[u8]) {
        if on == ONWARD {
            self.0.bus_mut().handle_returned(now, frame);
        } else {
            Machine::handle_frame(&mut self.0, now, from, frame);
        }
    }

    fn handle_broadcast(&mut self, now: Instant, on: InterfaceId, from: Source, frame: &[u8]) {
        Multihomed::handle_frame(self, now, on, from, frame);
    }

    fn handle_stream(&mut self, _now: Instant, _on: InterfaceId, _stream: StreamId, _change: StreamChange) {}

    fn handle_wrong_neighbour(&mut self, _now: Instant, _on: InterfaceId, _address: Ipv4Addr, _found: Mac) {}

    /// Returns the port of a SubDevice on each of both interfaces.
    fn ports(&self, _on: InterfaceId) -> &[PortRequest] {
        Machine::ports(&self.0)
    }

    fn listen_port(&self, _on: InterfaceId) -> Option<u16> {
        None
    }

    fn poll_stream(&mut self) -> Option<(InterfaceId, StreamRequest)> {
        None
    }

    fn dscp(&self, _on: InterfaceId, _port: Port) -> u8 {
        0
    }

    fn group(&self, _on: InterfaceId, _port: Port, _index: usize) -> Option<Ipv4Addr> {
        None
    }

    fn neighbour(&self, _on: InterfaceId, _address: Ipv4Addr) -> Option<Mac> {
        None
    }

    fn handle_timeout(&mut self, now: Instant) {
        Machine::handle_timeout(&mut self.0, now);
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<(InterfaceId, Transmit)> {
        let (end, transmit) = self.0.bus_mut().poll_frame(now, buf)?;
        let on = match end {
            SegmentEnd::Upstream => InterfaceId::FIRST,
            SegmentEnd::Onward => ONWARD,
        };
        Some((on, transmit))
    }

    fn poll_event(&mut self) -> Option<RobotEvent> {
        Machine::poll_event(&mut self.0)
    }

    fn poll_timeout(&self) -> Option<Instant> {
        Machine::poll_timeout(&self.0)
    }
}
