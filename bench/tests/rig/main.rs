//! The rig in real time on real sockets: what the bench leaves behind, and how soon it notices an error.

#![expect(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test fails by panicking")]

mod cells;
mod device_file;
mod process;

use std::fs;
use std::io::{BufRead as _, BufReader};
use std::os::unix::process::ExitStatusExt as _;
use std::process::{Command, ExitCode, Stdio};
use std::thread;
use std::time::Duration;

use pcap_file::pcapng::blocks::enhanced_packet::EnhancedPacketOption;
use pcap_file::pcapng::{Block, PcapNgReader};
use process::{Bench, Ended, networks, patient};
use rustix::process::{Pid, Signal, kill_process};

fn main() -> ExitCode {
    networked_tests::run(networked_tests::tests![
        a_run_over_either_cyclic_transport_passes,
        a_run_of_setup_b_passes_and_loses_no_frame,
        a_run_of_setup_c_passes_and_loses_no_frame,
        exported_code_runs_on_every_bus_in_the_place_of_the_function_blocks,
        compact_points_are_driven_in_a_real_run_on_every_bus,
        device_file::a_foreign_device_of_a_file_carries_the_image_in_a_real_run_on_every_bus,
        a_killed_node_fails_the_run_at_once_and_is_named,
        a_node_that_hangs_fails_the_run,
        nodes_that_both_hang_fail_the_run_and_are_named_with_what_they_sent_last,
        a_plc_that_is_stopped_before_it_is_connected_is_named,
        a_repetition_is_run_again_if_the_host_stalled_a_node_until_the_connection_was_lost,
        a_repetition_in_which_the_host_stalled_a_node_is_marked,
        ctrl_c_and_sigterm_end_everything_and_keep_the_samples,
        even_a_killed_bench_leaves_nothing_behind,
        a_real_timeline_has_the_frames_of_both_ends_without_an_unrequested_capture,
        a_run_during_which_utc_steps_by_hours_is_as_any_other,
        a_real_cable_makes_the_requested_faults_and_each_is_commented_and_counted,
        a_cut_and_a_killed_node_are_comments_at_the_next_frames_of_a_real_capture,
        a_plc_that_a_fault_killed_is_named_with_that_fault,
        cells::a_cell_runs_on_a_switch_or_on_cables_and_every_node_has_a_capture,
        cells::a_cut_between_two_robots_in_line_loses_the_second_one_and_it_is_named,
        cells::the_time_before_a_shared_zone_and_every_scan_of_each_station_are_in_a_real_run,
        cells::a_cell_with_a_lossy_cable_to_one_station_passes_and_counts_what_was_lost,
        cells::a_killed_robot_of_a_cell_fails_the_run_and_its_station_is_named,
        cells::the_live_view_of_a_cell_shows_both_arms_their_marks_and_the_figures_of_every_node,
        cells::a_closed_terminal_ends_a_cell_in_order_and_keeps_the_repetitions,
        a_run_of_setup_b_survives_a_lossy_real_cable,
        the_cost_of_recording_is_printed_for_both_nodes_and_the_recordings_are_kept,
        an_interrupted_measurement_of_the_cost_of_recording_prints_the_pairs_so_far,
    ])
}

fn a_run_over_either_cyclic_transport_passes() {
    for cyclic in ["udp", "rt1"] {
        let ended = Bench::start_patient("A", &["--reps", "1", "--cyclic", cyclic]).wait();
        assert!(ended.status.success(), "{cyclic}: {}: {}", ended.status, ended.stderr);
        assert_eq!(ended.samples.lines().count(), 2);
    }
}

fn exported_code_runs_on_every_bus_in_the_place_of_the_function_blocks() {
    for setup in ["A", "B", "C"] {
        let directory = tempfile::tempdir().unwrap();
        let (parts, found) = planning::setup_with_application(setup).unwrap();
        let plan = found.plan(&parts).unwrap();
        let kit = directory.path().join("kit");
        plc_export::export(
            &plc_node::PlcConfig::of_plan(&parts, &plan).exported(true),
            plc_export::Maker::St,
            &kit,
        )
        .unwrap();
        let kit = kit.to_str().unwrap();
        let ended = Bench::start_patient(setup, &["--reps", "1", "--plc-program", kit]).wait();
        assert!(ended.status.success(), "{setup}: {}: {}", ended.status, ended.stderr);
        assert_eq!(ended.samples.lines().count(), 2);
    }
}

fn compact_points_are_driven_in_a_real_run_on_every_bus() {
    for setup in ["A", "B", "C"] {
        let ended = Bench::start_with_compact_points(setup, &["--types", "cm", "--reps", "2"]).wait();
        assert!(ended.status.success(), "{setup}: {}: {}", ended.status, ended.stderr);
        assert_eq!(ended.samples.lines().count(), 3);
        assert_eq!(ended.most_accepted_in_a_cycle(), 10, "{setup}");
    }
}

/// EtherNet/IP between two processes. If the host stalls, cycles are skipped, and both sides report it; every sent
/// frame must arrive.
fn a_run_of_setup_b_passes_and_loses_no_frame() {
    let ended = Bench::start_patient("B", &["--reps", "1"]).wait();
    assert!(ended.status.success(), "{}: {}", ended.status, ended.stderr);
    assert_eq!(ended.samples.lines().count(), 2);
    let bus = &ended.results["bus"];
    // If the host breaks the connection, frames in flight are lost with it.
    assert!(bus["lost"] == 0 || ended.results["repeated"] != 0, "{bus}");
    let [sent, received] = ["frames_sent", "frames_received"].map(|key| bus[key].as_u64().unwrap());
    assert!(sent > 500 && received > sent * 9 / 10, "{bus}");
    let allocations = &ended.results["cyclic_allocations"];
    assert_eq!((&allocations["plc"], &allocations["robot"]), (&0.into(), &0.into()));
}

/// EtherCAT between two processes, over raw Ethernet. Each frame that the PLC sends comes back.
fn a_run_of_setup_c_passes_and_loses_no_frame() {
    let ended = Bench::start_patient("C", &["--reps", "1"]).wait();
    assert!(ended.status.success(), "{}: {}", ended.status, ended.stderr);
    assert_eq!(ended.samples.lines().count(), 2);
    let bus = &ended.results["bus"];
    let [sent, received, lost] =
        ["frames_sent", "frames_received", "lost"].map(|key| bus[key].as_u64().unwrap());
    // A host that stalls the robot for longer than a frame's time costs that frame, and the cycles meanwhile.
    assert!(sent > 500 && received > sent * 9 / 10 && lost < sent / 10, "{bus}");
    let allocations = &ended.results["cyclic_allocations"];
    assert_eq!((&allocations["plc"], &allocations["robot"]), (&0.into(), &0.into()));
}

fn a_killed_node_fails_the_run_at_once_and_is_named() {
    for (index, name) in [(0, "plc-node"), (1, "robot-node")] {
        let mut bench = Bench::start(&["--reps", "1000"]);
        let nodes = bench.nodes();
        let networks = networks(nodes);
        kill_process(nodes[index], Signal::KILL).unwrap();
        let ended = bench.wait();
        assert_eq!(ended.status.code(), Some(4), "{}", ended.stderr);
        ended.at_once();
        assert!(
            ended.stderr.contains(&format!("the {name} ended (signal: 9 (SIGKILL))")),
            "{}",
            ended.stderr
        );
        assert!(ended.samples.lines().count() > 1, "the samples so far are gone");
        ended.nothing_is_left(&networks);
    }
}

fn a_node_that_hangs_fails_the_run() {
    for index in [0, 1] {
        let mut bench = Bench::start(&["--reps", "1000"]);
        let nodes = bench.nodes();
        let networks = networks(nodes);
        kill_process(nodes[index], Signal::STOP).unwrap();
        let ended = bench.wait();
        assert_eq!(ended.status.code(), Some(4), "{}", ended.stderr);
        ended.at_once();
        // Any of these may be noticed first.
        let reasons = ["was lost", "life counter stood still", "its node stands still"];
        assert!(reasons.iter().any(|reason| ended.stderr.contains(reason)), "{}", ended.stderr);
        ended.nothing_is_left(&networks);
    }
}

/// Nobody is left to report anything: only the silence shows it.
fn nodes_that_both_hang_fail_the_run_and_are_named_with_what_they_sent_last() {
    let mut bench = Bench::start(&["--reps", "1000"]);
    let nodes = bench.nodes();
    let networks = networks(nodes);
    for node in nodes {
        kill_process(node, Signal::STOP).unwrap();
    }
    let ended = bench.wait();
    assert_eq!(ended.status.code(), Some(4), "{}", ended.stderr);
    for name in ["plc-node", "robot-node"] {
        let said = format!("the {name} has sent nothing for ");
        assert!(ended.stderr.contains(&said) && ended.stderr.contains(", after `"), "{}", ended.stderr);
    }
    ended.nothing_is_left(&networks);
}

fn a_plc_that_is_stopped_before_it_is_connected_is_named() {
    let mut bench = Bench::start(&["--reps", "1"]);
    let plc = bench.starting("__plc-node");
    kill_process(plc, Signal::STOP).unwrap();
    let ended = bench.wait();
    assert_eq!(ended.status.code(), Some(5), "{}", ended.stderr);
    assert!(ended.stderr.contains("the plc-node has "), "{}", ended.stderr);
    assert!(ended.stderr.contains("a process or its host is stopped"), "{}", ended.stderr);
}

/// The host breaks the connection, while both nodes are correct: this must not fail the run.
fn a_repetition_is_run_again_if_the_host_stalled_a_node_until_the_connection_was_lost() {
    let hold_up = |index: usize| {
        let mut bench = Bench::start(&["--reps", "2"]);
        let nodes = bench.nodes();
        kill_process(nodes[index], Signal::STOP).unwrap();
        // Longer than the watchdog, and shorter than the wait for a hanging node.
        thread::sleep(Duration::from_millis(900));
        kill_process(nodes[index], Signal::CONT).unwrap();
        let ended = bench.wait();
        assert!(ended.status.success(), "{}: {}", ended.status, ended.stderr);
        assert_eq!(ended.samples.lines().count(), 3, "{}", ended.samples);
        ended
    };
    for (index, name) in [(0, "plc-node"), (1, "robot-node")] {
        let expected = format!("the host stopped the {name} for ");
        // If the host also stalls the other node at that moment, its watchdog does not see the stall, or the other
        // node is reported instead.
        let mut tries = (0..3).map(|_| hold_up(index));
        let ended =
            tries.find(|ended| ended.stderr.contains(&expected)).expect("a try in which it is expected");
        assert!(ended.stderr.contains("warning: run again, cm 2: "), "{}", ended.stderr);
        assert!(ended.results["repeated"].as_u64() >= Some(1), "{}", ended.results["repeated"]);
    }
}

/// The connection survives the stall, and the repetition ends as it should: nothing but the node's cycles shows it.
fn a_repetition_in_which_the_host_stalled_a_node_is_marked() {
    for (index, role) in [(0, "plc"), (1, "robot")] {
        let mut bench = Bench::start_patient("A", &["--reps", "2"]);
        let nodes = bench.nodes();
        // Longer than the pause before the second repetition.
        thread::sleep(Duration::from_millis(800));
        kill_process(nodes[index], Signal::STOP).unwrap();
        thread::sleep(Duration::from_millis(300));
        kill_process(nodes[index], Signal::CONT).unwrap();
        let ended = bench.wait();
        assert!(ended.status.success(), "{}: {}", ended.status, ended.stderr);
        let missed = &ended.results["results"]["cm"]["missed_cycles"][1];
        assert!(missed[role].as_u64() >= Some(50) && missed["held_up"] == true, "{missed}");
        assert!(ended.stdout.contains("cm 2 (PLC "), "{}", ended.stdout);
    }
}

fn ctrl_c_and_sigterm_end_everything_and_keep_the_samples() {
    for signal in [Signal::INT, Signal::TERM] {
        let mut bench = Bench::start(&["--reps", "1000"]);
        let networks = networks(bench.nodes());
        kill_process(bench.pid(), signal).unwrap();
        let ended = bench.wait();
        assert_eq!(ended.status.code(), Some(130), "{}", ended.stderr);
        ended.at_once();
        let saved = ended.samples.lines().count() - 1;
        assert!(saved > 0, "the samples so far are gone");
        let expected = format!("Interrupted, {saved} of 1000 repetitions saved in ");
        assert!(ended.stdout.contains(&expected), "{}", ended.stdout);
        ended.nothing_is_left(&networks);
    }
}

fn even_a_killed_bench_leaves_nothing_behind() {
    let mut bench = Bench::start(&["--reps", "1000"]);
    let networks = networks(bench.nodes());
    kill_process(bench.pid(), Signal::KILL).unwrap();
    let ended = bench.wait();
    assert_eq!(ended.status.signal(), Some(9));
    ended.nothing_is_left(&networks);
}

/// Returns the frames of one track of a timeline: when each passed, in µs, and whether the cable impaired it.
fn frames(timeline: &serde_json::Value, track: u64) -> Vec<(f64, bool)> {
    let events = timeline["traceEvents"].as_array().unwrap().iter();
    let frames = events.filter(|event| event["ph"] == "i" && event["pid"] == 4 && event["tid"] == track);
    frames.map(|event| (event["ts"].as_f64().unwrap(), event["args"]["fault"] == true)).collect()
}

fn a_real_timeline_has_the_frames_of_both_ends_without_an_unrequested_capture() {
    let ended = Bench::start_patient("A", &["--reps", "1", "--trace"]).wait();
    assert!(ended.status.success(), "{}: {}", ended.status, ended.stderr);
    let run_ms = ended.results["results"]["cm"]["samples_ms"][0].as_f64().unwrap();
    let [plc_sends, robot_receives, robot_sends, plc_receives] =
        [1, 2, 3, 4].map(|track| frames(&ended.timeline, track));
    let sent_at_all = ended.results["bus"]["frames_sent"].as_u64().unwrap();
    for (sent, received) in [(&plc_sends, &robot_receives), (&robot_sends, &plc_receives)] {
        // The connection exists hardly longer than the run.
        assert!(sent.len() as u64 > sent_at_all / 2, "{} of {sent_at_all} frames", sent.len());
        assert!(sent.iter().chain(received).all(|(at, _)| (0.0..=run_ms * 1e3).contains(at)));
        assert!(sent.is_sorted() && received.is_sorted(), "a track runs backwards");
        // A frame may pass one end just before the run and the other end in it, and the other way round.
        assert!(sent.len().abs_diff(received.len()) <= 2, "{} sent, {} received", sent.len(), received.len());
    }
    assert!(!ended.files.iter().any(|file| file.ends_with(".pcapng")), "{:?}", ended.files);
}

/// Returns the comments in the capture of one end, at the frames that it sent or at those that it received.
fn comments(ended: &Ended, file: &str, sent: bool) -> Vec<String> {
    let bytes = &ended.captures.iter().find(|(name, _)| name == file).expect("a capture").1;
    let mut reader = PcapNgReader::new(&bytes[..]).unwrap();
    let mut comments = Vec::new();
    while let Some(block) = reader.next_block() {
        let Block::EnhancedPacket(packet) = block.unwrap() else { continue };
        let is_sent = packet.options.iter().any(|option| matches!(option, EnhancedPacketOption::Flags(2)));
        comments.extend(packet.options.iter().filter_map(|option| match option {
            EnhancedPacketOption::Comment(comment) if is_sent == sent => Some(comment.to_string()),
            _ => None,
        }));
    }
    comments
}

/// Returns the stamps in the capture of one end, in the order of the capture.
fn stamps(ended: &Ended, file: &str) -> Vec<Duration> {
    let bytes = &ended.captures.iter().find(|(name, _)| name == file).expect("a capture").1;
    let mut reader = PcapNgReader::new(&bytes[..]).unwrap();
    let mut stamps = Vec::new();
    while let Some(block) = reader.next_block() {
        if let Block::EnhancedPacket(packet) = block.unwrap() {
            stamps.push(packet.timestamp);
        }
    }
    stamps
}

/// The clock is replaced in the bench and in both nodes: each reading of UTC is 3 h ahead, right, or 5 h behind. The kernel's
/// stamps of frames stay right.
fn a_run_during_which_utc_steps_by_hours_is_as_any_other() {
    for (fault, is_impaired) in [(&[][..], false), (&["--fault", "duplicate=0.001"][..], true)] {
        let args = [&["--reps", "1", "--capture", "always", "--trace"], fault].concat();
        let ended = Bench::start_with_a_stepping_clock("A", &args).wait();
        assert!(ended.status.success(), "{}: {}", ended.status, ended.stderr);
        // Passed means: verified against the plan, by the clocks of both nodes.
        assert_eq!(ended.samples.lines().count(), 2);
        let run_ms = ended.results["results"]["cm"]["samples_ms"][0].as_f64().unwrap();
        assert!((1_000.0..60_000.0).contains(&run_ms), "{run_ms} ms");
        // The timeline has no frame that is hours away, and lacks none.
        let sent_at_all = ended.results["bus"]["frames_sent"].as_u64().unwrap();
        for track in 1..=4 {
            let frames = frames(&ended.timeline, track);
            assert!(frames.len() as u64 > sent_at_all / 2, "{} of {sent_at_all} frames", frames.len());
            assert!(frames.iter().all(|(at, _)| (0.0..=run_ms * 1e3).contains(at)));
        }
        // An impaired cable stamps what it delivers itself: there the steps are seen.
        let stamps = stamps(&ended, "robot.pcapng");
        let (first, last) = (stamps.iter().min().unwrap(), stamps.iter().max().unwrap());
        assert_eq!(*last - *first > Duration::from_secs(7 * 3_600), is_impaired, "{first:?} to {last:?}");
    }
}

/// Returns the cyclic frames of both directions, counted by the PLC.
fn passed(bus: &serde_json::Value) -> u64 {
    ["frames_sent", "frames_received"].iter().map(|frames| bus[frames].as_u64().unwrap()).sum()
}

fn a_real_cable_makes_the_requested_faults_and_each_is_commented_and_counted() {
    let mut args = vec!["--reps", "1", "--capture", "always", "--trace"];
    for fault in ["loss=0.01", "to-plc:duplicate=0.02", "to-robot:reorder=0.01@3ms"] {
        args.extend(["--fault", fault]);
    }
    let ended = Bench::start_patient("A", &args).wait();
    assert!(ended.status.success(), "{}: {}", ended.status, ended.stderr);
    let (plc, robot) = (comments(&ended, "plc.pcapng", true), comments(&ended, "robot.pcapng", true));
    let count =
        |comments: &[String], text: &str| comments.iter().filter(|comment| comment.contains(text)).count();
    let faults = &ended.results["faults"];
    assert_eq!((count(&plc, "lost") + count(&robot, "lost")) as u64, faults["lost"]);
    assert_eq!(
        (count(&plc, "twice") as u64, faults["duplicated"].as_u64()),
        (0, Some(count(&robot, "twice") as u64))
    );
    let held = count(&plc, "held back by 3ms") as u64;
    assert_eq!((count(&robot, "held back"), faults["reordered"].as_u64()), (0, Some(held)));
    // Each fault hits one frame in a hundred or two on average; at least a fifth of that is practically certain.
    let bus = &ended.results["bus"];
    let passed = passed(bus);
    for fault in ["lost", "duplicated", "reordered"] {
        assert!(faults[fault].as_u64() > Some(passed / 1_000), "{fault} of {passed}: {faults}");
    }
    // The nodes count what the cable lost.
    assert!(bus["lost"].as_u64() > Some(passed / 1_000), "{bus}");
    assert!(frames(&ended.timeline, 1).iter().any(|(_, faulty)| *faulty));
}

fn a_cut_and_a_killed_node_are_comments_at_the_next_frames_of_a_real_capture() {
    let faults = ["--fault", "cut-at=500ms..1s", "--fault", "kill-robot-at=1500ms"];
    let ended =
        Bench::start_patient("A", &[&["--reps", "9", "--capture", "on-failure"], &faults[..]].concat())
            .wait();
    assert_eq!(ended.status.code(), Some(4), "{}", ended.stderr);
    let expected = "the robot-node was killed by this run's fault `kill-robot-at`";
    assert!(ended.stderr.contains(expected), "{}", ended.stderr);
    let comments = [true, false].map(|sent| comments(&ended, "plc.pcapng", sent).join("\n")).join("\n");
    for text in [
        "the cable is cut from here on",
        "lost, the cable is cut",
        "the cable is mended",
        "the robot is killed",
    ] {
        assert!(comments.contains(text), "{text} is not among: {comments}");
    }
}

fn a_plc_that_a_fault_killed_is_named_with_that_fault() {
    let ended = Bench::start_patient("A", &["--reps", "9", "--fault", "kill-plc-at=500ms"]).wait();
    assert_eq!(ended.status.code(), Some(4), "{}", ended.stderr);
    let expected = "the plc-node was killed by this run's fault `kill-plc-at`";
    assert!(ended.stderr.contains(expected), "{}", ended.stderr);
}

/// EtherNet/IP also uses TCP connections on the same cable: lost segments are retransmitted.
fn a_run_of_setup_b_survives_a_lossy_real_cable() {
    let ended = Bench::start_patient("B", &["--reps", "1", "--fault", "loss=0.02"]).wait();
    assert!(ended.status.success(), "{}: {}", ended.status, ended.stderr);
    // At least a quarter of the expected number is practically certain.
    let lost = ended.results["faults"]["lost"].as_u64().unwrap();
    assert!(lost * 200 > passed(&ended.results["bus"]), "{lost} lost: {}", ended.results["bus"]);
}

fn the_cost_of_recording_is_printed_for_both_nodes_and_the_recordings_are_kept() {
    let place = tempfile::tempdir().unwrap();
    let ended = Command::new(env!("CARGO_BIN_EXE_bench"))
        .args(["overhead", "--pairs", "5", "--setup"])
        .arg(patient("A", place.path()))
        .arg("--out")
        .arg(place.path())
        .output()
        .unwrap();
    let said = String::from_utf8(ended.stdout).unwrap();
    assert!(said.starts_with("Setup A, seconds of cm in pairs: 5; limit +5 %"), "{said}");
    for node in ["\n  PLC    ", "\n  robot  "] {
        assert!(said.contains(node), "{said}");
    }
    // The cost depends on the host; the exit code and the text must agree.
    assert_eq!(ended.status.code(), Some(if said.contains("; fail") { 3 } else { 0 }), "{said}");
    let length = |file| fs::metadata(place.path().join(file)).unwrap().len();
    for file in ["plc.pcapng", "robot.pcapng"] {
        // Recorded half of the time: all of it would be 12 MB.
        assert!((50_000..9_000_000).contains(&length(file)), "{file} has {} bytes", length(file));
    }
    assert!(length("trace-plc.rows") > 5_000 && length("trace-robot.rows") > 5_000);
}

fn an_interrupted_measurement_of_the_cost_of_recording_prints_the_pairs_so_far() {
    let place = tempfile::tempdir().unwrap();
    let mut bench = Command::new(env!("CARGO_BIN_EXE_bench"))
        .args(["overhead", "--pairs", "1000", "--setup"])
        .arg(patient("A", place.path()))
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut progress = BufReader::new(bench.stderr.take().unwrap()).lines().map(Result::unwrap);
    let first = progress.find(|line| line.contains(" pairs, "));
    assert_eq!(first.as_deref(), Some("1 of 1000 pairs, 2197 s left"));
    kill_process(Pid::from_child(&bench), Signal::INT).unwrap();
    let ended = bench.wait_with_output().unwrap();
    assert_eq!(ended.status.code(), Some(130));
    let said = String::from_utf8(ended.stdout).unwrap();
    assert!(said.starts_with("Setup A, seconds of cm in pairs: "), "{said}");
    assert!(!said.contains("in pairs: 0"), "{said}");
    // The pair counts in the medians, or it was left out because the host ran others meanwhile.
    assert!(said.contains("µs recorded") || said.contains("of the pairs are left out"), "{said}");
}
