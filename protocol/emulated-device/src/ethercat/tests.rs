use device_files::{ChosenDevice, DeviceChoice, choose, read};
use ethercat_subdevice::sii_image;

use super::*;

/// A device with parts of objects, bits, modes of the clock and a name of its own.
const FOREIGN: &str = "<EtherCATInfo><Vendor><Id>9</Id></Vendor><Descriptions><Devices><Device>\
    <Type ProductCode='#x2' RevisionNo='#x1'>EX1</Type><Name>Example</Name>\
    <Sm DefaultSize='128' StartAddress='#x1000' ControlByte='#x26' Enable='1'>MBoxOut</Sm>\
    <Sm DefaultSize='128' StartAddress='#x1080' ControlByte='#x22' Enable='1'>MBoxIn</Sm>\
    <Sm StartAddress='#x1100' ControlByte='#x64' Enable='0'>Outputs</Sm>\
    <Sm StartAddress='#x1180' ControlByte='#x20' Enable='1'>Inputs</Sm>\
    <TxPdo Fixed='1' Sm='3'><Index>#x1A00</Index><Name>Status</Name>\
    <Entry><Index>#x6000</Index><SubIndex>1</SubIndex><BitLen>1</BitLen><Name>Ready</Name><DataType>BIT</DataType></Entry>\
    <Entry><Index>#x6000</Index><SubIndex>2</SubIndex><BitLen>5</BitLen><Name>State</Name><DataType>BIT5</DataType></Entry>\
    <Entry><Index>#x6000</Index><SubIndex>3</SubIndex><BitLen>1</BitLen><Name>Alarm</Name><DataType>BOOL</DataType></Entry>\
    <Entry><Index>0</Index><BitLen>1</BitLen></Entry></TxPdo><Mailbox><CoE/></Mailbox>\
    <Dc><OpMode><Name>Synchron</Name><Desc>SM</Desc><AssignActivate>#x0</AssignActivate></OpMode>\
    <OpMode><Name>DCSync</Name><Desc>Two signals</Desc><AssignActivate>#x700</AssignActivate>\
    <CycleTimeSync0 Factor='1'>0</CycleTimeSync0><ShiftTimeSync0>-2500</ShiftTimeSync0>\
    <CycleTimeSync1 Factor='-2'>0</CycleTimeSync1><ShiftTimeSync1>700</ShiftTimeSync1></OpMode></Dc>\
    <Profile><Dictionary><DataTypes><DataType><Name>STRING(9)</Name><BitSize>72</BitSize></DataType></DataTypes>\
    <Objects><Object><Index>#x1008</Index><Name>Device name</Name><Type>STRING(9)</Type><BitSize>72</BitSize>\
    <Info><DefaultString>EX1 model</DefaultString></Info></Object></Objects></Dictionary></Profile>\
    </Device></Devices></Descriptions></EtherCATInfo>";

fn foreign() -> Description {
    let catalogue = read("foreign.xml", FOREIGN.into()).unwrap();
    let ChosenDevice::Esi(chosen) = choose(&catalogue, &DeviceChoice::default()).unwrap() else {
        panic!("an ESI");
    };
    describe(&chosen, &Alteration::default()).unwrap()
}

/// Returns a category of an EEPROM.
fn category(image: &[u8], wanted: u16) -> &[u8] {
    let word = |at: usize| u16::from_le_bytes([image[at], image[at + 1]]);
    let mut at = 0x80;
    while word(at) != wanted {
        at += 4 + 2 * usize::from(word(at + 2));
    }
    &image[at + 4..][..2 * usize::from(word(at + 2))]
}

/// Returns the string with this number, from 1.
fn string(image: &[u8], number: u8) -> &str {
    let mut strings = &category(image, 10)[1..];
    for _ in 1..number {
        strings = &strings[1 + usize::from(strings[0])..];
    }
    std::str::from_utf8(&strings[1..][..usize::from(strings[0])]).unwrap()
}

#[test]
fn the_eeprom_has_names_types_and_clock_modes_of_the_file() {
    let image = sii_image(&foreign(), 1, 0);
    let general = category(&image, 30);
    assert_eq!([general[2], general[3]].map(|number| string(&image, number)), ["EX1", "Example"]);
    let entries = category(&image, 50)[8..].chunks(8);
    let entries: Vec<_> = entries.map(|entry| (entry[3], entry[4], entry[5])).collect();
    let [(ready, 0x30, 1), (state, 0x34, 5), (alarm, 0x01, 1), (0, _, 1)] = entries[..] else {
        panic!("{entries:X?}");
    };
    assert_eq!([ready, state, alarm].map(|number| string(&image, number)), ["Ready", "State", "Alarm"]);
    let modes = category(&image, 60);
    assert_eq!([modes[18], modes[19]].map(|number| string(&image, number)), ["Synchron", "SM"]);
    let (free, sync) = modes.split_at(24);
    assert_eq!((&free[..18], sync.len()), (&[0; 18][..], 24));
    assert_eq!(&sync[..8], [0_i32.to_le_bytes(), (-2500_i32).to_le_bytes()].as_flattened());
    assert_eq!(&sync[8..14], [&700_i32.to_le_bytes()[..], &(-2_i16).to_le_bytes()].concat());
    assert_eq!(&sync[14..18], [0, 7, 1, 0]);
    assert_eq!([sync[18], sync[19]].map(|number| string(&image, number)), ["DCSync", "Two signals"]);
}

#[test]
fn each_length_of_a_bit_type_has_its_code() {
    let names: Vec<_> = (1..=8).map(|bits| format!("BIT{bits}")).collect();
    let codes = names.iter().zip(1..).map(|(name, bits)| data_type(name, bits) as u8);
    assert!(codes.eq(0x30..=0x37));
    assert_eq!(data_type("USINT", 8), DataType::Unsigned8);
}

#[test]
fn the_name_object_is_that_of_the_file() {
    let description = foreign();
    let [name] = description.objects else { panic!("{:?}", description.objects) };
    assert_eq!((name.index, name.entries[0].default), (0x1008, &b"EX1 model"[..]));
}

#[test]
fn a_dump_of_an_eeprom_is_the_device_that_has_it() {
    let text = include_str!("../../../../scripts/interop/files/made-up-terminal.xml");
    let choice = DeviceChoice::from_toml("device_name = \"MU2004\"").unwrap();
    let file = read("a.xml", text.into()).unwrap();
    let Ok(ChosenDevice::Esi(chosen)) = choose(&file, &choice) else { panic!() };
    let description = describe(&chosen, &Alteration::default()).unwrap();
    let dump = sii_image(&description, 7, 0);
    let file = read("dump.bin", dump.clone()).unwrap();
    let Ok(ChosenDevice::Esi(found)) = choose(&file, &Default::default()) else { panic!() };
    assert_eq!((&found.kind, &found.name, found.lengths()), (&chosen.kind, &chosen.name, (1, 0)));
    assert_eq!((found.vendor_id, found.product_code), (chosen.vendor_id, chosen.product_code));
    let entries =
        |it: &ChosenSubDevice| it.outputs[0].pdo.entries.iter().map(|it| it.bits).collect::<Vec<_>>();
    assert_eq!(entries(&found), entries(&chosen));
    assert_eq!(configure(&found, &Alteration::default(), 1).unwrap().eeprom, dump);
    // Whatever is cut or changed, nothing panics.
    for at in 0..dump.len().min(512) {
        let mut changed = dump.clone();
        changed[at] = changed[at].wrapping_add(0x81);
        let _ = read("dump.bin", changed);
        let _ = read("dump.bin", dump[..at].to_vec());
    }
}
