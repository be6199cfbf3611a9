//! The studies from the command line: their output, their files, and the input that they refuse.

use std::io::{BufRead as _, BufReader, Read as _};
use std::path::Path;
use std::process::{Command, Stdio};

use rustix::process::{Pid, Signal, kill_process};
use studies::sensitivity::{Factor, Sensitivity};
use studies::sweep::Sweep;

use crate::program::{Finished, bench};

fn study(directory: &Path, arguments: &str) -> Finished {
    bench(directory, arguments.split(' '))
}

fn read(directory: &Path, name: &str) -> String {
    std::fs::read_to_string(directory.join(name)).unwrap()
}

#[test]
fn a_sweep_writes_a_page_a_table_and_the_points() {
    let place = tempfile::tempdir().unwrap();
    let finished = study(
        place.path(),
        "sweep --depths 2 --cycles 1,64 --lengths 2 --motions 8 --reps 1 --out study --export-csv points.csv",
    );
    assert_eq!(finished.code, Some(0), "{}", finished.stderr);
    assert!(
        finished.stdout.contains("2 slots") && finished.stdout.contains("bus 64 ms"),
        "{}",
        finished.stdout
    );
    assert!(finished.stderr.starts_with("sweep "), "progress on stderr: {}", finished.stderr);
    let sweep: Sweep = serde_json::from_str(&read(place.path(), "study/sweep.json")).unwrap();
    assert_eq!(sweep.points.len(), 2);
    assert_eq!(read(place.path(), "points.csv"), read(place.path(), "study/sweep.csv"));
    let page = read(place.path(), "study/sweep.html");
    assert_eq!(page.matches("<svg").count(), 2, "in both widths");
    let page = page.replace("http://www.w3.org/2000/svg", "");
    assert!(!page.contains("http://") && !page.contains("<script"));
    assert!(place.path().join("study/setup.toml").exists());
}

#[test]
fn a_sweep_with_a_bus_cycle_that_the_bus_does_not_support_is_refused_before_it_runs() {
    let place = tempfile::tempdir().unwrap();
    let finished = study(place.path(), "sweep --cycles 1,3 --out study");
    assert_eq!(finished.code, Some(2));
    assert!(finished.stderr.contains("3000 µs is not a PROFINET cycle"), "{}", finished.stderr);
    assert!(!place.path().join("study").exists());
    assert_eq!(study(place.path(), "sweep --depths 6").code, Some(2));
}

#[test]
fn the_sensitivity_of_setup_a_agrees_with_the_model() {
    let place = tempfile::tempdir().unwrap();
    let finished = study(
        place.path(),
        "sensitivity --factors 0,0.5,2 --reps 1 --quiet --export-json figures.json --out study",
    );
    assert_eq!((finished.code, finished.stderr.as_str()), (Some(0), ""));
    let study: Sensitivity = serde_json::from_str(&read(place.path(), "figures.json")).unwrap();
    let page = read(place.path(), "study/sensitivity.html");
    assert_eq!(page.matches("<svg").count(), 2, "in both widths");
    assert!(page.contains("moves that most") && page.contains("is refused: ") && !page.contains("<script"));
    let share = |factor, times| {
        let row = study.rows.iter().find(|row| (row.factor, row.times) == (factor, times)).unwrap();
        row.calibrated.aet_improvement
    };
    let as_it_is = share(None, 1.0).unwrap();
    let improvement = |factor, times| share(Some(factor), times).unwrap();
    assert!(improvement(Factor::Overhead, 0.0) < improvement(Factor::Overhead, 0.5));
    assert!(improvement(Factor::Overhead, 0.5) < as_it_is && as_it_is < improvement(Factor::Overhead, 2.0));
    assert!(improvement(Factor::Motions, 0.5) < as_it_is && as_it_is < improvement(Factor::Motions, 2.0));
    assert!(improvement(Factor::Approximation, 0.0) < as_it_is, "without blending CM stops as SM does");
    let base = study.rows.first().unwrap();
    assert_eq!(base.without_skill_overhead.aet_improvement, share(Some(Factor::Overhead), 0.0));
    assert!(base.uncalibrated.rc_ms < base.calibrated.rc_ms, "at rated speeds");
    // Twice the size is out of the arm's reach, and half of an acceleration of 0 is none: both rows tell so.
    let refused = |factor, times| {
        let row = study.rows.iter().find(|row| (row.factor, row.times) == (Some(factor), times)).unwrap();
        row.refused.clone().unwrap()
    };
    let told = finished.stdout.replace("\n ", "");
    assert!(told.contains(&refused(Factor::Length, 2.0)), "{}", finished.stdout);
    assert!(refused(Factor::Acceleration, 0.0).contains("motions.acceleration_percent"));
    assert_eq!(read(place.path(), "study/sensitivity.csv").lines().count(), 1 + study.rows.len());
}

#[test]
fn a_study_does_not_write_into_a_run() {
    let place = tempfile::tempdir().unwrap();
    std::fs::create_dir(place.path().join("run")).unwrap();
    for file in ["samples.csv", "setup.toml", "application.toml"] {
        std::fs::write(place.path().join("run").join(file), "of the run").unwrap();
    }
    for verb in ["sensitivity --factors 1 --reps 1", "explore --kinds lose"] {
        let finished = study(place.path(), &format!("{verb} --quiet --out run"));
        assert!(
            finished.stderr.contains("run holds a run already; choose another directory by --out"),
            "{}",
            finished.stderr
        );
        assert_ne!(finished.code, Some(0));
        for file in std::fs::read_dir(place.path().join("run")).unwrap() {
            assert_eq!(std::fs::read_to_string(file.unwrap().path()).unwrap(), "of the run");
        }
    }
}

#[test]
fn a_study_that_cannot_be_saved_is_refused_before_it_runs() {
    let place = tempfile::tempdir().unwrap();
    std::fs::write(place.path().join("file"), "").unwrap();
    std::fs::create_dir(place.path().join("directory")).unwrap();
    for (option, refusal) in [
        ("--out file/below", "cannot make the directory file/below"),
        ("--export-json directory", "directory is a directory; name a file"),
        ("--export-csv missing/figures.csv", "cannot write to missing"),
    ] {
        for verb in ["sweep", "sensitivity"] {
            let finished = study(place.path(), &format!("{verb} --reps 1 {option}"));
            assert!(finished.stderr.contains(refusal), "{verb} {option}: {}", finished.stderr);
            assert_eq!(finished.stderr.lines().count(), 1, "no progress before it: {}", finished.stderr);
            assert_eq!(finished.stdout, "");
        }
    }
}

/// Starts a command of the bench that takes long on every machine, sends it a signal at the first line of its progress that
/// counts `jobs` or more, and returns what it printed.
fn interrupted(directory: &Path, arguments: &str, jobs: u32, signal: Signal) -> Finished {
    let mut bench = Command::new(env!("CARGO_BIN_EXE_bench"))
        .current_dir(directory)
        .args(arguments.split(' '))
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut progress = BufReader::new(bench.stderr.take().unwrap());
    let mut stderr = String::new();
    loop {
        let before = stderr.len();
        assert_ne!(progress.read_line(&mut stderr).unwrap(), 0, "it has ended: {stderr}");
        let count = stderr[before..].split('/').next().and_then(|words| words.split(' ').next_back());
        if jobs == 0 || count.and_then(|count| count.parse().ok()).is_some_and(|count: u32| count >= jobs) {
            break;
        }
    }
    kill_process(Pid::from_child(&bench), signal).unwrap();
    progress.read_to_string(&mut stderr).unwrap();
    let ended = bench.wait_with_output().unwrap();
    Finished { code: ended.status.code(), stdout: String::from_utf8(ended.stdout).unwrap(), stderr }
}

#[test]
fn an_interrupted_study_prints_what_it_measured_so_far_and_how_much_that_is() {
    let place = tempfile::tempdir().unwrap();
    // A closed terminal sends the third one.
    let hang_up = if cfg!(feature = "real") { Signal::HUP } else { Signal::INT };
    let cases = [
        ("sweep --cycles 1 --reps 60", Signal::INT, "points", " slot"),
        ("sensitivity --reps 60", hang_up, "cases", " as it is "),
        ("calibrate --seeds 2 --reps 5", Signal::TERM, "numbers", "# robot.interpreter_quantum_us: "),
        ("explore --types cm --kinds lose --out explored", hang_up, "runs", "to go on"),
    ];
    for (arguments, signal, things, figure) in cases {
        let Finished { code, stdout, stderr } = interrupted(place.path(), arguments, 0, signal);
        assert_eq!(code, Some(130), "{arguments}: {stderr}");
        let line = stderr.lines().find(|line| line.starts_with("interrupted, ")).unwrap();
        let (done, all) = line.strip_prefix("interrupted, ").unwrap().split_once(" of ").unwrap();
        let (done, all): (u32, u32) =
            (done.parse().unwrap(), all.strip_suffix(things).unwrap().trim().parse().unwrap());
        assert!(done < all, "{arguments}: {line}");
        assert_eq!(done > 0, stdout.contains(figure), "{arguments}: {line}\n{stdout}");
    }
}

#[test]
fn an_interrupted_study_saves_what_it_measured_so_far_and_says_that_it_is_a_part() {
    let place = tempfile::tempdir().unwrap();
    // The first jobs of the sweep are the robot's own programs, and three jobs are a case.
    let cases = [("sweep", "--cycles 1 --reps 40", 9, "points"), ("sensitivity", "--reps 40", 3, "cases")];
    for (study, options, jobs, things) in cases {
        let arguments = format!("{study} {options} --out {study}");
        let Finished { code, stderr, .. } = interrupted(place.path(), &arguments, jobs, Signal::INT);
        assert_eq!(code, Some(130), "{stderr}");
        let line = stderr.lines().find(|line| line.starts_with("interrupted, ")).unwrap();
        let saved = |file| std::fs::read_to_string(place.path().join(study).join(study).with_extension(file));
        assert!(saved("html").unwrap().contains(line), "{line}");
        let (done, all) = line.strip_prefix("interrupted, ").unwrap().split_once(" of ").unwrap();
        let all = all.strip_suffix(things).unwrap().trim();
        assert!(saved("json").unwrap().contains(&format!("\"planned\": {all},")), "{line}");
        assert_eq!(saved("csv").unwrap().lines().count(), 1 + done.parse::<usize>().unwrap());
    }
}

#[test]
fn an_interrupted_soak_prints_what_it_lived_through_so_far() {
    let place = tempfile::tempdir().unwrap();
    let arguments = "soak --hours 1000 --life-minutes 1 --threads 1";
    let Finished { code, stdout: summary, stderr } = interrupted(place.path(), arguments, 0, Signal::TERM);
    assert!(stderr.starts_with("soak "), "{stderr}");
    assert_eq!(code, Some(130), "{stderr}");
    assert!(stderr.contains("interrupted, ") && stderr.contains(" of 60000 lives\n"), "{stderr}");
    assert!(summary.contains(" hours of the plant in ") && summary.contains("0 altered."), "{summary}");
}

/// Returns the figures of a call: its output up to the seconds that it took here.
fn figures(finished: &Finished) -> String {
    let before = |line: &str| {
        line.split(" s here")
            .next()
            .and_then(|text| text.rsplit_once(' '))
            .map_or_else(|| line.to_owned(), |(figures, _)| figures.to_owned())
    };
    finished.stdout.lines().map(before).collect::<Vec<_>>().join("\n")
}

#[test]
fn a_soak_and_a_judge_that_were_killed_go_on_to_the_same_file_and_refuse_other_options() {
    let place = tempfile::tempdir().unwrap();
    let cases = [
        ("soak --hours 0.1 --life-minutes 1 --quiet", "lives.csv", "--seed 2", "--seed 1 "),
        ("judge --lists 1500 --quiet", "lists.csv", "--ignore stuck", "--setup A --lists 1500 --seed 1"),
    ];
    for (verb, file, other, known) in cases {
        let call = |options: &str| study(place.path(), &format!("{verb} {options}"));
        let read = |out: &str| std::fs::read_to_string(place.path().join(out).join(file)).unwrap();
        let one = call(&format!("--threads 1 --out one-{file}"));
        assert_eq!(one.code, Some(0), "{}{}", one.stdout, one.stderr);
        let whole = read(&format!("one-{file}"));
        assert_eq!(whole.lines().count(), 7, "{whole}");
        // Killed while it wrote the fourth line.
        let cut = whole.match_indices('\n').nth(3).unwrap().0 + 9;
        let path = place.path().join(format!("one-{file}")).join(file);
        std::fs::write(&path, &whole[..cut]).unwrap();
        let again = call(&format!("--threads 2 --out one-{file}"));
        assert_eq!((again.code, figures(&again)), (Some(0), figures(&one)), "{}", again.stderr);
        assert_eq!(read(&format!("one-{file}")), whole);
        let refused = call(&format!("{other} --out one-{file}"));
        assert_eq!(refused.code, Some(2), "{}", refused.stderr);
        assert!(
            refused.stderr.contains("other options; use another --out") && refused.stderr.contains(known),
            "{}",
            refused.stderr
        );
        assert_eq!(read(&format!("one-{file}")), whole);
    }
    std::fs::create_dir(place.path().join("old")).unwrap();
    std::fs::write(place.path().join("old/A-stuck-7.toml"), "").unwrap();
    let old = study(place.path(), "judge --lists 5 --quiet --out old");
    assert_eq!(old.code, Some(2), "{}", old.stderr);
    assert!(
        old.stderr.contains("A-stuck-7.toml without study.json, so its options are not known"),
        "{}",
        old.stderr
    );
}

#[cfg(feature = "real")]
#[test]
fn a_closed_terminal_ends_a_measurement_in_order_and_its_part_can_be_read() {
    let place = tempfile::tempdir().unwrap();
    let arguments = "--mode virtual --reps 10000 --types rc,cm --out run --without race";
    let Finished { code, stdout, stderr } = interrupted(place.path(), arguments, 3, Signal::HUP);
    assert_eq!(code, Some(130), "{stderr}");
    assert!(stdout.contains("Interrupted, ") && stdout.contains(" of 20000 "), "{stdout}");
    let results: serde_json::Value = serde_json::from_str(&read(place.path(), "run/results.json")).unwrap();
    assert_eq!(results["status"], "interrupted");
    assert!(read(place.path(), "run/samples.csv").lines().count() > 3);
    let report = study(place.path(), "report run");
    assert_eq!(report.code, Some(0), "{}", report.stderr);
}

#[cfg(feature = "real")]
#[test]
fn a_file_beyond_the_limit_of_the_shell_is_refused_in_words_and_no_signal_ends_the_bench() {
    let place = tempfile::tempdir().unwrap();
    for arguments in ["--mode virtual --types rc --reps 300 --out run", "buses --reps 30 --out buses"] {
        let script = format!("ulimit -f 12; exec \"$BENCH\" {arguments}");
        let ended = Command::new("sh")
            .args(["-c", &script])
            .env("BENCH", env!("CARGO_BIN_EXE_bench"))
            .current_dir(place.path())
            .output()
            .unwrap();
        let stderr = String::from_utf8(ended.stderr).unwrap();
        assert_eq!(ended.status.code(), Some(1), "{arguments}: {stderr}");
        assert!(stderr.contains("File too large"), "{arguments}: {stderr}");
    }
}

#[cfg(feature = "real")]
#[test]
fn a_verb_that_has_nothing_to_save_also_ends_with_130_at_either_signal() {
    let place = tempfile::tempdir().unwrap();
    for signal in [Signal::INT, Signal::TERM] {
        let Finished { code, stderr, .. } = interrupted(place.path(), "doctor --seconds 3600", 0, signal);
        assert_eq!(code, Some(130), "{stderr}");
    }
}
