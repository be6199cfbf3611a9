//! `plc-node set-ip --bus ethernet-ip`: the address of an adapter, by its TCP/IP Interface object (volume 2, 5-4).

use std::net::{Ipv4Addr, SocketAddrV4};

use ethernet_ip::cip::{General, class, service};
use ethernet_ip::{ENCAPSULATION_PORT, FoundDevice};
use machine::Duration;
use node::Outcome;
use node::output::to_stdout;
use protocol_linux::Interface;

use crate::dialogue::{DeviceReply, Dialogue};
use crate::discover::find_adapters;
use crate::printable::printable;
use crate::station_error::StationError;

/// Time for the answers of devices to a question to all of them.
const SEARCH: Duration = Duration::from_millis(1_000);

/// Searches for the device at its new address, each of the time [`SEARCH`].
const SEARCHES: usize = 10;

/// Attributes of the TCP/IP Interface object (volume 2, table 5-4.1).
const CAPABILITY: u32 = 2;
const CONTROL: u32 = 3;
const CONFIGURATION: u32 = 5;

/// Bits of the capability: the configuration can be set; a change takes effect after a reset (volume 2, table 5-4.4).
const IS_SETTABLE: u32 = 1 << 4;
const NEEDS_RESET: u32 = 1 << 6;

/// Bits of the control with the method of configuration; 0 is the address that was set (volume 2, table 5-4.6).
const METHOD: u32 = 0x0F;

/// Address, mask and gateway of an adapter; 0.0.0.0 for no gateway.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct AdapterAddress {
    pub(crate) address: Ipv4Addr,
    pub(crate) mask: Ipv4Addr,
    pub(crate) gateway: Ipv4Addr,
}

impl std::fmt::Display for AdapterAddress {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}, mask {}, ", self.address, self.mask)?;
        if self.gateway.is_unspecified() {
            f.write_str("no gateway")
        } else {
            write!(f, "gateway {}", self.gateway)
        }
    }
}

/// Values of an adapter's TCP/IP Interface object before the change.
#[derive(Clone, PartialEq, Eq, Debug)]
struct TcpIpInterface {
    /// `None` where the device does not have the attribute.
    capability: Option<u32>,
    control: Option<u32>,
    /// Bytes of the configuration: address, mask, gateway, two name servers, domain.
    configuration: Vec<u8>,
}

/// Asks the TCP/IP Interface object: service, attribute, data.
type Ask<'a> = dyn FnMut(u8, u32, &[u8]) -> std::io::Result<DeviceReply> + 'a;

impl TcpIpInterface {
    fn read(ask: &mut Ask<'_>) -> std::io::Result<Self> {
        let mut attribute = |number| {
            let reply = ask(service::GET_ATTRIBUTE_SINGLE, number, &[])?;
            Ok::<_, std::io::Error>((reply.status == General::Success).then_some(reply.data))
        };
        let number = |data: Option<Vec<u8>>| data?.first_chunk().copied().map(u32::from_le_bytes);
        let (capability, control) = (number(attribute(CAPABILITY)?), number(attribute(CONTROL)?));
        Ok(Self { capability, control, configuration: attribute(CONFIGURATION)?.unwrap_or_default() })
    }

    fn gateway(&self) -> Option<Ipv4Addr> {
        let bytes = self.configuration.get(8..12)?.first_chunk::<4>()?;
        Some(Ipv4Addr::from_bits(u32::from_le_bytes(*bytes))).filter(|gateway| !gateway.is_unspecified())
    }

    /// Returns the configuration with another address. Name servers and domain stay.
    fn with(&self, address: AdapterAddress) -> Vec<u8> {
        let AdapterAddress { address, mask, gateway } = address;
        let numbers = [address, mask, gateway].map(|it| it.to_bits().to_le_bytes());
        let mut configuration = numbers.concat();
        match self.configuration.get(12..).filter(|rest| rest.len() >= 10) {
            Some(rest) => configuration.extend_from_slice(rest),
            // No name servers, no domain.
            None => configuration.extend([0; 10]),
        }
        configuration
    }

    /// Sets the address, and the method of configuration where it is another one than this.
    fn set(&self, ask: &mut Ask<'_>, address: AdapterAddress) -> std::io::Result<SetAnswer> {
        let method = self.control.map_or(0, |control| control & METHOD);
        if method != 0 {
            let control = self.control.unwrap_or(0) & !METHOD;
            let reply = ask(service::SET_ATTRIBUTE_SINGLE, CONTROL, &control.to_le_bytes())?;
            if reply.status != General::Success {
                return Ok(SetAnswer::Refused("to keep an address that is set", reply));
            }
        }
        let reply = match ask(service::SET_ATTRIBUTE_SINGLE, CONFIGURATION, &self.with(address)) {
            Ok(reply) => reply,
            // A device that takes its new address at once may not answer from the old one.
            Err(_) => return Ok(SetAnswer::NoReply),
        };
        if reply.status == General::Success {
            return Ok(SetAnswer::Taken);
        }
        if let Some(control) = self.control.filter(|_| method != 0) {
            // The device gets its address as before.
            ask(service::SET_ATTRIBUTE_SINGLE, CONTROL, &control.to_le_bytes())?;
        }
        Ok(SetAnswer::Refused("the address", reply))
    }

    fn needs_reset(&self) -> bool {
        self.capability.is_some_and(|it| it & NEEDS_RESET != 0)
    }

    /// Returns why the device refuses, and what to do.
    fn refusal(&self, what: &str, reply: &DeviceReply) -> String {
        let is_fixed = self.capability.is_some_and(|it| it & IS_SETTABLE == 0);
        let remedy = match reply.status {
            _ if is_fixed => {
                "by its capability (attribute 2) it cannot be set over the network; use its switches, its display or the maker's tool"
            }
            General::AttributeNotSettable | General::ServiceNotSupported | General::AttributeNotSupported => {
                "it has no address that can be set; use its switches or the maker's tool"
            }
            General::PathDestinationUnknown | General::ObjectDoesNotExist => {
                "it has no TCP/IP Interface object; use the maker's tool"
            }
            General::ObjectStateConflict | General::DeviceStateConflict => {
                "end the connections to it, look at its address switches, and try again"
            }
            General::PrivilegeViolation => "unlock it with the maker's tool",
            General::InvalidAttributeValue => "choose another address, mask or gateway",
            _ => "see its manual",
        };
        let additional =
            reply.additional.map_or_else(String::new, |word| format!(", additional status 0x{word:04X}"));
        let status = u8::from(reply.status);
        format!("it refuses {what}: {} (0x{status:02X}{additional}); {remedy}", reply.status.text())
    }
}

/// Answer of a device to the change.
#[derive(Clone, PartialEq, Eq, Debug)]
enum SetAnswer {
    Taken,
    NoReply,
    Refused(&'static str, DeviceReply),
}

/// New address of an adapter, as the command line has it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct AdapterChange {
    pub(crate) address: Ipv4Addr,
    pub(crate) mask: Ipv4Addr,
    /// `None` keeps the one that the device has, if the new address can reach it.
    pub(crate) gateway: Option<Ipv4Addr>,
    /// Resets the device where it needs this.
    pub(crate) resets: bool,
}

/// Gives an adapter its address, and says what it has then.
pub(crate) fn set_address(
    interface: &Interface,
    at: &str,
    change: AdapterChange,
    confirm: impl FnOnce(&str) -> anyhow::Result<()>,
) -> anyhow::Result<Outcome> {
    let found = find_adapters(interface, SEARCH)?;
    let device = adapter_at(&found, at)?;
    let AdapterChange { address, mask, gateway, resets } = change;
    if let Some(other) = found.iter().find(|other| other.address == address && !std::ptr::eq(*other, device))
    {
        return Err(StationError::Taken(format!("the address {address}"), describe(other)).into());
    }
    let mut dialogue = Dialogue::open(SocketAddrV4::new(device.address, ENCAPSULATION_PORT))?;
    let mut ask = |service: u8, attribute: u32, data: &[u8]| {
        dialogue.request(service, &[class::TCP_IP_INTERFACE, 1, attribute], data)
    };
    let before = TcpIpInterface::read(&mut ask)?;
    let kept = before.gateway().filter(|gateway| *gateway & mask == address & mask);
    let gateway = gateway.or(kept).unwrap_or(Ipv4Addr::UNSPECIFIED);
    let new = AdapterAddress { address, mask, gateway };
    let will_reset = resets && before.needs_reset();
    let reset = if will_reset { " and reset it" } else { "" };
    confirm(&format!("Give {} the address {new}{reset}?", describe(device)))?;
    let name = describe(device);
    match before.set(&mut ask, new)? {
        SetAnswer::Refused(what, reply) => {
            node::errln!("{name}: {}", before.refusal(what, &reply));
            return Ok(Outcome::RunFailed);
        }
        SetAnswer::NoReply => to_stdout(format_args!("{name}: no answer to the change; it is looked for\n"))?,
        SetAnswer::Taken => to_stdout(format_args!("{name}: it confirms\n"))?,
    }
    if before.needs_reset() && !will_reset {
        to_stdout(format_args!("it takes {address} after a reset: switch it off and on, or give --reset\n"))?;
        return Ok(Outcome::Done);
    }
    if will_reset {
        let reply = dialogue.request(service::RESET, &[class::IDENTITY, 1], &[]);
        if let Ok(reply) = reply
            && reply.status != General::Success
        {
            let status = u8::from(reply.status);
            node::errln!(
                "{name}: it refuses a reset: {} (0x{status:02X}); switch it off and on",
                reply.status.text()
            );
            return Ok(Outcome::RunFailed);
        }
    }
    look_for(interface, device, address)
}

/// Searches for a device until it answers at its new address.
fn look_for(interface: &Interface, device: &FoundDevice, address: Ipv4Addr) -> anyhow::Result<Outcome> {
    let is_it = |other: &&FoundDevice| {
        let (one, other) = (device.identity, other.identity);
        (one.key.vendor, one.serial_number) == (other.key.vendor, other.serial_number)
    };
    let mut last = None;
    for _ in 0..SEARCHES {
        last = find_adapters(interface, SEARCH)?.iter().find(is_it).cloned().or(last);
        if let Some(now) = last.as_ref().filter(|now| now.address == address) {
            to_stdout(format_args!("now {}\n", describe(now)))?;
            return Ok(Outcome::Done);
        }
    }
    match last {
        Some(now) => node::errln!("{}: still at its former address; switch it off and on", describe(&now)),
        None => node::errln!(
            "{}: does not answer any more; give the interface an address of its new subnet and search with `plc-node discover`",
            describe(device)
        ),
    }
    Ok(Outcome::EnvironmentUnusable)
}

/// Returns the adapter at an address.
fn adapter_at<'f>(found: &'f [FoundDevice], at: &str) -> Result<&'f FoundDevice, StationError> {
    let meant: Vec<_> = found.iter().filter(|device| device.address.to_string() == at).collect();
    let list = |devices: &[&FoundDevice]| {
        let listed: Vec<_> = devices.iter().take(MOST_LISTED).map(|device| describe(device)).collect();
        if listed.is_empty() { "none".to_owned() } else { listed.join(", ") }
    };
    match meant.as_slice() {
        [device] => Ok(device),
        [] => Err(StationError::None(printable(at.as_bytes()), list(&found.iter().collect::<Vec<_>>()))),
        several => Err(StationError::SharedAddress(several.len(), list(several))),
    }
}

/// Devices that a message lists.
const MOST_LISTED: usize = 12;

fn describe(device: &FoundDevice) -> String {
    let name = printable(&device.product_name);
    format!("{name} ({}, serial number 0x{:08X})", device.address, device.identity.serial_number)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dialogue::malformed;

    /// An adapter as volume 2 describes it: its address is set only while its method is the static one.
    struct Adapter {
        control: u32,
        configuration: Vec<u8>,
        capability: u32,
        log: Vec<(u8, u32)>,
    }

    const NEW: AdapterAddress = AdapterAddress {
        address: Ipv4Addr::new(192, 168, 64, 9),
        mask: Ipv4Addr::new(255, 255, 255, 0),
        gateway: Ipv4Addr::new(192, 168, 64, 1),
    };

    impl Adapter {
        fn new(control: u32, capability: u32) -> Self {
            // 192.168.64.2 of a subnet of 256, gateway .1, a name server, and the domain `ab`.
            let configuration = [
                &[2, 64, 168, 192, 0, 255, 255, 255, 1, 64, 168, 192, 8, 8, 8, 8, 0, 0, 0, 0, 2, 0][..],
                b"ab",
            ]
            .concat();
            Self { control, configuration, capability, log: Vec::new() }
        }

        fn answer(&mut self, service: u8, attribute: u32, data: &[u8]) -> std::io::Result<DeviceReply> {
            self.log.push((service, attribute));
            let reply =
                |status, data: &[u8]| Ok(DeviceReply { status, additional: None, data: data.to_vec() });
            match (service, attribute) {
                (service::GET_ATTRIBUTE_SINGLE, CAPABILITY) => {
                    reply(General::Success, &self.capability.to_le_bytes())
                }
                (service::GET_ATTRIBUTE_SINGLE, CONTROL) => {
                    reply(General::Success, &self.control.to_le_bytes())
                }
                (service::GET_ATTRIBUTE_SINGLE, CONFIGURATION) => {
                    reply(General::Success, &self.configuration.clone())
                }
                (_, CONTROL) => {
                    self.control = u32::from_le_bytes(data.try_into().map_err(|_| malformed("control"))?);
                    reply(General::Success, &[])
                }
                _ if self.capability & IS_SETTABLE == 0 => reply(General::AttributeNotSettable, &[]),
                _ if self.control & METHOD != 0 => reply(General::ObjectStateConflict, &[]),
                _ => {
                    self.configuration = data.to_vec();
                    reply(General::Success, &[])
                }
            }
        }
    }

    fn set(adapter: &mut Adapter) -> (TcpIpInterface, SetAnswer) {
        let mut ask = |service: u8, attribute: u32, data: &[u8]| adapter.answer(service, attribute, data);
        let before = TcpIpInterface::read(&mut ask).unwrap();
        let answer = before.set(&mut ask, NEW).unwrap();
        (before, answer)
    }

    #[test]
    fn an_address_is_set_in_the_byte_order_of_cip_and_name_servers_and_domain_stay() {
        let mut adapter = Adapter::new(0, IS_SETTABLE);
        let (before, answer) = set(&mut adapter);
        assert_eq!(answer, SetAnswer::Taken);
        assert_eq!(before.gateway(), Some(NEW.gateway));
        assert_eq!(adapter.configuration[..12], [9, 64, 168, 192, 0, 255, 255, 255, 1, 64, 168, 192]);
        assert_eq!(adapter.configuration[12..], Adapter::new(0, 0).configuration[12..]);
        assert!(!before.needs_reset());
    }

    #[test]
    fn a_device_with_dhcp_gets_the_static_method_first_and_keeps_the_other_bits_of_its_control() {
        // DHCP, and names by DNS.
        let mut adapter = Adapter::new(0x12, IS_SETTABLE | NEEDS_RESET);
        let (before, answer) = set(&mut adapter);
        assert_eq!((answer, adapter.control), (SetAnswer::Taken, 0x10));
        assert!(before.needs_reset());
    }

    #[test]
    fn a_device_that_refuses_the_address_gets_its_method_back_and_the_remedy_is_said() {
        let mut adapter = Adapter::new(2, 0);
        let (before, answer) = set(&mut adapter);
        assert_eq!(adapter.control, 2);
        let SetAnswer::Refused(what, reply) = answer else { panic!("{answer:?}") };
        assert_eq!(
            before.refusal(what, &reply),
            "it refuses the address: the attribute cannot be set (0x0E); by its capability (attribute 2) it cannot be set over the \
             network; use its switches, its display or the maker's tool"
        );
    }

    #[test]
    fn a_device_that_goes_silent_after_the_change_has_perhaps_taken_it() {
        let mut adapter = Adapter::new(0, IS_SETTABLE);
        let mut ask = |service: u8, attribute: u32, data: &[u8]| match service {
            service::SET_ATTRIBUTE_SINGLE => Err(malformed("cut")),
            _ => adapter.answer(service, attribute, data),
        };
        let before = TcpIpInterface::read(&mut ask).unwrap();
        assert_eq!(before.set(&mut ask, NEW).unwrap(), SetAnswer::NoReply);
    }

    #[test]
    fn attributes_that_are_cut_off_are_taken_as_missing() {
        let mut ask = |_: u8, _: u32, _: &[u8]| {
            Ok(DeviceReply { status: General::Success, additional: None, data: vec![1, 2] })
        };
        let before = TcpIpInterface::read(&mut ask).unwrap();
        assert_eq!((before.capability, before.control, before.gateway()), (None, None, None));
        assert_eq!(before.with(NEW).len(), 22);
    }
}
