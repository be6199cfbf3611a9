//! Establishes a connection over TCP step by step: each answer leads to the next message.

use super::super::config::ConnectionConfig;
use super::dialogue::{self, ScannerMessage, Sockets};
use super::io::Io;
use super::{
    Connection, DATA_WITHIN, KEEP_ALIVE, Numbers, Owner, Refusal, RequestedAssembly, RequestedConnection,
    Step,
};
use crate::cip::{Extended, General, KeyMismatch, Path, Reply, service};
use crate::connection::{
    CloseRequest, ConnectionData, ConnectionType, OpenReply, OpenRequest, Parameters, Transport,
};
use crate::encapsulation::{Command, Header, Status};
use core::net::SocketAddrV4;
use machine::Instant;
use machine::{Down, DownCause, LinkEvent};

/// The shortest interval that is accepted from an adapter: its reply alone decides how often the scanner sends.
const LEAST_INTERVAL_US: u32 = 100;

/// Largest ratio of the adapter's interval to the requested one. A connection waits for at least four requested intervals,
/// so that neither watchdog expires.
const MOST_INTERVALS: u32 = 4;

impl Connection {
    fn requested(&self) -> RequestedConnection {
        let config = &self.config;
        RequestedConnection {
            target: config.target,
            described: config.described,
            key: config.key,
            consumed: RequestedAssembly {
                instance: config.consumed,
                connection_size: config.o_t().size,
                format: config.consumed_format,
            },
            produced: RequestedAssembly {
                instance: config.produced,
                connection_size: config.t_o().size,
                format: config.produced_format,
            },
            configuration: config.configuration,
            rpi_us: (config.o_t_rpi_us, config.t_o_rpi_us),
        }
    }

    fn refused(&mut self, now: Instant, reply: &Reply<'_>) {
        let refusal = Refusal::of_reply(reply, self.requested(), self.found);
        (self.refusal, self.conflict) = (Some(refusal), None);
        let is_owned = refusal.extended == Some(Extended::OwnershipConflict);
        // A bridge on the way would answer for itself.
        if is_owned && self.step == Step::Opening && self.config.route.is_empty() {
            return self.enter(now, Step::AskingOwner, ScannerMessage::AskOwner);
        }
        self.report_refusal(now);
    }

    /// Reports the refusal of the last connection, with what was found out about it.
    pub(super) fn report_refusal(&mut self, now: Instant) {
        // There is nothing to close.
        self.step = Step::Idle;
        if let Some(refusal) = self.refusal {
            self.fail(now, refusal.down());
        }
    }

    pub(super) fn handle_message(
        &mut self,
        now: Instant,
        header: &Header,
        data: &[u8],
        numbers: &mut Numbers,
    ) {
        match (self.step, header.command) {
            (Step::Registering, Command::RegisterSession) => {
                if header.status == Status::Success {
                    self.session = header.session;
                    if self.leaving {
                        self.enter(now, Step::Closing, ScannerMessage::Close);
                    } else if self.unreleased {
                        self.enter(now, Step::Releasing, ScannerMessage::Close);
                    } else {
                        self.enter(now, Step::Identifying, ScannerMessage::Identify);
                    }
                } else {
                    let (code, text) = (header.status.into(), header.status.text());
                    self.fail(now, Down { cause: DownCause::Refused, code, text });
                }
            }
            (Step::Running, Command::SendRRData) if self.is_explicit(header) => {
                self.handle_explicit(header, data);
            }
            // An answer to an explicit request whose time is over concerns no cyclic data.
            (step, Command::SendRRData)
                if step != Step::Running && dialogue::number_of(header) == self.request =>
            {
                if header.status != Status::Success && self.step == Step::AskingOwner {
                    return self.report_refusal(now);
                }
                if header.status != Status::Success {
                    let (code, text) = (header.status.into(), header.status.text());
                    return self.fail(now, Down { cause: DownCause::Refused, code, text });
                }
                match dialogue::read_reply(data) {
                    Some((reply, sockets)) => self.handle_reply(now, &reply, sockets, numbers),
                    None => self.counters.malformed += 1,
                }
            }
            _ => self.counters.foreign += 1,
        }
    }

    fn handle_reply(&mut self, now: Instant, reply: &Reply<'_>, sockets: Sockets, numbers: &mut Numbers) {
        match (self.step, reply.service) {
            // A router that cannot reach the adapter refuses the Unconnected_Send; the Forward_Open will say why.
            (Step::Identifying, service::GET_ATTRIBUTES_ALL | service::UNCONNECTED_SEND) => {
                // An adapter that does not report all its attributes may still be the right one.
                self.found = Some(reply.data)
                    .filter(|_| {
                        reply.general == General::Success && reply.service == service::GET_ATTRIBUTES_ALL
                    })
                    .and_then(|data| dialogue::read_identity(data).ok());
                match self.check_identity() {
                    Ok(()) if !self.has_serial_number() => {
                        let text = "the device at the adapter's address has another serial number than listed (the status is \
                                    its number): look whether it was exchanged";
                        let code = self.found.map_or(0, |found| found.serial_number);
                        self.fail(now, Down { cause: DownCause::Refused, code, text });
                    }
                    Ok(()) => self.open(now, numbers),
                    Err(_) => {
                        let mismatch = Reply { general: General::KeyFailure, additional: &[], ..*reply };
                        self.refused(now, &mismatch);
                    }
                }
            }
            (Step::Opening, service::FORWARD_OPEN | service::LARGE_FORWARD_OPEN) => {
                if reply.general != General::Success {
                    return self.refused(now, reply);
                }
                match OpenReply::parse(reply.data) {
                    Ok(opened) if opened.triad == self.numbers.triad && self.is_null => self.opened_null(now),
                    Ok(opened) if opened.triad == self.numbers.triad => self.opened(now, &opened, sockets),
                    _ => self.counters.malformed += 1,
                }
            }
            // An adapter without this service refuses it; then nobody is named.
            (Step::AskingOwner, service::GET_CONNECTION_OWNER) => {
                let owner = Owner::parse(reply.data).filter(|_| reply.general == General::Success);
                self.refusal = self.refusal.map(|refusal| Refusal { owner, ..refusal });
                match owner {
                    Some(_) => self.enter(now, Step::AskingOwner, ScannerMessage::AskOwnerData),
                    None => self.report_refusal(now),
                }
            }
            // How long it may be silent: an adapter without this service refuses it.
            (Step::AskingOwner, service::SEARCH_CONNECTION_DATA) => {
                let data = Some(reply.data).filter(|_| reply.general == General::Success);
                let data = data.and_then(|data| ConnectionData::parse(data).ok());
                if let Some(Refusal { owner: Some(owner), .. }) = &mut self.refusal {
                    owner.o_t = data.filter(|data| data.triad == owner.triad).map(|data| data.o_t);
                }
                self.report_refusal(now);
            }
            // If it was not open, there is nothing to close.
            (Step::Releasing, service::FORWARD_CLOSE) => {
                self.unreleased = false;
                self.enter(now, Step::Identifying, ScannerMessage::Identify);
            }
            (Step::Closing, service::FORWARD_CLOSE) => {
                self.fail(now, Down { cause: DownCause::ClosedHere, code: 0, text: "" });
            }
            _ => self.counters.foreign += 1,
        }
    }

    /// Handles an opened connection: starts to send data, or closes the connection again if the reply contains something
    /// that cannot be served.
    fn opened(&mut self, now: Instant, opened: &OpenReply, sockets: Sockets) {
        if let Err((code, text)) = self.check_opened(opened, sockets) {
            return self.fail(now, Down { cause: DownCause::Refused, code, text });
        }
        let Some(io) = Io::new(now, &self.config, opened, sockets) else {
            let text = "the adapter opened a multicast connection but named no multicast group";
            return self.fail(now, Down { cause: DownCause::Refused, code: 0, text });
        };
        (self.refusal, self.conflict) = (None, None);
        self.granted_us = (opened.o_t_api_us, opened.t_o_api_us);
        self.step = Step::Running;
        self.deadline = Some(now + DATA_WITHIN);
        self.keep_alive_at = Some(now + KEEP_ALIVE);
        self.io = Some(io);
    }

    /// Handles the answer to a null Forward_Open: the adapter took its configuration.
    fn opened_null(&mut self, now: Instant) {
        (self.refusal, self.conflict, self.reported) = (None, None, None);
        (self.step, self.deadline, self.up) = (Step::Running, None, true);
        self.keep_alive_at = Some(now + KEEP_ALIVE);
        self.events.push_back(LinkEvent::Up);
    }

    /// Returns the parameters of a direction: those of a null connection have no type and no size.
    const fn parameters(&self, parameters: Parameters) -> Parameters {
        if self.is_null {
            Parameters { kind: ConnectionType::Null, size: 0, ..parameters }
        } else {
            parameters
        }
    }

    /// Checks the packet intervals and the receiver that the adapter names; returns a status and what is wrong.
    fn check_opened(&self, opened: &OpenReply, sockets: Sockets) -> Result<(), (u32, &'static str)> {
        let config = &self.config;
        let most = |requested: u32| requested.saturating_mul(MOST_INTERVALS).max(LEAST_INTERVAL_US);
        if opened.o_t_api_us < LEAST_INTERVAL_US {
            return Err((
                opened.o_t_api_us,
                "the adapter wants its data more often than every 100 µs (the status is its interval, in µs): ask for \
                 another one, or look at its answer in a capture",
            ));
        }
        let intervals = [(opened.o_t_api_us, config.o_t_rpi_us), (opened.t_o_api_us, config.t_o_rpi_us)];
        if let Some((code, _)) =
            intervals.into_iter().find(|(api, requested)| *api == 0 || *api > most(*requested))
        {
            return Err((
                code,
                "the adapter's packet interval is 0, or more than four times as long as asked (the status is its \
                 interval, in µs): ask for another one, or look at its answer in a capture",
            ));
        }
        let third = |socket: SocketAddrV4| !socket.ip().is_unspecified() && *socket.ip() != config.target;
        match sockets.o_t.filter(|socket| third(*socket)) {
            Some(socket) => Err((
                socket.ip().to_bits(),
                "the adapter wants its data to be sent to another host (the status is its address), which this scanner \
                 does not: connect to that host itself",
            )),
            None => Ok(()),
        }
    }

    /// Checks whether the device is the configured one, before a connection is opened.
    fn check_identity(&self) -> Result<(), KeyMismatch> {
        match (&self.config.key, &self.found) {
            (Some(key), Some(found)) => key.check(&found.key),
            _ => Ok(()),
        }
    }

    /// Returns whether the device has the required serial number, if one is required.
    fn has_serial_number(&self) -> bool {
        let found = self.found.map(|found| found.serial_number);
        self.config.serial_number.is_none_or(|wanted| found == Some(wanted))
    }

    fn open(&mut self, now: Instant, numbers: &mut Numbers) {
        numbers.advance();
        self.numbers = *numbers;
        self.enter(now, Step::Opening, ScannerMessage::Open);
    }

    pub(super) fn emit(&mut self, message: ScannerMessage, buf: &mut [u8]) -> Option<usize> {
        self.request = self.request.wrapping_add(1);
        let numbers = (self.session, self.request);
        let path = Path(&self.path);
        let written = match message {
            ScannerMessage::Register | ScannerMessage::Unregister | ScannerMessage::Nop => {
                dialogue::emit_plain(buf, message, self.session)
            }
            ScannerMessage::Identify => {
                let ConnectionConfig { route, request_timeout, .. } = &self.config;
                dialogue::emit_identify(buf, numbers, (route, *request_timeout))
            }
            ScannerMessage::Explicit => {
                let ConnectionConfig { route, request_timeout, .. } = &self.config;
                let explicit = self.explicit.as_mut()?;
                explicit.number = Some(self.request);
                dialogue::emit_explicit(buf, numbers, (route, *request_timeout), |writer| {
                    explicit.emit(writer)
                })
            }
            ScannerMessage::Open => {
                let config = &self.config;
                let request = OpenRequest {
                    o_t_id: 0,
                    t_o_id: self.numbers.t_o_id,
                    triad: self.numbers.triad,
                    multiplier: config.multiplier.code(),
                    o_t_rpi_us: config.o_t_rpi_us,
                    o_t: self.parameters(config.o_t()),
                    t_o_rpi_us: config.t_o_rpi_us,
                    t_o: self.parameters(config.t_o()),
                    transport: Transport::CYCLIC,
                    path,
                };
                dialogue::emit_open(buf, numbers, &request, config.is_large() && !self.is_null)
            }
            ScannerMessage::AskOwner => dialogue::emit_ask_owner(buf, numbers, &path),
            ScannerMessage::AskOwnerData => {
                let triad = self.refusal.and_then(|refusal| refusal.owner)?.triad;
                dialogue::emit_ask_data(buf, numbers, triad)
            }
            ScannerMessage::Close => {
                dialogue::emit_close(buf, numbers, &CloseRequest { triad: self.numbers.triad, path })
            }
        };
        if message == ScannerMessage::Unregister {
            self.session = 0;
        }
        written.ok()
    }
}
