//! Why the robot refuses a skill or stops, as a number in the feedback image.

use core::fmt;

use super::codes;

codes! {
    /// Why a skill was refused or ended early. `error_motion` is the motion that it refers to.
    ErrorNumber: u16 {
        /// No error.
        None = 0,
        /// This robot does not have the skill of this code.
        UnknownSkill = 1,
        /// The motion kind is not one of the standard ones, or the slot is empty.
        UnknownMotionKind = 2,
        /// The motion kind is a standard one, but this robot does not support it.
        MotionKindNotSupported = 3,
        /// A skill was commanded in a state in which no skill can start.
        NotReady = 4,
        /// The program number is not stored in this robot.
        UnknownProgram = 5,
        /// The skill has no motions.
        NoMotions = 6,
        /// `written` is more than five motions ahead, or went backwards: motions were lost.
        QueueOverrun = 7,
        /// The tool number is not defined.
        UnknownTool = 8,
        /// The base number is not defined.
        UnknownBase = 9,
        /// The velocity is 0, or above what the motion kind allows.
        VelocityOutOfRange = 10,
        /// The acceleration is 0, or above what the motion kind allows.
        AccelerationOutOfRange = 11,
        /// The override is above 100 %: no skill starts with it, and a running skill keeps the last valid one.
        OverrideOutOfRange = 12,
        /// A coordinate is not a finite number.
        TargetNotFinite = 13,
        /// The target is out of the arm's reach.
        Unreachable = 14,
        /// A joint would leave its range.
        AxisLimit = 15,
        /// The path passes a singular position.
        Singular = 16,
        /// The connection to the PLC was lost while a skill ran.
        ConnectionLost = 17,
        /// The PLC withdrew `enable` while a skill ran.
        Disabled = 18,
        /// The arm cannot follow a line in the configuration (elbow, wrist) in which it starts.
        ConfigurationChange = 19,
        /// The motion has no length: its target is its start.
        ZeroLength = 20,
        /// Start, intermediate point and target of a circle lie on one line.
        CollinearCircle = 21,
        /// The contact force is 0 or less, not a number, or above what the robot is able to apply.
        ForceOutOfRange = 22,
        /// The contact force does not point along the line.
        ForceDirection = 23,
        /// The arm reached the end of the line without the contact force.
        ForceNotReached = 24,
        /// The next robot cycle would exceed a joint's rated speed; the arm braked instead.
        JointSpeed = 25,
        /// The next robot cycle would exceed a joint's rated acceleration; the arm braked instead.
        JointAcceleration = 26,
        /// The next robot cycle would exceed a joint's rated jerk; the arm braked instead.
        JointJerk = 27,
        /// The arm cannot have the configuration of the motion at its target.
        ConfigurationMismatch = 28,
        /// The deceleration is above what the motion kind allows.
        DecelerationOutOfRange = 29,
        /// The jerk is above what the motion kind allows.
        JerkOutOfRange = 30,
        /// The checks of the command images are wrong, so that none of them is followed.
        WrongCheck = 31,
        /// The drive of an axis has a fault, such as a following error.
        DriveFault = 32,
        /// The drive of an axis stopped, or took its torque away, without a command and without a fault.
        DriveStopped = 33,
        /// The robot controller lost the connection to its drives.
        DrivesLost = 34,
        /// The motion turns the tool so far on so short a way that at its velocity no wrist could follow.
        TurnTooFast = 35,
        /// The contact force swings about the programmed one: the surface is too stiff for the force controller.
        ForceUnsteady = 36,
        /// A skill of one motion has a `total` or a `written` other than 1.
        NotOneMotion = 37,
        /// The life counters of the command images are refused, so that none of them is followed.
        WrongLifeCounter = 38,
        /// The drive of an axis was too far from its set-points for too long.
        FollowingError = 39,
        /// The drive of an axis did not arrive where its set-points came to rest.
        DriveNotArrived = 40,
        /// The drive of an axis did not switch on after a reset.
        DriveNotOn = 41,
        /// The command asks for something that this robot does not serve: a suspend, a start time.
        NotServed = 42,
        /// The robot does not take compact points.
        CompactNotServed = 43,
        /// The head of the compact points has a resolution, coordinates or a content that it cannot have, or `COMPACT` is not set.
        PointHead = 44,
    }
}

impl fmt::Display for ErrorNumber {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::None => "no error",
            Self::UnknownSkill => "the robot does not have this skill",
            Self::UnknownMotionKind => "the slot is empty or its motion kind is not a standard one",
            Self::MotionKindNotSupported => "this robot does not run this kind of motion",
            Self::NotReady => "no skill can start in this state; reset first",
            Self::UnknownProgram => "the robot has no program of this number",
            Self::NoMotions => "the skill has no motions",
            Self::QueueOverrun => "motions were written over before the robot took them",
            Self::UnknownTool => "the tool number is not defined in the robot",
            Self::UnknownBase => "the base number is not defined in the robot",
            Self::VelocityOutOfRange => "the velocity is zero or above the limit of its motion kind",
            Self::AccelerationOutOfRange => "the acceleration is zero or above the limit of its motion kind",
            Self::OverrideOutOfRange => "the override is not within 0 to 100 %",
            Self::TargetNotFinite => "a coordinate is not a finite number",
            Self::Unreachable => "the target is out of the arm's reach",
            Self::AxisLimit => "a joint would leave its range",
            Self::Singular => "the path passes a singular position",
            Self::ConnectionLost => "the connection to the PLC was lost while the skill ran",
            Self::Disabled => "the PLC took back `enable` while the skill ran",
            Self::ConfigurationChange => "the line needs another configuration of the arm",
            Self::ZeroLength => "the motion's target is where it starts",
            Self::CollinearCircle => "start, intermediate point and target of the circle lie on one line",
            Self::ForceOutOfRange => "the force is zero or above what the robot may press with",
            Self::ForceDirection => "the force does not point along the line",
            Self::ForceNotReached => "an end of the line was reached without the contact force",
            Self::JointSpeed => "a joint would move faster than it is rated for",
            Self::JointAcceleration => "a joint would accelerate faster than it is rated for",
            Self::JointJerk => "a joint would change its acceleration faster than it is rated for",
            Self::ConfigurationMismatch => "the arm cannot have this configuration at the target",
            Self::DecelerationOutOfRange => "the deceleration is above the limit of its motion kind",
            Self::JerkOutOfRange => "the jerk is above the limit of its motion kind",
            Self::WrongCheck => "the checks of the command images are wrong: bytes are altered on the way, or the PLC computes them otherwise",
            Self::DriveFault => "the drive of an axis has a fault",
            Self::DriveStopped => "the drive of an axis stopped without a command",
            Self::DrivesLost => "the robot controller lost the connection to its drives",
            Self::TurnTooFast => "the motion turns the tool too far on its way for its velocity",
            Self::ForceUnsteady => "the contact force swings and does not settle",
            Self::NotOneMotion => "a skill of one motion needs `total` and `written` of 1",
            Self::WrongLifeCounter => "the life counters of the command images are refused: the images are old, or the PLC counts faster than the robot's setup says",
            Self::FollowingError => "following error: an axis was too far from its set-point",
            Self::DriveNotArrived => "an axis did not arrive at its set-point within the settling time",
            Self::DriveNotOn => "the drives did not switch on after a reset",
            Self::NotServed => "the robot does not serve a suspend or a start time",
            Self::CompactNotServed => "the robot does not take compact points",
            Self::PointHead => "the head of the compact points cannot be used",
            Self::Unknown(code) => return write!(f, "error number {code}"),
        })
    }
}
