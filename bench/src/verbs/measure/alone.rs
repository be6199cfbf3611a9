//! Each arm of a cell alone, without waits: what CM gains there stands beside what it gains where the arms meet.

use anyhow::Context as _;
use planning::PlannedCell;

use records::cell_results::CellResults;
use records::schedule::Schedule;
use stands::virtual_run;

/// Runs the schedule with each arm alone, in virtual time, and adds what it takes to the results.
///
/// # Errors
///
/// An arm alone cannot execute its motions.
pub fn add_alone(
    results: &mut CellResults,
    planned: &PlannedCell,
    schedule: &Schedule,
) -> anyhow::Result<()> {
    for (index, station) in planned.stations.iter().enumerate() {
        let alone = virtual_run::whole(&station.setup, &station.application, schedule)
            .with_context(|| format!("station {} alone", station.name))?;
        results.set_alone(index, &alone);
    }
    Ok(())
}
