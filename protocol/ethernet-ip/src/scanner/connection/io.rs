//! The cyclic side of a scanner's connection.

use core::net::{Ipv4Addr, SocketAddrV4};

use super::super::config::ConnectionConfig;
use super::dialogue::Sockets;
use crate::IO_PORT;
use crate::class1::{self, Frame};
use crate::connection::{OpenReply, RealTimeFormat, Watchdog, sequence};
use machine::Counters;
use machine::{Cycle, Duration, Instant, Sequence};

/// A connection that is open.
#[derive(Debug)]
pub(super) struct Io {
    o_t_id: u32,
    t_o_id: u32,
    to: SocketAddrV4,
    cycle: Cycle,
    sequence: u32,
    count: u16,
    check: Sequence,
    watchdog: Watchdog,
    /// Bytes behind the sequence count of a T→O frame.
    t_o_len: usize,
    produced_format: RealTimeFormat,
    consumed_format: RealTimeFormat,
    /// The multicast group that T→O frames go to.
    pub(super) group: Option<Ipv4Addr>,
    /// Whether good data of the adapter has arrived.
    pub(super) good: bool,
    /// Whether any frame of it has arrived.
    pub(super) is_heard: bool,
}

impl Io {
    /// Creates the cyclic part from the adapter's reply; `None` if the reply lacks a multicast group that it should name.
    pub(super) fn new(
        now: Instant,
        config: &ConnectionConfig,
        opened: &OpenReply,
        sockets: Sockets,
    ) -> Option<Self> {
        let micros = |micros: u32| Duration::from_micros(micros.into());
        let format = config.produced_format;
        // The adapter may name another port than the usual one.
        let port = sockets.o_t.map(|socket| socket.port()).filter(|port| *port != 0);
        let to = SocketAddrV4::new(config.target, port.unwrap_or(IO_PORT));
        let group = sockets.t_o.map(|socket| *socket.ip()).filter(Ipv4Addr::is_multicast);
        if config.multicast && group.is_none() {
            return None;
        }
        Some(Self {
            o_t_id: opened.o_t_id,
            t_o_id: opened.t_o_id,
            to,
            cycle: Cycle::new(now, micros(opened.o_t_api_us)),
            sequence: 0,
            count: 0,
            check: sequence(micros(opened.t_o_api_us)),
            watchdog: Watchdog::start(now, config.multiplier.timeout(micros(opened.t_o_api_us))),
            t_o_len: usize::from(format.header_len()) + usize::from(format.data_len(config.t_o_size)),
            produced_format: format,
            consumed_format: config.consumed_format,
            group: group.filter(|_| config.multicast),
            good: false,
            is_heard: false,
        })
    }

    /// Returns the connection number of the frames that it receives.
    pub(super) const fn t_o_id(&self) -> u32 {
        self.t_o_id
    }

    pub(super) fn next_timeout(&self) -> Instant {
        self.cycle.next().min(self.watchdog.deadline())
    }

    pub(super) fn expired(&self, now: Instant) -> bool {
        self.watchdog.expired(now)
    }

    /// Handles a frame and copies its data to `input`.
    pub(super) fn receive(
        &mut self,
        now: Instant,
        frame: &Frame<'_>,
        input: &mut [u8],
        counters: &mut Counters,
    ) {
        let is_whole = frame.payload.len() == self.t_o_len;
        let is_idle = self.produced_format == RealTimeFormat::ZeroLength && frame.payload.is_empty();
        if !(is_whole || is_idle) {
            counters.malformed += 1;
            return;
        }
        let Some(ahead) = self.check.accept(now, frame.sequence) else {
            counters.late += 1;
            return;
        };
        let split = match self.produced_format {
            RealTimeFormat::RunIdleHeader => frame.run_and_data(),
            _ => Ok((is_whole, frame.payload)),
        };
        let Ok((run, data)) = split else {
            counters.malformed += 1;
            return;
        };
        self.watchdog.feed(now);
        counters.received += 1;
        counters.lost += u64::from(ahead.saturating_sub(1));
        (self.good, self.is_heard) = (run, true);
        if let Some(input) = input.get_mut(..data.len()) {
            input.copy_from_slice(data);
        }
    }

    /// Writes the frame that is due. Returns its receiver and length.
    pub(super) fn produce(
        &mut self,
        now: Instant,
        run: bool,
        data: &[u8],
        buf: &mut [u8],
    ) -> Option<(SocketAddrV4, usize)> {
        self.cycle.tick(now)?;
        self.sequence = self.sequence.wrapping_add(1);
        self.count = self.count.wrapping_add(1);
        let numbers = (self.o_t_id, self.sequence, self.count);
        let (header, data) = match self.consumed_format {
            RealTimeFormat::RunIdleHeader => (Some(run), data),
            RealTimeFormat::ZeroLength if !run => (None, &[][..]),
            RealTimeFormat::Heartbeat => (None, &[][..]),
            RealTimeFormat::Modeless | RealTimeFormat::ZeroLength => (None, data),
        };
        let len = class1::emit(buf, numbers, header, data).ok()?;
        Some((self.to, len))
    }
}
