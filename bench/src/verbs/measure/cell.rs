//! A measured run of a cell with several stations, in virtual time.

use std::path::PathBuf;
use std::time::SystemTime;

use anyhow::{Context as _, anyhow};
use capture_file::Retention;
use node::list::flat;
use planning::{FoundCell, PlannedCell};
use setup::Cell;

use super::alone::add_alone;
use super::{Capture, RunOptions};
use records::cell_directory::CellDirectory;
use records::cell_results::CellResults;
use records::cell_sample::CellSample;
use records::exit::{Exit, Failure};
use records::mode::Mode;
use records::occupied;
use records::results::Status;
use records::run_directory::{self, Durability, replace};
use records::schedule::{Schedule, Step};
use records::trace::CellTrace;
use report::pages;
use report::{cell_files, cell_table, errln, in_shell, outln};
use stands::planned_station::PlannedStation;
use stands::relative_pose::RelativePose;
use stands::verification::StationVerification;
use stands::virtual_run::{CellMeasured, CellRun};
use studies::outputs::{self, Own};

/// Returns the cell of a setup with several stations; `None` for a setup of one robot, and for one that cannot be read: its own
/// verb says why.
pub fn of_several(name: &str) -> Option<Cell> {
    setup::cell(name).ok().map(|(cell, _)| cell).filter(|cell| !cell.is_one())
}

/// Runs a cell and prints its table.
pub fn run(options: &RunOptions) -> Result<Exit, Failure> {
    check_options(options)?;
    let (cell, found) = planning::cell_with_applications(options.setup.name())?;
    let planned = found.plan(&cell)?;
    let plant = Plant::of(&cell, &planned)?;
    let mut read = vec![("the setup", options.setup.file())];
    read.extend(found.stations.iter().map(|station| ("the application", station.path.as_deref())));
    let own = Own { directory: options.out.as_deref(), files: occupied::RUN.results };
    outputs::check(&options.exports.files(), &read, own)?;
    let schedule = Schedule::new(&flat(&options.types), options.reps, options.seed);
    let path = options.out.clone().unwrap_or_else(|| default_path(&cell));
    let text = found.stations.first().filter(|_| cell.application.is_some()).map(|first| first.text.as_str());
    let mut directory = CellDirectory::create(&path, &cell, text)?;
    let keep = match options.capture {
        Capture::Always => Some(Retention::All),
        Capture::OnFailure => Some(Retention::FirstAndLast),
        Capture::Never => None,
    };
    let capture = keep.map(|keep| (path.clone(), keep));
    let mut results = CellResults::new(&cell, &planned, Mode::Virtual, &schedule);
    results.digests = Some(directory.digests().clone());
    let mut save = |step: &Step, outcome: &anyhow::Result<CellSample>, results: &CellResults| {
        directory.save(step, outcome, results)
    };
    let mut traces = CellTrace::default();
    let always = options.capture == Capture::Always;
    let executed = execute(plant, &schedule, &mut results, (&mut save, &mut traces), (capture, always));
    let failure = match executed {
        Ok(failure) => failure,
        Err(error) => {
            directory.discard();
            return Err(error);
        }
    };
    if failure.is_none() {
        add_alone(&mut results, &planned, &schedule)?;
    }
    directory.save_results(&results)?;
    directory.save_trace(&traces)?;
    if options.trace {
        cell_files::save_timeline(&path, &planned, &traces)?;
    }
    #[cfg(feature = "mcap")]
    if options.mcap {
        cell_files::save_playback(&path, &cell, &planned, &traces)?;
    }
    let pages = pages::write(&path)?;
    for (_, file) in options.exports.files() {
        let Some(file) = file else { continue };
        replace(file, &results.to_json().context("cannot write the results as JSON")?, Durability::Synced)?;
    }
    outln!("{}", cell_table::render(&results));
    outln!("  Saved in {}.", in_shell(path.display()));
    outln!("  Report: {}", in_shell(pages.report.display()));
    if let Some(race) = pages.race {
        outln!("  Race: {}, all arms in one scene.", in_shell(race.display()));
    }
    Ok(failure.map_or(Exit::Pass, |error| {
        errln!("error: {error:#}");
        Exit::of_run(&error)
    }))
}

/// What a planned cell runs, and what its repetitions are compared with.
struct Plant {
    stations: Vec<PlannedStation>,
    relative_pose: RelativePose,
}

impl Plant {
    fn of(cell: &Cell, planned: &PlannedCell) -> Result<Self, Failure> {
        let stations = PlannedStation::all(planned).map_err(|error| Failure::new(Exit::Usage, error))?;
        let relative_pose = RelativePose::new(cell, &planned.marks, &stations);
        Ok(Self { stations, relative_pose })
    }
}

/// Executes a whole schedule without a directory.
///
/// # Errors
///
/// The stations do not connect, or a repetition fails.
pub fn whole(cell: &Cell, found: &FoundCell, schedule: &Schedule) -> Result<CellResults, Failure> {
    let planned = found.plan(cell)?;
    let mut results = CellResults::new(cell, &planned, Mode::Virtual, schedule);
    let mut traces = CellTrace::default();
    let outputs: (Save<'_>, _) = (&mut |_, _, _| Ok(()), &mut traces);
    match execute(Plant::of(cell, &planned)?, schedule, &mut results, outputs, (None, false))? {
        None => Ok(results),
        Some(error) => Err(Failure::new(Exit::of_run(&error), error.context("the virtual run failed"))),
    }
}

/// Saves a repetition and the results so far.
type Save<'a> = &'a mut dyn FnMut(&Step, &anyhow::Result<CellSample>, &CellResults) -> anyhow::Result<()>;

/// Executes a schedule, and saves each repetition before the next one. Returns the error of a repetition that failed.
fn execute(
    plant: Plant,
    schedule: &Schedule,
    results: &mut CellResults,
    (save, traces): (Save<'_>, &mut CellTrace),
    (capture, always): (Option<(PathBuf, Retention)>, bool),
) -> Result<Option<anyhow::Error>, Failure> {
    // In virtual time nothing but the setup keeps the stations from connecting.
    let Plant { stations, mut relative_pose } = plant;
    let mut run = CellRun::start_captured(&stations, schedule.seed, capture)
        .map_err(|error| Failure::new(Exit::Usage, error))?;
    let mut verifications: Vec<_> = stations.into_iter().map(StationVerification::new).collect();
    for step in schedule.steps() {
        let execution_type = step.execution_type;
        let outcome = run.execute(step).and_then(|CellMeasured { mut sample, stations }| {
            for (verification, of_station) in verifications.iter_mut().zip(&stations) {
                verification.check(of_station)?;
            }
            sample.relative_pose_mm = relative_pose.of(execution_type, run.recordings())?;
            Ok(sample)
        });
        if step.repetition == 1 {
            traces.set(execution_type, run.recordings());
        }
        match &outcome {
            Ok(sample) => results.record(step.execution_type, sample),
            Err(error) => {
                results.status = Status::Failed;
                results.record_failure(step.execution_type, step.repetition, format!("{error:#}"));
            }
        }
        results.set_health(&run.health());
        save(&step, &outcome, results)?;
        if let Err(error) = outcome {
            run.end_capture(true)?;
            return Ok(Some(error));
        }
    }
    run.end_capture(always)?;
    results.status = Status::Complete;
    Ok(None)
}

/// Refuses what cells do not have yet.
fn check_options(options: &RunOptions) -> Result<(), Failure> {
    if options.mode == Mode::Real {
        let error = anyhow!(
            "a setup of several stations runs in virtual time only so far: add `--mode virtual`, or take a setup of one station"
        );
        return Err(Failure::new(Exit::Usage, error));
    }
    let exports = options.exports.files();
    let export = exports.iter().find(|(name, file)| file.is_some() && *name != "--export-json");
    let refused = [
        ("--application", options.application.is_some()),
        ("--cyclic", options.cyclic.is_some()),
        ("--drives", !options.drives.in_command().is_empty()),
        ("--attach", options.attach.is_some()),
        ("--override", options.overrides.is_some()),
        ("--fault", !options.fault.is_empty()),
        ("--live", options.live.is_some()),
    ];
    let given = refused.iter().find(|(_, is_given)| *is_given).map(|(name, _)| *name);
    match given.or(export.map(|(name, _)| *name)) {
        None => Ok(()),
        Some(name) => {
            let error =
                anyhow!("{name} is for setups of one station so far; leave it out with several stations");
            Err(Failure::new(Exit::Usage, error))
        }
    }
}

fn default_path(cell: &Cell) -> PathBuf {
    run_directory::default_path(&cell.name, Mode::Virtual.name(), SystemTime::now())
}
