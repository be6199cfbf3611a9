//! Waits of a run of a cell: for the connections, the arms at the start, and a PLC that runs its scans.

use anyhow::{Context as _, bail};
use plc_node::{PlcEvent, PlcReport};
use protocol::fieldbus::{Down, DownCause, LinkEvent};

use super::super::nodes::{CONNECT, LONGEST_RUN, NeverEnded, SILENCE};
use super::CellRun;
use records::not_ready::NotReady;

impl CellRun {
    /// Waits until all nodes are connected and every robot is ready.
    ///
    /// # Errors
    ///
    /// A robot does not get ready; the error names its station.
    pub fn connect(&mut self) -> anyhow::Result<()> {
        let until = self.cell.now() + CONNECT;
        let (mut moving, mut waiting, mut last_attempt) = (None, None, None);
        while let Some(PlcReport { station, event }) = self.next_event(until) {
            match event {
                PlcEvent::MovingToStart => moving = station,
                PlcEvent::Waiting { for_what, seconds } => {
                    let why = NotReady::Waiting { seconds, for_what: for_what.to_string() };
                    waiting = Some((station, why));
                }
                PlcEvent::Ready => {
                    self.faults.begin(self.cell.now());
                    return Ok(());
                }
                PlcEvent::Link(LinkEvent::Down(down)) => {
                    let is_final = !self.faults.are_any() || matches!(down.cause, DownCause::Refused);
                    let why = self.not_connected(station.unwrap_or_default(), down);
                    if is_final {
                        return Err(why).context(self.named(station));
                    }
                    // A cable with faults may spoil an attempt; the PLC makes the next one.
                    last_attempt = Some((station, why));
                }
                PlcEvent::Link(LinkEvent::Up) => {
                    last_attempt.take_if(|(of, _)| *of == station);
                }
                _ => {}
            }
        }
        let silent = self.cell.plc().stations().iter().position(|station| !station.is_ready());
        let late = match moving {
            Some(_) => (moving, NotReady::StillMoving(CONNECT)),
            None => (silent, NotReady::Late(CONNECT)),
        };
        let (station, why) = last_attempt.or(waiting).unwrap_or(late);
        Err(why).context(self.named(station))
    }

    fn not_connected(&self, station: usize, down: Down) -> NotReady {
        let mut words = String::new();
        let explained = self.cell.plc().explain(station, &mut words);
        if explained.is_err() || words.is_empty() {
            words = down.to_string();
        }
        match down.cause {
            DownCause::Refused => NotReady::OtherRobot(words),
            _ => NotReady::NotConnected(words),
        }
    }

    /// Waits until the cell is ready again after a run that failed.
    ///
    /// # Errors
    ///
    /// A robot does not get ready again; the error names its station.
    pub fn recover(&mut self) -> anyhow::Result<()> {
        self.until_at_start()?;
        self.faults.begin(self.cell.now());
        Ok(())
    }

    /// Waits until all arms are at the application's start. That may take as long as they like; a PLC that only waits for a
    /// robot that owes progress is an error.
    pub(super) fn until_at_start(&mut self) -> anyhow::Result<()> {
        let longest = self.cell.now() + LONGEST_RUN;
        while !self.cell.plc().is_ready() {
            let scans = self.cell.plc().scans();
            let Some(PlcReport { station, event }) = self.next_event(self.cell.now() + SILENCE) else {
                self.check_scans(scans)?;
                if self.cell.now() >= longest {
                    return Err(NeverEnded::TooLong.into());
                }
                continue;
            };
            if let PlcEvent::Waiting { for_what, seconds } = event
                && for_what.is_owed()
                && u64::from(seconds) >= SILENCE.as_secs()
            {
                let why = NotReady::Waiting { seconds, for_what: for_what.to_string() };
                return Err(why).context(self.named(station));
            }
        }
        Ok(())
    }

    /// Checks that the PLC has run further scans.
    pub(super) fn check_scans(&self, before: u64) -> anyhow::Result<()> {
        if self.cell.plc().scans() > before {
            return Ok(());
        }
        if self.faults.has_killed_plc() {
            bail!(
                "the plc-node was killed by this run's fault `kill-plc-at`: nobody is left to see the end of the run"
            );
        }
        Err(NeverEnded::NoScan.into())
    }
}
