//! The EEPROM: its bytes, as ethercrab reads and writes them, and what the chip does with them.

use ethercat_maindevice::time;
use ethercat_subdevice::{DeviceConfig, DeviceId, Segment, sii_image};
use ethercrab::error::Error;
use machine::Duration;

use crate::devices::{BRIDGE, PLAIN, SENSOR, SIMPLE, SMART, TERMINAL};
use crate::main_device::Stand;
use crate::raw_main_device::{APRD, APWR, FIRST, RawMainDevice};

fn single_device(config: &DeviceConfig) -> Segment {
    let mut segment = Segment::new();
    segment.add(config);
    segment
}

#[test]
fn an_alias_that_ethercrab_writes_with_its_checksum_counts_after_power_on() {
    let mut segment = single_device(&DeviceConfig { alias: 5, ..DeviceConfig::new(&BRIDGE) });
    let ended = Stand::new(&mut segment).run(async |main| {
        let mut group = main.init_single_group::<4, 512>(time::now_ns).await?;
        let mut device = group.iter_mut(main).next().ok_or(Error::UnknownSubDevice)?;
        let before = device.alias_address();
        device.set_alias_address(0x0777).await?;
        let description = device.description().await?.map(|words| words.as_str().to_owned());
        Ok::<_, Error>((before, description, device.eeprom_size(main).await?))
    });
    let size = sii_image(&BRIDGE, 0, 5).len();
    assert_eq!(ended.result, Some(Ok((5, Some(BRIDGE.name.to_owned()), size))));
    let mut main_device = RawMainDevice::new(segment);
    assert_eq!(main_device.exchange(APRD, 0, 0x0012, &[0; 2]).0, [5, 0], "not before");
    main_device.segment.set_power(main_device.now, DeviceId(0), false);
    main_device.segment.set_power(main_device.now, DeviceId(0), true);
    assert_eq!(main_device.exchange(APRD, 0, 0x0012, &[0; 2]).0, [0x77, 0x07]);
    assert_eq!(main_device.exchange(APRD, 0, 0x0502, &[0; 2]).0, [0xC0, 0x00], "no error");
}

#[test]
fn a_wrong_checksum_leaves_the_device_without_alias_and_in_init() {
    let mut segment = single_device(&DeviceConfig { alias: 5, ..DeviceConfig::new(&PLAIN) });
    segment.eeprom_mut(DeviceId(0)).unwrap()[14] ^= 1;
    let mut main_device = RawMainDevice::new(segment);
    main_device.segment.set_power(main_device.now, DeviceId(0), false);
    main_device.segment.set_power(main_device.now, DeviceId(0), true);
    assert_eq!(main_device.exchange(APRD, 0, 0x0502, &[0; 2]).0, [0xC0, 0x18], "checksum error, not loaded");
    assert_eq!(main_device.exchange(APRD, 0, 0x0110, &[0]).0[0] & 1, 0);
    assert_eq!(main_device.exchange(APRD, 0, 0x0012, &[0; 2]).0, [0, 0]);
    main_device.exchange(APWR, 0, 0x0010, &FIRST.to_le_bytes());
    main_device.request_state(2);
    assert_eq!(main_device.al_status(), (0x01, 0));
    assert_eq!(main_device.read(0x1000, 4).1, 0, "the RAM is not there either");
    assert_eq!(main_device.write(0x1000, &[1; 4]), 0);
    assert_eq!(main_device.read(0x0F80, 4).1, 1, "the registers are");
}

#[test]
fn a_command_takes_its_time_and_errors_show_until_the_next() {
    let busy = DeviceConfig { eeprom_delay: Duration::from_micros(400), ..DeviceConfig::new(&PLAIN) };
    let mut main_device = RawMainDevice::new(single_device(&busy));
    main_device.exchange(APWR, 0, 0x0010, &FIRST.to_le_bytes());
    // Read of the vendor.
    main_device.write(0x0502, &[0, 1, 8, 0, 0, 0]);
    assert_eq!(main_device.read(0x0502, 2).0, [0xC0, 0x80]);
    main_device.wait(Duration::from_micros(399));
    assert_eq!(main_device.read(0x0502, 2).0, [0xC0, 0x80]);
    main_device.write(0x0502, &[0, 1, 0, 0, 0, 0]);
    main_device.wait(Duration::from_micros(1));
    assert_eq!(main_device.read(0x0502, 2).0, [0xC0, 0x00]);
    assert_eq!(main_device.read(0x0508, 8).0, [0, 0x0F, 0, 0, 3, 0, 0, 0]);
    // A write without the permission in the same command.
    main_device.write(0x0502, &[0, 2, 4, 0, 0, 0]);
    main_device.wait(Duration::from_micros(400));
    assert_eq!(main_device.read(0x0502, 2).0, [0xC0, 0x40]);
    // While the EEPROM belongs to the device's own side, nothing is done.
    main_device.write(0x0500, &[1]);
    main_device.write(0x0502, &[0, 1, 8, 0, 0, 0]);
    assert_eq!(main_device.read(0x0503, 1).0, [0x40]);
    main_device.write(0x0500, &[0]);
    main_device.write(0x0502, &[0, 0]);
    assert_eq!(main_device.read(0x0503, 1).0, [0]);
}

#[test]
fn after_a_command_that_does_not_exist_none_is_executed_until_the_error_is_cleared() {
    let mut main_device = RawMainDevice::new(single_device(&DeviceConfig::new(&PLAIN)));
    main_device.exchange(APWR, 0, 0x0010, &FIRST.to_le_bytes());
    main_device.write(0x0502, &[0, 7]);
    assert_eq!(main_device.read(0x0502, 2).0, [0xC0, 0x20]);
    main_device.write(0x0502, &[0, 1, 8, 0, 0, 0]);
    assert_eq!(
        (main_device.read(0x0502, 2).0, main_device.read(0x0508, 4).0),
        (vec![0xC0, 0x20], vec![0; 4])
    );
    main_device.write(0x0502, &[0, 0]);
    assert_eq!(main_device.read(0x0502, 2).0, [0xC0, 0x00]);
    main_device.write(0x0502, &[0, 1, 8, 0, 0, 0]);
    assert_eq!(main_device.read(0x0508, 4).0, [0, 0x0F, 0, 0]);
}

#[test]
fn while_a_command_runs_or_the_device_owns_the_eeprom_nothing_is_written_to_its_registers() {
    let busy = DeviceConfig { eeprom_delay: Duration::from_micros(400), ..DeviceConfig::new(&PLAIN) };
    let mut main_device = RawMainDevice::new(single_device(&busy));
    main_device.exchange(APWR, 0, 0x0010, &FIRST.to_le_bytes());
    let vendor_and_product = [0, 0x0F, 0, 0, 3, 0, 0, 0];
    assert_eq!(main_device.write(0x0502, &[0, 1, 8, 0, 0, 0]), 1);
    assert_eq!(main_device.write(0x0504, &[9, 0, 0, 0, 0xAA, 0xAA]), 0, "busy");
    main_device.wait(Duration::from_micros(400));
    assert_eq!(main_device.read(0x0504, 4).0, [8, 0, 0, 0]);
    assert_eq!(main_device.read(0x0508, 8).0, vendor_and_product);
    assert_eq!(main_device.write(0x050A, &[0xAA; 6]), 0, "a write has one word");
    assert_eq!(main_device.read(0x0508, 8).0, vendor_and_product);
    main_device.write(0x0500, &[1]);
    assert_eq!(main_device.write(0x0502, &[0, 1, 4, 0, 0, 0]), 0);
    assert_eq!(main_device.read(0x0504, 1), (vec![8], 1));
    main_device.write(0x0500, &[2]);
    assert_eq!(main_device.write(0x0502, &[0, 1, 10, 0, 0, 0]), 1);
}

#[test]
fn the_chips_configuration_is_loaded_into_its_registers_and_a_reload_takes_all_but_the_alias() {
    let mut segment = single_device(&DeviceConfig { alias: 5, ..DeviceConfig::new(&BRIDGE) });
    let image = segment.eeprom_mut(DeviceId(0)).unwrap().to_vec();
    let mut main_device = RawMainDevice::new(segment);
    main_device.exchange(APWR, 0, 0x0010, &FIRST.to_le_bytes());
    assert_eq!(main_device.read(0x0140, 2).0, image[..2]);
    assert_eq!(main_device.read(0x0150, 2).0, image[2..4]);
    assert_eq!(main_device.read(0x0982, 2).0, image[4..6]);
    assert_eq!(main_device.read(0x0110, 1).0[0] & 0x07, 0x03, "loaded, no enhanced link detection");

    // Another PDI with SYNC pulses of 2 us and another alias.
    let reload = |main_device: &mut RawMainDevice, words: &[u8; 14]| {
        let eeprom = main_device.segment.eeprom_mut(DeviceId(0)).unwrap();
        eeprom[..14].copy_from_slice(words);
        eeprom[14] = crc(words);
        main_device.write(0x0502, &[0, 4]);
    };
    let mut words = [0x05, 0x06, 0x0F, 0x44, 200, 0, 1, 2, 9, 0, 3, 4, 0, 0];
    reload(&mut main_device, &words);
    assert_eq!(main_device.read(0x0502, 2).0, [0xC0, 0x00]);
    assert_eq!(main_device.read(0x0140, 4).0, [0x05, 0x06, 3, 4]);
    assert_eq!(main_device.read(0x0150, 4).0, [0x0F, 0x44, 1, 2]);
    assert_eq!(main_device.read(0x0982, 2).0, [200, 0]);
    assert_eq!(main_device.read(0x0012, 2).0, [5, 0], "the alias is loaded at power-on alone");
    assert_eq!(main_device.read(0x0110, 1).0[0] & 0x07, 0x03);

    // A damaged one takes the device's own side from the chip, and a good one gives it back.
    words[0] = 0x08;
    reload(&mut main_device, &words);
    main_device.segment.eeprom_mut(DeviceId(0)).unwrap()[0] = 0x07;
    main_device.write(0x0502, &[0, 4]);
    assert_eq!(main_device.read(0x0502, 2).0, [0xC0, 0x18]);
    assert_eq!((main_device.read(0x0110, 1).0[0] & 0x07, main_device.read(0x0140, 1).0), (0x02, vec![0x08]));
    reload(&mut main_device, &words);
    assert_eq!(main_device.read(0x0110, 1).0[0] & 0x07, 0x03);
    main_device.segment.set_power(main_device.now, DeviceId(0), false);
    main_device.segment.set_power(main_device.now, DeviceId(0), true);
    assert_eq!(main_device.exchange(APRD, 0, 0x0012, &[0; 2]).0, [9, 0]);
    assert_eq!(main_device.exchange(APRD, 0, 0x0110, &[0]).0[0] & 0x07, 0x07, "bit 9 of the first word");
}

/// Returns the checksum over the configuration, as the division of a polynomial by another bit by bit.
fn crc(words: &[u8]) -> u8 {
    let bits = words.iter().flat_map(|byte| (0..8).rev().map(move |bit| byte >> bit & 1 != 0));
    bits.fold(0xFF_u8, |rest, bit| (rest << 1) ^ if (rest & 0x80 != 0) != bit { 0x07 } else { 0 })
}

#[test]
fn the_image_begins_with_what_the_standard_lays_down() {
    let image = sii_image(&BRIDGE, 0x0403_0201, 0x1234);
    assert_eq!(image[..14], [0x08, 0x04, 0, 0xCC, 100, 0, 0, 0, 0x34, 0x12, 0, 0, 0, 0]);
    assert_eq!(image[16..32], [0, 0x0F, 0, 0, 2, 0, 0, 0, 0, 0, 1, 0, 1, 2, 3, 4]);
    let mailboxes = [0x00, 0x10, 128, 0, 0x80, 0x10, 128, 0];
    assert_eq!((&image[40..48], &image[48..56]), (&mailboxes[..], &mailboxes[..]), "in BOOT, and else");
    assert_eq!(image[56..58], [0x0C, 0], "CoE and FoE");
    assert_eq!(image[124..128], [(image.len() / 128 - 1) as u8, 0, 1, 0]);
    assert_eq!(image[128..130], [10, 0], "strings");
    assert_eq!(image[133..140], *b"\x06BRIDGE");
    // Each category leads to the next, the last one is the end.
    let word = |at: usize| usize::from(u16::from_le_bytes([image[at * 2], image[at * 2 + 1]]));
    let mut at = 0x40;
    let mut kinds = Vec::new();
    while word(at) != 0xFFFF {
        kinds.push(word(at));
        at += 2 + word(at + 1);
    }
    assert_eq!(kinds, [10, 30, 40, 41, 50, 51, 60]);
    assert!(image[2 * at + 2..].iter().all(|byte| *byte == 0xFF), "erased");
    // General, behind the strings: numbers of group, order code and name, CoE and FoE, repetition of mailbox messages.
    let general = 2 * (0x40 + 2 + word(0x41)) + 4;
    assert_eq!(image[general..general + 18], [3, 0, 1, 2, 0, 0x23, 1, 0, 0, 0, 0, 4, 0, 0, 0, 0, 0x11, 0]);
}

/// Returns where the data of a category begin.
fn category(image: &[u8], kind: u16) -> usize {
    let word = |at: usize| u16::from_le_bytes([image[at], image[at + 1]]);
    let mut at = 0x80;
    while word(at) != kind {
        assert_ne!(word(at), 0xFFFF, "no category {kind}");
        at += 4 + 2 * usize::from(word(at + 2));
    }
    at + 4
}

#[test]
fn the_image_of_a_device_without_files_has_no_mailbox_in_boot_and_names_no_foe() {
    let image = sii_image(&SMART, 0, 0);
    assert_eq!(image[40..48], [0; 8], "in BOOT");
    assert_eq!(image[48..56], [0x00, 0x10, 128, 0, 0x80, 0x10, 128, 0], "else");
    assert_eq!(image[56..58], [0x04, 0], "CoE alone");
    assert_eq!(image[category(&image, 30) + 6], 0, "no FoE");
}

#[test]
fn a_sync_manager_without_process_data_is_not_to_be_enabled() {
    let image = sii_image(&SENSOR, 0, 0);
    let units = category(&image, 41);
    let enabled: Vec<(u8, u8)> =
        (0..4).map(|unit| &image[units + 8 * unit..]).map(|unit| (unit[7], unit[6])).collect();
    // Mailboxes out and in, outputs, inputs.
    assert_eq!(enabled, [(1, 1), (2, 1), (3, 0), (4, 1)]);
}

/// Returns the string with this number, from 1.
fn string(image: &[u8], number: u8) -> String {
    let mut at = category(image, 10) + 1;
    for _ in 1..number {
        at += 1 + usize::from(image[at]);
    }
    String::from_utf8(image[at + 1..at + 1 + usize::from(image[at])].to_vec()).unwrap()
}

#[test]
fn the_image_names_group_and_device_and_each_part_of_an_object() {
    let image = sii_image(&BRIDGE, 0, 0);
    let general = category(&image, 30);
    let [group, _, order_code, name] = [0, 1, 2, 3].map(|at| image[general + at]);
    let strings = [group, order_code, name].map(|number| string(&image, number));
    assert_eq!(strings, ["Test devices", "BRIDGE", "256 bytes out, 256 bytes in"]);
    assert_eq!(order_code, 1, "some MainDevices take the first string for the name");
    // A mapping object, and its third entry.
    let outputs = category(&image, 51);
    assert_eq!(string(&image, image[outputs + 5]), "Outputs");
    assert_eq!(string(&image, image[outputs + 8 + 2 * 8 + 3]), "Output 3");
}

#[test]
fn the_image_of_a_device_with_a_clock_lists_its_modes() {
    let image = sii_image(&BRIDGE, 0, 0);
    let modes = category(&image, 60);
    assert_eq!(image[modes - 2..modes], [24, 0], "two modes of 12 words");
    for (at, assign_activate, factor, names) in
        [(0, 0x0000, 0, ["FreeRun", "without clock"]), (24, 0x0300, 1, ["DC", "SYNC0"])]
    {
        let mode = &image[modes + at..modes + at + 24];
        let word = |at: usize| u16::from_le_bytes([mode[at], mode[at + 1]]);
        assert_eq!((&mode[..14], word(14), word(16)), (&[0; 14][..], assign_activate, factor));
        assert_eq!([18, 19].map(|at| string(&image, mode[at])), names);
        assert_eq!(mode[20..], [0; 4]);
    }
    let without = sii_image(&SIMPLE, 0, 0);
    assert!(!without.windows(4).any(|bytes| bytes == [60, 0, 24, 0]));
}

#[test]
fn fmmus_are_those_that_a_device_needs_and_a_word_is_filled_up_with_an_unused_one() {
    for (description, fmmus) in
        [(&BRIDGE, &[1, 2, 3, 0][..]), (&SIMPLE, &[1, 2]), (&TERMINAL, &[2, 0]), (&SENSOR, &[1, 2, 3, 0])]
    {
        let image = sii_image(description, 0, 0);
        let at = category(&image, 40);
        assert_eq!(image[at - 2..at], [fmmus.len() as u8 / 2, 0]);
        assert_eq!(&image[at..at + fmmus.len()], fmmus, "{}", description.name);
    }
}
