//! Checks requests to open a class 3 connection, and opens it (volume 1, 3-5.5.2 and 3-6.2).

use super::Room;
use super::establish::micros;
use super::explicit::{ExplicitConnection, MAX_SIZE};
use super::state::{Context, State};
use crate::cip::{Application, Violation};
use crate::class1::SEQUENCE_LEN;
use crate::connection::{ConnectionType, OpenReply, OpenRequest, Priority, TimeoutMultiplier, Watchdog};

/// The longest packet interval of a class 3 connection, in µs: its timeout is at most 512 times that.
const MAX_EXPLICIT_RPI_US: u32 = 100_000_000;

impl State {
    /// Opens a class 3 connection to the Message Router.
    pub(super) fn open_explicit(
        &mut self,
        context: &Context,
        request: &OpenRequest<'_>,
        multiplier: TimeoutMultiplier,
        application: &Application<'_>,
    ) -> Result<OpenReply, Violation> {
        let OpenRequest { triad, t_o_id, o_t_rpi_us, o_t, t_o_rpi_us, t_o, transport, .. } = *request;
        if !transport.is_server() {
            return Err(Violation::DirectionNotSupported);
        }
        if !application.is_message_router() {
            return Err(Violation::ApplicationPath);
        }
        if o_t.kind != ConnectionType::PointToPoint {
            return Err(Violation::OtType);
        }
        if t_o.kind != ConnectionType::PointToPoint {
            return Err(Violation::ToType);
        }
        if o_t.priority == Priority::Urgent {
            return Err(Violation::OtPriority);
        }
        if t_o.priority == Priority::Urgent {
            return Err(Violation::ToPriority);
        }
        let sizes = SEQUENCE_LEN + 2..=MAX_SIZE;
        if !sizes.contains(&o_t.size) {
            return Err(Violation::OtSize(MAX_SIZE));
        }
        if !sizes.contains(&t_o.size) {
            return Err(Violation::ToSize(MAX_SIZE));
        }
        let served = 1..=MAX_EXPLICIT_RPI_US;
        if !served.contains(&o_t_rpi_us) || !served.contains(&t_o_rpi_us) {
            return Err(Violation::RpiNotSupported);
        }
        let host = *context.peer.ip();
        match self.explicit.room(host) {
            Room::Free => {}
            Room::Taken if self.io.is_preferred(context.now, host) => {
                let Self { explicit, io, .. } = self;
                let stream = explicit.give_way(host, |host| io.is_preferred(context.now, host));
                if stream.is_none() {
                    return Err(Violation::OutOfConnections);
                }
                self.end_unused(stream);
            }
            Room::Taken | Room::Used => return Err(Violation::OutOfConnections),
        }
        let o_t_id = self.fresh_id();
        let data = request.data(self.fresh_number(), multiplier, (o_t_id, t_o_id), t_o_rpi_us);
        self.explicit.add(ExplicitConnection {
            data,
            triad,
            host,
            stream: context.stream,
            o_t_id,
            t_o_id,
            o_t_size: o_t.size,
            t_o_size: t_o.size,
            watchdog: Watchdog::start(context.now, multiplier.timeout(micros(o_t_rpi_us))),
        });
        Ok(OpenReply { o_t_id, t_o_id, triad, o_t_api_us: o_t_rpi_us, t_o_api_us: t_o_rpi_us })
    }
}
