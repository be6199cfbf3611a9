//! Commands, faults and cut cables in random order: each run ends exactly once, and the robot always becomes ready
//! again.

use machine::Duration;
use plc_node::{ExecutionType, PlcEvent, PlcReport};
use proptest::prelude::*;
use protocol::image::ErrorNumber;
use virtual_time::Event;

use crate::scripted::{Cell, Fault, cell, run};

#[derive(Clone, Copy, Debug)]
enum Action {
    Start(ExecutionType),
    Abort,
    Disconnect,
    Cut,
    Mend,
    Break(Fault),
    RestartRobotController,
}

fn action() -> impl Strategy<Value = Action> {
    let number = ErrorNumber::Unreachable;
    prop_oneof![
        4 => proptest::sample::select(&ExecutionType::ALL).prop_map(Action::Start),
        1 => Just(Action::Abort),
        1 => Just(Action::Disconnect),
        1 => Just(Action::Cut),
        2 => Just(Action::Mend),
        1 => Just(Action::RestartRobotController),
        1 => (1..20_u32).prop_map(move |at| Action::Break(Fault::Error { at, number })),
        1 => (1..20_u32).prop_map(|at| Action::Break(Fault::Abort { at })),
        1 => (0..20_u32).prop_map(|at| Action::Break(Fault::LifeStandsStill { at })),
        1 => Just(Action::Break(Fault::Deaf)),
        1 => Just(Action::Break(Fault::IgnoresReset)),
        1 => Just(Action::Break(Fault::None)),
    ]
}

/// Counts accepted runs and ended runs.
#[derive(Default, Debug)]
struct Book {
    accepted: u32,
    ended: u32,
}

impl Book {
    fn go_on(&mut self, cell: &mut Cell, time: Duration) {
        let until = cell.now() + time;
        while let Some(event) = cell.next_event(until) {
            if let Event::A(PlcReport { event: PlcEvent::Finished(_) | PlcEvent::Failed(_), .. }) = event {
                self.ended += 1;
            }
        }
    }

    fn act(&mut self, cell: &mut Cell, action: Action) {
        match action {
            Action::Start(execution_type) => {
                let started = cell.command_a(|plc, now| plc.start(now, execution_type));
                self.accepted += u32::from(started.is_ok());
            }
            Action::Abort => cell.command_a(|plc, now| plc.abort(now)),
            Action::Disconnect => cell.command_a(|plc, now| plc.disconnect(now)),
            Action::Cut => cell.set_cut(true),
            Action::Mend => cell.set_cut(false),
            Action::Break(fault) => cell.command_b(|robot, _| robot.fault = fault),
            Action::RestartRobotController => cell.command_b(|robot, _| robot.restart()),
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]
    #[test]
    fn each_run_ends_exactly_once_and_the_robot_becomes_ready_again(
        script in proptest::collection::vec((action(), 0..60_000_u64), 1..30),
    ) {
        let mut cell = cell(6);
        cell.command_b(|robot, _| (robot.motion_cycles, robot.program_motions) = (2, 6));
        let mut book = Book::default();
        for (action, micros) in script {
            book.act(&mut cell, action);
            book.go_on(&mut cell, Duration::from_micros(micros));
            prop_assert!(book.accepted - book.ended <= 1, "{book:?}");
        }
        book.act(&mut cell, Action::Mend);
        book.act(&mut cell, Action::Break(Fault::None));
        book.go_on(&mut cell, Duration::from_secs(1));
        prop_assert_eq!(book.accepted, book.ended);
        prop_assert!(cell.a().is_ready(), "{:?}", cell.a().command());
        for execution_type in ExecutionType::ALL {
            prop_assert_eq!(run(&mut cell, execution_type).motions, 6);
        }
    }
}
