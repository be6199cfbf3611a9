//! What limits the waits of a virtual run: the silence of the PLC, and not the length of the run.

use std::time::Duration;

use ::node::role::NodeRole;
use anyhow::bail;
use machine::Instant;
use plc_node::{ExecutionType, Failure, PlcEvent};

use super::Nodes;
use records::not_ready::NotReady;

/// Time without a scan after which a PLC counts as gone, and for which it may wait before a run for a robot that owes
/// progress.
pub(in super::super) const SILENCE: Duration = Duration::from_secs(10);

/// Longest run: the PLC gives up a robot without progress, so that a run which lasts this long is a fault of this program.
pub(in super::super) const LONGEST_RUN: Duration = Duration::from_secs(24 * 3_600);

/// A run did not end.
#[derive(Debug, thiserror::Error)]
pub enum NeverEnded {
    /// It was still under way after `LONGEST_RUN`.
    #[error("the run did not end within {} h of virtual time", LONGEST_RUN.as_secs() / 3_600)]
    TooLong,
    /// The PLC stands still.
    #[error("the PLC ran no scan for {} s of virtual time", SILENCE.as_secs())]
    NoScan,
}

impl Nodes {
    /// Waits until the arm is at the application's start, so that a run can begin at once. A PLC that only waits meanwhile is
    /// an error.
    pub(super) fn until_at_start(&mut self) -> anyhow::Result<()> {
        while !self.cell.plc().is_ready() {
            match self.next_event_of_scans()? {
                PlcEvent::Waiting { for_what, seconds }
                    if for_what.is_owed() && u64::from(seconds) >= SILENCE.as_secs() =>
                {
                    return Err(NotReady::Waiting { seconds, for_what: for_what.to_string() }.into());
                }
                PlcEvent::Failed(failure) => return Err(failure.into()),
                _ => {}
            }
        }
        Ok(())
    }

    /// Lets the time until the start of a run of this type pass. A failure meanwhile is that of exported code which stopped: no further
    /// run can start.
    pub(super) fn pause(&mut self, until: Instant, execution_type: ExecutionType) -> anyhow::Result<()> {
        while let Some(event) = self.next_event(until) {
            if let PlcEvent::Failed(failure) = event {
                return Err(Failure { execution_type, ..failure }.into());
            }
        }
        Ok(())
    }

    /// Returns the PLC's next event, however long that takes, as long as the PLC runs its scans.
    fn next_event_of_scans(&mut self) -> anyhow::Result<PlcEvent> {
        let longest = self.cell.now() + LONGEST_RUN;
        while self.cell.now() < longest {
            let scans = self.cell.plc().scans();
            if let Some(event) = self.next_event(self.cell.now() + SILENCE) {
                return Ok(event);
            }
            self.check_scans(scans)?;
        }
        Err(NeverEnded::TooLong.into())
    }

    /// Checks that the PLC has run further scans.
    pub(super) fn check_scans(&self, before: u64) -> anyhow::Result<()> {
        if self.cell.plc().scans() > before {
            return Ok(());
        }
        if let Some(NodeRole::Plc) = self.killed {
            bail!(
                "the plc-node was killed by this run's fault `kill-plc-at`: nobody is left to see the end of the run"
            );
        }
        Err(NeverEnded::NoScan.into())
    }
}
