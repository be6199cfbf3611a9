//! The borders of CoE: names that do not fit, lists that do not exist, lengths that are just right or just wrong.

use ethercat_subdevice::description::{Access, DataType, Entry, Object, ObjectCode, Pdo, PdoEntry};
use ethercat_subdevice::{Description, DeviceConfig, DeviceId, Segment};

use crate::devices::{BRIDGE, SMART, TINY};
use crate::raw_main_device::RawMainDevice;

const ABORTED: u8 = 0x80;
const COMMAND: u32 = 0x0504_0001;
const READ_ONLY: u32 = 0x0601_0002;
const NO_COMPLETE_ACCESS: u32 = 0x0601_0004;
const TOO_LONG: u32 = 0x0607_0012;
const GENERAL: u32 = 0x0800_0000;

fn of(description: &'static Description) -> Segment {
    let mut segment = Segment::new();
    segment.add(&DeviceConfig::new(description));
    segment
}

/// Sends an SDO request; returns command and value of the answer.
fn ask(main_device: &mut RawMainDevice, command: u8, index: u16, subindex: u8, value: u32) -> (u8, u32) {
    let mut request = vec![command];
    request.extend(index.to_le_bytes());
    request.push(subindex);
    request.extend(value.to_le_bytes());
    let answer = main_device.sdo(&request);
    (answer[0], u32::from_le_bytes(answer[4..8].try_into().unwrap()))
}

/// Asks for the next segment.
fn segment(main_device: &mut RawMainDevice, toggle: u8) -> Vec<u8> {
    main_device.sdo(&[0x60 | toggle, 0, 0, 0, 0, 0, 0, 0])
}

#[test]
fn a_name_that_does_not_fit_the_mailbox_is_cut_to_what_fits() {
    let mut main_device = RawMainDevice::start_with(of(&TINY), 32);
    // 6 bytes of the mailbox, 2 of CoE, 4 of the service and 6 of the object leave 14.
    let object = main_device.coe(8, &[3, 0, 0, 0, 0x09, 0x10]);
    assert_eq!(object[2..8], [4, 0, 0, 0, 0x09, 0x10]);
    assert_eq!(object[12..], *b"Hardware versi");
    // Of an entry 4 more are its own.
    let entry = main_device.coe(8, &[5, 0, 0, 0, 0x18, 0x10, 0, 0]);
    assert_eq!(entry[2..8], [6, 0, 0, 0, 0x18, 0x10]);
    assert_eq!(entry[16..], *b"Highest su");
}

#[test]
fn there_are_five_lists_of_objects_and_a_sixth_is_refused() {
    let mut main_device = RawMainDevice::start(of(&SMART));
    for list in 1..=5 {
        let answer = main_device.coe(8, &[1, 0, 0, 0, list, 0]);
        assert_eq!(answer[2..8], [2, 0, 0, 0, list, 0]);
    }
    let answer = main_device.coe(8, &[1, 0, 0, 0, 6, 0]);
    assert_eq!((answer[2], &answer[6..]), (7, &GENERAL.to_le_bytes()[..]));
}

#[test]
fn an_upload_that_fits_one_message_has_no_segments() {
    let mut main_device = RawMainDevice::start(of(&BRIDGE));
    let room = 128 - 6 - 2 - 8;
    for len in [0, 5, room] {
        main_device.segment.set_object(DeviceId(0), 0x8001, 0, &vec![b'x'; len]).unwrap();
        assert_eq!(ask(&mut main_device, 0x40, 0x8001, 0, 0), (0x41, len as u32));
        let answer = segment(&mut main_device, 0);
        assert_eq!((answer[0], &answer[4..8]), (ABORTED, &COMMAND.to_le_bytes()[..]), "{len}");
    }
    main_device.segment.set_object(DeviceId(0), 0x8001, 0, &vec![b'x'; room + 1]).unwrap();
    assert_eq!(ask(&mut main_device, 0x40, 0x8001, 0, 0), (0x41, room as u32 + 1));
    assert_eq!(segment(&mut main_device, 0)[..2], [0x01 | 6 << 1, b'x'], "six of seven bytes are unused");
}

#[test]
fn a_short_last_segment_says_how_many_of_its_seven_bytes_are_unused() {
    let mut main_device = RawMainDevice::start(of(&BRIDGE));
    for more in 1..=9_usize {
        main_device.segment.set_object(DeviceId(0), 0x8001, 0, &vec![b'x'; 112 + more]).unwrap();
        ask(&mut main_device, 0x40, 0x8001, 0, 0);
        let unused = 7_usize.saturating_sub(more);
        let answer = segment(&mut main_device, 0);
        assert_eq!(answer[0], 0x01 | (unused as u8) << 1, "{more}");
        assert_eq!(answer[1..], [vec![b'x'; more], vec![0; unused]].concat());
    }
}

#[test]
fn an_expedited_download_without_its_length_has_that_of_the_entry() {
    let mut main_device = RawMainDevice::start(of(&BRIDGE));
    for (subindex, len) in [(1, 2_usize), (2, 1), (3, 4)] {
        assert_eq!(ask(&mut main_device, 0x22, 0x8000, subindex, 0x0403_0201), (0x60, 0));
        let value = &[1, 2, 3, 4][..len];
        assert_eq!(main_device.segment.object(DeviceId(0), 0x8000, subindex), Some(value));
    }
}

#[test]
fn a_value_of_more_than_64_kib_is_refused_before_memory_is_allocated_for_it() {
    let mut main_device = RawMainDevice::start(of(&BRIDGE));
    assert_eq!(ask(&mut main_device, 0x21, 0x8001, 0, 0x1_0000), (0x60, 0));
    assert_eq!(ask(&mut main_device, 0x21, 0x8001, 0, 0x1_0001), (ABORTED, TOO_LONG));
}

#[test]
fn a_download_in_segments_to_what_cannot_be_written_is_refused_at_its_start() {
    let mut main_device = RawMainDevice::start(of(&BRIDGE));
    assert_eq!(ask(&mut main_device, 0x21, 0x1008, 0, 300), (ABORTED, READ_ONLY));
    assert_eq!(ask(&mut main_device, 0x21, 0x8001, 0, 300), (0x60, 0));
}

#[test]
fn a_complete_access_begins_at_subindex_0_or_1_of_an_object_with_several() {
    let mut main_device = RawMainDevice::start(of(&BRIDGE));
    for subindex in [0, 1] {
        assert_eq!(ask(&mut main_device, 0x50, 0x1018, subindex, 0).0 & 0xF0, 0x50, "{subindex}");
    }
    for (index, subindex) in [(0x1018, 2), (0x1018, 3), (0x1000, 0)] {
        assert_eq!(ask(&mut main_device, 0x50, index, subindex, 0), (ABORTED, NO_COMPLETE_ACCESS));
    }
}

const fn entry(index: u16) -> PdoEntry {
    PdoEntry { index, subindex: 1, bits: 8, data_type: DataType::Unsigned8, name: "Byte" }
}

const fn described(index: u16) -> Object {
    Object {
        index,
        name: "Described and mapped",
        code: ObjectCode::Array,
        entries: &[
            Entry {
                subindex: 0,
                name: "Highest subindex",
                data_type: DataType::Unsigned8,
                access: Access::ReadOnly,
                capacity: 1,
                default: &[1],
            },
            Entry {
                subindex: 1,
                name: "Byte",
                data_type: DataType::Unsigned8,
                access: Access::ReadOnly,
                capacity: 1,
                default: &[],
            },
        ],
    }
}

/// A device that describes the objects of its process data; 0x5000 is in both directions.
static MAPPED: Description = Description {
    outputs: &[Pdo { index: 0x1600, name: "Outputs", entries: &[entry(0x5000), entry(0x7000)] }],
    inputs: &[Pdo { index: 0x1A00, name: "Inputs", entries: &[entry(0x5000), entry(0x6000)] }],
    objects: &[described(0x5000), described(0x6000), described(0x7000)],
    ..SMART
};

#[test]
fn an_object_that_is_described_and_mapped_says_in_which_directions() {
    let mut main_device = RawMainDevice::start(of(&MAPPED));
    for (index, mappable) in [(0x5000_u16, 0xC0), (0x6000, 0x80), (0x7000, 0x40)] {
        let [low, high] = index.to_le_bytes();
        let entry = main_device.coe(8, &[5, 0, 0, 0, low, high, 1, 0]);
        assert_eq!((entry[2], entry[14] & 0xC0), (6, mappable), "{index:04X}");
    }
    for (list, indices) in [(2, [0x00, 0x50, 0x00, 0x70]), (3, [0x00, 0x50, 0x00, 0x60])] {
        assert_eq!(main_device.coe(8, &[1, 0, 0, 0, list, 0])[8..], indices, "list {list}");
    }
}
