//! `plc-node set-name`, `set-ip` and `flash`: name, address and lamp of a PROFINET station, for commissioning; the address also of an
//! EtherNet/IP adapter.

use std::io::{BufRead as _, IsTerminal as _};
use std::net::Ipv4Addr;

use machine::Duration;
use machine::ethernet::Mac;
use node::Outcome;
use node::output::to_stdout;
use profinet::dcp::IpSuite;
use profinet::{
    FoundStation, StationChange, StationSetError, StationSetter, StationSetterConfig, is_station_name,
};
use protocol_linux::{Interface, clock};

use crate::discover::{find_stations, set_station};
use crate::printable::printable;
use crate::set_adapter::{AdapterChange, set_address};
use crate::station_error::StationError;

/// Time for the answers of stations to a question to all of them.
const SEARCH: Duration = Duration::from_millis(1_000);

/// Stations that a message lists.
const MOST_LISTED: usize = 12;

/// Station that is meant.
#[derive(clap::Args, Clone, Debug)]
struct StationOptions {
    /// The network interface.
    #[arg(long, value_name = "IF")]
    interface: String,
    /// The station: its name, its IP address or its MAC address.
    #[arg(long, value_name = "STATION")]
    at: String,
}

/// Options of a change.
#[derive(clap::Args, Clone, Debug)]
struct ChangeOptions {
    /// The station loses it when it is switched off.
    #[arg(long)]
    temporary: bool,
    /// Do not ask.
    #[arg(long)]
    yes: bool,
}

/// A new name for a PROFINET station.
#[derive(clap::Args, Clone, Debug)]
#[command(after_help = EXAMPLES)]
pub(crate) struct SetNameCommand {
    #[command(flatten)]
    station: StationOptions,
    /// The new name.
    name: String,
    #[command(flatten)]
    change: ChangeOptions,
}

/// Bus of a device that gets an address.
#[derive(Clone, Copy, PartialEq, Eq, Debug, clap::ValueEnum)]
enum AddressedBus {
    /// DCP Set.
    Profinet,
    /// Set_Attribute_Single of the TCP/IP Interface object.
    EthernetIp,
}

/// A new IP address for a PROFINET station or an EtherNet/IP adapter.
#[derive(clap::Args, Clone, Debug)]
#[command(after_help = EXAMPLES)]
pub(crate) struct SetIpCommand {
    #[command(flatten)]
    station: StationOptions,
    /// The new IP address.
    address: Ipv4Addr,
    /// Subnet mask; without it, that of the interface.
    #[arg(long, value_name = "MASK")]
    mask: Option<Ipv4Addr>,
    /// Gateway, 0.0.0.0 for none; without it, the one that the station has, if the new address can reach it.
    #[arg(long, value_name = "ADDRESS")]
    gateway: Option<Ipv4Addr>,
    /// The bus of the device. On EtherNet/IP --at is the IP address of an adapter.
    #[arg(long, value_enum, default_value_t = AddressedBus::Profinet)]
    bus: AddressedBus,
    /// Reset an EtherNet/IP adapter that takes a new address only then.
    #[arg(long)]
    reset: bool,
    #[command(flatten)]
    change: ChangeOptions,
}

/// A flashing lamp of a PROFINET station.
#[derive(clap::Args, Clone, Debug)]
#[command(after_help = EXAMPLES)]
pub(crate) struct FlashCommand {
    #[command(flatten)]
    station: StationOptions,
}

const EXAMPLES: &str = "\
Examples:
  plc-node set-name --interface eth1 --at 28:63:36:00:00:07 valve-7
  plc-node set-ip --interface eth1 --at valve-7 192.168.0.7 --mask 255.255.255.0
  plc-node set-ip --bus ethernet-ip --interface eth1 --at 192.168.0.2 192.168.0.7
  plc-node flash --interface eth1 --at valve-7

For PROFINET; set-ip also for EtherNet/IP, which has neither names nor lamps for this. Devices on EtherCAT have a position on the cable in
their place. PROFINET needs raw sockets (root, or the capability CAP_NET_RAW).
Exit codes: 2 if no station or several are meant, or nobody said yes; 4 if the station refuses; 5 if it does not answer.";

impl SetNameCommand {
    /// Gives a station its name, and says what it has then.
    pub(crate) fn execute(self) -> anyhow::Result<Outcome> {
        let name = self.name.to_lowercase();
        if !is_station_name(name.as_bytes()) {
            return Err(StationError::Name(printable(self.name.as_bytes())).into());
        }
        let (interface, found) = self.station.search()?;
        let station = station_among(&found, &self.station.at)?;
        if let Some(other) =
            found.iter().find(|other| other.mac != station.mac && *other.name == *name.as_bytes())
        {
            return Err(StationError::Taken(format!("the name {name}"), other.mac.to_string()).into());
        }
        self.change.ask(&format!("Rename {} to {name}?", describe(station)))?;
        let change = StationChange::Name(name.into_bytes());
        set(&interface, station, change, !self.change.temporary)
    }
}

impl SetIpCommand {
    /// Gives a station its address, and says what it has then.
    pub(crate) fn execute(self) -> anyhow::Result<Outcome> {
        let address = self.address;
        if address.is_unspecified()
            || address.is_multicast()
            || address.is_broadcast()
            || address.is_loopback()
        {
            return Err(StationError::Address(address).into());
        }
        if self.bus == AddressedBus::EthernetIp {
            return self.set_adapter();
        }
        if self.reset {
            return Err(StationError::OtherBus("--reset is for --bus ethernet-ip; leave it out").into());
        }
        let (interface, found) = self.station.search()?;
        let station = station_among(&found, &self.station.at)?;
        let is_its = |other: &&FoundStation| {
            other.mac != station.mac && other.ip.is_some_and(|ip| ip.address == address)
        };
        if let Some(other) = found.iter().find(is_its) {
            return Err(StationError::Taken(format!("the address {address}"), describe(other)).into());
        }
        if interface.address() == Some(address) {
            let own = format!("this computer ({})", interface.name());
            return Err(StationError::Taken(format!("the address {address}"), own).into());
        }
        let mask = self.mask.or_else(|| interface.mask()).unwrap_or(Ipv4Addr::new(255, 255, 255, 0));
        let suite = self.suite(station, mask);
        self.change.ask(&format!("Give {} the address {}?", describe(station), in_words(suite)))?;
        set(&interface, station, StationChange::Address(suite), !self.change.temporary)
    }
}

impl SetIpCommand {
    /// Gives an adapter its address, and says what it has then.
    fn set_adapter(&self) -> anyhow::Result<Outcome> {
        if self.change.temporary {
            return Err(StationError::OtherBus("--temporary is for --bus profinet; leave it out").into());
        }
        let interface = Interface::find(&self.station.interface)?;
        if interface.address() == Some(self.address) {
            let own = format!("this computer ({})", interface.name());
            return Err(StationError::Taken(format!("the address {}", self.address), own).into());
        }
        let mask = self.mask.or_else(|| interface.mask()).unwrap_or(Ipv4Addr::new(255, 255, 255, 0));
        let change = AdapterChange { address: self.address, mask, gateway: self.gateway, resets: self.reset };
        set_address(&interface, &self.station.at, change, |question| self.change.ask(question))
    }

    /// Returns the address, mask and gateway that the station gets. One without a gateway has its own address there (IEC 61158-6-10,
    /// IPParameter).
    fn suite(&self, station: &FoundStation, mask: Ipv4Addr) -> IpSuite {
        let address = self.address;
        let former = station.ip.and_then(gateway_of);
        let kept = former.filter(|gateway| *gateway & mask == address & mask);
        let gateway = self.gateway.or(kept).filter(|gateway| !gateway.is_unspecified());
        IpSuite { address, mask, gateway: gateway.unwrap_or(address) }
    }
}

impl FlashCommand {
    /// Lets a station flash its lamp for three seconds.
    pub(crate) fn execute(self) -> anyhow::Result<Outcome> {
        let (interface, found) = self.station.search()?;
        set(&interface, station_among(&found, &self.station.at)?, StationChange::Flash, false)
    }
}

impl StationOptions {
    fn search(&self) -> anyhow::Result<(Interface, Vec<FoundStation>)> {
        let interface = Interface::find(&self.interface)?;
        let found = find_stations(&interface, SEARCH)?;
        Ok((interface, found))
    }
}

impl ChangeOptions {
    /// Asks on a terminal whether to go on.
    fn ask(&self, question: &str) -> anyhow::Result<()> {
        if self.yes {
            return Ok(());
        }
        if !std::io::stdin().is_terminal() {
            return Err(StationError::NotAgreed.into());
        }
        to_stdout(format_args!("{question} A running connection to it may end. [yes/no] "))?;
        let mut answer = String::new();
        std::io::stdin().lock().read_line(&mut answer)?;
        match answer.trim() {
            "y" | "yes" => Ok(()),
            _ => Err(StationError::NotAgreed.into()),
        }
    }
}

/// Returns the gateway of a station; `None` for 0.0.0.0 and its own address.
fn gateway_of(ip: IpSuite) -> Option<Ipv4Addr> {
    Some(ip.gateway).filter(|gateway| !gateway.is_unspecified() && *gateway != ip.address)
}

fn in_words(ip: IpSuite) -> String {
    let gateway =
        gateway_of(ip).map_or_else(|| "no gateway".to_owned(), |gateway| format!("gateway {gateway}"));
    format!("{}, mask {}, {gateway}", ip.address, ip.mask)
}

fn describe(station: &FoundStation) -> String {
    let name = if station.name.is_empty() { "without a name".to_owned() } else { printable(&station.name) };
    let address = station.ip.map(|ip| ip.address).filter(|address| !address.is_unspecified());
    let address = address.map_or_else(|| "no address".to_owned(), |address| address.to_string());
    format!("{name} ({}, {address})", station.mac)
}

/// Returns the station that is meant: by name, IP address or MAC address.
fn station_among<'f>(found: &'f [FoundStation], at: &str) -> Result<&'f FoundStation, StationError> {
    let lower = at.to_lowercase();
    let is_meant = |station: &&FoundStation| {
        let ip = station.ip.map(|ip| ip.address.to_string());
        *station.name == *lower.as_bytes()
            || ip.as_deref() == Some(at)
            || station.mac.to_string().to_lowercase() == lower.replace('-', ":")
    };
    let meant: Vec<_> = found.iter().filter(is_meant).collect();
    match meant.as_slice() {
        [station] => Ok(station),
        [] => Err(StationError::None(printable(at.as_bytes()), list(found.iter()))),
        several => {
            Err(StationError::Several(several.len(), printable(at.as_bytes()), list(several.iter().copied())))
        }
    }
}

fn list<'f>(stations: impl Iterator<Item = &'f FoundStation>) -> String {
    let listed: Vec<_> = stations.take(MOST_LISTED).map(describe).collect();
    if listed.is_empty() { "none".to_owned() } else { listed.join(", ") }
}

/// Changes a station, and prints what it answered and what it has then.
fn set(
    interface: &Interface,
    station: &FoundStation,
    change: StationChange,
    is_permanent: bool,
) -> anyhow::Result<Outcome> {
    let start = clock::now();
    let is_flash = change == StationChange::Flash;
    let config = StationSetterConfig {
        mac: interface.mac(),
        station: station.mac,
        // The clock gives each request its own number.
        xid: (start.as_nanos() >> 10) as u32,
        change,
        is_permanent,
    };
    let result = set_station(StationSetter::new(config, start), interface)?;
    if let Err(error) = result {
        node::errln!("{}: {error}", describe(station));
        return Ok(match error {
            StationSetError::NoAnswer => Outcome::EnvironmentUnusable,
            _ => Outcome::RunFailed,
        });
    }
    if is_flash {
        to_stdout(format_args!("{}: it confirms; its lamp flashes for 3 s\n", describe(station)))?;
        return Ok(Outcome::Done);
    }
    to_stdout(format_args!("{}: it confirms\n", describe(station)))?;
    confirm(interface, station.mac)
}

/// Asks the station again what it has, since an address may be refused after the confirmation.
fn confirm(interface: &Interface, mac: Mac) -> anyhow::Result<Outcome> {
    match find_stations(interface, SEARCH)?.iter().find(|station| station.mac == mac) {
        Some(station) => {
            let ip = station.ip.filter(|ip| !ip.address.is_unspecified());
            let rest = ip.map_or_else(String::new, |ip| format!(": {}", in_words(ip)));
            to_stdout(format_args!("now {}{rest}\n", describe(station)))?;
            Ok(Outcome::Done)
        }
        None => {
            node::errln!(
                "{mac}: does not answer any more; look at its lamps, and search with `plc-node discover`"
            );
            Ok(Outcome::EnvironmentUnusable)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn station(last: u8, name: &str, address: u8) -> FoundStation {
        let address = Ipv4Addr::new(192, 168, 0, address);
        let mask = Ipv4Addr::new(255, 255, 255, 0);
        FoundStation {
            mac: Mac([2, 0, 0, 0, 0, last]),
            name: name.as_bytes().into(),
            type_of_station: Box::default(),
            identity: None,
            ip: Some(IpSuite { address, mask, gateway: address }),
            roles: 1,
        }
    }

    #[test]
    fn a_station_is_meant_by_name_address_or_mac_address_and_twins_by_the_last_one_only() {
        let found = [station(1, "valve", 7), station(2, "drive", 8), station(3, "drive", 9)];
        for at in ["valve", "VALVE", "192.168.0.7", "02:00:00:00:00:01", "02-00-00-00-00-01"] {
            assert_eq!(station_among(&found, at).unwrap().mac, found[0].mac, "{at}");
        }
        let said = station_among(&found, "drive").unwrap_err().to_string();
        assert!(
            said.starts_with("2 stations are `drive`: drive (02:00:00:00:00:02, 192.168.0.8), "),
            "{said}"
        );
        assert_eq!(station_among(&found, "02:00:00:00:00:03").unwrap().mac, found[2].mac);
        let said = station_among(&found[..1], "pump").unwrap_err().to_string();
        assert_eq!(
            said,
            "no station is `pump`; stations that answer: valve (02:00:00:00:00:01, 192.168.0.7)"
        );
    }

    #[test]
    fn a_new_address_keeps_the_gateway_that_it_can_reach() {
        let mut valve = station(1, "valve", 7);
        let suite = |valve: &FoundStation, options: &[&str]| {
            let command = ["set-ip", "--interface", "eth1", "--at", "valve"];
            let matches = <SetIpCommand as clap::Args>::augment_args(clap::Command::new("set-ip"))
                .get_matches_from(command.iter().chain(options));
            let command = <SetIpCommand as clap::FromArgMatches>::from_arg_matches(&matches).unwrap();
            in_words(command.suite(valve, Ipv4Addr::new(255, 255, 255, 0)))
        };
        assert_eq!(suite(&valve, &["192.168.0.9"]), "192.168.0.9, mask 255.255.255.0, no gateway");
        valve.ip.as_mut().unwrap().gateway = Ipv4Addr::new(192, 168, 0, 1);
        assert_eq!(suite(&valve, &["192.168.0.9"]), "192.168.0.9, mask 255.255.255.0, gateway 192.168.0.1");
        assert_eq!(suite(&valve, &["192.168.5.9"]), "192.168.5.9, mask 255.255.255.0, no gateway");
        let other = suite(&valve, &["192.168.0.9", "--gateway", "192.168.0.2"]);
        assert_eq!(other, "192.168.0.9, mask 255.255.255.0, gateway 192.168.0.2");
        let none = suite(&valve, &["192.168.0.9", "--gateway", "0.0.0.0"]);
        assert_eq!(none, "192.168.0.9, mask 255.255.255.0, no gateway");
    }
}
