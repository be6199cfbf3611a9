//! A plan in the units of the wire. They are the same for the PLC, which sends it, and for the robot's program store.

use core::ops::Range;
use core::time::Duration;

use protocol::image;
use setup::Setup;

use crate::mark_outputs::outputs_of_waits;
use crate::mark_signal::{MarkSignal, output_bit};
use crate::motion::Motion;
use crate::plan::{Continuous, Plan, ToStart};

/// Number under which the robot's program store holds the application, and which the PLC starts for RC.
pub const PROGRAM: u16 = 1;

/// Where a continuous motion ends.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Stop {
    /// How many motions of the plan are executed there.
    pub after: u32,
    /// What happens there before the next motion.
    pub then: Option<Switch>,
}

/// A part of a plan that the arm executes without a wait for others.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct ProgramSection {
    /// Indices of its motions.
    pub motions: Range<usize>,
    /// Its stops, counted from its first motion. Of several sections the stop at the end belongs to it only where arms meet by outputs:
    /// elsewhere what happens there is the PLC's.
    pub stops: Vec<Stop>,
    /// Marks at which it meets others by outputs, in order, counted from its first motion.
    pub meetings: Vec<Meeting>,
    /// Outputs that it clears before it begins: those by which arms meet, once in a run.
    pub clears: u16,
}

/// A mark in a stored program.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Meeting {
    /// Motions of the program before it.
    pub after: u32,
    /// Set where the action at this stop comes first, and not after the wait.
    pub after_action: bool,
    /// Outputs by which the arms meet.
    pub signal: MarkSignal,
}

/// A digital output that is set or cleared, and the time until that has taken effect.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Switch {
    /// Which bit of the digital outputs, 0..=15.
    pub output: u8,
    /// Whether it is set or cleared.
    pub set: bool,
    /// How long to wait afterwards.
    pub wait: Duration,
}

impl Switch {
    /// Applies the change to `outputs` and returns the result.
    #[must_use]
    pub const fn applied_to(self, outputs: u16) -> u16 {
        let bit = output_bit(self.output);
        if self.set { outputs | bit } else { outputs & !bit }
    }
}

impl Plan {
    /// Returns the stops at which the plan's continuous motions end, in order.
    #[must_use]
    pub fn stops(&self) -> Vec<Stop> {
        let stop = |continuous: &Continuous| Stop {
            after: u32::try_from(continuous.motions.end).unwrap_or(u32::MAX),
            then: continuous.then.as_ref().map(|action| Switch {
                output: action.output,
                set: action.set,
                wait: Duration::try_from_secs_f64(action.wait_ms / 1e3).unwrap_or(Duration::ZERO),
            }),
        };
        self.continuous.iter().map(stop).collect()
    }

    /// Returns the sections that a robot stores as programs, in order, none of them empty: from one visit of a shared zone to the next.
    /// Marks at which arms meet by outputs are within them; at others a section ends.
    #[must_use]
    pub fn sections(&self) -> Vec<ProgramSection> {
        let waits = self.waits.iter().filter(|wait| wait.signal.is_none()).map(|wait| wait.after);
        let mut sections = self.sections_to(waits);
        let stops = self.stops();
        for wait in &self.waits {
            let Some(signal) = wait.signal else { continue };
            // The mark before the first motion is part of the first program.
            let is_in = |section: &&mut ProgramSection| wait.after <= section.motions.end;
            let Some(section) = sections.iter_mut().find(is_in) else { continue };
            let after = u32::try_from(wait.after - section.motions.start.min(wait.after)).unwrap_or(u32::MAX);
            section.meetings.push(Meeting { after, after_action: wait.after_action, signal });
            let at_end = stops.iter().copied().find(|stop| usize::try_from(stop.after) == Ok(wait.after));
            if let Some(stop) = at_end.filter(|_| section.stops.iter().all(|stop| stop.after < after)) {
                section.stops.push(Stop { after, ..stop });
            }
        }
        if let Some(first) = sections.first_mut() {
            first.clears = outputs_of_waits(&self.waits);
        }
        sections
    }

    /// Returns the sections from one rest of the arm at a mark or before a shared zone to the next, in order, none of them empty. What
    /// happens at their ends is not part of them. Without any rest the plan is one section with all its stops.
    #[must_use]
    pub fn sections_between_rests(&self) -> Vec<ProgramSection> {
        self.sections_to(self.waits.iter().map(|wait| wait.after))
    }

    fn sections_to(&self, waits: impl Iterator<Item = usize>) -> Vec<ProgramSection> {
        let (stops, total) = (self.stops(), self.motions.len());
        let visits = self.visits.iter().map(|visit| visit.after);
        let mut bounds: Vec<_> = waits.chain(visits).collect();
        let section = |motions, stops| ProgramSection { motions, stops, meetings: Vec::new(), clears: 0 };
        if bounds.is_empty() {
            return vec![section(0..total, stops)];
        }
        bounds.extend([0, total]);
        bounds.sort_unstable();
        bounds.dedup();
        let between = |(start, end): (usize, usize)| {
            let within = stops.iter().filter_map(|stop| {
                let after = usize::try_from(stop.after).ok()?;
                let in_section = u32::try_from(after.checked_sub(start)?).ok()?;
                (0 < in_section && after < end).then_some(Stop { after: in_section, ..*stop })
            });
            section(start..end, within.collect())
        };
        bounds.iter().copied().zip(bounds.iter().copied().skip(1)).map(between).collect()
    }

    /// Returns the motions in the units of the wire, as this setup programs them; with `plc.form = "compact"` to targets that are
    /// whole steps of the compact points.
    #[must_use]
    pub fn wire_motions(&self, setup: &Setup) -> Vec<image::Motion> {
        match self.wire_points(setup) {
            Ok(Some(path)) => path.motions().collect(),
            _ => self.motions.iter().map(|motion| motion.wire(setup)).collect(),
        }
    }

    /// Returns the motions to the start in the units of the wire, as this setup programs them.
    #[must_use]
    pub fn wire_to_start(&self, setup: &Setup) -> ToStart<image::Motion> {
        let ToStart { from_anywhere, from_end } = &self.to_start;
        ToStart {
            from_anywhere: from_anywhere.as_ref().map(|motion| motion.wire(setup)),
            from_end: from_end.iter().map(|motion| motion.wire(setup)).collect(),
        }
    }
}

impl Motion {
    /// Returns the motion in the units of the wire, as this setup programs it; see [`image::Motion`] for the units.
    ///
    /// Velocity and acceleration are the setup's shares of the rated values, a path's speed at most what its step
    /// allows.
    #[must_use]
    pub fn wire(&self, setup: &Setup) -> image::Motion {
        let programmed = &setup.motions;
        let velocity_share = programmed.velocity_percent.value / 100.0 * self.speed_percent / 100.0;
        let acceleration_share = programmed.acceleration_percent.value / 100.0;
        let (velocity, acceleration) = if self.kind.is_point_to_point() {
            (velocity_share * 10_000.0, acceleration_share * 10_000.0)
        } else {
            let speed_mm_s = velocity_share * setup.robot.path_velocity_mm_s.value;
            let speed_mm_s = self.speed_mm_s.map_or(speed_mm_s, |highest| speed_mm_s.min(highest));
            (speed_mm_s * 10.0, acceleration_share * setup.robot.path_acceleration_mm_s2.value)
        };
        image::Motion {
            kind: self.kind,
            target: self.joints_deg.unwrap_or(self.target.mm_deg()).map(|coordinate| coordinate as f32),
            auxiliary: self.auxiliary.map(|coordinate| coordinate as f32),
            configuration: self.configuration,
            velocity: wire(velocity),
            acceleration: wire(acceleration),
            approximation: wire(self.zone_mm * 100.0),
            tool: self.tool,
            base: self.base,
            ..image::Motion::EMPTY
        }
    }
}

/// Returns the nearest number that the wire can carry.
fn wire(value: f64) -> u16 {
    value.round().clamp(0.0, f64::from(u16::MAX)) as u16
}
