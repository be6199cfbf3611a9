use super::*;
use alloc::vec::Vec;
use machine::wire::{BigEndian, LittleEndian};
use proptest::prelude::*;

fn sample_motion() -> Motion {
    Motion {
        kind: MotionKind::Circular,
        target: [1.0, -2.0, 3.5, 0.0, 90.0, -180.0],
        auxiliary: [4.0, 5.0, 6.0],
        configuration: None,
        velocity: 2_500,
        acceleration: 5_000,
        deceleration: 0,
        jerk: 0,
        approximation: 1_000,
        tool: 1,
        base: 2,
    }
}

#[test]
fn a_motion_has_the_specified_44_bytes_in_either_byte_order() {
    let mut big = [0; MOTION_LEN];
    let mut writer = machine::wire::Writer::<BigEndian>::new(&mut big);
    sample_motion().emit(&mut writer);
    assert_eq!(writer.finish(), Ok(MOTION_LEN));
    #[rustfmt::skip]
    let expected = [
        0x3F, 0x80, 0, 0,  0xC0, 0, 0, 0,  0x40, 0x60, 0, 0,  0, 0, 0, 0,  0x42, 0xB4, 0, 0,  0xC3, 0x34, 0, 0,
        0x40, 0x80, 0, 0,  0x40, 0xA0, 0, 0,  0x40, 0xC0, 0, 0,
        0x09, 0xC4,  0x13, 0x88,  0x03, 0xE8,  4,  0x12,
    ];
    assert_eq!(big, expected);

    let mut little = [0; MOTION_LEN];
    sample_motion().emit(&mut machine::wire::Writer::<LittleEndian>::new(&mut little));
    assert_eq!(&little[..8], &[0, 0, 0x80, 0x3F, 0, 0, 0, 0xC0]);
    assert_eq!(&little[36..], &[0xC4, 0x09, 0x88, 0x13, 0xE8, 0x03, 4, 0x12]);
}

#[test]
fn without_a_point_or_a_force_the_first_six_auxiliary_bytes_are_configuration_deceleration_and_jerk() {
    let configuration = Some(Configuration { status: 2, turn: Some(35) });
    let kind = MotionKind::PtpCartesian;
    let (deceleration, jerk) = (0x0102, 0x0304);
    let motion = Motion { kind, auxiliary: [0.0; 3], configuration, deceleration, jerk, ..sample_motion() };
    let mut bytes = [0xFF; MOTION_LEN];
    motion.emit(&mut machine::wire::Writer::<BigEndian>::new(&mut bytes));
    assert_eq!(&bytes[24..36], &[0x82, 35, 1, 2, 3, 4, 0, 0, 0, 0, 0, 0]);
    let parse = |bytes: &[u8]| Motion::parse(&mut machine::wire::Reader::<BigEndian>::new(bytes)).unwrap();
    assert_eq!(parse(&bytes), motion);

    bytes[24] = 0x02;
    assert_eq!(parse(&bytes).configuration, None, "bit 7 says whether one is given");
    bytes[24] = 0xC2;
    assert_eq!(parse(&bytes).configuration, Some(Configuration { status: 2, turn: None }));
    bytes[24] = 0x82;
    bytes[42] = MotionKind::Circular.into();
    let circle = parse(&bytes);
    assert_eq!(
        (circle.configuration, circle.deceleration, circle.jerk),
        (None, 0, 0),
        "a circle's intermediate point takes all of the bytes"
    );
}

/// Clears the auxiliary bytes of a slot that no field carries.
fn clear_reserved(slot: &mut [u8]) {
    if !MotionKind::from(slot[42]).has_auxiliary() {
        match slot[24] & 0xC0 {
            0x80 => {}
            0xC0 => slot[25] = 0,
            _ => slot[24..26].fill(0),
        }
        slot[30..36].fill(0);
    }
}

#[test]
fn a_commands_head_has_the_specified_36_bytes() {
    let command = Command {
        control: Control::ENABLE | Control::EXECUTE,
        life: 0x0102,
        number: 0x0304,
        skill: Skill::MoveContinuous,
        override_percent: 100,
        total: 13,
        written: 5,
        program: 0x0506,
        outputs: 0x0708,
        start_time_ns: 0x0102_0304_0506_0708,
        law_time_us: 0x090A_0B0C,
        ..Command::default()
    };
    let mut image = [0xFF; IMAGE_LEN];
    command.emit::<BigEndian>(&mut image);
    #[rustfmt::skip]
    let head = [
        0, 3,  1, 2,  3, 4,  16, 100,  0, 0, 0, 13,  0, 0, 0, 5,  5, 6,  7, 8,
        1, 2, 3, 4, 5, 6, 7, 8,  9, 10, 11, 12,  0, 0, 0, 0,
    ];
    assert_eq!(&image[..HEAD_LEN], &head);
    assert!(image[HEAD_LEN..].iter().all(|byte| *byte == 0), "empty slots are zero");

    let mut other = [0xFF; IMAGE_LEN];
    command.emit_head::<BigEndian>(&mut other);
    assert_eq!(&other[..HEAD_LEN], &head);
    assert!(other[HEAD_LEN..].iter().all(|byte| *byte == 0xFF), "the slots stay as they were");
}

#[test]
fn a_feedbacks_head_has_the_specified_bytes() {
    let feedback = Feedback {
        status: Status::BUSY | Status::ENABLED,
        state: State::Running,
        override_percent: 50,
        number: 7,
        error: ErrorNumber::AxisLimit,
        executed: 3,
        accepted: 8,
        error_motion: 9,
        inputs: 0x1122,
        life_echo: 0x3344,
        life: 0x5566,
        blends_suppressed: 2,
        clock_ns: 1_000,
        execution_ns: 2_000,
        joints: [1.0; 6],
        pose: [2.0; 6],
        path_speed: 3.0,
        contact_force: 4.0,
        finding: Finding::new(5, 6.0, 7.0, 8.0),
        law_time_us: 0x0102_0304,
        queue_depth: 0x40,
        services: Services::SYNC | Services::KEEPS_ACCEPTED,
    };
    let mut image = [0xFF; IMAGE_LEN];
    feedback.emit::<LittleEndian>(&mut image);
    #[rustfmt::skip]
    let head = [
        0x21, 0,  2,  50,  7, 0,  15, 0,  3, 0, 0, 0,  8, 0, 0, 0,  9, 0, 0, 0,  0x22, 0x11,  0x44, 0x33,  0x66, 0x55,
        2, 0,  0xE8, 3, 0, 0, 0, 0, 0, 0,  0xD0, 7, 0, 0, 0, 0, 0, 0,
    ];
    assert_eq!(&image[..44], &head);
    assert_eq!(&image[88..96], &[0, 0, 0, 0x40, 0, 0, 0x40, 0x40]);
    let rest = [0, 0, 0x80, 0x40, 5, 0, 0, 0, 0, 0, 0xC0, 0x40, 0, 0, 0xE0, 0x40, 0, 0, 0, 0x41];
    assert_eq!(&image[96..116], &rest);
    assert_eq!(&image[116..128], &[0, 0, 0, 0, 4, 3, 2, 1, 0x40, 0, 5, 0]);
    assert!(image[128..].iter().all(|byte| *byte == 0));
    assert_eq!(Feedback::parse::<LittleEndian>(&image), Ok(feedback));
}

#[test]
fn motion_k_is_in_slot_k_mod_5() {
    let mut command = Command::default();
    for index in 0..7 {
        command.set_slot(index, Motion { velocity: index as u16, ..sample_motion() });
    }
    let Slots::Motions(slots) = command.slots else { panic!("these are motions") };
    let velocities = slots.map(|slot| slot.velocity);
    assert_eq!(velocities, [5, 6, 2, 3, 4]);
    assert_eq!([2, 3, 4, 5, 6].map(|index| command.slot(index).velocity), [2, 3, 4, 5, 6]);
}

#[test]
fn a_motions_figures_are_in_mm_and_seconds_or_shares_of_what_is_rated() {
    let motion = Motion { deceleration: 4_000, jerk: 3_000, ..sample_motion() };
    assert_eq!((motion.velocity_mm_s(), motion.velocity_share()), (250.0, 0.25));
    assert_eq!((motion.acceleration_mm_s2(), motion.acceleration_share()), (5_000.0, 0.5));
    assert_eq!((motion.deceleration_mm_s2(), motion.deceleration_share()), (Some(4_000.0), Some(0.4)));
    assert_eq!((motion.jerk_mm_s3(), motion.jerk_share()), (Some(30_000.0), Some(0.3)));
    assert_eq!(motion.approximation_mm(), 10.0);
    // A deceleration and a jerk of 0 are the robot's to choose.
    let motion = sample_motion();
    assert_eq!((motion.deceleration_mm_s2(), motion.deceleration_share()), (None, None));
    assert_eq!((motion.jerk_mm_s3(), motion.jerk_share()), (None, None));
    assert_eq!(motion.buffer_len(), MOTION_LEN);
}

/// Returns the known and some unknown kinds for which a question has the answer yes.
fn kinds_with(question: impl Fn(MotionKind) -> bool) -> Vec<MotionKind> {
    (0..=u8::MAX).map(MotionKind::from).filter(|kind| question(*kind)).collect()
}

#[test]
fn each_question_about_a_kind_has_the_answer_that_its_row_gives() {
    use MotionKind::{Circular, LinCartesian, LinForceCartesian, PtpCartesian, PtpJoint, Spline};

    let standard: Vec<_> = MotionKind::standard().collect();
    assert_eq!(standard, [LinCartesian, PtpCartesian, PtpJoint, Circular, Spline, LinForceCartesian]);
    assert_eq!(kinds_with(|kind| kind.traits().is_some()), standard);
    assert_eq!(kinds_with(MotionKind::is_point_to_point), [PtpCartesian, PtpJoint]);
    assert_eq!(kinds_with(MotionKind::has_joint_target), [PtpJoint]);
    assert_eq!(kinds_with(MotionKind::has_configuration), [LinCartesian, PtpCartesian, Spline]);
    assert_eq!(kinds_with(MotionKind::has_force), [LinForceCartesian]);
    let mut known = kinds_with(MotionKind::has_auxiliary);
    known.retain(|kind| standard.contains(kind));
    assert_eq!(known, [Circular, LinForceCartesian]);
    // A slot that nobody understands is passed on as it came.
    assert!([0, 200, u8::MAX].map(MotionKind::from).into_iter().all(MotionKind::has_auxiliary));
}

#[test]
fn the_skill_of_a_kind_has_its_code_and_leads_back_to_it() {
    for kind in MotionKind::standard() {
        let skill = kind.skill();
        assert_eq!((u8::from(skill), skill.motion_kind()), (kind.into(), Some(kind)));
    }
    let single = Skill::NAMED.iter().filter_map(|skill| skill.motion_kind());
    assert!(single.eq(MotionKind::standard()), "a skill of one motion executes a standard kind");
    assert_eq!([MotionKind::None, MotionKind::Unknown(16)].map(MotionKind::skill), [Skill::None; 2]);
}

#[test]
fn a_findings_figures_are_those_that_it_was_made_of() {
    let finding = Finding::new(5, 6.0, 7.0, 8.0);
    assert_eq!((finding.index, finding.value(), finding.lower(), finding.upper()), (5, 6.0, 7.0, 8.0));
}

#[test]
fn an_image_is_read_in_the_byte_order_in_which_it_was_written_and_not_in_the_other() {
    let mut command = Command { life: 0x0102, number: 0x0304, total: 7, ..Command::default() };
    command.set_slot(0, sample_motion());
    let head = Command { slots: Slots::EMPTY, ..command };
    let feedback = Feedback { number: 0x0304, clock_ns: 5, joints: [1.0; 6], ..Feedback::default() };
    for (order, other) in [(Order::BigEndian, Order::LittleEndian), (Order::LittleEndian, Order::BigEndian)] {
        let mut image = [0; IMAGE_LEN];
        order.emit_command(&command, &mut image);
        assert_eq!(order.parse_command(&image), Ok(command));
        assert_eq!(order.parse_command_head(&image), Ok(head));
        assert_eq!(other.parse_command_head(&image).map(|command| command.number), Ok(0x0403));
        let mut image = [0; IMAGE_LEN];
        order.emit_command_head(&command, &mut image);
        assert_eq!(order.parse_command(&image), Ok(head));
        order.emit_feedback(&feedback, &mut image);
        assert_eq!(order.parse_feedback(&image), Ok(feedback));
        assert_eq!((order.feedback_clock(&image), other.feedback_clock(&image)), (5, 5 << 56));
        assert_eq!(other.parse_feedback(&image).map(|feedback| feedback.number), Ok(0x0403));
    }
}

proptest! {
    /// All bytes of an image's length can be parsed, and writing the result gives the same bytes where they have a
    /// meaning: unknown codes are kept.
    #[test]
    fn any_256_bytes_survive_a_round_trip(mut bytes in proptest::collection::vec(any::<u8>(), IMAGE_LEN)) {
        let mut image = [0; IMAGE_LEN];
        if bytes[6] == 18 {
            bytes[0] &= !1; // the second form is in `points`
        }
        let command = Command::parse::<BigEndian>(&bytes).unwrap();
        command.emit::<BigEndian>(&mut image);
        bytes[32..36].fill(0);
        bytes[HEAD_LEN..].chunks_exact_mut(MOTION_LEN).for_each(clear_reserved);
        prop_assert_eq!(&image[..], &bytes[..]);

        let feedback = Feedback::parse::<LittleEndian>(&bytes).unwrap();
        feedback.emit::<LittleEndian>(&mut image);
        bytes[101..104].fill(0);
        bytes[116..120].fill(0);
        bytes[128..].fill(0);
        prop_assert_eq!(&image[..], &bytes[..]);
    }

    #[test]
    fn a_motion_of_a_known_kind_survives_a_round_trip(
        kind in proptest::sample::select(MotionKind::standard().collect::<Vec<_>>()),
        numbers in any::<[u16; 5]>(),
        coordinates in proptest::array::uniform9(-1e6..1e6_f32),
        given in proptest::option::of((0..=Configuration::HIGHEST_STATUS, any::<Option<u8>>())),
    ) {
        let [velocity, acceleration, approximation, deceleration, jerk] = numbers;
        let [a, b, c, d, e, f, point @ ..] = coordinates;
        let has_auxiliary = kind.has_auxiliary();
        let configuration = given.map(|(status, turn)| Configuration { status, turn });
        let motion = Motion {
            kind,
            target: [a, b, c, d, e, f],
            auxiliary: if has_auxiliary { point } else { [0.0; 3] },
            configuration: configuration.filter(|_| !has_auxiliary),
            velocity,
            acceleration,
            deceleration: if has_auxiliary { 0 } else { deceleration },
            jerk: if has_auxiliary { 0 } else { jerk },
            approximation,
            ..sample_motion()
        };
        let mut bytes = [0xFF; MOTION_LEN];
        motion.emit(&mut machine::wire::Writer::<LittleEndian>::new(&mut bytes));
        prop_assert_eq!(Motion::parse(&mut machine::wire::Reader::<LittleEndian>::new(&bytes)), Ok(motion));
    }

    #[test]
    fn a_shorter_image_is_refused(len in 0..IMAGE_LEN) {
        prop_assert!(Command::parse::<BigEndian>(&[0; IMAGE_LEN][..len]).is_err());
        prop_assert_eq!(Feedback::parse::<BigEndian>(&[0; IMAGE_LEN][..len]).is_err(), len < 128);
    }
}
