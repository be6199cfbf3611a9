//! Waits of the robot: it says every ten seconds what it waits for, and goes on as soon as that comes.

use protocol::image::{Control, Skill, Status};
use robot_node::{RobotEvent, WaitingFor};

use crate::plc::{Cell, application, lin};

/// Lets 35 s pass and returns what the robot said of its waits, with their seconds.
fn said(cell: &mut Cell) -> Vec<(u32, WaitingFor)> {
    cell.events.clear();
    cell.run_ms(35_000);
    let events = cell.events.iter().filter_map(|(_, event)| match event {
        RobotEvent::Waiting { for_what, seconds } => Some((*seconds, *for_what)),
        _ => None,
    });
    events.collect()
}

/// Checks that a wait was said every ten seconds.
#[track_caller]
fn every_ten_seconds(said: &[(u32, WaitingFor)], is_wanted: impl Fn(&WaitingFor) -> bool) {
    assert_eq!(said.iter().map(|(seconds, _)| *seconds).collect::<Vec<_>>(), [10, 20, 30], "{said:?}");
    assert!(said.iter().all(|(_, what)| is_wanted(what)), "{said:?}");
}

#[test]
fn a_robot_without_a_plc_says_so_and_a_ready_one_with_a_plc_says_nothing() {
    let mut cell = Cell::ready(application());
    assert_eq!(said(&mut cell), []);
    cell.pair.set_cut(true);
    cell.run_ms(25);
    every_ten_seconds(&said(&mut cell), |what| *what == WaitingFor::Plc);
    cell.pair.set_cut(false);
    cell.run_ms(25);
    assert_eq!(said(&mut cell), []);
}

#[test]
fn a_plc_whose_program_stands_still_is_named_and_one_that_has_no_life_counter_is_not() {
    let mut cell = Cell::ready(application());
    cell.pair.command_a(|plc, _| plc.stands = true);
    cell.run_ms(25);
    every_ten_seconds(&said(&mut cell), |what| matches!(what, WaitingFor::Life { .. }));
    // A new connection to a PLC whose counter never moves.
    cell.pair.set_cut(true);
    cell.run_ms(100);
    cell.pair.set_cut(false);
    cell.run_ms(25);
    assert_eq!(said(&mut cell), []);
}

#[test]
fn an_override_of_zero_a_suspended_skill_and_a_missing_motion_are_named_and_the_skill_ends_after_them() {
    let motions = || vec![lin(400.0, 0.0, 150.0, 0), lin(400.0, 100.0, 150.0, 0), lin(400.0, 0.0, 150.0, 0)];
    for wait in ["override", "suspend", "motion", "start time", "master"] {
        let mut cell = Cell::ready(application());
        let keep_back = usize::from(wait == "motion");
        cell.call_keeping_back(Skill::MoveContinuous, motions(), keep_back);
        if wait == "start time" {
            let far = cell.feedback().clock_ns + 3_600_000_000_000;
            cell.command(|command| command.start_time_ns = far);
        }
        cell.run_ms(700);
        match wait {
            "override" => cell.command(|command| command.override_percent = 0),
            "suspend" => cell.control(Control::ENABLE | Control::EXECUTE | Control::SUSPEND),
            "master" => cell.control(Control::ENABLE | Control::EXECUTE | Control::SYNC),
            "start time" => {}
            _ => cell.wait(|feedback| feedback.executed == 2),
        }
        cell.run_ms(500);
        let said = said(&mut cell);
        every_ten_seconds(&said, |what| match wait {
            "override" => matches!(what, WaitingFor::Override { .. }),
            "suspend" => matches!(what, WaitingFor::Resume { .. }),
            "master" => matches!(what, WaitingFor::Master { .. }),
            "start time" => matches!(what, WaitingFor::StartTime { .. }),
            _ => matches!(what, WaitingFor::Motion { written: 2, total: 3, .. }),
        });
        match wait {
            "override" => cell.command(|command| command.override_percent = 100),
            "suspend" => cell.control(Control::ENABLE | Control::EXECUTE | Control::RESUME),
            "master" => cell.control(Control::ENABLE | Control::EXECUTE),
            "start time" => {
                cell.control(Control::ENABLE | Control::CANCEL);
                cell.wait(|feedback| feedback.state == protocol::image::State::Ready);
                continue;
            }
            _ => cell.pair.command_a(|plc, _| plc.keep_back = 0),
        }
        cell.wait_for_end();
        assert!(cell.feedback().status.contains(Status::DONE), "{wait}: {:?}", cell.feedback());
    }
}
