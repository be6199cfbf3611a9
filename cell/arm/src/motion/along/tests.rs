//! The nodes of curves of a SCARA against differences, and when a piece is described well enough.

use std::sync::Arc as Shared;

use super::super::arc::Arc;
use super::super::curve::Line;
use super::super::flange::Flange;
use super::super::spline::Spline;
use super::*;
use crate::{AXES, AxisLimits, Frame, Scara};

const ACCELERATION: f64 = 2_000.0;
const JERK: f64 = 60_000.0;

fn arm() -> Arm {
    let limits = AxisLimits {
        lower: [-179.0, -165.0, 0.0, -720.0, 0.0, 0.0],
        upper: [179.0, 165.0, 200.0, 720.0, 0.0, 0.0],
        speed: [400.0; AXES],
        acceleration: [3_000.0; AXES],
        jerk: [60_000.0; AXES],
    };
    Arm::new(Shared::new(Scara { link_1_mm: 225.0, link_2_mm: 275.0, height_mm: 0.0 }), limits)
}

fn at([x, y]: [f64; 2]) -> Frame {
    Frame::from_mm_deg([x, y, 100.0, 0.0, 0.0, 180.0])
}

fn line(from: [f64; 2], to: [f64; 2]) -> Curve {
    Curve::Line(Line::new(at(from), at(to), Flange::of_tool(&Frame::IDENTITY)))
}

fn spline(targets: [[f64; 2]; 4]) -> Curve {
    let [before, from, to, after] = targets.map(at);
    let spline = Spline::new(from, to, Flange::of_tool(&Frame::IDENTITY));
    Curve::Spline(spline.with_neighbours(Some(before), Some(after)))
}

fn ratings(arm: &Arm) -> Ratings {
    Ratings::of_axes(arm.limits(), 1.0, AXIS_RESERVE).with_tool(ACCELERATION, JERK, TOOL_RESERVE)
}

fn start(curve: &Curve, arm: &Arm) -> Joints {
    let (tools, _) = curve.tools(&[0.0]).expect("the tool is led");
    arm.inverse(&tools[0], &[0.0; AXES]).expect("the arm reaches the start")
}

fn followed(curve: &Curve, arm: &Arm) -> Followed {
    along(curve, &start(curve, arm), 200.0, [ACCELERATION, JERK], &ratings(arm), arm)
        .expect("the arm can follow it")
}

/// First, second and third derivative of figures by the way.
fn differences<const N: usize>(way: f64, step: f64, figures: impl Fn(f64) -> [f64; N]) -> [[f64; N]; 3] {
    let [a, b, c, d, e] = [-2.0, -1.0, 0.0, 1.0, 2.0].map(|steps| figures(way + steps * step));
    [
        core::array::from_fn(|i| (d[i] - b[i]) / (2.0 * step)),
        core::array::from_fn(|i| (d[i] - 2.0 * c[i] + b[i]) / (step * step)),
        core::array::from_fn(|i| (e[i] - 2.0 * d[i] + 2.0 * b[i] - a[i]) / (2.0 * step * step * step)),
    ]
}

#[test]
fn nodes_have_the_derivatives_of_joints_and_tool() {
    let arm = arm();
    let curves = [
        line([350.0, -200.0], [300.0, 220.0]),
        line([190.0, -250.0], [180.0, 300.0]),
        // Close by the base two samples are more than 75 degrees apart.
        line([100.0, -460.0], [100.0, 460.0]),
        spline([[250.0, -250.0], [300.0, -150.0], [380.0, 20.0], [250.0, 200.0]]),
    ];
    for curve in curves {
        let (found, whole) = (followed(&curve, &arm), curve.length());
        let near = |way: f64| {
            // Step by step, so that the configuration stays.
            (1..=40).fold(start(&curve, &arm), |near, part| {
                curve.joints(way * f64::from(part) / 40.0, &arm, &near).expect("the arm reaches it")
            })
        };
        assert_eq!((found.nodes[0].way, found.nodes[found.nodes.len() - 1].way), (0.0, whole));
        assert!(distance(arm.forward(&found.end).position, curve.position(whole).unwrap()) < 1e-6);
        let (speed, most) = (200.0, [0, 1, 2].map(|order| [2e-3, 6e-3, 4e-2][order]));
        for node in found.nodes.iter().filter(|node| node.way > 2.0 && node.way < whole - 2.0) {
            let here = near(node.way);
            let joints = |way: f64| curve.joints(way, &arm, &here).expect("the arm reaches it");
            let found = [node.slope, node.bend, node.twist];
            for (order, (found, expected)) in found.iter().zip(differences(node.way, 0.5, joints)).enumerate()
            {
                let by = [speed, speed * speed, speed * speed * speed / 20.0][order];
                for axis in 0..arm.axes() {
                    let off = f64::from(found[axis]) * ratings(&arm).acceleration[axis] - expected[axis];
                    let share = off.abs() * by / [400.0, 3_000.0, 3_000.0][order];
                    assert!(
                        share < most[order],
                        "{share} of the limit at {} of {whole}, order {order}",
                        node.way
                    );
                }
            }
            let tool = |way: f64| curve.position(way).expect("the tool is led");
            for (order, (found, expected)) in
                node.tool.iter().zip(differences(node.way, 0.5, tool)).enumerate()
            {
                let found = found.map(|part| f64::from(part) * ratings(&arm).tool_acceleration);
                // Of a line only the size counts.
                let off = match curve {
                    Curve::Line(_) => (length(found) - length(expected)).abs(),
                    _ => distance(found, expected),
                };
                assert!(off < [1e-3, 1e-3, 2e-3][order], "{off} at {} of {whole}, order {order}", node.way);
            }
        }
    }
}

#[test]
fn a_corner_may_replace_a_half_or_as_much_as_turns_no_joint_too_far() {
    let arm = arm();
    let curve = line([350.0, -200.0], [300.0, 220.0]);
    let half = curve.length() / 2.0;
    assert_eq!(followed(&curve, &arm).zones, [half, half]);
    // Along the base a joint turns far; at both ends hardly.
    let (from, joints) = ([0.0; AXES], |turn: f64| [turn, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let zone = |trail: &[(f64, f64)]| {
        let trail: Vec<(f64, Joints)> = trail.iter().map(|(way, turn)| (*way, joints(*turn))).collect();
        unambiguous(&from, trail.iter().map(|(way, joints)| (*way, joints)), 10.0, &arm)
    };
    assert_eq!(zone(&[(0.0, 0.0), (4.0, 150.0), (8.0, 151.0)]), 4.0);
    assert_eq!(zone(&[(0.0, 0.0), (4.0, -150.0), (8.0, -151.0), (12.0, 0.0)]), 4.0);
    assert_eq!(zone(&[(0.0, 0.0), (4.0, 90.0), (10.0, 100.0), (11.0, 170.0)]), 10.0);
    assert_eq!(zone(&[(0.0, 0.0), (4.0, 90.0), (11.0, 170.0)]), 4.0);
}

#[test]
fn on_a_circle_around_the_base_both_zones_end_where_the_first_joint_has_turned_too_far() {
    let arm = arm();
    let on_circle = |angle: f64| {
        let (sin, cos) = libm::sincos(angle.to_radians());
        Frame::from_mm_deg([480.0 * cos, 480.0 * sin, 100.0, 0.0, 0.0, 180.0])
    };
    let [from, through, to] = [-155.0, 5.0, 155.0].map(on_circle);
    let flange = Flange::of_tool(&Frame::IDENTITY);
    let curve = Curve::Arc(Arc::new(from, through.position, to, flange).expect("a circle"));
    let near = [-155.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let start = arm.inverse(&from, &near).expect("the arm reaches the start");
    let found = along(&curve, &start, 200.0, [ACCELERATION, JERK], &ratings(&arm), &arm)
        .expect("the arm can follow it");
    let free = curve.length() * UNAMBIGUOUS_DEG / 310.0;
    for zone in found.zones {
        assert!((0.85 * free..=free).contains(&zone), "{zone} of {free} mm");
    }
}

#[test]
fn a_singular_position_is_told_with_the_least_share_of_the_speed_that_it_leaves() {
    let arm = arm();
    // The arm is nearly stretched, and more so at the one end.
    let shares = [[499.98, 499.999], [499.999, 499.98]].map(|[begin, end]| {
        let curve = line([begin, 0.0], [end, 0.0]);
        let found = along(&curve, &start(&curve, &arm), 300.0, [ACCELERATION, JERK], &ratings(&arm), &arm);
        let Err(Violation::Singular { axis: 2, share }) = found else { panic!("{found:?}") };
        share
    });
    // Toward that end the first piece that leaves too little counts.
    assert!(
        (0.002..0.005).contains(&shares[0]) && (1e-4..5e-4).contains(&shares[1]),
        "{shares:?} of the speed"
    );
}

#[test]
fn a_line_of_a_hundredth_of_a_millimetre_is_not_taken_for_a_singular_position() {
    let arm = arm();
    for length_mm in [0.01, 0.03, 0.1] {
        for turn in 0..20 {
            let (sin, cos) = libm::sincos(f64::from(turn));
            let curve = line([300.0, 80.0], [300.0 + length_mm * cos, 80.0 + length_mm * sin]);
            let limits = [ACCELERATION, JERK];
            let found = along(&curve, &start(&curve, &arm), 2_000.0, limits, &ratings(&arm), &arm).unwrap();
            // A longer line there has joints that follow at the same speed.
            let least = found.nodes.iter().map(|node| node.highest).fold(f64::INFINITY, f64::min);
            assert!(least.sqrt() > 100.0, "{length_mm} mm towards {turn}: {} mm/s", least.sqrt());
        }
    }
}

#[test]
fn pieces_that_double_come_to_the_end() {
    assert_eq!(pieces_to_end(1.0, 1.0), 1);
    assert_eq!(pieces_to_end(0.5, 1.0), 2);
    assert_eq!(pieces_to_end(0.25, 0.75), 2);
    assert_eq!(pieces_to_end(0.125, 1.0), 4);
    assert_eq!(pieces_to_end(0.5, 0.0), 0);
}

#[test]
fn a_turn_of_the_tool_alone_that_is_too_fast_is_told_with_the_speed_that_is_not() {
    let arm = arm();
    let turned = Frame::from_mm_deg([310.0, 0.0, 100.0, 90.0, 0.0, 180.0]);
    let curve = Curve::Line(Line::new(at([300.0, 0.0]), turned, Flange::of_tool(&Frame::IDENTITY)));
    assert!((curve.turn_deg() - 90.0).abs() < 1e-9 && (curve.length() - 10.0).abs() < 1e-9);
    // At this speed a joint that turns as the tool has three times the share of a singular position left.
    let border = 400.0 * 10.0 / (TURN_SHARE * 90.0);
    assert_eq!(turn_too_fast(&curve, 0.999 * border, (0.004, 4), &arm), None);
    let found = turn_too_fast(&curve, 1.001 * border, (0.004, 4), &arm);
    let Some(Violation::TurnTooFast { axis: 4, turn_deg, way_mm, speed_mm_s, rated_deg_s, slower_mm_s }) =
        found
    else {
        panic!("{found:?}")
    };
    assert_eq!((turn_deg, way_mm, rated_deg_s), (curve.turn_deg(), curve.length(), 400.0));
    assert_eq!(speed_mm_s, 1.001 * border);
    assert!((slower_mm_s / speed_mm_s - 0.4).abs() < 1e-9, "{slower_mm_s}");
}

#[test]
fn bends_off_is_how_far_the_samples_bends_are_from_those_of_the_curve() {
    let arm = arm();
    let curve = spline([[250.0, -250.0], [300.0, -150.0], [380.0, 20.0], [250.0, 200.0]]);
    let Curve::Spline(piece) = &curve else { panic!("{curve:?}") };
    let (begin, width) = (0.25 * curve.length(), 0.5 * curve.length());
    let (samples, ..) =
        sampled(&curve, &start(&curve, &arm), begin, width, &arm).expect("the arm can follow it");
    let mut found = Derivatives::NONE;
    found.find(&samples, width, arm.axes(), Some(0));
    let off = bends_off(&curve, &found, begin, width);
    let bends = [0.0, 0.5, 1.0].map(|share| length(piece.bends(&[begin + share * width])[0]));
    let most = bends.into_iter().fold(0.0, f64::max);
    assert!(off < 0.02 * most, "{off} of {most} per mm");
    assert!((bends_off(&curve, &Derivatives::NONE, begin, width) - most).abs() < 1e-12);
    assert_eq!(bends_off(&line([300.0, 0.0], [310.0, 0.0]), &found, begin, width), 0.0);
}

/// What of a piece decides whether its samples describe it well enough.
#[derive(Clone, Copy)]
struct Case {
    /// The joint, or from [`AXES`] on the coordinate of the tool.
    channel: usize,
    off: [f64; 3],
    bends: f64,
    speed: f64,
    most: [f64; 2],
}

impl Case {
    fn is_resolved(&self, ratings: &Ratings) -> bool {
        let node = Node::of_axes(0.0, self.speed, &[0.0; AXES], ratings);
        let piece = Derivatives::with_errors(self.channel, self.off);
        is_resolved(&piece, self.bends, &[node], self.most, ratings, AXES)
    }

    /// Whether an error is at the border: a little less is well enough, a little more is not.
    #[track_caller]
    fn is_at_the_border(self, what: &str) {
        let ratings = ratings(&arm());
        let by =
            |factor: f64| Self { off: self.off.map(|off| factor * off), bends: factor * self.bends, ..self };
        assert!(by(0.999).is_resolved(&ratings), "{what} is not well enough");
        assert!(!by(1.001).is_resolved(&ratings), "{what} is well enough");
    }
}

#[test]
fn a_piece_is_resolved_while_its_errors_take_no_more_than_their_share_of_the_reserve() {
    let limits = ratings(&arm());
    let (v, [a, j]) = (150.0, [2_500.0, 50_000.0]);
    let reserve = AXIS_LEFT_OUT * (1.0 - AXIS_RESERVE);
    let speed = AXIS_LEFT_OUT * (1.0 - AXIS_SPEED_RESERVE) * limits.speed[1];
    let [acceleration, jerk] = [limits.acceleration[1], limits.jerk()[1]].map(|all| reserve * all);
    let joint = |off: [f64; 3], speed: f64, most: [f64; 2]| Case { channel: 1, off, bends: 0.0, speed, most };
    joint([speed / v, 0.0, 0.0], v, [1.0, 1.0]).is_at_the_border("a speed");
    joint([acceleration / a, 0.0, 0.0], 1.0, [a, 1.0]).is_at_the_border("an acceleration along");
    joint([jerk / j, 0.0, 0.0], 1.0, [1.0, j]).is_at_the_border("a jerk along");
    joint([0.0, acceleration / (v * v), 0.0], v, [1.0, 1.0]).is_at_the_border("an acceleration across");
    joint([0.0, jerk / (3.0 * v * a), 0.0], v, [a, 1.0]).is_at_the_border("a jerk of an acceleration");
    joint([0.0, 0.0, jerk / (v * v * v)], v, [1.0, 1.0]).is_at_the_border("a jerk across");
    let thirds = [jerk / j / 3.0, jerk / (3.0 * v * a) / 3.0, jerk / (v * v * v) / 3.0];
    joint(thirds, v, [a, j]).is_at_the_border("a jerk of three parts");
    let halves = [acceleration / 1_500.0 / 2.0, acceleration / (v * v) / 2.0, 0.0];
    joint(halves, v, [1_500.0, 1.0]).is_at_the_border("an acceleration of two parts");
    let reserve = TOOL_LEFT_OUT * (1.0 - TOOL_RESERVE);
    let [acceleration, jerk] = [limits.tool_acceleration, limits.tool_jerk()].map(|all| reserve * all);
    let tool =
        |off: [f64; 3], bends: f64, most: [f64; 2]| Case { channel: AXES + 1, off, bends, speed: v, most };
    tool([0.0, acceleration / (v * v), 0.0], 0.0, [1.0, 1.0]).is_at_the_border("the tool across");
    tool([0.0; 3], acceleration / (v * v), [1.0, 1.0]).is_at_the_border("the tool's bend that is known");
    tool([0.0, jerk / (3.0 * v * a), 0.0], 0.0, [a, 1.0])
        .is_at_the_border("the tool's jerk of an acceleration");
    tool([0.0, 0.0, jerk / (v * v * v)], 0.0, [1.0, 1.0]).is_at_the_border("the tool's jerk across");
    let halves = [0.0, jerk / (3.0 * v * a) / 2.0, jerk / (v * v * v) / 2.0];
    tool(halves, 0.0, [a, 1.0]).is_at_the_border("the tool's jerk of two parts");
    let not_led = Ratings::of_axes(arm().limits(), 1.0, AXIS_RESERVE);
    assert!(tool([0.0, 1e9, 1e9], 1e9, [a, j]).is_resolved(&not_led), "no tool is led");
}

#[test]
fn the_highest_speed_and_the_least_turn_of_the_nodes_count() {
    let limits = ratings(&arm());
    let speed = AXIS_LEFT_OUT * (1.0 - AXIS_SPEED_RESERVE) * limits.speed[1];
    let node = |programmed: f64, highest: f64, slope: f64| {
        let mut node = Node { highest, ..Node::of_axes(0.0, programmed, &[0.0; AXES], &limits) };
        node.slope[0] = slope as f32;
        node
    };
    let resolved = |nodes: &[Node], off: f64, most: [f64; 2]| {
        is_resolved(&Derivatives::with_errors(1, [off, 0.0, 0.0]), 0.0, nodes, most, &limits, AXES)
    };
    // 100 mm/s, programmed for the first and allowed at the second.
    let nodes = [node(100.0, 1e6, 0.0), node(300.0, 1e4, 0.0), node(50.0, 1e6, 0.0)];
    assert!(resolved(&nodes, 0.999 * speed / 100.0, [1.0, 1.0]));
    assert!(!resolved(&nodes, 1.001 * speed / 100.0, [1.0, 1.0]));
    // Along the piece no joint allows more than this acceleration: 200 mm/s² at the second.
    let acceleration = AXIS_LEFT_OUT * (1.0 - AXIS_RESERVE) * limits.acceleration[1];
    let nodes = [node(1.0, 1e6, 0.02), node(1.0, 1e6, 0.005)];
    assert!(resolved(&nodes, 0.999 * acceleration / 200.0, [1e9, 1.0]));
    assert!(!resolved(&nodes, 1.001 * acceleration / 200.0, [1e9, 1.0]));
}
