//! `bench buses`: the same arm and application over every bus, in virtual time: execution times, and how long a reaction
//! over the bus takes beside the least and the most that its cycles allow.

use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::Duration;

use clap::Args;
use node::screen;
use planning::Application;
use plc_node::ExecutionType;
use serde::Serialize;
use setup::Setup;

use crate::each_bus::over_each_bus;
use crate::engine::claim::{RowsOrigin, StudyClaim};
use crate::engine::job::{JobRows, ListedJob};
use crate::engine::listed::ListedStudy;
use crate::event_loop::{interrupted, watch_for_interrupt};
use crate::jobs;
use crate::outputs::{self, FigureExports, Own, csv_number};
use crate::setup_option::SetupOption;
use crate::study_files::CLAIMED_FILES;
use records::exit::{Exit, Failure};
use records::schedule::{Schedule, repetitions};
use report::export_text::quoted;
use report::outln;
use stands::planned_cell::PlannedCell;
use stands::reaction_limits::reaction_limits;
use stands::virtual_run::reactions;

/// Number of random sets of clocks and phases for the reactions, and number of reactions with each.
const DRAWINGS: u64 = 100;
const REACTIONS: usize = 20;

/// Options of the comparison.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  bench buses                                 the arm of Setup A over each bus
  bench buses --setup B --reps 3              another arm
  bench buses --export-csv buses.csv --quiet  a line for each bus, for other programs

The setup's own bus gives cycle, watchdog and cable; PROFINET's and EtherNet/IP's other settings are those of Setup A and B.")]
pub struct BusesOptions {
    /// Which setup.
    #[command(flatten)]
    pub setup: SetupOption,
    /// Repetitions of each execution type.
    #[arg(long, value_name = "N", default_value_t = 25, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub reps: u32,
    /// Seed of the clocks, phases and pauses.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Directory for the rows; given again, a comparison that ended early goes on.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Files for other programs.
    #[command(flatten)]
    pub exports: FigureExports,
    /// Print the table only: no progress.
    #[arg(long, short)]
    pub quiet: bool,
}

/// Columns of `--export-csv`.
pub const CSV_HEADER: &str = "bus,rc_ms,sm_ms,cm_ms,reaction_min_ms,reaction_mean_ms,reaction_max_ms";

/// Version of the format of `--export-json`.
const SCHEMA_VERSION: u32 = 1;

/// Figures of one bus.
struct BusRow {
    bus: &'static str,
    /// Mean execution times of RC, SM and CM in ms.
    aet_ms: [f64; 3],
    /// Shortest, mean and longest reaction.
    reaction: [Duration; 3],
}

/// Comparison of the buses for other programs.
#[derive(Serialize)]
struct BusesExport<'a> {
    schema_version: u32,
    setup: &'a str,
    application: &'a str,
    reps: u32,
    seed: u64,
    /// Number of reactions of each bus.
    reactions: usize,
    /// Shortest and longest reaction that the cycles allow.
    reaction_limits_ms: [f64; 2],
    /// Number of buses of the whole comparison; an interrupt leaves out the last ones.
    planned: usize,
    buses: Vec<BusFigures>,
}

/// Figures of one bus for other programs; JSON has null and CSV an empty field for a figure without a value.
#[derive(Serialize)]
struct BusFigures {
    bus: &'static str,
    rc_ms: Option<f64>,
    sm_ms: Option<f64>,
    cm_ms: Option<f64>,
    reaction_min_ms: f64,
    reaction_mean_ms: f64,
    reaction_max_ms: f64,
}

impl BusFigures {
    fn of(row: &BusRow) -> Self {
        let [rc_ms, sm_ms, cm_ms] = row.aet_ms.map(|aet| Some(aet).filter(|aet| aet.is_finite()));
        let [reaction_min_ms, reaction_mean_ms, reaction_max_ms] = row.reaction.map(millis);
        Self { bus: row.bus, rc_ms, sm_ms, cm_ms, reaction_min_ms, reaction_mean_ms, reaction_max_ms }
    }

    fn line(&self) -> String {
        let Self { bus, rc_ms, sm_ms, cm_ms, reaction_min_ms, reaction_mean_ms, reaction_max_ms } = self;
        let aets = [rc_ms, sm_ms, cm_ms].map(|aet| csv_number(*aet, 4));
        let reactions = [reaction_min_ms, reaction_mean_ms, reaction_max_ms];
        let reactions = reactions.map(|reaction| csv_number(Some(*reaction), 6));
        format!("{},{},{}\n", quoted(bus), aets.join(","), reactions.join(","))
    }
}

fn millis(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}

/// Runs the setup over each bus and prints the table.
///
/// # Errors
///
/// The setup cannot be used on one of the buses, or a run fails.
pub fn run(options: &BusesOptions, commit: &str) -> Result<Exit, Failure> {
    let (setup, found) = options.setup.load()?;
    let variants = over_each_bus(&setup)?;
    for (_, variant) in &variants {
        setup::check(variant)?;
    }
    let read = [("the setup", options.setup.file()), ("the application", found.path.as_deref())];
    let own = Own { directory: options.out.as_deref(), files: &CLAIMED_FILES };
    outputs::check(&options.exports.files(), &read, own)?;
    options.exports.check_writable()?;
    let is_interrupted = watch_for_interrupt()?;
    let mut study = ListedStudy::in_memory("buses", options.quiet, &is_interrupted);
    if let Some(directory) = &options.out {
        let claim = format!(
            "buses\n{}\n{}\n{} {}",
            setup::setup_to_toml(&setup)?,
            found.text,
            options.reps,
            options.seed
        );
        let (options, command, results) = (claim.as_str(), "", &[]);
        let origin = RowsOrigin { directory, options, command, results, commit };
        study = study.saved_in(&StudyClaim::checked(origin)?)?;
    }
    let listed = variants.iter().map(|(_, setup)| listed(setup, &found.application, options));
    let executed = study.measured(&listed.collect::<anyhow::Result<Vec<_>>>()?)?;
    let measured: Vec<_> =
        variants.iter().zip(executed).filter_map(|(variant, rows)| Some((variant, rows?))).collect();
    let measure = |((bus, setup), rows): &(&(&'static str, Setup), JobRows)| row(bus, setup, rows, options);
    let rows = jobs::run("reactions", options.quiet, &is_interrupted, &measured, measure)?;
    let rows: Vec<BusRow> = rows.into_iter().flatten().collect();
    if !rows.is_empty() {
        outln!("{}", render(&setup, &found.application.name, options, &rows));
        export(&setup, &found.application.name, options, (&rows, variants.len()))?;
    }
    if is_interrupted.load(Ordering::Relaxed) {
        return Ok(interrupted(rows.len(), variants.len(), "buses"));
    }
    Ok(Exit::Pass)
}

fn listed(setup: &Setup, application: &Application, options: &BusesOptions) -> anyhow::Result<ListedJob> {
    let schedule = Schedule::new(&ExecutionType::ALL, options.reps, options.seed);
    Ok(ListedJob { setup: setup.clone(), planned: PlannedCell::of(setup, application)?, schedule })
}

fn row(bus: &'static str, setup: &Setup, rows: &JobRows, options: &BusesOptions) -> anyhow::Result<BusRow> {
    let aet_ms = ExecutionType::ALL
        .map(|execution_type| rows.aet_mad(execution_type).map_or(f64::NAN, |figure| figure.aet_ms));
    let mut times = Vec::new();
    for drawing in 0..DRAWINGS {
        times.extend(reactions(setup, options.seed.wrapping_add(drawing), REACTIONS)?);
    }
    let sum: Duration = times.iter().sum();
    let mean = sum / u32::try_from(times.len()).unwrap_or(u32::MAX).max(1);
    let shortest = times.iter().min().copied().unwrap_or_default();
    let longest = times.iter().max().copied().unwrap_or_default();
    Ok(BusRow { bus, aet_ms, reaction: [shortest, mean, longest] })
}

/// Writes the requested files.
fn export(
    setup: &Setup,
    application: &str,
    options: &BusesOptions,
    (rows, planned): (&[BusRow], usize),
) -> anyhow::Result<()> {
    let (shortest, longest) = reaction_limits(setup);
    let export = BusesExport {
        schema_version: SCHEMA_VERSION,
        setup: &setup.name,
        application,
        reps: options.reps,
        seed: options.seed,
        reactions: DRAWINGS as usize * REACTIONS,
        reaction_limits_ms: [shortest, longest].map(millis),
        planned,
        buses: rows.iter().map(BusFigures::of).collect(),
    };
    let lines: String = export.buses.iter().map(BusFigures::line).collect();
    options.exports.write(&outputs::json(&export)?, &format!("{CSV_HEADER}\n{lines}"))
}

fn render(setup: &Setup, application: &str, options: &BusesOptions, rows: &[BusRow]) -> String {
    let mut table = screen::ruled();
    table.set_header(["bus", "RC\nms", "SM\nms", "CM\nms", "reaction\nleast ms", "mean\nms", "most\nms"]);
    let ms = |time: Duration| format!("{:.3}", millis(time));
    for BusRow { bus, aet_ms, reaction } in rows {
        let [rc, sm, cm] = aet_ms.map(|aet| format!("{aet:.1}"));
        let [least, mean, most] = reaction.map(ms);
        table.add_row([(*bus).to_owned(), rc, sm, cm, least, mean, most]);
    }
    let (shortest, longest) = reaction_limits(setup);
    table.add_row([
        "by the cycles".to_owned(),
        String::new(),
        String::new(),
        String::new(),
        ms(shortest),
        ms((shortest + longest) / 2),
        ms(longest),
    ]);
    let heading = format!(
        "Setup {}'s arm over each bus: {application}, {} of each type, virtual mode, seed {}",
        setup.name,
        repetitions(options.reps),
        options.seed
    );
    let sentences = [
        "RC, SM, CM: mean execution times.".to_owned(),
        format!(
            "Reaction: from the PLC's scan that writes a number to the scan that reads it back from the robot, which \
             copies it in its own cycle; {} of each bus, without program and skill.",
            DRAWINGS as usize * REACTIONS
        ),
        "By the cycles: at least the cable there and back; at most a scan, a robot cycle and two bus cycles more."
            .to_owned(),
    ];
    let sentences = sentences.map(|sentence| screen::wrapped(&sentence, 2, 2)).join("\n");
    let table = screen::drawn(&screen::numbers_right(table));
    format!("{}\n\n{table}\n\n{sentences}", screen::wrapped(&heading, 0, 2))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_reaction_over_every_bus_is_within_what_the_cycles_allow() {
        // Drift: how much longer 4 ms of the robot are on the PLC's clock.
        let drift = Duration::from_micros(1);
        let near = Duration::from_millis(1);
        for (bus, setup) in over_each_bus(&setup::setup("A").unwrap()).unwrap() {
            setup::check(&setup).unwrap();
            let (shortest, longest) = reaction_limits(&setup);
            let times: Vec<_> =
                (1..=200).flat_map(|seed| reactions(&setup, seed, REACTIONS).unwrap()).collect();
            let (least, most) = (times.iter().min().unwrap(), times.iter().max().unwrap());
            assert!(*least >= shortest && *least < shortest + near * 2, "{bus}: {least:?}");
            assert!(*most <= longest + drift && *most > longest - near * 2, "{bus}: {most:?} of {longest:?}");
        }
    }
}
