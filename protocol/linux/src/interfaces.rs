//! The interfaces of a machine, each with the ports that are open on it.

use std::ops::Range;

use machine::{InterfaceId, Multihomed, Port, PortRequest};

use crate::port_holders::Transport;
use crate::{Interface, OpenPort, PortError};

/// An open port and the interface of the machine that it belongs to.
#[derive(Debug)]
pub(crate) struct InterfacePort {
    pub(crate) on: InterfaceId,
    pub(crate) open: OpenPort,
}

/// The interfaces of a machine with their open ports.
///
/// Two of them may be the same interface of the host. Each has its own sockets there, and the kernel gives each raw socket
/// its own copy of a frame.
#[derive(Debug)]
pub(crate) struct Interfaces {
    /// Each interface, and the places of its ports in the list of all ports. The index is the [`InterfaceId`].
    interfaces: Vec<(Interface, Range<usize>)>,
    ports: Vec<InterfacePort>,
}

impl Interfaces {
    /// Opens the ports of a machine, whose interfaces are given in the order of their [`InterfaceId`]s. If one fails, none
    /// stays open.
    pub(crate) fn open<M: Multihomed>(machine: &M, given: Vec<Interface>) -> Result<Self, PortError> {
        let needed = usize::from(machine.interfaces());
        if given.len() != needed {
            return Err(PortError::InterfaceCount { needed, given: given.len() });
        }
        let mut opened = Self { interfaces: Vec::new(), ports: Vec::new() };
        for (on, interface) in (0..=u8::MAX).map(InterfaceId).zip(given) {
            let first = opened.ports.len();
            for request in machine.ports(on) {
                opened.check_shared(&interface, *request)?;
                let open = OpenPort::open(&interface, *request)?;
                opened.ports.push(InterfacePort { on, open });
            }
            let ports = first..opened.ports.len();
            opened.interfaces.push((interface, ports));
        }
        Ok(opened)
    }

    /// Returns an error if another interface of the machine is the same one of the host and has this UDP port, too.
    fn check_shared(&self, interface: &Interface, request: PortRequest) -> Result<(), PortError> {
        let PortRequest::Udp(port) = request else { return Ok(()) };
        // The kernel chooses a free port for 0.
        let mut same = self.interfaces.iter().filter(|(other, _)| other.index() == interface.index());
        if port != 0 && same.any(|(_, ports)| self.find(ports, Port::Udp(port)).is_some()) {
            let interface = interface.name().to_owned();
            return Err(PortError::Shared { transport: Transport::Udp, port, interface });
        }
        Ok(())
    }

    fn find(&self, among: &Range<usize>, port: Port) -> Option<&OpenPort> {
        let mut ports = self.ports.get(among.clone()).unwrap_or_default().iter();
        ports.find_map(|InterfacePort { open, .. }| (open.port() == port).then_some(open))
    }

    /// Returns an interface.
    pub(crate) fn get(&self, on: InterfaceId) -> Option<&Interface> {
        self.interfaces.get(usize::from(on.0)).map(|(interface, _)| interface)
    }

    /// Returns the interfaces in order.
    pub(crate) fn iter(&self) -> impl ExactSizeIterator<Item = &Interface> {
        self.interfaces.iter().map(|(interface, _)| interface)
    }

    /// Returns all ports, those of the first interface first.
    pub(crate) fn ports(&self) -> &[InterfacePort] {
        &self.ports
    }

    /// Returns a port of an interface. It looks through the few ports of this interface only.
    pub(crate) fn port(&self, on: InterfaceId, port: Port) -> Option<&OpenPort> {
        self.find(&self.interfaces.get(usize::from(on.0))?.1, port)
    }
}

impl From<Interface> for Vec<Interface> {
    /// Lists the one interface, for a machine that has no other.
    fn from(interface: Interface) -> Self {
        vec![interface]
    }
}
