//! Captures of anybody: pcap (times in µs or ns) and pcapng, in either byte order, read packet by packet from a stream.
//!
//! The memory needed does not grow with the file. A file that ends in the middle of a packet gives all packets before it, and then
//! [`CaptureError::Cut`].

mod pcap;
mod pcapng;
mod source;

use std::io::{self, Read};
use std::ops::Range;

use source::Source;

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
        /// What cannot be right.
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
    Pcapng(pcapng::Section),
}

/// A reader of a capture.
#[derive(Debug)]
pub struct CaptureReader<R> {
    source: Source<R>,
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
        let mut source = Source::new(input);
        let mut magic = [0; 4];
        if !source.fill_or_end(&mut magic)? {
            return Err(CaptureError::Unknown(magic));
        }
        let format = if pcapng::is_section(magic) {
            Format::Pcapng(pcapng::Section::read(&mut source, None)?)
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
