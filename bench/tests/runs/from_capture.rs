//! Measurements from captures: of our own runs, whose PLC has measured the same repetitions, and of captures with faults.

use std::fs;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use capture_file::reader::CaptureReader;
use capture_file::{CaptureFile, Packet, Retention};
use serde_json::Value;

use crate::program::bench;

/// Time in ms from the start of our captures after which the PLC is connected and a repetition runs.
const CONNECTED_NS: u64 = 2_500_000_000;

/// Bus cycle of Setups A and B, by which a time from the frames may differ from that of the PLC.
const BUS_CYCLE_MS: f64 = 1.0;

/// A packet: its time in ns, and the frame.
type Frame = (u64, Vec<u8>);

/// Runs a setup in virtual time; returns the directory of its run.
fn run(place: &Path, setup: &str, more: &[&str]) -> PathBuf {
    let all = ["--setup", setup, "--mode", "virtual", "--capture", "always", "--out", "run", "-q"];
    let finished = bench(place, all.iter().chain(more));
    assert_eq!(finished.code, Some(0), "{}", finished.stderr);
    place.join("run")
}

fn read(path: &Path) -> Vec<Frame> {
    let mut reader = CaptureReader::new(BufReader::new(File::open(path).unwrap())).unwrap();
    let mut packets = Vec::new();
    while let Some(packet) = reader.next_packet().unwrap() {
        packets.push((packet.nanos, packet.data.to_vec()));
    }
    packets
}

fn write(path: &Path, packets: &[Frame]) {
    let mut file = CaptureFile::create(path, "tap", "", Retention::All).unwrap();
    for (nanos, data) in packets {
        let since_1970 = Duration::from_nanos(*nanos);
        file.write(&Packet { since_1970, sent: None, data, comment: None }).unwrap();
    }
    file.finish().unwrap();
}

/// Measures a capture; returns the results of the new run.
fn measure(place: &Path, capture: &Path, setup: &str) -> Value {
    let _ = fs::remove_dir_all(place.join("measured"));
    let capture = capture.to_str().unwrap();
    let all = ["from-capture", capture, "--setup", setup, "--out", "measured", "--export-json", "found.json"];
    let finished = bench(place, all);
    assert_eq!(finished.code, Some(0), "{}", finished.stderr);
    json(&place.join("measured/results.json"))
}

fn json(path: &Path) -> Value {
    serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap()
}

fn samples(results: &Value, kind: &str) -> Vec<f64> {
    let samples = results["results"][kind]["samples_ms"].as_array().cloned().unwrap_or_default();
    samples.iter().map(|sample| sample.as_f64().unwrap()).collect()
}

/// Compares the last samples of each type with those of the PLC.
fn assert_same(measured: &Value, own: &Value, reps: usize, within_ms: f64) {
    for kind in ["rc", "sm", "cm"] {
        let (found, expected) = (samples(measured, kind), samples(own, kind));
        assert!(found.len() >= reps, "{kind}: {} of {}", found.len(), expected.len());
        for (found, expected) in found.iter().rev().zip(expected.iter().rev()) {
            assert!((found - expected).abs() <= within_ms, "{kind}: {found} ms, by the PLC {expected} ms");
        }
    }
}

#[test]
fn each_repetition_lasts_in_a_capture_what_its_plc_measured() {
    for (setup, more) in [("A", &[][..]), ("A", &["--cyclic", "rt1"]), ("B", &[])] {
        let place = tempfile::tempdir().unwrap();
        let own = run(place.path(), setup, &[&["--reps", "2", "--seed", "5"], more].concat());
        for end in ["plc.pcapng", "robot.pcapng"] {
            let measured = measure(place.path(), &own.join(end), setup);
            assert_same(&measured, &json(&own.join("results.json")), 2, BUS_CYCLE_MS);
            assert_eq!(measured["mode"], "captured");
            assert_eq!(json(&place.path().join("found.json"))["directions_by"], "connection");
        }
        // A mirror port that gives both ends, in a capture that begins within a repetition.
        let mut both = read(&own.join("plc.pcapng"));
        both.extend(read(&own.join("robot.pcapng")));
        both.retain(|(nanos, _)| *nanos > CONNECTED_NS);
        both.sort_by_key(|(nanos, _)| *nanos);
        let path = place.path().join("both.pcapng");
        write(&path, &both);
        let measured = measure(place.path(), &path, setup);
        assert_same(&measured, &json(&own.join("results.json")), 1, BUS_CYCLE_MS);
        let found = json(&place.path().join("found.json"));
        assert_eq!(found["directions_by"], "content");
        let commands = &found["commands"];
        let count = |key: &str| commands[key].as_u64().unwrap();
        assert!(count("doubled") + 2 >= count("frames") && count("missing") == 0, "{commands}");
        let remarks = found["remarks"].to_string();
        assert!(remarks.contains("a skill was under way when the capture began"), "{remarks}");
    }
}

#[test]
fn lost_and_late_frames_are_counted_and_a_repetition_is_off_by_no_more_than_it_says() {
    let place = tempfile::tempdir().unwrap();
    let faults = ["--fault", "loss=0.01", "--fault", "duplicate=0.01", "--fault", "jitter=300us"];
    let own = run(place.path(), "A", &[&["--reps", "2", "--seed", "11"], &faults[..]].concat());
    let measured = measure(place.path(), &own.join("plc.pcapng"), "A");
    let found = json(&place.path().join("found.json"));
    let of_types = ["rc", "sm", "cm"].map(|kind| found["results"][kind]["repetitions"].clone());
    let all = of_types.iter().flat_map(|all| all.as_array().unwrap());
    let uncertainty = all.map(|one| one["uncertainty_ms"].as_f64().unwrap()).fold(0.0, f64::max);
    assert_same(&measured, &json(&own.join("results.json")), 2, uncertainty + 1.0);
    let feedbacks = &found["feedbacks"];
    let missing =
        feedbacks["missing"].as_u64().unwrap() as f64 / feedbacks["frames"].as_u64().unwrap() as f64;
    assert!((0.005..0.015).contains(&missing), "{missing}");
    let latest = feedbacks["late_ms"][2].as_f64().unwrap();
    assert!((0.25..=0.33).contains(&latest), "{latest}");
}

#[test]
fn tshark_finds_the_same_intervals() {
    let place = tempfile::tempdir().unwrap();
    let more = ["--cyclic", "rt1", "--reps", "1", "--types", "rc", "--fault", "jitter=250us"];
    let own = run(place.path(), "A", &more);
    let capture = own.join("plc.pcapng");
    measure(place.path(), &capture, "A");
    let found = json(&place.path().join("found.json"));
    for (key, sender) in [("commands", "02:00:00:00:00:01"), ("feedbacks", "02:00:00:00:00:02")] {
        let filter =
            format!("pn_rt && eth.src == {sender} && pn_rt.frame_id >= 0x8000 && pn_rt.frame_id < 0xf800");
        let output = Command::new("tshark")
            .args(["-r", capture.to_str().unwrap(), "-Y", &filter, "-T", "fields", "-e", "frame.time_epoch"])
            .output()
            .unwrap();
        let text = String::from_utf8(output.stdout).unwrap();
        let times: Vec<f64> = text.lines().map(|line| line.trim().parse::<f64>().unwrap() * 1e3).collect();
        assert!(times.len() > 3_000, "{} frames by tshark", times.len());
        assert_eq!(found[key]["frames"].as_u64().unwrap() as usize, times.len());
        let intervals = || times.windows(2).map(|pair| pair[1] - pair[0]);
        let mean = intervals().sum::<f64>() / (times.len() - 1) as f64;
        let expected = [mean, intervals().fold(f64::MAX, f64::min), intervals().fold(0.0, f64::max)];
        let own = &found[key]["interval_ms"];
        for (at, expected) in [0, 1, 4].into_iter().zip(expected) {
            let own = own[at].as_f64().unwrap();
            assert!((own - expected).abs() < 2e-6, "{key} {at}: {own} ms, by tshark {expected} ms");
        }
    }
}

/// Replaces one byte string by another of the same length in a frame.
fn renamed(frame: &[u8], from: &[u8], to: &[u8]) -> Vec<u8> {
    let mut frame = frame.to_vec();
    let header = frame.len().min(34);
    for at in 0..header.saturating_sub(from.len()) + 1 {
        if frame[at..].starts_with(from) {
            frame[at..at + to.len()].copy_from_slice(to);
        }
    }
    frame
}

#[test]
fn a_capture_that_cannot_be_measured_is_refused_in_words_and_nothing_is_written() {
    let place = tempfile::tempdir().unwrap();
    let own = run(place.path(), "A", &["--reps", "1", "--types", "cm"]);
    let packets = read(&own.join("plc.pcapng"));
    let (plc, robot) = ([192, 168, 64, 1], [192, 168, 64, 2]);
    let with = |from: &[u8], to: &[u8]| -> Vec<Frame> {
        let other = packets.iter().map(|(nanos, frame)| (nanos + 1_000, renamed(frame, from, to)));
        let mut all: Vec<_> = packets.iter().cloned().chain(other).collect();
        all.sort_by_key(|(nanos, _)| *nanos);
        all
    };
    let bytes = fs::read(own.join("plc.pcapng")).unwrap();
    let sent_by = |address: [u8; 4]| -> Vec<Frame> {
        packets.iter().filter(|(_, frame)| frame.get(26..30) == Some(&address)).cloned().collect()
    };
    let cases: [(&str, Vec<Frame>); 6] = [
        ("two robots", with(&robot, &[192, 168, 64, 77])),
        ("two PLCs", with(&plc, &[192, 168, 64, 78])),
        ("commands only", sent_by(plc)),
        ("feedbacks only", sent_by(robot)),
        ("start only", packets.iter().take_while(|(nanos, _)| *nanos < 500_000_000).cloned().collect()),
        ("empty", Vec::new()),
    ];
    let path = place.path().join("bad.pcapng");
    let mut said = Vec::new();
    let mut refused = |name: &str, setup: &str| {
        let finished = bench(place.path(), ["from-capture", "bad.pcapng", "--setup", setup, "--out", "bad"]);
        assert_eq!(finished.code, Some(2), "{name}: {}", finished.stderr);
        assert!(!place.path().join("bad").exists(), "{name} left a directory");
        said.push(format!("{name}: {}", finished.stderr.trim().replace("error: bad.pcapng: ", "")));
    };
    for (name, packets) in cases {
        write(&path, &packets);
        refused(name, "A");
    }
    let aside = place.path().join("aside");
    fs::create_dir(&aside).unwrap();
    let other = read(&run(&aside, "B", &["--reps", "1", "--types", "cm"]).join("plc.pcapng"));
    let mut both: Vec<_> = packets.iter().cloned().chain(other).collect();
    both.sort_by_key(|(nanos, _)| *nanos);
    write(&path, &both);
    refused("two buses", "A");
    fs::write(&path, &bytes[..400]).unwrap();
    refused("cut", "A");
    fs::write(&path, b"\x1f\x8b\x08\0\0\0\0\0").unwrap();
    refused("compressed", "A");
    fs::write(&path, b"no capture").unwrap();
    refused("text", "A");
    insta::assert_snapshot!(said.join("\n"), @r"
        two robots: 2 robots are in the capture, 192.168.64.2 and 192.168.64.77: choose one by --robot
        two PLCs: 2 PLCs command the robot 192.168.64.2, 192.168.64.1 and 192.168.64.78: capture with one of them
        commands only: only frames to the robot are in the capture, none to the PLC: mirror both directions of the port
        feedbacks only: only frames to the PLC are in the capture, none to the robot: mirror both directions of the port
        start only: no complete repetition in the capture: 1 skill done; 1 single motion not in the plan, such as a move to the start; --application chooses another plan
        empty: no cyclic frame of PROFINET or EtherNet/IP among 0 packets: capture on the cable between PLC and robot, or at a mirror port
        two buses: 2 robots in the capture have the address 192.168.64.2, over EtherNet/IP and over PROFINET RT over UDP: leave the frames of one bus out of the capture
        cut: no cyclic frame of PROFINET or EtherNet/IP among 1 packet: capture on the cable between PLC and robot, or at a mirror port; the capture is cut at byte 400, in the middle of a packet; what comes before is measured
        compressed: the capture is compressed: unpack it by `gunzip` first
        text: not a capture: expected pcap or pcapng, found the bytes [6E, 6F, 20, 63]
        ");
}

#[test]
fn a_capture_that_is_cut_is_measured_up_to_there_and_a_robot_of_several_can_be_chosen() {
    let place = tempfile::tempdir().unwrap();
    let own = run(place.path(), "B", &["--reps", "1", "--types", "cm"]);
    let path = place.path().join("plc.pcapng");
    let bytes = fs::read(own.join("plc.pcapng")).unwrap();
    fs::write(&path, &bytes[..bytes.len() - 9]).unwrap();
    let measured = measure(place.path(), &path, "B");
    assert_eq!(samples(&measured, "cm").len(), 1);
    assert!(
        measured["connection_remarks"]
            .to_string()
            .contains("in the middle of a packet; what comes before is measured")
    );
    // A capture that was joined to another one of an earlier time.
    let once = read(&own.join("plc.pcapng"));
    write(&path, &[&once[..], &once].concat());
    let measured = measure(place.path(), &path, "B");
    assert_same(&measured, &json(&own.join("results.json")), 0, BUS_CYCLE_MS);
    assert_eq!(samples(&measured, "cm").len(), 2);
    let other = read(&own.join("plc.pcapng")).into_iter();
    let other =
        other.map(|(nanos, frame)| (nanos + 5, renamed(&frame, &[192, 168, 64, 2], &[192, 168, 64, 9])));
    let mut both = read(&own.join("plc.pcapng"));
    both.extend(other);
    both.sort_by_key(|(nanos, _)| *nanos);
    write(&path, &both);
    for (robot, code) in [("192.168.64.9", 0), ("192.168.64.3", 2)] {
        let all = ["from-capture", "plc.pcapng", "--setup", "B", "--out", robot, "--robot", robot];
        let finished = bench(place.path(), all);
        assert_eq!(finished.code, Some(code), "{}", finished.stderr);
    }
}

#[cfg(unix)]
#[test]
fn a_pipe_in_place_of_a_capture_is_refused_before_anything_waits_for_its_writer() {
    let place = tempfile::tempdir().unwrap();
    assert!(Command::new("mkfifo").arg(place.path().join("tap.pcap")).status().unwrap().success());
    let refused = bench(place.path(), ["from-capture", "tap.pcap", "--setup", "A"]);
    assert_eq!(refused.code, Some(2), "{}", refused.stderr);
    insta::assert_snapshot!(refused.stderr, @"error: cannot read tap.pcap: it is a pipe or a device; give the path of a file");
    assert!(!place.path().join("runs").exists());
}
