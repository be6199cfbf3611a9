//! All orders in which arms ask for zones, enter, leave, lose their cables, halt and move to their starts, and in which the PLC
//! loses its memory, until no new state appears.
//!
//! The arms here do with [`Zones`] what [`Sequences`](crate::Sequences) does: they give back what the PLC has seen them leave, ask for
//! the next visit within reach, and get no motion beyond one that is not granted.

use std::collections::BTreeSet;

use planning::{Plan, WaitAt, ZoneSet, ZoneVisit, check_turns};

use super::Zones;

/// Motions of an arm, its visits (zone, after, until), and where it waits at mark 1.
#[derive(Clone, Debug)]
struct VisitingWork {
    motions: u8,
    visits: Vec<(usize, u8, u8)>,
    mark: Option<u8>,
}

impl VisitingWork {
    fn new(motions: u8, visits: &[(usize, u8, u8)]) -> Self {
        let mut visits = visits.to_vec();
        visits.sort_by_key(|(zone, after, _)| (*after, *zone));
        Self { motions, visits, mark: None }
    }

    /// Returns the zones in which an arm may be that has executed so many motions, and moves in the next one or stands.
    fn inside(&self, executed: u8, moves: bool) -> ZoneSet {
        let is_in = |(_, after, until): &&(usize, u8, u8)| {
            executed < *until && (*after < executed || *after == executed && moves)
        };
        set(self.visits.iter().filter(is_in).map(|(zone, ..)| *zone))
    }

    fn plan(&self) -> Plan {
        let visit = |(zone, after, until): &(usize, u8, u8)| ZoneVisit {
            zone: *zone,
            after: usize::from(*after),
            until: usize::from(*until),
        };
        let wait =
            |after: &u8| WaitAt { mark: 1, after: usize::from(*after), after_action: false, signal: None };
        Plan {
            visits: self.visits.iter().map(visit).collect(),
            waits: self.mark.iter().map(wait).collect(),
            ..Plan::default()
        }
    }
}

fn set(zones: impl Iterator<Item = usize>) -> ZoneSet {
    zones.fold(ZoneSet::NONE, |all, zone| all.with(ZoneSet::of(zone)))
}

/// The zones on the way to the start: whoever is in zone 1 comes through zone 0.
fn way_from(place: ZoneSet) -> ZoneSet {
    if place.contains(1) { place.with(ZoneSet::of(0)) } else { place }
}

#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
enum Whereabouts {
    /// Where its run starts.
    Start,
    /// In the run, or still executing what it has got of one.
    Executing,
    /// It halted somewhere, in these zones.
    Halted(ZoneSet),
    /// On its way to the start through these zones.
    OnWay(ZoneSet),
}

#[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Debug)]
struct GrantedArm {
    place: Whereabouts,
    /// Motions that it has executed, those that the PLC has seen, and those that it has got.
    executed: u8,
    seen: u8,
    got: u8,
    /// Visits that are granted.
    granted: usize,
    has_passed: bool,
    is_cut: bool,
    is_lost: bool,
}

impl GrantedArm {
    const NEW: Self = Self {
        place: Whereabouts::Start,
        executed: 0,
        seen: 0,
        got: 0,
        granted: 0,
        has_passed: false,
        is_cut: false,
        is_lost: false,
    };
}

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum ZoneStep {
    Execute(usize),
    /// Its cable is cut or mended.
    Cut(usize),
    /// The PLC gives it up in the run.
    Lose(usize),
    /// It halts: at once, in the middle of a motion.
    Halt(usize),
    Arrive(usize),
    /// The PLC starts anew and knows nothing.
    Restart,
    /// The PLC begins the run.
    Begin,
}

#[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Debug)]
struct GrantedCell {
    arms: Vec<GrantedArm>,
    zones: Zones,
    is_running: bool,
}

/// The work of all arms of a cell.
struct World {
    work: Vec<VisitingWork>,
    /// Motions that the PLC writes ahead.
    depth: u8,
}

impl World {
    fn new(work: Vec<VisitingWork>, depth: u8) -> Self {
        Self { work, depth }
    }

    fn at_power_on(&self) -> GrantedCell {
        let arms = vec![GrantedArm::NEW; self.work.len()];
        let mut cell = GrantedCell { zones: Zones::unknown(arms.len()), arms, is_running: false };
        self.settle(&mut cell);
        cell
    }

    fn moves(&self, arm: &GrantedArm) -> bool {
        arm.place == Whereabouts::Executing && arm.executed < arm.got
    }

    /// Returns the zones that an arm may truly be in.
    fn inside(&self, index: usize, arm: &GrantedArm) -> ZoneSet {
        match arm.place {
            Whereabouts::Start => ZoneSet::NONE,
            Whereabouts::Halted(place) | Whereabouts::OnWay(place) => place,
            Whereabouts::Executing => self.work[index].inside(arm.executed, self.moves(arm)),
        }
    }

    fn check(&self, cell: &GrantedCell) {
        let mut taken = ZoneSet::NONE;
        for (index, arm) in cell.arms.iter().enumerate() {
            let inside = self.inside(index, arm);
            assert!(!taken.meets(inside), "two arms are in a zone: {cell:?}");
            taken = taken.with(inside);
        }
    }

    /// Returns the steps that are possible.
    fn steps(&self, cell: &GrantedCell) -> Vec<ZoneStep> {
        let mut steps = vec![ZoneStep::Restart];
        for (index, arm) in cell.arms.iter().enumerate() {
            steps.push(ZoneStep::Cut(index));
            if self.moves(arm) {
                steps.push(ZoneStep::Execute(index));
            }
            if cell.is_running && !arm.is_lost {
                steps.push(ZoneStep::Lose(index));
            }
            // A robot in a run halts only because it is lost.
            match arm.place {
                Whereabouts::Executing if !cell.is_running || arm.is_lost => {
                    steps.push(ZoneStep::Halt(index))
                }
                Whereabouts::OnWay(_) => steps.extend([ZoneStep::Halt(index), ZoneStep::Arrive(index)]),
                _ => {}
            }
        }
        if !cell.is_running {
            steps.push(ZoneStep::Begin);
        }
        steps
    }

    fn step(&self, cell: &mut GrantedCell, step: ZoneStep) {
        match step {
            ZoneStep::Execute(arm) => cell.arms[arm].executed += 1,
            ZoneStep::Cut(arm) => cell.arms[arm].is_cut ^= true,
            ZoneStep::Lose(arm) => self.lose(cell, arm),
            ZoneStep::Halt(arm) => {
                let place = self.inside(arm, &cell.arms[arm]);
                cell.arms[arm].place = Whereabouts::Halted(place);
            }
            ZoneStep::Arrive(arm) => cell.arms[arm].place = Whereabouts::Start,
            ZoneStep::Restart => {
                cell.zones = Zones::unknown(cell.arms.len());
                cell.is_running = false;
            }
            ZoneStep::Begin => self.begin(cell),
        }
        self.settle(cell);
    }

    /// Begins a run if all arms are at their starts, as the PLC sees it.
    fn begin(&self, cell: &mut GrantedCell) {
        if !cell.arms.iter().all(|arm| arm.place == Whereabouts::Start && !arm.is_cut) {
            return;
        }
        cell.is_running = true;
        for (index, arm) in cell.arms.iter_mut().enumerate() {
            *arm = GrantedArm { place: Whereabouts::Executing, ..GrantedArm::NEW };
            cell.zones.withdraw(index);
            cell.zones.locate(index, ZoneSet::NONE);
        }
    }

    fn lose(&self, cell: &mut GrantedCell, lost: usize) {
        cell.arms[lost].is_lost = true;
        cell.zones.withdraw(lost);
        let held = cell.zones.held(lost);
        let waits_for_it = |(index, arm): (usize, &GrantedArm)| {
            let to_come = self.work[index].visits.iter().skip(arm.granted).map(|(zone, ..)| *zone);
            !arm.is_lost && (set(to_come).meets(held) || self.shares_mark(cell, lost, index))
        };
        if cell.arms.iter().enumerate().any(waits_for_it) || cell.arms.iter().all(|arm| arm.is_lost) {
            cell.is_running = false;
        }
    }

    fn shares_mark(&self, cell: &GrantedCell, lost: usize, other: usize) -> bool {
        [lost, other].into_iter().all(|arm| self.work[arm].mark.is_some() && !cell.arms[arm].has_passed)
    }

    /// Runs scans of the PLC until nothing changes.
    fn settle(&self, cell: &mut GrantedCell) {
        loop {
            let before = cell.clone();
            if cell.is_running {
                self.scan_run(cell)
            } else {
                self.scan_idle(cell)
            }
            if *cell == before {
                return;
            }
        }
    }

    fn scan_run(&self, cell: &mut GrantedCell) {
        let stands_at_mark = |cell: &GrantedCell, index: usize| {
            let arm = &cell.arms[index];
            let mark = self.work[index].mark.filter(|_| !arm.has_passed);
            mark.is_some_and(|after| arm.seen >= after && !arm.is_lost)
        };
        let having: Vec<usize> = (0..cell.arms.len())
            .filter(|arm| self.work[*arm].mark.is_some() && !cell.arms[*arm].has_passed)
            .collect();
        if having.iter().all(|arm| stands_at_mark(cell, *arm)) {
            having.into_iter().for_each(|arm| cell.arms[arm].has_passed = true);
        }
        for (index, arm) in cell.arms.iter_mut().enumerate().filter(|(_, arm)| !arm.is_lost) {
            if !arm.is_cut {
                arm.seen = arm.executed;
            }
            let granted = self.work[index].visits.iter().take(arm.granted);
            let open = granted.filter(|(_, _, until)| arm.seen < *until).map(|(zone, ..)| *zone);
            cell.zones.locate(index, set(open));
        }
        for (index, arm) in cell.arms.iter_mut().enumerate().filter(|(_, arm)| !arm.is_lost) {
            let work = &self.work[index];
            let to_mark = work.mark.filter(|_| !arm.has_passed).unwrap_or(u8::MAX);
            while let Some((zone, after, _)) = work.visits.get(arm.granted) {
                let could_write = *after <= arm.seen || *after - arm.seen < self.depth;
                if *after >= to_mark || !could_write || !cell.zones.request(index, *zone) {
                    break;
                }
                arm.granted += 1;
            }
            let to_zone = work.visits.get(arm.granted).map_or(u8::MAX, |(_, after, _)| *after);
            let written = work.motions.min(to_mark).min(to_zone).min(arm.seen + self.depth);
            if !arm.is_cut {
                arm.got = arm.got.max(written);
            }
        }
        let is_done = |(arm, work): (&GrantedArm, &VisitingWork)| arm.is_lost || arm.seen == work.motions;
        if cell.arms.iter().zip(&self.work).all(is_done) {
            cell.is_running = false;
            for (arm, work) in cell.arms.iter_mut().zip(&self.work) {
                if arm.executed == work.motions {
                    arm.place = Whereabouts::Start;
                }
            }
        }
    }

    /// Locates arms that rest, and lets them set out for their starts.
    fn scan_idle(&self, cell: &mut GrantedCell) {
        for (index, arm) in cell.arms.iter().enumerate() {
            match arm.place {
                _ if arm.is_cut => cell.zones.locate(index, ZoneSet::ALL),
                Whereabouts::Start => cell.zones.locate(index, ZoneSet::NONE),
                Whereabouts::Halted(place) => cell.zones.locate(index, place),
                Whereabouts::Executing | Whereabouts::OnWay(_) => {}
            }
        }
        for (index, arm) in cell.arms.iter_mut().enumerate().filter(|(_, arm)| !arm.is_cut) {
            if let Whereabouts::Halted(place) = arm.place {
                let way = way_from(place);
                if cell.zones.request_all(index, way) {
                    arm.place = Whereabouts::OnWay(way);
                }
            }
        }
    }

    /// Checks that all gets to its end once the cables are mended: the run, and the ways to the starts.
    fn check_end(&self, mut cell: GrantedCell) {
        cell.arms.iter_mut().for_each(|arm| arm.is_cut = false);
        self.settle(&mut cell);
        let unended = cell.clone();
        for _ in 0..100 {
            for index in 0..cell.arms.len() {
                let step = match cell.arms[index].place {
                    Whereabouts::Executing if self.moves(&cell.arms[index]) => ZoneStep::Execute(index),
                    Whereabouts::Executing if !cell.is_running => ZoneStep::Halt(index),
                    Whereabouts::OnWay(_) => ZoneStep::Arrive(index),
                    _ => continue,
                };
                self.step(&mut cell, step);
                self.check(&cell);
            }
        }
        assert!(!cell.is_running, "the run never ends: {unended:?}");
        assert!(
            cell.arms.iter().all(|arm| arm.place == Whereabouts::Start),
            "an arm never gets to its start: {unended:?}"
        );
    }

    /// Explores all states; returns how many there are.
    fn explore(&self) -> usize {
        let mut known = BTreeSet::new();
        let mut open = vec![self.at_power_on()];
        while let Some(cell) = open.pop() {
            if !known.insert(normal(&cell)) {
                continue;
            }
            self.check(&cell);
            self.check_end(cell.clone());
            for step in self.steps(&cell) {
                let mut next = cell.clone();
                self.step(&mut next, step);
                open.push(next);
            }
        }
        known.len()
    }
}

/// Returns the state without the count of requests: only their order is one.
fn normal(cell: &GrantedCell) -> GrantedCell {
    let mut cell = cell.clone();
    let mut asked: Vec<u64> = cell.zones.asked.iter().flatten().map(|(_, since)| *since).collect();
    asked.sort_unstable();
    for (_, since) in cell.zones.asked.iter_mut().flatten() {
        *since = asked.iter().position(|it| it == since).unwrap_or_default() as u64;
    }
    cell.zones.next = 0;
    cell
}

#[test]
fn no_order_of_events_losses_halts_and_restarts_lets_two_arms_into_a_zone_or_leaves_one_waiting_for_ever() {
    let worlds = [
        World::new(vec![VisitingWork::new(3, &[(0, 1, 2)]), VisitingWork::new(3, &[(0, 0, 2)])], 1),
        World::new(
            vec![
                VisitingWork::new(4, &[(0, 1, 3), (1, 2, 4)]),
                VisitingWork::new(3, &[(0, 0, 1), (1, 1, 3)]),
            ],
            2,
        ),
        World::new(
            vec![
                VisitingWork::new(4, &[(0, 0, 1), (0, 2, 3)]),
                VisitingWork::new(3, &[(0, 1, 2), (1, 1, 2)]),
            ],
            3,
        ),
        World::new(
            vec![
                VisitingWork::new(2, &[(0, 1, 2)]),
                VisitingWork::new(2, &[(0, 0, 1)]),
                VisitingWork::new(2, &[(0, 1, 2)]),
            ],
            1,
        ),
        World::new(
            vec![
                VisitingWork::new(2, &[(0, 0, 1), (1, 1, 2)]),
                VisitingWork::new(1, &[(0, 0, 1)]),
                VisitingWork::new(1, &[(1, 0, 1)]),
            ],
            2,
        ),
    ];
    for world in worlds {
        let states = world.explore();
        assert!(states > 500, "{states} states of {:?}", world.work);
    }
}

#[test]
#[should_panic(expected = "two arms are in a zone")]
fn a_zone_that_is_given_back_when_an_arm_is_lost_lets_two_arms_in() {
    let world = World::new(vec![VisitingWork::new(2, &[(0, 0, 2)]), VisitingWork::new(2, &[(0, 0, 2)])], 1);
    let mut cell = world.at_power_on();
    world.step(&mut cell, ZoneStep::Begin);
    world.step(&mut cell, ZoneStep::Cut(0));
    cell.zones.locate(0, ZoneSet::NONE);
    cell.arms[0].is_lost = true;
    world.settle(&mut cell);
    world.check(&cell);
}

/// Returns whether the arms of a world can wait for each other for ever, without losses.
fn can_stand_still(world: &World) -> bool {
    let mut begun = world.at_power_on();
    world.step(&mut begun, ZoneStep::Begin);
    let mut known = BTreeSet::new();
    let mut open = vec![begun];
    while let Some(cell) = open.pop() {
        if !known.insert(normal(&cell)) || !cell.is_running {
            continue;
        }
        let moving: Vec<usize> = (0..cell.arms.len()).filter(|arm| world.moves(&cell.arms[*arm])).collect();
        if moving.is_empty() {
            return true;
        }
        for arm in moving {
            let mut next = cell.clone();
            world.step(&mut next, ZoneStep::Execute(arm));
            open.push(next);
        }
    }
    false
}

#[test]
fn planning_accepts_no_work_in_which_arms_can_wait_for_each_other_for_ever_and_refuses_little_else() {
    const MOTIONS: u8 = 3;
    let spans: Vec<Option<(u8, u8)>> = (0..MOTIONS)
        .flat_map(|after| (after + 1..=MOTIONS).map(move |until| Some((after, until))))
        .chain([None])
        .collect();
    let mut works = Vec::new();
    for first in &spans {
        for second in &spans {
            let visit =
                |zone: usize, span: &Option<(u8, u8)>| span.map(|(after, until)| (zone, after, until));
            let visits: Vec<_> = [visit(0, first), visit(1, second)].into_iter().flatten().collect();
            works.push(VisitingWork::new(MOTIONS, &visits));
        }
    }
    let marks = [None, Some([1, 1]), Some([2, 2]), Some([1, 2]), Some([0, 3])];
    let mut counts = [0, 0];
    for left in &works {
        for right in &works {
            for marks in &marks {
                let mut work = vec![left.clone(), right.clone()];
                for (arm, work) in work.iter_mut().enumerate() {
                    work.mark = marks.map(|marks| marks[arm]);
                }
                let plans: Vec<Plan> = work.iter().map(VisitingWork::plan).collect();
                let arms: Vec<_> = ["left", "right"].into_iter().zip(&plans).collect();
                let refused = check_turns(&arms, &["0".to_owned(), "1".to_owned()]);
                let [stands, stands_with_more] =
                    [1, 5].map(|depth| can_stand_still(&World::new(work.clone(), depth)));
                assert!(refused.is_err() || !stands && !stands_with_more, "{work:?}");
                // What is asked for in one scan, as the first one and that after a mark, has one order, by chance.
                let asks_alone = |work: &VisitingWork| {
                    let afters: BTreeSet<u8> = work.visits.iter().map(|(_, after, _)| *after).collect();
                    work.mark.is_none() && afters.len() == work.visits.len() && !afters.contains(&0)
                };
                let is_exact = work.iter().all(asks_alone);
                assert!(!is_exact || stands == refused.is_err(), "{refused:?} {work:?}");
                counts[usize::from(stands)] += 1;
            }
        }
    }
    assert!(counts.iter().all(|count| *count > 500), "{counts:?}");
}
