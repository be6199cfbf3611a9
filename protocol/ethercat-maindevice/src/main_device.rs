//! The MainDevice as a machine: one cable with several devices, each of which is up or down on its own.
//!
//! ```text
//! MainDevice ─┬─ device 1: an ethercrab of its own ─┐
//!             ├─ device 2: an ethercrab of its own ─┼─ cable: their datagrams share Ethernet frames
//!             └─ ...                                ┘
//! ```
//!
//! So whatever happens to one device is handled as if it were alone on the cable, and the others do not take part in it. A
//! MainDevice with one device sends that ethercrab's frames as they are.

use std::fmt;

use machine::{
    Counters, Deadlines, Instant, LinkEvent, Machine, Numbers, Pending, Port, PortRequest, Source, Transmit,
    Turns,
};

use crate::ETHER_TYPE;
use crate::cable::{Cable, Reply};
use crate::commissioning::{DetectedModule, ModuleList, SdoAnswer, SdoRefusal, SdoRequest, StartupWrite};
use crate::config::Config;
use crate::foreign::{self, Foreign};
use crate::group::GroupMainDevice;
use crate::slot::Slot;

/// Largest number of devices: their station addresses and logical addresses must not overlap.
const MOST_DEVICES: usize = 1024;

/// A device of a [`MainDevice`]: its place in [`Config::devices`], from 0.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Debug)]
pub struct SubDeviceId(pub u16);

/// Error: more devices than a MainDevice can drive.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct TooManyDevices(pub usize);

impl fmt::Display for TooManyDevices {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} devices on one EtherCAT cable: use at most {MOST_DEVICES}", self.0)
    }
}

impl std::error::Error for TooManyDevices {}

/// Error: positions that devices cannot have.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
pub enum PositionError {
    /// Another number of positions than of devices.
    #[error("{positions} positions for {devices} devices: give each device its position")]
    Number {
        /// Number of positions.
        positions: usize,
        /// Number of devices.
        devices: usize,
    },
    /// A position of two devices, from 0.
    #[error("position {} is that of two devices; give each its own", .0 + 1)]
    Twice(u16),
    /// A position beyond the last one.
    #[error(transparent)]
    TooMany(#[from] TooManyDevices),
}

/// A MainDevice that drives the devices of its [`Config`], each on its own: it brings them to OP and exchanges process data
/// with each cycle. When a device leaves OP, is cut off, missing or another one than expected, the MainDevice reports this for
/// the device and brings it to OP as soon as possible; the others exchange their data meanwhile. It changes nothing while
/// another MainDevice drives the devices.
///
/// Devices after the last expected one are left as they are, unless there is only one expected device: then they are refused.
/// [`at_positions`](Self::at_positions) leaves all others as they are.
#[derive(Debug)]
pub struct MainDevice {
    devices: Vec<Device>,
    /// True if the only device has the cable for itself: then its ethercrab's frames go out as they are.
    is_alone: bool,
    cable: Cable,
    deadlines: Deadlines,
    /// Devices whose deadline is over.
    due: Numbers,
    /// Devices that have frames to send.
    sending: Turns,
    /// Devices that have events.
    reporting: Turns,
    /// Devices whose process data have arrived since the owner last asked.
    received: Turns,
    /// Number of devices that are up.
    up: usize,
    /// Frames of other MainDevices, where several devices share the cable.
    foreign: Foreign,
    /// Replies to no frame on its way.
    late: u64,
}

#[derive(Debug)]
struct Device {
    main: GroupMainDevice,
    slot: Slot,
    is_up: bool,
}

impl MainDevice {
    /// Creates a MainDevice that looks for its devices from `start` on.
    pub fn new(config: Config, start: Instant) -> Result<Self, TooManyDevices> {
        let is_alone = config.devices.len() == 1;
        let positions: Vec<_> = (0..=u16::MAX).take(config.devices.len()).collect();
        Self::of(config, &positions, is_alone, start)
    }

    /// Creates a MainDevice whose devices are at these positions on the cable, from 0: one for each device of the config. It
    /// changes nothing at other devices.
    pub fn at_positions(positions: &[u16], config: Config, start: Instant) -> Result<Self, PositionError> {
        if positions.len() != config.devices.len() {
            return Err(PositionError::Number { positions: positions.len(), devices: config.devices.len() });
        }
        let mut sorted = positions.to_vec();
        sorted.sort_unstable();
        match sorted.windows(2).find(|pair| pair.first() == pair.last()).and_then(<[u16]>::first) {
            Some(position) => Err(PositionError::Twice(*position)),
            None => Ok(Self::of(config, positions, false, start)?),
        }
    }

    fn of(config: Config, positions: &[u16], is_alone: bool, start: Instant) -> Result<Self, TooManyDevices> {
        let count = config.devices.len();
        let range =
            (positions.iter().min().copied().unwrap_or(0), positions.iter().max().copied().unwrap_or(0));
        let last = count.max(usize::from(range.1) + usize::from(count > 0));
        if last > MOST_DEVICES {
            return Err(TooManyDevices(last));
        }
        let mut deadlines = Deadlines::new();
        let device = |(driven, (index, device))| {
            let slot = Slot { index, driven, range, grid: start };
            let config = Config { devices: vec![device], ..config.clone() };
            let main = GroupMainDevice::at((!is_alone).then_some(slot), config, start);
            deadlines.set(driven, main.poll_timeout());
            Device { main, slot, is_up: false }
        };
        let devices = positions.iter().copied().zip(config.devices.iter().copied());
        let devices: Vec<_> = (0..).zip(devices).map(device).collect();
        let [mut sending, mut reporting, mut received] = [const { Turns::new() }; 3];
        let mut due = Numbers::new();
        due.reserve(count);
        for turns in [&mut sending, &mut reporting, &mut received] {
            turns.reserve(count);
        }
        Ok(Self {
            cable: Cable::new(if is_alone { 0 } else { count }),
            devices,
            is_alone,
            deadlines,
            due,
            sending,
            reporting,
            received,
            up: 0,
            foreign: Foreign::none(),
            late: 0,
        })
    }

    /// Returns the devices.
    pub fn ids(&self) -> impl Iterator<Item = SubDeviceId> + use<> {
        (0..self.devices.len() as u16).map(SubDeviceId)
    }

    /// Returns the data for a device, which go out with the next cycle; empty if there is no such device.
    pub fn outputs_mut(&mut self, id: SubDeviceId) -> &mut [u8] {
        self.devices.get_mut(usize::from(id.0)).map_or(&mut [], |device| device.main.outputs_mut())
    }

    /// Returns a device's data from its last good exchange; `None` unless it is in OP.
    #[must_use]
    pub fn inputs(&self, id: SubDeviceId) -> Option<&[u8]> {
        self.devices.get(usize::from(id.0))?.main.inputs()
    }

    /// Returns the counters of a device's process data: `sent` and `received` are exchanges. An exchange without a good reply
    /// is `lost`, and so are the cycles that pass while it waits for the reply.
    #[must_use]
    pub fn counters(&self, id: SubDeviceId) -> Counters {
        self.devices.get(usize::from(id.0)).map_or_else(Counters::default, |device| device.main.counters())
    }

    /// Returns the next device whose process data have arrived since it was last returned here.
    pub fn poll_received(&mut self) -> Option<SubDeviceId> {
        self.received.pop().map(SubDeviceId)
    }

    /// Returns the counters of frames that concern no device: late replies, and frames of other MainDevices. With one device
    /// that has the cable for itself, its own counters have them.
    #[must_use]
    pub fn cable_counters(&self) -> Counters {
        Counters { late: self.late, foreign: self.foreign.heard(), ..Counters::default() }
    }

    /// Takes a device to INIT with the next cycle and ends its connection; without a connection, ends at once.
    pub fn disconnect(&mut self, now: Instant, id: SubDeviceId) {
        self.serve(id.0, |main| main.disconnect(now));
    }

    /// Sets what is written to a device's objects in PRE-OP, before its process data are configured. Call it at the start.
    pub fn set_startup(&mut self, id: SubDeviceId, writes: Vec<StartupWrite>) {
        self.serve(id.0, |main| main.commissioning_mut().startup = writes);
    }

    /// Reads which modules a device detects (object 0xF050) once it is in PRE-OP, in place of exchanging process data: for an owner who
    /// does not know their size yet. The device returns to INIT. Call it at the start.
    pub fn read_modules(&mut self, id: SubDeviceId) {
        self.serve(id.0, |main| main.commissioning_mut().modules = ModuleList::Wanted);
    }

    /// Returns the modules of a device that were read, once, or why it does not list them.
    pub fn take_modules(&mut self, id: SubDeviceId) -> Option<Result<Vec<DetectedModule>, String>> {
        let modules = &mut self.devices.get_mut(usize::from(id.0))?.main.commissioning_mut().modules;
        match std::mem::take(modules) {
            ModuleList::Read(found) => Some(found),
            other => {
                *modules = other;
                None
            }
        }
    }

    /// Holds a device in SAFE-OP, where it sends inputs and ignores outputs, or lets it go to OP. A device that is held counts
    /// as up.
    pub fn hold_safe_op(&mut self, id: SubDeviceId, holds: bool) {
        self.serve(id.0, |main| main.commissioning_mut().holds_safe_op = holds);
    }

    /// Sets where a device's mailbox for the MainDevice is, in bytes from address 0; it is read for emergencies while no SDO
    /// is under way. Call it at the start.
    pub fn set_mailbox(&mut self, id: SubDeviceId, start: u16, len: u16) {
        self.serve(id.0, |main| main.commissioning_mut().mailbox = Some((start, len)));
    }

    /// Reads or writes an object of a device while it is up, one at a time. [`take_sdo`](Self::take_sdo) returns the answer.
    ///
    /// # Errors
    ///
    /// The device is not up, its mailbox is not known, an earlier request has not ended, or the data are too long.
    pub fn request_sdo(&mut self, id: SubDeviceId, request: SdoRequest) -> Result<(), SdoRefusal> {
        let mut result = Err(SdoRefusal::NotConnected);
        self.serve(id.0, |main| {
            if main.is_up() {
                result = main.commissioning_mut().ask(request);
            }
        });
        result
    }

    /// Returns the answer to the request once. If the connection ends before, this is the answer.
    pub fn take_sdo(&mut self, id: SubDeviceId) -> Option<SdoAnswer> {
        self.devices.get_mut(usize::from(id.0))?.main.commissioning_mut().take_answer()
    }

    /// Returns the next emergency of a device: error code, error register and data, as CoE carries them.
    pub fn poll_emergency(&mut self, id: SubDeviceId) -> Option<[u8; 8]> {
        self.devices.get_mut(usize::from(id.0))?.main.commissioning_mut().emergencies.pop_front()
    }

    /// Writes details that the last event `Down` of a device does not contain: what was expected and what was found.
    pub fn explain(&self, id: SubDeviceId, words: &mut dyn fmt::Write) -> fmt::Result {
        let Some(Device { main, .. }) = self.devices.get(usize::from(id.0)) else { return Ok(()) };
        main.explain(words)?;
        match self.cable.devices().filter(|_| main.is_missing()) {
            Some(1) => words.write_str("; the cable has 1 device"),
            Some(count) => write!(words, "; the cable has {count} devices"),
            None => Ok(()),
        }
    }

    /// Writes what a device says of itself in its EEPROM; nothing before it was found.
    ///
    /// # Errors
    ///
    /// That of the writer.
    pub fn write_identity(&self, id: SubDeviceId, words: &mut dyn fmt::Write) -> fmt::Result {
        let device = self.devices.get(usize::from(id.0));
        device.map_or(Ok(()), |device| device.main.write_identity(words))
    }

    /// Calls a device, and notes what it has to send and to report, and when it is due next.
    fn serve(&mut self, index: u16, call: impl FnOnce(&mut GroupMainDevice)) {
        let Some(Device { main, is_up, .. }) = self.devices.get_mut(usize::from(index)) else { return };
        let before = main.counters().received;
        call(main);
        if main.counters().received != before {
            self.received.push(index);
        }
        let was_up = std::mem::replace(is_up, main.is_up());
        self.up = self.up + usize::from(*is_up) - usize::from(was_up);
        self.deadlines.set(index, main.poll_timeout());
        if main.next_frame().is_some() {
            self.sending.push(index);
        }
        if main.has_event() {
            self.reporting.push(index);
        }
    }

    /// Gives each device its part of a reply.
    fn handle_reply(&mut self, now: Instant, from: Source, place: usize, frame: &[u8]) {
        let mut cable = std::mem::take(&mut self.cable);
        for number in 0.. {
            let Some((device, reply)) = cable.part(place, number, frame) else { break };
            self.serve(device, |main| main.handle_frame(now, from, reply));
        }
        self.cable = cable;
    }

    /// Handles a frame that no device of this cable expects. Devices on their way to OP must hear it, to find out whether another
    /// MainDevice drives them; those in OP learn of it once it is certain.
    fn handle_stray(&mut self, now: Instant, from: Source, frame: &[u8], is_own: bool) {
        if self.up < self.devices.len() {
            for index in 0..self.devices.len() as u16 {
                let is_up = self.devices.get(usize::from(index)).is_none_or(|device| device.is_up);
                if !is_up {
                    self.serve(index, |main| main.handle_frame(now, from, frame));
                }
            }
        }
        if let (false, Some(source)) = (is_own, foreign::source(frame)) {
            self.foreign.hear(now, source, frame);
        }
        if let Some(other) = self.foreign.found() {
            self.foreign.forget();
            for index in 0..self.devices.len() as u16 {
                self.serve(index, |main| main.handle_other(now, other));
            }
        }
    }

    fn is_own(&self, frame: &[u8]) -> bool {
        let own = self.devices.first().map(|device| device.main.source());
        foreign::source(frame).zip(own).is_some_and(|(source, own)| foreign::is_same(source, own))
    }
}

impl Machine for MainDevice {
    type Event = (SubDeviceId, LinkEvent);

    /// Other MainDevices may send to any address.
    fn ports(&self) -> &[PortRequest] {
        &[PortRequest::AnyEthernet { ether_type: ETHER_TYPE }]
    }

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        if self.is_alone {
            return self.serve(0, |main| main.handle_frame(now, from, frame));
        }
        if !self.is_own(frame) {
            return self.handle_stray(now, from, frame, false);
        }
        match self.cable.find(frame) {
            Reply::Of(place) => self.handle_reply(now, from, place, frame),
            Reply::Late => self.late += 1,
            // Another program on this host has the same source address.
            Reply::Unknown => self.handle_stray(now, from, frame, true),
        }
    }

    fn handle_timeout(&mut self, now: Instant) {
        while let Some(index) = self.deadlines.take_due(now) {
            self.due.insert(index);
        }
        while let Some(index) = self.due.take_first() {
            self.serve(index, |main| main.handle_timeout(now));
        }
    }

    fn pending(&self, _now: Instant) -> Pending {
        let frame = match self.devices.as_slice() {
            [device] if self.is_alone => device.main.next_frame().is_some(),
            _ => !self.sending.is_empty(),
        };
        Pending { frame, request: false, event: !self.reporting.is_empty() }
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        if let ([device], true) = (self.devices.as_mut_slice(), self.is_alone) {
            return device.main.poll_transmit(now, buf);
        }
        let mut len = None;
        while let Some(index) = self.sending.first() {
            let Some(device) = self.devices.get_mut(usize::from(index)) else { break };
            let Some(frame) = device.main.next_frame() else {
                self.sending.pop();
                continue;
            };
            let start = match len {
                Some(len) => len,
                None => self.cable.begin(frame, buf)?,
            };
            match self.cable.append(device.slot, frame, buf, start) {
                Some(end) => len = Some(end),
                // It waits for the next frame.
                None if len.is_some() => break,
                // It is too long for any frame.
                None => {}
            }
            device.main.drop_frame();
        }
        let len = self.cable.finish(buf, len?)?;
        Some(Transmit { port: Port::Ethernet, to: None, len })
    }

    fn poll_event(&mut self) -> Option<Self::Event> {
        while let Some(index) = self.reporting.first() {
            let device = self.devices.get_mut(usize::from(index));
            if let Some(event) = device.and_then(|device| device.main.poll_event()) {
                return Some((SubDeviceId(index), event));
            }
            self.reporting.pop();
        }
        None
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.deadlines.first()
    }
}
