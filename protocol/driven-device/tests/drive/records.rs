//! Parameter records that are written together and long ones, and diagnosis from before the connection.

use std::cell::RefCell;
use std::rc::Rc;

use virtual_time::Side;

use crate::cell::{Chosen, DrivenPair, EDS, GSDML, chosen, devices, drive_config};

/// Returns a device with these records of (index, length) in subslot 2.1.
fn device(records: &[(u16, usize)], multiple: bool) -> Chosen {
    let record = |(index, length): &(u16, usize)| {
        format!(
            "<ParameterRecordDataItem Index=\"{index}\" Length=\"{length}\"><Name TextId=\"T_2AO\"/>\
             <Const Data=\"0x01,0x02\"/></ParameterRecordDataItem>"
        )
    };
    let list: String = records.iter().map(record).collect();
    let old = GSDML.find("<RecordDataList>").unwrap()..GSDML.find("</RecordDataList>").unwrap();
    let mut text = GSDML.to_owned();
    text.replace_range(old, &format!("<RecordDataList>{list}"));
    if multiple {
        text = text.replacen(
            "<DeviceAccessPointItem ",
            "<DeviceAccessPointItem MultipleWriteSupported=\"true\" ",
            1,
        );
    }
    chosen("GSDML-V2.35-a.xml", &text, "[modules]\n1 = \"M_8DI\"\n2 = \"M_2AO\"\n")
}

/// Connects, and returns the index of each Write that the controller called.
fn writes(chosen: &Chosen) -> (DrivenPair, Vec<u16>) {
    let (cell, written) = connected(chosen);
    let written = written.borrow().clone();
    (cell, written)
}

/// Connects, and keeps the index of each Write that the controller calls.
fn connected(chosen: &Chosen) -> (DrivenPair, Rc<RefCell<Vec<u16>>>) {
    let mut cell = DrivenPair::of(chosen, "", "", &drive_config());
    let written = Rc::new(RefCell::new(Vec::new()));
    let kept = Rc::clone(&written);
    cell.pair.set_tap(move |tapped| {
        if (tapped.from, tapped.end) == (Side::A, Side::A)
            && let Some(index) = index_of_write(tapped.frame)
        {
            kept.borrow_mut().push(index);
        }
    });
    cell.run_to(5_000);
    (cell, written)
}

/// Returns the index of the first block of an RPC request Write in a datagram, unless it is a later fragment.
fn index_of_write(datagram: &[u8]) -> Option<u16> {
    let (header, body) = profinet::rpc::Header::parse(datagram).ok()?;
    let is_write =
        header.kind == profinet::rpc::Kind::Request && header.operation == 3 && header.fragment == 0;
    // 20 bytes of NDR numbers, then the head: block head, SeqNumber, ARUUID, API, slot, subslot, padding, index.
    let index = body.get(20 + 6 + 2 + 16 + 4 + 2 + 2 + 2..)?.first_chunk::<2>()?;
    is_write.then(|| u16::from_be_bytes(*index))
}

const MULTIPLE_WRITE: u16 = 0xE040;

#[test]
fn records_are_written_together_where_the_file_says_that_the_device_takes_it() {
    let records = [(100, 2), (101, 7), (102, 500)];
    let (cell, written) = writes(&device(&records, true));
    assert!(cell.pair.a().devices()[0].is_up(), "{:?}", cell.texts());
    assert_eq!(written, [MULTIPLE_WRITE]);
    let (cell, written) = writes(&device(&records, false));
    assert!(cell.pair.a().devices()[0].is_up(), "{:?}", cell.texts());
    assert_eq!(written, [0x8071, 100, 101, 102]);
}

#[test]
fn a_record_that_is_refused_among_others_is_said_and_the_others_are_written() {
    let there = device(&[(100, 2), (102, 2)], true);
    let wanted = device(&[(100, 2), (101, 2), (102, 2)], true);
    let emulated = crate::cell::emulated(there.device, "");
    let mut cell = DrivenPair::between(crate::cell::driven(&wanted, "", &drive_config()), emulated);
    cell.run_to(5_000);
    let alarms: Vec<_> = cell.texts().into_iter().filter(|text| text.starts_with("alarm")).collect();
    assert_eq!(alarms.len(), 1, "{alarms:?}");
    assert!(
        alarms[0].starts_with("alarm record 101 of subslot 2.1, 2 bytes: the device refuses it"),
        "{alarms:?}"
    );
    assert!(cell.pair.a().devices()[0].is_up());
}

#[test]
fn records_of_up_to_64_kib_are_written_at_the_start_and_later() {
    let (mut cell, written) = writes(&device(&[(100, 2), (101, 5_000), (102, 65_452)], false));
    assert!(cell.pair.a().devices()[0].is_up(), "{:?}", cell.texts());
    assert_eq!(written, [0x8071, 100, 101, 102]);
    assert!(!cell.texts().iter().any(|text| text.starts_with("alarm")), "{:?}", cell.texts());
    let value = "5a".repeat(5_000);
    cell.pair.command_a(|bus, _| bus.write_parameter("2.1:101", &value)).unwrap();
    cell.run_to(7_000);
    let answer = cell.texts().into_iter().find(|text| text.starts_with("answer")).unwrap();
    assert!(answer.ends_with(&value), "{answer}");
    // Together with others it does not fit; then it goes on its own.
    let (cell, written) = writes(&device(&[(100, 2), (101, 65_400), (102, 2), (103, 2)], true));
    assert!(cell.pair.a().devices()[0].is_up(), "{:?}", cell.texts());
    assert_eq!(written, [MULTIPLE_WRITE, 101, MULTIPLE_WRITE]);
}

#[test]
fn a_record_that_is_too_long_for_a_call_is_refused_in_words_before_anything_is_sent() {
    let (mut cell, written) = connected(&device(&[(100, 2)], false));
    let before = written.borrow().len();
    let value = "5a".repeat(65_453);
    cell.pair.command_a(|bus, _| bus.write_parameter("2.1:200", &value)).unwrap();
    cell.run_to(7_000);
    let answer = cell.texts().into_iter().find(|text| text.starts_with("answer")).unwrap();
    assert_eq!(answer, "answer 2.1:200: 65453 bytes: a record has at most 65452; shorten it");
    assert_eq!(written.borrow().len(), before, "nothing is sent");
    // The connection goes on, and takes the longest that fits.
    cell.pair.command_a(|bus, _| bus.write_parameter("2.1:200", &value[2..])).unwrap();
    cell.run_to(9_000);
    assert!(cell.pair.a().devices()[0].is_up(), "{:?}", cell.texts());
    assert_eq!(written.borrow()[before..], [200]);
}

#[test]
fn diagnosis_from_before_the_connection_is_said_in_the_file_s_words() {
    let script = "[[faults]]\nkind = \"alarm\"\nslot = 2\nchannel = 1\ncode = 6\n";
    let mut cell = DrivenPair::of(&devices()[1], script, "", &drive_config());
    cell.run_to(4_000);
    let texts = cell.texts();
    let said = "earlier diagnosis of subslot 2.1; channel 1: line break (0x0006) appears";
    assert!(texts.iter().any(|text| text == said), "{texts:?}");
    // A device without any says nothing.
    let mut cell = DrivenPair::of(&devices()[1], "", "", &drive_config());
    cell.run_to(4_000);
    assert!(!cell.texts().iter().any(|text| text.starts_with("earlier")), "{:?}", cell.texts());
}

#[test]
fn a_fault_of_an_adapter_from_before_the_connection_is_said() {
    // An adapter whose owner was lost reports it in its status until the next one.
    let mut cell = DrivenPair::of(&chosen("a.eds", EDS, ""), "", "", &drive_config());
    cell.run_to(3_000);
    assert!(!cell.texts().iter().any(|text| text.starts_with("earlier")), "{:?}", cell.texts());
    let words = driven_device::identity_status(0x0244);
    assert_eq!(
        words.as_deref(),
        Some("identity status 0x0244: minor unrecoverable fault, its stored configuration is bad")
    );
    assert_eq!(driven_device::identity_status(0x0064), None);
}
