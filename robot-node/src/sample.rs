//! What the robot does in one cycle, and its columns in a trace.

use std::fmt;
use std::fmt::Write as _;
use std::str::FromStr;

use node::trace_row::{Fields, TraceSample};
use protocol::image::State;
use serde::{Deserialize, Serialize};

/// Source of the joints' positions.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Positions {
    /// What the controller sets: there are no drives.
    #[default]
    SetPoints,
    /// What the drives report.
    Drives,
}

impl Positions {
    /// Returns the source for a robot with these drives.
    #[must_use]
    pub const fn of(drives: Option<setup::Drives>) -> Self {
        if drives.is_some() { Self::Drives } else { Self::SetPoints }
    }
}

impl fmt::Display for Positions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::SetPoints => "set-points",
            Self::Drives => "drives",
        })
    }
}

impl FromStr for Positions {
    type Err = ();

    fn from_str(name: &str) -> Result<Self, ()> {
        [Self::SetPoints, Self::Drives].into_iter().find(|known| known.to_string() == name).ok_or(())
    }
}

/// What the robot does in one interpolation cycle.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Sample {
    /// State of the skill execution.
    pub state: State,
    /// Number of the last command that the robot accepted or refused.
    pub command: u16,
    /// Motions of the skill that the robot has executed.
    pub executed: u32,
    /// Motions of the skill that the robot has accepted.
    pub accepted: u32,
    /// Motions of the skill that ended in a stop because the next motion did not arrive in time.
    pub blends_suppressed: u16,
    /// Speed of the tool along its path, in mm/s.
    pub path_speed_mm_s: f32,
    /// Pose of the tool in the base frame: x, y, z in mm; a, b, c in degrees.
    pub pose: [f32; 6],
    /// Joint values in degrees; in mm for a linear axis. As exact as the robot has them: a jerk in rated units can be
    /// found from four rows.
    pub joints: [f64; 6],
    /// Images of the PLC that the robot refused so far, because a byte was altered.
    pub altered: u64,
    /// Source of joints, pose and path speed.
    pub positions: Positions,
    /// Law time of the skill that the arm has driven, in µs, see `process-image.md`, Moving together; after the skill's end that of its
    /// end, until the next command.
    pub progress_us: u64,
}

impl Sample {
    /// Returns the motions that wait in the robot or are being executed.
    #[must_use]
    pub const fn queued(&self) -> u32 {
        self.accepted.saturating_sub(self.executed)
    }
}

impl Default for Sample {
    fn default() -> Self {
        Self {
            state: State::Halted,
            command: 0,
            executed: 0,
            accepted: 0,
            blends_suppressed: 0,
            path_speed_mm_s: 0.0,
            pose: [0.0; 6],
            joints: [0.0; 6],
            altered: 0,
            positions: Positions::SetPoints,
            progress_us: 0,
        }
    }
}

impl TraceSample for Sample {
    const COLUMNS: &'static str = "state,command,executed,accepted,queued,blends_suppressed,path_speed_mm_s,\
        x_mm,y_mm,z_mm,a_deg,b_deg,c_deg,joint_1,joint_2,joint_3,joint_4,joint_5,joint_6,altered,positions,progress";
    const ADDED: &'static str = ",progress";

    fn write(&self, line: &mut String) {
        let Self { state, command, executed, accepted, blends_suppressed, path_speed_mm_s, .. } = self;
        let queued = self.queued();
        let _ = write!(
            line,
            "{state:?},{command},{executed},{accepted},{queued},{blends_suppressed},{path_speed_mm_s:.3}"
        );
        for value in &self.pose {
            let _ = write!(line, ",{value:.4}");
        }
        for value in &self.joints {
            let _ = write!(line, ",{value:.7}");
        }
        let _ = write!(line, ",{},{},{}", self.altered, self.positions, self.progress_us);
    }

    fn read(fields: &mut Fields<'_>) -> Option<Self> {
        let state = match fields.text()? {
            "Halted" => State::Halted,
            "Ready" => State::Ready,
            "Running" => State::Running,
            "Suspended" => State::Suspended,
            _ => return None,
        };
        let (command, executed, accepted) = (fields.value()?, fields.value()?, fields.value()?);
        let queued: u32 = fields.value()?;
        let mut sample = Self {
            state,
            command,
            executed,
            accepted,
            blends_suppressed: fields.value()?,
            path_speed_mm_s: fields.value()?,
            ..Self::default()
        };
        for value in &mut sample.pose {
            *value = fields.value()?;
        }
        for value in &mut sample.joints {
            *value = fields.value()?;
        }
        sample.altered = fields.value()?;
        // Older versions do not name it: their path speed is that of the set-points.
        sample.positions = fields.text().map_or(Some(Positions::SetPoints), |name| name.parse().ok())?;
        sample.progress_us = fields.text().map_or(Some(0), |value| value.parse().ok())?;
        (sample.queued() == queued).then_some(sample)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_column_has_a_name_and_is_read_as_it_was_written() {
        for state in [State::Halted, State::Ready, State::Running, State::Suspended] {
            let sample = Sample {
                state,
                command: 3,
                executed: 1,
                accepted: 5,
                blends_suppressed: 2,
                path_speed_mm_s: 441.75,
                pose: [1.0, -2.5, 3.0, 0.0, 0.0, 180.0],
                joints: [10.0, 20.0, 30.0, 40.0, 0.0, 0.0],
                altered: 1,
                positions: Positions::Drives,
                progress_us: 1_250_000,
            };
            let mut line = String::new();
            sample.write(&mut line);
            assert_eq!(line.split(',').count(), Sample::COLUMNS.split(',').count());
            assert_eq!(Fields::of(&line).sample(), Some(sample));
        }
    }
}
