//! What became of the faults of a run.

use std::fmt;
use std::time::Duration;

use serde::{Deserialize, Serialize};
use virtual_time::{LinkCounters, Side};

use super::{Fault, Kind};

/// The requested faults, and what the cable did in both directions together.
#[derive(Clone, PartialEq, Eq, Default, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct FaultReport {
    /// Each `--fault`, as the user wrote it.
    pub asked: Vec<String>,
    /// Those of them that never came to pass, because the run ended before; absent if there are none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub never: Vec<String>,
    /// Frames lost, by chance or a cut; for TCP, segments that were retransmitted.
    pub lost: u64,
    /// Frames that arrived twice.
    pub duplicated: u64,
    /// Frames that were held back.
    pub reordered: u64,
    /// Frames in which a bit flipped after the checksums of Ethernet and UDP, so that it reached a node.
    pub corrupted: u64,
    /// Frames in which a bit flipped on the wire, before these checksums; they count as lost as well.
    #[serde(default)]
    pub corrupted_on_wire: u64,
}

impl FaultReport {
    /// Creates the report of what `links` did so far, this time after the robot was ready; `None` if it is not ready yet.
    #[must_use]
    pub fn new(faults: &[Fault], links: [LinkCounters; 2], since_ready: Option<Duration>) -> Self {
        let never = faults.iter().filter(|fault| !fault.has_begun(&links, since_ready));
        let mut report = Self {
            asked: faults.iter().map(ToString::to_string).collect(),
            never: never.map(ToString::to_string).collect(),
            ..Self::default()
        };
        for link in links {
            report.lost += link.lost;
            report.duplicated += link.duplicated;
            report.reordered += link.reordered;
            report.corrupted += link.corrupted;
            report.corrupted_on_wire += link.corrupted_on_wire;
        }
        report
    }

    /// Returns this report and that of another cable together.
    #[must_use]
    pub fn and(mut self, other: Self) -> Self {
        self.asked.extend(other.asked);
        self.never.extend(other.never);
        Self {
            lost: self.lost + other.lost,
            duplicated: self.duplicated + other.duplicated,
            reordered: self.reordered + other.reordered,
            corrupted: self.corrupted + other.corrupted,
            corrupted_on_wire: self.corrupted_on_wire + other.corrupted_on_wire,
            ..self
        }
    }
}

impl Fault {
    /// Returns whether the frame or the time that it begins with has come.
    fn has_begun(&self, links: &[LinkCounters; 2], since_ready: Option<Duration>) -> bool {
        let sent = |from: Side| links.get(from.index()).map_or(0, |link| link.sent);
        let is_time = |at| since_ready.is_some_and(|since| since >= at);
        match self.kind {
            Kind::FrameFault(frame, _) => self.from.is_some_and(|from| sent(from) >= frame),
            Kind::AtFrame(at) => sent(at.from) >= at.frame,
            Kind::Cut(at, _) | Kind::Kill(_, at) => is_time(at),
            Kind::Drive(fault) => is_time(fault.at()),
            _ => true,
        }
    }
}

impl fmt::Display for FaultReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { asked, never, lost, duplicated, reordered, corrupted, corrupted_on_wire } = self;
        let put_in: Vec<_> =
            asked.iter().filter(|fault| !never.contains(fault)).map(String::as_str).collect();
        if !put_in.is_empty() {
            write!(
                f,
                "Faults put in ({}): {lost} frames lost, {duplicated} twice, {reordered} held back, {corrupted} corrupted \
                 after the checksums of Ethernet and UDP",
                put_in.join(", ")
            )?;
            if *corrupted_on_wire > 0 {
                write!(f, ", {corrupted_on_wire} on the wire and so among the lost")?;
            }
            f.write_str(".")?;
        }
        if !never.is_empty() {
            let separator = if put_in.is_empty() { "" } else { " " };
            write!(f, "{separator}Never came to pass, because the run ended before: {}.", never.join(", "))?;
        }
        Ok(())
    }
}
