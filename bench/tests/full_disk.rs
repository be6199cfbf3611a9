//! A full disk: earlier results stay readable, no partly written file replaces a file, and the error says what to do.
//!
//! The disks are file systems in memory, in a mount namespace of each test, which needs the same permission as networks.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::fs;
use std::path::Path;
use std::process::{Command, ExitCode};

fn main() -> ExitCode {
    networked_tests::run(networked_tests::tests![
        a_run_ends_in_order_at_whatever_point_the_disk_becomes_full_and_its_files_can_be_read,
        a_report_without_room_on_the_disk_keeps_the_old_one,
        a_baseline_without_room_on_the_disk_keeps_the_old_one,
        a_study_on_a_full_disk_ends_in_words_and_goes_on_when_there_is_room,
        a_real_run_on_a_full_disk_ends_with_the_reason_and_leaves_nothing_running,
    ])
}

/// Output of a script on a small disk.
struct Finished {
    code: Option<i32>,
    stdout: String,
    stderr: String,
}

/// Runs a script in `place`, with a disk of this many KiB at `disk` and the bench as `$BENCH`.
fn on_a_disk(place: &Path, kib: u32, script: &str) -> Finished {
    let script = format!("mkdir -p disk && mount -t tmpfs -o size={kib}k tmpfs disk\n{script}");
    let output = Command::new("unshare")
        .args(["--mount", "sh", "-c", &script])
        .env("BENCH", env!("CARGO_BIN_EXE_bench"))
        .current_dir(place)
        .output()
        .unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    Finished { code: output.status.code(), stdout: text(output.stdout), stderr: text(output.stderr) }
}

const FULL: &str = "No space left on device";

/// How a run on a small disk ended.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
enum End {
    BeforeTheFirstRepetition,
    AmongTheRepetitions,
    BehindTheLastRepetition,
    AtTheReport,
    Whole,
}

/// Executes a run with 100 repetitions on a disk of this many KiB, and checks what remains there.
fn run_into(kib: u32) -> End {
    let place = tempfile::tempdir().unwrap();
    let script = "
        $BENCH --mode virtual --types cm --reps 100 --out disk/run
        code=$?
        $BENCH report disk/run --out report.html >said 2>&1; echo $? >code
        cp -r disk/run copy
        exit $code";
    let Finished { code, stdout, stderr } = on_a_disk(place.path(), kib, script);
    let copy = place.path().join("copy");
    let left: Vec<_> = fs::read_dir(&copy)
        .map(|files| files.map(|file| file.unwrap().file_name().into_string().unwrap()).collect())
        .unwrap_or_default();
    assert!(!left.iter().any(|name| name.ends_with(".new")), "{kib} KiB: half a file is left: {left:?}");
    let samples = fs::read_to_string(copy.join("samples.csv")).unwrap_or_default();
    assert!(samples.is_empty() || samples.ends_with('\n'), "{kib} KiB: half a line is left");
    let saved = samples.lines().count().saturating_sub(1);
    let report = fs::read_to_string(place.path().join("code")).unwrap();
    let printed = fs::read_to_string(place.path().join("said")).unwrap();
    if stderr.contains("but their report is not") {
        assert_eq!((code, report.trim(), saved), (Some(0), "0", 100), "{kib} KiB: {stderr}{printed}");
        assert!(
            stderr.contains(FULL) && stderr.contains("`bench report disk/run` draws it again"),
            "{stderr}"
        );
        return End::AtTheReport;
    }
    if code == Some(0) {
        assert_eq!(
            (report.trim(), saved, stderr.contains(FULL)),
            ("0", 100, false),
            "{kib} KiB: {stderr}{printed}"
        );
        return End::Whole;
    }
    assert_eq!(code, Some(1), "{kib} KiB: {stderr}");
    assert!(stderr.contains("cannot write disk/run/") && stderr.contains(FULL), "{kib} KiB: {stderr}");
    if !copy.join("results.json").exists() {
        assert!(!report.starts_with('0') && printed.contains("disk/run"), "{printed}");
        return End::BeforeTheFirstRepetition;
    }
    assert_eq!(report.trim(), "0", "{kib} KiB: what was saved cannot be read: {printed}");
    if saved == 0 {
        return End::BeforeTheFirstRepetition;
    }
    assert!(stdout.contains("CM"), "what was measured is shown: {stdout}");
    assert!(stdout.contains("as far as the disk took it"), "{stdout}");
    if saved == 100 {
        return End::BehindTheLastRepetition;
    }
    assert!(stderr.contains("the run ends here, since the disk does not take its results"), "{stderr}");
    End::AmongTheRepetitions
}

fn a_run_ends_in_order_at_whatever_point_the_disk_becomes_full_and_its_files_can_be_read() {
    let sizes =
        (4..48).step_by(4).chain((48..96).step_by(8)).chain((304..=1_024).step_by(256)).chain([8_192]);
    let ends: Vec<End> = sizes.map(run_into).collect();
    assert!(ends.is_sorted(), "a larger disk takes more: {ends:?}");
    for end in
        [End::BeforeTheFirstRepetition, End::AmongTheRepetitions, End::BehindTheLastRepetition, End::Whole]
    {
        assert!(ends.contains(&end), "no disk was full {end:?}: {ends:?}");
    }
}

fn a_report_without_room_on_the_disk_keeps_the_old_one() {
    let place = tempfile::tempdir().unwrap();
    let script = "
        $BENCH --mode virtual --types cm --reps 2 --out disk/run --quiet >/dev/null || exit 9
        echo old >disk/run/report.html
        cat /dev/zero >disk/rest 2>/dev/null
        $BENCH report disk/run
        code=$?
        cp -r disk/run copy
        exit $code";
    let finished = on_a_disk(place.path(), 4_096, script);
    assert_eq!(finished.code, Some(1), "{}", finished.stderr);
    insta::assert_snapshot!(finished.stderr, @"error: the run is as it was; name a file that can be written by --out: cannot write disk/run/report.html: No space left on device (os error 28)");
    assert_eq!(fs::read_to_string(place.path().join("copy/report.html")).unwrap(), "old\n");
    assert!(!place.path().join("copy/report.html.new").exists());
}

fn a_baseline_without_room_on_the_disk_keeps_the_old_one() {
    let place = tempfile::tempdir().unwrap();
    let baseline =
        fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("baselines/A.json")).unwrap();
    fs::write(place.path().join("A.json"), &baseline).unwrap();
    let script = "
        cp A.json disk/A.json
        cat /dev/zero >disk/rest 2>/dev/null
        $BENCH gate --setup A --baseline disk/A.json --update
        code=$?
        mkdir copy && cp disk/A.json* copy
        exit $code";
    let finished = on_a_disk(place.path(), 64, script);
    assert_eq!((finished.code, finished.stdout.as_str()), (Some(1), ""), "{}", finished.stderr);
    insta::assert_snapshot!(finished.stderr, @"error: no baseline was changed; run this from the repository's root, or name a file that can be written by --baseline: cannot write disk/A.json: No space left on device (os error 28)");
    assert_eq!(fs::read_to_string(place.path().join("copy/A.json")).unwrap(), baseline);
    assert_eq!(fs::read_dir(place.path().join("copy")).unwrap().count(), 1);
}

fn a_study_on_a_full_disk_ends_in_words_and_goes_on_when_there_is_room() {
    let place = tempfile::tempdir().unwrap();
    let study = "[study]\nsetup = \"A\"\ntypes = [\"cm\"]\nreps = 1\nseeds = \"1..=400\"\n";
    fs::write(place.path().join("study.toml"), study).unwrap();
    // The disk fills when the first jobs are saved, which the estimate before them does not see.
    let script = "
        $BENCH study run study.toml --out disk/study --quiet >/dev/null &
        until [ \"$(wc -l 2>/dev/null <disk/study/jobs.csv)\" -gt 3 ] 2>/dev/null; do :; done
        cat /dev/zero >disk/rest 2>/dev/null
        wait $!
        echo $? >code
        tail -c 1 disk/study/rows.csv | od -An -c >end
        rm disk/rest
        $BENCH study run study.toml --out disk/study --quiet >/dev/null || exit 9
        $BENCH study run study.toml --out whole --quiet >/dev/null || exit 9
        $BENCH study merge disk/study --out one && $BENCH study merge whole --out other";
    let finished = on_a_disk(place.path(), 4_096, script);
    assert_eq!(finished.code, Some(0), "{}", finished.stderr);
    let text = |name| fs::read_to_string(place.path().join(name)).unwrap();
    assert_eq!(text("code").trim(), "5", "{}", finished.stderr);
    assert_eq!(text("end").trim(), "\\n", "half a line is left");
    assert!(
        finished.stderr.contains("cannot write disk/study/") && finished.stderr.contains(FULL),
        "{}",
        finished.stderr
    );
    let digests: Vec<_> = finished.stdout.lines().filter(|line| line.starts_with("digest ")).collect();
    assert!(matches!(digests[..], [one, other] if one == other), "{}", finished.stdout);
}

/// The captures and both nodes' rows fill the disk while the arm moves.
fn a_real_run_on_a_full_disk_ends_with_the_reason_and_leaves_nothing_running() {
    let place = tempfile::tempdir().unwrap();
    let script = "$BENCH --mode real --types cm --reps 3 --capture always --out disk/run";
    let finished = on_a_disk(place.path(), 512, script);
    assert_eq!(finished.code, Some(1), "{}", finished.stderr);
    assert!(
        finished.stderr.contains("cannot write") && finished.stderr.contains(FULL),
        "{}",
        finished.stderr
    );
}
