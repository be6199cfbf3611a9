//! The events that a run sends to the live view. Sending never waits: if the view is too slow, it loses events.

use node::report::NodeReport;
use node::role::NodeRole;
use plc_node::ExecutionType;
use tokio::sync::mpsc;

use super::state::Part;
use crate::records::results::Results;

/// Events that may wait for the view's thread.
const WAITING: usize = 1_024;

/// An event of a run.
#[derive(Debug)]
pub(super) enum FeedEvent {
    /// The next repetition begins with its pause.
    Next { execution_type: ExecutionType, repetition: u32 },
    /// The start edge was set, at this time of the nodes' clock.
    Started { at_ns: u64 },
    /// The repetition's motions are done, so long after the start edge.
    MotionsDone { length_ns: u64 },
    /// The results so far.
    Results(Box<Results>),
    /// A node's report about itself.
    Report(NodeRole, Box<NodeReport>),
    /// How the run ended; nothing follows.
    Last(Box<Part>),
    /// Something that a person should know.
    Note { is_problem: bool, text: String },
}

/// The run's end of the channel to the live view.
#[derive(Clone, Debug)]
pub struct Feed(mpsc::Sender<FeedEvent>);

impl Feed {
    pub(super) fn new() -> (Self, mpsc::Receiver<FeedEvent>) {
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

    /// Reports a node's report about itself.
    pub fn report(&self, role: NodeRole, report: NodeReport) {
        self.send(FeedEvent::Report(role, Box::new(report)));
    }

    /// Reports something that a person may want to know.
    pub fn note(&self, text: impl Into<String>) {
        self.send(FeedEvent::Note { is_problem: false, text: text.into() });
    }

    /// Reports an alarm or a fault.
    pub fn alarm(&self, text: impl Into<String>) {
        self.send(FeedEvent::Note { is_problem: true, text: text.into() });
    }

    /// Reports how the run ended. If the channel is full, the thread ends without this event once all feeds are dropped.
    pub(super) fn last(&self, part: Part) {
        self.send(FeedEvent::Last(Box::new(part)));
    }

    fn send(&self, event: FeedEvent) {
        let _ = self.0.try_send(event);
    }
}
