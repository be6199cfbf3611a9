//! Requests to the message router and its replies (volume 1, 2-4).
//!
//! ```text
//! request                          reply
//! 0     service   u8, bit 7 clear  0     service            u8, bit 7 set
//! 1     path size u8, words        1     0
//! 2..   path                       2     general status     u8
//! ..    data                       3     additional size    u8, words
//!                                  4..   additional status
//!                                  ..    data
//! ```

use super::super::{Reader, Writer};
use super::path::Path;
use super::status::General;
use super::violation::Violation;
use machine::wire::Truncated;

/// Service codes (volume 1, appendix A; those from 0x4B on belong to the object).
pub mod service {
    /// Get_Attributes_All.
    pub const GET_ATTRIBUTES_ALL: u8 = 0x01;
    /// Get_Attribute_List.
    pub const GET_ATTRIBUTE_LIST: u8 = 0x03;
    /// Set_Attribute_List.
    pub const SET_ATTRIBUTE_LIST: u8 = 0x04;
    /// Reset.
    pub const RESET: u8 = 0x05;
    /// Multiple_Service_Packet.
    pub const MULTIPLE_SERVICE: u8 = 0x0A;
    /// Get_Attribute_Single.
    pub const GET_ATTRIBUTE_SINGLE: u8 = 0x0E;
    /// Set_Attribute_Single.
    pub const SET_ATTRIBUTE_SINGLE: u8 = 0x10;
    /// Get_and_Clear, of the Ethernet Link.
    pub const GET_AND_CLEAR: u8 = 0x4C;
    /// Forward_Close, of the Connection Manager.
    pub const FORWARD_CLOSE: u8 = 0x4E;
    /// Unconnected_Send, of the Connection Manager.
    pub const UNCONNECTED_SEND: u8 = 0x52;
    /// Forward_Open, of the Connection Manager.
    pub const FORWARD_OPEN: u8 = 0x54;
    /// Get_Connection_Data, of the Connection Manager.
    pub const GET_CONNECTION_DATA: u8 = 0x56;
    /// Search_Connection_Data, of the Connection Manager.
    pub const SEARCH_CONNECTION_DATA: u8 = 0x57;
    /// Get_Connection_Owner, of the Connection Manager.
    pub const GET_CONNECTION_OWNER: u8 = 0x5A;
    /// Large_Forward_Open, of the Connection Manager.
    pub const LARGE_FORWARD_OPEN: u8 = 0x5B;
}

/// A request.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Request<'a> {
    /// The requested service.
    pub service: u8,
    /// The object that executes it.
    pub path: Path<'a>,
    /// Its parameters.
    pub data: &'a [u8],
}

impl<'a> Request<'a> {
    /// Parses a request. An error includes the service, for the reply.
    pub fn parse(message: &'a [u8]) -> Result<Self, (u8, Violation)> {
        let mut reader = Reader::new(message);
        let Ok(service) = reader.u8() else { return Err((0, Violation::TooShort)) };
        let Ok(words) = reader.u8() else { return Err((service, Violation::TooShort)) };
        let Ok(path) = reader.bytes(2 * usize::from(words)) else {
            return Err((service, Violation::PathSize));
        };
        Ok(Self { service, path: Path(path), data: reader.rest() })
    }

    /// Writes a request; `path` writes an even number of bytes.
    pub fn emit(
        writer: &mut Writer<'_>,
        service: u8,
        path: impl FnOnce(&mut Writer<'_>),
        data: impl FnOnce(&mut Writer<'_>),
    ) {
        let head = writer.len();
        writer.u16(0);
        path(writer);
        let words = (writer.len().saturating_sub(head + 2)) / 2;
        writer.patch_u16(head, u16::from_le_bytes([service, u8::try_from(words).unwrap_or(u8::MAX)]));
        data(writer);
    }
}

/// A reply.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Reply<'a> {
    /// The requested service, with bit 7 cleared.
    pub service: u8,
    /// The result.
    pub general: General,
    /// Additional status words as bytes.
    pub additional: &'a [u8],
    /// The data that the service returns.
    pub data: &'a [u8],
}

impl<'a> Reply<'a> {
    /// Parses a reply.
    pub fn parse(message: &'a [u8]) -> Result<Self, Truncated> {
        let mut reader = Reader::new(message);
        let service = reader.u8()? & 0x7F;
        reader.skip(1)?;
        let general = reader.u8()?.into();
        let words = reader.u8()?;
        let additional = reader.bytes(2 * usize::from(words))?;
        Ok(Self { service, general, additional, data: reader.rest() })
    }

    /// Returns the additional status word `index`.
    #[must_use]
    pub fn additional_status(&self, index: usize) -> Option<u16> {
        let mut reader = Reader::new(self.additional);
        reader.skip(2 * index).ok()?;
        reader.u16().ok()
    }
}

/// Writes the reply to `service`: what `data` writes, or its violation. Returns the length.
pub fn emit_reply(
    buf: &mut [u8],
    service: u8,
    data: impl FnOnce(&mut Writer<'_>) -> Result<General, Violation>,
) -> usize {
    let mut writer = Writer::new(buf);
    writer.bytes(&[service | 0x80, 0, 0, 0]);
    let result = data(&mut writer);
    if let Ok(general) = result {
        writer.patch_u16(2, u8::from(general).into());
    }
    match (result, writer.finish()) {
        (Ok(_), Ok(len)) => len,
        (Ok(_), Err(_)) => emit_refusal(buf, service, Violation::ReplyTooLarge, |_| {}),
        (Err(violation), _) => emit_refusal(buf, service, violation, |_| {}),
    }
}

/// Writes a reply that refuses `service`, with what `data` writes behind the status. Returns the length.
pub fn emit_refusal(
    buf: &mut [u8],
    service: u8,
    violation: Violation,
    data: impl FnOnce(&mut Writer<'_>),
) -> usize {
    let mut writer = Writer::new(buf);
    writer.bytes(&[service | 0x80, 0]);
    violation.status().emit(&mut writer);
    data(&mut writer);
    writer.finish().unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_request_is_split_into_service_path_and_data() {
        let request = Request::parse(b"\x0E\x03\x20\x01\x24\x01\x30\x07\xAA").unwrap();
        assert_eq!((request.service, request.data), (0x0E, &b"\xAA"[..]));
        let target = request.path.target().unwrap();
        assert_eq!((target.class, target.instance, target.attribute), (Some(1), Some(1), Some(7)));
    }

    #[test]
    fn the_error_for_a_truncated_request_has_its_service_if_it_contains_one() {
        assert_eq!(Request::parse(b""), Err((0, Violation::TooShort)));
        assert_eq!(Request::parse(b"\x0E"), Err((0x0E, Violation::TooShort)));
        assert_eq!(Request::parse(b"\x0E\xFF\x20\x01"), Err((0x0E, Violation::PathSize)));
    }

    #[test]
    fn a_reply_that_is_too_large_is_replaced_by_an_error_reply() {
        let mut buf = [0; 8];
        let len = emit_reply(&mut buf, 1, |w| {
            w.zeros(100);
            Ok(General::Success)
        });
        assert_eq!(&buf[..len], [0x81, 0, 0x11, 0]);
    }
}
