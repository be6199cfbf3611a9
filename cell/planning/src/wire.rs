//! A plan in the units of the wire. They are the same for the PLC, which sends it, and for the robot's program store.

use core::ops::Range;
use core::time::Duration;

use protocol::image;
use setup::Setup;

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
    /// Its stops, counted from its first motion. What happens at the section's end is not part of it, if there are several.
    pub stops: Vec<Stop>,
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
        let bit = match 1_u16.checked_shl(self.output as u32) {
            Some(bit) => bit,
            None => 0,
        };
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

    /// Returns the sections between the waits and before the visits of shared zones, in order, none of them empty. Without any the
    /// plan is one section with all its stops.
    #[must_use]
    pub fn sections(&self) -> Vec<ProgramSection> {
        let (stops, total) = (self.stops(), self.motions.len());
        if self.waits.is_empty() && self.visits.is_empty() {
            return vec![ProgramSection { motions: 0..total, stops }];
        }
        let waits = self.waits.iter().map(|wait| wait.after);
        let visits = self.visits.iter().map(|visit| visit.after);
        let mut bounds: Vec<_> = waits.chain(visits).chain([0, total]).collect();
        bounds.sort_unstable();
        bounds.dedup();
        let section = |(start, end): (usize, usize)| {
            let within = stops.iter().filter_map(|stop| {
                let after = usize::try_from(stop.after).ok()?;
                let in_section = u32::try_from(after.checked_sub(start)?).ok()?;
                (0 < in_section && after < end).then_some(Stop { after: in_section, ..*stop })
            });
            ProgramSection { motions: start..end, stops: within.collect() }
        };
        bounds.iter().copied().zip(bounds.iter().copied().skip(1)).map(section).collect()
    }

    /// Returns the motions in the units of the wire, as this setup programs them.
    #[must_use]
    pub fn wire_motions(&self, setup: &Setup) -> Vec<image::Motion> {
        self.motions.iter().map(|motion| motion.wire(setup)).collect()
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
