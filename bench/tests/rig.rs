//! The rig on real time and real sockets: what the bench leaves behind, and how soon it notices what went wrong.
//!
//! These tests run the bench, which makes networks of its own: they need root or user namespaces and fail without.

#![expect(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test fails by panicking")]

use std::fs;
use std::io::Read as _;
use std::os::unix::process::ExitStatusExt as _;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use pcap_file::pcapng::blocks::enhanced_packet::EnhancedPacketOption;
use pcap_file::pcapng::{Block, PcapNgReader};
use rustix::process::{Pid, Signal, kill_process};

/// Real time wants the host for itself: one test at a time.
static HOST: Mutex<()> = Mutex::new(());

/// How soon the bench has to notice and end.
const NOTICE: Duration = Duration::from_secs(2);

/// For what has no limit of its own but must not hang the tests.
const PATIENCE: Duration = Duration::from_secs(60);

/// The bench on a run that would take hours.
struct Bench {
    child: Child,
    place: tempfile::TempDir,
    _host: MutexGuard<'static, ()>,
}

/// How it ended.
struct Ended {
    status: ExitStatus,
    after: Duration,
    stderr: String,
    samples: String,
    results: serde_json::Value,
    timeline: serde_json::Value,
    files: Vec<String>,
    captures: Vec<(String, Vec<u8>)>,
}

impl Bench {
    fn start(args: &[&str]) -> Self {
        Self::start_setup("A", args)
    }

    fn start_setup(setup: &str, args: &[&str]) -> Self {
        let host = HOST.lock().unwrap_or_else(PoisonError::into_inner);
        let place = tempfile::tempdir().unwrap();
        let child = Command::new(env!("CARGO_BIN_EXE_bench"))
            .args(["--setup", setup, "--types", "cm", "--out"])
            .arg(place.path().join("run"))
            .args(args)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        Self { child, place, _host: host }
    }

    /// Both nodes, PLC first, as soon as a run is under way: then the first repetition is saved.
    fn nodes(&mut self) -> [Pid; 2] {
        let samples = self.place.path().join("run/samples.csv");
        self.until("a repetition is saved", || {
            fs::read_to_string(&samples).is_ok_and(|samples| samples.lines().count() > 1)
        });
        ["__plc-node", "__robot-node"].map(|name| self.node(name).expect("a node that runs"))
    }

    fn node(&self, name: &str) -> Option<Pid> {
        let bench = self.child.id().to_string();
        let children = fs::read_to_string(format!("/proc/{bench}/task/{bench}/children")).ok()?;
        let named = |pid: &&str| {
            fs::read_to_string(format!("/proc/{pid}/cmdline")).is_ok_and(|line| line.contains(name))
        };
        let pid = children.split_whitespace().find(named)?;
        Pid::from_raw(pid.parse().ok()?)
    }

    fn pid(&self) -> Pid {
        Pid::from_child(&self.child)
    }

    fn until(&mut self, what: &str, mut done: impl FnMut() -> bool) {
        let start = Instant::now();
        while !done() {
            if let Some(status) = self.child.try_wait().unwrap() {
                let mut stderr = String::new();
                self.child.stderr.take().unwrap().read_to_string(&mut stderr).unwrap();
                panic!(
                    "the bench ended ({status}) before {what}: {stderr}\n(as an ordinary user it needs user namespaces)"
                );
            }
            assert!(start.elapsed() < PATIENCE, "not within {PATIENCE:?}: {what}");
            thread::sleep(Duration::from_millis(5));
        }
    }

    fn wait(mut self) -> Ended {
        let start = Instant::now();
        let status = self.child.wait().unwrap();
        let after = start.elapsed();
        let mut stderr = String::new();
        self.child.stderr.take().unwrap().read_to_string(&mut stderr).unwrap();
        let samples = fs::read_to_string(self.place.path().join("run/samples.csv")).unwrap_or_default();
        let json = |name| {
            let text = fs::read_to_string(self.place.path().join(name)).unwrap_or_default();
            serde_json::from_str(&text).unwrap_or_default()
        };
        let (results, timeline) = (json("run/results.json"), json("run/trace.json"));
        let entries = fs::read_dir(self.place.path().join("run")).map(|entries| entries.map(Result::unwrap));
        let files: Vec<_> =
            entries.into_iter().flatten().map(|entry| entry.file_name().into_string().unwrap()).collect();
        let captures = files.iter().filter(|name| name.ends_with(".pcapng"));
        let captures = captures
            .map(|name| (name.clone(), fs::read(self.place.path().join("run").join(name)).unwrap()))
            .collect();
        Ended { status, after, stderr, samples, results, timeline, files, captures }
    }
}

/// The network that a process is in.
fn network(pid: Pid) -> String {
    fs::read_link(format!("/proc/{pid}/ns/net")).unwrap().to_string_lossy().into_owned()
}

/// Neither the nodes nor anybody in their networks is left, so the networks and their interfaces are gone too.
fn nothing_is_left(networks: &[String]) {
    let start = Instant::now();
    loop {
        let left: Vec<_> = fs::read_dir("/proc")
            .unwrap()
            .filter_map(|entry| fs::read_link(entry.unwrap().path().join("ns/net")).ok())
            .filter(|link| networks.contains(&link.to_string_lossy().into_owned()))
            .collect();
        if left.is_empty() {
            return;
        }
        assert!(start.elapsed() < NOTICE, "processes are left in {left:?}");
        thread::sleep(Duration::from_millis(5));
    }
}

fn networks(nodes: [Pid; 2]) -> [String; 2] {
    let networks = nodes.map(network);
    let own = fs::read_link("/proc/self/ns/net").unwrap().to_string_lossy().into_owned();
    assert!(networks[0] != networks[1] && !networks.contains(&own), "each node has a network of its own");
    networks
}

#[test]
fn a_run_over_either_cyclic_transport_passes() {
    for cyclic in ["udp", "rt1"] {
        let ended = Bench::start(&["--reps", "1", "--cyclic", cyclic]).wait();
        assert!(ended.status.success(), "{cyclic}: {}: {}", ended.status, ended.stderr);
        assert_eq!(ended.samples.lines().count(), 2);
    }
}

/// EtherNet/IP between two processes. A host that stalls skips cycles, which both sides tell; what was sent must arrive.
#[test]
fn a_run_of_setup_b_passes_and_loses_no_frame() {
    let ended = Bench::start_setup("B", &["--reps", "1"]).wait();
    assert!(ended.status.success(), "{}: {}", ended.status, ended.stderr);
    assert_eq!(ended.samples.lines().count(), 2);
    let bus = &ended.results["bus"];
    assert_eq!(bus["lost"], 0, "{bus}");
    assert!(
        bus["frames_sent"].as_u64() > Some(1_000) && bus["frames_received"].as_u64() > Some(1_000),
        "{bus}"
    );
    let allocations = &ended.results["cyclic_allocations"];
    assert_eq!((&allocations["plc"], &allocations["robot"]), (&0.into(), &0.into()));
}

#[test]
fn a_killed_node_fails_the_run_at_once_and_is_named() {
    for (index, name) in [(0, "plc-node"), (1, "robot-node")] {
        let mut bench = Bench::start(&["--reps", "1000"]);
        let nodes = bench.nodes();
        let networks = networks(nodes);
        kill_process(nodes[index], Signal::KILL).unwrap();
        let ended = bench.wait();
        assert_eq!(ended.status.code(), Some(4), "{}", ended.stderr);
        assert!(ended.after < NOTICE, "only after {:?}", ended.after);
        assert!(
            ended.stderr.contains(&format!("the {name} ended (signal: 9 (SIGKILL))")),
            "{}",
            ended.stderr
        );
        assert!(ended.samples.lines().count() > 1, "the samples so far are gone");
        nothing_is_left(&networks);
    }
}

#[test]
fn a_node_that_hangs_fails_the_run() {
    for index in [0, 1] {
        let mut bench = Bench::start(&["--reps", "1000"]);
        let nodes = bench.nodes();
        let networks = networks(nodes);
        kill_process(nodes[index], Signal::STOP).unwrap();
        let ended = bench.wait();
        assert_eq!(ended.status.code(), Some(4), "{}", ended.stderr);
        assert!(ended.after < NOTICE, "only after {:?}", ended.after);
        // Whichever is noticed first.
        let reasons = ["was lost", "life counter stood still"];
        assert!(reasons.iter().any(|reason| ended.stderr.contains(reason)), "{}", ended.stderr);
        nothing_is_left(&networks);
    }
}

#[test]
fn ctrl_c_and_sigterm_end_everything_and_keep_the_samples() {
    for signal in [Signal::INT, Signal::TERM] {
        let mut bench = Bench::start(&["--reps", "1000"]);
        let networks = networks(bench.nodes());
        kill_process(bench.pid(), signal).unwrap();
        let ended = bench.wait();
        assert_eq!(ended.status.code(), Some(130), "{}", ended.stderr);
        assert!(ended.after < NOTICE, "only after {:?}", ended.after);
        assert!(ended.samples.lines().count() > 1, "the samples so far are gone");
        nothing_is_left(&networks);
    }
}

#[test]
fn even_a_killed_bench_leaves_nothing_behind() {
    let mut bench = Bench::start(&["--reps", "1000"]);
    let networks = networks(bench.nodes());
    kill_process(bench.pid(), Signal::KILL).unwrap();
    assert_eq!(bench.wait().status.signal(), Some(9));
    nothing_is_left(&networks);
}

/// The frames of one track of a timeline: when each passed, in µs, and whether the cable did something to it.
fn frames(timeline: &serde_json::Value, track: u64) -> Vec<(f64, bool)> {
    let events = timeline["traceEvents"].as_array().unwrap().iter();
    let frames = events.filter(|event| event["ph"] == "i" && event["pid"] == 4 && event["tid"] == track);
    frames.map(|event| (event["ts"].as_f64().unwrap(), event["args"]["fault"] == true)).collect()
}

#[test]
fn a_real_timeline_has_the_frames_of_both_ends_without_a_capture_that_nobody_asked_for() {
    let ended = Bench::start(&["--reps", "1", "--trace"]).wait();
    assert!(ended.status.success(), "{}: {}", ended.status, ended.stderr);
    let run_ms = ended.results["results"]["cm"]["samples_ms"][0].as_f64().unwrap();
    let [plc_sends, robot_receives, robot_sends, plc_receives] =
        [1, 2, 3, 4].map(|track| frames(&ended.timeline, track));
    for (sent, received) in [(&plc_sends, &robot_receives), (&robot_sends, &plc_receives)] {
        // One a millisecond; a host that stalls skips some.
        assert!(sent.len() as f64 > run_ms * 0.5, "{} frames in {run_ms} ms", sent.len());
        assert!(sent.iter().chain(received).all(|(at, _)| (0.0..=run_ms * 1e3).contains(at)));
        assert!(sent.is_sorted() && received.is_sorted(), "a track runs backwards");
        // What passed one end just before the run passes the other in it, and the other way round.
        assert!(sent.len().abs_diff(received.len()) <= 2, "{} sent, {} received", sent.len(), received.len());
    }
    assert!(!ended.files.iter().any(|file| file.ends_with(".pcapng")), "{:?}", ended.files);
}

/// What the comments in the capture of one end say, at the frames that it sent or at those that it received.
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

#[test]
fn a_real_cable_does_the_faults_that_were_asked_for_and_each_is_a_comment_and_counted() {
    let mut args = vec!["--reps", "1", "--capture", "always", "--trace"];
    for fault in ["loss=0.01", "to-plc:duplicate=0.02", "to-robot:reorder=0.01@3ms"] {
        args.extend(["--fault", fault]);
    }
    let ended = Bench::start(&args).wait();
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
    assert!(
        ["lost", "duplicated", "reordered"].iter().all(|fault| faults[fault].as_u64() > Some(10)),
        "{faults}"
    );
    // The nodes missed what the cable lost.
    assert!(ended.results["bus"]["lost"].as_u64() >= Some(10), "{}", ended.results["bus"]);
    assert!(frames(&ended.timeline, 1).iter().any(|(_, faulty)| *faulty));
}

#[test]
fn a_cut_and_a_killed_node_are_told_beside_the_next_frames_of_a_real_capture() {
    let faults = ["--fault", "cut-at=500ms..504ms", "--fault", "kill-robot-at=1s"];
    let ended = Bench::start(&[&["--reps", "9", "--capture", "on-failure"], &faults[..]].concat()).wait();
    assert_eq!(ended.status.code(), Some(4), "{}", ended.stderr);
    assert!(ended.stderr.contains("the robot-node ended (signal: 9 (SIGKILL))"), "{}", ended.stderr);
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

/// EtherNet/IP has connections over TCP on the same cable: what is lost of them is sent again.
#[test]
fn a_run_of_setup_b_outlives_a_lossy_real_cable() {
    let ended = Bench::start_setup("B", &["--reps", "1", "--fault", "loss=0.005"]).wait();
    assert!(ended.status.success(), "{}: {}", ended.status, ended.stderr);
    assert!(ended.results["faults"]["lost"].as_u64() > Some(5), "{}", ended.results["faults"]);
}

#[test]
fn what_recording_costs_is_told_of_both_nodes_and_what_was_recorded_is_kept() {
    let _host = HOST.lock().unwrap_or_else(PoisonError::into_inner);
    let place = tempfile::tempdir().unwrap();
    let ended = Command::new(env!("CARGO_BIN_EXE_bench"))
        .args(["overhead", "--pairs", "5", "--out"])
        .arg(place.path())
        .output()
        .unwrap();
    let said = String::from_utf8(ended.stdout).unwrap();
    assert!(said.starts_with("Setup A, 5 pairs of seconds of cm"), "{said}");
    for node in ["\n  PLC    ", "\n  robot  "] {
        assert!(said.contains(node), "{said}");
    }
    // What it costs is this host's to say; the exit code says the same as the words.
    assert_eq!(ended.status.code(), Some(if said.contains("; fail") { 3 } else { 0 }), "{said}");
    let length = |file| fs::metadata(place.path().join(file)).unwrap().len();
    for file in ["plc.pcapng", "robot.pcapng"] {
        // Half of the time: all of it would be 12 MB.
        assert!((500_000..9_000_000).contains(&length(file)), "{file} has {} bytes", length(file));
    }
    assert!(length("trace-plc.rows") > 50_000 && length("trace-robot.rows") > 50_000);
}
