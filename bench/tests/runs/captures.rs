//! Captures of a virtual cable: real packets, the same at both ends except for what the cable did, with a comment at
//! each fault.
use std::fs::File;
use std::path::Path;

use capture_file::Retention;
use pcap_file::pcapng::blocks::enhanced_packet::EnhancedPacketOption;
use pcap_file::pcapng::{Block, PcapNgReader};
use plc_node::ExecutionType;
use records::schedule::Schedule;
use stands::Stand as _;
use stands::capture::{PLC_FILE, ROBOT_FILE};
use stands::virtual_run::{Extras, VirtualRun};

#[derive(Clone, PartialEq, Debug)]
pub(crate) struct SeenFrame {
    pub(crate) at_ns: u128,
    sent: bool,
    comment: Option<String>,
    pub(crate) data: Vec<u8>,
}

/// Returns the packets of a capture.
pub(crate) fn read(directory: &Path, file: &str) -> Vec<SeenFrame> {
    let mut reader = PcapNgReader::new(File::open(directory.join(file)).unwrap()).unwrap();
    let mut packets = Vec::new();
    while let Some(block) = reader.next_block() {
        let Block::EnhancedPacket(packet) = block.unwrap().into_owned() else { continue };
        let mut seen = SeenFrame {
            at_ns: packet.timestamp.as_nanos(),
            sent: false,
            comment: None,
            data: packet.data.to_vec(),
        };
        for option in packet.options {
            match option {
                EnhancedPacketOption::Flags(flags) => seen.sent = flags & 3 == 2,
                EnhancedPacketOption::Comment(comment) => seen.comment = Some(comment.into_owned()),
                _ => {}
            }
        }
        packets.push(seen);
    }
    packets
}

/// Returns what both ends saw of one CM, and how many frames the faults hit.
fn capture(setup: &str, faults: &[&str]) -> ([Vec<SeenFrame>; 2], Option<records::faults::FaultReport>) {
    let place = tempfile::tempdir().unwrap();
    let (setup, found) = planning::setup_with_application(setup).unwrap();
    let extras = Extras {
        faults: faults.iter().map(|fault| fault.parse().unwrap()).collect(),
        capture: Some((place.path().to_owned(), Retention::All)),
        frames: false,
        ..Extras::default()
    };
    let mut run = VirtualRun::start_with(&setup, &found.application, 1, &extras).unwrap();
    let runtime = tokio::runtime::Builder::new_current_thread().build().unwrap();
    let step = Schedule::new(&[ExecutionType::Cm], 1, 1).steps().next().unwrap();
    let _ = runtime.block_on(run.execute(step));
    run.end_capture(true).unwrap();
    ([PLC_FILE, ROBOT_FILE].map(|file| read(place.path(), file)), run.health().faults)
}

/// Returns the ones' complement sum of a header that contains its checksum: all ones (RFC 1071).
fn sum(parts: &[&[u8]]) -> u32 {
    let bytes = parts.concat();
    let words = bytes.chunks(2).map(|pair| u32::from(pair[0]) << 8 | u32::from(*pair.get(1).unwrap_or(&0)));
    let mut sum: u32 = words.sum();
    while sum > 0xFFFF {
        sum = (sum & 0xFFFF) + (sum >> 16);
    }
    sum
}

fn check_headers(packet: &[u8]) {
    if packet[12..14] != [0x08, 0x00] {
        return;
    }
    let (header, payload) = packet[14..].split_at(20);
    assert_eq!(sum(&[header]), 0xFFFF, "IP header");
    assert_eq!(usize::from(u16::from_be_bytes([header[2], header[3]])), packet.len() - 14, "total length");
    // The checksum covers more than one fragment.
    if header[6] & 0x40 != 0 {
        let len = (payload.len() as u16).to_be_bytes();
        assert_eq!(sum(&[&header[12..20], &[0, header[9]], &len, payload]), 0xFFFF, "payload");
    }
}

#[test]
fn each_end_receives_what_the_other_sends_byte_for_byte_with_correct_checksums() {
    for setup in ["A", "B"] {
        let ([plc, robot], faults) = capture(setup, &[]);
        assert_eq!(faults, None);
        plc.iter().for_each(|packet| check_headers(&packet.data));
        for (from, to) in [(&plc, &robot), (&robot, &plc)] {
            let bytes = |packets: &[SeenFrame], sent| {
                let chosen = packets.iter().filter(|packet| packet.sent == sent);
                let mut bytes: Vec<_> = chosen.map(|packet| packet.data.clone()).collect();
                bytes.sort();
                bytes
            };
            let (sent, received) = (bytes(from, true), bytes(to, false));
            assert!(received.len() > 3_000, "{} of setup {setup}", received.len());
            // Frames in flight at the end were only sent.
            assert!(sent.len() - received.len() <= 2, "{} sent, {} received", sent.len(), received.len());
            assert!(received.iter().all(|packet| sent.binary_search(packet).is_ok()));
        }
        assert!(plc.is_sorted_by_key(|packet| packet.at_ns) && robot.is_sorted_by_key(|packet| packet.at_ns));
    }
}

#[test]
fn the_bytes_of_a_tcp_connection_are_in_sequence_and_acknowledged() {
    let ([plc, _], _) = capture("B", &[]);
    let segments = || plc.iter().filter(|packet| packet.data[12..14] == [8, 0] && packet.data[23] == 6);
    let number = |data: &[u8], at: usize| u32::from_be_bytes(data[at..at + 4].try_into().unwrap());
    for sent in [true, false] {
        let mut next = None;
        let mut bytes = 0;
        for SeenFrame { data, .. } in segments().filter(|packet| packet.sent == sent) {
            let takes = u32::from(data[47] & 0x03 != 0);
            let payload = data.len() as u32 - 34 - u32::from(data[46] >> 4) * 4;
            let sequence = number(data, 38);
            assert_eq!(sequence, next.unwrap_or(sequence));
            next = Some(sequence + payload + takes);
            bytes += payload;
        }
        let last = segments().rfind(|packet| packet.sent != sent).unwrap();
        assert_eq!(next, Some(number(&last.data, 42)), "all is acknowledged");
        assert!(bytes > 100, "{bytes}");
    }
}

#[test]
fn each_fault_is_a_comment_at_the_frame_it_hit() {
    let faults = ["loss=0.01", "duplicate=0.02", "reorder=0.01@3ms", "corrupt=0.001"];
    let ([plc, robot], report) = capture("A", &faults);
    let report = report.unwrap();
    let sent = || plc.iter().chain(&robot).filter(|packet| packet.sent);
    let with = |text: &str| {
        sent().filter(|packet| packet.comment.as_ref().is_some_and(|comment| comment.contains(text))).count()
    };
    let found = [with("lost"), with("arrives twice"), with("held back by 3ms"), with("flipped")];
    let counted = [report.lost, report.duplicated, report.reordered, report.corrupted];
    assert_eq!(found.map(|count| count as u64), counted);
    assert!(counted.iter().all(|count| *count > 0), "{counted:?}");
    assert_eq!(report.asked, faults);
}

#[test]
fn a_cut_is_commented_at_both_ends_and_the_same_seed_gives_the_same_captures() {
    let faults = ["cut-at=1s..1.005s", "to-plc:jitter=20us"];
    let (ends, _) = capture("A", &faults);
    for end in &ends {
        let comments: Vec<_> = end.iter().filter_map(|packet| packet.comment.as_deref()).collect();
        assert!(comments[0].starts_with("fault: the cable is cut from here on"), "{comments:?}");
        assert!(comments.iter().any(|comment| comment.contains("the cable is mended")), "{comments:?}");
        assert!(comments.contains(&"fault: lost, the cable is cut"), "{comments:?}");
    }
    assert!(ends == capture("A", &faults).0);
}
