//! The report's texts, tables and figures, for its template.

use plc_node::ExecutionType;
use serde::Serialize;

use super::first_look::FirstLook;
use super::race::{self, Race};
use super::run::Run;
use super::{RaceIs, lateness, numbers, path, queue, result, samples, speed};
use crate::figures::{self, Figures};
use crate::html::chart::{colour, short};
use crate::html::document::fill_with;
use crate::html::figure::Figure;
use crate::progress::label;
use crate::quality;
use crate::table;
use crate::verdicts;
use records::calibrated;
use records::ratio::Ratio;
use records::results::{Results, Status};
use records::statistics::AetMad;
use records::trace::Trace;

const TEMPLATE: &str = include_str!("page.html");
/// The picture of the first look.
const BARS: &str = include_str!("bars.svg");

#[derive(Serialize)]
struct Page {
    name: String,
    title: String,
    subtitle: String,
    made: String,
    banner: Option<Banner>,
    summary: Option<String>,
    first_look: Option<FirstLook>,
    is_virtual: bool,
    figures: Figures,
    calibrated: Vec<[String; 3]>,
    no_paper: Option<String>,
    attached: Option<String>,
    origin: Option<String>,
    not_verified: Vec<String>,
    by_construction: Option<String>,
    not_reproduced: Option<String>,
    distances: Vec<verdicts::DistanceRow>,
    claims: Vec<verdicts::Claim>,
    ratio: Option<String>,
    suppressed: u32,
    frames: String,
    /// What became of the faults that were asked for.
    faults: Option<String>,
    repeated: u32,
    quality: Vec<QualityRow>,
    quality_columns: [[&'static str; 2]; quality::COLUMNS.len()],
    quality_legend: [&'static str; quality::LEGEND.len()],
    quality_summary: Option<String>,
    race: Option<RaceStill>,
    /// Why there is no race, and what would make one.
    no_race: Option<String>,
    speed: Option<Figure>,
    samples: Option<Figure>,
    path: Option<Figure>,
    approximation: Option<String>,
    queue: Option<Figure>,
    lateness: Option<Figure>,
    cycles: Vec<[String; 5]>,
    numbers: Vec<numbers::Number>,
    host: Vec<[String; 2]>,
    failures: Vec<[String; 2]>,
    missing: Vec<String>,
    /// Where recordings end before their repetitions did.
    incomplete: Option<String>,
    no_trace: String,
}

#[derive(Serialize)]
struct Banner {
    title: &'static str,
    text: String,
}

/// Quality of the arm's motion in the runs of a type.
#[derive(Serialize)]
struct QualityRow {
    name: String,
    cells: [String; quality::COLUMNS.len()],
}

/// The picture of the race.
#[derive(Serialize)]
struct RaceStill {
    figure: Option<Figure>,
    result: String,
    /// What happens at the moment of the picture.
    moment: &'static str,
    /// What opens the page, at the moment of the picture; none where the page is not beside the report.
    link: Option<String>,
    file: &'static str,
}

impl RaceStill {
    fn of(race: &Race, is: RaceIs) -> anyhow::Result<Self> {
        let figure = Figure::draw(&format!("The arms at the moment at which {}", race.moment()), |format| {
            race.still(format).map(Some)
        })?;
        let link = (is == RaceIs::Beside).then(|| race::FILE.to_owned());
        Ok(Self { figure, result: race.result(), moment: race.moment(), link, file: race::FILE })
    }
}

const NONE: &str = "–";

/// Returns the report as HTML.
pub(super) fn render(run: &Run, race: RaceIs) -> anyhow::Result<String> {
    fill_with(TEMPLATE, &[("bars.svg", BARS)], &page(run, race)?)
}

fn page(run: &Run, race_is: RaceIs) -> anyhow::Result<Page> {
    // Longer than a screen, because the page has that many parts, a line or two each.
    let results = &run.results;
    let race = Race::of(run);
    let trace = run.trace.as_ref();
    let traced = |draw: &dyn Fn(&Trace) -> anyhow::Result<Option<String>>| match trace {
        Some(trace) => draw(trace),
        None => Ok(None),
    };
    Ok(Page {
        name: run.name(),
        title: results.title.clone(),
        subtitle: run.about(),
        made: made(run),
        banner: banner(results),
        summary: result::sentences(results),
        first_look: FirstLook::of(results, run.continuous),
        is_virtual: results.mode == "virtual",
        figures: Figures::of(results),
        calibrated: calibrated(results),
        no_paper: results.no_paper.clone(),
        attached: results.attached.as_ref().map(ToString::to_string),
        origin: results.origin.as_ref().map(ToString::to_string),
        not_verified: table::not_verified(results).chain(table::connection_remarks(results)).collect(),
        by_construction: verdicts::by_construction(results),
        not_reproduced: verdicts::not_reproduced(results),
        distances: verdicts::distance_rows(results),
        claims: verdicts::claims(results),
        ratio: ratio(results),
        suppressed: results.blends_suppressed(),
        frames: match table::has_counted_frames(results) {
            true => table::cyclic_frames(&results.bus),
            false => "Cyclic frames were not counted.".to_owned(),
        },
        faults: results.faults.as_ref().map(ToString::to_string),
        repeated: results.repeated,
        quality: qualities(results),
        quality_columns: quality::COLUMNS,
        quality_legend: quality::LEGEND,
        quality_summary: quality::summary(results),
        no_race: race.as_ref().err().cloned(),
        race: race.ok().map(|race| RaceStill::of(&race, race_is)).transpose()?,
        speed: Figure::draw("Path speed over time of RC, SM and CM on one time axis", |format| {
            traced(&|trace| speed::draw(trace, results, run.continuous, format))
        })?
        .zip(trace)
        .map(|(figure, trace)| figure.with(speed::data(trace))),
        samples: Figure::draw("Deviation of each execution time from its type's mean", |format| {
            samples::draw(&sample_rows(results), "execution time minus the type's AET, in ms", format)
        })?
        .map(|figure| figure.with(samples::data(&sample_rows(results)))),
        path: Figure::draw("The tool's path from the side and from above", |format| {
            traced(&|trace| path::draw(trace, run.setup.as_ref(), run.application.as_ref(), format))
        })?
        .map(|figure| figure.with(path::data(run.setup.as_ref(), run.application.as_ref()))),
        approximation: run.setup.as_ref().map(|setup| short(&setup.motions.approximation_mm.value)),
        queue: Figure::draw("Motions in the slots over time", |format| {
            traced(&|trace| queue::draw(trace, format))
        })?
        .zip(trace)
        .map(|(figure, trace)| figure.with(queue::data(trace))),
        lateness: Figure::draw("Histograms of the cycles' lateness", |format| {
            // In virtual time the only lateness is rounding between two clocks.
            if results.mode == "real" { lateness::draw(&results.cycle, format) } else { Ok(None) }
        })?,
        cycles: cycles(results),
        numbers: numbers::of(run)?,
        host: host(run),
        failures: failures(results),
        missing: run.missing.clone(),
        incomplete: run.incomplete(),
        no_trace: run.no_trace(),
    })
}

fn made(run: &Run) -> String {
    let date = run.host("date").map(|date| date.replace('T', " ").replace('Z', " UTC"));
    let version = run.host("version").map(|version| format!("skillbench {version}"));
    let commit = run.host("commit").map(|commit| format!("commit {commit}"));
    date.into_iter().chain(version).chain(commit).collect::<Vec<_>>().join(" · ")
}

fn banner(results: &Results) -> Option<Banner> {
    let done: usize = ExecutionType::ALL
        .iter()
        .filter_map(|execution_type| results.results.get(*execution_type))
        .map(|result| result.samples_ms.len())
        .sum();
    let types = ExecutionType::ALL
        .iter()
        .filter(|execution_type| results.results.get(**execution_type).is_some())
        .count();
    let all = results.reps as usize * types;
    let so_far = format!("{done} of {all} runs are done, and this report shows those.");
    match results.status {
        Status::Complete => None,
        Status::Interrupted => Some(Banner { title: "This run was interrupted.", text: so_far }),
        Status::Failed => Some(Banner {
            title: "A repetition of this run failed.",
            text: format!("{so_far} What went wrong stands under Failures."),
        }),
        Status::Running => Some(Banner {
            title: "This run is not finished.",
            text: format!(
                "It is still running, or the program was ended from outside or by a full disk. {so_far}"
            ),
        }),
    }
}

/// Returns what this one run shows about CM against RC, independent of the host's influence on both.
fn ratio(results: &Results) -> Option<String> {
    let samples = |execution_type| Some(results.results.get(execution_type)?.samples_ms.as_slice());
    let found = Ratio::of(samples(ExecutionType::Cm)?, samples(ExecutionType::Rc)?, results.seed)?;
    let Ratio { ratio, low, high } = found;
    Some(format!(
        "CM / RC = {ratio:.4}, 95\u{a0}% interval {low:.4} to {high:.4} (percentile bootstrap of this run's samples)."
    ))
}

fn qualities(results: &Results) -> Vec<QualityRow> {
    let row = |execution_type: ExecutionType| {
        let quality = results.results.get(execution_type)?.quality?;
        Some(QualityRow { name: label(execution_type), cells: quality::cells(&quality) })
    };
    ExecutionType::ALL.into_iter().filter_map(row).collect()
}

fn calibrated(results: &Results) -> Vec<[String; 3]> {
    let line = |number: &calibrated::Calibrated| {
        let met = calibrated::figure(&number.key, &results.calibrated);
        [number.key.clone(), number.value.to_string(), met.to_owned()]
    };
    figures::marked(results).map(line).collect()
}

fn sample_rows(results: &Results) -> Vec<samples::Row> {
    let row = |execution_type: ExecutionType| {
        let result = results.results.get(execution_type)?;
        let AetMad { aet_ms, mad_ms } = results.figure(execution_type)?;
        Some(samples::Row {
            name: label(execution_type),
            about: match result.samples_ms.len() {
                // One sample has no deviation.
                1 => format!("{aet_ms:.1} ms, n = 1"),
                n => format!("{aet_ms:.1} ms, MAD {mad_ms:.1} ms, n = {n}"),
            },
            colour: colour(execution_type),
            samples: result.samples_ms.iter().map(|sample| sample - aet_ms).collect(),
        })
    };
    ExecutionType::ALL.into_iter().filter_map(row).collect()
}

fn cycles(results: &Results) -> Vec<[String; 5]> {
    if results.mode != "real" {
        return Vec::new();
    }
    let line = |name: &str, cycle: &records::lateness::CycleLateness| {
        let micros = |value: f64| format!("{value:.0}");
        [
            name.to_owned(),
            micros(cycle.p50_us),
            micros(cycle.p99_us),
            micros(cycle.max_us),
            cycle.missed.to_string(),
        ]
    };
    vec![line("PLC scans", &results.cycle.plc), line("Robot cycles", &results.cycle.robot)]
}

fn failures(results: &Results) -> Vec<[String; 2]> {
    let of_type = |execution_type: ExecutionType| {
        let failed = results.results.get(execution_type).map_or(&[][..], |result| &result.failed);
        failed.iter().map(move |failed| {
            [format!("{} {}", label(execution_type), failed.repetition), failed.error.clone()]
        })
    };
    ExecutionType::ALL.into_iter().flat_map(of_type).collect()
}

fn host(run: &Run) -> Vec<[String; 2]> {
    let Some(host) = &run.host else { return Vec::new() };
    let text = |value: &serde_json::Value| match value {
        serde_json::Value::Null => NONE.to_owned(),
        serde_json::Value::String(text) => text.clone(),
        other => other.to_string(),
    };
    host.iter().map(|(key, value)| [key.replace('_', " "), text(value)]).collect()
}
