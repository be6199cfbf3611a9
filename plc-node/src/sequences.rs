//! The paper's sequences as a PLC program: each station's motions as RC, SM or CM.
//!
//! Arms wait for each other at marks. No motion beyond a mark is given to a robot before all arms of the mark have come to it: with
//! CM the PLC writes no slot beyond, and the arm stops there as at any last motion that it knows, without losing its skill. With RC the stored
//! programs wait themselves: each robot switches an output, and the PLC passes it on to the inputs of the others.
//!
//! In shared zones they take turns: no motion that leads into a zone is given to a robot before the zone is granted to its arm.

#[cfg(test)]
mod exploration;
mod in_step;
mod signals;
mod turns;
mod work;
#[cfg(test)]
mod zone_exploration;

pub use turns::ZoneWait;
pub use work::{MarkPassage, StationWork};

use machine::{Duration, Instant};
use planning::{MarkSignal, Stop, WaitAt, ZoneSet};
use protocol::image::{Digest, Services, Sum};
use setup::Refill;

use in_step::{ArmPlace, InStep};
use signals::MarkOutputs;

use crate::arm_in_step::ArmInStep;
use crate::motion_source::Digested;
use crate::program::{AfterLoss, PlcProgram, Progress, SetOut, Totals};
use crate::sequence::{Reach, Sequence, SkillProgress};
use crate::zones::Zones;
use crate::{ExecutionType, FailureCause, MotionSource, StartError, Station};
use turns::ZoneTurns;

/// The program that runs the sequences of all stations.
#[derive(Debug)]
pub struct Sequences {
    parts: Vec<Part>,
    zones: Zones,
    in_step: InStep,
    execution_type: ExecutionType,
}

/// The sequence of a station.
#[derive(Debug)]
struct Part {
    sequence: Sequence,
    program: u16,
    queue_depth: u32,
    refill: Refill,
    motions: Digested,
    stops: Vec<Stop>,
    /// Those of them whose action is the PLC's with RC, too: where no stored program meets others.
    stops_of_rc: Vec<Stop>,
    waits: Vec<WaitAt>,
    outputs: MarkOutputs,
    /// Marks that were passed in this run.
    passed: usize,
    /// Marks that the arm came to in this run; its capacity is taken at the start.
    passages: Vec<MarkPassage>,
    turns: ZoneTurns,
    state: PartState,
    /// What went wrong in the scan in which another station's trouble came first.
    trouble: Option<Progress>,
}

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum PartState {
    Running,
    Done,
    Lost,
}

impl Part {
    fn new(work: StationWork) -> Self {
        let StationWork { program, queue_depth, refill, motions, stops, waits, visits, zones } = work;
        let meets = |stop: &Stop| {
            let mut waits = waits.iter().filter(|wait| wait.signal.is_some());
            waits.any(|wait| u32::try_from(wait.after) == Ok(stop.after))
        };
        Self {
            turns: ZoneTurns::new(visits, &stops, zones),
            stops_of_rc: stops.iter().filter(|stop| !meets(stop)).copied().collect(),
            outputs: MarkOutputs::of(&waits),
            sequence: Sequence::new(ExecutionType::Rc, program, queue_depth),
            program,
            queue_depth,
            refill,
            motions: Digested::new(motions),
            stops,
            passages: Vec::with_capacity(waits.len()),
            waits,
            passed: 0,
            state: PartState::Done,
            trouble: None,
        }
    }

    fn begin(&mut self, execution_type: ExecutionType) {
        let sequence = Sequence::new(execution_type, self.program, self.queue_depth).refilled_by(self.refill);
        let sequence = sequence.with_points(self.motions.point_head());
        let is_whole = self.waits.iter().all(|wait| wait.signal.is_some()) && !self.turns.has_visits();
        self.sequence = if is_whole { sequence } else { sequence.in_sections() };
        self.outputs.begin();
        self.turns.begin();
        self.motions.restart();
        self.passed = 0;
        self.passages.clear();
        (self.state, self.trouble) = (PartState::Running, None);
    }

    /// Returns how far the arm may go: to the next mark that it has not passed, and not into a zone that it was not granted. At a mark with
    /// outputs its stored program waits itself.
    fn reach(&self) -> Reach {
        let mut waits = self.waits.iter().skip(self.passed);
        self.turns.limit(reach_to(waits.find(|wait| self.signal_at(wait).is_none())))
    }

    /// Returns how far the arm is to go before it meets others.
    fn reach_of_marks(&self) -> Reach {
        reach_to(self.waits.get(self.passed))
    }

    /// Returns the outputs by which the stored program of this run meets others at a mark.
    fn signal_at(&self, wait: &WaitAt) -> Option<MarkSignal> {
        wait.signal.filter(|_| self.sequence.is_rc())
    }

    /// Returns the mark at which the arm stands and waits.
    fn stands_at(&self) -> Option<u32> {
        let wait = self.waits.get(self.passed)?;
        let stands = match self.signal_at(wait) {
            Some(signal) => signal.is_shown_by(self.outputs.shown()),
            None => self.sequence.has_come_to(self.reach_of_marks()),
        };
        (self.state != PartState::Lost && stands).then_some(wait.mark)
    }

    /// Returns the mark that the stored program has passed before the others came, by the motions that it counts.
    fn ignored_mark(&self, is_done: bool) -> Option<u32> {
        let wait = self.waits.get(self.passed).filter(|wait| self.signal_at(wait).is_some())?;
        let after = u32::try_from(wait.after).unwrap_or(u32::MAX);
        (is_done || self.sequence.executed() > after).then_some(wait.mark)
    }

    /// Notes that the arm has come to a mark.
    fn note_arrival(&mut self, now: Instant) {
        if let Some(mark) = self.stands_at()
            && self.passages.len() == self.passed
        {
            self.passages.push(MarkPassage { mark, came: now, passed: None });
        }
    }

    /// Lets the arm pass the mark at which it stands.
    fn pass(&mut self, now: Instant) {
        if let Some(passage) = self.passages.get_mut(self.passed) {
            passage.passed = Some(now);
        }
        self.passed += 1;
    }

    /// Returns where the arm is, as far as others that are in step with it need to know.
    fn place(&self) -> ArmPlace {
        let passed = self.passed.checked_sub(1).and_then(|last| self.waits.get(last));
        ArmPlace {
            passed: passed.filter(|_| self.state == PartState::Running).map(|wait| wait.mark),
            step: self.sequence.step(),
            is_called: self.state == PartState::Running && !self.sequence.is_between_skills(),
            stands: self.stands_at().is_some(),
            total: self.motions.total(),
        }
    }

    /// Returns whether the arm comes to a mark in this run that it has not passed.
    fn comes_to(&self, mark: u32) -> bool {
        self.waits.iter().skip(self.passed).any(|wait| wait.mark == mark)
    }

    /// Returns whether both arms come to one mark that they have not passed.
    fn shares_mark_with(&self, other: &Self) -> bool {
        self.waits.iter().skip(self.passed).any(|wait| other.comes_to(wait.mark))
    }
}

/// Returns how far an arm goes to this wait.
fn reach_to(wait: Option<&WaitAt>) -> Reach {
    wait.map_or(Reach::END, |wait| Reach {
        motions: u32::try_from(wait.after).unwrap_or(u32::MAX),
        with_action: wait.after_action,
    })
}

impl Sequences {
    /// Creates the program with the work of each station, in the order of the stations.
    #[must_use]
    pub fn new(work: Vec<StationWork>) -> Self {
        let parts: Vec<Part> = work.into_iter().map(Part::new).collect();
        Self {
            zones: Zones::unknown(parts.len()),
            parts,
            in_step: InStep::default(),
            execution_type: ExecutionType::Rc,
        }
    }

    /// Returns the waits of a station before shared zones in this run, or in the last one, in order.
    #[must_use]
    pub fn zone_waits(&self, station: usize) -> &[ZoneWait] {
        self.parts.get(station).map_or(&[], |part| part.turns.waits())
    }

    /// Returns the grants of the shared zones.
    #[must_use]
    pub const fn zones(&self) -> &Zones {
        &self.zones
    }

    /// Returns the digest of the motions that a station took from their source in this run, or in the last one.
    #[must_use]
    pub fn digest(&self, station: usize) -> Option<&Digest> {
        self.parts.get(station).map(|part| part.motions.given())
    }

    /// Lets the arms pass each mark at which all stand that have it.
    fn pass_marks(&mut self, now: Instant) {
        loop {
            self.parts.iter_mut().for_each(|part| part.note_arrival(now));
            let together = |mark: u32| {
                let mut having = self.parts.iter().filter(|part| part.comes_to(mark));
                having.all(|part| part.stands_at() == Some(mark))
            };
            let Some(mark) = self.parts.iter().filter_map(Part::stands_at).find(|mark| together(*mark))
            else {
                return;
            };
            for part in self.parts.iter_mut().filter(|part| part.stands_at() == Some(mark)) {
                part.pass(now);
            }
        }
    }
}

impl Sequences {
    /// Takes back the zones that arms have left, and grants those that they could enter now.
    fn take_turns(&mut self, now: Instant) {
        let is_running = |part: &Part| part.state == PartState::Running;
        for (arm, part) in self.parts.iter().enumerate().filter(|(_, part)| part.state != PartState::Lost) {
            part.turns.leave(arm, &part.sequence, &mut self.zones);
        }
        for (arm, part) in self.parts.iter_mut().enumerate().filter(|(_, part)| is_running(part)) {
            let reach = part.reach_of_marks();
            let (sequence, stops) = (&part.sequence, &part.stops);
            let could_write = |motion| sequence.could_write(motion, stops);
            part.turns.ask((arm, now), reach.motions, could_write, &mut self.zones);
            if let Some(zone) = part.turns.stands_before(&part.sequence, reach) {
                part.turns.note_wait(now, zone);
            }
        }
    }

    /// Passes the outputs on by which stored programs meet; without such programs it clears them.
    fn pass_outputs_on(&mut self, stations: &mut [Station]) {
        if self.execution_type == ExecutionType::Rc {
            let running =
                self.parts.iter_mut().zip(&*stations).filter(|(part, _)| part.state != PartState::Lost);
            running.for_each(|(part, station)| part.outputs.read(&part.sequence, station));
        }
        let shown = self.parts.iter().fold(0, |all, part| all | part.outputs.shown());
        for (part, station) in self.parts.iter().zip(stations) {
            part.outputs.pass_on(shown, station);
        }
    }

    /// Notes where all arms are that rest, as far as the PLC knows.
    fn locate_arms(&mut self, stations: &[Station]) {
        for (arm, (part, station)) in self.parts.iter().zip(stations).enumerate() {
            if !station.is_connected() {
                // Somebody else may move it.
                self.zones.locate(arm, ZoneSet::ALL);
            } else if let Some(zones) = part.turns.place_of(station) {
                self.zones.locate(arm, zones);
            }
        }
    }
}

impl PlcProgram for Sequences {
    fn check(&self, execution_type: ExecutionType, stations: &[Station]) -> Result<(), StartError> {
        let is_empty = |part: &Part| part.motions.total() == 0;
        if execution_type != ExecutionType::Rc && self.parts.iter().any(is_empty) {
            return Err(StartError::NoMotions(execution_type));
        }
        let is_led = |(index, _): &(usize, &Station)| self.in_step.moves_together(execution_type, *index);
        let serves = |station: &Station| {
            station.group().feedback().is_some_and(|feedback| feedback.services.contains(Services::SYNC))
        };
        let mut led = stations.iter().enumerate().filter(is_led);
        led.find(|(_, station)| !serves(station))
            .map_or(Ok(()), |(station, _)| Err(StartError::NoSync(station)))
    }

    fn keep_in_step(&mut self, arms: Vec<ArmInStep>) {
        self.in_step = InStep::of(arms);
    }

    fn begin(&mut self, _now: Instant, execution_type: ExecutionType) {
        self.execution_type = execution_type;
        self.in_step.begin();
        self.parts.iter_mut().for_each(|part| part.begin(execution_type));
        for arm in 0..self.parts.len() {
            // A run begins with all arms at their starts, which are outside of all zones.
            self.zones.withdraw(arm);
            self.zones.locate(arm, ZoneSet::NONE);
        }
    }

    fn set_out(&mut self, station: usize, stations: &[Station]) -> SetOut {
        if !self.parts.iter().any(|part| part.turns.has_zones()) {
            return SetOut::Now;
        }
        self.locate_arms(stations);
        let way = match (self.parts.get_mut(station), stations.get(station)) {
            (Some(part), Some(own)) => part.turns.way_of(own),
            _ => return SetOut::Blocked,
        };
        if self.zones.request_all(station, way) {
            return SetOut::Now;
        }
        let is_way_under_way = stations.iter().any(Station::is_on_its_way);
        if is_way_under_way { SetOut::Wait } else { SetOut::Blocked }
    }

    /// Runs all parts also where one has trouble: the others may go on.
    fn scan(&mut self, now: Instant, stations: &mut [Station]) -> Progress {
        self.pass_outputs_on(stations);
        self.pass_marks(now);
        self.take_turns(now);
        let mut is_running = false;
        for (index, (part, station)) in self.parts.iter_mut().zip(&mut *stations).enumerate() {
            if part.state != PartState::Running || part.trouble.is_some() {
                continue;
            }
            let reach = part.reach();
            let stops = if part.sequence.is_rc() { &part.stops_of_rc } else { &part.stops };
            match part.sequence.scan(now, &mut part.motions, stops, reach, station.group_mut()) {
                progress @ (SkillProgress::Running | SkillProgress::Done) => {
                    let is_done = progress == SkillProgress::Done;
                    match part.ignored_mark(is_done) {
                        Some(mark) => {
                            let cause = FailureCause::MarkIgnored { mark };
                            part.trouble = Some(Progress::Ended { station: index, cause });
                        }
                        None if is_done => part.state = PartState::Done,
                        None => is_running = true,
                    }
                }
                SkillProgress::Aborted => part.trouble = Some(Progress::Aborted { station: index }),
                SkillProgress::Failed { motion, error } => {
                    part.trouble = Some(Progress::Failed { station: index, motion, error });
                }
            }
        }
        self.parts.iter_mut().for_each(|part| part.note_arrival(now));
        let place = |index: usize| self.parts.get(index).map(Part::place);
        self.in_step.lead(now, self.execution_type, place, stations);
        let running = self.parts.iter_mut().filter(|part| part.state == PartState::Running);
        if let Some(trouble) = running.filter_map(|part| part.trouble.take()).next() {
            return trouble;
        }
        if is_running { Progress::Running } else { Progress::Done }
    }

    /// Others that would wait for the lost arm at a mark end with it, and those that would wait for a zone that it may be in.
    fn lose(&mut self, station: usize, _cause: FailureCause) -> AfterLoss {
        let Some(part) = self.parts.get_mut(station) else { return AfterLoss::EndRun };
        part.state = PartState::Lost;
        // What it holds it keeps: it may be inside, or get there.
        self.zones.withdraw(station);
        let held = self.zones.held(station);
        let mut running = self.parts.iter().filter(|part| part.state == PartState::Running).peekable();
        let is_last = running.peek().is_none();
        let lost = self.parts.get(station);
        let is_awaited = |part: &Part| {
            lost.is_some_and(|lost| lost.shares_mark_with(part)) || part.turns.to_come().meets(held)
        };
        if is_last || running.any(is_awaited) { AfterLoss::EndRun } else { AfterLoss::GoOn }
    }

    fn waits(&self, station: usize) -> bool {
        self.parts.get(station).is_none_or(|part| {
            part.state != PartState::Running
                || part.sequence.waits()
                || part.stands_at().is_some()
                || part.turns.stands_before(&part.sequence, part.reach_of_marks()).is_some()
        }) || self.in_step.waits(station)
    }

    fn marks(&self, station: usize) -> [u32; 2] {
        let count = |marks: usize| u32::try_from(marks).unwrap_or(u32::MAX);
        self.parts.get(station).map_or([0; 2], |part| [part.passages.len(), part.passed].map(count))
    }

    fn totals(&self, station: usize) -> Totals {
        self.parts.get(station).map(|part| part.sequence.totals()).unwrap_or_default()
    }

    fn passages(&self, station: usize) -> &[MarkPassage] {
        self.parts.get(station).map_or(&[], |part| &part.passages)
    }

    fn waited_for_zones(&self, station: usize) -> Option<Duration> {
        let turns = self.parts.get(station).map(|part| &part.turns).filter(|turns| turns.has_zones())?;
        Some(turns.waits().iter().filter_map(|wait| Some(wait.granted?.since(wait.came))).sum())
    }

    fn sent(&self, station: usize) -> Sum {
        self.parts.get(station).map_or_else(|| Digest::default().sum(), |part| part.motions.given().sum())
    }
}
