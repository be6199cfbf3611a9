//! Stations without a partner, and searches: what anybody on the cable may send.

use std::net::{Ipv4Addr, SocketAddrV4};

use machine::ethernet::Mac;
use machine::wire::FRAME_CAPACITY;
use machine::{Allowed, Duration, Instant, Machine, Port, Source};
use profinet::dcp::IpSuite;
use profinet::rpc::{self, Header, Kind, Operation};
use profinet::{
    Device, DeviceConfig, RPC_PORT, RecordPlace, RecordReader, RecordReaderConfig, StationChange,
    StationSetter, StationSetterConfig, Uuid, record,
};
use protocol::search::Search;
use virtual_time::hostile::{Choices as _, Script};

use crate::profinet::{DEVICE, STATIONS};

const MASK: Ipv4Addr = Ipv4Addr::new(255, 255, 255, 0);

/// Frames that a machine may answer to one that it got, alarms and repetitions among them.
const MOST_ANSWERS: usize = 16;

/// Sends DCP frames to a device without a connection.
pub(crate) fn dcp(data: &[u8]) {
    let config = DeviceConfig {
        mac: STATIONS[1].0,
        station_name: b"device".to_vec(),
        permanent: None,
        address: None,
        mask: MASK,
        description: DEVICE,
        controllers: Allowed(Vec::new()),
    };
    let device = Device::new(config, Instant::ZERO);
    feed(device, data, |script| {
        // DCP's FrameIDs are FEFC to FEFF; by Identify's multicast address, or by the station's own.
        let to = [Mac([0x01, 0x0E, 0xCF, 0, 0, 0]), STATIONS[1].0][script.below(2)];
        let mut frame = [to.0, STATIONS[0].0.0].concat();
        frame.extend([0x88, 0x92, 0xFE, 0xFC + script.below(4) as u8]);
        let len = script.below(128);
        frame.extend(script.take(len));
        (Source { port: Port::Ethernet, peer: None }, frame)
    });
}

/// Answers what `plc-node discover` asks.
pub(crate) fn discovery(data: &[u8]) {
    let length = Duration::from_secs(2);
    let config = profinet::SearchConfig { mac: STATIONS[0].0, first_xid: 1, length };
    let profinet = profinet::Search::new(config, Instant::ZERO);
    let config = ethernet_ip::SearchConfig::from_address(0, STATIONS[0].1, MASK, length);
    let ethernet_ip = ethernet_ip::Search::new(config, Instant::ZERO);
    let search = Search::new(Some(profinet), Some(ethernet_ip));
    feed(search, data, |script| {
        let host = script.below(256) as u8;
        let is_ethernet = script.below(2) == 0;
        let len = script.below(128);
        if is_ethernet {
            let mut frame = [STATIONS[0].0.0, [2, 0, 0, 0, 1, host]].concat();
            // The answer to Identify.
            frame.extend([0x88, 0x92, 0xFE, 0xFF]);
            frame.extend(script.take(len));
            return (Source { port: Port::Ethernet, peer: None }, frame);
        }
        let peer = Some(SocketAddrV4::new(Ipv4Addr::new(192, 168, 64, host), 44_818));
        (Source { port: Port::Udp(0), peer }, script.take(len))
    });
}

/// Answers a tool that reads records without a connection. The header of an answer is mostly that of a call.
pub(crate) fn reader(data: &[u8]) {
    const PORT: u16 = 50_000;
    let activity = Uuid([7; 16]);
    let place = |index| RecordPlace { slot: 0, subslot: 1, index };
    let records = vec![
        place(record::index::REAL_IDENTIFICATION_API),
        place(record::index::IDENTIFICATION_AND_MAINTENANCE_0),
    ];
    let address = STATIONS[1].1;
    let identity = DEVICE.identity;
    let config = RecordReaderConfig { address, identity, local_port: PORT, activity, records };
    feed(RecordReader::new(config, Instant::ZERO), data, |script| {
        let object = rpc::object(rpc::INSTANCE, identity);
        let sequence = script.below(4) as u32;
        let call =
            Header::request(Operation::ReadImplicit, object, rpc::DEVICE_INTERFACE, activity, sequence);
        let kind = [Kind::Response, Kind::Fault, Kind::Reject, Kind::Working][script.below(4)];
        let flags = script.below(256) as u8;
        let len = script.below(256);
        let body = script.take(len);
        let mut frame = vec![0; FRAME_CAPACITY];
        let written = Header { kind, flags, ..call }.emit(&body, &mut frame);
        frame.truncate(written.unwrap_or(0));
        (Source { port: Port::Udp(PORT), peer: Some(SocketAddrV4::new(address, RPC_PORT)) }, frame)
    });
}

/// Answers a tool that sets a station. The head of an answer is mostly that of its request.
pub(crate) fn setter(data: &[u8]) {
    const XID: u32 = 77;
    let mut choices = Script::new(data);
    let suite = IpSuite { address: STATIONS[1].1, mask: MASK, gateway: STATIONS[1].1 };
    let change = match choices.below(3) {
        0 => StationChange::Name(b"device".to_vec()),
        1 => StationChange::Address(suite),
        _ => StationChange::Flash,
    };
    let is_permanent = choices.below(2) == 0;
    let config =
        StationSetterConfig { mac: STATIONS[0].0, station: STATIONS[1].0, xid: XID, change, is_permanent };
    let rest = choices.take(data.len());
    feed(StationSetter::new(config, Instant::ZERO), &rest, |script| {
        let mut frame = [STATIONS[0].0.0, STATIONS[1].0.0].concat();
        // DCP-Get-Set, service Set, a response, or one that says that it is not supported.
        frame.extend([0x88, 0x92, 0xFE, 0xFD, 4, [1, 5][script.below(2)]]);
        let xid = if script.below(8) == 0 { script.below(256) as u32 } else { XID };
        frame.extend(xid.to_be_bytes());
        let len = script.below(128);
        let length = if script.below(8) == 0 { script.below(65_536) } else { len };
        frame.extend([0, 0]);
        frame.extend((length as u16).to_be_bytes());
        frame.extend(script.take(len));
        (Source { port: Port::Ethernet, peer: None }, frame)
    });
}

/// Gives a machine the frames of a script and lets time pass between them, as the contract of machines says.
fn feed<M: Machine>(mut machine: M, data: &[u8], next: impl Fn(&mut Script) -> (Source, Vec<u8>)) {
    let (mut script, mut now) = (Script::new(data), Instant::ZERO);
    let mut buf = vec![0; FRAME_CAPACITY];
    let mut settle = |machine: &mut M, now| {
        let sent = (0..=MOST_ANSWERS).take_while(|_| machine.poll_transmit(now, &mut buf).is_some()).count();
        assert!(sent <= MOST_ANSWERS, "no end of frames");
        while machine.poll_stream().is_some() {}
        while machine.poll_event().is_some() {}
    };
    while !script.is_over() {
        let (source, frame) = next(&mut script);
        machine.handle_frame(now, source, &frame);
        settle(&mut machine, now);
        let until = now + Duration::from_millis(script.below(256) as u64);
        while let Some(due) = machine.poll_timeout().filter(|due| *due <= until) {
            // A machine that wants to be called at once again and again would stop the cyclic thread.
            assert!(due >= now, "a timeout in the past");
            now = now.max(due);
            machine.handle_timeout(now);
            settle(&mut machine, now);
            assert!(machine.poll_timeout().is_none_or(|next| next > due), "the timeout stays where it was");
        }
        now = until;
    }
}
