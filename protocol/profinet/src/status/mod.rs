//! PNIOStatus: the status of a refusal.
//!
//! ```text
//! 0 ErrorCode · 1 ErrorDecode · 2 ErrorCode1 · 3 ErrorCode2        IEC 61158-6-10, PNIOStatus
//! ```
//!
//! In an RPC PDU it is one 32-bit number in the sender's byte order. ErrorCode names the service that failed, ErrorDecode
//! defines the meaning of the other two, ErrorCode1 names the block or the state machine, ErrorCode2 the field or reason.

mod violation;

pub use violation::{Block, HeadField, Violation};

use core::fmt;

use violation::{PNIO, PNIORW};

/// A PNIOStatus.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct Status(pub u32);

impl Status {
    /// Success.
    pub const OK: Self = Self(0);

    /// Creates a status from its four bytes.
    #[must_use]
    pub const fn new(code: u8, decode: u8, code1: u8, code2: u8) -> Self {
        Self(u32::from_be_bytes([code, decode, code1, code2]))
    }

    /// Returns whether it is success.
    #[must_use]
    pub const fn is_ok(self) -> bool {
        self.0 == 0
    }

    /// Returns ErrorCode: the service that failed, see [`Service::error_code`].
    #[must_use]
    pub const fn code(self) -> u8 {
        self.0.to_be_bytes()[0]
    }

    /// Returns ErrorDecode: 0x80 for PNIORW, 0x81 for PNIO.
    #[must_use]
    pub const fn decode(self) -> u8 {
        self.0.to_be_bytes()[1]
    }

    /// Returns ErrorCode1: the block, the state machine or the class of an access error.
    #[must_use]
    pub const fn code1(self) -> u8 {
        self.0.to_be_bytes()[2]
    }

    /// Returns ErrorCode2: the field of the block, or the reason.
    #[must_use]
    pub const fn code2(self) -> u8 {
        self.0.to_be_bytes()[3]
    }

    /// Returns whether it is about the access to a record (PNIORW), and not about the protocol.
    #[must_use]
    pub const fn is_access_error(self) -> bool {
        self.decode() == PNIORW
    }

    /// Returns the status as text.
    #[must_use]
    pub fn text(self) -> &'static str {
        if self.is_ok() {
            return "";
        }
        let reason = [self.decode(), self.code1(), self.code2()];
        let named = Violation::NAMED.iter().find(|violation| violation.codes() == reason);
        let user_code2 = || {
            let class = [self.decode(), self.code1(), 0];
            Violation::NAMED.iter().find(|violation| self.decode() == PNIORW && violation.codes() == class)
        };
        let block = || {
            let block = Block::ALL.iter().find(|block| block.code1() == self.code1());
            block.filter(|_| self.decode() == PNIO)
        };
        named
            .or_else(user_code2)
            .map(|violation| violation.text())
            .or_else(|| block().map(|block| block.text()))
            .unwrap_or("a status that has no name here; IEC 61158-6-10, PNIOStatus lists more")
    }
}

impl fmt::Debug for Status {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [code, decode, code1, code2] = self.0.to_be_bytes();
        write!(f, "Status({code:02X} {decode:02X} {code1:02X} {code2:02X} {})", self.text())
    }
}

/// The service that a status answers.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Service {
    /// Connect.
    Connect,
    /// Release.
    Release,
    /// Control: PrmBegin, PrmEnd, ApplicationReady.
    Control,
    /// Read.
    Read,
    /// Write.
    Write,
    /// An error PDU that aborts the AR.
    Abort,
    /// An acknowledged alarm.
    AlarmAck,
}

impl Service {
    /// Returns the ErrorCode of this service.
    #[must_use]
    pub const fn error_code(self) -> u8 {
        match self {
            Self::Abort => 0xCF,
            Self::AlarmAck => 0xDA,
            Self::Connect => 0xDB,
            Self::Release => 0xDC,
            Self::Control => 0xDD,
            Self::Read => 0xDE,
            Self::Write => 0xDF,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_violation_gives_its_status_and_the_status_its_text() {
        let status = Violation::IoDataOffset.status(Service::Connect);
        assert_eq!(status, Status::new(0xDB, 0x81, 0x02, 0x18));
        assert_eq!(status.text(), "IOCRBlockReq: an IODataObject lies past DataLength or over another one");

        let status = Violation::Head(Block::AlarmCr, HeadField::Length).status(Service::Connect);
        assert_eq!(status, Status(0xDB81_0401));
        assert_eq!(status.text(), "AlarmCRBlockReq is faulty");
    }

    #[test]
    fn the_text_of_an_access_error_does_not_depend_on_its_second_code() {
        assert_eq!(Status(0xDE80_B0FF).text(), "there is no record of this index");
        assert!(Status(0xDE99_0000).text().starts_with("a status that has no name here"));
    }

    #[test]
    fn a_status_is_four_bytes() {
        let status = Status::new(0xDB, 0x81, 0x02, 0x05);
        assert_eq!(status, Status(0xDB81_0205));
        assert_eq!([status.code(), status.decode(), status.code1(), status.code2()], [0xDB, 0x81, 2, 5]);
    }
}
