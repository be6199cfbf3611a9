//! The messages of adapter and scanner as tshark reads them, field by field. A message may be well-formed for a dissector and
//! mean something else; so the values are compared, and the mere absence of faults is not enough.
//!
//! These tests need tshark; `scripts/dev.sh setup` installs it.

use std::collections::BTreeSet;
use std::net::SocketAddrV4;

use ethernet_ip::cip::{ObjectClass, Path};
use ethernet_ip::connection::OpenRequest;
use ethernet_ip::encapsulation::Command;
use ethernet_ip::{ConnectionConfig, ENCAPSULATION_PORT};

use machine::{LinkCounters, LinkStatus};

use crate::cell::{PLC, ROBOT, wanted};
use crate::client::{
    Client, OWNER_PATH, Rig, close_message, message, open_message, owner, peer, unconnected,
};
use crate::scanner_hostile::asked_for_identity_by;

/// A request and the answer to it, as messages over TCP.
type Exchange = [Vec<u8>; 2];

/// Returns the Ethernet frames of requests and answers over one TCP connection.
fn frames(exchanges: &[Exchange]) -> Vec<Vec<u8>> {
    let ends = [peer(PLC, 50_000), peer(ROBOT, ENCAPSULATION_PORT)];
    // The next sequence number of each end.
    let mut next = [1_u32, 1];
    let mut frames = Vec::new();
    for messages in exchanges {
        for (from, bytes) in messages.iter().enumerate() {
            frames.push(frame(ends[from], ends[1 - from], [next[from], next[1 - from]], bytes));
            next[from] += bytes.len() as u32;
        }
    }
    frames
}

/// Returns an Ethernet frame with a TCP segment: its numbers are those of the first byte and of the acknowledgement.
fn frame(from: SocketAddrV4, to: SocketAddrV4, numbers: [u32; 2], bytes: &[u8]) -> Vec<u8> {
    let mac = |end: SocketAddrV4| [2, 0, 0, 0, 0, end.ip().octets()[3]];
    let mut frame = [&mac(to)[..], &mac(from), &[8, 0, 0x45, 0]].concat();
    frame.extend((20 + 20 + bytes.len() as u16).to_be_bytes());
    frame.extend([0, 0, 0x40, 0, 64, 6, 0, 0]);
    frame.extend([from.ip().octets(), to.ip().octets()].concat());
    frame.extend([from.port().to_be_bytes(), to.port().to_be_bytes()].concat());
    frame.extend(numbers.map(u32::to_be_bytes).concat());
    // 20 bytes of header, PSH and ACK, window, no checksum, no urgent data.
    frame.extend([0x50, 0x18, 0xFF, 0xFF, 0, 0, 0, 0]);
    frame.extend(bytes);
    frame
}

/// Returns what tshark reads in each message: all values of each field, in the order of the fields, and the faults that it
/// finds.
pub(crate) fn dissected(exchanges: &[Exchange], fields: &[&str]) -> Vec<Vec<String>> {
    let faults = ["_ws.malformed", "_ws.expert.severity"];
    dissector::read(&frames(exchanges), fields.iter().copied().chain(faults))
}

/// Makes a CIP request and returns its message with the answer.
fn exchange(rig: &mut Rig, client: Client, cip: &[u8]) -> Exchange {
    let request = message(Command::SendRRData, client.session, &unconnected(cip));
    rig.send(client.stream, &request);
    [request, rig.streams.remove(&client.stream.0).expect("an answer")]
}

#[test]
fn each_refused_size_stands_where_the_dissector_looks_for_it() {
    let mut rig = Rig::new();
    let client = rig.client();
    let with_data: &[u8] = b"\x20\x04\x24\x97\x2C\x96\x2C\x64\x80\x01\0\0";
    let (mut o_t, mut t_o) = (owner(0x77), owner(0x77));
    (o_t.o_t.size, t_o.t_o.size) = (100, 100);
    let requests = [OpenRequest { path: Path(with_data), ..owner(0x77) }, o_t, t_o];
    let exchanges = requests.map(|request| exchange(&mut rig, client, &open_message(&request, false)));
    let fields = [
        "cip.cm.ext_status",
        "cip.cm.ext126_size",
        "cip.cm.ext127_size",
        "cip.cm.ext128_size",
        "cip.cm.conn_serial_num",
        "cip.cm.remain_path_size",
    ];
    let read = dissected(&exchanges, &fields);
    let answers: Vec<_> = read.iter().skip(1).step_by(2).map(|values| values.join(" ")).collect();
    assert_eq!(
        answers,
        ["0x0126 0   0x0077 0  ", "0x0127  262  0x0077 0  ", "0x0128   258 0x0077 0  "],
        "status, size of configuration data in words, O→T and T→O in bytes, serial number, path left, faults"
    );
}

#[test]
fn a_refused_interval_and_the_path_that_is_left_stand_where_the_dissector_looks_for_them() {
    let mut rig = Rig::new();
    let client = rig.client();
    let short = OpenRequest { o_t_rpi_us: 499, t_o_rpi_us: 10_000_001, ..owner(0x77) };
    let routed = OpenRequest { path: Path(&[1, 0, 0x20, 4, 0x2C, 150, 0x2C, 100]), ..owner(0x78) };
    let exchanges = [short, routed].map(|request| exchange(&mut rig, client, &open_message(&request, false)));
    let fields = [
        "cip.cm.ext_status",
        "cip.cm.ext112otrpi_type",
        "cip.cm.ext112torpi_type",
        "cip.cm.ext112otrpi",
        "cip.cm.ext112torpi",
        "cip.cm.conn_serial_num",
        "cip.cm.remain_path_size",
    ];
    let read = dissected(&exchanges, &fields);
    let answers: Vec<_> = read.iter().skip(1).step_by(2).map(|values| values.join(" ")).collect();
    assert_eq!(answers, ["0x0112 2 3 500 10000000 0x0077 0  ", "0x0311     0x0078 4  "]);
}

#[test]
fn the_interval_of_each_direction_and_the_one_that_is_granted_stand_where_the_dissector_looks_for_them() {
    let mut rig = Rig::new();
    let client = rig.client();
    let request = OpenRequest { o_t_rpi_us: 4_000, t_o_rpi_us: 20_000, ..owner(0x77) };
    let exchanges = [exchange(&mut rig, client, &open_message(&request, false))];
    let fields = ["cip.cm.otrpi", "cip.cm.torpi", "cip.cm.otapi", "cip.cm.toapi", "cip.cm.conn_serial_num"];
    let read: Vec<_> = dissected(&exchanges, &fields).iter().map(|values| values.join(" ")).collect();
    assert_eq!(read, ["4000 20000   0x0077  ", "  4000 20000 0x0077  "]);
}

#[test]
fn a_question_along_a_route_is_an_unconnected_send_to_the_identity_behind_it() {
    let config = ConnectionConfig { route: vec![1, 3], ..wanted() };
    let (_, question) = asked_for_identity_by(config);
    let fields = [
        "cip.sc",
        "cip.class",
        "cip.cm.timeout",
        "cip.cm.msg_req_size",
        "cip.cm.route_path_size",
        "cip.port",
        "cip.linkaddress.byte",
    ];
    let read = dissected(&[[question, Vec::new()]], &fields);
    assert_eq!(read[0].join(" "), "0x52,0x01 0x06,0x01 992 6 1 1 3  ");
}

#[test]
fn every_object_answers_as_the_dissector_expects_it() {
    let mut rig = Rig::new();
    let client = rig.client();
    let counters = LinkCounters { in_octets: 1_000_001, fcs_errors: 7, ..LinkCounters::default() };
    let is_full_duplex = Some(true);
    rig.adapter.set_link(LinkStatus { is_full_duplex, counters, ..LinkStatus::default() });
    let mut exchanges = Vec::new();
    for class in ObjectClass::ALL.iter().map(|class| class.code()) {
        for instance in [0, 1] {
            exchanges.push(exchange(&mut rig, client, &[1, 2, 0x20, class, 0x24, instance]));
            for id in 1..=13 {
                exchanges.push(exchange(&mut rig, client, &[0x0E, 3, 0x20, class, 0x24, instance, 0x30, id]));
            }
        }
    }
    exchanges.push(exchange(&mut rig, client, b"\x03\x02\x20\xF6\x24\x01\x04\0\x01\0\x02\0\x03\0\x0A\0"));
    for command in [Command::ListIdentity, Command::ListServices, Command::ListInterfaces] {
        let request = message(command, 0, &[]);
        rig.send(client.stream, &request);
        exchanges.push([request, rig.streams.remove(&client.stream.0).expect("an answer")]);
    }
    for large in [false, true] {
        let request = OpenRequest { t_o_rpi_us: 2_000, ..owner(1 + u16::from(large)) };
        exchanges.push(exchange(&mut rig, client, &open_message(&request, large)));
        exchanges.push(exchange(&mut rig, client, &close_message(request.triad, OWNER_PATH)));
    }
    // One value of each object, and those of the connection.
    let fields = [
        "cip.id.serial_number",
        "cip.mr.num_classes",
        "cip.cm.open_requests",
        "cip.port.number",
        "cip.tcpip.mcast.addr_start",
        "cip.elink.iflags.duplex",
        "cip.elink.icount.in_octets",
        "cip.elink.mcount.fcs_errors",
        "cip.elink.hc_icount.in_octets",
        "cip.elink.hc_mcount.stats_fcs_errors",
        "cip.cm.otapi",
        "cip.cm.toapi",
        "enip.lir.devtype",
    ];
    let read = dissected(&exchanges, &fields);
    assert_eq!(read.len(), 2 * exchanges.len());
    let seen = |index: usize| {
        let values: BTreeSet<_> = read.iter().map(|values| values[index].as_str()).collect();
        values.into_iter().filter(|value| !value.is_empty()).collect::<Vec<_>>().join(" ")
    };
    let seen: Vec<_> = fields.iter().enumerate().map(|(index, field)| (*field, seen(index))).collect();
    let faults: Vec<_> =
        read.iter().enumerate().filter(|(_, values)| values[fields.len()..].concat() != "").collect();
    assert!(faults.is_empty(), "{faults:?}");
    let counted = ["1000001", "7", "1000001", "7"];
    let expected = ["0x12345678", "8", "0", "0,2 2", "239.192.1.32", "1"].into_iter().chain(counted);
    let expected = expected.chain(["1000", "2000", "43"]);
    assert_eq!(seen, fields.into_iter().zip(expected.map(str::to_owned)).collect::<Vec<_>>());
}
