//! Causes of a block's error: the events of the script since the image that the program saw when it started the block.

use std::collections::BTreeMap;

use plc_node::AxesGroup;
use plc_node::function_blocks::{BlockError, BufferMode, Outputs};
use protocol::image::{Control, ErrorNumber, Feedback, State, Status};

use super::cell::BAD_MOTION;
use super::plc::{BLOCKS, DISABLE, ENABLE, HALT, INTERRUPT, RESET, SKILLS, STOP};
use super::rules::{Broken, Rule, Rules, broken};

/// The last scan of each kind of event; 0: never.
#[derive(Clone, Copy, Default, Debug)]
struct LastScans {
    halt: u64,
    no_enable: u64,
    suspend: u64,
    reset: u64,
    lost: u64,
    busy: [u64; BLOCKS],
}

/// Knowledge of the program when it started a block.
#[derive(Clone, Copy, Default, Debug)]
struct StartView {
    /// Scan in which it started the block.
    scan: u64,
    /// Scan whose image the robot had followed before it sent the image that the program saw.
    echo: u64,
    is_ready: bool,
    is_enabled: bool,
    number: u16,
    /// Last scan with RESET before the block.
    reset_before: u64,
    /// The robot has followed an image without RESET since then.
    has_rearmed: bool,
}

/// Events of a script.
#[derive(Clone, Default, Debug)]
pub(crate) struct Causes {
    last: LastScans,
    /// First scan from which on all images forbid `Ready`; 0: the present one does not.
    unready_since: u64,
    /// Scans that the robot echoed last, the newer one second: it read the control bits of an image between them.
    echoes: [u64; 2],
    /// When the robot last showed an error of each command.
    failures: BTreeMap<u16, u64>,
    starts: [StartView; BLOCKS],
}

/// An error of a block, with what only the cell knows.
pub(crate) struct BlockFailure<'a> {
    pub(crate) block: usize,
    pub(crate) error: BlockError,
    pub(crate) group: &'a AxesGroup,
    pub(crate) outputs: &'a [Outputs; BLOCKS],
    pub(crate) mode: BufferMode,
    /// The block's motions contain one that is out of reach.
    pub(crate) has_bad: bool,
}

impl Causes {
    /// Notes what the program sends in this scan.
    pub(crate) fn note_scan(&mut self, group: &AxesGroup, is_lost: bool, outputs: &[Outputs; BLOCKS]) {
        let (scan, control) = (group.scans(), group.command().control);
        let has = |bit| control.contains(bit);
        if is_lost || !has(Control::HALT) && has(Control::ENABLE) {
            self.unready_since = 0;
        } else if self.unready_since == 0 {
            self.unready_since = scan;
        }
        let last = &mut self.last;
        for (event, happens) in [
            (&mut last.halt, has(Control::HALT)),
            (&mut last.no_enable, !has(Control::ENABLE)),
            (&mut last.suspend, has(Control::SUSPEND)),
            (&mut last.reset, has(Control::RESET)),
            (&mut last.lost, is_lost),
        ] {
            if happens {
                *event = scan;
            }
        }
        for (busy, outputs) in last.busy.iter_mut().zip(outputs) {
            if outputs.busy {
                *busy = scan;
            }
        }
    }

    /// Notes an image of the robot.
    ///
    /// # Errors
    /// The robot echoes an image that forbids `Ready`, and shows `Ready`.
    pub(crate) fn note_image(&mut self, scan: u64, shown: &Feedback) -> Result<(), Broken> {
        if shown.status.contains(Status::ERROR) {
            self.failures.insert(shown.number, scan);
        }
        let echo = scan.saturating_sub(((scan as u16).wrapping_sub(shown.life_echo)).into());
        if echo != self.echoes[1] {
            self.echoes = [self.echoes[1], echo];
            for start in &mut self.starts {
                start.has_rearmed |= self.echoes[0] > start.reset_before && echo < start.scan;
            }
            if self.unready_since > 0 && echo >= self.unready_since && shown.state == State::Ready {
                let text = format!("scan {echo} is echoed, HALT or no ENABLE since {}", self.unready_since);
                return broken(Rule::EchoAhead, text);
            }
        }
        Ok(())
    }

    /// Returns the last scan in which the robot showed an error of another command.
    fn other_failure(&self, number: u16) -> u64 {
        let others = self.failures.iter().filter(|(other, _)| **other != number);
        others.map(|(_, scan)| *scan).max().unwrap_or(0)
    }

    /// Returns whether something has kept a reset of this block from acting: it acts once when the robot sees it set after it saw it
    /// cleared, on an enabled robot that nothing stops and that executes nothing.
    fn hinders_reset(&self, block: usize) -> bool {
        let (last, start) = (&self.last, &self.starts[block]);
        let others = (0..SKILLS).chain([ENABLE, DISABLE, RESET, STOP]).filter(|other| *other != block);
        let busy = others.map(|other| last.busy[other]);
        [last.halt, last.no_enable, last.lost, self.other_failure(0)]
            .into_iter()
            .chain(busy)
            .any(|scan| scan >= start.scan)
            || !start.has_rearmed
    }

    /// Notes that a block starts: a group block by its edge, a skill when its command is written.
    pub(crate) fn note_start(&mut self, block: usize, group: &AxesGroup) {
        let scan = group.scans();
        let echo = group
            .feedback()
            .map_or(0, |view| scan.saturating_sub(u64::from((scan as u16).wrapping_sub(view.life_echo))));
        let status = |bit| group.feedback().is_some_and(|view| view.status.contains(bit));
        self.starts[block] = StartView {
            scan,
            echo,
            is_ready: group.feedback().is_some_and(|view| view.state == State::Ready),
            is_enabled: status(Status::ENABLED),
            number: group.command().number,
            reset_before: self.last.reset,
            has_rearmed: self.last.reset == 0 || self.echoes[0] > self.last.reset,
        };
    }

    /// Returns whether the events of the script explain an error.
    pub(crate) fn explain(&self, failure: &BlockFailure<'_>, rules: &Rules) -> bool {
        let &BlockFailure { block, error, group, outputs, mode, has_bad } = failure;
        let (last, start) = (&self.last, &self.starts[block]);
        let since_view = |scan: u64| scan > start.echo;
        let view = group.feedback();
        match error {
            BlockError::Robot { number, motion, .. } => match number {
                ErrorNumber::Unreachable => has_bad && motion == BAD_MOTION,
                // The program did not see `Ready`, or what ends it came after that image.
                ErrorNumber::NotReady => {
                    // A suspend that meets a skill at its end leaves the robot halted after DONE, without an error.
                    let ends_ready = [
                        last.halt,
                        last.no_enable,
                        last.lost,
                        last.suspend,
                        self.other_failure(start.number),
                    ];
                    !start.is_ready || ends_ready.into_iter().any(since_view)
                }
                ErrorNumber::Disabled => since_view(last.no_enable),
                ErrorNumber::NotServed => since_view(last.suspend),
                ErrorNumber::ConnectionLost => since_view(last.lost),
                _ => false,
            },
            BlockError::StateNotReached { .. } => {
                matches!(block, RESET | ENABLE) && self.hinders_reset(block)
            }
            // A reset took the answer back before the program saw it.
            BlockError::NoAnswer { number, .. } | BlockError::EndUnknown { number }
                if rules.was_taken_back(number) =>
            {
                since_view(last.reset)
            }
            // The first number of a connection is an old one: a program that does not wait for ENABLED loses its command.
            BlockError::NoAnswer { .. } => last.lost > 0 && (since_view(last.lost) || !start.is_enabled),
            BlockError::NotConnected => view.is_none(),
            BlockError::Stopping => group.command().control.contains(Control::HALT),
            BlockError::QueueFull => {
                let others = (0..SKILLS).filter(|other| *other != block);
                mode == BufferMode::Buffered && others.into_iter().any(|other| outputs[other].busy)
            }
            BlockError::InError { .. } => {
                block == ENABLE && view.is_some_and(|view| view.status.contains(Status::ERROR))
            }
            BlockError::NothingToDo(_) => match block {
                INTERRUPT => view.is_some_and(|view| view.state != State::Running),
                HALT => view.is_some_and(|view| view.state == State::Halted),
                _ => false,
            },
            _ => false,
        }
    }
}
