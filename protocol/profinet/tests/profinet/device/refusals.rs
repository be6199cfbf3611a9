//! What a controller can do wrong, and the status that it gets for it.

use super::*;
use profinet::Parameter;
use profinet::connect::{ModuleState, SubmoduleState};
use profinet::record::{Address, ReadRequest, WriteRequest, WriteResponse, index};
use profinet::status::{Block, HeadField};

/// Connects with a request that `spoil` has changed; returns the status.
fn refused(rt_class: RtClass, spoil: impl FnOnce(&mut ConnectRequest)) -> Status {
    let mut rig = DeviceRig::new();
    let mut request = connect_request(rt_class, true);
    spoil(&mut request);
    let (status, _) = rig.connect(&request);
    assert!(!rig.device.has_controller() || status.is_ok());
    status
}

#[test]
fn every_field_of_a_connect_that_is_out_of_bounds_gets_its_own_status() {
    // Longer than a screen, because it is one table of cases.
    type Spoil = fn(&mut ConnectRequest);
    let cases: &[(Violation, Spoil)] = &[
        (Violation::ArType, |r| r.ar.ar_type = 6),
        (Violation::ArUuid, |r| r.ar.uuid = Uuid::NIL),
        (Violation::InitiatorMac, |r| r.ar.initiator_mac = Mac([1, 0, 0, 0, 0, 0])),
        (Violation::InitiatorObject, |r| r.ar.initiator_object = AR),
        (Violation::ArProperties, |r| r.ar.properties.0 = 0),
        (Violation::ArProperties, |r| r.ar.properties.0 |= ArProperties::DEVICE_ACCESS),
        (Violation::ActivityTimeout, |r| r.ar.activity_timeout = 1_001),
        (Violation::StationNameLength, |r| r.ar.initiator_name.clear()),
        (Violation::StationNameLength, |r| r.ar.initiator_name = vec![b'a'; 241]),
        (Violation::IocrMissing, |r| drop(r.iocrs.pop())),
        (Violation::IocrMissing, |r| r.iocrs.clear()),
        (Violation::IocrType, |r| r.iocrs[1].iocr_type = IocrType::Unknown(3)),
        (Violation::IocrType, |r| r.iocrs.push(r.iocrs[0].clone())),
        (Violation::IocrReference, |r| r.iocrs[1].reference = 1),
        (Violation::IocrLt, |r| r.iocrs[0].lt = LT_UDP),
        (Violation::IocrProperties, |r| r.iocrs[0].rt_class = RtClass::Unknown(3)),
        (Violation::IocrDataLength, |r| r.iocrs[0].data_length = 39),
        (Violation::IocrDataLength, |r| r.iocrs[0].data_length = 1_441),
        (Violation::FrameId, |r| r.iocrs[0].frame_id = 0xC001),
        (Violation::SendClockFactor, |r| r.iocrs[0].send_clock_factor = 0),
        (Violation::SendClockFactor, |r| r.iocrs[0].send_clock_factor = 33),
        (Violation::SendClockFactor, |r| r.iocrs[1].send_clock_factor = 256),
        (Violation::ReductionRatio, |r| r.iocrs[0].reduction_ratio = 0),
        (Violation::ReductionRatio, |r| r.iocrs[0].reduction_ratio = 3),
        (Violation::ReductionRatio, |r| r.iocrs[0].reduction_ratio = 1_024),
        // Cycles of 31.25 µs, of 500 µs and of 1.024 s.
        (Violation::ReductionRatio, |r| r.iocrs[0].send_clock_factor = 1),
        (Violation::ReductionRatio, |r| r.iocrs[1].send_clock_factor = 16),
        (Violation::ReductionRatio, |r| {
            (r.iocrs[0].send_clock_factor, r.iocrs[0].reduction_ratio, r.iocrs[0].phase) = (64, 512, 1);
            (r.iocrs[0].watchdog_factor, r.iocrs[0].data_hold_factor) = (1, 1);
        }),
        (Violation::Phase, |r| r.iocrs[0].phase = 2),
        (Violation::FrameSendOffset, |r| r.iocrs[0].frame_send_offset = 1_000_000),
        (Violation::WatchdogFactor, |r| r.iocrs[0].watchdog_factor = 0),
        (Violation::DataHoldFactor, |r| r.iocrs[1].data_hold_factor = 1_921),
        (Violation::IocrTagHeader, |r| r.iocrs[0].tag_header = 0x4000),
        (Violation::IocrTagHeader, |r| r.iocrs[1].tag_header = 0xC001),
        (Violation::IocrProperties, |r| {
            let iocrs = r.iocrs.iter_mut();
            iocrs.for_each(|iocr| {
                (iocr.rt_class, iocr.frame_id) = (RtClass::Legacy1, 0xC000 + iocr.reference)
            });
        }),
        (Violation::IoDataSlot, |r| r.iocrs[0].objects[0].slot = 9),
        (Violation::IoDataSubslot, |r| r.iocrs[0].objects[0].subslot = 9),
        (Violation::IoDataSubslot, |r| r.iocrs[1].objects[0] = r.iocrs[0].objects[0]),
        (Violation::IoDataOffset, |r| r.iocrs[0].objects[0].offset = 261),
        (Violation::IoDataOffset, |r| r.iocrs[0].objects[0].offset = u16::MAX),
        (Violation::IoDataOffset, |r| r.iocrs[0].objects[0].offset = 258),
        (Violation::IocsSlot, |r| r.iocrs[0].consumer_statuses[0].slot = 9),
        (Violation::IocsSubslot, |r| r.iocrs[0].consumer_statuses[0].subslot = 9),
        (Violation::IocsOffset, |r| r.iocrs[0].consumer_statuses[0].offset = 0),
        (Violation::IocsOffset, |r| r.iocrs[0].consumer_statuses[0].offset = 261),
        (Violation::IoDataCount, |r| r.iocrs[0].objects = vec![r.iocrs[0].objects[0]; 513]),
        (Violation::AlarmCrCount, |r| r.alarm_cr = None),
        (Violation::AlarmCrType, |r| alarm_cr(r).alarm_cr_type = 2),
        (Violation::AlarmCrLt, |r| alarm_cr(r).lt = LT_UDP),
        (Violation::AlarmCrProperties, |r| alarm_cr(r).properties = 8),
        (Violation::RtaTimeoutFactor, |r| alarm_cr(r).rta_timeout = 0),
        (Violation::RtaRetries, |r| alarm_cr(r).rta_retries = 2),
        (Violation::MaxAlarmDataLength, |r| alarm_cr(r).max_data_length = 199),
        (Violation::AlarmCrTagHeaderHigh, |r| alarm_cr(r).tag_high = 0xA000),
        (Violation::AlarmCrTagHeaderLow, |r| alarm_cr(r).tag_low = 0xC000),
        (Violation::AlarmCrTagHeaderHigh, |r| alarm_cr(r).tag_high = 0xC001),
        (Violation::AlarmCrTagHeaderLow, |r| alarm_cr(r).tag_low = 0xAFFF),
        (Violation::SubmoduleProperties, |r| r.expected[1].submodules[0].properties = 1 << 3),
        (Violation::SubmoduleProperties, |r| r.expected[1].submodules[0].properties = 1 << 4),
        (Violation::SubmoduleProperties, |r| r.expected[0].submodules[0].properties = 1 << 5),
        (Violation::ExpectedSlot, |r| r.expected.push(r.expected[0].clone())),
        (Violation::ExpectedSubslot, |r| r.expected[0].submodules[1].subslot = 1),
        (Violation::ExpectedSubmoduleCount, |r| r.expected[0].submodules.clear()),
        (Violation::SubmoduleDataLength, |r| {
            r.iocrs[0].data_length = 1_440;
            r.iocrs[0].objects.pop();
            r.iocrs[1].objects.pop();
            r.expected[1].submodules[0].input_len = Some(255);
        }),
        (Violation::SubmoduleDataLength, |r| r.expected[1].submodules[0].input_len = Some(1_440)),
    ];
    for (violation, spoil) in cases {
        let status = refused(RtClass::Class1, spoil);
        assert_eq!(status, violation.status(Service::Connect), "{violation:?}");
    }
}

fn alarm_cr(request: &mut ConnectRequest) -> &mut AlarmCr {
    request.alarm_cr.as_mut().unwrap()
}

#[test]
fn over_udp_the_bounds_are_wider_and_the_port_must_be_a_free_one() {
    assert!(refused(RtClass::Udp, |r| r.iocrs[0].reduction_ratio = 3).is_ok());
    assert!(refused(RtClass::Udp, |r| r.iocrs[1].data_hold_factor = 0x1E00).is_ok());
    assert!(refused(RtClass::Udp, |r| r.iocrs[0].tag_header = 0).is_ok());
    assert!(refused(RtClass::Udp, |r| r.iocrs[0].reduction_ratio = 1_920).is_ok());
    // Each frame would have the same number as the one before, and would count as repeated.
    let every_2048_ms = refused(RtClass::Udp, |r| r.iocrs[0].reduction_ratio = 2_048);
    assert_eq!(every_2048_ms, Violation::ReductionRatio.status(Service::Connect));
    let every_31_us = refused(RtClass::Udp, |r| r.iocrs[0].send_clock_factor = 1);
    assert_eq!(every_31_us, Violation::ReductionRatio.status(Service::Connect));
    let status = refused(RtClass::Udp, |r| r.ar.initiator_rt_port = 0x3FF);
    assert_eq!(status, Violation::InitiatorRtPort.status(Service::Connect));
    let status = refused(RtClass::Udp, |r| r.iocrs[0].lt = ETHER_TYPE);
    assert_eq!(status, Violation::IocrLt.status(Service::Connect));
}

#[test]
fn a_frame_id_that_the_controller_leaves_open_is_chosen() {
    for (rt_class, chosen) in [(RtClass::Class1, 0x8000), (RtClass::Legacy1, 0xC000), (RtClass::Udp, 0xC000)]
    {
        let mut rig = DeviceRig::new();
        let mut request = connect_request(rt_class, true);
        request.iocrs[1].frame_id = 0xFFFF;
        let (_, response) = rig.connect(&request);
        assert_eq!(response.unwrap().iocrs[1].frame_id, chosen, "0x..01 is taken by the input");
    }
}

#[test]
fn wrong_modules_are_told_and_the_rest_works() {
    let mut rig = DeviceRig::new();
    let mut request = connect_request(RtClass::Class1, true);
    request.expected[0].submodules[2].ident = 0x9999;
    request.expected.push(ExpectedModule {
        slot: 7,
        ident: 0x70,
        properties: 0,
        submodules: vec![ExpectedSubmodule {
            subslot: 1,
            ident: 0x71,
            properties: 0,
            input_len: Some(2),
            output_len: None,
        }],
    });
    let (status, response) = rig.connect(&request);
    assert!(status.is_ok());
    let diff = response.unwrap().diff;
    assert_eq!(diff.len(), 2);
    assert_eq!((diff[0].slot, diff[0].state, diff[0].ident), (0, ModuleState::ProperModule, 1));
    assert_eq!(diff[0].submodules.len(), 1);
    assert_eq!((diff[0].submodules[0].ident, diff[0].submodules[0].state), (0x8001, SubmoduleState::WRONG));
    assert_eq!((diff[1].slot, diff[1].state, diff[1].ident), (7, ModuleState::NoModule, 0));
    assert_eq!(diff[1].submodules[0].state, SubmoduleState::NONE);
    let (_, sent) = rig.prm_end();
    rig.confirm(&sent[0].1);
    rig.send_data(&[1; LEN]);
    assert_eq!(rig.events(), [LinkEvent::Up]);

    let mut rig = DeviceRig::new();
    let mut request = connect_request(RtClass::Class1, true);
    request.expected[1].ident = 0x9999;
    let (_, response) = rig.connect(&request);
    let diff = response.unwrap().diff;
    assert_eq!((diff[0].slot, diff[0].state), (1, ModuleState::WrongModule));
    let (_, sent) = rig.prm_end();
    rig.confirm(&sent[0].1);
    rig.send_data(&[1; LEN]);
    assert_eq!(rig.events(), [], "without the module there are no data");
}

#[test]
fn requests_for_another_ar_or_session_or_out_of_turn_are_refused_and_the_ar_stays() {
    let mut rig = DeviceRig::connected(RtClass::Class1);
    let other_ar = Control { ar: Uuid([1; 16]), ..control(Command::PrmEnd) };
    let other_session = |command| Control { session: 9, ..control(command) };
    let cases = [
        (Operation::Control, other_ar, 0xDD81_4005),
        (Operation::Control, control(Command::PrmEnd), 0xDD81_4006),
        (Operation::Control, other_session(Command::PrmEnd), 0xDD81_1406),
        (Operation::Control, other_session(Command::PrmBegin), 0xDD81_1806),
        (Operation::Control, control(Command::Release), 0xDD81_4001),
        (Operation::Control, control(Command::ApplicationReady), 0xDD81_4001),
        (Operation::Release, other_session(Command::Release), 0xDC81_2806),
        (Operation::Release, Control { ar: Uuid([1; 16]), ..control(Command::Release) }, 0xDC81_4005),
        (Operation::Release, control(Command::PrmEnd), 0xDC81_4001),
    ];
    for (operation, control, status) in cases {
        assert_eq!(rig.control(operation, control).0, Status(status), "{operation:?} {control:?}");
    }
    let connect = connect_request(RtClass::Class1, true);
    assert_eq!(rig.connect(&connect).0, Violation::StateConflict.status(Service::Connect));
    assert_eq!(rig.events(), []);
    assert!(rig.device.output(1, 1).is_some());
}

#[test]
fn parameters_can_be_written_anew_and_then_the_device_is_ready_again() {
    let mut rig = DeviceRig::connected(RtClass::Class1);
    assert!(rig.control(Operation::Control, control(Command::PrmBegin)).0.is_ok());
    let (status, sent) = rig.prm_end();
    assert!(status.is_ok());
    rig.confirm(&sent[0].1);
    assert!(rig.device.output(1, 1).is_some());
    assert_eq!(rig.events(), []);
}

const ADDRESS_OF_RECORD: Address = Address { sequence: 0, ar: AR, api: 0, slot: 1, subslot: 1, index: 1 };

#[test]
fn writes_are_refused_by_reason() {
    let mut rig = DeviceRig::connected(RtClass::Class1);
    let address = ADDRESS_OF_RECORD;
    for (address, status) in [
        (address, 0xDF80_B000),
        (Address { slot: 9, ..address }, 0xDF80_B200),
        (Address { api: 1, ..address }, 0xDF80_B400),
        (Address { index: index::IDENTIFICATION_AND_MAINTENANCE_0, ..address }, 0xDF80_B600),
        (Address { index: index::INPUT_DATA, ..address }, 0xDF80_B600),
        (Address { slot: 0, subslot: 0x8001, index: index::PD_PORT_DATA_REAL, ..address }, 0xDF80_B600),
        (Address { slot: 0, subslot: 0x8000, index: index::PD_INTERFACE_ADJUST, ..address }, 0xDF80_B100),
        (Address { slot: 0, subslot: 0x8001, index: index::PD_INTERFACE_ADJUST, ..address }, 0xDF80_B000),
        // PDInterfaceMrpDataAdjust: a ring must not rely on a device that is not part of it.
        (Address { slot: 0, subslot: 0x8000, index: 0x8052, ..address }, 0xDF80_B000),
        (Address { ar: Uuid([1; 16]), ..address }, 0xDF81_4005),
    ] {
        let write = WriteRequest { address, record: &[1, 2, 3, 4] };
        let (answer, ..) = rig.call(Operation::Write, &emitted(|w| write.emit(w)));
        assert_eq!(answer, Status(status), "{address:?}");
    }
}

#[test]
fn each_write_of_a_multiple_write_has_its_own_status_and_one_that_is_cut_fails_them_all() {
    let mut rig = DeviceRig::connected(RtClass::Class1);
    let adjust = Address { slot: 0, subslot: 0x8000, index: 0x8071, ..ADDRESS_OF_RECORD };
    let parts = emitted(|w| {
        let record = [&Parameter::interface_adjust().data[..], &[0; 3]].concat();
        WriteRequest { address: adjust, record: &record }.emit(w);
        w.align(4);
        WriteRequest { address: ADDRESS_OF_RECORD, record: &[4] }.emit(w);
    });
    let multiple = Address { index: index::MULTIPLE_WRITE, ..ADDRESS_OF_RECORD };
    let write = |record: &[u8]| emitted(|w| WriteRequest { address: multiple, record }.emit(w));
    let (status, blocks, _) = rig.call(Operation::Write, &write(&parts));
    assert!(status.is_ok());
    let mut reader = BlockReader::new(&blocks);
    let statuses: Vec<_> = (0..3).map(|_| WriteResponse::parse(&mut reader).unwrap().status.0).collect();
    assert_eq!(statuses, [0, 0, 0xDF80_B000]);

    let (status, ..) = rig.call(Operation::Write, &write(&parts[..parts.len() - 1]));
    assert_eq!(status, Violation::RecordDataLength.status(Service::Write));
    let (status, ..) = rig.call(Operation::Write, &write(&write(&[])));
    assert_eq!(status, Violation::RecordIndex.status(Service::Write));
}

#[test]
fn reads_are_answered_or_refused_by_reason() {
    let mut rig = DeviceRig::connected(RtClass::Class1);
    let address = ADDRESS_OF_RECORD;
    let im0 = index::IDENTIFICATION_AND_MAINTENANCE_0;
    let cases = [
        (Operation::Read, Address { index: im0, ..address }, 4_000, 0),
        (Operation::ReadImplicit, Address { index: im0, ar: Uuid::NIL, ..address }, 4_000, 0),
        (Operation::Read, Address { index: im0, ar: Uuid::NIL, ..address }, 4_000, 0xDE81_4005),
        (Operation::Read, Address { index: im0, slot: 3, ..address }, 4_000, 0xDE80_B200),
        (Operation::Read, Address { index: im0, api: 3, ..address }, 4_000, 0xDE80_B400),
        (Operation::Read, Address { index: im0, ..address }, 59, 0xDE80_B700),
        (Operation::Read, Address { index: 0xAFF5, ..address }, 4_000, 0xDE80_B000),
        (Operation::Read, Address { index: 0xF000, slot: 0, subslot: 0, ..address }, 4_000, 0),
        (Operation::Read, Address { index: 0xE001, slot: 0xFFFF, ..address }, 4_000, 0),
        (Operation::Read, Address { index: 0xC001, subslot: 0, ..address }, 4_000, 0),
        (Operation::Read, Address { index: 0xC001, slot: 5, ..address }, 4_000, 0xDE80_B200),
        (Operation::Read, Address { index: 0x8001, ..address }, 4_000, 0),
        (Operation::Read, Address { index: 0xF840, slot: 77, subslot: 9, api: 5, ..address }, 4_000, 0),
        (
            Operation::Read,
            Address { index: 0xF83F, slot: 77, subslot: 9, api: 5, ..address },
            4_000,
            0xDE80_B000,
        ),
        (
            Operation::Read,
            Address { index: 0xE0FF, slot: 77, subslot: 9, api: 5, ..address },
            4_000,
            0xDE80_B000,
        ),
        (Operation::Read, Address { index: 0xF0FF, slot: 77, subslot: 9, ..address }, 4_000, 0xDE80_B000),
        (Operation::Read, Address { index: 0xF0FF, api: 5, ..address }, 4_000, 0xDE80_B400),
        (Operation::Read, Address { index: 0xC00A, subslot: 9, ..address }, 0, 0),
        (Operation::Read, Address { index: 0xF80C, slot: 77, ..address }, 0, 0),
        (
            Operation::ReadImplicit,
            Address { index: 0xE000, ar: Uuid([1; 16]), ..address },
            4_000,
            0xDE81_0805,
        ),
        (Operation::ReadImplicit, Address { index: 0xE000, ar: Uuid::NIL, ..address }, 4_000, 0),
    ];
    for (operation, address, most, status) in cases {
        let read = ReadRequest { address, most, target_ar: Uuid::NIL };
        let (answer, ..) = rig.call(operation, &emitted(|w| read.emit(w)));
        assert_eq!(answer, Status(status), "{operation:?} {address:?}");
    }
}

#[test]
fn an_unknown_operation_or_interface_is_rejected_in_the_terms_of_rpc() {
    let mut rig = DeviceRig::new();
    let mut reject = |header: Header| {
        let mut buf = [0; 200];
        let len = header.emit(&[0; 20], &mut buf).unwrap();
        let sent = rig.receive(Port::Udp(RPC_PORT), &buf[..len]);
        let (header, body) = Header::parse(&sent[0].1).unwrap();
        assert_eq!(header.kind, Kind::Reject);
        profinet::rpc::read_rpc_status(&header, body)
    };
    let header = DeviceRig::new().header(Operation::Unknown(9));
    assert_eq!(reject(header), Some(rpc_status::OPERATION_RANGE));
    assert_eq!(reject(Header { interface: AR, ..header }), Some(rpc_status::UNKNOWN_INTERFACE));
}

#[test]
fn a_write_of_more_records_than_fit_into_a_call_is_rejected_and_the_connection_stays() {
    let mut rig = DeviceRig::connected(RtClass::Class1);
    let header = rig.header(Operation::Write);
    let mut answers = Vec::new();
    // A MultipleWrite of 10 kB, and the same once more.
    for fragment in (0..8).chain(0..8) {
        let last = if fragment == 7 { flags::LAST_FRAGMENT } else { 0 };
        let flags = header.flags | flags::FRAGMENT | flags::NO_FRAGMENT_ACK | last;
        let mut buf = [0; 1500];
        let len = Header { fragment, flags, ..header }.emit(&[0; 1312], &mut buf).unwrap();
        for (_, datagram) in rig.receive(Port::Udp(RPC_PORT), &buf[..len]) {
            let Ok((answer, body)) = Header::parse(&datagram) else { continue };
            answers.push((fragment, answer.kind, profinet::rpc::read_rpc_status(&answer, body)));
        }
    }
    let reject = (6, Kind::Reject, Some(rpc_status::UNSPECIFIED_REJECT));
    assert_eq!(answers, [reject, reject], "the seventh fragment does not fit into 8192 bytes");
    assert!(rig.device.has_controller());
}

#[test]
fn block_lengths_of_zero_or_past_the_end_name_their_block() {
    let blocks = emitted(|w| connect_request(RtClass::Class1, true).emit(w));
    let mut starts = Vec::new();
    let mut at = 0;
    while at < blocks.len() {
        starts.push(at);
        at += 4 + usize::from(u16::from_be_bytes([blocks[at + 2], blocks[at + 3]]));
    }
    let faulty = [
        Block::Ar,
        Block::Iocr,
        Block::Iocr,
        Block::AlarmCr,
        Block::ExpectedSubmodule,
        Block::ExpectedSubmodule,
    ];
    for (start, block) in starts.into_iter().zip(faulty) {
        for length in [0_u16, 1, 5, 0xFFFF] {
            let mut blocks = blocks.clone();
            blocks[start + 2..start + 4].copy_from_slice(&length.to_be_bytes());
            let (status, ..) = DeviceRig::new().call(Operation::Connect, &blocks);
            let wanted = Violation::Head(block, HeadField::Length).status(Service::Connect);
            assert_eq!(status, wanted, "block at {start}, length {length}");
        }
    }
}
