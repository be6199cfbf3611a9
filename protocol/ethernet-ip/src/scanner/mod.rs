//! The scanner: the originator that the PLC node is.
//!
//! It connects over TCP, registers a session, reads who the adapter is, opens the connection, and exchanges cyclic
//! frames. Whatever goes wrong on the way, it says why and begins anew after a while.

mod config;
mod dialogue;
mod establish;
mod io;
mod refusal;

pub use config::ScannerConfig;
pub use refusal::{Asked, Refusal};

use alloc::boxed::Box;
use alloc::collections::VecDeque;
use alloc::vec;
use alloc::vec::Vec;
use core::fmt;
use core::net::{Ipv4Addr, SocketAddrV4};

use self::dialogue::Say;
use self::io::Io;
use super::class1::Frame;
use super::connection::Triad;
use super::description::Identity;
use super::encapsulation::{Message, Reassembly};
use super::objects::Qos;
use super::{ENCAPSULATION_PORT, IO_PORT};
use crate::{IO_DATA_LEN, IoData};
use machine::{Counters, Down, DownCause, LinkEvent};
use machine::{
    Duration, Instant, Machine, Port, PortRequest, Source, StreamChange, StreamId, StreamRequest, Transmit,
};

/// How often a session without requests shows that it is alive: adapters end silent ones after 120 s.
const KEEP_ALIVE: Duration = Duration::from_secs(30);

/// Where the scanner stands. Each step but the first and the last waits for an answer.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Step {
    /// Waits to begin anew, or for ever after a disconnect.
    Idle,
    Connecting,
    Registering,
    Identifying,
    Opening,
    Running,
    Closing,
}

/// An EtherNet/IP scanner.
#[derive(Debug)]
pub struct Scanner {
    config: ScannerConfig,
    path: Vec<u8>,
    step: Step,
    /// When the answer must be there, or the next attempt begins.
    deadline: Option<Instant>,
    stream: Option<StreamId>,
    reassembly: Option<Reassembly>,
    session: u32,
    /// Number of the last request.
    request: u32,
    to_say: VecDeque<(StreamId, Say)>,
    connect: bool,
    to_close: VecDeque<StreamId>,
    keep_alive_at: Option<Instant>,
    /// Connects only to close what it left open.
    leaving: bool,
    triad: Triad,
    t_o_id: u32,
    io: Option<Io>,
    run: bool,
    output: Box<[u8]>,
    input: IoData,
    found: Option<Identity>,
    refusal: Option<Refusal>,
    up: bool,
    /// The last news of a failure, which is not told twice.
    told: Option<Down>,
    events: VecDeque<LinkEvent>,
    counters: Counters,
}

impl Scanner {
    /// A scanner that begins to connect at `start`.
    #[must_use]
    pub fn new(config: ScannerConfig, start: Instant) -> Self {
        let triad = Triad {
            connection_serial: config.first_id as u16,
            vendor: config.vendor,
            originator_serial: config.serial_number,
        };
        Self {
            path: config.path(),
            step: Step::Idle,
            deadline: Some(start),
            stream: None,
            reassembly: Some(Reassembly::default()),
            session: 0,
            request: 0,
            to_say: VecDeque::with_capacity(8),
            connect: false,
            to_close: VecDeque::with_capacity(8),
            keep_alive_at: None,
            leaving: false,
            triad,
            t_o_id: config.first_id,
            io: None,
            run: true,
            output: vec![0; usize::from(config.o_t_size)].into_boxed_slice(),
            input: [0; IO_DATA_LEN],
            found: None,
            refusal: None,
            up: false,
            told: None,
            events: VecDeque::with_capacity(8),
            counters: Counters::default(),
            config,
        }
    }

    /// Why the adapter refused the last connection, with what it has instead.
    #[must_use]
    pub const fn refusal(&self) -> Option<&Refusal> {
        self.refusal.as_ref()
    }

    /// Who the adapter says it is, once it was asked.
    #[must_use]
    pub const fn identity(&self) -> Option<&Identity> {
        self.found.as_ref()
    }

    /// Whether the frames say that the PLC's program runs (from the start they do) or that it is idle.
    pub const fn set_run(&mut self, run: bool) {
        self.run = run;
    }

    fn enter(&mut self, now: Instant, step: Step, say: Say) {
        self.step = step;
        self.deadline = Some(now + self.config.request_timeout);
        self.say(say);
    }

    fn say(&mut self, say: Say) {
        if let Some(stream) = self.stream {
            self.to_say.push_back((stream, say));
        }
    }

    fn connect(&mut self, now: Instant) {
        self.step = Step::Connecting;
        self.deadline = Some(now + self.config.request_timeout);
        self.connect = true;
    }

    /// Ends what there is without waiting for answers, so that the adapter does not have to run into its timeout.
    fn abandon(&mut self) {
        if matches!(self.step, Step::Opening | Step::Running) {
            self.say(Say::Close);
        }
        if self.session != 0 {
            self.say(Say::Unregister);
        }
        self.to_close.extend(self.stream.take());
        self.io = None;
        self.keep_alive_at = None;
        self.step = Step::Idle;
    }

    /// The connection is lost or did not come about: begin anew later.
    fn fail(&mut self, now: Instant, down: Down) {
        let ended = self.leaving || self.step == Step::Closing;
        self.abandon();
        self.deadline = (!ended).then_some(now + self.config.retry_after);
        let down = if ended { Down { cause: DownCause::ClosedHere, code: 0, text: "" } } else { down };
        self.up = false;
        if self.told.replace(down) != Some(down) {
            self.events.push_back(LinkEvent::Down(down));
        }
    }

    fn no_answer(&mut self, now: Instant) {
        let text = match self.step {
            Step::Connecting => {
                "TCP port 44818 of the adapter does not answer; is it on and on this network?"
            }
            Step::Registering => "the adapter did not answer RegisterSession",
            Step::Identifying => "the adapter did not answer the question for its identity",
            _ => "the adapter did not answer the Forward_Open",
        };
        self.fail(now, Down { cause: DownCause::NoAnswer, code: 0, text });
    }

    fn follow_io(&mut self) {
        let good = self.io.as_ref().is_some_and(|io| io.good);
        if good && !self.up {
            self.up = true;
            self.told = None;
            self.events.push_back(LinkEvent::Up);
        } else if !good && self.up {
            self.up = false;
            let down =
                Down { cause: DownCause::ClosedByPeer, code: 0, text: "the adapter says that it is idle" };
            self.told = Some(down);
            self.events.push_back(LinkEvent::Down(down));
        }
    }
}

impl Machine for Scanner {
    type Event = LinkEvent;

    fn ports(&self) -> &[PortRequest] {
        super::PORTS
    }

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        match from.port {
            Port::Udp(IO_PORT) => {
                let peer = from.peer.map(|peer| *peer.ip());
                match (&mut self.io, Frame::parse(frame)) {
                    (_, Err(_)) => self.counters.malformed += 1,
                    (Some(io), Ok(frame)) if peer == Some(self.config.target) => {
                        io.take(now, &frame, &mut self.input, &mut self.counters);
                        self.follow_io();
                    }
                    _ => self.counters.foreign += 1,
                }
            }
            Port::Stream(stream) if Some(stream) == self.stream => {
                // Lent out while messages are taken from it; always put back.
                let Some(mut reassembly) = self.reassembly.take() else { return };
                let taken = reassembly.push(frame).is_ok();
                while let Some(message) = reassembly.next_message() {
                    match message {
                        Message::Whole(header, data) => self.hear(now, &header, data),
                        Message::TooLong(_) => self.counters.malformed += 1,
                    }
                }
                self.reassembly = Some(reassembly);
                if !taken {
                    let text = "the adapter sent more than a message over TCP that makes no sense";
                    self.fail(now, Down { cause: DownCause::ClosedHere, code: 0, text });
                }
            }
            _ => self.counters.foreign += 1,
        }
    }

    fn handle_stream(&mut self, now: Instant, stream: StreamId, change: StreamChange) {
        match change {
            StreamChange::Opened(_) if self.step == Step::Connecting && self.stream.is_none() => {
                self.stream = Some(stream);
                self.session = 0;
                if let Some(reassembly) = &mut self.reassembly {
                    reassembly.clear();
                }
                self.enter(now, Step::Registering, Say::Register);
            }
            StreamChange::Opened(_) => self.to_close.push_back(stream),
            StreamChange::Closed if self.stream == Some(stream) => {
                self.stream = None;
                self.session = 0;
                match self.step {
                    // Cyclic data does not need the session: the watchdog tells whether the adapter is gone.
                    Step::Running => self.keep_alive_at = None,
                    _ => {
                        let text = "the adapter ended the TCP connection";
                        self.fail(now, Down { cause: DownCause::ClosedByPeer, code: 0, text });
                    }
                }
            }
            StreamChange::Closed if self.step == Step::Connecting && self.stream.is_none() => {
                self.no_answer(now);
            }
            StreamChange::Closed => {}
        }
    }

    fn poll_stream(&mut self) -> Option<StreamRequest> {
        if let Some(stream) = self.to_close.pop_front() {
            return Some(StreamRequest::Close(stream));
        }
        let to = SocketAddrV4::new(self.config.target, ENCAPSULATION_PORT);
        core::mem::take(&mut self.connect).then_some(StreamRequest::Connect { to })
    }

    /// What a device's QoS object says before anybody changes it: a scanner has no such object.
    fn dscp(&self, port: Port) -> u8 {
        match port {
            Port::Udp(IO_PORT) => Qos::default().cyclic(self.config.o_t().priority),
            _ => Qos::default().explicit(),
        }
    }

    fn group(&self, port: Port) -> Option<Ipv4Addr> {
        self.io.as_ref().filter(|_| port == Port::Udp(IO_PORT)).and_then(|io| io.group)
    }

    fn handle_timeout(&mut self, now: Instant) {
        if self.io.as_ref().is_some_and(|io| io.expired(now)) {
            let text = "the adapter sent nothing for as long as the timeout allows";
            self.fail(now, Down { cause: DownCause::Watchdog, code: 0, text });
        }
        if self.keep_alive_at.is_some_and(|at| now >= at) {
            self.keep_alive_at = Some(now + KEEP_ALIVE);
            self.say(Say::Nop);
        }
        if self.deadline.is_some_and(|deadline| now >= deadline) {
            match self.step {
                Step::Idle => self.connect(now),
                _ => self.no_answer(now),
            }
        }
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        if let Some(io) = &mut self.io
            && let Some((to, len)) = io.produce(now, self.run, &self.output, buf)
        {
            self.counters.sent += 1;
            return Some(Transmit { port: Port::Udp(IO_PORT), to: Some(to), len });
        }
        while let Some((stream, say)) = self.to_say.pop_front() {
            if let Some(len) = self.emit(say, buf) {
                return Some(Transmit { port: Port::Stream(stream), to: None, len });
            }
        }
        None
    }

    fn poll_event(&mut self) -> Option<LinkEvent> {
        self.events.pop_front()
    }

    fn poll_timeout(&self) -> Option<Instant> {
        let io = self.io.as_ref().map(Io::next_timeout);
        Instant::earlier(Instant::earlier(self.deadline, self.keep_alive_at), io)
    }
}

impl Scanner {
    /// Sets the data that go out with the next cyclic frame and with every one after it.
    pub fn set_output(&mut self, image: &IoData) {
        // An assembly may be shorter or longer than the image.
        for (place, byte) in self.output.iter_mut().zip(image) {
            *place = *byte;
        }
    }

    /// The last data that the peer sent and marked as good; none before the first and after the connection is lost.
    #[must_use]
    pub fn input(&self) -> Option<&IoData> {
        self.up.then_some(&self.input)
    }

    /// Closes the connection by a Forward_Close and the session behind it, over a new TCP connection where the old one
    /// is gone. [`LinkEvent::Down`] tells when it is done.
    pub fn disconnect(&mut self, now: Instant) {
        if self.leaving {
            return;
        }
        self.leaving = true;
        self.up = false;
        self.keep_alive_at = None;
        match (self.step, self.stream) {
            (Step::Running, Some(_)) => {
                self.io = None;
                self.enter(now, Step::Closing, Say::Close);
            }
            (Step::Running, None) => {
                self.io = None;
                self.connect(now);
            }
            _ => {
                self.connect = false;
                self.fail(now, Down { cause: DownCause::ClosedHere, code: 0, text: "" });
            }
        }
    }

    /// Writes why the peer refused the last connection and what it has instead, where that is more than
    /// [`Down`] holds; otherwise nothing.
    pub fn explain(&self, words: &mut dyn fmt::Write) -> fmt::Result {
        self.refusal.as_ref().map_or(Ok(()), |refusal| write!(words, "{refusal}"))
    }

    /// What was sent, received and refused since the start.
    #[must_use]
    pub fn counters(&self) -> Counters {
        self.counters
    }
}
