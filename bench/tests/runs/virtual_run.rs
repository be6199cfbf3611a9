//! The run command in virtual mode: the same bytes for the same seed, and physically plausible figures.

use planning::Application;
use plc_node::ExecutionType;
use records::results::{PerType, Results};
use records::schedule::Schedule;
use setup::{BusKind, Ethercat, EthernetIp, Setup};
use stands::virtual_run::whole;

use crate::program::bench;

fn setup_a() -> (Setup, Application) {
    let (setup, found) = planning::setup_with_application("A").unwrap();
    (setup, found.application)
}

fn run(seed: u64, reps: u32) -> Results {
    let (setup, application) = setup_a();
    whole(&setup, &application, &Schedule::new(&ExecutionType::ALL, reps, seed)).unwrap()
}

#[test]
fn two_runs_of_one_seed_give_the_same_bytes_and_another_seed_gives_others() {
    let [first, again, other] = [1, 1, 2].map(|seed| run(seed, 3).to_json().unwrap());
    assert_eq!(first, again);
    let other: Results = serde_json::from_str(&other).unwrap();
    let first: Results = serde_json::from_str(&first).unwrap();
    assert_ne!(first.results, other.results);
}

#[test]
fn setup_a_reproduces_the_calibrated_figures_and_predicts_that_cm_equals_rc() {
    let results = run(1, 25);
    let aet = |execution_type| results.figure(execution_type).unwrap().aet_ms;
    let (rc, sm, cm) = (aet(ExecutionType::Rc), aet(ExecutionType::Sm), aet(ExecutionType::Cm));
    assert!((rc / 3725.0 - 1.0).abs() < 0.01, "RC {rc} ms");
    assert!((sm / 6477.0 - 1.0).abs() < 0.03, "SM {sm} ms");
    let improvement = results.aet_improvement.unwrap();
    assert!((improvement - 0.42).abs() <= 0.01, "AETi {improvement}, published 42 %");
    assert!((cm - rc).abs() <= 12.0, "CM − RC = {} ms", cm - rc);
    assert_eq!(results.bus.lost, 0);
    let PerType { rc: Some(rc), .. } = &results.results else { panic!("RC is there") };
    assert!(rc.samples_ms.iter().zip(&rc.robot_samples_ms).all(|(plc, robot)| plc >= robot));
}

#[test]
fn setup_b_reproduces_the_calibrated_figures_and_predicts_that_cm_equals_rc() {
    let (setup, found) = planning::setup_with_application("B").unwrap();
    let results = whole(&setup, &found.application, &Schedule::new(&ExecutionType::ALL, 25, 1)).unwrap();
    let aet = |execution_type| results.figure(execution_type).unwrap().aet_ms;
    let (rc, sm, cm) = (aet(ExecutionType::Rc), aet(ExecutionType::Sm), aet(ExecutionType::Cm));
    assert!((rc / 7617.0 - 1.0).abs() < 0.01, "RC {rc} ms");
    assert!((sm / 8971.0 - 1.0).abs() < 0.03, "SM {sm} ms");
    let improvement = results.aet_improvement.unwrap();
    assert!((improvement - 0.15).abs() <= 0.01, "AETi {improvement}, published 15 %");
    assert!((cm - rc).abs() <= 12.0, "CM − RC = {} ms", cm - rc);
    assert_eq!(results.bus.lost, 0);
    let suppressed = ExecutionType::ALL
        .map(|execution_type| results.results.get(execution_type).unwrap().blends_suppressed.clone());
    assert!(suppressed.iter().flatten().all(|count| *count == 0), "{suppressed:?}");
}

#[test]
fn without_its_calibrated_overhead_a_single_skill_still_costs_more_than_a_blend() {
    let (mut setup, application) = setup_a();
    setup.robot.skill_overhead_us.value = 0;
    let results = whole(&setup, &application, &Schedule::new(&ExecutionType::ALL, 3, 1)).unwrap();
    let improvement = results.aet_improvement.unwrap();
    assert!((0.05..0.40).contains(&improvement), "AETi {improvement}");
}

#[test]
fn an_application_of_more_motions_than_slots_streams_without_a_suppressed_blend() {
    let results = run(3, 2);
    let suppressed = ExecutionType::ALL
        .map(|execution_type| results.results.get(execution_type).unwrap().blends_suppressed.clone());
    assert_eq!(suppressed, [vec![0, 0], vec![0, 0], vec![0, 0]]);
}

#[test]
fn over_every_bus_the_same_cell_takes_as_long() {
    let (mut setup, application) = setup_a();
    let schedule = Schedule::new(&ExecutionType::ALL, 3, 1);
    let profinet = whole(&setup, &application, &schedule).unwrap();
    let addresses = *setup.bus.addresses().unwrap();
    let others =
        [BusKind::EthernetIp(addresses, EthernetIp::default()), BusKind::Ethercat(Ethercat::default())];
    for kind in others {
        setup.bus.kind = kind;
        let other = whole(&setup, &application, &schedule).unwrap();
        for execution_type in ExecutionType::ALL {
            let aet = |results: &Results| results.figure(execution_type).unwrap().aet_ms;
            let apart = aet(&other) - aet(&profinet);
            // Within the robot's interpreter quantum: the cycles of the two buses have other phases.
            assert!(apart.abs() <= 12.0, "{execution_type} differs by {apart} ms");
        }
        assert_eq!(other.bus.lost, 0);
        assert!(other.bus.frames_received > 5_000, "{:?}", other.bus);
    }
}

#[test]
fn an_override_of_0_stops_every_type_on_its_path_and_a_higher_one_lets_it_go_on() {
    let (setup, application) = setup_a();
    let schedule = Schedule::new(&ExecutionType::ALL, 1, 1);
    let with = |overrides: &str| {
        let overrides = Some(overrides.parse().unwrap());
        whole(&setup, &application, &Schedule { overrides, ..schedule.clone() }).unwrap()
    };
    let (full, half, stopped) =
        (whole(&setup, &application, &schedule).unwrap(), with("50"), with("100,0@1s,100@3s"));
    for execution_type in ExecutionType::ALL {
        let aet = |results: &Results| results.figure(execution_type).unwrap().aet_ms;
        assert!(aet(&half) > aet(&full) + 200.0, "{execution_type}: {} and {} ms", aet(&half), aet(&full));
        // It stands for two seconds less what it takes to brake, and needs as long to be up to speed again. Between two
        // single motions it has nothing to brake.
        let longer = aet(&stopped) - aet(&full);
        assert!((1_850.0..2_150.0).contains(&longer), "{execution_type}: {longer} ms longer");
    }
    assert_eq!(stopped.overrides.as_deref(), Some("100,0@1s,100@3s"));
}

#[test]
fn a_quiet_run_prints_its_table_alone_and_leaves_out_the_parts_that_it_is_asked_to() {
    for setup in ["A", "F"] {
        let place = tempfile::tempdir().unwrap();
        let arguments = ["--setup", setup, "--mode", "virtual", "--reps", "1", "--quiet", "--out", "run"];
        let without = ["--without", "race,report", "traces"];
        let finished = bench(place.path(), arguments.into_iter().chain(without));
        assert_eq!((finished.code, finished.stderr.as_str()), (Some(0), ""));
        let lines = finished.stdout.lines().count();
        assert!(lines <= 12 && !finished.stdout.contains("Saved"), "{}", finished.stdout);
        let run = std::fs::read_dir(place.path().join("run")).unwrap();
        let files: Vec<_> = run.map(|file| file.unwrap().file_name().into_string().unwrap()).collect();
        for left_out in ["report.html", "race.html", "trace-"] {
            assert!(!files.iter().any(|name| name.starts_with(left_out)), "{files:?}");
        }
        assert!(files.contains(&"samples.csv".to_owned()) && files.contains(&"results.json".to_owned()));
    }
}
