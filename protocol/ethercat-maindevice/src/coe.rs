//! CoE as bytes: accesses to objects, and what comes back (ETG.1000.4, mailbox; ETG.1000.6, 5.6.2).
//!
//! ```text
//! mailbox header  length u16 of what follows the header · address u16 · channel and priority u8 · type and counter u8
//! CoE header      number and service u16
//! SDO             command u8 · index u16 · subindex u8 · data; a segment has its data after the command
//! ```

/// Bytes of the mailbox header.
const HEADER: usize = 6;

/// Bytes of the CoE header and of a segment's command.
const SEGMENT_HEAD: usize = 3;

/// Bytes of the CoE header, of command, index and subindex, and of the whole length.
const TRANSFER_HEAD: usize = 2 + 4 + 4;

/// Least bytes of a segment's data.
const LEAST_SEGMENT: usize = 7;

/// Types of mailbox messages.
const ERROR: u8 = 0;
const COE: u8 = 3;

/// Services of CoE, in the highest four bits of its header.
const EMERGENCY: u16 = 1;
const SDO_REQUEST: u16 = 2;
const SDO_RESPONSE: u16 = 3;

/// Bits of an SDO's command.
const COMPLETE: u8 = 0x10;
const TOGGLE: u8 = 0x10;
const EXPEDITED: u8 = 0x02;
const HAS_SIZE: u8 = 0x01;
const LAST: u8 = 0x01;
const ABORT: u8 = 0x80;

/// Object that is read or written.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct SdoObject {
    pub(crate) index: u16,
    pub(crate) subindex: u8,
    /// True for all entries from the subindex on, 0 or 1, at once.
    pub(crate) is_complete: bool,
}

/// Message of a device.
#[derive(PartialEq, Eq, Debug)]
pub(crate) enum Mail<'m> {
    Emergency([u8; 8]),
    /// The device could not handle a message, for this reason.
    Fault(u16),
    Sdo(Sdo<'m>),
    /// A message of another protocol or service.
    Other,
}

/// Answer of a device to an access.
#[derive(PartialEq, Eq, Debug)]
pub(crate) enum Sdo<'m> {
    Aborted {
        index: u16,
        subindex: u8,
        code: u32,
    },
    /// The first part of an object, with its whole length if there may be more.
    Uploaded {
        index: u16,
        subindex: u8,
        whole: Option<u32>,
        data: &'m [u8],
    },
    UploadedSegment {
        toggle: bool,
        is_last: bool,
        data: &'m [u8],
    },
    Downloaded {
        index: u16,
        subindex: u8,
    },
    DownloadedSegment {
        toggle: bool,
    },
}

/// Makes a message of an SDO service. Its counter is 0: unused, since ethercrab counts its own messages.
fn mail(sdo: &[u8]) -> Vec<u8> {
    let length = u16::try_from(2 + sdo.len()).unwrap_or(u16::MAX);
    let mut mail = Vec::with_capacity(HEADER + 2 + sdo.len());
    mail.extend(length.to_le_bytes());
    mail.extend([0, 0, 0, COE]);
    mail.extend((SDO_REQUEST << 12).to_le_bytes());
    mail.extend(sdo);
    mail
}

fn head(command: u8, object: SdoObject) -> Vec<u8> {
    let [low, high] = object.index.to_le_bytes();
    let complete = if object.is_complete { COMPLETE } else { 0 };
    vec![command | complete, low, high, object.subindex]
}

const fn toggle_bit(toggle: bool) -> u8 {
    if toggle { TOGGLE } else { 0 }
}

/// Makes the request to read an object.
pub(crate) fn upload(object: SdoObject) -> Vec<u8> {
    let mut sdo = head(2 << 5, object);
    sdo.extend([0; 4]);
    mail(&sdo)
}

/// Makes the request for the next segment of an object.
pub(crate) fn upload_segment(toggle: bool) -> Vec<u8> {
    mail(&[3 << 5 | toggle_bit(toggle), 0, 0, 0, 0, 0, 0, 0])
}

/// Makes the request to write an object by a mailbox of so many bytes. Returns it with the number of bytes of data in it; others
/// follow in segments.
pub(crate) fn download(object: SdoObject, data: &[u8], room: usize) -> (Vec<u8>, usize) {
    if let Some(unused @ 0..4) = 4_usize.checked_sub(data.len()) {
        let mut sdo = head(1 << 5 | EXPEDITED | HAS_SIZE | (unused as u8) << 2, object);
        sdo.extend(data);
        sdo.resize(8, 0);
        return (mail(&sdo), data.len());
    }
    let most = room.saturating_sub(HEADER + TRANSFER_HEAD);
    let first = data.get(..most).unwrap_or(data);
    let mut sdo = head(1 << 5 | HAS_SIZE, object);
    sdo.extend(u32::try_from(data.len()).unwrap_or(u32::MAX).to_le_bytes());
    sdo.extend(first);
    (mail(&sdo), first.len())
}

/// Makes the request to write the next segment. Returns it with the number of bytes of data in it.
pub(crate) fn download_segment(toggle: bool, data: &[u8], room: usize) -> (Vec<u8>, usize) {
    let most = room.saturating_sub(HEADER + SEGMENT_HEAD).max(LEAST_SEGMENT);
    let part = data.get(..most).unwrap_or(data);
    let unused = LEAST_SEGMENT.saturating_sub(part.len()) as u8;
    let last = if part.len() == data.len() { LAST } else { 0 };
    let mut sdo = vec![toggle_bit(toggle) | unused << 1 | last];
    sdo.extend(part);
    sdo.resize(sdo.len().max(1 + LEAST_SEGMENT), 0);
    (mail(&sdo), part.len())
}

/// Makes the message that ends an access.
pub(crate) fn abort(object: SdoObject, code: u32) -> Vec<u8> {
    let mut sdo = head(ABORT, SdoObject { is_complete: false, ..object });
    sdo.extend(code.to_le_bytes());
    mail(&sdo)
}

/// Reads a message; `None` if its lengths do not fit together.
pub(crate) fn parse(mail: &[u8]) -> Option<Mail<'_>> {
    let ([low, high, _, _, _, kind], rest) = mail.split_first_chunk::<HEADER>()?;
    let body = rest.get(..usize::from(u16::from_le_bytes([*low, *high])))?;
    match kind & 0x0F {
        ERROR => {
            let (_, detail) = body.split_first_chunk::<2>()?;
            Some(Mail::Fault(u16::from_le_bytes(*detail.first_chunk()?)))
        }
        COE => {
            let (head, sdo) = body.split_first_chunk::<2>()?;
            match u16::from_le_bytes(*head) >> 12 {
                EMERGENCY => Some(Mail::Emergency(*sdo.first_chunk()?)),
                SDO_REQUEST | SDO_RESPONSE => parse_sdo(sdo).map(Mail::Sdo),
                _ => Some(Mail::Other),
            }
        }
        _ => Some(Mail::Other),
    }
}

fn parse_sdo(sdo: &[u8]) -> Option<Sdo<'_>> {
    let (command, rest) = sdo.split_first()?;
    let toggle = command & TOGGLE != 0;
    let place = || {
        let [low, high, subindex] = *rest.first_chunk()?;
        Some((u16::from_le_bytes([low, high]), subindex))
    };
    let data = || rest.get(3..);
    Some(match command >> 5 {
        4 => {
            let (index, subindex) = place()?;
            Sdo::Aborted { index, subindex, code: u32::from_le_bytes(*data()?.first_chunk()?) }
        }
        2 => {
            let (index, subindex) = place()?;
            let (value, more) = data()?.split_first_chunk::<4>()?;
            if command & EXPEDITED != 0 {
                let unused = if command & HAS_SIZE != 0 { usize::from(command >> 2 & 3) } else { 0 };
                Sdo::Uploaded { index, subindex, whole: None, data: value.get(..4 - unused)? }
            } else {
                Sdo::Uploaded { index, subindex, whole: Some(u32::from_le_bytes(*value)), data: more }
            }
        }
        0 => {
            let unused = if rest.len() == LEAST_SEGMENT { usize::from(command >> 1 & 7) } else { 0 };
            let data = rest.get(..rest.len().checked_sub(unused)?)?;
            Sdo::UploadedSegment { toggle, is_last: command & LAST != 0, data }
        }
        3 => {
            let (index, subindex) = place()?;
            Sdo::Downloaded { index, subindex }
        }
        1 => Sdo::DownloadedSegment { toggle },
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const OBJECT: SdoObject = SdoObject { index: 0x1018, subindex: 1, is_complete: false };

    #[test]
    fn requests_are_those_of_the_specification() {
        assert_eq!(upload(OBJECT), [10, 0, 0, 0, 0, 3, 0, 0x20, 0x40, 0x18, 0x10, 1, 0, 0, 0, 0]);
        let complete = SdoObject { subindex: 0, is_complete: true, ..OBJECT };
        assert_eq!(upload(complete)[8..12], [0x50, 0x18, 0x10, 0]);
        let (expedited, taken) = download(OBJECT, &[7, 8], 128);
        assert_eq!((&expedited[8..], taken), (&[0x2B, 0x18, 0x10, 1, 7, 8, 0, 0][..], 2));
        let (normal, taken) = download(complete, &[9; 6], 128);
        assert_eq!((&normal[8..18], taken), (&[0x31, 0x18, 0x10, 0, 6, 0, 0, 0, 9, 9][..], 6));
        // Nothing, and more than the mailbox holds.
        assert_eq!(download(OBJECT, &[], 128).0[8..], [0x21, 0x18, 0x10, 1, 0, 0, 0, 0]);
        let (first, taken) = download(OBJECT, &[1; 50], 32);
        assert_eq!((first.len(), taken), (32, 16));
        let (segment, taken) = download_segment(true, &[2; 34], 32);
        assert_eq!((segment.len(), taken, segment[8]), (32, 23, 0x10));
        let (last, taken) = download_segment(false, &[3; 5], 32);
        assert_eq!((&last[8..], taken), (&[0x05, 3, 3, 3, 3, 3, 0, 0][..], 5));
    }

    #[test]
    fn a_message_cut_or_altered_anywhere_is_taken_without_a_panic() {
        let whole = [10, 0, 0, 0, 0, 3, 0, 0x30, 0x4B, 0x18, 0x10, 1, 7, 8, 0, 0];
        let uploaded = Sdo::Uploaded { index: 0x1018, subindex: 1, whole: None, data: &[7, 8] };
        assert_eq!(parse(&whole), Some(Mail::Sdo(uploaded)));
        for len in 0..whole.len() {
            assert_eq!(parse(&whole[..len]), None, "{len}");
        }
        for place in 0..whole.len() {
            for value in 0..=u8::MAX {
                let mut altered = whole;
                altered[place] = value;
                let _ = parse(&altered);
            }
        }
        assert_eq!(parse(&[4, 0, 0, 0, 0, 0, 1, 0, 8, 0]), Some(Mail::Fault(8)));
        assert_eq!(parse(&[4, 0, 0, 0, 0, 5, 1, 0, 8, 0]), Some(Mail::Other));
    }
}
