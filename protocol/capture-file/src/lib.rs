#![doc = include_str!("../README.md")]
//!
//! Each end of a cable has its own file. One file for both ends would hold every frame twice, and whatever a
//! dissector follows from packet to packet (TCP sequence numbers, requests and responses, I/O graphs) would count it
//! twice. To get one file with two interfaces: `mergecap -w both.pcapng plc.pcapng robot.pcapng`.

pub mod reader;

use std::borrow::Cow;
use std::collections::VecDeque;
use std::fmt;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

use pcap_file::DataLink;
use pcap_file::pcapng::PcapNgWriter;
use pcap_file::pcapng::blocks::enhanced_packet::{EnhancedPacketBlock, EnhancedPacketOption};
use pcap_file::pcapng::blocks::interface_description::{
    InterfaceDescriptionBlock, InterfaceDescriptionOption,
};
use virtual_time::Side;

/// Captured length in bytes. Longer frames are cut; no port of a node takes longer ones.
pub const SNAP_LEN: usize = 2048;

/// What a ring keeps from the start, in bytes: the connection's establishment, without which later frames mean
/// little.
const FIRST: usize = 1 << 20;

/// What a ring keeps from the end, in bytes: about 90 s at two frames a millisecond.
const LAST: usize = 64 << 20;

/// Which frames a capture keeps.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Retention {
    /// All frames, written to disk as they come.
    All,
    /// The first MiB and the last 64 MiB, held in memory and written at the end.
    FirstAndLast,
}

/// A frame as it passed an interface.
#[derive(Clone, Copy, Debug)]
pub struct Packet<'a> {
    /// When it passed, in UTC.
    pub since_1970: Duration,
    /// Whether the interface sent it; `None` if that is not known.
    pub sent: Option<bool>,
    /// The frame from the destination MAC address on, without FCS.
    pub data: &'a [u8],
    /// Comment on the packet, which Wireshark shows beside it.
    pub comment: Option<&'a str>,
}

/// Comment beside the next frame when the cable's or a node's state changes.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum CableEvent {
    /// The cable was cut.
    Cut {
        /// Frames that were on the cable and are lost.
        lost_under_way: u64,
    },
    /// The cable was mended.
    Mended,
    /// A node was killed: the PLC is at end A, the robot at end B.
    Killed(Side),
}

impl fmt::Display for CableEvent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Cut { lost_under_way: 0 } => f.write_str("fault: the cable is cut from here on"),
            Self::Cut { lost_under_way } => {
                write!(f, "fault: the cable is cut from here on; {lost_under_way} frames under way are lost")
            }
            Self::Mended => f.write_str("the cable is mended"),
            Self::Killed(Side::A) => f.write_str("fault: the PLC is killed"),
            Self::Killed(Side::B) => f.write_str("fault: the robot is killed"),
        }
    }
}

/// An open capture file.
pub struct CaptureFile {
    path: PathBuf,
    writer: PcapNgWriter<Sink>,
    packets: u64,
}

impl fmt::Debug for CaptureFile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("CaptureFile")
            .field("path", &self.path)
            .field("packets", &self.packets)
            .finish_non_exhaustive()
    }
}

impl CaptureFile {
    /// Creates a capture of what passes `interface`. `about` is the interface's comment; none if it is empty.
    ///
    /// # Errors
    ///
    /// The file cannot be created.
    pub fn create(path: &Path, interface: &str, about: &str, retention: Retention) -> io::Result<Self> {
        let sink = match retention {
            Retention::All => Sink::Disk(BufWriter::with_capacity(1 << 16, File::create(path)?)),
            Retention::FirstAndLast => Sink::Memory(Ring::default()),
        };
        let mut writer = PcapNgWriter::new(sink).map_err(io::Error::other)?;
        let mut options = vec![
            InterfaceDescriptionOption::IfName(interface.to_owned().into()),
            InterfaceDescriptionOption::IfTsResol(9),
        ];
        if !about.is_empty() {
            options.push(InterfaceDescriptionOption::Comment(about.to_owned().into()));
        }
        let description =
            InterfaceDescriptionBlock { linktype: DataLink::ETHERNET, snaplen: SNAP_LEN as u32, options };
        writer.write_pcapng_block(description).map_err(io::Error::other)?;
        writer.get_mut().end_block();
        Ok(Self { path: path.to_owned(), writer, packets: 0 })
    }

    /// Returns the file's path; the file exists only from the end on if it is kept in memory.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Appends a packet.
    ///
    /// # Errors
    ///
    /// The file cannot be written.
    pub fn write(&mut self, packet: &Packet<'_>) -> io::Result<()> {
        let mut options = Vec::new();
        if let Some(sent) = packet.sent {
            // Bits 0 and 1 of epb_flags (pcapng, section 4.3.1): 1 is inbound, 2 outbound.
            options.push(EnhancedPacketOption::Flags(if sent { 2 } else { 1 }));
        }
        if let Some(comment) = packet.comment {
            options.push(EnhancedPacketOption::Comment(comment.into()));
        }
        let kept = packet.data.get(..SNAP_LEN).unwrap_or(packet.data);
        let block = EnhancedPacketBlock {
            interface_id: 0,
            timestamp: packet.since_1970,
            original_len: packet.data.len() as u32,
            data: Cow::Borrowed(kept),
            options,
        };
        self.writer.write_pcapng_block(block).map_err(|error| match error {
            pcap_file::PcapError::IoError(error) => error,
            other => io::Error::other(other),
        })?;
        self.writer.get_mut().end_block();
        self.packets += 1;
        Ok(())
    }

    /// Writes buffered packets to disk, unless the capture is kept in memory.
    ///
    /// # Errors
    ///
    /// The file cannot be written.
    pub fn flush(&mut self) -> io::Result<()> {
        self.writer.get_mut().flush()
    }

    /// Ends the capture and returns how many packets were given to it.
    ///
    /// # Errors
    ///
    /// The file cannot be written.
    pub fn finish(mut self) -> io::Result<u64> {
        self.flush()?;
        if let Sink::Memory(ring) = self.writer.get_mut() {
            ring.write_to(&self.path)?;
        }
        Ok(self.packets)
    }
}

enum Sink {
    Disk(BufWriter<File>),
    Memory(Ring),
}

impl Sink {
    fn end_block(&mut self) {
        if let Self::Memory(ring) = self {
            ring.end_block(FIRST, LAST);
        }
    }
}

impl Write for Sink {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Self::Disk(file) => file.write(bytes),
            Self::Memory(ring) => ring.block.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::Disk(file) => file.flush(),
            Self::Memory(_) => Ok(()),
        }
    }
}

/// Whole blocks: the first ones, and as many of the last ones as fit.
#[derive(Default)]
struct Ring {
    /// The block being written.
    block: Vec<u8>,
    first: Vec<u8>,
    last: VecDeque<u8>,
}

impl Ring {
    fn end_block(&mut self, first: usize, last: usize) {
        if self.last.is_empty() && self.first.len() + self.block.len() <= first {
            self.first.append(&mut self.block);
            return;
        }
        while !self.last.is_empty() && self.last.len() + self.block.len() > last {
            // A block begins with its type and its length, four bytes each (pcapng, section 3.1).
            let length: [u8; 4] = std::array::from_fn(|at| self.last.get(4 + at).copied().unwrap_or(0));
            let length = (u32::from_ne_bytes(length) as usize).clamp(1, self.last.len());
            self.last.drain(..length);
        }
        self.last.extend(self.block.drain(..));
    }

    fn write_to(&self, path: &Path) -> io::Result<()> {
        let mut file = File::create(path)?;
        file.write_all(&self.first)?;
        let (front, back) = self.last.as_slices();
        file.write_all(front)?;
        file.write_all(back)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn block(number: u32) -> Vec<u8> {
        [6_u32, 16, number, 16].iter().flat_map(|word| word.to_ne_bytes()).collect()
    }

    #[test]
    fn a_ring_keeps_the_first_blocks_and_as_many_of_the_last_as_fit() {
        let mut ring = Ring::default();
        for number in 0..100 {
            ring.block = block(number);
            ring.end_block(40, 64);
        }
        let kept = |bytes: Vec<u8>| -> Vec<u8> { bytes.chunks(16).map(|block| block[8]).collect() };
        assert_eq!(kept(ring.first), [0, 1]);
        assert_eq!(kept(ring.last.into()), [96, 97, 98, 99]);
    }
}
