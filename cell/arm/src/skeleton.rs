//! The lines along which an arm's bodies lie, to find out what its volume comes near to.

/// Most points of a skeleton.
pub const MOST_POINTS: usize = 10;

/// The points of an arm from its root to its flange, in the root frame, in mm: a link lies between each and the next one.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Skeleton {
    points: [[f64; 3]; MOST_POINTS],
    count: usize,
}

impl Skeleton {
    /// Creates a skeleton from its points; those beyond [`MOST_POINTS`] are dropped.
    #[must_use]
    pub fn new(of: &[[f64; 3]]) -> Self {
        let mut points = [[0.0; 3]; MOST_POINTS];
        let mut count = 0;
        for (place, point) in points.iter_mut().zip(of) {
            (*place, count) = (*point, count + 1);
        }
        Self { points, count }
    }

    /// Returns the points, the flange last.
    #[must_use]
    pub fn points(&self) -> &[[f64; 3]] {
        self.points.get(..self.count).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use crate::{Installation, distance};

    /// Returns the distances from point to point of the arm of a setup in some joints.
    fn lengths(name: &str, joints: [f64; 6]) -> Vec<f64> {
        let arm = Installation::from_setup(&setup::setup(name).unwrap()).unwrap().arm;
        let skeleton = arm.skeleton(&joints);
        let flange = arm.forward(&joints).position;
        assert!(distance(*skeleton.points().last().unwrap(), flange) < 1e-9, "it ends at the flange");
        assert_eq!(skeleton.points()[0], [0.0; 3], "it begins at the root");
        skeleton.points().windows(2).map(|pair| distance(pair[0], pair[1])).collect()
    }

    #[test]
    fn however_an_arm_stands_the_links_of_its_skeleton_keep_the_lengths_of_the_setup() {
        let wanted: [(&str, &[f64]); 3] = [
            // The links lie above the stroke of the quill.
            ("A", &[200.0, 225.0, 275.0]),
            ("B", &[327.0, 0.0, 225.0, 10.0, 250.0, 64.0]),
            ("D", &[162.5, 133.3, 425.0, 133.3, 392.2, 133.3, 99.7, 99.6]),
        ];
        for (name, wanted) in wanted {
            for joints in
                [[0.0; 6], [20.0, -35.0, 50.0, 70.0, -40.0, 110.0], [-80.0, 60.0, 10.0, 5.0, 90.0, -30.0]]
            {
                let found = lengths(name, joints);
                assert!(found.len() >= wanted.len(), "{name}: {found:?}");
                for (found, wanted) in found.iter().zip(wanted) {
                    assert!((found - wanted).abs() < 1e-9, "{name} {joints:?}: {found} is not {wanted}");
                }
            }
        }
    }
}
