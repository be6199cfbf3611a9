//! A search lists emulated SubDevices as they are, and changes nothing.

#![expect(clippy::unwrap_used, clippy::panic, clippy::indexing_slicing, reason = "a test fails by a panic")]

use ethercat_maindevice::{Config, ETHER_TYPE, ExpectedDevice, Found, GroupMainDevice, Identity, search};
use ethercat_subdevice::description::{DataType, Description, Pdo, PdoEntry};
use ethercat_subdevice::{AlState, AlStatusCode, DeviceConfig, DeviceId, Segment};
use machine::ethernet::Mac;
use machine::{Duration, Instant, LinkEvent, Machine, Port, PortRequest, Source, Transmit};
use virtual_time::{Clock, Event, Impairment, Pair, PairConfig};

const MS: Duration = Duration::from_millis(1);

/// Four bytes of inputs, no mailbox.
static SENSOR: Description = Description {
    vendor_id: 0x0000_0F00,
    product_code: 9,
    revision: 0x0002_0001,
    order_code: "SENS-4",
    name: "A sensor of four bytes",
    group: "Test devices",
    device_type: 0,
    hardware_version: "1",
    software_version: "1",
    outputs: &[],
    inputs: &[Pdo {
        index: 0x1A00,
        name: "Inputs",
        entries: &[PdoEntry {
            index: 0x6000,
            subindex: 1,
            bits: 32,
            data_type: DataType::Unsigned32,
            name: "Value",
        }],
    }],
    mailbox: None,
    objects: &[],
    optional_outputs: &[],
    optional_inputs: &[],
    clock_modes: &[],
    numbers_names: true,
};

fn sensor(serial_number: u32, alias: u16) -> DeviceConfig {
    DeviceConfig { serial_number, alias, ..DeviceConfig::new(&SENSOR) }
}

fn over(seed: u64, cable: Impairment) -> PairConfig {
    PairConfig { seed, clocks: [Clock::default(); 2], links: [cable; 2], addresses: [None; 2] }
}

fn short_cable() -> Impairment {
    Impairment { delay: Duration::from_micros(20), ..Impairment::default() }
}

/// First the MainDevice, then a search from the same interface.
enum Master {
    Driving(Box<GroupMainDevice>),
    Searching(Box<dyn Machine<Event = Found>>),
}

impl Machine for Master {
    type Event = Option<Found>;

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        match self {
            Self::Driving(main) => main.handle_frame(now, from, frame),
            Self::Searching(search) => search.handle_frame(now, from, frame),
        }
    }

    fn handle_timeout(&mut self, now: Instant) {
        match self {
            Self::Driving(main) => main.handle_timeout(now),
            Self::Searching(search) => search.handle_timeout(now),
        }
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        match self {
            Self::Driving(main) => main.poll_transmit(now, buf),
            Self::Searching(search) => search.poll_transmit(now, buf),
        }
    }

    fn poll_event(&mut self) -> Option<Option<Found>> {
        match self {
            Self::Driving(main) => main.poll_event().map(|event| {
                assert_eq!(event, LinkEvent::Up);
                None
            }),
            Self::Searching(search) => search.poll_event().map(Some),
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        match self {
            Self::Driving(main) => main.poll_timeout(),
            Self::Searching(search) => search.poll_timeout(),
        }
    }

    fn ports(&self) -> &[PortRequest] {
        match self {
            Self::Driving(main) => main.ports(),
            Self::Searching(search) => search.ports(),
        }
    }
}

/// Sends back what comes, with the mark in its source address that a chip sets, but counts nothing.
#[derive(Default)]
struct Loopback(Option<Vec<u8>>);

impl Machine for Loopback {
    type Event = ();

    fn handle_frame(&mut self, _: Instant, _: Source, frame: &[u8]) {
        let mut frame = frame.to_vec();
        frame[6] |= 2;
        self.0 = Some(frame);
    }

    fn handle_timeout(&mut self, _: Instant) {}

    fn poll_transmit(&mut self, _: Instant, buf: &mut [u8]) -> Option<Transmit> {
        let frame = self.0.take()?;
        buf[..frame.len()].copy_from_slice(&frame);
        Some(Transmit { port: Port::Ethernet, to: None, len: frame.len() })
    }

    fn poll_event(&mut self) -> Option<()> {
        None
    }

    fn poll_timeout(&self) -> Option<Instant> {
        None
    }

    fn ports(&self) -> &[PortRequest] {
        &[PortRequest::Ethernet { ether_type: ETHER_TYPE, groups: &[] }]
    }
}

fn searching(start: Instant) -> Master {
    Master::Searching(Box::new(search(start, MS * 2_000)))
}

type Cell = Pair<Master, Segment>;

/// Lets it run until the master has an event.
fn run(cell: &mut Cell) -> Option<Found> {
    let until = cell.now() + MS * 3_000;
    loop {
        match cell.next_event(until) {
            Some(Event::A(event)) => return event,
            Some(Event::B(_)) => {}
            None => panic!("nothing ends"),
        }
    }
}

fn searched(segment: Segment, config: PairConfig) -> Found {
    run(&mut Pair::new(searching(Instant::ZERO), segment, config)).unwrap()
}

fn sensors(count: u32) -> Segment {
    let mut segment = Segment::new();
    for serial_number in 1..=count {
        segment.add(&sensor(serial_number, 0));
    }
    segment
}

#[test]
fn every_device_is_listed_in_its_place_with_what_its_eeprom_says() {
    let mut segment = Segment::new();
    segment.add(&sensor(11, 0));
    segment.add(&sensor(12, 0x0203));
    let found = searched(segment, over(1, short_cable()));
    assert!(found.frames_return && found.complete);
    let places: Vec<_> = found.devices.iter().map(|device| (device.position, device.alias)).collect();
    assert_eq!(places, [(0, 0), (1, 0x0203)]);
    for (device, serial_number) in found.devices.iter().zip([11, 12]) {
        let identity = Identity {
            vendor: SENSOR.vendor_id,
            product: SENSOR.product_code,
            revision: SENSOR.revision,
            serial_number,
            order_code: SENSOR.order_code.into(),
            name: SENSOR.name.into(),
        };
        assert_eq!(device.identity.as_ref(), Ok(&identity));
        assert_eq!((device.station_address, device.status, device.status_code), (0, 1, 0), "after power-on");
    }
}

#[test]
fn a_search_leaves_devices_in_op_as_they_are_and_tells_their_addresses_and_errors() {
    let expected = ExpectedDevice {
        vendor: SENSOR.vendor_id,
        product: SENSOR.product_code,
        revision: None,
        output_bytes: 0,
        input_bytes: 4,
    };
    let config =
        Config { mac: Mac([2, 0, 0, 0, 0, 1]), devices: vec![expected; 2], cycle: MS, watchdog: MS * 20 };
    let main = Master::Driving(Box::new(GroupMainDevice::new(config, Instant::ZERO)));
    let mut cell = Pair::new(main, sensors(2), over(1, short_cable()));
    assert_eq!(run(&mut cell), None);
    cell.command_a(|master, now| *master = searching(now + MS));
    let found = run(&mut cell).unwrap();
    let states: Vec<_> = found.devices.iter().map(|device| (device.station_address, device.status)).collect();
    assert_eq!(states, [(0x1000, 8), (0x1001, 8)]);
    assert_eq!(cell.b().state(DeviceId(1)), Some((AlState::Op, AlStatusCode::NO_ERROR)));

    cell.command_b(|segment, _| segment.fail(DeviceId(1), AlStatusCode::WATCHDOG));
    cell.command_a(|master, now| *master = searching(now + MS));
    let found = run(&mut cell).unwrap();
    let last = found.devices.last().unwrap();
    assert_eq!((last.status, last.status_code), (0x14, AlStatusCode::WATCHDOG.0), "SAFE-OP with an error");
    let mut words = String::new();
    last.write_state(&mut words).unwrap();
    assert_eq!(words, "SAFE-OP, AL status code 0x001b: Sync manager watchdog");
}

#[test]
fn a_cable_without_devices_is_told_from_one_from_which_no_frame_comes_back() {
    let mut cell = Pair::new(searching(Instant::ZERO), sensors(1), over(1, short_cable()));
    cell.set_cut(true);
    assert_eq!(run(&mut cell), Some(Found::default()));

    let mut cell = Pair::new(searching(Instant::ZERO), Loopback::default(), over(1, short_cable()));
    let nobody = loop {
        if let Some(Event::A(found)) = cell.next_event(Instant::ZERO + MS * 3_000) {
            break found.unwrap();
        }
    };
    assert_eq!(nobody, Found { frames_return: true, complete: true, ..Found::default() });
}

#[test]
fn lost_frames_and_slow_eeproms_change_nothing() {
    let mut segment = Segment::new();
    for serial_number in 1..=3 {
        segment.add(&DeviceConfig { eeprom_delay: MS, ..sensor(serial_number, 0) });
    }
    let perfect = searched(segment, over(1, short_cable()));
    assert_eq!(perfect.devices.len(), 3);
    for seed in 1..=20 {
        let found = searched(sensors(3), over(seed, Impairment { loss_ppm: 20_000, ..short_cable() }));
        assert_eq!(found, perfect, "seed {seed}");
    }
}

#[test]
fn a_device_whose_eeprom_is_erased_is_listed_with_nothing_in_it() {
    let mut segment = sensors(2);
    segment.eeprom_mut(DeviceId(0)).unwrap().fill(0xFF);
    let found = searched(segment, over(1, short_cable()));
    let [erased, whole] = &found.devices[..] else { panic!("{found:?}") };
    let erased = erased.identity.as_ref().unwrap();
    assert_eq!((erased.vendor, erased.order_code.len(), erased.name.len()), (u32::MAX, 0, 0));
    assert!(whole.identity.is_ok());
}

/// As a new board has it: what is not the chip's own configuration may be whole.
#[test]
fn a_device_that_could_not_load_its_configuration_is_listed_with_the_rest_of_its_eeprom() {
    let mut segment = sensors(2);
    segment.eeprom_mut(DeviceId(0)).unwrap()[14] ^= 0xFF;
    for powered in [false, true] {
        segment.set_power(Instant::ZERO, DeviceId(0), powered);
    }
    let found = searched(segment, over(1, short_cable()));
    let names: Vec<_> =
        found.devices.iter().map(|device| device.identity.as_ref().unwrap().order_code.clone()).collect();
    assert_eq!(names, [b"SENS-4", b"SENS-4"]);
}

#[test]
fn an_error_that_another_maindevice_left_behind_is_cleared() {
    let mut segment = sensors(1);
    let mut frame = vec![0xFF; 12];
    frame.extend(ETHER_TYPE.to_be_bytes());
    // APWR of a command that does not exist to 0x0502.
    frame.extend([14, 0x10, 2, 0, 0, 0, 0x02, 0x05, 2, 0, 0, 0, 0, 7, 0, 0]);
    frame.resize(60, 0);
    segment.handle_frame(Instant::ZERO, Source { port: Port::Ethernet, peer: None }, &frame);
    assert!(segment.poll_transmit(Instant::ZERO, &mut [0; 60]).is_some());
    let found = searched(segment, over(1, short_cable()));
    assert_eq!(found.devices[0].identity.as_ref().unwrap().vendor, SENSOR.vendor_id);
}

#[test]
fn strings_that_lead_out_of_their_category_are_left_out() {
    let mut segment = sensors(1);
    let eeprom = segment.eeprom_mut(DeviceId(0)).unwrap();
    // The first category is the strings: type, length, count, then each with its length.
    eeprom[0x80 + 5] = 0xFF;
    let found = searched(segment, over(1, short_cable()));
    let identity = found.devices[0].identity.as_ref().unwrap();
    assert_eq!((identity.vendor, identity.order_code.len()), (SENSOR.vendor_id, 0));
}
