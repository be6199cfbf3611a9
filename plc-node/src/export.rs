//! The application of a PLC as the exported code has it.

use machine::Duration;
use planning::Switch;
use plc_export::{ExportedApplication, Maker, StopData};

use crate::waiting::longest_silence;
use crate::{PlcConfig, StationConfig};

impl PlcConfig {
    /// Returns what the exported code needs of this configuration, with the check of the image or without.
    ///
    /// The motions are read from their source. An empty list is exported as well: then only RC runs.
    pub fn exported(&mut self, with_check: bool) -> ExportedApplication {
        let limits = self.wait_limits();
        let progress = longest_silence(self.answer_timeout, StationConfig::longest_of(&self.stops));
        let progress_scans = progress.as_nanos().div_ceil(self.scan_cycle.as_nanos().max(1));
        let micros = |duration: Duration| u32::try_from(duration.as_micros()).unwrap_or(u32::MAX);
        let switch = |Switch { output, set, wait }| (output, set, micros(wait));
        ExportedApplication {
            motions: (0..self.motions.total()).map_while(|index| self.motions.get(index)).collect(),
            from_anywhere: self.to_start.from_anywhere,
            from_end: self.to_start.from_end.clone(),
            stops: self
                .stops
                .iter()
                .map(|stop| StopData { after: stop.after, switch: stop.then.map(switch) })
                .collect(),
            answer_scans: limits.answer_scans,
            silent_scans: limits.silent_scans,
            progress_scans: u32::try_from(progress_scans).unwrap_or(u32::MAX),
            scan_us: micros(self.scan_cycle),
            most_motions: Maker::most_motions(Maker::St.memory_kib()),
            big_endian: false,
            robot_cycle_us: micros(self.robot_cycle),
            queue_depth: self.queue_depth,
            program: self.program,
            with_check,
        }
    }
}
