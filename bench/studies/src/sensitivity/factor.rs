//! The numbers that a study varies.

use std::fmt;

use planning::{Application, Plan};
use serde::{Deserialize, Serialize};
use setup::Setup;

/// A number that the paper does not give.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Factor {
    /// N: the same path in another number of motions. Below 1, collinear motions are joined; from 2 on, each straight
    /// motion is split into this many.
    Motions,
    /// The length of every path.
    Length,
    /// The programmed acceleration.
    Acceleration,
    /// The approximation distance.
    Approximation,
    /// h: what a skill call costs besides its motion.
    Overhead,
}

impl Factor {
    /// All factors.
    pub const ALL: [Self; 5] =
        [Self::Motions, Self::Length, Self::Acceleration, Self::Approximation, Self::Overhead];

    /// Returns the default multipliers: half and double if the arm allows it. Upwards its stroke ends a little above
    /// the unchanged application.
    const fn usual(self) -> &'static [f64] {
        match self {
            Self::Motions => &[0.5, 2.0, 3.0],
            Self::Length => &[0.5, 0.75, 1.1],
            Self::Acceleration => &[0.5, 2.0],
            Self::Approximation => &[0.0, 0.5, 2.0],
            Self::Overhead => &[0.0, 0.5, 2.0],
        }
    }
}

impl fmt::Display for Factor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Motions => "motions",
            Self::Length => "path length",
            Self::Acceleration => "acceleration",
            Self::Approximation => "blending",
            Self::Overhead => "h",
        })
    }
}

/// The setup with one number changed.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Case {
    /// The varied number; `None` for the unchanged setup.
    pub factor: Option<Factor>,
    /// Its multiplier.
    pub times: f64,
}

/// Inputs of one case's run.
pub(super) struct Job {
    pub(super) setup: Setup,
    pub(super) application: Application,
    pub(super) plan: Plan,
}

impl Case {
    /// Returns the unchanged setup, then every number with every multiplier except 1. Numbers that a setup does not
    /// have are left out.
    #[must_use]
    pub fn all(setup: &Setup, factors: Option<&[f64]>) -> Vec<Self> {
        let has = |factor: Factor| match factor {
            Factor::Motions | Factor::Length | Factor::Acceleration => true,
            Factor::Approximation => setup.motions.approximation_mm.value > 0.0,
            Factor::Overhead => setup.robot.skill_overhead_us.value > 0,
        };
        let cases = |factor: Factor| {
            // The motions have their own multipliers: a plan is joined or split as a whole.
            let asked = factors.filter(|_| factor != Factor::Motions);
            let times = asked.unwrap_or(factor.usual()).iter().filter(|times| **times != 1.0);
            times.map(move |times| Self { factor: Some(factor), times: *times }).collect::<Vec<_>>()
        };
        std::iter::once(Self { factor: None, times: 1.0 })
            .chain(Factor::ALL.into_iter().filter(|factor| has(*factor)).flat_map(cases))
            .collect()
    }

    /// Makes the setup, the application and the plan of this case.
    ///
    /// # Errors
    ///
    /// Why there is none, as text.
    pub(super) fn make(&self, setup: &Setup, application: &Application) -> Result<Job, String> {
        let Self { factor, times } = *self;
        let mut setup = setup.clone();
        let mut application = application.clone();
        match factor {
            None | Some(Factor::Motions) => {}
            Some(Factor::Length) => application = application.scaled(times),
            Some(Factor::Acceleration) => {
                let percent = setup.motions.acceleration_percent.value * times;
                setup = setup.with_acceleration(percent);
            }
            Some(Factor::Approximation) => {
                application.zones.approximation_mm = application.zones.approximation_mm.map(|mm| mm * times);
                let mm = setup.motions.approximation_mm.value * times;
                setup = setup.with_approximation(mm);
            }
            Some(Factor::Overhead) => {
                let overhead_us = f64::from(setup.robot.skill_overhead_us.value) * times;
                setup = setup.with_skill_overhead(overhead_us.round() as u32);
            }
        }
        setup::check(&setup).map_err(|error| error.to_string())?;
        let plan = planning::plan(&application, &setup).map_err(|error| error.to_string())?;
        let approximation_mm = setup.motions.approximation_mm.value;
        let plan = match factor {
            Some(Factor::Motions) if times < 1.0 => plan.joined(),
            Some(Factor::Motions) => plan.divided(times.round() as u32, approximation_mm),
            _ => plan,
        };
        Ok(Job { setup, application, plan })
    }

    /// Formats the number's value in this case, with its unit.
    #[must_use]
    pub fn value(&self, setup: &Setup, application: &Application) -> String {
        let made = self.make(setup, application).ok();
        let motions = &setup.motions;
        match self.factor {
            None => {
                made.map_or_else(String::new, |Job { plan, .. }| format!("{} motions", plan.motions.len()))
            }
            Some(Factor::Motions) => {
                made.map_or_else(String::new, |Job { plan, .. }| plan.motions.len().to_string())
            }
            Some(Factor::Length) => {
                made.map_or_else(String::new, |Job { plan, .. }| format!("{:.0} mm", plan.length_mm()))
            }
            Some(Factor::Acceleration) => {
                let share = motions.acceleration_percent.value / 100.0 * self.times;
                format!("{:.2} m/s²", share * setup.robot.path_acceleration_mm_s2.value / 1e3)
            }
            Some(Factor::Approximation) => format!("{} mm", motions.approximation_mm.value * self.times),
            Some(Factor::Overhead) => {
                format!("{:.1} ms", f64::from(setup.robot.skill_overhead_us.value) * self.times / 1e3)
            }
        }
    }
}
