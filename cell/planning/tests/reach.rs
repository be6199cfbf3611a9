//! What of a plan an arm reaches, and what is said where it does not.

#![expect(clippy::unwrap_used, reason = "a helper of a test may panic as the test may")]

use planning::{APPLICATIONS, Application, OutOfReach, Reached, plan};
use setup::{SETUPS, Setup, setup};

fn application(name: &str) -> Application {
    planning::application(name, None).unwrap().application
}

/// Plans pick and place on a changed setup and follows the plan with its arm.
fn changed(name: &str, change: impl Fn(&mut Setup)) -> Result<Reached, OutOfReach> {
    let mut setup = setup(name).unwrap();
    change(&mut setup);
    plan(&application("pick-and-place"), &setup).unwrap().reach(&setup)
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
        let reached = plan(&application(application_name), &setup).unwrap().reach(&setup);
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
    the arm cannot stand at the start: the target is 934.077 mm from axis 1; the arm reaches from 50.000 to 500.000 mm; 434.1 mm are missing: change its frame, or base 1 in the setup
    the arm cannot stand at the start: the wrist centre would be 938.120 mm from axis 2; the arm reaches from 25.200 to 475.200 mm; 462.9 mm are missing: change its frame, or base 1 in the setup
    the arm cannot stand at the start: the wrist centre would be 893.370 mm from axis 2; the arm reaches from 32.800 to 817.200 mm; 76.2 mm are missing: change its frame, or base 1 in the setup
    ");
    let partly = ["A", "B", "D"].map(|name| {
        let by = |mm: u32| moved(name, [f64::from(mm), 0.0, 0.0, 0.0, 0.0, 0.0]);
        (1..800).find_map(|mm| by(mm).err()).unwrap().to_string()
    });
    insta::assert_snapshot!(partly.join("\n"), @r"
    motion 1 `PTP before A`, its target: the target is 500.029 mm from axis 1; the arm reaches from 50.000 to 500.000 mm; 0.0 mm are missing: change its frame, or base 1 in the setup
    motion 3 `LIN A`, after 26.2 of its 30.0 mm: the wrist centre would be 475.687 mm from axis 2; the arm reaches from 25.200 to 475.200 mm; 0.5 mm are missing: change its frame, or base 1 in the setup
    motion 1 `PTP before A`, its target: the wrist centre would be 817.633 mm from axis 2; the arm reaches from 32.800 to 817.200 mm; 0.4 mm are missing: change its frame, or base 1 in the setup
    ");
}

#[test]
fn a_joint_that_would_leave_its_range_is_named_with_what_is_missing() {
    let low = changed("A", |setup| {
        setup.robot.axes.upper_deg.value[2] = 174.0;
        setup.robot.axes.home_deg = None;
    });
    let low = low.unwrap_err();
    insta::assert_snapshot!(low, @"the arm cannot stand at the start: joint 3 would be at 175.000, its range is 0.000 to 174.000; 1.0 degrees or mm are missing: change its frame, or base 1 in the setup");
    let narrow = changed("B", |setup| setup.robot.axes.upper_deg.value[0] = -30.0);
    insta::assert_snapshot!(narrow.unwrap_err(), @"motion 1 `PTP before A`, its target: joint 1 would be at -26.565, its range is -230.000 to -30.000; 3.4 degrees or mm are missing: change its frame, or base 1 in the setup");
}

#[test]
fn a_base_that_a_scara_would_have_to_tilt_for_is_refused_with_the_tilt() {
    let tilted = moved("A", [0.0, 0.0, 0.0, 0.0, 5.0, 0.0]).unwrap_err();
    insta::assert_snapshot!(tilted, @"the arm cannot stand at the start: the flange would be tilted by 5.000° from straight down; this arm cannot tilt it (c = 180); change its frame, or base 1 in the setup");
}
