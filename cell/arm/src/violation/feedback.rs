//! What the feedback image carries of a violation: its number and its figures.

use protocol::image::{ErrorNumber, Finding};

use super::{Count, LEAST_WAY_MM, Rated, SINGULAR_SHARE, TURNED_OVER_DEG, Violation};

impl Violation {
    /// Returns the number that the feedback image carries for it.
    #[must_use]
    pub const fn number(&self) -> ErrorNumber {
        match self {
            Self::Plain(number) => *number,
            Self::NotFinite(_) => ErrorNumber::TargetNotFinite,
            Self::Radius { .. } | Self::WristReach { .. } | Self::WristRadius { .. } | Self::Tilt { .. } => {
                ErrorNumber::Unreachable
            }
            Self::Configuration { .. } => ErrorNumber::ConfigurationChange,
            Self::Status { .. }
            | Self::TurnBits { .. }
            | Self::Turn { .. }
            | Self::OtherConfiguration { .. }
            | Self::NotCartesian(_) => ErrorNumber::ConfigurationMismatch,
            Self::Axis { .. } => ErrorNumber::AxisLimit,
            Self::Rated { rated: Rated::Speed, .. } => ErrorNumber::JointSpeed,
            Self::Rated { rated: Rated::Acceleration, .. } => ErrorNumber::JointAcceleration,
            Self::Rated { rated: Rated::Jerk, .. } => ErrorNumber::JointJerk,
            Self::Singular { .. } => ErrorNumber::Singular,
            Self::TurnTooFast { .. } => ErrorNumber::TurnTooFast,
            Self::ZeroLength { .. } => ErrorNumber::ZeroLength,
            Self::Collinear { .. } => ErrorNumber::CollinearCircle,
            Self::Velocity { .. } => ErrorNumber::VelocityOutOfRange,
            Self::Acceleration { .. } => ErrorNumber::AccelerationOutOfRange,
            Self::Deceleration { .. } => ErrorNumber::DecelerationOutOfRange,
            Self::Jerk { .. } => ErrorNumber::JerkOutOfRange,
            Self::Approach { .. } => ErrorNumber::VelocityOutOfRange,
            Self::Tool(_) => ErrorNumber::UnknownTool,
            Self::Base(_) => ErrorNumber::UnknownBase,
            Self::Kind(_) => ErrorNumber::UnknownMotionKind,
            Self::Override { .. } => ErrorNumber::OverrideOutOfRange,
            Self::NotOneMotion { .. } => ErrorNumber::NotOneMotion,
            Self::PointHead(_) => ErrorNumber::PointHead,
            Self::Force { .. } => ErrorNumber::ForceOutOfRange,
            Self::ForceDirection { .. } => ErrorNumber::ForceDirection,
            Self::ForceNotReached { .. } => ErrorNumber::ForceNotReached,
            Self::ForceUnsteady { .. } => ErrorNumber::ForceUnsteady,
        }
    }

    /// Returns the figures that the feedback image carries for it.
    #[must_use]
    pub fn finding(&self) -> Finding {
        let finding = |index: u8, value: f64, lower: f64, upper: f64| {
            Finding::new(index, value as f32, lower as f32, upper as f32)
        };
        match *self {
            Self::Plain(_) => Finding::NONE,
            Self::PointHead(finding) => finding,
            Self::NotFinite(index) | Self::Tool(index) | Self::Base(index) | Self::Kind(index) => {
                finding(index, f64::from(index), 0.0, 0.0)
            }
            Self::Radius { radius_mm, nearest_mm, farthest_mm } => {
                finding(1, radius_mm, nearest_mm, farthest_mm)
            }
            Self::WristReach { distance_mm, nearest_mm, farthest_mm } => {
                finding(2, distance_mm, nearest_mm, farthest_mm)
            }
            Self::WristRadius { distance_mm, nearest_mm } => {
                finding(1, distance_mm, nearest_mm, f64::INFINITY)
            }
            Self::Tilt { tilt_deg } => finding(3, tilt_deg, 0.0, 0.0),
            Self::Configuration { axis, turn_deg, .. } => finding(axis, turn_deg, 0.0, TURNED_OVER_DEG),
            Self::Axis { axis, value, lower, upper, .. } | Self::Turn { axis, value, lower, upper } => {
                finding(axis, value, lower, upper)
            }
            Self::Status { status, bits } => finding(7, status.into(), 0.0, bits.into()),
            Self::TurnBits { turn, bits } => finding(8, turn.into(), 0.0, bits.into()),
            Self::OtherConfiguration { wanted, found } if wanted.status != found.status => {
                finding(9, found.status.into(), wanted.status.into(), wanted.status.into())
            }
            Self::OtherConfiguration { wanted, found } => {
                let [wanted, found] = [wanted, found].map(|it| it.turn.unwrap_or(0).into());
                finding(10, found, wanted, wanted)
            }
            Self::NotCartesian(_) => finding(11, 0.0, 0.0, 0.0),
            Self::Rated { axis, value, limit, .. } => finding(axis, value, 0.0, limit),
            Self::Singular { axis, share } => finding(axis, share, SINGULAR_SHARE, 1.0),
            Self::TurnTooFast { axis, turn_deg, way_mm, speed_mm_s, rated_deg_s, .. } => {
                finding(axis, speed_mm_s * turn_deg / way_mm, 0.0, rated_deg_s)
            }
            Self::ZeroLength { way_mm } => finding(0, way_mm, LEAST_WAY_MM, f64::INFINITY),
            Self::Collinear { offset_mm, least_mm } => finding(0, offset_mm, least_mm, f64::INFINITY),
            Self::Velocity { value, limit }
            | Self::Acceleration { value, limit }
            | Self::Deceleration { value, limit }
            | Self::Jerk { value, limit }
            | Self::Approach { value, limit, .. }
            | Self::Force { value_n: value, limit_n: limit } => finding(0, value, 0.0, limit),
            Self::Override { percent } => finding(0, percent.into(), 0.0, 100.0),
            Self::NotOneMotion { field, value } => {
                let index = match field {
                    Count::Total => 1,
                    Count::Written => 2,
                };
                finding(index, value.into(), 1.0, 1.0)
            }
            Self::ForceDirection { angle_deg, limit_deg } => finding(0, angle_deg, 0.0, limit_deg),
            Self::ForceNotReached { found_n, wanted_n, way_mm } => finding(0, found_n, wanted_n, way_mm),
            Self::ForceUnsteady { highest_n, wanted_n, stiffness_n_per_mm } => {
                finding(0, highest_n, wanted_n, stiffness_n_per_mm)
            }
        }
    }
}
