//! Configuration data that a scanner sends with its Forward_Open, for a device that has some.

use ethernet_ip::AdapterConfig;
use ethernet_ip::cip::Path;
use ethernet_ip::connection::{ConnectionType, OpenRequest};
use ethernet_ip::description::{Assembly, Description, Role};

use crate::cell::adapter_config;
use crate::client::{Client, Rig, close_message, heartbeat, open_message, owner, parameters};
use crate::samples::{CONSUMED, DEVICE, PRODUCED};

/// A device with three bytes of configuration.
const CONFIGURED: Description = Description {
    assemblies: &[
        Assembly { instance: PRODUCED, role: Role::Produced, size: 256, name: "Inputs" },
        Assembly { instance: CONSUMED, role: Role::Consumed, size: 256, name: "Outputs" },
        Assembly { instance: 151, role: Role::Configuration, size: 3, name: "Configuration" },
        Assembly { instance: 152, role: Role::InputOnlyHeartbeat, size: 0, name: "Input-only heartbeat" },
    ],
    ..DEVICE
};

/// Paths of an owner: with three bytes in two words, with other ones, and with one word.
const ONE: &[u8] = b"\x20\x04\x24\x97\x2C\x96\x2C\x64\x80\x02\x01\x02\x03\0";
const OTHER: &[u8] = b"\x20\x04\x24\x97\x2C\x98\x2C\x64\x80\x02\x07\x08\x09\0";
const SAME: &[u8] = b"\x20\x04\x24\x97\x2C\x98\x2C\x64\x80\x02\x01\x02\x03\0";
const SHORT: &[u8] = b"\x20\x04\x24\x97\x2C\x96\x2C\x64\x80\x01\x01\x02";

fn rig() -> (Rig, Client) {
    let mut rig = Rig::of(AdapterConfig { description: &CONFIGURED, ..adapter_config() });
    let client = rig.client();
    (rig, client)
}

/// Reads the configuration assembly's data.
fn read(rig: &mut Rig, client: Client) -> Vec<u8> {
    rig.request(client, &[0x0E, 3, 0x20, 4, 0x24, 151, 0x30, 3]).data
}

#[test]
fn data_of_the_assemblys_size_configure_the_device_and_can_be_read_again() {
    let (mut rig, client) = rig();
    assert_eq!(read(&mut rig, client), [0, 0, 0]);
    rig.open(client, &OpenRequest { path: Path(ONE), ..owner(1) });
    assert_eq!(read(&mut rig, client), [1, 2, 3]);
    assert_eq!(rig.adapter.configuration(151), Some(&[1, 2, 3][..]));
    assert_eq!(rig.adapter.configuration(PRODUCED), None, "which is no configuration assembly");
}

#[test]
fn a_reset_to_defaults_takes_the_configuration_back_and_a_plain_one_does_not() {
    for (kind, data) in [(0, [1, 2, 3]), (1, [0, 0, 0])] {
        let (mut rig, client) = rig();
        rig.open(client, &OpenRequest { path: Path(ONE), ..owner(1) });
        rig.request(client, &close_message(owner(1).triad, &[]));
        rig.request(client, &[5, 2, 0x20, 1, 0x24, 1, kind]);
        assert_eq!(rig.adapter.configuration(151), Some(&data[..]), "reset of type {kind}");
    }
}

#[test]
fn a_connection_without_data_leaves_the_configuration_as_it_is() {
    let (mut rig, client) = rig();
    rig.open(client, &OpenRequest { path: Path(ONE), ..owner(1) });
    rig.request(client, &close_message(owner(1).triad, &[]));
    rig.open(client, &owner(2));
    assert_eq!(read(&mut rig, client), [1, 2, 3]);
}

#[test]
fn data_of_another_size_are_refused_with_the_size_in_words() {
    let (mut rig, client) = rig();
    let request = OpenRequest { path: Path(SHORT), ..owner(1) };
    let answer = rig.request(client, &open_message(&request, false));
    assert_eq!(answer.additional, [0x0126, 2]);
    assert_eq!(read(&mut rig, client), [0, 0, 0]);
}

#[test]
fn a_second_connection_brings_the_same_data_or_none_while_the_first_depends_on_them() {
    let (mut rig, client) = rig();
    rig.open(client, &OpenRequest { path: Path(ONE), ..owner(1) });
    let viewer = |path| OpenRequest { path: Path(path), ..heartbeat(2, &[]) };
    assert_eq!(rig.try_open(client, &viewer(OTHER)), Err((1, 0x0106)));
    assert_eq!(read(&mut rig, client), [1, 2, 3]);
    rig.open(client, &viewer(SAME));
}

#[test]
fn a_refused_connection_configures_nothing() {
    let (mut rig, client) = rig();
    let too_fast = OpenRequest { path: Path(ONE), t_o_rpi_us: 1, ..owner(1) };
    assert_eq!(rig.try_open(client, &too_fast), Err((1, 0x0112)));
    assert_eq!(read(&mut rig, client), [0, 0, 0]);
}

#[test]
fn a_null_forward_open_configures_a_device_without_connections() {
    let (mut rig, client) = rig();
    let null = parameters(ConnectionType::Null, 0);
    let request = OpenRequest { o_t: null, t_o: null, path: Path(ONE), ..owner(1) };
    rig.open(client, &request);
    assert_eq!((read(&mut rig, client), rig.adapter.connections()), (vec![1, 2, 3], (0, 0)));
    rig.open(client, &owner(2));
    let other = OpenRequest { path: Path(OTHER), ..request };
    assert_eq!(rig.try_open(client, &OpenRequest { triad: owner(3).triad, ..other }), Err((1, 0x0106)));
}

#[test]
fn a_message_sets_the_configuration_while_no_connection_depends_on_it() {
    let (mut rig, client) = rig();
    let set = |data: &[u8]| [&[0x10, 3, 0x20, 4, 0x24, 151, 0x30, 3][..], data].concat();
    assert_eq!(rig.request(client, &set(&[4, 5, 6])).status().0, 0);
    assert_eq!(rig.request(client, &set(&[4, 5])).status().0, 0x13);
    assert_eq!(rig.request(client, &set(&[4, 5, 6, 7])).status().0, 0x15);
    rig.open(client, &owner(1));
    assert_eq!(rig.request(client, &set(&[7, 8, 9])).status().0, 0x10);
    assert_eq!(read(&mut rig, client), [4, 5, 6]);
}
