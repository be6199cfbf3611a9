//! When the faults change a node, or a drive of one.

use std::collections::VecDeque;
use std::future::pending;

use tokio::time::{Instant, sleep_until};

use super::layout::RigLayout;
use records::faults::{Change, Fault};

/// Changes still to be made, by time, each with the index of its station.
#[derive(Debug, Default)]
pub(super) struct Changes(VecDeque<(Instant, usize, Change)>);

impl Changes {
    /// Takes the changes of nodes among these faults; their times count from now.
    pub(super) fn from_now(layout: &RigLayout, faults: &[Fault]) -> Self {
        let now = Instant::now();
        let changes = layout.changes(faults).into_iter();
        Self(changes.map(|(after, station, change)| (now + after, station, change)).collect())
    }

    /// Waits for the next change, for ever if there is none. Dropping this future loses nothing.
    pub(super) async fn next(&mut self) -> (usize, Change) {
        match self.0.front().copied() {
            Some((at, station, change)) => {
                sleep_until(at).await;
                self.0.pop_front();
                (station, change)
            }
            None => pending().await,
        }
    }
}
