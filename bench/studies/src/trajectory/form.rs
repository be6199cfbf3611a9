//! The form in which the PLC sends the path: motions in slots, or compact points.

use anyhow::anyhow;
use clap::ValueEnum;
use planning::{CompactError, CompactPath, ToStart};
use plc_node::{MotionList, MotionSource, PointList};
use protocol::image::{Motion, PointHead};
use records::trace::RobotTick;
use serde::Serialize;

use super::points::PathPoints;

/// Form of the image's bytes 36..256.
#[derive(Clone, Copy, PartialEq, Eq, Debug, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum SentForm {
    /// Five motions of 44 bytes.
    Full,
    /// Thirty points, or fifteen with angles, as differences.
    Compact,
}

/// Path that the PLC sends.
#[derive(Debug)]
pub(super) struct SentPath {
    pub(super) source: Box<dyn MotionSource>,
    /// Motions before it: with compact points the way to the first one.
    pub(super) to_start: ToStart<Motion>,
    /// Length of a step of compact points, in µm (1e-3 degrees).
    pub(super) resolution_um: Option<f64>,
}

impl SentPath {
    /// Sends the motions as they are.
    pub(super) fn full(motions: Vec<Motion>) -> Self {
        Self {
            source: Box::new(MotionList::from(motions)),
            to_start: ToStart::default(),
            resolution_um: None,
        }
    }

    /// Sends compact points after the motion to the first one, in steps of this length or as fine as the longest step allows.
    pub(super) fn compact(
        motions: &[Motion],
        path: &PathPoints,
        turn: [f64; 3],
        resolution_um: Option<f64>,
    ) -> anyhow::Result<Self> {
        let [to_first, points @ ..] = motions else { return Err(anyhow!("the path has no points")) };
        let first = points.first().ok_or_else(|| anyhow!("the path has one point only"))?;
        let line_of = |index: usize| path.points.get(index + 1).map_or(0, |point| point.line);
        if let Some(index) = points.iter().position(|motion| motion.velocity != first.velocity) {
            return Err(anyhow!(
                "line {}: point {index} has another speed than point 0, and compact points have one speed: give --speed",
                line_of(index)
            ));
        }
        let targets: Vec<[f64; 6]> = path
            .points
            .iter()
            .map(|point| {
                let [[x, y, z], [a, b, c]] = [point.place, point.turn.unwrap_or(turn)];
                [x, y, z, a, b, c]
            })
            .collect();
        let [origin, targets @ ..] = &targets[..] else { return Err(anyhow!("the path has no points")) };
        let resolution = resolution_um.map(resolution_of).transpose()?;
        let compact =
            CompactPath::like(first, *origin, targets, resolution).map_err(|error| match error {
                CompactError::Step { index, .. } | CompactError::NoWay { index, .. } => {
                    anyhow!("line {}: {error}", line_of(index))
                }
                CompactError::Head(_) => anyhow!("{error}"),
            })?;
        let resolution_um = Some(compact.head.resolution_um());
        Ok(Self {
            source: Box::new(PointList::from(compact)),
            to_start: ToStart { from_anywhere: Some(*to_first), from_end: Vec::new() },
            resolution_um,
        })
    }
}

fn resolution_of(length_um: f64) -> anyhow::Result<u16> {
    let steps = (length_um * 100.0).round();
    let range = f64::from(PointHead::FINEST)..=f64::from(PointHead::COARSEST);
    if !range.contains(&steps) {
        return Err(anyhow!("--resolution: {length_um} µm: must be 0.01 to 10"));
    }
    Ok(steps as u16)
}

/// Returns the ticks from the start of the points on, with counts that include the motion to the first point as the full form has it.
pub(super) fn with_first_point(ticks: &[RobotTick]) -> Vec<RobotTick> {
    // The robot shows the counts of the motion to the first point until it takes up the command.
    let began = ticks.iter().position(|tick| tick.sample.executed == 0).unwrap_or(ticks.len());
    let counted = ticks.iter().skip(began).copied().map(|mut tick| {
        tick.sample.executed += 1;
        tick.sample.accepted += 1;
        tick
    });
    counted.collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use protocol::image::MotionKind;

    use super::super::drive;
    use super::super::figures::{ProgrammedPath, TrajectoryFigures};

    fn motions(path: &PathPoints) -> Vec<Motion> {
        let motion = |kind, place: [f64; 3]| Motion {
            kind,
            target: [place[0], place[1], place[2], 0.0, 0.0, 180.0].map(|coordinate| coordinate as f32),
            velocity: 5_000,
            acceleration: 5_000,
            approximation: if kind == MotionKind::Spline { 50 } else { 0 },
            base: 1,
            ..Motion::EMPTY
        };
        let kinds = std::iter::once(MotionKind::PtpCartesian).chain(std::iter::repeat(MotionKind::Spline));
        kinds.zip(&path.points).map(|(kind, point)| motion(kind, point.place)).collect()
    }

    /// Points 0.25 mm apart on a circle of 60 mm.
    fn circle(points: u32) -> PathPoints {
        let point = |point: u32| {
            let angle = f64::from(point) * 0.25 / 60.0;
            format!("{:.6},{:.6},100\n", 150.0 + 60.0 * libm::cos(angle), 60.0 * libm::sin(angle))
        };
        PathPoints::from_csv(&(0..points).map(point).collect::<String>()).unwrap()
    }

    #[test]
    fn points_of_a_quarter_millimetre_pass_both_nodes_at_three_hundred_mm_per_s() {
        let setup = setup::setup("A").unwrap().with_queue_motions(128).with_compact_points();
        let setup = setup.with_refill(setup::Refill::Accepted);
        let path = circle(3_000);
        let sent = SentPath::compact(&motions(&path), &path, [0.0, 0.0, 180.0], None).unwrap();
        let programmed = ProgrammedPath {
            speed_mm_s: 500.0,
            acceleration_mm_s2: 5_000.0,
            is_lines: false,
            resolution_um: sent.resolution_um,
        };
        let recording = drive(&setup, sent, 1).unwrap();
        let ticks = with_first_point(recording.robot_ticks());
        let figures = TrajectoryFigures::of(&setup, &path, programmed, &ticks).unwrap();
        assert_eq!(ticks.last().map(|tick| tick.sample.executed), Some(3_000));
        assert!(figures.mean_mm_s >= 300.0 && figures.suppressed == 0, "{figures:?}");
        assert!(figures.deviation_mm < 0.02, "{figures:?}");
    }

    #[test]
    fn compact_points_are_those_of_the_full_form_within_half_a_step() {
        let path = circle(2_000);
        let full = motions(&path);
        let mut sent = SentPath::compact(&full, &path, [0.0, 0.0, 180.0], None).unwrap();
        let half_step = sent.resolution_um.unwrap() / 2_000.0;
        assert_eq!(sent.source.total() as usize, full.len() - 1);
        for (index, motion) in full[1..].iter().enumerate() {
            let point = sent.source.get(index as u32).unwrap();
            assert_eq!(Motion { target: motion.target, ..point }, *motion);
            for (one, other) in point.target.into_iter().zip(motion.target) {
                // Single precision rounds once in each form.
                let most = half_step + f64::from(f32::EPSILON) * f64::from(other.abs());
                assert!(
                    (f64::from(one) - f64::from(other)).abs() <= most,
                    "point {index}: {one} for {other}"
                );
            }
        }
    }

    #[test]
    fn a_list_that_has_no_compact_form_is_refused_with_its_line() {
        let refused = |text: &str, resolution| {
            let path = PathPoints::from_csv(text).unwrap();
            SentPath::compact(&motions(&path), &path, [0.0, 0.0, 180.0], resolution).unwrap_err().to_string()
        };
        insta::assert_snapshot!([
            refused("400,0,100\n401,0,100\n410,0,100\n", Some(0.1)),
            refused("400,0,100\n401,0,100\n401.004,0,100\n", Some(10.0)),
            refused("400,0,100\n401,0,100\n402,0,100\n", Some(11.0)),
        ].join("\n"), @"
        line 3: point 1: x is 9 mm from the point before: a difference carries at most 3.2767 mm; choose a coarser resolution or a closer spacing
        line 3: point 1 is where the point before it is, in steps of 10 µm: choose a finer resolution, or leave it out
        --resolution: 11 µm: must be 0.01 to 10
        ");
    }
}
