//! The blocks of DCP: one option of a station each (IEC 61158-6-10, 4.3.1.4).
//!
//! ```text
//! 0      Option
//! 1      Suboption
//! 2..4   DCPBlockLength    of all that follows, without the byte that makes the next offset even
//! 4..6   BlockInfo         in answers and Hello     BlockQualifier   in Set requests     neither in others
//! 6..    value
//! ```

use core::net::Ipv4Addr;

use super::Violation;
use machine::ethernet::Mac;
use machine::wire::{BigEndian, Reader, Writer};

/// Option (high byte) and suboption (low byte) of a block.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Debug)]
pub struct Code(pub u16);

impl Code {
    /// The station's MAC address, for reading only.
    pub const MAC_ADDRESS: Self = Self(0x0101);
    /// IP address, mask and gateway.
    pub const IP: Self = Self(0x0102);
    /// Type of station, chosen by the vendor.
    pub const TYPE_OF_STATION: Self = Self(0x0201);
    /// The station's name.
    pub const NAME_OF_STATION: Self = Self(0x0202);
    /// VendorID and DeviceID.
    pub const DEVICE_ID: Self = Self(0x0203);
    /// IO-Device, IO-Controller and so on.
    pub const DEVICE_ROLE: Self = Self(0x0204);
    /// The options that the station has.
    pub const DEVICE_OPTIONS: Self = Self(0x0205);
    /// Name of the neighbour's port, by which an unnamed station is found.
    pub const ALIAS_NAME: Self = Self(0x0206);
    /// Instance of the device.
    pub const DEVICE_INSTANCE: Self = Self(0x0207);
    /// Identity of the OEM, whose product is sold under another name.
    pub const OEM_DEVICE_ID: Self = Self(0x0208);
    /// Start of a transaction of Set requests.
    pub const START: Self = Self(0x0501);
    /// End of a transaction of Set requests.
    pub const END: Self = Self(0x0502);
    /// Flash a lamp.
    pub const SIGNAL: Self = Self(0x0503);
    /// Result of setting or reading an option.
    pub const RESPONSE: Self = Self(0x0504);
    /// Reset name, address and parameters.
    pub const FACTORY_RESET: Self = Self(0x0505);
    /// Reset what the qualifier selects.
    pub const RESET_TO_FACTORY: Self = Self(0x0506);
    /// Whether the station sends Hello by itself.
    pub const INITIATIVE: Self = Self(0x0601);
    /// Every station, in an Identify request.
    pub const ALL: Self = Self(0xFFFF);
}

/// An IP address with subnet mask and gateway.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub struct IpSuite {
    /// The station's own address.
    pub address: Ipv4Addr,
    /// Its subnet mask.
    pub mask: Ipv4Addr,
    /// Its gateway; its own address if there is none.
    pub gateway: Ipv4Addr,
}

/// Why an option was not set or read.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum BlockError {
    /// No error.
    None,
    /// The station does not have the option.
    OptionNotSupported,
    /// The station does not have the suboption, or no value of it.
    SuboptionNotSupported,
    /// The value is not allowed.
    SuboptionNotSet,
    /// The station lacks resources.
    Resource,
    /// Not possible, for local reasons.
    NotPossible,
    /// Not possible while data is exchanged.
    InOperation,
    /// A code that this version does not know.
    Unknown(u8),
}

impl From<u8> for BlockError {
    fn from(code: u8) -> Self {
        match code {
            0 => Self::None,
            1 => Self::OptionNotSupported,
            2 => Self::SuboptionNotSupported,
            3 => Self::SuboptionNotSet,
            4 => Self::Resource,
            5 => Self::NotPossible,
            6 => Self::InOperation,
            other => Self::Unknown(other),
        }
    }
}

impl From<BlockError> for u8 {
    fn from(error: BlockError) -> Self {
        match error {
            BlockError::None => 0,
            BlockError::OptionNotSupported => 1,
            BlockError::SuboptionNotSupported => 2,
            BlockError::SuboptionNotSet => 3,
            BlockError::Resource => 4,
            BlockError::NotPossible => 5,
            BlockError::InOperation => 6,
            BlockError::Unknown(code) => code,
        }
    }
}

/// Value of a block.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Content<'a> {
    /// The station's MAC address.
    MacAddress(Mac),
    /// IP address, mask and gateway.
    Ip(IpSuite),
    /// Type of station, chosen by the vendor.
    TypeOfStation(&'a [u8]),
    /// The station's name, lower-case ASCII.
    NameOfStation(&'a [u8]),
    /// Vendor and device.
    DeviceId {
        /// VendorID.
        vendor: u16,
        /// DeviceID.
        device: u16,
    },
    /// Roles as bits: 1 IO-Device, 2 IO-Controller, 4 IO-Multidevice, 8 IO-Supervisor.
    DeviceRole(u8),
    /// The options that the station has: pairs of option and suboption.
    DeviceOptions(&'a [u8]),
    /// Name of the neighbour's port.
    AliasName(&'a [u8]),
    /// Instance of the device.
    DeviceInstance(u16),
    /// OEM and device.
    OemDeviceId {
        /// VendorID.
        vendor: u16,
        /// DeviceID.
        device: u16,
    },
    /// Start of a transaction.
    Start,
    /// End of a transaction.
    End,
    /// Flash a lamp; 0x0100 is once.
    Signal(u16),
    /// Result for an option.
    Response {
        /// The option that was to be set or read.
        code: Code,
        /// The error, if any.
        error: BlockError,
    },
    /// Reset name, address and parameters.
    FactoryReset,
    /// Reset what the qualifier selects.
    ResetToFactory,
    /// 1 if the station sends Hello by itself.
    Initiative(u16),
    /// Every station.
    All,
    /// An option that this version does not know.
    Unknown(Code, &'a [u8]),
}

/// One block.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Block<'a> {
    /// BlockInfo in answers (for an IP address: 0 not set, 1 set, 2 by DHCP, bit 7 conflict), BlockQualifier in Set
    /// requests (bit 0: store permanently); 0 in blocks that have neither.
    pub qualifier: u16,
    /// The value.
    pub content: Content<'a>,
}

impl<'a> From<Content<'a>> for Block<'a> {
    fn from(content: Content<'a>) -> Self {
        Self { qualifier: 0, content }
    }
}

impl<'a> Block<'a> {
    /// Bit of the BlockInfo of an IP address: the station noticed that another one has the address.
    pub const ADDRESS_CONFLICT: u16 = 1 << 7;

    /// Returns option and suboption.
    #[must_use]
    pub const fn code(&self) -> Code {
        match self.content {
            Content::MacAddress(_) => Code::MAC_ADDRESS,
            Content::Ip(_) => Code::IP,
            Content::TypeOfStation(_) => Code::TYPE_OF_STATION,
            Content::NameOfStation(_) => Code::NAME_OF_STATION,
            Content::DeviceId { .. } => Code::DEVICE_ID,
            Content::DeviceRole(_) => Code::DEVICE_ROLE,
            Content::DeviceOptions(_) => Code::DEVICE_OPTIONS,
            Content::AliasName(_) => Code::ALIAS_NAME,
            Content::DeviceInstance(_) => Code::DEVICE_INSTANCE,
            Content::OemDeviceId { .. } => Code::OEM_DEVICE_ID,
            Content::Start => Code::START,
            Content::End => Code::END,
            Content::Signal(_) => Code::SIGNAL,
            Content::Response { .. } => Code::RESPONSE,
            Content::FactoryReset => Code::FACTORY_RESET,
            Content::ResetToFactory => Code::RESET_TO_FACTORY,
            Content::Initiative(_) => Code::INITIATIVE,
            Content::All => Code::ALL,
            Content::Unknown(code, _) => code,
        }
    }

    pub(super) fn parse(reader: &mut Reader<'a, BigEndian>, qualifiers: bool) -> Result<Self, Violation> {
        let code = Code(reader.u16()?);
        let len = reader.u16()?;
        let value = reader.bytes(usize::from(len))?;
        reader.align(2);
        Self::parse_value(code, value, qualifiers).ok_or(Violation::BlockLength { code, len })
    }

    fn parse_value(code: Code, value: &'a [u8], qualifiers: bool) -> Option<Self> {
        let mut value = Reader::<BigEndian>::new(value);
        let qualifier = if qualifiers && code != Code::RESPONSE { value.u16().ok()? } else { 0 };
        let content = match code {
            Code::MAC_ADDRESS => Content::MacAddress(Mac(value.array().ok()?)),
            Code::IP if value.left() == 12 => Content::Ip(IpSuite {
                address: value.array::<4>().ok()?.into(),
                mask: value.array::<4>().ok()?.into(),
                gateway: value.array::<4>().ok()?.into(),
            }),
            Code::IP => return None,
            Code::TYPE_OF_STATION => Content::TypeOfStation(value.rest()),
            Code::NAME_OF_STATION => Content::NameOfStation(value.rest()),
            Code::DEVICE_ID => Content::DeviceId { vendor: value.u16().ok()?, device: value.u16().ok()? },
            Code::DEVICE_ROLE => Content::DeviceRole(value.u8().ok()?),
            Code::DEVICE_OPTIONS => Content::DeviceOptions(value.rest()),
            Code::ALIAS_NAME => Content::AliasName(value.rest()),
            Code::DEVICE_INSTANCE => Content::DeviceInstance(value.u16().ok()?),
            Code::OEM_DEVICE_ID => {
                Content::OemDeviceId { vendor: value.u16().ok()?, device: value.u16().ok()? }
            }
            Code::START => Content::Start,
            Code::END => Content::End,
            Code::SIGNAL => Content::Signal(value.u16().ok()?),
            Code::RESPONSE => {
                Content::Response { code: Code(value.u16().ok()?), error: value.u8().ok()?.into() }
            }
            Code::FACTORY_RESET => Content::FactoryReset,
            Code::RESET_TO_FACTORY => Content::ResetToFactory,
            Code::INITIATIVE => Content::Initiative(value.u16().ok()?),
            Code::ALL => Content::All,
            other => Content::Unknown(other, value.rest()),
        };
        Some(Self { qualifier, content })
    }

    pub(super) fn emit(&self, writer: &mut Writer<'_, BigEndian>, qualifiers: bool) {
        let code = self.code();
        writer.u16(code.0);
        let len_at = writer.len();
        writer.u16(0);
        let start = writer.len();
        if qualifiers && code != Code::RESPONSE {
            writer.u16(self.qualifier);
        }
        match self.content {
            Content::MacAddress(mac) => writer.bytes(&mac.0),
            Content::Ip(IpSuite { address, mask, gateway }) => {
                for part in [address, mask, gateway] {
                    writer.bytes(&part.octets());
                }
            }
            Content::TypeOfStation(bytes)
            | Content::NameOfStation(bytes)
            | Content::DeviceOptions(bytes)
            | Content::AliasName(bytes)
            | Content::Unknown(_, bytes) => writer.bytes(bytes),
            Content::DeviceId { vendor, device } | Content::OemDeviceId { vendor, device } => {
                writer.u16(vendor);
                writer.u16(device);
            }
            Content::DeviceRole(roles) => {
                writer.u8(roles);
                writer.u8(0);
            }
            Content::DeviceInstance(value) | Content::Signal(value) | Content::Initiative(value) => {
                writer.u16(value);
            }
            Content::Response { code, error } => {
                writer.u16(code.0);
                writer.u8(error.into());
            }
            Content::Start
            | Content::End
            | Content::FactoryReset
            | Content::ResetToFactory
            | Content::All => {}
        }
        let len = writer.len() - start;
        writer.patch_u16(len_at, u16::try_from(len).unwrap_or(u16::MAX));
        if len % 2 == 1 {
            writer.u8(0);
        }
    }
}
