//! One robot that works alone.

use setup::Setup;

use super::{ExploredRun, FaultTarget, RunEnd};
use crate::explore::fault::Extent;
use records::conditions::Measured;
use records::faults::Fault;
use records::mode::Mode;
use records::schedule::Step;
use stands::planned_cell::PlannedCell;
use stands::verification::{DriveDeviation, Verification};
use stands::virtual_run::{Extras, VirtualRun};

/// A robot, its motions, and what verifies its runs.
#[derive(Clone, Debug)]
pub(in crate::explore) struct LoneRobot {
    setup: Setup,
    planned: PlannedCell,
    verification: Verification,
}

impl LoneRobot {
    pub(in crate::explore) fn new(setup: Setup, planned: PlannedCell) -> anyhow::Result<Self> {
        let verification = Verification::of(&setup, planned.clone(), Mode::Virtual, &[])?;
        Ok(Self { setup, planned, verification })
    }
}

impl FaultTarget for LoneRobot {
    fn switch_on<'r>(&'r self, seed: u64, faults: &'r [Fault]) -> anyhow::Result<Box<dyn ExploredRun + 'r>> {
        let extras = Extras { faults: faults.to_vec(), ..Extras::default() };
        let run = VirtualRun::switch_on(&self.setup, self.planned.clone(), seed, &extras)?;
        Ok(Box::new(RobotRun { of: self, run, verification: self.verification.clone(), faults }))
    }

    /// There is only one place.
    fn is_located(&self, _reason: &str) -> bool {
        true
    }
}

struct RobotRun<'r> {
    of: &'r LoneRobot,
    run: VirtualRun,
    verification: Verification,
    faults: &'r [Fault],
}

impl RobotRun<'_> {
    fn verify(&mut self, measured: &Measured) -> anyhow::Result<()> {
        self.verification.check(measured).or_else(|_| {
            // A frame that is held back may delay a call.
            let LoneRobot { setup, planned, .. } = self.of;
            Verification::of(setup, planned.clone(), Mode::Virtual, self.faults)?.check(measured)
        })
    }
}

impl ExploredRun for RobotRun<'_> {
    fn connect(&mut self) -> anyhow::Result<()> {
        self.run.connect()
    }

    fn execute(&mut self, step: Step) -> RunEnd {
        let measured = match self.run.execute_unrecorded(step) {
            Ok(measured) => measured,
            Err(reason) => return RunEnd::failed(reason),
        };
        match self.verify(&measured) {
            Ok(()) => RunEnd::Passed(measured.execution.execution_time_ns),
            Err(deviation) if deviation.is::<DriveDeviation>() && moves_drives(self.faults) => {
                RunEnd::OffPath(deviation)
            }
            Err(difference) => RunEnd::Altered(difference),
        }
    }

    fn recover(&mut self) -> anyhow::Result<()> {
        self.run.recover()
    }

    fn extents(&self) -> Vec<Extent> {
        vec![Extent {
            frames: self.run.frames_sent(),
            run_us: self.run.since_ready().as_micros().try_into().unwrap_or(u64::MAX),
            axes: self.of.planned.robot.arm.axes() as u64,
            has_drives: self.of.planned.robot.drives.is_some(),
        }]
    }

    fn broken_law(&self) -> Option<String> {
        None
    }

    fn rehearsed(&self) -> Box<dyn FaultTarget> {
        Box::new(LoneRobot { verification: self.verification.clone(), ..self.of.clone() })
    }
}

pub(super) fn moves_drives(faults: &[Fault]) -> bool {
    faults.iter().any(Fault::is_of_drive)
}
