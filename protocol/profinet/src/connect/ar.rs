//! ARBlockReq and ARBlockRes.
//!
//! ```text
//! request   ARType u16 · ARUUID 16 · SessionKey u16 · CMInitiatorMACAdd 6 · CMInitiatorObjectUUID 16
//!           ARProperties u32 · CMInitiatorActivityTimeoutFactor u16 · CMInitiatorUDPRTPort u16
//!           StationNameLength u16 · CMInitiatorStationName
//! response  ARType u16 · ARUUID 16 · SessionKey u16 · CMResponderMACAdd 6 · CMResponderUDPRTPort u16
//! ```

use super::StationName;
use crate::Uuid;
use crate::block::{self, BlockReader, BlockType, BlockWriter, short};
use crate::status::{Block, Violation};
use machine::ethernet::Mac;
use machine::wire::Truncated;

/// ARProperties.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub struct ArProperties(pub u32);

impl ArProperties {
    /// State = Active; the only state there is.
    pub const ACTIVE: u32 = 1;
    /// The controller itself writes the parameters.
    pub const PARAMETERIZATION_BY_INITIATOR: u32 = 1 << 4;
    /// The AR reads and writes records only, without cyclic data.
    pub const DEVICE_ACCESS: u32 = 1 << 8;
    /// Advanced startup mode; without it, legacy.
    pub const ADVANCED_STARTUP: u32 = 1 << 30;

    /// Returns bits 0 to 2: State.
    #[must_use]
    pub const fn state(self) -> u32 {
        self.0 & 7
    }

    /// Returns whether all bits of `mask` are set.
    #[must_use]
    pub const fn has(self, mask: u32) -> bool {
        self.0 & mask == mask
    }
}

/// An ARBlockReq.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Ar {
    /// ARType; 1 = IOCARSingle.
    pub ar_type: u16,
    /// ARUUID: identifies the AR in every later request.
    pub uuid: Uuid,
    /// SessionKey: number of the controller's attempt.
    pub session: u16,
    /// CMInitiatorMACAdd.
    pub initiator_mac: Mac,
    /// CMInitiatorObjectUUID: the object in calls to the controller.
    pub initiator_object: Uuid,
    /// ARProperties.
    pub properties: ArProperties,
    /// CMInitiatorActivityTimeoutFactor, in 100 ms: longest time of one step of the connection's establishment.
    pub activity_timeout: u16,
    /// CMInitiatorUDPRTPort.
    pub initiator_rt_port: u16,
    /// CMInitiatorStationName.
    pub initiator_name: StationName,
}

impl Ar {
    /// ARType of a plain AR.
    pub const IOCAR_SINGLE: u16 = 1;

    pub(super) fn parse(body: &mut BlockReader<'_>) -> Result<Self, Violation> {
        let (mut ar, name_len) = Self::parse_fields(body).map_err(short(Block::Ar))?;
        if name_len == 0 || name_len > 240 {
            return Err(Violation::StationNameLength);
        }
        if body.left() != usize::from(name_len) {
            return Err(Violation::InitiatorStationName);
        }
        ar.initiator_name = body.rest().to_vec();
        Ok(ar)
    }

    fn parse_fields(body: &mut BlockReader<'_>) -> Result<(Self, u16), Truncated> {
        let ar = Self {
            ar_type: body.u16()?,
            uuid: Uuid::read(body)?,
            session: body.u16()?,
            initiator_mac: Mac(body.array()?),
            initiator_object: Uuid::read(body)?,
            properties: ArProperties(body.u32()?),
            activity_timeout: body.u16()?,
            initiator_rt_port: body.u16()?,
            initiator_name: StationName::new(),
        };
        Ok((ar, body.u16()?))
    }

    pub(super) fn emit(&self, writer: &mut BlockWriter<'_>) {
        block::write(writer, BlockType::Ar, |w| {
            w.u16(self.ar_type);
            self.uuid.write(w);
            w.u16(self.session);
            w.bytes(&self.initiator_mac.0);
            self.initiator_object.write(w);
            w.u32(self.properties.0);
            w.u16(self.activity_timeout);
            w.u16(self.initiator_rt_port);
            w.u16(u16::try_from(self.initiator_name.len()).unwrap_or(u16::MAX));
            w.bytes(&self.initiator_name);
        });
    }
}

/// An ARBlockRes.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct ArResponse {
    /// ARType.
    pub ar_type: u16,
    /// ARUUID.
    pub uuid: Uuid,
    /// SessionKey.
    pub session: u16,
    /// CMResponderMACAdd.
    pub responder_mac: Mac,
    /// CMResponderUDPRTPort.
    pub responder_rt_port: u16,
}

impl ArResponse {
    pub(super) fn parse(body: &mut BlockReader<'_>) -> Result<Self, Violation> {
        Self::parse_fields(body).map_err(short(Block::ArRes))
    }

    fn parse_fields(body: &mut BlockReader<'_>) -> Result<Self, Truncated> {
        Ok(Self {
            ar_type: body.u16()?,
            uuid: Uuid::read(body)?,
            session: body.u16()?,
            responder_mac: Mac(body.array()?),
            responder_rt_port: body.u16()?,
        })
    }

    pub(super) fn emit(&self, writer: &mut BlockWriter<'_>) {
        block::write(writer, BlockType::ArResponse, |w| {
            w.u16(self.ar_type);
            self.uuid.write(w);
            w.u16(self.session);
            w.bytes(&self.responder_mac.0);
            w.u16(self.responder_rt_port);
        });
    }
}
