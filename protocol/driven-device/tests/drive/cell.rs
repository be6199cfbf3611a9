//! A device of a file on one side of a cable, and its controller on the other.

use std::net::Ipv4Addr;

use device_files::{ChosenDevice, DeviceChoice, DeviceFile, choose, read};
use driven_device::{
    BusConfig, DriveConfig, DriveError, DriveEvent, DrivenBus, DrivenDevice, FileDevice, OutputScript,
    ParameterValue,
};
use emulated_device::{DeviceScript, EmulatedDevice, EmulationConfig};
use machine::ethernet::Mac;
use machine::{Duration, Instant, LinkEvent};
use virtual_time::{Clock, Event, Impairment, Pair, PairConfig, Side};

pub(crate) const CONTROLLER: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 1);
pub(crate) const DEVICE: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 2);
const MASK: Ipv4Addr = Ipv4Addr::new(255, 255, 255, 0);

pub(crate) const GSDML: &str =
    include_str!("../../../../scripts/interop/files/GSDML-V2.35-made-up-io-20260101.xml");
pub(crate) const EDS: &str = include_str!("../../../../scripts/interop/files/made-up-adapter.eds");
pub(crate) const ESI: &str = include_str!("../../../../scripts/interop/files/made-up-terminal.xml");

/// A cable with a driven device at side A and an emulated one at side B.
pub(crate) struct DrivenPair {
    pub(crate) pair: Pair<DrivenBus, EmulatedDevice>,
    pub(crate) events: Vec<DriveEvent>,
}

/// File, and what is chosen from it.
#[derive(Clone)]
pub(crate) struct Chosen {
    pub(crate) file: DeviceFile,
    pub(crate) device: ChosenDevice,
}

pub(crate) fn chosen(name: &str, text: &str, choice: &str) -> Chosen {
    let file = read(name, text.to_owned().into()).unwrap();
    let device = choose(&file, &DeviceChoice::from_toml(choice).unwrap()).unwrap();
    Chosen { file, device }
}

/// Returns a device for each bus, with its inputs and outputs by name: a whole place of each.
pub(crate) fn devices() -> [Chosen; 3] {
    [
        chosen("made-up-adapter.eds", EDS, ""),
        chosen("GSDML-V2.35-a.xml", GSDML, "[modules]\n1 = \"M_8DI\"\n2 = \"M_2AO\"\n"),
        chosen("made-up-terminal.xml", ESI, "device_name = \"MU1002\""),
    ]
}

pub(crate) fn bus_config() -> BusConfig {
    BusConfig { mac: Mac([2, 0, 0, 0, 0, 1]), address: Some(CONTROLLER), mask: MASK, seed: 0x1234_5678_9ABC }
}

pub(crate) fn drive_config() -> DriveConfig {
    DriveConfig {
        device_address: Some(DEVICE),
        station_name: Some("made-up-io".to_owned()),
        position: None,
        interval: None,
        output_interval: None,
        input_interval: None,
        is_running: true,
        report_every: Duration::from_millis(100),
    }
}

pub(crate) fn emulation_config() -> EmulationConfig {
    EmulationConfig {
        mac: Mac([2, 0, 0, 0, 0, 2]),
        address: Some(DEVICE),
        mask: MASK,
        gateway: Ipv4Addr::UNSPECIFIED,
        station_name: Some(b"made-up-io".to_vec()),
        permanent: None,
        serial_number: 7,
        first_id: 1,
    }
}

pub(crate) fn emulated(device: ChosenDevice, script: &str) -> EmulatedDevice {
    let script = DeviceScript::from_toml(script).unwrap();
    EmulatedDevice::new(device, script, emulation_config(), Instant::ZERO).unwrap()
}

pub(crate) fn driven(chosen: &Chosen, script: &str, config: &DriveConfig) -> DrivenBus {
    let script = OutputScript::from_toml(script).unwrap();
    drive_file(chosen.file.clone(), chosen.device.clone(), script, config).unwrap()
}

/// Returns a device of a file under a name.
pub(crate) fn file_device(chosen: &Chosen, name: &str, config: DriveConfig) -> FileDevice {
    let Chosen { file, device } = chosen.clone();
    FileDevice { name: name.to_owned(), file, chosen: device, script: OutputScript::default(), config }
}

/// Makes a bus of one device.
pub(crate) fn drive_file(
    file: DeviceFile,
    chosen: ChosenDevice,
    script: OutputScript,
    config: &DriveConfig,
) -> Result<DrivenBus, DriveError> {
    let device = FileDevice { name: "device".to_owned(), file, chosen, script, config: config.clone() };
    DrivenBus::new(vec![device], &bus_config(), Instant::ZERO)
}

/// Returns a cable that loses nothing.
pub(crate) fn pair_config() -> PairConfig {
    PairConfig {
        seed: 1,
        clocks: [Clock::default(); 2],
        links: [Impairment::default(); 2],
        addresses: [Some(CONTROLLER), Some(DEVICE)],
    }
}

impl DrivenPair {
    /// Connects a device to its own controller.
    pub(crate) fn of(chosen: &Chosen, device_script: &str, script: &str, config: &DriveConfig) -> Self {
        Self::between(driven(chosen, script, config), emulated(chosen.device.clone(), device_script))
    }

    pub(crate) fn between(driven: DrivenBus, emulated: EmulatedDevice) -> Self {
        Self { pair: Pair::new(driven, emulated, pair_config()), events: Vec::new() }
    }

    /// Runs until so many milliseconds after the start.
    pub(crate) fn run_to(&mut self, millis: u64) {
        while let Some(event) = self.pair.next_event(Instant::from_millis(millis)) {
            match event {
                Event::A((_, event)) => self.events.push(event),
                Event::B(emulated_device::DeviceEvent::Link(LinkEvent::SetAddress {
                    address, mask, ..
                })) => {
                    self.pair.set_address(Side::B, Some(address));
                    self.pair.command_b(|device, now| device.address_set(now, Some(address), mask));
                }
                Event::B(_) => {}
            }
        }
    }

    pub(crate) fn device(&mut self) -> &DrivenDevice {
        &self.pair.a().devices()[0]
    }

    /// Returns the value of an input as text.
    pub(crate) fn input(&self, name: &str) -> Option<String> {
        self.pair.a().devices()[0].input(name).map(|value| value.to_string())
    }

    /// Returns the bytes of an output place at the device.
    pub(crate) fn output(&self, place: &str) -> Option<Vec<u8>> {
        self.pair.b().output(place).map(<[u8]>::to_vec)
    }

    pub(crate) fn texts(&self) -> Vec<String> {
        let text = |event: &DriveEvent| match event {
            DriveEvent::Difference(text) => Some(format!("difference {text}")),
            DriveEvent::Alarm(text) => Some(format!("alarm {text}")),
            DriveEvent::Earlier(text) => Some(format!("earlier {text}")),
            DriveEvent::Up => Some("up".to_owned()),
            DriveEvent::Configured => Some("configured".to_owned()),
            DriveEvent::Down(down, details) => Some(format!("down {down}; {details}")),
            DriveEvent::Conflict(conflict) => Some(format!("conflict {conflict}")),
            DriveEvent::Answer(answer) => Some(match &answer.result {
                Ok(ParameterValue { raw, scaled: Some(scaled), .. }) => {
                    format!("answer {} = {scaled} {} (raw {raw})", answer.name, answer.unit)
                }
                Ok(value) => format!("answer {} = {}", answer.name, value.raw),
                Err(error) => format!("answer {}: {error}", answer.name),
            }),
            _ => None,
        };
        self.events.iter().filter_map(text).collect()
    }
}
