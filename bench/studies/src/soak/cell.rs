//! The soak of a cell with several stations: faults at every station all the time.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use anyhow::anyhow;
use planning::FoundCell;
use plc_node::ExecutionType;
use setup::Cell;

use super::never_ready::NeverReady;
use super::{Counts, drive_faults};
use records::exit::{Exit, Failure};
use records::faults::{self, Fault};
use records::schedule::Schedule;
use stands::planned_station::PlannedStation;
use stands::verification::{Difference, DriveDeviation, StationVerification};
use stands::virtual_run::CellRun;

/// A cell, planned, with the faults of every life.
pub(super) struct SoakedCell {
    pub(super) name: String,
    stations: Vec<PlannedStation>,
    faults: Vec<Fault>,
}

impl SoakedCell {
    /// Plans a cell. Faults without a station are those of every station.
    pub(super) fn new(cell: &Cell, found: &FoundCell, faults: &[Fault]) -> Result<Self, Failure> {
        let usage = |error: anyhow::Error| Failure::new(Exit::Usage, error);
        let at_all = |fault: &Fault| match fault.station() {
            None if !fault.is_of_plc() => cell.names().map(|name| fault.at_station(name)).collect(),
            _ => vec![fault.clone()],
        };
        let faults: Vec<Fault> = faults.iter().flat_map(at_all).collect();
        faults::check_cell(&faults, cell).map_err(|error| usage(error.into()))?;
        let stations = PlannedStation::all(&found.plan(cell)?).map_err(usage)?;
        Ok(Self { name: cell.name.clone(), stations, faults })
    }

    /// Runs a life, or until an interrupt: one repetition of each type after the other.
    pub(super) fn live(
        &self,
        seed: u64,
        life: Duration,
        is_interrupted: &AtomicBool,
    ) -> anyhow::Result<Counts> {
        let mut faults = self.faults.clone();
        for (index, station) in self.stations.iter().enumerate() {
            let of_drives = drive_faults(&station.setup, seed.wrapping_add(index as u64), life)?;
            faults.extend(of_drives.iter().map(|fault| fault.at_station(&station.name)));
        }
        let mut verifications: Vec<_> = self.stations.iter().cloned().map(StationVerification::new).collect();
        let mut run = CellRun::switch_on(&self.stations, seed, &faults)?;
        run.watch_laws(&self.stations);
        let mut counts = Counts::default();
        let mut connected = run.connect();
        for step in Schedule::new(&ExecutionType::ALL, u32::MAX, seed).steps() {
            let ended = connected.and_then(|()| run.execute(step)).and_then(|measured| {
                if measured.stations.len() != verifications.len() {
                    return Err(anyhow!("a station of the cell has no result"));
                }
                let mut stations = verifications.iter_mut().zip(&measured.stations);
                stations.try_for_each(|(verification, of_station)| verification.check(of_station))
            });
            connected = Ok(());
            if let Some(law) = run.broken_law() {
                counts.differ(seed, &law.clone().into());
                break;
            }
            match ended {
                Ok(()) => counts.passed += 1,
                Err(error) if error.downcast_ref::<Difference>().is_some() => counts.differ(seed, &error),
                // What holds an axis also moves the arm off its path: the repetition fails, and the next one passes.
                Err(error) if error.downcast_ref::<DriveDeviation>().is_some() => counts.refuse(seed, &error),
                // Whatever ends a run is named with its station.
                Err(error) if !self.names_station(&error) => counts.differ(seed, &error),
                Err(error) => {
                    counts.refuse(seed, &error);
                    run.recover().map_err(|then| NeverReady::new(seed, &error, &then, &self.faults))?;
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

    fn names_station(&self, error: &anyhow::Error) -> bool {
        let error = format!("{error:#}");
        self.stations.iter().any(|station| error.contains(&format!("station {}", station.name)))
    }
}
