//! Connect of PROFINET (IEC 61158-6-10, 5.2.1): the request has the places of the data, the response the FrameIDs.

use std::net::SocketAddrV4;

use profinet::Uuid;
use profinet::connect::{ConnectRequest, ConnectResponse, Iocr, IocrType};
use profinet::rpc::{DEVICE_INTERFACE, Header, Kind, Operation, RequestArgs, ResponseArgs};
use protocol::image::IMAGE_LEN;

use super::{Agreement, PeerTraits, Relation};
use crate::address::EndAddress;
use crate::content::ImageDirection;

/// Requests that wait for their response.
const MAX_WAITING: usize = 16;

/// Length of a send clock's unit in ns.
const SEND_CLOCK_UNIT_NS: u64 = 31_250;

/// Requests without their response so far.
#[derive(Default, Debug)]
pub(super) struct Connects {
    waiting: Vec<WaitingConnect>,
}

#[derive(Debug)]
struct WaitingConnect {
    request: ConnectRequest,
    object: Uuid,
}

impl Connects {
    /// Reads a datagram; returns the connection if it is the response to a Connect.
    pub(super) fn read(
        &mut self,
        (from, to): (SocketAddrV4, SocketAddrV4),
        datagram: &[u8],
    ) -> Option<Relation> {
        let (header, body) = Header::parse(datagram).ok()?;
        let is_connect =
            header.interface == DEVICE_INTERFACE && header.operation == u16::from(Operation::Connect);
        if !is_connect || header.is_fragment() {
            return None;
        }
        match header.kind {
            Kind::Request => {
                let blocks = RequestArgs::parse(&header, body).ok()?.blocks;
                let request = ConnectRequest::parse(blocks).ok()?;
                // A request that is repeated has the AR of the first one.
                self.waiting.retain(|waiting| waiting.request.ar.uuid != request.ar.uuid);
                if self.waiting.len() >= MAX_WAITING {
                    self.waiting.remove(0);
                }
                self.waiting.push(WaitingConnect { request, object: header.object });
                None
            }
            Kind::Response => {
                let blocks = ResponseArgs::parse(&header, body).ok()?.blocks;
                let response = ConnectResponse::parse(blocks).ok()?;
                let is_of = |waiting: &WaitingConnect| waiting.request.ar.uuid == response.ar.uuid;
                let at = self.waiting.iter().position(is_of)?;
                Some(relation(self.waiting.remove(at), &response, (from, to)))
            }
            _ => None,
        }
    }
}

fn relation(
    WaitingConnect { request, object }: WaitingConnect,
    response: &ConnectResponse,
    (from, to): (SocketAddrV4, SocketAddrV4),
) -> Relation {
    let name = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let plc = PeerTraits {
        mac: Some(request.ar.initiator_mac),
        ip: Some(*to.ip()),
        name: Some(name(&request.ar.initiator_name)),
        identity: None,
    };
    let robot = PeerTraits {
        mac: Some(response.ar.responder_mac),
        ip: Some(*from.ip()),
        name: response.server.as_deref().map(name),
        identity: identity(object),
    };
    let agreements = request.iocrs.iter().filter_map(|iocr| {
        let answer = response.iocrs.iter().find(|answer| answer.reference == iocr.reference)?;
        agreement(&request, iocr, answer.frame_id, (&plc, &robot))
    });
    let agreements = agreements.collect();
    Relation { plc, robot, agreements }
}

/// Returns vendor and device of an ObjectUUID, its last four bytes.
fn identity(object: Uuid) -> Option<String> {
    let [.., d0, d1, v0, v1] = object.0;
    let (device, vendor) = (u16::from_be_bytes([d0, d1]), u16::from_be_bytes([v0, v1]));
    (vendor != 0).then(|| format!("vendor 0x{vendor:04X}, device 0x{device:04X}"))
}

fn agreement(
    request: &ConnectRequest,
    iocr: &Iocr,
    frame_id: u16,
    (plc, robot): (&PeerTraits, &PeerTraits),
) -> Option<Agreement> {
    let (direction, sender) = match iocr.iocr_type {
        IocrType::Output => (ImageDirection::Command, plc),
        IocrType::Input => (ImageDirection::Feedback, robot),
        IocrType::Unknown(_) => return None,
    };
    let clocks = u32::from(iocr.send_clock_factor).saturating_mul(iocr.reduction_ratio.into());
    Some(Agreement {
        direction,
        connection: frame_id.into(),
        from: [sender.mac.map(EndAddress::Mac), sender.ip.map(EndAddress::Ip)],
        parts: parts(request, iocr, direction),
        sdu_len: Some(iocr.data_length.into()),
        cycle_ns: u64::from(clocks).saturating_mul(SEND_CLOCK_UNIT_NS),
        // A step of 1 is EtherNet/IP's; no cycle is as short as one unit.
        step: clocks.max(2),
    })
}

/// Returns the parts of the image in the data of an IOCR: the only submodule that is long enough for it, or else all of them by slot
/// and subslot.
fn parts(request: &ConnectRequest, iocr: &Iocr, direction: ImageDirection) -> Vec<(usize, usize)> {
    let length = |slot: u16, subslot: u16| {
        let modules = request.expected.iter().filter(|module| module.slot == slot);
        let mut submodules = modules.flat_map(|module| &module.submodules);
        let submodule = submodules.find(|submodule| submodule.subslot == subslot)?;
        let length = match direction {
            ImageDirection::Command => submodule.output_len,
            ImageDirection::Feedback => submodule.input_len,
        };
        length.map(usize::from).filter(|length| *length > 0)
    };
    let mut objects = iocr.objects.clone();
    objects.sort_by_key(|object| (object.slot, object.subslot));
    let all = objects.iter();
    let all = all.filter_map(|object| Some((object.offset.into(), length(object.slot, object.subslot)?)));
    let all: Vec<(usize, usize)> = all.collect();
    let mut whole = all.iter().filter(|(_, length)| *length >= IMAGE_LEN);
    match (whole.next(), whole.next()) {
        (Some(one), None) => vec![*one],
        _ => all,
    }
}
