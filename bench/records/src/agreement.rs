//! Whether what is saved of a run agrees: derived figures with the samples, `results.json` with `samples.csv`, and all of it
//! with its digests. It detects accidents, not forgers.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use plc_node::ExecutionType;
use serde_json::Value;

use crate::cell_results::CellResults;
use crate::counted::counted;
use crate::digest::{Digests, Mismatch};
use crate::occupied::{MOST_RUN_BYTES, SAMPLES};
use crate::results::{Results, Status, TypeResult, aet_mad};
use crate::sample_rows::{Row, Rows};
use crate::statistics::{AetMad, aet_improvement};

/// Largest difference of equal times in ms: half a nanosecond, which is the resolution of the samples.
const EQUAL_MS: f64 = 0.5e-6;

/// Largest difference of equal shares.
const EQUAL_SHARE: f64 = 1e-9;

/// A saved run that does not agree with itself.
#[derive(Debug, thiserror::Error)]
#[error("{}: {problem}; restore the file, or run again", path.display())]
pub struct Altered {
    path: PathBuf,
    /// The figure, the value found, and what it should be.
    problem: String,
}

impl Altered {
    /// Creates the error for a file of a run.
    pub(super) fn new(path: PathBuf, problem: impl Into<String>) -> Self {
        Self { path, problem: problem.into() }
    }
}

/// Checks the results of a cell with several stations: as those of one station, at each.
///
/// # Errors
///
/// The first figure that does not agree, with what was found and what was computed.
pub fn check_cell(directory: &Path, value: &Value, cell: &CellResults) -> Result<(), Altered> {
    let in_file = |name: &'static str| move |problem: String| Altered::new(directory.join(name), problem);
    lists_of_cell(cell).map_err(in_file("results.json"))?;
    let samples = samples_of(directory)?;
    for (index, station) in cell.stations.iter().enumerate() {
        let results = cell.of_station(index);
        let at = |problem: String| format!("station {}: {problem}", station.name);
        figures(&results).map_err(at).map_err(in_file("results.json"))?;
        let rows = Rows::parse(&samples).of_station(&station.name);
        samples_agree(rows, &results).map_err(at).map_err(in_file(SAMPLES))?;
    }
    digests_agree(directory, value, cell.digests.as_ref())
}

/// Compares the lengths of the lists that only cells have.
fn lists_of_cell(cell: &CellResults) -> Result<(), String> {
    for one in ExecutionType::ALL {
        let Some(result) = cell.results.get(one) else { continue };
        let (name, count) = (one.to_string().to_uppercase(), result.samples_ms.len());
        let stations = result.stations.len();
        if stations != cell.stations.len() {
            return Err(format!("{name} has {stations} stations, the run {}", cell.stations.len()));
        }
        let of_stations = result.stations.iter().flat_map(|station| {
            let zones = station.zone_waiting_ms.len();
            let zones = if zones == 0 { count } else { zones };
            [("waiting_ms", station.waiting_ms.len()), ("zone_waiting_ms", zones)]
        });
        // An older version did not measure it.
        let poses = if result.relative_pose_mm.is_empty() { count } else { result.relative_pose_mm.len() };
        let of_type = [("start_skew_us", result.start_skew_us.len()), ("relative_pose_mm", poses)];
        if let Some((list, found)) = of_type.into_iter().chain(of_stations).find(|(_, found)| *found != count)
        {
            return Err(format!("{list} of {name} has {found} entries, its samples_ms {count}"));
        }
    }
    Ok(())
}

fn samples_of(directory: &Path) -> Result<String, Altered> {
    let path = directory.join(SAMPLES);
    setup::read_plain_text_within(&path, MOST_RUN_BYTES).map_err(|error| {
        let problem = match error.kind() {
            ErrorKind::NotFound => "is missing beside results.json".to_owned(),
            _ => format!("cannot be read: {error}"),
        };
        Altered::new(path, problem)
    })
}

fn digests_agree(directory: &Path, value: &Value, digests: Option<&Digests>) -> Result<(), Altered> {
    let Some(digests) = digests else { return Ok(()) };
    let checked =
        digests.check(value, |name| setup::read_plain_file(&directory.join(name), MOST_RUN_BYTES).ok());
    checked.map_err(|mismatch| of_mismatch(directory, mismatch))
}

/// Checks the results of a run directory, which were read from `value`.
///
/// # Errors
///
/// The first figure that does not agree, with what was found and what was computed.
pub fn check(directory: &Path, value: &Value, results: &Results) -> Result<(), Altered> {
    let in_file = |name: &'static str| move |problem: String| Altered::new(directory.join(name), problem);
    figures(results).map_err(in_file("results.json"))?;
    samples_agree(Rows::parse(&samples_of(directory)?), results).map_err(in_file(SAMPLES))?;
    match &results.digests {
        None => names(directory, results).map_err(in_file("results.json")),
        digests => digests_agree(directory, value, digests.as_ref()),
    }
}

fn of_mismatch(directory: &Path, mismatch: Mismatch) -> Altered {
    let shown =
        |digest: Option<String>| digest.map_or_else(|| "missing".to_owned(), |digest| format!("`{digest}`"));
    match mismatch {
        Mismatch::Value { key, value, found, saved } => {
            let value = value.map_or_else(String::new, |value| format!(" is {value}"));
            let problem =
                format!("`{key}`{value}: its digest is {}, the saved one {}", shown(found), shown(saved));
            Altered::new(directory.join("results.json"), problem)
        }
        Mismatch::File { name, found, saved } => {
            let problem = format!("its digest is `{found}`, the one in results.json `{saved}`");
            Altered::new(directory.join(name), problem)
        }
    }
}

/// Compares every figure that follows from others with them.
fn figures(results: &Results) -> Result<(), String> {
    for (name, result) in types(results) {
        let count = result.samples_ms.len();
        // What was measured elsewhere may lack what only the robot knows.
        let or_unknown = |found: usize| if found == 0 && results.origin.is_some() { count } else { found };
        for (list, found) in [
            ("robot_samples_ms", or_unknown(result.robot_samples_ms.len())),
            ("blends_suppressed", or_unknown(result.blends_suppressed.len())),
            // An older version did not count them.
            (
                "missed_cycles",
                if result.missed_cycles.is_empty() { count } else { result.missed_cycles.len() },
            ),
        ] {
            if found != count {
                return Err(format!("{list} of {name} has {found} entries, its samples_ms {count}"));
            }
        }
        // A capture has as many repetitions of each type as it has.
        let is_of_bench = results.origin.is_none();
        if is_of_bench && results.status == Status::Complete && count != results.reps as usize {
            let (samples, reps) = (counted(count, "sample"), counted(results.reps, "repetition"));
            return Err(format!("{name} has {samples}, and the complete run {reps}"));
        }
        let computed = aet_mad(&result.samples_ms);
        equal(&format!("aet_ms of {name}"), result.aet_ms, computed.map(|it| it.aet_ms), EQUAL_MS)?;
        equal(&format!("mad_ms of {name}"), result.mad_ms, computed.map(|it| it.mad_ms), EQUAL_MS)?;
    }
    let improvement = |sm: Option<f64>, cm: Option<f64>| sm.zip(cm).map(|(sm, cm)| aet_improvement(sm, cm));
    let aet_ms = |it: Option<&TypeResult>| it.and_then(|result| result.aet_ms);
    let (sm, cm) = (aet_ms(results.results.sm.as_ref()), aet_ms(results.results.cm.as_ref()));
    equal("aet_improvement", results.aet_improvement, improvement(sm, cm), EQUAL_SHARE)?;
    let Some(h0) = &results.without_skill_overhead else { return Ok(()) };
    let aet_ms = |it: Option<AetMad>| it.map(|figure| figure.aet_ms);
    let computed = improvement(aet_ms(h0.results.sm), aet_ms(h0.results.cm));
    equal("aet_improvement of without_skill_overhead", h0.aet_improvement, computed, EQUAL_SHARE)
}

fn types(results: &Results) -> impl Iterator<Item = (String, &TypeResult)> {
    let all = ExecutionType::ALL.into_iter();
    all.filter_map(|one| Some((one.to_string().to_uppercase(), results.results.get(one)?)))
}

/// Compares a saved figure with what its samples give.
fn equal(name: &str, found: Option<f64>, computed: Option<f64>, tolerance: f64) -> Result<(), String> {
    let is_equal = match (found, computed) {
        (Some(found), Some(computed)) => (found - computed).abs() <= tolerance,
        (None, None) => true,
        _ => false,
    };
    let shown = |value: Option<f64>| value.map_or_else(|| "none".to_owned(), |value| value.to_string());
    if is_equal {
        return Ok(());
    }
    Err(format!("{name} is {}, its samples give {}", shown(found), shown(computed)))
}

/// Compares the repetitions in `samples.csv` with those in the results.
fn samples_agree(rows: Rows, results: &Results) -> Result<(), String> {
    let Rows { mut rows, broken } = rows;
    // The line of a repetition is written before the results: a run that was killed or whose disk was full between the two
    // has one repetition more in one of them, or half a line.
    let may_lack_one = matches!(results.status, Status::Running | Status::Failed);
    if let Some(problem) = broken.filter(|_| !may_lack_one) {
        return Err(problem);
    }
    let saved: usize = types(results).map(|(_, result)| result.samples_ms.len() + result.failed.len()).sum();
    if may_lack_one && rows.len() == saved + 1 {
        rows.pop();
    }
    let lacks_one = may_lack_one && rows.len() + 1 == saved;
    for one in ExecutionType::ALL {
        let of_type = || rows.iter().filter(move |row| row.execution_type == one);
        let Some(result) = results.results.get(one) else {
            let Some(row) = of_type().next() else { continue };
            return Err(format!("has {}, and results.json no repetition of this type", row.name()));
        };
        let finished: Vec<_> = of_type().filter(|row| row.error.is_none()).collect();
        let failed: Vec<_> = of_type().filter(|row| row.error.is_some()).collect();
        for (what, found, expected) in [
            ("repetition", finished.len(), result.samples_ms.len()),
            ("failed repetition", failed.len(), result.failed.len()),
        ] {
            if found != expected && !(lacks_one && found + 1 == expected) {
                let name = one.to_string().to_uppercase();
                return Err(format!("has {} of {name}, results.json has {expected}", counted(found, what)));
            }
        }
        finished.iter().enumerate().try_for_each(|(index, row)| agrees(row, result, index))?;
        for (row, saved) in failed.iter().zip(&result.failed) {
            if row.repetition != saved.repetition {
                let number = saved.repetition;
                return Err(format!("{} failed, in results.json repetition {number}", row.name()));
            }
        }
    }
    Ok(())
}

/// Compares a line of `samples.csv` with the entries of its repetition.
fn agrees(row: &Row, result: &TypeResult, index: usize) -> Result<(), String> {
    let missed = result.missed_cycles.get(index);
    let count = |value: u64| value as f64;
    for (column, found, saved) in [
        ("execution_ms", row.execution_ms, result.samples_ms.get(index).copied()),
        ("robot_execution_ms", row.robot_execution_ms, result.robot_samples_ms.get(index).copied()),
        (
            "blends_suppressed",
            row.blends_suppressed,
            result.blends_suppressed.get(index).copied().map(f64::from),
        ),
        ("plc_missed", row.plc_missed, missed.map(|missed| count(missed.plc))),
        ("robot_missed", row.robot_missed, missed.map(|missed| count(missed.robot))),
    ] {
        let (Some(found), Some(saved)) = (found, saved) else { continue };
        if (found - saved).abs() > EQUAL_MS {
            return Err(format!("{column} of {} is {found}, results.json has {saved}", row.name()));
        }
    }
    Ok(())
}

/// Compares the names in results without digests with those of the files beside them.
fn names(directory: &Path, results: &Results) -> Result<(), String> {
    // A file that this version cannot read is named by the report.
    let text = |name: &str| setup::read_plain_text(&directory.join(name)).ok();
    let setup = text("setup.toml").and_then(|text| setup::setup_from_text("setup.toml", &text).ok());
    let application = text("application.toml")
        .and_then(|text| planning::Application::parse("application.toml", &text).ok())
        .map(|application| application.name);
    for (key, found, file, expected) in [
        ("setup", &results.setup, "setup.toml", setup.map(|setup| setup.name)),
        ("application", &results.application, "application.toml", application),
    ] {
        if let Some(expected) = expected.filter(|expected| expected != found) {
            return Err(format!("`{key}` is `{found}`, {file} has `{expected}`"));
        }
    }
    Ok(())
}
