//! Arms in step, by true time: where the left tool is in the right tool's frame, and how far apart arms start.

use plc_node::{ExecutionType, MarkPassage, Override, TogetherLeg};
use protocol::image::State;
use robot_node::arm::{Frame, Joints, distance};
use virtual_time::Impairment;

use super::*;

/// The joints of an arm at an instant of true time, and the time on the law of its skill in s.
type Seen = (Instant, Joints, f64);

/// Disturbances of a run.
#[derive(Clone, Copy, Default, Debug)]
struct Disturbed {
    loss_ppm: u32,
    jitter: Duration,
    /// Share of the frames that are held back by 8 ms.
    reorder_ppm: u32,
    /// The station that the PLC suspends, and when in the section.
    suspends: Option<(usize, Duration)>,
    /// The override in the run, and after a while in the section.
    overrides: [Option<u8>; 2],
}

struct TwoArms {
    stations: Vec<PlannedStation>,
    run: CellRun,
}

/// Course of both arms while they moved together.
struct Together {
    seen: [Vec<Seen>; 2],
}

fn pair(cell: &str, seed: u64) -> TwoArms {
    let (cell, found) = planning::cell_with_applications(cell).unwrap();
    let stations = PlannedStation::all(&found.plan(&cell).unwrap()).unwrap();
    pair_of(stations, seed)
}

fn pair_of(stations: Vec<PlannedStation>, seed: u64) -> TwoArms {
    let run = CellRun::start(&stations, seed).unwrap();
    TwoArms { stations, run }
}

impl TwoArms {
    fn disturb(&mut self, disturbed: Disturbed) {
        for (index, station) in self.stations.iter().enumerate() {
            let delay = Duration::from_micros(station.setup.bus.cable_delay_us.value.into());
            let Disturbed { loss_ppm, jitter, reorder_ppm, .. } = disturbed;
            let reorder_by = Duration::from_millis(8);
            let link =
                Impairment { delay, loss_ppm, jitter, reorder_ppm, reorder_by, ..Impairment::default() };
            self.run.cell.set_links(RobotId(index), link);
        }
    }

    /// Runs CM, and returns what the arms did from the mark where they begin to move together to the next one.
    fn moves_together(&mut self, disturbed: Disturbed, [from, to]: [u32; 2]) -> Together {
        self.disturb(disturbed);
        let set = |plc: &mut CellRun, percent: Option<u8>| {
            let Some(percent) = percent else { return };
            let to = Override::from_percent(f64::from(percent)).unwrap();
            plc.cell.command_plc(|plc, now| plc.set_override(now, to));
        };
        set(&mut self.run, disturbed.overrides[0]);
        self.run.begin(&step(ExecutionType::Cm)).unwrap();
        let mut seen: [Vec<Seen>; 2] = [Vec::new(), Vec::new()];
        let (mut began, mut suspended, mut changed) = (None, false, false);
        loop {
            let until = self.run.cell.now() + MS / 2;
            let report = self.run.next_event(until);
            if let Some(PlcReport { event: PlcEvent::Failed(failure), .. }) = report {
                panic!("{failure}");
            }
            let is_at = |mark: u32, passed: bool| {
                let passages = self.run.cell.plc().program().passages(0);
                passages.iter().any(|it| it.mark == mark && (!passed || it.passed.is_some()))
            };
            if !is_at(from, true) {
                continue;
            }
            let now = self.run.cell.now();
            let since = now.since(*began.get_or_insert(now));
            assert!(since < Duration::from_secs(60), "it never ends");
            if since > Duration::from_millis(1_000) && !std::mem::replace(&mut changed, true) {
                set(&mut self.run, disturbed.overrides[1]);
            }
            if let Some((station, after)) = disturbed.suspends {
                if since > after && !std::mem::replace(&mut suspended, true) {
                    self.run.cell.command_plc(|plc, _| plc.suspend(station));
                } else if since > after + Duration::from_millis(1_500) {
                    self.run.cell.command_plc(|plc, _| plc.resume(station));
                }
            }
            for (index, seen) in seen.iter_mut().enumerate() {
                let robot = self.run.cell.robot(RobotId(index));
                let at = self.run.watch.true_time_of_robot(index, robot.ticked_at()).unwrap();
                if seen.last().is_none_or(|(last, ..)| *last != at) {
                    let law_s = f64::from(robot.controller().feedback().law_time_us) / 1e6;
                    seen.push((at, *robot.controller().joints(), law_s));
                }
            }
            if self.run.cell.plc().program().passages(0).iter().any(|it| it.mark == to)
                && self.run.cell.plc().program().passages(1).iter().any(|it| it.mark == to)
            {
                return Together { seen };
            }
        }
    }

    /// Returns the frame of an arm's tool in the cell.
    fn tool(&self, station: usize, joints: &Joints) -> Frame {
        let PlannedStation { planned, setup, .. } = &self.stations[station];
        let root =
            Frame::from_mm_deg(if station == 0 { [0.0; 6] } else { [1200.0, 0.0, 0.0, 180.0, 0.0, 0.0] });
        let tool = setup.robot.tools[0].mm_deg.value;
        root * planned.robot.arm.forward(joints) * Frame::from_mm_deg(tool)
    }

    /// Returns the largest distance of the left tool from where it was first, in the right tool's frame, in mm; and the highest
    /// speed of a tool in mm/s.
    fn worst(&self, Together { seen: [left, right] }: &Together) -> (f64, f64) {
        let relative = |left: &Joints, right: &Joints| self.tool(1, right).inverse() * self.tool(0, left);
        let mut first = None;
        let mut worst = 0.0_f64;
        let mut fastest = 0.0_f64;
        let mut before: Option<(Instant, [f64; 3])> = None;
        for (at, joints, _) in left {
            let next = right.partition_point(|(other, ..)| other < at);
            let (Some((from, one, _)), Some((to, two, _))) =
                (next.checked_sub(1).and_then(|last| right.get(last)), right.get(next))
            else {
                continue;
            };
            let share = at.since(*from).as_secs_f64() / to.since(*from).as_secs_f64();
            let right = core::array::from_fn(|axis| one[axis] + share * (two[axis] - one[axis]));
            let there = relative(joints, &right).position;
            worst = worst.max(distance(*first.get_or_insert(there), there));
            let tool = self.tool(0, joints).position;
            if let Some((last, position)) = before.replace((*at, tool)) {
                fastest = fastest.max(distance(position, tool) / at.since(last).as_secs_f64());
            }
        }
        (worst, fastest)
    }
}

/// Returns the longest cycle of the arms, and of their buses.
fn cycles(stations: &[PlannedStation]) -> [Duration; 2] {
    let longest =
        |of: fn(&PlannedStation) -> u32| Duration::from_micros(stations.iter().map(of).max().unwrap().into());
    [longest(|it| it.setup.robot.cycle_us.value), longest(|it| it.setup.bus.cycle_us.value)]
}

fn step(execution_type: ExecutionType) -> Step {
    Step { execution_type, repetition: 1, pause: records::schedule::PAUSE, overrides: None }
}

const MS: Duration = Duration::from_millis(1);

#[test]
fn two_arms_that_carry_a_plate_hold_it_to_a_tenth_of_a_millimetre_whatever_happens() {
    let cases = [
        Disturbed::default(),
        Disturbed { overrides: [Some(37), Some(37)], ..Disturbed::default() },
        Disturbed { overrides: [Some(100), Some(23)], ..Disturbed::default() },
        Disturbed { suspends: Some((0, MS * 1_500)), ..Disturbed::default() },
        Disturbed { suspends: Some((1, MS * 2_200)), overrides: [Some(60), None], ..Disturbed::default() },
        Disturbed { loss_ppm: 10_000, overrides: [Some(37), None], ..Disturbed::default() },
        Disturbed { loss_ppm: 10_000, suspends: Some((0, MS * 800)), ..Disturbed::default() },
        Disturbed { jitter: MS, reorder_ppm: 10_000, ..Disturbed::default() },
    ];
    for seed in [1, 7] {
        for case in cases {
            let mut pair = pair("F", seed);
            let together = pair.moves_together(case, [2, 3]);
            let (worst, fastest) = pair.worst(&together);
            let explained = fastest * cycles(&pair.stations)[0].as_secs_f64();
            assert!(worst <= 0.1 + explained, "{case:?}, seed {seed}: {worst} mm at {fastest} mm/s");
        }
    }
}

#[test]
fn without_a_master_the_plate_would_be_torn() {
    let worst = |suspends: Option<(usize, Duration)>, seed: u64| {
        let mut stations = pair("F", seed).stations;
        stations.iter_mut().filter_map(|it| it.in_step.as_mut()).for_each(|arm| arm.sections.clear());
        let mut pair = pair_of(stations, seed);
        let together = pair.moves_together(Disturbed { suspends, ..Disturbed::default() }, [2, 3]);
        pair.worst(&together).0
    };
    let undisturbed = (1..24).map(|seed| worst(None, seed)).fold(0.0, f64::max);
    assert!(undisturbed > 0.4, "{undisturbed} mm");
    let suspended = worst(Some((0, MS * 1_500)), 1);
    assert!(suspended > 50.0, "{suspended} mm");
}

/// Runs CM once, and suspends an arm for 2 s while both carry the plate; returns the relative pose of a run that is verified, in mm.
fn carried(suspended: Option<usize>) -> f64 {
    let (cell, found) = planning::cell_with_applications("F").unwrap();
    let planned = found.plan(&cell).unwrap();
    let TwoArms { stations, mut run } = pair("F", 1);
    run.begin(&step(ExecutionType::Cm)).unwrap();
    let (mut began, mut is_suspended, mut is_resumed) = (None, false, false);
    let mut measured = loop {
        let now = run.cell.now();
        let report = run.next_event(now + MS / 2);
        if let Some(measured) = report.and_then(|report| run.take(report).unwrap()) {
            break measured;
        }
        let carries = |passage: &MarkPassage| passage.mark == 2 && passage.passed.is_some();
        let is_carried = run.cell.plc().program().passages(0).iter().any(carries);
        let Some(arm) = suspended.filter(|_| is_carried) else { continue };
        let since = now.since(*began.get_or_insert(now));
        if since > MS * 1_500 && !std::mem::replace(&mut is_suspended, true) {
            run.cell.command_plc(|plc, _| plc.suspend(arm));
        }
        if since > MS * 3_500 && !std::mem::replace(&mut is_resumed, true) {
            let [held, other] = [arm, 1 - arm].map(|arm| run.cell.robot(RobotId(arm)).sample());
            assert_eq!((held.state, other.state), (State::Suspended, State::Running), "arm {arm}");
            assert!(held.path_speed_mm_s < 0.1 && other.path_speed_mm_s < 0.1, "arm {arm}");
            run.cell.command_plc(|plc, _| plc.resume(arm));
        }
    };
    assert_eq!(is_resumed, suspended.is_some());
    let mut verification = CellVerification::new(&cell, &planned, &stations);
    verification.check(ExecutionType::Cm, &mut measured, run.watch.recordings()).unwrap();
    measured.sample.relative_pose_mm.unwrap()
}

#[test]
fn an_arm_that_is_suspended_between_two_marks_holds_the_other_in_step_and_both_end_the_run() {
    let undisturbed = carried(None);
    for arm in 0..2 {
        let found = carried(Some(arm));
        assert!(found <= undisturbed + 0.1, "arm {arm}: {found} mm, undisturbed {undisturbed} mm");
    }
}

#[test]
fn an_arm_that_is_cut_off_while_both_carry_the_plate_fails_the_run_by_name_and_both_come_to_rest() {
    for (lost, name) in ["left", "right"].into_iter().enumerate() {
        let mut pair = pair("F", 1);
        pair.run.begin(&step(ExecutionType::Cm)).unwrap();
        let mut together: Option<Instant> = None;
        let (mut is_cut, mut failed) = (false, None);
        while failed.is_none() {
            let now = pair.run.cell.now();
            let carries = |passage: &MarkPassage| passage.mark == 2 && passage.passed.is_some();
            if pair.run.cell.plc().program().passages(0).iter().any(carries) {
                let since = now.since(*together.get_or_insert(now));
                assert!(since < MS * 10_000, "the run goes on without the {name} arm");
                if since > MS * 800 && !std::mem::replace(&mut is_cut, true) {
                    pair.run.cell.set_cut(RobotId(lost), true);
                }
            }
            failed = match pair.run.next_event(now + MS / 2) {
                Some(PlcReport { station, event: PlcEvent::Failed(failure) }) => Some((station, failure)),
                _ => None,
            };
        }
        let (station, failure) = failed.unwrap();
        assert_eq!(station, Some(lost), "{failure}");
        let until = pair.run.cell.now() + MS * 2_000;
        while pair.run.next_event(until).is_some() {}
        let rests = |arm: usize| pair.run.cell.robot(RobotId(arm)).sample().path_speed_mm_s < 1.0;
        assert!(rests(0) && rests(1), "without the {name} arm");
    }
}

/// The plate's right arm is slower, has another number of motions, and a stop among them.
fn unlike(path: &str, acceleration_percent: f64) -> Vec<PlannedStation> {
    const APPLICATION: &str = include_str!("../../../../../cell/applications/carry-plate.toml");
    let frames = "right-middle = { on = \"right-lifted\", shift_mm = [0.0, 100.0, 0.0] }\n\n[actions]";
    let (left, right) = APPLICATION.split_once("name = \"right-edge\"").unwrap();
    let one = "labels = [\"blending\"]\npath = [{ line = \"right-lifted\" }, { line = \"right-aside\" }, { line = \"right-down\" }]";
    assert!(right.contains(one));
    let left = left.replace("[actions]", frames);
    let text = format!("{left}name = \"right-edge\"{}", right.replace(one, path));
    let directory = tempfile::tempdir().unwrap();
    std::fs::write(directory.path().join("unlike.toml"), text).unwrap();
    let (_, setup) = setup::built_in(setup::CELLS, "F").unwrap();
    let setup = setup.replace("application = \"carry-plate\"", "application = \"unlike.toml\"");
    let file = directory.path().join("cell.toml");
    std::fs::write(&file, setup).unwrap();
    let (mut cell, found) = planning::cell_with_applications(file.to_str().unwrap()).unwrap();
    cell.stations[1].motions.acceleration_percent.value = acceleration_percent;
    PlannedStation::all(&found.plan(&cell).unwrap()).unwrap()
}

fn legs_of(station: &PlannedStation) -> &[TogetherLeg] {
    &station.in_step.as_ref().unwrap().sections[0].legs
}

/// Returns the share of the section that an arm has driven at each instant. Each skill begins at 0.
fn shares(station: &PlannedStation, seen: &[Seen]) -> Vec<(Instant, f64)> {
    let legs: Vec<f64> = legs_of(station).iter().map(|leg| leg.law.as_secs_f64()).collect();
    let (mut leg, mut before_s) = (0, 0.0);
    let share = |(at, _, law_s): &Seen| {
        if *law_s < before_s - 0.1 {
            leg += 1;
        }
        before_s = *law_s;
        (*at, (legs[..leg].iter().sum::<f64>() + law_s) / legs.iter().sum::<f64>())
    };
    seen.iter().map(share).collect()
}

#[test]
fn arms_with_unlike_laws_numbers_of_motions_and_stops_drive_the_same_share_of_their_sections() {
    let more = "labels = [\"blending\"]\npath = [{ line = \"right-lifted\" }, { line = \"right-middle\" }, \
                { line = \"right-aside\" }, { line = \"right-down\" }]";
    let stop = "labels = [\"blending\", \"accurate-stop\"]\npath = [{ line = \"right-lifted\" }, { line = \"right-middle\" }]\n\n\
                [[arm.step]]\nname = \"down\"\ndoes = \"aside and down\"\nlabels = [\"blending\"]\n\
                path = [{ line = \"right-aside\" }, { line = \"right-down\" }]";
    for (path, legs) in [(more, 1), (stop, 2)] {
        for (acceleration_percent, overrides) in [(50.0, [None; 2]), (8.0, [Some(100), Some(41)])] {
            let stations = unlike(path, acceleration_percent);
            assert_eq!(legs_of(&stations[1]).len(), legs);
            let mut pair = pair_of(stations, 3);
            let disturbed = Disturbed { overrides, ..Disturbed::default() };
            let Together { seen } = pair.moves_together(disturbed, [2, 3]);
            let [left, right] = [0, 1].map(|index| shares(&pair.stations[index], &seen[index]));
            let law_s = [0, 1].map(|index| {
                let legs = legs_of(&pair.stations[index]);
                legs.iter().map(|leg| leg.law.as_secs_f64()).sum::<f64>()
            });
            let longest_s = law_s[0].max(law_s[1]);
            let mut worst = (0.0, 0.0);
            for (at, share) in &left {
                let next = right.partition_point(|(other, _)| other < at);
                let Some((_, other)) = right.get(next) else { continue };
                let apart_s = (share - other).abs() * longest_s;
                if apart_s > worst.0 {
                    worst = (apart_s, *share);
                }
            }
            assert!(worst.0 < 0.004, "{legs} legs, {acceleration_percent} %: {worst:?} of {longest_s} s");
        }
    }
}

#[test]
fn arms_start_within_their_cycles_of_each_other_in_every_type() {
    for cell in ["E", "F", "G"] {
        for seed in 1..6 {
            let mut pair = pair(cell, seed);
            for execution_type in ExecutionType::ALL {
                let skew = pair.run.execute(step(execution_type)).unwrap().sample.start_skew.unwrap();
                // An arm starts in a cycle of its own, and no image shows at which part of a bus cycle its robot sends.
                // Half of that is assumed, with an error of half at each robot.
                let [robot_cycle, _] = cycles(&pair.stations);
                let bus_cycles = pair.stations.iter().map(|it| it.setup.bus.cycle_us.value).sum::<u32>();
                let explained = robot_cycle + Duration::from_micros(bus_cycles.into()) / 2;
                assert!(skew <= explained + MS / 10, "{cell} {execution_type}, seed {seed}: {skew:?}");
            }
        }
    }
}
