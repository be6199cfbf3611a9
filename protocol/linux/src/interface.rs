//! A network interface: its MAC address, its IP address, and whether it is up.

mod gateway;
mod neighbour;
mod status;

use std::net::Ipv4Addr;
use std::os::fd::{AsFd, AsRawFd, OwnedFd};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use rustix::io::Errno;
use rustix::net::{AddressFamily, SocketFlags, SocketType, netdevice, socket_with};

use machine::ethernet::Mac;

/// Flag of an interface that is up.
const UP: libc::c_short = libc::IFF_UP as libc::c_short;

/// Why an interface cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum InterfaceError {
    /// No interface has this name.
    #[error("there is no network interface `{name}`; there are: {}", known.join(", "))]
    NotFound {
        /// The name that was asked for.
        name: String,
        /// The names that there are.
        known: Vec<String>,
    },
    /// No interface has this address, or several have it.
    #[error(
        "{} has the address {address}; there are: {}",
        if *several { "more than one network interface" } else { "no network interface" },
        known.join(", ")
    )]
    NotByAddress {
        /// The address that was asked for.
        address: Ipv4Addr,
        /// Whether several have it.
        several: bool,
        /// The interfaces that there are, with their addresses.
        known: Vec<String>,
    },
    /// It already has an address, and not the one of the setup.
    #[error(
        "interface `{name}` has the address {found}, but the setup's {key} is {wanted}: use another interface or a setup \
         with that address{}",
        if *is_left_over {
            format!("; if nothing else uses it, `ip -4 address flush dev {name}` removes it")
        } else {
            String::new()
        }
    )]
    OtherAddress {
        /// The interface.
        name: String,
        /// The address that it has.
        found: Ipv4Addr,
        /// The setup's key.
        key: &'static str,
        /// The address there.
        wanted: Ipv4Addr,
        /// Whether it is probably left over from a node: it is in the setup's subnet, and no route leads through it to
        /// another network. Only such an address may be removed without cutting the user's own connection.
        is_left_over: bool,
    },
    /// The kernel refuses to read or change the interface.
    #[error("{action} of network interface `{name}`: {reason}{}", hint(reason))]
    Refused {
        /// The interface.
        name: String,
        /// What was being done.
        action: &'static str,
        /// What the kernel said.
        reason: std::io::Error,
    },
}

fn hint(error: &std::io::Error) -> &'static str {
    if error.kind() == std::io::ErrorKind::PermissionDenied {
        "; run as root, or give the program the capability CAP_NET_ADMIN"
    } else {
        ""
    }
}

/// Reads the kernel's table of routes of this thread's network.
fn routes() -> std::io::Result<String> {
    std::fs::read_to_string("/proc/thread-self/net/route")
}

/// Returns whether the kernel's table of routes has one through this interface to a gateway.
fn has_gateway(routes: &str, interface: &str) -> bool {
    let mut fields = routes.lines().skip(1).map(str::split_ascii_whitespace);
    // Interface, destination, gateway.
    fields.any(|mut fields| fields.next() == Some(interface) && fields.nth(1) != Some("00000000"))
}

/// A network interface of the namespace in which it was opened.
#[derive(Clone, Debug)]
pub struct Interface {
    name: String,
    index: u32,
    mac: Mac,
    /// Socket for interface requests; its kind does not matter.
    control: Arc<OwnedFd>,
    /// The last address that [`set_address`](Self::set_address) gave it; 0 for none.
    given: Arc<AtomicU32>,
}

impl Interface {
    /// Finds an interface by its name or by its IPv4 address.
    ///
    /// The address helps where interface names are not predictable: in a container with two networks.
    pub fn find(name_or_address: &str) -> Result<Self, InterfaceError> {
        let Ok(address) = name_or_address.parse() else { return Self::open(name_or_address) };
        // An interface that disappears meanwhile does not have the address.
        let all: Vec<_> = names().iter().filter_map(|name| Self::open(name).ok()).collect();
        let mut found = all.iter().filter(|interface| interface.address() == Some(address));
        match (found.next(), found.next()) {
            (Some(interface), None) => Ok(interface.clone()),
            (_, second) => Err(InterfaceError::NotByAddress {
                address,
                several: second.is_some(),
                known: all.iter().map(Self::with_address).collect(),
            }),
        }
    }

    fn with_address(&self) -> String {
        let address = self.address().map_or_else(|| "no address".to_owned(), |address| address.to_string());
        format!("{} ({address})", self.name)
    }

    /// Finds the interface `name`.
    pub fn open(name: &str) -> Result<Self, InterfaceError> {
        let refused = |action| {
            move |reason: Errno| InterfaceError::Refused {
                name: name.to_owned(),
                action,
                reason: reason.into(),
            }
        };
        let control = socket_with(AddressFamily::INET, SocketType::DGRAM, SocketFlags::CLOEXEC, None)
            .map_err(refused("opening a socket to ask for the properties"))?;
        let index = match netdevice::name_to_index(&control, name) {
            Ok(index) => index,
            Err(Errno::NODEV) => {
                return Err(InterfaceError::NotFound { name: name.to_owned(), known: names() });
            }
            Err(error) => return Err(refused("reading the index")(error)),
        };
        let mut interface = Self {
            name: name.to_owned(),
            index,
            mac: Mac::default(),
            control: Arc::new(control),
            given: Arc::default(),
        };
        interface.mac = interface.read_mac().map_err(refused("reading the hardware address"))?;
        Ok(interface)
    }

    /// Returns its name, such as `eth0`.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Returns the kernel's index of it.
    #[must_use]
    pub const fn index(&self) -> u32 {
        self.index
    }

    /// Returns its MAC address.
    #[must_use]
    pub const fn mac(&self) -> Mac {
        self.mac
    }

    /// Returns whether the interface still exists. It does after its cable was pulled; a removed adapter does not.
    #[must_use]
    pub fn exists(&self) -> bool {
        netdevice::index_to_name_inlined(&*self.control, self.index).is_ok()
    }

    /// Returns its IPv4 address, if it has one.
    #[must_use]
    pub fn address(&self) -> Option<Ipv4Addr> {
        self.read_ipv4(libc::SIOCGIFADDR)
    }

    /// Returns the subnet mask of its IPv4 address, if it has one.
    #[must_use]
    pub fn mask(&self) -> Option<Ipv4Addr> {
        self.read_ipv4(libc::SIOCGIFNETMASK)
    }

    /// Replaces its IPv4 address by this one; the unspecified address only removes it.
    ///
    /// Needs `CAP_NET_ADMIN`. Does not allocate unless it fails.
    pub fn set_address(&self, address: Ipv4Addr, mask: Ipv4Addr) -> Result<(), InterfaceError> {
        // Setting the same address again would drop its routes and neighbours.
        if self.address().unwrap_or(Ipv4Addr::UNSPECIFIED) == address
            && (address.is_unspecified() || self.mask() == Some(mask))
        {
            return Ok(());
        }
        self.write_ipv4(libc::SIOCSIFADDR, address)
            .map_err(|e| self.refused("setting the IPv4 address", e))?;
        self.given.store(address.to_bits(), Ordering::Relaxed);
        if address.is_unspecified() {
            return Ok(());
        }
        self.write_ipv4(libc::SIOCSIFNETMASK, mask).map_err(|e| self.refused("setting the subnet mask", e))
    }

    /// Sets the address that a setup gives under `key`, unless the interface has another address: replacing that
    /// could cut the user's own connection. Needs the same capability as [`set_address`](Self::set_address).
    pub fn take_address(
        &self,
        key: &'static str,
        wanted: Ipv4Addr,
        mask: Ipv4Addr,
    ) -> Result<(), InterfaceError> {
        match self.address().filter(|found| *found != wanted) {
            Some(found) => {
                let is_in_subnet = found & mask == wanted & mask;
                let is_left_over = is_in_subnet && !self.leads_to_other_networks();
                let name = self.name.clone();
                Err(InterfaceError::OtherAddress { name, found, key, wanted, is_left_over })
            }
            None => self.set_address(wanted, mask),
        }
    }

    /// Returns whether its address is the one that [`set_address`](Self::set_address) gave it, and nobody changed it since.
    pub(crate) fn has_given_address(&self) -> bool {
        self.address().is_some_and(|address| address.to_bits() == self.given.load(Ordering::Relaxed))
    }

    /// Returns whether a route leads through it to a gateway; also where the kernel does not show its routes.
    fn leads_to_other_networks(&self) -> bool {
        routes().map_or(true, |routes| has_gateway(&routes, &self.name))
    }

    /// Returns whether it is up, with or without a carrier.
    pub fn is_up(&self) -> Result<bool, InterfaceError> {
        Ok(self.flags()? & UP != 0)
    }

    /// Returns whether it is up and something is at the other end of its cable, so that it can send.
    ///
    /// When a cable gets its other end, the kernel leaves the rest to a background job; until then it discards what is
    /// sent, on a busy host for more than a second. This request finishes that job first.
    pub fn has_carrier(&self) -> Result<bool, InterfaceError> {
        /// `ETHTOOL_GLINK` of linux/ethtool.h.
        const GET_LINK: u32 = 0x0A;
        let link = self.ethtool(GET_LINK, 0).map_err(|error| self.refused("reading the carrier", error))?;
        Ok(link != 0)
    }

    /// Brings it up, as `ip link set … up` does. Needs `CAP_NET_ADMIN`, unless it is up already.
    pub fn set_up(&self) -> Result<(), InterfaceError> {
        self.switch(true)
    }

    /// Takes it down: the other end of its cable loses its carrier. Needs `CAP_NET_ADMIN`, unless it is down already.
    pub fn set_down(&self) -> Result<(), InterfaceError> {
        self.switch(false)
    }

    fn switch(&self, on: bool) -> Result<(), InterfaceError> {
        let flags = self.flags()?;
        if (flags & UP != 0) == on {
            return Ok(());
        }
        let mut request = self.request();
        request.ifr_ifru.ifru_flags = if on { flags | UP } else { flags & !UP };
        let action = if on { "switching on" } else { "switching off" };
        self.ioctl(libc::SIOCSIFFLAGS, &mut request).map_err(|error| self.refused(action, error))
    }

    /// Makes the kernel fill in the checksums of what this interface sends. A veth omits them, since no bit can flip
    /// between its ends; a program that forwards frames by raw sockets then forwards them without checksums. Large
    /// TCP segments are split before they are sent from then on. Needs `CAP_NET_ADMIN`.
    pub fn fill_in_checksums(&self) -> Result<(), InterfaceError> {
        /// `ETHTOOL_STXCSUM` of linux/ethtool.h.
        const SET_TX_CHECKSUMMING: u32 = 0x17;
        self.ethtool(SET_TX_CHECKSUMMING, 0)
            .map(drop)
            .map_err(|error| self.refused("switching checksum offload off", error))
    }

    /// Makes a request with a `struct ethtool_value`, the command and its value. Returns the value that the kernel left
    /// there.
    fn ethtool(&self, command: u32, value: u32) -> std::io::Result<u32> {
        let mut value = [command, value];
        let mut request = self.request();
        request.ifr_ifru.ifru_data = value.as_mut_ptr().cast();
        // `value` outlives the request, and the kernel touches no more than its eight bytes.
        self.ioctl(libc::SIOCETHTOOL, &mut request)?;
        Ok(value[1])
    }

    fn flags(&self) -> Result<libc::c_short, InterfaceError> {
        let mut request = self.request();
        self.ioctl(libc::SIOCGIFFLAGS, &mut request).map_err(|e| self.refused("reading the state", e))?;
        // SAFETY: SIOCGIFFLAGS succeeded, so the kernel wrote `ifru_flags`.
        Ok(unsafe { request.ifr_ifru.ifru_flags })
    }

    fn refused(&self, action: &'static str, reason: std::io::Error) -> InterfaceError {
        InterfaceError::Refused { name: self.name.clone(), action, reason }
    }

    fn read_mac(&self) -> Result<Mac, Errno> {
        let mut request = self.request();
        self.ioctl(libc::SIOCGIFHWADDR, &mut request)
            .map_err(|error| Errno::from_io_error(&error).unwrap_or(Errno::IO))?;
        // SAFETY: SIOCGIFHWADDR succeeded, so the kernel wrote `ifru_hwaddr`.
        let address = unsafe { request.ifr_ifru.ifru_hwaddr };
        let [a, b, c, d, e, f, ..] = address.sa_data.map(|byte| byte as u8);
        Ok(Mac([a, b, c, d, e, f]))
    }

    fn read_ipv4(&self, what: libc::Ioctl) -> Option<Ipv4Addr> {
        let mut request = self.request();
        self.ioctl(what, &mut request).ok()?;
        // SAFETY: the request succeeded, so the kernel wrote `ifru_addr`, with a sockaddr_in in it.
        let address = unsafe { request.ifr_ifru.ifru_addr };
        // A sockaddr_in has the port in the first two bytes after the family, then the address.
        let [_, _, a, b, c, d, ..] = address.sa_data.map(|byte| byte as u8);
        Some(Ipv4Addr::new(a, b, c, d))
    }

    fn write_ipv4(&self, what: libc::Ioctl, address: Ipv4Addr) -> std::io::Result<()> {
        let mut request = self.request();
        request.ifr_ifru.ifru_addr = socket_address(address);
        self.ioctl(what, &mut request)
    }

    /// Returns an empty request about this interface.
    fn request(&self) -> libc::ifreq {
        let mut name = [0; libc::IFNAMSIZ];
        for (to, from) in name.iter_mut().take(libc::IFNAMSIZ - 1).zip(self.name.bytes()) {
            *to = from as libc::c_char;
        }
        let nothing = libc::sockaddr { sa_family: 0, sa_data: [0; 14] };
        libc::ifreq { ifr_name: name, ifr_ifru: libc::__c_anonymous_ifr_ifru { ifru_addr: nothing } }
    }

    fn ioctl(&self, what: libc::Ioctl, request: &mut libc::ifreq) -> std::io::Result<()> {
        // SAFETY: `control` is an open socket, and every request used in this file takes one `ifreq`, which the
        // kernel reads and writes during the call only, as it does what it points to.
        let result = unsafe { libc::ioctl(self.control.as_fd().as_raw_fd(), what, request) };
        if result < 0 { Err(std::io::Error::last_os_error()) } else { Ok(()) }
    }
}

/// Returns the `sockaddr_in` of an address, without a port: the address comes after the two bytes of that.
fn socket_address(address: Ipv4Addr) -> libc::sockaddr {
    let mut data = [0; 14];
    for (to, from) in data.iter_mut().skip(2).zip(address.octets()) {
        *to = from as libc::c_char;
    }
    libc::sockaddr { sa_family: libc::AF_INET as libc::sa_family_t, sa_data: data }
}

/// Returns the interfaces of this thread's network namespace. `/sys/class/net` would list those of the process that
/// mounted it.
fn names() -> Vec<String> {
    let table = std::fs::read_to_string("/proc/thread-self/net/dev").unwrap_or_default();
    let names = table.lines().skip(2).filter_map(|line| line.split_once(':'));
    names.map(|(name, _)| name.trim().to_owned()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_error_for_an_unknown_interface_lists_the_existing_ones() {
        let error = Interface::open("nosuch0").unwrap_err().to_string();
        assert!(error.contains("`nosuch0`") && error.contains("lo"), "{error}");
    }

    #[test]
    fn an_interface_is_also_found_by_its_address() {
        assert_eq!(Interface::find("lo").unwrap().name(), "lo");
        assert_eq!(Interface::find("127.0.0.1").unwrap().name(), "lo");
        let error = Interface::find("203.0.113.9").unwrap_err().to_string();
        assert!(
            error.contains("no network interface has the address 203.0.113.9")
                && error.contains("lo (127.0.0.1)"),
            "{error}"
        );
    }

    #[test]
    fn the_removal_of_an_address_is_advised_only_where_it_cuts_no_connection() {
        let lo = Interface::open("lo").unwrap();
        let mask = Ipv4Addr::new(255, 255, 255, 0);
        let refusal = |wanted| lo.take_address("bus.plc_address", wanted, mask).unwrap_err().to_string();
        let other = refusal(Ipv4Addr::new(192, 168, 64, 1));
        assert!(other.ends_with("use another interface or a setup with that address"), "{other}");
        // The second address of a setup, left by a node that ran here before.
        let left_over = refusal(Ipv4Addr::new(127, 0, 0, 2));
        assert!(left_over.ends_with("`ip -4 address flush dev lo` removes it"), "{left_over}");
        let routes = "Iface\tDestination\tGateway\tFlags\n\
                      eth1\t0040A8C0\t00000000\t0001\n\
                      eth0\t00000000\t010200C0\t0003\n";
        assert_eq!(["eth0", "eth1", "eth2"].map(|name| has_gateway(routes, name)), [true, false, false]);
    }

    #[test]
    fn the_loopback_has_no_hardware_address_and_the_usual_ip_address() {
        let lo = Interface::open("lo").unwrap();
        assert_eq!(lo.mac(), Mac([0; 6]));
        assert!(lo.exists());
        assert_eq!(lo.address(), Some(Ipv4Addr::LOCALHOST));
    }
}
