//! What of a plan an arm reaches, and what is said where it does not.

#![expect(clippy::unwrap_used, reason = "a helper of a test may panic as the test may")]

use arm::Violation;
use planning::{APPLICATIONS, Application, OutOfReach, Reached, plan};
use setup::{SETUPS, Setup, setup};

fn application(name: &str) -> Application {
    planning::application(name, None).unwrap().application
}

/// Plans pick and place on a changed setup and follows the plan with its arm.
fn changed(name: &str, change: impl Fn(&mut Setup)) -> Result<Reached, OutOfReach> {
    let mut setup = setup(name).unwrap();
    change(&mut setup);
    let application = application("pick-and-place");
    plan(&application, &setup).unwrap().reach(&application, &setup)
}

fn moved(name: &str, by: [f64; 6]) -> Result<Reached, OutOfReach> {
    changed(name, |setup| {
        let base = &mut setup.robot.bases[0].mm_deg.value;
        *base = core::array::from_fn(|i| base[i] + by[i]);
    })
}

#[test]
fn every_built_in_setup_reaches_every_built_in_application_and_starts_at_its_home() {
    for ((name, _), (application_name, _)) in
        SETUPS.iter().flat_map(|setup| APPLICATIONS.iter().map(move |application| (setup, application)))
    {
        let setup = setup(name).unwrap();
        let found = planning::application(application_name, None).unwrap();
        let reached = found.reach(&found.plan(&setup).unwrap(), &setup);
        let reached = reached.unwrap_or_else(|error| panic!("{application_name} on {name}: {error}"));
        if let Some(home) = setup.robot.axes.home_deg.filter(|_| setup.application == *application_name) {
            let off = home.value.iter().zip(reached.start).map(|(home, start)| (home - start).abs());
            assert!(off.fold(0.0, f64::max) < 1e-3, "{application_name} on {name}: {reached:?}");
        }
    }
}

#[test]
fn a_cell_too_far_away_is_refused_with_the_motion_and_the_distance_that_is_missing() {
    let far =
        ["A", "B", "D"].map(|name| moved(name, [700.0, 0.0, 0.0, 0.0, 0.0, 0.0]).unwrap_err().to_string());
    insta::assert_snapshot!(far.join("\n"), @r"
    the arm cannot stand at the start: the target is 934.077 mm from axis 1; the arm reaches from 50.000 to 500.000 mm; 434.1 mm are missing: change frame `home`, or base 1 in the setup
    the arm cannot stand at the start: the wrist centre would be 938.120 mm from axis 2; the arm reaches from 25.200 to 475.200 mm; 462.9 mm are missing: change frame `home`, or base 1 in the setup
    the arm cannot stand at the start: the wrist centre would be 893.370 mm from axis 2; the arm reaches from 32.800 to 817.200 mm; 76.2 mm are missing: change frame `home`, or base 1 in the setup
    ");
    let partly = ["A", "B", "D"].map(|name| {
        let by = |mm: u32| moved(name, [f64::from(mm), 0.0, 0.0, 0.0, 0.0, 0.0]);
        (1..800).find_map(|mm| by(mm).err()).unwrap().to_string()
    });
    insta::assert_snapshot!(partly.join("\n"), @r"
    motion 1 `PTP before A`, its target: the target is 500.029 mm from axis 1; the arm reaches from 50.000 to 500.000 mm; 0.028999 mm are missing: change frame `carrier-rim` or the step's approach_mm, or base 1 in the setup
    motion 3 `LIN A`, after 26.2 of its 30.0 mm: the wrist centre would be 475.687 mm from axis 2; the arm reaches from 25.200 to 475.200 mm; 0.5 mm are missing: change frame `grip`, or base 1 in the setup
    motion 1 `PTP before A`, its target: the wrist centre would be 817.633 mm from axis 2; the arm reaches from 32.800 to 817.200 mm; 0.4 mm are missing: change frame `carrier-rim` or the step's approach_mm, or base 1 in the setup
    ");
}

#[test]
fn a_joint_that_would_leave_its_range_is_named_with_what_is_missing() {
    let low = changed("A", |setup| {
        setup.robot.axes.upper_deg.value[2] = 174.0;
        setup.robot.axes.home_deg = None;
    });
    let low = low.unwrap_err();
    insta::assert_snapshot!(low, @"the arm cannot stand at the start: joint 3 would be at 175.000 mm, its range is 0.000 to 174.000 mm; 1.0 mm are missing: change frame `home`, or base 1 in the setup");
    let narrow = changed("B", |setup| setup.robot.axes.upper_deg.value[0] = -30.0);
    insta::assert_snapshot!(narrow.unwrap_err(), @"motion 1 `PTP before A`, its target: joint 1 would be at -26.565°, its range is -230.000 to -30.000°; 3.4 degrees are missing: change frame `carrier-rim` or the step's approach_mm, or base 1 in the setup");
}

#[test]
fn a_base_that_a_scara_would_have_to_tilt_for_is_refused_with_the_tilt() {
    let tilted = moved("A", [0.0, 0.0, 0.0, 0.0, 5.0, 0.0]).unwrap_err();
    insta::assert_snapshot!(tilted, @"the arm cannot stand at the start: the flange would be tilted by 5.000° from straight down; this arm cannot tilt it (c = 180); change frame `home`, or base 1 in the setup");
}

/// Plans an application of frames in the root and of steps, and follows it with the arm of a setup.
fn of_frames(name: &str, zone_mm: f64, frames: &[[f64; 6]], steps: &str) -> Result<Reached, OutOfReach> {
    let mut text = format!(
        "schema = 2\nname = \"frames\"\ntitle = \"frames\"\ntool = \"flange\"\nbase = \"root\"\nstart = \"f0\"\n\
         [tools]\nflange = 0\n[bases]\nroot = 0\n[zones]\napproximation_mm = {zone_mm:?}\n[frames]\n"
    );
    for (index, frame) in frames.iter().enumerate() {
        text += &format!("f{index} = {{ mm_deg = {frame:?} }}\n");
    }
    text += steps;
    let (application, setup) = (Application::parse("frames", &text).unwrap(), setup(name).unwrap());
    plan(&application, &setup).unwrap().reach(&application, &setup)
}

#[test]
fn a_short_line_that_turns_the_tool_far_is_refused_for_its_turn_and_not_for_a_singular_position() {
    let line = "[[step]]\nname = \"turn\"\nlabels = [\"accurate-path\", \"accurate-stop\"]\npath = [{ line = \"f1\" }]\n";
    let turn = |way_mm: f64, speed: &str| {
        let frames = [[250.0, 0.0, 400.0, 0.0, 0.0, 180.0], [250.0 + way_mm, 0.0, 400.0, 120.0, 0.0, 180.0]];
        of_frames("B", 0.0, &frames, &format!("{line}{speed}"))
    };
    let refused = turn(0.1, "").unwrap_err();
    let text = refused.to_string();
    let begin = "motion 1 `LIN turn`, after 0.0 of its 0.1 mm: it turns the tool by 120.0° on 0.100 mm; at 148.1 mm/s the wrist \
                 would need 177709 degrees per s, and joint 6 is rated for 750; lower the speed to ";
    assert!(text.starts_with(begin) && text.ends_with(" mm/s or lengthen the motion"), "{text}");
    let OutOfReach::Motion { violation: Violation::TurnTooFast { slower_mm_s, .. }, .. } = refused else {
        panic!("{text}");
    };
    for (factor, is_reached) in [(0.98, true), (1.02, false)] {
        let speed = format!("speed_mm_s = {:?}\n", factor * slower_mm_s);
        assert_eq!(turn(0.1, &speed).is_ok(), is_reached, "{speed}");
    }
    assert!(turn(50.0, "").is_ok(), "longer");
}

#[test]
fn a_corner_that_passes_the_end_of_a_joint_range_inside_its_zone_is_warned_of_with_joint_and_place() {
    // Both lines pass axis 1 at 160 mm, and joint 2 lets the arm come as near as 158 mm.
    let frames =
        [[-237.5, -160.2], [92.5, -160.2], [257.5, 125.6]].map(|[x, y]| [x, y, 100.0, 0.0, 0.0, 180.0]);
    let steps = "[[step]]\nname = \"round\"\nlabels = [\"blending\", \"accurate-stop\"]\n\
                 path = [{ line = \"f1\" }, { line = \"f2\" }]\n";
    let stopped = |zone_mm: f64| {
        let reached = of_frames("A", zone_mm, &frames, steps).unwrap();
        reached.stopped.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n")
    };
    insta::assert_snapshot!(stopped(160.0), @"motion 1 `LIN round 1/2` will stop exactly before motion 2 `LIN round 2/2`: after 21 % of the corner in the zone of 160.00 mm, joint 2 would be at -145.700°, its range is -145.000 to 145.000°; 0.7 degrees are missing; lower approximation_mm, or move the frames");
    assert_eq!(stopped(20.0), "");
}

#[test]
fn who_has_a_frame_in_the_root_is_not_advised_to_change_base_0_which_no_setup_has() {
    let frames = [[300.0, 0.0, 100.0, 0.0, 0.0, 180.0], [700.0, 0.0, 100.0, 0.0, 0.0, 180.0]];
    let steps = "[[step]]\nname = \"far\"\nlabels = [\"accurate-stop\"]\nreach = \"f1\"\n";
    let refused = of_frames("A", 0.0, &frames, steps).unwrap_err();
    insta::assert_snapshot!(refused, @"motion 1 `PTP far`, its target: the target is 700.000 mm from axis 1; the arm reaches from 50.000 to 500.000 mm; 200.0 mm are missing: change frame `f1`");
}

#[test]
fn joints_of_a_frame_that_do_not_take_the_tool_there_are_refused_with_where_they_do() {
    let start = [[250.0, 250.0, 100.0, 0.0, 0.0, 180.0]];
    let reach = |mm_deg: [f64; 6]| {
        let joints = "joints_deg = [0.0, 90.0, 100.0, 0.0, 0.0, 0.0]";
        let step = "[[step]]\nname = \"there\"\nlabels = [\"accurate-stop\"]\nreach = \"f1\"\n";
        of_frames("A", 0.0, &start, &format!("f1 = {{ mm_deg = {mm_deg:?}, {joints} }}\n{step}"))
    };
    let refused = reach([300.0, 0.0, 100.0, 0.0, 0.0, 180.0]).unwrap_err();
    insta::assert_snapshot!(refused, @"motion 1 `PTP there`: the frame's joints_deg take the tool to [225.0, 275.0, 100.0, 90.0, 0.0, 180.0] in its base, 285.0 mm and 90.0° away from its mm_deg; correct one of the two");
    // Rounded a little is no contradiction.
    assert!(reach([225.4, 274.6, 100.0, 90.5, 0.0, 180.0]).is_ok());
}

#[test]
fn who_reads_that_a_target_is_too_far_away_is_told_what_decides_where_it_is() {
    // The line from f0 to f1 leads straight out, f1 is just within reach, and f2 is not.
    let frames = [400.0, 499.0, 520.0].map(|x| [x, 0.0, 100.0, 0.0, 0.0, 180.0]);
    let refused = |steps: &str| {
        let steps =
            format!("[[step]]\nname = \"out\"\nlabels = [\"accurate-path\", \"accurate-stop\"]\n{steps}");
        of_frames("A", 0.0, &frames, &steps).unwrap_err().to_string()
    };
    let found = [
        "path = [{ line = \"f1\" }]\nretreat_mm = 20.0\n",
        "from = \"f1\"\npath = [{ line = \"f0\" }]\napproach_mm = 20.0\n",
        "path = [{ spline = [\"f2\", \"f1\"] }]\n",
    ];
    insta::assert_snapshot!(found.map(refused).join("\n"), @r"
    motion 2 `LIN after out`, after 1.0 of its 20.0 mm: the target is 519.000 mm from axis 1; the arm reaches from 50.000 to 500.000 mm; 19.0 mm are missing: change frame `f1` or the step's retreat_mm
    motion 1 `PTP before out`, its target: the target is 519.000 mm from axis 1; the arm reaches from 50.000 to 500.000 mm; 19.0 mm are missing: change frame `f1` or the step's approach_mm
    motion 1 `SPLINE out 1/2`, after 100.0 of its 120.0 mm: the target is 520.000 mm from axis 1; the arm reaches from 50.000 to 500.000 mm; 20.0 mm are missing: change frame `f2`
    ");
    // The way over a wall leads out of the arm's reach, though both of its ends are within.
    let wall = "[ways]\nclearance_mm = 5.0\nceiling_mm = 400.0\nheight_step_mm = 10.0\nptp_radius_mm = 250.0\ndetour_percent = 5.0\n\
                [[obstacle]]\nname = \"wall\"\nlower_mm = [-50.0, 300.0, 0.0]\nupper_mm = [50.0, 500.0, 300.0]\n";
    let step = "[[step]]\nname = \"over\"\nlabels = [\"accurate-stop\"]\nreach = \"f1\"\n";
    let sides = [300.0, -300.0].map(|x| [x, 350.0, 100.0, 0.0, 0.0, 180.0]);
    let over = of_frames("A", 0.0, &sides, &format!("{wall}{step}")).unwrap_err();
    insta::assert_snapshot!(over, @"motion 1 `PTP over the wall`, its target: joint 3 would be at 310.000 mm, its range is 0.000 to 200.000 mm; 110.0 mm are missing: change the frames before and after it or the obstacle between them");
}
