//! What each command reads, writes and counts at three devices, by single datagrams.

use ethercat_subdevice::{DeviceConfig, Segment};

use crate::devices::{BRIDGE, SIMPLE};
use crate::raw_main_device::{
    APRD, APWR, ARMW, BRD, BRW, BWR, FIRST, FPRD, FPRW, FPWR, FRMW, LRD, LRW, LWR, RawMainDevice, frame,
};

/// User RAM, which every device has and nothing else uses.
const RAM: u16 = 0x0F80;

fn three() -> RawMainDevice {
    let mut segment = Segment::new();
    for _ in 0..3 {
        segment.add(&DeviceConfig { alias: 0x77, ..DeviceConfig::new(&SIMPLE) });
    }
    let mut main_device = RawMainDevice::new(segment);
    for position in 0..3_u16 {
        let address = (FIRST + position).to_le_bytes();
        assert_eq!(main_device.exchange(APWR, 0_u16.wrapping_sub(position), 0x0010, &address).1, 1);
        assert_eq!(main_device.exchange(FPWR, FIRST + position, RAM, &[1 << position]).1, 1);
    }
    main_device
}

/// Returns the byte in each device's RAM.
fn ram(main_device: &mut RawMainDevice) -> [u8; 3] {
    core::array::from_fn(|position| main_device.exchange(FPRD, FIRST + position as u16, RAM, &[0]).0[0])
}

#[test]
fn each_physical_command_reads_writes_and_counts_as_the_standard_says() {
    let second = FIRST + 1;
    // Command, position, incoming, then outgoing, working counter and what the three have afterwards.
    for (command, position, out, count, after) in [
        (APRD, 0xFFFF, 2, 1, [1, 2, 4]),
        (APWR, 0xFFFF, 0x80, 1, [1, 0x80, 4]),
        (3, 0xFFFF, 2, 3, [1, 0x80, 4]),
        (FPRD, second, 2, 1, [1, 2, 4]),
        (FPWR, second, 0x80, 1, [1, 0x80, 4]),
        (FPRW, second, 2, 3, [1, 0x80, 4]),
        (FPRD, 0x5555, 0x80, 0, [1, 2, 4]),
        (BRD, 0, 0x87, 3, [1, 2, 4]),
        (BWR, 0, 0x80, 3, [0x80; 3]),
        // Each device writes what reached it, which contains the memory of those before.
        (BRW, 0, 0x87, 9, [0x80, 0x81, 0x83]),
        // The first device writes what came, the second reads, the third writes what the second has.
        (ARMW, 0xFFFF, 2, 3, [0x80, 2, 2]),
        (FRMW, second, 2, 3, [0x80, 2, 2]),
        (0, 0, 0x80, 0, [1, 2, 4]),
        (15, 0, 0x80, 0, [1, 2, 4]),
    ] {
        let mut main_device = three();
        let (data, counted) = main_device.exchange(command, position, RAM, &[0x80]);
        assert_eq!((data[0], counted, ram(&mut main_device)), (out, count, after), "command {command}");
    }
}

#[test]
fn positions_and_broadcasts_are_counted_up_and_station_addresses_stay() {
    let mut main_device = three();
    for (command, before, after) in [
        (APRD, 0xFFFF, 2),
        (BRD, 0, 3),
        (BWR, 7, 10),
        (FPRD, FIRST, FIRST),
        (FRMW, FIRST, FIRST),
        (ARMW, 0, 3),
    ] {
        let address = u32::from(before) | u32::from(RAM) << 16;
        let (address, ..) = main_device.exchange_at(command, address, &[0]).unwrap();
        assert_eq!(address as u16, after, "command {command}");
    }
}

#[test]
fn the_alias_addresses_a_device_once_it_is_enabled() {
    let mut main_device = three();
    assert_eq!(main_device.exchange(FPRD, 0x77, RAM, &[0]).1, 0);
    main_device.exchange(FPWR, FIRST + 2, 0x0103, &[1]);
    assert_eq!(main_device.exchange(FPRD, 0x77, RAM, &[0]), (vec![4], 1));
}

#[test]
fn registers_that_do_not_exist_or_cannot_be_written_do_not_count() {
    let mut main_device = three();
    // No clock; the AL status is the device's own; address past the RAM.
    for (command, offset, counted) in [
        (BRD, 0x0910, 0),
        (BWR, 0x0900, 0),
        (BWR, 0x0130, 0),
        (BRD, 0x0130, 3),
        (BRD, 0xF000, 0),
        (BRD, 0x1F00, 3),
    ] {
        assert_eq!(main_device.exchange(command, 0, offset, &[0; 2]).1, counted, "0x{offset:04X}");
    }
    // One byte is enough.
    assert_eq!(main_device.exchange(BRD, 0, 0x000F, &[0; 4]).1, 3);
}

/// Maps `len` bytes at a logical address to the RAM of a device, by its FMMU `index`.
fn map(main_device: &mut RawMainDevice, device: u16, index: u16, logical: u32, len: u16, directions: u8) {
    let mut fmmu = logical.to_le_bytes().to_vec();
    fmmu.extend(len.to_le_bytes());
    fmmu.extend([0, 7, 0x80, 0x0F, 0, directions, 1, 0, 0, 0]);
    assert_eq!(main_device.exchange(FPWR, FIRST + device, 0x0600 + 16 * index, &fmmu).1, 1);
}

#[test]
fn logical_commands_count_one_to_read_and_write_and_two_to_write_in_both() {
    for (command, out, count, after) in [
        (LRD, [0xAA, 2, 4], 2, [1, 2, 4]),
        (LWR, [0xAA, 0xBB, 0xCC], 2, [0xAA, 2, 0xCC]),
        (LRW, [0xAA, 2, 4], 6, [0xAA, 2, 0xCC]),
    ] {
        let mut main_device = three();
        map(&mut main_device, 0, 0, 0x0001_0000, 1, 2);
        map(&mut main_device, 1, 0, 0x0001_0001, 1, 1);
        map(&mut main_device, 2, 3, 0x0001_0002, 1, 3);
        let (_, data, counted) = main_device.exchange_at(command, 0x0001_0000, &[0xAA, 0xBB, 0xCC]).unwrap();
        assert_eq!(
            (&data[..], counted, ram(&mut main_device)),
            (&out[..], count, after),
            "command {command}"
        );
        assert_eq!(main_device.exchange_at(command, 0x0002_0000, &[0; 3]).unwrap().2, 0);
    }
}

#[test]
fn two_fmmus_of_one_device_count_once() {
    let mut main_device = three();
    map(&mut main_device, 0, 0, 0x100, 1, 1);
    map(&mut main_device, 0, 1, 0x101, 1, 1);
    assert_eq!(main_device.exchange_at(LRD, 0x100, &[0; 2]).unwrap(), (0x100, vec![1, 1], 1));
}

#[test]
fn bits_are_read_beside_those_of_others_and_written_with_zeros_beside_them() {
    let mut main_device = three();
    // Logical bits 6..10 to bits 1..5 of the RAM, both directions.
    let fmmu = [0, 0, 0, 0, 2, 0, 6, 1, 0x80, 0x0F, 1, 3, 1, 0, 0, 0];
    main_device.exchange(FPWR, FIRST, 0x0600, &fmmu);
    main_device.exchange(FPWR, FIRST, RAM, &[0b1000_0001]);
    let (_, data, counted) = main_device.exchange_at(LRW, 0, &[0b1111_1111, 0b0000_0001]).unwrap();
    assert_eq!((data, counted), (vec![0b0011_1111, 0b0000_0000], 3));
    assert_eq!(ram(&mut main_device)[0], 0b0000_1110);
}

#[test]
fn bits_that_cannot_be_read_stay_as_they_are_in_the_datagram() {
    let mut main_device = three();
    // Twelve bits each: from the chip's type on, and from 0x0133 on, a byte without register.
    for (index, logical, physical) in [(0, 0_u8, 0_u8), (1, 2, 0x33)] {
        let fmmu = [logical, 1, 0, 0, 2, 0, 0, 3, physical, u8::from(physical > 0), 0, 1, 1, 0, 0, 0];
        assert_eq!(main_device.exchange(FPWR, FIRST, 0x0600 + 16 * index, &fmmu).1, 1);
    }
    for unread in [0, 0xA5] {
        let (_, data, counted) = main_device.exchange_at(LRD, 0x100, &[0, 0, unread, 0]).unwrap();
        assert_eq!((data[0], data[2], data[3], counted), (0x11, unread, 0, 1));
    }
}

#[test]
fn a_configured_sync_manager_cannot_be_changed_until_it_is_switched_off() {
    let mut main_device = three();
    main_device.write(0x0800, &[0x00, 0x10, 4, 0, 0x64, 0, 1, 0]);
    main_device.write(0x0800, &[0x00, 0x20, 9, 0, 0x26]);
    assert_eq!(main_device.read(0x0800, 5).0, [0x00, 0x10, 4, 0, 0x64]);
    main_device.write(0x0806, &[0]);
    main_device.write(0x0800, &[0x00, 0x20, 9, 0, 0x26]);
    assert_eq!(main_device.read(0x0800, 5).0, [0x00, 0x20, 9, 0, 0x26]);
}

#[test]
fn each_sync_manager_is_locked_by_its_own_activation() {
    let mut main_device = three();
    for index in 0..8 {
        let register = 0x0800 + 8 * index;
        let start = 0x20 + index as u8;
        main_device.write(register, &[0x00, start, 4, 0, 0x64, 0, 1, 0]);
        main_device.write(register, &[0x00, 0x1F]);
        assert_eq!(main_device.read(register, 2).0, [0x00, start], "{index}");
    }
    for index in 0..8 {
        let register = 0x0800 + 8 * index;
        main_device.write(register + 6, &[0]);
        main_device.write(register, &[0x00, 0x1F]);
        assert_eq!(main_device.read(register, 2).0, [0x00, 0x1F], "{index}");
    }
}

#[test]
fn an_access_longer_than_a_buffer_is_one_to_the_buffer_and_others_to_what_is_beside_it() {
    let mut main_device = three();
    main_device.write(0x0838, &[0x00, 0x28, 4, 0, 0x64, 0, 1, 0]);
    assert_eq!(main_device.write(0x2800, &[1; 20]), 1);
    assert_eq!(main_device.read(0x083D, 1).0, [0x01], "the first buffer was written to its end");
    // Of the three buffers, which are the chip's, nothing was written; behind them all was.
    assert_eq!(main_device.read(0x280C, 8), (vec![1; 8], 1));
    assert_eq!(main_device.write(0x27FC, &[2; 8]), 1);
    assert_eq!(main_device.read(0x083D, 1).0, [0x11], "an access that begins before it");
    assert_eq!(main_device.read(0x27FC, 4), (vec![2; 4], 1));
    // From within the buffer, which is not open: the memory before it alone.
    assert_eq!(main_device.write(0x27FC, &[3; 6]), 1);
    assert_eq!(main_device.write(0x27FC, &[4; 4]), 1);
    assert_eq!(main_device.read(0x083D, 1).0, [0x11], "half of it is no buffer");
}

#[test]
fn a_buffer_is_opened_by_its_first_byte_and_handed_over_by_its_last() {
    let mut segment = Segment::new();
    segment.add(&DeviceConfig::new(&BRIDGE));
    let mut main_device = RawMainDevice::start(segment);
    // A free sync manager: three buffers of 4 bytes, written by the MainDevice.
    main_device.write(0x0838, &[0x00, 0x28, 4, 0, 0x64, 0, 1, 0]);
    assert_eq!(main_device.write(0x2801, &[1]), 0, "not opened");
    assert_eq!(main_device.write(0x2800, &[1, 2]), 1);
    assert_eq!(main_device.read(0x083D, 1).0, [0x30], "no buffer is written yet");
    assert_eq!(main_device.write(0x2802, &[3, 4]), 1);
    assert_eq!(main_device.read(0x083D, 1).0, [0x01], "the first buffer is written");
    assert_eq!(main_device.write(0x2802, &[3, 4]), 0, "handed over");
    assert_eq!(main_device.read(0x2800, 4).1, 0, "the MainDevice writes this one");
    assert_eq!(main_device.write(0x2804, &[9; 8]), 0, "the other buffers are the chip's");
    assert_eq!(main_device.write(0x280C, &[9]), 1, "behind them is free memory");
}

/// Returns a frame with two datagrams for the first device.
fn two_in_one(commands: [u8; 2], offset: u16, data: &[u8]) -> Vec<u8> {
    let mut both = frame(0, 0, &[]);
    both.truncate(14);
    let len = 2 * (12 + data.len()) as u16;
    both.extend((0x1000 | len).to_le_bytes());
    for (command, more) in commands.into_iter().zip([1, 0]) {
        both.extend([command, 0]);
        both.extend(FIRST.to_le_bytes());
        both.extend(offset.to_le_bytes());
        both.extend((data.len() as u16 | more << 15).to_le_bytes());
        both.extend([0, 0]);
        both.extend(data);
        both.extend([0, 0]);
    }
    both.resize(60, 0);
    both
}

#[test]
fn the_last_byte_of_a_buffer_is_accessed_once_in_a_frame() {
    let mut main_device = three();
    main_device.write(0x0838, &[0x00, 0x28, 2, 0, 0x64, 0, 1, 0]);
    let reply = main_device.send(&two_in_one([FPWR, FPWR], 0x2800, &[1, 2])).unwrap();
    assert_eq!((reply[28], reply[42]), (1, 0));
    assert_eq!(main_device.read(0x083D, 1).0, [0x01]);
    assert_eq!(main_device.write(0x2800, &[3, 4]), 1, "in the next frame");
}

#[test]
fn a_register_keeps_its_value_until_the_frame_has_passed() {
    let mut main_device = three();
    // 0x0108 is free for both sides.
    let reply = main_device.send(&two_in_one([FPWR, FPRD], 0x0108, &[7])).unwrap();
    assert_eq!((reply[26..29].to_vec(), reply[39..42].to_vec()), (vec![7, 1, 0], vec![0, 1, 0]));
    assert_eq!(main_device.read(0x0108, 1).0, [7]);
}

#[test]
fn a_sync_manager_of_one_byte_lets_every_access_pass() {
    let mut main_device = three();
    main_device.write(0x0838, &[0x00, 0x28, 1, 0, 0x64, 0, 1, 0]);
    assert_eq!(main_device.write(0x2800, &[5]), 1);
    assert_eq!(main_device.read(0x083D, 1).0, [0x01], "it is handed over as others are");
    assert_eq!(main_device.read(0x2800, 1), (vec![5], 1));
    assert_eq!(main_device.write(0x2801, &[6, 7]), 1, "there are no further buffers");
}

#[test]
fn a_buffer_can_be_read_once_the_device_has_written_it() {
    let mut main_device = three();
    main_device.write(0x0838, &[0x00, 0x28, 4, 0, 0x20, 0, 1, 0]);
    assert_eq!(main_device.read(0x2800, 4).1, 0);
}

#[test]
fn a_full_mailbox_shows_as_a_bit_of_the_process_image_and_in_the_event_requests() {
    let mut segment = Segment::new();
    segment.add(&DeviceConfig::new(&BRIDGE));
    let mut main_device = RawMainDevice::start(segment);
    // Bit 3 of the status of sync manager 1 to logical bit 5.
    main_device.write(0x0620, &[0, 0, 0, 0, 1, 0, 5, 5, 0x0D, 0x08, 3, 1, 1, 0, 0, 0]);
    main_device.write(0x0200, &[0xFF, 0x0F]);
    let (_, empty, _) = main_device.exchange_at(LRD, 0, &[0]).unwrap();
    main_device.post(3, &[0, 0x20, 0x40, 0, 0x10, 0, 0, 0, 0, 0]);
    let (_, full, counted) = main_device.exchange_at(LRD, 0, &[0]).unwrap();
    assert_eq!((empty[0], full[0], counted), (0, 0b0010_0000, 1));
    let reply = main_device.send(&frame(BRD, 0, &[0])).unwrap();
    assert_eq!(reply[24] & 0b0010_0000, 0b0010_0000, "sync manager 1 in the event requests");
    main_device.fetch().unwrap();
    assert_eq!(main_device.send(&frame(BRD, 0, &[0])).unwrap()[24] & 0b0010_0000, 0);
}

#[test]
fn a_tagged_frame_is_processed_and_keeps_its_tag_and_other_protocols_are_dropped() {
    let mut main_device = three();
    let mut tagged = frame(BRD, 0, &[0]);
    tagged.splice(12..12, [0x81, 0x00, 0xC0, 0x00]);
    let reply = main_device.send(&tagged).unwrap();
    assert_eq!((&reply[12..16], &reply[31..33]), (&[0x81, 0x00, 0xC0, 0x00][..], &[3, 0][..]));
    assert_eq!(reply[6], tagged[6] | 0x02, "the source is marked");
    let mut foreign = frame(BRD, 0, &[0]);
    foreign[13] = 0x92;
    assert_eq!(main_device.send(&foreign), None);
    let mut mailbox_gateway = frame(BRD, 0, &[0]);
    mailbox_gateway[15] = 0x50;
    assert_eq!(main_device.send(&mailbox_gateway), None);
    assert_eq!(main_device.segment.counters().foreign, 2);
}
