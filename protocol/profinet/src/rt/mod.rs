//! Cyclic data: one frame in each cycle and direction, over Ethernet (RT_CLASS_1) or over UDP (RT_CLASS_UDP).
//!
//! ```text
//! 0..2      FrameID           0x8000–0xBFFF RT_CLASS_2 numbering · 0xC000–0xFBFF RT_CLASS_1 and RT_CLASS_UDP
//! 2..2+n    C_SDU             data with IOPS, and IOCS; n as agreed in the IOCR, 40–1440 (12–1440 over UDP)
//! 2+n..4+n  CycleCounter      clock of the provider, 31.25 µs a count
//! 4+n       DataStatus        bits
//! 5+n       TransferStatus    0
//! ```
//!
//! The PDU stands behind EtherType 0x8892 with a priority tag, or in a datagram to UDP port 34962 (IEC 61158-6-10,
//! 4.7). The IOCRs define the content of the C_SDU; this module treats it as bytes.
//!
//! [`CyclicSender`] and [`CyclicReceiver`] are the provider and the consumer of one IOCR. A controller and a device
//! have one of each.

mod receiver;
mod sender;
mod timing;

pub use receiver::{CyclicReceiver, Received};
pub use sender::{CyclicSender, Route};
pub use timing::{COUNT_NANOS, CycleTime, Transport, UnsupportedCycle, cycle_counter};

use machine::wire::{BigEndian, Reader, Truncated, Writer};

/// UDP port of RT_CLASS_UDP, at both ends.
pub const UDP_PORT: u16 = 0x8892;

/// FrameIDs of unicast cyclic data of RT_CLASS_1 in the numbering that is now used (RTClass 2 in the IOCR).
pub const FRAME_IDS_RT_CLASS_2: core::ops::RangeInclusive<u16> = 0x8000..=0xBBFF;

/// FrameIDs of unicast cyclic data of RT_CLASS_UDP, and of RT_CLASS_1 in the older numbering (RTClass 1 in the IOCR).
pub const FRAME_IDS_RT_CLASS_1_UDP: core::ops::RangeInclusive<u16> = 0xC000..=0xF7FF;

/// Returns whether a FrameID is one of unicast cyclic data, of any class.
#[must_use]
pub fn is_cyclic(frame_id: u16) -> bool {
    FRAME_IDS_RT_CLASS_2.contains(&frame_id) || FRAME_IDS_RT_CLASS_1_UDP.contains(&frame_id)
}

/// Longest C_SDU in bytes.
pub const MAX_C_SDU_LEN: usize = 1440;

/// Status of a submodule's data, by its provider (IOPS) or consumer (IOCS): bit 7 is good or bad, bits 5 and 6 say
/// who detected it, bit 0 says that another byte follows (IEC 61158-6-10, 4.7.2.3).
#[derive(Clone, Copy, PartialEq, Eq, Hash, Default, Debug)]
pub struct IoxStatus(pub u8);

impl IoxStatus {
    /// The data is good.
    pub const GOOD: Self = Self(0x80);
    /// The data is bad, detected by the submodule.
    pub const BAD: Self = Self(0x00);
    /// The data is bad, detected by the device.
    pub const BAD_BY_DEVICE: Self = Self(0x40);
    /// The data is bad, detected by the controller.
    pub const BAD_BY_CONTROLLER: Self = Self(0x60);

    /// Returns whether the data is good.
    #[must_use]
    pub const fn is_good(self) -> bool {
        self.0 & 0x80 != 0
    }
}

/// DataStatus of a cyclic frame.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct DataStatus(pub u8);

impl DataStatus {
    /// Primary of a redundant pair, or the only one.
    pub const PRIMARY: u8 = 1 << 0;
    /// In the data of a backup: there is no primary.
    pub const REDUNDANCY: u8 = 1 << 1;
    /// The data is valid.
    pub const VALID: u8 = 1 << 2;
    /// The provider is in run; without this bit it is in stop.
    pub const RUN: u8 = 1 << 4;
    /// The provider has no problem to report.
    pub const NORMAL: u8 = 1 << 5;
    /// The frame is to be ignored.
    pub const IGNORE: u8 = 1 << 7;

    /// Primary, valid, run, no problem: 0x35.
    pub const RUNNING: Self = Self(Self::PRIMARY | Self::VALID | Self::RUN | Self::NORMAL);

    /// Primary, valid, no problem, but the provider is in stop: 0x25.
    pub const STOPPED: Self = Self(Self::PRIMARY | Self::VALID | Self::NORMAL);

    /// Returns whether all of these bits are set.
    #[must_use]
    pub const fn contains(self, bits: u8) -> bool {
        self.0 & bits == bits
    }

    /// Returns whether the data may be used: valid, from a running provider, and not to be ignored.
    #[must_use]
    pub const fn is_usable(self) -> bool {
        self.contains(Self::VALID | Self::RUN) && !self.contains(Self::IGNORE)
    }
}

impl core::fmt::Debug for DataStatus {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "DataStatus(0x{:02X})", self.0)
    }
}

/// A cyclic frame, from the FrameID on.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct CyclicFrame<'a> {
    /// Number of the connection.
    pub frame_id: u16,
    /// Data with IOPS, and IOCS.
    pub c_sdu: &'a [u8],
    /// The provider's clock in counts of 31.25 µs.
    pub cycle_counter: u16,
    /// State of the provider.
    pub data_status: DataStatus,
    /// 0 unless the frame was damaged in transit.
    pub transfer_status: u8,
}

impl<'a> CyclicFrame<'a> {
    /// Parses a frame whose C_SDU is `c_sdu_len` bytes long; bytes behind its status are padding.
    pub fn parse(payload: &'a [u8], c_sdu_len: usize) -> Result<Self, Truncated> {
        let mut reader = Reader::<BigEndian>::new(payload);
        Ok(Self {
            frame_id: reader.u16()?,
            c_sdu: reader.bytes(c_sdu_len)?,
            cycle_counter: reader.u16()?,
            data_status: DataStatus(reader.u8()?),
            transfer_status: reader.u8()?,
        })
    }

    /// Writes the frame from the FrameID on.
    pub fn emit(&self, writer: &mut Writer<'_, BigEndian>) {
        writer.u16(self.frame_id);
        writer.bytes(self.c_sdu);
        writer.u16(self.cycle_counter);
        writer.u8(self.data_status.0);
        writer.u8(self.transfer_status);
    }
}

#[cfg(test)]
mod tests;
