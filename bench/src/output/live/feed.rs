//! What a run tells the live view. Telling never waits: the view loses news before the run loses time.

use node::report::NodeReport;
use node::role::NodeRole;
use plc_node::ExecutionType;
use tokio::sync::mpsc;

use super::state::Part;
use crate::records::results::Results;

/// News that may wait for the view's thread.
const WAITING: usize = 1_024;

/// News of a run.
#[derive(Debug)]
pub(super) enum News {
    /// The next repetition begins with its pause.
    Next { execution_type: ExecutionType, repetition: u32 },
    /// The start edge was set, at this time of the nodes' clock.
    Started { at_ns: u64 },
    /// The repetition's motions are done, so long after the start edge.
    Moved { length_ns: u64 },
    /// The results so far.
    Results(Box<Results>),
    /// A node's report about itself.
    Report(NodeRole, Box<NodeReport>),
    /// How the run ended; nothing follows.
    Last(Box<Part>),
    /// Something that a person should know.
    Happened { is_problem: bool, text: String },
}

/// The run's end of the channel to the live view.
#[derive(Clone, Debug)]
pub struct Feed(mpsc::Sender<News>);

impl Feed {
    pub(super) fn new() -> (Self, mpsc::Receiver<News>) {
        let (sender, receiver) = mpsc::channel(WAITING);
        (Self(sender), receiver)
    }

    /// Tells that the next repetition begins with its pause.
    pub fn next(&self, execution_type: ExecutionType, repetition: u32) {
        self.tell(News::Next { execution_type, repetition });
    }

    /// Tells that the start edge was set, in ns of the nodes' clock.
    pub fn started(&self, at_ns: u64) {
        self.tell(News::Started { at_ns });
    }

    /// Tells that the repetition's motions are done, so long after the start edge.
    pub fn moved(&self, length_ns: u64) {
        self.tell(News::Moved { length_ns });
    }

    /// Tells the results so far.
    pub fn results(&self, results: &Results) {
        self.tell(News::Results(Box::new(results.clone())));
    }

    /// Tells a node's report about itself.
    pub fn report(&self, role: NodeRole, report: NodeReport) {
        self.tell(News::Report(role, Box::new(report)));
    }

    /// Tells what a person may want to know.
    pub fn note(&self, text: impl Into<String>) {
        self.tell(News::Happened { is_problem: false, text: text.into() });
    }

    /// Tells an alarm or a fault.
    pub fn alarm(&self, text: impl Into<String>) {
        self.tell(News::Happened { is_problem: true, text: text.into() });
    }

    /// Tells how the run ended. If the channel is full, the thread ends without these words when all feeds are dropped.
    pub(super) fn last(&self, part: Part) {
        self.tell(News::Last(Box::new(part)));
    }

    fn tell(&self, news: News) {
        let _ = self.0.try_send(news);
    }
}
