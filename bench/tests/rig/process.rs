//! The bench as a process on a real rig, and how it ends.

use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use rustix::process::Pid;

/// Time in which the bench has to notice an error and end, on a host that runs it at once.
const NOTICE: Duration = Duration::from_secs(2);

/// Factor for slow hosts. Creating the cable, starting and connecting both nodes and saving is much the same work as
/// ending, so ending may take longer by this many times the time that the start took.
const SLOWNESS: u32 = 10;

/// Limit for waits that have no limit of their own but must not hang the tests.
const PATIENCE: Duration = Duration::from_secs(120);

/// The bench on a run of hours.
pub(crate) struct Bench {
    child: Child,
    place: tempfile::TempDir,
    started: Instant,
    /// Time from the start until the first repetition was saved, without that repetition; set once it is known.
    prepared: Duration,
}

/// Returns the path of a shipped setup whose connection is changed to tolerate stalls of the host of almost two
/// seconds.
pub(crate) fn patient(setup: &str, place: &Path) -> String {
    let (shipped, changes) = match setup {
        "A" => (
            include_str!("../../../cell/setups/A.toml"),
            [("watchdog_cycles", 500, 1_900), ("cycle_us", 1_000, 1_000)],
        ),
        "C" => (
            include_str!("../../../cell/setups/C.toml"),
            [("watchdog_cycles", 500, 1_900), ("cycle_us", 1_000, 1_000)],
        ),
        // EtherNet/IP tolerates at most 512 packet intervals, so they have to be longer.
        _ => (
            include_str!("../../../cell/setups/B.toml"),
            [("watchdog_cycles", 512, 512), ("cycle_us", 1_000, 4_000)],
        ),
    };
    let (before, bus) = shipped.split_once("[bus]").unwrap();
    let mut bus = bus.to_owned();
    for (key, usual, wanted) in changes {
        let usual = format!("\n{key} = {{ value = {usual},");
        assert!(bus.contains(&usual), "setup {setup} has another {key}");
        bus = bus.replacen(&usual, &format!("\n{key} = {{ value = {wanted},"), 1);
    }
    let path = place.join("patient.toml");
    fs::write(&path, format!("{before}[bus]{bus}")).unwrap();
    path.into_os_string().into_string().unwrap()
}

/// How the bench ended.
pub(crate) struct Ended {
    pub(crate) status: ExitStatus,
    after: Duration,
    prepared: Duration,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
    pub(crate) samples: String,
    pub(crate) results: serde_json::Value,
    pub(crate) timeline: serde_json::Value,
    pub(crate) files: Vec<String>,
    pub(crate) captures: Vec<(String, Vec<u8>)>,
    robot_trace: String,
}

impl Bench {
    pub(crate) fn start(args: &[&str]) -> Self {
        Self::start_in(tempfile::tempdir().unwrap(), "A", args, &[])
    }

    /// Starts it on another built-in setup.
    pub(crate) fn start_setup(setup: &str, args: &[&str]) -> Self {
        Self::start_in(tempfile::tempdir().unwrap(), setup, args, &[])
    }

    /// Starts it on a setup that tolerates all stalls of the host.
    pub(crate) fn start_patient(setup: &str, args: &[&str]) -> Self {
        let place = tempfile::tempdir().unwrap();
        let setup = patient(setup, place.path());
        Self::start_in(place, &setup, args, &[])
    }

    /// Starts it likewise, with a PLC that sends sixty points on a circle as compact points.
    pub(crate) fn start_with_compact_points(setup: &str, args: &[&str]) -> Self {
        let place = tempfile::tempdir().unwrap();
        let setup = patient(setup, place.path());
        let robot = "\n[robot]\ncompact_points = true\nqueue_motions = { value = 64, from = \"assumed\" }\n";
        let text = fs::read_to_string(&setup).unwrap();
        let text = text.replace("\n[plc]\n", "\n[plc]\nform = \"compact\"\n").replace("\n[robot]\n", robot);
        fs::write(&setup, text).unwrap();
        let circle = place.path().join("circle.toml");
        fs::write(&circle, include_str!("../../../cell/planning/tests/circle.toml")).unwrap();
        let args = [&["--application", circle.to_str().unwrap()], args].concat();
        Self::start_in(place, &setup, &args, &[])
    }

    /// Starts one CM likewise, with the robot's device from a file.
    pub(crate) fn start_with_device(setup: &str, device: &str, choice: &str) -> Self {
        let place = tempfile::tempdir().unwrap();
        let setup = patient(setup, place.path());
        let text = fs::read_to_string(&setup).unwrap();
        let lines = "device = \"device\"\nconfig = \"choice.toml\"";
        fs::write(&setup, crate::device_file::with_lines(&text, lines)).unwrap();
        fs::write(place.path().join("device"), device).unwrap();
        fs::write(place.path().join("choice.toml"), choice).unwrap();
        let short = place.path().join("short.toml");
        fs::write(&short, include_str!("../../studies/src/explore/short.toml")).unwrap();
        let args = ["--application", short.to_str().unwrap(), "--types", "cm", "--reps", "1"];
        Self::start_in(place, &setup, &args, &[])
    }

    /// Starts it likewise, it and its nodes with a UTC that steps by hours.
    pub(crate) fn start_with_a_stepping_clock(setup: &str, args: &[&str]) -> Self {
        let place = tempfile::tempdir().unwrap();
        let setup = patient(setup, place.path());
        let clock = place.path().join("stepping-clock.so");
        let source = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/rig/stepping_clock.c");
        let built = Command::new("cc").args(["-O2", "-shared", "-fPIC", source, "-o"]).arg(&clock).status();
        assert!(built.unwrap().success());
        Self::start_in(place, &setup, args, &[("LD_PRELOAD", clock.as_os_str())])
    }

    fn start_in(
        place: tempfile::TempDir,
        setup: &str,
        args: &[&str],
        environment: &[(&str, &OsStr)],
    ) -> Self {
        let started = Instant::now();
        let child = Command::new(env!("CARGO_BIN_EXE_bench"))
            .args(["--setup", setup, "--types", "cm", "--out"])
            .arg(place.path().join("run"))
            .args(args)
            .envs(environment.iter().copied())
            .stdin(Stdio::null())
            .stdout(File::create(place.path().join("printed")).unwrap())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        Self { child, place, started, prepared: Duration::ZERO }
    }

    /// Returns both nodes, the PLC first, as soon as a run is in progress: then the first repetition is saved.
    pub(crate) fn nodes(&mut self) -> [Pid; 2] {
        let samples = self.place.path().join("run/samples.csv");
        self.until("a repetition is saved", || {
            fs::read_to_string(&samples).is_ok_and(|samples| samples.lines().count() > 1)
        });
        let samples = fs::read_to_string(&samples).unwrap();
        let first_ms = samples.lines().nth(1).and_then(|line| line.split(',').nth(2)?.parse().ok());
        let first = Duration::from_secs_f64(first_ms.unwrap_or(0.0) / 1e3);
        self.prepared = self.started.elapsed().saturating_sub(first);
        ["__plc-node", "__robot-node"].map(|name| self.node(name).expect("a node that runs"))
    }

    /// Returns the node of a station, likewise.
    pub(crate) fn node_of_station(&mut self, station: &str) -> Pid {
        self.nodes();
        let argument = format!("--station\0{station}\0");
        node_of(self.child.id(), &argument).expect("a node that runs")
    }

    /// Returns a node as soon as its process runs.
    pub(crate) fn starting(&mut self, name: &str) -> Pid {
        let mut found = None;
        let bench = self.child.id();
        self.until("the node has started", || {
            found = node_of(bench, name);
            found.is_some()
        });
        found.expect("a node that runs")
    }

    fn node(&self, name: &str) -> Option<Pid> {
        node_of(self.child.id(), name)
    }

    pub(crate) fn pid(&self) -> Pid {
        Pid::from_child(&self.child)
    }

    fn until(&mut self, what: &str, mut done: impl FnMut() -> bool) {
        let start = Instant::now();
        while !done() {
            if let Some(status) = self.child.try_wait().unwrap() {
                let mut stderr = String::new();
                self.child.stderr.take().unwrap().read_to_string(&mut stderr).unwrap();
                panic!("the bench ended ({status}) before {what}: {stderr}");
            }
            assert!(start.elapsed() < PATIENCE, "not within {PATIENCE:?}: {what}");
            thread::sleep(Duration::from_millis(5));
        }
    }

    pub(crate) fn wait(mut self) -> Ended {
        let start = Instant::now();
        let status = self.child.wait().unwrap();
        let after = start.elapsed();
        let mut stderr = String::new();
        self.child.stderr.take().unwrap().read_to_string(&mut stderr).unwrap();
        let stdout = fs::read_to_string(self.place.path().join("printed")).unwrap();
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
        Ended {
            status,
            after,
            prepared: self.prepared,
            stdout,
            stderr,
            samples,
            results,
            timeline,
            files,
            captures,
            robot_trace: fs::read_to_string(self.place.path().join("run/trace-robot.csv"))
                .unwrap_or_default(),
        }
    }
}

/// Returns the node with this name that a bench has started.
fn node_of(bench: u32, name: &str) -> Option<Pid> {
    let children = fs::read_to_string(format!("/proc/{bench}/task/{bench}/children")).ok()?;
    let named =
        |pid: &&str| fs::read_to_string(format!("/proc/{pid}/cmdline")).is_ok_and(|line| line.contains(name));
    let pid = children.split_whitespace().find(named)?;
    Pid::from_raw(pid.parse().ok()?)
}

/// The network of a node. While the file is open, no other network can get its number.
pub(crate) struct HeldNetwork {
    number: PathBuf,
    _held: File,
}

impl HeldNetwork {
    /// Returns the network of a process.
    fn of(pid: Pid) -> Self {
        let path = format!("/proc/{pid}/ns/net");
        Self { number: fs::read_link(&path).unwrap(), _held: File::open(path).unwrap() }
    }
}

impl Ended {
    /// Returns the time in which the bench has to notice an error on this host.
    fn limit(&self) -> Duration {
        NOTICE + self.prepared * SLOWNESS
    }

    /// Returns the largest number of motions that the robot accepted in one cycle, by its trace.
    pub(crate) fn most_accepted_in_a_cycle(&self) -> u64 {
        let mut lines = self.robot_trace.lines().map(|line| line.split(',').collect::<Vec<_>>());
        let header = lines.next().unwrap();
        let accepted = header.iter().position(|name| *name == "accepted").unwrap();
        let counts: Vec<u64> = lines.map(|line| line[accepted].parse().unwrap()).collect();
        counts.windows(2).map(|two| two[1].saturating_sub(two[0])).max().unwrap()
    }

    pub(crate) fn at_once(&self) {
        let Self { after, prepared, .. } = self;
        assert!(*after < self.limit(), "only after {after:?}, and starting took {prepared:?}");
    }

    /// Checks that neither nodes nor other processes in their networks are left; then the networks and their
    /// interfaces go too.
    pub(crate) fn nothing_is_left(&self, networks: &[HeldNetwork]) {
        let start = Instant::now();
        loop {
            let left: Vec<_> = fs::read_dir("/proc")
                .unwrap()
                .filter_map(|entry| fs::read_link(entry.unwrap().path().join("ns/net")).ok())
                .filter(|link| networks.iter().any(|network| network.number == *link))
                .collect();
            if left.is_empty() {
                return;
            }
            assert!(start.elapsed() < self.limit(), "processes are left in {left:?}");
            thread::sleep(Duration::from_millis(5));
        }
    }
}

pub(crate) fn networks(nodes: [Pid; 2]) -> [HeldNetwork; 2] {
    let networks = nodes.map(HeldNetwork::of);
    let own = fs::read_link("/proc/self/ns/net").unwrap();
    let [plc, robot] = networks.each_ref().map(|network| &network.number);
    assert!(plc != robot && ![plc, robot].contains(&&own), "each node has a network of its own");
    networks
}
