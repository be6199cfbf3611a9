use super::super::{Command, Control, Image, Skill};
use super::*;
use machine::wire::{BigEndian, LittleEndian};
use proptest::prelude::*;

fn head() -> PointHead {
    PointHead::of(
        &Motion {
            kind: MotionKind::Spline,
            target: [400.0, 0.0, 100.0, 0.0, 0.0, 180.0],
            velocity: 5_000,
            acceleration: 5_000,
            approximation: 50,
            base: 1,
            ..Motion::EMPTY
        },
        5,
        3,
    )
}

fn command(points: CompactPoints) -> Command {
    let control = Control::EXECUTE | Control::COMPACT;
    Command { control, skill: Skill::MoveTrajectory, slots: Slots::Points(points), ..Command::default() }
}

#[test]
fn a_million_differences_add_up_exactly_where_rounded_sums_drift() {
    let head = PointHead { origin: [0.0; 6], resolution: 3, ..head() };
    let mut sum = PointSum::default();
    for point in 0..1_000_000_i64 {
        sum.add([i16::MAX, -1, if point % 2 == 0 { 7 } else { -7 }, 0, 0, 0]);
    }
    assert_eq!(sum, PointSum([32_767_000_000, -1_000_000, 0, 0, 0, 0]));
    assert_eq!(sum.motion(&head).target, [983_010.0, -30.0, 0.0, 0.0, 0.0, 0.0]);
    let rounded = (0..1_000_000).fold(0.0_f32, |sum, _| sum - 3e-5);
    assert!((rounded + 30.0).abs() > 0.1, "{rounded}");
}

#[test]
fn the_points_of_a_long_path_stay_within_half_a_step_of_what_was_asked() {
    let head = PointHead { resolution: 1_000, ..head() };
    let mut sum = PointSum::default();
    for point in 1..=100_000 {
        let x = 400.0 + f64::from(point) * 0.0123;
        sum.advance(&head, [x, 0.0, 100.0, 0.0, 0.0, 180.0]).unwrap();
        let reached = f64::from(head.origin[0]) + sum.0[0] as f64 * 0.01;
        assert!((reached - x).abs() < 0.005 + 1e-9, "point {point}: {reached} for {x}");
    }
}

#[test]
fn a_point_that_is_too_far_is_refused_with_its_coordinate_and_adds_nothing() {
    let mut sum = PointSum::default();
    let refused = |sum: &mut PointSum, head: &PointHead, target| {
        let misfit = sum.advance(head, target).unwrap_err();
        assert_eq!(*sum, PointSum::default());
        misfit.to_string()
    };
    let far = refused(&mut sum, &head(), [400.0, -2.0, 100.0, 0.0, 0.0, 180.0]);
    assert_eq!(far, "y is -2 mm from the point before: a difference carries at most 1.63835 mm");
    let turned = refused(&mut sum, &head(), [400.0, 0.0, 100.0, 0.5, 0.0, 180.0]);
    assert_eq!(turned, "a is 0.5 degrees from the point before: a difference carries at most 0 degrees");
    assert!(
        sum.advance(&head(), [f64::NAN; 6]).is_err() && sum.advance(&head(), [f64::INFINITY; 6]).is_err()
    );
}

#[test]
fn a_head_that_no_robot_can_use_is_refused_with_the_field_and_its_limits() {
    let found =
        |head: PointHead| head.check().map_err(|(number, finding)| (u16::from(number), finding.index));
    assert_eq!(found(head()), Ok(()));
    assert_eq!(found(PointHead { resolution: 0, ..head() }), Err((44, 1)));
    assert_eq!(found(PointHead { resolution: 1_001, ..head() }), Err((44, 1)));
    assert_eq!(found(PointHead { coordinates: 4, ..head() }), Err((44, 2)));
    assert_eq!(found(PointHead { content: 1, ..head() }), Err((44, 3)));
    for kind in [MotionKind::None, MotionKind::PtpCartesian, MotionKind::Circular, MotionKind::Unknown(9)] {
        assert_eq!(found(PointHead { kind, ..head() }), Err((3, 0)));
    }
}

#[test]
fn the_bit_compact_acts_with_its_skill_only() {
    let mut image: Image = [0; IMAGE_LEN];
    command(CompactPoints::new(head())).emit::<BigEndian>(&mut image);
    let is_compact = |image: &Image| Command::parse::<BigEndian>(image).unwrap().slots.points().is_some();
    assert!(is_compact(&image));
    image[6] = 16;
    assert!(!is_compact(&image), "another skill");
    (image[0], image[6]) = (0, 18);
    assert!(!is_compact(&image), "without the bit");
}

proptest! {
    #[test]
    fn any_bytes_of_the_second_form_survive_a_round_trip(
        mut bytes in proptest::collection::vec(any::<u8>(), IMAGE_LEN),
    ) {
        (bytes[0], bytes[6]) = (bytes[0] | 1, 18);
        let mut image = [0; IMAGE_LEN];
        let command = Command::parse::<BigEndian>(&bytes).unwrap();
        prop_assert!(command.slots.points().is_some());
        command.emit::<BigEndian>(&mut image);
        bytes[32..36].fill(0);
        prop_assert_eq!(&image[..], &bytes[..]);
    }

    #[test]
    fn each_point_is_read_from_the_place_into_which_it_was_written(
        coordinates in proptest::sample::select(vec![3_u8, 6]),
        differences in proptest::collection::vec(any::<PointDifference>(), 1..100),
    ) {
        let mut points = CompactPoints::new(PointHead { coordinates, ..head() });
        let capacity = points.head.capacity() as usize;
        for (index, difference) in differences.iter().enumerate() {
            points.set_difference(index as u32, *difference);
            let mut image = [0; IMAGE_LEN];
            command(points).emit::<LittleEndian>(&mut image);
            let read = Command::parse::<LittleEndian>(&image).unwrap();
            let read = *read.slots.points().unwrap();
            let in_ring = differences.iter().enumerate().take(index + 1).skip((index + 1).saturating_sub(capacity));
            for (known, written) in in_ring {
                let mut expected = *written;
                if coordinates == 3 {
                    expected[3..].fill(0);
                }
                prop_assert_eq!(read.difference(known as u32), expected);
            }
        }
    }

    #[test]
    fn what_was_advanced_to_is_where_the_differences_lead(
        resolution in PointHead::FINEST..=PointHead::COARSEST,
        steps in proptest::collection::vec(proptest::array::uniform6(-0.3..0.3_f64), 1..50),
    ) {
        let head = PointHead { resolution, coordinates: 6, ..head() };
        let (mut planned, mut driven) = (PointSum::default(), PointSum::default());
        let mut target = head.origin.map(f64::from);
        for step in steps {
            target.iter_mut().zip(step).for_each(|(at, step)| *at += step);
            let Ok(difference) = planned.advance(&head, target) else { return Ok(()) };
            driven.add(difference);
            prop_assert_eq!(driven, planned);
            for (reached, wanted) in driven.motion(&head).target.into_iter().zip(target) {
                let half_step = f64::from(resolution) / 2e5;
                prop_assert!((f64::from(reached) - wanted).abs() <= half_step + 4e-5);
            }
        }
    }
}
