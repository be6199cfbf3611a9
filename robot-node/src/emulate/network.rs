//! Interfaces of several devices: each with a MAC address of its own at the interface of the command line.

use std::net::Ipv4Addr;

use emulated_device::EmulationConfig;
use protocol_linux::namespace::NetworkNamespace;
use protocol_linux::{Interface, macvlan};

/// A network of the devices alone, so that each address belongs to its own interface. Its interfaces end with the program.
#[derive(Debug)]
pub(super) struct DeviceNetwork {
    pub(super) network: NetworkNamespace,
    /// Interfaces of the devices in their order.
    pub(super) interfaces: Vec<Interface>,
}

impl DeviceNetwork {
    /// Adds an interface for each device to the cable of `host`, with the device's addresses.
    ///
    /// # Errors
    ///
    /// The kernel's error.
    pub(super) fn set_up(host: &Interface, configs: &[EmulationConfig]) -> anyhow::Result<Self> {
        let network = NetworkNamespace::new()?;
        macvlan::separate_addresses(&network)?;
        let name = |number: usize| format!("device{}", number + 1);
        for (number, config) in configs.iter().enumerate() {
            macvlan::add(host, &network, &name(number), config.mac)?;
        }
        let open = |(number, config): (usize, &EmulationConfig)| -> anyhow::Result<Interface> {
            let interface = Interface::open(&name(number))?;
            if let Some(address) = config.address.filter(|address| *address != Ipv4Addr::UNSPECIFIED) {
                interface.set_address(address, config.mask)?;
            }
            interface.set_up()?;
            Ok(interface)
        };
        let opened = network.run(|| configs.iter().enumerate().map(open).collect::<anyhow::Result<Vec<_>>>());
        Ok(Self { interfaces: opened??, network })
    }
}
