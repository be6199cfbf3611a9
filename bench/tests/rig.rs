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
        let results = fs::read_to_string(self.place.path().join("run/results.json")).unwrap_or_default();
        let results = serde_json::from_str(&results).unwrap_or_default();
        Ended { status, after, stderr, samples, results }
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
