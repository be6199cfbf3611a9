//! Each record and answer of the device as tshark reads it, field by field. A frame may be well-formed for a dissector and
//! mean something else; so the values are compared, and the mere absence of faults is not enough.
//!
//! These tests need tshark; `scripts/dev.sh setup` installs it.

use profinet::record::{Address, ReadRequest, WriteRequest, index};
use profinet::rpc::{ENDPOINT_MAPPER_INTERFACE, LOOKUP};
use profinet::{Parameter, dcp};

use super::*;
use crate::tshark;

/// A request and the answer to it, as datagrams.
pub(super) type Exchange = [Vec<u8>; 2];

/// Returns what tshark reads in each answer: all values of each field, in the order of the fields, and the faults that it
/// finds.
pub(super) fn dissected(exchanges: &[Exchange], fields: &[&str]) -> Vec<Vec<String>> {
    let (controller, device) = ((CONTROLLER_MAC, CONTROLLER), (MAC, SocketAddrV4::new(ADDRESS, RPC_PORT)));
    let frames: Vec<_> = exchanges
        .iter()
        .flat_map(|[request, answer]| {
            [tshark::frame(controller, device, request), tshark::frame(device, controller, answer)]
        })
        .collect();
    tshark::dissected(&frames, fields).into_iter().skip(1).step_by(2).collect()
}

/// Makes a request and returns it with its answer.
pub(super) fn exchange(rig: &mut DeviceRig, request: Vec<u8>) -> Exchange {
    rig.sequence += 1;
    let sent = rig.receive(Port::Udp(RPC_PORT), &request);
    let answer = sent.into_iter().find(|(transmit, _)| transmit.to == Some(CONTROLLER));
    [request, answer.expect("an answer").1]
}

/// Reads a record of the AR at this place.
pub(super) fn read(rig: &mut DeviceRig, index: u16, slot: u16, subslot: u16) -> Exchange {
    let address = Address { sequence: 0, ar: AR, api: 0, slot, subslot, index };
    let request = ReadRequest { address, most: 4_000, target_ar: Uuid::NIL };
    let datagram = rig.datagram(Operation::Read, &emitted(|w| request.emit(w)));
    exchange(rig, datagram)
}

/// Asserts that tshark reads these values in the record: those of its head, which repeats the address, come first.
pub(super) fn assert_records(rig: &mut DeviceRig, fields: &[&str], cases: &[(u16, u16, u16, &[&str])]) {
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
    let mut rig = DeviceRig::connected(RtClass::Class1);
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
    let mut rig = DeviceRig::connected(RtClass::Class1);
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
fn the_ar_data_are_those_of_the_connect_and_of_the_last_frames() {
    let fields = [
        "pn_io.block_type",
        "pn_io.block_version_low",
        "pn_io.number_of_ars",
        "pn_io.cminitiator_uuid",
        "pn_io.ar_properties",
        "pn_io.ar_type",
        "pn_io.localalarmref",
        "pn_io.remotealarmref",
        "pn_io.cminitiator_udprtport",
        "pn_io.cmresponder_udprtport",
        "pn_io.cminitiator_station_name",
        "pn_io.iocr_properties.rtclass",
        "pn_io.iocr_type",
        "pn_io.frame_id",
        "pn_io.number_of_apis",
    ];
    for (rt_class, class, frame_ids) in [
        (RtClass::Class1, "0x00000002,0x00000002", "0x8001,0x8002"),
        (RtClass::Udp, "0x00000004,0x00000004", "0xc001,0xc002"),
    ] {
        let mut rig = DeviceRig::connected(rt_class);
        rig.advance(Duration::from_millis(2));
        rig.send_data(&[1; LEN]);
        // At any slot, and by its API.
        let answers = [read(&mut rig, 0xF820, 7, 7), read(&mut rig, 0xF020, 0, 0)];
        for row in dissected(&answers, &fields) {
            let (values, faults) = row.split_at(fields.len());
            let ar = ["dea00000-6c97-11d1-8271-0001010e002a", "0x40000001", "0x0001", "0x0000", "0x0005"];
            let ends = ["0x8892", "0x8892", "plc", class, "0x0001,0x0002", frame_ids, "1"];
            let wanted = [&["0x8009,0x0018", "0,1", "1"][..], &ar, &ends].concat();
            assert_eq!(values, wanted);
            assert!(faults.iter().all(String::is_empty), "{faults:?}");
        }
        // CycleCounter and DataStatus of the last frame from the controller.
        let (counter, status) = (rig.counter.to_be_bytes(), DataStatus::RUNNING.0);
        let output = [counter[0], counter[1], status, 0];
        assert!(read(&mut rig, 0xF820, 0, 0)[1].windows(4).any(|window| window == output));
    }
    let mut rig = DeviceRig::new();
    let none = ReadRequest {
        address: Address { sequence: 0, ar: Uuid::NIL, api: 0, slot: 0, subslot: 0, index: 0xF820 },
        most: 4_000,
        target_ar: Uuid::NIL,
    };
    let datagram = rig.datagram(Operation::ReadImplicit, &emitted(|w| none.emit(w)));
    let row = &dissected(&[exchange(&mut rig, datagram)], &fields)[0];
    assert_eq!((&row[2][..], &row[13][..]), ("0", ""));
}

#[test]
fn identification_and_maintenance_and_the_apis_are_those_of_the_description() {
    let mut rig = DeviceRig::connected(RtClass::Class1);
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
    let mut rig = DeviceRig::connected(RtClass::Class1);
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
fn the_data_of_a_submodule_are_those_of_the_last_frames_with_their_statuses() {
    let mut rig = DeviceRig::new();
    rig.device.set_input(1, 1, &[0x33; LEN]).unwrap();
    rig.establish(&connect_request(RtClass::Class1, true));
    let fields = [
        "pn_io.block_type",
        "pn_io.substitute_active_flag",
        "pn_io.length_iocs",
        "pn_io.length_iops",
        "pn_io.ioxs",
        "pn_io.iops",
        "pn_io.length_data",
    ];
    let none = ["0x8009,0x0015", "", "1", "1", "0x80", "0x80", "0"];
    let input = ["0x8009,0x0015", "", "1", "1", "0x80", "0x80", "256"];
    let output = |substitute, iops| ["0x8009,0x0016,0x0014", substitute, "1", "1", "0x80,0x80", iops, "256"];
    assert_records(
        &mut rig,
        &fields,
        &[(0x8028, 0, 0x8000, &none), (0x8028, 1, 1, &input), (0x8029, 1, 1, &output("0x0000", "0x80"))],
    );
    let holds = |rig: &mut DeviceRig, index, data: &[u8]| {
        read(rig, index, 1, 1)[1].windows(data.len()).any(|window| window == data)
    };
    assert!(holds(&mut rig, 0x8028, &[0x33; LEN]));
    assert!(holds(&mut rig, 0x8029, &[0x5A; LEN]));
    // The controller calls its data bad, so the device uses zeros.
    let (port, frame) = rig.cyclic(&[0x77; LEN], 0x60, DataStatus::RUNNING);
    rig.receive(port, &frame);
    let bad = output("0x0001", "0x60");
    assert_records(&mut rig, &fields, &[(0x8029, 1, 1, &bad)]);
    assert!(holds(&mut rig, 0x8029, &[0x77; LEN]) && holds(&mut rig, 0x8029, &[0; LEN]));
}

#[test]
fn there_are_data_of_a_submodule_only_in_the_directions_that_the_controller_connected() {
    let mut rig = DeviceRig::new();
    let missing = |rig: &mut DeviceRig, index, slot, subslot| {
        let address = Address { sequence: 0, ar: Uuid::NIL, api: 0, slot, subslot, index };
        let request = ReadRequest { address, most: 4_000, target_ar: Uuid::NIL };
        let (status, ..) = rig.call(Operation::ReadImplicit, &emitted(|w| request.emit(w)));
        status == Violation::InvalidIndex.status(Service::Read)
    };
    assert!(missing(&mut rig, 0x8028, 1, 1) && missing(&mut rig, 0x8029, 1, 1), "no AR");
    rig.establish(&connect_request(RtClass::Class1, false));
    assert!(!missing(&mut rig, 0x8028, 1, 1) && !missing(&mut rig, 0x8029, 1, 1));
    // This controller does not connect the access point, and gives no consumer statuses.
    assert!(missing(&mut rig, 0x8028, 0, 0x8000) && missing(&mut rig, 0x8029, 0, 0x8000));
    let fields = ["pn_io.ioxs", "pn_io.iops", "pn_io.length_data"];
    assert_records(&mut rig, &fields, &[(0x8028, 1, 1, &["0x00", "0x80", "256"])]);
}

/// Returns PDPortDataCheck: the port's neighbour should be port-002 of the station `plc`.
fn port_data_check() -> Vec<u8> {
    let peers = [&[1, 8][..], b"port-002", &[3], b"plc", &[0]].concat();
    let check_peers = [&[0x02, 0x0A, 0, 2 + peers.len() as u8, 1, 0][..], &peers].concat();
    let head = [0x02, 0x00, 0, 8 + check_peers.len() as u8, 1, 0, 0, 0, 0, 0, 0x80, 0x01];
    [&head[..], &check_peers].concat()
}

#[test]
fn what_is_written_to_interface_and_port_is_expected_until_the_connection_ends() {
    const ADJUST: u16 = index::PD_INTERFACE_ADJUST;
    const CHECK: u16 = index::PD_PORT_DATA_CHECK;
    let mut rig = DeviceRig::connected(RtClass::Class1);
    let fields = [
        "pn_io.block_type",
        "pn_io.slot_nr",
        "pn_io.subslot_nr",
        "pn_io.number_of_peers",
        "pn_io.peer_port_id",
        "pn_io.peer_chassis_id",
    ];
    let empty = |subslot| ["0x8009", "0x0000", subslot, "", "", ""];
    let nothing = [
        (CHECK, 0, 0x8001, &empty("0x8001")[..]),
        (ADJUST, 0, 0x8000, &empty("0x8000")),
        (0xF842, 0, 0, &empty("0x0000")),
    ];
    assert_records(&mut rig, &fields, &nothing);

    let write = |rig: &mut DeviceRig, subslot, index, record: &[u8]| {
        let address = Address { sequence: 0, ar: AR, api: 0, slot: 0, subslot, index };
        rig.call(Operation::Write, &emitted(|w| WriteRequest { address, record }.emit(w))).0
    };
    // Longer at first: the second one replaces it. The last bytes fill the record up, and are not kept.
    let padded = [&port_data_check()[..], &[0; 2]].concat();
    let mut longer = [&port_data_check()[..], &[0; 40]].concat();
    longer[3] += 40;
    for record in [&longer, &padded] {
        assert_eq!(write(&mut rig, 0x8001, CHECK, record), Status::OK);
    }
    assert_eq!(write(&mut rig, 0x8000, ADJUST, &Parameter::interface_adjust().data), Status::OK);
    let check = ["0x8009,0x0200,0x020a", "0x0000,0x0000", "0x8001,0x8001", "1", "port-002", "plc"];
    let adjust = ["0x8009,0x0250", "0x0000", "0x8000", "", "", ""];
    let all = [
        "0x8009,0x0400,0x0250,0x0400,0x0200,0x020a",
        "0x0000,0x0000,0x0000,0x0000",
        "0x0000,0x8000,0x8001,0x8001",
        "1",
        "port-002",
        "plc",
    ];
    let written = [(CHECK, 0, 0x8001, &check[..]), (ADJUST, 0, 0x8000, &adjust), (0xF842, 0, 0, &all)];
    assert_records(&mut rig, &fields, &written);

    // The greatest that is kept, and one more; another block, and a cut one.
    let length = |record: &mut Vec<u8>, len: usize| {
        record.resize(len, 0);
        record[2..4].copy_from_slice(&(len as u16 - 4).to_be_bytes());
    };
    let mut long = port_data_check();
    length(&mut long, 1_024);
    assert_eq!(write(&mut rig, 0x8001, CHECK, &long), Status::OK);
    length(&mut long, 1_025);
    for (record, violation) in [
        (&long[..], Violation::WriteLength),
        (&Parameter::interface_adjust().data, Violation::InvalidParameter),
        (&port_data_check()[..20], Violation::WriteLength),
        (&[], Violation::WriteLength),
    ] {
        assert_eq!(write(&mut rig, 0x8001, CHECK, record), violation.status(Service::Write));
    }

    let release = control(Command::Release);
    assert_eq!(rig.control(Operation::Release, release).0, Status::OK);
    rig.events();
    rig.establish(&connect_request(RtClass::Class1, true));
    assert_records(&mut rig, &fields, &nothing);
}

#[test]
fn the_module_diff_and_the_log_book_tell_what_was_wrong() {
    let mut rig = DeviceRig::new();
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
    let mut rig = DeviceRig::new();
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
fn the_endpoint_mapper_lists_itself_and_the_device_with_annotation_port_and_address() {
    let mut rig = DeviceRig::new();
    // Both pointers, and at most one entry.
    let mut body = [0; 76];
    (body[7], body[27], body[75]) = (1, 2, 1);
    let mut exchanges = Vec::new();
    for sequence in 0..3 {
        let operation = Operation::Unknown(LOOKUP);
        let mut header =
            Header::request(operation, Uuid::NIL, ENDPOINT_MAPPER_INTERFACE, rig.activity, sequence);
        header.interface_version = 3;
        let mut buf = [0; 200];
        let len = header.emit(&body, &mut buf).unwrap();
        let found = exchange(&mut rig, buf[..len].to_vec());
        let (_, answer) = Header::parse(&found[1]).unwrap();
        body[52..72].copy_from_slice(&answer[..20]);
        exchanges.push(found);
    }
    let fields = ["epm.annotation", "epm.uuid", "epm.proto.udp_port", "epm.proto.ip", "epm.rc"];
    let rows = dissected(&exchanges, &fields);
    let annotation = format!("{:25} {:20} {:5} V{:3}{:3}{:3}", "sample device", "sample-device", 1, 0, 1, 0);
    let ndr = "8a885d04-1ceb-11c9-9fe8-08002b104860";
    let floors = ["e1af8308-5d1f-11c9-91a4-08002b14a0fa", "dea00001-6c97-11d1-8271-00a02442df7d"]
        .map(|interface| format!("{interface},{ndr}"));
    for (row, floors) in rows.iter().zip(&floors) {
        assert_eq!(row[..fields.len()], [&annotation, floors, "34964", "192.168.64.2", "0x00000000"]);
    }
    assert_eq!(rows[2][..fields.len()], ["", "", "", "", "0x16c9a0d6"]);
    for row in rows {
        assert!(row[fields.len()..].iter().all(String::is_empty), "{row:?}");
    }
}

#[test]
fn the_answer_to_identify_has_every_block_that_it_lists() {
    let mut rig = DeviceRig::new();
    let identify = discovery::request(dcp::IDENTIFY_MULTICAST, |w| {
        dcp::emit(w, dcp::Service::IdentifyRequest, 7, 1, [dcp::Content::All.into()]);
    });
    let sent = rig.receive(Port::Ethernet, &identify);
    let fields = [
        "pn_dcp.suboption_device_nameofstation",
        "pn_dcp.suboption_vendor_id",
        "pn_dcp.suboption_device_id",
        "pn_dcp.suboption_ip_ip",
        "pn_dcp.suboption_device_role",
        "pn_dcp.suboption_device_instance",
        "pn_dcp.suboption_device",
    ];
    let rows = tshark::dissected(&[sent[0].1.clone()], &fields);
    let (values, faults) = rows[0].split_at(fields.len());
    // The instance as its high and its low byte.
    assert_eq!(values[..6], ["device", "0xffff", "0x0001", "192.168.64.2", "0x01", "0x00,0x01"]);
    // Its own blocks, between them those that it lists.
    assert_eq!(values[6], "1,2,3,4,5,1,2,3,4,5,6,7,7");
    assert!(faults.iter().all(String::is_empty), "{faults:?}");
}
