//! Motions of a SCARA that are ready to run.

use std::sync::Arc as Shared;

use super::super::blend::tests::{arm, motion, prepared};
use super::*;
use crate::{AxisLimits, Scara};

const CYCLE_S: f64 = 0.004;

fn lin(target: [f32; 2]) -> Motion {
    motion(MotionKind::LinCartesian, target, 0)
}

#[test]
fn point_to_point_half_of_the_way_may_belong_to_a_corner_and_the_programmed_speed_is_the_limit() {
    let [segment] =
        <[Segment; 1]>::try_from(prepared(&[motion(MotionKind::PtpCartesian, [380.0, 0.0], 0)])).unwrap();
    assert_eq!(segment.zones, [0.5; 2]);
    assert_eq!(segment.ratings.speed, [f64::INFINITY; AXES]);
    assert_eq!(segment.programmed_share(), 0.6);
    // The slowest joint has its share of its speed.
    let Curve::Axes(axes) = segment.curve else { panic!("{:?}", segment.curve) };
    let speeds = axes.way().map(|way| way.abs() * segment.programmed_speed());
    let rated = arm().limits().speed;
    let shares = speeds.iter().zip(&rated).map(|(speed, rated)| speed / rated);
    assert!((shares.fold(0.0, f64::max) - 0.6).abs() < 1e-9);
    let [line] = <[Segment; 1]>::try_from(prepared(&[lin([380.0, 0.0])])).unwrap();
    assert_eq!(line.programmed_share(), 1.0);
}

/// The same arm with this jerk of its joints.
fn arm_with(jerk: f64) -> Arm {
    let limits = AxisLimits { jerk: [jerk; AXES], ..*arm().limits() };
    Arm::new(Shared::new(Scara { link_1_mm: 225.0, link_2_mm: 275.0, height_mm: 0.0 }), limits)
}

#[test]
fn lines_are_driven_as_one_while_no_joint_notices_the_bend_within_a_cycle() {
    for (last, velocity) in [([419.999_95, 140.0], 3_000), ([419.999_95, 140.0], 8_000)] {
        let motions = [lin([380.0, 0.0]), lin(last)].map(|motion| Motion { velocity, ..motion });
        let motions = [
            Motion { target: [340.0, -140.0, 100.0, 0.0, 0.0, 180.0], ..motions[0] },
            motions[0],
            motions[1],
        ];
        let [_, first, second] = <[Segment; 3]>::try_from(prepared(&motions)).unwrap();
        let (Curve::Line(one), Curve::Line(next)) = (&first.curve, &second.curve) else { panic!("lines") };
        assert!(one.goes_on_to(next));
        let way = (f64::from(velocity) / 10.0 * CYCLE_S).min(second.curve.length()).min(first.curve.length());
        let at = |tool: Frame| {
            arm().inverse(&first.curve.flange().unwrap().when_tool_at(tool), &first.end).unwrap()
        };
        let (straight, on) = (at(one.tool(first.curve.length() + way)), at(next.tool(way)));
        let most = straight.iter().zip(&on).map(|(one, other)| (one - other).abs()).fold(0.0, f64::max);
        let border = most / (UNNOTICED * CYCLE_S * CYCLE_S * CYCLE_S);
        assert!(first.goes_straight_on_to(&second, &arm_with(1.001 * border), CYCLE_S), "{border}");
        assert!(!first.goes_straight_on_to(&second, &arm_with(0.999 * border), CYCLE_S), "{border}");
    }
}

#[test]
fn a_spline_takes_its_shape_from_the_motion_before_and_needs_a_way() {
    let spline = |target| motion(MotionKind::Spline, target, 0);
    let [before] = <[Segment; 1]>::try_from(prepared(&[spline([360.0, -50.0])])).unwrap();
    let arm = arm();
    let mut frames: Frames = [None; 16];
    frames[0] = Some(Frame::IDENTITY);
    let most = Programmed { speed: 2_000.0, acceleration: 10_000.0, deceleration: 10_000.0, jerk: 200_000.0 };
    let robot = Robot { arm: &arm, tools: &frames, bases: &frames, most, presses: false };
    let next = spline([330.0, 80.0]);
    let bent = Segment::prepare_after(Some(&before), &next, &before.end, robot).unwrap();
    let alone = Segment::prepare(&next, &before.end, robot).unwrap();
    let shape = |segment: &Segment| match segment.curve {
        Curve::Spline(spline) => spline.before(),
        _ => None,
    };
    assert!(shape(&bent).is_some() && shape(&alone).is_none());
    assert!(Segment::curve_of(&next, &before.end, robot).unwrap().is_some());
    let ptp = motion(MotionKind::PtpCartesian, [330.0, 80.0], 0);
    assert_eq!(Segment::curve_of(&ptp, &before.end, robot), Ok(None));
    // It only turns.
    let turned = Motion { target: [360.0, -50.0, 100.0, 30.0, 0.0, 180.0], ..next };
    let refused = Segment::prepare(&turned, &before.end, robot).unwrap_err();
    assert!(matches!(refused, Violation::ZeroLength { .. }), "{refused:?}");
}
