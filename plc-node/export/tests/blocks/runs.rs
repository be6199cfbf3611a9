use plc_node::ExecutionType;
use protocol::image::Order;

use crate::bed::Bed;

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
    println!("{samples:?}");
    assert!(samples.iter().all(|sample| *sample > 1_000_000), "{samples:?}");
}

#[test]
fn the_same_holds_on_a_little_endian_bus_and_for_applications_with_stops_and_switched_outputs() {
    for (setup, application, order) in [
        ("B", "pick-and-place", Order::LittleEndian),
        ("B", "pick-and-place-gripper", Order::LittleEndian),
        ("A", "pick-and-place-gripper", Order::BigEndian),
        ("D", "gluing", Order::BigEndian),
    ] {
        println!("{setup} {application} {:?}", run_all(setup, application, order));
    }
}
