//! The override: how fast the robot goes of what is programmed, now and over the time of a run.

use core::fmt;
use core::str::FromStr;

use machine::Duration;
use node::list::values;
use serde::{Deserialize, Serialize};
use setup::Figure;

/// Changes of the override in one run, at most.
const STEPS: usize = 16;

/// Latest time of a change after the start of a run.
const LATEST: Duration = Duration::from_secs(3_600);

/// The override in whole percent of every programmed velocity, 0 to 100. At 0 the arm stops on its path.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub struct Override(u8);

/// A number that is not an override.
#[derive(Clone, Copy, PartialEq, Debug, thiserror::Error)]
#[error("an override of {} % was asked for; it is 0 (the arm stops on its path) to 100 %", Figure(*.0))]
pub struct OverrideError(pub f64);

impl Override {
    /// As programmed.
    pub const FULL: Self = Self(100);
    /// The arm stops on its path.
    pub const STOP: Self = Self(0);

    /// Creates an override in percent, rounded to whole ones; a value above 0 that would round to 0 becomes 1 %, because
    /// only 0 stops the arm.
    ///
    /// # Errors
    ///
    /// It is not within 0 to 100 %.
    pub fn from_percent(percent: f64) -> Result<Self, OverrideError> {
        if !(0.0..=100.0).contains(&percent) {
            return Err(OverrideError(percent));
        }
        let least = if percent > 0.0 { 1.0 } else { 0.0 };
        Ok(Self(percent.round().max(least) as u8))
    }

    /// Returns the override in percent, as the image carries it.
    #[must_use]
    pub const fn percent(self) -> u8 {
        self.0
    }
}

impl fmt::Display for Override {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} %", self.0)
    }
}

/// One change of the override.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct OverrideStep {
    after_us: u32,
    /// The override from then on.
    pub to: Override,
}

impl OverrideStep {
    /// As a run without a schedule starts.
    const START: Self = Self { after_us: 0, to: Override::FULL };

    /// Returns the time since the start edge of the run.
    #[must_use]
    pub const fn after(&self) -> Duration {
        Duration::from_micros(self.after_us as u64)
    }
}

/// The override over the time of a run, as `--override` says it: `50` from the start edge on, `50@2s` from two seconds after
/// it on, `80,0@2s,100@3s` one after the other. Before its first step a run goes at 100 %.
///
/// It has a fixed size, so that the cyclic thread takes it over without memory of its own.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct OverrideSchedule {
    steps: [OverrideStep; STEPS],
    len: usize,
}

/// Why a text is no [`OverrideSchedule`].
#[derive(Clone, PartialEq, Debug, thiserror::Error)]
pub enum ScheduleError {
    /// A step is none.
    #[error(
        "`{0}`: invalid override; write percent, and a time after the start of each repetition: 50, 50@2s or 80,0@2s,100@3s"
    )]
    Form(String),
    /// The percent are out of their range.
    #[error("`{text}`: {error}")]
    Percent {
        /// The step.
        text: String,
        /// What is wrong with it.
        error: OverrideError,
    },
    /// The percent are not whole, as the process image carries them.
    #[error("`{0}`: must be a whole percentage, 0 to 100, such as 50")]
    Fraction(String),
    /// A time is none.
    #[error("`{0}`: invalid time after @; write a number of us, ms or s, at most 3600s, such as 2.5ms or 2s")]
    Time(String),
    /// A step comes too early.
    #[error("`{0}` does not come after the step before it; write the steps in the order of their times")]
    Order(String),
    /// There are more steps than there is room for.
    #[error("there are {0} changes of the override; a run takes {STEPS}")]
    TooMany(usize),
    /// The run would not end.
    #[error("`{0}` leaves the arm standing for ever; let a later step raise the override, as in 0,100@10s")]
    Standstill(String),
}

impl OverrideSchedule {
    /// Returns whether the override is 100 % throughout, as without a schedule.
    #[must_use]
    pub fn is_full(&self) -> bool {
        self.steps().iter().all(|step| step.to == Override::FULL)
    }

    /// Returns the steps in the order of their times. The first one is that of the start edge.
    #[must_use]
    pub fn steps(&self) -> &[OverrideStep] {
        self.steps.get(..self.len).unwrap_or_default()
    }
}

impl FromStr for OverrideSchedule {
    type Err = ScheduleError;

    fn from_str(text: &str) -> Result<Self, ScheduleError> {
        let mut found = vec![OverrideStep::START];
        // A blank separates steps, but not a number from its unit.
        let text = &text.replace(" %", "%");
        if values(text).next().is_none() {
            step(text)?;
        }
        for (index, part) in values(text).enumerate() {
            let step = step(part)?;
            let before = found.last().map_or(0, |step| step.after_us);
            match found.first_mut() {
                Some(start) if index == 0 && step.after_us == 0 => *start = step,
                _ if step.after_us <= before => return Err(ScheduleError::Order(part.to_owned())),
                _ => found.push(step),
            }
        }
        if found.last().is_some_and(|last| last.to == Override::STOP) {
            return Err(ScheduleError::Standstill(text.to_owned()));
        }
        let mut steps = [OverrideStep::START; STEPS];
        let room = steps.get_mut(..found.len()).ok_or(ScheduleError::TooMany(found.len()))?;
        room.copy_from_slice(&found);
        Ok(Self { steps, len: found.len() })
    }
}

fn step(text: &str) -> Result<OverrideStep, ScheduleError> {
    let (percent, after_us) = match text.split_once('@') {
        None => (text, Some(0)),
        Some((percent, time)) => {
            let after = node::parse_duration(time).filter(|after| *after <= LATEST);
            (percent, after.and_then(|after| u32::try_from(after.as_micros()).ok()))
        }
    };
    let after_us = after_us.ok_or_else(|| ScheduleError::Time(text.to_owned()))?;
    let percent = percent.trim().trim_end_matches('%').trim_end();
    let percent: f64 = percent.parse().map_err(|_| ScheduleError::Form(text.to_owned()))?;
    let to = Override::from_percent(percent);
    if to.is_ok() && percent.fract() > 0.0 {
        return Err(ScheduleError::Fraction(text.to_owned()));
    }
    Ok(OverrideStep {
        after_us,
        to: to.map_err(|error| ScheduleError::Percent { text: text.to_owned(), error })?,
    })
}

impl fmt::Display for OverrideSchedule {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, OverrideStep { after_us, to }) in self.steps().iter().enumerate() {
            let comma = if index == 0 { "" } else { "," };
            write!(f, "{comma}{}", to.percent())?;
            if *after_us > 0 {
                write!(f, "@{}s", f64::from(*after_us) / 1e6)?;
            }
        }
        Ok(())
    }
}

impl TryFrom<String> for OverrideSchedule {
    type Error = String;

    /// The error names the field, because an instruction has other ones.
    fn try_from(text: String) -> Result<Self, String> {
        text.parse().map_err(|error: ScheduleError| format!("override: {error}"))
    }
}

impl From<OverrideSchedule> for String {
    fn from(schedule: OverrideSchedule) -> Self {
        schedule.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn steps(text: &str) -> Vec<(u32, u8)> {
        let schedule: OverrideSchedule = text.parse().unwrap();
        assert_eq!(schedule.to_string().parse(), Ok(schedule), "{schedule}");
        schedule.steps().iter().map(|step| (step.after_us, step.to.percent())).collect()
    }

    #[test]
    fn a_schedule_is_read_as_it_is_written_and_begins_at_100_percent() {
        assert_eq!(steps("50"), [(0, 50)]);
        assert_eq!(steps("50 %"), [(0, 50)]);
        assert_eq!(steps("50@2s"), [(0, 100), (2_000_000, 50)]);
        assert_eq!(steps("80,0@1.5ms,100@3s"), [(0, 80), (1_500, 0), (3_000_000, 100)]);
        assert_eq!(steps("80 % 0@1.5ms, 100@3s"), [(0, 80), (1_500, 0), (3_000_000, 100)]);
    }

    #[test]
    fn a_schedule_is_stored_as_the_text_that_it_is_read_from() {
        let schedule: OverrideSchedule = "80, 0@1.5ms, 100@3s".parse().unwrap();
        let text = serde_json::to_string(&schedule).unwrap();
        assert_eq!(text, r#""80,0@0.0015s,100@3s""#);
        assert_eq!(serde_json::from_str::<OverrideSchedule>(&text).unwrap(), schedule);
    }

    #[test]
    fn what_is_no_schedule_says_which_part_what_was_found_and_what_would_do() {
        let wrong = [
            "fast",
            "50@2",
            "50@1h",
            "50@3601s",
            "50.4",
            "0.1@2s",
            "120",
            "1e308",
            "-1@2s",
            "NaN",
            "50@2s,70@1s",
            "50,60",
            "0",
            "80,0@2s",
            "",
        ];
        let many = (1..=16).map(|second| format!("50@{second}s")).collect::<Vec<_>>().join(",");
        let told: Vec<String> = wrong
            .iter()
            .copied()
            .chain([many.as_str()])
            .map(|text| text.parse::<OverrideSchedule>().unwrap_err().to_string())
            .collect();
        insta::assert_snapshot!(told.join("\n"), @"
        `fast`: invalid override; write percent, and a time after the start of each repetition: 50, 50@2s or 80,0@2s,100@3s
        `50@2`: invalid time after @; write a number of us, ms or s, at most 3600s, such as 2.5ms or 2s
        `50@1h`: invalid time after @; write a number of us, ms or s, at most 3600s, such as 2.5ms or 2s
        `50@3601s`: invalid time after @; write a number of us, ms or s, at most 3600s, such as 2.5ms or 2s
        `50.4`: must be a whole percentage, 0 to 100, such as 50
        `0.1@2s`: must be a whole percentage, 0 to 100, such as 50
        `120`: an override of 120 % was asked for; it is 0 (the arm stops on its path) to 100 %
        `1e308`: an override of 1e308 % was asked for; it is 0 (the arm stops on its path) to 100 %
        `-1@2s`: an override of -1 % was asked for; it is 0 (the arm stops on its path) to 100 %
        `NaN`: an override of NaN % was asked for; it is 0 (the arm stops on its path) to 100 %
        `70@1s` does not come after the step before it; write the steps in the order of their times
        `60` does not come after the step before it; write the steps in the order of their times
        `0` leaves the arm standing for ever; let a later step raise the override, as in 0,100@10s
        `80,0@2s` leaves the arm standing for ever; let a later step raise the override, as in 0,100@10s
        ``: invalid override; write percent, and a time after the start of each repetition: 50, 50@2s or 80,0@2s,100@3s
        there are 17 changes of the override; a run takes 16
        ");
    }

    #[test]
    fn a_schedule_of_nothing_but_100_percent_is_full() {
        let is_full = |text: &str| text.parse::<OverrideSchedule>().unwrap().is_full();
        assert!(is_full("100") && is_full("100,100@2s"));
        assert!(!is_full("50") && !is_full("100,50@2s") && !is_full("50,100@2s"));
    }

    #[test]
    fn percent_are_rounded_but_only_0_stops_the_arm() {
        let percent = |percent| Override::from_percent(percent).map(Override::percent);
        assert_eq!(
            [percent(0.0), percent(0.1), percent(49.6), percent(100.0)],
            [Ok(0), Ok(1), Ok(50), Ok(100)]
        );
        for wrong in [-0.1, 100.1, f64::NAN, f64::INFINITY] {
            assert!(percent(wrong).is_err(), "{wrong}");
        }
    }
}
