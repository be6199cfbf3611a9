//! A MainDevice and its devices on one cable.

use std::collections::BTreeMap;

use ethercat_maindevice::{Config, ExpectedDevice, MainDevice, SubDeviceId};
use ethercat_subdevice::description::{DataType, Description, Mailbox, Pdo, PdoEntry};
use ethercat_subdevice::{DeviceConfig, DeviceId, Segment};
use machine::ethernet::Mac;
use machine::{DownCause, Duration, Instant, LinkEvent, Machine, PortRequest, Source, Transmit};
use virtual_time::{Clock, Event, Impairment, Pair, PairConfig};

pub(crate) const MS: Duration = Duration::from_millis(1);
pub(crate) const BYTES: usize = 8;

pub(crate) const fn numbers(index: u16) -> PdoEntry {
    PdoEntry { index, subindex: 1, bits: 64, data_type: DataType::Unsigned64, name: "Number" }
}

/// Eight bytes each way, with a mailbox.
pub(crate) static DEVICE: Description = Description {
    vendor_id: 0x0000_0F00,
    product_code: 7,
    revision: 3,
    order_code: "ECHO",
    name: "Eight bytes each way",
    group: "Test devices",
    device_type: 0,
    hardware_version: "1",
    software_version: "1",
    outputs: &[Pdo { index: 0x1600, name: "Outputs", entries: &[numbers(0x7000)] }],
    inputs: &[Pdo { index: 0x1A00, name: "Inputs", entries: &[numbers(0x6000)] }],
    mailbox: Some(Mailbox { len: 128, file_capacity: 0 }),
    objects: &[],
    optional_outputs: &[],
    optional_inputs: &[],
    clock_modes: &[],
    numbers_names: true,
};

/// The same with another product code.
pub(crate) static OTHER: Description = Description { product_code: 8, order_code: "OTHER", ..DEVICE };

/// 256 bytes each way.
pub(crate) static LARGE: Description = Description {
    product_code: 9,
    outputs: &[Pdo { index: 0x1600, name: "Outputs", entries: &[numbers(0x7000); 32] }],
    inputs: &[Pdo { index: 0x1A00, name: "Inputs", entries: &[numbers(0x6000); 32] }],
    mailbox: None,
    ..DEVICE
};

/// Devices that send their outputs back.
pub(crate) struct Echo {
    pub(crate) segment: Segment,
    /// Frames that came.
    pub(crate) frames: u64,
    pub(crate) longest: usize,
    /// All frames, if they are kept, and when they came.
    pub(crate) kept: Option<Vec<(Instant, Vec<u8>)>>,
    /// Positions of two devices that have changed places.
    pub(crate) swapped: Option<(u16, u16)>,
}

impl Echo {
    pub(crate) fn of(segment: Segment) -> Self {
        Self { segment, frames: 0, longest: 0, kept: None, swapped: None }
    }
}

/// Returns a frame in which accesses by position go to the other one of two devices.
fn swapped(frame: &[u8], (one, other): (u16, u16)) -> Vec<u8> {
    let mut frame = frame.to_vec();
    let end = 16 + usize::from(u16::from_le_bytes([frame[14], frame[15]]) & 0x07FF);
    let mut at = 16;
    while at < end {
        let position = 0_u16.wrapping_sub(u16::from_le_bytes([frame[at + 2], frame[at + 3]]));
        let by_position = matches!(frame[at], 1..=3);
        let to = if position == one { other } else { one };
        if by_position && (position == one || position == other) {
            frame[at + 2..at + 4].copy_from_slice(&0_u16.wrapping_sub(to).to_le_bytes());
        }
        at += 12 + usize::from(u16::from_le_bytes([frame[at + 6], frame[at + 7]]) & 0x07FF);
    }
    frame
}

impl Machine for Echo {
    type Event = (DeviceId, ethercat_subdevice::Event);

    fn ports(&self) -> &[PortRequest] {
        self.segment.ports()
    }

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        self.frames += 1;
        self.longest = self.longest.max(frame.len());
        if let Some(kept) = &mut self.kept {
            kept.push((now, frame.to_vec()));
        }
        match self.swapped {
            None => self.segment.handle_frame(now, from, frame),
            Some(places) => self.segment.handle_frame(now, from, &swapped(frame, places)),
        }
        for id in (0..self.segment.len()).map(DeviceId) {
            if let Some(outputs) = self.segment.outputs(id).map(<[u8]>::to_vec) {
                self.segment.set_inputs(id, &outputs).unwrap();
            }
        }
    }

    fn handle_timeout(&mut self, now: Instant) {
        self.segment.handle_timeout(now);
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        self.segment.poll_transmit(now, buf)
    }

    fn poll_event(&mut self) -> Option<Self::Event> {
        self.segment.poll_event()
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.segment.poll_timeout()
    }
}

pub(crate) type Cell = Pair<MainDevice, Echo>;

pub(crate) fn expected(description: &Description, bytes: usize) -> ExpectedDevice {
    let Description { vendor_id, product_code, .. } = *description;
    ExpectedDevice {
        vendor: vendor_id,
        product: product_code,
        revision: None,
        output_bytes: bytes,
        input_bytes: bytes,
    }
}

/// Returns a cable that loses nothing.
pub(crate) fn good_cable() -> Impairment {
    Impairment { delay: Duration::from_micros(20), ..Impairment::default() }
}

pub(crate) fn cell_of(devices: &[ExpectedDevice], on_cable: &[&'static Description]) -> Cell {
    cell_on(devices, on_cable, 1, good_cable())
}

pub(crate) fn cell_on(
    devices: &[ExpectedDevice],
    on_cable: &[&'static Description],
    seed: u64,
    cable: Impairment,
) -> Cell {
    connected(MainDevice::new(config(devices), Instant::ZERO).unwrap(), on_cable, seed, cable)
}

pub(crate) fn config(devices: &[ExpectedDevice]) -> Config {
    Config { mac: Mac([2, 0, 0, 0, 0, 1]), devices: devices.to_vec(), cycle: MS, watchdog: MS * 20 }
}

/// Connects any MainDevice to these devices.
pub(crate) fn connected<M: Machine>(
    main: M,
    on_cable: &[&'static Description],
    seed: u64,
    cable: Impairment,
) -> Pair<M, Echo> {
    let mut segment = Segment::new();
    for description in on_cable {
        segment.add(&DeviceConfig::new(description));
    }
    let pair = PairConfig { seed, clocks: [Clock::default(); 2], links: [cable; 2], addresses: [None; 2] };
    Pair::new(main, Echo::of(segment), pair)
}

/// Returns what the MainDevice reports within this time: device, from 0, and event.
pub(crate) fn events(cell: &mut Cell, within: Duration) -> Vec<(u16, LinkEvent)> {
    let until = cell.now() + within;
    let mut events = Vec::new();
    while let Some(event) = cell.next_event(until) {
        if let Event::A((SubDeviceId(device), event)) = event {
            events.push((device, event));
        }
    }
    events
}

/// Brings this number of devices up.
pub(crate) fn running(devices: usize) -> Cell {
    let mut cell = cell_of(&vec![expected(&DEVICE, BYTES); devices], &vec![&DEVICE; devices]);
    let mut up = events(&mut cell, MS * 1_000);
    up.sort_unstable_by_key(|(device, _)| *device);
    let all: Vec<_> = (0..devices as u16).map(|device| (device, LinkEvent::Up)).collect();
    assert_eq!(up, all);
    cell
}

/// Writes another number to each of these devices and returns those from which it came back within some cycles.
pub(crate) fn echoing(cell: &mut Cell, devices: &[u16], number: u8) -> Vec<u16> {
    for device in devices {
        cell.command_a(|main, _| main.outputs_mut(SubDeviceId(*device)).fill(number + *device as u8));
    }
    assert_eq!(events(cell, MS * 5), []);
    let comes_back = |device: &u16| {
        let inputs = cell.a().inputs(SubDeviceId(*device));
        inputs.is_some_and(|inputs| inputs.iter().all(|byte| *byte == number + *device as u8))
    };
    devices.iter().copied().filter(comes_back).collect()
}

/// Returns the causes of the Downs by device, and fails if a device is not among `affected`.
pub(crate) fn causes(events: &[(u16, LinkEvent)], affected: &[u16]) -> BTreeMap<u16, Vec<DownCause>> {
    let mut causes = BTreeMap::<_, Vec<_>>::new();
    for (device, event) in events {
        assert!(affected.contains(device), "device {device}: {event:?}");
        if let LinkEvent::Down(down) = event {
            causes.entry(*device).or_default().push(down.cause);
        }
    }
    causes
}

pub(crate) fn explained(cell: &Cell, device: u16) -> String {
    let mut words = String::new();
    cell.a().explain(SubDeviceId(device), &mut words).unwrap();
    words
}

/// Returns the lost exchanges of a device.
pub(crate) fn lost(cell: &Cell, device: u16) -> u64 {
    cell.a().counters(SubDeviceId(device)).lost
}
