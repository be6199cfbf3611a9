//! Process data that a MainDevice chooses: assignment and mapping, by ethercrab and by single datagrams.

use ethercat_maindevice::time;
use ethercat_subdevice::description::{DataType, Mailbox, Pdo, PdoEntry};
use ethercat_subdevice::{Description, DeviceConfig, DeviceId, PdoConfiguration, Segment};
use ethercrab::error::{CoeAbortCode, Error, MailboxError};

use crate::main_device::Stand;
use crate::raw_main_device::RawMainDevice;

const ID: DeviceId = DeviceId(0);

const READ_ONLY: u32 = 0x0601_0002;
const COUNT_NOT_ZERO: u32 = 0x0601_0003;
const NOT_MAPPABLE: u32 = 0x0604_0041;
const TOO_MUCH_TO_MAP: u32 = 0x0604_0042;
const TOO_LONG: u32 = 0x0607_0012;
const TOO_SHORT: u32 = 0x0607_0013;
const NO_SUBINDEX: u32 = 0x0609_0011;

const fn word(index: u16) -> PdoEntry {
    PdoEntry { index, subindex: 0, bits: 16, data_type: DataType::Unsigned16, name: "Word" }
}

const fn long(index: u16) -> PdoEntry {
    PdoEntry { index, subindex: 0, bits: 32, data_type: DataType::Unsigned32, name: "Long" }
}

/// Two objects in each direction.
static MODULAR: Description = Description {
    vendor_id: 0x0000_0F00,
    product_code: 0x0000_0009,
    revision: 0x0001_0000,
    order_code: "MODULAR",
    name: "Process data to choose",
    group: "Test devices",
    device_type: 0,
    hardware_version: "1",
    software_version: "1",
    outputs: &[
        Pdo { index: 0x1600, name: "Control", entries: &[word(0x7000), long(0x7001)] },
        Pdo { index: 0x1601, name: "More", entries: &[word(0x7002)] },
    ],
    inputs: &[
        Pdo { index: 0x1A00, name: "Status", entries: &[word(0x6000), long(0x6001)] },
        Pdo { index: 0x1A01, name: "More", entries: &[word(0x6002)] },
    ],
    mailbox: Some(Mailbox { len: 128, file_capacity: 0 }),
    objects: &[],
    optional_outputs: &[],
    optional_inputs: &[],
    clock_modes: &[],
    numbers_names: true,
};

fn segment(pdo_configuration: PdoConfiguration) -> Segment {
    let mut segment = Segment::new();
    segment.add(&DeviceConfig { pdo_configuration, ..DeviceConfig::new(&MODULAR) });
    segment
}

/// Writes up to four bytes; returns the abort code, 0 for none.
fn write(main_device: &mut RawMainDevice, index: u16, subindex: u8, data: &[u8]) -> u32 {
    let mut request = vec![0x23 | ((4 - data.len()) as u8) << 2];
    request.extend(index.to_le_bytes());
    request.push(subindex);
    request.extend(data);
    request.resize(8, 0);
    answered(&main_device.sdo(&request))
}

fn answered(answer: &[u8]) -> u32 {
    match answer[0] {
        0x80 => u32::from_le_bytes(answer[4..8].try_into().unwrap()),
        command => {
            assert!(command == 0x60 || command == 0x70, "{answer:02X?}");
            0
        }
    }
}

#[test]
fn a_main_device_assigns_some_objects_and_they_are_exchanged_in_its_order() {
    let mut segment = segment(PdoConfiguration::Assignable);
    let ended = Stand::new(&mut segment).run(async |main| {
        let group = main.init_single_group::<4, 64>(time::now_ns).await?;
        {
            let device = group.subdevice(main, 0)?;
            for (assignment, pdos) in [(0x1C12, &[0x1601_u16][..]), (0x1C13, &[0x1A01, 0x1A00])] {
                device.sdo_write(assignment, 0, 0_u8).await?;
                for (number, pdo) in (1..).zip(pdos) {
                    device.sdo_write(assignment, number, *pdo).await?;
                }
                device.sdo_write(assignment, 0, pdos.len() as u8).await?;
            }
        }
        let group = group.into_op(main).await?;
        let lens = {
            let device = group.subdevice(main, 0)?;
            [device.outputs_raw().len(), device.inputs_raw().len()]
        };
        Ok::<_, Error>(lens)
    });
    assert_eq!(ended.result, Some(Ok([2, 8])), "ended at {:?}", ended.at);
    // The device's owner has as many bytes, and SDOs show the entries where they are now.
    assert!(segment.set_inputs(ID, &[0; 2]).is_err());
    segment.set_inputs(ID, &[7, 0, 1, 0, 2, 0, 0, 0]).unwrap();
}

#[test]
fn what_is_chosen_shows_in_the_objects_and_the_rest_keeps_a_value_of_its_own() {
    let mut main_device = RawMainDevice::start(segment(PdoConfiguration::Assignable));
    for (index, subindex, data) in
        [(0x1C13, 0, &[0][..]), (0x1C13, 1, &[0x01, 0x1A]), (0x1C13, 0, &[1]), (0x1C12, 0, &[0])]
    {
        assert_eq!(write(&mut main_device, index, subindex, data), 0, "{index:04X}:{subindex}");
    }
    main_device.segment.set_inputs(ID, &[0x34, 0x12]).unwrap();
    let read = |main_device: &mut RawMainDevice, index: u16| {
        let [low, high] = index.to_le_bytes();
        u32::from_le_bytes(main_device.sdo(&[0x40, low, high, 0, 0, 0, 0, 0])[4..8].try_into().unwrap())
    };
    assert_eq!(read(&mut main_device, 0x6002), 0x1234);
    assert_eq!(read(&mut main_device, 0x6000), 0);
    // No output is assigned, so that all of them are written by SDO.
    assert_eq!(write(&mut main_device, 0x7000, 0, &[5, 0]), 0);
    assert_eq!(read(&mut main_device, 0x7000), 5);
}

/// Returns the access rights that the information service names.
fn access(main_device: &mut RawMainDevice, index: u16, subindex: u8) -> u16 {
    let [low, high] = index.to_le_bytes();
    let entry = main_device.coe(8, &[5, 0, 0, 0, low, high, subindex, 0]);
    assert_eq!(entry[2], 6, "{entry:02X?}");
    u16::from_le_bytes([entry[14], entry[15]])
}

#[test]
fn eeprom_and_information_service_say_what_the_main_device_may_choose() {
    for (configuration, details, assignment, mapping) in [
        (PdoConfiguration::Fixed, 0x23, 0x07, 0x07),
        (PdoConfiguration::Assignable, 0x27, 0x0F, 0x07),
        (PdoConfiguration::Mappable, 0x2F, 0x0F, 0x0F),
    ] {
        let mut segment = segment(configuration);
        let eeprom = segment.eeprom_mut(ID).unwrap();
        // The category behind the strings, which are the first one.
        let strings = usize::from(u16::from_le_bytes([eeprom[0x82], eeprom[0x83]])) * 2;
        let general = 0x84 + strings;
        assert_eq!(eeprom[general..general + 2], [30, 0]);
        assert_eq!(eeprom[general + 4 + 5], details, "{configuration:?}");
        let mut main_device = RawMainDevice::start(segment);
        for (index, expected) in
            [(0x1C12, assignment), (0x1C13, assignment), (0x1600, mapping), (0x1A01, mapping)]
        {
            for subindex in [0, 1] {
                assert_eq!(
                    access(&mut main_device, index, subindex),
                    expected,
                    "{configuration:?} 0x{index:04X}"
                );
            }
        }
        assert_eq!(access(&mut main_device, 0x1C00, 1), 0x07);
    }
}

#[test]
fn an_entry_that_is_not_mapped_now_is_still_one_that_can_be() {
    let mut main_device = RawMainDevice::start(segment(PdoConfiguration::Mappable));
    let lists = |main_device: &mut RawMainDevice| {
        [2, 3].map(|list| main_device.coe(8, &[1, 0, 0, 0, list, 0])[8..].to_vec())
    };
    let mapped = lists(&mut main_device);
    assert_eq!(mapped, [vec![0x00, 0x70, 0x01, 0x70, 0x02, 0x70], vec![0x00, 0x60, 0x01, 0x60, 0x02, 0x60]]);
    for index in [0x1C12, 0x1C13] {
        assert_eq!(write(&mut main_device, index, 0, &[0]), 0);
    }
    assert_eq!(lists(&mut main_device), mapped);
    assert_eq!((access(&mut main_device, 0x7001, 0), access(&mut main_device, 0x6001, 0)), (0x7F, 0x87));
}

#[test]
fn each_wrong_choice_has_its_abort_code_and_changes_nothing() {
    let mut main_device = RawMainDevice::start(segment(PdoConfiguration::Mappable));
    for (index, subindex, data, code) in [
        (0x1C12, 1, &[0x01, 0x16][..], COUNT_NOT_ZERO),
        (0x1600, 1, &[16, 0, 2, 0x70], COUNT_NOT_ZERO),
        (0x1C12, 0, &[3], TOO_MUCH_TO_MAP),
        (0x1C12, 0, &[1, 0], TOO_LONG),
        (0x1C12, 3, &[0x01, 0x16], NO_SUBINDEX),
        (0x1C12, 0, &[0], 0),
        (0x1C12, 1, &[0x01], TOO_SHORT),
        (0x1C12, 1, &[0x00, 0x1A], NOT_MAPPABLE),
        (0x1C12, 1, &[0x02, 0x16], NOT_MAPPABLE),
        (0x1C12, 1, &[0x01, 0x16], 0),
        (0x1C12, 2, &[0x01, 0x16], 0),
        (0x1C12, 0, &[2], NOT_MAPPABLE),
        (0x1C12, 0, &[1], 0),
        (0x1601, 0, &[0], 0),
        (0x1601, 1, &[16, 0, 0, 0x60], NOT_MAPPABLE),
        (0x1601, 1, &[8, 0, 2, 0x70], NOT_MAPPABLE),
        (0x1601, 1, &[0, 0, 0, 0], NOT_MAPPABLE),
        // A gap that is longer than all that is described.
        (0x1601, 1, &[255, 0, 0, 0], 0),
        (0x1601, 0, &[1], TOO_MUCH_TO_MAP),
        (0x1601, 1, &[32, 0, 1, 0x70], 0),
        (0x1601, 0, &[1], 0),
    ] {
        assert_eq!(
            write(&mut main_device, index, subindex, data),
            code,
            "{index:04X}:{subindex} {data:02X?}"
        );
    }
    assert_eq!(main_device.segment.object(ID, 0x1C12, 0), Some(&[1][..]));
    assert_eq!(main_device.segment.object(ID, 0x1601, 1), Some(&[32, 0, 1, 0x70][..]));
    // 0x7001 is process data now.
    assert_eq!(main_device.segment.object(ID, 0x7001, 0), None);
    assert_eq!(main_device.segment.object(ID, 0x7002, 0), Some(&[0, 0][..]));
}

#[test]
fn a_complete_access_writes_a_whole_assignment_or_nothing_of_it() {
    let mut main_device = RawMainDevice::start(segment(PdoConfiguration::Assignable));
    let complete = |data: &[u8]| {
        let mut request = vec![0x31, 0x13, 0x1C, 0];
        request.extend((data.len() as u32).to_le_bytes());
        request.extend(data);
        request
    };
    let assigned = |main_device: &RawMainDevice| {
        [0, 1, 2].map(|number| main_device.segment.object(ID, 0x1C13, number).unwrap().to_vec())
    };
    let before = assigned(&main_device);
    assert_eq!(answered(&main_device.sdo(&complete(&[2, 0, 0x01, 0x1A, 0x00, 0x16]))), NOT_MAPPABLE);
    assert_eq!(assigned(&main_device), before);
    assert_eq!(answered(&main_device.sdo(&complete(&[1, 0, 0x01, 0x1A]))), 0);
    assert_eq!(assigned(&main_device)[..2], [vec![1], vec![0x01, 0x1A]]);
    main_device.segment.set_inputs(ID, &[1, 2]).unwrap();
    let read = main_device.sdo(&[0x50, 0x13, 0x1C, 0, 0, 0, 0, 0]);
    assert_eq!(read[4..8], [1, 0, 0x01, 0x1A], "only what counts: {read:02X?}");
}

#[test]
fn process_data_that_are_fixed_or_run_are_not_chosen() {
    let mut fixed = RawMainDevice::start(segment(PdoConfiguration::Fixed));
    assert_eq!(write(&mut fixed, 0x1C12, 0, &[0]), READ_ONLY);
    assert_eq!(write(&mut fixed, 0x1600, 0, &[0]), READ_ONLY);
    let mut assignable = RawMainDevice::start(segment(PdoConfiguration::Assignable));
    assert_eq!(write(&mut assignable, 0x1600, 0, &[0]), READ_ONLY);
    let mut segment = segment(PdoConfiguration::Mappable);
    let ended = Stand::new(&mut segment).run(async |main| {
        let group = main.init_single_group::<4, 64>(time::now_ns).await?.into_safe_op(main).await?;
        let device = group.subdevice(main, 0)?;
        Ok::<_, Error>(device.sdo_write(0x1C12, 0, 0_u8).await)
    });
    let refused = ended.result.unwrap().unwrap();
    let code = CoeAbortCode::InvalidState;
    assert_eq!(refused, Err(Error::Mailbox(MailboxError::Aborted { code, address: 0x1C12, sub_index: 0 })));
}
