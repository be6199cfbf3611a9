//! How near the motions of a plan may come to an obstacle.

#![expect(clippy::unwrap_used, reason = "a helper of a test may panic as the test may")]

use planning::{Application, Error, Found, Plan, plan};
use protocol::image::MotionKind;

/// Plans an application of a box, of frames in the root and of steps on Setup A.
fn planned(numbers: &str, obstacle: [[f64; 3]; 2], frames: &[[f64; 6]], steps: &str) -> Result<Plan, Error> {
    plan(&application(numbers, obstacle, frames, steps).application, &setup::setup("A").unwrap())
}

fn application(numbers: &str, obstacle: [[f64; 3]; 2], frames: &[[f64; 6]], steps: &str) -> Found {
    let [lower, upper] = obstacle;
    let mut text = format!(
        "schema = 2\nname = \"box\"\ntitle = \"box\"\ntool = \"flange\"\nbase = \"root\"\nstart = \"f0\"\n\
         [tools]\nflange = 0\n[bases]\nroot = 0\n{numbers}\nceiling_mm = 180.0\nheight_step_mm = 10.0\n\
         detour_percent = 5.0\n[[obstacle]]\nname = \"box\"\nlower_mm = {lower:?}\nupper_mm = {upper:?}\n[frames]\n"
    );
    for (index, frame) in frames.iter().enumerate() {
        text += &format!("f{index} = {{ mm_deg = {frame:?} }}\n");
    }
    text += steps;
    let application = Application::parse("box", &text).unwrap();
    Found { origin: "box.toml".to_owned(), path: None, text, application }
}

#[test]
fn a_ptp_around_axis_1_does_not_go_through_a_box_on_its_arc() {
    // 384 mm from axis 1 at both ends, 150° apart: the arc is at x = 384 where the chord is at x = 99.
    let ends = [-371.2712, 371.2712].map(|y| [99.4818, y, 60.0, 0.0, 0.0, 180.0]);
    let reach = "[[step]]\nname = \"a\"\nlabels = [\"accurate-stop\"]\nreach = \"f1\"\n";
    let numbers = "[ways]\nclearance_mm = 8.0\nptp_radius_mm = 384.0";
    let plan = planned(numbers, [[287.8, -40.0, 0.0], [444.4, 40.0, 90.0]], &ends, reach).unwrap();
    assert!(plan.motions.len() > 1, "{plan}");
}

#[test]
fn a_line_needs_half_the_approximation_distance_more_only_where_it_is_blended() {
    let frames = [[200.0, 0.0, 60.0], [300.0, 0.0, 60.0], [300.0, 100.0, 60.0]];
    let frames = frames.map(|[x, y, z]| [x, y, z, 0.0, 0.0, 180.0]);
    let steps = |labels: &str| {
        format!(
            "[[step]]\nname = \"a\"\nlabels = [{labels}]\npath = [{{ line = \"f1\" }}]\n\
             [[step]]\nname = \"b\"\nlabels = [\"accurate-stop\"]\npath = [{{ line = \"f2\" }}]\n"
        )
    };
    // The box is 25 mm from the corner.
    let numbers = "[zones]\napproximation_mm = 20.0\n[ways]\nclearance_mm = 20.0\nptp_radius_mm = 250.0";
    let space = [[325.0, -20.0, 0.0], [345.0, 10.0, 100.0]];
    let plan = planned(numbers, space, &frames, &steps("\"accurate-stop\"")).unwrap();
    assert!(plan.motions.iter().all(|motion| motion.kind == MotionKind::LinCartesian), "{plan}");
    let refused = planned(numbers, space, &frames, &steps("\"blending\"")).unwrap_err().to_string();
    assert!(refused.contains("the path comes nearer to obstacle `box` than clearance_mm = 20"), "{refused}");
}

#[test]
fn a_ptp_whose_joints_take_the_tool_to_an_obstacle_far_from_its_chord_is_refused_with_how_near_it_comes() {
    // The tool is 384 mm from axis 1, and the application says that it bows no more than on a radius of 3000 mm.
    let ends = [-371.2712, 371.2712].map(|y| [99.4818, y, 60.0, 0.0, 0.0, 180.0]);
    let step = "[[step]]\nname = \"a\"\nlabels = [\"accurate-stop\"]\nreach = \"f1\"\n";
    let numbers = "[ways]\nclearance_mm = 8.0\nptp_radius_mm = 3000.0";
    let setup = setup::setup("A").unwrap();
    let found = application(numbers, [[370.0, -40.0, 0.0], [400.0, 40.0, 90.0]], &ends, step);
    let reached = found.reach(&found.plan(&setup).unwrap(), &setup);
    insta::assert_snapshot!(reached.unwrap_err(), @"box.toml on setup A: motion 1 `PTP a`: its joints take the tool to 0.0 mm from obstacle `box`; clearance_mm = 8 are needed: lower ptp_radius_mm = 3000, or lead the tool over a frame between");
    let elsewhere = application(numbers, [[370.0, -40.0, 150.0], [400.0, 40.0, 190.0]], &ends, step);
    assert!(elsewhere.reach(&elsewhere.plan(&setup).unwrap(), &setup).is_ok());
}
