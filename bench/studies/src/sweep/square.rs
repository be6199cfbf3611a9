//! The synthetic application of the sweep: round and round a square, every side a motion of one length, every corner
//! blended.

use planning::{Application, Course, Labels, Place, Point, Segment, Step, Zones};

/// Returns a square in the frame of `application`, from where its tool stands at the start: `motions` sides of `side_mm`,
/// back at the start after each fourth. Only the last one ends in a stop.
pub(super) fn application(application: &Application, side_mm: f64, motions: u32) -> Application {
    let (start, tool) = &application.start;
    let corner = |index: u32| {
        let (x, y) = match index % 4 {
            0 => (0.0, 0.0),
            1 => (side_mm, 0.0),
            2 => (side_mm, -side_mm),
            _ => (0.0, -side_mm),
        };
        let pose = start.pose.at(start.pose.point + Point::new(x, y, 0.0));
        Place {
            name: format!("corner {}", index % 4),
            pose,
            grid: None,
            joints_deg: None,
            configuration: None,
        }
    };
    let step = Step {
        name: "square".to_owned(),
        does: format!("{motions} sides of {side_mm} mm"),
        labels: Labels { accurate_path: false, accurate_stop: true },
        tool: tool.clone(),
        base: None,
        course: Course::Follow {
            from: None,
            segments: (1..=motions).map(|index| Segment::Line(corner(index))).collect(),
            approach_mm: 0.0,
            retreat_mm: 0.0,
        },
        speed_mm_s: None,
        speed_percent: 100.0,
        then: None,
    };
    Application {
        name: "square".to_owned(),
        title: format!("{motions} motions of {side_mm} mm round a square, all blended"),
        base: application.base,
        start: (Place { grid: None, ..start.clone() }, tool.clone()),
        zones: Zones::default(),
        ways: None,
        grids: Vec::new(),
        obstacles: Vec::new(),
        surfaces: Vec::new(),
        waits: Vec::new(),
        unused: Vec::new(),
        steps: vec![step],
    }
}
