//! The events that a run sends to the live view. Sending never waits: if the view is too slow, it loses events.

use node::report::NodeReport;
use plc_node::ExecutionType;
use tokio::sync::mpsc;

use crate::cell_results::CellResults;
use crate::results::Results;

/// Events that may wait for the view's thread.
const WAITING: usize = 1_024;

/// An event of a run.
#[derive(Debug)]
pub enum FeedEvent {
    /// The next repetition begins with its pause.
    Next {
        /// Its type.
        execution_type: ExecutionType,
        /// Its number within the type, from 1.
        repetition: u32,
    },
    /// The start edge was set, at this time of the nodes' clock.
    Started {
        /// ns of the nodes' clock.
        at_ns: u64,
    },
    /// The repetition's motions are done, so long after the start edge.
    MotionsDone {
        /// ns since the start edge.
        length_ns: u64,
    },
    /// The results so far.
    Results(Box<Results>),
    /// The results of a cell with several stations so far.
    CellResults(Box<CellResults>),
    /// A node's report about itself: of the robot at this station, `None` for the PLC.
    Report(Option<usize>, Box<NodeReport>),
    /// Something that a person should know.
    Note {
        /// Whether it is an alarm or a fault.
        is_problem: bool,
        /// The line.
        text: String,
    },
}

/// The run's end of the channel to the live view.
#[derive(Clone, Debug)]
pub struct Feed(mpsc::Sender<FeedEvent>);

impl Feed {
    /// Creates both ends of the channel.
    #[must_use]
    pub fn new() -> (Self, mpsc::Receiver<FeedEvent>) {
        let (sender, receiver) = mpsc::channel(WAITING);
        (Self(sender), receiver)
    }

    /// Reports that the next repetition begins with its pause.
    pub fn next(&self, execution_type: ExecutionType, repetition: u32) {
        self.send(FeedEvent::Next { execution_type, repetition });
    }

    /// Reports that the start edge was set, in ns of the nodes' clock.
    pub fn started(&self, at_ns: u64) {
        self.send(FeedEvent::Started { at_ns });
    }

    /// Reports that the repetition's motions are done, so long after the start edge.
    pub fn motions_done(&self, length_ns: u64) {
        self.send(FeedEvent::MotionsDone { length_ns });
    }

    /// Reports the results so far.
    pub fn results(&self, results: &Results) {
        self.send(FeedEvent::Results(Box::new(results.clone())));
    }

    /// Reports the results of a cell with several stations so far.
    pub fn cell_results(&self, results: &CellResults) {
        self.send(FeedEvent::CellResults(Box::new(results.clone())));
    }

    /// Reports a node's report about itself: of the robot at this station, `None` for the PLC.
    pub fn report(&self, robot: Option<usize>, report: NodeReport) {
        self.send(FeedEvent::Report(robot, Box::new(report)));
    }

    /// Reports something that a person may want to know.
    pub fn note(&self, text: impl Into<String>) {
        self.send(FeedEvent::Note { is_problem: false, text: text.into() });
    }

    /// Reports an alarm or a fault.
    pub fn alarm(&self, text: impl Into<String>) {
        self.send(FeedEvent::Note { is_problem: true, text: text.into() });
    }

    fn send(&self, event: FeedEvent) {
        let _ = self.0.try_send(event);
    }
}
