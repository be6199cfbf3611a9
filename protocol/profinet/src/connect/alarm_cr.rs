//! AlarmCRBlockReq and AlarmCRBlockRes.
//!
//! ```text
//! request   AlarmCRType u16 · LT u16 · AlarmCRProperties u32 (bit 0 priority, bit 1 transport over UDP)
//!           RTATimeoutFactor u16 (100 ms) · RTARetries u16 · LocalAlarmReference u16 · MaxAlarmDataLength u16
//!           AlarmCRTagHeaderHigh u16 · AlarmCRTagHeaderLow u16
//! response  AlarmCRType u16 · LocalAlarmReference u16 · MaxAlarmDataLength u16
//! ```

use crate::block::{self, BlockReader, BlockType, BlockWriter, short};
use crate::status::{Block, Violation};
use machine::wire::Truncated;

/// An AlarmCRBlockReq.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct AlarmCr {
    /// AlarmCRType; 1 is the only one.
    pub alarm_cr_type: u16,
    /// LT: the EtherType of its frames.
    pub lt: u16,
    /// AlarmCRProperties.
    pub properties: u32,
    /// RTATimeoutFactor, in 100 ms: time until an alarm is repeated.
    pub rta_timeout: u16,
    /// RTARetries: number of repetitions.
    pub rta_retries: u16,
    /// LocalAlarmReference: the controller's alarm endpoint.
    pub local_reference: u16,
    /// MaxAlarmDataLength in bytes.
    pub max_data_length: u16,
    /// AlarmCRTagHeaderHigh: the 802.1Q tag of alarms of high priority.
    pub tag_high: u16,
    /// AlarmCRTagHeaderLow: the 802.1Q tag of alarms of low priority.
    pub tag_low: u16,
}

impl AlarmCr {
    /// Bit of AlarmCRProperties: alarms go over UDP.
    pub const OVER_UDP: u32 = 1 << 1;

    pub(super) fn parse(body: &mut BlockReader<'_>) -> Result<Self, Violation> {
        Self::parse_fields(body).map_err(short(Block::AlarmCr))
    }

    fn parse_fields(body: &mut BlockReader<'_>) -> Result<Self, Truncated> {
        Ok(Self {
            alarm_cr_type: body.u16()?,
            lt: body.u16()?,
            properties: body.u32()?,
            rta_timeout: body.u16()?,
            rta_retries: body.u16()?,
            local_reference: body.u16()?,
            max_data_length: body.u16()?,
            tag_high: body.u16()?,
            tag_low: body.u16()?,
        })
    }

    pub(super) fn emit(&self, writer: &mut BlockWriter<'_>) {
        block::write(writer, BlockType::AlarmCr, |w| {
            w.u16(self.alarm_cr_type);
            w.u16(self.lt);
            w.u32(self.properties);
            w.u16(self.rta_timeout);
            w.u16(self.rta_retries);
            w.u16(self.local_reference);
            w.u16(self.max_data_length);
            w.u16(self.tag_high);
            w.u16(self.tag_low);
        });
    }
}

/// An AlarmCRBlockRes.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct AlarmCrResponse {
    /// AlarmCRType.
    pub alarm_cr_type: u16,
    /// LocalAlarmReference: the device's alarm endpoint.
    pub local_reference: u16,
    /// MaxAlarmDataLength in bytes.
    pub max_data_length: u16,
}

impl AlarmCrResponse {
    pub(super) fn parse(body: &mut BlockReader<'_>) -> Result<Self, Violation> {
        let short = short(Block::AlarmCrRes);
        Ok(Self {
            alarm_cr_type: body.u16().map_err(&short)?,
            local_reference: body.u16().map_err(&short)?,
            max_data_length: body.u16().map_err(&short)?,
        })
    }

    pub(super) fn emit(&self, writer: &mut BlockWriter<'_>) {
        block::write(writer, BlockType::AlarmCrResponse, |w| {
            w.u16(self.alarm_cr_type);
            w.u16(self.local_reference);
            w.u16(self.max_data_length);
        });
    }
}
