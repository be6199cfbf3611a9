//! Brings a quantity to a target value, one robot cycle after another: as fast as the limits of its change and of the
//! difference of successive changes allow, without overshoot.
//!
//! A motion profile over time does not help if the target value is known for this cycle only, as for a contact force,
//! or if the arm has left its path. Then the limits apply to the differences between cycles, and they are kept
//! exactly.

/// Returns the next change, in one cycle, of a quantity that is `missing` from its target value and was changed by
/// `change` in the last cycle.
///
/// It is at most `most`, and differs from the last one by at most `step`. If the quantity already changes too fast to
/// stop at the target value, it overshoots and comes back.
pub(crate) fn next_change(missing: f64, change: f64, most: f64, step: f64) -> f64 {
    let sign = 1.0_f64.copysign(missing);
    let (missing, change) = (missing.abs(), sign * change);
    // After a change y, followed by y − step, y − 2·step …, the quantity has changed by y·n − step·n·(n − 1)/2 in
    // total.
    let cycles = (((1.0 + 8.0 * missing / step).sqrt() - 1.0) / 2.0).ceil();
    let highest = if cycles > 0.0 { missing / cycles + step * (cycles - 1.0) / 2.0 } else { 0.0 };
    let (slower, faster) = (change - step, (change + step).min(most));
    sign * highest.min(faster).max(slower)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_target_value_is_reached_and_kept_within_both_limits(
            start in -100.0..100.0_f64,
            most in 0.1..20.0_f64,
            step in 0.01..5.0_f64,
            share in -1.0..1.0_f64,
        ) {
            let (mut missing, mut change) = (start, share * most);
            let mut cycles = 0;
            while (missing, change) != (0.0, 0.0) {
                let next = next_change(missing, change, most, step);
                prop_assert!((next - change).abs() <= step * (1.0 + 1e-9));
                prop_assert!(next.abs() <= most * (1.0 + 1e-9));
                (missing, change) = (missing - next, next);
                cycles += 1;
                prop_assert!(cycles < 1_000_000, "{missing} is left, changed by {change}");
            }
        }

        #[test]
        fn from_rest_there_is_no_overshoot(
            start in 0.0..100.0_f64, most in 0.1..20.0_f64, step in 0.01..5.0_f64,
        ) {
            let (mut missing, mut change) = (start, 0.0);
            while (missing, change) != (0.0, 0.0) {
                change = next_change(missing, change, most, step);
                missing -= change;
                prop_assert!(missing >= -start * 1e-12, "passed by {}", -missing);
                if missing < 0.0 {
                    missing = 0.0;
                }
            }
        }
    }
}
