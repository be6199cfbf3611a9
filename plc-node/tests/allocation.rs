//! The cyclic path takes no memory from the heap after the start.

use machine::wire::{BigEndian, FRAME_CAPACITY};
use machine::{Duration, Instant, Multihomed, Port, Source};
use planning::{Stop, Switch, ToStart};
use plc_node::{ExecutionType, MotionList, PlcConfig, PlcEvent, PlcNode};
use protocol::direct::Direct;
use protocol::image::{Command, Feedback, IMAGE_LEN, Motion, MotionKind, Skill, State, Status};
use protocol::one_station::OneStation;
use protocol_linux::allocation::{self, AllocationCounter};

#[global_allocator]
static ALLOCATOR: AllocationCounter = AllocationCounter;

/// Answers a command as a robot that ends a motion with every image it sends.
fn answer(command: &Command, feedback: &mut Feedback) {
    feedback.life = feedback.life.wrapping_add(1);
    feedback.life_echo = command.life;
    if command.number != feedback.number {
        (feedback.number, feedback.executed) = (command.number, 0);
        (feedback.state, feedback.status) = (State::Running, Status::BUSY | Status::ENABLED);
        return;
    }
    if feedback.state == State::Running {
        let total = if command.skill == Skill::RunProgram { 13 } else { command.total };
        feedback.executed += 1;
        feedback.accepted = command.written;
        if feedback.executed == total {
            (feedback.state, feedback.status) = (State::Ready, Status::DONE | Status::ENABLED);
        }
    }
}

#[test]
fn no_scan_frame_or_run_allocates_after_the_start() {
    const MS: Duration = Duration::from_millis(1);
    let motion = Motion { kind: MotionKind::LinCartesian, ..Motion::EMPTY };
    let switch = Switch { output: 1, set: true, wait: MS };
    let config = PlcConfig {
        scan_cycle: MS,
        scan_cost: Duration::ZERO,
        answer_timeout: MS * 100,
        silent_timeout: MS * 100,
        robot_cycle: MS,
        queue_depth: 5,
        program: 1,
        motions: Box::new(MotionList::from(vec![motion; 13])),
        to_start: ToStart { from_anywhere: Some(motion), from_end: vec![motion; 2] },
        stops: vec![Stop { after: 5, then: None }, Stop { after: 13, then: Some(switch) }],
    };
    let mut plc =
        PlcNode::new(config, OneStation::new(Direct::new(Instant::ZERO, MS, MS * 20)), Instant::ZERO);
    let mut feedback = Feedback { state: State::Ready, status: Status::ENABLED, ..Feedback::default() };
    let (mut frame, mut image) = (vec![0; FRAME_CAPACITY], [0; IMAGE_LEN]);
    let source = Source { port: Port::Ethernet, peer: None };

    assert!(allocation::arm(), "the counter is installed");
    let (mut now, mut runs, mut failed) = (Instant::ZERO, 0, 0);
    for _ in 0..30_000 {
        now = plc.poll_timeout().unwrap().max(now);
        plc.handle_timeout(now);
        while let Some((on, transmit)) = plc.poll_transmit(now, &mut frame) {
            answer(&Command::parse::<BigEndian>(&frame[..transmit.len]).unwrap(), &mut feedback);
            feedback.emit::<BigEndian>(&mut image);
            plc.handle_frame(now, on, source, &image);
        }
        while let Some(report) = plc.poll_event() {
            match report.event {
                PlcEvent::Ready => {
                    plc.start(now, ExecutionType::ALL[runs % 3]).unwrap();
                    runs += 1;
                }
                PlcEvent::Failed(_) => failed += 1,
                _ => {}
            }
        }
    }
    assert_eq!(allocation::count(), 0, "in {runs} runs");
    assert!(runs > 1_000 && failed == 0, "{runs} runs, {failed} failed");
}
