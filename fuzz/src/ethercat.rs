//! EtherCAT SubDevices under a MainDevice that sends anything.

use ethercat_subdevice::{DeviceConfig, Segment};
use machine::wire::FRAME_CAPACITY;
use machine::{Duration, Instant, Machine as _, Port, Source};
use virtual_time::hostile::{Choices as _, Script};

#[allow(dead_code, unreachable_pub, reason = "the tests use the others")]
#[path = "../../protocol/ethercat/tests/ethercat/devices.rs"]
pub(crate) mod devices;

/// What each of three devices may add to a working counter: one that reads and writes counts three times.
const MOST_COUNTED: u16 = 9;

/// Offsets of registers and buffers that do something.
const OFFSETS: [u16; 16] = [
    0x0010, 0x0100, 0x0120, 0x0130, 0x0200, 0x0400, 0x0500, 0x0502, 0x0600, 0x0610, 0x0800, 0x0810, 0x0900,
    0x0981, 0x1000, 0x1080,
];

/// Sends datagrams, and frames that are none.
pub(crate) fn subdevice(data: &[u8]) {
    let mut segment = Segment::new();
    segment.add(&DeviceConfig { alias: 0x1001, ..DeviceConfig::new(&devices::BRIDGE) });
    segment.add(&DeviceConfig::new(&devices::BRIDGE));
    segment.add(&DeviceConfig::new(&devices::SIMPLE));
    let (mut script, mut now) = (Script::new(data), Instant::ZERO);
    while !script.is_over() {
        match script.below(8) {
            0 => {
                let len = script.below(128);
                let mut frame = head();
                frame.extend(script.take(len));
                exchange(&mut segment, &mut now, &frame);
            }
            1 => now += Duration::from_micros(script.below(65_536) as u64 * 16),
            _ => {
                let frame = datagram(&mut script);
                let reply = exchange(&mut segment, &mut now, &frame);
                // A line whose port is held open loses what it is sent.
                let Some(reply) = reply else { continue };
                assert_eq!(reply.len(), frame.len());
                let counted = u16::from_le_bytes([reply[reply.len() - 2], reply[reply.len() - 1]]);
                assert!(counted <= MOST_COUNTED, "a working counter of {counted}");
            }
        }
    }
}

/// Returns an Ethernet header of EtherCAT.
fn head() -> Vec<u8> {
    let mut frame = vec![0xFF; 6];
    frame.extend([2, 0, 0, 0, 0, 1, 0x88, 0xA4]);
    frame
}

/// Returns a frame with one datagram: command, address, data.
fn datagram(script: &mut Script) -> Vec<u8> {
    let command = script.below(17) as u8;
    let position: u16 = [0, 0xFFFF, 0x1000, 0x1001][script.below(4)];
    let offset = match script.below(4) {
        0 => script.below(65_536) as u16,
        _ => OFFSETS[script.below(OFFSETS.len())],
    };
    let len = [1, 2, 4, 8, 16, 128][script.below(6)];
    let mut data = script.take(len);
    data.resize(len, 0);
    let mut frame = head();
    frame.extend(((12 + len as u16) | 0x1000).to_le_bytes());
    frame.extend([command, 0]);
    frame.extend(position.to_le_bytes());
    frame.extend(offset.to_le_bytes());
    frame.extend((len as u16).to_le_bytes());
    frame.extend([0, 0]);
    frame.extend(data);
    frame.extend([0, 0]);
    frame
}

/// Sends a frame; returns the one that comes back.
pub(crate) fn exchange(segment: &mut Segment, now: &mut Instant, frame: &[u8]) -> Option<Vec<u8>> {
    segment.handle_frame(*now, Source { port: Port::Ethernet, peer: None }, frame);
    let mut buf = vec![0; FRAME_CAPACITY];
    let mut sent = None;
    for _ in 0..2 {
        sent = segment.poll_transmit(*now, &mut buf);
        let Some(due) = segment.poll_timeout().filter(|_| sent.is_none()) else { break };
        *now = (*now).max(due);
        segment.handle_timeout(*now);
    }
    while segment.poll_event().is_some() {}
    sent.map(|transmit| buf[..transmit.len].to_vec())
}
