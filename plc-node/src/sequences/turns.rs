//! The turns of an arm in shared zones: when it asks for one, how far it may go without it, and when it has left.

use machine::Instant;
use planning::{StationZones, Stop, ZoneSet, ZoneVisit};

use crate::Station;
use crate::sequence::{Reach, Sequence};
use crate::zones::Zones;

/// A wait of an arm before a shared zone, by the scans of the PLC.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct ZoneWait {
    /// Number of the zone in the setup, from 0.
    pub zone: usize,
    /// The first scan in which the PLC saw the arm stand there.
    pub came: Instant,
    /// The scan that granted the zone; `None` while the arm waits.
    pub granted: Option<Instant>,
}

/// The joints from which an arm is to move to the start, and the zones on that way.
type Way = ([f32; 6], ZoneSet);

/// The visits of an arm, and how far it is with them.
#[derive(Debug, Default)]
pub(super) struct ZoneTurns {
    visits: Vec<ZoneVisit>,
    /// Flags of the visits before which the stop switches something.
    switches: Vec<bool>,
    /// Volume of its arm in the cell; `None` in a cell without zones.
    zones: Option<StationZones>,
    /// Visits that were granted in this run.
    granted: usize,
    /// Visits before which the arm stood in this run; its capacity is taken at the start.
    waits: Vec<ZoneWait>,
    /// The way to the start that the arm waits for.
    way: Option<Way>,
}

impl ZoneTurns {
    pub(super) fn new(visits: Vec<ZoneVisit>, stops: &[Stop], zones: Option<StationZones>) -> Self {
        let switches = visits.iter().map(|visit| {
            stops.iter().any(|stop| u32::try_from(visit.after) == Ok(stop.after) && stop.then.is_some())
        });
        let (switches, waits) = (switches.collect(), Vec::with_capacity(visits.len()));
        Self { visits, switches, zones, granted: 0, waits, way: None }
    }

    pub(super) fn begin(&mut self) {
        self.granted = 0;
        self.waits.clear();
    }

    /// Returns whether the arm is in a zone in its plan.
    pub(super) const fn has_visits(&self) -> bool {
        !self.visits.is_empty()
    }

    /// Returns whether the cell has shared zones.
    pub(super) const fn has_zones(&self) -> bool {
        self.zones.is_some()
    }

    pub(super) fn waits(&self) -> &[ZoneWait] {
        &self.waits
    }

    fn next(&self) -> Option<&ZoneVisit> {
        self.visits.get(self.granted)
    }

    /// Returns how far the arm may go, if that is not as far as to its next mark.
    pub(super) fn limit(&self, to_mark: Reach) -> Reach {
        let after = self.next().map_or(u32::MAX, |visit| u32::try_from(visit.after).unwrap_or(u32::MAX));
        let with_action = self.switches.get(self.granted).copied().unwrap_or(false);
        if after < to_mark.motions { Reach { motions: after, with_action } } else { to_mark }
    }

    /// Returns the zones of visits that are granted and that the arm may not have left after this many motions.
    fn inside(&self, executed: u32) -> ZoneSet {
        let is_open =
            |visit: &&ZoneVisit| usize::try_from(executed).is_ok_and(|executed| executed < visit.until);
        let open = self.visits.iter().take(self.granted).filter(is_open);
        open.fold(ZoneSet::NONE, |zones, visit| zones.with(ZoneSet::of(visit.zone)))
    }

    /// Returns the zones of the visits that are still to come in this run.
    pub(super) fn to_come(&self) -> ZoneSet {
        let rest = self.visits.iter().skip(self.granted);
        rest.fold(ZoneSet::NONE, |zones, visit| zones.with(ZoneSet::of(visit.zone)))
    }

    /// Gives back what the arm has left.
    pub(super) fn leave(&self, arm: usize, sequence: &Sequence, zones: &mut Zones) {
        if self.has_zones() || self.has_visits() {
            zones.locate(arm, self.inside(sequence.executed()));
        }
    }

    /// Asks for the zones that the arm could enter now, none beyond its next mark, which comes after `to_mark` motions.
    pub(super) fn ask(
        &mut self,
        (arm, now): (usize, Instant),
        to_mark: u32,
        could_write: impl Fn(u32) -> bool,
        zones: &mut Zones,
    ) {
        while let Some(visit) = self.next() {
            let after = u32::try_from(visit.after).unwrap_or(u32::MAX);
            if after >= to_mark || !could_write(after) || !zones.request(arm, visit.zone) {
                return;
            }
            self.granted += 1;
            for wait in self.waits.iter_mut().filter(|wait| wait.granted.is_none()) {
                wait.granted = Some(now);
            }
        }
    }

    /// Returns the zone before which the arm stands and waits.
    pub(super) fn stands_before(&self, sequence: &Sequence, to_mark: Reach) -> Option<usize> {
        let (visit, limit) = (self.next()?, self.limit(to_mark));
        (limit != to_mark && sequence.has_come_to(limit)).then_some(visit.zone)
    }

    /// Notes that the arm stands before a zone.
    pub(super) fn note_wait(&mut self, now: Instant, zone: usize) {
        if self.waits.last().is_none_or(|wait| wait.granted.is_some()) {
            self.waits.push(ZoneWait { zone, came: now, granted: None });
        }
    }

    /// Returns the zones that an arm may be in that is at rest, or in no run; `None` if that is not known.
    pub(super) fn place_of(&self, station: &Station) -> Option<ZoneSet> {
        let (zones, joints) = (self.zones.as_ref()?, station.resting_joints()?);
        Some(zones.volume.at(&joints.map(f64::from)))
    }

    /// Returns the zones on the way of an arm to where its run starts.
    pub(super) fn way_of(&mut self, station: &Station) -> ZoneSet {
        let Some(zones) = &self.zones else { return ZoneSet::NONE };
        let Some(joints) = station.resting_joints() else { return ZoneSet::ALL };
        if station.comes_from_end() {
            return zones.from_end.with(zones.volume.at(&joints.map(f64::from)));
        }
        match self.way {
            Some((from, way)) if from == joints => way,
            _ => {
                let way = zones.volume.between(&joints.map(f64::from), &zones.start);
                self.way = Some((joints, way));
                way
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use machine::Duration;
    use planning::PlannedStation;
    use protocol::image::{Feedback, Order, State, Status};

    use crate::event::Events;
    use crate::program::{PlcProgram as _, SetOut};
    use crate::sequences::{Sequences, StationWork};
    use crate::station::StationState;
    use crate::{MotionList, Station, StationConfig};

    fn planned() -> Vec<PlannedStation> {
        let (cell, found) = planning::cell_with_applications("G").unwrap();
        found.plan(&cell).unwrap().stations
    }

    fn program(planned: &[PlannedStation]) -> Sequences {
        let work = |station: &PlannedStation| StationWork {
            program: 1,
            queue_depth: 5,
            refill: setup::Refill::Executed,
            motions: Box::new(MotionList::default()),
            stops: Vec::new(),
            waits: Vec::new(),
            visits: station.plan.visits.clone(),
            zones: station.zones.clone(),
        };
        Sequences::new(planned.iter().map(work).collect())
    }

    /// Returns a station whose arm rests in these joints, in the state.
    fn resting(index: usize, joints: [f64; 6], state: StationState) -> Station {
        let config = StationConfig::patient(100);
        let mut station = Station::new(index, config, Order::BigEndian, Duration::from_millis(1));
        station.connect();
        station.state = state;
        let feedback = Feedback {
            state: State::Ready,
            status: Status::ENABLED | Status::AT_REST,
            joints: joints.map(|joint| joint as f32),
            ..Feedback::default()
        };
        station.group_mut().read(Some(feedback));
        station
    }

    fn to_move(index: usize, joints: [f64; 6]) -> Station {
        let mut station = resting(index, joints, StationState::Ready);
        station.move_to_start(false);
        station
    }

    #[test]
    fn an_arm_sets_out_only_when_no_other_arm_is_or_may_be_in_a_zone_on_its_way() {
        let planned = planned();
        let put = |arm: usize| planned[arm].reached.targets[planned[arm].plan.visits[0].until - 3];
        let start = |arm: usize| planned[arm].reached.start;
        let mut program = program(&planned);
        let is =
            |program: &mut Sequences, arm: usize, stations: [Station; 2]| program.set_out(arm, &stations);
        // Nobody knows where the other arm is: its robot is being led to Ready, or has no connection.
        let preparing = || resting(1, start(1), StationState::Preparing);
        assert_eq!(is(&mut program, 0, [to_move(0, put(0)), preparing()]), SetOut::Blocked);
        // The other one rests in the zone.
        assert_eq!(is(&mut program, 0, [to_move(0, put(0)), to_move(1, put(1))]), SetOut::Blocked);
        // Its own way does not lead through the zone.
        let beside = planned[0].reached.targets[0];
        assert_eq!(is(&mut program, 0, [to_move(0, beside), to_move(1, put(1))]), SetOut::Now);
        // The other one rests outside.
        let ready = || resting(1, start(1), StationState::Ready);
        assert_eq!(is(&mut program, 0, [to_move(0, put(0)), ready()]), SetOut::Now);
        // Now this one is on its way through the zone, and keeps it until it rests.
        let mut on_way = to_move(0, put(0));
        on_way.go_on_to_start(machine::Instant::ZERO, &mut Events::for_stations(2));
        assert!(on_way.is_on_its_way());
        assert_eq!(is(&mut program, 1, [on_way, to_move(1, put(1))]), SetOut::Wait);
        let arrived = resting(0, start(0), StationState::Ready);
        assert_eq!(is(&mut program, 1, [arrived, to_move(1, put(1))]), SetOut::Now);
        // A lost connection: somebody else may move it.
        let mut lost = resting(0, start(0), StationState::Ready);
        lost.disarm();
        assert_eq!(is(&mut program, 1, [lost, to_move(1, put(1))]), SetOut::Blocked);
    }
}
