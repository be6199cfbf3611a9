//! Angles of vectors in the plane, several at once.
//!
//! An inverse kinematics ends in an arc tangent for each joint, and those of a library come one after the other. Here
//! all of them are worked on side by side, without a branch, in the processor's vectors.

/// tan(22.5°)
const TAN: f64 = core::f64::consts::SQRT_2 - 1.0;

/// The polynomial in u that is nearest to atan(√u)/√u, in degrees, from u = 0 to tan²(22.5°): a Chebyshev fit, off by
/// 2·10⁻¹⁵° at most, which is less than rounding. The highest power first, and then two powers at a time: pairs need not
/// wait for each other.
const HIGHEST: f64 = 1.210_967_680_369_910_5;
const PAIRS: [[f64; 2]; 5] = [
    [-2.491_250_410_630_595, 3.259_184_030_926_613_6],
    [-3.804_573_791_931_714, 4.406_018_799_902_542],
    [-5.208_629_296_976_883, 6.366_194_898_618_501],
    [-8.185_111_299_001_411, 11.459_155_901_960_491],
    [-19.098_593_171_024_635, 57.295_779_513_082_316],
];

/// The angles in degrees, −180 to 180, of the vectors (x, y), to some 10⁻¹⁴°; about 0 for one without length.
pub(super) fn degrees<const N: usize>(x: [f64; N], y: [f64; N]) -> [f64; N] {
    let (mut tangent, mut square, mut sum) = ([0.0; N], [0.0; N], [HIGHEST; N]);
    for i in 0..N {
        let (along, across) = (x[i].abs(), y[i].abs());
        let (long, short) = if across > along { (across, along) } else { (along, across) };
        // In the first eighth of the turn, and from its middle: within ±22.5°.
        let long = if long < 1e-300 { 1e-300 } else { long };
        tangent[i] = (short - long * TAN) / (long + short * TAN);
        square[i] = tangent[i] * tangent[i];
    }
    for [odd, even] in &PAIRS {
        for i in 0..N {
            sum[i] = sum[i] * (square[i] * square[i]) + (odd * square[i] + even);
        }
    }
    core::array::from_fn(|i| {
        let acute = 22.5 + tangent[i] * sum[i];
        let acute = if y[i].abs() > x[i].abs() { 90.0 - acute } else { acute };
        let angle = if x[i] < 0.0 { 180.0 - acute } else { acute };
        angle.copysign(y[i])
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_axes_and_their_bisectors_are_met_and_no_vector_has_no_angle() {
        let x = [1.0, 1.0, 0.0, -1.0, -1.0, -1.0, 0.0, 1.0, 0.0];
        let y = [0.0, 1.0, 1.0, 1.0, 0.0, -1.0, -1.0, -1.0, 0.0];
        let expected = [0.0, 45.0, 90.0, 135.0, 180.0, -135.0, -90.0, -45.0, 0.0];
        for (found, expected) in degrees(x, y).into_iter().zip(expected) {
            assert!((found - expected).abs() < 2e-14, "{found} is not {expected}");
        }
    }

    #[test]
    fn what_is_no_number_has_no_angle() {
        assert!(degrees([f64::NAN, 1.0], [1.0, f64::NAN]).iter().all(|angle| angle.is_nan()));
    }

    proptest! {
        #[test]
        fn angles_are_those_of_the_library(
            (x, y) in (-1.0..1.0_f64, -1.0..1.0_f64),
            scale in prop_oneof![Just(1e-200), Just(1.0), Just(1e200)],
        ) {
            let [found] = degrees([x * scale], [y * scale]);
            prop_assert!((found - y.atan2(x).to_degrees()).abs() < 5e-14, "{found}");
        }
    }
}
