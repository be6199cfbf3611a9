//! The PLC's two modes of operation: it follows instructions, or the command line alone.

use std::fmt;

use node::Outcome;
use node::supervise::{Next, OperatingMode};
use protocol::fieldbus::{ControllerBus, LinkEvent};

use super::message::{PlcInstruction, PlcMessage, PlcOrder, PlcRefusal, message, refusal};
use crate::{ExecutionType, OverrideSchedule, PlcEvent, PlcNode, PlcProgram, PlcReport, StartError};

/// The mode in which the PLC follows instructions.
#[derive(Default)]
pub(super) struct OnInstruction {
    /// Whether the robot was ready at its last message. A controller that connects later gets this state.
    ready: bool,
}

impl<B, P> OperatingMode<PlcNode<B, P>> for OnInstruction
where
    B: ControllerBus + Send + fmt::Debug + 'static,
    P: PlcProgram + 'static,
{
    type Message = PlcMessage;
    type Instruction = PlcInstruction;

    fn event(&mut self, report: PlcReport) -> (Option<PlcMessage>, Next<PlcOrder>) {
        self.ready = matches!(report.event, PlcEvent::Ready);
        (message(&report.event), Next::Wait)
    }

    fn link(&mut self, event: LinkEvent) -> Next<PlcOrder> {
        self.ready &= !matches!(event, LinkEvent::Down(_));
        Next::Wait
    }

    fn greeting(&self) -> Option<PlcMessage> {
        self.ready.then_some(PlcMessage::Ready)
    }

    fn controller_left(&mut self) -> Next<PlcOrder> {
        Next::Order(PlcOrder::Abort)
    }

    fn answer(&mut self, answer: PlcRefusal) -> (PlcMessage, Next<PlcOrder>) {
        let is_unready = matches!(
            answer,
            PlcRefusal::Start { error: StartError::NotConnected | StartError::NotReady { .. }, .. }
        );
        self.ready &= !is_unready;
        (refusal(answer), Next::Wait)
    }

    fn answered_station(answer: &PlcRefusal) -> Option<usize> {
        match answer {
            PlcRefusal::Start { station, .. } => *station,
            PlcRefusal::Override(_) => None,
        }
    }

    fn instruction(&mut self, instruction: PlcInstruction) -> PlcOrder {
        instruction.into()
    }

    fn refuse(&self, reason: String) -> PlcMessage {
        PlcMessage::Refused { reason }
    }
}

/// Runs its repetitions and ends.
pub(super) struct Standalone {
    /// The runs to come, the next one last.
    runs: Vec<ExecutionType>,
    overrides: Option<OverrideSchedule>,
}

impl Standalone {
    pub(super) fn new(types: &[ExecutionType], reps: u32, overrides: Option<OverrideSchedule>) -> Self {
        let mut runs: Vec<_> = (0..reps).flat_map(|_| types.iter().copied()).collect();
        runs.reverse();
        Self { runs, overrides }
    }

    fn next(&mut self) -> Next<PlcOrder> {
        let start = |run| Next::Order(PlcOrder::Start(run, self.overrides));
        self.runs.pop().map_or(Next::End(Outcome::Done), start)
    }
}

impl<B, P> OperatingMode<PlcNode<B, P>> for Standalone
where
    B: ControllerBus + Send + fmt::Debug + 'static,
    P: PlcProgram + 'static,
{
    type Message = PlcMessage;
    type Instruction = PlcInstruction;

    fn event(&mut self, report: PlcReport) -> (Option<PlcMessage>, Next<PlcOrder>) {
        let next = match report.event {
            PlcEvent::Ready => self.next(),
            PlcEvent::Failed(_) => Next::End(Outcome::RunFailed),
            PlcEvent::Link(_)
            | PlcEvent::ImageBad
            | PlcEvent::ImageGood
            | PlcEvent::LifeStill
            | PlcEvent::MovingToStart
            | PlcEvent::Started { .. }
            | PlcEvent::Waiting { .. }
            | PlcEvent::Passed(_)
            | PlcEvent::Finished(_) => Next::Wait,
        };
        (message(&report.event), next)
    }

    fn answer(&mut self, answer: PlcRefusal) -> (PlcMessage, Next<PlcOrder>) {
        (refusal(answer), Next::End(Outcome::RunFailed))
    }

    fn answered_station(answer: &PlcRefusal) -> Option<usize> {
        match answer {
            PlcRefusal::Start { station, .. } => *station,
            PlcRefusal::Override(_) => None,
        }
    }

    fn instruction(&mut self, instruction: PlcInstruction) -> PlcOrder {
        instruction.into()
    }

    fn refuse(&self, reason: String) -> PlcMessage {
        PlcMessage::Refused { reason }
    }
}
