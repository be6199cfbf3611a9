//! The way to other networks through an interface: its default route.

use std::ffi::{c_short, c_ulong};
use std::io::Error;
use std::net::Ipv4Addr;
use std::os::fd::{AsFd as _, AsRawFd as _};

use rustix::io::Errno;

use super::{Interface, InterfaceError, socket_address};

/// Metric of the route. It marks our route, so that only ours is removed. Routes with a lower metric take precedence, as those of
/// others have: who sets a gateway over the bus must not redirect what the host sends elsewhere.
const METRIC: c_short = 30_000;

impl Interface {
    /// Makes this the gateway to other networks through this interface, in place of the one that this function set before;
    /// the unspecified address, or the interface's own one, only removes that.
    ///
    /// Set the address first: changing it removes all routes. Needs `CAP_NET_ADMIN`, except for nothing to remove. Does not
    /// allocate unless it fails.
    pub fn set_gateway(&self, gateway: Ipv4Addr) -> Result<(), InterfaceError> {
        match self.change_route(libc::SIOCDELRT, Ipv4Addr::UNSPECIFIED).map_err(|e| Errno::from_io_error(&e))
        {
            // There was none; or this process may not change routes, and has set none.
            Ok(()) | Err(Some(Errno::SRCH | Errno::PERM)) => {}
            Err(error) => {
                let reason = error.unwrap_or(Errno::IO).into();
                return Err(self.refused("removing the former gateway", reason));
            }
        }
        if gateway.is_unspecified() || self.address() == Some(gateway) {
            return Ok(());
        }
        self.change_route(libc::SIOCADDRT, gateway)
            .map_err(|reason| self.refused("setting the gateway", reason))
    }

    /// Adds or removes the default route with our metric. A gateway that is not specified is any, for one to be removed.
    fn change_route(&self, what: c_ulong, gateway: Ipv4Addr) -> Result<(), Error> {
        let mut name = self.request().ifr_name;
        // SAFETY: it consists of numbers, for which all bytes are valid, and of a pointer, which may be null.
        let mut route: libc::rtentry = unsafe { std::mem::zeroed() };
        route.rt_dst = socket_address(Ipv4Addr::UNSPECIFIED);
        route.rt_genmask = socket_address(Ipv4Addr::UNSPECIFIED);
        route.rt_dev = name.as_mut_ptr();
        // The kernel subtracts one, so that 0 is none.
        route.rt_metric = METRIC + 1;
        route.rt_flags = libc::RTF_UP;
        if !gateway.is_unspecified() {
            route.rt_gateway = socket_address(gateway);
            route.rt_flags |= libc::RTF_GATEWAY;
        }
        // SAFETY: `control` is an open socket. Both requests take an `rtentry`, which the kernel reads during the call, as it
        // does the name that it points to, which ends with a zero.
        let result =
            unsafe { libc::ioctl(self.control.as_fd().as_raw_fd(), what as libc::Ioctl, &raw mut route) };
        if result < 0 { Err(Error::last_os_error()) } else { Ok(()) }
    }
}
