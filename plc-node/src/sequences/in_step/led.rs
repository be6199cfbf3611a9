//! An arm that a master leads: its share of the master's position, and how well it follows.

use machine::{Duration, Instant};
use protocol::image::{Control, State};

use super::ArmPlace;
use super::sent::SentSetPoints;
use crate::Station;
use crate::arm_in_step::{RobotTimes, TogetherSection};
use crate::axes_group::Lead;

/// Time on the law by which an arm may be late before the master slows down for it, in s: robots follow to a fraction of that.
const LATE_S: f64 = 0.005;

/// Time on the law beyond that with which the master stands for it, in s.
const LATEST_S: f64 = 0.02;

/// Longest time for which an arm that should be at the end of its law is led on, in s: the rehearsal may be a little short.
const MOST_EXTRA_S: f64 = 5.0;

/// Time after which an arm counts as ready although it has not taken all motions: those after a LIN force it takes later.
const TAKES_NO_MORE: Duration = Duration::from_millis(200);

/// State of a led arm.
#[derive(Clone, Copy, PartialEq, Debug)]
enum LedPhase {
    /// It stands at the start of its present leg, and may not be able to move yet; since when its robot has taken the skill up.
    Preparing(Option<Instant>),
    /// It follows the master.
    Going,
    /// It stands at the end of the section.
    Done,
}

/// An arm of a group.
#[derive(Debug)]
pub(super) struct LedArm {
    pub(super) station: usize,
    section: TogetherSection,
    /// Time on the law from the start of the section to the end of each leg, in s.
    ends_s: Vec<f64>,
    /// Time on this arm's law for a second of the master.
    scale: f64,
    phase: LedPhase,
    leg: usize,
    /// The first scan with SYNC.
    from_scan: u64,
    /// Time on the law of the arm's skill at the start of the leg, in s.
    base_s: f64,
    /// Time by which the arm is led on beyond the end of its leg, in s.
    extra_s: f64,
    sent: SentSetPoints,
    /// By how much it is late, in s on its law.
    late_s: f64,
    /// Set while it is suspended, or about to be.
    is_held: bool,
}

impl LedArm {
    pub(super) fn new(station: usize, section: TogetherSection) -> Self {
        let mut end_s = 0.0;
        let ends = section.legs.iter().map(|leg| {
            end_s += leg.law.as_secs_f64();
            end_s
        });
        Self {
            station,
            ends_s: ends.collect(),
            section,
            scale: 1.0,
            phase: LedPhase::Done,
            leg: 0,
            from_scan: 0,
            base_s: 0.0,
            extra_s: 0.0,
            sent: SentSetPoints::default(),
            late_s: 0.0,
            is_held: false,
        }
    }

    /// Returns the time on the law of the whole section, in s.
    pub(super) fn law_s(&self) -> f64 {
        self.ends_s.last().copied().unwrap_or(0.0)
    }

    /// Takes its share of a master that needs this time for the section.
    pub(super) fn scaled_to(mut self, longest_s: f64) -> Self {
        self.scale = if longest_s > 0.0 { self.law_s() / longest_s } else { 1.0 };
        self
    }

    /// Begins the section; `scan` is the first one with SYNC.
    pub(super) const fn begin(&mut self, scan: u64) {
        (self.leg, self.from_scan) = (0, scan);
        self.begin_leg();
    }

    const fn begin_leg(&mut self) {
        self.phase = LedPhase::Preparing(None);
        (self.base_s, self.extra_s, self.late_s, self.is_held) = (0.0, 0.0, 0.0, false);
        self.sent.clear();
    }

    pub(super) const fn is_preparing(&self) -> bool {
        matches!(self.phase, LedPhase::Preparing(_))
    }

    pub(super) fn is_lagging(&self) -> bool {
        self.phase == LedPhase::Going && self.late_s > LATE_S
    }

    pub(super) const fn is_held(&self) -> bool {
        self.is_held
    }

    /// Returns the time on the law from the start of the section to the start of the present leg, and to its end, in s.
    fn leg_s(&self) -> [f64; 2] {
        let end = |leg: usize| self.ends_s.get(leg).copied().unwrap_or_else(|| self.law_s());
        [self.leg.checked_sub(1).map_or(0.0, end), end(self.leg)]
    }

    /// Returns the master's position that it must not pass before the arm begins its next leg, in s.
    pub(super) fn stop_at_s(&self) -> f64 {
        let [start, end] = self.leg_s();
        let at = if self.is_preparing() { start } else { end };
        if self.phase == LedPhase::Done || self.scale <= 0.0 { f64::INFINITY } else { at / self.scale }
    }

    /// Returns whether the arm rests by its own law where the master is at this position.
    pub(super) fn rests_at(&self, position_s: f64) -> bool {
        let at = position_s * self.scale;
        let is_end = |end: &f64| (at - end).abs() < 1e-9;
        self.phase == LedPhase::Done || at < 1e-9 || self.ends_s.iter().any(is_end)
    }

    /// Takes over what the arm has done until this scan.
    pub(super) fn follow(
        &mut self,
        now: Instant,
        lead: Duration,
        times: &RobotTimes,
        place: &ArmPlace,
        station: &Station,
    ) {
        let legs = &self.section.legs;
        let leg = legs.partition_point(|leg| leg.end <= place.step);
        if place.stands || leg >= legs.len() {
            (self.phase, self.late_s, self.is_held) = (LedPhase::Done, 0.0, false);
            return;
        }
        if leg > self.leg {
            self.leg = leg;
            self.begin_leg();
        }
        if let LedPhase::Preparing(taken_up) = self.phase {
            self.prepare(now, lead, times, taken_up, place, station);
        }
        let (command, feedback) = (station.group().command(), station.group().feedback());
        let stops = Control::SUSPEND.0 | Control::HALT.0 | Control::CANCEL.0;
        self.is_held = command.control.0 & stops != 0
            || feedback.is_some_and(|feedback| feedback.state == State::Suspended);
        let [start, end] = self.leg_s();
        let late_s = feedback.and_then(|feedback| {
            let wanted_s = self.sent.at(feedback.clock_ns)?.min(self.base_s + end - start);
            Some(wanted_s - f64::from(feedback.law_time_us) / 1e6)
        });
        self.late_s = late_s.unwrap_or(self.late_s).max(0.0);
    }

    /// Has the arm follow the master once it can move: its robot has SYNC and the motions, and has had its time to start.
    fn prepare(
        &mut self,
        now: Instant,
        lead: Duration,
        times: &RobotTimes,
        taken_up: Option<Instant>,
        place: &ArmPlace,
        station: &Station,
    ) {
        let (group, command) = (station.group(), station.group().command());
        let executing = group.feedback().filter(|feedback| {
            let is_running = matches!(feedback.state, State::Running | State::Suspended);
            place.is_called && feedback.number == command.number && is_running
        });
        let Some(feedback) = executing.filter(|_| group.has_seen(self.from_scan)) else {
            self.phase = LedPhase::Preparing(None);
            return;
        };
        let taken_up = taken_up.unwrap_or(now);
        let since = now.since(taken_up);
        // A skill that was under way at the mark needs no time to start. The master begins a lead later.
        let is_under_way = feedback.executed > 0;
        let is_prepared = is_under_way || since + lead >= times.prepare_continuous + times.cycle;
        let has_motions = feedback.accepted >= command.written || since >= TAKES_NO_MORE;
        if is_prepared && has_motions {
            (self.phase, self.base_s) = (LedPhase::Going, f64::from(feedback.law_time_us) / 1e6);
        } else {
            self.phase = LedPhase::Preparing(Some(taken_up));
        }
    }

    /// Returns the highest rate of the master with which the arm can go, and should.
    pub(super) fn highest_rate(&self, station: &Station) -> f64 {
        if self.is_held {
            return 0.0;
        }
        if self.phase != LedPhase::Going {
            return 1.0;
        }
        let share = |percent: u8| f64::from(percent.min(100)) / 100.0;
        let wanted = share(station.group().command().override_percent);
        let can = station.group().feedback().map_or(0.0, |feedback| share(feedback.override_percent));
        let slows_s = (self.late_s - LATE_S).max(0.0);
        wanted.min(can) * (1.0 - slows_s / LATEST_S).max(0.0)
    }

    /// Sends the arm its set-point: the place on its law when the master is at a position, which it is at `holds_at`. `passed_s` is
    /// the time since the last one.
    pub(super) fn send(
        &mut self,
        holds_at: Instant,
        position_s: f64,
        passed_s: f64,
        lets_suspend: bool,
        station: &mut Station,
    ) {
        let [start, end] = self.leg_s();
        let driven_s = (position_s * self.scale - start).clamp(0.0, end - start);
        let is_going = self.phase == LedPhase::Going;
        if is_going && driven_s >= end - start {
            self.extra_s = (self.extra_s + passed_s * self.highest_rate(station)).min(MOST_EXTRA_S);
        }
        let time = station.robot_clock().and_then(|clock| clock.robot_time(holds_at));
        let start_time_ns = time.map_or(0, |time| time.at_ns.max(1));
        let law_s = if self.is_preparing() { 0.0 } else { self.base_s + driven_s + self.extra_s };
        if is_going && start_time_ns != 0 {
            self.sent.push(start_time_ns, law_s);
        }
        station.group_mut().set_lead(Some(Lead {
            start_time_ns,
            law_time_us: (law_s * 1e6).round() as u32,
            keeps_override: self.section.has_force,
            lets_suspend: lets_suspend || !is_going,
        }));
    }
}
