use super::*;
use protocol::image::State;
use records::trace::{PlcScan, RobotTick};
use std::collections::BTreeMap;

fn trace() -> Trace {
    let mut trace = Trace::default();
    for execution_type in [ExecutionType::Rc, ExecutionType::Cm] {
        let mut recording = Recording::default();
        for number in 0..40_u16 {
            let state = if number < 4 { State::Ready } else { State::Running };
            let sample = robot_node::Sample {
                state,
                command: number / 20,
                accepted: 3,
                path_speed_mm_s: f32::from(number),
                altered: u64::from(number >= 20),
                ..robot_node::Sample::default()
            };
            recording.robot(RobotTick { at_ms: f64::from(number) * 4.0 - 1.5, true_ns: 0, sample });
            let sample = plc_node::Sample {
                scan: number.into(),
                command: number / 20,
                total: 13,
                written: 5,
                in_slots: 5,
                altered: 0,
                marks_come: u32::from(number >= 10),
                marks_passed: u32::from(number >= 25),
            };
            recording.plc(PlcScan { at_us: i64::from(number) * 1_000, true_ns: 0, sample });
        }
        *trace.types.entry(execution_type) = Some(recording);
    }
    trace
}

#[test]
fn every_event_has_the_fields_of_the_format_and_the_times_of_each_track_increase() {
    let json: serde_json::Value =
        serde_json::from_str(&json(&trace(), &["LIN to A", "PTP to B", "LIN before C"]).unwrap()).unwrap();
    let events = json["traceEvents"].as_array().unwrap();
    assert!(events.len() > 200, "{}", events.len());
    let refused = events.iter().filter(|event| event["name"] == "altered image refused");
    assert_eq!(refused.count(), 2, "one in each repetition");
    let mut tracks: BTreeMap<(u64, u64, String), f64> = BTreeMap::new();
    for event in events {
        let phase = event["ph"].as_str().unwrap();
        let name = event["name"].as_str().unwrap();
        let (pid, tid) = (event["pid"].as_u64().unwrap(), event["tid"].as_u64().unwrap());
        let ts = event["ts"].as_f64().unwrap();
        let counter = if phase == "C" { name } else { "" };
        match phase {
            "X" => assert!(event["dur"].as_f64().unwrap() >= 0.0, "{event}"),
            "i" => assert_eq!(event["s"], "t"),
            "C" => assert!(event["args"]["value"].is_number(), "{event}"),
            "M" => assert!(event["args"]["name"].is_string(), "{event}"),
            other => panic!("phase {other}"),
        }
        // Spans of a track do not overlap.
        let free = tracks.entry((pid, tid, counter.to_owned())).or_insert(f64::MIN);
        assert!(ts >= *free - 1e-3, "{event} begins before {free}");
        *free = ts + event["dur"].as_f64().unwrap_or_default();
    }
}

#[test]
fn every_track_has_a_name() {
    let json: serde_json::Value =
        serde_json::from_str(&json(&trace(), &["LIN to A", "PTP to B", "LIN before C"]).unwrap()).unwrap();
    let events = json["traceEvents"].as_array().unwrap();
    let named = |pid: &serde_json::Value, tid: &serde_json::Value| {
        events
            .iter()
            .any(|event| event["name"] == "thread_name" && event["pid"] == *pid && event["tid"] == *tid)
    };
    for event in events.iter().filter(|event| event["ph"] == "X" || event["ph"] == "i") {
        assert!(named(&event["pid"], &event["tid"]), "{event}");
    }
}

#[test]
fn two_stations_share_the_runs_and_show_their_waits_at_marks() {
    let (trace, motions) = (trace(), ["LIN to A", "PTP to B", "LIN before C"]);
    let station = |name| TimelineStation { name, trace: &trace, motions: &motions, marks: &[7] };
    let json: serde_json::Value =
        serde_json::from_str(&json_of(&[station("left"), station("right")]).unwrap()).unwrap();
    let events = json["traceEvents"].as_array().unwrap();
    let named = |name: &str| events.iter().filter(|event| event["name"] == name).collect::<Vec<_>>();
    assert_eq!(named("rc").len(), 1);
    let waits = named("waits at mark 7");
    let of = |event: &&&serde_json::Value| (event["pid"].as_u64().unwrap(), event["dur"].as_f64().unwrap());
    let found: Vec<_> = waits.iter().map(|event| of(&event)).collect();
    assert_eq!(found, [(2, 15_000.0), (5, 15_000.0), (2, 15_000.0), (5, 15_000.0)]);
    let processes = named("process_name");
    let names: Vec<_> = processes.iter().map(|event| event["args"]["name"].as_str().unwrap()).collect();
    assert_eq!(
        names,
        ["run", "PLC left", "robot left", "cable left", "PLC right", "robot right", "cable right"]
    );
}
