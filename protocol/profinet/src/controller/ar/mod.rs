//! An application relation (AR): one device, from the search for it to its end, and again after each failure.
//!
//! ```text
//! Pausing ──▶ Searching ──▶ Connecting ──▶ Writing ──▶ EndingParameters ──▶ AwaitingReady ──▶ Exchanging
//!    ▲        (DCP)         (Connect)      (records)   (PrmEnd)             (ApplicationReady)    │
//!    └──────────────────────────────── any failure, after a pause ◀──────────────────────────────┘
//! ```
//!
//! It finds the device by its name, gives it its address, connects, writes its parameters and exchanges data. Any failure
//! is reported once by [`LinkEvent::Down`]; then the AR starts over. Outputs are sent from the answer to Connect on,
//! because the device's watchdog may already run; they are bad until the owner sets them.

mod acyclic;
mod alarms;
mod call;
mod commissioning;
mod conflict;
mod connect_plan;
mod discovery;
mod down_reasons;
mod health;
mod layout;
mod link;
mod multiple_write;
mod object;
mod obstacle;
mod owner;
mod plug;
mod startup;

use alloc::collections::VecDeque;
use alloc::vec::Vec;
use core::net::Ipv4Addr;

use machine::ethernet::Mac;
use machine::{Counters, Down, DownCause, Duration, Instant, LinkEvent, Transmit};
use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

pub use commissioning::{ReceivedAlarm, RecordError};

use super::config::{ArConfig, ConfigError, ControllerConfig};
use crate::Uuid;
use crate::alarm::{FRAME_ID_HIGH, FRAME_ID_LOW};
use crate::connect::DiffModule;
use crate::dcp::IpSuite;
use crate::provided::Provided;
use crate::rpc::DEVICE_INTERFACE;
use crate::rt::{Received, Transport};
use crate::status::Status;
use acyclic::Acyclic;
use alarms::{FinalError, Outcome};
use call::Caller;
use commissioning::Commissioning;
use connect_plan::{ConnectPlan, PlanChanges};
use discovery::{Discovery, WantedStation};
use health::DeviceHealth;
use link::CyclicLink;
use object::Instance;
use obstacle::Obstacle;
use plug::Plugs;

/// Time without a connection after which we report it.
const SILENT_FOR: Duration = Duration::from_secs(3);
/// Pause before the first new attempt; it doubles up to [`PAUSE_AT_MOST`].
const PAUSE: Duration = Duration::from_millis(100);
/// The longest pause between attempts.
const PAUSE_AT_MOST: Duration = Duration::from_millis(1_600);
/// How long a device may take from PrmEnd to ApplicationReady while it sends cyclic frames (IEC 61158-6-10,
/// RemoteApplicationReadyTimeout; the GSDML file of a device may name less, which we do not know).
const READY_WITHIN: Duration = Duration::from_secs(300);
/// How long it may take if it sends nothing meanwhile.
const SILENT_READY_WITHIN: Duration = Duration::from_secs(20);
/// How long we wait for the answer to a Release.
const RELEASED_WITHIN: Duration = Duration::from_secs(1);

/// Why a device cannot be used: a status and its text.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
struct Refusal {
    code: u32,
    text: &'static str,
}

/// State of the AR.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum ArPhase {
    /// The owner ended it; it does not start again.
    Stopped,
    /// It waits before it tries again.
    Pausing { until: Instant },
    /// It searches for the device.
    Searching,
    /// Connect is called.
    Connecting,
    /// The parameter records from this index on are being written, up to `end` together.
    Writing { parameter: usize, end: usize },
    /// PrmEnd is called. `ready`: ApplicationReady has already arrived.
    EndingParameters { ready: bool },
    /// The device prepares itself until it calls ApplicationReady. `silent_until`: how long it may do so without a cyclic frame.
    AwaitingReady { until: Instant, silent_until: Instant },
    /// Data are exchanged.
    Exchanging,
    /// Release is called.
    Releasing { until: Instant },
}

/// A controller's end of an application relation with one device.
#[derive(Debug)]
pub struct Ar {
    /// MAC address of the controller.
    own: Mac,
    config: ArConfig,
    plan: ConnectPlan,
    random: Pcg64Mcg,
    phase: ArPhase,
    pause: Duration,
    discovery: Discovery,
    caller: Caller,
    instance: Instance,
    changes: PlanChanges,
    link: Option<CyclicLink>,
    final_error: Option<FinalError>,
    plugs: Plugs,
    output: Provided,
    up: bool,
    /// When we report that there is no connection, unless something else is reported before.
    silent_at: Option<Instant>,
    /// The last failure.
    words: &'static str,
    /// The station that ended the last attempt.
    obstacle: Option<Obstacle>,
    /// Last failure reported since the connection was up.
    reported: Option<Down>,
    diff: Vec<DiffModule>,
    events: VecDeque<LinkEvent>,
    /// Counters of earlier connections, and of frames that belong to none.
    counters: Counters,
    acyclic: Acyclic,
    commissioning: Commissioning,
    health: DeviceHealth,
}

impl Ar {
    /// Creates an AR that starts to search for its device at `start`. `number` distinguishes the ARs of one controller,
    /// from 0.
    pub(super) fn new(
        own: &ControllerConfig,
        config: ArConfig,
        number: u16,
        start: Instant,
    ) -> Result<Self, ConfigError> {
        let seed = own.seed ^ start.as_nanos().rotate_left(32) ^ u64::from(number) << 48;
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        let plan = ConnectPlan::new(own, &config, number, random_uuid(&mut random))?;
        let identity = config.description.identity;
        let discovery = Discovery::new(WantedStation {
            own_mac: own.mac,
            own_address: own.address,
            name: config.station_name.as_bytes().into(),
            identity: (identity.vendor, identity.device),
            mac: config.mac,
            address: IpSuite { address: config.address, mask: own.mask, gateway: config.address },
        });
        let capacity = multiple_write::capacity(&config.parameters);
        let outputs = config.description.submodules();
        let output =
            Provided::new(outputs.map(|(slot, submodule)| (slot, submodule.subslot, submodule.output_len)));
        Ok(Self {
            own: own.mac,
            plan,
            random,
            phase: ArPhase::Pausing { until: start },
            pause: PAUSE,
            discovery,
            caller: Caller::new(DEVICE_INTERFACE, capacity),
            instance: Instance::new(),
            changes: PlanChanges::default(),
            link: None,
            final_error: None,
            plugs: Plugs::new(config.description.submodules().count()),
            output,
            up: false,
            silent_at: Some(start + SILENT_FOR),
            words: down_reasons::NO_STATION,
            obstacle: None,
            reported: None,
            diff: Vec::new(),
            events: VecDeque::with_capacity(8),
            counters: Counters::default(),
            acyclic: Acyclic::Active,
            commissioning: Commissioning::default(),
            health: DeviceHealth::default(),
            config,
        })
    }

    fn write_output(&mut self) {
        if let Some(link) = &mut self.link {
            link.write_output(&self.plan, &self.output);
        }
    }

    /// Returns the device's IP address.
    pub(super) const fn address(&self) -> Ipv4Addr {
        self.config.address
    }

    /// Returns the transport of the cyclic frames.
    pub(super) const fn transport(&self) -> Transport {
        self.config.transport
    }

    /// Returns the device's station name.
    pub(super) fn station_name(&self) -> &str {
        &self.config.station_name
    }

    /// Returns the device's MAC address, while it is connected by RT_CLASS_1.
    pub(super) fn rt1_device(&self) -> Option<Mac> {
        let link = self.link.as_ref().filter(|_| self.config.transport == Transport::Rt1)?;
        Some(link.device)
    }

    /// Returns the number of the AR to whose cyclic data a FrameID belongs, if any.
    pub(super) const fn number_of(frame_id: u16) -> u16 {
        connect_plan::number_of(frame_id)
    }

    /// Returns the transaction of the search for the device.
    pub(super) const fn xid(&self) -> u32 {
        self.discovery.xid()
    }

    /// Handles a cyclic frame or an alarm, from the FrameID on. Returns whether it belongs to this AR.
    pub(super) fn handle_rt(&mut self, now: Instant, frame_id: u16, payload: &[u8]) -> bool {
        let Some(link) = &mut self.link else { return false };
        if frame_id == link.receiver.frame_id() {
            match link.receiver.handle_frame(now, payload) {
                Received::New if self.up => {
                    let status = link.receiver.data_status();
                    self.follow_health(now, status);
                }
                Received::New if self.phase == ArPhase::Exchanging => self.go_up(),
                Received::New | Received::Late => {}
                Received::Ignored => return false,
                Received::Malformed => self.counters.malformed += 1,
            }
            return true;
        }
        self.acyclic = Acyclic::Active;
        let pdu = payload.get(2..).unwrap_or_default();
        let before = link.alarms.received();
        let outcome = match frame_id {
            FRAME_ID_HIGH | FRAME_ID_LOW => link.alarms.handle(now, frame_id, pdu),
            _ => Outcome::Foreign,
        };
        if link.alarms.received() != before {
            self.note_alarm(pdu);
        }
        match outcome {
            Outcome::Handled => {}
            Outcome::Plugged(plugged) => self.plugged(plugged),
            Outcome::Foreign => return false,
            Outcome::Malformed => self.counters.malformed += 1,
            Outcome::Aborted(status) => {
                let down = Down { cause: DownCause::ClosedByPeer, code: status.0, text: status.text() };
                self.fail(now, down, None);
            }
        }
        self.continue_plug(now);
        true
    }

    /// Ends the attempt or the connection; sends `status` to the device unless the device itself ended it.
    fn fail(&mut self, now: Instant, down: Down, status: Option<Status>) {
        self.acyclic = Acyclic::Active;
        if let (Some(link), Some(status)) = (&self.link, status) {
            self.final_error = Some(link.alarms.final_error(status));
        }
        self.drop_link();
        self.give_up_record();
        self.caller.cancel();
        self.discovery.stop();
        self.phase = ArPhase::Pausing { until: now + self.pause };
        self.pause = self.pause.saturating_mul(2).min(PAUSE_AT_MOST);
        let was_up = core::mem::take(&mut self.up);
        let same = |reported: Down| reported == down;
        let nothing_new = match self.reported {
            Some(reported) => down.cause == DownCause::NoAnswer || same(reported),
            // A silent device is reported only after a while.
            None => down.cause == DownCause::NoAnswer,
        };
        self.words = down.text;
        self.obstacle = None;
        if was_up || !nothing_new {
            self.report(down);
        }
    }

    fn report(&mut self, down: Down) {
        self.reported = Some(down);
        self.silent_at = None;
        self.events.push_back(LinkEvent::Down(down));
    }

    fn go_up(&mut self) {
        self.acyclic = Acyclic::Active;
        self.up = true;
        self.pause = PAUSE;
        self.caller.reset_patience();
        self.silent_at = None;
        self.reported = None;
        self.events.push_back(LinkEvent::Up);
    }

    fn drop_link(&mut self) {
        self.plugs.clear();
        self.health.clear();
        if let Some(link) = self.link.take() {
            link.count(&mut self.counters);
        }
    }

    /// Returns whether the connection ends if no cyclic frame comes within the data hold time: while data are exchanged, and
    /// before, from the device's first frame on.
    fn is_monitored(&self, link: &CyclicLink) -> bool {
        match self.phase {
            ArPhase::Exchanging => true,
            ArPhase::AwaitingReady { .. } => link.receiver.received() > 0,
            _ => false,
        }
    }

    /// Returns a hint for the user if the device stays silent in this phase.
    fn reason_for_silence(&self) -> &'static str {
        match self.phase {
            ArPhase::Connecting | ArPhase::Writing { .. } | ArPhase::EndingParameters { .. } => {
                self.no_answer()
            }
            ArPhase::AwaitingReady { .. } => down_reasons::NOT_READY,
            ArPhase::Exchanging => down_reasons::NO_CYCLIC,
            ArPhase::Pausing { .. } => self.words,
            _ if self.discovery.is_resolving() => down_reasons::NO_ARP,
            _ if self.discovery.has_found() => down_reasons::NO_SET,
            _ => down_reasons::NO_STATION,
        }
    }

    /// Returns a hint for the user if the device does not answer calls.
    fn no_answer(&self) -> &'static str {
        if self.discovery.has_conflict() { down_reasons::ADDRESS_TAKEN } else { down_reasons::NO_RPC }
    }

    pub(super) fn handle_timeout(&mut self, now: Instant) {
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

    /// Writes the cyclic frame that is due, if one is.
    pub(super) fn poll_cyclic(&mut self, buf: &mut [u8]) -> Option<Transmit> {
        self.link.as_mut()?.sender.poll_transmit(buf)
    }

    /// Returns whether a cyclic frame is due.
    pub(super) fn has_cyclic(&self) -> bool {
        self.link.as_ref().is_some_and(|link| link.sender.is_due())
    }

    /// Returns whether another frame may be waiting.
    pub(super) const fn has_acyclic(&self) -> bool {
        matches!(self.acyclic, Acyclic::Active)
    }

    /// Returns whether an event is waiting.
    pub(super) fn has_event(&self) -> bool {
        !self.events.is_empty()
    }

    pub(super) fn poll_event(&mut self) -> Option<LinkEvent> {
        self.events.pop_front()
    }

    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        let acyclic = match self.acyclic {
            Acyclic::Active => self.acyclic_timeout(),
            Acyclic::Quiet { until } => until,
        };
        let Some(link) = &self.link else { return acyclic };
        let mut next = link.sender.poll_timeout();
        if self.is_monitored(link) {
            next = next.min(link.receiver.poll_timeout());
        }
        Instant::earlier(acyclic, Some(next))
    }
}

/// Returns a UUID of random numbers (RFC 9562, version 4).
fn random_uuid(random: &mut Pcg64Mcg) -> Uuid {
    let bits = u128::from(random.next_u64()) << 64 | u128::from(random.next_u64());
    let version = bits & !(0xF << 76) | 4 << 76;
    Uuid((version & !(3 << 62) | 2 << 62).to_be_bytes())
}
