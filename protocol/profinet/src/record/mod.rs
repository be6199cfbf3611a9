//! Records: Read and Write, MultipleWrite, and the records that every device has.
//!
//! ```text
//! Write request   SeqNumber u16 · ARUUID 16 · API u32 · slot u16 · subslot u16 · padding 2 · index u16
//! (64 bytes)      RecordDataLength u32 · padding 24 · then the record
//! Write response  ... RecordDataLength u32 · AdditionalValue1 u16 · AdditionalValue2 u16 · PNIOStatus u32 · padding 16
//! Read request    ... RecordDataLength u32 (most bytes wanted) · TargetARUUID 16 · padding 8
//! Read response   ... RecordDataLength u32 · AdditionalValue1 u16 · AdditionalValue2 u16 · padding 20 · then the record
//! ```
//!
//! A MultipleWrite is a Write of index 0xE040, whose record is Writes one after another, each at a multiple of four
//! bytes; its answer contains one answer for each.

mod ar_data;
mod channel;
mod contents;
mod diagnosis;
mod identification;
mod io_data;
mod log_book;
mod maintenance;
mod physical_device;
mod physical_parameters;

pub use ar_data::{ArData, IocrData, emit_ar_data};
pub use channel::{ChannelFault, DiagnosisItem, WHOLE_SUBMODULE, channel_error_name, diagnosis_items};
pub use contents::{
    IM0_LEN, emit_api_data, emit_expected_identification, emit_im0, emit_im0_filter_data,
    emit_real_identification,
};
pub use diagnosis::{Diagnosis, parse_diagnosis};
pub use identification::{Identification, RealModule, parse_real_identification};
pub use io_data::IoData;
pub use log_book::{LogBook, LogEntry};
pub use maintenance::Maintenance;
pub use physical_device::{PhysicalDevice, is_port};
pub use physical_parameters::PhysicalParameters;

use physical_device::emit_multiple;

use super::Uuid;
use super::block::{self, BlockReader, BlockType, BlockWriter, short};
use super::status::{Block, HeadField, Status, Violation};
use machine::wire::Truncated;

/// Record indices (IEC 61158-6-10, Index).
pub mod index {
    /// MultipleWrite.
    pub const MULTIPLE_WRITE: u16 = 0xE040;
    /// I&M0: identification.
    pub const IDENTIFICATION_AND_MAINTENANCE_0: u16 = 0xAFF0;
    /// I&M1: function and location.
    pub const IDENTIFICATION_AND_MAINTENANCE_1: u16 = 0xAFF1;
    /// I&M2: date of installation.
    pub const IDENTIFICATION_AND_MAINTENANCE_2: u16 = 0xAFF2;
    /// I&M3: descriptor.
    pub const IDENTIFICATION_AND_MAINTENANCE_3: u16 = 0xAFF3;
    /// I&M4: signature.
    pub const IDENTIFICATION_AND_MAINTENANCE_4: u16 = 0xAFF4;
    /// ExpectedIdentificationData of one subslot.
    pub const EXPECTED_IDENTIFICATION_SUBSLOT: u16 = 0x8000;
    /// RealIdentificationData of one subslot.
    pub const REAL_IDENTIFICATION_SUBSLOT: u16 = 0x8001;
    /// ExpectedIdentificationData of one slot.
    pub const EXPECTED_IDENTIFICATION_SLOT: u16 = 0xC000;
    /// RealIdentificationData of one slot.
    pub const REAL_IDENTIFICATION_SLOT: u16 = 0xC001;
    /// ExpectedIdentificationData of one AR.
    pub const EXPECTED_IDENTIFICATION_AR: u16 = 0xE000;
    /// RealIdentificationData of one AR.
    pub const REAL_IDENTIFICATION_AR: u16 = 0xE001;
    /// Diagnosis, maintenance and status of the device.
    pub const DIAGNOSIS: u16 = 0xF80C;
    /// ModuleDiffBlock of one AR.
    pub const MODULE_DIFF: u16 = 0xE002;
    /// RealIdentificationData of one API.
    pub const REAL_IDENTIFICATION_API: u16 = 0xF000;
    /// ARData of one API.
    pub const AR_DATA_API: u16 = 0xF020;
    /// ARData of the device.
    pub const AR_DATA: u16 = 0xF820;
    /// APIData: the APIs of the device.
    pub const API_DATA: u16 = 0xF821;
    /// RecordInputDataObjectElement of one subslot.
    pub const INPUT_DATA: u16 = 0x8028;
    /// RecordOutputDataObjectElement of one subslot.
    pub const OUTPUT_DATA: u16 = 0x8029;
    /// PDPortDataCheck of one port.
    pub const PD_PORT_DATA_CHECK: u16 = 0x802B;
    /// PDPortDataAdjust of one port.
    pub const PD_PORT_DATA_ADJUST: u16 = 0x802F;
    /// PDInterfaceAdjust of one interface.
    pub const PD_INTERFACE_ADJUST: u16 = 0x8071;
    /// PDExpectedData: what was written to interface and ports of the device.
    pub const PD_EXPECTED_DATA: u16 = 0xF842;
    /// PDPortDataReal of one port.
    pub const PD_PORT_DATA_REAL: u16 = 0x802A;
    /// PDInterfaceDataReal of one interface.
    pub const PD_INTERFACE_DATA_REAL: u16 = 0x8080;
    /// PDRealData: interface and ports of the device.
    pub const PD_REAL_DATA: u16 = 0xF841;
    /// LogBookData.
    pub const LOG_BOOK: u16 = 0xF830;
    /// I&M0FilterData: which submodules have I&M0 of their own.
    pub const IM0_FILTER_DATA: u16 = 0xF840;
    /// Trigger of the monitoring of an AR that is being established: an empty record, which the controller reads while it has
    /// nothing else to call.
    pub const CONNECTION_MONITORING_TRIGGER: u16 = 0xFBFF;
    /// The first index that the application may use is 0, the last this.
    pub const LAST_OF_APPLICATION: u16 = 0x7FFF;
}

/// Length in bytes of the head of each of the four PDUs.
pub const HEADER_LEN: usize = 64;

/// Address of a record in a Read or Write.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Address {
    /// SeqNumber: counts the records of an AR.
    pub sequence: u16,
    /// ARUUID; nil for a Read without an AR.
    pub ar: Uuid,
    /// API.
    pub api: u32,
    /// Slot number.
    pub slot: u16,
    /// Subslot number.
    pub subslot: u16,
    /// Index of the record.
    pub index: u16,
}

impl Address {
    fn parse(body: &mut BlockReader<'_>) -> Result<(Self, u32), Truncated> {
        let sequence = body.u16()?;
        let ar = Uuid::read(body)?;
        let api = body.u32()?;
        let slot = body.u16()?;
        let subslot = body.u16()?;
        body.skip(2)?;
        let index = body.u16()?;
        let length = body.u32()?;
        Ok((Self { sequence, ar, api, slot, subslot, index }, length))
    }

    fn emit(&self, length: u32, writer: &mut BlockWriter<'_>) {
        writer.u16(self.sequence);
        self.ar.write(writer);
        writer.u32(self.api);
        writer.u16(self.slot);
        writer.u16(self.subslot);
        writer.zeros(2);
        writer.u16(self.index);
        writer.u32(length);
    }
}

/// Reads the head of a record PDU: address, RecordDataLength, and the reader over the rest of its 64 bytes.
fn parse_head<'a>(
    reader: &mut BlockReader<'a>,
    wanted: BlockType,
) -> Result<(Address, u32, BlockReader<'a>), Violation> {
    let (block_type, mut body) = block::next(reader, |_| Block::Record)?;
    if block_type != wanted {
        return Err(Violation::Head(Block::Record, HeadField::Type));
    }
    if body.left() + block::HEAD_LEN != HEADER_LEN {
        return Err(Violation::Head(Block::Record, HeadField::Length));
    }
    let (address, length) = Address::parse(&mut body).map_err(short(Block::Record))?;
    Ok((address, length, body))
}

/// A Write.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct WriteRequest<'a> {
    /// Address of the record.
    pub address: Address,
    /// The record.
    pub record: &'a [u8],
}

impl<'a> WriteRequest<'a> {
    /// Parses a Write and moves the reader behind it.
    pub fn parse(reader: &mut BlockReader<'a>) -> Result<Self, Violation> {
        let (address, length, _padding) = parse_head(reader, BlockType::WriteRequest)?;
        let length = usize::try_from(length).map_err(|_| Violation::RecordDataLength)?;
        let record = reader.bytes(length).map_err(|_| Violation::RecordDataLength)?;
        Ok(Self { address, record })
    }

    /// Writes it.
    pub fn emit(&self, writer: &mut BlockWriter<'_>) {
        block::write(writer, BlockType::WriteRequest, |w| {
            self.address.emit(u32::try_from(self.record.len()).unwrap_or(u32::MAX), w);
            w.zeros(24);
        });
        writer.bytes(self.record);
    }

    /// Returns the Writes in a MultipleWrite, up to the first malformed one.
    pub fn writes(&self) -> impl Iterator<Item = Result<WriteRequest<'a>, Violation>> + use<'a> {
        let mut reader = BlockReader::new(self.record);
        core::iter::from_fn(move || {
            if reader.is_empty() {
                return None;
            }
            let part = WriteRequest::parse(&mut reader);
            reader.align(4);
            if part.is_err() {
                reader = BlockReader::new(&[]);
            }
            Some(part)
        })
    }
}

/// Writes a MultipleWrite of these Writes: each begins at a multiple of four bytes. It concerns no submodule, so its place is all
/// ones (IEC 61158-6-10, IODWriteMultipleReq).
pub fn emit_multiple_write<'a>(
    sequence: u16,
    ar: Uuid,
    parts: impl Iterator<Item = WriteRequest<'a>>,
    writer: &mut BlockWriter<'_>,
) {
    let start = writer.len();
    let address = Address {
        sequence,
        ar,
        api: u32::MAX,
        slot: u16::MAX,
        subslot: u16::MAX,
        index: index::MULTIPLE_WRITE,
    };
    WriteRequest { address, record: &[] }.emit(writer);
    let first = writer.len();
    for part in parts {
        let fill = (writer.len() - first).next_multiple_of(4) - (writer.len() - first);
        writer.zeros(fill);
        part.emit(writer);
    }
    let length = u32::try_from(writer.len() - first).unwrap_or(u32::MAX);
    writer.patch_u32(start + RECORD_LENGTH_AT, length);
}

/// Place of RecordDataLength in the head of a record PDU: after block head, SeqNumber, ARUUID, API, slot, subslot, padding and
/// index.
const RECORD_LENGTH_AT: usize = 6 + 2 + 16 + 4 + 2 + 2 + 2 + 2;

/// The answer to a Write.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct WriteResponse {
    /// Address of the record.
    pub address: Address,
    /// RecordDataLength: bytes written.
    pub length: u32,
    /// Result of the Write.
    pub status: Status,
}

impl WriteResponse {
    /// Parses an answer and moves the reader behind it.
    pub fn parse(reader: &mut BlockReader<'_>) -> Result<Self, Violation> {
        let (address, length, mut body) = parse_head(reader, BlockType::WriteResponse)?;
        body.skip(4).map_err(short(Block::Record))?;
        let status = Status(body.u32().map_err(short(Block::Record))?);
        Ok(Self { address, length, status })
    }

    /// Writes it.
    pub fn emit(&self, writer: &mut BlockWriter<'_>) {
        block::write(writer, BlockType::WriteResponse, |w| {
            self.address.emit(self.length, w);
            w.zeros(4);
            w.u32(self.status.0);
            w.zeros(16);
        });
    }
}

/// A Read.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct ReadRequest {
    /// Address of the requested record.
    pub address: Address,
    /// Largest number of bytes to return.
    pub most: u32,
    /// TargetARUUID, for a Read without an AR; else nil.
    pub target_ar: Uuid,
}

impl ReadRequest {
    /// Reads it.
    pub fn parse(reader: &mut BlockReader<'_>) -> Result<Self, Violation> {
        let (address, most, mut body) = parse_head(reader, BlockType::ReadRequest)?;
        let target_ar = Uuid::read(&mut body).map_err(short(Block::Record))?;
        Ok(Self { address, most, target_ar })
    }

    /// Writes it.
    pub fn emit(&self, writer: &mut BlockWriter<'_>) {
        block::write(writer, BlockType::ReadRequest, |w| {
            self.address.emit(self.most, w);
            self.target_ar.write(w);
            w.zeros(8);
        });
    }
}

/// The answer to a Read.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct ReadResponse<'a> {
    /// Address of the record.
    pub address: Address,
    /// The record.
    pub record: &'a [u8],
}

impl<'a> ReadResponse<'a> {
    /// Reads it.
    pub fn parse(reader: &mut BlockReader<'a>) -> Result<Self, Violation> {
        let (address, length, _values) = parse_head(reader, BlockType::ReadResponse)?;
        let length = usize::try_from(length).map_err(|_| Violation::RecordDataLength)?;
        let record = reader.bytes(length).map_err(|_| Violation::RecordDataLength)?;
        Ok(Self { address, record })
    }

    /// Writes it.
    pub fn emit(&self, writer: &mut BlockWriter<'_>) {
        block::write(writer, BlockType::ReadResponse, |w| {
            self.address.emit(u32::try_from(self.record.len()).unwrap_or(u32::MAX), w);
            w.zeros(24);
        });
        writer.bytes(self.record);
    }
}

/// Returns the body of the one block that a written record consists of.
fn only_block(record: &[u8], wanted: BlockType) -> Result<BlockReader<'_>, Violation> {
    let mut reader = BlockReader::new(record);
    let (block_type, body) =
        block::next(&mut reader, |_| Block::Record).map_err(|violation| match violation {
            Violation::Head(_, HeadField::VersionHigh | HeadField::VersionLow) => Violation::InvalidParameter,
            _ => Violation::WriteLength,
        })?;
    if block_type != wanted {
        return Err(Violation::InvalidParameter);
    }
    // A tool may fill the record up to a multiple of four bytes.
    if reader.left() < 4 { Ok(body) } else { Err(Violation::WriteLength) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::captured;
    use crate::rpc::{Header, RequestArgs, ResponseArgs};
    use crate::samples::emitted;

    fn request(text: &str) -> Vec<u8> {
        let datagram = captured::datagram(text);
        let (header, body) = Header::parse(&datagram).unwrap();
        RequestArgs::parse(&header, body).unwrap().blocks.to_vec()
    }

    fn response(text: &str) -> Vec<u8> {
        let datagram = captured::datagram(text);
        let (header, body) = Header::parse(&datagram).unwrap();
        let args = ResponseArgs::parse(&header, body).unwrap();
        assert!(args.status.is_ok());
        args.blocks.to_vec()
    }

    #[test]
    fn a_captured_multiple_write_holds_four_writes() {
        let blocks = request(captured::WRITE_REQ);
        let write = WriteRequest::parse(&mut BlockReader::new(&blocks)).unwrap();
        assert_eq!(write.address.index, index::MULTIPLE_WRITE);
        assert_eq!(emitted(|w| write.emit(w)), blocks);
        let writes: Vec<_> = write
            .writes()
            .map(|write| write.map(|write| (write.address.index, write.record.len())))
            .collect();
        assert_eq!(writes, [Ok((0x8071, 12)), Ok((0x7B, 4)), Ok((0x7C, 4)), Ok((0x7D, 4))]);
    }

    #[test]
    fn the_captured_multiple_write_is_written_again_from_its_writes() {
        let blocks = request(captured::WRITE_REQ);
        let write = WriteRequest::parse(&mut BlockReader::new(&blocks)).unwrap();
        let Address { sequence, ar, .. } = write.address;
        let again = emitted(|w| emit_multiple_write(sequence, ar, write.writes().flatten(), w));
        assert_eq!(again, blocks);
    }

    #[test]
    fn the_captured_answer_to_it_holds_five_heads() {
        let blocks = response(captured::WRITE_RES);
        let mut reader = BlockReader::new(&blocks);
        let mut again = Vec::new();
        while !reader.is_empty() {
            let answer = WriteResponse::parse(&mut reader).unwrap();
            assert!(answer.status.is_ok());
            again.extend(emitted(|w| answer.emit(w)));
        }
        assert_eq!((again.len(), &again), (5 * HEADER_LEN, &blocks));
    }

    #[test]
    fn a_captured_read_of_im0_and_its_answer_come_out_again() {
        for (read, answer) in [
            (captured::IM0_READ_REQ, captured::IM0_READ_RES),
            (captured::IM0_READ_REQ_IF, captured::IM0_READ_RES_IF),
        ] {
            let blocks = request(read);
            let read = ReadRequest::parse(&mut BlockReader::new(&blocks)).unwrap();
            assert_eq!((read.address.index, read.most), (index::IDENTIFICATION_AND_MAINTENANCE_0, 0x8000));
            assert_eq!(emitted(|w| read.emit(w)), blocks);

            let blocks = response(answer);
            let answer = ReadResponse::parse(&mut BlockReader::new(&blocks)).unwrap();
            assert_eq!(answer.address, read.address);
            assert_eq!(answer.record.len(), IM0_LEN);
            assert_eq!(emitted(|w| answer.emit(w)), blocks);
        }
    }

    #[test]
    fn a_record_past_the_end_of_the_request_is_refused() {
        let blocks = request(captured::WRITE_REQ);
        for len in 0..blocks.len() {
            assert!(WriteRequest::parse(&mut BlockReader::new(&blocks[..len])).is_err(), "cut at {len}");
        }
        let cut = [&blocks[..HEADER_LEN + 200]].concat();
        let write = WriteRequest { address: whole_address(&blocks), record: &cut[HEADER_LEN..] };
        let writes: Vec<_> = write.writes().collect();
        assert!(writes[1].is_ok() && writes.last().unwrap().is_err());
    }

    fn whole_address(blocks: &[u8]) -> Address {
        WriteRequest::parse(&mut BlockReader::new(blocks)).unwrap().address
    }
}
