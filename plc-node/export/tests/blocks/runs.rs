use plc_node::ExecutionType;
use protocol::image::{IMAGE_LEN, Order};

use crate::bed::{Bed, Exported, exported_a};

const ALL: [ExecutionType; 3] = [ExecutionType::Rc, ExecutionType::Sm, ExecutionType::Cm];

/// Runs each type twice and compares the samples too.
fn run_all(setup: &str, application: &str, order: Order) -> Vec<i64> {
    let mut bed = Bed::new(setup, application, order);
    bed.until_ready(60_000);
    let mut all = Vec::new();
    for execution_type in ALL {
        bed.samples.clear();
        bed.start(execution_type, 2);
        bed.until_done(600_000);
        assert_eq!((bed.exported.error(), bed.failures.as_slice()), (0, &[][..]));
        let samples: Vec<_> = (0..2).map(|index| bed.exported.sample_us(index)).collect();
        let expected: Vec<_> = bed.samples.iter().map(|ns| i64::try_from(ns / 1_000).unwrap()).collect();
        assert_eq!(samples, expected, "{execution_type:?}");
        all.extend(samples);
        bed.until_ready(60_000);
    }
    all
}

#[test]
fn the_robot_executes_setup_a_by_the_exported_code_whose_bytes_are_those_of_the_blocks() {
    let samples = run_all("A", "pick-and-place", Order::BigEndian);
    // Table 2 of the paper has 3725, 6477 and 3729 ms.
    let near = [3_725_000, 3_725_000, 6_477_000, 6_477_000, 3_729_000, 3_729_000];
    assert!(samples.iter().zip(near).all(|(sample, paper)| (sample - paper).abs() < 20_000), "{samples:?}");
}

#[test]
fn the_same_holds_on_a_little_endian_bus_and_for_applications_with_stops_and_switched_outputs() {
    for (setup, application, order) in [
        ("B", "pick-and-place", Order::LittleEndian),
        ("B", "pick-and-place-gripper", Order::LittleEndian),
        ("A", "pick-and-place-gripper", Order::BigEndian),
        ("D", "gluing", Order::BigEndian),
    ] {
        run_all(setup, application, order);
    }
}

#[test]
#[should_panic(expected = ": bytes [")]
fn a_single_wrong_slot_in_edited_code_is_found() {
    let edit = |text: String| {
        let edited = text.replace("group.c_written MOD UDINT#5", "group.c_written MOD UDINT#4");
        assert_ne!(edited, text);
        edited
    };
    let mut bed = Bed::with_edited("A", "pick-and-place", Order::BigEndian, edit);
    bed.until_ready(60_000);
    bed.start(ExecutionType::Cm, 1);
    bed.until_done(60_000);
}

#[test]
#[should_panic(expected = "a loop does not end")]
fn edited_code_that_loops_for_ever_is_stopped_with_its_line_and_scan() {
    let edit = |text: String| text.replace("        group.c_written := group.c_written + UDINT#1;\n", "");
    let mut bed = Bed::with_edited("A", "pick-and-place", Order::BigEndian, edit);
    bed.until_ready(60_000);
    bed.start(ExecutionType::Cm, 1);
    bed.until_done(60_000);
}

#[test]
fn a_plc_whose_arithmetic_fails_the_self_test_never_enables_the_robot() {
    let text = exported_text().replace("16#82F63B78", "16#82F63B79");
    let mut exported = Exported::new(&text, Order::BigEndian);
    for scan in 1..100 {
        assert_eq!(exported.scan(scan * 1_000, &[1; IMAGE_LEN]), [0; IMAGE_LEN]);
        assert_eq!(exported.error(), 0x8107);
    }
}

fn exported_text() -> String {
    plc_export::structured_text(&exported_a()).unwrap()
}
