//! Encoding and decoding of EtherNet/IP: the class 1 frame of 256 bytes, the request that opens a connection, and
//! a cycle of a scanner with many adapters.

#![expect(clippy::unwrap_used, clippy::indexing_slicing, reason = "a benchmark ends by panicking")]

use ethernet_ip::cip::{Logical, Path, class, write_logical};
use ethernet_ip::class1::{Frame, emit};
use ethernet_ip::connection::{
    ConnectionType, OpenRequest, Parameters, Priority, TimeoutMultiplier, Transport, Triad,
};
use machine::wire::{LittleEndian, Writer};

mod stations;

#[path = "../tests/ethernet_ip/samples.rs"]
mod samples;

type Buffer = [u8; 512];

const EMPTY: Buffer = [0; 512];

fn main() {
    hot_path::main(|paths| {
        stations::add(paths);
        paths.add("EtherNet/IP class 1 frame", "encode O→T", || EMPTY, encode);
        paths.add(
            "EtherNet/IP class 1 frame",
            "decode O→T",
            || encode(EMPTY),
            |(buffer, len)| {
                let frame = Frame::parse(&buffer[..len]).unwrap();
                (frame.sequence, frame.run_and_data().unwrap().1.len())
            },
        );
        paths.add("EtherNet/IP connection", "encode Forward_Open", || EMPTY, forward_open);
        paths.add(
            "EtherNet/IP connection",
            "decode Forward_Open",
            || forward_open(EMPTY),
            |(buffer, len)| {
                let request = OpenRequest::parse(&buffer[..len], false).unwrap();
                (request.triad, request.path.application().unwrap().points)
            },
        );
    });
}

fn encode(mut buffer: Buffer) -> (Buffer, usize) {
    let len = emit(&mut buffer, (0x5C00_0001, 7, 7), Some(true), &[0x5A; 256]).unwrap();
    (buffer, len)
}

fn forward_open(mut buffer: Buffer) -> (Buffer, usize) {
    let mut path = [0; 16];
    let mut writer = Writer::<LittleEndian>::new(&mut path);
    write_logical(&mut writer, Logical::Class, class::ASSEMBLY);
    write_logical(&mut writer, Logical::Instance, 151);
    write_logical(&mut writer, Logical::ConnectionPoint, 150);
    write_logical(&mut writer, Logical::ConnectionPoint, 100);
    let path_len = writer.finish().unwrap();
    let parameters = |size| Parameters {
        redundant_owner: false,
        kind: ConnectionType::PointToPoint,
        priority: Priority::Scheduled,
        variable: false,
        size,
    };
    let request = OpenRequest {
        o_t_id: 1,
        t_o_id: 0x5C00_0001,
        triad: Triad { connection_serial: 1, vendor: 0xFFFF, originator_serial: 1 },
        multiplier: TimeoutMultiplier::TIMES_128.code(),
        o_t_rpi_us: 1_000,
        o_t: parameters(262),
        t_o_rpi_us: 1_000,
        t_o: parameters(258),
        transport: Transport::CYCLIC,
        path: Path(&path[..path_len]),
    };
    let mut writer = Writer::<LittleEndian>::new(&mut buffer);
    request.emit(&mut writer, false);
    let len = writer.finish().unwrap();
    (buffer, len)
}
