//! The codes in an RPC header: PDU types, operations, flags; and the statuses of RPC itself.

/// Kind of a PDU.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Kind {
    /// A call.
    Request,
    /// Asks whether the call is still being executed.
    Ping,
    /// The answer to a call.
    Response,
    /// The call was started and failed; the body is one RPC status.
    Fault,
    /// The call is being executed.
    Working,
    /// The call is unknown; the answer to a ping.
    NoCall,
    /// The call was not started; the body is one RPC status.
    Reject,
    /// Acknowledges the response.
    Ack,
    /// Cancels the call.
    Cancel,
    /// Acknowledges a fragment.
    FragmentAck,
    /// Acknowledges a Cancel.
    CancelAck,
    /// A kind that this version does not know; it survives a round trip.
    Unknown(u8),
}

impl From<u8> for Kind {
    fn from(code: u8) -> Self {
        match code {
            0 => Self::Request,
            1 => Self::Ping,
            2 => Self::Response,
            3 => Self::Fault,
            4 => Self::Working,
            5 => Self::NoCall,
            6 => Self::Reject,
            7 => Self::Ack,
            8 => Self::Cancel,
            9 => Self::FragmentAck,
            10 => Self::CancelAck,
            other => Self::Unknown(other),
        }
    }
}

impl From<Kind> for u8 {
    fn from(kind: Kind) -> Self {
        match kind {
            Kind::Request => 0,
            Kind::Ping => 1,
            Kind::Response => 2,
            Kind::Fault => 3,
            Kind::Working => 4,
            Kind::NoCall => 5,
            Kind::Reject => 6,
            Kind::Ack => 7,
            Kind::Cancel => 8,
            Kind::FragmentAck => 9,
            Kind::CancelAck => 10,
            Kind::Unknown(code) => code,
        }
    }
}

/// Operation of a call: the operation number of the device and controller interfaces.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Operation {
    /// Connect: sets an AR up.
    Connect,
    /// Release: ends an AR.
    Release,
    /// Read within an AR.
    Read,
    /// Write within an AR.
    Write,
    /// Control: PrmBegin, PrmEnd, ApplicationReady.
    Control,
    /// Read without an AR.
    ReadImplicit,
    /// An operation that this version does not know; it survives a round trip.
    Unknown(u16),
}

impl From<u16> for Operation {
    fn from(code: u16) -> Self {
        match code {
            0 => Self::Connect,
            1 => Self::Release,
            2 => Self::Read,
            3 => Self::Write,
            4 => Self::Control,
            5 => Self::ReadImplicit,
            other => Self::Unknown(other),
        }
    }
}

impl Operation {
    /// Returns the operation number.
    pub(super) const fn code(self) -> u16 {
        match self {
            Self::Connect => 0,
            Self::Release => 1,
            Self::Read => 2,
            Self::Write => 3,
            Self::Control => 4,
            Self::ReadImplicit => 5,
            Self::Unknown(code) => code,
        }
    }
}

impl From<Operation> for u16 {
    fn from(operation: Operation) -> Self {
        operation.code()
    }
}

/// Flags1 of the header.
pub mod flags {
    /// The last fragment.
    pub const LAST_FRAGMENT: u8 = 0x02;
    /// One fragment of several.
    pub const FRAGMENT: u8 = 0x04;
    /// No FragmentAck is requested.
    pub const NO_FRAGMENT_ACK: u8 = 0x08;
    /// No answer is requested.
    pub const MAYBE: u8 = 0x10;
    /// Executing the call twice is harmless.
    pub const IDEMPOTENT: u8 = 0x20;
    /// The call goes to everyone.
    pub const BROADCAST: u8 = 0x40;
}

/// Statuses of RPC itself, the body of a Reject or Fault (C706, appendix E).
pub mod rpc_status {
    /// There is no operation with this number.
    pub const OPERATION_RANGE: u32 = 0x1C01_0002;
    /// The interface is not offered here.
    pub const UNKNOWN_INTERFACE: u32 = 0x1C01_0003;
    /// The call cannot be executed, for a reason without a code of its own (C706, appendix E).
    pub const UNSPECIFIED_REJECT: u32 = 0x1C00_0009;
    /// The protocol was violated.
    pub const PROTOCOL_ERROR: u32 = 0x1C01_000B;
    /// The server does not have the called object.
    pub const OBJECT_NOT_FOUND: u32 = 0x1C00_0024;
    /// The server has no room for the call.
    pub const SERVER_TOO_BUSY: u32 = 0x1C01_0014;
}
