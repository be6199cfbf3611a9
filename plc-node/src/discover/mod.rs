//! `plc-node discover`: lists the devices on a cable, for commissioning. [`find_devices`] finds those on one bus.

mod conflict;
mod find;
mod found_device;
mod listing;
mod sub_device;

use std::collections::BTreeSet;
use std::ops::ControlFlow;

use anyhow::Context as _;
use ethercat_maindevice::Found;
use machine::arp::{self, HolderSearch};
use machine::search::SearchEnded;
use machine::{Duration, Instant, Machine, PortRequest};
use node::Outcome;
use node::errln;
use node::output::to_stdout;
use protocol::search::Search;
use protocol_linux::{Driver, Interface, Notifier, OpenPort, Owner, Statistics, clock};

pub use find::{FoundDevices, find_devices, read_records};
pub(crate) use find::{find_adapters, find_stations, find_sub_devices, set_station};
use listing::{Bus, Hosts, Listing, Skipped};
use sub_device::SubDevices;

/// A cable and how to search it.
#[derive(clap::Args, Debug)]
#[command(after_help = EXAMPLES)]
pub(crate) struct DiscoverCommand {
    /// The network interface that the devices are on.
    #[arg(long, value_name = "IF")]
    interface: String,
    /// Which devices to look for.
    #[arg(long, value_enum, default_value_t = Wanted::All)]
    bus: Wanted,
    /// How long to look, in ms. Devices spread their answers over a quarter of it.
    #[arg(long, value_name = "MS", default_value_t = 2_000, value_parser = clap::value_parser!(u32).range(100..=60_000))]
    timeout: u32,
    /// Print JSON in place of tables.
    #[arg(long)]
    json: bool,
}

const EXAMPLES: &str = "\
Examples:
  plc-node discover --interface eth0
  plc-node discover --interface eth0 --bus profinet --timeout 5000   a large network
  plc-node discover --interface eth0 --json | jq '.profinet[].name'

PROFINET and EtherCAT need raw sockets (root, or the capability CAP_NET_RAW); EtherNet/IP needs an IPv4 address on the
interface. SubDevices of EtherCAT stay in their states; do not search where a MainDevice of this host uses the interface.
A bus that cannot be asked is skipped with a warning. `!` marks names, addresses and serial numbers that several devices have. A search that finds nothing ends with exit code 0 too.";

/// Which devices to look for.
#[derive(Clone, Copy, PartialEq, Eq, Debug, clap::ValueEnum)]
enum Wanted {
    /// DCP Identify.
    Profinet,
    /// ListIdentity.
    EthernetIp,
    /// Reading registers and EEPROMs.
    Ethercat,
    /// All of them.
    All,
}

impl Wanted {
    fn includes(self, bus: Bus) -> bool {
        match self {
            Self::Profinet => bus == Bus::Profinet,
            Self::EthernetIp => bus == Bus::EthernetIp,
            Self::Ethercat => bus == Bus::Ethercat,
            Self::All => true,
        }
    }
}

impl DiscoverCommand {
    /// Searches, prints what was found to standard output, and what could not be searched to standard error.
    pub(crate) fn execute(self) -> anyhow::Result<Outcome> {
        let interface = Interface::open(&self.interface)?;
        if !interface.is_up()? {
            anyhow::bail!(
                "network interface `{0}` is switched off, so nothing can answer: `ip link set {0} up`",
                self.interface
            );
        }
        let length = Duration::from_millis(self.timeout.into());
        let mut skipped = Vec::new();
        let search = self.search_by_questions(&interface, length, &mut skipped)?;
        let hosts = search.as_ref().map(|search| ask_hosts(&interface, search)).transpose()?.flatten();
        let ethercat = self.search_ethercat(&interface, length, &mut skipped)?;
        if ethercat.is_none() && search.is_none() {
            let reasons: Vec<_> = skipped.iter().map(|skipped| skipped.reason.as_str()).collect();
            anyhow::bail!("nothing can be asked on `{}`: {}", self.interface, reasons.join("; "));
        }
        for Skipped { bus, reason } in &skipped {
            errln!("warning: {bus} was not searched: {reason}");
        }
        let listing =
            Listing::new(self.interface, self.timeout, search.as_ref(), hosts.as_ref(), ethercat, skipped);
        let text = if self.json { listing.to_json()? } else { listing.to_string() };
        to_stdout(format_args!("{text}"))?;
        Ok(Outcome::Done)
    }

    /// Asks the devices on PROFINET and EtherNet/IP at the same time; `None` if neither can be asked.
    fn search_by_questions(
        &self,
        interface: &Interface,
        length: Duration,
        skipped: &mut Vec<Skipped>,
    ) -> anyhow::Result<Option<Search>> {
        let start = clock::now();
        let (mut profinet, mut ethernet_ip) = (None, None);
        if self.bus.includes(Bus::Profinet) {
            // Opened only to see whether it is possible; the driver opens it again.
            match OpenPort::open(interface, profinet::ETHERNET) {
                Ok(_) => {
                    // The clock gives each search its own transaction numbers.
                    let first_xid = (start.as_nanos() >> 10) as u32;
                    let config = profinet::SearchConfig { mac: interface.mac(), first_xid, length };
                    profinet = Some(profinet::Search::new(config, start));
                }
                Err(error) => skipped.push(Skipped { bus: Bus::Profinet, reason: error.to_string() }),
            }
        }
        if self.bus.includes(Bus::EthernetIp) {
            match ethernet_ip_search(interface, length) {
                Ok(config) => ethernet_ip = Some(ethernet_ip::Search::new(config, start)),
                Err(error) => skipped.push(Skipped { bus: Bus::EthernetIp, reason: format!("{error:#}") }),
            }
        }
        if profinet.is_none() && ethernet_ip.is_none() {
            return Ok(None);
        }
        let search = Search::new(profinet, ethernet_ip);
        Ok(Some(searched(search, interface, UntilSearchEnded)?.0))
    }

    /// Looks for SubDevices on EtherCAT; `None` if they are not looked for.
    fn search_ethercat(
        &self,
        interface: &Interface,
        length: Duration,
        skipped: &mut Vec<Skipped>,
    ) -> anyhow::Result<Option<SubDevices>> {
        if !self.bus.includes(Bus::Ethercat) {
            return Ok(None);
        }
        let port = PortRequest::AnyEthernet { ether_type: ethercat_maindevice::ETHER_TYPE };
        if let Err(error) = OpenPort::open(interface, port) {
            skipped.push(Skipped { bus: Bus::Ethercat, reason: error.to_string() });
            return Ok(None);
        }
        let search = ethercat_maindevice::search(clock::now(), length).on_interface(interface.mac());
        let (_, UntilFound(found)) = searched(search, interface, UntilFound(None))?;
        Ok(found.map(SubDevices::from))
    }
}

/// Asks by ARP which stations have the addresses of the devices that were found; `None` if that may not be asked.
fn ask_hosts(interface: &Interface, search: &Search) -> anyhow::Result<Option<Hosts>> {
    let stations = search.profinet().map(|search| search.answers().devices()).unwrap_or_default();
    let devices = search.ethernet_ip().map(|search| search.answers().devices()).unwrap_or_default();
    let of_stations = stations.iter().filter_map(|station| station.ip.map(|ip| ip.address));
    let addresses: BTreeSet<_> = of_stations.chain(devices.iter().map(|device| device.address)).collect();
    let addresses: Vec<_> = addresses.into_iter().filter(|address| !address.is_unspecified()).collect();
    if addresses.is_empty() {
        return Ok(Some(Hosts::new()));
    }
    // The warning about PROFINET, or the column of the table, says that raw sockets are not allowed.
    if OpenPort::open(interface, arp::ETHERNET).is_err() {
        return Ok(None);
    }
    let (mac, own) = (interface.mac(), interface.address());
    let search = HolderSearch::new(mac, own, addresses, clock::now());
    let (search, _) = searched(search, interface, UntilSearchEnded)?;
    let mut hosts: Hosts = search.found().collect();
    // A device may have the address of this interface.
    if let Some(macs) = own.and_then(|own| hosts.get_mut(&own)) {
        macs.push(mac);
    }
    Ok(Some(hosts))
}

/// Runs a search until its owner ends it, and returns both.
fn searched<M: Machine, O: Owner<M>>(
    search: M,
    interface: &Interface,
    mut owner: O,
) -> anyhow::Result<(M, O)> {
    let mut driver = Driver::new(search, Interface::open(interface.name())?, Notifier::new()?)?;
    driver.run(&mut owner)?;
    let statistics = driver.statistics();
    if statistics.sent == 0
        && let Some(error) = statistics.last_send_error
    {
        anyhow::bail!("no question left `{}`: {error}; is the cable plugged in?", interface.name());
    }
    Ok((driver.into_machine(), owner))
}

/// Returns the configuration of the search on EtherNet/IP. It uses a port that the kernel chooses, since a node on
/// this host may use the standard ones.
fn ethernet_ip_search(interface: &Interface, length: Duration) -> anyhow::Result<ethernet_ip::SearchConfig> {
    let name = interface.name();
    let (address, mask) = interface.address().zip(interface.mask()).with_context(|| {
        format!(
            "interface `{name}` has no IPv4 address, so devices could not answer: \
             `ip address add 192.168.64.1/24 dev {name}`, with an address of the devices' subnet"
        )
    })?;
    Ok(ethernet_ip::SearchConfig::from_address(0, address, mask, length))
}

/// Waits for the search to end.
struct UntilSearchEnded;

impl<M: Machine<Event = SearchEnded>> Owner<M> for UntilSearchEnded {
    fn wake(&mut self, _: Instant, _: &mut M, _: &Statistics) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }

    fn event(&mut self, _: Instant, _: &mut M, _: SearchEnded) -> ControlFlow<()> {
        ControlFlow::Break(())
    }
}

/// Waits for what the search found.
struct UntilFound(Option<Found>);

impl<M: Machine<Event = Found>> Owner<M> for UntilFound {
    fn wake(&mut self, _: Instant, _: &mut M, _: &Statistics) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }

    fn event(&mut self, _: Instant, _: &mut M, found: Found) -> ControlFlow<()> {
        self.0 = Some(found);
        ControlFlow::Break(())
    }
}
