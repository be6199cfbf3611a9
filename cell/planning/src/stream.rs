//! A stream of motions without a list in memory: five million take no more memory than one cycle.

use protocol::image;
use setup::Setup;

use crate::application::Application;
use crate::error::Error;
use crate::plan::{Plan, ToStart};
use crate::planner::Planner;

/// A motion of a stream.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Streamed {
    /// Its number in the stream, from 1.
    pub number: u64,
    /// The motion in the units of the wire.
    pub motion: image::Motion,
    /// Whether a continuous motion ends with it, in an accurate stop.
    pub accurate_stop: bool,
}

/// Repeats an application: all cells of its grids, `passes` times. It plans one cycle ahead and holds no more.
#[derive(Debug)]
pub struct Stream<'a> {
    application: &'a Application,
    setup: &'a Setup,
    planner: Planner<'a>,
    /// The cycle that is being handed out.
    cycle: Plan,
    /// Index of the next motion in it, and of its continuous motion.
    next: (usize, usize),
    /// The cell to plan next.
    cell: usize,
    /// Passes that are not planned to their end.
    passes: u64,
    /// Motions handed out.
    handed_out: u64,
    /// What ends the stream after the motions of this cycle.
    refused: Option<Error>,
}

/// Streams the motions of `passes` repetitions of an application on a setup.
///
/// An item is an error if a motion is refused. The motions before it were returned, the last of them with an exact stop,
/// and nothing follows the error.
#[must_use]
pub fn stream<'a>(application: &'a Application, setup: &'a Setup, passes: u64) -> Stream<'a> {
    Stream {
        application,
        setup,
        planner: Planner::new(application, setup),
        cycle: Plan::empty(application, setup),
        next: (0, 0),
        cell: 0,
        passes,
        handed_out: 0,
        refused: None,
    }
}

/// Counts the motions of `passes` repetitions, which a MoveContinuousSkill must know before it starts. It plans two
/// passes: the second and all later ones begin where the one before ended.
///
/// # Errors
/// [`Error::Refused`] names the first motion that cannot be planned.
pub fn count(application: &Application, setup: &Setup, passes: u64) -> Result<u64, Error> {
    let mut planner = Planner::new(application, setup);
    let mut cycle = Plan::empty(application, setup);
    let mut counted = [0; 2];
    for (_, counted) in (0..passes).zip(&mut counted) {
        let before = planner.planned();
        for cell in 0..application.cells() {
            cycle.clear();
            planner.cycle(cell, &mut cycle)?;
        }
        *counted = planner.planned() - before;
    }
    let [first, later] = counted;
    Ok(first + later * passes.saturating_sub(1))
}

/// Returns the motion to where the first pass starts, from wherever the arm is.
///
/// # Errors
/// [`Error::Refused`]: the robot has no such tool or base.
pub fn to_start(application: &Application, setup: &Setup) -> Result<ToStart<image::Motion>, Error> {
    let to_start = Planner::new(application, setup).way_to_start()?;
    let plan = Plan { to_start, ..Plan::empty(application, setup) };
    Ok(plan.wire_to_start(setup))
}

impl Iterator for Stream<'_> {
    type Item = Result<Streamed, Error>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            let (index, continuous) = self.next;
            if let Some(motion) = self.cycle.motions.get(index) {
                let accurate_stop =
                    self.cycle.continuous.get(continuous).is_some_and(|it| it.motions.end == index + 1);
                self.next = (index + 1, continuous + usize::from(accurate_stop));
                self.handed_out += 1;
                let motion = motion.wire(self.setup);
                return Some(Ok(Streamed { number: self.handed_out, motion, accurate_stop }));
            }
            if let Some(error) = self.refused.take() {
                self.passes = 0;
                self.cycle.clear();
                return Some(Err(error));
            }
            if self.passes == 0 {
                return None;
            }
            self.cycle.clear();
            self.next = (0, 0);
            self.refused = self.planner.cycle(self.cell, &mut self.cycle).err();
            self.cell += 1;
            if self.cell >= self.application.cells() {
                self.cell = 0;
                self.passes -= 1;
            }
        }
    }
}
