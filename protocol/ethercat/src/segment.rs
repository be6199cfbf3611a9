//! A segment: SubDevices on one cable of a MainDevice, as one machine.

mod frames;

use alloc::boxed::Box;
use alloc::collections::VecDeque;
use alloc::vec::Vec;

use machine::{Duration, Instant, Machine, Pending, PortRequest, Source, Transmit};

pub use frames::SegmentEnd;

use frames::UnderWay;

use crate::ETHER_TYPE;
use crate::al::{AlState, AlStatusCode};
use crate::cabling::{Cabling, End, Place};
use crate::config::DeviceConfig;
use crate::event::{DeviceId, Event, Sink};
use crate::mailbox::{Emergency, MailFault};
use crate::subdevice::SubDevice;

/// Ports that a segment needs. A chip ignores the destination address: MainDevices send to broadcast, to a group or to the
/// address of any station.
const PORTS: &[PortRequest] = &[PortRequest::AnyEthernet { ether_type: ETHER_TYPE }];

/// What a segment did with the frames that it received.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub struct Counters {
    /// EtherCAT frames that passed the devices and went back, or on to devices after the last one.
    pub passed: u64,
    /// Frames that were lost: no device has power and a whole cable, or too many frames were under way.
    pub lost: u64,
    /// Frames without datagrams: of other protocols, or damaged.
    pub foreign: u64,
}

/// Inputs that a device does not have.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
pub enum DataError {
    /// There is no such device.
    #[error("there is no device {0:?} on this segment")]
    NoDevice(DeviceId),
    /// The data have another length than the device's inputs.
    #[error("{given} bytes for inputs of {wanted} bytes")]
    WrongLength {
        /// Length of the inputs in bytes.
        wanted: usize,
        /// Length of the data in bytes.
        given: usize,
    },
}

/// SubDevices on one cable.
#[derive(Default, Debug)]
pub struct Segment {
    devices: Vec<SubDevice>,
    cabling: Cabling,
    /// State of the cable at port 1 of the last device: true with a link; `None` if that port does not lead out of the segment.
    onward_link: Option<bool>,
    under_way: VecDeque<UnderWay>,
    spare: Vec<Box<[u8]>>,
    events: VecDeque<(DeviceId, Event)>,
    counters: Counters,
}

impl Segment {
    /// Creates a segment without devices.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a device behind the last one, at its port 1, or at port 0 if port 1 leads towards the MainDevice.
    pub fn add(&mut self, config: &DeviceConfig) -> DeviceId {
        // The place behind the last device is always free: each added device becomes the last one.
        self.connect(
            config,
            match self.devices.len().checked_sub(1) {
                Some(device) => {
                    let port = usize::from(self.cabling.upstream_port(device) != 1);
                    End::Device(Place { device, port })
                }
                None => End::MainDevice,
            },
        )
    }

    /// Connects port 1 of the last device to devices that are not in this segment: the last device shows a link there, and a frame
    /// leaves there when all devices have processed it. Whoever carries the frame gives it to those devices, and then back to the
    /// MainDevice: a device does not process frames on their way back. [`handle_returned`](Self::handle_returned) brings them back
    /// through this segment, as on a real cable.
    pub fn lead_on(&mut self) {
        self.set_onward_link(true);
    }

    /// Sets whether the cable from port 1 of the last device has a link. Without one the device closes the loop there: frames turn
    /// round and go back to the MainDevice.
    pub fn set_onward_link(&mut self, is_up: bool) {
        if self.onward_link.is_none()
            && let Some(last) = self.devices.last_mut()
        {
            last.esc.add_port(1);
        }
        self.onward_link = Some(is_up);
        self.update_links();
    }

    /// Adds a device at a port of another one. Returns `None` if there is no such port or if it is taken.
    pub fn add_at(&mut self, config: &DeviceConfig, device: DeviceId, port: usize) -> Option<DeviceId> {
        let place = Place { device: device.0, port };
        self.cabling.is_free(place).then(|| self.connect(config, End::Device(place)))
    }

    fn connect(&mut self, config: &DeviceConfig, upstream: End) -> DeviceId {
        self.cabling.add(upstream, config);
        if let End::Device(place) = upstream
            && let Some(device) = self.devices.get_mut(place.device)
        {
            device.esc.add_port(place.port);
        }
        let mut device = SubDevice::new(config);
        device.esc.add_port(self.cabling.upstream_port(self.devices.len()));
        self.devices.push(device);
        self.update_links();
        DeviceId(self.devices.len() - 1)
    }

    /// Returns the number of devices.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.devices.len()
    }

    /// Returns whether there are no devices.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.devices.is_empty()
    }

    /// Returns what the segment did with the frames that it received.
    #[must_use]
    pub const fn counters(&self) -> Counters {
        self.counters
    }

    /// Returns a device's state, and the error that it indicates.
    #[must_use]
    pub fn state(&self, id: DeviceId) -> Option<(AlState, AlStatusCode)> {
        self.devices.get(id.0).map(SubDevice::state)
    }

    /// Returns the outputs that the MainDevice wrote last, while the device is in OP.
    #[must_use]
    pub fn outputs(&self, id: DeviceId) -> Option<&[u8]> {
        self.devices.get(id.0)?.outputs()
    }

    /// Sets the inputs, which the MainDevice reads from its next frame on.
    pub fn set_inputs(&mut self, id: DeviceId, data: &[u8]) -> Result<(), DataError> {
        let device = self.devices.get_mut(id.0).ok_or(DataError::NoDevice(id))?;
        let inputs = device.inputs_mut();
        if inputs.len() != data.len() {
            return Err(DataError::WrongLength { wanted: inputs.len(), given: data.len() });
        }
        inputs.copy_from_slice(data);
        device.publish_inputs();
        Ok(())
    }

    /// Returns the value of an object's entry that is not mapped into process data.
    #[must_use]
    pub fn object(&self, id: DeviceId, index: u16, subindex: u8) -> Option<&[u8]> {
        self.devices.get(id.0)?.dictionary().get(index, subindex)
    }

    /// Sets the value of an object's entry that is not mapped into process data, even if the MainDevice may not write it.
    /// Returns `None` if there is no such entry, or if the value has the wrong length.
    pub fn set_object(&mut self, id: DeviceId, index: u16, subindex: u8, value: &[u8]) -> Option<()> {
        self.devices.get_mut(id.0)?.dictionary_mut().set(index, subindex, value)
    }

    /// Returns whether a device's process data have the described entries in their order: the MainDevice has not mapped other
    /// ones.
    #[must_use]
    pub fn is_mapped_as_described(&self, id: DeviceId) -> bool {
        self.devices.get(id.0).is_none_or(|device| device.dictionary().is_as_described())
    }

    /// Returns the value of an object's entry, of up to 64 bits, wherever it is: in the outputs, once they have come in OP, in
    /// the inputs, or in the dictionary.
    #[must_use]
    pub fn number(&self, id: DeviceId, index: u16, subindex: u8) -> Option<u64> {
        self.devices.get(id.0)?.number(index, subindex)
    }

    /// Sets the value of an object's entry, of up to 64 bits, wherever it is. Bits that the entry does not have are left out.
    /// Returns `None` for an unknown entry.
    pub fn set_number(&mut self, id: DeviceId, index: u16, subindex: u8, number: u64) -> Option<()> {
        self.devices.get_mut(id.0)?.set_number(index, subindex, number)
    }

    /// Reports an error to the MainDevice by CoE. Returns whether the device's mailbox runs and had room for it.
    pub fn raise(&mut self, id: DeviceId, emergency: Emergency) -> bool {
        self.devices.get_mut(id.0).is_some_and(|device| device.raise(emergency))
    }

    /// Sets the fault of the answers that a device gives by its mailbox; none for a good one. Emergencies have none.
    pub fn set_mail_fault(&mut self, id: DeviceId, fault: Option<MailFault>) {
        if let Some(device) = self.devices.get_mut(id.0) {
            device.set_mail_fault(fault);
        }
    }

    /// Returns name and content of the file that the MainDevice wrote.
    #[must_use]
    pub fn file(&self, id: DeviceId) -> Option<(&[u8], &[u8])> {
        self.devices.get(id.0)?.file().get()
    }

    /// Returns a device's local copy of the system time in nanoseconds, if it has a clock.
    #[must_use]
    pub fn system_time(&self, id: DeviceId, now: Instant) -> Option<u64> {
        self.devices.get(id.0)?.esc.system_time(now)
    }

    /// Returns the content of a device's EEPROM. The chip's own configuration counts from the next power-on.
    pub fn eeprom_mut(&mut self, id: DeviceId) -> Option<&mut [u8]> {
        Some(self.devices.get_mut(id.0)?.esc.eeprom_mut())
    }

    /// Makes a device fall to SAFE-OP with an error of its own.
    pub fn fail(&mut self, id: DeviceId, code: AlStatusCode) {
        if let Some(device) = self.devices.get_mut(id.0) {
            device.fail(code, &mut Sink { id, events: &mut self.events });
        }
    }

    /// Opens or closes a device's process data to the MainDevice, as its application does. While they are closed they do not
    /// count in the working counter; the next change of state opens them again.
    pub fn set_process_data_locked(&mut self, id: DeviceId, locked: bool) {
        if let Some(device) = self.devices.get_mut(id.0) {
            device.lock_process_data(locked);
        }
    }

    /// Cuts the cable of a device towards the MainDevice, or mends it.
    pub fn set_cut(&mut self, id: DeviceId, cut: bool) {
        self.cabling.set_cut(id.0, cut);
        self.update_links();
    }

    /// Takes a device's power, or gives it back: it is in INIT then and has no address. Its EEPROM, file and objects
    /// keep their values.
    pub fn set_power(&mut self, now: Instant, id: DeviceId, powered: bool) {
        if self.cabling.set_power(id.0, powered)
            && let Some(device) = self.devices.get_mut(id.0)
        {
            device.power_on(now, &mut Sink { id, events: &mut self.events });
        }
        self.update_links();
    }

    /// Changes the time that a device's application takes for an answer, to make it hang or answer slowly.
    pub fn set_answer_delay(&mut self, id: DeviceId, delay: Duration) {
        if let Some(device) = self.devices.get_mut(id.0) {
            device.set_answer_delay(delay);
        }
    }

    fn update_links(&mut self) {
        let onward = self.onward();
        for (index, device) in self.devices.iter_mut().enumerate() {
            let mut links = self.cabling.links(index);
            if onward.is_some_and(|place| place.device == index) {
                links[1] = true;
            }
            device.esc.set_ports(links);
        }
    }

    /// Returns the port from which a connected cable leads to devices that are not in this segment.
    fn onward(&self) -> Option<Place> {
        let last = self.devices.len().checked_sub(1).filter(|_| self.onward_link == Some(true))?;
        Some(Place { device: last, port: 1 })
    }
}

impl Machine for Segment {
    type Event = (DeviceId, Event);

    fn ports(&self) -> &[PortRequest] {
        PORTS
    }

    fn handle_frame(&mut self, now: Instant, _from: Source, frame: &[u8]) {
        self.take(now, SegmentEnd::Upstream, frame);
    }

    fn handle_timeout(&mut self, now: Instant) {
        for (index, device) in self.devices.iter_mut().enumerate() {
            if self.cabling.is_powered(index) {
                device.advance(now, &mut Sink { id: DeviceId(index), events: &mut self.events });
            }
        }
    }

    fn pending(&self, now: Instant) -> Pending {
        let frame = self.under_way.front().is_some_and(|next| next.departs <= now);
        Pending { frame, request: false, event: !self.events.is_empty() }
    }

    /// Returns the next frame by whichever end: the owner of a segment that leads on carries it further.
    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        self.poll_frame(now, buf).map(|(_, transmit)| transmit)
    }

    fn poll_event(&mut self) -> Option<(DeviceId, Event)> {
        self.events.pop_front()
    }

    fn poll_timeout(&self) -> Option<Instant> {
        let frames = self.under_way.front().map(|next| next.departs);
        let powered = self.devices.iter().enumerate().filter(|(index, _)| self.cabling.is_powered(*index));
        powered.map(|(_, device)| device.deadline()).fold(frames, Instant::earlier)
    }
}
