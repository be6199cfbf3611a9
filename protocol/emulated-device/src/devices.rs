//! Several devices of one process: on EtherCAT a line at one interface, on the other buses each at an interface of its own.

use std::net::Ipv4Addr;

use ethercat_subdevice::SegmentEnd;
use machine::ethernet::Mac;
use machine::{
    Instant, InterfaceId, Machine, Machines, Multihomed, Port, PortRequest, Source, StreamChange, StreamId,
    StreamRequest, Transmit,
};

use crate::config::EmulationError;
use crate::device::{DeviceEvent, EmulatedDevice};

/// Most devices.
pub const MOST_DEVICES: usize = Machines::<EmulatedDevice>::MOST;

/// Devices of one bus, as one machine. Events have the number of their device, from 0.
#[derive(Debug)]
pub struct EmulatedDevices {
    devices: Machines<EmulatedDevice>,
    /// True for the devices of an EtherCAT cable: the first one is at the only interface.
    is_line: bool,
}

impl EmulatedDevices {
    /// Connects devices: those of EtherCAT in their order.
    ///
    /// # Errors
    ///
    /// There is none, there are more than [`MOST_DEVICES`], or they are of different buses.
    pub fn new(mut devices: Vec<EmulatedDevice>) -> Result<Self, EmulationError> {
        let bus = devices.first().map_or("", EmulatedDevice::bus);
        if devices.is_empty() || devices.len() > MOST_DEVICES {
            return Err(EmulationError::Count(devices.len()));
        }
        if let Some(other) = devices.iter().find(|device| device.bus() != bus) {
            return Err(EmulationError::SeveralBuses(bus, other.bus()));
        }
        let is_line = bus == "EtherCAT";
        let before_the_last = devices.len() - 1;
        devices.iter_mut().take(before_the_last).for_each(EmulatedDevice::lead_on);
        Ok(Self { devices: Machines::new(devices), is_line })
    }

    /// Returns the devices in their order.
    #[must_use]
    pub fn devices(&self) -> &[EmulatedDevice] {
        self.devices.as_slice()
    }

    /// Changes a device. Returns `None` for a number beyond the last one.
    pub fn change<T>(&mut self, number: usize, change: impl FnOnce(&mut EmulatedDevice) -> T) -> Option<T> {
        self.devices.change(number, change)
    }

    /// Carries frames from device to device, until one leaves the line towards the MainDevice.
    fn pass_along(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        loop {
            let (number, (end, transmit)) = self.devices.poll_frame(|device| device.poll_frame(now, buf))?;
            let frame = buf.get(..transmit.len).unwrap_or_default();
            match (end, number.checked_sub(1)) {
                (SegmentEnd::Upstream, None) => return Some(transmit),
                (SegmentEnd::Upstream, Some(before)) => {
                    self.change(before, |device| device.handle_returned(now, frame));
                }
                (SegmentEnd::Onward, _) => {
                    let from = Source { port: Port::Ethernet, peer: None };
                    self.change(number + 1, |device| Machine::handle_frame(device, now, from, frame));
                }
            }
        }
    }
}

impl Multihomed for EmulatedDevices {
    type Event = (usize, DeviceEvent);

    fn interfaces(&self) -> u8 {
        if self.is_line { 1 } else { self.devices.interfaces() }
    }

    fn handle_frame(&mut self, now: Instant, on: InterfaceId, from: Source, frame: &[u8]) {
        self.devices.handle_frame(now, on, from, frame);
    }

    fn handle_broadcast(&mut self, now: Instant, on: InterfaceId, from: Source, frame: &[u8]) {
        self.devices.handle_broadcast(now, on, from, frame);
    }

    fn handle_stream(&mut self, now: Instant, on: InterfaceId, stream: StreamId, change: StreamChange) {
        self.devices.handle_stream(now, on, stream, change);
    }

    fn handle_wrong_neighbour(&mut self, now: Instant, on: InterfaceId, address: Ipv4Addr, found: Mac) {
        self.devices.handle_wrong_neighbour(now, on, address, found);
    }

    fn ports(&self, on: InterfaceId) -> &[PortRequest] {
        self.devices.ports(on)
    }

    fn listen_port(&self, on: InterfaceId) -> Option<u16> {
        self.devices.listen_port(on)
    }

    fn poll_stream(&mut self) -> Option<(InterfaceId, StreamRequest)> {
        self.devices.poll_stream()
    }

    fn dscp(&self, on: InterfaceId, port: Port) -> u8 {
        self.devices.dscp(on, port)
    }

    fn group(&self, on: InterfaceId, port: Port, index: usize) -> Option<Ipv4Addr> {
        self.devices.group(on, port, index)
    }

    fn neighbour(&self, on: InterfaceId, address: Ipv4Addr) -> Option<Mac> {
        self.devices.neighbour(on, address)
    }

    fn handle_timeout(&mut self, now: Instant) {
        self.devices.handle_timeout(now);
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<(InterfaceId, Transmit)> {
        if self.is_line {
            return Some((InterfaceId::FIRST, self.pass_along(now, buf)?));
        }
        self.devices.poll_transmit(now, buf)
    }

    fn poll_event(&mut self) -> Option<(usize, DeviceEvent)> {
        self.devices.poll_event()
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.devices.poll_timeout()
    }
}
