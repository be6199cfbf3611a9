//! A program that leads the stations itself, also outside of runs.

use machine::Instant;
use protocol::fieldbus::ControllerBus;
use protocol::image::Digest;

use super::{PlcNode, ScanMode, the_station};
use crate::program::{Led, PlcProgram};
use crate::sequences::Sequences;
use crate::station::Station;
use crate::{AnyProgram, CodeError, ExportedCode, ExportedProgram, FailureCause, PlcConfig, Scan};

impl<B: ControllerBus> PlcNode<B, AnyProgram> {
    /// Creates a PLC like [`PlcNode::new`] that executes exported code in the place of its blocks, if there is some.
    ///
    /// # Errors
    ///
    /// The code has no instance.
    pub fn of_code(
        config: PlcConfig,
        code: Option<ExportedCode>,
        bus: B,
        start: Instant,
    ) -> Result<Self, CodeError> {
        let scan = Scan::new(start, config.scan_cycle, config.scan_cost);
        let (config, work) = config.into_station("", &[]);
        let program: AnyProgram = match code {
            Some(code) => ExportedProgram::new(code, work.motions)?.into(),
            None => Sequences::new(vec![work]).into(),
        };
        Ok(Self::with_program(scan, vec![bus], vec![the_station(config)], program))
    }

    /// Returns the digest of the motions that were sent to the first station in this run, or in the last one.
    #[must_use]
    pub fn sent(&self) -> Digest {
        self.program.digest(0)
    }
}

impl<B: ControllerBus, P: PlcProgram> PlcNode<B, P> {
    /// Has a program that leads the stations do so.
    pub(super) fn lead(&mut self, now: Instant) {
        if self.mode == ScanMode::Running {
            return;
        }
        let led = self.program.lead(now, &mut self.stations);
        let was_ready = self.stations.iter().all(Station::is_ready);
        for station in &mut self.stations {
            station.follow(led, &mut self.events);
        }
        match led {
            Led::Ready if !was_ready => self.report_ready(),
            Led::Preparing if was_ready && self.mode != ScanMode::Idle => {
                self.fail(Some(0), FailureCause::RobotHalted);
            }
            Led::Ended(cause) => {
                let execution_type = match self.mode {
                    ScanMode::Starting(execution_type) => execution_type,
                    ScanMode::Idle | ScanMode::Running => self.run.execution_type,
                };
                self.mode = ScanMode::Idle;
                self.report_failure(Some(0), execution_type, 0, cause);
            }
            Led::Ready | Led::Preparing | Led::MovingToStart => {}
        }
    }
}
