//! When the faults change a node, or a drive of one.

use std::collections::VecDeque;
use std::future::pending;

use tokio::time::{Instant, sleep_until};

use records::faults::{self, Change, Fault};

/// Changes still to be made, by time.
#[derive(Debug, Default)]
pub(super) struct Changes(VecDeque<(Instant, Change)>);

impl Changes {
    /// Takes the changes of nodes among these faults; their times count from now.
    pub(super) fn from_now(faults: &[Fault]) -> Self {
        let now = Instant::now();
        let changes = faults::changes_of_nodes(faults).into_iter();
        Self(changes.map(|(after, change)| (now + after, change)).collect())
    }

    /// Waits for the next change, for ever if there is none. Dropping this future loses nothing.
    pub(super) async fn next(&mut self) -> Change {
        match self.0.front().copied() {
            Some((at, change)) => {
                sleep_until(at).await;
                self.0.pop_front();
                change
            }
            None => pending().await,
        }
    }
}
