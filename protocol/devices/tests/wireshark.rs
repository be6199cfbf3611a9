//! The dissector for Wireshark shows what our decoder reads: every field, on each bus, in tshark.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::PathBuf;

use protocol::image::{
    Command, CommandSealer, CompactPoints, Configuration, Control, Feedback, FeedbackSealer, Finding,
    IMAGE_LEN, Image, Motion, MotionKind, Order, PointHead, Services, Skill, Slots, State, Status,
};

/// FrameForm of one bus: what stands around an image.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum FrameForm {
    ProfinetRaw,
    ProfinetUdp,
    EthernetIp,
    EtherCat,
}

const FRAME_FORMS: [FrameForm; 4] =
    [FrameForm::ProfinetRaw, FrameForm::ProfinetUdp, FrameForm::EthernetIp, FrameForm::EtherCat];

impl FrameForm {
    const fn order(self) -> Order {
        match self {
            Self::ProfinetRaw | Self::ProfinetUdp => Order::BigEndian,
            Self::EthernetIp | Self::EtherCat => Order::LittleEndian,
        }
    }

    /// Returns a frame with an image. Other submodules' data, a sequence count or a run/idle header stand before it.
    fn frame(self, is_command: bool, image: &Image) -> Vec<u8> {
        let source = if is_command { 1 } else { 2 };
        let mut frame = vec![2, 0, 0, 0, 0, 9, 2, 0, 0, 0, 0, source];
        match self {
            Self::ProfinetRaw => {
                frame.extend([0x88, 0x92, 0x80, source]);
                frame.extend([0x80, 0x80, 0x80]);
                frame.extend(image);
                frame.extend([0x80, 0, 1, 0x35, 0]);
            }
            Self::ProfinetUdp => {
                let mut payload = vec![0xC0, source, 0x80, 0x80, 0x80];
                payload.extend(image);
                payload.extend([0x80, 0, 1, 0x35, 0]);
                frame.extend(udp(source, 0x8892, &payload));
            }
            Self::EthernetIp => {
                let mut payload = vec![2, 0, 2, 0x80, 8, 0, source, 0, 0, 0, 7, 0, 0, 0, 0xB1, 0];
                let head = if is_command { 6 } else { 2 };
                payload.extend(u16::to_le_bytes(256 + head));
                payload.extend([7, 0]);
                if is_command {
                    payload.extend([1, 0, 0, 0]);
                }
                payload.extend(image);
                frame.extend(udp(source, 2222, &payload));
            }
            Self::EtherCat => {
                let (command, counter) = if is_command { (11, 0) } else { (10, 1) };
                frame.extend([0x88, 0xA4]);
                frame.extend(u16::to_le_bytes(0x1000 | (12 + 258)));
                frame.extend([command, 0, 0, 0, 0, 0]);
                frame.extend(u16::to_le_bytes(258));
                frame.extend([0, 0, 0xAA, 0xAA]);
                frame.extend(image);
                frame.extend([counter, 0]);
            }
        }
        frame
    }
}

/// Returns a datagram of IPv4 and UDP; its checksums are 0, which no dissector checks by default.
fn udp(host: u8, port: u16, payload: &[u8]) -> Vec<u8> {
    let len = payload.len() as u16;
    let mut packet = vec![0x08, 0x00, 0x45, 0];
    packet.extend((28 + len).to_be_bytes());
    packet.extend([0, 0, 0, 0, 64, 17, 0, 0, 10, 0, 0, host, 10, 0, 0, 9]);
    packet.extend(port.to_be_bytes());
    packet.extend(port.to_be_bytes());
    packet.extend((8 + len).to_be_bytes());
    packet.extend([0, 0]);
    packet.extend(payload);
    packet
}

/// A sequence of numbers that looks random.
struct ImageSource(u64);

impl ImageSource {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        self.0 >> 24
    }

    /// A number that a short decimal text has exactly.
    fn real(&mut self) -> f32 {
        (self.next() % 8_000) as f32 / 4.0 - 1_000.0
    }

    fn reals<const N: usize>(&mut self) -> [f32; N] {
        std::array::from_fn(|_| self.real())
    }

    fn motion(&mut self) -> Motion {
        let kind = MotionKind::NAMED[self.next() as usize % MotionKind::NAMED.len()];
        let mut motion = Motion {
            kind,
            target: self.reals(),
            velocity: self.next() as u16,
            acceleration: self.next() as u16,
            approximation: self.next() as u16,
            tool: self.next() as u8 % 16,
            base: self.next() as u8 % 16,
            ..Motion::EMPTY
        };
        if kind.has_auxiliary() {
            motion.auxiliary = self.reals();
        } else {
            motion.deceleration = self.next() as u16;
            motion.jerk = self.next() as u16;
        }
        if kind.has_configuration() {
            motion.configuration =
                Some(Configuration { status: self.next() as u8 % 8, turn: Some(self.next() as u8) });
        }
        motion
    }

    fn points(&mut self) -> CompactPoints {
        let head = PointHead {
            origin: self.reals(),
            velocity: self.next() as u16,
            acceleration: self.next() as u16,
            deceleration: self.next() as u16,
            jerk: self.next() as u16,
            approximation: self.next() as u16,
            kind: MotionKind::NAMED[self.next() as usize % MotionKind::NAMED.len()],
            tool: self.next() as u8 % 16,
            base: self.next() as u8 % 16,
            resolution: self.next() as u16,
            coordinates: self.next() as u8,
            content: self.next() as u8,
        };
        CompactPoints { head, ring: std::array::from_fn(|_| self.next() as i16) }
    }

    fn command(&mut self) -> Command {
        let mut command = self.command_of_motions();
        if self.next().is_multiple_of(4) {
            command.skill = Skill::MoveTrajectory;
            command.control.set(Control::COMPACT, true);
        }
        if command.is_compact() {
            command.slots = Slots::Points(self.points());
        }
        command
    }

    fn command_of_motions(&mut self) -> Command {
        Command {
            control: Control(self.next() as u16),
            life: self.next() as u16 | 1,
            number: self.next() as u16,
            skill: Skill::NAMED[self.next() as usize % Skill::NAMED.len()],
            override_percent: self.next() as u8,
            total: self.next() as u32,
            written: self.next() as u32,
            program: self.next() as u16,
            outputs: self.next() as u16,
            start_time_ns: self.next(),
            law_time_us: self.next() as u32,
            slots: Slots::Motions(std::array::from_fn(|_| self.motion())),
        }
    }

    fn feedback(&mut self) -> Feedback {
        Feedback {
            status: Status(self.next() as u16),
            state: State::NAMED[self.next() as usize % State::NAMED.len()],
            override_percent: self.next() as u8,
            number: self.next() as u16,
            error: (self.next() as u16 % 42).into(),
            executed: self.next() as u32,
            accepted: self.next() as u32,
            error_motion: self.next() as u32,
            inputs: self.next() as u16,
            life_echo: self.next() as u16,
            life: self.next() as u16 | 1,
            blends_suppressed: self.next() as u16,
            clock_ns: self.next(),
            execution_ns: self.next(),
            joints: self.reals(),
            pose: self.reals(),
            path_speed: self.real(),
            contact_force: self.real(),
            finding: Finding::new(self.next() as u8, self.real(), self.real(), self.real()),
            law_time_us: self.next() as u32,
            queue_depth: self.next() as u16,
            services: Services(self.next() as u16),
        }
    }
}

/// Values of a field by its filter's name, in the order in which they stand in the image.
type Values = Vec<(&'static str, Vec<String>)>;

fn text(value: impl ToString) -> Vec<String> {
    vec![value.to_string()]
}

fn texts<T: ToString>(values: impl IntoIterator<Item = T>) -> Vec<String> {
    values.into_iter().map(|value| value.to_string()).collect()
}

fn command_values(image: &Image, order: Order) -> Values {
    let command = order.parse_command(image).unwrap();
    let slots = match &command.slots {
        Slots::Motions(slots) => &slots[..],
        Slots::Points(_) => &[],
    };
    let points: Vec<_> = command.slots.points().into_iter().collect();
    let heads: Vec<_> = points.iter().map(|points| points.head).collect();
    let motions: Vec<_> = slots.iter().filter(|motion| motion.kind != MotionKind::None).collect();
    let options: Vec<_> = motions.iter().filter(|motion| !motion.kind.has_auxiliary()).collect();
    let auxiliary = |with_force: bool| {
        let kinds = motions
            .iter()
            .filter(move |motion| motion.kind.has_auxiliary() && motion.kind.has_force() == with_force);
        texts(kinds.flat_map(|motion| motion.auxiliary))
    };
    vec![
        ("skillbench.command.control", vec![format!("0x{:04x}", command.control.0)]),
        ("skillbench.command.control.enable", text(command.control.contains(Control::ENABLE))),
        ("skillbench.command.control.sync", text(command.control.contains(Control::SYNC))),
        ("skillbench.command.life_counter", text(command.life)),
        ("skillbench.command.command_number", text(command.number)),
        ("skillbench.command.skill", text(u8::from(command.skill))),
        ("skillbench.command.override", text(command.override_percent)),
        ("skillbench.command.total", text(command.total)),
        ("skillbench.command.written", text(command.written)),
        ("skillbench.command.program_number", text(command.program)),
        ("skillbench.command.digital_outputs", vec![format!("0x{:04x}", command.outputs)]),
        ("skillbench.command.start_time", text(command.start_time_ns)),
        ("skillbench.command.law_time", text(command.law_time_us)),
        ("skillbench.motion.target", texts(motions.iter().flat_map(|motion| motion.target))),
        ("skillbench.motion.point", auxiliary(false)),
        ("skillbench.motion.force", auxiliary(true)),
        (
            "skillbench.motion.turn",
            texts(options.iter().map(|motion| motion.configuration.and_then(|it| it.turn).unwrap_or(0))),
        ),
        ("skillbench.motion.deceleration", texts(options.iter().map(|motion| motion.deceleration))),
        ("skillbench.motion.jerk", texts(options.iter().map(|motion| motion.jerk))),
        ("skillbench.motion.velocity", texts(motions.iter().map(|motion| motion.velocity))),
        ("skillbench.motion.acceleration", texts(motions.iter().map(|motion| motion.acceleration))),
        ("skillbench.motion.approximation", texts(motions.iter().map(|motion| motion.approximation))),
        ("skillbench.motion.kind", texts(motions.iter().map(|motion| u8::from(motion.kind)))),
        (
            "skillbench.motion.tool_and_base",
            texts(motions.iter().map(|motion| 16 * motion.tool + motion.base)),
        ),
        ("skillbench.points.origin", texts(heads.iter().flat_map(|head| head.origin))),
        ("skillbench.points.velocity", texts(heads.iter().map(|head| head.velocity))),
        ("skillbench.points.acceleration", texts(heads.iter().map(|head| head.acceleration))),
        ("skillbench.points.deceleration", texts(heads.iter().map(|head| head.deceleration))),
        ("skillbench.points.jerk", texts(heads.iter().map(|head| head.jerk))),
        ("skillbench.points.zone", texts(heads.iter().map(|head| head.approximation))),
        ("skillbench.points.kind", texts(heads.iter().map(|head| u8::from(head.kind)))),
        ("skillbench.points.tool_and_base", texts(heads.iter().map(|head| 16 * head.tool + head.base))),
        ("skillbench.points.resolution", texts(heads.iter().map(|head| head.resolution))),
        ("skillbench.points.coordinates", texts(heads.iter().map(|head| head.coordinates))),
        ("skillbench.points.content", texts(heads.iter().map(|head| head.content))),
        ("skillbench.points.ring", texts(points.iter().flat_map(|points| points.ring))),
    ]
}

fn feedback_values(image: &Image, order: Order) -> Values {
    let feedback = order.parse_feedback(image).unwrap();
    vec![
        ("skillbench.feedback.status", vec![format!("0x{:04x}", feedback.status.0)]),
        ("skillbench.feedback.status.busy", text(feedback.status.contains(Status::BUSY))),
        ("skillbench.feedback.status.warning", text(feedback.status.contains(Status::WARNING))),
        ("skillbench.feedback.state", text(u8::from(feedback.state))),
        ("skillbench.feedback.override", text(feedback.override_percent)),
        ("skillbench.feedback.command_number", text(feedback.number)),
        ("skillbench.feedback.error_number", text(u16::from(feedback.error))),
        ("skillbench.feedback.executed", text(feedback.executed)),
        ("skillbench.feedback.accepted", text(feedback.accepted)),
        ("skillbench.feedback.error_motion", text(feedback.error_motion)),
        ("skillbench.feedback.digital_inputs", vec![format!("0x{:04x}", feedback.inputs)]),
        ("skillbench.feedback.life_counter_echo", text(feedback.life_echo)),
        ("skillbench.feedback.life_counter", text(feedback.life)),
        ("skillbench.feedback.blends_suppressed", text(feedback.blends_suppressed)),
        ("skillbench.feedback.clock", text(feedback.clock_ns)),
        ("skillbench.feedback.execution_time", text(feedback.execution_ns)),
        ("skillbench.feedback.joints", texts(feedback.joints)),
        ("skillbench.feedback.pose", texts(feedback.pose)),
        ("skillbench.feedback.path_speed", text(feedback.path_speed)),
        ("skillbench.feedback.contact_force", text(feedback.contact_force)),
        ("skillbench.feedback.error_index", text(feedback.finding.index)),
        ("skillbench.feedback.error_value", text(feedback.finding.value())),
        ("skillbench.feedback.error_lower_limit", text(feedback.finding.lower())),
        ("skillbench.feedback.error_upper_limit", text(feedback.finding.upper())),
        ("skillbench.feedback.law_time", text(feedback.law_time_us)),
        ("skillbench.feedback.queue_depth", text(feedback.queue_depth)),
        ("skillbench.feedback.services", vec![format!("0x{:04x}", feedback.services.0)]),
        ("skillbench.feedback.services.sync", text(feedback.services.contains(Services::SYNC))),
        ("skillbench.feedback.services.compact", text(feedback.services.contains(Services::COMPACT))),
        (
            "skillbench.feedback.services.keeps_accepted",
            text(feedback.services.contains(Services::KEEPS_ACCEPTED)),
        ),
    ]
}

fn script() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(devices::wireshark::FILE_NAME)
}

/// Versions of tshark print a bit as 1 or as True.
fn without_capitals(read: &str) -> Vec<String> {
    let value = |text: &str| match text {
        "1" | "True" => "true".to_owned(),
        "0" | "False" => "false".to_owned(),
        other => other.to_owned(),
    };
    read.split(',').filter(|text| !text.is_empty()).map(value).collect()
}

fn image_of(numbers: &mut ImageSource, is_command: bool, order: Order) -> Image {
    let mut image = [0; IMAGE_LEN];
    if is_command {
        order.emit_command(&numbers.command(), &mut image);
        let mut sealer = CommandSealer::default();
        sealer.take_tail(&image);
        sealer.seal(order, &mut image);
    } else {
        order.emit_feedback(&numbers.feedback(), &mut image);
        let mut sealer = FeedbackSealer::default();
        sealer.take_tail(&image);
        sealer.seal(order, &mut image);
    }
    image
}

#[test]
fn every_field_of_an_image_is_what_our_decoder_reads_on_each_bus() {
    let mut numbers = ImageSource(7);
    let (mut frames, mut images) = (Vec::new(), Vec::new());
    for wire in FRAME_FORMS {
        for index in 0..40 {
            let is_command = index % 2 == 0;
            let image = image_of(&mut numbers, is_command, wire.order());
            frames.push(wire.frame(is_command, &image));
            images.push((wire, is_command, image));
        }
    }
    for is_command in [true, false] {
        let values = |wire: FrameForm, image: &Image| {
            if is_command {
                command_values(image, wire.order())
            } else {
                feedback_values(image, wire.order())
            }
        };
        let names: Vec<_> =
            values(FrameForm::ProfinetRaw, &[0; IMAGE_LEN]).into_iter().map(|(name, _)| name).collect();
        let read = dissector::read_with(&script(), &frames, names.iter().copied());
        assert_eq!(read.len(), frames.len());
        for ((wire, of_command, image), row) in images.iter().zip(&read) {
            if *of_command != is_command {
                continue;
            }
            for ((name, expected), cell) in values(*wire, image).into_iter().zip(row) {
                let is_bit = expected.first().is_some_and(|value| value == "true" || value == "false");
                let cell = if is_bit {
                    without_capitals(cell)
                } else {
                    texts(cell.split(',').filter(|it| !it.is_empty()))
                };
                assert_eq!(cell, expected, "{name} on {wire:?}");
            }
        }
    }
}

#[test]
fn every_field_of_the_tables_is_compared() {
    let filters = std::fs::read_to_string(script()).unwrap();
    let (command, feedback) = (
        command_values(&[0; IMAGE_LEN], Order::BigEndian),
        feedback_values(&[0; IMAGE_LEN], Order::BigEndian),
    );
    for (prefix, fields) in [
        ("skillbench.command", protocol::image::COMMAND_FIELDS),
        ("skillbench.feedback", protocol::image::FEEDBACK_FIELDS),
        ("skillbench.motion", protocol::image::MOTION_FIELDS),
        ("skillbench.motion", protocol::image::OPTION_FIELDS),
        ("skillbench.points", protocol::image::POINT_FIELDS),
    ] {
        for field in fields {
            let name = format!("{prefix}.{}", field.name.replace(' ', "_"));
            let is_compared = command.iter().chain(&feedback).any(|(filter, _)| *filter == name);
            // The checks are the next test's, the auxiliary bytes are shown as what the kind has there, and the bits of a
            // configuration's status differ by whether it is given.
            let is_other = ["check", "auxiliary", "reserved", "status"].contains(&field.name)
                || field.name.starts_with("slot");
            assert!(is_compared || is_other, "{name} is in no test");
        }
    }
    assert!(filters.contains("skillbench.check_state"));
}

#[test]
fn a_wrong_check_is_shown_as_such_where_images_were_found_and_a_frame_of_others_is_no_image() {
    for wire in FRAME_FORMS {
        let mut numbers = ImageSource(11);
        let order = wire.order();
        let good = image_of(&mut numbers, true, order);
        let (mut altered, mut unchecked) = (good, good);
        altered[200] ^= 4;
        unchecked[32..36].fill(0);
        let others = [0x55; IMAGE_LEN];
        let frames = [&others, &unchecked, &good, &altered, &unchecked].map(|image| wire.frame(true, image));
        let read = dissector::read_with(&script(), &frames, ["skillbench.check_state", "_ws.expert.message"]);
        let states: Vec<_> = read.iter().map(|row| row[0].as_str()).collect();
        assert_eq!(states, ["", "", "1", "2", "0"], "{wire:?}");
        assert!(read[3][1].contains("The check is wrong"), "{wire:?}: {:?}", read[3]);
        assert_eq!(read.iter().filter(|row| row[1].contains("check is wrong")).count(), 1, "{wire:?}");
    }
}
