//! The message router: finds the object of a request. The Connection Manager's own services are here.

use super::establish::in_their_places;
use super::open_report::OpenReport;
use super::state::{Context, State};
use crate::cip::{
    General, Path, PathError, Request, Segment, Violation, class, emit_refusal, emit_reply, service,
};
use crate::connection::{CloseReply, CloseRequest, OpenRequest, RefusedReply};
use crate::objects::{multiple_service, serve};
use crate::{Reader, Writer, objects};
use machine::{Down, DownCause, Requested};

/// Largest nesting of services: Unconnected_Send, Multiple_Service, and one service.
const MAX_DEPTH: u8 = 2;

impl State {
    /// Answers a request. Returns the reply's length, 0 if there is no room for a reply.
    pub(super) fn route(&mut self, context: &mut Context, message: &[u8], reply: &mut [u8]) -> usize {
        let request = match Request::parse(message) {
            Ok(request) => request,
            Err((service, violation)) => return emit_refusal(reply, service, violation, |_| {}),
        };
        let target = match request.path.target() {
            Ok(target) => target,
            Err(violation) => return emit_refusal(reply, request.service, violation, |_| {}),
        };
        let data = request.data;
        match (target.class, target.instance, request.service) {
            (Some(class::MESSAGE_ROUTER), Some(1), service::MULTIPLE_SERVICE) => {
                if context.depth >= MAX_DEPTH {
                    return emit_refusal(reply, request.service, Violation::NestedTooDeep, |_| {});
                }
                // A Multiple_Service within another is not allowed.
                context.depth = MAX_DEPTH;
                multiple_service(data, reply, |one, reply| self.route(context, one, reply))
            }
            (Some(class::CONNECTION_MANAGER), Some(1), service) => match service {
                service::FORWARD_OPEN => self.forward_open(context, data, service, reply),
                service::LARGE_FORWARD_OPEN => self.forward_open(context, data, service, reply),
                service::FORWARD_CLOSE => self.forward_close(context, data, reply),
                service::GET_CONNECTION_DATA
                | service::SEARCH_CONNECTION_DATA
                | service::GET_CONNECTION_OWNER => emit_reply(reply, service, |writer| {
                    self.diagnose(service, data, writer)?;
                    Ok(General::Success)
                }),
                service::UNCONNECTED_SEND => self.unconnected_send(context, data, reply),
                _ => self.serve(context, &request, target, reply),
            },
            _ => self.serve(context, &request, target, reply),
        }
    }

    fn serve(
        &mut self,
        context: &Context,
        request: &Request<'_>,
        target: crate::cip::Target,
        reply: &mut [u8],
    ) -> usize {
        let host = *context.peer.ip();
        let is_foreign = self.io.is_foreign(host);
        self.device.locked = is_foreign;
        let mut is_refused = false;
        let len = emit_reply(reply, request.service, |writer| {
            let served = serve(&mut self.device, target, request.service, request.data, writer);
            is_refused = matches!(served, Err(Violation::InUse | Violation::NotSettable));
            served
        });
        if is_refused && is_foreign {
            let what = if request.service == service::RESET { Requested::Reset } else { Requested::Write };
            self.refuse_foreign(context.now, host, what, self.io.owner_besides(host));
        }
        len
    }

    fn forward_open(&mut self, context: &mut Context, data: &[u8], service: u8, reply: &mut [u8]) -> usize {
        let large = service == service::LARGE_FORWARD_OPEN;
        let host = *context.peer.ip();
        let request = OpenRequest::parse(data, large);
        let result = request.and_then(|request| self.open(context, &request));
        let points = |request: &OpenRequest<'_>| {
            request.path.application().map_or([None; 3], |application| in_their_places(application.points))
        };
        let asked =
            request.as_ref().map(|request| (request, points(request))).map_err(|violation| *violation);
        if let Some(report) = OpenReport::new(host, asked, result.err()) {
            self.last_open = Some(report);
        }
        let owner = self.io.owner_besides(host);
        let (is_foreign, owner) = match result {
            Err(Violation::OutputsOwned) => (self.io.is_foreign(host), owner),
            Err(Violation::OriginatorNotListed) => (true, None),
            _ => (false, None),
        };
        if is_foreign {
            self.refuse_foreign(context.now, host, Requested::Connection, owner);
        }
        self.device.manager.opened(result.err());
        match result {
            Ok(opened) => emit_reply(reply, service, |writer| {
                opened.emit(writer);
                Ok(General::Success)
            }),
            Err(violation) => emit_refusal(reply, service, violation, |writer| {
                let path_left = if is_of_route(violation) { open_path_words(data, large) } else { 0 };
                let refused = RefusedReply::from_open_request(data);
                write_refused(writer, refused.map(|refused| RefusedReply { path_left, ..refused }));
            }),
        }
    }

    fn forward_close(&mut self, context: &Context, data: &[u8], reply: &mut [u8]) -> usize {
        let result = CloseRequest::parse(data).and_then(|request| self.close(context, &request));
        self.device.manager.closed(result.err());
        match result {
            Ok(closed) => emit_reply(reply, service::FORWARD_CLOSE, |writer| {
                closed.emit(writer);
                Ok(General::Success)
            }),
            Err(violation) => emit_refusal(reply, service::FORWARD_CLOSE, violation, |writer| {
                write_refused(writer, RefusedReply::from_close_request(data));
            }),
        }
    }

    fn close(&mut self, context: &Context, request: &CloseRequest<'_>) -> Result<CloseReply, Violation> {
        let CloseRequest { triad, path } = *request;
        let host = *context.peer.ip();
        if let Some(connection) = self.io.find_of(host, &triad) {
            let points = path.application().map_err(|_| Violation::ForwardClosePath)?.points;
            if !path.0.is_empty() && !same_points(points, connection.points) {
                return Err(Violation::ForwardClosePath);
            }
            self.io.remove(context.now, host, &triad);
            let down = Down { cause: DownCause::ClosedByPeer, code: 0, text: "by a Forward_Close" };
            self.follow_owner(Some(down));
            return Ok(CloseReply { triad });
        }
        let is_open = self.explicit.find_of(host, &triad).is_some();
        if is_open && !path.0.is_empty() {
            let application = path.application().map_err(|_| Violation::ForwardClosePath)?;
            if !application.is_message_router() {
                return Err(Violation::ForwardClosePath);
            }
        }
        // By any TCP connection of the host: the one that opened it may be dead, and only this end does not know it yet.
        if !self.explicit.remove_of(host, &triad) {
            let cyclic = self.io.find(&triad).map(|connection| connection.originator);
            let explicit = self.explicit.find(&triad).map(|connection| connection.host);
            let Some(owner) = cyclic.or(explicit) else { return Err(Violation::ConnectionNotFound) };
            self.refuse_foreign(context.now, host, Requested::End, Some(owner));
            return Err(Violation::ForeignOriginator);
        }
        Ok(CloseReply { triad })
    }

    /// Runs the message within, if its route leads to this device (volume 1, 3-5.5.4).
    ///
    /// ```text
    /// 0     priority and time tick  u8
    /// 1     timeout ticks           u8
    /// 2..4  message size            u16, bytes
    /// 4..   message, and a zero byte where its size is odd
    /// ..    route path size         u8, words; a zero byte; the route path
    /// ```
    ///
    /// Where the route cannot be followed, the size of what is left of it in words and a zero byte stand behind
    /// the status.
    fn unconnected_send(&mut self, context: &mut Context, data: &[u8], reply: &mut [u8]) -> usize {
        let message = match self.unwrap_unconnected(data) {
            _ if context.depth >= MAX_DEPTH => Err(Violation::NestedTooDeep),
            unwrapped => unwrapped,
        };
        match message {
            Ok(message) => {
                context.depth += 1;
                self.route(context, message, reply)
            }
            Err(violation) => emit_refusal(reply, service::UNCONNECTED_SEND, violation, |writer| {
                // Which router of the route found the error.
                if let Some(words) = route_words(data).filter(|_| is_of_route(violation)) {
                    writer.bytes(&[words, 0]);
                }
            }),
        }
    }

    fn unwrap_unconnected<'a>(&self, data: &'a [u8]) -> Result<&'a [u8], Violation> {
        let mut reader = Reader::new(data);
        let read = |_| Violation::TooShort;
        reader.skip(1).map_err(read)?;
        let ticks = reader.u8().map_err(read)?;
        let size = reader.u16().map_err(read)?;
        let message = reader.bytes(size.into()).map_err(read)?;
        reader.skip(usize::from(size) % 2).map_err(read)?;
        let words = reader.u8().map_err(read)?;
        reader.skip(1).map_err(read)?;
        let route = Path(reader.bytes(2 * usize::from(words)).map_err(read)?);
        if !reader.is_empty() {
            return Err(Violation::TooLong);
        }
        if message.is_empty() {
            return Err(Violation::UnconnectedParameter);
        }
        if ticks == 0 {
            return Err(Violation::UnconnectedTimeout);
        }
        for segment in route.segments() {
            self.check_route(segment)?;
        }
        Ok(message)
    }

    /// Checks that a segment of a route leads to this device itself.
    fn check_route(&self, segment: Result<Segment<'_>, PathError>) -> Result<(), Violation> {
        let Ok(Segment::Port { port, link }) = segment else { return Err(Violation::InvalidSegmentInPath) };
        if port != objects::PORT_NUMBER {
            return Err(Violation::InvalidPort);
        }
        let address =
            core::str::from_utf8(link).ok().and_then(|link| link.trim_end_matches('\0').parse().ok());
        if address == Some(self.device.network.address) { Ok(()) } else { Err(Violation::InvalidLinkAddress) }
    }
}

/// Returns the size of the route in an Unconnected_Send, in words.
fn route_words(data: &[u8]) -> Option<u8> {
    let mut reader = Reader::new(data);
    reader.skip(2).ok()?;
    let size = usize::from(reader.u16().ok()?);
    reader.skip(size + size % 2).ok()?;
    reader.u8().ok()
}

/// Returns the size of the path in a Forward_Open, in words.
fn open_path_words(data: &[u8], large: bool) -> u8 {
    data.get(if large { 39 } else { 35 }).copied().unwrap_or(0)
}

/// Returns whether a request got no further along its route (volume 1, 3-5.5.2 and 3-5.5.4).
const fn is_of_route(violation: Violation) -> bool {
    matches!(
        violation,
        Violation::UnconnectedTimeout
            | Violation::InvalidPort
            | Violation::InvalidLinkAddress
            | Violation::InvalidSegmentInPath
    )
}

fn write_refused(writer: &mut Writer<'_>, refused: Option<RefusedReply>) {
    if let Some(refused) = refused {
        refused.emit(writer);
    }
}

/// Returns whether a Forward_Close names the assemblies that were opened; the configuration may be left out.
fn same_points(named: [Option<u32>; 3], opened: [Option<u32>; 3]) -> bool {
    let [_, consumed, produced] = opened;
    named == opened || named == [consumed, produced, None]
}
