//! An adapter with more than one pair of assemblies: each consumed assembly has an owner of its own.

use std::net::Ipv4Addr;

use ethernet_ip::AdapterConfig;
use ethernet_ip::cip::Path;
use ethernet_ip::connection::{ConnectionType, OpenRequest};
use ethernet_ip::description::{Assembly, Description, Role};
use machine::{Duration, LinkEvent};

use crate::cell::{PLC, adapter_config};
use crate::client::{Client, Rig, close_message, heartbeat, owner, parameters};
use crate::samples::{CONSUMED, DEVICE, PRODUCED};

const OTHER: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 7);
const SECOND_PRODUCED: u32 = 101;
const SECOND_CONSUMED: u32 = 160;

/// A device with a second pair of 4 and 8 bytes.
const TWO_PAIRS: Description = Description {
    assemblies: &[
        Assembly { instance: PRODUCED, role: Role::Produced, size: 256, name: "Inputs" },
        Assembly { instance: SECOND_PRODUCED, role: Role::Produced, size: 4, name: "More inputs" },
        Assembly { instance: CONSUMED, role: Role::Consumed, size: 256, name: "Outputs" },
        Assembly { instance: SECOND_CONSUMED, role: Role::Consumed, size: 8, name: "More outputs" },
        Assembly { instance: 152, role: Role::InputOnlyHeartbeat, size: 0, name: "Input-only heartbeat" },
        Assembly { instance: 153, role: Role::ListenOnlyHeartbeat, size: 0, name: "Listen-only heartbeat" },
    ],
    exclusive_owners: 2,
    ..DEVICE
};

fn rig() -> Rig {
    Rig::of(AdapterConfig { description: &TWO_PAIRS, ..adapter_config() })
}

fn first(serial: u16) -> OpenRequest<'static> {
    OpenRequest { path: Path(&[0x20, 4, 0x2C, 150, 0x2C, 100]), ..owner(serial) }
}

fn second(serial: u16) -> OpenRequest<'static> {
    let (o_t, t_o) =
        (parameters(ConnectionType::PointToPoint, 14), parameters(ConnectionType::PointToPoint, 6));
    OpenRequest { o_t, t_o, path: Path(&[0x20, 4, 0x2C, 160, 0x2C, 101]), ..owner(serial) }
}

/// Returns a listener to the second produced assembly.
fn listener(serial: u16) -> OpenRequest<'static> {
    let t_o = parameters(ConnectionType::PointToPoint, 6);
    OpenRequest { t_o, ..heartbeat(serial, &[0x20, 4, 0x2C, 153, 0x2C, 101]) }
}

/// Returns the assembly data that both owners have sent.
fn consumed(rig: &Rig) -> [Option<u8>; 2] {
    [CONSUMED, SECOND_CONSUMED].map(|instance| rig.adapter.consumed(instance).map(|data| data[0]))
}

fn close(rig: &mut Rig, client: Client, serial: u16) {
    let answer = rig.request(client, &close_message(owner(serial).triad, &[]));
    assert_eq!(answer.status().0, 0);
}

#[test]
fn two_hosts_own_one_assembly_each_and_neither_gets_the_others() {
    let mut rig = rig();
    let (client, other) = (rig.client(), rig.client_from(OTHER));
    let opened = [rig.open(client, &first(1)), rig.open(other, &second(2))];
    assert_eq!(rig.try_open(other, &first(3)), Err((1, 0x0106)), "the first assembly has an owner");
    assert_eq!(rig.try_open(client, &second(3)), Err((1, 0x0106)), "and the second one too");

    rig.io(PLC, opened[0].o_t_id, 1, Some(true), &[1; 256]);
    assert_eq!(consumed(&rig), [Some(1), None], "nobody has sent the second one yet");
    rig.io(OTHER, opened[1].o_t_id, 1, Some(true), &[2; 8]);
    assert_eq!(consumed(&rig), [Some(1), Some(2)]);
    rig.io(PLC, opened[0].o_t_id, 2, Some(false), &[3; 256]);
    assert_eq!(consumed(&rig), [None, Some(2)], "the first owner is idle, the second one is not");
    rig.io(OTHER, opened[1].o_t_id, 2, Some(true), &[4; 8]);
    assert_eq!(rig.events, [LinkEvent::Up], "the link is up while one owner runs");
    close(&mut rig, other, 2);
    assert_eq!(consumed(&rig), [None, None]);
    assert!(matches!(rig.events[..], [LinkEvent::Up, LinkEvent::Down(_)]), "{:?}", rig.events);
    rig.open(client, &second(4));
}

#[test]
fn a_second_owner_of_one_assembly_is_refused_also_where_the_device_has_connections_for_two_owners() {
    let mut rig = rig();
    let client = rig.client();
    rig.open(client, &first(1));
    assert_eq!(rig.try_open(client, &first(2)), Err((1, 0x0106)));
}

#[test]
fn an_owner_of_a_free_assembly_is_refused_where_the_device_has_no_connection_for_it() {
    const ONE_OWNER: Description = Description { exclusive_owners: 1, ..TWO_PAIRS };
    let mut rig = Rig::of(AdapterConfig { description: &ONE_OWNER, ..adapter_config() });
    let client = rig.client();
    rig.open(client, &first(1));
    assert_eq!(rig.try_open(client, &second(2)), Err((1, 0x011A)));
}

#[test]
fn each_connection_gets_the_assembly_that_it_names() {
    let mut rig = rig();
    let (client, other) = (rig.client(), rig.client_from(OTHER));
    rig.open(client, &first(1));
    rig.open(other, &second(2));
    rig.adapter.set_produced(PRODUCED, &[7; 256]).unwrap();
    rig.adapter.set_produced(SECOND_PRODUCED, &[9; 4]).unwrap();
    rig.datagrams.clear();
    rig.advance(Duration::from_micros(1_500));
    let sent: Vec<_> =
        rig.datagrams.iter().map(|(_, _, to, frame)| (*to.ip(), frame[20..].to_vec())).collect();
    assert_eq!(sent, [(PLC, vec![7; 256]), (OTHER, vec![9; 4])]);
}

#[test]
fn a_listener_needs_and_outlives_no_connection_but_one_that_gets_the_same_assembly() {
    let mut rig = rig();
    let client = rig.client();
    rig.open(client, &first(1));
    assert_eq!(rig.try_open(client, &listener(3)), Err((1, 0x0119)), "nobody gets the second assembly");
    rig.open(client, &second(2));
    rig.open(client, &listener(3));
    close(&mut rig, client, 1);
    assert_eq!(rig.adapter.connections().0, 2, "the listener does not depend on the first owner");
    rig.open(client, &first(1));
    close(&mut rig, client, 2);
    assert_eq!(rig.adapter.connections().0, 1, "it ends with the second one, though the first is there");
}

#[test]
fn multicasts_of_two_assemblies_run_side_by_side() {
    let mut rig = rig();
    let client = rig.client();
    let multicast = |size| parameters(ConnectionType::Multicast, size);
    let on_first = heartbeat(1, &[0x20, 4, 0x2C, 152, 0x2C, 100]);
    let on_second = heartbeat(2, &[0x20, 4, 0x2C, 152, 0x2C, 101]);
    let opened = [
        rig.open(client, &OpenRequest { t_o: multicast(258), ..on_first }),
        rig.open(client, &OpenRequest { t_o: multicast(6), ..on_second }),
    ];
    assert_ne!(opened[0].t_o_id, opened[1].t_o_id);
    rig.datagrams.clear();
    rig.advance(Duration::from_micros(1_500));
    let groups: Vec<_> =
        rig.datagrams.iter().map(|(_, _, to, frame)| (to.ip().octets()[3], frame.len())).collect();
    assert_eq!(groups, [(32, 276), (33, 24)]);
}

#[test]
fn whoever_owns_an_assembly_may_set_what_its_connection_depends_on_and_others_may_not() {
    let mut rig = rig();
    let (client, other) = (rig.client(), rig.client_from(OTHER));
    rig.open(client, &first(1));
    let inactivity = [0x10, 3, 0x20, 0xF5, 0x24, 1, 0x30, 13, 60, 0];
    assert_eq!(rig.request(other, &inactivity).status().0, 0x10);
    rig.open(other, &second(2));
    assert_eq!(rig.request(other, &inactivity).status().0, 0);
}
