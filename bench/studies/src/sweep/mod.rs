//! The starvation sweep: from which bus cycle on a MoveContinuousSkill loses to the robot's own program, for every
//! number of slots and several lengths of motion, and why five slots suffice.
//!
//! ```text
//! grid        the runs: RC and CM round a square, in virtual time
//! ├─ square      that application
//! └─ round_trip  the time from a free slot to the next motion in it
//! found       the results of the grid as sentences
//! table       the grid on screen, and as CSV; page draws it
//! ```

mod found;
mod grid;
mod page;
mod round_trip;
mod square;
pub(crate) mod table;

use std::time::SystemTime;

use clap::Args;
use node::list::{List, flat, list};
use serde::{Deserialize, Serialize};
use setup::Setup;

pub use found::sentences;
pub use grid::{Predicted, SweepGrid, SweepPoint};
pub use round_trip::RoundTrip;
pub use table::{CSV_HEADER, csv, render};

use crate::engine::listed::ListedStudy;
use crate::event_loop::watch_for_interrupt;
use crate::outputs;
use crate::study::{Found, StudyOptions, ended, interrupted};
use records::exit::{Exit, Failure};
use report::outln;

/// Version of the sweep's JSON.
pub const SCHEMA_VERSION: u32 = 1;

/// Motions of a run: six times round the square.
const MOTIONS: u32 = 24;
/// Runs of every point, each at other phases.
const REPETITIONS: u32 = 3;
/// The paper's five slots, and fewer.
const DEPTHS: &str = "1,2,3,4,5";
/// Bus cycles in ms, of those that every bus knows.
const BUS_CYCLES_MS: &str = "1,2,4,8,16,32,64";
/// Lengths of a motion in mm: from a point of a taught curve to a way across the cell.
const LENGTHS_MM: &str = "1,2,5,10,20,50,100";

const EXAMPLES: &str = "\
Examples:
  bench sweep --setup A                       where CM loses to RC, as a table and as a page
  bench sweep --setup B --lengths 0.5,1,2     shorter motions, over EtherNet/IP
  bench sweep --depths 5 --cycles 64 --quiet  one column, for scripts
  bench sweep --export-csv sweep.csv --export-json sweep.json";

/// Options of a sweep.
#[derive(Args, Debug)]
#[command(after_help = EXAMPLES)]
pub struct SweepOptions {
    /// Setup, seed and files.
    #[command(flatten)]
    pub study: StudyOptions,
    /// Slots of the image in use; commas or blanks between several.
    #[arg(long, value_name = "N", num_args = 1.., default_value = DEPTHS, value_parser = list(depth))]
    pub depths: Vec<List<u32>>,
    /// Bus cycles in ms; commas or blanks between several.
    #[arg(long, value_name = "MS", num_args = 1.., default_value = BUS_CYCLES_MS, value_parser = list(milliseconds))]
    pub cycles: Vec<List<u32>>,
    /// Lengths of every motion in mm; commas or blanks between several.
    #[arg(long, value_name = "MM", num_args = 1.., default_value = LENGTHS_MM, value_parser = list(length))]
    pub lengths: Vec<List<f64>>,
    /// Motions of a run; a square has four sides.
    #[arg(long, value_name = "N", default_value_t = MOTIONS, value_parser = clap::value_parser!(u32).range(6..=1_000))]
    pub motions: u32,
    /// Repetitions of every point, each with other phases of the cycles.
    #[arg(long, value_name = "N", default_value_t = REPETITIONS, value_parser = clap::value_parser!(u32).range(1..=1_000))]
    pub reps: u32,
}

fn depth(text: &str) -> Result<u32, String> {
    let depth = text.parse().ok().filter(|depth| (1..=5).contains(depth));
    depth.ok_or_else(|| format!("`{text}`: must be a number of slots, 1 to 5"))
}

/// Parses a bus cycle in ms and returns it in µs.
fn milliseconds(text: &str) -> Result<u32, String> {
    let ms: f64 = text.parse().map_err(|_| "not a number of milliseconds".to_owned())?;
    if ms > 0.0 && ms <= 10_000.0 {
        Ok((ms * 1e3).round() as u32)
    } else {
        Err("a bus cycle is above 0 and at most 10000 ms".to_owned())
    }
}

fn length(text: &str) -> Result<f64, String> {
    let mm: f64 = text.parse().map_err(|_| "not a number of millimetres".to_owned())?;
    if (planning::LEAST_MM..=10_000.0).contains(&mm) {
        Ok(mm)
    } else {
        Err(format!("a length is {} to 10000 mm", planning::LEAST_MM))
    }
}

/// The results of a sweep.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct Sweep {
    /// Version of this format.
    pub schema_version: u32,
    /// The setup's name.
    pub setup: String,
    /// The setup's title.
    pub title: String,
    /// The setup's own bus cycle, in ms.
    pub bus_cycle_ms: f64,
    /// The setup's own slots in use.
    pub queue_depth: u32,
    /// Motions of a run.
    pub motions: u32,
    /// Runs of every point.
    pub reps: u32,
    /// Seed of clocks, phases and pauses.
    pub seed: u64,
    /// Points of the whole grid.
    pub planned: usize,
    /// The points: depth is the slowest to change, length the fastest. An interrupt leaves out the last ones.
    pub points: Vec<SweepPoint>,
}

impl Sweep {
    /// Collects the points of a grid that was run on a setup.
    #[must_use]
    pub fn new(setup: &Setup, grid: &SweepGrid, points: Vec<SweepPoint>) -> Self {
        Self {
            schema_version: SCHEMA_VERSION,
            setup: setup.name.clone(),
            title: setup.title.clone(),
            bus_cycle_ms: f64::from(setup.bus.cycle_us.value) / 1e3,
            queue_depth: setup.plc.slots_in_use(),
            motions: grid.motions,
            reps: grid.reps,
            seed: grid.seed,
            planned: grid.points(),
            points,
        }
    }
}

/// Runs a sweep, prints its table and writes its page.
///
/// # Errors
///
/// The options or the setup do not allow it, a run fails, or the disk does not take the results.
pub fn run(options: &SweepOptions, commit: &str) -> Result<Exit, Failure> {
    let started = SystemTime::now();
    let (setup, found) = options.study.setup.load()?;
    let grid = SweepGrid {
        depths: flat(&options.depths),
        bus_cycles_us: flat(&options.cycles),
        lengths_mm: flat(&options.lengths),
        motions: options.motions,
        reps: options.reps,
        seed: options.study.seed,
    };
    for cycle_us in &grid.bus_cycles_us {
        setup::check(&setup.clone().with_bus_cycle(*cycle_us))?;
    }
    let directory = options.study.prepare("sweep", &setup, &found, started)?;
    let is_interrupted = watch_for_interrupt()?;
    let study = ListedStudy::in_memory("sweep", options.study.quiet, &is_interrupted);
    let study = options.study.with_rows(study, (&setup, &found), &directory, &format!("{grid:?}"), commit)?;
    let points = grid.run(&setup, &found.application, &study)?;
    let sweep = Sweep::new(&setup, &grid, points);
    if sweep.points.is_empty() {
        study.discard_if_empty();
        return Ok(interrupted(&directory, sweep.planned, "points"));
    }
    outln!("{}", render(&sweep));
    let found = Found { json: &outputs::json(&sweep)?, csv: &csv(&sweep), page: Some(&page::page(&sweep)?) };
    options.study.save(&directory, "sweep", &setup, found)?;
    outln!("  Saved in {}.\n  Page: {}.", directory.display(), directory.join("sweep.html").display());
    Ok(ended(sweep.points.len(), sweep.planned, "points"))
}
