//! State of the adapter besides its TCP streams: objects, connections, events.

use alloc::boxed::Box;
use alloc::collections::VecDeque;
use alloc::vec;
use core::net::{Ipv4Addr, SocketAddrV4};

use super::explicit::ExplicitConnections;
use super::io::{IoConnection, IoConnections, Kind, ReceivedFrame};
use super::open_report::OpenReport;
use crate::IO_PORT;
use crate::class1::{self, Frame};
use crate::encapsulation::MAX_MESSAGE_LEN;
use crate::objects::{Device, IoState};
use machine::arp::AddressConflict;
use machine::{
    Allowed, Counters, Down, DownCause, ForeignRequests, LinkEvent, OwnerReport, OwnerReports, Requested,
    Sender, StationConflict,
};
use machine::{Instant, Port, StreamId, Transmit};

/// Largest number of bytes that an encapsulation reply adds to a CIP reply: header, items, a socket address.
const ENVELOPE_LEN: usize = 24 + 16 + 20;

/// Largest number of events that wait. The owner polls after every handler, so two are more than enough.
const EVENTS: usize = 8;

#[derive(Debug)]
pub(super) struct State {
    pub(super) device: Device,
    pub(super) io: IoConnections,
    pub(super) explicit: ExplicitConnections,
    pub(super) counters: Counters,
    pub(super) events: VecDeque<LinkEvent>,
    /// TCP connections to close: all connections that were opened over them have timed out or given way.
    pub(super) unused: VecDeque<StreamId>,
    /// Buffer in which CIP replies are built.
    pub(super) scratch: Box<[u8]>,
    /// Whether new connections are refused.
    pub(super) closed: bool,
    /// Whether another station has this device's address: new connections are refused, too.
    pub(super) address_is_taken: bool,
    reported_conflict: Option<AddressConflict>,
    /// The DSCP of the cyclic frame that was handed out last.
    pub(super) cyclic_dscp: u8,
    /// Who may connect.
    pub(super) originators: Allowed,
    foreign: ForeignRequests,
    owner_reports: OwnerReports,
    /// The last end of the link, and the owner that it had.
    pub(super) last_down: Option<(Down, OwnerReport)>,
    /// The last request for cyclic data.
    pub(super) last_open: Option<OpenReport>,
    up: bool,
    next_id: u32,
}

/// Sender of a request, and what the encapsulation adds to its CIP reply.
#[derive(Clone, Copy, Debug)]
pub(super) struct Context {
    pub(super) now: Instant,
    pub(super) peer: SocketAddrV4,
    pub(super) stream: StreamId,
    /// Where the originator wants T→O data, if the request contains it.
    pub(super) socket_t_o: Option<SocketAddrV4>,
    /// Where multicast T→O data goes: for the reply.
    pub(super) reply_socket_t_o: Option<SocketAddrV4>,
    /// Services around this one.
    pub(super) depth: u8,
}

impl State {
    pub(super) fn new(device: Device, first_id: u32, originators: Allowed) -> Self {
        let description = device.description;
        Self {
            io: IoConnections::new(description),
            explicit: ExplicitConnections::new(description.explicit.into()),
            device,
            counters: Counters::default(),
            events: VecDeque::with_capacity(EVENTS),
            unused: VecDeque::with_capacity(description.connections()),
            scratch: vec![0; MAX_MESSAGE_LEN - ENVELOPE_LEN].into_boxed_slice(),
            closed: false,
            address_is_taken: false,
            reported_conflict: None,
            cyclic_dscp: 0,
            originators,
            foreign: ForeignRequests::default(),
            owner_reports: OwnerReports::default(),
            last_down: None,
            last_open: None,
            up: false,
            next_id: first_id,
        }
    }

    /// Returns a connection number that no open connection has.
    pub(super) fn fresh_id(&mut self) -> u32 {
        loop {
            self.next_id = self.next_id.wrapping_add(1).max(1);
            if !self.io.uses_id(self.next_id) && !self.explicit.uses_id(self.next_id) {
                return self.next_id;
            }
        }
    }

    /// Handles a cyclic frame.
    pub(super) fn consume(&mut self, now: Instant, peer: Ipv4Addr, datagram: &[u8]) {
        let Ok(frame) = Frame::parse(datagram) else {
            self.counters.malformed += 1;
            return;
        };
        match self.io.receive(now, peer, &frame, &mut self.device.assemblies) {
            ReceivedFrame::Foreign => self.counters.foreign += 1,
            ReceivedFrame::WrongSize => self.counters.malformed += 1,
            ReceivedFrame::Late => self.counters.late += 1,
            ReceivedFrame::Fresh { missing } => {
                self.counters.received += 1;
                self.counters.lost += u64::from(missing);
                self.follow_owner(None);
            }
        }
    }

    /// Writes the next cyclic frame that is due.
    pub(super) fn produce(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        let due = self.io.next_due(now)?;
        let data = self.device.assemblies.get(due.assembly);
        // A device that sends inputs runs.
        let run = due.has_header.then_some(true);
        let len = class1::emit(buf, (due.id, due.sequence, due.count), run, data).ok()?;
        self.counters.sent += 1;
        self.cyclic_dscp = due.dscp;
        Some(Transmit { port: Port::Udp(IO_PORT), to: Some(due.to), len })
    }

    /// Ends connections whose originators are silent.
    pub(super) fn check_watchdogs(&mut self, now: Instant) {
        while let Some((kind, stream)) = self.io.remove_expired(now) {
            self.timed_out(stream);
            if kind == Kind::ExclusiveOwner {
                self.device.io.faulted = true;
                self.follow_owner(Some(Down {
                    cause: DownCause::Watchdog,
                    code: 0,
                    text: "the owner of the outputs sent nothing for as long as it had promised to",
                }));
            }
        }
        while let Some(stream) = self.explicit.remove_expired(now) {
            self.timed_out(Some(stream));
        }
        self.follow_owner(None);
    }

    /// Counts a connection that timed out. If it was the last one that was opened over its TCP connection, that one is closed
    /// too: its other end may be dead (volume 2, 2-5.5.2).
    fn timed_out(&mut self, stream: Option<StreamId>) {
        self.device.manager.timed_out();
        self.end_unused(stream);
    }

    /// Ends a TCP connection over which no connection is open any more.
    pub(super) fn end_unused(&mut self, stream: Option<StreamId>) {
        let is_unused =
            |stream: &StreamId| !self.io.was_opened_over(*stream) && !self.explicit.carries(*stream);
        self.unused.extend(stream.filter(is_unused));
    }

    /// Reports a refused request as an event: its sender is not the owner of the outputs or of the connection, or, without
    /// such an owner, not a listed originator.
    pub(super) fn refuse_foreign(
        &mut self,
        now: Instant,
        from: Ipv4Addr,
        what: Requested,
        owner: Option<Ipv4Addr>,
    ) {
        let owner = owner.map(Sender::Ip);
        if let Some(report) = self.foreign.refuse(now, Sender::Ip(from), what, owner)
            && self.events.len() < EVENTS
        {
            self.events.push_back(LinkEvent::Foreign(report));
        }
    }

    /// Reports who has opened a connection that owns outputs.
    pub(super) fn report_owner(&mut self, now: Instant, owner: OwnerReport) {
        if self.owner_reports.open(now, owner) && self.events.len() < EVENTS {
            self.events.push_back(LinkEvent::Owner(owner));
        }
    }

    /// Ends every connection and takes no new one.
    pub(super) fn close_all(&mut self, cause: DownCause) {
        self.closed = true;
        self.end_all(cause);
    }

    /// Handles that another station had this device's address first.
    pub(super) fn take_address_away(&mut self, conflict: AddressConflict) {
        self.address_is_taken = true;
        // It is probed again and again.
        if self.reported_conflict.replace(conflict) != Some(conflict) {
            self.report_conflict(conflict);
        }
        self.end_all(DownCause::ClosedHere);
    }

    pub(super) fn report_conflict(&mut self, conflict: AddressConflict) {
        if self.events.len() < EVENTS {
            self.events.push_back(LinkEvent::Conflict(StationConflict::Address(conflict)));
        }
    }

    fn end_all(&mut self, cause: DownCause) {
        self.io.clear();
        self.explicit.clear();
        self.follow_owner(Some(Down { cause, code: 0, text: "" }));
    }

    /// Returns whether an owner of outputs is in run.
    pub(super) const fn is_up(&self) -> bool {
        self.up
    }

    /// Reports as an event when the link comes up or goes down, and updates the Identity's status.
    pub(super) fn follow_owner(&mut self, down: Option<Down>) {
        let owner = self.io.is_owner_running();
        self.device.io = IoState {
            owned: owner.is_some(),
            connections: self.io.len(),
            running: owner == Some(true),
            faulted: self.device.io.faulted && owner.is_none(),
        };
        let up = owner == Some(true);
        if up == self.up || self.events.len() == EVENTS {
            return;
        }
        self.up = up;
        self.events.push_back(if up {
            LinkEvent::Up
        } else {
            let idle = Down {
                cause: DownCause::PeerIdle,
                code: 0,
                text: "the scanner's program does not run; set it to run",
            };
            let owner = match down {
                Some(_) => self.io.last_owner(),
                None => self.io.silent_owner().map(IoConnection::owner_report),
            };
            let down = down.unwrap_or(idle);
            self.last_down = owner.map(|owner| (down, owner));
            LinkEvent::Down(down)
        });
    }

    pub(super) fn next_timeout(&self) -> Option<Instant> {
        Instant::earlier(self.io.next_timeout(), self.explicit.next_timeout())
    }
}
