use super::*;

const RATED: AxisLimits = AxisLimits {
    lower: [-180.0; 6],
    upper: [180.0; 6],
    speed: [100.0, 110.0, 120.0, 130.0, 140.0, 150.0],
    acceleration: [1_000.0; 6],
    jerk: [20_000.0; 6],
};

fn ratings() -> Ratings {
    Ratings::of_axes(&RATED, 1.0, 1.0).with_tool(2_000.0, 40_000.0, 1.0)
}

/// A place at which nothing changes with the way.
fn still() -> Node {
    Node::of_axes(0.0, 1.0, &[0.0; 6], &ratings())
}

/// A place at which one joint has these derivatives by the way, in degrees.
fn joint(axis: usize, [slope, bend, twist]: [f64; 3]) -> Node {
    let mut node = still();
    (node.slope[axis], node.bend[axis], node.twist[axis]) =
        ((slope / 1_000.0) as f32, (bend / 1_000.0) as f32, (twist / 1_000.0) as f32);
    node
}

/// A place at which the tool has these derivatives by the way, in mm.
fn tool(derivatives: [[f64; 3]; 3]) -> Node {
    Node { tool: derivatives.map(|vector| vector.map(|part| (part / 2_000.0) as f32)), ..still() }
}

#[track_caller]
fn assert_near(found: f64, expected: f64) {
    assert!(found == expected || (found / expected - 1.0).abs() < 1e-6, "{found} instead of {expected}");
}

#[test]
fn ratings_are_the_shares_of_what_the_axes_have() {
    let half = Ratings::of_axes(&RATED, 0.5, 0.9);
    assert_near(half.speed[1], 99.0);
    assert_near(half.acceleration[0], 450.0);
    assert_near(half.ramp_s[0], 0.05);
    assert_near(half.jerk()[0], 9_000.0);
    assert!(!half.leads_tool());
    let led = half.with_tool(2_000.0, 40_000.0, 0.9);
    assert!(led.leads_tool());
    assert_near(led.tool_acceleration, 1_800.0);
    assert_near(led.tool_jerk(), 36_000.0);
    let without = Ratings::of_axes(&AxisLimits { jerk: [f64::INFINITY; 6], ..RATED }, 1.0, 1.0);
    assert_eq!(without.ramp_s, [0.0; 6], "an acceleration without a limit of its jerk is there at once");
}

#[test]
fn each_joint_limits_the_speed_by_its_speed_its_acceleration_and_its_jerk() {
    for axis in 0..AXES {
        for sign in [1.0, -1.0] {
            let highest = |derivatives: [f64; 3]| {
                let node = joint(axis, derivatives.map(|value| sign * value));
                let (square, limiting) = node.highest_of_joints(&ratings());
                assert_eq!(usize::from(limiting), axis + 1);
                square.sqrt()
            };
            // q'·v is the rated speed.
            assert_near(highest([2.0, 0.0, 0.0]), RATED.speed[axis] / 2.0);
            // q''·v² is the rated acceleration.
            assert_near(highest([0.0, 0.4, 0.0]), 50.0);
            // q'''·v³ is nine tenths of the rated jerk.
            assert_near(highest([0.0, 0.0, 0.018]), 100.0);
            // The least of the three.
            assert_near(highest([2.0, 0.1, 0.001]), RATED.speed[axis] / 2.0);
            assert_near(highest([0.2, 0.4, 0.001]), 50.0);
            assert_near(highest([0.2, 0.1, 0.144]), 50.0);
        }
    }
    assert_eq!(still().highest_of_joints(&ratings()), (f64::INFINITY, 1));
}

#[test]
fn of_several_joints_the_slowest_one_limits_the_speed() {
    let mut node = joint(1, [2.0, 0.0, 0.0]);
    node.slope[4] = 0.004;
    node.bend[2] = 0.000_1;
    assert_eq!(node.highest_of_joints(&ratings()).1, 5);
    assert_near(node.highest_of_joints(&ratings()).0, 35.0 * 35.0);
    assert_near(node.speed_of_joints(&ratings()), 35.0);
    assert_eq!(still().speed_of_joints(&ratings()), f64::INFINITY);
}

#[test]
fn the_tool_limits_the_speed_by_its_acceleration_and_its_jerk() {
    let slope = [1.0, 0.0, 0.0];
    let highest = |bend, twist| tool([slope, bend, twist]).highest_of_tool(&ratings()).sqrt();
    assert_near(highest([0.3, 0.4, 0.0], [0.0; 3]), 4_000.0_f64.sqrt());
    // 0.036 mm⁻² · v³ is nine tenths of 40,000 mm/s³.
    assert_near(highest([0.0; 3], [0.0, 0.0, 0.036]), 100.0);
    assert_near(highest([0.1, 0.0, 0.0], [0.0, 0.036, 0.0]), 100.0);
    assert_near(highest([0.8, 0.0, 0.0], [0.0, 0.036, 0.0]), 50.0);
    assert_eq!(highest([0.0; 3], [0.0; 3]), f64::INFINITY);
}

#[test]
fn from_rest_the_steepest_joint_or_the_tool_limits_acceleration_and_jerk() {
    let [acceleration, jerk] = joint(3, [-2.0, 0.0, 0.0]).most_along(&ratings());
    assert_near(acceleration, 500.0);
    assert_near(jerk, 10_000.0);
    let led = tool([[0.6, 0.8, 0.0], [0.0; 3], [0.0; 3]]);
    let [acceleration, jerk] = led.most_along(&ratings());
    assert_near(acceleration, 2_000.0);
    assert_near(jerk, 40_000.0);
    assert_near(led.tool_slope(&ratings()), 1.0);
    assert_eq!(still().tool_slope(&ratings()), 0.0);
}

#[test]
fn limits_that_are_used_at_once_stay_within_those_of_every_joint() {
    let most = Limits { speed: 80.0, acceleration: 900.0, jerk: 30_000.0 };
    for (derivatives, highest, is_slowed) in [
        ([0.0, 0.0, 0.0], f64::INFINITY, false),
        ([0.5, 0.0, 0.0], f64::INFINITY, false),
        ([2.0, 0.0, 0.0], f64::INFINITY, false),
        ([2.0, 0.3, 0.0], f64::INFINITY, true),
        ([1.0, 0.05, 0.05], f64::INFINITY, true),
        ([0.5, 0.0, 0.0], 400.0, true),
    ] {
        let node = Node { highest, ..joint(2, derivatives) };
        let Limits { speed, acceleration, jerk } = node.steady(most, &ratings());
        let [slope, bend, twist] = derivatives;
        // Half of the joint for acceleration and jerk along the way.
        assert_near(acceleration, most.acceleration.min(500.0 / slope));
        assert_near(jerk, most.jerk.min(10_000.0 / slope));
        let fits = |speed: f64| {
            speed * speed <= highest
                && slope * acceleration + bend * speed * speed <= 1_000.0 * (1.0 + 1e-6)
                && slope * jerk + 3.0 * bend * speed * acceleration + twist * speed * speed * speed
                    <= 20_000.0 * (1.0 + 1e-6)
        };
        assert_eq!(speed < most.speed, is_slowed, "{derivatives:?}: {speed}");
        assert!(fits(speed), "{derivatives:?}: {speed}");
        assert!(!is_slowed || !fits(speed * 1.06), "{derivatives:?}: {speed} is too slow");
    }
}

#[test]
fn a_jerk_that_limits_a_little_more_than_the_acceleration_counts() {
    // 0.95 and 0.9025 of what the acceleration of 1 leaves.
    let root = libm::cbrt(TWISTING / 0.95);
    assert_near(joint(1, [0.0, 1_000.0, 19_000.0]).highest_of_joints(&ratings()).0, root * root);
    let twisted = tool([[0.0; 3], [2_000.0, 0.0, 0.0], [0.0, 38_000.0, 0.0]]);
    assert_near(twisted.highest_of_tool(&ratings()), root * root);
}

#[test]
fn the_share_of_the_error_that_is_asked_for_is_added_to_a_derivative() {
    let found = Derivatives::with_errors(2, [10.0, 20.0, 30.0]);
    let node = |off: f64| Node::new(0.0, 1.0, (&found, 0, off), true, &ratings());
    assert_eq!(node(0.0).slope[2], 0.0);
    for (order, value) in [node(0.5).slope[2], node(0.5).bend[2], node(0.5).twist[2]].into_iter().enumerate()
    {
        assert_near(f64::from(value), f64::from((0.005 * (order + 1) as f64) as f32));
    }
    let slower = Ratings { deceleration: 0.25, ..ratings() };
    assert_near(slower.joints_slow()[3], 250.0);
}
