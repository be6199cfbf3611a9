//! RTA: alarms, their acknowledgements, and the error PDU that aborts an AR.
//!
//! ```text
//! 0..2 AlarmDstEndpoint · 2..4 AlarmSrcEndpoint · 4 PDUType (1 in the high half; 1 DATA, 2 NACK, 3 ACK, 4 ERR)
//! 5 AddFlags (bits 0..4 window size, bit 4 TACK: acknowledge at once) · 6..8 SendSeqNum · 8..10 AckSeqNum
//! 10..12 VarPartLen · 12.. the variable part
//! ```
//!
//! The PDU follows FrameID 0xFC01 (high priority) or 0xFE01 (low). A DATA PDU carries one alarm block, an ERR PDU a
//! PNIOStatus and then data of the vendor's choice.

use super::block::{self, BlockReader, BlockType, BlockWriter, short};
use super::status::{Block, HeadField, Status, Violation};
use machine::wire::{BigEndian, Reader, Truncated, Writer};

/// Length in bytes of the header.
pub const HEADER_LEN: usize = 12;

/// FrameID of alarms of high priority.
pub const FRAME_ID_HIGH: u16 = 0xFC01;
/// FrameID of alarms of low priority, and of error PDUs.
pub const FRAME_ID_LOW: u16 = 0xFE01;

/// PDUType.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum PduType {
    /// An alarm or its acknowledgement by the application.
    Data,
    /// A PDU was refused.
    Nack,
    /// Acknowledges a PDU.
    Ack,
    /// The AR is aborted.
    Error,
    /// A type that this version does not know; it survives a round trip.
    Unknown(u8),
}

impl From<u8> for PduType {
    fn from(code: u8) -> Self {
        match code {
            1 => Self::Data,
            2 => Self::Nack,
            3 => Self::Ack,
            4 => Self::Error,
            other => Self::Unknown(other),
        }
    }
}

impl From<PduType> for u8 {
    fn from(value: PduType) -> Self {
        match value {
            PduType::Data => 1,
            PduType::Nack => 2,
            PduType::Ack => 3,
            PduType::Error => 4,
            PduType::Unknown(code) => code,
        }
    }
}

/// Why bytes are not an RTA PDU.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
pub enum Error {
    /// It is shorter than its header or its VarPartLen.
    #[error("the RTA PDU is cut: {0}")]
    Truncated(#[from] Truncated),
    /// The version is not 1.
    #[error("RTA version {0}, where there is only 1")]
    Version(u8),
}

/// The header of an RTA PDU.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Rta {
    /// AlarmDstEndpoint: the receiver's alarm reference.
    pub destination: u16,
    /// AlarmSrcEndpoint: the sender's alarm reference.
    pub source: u16,
    /// PDUType.
    pub pdu_type: PduType,
    /// AddFlags: window size and TACK.
    pub flags: u8,
    /// SendSeqNum: number of this PDU.
    pub send_sequence: u16,
    /// AckSeqNum: number of the last PDU received.
    pub ack_sequence: u16,
}

impl Rta {
    /// AddFlags of a DATA PDU: window of one, acknowledge at once.
    pub const WINDOW_1_TACK: u8 = 0x11;
    /// AddFlags of every other PDU: window of one.
    pub const WINDOW_1: u8 = 0x01;

    /// Parses a PDU into the header and the variable part. Bytes behind it are padding.
    pub fn parse(pdu: &[u8]) -> Result<(Self, &[u8]), Error> {
        let mut reader = Reader::<BigEndian>::new(pdu);
        let destination = reader.u16()?;
        let source = reader.u16()?;
        let [pdu_type, flags] = reader.array()?;
        let send_sequence = reader.u16()?;
        let ack_sequence = reader.u16()?;
        let length = reader.u16()?;
        if pdu_type >> 4 != 1 {
            return Err(Error::Version(pdu_type >> 4));
        }
        let variable = reader.bytes(usize::from(length))?;
        let pdu_type = (pdu_type & 0xF).into();
        Ok((Self { destination, source, pdu_type, flags, send_sequence, ack_sequence }, variable))
    }

    /// Writes the header and what `variable` writes.
    pub fn emit(
        &self,
        writer: &mut Writer<'_, BigEndian>,
        variable: impl FnOnce(&mut Writer<'_, BigEndian>),
    ) {
        writer.u16(self.destination);
        writer.u16(self.source);
        writer.bytes(&[0x10 | u8::from(self.pdu_type), self.flags]);
        writer.u16(self.send_sequence);
        writer.u16(self.ack_sequence);
        let length_at = writer.len();
        writer.u16(0);
        variable(writer);
        let length = writer.len() - length_at - 2;
        writer.patch_u16(length_at, u16::try_from(length).unwrap_or(u16::MAX));
    }

    /// Writes an error PDU: the header and the status.
    pub fn emit_error(&self, status: Status, writer: &mut Writer<'_, BigEndian>) {
        self.emit(writer, |w| w.u32(status.0));
    }
}

/// Returns the SendSeqNum after this one: 0xFFFE, 0xFFFF, and then 15 bits that wrap around (IEC 61158-6-10).
pub(crate) const fn next_sequence(sequence: u16) -> u16 {
    if sequence >= 0xFFFE { sequence.wrapping_add(1) } else { (sequence + 1) & 0x7FFF }
}

/// Returns the status in the variable part of an error PDU.
#[must_use]
pub fn error_status(variable: &[u8]) -> Option<Status> {
    Reader::<BigEndian>::new(variable).u32().ok().map(Status)
}

/// Priority of an alarm.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Priority {
    /// High: process alarms.
    High,
    /// Low: diagnosis.
    Low,
}

/// An AlarmNotification.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Notification<'a> {
    /// Its priority.
    pub priority: Priority,
    /// Its type and source.
    pub head: AlarmHead,
    /// ModuleIdentNumber.
    pub module_ident: u32,
    /// SubmoduleIdentNumber.
    pub submodule_ident: u32,
    /// AlarmSpecifier: bits 0..11 sequence number, 11.. kinds of pending diagnosis.
    pub specifier: u16,
    /// UserStructureIdentifier and data, one after another.
    pub items: &'a [u8],
}

/// An AlarmAck: the application received the alarm.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Acknowledgement {
    /// Its priority.
    pub priority: Priority,
    /// Its type and source.
    pub head: AlarmHead,
    /// AlarmSpecifier of the notification.
    pub specifier: u16,
    /// The application's result.
    pub status: Status,
}

/// Type and source of an alarm.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct AlarmHead {
    /// AlarmType: 1 diagnosis, 2 process, 3 pull, 4 plug, 0x0C diagnosis disappears, ...
    pub alarm_type: u16,
    /// API.
    pub api: u32,
    /// Slot number.
    pub slot: u16,
    /// Subslot number.
    pub subslot: u16,
}

impl AlarmHead {
    fn parse(body: &mut BlockReader<'_>) -> Result<Self, Truncated> {
        Ok(Self { alarm_type: body.u16()?, api: body.u32()?, slot: body.u16()?, subslot: body.u16()? })
    }

    fn emit(&self, writer: &mut BlockWriter<'_>) {
        writer.u16(self.alarm_type);
        writer.u32(self.api);
        writer.u16(self.slot);
        writer.u16(self.subslot);
    }
}

/// The block in a DATA PDU.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Alarm<'a> {
    /// An alarm.
    Notification(Notification<'a>),
    /// Its acknowledgement.
    Acknowledgement(Acknowledgement),
}

impl<'a> Alarm<'a> {
    /// Parses the variable part of a DATA PDU.
    pub fn parse(variable: &'a [u8]) -> Result<Self, Violation> {
        let mut reader = BlockReader::new(variable);
        let (block_type, mut body) = block::next(&mut reader, |_| Block::AlarmCr)?;
        let short = short(Block::AlarmCr);
        let priority = match block_type {
            BlockType::AlarmNotificationHigh | BlockType::AlarmAckHigh => Priority::High,
            _ => Priority::Low,
        };
        let head = AlarmHead::parse(&mut body).map_err(&short)?;
        match block_type {
            BlockType::AlarmNotificationHigh | BlockType::AlarmNotificationLow => {
                Ok(Self::Notification(Notification {
                    priority,
                    head,
                    module_ident: body.u32().map_err(&short)?,
                    submodule_ident: body.u32().map_err(&short)?,
                    specifier: body.u16().map_err(&short)?,
                    items: body.rest(),
                }))
            }
            BlockType::AlarmAckHigh | BlockType::AlarmAckLow => Ok(Self::Acknowledgement(Acknowledgement {
                priority,
                head,
                specifier: body.u16().map_err(&short)?,
                status: Status(body.u32().map_err(&short)?),
            })),
            _ => Err(Violation::Head(Block::AlarmCr, HeadField::Type)),
        }
    }

    /// Writes the variable part of a DATA PDU.
    pub fn emit(&self, writer: &mut BlockWriter<'_>) {
        match self {
            Self::Notification(notification) => {
                let block_type = match notification.priority {
                    Priority::High => BlockType::AlarmNotificationHigh,
                    Priority::Low => BlockType::AlarmNotificationLow,
                };
                block::write(writer, block_type, |w| {
                    notification.head.emit(w);
                    w.u32(notification.module_ident);
                    w.u32(notification.submodule_ident);
                    w.u16(notification.specifier);
                    w.bytes(notification.items);
                });
            }
            Self::Acknowledgement(acknowledgement) => {
                let block_type = match acknowledgement.priority {
                    Priority::High => BlockType::AlarmAckHigh,
                    Priority::Low => BlockType::AlarmAckLow,
                };
                block::write(writer, block_type, |w| {
                    acknowledgement.head.emit(w);
                    w.u16(acknowledgement.specifier);
                    w.u32(acknowledgement.status.0);
                });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::captured;

    /// Destination, source, tag, EtherType and FrameID come before the PDU.
    const PDU_AT: usize = 20;

    #[test]
    fn every_captured_alarm_frame_is_parsed_and_written_back_unchanged() {
        let mut seen = 0;
        for (name, text) in captured::ALL.iter().filter(|(name, _)| name.starts_with("alarm_")) {
            let frame = captured::frame(text);
            let pdu = &frame[PDU_AT..];
            let (rta, variable) = Rta::parse(pdu).unwrap();
            let mut buf = [0; 100];
            let mut writer = Writer::new(&mut buf);
            match rta.pdu_type {
                PduType::Data => {
                    let alarm = Alarm::parse(variable).unwrap();
                    rta.emit(&mut writer, |w| alarm.emit(w));
                }
                PduType::Ack => rta.emit(&mut writer, |_| {}),
                PduType::Error => {
                    let status = error_status(variable).unwrap();
                    assert!(!status.text().contains("no name"), "{name}: {status:?}");
                    rta.emit(&mut writer, |w| w.bytes(variable));
                }
                other => panic!("{name}: {other:?}"),
            }
            let len = writer.finish().unwrap();
            assert_eq!((len, &buf[..len]), (12 + variable.len(), &pdu[..len]), "{name}");
            seen += 1;
        }
        assert_eq!(seen, 16);
    }

    #[test]
    fn the_numbers_of_pdus_wrap_around_at_15_bits_after_their_start() {
        assert_eq!([0xFFFE, 0xFFFF, 0, 0x7FFE, 0x7FFF].map(next_sequence), [0xFFFF, 0, 1, 0x7FFF, 0]);
    }

    #[test]
    fn a_cut_pdu_and_another_version_are_refused() {
        let frame = captured::frame(captured::ALARM_DIAG_NOTIF);
        let pdu = &frame[PDU_AT..];
        for len in 0..pdu.len() {
            assert!(Rta::parse(&pdu[..len]).is_err());
        }
        let (_, variable) = Rta::parse(pdu).unwrap();
        for len in 0..variable.len() {
            assert!(Alarm::parse(&variable[..len]).is_err());
        }
        let mut other = pdu.to_vec();
        other[4] = 0x21;
        assert_eq!(Rta::parse(&other), Err(Error::Version(2)));
    }
}
