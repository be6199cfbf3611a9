//! Lines and turns that pass positions in which one joint moves far for a moment, and those away from them, against the time optimum. `examples/near_optimum.rs` draws many more.

use std::fmt::Write as _;

use protocol::image::{Motion, MotionKind};
use robot_node::RobotConfig;

use crate::drawn::{Drawn, Passage};
use crate::fastest::fastest;
use crate::fed::config;
use crate::recorded;

/// Random motions of each kind.
const CASES: usize = 5;

/// Returns the time of a random motion over that of the reference; none where it is of another kind.
fn ratio(drawn: &mut Drawn<'_>, kind: Passage, config: &RobotConfig) -> Option<f64> {
    let (motion, from) = drawn.motion(kind)?;
    let sections = recorded::sections(&[motion], &from, config)?;
    let [section] = &sections[..] else { return None };
    if !drawn.is_of(kind, section.all_joints().step_by(16)) {
        return None;
    }
    let steps = ((section.duration / 5e-3) as usize).clamp(100, 600);
    let (points, half) = section.points(steps, &[motion], config);
    Some(recorded::seconds(&motion, &from, config) / fastest(&points, half).duration)
}

#[test]
fn lines_circles_and_turns_are_near_the_time_optimum_beside_singular_positions_too() {
    let (mut table, mut wrong) = (String::new(), Vec::new());
    for name in ["A", "B", "D"] {
        let (config, setup) = (config(name), setup::setup(name).unwrap());
        for (label, kind) in Passage::ALL {
            if config.arm.axes() == 4 && kind.is_singular() {
                continue;
            }
            let mut drawn = Drawn::new(3, &config, &setup);
            let found = core::iter::repeat_with(|| ratio(&mut drawn, kind, &config));
            let ratios: Vec<f64> = found.flatten().take(CASES).collect();
            let worst = ratios.iter().copied().fold(0.0, f64::max);
            writeln!(table, "{name}  {label:22} {ratios:.3?}").unwrap();
            if worst > if kind.is_singular() { 1.10 } else { 1.055 } {
                wrong.push(format!("{label} on {name}: {ratios:.3?}"));
            }
        }
    }
    println!("{table}");
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn a_line_past_the_shoulder_and_a_turn_at_one_place_take_hardly_more_than_an_outside_reference_does() {
    let config = config("B");
    let line = |target, [velocity, acceleration]: [u16; 2]| Motion {
        kind: MotionKind::LinCartesian,
        target,
        velocity,
        acceleration,
        ..Motion::EMPTY
    };
    let past_shoulder = [-54.257_744, 62.464_966, 660.738_65, -46.499_63, 3.246_816, -21.758_856];
    let from = [129.468_111, -74.105_949, 9.926_228, 41.132_742, -34.594_851, -211.373_507];
    let took = recorded::seconds(&line(past_shoulder, [19_544, 4_075]), &from, &config);
    assert!(took < 1.10 * 0.849, "{took} s, 0.849 s is possible");
    let turned = [-57.334_65, 9.255_69, 601.115_1, -87.815, -46.548, -4.699];
    let from = [187.708, -62.126, 25.12, -30.815, 30.952, 208.484];
    for (acceleration, possible) in [(1_081, 0.854), (5_000, 0.725)] {
        let took = recorded::seconds(&line(turned, [5_714, acceleration]), &from, &config);
        assert!(took < 1.05 * possible, "{took} s at {acceleration}, {possible} s is possible");
    }
}
