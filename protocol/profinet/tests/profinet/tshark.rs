//! Frames as tshark reads them.

use std::net::SocketAddrV4;

use machine::ethernet::Mac;

/// One end of a datagram.
pub(crate) type End = (Mac, SocketAddrV4);

/// Returns the Ethernet frame of a datagram over IPv4 and UDP.
pub(crate) fn frame(from: End, to: End, datagram: &[u8]) -> Vec<u8> {
    let udp_len = (8 + datagram.len()) as u16;
    let mut frame = [&to.0.0[..], &from.0.0, &[8, 0, 0x45, 0]].concat();
    frame.extend((20 + udp_len).to_be_bytes());
    frame.extend([0, 0, 0x40, 0, 64, 17, 0, 0]);
    frame.extend(from.1.ip().octets());
    frame.extend(to.1.ip().octets());
    for number in [from.1.port(), to.1.port(), udp_len, 0] {
        frame.extend(number.to_be_bytes());
    }
    frame.extend(datagram);
    frame
}

/// Returns what tshark reads in each frame: all values of each field, in the order of the fields, and the faults that it
/// finds.
pub(crate) fn dissected(frames: &[Vec<u8>], fields: &[&str]) -> Vec<Vec<String>> {
    dissector::read(frames, fields.iter().copied().chain(["_ws.expert.message", "_ws.malformed"]))
}
