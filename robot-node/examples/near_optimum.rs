//! The times of random single motions, over those of the time optimum on the same path within the same limits.
//!
//! ```text
//! cargo run --release -p robot-node --example near_optimum -- SETUP COUNT SEED [FILE [PERCENT]]
//! ```
//!
//! prints a table by kind of motion. The times are those of the robot's own cycle. A file gets the paths and limits of the first
//! motions of each kind, a line of JSON each, for another reference: `scripts/optimum.py`. With a percentage the robot is given so much of the
//! acceleration only, which a reference must find.

#![expect(
    clippy::unwrap_used,
    clippy::panic,
    clippy::print_stdout,
    clippy::disallowed_types,
    reason = "a study for those who change the law"
)]

use std::io::Write as _;

use protocol::image::Motion;
use robot_node::RobotConfig;
use robot_node::arm::{AXES, Joints};

#[path = "../tests/robot/drawn.rs"]
mod drawn;
#[path = "../tests/robot/fastest.rs"]
mod fastest;
#[path = "../tests/robot/recorded.rs"]
mod recorded;

use drawn::{Drawn, Passage};
use fastest::{Point, fastest};

/// A step of the reference in s, and the least and largest number of them.
const STEP_S: f64 = 5e-3;
const STEPS: [usize; 2] = [100, 600];

/// Draws for each motion at most: an arm may have none of a kind.
const DRAWS: usize = 2_000;

/// Motions of each kind whose paths are written to the file.
const WRITTEN: usize = 40;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [name, count, seed, ..] = &arguments[..] else { panic!("SETUP COUNT SEED [FILE [PERCENT]]") };
    let (count, seed): (usize, u64) = (count.parse().unwrap(), seed.parse().unwrap());
    let mut file = arguments.get(3).map(|name| std::fs::File::create(name).unwrap());
    let percent: u32 = arguments.get(4).map_or(100, |percent| percent.parse().unwrap());
    let setup = setup::setup(name).unwrap();
    let config = RobotConfig::from_setup(&setup).unwrap();
    let has_wrist = config.arm.axes() > 4;
    for (label, kind) in Passage::ALL.into_iter().filter(|(_, kind)| has_wrist || !kind.is_singular()) {
        let mut drawn = Drawn::new(seed, &config, &setup);
        let mut ratios = Vec::new();
        let mut draws = 0;
        while ratios.len() < count && draws < DRAWS + 50 * ratios.len() {
            draws += 1;
            let Some((motion, from)) = drawn.motion(kind) else { continue };
            let Some(sections) = recorded::sections(&[motion], &from, &config) else { continue };
            let [section] = &sections[..] else { continue };
            if !drawn.is_of(kind, section.all_joints().step_by(16)) {
                continue;
            }
            let steps = ((section.duration / STEP_S) as usize).clamp(STEPS[0], STEPS[1]);
            let (points, half) = section.points(steps, &[motion], &config);
            let least = fastest(&points, half).duration;
            let acceleration = (u32::from(motion.acceleration) * percent / 100) as u16;
            let took = recorded::seconds(&Motion { acceleration, ..motion }, &from, &config);
            if let Some(file) = file.as_mut().filter(|_| ratios.len() < WRITTEN) {
                write(file, &format!("{label} on {name}"), [took, least, half], &points);
            }
            ratios.push((took / least, section.duration / least, motion, from));
        }
        print(name, label, &mut ratios);
    }
}

/// Prints a row of the table, and the motion with the largest ratio.
fn print(setup: &str, label: &str, ratios: &mut [(f64, f64, Motion, Joints)]) {
    ratios.sort_by(|one, other| one.0.total_cmp(&other.0));
    let count = ratios.len();
    let Some((worst, finely, motion, from)) = ratios.last() else {
        println!("{setup}  {label:22} none found");
        return;
    };
    let mean = ratios.iter().map(|row| row.0).sum::<f64>() / count as f64;
    let at = |share: f64| ratios[(((count - 1) as f64) * share) as usize].0;
    println!(
        "{setup}  {label:22} {count:5}  least {:.3}  mean {mean:.3}  nine of ten {:.3}  99 of 100 {:.3}  worst {worst:.3}",
        at(0.0),
        at(0.9),
        at(0.99),
    );
    let Motion { kind, target, auxiliary, velocity, acceleration, .. } = motion;
    println!(
        "   worst ({finely:.3} in fine cycles): {kind:?} to {target:?} by {auxiliary:?}, {velocity} {acceleration}, from {from:?}"
    );
}

/// Writes a path with its limits: what another reference needs.
fn write(file: &mut std::fs::File, name: &str, [took, least, half]: [f64; 3], points: &[Point]) {
    let list = |values: &[f64]| {
        let values: Vec<String> = values
            .iter()
            .map(|value| if value.is_finite() { value.to_string() } else { "null".into() })
            .collect();
        format!("[{}]", values.join(","))
    };
    let bounds = points[points.len() / 2].bounds;
    let rows = |rows: Vec<String>| format!("[{}]", rows.join(","));
    writeln!(
        file,
        r#"{{"name":"{name}","took":{took},"least":{least},"half":{half},"axes":{AXES},"joints":{},"tool":{},"joint_limits":{},"tool_limits":{}}}"#,
        rows(points.iter().map(|point| list(&point.joints)).collect()),
        rows(points.iter().map(|point| list(&point.tool)).collect()),
        rows(bounds.joints.iter().map(|limits| list(limits)).collect()),
        list(&bounds.tool),
    )
    .unwrap();
}
