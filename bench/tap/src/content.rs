//! ImageDirection and place of the image, from the bytes alone: for a capture without the start of the connection.
//!
//! An image with a right check tells both at once. Without checks a place is accepted when its counters move and it holds, in
//! all frames, only what one of the two images may hold.

use protocol::image::{
    Command, CommandChecker, CompactPoints, Control, Feedback, FeedbackChecker, IMAGE_LEN, Image, MotionKind,
    Order, Skill, Slots, State, Verdict,
};

/// ImageDirection of images.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum ImageDirection {
    /// From the PLC to the robot.
    Command,
    /// From the robot to the PLC.
    Feedback,
}

/// Frames in which checks are looked for at every place: they cost some hundred sums each.
const SEARCHED_FRAMES: u32 = 64;

/// Frames after which the search by content ends.
const MAX_FRAMES: u32 = 20_000;

/// Changes of its life counter after which a place without a check is accepted, and most of those that the other image may show
/// there.
const MOVES: u32 = 64;
const FEW_MOVES: u32 = 8;

/// Places in a frame that may hold an image: after the statuses of some modules.
const MAX_PLACES: usize = 256;

/// Search for the image in the frames of one connection and direction.
#[derive(Clone, Default, Debug)]
pub(crate) struct ContentSearch {
    frames: u32,
    places: Vec<ImagePlace>,
}

/// Evidence of one place in the frames so far.
#[derive(Clone, Copy, Default, Debug)]
struct ImagePlace {
    command: Hypothesis,
    feedback: Hypothesis,
}

#[derive(Clone, Copy, Default, Debug)]
struct Hypothesis {
    is_refuted: bool,
    life: u16,
    moves: u32,
}

impl Hypothesis {
    fn add(&mut self, life: Option<u16>) {
        match life {
            None => self.is_refuted = true,
            Some(life) => {
                self.moves += u32::from(life != self.life);
                self.life = life;
            }
        }
    }

    const fn holds_against(&self, other: &Self) -> bool {
        !self.is_refuted && self.moves >= MOVES && (other.is_refuted || other.moves < FEW_MOVES)
    }
}

impl ContentSearch {
    /// Adds a frame; returns the direction and the place of the image once both are certain.
    pub(crate) fn add(&mut self, order: Order, body: &[u8]) -> Option<(ImageDirection, usize)> {
        if self.frames >= MAX_FRAMES {
            return None;
        }
        self.frames += 1;
        let places = (body.len() + 1).saturating_sub(IMAGE_LEN).min(MAX_PLACES);
        if self.frames == 1 {
            self.places.resize(places, ImagePlace::default());
        }
        if places != self.places.len() {
            // One connection has frames of one length.
            self.frames = MAX_FRAMES;
            return None;
        }
        let images = body.windows(IMAGE_LEN).take(places).enumerate();
        let images = images.filter_map(|(at, bytes)| Some((at, <&Image>::try_from(bytes).ok()?)));
        if self.frames <= SEARCHED_FRAMES {
            let by_check = images.clone().find_map(|(at, image)| Some((checked(order, image)?, at)));
            if by_check.is_some() {
                return by_check;
            }
        }
        for ((_, image), place) in images.zip(&mut self.places) {
            if !place.command.is_refuted {
                place.command.add(command_life(order, image));
            }
            if !place.feedback.is_refuted {
                place.feedback.add(feedback_life(order, image));
            }
        }
        self.only_place()
    }

    /// Returns whether a later frame can still show where the image is.
    pub(crate) const fn is_open(&self) -> bool {
        self.frames < MAX_FRAMES
    }

    /// Returns the only place with the only image that may be there.
    fn only_place(&self) -> Option<(ImageDirection, usize)> {
        let found = |place: &ImagePlace| {
            if place.command.holds_against(&place.feedback) {
                Some(ImageDirection::Command)
            } else if place.feedback.holds_against(&place.command) {
                Some(ImageDirection::Feedback)
            } else {
                None
            }
        };
        let mut all = self.places.iter().enumerate().filter_map(|(at, place)| Some((found(place)?, at)));
        let first = all.next()?;
        all.next().is_none().then_some(first)
    }
}

/// Returns the direction of an image with a right check.
fn checked(order: Order, image: &Image) -> Option<ImageDirection> {
    if CommandChecker::default().verify(order, image) == Verdict::Intact {
        return Some(ImageDirection::Command);
    }
    (FeedbackChecker::default().verify(order, image) == Verdict::Intact).then_some(ImageDirection::Feedback)
}

/// Returns the life counter of what may be a command.
fn command_life(order: Order, image: &Image) -> Option<u16> {
    let command = order.parse_command(image).ok()?;
    // Elsewhere the bit would let an image begin one byte too early.
    let high_bits = if command.is_compact() { Control::COMPACT.0 } else { 0 };
    let Command { control, life, skill, override_percent, total, written, slots, .. } = command;
    let is_known = |kind: MotionKind| !matches!(kind, MotionKind::Unknown(_));
    let is_point_finite = |target: &[f32; 6]| target.iter().all(|value| value.is_finite());
    let hold = match &slots {
        Slots::Motions(slots) => {
            slots.iter().all(|slot| is_known(slot.kind) && is_point_finite(&slot.target))
        }
        Slots::Points(CompactPoints { head, .. }) => head.check().is_ok() && is_point_finite(&head.origin),
    };
    let is_command = control.0 & !high_bits <= 0xFF
        && !matches!(skill, Skill::Unknown(_))
        && override_percent <= 100
        && written <= total
        && hold;
    is_command.then_some(life)
}

/// Returns the life counter of what may be a feedback.
fn feedback_life(order: Order, image: &Image) -> Option<u16> {
    let feedback = order.parse_feedback(image).ok()?;
    let Feedback { status, state, override_percent, life, joints, pose, .. } = feedback;
    // Bytes that are zero in every feedback.
    let zeros = image.iter().enumerate().filter(|(at, _)| matches!(at, 101..104 | 124..126 | 128..));
    let is_feedback = status.0 <= 0x7F
        && !matches!(state, State::Unknown(_))
        && override_percent <= 100
        && joints.iter().chain(&pose).all(|value| value.is_finite())
        && zeros.into_iter().all(|(_, byte)| *byte == 0);
    is_feedback.then_some(life)
}

#[cfg(test)]
mod tests {
    use super::*;
    use protocol::image::{CommandSealer, Motion, Status};

    fn body(image: &Image) -> Vec<u8> {
        // Statuses of three modules before it, and of one after it.
        [&[0x80; 3][..], image, &[0x80, 0x12, 0x34, 0x35, 0]].concat()
    }

    fn command(life: u16) -> Command {
        let mut command = Command { control: Control::ENABLE, life, number: 7, ..Command::default() };
        command.set_slot(0, Motion { kind: MotionKind::PtpJoint, target: [10.5; 6], ..Motion::EMPTY });
        command
    }

    #[test]
    fn one_image_with_a_right_check_tells_direction_and_place() {
        let mut image = [0; IMAGE_LEN];
        Order::BigEndian.emit_command(&command(3), &mut image);
        let mut sealer = CommandSealer::default();
        sealer.take_tail(&image);
        sealer.seal(Order::BigEndian, &mut image);
        let found = ContentSearch::default().add(Order::BigEndian, &body(&image));
        assert_eq!(found, Some((ImageDirection::Command, 3)));
    }

    #[test]
    fn images_without_checks_are_told_apart_by_what_moves() {
        for order in [Order::BigEndian, Order::LittleEndian] {
            let (mut commands, mut feedbacks) = (ContentSearch::default(), ContentSearch::default());
            let mut found = [None; 2];
            for life in 0..2_000_u16 {
                let mut image = [0; IMAGE_LEN];
                order.emit_command(&command(life), &mut image);
                found[0] = found[0].or_else(|| commands.add(order, &body(&image)));
                let feedback = Feedback {
                    status: Status::ENABLED | Status::AT_REST,
                    state: State::Ready,
                    life: life / 4,
                    life_echo: life,
                    clock_ns: u64::from(life) * 1_000_000,
                    pose: [400.25; 6],
                    ..Feedback::default()
                };
                let mut image = [0; IMAGE_LEN];
                order.emit_feedback(&feedback, &mut image);
                found[1] = found[1].or_else(|| feedbacks.add(order, &body(&image)));
            }
            assert_eq!(
                found,
                [Some((ImageDirection::Command, 3)), Some((ImageDirection::Feedback, 3))],
                "{order:?}"
            );
        }
    }

    #[test]
    fn other_data_has_no_image() {
        let mut search = ContentSearch::default();
        for number in 0..30_000_u32 {
            let body: Vec<u8> = (0..300_u32).map(|at| (number.wrapping_mul(at + 7) >> 5) as u8).collect();
            assert_eq!(search.add(Order::BigEndian, &body), None);
        }
        assert!(!search.is_open());
    }
}
