//! Captures of anybody: pcap (times in µs or ns) and pcapng, in either byte order, read packet by packet from a stream.
//!
//! The memory needed does not grow with the file. A file that ends in the middle of a packet gives all packets before it, and then
//! [`CaptureError::Cut`].

mod pcap;
mod pcapng;
mod source;

use std::io::{self, Read};
use std::ops::Range;

use source::CountedInput;

/// Link type of Ethernet frames from the destination address on (LINKTYPE_ETHERNET).
pub const ETHERNET: u32 = 1;

/// Longest packet or block that is read into memory, in bytes: four times what Wireshark accepts.
const MAX_BLOCK_LEN: usize = 1 << 20;

/// First two bytes of a file that gzip made (RFC 1952, section 2.3.1).
const GZIP: [u8; 2] = [0x1F, 0x8B];

/// A packet of a capture.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct CapturedPacket<'a> {
    /// Number of the interface in its section; 0 in a pcap file.
    pub interface: u32,
    /// Link type of the interface; [`ETHERNET`] is 1.
    pub link_type: u32,
    /// Time in ns since 1970, by the clock of whoever captured it.
    pub nanos: u64,
    /// Captured bytes.
    pub data: &'a [u8],
    /// Length in bytes that it had on the wire.
    pub original_len: u32,
}

impl CapturedPacket<'_> {
    /// Returns whether the capture lacks the end of the packet: the snapshot length was too short.
    #[must_use]
    pub fn is_cut(&self) -> bool {
        self.original_len as usize > self.data.len()
    }
}

/// Error in reading a capture.
#[derive(Debug, thiserror::Error)]
pub enum CaptureError {
    /// The file cannot be read.
    #[error("cannot read the capture: {0}")]
    Io(#[from] io::Error),
    /// It is compressed.
    #[error("the capture is compressed: unpack it by `gunzip` first")]
    Compressed,
    /// It is another kind of file.
    #[error("not a capture: expected pcap or pcapng, found the bytes {0:02X?}")]
    Unknown([u8; 4]),
    /// It ends within a packet or a block.
    #[error("the capture is cut at byte {0}, in the middle of a packet")]
    Cut(u64),
    /// A length or a number in it cannot be right.
    #[error("the capture is damaged at byte {offset}: {found}")]
    Damaged {
        /// Where the packet or block begins.
        offset: u64,
        /// The impossible length or number.
        found: &'static str,
    },
}

/// Position of a packet's data in the buffer, with what is known of it.
#[derive(Clone, Debug)]
struct PacketPlace {
    interface: u32,
    link_type: u32,
    nanos: u64,
    original_len: u32,
    data: Range<usize>,
}

#[derive(Debug)]
enum Format {
    Pcap(pcap::FileHeader),
    Pcapng(pcapng::PcapngSection),
}

/// A reader of a capture.
#[derive(Debug)]
pub struct CaptureReader<R> {
    source: CountedInput<R>,
    format: Format,
    buffer: Vec<u8>,
    has_ended: bool,
}

impl<R: Read> CaptureReader<R> {
    /// Reads the head of a capture. The reader asks for few bytes at a time: give it a buffered input.
    ///
    /// # Errors
    ///
    /// This is not a capture, or it cannot be read.
    pub fn new(input: R) -> Result<Self, CaptureError> {
        let mut source = CountedInput::new(input);
        let mut magic = [0; 4];
        if !source.fill_or_end(&mut magic)? {
            return Err(CaptureError::Unknown(magic));
        }
        let format = if pcapng::is_section(magic) {
            Format::Pcapng(pcapng::PcapngSection::read(&mut source, None)?)
        } else if let Some(header) = pcap::FileHeader::read(magic, &mut source)? {
            Format::Pcap(header)
        } else if magic.starts_with(&GZIP) {
            return Err(CaptureError::Compressed);
        } else {
            return Err(CaptureError::Unknown(magic));
        };
        Ok(Self { source, format, buffer: Vec::new(), has_ended: false })
    }

    /// Returns the next packet; `None` at the end, and after an error.
    ///
    /// # Errors
    ///
    /// The file is cut or damaged, or cannot be read.
    pub fn next_packet(&mut self) -> Result<Option<CapturedPacket<'_>>, CaptureError> {
        if self.has_ended {
            return Ok(None);
        }
        let found = match &mut self.format {
            Format::Pcap(header) => header.read_packet(&mut self.source, &mut self.buffer),
            Format::Pcapng(section) => section.read_packet(&mut self.source, &mut self.buffer),
        };
        let place = match found {
            Ok(Some(place)) => place,
            ended => {
                self.has_ended = true;
                return ended.map(|_| None);
            }
        };
        let PacketPlace { interface, link_type, nanos, original_len, data } = place;
        let data = self.buffer.get(data).unwrap_or_default();
        Ok(Some(CapturedPacket { interface, link_type, nanos, data, original_len }))
    }

    /// Returns how many packets were left out because the file gives no time for them.
    #[must_use]
    pub const fn untimed(&self) -> u64 {
        match &self.format {
            Format::Pcap(_) => 0,
            Format::Pcapng(section) => section.untimed(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAMES: [(u64, &[u8]); 2] =
        [(1_700_000_000_123_456_000, b"first"), (1_700_000_000_123_457_000, b"2nd")];

    fn number(is_big: bool, value: u32) -> [u8; 4] {
        if is_big { value.to_be_bytes() } else { value.to_le_bytes() }
    }

    fn pcap(is_big: bool, magic: u32, unit: u64) -> Vec<u8> {
        let word = |value| number(is_big, value);
        let version = if is_big { [0, 2, 0, 4] } else { [2, 0, 4, 0] };
        // Bit 26 and the top four: the frames have an FCS of 4 bytes.
        let mut file = [word(magic), version, word(0), word(0), word(65_535), word(0x4000_0001)].concat();
        for (nanos, data) in FRAMES {
            let (seconds, fraction) = (nanos / 1_000_000_000, nanos % 1_000_000_000 / unit);
            for value in [seconds as u32, fraction as u32, data.len() as u32, 1_500] {
                file.extend(word(value));
            }
            file.extend(data);
        }
        file
    }

    fn block(is_big: bool, kind: u32, body: &[u8]) -> Vec<u8> {
        let mut body = body.to_vec();
        body.resize(body.len().next_multiple_of(4), 0);
        let length = number(is_big, body.len() as u32 + 12);
        [&number(is_big, kind)[..], &length, &body, &length].concat()
    }

    /// Times in units of 2^-20 s and of 10^-9 s with an offset of 1,000 s, in a second section.
    fn pcapng(is_big: bool) -> Vec<u8> {
        let word = |value| number(is_big, value);
        let half = |value: u16| if is_big { value.to_be_bytes() } else { value.to_le_bytes() };
        let option = |code: u16, value: &[u8]| {
            let mut option = [half(code), half(value.len() as u16)].concat();
            option.extend(value);
            option.resize(option.len().next_multiple_of(4), 0);
            option
        };
        let seconds = if is_big { 1_000_i64.to_be_bytes() } else { 1_000_i64.to_le_bytes() };
        let section =
            block(is_big, 0x0A0D_0D0A, &[word(0x1A2B_3C4D), word(1), [0xFF; 4], [0xFF; 4]].concat());
        let interface =
            |options: &[u8]| block(is_big, 1, &[&half(1)[..], &[0; 2], &word(0), options].concat());
        let packet = |ticks: u64, data: &[u8]| {
            let head = [0, (ticks >> 32) as u32, ticks as u32, data.len() as u32, 1_500].map(word).concat();
            block(is_big, 6, &[&head, data].concat())
        };
        let nanos = FRAMES[1].0 - 1_000_000_000_000;
        [
            section.clone(),
            interface(&option(9, &[0x80 | 20])),
            block(is_big, 3, &word(4)),
            packet(1_700_000_000 << 20, FRAMES[0].1),
            section,
            interface(&[option(9, &[9]), option(14, &seconds)].concat()),
            packet(nanos, FRAMES[1].1),
        ]
        .concat()
    }

    fn read(file: &[u8]) -> Result<Vec<(u64, Vec<u8>)>, CaptureError> {
        let mut reader = CaptureReader::new(file)?;
        let mut packets = Vec::new();
        while let Some(packet) = reader.next_packet()? {
            assert_eq!((packet.link_type, packet.is_cut()), (ETHERNET, true));
            packets.push((packet.nanos, packet.data.to_vec()));
        }
        assert!(reader.next_packet().is_ok_and(|packet| packet.is_none()));
        Ok(packets)
    }

    #[test]
    fn captures_of_both_formats_resolutions_and_byte_orders_are_read() {
        let expected = FRAMES.map(|(nanos, data)| (nanos, data.to_vec()));
        for is_big in [false, true] {
            assert_eq!(read(&pcap(is_big, 0xA1B2_C3D4, 1_000)).unwrap(), expected);
            assert_eq!(read(&pcap(is_big, 0xA1B2_3C4D, 1)).unwrap(), expected);
            let [(_, first), second] = expected.clone();
            assert_eq!(read(&pcapng(is_big)).unwrap(), [(1_700_000_000_000_000_000, first), second]);
        }
    }

    #[test]
    fn a_file_that_is_cut_anywhere_or_altered_ends_with_an_error_and_not_a_panic() {
        for file in [pcap(true, 0xA1B2_C3D4, 1_000), pcapng(false)] {
            let whole = read(&file).unwrap().len();
            for cut in 0..file.len() {
                match read(&file[..cut]) {
                    Ok(packets) => assert!(packets.len() < whole),
                    Err(error) => assert!(!error.to_string().is_empty()),
                }
                for value in [0, 0x7F, 0xFF] {
                    let mut altered = file.clone();
                    altered[cut] = value;
                    let mut reader = CaptureReader::new(&altered[..]);
                    while let Ok(Ok(Some(_))) = reader.as_mut().map(CaptureReader::next_packet) {}
                }
            }
        }
    }

    #[test]
    fn other_files_are_named_for_what_they_are() {
        let said = |file: &[u8]| CaptureReader::new(file).unwrap_err().to_string();
        assert_eq!(said(b"\x1f\x8b\x08\0rest"), "the capture is compressed: unpack it by `gunzip` first");
        assert_eq!(
            said(b"type,rep"),
            "not a capture: expected pcap or pcapng, found the bytes [74, 79, 70, 65]"
        );
        assert_eq!(said(b""), "not a capture: expected pcap or pcapng, found the bytes [00, 00, 00, 00]");
    }
}
