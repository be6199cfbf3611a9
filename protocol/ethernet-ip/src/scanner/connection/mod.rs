//! One connection of a scanner: its TCP connection and session, its establishment, and its cyclic data.

mod advice;
mod conflicts;
mod dialogue;
mod establish;
mod explicit;
mod io;
mod owner;
mod refusal;

pub use explicit::{ExplicitAnswer, ExplicitError};
pub use refusal::{Owner, Refusal, RequestedAssembly, RequestedConnection};

use alloc::boxed::Box;
use alloc::collections::VecDeque;
use alloc::vec;
use alloc::vec::Vec;
use core::net::{Ipv4Addr, SocketAddrV4};

use machine::{
    Attempt, Counters, Down, DownCause, Duration, Instant, LinkEvent, Port, StreamId, StreamRequest, Transmit,
};

use self::dialogue::ScannerMessage;
use self::explicit::Explicit;
use self::io::Io;
use super::config::ConnectionConfig;
use super::conflict::{Asker, Conflict, Target};
use crate::class1::Frame;
use crate::connection::Triad;
use crate::description::Identity;
use crate::encapsulation::{Message, Reassembly};
use crate::{ENCAPSULATION_PORT, IO_PORT};

/// Time between NOPs on a session without requests. Adapters end silent sessions after 120 s.
const KEEP_ALIVE: Duration = Duration::from_secs(30);

/// Time from the adapter's answer to a Forward_Open until its missing data are reported. The connection itself waits for the
/// first frame for 10 s or longer (volume 1, 3-4.6.2), and for ever for an adapter that is idle. Assumed.
const DATA_WITHIN: Duration = Duration::from_secs(2);

/// The adapter's frames say that it is idle.
const IDLE: Down =
    Down { cause: DownCause::PeerIdle, code: 0, text: "the adapter's program does not run; set it to run" };

/// The adapter's frames do not come.
const NO_FRAME: Down = Down {
    cause: DownCause::NoAnswer,
    code: 0,
    text: "the adapter accepted the connection and has sent no frame yet: look at UDP port 2222 and firewalls on the way",
};

/// The last numbers given to a connection: no two connections of a scanner have the same at a time.
#[derive(Clone, Copy, Debug)]
pub(super) struct Numbers {
    /// The last connection serial number, with the scanner's own numbers.
    pub(super) triad: Triad,
    /// The last connection number T→O.
    pub(super) t_o_id: u32,
}

impl Numbers {
    fn advance(&mut self) {
        self.triad.connection_serial = self.triad.connection_serial.wrapping_add(1);
        self.t_o_id = self.t_o_id.wrapping_add(1).max(1);
    }
}

/// Step of the establishment. Each step but the first and the last waits for an answer.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Step {
    /// Waits for the next attempt, or for ever after a disconnect.
    Idle,
    /// Asks who has the adapter's address.
    Asking,
    Connecting,
    Registering,
    Releasing,
    Identifying,
    Opening,
    /// The outputs have an owner: asks for it, to name it.
    AskingOwner,
    Running,
    Closing,
}

/// A connection to an adapter. After each failure it reports the reason and, after a pause, starts over.
#[derive(Debug)]
pub struct Connection {
    config: ConnectionConfig,
    attempt: Attempt,
    path: Vec<u8>,
    step: Step,
    /// Deadline of the answer, or start of the next attempt.
    deadline: Option<Instant>,
    stream: Option<StreamId>,
    reassembly: Option<Reassembly>,
    session: u32,
    /// Number of the last request.
    request: u32,
    to_send: VecDeque<(StreamId, ScannerMessage)>,
    connect: bool,
    to_close: VecDeque<StreamId>,
    keep_alive_at: Option<Instant>,
    /// Whether it connects only to close the connection that is still open.
    leaving: bool,
    /// Numbers of the connection that was opened last.
    numbers: Numbers,
    /// Whether the adapter may still hold the connection that was opened last, because an attempt failed before the answer
    /// came, or could not close it. Until the adapter's watchdog expires, it occupies a place that the next attempt may need.
    unreleased: bool,
    io: Option<Io>,
    /// True for a null connection: its Forward_Open configures the adapter and opens nothing.
    is_null: bool,
    run: bool,
    output: Box<[u8]>,
    input: Box<[u8]>,
    found: Option<Identity>,
    /// Explicit request of the owner, until its answer is taken.
    explicit: Option<Box<Explicit>>,
    refusal: Option<Refusal>,
    /// The intervals O→T and T→O in µs that the adapter granted.
    granted_us: (u32, u32),
    /// Who has the adapter's address, where that is asked.
    target: Option<Target>,
    conflict: Option<Conflict>,
    up: bool,
    /// The last failure reported, which is not reported twice.
    reported: Option<Down>,
    events: VecDeque<LinkEvent>,
    counters: Counters,
}

impl Connection {
    pub(super) fn new(
        config: ConnectionConfig,
        attempt: Attempt,
        numbers: Numbers,
        start: Instant,
        own: Option<Asker>,
    ) -> Self {
        let zeros = |len: u16| vec![0; usize::from(len)].into_boxed_slice();
        Self {
            path: config.path(),
            attempt,
            step: Step::Idle,
            deadline: Some(start),
            stream: None,
            reassembly: Some(Reassembly::default()),
            session: 0,
            request: 0,
            to_send: VecDeque::with_capacity(8),
            connect: false,
            to_close: VecDeque::with_capacity(8),
            keep_alive_at: None,
            leaving: false,
            numbers,
            unreleased: false,
            io: None,
            is_null: false,
            run: true,
            output: zeros(config.o_t_size),
            input: zeros(config.t_o_size),
            found: None,
            explicit: None,
            refusal: None,
            granted_us: (0, 0),
            target: own.and_then(|own| Target::new(own, config.target)),
            conflict: None,
            up: false,
            reported: None,
            events: VecDeque::with_capacity(8),
            counters: Counters::default(),
            config,
        }
    }

    fn enter(&mut self, now: Instant, step: Step, message: ScannerMessage) {
        self.step = step;
        let ConnectionConfig { open_timeout, request_timeout, .. } = self.config;
        self.deadline = Some(now + if step == Step::Opening { open_timeout } else { request_timeout });
        self.queue(message);
    }

    fn queue(&mut self, message: ScannerMessage) {
        if let Some(stream) = self.stream {
            self.to_send.push_back((stream, message));
        }
    }

    fn connect(&mut self, now: Instant) {
        self.step = Step::Connecting;
        self.deadline = Some(now + self.config.request_timeout);
        self.connect = true;
    }

    /// Closes the connection and the session without waiting for answers, so that the adapter need not wait for its timeout.
    fn abandon(&mut self) {
        if matches!(self.step, Step::Opening | Step::Running) && !self.is_null {
            self.queue(ScannerMessage::Close);
        }
        if self.session != 0 {
            self.queue(ScannerMessage::Unregister);
        }
        self.to_close.extend(self.stream.take());
        self.io = None;
        self.keep_alive_at = None;
        self.step = Step::Idle;
        self.give_up_explicit();
    }

    /// Handles a connection that was lost or could not be established: the scanner starts again later.
    fn fail(&mut self, now: Instant, down: Down) {
        let ended = self.leaving;
        let may_be_open = self.step == Step::Opening || self.step == Step::Running && self.stream.is_none();
        if may_be_open && !ended && !self.is_null {
            self.unreleased = true;
        } else if self.step == Step::Releasing {
            // An adapter that cannot close it must not stop each later attempt; its own watchdog ends the connection.
            self.unreleased = false;
        }
        self.abandon();
        self.deadline = (!ended).then_some(now + self.config.retry_after);
        let down = if ended { Down { cause: DownCause::ClosedHere, code: 0, text: "" } } else { down };
        self.up = false;
        if self.reported.replace(down) != Some(down) {
            self.events.push_back(LinkEvent::Down(down));
        }
    }

    fn no_answer(&mut self, now: Instant) {
        if self.step == Step::AskingOwner {
            return self.report_refusal(now);
        }
        let text = match self.step {
            Step::Connecting => {
                "TCP port 44818 of the adapter does not answer; is it on and on this network?"
            }
            Step::Registering => "the adapter did not answer RegisterSession",
            Step::Releasing => "the adapter did not answer the Forward_Close of an earlier attempt",
            Step::Identifying => "the adapter did not answer the question for its identity",
            _ => "the adapter did not answer the Forward_Open",
        };
        self.fail(now, Down { cause: DownCause::NoAnswer, code: 0, text });
    }

    fn follow_io(&mut self) {
        let good = self.io.as_ref().is_some_and(|io| io.good);
        if good && !self.up {
            self.up = true;
            self.deadline = None;
            self.reported = None;
            self.events.push_back(LinkEvent::Up);
        } else if !good && self.up {
            self.up = false;
            self.reported = Some(IDLE);
            self.events.push_back(LinkEvent::Down(IDLE));
        }
    }

    /// Reports that an open connection has brought no data yet; it stays open.
    fn report_no_data(&mut self) {
        self.deadline = None;
        let down = if self.io.as_ref().is_some_and(|io| io.is_heard) { IDLE } else { NO_FRAME };
        if self.reported.replace(down) != Some(down) {
            self.events.push_back(LinkEvent::Down(down));
        }
    }

    /// Returns the adapter's address.
    pub(super) const fn target(&self) -> Ipv4Addr {
        self.config.target
    }

    /// Returns the sender and the connection number of the cyclic frames that are for this connection, while it is open.
    pub(super) fn consumed(&self) -> Option<(Ipv4Addr, u32)> {
        self.io.as_ref().map(|io| (self.config.target, io.t_o_id()))
    }

    /// Handles a cyclic frame.
    pub(super) fn handle_io(&mut self, now: Instant, frame: &Frame<'_>) {
        if let Some(io) = &mut self.io {
            io.receive(now, frame, &mut self.input, &mut self.counters);
            self.follow_io();
        }
    }

    /// Returns its TCP connection, while it has one.
    pub(super) const fn stream(&self) -> Option<StreamId> {
        self.stream
    }

    /// Handles bytes of its TCP connection.
    pub(super) fn handle_bytes(&mut self, now: Instant, bytes: &[u8], numbers: &mut Numbers) {
        // Taken out while its messages are handled, then put back.
        let Some(mut reassembly) = self.reassembly.take() else { return };
        let taken = reassembly.push(bytes).is_ok();
        while let Some(message) = reassembly.next_message() {
            match message {
                Message::Whole(header, data) => self.handle_message(now, &header, data, numbers),
                Message::TooLong(_) => self.counters.malformed += 1,
            }
        }
        self.reassembly = Some(reassembly);
        if !taken {
            let text = "the adapter sent more than a message over TCP that makes no sense";
            self.fail(now, Down { cause: DownCause::ClosedHere, code: 0, text });
        }
    }

    /// Handles the requested TCP connection, which is up now. Returns whether the connection still needs it.
    pub(super) fn handle_connected(&mut self, now: Instant, stream: StreamId) -> bool {
        if self.step != Step::Connecting || self.stream.is_some() {
            return false;
        }
        self.stream = Some(stream);
        self.session = 0;
        if let Some(reassembly) = &mut self.reassembly {
            reassembly.clear();
        }
        self.enter(now, Step::Registering, ScannerMessage::Register);
        true
    }

    /// Handles a requested TCP connection that could not be made.
    pub(super) fn handle_not_connected(&mut self, now: Instant) {
        if self.step == Step::Connecting {
            self.no_answer(now);
        }
    }

    /// Handles the end of its TCP connection.
    pub(super) fn handle_closed(&mut self, now: Instant) {
        self.stream = None;
        self.session = 0;
        match self.step {
            // Cyclic data does not need the session: the watchdog tells whether the adapter is gone.
            Step::Running if !self.is_null => {
                self.keep_alive_at = None;
                self.give_up_explicit();
            }
            Step::AskingOwner => self.report_refusal(now),
            _ => {
                let text = "the adapter ended the TCP connection";
                self.fail(now, Down { cause: DownCause::ClosedByPeer, code: 0, text });
            }
        }
    }

    pub(super) fn poll_stream(&mut self) -> Option<StreamRequest> {
        if let Some(stream) = self.to_close.pop_front() {
            return Some(StreamRequest::Close(stream));
        }
        let to = SocketAddrV4::new(self.config.target, ENCAPSULATION_PORT);
        core::mem::take(&mut self.connect).then_some(StreamRequest::Connect { to, attempt: self.attempt })
    }

    /// Returns the multicast group that its T→O frames go to.
    pub(super) fn group(&self) -> Option<Ipv4Addr> {
        self.io.as_ref()?.group
    }

    pub(super) fn handle_timeout(&mut self, now: Instant) {
        self.follow_question(now);
        if self.io.as_ref().is_some_and(|io| io.expired(now)) {
            let text = "the adapter sent nothing for as long as the timeout allows";
            self.fail(now, Down { cause: DownCause::Watchdog, code: 0, text });
        }
        if self.explicit.is_some() && self.explicit_until().is_some_and(|until| now >= until) {
            self.give_up_explicit();
        }
        if self.keep_alive_at.is_some_and(|at| now >= at) {
            self.keep_alive_at = Some(now + KEEP_ALIVE);
            self.queue(ScannerMessage::Nop);
        }
        if self.deadline.is_some_and(|deadline| now >= deadline) {
            match self.step {
                Step::Idle => self.begin(now),
                Step::Running => self.report_no_data(),
                _ => self.no_answer(now),
            }
        }
    }

    /// Writes the cyclic frame that is due, if one is.
    pub(super) fn poll_io(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        let (to, len) = self.io.as_mut()?.produce(now, self.run, &self.output, buf)?;
        self.counters.sent += 1;
        Some(Transmit { port: Port::Udp(IO_PORT), to: Some(to), len })
    }

    /// Writes the next message over TCP.
    pub(super) fn poll_message(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        if let Some(len) = self.target.as_mut().and_then(|target| target.holders.poll_transmit(now, buf)) {
            return Some(Transmit { port: Port::Ethernet, to: None, len });
        }
        while let Some((stream, message)) = self.to_send.pop_front() {
            if let Some(len) = self.emit(message, buf) {
                return Some(Transmit { port: Port::Stream(stream), to: None, len });
            }
        }
        None
    }

    /// Returns whether [`poll_message`](Self::poll_message) may have something to send.
    pub(super) fn has_message(&self) -> bool {
        let asks = self.target.as_ref().is_some_and(|target| target.holders.poll_timeout().is_some());
        asks || !self.to_send.is_empty()
    }

    /// Returns whether it wants to make or to close a TCP connection.
    pub(super) fn has_stream_request(&self) -> bool {
        self.connect || !self.to_close.is_empty()
    }

    /// Returns whether an event is waiting.
    pub(super) fn has_event(&self) -> bool {
        !self.events.is_empty()
    }

    pub(super) fn poll_event(&mut self) -> Option<LinkEvent> {
        self.events.pop_front()
    }

    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        let io = self.io.as_ref().map(Io::next_timeout);
        let question = self.target.as_ref().and_then(|target| target.holders.poll_timeout());
        let mut deadlines = Instant::earlier(self.deadline, self.keep_alive_at);
        if self.explicit.is_some() {
            deadlines = Instant::earlier(deadlines, self.explicit_until());
        }
        Instant::earlier(Instant::earlier(deadlines, question), io)
    }
}
