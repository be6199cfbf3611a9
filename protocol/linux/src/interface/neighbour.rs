//! The host's table of neighbours: the MAC address at which it reaches an IP address (arp(7)).

use std::io::Error;
use std::net::Ipv4Addr;

use machine::ethernet::Mac;
use rustix::io::Errno;

use super::{Interface, socket_address};
use std::os::fd::{AsFd as _, AsRawFd as _};

impl Interface {
    /// Returns the MAC address to which the host sends what is for this IP address through this interface; `None` if it
    /// would ask by ARP first. Needs no privilege.
    pub fn neighbour(&self, address: Ipv4Addr) -> Result<Option<Mac>, Error> {
        let mut request = self.neighbour_request(address, None);
        match self.change_neighbour(libc::SIOCGARP, &mut request) {
            Ok(()) if request.arp_flags & libc::ATF_COM != 0 => {
                let [a, b, c, d, e, f, ..] = request.arp_ha.sa_data.map(|byte| byte as u8);
                Ok(Some(Mac([a, b, c, d, e, f])))
            }
            // It waits for an answer, or got none.
            Ok(()) => Ok(None),
            Err(error) if Errno::from_io_error(&error) == Some(Errno::NXIO) => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// Makes the host send to this MAC address what is for this IP address, until the neighbour itself names another one.
    /// Needs `CAP_NET_ADMIN`.
    pub fn set_neighbour(&self, address: Ipv4Addr, mac: Mac) -> Result<(), Error> {
        let mut request = self.neighbour_request(address, Some(mac));
        self.change_neighbour(libc::SIOCSARP, &mut request)
    }

    fn neighbour_request(&self, address: Ipv4Addr, mac: Option<Mac>) -> libc::arpreq {
        let mut hardware = libc::sockaddr { sa_family: libc::ARPHRD_ETHER, sa_data: [0; 14] };
        for (to, from) in hardware.sa_data.iter_mut().zip(mac.unwrap_or_default().0) {
            *to = from as libc::c_char;
        }
        let nothing = libc::sockaddr { sa_family: 0, sa_data: [0; 14] };
        libc::arpreq {
            arp_pa: socket_address(address),
            arp_ha: hardware,
            arp_flags: if mac.is_some() { libc::ATF_COM } else { 0 },
            arp_netmask: nothing,
            arp_dev: {
                let name = self.request().ifr_name;
                let mut device = [0; 16];
                device.copy_from_slice(&name);
                device
            },
        }
    }

    fn change_neighbour(&self, what: libc::Ioctl, request: &mut libc::arpreq) -> Result<(), Error> {
        // SAFETY: `control` is an open socket, and both requests take one `arpreq`, which the kernel reads and writes during
        // the call only.
        let result = unsafe { libc::ioctl(self.control.as_fd().as_raw_fd(), what, &raw mut *request) };
        if result < 0 { Err(Error::last_os_error()) } else { Ok(()) }
    }
}
