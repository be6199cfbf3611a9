//! The shipped applications on both arms, cycle by cycle, against what their plans promise.

use planning::{APPLICATIONS, Application, Plan, Point, Stop};
use protocol::image::{Feedback, Skill};
use robot_node::Program;
use setup::Setup;

use crate::driven::{Driven, bare};

fn shipped() -> impl Iterator<Item = (Setup, Application)> {
    let both = |(name, text): &(&str, &str)| {
        ["A", "B"].map(|setup| (setup::setup(setup).unwrap(), Application::parse(name, text).unwrap()))
    };
    APPLICATIONS.iter().flat_map(both)
}

/// Runs the plan as a program of the robot and calls `watch` after each cycle, with the index of the motion under way.
fn run(setup: &Setup, application: &Application, plan: &Plan, mut watch: impl FnMut(usize, &Feedback)) {
    let to_start = plan.wire_to_start(setup);
    let config = bare(&setup.name).in_cell_of(application, &to_start).unwrap();
    let motions: Vec<_> = to_start.from_anywhere.into_iter().chain(plan.wire_motions(setup)).collect();
    let stops: Vec<Stop> =
        plan.stops().into_iter().map(|stop| Stop { after: stop.after + 1, ..stop }).collect();
    let total = motions.len();
    let mut driven = Driven::ready(config, Program::new(motions, &stops));
    driven.call(Skill::RunProgram, Vec::new());
    while driven.feedback().executed < total as u32 {
        driven.tick();
        let feedback = driven.feedback();
        assert!(!feedback.status.contains(protocol::image::Status::ERROR), "{feedback:?}");
        if let Some(index) = feedback.executed.checked_sub(1) {
            watch(index as usize, feedback);
        }
    }
}

fn tool(feedback: &Feedback) -> Point {
    let [x, y, z, ..] = feedback.pose.map(f64::from);
    Point::new(x, y, z)
}

#[test]
fn the_tool_keeps_the_clearance_from_every_obstacle_whatever_the_motion_and_the_arm() {
    let mut nearest_mm = f64::INFINITY;
    for (setup, application) in shipped() {
        let Some(ways) = application.ways else { continue };
        let plan = planning::plan(&application, &setup).unwrap();
        run(&setup, &application, &plan, |index, feedback| {
            for obstacle in &application.obstacles {
                let over_mm = -obstacle.space.grown(ways.clearance_mm).depth_mm(tool(feedback));
                nearest_mm = nearest_mm.min(over_mm);
                assert!(
                    over_mm > -0.01,
                    "{} on {}: motion {index} by {over_mm} mm",
                    application.name,
                    setup.name
                );
            }
        });
    }
    assert!(nearest_mm < 30.0, "the ways go round far: {nearest_mm} mm");
}

#[test]
fn accurate_paths_run_where_the_plan_says_lines_circles_and_splines_alike() {
    let mut splines = 0;
    for (setup, application) in shipped() {
        let plan = planning::plan(&application, &setup).unwrap();
        let courses: Vec<Vec<Point>> = plan.motions.iter().map(planning::Motion::course).collect();
        let off_mm = |course: &[Point], at: Point| {
            let legs = course.iter().zip(course.iter().skip(1));
            legs.map(|(from, to)| from_leg(at, *from, *to)).fold(f64::INFINITY, f64::min)
        };
        run(&setup, &application, &plan, |index, feedback| {
            let Some(motion) = plan.motions.get(index).filter(|motion| motion.accurate_path) else { return };
            splines += usize::from(motion.kind == protocol::image::MotionKind::Spline);
            // A corner that is smooth enough to be passed lies beside both courses.
            let near = courses[index.saturating_sub(1)..].iter().take(3);
            let off = near.map(|course| off_mm(course, tool(feedback))).fold(f64::INFINITY, f64::min);
            let tolerance = application.zones.path_tolerance_mm / 2.0 + 0.03;
            assert!(off < tolerance, "{} on {}: {} by {off} mm", application.name, setup.name, motion.name);
        });
    }
    assert!(splines > 500, "{splines} cycles of splines");
}

fn from_leg(at: Point, from: Point, to: Point) -> f64 {
    let way = to - from;
    let share = ((at - from).dot(way) / way.dot(way)).clamp(0.0, 1.0);
    (at - from.toward(to, share)).length()
}
