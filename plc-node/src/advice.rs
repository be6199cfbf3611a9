//! What a person does about an error number of the robot.

use protocol::image::ErrorNumber;

/// Returns what to do about an error of the robot; `None` if its motion is to be corrected.
pub(crate) const fn advice(number: ErrorNumber) -> Option<&'static str> {
    Some(match number {
        ErrorNumber::None => "look at the robot's node",
        ErrorNumber::UnknownSkill => "use skills that this robot has",
        ErrorNumber::NotReady => "start again when the robot is ready",
        ErrorNumber::UnknownProgram => "store the program in the robot, or run sm or cm",
        ErrorNumber::NoMotions => "give the application motions",
        ErrorNumber::QueueOverrun => "look at how the PLC writes motions into the slots",
        ErrorNumber::NotOneMotion => "write 1 to `total` and `written` in the scan that calls the skill",
        ErrorNumber::OverrideOutOfRange => "set an override of 0 to 100 %",
        ErrorNumber::ConnectionLost => {
            "look at the cable and at the robot's log, and start again once the connection is up"
        }
        ErrorNumber::Disabled => "enable the robot first and keep it enabled while a skill runs",
        ErrorNumber::WrongCheck => "look at cables, switches and gateways, and at the PLC's check",
        ErrorNumber::WrongLifeCounter => {
            "add 1 to the life counter in each scan, and set `plc.scan_cycle_us` of the robot's setup to the PLC's scan"
        }
        ErrorNumber::DriveFault
        | ErrorNumber::DriveStopped
        | ErrorNumber::DrivesLost
        | ErrorNumber::DriveNotOn => "see to the robot's drives",
        ErrorNumber::CompactNotServed => "set robot.compact_points, or send the motions by MoveContinuous",
        ErrorNumber::PointHead => "correct the head of the compact points",
        ErrorNumber::NotServed => "leave out the start time, and do not suspend this robot",
        ErrorNumber::FollowingError | ErrorNumber::DriveNotArrived => {
            "look for what holds the axis, reset, and start again"
        }
        ErrorNumber::ForceUnsteady => {
            "set the robot's force controller for this surface (`stiffest_n_per_mm`), or press on a softer one"
        }
        ErrorNumber::Unknown(_) => "look the number up in the robot's manual",
        ErrorNumber::UnknownMotionKind
        | ErrorNumber::MotionKindNotSupported
        | ErrorNumber::UnknownTool
        | ErrorNumber::UnknownBase
        | ErrorNumber::VelocityOutOfRange
        | ErrorNumber::AccelerationOutOfRange
        | ErrorNumber::TargetNotFinite
        | ErrorNumber::Unreachable
        | ErrorNumber::AxisLimit
        | ErrorNumber::Singular
        | ErrorNumber::ConfigurationChange
        | ErrorNumber::ZeroLength
        | ErrorNumber::CollinearCircle
        | ErrorNumber::ForceOutOfRange
        | ErrorNumber::ForceDirection
        | ErrorNumber::ForceNotReached
        | ErrorNumber::JointSpeed
        | ErrorNumber::JointAcceleration
        | ErrorNumber::JointJerk
        | ErrorNumber::ConfigurationMismatch
        | ErrorNumber::DecelerationOutOfRange
        | ErrorNumber::JerkOutOfRange
        | ErrorNumber::TurnTooFast => return None,
    })
}
