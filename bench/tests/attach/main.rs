//! The bench on nodes that it did not start, as in containers or on other machines: they outlive it, whatever it does. And
//! the nodes with another controller, or with none.
//!
//! ```text
//!   bench ── c0 ═ plc ── PLC's network ── plc0 ═ robot0 ── robot's network ── robot ═ c1 ── bench
//! ```

#![expect(clippy::unwrap_used, clippy::panic, reason = "a test fails by panicking")]

mod by_hand;
mod cell;
mod device_file;
mod peer;
mod stations;

use std::fs;
use std::net::Ipv4Addr;
use std::path::Path;
use std::process::{Child, Command, ExitCode, Output, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use networked_tests::End;
use protocol_linux::namespace::NetworkNamespace;
use rustix::process::{Pid, Signal, kill_process};

use by_hand::{
    a_wrong_value_in_an_instruction_is_refused_and_the_run_goes_on,
    nodes_end_with_130_at_ctrl_c_and_sigterm_whatever_they_do,
};

const PLC: &str = "plc=10.77.0.1:7700";
/// The token of the nodes and of the bench.
const TOKEN: &str = "for these tests alone";
const BOTH: &str = "plc=10.77.0.1:7700,robot=10.77.1.1:7700";

fn main() -> ExitCode {
    networked_tests::run(networked_tests::tests![
        one_bench_after_the_other_measures_on_nodes_that_run_on,
        the_plc_alone_is_enough_where_the_robot_is_no_node_of_ours,
        a_bench_that_is_killed_or_interrupted_leaves_nodes_that_the_next_one_can_use,
        a_second_bench_is_refused_and_does_not_disturb_the_first,
        a_bench_without_the_nodes_token_gets_nothing_but_the_reason,
        a_node_does_not_listen_to_other_hosts_without_a_token,
        a_robot_with_another_last_target_fails_the_run_although_only_the_plc_is_attached,
        a_node_that_goes_away_fails_the_run,
        a_plc_that_is_stopped_fails_the_run_or_keeps_it_from_beginning_and_is_named,
        what_runs_there_has_to_be_what_is_asked_for,
        another_value_anywhere_in_setup_or_application_is_refused_and_its_key_named,
        a_wrong_value_in_an_instruction_is_refused_and_the_run_goes_on,
        nodes_end_with_130_at_ctrl_c_and_sigterm_whatever_they_do,
        device_file::a_bench_measures_on_nodes_of_the_same_device_file_and_refuses_those_of_another,
        cell::two_robots_on_two_buses_and_one_switch_work_with_one_plc,
        cell::a_plc_that_sends_json_names_the_station_of_each_message,
        cell::a_robot_that_is_missing_or_another_than_described_is_named_and_the_other_arm_does_not_move,
        cell::a_bench_measures_on_the_nodes_of_a_cell_that_run_already,
        cell::attached_nodes_of_a_cell_that_are_others_or_missing_are_named_before_anything_moves,
        peer::the_doctor_sees_every_step_of_a_robot_that_runs_on_each_bus,
        peer::the_doctor_sees_every_step_of_a_plc_up_to_its_first_command_on_each_bus,
        peer::the_doctor_names_assemblies_whose_size_or_number_is_not_that_of_the_setup,
        peer::the_doctor_names_the_first_step_that_a_missing_peer_lacks,
        stations::a_robot_that_kept_the_address_of_another_one_is_not_connected_to,
        stations::a_stranger_that_takes_the_address_of_the_robot_is_named_by_both_nodes,
    ])
}

/// Both nodes of Setup A on their cable, and the network of their controllers.
struct Cell {
    control: NetworkNamespace,
    nodes: [Child; 2],
    place: tempfile::TempDir,
}

impl Cell {
    fn start() -> Self {
        Self::start_with(&[])
    }

    /// Starts a cell whose robot node gets further arguments.
    fn start_with(robot_args: &[&str]) -> Self {
        Self::start_of("A", robot_args)
    }

    /// Starts a cell of another setup on PROFINET.
    fn start_of(setup: &str, robot_args: &[&str]) -> Self {
        let [plc, robot, control] = [(); 3].map(|()| NetworkNamespace::new().unwrap());
        cable((&plc, "plc0", None), (&robot, "robot0", None));
        cable((&plc, "plc", Some([10, 77, 0, 1])), (&control, "c0", Some([10, 77, 0, 2])));
        cable((&robot, "robot", Some([10, 77, 1, 1])), (&control, "c1", Some([10, 77, 1, 2])));
        let node = |network: &NetworkNamespace, name, interface, address, more: &[&str]| {
            let mut command = node_of(setup, network, name, interface);
            command.args(["--control", address]).args(more).env("SKILLBENCH_CONTROL_TOKEN", TOKEN);
            command.stdout(Stdio::null()).spawn().unwrap()
        };
        let nodes = [
            node(&plc, "__plc-node", "plc0", "10.77.0.1:7700", &[]),
            node(&robot, "__robot-node", "robot0", "10.77.1.1:7700", robot_args),
        ];
        Self { control, nodes, place: tempfile::tempdir().unwrap() }
    }

    /// Starts a bench that is attached like this, with further `args`; it runs CM if these name no types.
    fn bench(&self, run: &str, attach: &str, args: &[&str]) -> Child {
        let mut command = bench();
        let types: &[&str] = if args.contains(&"--types") { &[] } else { &["--types", "cm"] };
        command
            .env("SKILLBENCH_CONTROL_TOKEN", TOKEN)
            .args(types)
            .args(["--attach", attach, "--out"])
            .arg(self.place.path().join(run))
            .args(args);
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        self.control.confine(&mut command).unwrap();
        command.spawn().unwrap()
    }

    fn measure(&self, run: &str, attach: &str, args: &[&str]) -> Output {
        self.bench(run, attach, args).wait_with_output().unwrap()
    }

    /// Starts a bench on a run of hours and waits for its first repetition.
    fn long_run(&self, run: &str) -> Child {
        let mut bench = self.bench(run, BOTH, &["--reps", "1000"]);
        let samples = self.place.path().join(run).join("samples.csv");
        while fs::read_to_string(&samples).map_or(0, |samples| samples.lines().count()) < 2 {
            if bench.try_wait().unwrap().is_some() {
                let output = bench.wait_with_output().unwrap();
                panic!("the bench ended before a repetition was saved: {}", text(&output.stderr));
            }
            thread::sleep(Duration::from_millis(5));
        }
        bench
    }

    fn nodes_run(&mut self) -> bool {
        self.nodes.iter_mut().all(|node| node.try_wait().unwrap().is_none())
    }
}

impl Drop for Cell {
    fn drop(&mut self) {
        for node in &mut self.nodes {
            let _ = kill_process(Pid::from_child(node), Signal::TERM);
            let _ = node.wait();
        }
    }
}

/// Lays a cable between two networks; each end has a name and possibly an address.
fn cable(a: (&NetworkNamespace, &str, Option<[u8; 4]>), b: (&NetworkNamespace, &str, Option<[u8; 4]>)) {
    networked_tests::cable([a, b].map(|(network, name, address)| End {
        network,
        name,
        address: address.map(Ipv4Addr::from),
    }));
}

/// Returns the command that starts a node of Setup A in a network.
fn node(network: &NetworkNamespace, name: &str, interface: &str) -> Command {
    node_of("A", network, name, interface)
}

/// Returns the command that starts a node of a setup in a network.
fn node_of(setup: &str, network: &NetworkNamespace, name: &str, interface: &str) -> Command {
    let mut command = bench();
    command.args([name, "run", "--setup", setup, "--interface", interface]);
    // A directory that cannot be read, as where `HOME` is another user's: the node starts all the same.
    command.env_remove("STATE_DIRECTORY").env("XDG_STATE_HOME", "/dev/null");
    network.confine(&mut command).unwrap();
    command.stdin(Stdio::null());
    command
}

fn bench() -> Command {
    Command::new(env!("CARGO_BIN_EXE_bench"))
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn results(place: &Path, run: &str) -> serde_json::Value {
    serde_json::from_str(&fs::read_to_string(place.join(run).join("results.json")).unwrap()).unwrap()
}

fn one_bench_after_the_other_measures_on_nodes_that_run_on() {
    let mut cell = Cell::start();
    let [_, longest] = ["first", "second"].map(|run| {
        let started = Instant::now();
        let output = cell.measure(run, BOTH, &["--reps", "1", "--quiet"]);
        assert!(output.status.success(), "{}", text(&output.stderr));
        started.elapsed()
    });
    assert!(cell.nodes_run());
    let slow = cell.measure("slow", BOTH, &["--reps", "1", "--quiet", "--override", "100,20@500ms"]);
    assert!(slow.status.success(), "{}", text(&slow.stderr));
    let [first, second, slow] = ["first", "second", "slow"].map(|run| results(cell.place.path(), run));
    let aet = |results: &serde_json::Value| results["results"]["cm"]["aet_ms"].as_f64().unwrap();
    assert!(aet(&slow) > 1.5 * aet(&first), "the override reaches a PLC that runs elsewhere");
    for results in [&first, &second] {
        assert_eq!(results["attached"]["robot"]["address"], "10.77.1.1:7700");
        assert!(results["without_skill_overhead"].is_object(), "both nodes are the model");
        assert_eq!(results["results"]["cm"]["samples_ms"].as_array().unwrap().len(), 1);
        assert_eq!(results["connected_after_ms"], serde_json::Value::Null);
    }
    // Counts since the nodes' start must be subtracted: with those of the first run, there would be more cycles
    // of a millisecond than the second one took.
    let most = longest.as_millis() as u64;
    let frames = second["bus"]["frames_sent"].as_u64().unwrap();
    let buckets = second["cycle"]["plc"]["buckets"].as_array().unwrap().iter();
    let scans: u64 = buckets.map(|bucket| bucket[1].as_u64().unwrap()).sum();
    assert!(frames <= most && scans <= most, "{frames} frames and {scans} scans in {most} ms");
}

fn the_plc_alone_is_enough_where_the_robot_is_no_node_of_ours() {
    let cell = Cell::start();
    let output = cell.measure("run", PLC, &["--reps", "1"]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let table = text(&output.stdout);
    assert!(table.contains("robot not reported."), "{table}");
    // A robot that is not ours is no model, so nothing that was calibrated or simulated stands beside its figures.
    assert!(["h = 0", "calibrated", "by construction"].iter().all(|words| !table.contains(words)), "{table}");
    let told = table.replace("\n ", "");
    assert!(
        told.contains("Measured on nodes that ran already: PLC at 10.77.0.1:7700, skillbench"),
        "{table}"
    );
    let on_the_bus = "robot not attached; on the bus the robot is `skillbench-robot` (";
    assert!(told.contains(on_the_bus) && told.contains("VendorID 0xFFFF, DeviceID 0x0001."), "{table}");
    let not_verified = "Not verified: path, speed, override, ratings of the joints";
    assert!(told.replace("  ", " ").contains(not_verified), "{table}");
    assert!(
        results(cell.place.path(), "run")["not_verified"][0].as_str().unwrap().starts_with("path, speed")
    );
    let attached = &results(cell.place.path(), "run")["attached"];
    assert_eq!(attached["plc"]["version"], env!("CARGO_PKG_VERSION"));
    assert!(attached["identity"].as_str().unwrap().starts_with("`skillbench-robot` ("), "{attached}");
    assert!(attached["plc"]["host"].as_str().unwrap().contains("Linux") && attached["robot"].is_null());
    let report = fs::read_to_string(cell.place.path().join("run/report.html")).unwrap();
    assert!(report.contains("on the bus the robot is `skillbench-robot`"), "the report's line on the nodes");
    assert!(report.contains("Measured on nodes that ran already") && !report.contains("h = 0"));
    assert!(report.contains(not_verified));
    let history = bench().arg("history").arg(cell.place.path()).output().unwrap();
    assert!(text(&history.stdout).contains("real, attached"), "{}", text(&history.stdout));
}

fn a_bench_that_is_killed_or_interrupted_leaves_nodes_that_the_next_one_can_use() {
    let mut cell = Cell::start();
    for (signal, code) in [(Signal::KILL, None), (Signal::TERM, Some(130))] {
        let run = format!("ended-by-{}", signal.as_raw());
        let bench = cell.long_run(&run);
        kill_process(Pid::from_child(&bench), signal).unwrap();
        assert_eq!(bench.wait_with_output().unwrap().status.code(), code);
    }
    let output = cell.measure("after", BOTH, &["--reps", "1"]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert!(cell.nodes_run());
}

fn a_second_bench_is_refused_and_does_not_disturb_the_first() {
    let cell = Cell::start();
    let mut first = cell.long_run("first");
    let second = cell.measure("second", BOTH, &[]);
    let error = text(&second.stderr);
    assert_eq!(second.status.code(), Some(5), "{error}");
    assert!(error.contains("the plc-node is controlled by 10.77.0.2:"), "{error}");
    assert!(first.try_wait().unwrap().is_none());
    first.kill().unwrap();
    first.wait().unwrap();
}

fn a_bench_without_the_nodes_token_gets_nothing_but_the_reason() {
    let cell = Cell::start();
    let file = cell.place.path().join("token");
    fs::write(&file, "another token of some length\n").unwrap();
    let wrong = cell.measure("wrong", BOTH, &["--control-token", file.to_str().unwrap()]);
    let error = text(&wrong.stderr);
    assert_eq!(wrong.status.code(), Some(2), "{error}");
    assert!(
        error.contains("the plc-node does not follow this bench: the control token is not the node's"),
        "{error}"
    );
    fs::write(&file, format!("{TOKEN}\n")).unwrap();
    let right = cell.measure("right", BOTH, &["--control-token", file.to_str().unwrap(), "--reps", "1"]);
    assert!(right.status.success(), "{}", text(&right.stderr));
}

fn a_node_does_not_listen_to_other_hosts_without_a_token() {
    let mut command = bench();
    command.args(["__plc-node", "run", "--setup", "A", "--interface", "lo", "--control", "0.0.0.0:7700"]);
    let output = command.env_remove("SKILLBENCH_CONTROL_TOKEN").output().unwrap();
    let error = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{error}");
    assert!(error.contains("other hosts reach 0.0.0.0:7700") && error.contains("--control-token"), "{error}");
}

fn a_robot_with_another_last_target_fails_the_run_although_only_the_plc_is_attached() {
    let place = tempfile::tempdir().unwrap();
    let application = planning::APPLICATIONS.iter().find(|(name, _)| *name == "pick-and-place").unwrap().1;
    let (before, last) = application.rsplit_once("reach = \"home\"").unwrap();
    let beside = "beside = { mm_deg = [-100.0, 160.0, 150.0, 0.0, 0.0, 180.0] }";
    let before = before.replace("\nhome = ", &format!("\n{beside}\nhome = "));
    let path = place.path().join("beside.toml");
    fs::write(&path, format!("{before}reach = \"beside\"{last}")).unwrap();
    let cell = Cell::start_with(&["--application", path.to_str().unwrap()]);
    let output = cell.measure("run", PLC, &["--reps", "1", "--types", "rc"]);
    let error = text(&output.stderr);
    assert_eq!(output.status.code(), Some(4), "{error}");
    assert!(error.contains("by the PLC, joint ") && error.contains(" ended at "), "{error}");
    // The PLC sends the motions of SM itself.
    let output = cell.measure("sm", PLC, &["--reps", "1", "--types", "sm"]);
    assert!(output.status.success(), "{}", text(&output.stderr));
}

fn a_node_that_goes_away_fails_the_run() {
    let cell = Cell::start();
    let first = cell.long_run("run");
    kill_process(Pid::from_child(&cell.nodes[1]), Signal::KILL).unwrap();
    let output = first.wait_with_output().unwrap();
    let error = text(&output.stderr);
    assert_eq!(output.status.code(), Some(4), "{error}");
    assert!(error.contains("the robot-node at 10.77.1.1:7700 ended or closed the connection"), "{error}");
}

fn a_plc_that_is_stopped_fails_the_run_or_keeps_it_from_beginning_and_is_named() {
    let cell = Cell::start();
    let plc = Pid::from_child(&cell.nodes[0]);
    let first = cell.long_run("run");
    kill_process(plc, Signal::STOP).unwrap();
    for (bench, code) in [(first, 4), (cell.bench("stopped", PLC, &["--reps", "1"]), 5)] {
        let output = bench.wait_with_output().unwrap();
        let error = text(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{error}");
        // The robot's watchdog may notice it first.
        let reasons = ["the plc-node has ", "the connection between the nodes was lost"];
        assert!(reasons.iter().any(|reason| error.contains(reason)), "{error}");
        assert!(code == 4 || error.contains("the plc-node has not sent a message in "), "{error}");
    }
    kill_process(plc, Signal::CONT).unwrap();
}

fn what_runs_there_has_to_be_what_is_asked_for() {
    let cell = Cell::start();
    let other_setup = cell.measure("setup", BOTH, &["--setup", "B"]);
    let error = text(&other_setup.stderr);
    assert_eq!(other_setup.status.code(), Some(2), "{error}");
    assert!(error.contains("a plc-node of setup A, but a plc-node of setup B is needed"), "{error}");

    let swapped = cell.measure("swapped", "plc=10.77.1.1:7700", &[]);
    let error = text(&swapped.stderr);
    assert_eq!(swapped.status.code(), Some(2), "{error}");
    assert!(error.contains("a robot-node of setup A, but a plc-node of setup A is needed"), "{error}");
}

fn another_value_anywhere_in_setup_or_application_is_refused_and_its_key_named() {
    let cell = Cell::start();
    let place = cell.place.path();
    let built_in =
        |list: &[(&str, &'static str)], name| list.iter().find(|(known, _)| *known == name).unwrap().1;
    let setup = built_in(setup::SETUPS, "A");
    let application = built_in(planning::APPLICATIONS, "pick-and-place");
    let faster = setup.replace("velocity_percent = { value = 2", "velocity_percent = { value = 4");
    assert_ne!(faster, setup);
    fs::write(place.join("faster.toml"), faster).unwrap();
    let own = setup.replace("application = \"pick-and-place\"", "application = \"task.toml\"");
    fs::write(place.join("own.toml"), own).unwrap();
    fs::write(place.join("task.toml"), application).unwrap();
    let measure = |run: &str, name: &str, args: &[&str]| {
        let setup = place.join(name);
        let args = [&["--reps", "1", "--setup", setup.to_str().unwrap()], args].concat();
        let output = cell.measure(run, BOTH, &args);
        (output.status.code(), text(&output.stderr))
    };
    let (code, error) = measure("faster", "faster.toml", &[]);
    assert_eq!(code, Some(2), "{error}");
    let told =
        "the plc-node at 10.77.0.1:7700 runs another cell: in its setup, `motions.velocity_percent` is 2";
    assert!(error.contains(told) && error.contains(", and here 4"), "{error}");
    let (code, error) = measure("cyclic", "own.toml", &["--cyclic", "rt1"]);
    assert_eq!(code, Some(2), "{error}");
    assert!(error.contains("`bus.profinet.cyclic` is \"udp\", and here \"rt1\""), "{error}");
    // The same application from a file of one's own passes; another height in it does not.
    let (code, error) = measure("same", "own.toml", &[]);
    assert_eq!(code, Some(0), "{error}");
    fs::write(place.join("task.toml"), application.replace("clearance_mm = 8.0", "clearance_mm = 8.5"))
        .unwrap();
    let (code, error) = measure("other", "own.toml", &[]);
    assert_eq!(code, Some(2), "{error}");
    assert!(error.contains("in its application, `ways.clearance_mm` is "), "{error}");
}
