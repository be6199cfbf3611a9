//! Where an arm stands if nothing else says so.

use protocol::image::{Configuration, ErrorNumber};

use crate::{Arm, Frame, Joints, Violation};

impl Arm {
    /// Returns the joints in the middle of their ranges; those without a range are 0.
    #[must_use]
    pub fn middle(&self) -> Joints {
        let (lower, upper) = (self.limits().lower, self.limits().upper);
        core::array::from_fn(|axis| {
            let middle = f64::midpoint(lower[axis], upper[axis]);
            if middle.is_finite() { middle } else { 0.0 }
        })
    }

    /// Returns the joints for this pose of the flange, in the configuration that leaves the joints the most room to the
    /// ends of their ranges.
    ///
    /// # Errors
    ///
    /// No configuration reaches the pose: the violation of the last one.
    pub fn stand_at(&self, flange: &Frame) -> Result<Joints, Violation> {
        let middle = self.middle();
        let mut best = Err(Violation::Plain(ErrorNumber::Unreachable));
        for status in self.statuses() {
            let configuration = Configuration { status, turn: None };
            match (self.inverse_in(flange, configuration, &middle), &best) {
                (Ok(joints), Ok(known)) if self.used_range(&joints) >= self.used_range(known) => {}
                (Err(_), Ok(_)) => {}
                (found, _) => best = found,
            }
        }
        best
    }

    /// Returns how far the joint closest to an end of its range is from the middle of the range: 1 is the end.
    fn used_range(&self, joints: &Joints) -> f64 {
        let (lower, upper, middle) = (self.limits().lower, self.limits().upper, self.middle());
        let share =
            |axis: usize| (joints[axis] - middle[axis]).abs() / (upper[axis] - lower[axis]).abs() * 2.0;
        (0..self.axes()).map(share).fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use crate::{Installation, distance};

    #[test]
    fn an_arm_stands_at_a_pose_in_its_roomiest_configuration_and_says_why_it_cannot() {
        for name in ["A", "B", "D"] {
            let Installation { arm, .. } = Installation::from_setup(&setup::setup(name).unwrap()).unwrap();
            let mut near = arm.middle();
            near[1] += 40.0;
            near[4] += if arm.axes() == 6 { 50.0 } else { 0.0 };
            let flange = arm.forward(&near);
            let found = arm.stand_at(&flange).unwrap();
            assert!(arm.within_range(&found).is_ok(), "{name}: {found:?}");
            assert!(distance(arm.forward(&found).position, flange.position) < 1e-6, "{name}: {found:?}");
            assert!(arm.used_range(&found) <= arm.used_range(&near) + 1e-9, "{name}: {found:?}");
            let mut far = flange;
            far.position[0] += 5_000.0;
            assert!(arm.stand_at(&far).unwrap_err().to_string().contains("the arm reaches"), "{name}");
        }
    }
}
