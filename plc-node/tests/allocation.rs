//! The cyclic path takes no memory from the heap after the start.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on stops")]

use machine::wire::{BigEndian, FRAME_CAPACITY};
use machine::{Duration, Instant, Multihomed, Port, Source};
use planning::{Stop, Switch, ToStart, WaitAt, ZoneVisit};
use plc_node::robot_clock::StampDelay;
use plc_node::{
    ArmInStep, ExecutionType, MotionList, PlacedStation, PlcConfig, PlcEvent, PlcNode, RobotTimes, Scan,
    Sequences, StationConfig, StationWork, TogetherLeg, TogetherSection, WaitLimits,
};
use protocol::direct::Direct;
use protocol::fieldbus::StationId;
use protocol::image::{
    Command, Control, Feedback, IMAGE_LEN, Motion, MotionKind, Services, Skill, State, Status,
};
use protocol::one_station::OneStation;
use protocol_linux::allocation::{self, AllocationCounter};

#[global_allocator]
static ALLOCATOR: AllocationCounter = AllocationCounter;

/// Answers a command as a robot that ends a motion with every image it sends, if it has one.
fn answer(command: &Command, feedback: &mut Feedback) {
    feedback.life = feedback.life.wrapping_add(1);
    feedback.life_echo = command.life;
    let control = command.control;
    if control.contains(Control::HALT) {
        (feedback.state, feedback.status) =
            (State::Halted, Status::ABORTED | Status::AT_REST | Status::ENABLED);
    } else if feedback.state == State::Halted && control.contains(Control::RESET) {
        (feedback.state, feedback.status) = (State::Ready, Status::AT_REST | Status::ENABLED);
    } else if control.contains(Control::EXECUTE) && command.number != feedback.number {
        (feedback.number, feedback.executed) = (command.number, 0);
        (feedback.state, feedback.status) = (State::Running, Status::BUSY | Status::ENABLED);
    } else if feedback.state == State::Running {
        let is_program = command.skill == Skill::RunProgram;
        let total = if is_program { 13 } else { command.total };
        feedback.accepted = command.written;
        feedback.executed += u32::from(is_program || feedback.executed < command.written);
        if feedback.executed == total {
            (feedback.state, feedback.status) = (State::Ready, Status::DONE | Status::ENABLED);
        }
    }
}

const MS: Duration = Duration::from_millis(1);
const MOTION: Motion = Motion { kind: MotionKind::LinCartesian, ..Motion::EMPTY };

fn bus() -> OneStation<Direct> {
    OneStation::new(Direct::new(Instant::ZERO, MS, MS * 20))
}

fn stops() -> Vec<Stop> {
    let switch = Switch { output: 1, set: true, wait: MS };
    vec![Stop { after: 5, then: None }, Stop { after: 13, then: Some(switch) }]
}

fn with_one_station() -> PlcNode<OneStation<Direct>> {
    let config = PlcConfig {
        scan_cycle: MS,
        scan_cost: Duration::ZERO,
        answer_timeout: MS * 100,
        silent_timeout: MS * 100,
        robot_cycle: MS,
        queue_depth: 5,
        refill: setup::Refill::Executed,
        program: 1,
        motions: Box::new(MotionList::from(vec![MOTION; 13])),
        arm: plc_node::DescribedArm::from_setup(&setup::setup("A").unwrap()),
        to_start: ToStart { from_anywhere: Some(MOTION), from_end: vec![MOTION; 2] },
        stops: stops(),
    };
    PlcNode::new(config, bus(), Instant::ZERO)
}

/// Two stations with a mark; RC has one program of 13 motions for both sections.
fn with_two_stations() -> PlcNode<OneStation<Direct>> {
    let placed = |bus| PlacedStation {
        bus,
        id: StationId::FIRST,
        config: StationConfig {
            name: String::new(),
            wait_limits: WaitLimits { answer_scans: 100, silent_scans: 100 },
            answer_timeout: MS * 100,
            robot_cycle: MS,
            arm: plc_node::DescribedArm::from_setup(&setup::setup("B").unwrap()),
            to_start: ToStart { from_anywhere: Some(MOTION), from_end: vec![MOTION; 2] },
            longest_stop: MS,
        },
    };
    let work = |after| StationWork {
        program: 1,
        queue_depth: 5,
        refill: setup::Refill::Executed,
        motions: Box::new(MotionList::from(vec![MOTION; 13])),
        stops: stops(),
        waits: vec![WaitAt { mark: 1, after, after_action: false, signal: None }],
        visits: vec![ZoneVisit { zone: 0, after: after + 2, until: after + 4 }],
        zones: None,
    };
    let scan = Scan::new(Instant::ZERO, MS, Duration::ZERO);
    let program = Sequences::new(vec![work(3), work(7)]);
    let arm = || ArmInStep {
        stamp: StampDelay { least: Duration::ZERO, spread: MS },
        times: RobotTimes::default(),
        sections: vec![TogetherSection {
            mark: 1,
            legs: vec![TogetherLeg { end: 13, law: MS * 50 }],
            has_force: false,
        }],
    };
    PlcNode::with_program(scan, vec![bus(), bus()], vec![placed(0), placed(1)], program)
        .in_step(vec![arm(), arm()])
}

/// Runs so many steps. In every fourth run a robot of several is lost. Returns the runs, and those that failed.
fn run(plc: &mut PlcNode<OneStation<Direct>>, steps: usize) -> [usize; 2] {
    let stations = plc.stations().len();
    let (state, status, services) = (State::Ready, Status::ENABLED, Services::SYNC);
    let robot = Feedback { state, status, services, ..Feedback::default() };
    let (mut robots, mut frame, mut image) = ([robot; 2], [0; FRAME_CAPACITY], [0; IMAGE_LEN]);
    let source = Source { port: Port::Ethernet, peer: None };
    let (mut now, mut runs, mut failed, mut silent) = (Instant::ZERO, 0, 0, 0);
    for _ in 0..steps {
        now = plc.poll_timeout().unwrap().max(now);
        plc.handle_timeout(now);
        silent -= usize::from(silent > 0);
        while let Some((on, transmit)) = plc.poll_transmit(now, &mut frame) {
            let robot = &mut robots[usize::from(on.0)];
            answer(&Command::parse::<BigEndian>(&frame[..transmit.len]).unwrap(), robot);
            robot.clock_ns = now.as_nanos();
            robot.emit::<BigEndian>(&mut image);
            if silent == 0 || usize::from(on.0) != runs / 4 % stations {
                plc.handle_frame(now, on, source, &image);
            }
        }
        while let Some(report) = plc.poll_event() {
            match report.event {
                PlcEvent::Ready => {
                    plc.start(now, ExecutionType::ALL[runs % 3]).unwrap();
                    runs += 1;
                    silent = if stations > 1 && runs % 4 == 0 { 40 } else { 0 };
                }
                PlcEvent::Failed(_) => failed += 1,
                _ => {}
            }
        }
    }
    [runs, failed]
}

#[test]
fn no_scan_frame_run_or_loss_of_a_station_allocates_after_the_start() {
    let (mut one, mut two) = (with_one_station(), with_two_stations());
    assert!(allocation::arm(), "the counter is installed");
    let [runs, failed] = run(&mut one, 30_000);
    assert_eq!(allocation::count(), 0, "in {runs} runs");
    let [runs_of_two, failed_of_two] = run(&mut two, 60_000);
    assert_eq!(allocation::count(), 0, "in {runs_of_two} runs of two stations");
    assert!(runs > 1_000 && failed == 0, "{runs} runs, {failed} failed");
    assert!(failed_of_two > 100, "{runs_of_two} runs, {failed_of_two} failed");
    assert!(runs_of_two > failed_of_two * 2, "{runs_of_two} runs, {failed_of_two} failed");
}
