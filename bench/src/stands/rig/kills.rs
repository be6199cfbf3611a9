//! When which node is killed, where that is asked for.

use std::collections::VecDeque;
use std::future::pending;

use tokio::time::{Instant, sleep_until};
use virtual_time::Side;

use crate::records::faults::{self, Fault};

/// Nodes that are still to be killed, in order of time.
#[derive(Debug, Default)]
pub(super) struct Kills(VecDeque<(Instant, Side)>);

impl Kills {
    /// Those of these faults, whose times count from now.
    pub(super) fn from_now(faults: &[Fault]) -> Self {
        let now = Instant::now();
        Self(faults::kills(faults).into_iter().map(|(after, side)| (now + after, side)).collect())
    }

    /// Waits for the next one, for ever where there is none. Nothing is lost where nobody waits to the end.
    pub(super) async fn next(&mut self) -> Side {
        match self.0.front().copied() {
            Some((at, side)) => {
                sleep_until(at).await;
                self.0.pop_front();
                side
            }
            None => pending().await,
        }
    }
}
