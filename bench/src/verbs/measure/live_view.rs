//! The live view of a run: its address is reserved before the run begins, and its page is served while it lasts.

use std::path::Path;

use anyhow::anyhow;

use super::RunOptions;
use records::exit::{Exit, Failure};
use records::mode::Mode;
use records::schedule::Schedule;
use report::errln;
use report::live::{About, AboutArms, Live, LiveAddress, Reserved};

/// Why a live view of attached nodes has no arm.
const NO_ROWS: &str = "No arm is drawn: nodes that the bench did not start write their cycles nowhere that it could read. Leave out --attach \
     to see it. Table, lateness, frames and alarms follow the run.";

/// Reserves the address of the live view.
pub(super) fn reserve(address: LiveAddress, mode: Mode) -> Result<Reserved, Failure> {
    if mode == Mode::Virtual {
        let error = anyhow!(
            "--live shows a run in real time, and a virtual one is over in seconds: leave out `--mode virtual`, or open the \
             race.html that every run writes"
        );
        return Err(Failure::new(Exit::Usage, error));
    }
    Reserved::open(address).map_err(|error| Failure::new(Exit::EnvironmentUnusable, error))
}

/// Starts the live view of a run in `directory`, and prints its address.
pub(super) fn start(
    address: Reserved,
    arms: AboutArms<'_>,
    schedule: &Schedule,
    options: &RunOptions,
    directory: &Path,
) -> Result<Live, Failure> {
    let is_attached = options.attach.is_some();
    let about =
        About { arms, types: &schedule.types, reps: schedule.reps, no_rows: is_attached.then_some(NO_ROWS) };
    let live = Live::start(address, &about, (!is_attached).then_some(directory))?;
    // Even with `--quiet`: without the address the user cannot find the page.
    errln!("Live at http://{}/", live.address());
    Ok(live)
}
