//! The recordings of a cell in the formats of other programs: one timeline, and one file with the motion of all arms.

use std::path::Path;

use planning::PlannedCell;
#[cfg(feature = "mcap")]
use robot_node::arm::Frame;
#[cfg(feature = "mcap")]
use setup::Cell;

#[cfg(feature = "mcap")]
use crate::playback;
use crate::timeline::{self, TimelineStation};
use records::run_directory::{Durability, replace};
use records::trace::CellTrace;

/// Writes one timeline of all stations into a run directory.
///
/// # Errors
///
/// It cannot be written.
pub fn save_timeline(directory: &Path, planned: &PlannedCell, trace: &CellTrace) -> anyhow::Result<()> {
    fn known(station: &planning::PlannedStation) -> (Vec<&str>, Vec<u32>) {
        let motions = station.plan.motions.iter().map(|motion| motion.name.as_str()).collect();
        (motions, station.plan.waits.iter().map(|wait| wait.mark).collect())
    }
    let known: Vec<_> = planned.stations.iter().map(known).collect();
    let stations = planned.stations.iter().zip(&known).zip(&trace.stations);
    let stations: Vec<_> = stations
        .map(|((station, (motions, marks)), trace)| TimelineStation {
            name: &station.name,
            trace,
            motions,
            marks,
        })
        .collect();
    replace(&directory.join(timeline::FILE), &timeline::json_of(&stations)?, Durability::Written)
}

/// Writes the motion of all arms into a run directory, in the frame of the cell.
///
/// # Errors
///
/// It cannot be written.
#[cfg(feature = "mcap")]
pub fn save_playback(
    directory: &Path,
    cell: &Cell,
    planned: &PlannedCell,
    trace: &CellTrace,
) -> anyhow::Result<()> {
    let stations = cell.stations.iter().zip(&planned.stations).zip(&trace.stations);
    let stations: Vec<_> = stations
        .map(|((placed, station), trace)| {
            let number = station.plan.motions.first().map_or(0, |motion| motion.base);
            let base = station.setup.robot.bases.iter().find(|base| base.number == number);
            let base = base.map_or(Frame::IDENTITY, |base| Frame::from_mm_deg(base.mm_deg.value));
            let base = Frame::from_mm_deg(placed.root_mm_deg.value) * base;
            playback::PlaybackStation {
                placed: Some((&station.name, base)),
                trace,
                setup: &station.setup,
                plan: &station.plan,
            }
        })
        .collect();
    replace(&directory.join(playback::FILE), playback::bytes_of(&cell.name, &stations)?, Durability::Written)
}
