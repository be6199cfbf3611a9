//! A measured run: from its options to its table and exit code.

pub mod alone;
pub mod cell;
mod live_view;
mod measurement;
mod options;
mod reference_runs;
pub mod session;

pub use options::{Capture, RunOptions, RunPart};

use std::path::Path;

use ::node::token::ControlToken;
use anyhow::anyhow;
use node::list::flat;
use planning::{Found, Reached};
use robot_node::RobotConfig;
use setup::Setup;

use measurement::Measurement;
use records::exit::{Exit, Failure};
use records::faults;
use records::mode::Mode;
use records::occupied;
use records::schedule::Schedule;
use report::outln;
use report::pages::{self, Pages, WantedPages};
use report::table;
use report::{errln, in_shell};
use session::Ended;
#[cfg(all(feature = "real", target_os = "linux"))]
use stands::rig;
use studies::event_loop::event_loop;
use studies::outputs::{self, Own};

/// Runs a measurement and prints its table.
///
/// # Errors
///
/// The options, the setup, the computer or the disk does not allow it. A failed repetition is not an error: the table
/// is printed as far as it is complete, and the exit code reports the failure.
pub fn run(options: &RunOptions) -> Result<Exit, Failure> {
    if options.setup.of_several().is_some() {
        return cell::run(options);
    }
    let (setup, found) = load(options)?;
    let plan = found.plan(&setup)?;
    let reached = check_robot(&setup, &found, &plan)?;
    let warnings = [plan.warnings(), reached.warnings()].concat();
    check_outputs(options, &found)?;
    check_faults(options, &setup)?;
    let code = options.plc_program.as_deref().map(plc_node::read_program).transpose();
    let code = code.map_err(|error| Failure::new(Exit::Usage, error))?;
    let live = options.live.map(|address| live_view::reserve(address, options.mode)).transpose()?;
    let mut token = None;
    if let Some(attach) = &options.attach {
        check_attach(options)?;
        attach.check_one(&setup.name).map_err(|error| Failure::new(Exit::Usage, error))?;
        token = ControlToken::find(options.control_token.as_deref())
            .map_err(|error| Failure::new(Exit::Usage, error))?;
    }
    if options.mode == Mode::Real {
        #[cfg(not(all(feature = "real", target_os = "linux")))]
        return Err(no_real_mode());
        #[cfg(all(feature = "real", target_os = "linux"))]
        if options.attach.is_none() {
            // The kernel allows it only while this process has one thread.
            rig::enter_user_namespace()?;
        }
    }
    let measurement = Measurement {
        faults: flat(&options.fault),
        schedule: Schedule {
            overrides: options.overrides,
            ..Schedule::new(&flat(&options.types), options.reps, options.seed)
        },
        options,
        setup,
        found,
        warnings,
        token,
        live,
        code,
    };
    let runtime = event_loop()?;
    let (ended, directory, live) = runtime.block_on(measurement.run())?;
    if options.quiet && ended.exit == Exit::Pass {
        outln!("{}", table::figures(&ended.results));
        write_quietly(&directory, options.pages());
    } else {
        outln!("{}", table::render(&ended.results));
        print_where(&ended, &directory, options.pages());
    }
    live.into_iter().for_each(|live| live.close(Some(&directory)));
    ended.failures.iter().for_each(|error| errln!("error: {error:#}"));
    Ok(ended.exit)
}

/// Returns the failure of real mode in a bench that was built without it.
#[cfg(not(all(feature = "real", target_os = "linux")))]
fn no_real_mode() -> Failure {
    let error = anyhow!(
        "this bench was built without real mode: add `--mode virtual`, or build it on Linux with the feature `real`"
    );
    Failure::new(Exit::EnvironmentUnusable, error)
}

/// Loads the setup with the options in it, and the application.
fn load(options: &RunOptions) -> Result<(Setup, Found), Failure> {
    let (mut setup, found) = options.setup.load_with(options.application.as_deref())?;
    if let Some(cyclic) = options.cyclic {
        if !setup.bus.set_cyclic(cyclic.into()) {
            let error = anyhow!("--cyclic is about PROFINET, and setup {} does not use it", setup.name);
            return Err(Failure::new(Exit::Usage, error));
        }
        setup::check(&setup)?;
    }
    Ok((options.drives.applied_to(setup)?, found))
}

/// Rejects exports that cannot be written, or that would replace what the run reads or measures.
fn check_outputs(options: &RunOptions, found: &Found) -> Result<(), Failure> {
    let read = [
        ("the setup", options.setup.file()),
        ("the application", found.path.as_deref()),
        ("the token of the control ports", options.control_token.as_deref()),
    ];
    let own = Own { directory: options.out.as_deref(), files: occupied::RUN.results };
    outputs::check(&options.exports.files(), &read, own)?;
    if options.mcap && !cfg!(feature = "mcap") {
        return Err(no_mcap());
    }
    Ok(())
}

/// Returns the failure of `--mcap` in a bench that was built without it.
fn no_mcap() -> Failure {
    let error = anyhow!(
        "--mcap is not built into this bench: `cargo build -p bench --features mcap` makes one that has it, and \
         `cargo run -p bench --features mcap -- …` runs it"
    );
    Failure::new(Exit::Usage, error)
}

/// Rejects faults that the drives, the cable or the mode do not have.
fn check_faults(options: &RunOptions, setup: &Setup) -> Result<(), Failure> {
    let faults = flat(&options.fault);
    faults::check_one_robot(&faults, &setup.name).map_err(|error| Failure::new(Exit::Usage, error))?;
    faults::check(&faults, setup).map_err(|error| Failure::new(Exit::Usage, error))?;
    if options.mode == Mode::Real {
        faults::check_real(&faults).map_err(|error| Failure::new(Exit::Usage, error))?;
    }
    Ok(())
}

/// Writes the pages of a run that passed and prints only a warning where that fails.
fn write_quietly(directory: &Path, wanted: WantedPages) {
    if let Err(Failure { error, .. }) = pages::write(directory, wanted) {
        warn_of_report(&error, directory);
    }
}

fn warn_of_report(error: &anyhow::Error, directory: &Path) {
    errln!(
        "warning: the results are saved, but their report is not: {error:#}; `bench report {}` draws it again",
        in_shell(directory.display())
    );
}

/// Prints where the run is saved, how much of it, and where its report is.
fn print_where(ended: &Ended, directory: &Path, wanted: WantedPages) {
    let shown = directory.display();
    if ended.exit == Exit::Internal {
        outln!(
            "  Saved in {shown} as far as the disk took it; `bench report {}` shows that.",
            in_shell(&shown)
        );
        return;
    }
    if ended.exit == Exit::Interrupted {
        let (saved, all) = ended.results.saved_of_all();
        outln!("  Interrupted, {saved} of {all} repetitions saved in {shown}.");
    } else {
        outln!("  Saved in {shown}.");
    }
    match pages::write(directory, wanted) {
        Ok(Pages { report, race, .. }) => {
            if wanted.report {
                outln!("  Report: {}.", report.display());
            }
            if let Some(race) = race {
                outln!("  Race: {}, the arms side by side.", race.display());
            }
        }
        Err(Failure { error, .. }) => warn_of_report(&error, directory),
    }
}

/// Checks that the setup describes a robot, that it can stand where the application starts, and that its arm reaches
/// every motion of the plan. Returns where the arm stands in it.
fn check_robot(setup: &Setup, found: &Found, plan: &planning::Plan) -> Result<Reached, Failure> {
    let robot = RobotConfig::from_setup(setup).map_err(|error| Failure::new(Exit::Usage, error))?;
    let reached = found.reach(plan, setup)?;
    let in_cell = robot.in_cell_of(&found.application, &plan.wire_to_start(setup));
    in_cell.map(drop).map_err(|error| Failure::new(Exit::Usage, error))?;
    Ok(reached)
}

/// Rejects options that need nodes started by the bench.
fn check_attach(options: &RunOptions) -> Result<(), Failure> {
    let instead = if options.mode == Mode::Virtual {
        "--attach measures on running nodes, in real time: leave out `--mode virtual`"
    } else if options.capture != Capture::Never {
        "--capture records the network that the bench makes: with --attach, record on the nodes' machine"
    } else if !options.fault.is_empty() {
        "--fault impairs the cable that the bench lays: leave it out with --attach, and impair the nodes' network, by \
         `tc qdisc add dev IF root netem` for instance"
    } else if options.trace || options.mcap {
        "--trace and --mcap record nodes that the bench starts: leave them out with --attach"
    } else {
        return Ok(());
    };
    Err(Failure::new(Exit::Usage, anyhow!(instead)))
}
