//! Every shipped application runs in virtual mode, in all three execution types.

#![expect(clippy::unwrap_used, reason = "a helper of a test may panic as the test may")]

use bench::records::results::Results;
use bench::records::schedule::Plan;
use bench::stands::virtual_run::whole;
use plc_node::ExecutionType::{self, Cm, Rc, Sm};

fn run(application: &str) -> Results {
    let found = planning::application(application, None).unwrap();
    let setup = setup::setup("A").unwrap();
    let plan = Plan::new(&ExecutionType::ALL, 2, 1);
    whole(&setup, &found.application, &plan).unwrap()
}

fn aet(results: &Results, of: ExecutionType) -> f64 {
    results.figure(of).map_or(f64::NAN, |figure| figure.aet_ms)
}

#[test]
fn each_is_fastest_as_a_program_and_slowest_as_single_motions() {
    for name in ["pick-and-place-gripper", "gluing", "insertion-with-force"] {
        let results = run(name);
        let [rc, sm, cm] = [Rc, Sm, Cm].map(|of| aet(&results, of));
        assert!(rc < cm && cm < sm, "{name}: RC {rc}, CM {cm}, SM {sm} ms");
        assert_eq!(results.bus.lost, 0, "{name}");
    }
}

#[test]
fn gripping_and_releasing_takes_their_waits_and_for_cm_two_more_skill_calls() {
    let (measured, planned) = (run("pick-and-place"), run("pick-and-place-gripper"));
    let more = |of| aet(&planned, of) - aet(&measured, of);
    // 150 ms to grip and 100 ms to release, each on the robot's cycle; a junction is no faster for a stop.
    assert!((250.0..275.0).contains(&more(Rc)), "RC takes {} ms more", more(Rc));
    let (setup, _) = planning::setup_with_application("A").unwrap();
    let overhead_ms = f64::from(setup.robot.skill_overhead_us.value) / 1e3;
    let calls = more(Cm) - 250.0;
    assert!((2.0 * overhead_ms..2.0 * overhead_ms + 80.0).contains(&calls), "CM's calls take {calls} ms");
    // Thirteen calls find the interpreter at thirteen phases, so that the mean of two runs is off by up to 30 ms.
    assert!((220.0..290.0).contains(&more(Sm)), "SM takes {} ms more", more(Sm));
}
