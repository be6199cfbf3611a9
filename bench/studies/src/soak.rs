//! `bench soak`: many hours of the plant in virtual time, with faults all the time and many seeds. It verifies every
//! repetition, and checks that memory and descriptors of this process do not grow.

mod cell;
mod counts;
mod growth;
mod never_ready;

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::anyhow;
use clap::Args;
use node::list::{List, flat};
use plc_node::ExecutionType;
use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;
use setup::Setup;

use cell::SoakedCell;
use counts::{Counts, HEAD};
use growth::{Growth, Held};
use never_ready::NeverReady;

use super::engine::claim::{RowsOrigin, StudyClaim};
use super::engine::numbered::NumberedJobs;
use super::event_loop::{interrupted, watch_for_interrupt};
use super::jobs::Pool;
use super::setup_option::{DrivesOption, SetupOption};
use records::exit::{Exit, Failure};
use records::faults::{self, Fault};
use records::mode::Mode;
use records::schedule::Schedule;
use report::{in_shell, outln};
use stands::planned_cell::PlannedCell;
use stands::verification::{Difference, DriveDeviation, Verification};
use stands::virtual_run::{Extras, VirtualRun};

/// Faults of a cell in the soak: more of each than any plant has.
const BACKGROUND: &str =
    "loss=0.001 duplicate=0.0005 jitter=100us reorder=0.0005@2ms corrupt=0.0001@memory corrupt=0.0001@wire";

/// Mean time between two faults of drives in a life.
const DRIVE_FAULT_EVERY: Duration = Duration::from_secs(30);

/// Longest soak, which is about eleven years.
const MOST_HOURS: f64 = 100_000.0;

/// The file with the counts of each life.
const LIVES: &str = "lives.csv";

/// Options of the soak.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  bench soak                                  an hour of the plant, a minute or less here
  bench soak --setup B --hours 100 --threads 1
  bench soak --hours 1000 --out soaked        given again, it goes on after an interrupt or a kill")]
pub struct SoakOptions {
    /// Which setup.
    #[command(flatten)]
    pub setup: SetupOption,
    /// What moves the robot's joints. With drives every life also has blocks of 20 to 500 ms, faults and stops of drives, drawn
    /// by its seed.
    #[command(flatten)]
    pub drives: DrivesOption,
    /// Hours of the plant.
    #[arg(long, value_name = "N", default_value_t = 1.0, value_parser = hours)]
    pub hours: f64,
    /// Minutes of the plant after which a cell is switched off, and another one with the next seed is switched on; at most the
    /// hours.
    #[arg(long, value_name = "N", default_value_t = 60.0, value_parser = minutes)]
    pub life_minutes: f64,
    /// Faults of every life; commas or blanks between them.
    #[arg(long, value_name = "FAULT", default_value = BACKGROUND, num_args = 1..)]
    pub fault: Vec<List<Fault>>,
    /// Seed of the first life.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Directory that keeps the counts of each life; given again, an interrupted soak goes on [default: nothing is kept].
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Lives at a time [default: one a core].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub threads: Option<u16>,
    /// Print the result only: no progress.
    #[arg(long, short)]
    pub quiet: bool,
}

fn hours(text: &str) -> Result<f64, String> {
    let hours: f64 = text.parse().map_err(|_| "not a number of hours".to_owned())?;
    if hours > 0.0 && hours <= MOST_HOURS {
        Ok(hours)
    } else {
        Err(format!("a soak takes above 0 and at most {MOST_HOURS} hours"))
    }
}

fn minutes(text: &str) -> Result<f64, String> {
    let minutes: f64 = text.parse().map_err(|_| "not a number of minutes".to_owned())?;
    if (1.0..=MOST_HOURS * 60.0).contains(&minutes) {
        Ok(minutes)
    } else {
        Err(format!("a life takes 1 to {} minutes", MOST_HOURS * 60.0))
    }
}

/// Runs all cells one after another and prints their results.
///
/// # Errors
///
/// The setup cannot be read, a cell is not ready again after a failed run, or the kernel does not say what this process has.
pub fn run(options: &SoakOptions, commit: &str) -> Result<Exit, Failure> {
    let faults = flat(&options.fault);
    check_kills(&faults)?;
    if let Some(cell) = options.setup.of_several() {
        if !options.drives.in_command().is_empty() {
            let error = anyhow!(
                "--drives is for setups of one station; write `drives = \"ethercat\"` at a station's robot"
            );
            return Err(Failure::new(Exit::Usage, error));
        }
        let (_, found) = planning::cell_with_applications(options.setup.name())?;
        let described = setup::cell_to_toml(&cell)? + &found.text(&cell);
        let cell = SoakedCell::new(&cell, &found, &faults)?;
        let described = (cell.name.as_str(), described);
        let claim = options.claim(described, &faults, commit)?;
        return soak(options, &cell.name, claim.as_ref(), |seed, life, interrupted| {
            cell.live(seed, life, interrupted)
        });
    }
    let (setup, found) = options.setup.load()?;
    let setup = options.drives.applied_to(setup)?;
    faults::check_one_robot(&faults, &setup.name).map_err(|error| Failure::new(Exit::Usage, error))?;
    faults::check(&faults, &setup).map_err(|error| Failure::new(Exit::Usage, error))?;
    let planned = PlannedCell::of_plan(&setup, &found.application, &found.plan(&setup)?)?;
    let described = (setup.name.as_str(), setup::setup_to_toml(&setup)? + &found.text);
    let claim = options.claim(described, &faults, commit)?;
    soak(options, &setup.name, claim.as_ref(), |seed, life, interrupted| {
        live(&setup, &planned, &faults, seed, life, interrupted)
    })
}

/// Runs all lives of a setup of this name, and prints their results.
fn soak(
    options: &SoakOptions,
    name: &str,
    claim: Option<&StudyClaim>,
    live: impl Fn(u64, Duration, &AtomicBool) -> anyhow::Result<Counts> + Sync,
) -> Result<Exit, Failure> {
    let started = Instant::now();
    let (lives, life) = options.lives();
    let seed = |number| options.seed.wrapping_add(number);
    let (mut all, mut held) = (Counts::default(), Vec::new());
    let is_interrupted = watch_for_interrupt()?;
    let pool =
        Pool { name: "soak", quiet: options.quiet, threads: options.threads, interrupted: &is_interrupted };
    let mut jobs = NumberedJobs::in_memory(pool, lives);
    if let Some(claim) = claim {
        jobs = jobs.saved_in(claim, LIVES, HEAD, |_, fields| {
            all.add(Counts::of_fields(fields)?);
            Some(())
        })?;
    }
    let lived = jobs.each(
        |number| live(seed(number), life, &is_interrupted),
        |number, counts| {
            let line = counts.line(seed(number));
            all.add(counts);
            held.push(Held::now()?);
            Ok(line)
        },
    );
    let lived = lived.map_err(failure)?;
    let growth = Growth::of(&held);
    outln!("Setup {name}, {} {growth}", all.summary(lived, started.elapsed()));
    if is_interrupted.load(Ordering::Relaxed) {
        let exit = interrupted(lived as usize, lives as usize, "lives");
        return Ok(if all.altered == 0 { exit } else { Exit::RunFailed });
    }
    let is_well = all.altered == 0 && all.passed > 0 && growth.is_none();
    Ok(if is_well { Exit::Pass } else { Exit::RunFailed })
}

/// Draws a fault of a drive for each part of a life, of all kinds, axes and lengths; none for a robot without drives.
fn drive_faults(setup: &Setup, seed: u64, life: Duration) -> anyhow::Result<Vec<Fault>> {
    if setup.robot.drives.is_none() {
        return Ok(Vec::new());
    }
    let mut random = Pcg64Mcg::seed_from_u64(seed.rotate_left(31) ^ 0xD41E);
    let mut below = |bound: u64| ((u128::from(random.next_u64()) * u128::from(bound)) >> 64) as u64;
    let (axes, part_ms) =
        (setup.robot.axes.lower_deg.value.len() as u64, DRIVE_FAULT_EVERY.as_millis() as u64);
    let parts = u64::try_from(life.as_millis()).unwrap_or(u64::MAX) / part_ms;
    let mut fault = |part: u64| {
        let (axis, at_ms) = (1 + below(axes), part * part_ms + below(part_ms));
        let text = match below(4) {
            0 => format!("drive-fault={axis}@{at_ms}ms"),
            1 => format!("drive-stop={axis}@{at_ms}ms"),
            _ => format!("drive-block={axis}@{at_ms}ms..{}ms", at_ms + 20 + below(481)),
        };
        Ok(text.parse()?)
    };
    (0..parts).map(&mut fault).collect()
}

/// Rejects faults after which a cell is dead.
fn check_kills(faults: &[Fault]) -> Result<(), Failure> {
    match faults.iter().find(|fault| fault.kills()) {
        None => Ok(()),
        Some(fault) => {
            let error = anyhow!(
                "`{fault}` ends a cell for good, and a soak goes on after each fault: a node that is started again is \
                 to-robot:restart-robot=17@100ms or to-plc:restart-plc=17@100ms"
            );
            Err(Failure::new(Exit::Usage, error))
        }
    }
}

/// Returns the failure of a soak: a cell that never gets ready again is one of its faults.
fn failure(failure: Failure) -> Failure {
    if failure.error.is::<NeverReady>() { Failure::new(Exit::RunFailed, failure.error) } else { failure }
}

/// Runs a cell with these faults for this time, or until an interrupt: one repetition of each type after the other.
fn live(
    setup: &Setup,
    planned: &PlannedCell,
    faults: &[Fault],
    seed: u64,
    life: Duration,
    is_interrupted: &AtomicBool,
) -> anyhow::Result<Counts> {
    let of_drives = drive_faults(setup, seed, life)?;
    let extras = Extras { faults: [faults, &of_drives].concat(), ..Extras::default() };
    let mut verification = Verification::of(setup, planned.clone(), Mode::Virtual, faults)?;
    let mut run = VirtualRun::switch_on(setup, planned.clone(), seed, &extras)?;
    let mut counts = Counts::default();
    // Connects again after the faults ended a connection.
    let mut connected = run.connect();
    for step in Schedule::new(&ExecutionType::ALL, u32::MAX, seed).steps() {
        let ended = connected
            .and_then(|()| run.execute_unrecorded(step))
            .and_then(|measured| verification.check(&measured));
        connected = Ok(());
        match ended {
            Ok(()) => counts.passed += 1,
            Err(error) if error.is::<Difference>() => counts.differ(seed, &error),
            // What holds an axis also moves the arm off its path: the repetition fails, and the next one passes.
            Err(error) if error.is::<DriveDeviation>() && extras.faults.iter().any(Fault::is_of_drive) => {
                counts.refuse(seed, &error);
            }
            Err(error) => {
                counts.refuse(seed, &error);
                run.recover().map_err(|then| NeverReady::new(seed, &error, &then, faults))?;
            }
        }
        if run.plant_time() >= life {
            break;
        }
        if is_interrupted.load(Ordering::Relaxed) {
            counts.is_cut = true;
            break;
        }
    }
    counts.plant = run.plant_time();
    Ok(counts)
}

impl SoakOptions {
    /// Returns how many lives there are, and how long each is.
    fn lives(&self) -> (u64, Duration) {
        let minutes = self.hours * 60.0;
        let life = self.life_minutes.min(minutes);
        ((minutes / life).ceil() as u64, Duration::from_secs_f64(life * 60.0))
    }

    /// Claims the directory that keeps the lives, if there is one, for a setup with its applications and these faults.
    fn claim(
        &self,
        (name, described): (&str, String),
        faults: &[Fault],
        commit: &str,
    ) -> Result<Option<StudyClaim>, Failure> {
        let Some(directory) = self.out.as_deref() else { return Ok(None) };
        let Self { hours, life_minutes, seed, .. } = self;
        let faults = faults::listed(faults);
        let command = format!(
            "--setup {}{} --hours {hours} --life-minutes {life_minutes} --seed {seed} --fault {}",
            in_shell(self.setup.name()),
            self.drives.in_command(),
            in_shell(&faults)
        );
        let (lives, life) = self.lives();
        let jobs = format!("soak {name} {lives} {life:?} {seed} {faults}\n{described}");
        let (options, command, results) = (jobs.as_str(), command.as_str(), &[LIVES]);
        StudyClaim::checked(RowsOrigin { directory, options, command, results, commit }).map(Some)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::FromArgMatches as _;
    use setup::Refill;

    fn options(arguments: &[&str]) -> Result<SoakOptions, clap::Error> {
        let command = SoakOptions::augment_args(clap::Command::new("soak").no_binary_name(true));
        command.try_get_matches_from(arguments).and_then(|found| SoakOptions::from_arg_matches(&found))
    }

    #[test]
    fn a_soak_takes_a_number_of_hours_and_no_life_is_longer_than_that() {
        for wrong in ["inf", "nan", "0", "-1", "1e300", "an hour"] {
            options(&["--hours", wrong]).unwrap_err();
            options(&["--life-minutes", wrong]).unwrap_err();
        }
        let lives = |arguments: &[&str]| {
            let (lives, life) = options(arguments).unwrap().lives();
            (lives, life.as_secs_f64())
        };
        assert_eq!(lives(&[]), (1, 3_600.0));
        assert_eq!(lives(&["--hours", "0.02"]), (1, 72.0));
        assert_eq!(lives(&["--hours", "2.5"]), (3, 3_600.0));
        assert_eq!(lives(&["--hours", "100000", "--life-minutes", "1"]), (6_000_000, 60.0));
    }

    #[test]
    fn a_fault_that_kills_a_node_for_good_is_refused_and_one_that_restarts_it_is_not() {
        let fault = |text: &str| [text.parse::<Fault>().unwrap()];
        for kill in ["kill-robot-at=2s", "kill-plc-at=2s"] {
            let refused = check_kills(&fault(kill)).unwrap_err();
            assert_eq!(refused.exit, Exit::Usage);
            assert!(refused.error.to_string().contains(kill), "{}", refused.error);
        }
        check_kills(&fault("to-robot:restart-robot=17@100ms")).unwrap();
        check_kills(&fault("cut-at=2s..3s")).unwrap();
    }

    #[test]
    fn a_cell_that_never_gets_ready_fails_the_soak_by_its_faults() {
        let (setup, found) = planning::setup_with_application("A").unwrap();
        let planned = PlannedCell::of(&setup, &found.application).unwrap();
        let (faults, go_on) = (["loss=1".parse().unwrap()], AtomicBool::new(false));
        let error = live(&setup, &planned, &faults, 7, Duration::from_secs(60), &go_on).unwrap_err();
        let said = error.to_string();
        assert!(said.starts_with("seed 7: no connection to the robot: "), "{said}");
        assert!(said.ends_with("; the faults of every life are loss=1"), "{said}");
        assert_eq!(failure(error.into()).exit, Exit::RunFailed);
    }

    /// Lives for a minute of the plant.
    fn minute_of(setup: &Setup, application: &planning::Application) -> Counts {
        let planned = PlannedCell::of(setup, application).unwrap();
        let faults: Vec<Fault> = BACKGROUND.split(' ').map(|fault| fault.parse().unwrap()).collect();
        let go_on = AtomicBool::new(false);
        let counts = live(setup, &planned, &faults, 1, Duration::from_secs(60), &go_on).unwrap();
        assert!(counts.plant >= Duration::from_secs(60) && counts.passed > 5, "{counts:?}");
        counts
    }

    #[test]
    fn a_minute_of_the_plant_with_many_faults_passes_on_every_bus() {
        for (setup, drives) in [("A", None), ("B", None), ("C", None), ("D", Some(setup::Drives::Ethercat))] {
            let (setup, found) = planning::setup_with_application(setup).unwrap();
            let setup = drives.iter().fold(setup, |setup, drives| setup.with_drives(*drives));
            assert_eq!(minute_of(&setup, &found.application).altered, 0);
        }
    }

    #[test]
    fn a_minute_of_compact_points_with_many_faults_passes_on_every_bus() {
        let circle = include_str!("../../../cell/planning/tests/circle.toml");
        let application = planning::Application::parse("circle.toml", circle).unwrap();
        for (setup, refill) in [("A", Refill::Accepted), ("B", Refill::Accepted), ("C", Refill::Executed)] {
            let setup = setup::setup(setup).unwrap().with_queue_motions(64).with_refill(refill);
            assert_eq!(minute_of(&setup.with_form_compact(), &application).altered, 0);
        }
    }
}
