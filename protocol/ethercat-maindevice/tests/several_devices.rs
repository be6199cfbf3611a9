//! A MainDevice drives several devices on one cable, in virtual time: what happens to one does not disturb the others.

#![expect(clippy::unwrap_used, reason = "a test fails by a panic")]

use std::collections::BTreeMap;

use ethercat_maindevice::{Config, ExpectedDevice, MainDevice, SubDeviceId};
use ethercat_subdevice::description::{DataType, Description, Mailbox, Pdo, PdoEntry};
use ethercat_subdevice::{AlState, AlStatusCode, DeviceConfig, DeviceId, Segment};
use machine::ethernet::Mac;
use machine::{DownCause, Duration, Instant, LinkEvent, Machine, PortRequest, Source, Transmit};
use virtual_time::{Clock, Event, Impairment, Pair, PairConfig};

const MS: Duration = Duration::from_millis(1);
const BYTES: usize = 8;

const fn numbers(index: u16) -> PdoEntry {
    PdoEntry { index, subindex: 1, bits: 64, data_type: DataType::Unsigned64, name: "Number" }
}

/// Eight bytes each way, with a mailbox.
static DEVICE: Description = Description {
    vendor_id: 0x0000_0F00,
    product_code: 7,
    revision: 3,
    order_code: "ECHO",
    name: "Eight bytes each way",
    device_type: 0,
    hardware_version: "1",
    software_version: "1",
    outputs: &[Pdo { index: 0x1600, name: "Outputs", entries: &[numbers(0x7000)] }],
    inputs: &[Pdo { index: 0x1A00, name: "Inputs", entries: &[numbers(0x6000)] }],
    mailbox: Some(Mailbox { len: 128, file_capacity: 0 }),
    objects: &[],
    distributed_clocks: false,
};

/// The same with another product code.
static OTHER: Description = Description { product_code: 8, order_code: "OTHER", ..DEVICE };

/// 256 bytes each way.
static LARGE: Description = Description {
    product_code: 9,
    outputs: &[Pdo { index: 0x1600, name: "Outputs", entries: &[numbers(0x7000); 32] }],
    inputs: &[Pdo { index: 0x1A00, name: "Inputs", entries: &[numbers(0x6000); 32] }],
    mailbox: None,
    ..DEVICE
};

/// Devices that send their outputs back.
struct Echo {
    segment: Segment,
    /// Frames that came.
    frames: u64,
    longest: usize,
}

impl Machine for Echo {
    type Event = (DeviceId, ethercat_subdevice::Event);

    fn ports(&self) -> &[PortRequest] {
        self.segment.ports()
    }

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        self.frames += 1;
        self.longest = self.longest.max(frame.len());
        self.segment.handle_frame(now, from, frame);
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

type Cell = Pair<MainDevice, Echo>;

fn expected(description: &Description, bytes: usize) -> ExpectedDevice {
    let Description { vendor_id, product_code, .. } = *description;
    ExpectedDevice {
        vendor: vendor_id,
        product: product_code,
        revision: None,
        output_bytes: bytes,
        input_bytes: bytes,
    }
}

fn cell_of(devices: &[ExpectedDevice], on_cable: &[&'static Description]) -> Cell {
    let mut segment = Segment::new();
    for description in on_cable {
        segment.add(&DeviceConfig::new(description));
    }
    let config =
        Config { mac: Mac([2, 0, 0, 0, 0, 1]), devices: devices.to_vec(), cycle: MS, watchdog: MS * 20 };
    let cable = Impairment { delay: Duration::from_micros(20), ..Impairment::default() };
    let pair = PairConfig { seed: 1, clocks: [Clock::default(); 2], links: [cable; 2], addresses: [None; 2] };
    let main = MainDevice::new(config, Instant::ZERO).unwrap();
    Pair::new(main, Echo { segment, frames: 0, longest: 0 }, pair)
}

/// Returns what the MainDevice reports within this time: device, from 0, and event.
fn events(cell: &mut Cell, within: Duration) -> Vec<(u16, LinkEvent)> {
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
fn running(devices: usize) -> Cell {
    let mut cell = cell_of(&vec![expected(&DEVICE, BYTES); devices], &vec![&DEVICE; devices]);
    let mut up = events(&mut cell, MS * 1_000);
    up.sort_unstable_by_key(|(device, _)| *device);
    let all: Vec<_> = (0..devices as u16).map(|device| (device, LinkEvent::Up)).collect();
    assert_eq!(up, all);
    cell
}

/// Writes another number to each of these devices and returns those from which it came back within some cycles.
fn echoing(cell: &mut Cell, devices: &[u16], number: u8) -> Vec<u16> {
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
fn causes(events: &[(u16, LinkEvent)], affected: &[u16]) -> BTreeMap<u16, Vec<DownCause>> {
    let mut causes = BTreeMap::<_, Vec<_>>::new();
    for (device, event) in events {
        assert!(affected.contains(device), "device {device}: {event:?}");
        if let LinkEvent::Down(down) = event {
            causes.entry(*device).or_default().push(down.cause);
        }
    }
    causes
}

fn explained(cell: &Cell, device: u16) -> String {
    let mut words = String::new();
    cell.a().explain(SubDeviceId(device), &mut words).unwrap();
    words
}

/// Returns the lost exchanges of a device.
fn lost(cell: &Cell, device: u16) -> u64 {
    cell.a().counters(SubDeviceId(device)).lost
}

#[test]
fn each_device_has_its_own_data_and_all_share_one_frame_a_cycle() {
    for devices in [2, 5] {
        let mut cell = running(devices);
        let all: Vec<_> = (0..devices as u16).collect();
        assert_eq!(echoing(&mut cell, &all, 10), all);
        let before = (cell.b().frames, cell.a().counters(SubDeviceId(0)).received);
        assert_eq!(events(&mut cell, MS * 1_000), []);
        let received = cell.a().counters(SubDeviceId(0)).received - before.1;
        assert_eq!((cell.b().frames - before.0, received), (1_000, 1_000));
    }
}

#[test]
fn a_cut_between_two_devices_takes_down_only_those_after_it_and_mended_they_come_back() {
    let mut cell = running(5);
    cell.command_b(|echo, _| echo.segment.set_cut(DeviceId(2), true));
    let down = causes(&events(&mut cell, MS * 3_000), &[2, 3, 4]);
    assert_eq!(down, (2..5).map(|device| (device, vec![DownCause::Watchdog])).collect());
    assert_eq!(echoing(&mut cell, &[0, 1], 20), [0, 1]);
    assert_eq!([0, 1].map(|device| lost(&cell, device)), [0, 0]);
    cell.command_b(|echo, _| echo.segment.set_cut(DeviceId(2), false));
    let up = events(&mut cell, MS * 1_000);
    assert!(causes(&up, &[2, 3, 4]).is_empty() && up.len() == 3, "{up:?}");
    assert_eq!(echoing(&mut cell, &[0, 1, 2, 3, 4], 30), [0, 1, 2, 3, 4]);
    assert_eq!([0, 1].map(|device| lost(&cell, device)), [0, 0], "the others did not miss an exchange");
}

#[test]
fn a_device_that_leaves_op_is_named_and_helped_while_the_others_exchange() {
    let mut cell = running(5);
    cell.command_b(|echo, _| echo.segment.fail(DeviceId(1), AlStatusCode(0x0018)));
    let events = events(&mut cell, MS * 50);
    assert_eq!(causes(&events, &[1]), [(1, vec![DownCause::ClosedByPeer])].into());
    assert_eq!(events.last(), Some(&(1, LinkEvent::Up)), "device 2 comes back");
    assert_eq!([0, 2, 3, 4].map(|device| lost(&cell, device)), [0; 4]);
    assert_eq!(echoing(&mut cell, &[0, 1, 2, 3, 4], 40), [0, 1, 2, 3, 4]);
}

#[test]
fn a_device_missing_from_the_start_is_named_and_found_later_while_the_others_run() {
    let mut cell = cell_of(&[expected(&DEVICE, BYTES); 3], &[&DEVICE; 3]);
    cell.command_b(|echo, _| echo.segment.set_cut(DeviceId(2), true));
    let start = events(&mut cell, MS * 2_000);
    assert_eq!(causes(&start, &[0, 1, 2]), [(2, vec![DownCause::NoAnswer])].into());
    assert_eq!(
        explained(&cell, 2),
        "device 3 is missing: check its power and the cable between devices 2 and 3"
    );
    assert_eq!(echoing(&mut cell, &[0, 1, 2], 50), [0, 1]);
    cell.command_b(|echo, _| echo.segment.set_cut(DeviceId(2), false));
    assert_eq!(events(&mut cell, MS * 1_000), [(2, LinkEvent::Up)]);
    assert_eq!(echoing(&mut cell, &[0, 1, 2], 60), [0, 1, 2]);
    assert_eq!([0, 1].map(|device| lost(&cell, device)), [0, 0]);
}

#[test]
fn another_product_in_the_middle_of_the_cable_is_named_and_the_others_run() {
    let mut cell = cell_of(&[expected(&DEVICE, BYTES); 3], &[&DEVICE, &OTHER, &DEVICE]);
    let start = events(&mut cell, MS * 2_000);
    assert_eq!(causes(&start, &[0, 1, 2]), [(1, vec![DownCause::Refused])].into());
    assert_eq!(
        explained(&cell, 1),
        "device 2 is another one: expected vendor 0x00000F00, product 0x00000007; found `OTHER` (vendor 0x00000F00, \
         product 0x00000008, revision 0x00000003)"
    );
    assert_eq!(echoing(&mut cell, &[0, 1, 2], 70), [0, 2]);
}

#[test]
fn a_device_that_is_replaced_while_it_is_off_is_named_and_the_right_one_is_taken() {
    let mut cell = running(3);
    let product = |cell: &mut Cell, code: u8| {
        cell.command_b(|echo, now| {
            echo.segment.set_power(now, DeviceId(2), false);
            let eeprom = echo.segment.eeprom_mut(DeviceId(2)).unwrap();
            // Product code, ETG.1000.6.
            eeprom[0x14] = code;
            echo.segment.set_power(now, DeviceId(2), true);
        });
    };
    product(&mut cell, 8);
    let replaced = causes(&events(&mut cell, MS * 3_000), &[2]);
    assert_eq!(replaced[&2].last(), Some(&DownCause::Refused));
    assert!(explained(&cell, 2).starts_with("device 3 is another one"), "{}", explained(&cell, 2));
    product(&mut cell, 7);
    assert_eq!(events(&mut cell, MS * 1_000), [(2, LinkEvent::Up)]);
    assert_eq!(echoing(&mut cell, &[0, 1, 2], 80), [0, 1, 2]);
    assert_eq!([0, 1].map(|device| lost(&cell, device)), [0, 0]);
}

#[test]
fn a_device_without_power_in_the_middle_cuts_off_those_after_it_and_all_come_back() {
    let mut cell = running(3);
    cell.command_b(|echo, now| echo.segment.set_power(now, DeviceId(1), false));
    assert_eq!(
        causes(&events(&mut cell, MS * 2_000), &[1, 2]),
        [(1, vec![DownCause::Watchdog]), (2, vec![DownCause::Watchdog])].into()
    );
    assert_eq!(echoing(&mut cell, &[0, 1, 2], 90), [0]);
    cell.command_b(|echo, now| echo.segment.set_power(now, DeviceId(1), true));
    assert_eq!(events(&mut cell, MS * 1_000).len(), 2);
    assert_eq!(echoing(&mut cell, &[0, 1, 2], 100), [0, 1, 2]);
    assert_eq!(lost(&cell, 0), 0);
}

#[test]
fn a_device_that_flaps_again_and_again_costs_the_others_no_exchange() {
    let mut cell = running(4);
    for round in 0..40_u64 {
        let cut = round % 2 == 0;
        cell.command_b(|echo, _| echo.segment.set_cut(DeviceId(3), cut));
        causes(&events(&mut cell, MS * (7 + 13 * (round as u32 % 11))), &[3]);
        assert_eq!([0, 1, 2].map(|device| lost(&cell, device)), [0; 3], "round {round}");
    }
    events(&mut cell, MS * 2_000);
    assert_eq!(echoing(&mut cell, &[0, 1, 2, 3], 110), [0, 1, 2, 3]);
}

#[test]
fn a_device_is_disconnected_alone() {
    let mut cell = running(3);
    cell.command_a(|main, now| main.disconnect(now, SubDeviceId(1)));
    let closed = events(&mut cell, MS * 1_000);
    assert_eq!(causes(&closed, &[1]), [(1, vec![DownCause::ClosedHere])].into());
    let states = [0, 1, 2].map(|id| cell.b().segment.state(DeviceId(id)).unwrap().0);
    assert_eq!(states, [AlState::Op, AlState::Init, AlState::Op]);
    assert_eq!(echoing(&mut cell, &[0, 1, 2], 120), [0, 2]);
}

#[test]
fn a_cable_that_is_cut_at_the_main_device_takes_all_down_and_all_come_back() {
    let mut cell = running(3);
    cell.set_cut(true);
    let all = [0, 1, 2];
    let down = causes(&events(&mut cell, MS * 3_000), &all);
    assert_eq!(down, all.map(|device| (device, vec![DownCause::Watchdog])).into());
    cell.set_cut(false);
    assert_eq!(events(&mut cell, MS * 2_000).len(), 3);
    assert_eq!(echoing(&mut cell, &all, 130), all);
}

#[test]
fn process_data_of_64_devices_of_256_bytes_each_way_are_spread_over_frames() {
    let devices = 64;
    let mut cell = cell_of(&vec![expected(&LARGE, 256); devices], &vec![&LARGE; devices]);
    assert_eq!(events(&mut cell, MS * 3_000).len(), devices);
    let all: Vec<_> = (0..devices as u16).collect();
    assert_eq!(echoing(&mut cell, &all, 140), all);
    let before = cell.b().frames;
    assert_eq!(events(&mut cell, MS * 100), []);
    assert_eq!(cell.b().frames - before, 100 * 32, "two devices a frame");
    assert!(cell.b().longest <= 1514);
    assert!(all.iter().all(|device| lost(&cell, *device) == 0));
}
