//! The inputs of a block of one motion, in engineering units, and the motion of the image that they make.
//!
//! | blocks | `Velocity` | `Acceleration`, `Deceleration` | `Jerk` |
//! |---|---|---|---|
//! | LIN, CIRC, SPLINE, LIN force | mm/s | mm/s² | mm/s³ |
//! | PTP | % of each axis's rated speed | % of its rated acceleration | % of its rated jerk |
//!
//! A line that only turns the tool has degrees for mm. A PTP has no speed in mm/s: the slowest axis sets the pace of all, and
//! PLCopen, SRCI and mxAutomation give it as a percentage as well.
//!
//! A block refuses what the image cannot carry; what this robot cannot do is refused by the robot, with its limit.

use protocol::image::{Configuration, Motion, MotionKind};

use super::{BlockError, Real};

/// The inputs of a block of one motion.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct MotionInputs {
    /// `Position`: x, y, z in mm and the angles a, b, c (about z, y', x'') in degrees, in the base; of a joint target the
    /// joints in degrees, a linear one in mm.
    pub position: [f64; 6],
    /// `AuxPoint` of a circle in mm, `Force` of a LIN force in N; otherwise not used.
    pub auxiliary: [f64; 3],
    /// Configuration in which the arm reaches a Cartesian target; none is the nearest one. PTP, LIN and SPLINE have it.
    pub configuration: Option<Configuration>,
    /// How fast.
    pub dynamics: Dynamics,
    /// PLCopen's `TransitionParameter`: approximation distance in mm, how far from its target a motion of a
    /// [`MoveContinuous`](super::MoveContinuous) may leave its path for the next one. A block of one motion stops exactly at its target.
    pub approximation_mm: f64,
    /// `Tool`: number of the tool frame, 0..=15.
    pub tool: u8,
    /// `Base`: number of the base frame, 0..=15.
    pub base: u8,
}

/// Speed and its changes, along a path in mm (degrees) and s, of a PTP in percent of the rated values.
#[derive(Clone, Copy, PartialEq, Default, Debug)]
pub struct Dynamics {
    /// `Velocity`, in mm/s or %.
    pub velocity: f64,
    /// `Acceleration`, in mm/s² or %.
    pub acceleration: f64,
    /// `Deceleration`, in mm/s² or %; 0 is the same as `acceleration`. LIN, SPLINE and PTP have it.
    pub deceleration: f64,
    /// `Jerk`, in mm/s³ or %; 0 is the robot's own: the setup's path jerk, of a PTP the share of `acceleration`. LIN, SPLINE and
    /// PTP have it.
    pub jerk: f64,
}

/// What one step of the image's numbers is worth: of velocity, acceleration and jerk.
struct Steps {
    velocity: f64,
    acceleration: f64,
    jerk: f64,
}

impl Steps {
    const fn of(kind: MotionKind) -> Self {
        if kind.is_point_to_point() {
            Self { velocity: 0.01, acceleration: 0.01, jerk: 0.01 }
        } else {
            Self { velocity: 0.1, acceleration: 1.0, jerk: 10.0 }
        }
    }
}

/// What one step of the approximation distance is worth, in mm.
const APPROXIMATION_MM: f64 = 0.01;

/// Highest number of a tool or base.
const HIGHEST_FRAME: u8 = 15;

impl MotionInputs {
    /// Returns the motion of this kind.
    ///
    /// # Errors
    ///
    /// [`BlockError::InputOutOfRange`] and [`BlockError::InputNotSupported`] where the image cannot carry an input.
    pub fn motion(&self, kind: MotionKind) -> Result<Motion, BlockError> {
        let steps = Steps::of(kind);
        let Dynamics { velocity, acceleration, deceleration, jerk } = self.dynamics;
        let motion = Motion {
            kind,
            target: self.position.map(|coordinate| coordinate as f32),
            auxiliary: if kind.has_auxiliary() { self.auxiliary.map(|part| part as f32) } else { [0.0; 3] },
            configuration: self.configuration,
            velocity: number("Velocity", velocity, steps.velocity)?,
            acceleration: number("Acceleration", acceleration, steps.acceleration)?,
            deceleration: number("Deceleration", deceleration, steps.acceleration)?,
            jerk: number("Jerk", jerk, steps.jerk)?,
            approximation: number("TransitionParameter", self.approximation_mm, APPROXIMATION_MM)?,
            tool: frame("Tool", self.tool)?,
            base: frame("Base", self.base)?,
        };
        let is_given = [
            ("Deceleration", motion.deceleration > 0 && kind.has_auxiliary()),
            ("Jerk", motion.jerk > 0 && kind.has_auxiliary()),
            ("Configuration", motion.configuration.is_some() && !kind.has_configuration()),
        ];
        match is_given.into_iter().find(|(_, is_given)| *is_given) {
            Some((name, _)) => Err(BlockError::InputNotSupported { name, kind }),
            None => Ok(motion),
        }
    }
}

impl From<&Motion> for MotionInputs {
    /// Reads a motion of the image in engineering units. The way back gives the same motion.
    fn from(motion: &Motion) -> Self {
        let steps = Steps::of(motion.kind);
        Self {
            position: motion.target.map(f64::from),
            auxiliary: motion.auxiliary.map(f64::from),
            configuration: motion.configuration,
            dynamics: Dynamics {
                velocity: f64::from(motion.velocity) * steps.velocity,
                acceleration: f64::from(motion.acceleration) * steps.acceleration,
                deceleration: f64::from(motion.deceleration) * steps.acceleration,
                jerk: f64::from(motion.jerk) * steps.jerk,
            },
            approximation_mm: f64::from(motion.approximation) * APPROXIMATION_MM,
            tool: motion.tool,
            base: motion.base,
        }
    }
}

/// Converts an input to the image's number. A value above 0 does not become 0, which may have another meaning.
fn number(name: &'static str, value: f64, step: f64) -> Result<u16, BlockError> {
    let upper = f64::from(u16::MAX) * step;
    let steps = (value / step).round();
    if !(0.0..=f64::from(u16::MAX)).contains(&steps) || (steps == 0.0 && value != 0.0) {
        let [found, lower, upper] = [value, step, upper].map(Real::from);
        return Err(BlockError::InputOutOfRange { name, found, lower, upper });
    }
    Ok(steps as u16)
}

fn frame(name: &'static str, number: u8) -> Result<u8, BlockError> {
    if number <= HIGHEST_FRAME {
        return Ok(number);
    }
    let [found, lower, upper] = [number, 0, HIGHEST_FRAME].map(|number| Real::from(f64::from(number)));
    Err(BlockError::InputOutOfRange { name, found, lower, upper })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const LINE: MotionInputs = MotionInputs {
        position: [100.0, 0.0, 50.0, 0.0, 0.0, 180.0],
        auxiliary: [0.0; 3],
        configuration: None,
        dynamics: Dynamics { velocity: 250.0, acceleration: 2500.0, deceleration: 1000.0, jerk: 40_000.0 },
        approximation_mm: 5.0,
        tool: 0,
        base: 1,
    };

    const PERCENT: Dynamics = Dynamics { velocity: 25.0, acceleration: 50.0, deceleration: 10.0, jerk: 5.0 };

    fn refusal(kind: MotionKind, change: impl FnOnce(&mut MotionInputs)) -> String {
        let mut inputs = LINE;
        change(&mut inputs);
        inputs.motion(kind).unwrap_err().to_string()
    }

    #[test]
    fn a_path_has_mm_and_seconds_and_a_ptp_percent() {
        let line = LINE.motion(MotionKind::LinCartesian).unwrap();
        assert_eq!((line.velocity_mm_s(), line.acceleration_mm_s2()), (250.0, 2500.0));
        assert_eq!((line.deceleration_mm_s2(), line.jerk_mm_s3()), (Some(1000.0), Some(40_000.0)));
        assert_eq!(line.approximation_mm(), 5.0);
        let ptp = MotionInputs { dynamics: PERCENT, ..LINE }.motion(MotionKind::PtpCartesian).unwrap();
        assert_eq!((ptp.velocity_share(), ptp.acceleration_share()), (0.25, 0.5));
        assert_eq!((ptp.deceleration_share(), ptp.jerk_share()), (Some(0.1), Some(0.05)));
    }

    #[test]
    fn what_the_image_cannot_carry_is_refused_with_input_value_and_range() {
        let lin = MotionKind::LinCartesian;
        let mut words = String::new();
        let mut add = |refusal: String| words.extend([refusal.as_str(), "\n"]);
        add(refusal(lin, |it| it.dynamics.velocity = 6554.0));
        add(refusal(lin, |it| it.dynamics.velocity = f64::NAN));
        add(refusal(lin, |it| it.dynamics.acceleration = -1.0));
        add(refusal(lin, |it| it.dynamics.deceleration = 0.2));
        add(refusal(lin, |it| it.dynamics.jerk = 3.0));
        add(refusal(MotionKind::PtpJoint, |it| it.dynamics = Dynamics { velocity: 700.0, ..PERCENT }));
        add(refusal(lin, |it| it.tool = 16));
        add(refusal(MotionKind::Circular, |_| ()));
        add(refusal(MotionKind::LinForceCartesian, |it| it.dynamics.deceleration = 0.0));
        add(refusal(MotionKind::PtpJoint, |it| {
            it.dynamics = PERCENT;
            it.configuration = Some(Configuration { status: 2, turn: None });
        }));
        insta::assert_snapshot!(words, @r"
        Velocity is 6554, the process image carries 0.1 to 6553.5; change Velocity
        Velocity is NaN, the process image carries 0.1 to 6553.5; change Velocity
        Acceleration is -1, the process image carries 1 to 65535; change Acceleration
        Deceleration is 0.2, the process image carries 1 to 65535; change Deceleration
        Jerk is 3, the process image carries 10 to 655350; change Jerk
        Velocity is 700, the process image carries 0.01 to 655.35; change Velocity
        Tool is 16, the process image carries 0 to 15; change Tool
        Deceleration is given, and the process image has no room for it in this kind of motion (Circular); leave it out
        Jerk is given, and the process image has no room for it in this kind of motion (LinForceCartesian); leave it out
        Configuration is given, and the process image has no room for it in this kind of motion (PtpJoint); leave it out
        ");
    }

    proptest! {
        #[test]
        fn a_motion_of_the_image_read_in_engineering_units_gives_the_same_motion(
            kind in proptest::sample::select(MotionKind::standard().collect::<Vec<_>>()),
            numbers in any::<[u16; 5]>(),
            coordinates in proptest::array::uniform9(-1e6..1e6_f32),
            given in proptest::option::of((0..=7_u8, any::<Option<u8>>())),
            (tool, base) in (0..16_u8, 0..16_u8),
        ) {
            let [velocity, acceleration, approximation, deceleration, jerk] = numbers;
            let [a, b, c, d, e, f, auxiliary @ ..] = coordinates;
            let motion = Motion {
                kind,
                target: [a, b, c, d, e, f],
                auxiliary: if kind.has_auxiliary() { auxiliary } else { [0.0; 3] },
                configuration: given
                    .map(|(status, turn)| Configuration { status, turn })
                    .filter(|_| kind.has_configuration()),
                velocity,
                acceleration,
                deceleration: if kind.has_auxiliary() { 0 } else { deceleration },
                jerk: if kind.has_auxiliary() { 0 } else { jerk },
                approximation,
                tool,
                base,
            };
            prop_assert_eq!(MotionInputs::from(&motion).motion(kind), Ok(motion));
        }
    }
}
