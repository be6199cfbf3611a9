//! Angles of vectors in the plane and vectors of angles, several at once, in degrees.
//!
//! An inverse kinematics ends with an arc tangent for each joint, and a forward kinematics begins with a sine and a
//! cosine of each; library functions compute them one after another. Here all of them are computed side by side,
//! without branches, in the processor's vector units, and only from sums and products: the same bits on every
//! computer.

/// tan(22.5°)
const TAN: f64 = core::f64::consts::SQRT_2 - 1.0;

/// The polynomial in u that approximates atan(√u)/√u, in degrees, from u = 0 to tan²(22.5°): a Chebyshev fit with an
/// error of at most 2·10⁻¹⁵°, less than rounding. The highest coefficient first, then two at a time: pairs need not
/// wait for each other.
const ANGLE_HIGHEST: f64 = 1.210_967_680_369_910_5;
const ANGLE_PAIRS: [[f64; 2]; 5] = [
    [-2.491_250_410_630_595, 3.259_184_030_926_613_6],
    [-3.804_573_791_931_714, 4.406_018_799_902_542],
    [-5.208_629_296_976_883, 6.366_194_898_618_501],
    [-8.185_111_299_001_411, 11.459_155_901_960_491],
    [-19.098_593_171_024_635, 57.295_779_513_082_316],
];

/// The polynomial in u that approximates sin(√u°)/√u, from u = 0 to 45²: a Chebyshev fit with a relative error of
/// 2·10⁻¹⁷.
const SINE_HIGHEST: f64 = 2.216_456_005_957_463_2e-33;
const SINE_PAIRS: [[f64; 2]; 3] = [
    [-1.146_756_482_356_073_4e-27, 4.141_266_538_492_003e-22],
    [-9.788_384_855_392_072e-17, 1.349_601_623_161_154_3e-11],
    [-8.860_961_557_012_953e-7, 0.017_453_292_519_943_295],
];

/// The polynomial in u that approximates cos(√u°), in the same way, with a relative error of 4·10⁻¹⁷.
const COSINE_HIGHEST: f64 = 3.511_377_951_827_021e-42;
const COSINE_PAIRS: [[f64; 2]; 4] = [
    [-2.791_617_520_664_019e-36, 1.667_982_087_225_27e-30],
    [-7.227_875_160_708_368e-25, 2.135_494_303_592_910_3e-19],
    [-3.925_831_985_743_087e-14, 3.866_323_851_562_994e-9],
    [-0.000_152_308_709_893_354_3, 1.0],
];

/// Adding this to a number and subtracting it again gives the nearest whole number; the lowest bits of the sum are
/// that number's.
const ROUND: f64 = 1.5 * (1_u64 << 52) as f64;

/// Largest angle in degrees that is used as it is; from larger ones the full turns are subtracted first.
const MANY_TURNS: f64 = 1e9;

/// Returns the sines and cosines of angles in degrees, to some 10⁻¹⁶; exactly 0 and ±1 on the axes.
pub(super) fn sin_cos<const N: usize>(mut degrees: [f64; N]) -> ([f64; N], [f64; N]) {
    if degrees.iter().any(|angle| angle.abs() > MANY_TURNS) {
        degrees = degrees.map(|angle| angle % 360.0);
    }
    let (mut rest, mut square, mut quarters) = ([0.0; N], [0.0; N], [0_u64; N]);
    for i in 0..N {
        let rounded = degrees[i] * (1.0 / 90.0) + ROUND;
        quarters[i] = rounded.to_bits();
        // Exact: both are multiples of what the angle's last bit is worth, and the rest is within ±45°.
        rest[i] = degrees[i] - 90.0 * (rounded - ROUND);
        square[i] = rest[i] * rest[i];
    }
    let sine = polynomials(SINE_HIGHEST, &SINE_PAIRS, &square);
    let cosine = polynomials(COSINE_HIGHEST, &COSINE_PAIRS, &square);
    let (mut sines, mut cosines) = ([0.0; N], [0.0; N]);
    for i in 0..N {
        let (sine, cosine) = (rest[i] * sine[i], cosine[i]);
        let (along, across) = if quarters[i] & 1 == 0 { (cosine, sine) } else { (sine, cosine) };
        // The second bit is the sign, and a sum with 0 has no negative zero.
        let signed = |value: f64, quarters: u64| f64::from_bits(value.to_bits() ^ (quarters & 2) << 62) + 0.0;
        sines[i] = signed(across, quarters[i]);
        cosines[i] = signed(along, quarters[i].wrapping_add(1));
    }
    (sines, cosines)
}

/// Evaluates one polynomial at several places; its coefficients are the highest one, and then two at a time.
fn polynomials<const N: usize>(highest: f64, pairs: &[[f64; 2]], at: &[f64; N]) -> [f64; N] {
    let mut sum = [highest; N];
    for [odd, even] in pairs {
        for i in 0..N {
            sum[i] = sum[i] * (at[i] * at[i]) + (odd * at[i] + even);
        }
    }
    sum
}

/// Returns the angles in degrees, −180 to 180, of the vectors (x, y), accurate to some 10⁻¹⁴°; about 0 for a vector
/// without length.
pub(super) fn degrees<const N: usize>(x: [f64; N], y: [f64; N]) -> [f64; N] {
    let (mut tangent, mut square) = ([0.0; N], [0.0; N]);
    for i in 0..N {
        let (along, across) = (x[i].abs(), y[i].abs());
        let (long, short) = if across > along { (across, along) } else { (along, across) };
        // In the first eighth of the turn, and from its middle: within ±22.5°.
        let long = if long < 1e-300 { 1e-300 } else { long };
        tangent[i] = (short - long * TAN) / (long + short * TAN);
        square[i] = tangent[i] * tangent[i];
    }
    let sum = polynomials(ANGLE_HIGHEST, &ANGLE_PAIRS, &square);
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
    fn the_angles_of_the_axes_and_their_bisectors_are_exact_and_that_of_a_zero_vector_is_0() {
        let x = [1.0, 1.0, 0.0, -1.0, -1.0, -1.0, 0.0, 1.0, 0.0];
        let y = [0.0, 1.0, 1.0, 1.0, 0.0, -1.0, -1.0, -1.0, 0.0];
        let expected = [0.0, 45.0, 90.0, 135.0, 180.0, -135.0, -90.0, -45.0, 0.0];
        for (found, expected) in degrees(x, y).into_iter().zip(expected) {
            assert!((found - expected).abs() < 2e-14, "{found} is not {expected}");
        }
    }

    #[test]
    fn a_vector_of_nan_has_the_angle_nan() {
        assert!(degrees([f64::NAN, 1.0], [1.0, f64::NAN]).iter().all(|angle| angle.is_nan()));
    }

    #[test]
    fn sines_and_cosines_on_the_axes_are_whole_numbers() {
        for turns in [-1e12, -1e6, -360.0, 0.0, 720.0, 1e6, 1e12].map(|turns: f64| turns * 360.0) {
            let (sines, cosines) = sin_cos([turns, turns + 90.0, turns + 180.0, turns - 90.0]);
            assert_eq!((sines, cosines), ([0.0, 1.0, 0.0, -1.0], [1.0, 0.0, -1.0, 0.0]));
        }
    }

    #[test]
    fn an_angle_that_is_not_finite_has_the_sine_nan() {
        let (sines, cosines) = sin_cos([f64::NAN, f64::INFINITY]);
        assert!(sines.iter().chain(&cosines).all(|value| value.is_nan()), "{sines:?} {cosines:?}");
    }

    proptest! {
        #[test]
        fn sines_and_cosines_are_those_of_the_library(
            degrees in prop_oneof![-90.0..90.0_f64, -800.0..800.0_f64],
            turns in prop_oneof![Just(0.0), Just(360.0)],
        ) {
            let ([sine], [cosine]) = sin_cos([degrees + turns]);
            let (expected_sine, expected_cosine) = libm::sincos(degrees.to_radians());
            // The library's angle in radians has an error of its last bit, and so has the sum.
            let off = 2e-16 + (degrees.abs() + turns).max(360.0).to_radians() * f64::EPSILON;
            prop_assert!((sine - expected_sine).abs() < off, "sin {degrees}°: {sine}");
            prop_assert!((cosine - expected_cosine).abs() < off, "cos {degrees}°: {cosine}");
        }

        #[test]
        fn angles_are_those_of_the_library(
            (x, y) in (-1.0..1.0_f64, -1.0..1.0_f64),
            scale in prop_oneof![Just(1e-200), Just(1.0), Just(1e200)],
        ) {
            let [found] = degrees([x * scale], [y * scale]);
            // Each has errors of its last bits, which are worth 2.8e-14 near 180°.
            prop_assert!((found - libm::atan2(y, x).to_degrees()).abs() < 1e-13, "{found}");
        }
    }
}
