//! The runs of a sweep and their results.

use std::time::Duration;

use planning::Application;
use plc_node::ExecutionType;
use serde::{Deserialize, Serialize};
use setup::Setup;

use super::round_trip::RoundTrip;
use super::square;
use crate::engine::job::{JobRows, ListedJob};
use crate::engine::listed::ListedStudy;
use records::schedule::Schedule;
use stands::planned_cell::PlannedCell;

/// Cost of a skill call in the sweep, in µs: longer than the robot needs to look through its program before it starts,
/// so that RC and CM start equally late. Both contain it once, and it is subtracted from the results.
const OVERHEAD_US: u32 = 200_000;

/// Share of RC's time from which on CM counts as slower; smaller differences come from the robot's cycle.
const SLOWER: f64 = 0.01;

/// What is varied.
#[derive(Clone, PartialEq, Debug)]
pub struct SweepGrid {
    /// Slots of the image in use.
    pub depths: Vec<u32>,
    /// Bus cycles, in µs.
    pub bus_cycles_us: Vec<u32>,
    /// Lengths of every motion, in mm.
    pub lengths_mm: Vec<f64>,
    /// Motions in a run.
    pub motions: u32,
    /// Runs whose mean counts.
    pub reps: u32,
    /// Seed of clocks, phases and pauses.
    pub seed: u64,
}

/// The result of one point of the grid.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
pub struct SweepPoint {
    /// Slots in use.
    pub depth: u32,
    /// Bus cycle in ms.
    pub bus_cycle_ms: f64,
    /// Length of a motion in mm.
    pub length_mm: f64,
    /// Time of the whole path as the robot's own program, in ms, by the robot and without the call's overhead.
    pub rc_ms: f64,
    /// The same as a MoveContinuousSkill.
    pub cm_ms: f64,
    /// Blends that CM lost in a run, on average.
    pub blends_suppressed: f64,
    /// The round trip from an executed motion to the next one in its slot, at its longest, in ms.
    pub round_trip_ms: f64,
    /// The verdict of the round trip alone.
    pub predicted: Predicted,
}

/// The verdict of the round trip alone on a point, for any profile of the motions.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Predicted {
    /// CM loses no blend.
    KeepsUp,
    /// It depends on when the robot needs the next motion during a motion.
    Open,
    /// CM loses blends.
    Starves,
}

impl SweepPoint {
    /// Returns the time that CM takes longer than RC, as a share of RC's time.
    #[must_use]
    pub fn loss(&self) -> f64 {
        (self.cm_ms - self.rc_ms) / self.rc_ms
    }

    /// Returns whether CM is worse than RC: it loses a blend, or takes more time than the cycles alone explain.
    #[must_use]
    pub fn loses(&self) -> bool {
        self.blends_suppressed > 0.0 || self.loss() > SLOWER
    }

    /// Returns whether CM lost time but no blend: the robot plans for a stop at the end of the motions that it knows, and
    /// it knows too few of them to be as fast as with its whole program.
    #[must_use]
    pub fn looks_too_short(&self) -> bool {
        self.loses() && self.blends_suppressed == 0.0
    }
}

/// One run: of RC, which has no depth, or of CM.
struct Job {
    depth: Option<u32>,
    bus_cycle_us: u32,
    length_mm: f64,
}

/// The result of a run.
#[derive(Clone, Copy)]
struct SweepOutcome {
    path_ms: f64,
    blends_suppressed: f64,
}

impl SweepGrid {
    /// Returns the number of points.
    #[must_use]
    pub fn points(&self) -> usize {
        self.depths.len() * self.bus_cycles_us.len() * self.lengths_mm.len()
    }

    /// Runs it all, or what it can before an interrupt; depth is the slowest to change, length the fastest.
    ///
    /// # Errors
    ///
    /// The setup cannot be run with one of the bus cycles, the arm does not reach the square, or a run fails.
    pub fn run(
        &self,
        setup: &Setup,
        application: &Application,
        study: &ListedStudy<'_>,
    ) -> anyhow::Result<Vec<SweepPoint>> {
        let job = |depth, bus_cycle_us, length_mm| Job { depth, bus_cycle_us, length_mm };
        let of_cells = |depth: Option<u32>| {
            self.bus_cycles_us
                .iter()
                .flat_map(move |cycle| self.lengths_mm.iter().map(move |length| job(depth, *cycle, *length)))
        };
        // RC first: it is what all else is compared with.
        let rc: Vec<Job> = of_cells(None).collect();
        let cells = rc.len();
        let jobs: Vec<Job> =
            rc.into_iter().chain(self.depths.iter().flat_map(|depth| of_cells(Some(*depth)))).collect();
        let listed = jobs.iter().map(|job| self.listed(setup, application, job));
        let rows = study.measured(&listed.collect::<anyhow::Result<Vec<_>>>()?)?;
        let outcome = |(job, rows): (&Job, &Option<JobRows>)| Some(job.outcome(rows.as_ref()?));
        let outcomes: Vec<Option<SweepOutcome>> = jobs.iter().zip(&rows).map(outcome).collect();
        let (rc, cm) = outcomes.split_at(cells.min(outcomes.len()));
        let of_rc = rc.iter().cycle();
        let points = jobs.iter().skip(cells).zip(cm).zip(of_rc).filter_map(|((job, cm), rc)| {
            let (cm, rc) = (cm.as_ref()?, rc.as_ref()?);
            let depth = job.depth.unwrap_or_default();
            let trip = RoundTrip::of(&setup.clone().with_bus_cycle(job.bus_cycle_us));
            let motion = Duration::from_secs_f64(rc.path_ms / 1e3 / f64::from(self.motions));
            Some(SweepPoint {
                depth,
                bus_cycle_ms: f64::from(job.bus_cycle_us) / 1e3,
                length_mm: job.length_mm,
                rc_ms: rc.path_ms,
                cm_ms: cm.path_ms,
                blends_suppressed: cm.blends_suppressed,
                round_trip_ms: trip.longest.as_secs_f64() * 1e3,
                predicted: if trip.sufficient(depth).is_some_and(|sufficient| motion >= sufficient) {
                    Predicted::KeepsUp
                } else if motion < trip.necessary(depth) {
                    Predicted::Starves
                } else {
                    Predicted::Open
                },
            })
        });
        Ok(points.collect())
    }

    fn listed(&self, setup: &Setup, application: &Application, job: &Job) -> anyhow::Result<ListedJob> {
        let depth = job.depth.unwrap_or_else(|| setup.plc.slots_in_use());
        // The time that CM needs before its first motion is the same at every point; it depends on neither slots nor bus cycle.
        let setup = setup
            .clone()
            .without_start_cycles()
            .with_bus_cycle(job.bus_cycle_us)
            .with_queue_depth(depth)
            .with_skill_overhead(OVERHEAD_US)
            .without_quanta();
        setup::check(&setup)?;
        let square = square::application(application, job.length_mm, self.motions);
        let planned = PlannedCell::of(&setup, &square)?;
        let schedule = Schedule::new(&[job.execution_type()], self.reps, self.seed);
        Ok(ListedJob { setup, planned, schedule })
    }
}

impl Job {
    const fn execution_type(&self) -> ExecutionType {
        if self.depth.is_none() { ExecutionType::Rc } else { ExecutionType::Cm }
    }

    fn outcome(&self, rows: &JobRows) -> SweepOutcome {
        // By the robot, which the call's overhead precedes.
        let mean = |figure| rows.mean(self.execution_type(), figure).unwrap_or(f64::NAN);
        let [_, robot_ns, blends_suppressed] = [0, 1, 2].map(mean);
        SweepOutcome { path_ms: robot_ns / 1e6 - f64::from(OVERHEAD_US) / 1e3, blends_suppressed }
    }
}
