//! Distance of one arm's tool, seen from another arm's, from its place in the plan at the same progress: at the marks, and where
//! arms move together.
//!
//! Progress is the law's time that an arm has driven, as a share of that between two marks. The plan is each arm's rehearsal.
//! Times are true ones: the bench may compare the arms' instants by them, and no node does.

use std::ops::Range;

use plc_node::ExecutionType;
use protocol::image::State;
use robot_node::arm::{Frame, Joints, distance};
use setup::Cell;

use crate::planned_path::{PlannedPath, between};
use crate::planned_station::PlannedStation;
use records::trace::{Recording, RobotTick};

/// Largest difference of a joint from where the rehearsal began, in degrees (mm).
const SAME_START: f64 = 1e-6;

/// Measures the relative pose of the arms of a cell.
#[derive(Clone, Debug)]
pub struct RelativePose {
    arms: Vec<MeasuredArm>,
    /// Numbers of the marks from which arms move together.
    together: Vec<u32>,
}

#[derive(Clone, Debug)]
struct MeasuredArm {
    station: PlannedStation,
    root: Frame,
    tool: Frame,
    /// The path of each type, and where it began.
    paths: Vec<(ExecutionType, Joints, PlannedPath)>,
}

/// Motions of two arms from one mark to the next.
struct Passage {
    /// Motions of each arm, from the mark to its next one.
    motions: [Range<usize>; 2],
    is_together: bool,
}

impl RelativePose {
    /// Prepares the measurement of a planned cell.
    #[must_use]
    pub fn new(cell: &Cell, marks: &[planning::Mark], stations: &[PlannedStation]) -> Self {
        let arm = |(station, placed): (&PlannedStation, &setup::Station)| {
            let robot = &station.planned.robot;
            let number = station.planned.motions.first().map_or(0, |motion| motion.tool);
            let tool = robot.tools.get(usize::from(number)).copied().flatten();
            MeasuredArm {
                station: station.clone(),
                root: Frame::from_mm_deg(placed.root_mm_deg.value),
                tool: tool.unwrap_or(Frame::IDENTITY),
                paths: Vec::new(),
            }
        };
        let together = marks.iter().filter(|mark| mark.together).map(|mark| mark.number);
        Self { arms: stations.iter().zip(&cell.stations).map(arm).collect(), together: together.collect() }
    }

    /// Returns the largest difference in mm in a repetition of a type; `None` if the recordings do not show all of it, or no two
    /// arms meet.
    ///
    /// # Errors
    ///
    /// An arm alone cannot execute its plan.
    pub fn of(
        &mut self,
        execution_type: ExecutionType,
        recordings: &[Recording],
    ) -> anyhow::Result<Option<f64>> {
        let tracks: Vec<Track> = recordings.iter().map(Track::of).collect();
        for (arm, track) in self.arms.iter_mut().zip(&tracks) {
            if let Some(first) = track.points.first() {
                arm.rehearse(execution_type, &first.joints)?;
            }
        }
        let mut worst: Option<f64> = None;
        for one in 0..self.arms.len() {
            for other in one + 1..self.arms.len() {
                let (Some(arms), Some(tracks)) = (pair(&self.arms, one, other), pair(&tracks, one, other))
                else {
                    continue;
                };
                for passage in self.passages(arms) {
                    let Some(found) = difference(execution_type, arms, tracks, &passage) else {
                        return Ok(None);
                    };
                    worst = Some(worst.map_or(found, |worst| worst.max(found)));
                }
            }
        }
        Ok(worst)
    }

    /// Returns the marks that both arms have, in the order of the first, each as often as it is passed.
    fn passages(&self, [one, other]: [&MeasuredArm; 2]) -> Vec<Passage> {
        let mut passages = Vec::new();
        for (index, wait) in one.station.waits.iter().enumerate() {
            let nth = one.station.waits.iter().take(index).filter(|before| before.mark == wait.mark).count();
            let there = other.station.waits.iter().enumerate().filter(|(_, there)| there.mark == wait.mark);
            let Some((there, _)) = there.clone().nth(nth) else { continue };
            let motions = [(one, index), (other, there)].map(|(arm, index)| arm.motions_from(index));
            passages.push(Passage { motions, is_together: self.together.contains(&wait.mark) });
        }
        passages
    }
}

fn pair<T>(all: &[T], one: usize, other: usize) -> Option<[&T; 2]> {
    Some([all.get(one)?, all.get(other)?])
}

impl MeasuredArm {
    /// Rehearses a type from these joints, unless that is done.
    fn rehearse(&mut self, execution_type: ExecutionType, start: &Joints) -> anyhow::Result<()> {
        let is_near = |from: &Joints| from.iter().zip(start).all(|(a, b)| (a - b).abs() < SAME_START);
        if self.paths.iter().any(|(of, from, _)| *of == execution_type && is_near(from)) {
            return Ok(());
        }
        let path = PlannedPath::rehearse(&self.station, execution_type, *start, 100)?;
        self.paths.retain(|(of, ..)| *of != execution_type);
        self.paths.push((execution_type, *start, path));
        Ok(())
    }

    /// Returns the motions from a wait to the next one.
    fn motions_from(&self, wait: usize) -> Range<usize> {
        let after = |index: usize| self.station.waits.get(index).map(|wait| wait.after);
        let from = after(wait).unwrap_or_default();
        from..after(wait + 1).unwrap_or(self.station.planned.motions.len())
    }

    fn planned(&self, execution_type: ExecutionType, motions: Range<usize>, share: f64) -> Option<Joints> {
        let (.., path) = self.paths.iter().find(|(of, ..)| *of == execution_type)?;
        path.joints(motions, share)
    }

    /// Returns where the tool is in the cell.
    fn tool_at(&self, joints: &Joints) -> Frame {
        self.root * self.station.planned.robot.arm.forward(joints) * self.tool
    }
}

/// Returns where the first arm's tool is in the frame of the other's.
fn relative(arms: [&MeasuredArm; 2], joints: [Joints; 2]) -> [f64; 3] {
    let [one, other] = [0, 1].map(|index| arms[index].tool_at(&joints[index]));
    (other.inverse() * one).position
}

/// Returns the largest difference at a mark, and up to the next one if the arms move together.
fn difference(
    execution_type: ExecutionType,
    arms: [&MeasuredArm; 2],
    tracks: [&Track; 2],
    passage: &Passage,
) -> Option<f64> {
    let arrivals = |after: [usize; 2]| {
        let [one, other] = [tracks[0].arrival(after[0])?, tracks[1].arrival(after[1])?];
        Some([one, other])
    };
    let [a, b] = &passage.motions;
    let begins = arrivals([a.start, b.start])?;
    let from_ns = begins[0].true_ns.max(begins[1].true_ns);
    let off = |at_ns: u64, planned: [Option<Joints>; 2]| {
        let found = [tracks[0].at(at_ns)?.0, tracks[1].at(at_ns)?.0];
        let [one, other] = planned;
        Some(distance(relative(arms, found), relative(arms, [one?, other?])))
    };
    let at_share = |share: f64| {
        [(0, a), (1, b)].map(|(index, motions)| arms[index].planned(execution_type, motions.clone(), share))
    };
    let at_mark = [(0, a), (1, b)]
        .map(|(index, motions)| arms[index].planned(execution_type, motions.start..motions.start, 0.0));
    let mut worst = off(from_ns, at_mark)?;
    if !passage.is_together {
        return Some(worst);
    }
    let ends = arrivals([a.end, b.end])?;
    let to_ns = ends[0].true_ns.max(ends[1].true_ns);
    // An arm that stands meanwhile has no share.
    let reference = usize::from(a.is_empty());
    let (begin, end) = (begins[reference].progress_us as f64, ends[reference].progress_us as f64);
    let instants = tracks.iter().flat_map(|track| track.points.iter().map(|point| point.true_ns));
    for at_ns in instants.filter(|at_ns| (from_ns..=to_ns).contains(at_ns)) {
        let (_, progress_us) = tracks[reference].at(at_ns)?;
        let share = if end > begin { ((progress_us - begin) / (end - begin)).clamp(0.0, 1.0) } else { 1.0 };
        worst = worst.max(off(at_ns, at_share(share))?);
    }
    Some(worst)
}

/// An arm over the cycles of a repetition.
struct Track {
    points: Vec<TrackPoint>,
}

struct TrackPoint {
    true_ns: u64,
    /// Motions executed in the repetition.
    executed: usize,
    /// The law's time driven in it, in µs.
    progress_us: u64,
    joints: Joints,
}

impl Track {
    fn of(recording: &Recording) -> Self {
        let ticks = recording.robot_ticks();
        // Until the robot notices the first command of the run it shows the one before.
        let is_before = |tick: &&RobotTick| {
            ticks.first().is_some_and(|first| {
                first.sample.state != State::Running && first.sample.command == tick.sample.command
            })
        };
        let (mut executed, mut progress_us) = (Sum::default(), Sum::default());
        let mut before = true;
        let point = |tick: &RobotTick| {
            let sample = &tick.sample;
            before &= is_before(&tick);
            let (counted, driven) =
                if before { (0, 0) } else { (sample.executed.into(), sample.progress_us) };
            let accepted = if before { 0 } else { sample.accepted.into() };
            TrackPoint {
                true_ns: tick.true_ns,
                executed: executed.with(sample.command, counted, accepted) as usize,
                progress_us: progress_us.with(sample.command, driven, driven),
                joints: sample.joints,
            }
        };
        Self { points: ticks.iter().map(point).collect() }
    }

    /// Returns the first cycle in which so many motions are executed.
    fn arrival(&self, after: usize) -> Option<&TrackPoint> {
        self.points.iter().find(|point| point.executed >= after)
    }

    /// Returns joints and progress at an instant; before the first and after the last cycle they are those of that cycle.
    fn at(&self, at_ns: u64) -> Option<(Joints, f64)> {
        let next = self.points.partition_point(|point| point.true_ns <= at_ns);
        let before = self.points.get(next.saturating_sub(1))?;
        let after = self.points.get(next).unwrap_or(before);
        let span = after.true_ns.saturating_sub(before.true_ns) as f64;
        let share = if span > 0.0 { at_ns.saturating_sub(before.true_ns) as f64 / span } else { 0.0 };
        let progress = after.progress_us as f64 - before.progress_us as f64;
        Some((between(&before.joints, &after.joints, share), before.progress_us as f64 + progress * share))
    }
}

/// A count of a repetition, over its commands.
#[derive(Default)]
struct Sum {
    command: Option<u16>,
    before: u64,
    /// Count of the command once it has ended.
    whole: u64,
}

impl Sum {
    fn with(&mut self, command: u16, count: u64, whole: u64) -> u64 {
        if self.command.replace(command) != Some(command) {
            self.before += std::mem::take(&mut self.whole);
        }
        self.whole = whole;
        self.before + count
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell_stand::CellStand as _;
    use crate::virtual_run::CellRun;
    use records::schedule::Step;

    /// Runs a type of a cell once; returns what measures it, and its recordings.
    fn recorded(name: &str, execution_type: ExecutionType) -> (RelativePose, Vec<Recording>) {
        let (cell, found) = planning::cell_with_applications(name).unwrap();
        let planned = found.plan(&cell).unwrap();
        let stations = PlannedStation::all(&planned).unwrap();
        let mut run = CellRun::start(&stations, 1).unwrap();
        let pause = records::schedule::PAUSE;
        CellRun::execute(&mut run, Step { execution_type, repetition: 1, pause, overrides: None }).unwrap();
        (RelativePose::new(&cell, &planned.marks, &stations), run.recordings().to_vec())
    }

    /// Returns a recording whose robot is later by some ns.
    fn later(recording: &Recording, by_ns: u64) -> Recording {
        let mut all = Recording::default();
        for tick in recording.robot_ticks() {
            all.robot(RobotTick { true_ns: tick.true_ns + by_ns, ..*tick });
        }
        all
    }

    #[test]
    fn an_arm_that_is_late_is_off_by_its_way_in_that_time() {
        for execution_type in ExecutionType::ALL {
            let (mut pose, recordings) = recorded("F", execution_type);
            let [left, right] = &recordings[..] else { panic!("two stations") };
            let mut off = |ms: u64| {
                let late = [left.clone(), later(right, ms * 1_000_000)];
                pose.of(execution_type, &late).unwrap().unwrap()
            };
            // The plate moves at 150 mm/s: 1.5 mm in 10 ms.
            let (own, ten, twenty) = (off(0), off(10), off(20));
            assert!(own < 1.0, "{execution_type}: {own} mm");
            assert!((twenty - ten - 1.5).abs() < 0.1, "{execution_type}: {own}, {ten}, {twenty} mm");
        }
    }

    #[test]
    fn arms_that_only_meet_are_measured_where_they_stand() {
        let (mut pose, recordings) = recorded("E", ExecutionType::Cm);
        assert!(pose.of(ExecutionType::Cm, &recordings).unwrap().unwrap() < 1e-3);
        let [left, right] = &recordings[..] else { panic!("two stations") };
        let late = [left.clone(), later(right, 10_000_000)];
        assert!(pose.of(ExecutionType::Cm, &late).unwrap().unwrap() < 1e-3, "each waits for the other");
        let mut moved = Recording::default();
        for tick in right.robot_ticks() {
            let mut tick = *tick;
            tick.sample.joints[0] += 0.1;
            moved.robot(tick);
        }
        let found = pose.of(ExecutionType::Cm, &[left.clone(), moved]).unwrap().unwrap();
        // 0.1 degrees at a reach of 0.4 to 0.5 m.
        assert!((0.5..1.0).contains(&found), "{found} mm");
    }

    #[test]
    fn a_recording_that_ends_before_the_last_mark_gives_no_figure() {
        let (mut pose, recordings) = recorded("F", ExecutionType::Rc);
        let mut cut = Recording::default();
        recordings[1].robot_ticks().iter().take(500).for_each(|tick| cut.robot(*tick));
        assert_eq!(pose.of(ExecutionType::Rc, &[recordings[0].clone(), cut]).unwrap(), None);
    }
}
