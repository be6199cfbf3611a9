//! The check of an image: finds altered bytes that no checksum of the bus found, such as one that flipped in a switch or in a
//! gateway, or a slot that was copied from the wrong place.
//!
//! ```text
//! command   32..36  u32   over bytes 36..256 and then 0..32
//! feedback 116..120 u32   over bytes 120..256 and then 0..116
//! ```
//!
//! The check is CRC-32C (Castagnoli): polynomial 0x1EDC6F41, bits reflected, start value and final exclusive-or 0xFFFFFFFF; over
//! the characters `123456789` it is 0xE3069283. With the 2,016 bits that it covers here it finds every change of up to five
//! bits, every odd number of them, and every burst of up to 32 bits (P. Koopman, "32-Bit Cyclic Redundancy Codes for Internet
//! Applications", DSN 2002: Hamming distance 6 up to 5,243 bits). The polynomial of Ethernet's own check has distance 5 at this
//! length, and what it does not find another polynomial finds independently of it.
//!
//! It begins with the bytes behind itself, since these seldom change: a PLC that keeps the sum over the slots computes only
//! the 32 bytes of the head in each scan.
//!
//! The value 0 says that the sender gives no check. Where the sum is 0, 0xFFFFFFFF is sent.

use super::{IMAGE_LEN, Image, Order};

/// Where the check of a command begins.
pub const COMMAND_CHECK: usize = 32;

/// Where the check of a feedback begins.
pub const FEEDBACK_CHECK: usize = 116;

/// Length of a check in bytes.
const CHECK_LEN: usize = 4;

/// Polynomial of CRC-32C with its bits reflected.
const POLYNOMIAL: u32 = 0x82F6_3B78;

/// Bytes that are summed up at once, each by a table of its own.
const SLICE: usize = 8;

/// What each value of a byte does to the sum: the first table if no byte follows it, each other one if one byte more
/// follows than for the table before (M. Kounavis and F. Berry, "A Systematic Approach to Building High Performance
/// Software-Based CRC Generators", ISCC 2005: slicing by 8).
static TABLES: [[u32; 256]; SLICE] = tables();

#[expect(clippy::indexing_slicing, reason = "each index is below its bound, and this runs at compile time")]
const fn tables() -> [[u32; 256]; SLICE] {
    let mut tables = [[0; 256]; SLICE];
    let mut byte = 0;
    while byte < 256 {
        let (mut sum, mut bit) = (byte as u32, 0);
        while bit < 8 {
            sum = if sum & 1 == 1 { sum >> 1 ^ POLYNOMIAL } else { sum >> 1 };
            bit += 1;
        }
        tables[0][byte] = sum;
        byte += 1;
    }
    let mut following = 1;
    while following < SLICE {
        let mut byte = 0;
        while byte < 256 {
            let before = tables[following - 1][byte];
            tables[following][byte] = before >> 8 ^ tables[0][(before & 0xFF) as usize];
            byte += 1;
        }
        following += 1;
    }
    tables
}

/// What this byte does to the sum if so many bytes of its slice follow it.
#[expect(
    clippy::indexing_slicing,
    reason = "a byte is always below 256, and so few bytes follow as there are tables"
)]
fn entry<const FOLLOWING: usize>(byte: u8) -> u32 {
    const { assert!(FOLLOWING < SLICE) };
    TABLES[FOLLOWING][usize::from(byte)]
}

/// A CRC-32C under way.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
struct Crc(u32);

impl Crc {
    const START: Self = Self(u32::MAX);

    fn then(self, bytes: &[u8]) -> Self {
        let (slices, rest) = bytes.as_chunks::<SLICE>();
        let sum = slices.iter().fold(self.0, |sum, [a, b, c, d, e, f, g, h]| {
            let [w, x, y, z] = sum.to_le_bytes();
            let first = entry::<7>(a ^ w) ^ entry::<6>(b ^ x) ^ entry::<5>(c ^ y) ^ entry::<4>(d ^ z);
            first ^ entry::<3>(*e) ^ entry::<2>(*f) ^ entry::<1>(*g) ^ entry::<0>(*h)
        });
        Self(rest.iter().fold(sum, |sum, byte| sum >> 8 ^ entry::<0>(sum as u8 ^ byte)))
    }

    const fn value(self) -> u32 {
        !self.0
    }
}

/// Splits an image into what is before its check at `at`, the check, and what is behind it.
fn parts<const AT: usize>(image: &Image) -> (&[u8], [u8; CHECK_LEN], &[u8]) {
    let (head, rest) = image.split_at(AT);
    let (check, tail) = rest.split_at(CHECK_LEN);
    (head, check.try_into().unwrap_or([0; CHECK_LEN]), tail)
}

/// Returns the check to send for a sum; 0 would mean that there is no check.
const fn sent(sum: Crc) -> u32 {
    match sum.value() {
        0 => u32::MAX,
        value => value,
    }
}

/// Writes the check of images. `AT` is where it begins.
#[derive(Clone, Copy, Debug)]
pub struct Sealer<const AT: usize> {
    tail: Crc,
}

/// Writes the check of commands.
pub type CommandSealer = Sealer<COMMAND_CHECK>;

/// Writes the check of feedbacks.
pub type FeedbackSealer = Sealer<FEEDBACK_CHECK>;

impl<const AT: usize> Default for Sealer<AT> {
    /// Returns a sealer of images whose bytes behind the check are all zero.
    fn default() -> Self {
        Self { tail: Crc::START.then(parts::<AT>(&[0; IMAGE_LEN]).2) }
    }
}

impl<const AT: usize> Sealer<AT> {
    /// Takes up the bytes behind the check; needed whenever they have changed.
    pub fn take_tail(&mut self, image: &Image) {
        self.tail = Crc::START.then(parts::<AT>(image).2);
    }

    /// Writes the check of an image whose bytes behind the check were taken up.
    pub fn seal(&self, order: Order, image: &mut Image) {
        let sum = sent(self.tail.then(parts::<AT>(image).0));
        let bytes = match order {
            Order::BigEndian => sum.to_be_bytes(),
            Order::LittleEndian => sum.to_le_bytes(),
        };
        image.iter_mut().skip(AT).zip(bytes).for_each(|(place, byte)| *place = byte);
    }
}

/// What a received image's check says.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Verdict {
    /// The image is as it was sent.
    Intact,
    /// The sender gives no check.
    Unchecked,
    /// A byte was altered on the way, or the sender computes the check wrongly.
    Altered,
}

/// Received images by what their checks and life counters said.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub struct Checks {
    /// Images that were refused because a byte was altered.
    pub altered: u64,
    /// Images without a check.
    pub unchecked: u64,
    /// Images that were refused because of their age: [`LifeMonitor`](super::LifeMonitor) counts them.
    pub outdated: u64,
}

/// Verifies the checks of received images. `AT` is where they begin.
#[derive(Clone, Debug)]
pub struct Checker<const AT: usize> {
    /// The last image that was accepted.
    last: Image,
    /// The sum over its bytes behind the check.
    tail: Crc,
    /// Whether this connection has carried a check: then an image without one was altered.
    is_given: bool,
    checks: Checks,
}

/// Verifies the checks of commands.
pub type CommandChecker = Checker<COMMAND_CHECK>;

/// Verifies the checks of feedbacks.
pub type FeedbackChecker = Checker<FEEDBACK_CHECK>;

impl<const AT: usize> Default for Checker<AT> {
    fn default() -> Self {
        let Sealer { tail } = Sealer::<AT>::default();
        Self { last: [0; IMAGE_LEN], tail, is_given: false, checks: Checks::default() }
    }
}

impl<const AT: usize> Checker<AT> {
    /// Verifies an image and counts it.
    pub fn verify(&mut self, order: Order, image: &Image) -> Verdict {
        if self.is_given && *image == self.last {
            // A node runs more often than the bus brings something new.
            return Verdict::Intact;
        }
        let (head, check, tail) = parts::<AT>(image);
        let given = match order {
            Order::BigEndian => u32::from_be_bytes(check),
            Order::LittleEndian => u32::from_le_bytes(check),
        };
        if given == 0 && !self.is_given {
            // Zeros are what a bus holds before the sender's program has written anything.
            self.checks.unchecked += u64::from(image.iter().any(|byte| *byte != 0));
            return Verdict::Unchecked;
        }
        let is_same = parts::<AT>(&self.last).2 == tail;
        let sum = if is_same { self.tail } else { Crc::START.then(tail) };
        if given == 0 || sent(sum.then(head)) != given {
            self.checks.altered += 1;
            return Verdict::Altered;
        }
        self.is_given = true;
        (self.last, self.tail) = (*image, sum);
        Verdict::Intact
    }

    /// Forgets the connection: the next one may be with a sender that gives no checks.
    pub const fn disconnect(&mut self) {
        self.is_given = false;
    }

    /// Returns what was counted so far.
    #[must_use]
    pub const fn checks(&self) -> Checks {
        self.checks
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::{Command, Feedback};
    use alloc::vec::Vec;
    use machine::wire::{BigEndian, LittleEndian};
    use proptest::prelude::*;

    fn sealed<const AT: usize>(order: Order, bytes: &[u8]) -> Image {
        let mut image: Image = bytes.try_into().unwrap();
        let mut sealer = Sealer::<AT>::default();
        sealer.take_tail(&image);
        sealer.seal(order, &mut image);
        image
    }

    #[test]
    fn the_sum_passes_the_published_vectors_of_crc_32c() {
        // The check value of the catalogue of CRCs, and RFC 3720, B.4.
        assert_eq!(Crc::START.then(b"123456789").value(), 0xE306_9283);
        assert_eq!(Crc::START.then(&[0; 32]).value(), 0x8A91_36AA);
        assert_eq!(Crc::START.then(&[0xFF; 32]).value(), 0x62A8_AB43);
    }

    #[test]
    fn the_sum_of_any_length_is_that_of_single_bits() {
        let bytes: Vec<u8> = (0..100_u8).map(|number| number.wrapping_mul(73) ^ 0x5A).collect();
        let by_bits = |bytes: &[u8]| {
            let sum = bytes.iter().fold(u32::MAX, |sum, byte| {
                (0..8).fold(sum ^ u32::from(*byte), |sum, _| (sum >> 1) ^ (POLYNOMIAL * (sum & 1)))
            });
            !sum
        };
        for length in 0..bytes.len() {
            for middle in 0..=length {
                let (head, tail) = bytes[..length].split_at(middle);
                assert_eq!(Crc::START.then(head).then(tail).value(), by_bits(&bytes[..length]), "{length}");
            }
        }
    }

    #[test]
    fn the_worked_examples_of_the_page_are_right() {
        let page = include_str!("../../../docs/process-image.md");
        let mut image = [0; IMAGE_LEN];
        Command { life: 1, ..Command::default() }.emit::<BigEndian>(&mut image);
        let big = sealed::<COMMAND_CHECK>(Order::BigEndian, &image);
        Command { life: 1, ..Command::default() }.emit::<LittleEndian>(&mut image);
        let little = sealed::<COMMAND_CHECK>(Order::LittleEndian, &image);
        let hex = |bytes: &[u8]| {
            let digits: Vec<_> = bytes.iter().map(|byte| alloc::format!("{byte:02X}")).collect();
            digits.join(" ")
        };
        for (order, image) in [("PROFINET", big), ("EtherNet/IP", little)] {
            let row = alloc::format!("| {order} | `{}` | `{}` |", hex(&image[..8]), hex(&image[32..36]));
            assert!(page.contains(&row), "the page lacks: {row}");
        }
    }

    #[test]
    fn a_sender_without_checks_is_accepted_until_it_gives_one() {
        let mut checker = CommandChecker::default();
        let plain = [7; 32].into_iter().chain([0; IMAGE_LEN - 32]).collect::<Vec<_>>();
        let plain: Image = plain.try_into().unwrap();
        assert_eq!(checker.verify(Order::BigEndian, &plain), Verdict::Unchecked);
        let good = sealed::<COMMAND_CHECK>(Order::BigEndian, &plain);
        assert_eq!(checker.verify(Order::BigEndian, &good), Verdict::Intact);
        assert_eq!(checker.verify(Order::BigEndian, &plain), Verdict::Altered);
        assert_eq!(checker.checks(), Checks { altered: 1, unchecked: 1, outdated: 0 });
        checker.disconnect();
        assert_eq!(checker.verify(Order::BigEndian, &plain), Verdict::Unchecked);
    }

    #[test]
    fn an_image_of_zeros_is_from_no_program_and_does_not_count() {
        let mut checker = FeedbackChecker::default();
        assert_eq!(checker.verify(Order::BigEndian, &[0; IMAGE_LEN]), Verdict::Unchecked);
        assert_eq!(checker.checks(), Checks::default());
        assert_eq!(checker.verify(Order::BigEndian, &[1; IMAGE_LEN]), Verdict::Altered);
        assert_eq!(checker.checks(), Checks { altered: 1, ..Checks::default() });
    }

    #[test]
    fn every_flipped_bit_of_either_image_is_found() {
        let mut image = [0; IMAGE_LEN];
        Feedback { life: 9, joints: [12.5; 6], ..Feedback::default() }.emit::<LittleEndian>(&mut image);
        let feedback = sealed::<FEEDBACK_CHECK>(Order::LittleEndian, &image);
        Command { life: 9, number: 3, ..Command::default() }.emit::<BigEndian>(&mut image);
        let command = sealed::<COMMAND_CHECK>(Order::BigEndian, &image);
        let (mut commands, mut feedbacks) = (CommandChecker::default(), FeedbackChecker::default());
        for bit in 0..IMAGE_LEN * 8 {
            let flip = |mut image: Image| {
                image[bit / 8] ^= 1 << (bit % 8);
                image
            };
            assert_eq!(commands.verify(Order::BigEndian, &command), Verdict::Intact);
            assert_eq!(commands.verify(Order::BigEndian, &flip(command)), Verdict::Altered, "bit {bit}");
            assert_eq!(feedbacks.verify(Order::LittleEndian, &feedback), Verdict::Intact);
            assert_eq!(feedbacks.verify(Order::LittleEndian, &flip(feedback)), Verdict::Altered, "bit {bit}");
        }
    }

    proptest! {
        #[test]
        fn up_to_five_flipped_bits_and_bursts_of_32_are_found_in_any_image(
            bytes in proptest::collection::vec(any::<u8>(), IMAGE_LEN),
            bits in proptest::collection::btree_set(0..IMAGE_LEN * 8, 1..=5),
            burst in (0..IMAGE_LEN - 4, 1..=u32::MAX),
        ) {
            let good = sealed::<FEEDBACK_CHECK>(Order::BigEndian, &bytes);
            let mut checker = FeedbackChecker::default();
            prop_assert_eq!(checker.verify(Order::BigEndian, &good), Verdict::Intact);
            let mut bad = good;
            bits.iter().for_each(|bit| bad[bit / 8] ^= 1 << (bit % 8));
            prop_assert_eq!(checker.verify(Order::BigEndian, &bad), Verdict::Altered);
            let (at, pattern) = burst;
            let mut bad = good;
            bad.iter_mut().skip(at).zip(pattern.to_be_bytes()).for_each(|(byte, flip)| *byte ^= flip);
            prop_assert_eq!(checker.verify(Order::BigEndian, &bad), Verdict::Altered);
            prop_assert_eq!(checker.verify(Order::BigEndian, &good), Verdict::Intact);
        }
    }
}
