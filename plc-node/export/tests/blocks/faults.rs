use plc_node::ExecutionType;
use proptest::prelude::*;
use protocol::image::Order;

use crate::bed::{Bed, Way};

/// What happens for how many scans.
fn stretch() -> impl Strategy<Value = (Way, u32)> {
    prop_oneof![
        8 => (Just(Way::Intact), 1..3_000_u32),
        3 => (Just(Way::Lost), 1..40_u32),
        1 => (Just(Way::Lost), 400..700_u32),
        3 => ((0..2048_usize).prop_map(Way::Altered), 1..40_u32),
        1 => ((0..2048_usize).prop_map(Way::Altered), 400..700_u32),
        1 => (Just(Way::Cut), 1..200_u32),
        2 => ((1..4_000_usize).prop_map(Way::Old), 1..150_u32),
    ]
}

fn execution_type() -> impl Strategy<Value = ExecutionType> {
    prop_oneof![Just(ExecutionType::Rc), Just(ExecutionType::Sm), Just(ExecutionType::Cm)]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, ..ProptestConfig::default() })]

    #[test]
    fn no_byte_differs_whatever_happens_to_the_robots_images(
        stretches in proptest::collection::vec((stretch(), execution_type(), any::<bool>()), 1..25),
        is_big in any::<bool>(),
    ) {
        let order = if is_big { Order::BigEndian } else { Order::LittleEndian };
        let mut bed = Bed::new("A", "pick-and-place-gripper", order);
        for ((way, scans), execution_type, starts) in stretches {
            if starts && bed.remaining == 0 {
                bed.exported.start(false, 0, 0);
                bed.scan(Way::Intact);
                bed.start(execution_type, 2);
            }
            for _ in 0..scans {
                bed.scan(way);
            }
            prop_assert_eq!(bed.exported.error() != 0, !bed.failures.is_empty(), "{:?}", bed.failures);
            if bed.remaining == 0 {
                bed.failures.clear();
                bed.exported.clear_error();
            }
        }
    }
}
