//! The ESI file, read by a parser of others and compared with a running SubDevice, as ethercrab finds it.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use ethercat_esi::{EtherCatInfo, Pdo};
use ethercat_maindevice::ethercrab::error::Error;
use ethercat_maindevice::ethercrab::{MainDevice, MainDeviceConfig, Timeouts};
use ethercat_maindevice::{Scripted, time, with_main_device};
use ethercat_subdevice::description::{CLOCK_MODES, DataType, Description, Mailbox, PdoEntry};
use ethercat_subdevice::{DeviceConfig, Segment, sii_image};
use machine::{Duration, Instant};
use protocol::stations::ETHERCAT_ROBOT;
use roxmltree::{Document, Node};
use virtual_time::{Clock, Event, Impairment, Pair, PairConfig};

fn text() -> String {
    let [.., (_, text)] = devices::files();
    text
}

/// Returns the only element of this name.
fn only_element<'a>(document: &'a Document<'_>, name: &str) -> Node<'a, 'a> {
    let named: Vec<_> = document.descendants().filter(|node| node.has_tag_name(name)).collect();
    assert_eq!(named.len(), 1, "elements {name}");
    named[0]
}

/// A sync manager: start, length, control byte, and whether it is enabled.
type SyncManager = (u16, u16, u8, bool);

/// An entry of process data: index, subindex, bits.
type Entry = (u16, u8, u8);

/// What ethercrab found of a running device.
#[derive(Clone, PartialEq, Eq, Debug)]
struct Running {
    identity: [u32; 3],
    name: String,
    description: String,
    sync_managers: Vec<SyncManager>,
    rx_pdos: Vec<(u16, Vec<Entry>)>,
    tx_pdos: Vec<(u16, Vec<Entry>)>,
    /// Bytes of outputs and of inputs.
    process_data: [usize; 2],
    has_clock: bool,
    eeprom: (usize, Vec<u8>),
    /// Where its mailbox is in BOOT, as the EEPROM has it; zeros without a file service.
    bootstrap: [u8; 8],
    /// Whether the PDOs of a sync manager can be chosen.
    pdo_assign: bool,
    /// Objects that the information service lists; `None` without that service.
    objects: Option<usize>,
}

/// Brings the device to OP in virtual time and reads what it says.
fn running(description: &'static Description) -> Running {
    let mut segment = Segment::new();
    segment.add(&DeviceConfig::new(description));
    let cable = Impairment { delay: Duration::from_micros(10), ..Impairment::default() };
    let config =
        PairConfig { seed: 1, clocks: [Clock::default(); 2], links: [cable; 2], addresses: [None; 2] };
    let settings = MainDeviceConfig { dc_static_sync_iterations: 0, ..MainDeviceConfig::default() };
    let script = with_main_device(Timeouts::default(), settings, read);
    let mut pair = Pair::new(Scripted::new(script, Instant::ZERO), segment, config);
    loop {
        match pair.next_event(Instant::ZERO + Duration::from_secs(10)) {
            Some(Event::A(result)) => break result.unwrap(),
            Some(Event::B(_)) => {}
            None => unreachable!("the device does not come to OP"),
        }
    }
}

async fn read(main: &MainDevice<'_>) -> Result<Running, Error> {
    let group = main.init_single_group::<2, 1024>(time::now_ns).await?;
    let device = group.iter(main).next().ok_or(Error::UnknownSubDevice)?;
    let mut pdos = [Vec::new(), Vec::new()];
    for (pdos, assignment) in pdos.iter_mut().zip([0x1C12_u16, 0x1C13]) {
        for number in 1..=device.sdo_read::<u8>(assignment, 0).await? {
            let index = device.sdo_read::<u16>(assignment, number).await?;
            let mut entries = Vec::new();
            for entry in 1..=device.sdo_read::<u8>(index, 0).await? {
                let mapping = device.sdo_read::<u32>(index, entry).await?;
                entries.push(((mapping >> 16) as u16, (mapping >> 8) as u8, mapping as u8));
            }
            pdos.push((index, entries));
        }
    }
    let pdo_assign = device.sdo_write(0x1C12, 0, 0_u8).await.is_ok();
    let objects = device.sdo_info_object_quantities().await?.map(|quantities| usize::from(quantities.all));
    let name = device.name().to_owned();
    let description = device.description().await?.map_or_else(String::new, |words| words.as_str().to_owned());
    let identity = device.identity();
    let has_clock = device.dc_support().any();
    let mut config = [0; 14];
    let size = device.eeprom_size(main).await?;
    device.eeprom_read_raw(main, 0, &mut config).await?;
    let mut bootstrap = [0; 8];
    device.eeprom_read_raw(main, 0x14, &mut bootstrap).await?;
    let group = group.into_op(main).await?;
    let device = group.iter(main).next().ok_or(Error::UnknownSubDevice)?;
    let mut sync_managers = Vec::new();
    for number in 0..4 {
        let [a, b, c, d, control, _, activate, _] =
            device.register_read::<[u8; 8]>(0x0800_u16 + 8 * number).await?;
        let (start, len) = (u16::from_le_bytes([a, b]), u16::from_le_bytes([c, d]));
        sync_managers.push((start, len, control, activate & 1 == 1));
    }
    let [rx_pdos, tx_pdos] = pdos;
    Ok(Running {
        identity: [identity.vendor_id, identity.product_id, identity.revision],
        name,
        description,
        sync_managers,
        rx_pdos,
        tx_pdos,
        process_data: [device.outputs_raw().len(), device.inputs_raw().len()],
        has_clock,
        eeprom: (size, config.to_vec()),
        bootstrap,
        pdo_assign,
        objects,
    })
}

fn entries(pdos: &[Pdo]) -> Vec<(u16, Vec<Entry>)> {
    let entries = |pdo: &Pdo| {
        let entries = pdo.entries.iter().map(|entry| {
            let index = u16::from(entry.entry_idx.idx);
            (index, u8::from(entry.entry_idx.sub_idx), u8::try_from(entry.bit_len).unwrap())
        });
        (u16::from(pdo.idx), entries.collect())
    };
    pdos.iter().map(entries).collect()
}

/// Compares a file with a running device of the same description.
fn compare(text: &str, description: &'static Description) {
    let found = running(description);
    let info = EtherCatInfo::from_xml_str(text).unwrap();
    let [device] = &info.description.devices[..] else { unreachable!("one device") };
    assert_eq!([info.vendor.id, device.product_code, device.revision_no], found.identity);
    assert_eq!((device.desc.as_str(), device.name.as_str()), (&found.name[..], &found.description[..]));
    let size = |size: Option<usize>| u16::try_from(size.unwrap()).unwrap();
    let sync_managers: Vec<SyncManager> = device
        .sm
        .iter()
        .map(|sm| (sm.start_address, size(sm.default_size), sm.control_byte, sm.enable))
        .collect();
    assert_eq!(sync_managers, found.sync_managers[..sync_managers.len()]);
    assert!(found.sync_managers[sync_managers.len()..].iter().all(|(_, _, _, enabled)| !enabled));
    assert_eq!(entries(&device.rx_pdo), found.rx_pdos);
    assert_eq!(entries(&device.tx_pdo), found.tx_pdos);
    for (pdos, bytes) in [&device.rx_pdo, &device.tx_pdo].into_iter().zip(found.process_data) {
        let bits: usize = pdos.iter().flat_map(|pdo| &pdo.entries).map(|entry| entry.bit_len).sum();
        assert_eq!(bits, bytes * 8);
        for pdo in pdos {
            assert_eq!(
                size(device.sm[usize::from(u8::from(pdo.sm))].default_size),
                u16::try_from(bytes).unwrap()
            );
        }
    }

    let document = Document::parse(text).unwrap();
    assert_eq!(document.descendants().any(|node| node.has_tag_name("Dc")), found.has_clock);
    let content = |name| only_element(&document, name).text().unwrap().to_owned();
    let (eeprom_size, config) = &found.eeprom;
    assert_eq!(content("ByteSize"), eeprom_size.to_string());
    let hexadecimal = |bytes: &[u8]| bytes.iter().map(|byte| format!("{byte:02X}")).collect::<String>();
    assert_eq!(content("ConfigData"), hexadecimal(config));
    if found.bootstrap == [0; 8] {
        assert!(!document.descendants().any(|node| node.has_tag_name("BootStrap")));
    } else {
        assert_eq!(content("BootStrap"), hexadecimal(&found.bootstrap));
    }
    let coe = only_element(&document, "CoE");
    assert_eq!(coe.attribute("PdoAssign"), Some(if found.pdo_assign { "true" } else { "false" }));
    assert_eq!(coe.attribute("SdoInfo"), Some(if found.objects.is_some() { "true" } else { "false" }));
}

#[test]
fn the_file_is_that_of_the_running_robot() {
    compare(&text(), &ETHERCAT_ROBOT);
}

/// With a clock, a file service and a mailbox of another length.
static OTHER: Description = Description {
    product_code: 2,
    mailbox: Some(Mailbox { len: 256, file_capacity: 1_000 }),
    clock_modes: &CLOCK_MODES,
    numbers_names: true,
    ..ETHERCAT_ROBOT
};

#[test]
fn another_device_gives_another_file_and_neither_fits_the_other() {
    let other = devices::esi::write(&OTHER);
    compare(&other, &OTHER);
    let document = Document::parse(&other).unwrap();
    let cycle = only_element(&document, "CycleTimeSync0");
    assert_eq!((cycle.attribute("Factor"), cycle.text()), (Some("1"), Some("0")));
    let mode = cycle.parent().unwrap();
    let children = mode.children().filter(Node::is_element).map(|node| node.tag_name().name());
    assert_eq!(children.collect::<Vec<_>>(), ["Name", "Desc", "AssignActivate", "CycleTimeSync0"]);
    assert!(mode.children().any(|node| node.has_tag_name("Name") && node.text() == Some("DC")));
    assert!(only_element(&document, "BootStrap").parent().unwrap().has_tag_name("Eeprom"));
    assert!(only_element(&document, "Mailbox").children().any(|node| node.has_tag_name("FoE")));
    let wrong = std::panic::catch_unwind(|| compare(&other, &ETHERCAT_ROBOT));
    assert!(wrong.is_err(), "a file of another device passed");
}

#[test]
fn each_altered_number_of_the_file_is_noticed() {
    let whole = text();
    let altered = [
        ("ProductCode=\"#x00000001\"", "ProductCode=\"#x00000009\""),
        ("RevisionNo=\"#x00010000\"", "RevisionNo=\"#x00010001\""),
        ("StartAddress=\"#x1080\"", "StartAddress=\"#x1090\""),
        ("ControlByte=\"#x64\"", "ControlByte=\"#x24\""),
        ("DefaultSize=\"128\"", "DefaultSize=\"127\""),
        ("<Index>#x1A00</Index>", "<Index>#x1A01</Index>"),
        ("<BitLen>32</BitLen>", "<BitLen>16</BitLen>"),
        ("PdoAssign=\"false\"", "PdoAssign=\"true\""),
        ("<ByteSize>", "<ByteSize>1"),
        ("<Eeprom>", "<Dc></Dc><Eeprom>"),
    ];
    for (right, wrong) in altered {
        assert!(whole.contains(right), "{right}");
        let text = whole.replacen(right, wrong, 1);
        let noticed = std::panic::catch_unwind(|| compare(&text, &ETHERCAT_ROBOT));
        assert!(noticed.is_err(), "{wrong} passed");
    }
}

#[test]
fn elements_are_in_the_order_of_the_schema() {
    let text = text();
    let document = Document::parse(&text).unwrap();
    let children = |name| {
        let elements = only_element(&document, name).children().filter(Node::is_element);
        let mut names: Vec<_> = elements.map(|node| node.tag_name().name().to_owned()).collect();
        names.dedup();
        names
    };
    assert_eq!(children("EtherCATInfo"), ["Vendor", "Descriptions"]);
    assert_eq!(children("Descriptions"), ["Groups", "Devices"]);
    // ETG.2000, DeviceType.
    let device = ["Type", "Name", "GroupType", "Fmmu", "Sm", "RxPdo", "TxPdo", "Mailbox", "Eeprom"];
    assert_eq!(children("Device"), device);
}

#[test]
fn every_type_of_an_entry_has_the_length_that_its_name_says() {
    let lengths = [("BOOL", 1), ("USINT", 8), ("UINT", 16), ("UDINT", 32), ("ULINT", 64), ("REAL", 32)];
    let all = ETHERCAT_ROBOT.outputs.iter().chain(ETHERCAT_ROBOT.inputs);
    let is_gap = |entry: &&PdoEntry| entry.index == 0;
    for PdoEntry { bits, data_type, .. } in all.flat_map(|pdo| pdo.entries).filter(|entry| !is_gap(entry)) {
        let name = devices::esi::type_name(*data_type);
        assert!(lengths.contains(&(name, *bits)), "{name} of {bits} bits");
    }
    assert_eq!(devices::esi::type_name(DataType::Integer32), "DINT");
}

/// Returns the data of a category of an EEPROM.
fn category(image: &[u8], kind: u16) -> &[u8] {
    let word = |at: usize| u16::from_le_bytes([image[at], image[at + 1]]);
    let mut at = 0x80;
    while word(at) != kind {
        assert_ne!(word(at), 0xFFFF, "no category {kind}");
        at += 4 + 2 * usize::from(word(at + 2));
    }
    &image[at + 4..at + 4 + 2 * usize::from(word(at + 2))]
}

#[test]
fn group_device_and_process_data_have_the_names_of_the_eeprom() {
    for description in [&ETHERCAT_ROBOT, &OTHER] {
        let text = devices::esi::write(description);
        let document = Document::parse(&text).unwrap();
        let image = sii_image(description, 0, 0);
        let mut rest = category(&image, 10);
        let mut strings = vec![String::new()];
        let count = rest[0];
        rest = &rest[1..];
        for _ in 0..count {
            let (string, after) = rest[1..].split_at(rest[0].into());
            strings.push(String::from_utf8(string.to_vec()).unwrap());
            rest = after;
        }
        let device = only_element(&document, "Device");
        let child = |node: Node<'_, '_>, name: &str| {
            let found = node.children().find(|child| child.has_tag_name(name));
            found.and_then(|child| child.text()).unwrap_or_default().to_owned()
        };
        let general = category(&image, 30);
        let named = [0, 2, 3].map(|at: usize| strings[usize::from(general[at])].clone());
        assert_eq!(named, ["GroupType", "Type", "Name"].map(|name| child(device, name)));
        assert_eq!(named[0], child(only_element(&document, "Group"), "Type"));
        for (kind, element) in [(51, "RxPdo"), (50, "TxPdo")] {
            let data = category(&image, kind);
            let pdo = only_element(&document, element);
            assert_eq!(strings[usize::from(data[5])], child(pdo, "Name"));
            let entries = pdo.children().filter(|child| child.has_tag_name("Entry"));
            let names: Vec<String> = entries.map(|entry| child(entry, "Name")).collect();
            let (entries, _) = data[8..].as_chunks::<8>();
            let in_eeprom = entries.iter().map(|entry| strings[usize::from(entry[3])].clone());
            assert_eq!(in_eeprom.collect::<Vec<_>>(), names);
        }
        let modes: Vec<_> = document.descendants().filter(|node| node.has_tag_name("OpMode")).collect();
        if description.has_clocks() {
            let (in_eeprom, _) = category(&image, 60).as_chunks::<24>();
            let in_eeprom: Vec<_> =
                in_eeprom.iter().map(|mode| strings[usize::from(mode[18])].clone()).collect();
            assert_eq!(in_eeprom, modes.iter().map(|mode| child(*mode, "Name")).collect::<Vec<_>>());
        } else {
            assert!(modes.is_empty());
        }
    }
}
