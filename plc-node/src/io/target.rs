//! The device on the wire: found by name, address or position, or as the only one of the file's identity.

use std::net::Ipv4Addr;
use std::ops::ControlFlow;

use device_files::{
    ChosenDevice, DeviceChoice, DeviceFile, FoundModule, Gsdml, choose, choose_found, choose_head,
};
use driven_device::{
    DriveConfig, DriveEvent, DrivenDevice, MODULES_RECORD, OutputScript, ParameterValue, SignalValue,
    found_modules,
};
use machine::{Duration, Instant};
use profinet::FoundStation;
use protocol_linux::{Driver, Interface, Notifier, Owner, Statistics, clock};

use super::{Choice, bus_of};
use crate::discover::{find_adapters, find_stations};
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
}

/// Reason why the device is not found.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub(super) enum TargetError {
    /// The option does not name a device of the bus.
    #[error("--at `{0}`: must be {1}")]
    At(String, &'static str),
    /// No device has the identity.
    #[error(
        "no {0} device of the file's identity answers on this network; check cable and power, or give --at"
    )]
    None(&'static str),
    /// Several devices have it.
    #[error("{0} devices of the file's identity answer: {1}; choose one with --at")]
    Several(usize, String),
    /// No station has the name.
    #[error("no station is called `{0}`; stations that answer: {1}")]
    NoStation(String, String),
    /// Several stations have the name.
    #[error("{0} stations are called `{1}`: {2}; rename one of them")]
    Twins(usize, String, String),
    /// The station has no address.
    #[error("station `{0}` has no IP address; give it one with --address")]
    NoStationAddress(String),
    /// The device does not report its modules.
    #[error("the device does not report its modules: {0}; give them with --module")]
    NoModules(String),
}

impl TargetError {
    /// Returns true for an error of the command line.
    pub(super) const fn is_usage(&self) -> bool {
        matches!(self, Self::At(..) | Self::NoStationAddress(_) | Self::Several(..))
    }
}

impl DeviceTarget {
    pub(super) fn find(
        file: &DeviceFile,
        interface: &Interface,
        at: Option<&str>,
        address: Option<Ipv4Addr>,
    ) -> anyhow::Result<Self> {
        match (file, at) {
            (DeviceFile::Gsdml(gsdml), at) => Self::station(gsdml, interface, at, address),
            (DeviceFile::Eds(_), Some(at)) => {
                let parsed = at.parse().ok();
                let wrong = || TargetError::At(printable(at.as_bytes()), "an IPv4 address, as 192.168.0.2");
                Ok(Self { address: Some(parsed.ok_or_else(wrong)?), ..Self::default() })
            }
            (DeviceFile::Eds(eds), None) => {
                let found = find_adapters(interface, SEARCH)?;
                let is_its = |key: &ethernet_ip::cip::ElectronicKey| {
                    (key.vendor, key.product_code) == (eds.vendor_id, eds.product_code)
                };
                let mut its: Vec<_> =
                    found.iter().filter(|it| is_its(&it.identity.key)).map(|it| it.address).collect();
                its.dedup();
                match its.as_slice() {
                    [only] => Ok(Self { address: Some(*only), ..Self::default() }),
                    [] => Err(TargetError::None(bus_of(file)).into()),
                    several => {
                        let list: Vec<_> = several.iter().map(Ipv4Addr::to_string).collect();
                        Err(TargetError::Several(several.len(), list.join(", ")).into())
                    }
                }
            }
            // The MainDevice names other devices on the cable itself.
            (DeviceFile::Esi(_), None | Some("1")) => Ok(Self::default()),
            (DeviceFile::Esi(_), Some(at)) => {
                let must = "1: the device must be alone on the cable";
                Err(TargetError::At(printable(at.as_bytes()), must).into())
            }
        }
    }

    fn station(
        gsdml: &Gsdml,
        interface: &Interface,
        at: Option<&str>,
        address: Option<Ipv4Addr>,
    ) -> anyhow::Result<Self> {
        let found = find_stations(interface, SEARCH)?;
        let name = |station: &FoundStation| printable(&station.name);
        let list = |stations: &[&FoundStation], text: fn(&FoundStation) -> String| {
            let texts: Vec<_> = stations.iter().take(12).map(|it| text(it)).collect();
            if texts.is_empty() { "none".to_owned() } else { texts.join(", ") }
        };
        let all: Vec<_> = found.iter().collect();
        let its: Vec<_> = match at {
            Some(at) => all.iter().copied().filter(|it| &*it.name == at.as_bytes()).collect(),
            None => {
                let identity = Some((gsdml.vendor_id, gsdml.device_id));
                all.iter().copied().filter(|it| it.identity == identity).collect()
            }
        };
        let station = match (its.as_slice(), at) {
            ([only], _) => *only,
            ([], Some(at)) => {
                return Err(TargetError::NoStation(
                    printable(at.as_bytes()),
                    list(&all, |it| printable(&it.name)),
                )
                .into());
            }
            ([], None) => return Err(TargetError::None("PROFINET").into()),
            (several, Some(at)) => {
                let macs = list(several, |it| it.mac.to_string());
                return Err(TargetError::Twins(several.len(), printable(at.as_bytes()), macs).into());
            }
            (several, None) => {
                return Err(
                    TargetError::Several(several.len(), list(several, |it| printable(&it.name))).into()
                );
            }
        };
        let its_address = station.ip.map(|ip| ip.address).filter(|address| !address.is_unspecified());
        let address = address.or(its_address).ok_or_else(|| TargetError::NoStationAddress(name(station)))?;
        let station_name = String::from_utf8(station.name.to_vec()).ok();
        Ok(Self { address: Some(address), station_name })
    }
}

/// Makes the device of the choice; on PROFINET without chosen modules, of those that it reports.
pub(super) fn choose_device(
    file: &DeviceFile,
    choice: &DeviceChoice,
    interface: &Interface,
    config: &DriveConfig,
) -> anyhow::Result<Choice> {
    match file {
        DeviceFile::Gsdml(gsdml) if choice.modules.is_empty() => {
            let head = ChosenDevice::Gsdml(choose_head(gsdml, choice)?);
            let found = read_modules(file, head, interface, config)?;
            let (device, unknown) = choose_found(gsdml, choice, &found)?;
            Ok((ChosenDevice::Gsdml(device), unknown))
        }
        _ => Ok((choose(file, choice)?, Vec::new())),
    }
}

/// Connects to the access point alone, and reads which modules the device has.
fn read_modules(
    file: &DeviceFile,
    head: ChosenDevice,
    interface: &Interface,
    config: &DriveConfig,
) -> anyhow::Result<Vec<FoundModule>> {
    let config = DriveConfig { is_running: false, ..config.clone() };
    let mut device = DrivenDevice::new(file.clone(), head, OutputScript::default(), &config, clock::now())?;
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

impl Owner<DrivenDevice> for ModuleReader {
    fn wake(&mut self, now: Instant, _: &mut DrivenDevice, _: &Statistics) -> ControlFlow<()> {
        if self.until <= now { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }

    fn event(&mut self, now: Instant, device: &mut DrivenDevice, event: DriveEvent) -> ControlFlow<()> {
        match event {
            DriveEvent::Answer(answer) => {
                match answer.result {
                    Ok(ParameterValue { raw: SignalValue::Bytes(record), .. }) => {
                        self.found = found_modules(&record)
                    }
                    Ok(_) => {}
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
