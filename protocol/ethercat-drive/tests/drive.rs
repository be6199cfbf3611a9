//! One drive, without a bus: the state machine of CiA 402, following error, quick stop and faults.

use std::collections::BTreeSet;

use ethercat_drive::{Drive, ErrorCode, Outputs, Parameters, QuickStop, State, StatusWord, control};
use machine::Duration;

const MS: Duration = Duration::from_millis(1);

/// Increments/s.
const MAX_SPEED: f64 = 1e6;

/// Increments/s² at rated torque: at full speed within a cycle.
const ACCELERATION: f64 = 1e9;

fn parameters() -> Parameters {
    Parameters {
        window: Some(2_000),
        window_time: MS * 10,
        quick_stop: QuickStop::Brake,
        deceleration: 1e7,
        torque: 1.0,
    }
}

/// A drive that gets the same process data until a test changes them.
struct CommandedDrive {
    drive: Drive,
    outputs: Outputs,
    parameters: Parameters,
}

impl CommandedDrive {
    fn new() -> Self {
        let outputs = Outputs { mode: 8, ..Outputs::default() };
        Self { drive: Drive::new(0, MAX_SPEED, ACCELERATION, MS), outputs, parameters: parameters() }
    }

    /// Returns a drive in the state Operation enabled.
    fn running() -> Self {
        let mut commanded = Self::new();
        for word in [0, control::SHUTDOWN, control::SWITCH_ON, control::ENABLE_OPERATION] {
            commanded.command(word);
        }
        assert_eq!(commanded.drive.state(), State::OperationEnabled);
        commanded
    }

    fn command(&mut self, control_word: u16) -> State {
        self.outputs.control_word = control_word;
        self.cycle();
        self.drive.state()
    }

    fn cycle(&mut self) {
        self.drive.cycle(MS, Some(&self.outputs), &self.parameters);
    }

    /// Moves by so many increments in each cycle.
    fn drive_on(&mut self, step: i32, cycles: u32) {
        for _ in 0..cycles {
            self.outputs.target += step;
            self.cycle();
        }
    }

    /// Runs the drive until the following error is a fault and the reaction to the fault has ended.
    fn fault(&mut self) {
        self.drive.set_cause(ErrorCode::OVER_CURRENT);
        while self.drive.state() != State::Fault {
            self.cycle();
        }
        self.drive.set_cause(ErrorCode::NONE);
    }
}

/// Brings a drive into a state by control words.
fn in_state(state: State, quick_stop: QuickStop) -> CommandedDrive {
    let mut commanded = CommandedDrive::new();
    commanded.parameters.quick_stop = quick_stop;
    let enable = [0, control::SHUTDOWN, control::SWITCH_ON, control::ENABLE_OPERATION];
    let words: &[u16] = match state {
        State::SwitchOnDisabled => &enable[..1],
        State::ReadyToSwitchOn => &enable[..2],
        State::SwitchedOn => &enable[..3],
        _ => &enable,
    };
    for word in words {
        commanded.command(*word);
    }
    match state {
        State::QuickStopActive => {
            commanded.drive_on(500, 20);
            commanded.command(control::QUICK_STOP);
        }
        State::Fault => commanded.fault(),
        _ => {}
    }
    assert_eq!(commanded.drive.state(), state);
    commanded
}

#[test]
fn every_control_word_in_every_state_leads_where_the_standard_says() {
    use State::{Fault, OperationEnabled, QuickStopActive, ReadyToSwitchOn, SwitchOnDisabled, SwitchedOn};
    // Rows: states. Columns: disable voltage, quick stop, shutdown, switch on, enable operation (CiA 402-2, table of
    // transitions 2 to 16).
    let words = [
        control::DISABLE_VOLTAGE,
        control::QUICK_STOP,
        control::SHUTDOWN,
        control::SWITCH_ON,
        control::ENABLE_OPERATION,
    ];
    let table = [
        (
            SwitchOnDisabled,
            [SwitchOnDisabled, SwitchOnDisabled, ReadyToSwitchOn, SwitchOnDisabled, SwitchOnDisabled],
        ),
        (ReadyToSwitchOn, [SwitchOnDisabled, SwitchOnDisabled, ReadyToSwitchOn, SwitchedOn, SwitchedOn]),
        (SwitchedOn, [SwitchOnDisabled, SwitchOnDisabled, ReadyToSwitchOn, SwitchedOn, OperationEnabled]),
        (
            OperationEnabled,
            [SwitchOnDisabled, QuickStopActive, ReadyToSwitchOn, SwitchedOn, OperationEnabled],
        ),
        (
            QuickStopActive,
            [SwitchOnDisabled, QuickStopActive, QuickStopActive, QuickStopActive, OperationEnabled],
        ),
        (Fault, [Fault; 5]),
    ];
    for (state, expected) in table {
        for (word, expected) in words.into_iter().zip(expected) {
            let mut commanded = in_state(state, QuickStop::BrakeAndStay);
            assert_eq!(commanded.command(word), expected, "{state:?}, {word:#06x}");
        }
    }
}

#[test]
fn no_control_words_in_any_order_lead_to_a_state_that_the_status_word_does_not_show() {
    let mut commanded = CommandedDrive::new();
    let mut seen = BTreeSet::new();
    let mut number = 1_u32;
    for _ in 0..200_000 {
        // A simple generator of pseudo-random numbers.
        number = number.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let word = [0x00, 0x02, 0x06, 0x07, 0x0F, 0x0F, 0x0F, 0x80][(number >> 29) as usize];
        commanded.drive.set_cause(if number >> 16 & 0xFF == 0 {
            ErrorCode::ENCODER
        } else {
            ErrorCode::NONE
        });
        commanded.outputs.target = commanded.outputs.target.wrapping_add((number >> 8 & 0xFF) as i32);
        if commanded.drive.state() != State::OperationEnabled {
            commanded.outputs.target = commanded.drive.position();
        }
        commanded.command(word);
        let inputs = commanded.drive.inputs();
        assert_eq!(inputs.status_word.state(), Some(commanded.drive.state()));
        let faulty = matches!(commanded.drive.state(), State::Fault | State::FaultReactionActive);
        assert_eq!(inputs.error != ErrorCode::NONE, faulty, "{inputs:?}");
        seen.insert(commanded.drive.state().bits());
    }
    assert!(seen.len() >= 7, "{seen:02X?}");
}

#[test]
fn the_motor_follows_a_target_that_moves_no_faster_than_it_can() {
    let mut commanded = CommandedDrive::running();
    for _ in 0..1_000 {
        commanded.drive_on(900, 1);
        let inputs = commanded.drive.inputs();
        assert_eq!((inputs.position, inputs.following_error), (commanded.outputs.target, 0));
        assert!(inputs.status_word.has(StatusWord::FOLLOWS) && !inputs.status_word.has(StatusWord::LIMIT));
    }
}

#[test]
fn a_target_that_is_too_fast_becomes_a_following_error_after_its_time_out_and_the_motor_brakes() {
    let mut commanded = CommandedDrive::running();
    // 1000 increments in a cycle are the most; after 4 cycles it is 2000 behind.
    commanded.drive_on(1_500, 4);
    assert!(commanded.drive.inputs().status_word.has(StatusWord::LIMIT));
    assert!(!commanded.drive.inputs().status_word.has(StatusWord::FOLLOWING_ERROR), "not yet outside");
    commanded.drive_on(1_500, 1);
    assert!(commanded.drive.inputs().status_word.has(StatusWord::FOLLOWING_ERROR));
    commanded.drive_on(1_500, 9);
    assert_eq!(commanded.drive.state(), State::OperationEnabled, "10 ms are allowed");
    commanded.drive_on(1_500, 1);
    let inputs = commanded.drive.inputs();
    assert_eq!(
        (commanded.drive.state(), inputs.error),
        (State::FaultReactionActive, ErrorCode::FOLLOWING_ERROR)
    );
    assert!(inputs.following_error > 2_000);
    let before = commanded.drive.position();
    while commanded.drive.state() == State::FaultReactionActive {
        commanded.cycle();
    }
    // From 10^6 increments/s at 10^7 increments/s²: 0.1 s and 50,000 increments.
    let way = commanded.drive.position() - before;
    assert!((49_000..=50_000).contains(&way), "{way}");
    assert_eq!(commanded.drive.state(), State::Fault);
}

#[test]
fn a_blocked_shaft_within_the_window_is_no_fault_and_without_a_window_never_is() {
    let mut commanded = CommandedDrive::running();
    commanded.drive.block(true);
    commanded.drive_on(100, 20);
    for _ in 0..1_000 {
        commanded.cycle();
    }
    assert_eq!(
        (commanded.drive.state(), commanded.drive.inputs().following_error),
        (State::OperationEnabled, 2_000)
    );
    commanded.parameters.window = None;
    commanded.drive_on(100, 1_000);
    assert_eq!(commanded.drive.state(), State::OperationEnabled);
    commanded.parameters.window = Some(2_000);
    commanded.drive_on(0, 11);
    assert_eq!(commanded.drive.inputs().error, ErrorCode::FOLLOWING_ERROR);
    assert_eq!(commanded.drive.state(), State::Fault, "it stands already");
}

#[test]
fn a_quick_stop_brakes_as_its_option_says() {
    for (quick_stop, end) in [
        (QuickStop::Disable, State::SwitchOnDisabled),
        (QuickStop::Brake, State::SwitchOnDisabled),
        (QuickStop::BrakeAndStay, State::QuickStopActive),
    ] {
        let mut commanded = CommandedDrive::running();
        commanded.parameters.quick_stop = quick_stop;
        commanded.drive_on(1_000, 50);
        let before = commanded.drive.position();
        commanded.command(control::QUICK_STOP);
        for _ in 0..200 {
            commanded.cycle();
        }
        let way = commanded.drive.position() - before;
        assert_eq!(commanded.drive.state(), end, "{quick_stop:?}");
        let expected = if quick_stop == QuickStop::Disable { 0..=0 } else { 49_000..=50_000 };
        assert!(expected.contains(&way), "{quick_stop:?}: {way}");
    }
    for (code, meaning) in
        [(0, QuickStop::Disable), (2, QuickStop::Brake), (6, QuickStop::BrakeAndStay), (-1, QuickStop::Brake)]
    {
        assert_eq!(QuickStop::of(code), meaning);
    }
}

#[test]
fn a_fault_is_reset_by_an_edge_and_only_once_its_cause_has_gone() {
    let mut commanded = CommandedDrive::running();
    commanded.drive.set_cause(ErrorCode::OVER_TEMPERATURE);
    assert_eq!(commanded.command(control::ENABLE_OPERATION), State::Fault);
    assert_eq!(commanded.command(control::FAULT_RESET), State::Fault, "it is still too hot");
    commanded.drive.set_cause(ErrorCode::NONE);
    assert_eq!(commanded.command(control::FAULT_RESET), State::Fault, "no edge");
    assert_eq!(commanded.command(0), State::Fault);
    assert_eq!(commanded.command(control::FAULT_RESET), State::SwitchOnDisabled);
    assert_eq!(commanded.drive.inputs().error, ErrorCode::NONE);
}

#[test]
fn a_drive_without_process_data_stops_with_a_fault_and_one_without_voltage_does_not() {
    let mut commanded = CommandedDrive::running();
    commanded.drive_on(1_000, 50);
    commanded.drive.cycle(MS, None, &commanded.parameters);
    assert_eq!(commanded.drive.state(), State::FaultReactionActive);
    for _ in 0..200 {
        commanded.drive.cycle(MS, None, &commanded.parameters);
    }
    let inputs = commanded.drive.inputs();
    assert_eq!((commanded.drive.state(), inputs.error), (State::Fault, ErrorCode::COMMUNICATION));

    let mut commanded = in_state(State::ReadyToSwitchOn, QuickStop::Brake);
    commanded.drive.cycle(MS, None, &commanded.parameters);
    assert_eq!(commanded.drive.state(), State::ReadyToSwitchOn);
}

#[test]
fn another_mode_of_operation_moves_nothing() {
    let mut commanded = CommandedDrive::running();
    commanded.outputs.mode = 1;
    commanded.drive_on(1_000, 10);
    let inputs = commanded.drive.inputs();
    assert_eq!((inputs.position, inputs.mode), (0, 0));
    assert!(!inputs.status_word.has(StatusWord::FOLLOWS));
}

#[test]
fn a_mode_of_0_keeps_the_one_in_use() {
    let mut commanded = CommandedDrive::running();
    commanded.outputs.mode = 0;
    commanded.drive_on(500, 10);
    let inputs = commanded.drive.inputs();
    assert_eq!((inputs.position, inputs.mode), (5_000, 8));
    let mut commanded = CommandedDrive::new();
    commanded.outputs.mode = 0;
    commanded.cycle();
    assert_eq!(commanded.drive.inputs().mode, 0, "none was chosen yet");
}

#[test]
fn a_drive_that_stopped_by_itself_and_stays_there_goes_on_by_a_new_command_alone() {
    let mut commanded = CommandedDrive::running();
    commanded.parameters.quick_stop = QuickStop::BrakeAndStay;
    commanded.drive_on(500, 20);
    commanded.drive.stop(QuickStop::BrakeAndStay);
    for _ in 0..200 {
        assert_eq!(commanded.command(control::ENABLE_OPERATION), State::QuickStopActive);
    }
    assert_eq!(commanded.command(control::QUICK_STOP), State::QuickStopActive);
    commanded.outputs.target = commanded.drive.position();
    assert_eq!(commanded.command(control::ENABLE_OPERATION), State::OperationEnabled);
}

#[test]
fn the_error_register_names_the_kind_of_the_error() {
    for (code, register) in [
        (ErrorCode::NONE, 0x00),
        (ErrorCode::OVER_CURRENT, 0x03),
        (ErrorCode::DC_LINK_OVER_VOLTAGE, 0x05),
        (ErrorCode::OVER_TEMPERATURE, 0x09),
        (ErrorCode::ENCODER, 0x01),
        (ErrorCode::COMMUNICATION, 0x11),
        (ErrorCode::FOLLOWING_ERROR, 0x21),
        (ErrorCode(0xFF01), 0x81),
    ] {
        assert_eq!(code.register(), register, "{code}");
    }
}

#[test]
fn process_data_are_the_same_after_a_way_over_the_bus() {
    let outputs = Outputs { control_word: 0x1234, target: -5_678, mode: -8 };
    assert_eq!(Outputs::parse(&outputs.bytes()), Some(outputs));
    let mut commanded = CommandedDrive::running();
    commanded.drive_on(-700, 3);
    let inputs = commanded.drive.inputs();
    assert_eq!(ethercat_drive::Inputs::parse(&inputs.bytes()).unwrap(), inputs);
    assert_eq!(Outputs::parse(&[0; 7]), None);
    assert_eq!(ethercat_drive::Inputs::parse(&[0; 15]), None);
}

#[test]
fn the_speed_never_changes_faster_than_the_torque_allows_also_where_the_motor_catches_up_after_a_block() {
    // 50 increments/ms² at rated torque, 100 with twice that.
    for (torque, most) in [(1.0, 51), (2.0, 101)] {
        let mut commanded = CommandedDrive::running();
        commanded.drive = Drive::new(0, MAX_SPEED, 5e7, MS);
        for word in [0, control::SHUTDOWN, control::SWITCH_ON, control::ENABLE_OPERATION] {
            commanded.command(word);
        }
        (commanded.parameters.torque, commanded.parameters.window) = (torque, None);
        for step in 0..400 {
            commanded.drive_on((step / 5).min(30) * 10, 1);
        }
        commanded.drive.block(true);
        commanded.drive_on(300, 50);
        commanded.drive.block(false);
        let (mut before, mut speed, mut overshoot) = (commanded.drive.position(), 0, 0);
        for _ in 0..1_000 {
            commanded.drive_on(300, 1);
            let step = commanded.drive.position() - before;
            assert!((step - speed).abs() <= most, "from {speed} to {step} increments in a cycle");
            assert!(step <= 1_000, "faster than its highest speed: {step}");
            (before, speed) = (commanded.drive.position(), step);
            overshoot = overshoot.min(commanded.drive.inputs().following_error);
        }
        assert_eq!((commanded.drive.inputs().following_error, speed), (0, 300));
        assert!(overshoot >= -1, "it passes its demand by {overshoot}");
    }
}

#[test]
fn a_following_error_stays_readable_until_the_fault_is_reset() {
    let mut commanded = CommandedDrive::running();
    commanded.drive.block(true);
    commanded.drive_on(400, 16);
    for _ in 0..50 {
        commanded.cycle();
    }
    let inputs = commanded.drive.inputs();
    assert_eq!((commanded.drive.state(), inputs.error), (State::Fault, ErrorCode::FOLLOWING_ERROR));
    assert_eq!(inputs.following_error, 6_400, "16 cycles of 400");
    commanded.command(0);
    commanded.command(control::FAULT_RESET);
    assert_eq!(commanded.drive.inputs().following_error, 0);
}
