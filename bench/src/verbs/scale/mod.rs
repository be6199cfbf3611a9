//! `bench scale`: the cost of a cycle by the number of stations, in virtual time or on a real network.
//!
//! ```text
//! plant         the stations of a measurement
//! virtual_time  PLC, network and robots on one thread
//! real          a PLC on one core, the robots in processes on another one, one cable between them
//! measured      what is saved
//! table, chart  what is shown
//! ```

mod chart;
mod measured;
pub mod plant;
mod real;
mod table;
mod virtual_time;

use std::num::ParseIntError;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use anyhow::Context as _;
use clap::ValueEnum as _;
use node::list::{List, flat, list};
use records::exit::{Exit, Failure};
use records::mode::Mode;
use records::own_memory::OwnMemory;
use records::run_directory::{Durability, replace};
use report::errln;
use report::outln;
use rustix::time::{ClockId, clock_gettime};
use stands::rig;
use studies::event_loop::{interrupted, watch_for_interrupt};
use studies::outputs::{self, Own};

use measured::{Growth, ScaleFigures};
use plant::{MOST_STATIONS, ScaledBus};

pub use real::run_as_robots;

/// Version of the format of `--export-json`.
const SCHEMA_VERSION: u32 = 1;

/// Options of a measurement.
#[derive(clap::Args, Debug)]
pub struct ScaleOptions {
    /// Numbers of stations, 1 to 128, with commas or blanks between them.
    #[arg(long, value_name = "N", num_args = 1.., value_parser = list(stations), default_value = "1,2,8,64")]
    pub stations: Vec<List<u32>>,
    /// Buses to measure: profinet-udp, profinet-rt1, ethernet-ip, ethercat, with commas or blanks between them; all without it.
    #[arg(long, value_name = "BUS", num_args = 1.., value_parser = list(bus))]
    pub buses: Vec<List<ScaledBus>>,
    /// Where the nodes run: in virtual time, or as processes on a real network.
    #[arg(long, value_enum, default_value_t = Mode::Virtual)]
    pub mode: Mode,
    /// Seconds that each bus is measured with each number of stations; in virtual time seconds of the plant.
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..=3_600))]
    pub seconds: u32,
    /// Write the figures to this file as well, as JSON.
    #[arg(long = "export-json", alias = "json", value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Write a page with the tables and a picture into this file.
    #[arg(long, value_name = "FILE")]
    pub html: Option<PathBuf>,
}

fn bus(name: &str) -> Result<ScaledBus, String> {
    let unknown = || {
        format!("unknown bus `{name}`; the buses are profinet-udp, profinet-rt1, ethernet-ip and ethercat")
    };
    ScaledBus::from_str(name, false).map_err(|_| unknown())
}

fn stations(text: &str) -> Result<u32, String> {
    let number = text.parse().map_err(|error: ParseIntError| format!("`{text}`: {error}"))?;
    if (1..=MOST_STATIONS).contains(&number) {
        Ok(number)
    } else {
        Err(format!("{number} stations cannot be measured; give 1 to {MOST_STATIONS}"))
    }
}

/// Measures, prints the tables and writes the files.
pub fn run(options: &ScaleOptions) -> Result<Exit, Failure> {
    let asked = [("--export-json", options.json.as_deref()), ("--html", options.html.as_deref())];
    outputs::check(&asked, &[], Own::default())?;
    let unusable = |error| Failure::new(Exit::EnvironmentUnusable, error);
    if options.mode == Mode::Real {
        rig::enter_user_namespace().map_err(|error| unusable(error.into()))?;
    }
    let is_interrupted = watch_for_interrupt()?;
    let (measured, planned) = measure(options, &is_interrupted).map_err(unusable)?;
    if !measured.rows.is_empty() {
        outln!("{}", table::render(&measured));
        write(options, &measured)?;
    }
    let done = measured.rows.len();
    Ok(if done < planned { interrupted(done, planned, "measurements") } else { Exit::Pass })
}

/// Returns what was measured, and how many rows were wanted.
fn measure(options: &ScaleOptions, is_interrupted: &AtomicBool) -> anyhow::Result<(ScaleFigures, usize)> {
    let chosen = flat(&options.buses);
    let buses = ScaledBus::ALL.into_iter().filter(|bus| chosen.is_empty() || chosen.contains(bus));
    let mut counts = flat(&options.stations);
    counts.sort_unstable();
    counts.dedup();
    let wanted: Vec<_> = buses.flat_map(|bus| counts.iter().map(move |count| (bus, *count))).collect();
    let mut rows = Vec::new();
    for (bus, count) in wanted.iter().copied() {
        errln!("{}: {count} {}", bus.key(), if count == 1 { "station" } else { "stations" });
        let row = match options.mode {
            Mode::Virtual => virtual_time::measure(bus, count, options.seconds, is_interrupted),
            Mode::Real => real::measure(bus, count, options.seconds, is_interrupted),
        };
        match row.with_context(|| format!("{count} stations on {}", bus.key()))? {
            Some(row) => rows.push(row),
            None => break,
        }
    }
    let growth = Growth::of(&rows);
    let (mode, seconds) = (options.mode.name(), options.seconds);
    Ok((ScaleFigures { schema_version: SCHEMA_VERSION, mode, seconds, rows, growth }, wanted.len()))
}

fn write(options: &ScaleOptions, measured: &ScaleFigures) -> anyhow::Result<()> {
    if let Some(file) = &options.json {
        replace(file, outputs::json(measured)?, Durability::Written)?;
    }
    if let Some(file) = &options.html {
        replace(file, &chart::page(measured)?, Durability::Written)?;
        outln!("Page: {}.", file.display());
    }
    Ok(())
}

/// Returns the processor time of this thread.
fn thread_time_ns() -> u64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    let part = |part: i64| u64::try_from(part).unwrap_or_default();
    part(time.tv_sec) * 1_000_000_000 + part(time.tv_nsec)
}

/// Returns the physical memory of this process; 0 where the kernel does not show it.
fn memory_mib() -> f64 {
    OwnMemory::Resident.kib().unwrap_or(0) as f64 / 1_024.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_stations_beyond_the_limit_are_refused_in_words() {
        assert_eq!(stations("64"), Ok(64));
        assert!(stations("0").unwrap_err().contains("1 to 128"));
        assert!(stations("129").unwrap_err().contains("1 to 128"));
        assert!(stations("two").unwrap_err().contains("`two`"));
        assert!(bus("can").unwrap_err().contains("ethernet-ip"));
    }

    #[test]
    fn two_stations_are_sent_twice_the_frames_of_one() {
        let go_on = AtomicBool::new(false);
        for bus in ScaledBus::ALL {
            let [one, two] =
                [1, 2].map(|count| virtual_time::measure(bus, count, 1, &go_on).unwrap().unwrap());
            assert!((one.frames_sent, two.frames_sent) == (1.0, 2.0), "{one:?} {two:?}");
            assert!(two.frames_received > 1.5 && two.cost_us > 0.0, "{one:?} {two:?}");
        }
    }
}
