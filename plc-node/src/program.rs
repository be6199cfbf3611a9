//! What a PLC runs: a program over its stations.

use core::fmt::Debug;

use machine::{Duration, Instant};
use protocol::image::{Digest, Sum};

use crate::function_blocks::BlockError;
use crate::{ArmInStep, ExecutionType, FailureCause, MarkPassage, StartError, Station};

/// The application program of a [`PlcNode`](crate::PlcNode): it is called once in each scan of a run, with all stations.
///
/// Outside of a run the PLC itself keeps the robots enabled, leads them to `Ready` and moves the arms to where a run starts; in a
/// run the stations are the program's. A program works with a station's [`AxesGroup`](crate::AxesGroup) and the function blocks,
/// or with its images as bytes ([`Station::image`], [`Station::set_image`]), as code from elsewhere does. It must not block,
/// and allocate nothing.
///
/// A program that has both robots execute their stored programs at once:
///
/// ```
/// use machine::Instant;
/// use plc_node::function_blocks::{BufferMode, RunProgram};
/// use plc_node::{ExecutionType, PlcProgram, Progress, Station};
///
/// #[derive(Debug, Default)]
/// struct Together([RunProgram; 2]);
///
/// impl PlcProgram for Together {
///     fn begin(&mut self, _now: Instant, _execution_type: ExecutionType) {
///         *self = Self::default();
///     }
///
///     fn scan(&mut self, _now: Instant, stations: &mut [Station]) -> Progress {
///         let mut are_done = true;
///         for (station, (block, one)) in self.0.iter_mut().zip(stations).enumerate() {
///             let outputs = block.call(true, 1, BufferMode::Aborting, one.group_mut());
///             if let Some(error) = block.error() {
///                 return Progress::Failed { station, motion: 0, error };
///             }
///             are_done &= outputs.done;
///         }
///         if are_done { Progress::Done } else { Progress::Running }
///     }
/// }
/// ```
pub trait PlcProgram: Debug + Send {
    /// Returns why no run of this kind can start with these stations, which are connected and ready, if none can.
    ///
    /// # Errors
    /// The program has nothing to run, or a robot does not serve what it needs.
    fn check(&self, _execution_type: ExecutionType, _stations: &[Station]) -> Result<(), StartError> {
        Ok(())
    }

    /// Takes the arms that are to start and move together, one for each station. A program that does not lead them leaves it.
    fn keep_in_step(&mut self, _arms: Vec<ArmInStep>) {}

    /// Begins a run; the first [`scan`](Self::scan), which sets the start edge, follows at once.
    fn begin(&mut self, now: Instant, execution_type: ExecutionType);

    /// Executes one scan of a run, which began at `now`. The stations have their inputs; their outputs go out after the scan.
    fn scan(&mut self, now: Instant, stations: &mut [Station]) -> Progress;

    /// Returns whether the program also leads the robots to `Ready` and the arms to where a run starts. Then the PLC leaves that
    /// to [`lead`](Self::lead).
    fn leads(&self) -> bool {
        false
    }

    /// Executes one scan outside of a run, for a program that [leads](Self::leads). The PLC calls it after the last scan of a
    /// run once more, within the same scan.
    fn lead(&mut self, _now: Instant, _stations: &mut [Station]) -> Led {
        Led::Preparing
    }

    /// Handles that a station of the run is lost: its connection, its image, or its progress. The others go on unless the
    /// program ends the run, which then fails with this cause.
    fn lose(&mut self, _station: usize, _cause: FailureCause) -> AfterLoss {
        AfterLoss::EndRun
    }

    /// Returns whether the program itself waits at a station: then the robot there owes no progress.
    fn waits(&self, _station: usize) -> bool {
        false
    }

    /// Returns how many marks, at which arms wait for each other, a station has come to in this run, or in the last one, and how many it
    /// has passed.
    fn marks(&self, _station: usize) -> [u32; 2] {
        [0; 2]
    }

    /// Decides whether an arm sets out for where a run starts. Asked outside of a run while all robots are connected, in each scan
    /// until it sets out.
    fn set_out(&mut self, _station: usize, _stations: &[Station]) -> SetOut {
        SetOut::Now
    }

    /// Returns what a station has executed in this run, or in the last one.
    fn totals(&self, _station: usize) -> Totals {
        Totals::default()
    }

    /// Returns the marks that a station came to in this run, or in the last one, in order.
    fn passages(&self, _station: usize) -> &[MarkPassage] {
        &[]
    }

    /// Returns the time for which a station's arm stood before shared zones in this run, or in the last one; `None` in a cell without
    /// such zones.
    fn waited_for_zones(&self, _station: usize) -> Option<Duration> {
        None
    }

    /// Returns the time in us of the last run as the program itself measured it; `None` if it leaves that to the PLC.
    fn execution_time_us(&self) -> Option<u64> {
        None
    }

    /// Returns the number and the digest of the motions that the program sent to a station in this run, or in the last one.
    fn sent(&self, _station: usize) -> Sum {
        Digest::default().sum()
    }
}

/// State of a program after a scan.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Progress {
    /// The run goes on.
    Running,
    /// The run is done.
    Done,
    /// A robot gave its skill up, without an error: it was halted.
    Aborted {
        /// Index of its station.
        station: usize,
    },
    /// The program ended the run.
    Ended {
        /// Index of the station concerned.
        station: usize,
        /// Why.
        cause: FailureCause,
    },
    /// A block reported an error.
    Failed {
        /// Index of its station.
        station: usize,
        /// The motion concerned, from 0.
        motion: u32,
        /// The block's error.
        error: BlockError,
    },
}

/// Stations of a program that leads them, outside of a run.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Led {
    /// Not ready.
    Preparing,
    /// Arms move to where a run starts.
    MovingToStart,
    /// A run may start.
    Ready,
    /// The program has just ended for good.
    Ended(FailureCause),
}

/// Permission for an arm to set out for where a run starts.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum SetOut {
    /// It sets out in this scan.
    Now,
    /// It waits for another arm that is on its way, or for a robot that is not connected.
    Wait,
    /// It waits, and no arm is on its way that could make room: its wait has a limit.
    Blocked,
}

/// What becomes of a run that has lost a station.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum AfterLoss {
    /// The run goes on without the station, and fails when the others are done.
    GoOn,
    /// The run ends: the other robots are halted.
    EndRun,
}

/// Totals of a station in a run so far.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub struct Totals {
    /// Motions that the robot executed.
    pub executed: u32,
    /// Motions that were run to a stop because the next one was not there in time.
    pub blends_suppressed: u32,
    /// The robot's own measure in ns.
    pub robot_execution_ns: u64,
}
