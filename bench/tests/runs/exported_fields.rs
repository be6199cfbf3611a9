//! The exported JSON: its fields.

use std::fs;

use crate::program::bench;

#[test]
fn the_exported_json_has_its_documented_fields_and_neither_time_nor_host() {
    // Longer than a screen, because it is one list: all fields of the file.
    let directory = tempfile::tempdir().unwrap();
    let export = |name: &str| {
        let finished =
            bench(directory.path(), ["--mode", "virtual", "--reps", "1", "--export-json", name, "--quiet"]);
        assert_eq!((finished.code, finished.stderr.as_str()), (Some(0), ""));
        fs::read_to_string(directory.path().join(name)).unwrap()
    };
    let json = export("a.json");
    assert_eq!(json, export("b.json"));
    let value: serde_json::Value = serde_json::from_str(&json).unwrap();
    let mut paths = Vec::new();
    leaves(&value, String::new(), &mut paths);
    // One for each value, see `Digests`.
    let (digests, others): (Vec<_>, Vec<_>) = paths.iter().partition(|path| path.starts_with(".digests."));
    assert!(digests.len() > 20, "{digests:?}");
    let paths = others.into_iter().cloned().collect::<Vec<_>>();
    insta::assert_snapshot!(paths.join("\n"), @"
    .aet_improvement
    .application
    .arms.a_as_b_ms
    .arms.a_ms
    .arms.b_as_a_ms
    .arms.b_ms
    .bus.foreign
    .bus.frames_received
    .bus.frames_sent
    .bus.lost
    .bus.skipped
    .calibrated[].key
    .calibrated[].note
    .calibrated[].value
    .connected_after_ms
    .cycle.plc.buckets[][]
    .cycle.plc.max_us
    .cycle.plc.missed
    .cycle.plc.p50_us
    .cycle.plc.p99_us
    .cycle.robot.buckets[][]
    .cycle.robot.max_us
    .cycle.robot.missed
    .cycle.robot.p50_us
    .cycle.robot.p99_us
    .cyclic_allocations
    .images.plc_altered
    .images.plc_outdated
    .images.plc_unchecked
    .images.robot_altered
    .images.robot_outdated
    .images.robot_unchecked
    .mode
    .paper.cm.aet_ms
    .paper.cm.mad_ms
    .paper.rc.aet_ms
    .paper.rc.mad_ms
    .paper.sm.aet_ms
    .paper.sm.mad_ms
    .positions
    .repeated
    .reps
    .results.cm.aet_ms
    .results.cm.blends_suppressed[]
    .results.cm.failed[]
    .results.cm.mad_ms
    .results.cm.missed_cycles[].held_up
    .results.cm.missed_cycles[].plc
    .results.cm.missed_cycles[].robot
    .results.cm.quality.energy_proxy_s
    .results.cm.quality.joint_acceleration.peak
    .results.cm.quality.joint_acceleration.rms
    .results.cm.quality.joint_jerk.peak
    .results.cm.quality.joint_jerk.rms
    .results.cm.quality.joint_speed.peak
    .results.cm.quality.joint_speed.rms
    .results.cm.quality.path_deviation_mm
    .results.cm.quality.repetitions
    .results.cm.quality.stops
    .results.cm.quality.tool_acceleration_mm_s2.peak
    .results.cm.quality.tool_acceleration_mm_s2.rms
    .results.cm.quality.tool_jerk_mm_s3.peak
    .results.cm.quality.tool_jerk_mm_s3.rms
    .results.cm.robot_samples_ms[]
    .results.cm.samples_ms[]
    .results.rc.aet_ms
    .results.rc.blends_suppressed[]
    .results.rc.failed[]
    .results.rc.mad_ms
    .results.rc.missed_cycles[].held_up
    .results.rc.missed_cycles[].plc
    .results.rc.missed_cycles[].robot
    .results.rc.quality.energy_proxy_s
    .results.rc.quality.joint_acceleration.peak
    .results.rc.quality.joint_acceleration.rms
    .results.rc.quality.joint_jerk.peak
    .results.rc.quality.joint_jerk.rms
    .results.rc.quality.joint_speed.peak
    .results.rc.quality.joint_speed.rms
    .results.rc.quality.path_deviation_mm
    .results.rc.quality.repetitions
    .results.rc.quality.stops
    .results.rc.quality.tool_acceleration_mm_s2.peak
    .results.rc.quality.tool_acceleration_mm_s2.rms
    .results.rc.quality.tool_jerk_mm_s3.peak
    .results.rc.quality.tool_jerk_mm_s3.rms
    .results.rc.robot_samples_ms[]
    .results.rc.samples_ms[]
    .results.sm.aet_ms
    .results.sm.blends_suppressed[]
    .results.sm.failed[]
    .results.sm.mad_ms
    .results.sm.missed_cycles[].held_up
    .results.sm.missed_cycles[].plc
    .results.sm.missed_cycles[].robot
    .results.sm.quality.energy_proxy_s
    .results.sm.quality.joint_acceleration.peak
    .results.sm.quality.joint_acceleration.rms
    .results.sm.quality.joint_jerk.peak
    .results.sm.quality.joint_jerk.rms
    .results.sm.quality.joint_speed.peak
    .results.sm.quality.joint_speed.rms
    .results.sm.quality.path_deviation_mm
    .results.sm.quality.repetitions
    .results.sm.quality.stops
    .results.sm.quality.tool_acceleration_mm_s2.peak
    .results.sm.quality.tool_acceleration_mm_s2.rms
    .results.sm.quality.tool_jerk_mm_s3.peak
    .results.sm.quality.tool_jerk_mm_s3.rms
    .results.sm.robot_samples_ms[]
    .results.sm.samples_ms[]
    .schema_version
    .seed
    .setup
    .status
    .title
    .without_skill_overhead.aet_improvement
    .without_skill_overhead.results.cm.aet_ms
    .without_skill_overhead.results.cm.mad_ms
    .without_skill_overhead.results.rc.aet_ms
    .without_skill_overhead.results.rc.mad_ms
    .without_skill_overhead.results.sm.aet_ms
    .without_skill_overhead.results.sm.mad_ms
    ");
}

/// Collects the paths of everything that is not an object; elements of an array count once.
fn leaves(value: &serde_json::Value, path: String, paths: &mut Vec<String>) {
    match value {
        serde_json::Value::Object(object) => {
            object.iter().for_each(|(key, value)| leaves(value, format!("{path}.{key}"), paths));
        }
        serde_json::Value::Array(items) => match items.first() {
            Some(first) => leaves(first, format!("{path}[]"), paths),
            None => paths.push(format!("{path}[]")),
        },
        _ => paths.push(path),
    }
}
