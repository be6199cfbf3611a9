//! What the controller sends, as tshark reads it. These tests need tshark; `scripts/dev.sh setup` installs it.

use super::*;
use crate::tshark::dissected;
use profinet::Uuid;
use profinet::rpc::{CONTROLLER_INTERFACE, ENDPOINT_MAPPER_INTERFACE, LOOKUP, Operation};

const FIELDS: [&str; 6] = [
    "pn_io.block_type",
    "pn_io.session_key",
    "pn_io.control_alarm_sequence_number",
    "pn_io.control_command.prmend",
    "pn_io.control_command.applready",
    "pn_io.control_command.done",
];

/// Returns the values of [`FIELDS`] in each frame with control blocks, and asserts that tshark finds no fault in any frame.
fn control_blocks(cell: &Cell) -> Vec<[String; 6]> {
    let all = dissected(&cell.tap, &FIELDS);
    assert_eq!(all.len(), cell.tap.len());
    let mut control = Vec::new();
    for (number, values) in all.into_iter().enumerate() {
        let (values, faults) = values.split_at(FIELDS.len());
        assert!(faults.iter().all(String::is_empty), "frame {number}: {faults:?}");
        if !values[3].is_empty() {
            control.push(values.to_vec().try_into().unwrap());
        }
    }
    control
}

#[test]
fn a_start_and_a_plugged_submodule_have_their_control_blocks() {
    for transport in [Transport::Rt1, Transport::Udp] {
        let mut cell = Cell::new(transport, PeerScript::default());
        assert_eq!(cell.run(10), [LinkEvent::Up]);
        life::alarm(&mut cell, 4, 0xA123, 0xFFFF);
        cell.run(10);
        let blocks = control_blocks(&cell);
        let blocks: Vec<_> = blocks.iter().map(|values| values.each_ref().map(String::as_str)).collect();
        assert_eq!(
            blocks,
            [
                ["0x0110", "1", "", "1", "0", "0"],
                ["0x8110", "1", "", "0", "0", "1"],
                ["0x0112", "1", "", "0", "1", "0"],
                ["0x8112", "1", "", "0", "0", "1"],
                ["0x0111", "1", "0x0123", "1", "0", "0"],
                ["0x8111", "1", "0x0123", "0", "0", "1"],
                ["0x0113", "1", "0x0123", "0", "1", "0"],
                ["0x8113", "1", "0x0123", "0", "0", "1"],
            ],
            "{transport:?}"
        );
    }
}

#[test]
fn the_connect_to_an_old_stack_has_no_faults() {
    let mut cell = Cell::new(Transport::Rt1, PeerScript { is_old: true, ..PeerScript::default() });
    assert_eq!(cell.run(10), [LinkEvent::Up]);
    assert_eq!(control_blocks(&cell).len(), 4);
}

/// Asks the controller's endpoint mapper from this address; returns request and answer as frames, and the answer's header.
fn look_up(
    cell: &mut Cell,
    from: SocketAddrV4,
    operation: u16,
    body: &[u8],
) -> (Vec<Vec<u8>>, Option<Header>) {
    let operation = Operation::from(operation);
    let mut header =
        Header::request(operation, Uuid::NIL, ENDPOINT_MAPPER_INTERFACE, Uuid([3; 16]), cell.frames as u32);
    header.interface_version = 3;
    let mut buf = [0; FRAME_CAPACITY];
    let len = header.emit(body, &mut buf).unwrap();
    let (tool, own) = ((DEVICE, from), (CONTROLLER, SocketAddrV4::new(CONTROLLER_ADDRESS, RPC_PORT)));
    let mut frames = vec![tshark::frame(tool, own, &buf[..len])];
    let source = Source { port: Port::Udp(RPC_PORT), peer: Some(from) };
    let request = buf[..len].to_vec();
    cell.controller.handle_frame(cell.now, source, &request);
    let mut answer = None;
    while let Some(transmit) = cell.controller.poll_transmit(cell.now, &mut buf) {
        if transmit.to == Some(from) {
            frames.push(tshark::frame(own, tool, &buf[..transmit.len]));
            answer = Some(Header::parse(&buf[..transmit.len]).unwrap().0);
        }
    }
    (frames, answer)
}

#[test]
fn the_endpoint_mapper_names_the_controller_to_everyone() {
    let mut cell = Cell::new(Transport::Rt1, PeerScript::default());
    assert_eq!(cell.run(10), [LinkEvent::Up]);
    // All objects of the interface of a controller.
    let mut wanted = [0; 76];
    (wanted[3], wanted[7], wanted[27], wanted[75]) = (1, 1, 2, 1);
    wanted[28..44].copy_from_slice(&CONTROLLER_INTERFACE.0);
    let annotation =
        format!("{:25} {:20} {:5} V{:3}{:3}{:3}", "sample controller", "sample-controller", 1, 0, 1, 0);
    for from in [DEVICE_ADDRESS, Ipv4Addr::new(192, 168, 64, 99)] {
        let from = SocketAddrV4::new(from, 49_200);
        let (frames, _) = look_up(&mut cell, from, LOOKUP, &wanted);
        let fields = ["epm.annotation", "epm.uuid", "epm.proto.udp_port", "epm.proto.ip", "epm.rc"];
        let rows = dissected(&frames, &fields);
        assert_eq!(rows.len(), 2, "a request and its answer");
        assert!(rows[0][fields.len()..].iter().all(String::is_empty), "{rows:?}");
        let (values, faults) = rows[1].split_at(fields.len());
        assert_eq!(
            (&values[0], &values[2..]),
            (&annotation, &["34964", "192.168.64.1", "0x00000000"].map(String::from)[..])
        );
        assert!(values[1].starts_with("dea00002-6c97-11d1-8271-00a02442df7d"), "{values:?}");
        assert!(faults.iter().all(String::is_empty), "{faults:?}");
        let (_, cut) = look_up(&mut cell, from, LOOKUP, &wanted[..75]);
        assert_eq!(cut.unwrap().kind, Kind::Fault);
        let (_, map) = look_up(&mut cell, from, 3, &wanted);
        assert_eq!(map.unwrap().kind, Kind::Reject);
    }
    assert_eq!(cell.run(100), [], "the connection goes on");
    assert_eq!(control_blocks(&cell).len(), 4);
}
