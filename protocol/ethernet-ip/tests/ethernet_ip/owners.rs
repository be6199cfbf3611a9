//! Who owns the outputs of an adapter: named when it opens its connection, in later reports, and to everybody who asks.

use std::net::Ipv4Addr;

use ethernet_ip::cip::General;
use ethernet_ip::connection::{ConnectionData, OpenRequest, Triad};
use machine::{Duration, ForeignRequest, LinkEvent, OwnerReport, Requested, Sender};

use crate::cell::{PLC, data};
use crate::client::{Client, INPUT_ONLY_PATH, OWNER_PATH, Rig, close_message, explicit, heartbeat, owner};

const STRANGER: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 67);

/// Returns the request of an owner that may be silent for longest: 512 times the longest interval.
fn silent(serial: u16) -> OpenRequest<'static> {
    let triad = Triad { originator_serial: 0xDEAD_0001, vendor: 77, ..owner(serial).triad };
    OpenRequest { triad, multiplier: 7, o_t_rpi_us: 10_000_000, t_o_rpi_us: 10_000_000, ..owner(serial) }
}

fn words(write: impl FnOnce(&mut dyn std::fmt::Write) -> std::fmt::Result) -> String {
    let mut words = String::new();
    write(&mut words).unwrap();
    words
}

#[test]
fn whoever_opens_the_outputs_is_reported_at_once_with_interval_and_timeout_and_named_to_the_next_one() {
    let mut rig = Rig::new();
    let stranger = rig.client_from(STRANGER);
    // No outputs, no report.
    rig.open(stranger, &heartbeat(9, INPUT_ONLY_PATH));
    rig.open(stranger, &explicit(8));
    assert_eq!(rig.owners, []);
    rig.open(stranger, &silent(1));
    let report = OwnerReport {
        from: Sender::Ip(STRANGER),
        serial_number: Some(0xDEAD_0001),
        interval: Duration::from_secs(10),
        timeout: Duration::from_secs(5_120),
    };
    assert_eq!(rig.owners, [report]);
    let plc = rig.client();
    assert_eq!(rig.try_open(plc, &owner(2)), Err((1, 0x0106)));
    let refused = ForeignRequest {
        from: Sender::Ip(PLC),
        what: Requested::Connection,
        owner: Some(Sender::Ip(STRANGER)),
        more: 0,
    };
    assert_eq!(rig.events, [LinkEvent::Foreign(refused)]);
    let said = refused.to_string();
    assert!(said.ends_with("was refused: 192.168.64.67 owns the connection"), "{said}");
    let remark = words(|words| rig.adapter.remark(words));
    assert!(remark.starts_with("the scanner 192.168.64.67 (serial number 0xDEAD0001) owns the"), "{remark}");
}

#[test]
fn the_end_of_a_connection_names_its_owner_whatever_ended_it() {
    let open = |rig: &mut Rig| {
        let client = rig.client();
        let opened = rig.open(client, &owner(1));
        rig.io(PLC, opened.o_t_id, 1, Some(true), &data(1));
        assert_eq!(words(|words| rig.adapter.explain(words)), "", "it is up");
        (client, opened)
    };
    let named = "; the owner was 192.168.64.1 (serial number 0x0BADCAFE)";
    type End<'a> = &'a dyn Fn(&mut Rig);
    let ends: [(&str, End<'_>); 3] = [
        ("the watchdog expired", &|rig| {
            open(rig);
            rig.advance(Duration::from_secs(11));
        }),
        ("the peer ended the connection: by a Forward_Close", &|rig| {
            let (client, _) = open(rig);
            rig.request(client, &close_message(owner(1).triad, OWNER_PATH));
        }),
        ("the peer is connected and idle: the scanner's program does not run; set it to run", &|rig| {
            let (_, opened) = open(rig);
            rig.io(PLC, opened.o_t_id, 2, Some(false), &data(1));
        }),
    ];
    for (expected, end) in ends {
        let mut rig = Rig::new();
        end(&mut rig);
        let said = words(|words| rig.adapter.explain(words));
        assert!(said.starts_with(expected) && said.ends_with(named), "{expected}: {said}");
    }
}

#[test]
fn a_scanner_that_opens_again_and_again_is_reported_a_few_times() {
    let mut rig = Rig::new();
    let client = rig.client();
    for round in 0..100 {
        let request = OpenRequest { o_t_rpi_us: 1_000 + round % 50, ..owner(1) };
        rig.open(client, &request);
        rig.request(client, &close_message(owner(1).triad, OWNER_PATH));
    }
    assert_eq!(rig.owners.len(), 8);
}

/// Asks the Connection Manager.
fn ask(rig: &mut Rig, client: Client, service: u8, request: &[u8]) -> (General, Option<ConnectionData>) {
    let answer = rig.request(client, &[&[service, 2, 0x20, 6, 0x24, 1], request].concat());
    (answer.general, ConnectionData::parse(&answer.data).ok())
}

#[test]
fn everybody_may_ask_for_the_data_of_each_connection_by_its_number_and_by_its_triad() {
    let mut rig = Rig::new();
    let stranger = rig.client_from(STRANGER);
    let opened = rig.open(stranger, &silent(0x1234));
    let explicit_opened = rig.open(stranger, &explicit(8));
    let plc = rig.client();
    let (general, found) = ask(&mut rig, plc, 0x56, &[1, 0]);
    let found = found.unwrap();
    assert_eq!((general, found.number, found.triad), (General::Success, 1, silent(0x1234).triad));
    assert_eq!((found.o_t.target_id, found.t_o.target_id), (opened.o_t_id, opened.t_o_id));
    assert_eq!(
        (found.o_t.rpi_us, found.o_t.timeout()),
        (10_000_000, Some(Duration::from_micros(5_120_000_000)))
    );
    let triad = [0x34, 0x12, 77, 0, 0x01, 0, 0xAD, 0xDE];
    assert_eq!(ask(&mut rig, plc, 0x57, &triad), (General::Success, Some(found)));
    let class_3 = ask(&mut rig, plc, 0x56, &[2, 0]).1.unwrap();
    assert_eq!((class_3.triad, class_3.o_t.target_id), (explicit(8).triad, explicit_opened.o_t_id));
    // A number that is free is given again.
    rig.request(stranger, &close_message(silent(0x1234).triad, OWNER_PATH));
    assert_eq!(ask(&mut rig, plc, 0x56, &[1, 0]).0, General::PathDestinationUnknown);
    assert_eq!(ask(&mut rig, plc, 0x57, &triad).0, General::PathDestinationUnknown);
    rig.open(plc, &owner(3));
    assert_eq!(ask(&mut rig, plc, 0x56, &[1, 0]).1.map(|data| data.triad), Some(owner(3).triad));
    for (service, request, general) in [
        (0x56, &[][..], General::NotEnoughData),
        (0x56, &[1, 0, 0], General::TooMuchData),
        (0x57, &triad[..7], General::NotEnoughData),
        (0x57, &[0; 9], General::TooMuchData),
    ] {
        assert_eq!(ask(&mut rig, plc, service, request).0, general, "0x{service:02X} {request:?}");
    }
}

#[test]
fn the_owner_is_found_by_a_path_with_and_without_a_configuration_assembly() {
    let mut rig = Rig::new();
    let stranger = rig.client_from(STRANGER);
    rig.open(stranger, &silent(1));
    let plc = rig.client();
    for path in [OWNER_PATH, &[0x20, 4, 0x2C, 150, 0x2C, 100]] {
        let words = u8::try_from(path.len() / 2).unwrap();
        let answer = rig.request(plc, &[&[0x5A, 2, 0x20, 6, 0x24, 1, 0, words], path].concat());
        assert_eq!(answer.data, [1, 0, 0, 1, 1, 0, 77, 0, 0x01, 0, 0xAD, 0xDE], "{path:?}");
    }
}
