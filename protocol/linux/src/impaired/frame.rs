//! Which bytes of a frame a machine sees: the virtual cable impairs only these, so an impaired cable does the same.
//!
//! ```text
//! 0..12  addresses    12..14 EtherType, four bytes further on behind a tag (IEEE 802.1Q)
//! IPv4 (RFC 791):  0 version and header length in words   2..4 total length   6..8 flags and fragment   9 protocol
//! UDP (RFC 768):   6..8 checksum   8.. payload
//! ```

use std::ops::Range;

const TAG: [u8; 2] = [0x81, 0x00];
const IPV4: [u8; 2] = [0x08, 0x00];
const ARP: [u8; 2] = [0x08, 0x06];
const ICMP: u8 = 1;
const UDP: u8 = 17;

/// What a frame contains, from the point of view of the machines at both ends.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) enum Contents {
    /// A frame of a machine. A datagram also has a checksum.
    Machine {
        /// Range of the bytes that the machine sees.
        seen: Range<usize>,
        /// Position of the datagram's checksum, and of the UDP header that it covers.
        checksum: Option<(usize, usize)>,
    },
    /// Part of something that the receiving host checks and reassembles: a TCP segment or a fragment.
    Piece,
    /// Traffic between the two hosts: ICMP, and ARP, which machines read but which their hosts answer. It is not impaired.
    Hosts,
}

impl Contents {
    pub(super) fn of(frame: &[u8]) -> Self {
        let whole = Self::Machine { seen: 0..frame.len(), checksum: None };
        let at = if frame.get(12..14) == Some(&TAG) { 16 } else { 12 };
        match frame.get(at..at + 2) {
            Some(kind) if kind == ARP => Self::Hosts,
            Some(kind) if kind == IPV4 => Self::of_packet(frame, at + 2).unwrap_or(whole),
            _ => whole,
        }
    }

    /// Returns `None` if the packet is malformed.
    fn of_packet(frame: &[u8], ip: usize) -> Option<Self> {
        let header = frame.get(ip..ip + 20)?;
        let &[version, _, length_high, length_low, _, _, fragment_high, fragment_low, _, protocol, ..] =
            header
        else {
            return None;
        };
        // The bits behind "don't fragment": more fragments, and this fragment's offset.
        if u16::from_be_bytes([fragment_high, fragment_low]) & 0x3FFF != 0 {
            return Some(Self::Piece);
        }
        match protocol {
            ICMP => Some(Self::Hosts),
            UDP => {
                let udp = ip + usize::from(version & 0x0F) * 4;
                let end = ip + usize::from(u16::from_be_bytes([length_high, length_low]));
                let is_whole = udp + 8 <= end && end <= frame.len();
                is_whole.then_some(Self::Machine { seen: udp + 8..end, checksum: Some((udp + 6, udp)) })
            }
            _ => Some(Self::Piece),
        }
    }
}

/// Writes `seen`, which differs from the frame's bytes in at most one byte, into the frame and corrects the
/// datagram's checksum: the flipped bit is to reach the machine, not to be found by its host.
pub(super) fn put_in(frame: &mut [u8], contents: &Contents, seen: &[u8]) {
    let Contents::Machine { seen: place, checksum } = contents else { return };
    let Some(there) = frame.get_mut(place.clone()) else { return };
    let changed = there.iter().zip(seen).position(|(old, new)| old != new);
    let Some(index) = changed else { return };
    let (Some(old), Some(new)) = (there.get_mut(index), seen.get(index).copied()) else { return };
    let before = std::mem::replace(old, new);
    let Some((sum, header)) = *checksum else { return };
    let Some(bytes) = frame.get_mut(sum..sum + 2) else { return };
    let (Some(high), Some(low)) = (bytes.first().copied(), bytes.last().copied()) else { return };
    let stored = u16::from_be_bytes([high, low]);
    // The sender filled in no checksum (RFC 768).
    if stored == 0 {
        return;
    }
    let shift = if (place.start + index - header).is_multiple_of(2) { 8 } else { 0 };
    let (before, new) = (u32::from(before) << shift, u32::from(new) << shift);
    // RFC 1624, equation 3, over the one word that changed.
    let mut total = u32::from(!stored) + (!before & 0xFFFF) + new;
    total = (total & 0xFFFF) + (total >> 16);
    total = (total & 0xFFFF) + (total >> 16);
    let mended = match !(total as u16) {
        0 => 0xFFFF,
        mended => mended,
    };
    bytes.copy_from_slice(&mended.to_be_bytes());
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a datagram of six bytes from 10.0.0.1 to 10.0.0.2, with its checksum.
    fn datagram() -> Vec<u8> {
        let mut frame = vec![0; 12];
        frame.extend([0x08, 0x00, 0x45, 0, 0, 34, 0, 0, 0x40, 0, 64, UDP, 0, 0, 10, 0, 0, 1, 10, 0, 0, 2]);
        frame.extend([0x88, 0x92, 0x88, 0x92, 0, 14, 0, 0, 1, 2, 3, 4, 5, 6]);
        let sum = !sum(&frame);
        frame[40..42].copy_from_slice(&sum.to_be_bytes());
        frame
    }

    /// Returns the ones' complement sum of pseudo header and datagram, which is all ones if the checksum is right.
    fn sum(frame: &[u8]) -> u16 {
        let pseudo = [0, UDP, 0, 14];
        let bytes = [&frame[26..34], &pseudo, &frame[34..]].concat();
        let mut sum: u32 =
            bytes.chunks(2).map(|pair| u32::from(u16::from_be_bytes([pair[0], pair[1]]))).sum();
        while sum > 0xFFFF {
            sum = (sum & 0xFFFF) + (sum >> 16);
        }
        sum as u16
    }

    #[test]
    fn a_machine_sees_the_payload_of_a_datagram_and_all_of_a_profinet_frame() {
        let frame = datagram();
        let contents = Contents::of(&frame);
        assert_eq!(contents, Contents::Machine { seen: 42..48, checksum: Some((40, 34)) });
        let mut profinet = vec![0; 12];
        profinet.extend([0x81, 0x00, 0xC0, 0x00, 0x88, 0x92, 1, 2]);
        assert_eq!(Contents::of(&profinet), Contents::Machine { seen: 0..20, checksum: None });
    }

    #[test]
    fn arp_icmp_segments_and_fragments_are_not_frames_of_a_machine() {
        let with = |at: usize, byte| {
            let mut frame = datagram();
            frame[at] = byte;
            Contents::of(&frame)
        };
        assert_eq!(with(13, 0x06), Contents::Hosts);
        assert_eq!(with(23, ICMP), Contents::Hosts);
        assert_eq!(with(23, 6), Contents::Piece);
        assert_eq!(with(20, 0x20), Contents::Piece);
    }

    #[test]
    fn a_flipped_bit_in_a_datagram_keeps_its_checksum_correct() {
        for bit in 0..48 {
            let mut frame = datagram();
            let contents = Contents::of(&frame);
            let mut seen = frame[42..48].to_vec();
            seen[bit / 8] ^= 1 << (bit % 8);
            put_in(&mut frame, &contents, &seen);
            assert_eq!((&frame[42..48], sum(&frame)), (&seen[..], 0xFFFF), "bit {bit}");
        }
    }

    #[test]
    fn no_bytes_cause_a_panic() {
        let frame = datagram();
        for length in 0..frame.len() {
            let mut cut = frame[..length].to_vec();
            let contents = Contents::of(&cut);
            put_in(&mut cut, &contents, &[7; 64]);
        }
        let mut lying = frame;
        lying[16..18].copy_from_slice(&[0xFF, 0xFF]);
        assert_eq!(Contents::of(&lying), Contents::Machine { seen: 0..48, checksum: None });
    }
}
