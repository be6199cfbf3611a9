//! Cells with several stations on the real rig.

use std::io::{BufRead as _, BufReader, Write as _};
use std::net::TcpStream;
use std::process::{Command, Stdio};

use rustix::process::{Signal, kill_process};

use crate::process::{Bench, networks};

pub(crate) fn a_cell_runs_on_a_switch_or_on_cables_and_every_node_has_a_capture() {
    let captures = ["plc-left.pcapng", "plc-right.pcapng", "robot-left.pcapng", "robot-right.pcapng"];
    let place = tempfile::tempdir().unwrap();
    for setup in ["E", "F", &line(place.path())] {
        let args = ["--reps", "1", "--types", "rc,cm", "--capture", "always"];
        let ended = Bench::start_setup(setup, &args).wait();
        assert!(ended.status.success(), "{setup}: {}: {}", ended.status, ended.stderr);
        // A line of each station.
        assert_eq!(ended.samples.lines().count(), 1 + 4, "{}", ended.samples);
        let (results, mut found) = (&ended.results, ended.captures.clone());
        assert_eq!((&results["mode"], &results["status"]), (&"real".into(), &"complete".into()));
        assert_eq!(results["cyclic_allocations"], serde_json::json!({ "plc": 0, "robots": [0, 0] }));
        assert!(results["results"]["cm"]["relative_pose_mm"][0].is_f64(), "{}", results["results"]["cm"]);
        let has = |name: &str| ended.files.iter().any(|file| file == name);
        assert!(has("race.html") && has("trace-robot-left.csv") && has("trace-robot-right.csv"));
        assert!(has("trace-plc-left.csv") && has("trace-plc-right.csv"));
        assert!(!ended.files.iter().any(|file| file.ends_with(".rows")), "{:?}", ended.files);
        for station in results["stations"].as_array().unwrap() {
            assert!(station["frames"]["frames_received"].as_u64().unwrap() > 1_000, "{station}");
        }
        found.sort();
        assert!(found.iter().all(|(_, bytes)| bytes.len() > 100_000));
        assert_eq!(found.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>(), captures);
    }
}

/// Writes Setup F with both of its robots on EtherCAT, in line, and returns its path.
fn line(directory: &std::path::Path) -> String {
    let both =
        include_str!("../../../cell/setups/F.toml").replacen("kind = \"profinet\"", "kind = \"ethercat\"", 1);
    let path = directory.join("line.toml");
    std::fs::write(&path, both).unwrap();
    path.to_str().unwrap().to_owned()
}

pub(crate) fn a_cut_between_two_robots_in_line_loses_the_second_one_and_it_is_named() {
    let place = tempfile::tempdir().unwrap();
    let ended =
        Bench::start_setup(&line(place.path()), &["--reps", "50", "--fault", "right/cut-at=3s..600s"]).wait();
    assert_eq!(ended.status.code(), Some(4), "{}", ended.stderr);
    let said = &ended.stderr;
    assert!(said.contains("station right") && !said.contains("station left"), "{said}");
}

pub(crate) fn the_time_before_a_shared_zone_and_every_scan_of_each_station_are_in_a_real_run() {
    let ended = Bench::start_setup("G", &["--reps", "1"]).wait();
    assert!(ended.status.success(), "{}: {}", ended.status, ended.stderr);
    let stations = &ended.results["results"]["cm"]["stations"];
    let waited = |station: usize| stations[station]["zone_waiting_ms"][0].as_f64().unwrap();
    assert!(waited(0) + waited(1) > 100.0, "{stations}");
    assert!(ended.stdout.contains("left zones ms"), "{}", ended.stdout);
}

pub(crate) fn a_cell_with_a_lossy_cable_to_one_station_passes_and_counts_what_was_lost() {
    let fault = "right/to-robot:loss=0.02";
    let ended = Bench::start_setup("E", &["--reps", "1", "--fault", fault]).wait();
    assert!(ended.status.success(), "{}: {}", ended.status, ended.stderr);
    let faults = &ended.results["faults"];
    assert_eq!(faults["asked"], serde_json::json!([fault]));
    assert!(faults["lost"].as_u64().unwrap() > 20, "{faults}");
}

pub(crate) fn a_killed_robot_of_a_cell_fails_the_run_and_its_station_is_named() {
    let mut bench = Bench::start_setup("E", &["--reps", "1000"]);
    let right = bench.node_of_station("right");
    kill_process(right, Signal::KILL).unwrap();
    let ended = bench.wait();
    assert_eq!(ended.status.code(), Some(4), "{}", ended.stderr);
    let named = "the robot-node of station right ended (signal: 9 (SIGKILL))";
    assert!(ended.stderr.contains(named), "{}", ended.stderr);
    assert!(ended.samples.lines().count() > 2, "the samples so far are gone");
}

pub(crate) fn a_closed_terminal_ends_a_cell_in_order_and_keeps_the_repetitions() {
    let mut bench = Bench::start_setup("E", &["--reps", "1000"]);
    let networks = networks(bench.nodes());
    kill_process(bench.pid(), Signal::HUP).unwrap();
    let ended = bench.wait();
    assert_eq!(ended.status.code(), Some(130), "{}", ended.stderr);
    assert_eq!(ended.results["status"], "interrupted");
    assert!(ended.stdout.contains("Interrupted, ") && ended.samples.lines().count() > 2, "{}", ended.stdout);
    ended.nothing_is_left(&networks);
}

pub(crate) fn the_live_view_of_a_cell_shows_both_arms_their_marks_and_the_figures_of_every_node() {
    let place = tempfile::tempdir().unwrap();
    let mut bench = Command::new(env!("CARGO_BIN_EXE_bench"))
        .args(["--setup", "E", "--types", "cm", "--reps", "1", "--live", "127.0.0.1:0", "--out"])
        .arg(place.path().join("run"))
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut said = BufReader::new(bench.stderr.take().unwrap()).lines().map_while(Result::ok);
    let host =
        said.find_map(|line| Some(line.strip_prefix("Live at http://")?.trim_end_matches('/').to_owned()));
    let host = host.unwrap();
    // A full pipe would hold the bench up.
    let said = std::thread::spawn(move || said.collect::<Vec<_>>());
    let get = |path: &str| {
        let mut stream = TcpStream::connect(&host).unwrap();
        write!(stream, "GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n").unwrap();
        BufReader::new(stream).lines().map_while(Result::ok)
    };
    let page: Vec<_> = get("/").collect();
    let has = |text: &str| page.iter().any(|line| line.contains(text));
    assert!(has("data-station=\"left\"") && has("data-station=\"right\"") && has("hand-over"), "{page:?}");
    assert!(has("Robot left") && has("Robot right") && has("\"marks\":[1,2,3,4]"), "{page:?}");
    // The events end with the run.
    let parts: Vec<serde_json::Value> =
        get("/events").filter_map(|line| serde_json::from_str(line.strip_prefix("data: ")?).ok()).collect();
    assert!(bench.wait().unwrap().success(), "{:?}", said.join().unwrap());
    let frames: Vec<_> = parts.iter().filter_map(|part| part["frames"].as_array()).flatten().collect();
    for (arm, axes) in [(0, 4), (1, 6)] {
        let of_arm = || frames.iter().filter(|frame| frame["arm"].as_u64().unwrap_or(0) == arm);
        assert!(of_arm().all(|frame| frame["joints"].as_array().unwrap().len() == axes));
        let moves = of_arm().filter(|frame| frame["speed_mm_s"].as_f64().unwrap() > 1.0).count();
        assert!(moves > 20, "arm {arm}: {moves} frames");
        let marks = |of: usize| of_arm().filter_map(|frame| frame["marks"][of].as_u64()).max();
        assert_eq!([marks(0), marks(1)], [Some(4); 2], "arm {arm}");
    }
    // One of the arms comes to a mark first, and waits there.
    assert!(frames.iter().any(|frame| frame["marks"][0].as_u64() > frame["marks"][1].as_u64()));
    for node in ["plc", "robot-0", "robot-1"] {
        assert!(parts.iter().any(|part| part["nodes"][node]["summary"].is_string()), "{node}");
    }
    let [.., last, report] = parts.as_slice() else { panic!("{parts:?}") };
    assert!(report["report"]["page"].as_str().unwrap().contains("hand-over"), "{report}");
    assert!(report["report"]["race"].as_str().unwrap().contains("CM left"), "{report}");
    assert_eq!(last["table"]["rows"][0]["cells"][0], "1 of 1");
    assert!(last["ended"]["text"].as_str().unwrap().starts_with("Done: 1 repetition,"), "{last}");
}
