//! Each record and answer of the device as tshark reads it, field by field. A frame may be well-formed for a dissector and
//! mean something else; so the values are compared, and the mere absence of faults is not enough.
//!
//! These tests need tshark; `scripts/dev.sh setup` installs it.

use std::io::Write as _;
use std::process::{Command as Process, Stdio};

use profinet::record::{Address, ReadRequest};
use profinet::rpc::{ENDPOINT_MAPPER_INTERFACE, LOOKUP};

use super::*;

/// A request and the answer to it, as datagrams.
type Exchange = [Vec<u8>; 2];

/// Returns a capture of requests and answers, in the classic format of pcap.
fn capture(exchanges: &[Exchange]) -> Vec<u8> {
    let mut file = Vec::new();
    // Magic number, version 2.4, time zone, accuracy, snap length, Ethernet.
    for number in [0xA1B2_C3D4_u32, 2 << 16 | 4, 0, 0, 0xFFFF, 1] {
        file.extend(number.to_be_bytes());
    }
    let (controller, device) = ((CONTROLLER_MAC, CONTROLLER), (MAC, SocketAddrV4::new(ADDRESS, RPC_PORT)));
    for [request, answer] in exchanges {
        for (from, to, datagram) in [(controller, device, request), (device, controller, answer)] {
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
            let len = frame.len() as u32;
            for number in [0, 0, len, len] {
                file.extend(number.to_be_bytes());
            }
            file.extend(frame);
        }
    }
    file
}

/// Returns what tshark reads in each answer: all values of each field, in the order of the fields, and the faults that it
/// finds.
fn dissected(exchanges: &[Exchange], fields: &[&str]) -> Vec<Vec<String>> {
    let mut tshark = Process::new("tshark");
    tshark.args(["-n", "-r", "-", "-T", "fields", "-E", "occurrence=a", "-E", "separator=|"]);
    for field in fields.iter().chain(&["_ws.expert.message", "_ws.malformed"]) {
        tshark.args(["-e", field]);
    }
    let mut tshark = tshark
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .expect("tshark starts; `scripts/dev.sh setup` installs it");
    tshark.stdin.take().unwrap().write_all(&capture(exchanges)).unwrap();
    let output = tshark.wait_with_output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    text.lines().skip(1).step_by(2).map(|line| line.split('|').map(str::to_owned).collect()).collect()
}

/// Makes a request and returns it with its answer.
fn exchange(rig: &mut Rig, request: Vec<u8>) -> Exchange {
    rig.sequence += 1;
    let sent = rig.receive(Port::Udp(RPC_PORT), &request);
    let answer = sent.into_iter().find(|(transmit, _)| transmit.to == Some(CONTROLLER));
    [request, answer.expect("an answer").1]
}

/// Reads a record of the AR at this place.
fn read(rig: &mut Rig, index: u16, slot: u16, subslot: u16) -> Exchange {
    let address = Address { sequence: 0, ar: AR, api: 0, slot, subslot, index };
    let request = ReadRequest { address, most: 4_000, target_ar: Uuid::NIL };
    let datagram = rig.datagram(Operation::Read, &emitted(|w| request.emit(w)));
    exchange(rig, datagram)
}

/// Asserts that tshark reads these values in the record: those of its head, which repeats the address, come first.
fn assert_records(rig: &mut Rig, fields: &[&str], cases: &[(u16, u16, u16, &[&str])]) {
    let answers: Vec<_> =
        cases.iter().map(|(index, slot, subslot, _)| read(rig, *index, *slot, *subslot)).collect();
    let found = dissected(&answers, fields);
    assert_eq!(found.len(), cases.len());
    for (found, (index, slot, subslot, wanted)) in found.iter().zip(cases) {
        let (values, faults) = found.split_at(fields.len());
        assert_eq!(values, *wanted, "index 0x{index:04X} of slot {slot}, subslot 0x{subslot:04X}");
        assert!(faults.iter().all(String::is_empty), "index 0x{index:04X}: {faults:?}");
    }
}

const MODULES: [&str; 9] = [
    "pn_io.block_type",
    "pn_io.block_version_low",
    "pn_io.number_of_apis",
    "pn_io.api",
    "pn_io.number_of_slots",
    "pn_io.slot_nr",
    "pn_io.module_ident_number",
    "pn_io.subslot_nr",
    "pn_io.submodule_ident_number",
];

#[test]
fn real_and_expected_identification_have_the_modules_that_were_asked_for() {
    let mut rig = Rig::connected(RtClass::Class1);
    let whole = |block_type, slot, subslot| {
        [
            block_type,
            "0,1",
            "1",
            "0x00000000,0x00000000",
            "2",
            slot,
            "0x00000001,0x00000100",
            subslot,
            "0x00000001,0x00008000,0x00008001,0x00000101",
        ]
    };
    const REAL: &str = "0x8009,0x0013";
    const EXPECTED: &str = "0x8009,0x0012";
    let one_slot = |block_type| {
        [
            block_type,
            "0,1",
            "1",
            "0x00000000,0x00000000",
            "1",
            "0x0001,0x0001",
            "0x00000100",
            "0x0000,0x0001",
            "0x00000101",
        ]
    };
    let one_subslot = |block_type| {
        [
            block_type,
            "0,1",
            "1",
            "0x00000000,0x00000000",
            "1",
            "0x0000,0x0000",
            "0x00000001",
            "0x8000,0x8000",
            "0x00008000",
        ]
    };
    let everywhere =
        |block_type| whole(block_type, "0xffff,0x0000,0x0001", "0x0000,0x0001,0x8000,0x8001,0x0001");
    assert_records(
        &mut rig,
        &MODULES,
        &[
            (0xF000, 0xFFFF, 0, &everywhere(REAL)),
            (0xE001, 0xFFFF, 0, &everywhere(REAL)),
            (0xC001, 1, 0, &one_slot(REAL)),
            (0x8001, 0, 0x8000, &one_subslot(REAL)),
            (0xE000, 0xFFFF, 0, &everywhere(EXPECTED)),
            (0xC000, 1, 0, &one_slot(EXPECTED)),
            (0x8000, 0, 0x8000, &one_subslot(EXPECTED)),
        ],
    );
}

#[test]
fn im0_filter_data_name_the_access_point_at_all_three_levels() {
    let mut rig = Rig::connected(RtClass::Class1);
    let wanted = [
        "0x8009,0x0030,0x0031,0x0032",
        "0,0,0,0",
        "1,1,1",
        "0x00000000,0x00000000,0x00000000,0x00000000",
        "0x0309,0x0000,0x0000,0x0000",
        "0x00000001,0x00000001,0x00000001",
        "0x0007,0x0001,0x0001,0x0001",
        "0x00000001,0x00000001,0x00000001",
    ];
    let fields: Vec<_> = MODULES.into_iter().filter(|field| *field != "pn_io.number_of_slots").collect();
    assert_records(&mut rig, &fields, &[(0xF840, 0x0309, 7, &wanted)]);
}

#[test]
fn identification_and_maintenance_and_the_apis_are_those_of_the_description() {
    let mut rig = Rig::connected(RtClass::Class1);
    let fields = [
        "pn_io.block_type",
        "pn_io.api",
        "pn_io.number_of_apis",
        "pn_io.vendor_id_high",
        "pn_io.vendor_id_low",
        "pn_io.order_id",
        "pn_io.im_serial_number",
        "pn_io.im_hardware_revision",
        "pn_io.im_revision_prefix",
        "pn_io.im_sw_revision_functional_enhancement",
        "pn_io.im_revision_bugfix",
        "pn_io.im_sw_revision_internal_change",
        "pn_io.im_version_major",
        "pn_io.im_version_minor",
        "pn_io.im_supported",
    ];
    let im0 = [
        "0x8009,0x0020",
        "0x00000000",
        "",
        "0xff",
        "0xff",
        "sample-device       ",
        "1               ",
        "0x0001",
        "'V'",
        "0x00",
        "0x01",
        "0x00",
        "0x01",
        "0x01",
        "0x0000",
    ];
    let apis =
        ["0x8009,0x001a", "0x00000000,0x00000000", "1", "", "", "", "", "", "", "", "", "", "", "", ""];
    assert_records(&mut rig, &fields, &[(0xAFF0, 0, 1, &im0), (0xF821, 9, 9, &apis)]);
}

#[test]
fn interface_and_ports_are_those_of_the_station() {
    let mut rig = Rig::connected(RtClass::Class1);
    let fields = [
        "pn_io.block_type",
        "pn_io.slot_nr",
        "pn_io.subslot_nr",
        "pn_io.own_chassis_id",
        "pn_io.macadd",
        "pn_io.ip_address",
        "pn_io.subnetmask",
        "pn_io.standard_gateway",
        "pn_io.own_port_id",
        "pn_io.number_of_peers",
        "pn_io.mau_type",
        "pn_io.link_state_link",
        "pn_io.media_type",
    ];
    let interface = ["device", "02:00:00:00:00:02", "192.168.64.2", "255.255.255.0", "192.168.64.2"];
    let port = ["port-001", "0", "0x0000", "0x01", "0x00000000"];
    let none = [""; 5];
    let row = |head: [&'static str; 3], interface: [&'static str; 5], port: [&'static str; 5]| {
        [&head[..], &interface, &port].concat()
    };
    let one = row(["0x8009,0x0240", "0x0000", "0x8000"], interface, none);
    let other = row(["0x8009,0x020f", "0x0000,0x0000", "0x8001,0x8001"], none, port);
    let head =
        ["0x8009,0x0400,0x0240,0x0400,0x020f", "0x0000,0x0000,0x0000,0x0000", "0x0000,0x8000,0x8001,0x8001"];
    let all = row(head, interface, port);
    assert_records(
        &mut rig,
        &fields,
        &[(0x8080, 0, 0x8000, &one), (0x802A, 0, 0x8001, &other), (0xF841, 0, 0, &all)],
    );
}

#[test]
fn the_module_diff_and_the_log_book_tell_what_was_wrong() {
    let mut rig = Rig::new();
    let mut refused = connect_request(RtClass::Class1, true);
    refused.iocrs[0].phase = 7;
    let (status, _) = rig.connect(&refused);
    assert_eq!(status, Violation::Phase.status(Service::Connect));
    let mut request = connect_request(RtClass::Class1, true);
    request.expected[0].submodules[2].ident = 0x9999;
    assert!(rig.connect(&request).0.is_ok());
    let fields = [
        "pn_io.block_type",
        "pn_io.slot_nr",
        "pn_io.module_ident_number",
        "pn_io.module_state",
        "pn_io.subslot_nr",
        "pn_io.submodule_ident_number",
        "pn_io.submodule_state.ident_info",
        "pn_io.number_of_log_entries",
    ];
    let diff = [
        "0x8009,0x8104",
        "0x0000,0x0000",
        "0x00000001",
        "0x0002",
        "0x0000,0x8001",
        "0x00008001",
        "0x0002",
        "",
    ];
    let found = read(&mut rig, 0xE002, 0, 0);
    let log_book = read(&mut rig, 0xF830, 0, 0);
    let rows = dissected(&[found, log_book], &fields);
    assert_eq!(rows[0][..7], diff[..7]);
    assert_eq!((&rows[1][0][..], &rows[1][7][..]), ("0x8009,0x0019", "1"));
    for row in &rows {
        assert!(row[fields.len()..].iter().all(String::is_empty), "{row:?}");
    }
    // The status in the entry, as the refusal had it.
    let uuid_and_status = [&AR.0[..], &status.0.to_be_bytes()].concat();
    assert!(read(&mut rig, 0xF830, 0, 0)[1].windows(20).any(|window| window == uuid_and_status));
}

#[test]
fn the_answer_to_a_connect_has_its_numbers() {
    let mut rig = Rig::new();
    let datagram =
        rig.datagram(Operation::Connect, &emitted(|w| connect_request(RtClass::Class1, true).emit(w)));
    let connected = exchange(&mut rig, datagram);
    let fields = [
        "pn_io.block_type",
        "pn_io.ar_type",
        "pn_io.cmresponder_macadd",
        "pn_io.cmresponder_udprtport",
        "pn_io.iocr_type",
        "pn_io.frame_id",
        "pn_io.maxalarmdatalength",
        "pn_io.station_name_length",
    ];
    let rows = dissected(&[connected], &fields);
    // The MAC address and the FrameIDs appear again in the summary of their block.
    let wanted = [
        "0x8101,0x8102,0x8102,0x8103,0x8106",
        "0x0001",
        "02:00:00:00:00:02,02:00:00:00:00:02",
        "0x8892",
        "0x0001,0x0002",
        "0x8001,0x8002,0x8001,0x8002",
        "200",
        "6",
    ];
    assert_eq!(rows[0][..fields.len()], wanted);
    assert!(rows[0][fields.len()..].iter().all(String::is_empty), "{rows:?}");
}

#[test]
fn the_endpoint_mapper_answers_with_the_annotation_port_and_address() {
    let mut rig = Rig::new();
    let mut header =
        Header::request(Operation::Unknown(LOOKUP), Uuid::NIL, ENDPOINT_MAPPER_INTERFACE, rig.activity, 0);
    header.interface_version = 3;
    let mut body = [0; 76];
    body[75] = 1;
    let mut buf = [0; 200];
    let len = header.emit(&body, &mut buf).unwrap();
    let request = buf[..len].to_vec();
    let found = exchange(&mut rig, request);
    let fields = ["epm.annotation", "epm.proto.udp_port", "epm.proto.ip", "epm.rc"];
    let rows = dissected(&[found], &fields);
    let annotation = format!("{:25} {:20} {:5} V{:3}{:3}{:3}", "sample device", "sample-device", 1, 0, 1, 0);
    let wanted = [annotation.as_str(), "34964", "192.168.64.2", "0x00000000"];
    assert_eq!(rows[0][..fields.len()], wanted);
}
