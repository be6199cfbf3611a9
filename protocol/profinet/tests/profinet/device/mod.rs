//! The device alone, driven by the frames of a test controller: captured ones, and ones that the codecs write.

mod admitted;
mod answers;
mod captured;
mod counted;
mod discovery;
mod dissected;
mod hostile;
mod life;
mod lldp;
mod maintenance;
mod named;
mod permanent;
mod refusals;
mod restarts;
mod steps;
mod strangers;

use std::net::{Ipv4Addr, SocketAddrV4};

use machine::arp::ArpPacket;
use machine::ethernet::{EthernetHeader, Mac};
use machine::{DownCause, Duration, Instant, LinkEvent, Machine, Port, Source, Transmit};
use profinet::block::{BlockReader, BlockWriter};
use profinet::connect::{
    AlarmCr, Ar, ArProperties, ConnectRequest, ConnectResponse, ExpectedModule, ExpectedSubmodule, Iocr,
    IocrType, Object, RtClass,
};
use profinet::control::{Command, Control};
use profinet::description::Identity;
use profinet::rpc::{
    DEVICE_INTERFACE, Header, Kind, Operation, RequestArgs, ResponseArgs, flags, object, rpc_status,
};
use profinet::rt::{CyclicFrame, DataStatus, UDP_PORT};
use profinet::status::{Service, Status, Violation};
use profinet::{Device, DeviceConfig, ETHER_TYPE, LT_UDP, RPC_PORT, Uuid};

use crate::samples::{self, LEN, emitted};
use crate::{is_arp, is_lldp};

const MAC: Mac = Mac([2, 0, 0, 0, 0, 2]);
const CONTROLLER_MAC: Mac = Mac([2, 0, 0, 0, 0, 1]);
const CONTROLLER: SocketAddrV4 = SocketAddrV4::new(Ipv4Addr::new(192, 168, 64, 1), 49_152);
const ADDRESS: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 2);
const MASK: Ipv4Addr = Ipv4Addr::new(255, 255, 255, 0);
const AR: Uuid = Uuid([0xA7; 16]);

fn device() -> Device {
    device_named(b"device")
}

fn device_named(name: &[u8]) -> Device {
    Device::new(DeviceConfig { station_name: name.to_vec(), ..config() }, Instant::ZERO)
}

fn config() -> DeviceConfig {
    DeviceConfig {
        mac: MAC,
        station_name: b"device".to_vec(),
        permanent: None,
        address: Some(ADDRESS),
        mask: MASK,
        description: samples::DEVICE,
        controllers: machine::Allowed::default(),
    }
}

/// Returns a Connect that fits the sample device. With `with_access_point` it is as Siemens controllers write it, with
/// the device access point and consumer statuses; without, it has the data only, as `profinet-py` writes it.
fn connect_request(rt_class: RtClass, with_access_point: bool) -> ConnectRequest {
    // Longer than a screen, because it is one request, field by field.
    let modules = if with_access_point { samples::DEVICE.modules } else { &samples::DEVICE.modules[1..] };
    let expected = modules
        .iter()
        .map(|module| ExpectedModule {
            slot: module.slot,
            ident: module.ident,
            properties: 0,
            submodules: module
                .submodules
                .iter()
                .map(|submodule| ExpectedSubmodule {
                    subslot: submodule.subslot,
                    ident: submodule.ident,
                    properties: 0,
                    input_len: Some(submodule.input_len),
                    output_len: (submodule.output_len > 0).then_some(submodule.output_len),
                })
                .collect(),
        })
        .collect();
    let access_point = |offset: u16| {
        let subslots = if with_access_point { &[1, 0x8000, 0x8001][..] } else { &[] };
        let object = move |(index, subslot): (usize, &u16)| Object {
            slot: 0,
            subslot: *subslot,
            offset: offset + index as u16,
        };
        subslots.iter().enumerate().map(object)
    };
    let data = |offset| Object { slot: 1, subslot: 1, offset };
    let status = with_access_point.then_some(data(260));
    let (lt, transport_id) = match rt_class {
        RtClass::Udp => (LT_UDP, 0xC000),
        RtClass::Legacy1 => (ETHER_TYPE, 0xC000),
        _ => (ETHER_TYPE, 0x8000),
    };
    let iocr = |iocr_type, reference, objects: Vec<Object>, consumer_statuses: Vec<Object>| Iocr {
        iocr_type,
        reference,
        lt,
        rt_class,
        properties: 0,
        data_length: 261,
        frame_id: transport_id + reference,
        send_clock_factor: 32,
        reduction_ratio: 1,
        phase: 1,
        sequence: 0,
        frame_send_offset: Iocr::BEST_EFFORT,
        watchdog_factor: 10,
        data_hold_factor: 10,
        tag_header: 0xC000,
        multicast_mac: Mac::default(),
        objects,
        consumer_statuses,
    };
    ConnectRequest {
        ar: Ar {
            ar_type: 1,
            uuid: AR,
            session: 1,
            initiator_mac: CONTROLLER_MAC,
            initiator_object: object(1, Identity { vendor: 0x002A, device: 0x010E }),
            properties: match rt_class {
                RtClass::Legacy1 => ArProperties(ArProperties::ACTIVE),
                _ => ArProperties(ArProperties::ACTIVE | ArProperties::ADVANCED_STARTUP),
            },
            activity_timeout: 20,
            initiator_rt_port: UDP_PORT,
            initiator_name: b"plc".to_vec(),
        },
        iocrs: vec![
            iocr(
                IocrType::Input,
                1,
                access_point(257).chain([data(0)]).collect(),
                status.into_iter().collect(),
            ),
            iocr(IocrType::Output, 2, vec![data(0)], access_point(257).chain(status).collect()),
        ],
        alarm_cr: Some(AlarmCr {
            alarm_cr_type: 1,
            lt: ETHER_TYPE,
            properties: 0,
            rta_timeout: 1,
            rta_retries: 3,
            local_reference: 5,
            max_data_length: 200,
            tag_high: 0xC000,
            tag_low: 0xA000,
        }),
        expected,
    }
}

/// Frames that the device sent.
type Sent = Vec<(Transmit, Vec<u8>)>;

/// A controller that says exactly what a test wants it to.
struct DeviceRig {
    device: Device,
    now: Instant,
    activity: Uuid,
    sequence: u32,
    rt_class: RtClass,
    counter: u16,
    /// What the device announced to its neighbour.
    announced: Vec<(Instant, Vec<u8>)>,
    /// Whether it probes an address that was set.
    probes: bool,
}

impl DeviceRig {
    fn new() -> Self {
        Self::around(device())
    }

    fn around(device: Device) -> Self {
        let now = Instant::from_millis(10);
        let activity = Uuid([9; 16]);
        Self {
            device,
            now,
            activity,
            sequence: 0,
            rt_class: RtClass::Class1,
            counter: 0,
            announced: Vec::new(),
            probes: false,
        }
    }

    /// Returns a device with an AR that exchanges data.
    fn connected(rt_class: RtClass) -> Self {
        let mut rig = Self { rt_class, ..Self::new() };
        rig.establish(&connect_request(rt_class, true));
        rig
    }

    fn establish(&mut self, request: &ConnectRequest) {
        self.rt_class = request.iocrs[0].rt_class;
        let (status, _) = self.connect(request);
        assert_eq!(status, Status::OK);
        let (status, sent) = self.prm_end();
        assert_eq!(status, Status::OK);
        let call = sent.into_iter().find(|(transmit, _)| transmit.to.is_some_and(|to| to.port() == RPC_PORT));
        let (_, call) = call.expect("ApplicationReady follows PrmEnd");
        self.confirm(&call);
        self.send_data(&[0x5A; LEN]);
        let events: Vec<_> = core::iter::from_fn(|| self.device.poll_event()).collect();
        assert_eq!(events, [LinkEvent::Up]);
    }

    /// Returns everything that the device wants to send now, except its announcements.
    fn drain(&mut self) -> Sent {
        let mut buf = [0; machine::wire::FRAME_CAPACITY];
        let mut sent = Sent::new();
        while let Some(transmit) = self.device.poll_transmit(self.now, &mut buf) {
            let frame = buf[..transmit.len].to_vec();
            if is_arp(transmit.port, &frame) {
                self.probes |= ArpPacket::from_frame(&frame).unwrap().unwrap().is_probe();
            } else if is_lldp(transmit.port, &frame) {
                self.announced.push((self.now, frame));
            } else {
                sent.push((transmit, frame));
            }
        }
        sent
    }

    fn receive(&mut self, port: Port, frame: &[u8]) -> Sent {
        self.receive_from(CONTROLLER, port, frame)
    }

    fn receive_from(&mut self, peer: SocketAddrV4, port: Port, frame: &[u8]) -> Sent {
        let peer = (port != Port::Ethernet).then_some(peer);
        self.device.handle_frame(self.now, Source { port, peer }, frame);
        self.drain()
    }

    /// Lets time pass; returns what is sent meanwhile.
    fn advance(&mut self, by: Duration) -> Sent {
        let until = self.now + by;
        let mut sent = Vec::new();
        while let Some(at) = self.device.poll_timeout().filter(|at| *at <= until) {
            self.now = self.now.max(at);
            self.device.handle_timeout(self.now);
            sent.extend(self.drain());
        }
        self.now = until;
        sent
    }

    /// Lets the time pass in which the device probes an address. Returns what else is sent.
    fn probe(&mut self) -> Sent {
        let sent = if self.probes { self.advance(machine::arp::PROBE_TIME) } else { Sent::new() };
        self.probes = false;
        sent
    }

    fn events(&mut self) -> Vec<LinkEvent> {
        assert_eq!(self.probe().len(), 0, "nothing is answered while an address is probed");
        core::iter::from_fn(|| self.device.poll_event()).collect()
    }

    fn header(&self, operation: Operation) -> Header {
        let object = object(1, samples::DEVICE.identity);
        Header::request(operation, object, DEVICE_INTERFACE, self.activity, self.sequence)
    }

    fn datagram(&self, operation: Operation, blocks: &[u8]) -> Vec<u8> {
        let mut body = [0; 4000];
        let len = RequestArgs::emit(4000, &mut body, |w| w.bytes(blocks)).unwrap();
        let mut buf = [0; 4096];
        let len = self.header(operation).emit(&body[..len], &mut buf).unwrap();
        buf[..len].to_vec()
    }

    /// Makes a call; returns its status, the blocks of the answer, and what else is sent.
    fn call(&mut self, operation: Operation, blocks: &[u8]) -> (Status, Vec<u8>, Sent) {
        self.call_from(CONTROLLER, operation, blocks)
    }

    fn call_from(
        &mut self,
        from: SocketAddrV4,
        operation: Operation,
        blocks: &[u8],
    ) -> (Status, Vec<u8>, Sent) {
        let datagram = self.datagram(operation, blocks);
        self.sequence += 1;
        let mut sent = self.receive_from(from, Port::Udp(RPC_PORT), &datagram);
        let answer = sent.iter().position(|(transmit, _)| transmit.to == Some(from));
        let (_, answer) = sent.remove(answer.expect("an answer"));
        let (header, body) = Header::parse(&answer).unwrap();
        let args = ResponseArgs::parse(&header, body).unwrap();
        (args.status, args.blocks.to_vec(), sent)
    }

    fn connect(&mut self, request: &ConnectRequest) -> (Status, Option<ConnectResponse>) {
        let (status, blocks, _) = self.call(Operation::Connect, &emitted(|w| request.emit(w)));
        (status, status.is_ok().then(|| ConnectResponse::parse(&blocks).unwrap()))
    }

    fn control(&mut self, operation: Operation, control: Control) -> (Status, Sent) {
        let (status, blocks, sent) = self.call(operation, &emitted(|w| control.emit_request(w)));
        if status.is_ok() {
            assert_eq!(Control::parse_response(&blocks).map(|answer| answer.command), Ok(control.command));
        }
        (status, sent)
    }

    fn prm_end(&mut self) -> (Status, Sent) {
        self.control(Operation::Control, control(Command::PrmEnd))
    }

    /// Confirms an ApplicationReady call.
    fn confirm(&mut self, call: &[u8]) -> Sent {
        let (header, body) = Header::parse(call).unwrap();
        let args = RequestArgs::parse(&header, body).unwrap();
        let ready = Control::parse_request(args.blocks).unwrap();
        let mut body = [0; 200];
        let len =
            ResponseArgs::emit(Status::OK, args.maximum, &mut body, |w| ready.emit_response(w)).unwrap();
        let mut buf = [0; 400];
        let len = header.answer(Kind::Response).emit(&body[..len], &mut buf).unwrap();
        self.receive(Port::Udp(RPC_PORT), &buf[..len])
    }

    fn cyclic(&mut self, data: &[u8; LEN], iops: u8, data_status: DataStatus) -> (Port, Vec<u8>) {
        self.counter = self.counter.wrapping_add(32);
        let mut c_sdu = [0x80; 261];
        c_sdu[..LEN].copy_from_slice(data);
        c_sdu[LEN] = iops;
        let (port, frame_id) = match self.rt_class {
            RtClass::Udp => (Port::Udp(UDP_PORT), 0xC002),
            RtClass::Legacy1 => (Port::Ethernet, 0xC002),
            _ => (Port::Ethernet, 0x8002),
        };
        let frame = CyclicFrame {
            frame_id,
            c_sdu: &c_sdu,
            cycle_counter: self.counter,
            data_status,
            transfer_status: 0,
        };
        let mut buf = [0; 400];
        let len = if port == Port::Ethernet {
            ethernet_header().emit(&mut buf, |w| frame.emit(w)).unwrap()
        } else {
            let mut writer = BlockWriter::new(&mut buf);
            frame.emit(&mut writer);
            writer.finish().unwrap()
        };
        (port, buf[..len].to_vec())
    }

    fn send_data(&mut self, data: &[u8; LEN]) {
        let (port, frame) = self.cyclic(data, 0x80, DataStatus::RUNNING);
        self.receive(port, &frame);
    }
}

fn ethernet_header() -> EthernetHeader {
    EthernetHeader { destination: MAC, source: CONTROLLER_MAC, tag: None, ether_type: ETHER_TYPE }
}

const fn control(command: Command) -> Control {
    Control { command, ar: AR, session: 1, properties: 0 }
}
