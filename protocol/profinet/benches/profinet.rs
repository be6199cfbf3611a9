//! PROFINET on the wire: the cyclic frame both ways it travels, and the request that opens a connection; and a cycle of a
//! controller with many devices.

#![expect(clippy::unwrap_used, clippy::indexing_slicing, reason = "a benchmark ends by panicking")]

use machine::ethernet::{EthernetHeader, Mac};
use machine::wire::{BigEndian, Writer};
use profinet::ETHER_TYPE;
use profinet::connect::ConnectRequest;
use profinet::rpc::{Header, RequestArgs};
use profinet::rt::{CyclicFrame, DataStatus};
use profinet::tag;

mod stations;

#[expect(dead_code, reason = "the tests use the others")]
#[path = "../tests/profinet/samples.rs"]
mod samples;

/// 256 bytes of data, their IOPS and those of the other modules.
const C_SDU: [u8; 260] = [0x5A; 260];

/// A Siemens controller's Connect; where it was captured stands in `vectors/README.md`.
const CONNECT: &str = include_str!("../vectors/connect_req.hex");

/// Ethernet, IPv4 and UDP headers before the request.
const HEADERS: usize = 42;

type Buffer = [u8; 512];

const EMPTY: Buffer = [0; 512];

fn main() {
    hot_path::main(|paths| {
        stations::add(paths);
        paths.add("PROFINET cyclic frame", "encode, udp", || EMPTY, encode_udp);
        paths.add(
            "PROFINET cyclic frame",
            "decode, udp",
            || encode_udp(EMPTY),
            |(buffer, len)| CyclicFrame::parse(&buffer[..len], C_SDU.len()).unwrap().cycle_counter,
        );
        paths.add("PROFINET cyclic frame", "encode, rt1", || EMPTY, encode_rt1);
        paths.add(
            "PROFINET cyclic frame",
            "decode, rt1",
            || encode_rt1(EMPTY),
            |(buffer, len)| {
                let (header, payload) = EthernetHeader::parse(&buffer[..len]).unwrap();
                (header.source, CyclicFrame::parse(payload, C_SDU.len()).unwrap().cycle_counter)
            },
        );
        paths.add("PROFINET connection", "decode Connect", connect, |datagram: Vec<u8>| {
            let (header, body) = Header::parse(&datagram).unwrap();
            ConnectRequest::parse(RequestArgs::parse(&header, body).unwrap().blocks).unwrap()
        });
    });
}

fn frame() -> CyclicFrame<'static> {
    CyclicFrame {
        frame_id: 0x8001,
        c_sdu: &C_SDU,
        cycle_counter: 32,
        data_status: DataStatus(0x35),
        transfer_status: 0,
    }
}

fn encode_udp(mut buffer: Buffer) -> (Buffer, usize) {
    let mut writer = Writer::<BigEndian>::new(&mut buffer);
    frame().emit(&mut writer);
    let len = writer.finish().unwrap();
    (buffer, len)
}

fn encode_rt1(mut buffer: Buffer) -> (Buffer, usize) {
    let header = EthernetHeader {
        destination: Mac([2, 0, 0, 0, 0, 2]),
        source: Mac([2, 0, 0, 0, 0, 1]),
        tag: Some(tag::RT),
        ether_type: ETHER_TYPE,
    };
    let len = header.emit(&mut buffer, |writer| frame().emit(writer)).unwrap();
    (buffer, len)
}

fn connect() -> Vec<u8> {
    let bytes = CONNECT.lines().filter(|line| !line.starts_with('#')).flat_map(str::split_whitespace);
    bytes.skip(HEADERS).map(|byte| u8::from_str_radix(byte, 16).unwrap()).collect()
}
