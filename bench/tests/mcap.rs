//! `--mcap`: what a reader of MCAP files finds in one, held against the table of the same run. Built with the feature
//! `mcap` only.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::ExitCode;

use assert_cmd::Command;
use records::trace::{RobotTick, Trace};

fn main() -> ExitCode {
    networked_tests::run_beside(
        networked_tests::tests![a_real_run_has_the_same_topics],
        networked_tests::tests![
            a_virtual_run_has_every_cycle_of_every_type_in_units_of_ros,
            the_path_speed_stays_below_the_programmed_one,
            a_run_of_a_cell_has_the_topics_of_each_station,
        ],
    )
}

/// A message as the reader gives it.
struct ReadMessage {
    at_ns: u64,
    sequence: u32,
    data: Vec<u8>,
}

struct Topic {
    schema: String,
    heard: Vec<ReadMessage>,
}

/// A run with one repetition of each of these types, and what its file has by topic.
fn run(directory: &Path, mode: &str, setup: &str, types: &str) -> BTreeMap<String, Topic> {
    let arguments = [
        "--setup", setup, "--mode", mode, "--types", types, "--reps", "1", "--mcap", "--quiet", "--out",
        "run",
    ];
    let mut command = Command::cargo_bin("bench").unwrap();
    let output = command.current_dir(directory).args(arguments).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let bytes = fs::read(directory.join("run/motion.mcap")).unwrap();
    let mut topics = BTreeMap::new();
    let mut last = 0;
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        assert!(message.log_time >= last, "the file goes back in time at {}", message.channel.topic);
        last = message.log_time;
        let schema = message.channel.schema.as_ref().unwrap();
        assert_eq!((schema.encoding.as_str(), message.channel.message_encoding.as_str()), ("ros2msg", "cdr"));
        let topic = topics
            .entry(message.channel.topic.clone())
            .or_insert_with(|| Topic { schema: schema.name.clone(), heard: Vec::new() });
        let (at_ns, sequence) = (message.log_time, message.sequence);
        topic.heard.push(ReadMessage { at_ns, sequence, data: message.data.into_owned() });
    }
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    assert_eq!(summary.channels.len(), topics.len(), "the summary names every channel");
    topics
}

/// The run's tables.
fn trace(directory: &Path) -> Trace {
    let read = |name: &str| fs::read_to_string(directory.join("run").join(name)).unwrap();
    Trace::from_csv(&read("trace-robot.csv"), &read("trace-plc.csv")).unwrap()
}

/// The robot's cycles of this type in the run's table, from the start edge on.
fn cycles(directory: &Path, execution_type: &str) -> Vec<RobotTick> {
    let trace = trace(directory);
    let recording = trace.types.get(execution_type.parse().unwrap()).unwrap();
    recording.robot_ticks().iter().filter(|tick| tick.at_ms >= 0.0).copied().collect()
}

fn check(directory: &Path, topics: &BTreeMap<String, Topic>, types: &[&str]) {
    let of_all = types.iter().flat_map(|execution_type| {
        ["joint_states", "path", "path_points", "path_speed", "programmed_speed", "tool"]
            .map(|topic| format!("/{execution_type}/{topic}"))
    });
    // Where the host made a node miss a cycle, a warning says so.
    let warning = trace(directory).incomplete().map(|_| "/log".to_owned());
    let mut wanted: Vec<_> = of_all.chain(warning).collect();
    wanted.sort();
    assert_eq!(topics.keys().cloned().collect::<Vec<_>>(), wanted);
    for execution_type in types {
        let topic = |name: &str| &topics[&format!("/{execution_type}/{name}")];
        let cycles = cycles(directory, execution_type);
        assert!(cycles.len() > 200, "{} cycles of {execution_type}", cycles.len());
        for (name, schema) in [
            ("joint_states", "sensor_msgs/msg/JointState"),
            ("tool", "geometry_msgs/msg/PoseStamped"),
            ("path_speed", "std_msgs/msg/Float64"),
            ("programmed_speed", "std_msgs/msg/Float64"),
        ] {
            let Topic { schema: found, heard } = topic(name);
            assert_eq!((found.as_str(), heard.len()), (schema, cycles.len()), "/{execution_type}/{name}");
            assert!(heard.iter().enumerate().all(|(index, heard)| heard.sequence as usize == index));
            for (heard, RobotTick { at_ms, .. }) in heard.iter().zip(&cycles) {
                assert!(
                    (heard.at_ns as f64 / 1e6 - at_ms).abs() < 0.001,
                    "/{execution_type}/{name} at {at_ms} ms"
                );
            }
        }
        for (name, schema) in [("path", "nav_msgs/msg/Path"), ("path_points", "sensor_msgs/msg/PointCloud2")]
        {
            let Topic { schema: found, heard } = topic(name);
            assert_eq!((found.as_str(), heard.len()), (schema, 1));
        }
    }
}

/// The last f64 of a message.
fn last_f64(data: &[u8]) -> f64 {
    f64::from_le_bytes(data[data.len() - 8..].try_into().unwrap())
}

/// Positions and speeds of a JointState, from its end: no efforts, which is a length of 4 bytes; the speeds, whose length
/// takes 8 with the padding; the positions.
fn positions_and_speeds(data: &[u8], joints: usize) -> [Vec<f64>; 2] {
    let values = |end: usize| {
        let values = data[end - 8 * joints..end].chunks(8);
        values.map(|bytes| f64::from_le_bytes(bytes.try_into().unwrap())).collect()
    };
    let end = data.len() - 4;
    [values(end - 8 * joints - 8), values(end)]
}

fn a_virtual_run_has_every_cycle_of_every_type_in_units_of_ros() {
    for (setup, joints, linear) in [("A", 4, Some(2)), ("B", 6, None)] {
        let directory = tempfile::tempdir().unwrap();
        let topics = run(directory.path(), "virtual", setup, "rc,sm,cm");
        check(directory.path(), &topics, &["rc", "sm", "cm"]);
        for (tick, heard) in cycles(directory.path(), "cm").iter().zip(&topics["/cm/joint_states"].heard) {
            let [positions, _] = positions_and_speeds(&heard.data, joints);
            for (axis, found) in positions.into_iter().enumerate() {
                let value = tick.sample.joints[axis];
                let wanted = if linear == Some(axis) { value / 1e3 } else { value.to_radians() };
                assert!((found - wanted).abs() < 1e-5, "joint {} is {found}, not {wanted}", axis + 1);
            }
        }
        // From one cycle to the next it goes on by the mean of the speeds at both.
        let states: Vec<_> = topics["/cm/joint_states"]
            .heard
            .iter()
            .map(|heard| (heard.at_ns, positions_and_speeds(&heard.data, joints)))
            .collect();
        let mut fastest: f64 = 0.0;
        for states in states.windows(2) {
            let [(from, [start, before]), (to, [end, behind])] = states else { unreachable!() };
            let seconds = (to - from) as f64 / 1e9;
            for axis in 0..joints {
                let by_speeds = (before[axis] + behind[axis]) / 2.0 * seconds;
                fastest = fastest.max(before[axis].abs());
                assert!(
                    (end[axis] - start[axis] - by_speeds).abs() < 2e-4,
                    "joint {} at {from} ns",
                    axis + 1
                );
            }
        }
        assert!(fastest > 0.5, "{fastest} rad/s");
    }
}

/// Lines are too short here for the arm to reach its speed; that it never passes it shows that both speeds are of the same
/// motion. A point-to-point motion programs none.
fn the_path_speed_stays_below_the_programmed_one() {
    let directory = tempfile::tempdir().unwrap();
    let topics = run(directory.path(), "virtual", "A", "rc,sm,cm");
    for execution_type in ["rc", "sm", "cm"] {
        let speeds = |name: &str| -> Vec<f64> {
            topics[&format!("/{execution_type}/{name}")]
                .heard
                .iter()
                .map(|heard| last_f64(&heard.data))
                .collect()
        };
        let (actual, programmed) = (speeds("path_speed"), speeds("programmed_speed"));
        let (lines, others): (Vec<_>, Vec<_>) =
            actual.iter().zip(&programmed).partition(|(_, programmed)| programmed.is_finite());
        assert!(
            lines.len() > 100 && others.len() > 100,
            "{execution_type}: {} cycles on lines, {} not",
            lines.len(),
            others.len()
        );
        let highest = lines.iter().map(|(actual, programmed)| *actual / *programmed).fold(0.0, f64::max);
        assert!((0.3..1.0).contains(&highest), "{execution_type} reaches {highest} of its programmed speed");
        // Between the lines the tool is faster than any line allows.
        let fastest = |cycles: &[(&f64, &f64)]| cycles.iter().map(|(actual, _)| **actual).fold(0.0, f64::max);
        assert!(fastest(&others) > fastest(&lines), "{execution_type}");
    }
}

fn a_real_run_has_the_same_topics() {
    let directory = tempfile::tempdir().unwrap();
    let topics = run(directory.path(), "real", "A", "rc");
    check(directory.path(), &topics, &["rc"]);
}

fn a_run_of_a_cell_has_the_topics_of_each_station() {
    let directory = tempfile::tempdir().unwrap();
    let topics = run(directory.path(), "virtual", "F", "cm");
    for station in ["left", "right"] {
        let table = format!("run/trace-robot-{station}.csv");
        let table = fs::read_to_string(directory.path().join(table)).unwrap();
        let at_ms = |row: &str| row.split(',').nth(1).unwrap().parse::<f64>().unwrap();
        let cycles = table.lines().skip(1).filter(|row| at_ms(row) >= 0.0).count();
        assert!(cycles > 200, "{station}: {cycles} cycles");
        for name in ["joint_states", "tool", "path_speed", "programmed_speed"] {
            assert_eq!(topics[&format!("/cm/{station}/{name}")].heard.len(), cycles, "/cm/{station}/{name}");
        }
    }
}
