//! A device in as few lines as it takes: it answers each frame at once, as its script says.

use std::collections::BTreeSet;
use std::net::{Ipv4Addr, SocketAddrV4};

use machine::arp::{self, ArpPacket};
use machine::ethernet::{EthernetHeader, Mac};
use machine::wire::{BigEndian, FRAME_CAPACITY, Reader, Writer};
use machine::{Duration, Instant, Port, Source, Transmit};
use profinet::alarm::{FRAME_ID_HIGH, FRAME_ID_LOW, PduType, Rta, error_status};
use profinet::connect::{
    AlarmCrResponse, ArProperties, ArResponse, ConnectRequest, ConnectResponse, DiffModule, IocrResponse,
    IocrType, RtClass, emit_module_diff,
};
use profinet::control::{Command, Control};
use profinet::dcp::{self, Block, BlockError, Code, Content, IpSuite, Pdu, Service as DcpService};
use profinet::record::{WriteRequest, WriteResponse};
use profinet::rpc::{
    self, CONTROLLER_INTERFACE, Header, Kind, Operation, RequestArgs, ResponseArgs, rpc_status,
};
use profinet::rt::{CyclicFrame, DataStatus, UDP_PORT, cycle_counter};
use profinet::status::{Service, Status, Violation};
use profinet::{ETHER_TYPE, RPC_PORT, Uuid};

use super::{CONTROLLER, DEVICE, DEVICE_ADDRESS};
use crate::samples;

/// What the peer leaves out or does otherwise.
#[derive(Default)]
pub(super) struct PeerScript {
    pub(super) silent: bool,
    pub(super) deaf_to_rpc: bool,
    /// It does not answer when its address is set.
    pub(super) ignores_set: bool,
    /// The instances of its object; any if there is none. It reports the last one by DCP.
    pub(super) instances: Vec<u16>,
    pub(super) reports_no_instance: bool,
    pub(super) refuses_connect: Option<Status>,
    /// Its stack knows neither advanced startup mode nor the present number of RT_CLASS_1.
    pub(super) is_old: bool,
    pub(super) diff: Vec<DiffModule>,
    pub(super) diff_when_ready: Vec<DiffModule>,
    pub(super) refuses_write: Option<Status>,
    pub(super) refuses_release: Option<Status>,
    /// It refuses PrmEnd for a plugged submodule.
    pub(super) refuses_plug: Option<Status>,
    pub(super) ready_before_prm_end: bool,
    pub(super) never_ready: bool,
    /// Its answer to PrmEnd is lost, and it refuses a repetition with this status, or does not answer it.
    pub(super) prm_end_lost: Option<Option<Status>>,
    /// It answers a call when so much time has passed since the first time that it came.
    pub(super) slow: Duration,
    pub(super) has_address: bool,
    /// Another station has its address.
    pub(super) address_conflict: bool,
    pub(super) no_cyclic: bool,
    pub(super) bad_input: bool,
    /// DataStatus of its frames; that of a device that runs if there is none.
    pub(super) data_status: Option<DataStatus>,
    pub(super) output_frame_id: Option<u16>,
    pub(super) responder_mac: Option<Mac>,
    pub(super) responder_rt_port: Option<u16>,
}

/// The device.
pub(super) struct ScriptedPeer {
    pub(super) script: PeerScript,
    pub(super) connect: Option<ConnectRequest>,
    pub(super) written: Vec<Vec<u8>>,
    pub(super) released: bool,
    pub(super) partings: Vec<Status>,
    pub(super) answered_ready: usize,
    pub(super) outputs: Vec<Vec<u8>>,
    pub(super) alarm_pdus: Vec<PduType>,
    pub(super) ready_sequence: u32,
    /// The UDP ports to which cyclic frames and alarms came.
    pub(super) rt_ports: BTreeSet<u16>,
    /// The alarm numbers of PrmEnd for plugged submodules.
    pub(super) plug_ends: Vec<u16>,
    /// The last call, and when it came first.
    last_call: Option<(Header, Instant)>,
}

pub(super) type Frames = Vec<(Source, Vec<u8>)>;

pub(super) const ETHERNET: Source = Source { port: Port::Ethernet, peer: None };

pub(super) const fn udp(port: u16, from: u16) -> Source {
    Source { port: Port::Udp(port), peer: Some(SocketAddrV4::new(DEVICE_ADDRESS, from)) }
}

pub(super) fn ethernet(write: impl FnOnce(&mut Writer<'_, BigEndian>)) -> (Source, Vec<u8>) {
    let mut buf = [0; 1600];
    let header =
        EthernetHeader { destination: CONTROLLER, source: DEVICE, tag: None, ether_type: ETHER_TYPE };
    let len = header.emit(&mut buf, write).unwrap();
    (ETHERNET, buf[..len].to_vec())
}

pub(super) fn datagram(header: &Header, body: impl FnOnce(&mut [u8]) -> usize) -> (Source, Vec<u8>) {
    let (mut buf, mut body_buf) = ([0; FRAME_CAPACITY], [0; 2000]);
    let len = body(&mut body_buf);
    let len = header.emit(&body_buf[..len], &mut buf).unwrap();
    // From an ephemeral port, as many devices do.
    (udp(RPC_PORT, 49_152), buf[..len].to_vec())
}

/// Answers for the device's address, as its host would.
fn answer_arp(question: &ArpPacket) -> Frames {
    let mut buf = [0; 64];
    let len = question.answer(DEVICE).emit_frame(&mut buf).unwrap();
    let is_asked = question.operation == arp::Operation::Request && question.target_address == DEVICE_ADDRESS;
    if is_asked { vec![(ETHERNET, buf[..len].to_vec())] } else { Vec::new() }
}

impl ScriptedPeer {
    pub(super) fn new(script: PeerScript) -> Self {
        Self {
            script,
            connect: None,
            written: Vec::new(),
            released: false,
            partings: Vec::new(),
            answered_ready: 0,
            outputs: Vec::new(),
            alarm_pdus: Vec::new(),
            ready_sequence: 0,
            rt_ports: BTreeSet::new(),
            plug_ends: Vec::new(),
            last_call: None,
        }
    }

    pub(super) fn receive(&mut self, now: Instant, transmit: &Transmit, frame: &[u8]) -> Frames {
        if self.script.silent {
            return Vec::new();
        }
        match transmit.port {
            Port::Ethernet => {
                if let Some(packet) = ArpPacket::from_frame(frame) {
                    return answer_arp(&packet.unwrap());
                }
                let (_, payload) = EthernetHeader::parse(frame).unwrap();
                match Pdu::parse(payload) {
                    Ok(pdu) => self.receive_dcp(&pdu),
                    Err(_) => self.receive_rt(now, payload),
                }
            }
            Port::Udp(UDP_PORT) => {
                self.rt_ports.extend(transmit.to.map(|to| to.port()));
                self.receive_rt(now, frame)
            }
            _ if self.script.deaf_to_rpc => Vec::new(),
            _ => self.receive_rpc(now, frame),
        }
    }

    fn receive_dcp(&mut self, pdu: &Pdu<'_>) -> Frames {
        match pdu.service {
            DcpService::IdentifyRequest => {
                let address = if self.script.has_address { DEVICE_ADDRESS } else { Ipv4Addr::UNSPECIFIED };
                let mask = if self.script.has_address { [255, 255, 255, 0] } else { [0; 4] };
                let suite = IpSuite { address, mask: mask.into(), gateway: address };
                let conflict = if self.script.address_conflict { Block::ADDRESS_CONFLICT } else { 0 };
                let qualifier = u16::from(self.script.has_address) | conflict;
                let identity = samples::DEVICE.identity;
                let blocks = [
                    Block { qualifier, content: Content::Ip(suite) },
                    Content::NameOfStation(b"device").into(),
                    Content::DeviceId { vendor: identity.vendor, device: identity.device }.into(),
                ];
                let instance = self.script.instances.last().filter(|_| !self.script.reports_no_instance);
                let instance = instance.map(|instance| Content::DeviceInstance(*instance).into());
                let blocks = blocks.into_iter().chain(instance);
                vec![ethernet(|w| dcp::emit(w, DcpService::IdentifyResponse, pdu.xid, 0, blocks))]
            }
            DcpService::SetRequest if self.script.ignores_set => Vec::new(),
            DcpService::SetRequest => {
                self.script.has_address = true;
                let blocks = [Content::Response { code: Code::IP, error: BlockError::None }.into()];
                vec![ethernet(|w| dcp::emit(w, DcpService::SetResponse, pdu.xid, 0, blocks))]
            }
            other => panic!("a controller does not send {other:?}"),
        }
    }

    fn receive_rt(&mut self, now: Instant, payload: &[u8]) -> Frames {
        let connect = self.connect.as_ref().expect("connected first");
        let (input, output) = (&connect.iocrs[0], &connect.iocrs[1]);
        let frame_id = u16::from_be_bytes([payload[0], payload[1]]);
        if matches!(frame_id, FRAME_ID_HIGH | FRAME_ID_LOW) {
            let (rta, variable) = Rta::parse(&payload[2..]).unwrap();
            self.alarm_pdus.push(rta.pdu_type);
            self.partings.extend(error_status(variable).filter(|_| rta.pdu_type == PduType::Error));
            return Vec::new();
        }
        // A damaged answer may have named another one.
        if frame_id != self.script.output_frame_id.unwrap_or(output.frame_id) {
            return Vec::new();
        }
        let frame = CyclicFrame::parse(payload, usize::from(output.data_length)).unwrap();
        self.outputs.push(frame.c_sdu.to_vec());
        if self.script.no_cyclic {
            return Vec::new();
        }
        let mut c_sdu = vec![0; usize::from(input.data_length)];
        c_sdu[3] = 0x42;
        for (object, len) in input.objects.iter().zip([0, 0, 0, 256]) {
            c_sdu[usize::from(object.offset) + len] = if self.script.bad_input { 0 } else { 0x80 };
        }
        let frame = CyclicFrame {
            frame_id: input.frame_id,
            c_sdu: &c_sdu,
            cycle_counter: cycle_counter(now),
            data_status: self.script.data_status.unwrap_or(DataStatus::RUNNING),
            transfer_status: 0,
        };
        vec![self.rt(|w| frame.emit(w))]
    }

    /// Returns an RT frame to the controller, on the way that it asked for.
    pub(super) fn rt(&self, write: impl FnOnce(&mut Writer<'_, BigEndian>)) -> (Source, Vec<u8>) {
        let connect = self.connect.as_ref().unwrap();
        if connect.ar.initiator_rt_port == UDP_PORT && connect.iocrs[0].rt_class == RtClass::Udp {
            let mut buf = [0; 1600];
            let mut writer = Writer::new(&mut buf);
            write(&mut writer);
            let len = writer.finish().unwrap();
            return (udp(UDP_PORT, UDP_PORT), buf[..len].to_vec());
        }
        ethernet(write)
    }

    fn receive_rpc(&mut self, now: Instant, frame: &[u8]) -> Frames {
        let (header, body) = Header::parse(frame).unwrap();
        if header.kind != Kind::Request {
            let ready =
                header.kind == Kind::Response && ResponseArgs::parse(&header, body).unwrap().status.is_ok();
            self.answered_ready += usize::from(ready);
            return Vec::new();
        }
        let is_same = self.last_call.is_some_and(|(last, _)| last.is_same_call(&header));
        let first = self.last_call.filter(|_| is_same).map_or(now, |(_, first)| first);
        self.last_call = Some((header, first));
        if now.since(first) < self.script.slow {
            return Vec::new();
        }
        let object = |instance: &u16| rpc::object(*instance, samples::DEVICE.identity);
        let instances = &self.script.instances;
        if !instances.is_empty() && !instances.iter().any(|instance| object(instance) == header.object) {
            let status = rpc_status::UNKNOWN_INTERFACE.to_be_bytes();
            return vec![datagram(&header.answer(Kind::Reject), |body| {
                body[..4].copy_from_slice(&status);
                4
            })];
        }
        let blocks = RequestArgs::parse(&header, body).unwrap().blocks;
        let mut status = Status::OK;
        let mut out = [0; 1000];
        let mut writer = Writer::<BigEndian>::new(&mut out);
        let mut ready = None;
        match Operation::from(header.operation) {
            Operation::Connect => {
                let request = ConnectRequest::parse(blocks).unwrap();
                let old_refusal = || {
                    let is_new = request.iocrs.iter().any(|iocr| iocr.rt_class == RtClass::Class1);
                    if request.ar.properties.has(ArProperties::ADVANCED_STARTUP) {
                        Some(Violation::ArProperties)
                    } else {
                        is_new.then_some(Violation::IocrProperties)
                    }
                };
                let refusal = old_refusal().filter(|_| self.script.is_old);
                let refusal = refusal.map(|violation| violation.status(Service::Connect));
                status = self.script.refuses_connect.or(refusal).unwrap_or_default();
                if status.is_ok() {
                    self.connected(&request).emit(&mut writer);
                    self.connect = Some(request);
                }
            }
            Operation::Write => {
                let request = WriteRequest::parse(&mut Reader::new(blocks)).unwrap();
                status = self.script.refuses_write.unwrap_or_default();
                self.written.push(request.record.to_vec());
                WriteResponse { address: request.address, length: 0, status }.emit(&mut writer);
            }
            Operation::Control => {
                let control = Control::parse_request(blocks).unwrap();
                let is_ready = match control.command {
                    Command::PrmEnd => Command::ApplicationReady,
                    Command::PrmEndPlug { alarm } => {
                        self.plug_ends.push(alarm);
                        Command::ApplicationReadyPlug { alarm }
                    }
                    other => panic!("{other:?}"),
                };
                match self.script.refuses_plug.filter(|_| is_ready != Command::ApplicationReady) {
                    Some(refusal) => status = refusal,
                    None => {
                        control.emit_response(&mut writer);
                        ready = Some(self.call(is_ready)).filter(|_| !self.script.never_ready);
                    }
                }
            }
            Operation::Release => {
                self.released = true;
                status = self.script.refuses_release.unwrap_or_default();
                Control::parse_request(blocks).unwrap().emit_response(&mut writer);
            }
            other => panic!("{other:?}"),
        }
        let is_prm_end = Operation::from(header.operation) == Operation::Control;
        let lost = self.script.prm_end_lost.filter(|_| is_prm_end);
        if let Some(refusal) = lost {
            if !is_same {
                return ready.into_iter().collect();
            }
            ready = None;
            match refusal {
                Some(refusal) => status = refusal,
                None => return Vec::new(),
            }
        }
        let len = writer.finish().unwrap();
        let answer = datagram(&header.answer(Kind::Response), |body| {
            ResponseArgs::emit(status, 4096, body, |w| w.bytes(&out[..len])).unwrap()
        });
        let mut frames = vec![answer];
        frames.extend(ready);
        if self.script.ready_before_prm_end {
            frames.reverse();
        }
        frames
    }

    fn connected(&self, request: &ConnectRequest) -> ConnectResponse {
        ConnectResponse {
            ar: ArResponse {
                ar_type: 1,
                uuid: request.ar.uuid,
                session: request.ar.session,
                responder_mac: self.script.responder_mac.unwrap_or(DEVICE),
                responder_rt_port: self.script.responder_rt_port.unwrap_or(UDP_PORT),
            },
            iocrs: request
                .iocrs
                .iter()
                .map(|iocr| IocrResponse {
                    iocr_type: iocr.iocr_type,
                    reference: iocr.reference,
                    frame_id: match (iocr.iocr_type, self.script.output_frame_id) {
                        (IocrType::Output, Some(frame_id)) => frame_id,
                        _ => iocr.frame_id,
                    },
                })
                .collect(),
            alarm_cr: Some(AlarmCrResponse { alarm_cr_type: 1, local_reference: 9, max_data_length: 200 }),
            diff: self.script.diff.clone(),
            server: None,
        }
    }

    pub(super) fn application_ready(&mut self) -> (Source, Vec<u8>) {
        self.call(Command::ApplicationReady)
    }

    fn call(&mut self, command: Command) -> (Source, Vec<u8>) {
        let ar = &self.connect.as_ref().unwrap().ar;
        let control = Control { command, ar: ar.uuid, session: ar.session, properties: 0 };
        let activity = Uuid([3; 16]);
        let header = Header::request(
            Operation::Control,
            ar.initiator_object,
            CONTROLLER_INTERFACE,
            activity,
            self.ready_sequence,
        );
        self.ready_sequence += 1;
        let diff = &self.script.diff_when_ready;
        datagram(&header, |body| {
            let blocks = |w: &mut Writer<'_, BigEndian>| {
                control.emit_request(w);
                if !diff.is_empty() {
                    emit_module_diff(diff, w);
                }
            };
            RequestArgs::emit(4096, body, blocks).unwrap()
        })
    }
}
