//! Six drives under ethercrab at 1 ms, in virtual time: they move together, and the error names an axis
//! that stops.

#![expect(clippy::unwrap_used, reason = "a test fails by a panic")]

use ethercat_drive::{
    Axes, AxisError, Cause, DRIVE, DriveConfig, Drives, ErrorCode, INPUT_LEN, OUTPUT_LEN, Power, State,
    Wanted,
};
use ethercat_maindevice::{Config, ExpectedDevice, GroupMainDevice};
use ethercat_subdevice::{AlStatusCode, DeviceId};
use machine::ethernet::Mac;
use machine::{Duration, Instant, LinkEvent, Machine, PortRequest, Source, Transmit};
use virtual_time::{Clock, Event, Impairment, Pair, PairConfig};

const MS: Duration = Duration::from_millis(1);
const AXES: usize = 6;

/// The part of a robot controller that moves the drives: each exchange of process data is a cycle.
struct DriveController {
    main: GroupMainDevice,
    axes: Axes,
    targets: [i32; AXES],
    /// Increments per cycle.
    speeds: [i32; AXES],
    exchanges: u64,
    cycles: u64,
    worst_following_error: i32,
}

impl DriveController {
    fn new() -> Self {
        let drive = ExpectedDevice {
            vendor: DRIVE.vendor_id,
            product: DRIVE.product_code,
            revision: Some(DRIVE.revision),
            output_bytes: OUTPUT_LEN,
            input_bytes: INPUT_LEN,
        };
        let config =
            Config { mac: Mac([2, 0, 0, 0, 0, 1]), devices: vec![drive; AXES], cycle: MS, watchdog: MS * 20 };
        Self {
            main: GroupMainDevice::new(config, Instant::ZERO),
            axes: Axes::new(AXES),
            targets: [0; AXES],
            speeds: [0; AXES],
            exchanges: 0,
            cycles: 0,
            worst_following_error: 0,
        }
    }

    fn cycle(&mut self) {
        let received = self.main.counters().received;
        if received == std::mem::replace(&mut self.exchanges, received) {
            return;
        }
        let Some(inputs) = self.main.inputs().map(<[u8]>::to_vec) else { return };
        let are_on = self.axes.are_on();
        for (index, axis) in self.axes.axes().iter().enumerate() {
            if are_on {
                self.targets[index] += self.speeds[index];
                self.worst_following_error = self.worst_following_error.max(axis.following_error().abs());
            } else {
                self.targets[index] = axis.position();
            }
        }
        self.axes.cycle(&inputs, &self.targets, self.main.outputs_mut());
        self.cycles += 1;
    }
}

impl Machine for DriveController {
    type Event = LinkEvent;

    fn ports(&self) -> &[PortRequest] {
        self.main.ports()
    }

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        self.main.handle_frame(now, from, frame);
        self.cycle();
    }

    fn handle_timeout(&mut self, now: Instant) {
        self.main.handle_timeout(now);
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        self.main.poll_transmit(now, buf)
    }

    fn poll_event(&mut self) -> Option<LinkEvent> {
        self.main.poll_event()
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.main.poll_timeout()
    }
}

type Cell = Pair<DriveController, Drives>;

fn cell() -> Cell {
    let configs: Vec<_> = (0..AXES as u32)
        .map(|number| DriveConfig { position: 1_000 * number as i32, ..DriveConfig::new(number + 1, 1e6) })
        .collect();
    let cable = Impairment { delay: Duration::from_micros(20), ..Impairment::default() };
    // Half a ms of phase between the controller's cycle and the drives', and clocks that drift.
    let clocks = [Clock { drift_ppb: 30_000, ..Clock::default() }, Clock::default()];
    let config = PairConfig { seed: 1, clocks, links: [cable; 2], addresses: [None; 2] };
    Pair::new(DriveController::new(), Drives::new(&configs, MS, Instant::ZERO + MS / 4), config)
}

fn run(cell: &mut Cell, time: Duration) -> Vec<LinkEvent> {
    let until = cell.now() + time;
    let mut events = Vec::new();
    while let Some(event) = cell.next_event(until) {
        if let Event::A(event) = event {
            events.push(event);
        }
    }
    events
}

/// Returns six drives that are on.
fn running() -> Cell {
    let mut cell = cell();
    assert_eq!(run(&mut cell, MS * 500), [LinkEvent::Up]);
    assert!(!cell.a().axes.are_on(), "not before it is wanted");
    cell.command_a(|controller, _| controller.axes.want(Wanted::On));
    run(&mut cell, MS * 20);
    assert!(cell.a().axes.are_on(), "{:?}", cell.a().axes);
    cell
}

fn state(cell: &Cell, drive: usize) -> State {
    cell.b().drive(drive).unwrap().state()
}

#[test]
fn six_drives_follow_for_30_s_without_a_missed_working_counter() {
    let mut cell = running();
    cell.command_a(|controller, _| controller.speeds = [1, -20, 300, -400, 500, 600]);
    let start = [1, 2, 3, 4, 5, 6].map(|number| cell.b().drive(number - 1).unwrap().position());
    let before = cell.a().cycles;
    assert_eq!(run(&mut cell, MS * 30_000), []);
    let counters = cell.a().main.counters();
    assert_eq!((counters.lost, counters.late, counters.skipped), (0, 0, 0), "{counters:?}");
    let cycles = cell.a().cycles - before;
    assert!((29_998..=30_002).contains(&cycles), "{cycles}");
    for (index, speed) in cell.a().speeds.into_iter().enumerate() {
        let way = i64::from(cell.b().drive(index).unwrap().position() - start[index]);
        let expected = i64::from(speed) * cycles as i64;
        assert!((way - expected).abs() <= 3 * i64::from(speed.abs()), "axis {index}: {way}, {expected}");
    }
    // Two cycles of the bus and one of the drive pass from a target to the position that is reported.
    assert!(cell.a().worst_following_error <= 3 * 600, "{}", cell.a().worst_following_error);
    assert_eq!(cell.a().axes.error(), None);
}

#[test]
fn a_blocked_axis_is_named_with_its_code_and_the_others_stop() {
    let mut cell = running();
    cell.command_a(|controller, _| controller.speeds = [200; AXES]);
    run(&mut cell, MS * 200);
    cell.command_b(|drives, _| drives.drive_mut(2).unwrap().block(true));
    run(&mut cell, MS * 300);
    let error = cell.a().axes.error().unwrap();
    assert_eq!(error, AxisError { axis: 3, cause: Cause::Fault(ErrorCode::FOLLOWING_ERROR) });
    assert_eq!(error.to_string(), "drive of axis 3: 0x8611: following error");
    for drive in 0..AXES {
        let expected = if drive == 2 { State::Fault } else { State::SwitchOnDisabled };
        assert_eq!(state(&cell, drive), expected, "drive {drive}");
    }
    let stood = [0, 1, 2, 3, 4, 5].map(|drive| cell.b().drive(drive).unwrap().position());
    run(&mut cell, MS * 100);
    assert_eq!([0, 1, 2, 3, 4, 5].map(|drive| cell.b().drive(drive).unwrap().position()), stood);

    // Only a reset ends the error; then the axes continue from where they stand.
    cell.command_a(|controller, _| controller.axes.want(Wanted::On));
    run(&mut cell, MS * 50);
    assert!(!cell.a().axes.are_on());
    cell.command_b(|drives, _| drives.drive_mut(2).unwrap().block(false));
    cell.command_a(|controller, _| controller.axes.want(Wanted::Reset));
    run(&mut cell, MS * 20);
    cell.command_a(|controller, _| controller.axes.want(Wanted::On));
    run(&mut cell, MS * 100);
    assert!(cell.a().axes.are_on(), "{:?}", cell.a().axes);
    assert_eq!(cell.a().axes.error(), None);
}

#[test]
fn the_fault_of_any_drive_is_told_with_axis_and_code() {
    for (drive, code) in [(0, ErrorCode::OVER_CURRENT), (3, ErrorCode::ENCODER), (5, ErrorCode(0xFF01))] {
        let mut cell = running();
        cell.command_b(|drives, _| drives.drive_mut(drive).unwrap().set_cause(code));
        run(&mut cell, MS * 50);
        let expected = AxisError { axis: drive + 1, cause: Cause::Fault(code) };
        assert_eq!(cell.a().axes.error(), Some(expected));
        assert_eq!(cell.a().axes.axes()[drive].power(), Power::Fault(code));
        let registers = |cell: &mut Cell| {
            let mut registers = [0; AXES];
            cell.command_b(|drives, _| {
                for (index, register) in registers.iter_mut().enumerate() {
                    *register = drives.segment_mut().object(DeviceId(index), 0x1001, 0).unwrap()[0];
                }
            });
            registers
        };
        let mut expected = [0; AXES];
        expected[drive] = code.register();
        assert_ne!(expected[drive], 0);
        assert_eq!(registers(&mut cell), expected);
        cell.command_b(|drives, _| drives.drive_mut(drive).unwrap().set_cause(ErrorCode::NONE));
        cell.command_a(|controller, _| controller.axes.want(Wanted::Reset));
        run(&mut cell, MS * 20);
        assert_eq!(registers(&mut cell), [0; AXES]);
    }
}

#[test]
fn a_drive_that_an_input_of_its_own_stops_is_named_and_stops_the_others() {
    let mut cell = running();
    cell.command_a(|controller, _| controller.speeds = [900; AXES]);
    run(&mut cell, MS * 300);
    cell.command_b(|drives, _| drives.stop(4).unwrap());
    run(&mut cell, MS * 20);
    assert_eq!(cell.a().axes.error(), Some(AxisError { axis: 5, cause: Cause::QuickStop }));
    assert!((0..AXES).all(|drive| state(&cell, drive) == State::QuickStopActive), "they brake for 90 ms");
    assert!(!cell.a().axes.are_off());
    run(&mut cell, MS * 150);
    assert!(cell.a().axes.are_off());
}

#[test]
fn a_quick_stop_of_all_is_no_error_and_ends_with_all_drives_off() {
    let mut cell = running();
    cell.command_a(|controller, _| controller.speeds = [900; AXES]);
    run(&mut cell, MS * 300);
    cell.command_a(|controller, _| controller.axes.want(Wanted::QuickStop));
    run(&mut cell, MS * 20);
    assert!((0..AXES).all(|drive| state(&cell, drive) == State::QuickStopActive), "they brake for 90 ms");
    run(&mut cell, MS * 150);
    assert!((0..AXES).all(|drive| state(&cell, drive) == State::SwitchOnDisabled));
    assert_eq!(cell.a().axes.error(), None);
}

#[test]
fn a_drive_that_leaves_op_has_a_fault_of_its_own_once_the_bus_is_back() {
    let mut cell = running();
    cell.command_b(|drives, _| drives.segment_mut().fail(DeviceId(4), AlStatusCode::WATCHDOG));
    let events = run(&mut cell, MS * 200);
    assert!(matches!(events[..], [LinkEvent::Down(_), LinkEvent::Up]), "{events:?}");
    let expected = AxisError { axis: 5, cause: Cause::Fault(ErrorCode::COMMUNICATION) };
    assert_eq!(cell.a().axes.error(), Some(expected));
}
