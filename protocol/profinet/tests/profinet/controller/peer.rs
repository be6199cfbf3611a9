//! A device in as few lines as it takes: it answers each frame at once, as its script says.

use std::net::{Ipv4Addr, SocketAddrV4};

use machine::ethernet::{EthernetHeader, Mac};
use machine::wire::{BigEndian, FRAME_CAPACITY, Reader, Writer};
use machine::{Instant, Port, Source, Transmit};
use profinet::alarm::{FRAME_ID_HIGH, FRAME_ID_LOW, PduType, Rta, error_status};
use profinet::connect::{
    AlarmCrResponse, ArResponse, ConnectRequest, ConnectResponse, DiffModule, IocrResponse, IocrType,
};
use profinet::control::{Command, Control};
use profinet::dcp::{self, BlockError, Code, Content, IpSuite, Pdu, Service as DcpService};
use profinet::record::{WriteRequest, WriteResponse};
use profinet::rpc::{CONTROLLER_INTERFACE, Header, Kind, Operation, RequestArgs, ResponseArgs};
use profinet::rt::{CyclicFrame, DataStatus, UDP_PORT, cycle_counter};
use profinet::status::Status;
use profinet::{ETHER_TYPE, RPC_PORT, Uuid};

use super::{CONTROLLER, DEVICE, DEVICE_ADDRESS};
use crate::samples;

/// What the peer leaves out or does otherwise.
#[derive(Default)]
pub(super) struct Script {
    pub(super) silent: bool,
    pub(super) deaf_to_rpc: bool,
    pub(super) refuses_connect: Option<Status>,
    pub(super) diff: Vec<DiffModule>,
    pub(super) refuses_write: Option<Status>,
    pub(super) ready_before_prm_end: bool,
    pub(super) never_ready: bool,
    pub(super) has_address: bool,
    pub(super) no_cyclic: bool,
    pub(super) bad_input: bool,
    pub(super) output_frame_id: Option<u16>,
    pub(super) responder_mac: Option<Mac>,
}

/// The device.
pub(super) struct Peer {
    pub(super) script: Script,
    pub(super) connect: Option<ConnectRequest>,
    pub(super) written: Vec<Vec<u8>>,
    pub(super) released: bool,
    pub(super) partings: Vec<Status>,
    pub(super) answered_ready: usize,
    pub(super) outputs: Vec<Vec<u8>>,
    pub(super) alarm_pdus: Vec<PduType>,
    pub(super) ready_sequence: u32,
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

impl Peer {
    pub(super) fn new(script: Script) -> Self {
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
        }
    }

    pub(super) fn receive(&mut self, now: Instant, transmit: &Transmit, frame: &[u8]) -> Frames {
        if self.script.silent {
            return Vec::new();
        }
        match transmit.port {
            Port::Ethernet => {
                let (_, payload) = EthernetHeader::parse(frame).unwrap();
                match Pdu::parse(payload) {
                    Ok(pdu) => self.receive_dcp(&pdu),
                    Err(_) => self.receive_rt(now, payload),
                }
            }
            Port::Udp(UDP_PORT) => self.receive_rt(now, frame),
            _ if self.script.deaf_to_rpc => Vec::new(),
            _ => self.receive_rpc(frame),
        }
    }

    fn receive_dcp(&mut self, pdu: &Pdu<'_>) -> Frames {
        match pdu.service {
            DcpService::IdentifyRequest => {
                let address = if self.script.has_address { DEVICE_ADDRESS } else { Ipv4Addr::UNSPECIFIED };
                let mask = if self.script.has_address { [255, 255, 255, 0] } else { [0; 4] };
                let suite = IpSuite { address, mask: mask.into(), gateway: address };
                let identity = samples::DEVICE.identity;
                let blocks = [
                    Content::Ip(suite).into(),
                    Content::NameOfStation(b"device").into(),
                    Content::DeviceId { vendor: identity.vendor, device: identity.device }.into(),
                ];
                vec![ethernet(|w| dcp::emit(w, DcpService::IdentifyResponse, pdu.xid, 0, blocks))]
            }
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
            data_status: DataStatus::RUNNING,
            transfer_status: 0,
        };
        vec![self.rt(|w| frame.emit(w))]
    }

    /// Returns an RT frame to the controller, on the way that it asked for.
    pub(super) fn rt(&self, write: impl FnOnce(&mut Writer<'_, BigEndian>)) -> (Source, Vec<u8>) {
        if self.connect.as_ref().unwrap().ar.initiator_rt_port == UDP_PORT
            && self.connect.as_ref().unwrap().iocrs[0].frame_id == 0xC000
        {
            let mut buf = [0; 1600];
            let mut writer = Writer::new(&mut buf);
            write(&mut writer);
            let len = writer.finish().unwrap();
            return (udp(UDP_PORT, UDP_PORT), buf[..len].to_vec());
        }
        ethernet(write)
    }

    fn receive_rpc(&mut self, frame: &[u8]) -> Frames {
        let (header, body) = Header::parse(frame).unwrap();
        if header.kind != Kind::Request {
            let ready =
                header.kind == Kind::Response && ResponseArgs::parse(&header, body).unwrap().status.is_ok();
            self.answered_ready += usize::from(ready);
            return Vec::new();
        }
        let blocks = RequestArgs::parse(&header, body).unwrap().blocks;
        let mut status = Status::OK;
        let mut out = [0; 1000];
        let mut writer = Writer::<BigEndian>::new(&mut out);
        let mut ready = None;
        match Operation::from(header.operation) {
            Operation::Connect => {
                let request = ConnectRequest::parse(blocks).unwrap();
                status = self.script.refuses_connect.unwrap_or_default();
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
                assert_eq!(control.command, Command::PrmEnd);
                control.emit_response(&mut writer);
                ready = Some(self.application_ready()).filter(|_| !self.script.never_ready);
            }
            Operation::Release => {
                self.released = true;
                Control::parse_request(blocks).unwrap().emit_response(&mut writer);
            }
            other => panic!("{other:?}"),
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
                responder_rt_port: UDP_PORT,
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
        let ar = &self.connect.as_ref().unwrap().ar;
        let control =
            Control { command: Command::ApplicationReady, ar: ar.uuid, session: ar.session, properties: 0 };
        let activity = Uuid([3; 16]);
        let header = Header::request(
            Operation::Control,
            ar.initiator_object,
            CONTROLLER_INTERFACE,
            activity,
            self.ready_sequence,
        );
        self.ready_sequence += 1;
        datagram(&header, |body| RequestArgs::emit(4096, body, |w| control.emit_request(w)).unwrap())
    }
}
