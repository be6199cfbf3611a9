//! A list of motions on the bare path, fed as a PLC that is never late would.

use protocol::image::{Motion, MotionKind, SLOTS};
use robot_node::RobotConfig;
use robot_node::motion::{Interpolator, Segment};

/// The robot of a built-in setup.
pub(crate) fn config(setup: &str) -> RobotConfig {
    RobotConfig::from_setup(&setup::setup(setup).unwrap()).unwrap()
}

/// How long the motions but the first one take in s, and the speed of the tool in
/// each cycle, in mm/s.
pub(crate) fn driven(motions: &[Motion], config: &RobotConfig) -> (f64, Vec<f64>) {
    let (start, motions) = motions.split_first().unwrap();
    let start = Motion { kind: MotionKind::PtpCartesian, velocity: 10_000, acceleration: 10_000, ..*start };
    let from = Segment::prepare(&start, &config.home, config).unwrap().end;
    let cycle_s = config.cycle.as_secs_f64();
    let mut interpolator = Interpolator::at_rest(config.arm.clone(), from, cycle_s);
    let (mut appended, mut seconds, mut speeds) = (0, 0.0, Vec::new());
    loop {
        while appended < motions.len() && appended - (interpolator.path().executed() as usize) < SLOTS {
            let segment = interpolator.path().prepare(&motions[appended], config).unwrap();
            appended += 1;
            interpolator.append(segment, appended == motions.len());
        }
        let step = interpolator.drive(1.0).unwrap();
        assert_eq!(step.suppressed, None, "every motion is there in time");
        seconds += cycle_s;
        speeds.push(interpolator.path_speed());
        if let Some(left) = step.ended {
            return (seconds - left, speeds);
        }
    }
}
