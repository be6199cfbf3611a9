//! An IO-Controller that drives one IO-Device.
//!
//! ```text
//! Pausing ──▶ Looking ──▶ Connecting ──▶ Writing ──▶ Ending ──▶ Readying ──▶ Exchanging
//!    ▲        (DCP)       (Connect)      (records)   (PrmEnd)   (ApplicationReady)   │
//!    └───────────────────────── any failure, after a pause ◀─────────────────────────┘
//! ```
//!
//! It finds the device by its name, gives it its address, connects, writes its parameters and exchanges data; whatever
//! goes wrong is told once by [`LinkEvent::Down`], and the whole begins anew. Outputs go out from the answer to Connect
//! on, since a device may already watch for them; they are bad until there is an image.

mod acyclic;
mod alarms;
mod call;
mod config;
mod discovery;
mod layout;
mod link;
mod responder;
mod startup;
#[cfg(test)]
mod tests;
mod words;

pub use config::{ConfigError, ControllerConfig, Parameter};

use alloc::collections::VecDeque;
use alloc::vec::Vec;
use core::net::SocketAddrV4;

use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::alarm::{FRAME_ID_HIGH, FRAME_ID_LOW};
use super::connect::DiffModule;
use super::dcp::{self, IpSuite, Pdu};
use super::description::PLC;
use super::rpc::{self, DEVICE_INTERFACE, Header, Kind};
use super::rt::{Received, Transport, UDP_PORT};
use super::station::{self, Station};
use super::status::Status;
use super::{RPC_PORT, Uuid};
use crate::ETHER_TYPE;
use crate::{IO_DATA_LEN, IoData};
use acyclic::Acyclic;
use alarms::{Outcome, Parting};
use call::Caller;
use config::Plan;
use discovery::{Discovery, Wanted};
use link::Link;
use machine::ethernet::EthernetHeader;
use machine::{Counters, Down, DownCause, LinkEvent};
use machine::{Duration, Instant, Machine, Port, PortRequest, Source, Transmit};
use responder::Responder;

/// How long no connection may be there before that is told.
const SILENT_FOR: Duration = Duration::from_secs(3);
/// Pause before the first new attempt; it doubles up to [`PAUSE_AT_MOST`].
const PAUSE: Duration = Duration::from_millis(100);
/// The longest pause between attempts.
const PAUSE_AT_MOST: Duration = Duration::from_millis(1_600);
/// How long the device may take from PrmEnd to ApplicationReady.
const READY_WITHIN: Duration = Duration::from_secs(20);
/// How long a Release is waited for.
const RELEASED_WITHIN: Duration = Duration::from_secs(1);

/// Why a device cannot be driven: a status and what it says.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
struct Refusal {
    code: u32,
    text: &'static str,
}

/// What the controller is doing.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Phase {
    /// Nothing, for good: the owner ended it.
    Stopped,
    /// It waits before it tries again.
    Pausing { until: Instant },
    /// It looks for the device.
    Looking,
    /// Connect is called.
    Connecting,
    /// The parameter record of this index is being written.
    Writing { parameter: usize },
    /// PrmEnd is called. ApplicationReady may be there already.
    Ending { ready: bool },
    /// The device prepares itself.
    Readying { until: Instant },
    /// Data go both ways.
    Exchanging,
    /// Release is called.
    Releasing { until: Instant },
}

/// An IO-Controller with one IO-Device.
#[derive(Debug)]
pub struct Controller {
    config: ControllerConfig,
    plan: Plan,
    station: Station,
    random: Pcg64Mcg,
    phase: Phase,
    pause: Duration,
    discovery: Discovery,
    caller: Caller,
    responder: Responder,
    link: Option<Link>,
    parting: Option<Parting>,
    output: Option<IoData>,
    input: IoData,
    input_good: bool,
    up: bool,
    /// When it is told that no connection came about, unless something else is told before.
    silent_at: Option<Instant>,
    /// What the last failure said.
    words: &'static str,
    /// What was told last since the connection was up.
    told: Option<Down>,
    diff: Vec<DiffModule>,
    events: VecDeque<LinkEvent>,
    /// What earlier ARs counted, and what belongs to none.
    counters: Counters,
    acyclic: Acyclic,
}

impl Controller {
    /// A controller that starts to look for its device at `start`.
    pub fn new(config: ControllerConfig, start: Instant) -> Result<Self, ConfigError> {
        let mut random = Pcg64Mcg::seed_from_u64(config.seed ^ start.as_nanos().rotate_left(32));
        let plan = Plan::new(&config, random_uuid(&mut random))?;
        let identity = config.description.identity;
        let discovery = Discovery::new(Wanted {
            own_mac: config.mac,
            name: config.device_station_name.as_bytes().into(),
            identity: (identity.vendor, identity.device),
            address: IpSuite {
                address: config.device_address,
                mask: config.mask,
                gateway: config.device_address,
            },
        });
        let own = IpSuite { address: config.address, mask: config.mask, gateway: config.address };
        Ok(Self {
            plan,
            station: Station::controller(config.mac, PLC, config.station_name.as_bytes(), own),
            random,
            phase: Phase::Pausing { until: start },
            pause: PAUSE,
            discovery,
            caller: Caller::new(rpc::object(1, identity), DEVICE_INTERFACE),
            responder: Responder::new(),
            link: None,
            parting: None,
            output: None,
            input: [0; IO_DATA_LEN],
            input_good: false,
            up: false,
            silent_at: Some(start + SILENT_FOR),
            words: words::NO_STATION,
            told: None,
            diff: Vec::new(),
            events: VecDeque::with_capacity(8),
            counters: Counters::default(),
            acyclic: Acyclic::Active,
            config,
        })
    }

    /// Where the device's modules are not those of the description, after the last Connect; empty if all are.
    #[must_use]
    pub fn module_diff(&self) -> &[DiffModule] {
        &self.diff
    }

    fn handle_ethernet(&mut self, now: Instant, frame: &[u8]) {
        let Ok((header, payload)) = EthernetHeader::parse(frame) else {
            self.counters.malformed += 1;
            return;
        };
        let for_us = header.destination == self.config.mac || header.destination.is_group();
        if header.ether_type != ETHER_TYPE || !for_us {
            self.counters.foreign += 1;
            return;
        }
        let is_devices = self.link.as_ref().is_some_and(|link| link.device == header.source);
        match payload.first_chunk().copied().map(u16::from_be_bytes) {
            Some(frame_id) if dcp::FRAME_IDS.contains(&frame_id) => {
                self.acyclic = Acyclic::Active;
                match Pdu::parse(payload) {
                    Ok(pdu) if pdu.service.is_request() => self.answer_dcp(now, &header, payload),
                    Ok(pdu) => self.handle_dcp(now, header.source, &pdu),
                    Err(_) => self.counters.malformed += 1,
                }
            }
            Some(frame_id) if is_devices && self.config.transport == Transport::Rt1 => {
                self.handle_rt(now, frame_id, payload);
            }
            Some(_) => self.counters.foreign += 1,
            None => self.counters.malformed += 1,
        }
    }

    /// Others look for this station, as an engineering system does.
    fn answer_dcp(&mut self, now: Instant, header: &EthernetHeader, payload: &[u8]) {
        match self.station.handle_frame(now, header, payload) {
            Ok(_) => {}
            Err(station::Refusal::Malformed) => self.counters.malformed += 1,
            Err(station::Refusal::Foreign) => self.counters.foreign += 1,
        }
    }

    fn handle_rt(&mut self, now: Instant, frame_id: u16, payload: &[u8]) {
        let Some(link) = &mut self.link else {
            self.counters.foreign += 1;
            return;
        };
        if frame_id == link.receiver.frame_id() {
            match link.receiver.handle_frame(now, payload) {
                Received::New => {
                    self.input_good = link.read_input(&self.plan, &mut self.input);
                    if self.phase == Phase::Exchanging && !self.up {
                        self.go_up();
                    }
                }
                Received::Late => {}
                Received::Ignored => self.counters.foreign += 1,
                Received::Malformed => self.counters.malformed += 1,
            }
            return;
        }
        self.acyclic = Acyclic::Active;
        let pdu = payload.get(2..).unwrap_or_default();
        let outcome = match frame_id {
            FRAME_ID_HIGH | FRAME_ID_LOW => link.alarms.handle(now, frame_id, pdu),
            _ => Outcome::Foreign,
        };
        match outcome {
            Outcome::Taken => {}
            Outcome::Foreign => self.counters.foreign += 1,
            Outcome::Malformed => self.counters.malformed += 1,
            Outcome::Aborted(status) => {
                let down = Down { cause: DownCause::ClosedByPeer, code: status.0, text: status.text() };
                self.fail(now, down, None);
            }
        }
    }

    fn handle_rpc(&mut self, now: Instant, from: SocketAddrV4, datagram: &[u8]) {
        self.acyclic = Acyclic::Active;
        let Ok((header, body)) = Header::parse(datagram) else {
            self.counters.malformed += 1;
            return;
        };
        match header.kind {
            Kind::Request | Kind::Ping => self.handle_call(now, from, &header, body),
            _ => self.handle_answer(now, &header, body),
        }
    }

    /// Puts an end to the attempt or the connection, and to its AR: with `status`, if the device does not know yet.
    fn fail(&mut self, now: Instant, down: Down, status: Option<Status>) {
        self.acyclic = Acyclic::Active;
        if let (Some(link), Some(status)) = (&self.link, status) {
            self.parting = Some(link.alarms.parting(status));
        }
        self.drop_link();
        self.caller.cancel();
        self.discovery.stop();
        self.phase = Phase::Pausing { until: now + self.pause };
        self.pause = self.pause.saturating_mul(2).min(PAUSE_AT_MOST);
        let was_up = core::mem::take(&mut self.up);
        let same = |told: Down| (told.cause, told.code) == (down.cause, down.code);
        let nothing_new = match self.told {
            Some(told) => down.cause == DownCause::NoAnswer || same(told),
            // Silence is told when it has lasted.
            None => down.cause == DownCause::NoAnswer,
        };
        self.words = down.text;
        if was_up || !nothing_new {
            self.tell(down);
        }
    }

    fn tell(&mut self, down: Down) {
        self.told = Some(down);
        self.silent_at = None;
        self.events.push_back(LinkEvent::Down(down));
    }

    fn go_up(&mut self) {
        self.acyclic = Acyclic::Active;
        self.up = true;
        self.pause = PAUSE;
        self.silent_at = None;
        self.told = None;
        self.events.push_back(LinkEvent::Up);
    }

    fn drop_link(&mut self) {
        if let Some(link) = self.link.take() {
            link.count(&mut self.counters);
        }
        self.input_good = false;
    }

    /// What to look at if nothing comes any more in this phase.
    const fn words_for_silence(&self) -> &'static str {
        match self.phase {
            Phase::Connecting | Phase::Writing { .. } | Phase::Ending { .. } => words::NO_RPC,
            Phase::Readying { .. } => words::NOT_READY,
            Phase::Exchanging => words::NO_CYCLIC,
            Phase::Pausing { .. } => self.words,
            _ if self.discovery.has_found() => words::NO_SET,
            _ => words::NO_STATION,
        }
    }
}

impl Machine for Controller {
    type Event = LinkEvent;

    fn ports(&self) -> &[PortRequest] {
        super::PORTS
    }

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        let devices = from.peer.filter(|peer| *peer.ip() == self.config.device_address);
        match (from.port, devices) {
            (Port::Ethernet, _) => self.handle_ethernet(now, frame),
            (Port::Udp(RPC_PORT), Some(peer)) => self.handle_rpc(now, peer, frame),
            (Port::Udp(UDP_PORT), Some(_)) if self.config.transport == Transport::Udp => {
                match frame.first_chunk().copied().map(u16::from_be_bytes) {
                    Some(frame_id) => self.handle_rt(now, frame_id, frame),
                    None => self.counters.malformed += 1,
                }
            }
            _ => self.counters.foreign += 1,
        }
    }

    fn handle_timeout(&mut self, now: Instant) {
        let mut is_expired = false;
        if let Some(link) = &mut self.link {
            link.sender.handle_timeout(now);
            is_expired = link.receiver.is_expired(now);
        }
        if let Acyclic::Quiet { until } = self.acyclic
            && until.is_none_or(|until| now < until)
            && !is_expired
        {
            return;
        }
        self.handle_acyclic_timeout(now);
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        if let Some(link) = &mut self.link
            && let Some(transmit) = link.sender.poll_transmit(buf)
        {
            return Some(transmit);
        }
        if matches!(self.acyclic, Acyclic::Quiet { .. }) {
            return None;
        }
        let transmit = self.poll_acyclic(now, buf);
        if transmit.is_none() {
            self.acyclic = Acyclic::Quiet { until: self.acyclic_timeout() };
        }
        transmit
    }

    fn poll_event(&mut self) -> Option<LinkEvent> {
        self.events.pop_front()
    }

    fn poll_timeout(&self) -> Option<Instant> {
        let acyclic = match self.acyclic {
            Acyclic::Active => self.acyclic_timeout(),
            Acyclic::Quiet { until } => until,
        };
        let Some(link) = &self.link else { return acyclic };
        let mut next = link.sender.poll_timeout();
        if self.phase == Phase::Exchanging {
            next = next.min(link.receiver.poll_timeout());
        }
        Instant::earlier(acyclic, Some(next))
    }
}

impl Controller {
    /// Sets the data that go out with the next cyclic frame and with every one after it.
    pub fn set_output(&mut self, image: &IoData) {
        if let Some(link) = &mut self.link {
            link.write_output(&self.plan, Some(image));
        }
        self.output = Some(*image);
    }

    /// The last data that the peer sent and marked as good; none before the first and after the connection is lost.
    #[must_use]
    pub fn input(&self) -> Option<&IoData> {
        (self.up && self.input_good).then_some(&self.input)
    }

    /// Ends the connection as the standard wants it, or gives up the attempt to connect.
    pub fn disconnect(&mut self, now: Instant) {
        self.acyclic = Acyclic::Active;
        self.release(now);
    }

    /// What was sent, received and refused since the start.
    #[must_use]
    pub fn counters(&self) -> Counters {
        let mut counters = self.counters;
        if let Some(link) = &self.link {
            link.count(&mut counters);
        }
        counters
    }
}

/// A UUID of random numbers (RFC 9562, version 4).
fn random_uuid(random: &mut Pcg64Mcg) -> Uuid {
    let bits = u128::from(random.next_u64()) << 64 | u128::from(random.next_u64());
    let version = bits & !(0xF << 76) | 4 << 76;
    Uuid((version & !(3 << 62) | 2 << 62).to_be_bytes())
}
