//! Random scripts: what happens to the robot's images, and when runs start, for as many scans as one likes.

use plc_export::Maker;
use plc_node::ExecutionType;
use protocol::image::Order;

use crate::bed::{Bed, Way};

/// Draws numbers: SplitMix64.
pub(crate) struct Draw(pub(crate) u64);

impl Draw {
    pub(crate) fn below(&mut self, end: u64) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        (mixed ^ (mixed >> 31)) % end
    }

    fn within(&mut self, from: u64, end: u64) -> u64 {
        from + self.below(end - from)
    }

    fn count(&mut self, from: u64, end: u64) -> usize {
        usize::try_from(self.within(from, end)).unwrap()
    }

    /// Returns what happens next, and for how many scans.
    fn stretch(&mut self) -> (Way, u64) {
        match self.below(19) {
            0..8 => (Way::Intact, self.within(1, 3_000)),
            8..11 => (Way::Lost, self.within(1, 40)),
            11 => (Way::Lost, self.within(400, 700)),
            12..15 => (Way::Altered(self.count(0, 2_048)), self.within(1, 40)),
            15 => (Way::Altered(self.count(0, 2_048)), self.within(400, 700)),
            16 => (Way::Cut, self.within(1, 200)),
            _ => (Way::Old(self.count(1, 4_000)), self.within(1, 150)),
        }
    }
}

/// Steps the function blocks and the code of a maker through this many scans, and compares their bytes and errors.
pub(crate) fn random_scans(maker: Maker, scans: u64, seed: u64) {
    let mut draw = Draw(seed);
    let mut left = scans;
    let cells = [("A", "pick-and-place-gripper"), ("B", "pick-and-place"), ("D", "gluing")];
    while left > 0 {
        let (setup, application) = cells[draw.count(0, 3)];
        let order = if draw.below(2) == 0 { Order::BigEndian } else { Order::LittleEndian };
        let mut bed = Bed::of_maker(setup, application, order, maker);
        // A new bed from time to time, so that the ways from the start are many too.
        let mut of_bed = left.min(100_000);
        left -= of_bed;
        while of_bed > 0 {
            let (way, length) = draw.stretch();
            if draw.below(2) == 0 && bed.remaining == 0 && of_bed > 1 {
                bed.exported.start(false, 0, 0);
                bed.scan(Way::Intact);
                of_bed -= 1;
                bed.start(ExecutionType::ALL[draw.count(0, 3)], 2);
            }
            let length = length.min(of_bed);
            of_bed -= length;
            (0..length).for_each(|_| bed.scan(way));
            assert_eq!(bed.exported.error() != 0, !bed.failures.is_empty(), "{:?}", bed.failures);
            if bed.remaining == 0 {
                bed.failures.clear();
                bed.exported.clear_error();
            }
        }
    }
}
