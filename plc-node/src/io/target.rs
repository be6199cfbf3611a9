//! The device on the wire: found by name, address or position, or as the only one of the file's identity.

use std::cell::OnceCell;
use std::net::Ipv4Addr;
use std::ops::ControlFlow;

use device_files::{
    ChosenDevice, DeviceChoice, DeviceFile, FoundModule, Gsdml, choose, choose_detected, choose_found,
    choose_head, sub_device_head,
};
use driven_device::{
    BusConfig, DriveConfig, DriveEvent, DrivenBus, FileDevice, MODULES_RECORD, OutputScript, ParameterAnswer,
    SignalValue, found_modules,
};
use ethercat_maindevice::FoundSubDevice;
use ethernet_ip::FoundDevice;
use machine::{Duration, Instant};
use node::errln;
use profinet::FoundStation;
use protocol_linux::{Driver, Interface, Notifier, Owner, Statistics, clock};

use super::Choice;
use super::answers::{adapter_among, alone_at_its_address, position_among, station_among};
use super::detected::{detect_modules, list_modules};
use super::target_error::TargetError;
use crate::discover::{find_adapters, find_stations, find_sub_devices};
use crate::printable::printable;

/// Time for the answers of devices to a question to all of them.
const SEARCH: Duration = Duration::from_millis(1_000);

/// Time in which a device connects and reports its modules.
const MODULES_WITHIN: Duration = Duration::from_secs(15);

/// Where the device is.
#[derive(Clone, PartialEq, Eq, Default, Debug)]
pub(super) struct DeviceTarget {
    pub(super) address: Option<Ipv4Addr>,
    pub(super) station_name: Option<String>,
    /// Position on an EtherCAT cable with other devices, from 1.
    pub(super) position: Option<u16>,
}

/// Searches on the network of an interface, each of them once for all devices.
#[derive(Debug)]
pub(super) struct NetworkSearch<'i> {
    interface: &'i Interface,
    stations: OnceCell<Vec<FoundStation>>,
    adapters: OnceCell<Vec<FoundDevice>>,
    sub_devices: OnceCell<Vec<FoundSubDevice>>,
}

/// Returns what was found, or finds it.
fn once<T>(cell: &OnceCell<Vec<T>>, find: impl FnOnce() -> anyhow::Result<Vec<T>>) -> anyhow::Result<&[T]> {
    if let Some(found) = cell.get() {
        return Ok(found);
    }
    let found = find()?;
    Ok(cell.get_or_init(|| found))
}

impl<'i> NetworkSearch<'i> {
    pub(super) const fn new(interface: &'i Interface) -> Self {
        Self { interface, stations: OnceCell::new(), adapters: OnceCell::new(), sub_devices: OnceCell::new() }
    }

    fn stations(&self) -> anyhow::Result<&[FoundStation]> {
        once(&self.stations, || find_stations(self.interface, SEARCH))
    }

    fn adapters(&self) -> anyhow::Result<&[FoundDevice]> {
        once(&self.adapters, || find_adapters(self.interface, SEARCH))
    }

    fn sub_devices(&self) -> anyhow::Result<&[FoundSubDevice]> {
        once(&self.sub_devices, || Ok(find_sub_devices(self.interface, SEARCH)?.devices))
    }
}

impl DeviceTarget {
    pub(super) fn find(
        file: &DeviceFile,
        choice: &DeviceChoice,
        search: &NetworkSearch<'_>,
        at: Option<&str>,
        address: Option<Ipv4Addr>,
    ) -> anyhow::Result<Self> {
        match (file, at) {
            (DeviceFile::Gsdml(gsdml), at) => Self::station(gsdml, search, at, address),
            (DeviceFile::Eds(_), Some(at)) => {
                let parsed = at.parse().ok();
                let wrong = || TargetError::At(printable(at.as_bytes()), "an IPv4 address, as 192.168.0.2");
                Ok(Self { address: Some(parsed.ok_or_else(wrong)?), ..Self::default() })
            }
            (DeviceFile::Eds(eds), None) => {
                let address = adapter_among(search.adapters()?, eds.vendor_id, eds.product_code)?;
                Ok(Self { address: Some(address), ..Self::default() })
            }
            (DeviceFile::Esi(_), Some(at)) => {
                let must = "a position on the cable, from 1, as `plc-node discover` lists them";
                let wrong = || TargetError::At(printable(at.as_bytes()), must);
                let position = at.parse().ok().filter(|position| *position > 0).ok_or_else(wrong)?;
                Ok(Self { position: Some(position), ..Self::default() })
            }
            (DeviceFile::Esi(esi), None) => {
                let head = sub_device_head(esi, choice)?;
                let position = position_among(search.sub_devices()?, head.vendor_id, head.product_code)?;
                Ok(Self { position, ..Self::default() })
            }
        }
    }

    /// Returns the name of a device that the user did not name, beside those before it.
    pub(super) fn name(&self, before: &[FileDevice]) -> String {
        let position = self.position.map(|position| position.to_string());
        let address = self.address.map(|address| address.to_string());
        let name = self.station_name.clone().or(position).or(address).unwrap_or_else(|| "1".to_owned());
        let is_taken = |name: &str| before.iter().any(|it| it.name.eq_ignore_ascii_case(name));
        let numbered = (2..).map(|number| format!("{name}#{number}"));
        std::iter::once(name.clone()).chain(numbered).find(|name| !is_taken(name)).unwrap_or(name)
    }

    fn station(
        gsdml: &Gsdml,
        search: &NetworkSearch<'_>,
        at: Option<&str>,
        address: Option<Ipv4Addr>,
    ) -> anyhow::Result<Self> {
        let found = search.stations()?;
        let station = station_among(found, (gsdml.vendor_id, gsdml.device_id), at)?;
        let its_address = station.ip.map(|ip| ip.address).filter(|address| !address.is_unspecified());
        if address.is_none() {
            alone_at_its_address(found, station)?;
        }
        let no_address = || TargetError::NoStationAddress(printable(&station.name));
        let address = address.or(its_address).ok_or_else(no_address)?;
        let station_name = String::from_utf8(station.name.to_vec()).ok();
        Ok(Self { address: Some(address), station_name, position: None })
    }
}

/// Makes the device of the choice; without chosen modules, on PROFINET and EtherCAT, of those that it reports.
pub(super) fn choose_device(
    file: &DeviceFile,
    choice: &DeviceChoice,
    interface: &Interface,
    bus: &BusConfig,
    config: &DriveConfig,
) -> anyhow::Result<Choice> {
    match file {
        DeviceFile::Gsdml(gsdml) if choice.modules.is_empty() => {
            let head = ChosenDevice::Gsdml(choose_head(gsdml, choice)?);
            let found = read_modules(file, head, interface, (bus, config))?;
            let (device, unknown) = choose_found(gsdml, choice, &found)?;
            Ok((ChosenDevice::Gsdml(device), unknown))
        }
        DeviceFile::Esi(esi) if choice.modules.is_empty() => {
            let head = sub_device_head(esi, choice)?;
            if !head.lists_modules {
                return Ok((choose(file, choice)?, Vec::new()));
            }
            match detect_modules(head, interface, bus.mac, config.position, MODULES_WITHIN)? {
                Ok(detected) => {
                    let (device, unknown) = choose_detected(esi, choice, &detected)?;
                    let name = printable(device.kind.as_bytes());
                    errln!("{name}: modules detected: {}", list_modules(&device));
                    Ok((ChosenDevice::Esi(device), unknown))
                }
                Err(reason) => {
                    let device = choose(file, choice)?;
                    errln!("it does not list its modules: {reason}; those that the file requires are taken");
                    Ok((device, Vec::new()))
                }
            }
        }
        _ => Ok((choose(file, choice)?, Vec::new())),
    }
}

/// Connects to the access point alone, and reads which modules the device has.
fn read_modules(
    file: &DeviceFile,
    head: ChosenDevice,
    interface: &Interface,
    (bus, config): (&BusConfig, &DriveConfig),
) -> anyhow::Result<Vec<FoundModule>> {
    let device = FileDevice {
        name: config.station_name.clone().unwrap_or_default(),
        file: file.clone(),
        chosen: head,
        script: OutputScript::default(),
        config: DriveConfig { is_running: false, ..config.clone() },
    };
    let mut device = DrivenBus::new(vec![device], bus, clock::now())?;
    device.read_parameter(MODULES_RECORD)?;
    let mut reader = ModuleReader {
        until: clock::now() + MODULES_WITHIN,
        last: "it does not answer".to_owned(),
        found: None,
        is_answered: false,
    };
    let mut driver = Driver::new(device, interface.clone(), Notifier::new()?)?;
    driver.run(&mut reader)?;
    reader.found.ok_or_else(|| TargetError::NoModules(reader.last).into())
}

/// Owner of the connection by which modules are read.
struct ModuleReader {
    until: Instant,
    /// Why there are none yet.
    last: String,
    found: Option<Vec<FoundModule>>,
    is_answered: bool,
}

/// Returns the modules of the answer, or why there are none.
fn modules_in(answer: ParameterAnswer) -> Result<Vec<FoundModule>, String> {
    let record = match answer.result?.raw {
        SignalValue::Bytes(record) => record,
        value => return Err(format!("{MODULES_RECORD} is {value}, not bytes")),
    };
    let malformed = || format!("its record {MODULES_RECORD} of {} bytes lists no modules", record.len());
    found_modules(&record).ok_or_else(malformed)
}

impl Owner<DrivenBus> for ModuleReader {
    fn wake(&mut self, now: Instant, _: &mut DrivenBus, _: &Statistics) -> ControlFlow<()> {
        if self.until <= now { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }

    fn event(
        &mut self,
        now: Instant,
        device: &mut DrivenBus,
        (_, event): (usize, DriveEvent),
    ) -> ControlFlow<()> {
        match event {
            DriveEvent::Answer(answer) => {
                match modules_in(answer) {
                    Ok(modules) => self.found = Some(modules),
                    Err(reason) => self.last = reason,
                }
                self.is_answered = true;
                device.disconnect(now);
            }
            DriveEvent::Down(..) if self.is_answered => return ControlFlow::Break(()),
            DriveEvent::Down(down, details) => self.last = format!("{down} {details}").trim_end().to_owned(),
            _ => {}
        }
        ControlFlow::Continue(())
    }

    fn deadline(&self) -> Option<Instant> {
        Some(self.until)
    }
}

#[cfg(test)]
mod tests {
    use driven_device::ParameterValue;

    use super::*;

    #[test]
    fn a_record_that_lists_no_modules_is_told_as_such_and_not_as_silence() {
        let answered = |value| {
            let result = Ok(ParameterValue { raw: value, scaled: None, text: None });
            modules_in(ParameterAnswer {
                name: MODULES_RECORD.into(),
                unit: String::new(),
                is_write: false,
                result,
            })
        };
        let reason = answered(SignalValue::Bytes(vec![0x00, 0xF0, 0x00])).unwrap_err();
        assert_eq!(reason, "its record 0.1:0xF000 of 3 bytes lists no modules");
        assert_eq!(answered(SignalValue::Unsigned(7)).unwrap_err(), "0.1:0xF000 is 7, not bytes");
    }
}
