//! `bench study`: rows that depend on nothing but the jobs, studies that go on after a kill, and the input that it refuses.

use std::process::{Command, Stdio};
use std::{fs, thread, time};

use crate::study_calls::{merged, place, read, study};

const SMALL: &str = "[study]
setup = \"A\"
types = [\"cm\"]
reps = 1
seeds = \"1..=16\"

[[vary]]
key = \"motions.approximation_mm\"
values = [0.0, 10.0, 1000.0]

[[vary]]
key = \"robot.skill_overhead_us\"
normal = { mean = 133000.0, sd = 500.0, min = 130000.0, max = 136000.0 }

[[finding]]
figure = \"execution_ns\"
above = 4e9
";

#[test]
fn one_seven_and_sixty_four_shards_give_one_digest() {
    let place = place(SMALL);
    let place = place.path();
    let whole = study(place, "run study.toml --out whole --quiet");
    // A zone of a metre is refused: also such a job has its rows.
    assert_eq!(whole.code, Some(4), "{}{}", whole.stdout, whole.stderr);
    assert!(whole.stdout.starts_with("48 jobs, 16 did not pass, "), "{}", whole.stdout);
    let digest = merged(place, "whole", "merged-1");
    for count in [7, 64] {
        for index in (0..count).rev() {
            let out = format!("split-{count}/shard-{index}");
            let ran = study(
                place,
                &format!("run study.toml --out {out} --shard {index}/{count} --threads 1 --quiet"),
            );
            assert!(matches!(ran.code, Some(0 | 4)), "{}", ran.stderr);
        }
        assert_eq!(
            merged(place, &format!("split-{count}"), &format!("merged-{count}")),
            digest,
            "{count} shards"
        );
    }
    let (rows, jobs) = (read(place, "merged-7/rows.csv"), read(place, "merged-7/jobs.csv"));
    assert_eq!((rows.lines().count(), jobs.lines().count()), (49, 49));
    assert!(rows.lines().all(|line| line.len() <= 100));
    let schema = read(place, "merged-7/rows.schema.json");
    let schema: serde_json::Value = serde_json::from_str(&schema).unwrap();
    let names: Vec<_> =
        schema["fields"].as_array().unwrap().iter().map(|field| field["name"].as_str().unwrap()).collect();
    assert_eq!(rows.lines().next(), Some(names.join(",").as_str()));
    assert_eq!(merged(place, "merged-7", "again"), digest, "a merged study is a study");
}

#[test]
fn a_study_that_is_killed_goes_on_and_runs_no_finished_job_again() {
    let place = place(&SMALL.replace("reps = 1", "reps = 5"));
    let place = place.path();
    let digest = {
        study(place, "run study.toml --out whole --quiet");
        merged(place, "whole", "merged")
    };
    let mut killed = 0;
    for _ in 0..4 {
        let mut running = Command::new(env!("CARGO_BIN_EXE_bench"))
            .current_dir(place)
            .args(["study", "run", "study.toml", "--out", "killed", "--threads", "2", "--quiet"])
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        let jobs =
            || fs::read_to_string(place.join("killed/jobs.csv")).map_or(0, |text| text.lines().count());
        let before = jobs();
        // It waits for progress, not for a time.
        while running.try_wait().unwrap().is_none() && jobs() < before.max(1) + 4 {
            thread::sleep(time::Duration::from_millis(1));
        }
        killed += u32::from(running.try_wait().unwrap().is_none());
        running.kill().unwrap();
        running.wait().unwrap();
    }
    assert!(killed > 1, "it was too quick to be killed");
    let status = study(place, "status killed");
    assert!(status.stdout.contains("of 48 jobs are done"), "{}", status.stdout);
    let before = read(place, "killed/rows.csv");
    let whole_before = &before[..before.rfind('\n').unwrap()];
    study(place, "run study.toml --out killed --quiet");
    let after = read(place, "killed/rows.csv");
    // A job that was being written is made again; all before it stay.
    let kept = whole_before.lines().count().saturating_sub(5);
    assert!(after.lines().take(kept).eq(before.lines().take(kept)), "saving rewrites nothing");
    assert_eq!(merged(place, "killed", "merged-killed"), digest);
}

#[test]
fn what_is_not_this_study_is_refused_in_words_and_nothing_is_written() {
    let place = place(SMALL);
    let place = place.path();
    let refused = |arguments: &str| {
        let finished = study(place, arguments);
        assert_eq!(finished.code, Some(2), "{arguments}: {}{}", finished.stdout, finished.stderr);
        finished.stderr
    };
    study(place, "run study.toml --out whole --quiet");
    let rows = read(place, "whole/rows.csv");
    assert!(
        refused("run study.toml --out whole --shard 1/7")
            .contains("has shard 0/1 of this study, and this is 1/7")
    );
    assert!(refused("run study.toml --shard 7/7").contains("7 shards have the numbers 0 to 6"));
    fs::write(place.join("other.toml"), SMALL.replace("..=16", "..=17")).unwrap();
    assert!(refused("run other.toml --out whole").contains("has rows of another study; use another --out"));
    fs::write(place.join("typing.toml"), SMALL.replace("skill_overhead_us", "skil_overhead_us")).unwrap();
    assert!(refused("run typing.toml").contains("did you mean `robot.skill_overhead_us`?"));
    fs::write(place.join("open.toml"), SMALL.replace(", min = 130000.0, max = 136000.0", "")).unwrap();
    assert!(refused("run open.toml").contains("`min`"));
    let grid = "[study]\nsetup = \"A\"\nseeds = \"1..=1000000\"\n[[vary]]\nkey = \"motions.velocity_percent\"\nrange = { from = 1.0, to = 100.0, steps = 1000000 }\n";
    fs::write(place.join("grid.toml"), grid).unwrap();
    let said = refused("run grid.toml --out grid");
    assert!(
        said.contains("1,000,000,000,000 jobs")
            && said.contains(" years and ")
            && said.contains(" PB of disk"),
        "{said}"
    );
    assert!(!place.join("grid").exists());
    study(place, "run study.toml --out part --shard 0/2 --quiet");
    assert!(refused("merge part --out merged").contains("shard 1/2: missing"));
    assert!(refused("merge part whole --out merged").contains("merge those of one split"));
    assert!(refused("merge whole --out whole").contains("is merged itself"));
    let described = read(place, "whole/study.json");
    let program = |program: &str| {
        let mut value: serde_json::Value = serde_json::from_str(&described).unwrap();
        value["program"] = program.into();
        fs::write(place.join("whole/study.json"), value.to_string()).unwrap();
    };
    program("0123456789ab");
    assert!(refused("run study.toml --out whole").contains("has rows of program 0123456789ab, and this is "));
    fs::write(
        place.join("whole/study.json"),
        described.replace("\"schema_version\": 1", "\"schema_version\": 0"),
    )
    .unwrap();
    assert!(
        refused("run study.toml --out whole")
            .contains("rows of version 0, and this program continues version 1")
    );
    assert_eq!(read(place, "whole/rows.csv"), rows, "nothing was written");
    fs::create_dir(place.join("old")).unwrap();
    fs::write(place.join("old/rows.csv"), "of another program\n").unwrap();
    assert!(refused("run study.toml --out old").contains("holds another rows.csv, which would be replaced"));
    let missing = Command::new(env!("CARGO_BIN_EXE_bench"))
        .current_dir(place)
        .env("PATH", "")
        .args(["study", "submit", "study.toml", "--engine", "slurm", "--shards", "2", "--out", "cluster"])
        .output()
        .unwrap();
    assert_eq!(missing.status.code(), Some(5));
    assert!(String::from_utf8(missing.stderr).unwrap().contains("Debian has it in slurm-wlm"));
}

#[test]
fn a_job_that_fails_ends_with_code_4_and_runs_again_with_everything_kept_by_the_printed_command() {
    let text = "[study]\nsetup = \"A\"\ntypes = [\"cm\"]\nreps = 1\nseeds = \"3\"\n\
                [[vary]]\nkey = \"faults\"\nvalues = [\"\", \"cut-at=1s..4s\"]\n";
    let place = place(text);
    let place = place.path();
    let ran = study(place, "run study.toml --out faults --quiet");
    assert_eq!(ran.code, Some(4), "{}{}", ran.stdout, ran.stderr);
    assert!(ran.stdout.starts_with("2 jobs, 1 did not pass."), "{}", ran.stdout);
    let command = ran.stdout.split("bench study ").nth(1).unwrap().lines().next().unwrap();
    let rerun = study(place, command);
    assert_eq!(rerun.code, Some(4), "it fails again: {}{}", rerun.stdout, rerun.stderr);
    let job = command.rsplit(' ').next().unwrap();
    let run = place.join("faults").join(job).join("run");
    for file in ["samples.csv", "report.html", "plc.pcapng", "robot.pcapng"] {
        assert!(run.join(file).exists(), "{file}");
    }
    let passed = read(place, "faults/rows.csv");
    let passed = passed.lines().find(|line| line.ends_with(",passed")).unwrap();
    let rerun = study(place, &format!("rerun faults {} --out again", passed.split(',').next().unwrap()));
    assert_eq!(rerun.code, Some(0), "{}", rerun.stderr);
    let samples = read(place, "again/run/samples.csv");
    let ms: f64 = samples.lines().nth(1).unwrap().split(',').nth(2).unwrap().parse().unwrap();
    let ns: f64 = passed.split(',').nth(4).unwrap().parse().unwrap();
    assert_eq!((ms * 1e6).round(), ns, "the same time as in the study");
    assert_eq!(study(place, "rerun faults 0000000000000000").code, Some(2));
}
