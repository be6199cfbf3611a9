//! The header of every block in connection management, records and alarms.
//!
//! ```text
//! 0..2 BlockType · 2..4 BlockLength, counted from the next field · 4 BlockVersionHigh · 5 BlockVersionLow · 6.. body
//! ```

use super::status::{Block, HeadField, Violation};
use machine::wire::{BigEndian, Reader, Writer};

/// A reader of blocks, which are all big-endian.
pub type BlockReader<'a> = Reader<'a, BigEndian>;
/// A writer of blocks, which are all big-endian.
pub type BlockWriter<'a> = Writer<'a, BigEndian>;

/// Length in bytes of a block's head.
pub const HEAD_LEN: usize = 6;

macro_rules! block_types {
    ($($(#[$doc:meta])* $name:ident = $code:literal,)*) => {
        /// BlockType.
        #[derive(Clone, Copy, PartialEq, Eq, Debug)]
        pub enum BlockType {
            $($(#[$doc])* $name,)*
            /// A type that this version does not know; it survives a round trip.
            Unknown(u16),
        }

        impl From<u16> for BlockType {
            fn from(code: u16) -> Self {
                match code { $($code => Self::$name,)* other => Self::Unknown(other) }
            }
        }

        impl From<BlockType> for u16 {
            fn from(value: BlockType) -> Self {
                match value { $(BlockType::$name => $code,)* BlockType::Unknown(code) => code }
            }
        }
    };
}

block_types! {
    /// AlarmNotification of high priority.
    AlarmNotificationHigh = 0x0001,
    /// AlarmNotification of low priority.
    AlarmNotificationLow = 0x0002,
    /// Header of a Write.
    WriteRequest = 0x0008,
    /// Header of a Read.
    ReadRequest = 0x0009,
    /// DiagnosisData.
    DiagnosisData = 0x0010,
    /// I&M0: identification.
    IdentificationAndMaintenance0 = 0x0020,
    /// ARData.
    ArData = 0x0018,
    /// I&M1.
    IdentificationAndMaintenance1 = 0x0021,
    /// I&M2.
    IdentificationAndMaintenance2 = 0x0022,
    /// I&M3.
    IdentificationAndMaintenance3 = 0x0023,
    /// I&M4.
    IdentificationAndMaintenance4 = 0x0024,
    /// SubstituteValue.
    SubstituteValue = 0x0014,
    /// RecordInputDataObjectElement.
    RecordInputDataObjectElement = 0x0015,
    /// RecordOutputDataObjectElement.
    RecordOutputDataObjectElement = 0x0016,
    /// ExpectedIdentificationData.
    ExpectedIdentification = 0x0012,
    /// RealIdentificationData.
    RealIdentification = 0x0013,
    /// LogBookData.
    LogBook = 0x0019,
    /// APIData.
    ApiData = 0x001A,
    /// PDPortDataCheck.
    PdPortDataCheck = 0x0200,
    /// PDPortDataAdjust.
    PdPortDataAdjust = 0x0202,
    /// PDInterfaceAdjust.
    PdInterfaceAdjust = 0x0250,
    /// PDPortDataReal.
    PdPortDataReal = 0x020F,
    /// PDInterfaceDataReal.
    PdInterfaceDataReal = 0x0240,
    /// MultipleBlockHeader: the blocks of one submodule among those of others.
    MultipleBlockHeader = 0x0400,
    /// I&M0FilterDataSubmodule: the submodules with I&M0 of their own.
    Im0FilterDataSubmodule = 0x0030,
    /// I&M0FilterDataModule: the submodules whose I&M0 is that of their module.
    Im0FilterDataModule = 0x0031,
    /// I&M0FilterDataDevice: the submodule whose I&M0 is that of the device.
    Im0FilterDataDevice = 0x0032,
    /// ARBlockReq.
    Ar = 0x0101,
    /// IOCRBlockReq.
    Iocr = 0x0102,
    /// AlarmCRBlockReq.
    AlarmCr = 0x0103,
    /// ExpectedSubmoduleBlockReq.
    ExpectedSubmodule = 0x0104,
    /// PrmServerBlockReq.
    PrmServer = 0x0105,
    /// MCRBlockReq.
    Mcr = 0x0106,
    /// ARRPCBlockReq.
    ArRpc = 0x0107,
    /// ARVendorBlockReq.
    ArVendor = 0x0108,
    /// IRInfoBlock.
    IrInfo = 0x0109,
    /// SRInfoBlock.
    SrInfo = 0x010A,
    /// ARFSUBlock.
    ArFsu = 0x010B,
    /// RSInfoBlock.
    RsInfo = 0x010C,
    /// IODControl after Connect: PrmEnd.
    PrmEnd = 0x0110,
    /// IODControl after a plug alarm: PrmEnd.
    PrmEndPlug = 0x0111,
    /// IOXControl after Connect: ApplicationReady.
    ApplicationReady = 0x0112,
    /// IOXControl after a plug alarm: ApplicationReady.
    ApplicationReadyPlug = 0x0113,
    /// Release.
    Release = 0x0114,
    /// IODControl: PrmBegin.
    PrmBegin = 0x0118,
    /// SubmoduleListBlock, after PrmBegin.
    SubmoduleList = 0x0119,
    /// AlarmAck of high priority.
    AlarmAckHigh = 0x8001,
    /// AlarmAck of low priority.
    AlarmAckLow = 0x8002,
    /// Header of the answer to a Write.
    WriteResponse = 0x8008,
    /// Header of the answer to a Read.
    ReadResponse = 0x8009,
    /// ARBlockRes.
    ArResponse = 0x8101,
    /// IOCRBlockRes.
    IocrResponse = 0x8102,
    /// AlarmCRBlockRes.
    AlarmCrResponse = 0x8103,
    /// ModuleDiffBlock.
    ModuleDiff = 0x8104,
    /// ARServerBlockRes: the device's station name.
    ArServer = 0x8106,
    /// Answer to PrmEnd.
    PrmEndResponse = 0x8110,
    /// Answer to PrmEnd after a plug alarm.
    PrmEndPlugResponse = 0x8111,
    /// Answer to ApplicationReady.
    ApplicationReadyResponse = 0x8112,
    /// Answer to ApplicationReady after a plug alarm.
    ApplicationReadyPlugResponse = 0x8113,
    /// Answer to Release.
    ReleaseResponse = 0x8114,
    /// Answer to PrmBegin.
    PrmBeginResponse = 0x8118,
}

/// Reads the next block: returns its type and a reader of its body. `faulty` is the block to name in the error for a
/// wrong header.
pub fn next<'a>(
    reader: &mut BlockReader<'a>,
    faulty: impl Fn(BlockType) -> Block,
) -> Result<(BlockType, BlockReader<'a>), Violation> {
    next_known(reader, faulty, |_| true)
}

/// Reads the next block, as [`next()`] does. Its version is checked only if `is_known` says that the block will be read: one
/// that is skipped may be newer.
pub fn next_known<'a>(
    reader: &mut BlockReader<'a>,
    faulty: impl Fn(BlockType) -> Block,
    is_known: impl Fn(BlockType) -> bool,
) -> Result<(BlockType, BlockReader<'a>), Violation> {
    let block_type = reader.u16().map_err(|_| Violation::UnknownBlocks)?.into();
    let wrong = |field| Violation::Head(faulty(block_type), field);
    let length = reader.u16().map_err(|_| wrong(HeadField::Length))?;
    let mut block = reader.sub(usize::from(length)).map_err(|_| wrong(HeadField::Length))?;
    let [version_high, version_low] = block.array().map_err(|_| wrong(HeadField::Length))?;
    match [version_high, version_low] {
        [1, 0] => {}
        _ if !is_known(block_type) => {}
        [1, _] => return Err(wrong(HeadField::VersionLow)),
        _ => return Err(wrong(HeadField::VersionHigh)),
    }
    Ok((block_type, block))
}

/// Writes a block: its header, then what `body` writes; then fills in the length.
pub fn write(writer: &mut BlockWriter<'_>, block_type: BlockType, body: impl FnOnce(&mut BlockWriter<'_>)) {
    write_version(writer, block_type, 0, body);
}

/// Writes a block of this BlockVersionLow, as [`write()`] does.
pub fn write_version(
    writer: &mut BlockWriter<'_>,
    block_type: BlockType,
    version_low: u8,
    body: impl FnOnce(&mut BlockWriter<'_>),
) {
    writer.u16(block_type.into());
    let length_at = writer.len();
    writer.u16(0);
    writer.bytes(&[1, version_low]);
    body(writer);
    let length = writer.len() - length_at - 2;
    writer.patch_u16(length_at, u16::try_from(length).unwrap_or(u16::MAX));
}

/// Converts missing bytes to a violation of this block: a field beyond the end is a wrong BlockLength.
pub(crate) fn short(block: Block) -> impl Fn(machine::wire::Truncated) -> Violation {
    move |_| Violation::Head(block, HeadField::Length)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_block_has_the_length_in_its_header() {
        let mut buf = [0; 16];
        let mut writer = BlockWriter::new(&mut buf);
        write(&mut writer, BlockType::Unknown(0x7777), |w| w.u32(5));
        assert_eq!(writer.finish(), Ok(10));
        assert_eq!(buf[..10], [0x77, 0x77, 0, 6, 1, 0, 0, 0, 0, 5]);

        let mut reader = BlockReader::new(&buf[..10]);
        let (block_type, mut body) = next(&mut reader, |_| Block::Ar).unwrap();
        assert_eq!((block_type, body.u32()), (BlockType::Unknown(0x7777), Ok(5)));
        assert!(reader.is_empty());
    }

    #[test]
    fn a_length_of_zero_or_beyond_the_end_and_another_version_are_different_violations() {
        let parse = |bytes: &[u8]| next(&mut BlockReader::new(bytes), |_| Block::Iocr).map(|_| ());
        let wrong = |field| Err(Violation::Head(Block::Iocr, field));
        assert_eq!(parse(&[1, 2, 0, 0, 1, 0]), wrong(HeadField::Length));
        assert_eq!(parse(&[1, 2, 0, 9, 1, 0]), wrong(HeadField::Length));
        assert_eq!(parse(&[1, 2, 0, 2, 2, 0]), wrong(HeadField::VersionHigh));
        assert_eq!(parse(&[1, 2, 0, 2, 1, 1]), wrong(HeadField::VersionLow));
        assert_eq!(parse(&[1]), Err(Violation::UnknownBlocks));
    }
}
