//! Suspend, resume, halt, override and late data on circles and splines, on both arms: always on the curve.

use protocol::image::{Control, Feedback, Motion, MotionKind, Skill, State, Status};
use robot_node::{Program, RobotEvent};

use crate::driven::{Driven, bare, lin, ptp};

type Point = [f32; 3];

/// A named sequence of motions from (0, 40, 90) in base 1.
fn curves() -> [(&'static str, Vec<Motion>); 2] {
    let arc = Motion { kind: MotionKind::Circular, auxiliary: [50.0, 90.0, 90.0], ..lin(100.0, 40.0, 90.0) };
    let back = Motion { auxiliary: [50.0, -10.0, 90.0], target: lin(0.0, 40.0, 90.0).target, ..arc };
    let spline = |x, y| Motion { kind: MotionKind::Spline, ..lin(x, y, 90.0) };
    let wave = [(40.0, 65.0), (85.0, 80.0), (130.0, 75.0), (170.0, 50.0), (215.0, 40.0), (250.0, 60.0)];
    [("circle", vec![arc, back]), ("spline", wave.map(|(x, y)| spline(x, y)).to_vec())]
}

fn at_the_start(setup: &str) -> Driven {
    let mut robot = Driven::ready(bare(setup), Program::default());
    robot.run(vec![ptp(0.0, 40.0, 90.0)]);
    assert!(robot.is_done(), "{setup}: {:?}", robot.feedback());
    robot.events.clear();
    robot
}

fn place(feedback: &Feedback) -> Point {
    let [x, y, z, ..] = feedback.pose;
    [x, y, z]
}

/// The undisturbed run's places, cycle by cycle, and how many cycles it took.
fn undisturbed(setup: &str, motions: &[Motion]) -> Vec<Point> {
    let mut robot = at_the_start(setup);
    robot.call(Skill::MoveContinuous, motions.to_vec());
    let mut places = vec![place(robot.feedback())];
    while robot.feedback().number != robot.command.number || !robot.is_done() {
        robot.tick();
        places.push(place(robot.feedback()));
        assert!(!robot.feedback().status.contains(Status::ERROR), "{:?}", robot.feedback());
    }
    places
}

/// Distance in mm from a point to the course that the places make.
fn off_course(point: Point, places: &[Point]) -> f32 {
    let to_chord = |from: &Point, to: &Point| {
        let along: Point = core::array::from_fn(|i| to[i] - from[i]);
        let offset: Point = core::array::from_fn(|i| point[i] - from[i]);
        let square: f32 = along.iter().map(|it| it * it).sum();
        let share = along.iter().zip(offset).map(|(a, o)| a * o).sum::<f32>() / square.max(1e-9);
        let share = share.clamp(0.0, 1.0);
        let foot: Point = core::array::from_fn(|i| offset[i] - share * along[i]);
        foot.iter().map(|it| it * it).sum::<f32>().sqrt()
    };
    places.windows(2).map(|pair| to_chord(&pair[0], &pair[1])).fold(f32::INFINITY, f32::min)
}

/// A sample every millimetre of a curve of 40 mm radius leaves the chord by 0.003 mm.
const ON_COURSE_MM: f32 = 0.02;

#[test]
fn suspended_anywhere_on_a_curve_it_rests_on_it_and_goes_on_along_it() {
    for setup in ["A", "B"] {
        for (name, motions) in curves() {
            let course = undisturbed(setup, &motions);
            for share in [0.1, 0.35, 0.6, 0.9] {
                let mut robot = at_the_start(setup);
                robot.call(Skill::MoveContinuous, motions.clone());
                (0..(course.len() as f64 * share) as usize).for_each(|_| robot.tick());
                robot.control(Control::SUSPEND);
                robot.wait(|feedback| feedback.state == State::Suspended);
                let rests = place(robot.feedback());
                let off = off_course(rests, &course);
                assert!(off < ON_COURSE_MM, "{setup} {name} {share}: rests {off} mm off the curve");
                robot.run_ms(200);
                assert_eq!(place(robot.feedback()), rests);
                robot.control(Control::RESUME);
                while !robot.is_done() {
                    robot.tick();
                    let off = off_course(place(robot.feedback()), &course);
                    assert!(off < ON_COURSE_MM, "{setup} {name} {share}: {off} mm off the curve");
                    assert!(!robot.feedback().status.contains(Status::ERROR), "{:?}", robot.feedback());
                }
                assert_eq!(robot.feedback().executed as usize, motions.len());
            }
        }
    }
}

#[test]
fn halted_on_a_curve_it_stops_on_it() {
    for setup in ["A", "B"] {
        for (name, motions) in curves() {
            let course = undisturbed(setup, &motions);
            let mut robot = at_the_start(setup);
            robot.call(Skill::MoveContinuous, motions);
            (0..course.len() / 2).for_each(|_| robot.tick());
            robot.command.control = Control::ENABLE | Control::HALT;
            robot.wait_for_end();
            assert_eq!(robot.feedback().state, State::Halted);
            assert!(robot.feedback().status.contains(Status::ABORTED | Status::AT_REST));
            let off = off_course(place(robot.feedback()), &course);
            assert!(off < ON_COURSE_MM, "{setup} {name}: {off} mm off the curve");
        }
    }
}

#[test]
fn an_override_that_changes_on_the_way_keeps_to_the_curve() {
    for setup in ["A", "B"] {
        for (name, motions) in curves() {
            let course = undisturbed(setup, &motions);
            let mut robot = at_the_start(setup);
            robot.call(Skill::MoveContinuous, motions);
            let mut cycles = 0_usize;
            while robot.feedback().number != robot.command.number || !robot.is_done() {
                robot.command.override_percent = [100, 30, 60, 10][cycles / 60 % 4];
                robot.tick();
                cycles += 1;
                let off = off_course(place(robot.feedback()), &course);
                assert!(off < ON_COURSE_MM, "{setup} {name}: {off} mm off the curve");
                assert!(cycles < 40 * course.len(), "it never ends");
            }
            assert!(cycles > course.len() * 5 / 4, "{setup} {name}: {cycles} cycles of {}", course.len());
        }
    }
}

#[test]
fn a_late_successor_makes_an_exact_stop_that_is_reported_and_the_run_goes_on() {
    for setup in ["A", "B"] {
        for (name, motions) in curves() {
            let motions: Vec<Motion> =
                motions.into_iter().map(|motion| Motion { approximation: 1_000, ..motion }).collect();
            let mut robot = at_the_start(setup);
            let last_good = motions[motions.len() - 2].target;
            robot.keep_back = 1;
            robot.call(Skill::MoveContinuous, motions.clone());
            let before = motions.len() as u32 - 1;
            let number = robot.command.number;
            robot.wait(|feedback| {
                let waits = feedback.executed == before && feedback.status.contains(Status::AT_REST);
                feedback.number == number && waits
            });
            let [x, y, _] = place(robot.feedback());
            assert!(libm::hypotf(x - last_good[0], y - last_good[1]) < 1e-2, "{setup} {name}: ({x}, {y})");
            assert_eq!(robot.feedback().state, State::Running, "it waits, it does not fail");
            robot.keep_back = 0;
            robot.wait_for_end();
            assert!(robot.is_done(), "{setup} {name}: {:?}", robot.feedback());
            assert_eq!(robot.feedback().blends_suppressed, 1, "{setup} {name}");
            let suppressed =
                |event: &&RobotEvent| **event == RobotEvent::BlendSuppressed { motion: before - 1 };
            assert_eq!(robot.events.iter().filter(suppressed).count(), 1, "{setup} {name}");
        }
    }
}
