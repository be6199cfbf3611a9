//! Registers of the chip that no MainDevice needs for process data, but that tools and tests of MainDevices read and write
//! (ESC datasheet section II).

use ethercat_subdevice::{DeviceConfig, Event, LocalClock, Segment};
use machine::{Duration, Instant};

use crate::devices::{BRIDGE, SIMPLE};
use crate::raw_main_device::{APRD, APWR, BRD, BRW, BWR, FIRST, FPRW, FPWR, FRMW, RawMainDevice, frame};

/// A bridge with an address, in INIT.
fn bridge() -> RawMainDevice {
    let mut segment = Segment::new();
    segment.add(&DeviceConfig::new(&BRIDGE));
    let mut main_device = RawMainDevice::new(segment);
    main_device.exchange(APWR, 0, 0x0010, &FIRST.to_le_bytes());
    main_device
}

#[test]
fn the_chip_says_what_it_is_and_claims_no_feature_that_it_lacks() {
    let mut main_device = bridge();
    // An ET1100 with 8 FMMUs, 8 sync managers, 8 KiB, ports 0 and 1; clocks of 64 bits, not their enhanced activation; low jitter,
    // enhanced link detection and counters of FCS errors.
    assert_eq!(main_device.read(0x0000, 10).0, [0x11, 0, 2, 0, 8, 8, 8, 0x0F, 0xFC, 0x00]);
    assert_eq!(main_device.read(0x0984, 1).1, 0, "the status of an extended activation");
    assert_eq!(main_device.read(0x0204, 4).0, [0x0F, 0xFF, 0xFF, 0x00], "AL event mask");
    let mut segment = Segment::new();
    segment.add(&DeviceConfig::new(&SIMPLE));
    assert_eq!(RawMainDevice::new(segment).exchange(APRD, 0, 0x0008, &[0; 2]).0, [0xF0, 0]);
}

#[test]
fn a_watchdog_that_never_ran_and_a_sync_manager_that_is_off_show_their_reset_values() {
    let mut main_device = bridge();
    assert_eq!(main_device.read(0x0400, 2).0, 2_498_u16.to_le_bytes());
    assert_eq!(
        (main_device.read(0x0410, 2).0, main_device.read(0x0420, 2).0),
        (vec![0xE8, 3], vec![0xE8, 3])
    );
    assert_eq!(main_device.read(0x0440, 4).0, [0; 4], "not active");
    main_device.write(0x0420, &[0, 0]);
    assert_eq!(main_device.read(0x0440, 1).0, [1], "disabled");
    for index in 0..8 {
        assert_eq!(main_device.read(0x0805 + 8 * index, 1).0, [0x30], "no buffer is written");
    }
    // Three buffers of 4 bytes that the MainDevice writes.
    main_device.write(0x0838, &[0x00, 0x28, 4, 0, 0x64, 0, 1, 0]);
    main_device.write(0x2800, &[1, 2, 3, 4]);
    assert_eq!(main_device.read(0x083D, 1).0, [0x01]);
    main_device.write(0x083E, &[0]);
    assert_eq!(main_device.read(0x083D, 1).0, [0x30]);
    assert_eq!(main_device.read(0x0440, 1).0, [1], "it has triggered the watchdog");
}

#[test]
fn the_port_descriptor_names_every_port_that_has_a_cable() {
    for (port, descriptor) in [(1, 0x0F), (2, 0x3F), (3, 0xCF)] {
        let mut segment = Segment::new();
        let first = segment.add(&DeviceConfig::new(&SIMPLE));
        segment.add_at(&DeviceConfig::new(&SIMPLE), first, port).unwrap();
        segment.set_power(Instant::ZERO, first, false);
        segment.set_power(Instant::ZERO, first, true);
        let mut main_device = RawMainDevice::new(segment);
        assert_eq!(main_device.exchange(APRD, 0, 0x0007, &[0]).0, [descriptor]);
        assert_eq!(main_device.exchange(APRD, 0xFFFF, 0x0007, &[0]).0, [0x0F]);
    }
}

#[test]
fn reserved_bits_stay_0_and_what_the_device_owns_stays_as_it_is() {
    let mut main_device = bridge();
    for (register, mask) in [
        (0x0100, &[0x03, 0xFF, 0x0F, 0x01][..]),
        (0x0600, &[0xFF; 6]),
        (0x0606, &[0x07, 0x07, 0xFF, 0xFF, 0x07, 0x03, 0x01, 0, 0, 0]),
        (0x0800, &[0xFF; 5]),
        (0x0806, &[0xC3]),
        (0x0930, &[0xFF, 0x7F]),
        (0x0934, &[0x0F, 0x0F]),
        (0x0980, &[0x31]),
    ] {
        main_device.write(register, &vec![0xFF; mask.len()]);
        assert_eq!(main_device.read(register, mask.len()).0, mask, "0x{register:04X}");
        main_device.write(register, &vec![0; mask.len()]);
    }
    for (register, len) in [(0x0904, 12), (0x0914, 4), (0x030E, 2)] {
        let before = main_device.read(register, len).0;
        assert_eq!(main_device.write(register, &vec![0xAA; len]), 0, "0x{register:04X}");
        assert_eq!(main_device.read(register, len).0, before);
    }
}

#[test]
fn a_write_to_one_error_counter_clears_its_own_group_alone() {
    let mut segment = Segment::new();
    segment.add(&DeviceConfig::new(&SIMPLE));
    let second = segment.add(&DeviceConfig::new(&SIMPLE));
    let mut main_device = RawMainDevice::new(segment);
    main_device.exchange(APWR, 0, 0x0010, &FIRST.to_le_bytes());
    let lose_link = |main_device: &mut RawMainDevice| {
        main_device.segment.set_cut(second, true);
        main_device.segment.set_cut(second, false);
    };
    lose_link(&mut main_device);
    assert_eq!(main_device.read(0x0310, 4).0, [0, 1, 0, 0]);
    // The errors of received frames, and those of the processing unit and the PDI.
    for register in [0x0300, 0x0307, 0x030B, 0x030C, 0x030D] {
        assert_eq!(main_device.write(register, &[0]), 1);
    }
    assert_eq!(main_device.read(0x0310, 4).0, [0, 1, 0, 0], "links that were lost are another group");
    assert_eq!(main_device.write(0x0310, &[0xFF]), 1);
    assert_eq!(main_device.read(0x0310, 4).0, [0; 4]);
    // A loop that the MainDevice holds open or closed loses no link.
    for control in [0x08, 0x0C] {
        main_device.write(0x0101, &[control]);
        lose_link(&mut main_device);
        assert_eq!(main_device.read(0x0310, 4).0, [0; 4], "{control}");
    }
}

#[test]
fn a_reset_shows_its_progress_and_needs_three_frames_one_after_another() {
    let mut main_device = bridge();
    let progress = |main_device: &mut RawMainDevice, letters: &[u8]| {
        for letter in letters {
            main_device.write(0x0040, &[*letter]);
        }
        main_device.exchange(APRD, 0, 0x0040, &[0]).0[0]
    };
    assert_eq!(progress(&mut main_device, b"R"), 1);
    assert_eq!(progress(&mut main_device, b"RE"), 2);
    // The frame that read has interrupted it, and so does another letter.
    assert_eq!(progress(&mut main_device, b"S"), 0);
    assert_eq!(progress(&mut main_device, b"RXES"), 0);
    assert_eq!(progress(&mut main_device, b"ES"), 0);
    assert_eq!(main_device.read(0x0010, 2).0, FIRST.to_le_bytes(), "no reset so far");
    main_device.write(0x0040, b"R");
    main_device.write(0x0040, b"E");
    main_device.read(0x0130, 2);
    main_device.write(0x0040, b"S");
    assert_eq!(main_device.read(0x0010, 2).0, FIRST.to_le_bytes());
    assert_eq!(progress(&mut main_device, b"RES"), 0);
    assert_eq!(main_device.exchange(APRD, 0, 0x0010, &[0; 2]).0, [0, 0]);
}

#[test]
fn commands_that_read_and_write_do_so_at_two_addresses_if_the_offset_says_so() {
    for (command, position) in [(3, 0), (FPRW, FIRST), (BRW, 0)] {
        let mut main_device = bridge();
        main_device.write(0x0F80, &[1, 2]);
        main_device.write(0x0108, &[0x10, 0x00]);
        assert_eq!(main_device.exchange(command, position, 0x0F80, &[0, 0]), (vec![1, 2], 3));
        assert_eq!(main_device.read(0x0F80, 2).0, [1, 2], "read");
        main_device.exchange(command, position, 0x0F80, &[7, 8]);
        assert_eq!(main_device.read(0x0F90, 2).0, [7, 8], "written by {command}");
        // Other commands know no offset.
        main_device.exchange(FPWR, FIRST, 0x0F80, &[5]);
        assert_eq!(main_device.read(0x0F80, 2).0, [5, 2]);
    }
}

fn time(main_device: &mut RawMainDevice, register: u16) -> u64 {
    u64::from_le_bytes(main_device.read(register, 8).0.try_into().unwrap())
}

#[test]
fn receive_times_are_latched_by_bwr_and_fpwr_and_that_of_the_processing_unit_by_every_write() {
    let mut main_device = bridge();
    main_device.wait(Duration::from_micros(5));
    let port_0 = |main_device: &mut RawMainDevice| time(main_device, 0x0900) as u32;
    for (command, position, latches_ports) in
        [(BWR, 0, true), (FPWR, FIRST, true), (APWR, 0, false), (FPRW, FIRST, false), (BRD, 0, false)]
    {
        let before = port_0(&mut main_device);
        let unit_before = time(&mut main_device, 0x0918);
        main_device.wait(Duration::from_micros(5));
        let now = main_device.now.as_nanos();
        assert!(main_device.exchange(command, position, 0x0900, &[0xFF; 4]).1 > 0);
        let expected = if latches_ports { now as u32 } else { before };
        assert_eq!(port_0(&mut main_device), expected, "command {command}");
        let expected = if command == BRD { unit_before } else { now };
        assert_eq!(time(&mut main_device, 0x0918), expected, "command {command}");
    }
    // The other bytes latch nothing.
    let before = port_0(&mut main_device);
    main_device.wait(Duration::from_micros(5));
    assert_eq!(main_device.exchange(BWR, 0, 0x0901, &[0; 3]).1, 0);
    assert_eq!(port_0(&mut main_device), before);
}

/// Returns the difference to the system time at 0x092C, and whether bit 31 is set.
fn difference(main_device: &mut RawMainDevice) -> (u32, bool) {
    let (bytes, _) = main_device.read(0x092C, 4);
    let value = u32::from_le_bytes(bytes.try_into().unwrap());
    (value & 0x7FFF_FFFF, value >> 31 != 0)
}

#[test]
fn bit_31_of_the_difference_says_that_the_local_copy_is_not_behind() {
    for (received, expected) in [(4_000, (1_000, true)), (6_000, (1_000, false)), (5_000, (0, true))] {
        let mut segment = Segment::new();
        segment.add(&DeviceConfig {
            clock: LocalClock { start_ns: 5_000, error_ppb: 0 },
            ..DeviceConfig::new(&BRIDGE)
        });
        let mut main_device = RawMainDevice::new(segment);
        main_device.exchange(APWR, 0, 0x0010, &FIRST.to_le_bytes());
        // No filter.
        main_device.write(0x0934, &[0]);
        assert_eq!(difference(&mut main_device), (0, false), "nothing was received yet");
        assert_eq!(main_device.exchange(FRMW, 0x5555, 0x0910, &u64::to_le_bytes(received)).1, 1);
        assert_eq!(difference(&mut main_device), expected, "{received}");
        main_device.write(0x0911, &[0xFF]);
        assert_eq!(difference(&mut main_device), expected, "not the first byte");
        main_device.write(0x0930, &[0x00, 0x10]);
        assert_eq!(difference(&mut main_device), (0, false));
    }
}

/// Returns the SYNC signals so far, with their times in microseconds.
fn signals(main_device: &mut RawMainDevice) -> Vec<(u8, u64)> {
    let signals = main_device.events.drain(..).filter_map(|(_, event)| match event {
        Event::Sync0 { system_time_ns } => Some((0, system_time_ns / 1_000)),
        Event::Sync1 { system_time_ns } => Some((1, system_time_ns / 1_000)),
        _ => None,
    });
    signals.collect()
}

#[test]
fn sync_signals_start_when_bit_0_becomes_1_and_each_can_be_switched_off_and_on_beside_the_other() {
    let mut main_device = bridge();
    let wait_until = |main_device: &mut RawMainDevice, micros: u64| {
        let left = micros * 1_000 - main_device.now.as_nanos();
        main_device.wait(Duration::from_nanos(left));
    };
    main_device.write(0x0990, &1_000_000_u64.to_le_bytes());
    main_device.write(0x09A0, &1_000_000_u32.to_le_bytes());
    main_device.write(0x0981, &[0x03]);
    wait_until(&mut main_device, 2_500);
    // Written once more, the register changes nothing, though the start has passed by now.
    assert_eq!(main_device.write(0x0981, &[0x03]), 1);
    main_device.write(0x09A0, &500_000_u32.to_le_bytes());
    wait_until(&mut main_device, 3_500);
    assert_eq!(signals(&mut main_device), [(0, 1_000), (0, 2_000), (0, 3_000)]);
    main_device.write(0x0981, &[0x05]);
    wait_until(&mut main_device, 5_500);
    assert_eq!(signals(&mut main_device), [(1, 4_000), (1, 5_000)]);
    main_device.write(0x0981, &[0x07]);
    wait_until(&mut main_device, 6_500);
    assert_eq!(signals(&mut main_device), [(0, 6_000), (1, 6_000)]);
    // Off and on again: the new cycle counts, and the start has passed.
    main_device.write(0x0981, &[0x06]);
    main_device.write(0x0981, &[0x07]);
    wait_until(&mut main_device, 10_500);
    assert_eq!(signals(&mut main_device), []);
    main_device.write(0x0981, &[0x00]);
    main_device.write(0x0990, &11_000_000_u64.to_le_bytes());
    main_device.write(0x0981, &[0x03]);
    wait_until(&mut main_device, 12_200);
    assert_eq!(signals(&mut main_device), [(0, 11_000), (0, 11_500), (0, 12_000)]);
}

#[test]
fn sync_signals_that_belong_to_the_device_itself_are_not_the_maindevices() {
    let mut main_device = bridge();
    main_device.write(0x0990, &1_000_000_u64.to_le_bytes());
    main_device.write(0x0980, &[0x01]);
    for (register, len) in [(0x0981, 1), (0x0990, 8), (0x09A0, 8)] {
        assert_eq!(main_device.write(register, &vec![0x07; len]), 0, "0x{register:04X}");
    }
    main_device.wait(Duration::from_millis(5));
    assert_eq!(signals(&mut main_device), []);
    main_device.write(0x0980, &[0x00]);
    assert_eq!(main_device.read(0x0990, 8).0, 1_000_000_u64.to_le_bytes());
}

/// Returns the status of each of the first four sync managers.
fn buffers(main_device: &mut RawMainDevice) -> [u8; 4] {
    [0x0805, 0x080D, 0x0815, 0x081D].map(|register| main_device.read(register, 1).0[0])
}

/// Bits 0 and 1: written, read since the other; bit 3: mailbox full; bits 4 and 5: buffer that was written last, 3 for none.
#[test]
fn the_status_of_a_sync_manager_says_which_side_was_there_last() {
    let mut segment = Segment::new();
    let id = segment.add(&DeviceConfig::new(&BRIDGE));
    let mut main_device = RawMainDevice::start(segment);
    assert_eq!(buffers(&mut main_device), [0x00, 0x00, 0x30, 0x30]);
    let delay = Duration::from_millis(1);
    main_device.segment.set_answer_delay(id, delay);
    for _ in 0..2 {
        main_device.post(3, &[0, 0x20, 0x40, 0, 0x10, 0, 0, 0, 0, 0]);
        assert_eq!(buffers(&mut main_device)[0], 0x09, "full");
        main_device.wait(delay);
        assert_eq!(buffers(&mut main_device)[..2], [0x02, 0x09], "taken, and answered");
        main_device.fetch().unwrap();
        assert_eq!(buffers(&mut main_device)[..2], [0x02, 0x02]);
    }
    main_device.segment.set_answer_delay(id, Duration::ZERO);
    main_device.operate();
    main_device.request_state(4);
    assert_eq!(buffers(&mut main_device)[2..], [0x30, 0x21], "inputs at the way to SAFE-OP, to OP and back");
    for written in [0x01, 0x11, 0x21, 0x01] {
        main_device.write(0x1100, &[1; 256]);
        assert_eq!(buffers(&mut main_device)[2], written, "nobody takes outputs in SAFE-OP");
    }
    main_device.request_state(8);
    for taken in [0x12, 0x22, 0x02] {
        main_device.write(0x1100, &[1; 256]);
        assert_eq!(buffers(&mut main_device)[2], taken);
    }
    // The way to OP has passed the inputs once more.
    assert_eq!(buffers(&mut main_device)[3], 0x01);
    for (written, read) in [(0x11, 0x12), (0x21, 0x22), (0x01, 0x02)] {
        main_device.segment.set_inputs(id, &[1; 256]).unwrap();
        assert_eq!(buffers(&mut main_device)[3], written);
        for _ in 0..2 {
            main_device.read(0x1400, 256);
            assert_eq!(buffers(&mut main_device)[3], read, "however often it is read");
        }
    }
    for written in [0x11, 0x21] {
        main_device.segment.set_inputs(id, &[1; 256]).unwrap();
        assert_eq!(buffers(&mut main_device)[3], written, "written once more before it is read");
    }
}

/// Returns the event requests of a device, as its datagrams carry them.
fn events(main_device: &mut RawMainDevice) -> u16 {
    let reply = main_device.send(&frame(BRD, 0, &[0])).unwrap();
    u16::from_le_bytes([reply[24], reply[25]])
}

#[test]
fn a_change_of_al_status_and_one_of_dl_status_are_requested_until_each_is_read() {
    const DL: u16 = 0x0004;
    const AL: u16 = 0x0008;
    let mut segment = Segment::new();
    segment.add(&DeviceConfig::new(&SIMPLE));
    let second = segment.add(&DeviceConfig::new(&SIMPLE));
    let mut main_device = RawMainDevice::new(segment);
    main_device.exchange(APWR, 0, 0x0010, &FIRST.to_le_bytes());
    main_device.write(0x0200, &[0x0C, 0]);
    main_device.read(0x0110, 2);
    main_device.read(0x0130, 2);
    assert_eq!(events(&mut main_device), 0);
    main_device.segment.set_cut(second, true);
    main_device.request_state(2);
    assert_eq!(events(&mut main_device), AL | DL);
    // Registers before and behind them are no answer to the request.
    for (register, len) in [(0x012E, 2), (0x0132, 6), (0x010E, 2), (0x0112, 2)] {
        main_device.read(register, len);
    }
    assert_eq!(events(&mut main_device), AL | DL);
    main_device.read(0x0130, 2);
    assert_eq!(events(&mut main_device), DL);
    main_device.request_state(1);
    assert_eq!(events(&mut main_device), AL | DL);
    main_device.read(0x0110, 2);
    assert_eq!(events(&mut main_device), AL);
    main_device.read(0x0130, 2);
    assert_eq!(events(&mut main_device), 0);
}

#[test]
fn process_data_request_no_event() {
    let mut main_device = bridge();
    main_device.write(0x0800, &[0x00, 0x10, 128, 0, 0x26, 0, 1, 0]);
    main_device.write(0x0808, &[0x80, 0x10, 128, 0, 0x22, 0, 1, 0]);
    main_device.request_state(2);
    main_device.operate();
    main_device.write(0x1100, &[1; 256]);
    main_device.write(0x0200, &[0xFF, 0xFF]);
    main_device.read(0x0110, 2);
    main_device.read(0x0130, 2);
    assert_eq!(events(&mut main_device), 0, "only mailboxes have a bit");
}
