//! Objects 0x1C32 and 0x1C33: how outputs and inputs are synchronised.

use ethercat_subdevice::{DeviceConfig, Segment};
use machine::Duration;

use crate::devices::{BRIDGE, SENSOR, SMART};
use crate::raw_main_device::RawMainDevice;

/// Reads a value of up to four bytes; `Err` has the abort code.
fn read(main_device: &mut RawMainDevice, index: u16, subindex: u8) -> Result<u32, u32> {
    let [low, high] = index.to_le_bytes();
    let answer = main_device.sdo(&[0x40, low, high, subindex, 0, 0, 0, 0]);
    let value = u32::from_le_bytes(answer[4..8].try_into().unwrap());
    if answer[0] == 0x80 { Err(value) } else { Ok(value) }
}

/// Writes a word; returns the abort code, 0 for none.
fn write(main_device: &mut RawMainDevice, index: u16, subindex: u8, value: u16) -> u32 {
    let ([low, high], [a, b]) = (index.to_le_bytes(), value.to_le_bytes());
    let answer = main_device.sdo(&[0x2B, low, high, subindex, a, b, 0, 0]);
    if answer[0] == 0x80 { u32::from_le_bytes(answer[4..8].try_into().unwrap()) } else { 0 }
}

fn in_pre_op(description: &'static ethercat_subdevice::Description) -> RawMainDevice {
    let mut segment = Segment::new();
    segment.add(&DeviceConfig::new(description));
    let mailbox = description.mailbox.map_or(128, |mailbox| mailbox.len);
    RawMainDevice::start_with(segment, mailbox)
}

#[test]
fn a_device_with_a_clock_shows_how_its_data_are_synchronised_and_takes_the_types_that_it_has() {
    const RANGE: u32 = 0x0609_0030;
    let mut main_device = in_pre_op(&BRIDGE);
    for index in [0x1C32, 0x1C33] {
        assert_eq!(read(&mut main_device, index, 0), Ok(32));
        assert_eq!(read(&mut main_device, index, 1), Ok(1), "by its sync manager");
        assert_eq!(read(&mut main_device, index, 4), Ok(0b111), "types that it has");
        for subindex in [5, 6, 9, 11, 12, 32] {
            assert_eq!(read(&mut main_device, index, subindex), Ok(0));
        }
        assert!(read(&mut main_device, index, 7).is_err(), "reserved");
        for (value, code) in [(0, 0), (2, 0), (3, RANGE), (0x22, if index == 0x1C33 { 0 } else { RANGE })] {
            assert_eq!(write(&mut main_device, index, 1, value), code, "{index:04X}, {value}");
        }
    }
    assert_eq!(read(&mut main_device, 0x1C33, 1), Ok(0x22), "with the sync manager of the outputs");
}

#[test]
fn from_safe_op_on_they_are_synchronised_as_the_main_device_has_started_the_signals() {
    let mut main_device = in_pre_op(&BRIDGE);
    main_device.wait(Duration::from_millis(1));
    // The start in 10 ms, a cycle of 2 ms, SYNC0.
    main_device.write(0x0990, &11_000_000_u64.to_le_bytes());
    main_device.write(0x09A0, &2_000_000_u32.to_le_bytes());
    main_device.write(0x0980, &[0, 3]);
    main_device.operate();
    for index in [0x1C32, 0x1C33] {
        assert_eq!(read(&mut main_device, index, 1), Ok(2), "with SYNC0");
        assert_eq!([2, 10].map(|subindex| read(&mut main_device, index, subindex)), [Ok(2_000_000); 2]);
    }
    // Without signals, a choice of SYNC0 is not kept.
    main_device.request_state(2);
    main_device.write(0x0981, &[0]);
    main_device.request_state(4);
    assert_eq!(read(&mut main_device, 0x1C32, 1), Ok(1));
}

#[test]
fn a_device_without_a_clock_has_no_such_objects_and_one_without_outputs_those_of_its_inputs() {
    const NO_OBJECT: u32 = 0x0602_0000;
    let mut main_device = in_pre_op(&SENSOR);
    assert_eq!(read(&mut main_device, 0x1C33, 0), Err(NO_OBJECT));
    static WITH_CLOCK: ethercat_subdevice::Description =
        ethercat_subdevice::Description { outputs: &[], ..SMART };
    let mut main_device = in_pre_op(&WITH_CLOCK);
    assert_eq!(read(&mut main_device, 0x1C32, 0), Err(NO_OBJECT));
    assert_eq!(read(&mut main_device, 0x1C33, 0), Ok(32));
}

#[test]
fn a_subindex_that_the_object_leaves_out_is_described_as_one_without_a_type() {
    let mut main_device = in_pre_op(&BRIDGE);
    for (subindex, expected) in
        [(7, Some([0; 6])), (20, Some([0; 6])), (32, Some([1, 0, 8, 0, 7, 0])), (33, None)]
    {
        let answer = main_device.coe(8, &[5, 0, 0, 0, 0x32, 0x1C, subindex, 0]);
        let described = (answer[2] == 6).then(|| answer[10..16].try_into().unwrap());
        assert_eq!(described, expected, "{subindex}");
    }
}
