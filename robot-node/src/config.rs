//! The part of a setup that the robot node uses.

use core::time::Duration;

use setup::{Drives, LookAhead, Refill, Servo, Setup};

use crate::arm::motion::{Programmed, Robot};
use crate::arm::{Arm, ConfigError, Frames, Installation, Joints, Surface};

/// The configuration of a robot node.
#[derive(Clone, Debug)]
pub struct RobotConfig {
    /// The arm.
    pub arm: Arm,
    /// Where it stands at power-on.
    pub home: Joints,
    /// Whether the setup leaves that out, so that [`in_cell_of`](Self::in_cell_of) decides.
    pub home_is_open: bool,
    /// Tool frames by number, from the flange; number 0 is the flange.
    pub tools: Frames,
    /// Base frames by number, from the root; number 0 is the root.
    pub bases: Frames,
    /// Highest path velocity, in mm/s.
    pub path_velocity_mm_s: f64,
    /// Highest path acceleration, in mm/s².
    pub path_acceleration_mm_s2: f64,
    /// Highest path jerk, in mm/s³.
    pub path_jerk_mm_s3: f64,
    /// Its force control; `None` without a force controller.
    pub force: Option<ForceControl>,
    /// The surfaces that the tool can press against, in the root frame.
    pub surfaces: Vec<Surface>,
    /// Interpolation cycle.
    pub cycle: Duration,
    /// The PLC's scan cycle, in which it counts its life counter up.
    pub plc_cycle: Duration,
    /// The interpreter notices a command after a time evenly distributed between 0 and this.
    pub interpreter_quantum: Duration,
    /// Additional time before it notices a program or a MoveContinuousSkill, evenly distributed between 0 and this.
    pub start_quantum: Duration,
    /// Cycles that pass before the first motion of a MoveContinuousSkill, and not before that of a program.
    pub continuous_start_cycles: u32,
    /// Motions of a MoveContinuousSkill that it knows at most, from 5.
    pub queue_motions: u32,
    /// If true, it takes compact points.
    pub compact_points: bool,
    /// The count by which its PLC refills slots, for rehearsals.
    pub refill: Refill,
    /// Look-ahead over a program.
    pub program_look_ahead: LookAhead,
    /// Time of a skill call besides its motion.
    pub skill_overhead: Duration,
    /// What moves the joints; `None` for joints that are at once where they are set.
    pub drives: Option<Drives>,
    /// Limits and monitoring of the drives.
    pub servo: ServoLimits,
}

/// Limits and monitoring of the drives, the same for each axis.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct ServoLimits {
    /// Highest speed of a motor, as a share of its joint's rated speed.
    pub speed: f64,
    /// Peak torque of a motor, as a share of what its joint's rated acceleration takes.
    pub torque: f64,
    /// Largest following error, in degrees (mm).
    pub following_error: f64,
    /// Time for which the following error may be larger.
    pub following_error_for: Duration,
    /// Exact stop: largest distance of a joint from its set-point at which it has arrived, in degrees (mm).
    pub in_position: f64,
    /// Time within which each joint must arrive after its set-points rest.
    pub settling: Duration,
    /// Time within which a reset must switch all drives on.
    pub switch_on: Duration,
}

impl From<&Servo> for ServoLimits {
    fn from(servo: &Servo) -> Self {
        let millis = |value: u32| Duration::from_millis(value.into());
        Self {
            speed: servo.speed_percent.value / 100.0,
            torque: servo.torque_percent.value / 100.0,
            following_error: servo.following_error_deg.value,
            following_error_for: millis(servo.following_error_ms.value),
            in_position: servo.in_position_deg.value,
            settling: millis(servo.settling_ms.value),
            switch_on: millis(servo.switch_on_ms.value),
        }
    }
}

/// How the arm presses.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct ForceControl {
    /// The highest contact force that may be asked for, in N.
    pub max_n: f64,
    /// The stiffest surface that the controller is set for, in N/mm.
    pub stiffest_n_per_mm: f64,
    /// Tolerance around the programmed force, in N.
    pub tolerance_n: f64,
    /// How long it must stay reached.
    pub settling: Duration,
    /// The highest jerk of the tool, in mm/s³.
    pub jerk_mm_s3: f64,
}

fn error<T>(key: &str, problem: impl Into<String>) -> Result<T, ConfigError> {
    Err(ConfigError { key: key.to_owned(), problem: problem.into() })
}

impl RobotConfig {
    /// Reads the robot's part of a setup and checks its values.
    ///
    /// # Errors
    ///
    /// The key, what is wrong with it and what would be right.
    pub fn from_setup(setup: &Setup) -> Result<Self, ConfigError> {
        let robot = &setup.robot;
        let installation = Installation::from_setup(setup)?;
        let home = installation.home_or_middle();
        let Installation { arm, home: known_home, tools, bases } = installation;
        let (velocity, acceleration) = (robot.path_velocity_mm_s.value, robot.path_acceleration_mm_s2.value);
        if !(velocity > 0.0 && velocity.is_finite()) {
            return error("path_velocity_mm_s", format!("{velocity} is not a velocity above 0"));
        }
        if !(acceleration > 0.0 && acceleration.is_finite()) {
            return error(
                "path_acceleration_mm_s2",
                format!("{acceleration} is not an acceleration above 0"),
            );
        }
        let jerk = robot.path_jerk_mm_s3.value;
        if !(jerk > 0.0 && jerk.is_finite()) {
            return error("path_jerk_mm_s3", format!("{jerk} is not a jerk above 0"));
        }
        if robot.cycle_us.value == 0 {
            return error("cycle_us", "0 µs: must be 1000 to 12000 µs, as controllers interpolate");
        }
        let micros = |value: u32| Duration::from_micros(u64::from(value));
        Ok(Self {
            arm,
            home,
            home_is_open: known_home.is_none(),
            tools,
            bases,
            path_velocity_mm_s: velocity,
            path_acceleration_mm_s2: acceleration,
            path_jerk_mm_s3: jerk,
            force: robot.force.as_ref().map(|force| ForceControl {
                max_n: force.max_n.value,
                stiffest_n_per_mm: force.stiffest_n_per_mm.value,
                tolerance_n: force.tolerance_n.value,
                settling: Duration::from_millis(force.settling_ms.value.into()),
                jerk_mm_s3: force.jerk_mm_s3.value,
            }),
            surfaces: Vec::new(),
            cycle: micros(robot.cycle_us.value),
            plc_cycle: micros(setup.plc.scan_cycle_us.value),
            interpreter_quantum: micros(robot.interpreter_quantum_us.value),
            start_quantum: micros(robot.start_quantum_us.as_ref().map_or(0, |quantum| quantum.value)),
            continuous_start_cycles: robot.continuous_start_cycles.as_ref().map_or(0, |cycles| cycles.value),
            queue_motions: robot.queue_holds(),
            compact_points: robot.takes_compact_points(),
            refill: setup.plc.refills_by(),
            program_look_ahead: robot.looks_ahead(),
            skill_overhead: micros(robot.skill_overhead_us.value),
            drives: robot.drives,
            servo: ServoLimits::from(robot.servo.as_ref().unwrap_or(&Servo::assumed())),
        })
    }
}

impl<'a> From<&'a RobotConfig> for Robot<'a> {
    fn from(config: &'a RobotConfig) -> Self {
        let RobotConfig { arm, tools, bases, .. } = config;
        let most = Programmed {
            speed: config.path_velocity_mm_s,
            acceleration: config.path_acceleration_mm_s2,
            deceleration: config.path_acceleration_mm_s2,
            jerk: config.path_jerk_mm_s3,
        };
        Self { arm, tools, bases, most, presses: config.force.is_some() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn setup_a_describes_a_robot() {
        let config = RobotConfig::from_setup(&setup::setup("A").unwrap()).unwrap();
        assert_eq!(config.arm.axes(), 4);
        assert_eq!(config.cycle, Duration::from_millis(4));
        assert!(config.bases[1].is_some() && config.bases[2].is_none());
    }
}
