//! The violations of the protocol, with the only table of their statuses and texts, and the blocks that they name.

use super::{Service, Status};

/// ErrorDecode of read and write access.
pub(super) const PNIORW: u8 = 0x80;
/// ErrorDecode of everything else.
pub(super) const PNIO: u8 = 0x81;

/// A field of every block's header.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum HeadField {
    /// BlockType: not the expected block, or one too many.
    Type,
    /// BlockLength: beyond the end of the PDU, or not the length of its fields.
    Length,
    /// BlockVersionHigh: not 1.
    VersionHigh,
    /// BlockVersionLow: not 0.
    VersionLow,
}

macro_rules! blocks {
    ($($(#[$doc:meta])* $name:ident = $code1:literal, $text:literal;)*) => {
        /// A block that can be faulty.
        #[derive(Clone, Copy, PartialEq, Eq, Debug)]
        pub enum Block { $($(#[$doc])* $name,)* }

        impl Block {
            pub(super) const ALL: &[Self] = &[$(Self::$name),*];

            /// Returns the ErrorCode1 of this block.
            #[must_use]
            pub const fn code1(self) -> u8 {
                match self { $(Self::$name => $code1,)* }
            }

            pub(super) const fn text(self) -> &'static str {
                match self { $(Self::$name => concat!($text, " is faulty"),)* }
            }
        }
    };
}

blocks! {
    /// ARBlockReq.
    Ar = 1, "ARBlockReq";
    /// IOCRBlockReq.
    Iocr = 2, "IOCRBlockReq";
    /// ExpectedSubmoduleBlockReq.
    ExpectedSubmodule = 3, "ExpectedSubmoduleBlockReq";
    /// AlarmCRBlockReq.
    AlarmCr = 4, "AlarmCRBlockReq";
    /// PrmServerBlockReq.
    PrmServer = 5, "PrmServerBlockReq";
    /// MCRBlockReq.
    Mcr = 6, "MCRBlockReq";
    /// ARRPCBlockReq.
    ArRpc = 7, "ARRPCBlockReq";
    /// The header of a Read or Write.
    Record = 8, "the head of the record";
    /// IRInfoBlock.
    IrInfo = 9, "IRInfoBlock";
    /// SRInfoBlock.
    SrInfo = 10, "SRInfoBlock";
    /// ARFSUBlock.
    ArFsu = 11, "ARFSUBlock";
    /// ARVendorBlockReq.
    ArVendor = 12, "ARVendorBlockReq";
    /// RSInfoBlock.
    RsInfo = 13, "RSInfoBlock";
    /// IODControl: ControlBlockConnect (PrmEnd).
    ControlConnect = 20, "ControlBlockConnect of IODControl";
    /// IODControl: ControlBlockPlug.
    ControlPlug = 21, "ControlBlockPlug of IODControl";
    /// IOXControl: ControlBlockConnect (ApplicationReady).
    XControlConnect = 22, "ControlBlockConnect of IOXControl";
    /// IOXControl: ControlBlockPlug.
    XControlPlug = 23, "ControlBlockPlug of IOXControl";
    /// ControlBlockPrmBegin.
    PrmBegin = 24, "ControlBlockPrmBegin";
    /// SubmoduleListBlock.
    SubmoduleList = 25, "SubmoduleListBlock";
    /// ReleaseBlock.
    Release = 40, "ReleaseBlock";
    /// ARBlockRes.
    ArRes = 50, "ARBlockRes";
    /// IOCRBlockRes.
    IocrRes = 51, "IOCRBlockRes";
    /// AlarmCRBlockRes.
    AlarmCrRes = 52, "AlarmCRBlockRes";
    /// ModuleDiffBlock.
    ModuleDiff = 53, "ModuleDiffBlock";
    /// ARServerBlockRes.
    ArServer = 55, "ARServerBlockRes";
}

macro_rules! violations {
    ($($name:ident = $decode:ident $code1:literal $code2:literal $text:literal)*) => {
        /// A peer's violation of the protocol. [`Violation::status`] is the answer to it.
        #[derive(Clone, Copy, PartialEq, Eq, Debug)]
        pub enum Violation {
            /// The header of a block is wrong.
            Head(Block, HeadField),
            $(#[doc = $text] $name,)*
        }

        impl Violation {
            pub(super) const NAMED: &[Self] = &[$(Self::$name),*];

            /// Returns ErrorDecode, ErrorCode1 and ErrorCode2.
            #[must_use]
            pub const fn codes(self) -> [u8; 3] {
                match self {
                    Self::Head(block, field) => [PNIO, block.code1(), field as u8],
                    $(Self::$name => [$decode, $code1, $code2],)*
                }
            }

            /// Returns the violation as text.
            #[must_use]
            pub const fn text(self) -> &'static str {
                match self {
                    Self::Head(block, _) => block.text(),
                    $(Self::$name => $text,)*
                }
            }
        }
    };
}

// The status of each violation. Codes: IEC 61158-6-10, values of ErrorCode1 and ErrorCode2.
violations! {
    ArType = PNIO 1 4 "ARBlockReq: this ARType is not supported"
    ArUuid = PNIO 1 5 "ARBlockReq: the ARUUID is nil"
    InitiatorMac = PNIO 1 7 "ARBlockReq: CMInitiatorMACAdd is a group address"
    InitiatorObject = PNIO 1 8 "ARBlockReq: CMInitiatorObjectUUID is not one of PROFINET"
    ArProperties = PNIO 1 9 "ARBlockReq: these ARProperties are not supported"
    ActivityTimeout = PNIO 1 10 "ARBlockReq: CMInitiatorActivityTimeoutFactor is not 1 to 1000"
    InitiatorRtPort = PNIO 1 11 "ARBlockReq: CMInitiatorUDPRTPort is not above 0x3FF"
    StationNameLength = PNIO 1 12 "ARBlockReq: StationNameLength is not 1 to 240"
    InitiatorStationName = PNIO 1 13 "ARBlockReq: CMInitiatorStationName is not as long as its block says"

    IocrType = PNIO 2 4 "IOCRBlockReq: an IOCRType other than one input and one output CR"
    IocrReference = PNIO 2 5 "IOCRBlockReq: two IOCRs have the same reference"
    IocrLt = PNIO 2 6 "IOCRBlockReq: LT does not fit the RTClass"
    IocrProperties = PNIO 2 7 "IOCRBlockReq: this RTClass is not supported, or not with this startup mode"
    IocrDataLength = PNIO 2 8 "IOCRBlockReq: DataLength is out of range"
    FrameId = PNIO 2 9 "IOCRBlockReq: the FrameID does not fit the RTClass"
    SendClockFactor = PNIO 2 10 "IOCRBlockReq: SendClockFactor is not 1 to 128"
    ReductionRatio = PNIO 2 11 "IOCRBlockReq: ReductionRatio is not a power of two in range, or the cycle is too short or too long for the device"
    Phase = PNIO 2 12 "IOCRBlockReq: Phase is not 1 to ReductionRatio"
    FrameSendOffset = PNIO 2 14 "IOCRBlockReq: FrameSendOffset is past the send clock"
    WatchdogFactor = PNIO 2 15 "IOCRBlockReq: WatchdogFactor is out of range"
    DataHoldFactor = PNIO 2 16 "IOCRBlockReq: DataHoldFactor is out of range"
    IocrTagHeader = PNIO 2 17 "IOCRBlockReq: IOCRTagHeader is not priority 6 without a VLAN"
    IocrApiCount = PNIO 2 19 "IOCRBlockReq: NumberOfAPIs is 0 or too large"
    IocrApi = PNIO 2 20 "IOCRBlockReq: this API is not there"
    IoDataCount = PNIO 2 21 "IOCRBlockReq: NumberOfIODataObjects is too large"
    IoDataSlot = PNIO 2 22 "IOCRBlockReq: an IODataObject names a slot that is not expected"
    IoDataSubslot = PNIO 2 23 "IOCRBlockReq: an IODataObject names a subslot that is not expected"
    IoDataOffset = PNIO 2 24 "IOCRBlockReq: an IODataObject lies past DataLength or over another one"
    IocsCount = PNIO 2 25 "IOCRBlockReq: NumberOfIOCS is too large"
    IocsSlot = PNIO 2 26 "IOCRBlockReq: an IOCS names a slot that is not expected"
    IocsSubslot = PNIO 2 27 "IOCRBlockReq: an IOCS names a subslot that is not expected"
    IocsOffset = PNIO 2 28 "IOCRBlockReq: an IOCS lies past DataLength or over another field"

    ExpectedApiCount = PNIO 3 4 "ExpectedSubmoduleBlockReq: NumberOfAPIs is 0 or too large"
    ExpectedApi = PNIO 3 5 "ExpectedSubmoduleBlockReq: this API is not there"
    ExpectedSlot = PNIO 3 6 "ExpectedSubmoduleBlockReq: this slot is named twice"
    ExpectedModuleProperties = PNIO 3 8 "ExpectedSubmoduleBlockReq: ModuleProperties are not 0"
    ExpectedSubmoduleCount = PNIO 3 9 "ExpectedSubmoduleBlockReq: NumberOfSubmodules is 0 or too large"
    ExpectedSubslot = PNIO 3 10 "ExpectedSubmoduleBlockReq: this subslot is named twice"
    SubmoduleProperties = PNIO 3 12 "ExpectedSubmoduleBlockReq: SubmoduleProperties do not fit the data, or are not supported"
    DataDescription = PNIO 3 13 "ExpectedSubmoduleBlockReq: DataDescription is neither input nor output"
    SubmoduleDataLength = PNIO 3 14 "ExpectedSubmoduleBlockReq: SubmoduleDataLength is above 1439"
    LengthIops = PNIO 3 15 "ExpectedSubmoduleBlockReq: LengthIOPS is not 1"
    LengthIocs = PNIO 3 16 "ExpectedSubmoduleBlockReq: LengthIOCS is not 1"

    AlarmCrType = PNIO 4 4 "AlarmCRBlockReq: AlarmCRType is not 1"
    AlarmCrLt = PNIO 4 5 "AlarmCRBlockReq: LT does not fit the transport"
    AlarmCrProperties = PNIO 4 6 "AlarmCRBlockReq: reserved AlarmCRProperties are set"
    RtaTimeoutFactor = PNIO 4 7 "AlarmCRBlockReq: RTATimeoutFactor is not 1 to 100"
    RtaRetries = PNIO 4 8 "AlarmCRBlockReq: RTARetries is not 3 to 15"
    MaxAlarmDataLength = PNIO 4 10 "AlarmCRBlockReq: MaxAlarmDataLength is not 200 to 1432"
    AlarmCrTagHeaderHigh = PNIO 4 11 "AlarmCRBlockReq: AlarmCRTagHeaderHigh is not priority 6 without a VLAN"
    AlarmCrTagHeaderLow = PNIO 4 12 "AlarmCRBlockReq: AlarmCRTagHeaderLow is not priority 5 without a VLAN"

    RecordArUuid = PNIO 8 5 "the record names an ARUUID that is not there"
    RecordApi = PNIO 8 6 "the record names an API that is not there"
    RecordSlot = PNIO 8 7 "the record names a slot that is not there"
    RecordSubslot = PNIO 8 8 "the record names a subslot that is not there"
    RecordIndex = PNIO 8 10 "the record has an index that does not belong here"
    RecordDataLength = PNIO 8 11 "RecordDataLength is past the end of the request"

    ControlSessionKey = PNIO 20 6 "ControlBlockConnect: the SessionKey is not that of the AR"
    ControlCommand = PNIO 20 8 "ControlBlockConnect: ControlCommand does not fit the block"
    ControlPlugSessionKey = PNIO 21 6 "ControlBlockPlug: the SessionKey is not that of the AR"
    ControlPlugCommand = PNIO 21 8 "ControlBlockPlug: ControlCommand does not fit the block"
    XControlSessionKey = PNIO 22 6 "ControlBlockConnect of IOXControl: the SessionKey is not that of the AR"
    XControlCommand = PNIO 22 8 "ControlBlockConnect of IOXControl: ControlCommand does not fit the block"
    XControlPlugSessionKey = PNIO 23 6 "ControlBlockPlug of IOXControl: the SessionKey is not that of the AR"
    XControlPlugCommand = PNIO 23 8 "ControlBlockPlug of IOXControl: ControlCommand does not fit the block"
    PrmBeginSessionKey = PNIO 24 6 "ControlBlockPrmBegin: the SessionKey is not that of the AR"
    PrmBeginCommand = PNIO 24 8 "ControlBlockPrmBegin: ControlCommand does not fit the block"
    ReleaseSessionKey = PNIO 40 6 "ReleaseBlock: the SessionKey is not that of the AR"
    ReleaseCommand = PNIO 40 8 "ReleaseBlock: ControlCommand does not fit the block"

    AlarmNotSupported = PNIO 60 0 "this alarm is not supported"
    DeviceStateConflict = PNIO 61 0 "the device is not in a state for this (CMDEV)"
    DeviceResources = PNIO 61 1 "the device has no resources for this (CMDEV)"
    ArgsLength = PNIO 64 0 "ArgsLength is not the length of the request"
    UnknownBlocks = PNIO 64 1 "there are blocks that do not belong to this service"
    IocrMissing = PNIO 64 2 "an input or an output IOCR is missing"
    AlarmCrCount = PNIO 64 3 "there is not exactly one AlarmCRBlockReq"
    OutOfArResources = PNIO 64 4 "the device has no AR left"
    ArUuidUnknown = PNIO 64 5 "no AR has this ARUUID"
    StateConflict = PNIO 64 6 "the AR is not in a state for this"
    OutOfMemory = PNIO 64 8 "the request is larger than the device can take"

    Abort = PNIO 253 0 "aborted without a reason"
    SequenceError = PNIO 253 1 "an alarm came with a wrong sequence number"
    InstanceClosed = PNIO 253 2 "the alarm endpoint was closed"
    ConsumerExpired = PNIO 253 5 "no cyclic frame came within the data hold time"
    InitiatorTimeout = PNIO 253 6 "the connection was not completed within the activity timeout"
    AlarmSendTimeout = PNIO 253 8 "the peer did not receive an alarm after its last repetition"
    AlarmDataTooLong = PNIO 253 10 "an alarm was longer than agreed"
    AlarmError = PNIO 253 11 "the peer answered by an alarm error"
    RpcClientError = PNIO 253 12 "the ApplicationReady call failed"
    AbortRequested = PNIO 253 13 "the application asked for the abort"
    ReRun = PNIO 253 14 "a new Connect of the same controller took the AR's place"
    ReleaseReceived = PNIO 253 15 "the AR was released"
    ArRemoved = PNIO 253 17 "the AR was removed"
    ProtocolViolation = PNIO 253 18 "the protocol was violated"
    StationNameChanged = PNIO 253 31 "the station name was changed by DCP"
    FactoryReset = PNIO 253 32 "the station was reset by DCP"
    AddressChanged = PNIO 253 37 "the IP address was changed by DCP"
    ApplicationReadyTimeout = PNIO 253 40 "the ApplicationReady was not answered in time"

    ApplicationReadError = PNIORW 0xA0 0 "the record cannot be read"
    ApplicationWriteError = PNIORW 0xA1 0 "the record cannot be written"
    FeatureNotSupported = PNIORW 0xA9 0 "the record's feature is not supported"
    InvalidIndex = PNIORW 0xB0 0 "there is no record of this index"
    WriteLength = PNIORW 0xB1 0 "the record has another length"
    InvalidSlot = PNIORW 0xB2 0 "there is no such slot or subslot"
    InvalidApi = PNIORW 0xB4 0 "there is no such API"
    RecordStateConflict = PNIORW 0xB5 0 "the record cannot be accessed in this state"
    AccessDenied = PNIORW 0xB6 0 "access to the record is denied"
    InvalidRange = PNIORW 0xB7 0 "the request is out of range"
    InvalidParameter = PNIORW 0xB8 0 "a parameter of the record is wrong"
}

impl Violation {
    /// Returns the status that answers this violation of a service.
    #[must_use]
    pub const fn status(self, service: Service) -> Status {
        let [decode, code1, code2] = self.codes();
        Status::new(service.error_code(), decode, code1, code2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_two_violations_give_the_same_status() {
        for (index, one) in Violation::NAMED.iter().enumerate() {
            for other in &Violation::NAMED[..index] {
                assert_ne!(one.codes(), other.codes(), "{one:?} and {other:?}");
            }
        }
    }
}
