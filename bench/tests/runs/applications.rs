//! Every shipped application runs in virtual mode, in all three execution types.

use plc_node::ExecutionType::{self, Cm, Rc, Sm};
use records::results::Results;
use records::schedule::Schedule;
use stands::virtual_run::whole;

fn run(application: &str) -> Results {
    run_on("A", application, 2)
}

fn run_on(setup: &str, application: &str, reps: u32) -> Results {
    let found = planning::application(application, None).unwrap();
    let setup = setup::setup(setup).unwrap();
    let schedule = Schedule::new(&ExecutionType::ALL, reps, 1);
    whole(&setup, &found.application, &schedule).unwrap()
}

fn aet(results: &Results, execution_type: ExecutionType) -> f64 {
    results.figure(execution_type).map_or(f64::NAN, |figure| figure.aet_ms)
}

#[test]
fn each_application_runs_on_every_arm_and_is_fastest_as_a_program_and_slowest_as_single_motions() {
    for (setup, (name, _)) in ["A", "B", "D"]
        .into_iter()
        .flat_map(|it| planning::APPLICATIONS.iter().map(move |application| (it, application)))
    {
        let results = run_on(setup, name, 1);
        let [rc, sm, cm] = [Rc, Sm, Cm].map(|execution_type| aet(&results, execution_type));
        // One continuous motion costs one call, as a program does, so that the phase decides between them.
        let phase_ms = 80.0;
        assert!(rc < cm + phase_ms && cm < sm, "{name} on {setup}: RC {rc}, CM {cm}, SM {sm} ms");
        assert_eq!(results.bus.lost, 0, "{name} on {setup}");
    }
}

/// At power-on the arm is not at the start of most applications.
#[test]
fn the_first_repetition_takes_as_long_as_those_after_it() {
    for setup in ["A", "B"] {
        let setup = setup::setup(setup).unwrap();
        // Each of the two repetitions meets the interpreter at its own phase.
        let robot = &setup.robot;
        let start_us = robot.start_quantum_us.as_ref().map_or(0, |quantum| quantum.value);
        let phase_ms = f64::from(robot.interpreter_quantum_us.value + start_us) / 1e3;
        for name in ["gluing", "engraving", "insertion-with-force"] {
            let application = planning::application(name, None).unwrap().application;
            let results = whole(&setup, &application, &Schedule::new(&[Rc], 3, 1)).unwrap();
            let samples = &results.results.rc.as_ref().unwrap().samples_ms;
            let (least, most) = samples
                .iter()
                .fold((f64::MAX, f64::MIN), |(least, most), &sample| (least.min(sample), most.max(sample)));
            assert!(most - least <= phase_ms + 4.0, "{name} on {}: {samples:?} ms", setup.name);
        }
    }
}

#[test]
fn an_application_whose_start_is_not_its_end_begins_each_repetition_at_its_start() {
    let setup = setup::setup("A").unwrap();
    let (_, text) = planning::APPLICATIONS[0];
    let elsewhere = text.replacen("start = \"home\"", "start = \"above-wall\"", 1).replacen(
        "[frames]",
        "[frames]\nabove-wall = { mm_deg = [150.0, 20.0, 170.0, 0.0, 0.0, 180.0] }",
        1,
    );
    let samples = |text: &str| {
        let application = planning::Application::parse("test", text).unwrap();
        let results = whole(&setup, &application, &Schedule::new(&[Rc], 3, 1)).unwrap();
        results.results.rc.as_ref().unwrap().samples_ms.clone()
    };
    let (home, elsewhere) = (samples(text), samples(&elsewhere));
    for (home, elsewhere) in home.iter().zip(&elsewhere) {
        // The first motion has another path; the interpreter's phase is within 12 ms and a robot cycle.
        assert!((home - elsewhere).abs() > 20.0, "{home} and {elsewhere} ms");
    }
    assert!(elsewhere.iter().all(|sample| (sample - elsewhere[0]).abs() <= 16.0), "{elsewhere:?} ms");
}

#[test]
fn a_start_that_the_arm_cannot_reach_is_refused_with_frame_reason_and_remedy() {
    let setup = setup::setup("A").unwrap();
    let (_, text) = planning::APPLICATIONS[0];
    let far = text.replacen("start = \"home\"", "start = \"far\"", 1).replacen(
        "[frames]",
        "[frames]\nfar = { mm_deg = [700.0, 0.0, 150.0, 0.0, 0.0, 180.0] }",
        1,
    );
    let application = planning::Application::parse("test", &far).unwrap();
    let refused = whole(&setup, &application, &Schedule::new(&[Rc], 1, 1)).unwrap_err();
    insta::assert_snapshot!(refused, @"application pick-and-place: start: the arm cannot stand at frame `far`: the target is 626.498 mm from axis 1; the arm reaches from 50.000 to 500.000 mm; change that frame, or base 1 in the setup");
}

/// Pick-and-place with the elbow of the SCARA on a side, by the configuration of its `home` and `carrier-rim`.
fn with_elbow(status: u8) -> planning::Application {
    let (_, text) = planning::APPLICATIONS[0];
    let configured = ["home = {", "carrier-rim = {"].iter().fold(text.to_owned(), |text, frame| {
        text.replacen(frame, &format!("{frame} configuration = {{ status = {status} }},"), 1)
    });
    planning::Application::parse("test", &configured).unwrap()
}

#[test]
fn an_application_runs_with_the_elbow_on_the_side_that_it_names() {
    let setup = setup::setup("A").unwrap();
    // Joint 2 is below 0° at power-on, so that this is what the application does without a configuration.
    let usual = run("pick-and-place");
    for execution_type in ExecutionType::ALL {
        let aet_with = |status| {
            let schedule = Schedule::new(&[execution_type], 2, 1);
            aet(&whole(&setup, &with_elbow(status), &schedule).unwrap(), execution_type)
        };
        let (right, left) = (aet_with(0), aet_with(2));
        assert!((right - aet(&usual, execution_type)).abs() < 20.0, "{execution_type}: {right} ms");
        assert!((left - right).abs() > 10.0, "{execution_type}: {left} and {right} ms");
    }
}

/// From the second repetition on the PLC moves to the joints of the start, which have no configuration beside them.
#[test]
fn a_start_that_names_its_configuration_is_reached_again_where_the_end_is_elsewhere() {
    let setup = setup::setup("A").unwrap();
    let (_, text) = planning::APPLICATIONS[0];
    let elsewhere = text.replacen("start = \"home\"", "start = \"above-wall\"", 1).replacen(
        "[frames]",
        "[frames]\nabove-wall = { mm_deg = [150.0, 20.0, 170.0, 0.0, 0.0, 180.0], configuration = { status = 2 } }",
        1,
    );
    let application = planning::Application::parse("test", &elsewhere).unwrap();
    let results = whole(&setup, &application, &Schedule::new(&[Rc], 3, 1)).unwrap();
    assert_eq!(results.results.rc.as_ref().unwrap().samples_ms.len(), 3);
}

#[test]
fn a_start_in_a_configuration_that_the_arm_does_not_have_is_refused_with_frame_and_bits() {
    let setup = setup::setup("A").unwrap();
    let refused = whole(&setup, &with_elbow(4), &Schedule::new(&[Rc], 1, 1)).unwrap_err();
    insta::assert_snapshot!(refused, @"application pick-and-place: start: the arm cannot stand at frame `home`: the configuration has status 4, this arm has only the bits of 2; clear the others; change that frame, or base 1 in the setup");
}

#[test]
fn gripping_and_releasing_take_their_waits_and_for_cm_two_more_skill_calls() {
    let (measured, planned) = (run("pick-and-place"), run("pick-and-place-gripper"));
    let more = |execution_type| aet(&planned, execution_type) - aet(&measured, execution_type);
    // 150 ms to grip and 100 ms to release, each rounded to the robot's cycle; a stop does not make a junction
    // faster.
    assert!((250.0..275.0).contains(&more(Rc)), "RC takes {} ms more", more(Rc));
    let (setup, _) = planning::setup_with_application("A").unwrap();
    let overhead_ms = f64::from(setup.robot.skill_overhead_us.value) / 1e3;
    let calls = more(Cm) - 250.0;
    assert!((2.0 * overhead_ms..2.0 * overhead_ms + 80.0).contains(&calls), "CM's calls take {calls} ms");
    // Thirteen calls meet the interpreter at thirteen phases, so the mean of two runs deviates by up to 30 ms.
    assert!((220.0..290.0).contains(&more(Sm)), "SM takes {} ms more", more(Sm));
}
