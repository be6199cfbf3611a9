//! Why there is no connection, in words.

use std::fmt;

use ethercrab::error::{Error, TimeoutError};
use ethercrab::{AlStatusCode, EtherCrabWireRead, SubDeviceState};
use machine::ethernet::Mac;
use machine::{Down, DownCause};

use crate::config::{ExpectedDevice, MAX_DEVICES};
use crate::sdo_fault::SdoFault;
use crate::slot::Slot;

/// A device on the cable.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) struct FoundDevice {
    pub(crate) name: String,
    pub(crate) vendor: u32,
    pub(crate) product: u32,
    pub(crate) revision: u32,
}

impl FoundDevice {
    pub(crate) fn is(&self, expected: &ExpectedDevice) -> bool {
        (self.vendor, self.product) == (expected.vendor, expected.product)
            && expected.revision.is_none_or(|revision| revision == self.revision)
    }
}

impl fmt::Display for FoundDevice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, vendor, product, revision } = self;
        write!(f, "`{name}` (vendor 0x{vendor:08X}, product 0x{product:08X}, revision 0x{revision:08X})")
    }
}

/// What ended an attempt to connect, or the connection. Devices are numbered from 1.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) enum Problem {
    /// Frames do not come back.
    Silence,
    /// Frames come back, but no device saw them.
    NoDevice,
    /// Other devices than expected.
    OtherDevices { expected: Vec<ExpectedDevice>, found: Vec<FoundDevice> },
    /// There are more devices than this MainDevice can hold.
    TooManyDevices { expected: usize },
    /// A device has other process data.
    OtherProcessData { number: usize, found: FoundDevice, expected: [usize; 2], bytes: [usize; 2] },
    /// The devices did not come to OP, or one keeps an error there.
    NotOperational { number: usize, state: SubDeviceState, code: u16 },
    /// A device left OP, or indicates an error there.
    LeftOperational { number: usize, state: SubDeviceState, code: u16 },
    /// Frames with this source address come from another MainDevice.
    OtherMainDevice { mac: Mac },
    /// Another program on this host uses the same interface as a MainDevice.
    SameInterface,
    /// A device stays in OP beyond its watchdog, though no frame of another MainDevice comes.
    Driven { number: usize, station: u16 },
    /// The device at this place is driven as another one of the same MainDevice, with this number.
    Renumbered { driven_as: usize },
    /// There was no good exchange for the time of the watchdog.
    Watchdog,
    /// ethercrab panicked.
    Panic,
    /// A device refused what is written to it in PRE-OP.
    Startup { index: u16, subindex: u8, fault: SdoFault },
    /// Any other error of ethercrab.
    Other(Error),
}

impl Problem {
    /// Returns what an error means while devices are brought up.
    pub(crate) fn of_start(error: Error, expected: usize) -> Self {
        match error {
            Error::Timeout(TimeoutError::Pdu) => Self::Silence,
            Error::Capacity(ethercrab::error::Item::SubDevice) => Self::TooManyDevices { expected },
            error => Self::Other(error),
        }
    }

    /// Returns whether there is nobody who would answer.
    pub(crate) const fn is_silence(&self) -> bool {
        matches!(self, Self::Silence | Self::NoDevice)
    }

    /// Returns whether it may pass by itself: devices that are switched on while the MainDevice starts.
    pub(crate) const fn may_pass(&self) -> bool {
        self.is_silence() || matches!(self, Self::Other(_))
    }

    /// Returns whether another MainDevice has the devices.
    pub(crate) const fn is_conflict(&self) -> bool {
        matches!(self, Self::OtherMainDevice { .. } | Self::SameInterface | Self::Driven { .. })
    }

    pub(crate) fn down(&self, slot: Option<Slot>) -> Down {
        let (cause, code, text) = match self {
            Self::Silence => (
                DownCause::NoAnswer,
                0,
                "no EtherCAT frame comes back; is the cable plugged in, and is the device on?",
            ),
            Self::NoDevice if slot.is_some() => {
                (DownCause::NoAnswer, 0, "there is no SubDevice at this place on the cable")
            }
            Self::OtherDevices { .. } if slot.is_some() => {
                (DownCause::Refused, 0, "another device is at this place on the cable than is expected")
            }
            Self::Renumbered { .. } => {
                (DownCause::Refused, 0, "the devices on the cable have changed places; restore their order")
            }
            Self::NoDevice => (DownCause::NoAnswer, 0, "there is no SubDevice on the cable"),
            Self::OtherDevices { .. } | Self::TooManyDevices { .. } => {
                (DownCause::Refused, 0, "other devices are on the cable than are expected")
            }
            Self::OtherProcessData { .. } => {
                (DownCause::Refused, 0, "a device has process data of another size than is expected")
            }
            Self::NotOperational { state: SubDeviceState::Op, code, .. } => {
                (DownCause::Refused, u32::from(*code), "a device still indicates an error in OP")
            }
            Self::NotOperational { code, .. } => {
                (DownCause::Refused, u32::from(*code), "a device does not come to OP")
            }
            Self::LeftOperational { state: SubDeviceState::Op, code, .. } => {
                (DownCause::ClosedByPeer, u32::from(*code), "a device indicates an error in OP")
            }
            Self::LeftOperational { code, .. } => {
                (DownCause::ClosedByPeer, u32::from(*code), "a device left OP")
            }
            Self::OtherMainDevice { .. } | Self::SameInterface | Self::Driven { .. } => {
                (DownCause::Refused, 0, "another MainDevice drives the devices; stop one of the two")
            }
            Self::Watchdog => (DownCause::Watchdog, 0, ""),
            Self::Panic => (
                DownCause::Refused,
                0,
                "ethercrab cannot read what a device says of itself; is its EEPROM damaged?",
            ),
            Self::Startup { .. } => {
                (DownCause::Refused, 0, "the device refuses a start-up command of its file")
            }
            // A repeated request gets another answer than a first one whose answer was lost: the mailbox is empty by then.
            Self::Other(Error::WorkingCounter { .. }) => {
                (DownCause::NoAnswer, 0, "a device did not process a datagram while it was brought up")
            }
            Self::Other(Error::Timeout(_)) => (DownCause::NoAnswer, 0, "the devices could not be brought up"),
            Self::Other(_) => (DownCause::Refused, 0, "the devices could not be brought up"),
        };
        Down { cause, code, text }
    }

    /// Writes what [`Problem::down`] leaves out, if anything.
    pub(crate) fn explain(&self, slot: Option<Slot>, words: &mut dyn fmt::Write) -> fmt::Result {
        // A slot has one device, and the cable has several.
        let of_cable = |number: usize| slot.map_or(number, Slot::number);
        match self {
            Self::NoDevice => slot.map_or(Ok(()), |slot| slot.explain_missing(words)),
            Self::Silence | Self::Watchdog | Self::Panic => Ok(()),
            Self::OtherDevices { expected, found } => explain_others(expected, found, slot, words),
            Self::TooManyDevices { expected } => {
                write!(words, "the EtherCAT cable has more than {MAX_DEVICES} devices: expected {expected}")
            }
            Self::OtherProcessData { number, found, expected: [outputs, inputs], bytes } => {
                let [found_outputs, found_inputs] = bytes;
                write!(
                    words,
                    "device {}, {found}, has {found_outputs} bytes of outputs and {found_inputs} of inputs; \
                     expected {outputs} and {inputs}",
                    of_cable(*number)
                )
            }
            Self::NotOperational { number, state: SubDeviceState::Op, code } => {
                write!(words, "device {} still indicates an error in OP", of_cable(*number))?;
                write_code(words, *code)?;
                words.write_str(": restart the device")
            }
            Self::LeftOperational { number, state: SubDeviceState::Op, code } => {
                write!(words, "device {} indicates an error in OP", of_cable(*number))?;
                write_code(words, *code)
            }
            Self::NotOperational { number, state, code } => {
                write!(words, "device {} does not come to OP: it is in {}", of_cable(*number), name(*state))?;
                write_code(words, *code)
            }
            Self::LeftOperational { number, state, code } => {
                write!(words, "device {} left OP: it is in {}", of_cable(*number), name(*state))?;
                write_code(words, *code)
            }
            Self::OtherMainDevice { mac } => write!(
                words,
                "another EtherCAT MainDevice sends on this cable, source address {mac} (its first byte may differ from that of \
                 the interface): stop it; until then this one sends nothing"
            ),
            Self::SameInterface => words.write_str(
                "another program on this host drives EtherCAT by the same interface: stop it; until then this one sends nothing",
            ),
            Self::Driven { number, station } => write!(
                words,
                "device {} stays in OP, station address 0x{station:04X}: another MainDevice drives it; stop that one, or \
                 restart the device",
                of_cable(*number)
            ),
            Self::Renumbered { driven_as } => write!(
                words,
                "place {} on the cable has device {driven_as}, which runs: restore the order of the devices",
                of_cable(1)
            ),
            Self::Startup { index, subindex, fault } => {
                write!(words, "start-up command 0x{index:04X}:{subindex:02X}: {fault}; look whether the file is of this device")
            }
            Self::Other(error) => write!(words, "the EtherCAT devices could not be brought up: {error}"),
        }
    }
}

/// Writes which devices were expected and which ones were found.
fn explain_others(
    expected: &[ExpectedDevice],
    found: &[FoundDevice],
    slot: Option<Slot>,
    words: &mut dyn fmt::Write,
) -> fmt::Result {
    match slot {
        Some(slot) => write!(words, "device {} is another one: expected", slot.number())?,
        None => write!(words, "the EtherCAT cable has other devices: expected {}", expected.len())?,
    }
    let separator = |index| if slot.is_some() { " " } else { before(index) };
    for (index, device) in expected.iter().enumerate() {
        let ExpectedDevice { vendor, product, revision, .. } = device;
        write!(words, "{}vendor 0x{vendor:08X}, product 0x{product:08X}", separator(index))?;
        if let Some(revision) = revision {
            write!(words, ", revision 0x{revision:08X}")?;
        }
    }
    match slot {
        Some(_) => words.write_str("; found")?,
        None => write!(words, "; found {}", found.len())?,
    }
    for (index, device) in found.iter().enumerate() {
        write!(words, "{}{device}", separator(index))?;
    }
    Ok(())
}

const fn before(index: usize) -> &'static str {
    if index == 0 { ": " } else { ", then " }
}

/// Writes what an AL status code says; nothing if there is no error.
pub(crate) fn write_code(words: &mut dyn fmt::Write, code: u16) -> fmt::Result {
    if code == 0 {
        return Ok(());
    }
    match AlStatusCode::unpack_from_slice(&code.to_le_bytes()) {
        Ok(code) => write!(words, ", AL status code {code}"),
        Err(_) => write!(words, ", AL status code 0x{code:04X}"),
    }
}

/// Returns the standard's name of a state.
const fn name(state: SubDeviceState) -> &'static str {
    match state {
        SubDeviceState::None => "no state: it does not answer",
        SubDeviceState::Init => "INIT",
        SubDeviceState::PreOp => "PRE-OP",
        SubDeviceState::Bootstrap => "BOOT",
        SubDeviceState::SafeOp => "SAFE-OP",
        SubDeviceState::Op => "OP",
        SubDeviceState::Other(_) => "an unknown state",
    }
}
