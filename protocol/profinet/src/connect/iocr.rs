//! IOCRBlockReq and IOCRBlockRes: one direction of cyclic data.
//!
//! ```text
//! request   IOCRType u16 · IOCRReference u16 · LT u16 · IOCRProperties u32 (bits 0..4 RTClass) · DataLength u16
//!           FrameID u16 · SendClockFactor u16 (31.25 µs) · ReductionRatio u16 · Phase u16 · Sequence u16
//!           FrameSendOffset u32 (ns) · WatchdogFactor u16 · DataHoldFactor u16 · IOCRTagHeader u16 · multicast MAC 6
//!           NumberOfAPIs u16 · each: API u32
//!             NumberOfIODataObjects u16 · each: slot u16, subslot u16, offset in the C_SDU u16
//!             NumberOfIOCS u16          · each: slot u16, subslot u16, offset in the C_SDU u16
//! response  IOCRType u16 · IOCRReference u16 · FrameID u16
//! ```

use alloc::vec::Vec;

use super::{API, COUNT_LIMIT};
use crate::block::{self, BlockReader, BlockType, BlockWriter, short};
use crate::rt::CycleTime;
use crate::status::{Block, Violation};
use machine::ethernet::Mac;
use machine::wire::Truncated;

/// IOCRType.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum IocrType {
    /// Device to controller.
    Input,
    /// Controller to device.
    Output,
    /// A type that this version does not know; it survives a round trip.
    Unknown(u16),
}

impl From<u16> for IocrType {
    fn from(code: u16) -> Self {
        match code {
            1 => Self::Input,
            2 => Self::Output,
            other => Self::Unknown(other),
        }
    }
}

impl From<IocrType> for u16 {
    fn from(value: IocrType) -> Self {
        match value {
            IocrType::Input => 1,
            IocrType::Output => 2,
            IocrType::Unknown(code) => code,
        }
    }
}

/// RTClass: transport and FrameIDs of cyclic frames.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum RtClass {
    /// RT_CLASS_1 with the FrameIDs of legacy devices, 0xC000 to 0xFBFF.
    Legacy1,
    /// RT_CLASS_1 with FrameIDs 0x8000 to 0xBFFF (RT_CLASS_2 in old texts).
    Class1,
    /// RT_CLASS_UDP: over UDP port 34962, FrameIDs 0xC000 to 0xFBFF.
    Udp,
    /// A class that this version does not know; it survives a round trip.
    Unknown(u8),
}

impl From<u8> for RtClass {
    fn from(code: u8) -> Self {
        match code {
            1 => Self::Legacy1,
            2 => Self::Class1,
            4 => Self::Udp,
            other => Self::Unknown(other),
        }
    }
}

impl From<RtClass> for u8 {
    fn from(value: RtClass) -> Self {
        match value {
            RtClass::Legacy1 => 1,
            RtClass::Class1 => 2,
            RtClass::Udp => 4,
            RtClass::Unknown(code) => code,
        }
    }
}

/// Position in the frame of a submodule's data with its provider status, or of its consumer status.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Object {
    /// Slot number.
    pub slot: u16,
    /// Subslot number.
    pub subslot: u16,
    /// Bytes from the start of the C_SDU.
    pub offset: u16,
}

/// An IOCRBlockReq.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Iocr {
    /// IOCRType.
    pub iocr_type: IocrType,
    /// IOCRReference: the controller's number for it.
    pub reference: u16,
    /// LT: the EtherType of its frames.
    pub lt: u16,
    /// RTClass, bits 0 to 3 of IOCRProperties.
    pub rt_class: RtClass,
    /// The other bits of IOCRProperties, not shifted.
    pub properties: u32,
    /// DataLength: the C_SDU's length in bytes.
    pub data_length: u16,
    /// FrameID; for an output IOCR a proposal, 0xFFFF = the device shall choose.
    pub frame_id: u16,
    /// SendClockFactor: the send clock in units of 31.25 µs.
    pub send_clock_factor: u16,
    /// ReductionRatio: send clocks per frame.
    pub reduction_ratio: u16,
    /// Phase: the send clock within the ratio, from 1.
    pub phase: u16,
    /// Sequence: position within the phase; 0 = any.
    pub sequence: u16,
    /// FrameSendOffset in ns within the send clock; 0xFFFFFFFF = best effort.
    pub frame_send_offset: u32,
    /// WatchdogFactor, in cycles.
    pub watchdog_factor: u16,
    /// DataHoldFactor, in cycles: after this time without a frame the data is no longer valid.
    pub data_hold_factor: u16,
    /// IOCRTagHeader: the 802.1Q tag of its frames.
    pub tag_header: u16,
    /// IOCRMulticastMACAdd; zero for unicast.
    pub multicast_mac: Mac,
    /// Data with provider status, of API 0.
    pub objects: Vec<Object>,
    /// Consumer statuses, of API 0.
    pub consumer_statuses: Vec<Object>,
}

impl Iocr {
    /// FrameSendOffset that lets the sender choose.
    pub const BEST_EFFORT: u32 = 0xFFFF_FFFF;

    /// Returns the time from one frame to the next.
    #[must_use]
    pub const fn cycle_time(&self) -> CycleTime {
        CycleTime { send_clock_factor: self.send_clock_factor, reduction_ratio: self.reduction_ratio }
    }

    pub(super) fn parse(body: &mut BlockReader<'_>) -> Result<Self, Violation> {
        let short = short(Block::Iocr);
        let mut iocr = Self::parse_fields(body).map_err(&short)?;
        let apis = body.u16().map_err(&short)?;
        if apis == 0 || usize::from(apis) > COUNT_LIMIT {
            return Err(Violation::IocrApiCount);
        }
        for _ in 0..apis {
            if body.u32().map_err(&short)? != API {
                return Err(Violation::IocrApi);
            }
            parse_objects(body, &mut iocr.objects, Violation::IoDataCount)?;
            parse_objects(body, &mut iocr.consumer_statuses, Violation::IocsCount)?;
        }
        Ok(iocr)
    }

    fn parse_fields(body: &mut BlockReader<'_>) -> Result<Self, Truncated> {
        let iocr_type = body.u16()?.into();
        let reference = body.u16()?;
        let lt = body.u16()?;
        let properties = body.u32()?;
        Ok(Self {
            iocr_type,
            reference,
            lt,
            rt_class: ((properties & 0xF) as u8).into(),
            properties: properties & !0xF,
            data_length: body.u16()?,
            frame_id: body.u16()?,
            send_clock_factor: body.u16()?,
            reduction_ratio: body.u16()?,
            phase: body.u16()?,
            sequence: body.u16()?,
            frame_send_offset: body.u32()?,
            watchdog_factor: body.u16()?,
            data_hold_factor: body.u16()?,
            tag_header: body.u16()?,
            multicast_mac: Mac(body.array()?),
            objects: Vec::new(),
            consumer_statuses: Vec::new(),
        })
    }

    pub(super) fn emit(&self, writer: &mut BlockWriter<'_>) {
        block::write(writer, BlockType::Iocr, |w| {
            w.u16(self.iocr_type.into());
            w.u16(self.reference);
            w.u16(self.lt);
            w.u32(self.properties | u32::from(u8::from(self.rt_class)));
            w.u16(self.data_length);
            w.u16(self.frame_id);
            w.u16(self.send_clock_factor);
            w.u16(self.reduction_ratio);
            w.u16(self.phase);
            w.u16(self.sequence);
            w.u32(self.frame_send_offset);
            w.u16(self.watchdog_factor);
            w.u16(self.data_hold_factor);
            w.u16(self.tag_header);
            w.bytes(&self.multicast_mac.0);
            w.u16(1);
            w.u32(API);
            for objects in [&self.objects, &self.consumer_statuses] {
                w.u16(u16::try_from(objects.len()).unwrap_or(u16::MAX));
                for object in objects {
                    w.u16(object.slot);
                    w.u16(object.subslot);
                    w.u16(object.offset);
                }
            }
        });
    }
}

fn parse_objects(
    body: &mut BlockReader<'_>,
    objects: &mut Vec<Object>,
    too_many: Violation,
) -> Result<(), Violation> {
    let short = short(Block::Iocr);
    let count = body.u16().map_err(&short)?;
    if objects.len() + usize::from(count) > COUNT_LIMIT {
        return Err(too_many);
    }
    for _ in 0..count {
        let slot = body.u16().map_err(&short)?;
        let subslot = body.u16().map_err(&short)?;
        let offset = body.u16().map_err(&short)?;
        objects.push(Object { slot, subslot, offset });
    }
    Ok(())
}

/// An IOCRBlockRes.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct IocrResponse {
    /// IOCRType.
    pub iocr_type: IocrType,
    /// IOCRReference of the request.
    pub reference: u16,
    /// The FrameID in use; that of the output IOCR is chosen by the device.
    pub frame_id: u16,
}

impl IocrResponse {
    pub(super) fn parse(body: &mut BlockReader<'_>) -> Result<Self, Violation> {
        let short = short(Block::IocrRes);
        Ok(Self {
            iocr_type: body.u16().map_err(&short)?.into(),
            reference: body.u16().map_err(&short)?,
            frame_id: body.u16().map_err(&short)?,
        })
    }

    pub(super) fn emit(&self, writer: &mut BlockWriter<'_>) {
        block::write(writer, BlockType::IocrResponse, |w| {
            w.u16(self.iocr_type.into());
            w.u16(self.reference);
            w.u16(self.frame_id);
        });
    }
}
