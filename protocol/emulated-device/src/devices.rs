//! Several devices of one process: on EtherCAT a line at one interface, on the other buses each at an interface of its own.

use std::net::Ipv4Addr;

use ethercat_subdevice::SegmentEnd;
use machine::ethernet::Mac;
use machine::{
    Deadlines, Instant, InterfaceId, Machine, Multihomed, Numbers, Port, PortRequest, Source, StreamChange,
    StreamId, StreamRequest, Transmit, Turns,
};

use crate::config::EmulationError;
use crate::device::{DeviceEvent, EmulatedDevice};

/// Most devices: interfaces are numbered by a byte, and one number stays free.
pub const MOST_DEVICES: usize = 255;

/// Devices of one bus, as one machine. Events have the number of their device, from 0.
#[derive(Debug)]
pub struct EmulatedDevices {
    devices: Vec<EmulatedDevice>,
    /// True for the devices of an EtherCAT cable: the first one is at the only interface.
    is_line: bool,
    deadlines: Deadlines,
    /// Devices whose deadline is over.
    due: Numbers,
    /// Devices that may have frames or requests, and those that may have events.
    sending: Turns,
    reporting: Turns,
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
        let count = devices.len();
        let [mut sending, mut reporting] = [const { Turns::new() }; 2];
        let mut due = Numbers::new();
        due.reserve(count);
        sending.reserve(count);
        reporting.reserve(count);
        let mut own = Self { devices, is_line, deadlines: Deadlines::new(), due, sending, reporting };
        for number in 0..count {
            own.change(number, |_| ());
        }
        Ok(own)
    }

    /// Returns the devices in their order.
    #[must_use]
    pub fn devices(&self) -> &[EmulatedDevice] {
        &self.devices
    }

    /// Changes a device. Returns `None` for a number beyond the last one.
    pub fn change<T>(&mut self, number: usize, change: impl FnOnce(&mut EmulatedDevice) -> T) -> Option<T> {
        let device = self.devices.get_mut(number)?;
        let changed = change(device);
        let index = u16::try_from(number).ok()?;
        self.deadlines.set(index, Machine::poll_timeout(device));
        self.sending.push(index);
        self.reporting.push(index);
        Some(changed)
    }

    /// Returns the number of the device at an interface.
    fn at(&self, InterfaceId(on): InterfaceId) -> usize {
        usize::from(on)
    }

    fn get(&self, on: InterfaceId) -> Option<&EmulatedDevice> {
        self.devices.get(self.at(on))
    }

    /// Carries frames from device to device, until one leaves the line towards the MainDevice.
    fn pass_along(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        while let Some(index) = self.sending.first() {
            let number = usize::from(index);
            let Some((end, transmit)) = self.devices.get_mut(number)?.poll_frame(now, buf) else {
                self.sending.pop();
                continue;
            };
            let frame = buf.get(..transmit.len).unwrap_or_default();
            match (end, number.checked_sub(1)) {
                (SegmentEnd::Upstream, None) => {
                    self.change(number, |_| ());
                    return Some(transmit);
                }
                (SegmentEnd::Upstream, Some(before)) => {
                    self.change(before, |device| device.handle_returned(now, frame));
                }
                (SegmentEnd::Onward, _) => {
                    let from = Source { port: Port::Ethernet, peer: None };
                    self.change(number + 1, |device| Machine::handle_frame(device, now, from, frame));
                }
            }
            self.change(number, |_| ());
        }
        None
    }
}

impl Multihomed for EmulatedDevices {
    type Event = (usize, DeviceEvent);

    fn interfaces(&self) -> u8 {
        if self.is_line { 1 } else { u8::try_from(self.devices.len()).unwrap_or(u8::MAX) }
    }

    fn handle_frame(&mut self, now: Instant, on: InterfaceId, from: Source, frame: &[u8]) {
        self.change(self.at(on), |device| Machine::handle_frame(device, now, from, frame));
    }

    fn handle_broadcast(&mut self, now: Instant, on: InterfaceId, from: Source, frame: &[u8]) {
        self.change(self.at(on), |device| Machine::handle_broadcast(device, now, from, frame));
    }

    fn handle_stream(&mut self, now: Instant, on: InterfaceId, stream: StreamId, change: StreamChange) {
        self.change(self.at(on), |device| Machine::handle_stream(device, now, stream, change));
    }

    fn handle_wrong_neighbour(&mut self, now: Instant, on: InterfaceId, address: Ipv4Addr, found: Mac) {
        self.change(self.at(on), |device| Machine::handle_wrong_neighbour(device, now, address, found));
    }

    fn ports(&self, on: InterfaceId) -> &[PortRequest] {
        self.get(on).filter(|_| on.0 < self.interfaces()).map_or(&[], Machine::ports)
    }

    fn listen_port(&self, on: InterfaceId) -> Option<u16> {
        Machine::listen_port(self.get(on)?)
    }

    fn poll_stream(&mut self) -> Option<(InterfaceId, StreamRequest)> {
        let numbers = 0..self.interfaces();
        numbers.filter(|_| !self.is_line).find_map(|number| {
            let device = self.devices.get_mut(usize::from(number))?;
            Some((InterfaceId(number), Machine::poll_stream(device)?))
        })
    }

    fn dscp(&self, on: InterfaceId, port: Port) -> u8 {
        self.get(on).map_or(0, |device| Machine::dscp(device, port))
    }

    fn group(&self, on: InterfaceId, port: Port, index: usize) -> Option<Ipv4Addr> {
        Machine::group(self.get(on)?, port, index)
    }

    fn neighbour(&self, on: InterfaceId, address: Ipv4Addr) -> Option<Mac> {
        Machine::neighbour(self.get(on)?, address)
    }

    fn handle_timeout(&mut self, now: Instant) {
        while let Some(index) = self.deadlines.take_due(now) {
            self.due.insert(index);
        }
        while let Some(index) = self.due.take_first() {
            self.change(usize::from(index), |device| Machine::handle_timeout(device, now));
        }
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<(InterfaceId, Transmit)> {
        if self.is_line {
            return Some((InterfaceId::FIRST, self.pass_along(now, buf)?));
        }
        while let Some(index) = self.sending.first() {
            let device = self.devices.get_mut(usize::from(index))?;
            if let Some(transmit) = Machine::poll_transmit(device, now, buf) {
                self.deadlines.set(index, Machine::poll_timeout(device));
                self.reporting.push(index);
                return Some((InterfaceId(u8::try_from(index).ok()?), transmit));
            }
            self.sending.pop();
        }
        None
    }

    fn poll_event(&mut self) -> Option<(usize, DeviceEvent)> {
        while let Some(index) = self.reporting.first() {
            let number = usize::from(index);
            if let Some(event) = self.devices.get_mut(number).and_then(Machine::poll_event) {
                return Some((number, event));
            }
            self.reporting.pop();
        }
        None
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.deadlines.first()
    }
}
