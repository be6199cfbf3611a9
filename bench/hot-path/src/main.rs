//! Counts the instructions of all hot paths by callgrind and compares them with the committed counts.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

use anyhow::{Context as _, anyhow, bail, ensure};
use clap::Parser;
use comfy_table::{CellAlignment, Table, presets};
use serde::{Deserialize, Serialize};

/// Largest allowed excess over a path's committed count.
const LIMIT_PERCENT: f64 = 1.0;

/// glibc selects its copy functions by the processor, and each selection takes a different number of
/// instructions (a class 1 frame 655 or 834). These switches leave only one selection: an emulated EPYC Milan then
/// counts the same as an Intel Xeon, and a Nehalem, which has no AVX, at most 0.5 % more.
const ONE_PICK: &str =
    "glibc.cpu.hwcaps=-AVX,-AVX2,-AVX512F,-AVX512VL,-AVX_Fast_Unaligned_Load,-FMA,-FMA4,-ERMS,-FSRM";

/// Counts the instructions of the hot paths and fails with exit code 3 where one takes over 1 % more than committed.
#[derive(Parser, Debug)]
#[command(name = "hot-path", version)]
struct Cli {
    /// The committed counts.
    #[arg(long, value_name = "FILE", default_value = "bench/baselines/instructions.json")]
    baseline: PathBuf,
    /// Write the counts there in place of judging them.
    #[arg(long)]
    update: bool,
}

/// Counts, with the compiler and library that they depend on.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct InstructionCounts {
    /// Output of `rustc --version`.
    compiler: String,
    /// The C library, which contains the copy and sine functions.
    libc: String,
    /// Instructions of each path.
    instructions: BTreeMap<String, u64>,
}

fn main() -> ExitCode {
    match run(&Cli::parse()) {
        Ok(code) => code,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::from(5)
        }
    }
}

fn run(cli: &Cli) -> anyhow::Result<ExitCode> {
    ensure!(
        said("valgrind", &["--version"]).is_ok(),
        "valgrind is not there: `apt-get install valgrind`, or leave the counts to CI"
    );
    let found = InstructionCounts {
        compiler: said("rustc", &["--version"])?,
        libc: said("getconf", &["GNU_LIBC_VERSION"])?,
        instructions: count_all()?,
    };
    if cli.update {
        let text = serde_json::to_string_pretty(&found)? + "\n";
        std::fs::write(&cli.baseline, text).with_context(|| format!("writing {}", cli.baseline.display()))?;
        println!("{} counts written to {}", found.instructions.len(), cli.baseline.display());
        return Ok(ExitCode::SUCCESS);
    }
    let text = std::fs::read_to_string(&cli.baseline)
        .with_context(|| format!("reading {}; --update writes it", cli.baseline.display()))?;
    let committed: InstructionCounts =
        serde_json::from_str(&text).with_context(|| format!("reading {}", cli.baseline.display()))?;
    let (table, mut worst) = compare(&committed.instructions, &found.instructions);
    println!("{table}\n");
    let (lines, steep) = growth(&found.instructions);
    println!("{}\n", lines.join("\n"));
    if (&committed.compiler, &committed.libc) != (&found.compiler, &found.libc) {
        println!(
            "inconclusive: the committed counts are of {} and {}, these of {} and {}; count again with those, or \
             --update and look at the differences",
            committed.compiler, committed.libc, found.compiler, found.libc
        );
        return Ok(ExitCode::SUCCESS);
    }
    worst.extend(steep);
    if worst.is_empty() {
        println!(
            "pass: no path takes more than {LIMIT_PERCENT} % over its committed count, no station more than {GROWTH} of the second"
        );
        return Ok(ExitCode::SUCCESS);
    }
    for line in worst {
        println!("FAIL: {line}");
    }
    println!("If that is meant: scripts/dev.sh instructions --update, and say why in the commit.");
    Ok(ExitCode::from(3))
}

/// Largest cost of each further station, by that of the second one.
const GROWTH: f64 = 1.1;

/// Returns, for each path that is counted with 1, 2 and more stations, the cost of each further station by that of the second one, and
/// the list of those that are above the limit. Such a path has the number in its name: `cycle of 64`.
fn growth(found: &BTreeMap<String, u64>) -> (Vec<String>, Vec<String>) {
    let mut by_path: BTreeMap<String, BTreeMap<u64, f64>> = BTreeMap::new();
    for (name, count) in found {
        let Some((before, after)) = name.split_once(" of ") else { continue };
        let (number, rest) = after.split_once(',').unwrap_or((after, ""));
        if let Ok(number) = number.parse() {
            by_path.entry(format!("{before}{rest}")).or_default().insert(number, *count as f64);
        }
    }
    let (mut lines, mut wrong) = (Vec::new(), Vec::new());
    for (path, costs) in by_path {
        let (Some(one), Some(two), Some((most, all))) =
            (costs.get(&1), costs.get(&2), costs.last_key_value())
        else {
            continue;
        };
        let each = (all - one) / (*most as f64 - 1.0);
        let ratio = each / (two - one);
        lines.push(format!("{path}: each of {most} stations costs {ratio:.2} of the second one"));
        if ratio > GROWTH {
            wrong.push(format!(
                "{path}: each of {most} stations costs {ratio:.2} of the second one, at most {GROWTH}"
            ));
        }
    }
    (lines, wrong)
}

/// Returns the table and the list of errors.
fn compare(committed: &BTreeMap<String, u64>, found: &BTreeMap<String, u64>) -> (Table, Vec<String>) {
    let mut table = Table::new();
    table.load_preset(presets::UTF8_HORIZONTAL_ONLY);
    table.set_header(["instructions", "committed", "now", "change"]);
    let mut wrong = Vec::new();
    let names: std::collections::BTreeSet<_> = committed.keys().chain(found.keys()).collect();
    for name in names {
        let (before, now) = (committed.get(name), found.get(name));
        let number = |count: Option<&u64>| count.map_or_else(|| "–".to_owned(), u64::to_string);
        let change = match (before, now) {
            (Some(before), Some(now)) => {
                let percent = (*now as f64 - *before as f64) / *before as f64 * 100.0;
                if percent > LIMIT_PERCENT {
                    wrong.push(format!("{name} takes {now} instructions, {percent:+.2} % to {before}"));
                }
                format!("{percent:+.2} %")
            }
            (Some(_), None) => {
                wrong.push(format!("{name} is not a hot path any more, but has a committed count"));
                "gone".to_owned()
            }
            _ => {
                wrong.push(format!("{name} is a new hot path without a committed count"));
                "new".to_owned()
            }
        };
        table.add_row([name.clone(), number(before), number(now), change]);
    }
    for column in table.column_iter_mut().skip(1) {
        column.set_cell_alignment(CellAlignment::Right);
    }
    (table, wrong)
}

/// Builds the bench programs as `cargo run` builds the nodes, and counts each of their paths, one per core at a time:
/// other load does not change a count.
fn count_all() -> anyhow::Result<BTreeMap<String, u64>> {
    let mut paths = Vec::new();
    for program in bench_programs()? {
        let names = said(&program, &[hot_path::LIST])?;
        paths.extend(names.lines().map(|name| (program.clone(), name.to_owned())));
    }
    let place = tempfile::tempdir().context("making a directory for callgrind's output")?;
    let next = AtomicUsize::new(0);
    let count_some = || -> anyhow::Result<Vec<(String, u64)>> {
        let mut counted = Vec::new();
        loop {
            let index = next.fetch_add(1, Ordering::Relaxed);
            let Some((program, name)) = paths.get(index) else { return Ok(counted) };
            eprintln!("counting {name}");
            let out = place.path().join(format!("{index}.callgrind"));
            counted.push((name.clone(), count(program, name, &out)?));
        }
    };
    let counted = thread::scope(|scope| {
        let cores = thread::available_parallelism().map_or(1, usize::from);
        let workers: Vec<_> = (0..cores).map(|_| scope.spawn(count_some)).collect();
        let counted =
            workers.into_iter().map(|worker| worker.join().map_err(|_| anyhow!("a count broke off"))?);
        counted.collect::<anyhow::Result<Vec<_>>>()
    })?;
    let mut counts = BTreeMap::new();
    for (name, count) in counted.into_iter().flatten() {
        ensure!(counts.insert(name.clone(), count).is_none(), "two hot paths are called {name}");
    }
    Ok(counts)
}

/// Counts the instructions of one path.
fn count(program: &str, name: &str, out: &Path) -> anyhow::Result<u64> {
    let output = Command::new("valgrind")
        .env("GLIBC_TUNABLES", ONE_PICK)
        .args(["--quiet", "--tool=callgrind"])
        .arg(format!("--toggle-collect=*{}*", hot_path::COUNTED))
        .arg(format!("--callgrind-out-file={}", out.display()))
        .args([program, hot_path::RUN, name])
        .output()
        .context("starting valgrind")?;
    let stderr = String::from_utf8_lossy(&output.stderr);
    ensure!(output.status.success(), "{name} under valgrind: {}\n{stderr}", output.status);
    let counts = std::fs::read_to_string(out).with_context(|| format!("reading {}", out.display()))?;
    let total = counts.lines().find_map(|line| line.strip_prefix("totals: ")?.trim().parse().ok());
    match total {
        None | Some(0) => bail!("callgrind saw nothing of {name}: does {} still exist?", hot_path::COUNTED),
        Some(total) => Ok(total),
    }
}

/// Returns the bench programs in the dev profile with the features of the tests, so that most of them are already
/// built.
fn bench_programs() -> anyhow::Result<Vec<String>> {
    let mut cargo = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    cargo.args(["build", "--workspace", "--all-features", "--benches", "--locked"]);
    cargo.args(["--message-format", "json-render-diagnostics"]);
    let output = cargo.stderr(Stdio::inherit()).output().context("starting cargo")?;
    ensure!(output.status.success(), "the bench programs do not build");
    let messages = String::from_utf8(output.stdout).context("reading what cargo says")?;
    let mut programs = Vec::new();
    for message in messages.lines() {
        let message: serde_json::Value = serde_json::from_str(message).context("reading what cargo says")?;
        let is_bench = message["target"]["kind"][0] == "bench";
        programs.extend(message["executable"].as_str().filter(|_| is_bench).map(str::to_owned));
    }
    ensure!(!programs.is_empty(), "cargo named no bench program");
    Ok(programs)
}

/// Returns what a program prints on standard output.
fn said(program: &str, arguments: &[&str]) -> anyhow::Result<String> {
    let output =
        Command::new(program).args(arguments).output().with_context(|| format!("starting {program}"))?;
    ensure!(output.status.success(), "{program} {}: {}", arguments.join(" "), output.status);
    Ok(String::from_utf8_lossy(&output.stdout).trim().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn counts(list: &[(&str, u64)]) -> BTreeMap<String, u64> {
        list.iter().map(|(name, count)| ((*name).to_owned(), *count)).collect()
    }

    #[test]
    fn a_path_that_takes_over_one_percent_more_is_reported_with_its_excess() {
        let committed = counts(&[("encode", 1_000), ("decode", 1_000), ("plan", 1_000)]);
        let found = counts(&[("encode", 1_010), ("decode", 1_011), ("plan", 900)]);
        let (_, wrong) = compare(&committed, &found);
        assert_eq!(wrong, ["decode takes 1011 instructions, +1.10 % to 1000"]);
    }

    #[test]
    fn a_path_whose_further_stations_cost_more_than_the_second_one_is_reported() {
        let found = counts(&[
            ("scanner/cycle of 1", 100),
            ("scanner/cycle of 2", 200),
            ("scanner/cycle of 64", 6_400),
            ("controller/cycle of 1, rt1", 100),
            ("controller/cycle of 2, rt1", 200),
            ("controller/cycle of 64, rt1", 12_700),
            ("controller/cycle of 1, udp", 100),
            ("PLC/10 scans", 5),
        ]);
        let (lines, wrong) = growth(&found);
        assert_eq!(lines.len(), 2, "{lines:?}");
        assert_eq!(
            wrong,
            ["controller/cycle rt1: each of 64 stations costs 2.00 of the second one, at most 1.1"]
        );
    }

    #[test]
    fn a_new_path_and_a_removed_one_are_reported() {
        let (_, wrong) = compare(&counts(&[("old", 1)]), &counts(&[("new", 1)]));
        assert_eq!(
            wrong,
            [
                "new is a new hot path without a committed count",
                "old is not a hot path any more, but has a committed count"
            ]
        );
    }
}
