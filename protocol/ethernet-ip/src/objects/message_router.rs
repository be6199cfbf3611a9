//! Message Router, class 02, and its Multiple_Service_Packet (volume 1, 5-3 and appendix A-4.10).

use super::super::cip::{General, ObjectClass, Violation, emit_refusal, service};
use super::super::{Reader, Writer};
use super::{Device, Object};

pub(super) struct MessageRouter;

impl Object for MessageRouter {
    const REVISION: u16 = 1;
    const ATTRIBUTES: &'static [u16] = &[1, 2];
    const CLASS_ATTRIBUTES: &'static [u16] = &[1, 4, 5, 6, 7];

    fn get(
        device: &Device,
        _instance: u32,
        attribute: u16,
        writer: &mut Writer<'_>,
    ) -> Result<(), Violation> {
        match attribute {
            1 => {
                writer.u16(ObjectClass::ALL.len() as u16);
                ObjectClass::ALL.iter().for_each(|class| writer.u16(class.code().into()));
            }
            2 => writer.u16(device.description.explicit.into()),
            _ => return Err(Violation::UnknownAttribute),
        }
        Ok(())
    }

    fn get_of_class(_device: &Device, attribute: u16, writer: &mut Writer<'_>) -> Result<(), Violation> {
        match attribute {
            1 => writer.u16(Self::REVISION),
            2 | 3 => writer.u16(1),
            // Supported optional attributes and services, preceded by their number.
            4 => [2, 1, 2].iter().for_each(|number| writer.u16(*number)),
            5 => [1, service::MULTIPLE_SERVICE.into()].iter().for_each(|number| writer.u16(*number)),
            6 => writer.u16(7),
            7 => writer.u16(2),
            _ => return Err(Violation::UnknownAttribute),
        }
        Ok(())
    }
}

/// Answers a Multiple_Service_Packet; `answer_request` answers each request in it. Returns the reply's length.
///
/// ```text
/// 0..2  count     u16
/// 2..   offsets   u16 each, from the count's place
/// ..    messages
/// ```
pub(in super::super) fn multiple_service(
    data: &[u8],
    reply: &mut [u8],
    answer_request: impl FnMut(&[u8], &mut [u8]) -> usize,
) -> usize {
    match answer_each(data, reply, answer_request) {
        Ok(len) => len,
        Err(violation) => emit_refusal(reply, service::MULTIPLE_SERVICE, violation, |_| {}),
    }
}

fn answer_each(
    data: &[u8],
    reply: &mut [u8],
    mut answer_request: impl FnMut(&[u8], &mut [u8]) -> usize,
) -> Result<usize, Violation> {
    /// Length of the reply's header, before the count.
    const HEAD: usize = 4;

    let mut reader = Reader::new(data);
    let count = reader.u16().map_err(|_| Violation::TooShort)?;
    let mut offsets = reader.sub(2 * usize::from(count)).map_err(|_| Violation::TooShort)?;
    if count == 0 {
        return Err(Violation::TooShort);
    }
    let mut general = General::Success;
    let mut end = HEAD + 2 + 2 * usize::from(count);
    let mut start = usize::from(offsets.u16().map_err(|_| Violation::TooShort)?);
    for index in 0..usize::from(count) {
        let next = offsets.u16().map_or(data.len(), usize::from);
        let request = data.get(start..next).ok_or(Violation::TooShort)?;
        start = next;
        let offset = u16::try_from(end - HEAD).map_err(|_| Violation::ReplyTooLarge)?;
        let place = HEAD + 2 + 2 * index;
        reply
            .get_mut(place..place + 2)
            .ok_or(Violation::ReplyTooLarge)?
            .copy_from_slice(&offset.to_le_bytes());
        let room = reply.get_mut(end..).ok_or(Violation::ReplyTooLarge)?;
        let len = answer_request(request, room);
        match room.get(2) {
            Some(0) if len >= HEAD => {}
            Some(_) if len >= HEAD => general = General::EmbeddedServiceError,
            _ => return Err(Violation::ReplyTooLarge),
        }
        end += len;
    }
    let head = reply.get_mut(..HEAD + 2).ok_or(Violation::ReplyTooLarge)?;
    let mut writer = Writer::new(head);
    writer.bytes(&[service::MULTIPLE_SERVICE | 0x80, 0, general.into(), 0]);
    writer.u16(count);
    Ok(end)
}
