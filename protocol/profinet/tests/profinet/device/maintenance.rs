//! I&M1 to 4, which the operator of a plant writes and the device keeps.

use profinet::Permanent;
use profinet::dcp::{BlockError, Content};
use profinet::record::{Address, Maintenance, ReadRequest, ReadResponse, WriteRequest, index};

use super::dissected::{dissected, exchange};
use super::permanent::{own, set, with};
use super::*;

const IM1: u16 = index::IDENTIFICATION_AND_MAINTENANCE_1;
const IM2: u16 = index::IDENTIFICATION_AND_MAINTENANCE_2;
const IM3: u16 = index::IDENTIFICATION_AND_MAINTENANCE_3;
const IM4: u16 = index::IDENTIFICATION_AND_MAINTENANCE_4;

fn text<const LEN: usize>(text: &str) -> [u8; LEN] {
    format!("{text:LEN$}").into_bytes().try_into().unwrap()
}

fn written() -> Maintenance {
    Maintenance {
        function: text("pick and place"),
        location: text("hall 3"),
        date: text("2026-11-24 13:05"),
        descriptor: text("paper's setup"),
        signature: [7; 54],
    }
}

const fn address(index: u16) -> Address {
    Address { sequence: 0, ar: AR, api: 0, slot: 0, subslot: 1, index }
}

fn write_at(rig: &mut DeviceRig, address: Address, record: &[u8]) -> Status {
    rig.call(Operation::Write, &emitted(|w| WriteRequest { address, record }.emit(w))).0
}

fn write(rig: &mut DeviceRig, index: u16) -> Status {
    write_at(rig, address(index), &emitted(|w| written().emit(index, w)))
}

fn read(rig: &mut DeviceRig, index: u16) -> Result<Vec<u8>, Status> {
    let read = ReadRequest { address: address(index), most: 4_000, target_ar: Uuid::NIL };
    let (status, blocks, _) = rig.call(Operation::Read, &emitted(|w| read.emit(w)));
    if !status.is_ok() {
        return Err(status);
    }
    Ok(ReadResponse::parse(&mut BlockReader::new(&blocks)).unwrap().record.to_vec())
}

/// Returns a device with a controller, whose owner stored this.
fn connected(permanent: Option<Permanent>) -> DeviceRig {
    let mut rig = with(permanent);
    rig.establish(&connect_request(RtClass::Class1, true));
    rig
}

#[test]
fn what_the_operator_writes_is_stored_and_there_after_a_restart() {
    let mut rig = connected(Some(Permanent::default()));
    for index in [IM1, IM2, IM3, IM4] {
        let blank = emitted(|w| Maintenance::default().emit(index, w));
        assert_eq!(read(&mut rig, index), Ok(blank));
        assert_eq!(write(&mut rig, index), Status::OK);
        assert_eq!(read(&mut rig, index), Ok(emitted(|w| written().emit(index, w))));
    }
    assert_eq!(rig.events(), [LinkEvent::Store], "one event until the owner has taken it");
    assert_eq!(write(&mut rig, IM1), Status::OK);
    assert_eq!(rig.events(), [], "nothing new");
    let stored = Permanent { maintenance: rig.device.to_store().2.copied(), ..Permanent::default() };
    assert_eq!(stored.maintenance, Some(written()));
    rig.device.stored(rig.now, true);
    assert_eq!(rig.events(), [], "data go on");

    let mut rig = connected(Some(stored));
    assert_eq!(read(&mut rig, IM3), Ok(emitted(|w| written().emit(IM3, w))));
    assert_eq!(rig.events(), []);
}

#[test]
fn a_multiple_write_writes_them_too() {
    let mut rig = connected(Some(Permanent::default()));
    let parts: Vec<u8> = [IM1, IM2, IM3]
        .into_iter()
        .flat_map(|index| {
            let record = emitted(|w| written().emit(index, w));
            let mut part = emitted(|w| WriteRequest { address: address(index), record: &record }.emit(w));
            part.resize(part.len().next_multiple_of(4), 0);
            part
        })
        .collect();
    assert_eq!(write_at(&mut rig, address(index::MULTIPLE_WRITE), &parts), Status::OK);
    let expected = Maintenance { signature: [0; 54], ..written() };
    assert_eq!(rig.device.to_store().2, Some(&expected));
    assert_eq!(rig.events(), [LinkEvent::Store]);
}

#[test]
fn wrong_writes_are_refused_by_reason_and_change_nothing() {
    let mut rig = connected(Some(Permanent::default()));
    let good = emitted(|w| written().emit(IM1, w));
    for (address, record, status) in [
        (Address { subslot: 0x8000, ..address(IM1) }, &good[..], 0xDF80_B600),
        (Address { slot: 1, ..address(IM1) }, &good, 0xDF80_B600),
        (Address { slot: 9, ..address(IM1) }, &good, 0xDF80_B200),
        (Address { api: 5, ..address(IM1) }, &good, 0xDF80_B400),
        (address(IM1), &good[..59], 0xDF80_B100),
        (address(IM3), &good, 0xDF80_B800),
        (address(index::IDENTIFICATION_AND_MAINTENANCE_0), &good, 0xDF80_B600),
        (address(0xAFF5), &good, 0xDF80_B000),
    ] {
        assert_eq!(write_at(&mut rig, address, record), Status(status), "{address:?}");
    }
    assert_eq!((rig.events(), rig.device.to_store().2), (vec![], None));
}

#[test]
fn an_owner_without_storage_has_none_of_them() {
    let mut rig = connected(None);
    assert_eq!(write(&mut rig, IM1), Status(0xDF80_B000));
    assert_eq!(read(&mut rig, IM1), Err(Status(0xDE80_B000)));
    let im0 = read(&mut rig, index::IDENTIFICATION_AND_MAINTENANCE_0).unwrap();
    assert_eq!(im0[58..], [0, 0], "I&M_Supported");
}

#[test]
fn a_reset_of_everything_removes_them_and_one_of_the_communication_does_not() {
    let all = Permanent { name: Some(b"robot".to_vec()), address: None, maintenance: Some(written()) };
    for (qualifier, content, left) in [
        (2 << 1, Content::ResetToFactory, Some(written())),
        (8 << 1, Content::ResetToFactory, None),
        (0, Content::FactoryReset, None),
    ] {
        let mut rig = with(Some(all.clone()));
        let mut sent = set(&mut rig, &[(qualifier, content)]);
        let (more, stored) = own(&mut rig, all.clone(), true);
        sent.extend(more);
        assert_eq!(discovery::results(&sent)[0].1, BlockError::None);
        assert_eq!(stored, Permanent { maintenance: left, ..Permanent::default() });
        assert_eq!(rig.device.to_store().2, left.as_ref());
    }
}

#[test]
fn tshark_reads_each_of_their_fields() {
    let mut rig = connected(Some(Permanent { maintenance: Some(written()), ..Permanent::default() }));
    let fields = [
        "pn_io.block_type",
        "pn_io.im_tag_function",
        "pn_io.im_tag_location",
        "pn_io.im_date",
        "pn_io.im_descriptor",
        "pn_io.im_supported",
    ];
    let mut ask = |index| {
        let read = ReadRequest { address: address(index), most: 4_000, target_ar: Uuid::NIL };
        let datagram = rig.datagram(Operation::Read, &emitted(|w| read.emit(w)));
        exchange(&mut rig, datagram)
    };
    let im0 = index::IDENTIFICATION_AND_MAINTENANCE_0;
    let rows = dissected(&[im0, IM1, IM2, IM3, IM4].map(&mut ask), &fields);
    let wanted = [
        ["0x8009,0x0020", "", "", "", "", "0x001e"],
        ["0x8009,0x0021", "pick and place", "hall 3", "", "", ""],
        ["0x8009,0x0022", "", "", "2026-11-24 13:05", "", ""],
        ["0x8009,0x0023", "", "", "", "paper's setup", ""],
        ["0x8009,0x0024", "", "", "", "", ""],
    ];
    for (row, wanted) in rows.iter().zip(wanted) {
        let (values, faults) = row.split_at(fields.len());
        let values: Vec<_> = values.iter().map(|value| value.trim_end()).collect();
        assert_eq!(values, wanted);
        assert!(faults.iter().all(String::is_empty), "{row:?}");
    }
}
