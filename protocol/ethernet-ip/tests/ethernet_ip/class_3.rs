//! Class 3 connections of the kinds that controllers and tools open.

use ethernet_ip::cip::General;
use ethernet_ip::connection::{OpenReply, OpenRequest, Parameters, Transport};

use crate::client::{Rig, explicit, open_message};

/// Returns a request for messages of so many bytes each way.
fn of_size(serial: u16, size: u16) -> OpenRequest<'static> {
    let request = explicit(serial);
    let parameters = Parameters { size, ..request.o_t };
    OpenRequest { o_t: parameters, t_o: parameters, ..request }
}

#[test]
fn a_server_of_class_3_is_opened_whatever_triggers_its_client() {
    let mut rig = Rig::new();
    let client = rig.client();
    for (serial, transport) in [(1, 0x83), (2, 0x93), (3, 0xA3)] {
        let opened = rig.open(client, &OpenRequest { transport: Transport(transport), ..explicit(serial) });
        let vendor = rig.request_connected(client, &opened, 1, &[0x0E, 3, 0x20, 1, 0x24, 1, 0x30, 1]);
        assert_eq!(vendor.unwrap().data, [0xFF, 0xFF], "0x{transport:02X}");
    }
}

#[test]
fn messages_of_4002_bytes_are_carried_both_ways_and_longer_ones_are_refused_with_that_size() {
    let mut rig = Rig::new();
    let client = rig.client();
    let answer = rig.request(client, &open_message(&of_size(1, 4_002), true));
    assert_eq!(answer.general, General::Success);
    let opened = OpenReply::parse(&answer.data).unwrap();

    // A list of so many attributes that the request fills its connection; each status in the reply takes as much room again.
    let list = |attributes: u16| {
        let head = [&[3, 2, 0x20, 1, 0x24, 1][..], &attributes.to_le_bytes()].concat();
        [head, [0x63, 0].repeat(attributes.into())].concat()
    };
    let fills = list(1_996);
    assert_eq!(fills.len(), 4_000);
    let reply = rig.request_connected(client, &opened, 1, &fills).unwrap();
    assert_eq!(reply.general, General::ReplyDataTooLarge);
    let reply = rig.request_connected(client, &opened, 2, &list(998)).unwrap();
    assert_eq!((reply.general, reply.data.len()), (General::AttributeListError, 2 + 4 * 998));
    let again = rig.request_connected(client, &opened, 2, &list(998)).unwrap();
    assert_eq!(again.data, reply.data, "a repeated request gets the reply that is kept for it");

    let answer = rig.request(client, &open_message(&of_size(2, 4_003), true));
    assert_eq!((answer.general, &answer.additional[..]), (General::ConnectionFailure, &[0x0127, 4_002][..]));
}
