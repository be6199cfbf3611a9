//! The elastic surfaces of the cell that the tool can press against; they are part of the simulated plant.

use super::frame::{distance, dot};

/// A flat elastic surface in the root.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Surface {
    /// A point on it, in mm: its middle, where it is bounded.
    pub point: [f64; 3],
    /// The unit vector out of it, towards where the tool is free.
    pub normal: [f64; 3],
    /// Radius around its middle, in mm; infinite for a whole plane.
    pub radius_mm: f64,
    /// Stiffness: force for each millimetre that the tool is inside it, in N/mm.
    pub stiffness_n_per_mm: f64,
}

impl Surface {
    /// Returns the force of the surface on the tool in N, along the root's axes; 0 if the tool does not touch it.
    #[must_use]
    pub fn force_on(&self, tool: [f64; 3]) -> [f64; 3] {
        let offset: [f64; 3] = core::array::from_fn(|i| tool[i] - self.point[i]);
        let depth_mm = -dot(offset, self.normal);
        let foot: [f64; 3] = core::array::from_fn(|i| tool[i] + depth_mm * self.normal[i]);
        if depth_mm <= 0.0 || distance(foot, self.point) > self.radius_mm {
            return [0.0; 3];
        }
        self.normal.map(|along| along * self.stiffness_n_per_mm * depth_mm)
    }
}

/// Returns the force of all surfaces on the tool in N, along the root's axes.
#[must_use]
pub fn contact_force(surfaces: &[Surface], tool: [f64; 3]) -> [f64; 3] {
    surfaces.iter().fold([0.0; 3], |sum, surface| {
        let force = surface.force_on(tool);
        core::array::from_fn(|i| sum[i] + force[i])
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const SEAT: Surface =
        Surface { point: [1.0, 2.0, 8.0], normal: [0.0, 0.0, 1.0], radius_mm: 5.0, stiffness_n_per_mm: 40.0 };

    #[test]
    fn a_surface_pushes_back_by_its_stiffness_where_the_tool_is_in_it_and_nowhere_else() {
        assert_eq!(SEAT.force_on([1.0, 2.0, 8.0]), [0.0; 3]);
        assert_eq!(SEAT.force_on([1.0, 2.0, 7.5]), [0.0, 0.0, 20.0]);
        assert_eq!(SEAT.force_on([6.1, 2.0, 7.5]), [0.0; 3], "beside it");
        let two = [SEAT, Surface { stiffness_n_per_mm: 10.0, ..SEAT }];
        assert_eq!(contact_force(&two, [1.0, 2.0, 7.5]), [0.0, 0.0, 25.0]);
    }
}
