//! The frames of the recorded runs, for a timeline: kept in memory, and only while wanted.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use capture_file::Packet;
use machine::Instant;
use virtual_time::Side;

use crate::frame_name;
use records::trace::{Frame, RECORDED};

/// Longest time from the first wanted frame to the start edge: the arm moves to the application's start meanwhile.
const BEFORE_START: Duration = Duration::from_secs(60);

/// Log of the frames at both ends of the cable. Clones are the same log.
#[derive(Clone, Debug, Default)]
pub struct FrameLog(Arc<Log>);

#[derive(Debug, Default)]
struct Log {
    wanted: AtomicBool,
    ends: [Mutex<End>; 2],
}

/// What one end saw.
#[derive(Debug, Default)]
struct End {
    frames: Vec<(Instant, Frame)>,
    /// The first frame since frames are wanted.
    first: Option<Instant>,
}

impl FrameLog {
    /// Starts or stops collecting frames.
    pub(super) fn want(&self, wanted: bool) {
        self.0.ends.iter().for_each(|end| locked(end).first = None);
        self.0.wanted.store(wanted, Ordering::Relaxed);
    }

    /// Returns the callback that collects frames at this end.
    pub(super) fn at(&self, end: Side) -> impl FnMut(Instant, &Packet<'_>) + Send + 'static {
        let log = Arc::clone(&self.0);
        move |at, packet| {
            if !log.wanted.load(Ordering::Relaxed) {
                return;
            }
            let Some(seen) = log.ends.get(end.index()) else { return };
            let mut seen = locked(seen);
            let first = *seen.first.get_or_insert(at);
            if at.since(first) <= BEFORE_START + RECORDED {
                seen.frames.push((at, frame(end, packet)));
            }
        }
    }

    /// Takes all frames so far with their instants by the nodes' clock: those at the PLC's end, then those at the
    /// robot's.
    #[must_use]
    pub fn take(&self) -> Vec<(Instant, Frame)> {
        self.0.ends.iter().flat_map(|end| std::mem::take(&mut locked(end).frames)).collect()
    }
}

fn locked(end: &Mutex<End>) -> MutexGuard<'_, End> {
    end.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Converts a packet to a timeline's frame; the trace sets its time since the start edge.
fn frame(end: Side, packet: &Packet<'_>) -> Frame {
    let (name, bytes) = named(packet.data).unwrap_or(("Ethernet", packet.data.len()));
    Frame { at_us: 0.0, end, sent: packet.sent == Some(true), name, bytes, faulty: packet.comment.is_some() }
}

/// Returns the name of a frame and the length of its payload in bytes. As for a virtual cable, only the payload of an IP
/// packet counts.
fn named(frame: &[u8]) -> Option<(&'static str, usize)> {
    let (ether_type, packet) = frame_name::ether_type(frame)?;
    if ether_type != 0x0800 {
        return Some((frame_name::of_ethernet(frame), frame.len()));
    }
    // RFC 791: header length in words, total length, protocol.
    let header = usize::from(packet.first()? & 0x0F) * 4;
    let length = usize::from(u16::from_be_bytes([*packet.get(2)?, *packet.get(3)?]));
    let inner = packet.get(header..length.min(packet.len()))?;
    let ports = || {
        let [a, b, c, d, ..] = *inner else { return [0; 2] };
        [u16::from_be_bytes([a, b]), u16::from_be_bytes([c, d])]
    };
    let payload = |behind: usize| inner.get(behind..).unwrap_or_default();
    Some(match packet.get(9)? {
        17 => (frame_name::of_udp(ports(), payload(8)), payload(8).len()),
        6 => {
            // RFC 9293: the offset of the data in words.
            let payload = payload(usize::from(inner.get(12)? >> 4) * 4);
            (frame_name::of_tcp(ports(), payload), payload.len())
        }
        1 => ("ICMP", inner.len()),
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_has_the_name_of_its_protocol_and_the_length_of_its_payload() {
        let ip = |protocol: u8, behind: &[u8]| {
            let length = 20 + behind.len() as u8;
            let packet = [0x45, 0, 0, length, 0, 0, 0x40, 0, 64, protocol, 0, 0, 10, 0, 0, 1, 10, 0, 0, 2];
            [&[0; 12][..], &[0x08, 0x00], &packet, behind].concat()
        };
        let named = |frame: &[u8]| {
            let packet = Packet { since_1970: Duration::ZERO, sent: Some(true), data: frame, comment: None };
            let Frame { name, bytes, .. } = super::frame(Side::A, &packet);
            (name, bytes)
        };
        assert_eq!(named(&ip(17, &[0; 8 + 5])), ("UDP", 5));
        let segment = [&[0; 12][..], &[0x50], &[0; 7], &[1, 2, 3]].concat();
        assert_eq!(named(&ip(6, &segment)), ("TCP", 3));
        let profinet = [&[0; 12][..], &[0x81, 0x00, 0xC0, 0x00, 0x88, 0x92], &[0; 42]].concat();
        assert_eq!(named(&profinet), ("PROFINET", 60));
        for length in 0..20 {
            named(&ip(6, &segment)[..length]);
        }
    }

    #[test]
    fn frames_are_kept_only_while_they_are_wanted() {
        let log = FrameLog::default();
        let mut see = log.at(Side::B);
        let packet = Packet { since_1970: Duration::ZERO, sent: Some(false), data: &[0; 60], comment: None };
        for (at, wanted) in [(1, false), (2, true), (3, false)] {
            log.want(wanted);
            see(Instant::from_millis(at), &packet);
        }
        let found: Vec<_> = log.take().into_iter().map(|(at, frame)| (at, frame.end, frame.sent)).collect();
        assert_eq!(found, [(Instant::from_millis(2), Side::B, false)]);
    }
}
