//! Forward_Open of EtherNet/IP (volume 1, 3-5.5.2): the request has keys and sizes, the reply the numbers of both connections.

use std::net::SocketAddrV4;

use ethernet_ip::cip::{Reply, Request, service};
use ethernet_ip::connection::{OpenReply, OpenRequest, Triad};
use ethernet_ip::cpf;
use ethernet_ip::encapsulation::{Command, HEADER_LEN, Header};
use machine::ethernet::Mac;
use machine::wire::{LittleEndian, Reader};

use super::{Agreement, PeerTraits, Relation};
use crate::address::EndAddress;
use crate::content::ImageDirection;

/// Requests that wait for their reply.
const MAX_WAITING: usize = 16;

/// Interface handle and timeout before the items of SendRRData, in bytes (volume 2, 2-4.7).
const BEFORE_ITEMS: usize = 6;

/// Requests without their reply so far.
#[derive(Default, Debug)]
pub(super) struct Opens {
    waiting: Vec<WaitingOpen>,
}

#[derive(Debug)]
struct WaitingOpen {
    triad: Triad,
    target: Option<String>,
    plc: SocketAddrV4,
}

impl Opens {
    /// Reads a piece of a stream that begins with a message; returns the connection if it is the reply to a Forward_Open.
    pub(super) fn read(
        &mut self,
        (source, destination): (Mac, Mac),
        (from, to): (SocketAddrV4, SocketAddrV4),
        mut piece: &[u8],
    ) -> Option<Relation> {
        let mut found = None;
        // Several messages may share a segment.
        while let Ok(header) = Header::parse(piece) {
            let end = HEADER_LEN + usize::from(header.length);
            let Some(body) = piece.get(HEADER_LEN..end) else { break };
            if header.command == Command::SendRRData {
                found = self.read_message((source, destination), (from, to), body).or(found);
            }
            piece = piece.get(end..).unwrap_or_default();
        }
        found
    }

    fn read_message(
        &mut self,
        (source, destination): (Mac, Mac),
        (from, to): (SocketAddrV4, SocketAddrV4),
        body: &[u8],
    ) -> Option<Relation> {
        let packet = cpf::Packet::parse(Reader::<LittleEndian>::new(body.get(BEFORE_ITEMS..)?)).ok()?;
        let Some(cpf::Item::UnconnectedData(message)) = packet.data else { return None };
        if to.port() == ethernet_ip::ENCAPSULATION_PORT {
            self.remember(from, message);
            return None;
        }
        let reply = Reply::parse(message).ok()?;
        let is_open = matches!(reply.service, service::FORWARD_OPEN | service::LARGE_FORWARD_OPEN);
        let opened = OpenReply::parse(reply.data).ok().filter(|_| is_open && u8::from(reply.general) == 0)?;
        let at = self.waiting.iter().position(|waiting| waiting.triad == opened.triad)?;
        let WaitingOpen { triad, target, plc } = self.waiting.remove(at);
        let originator =
            format!("vendor 0x{:04X}, serial number 0x{:08X}", triad.vendor, triad.originator_serial);
        let plc = PeerTraits {
            mac: Some(destination),
            ip: Some(*plc.ip()),
            name: None,
            identity: Some(originator),
        };
        let robot = PeerTraits { mac: Some(source), ip: Some(*from.ip()), name: None, identity: target };
        let agreement = |direction, connection, sender: &PeerTraits, interval_us: u32| Agreement {
            direction,
            connection,
            from: [sender.ip.map(EndAddress::Ip), None],
            parts: Vec::new(),
            sdu_len: None,
            cycle_ns: u64::from(interval_us) * 1_000,
            step: 1,
        };
        let agreements = vec![
            agreement(ImageDirection::Command, opened.o_t_id, &plc, opened.o_t_api_us),
            agreement(ImageDirection::Feedback, opened.t_o_id, &robot, opened.t_o_api_us),
        ];
        Some(Relation { plc, robot, agreements })
    }

    fn remember(&mut self, plc: SocketAddrV4, message: &[u8]) {
        let Ok(request) = Request::parse(message) else { return };
        let is_large = request.service == service::LARGE_FORWARD_OPEN;
        if !is_large && request.service != service::FORWARD_OPEN {
            return;
        }
        let Ok(open) = OpenRequest::parse(request.data, is_large) else { return };
        let key = open.path.application().ok().and_then(|application| application.key);
        let target = key.filter(|key| key.vendor != 0).map(|key| {
            format!(
                "vendor 0x{:04X}, device type 0x{:02X}, product code {}",
                key.vendor, key.device_type, key.product_code
            )
        });
        self.waiting.retain(|waiting| waiting.triad != open.triad);
        if self.waiting.len() >= MAX_WAITING {
            self.waiting.remove(0);
        }
        self.waiting.push(WaitingOpen { triad: open.triad, target, plc });
    }
}
