//! The states of the devices: what they are asked for in the register AL control, and what they answer (ETG.1000.6).

use ethercrab::error::Error;
use ethercrab::{Command, MainDevice, RegisterAddress, SubDeviceState};

use crate::datagrams::Datagrams;

/// Requests for a state; bit 4 acknowledges an error.
pub(crate) const REQUEST_INIT: u16 = 0x0011;
pub(crate) const REQUEST_SAFE_OP: u16 = 0x0004;
pub(crate) const REQUEST_OP: u16 = 0x0008;
pub(crate) const ACKNOWLEDGE_IN_SAFE_OP: u16 = 0x0014;
pub(crate) const ACKNOWLEDGE_IN_OP: u16 = 0x0018;

/// Command and register by which ethercrab reads the states of its devices in each cycle, and the error indication there.
const FPRD: u8 = 4;
const AL_STATUS: u16 = 0x0130;
const ERROR: u8 = 0x10;

/// Station address of the first device; ethercrab numbers the others from there.
const FIRST_STATION: u16 = 0x1000;

/// AL status and AL status code of a device.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct Status {
    pub(crate) state: SubDeviceState,
    /// Whether the device indicates an error: it refused a state or left it.
    pub(crate) is_error: bool,
    pub(crate) code: u16,
}

impl Status {
    /// Reads the status of a device, counted from 0.
    pub(crate) async fn read(main: &MainDevice<'_>, index: usize) -> Result<Self, Error> {
        let read = Command::fprd(station(index), RegisterAddress::AlStatus.into());
        Ok(Self::of(read.receive::<[u8; 6]>(main).await?))
    }

    const fn of([status, _, _, _, low, high]: [u8; 6]) -> Self {
        let state = match status & 0x0F {
            1 => SubDeviceState::Init,
            2 => SubDeviceState::PreOp,
            3 => SubDeviceState::Bootstrap,
            4 => SubDeviceState::SafeOp,
            8 => SubDeviceState::Op,
            other => SubDeviceState::Other(other),
        };
        Self { state, is_error: status & 0x10 != 0, code: u16::from_le_bytes([low, high]) }
    }
}

/// Which devices indicated an error when their AL status came last. ethercrab returns their states without that bit.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub(crate) struct ErrorBits(u64);

impl ErrorBits {
    /// Creates the bits of devices without errors.
    pub(crate) const fn none() -> Self {
        Self(0)
    }

    /// Takes note of the AL status of each device that a received frame has.
    pub(crate) fn note(&mut self, frame: &[u8]) {
        for datagram in Datagrams::of(frame) {
            let (FPRD, AL_STATUS, 1) = (datagram.command, datagram.register, datagram.working_counter) else {
                continue;
            };
            let index = datagram.device.wrapping_sub(FIRST_STATION);
            let (Some(bit), Some(status)) = (1_u64.checked_shl(index.into()), datagram.data.first()) else {
                continue;
            };
            self.0 = if status & ERROR == 0 { self.0 & !bit } else { self.0 | bit };
        }
    }

    /// Returns whether a device, counted from 0, indicates an error.
    pub(crate) fn has(self, index: usize) -> bool {
        u32::try_from(index)
            .ok()
            .and_then(|index| self.0.checked_shr(index))
            .is_some_and(|bits| bits & 1 != 0)
    }

    /// Returns whether no device indicates an error.
    pub(crate) const fn is_empty(self) -> bool {
        self.0 == 0
    }
}

/// Requests a state of a device, counted from 0.
pub(crate) async fn request(main: &MainDevice<'_>, index: usize, control: u16) -> Result<(), Error> {
    Command::fpwr(station(index), RegisterAddress::AlControl.into()).send(main, control).await
}

/// Returns the station address of a device, counted from 0.
fn station(index: usize) -> u16 {
    FIRST_STATION.wrapping_add(u16::try_from(index).unwrap_or(u16::MAX))
}
