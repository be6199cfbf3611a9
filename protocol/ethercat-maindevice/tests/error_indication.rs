//! Devices that indicate an error in OP: one that refuses a stranger's request as the standard has it, and others that stay in OP.

#![expect(clippy::unwrap_used, reason = "a test fails by a panic")]

use ethercat_maindevice::{Config, ExpectedDevice, MainDevice, SubDeviceId};
use ethercat_subdevice::description::{DataType, Description, Mailbox, Pdo, PdoEntry};
use ethercat_subdevice::{AlState, AlStatusCode, DeviceConfig, DeviceId, Segment};
use machine::ethernet::Mac;
use machine::{Down, DownCause, Duration, Instant, LinkEvent, Machine, Port, PortRequest, Source, Transmit};
use virtual_time::{Clock, Event, Impairment, Pair, PairConfig};

const MS: Duration = Duration::from_millis(1);

const NUMBER: PdoEntry =
    PdoEntry { index: 0x7000, subindex: 1, bits: 64, data_type: DataType::Unsigned64, name: "Number" };

/// Eight bytes each way.
static DEVICE: Description = Description {
    vendor_id: 0x0000_0F00,
    product_code: 7,
    revision: 3,
    order_code: "DEVICE",
    name: "Eight bytes each way",
    group: "Test devices",
    device_type: 0,
    hardware_version: "1",
    software_version: "1",
    outputs: &[Pdo { index: 0x1600, name: "Outputs", entries: &[NUMBER] }],
    inputs: &[Pdo { index: 0x1A00, name: "Inputs", entries: &[PdoEntry { index: 0x6000, ..NUMBER }] }],
    mailbox: Some(Mailbox { len: 128, file_capacity: 0 }),
    objects: &[],
    optional_outputs: &[],
    optional_inputs: &[],
    clock_modes: &[],
    numbers_names: true,
};

/// FPWR and FPRD, AL control and AL status.
const FPWR: u8 = 5;
const FPRD: u8 = 4;
const AL_CONTROL: u16 = 0x0120;
const AL_STATUS: u16 = 0x0130;

/// Devices of which one, by its station address, may indicate an error without leaving its state.
struct Devices {
    segment: Segment,
    /// Station address, and AL status code.
    error: Option<(u16, u16)>,
    /// Set if an acknowledgement ends the error.
    ends: bool,
    acknowledgements: u32,
}

/// Calls `visit` with command, station address, register and data of each datagram of a frame.
fn each_datagram(frame: &mut [u8], mut visit: impl FnMut(u8, u16, u16, &mut [u8])) {
    let mut at = 16;
    while at + 10 <= frame.len() {
        let u16_at = |place: usize| u16::from_le_bytes([frame[place], frame[place + 1]]);
        let (command, station, register, len) = (frame[at], u16_at(at + 2), u16_at(at + 4), u16_at(at + 6));
        let end = at + 10 + usize::from(len & 0x07FF);
        visit(command, station, register, &mut frame[at + 10..end]);
        if len & 0x8000 == 0 {
            break;
        }
        at = end + 2;
    }
}

impl Machine for Devices {
    type Event = (DeviceId, ethercat_subdevice::Event);

    fn ports(&self) -> &[PortRequest] {
        self.segment.ports()
    }

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        each_datagram(&mut frame.to_vec(), |command, station, register, data| {
            let is_meant = self.error.is_some_and(|(wrong, _)| wrong == station);
            if command == FPWR && register == AL_CONTROL && is_meant && data[0] == 0x18 {
                self.acknowledgements += 1;
                self.error = self.error.filter(|_| !self.ends);
            }
        });
        self.segment.handle_frame(now, from, frame);
    }

    fn handle_timeout(&mut self, now: Instant) {
        self.segment.handle_timeout(now);
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        let transmit = self.segment.poll_transmit(now, buf)?;
        each_datagram(&mut buf[..transmit.len], |command, station, register, data| {
            if let Some((wrong, code)) = self.error
                && (command, station, register) == (FPRD, wrong, AL_STATUS)
            {
                data[0] |= 0x10;
                if let Some(place) = data.get_mut(4..6) {
                    place.copy_from_slice(&code.to_le_bytes());
                }
            }
        });
        Some(transmit)
    }

    fn poll_event(&mut self) -> Option<Self::Event> {
        self.segment.poll_event()
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.segment.poll_timeout()
    }
}

type Cell = Pair<MainDevice, Devices>;

/// Brings so many devices up.
fn running(count: usize) -> Cell {
    let expected =
        ExpectedDevice { vendor: 0x0000_0F00, product: 7, revision: None, output_bytes: 8, input_bytes: 8 };
    let config =
        Config { mac: Mac([2, 0, 0, 0, 0, 1]), devices: vec![expected; count], cycle: MS, watchdog: MS * 20 };
    let mut segment = Segment::new();
    for _ in 0..count {
        segment.add(&DeviceConfig::new(&DEVICE));
    }
    let cable = Impairment { delay: Duration::from_micros(20), ..Impairment::default() };
    let pair = PairConfig { seed: 3, clocks: [Clock::default(); 2], links: [cable; 2], addresses: [None; 2] };
    let devices = Devices { segment, error: None, ends: true, acknowledgements: 0 };
    let mut cell = Pair::new(MainDevice::new(config, Instant::ZERO).unwrap(), devices, pair);
    for _ in 0..count {
        assert_eq!(event(&mut cell, MS * 1_000).unwrap().1, LinkEvent::Up);
    }
    cell
}

fn event(cell: &mut Cell, within: Duration) -> Option<(SubDeviceId, LinkEvent)> {
    let until = cell.now() + within;
    while let Some(event) = cell.next_event(until) {
        if let Event::A(event) = event {
            return Some(event);
        }
    }
    None
}

/// Expects that a device is reported, and returns the reason in words.
fn reason(cell: &mut Cell, within: Duration, id: SubDeviceId, expected: DownCause, code: u32) -> String {
    let Some((device, LinkEvent::Down(Down { cause, code: found, .. }))) = event(cell, within) else {
        unreachable!("no device is reported")
    };
    assert_eq!((device, cause, found), (id, expected, code));
    let mut words = String::new();
    cell.a().explain(id, &mut words).unwrap();
    words
}

#[test]
fn a_device_that_refuses_a_strangers_request_stops_its_outputs_is_reported_and_brought_to_op_again() {
    for (count, number, request, code) in
        [(1, 1, 0, "0x0012"), (1, 1, 3, "0x0011"), (3, 2, 5, "0x0012"), (3, 3, 3, "0x0011")]
    {
        let mut cell = running(count);
        let id = SubDeviceId(number - 1);
        cell.command_b(|devices, now| {
            let station = (0x0FFF + number).to_le_bytes();
            let mut frame = [&[0xFF; 6][..], &[0x00, 0x0E, 0x8C, 0, 0, 1, 0x88, 0xA4, 14, 0x10]].concat();
            frame.extend([FPWR, 0, station[0], station[1], 0x20, 0x01, 2, 0, 0, 0, request, 0, 0, 0]);
            frame.resize(60, 0);
            devices.segment.handle_frame(now, Source { port: Port::Ethernet, peer: None }, &frame);
            assert_eq!(devices.segment.state(DeviceId(usize::from(id.0))).unwrap().0, AlState::SafeOp);
            assert_eq!(devices.segment.outputs(DeviceId(usize::from(id.0))), None);
        });
        let code_number = u32::from_str_radix(&code[2..], 16).expect("a number");
        let words = reason(&mut cell, MS * 5, id, DownCause::ClosedByPeer, code_number);
        let start = format!("device {number} left OP: it is in SAFE-OP, AL status code {code}: ");
        assert!(words.starts_with(&start), "{words}");
        assert_eq!(event(&mut cell, MS * 50), Some((id, LinkEvent::Up)), "request {request}");
        assert!(cell.b().segment.outputs(DeviceId(usize::from(id.0))).is_some());
    }
}

#[test]
fn a_device_that_indicates_an_error_but_stays_in_op_is_reported_and_acknowledged() {
    for (count, number) in [(1, 1), (3, 1), (3, 3)] {
        let mut cell = running(count);
        let id = SubDeviceId(number - 1);
        cell.command_b(|devices, _| devices.error = Some((0x0FFF + number, AlStatusCode(0x0011).0)));
        let words = reason(&mut cell, MS * 5, id, DownCause::ClosedByPeer, 0x0011);
        assert_eq!(
            words,
            format!(
                "device {number} indicates an error in OP, AL status code 0x0011: Invalid requested state change"
            )
        );
        assert_eq!(event(&mut cell, MS * 20), Some((id, LinkEvent::Up)));
        assert_eq!(cell.b().acknowledgements, 1);
        assert_eq!(event(&mut cell, MS * 1_000), None, "the others are not disturbed");
    }
}

#[test]
fn a_device_that_keeps_its_error_in_op_is_reported_with_a_remedy() {
    let mut cell = running(1);
    cell.command_b(|devices, _| (devices.error, devices.ends) = (Some((0x1000, 0x0020)), false));
    let id = SubDeviceId(0);
    reason(&mut cell, MS * 5, id, DownCause::ClosedByPeer, 0x0020);
    let words = reason(&mut cell, MS * 10_500, id, DownCause::Refused, 0x0020);
    assert!(words.starts_with("device 1 still indicates an error in OP, AL status code 0x0020"), "{words}");
    assert!(words.ends_with(": restart the device"), "{words}");
    let asked = cell.b().acknowledgements;
    assert!((90..=101).contains(&asked), "{asked} acknowledgements in 10 s");
}
