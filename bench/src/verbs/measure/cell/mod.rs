//! A measured run of a cell with several stations, from its options to its table and exit code.

mod measurement;
mod session;

use std::path::Path;

use ::node::token::ControlToken;
use anyhow::anyhow;
use node::list::flat;
use planning::FoundCell;
use setup::Cell;

use super::RunOptions;
use measurement::CellMeasurement;
use records::cell_results::CellResults;
use records::exit::{Exit, Failure};
use records::faults::{self, Fault};
use records::mode::Mode;
use records::occupied;
use records::results::Status;
use records::schedule::Schedule;
use report::pages::{self, Pages, WantedPages};
use report::{cell_table, errln, in_shell, outln};
use session::{CellEnded, Judge};
use stands::cell_stand::CellStand as _;
use stands::planned_station::PlannedStation;
#[cfg(all(feature = "real", target_os = "linux"))]
use stands::rig;
use stands::virtual_run::CellRun;
use studies::event_loop::event_loop;
use studies::outputs::{self, Own};

/// Runs a cell and prints its table.
///
/// # Errors
///
/// The options, the setup, the computer or the disk does not allow it. A failed repetition is not an error: the table
/// is printed as far as it is complete, and the exit code reports the failure.
pub fn run(options: &RunOptions) -> Result<Exit, Failure> {
    check_options(options)?;
    let (mut cell, found) =
        planning::cell_and_application(options.setup.name(), options.application.as_deref())?;
    apply_cyclic(options, &mut cell)?;
    let cell = options.drives.applied_to_cell(cell)?;
    let planned = found.plan(&cell)?;
    let stations = PlannedStation::all(&planned).map_err(usage)?;
    check_outputs(options, &found)?;
    let faults = flat(&options.fault);
    check_faults(&faults, &cell, options.mode)?;
    let live = options.live.map(|address| super::live_view::reserve(address, options.mode)).transpose()?;
    let mut token = None;
    if let Some(attach) = &options.attach {
        super::check_attach(options)?;
        let names: Vec<_> = cell.names().collect();
        attach.check_all(&cell.name, &names).map_err(usage)?;
        token = ControlToken::find(options.control_token.as_deref()).map_err(usage)?;
    }
    if options.mode == Mode::Real {
        #[cfg(not(all(feature = "real", target_os = "linux")))]
        return Err(super::no_real_mode());
        #[cfg(all(feature = "real", target_os = "linux"))]
        if options.attach.is_none() {
            // The kernel allows it only while this process has one thread.
            rig::enter_user_namespace()?;
        }
    }
    let schedule = Schedule {
        overrides: options.overrides,
        ..Schedule::new(&flat(&options.types), options.reps, options.seed)
    };
    let texts: Vec<_> = found.stations.iter().map(|station| station.text.clone()).collect();
    let applications = found.text(&cell);
    let measurement = CellMeasurement {
        options,
        faults,
        cell,
        planned,
        stations,
        texts,
        applications,
        schedule,
        token,
        live,
    };
    let (ended, directory, live) = event_loop()?.block_on(measurement.run())?;
    if options.quiet && ended.exit == Exit::Pass {
        outln!("{}", cell_table::figures(&ended.results));
        super::write_quietly(&directory, options.pages());
    } else {
        outln!("{}", cell_table::render(&ended.results));
        print_where(&ended, &directory, options.pages());
    }
    live.into_iter().for_each(|live| live.close(Some(&directory)));
    ended.failures.iter().for_each(|error| errln!("error: {error:#}"));
    Ok(ended.exit)
}

/// Prints where the run is saved, how much of it, and where its report is.
fn print_where(ended: &CellEnded, directory: &Path, wanted: WantedPages) {
    let shown = in_shell(directory.display());
    match ended.exit {
        Exit::Internal => outln!("  Saved in {shown} as far as the disk took it."),
        Exit::Interrupted => {
            let (saved, all) = ended.results.saved_of_all();
            outln!("  Interrupted, {saved} of {all} repetitions saved in {shown}.");
        }
        _ => outln!("  Saved in {shown}."),
    }
    if ended.exit == Exit::Internal {
        return;
    }
    match pages::write(directory, wanted) {
        Ok(Pages { report, race, .. }) => {
            if wanted.report {
                outln!("  Report: {}.", in_shell(report.display()));
            }
            if let Some(race) = race {
                outln!("  Race: {}, all arms in one scene.", in_shell(race.display()));
            }
        }
        Err(Failure { error, .. }) => super::warn_of_report(&error, directory),
    }
}

fn usage(error: impl Into<anyhow::Error>) -> Failure {
    Failure::new(Exit::Usage, error)
}

/// Executes a whole schedule in virtual time, without a directory.
///
/// # Errors
///
/// The stations do not connect, or a repetition fails.
pub fn whole(cell: &Cell, found: &FoundCell, schedule: &Schedule) -> Result<CellResults, Failure> {
    let planned = found.plan(cell)?;
    let mut results = CellResults::new(cell, &planned, Mode::Virtual, schedule);
    let stations = PlannedStation::all(&planned).map_err(usage)?;
    // In virtual time nothing but the setup keeps the stations from connecting.
    let mut run = CellRun::start(&stations, schedule.seed).map_err(usage)?;
    let mut judge = Judge::new(cell, &planned, &stations);
    for step in schedule.steps() {
        let outcome = CellRun::execute(&mut run, step);
        if let Err(error) = judge.record(&mut results, &step, outcome, run.recordings()) {
            return Err(Failure::new(Exit::of_run(&error), error.context("the virtual run failed")));
        }
    }
    CellRun::health(&run).write_to(&mut results);
    results.status = Status::Complete;
    Ok(results)
}

/// Rejects exports that cannot be written, or that would replace what the run reads or measures.
fn check_outputs(options: &RunOptions, found: &FoundCell) -> Result<(), Failure> {
    let mut read = vec![
        ("the setup", options.setup.file()),
        ("the token of the control ports", options.control_token.as_deref()),
    ];
    read.extend(found.stations.iter().map(|station| ("the application", station.path.as_deref())));
    let own = Own { directory: options.out.as_deref(), files: occupied::RUN.results };
    outputs::check(&options.exports.files(), &read, own)
}

/// Rejects faults that no station, or the mode, can have.
fn check_faults(faults: &[Fault], cell: &Cell, mode: Mode) -> Result<(), Failure> {
    faults::check_cell(faults, cell).map_err(usage)?;
    match mode {
        Mode::Real => faults::check_real(faults).map_err(usage),
        Mode::Virtual => Ok(()),
    }
}

/// Sets the transport of cyclic frames on the stations that PROFINET serves.
fn apply_cyclic(options: &RunOptions, cell: &mut Cell) -> Result<(), Failure> {
    let Some(cyclic) = options.cyclic else { return Ok(()) };
    let mut is_set = false;
    for station in &mut cell.stations {
        is_set |= station.bus.set_cyclic(cyclic.into());
    }
    if !is_set {
        return Err(usage(anyhow!(
            "--cyclic: no station of setup {} uses PROFINET; leave it out, or take a setup with a PROFINET station",
            cell.name
        )));
    }
    Ok(setup::check_cell(cell)?)
}

/// Refuses what cells do not have yet.
fn check_options(options: &RunOptions) -> Result<(), Failure> {
    if options.plc_program.is_some() {
        return Err(usage(anyhow!(
            "--plc-program: exported code commands one robot, and setup {} has several; leave it out, or take a setup of one station",
            options.setup.name()
        )));
    }
    if options.mcap && !cfg!(feature = "mcap") { Err(super::no_mcap()) } else { Ok(()) }
}
