//! One MoveContinuousSkill of any length, in steps that do not allocate.

use std::time::Duration;

use anyhow::Context;
use planning::ToStart;
use plc_node::{Execution, ExecutionType, MotionSource, PlcEvent};
use protocol::image::{Digest, Motion, Sum};
use setup::Setup;

use super::supply::{Origin, SupplyThread};
use stands::virtual_run::{Extras, VirtualRun, Work};

/// Both nodes, executing one long sequence.
pub struct LongRun {
    run: VirtualRun,
    supply: SupplyThread,
    total: u32,
    begun: Duration,
}

/// The two sides disagree about the motions.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
#[error("motions were lost, duplicated or reordered: {first} has the digest {}, {second} has {}", .sums[0], .sums[1])]
pub struct Mismatch {
    /// Owner of the first digest.
    pub first: &'static str,
    /// Owner of the second digest.
    pub second: &'static str,
    /// The two digests.
    pub sums: [Sum; 2],
}

/// Result of a finished run.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Finished {
    /// The PLC's result.
    pub execution: Execution,
    /// Digest of the motions from the list.
    pub list: Sum,
    /// Digest of the motions that the PLC sent.
    pub sent: Sum,
    /// Digest of the motions that the robot put on its path.
    pub accepted: Sum,
}

impl Finished {
    /// Checks that every motion of the list was transmitted once and in order.
    ///
    /// # Errors
    ///
    /// Two sides disagree.
    pub fn check(&self) -> Result<(), Mismatch> {
        agree("the list", self.list, "the PLC", self.sent)?;
        agree("the PLC", self.sent, "the robot", self.accepted)
    }
}

fn agree(first: &'static str, first_sum: Sum, second: &'static str, second_sum: Sum) -> Result<(), Mismatch> {
    if first_sum == second_sum {
        Ok(())
    } else {
        Err(Mismatch { first, second, sums: [first_sum, second_sum] })
    }
}

impl LongRun {
    /// Connects the nodes and sets the start edge of a run of the first `total` motions. The robot's program store is
    /// empty, since RC does not run.
    ///
    /// # Errors
    ///
    /// The setup does not describe a robot, or the nodes do not connect.
    pub fn start(setup: &Setup, origin: Origin, total: u32, seed: u64) -> anyhow::Result<Self> {
        let to_start = origin.to_start()?;
        let (supply, source) = SupplyThread::start(origin, total);
        Self::with(setup, supply, Box::new(source), to_start, seed)
    }

    /// Starts a run like [`start`](Self::start) with another source between the list and the PLC, for tests of the
    /// digests.
    ///
    /// # Errors
    ///
    /// The same as for [`start`](Self::start).
    pub fn with_source(
        setup: &Setup,
        supply: SupplyThread,
        source: Box<dyn MotionSource>,
        seed: u64,
    ) -> anyhow::Result<Self> {
        Self::with(setup, supply, source, ToStart::default(), seed)
    }

    fn with(
        setup: &Setup,
        supply: SupplyThread,
        source: Box<dyn MotionSource>,
        to_start: ToStart<Motion>,
        seed: u64,
    ) -> anyhow::Result<Self> {
        let total = source.total();
        let work = Work::sent(setup, source, to_start)?;
        let mut run = VirtualRun::start_on(setup, work, seed, &Extras::default())?;
        run.begin(ExecutionType::Cm)?;
        let begun = run.plant_time();
        Ok(Self { run, supply, total, begun })
    }

    /// Returns the total number of motions.
    #[must_use]
    pub const fn total(&self) -> u32 {
        self.total
    }

    /// Returns the time that the plant would have taken so far.
    #[must_use]
    pub fn plant_time(&self) -> Duration {
        self.run.plant_time().saturating_sub(self.begun)
    }

    /// Returns digests of the motions that the PLC sent so far, and of those that the robot put on its path.
    #[must_use]
    pub fn digests(&self) -> [Digest; 2] {
        self.run.digests()
    }

    /// Runs for `time`, or less if the run ends. Whenever both sides have passed the same interval, their digests are
    /// compared. Allocates only on an error.
    ///
    /// # Errors
    ///
    /// [`Mismatch`], or the reason why the run failed.
    pub fn advance(&mut self, time: Duration) -> anyhow::Result<Option<Execution>> {
        let until = self.run.plant_time() + time;
        while let Some(event) = self.run.run_for(until.saturating_sub(self.run.plant_time())) {
            match event {
                PlcEvent::Finished(execution) => return Ok(Some(execution)),
                PlcEvent::Failed(failure) => return Err(failure.into()),
                PlcEvent::Link(_)
                | PlcEvent::ImageBad
                | PlcEvent::ImageGood
                | PlcEvent::LifeStill
                | PlcEvent::MovingToStart
                | PlcEvent::Ready
                | PlcEvent::Waiting { .. }
                | PlcEvent::Passed(_)
                | PlcEvent::Started { .. } => {}
            }
        }
        let [sent, accepted] = self.digests().map(|digest| digest.mark());
        if sent.motions == accepted.motions {
            agree("the PLC", sent, "the robot", accepted)?;
        }
        Ok(None)
    }

    /// Ends the run with the last result of [`advance`](Self::advance); if the run was given up, that is the error.
    ///
    /// # Errors
    ///
    /// The list could not be read or planned to its end, or the run failed.
    pub fn finish(self, ended: anyhow::Result<Execution>) -> anyhow::Result<Finished> {
        let [sent, accepted] = self.digests().map(|digest| digest.sum());
        // Dropping the source with the PLC ends the thread that supplies its motions.
        drop(self.run);
        let list = self.supply.finish();
        match (ended, list) {
            (Ok(execution), Ok(list)) => Ok(Finished { execution, list, sent, accepted }),
            // If the list ended early, that is why the run failed.
            (Err(run), Err(list)) => Err(list.context(format!("{run:#}"))),
            (Ok(_), Err(list)) => Err(list).context("the run ended before its list"),
            (Err(run), Ok(_)) => Err(run),
        }
    }
}
