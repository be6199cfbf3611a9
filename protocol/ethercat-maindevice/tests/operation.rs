//! The MainDevice drives emulated SubDevices in virtual time, and recovers from what happens to them.

#![expect(clippy::unwrap_used, reason = "a test fails by a panic")]

use ethercat_maindevice::{Config, ExpectedDevice, GroupMainDevice};
use ethercat_subdevice::description::{DataType, Description, Mailbox, Pdo, PdoEntry};
use ethercat_subdevice::{AlState, AlStatusCode, DeviceConfig, DeviceId, Segment};
use machine::ethernet::Mac;
use machine::{Down, DownCause, Duration, Instant, LinkEvent, Machine, PortRequest, Source, Transmit};
use virtual_time::{Clock, Event, Impairment, Pair, PairConfig, Side};

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

/// Devices that send their outputs back, and the requests for a state that came for them.
struct Echo(Segment, Vec<(u16, u8)>);

impl Machine for Echo {
    type Event = (DeviceId, ethercat_subdevice::Event);

    fn ports(&self) -> &[PortRequest] {
        self.0.ports()
    }

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        self.0.handle_frame(now, from, frame);
        // FPWR to AL control, in a frame of one datagram.
        if frame[16] == 5 && frame[20..22] == [0x20, 0x01] {
            self.1.push((u16::from_le_bytes([frame[18], frame[19]]), frame[26]));
        }
        for id in (0..self.0.len()).map(DeviceId) {
            if let Some(outputs) = self.0.outputs(id).map(<[u8]>::to_vec) {
                self.0.set_inputs(id, &outputs).unwrap();
            }
        }
    }

    fn handle_timeout(&mut self, now: Instant) {
        self.0.handle_timeout(now);
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        self.0.poll_transmit(now, buf)
    }

    fn poll_event(&mut self) -> Option<Self::Event> {
        self.0.poll_event()
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.0.poll_timeout()
    }
}

type Cell = Pair<GroupMainDevice, Echo>;

const EXPECTED: ExpectedDevice = ExpectedDevice {
    vendor: 0x0000_0F00,
    product: 7,
    revision: None,
    output_bytes: BYTES,
    input_bytes: BYTES,
};

fn config(devices: &[ExpectedDevice]) -> Config {
    Config { mac: Mac([2, 0, 0, 0, 0, 1]), devices: devices.to_vec(), cycle: MS, watchdog: MS * 20 }
}

fn cell(config: Config, devices: usize) -> Cell {
    cell_on(config, devices, 1, Impairment { delay: Duration::from_micros(20), ..Impairment::default() })
}

fn cell_on(config: Config, devices: usize, seed: u64, cable: Impairment) -> Cell {
    let mut segment = Segment::new();
    for _ in 0..devices {
        segment.add(&DeviceConfig::new(&DEVICE));
    }
    let pair = PairConfig { seed, clocks: [Clock::default(); 2], links: [cable; 2], addresses: [None; 2] };
    Pair::new(GroupMainDevice::new(config, Instant::ZERO), Echo(segment, Vec::new()), pair)
}

/// Returns the next event of the connection within this time, and when it came.
fn event(cell: &mut Cell, within: Duration) -> Option<(LinkEvent, Instant)> {
    let until = cell.now() + within;
    while let Some(event) = cell.next_event(until) {
        if let Event::A(event) = event {
            return Some((event, cell.now()));
        }
    }
    None
}

/// Brings two devices up.
fn running() -> Cell {
    let mut cell = cell(config(&[EXPECTED; 2]), 2);
    assert_eq!(event(&mut cell, MS * 1_000).unwrap().0, LinkEvent::Up);
    cell
}

fn cause(event: Option<(LinkEvent, Instant)>) -> Option<DownCause> {
    match event {
        Some((LinkEvent::Down(Down { cause, .. }), _)) => Some(cause),
        _ => None,
    }
}

/// Returns the text that explains why there is no connection.
fn refusal(config: Config, devices: usize) -> String {
    let mut cell = cell(config, devices);
    let Some((LinkEvent::Down(down), _)) = event(&mut cell, MS * 10_000) else {
        return "no event".to_owned();
    };
    let mut words = String::new();
    cell.a().explain(&mut words).unwrap();
    assert_eq!(event(&mut cell, MS * 10_000), None, "it is told once");
    if words.is_empty() { down.to_string() } else { words }
}

/// Writes a number, and returns whether it comes back within some cycles.
fn echoes(cell: &mut Cell, number: u8) -> bool {
    cell.command_a(|main, _| main.outputs_mut().fill(number));
    assert_eq!(event(cell, MS * 10), None);
    cell.a().inputs().is_some_and(|inputs| inputs == [number; 2 * BYTES])
}

#[test]
fn two_devices_come_to_op_within_200_ms_and_exchange_data() {
    let mut cell = running();
    assert!(cell.now() < Instant::from_millis(200), "{:?}", cell.now());
    assert!(echoes(&mut cell, 42) && echoes(&mut cell, 43));
    let counters = cell.a().counters();
    assert_eq!((counters.lost, counters.skipped, counters.late), (0, 0, 0));
    assert!(counters.received >= 20 && counters.sent >= counters.received, "{counters:?}");
}

#[test]
fn each_cycle_is_one_frame_a_millisecond_after_the_one_before() {
    let mut cell = running();
    let before = cell.a().counters();
    assert_eq!(event(&mut cell, MS * 1_000), None);
    assert_eq!(cell.a().counters().received - before.received, 1_000);
}

#[test]
fn a_device_that_falls_back_is_reported_with_its_code_and_brought_to_op_again() {
    let mut cell = running();
    cell.command_b(|echo, _| echo.0.fail(DeviceId(1), AlStatusCode(0x0018)));
    assert_eq!(cause(event(&mut cell, MS * 5)), Some(DownCause::ClosedByPeer));
    let mut words = String::new();
    cell.a().explain(&mut words).unwrap();
    assert_eq!(words, "device 2 left OP: it is in SAFE-OP, AL status code 0x0018: No valid inputs available");
    assert_eq!(cell.a().inputs(), None);
    assert_eq!(event(&mut cell, MS * 20).unwrap().0, LinkEvent::Up);
    assert!(echoes(&mut cell, 5));
}

#[test]
fn a_cable_that_is_cut_and_mended_needs_no_restart() {
    let mut cell = running();
    let cut_at = cell.now();
    cell.set_cut(true);
    let down = event(&mut cell, MS * 200);
    assert_eq!(cause(down), Some(DownCause::Watchdog));
    assert!(down.unwrap().1.since(cut_at) < MS * 60, "the watchdog and a frame's time");
    assert_eq!(event(&mut cell, MS * 500), None);
    cell.set_cut(false);
    assert_eq!(event(&mut cell, MS * 1_000).unwrap().0, LinkEvent::Up);
    assert!(echoes(&mut cell, 6));
}

#[test]
fn a_cut_between_two_devices_and_a_power_cycle_are_recovered_from() {
    let mut cell = running();
    cell.command_b(|echo, _| echo.0.set_cut(DeviceId(1), true));
    assert!(cause(event(&mut cell, MS * 200)).is_some());
    assert_eq!(cause(event(&mut cell, MS * 2_000)), Some(DownCause::Refused), "one device is missing");
    cell.command_b(|echo, _| echo.0.set_cut(DeviceId(1), false));
    assert_eq!(event(&mut cell, MS * 1_000).unwrap().0, LinkEvent::Up);
    for powered in [false, true] {
        cell.command_b(|echo, now| echo.0.set_power(now, DeviceId(0), powered));
    }
    assert!(cause(event(&mut cell, MS * 200)).is_some());
    assert_eq!(event(&mut cell, MS * 1_000).unwrap().0, LinkEvent::Up);
    assert!(echoes(&mut cell, 7));
}

#[test]
fn the_devices_have_the_watchdog_of_the_config() {
    let mut cell = running();
    let gone_at = cell.now();
    cell.command_a(|main, now| {
        // A MainDevice that has ended sends nothing.
        *main = GroupMainDevice::new(config(&[]), now + MS * 100_000);
    });
    let fell_at = loop {
        match cell.next_event(cell.now() + MS * 1_000).unwrap() {
            Event::B((_, ethercat_subdevice::Event::StateChanged { state, code })) => {
                assert_eq!((state, code), (AlState::SafeOp, AlStatusCode::WATCHDOG));
                break cell.now();
            }
            _ => continue,
        }
    };
    let fell_after = fell_at.since(gone_at);
    assert!(fell_after > MS * 18 && fell_after < MS * 21, "{fell_after:?}");
}

#[test]
fn on_request_the_devices_go_to_init_and_the_connection_ends() {
    let mut cell = running();
    cell.command_a(GroupMainDevice::disconnect);
    assert_eq!(cause(event(&mut cell, MS * 50)), Some(DownCause::ClosedHere));
    for id in [0, 1].map(DeviceId) {
        assert_eq!(cell.b().0.state(id).unwrap().0, AlState::Init);
    }
    assert_eq!(event(&mut cell, MS * 1_000), None);
}

#[test]
fn other_devices_than_expected_are_refused_with_what_was_found() {
    let other = ExpectedDevice { vendor: 1, revision: Some(2), ..EXPECTED };
    assert_eq!(
        refusal(config(&[other]), 1),
        "the EtherCAT cable has other devices: expected 1: vendor 0x00000001, product 0x00000007, revision 0x00000002; \
         found 1: `ECHO` (vendor 0x00000F00, product 0x00000007, revision 0x00000003)"
    );
    let echo = "`ECHO` (vendor 0x00000F00, product 0x00000007, revision 0x00000003)";
    assert_eq!(
        refusal(config(&[EXPECTED]), 2),
        format!(
            "the EtherCAT cable has other devices: expected 1: vendor 0x00000F00, product 0x00000007; found 2: {echo}, \
             then {echo}"
        )
    );
    assert_eq!(refusal(config(&[EXPECTED]), 17), "the EtherCAT cable has more than 16 devices: expected 1");
}

#[test]
fn process_data_of_another_size_are_refused_with_both_sizes() {
    let larger = ExpectedDevice { output_bytes: 256, ..EXPECTED };
    assert_eq!(
        refusal(config(&[larger]), 1),
        "device 1, `ECHO` (vendor 0x00000F00, product 0x00000007, revision 0x00000003), has 8 bytes of outputs and 8 of \
         inputs; expected 256 and 8"
    );
}

#[test]
fn silence_is_reported_after_a_second_and_once() {
    assert_eq!(
        refusal(config(&[EXPECTED]), 0),
        "no answer from the peer: no EtherCAT frame comes back; is the cable plugged in, and is the device on?"
    );
}

#[test]
fn with_one_frame_in_fifty_lost_the_devices_come_to_op_and_each_loss_is_counted() {
    for seed in 1..=20 {
        let mut cell = cell_on(
            config(&[EXPECTED; 2]),
            2,
            seed,
            Impairment { loss_ppm: 10_000, delay: Duration::from_micros(20), ..Impairment::default() },
        );
        // A device does not repeat a lost answer of its mailbox: then the MainDevice starts over.
        while event(&mut cell, MS * 10_000).unwrap().0 != LinkEvent::Up {}
        let (from, before) = (cell.now(), cell.a().counters());
        while cell.now() < from + MS * 5_000 {
            // Three losses in a row are as long as the watchdog.
            event(&mut cell, MS * 5_000);
        }
        let counters = cell.a().counters().since(&before);
        assert!(counters.lost > 10 && counters.received > 1_000, "seed {seed}: {counters:?}");
        assert_eq!(counters.skipped, 0, "no host holds this MainDevice up");
    }
}

#[test]
fn a_damaged_eeprom_on_which_ethercrab_panics_is_reported_and_a_mended_one_is_found() {
    const FIRST_CATEGORY_LEN: usize = 0x82;
    let mut cell = cell(config(&[EXPECTED]), 1);
    let mut lengths = [0xFF; 2];
    let exchange = |cell: &mut Cell, lengths: &mut [u8; 2]| {
        cell.command_b(|echo, _| {
            let eeprom = echo.0.eeprom_mut(DeviceId(0)).unwrap();
            eeprom[FIRST_CATEGORY_LEN..FIRST_CATEGORY_LEN + 2].swap_with_slice(lengths);
        });
    };
    exchange(&mut cell, &mut lengths);
    let Some((LinkEvent::Down(down), _)) = event(&mut cell, MS * 2_000) else { panic!("no event") };
    assert!(down.text.contains("is its EEPROM damaged"), "{down}");
    exchange(&mut cell, &mut lengths);
    assert_eq!(event(&mut cell, MS * 2_000).unwrap().0, LinkEvent::Up);
    assert!(echoes_one(&mut cell));
}

/// Connects while one bit flips in every hundredth frame where no checksum protects it, and then on a good cable. Returns
/// whether data were exchanged at last.
fn connect_with_flipped_bits(seed: u64) -> bool {
    let good = Impairment { delay: Duration::from_micros(20), ..Impairment::default() };
    let cable = Impairment { corrupt_ppm: 10_000, ..good };
    let mut cell = cell_on(config(&[EXPECTED]), 1, seed, cable);
    for _ in 0..20 {
        if let Some((LinkEvent::Up, _)) = event(&mut cell, MS * 200) {
            break;
        }
    }
    for side in [Side::A, Side::B] {
        cell.set_impairment(side, good);
    }
    while event(&mut cell, MS * 10_000).is_some() {}
    echoes_one(&mut cell)
}

#[test]
fn flipped_bits_while_it_connects_do_not_keep_it_from_connecting_afterwards() {
    let failed: Vec<_> = (0..100).filter(|seed| !connect_with_flipped_bits(*seed)).collect();
    assert_eq!(failed, []);
}

fn echoes_one(cell: &mut Cell) -> bool {
    cell.command_a(|main, _| main.outputs_mut().fill(9));
    assert_eq!(event(cell, MS * 10), None);
    cell.a().inputs() == Some(&[9; BYTES])
}

/// Requests for a state that came for the device with this number since the last call.
fn requests(cell: &mut Cell, number: u16) -> Vec<u8> {
    let all = cell.command_b(|echo, _| std::mem::take(&mut echo.1));
    all.iter().filter(|(station, _)| *station == 0x0FFF + number).map(|(_, request)| *request).collect()
}

/// Changes the answer delay of a device as soon as it is in SAFE-OP.
fn slow_from_safe_op_on(cell: &mut Cell, id: DeviceId, delay: Duration) {
    loop {
        if let Event::B((device, ethercat_subdevice::Event::StateChanged { state: AlState::SafeOp, .. })) =
            cell.next_event(cell.now() + MS * 1_000).unwrap()
            && device == id
        {
            return cell.command_b(|echo, _| echo.0.set_answer_delay(id, delay));
        }
    }
}

#[test]
fn a_device_on_its_way_to_op_is_not_asked_again_in_each_cycle() {
    let mut cell = cell(config(&[EXPECTED; 2]), 2);
    slow_from_safe_op_on(&mut cell, DeviceId(1), MS * 500);
    assert_eq!(event(&mut cell, MS * 1_000).unwrap().0, LinkEvent::Up);
    assert_eq!(requests(&mut cell, 2).iter().filter(|request| **request == 8).count(), 1);
    cell.command_b(|echo, _| echo.0.fail(DeviceId(1), AlStatusCode(0x0018)));
    assert_eq!(cause(event(&mut cell, MS * 5)), Some(DownCause::ClosedByPeer));
    assert_eq!(event(&mut cell, MS * 2_000).unwrap().0, LinkEvent::Up);
    let asked = requests(&mut cell, 2);
    assert_eq!(asked.iter().filter(|request| **request == 8).count(), 1, "{asked:?}");
    assert!(asked.len() < 8, "{asked:?}");
}

#[test]
fn a_device_may_take_9_s_to_op() {
    let mut cell = cell(config(&[EXPECTED; 2]), 2);
    slow_from_safe_op_on(&mut cell, DeviceId(0), MS * 9_000);
    assert_eq!(event(&mut cell, MS * 9_500).unwrap().0, LinkEvent::Up);
    assert!(cell.now() > Instant::from_millis(9_000));
}

#[test]
fn a_device_that_hangs_in_safe_op_is_reported_as_such_and_not_as_silence() {
    let mut cell = cell(config(&[EXPECTED; 2]), 2);
    slow_from_safe_op_on(&mut cell, DeviceId(1), MS * 100_000);
    assert_eq!(cause(event(&mut cell, MS * 11_000)), Some(DownCause::Refused));
    let mut words = String::new();
    cell.a().explain(&mut words).unwrap();
    assert_eq!(words, "device 2 does not come to OP: it is in SAFE-OP");
}

#[test]
fn a_device_that_falls_is_helped_while_another_one_does_not_come_back() {
    let mut cell = running();
    cell.command_b(|echo, _| {
        echo.0.set_answer_delay(DeviceId(0), MS * 3_000);
        for id in [0, 1].map(DeviceId) {
            echo.0.fail(id, AlStatusCode(0x0018));
        }
    });
    assert_eq!(cause(event(&mut cell, MS * 5)), Some(DownCause::ClosedByPeer));
    assert_eq!(event(&mut cell, MS * 100), None);
    let states = [0, 1].map(|id| cell.b().0.state(DeviceId(id)).unwrap().0);
    assert_eq!(states, [AlState::SafeOp, AlState::Op]);
    assert_eq!(event(&mut cell, MS * 7_000).unwrap().0, LinkEvent::Up);
}

/// Changes a byte in the EEPROM of the second device, at the first place of `pattern`.
fn spoil_eeprom(cell: &mut Cell, pattern: &[u8]) {
    cell.command_b(|echo, _| {
        let eeprom = echo.0.eeprom_mut(DeviceId(1)).unwrap();
        let at = eeprom.windows(pattern.len()).position(|bytes| bytes == pattern).unwrap();
        eeprom[at] ^= 0x40;
    });
}

/// The start of the inputs' sync manager with its length, as the EEPROM has them.
fn inputs_in_eeprom() -> Vec<u8> {
    let unit = ethercat_subdevice::sync_managers(&DEVICE)[3];
    [unit.start.to_le_bytes(), unit.len.to_le_bytes()].concat()
}

#[test]
fn a_device_that_refuses_safe_op_is_reported_at_once_with_its_code() {
    let mut cell = cell(config(&[EXPECTED; 2]), 2);
    spoil_eeprom(&mut cell, &inputs_in_eeprom());
    let Some((LinkEvent::Down(down), at)) = event(&mut cell, MS * 1_000) else { panic!("no event") };
    assert_eq!((down.cause, down.code), (DownCause::Refused, 0x001E));
    assert!(at < Instant::from_millis(500), "{at:?}");
    let mut words = String::new();
    cell.a().explain(&mut words).unwrap();
    assert_eq!(
        words,
        "device 2 does not come to OP: it is in PRE-OP, AL status code 0x001e: Invalid Input Configuration"
    );
    assert_eq!(event(&mut cell, MS * 10_000), None, "it is told once");
}

#[test]
fn a_refusal_is_reported_also_after_a_cut_cable_was() {
    let mut cell = running();
    cell.set_cut(true);
    spoil_eeprom(&mut cell, &inputs_in_eeprom());
    assert_eq!(cause(event(&mut cell, MS * 200)), Some(DownCause::Watchdog));
    assert_eq!(event(&mut cell, MS * 3_000), None);
    cell.set_cut(false);
    let Some((LinkEvent::Down(down), _)) = event(&mut cell, MS * 1_000) else { panic!("no event") };
    assert_eq!((down.cause, down.code), (DownCause::Refused, 0x001E));
}

#[test]
fn a_device_that_refuses_pre_op_is_reported_with_its_code() {
    let mut cell = cell(config(&[EXPECTED; 2]), 2);
    let mailbox = ethercat_subdevice::sync_managers(&DEVICE)[0];
    // The category of sync managers, which follows the mailbox in the EEPROM's header.
    let length_and_control = [&mailbox.len.to_le_bytes()[..], &[mailbox.control]].concat();
    cell.command_b(|echo, _| {
        let eeprom = echo.0.eeprom_mut(DeviceId(1)).unwrap();
        let at = eeprom.windows(3).position(|bytes| bytes == length_and_control).unwrap();
        eeprom[at + 2] ^= 0x01;
    });
    let Some((LinkEvent::Down(down), _)) = event(&mut cell, MS * 6_000) else { panic!("no event") };
    assert_eq!((down.cause, down.code), (DownCause::Refused, 0x0016), "{down}");
}
