//! Runs of the built-in cells, with faults and without.

use std::time::Duration;

use super::*;
use plc_node::ExecutionType;
use setup::SlotForm;

impl CellRun {
    /// Executes one step of a schedule like [`execute`](Self::execute), and has `look` look at the cell in each half cycle.
    fn execute_watched(&mut self, step: Step, mut look: impl FnMut(&Self)) -> anyhow::Result<CellMeasured> {
        self.begin(&step)?;
        loop {
            let report = self.next_event(self.cell.now() + LOOK);
            look(self);
            if let Some(report) = report
                && let Some(measured) = self.take(report)?
            {
                return Ok(measured);
            }
        }
    }

    /// Returns how many motions a station's robot has executed in the run by the PLC's count.
    fn executed(&self, station: usize) -> u32 {
        self.cell.plc().program().totals(station).executed
    }

    /// Returns the tool's speed along the path of a station, in mm/s.
    fn path_speed_mm_s(&self, station: usize) -> f32 {
        self.cell.robot(RobotId(station)).sample().path_speed_mm_s
    }
}

/// Half of the shortest cycle of the built-in cells.
const LOOK: Duration = Duration::from_micros(500);

/// Half cycles within which a robot has reported the end of a motion, and the PLC has seen it.
const SETTLED: u32 = 10;

fn start_with(name: &str, faults: &[Fault]) -> (Vec<PlannedStation>, CellRun) {
    let (cell, found) = planning::cell_with_applications(name).unwrap();
    let stations = PlannedStation::all(&found.plan(&cell).unwrap()).unwrap();
    let run = CellRun::start_with(&stations, 1, faults).unwrap();
    (stations, run)
}

/// Returns Setup F with two arms on circles of sixty points, as compact points or as full motions.
fn two_circles(form: SlotForm) -> Vec<PlannedStation> {
    let place = tempfile::tempdir().unwrap();
    let text = include_str!("../../../../../cell/planning/tests/two-circles.toml");
    std::fs::write(place.path().join("task.toml"), text).unwrap();
    let (mut cell, _) = setup::cell("F").unwrap();
    cell.application = Some("task.toml".to_owned());
    for station in &mut cell.stations {
        station.application = format!("{}-circle", station.name);
    }
    let cell = cell.with_each_station(|setup| {
        let setup = setup.with_queue_motions(64).with_refill(setup::Refill::Accepted);
        if form == SlotForm::Compact { setup.with_form_compact() } else { setup }
    });
    let found = planning::applications_of("F", &cell, Some(place.path())).unwrap();
    PlannedStation::all(&found.plan(&cell).unwrap()).unwrap()
}

#[test]
fn arms_that_get_compact_points_meet_at_their_marks_and_take_no_longer_than_with_full_motions() {
    let mut times = Vec::new();
    for form in [SlotForm::Full, SlotForm::Compact] {
        let stations = two_circles(form);
        assert!(stations.iter().all(|it| it.planned.points.is_some() == (form == SlotForm::Compact)));
        let mut run = CellRun::start_with(&stations, 1, &[]).unwrap();
        for execution_type in ExecutionType::ALL {
            let mut waited = [0; 2];
            let measured = run
                .execute_watched(step(execution_type), |run| {
                    let executed = [0, 1].map(|station| run.executed(station));
                    for one in 0..2 {
                        // Beyond its mark an arm is only with the other one there.
                        assert!(executed[one] <= 30 || executed[1 - one] >= 30, "{form:?} {executed:?}");
                        waited[one] += u32::from(executed[one] == 30);
                    }
                })
                .unwrap();
            assert!(waited.iter().all(|waited| *waited > 0), "{form:?} {execution_type}: {waited:?}");
            let stations = &measured.sample.stations;
            // All points have one zone, so that a rest at a mark counts as a stop on a path that was to go on.
            let stops = u32::from(form == SlotForm::Compact && execution_type == ExecutionType::Cm);
            assert!(stations.iter().all(|it| it.blends_suppressed == stops), "{form:?}: {stations:?}");
            times.push(measured.sample.execution.as_secs_f64());
        }
    }
    let [rc, sm, cm, compact_rc, compact_sm, compact_cm] = times[..] else { panic!("{times:?}") };
    // Targets are rounded to whole steps, and nothing else changes but the skill of CM.
    assert!((compact_rc - rc).abs() < 0.009 && (compact_sm - sm).abs() < 0.1, "{times:?}");
    assert!(compact_cm < cm + 0.009, "{times:?}");
}

#[test]
fn compact_points_to_one_arm_outlive_lost_frames_and_a_cut_of_the_other_one_ends_the_run() {
    let stations = two_circles(SlotForm::Compact);
    let faults = ["left/loss=0.02", "right/loss=0.02"].map(|fault| fault.parse().unwrap());
    let mut run = CellRun::start_with(&stations, 1, &faults).unwrap();
    run.execute(step(ExecutionType::Cm)).unwrap();
    let cut = ["right/cut-at=1500ms..9s".parse().unwrap()];
    let mut run = CellRun::start_with(&stations, 1, &cut).unwrap();
    let error = format!("{:#}", run.execute(step(ExecutionType::Cm)).unwrap_err());
    assert!(error.starts_with("station right"), "{error}");
}

fn step(execution_type: ExecutionType) -> Step {
    Step { execution_type, repetition: 1, pause: records::schedule::PAUSE, overrides: None }
}

#[test]
fn an_arm_that_is_killed_in_a_run_fails_it_and_the_error_names_its_station() {
    for (killed, name) in ["station left", "station right"].into_iter().enumerate() {
        for execution_type in ExecutionType::ALL {
            let fault = format!("{}/kill-robot-at=700ms", ["left", "right"][killed]).parse().unwrap();
            let (_, mut run) = start_with("E", &[fault]);
            let error = format!("{:#}", run.execute(step(execution_type)).unwrap_err());
            assert!(error.starts_with(name), "{execution_type}: {error}");
            let stop = records::cell_stop::CellStop::of(1, run.recordings());
            let last = stop.stations.iter().filter_map(|arm| arm.stopped_at_ms).fold(0.0, f64::max);
            // The other goes to its mark, or brakes where the PLC halts it: at a mark all wait for the lost arm.
            assert!(last < 3_000.0, "{execution_type}: {stop:?}");
            assert!(stop.stations.iter().all(|arm| arm.marks_passed <= 1), "{execution_type}: {stop:?}");
        }
    }
}

#[test]
fn no_arm_moves_beyond_a_mark_before_the_other_has_come_to_it() {
    for cell in ["E", "F"] {
        let (stations, mut run) = start_with(cell, &[]);
        for execution_type in ExecutionType::ALL {
            let (mut moving_beyond, mut moving, mut last) =
                (0, vec![0; stations.len()], vec![0; stations.len()]);
            run.execute_watched(step(execution_type), |run| {
                for (one, station) in stations.iter().enumerate() {
                    // The robot moves, and the PLC has seen it come to the end of the section.
                    let executed = run.executed(one);
                    // The last cycle of a motion still has a speed.
                    let is_moving = run.path_speed_mm_s(one) > 0.0 && executed == last[one];
                    moving[one] = if is_moving { moving[one] + 1 } else { 0 };
                    last[one] = executed;
                    for wait in &station.waits {
                        let is_beyond = executed as usize > wait.after
                            || executed as usize == wait.after && moving[one] > SETTLED;
                        if !is_beyond {
                            continue;
                        }
                        moving_beyond += 1;
                        for (other, others) in stations.iter().enumerate() {
                            let there = others.waits.iter().find(|there| there.mark == wait.mark);
                            let come = run.executed(other) as usize;
                            assert!(
                                there.is_none_or(|there| come >= there.after),
                                "{cell} {execution_type} {wait:?}"
                            );
                        }
                    }
                }
            })
            .unwrap();
            assert!(moving_beyond > 0);
        }
    }
}

fn error_of(faults: &[&str], execution_type: ExecutionType) -> String {
    let faults: Vec<Fault> = faults.iter().map(|fault| fault.parse().unwrap()).collect();
    let (_, mut run) = start_with("E", &faults);
    format!("{:#}", run.execute(step(execution_type)).unwrap_err())
}

#[test]
fn a_fault_hits_the_cable_of_its_station_and_no_other() {
    for (hit, fault) in [(0, "left/to-robot:loss=0.01"), (1, "right/to-plc:loss=0.01")] {
        let (_, mut run) = start_with("E", &[fault.parse().unwrap()]);
        run.execute(step(ExecutionType::Cm)).unwrap();
        let health = CellRun::health(&run);
        let lost: Vec<_> = health.stations.iter().map(Health::frames_lost).collect();
        assert!(lost[hit] > 10 && lost[1 - hit] == 0, "{fault}: {lost:?}");
        assert_eq!(health.faults.unwrap().asked, [fault]);
    }
}

#[test]
fn a_cut_cable_and_a_killed_plc_fail_the_run_and_are_named() {
    let cut = error_of(&["right/cut-at=1s..9s"], ExecutionType::Sm);
    assert!(cut.starts_with("station right: "), "{cut}");
    let killed = error_of(&["kill-plc-at=1s"], ExecutionType::Sm);
    assert!(killed.contains("the plc-node was killed by this run's fault"), "{killed}");
}

/// A cell whose left robot has drives on an EtherCAT segment.
fn with_drives() -> (Vec<PlannedStation>, Cell) {
    let (cell, found) = planning::cell_with_applications("E").unwrap();
    let cell = cell.with_station("left", |setup| setup.with_drives(setup::Drives::Ethercat)).unwrap();
    (PlannedStation::all(&found.plan(&cell).unwrap()).unwrap(), cell)
}

#[test]
fn drives_of_a_station_are_compared_with_the_rehearsal() {
    let (stations, _) = with_drives();
    let verify = |faults: &[&str]| {
        let faults: Vec<Fault> = faults.iter().map(|fault| fault.parse().unwrap()).collect();
        let mut run = CellRun::start_with(&stations, 1, &faults).unwrap();
        let measured = run.execute(step(ExecutionType::Cm)).map_err(|error| format!("{error:#}"))?;
        let mut verification = crate::verification::StationVerification::new(stations[0].clone());
        verification.check(&measured.stations[0]).map_err(|error| format!("{error:#}"))
    };
    assert_eq!(verify(&[]), Ok(()));
    let blocked = verify(&["left/drive-block=1@100ms..2.5s"]).unwrap_err();
    assert!(blocked.starts_with("station left: "), "{blocked}");
}

#[test]
fn a_wrong_override_of_a_led_arm_is_found_within_its_led_sections_and_outside_of_them() {
    let (stations, mut run) = start_with("F", &[]);
    let overrides = Some("40,60@4s".parse().unwrap());
    let good = run.execute(Step { overrides, ..step(ExecutionType::Cm) }).unwrap();
    for (station, good) in stations.iter().zip(&good.stations) {
        let mut verification = crate::verification::StationVerification::new(station.clone());
        verification.check(good).unwrap();
        let account = good.account.unwrap();
        assert_eq!([account.override_percent, account.led_override_percent], [[40, 60], [100; 2]]);
        // Also a robot that takes the full override of its led sections along is wrong.
        for wrong in [[39, 60], [40, 61], [40, 100], [100, 100]] {
            let mut account = account;
            account.override_percent = wrong;
            let account = Some(account);
            let error = verification.check(&Measured { account, ..*good }).unwrap_err();
            let error = format!("{error:#}");
            let [low, high] = wrong;
            assert!(error.contains(&format!("override of {low} to {high} %, and the PLC")), "{error}");
        }
        for wrong in [[40, 60], [99, 100], [255, 0]] {
            let mut account = account;
            account.led_override_percent = wrong;
            let account = Some(account);
            let error = format!("{:#}", verification.check(&Measured { account, ..*good }).unwrap_err());
            assert!(error.contains("under the master axis"), "{error}");
        }
    }
}

#[test]
fn a_lossy_cable_spoils_an_attempt_to_connect_and_not_the_run() {
    let (cell, found) = planning::cell_with_applications("F").unwrap();
    let stations = PlannedStation::all(&found.plan(&cell).unwrap()).unwrap();
    let faults: Vec<Fault> = ["left/loss=0.01", "right/loss=0.01"].map(|fault| fault.parse().unwrap()).into();
    for seed in 1..=6 {
        CellRun::start_with(&stations, seed, &faults)
            .unwrap_or_else(|error| panic!("seed {seed}: {error:#}"));
    }
}
