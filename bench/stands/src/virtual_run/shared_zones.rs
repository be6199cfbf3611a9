//! Runs of Setup G over the real stacks with cables that are cut at any instant: never are both arms in the shared zone, by the true
//! joints of both at one instant of true time.

use std::time::Duration;

use plc_node::{ExecutionType, PlcEvent, Sequences};
use records::conditions::MotionTotals;

use super::cell::{RobotId, VirtualCell};
use super::new_cell::switch_on;
use crate::planned_station::PlannedStation;
use planning::{ArmVolume, ZoneSet};

/// Time between two looks at the arms: half of a robot cycle.
const LOOK: Duration = Duration::from_millis(2);

/// Longest time in which a run ends, or a cell gets ready.
const LONGEST: Duration = Duration::from_secs(90);

/// A cut of the cable of a station: so long after the start of the run, and for so long.
#[derive(Clone, Copy, Debug)]
struct TimedCut {
    station: usize,
    after: Duration,
    lasts: Duration,
}

/// The cell, and counts of looks at its arms.
struct ZoneWatch {
    cell: VirtualCell,
    volumes: Vec<ArmVolume>,
    /// Looks at which each arm was in the zone.
    inside: Vec<u32>,
    /// Looks at which both were.
    together: u32,
    events: Vec<PlcEvent>,
    cut: Option<TimedCut>,
}

fn stations() -> Vec<PlannedStation> {
    let (cell, found) = planning::cell_with_applications("G").unwrap();
    PlannedStation::all(&found.plan(&cell).unwrap()).unwrap()
}

/// Returns the stations with a PLC that grants nothing, and so gives motions whenever it likes.
fn without_grants(stations: &[PlannedStation]) -> Vec<PlannedStation> {
    let without =
        |station: &PlannedStation| PlannedStation { visits: Vec::new(), zones: None, ..station.clone() };
    stations.iter().map(without).collect()
}

impl ZoneWatch {
    /// Switches the cell on; `volumes` are those of the arms.
    fn new(stations: &[PlannedStation], volumes: Vec<ArmVolume>, seed: u64) -> Self {
        let cell = switch_on(stations, seed, &[]).unwrap().cell;
        let inside = vec![0; volumes.len()];
        let mut watched = Self { cell, volumes, inside, together: 0, events: Vec::new(), cut: None };
        watched.until_ready();
        watched
    }

    /// Goes on for one look.
    fn go_on(&mut self) {
        let until = self.cell.now() + LOOK;
        let mut moved = MotionTotals::default();
        while let Some(event) = self.cell.next_plc_event(until, &mut moved) {
            self.events.push(event);
        }
        let mut taken = ZoneSet::NONE;
        let mut are_together = false;
        for (index, volume) in self.volumes.iter().enumerate() {
            let zones = volume.at(&self.cell.robot(RobotId(index)).sample().joints);
            are_together |= taken.meets(zones);
            taken = taken.with(zones);
            self.inside[index] += u32::from(!zones.is_empty());
        }
        self.together += u32::from(are_together);
    }

    fn until_ready(&mut self) {
        let longest = self.cell.now() + LONGEST;
        while !self.cell.plc().is_ready() {
            self.go_on();
            assert!(self.cell.now() < longest, "the cell never gets ready: {:?} {:?}", self.cut, self.events);
        }
    }

    /// Runs once, with a cut. Returns why the run failed, if it did.
    fn run(&mut self, execution_type: ExecutionType, cut: Option<TimedCut>) -> Result<(), String> {
        self.until_ready();
        (self.cut, self.events) = (cut, Vec::new());
        self.cell.command_plc(|plc, now| plc.start(now, execution_type)).unwrap();
        let start = self.cell.now();
        let mut is_cut = false;
        let outcome = loop {
            self.go_on();
            let since = self.cell.now().since(start);
            if let Some(TimedCut { station, after, lasts }) = cut {
                let is_now = since >= after && since < after + lasts;
                if is_now != is_cut {
                    self.cell.set_cut(RobotId(station), is_now);
                    is_cut = is_now;
                }
            }
            assert!(since < LONGEST, "the run never ends: {cut:?} {:?}", self.events);
            let finished = self.events.iter().filter(|event| matches!(event, PlcEvent::Finished(_))).count();
            if finished == self.volumes.len() {
                break Ok(());
            }
            let failed = self.events.iter().find_map(|event| match event {
                PlcEvent::Failed(failure) => Some(failure.to_string()),
                _ => None,
            });
            if let Some(failure) = failed {
                break Err(failure);
            }
        };
        if let Some(TimedCut { station, after, lasts }) = cut.filter(|_| is_cut) {
            // Meanwhile the other arm must not come in on its way to the start.
            while self.cell.now().since(start) < after + lasts {
                self.go_on();
            }
            self.cell.set_cut(RobotId(station), false);
        }
        outcome
    }
}

fn sequences(watched: &ZoneWatch) -> &Sequences {
    watched.cell.plc().program().sequences().unwrap()
}

fn volumes(stations: &[PlannedStation]) -> Vec<ArmVolume> {
    stations.iter().map(|station| station.zones.as_ref().unwrap().volume.clone()).collect()
}

#[test]
fn both_arms_take_their_turns_in_the_zone_and_are_never_there_together() {
    let stations = stations();
    let mut watched = ZoneWatch::new(&stations, volumes(&stations), 1);
    for execution_type in ExecutionType::ALL {
        watched.inside.fill(0);
        watched.run(execution_type, None).unwrap();
        assert_eq!(watched.together, 0, "{execution_type}");
        assert!(watched.inside.iter().all(|looks| *looks > 50), "{execution_type}: {:?}", watched.inside);
        let waits = |station: usize| sequences(&watched).zone_waits(station).len();
        assert!(waits(0) + waits(1) > 0, "{execution_type}: one of them has to wait");
    }
}

#[test]
fn without_grants_both_arms_are_in_the_zone_together() {
    let stations = stations();
    let mut watched = ZoneWatch::new(&without_grants(&stations), volumes(&stations), 1);
    watched.run(ExecutionType::Cm, None).unwrap();
    assert!(watched.together > 10, "{}", watched.together);
}

#[test]
fn whenever_a_cable_is_cut_in_a_run_and_for_however_long_both_arms_are_never_in_the_zone_together() {
    let stations = stations();
    let mut failed = 0;
    for (seed, execution_type) in ExecutionType::ALL.into_iter().enumerate() {
        let mut watched = ZoneWatch::new(&stations, volumes(&stations), seed as u64);
        for step in 0..48 {
            let cut = TimedCut {
                station: step % 2,
                after: Duration::from_millis(130 + 157 * step as u64),
                lasts: Duration::from_millis([60, 700, 4_000][step % 3]),
            };
            let outcome = watched.run(execution_type, Some(cut));
            failed += u32::from(outcome.is_err());
            assert_eq!(watched.together, 0, "{execution_type} {cut:?}");
        }
        watched.run(execution_type, None).unwrap();
        assert!(watched.inside.iter().all(|looks| *looks > 50), "{execution_type}: {:?}", watched.inside);
    }
    assert!(failed > 40, "{failed} runs failed");
}

#[test]
fn a_robot_that_is_lost_in_the_zone_keeps_it_and_the_run_fails_by_its_name() {
    let stations = stations();
    for execution_type in ExecutionType::ALL {
        let mut watched = ZoneWatch::new(&stations, volumes(&stations), 7);
        watched.run(execution_type, None).unwrap();
        // The other one waits when the first one is in the zone for the first time.
        let program = sequences(&watched);
        let waited = (0..2).find_map(|arm| Some((arm, *program.zone_waits(arm).first()?))).unwrap();
        let holder = 1 - waited.0;
        watched.until_ready();
        watched.cell.command_plc(|plc, now| plc.start(now, execution_type)).unwrap();
        let longest = watched.cell.now() + LONGEST;
        watched.events.clear();
        let has_started = |watched: &ZoneWatch| {
            watched.events.iter().any(|event| matches!(event, PlcEvent::Started { .. }))
        };
        while !has_started(&watched) || sequences(&watched).zone_waits(waited.0).is_empty() {
            watched.go_on();
            assert!(watched.cell.now() < longest, "{execution_type}: it never waits");
        }
        watched.events.clear();
        watched.cell.set_cut(RobotId(holder), true);
        while !watched.events.iter().any(|event| matches!(event, PlcEvent::Failed(_))) {
            watched.go_on();
            assert!(watched.cell.now() < longest, "{execution_type}: it never fails");
        }
        let held = sequences(&watched).zones().held(holder);
        assert!(held.contains(0), "{execution_type}: the lost arm keeps the zone");
        // It stays so for as long as nobody knows where the arm is.
        let until = watched.cell.now() + Duration::from_secs(20);
        while watched.cell.now() < until {
            watched.go_on();
        }
        assert!(sequences(&watched).zones().held(holder).contains(0), "{execution_type}");
        watched.cell.set_cut(RobotId(holder), false);
        watched.run(execution_type, None).unwrap();
        assert_eq!(watched.together, 0, "{execution_type}");
    }
}
