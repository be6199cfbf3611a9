//! The self-test of the exported robot code, executed: it passes on a right adapter, and stays at the test that a fault breaks.

use protocol::image::{Command, Control, IMAGE_LEN, Order, Skill};
use robot_export::execution::{AdapterFunctions, FormController};
use robot_export::layer::REALS;

use crate::cell::code;

static ORDERS: [Order; 2] = [Order::BigEndian, Order::LittleEndian];

/// Runs both tasks for longer than the self-test takes; returns the number in `test`.
fn test_number(order: Order, has_sign: bool, adapter: AdapterFunctions) -> i64 {
    let code = code(None, has_sign);
    let mut robot = FormController::new(&code, order, 3, |_| protocol::image::ErrorNumber::None);
    robot.set_adapter(adapter);
    // A PLC that enables and starts at once.
    let control = Control::ENABLE | Control::EXECUTE;
    let command = Command { control, number: 1, skill: Skill::RunProgram, program: 1, ..Command::default() };
    let mut image = [0; IMAGE_LEN];
    order.emit_command(&command, &mut image);
    for life in 0..600_u32 {
        image[2..4].fill(life as u8);
        robot.step_cyclic(&image);
        robot.step_motion(&image);
        robot.step_arm();
        robot.pass_ms();
        let test = robot.value("test").unwrap();
        assert!(test == 0 || *robot.image() == [0; IMAGE_LEN], "test {test}: a signal is written");
        assert!(robot.begun().is_empty(), "test {test}: a motion begins");
    }
    if robot.value("test") == Some(0) {
        assert_ne!(*robot.image(), [0; IMAGE_LEN], "the robot does not answer after its self-test");
    }
    robot.value("test").unwrap()
}

#[test]
fn the_self_test_passes_on_a_right_adapter_and_nothing_is_sent_before() {
    for order in ORDERS {
        for has_sign in [true, false] {
            assert_eq!(test_number(order, has_sign, AdapterFunctions::default()), 0);
        }
    }
}

#[test]
fn each_fault_of_an_adapter_stops_the_self_test_at_its_number_and_the_robot_sends_nothing() {
    let right = AdapterFunctions::default();
    let faults: [(&str, i64, AdapterFunctions, &[Order]); 13] = [
        ("a REAL becomes its value", 11, AdapterFunctions { bits: |real| real as u32, ..right }, &ORDERS),
        (
            "the bits lack the sign",
            11,
            AdapterFunctions { bits: |real| real.abs().to_bits(), ..right },
            &ORDERS,
        ),
        (
            "the halves of the bits are swapped",
            11,
            AdapterFunctions { bits: |real| real.to_bits().rotate_left(16), ..right },
            &ORDERS,
        ),
        ("bits become their value", 12, AdapterFunctions { real: |bits| bits as f32, ..right }, &ORDERS),
        (
            "small numbers become 0",
            12,
            AdapterFunctions {
                real: |bits| Some(f32::from_bits(bits)).filter(|real| real.abs() > 0.001).unwrap_or(0.0),
                ..right
            },
            &ORDERS,
        ),
        ("words are not swapped", 13, AdapterFunctions { word: |_, value| value, ..right }, &ORDERS[..1]),
        (
            "words are always swapped",
            13,
            AdapterFunctions { word: |_, value| value.swap_bytes(), ..right },
            &ORDERS[1..],
        ),
        (
            "the high byte of a word gets lost",
            13,
            AdapterFunctions {
                word: |order, value| (AdapterFunctions::default().word)(order, value & 0xFF),
                ..right
            },
            &ORDERS,
        ),
        (
            "long numbers are not swapped",
            14,
            AdapterFunctions { double_word: |_, value| value, ..right },
            &ORDERS[..1],
        ),
        (
            "only words of a long number are swapped",
            14,
            AdapterFunctions { double_word: |_, value| value.rotate_left(16), ..right },
            &ORDERS,
        ),
        ("every REAL is finite", 15, AdapterFunctions { is_not_finite: |_| false, ..right }, &ORDERS),
        ("no REAL is finite", 15, AdapterFunctions { is_not_finite: |_| true, ..right }, &ORDERS),
        ("the clock stands", 17, AdapterFunctions { clock_ms: |_| 0, ..right }, &ORDERS),
    ];
    for (fault, number, adapter, orders) in faults {
        for order in orders {
            assert_eq!(test_number(*order, true, adapter), number, "{fault} on {order:?}");
        }
    }
}

#[test]
fn the_literals_of_the_self_test_are_exactly_the_values_of_their_bits() {
    for (literal, bits) in REALS {
        assert_eq!(literal.parse::<f32>().unwrap().to_bits(), bits, "{literal}");
        assert_eq!(literal.parse::<f64>().unwrap(), f64::from(f32::from_bits(bits)), "{literal} is rounded");
    }
}
