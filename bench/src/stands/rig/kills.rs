//! When to kill which node, if the faults ask for it.

use std::collections::VecDeque;
use std::future::pending;

use node::role::NodeRole;
use tokio::time::{Instant, sleep_until};

use crate::records::faults::{self, Fault};

/// Nodes still to be killed, by time.
#[derive(Debug, Default)]
pub(super) struct Kills(VecDeque<(Instant, NodeRole)>);

impl Kills {
    /// Takes the kills among these faults; their times count from now.
    pub(super) fn from_now(faults: &[Fault]) -> Self {
        let now = Instant::now();
        Self(faults::kills(faults).into_iter().map(|(after, role)| (now + after, role)).collect())
    }

    /// Waits for the next kill, for ever if there is none. Dropping this future loses nothing.
    pub(super) async fn next(&mut self) -> NodeRole {
        match self.0.front().copied() {
            Some((at, role)) => {
                sleep_until(at).await;
                self.0.pop_front();
                role
            }
            None => pending().await,
        }
    }
}
