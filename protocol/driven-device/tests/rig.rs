//! Several devices of one process on a real cable, under one controller: data of each compared, both ways.

#![expect(clippy::unwrap_used, clippy::panic, reason = "a test fails by a panic")]

use std::net::Ipv4Addr;
use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use driven_device::{DriveConfig, DriveEvent, DrivenBus, DrivenDevice};
use emulated_device::{DeviceEvent, DeviceScript, EmulatedDevice, EmulatedDevices, EmulationConfig};
use machine::ethernet::Mac;
use machine::{Duration, Instant, LinkEvent};
use networked_tests::{End, cable};
use protocol_linux::namespace::NetworkNamespace;
use protocol_linux::{Driver, Interface, Notifier, Owner, Statistics, clock, macvlan};

#[expect(dead_code, reason = "the tests in virtual time use the others")]
#[path = "drive/cell.rs"]
mod cell;

use cell::{CONTROLLER, Chosen, ESI, GSDML, bus_config, chosen, drive_config, emulation_config, file_device};

fn main() -> std::process::ExitCode {
    networked_tests::run(networked_tests::tests![
        two_sub_devices_of_one_cable_send_back_what_each_of_them_gets,
        sixty_four_io_devices_at_one_interface_send_back_every_4_ms_what_each_of_them_gets,
    ])
}

/// Values that each device sends back.
const ROUNDS: u16 = 20;

/// Owner of the controller: gives each device the next value once the last one has come back.
struct EchoOwner {
    /// Output and input of each device by name, and the bytes of the value at the output.
    signals: Vec<(String, String)>,
    /// Rounds that each device has done.
    rounds: Vec<u16>,
    is_sent: Vec<bool>,
    is_little_endian: bool,
    seen: Vec<String>,
}

impl EchoOwner {
    fn value(&self, number: usize) -> [u8; 2] {
        let value = 0x0100 * self.rounds[number] + number as u16 + 1;
        if self.is_little_endian { value.to_le_bytes() } else { value.to_be_bytes() }
    }
}

fn digits(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

impl Owner<DrivenBus> for EchoOwner {
    fn wake(&mut self, _: Instant, bus: &mut DrivenBus, _: &Statistics) -> ControlFlow<()> {
        for number in 0..self.rounds.len() {
            if self.rounds[number] == ROUNDS || !bus.devices()[number].is_up() {
                continue;
            }
            let value = self.value(number);
            if self.is_sent[number] {
                let inputs = bus.devices()[number].inputs();
                let input = &self.signals[number].1;
                let has_come = inputs.is_some_and(|table| {
                    let signal = table.find(input).unwrap_or_else(|| panic!("{input}"));
                    table.bytes()[signal.bit / 8..][..2] == value
                });
                if has_come {
                    self.rounds[number] += 1;
                    self.is_sent[number] = false;
                }
                continue;
            }
            let name = format!("{number}/{}", self.signals[number].0);
            let (len, is_number) = match bus.devices()[number].outputs().find(&self.signals[number].0) {
                Some(signal) => (signal.bits / 8, signal.bits == 16),
                None => panic!("{name}"),
            };
            let mut bytes = value.to_vec();
            bytes.resize(len, 0);
            let as_number = || match self.is_little_endian {
                true => i16::from_le_bytes(value),
                false => i16::from_be_bytes(value),
            };
            let text = if is_number { as_number().to_string() } else { digits(&bytes) };
            bus.set(&name, &text).unwrap_or_else(|error| panic!("{error}"));
            self.is_sent[number] = true;
        }
        if self.rounds.iter().all(|rounds| *rounds == ROUNDS) {
            return ControlFlow::Break(());
        }
        ControlFlow::Continue(())
    }

    fn event(
        &mut self,
        _: Instant,
        bus: &mut DrivenBus,
        (number, event): (usize, DriveEvent),
    ) -> ControlFlow<()> {
        match event {
            DriveEvent::Down(down, details) => self.seen.push(format!("{number}: {down}; {details}")),
            DriveEvent::Difference(text) | DriveEvent::Alarm(text) => panic!("{number}: {text}"),
            _ => {}
        }
        assert!(!bus.devices()[number].differs(), "{:?}", self.seen);
        ControlFlow::Continue(())
    }
}

/// Owner of the devices until the comparison ends.
struct Emulation {
    interfaces: Vec<Interface>,
    is_over: Arc<AtomicBool>,
}

impl Owner<EmulatedDevices> for Emulation {
    fn wake(&mut self, _: Instant, _: &mut EmulatedDevices, _: &Statistics) -> ControlFlow<()> {
        if self.is_over.load(Ordering::Relaxed) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }

    fn event(
        &mut self,
        now: Instant,
        devices: &mut EmulatedDevices,
        (number, event): (usize, DeviceEvent),
    ) -> ControlFlow<()> {
        if let DeviceEvent::Link(LinkEvent::SetAddress { address, mask, .. }) = event {
            self.interfaces[number].set_address(address, mask).unwrap();
            devices.change(number, |device| device.address_set(now, Some(address), mask));
        }
        ControlFlow::Continue(())
    }
}

/// Runs both ends until each device has sent back all its values. Returns the controller, and what its owner saw.
fn compare(
    (plc, interface): (&NetworkNamespace, &str),
    (devices, device_interfaces): (&NetworkNamespace, Vec<Interface>),
    driven: impl FnOnce() -> DrivenBus + Send,
    emulated: impl FnOnce() -> EmulatedDevices + Send,
    mut comparison: EchoOwner,
) -> (Vec<machine::Counters>, Statistics, EchoOwner) {
    let is_over = Arc::new(AtomicBool::new(false));
    let notifier = Notifier::new().unwrap();
    let mut emulation = Emulation { interfaces: device_interfaces.clone(), is_over: Arc::clone(&is_over) };
    let ended = notifier.clone();
    std::thread::scope(|scope| {
        let emulation = scope.spawn(move || {
            devices.run(|| {
                let mut driver = Driver::new(emulated(), device_interfaces, notifier).unwrap();
                driver.run(&mut emulation).unwrap();
            })
        });
        let result = plc.run(|| {
            let interface = Interface::open(interface).unwrap();
            let mut driver = Driver::new(driven(), interface, Notifier::new().unwrap()).unwrap();
            driver.run(&mut comparison).unwrap();
            let counters = driver.machine().devices().iter().map(DrivenDevice::counters).collect();
            (counters, driver.statistics().clone(), comparison)
        });
        is_over.store(true, Ordering::Relaxed);
        ended.notify();
        emulation.join().unwrap().unwrap();
        result.unwrap()
    })
}

fn two_networks() -> [NetworkNamespace; 2] {
    let networks = [NetworkNamespace::new().unwrap(), NetworkNamespace::new().unwrap()];
    let end = |network, name, address| End { network, name, address };
    let [plc, devices] = &networks;
    cable([end(plc, "plc", Some(CONTROLLER)), end(devices, "cable", None)]);
    networks
}

fn two_sub_devices_of_one_cable_send_back_what_each_of_them_gets() {
    let [plc, devices] = two_networks();
    let script = "[[inputs]]\nplace = \"0x6000:11\"\necho = { place = \"0x7000:01\" }\n";
    let analog = chosen("made-up-terminal.xml", ESI, "device_name = \"MU1002\"");
    let other = ESI.replace("ProductCode=\"#x77\"", "ProductCode=\"#x99\"");
    let other = chosen("other.xml", &other, "device_name = \"MU1002\"");
    let both = [analog, other];
    let driven = || {
        let devices = both.iter().enumerate().map(|(number, chosen)| {
            let config = DriveConfig { position: Some(number as u16 + 1), ..drive_config() };
            file_device(chosen, &number.to_string(), config)
        });
        DrivenBus::new(devices.collect(), &bus_config(), clock::now()).unwrap()
    };
    let emulated = || {
        let devices = both.iter().map(|chosen| {
            let script = DeviceScript::from_toml(script).unwrap();
            EmulatedDevice::new(chosen.device.clone(), script, emulation_config(), clock::now()).unwrap()
        });
        EmulatedDevices::new(devices.collect()).unwrap()
    };
    let comparison = EchoOwner {
        signals: vec![("Outputs/Output".to_owned(), "Inputs/Value".to_owned()); 2],
        rounds: vec![0; 2],
        is_sent: vec![false; 2],
        is_little_endian: true,
        seen: Vec::new(),
    };
    let interface = devices.run(|| Interface::open("cable").unwrap()).unwrap();
    let (counters, _, seen) =
        compare((&plc, "plc"), (&devices, vec![interface]), driven, emulated, comparison);
    assert!(counters.iter().all(|it| it.received > u64::from(ROUNDS)), "{counters:?}; {:?}", seen.seen);
}

/// Number of IO-Devices.
const DEVICES: usize = 64;

fn sixty_four_io_devices_at_one_interface_send_back_every_4_ms_what_each_of_them_gets() {
    let [plc, host] = two_networks();
    let devices = NetworkNamespace::new().unwrap();
    macvlan::separate_addresses(&devices).unwrap();
    let mac = |number: usize| Mac([2, 0, 0, 0, 1, number as u8]);
    let address = |number: usize| Ipv4Addr::new(192, 168, 64, 100 + number as u8);
    let name = |number: usize| format!("device{number}");
    host.run(|| {
        let cable = Interface::open("cable").unwrap();
        (0..DEVICES).for_each(|number| macvlan::add(&cable, &devices, &name(number), mac(number)).unwrap());
    })
    .unwrap();
    let open = |number| {
        let interface = Interface::open(&name(number)).unwrap();
        interface.set_up().unwrap();
        assert_eq!(interface.mac(), mac(number));
        interface
    };
    let interfaces: Vec<_> = devices.run(|| (0..DEVICES).map(open).collect()).unwrap();
    let chosen: Chosen = chosen("GSDML-V2.35-a.xml", GSDML, "[modules]\n2 = \"M_2AO\"\n");
    let driven = || {
        let devices = (0..DEVICES).map(|number| {
            let config = DriveConfig {
                device_address: Some(address(number)),
                station_name: Some(format!("io-{number}")),
                interval: Some(Duration::from_millis(4)),
                ..drive_config()
            };
            file_device(&chosen, &number.to_string(), config)
        });
        let plc = plc.run(|| Interface::open("plc").unwrap().mac()).unwrap();
        let bus = driven_device::BusConfig { mac: plc, ..bus_config() };
        DrivenBus::new(devices.collect(), &bus, clock::now()).unwrap()
    };
    let emulated = || {
        let script = "[[inputs]]\nplace = \"2.1\"\necho = { place = \"2.1\" }\n";
        let devices = (0..DEVICES).map(|number| {
            let config = EmulationConfig {
                mac: mac(number),
                address: None,
                station_name: Some(format!("io-{number}").into_bytes()),
                serial_number: number as u32,
                ..emulation_config()
            };
            let script = DeviceScript::from_toml(script).unwrap();
            EmulatedDevice::new(chosen.device.clone(), script, config, clock::now()).unwrap()
        });
        EmulatedDevices::new(devices.collect()).unwrap()
    };
    let comparison = EchoOwner {
        signals: vec![("2.1".to_owned(), "2.1".to_owned()); DEVICES],
        rounds: vec![0; DEVICES],
        is_sent: vec![false; DEVICES],
        is_little_endian: false,
        seen: Vec::new(),
    };
    let (counters, statistics, seen) =
        compare((&plc, "plc"), (&devices, interfaces), driven, emulated, comparison);
    let least = counters.iter().map(|it| it.received).min();
    assert!(least > Some(u64::from(ROUNDS)), "{counters:?}; {:?}", seen.seen);
    let lost: u64 = counters.iter().map(|it| it.lost).sum();
    let received: u64 = counters.iter().map(|it| it.received).sum();
    println!(
        "{received} frames received of {DEVICES} devices, {lost} lost; lateness {:?} at p99, {:?} at most; {:?}",
        statistics.lateness.quantile(0.99),
        statistics.lateness.max(),
        seen.seen
    );
}
