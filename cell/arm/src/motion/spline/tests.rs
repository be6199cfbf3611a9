//! The shape of splines, and that their parameter is the way.

use proptest::prelude::*;

use super::*;
use crate::cross;

pub(super) fn pieces(targets: &[[f64; 6]]) -> Vec<Spline> {
    let frames: Vec<Frame> = targets.iter().map(|target| Frame::from_mm_deg(*target)).collect();
    let at = |index: usize| frames.get(index).copied();
    (1..frames.len())
        .map(|index| {
            let flange = Flange::of_tool(&Frame::IDENTITY);
            Spline::new(frames[index - 1], frames[index], flange)
                .with_neighbours(index.checked_sub(2).and_then(at), at(index + 1))
        })
        .collect()
}

fn targets(count: usize) -> impl Strategy<Value = Vec<[f64; 6]>> {
    let step = (10.0..80.0_f64, -70.0..70.0_f64, -40.0..40.0_f64);
    let turn = (-40.0..40.0_f64, -30.0..30.0_f64, 150.0..210.0_f64);
    proptest::collection::vec((step, turn), count).prop_map(|steps| {
        let mut at = [0.0; 3];
        steps
            .into_iter()
            .map(|((dx, dy, dz), (a, b, c))| {
                at = [at[0] + dx, at[1] + dy, at[2] + dz];
                [at[0], at[1], at[2], a, b, c]
            })
            .collect()
    })
}

fn position(&[x, y, z, ..]: &Pose) -> [f64; 3] {
    [x, y, z]
}

/// The pose's derivative by τ of this order, 1 or 2.
fn derivative(piece: &Spline, order: u32, share: f64) -> Pose {
    let mut sum = [0.0; 7];
    for (power, factor) in (0..6_u32).zip(&piece.curve.0).rev() {
        let Some(left) = power.checked_sub(order) else { break };
        let scale = f64::from((left + 1..=power).product::<u32>());
        for (sum, factor) in sum.iter_mut().zip(factor) {
            *sum = *sum * share + scale * factor;
        }
    }
    sum
}

/// The curvature vector in 1/mm at a share τ: where the tangent turns to.
fn curvature(piece: &Spline, share: f64) -> [f64; 3] {
    let [first, second] = [1, 2].map(|order| position(&derivative(piece, order, share)));
    let square = dot(first, first);
    cross(cross(first, second), first).map(|part| part / (square * square))
}

fn apart(one: [f64; 3], other: [f64; 3]) -> f64 {
    distance(one, other)
}

#[test]
fn points_of_a_line_give_that_line() {
    let pieces = pieces(&[[0.0; 6], [10.0, 0.0, 0.0, 0.0, 0.0, 0.0], [50.0, 0.0, 0.0, 0.0, 0.0, 0.0]]);
    assert!((pieces[1].length() - 40.0).abs() < 1e-9);
    assert!(apart(pieces[1].tool(13.0).position, [23.0, 0.0, 0.0]) < 1e-9);
}

#[test]
fn points_of_a_circle_give_nearly_that_circle() {
    let on_circle = |index: usize| {
        let (sin, cos) = libm::sincos((index as f64 * 20.0).to_radians());
        [100.0 * cos, 100.0 * sin, 0.0, 0.0, 0.0, 0.0]
    };
    let targets: Vec<_> = (0..10).map(on_circle).collect();
    for piece in &pieces(&targets)[1..8] {
        for step in 0..=100 {
            let place = piece.tool(piece.length() * f64::from(step) / 100.0).position;
            assert!((length(place) - 100.0).abs() < 0.05, "{} mm", length(place));
        }
    }
}

#[test]
fn a_turn_back_is_no_part_of_a_curve() {
    let back = pieces(&[[0.0; 6], [10.0, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0, 0.0, 0.0]]);
    assert!(!back[0].goes_on_to(&back[1]));
}

#[test]
fn a_curve_goes_on_as_long_as_it_does_not_turn_back_too_far_and_keeps_its_tool() {
    let turned = |angle: f64, long: f64| {
        let (sin, cos) = libm::sincos(angle.to_radians());
        let end = [40.0 + long * cos, long * sin, 0.0, 0.0, 0.0, 0.0];
        let [one, other]: [Spline; 2] =
            pieces(&[[0.0; 6], [40.0, 0.0, 0.0, 0.0, 0.0, 0.0], end]).try_into().unwrap();
        (one, other)
    };
    for long in [5.0, 40.0, 300.0] {
        let (one, other) = turned(TURNS_BACK_DEG - 0.5, long);
        assert!(one.goes_on_to(&other), "{long} mm");
        let tool = Flange::of_tool(&Frame::from_mm_deg([0.0, 0.0, 10.0, 0.0, 0.0, 0.0]));
        let [from, to] = [*other.from(), *other.to()];
        assert!(!one.goes_on_to(&Spline::new(from, to, tool)), "another tool");
        let (one, other) = turned(TURNS_BACK_DEG + 0.5, long);
        assert!(!one.goes_on_to(&other), "{long} mm");
    }
}

#[test]
fn of_both_quaternions_of_a_rotation_the_nearer_one_is_taken() {
    let frame = Frame::from_mm_deg([1.0, 2.0, 3.0, 30.0, -20.0, 100.0]);
    let [x, y, z, a, b, c, d] = pose(&frame, None);
    let opposite = [x, y, z, -a, -b, -c, -d];
    assert_eq!(pose(&frame, Some(&opposite)), opposite);
    assert_eq!(pose(&frame, Some(&[x, y, z, a, b, c, d])), [x, y, z, a, b, c, d]);
    // Only the quaternions count.
    assert_eq!(pose(&frame, Some(&[-9.0 * x, -9.0 * y, -9.0 * z, a, b, c, d])), [x, y, z, a, b, c, d]);
}

proptest! {
    #[test]
    fn place_growth_and_bend_are_those_of_the_tool(targets in targets(5), share in 0.02..0.98_f64) {
        for piece in pieces(&targets) {
            let length = piece.length();
            for way in [-1.0, 0.0, share * length, length, length + 1.0] {
                prop_assert!(apart(piece.position(way), piece.tool(way).position) < 1e-12);
            }
            let step = 1e-4;
            let [before, here, after] = [-step, 0.0, step].map(|step| piece.curve.growth_at(share + step));
            prop_assert!((here[0] * piece.curve.speed(share) - 1.0).abs() < 1e-9);
            let second = (after[0] - before[0]) / (2.0 * step) * here[0];
            let most = 1e-4 * (second.abs() + here[0] * here[0]);
            prop_assert!((here[1] - second).abs() < most, "{} for {second}", here[1]);
            let (way, step) = (share * length, 1e-3 * length);
            let [one, two, three] = [-step, 0.0, step].map(|step| piece.position(way + step));
            let expected = core::array::from_fn(|i| (one[i] - 2.0 * two[i] + three[i]) / (step * step));
            let [found] = piece.bends(&[way]);
            prop_assert!(apart(found, expected) < 0.02 * (1e-3 + self::length(expected)), "{found:?} {expected:?}");
        }
    }

    #[test]
    fn tangent_and_curvature_are_continuous_at_every_target(targets in targets(6)) {
        let pieces = pieces(&targets);
        for pair in pieces.windows(2) {
            let (one, other) = (&pair[0], &pair[1]);
            prop_assert!(apart(one.tool(one.length()).position, other.tool(0.0).position) < 1e-9);
            let [one_tangent, other_tangent] = [derivative(one, 1, 1.0), derivative(other, 1, 0.0)].map(|first| {
                let first = position(&first);
                first.map(|part| part / length(first))
            });
            prop_assert!(apart(one_tangent, other_tangent) < 1e-9);
            let (bend, other_bend) = (curvature(one, 1.0), curvature(other, 0.0));
            prop_assert!(apart(bend, other_bend) < 1e-9 + 1e-6 * length(bend));
            // And numerically, on the path itself, by the way.
            let h = 0.02;
            let place = |way: f64| {
                let end = one.length();
                if way <= 0.0 { one.tool(end + way).position } else { other.tool(way).position }
            };
            let second = |at: f64| -> [f64; 3] {
                core::array::from_fn(|i| (place(at - h)[i] - 2.0 * place(at)[i] + place(at + h)[i]) / (h * h))
            };
            let (left, right) = (second(-h), second(h));
            prop_assert!(apart(left, right) < 0.02 * (1.0 + 30.0 * length(bend)), "{left:?} {right:?}");
        }
    }

    #[test]
    fn the_parameter_is_the_way(targets in targets(5), share in 0.0..0.99_f64) {
        for piece in pieces(&targets) {
            let way = share * piece.length();
            let step = piece.length() * 1e-4;
            let speed = apart(piece.tool(way).position, piece.tool(way + step).position) / step;
            prop_assert!((speed - 1.0).abs() < 3e-5, "{speed}");
        }
    }

    #[test]
    fn the_tool_turns_as_smoothly_as_it_moves(targets in targets(6)) {
        for pair in pieces(&targets).windows(2) {
            let (one, other) = (&pair[0], &pair[1]);
            let h = 0.01;
            let turn = |from: Frame, to: Frame| {
                let (axis, angle) = (from.rotation.inverse() * to.rotation).axis_angle();
                axis.map(|part| part * angle / h)
            };
            let left = turn(one.tool(one.length() - h), *one.to());
            let right = turn(*other.from(), other.tool(h));
            prop_assert!(apart(left, right) < 0.02 * (1.0 + length(left)), "{left:?} {right:?} °/mm");
        }
    }
}
