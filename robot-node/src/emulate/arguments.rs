//! The devices of the command line: each file with the options after it.

use std::net::Ipv4Addr;
use std::path::PathBuf;

use device_files::ChosenDevice;
use emulated_device::{DeviceScript, EmulationConfig};
use machine::ethernet::Mac;
use node::device_options::{DeviceOptions, read_toml};
use node::grouped_arguments::{Grouped, Groups};

/// A device, and what is said of it.
#[derive(clap::Args, Clone, Debug)]
pub(super) struct EmulatedArguments {
    #[command(flatten)]
    pub(super) device: DeviceOptions,
    /// Emulate so many of this device.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..))]
    count: Option<u8>,
    /// Inputs and faults over time, a TOML file.
    #[arg(long, value_name = "FILE.toml")]
    script: Option<PathBuf>,
    /// PROFINET: the station name; without it, that of the file.
    ///
    /// Of several devices the second one has it with -2, and so on.
    #[arg(long, value_name = "NAME")]
    station_name: Option<String>,
    /// The serial number; without it, the number of the device on the command line, from 1.
    #[arg(long, value_name = "N")]
    serial_number: Option<u32>,
    /// The IP address, at a MAC address of its own; without it, that of the interface.
    ///
    /// With --count the next ones have the next addresses.
    #[arg(long, value_name = "ADDRESS")]
    address: Option<Ipv4Addr>,
}

impl Grouped for EmulatedArguments {
    const FIRST: &'static str = "file";
    const WRITTEN: &'static str = "FILE";
}

/// Arguments that do not fit together.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub(super) enum ArgumentError {
    /// The choice of several devices is to be printed.
    #[error("--print-config: several devices; print the choice of one device at a time")]
    SeveralConfigs,
    /// A SubDevice is to have an IP address.
    #[error("--address {0}: a device on EtherCAT has no IP address; leave it out")]
    OnEthercat(Ipv4Addr),
    /// The addresses of several devices leave their subnet.
    #[error(
        "--address: device {number} would have {address}, which is not one of a station in the subnet with mask {mask}; begin lower"
    )]
    OutsideSubnet {
        /// Number of the device, from 1.
        number: usize,
        /// Its address.
        address: Ipv4Addr,
        /// Mask of the interface.
        mask: Ipv4Addr,
    },
    /// Two devices have one address.
    #[error("--address: devices {0} and {1} would have {2}; give each its own")]
    Twice(usize, usize, Ipv4Addr),
}

/// Checks that the addresses of several devices are of stations in one subnet, each of one device.
///
/// # Errors
///
/// One is not.
pub(super) fn check_addresses(configs: &[EmulationConfig]) -> Result<(), ArgumentError> {
    let mut known: Vec<(usize, Ipv4Addr)> = Vec::new();
    for (number, config) in (1..).zip(configs) {
        let (Some(address), mask) = (config.address, config.mask) else { continue };
        if let Some((other, _)) = known.iter().find(|(_, known)| *known == address) {
            return Err(ArgumentError::Twice(*other, number, address));
        }
        let host_part = address & !mask;
        let is_station = mask.to_bits().count_ones() > 30 || host_part.to_bits() != 0 && host_part != !mask;
        let is_beside = known.first().is_none_or(|(_, first)| *first & mask == address & mask);
        if !is_station || !is_beside {
            return Err(ArgumentError::OutsideSubnet { number, address, mask });
        }
        known.push((number, address));
    }
    Ok(())
}

/// All devices of the command line.
pub(super) type AllDevices = Groups<EmulatedArguments>;

/// Devices of one file and choice.
#[derive(Clone, Debug)]
pub(super) struct DeviceGroup {
    pub(super) chosen: ChosenDevice,
    pub(super) script: DeviceScript,
    /// Number of the first one, from 1, and how many there are.
    pub(super) first: usize,
    pub(super) count: usize,
    station_name: Option<String>,
    serial_number: Option<u32>,
    pub(super) address: Option<Ipv4Addr>,
}

/// Reads the files and makes the chosen devices.
///
/// # Errors
///
/// A file cannot be read or is refused, or its choice makes no device.
pub(super) fn groups(devices: &AllDevices) -> anyhow::Result<Vec<DeviceGroup>> {
    let mut first = 1;
    let group = |of: &EmulatedArguments| {
        let count = of.count.map_or(1, usize::from);
        let chosen = of.device.choose()?;
        if let (ChosenDevice::Esi(_), Some(address)) = (&chosen, of.address) {
            return Err(ArgumentError::OnEthercat(address).into());
        }
        let group = DeviceGroup {
            chosen,
            script: read_toml(of.script.as_deref(), DeviceScript::from_toml)?,
            first,
            count,
            station_name: of.station_name.clone(),
            serial_number: of.serial_number,
            address: of.address,
        };
        first += count;
        Ok(group)
    };
    devices.0.iter().map(group).collect()
}

impl DeviceGroup {
    /// Returns the settings of the device of an index in the group: its identity, beside those that all devices have.
    pub(super) fn config(&self, index: usize, is_alone: bool, common: &EmulationConfig) -> EmulationConfig {
        let number = self.first + index;
        let name = match &self.chosen {
            ChosenDevice::Gsdml(device) => Some(device.station_name.to_lowercase()),
            _ => None,
        };
        let given = self.station_name.clone();
        let name = match (given.is_some(), is_alone, index) {
            // A file may have a name that DCP refuses; alone the device itself takes or leaves it.
            (false, true, _) => None,
            // Devices of one file without a name of their own are numbered through.
            (false, false, _) if number > 1 => name.map(|name| format!("{name}-{number}")),
            (true, _, 1..) => given.map(|name| format!("{name}-{}", index + 1)),
            _ => given.or(name),
        };
        let offset = u32::try_from(index).unwrap_or(u32::MAX);
        let own = u32::try_from(number).unwrap_or(u32::MAX);
        EmulationConfig {
            mac: if self.address.is_some() || !is_alone { own_mac(common.mac, number) } else { common.mac },
            address: self.own_address(index).or(common.address.filter(|_| is_alone)),
            station_name: name.map(String::into_bytes),
            serial_number: self.serial_number.map_or(own, |first| first.wrapping_add(offset)),
            // Connections of different devices have different numbers.
            first_id: common.first_id.wrapping_add(own << 16),
            ..common.clone()
        }
    }

    /// Returns the IP address of the device of an index, if the command line gives it one.
    fn own_address(&self, index: usize) -> Option<Ipv4Addr> {
        let offset = u32::try_from(index).ok()?;
        Some(Ipv4Addr::from_bits(self.address?.to_bits().checked_add(offset)?))
    }
}

/// Returns a locally administered MAC address (IEEE 802, 8.4) that belongs to one device of this interface.
pub(super) fn own_mac(Mac([_, _, _, a, b, c]): Mac, number: usize) -> Mac {
    Mac([0x02, number as u8, 0x5B, a, b, c])
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct EmulateLine {
        #[command(flatten)]
        devices: AllDevices,
    }

    fn parsed(line: &str) -> Vec<DeviceGroup> {
        let files = format!("{}/../scripts/interop/files/", env!("CARGO_MANIFEST_DIR"));
        let line = line.replace("@", &files);
        let words = std::iter::once("emulate").chain(line.split_whitespace());
        groups(&EmulateLine::try_parse_from(words).unwrap().devices).unwrap()
    }

    fn common() -> EmulationConfig {
        EmulationConfig {
            mac: Mac([0x28, 0x63, 0x36, 1, 2, 3]),
            address: Some(Ipv4Addr::new(192, 168, 64, 2)),
            mask: Ipv4Addr::new(255, 255, 255, 0),
            gateway: Ipv4Addr::UNSPECIFIED,
            station_name: None,
            permanent: None,
            serial_number: 0,
            first_id: 1,
        }
    }

    #[test]
    fn a_device_alone_has_the_addresses_of_the_interface() {
        let [group] = &parsed("@made-up-adapter.eds")[..] else { panic!("one device") };
        let config = group.config(0, true, &common());
        assert_eq!((config.mac, config.address), (common().mac, common().address));
        assert_eq!((config.station_name, config.serial_number), (None, 1));
    }

    #[test]
    fn each_of_several_devices_has_its_own_name_addresses_and_serial_number() {
        let line = "@GSDML-V2.35-made-up-io-20260101.xml --module 1=M_8DI --count 2 --address 192.168.64.253 \
                    @GSDML-V2.35-made-up-io-20260101.xml --module 2=M_2AO --station-name valve --count 2 --serial-number 70";
        let groups = parsed(line);
        let configs: Vec<_> = groups
            .iter()
            .flat_map(|group| (0..group.count).map(|index| group.config(index, false, &common())))
            .collect();
        let names: Vec<_> =
            configs.iter().map(|it| String::from_utf8(it.station_name.clone().unwrap()).unwrap()).collect();
        assert_eq!(names, ["made-up-io", "made-up-io-2", "valve", "valve-2"]);
        assert_eq!(configs.iter().map(|it| it.serial_number).collect::<Vec<_>>(), [1, 2, 70, 71]);
        assert_eq!(configs[1].address, Some(Ipv4Addr::new(192, 168, 64, 254)));
        assert_eq!(check_addresses(&configs), Ok(()));
        assert_eq!(configs[2].address, None, "DCP gives it one");
        let mut macs: Vec<_> = configs.iter().map(|it| it.mac.0).collect();
        assert!(macs.iter().all(|mac| mac[0] & 3 == 2), "locally administered, of one station: {macs:?}");
        macs.sort_unstable();
        macs.dedup();
        assert_eq!(macs.len(), 4);
    }

    #[test]
    fn addresses_that_leave_the_subnet_or_belong_to_two_devices_are_refused() {
        let said = |line: &str| {
            let groups = parsed(line);
            let configs = groups.iter().flat_map(|group| {
                (0..group.count).map(|index| group.config(index, false, &common())).collect::<Vec<_>>()
            });
            check_addresses(&configs.collect::<Vec<_>>()).unwrap_err().to_string()
        };
        assert_eq!(
            said("@made-up-adapter.eds --count 3 --address 192.168.64.253"),
            "--address: device 3 would have 192.168.64.255, which is not one of a station in the subnet with mask 255.255.255.0; begin lower"
        );
        assert_eq!(
            said(
                "@made-up-adapter.eds --count 2 --address 192.168.64.9 @made-up-adapter.eds --address 192.168.64.10"
            ),
            "--address: devices 2 and 3 would have 192.168.64.10; give each its own"
        );
        let files = format!("{}/../scripts/interop/files/", env!("CARGO_MANIFEST_DIR"));
        let words = ["emulate", &format!("{files}made-up-coupler.xml"), "--address", "192.168.64.9"];
        let devices = EmulateLine::try_parse_from(words).unwrap().devices;
        let error = groups(&devices).unwrap_err().to_string();
        assert_eq!(error, "--address 192.168.64.9: a device on EtherCAT has no IP address; leave it out");
    }
}
