//! Corners of a SCARA: their zones, their limits and their speeds.

use std::sync::Arc as Shared;

use protocol::image::{Motion, MotionKind};

use super::super::segment::{Programmed, Robot};
use super::approach::ZONE_ACCURACY;
use super::*;
use crate::{AXES, AxisLimits, Frames, Scara};

pub(in super::super) fn arm() -> Arm {
    let limits = AxisLimits {
        lower: [-170.0, -145.0, 0.0, -720.0, 0.0, 0.0],
        upper: [170.0, 145.0, 200.0, 720.0, 0.0, 0.0],
        speed: [400.0, 450.0, 1_000.0, 900.0, 1.0, 1.0],
        acceleration: [3_000.0, 3_500.0, 8_000.0, 9_000.0, 1.0, 1.0],
        jerk: [60_000.0, 70_000.0, 160_000.0, 180_000.0, 1.0, 1.0],
    };
    Arm::new(Shared::new(Scara { link_1_mm: 225.0, link_2_mm: 275.0, height_mm: 0.0 }), limits)
}

/// Prepares motions one after the other, from the middle of the arm's reach.
pub(in super::super) fn prepared(motions: &[Motion]) -> Vec<Segment> {
    try_to_prepare(motions).expect("the arm can run them")
}

fn try_to_prepare(motions: &[Motion]) -> Result<Vec<Segment>, Violation> {
    let arm = arm();
    let mut frames: Frames = [None; 16];
    frames[0] = Some(Frame::IDENTITY);
    let most = Programmed { speed: 2_000.0, acceleration: 10_000.0, deceleration: 10_000.0, jerk: 200_000.0 };
    let robot = Robot { arm: &arm, tools: &frames, bases: &frames, most, presses: false };
    let start = Frame::from_mm_deg([300.0, -150.0, 100.0, 0.0, 0.0, 180.0]);
    let mut joints = arm.inverse(&start, &[0.0; AXES])?;
    let prepare = |motion: &Motion| {
        let segment = Segment::prepare(motion, &joints, robot)?;
        joints = segment.end;
        Ok(segment)
    };
    motions.iter().map(prepare).collect()
}

pub(in super::super) fn motion(kind: MotionKind, [x, y]: [f32; 2], approximation_mm: u16) -> Motion {
    let is_point_to_point = kind.is_point_to_point();
    Motion {
        kind,
        target: [x, y, 100.0, 0.0, 0.0, 180.0],
        velocity: if is_point_to_point { 6_000 } else { 3_000 },
        acceleration: if is_point_to_point { 10_000 } else { 2_000 },
        approximation: 100 * approximation_mm,
        ..Motion::EMPTY
    }
}

/// Pairs of motions with a corner between them.
fn corners() -> Vec<[Segment; 2]> {
    let lin = |target, zone| motion(MotionKind::LinCartesian, target, zone);
    let ptp = |target, zone| motion(MotionKind::PtpCartesian, target, zone);
    let slow = |motion: Motion| Motion {
        velocity: motion.velocity / 3,
        deceleration: motion.acceleration / 2,
        ..motion
    };
    let circle =
        Motion { auxiliary: [330.0, 60.0, 100.0], ..motion(MotionKind::Circular, [280.0, 150.0], 20) };
    let (near, far) = ([380.0, 0.0], [280.0, 180.0]);
    [
        [lin(near, 30), lin(far, 0)],
        [slow(lin(near, 20)), lin(far, 0)],
        [lin(near, 25), slow(lin(far, 0))],
        [ptp(near, 30), ptp(far, 0)],
        [ptp(near, 15), slow(ptp(far, 0))],
        [lin(near, 30), ptp(far, 0)],
        [ptp(near, 30), lin(far, 0)],
        [lin(near, 12), circle],
        [circle, lin(near, 0)],
    ]
    .map(|motions| <[Segment; 2]>::try_from(prepared(&motions)).expect("two of them"))
    .to_vec()
}

#[test]
fn a_zone_reaches_as_far_from_the_corner_as_is_asked() {
    let arm = arm();
    for [first, second] in corners() {
        for (segment, end) in
            [(&first, End::First), (&first, End::Last), (&second, End::First), (&second, End::Last)]
        {
            let approach = Approach::new(segment, end, &arm);
            for distance_mm in [0.05, 0.9, 4.0, 17.0, 30.0, 55.0] {
                let zone = approach.zone(distance_mm);
                let reached = approach.distance_at(zone);
                assert!(reached <= distance_mm * (1.0 + 1e-9), "{reached} for {distance_mm} mm");
                let least = (distance_mm * (1.0 - ZONE_ACCURACY)).min(approach.half_mm);
                assert!(
                    reached >= least * (1.0 - 1e-9),
                    "{reached} for {distance_mm} mm of {}",
                    approach.half_mm
                );
            }
            assert_eq!(approach.zone(1e6), approach.half, "half of it at most");
        }
        let distance_mm = first.approximation_mm;
        assert_eq!(wanted_zone(&first, &arm), Approach::new(&first, End::Last, &arm).zone(distance_mm));
        assert_eq!(entering_zone(&second, 9.0, &arm), Approach::new(&second, End::First, &arm).zone(9.0));
    }
}

#[test]
fn the_limits_of_a_corner_are_the_lower_ones_of_both_motions_with_the_reserve() {
    let arm = arm();
    let near = |one: f64, other: f64| one == other || (one - other).abs() <= 1e-9 * other.abs();
    for [first, second] in corners() {
        let found = both(&first, &second, &arm);
        let [one, other] = [&first.ratings, &second.ratings];
        let rated = arm.limits();
        for axis in 0..AXES {
            let reserved = AXIS_RESERVE * rated.acceleration[axis];
            let least = one.acceleration[axis].min(other.acceleration[axis]).min(reserved);
            assert!(near(found.acceleration[axis], least), "acceleration of {axis}");
            let least = one.jerk()[axis].min(other.jerk()[axis]).min(AXIS_RESERVE * rated.jerk[axis]);
            assert!(near(found.jerk()[axis], least), "jerk of {axis}");
            assert!(near(found.speed[axis], AXIS_SPEED_RESERVE * rated.speed[axis]), "speed of {axis}");
            let slows = one.joints_slow()[axis].min(other.joints_slow()[axis]).min(reserved);
            assert!(found.joints_slow()[axis] <= slows * (1.0 + 1e-9), "deceleration of {axis}");
        }
        let slows = |ratings: &Ratings| ratings.tool_acceleration * ratings.tool_deceleration;
        assert!(near(found.tool_acceleration, one.tool_acceleration.min(other.tool_acceleration)));
        assert!(near(slows(&found), slows(one).min(slows(other))), "deceleration of the tool");
    }
}

#[test]
fn in_a_corner_neither_a_motion_nor_the_tool_nor_a_joint_is_faster_than_programmed() {
    let arm = arm();
    for [first, second] in corners() {
        let blend = Blend::between(&first, &second, 1.0, &arm).expect("a corner");
        let [one, other] = [&first, &second].map(Segment::programmed_speed);
        assert_eq!(blend.nodes.first().map(|node| node.way), Some(0.0));
        for node in blend.nodes.iter() {
            let way = |share: f64| {
                let (from, to) = blend.ways_at(&first, share);
                [from, to]
            };
            let step = 1e-6;
            let (before, after) = (way((node.way - step).max(0.0)), way((node.way + step).min(1.0)));
            let width = (node.way + step).min(1.0) - (node.way - step).max(0.0);
            for (i, speed) in [one, other].into_iter().enumerate() {
                let share = node.programmed * (after[i] - before[i]) / width / speed;
                assert!(share < 1.0 + 1e-4, "{share} of the speed of motion {i} at {}", node.way);
            }
            let leads_tool = [&first, &second].map(|segment| segment.ratings.leads_tool());
            if leads_tool == [true; 2] {
                let tool = node.programmed * node.tool_slope(&blend.ratings);
                assert!(tool <= one.max(other) * (1.0 + 1e-5), "{tool} mm/s at {}", node.way);
            } else if leads_tool == [false; 2] {
                let most = first.programmed.speed.max(second.programmed.speed);
                let share = node.programmed / node.speed_of_joints(&blend.ratings);
                assert!(
                    share <= most * BETWEEN_NODES * (1.0 + 1e-6),
                    "{share} of a joint's speed at {}",
                    node.way
                );
            }
        }
        // At both ends it is as fast as the motions beside it.
        let ends = [
            (blend.nodes[0], one, blend.from_zone),
            (blend.nodes[blend.nodes.len() - 1], other, blend.to_zone),
        ];
        for (node, speed, zone) in ends {
            let share = node.programmed * BORDER_SLOPE * zone / speed;
            assert!((0.95..1.00001).contains(&share), "{share} of the speed at {}", node.way);
        }
    }
}

#[test]
fn where_the_tool_turns_back_the_rate_of_a_corner_is_at_most_twice_that_at_its_faster_end() {
    let arm = arm();
    let lin = |target, zone, velocity| Motion { velocity, ..motion(MotionKind::LinCartesian, target, zone) };
    for [one, other] in [[3_000, 1_000], [1_000, 3_000], [2_000, 2_000]] {
        let motions = prepared(&[lin([380.0, 0.0], 20, one), lin([301.0, -140.0], 0, other)]);
        let [first, second] = <[Segment; 2]>::try_from(motions).expect("two of them");
        let blend = Blend::between(&first, &second, 1.0, &arm).expect("a corner");
        let rate = |segment: &Segment, zone: f64| segment.programmed_speed() / (BORDER_SLOPE * zone);
        let most = 2.0 * rate(&first, blend.from_zone).max(rate(&second, blend.to_zone));
        let highest = blend.nodes.iter().map(|node| node.programmed).fold(0.0, f64::max);
        assert!(highest <= most * (1.0 + 1e-9), "{highest} of {most} per s");
    }
}

/// Pairs of lines and other motions between many targets.
fn many_corners() -> Vec<[Segment; 2]> {
    let mut corners = Vec::new();
    for number in 0..240_u16 {
        let place = |step: u16| {
            let angle = f64::from((number * step) % 97) * 1.6 - 75.0;
            let reach = 190.0 + f64::from((number * (step + 4)) % 89) * 3.2;
            let (sin, cos) = libm::sincos(angle.to_radians());
            [(reach * cos) as f32, (reach * sin) as f32]
        };
        let kinds = [MotionKind::LinCartesian, MotionKind::PtpCartesian];
        let motions = [
            motion(kinds[usize::from(number % 3 == 2)], place(7), 150),
            motion(kinds[usize::from(number % 5 == 4)], place(11), 0),
        ];
        let found = try_to_prepare(&motions).ok();
        corners.extend(found.and_then(|found| <[Segment; 2]>::try_from(found).ok()));
    }
    corners
}

#[test]
fn the_nodes_of_a_corner_have_the_derivatives_of_its_joints_from_its_start_to_its_end() {
    let (arm, mut cut, mut found) = (arm(), 0, 0);
    for [first, second] in many_corners() {
        let Some(blend) = Blend::between(&first, &second, 1.0, &arm) else { continue };
        found += 1;
        let nodes = &blend.nodes;
        cut += usize::from(nodes.len() > POINT_SHARES.len() || nodes.len() < POINT_SHARES.len());
        assert_eq!((nodes[0].way, nodes[nodes.len() - 1].way), (0.0, 1.0));
        assert!(nodes.windows(2).all(|pair| pair[0].way < pair[1].way && pair[1].way - pair[0].way < 0.2));
        let mut near = first.curve.joints(first.curve.length() - blend.from_zone, &arm, &first.end).unwrap();
        for node in nodes.iter() {
            near = blend.joints(&first, &second, node.way, &arm, &near).unwrap();
            let step = 1e-3;
            if node.way < step || node.way > 1.0 - step {
                continue;
            }
            let [before, after] = [-step, step]
                .map(|step| blend.joints(&first, &second, node.way + step, &arm, &near).unwrap());
            for axis in 0..arm.axes() {
                let slope = f64::from(node.slope[axis]) * blend.ratings.acceleration[axis];
                let off = (slope - (after[axis] - before[axis]) / (2.0 * step)).abs();
                // By the rate that the joints allow here.
                let share = off * node.programmed.min(node.highest.sqrt()) / arm.limits().speed[axis];
                assert!(share < 0.03, "{share} of the speed of axis {axis} at {}", node.way);
            }
        }
    }
    assert!(found > 200 && cut > 10, "{found} corners, and {cut} with more than one piece");
}

#[test]
fn a_corner_stays_within_its_distance_which_is_that_of_both_motions_or_a_little_less() {
    let arm = arm();
    for [first, second] in many_corners() {
        let stopped = Segment { approximation_mm: 0.0, ..first.clone() };
        assert_eq!(Blend::between(&stopped, &second, 1.0, &arm), None, "an exact stop has no corner");
        let Some(blend) = Blend::between(&first, &second, 1.0, &arm) else { continue };
        let (leaving, entering) =
            (Approach::new(&first, End::Last, &arm), Approach::new(&second, End::First, &arm));
        let allowed = first.approximation_mm.min(leaving.half_mm).min(entering.half_mm);
        let tries = (0..4).map(|tries| (0..tries).fold(allowed, |distance, _| 0.9 * distance));
        let is_tried = tries.into_iter().any(|distance| (distance - blend.distance_mm).abs() < 1e-9);
        assert!(is_tried, "{} of {allowed} mm", blend.distance_mm);
        let corner = first.tool_at(&first.end, &arm);
        let mut near = first.curve.joints(first.curve.length() - blend.from_zone, &arm, &first.end).unwrap();
        for step in 0..=100 {
            near = blend.joints(&first, &second, f64::from(step) / 100.0, &arm, &near).unwrap();
            let off = distance(first.tool_at(&near, &arm), corner);
            assert!(off <= blend.distance_mm * 1.01 + 1e-6, "{off} of {} mm", blend.distance_mm);
        }
    }
}
