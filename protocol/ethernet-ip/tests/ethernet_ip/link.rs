//! The Ethernet interface of an adapter: its state as its owner reports it, and the limits of answers over UDP.

use std::net::Ipv4Addr;

use ethernet_ip::ENCAPSULATION_PORT;
use ethernet_ip::encapsulation::Command;
use machine::{Duration, Instant, LinkCounters, LinkStatus, Medium};

use crate::cell::PLC;
use crate::client::{Client, Rig, message, peer};

/// Executes a service of the Ethernet Link with an attribute in its path; returns the general status and the data.
fn ask(rig: &mut Rig, client: Client, service: u8, attribute: u8) -> (u8, Vec<u8>) {
    let answer = rig.request(client, &[service, 3, 0x20, 0xF6, 0x24, 1, 0x30, attribute]);
    (answer.general.into(), answer.data)
}

/// Returns counters that all differ: of 64 bits, so that the lower half shows where it is cut.
fn counters(base: u64) -> LinkCounters {
    let high = base << 32;
    LinkCounters {
        in_octets: high + 1,
        in_unicast: high + 2,
        in_multicast: high + 3,
        in_broadcast: high + 4,
        in_discards: high + 5,
        in_errors: high + 6,
        in_unknown_protocols: high + 7,
        out_octets: high + 8,
        out_unicast: high + 9,
        out_multicast: high + 10,
        out_broadcast: high + 11,
        out_discards: high + 12,
        out_errors: high + 13,
        alignment_errors: high + 14,
        fcs_errors: high + 15,
        single_collisions: high + 16,
        multiple_collisions: high + 17,
        sqe_test_errors: high + 18,
        deferred: high + 19,
        late_collisions: high + 20,
        excessive_collisions: high + 21,
        transmit_errors: high + 22,
        carrier_sense_errors: high + 23,
        too_long: high + 24,
        receive_errors: high + 25,
        symbol_errors: high + 26,
    }
}

const FIBRE: LinkStatus = LinkStatus {
    is_up: true,
    speed_mbit_s: Some(10_000),
    is_full_duplex: Some(true),
    is_negotiated: Some(true),
    medium: Medium::Fibre,
    gateway: None,
    counters: LinkCounters {
        in_octets: 0,
        in_unicast: 0,
        in_multicast: 0,
        in_broadcast: 0,
        in_discards: 0,
        in_errors: 0,
        in_unknown_protocols: 0,
        out_octets: 0,
        out_unicast: 0,
        out_multicast: 0,
        out_broadcast: 0,
        out_discards: 0,
        out_errors: 0,
        alignment_errors: 0,
        fcs_errors: 0,
        single_collisions: 0,
        multiple_collisions: 0,
        sqe_test_errors: 0,
        deferred: 0,
        late_collisions: 0,
        excessive_collisions: 0,
        transmit_errors: 0,
        carrier_sense_errors: 0,
        too_long: 0,
        receive_errors: 0,
        symbol_errors: 0,
    },
};

#[test]
fn speed_duplex_negotiation_and_medium_are_those_that_the_owner_reports() {
    let slow = LinkStatus {
        speed_mbit_s: Some(10),
        is_full_duplex: Some(false),
        is_negotiated: Some(false),
        medium: Medium::TwistedPair,
        ..FIBRE
    };
    // Attributes 1, 2, 6, 7, 8 and 11.
    let cases: [(LinkStatus, [&[u8]; 6]); 4] = [
        (
            FIBRE,
            [
                &[0x10, 0x27, 0, 0],
                &[0xF, 0, 0, 0],
                &[1, 0, 0, 0],
                &[3],
                &[1],
                &[2, 0, 0, 0, 1, 0x10, 0x27, 1],
            ],
        ),
        (slow, [&[10, 0, 0, 0], &[0x11, 0, 0, 0], &[0, 0, 10, 0], &[2], &[1], &[0, 0, 0, 0, 1, 10, 0, 0]]),
        (
            LinkStatus { is_up: false, ..slow },
            [&[10, 0, 0, 0], &[0x10, 0, 0, 0], &[0, 0, 10, 0], &[2], &[0], &[0, 0, 0, 0, 1, 10, 0, 0]],
        ),
        (
            LinkStatus { speed_mbit_s: Some(200_000), ..FIBRE },
            [
                &[0x40, 0x0D, 3, 0],
                &[0xF, 0, 0, 0],
                &[1, 0, 0, 0],
                &[3],
                &[1],
                &[2, 0, 0, 0, 1, 0xFF, 0xFF, 1],
            ],
        ),
    ];
    let mut rig = Rig::new();
    let client = rig.client();
    for (status, expected) in cases {
        rig.adapter.set_link(status);
        for (attribute, expected) in [1, 2, 6, 7, 8, 11].into_iter().zip(expected) {
            assert_eq!(
                ask(&mut rig, client, 0x0E, attribute),
                (0, expected.to_vec()),
                "{attribute}: {status:?}"
            );
        }
    }
}

#[test]
fn the_gateway_is_the_one_that_the_interface_has_now() {
    let mut rig = Rig::new();
    let client = rig.client();
    for last in [254, 1] {
        let gateway = Some(Ipv4Addr::new(192, 168, 64, last));
        rig.adapter.set_link(LinkStatus { gateway, ..FIBRE });
        // Get_Attribute_Single of the interface configuration: address, mask, gateway.
        let answer = rig.request(client, &[0x0E, 3, 0x20, 0xF5, 0x24, 1, 0x30, 5]);
        assert_eq!(answer.data[8..12], [last, 64, 168, 192]);
    }
    rig.adapter.set_link(FIBRE);
    let answer = rig.request(client, &[0x0E, 3, 0x20, 0xF5, 0x24, 1, 0x30, 5]);
    assert_eq!(answer.data[8..12], [0; 4]);
}

#[test]
fn counters_are_read_in_32_and_64_bits_and_each_attribute_is_cleared_alone() {
    let mut rig = Rig::new();
    let client = rig.client();
    for (service, attribute) in [(0x0E, 4), (0x0E, 5), (0x0E, 12), (0x0E, 13), (0x4C, 4), (0x4C, 13)] {
        assert_eq!(ask(&mut rig, client, service, attribute), (0x14, vec![]), "before the first report");
    }
    rig.adapter.set_link(LinkStatus { counters: counters(1), ..FIBRE });
    let low = |numbers: &[u32]| numbers.iter().flat_map(|number| number.to_le_bytes()).collect::<Vec<_>>();
    let high = |numbers: &[u64]| -> Vec<u8> {
        numbers.iter().flat_map(|number| ((1 << 32) + number).to_le_bytes()).collect()
    };
    let all = [
        (4, low(&[1, 2, 7, 5, 6, 7, 8, 9, 21, 12, 13])),
        (5, low(&[14, 15, 16, 17, 18, 19, 20, 21, 22, 23, 24, 25])),
        (12, high(&[1, 2, 3, 4, 8, 9, 10, 11])),
        (13, high(&[14, 15, 22, 24, 25, 26])),
    ];
    for (attribute, expected) in &all {
        assert_eq!(ask(&mut rig, client, 0x0E, *attribute), (0, expected.clone()), "{attribute}");
    }
    for (index, (attribute, expected)) in all.iter().enumerate() {
        assert_eq!(ask(&mut rig, client, 0x4C, *attribute), (0, expected.clone()), "{attribute}");
        for (other, (attribute, expected)) in all.iter().enumerate() {
            let expected = if other <= index { vec![0; expected.len()] } else { expected.clone() };
            assert_eq!(ask(&mut rig, client, 0x0E, *attribute), (0, expected), "{attribute}");
        }
    }
    // They go on from there, also where the interface's own counters begin anew.
    rig.adapter.set_link(LinkStatus {
        counters: LinkCounters { out_octets: (1 << 32) + 9, ..counters(1) },
        ..FIBRE
    });
    assert_eq!(ask(&mut rig, client, 0x0E, 4).1, low(&[0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0]));
    rig.adapter.set_link(LinkStatus { counters: LinkCounters::default(), ..FIBRE });
    assert_eq!(ask(&mut rig, client, 0x0E, 4).0, 0);
    // What cannot be cleared.
    assert_eq!(ask(&mut rig, client, 0x4C, 1).0, 0x14);
    let whole = rig.request(client, &[0x4C, 2, 0x20, 0xF6, 0x24, 1]);
    assert_eq!(u8::from(whole.general), 0x14);
    let of_class = rig.request(client, &[0x4C, 3, 0x20, 0xF6, 0x24, 0, 0x30, 4]);
    assert_eq!(u8::from(of_class.general), 0x08);
    let with_data = rig.request(client, &[0x4C, 3, 0x20, 0xF6, 0x24, 1, 0x30, 4, 0]);
    assert_eq!(u8::from(with_data.general), 0x15);
    let of_identity = rig.request(client, &[0x4C, 3, 0x20, 1, 0x24, 1, 0x30, 1]);
    assert_eq!(u8::from(of_identity.general), 0x08);
}

#[test]
fn a_question_to_all_devices_is_answered_within_a_quarter_of_the_time_that_it_allows() {
    // 0 leaves the time to the device, which is 2 s; the least is 500 ms.
    for (allowed_ms, within_ms) in [(0, 500), (1, 125), (1_000, 250), (8_000, 2_000), (u16::MAX, 16_384)] {
        let mut latest = Duration::ZERO;
        for first_id in 1..=64 {
            let config = ethernet_ip::AdapterConfig { first_id, ..crate::cell::adapter_config() };
            let mut rig = Rig::of(config);
            let asked: Instant = rig.now;
            let mut question = message(Command::ListIdentity, 0, &[]);
            question[12..14].copy_from_slice(&allowed_ms.to_le_bytes());
            rig.broadcast(ENCAPSULATION_PORT, peer(PLC, 40_000), &question);
            rig.advance(Duration::from_secs(70));
            let [(at, ..)] = rig.datagrams[..] else { panic!("{} answers", rig.datagrams.len()) };
            latest = latest.max(at.since(asked));
        }
        let within = Duration::from_millis(within_ms);
        assert!(latest <= within && latest > within / 2, "{allowed_ms} ms: {latest:?}");
    }
}

#[test]
fn questions_to_one_device_are_answered_up_to_a_limit_which_leaves_some_for_other_hosts() {
    let mut rig = Rig::new();
    let question = message(Command::ListIdentity, 0, &[]);
    let before = rig.adapter.counters().foreign;
    for _ in 0..1_000 {
        rig.datagram(ENCAPSULATION_PORT, peer(Ipv4Addr::new(192, 168, 64, 80), 40_000), &question);
    }
    assert_eq!((rig.datagrams.len(), rig.adapter.counters().foreign - before), (16, 984));
    rig.datagram(ENCAPSULATION_PORT, peer(PLC, 40_000), &question);
    assert_eq!(rig.datagrams.len(), 17, "another host");
    for number in 0..1_000_u16 {
        let [high, low] = number.to_be_bytes();
        rig.datagram(ENCAPSULATION_PORT, peer(Ipv4Addr::new(10, 0, high, low), 40_000), &question);
    }
    assert_eq!(rig.datagrams.len(), 64, "forged senders");
    rig.advance(Duration::from_secs(1));
    rig.datagram(ENCAPSULATION_PORT, peer(PLC, 40_000), &question);
    assert_eq!(rig.datagrams.len(), 65, "the next second");
}
