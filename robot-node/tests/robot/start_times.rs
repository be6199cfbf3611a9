//! Robots that start at a time of their own clocks.

use std::time::Duration;

use machine::Instant;
use plc_node::robot_clock::{RobotClock, StampDelay, start_together};
use protocol::image::{Skill, State, Status};
use robot_node::{Program, RobotConfig, RobotEvent};

use crate::driven::{Driven, bare, lin, ptp};

fn ready(config: RobotConfig) -> Driven {
    let mut robot = Driven::ready(config, Program::default());
    robot.run(vec![ptp(0.0, 0.0, 100.0)]);
    robot
}

/// Calls a line that starts at a time of the robot's clock, and returns when the arm first moved.
fn moved_at(robot: &mut Driven, start: Instant) -> Instant {
    robot.command.start_time_ns = start.as_nanos();
    robot.call(Skill::MoveContinuous, vec![lin(100.0, 0.0, 100.0)]);
    robot.wait(|feedback| feedback.status.contains(Status::BUSY) && feedback.path_speed > 0.0);
    robot.at
}

#[test]
fn arms_start_in_the_cycle_after_the_start_time_however_many_cycles_they_prepare() {
    for continuous_start_cycles in [0, 1, 7] {
        for later_us in [0, 1_000, 3_999, 4_000] {
            let mut robot = ready(RobotConfig { continuous_start_cycles, ..bare("A") });
            let start = robot.at + Duration::from_micros(100_000 + later_us);
            let moved = moved_at(&mut robot, start);
            // It begins at the first cycle at or after the start time, and has moved one cycle later.
            let after = moved.since(start);
            let expected = Duration::from_millis(4)..Duration::from_millis(8);
            assert!(expected.contains(&after), "{continuous_start_cycles} cycles, {later_us} us: {after:?}");
        }
    }
}

#[test]
fn a_start_time_in_the_past_starts_at_once() {
    let mut without = ready(bare("A"));
    let start = without.at;
    let at_once = moved_at(&mut without, Instant::ZERO);
    for past in [Instant::from_nanos(1), start, start - Duration::from_millis(1)] {
        assert_eq!(moved_at(&mut ready(bare("A")), past), at_once, "{past:?}");
    }
}

#[test]
fn a_wait_for_a_start_time_that_never_comes_ends_with_a_halt_a_cancel_or_the_connection() {
    use protocol::image::Control;
    let far = Instant::from_nanos(u64::MAX);
    for end in ["halt", "cancel", "connection", "enable"] {
        let mut robot = ready(bare("A"));
        robot.command.start_time_ns = far.as_nanos();
        robot.call(Skill::MoveContinuous, vec![lin(100.0, 0.0, 100.0)]);
        robot.run_ms(5_000);
        let waiting = *robot.feedback();
        assert_eq!((waiting.state, waiting.executed), (State::Running, 0));
        assert!(waiting.status.contains(Status::BUSY | Status::AT_REST), "{waiting:?}");
        match end {
            "halt" => robot.command.control = Control::ENABLE | Control::HALT,
            "cancel" => robot.command.control = Control::ENABLE | Control::CANCEL,
            "enable" => robot.command.control = Control::default(),
            _ => robot.connected = false,
        }
        robot.tick();
        let ended = *robot.feedback();
        let state = if end == "cancel" { State::Ready } else { State::Halted };
        assert_eq!((ended.state, ended.path_speed), (state, 0.0), "{end}: {ended:?}");
        let is_over = |event: &RobotEvent| matches!(event, RobotEvent::SkillFinished { executed: 0, .. });
        assert!(robot.events.iter().any(is_over), "{end}");
    }
}

#[test]
fn a_suspend_holds_a_start_and_a_resume_after_the_start_time_starts_at_once() {
    use protocol::image::Control;
    let mut robot = ready(bare("A"));
    let start = robot.at + Duration::from_millis(400);
    robot.command.start_time_ns = start.as_nanos();
    robot.call(Skill::MoveContinuous, vec![lin(100.0, 0.0, 100.0)]);
    robot.run_ms(100);
    robot.control(Control::SUSPEND);
    robot.run_ms(1_000);
    assert_eq!((robot.feedback().state, robot.feedback().path_speed), (State::Suspended, 0.0));
    robot.control(Control::RESUME);
    robot.run_ms(12);
    assert!(robot.feedback().path_speed > 0.0, "{:?}", robot.feedback());
    robot.wait_for_end();
    assert!(robot.is_done());
}

/// A robot in the PLC's time: its clock began then, and is faster by that.
struct Station {
    robot: Driven,
    clock: RobotClock,
    began_ns: f64,
    drift: f64,
    random: u64,
}

impl Station {
    /// The PLC's time at the robot's present cycle, in ns.
    fn plc_ns(&self) -> f64 {
        self.began_ns + self.robot.at.as_nanos() as f64 / (1.0 + self.drift)
    }

    /// Runs a cycle; its feedback comes 150 µs and a jitter of up to 100 µs later.
    fn tick(&mut self) {
        self.robot.tick();
        self.random = self.random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        let jitter_ns = (self.random >> 33) % 100_000;
        let seen = Instant::from_nanos(self.plc_ns() as u64 + 150_000 + jitter_ns);
        self.clock.observe(seen, self.robot.feedback().clock_ns);
    }
}

#[test]
fn two_robots_with_different_clocks_start_within_a_cycle_and_100_us() {
    let phases = [(300_000.0, 30e-6), (5_912_345.0, -80e-6), (47_654_321.0, 100e-6)];
    let mut stations = phases.map(|(began_ns, drift)| {
        let delay = StampDelay { least: Duration::from_micros(150), spread: Duration::ZERO };
        let (robot, clock) =
            (ready(RobotConfig { continuous_start_cycles: 2, ..bare("A") }), RobotClock::new(delay));
        Station { robot, clock, began_ns, drift, random: began_ns as u64 }
    });
    for station in &mut stations {
        while station.plc_ns() < 45e9 {
            station.tick();
        }
    }
    let at_ns = 45_300_000_000_u64;
    let mut start_times = [0; 3];
    let clocks = stations.iter().map(|station| &station.clock);
    let skew = start_together(Instant::from_nanos(at_ns), clocks, &mut start_times).unwrap();
    assert!(skew < Duration::from_micros(50), "{skew:?}");
    for (station, start) in stations.iter_mut().zip(start_times) {
        let moved = moved_at(&mut station.robot, Instant::from_nanos(start));
        // The motion begins one cycle before it shows.
        let began_ns = station.plc_ns() - 4e6 / (1.0 + station.drift);
        let after_ns = began_ns - at_ns as f64;
        assert!((-100e3..4.1e6).contains(&after_ns), "{after_ns} ns, moved at {moved:?}");
    }
}
