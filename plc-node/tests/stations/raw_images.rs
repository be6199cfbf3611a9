//! A program that knows nothing but images.

use machine::Instant;
use plc_node::{ExecutionType, PlcEvent, PlcProgram, Progress, Station};
use protocol::image::{Command, CommandSealer, Control, IMAGE_LEN, Image, Motion, Skill, State, Status};

use crate::cell::{LEFT, MS, RIGHT, cell_with, motions, placed};

/// Runs three motions at each station by bytes alone.
#[derive(Debug, Default)]
struct Foreign {
    numbers: [u16; 2],
    lives: [u16; 2],
    /// Gives a run up in its first scan, after it has set its images.
    gives_up: bool,
}

impl Foreign {
    fn command(&self, station: usize, motions: &[Motion]) -> Command {
        let mut command = Command {
            skill: Skill::MoveContinuous,
            number: self.numbers[station],
            life: self.lives[station],
            total: motions.len() as u32,
            written: motions.len() as u32,
            override_percent: 100,
            ..Command::default()
        };
        command.control = Control::ENABLE | Control::EXECUTE;
        (0..).zip(motions).for_each(|(index, motion)| command.set_slot(index, *motion));
        command
    }
}

impl PlcProgram for Foreign {
    fn begin(&mut self, _now: Instant, _execution_type: ExecutionType) {
        self.numbers = [0; 2];
    }

    fn scan(&mut self, _now: Instant, stations: &mut [Station]) -> Progress {
        let mut are_done = true;
        for (index, station) in stations.iter_mut().enumerate() {
            let order = station.byte_order();
            let Some(feedback) = station.image().and_then(|image| order.parse_feedback(image).ok()) else {
                return Progress::Aborted { station: index };
            };
            if self.numbers[index] == 0 {
                self.numbers[index] = feedback.number.wrapping_add(100).max(1);
                self.lives[index] = station.group().command().life;
            }
            self.lives[index] = self.lives[index].wrapping_add(1);
            let command = self.command(index, &motions(index, 3));
            let mut image: Image = [0; IMAGE_LEN];
            order.emit_command(&command, &mut image);
            let mut sealer = CommandSealer::default();
            sealer.take_tail(&image);
            sealer.seal(order, &mut image);
            station.set_image(&image);
            are_done &= feedback.number == self.numbers[index]
                && feedback.state == State::Ready
                && feedback.status.contains(Status::DONE);
        }
        if self.gives_up {
            return Progress::Aborted { station: RIGHT };
        }
        if are_done { Progress::Done } else { Progress::Running }
    }
}

#[test]
fn a_program_that_works_on_bytes_alone_moves_both_robots() {
    let mut cell = cell_with(Foreign::default(), [placed(0, 0, "left"), placed(1, 0, "right")]);
    for _ in 0..3 {
        cell.start(ExecutionType::Cm);
        cell.wait_for(|report| match report.event {
            PlcEvent::Finished(_) => Some(()),
            PlcEvent::Failed(failure) => panic!("{failure}"),
            _ => None,
        });
        let _ = cell.reports(MS * 10);
        for station in [LEFT, RIGHT] {
            assert_eq!(cell.robot(station, |robot| robot.taken.clone()), motions(station, 3));
        }
    }
}

#[test]
fn an_image_that_the_program_set_in_the_scan_in_which_its_run_failed_does_not_go_out() {
    let program = Foreign { gives_up: true, ..Foreign::default() };
    let mut cell = cell_with(program, [placed(0, 0, "left"), placed(1, 0, "right")]);
    // Robots look at their images only every fourth millisecond.
    for pause in 0..8 {
        cell.until_ready();
        let _ = cell.reports(MS * (20 + pause));
        cell.start(ExecutionType::Cm);
        assert_eq!(cell.failure().0, Some(RIGHT));
        let _ = cell.reports(MS * 20);
        for station in [LEFT, RIGHT] {
            assert_eq!(cell.robot(station, |robot| robot.skills.clone()), []);
        }
    }
}
