//! What planning says of random applications is what the robot's controller finds when it runs them.

use std::fmt::Write as _;

use planning::{Application, OutOfReach, Stop, plan};
use protocol::image::{ErrorNumber, Motion, MotionKind};
use rand_core::{Rng as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;
use robot_node::arm::{Frame, Joints, Rotation};
use robot_node::rehearsal::{Calls, RehearsalError, rehearse};
use robot_node::{Ending, RobotConfig};
use setup::Setup;

/// A motion that is refused, counted from 0, and the number of its error.
type Refused = (usize, ErrorNumber);

/// A seeded stream of choices.
struct Choices(Pcg64Mcg);

impl Choices {
    /// A number from `low` to `high`.
    fn between(&mut self, low: f64, high: f64) -> f64 {
        let share = (self.0.next_u64() >> 11) as f64 / (1_u64 << 53) as f64;
        low + (high - low) * share
    }

    fn below(&mut self, count: u64) -> u64 {
        self.0.next_u64() % count
    }

    fn vector(&mut self, size: f64) -> [f64; 3] {
        core::array::from_fn(|_| self.between(-size, size))
    }
}

/// Draws an application whose frames lie around a random place of the arm: near and far, upright and tilted, and one in
/// three near a singular position of a wrist.
fn draw(seed: u64, config: &RobotConfig) -> String {
    let mut choices = Choices(Pcg64Mcg::seed_from_u64(seed));
    let arm = &config.arm;
    let mut middle: Joints = core::array::from_fn(|axis| {
        let (lower, upper) = (arm.limits().lower[axis], arm.limits().upper[axis]);
        if lower.is_finite() { choices.between(lower.max(-150.0), upper.min(150.0)) } else { 0.0 }
    });
    if arm.axes() == 6 && choices.below(3) == 0 {
        middle[4] = choices.between(-12.0, 12.0);
    }
    let middle = arm.forward(&middle);
    let size_mm = libm::exp(choices.between(1.0, 5.5));
    let turn_deg = choices.between(0.0, 70.0);
    let mut text = String::from(
        "schema = 2\nname = \"random\"\ntitle = \"random\"\ntool = \"flange\"\nbase = \"root\"\nstart = \"f0\"\n\
         [tools]\nflange = 0\n[bases]\nroot = 0\n",
    );
    let tolerance_mm = [0.0, 0.05, 0.5][choices.below(3) as usize];
    let zone_mm = [2.0, 10.0, 40.0][choices.below(3) as usize];
    writeln!(text, "[zones]\napproximation_mm = {zone_mm:?}\npath_tolerance_mm = {tolerance_mm:?}").unwrap();
    text.push_str("[frames]\n");
    for frame in 0..13 {
        let off = choices.vector(size_mm);
        let rotation = if arm.axes() == 4 {
            Rotation::about([0.0, 0.0, 1.0], choices.between(-turn_deg, turn_deg))
        } else {
            let [a, b, c] = choices.vector(turn_deg);
            Rotation::from_angles([a, b, c])
        };
        let place = Frame {
            position: core::array::from_fn(|i| middle.position[i] + off[i]),
            rotation: rotation * middle.rotation,
        };
        writeln!(text, "f{frame} = {{ mm_deg = {:?} }}", place.to_mm_deg()).unwrap();
    }
    let mut next = 1;
    let mut frame = move || {
        next += 1;
        next - 1
    };
    for step in 0..4 {
        write!(text, "[[step]]\nname = \"s{step}\"\n").unwrap();
        let label = ["blending", "blending", "accurate-path", "accurate-stop"][choices.below(4) as usize];
        let label = if step < 3 || label == "accurate-stop" {
            format!("\"{label}\"")
        } else {
            format!("\"{label}\", \"accurate-stop\"")
        };
        if choices.below(3) == 0 && !label.contains("accurate-path") {
            writeln!(text, "labels = [{label}]\nreach = \"f{}\"", frame()).unwrap();
            continue;
        }
        writeln!(text, "labels = [{label}]").unwrap();
        if choices.below(4) == 0 {
            writeln!(text, "speed_mm_s = {:?}", choices.between(5.0, 300.0)).unwrap();
        }
        let path = match choices.below(4) {
            0 => format!("{{ spline = [\"f{}\", \"f{}\", \"f{}\"] }}", frame(), frame(), frame()),
            1 => format!("{{ circle = {{ through = \"f{}\", to = \"f{}\" }} }}", frame(), frame()),
            2 => format!("{{ line = \"f{}\" }}, {{ line = \"f{}\" }}", frame(), frame()),
            _ => format!("{{ line = \"f{}\" }}", frame()),
        };
        writeln!(text, "path = [{path}]").unwrap();
    }
    text
}

/// What was found about one arm.
#[derive(Default, Debug)]
struct Found {
    /// Applications that planning and the controller accept, and refuse.
    verdicts: [u32; 2],
    /// Corners and joints of splines that are passed, of which one of each application is tried, and those at which the arm
    /// stops although they are to be passed.
    junctions: [u32; 2],
    /// What planning and the controller disagree about.
    disagreed: Vec<String>,
}

/// An application on its robot.
struct Case<'a> {
    config: &'a RobotConfig,
    start: Joints,
    motions: &'a [Motion],
    stops: &'a [Stop],
}

/// Lengths of paths that differ by less are of the same path. The law of a spline is refined from another cycle on where its
/// last motion is told to stop, so that the length is measured at other places: by up to 1.3·10⁻⁵ mm here. A corner that
/// becomes a stop changes it by 3.8·10⁻³ mm at least.
const SAME_LENGTH_MM: f64 = 2e-4;

impl Case<'_> {
    /// Returns what the controller refuses if the motions are called in this way.
    fn refused(&self, calls: Calls) -> Option<Refused> {
        match rehearse(self.config, self.start, self.motions, self.stops, calls, 100) {
            Ok(_) => None,
            Err(RehearsalError { motion, ending: Some(Ending::Fault { error, motion: of_skill, .. }) }) => {
                Some((motion + of_skill as usize, error))
            }
            Err(error) => panic!("{error}"),
        }
    }

    /// Returns the length of the path in mm if the arm is told to stop exactly after these motions.
    fn length_with_stops(&self, after: &[usize]) -> f64 {
        let mut motions = self.motions.to_vec();
        for index in after {
            motions[*index].approximation = 0;
        }
        rehearse(self.config, self.start, &motions, self.stops, Calls::Continuous, 100)
            .unwrap()
            .quality
            .path_length_mm
    }

    /// Compares the junctions that planning says will be stops with those where the controller stops: a stop that it makes
    /// anyway changes nothing of the path, and one where it would not stop makes the path another one.
    fn compare_stops(&self, planned: &[usize], seed: u64, found: &mut Found) {
        let as_planned = self.length_with_stops(&[]);
        let differs = |length: f64| (length - as_planned).abs() > SAME_LENGTH_MM;
        if differs(self.length_with_stops(planned)) {
            found.disagreed.push(format!("seed {seed}: no stops after {planned:?}"));
        }
        found.junctions[1] += planned.len() as u32;
        let ends = |index: usize| self.stops.iter().any(|stop| stop.after as usize == index + 1);
        let is_passed = |index: &usize| {
            self.motions[*index].approximation > 0 && !ends(*index) && !planned.contains(index)
        };
        let passed: Vec<_> = (0..self.motions.len()).filter(is_passed).collect();
        // One of them, so that the test takes seconds.
        if let Some(one) = (seed as usize).checked_rem(passed.len()).map(|one| passed[one]) {
            found.junctions[0] += 1;
            if !differs(self.length_with_stops(&[one])) {
                found.disagreed.push(format!("seed {seed}: a stop after {one}"));
            }
        }
    }
}

/// Runs random applications on an arm.
fn compare(setup: &Setup, seeds: core::ops::Range<u64>) -> Found {
    let mut found = Found::default();
    let bare = RobotConfig::from_setup(setup).unwrap();
    for seed in seeds {
        let application = Application::parse("random", &draw(seed, &bare)).unwrap();
        // What planning refuses without an arm would not run.
        let Ok(plan) = plan(&application, setup) else { continue };
        let to_start = plan.wire_to_start(setup);
        let reached = plan.reach(&application, setup);
        let Ok(config) = bare.clone().in_cell_of(&application, &to_start) else {
            if !matches!(reached, Err(OutOfReach::Start { .. })) {
                found.disagreed.push(format!("seed {seed}: the start, {reached:?}"));
            }
            continue;
        };
        let planned = match &reached {
            Ok(_) => None,
            // The way back to the start is the PLC's and no motion of the application.
            Err(OutOfReach::Motion { number: 0, .. }) => None,
            Err(OutOfReach::Motion { number, violation, .. }) => Some((number - 1, violation.number())),
            Err(other) => {
                found.disagreed.push(format!("seed {seed}: {other}"));
                continue;
            }
        };
        let there: Vec<_> = to_start.from_anywhere.into_iter().collect();
        let start = rehearse(&config, config.home, &there, &[], Calls::Singles, 100).unwrap().account.end;
        let (motions, stops) = (plan.wire_motions(setup), plan.stops());
        let case = Case { config: &config, start, motions: &motions, stops: &stops };
        let refused = [Calls::Program, Calls::Singles, Calls::Continuous].map(|calls| case.refused(calls));
        // A spline that a single skill cannot drive straight may be possible where its neighbours bend it.
        let is_bent = planned.is_some_and(|(motion, _)| motions[motion].kind == MotionKind::Spline);
        if refused[..2] != [planned; 2] || (refused[2] != planned && !is_bent) {
            found.disagreed.push(format!("seed {seed}: planning {planned:?}, the robot {refused:?}"));
            continue;
        }
        found.verdicts[usize::from(planned.is_some())] += 1;
        if let Ok(reached) = reached {
            let planned: Vec<_> = reached.stopped.iter().map(|stopped| stopped.number - 1).collect();
            case.compare_stops(&planned, seed, &mut found);
        }
    }
    found
}

/// Applications of each arm.
const SEEDS: u64 = 300;

#[test]
fn planning_refuses_and_warns_of_what_the_controller_of_each_arm_refuses_and_stops_at() {
    for name in ["A", "B", "D"] {
        let found = compare(&setup::setup(name).unwrap(), 0..SEEDS);
        assert!(found.disagreed.is_empty(), "{name}: {:#?}", found.disagreed);
        assert!(found.verdicts.iter().all(|count| *count > 50), "of each verdict there are many: {found:?}");
        assert!(
            found.junctions.iter().all(|count| *count > 10),
            "of each junction there are many: {found:?}"
        );
    }
}
