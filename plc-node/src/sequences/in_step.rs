//! Arms in step: they start at one instant, and between two marks they may move together, led by a [`MasterAxis`].
//!
//! The master's position is a time on the law of the slowest arm. Each arm gets its own share of it as the time on its own law, with
//! the time of its own robot's clock at which it should be there.
//!
//! ```text
//! Preparing  the arm stands; it has SYNC and the motions, or its next skill has yet to start
//! Going      the arm follows the master
//! Done       the arm stands at the section's end
//! ```

mod led;
mod sent;
#[cfg(test)]
mod tests;

use machine::{Duration, Instant};

use led::LedArm;

use crate::arm_in_step::ArmInStep;
use crate::master_axis::{MasterAxis, MasterDemand};
use crate::robot_clock::{CLOCK_WAIT, start_together};
use crate::{ExecutionType, Station};

/// Time before they hold at which set-points are sent: at least what lets arms do without the frames that a MainDevice of EtherCAT does not
/// send after it has lost one (30 ms), and at most less than the 100 ms for which a robot looks ahead.
const LEAST_LEAD: Duration = Duration::from_millis(50);
const MOST_LEAD: Duration = Duration::from_millis(80);

/// Time for which the master stands at first: every robot has some set-points where its arm stands before the first one beyond.
const STANDS_FIRST: Duration = Duration::from_millis(12);

/// Time that arms take to come to rest once their master stands, before one of them may be suspended: the last tenths of a
/// millimetre they go more and more slowly.
const COMES_TO_REST: Duration = Duration::from_millis(300);

/// Where an arm is in its sequence.
#[derive(Clone, Copy, Debug)]
pub(super) struct ArmPlace {
    /// The mark that it passed last.
    pub(super) passed: Option<u32>,
    /// Motions before its present skill.
    pub(super) step: u32,
    /// Set once a skill is called.
    pub(super) is_called: bool,
    /// Set where it stands at the next mark, or has nothing more to do.
    pub(super) stands: bool,
    /// All its motions.
    pub(super) total: u32,
}

/// Means to keep the arms of a program in step.
#[derive(Debug, Default)]
pub(super) struct InStep {
    arms: Vec<ArmInStep>,
    groups: Vec<LedGroup>,
    lead: Duration,
    is_first_scan: bool,
    /// Room for a start time of each station.
    start_times: Vec<u64>,
}

/// The arms that move together from a mark to their next one.
#[derive(Debug)]
struct LedGroup {
    mark: u32,
    arms: Vec<LedArm>,
    /// Time on the law of the slowest arm for the whole section.
    longest_s: f64,
    master: Option<MasterAxis>,
    /// When the arms passed the mark; `None` while they have not, or have passed the next one.
    since: Option<Instant>,
    /// The scan before.
    scanned: Instant,
    /// Since when the master stands.
    stands_since: Option<Instant>,
}

impl InStep {
    /// Keeps these arms in step, one for each station. One arm alone is in step with nobody.
    pub(super) fn of(arms: Vec<ArmInStep>) -> Self {
        if arms.len() < 2 {
            return Self::default();
        }
        let slowest = arms.iter().map(|arm| arm.times.image + arm.times.cycle).max().unwrap_or_default();
        let lead = (slowest * 2).clamp(LEAST_LEAD, MOST_LEAD);
        let sections = |arm: &ArmInStep| arm.sections.iter().map(|section| section.mark).collect::<Vec<_>>();
        let mut marks: Vec<u32> = arms.iter().flat_map(sections).collect();
        marks.sort_unstable();
        marks.dedup();
        let groups = marks.into_iter().map(|mark| LedGroup::new(mark, &arms)).collect();
        Self { start_times: vec![0; arms.len()], arms, groups, lead, is_first_scan: false }
    }

    /// Begins a run.
    pub(super) fn begin(&mut self) {
        self.is_first_scan = true;
        self.groups.iter_mut().for_each(|group| group.since = None);
    }

    /// Returns whether arms move together in a run of this type. Single skills and programs of the robot do not.
    pub(super) fn moves_together(&self, execution_type: ExecutionType, station: usize) -> bool {
        let is_in = |group: &LedGroup| group.arms.iter().any(|arm| arm.station == station);
        execution_type == ExecutionType::Cm && self.groups.iter().any(is_in)
    }

    /// Sets the start times and the set-points of a scan, after the blocks were called in it.
    pub(super) fn lead(
        &mut self,
        now: Instant,
        execution_type: ExecutionType,
        place: impl Fn(usize) -> Option<ArmPlace>,
        stations: &mut [Station],
    ) {
        if self.arms.is_empty() {
            return;
        }
        stations.iter_mut().for_each(|station| station.group_mut().set_lead(None));
        if execution_type == ExecutionType::Cm {
            self.groups.iter_mut().for_each(|group| group.scan(now, self.lead, &self.arms, &place, stations));
        }
        if core::mem::take(&mut self.is_first_scan) {
            self.start_together(now, execution_type, place, stations);
        }
    }

    /// Returns whether the arm stands, or goes slower, for another one that it moves together with.
    pub(super) fn waits(&self, station: usize) -> bool {
        let mut leading = self.groups.iter().filter(|group| group.since.is_some());
        leading.any(|group| group.waits(station))
    }

    /// Gives the skills that start in this scan one instant, by the clocks of their robots. If one of these is not known, they
    /// start at once.
    fn start_together(
        &mut self,
        now: Instant,
        execution_type: ExecutionType,
        place: impl Fn(usize) -> Option<ArmPlace>,
        stations: &mut [Station],
    ) {
        let starts = |index: usize| {
            let is_led = self.groups.iter().any(|group| group.leads(index));
            place(index).filter(|place| place.is_called && !is_led)
        };
        let longest = |(index, arm): (usize, &ArmInStep)| {
            starts(index).map(|place| arm.times.start(execution_type, place.total))
        };
        let Some(longest) = self.arms.iter().enumerate().filter_map(longest).max() else { return };
        let starting = (0..stations.len()).filter(|index| starts(*index).is_some());
        let clocks = starting.clone().filter_map(|index| stations.get(index)?.robot_clock());
        let count = starting.clone().count();
        if count < 2 || clocks.clone().count() < count {
            return;
        }
        if start_together(now + longest, clocks, &mut self.start_times).is_none() {
            return;
        }
        for (index, start_time_ns) in starting.zip(&self.start_times) {
            if let Some(station) = stations.get_mut(index) {
                station.group_mut().start_at(*start_time_ns);
            }
        }
    }
}

impl LedGroup {
    fn new(mark: u32, arms: &[ArmInStep]) -> Self {
        let led = |(station, arm): (usize, &ArmInStep)| {
            let section = arm.sections.iter().find(|section| section.mark == mark)?;
            Some(LedArm::new(station, section.clone()))
        };
        let arms: Vec<LedArm> = arms.iter().enumerate().filter_map(led).collect();
        let longest_s = arms.iter().map(LedArm::law_s).fold(0.0, f64::max);
        let arms = arms.into_iter().map(|arm| arm.scaled_to(longest_s)).collect();
        Self { mark, arms, longest_s, master: None, since: None, scanned: Instant::ZERO, stands_since: None }
    }

    fn leads(&self, station: usize) -> bool {
        self.since.is_some() && self.arms.iter().any(|arm| arm.station == station)
    }

    /// Returns whether this arm waits for another one of the group.
    fn waits(&self, station: usize) -> bool {
        let owes = |arm: &LedArm| arm.is_preparing() || arm.is_lagging() || arm.is_held();
        let mut others = self.arms.iter().filter(|arm| arm.station != station);
        let this = self.arms.iter().find(|arm| arm.station == station);
        this.is_some_and(|arm| !owes(arm)) && others.any(owes)
    }

    fn scan(
        &mut self,
        now: Instant,
        lead: Duration,
        of_arms: &[ArmInStep],
        place: &impl Fn(usize) -> Option<ArmPlace>,
        stations: &mut [Station],
    ) {
        let is_between =
            |arm: &LedArm| place(arm.station).is_some_and(|place| place.passed == Some(self.mark));
        if !self.arms.iter().all(is_between) {
            self.since = None;
            return;
        }
        let since = *self.since.get_or_insert_with(|| {
            (self.master, self.scanned, self.stands_since) = (None, now, None);
            self.arms.iter_mut().for_each(|arm| {
                let scan = stations.get(arm.station).map_or(0, |station| station.group().scans());
                arm.begin(scan);
            });
            now
        });
        for arm in &mut self.arms {
            let times = of_arms.get(arm.station).map(|arm| arm.times).unwrap_or_default();
            if let (Some(place), Some(station)) = (place(arm.station), stations.get(arm.station)) {
                arm.follow(now, lead, &times, &place, station);
            }
        }
        self.move_on(now, lead, now.since(since) >= CLOCK_WAIT, stations);
        let seconds = now.since(core::mem::replace(&mut self.scanned, now)).as_secs_f64();
        let lets_suspend = self.lets_suspend(now, lead);
        let holds_at = now + lead;
        let position_s = self.master.map_or(0.0, |master| master.position_s());
        for arm in &mut self.arms {
            if let Some(station) = stations.get_mut(arm.station) {
                arm.send(holds_at, position_s, seconds, lets_suspend, station);
            }
        }
    }

    /// Moves the master on, once all arms are ready and their clocks known. Where a clock is not known for long, a set-point holds
    /// when its robot sees it.
    fn move_on(&mut self, now: Instant, lead: Duration, is_late: bool, stations: &[Station]) {
        let knows_clock = |arm: &LedArm| {
            let clock = stations.get(arm.station).and_then(Station::robot_clock);
            clock.is_some_and(|clock| clock.robot_time(now).is_some())
        };
        let is_ready = |arm: &LedArm| !arm.is_preparing() && (is_late || knows_clock(arm));
        if self.master.is_none() && self.arms.iter().all(is_ready) {
            self.master = Some(MasterAxis::at_rest(now + lead + STANDS_FIRST));
        }
        let Some(master) = self.master.as_mut().filter(|master| master.at() <= now + lead) else { return };
        let stop_at_s = self.arms.iter().map(LedArm::stop_at_s).fold(self.longest_s, f64::min);
        let rests = |arm: &LedArm| arm.rests_at(stop_at_s);
        let rate = |arm: &LedArm| stations.get(arm.station).map_or(0.0, |station| arm.highest_rate(station));
        let demand = MasterDemand {
            rate: self.arms.iter().map(rate).fold(1.0, f64::min),
            is_lagging: self.arms.iter().any(LedArm::is_lagging),
            stop_at_s,
            all_rest_there: self.arms.iter().all(rests),
        };
        master.advance(now + lead, &demand);
        if master.rate() > 0.0 {
            self.stands_since = None;
        } else {
            self.stands_since.get_or_insert(now);
        }
    }

    /// Returns whether a suspend may reach the robots: the arms have come to rest with the master.
    fn lets_suspend(&self, now: Instant, lead: Duration) -> bool {
        self.master.is_none()
            || self.stands_since.is_some_and(|since| now.since(since) >= lead + COMES_TO_REST)
    }
}
