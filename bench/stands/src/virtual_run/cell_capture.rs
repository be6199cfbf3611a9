//! Captures of the cables of a virtual cell: at each robot, and at the other end of its cable.

use std::cell::RefCell;
use std::path::Path;
use std::rc::Rc;
use std::time::Duration;

use anyhow::Context as _;
use capture_file::Retention;
use virtual_time::CableId;

use super::cell::VirtualCell;
use super::new_cell::{plc_mac, robot_mac};
use crate::capture::{CableConfig, VirtualCapture};
use crate::planned_station::PlannedStation;
use records::faults::{self, Fault};

/// A cable and its capture.
type OnCable = (CableId, VirtualCapture);

/// The captures of a cell; shared with the tap that fills them.
#[derive(Clone, Debug, Default)]
pub(super) struct CellCaptures(Rc<RefCell<Vec<OnCable>>>);

impl CellCaptures {
    /// Creates two files for each station in `directory`, `plc-left.pcapng` and `robot-left.pcapng`, and has the cell fill them. They
    /// name the faults of each station.
    pub(super) fn start(
        (directory, keep): (&Path, Retention),
        stations: &[PlannedStation],
        faults: &[Vec<Fault>],
        cell: &mut VirtualCell,
    ) -> anyhow::Result<Self> {
        let mut captures = Vec::with_capacity(stations.len());
        for ((index, station), cable) in stations.iter().enumerate().zip(cell.cables()) {
            let delay = Duration::from_micros(station.setup.bus.cable_delay_us.value.into());
            let about = faults.get(index).map_or_else(String::new, |faults| faults::about(faults));
            let config = CableConfig { macs: [plc_mac(0), robot_mac(index)], delay, about };
            let capture = create(directory, &station.name, config, keep)?;
            captures.push((cable, capture));
        }
        let captures = Self(Rc::new(RefCell::new(captures)));
        let filled = captures.clone();
        cell.set_tap(move |tapped| {
            let mut all = filled.0.borrow_mut();
            if let Some((_, capture)) = all.iter_mut().find(|(cable, _)| *cable == tapped.cable) {
                capture.see(&tapped);
            }
        });
        Ok(captures)
    }

    /// Ends the captures. Those held in memory are written only if `wanted`.
    pub(super) fn finish(&self, wanted: bool) -> anyhow::Result<()> {
        for (_, capture) in self.0.take().into_iter().filter(|_| wanted) {
            capture.finish().map_err(|(path, error)| {
                anyhow::Error::new(error).context(format!("cannot write the capture {}", path.display()))
            })?;
        }
        Ok(())
    }
}

fn create(
    directory: &Path,
    name: &str,
    config: CableConfig,
    keep: Retention,
) -> anyhow::Result<VirtualCapture> {
    let files = ["plc", "robot"].map(|end| (format!("{end}-{name}.pcapng"), format!("{end}-{name}")));
    VirtualCapture::create_at(directory, files, config, keep)
        .with_context(|| format!("cannot make captures in {}", directory.display()))
}
