//! Several MainDevices and one cable of SubDevices on a switch, where all hear each other: one drives the devices, the others
//! say why they do not.

#![expect(clippy::unwrap_used, clippy::panic, reason = "a test fails by a panic")]

use ethercat_maindevice::{Config, ETHER_TYPE, ExpectedDevice, GroupMainDevice};
use ethercat_subdevice::description::{DataType, Description, Mailbox, Pdo, PdoEntry};
use ethercat_subdevice::{AlState, DeviceConfig, DeviceId, Segment};
use machine::ethernet::Mac;
use machine::{DownCause, Duration, Instant, LinkEvent, Machine, Port, PortRequest, Source, Transmit};
use virtual_time::{Network, NodeId, StationConfig, SwitchConfig, SwitchId};

/// Delay of the cable of each station: between two a frame takes twice as long.
const CABLE: Duration = Duration::from_nanos(10_000);

const MS: Duration = Duration::from_millis(1);

const fn numbers(index: u16) -> PdoEntry {
    PdoEntry { index, subindex: 1, bits: 64, data_type: DataType::Unsigned64, name: "Number" }
}

const OUTPUTS: &[Pdo] = &[Pdo { index: 0x1600, name: "Outputs", entries: &[numbers(0x7000)] }];

/// Eight bytes each way.
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
    outputs: OUTPUTS,
    inputs: &[Pdo { index: 0x1A00, name: "Inputs", entries: &[numbers(0x6000)] }],
    mailbox: Some(Mailbox { len: 128, file_capacity: 0 }),
    objects: &[],
    optional_outputs: &[],
    optional_inputs: &[],
    clock_modes: &[],
    numbers_names: true,
};

/// Eight bytes of inputs, so no watchdog runs in it.
static SENSOR: Description = Description { product_code: 8, outputs: &[], ..DEVICE };

/// What is on the switch.
enum Station {
    Plc(Box<GroupMainDevice>),
    Devices(Segment),
    /// Sends a frame every so often.
    Stranger {
        frame: Vec<u8>,
        every: Duration,
        next: Option<Instant>,
    },
    /// A MainDevice whose cable is cut.
    Away(Box<GroupMainDevice>),
    /// A MainDevice that hears nothing but replies to its own frames.
    Deaf(Box<GroupMainDevice>, Mac),
    Empty,
}

impl Machine for Station {
    type Event = LinkEvent;

    fn ports(&self) -> &[PortRequest] {
        &[PortRequest::AnyEthernet { ether_type: ETHER_TYPE }]
    }

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        match self {
            Self::Plc(plc) => plc.handle_frame(now, from, frame),
            Self::Deaf(plc, Mac([_, own @ ..])) if frame[7..12] == *own => plc.handle_frame(now, from, frame),
            // Chips mark what passed them, and do not take it once more.
            Self::Devices(devices) if frame[6] & 2 == 0 => devices.handle_frame(now, from, frame),
            _ => {}
        }
    }

    fn handle_timeout(&mut self, now: Instant) {
        match self {
            Self::Plc(plc) | Self::Away(plc) | Self::Deaf(plc, _) => plc.handle_timeout(now),
            Self::Devices(devices) => devices.handle_timeout(now),
            _ => {}
        }
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        match self {
            Self::Plc(plc) | Self::Deaf(plc, _) => plc.poll_transmit(now, buf),
            Self::Away(plc) => {
                while plc.poll_transmit(now, buf).is_some() {}
                None
            }
            Self::Devices(devices) => devices.poll_transmit(now, buf),
            Self::Stranger { frame, every, next } => {
                let due = next.filter(|next| *next <= now)?;
                *next = Some(due + *every);
                buf[..frame.len()].copy_from_slice(frame);
                Some(Transmit { port: Port::Ethernet, to: None, len: frame.len() })
            }
            Self::Empty => None,
        }
    }

    fn poll_event(&mut self) -> Option<LinkEvent> {
        match self {
            Self::Plc(plc) | Self::Away(plc) | Self::Deaf(plc, _) => plc.poll_event(),
            Self::Devices(devices) => {
                while devices.poll_event().is_some() {}
                None
            }
            _ => None,
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        match self {
            Self::Plc(plc) | Self::Away(plc) | Self::Deaf(plc, _) => plc.poll_timeout(),
            Self::Devices(devices) => devices.poll_timeout(),
            Self::Stranger { next, .. } => *next,
            Self::Empty => None,
        }
    }
}

const fn mac(number: u8) -> Mac {
    Mac([0x00, 0x1B, 0x21, 0, 0, number])
}

const fn expected(description: &Description) -> ExpectedDevice {
    ExpectedDevice {
        vendor: description.vendor_id,
        product: description.product_code,
        revision: None,
        output_bytes: if description.outputs.is_empty() { 0 } else { 8 },
        input_bytes: 8,
    }
}

/// A switch with devices.
struct Cell {
    network: Network<Station>,
    devices: NodeId,
    description: &'static Description,
    /// What each station reported: when, and in words.
    told: Vec<(NodeId, Instant, String)>,
}

impl Cell {
    fn of(description: &'static Description) -> Self {
        let mut network = Network::with_switch(1, SwitchConfig::IDEAL);
        let mut segment = Segment::new();
        segment.add(&DeviceConfig::new(description));
        let devices = network.add_station(
            SwitchId::FIRST,
            "devices",
            Station::Devices(segment),
            StationConfig::new(mac(0xFF), None, CABLE),
        );
        Self { network, devices, description, told: Vec::new() }
    }

    fn new() -> Self {
        Self::of(&DEVICE)
    }

    /// Starts a PLC on the interface with this address.
    fn start(&mut self, mac: Mac) -> NodeId {
        let config = Config { mac, devices: vec![expected(self.description)], cycle: MS, watchdog: MS * 20 };
        let plc = GroupMainDevice::new(config, self.network.now());
        self.network.add_station(
            SwitchId::FIRST,
            "plc",
            Station::Plc(Box::new(plc)),
            StationConfig::new(mac, None, CABLE),
        )
    }

    /// Ends a PLC as a crash does: without a word.
    fn kill(&mut self, plc: NodeId) {
        self.network.command(plc, |station, _| *station = Station::Empty).unwrap();
    }

    fn set_cut(&mut self, plc: NodeId, cut: bool) {
        let change = |station: &mut Station, _| {
            *station = match std::mem::replace(station, Station::Empty) {
                Station::Plc(plc) if cut => Station::Away(plc),
                Station::Away(plc) if !cut => Station::Plc(plc),
                other => other,
            };
        };
        self.network.command(plc, change).unwrap();
    }

    fn run(&mut self, time: Duration) {
        let until = self.network.now() + time;
        while let Some((id, event)) = self.network.next_event(until) {
            let mut words = match event {
                LinkEvent::Up => "up".to_owned(),
                LinkEvent::Down(down) => format!("{:?}", down.cause),
                other => panic!("{other:?}"),
            };
            if event != LinkEvent::Up {
                let mut details = String::new();
                self.plc(id).explain(&mut details).unwrap();
                words = format!("{words}: {details}");
            }
            self.told.push((id, self.network.now(), words));
        }
    }

    /// Returns what a PLC reported.
    fn told(&self, plc: NodeId) -> Vec<&str> {
        self.told.iter().filter(|(id, ..)| *id == plc).map(|(.., words)| words.as_str()).collect()
    }

    fn plc(&self, plc: NodeId) -> &GroupMainDevice {
        match self.network.machine(plc) {
            Some(Station::Plc(plc) | Station::Away(plc) | Station::Deaf(plc, _)) => plc,
            _ => panic!("it is a PLC"),
        }
    }

    fn is_up(&self, plc: NodeId) -> bool {
        self.plc(plc).inputs().is_some()
    }

    fn state(&self) -> AlState {
        match self.network.machine(self.devices) {
            Some(Station::Devices(segment)) => segment.state(DeviceId(0)).unwrap().0,
            _ => panic!("they are devices"),
        }
    }
}

fn refusal(number: u8) -> String {
    format!(
        "{:?}: another EtherCAT MainDevice sends on this cable, source address {} (its first byte may differ from that of \
         the interface): stop it; until then this one sends nothing",
        DownCause::Refused,
        mac(number)
    )
}

#[test]
fn a_second_plc_says_once_whose_frames_it_hears_and_the_first_one_loses_no_frame() {
    for after in [1, 37, 1_000] {
        let mut cell = Cell::new();
        let first = cell.start(mac(1));
        cell.run(MS * 200);
        let second = cell.start(mac(2));
        cell.run(MS * after);
        cell.run(MS * 60_000);
        assert_eq!(cell.told(first), ["up"]);
        assert_eq!(cell.told(second), [refusal(1)]);
        let counters = cell.plc(first).counters();
        assert_eq!((counters.lost, counters.late, counters.skipped), (0, 0, 0), "{counters:?}");
        assert!(counters.foreign < 10, "the second one read states at most: {counters:?}");
        let heard = cell.plc(second).counters().foreign;
        assert!(heard > 59_000, "{heard}");
    }
}

/// Steps through the time in which the first PLC brings its devices up.
#[test]
fn whenever_the_second_plc_starts_one_of_the_two_drives_the_devices_in_the_end_and_no_line_repeats() {
    for after_us in (0..60_000).step_by(487) {
        let mut cell = Cell::new();
        let first = cell.start(mac(1));
        cell.run(Duration::from_micros(after_us));
        let second = cell.start(mac(2));
        cell.run(MS * 60_000);
        let is_up = [first, second].map(|plc| cell.is_up(plc));
        assert!(is_up[0] != is_up[1], "{after_us} µs: {:?}", cell.told);
        let [driving, other] = if is_up[0] { [first, second] } else { [second, first] };
        assert!(cell.told(other).last().unwrap().contains("another EtherCAT MainDevice"), "{:?}", cell.told);
        assert_eq!(cell.told(driving).last(), Some(&"up"));
        assert!(cell.told.len() <= 6, "{after_us} µs: {:?}", cell.told);
        let from = cell.told.iter().map(|(_, at, _)| *at).max().unwrap();
        assert!(from < Instant::from_millis(20_000), "{:?}", cell.told);
        assert_eq!(cell.state(), AlState::Op);
    }
}

#[test]
fn four_plcs_that_start_at_once_agree_on_one() {
    for macs in [[1, 2, 3, 4], [9, 8, 7, 6], [0x10, 0x20, 0x30, 0x40]] {
        let mut cell = Cell::new();
        let plcs = macs.map(|number| cell.start(mac(number)));
        cell.run(MS * 120_000);
        assert_eq!(plcs.iter().filter(|plc| cell.is_up(**plc)).count(), 1, "{:?}", cell.told);
        assert!(cell.told.len() <= 12, "{:?}", cell.told);
    }
}

#[test]
fn the_second_plc_takes_the_devices_over_when_the_first_one_has_ended() {
    let mut cell = Cell::new();
    let first = cell.start(mac(1));
    cell.run(MS * 200);
    let second = cell.start(mac(2));
    cell.run(MS * 5_000);
    cell.kill(first);
    cell.run(MS * 3_000);
    assert_eq!(cell.told(second), [refusal(1).as_str(), "up"]);
}

#[test]
fn a_first_plc_whose_cable_returns_finds_the_second_one_and_leaves_it_alone() {
    let mut cell = Cell::new();
    let first = cell.start(mac(1));
    cell.run(MS * 200);
    cell.set_cut(first, true);
    cell.run(MS * 500);
    let second = cell.start(mac(2));
    cell.run(MS * 5_000);
    assert!(cell.is_up(second));
    cell.set_cut(first, false);
    cell.run(MS * 30_000);
    assert!(cell.is_up(second));
    assert_eq!(cell.told(second), ["up"]);
    assert_eq!(cell.told(first)[2..], [refusal(2)], "{:?}", cell.told(first));
}

#[test]
fn a_short_cut_of_the_first_plc_does_not_hand_the_devices_to_the_second_one() {
    for cut in [5, 19, 60, 150] {
        let mut cell = Cell::new();
        let first = cell.start(mac(1));
        cell.run(MS * 200);
        let second = cell.start(mac(2));
        cell.run(MS * 2_000);
        cell.set_cut(first, true);
        cell.run(MS * cut);
        cell.set_cut(first, false);
        cell.run(MS * 10_000);
        assert!(cell.is_up(first) && !cell.is_up(second), "{cut} ms: {:?}", cell.told);
        assert_eq!(cell.told(second), [refusal(1)]);
    }
}

#[test]
fn after_a_crash_the_same_plc_finds_its_devices_in_op_and_drives_them_again() {
    for description in [&DEVICE, &SENSOR] {
        for pause in [0, 1, 15, 30, 1_000] {
            let mut cell = Cell::of(description);
            let plc = cell.start(mac(1));
            cell.run(MS * 200);
            assert_eq!(cell.state(), AlState::Op);
            cell.kill(plc);
            cell.run(MS * pause);
            let again = cell.start(mac(1));
            cell.run(MS * 500);
            // A device without outputs may leave OP later.
            assert_eq!(cell.told(again)[0], "up", "after {pause} ms");
            assert!(!cell.told.iter().any(|(.., words)| words.contains("MainDevice")), "{:?}", cell.told);
        }
    }
}

#[test]
fn a_device_that_stays_in_op_beyond_its_watchdog_is_driven_though_nobody_is_heard() {
    let mut cell = Cell::new();
    let first = cell.start(mac(1));
    cell.run(MS * 200);
    let second = cell.start(mac(2));
    let deafen = |station: &mut Station, _| {
        let Station::Plc(plc) = std::mem::replace(station, Station::Empty) else { panic!("it is a PLC") };
        *station = Station::Deaf(plc, mac(2));
    };
    cell.network.command(second, deafen).unwrap();
    cell.run(MS * 30_000);
    assert_eq!(cell.told(first), ["up"]);
    assert_eq!(
        cell.told(second),
        [
            "Refused: device 1 stays in OP, station address 0x1000: another MainDevice drives it; stop that one, or restart \
             the device"
        ]
    );
    cell.kill(first);
    cell.run(MS * 3_000);
    assert_eq!(cell.told(second).last(), Some(&"up"));
}

/// Returns a frame with one datagram to AL control of all devices.
fn request(command: u8, register: u16, data: u8, source: Mac) -> Vec<u8> {
    let [low, high] = register.to_le_bytes();
    let mut frame = vec![0xFF; 6];
    frame.extend(source.0);
    frame.extend([0x88, 0xA4, 14, 0x10, command, 7, 0, 0, low, high, 2, 0, 0, 0, data, 0, 0, 0]);
    frame.resize(60, 0);
    frame
}

#[test]
fn a_stranger_that_starts_later_and_does_not_listen_ends_the_connection_once_and_for_good() {
    for source in [Mac([1; 6]), Mac([0x10; 6]), mac(9)] {
        let mut cell = Cell::new();
        let plc = cell.start(mac(1));
        cell.run(MS * 200);
        let next = Some(cell.network.now());
        let frame = request(8, 0x0120, 1, source);
        cell.network.add_station(
            SwitchId::FIRST,
            "stranger",
            Station::Stranger { frame, every: MS * 300, next },
            StationConfig::new(mac(9), None, CABLE),
        );
        cell.run(MS * 60_000);
        let told = cell.told(plc);
        assert!(told.last().unwrap().contains(&source.to_string()), "{told:?}");
        assert!(told.len() <= 5, "{told:?}");
        assert!(!cell.is_up(plc));
    }
}

#[test]
fn who_only_reads_does_not_end_the_connection_and_is_counted() {
    let mut cell = Cell::new();
    let plc = cell.start(mac(1));
    cell.run(MS * 200);
    let next = Some(cell.network.now());
    let frame = request(7, 0x0130, 0, mac(9));
    cell.network.add_station(
        SwitchId::FIRST,
        "stranger",
        Station::Stranger { frame, every: MS * 3, next },
        StationConfig::new(mac(9), None, CABLE),
    );
    cell.run(MS * 10_000);
    assert_eq!(cell.told(plc), ["up"]);
    // Requests and replies.
    assert!(cell.plc(plc).counters().foreign > 6_000);
    assert_eq!(cell.plc(plc).counters().lost, 0);
}

#[test]
fn a_second_program_on_the_interface_of_the_first_one_hears_replies_that_it_did_not_ask_for() {
    let mut cell = Cell::new();
    let first = cell.start(mac(1));
    cell.run(MS * 200);
    let second = cell.start(mac(1));
    cell.run(MS * 10_000);
    assert_eq!(cell.told(first), ["up"]);
    let told = cell.told(second);
    assert_eq!(told.len(), 1, "{told:?}");
    assert!(told[0].contains("another program on this host"), "{told:?}");
}
