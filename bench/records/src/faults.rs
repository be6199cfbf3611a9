//! Faults that the user injects with `--fault`, and their result; the same in both modes.

mod at_frame;
mod drives;
mod form;
mod limits;
mod report;

use std::fmt;
use std::str::FromStr;
use std::time::Duration;

use node::role::NodeRole;
use robot_node::Disturbance;
use virtual_time::ImpairmentPlan;
use virtual_time::{FrameFault, Impairment, Side};

pub use at_frame::AtFrame;
use drives::DriveFault;
pub use drives::NoSuchDrive;
pub use form::{FaultError, help};
pub use limits::{
    NotReal, Repeated, TooManyFrameFaults, UnfitFault, UnfitForCell, WrongStation, check, check_cell,
    check_one_robot, check_real,
};
pub use report::FaultReport;

/// One fault, in the form of the option: `loss=0.001`, `to-robot:delay=100us`, `cut-at=2s..2.1s`.
#[derive(Clone, PartialEq, Debug)]
pub struct Fault {
    /// The user's text.
    text: String,
    /// The station that it is at; `None` for the only robot, and for the PLC.
    station: Option<String>,
    /// The sender whose frames it affects; `None` for both.
    from: Option<Side>,
    kind: Kind,
}

#[derive(Clone, Copy, PartialEq, Debug)]
enum Kind {
    Delay(Duration),
    Jitter(Duration),
    Loss(u32),
    Duplicate(u32),
    Reorder(u32, Duration),
    Corrupt(u32),
    CorruptOnWire(u32),
    FrameFault(u64, FrameFault),
    AtFrame(AtFrame),
    Cut(Duration, Duration),
    Kill(NodeRole, Duration),
    Drive(DriveFault),
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

impl FromStr for Fault {
    type Err = FaultError;

    fn from_str(text: &str) -> Result<Self, FaultError> {
        let form = || FaultError::form(text);
        let (station, of_station) = match text.split_once('/') {
            Some((station, rest)) if !station.contains(['=', ':']) => (Some(station.to_owned()), rest),
            _ => (None, text),
        };
        let (from, rest) = match of_station.split_once(':') {
            None => (None, of_station),
            Some(("to-robot", rest)) => (Some(Side::A), rest),
            Some(("to-plc", rest)) => (Some(Side::B), rest),
            Some((direction, _)) if !direction.contains('=') => {
                return Err(FaultError::Direction { text: text.to_owned(), direction: direction.to_owned() });
            }
            Some(_) => return Err(form()),
        };
        let (key, value) = rest.split_once('=').ok_or_else(form)?;
        let kind = match key {
            "delay" => Kind::Delay(time(value)?),
            "jitter" => Kind::Jitter(time(value)?),
            "loss" => Kind::Loss(share(value)?),
            "duplicate" => Kind::Duplicate(share(value)?),
            "corrupt" => match value.split_once('@') {
                None => Kind::Corrupt(share(value)?),
                Some((part, "memory")) => Kind::Corrupt(share(part)?),
                Some((part, "wire")) => Kind::CorruptOnWire(share(part)?),
                Some(_) => return Err(form()),
            },
            "reorder" => {
                let (part, by) = value.split_once('@').ok_or_else(form)?;
                Kind::Reorder(share(part)?, time(by)?)
            }
            "lose-frame" if from.is_some() => Kind::FrameFault(frame(value)?, FrameFault::Lose),
            "double-frame" if from.is_some() => Kind::FrameFault(frame(value)?, FrameFault::Double),
            "hold-frame" if from.is_some() => {
                let (number, by) = value.split_once('@').ok_or_else(form)?;
                Kind::FrameFault(frame(number)?, FrameFault::Hold(time(by)?))
            }
            "flip-frame" if from.is_some() => flip(value).ok_or_else(form)??,
            "cut-at" if from.is_none() => {
                let (start, end) = value.split_once("..").ok_or_else(form)?;
                let (start, end) = (time(start)?, time(end)?);
                if end <= start {
                    return Err(FaultError::Backwards(text.to_owned()));
                }
                Kind::Cut(start, end)
            }
            "kill-robot-at" if from.is_none() => Kind::Kill(NodeRole::Robot, time(value)?),
            "kill-plc-at" if from.is_none() => Kind::Kill(NodeRole::Plc, time(value)?),
            _ => match from {
                Some(from) => Kind::AtFrame(AtFrame::parse(from, key, value).ok_or_else(form)??),
                None => Kind::Drive(DriveFault::parse(key, value).ok_or_else(form)??),
            },
        };
        Ok(Self { text: text.to_owned(), station, from, kind })
    }
}

impl Fault {
    /// Returns whether it is a fault of a drive.
    #[must_use]
    pub const fn is_of_drive(&self) -> bool {
        matches!(self.kind, Kind::Drive(_))
    }

    /// Returns the station that it is at; `None` if it names none.
    #[must_use]
    pub fn station(&self) -> Option<&str> {
        self.station.as_deref()
    }

    /// Returns the same fault at a station.
    #[must_use]
    pub fn at_station(&self, station: &str) -> Self {
        let text = self.text.rsplit_once('/').map_or(self.text.as_str(), |(_, fault)| fault);
        Self { text: format!("{station}/{text}"), station: Some(station.to_owned()), ..self.clone() }
    }

    /// Returns whether it is a fault of the PLC itself, and of no station.
    #[must_use]
    pub const fn is_of_plc(&self) -> bool {
        matches!(self.kind, Kind::Kill(NodeRole::Plc, _))
    }

    /// Returns whether it ends a node for good.
    #[must_use]
    pub const fn kills(&self) -> bool {
        matches!(self.kind, Kind::Kill(..))
    }
}

/// Parses a share of the frames and returns it in parts per million.
fn share(text: &str) -> Result<u32, FaultError> {
    let (number, scale) = text.strip_suffix('%').map_or((text, 1e6), |number| (number, 1e4));
    let share = number.trim().parse::<f64>().ok().map(|share| share * scale);
    let ppm = share.filter(|ppm| (0.0..=1e6).contains(ppm));
    ppm.map(|ppm| ppm.round() as u32).ok_or_else(|| FaultError::Share(text.to_owned()))
}

/// Parses the number of a frame among those of its sender, counted from 1.
fn frame(text: &str) -> Result<u64, FaultError> {
    text.parse().ok().filter(|number| *number > 0).ok_or_else(|| FaultError::Frame(text.to_owned()))
}

/// Parses a bit that flips, such as `17.93@memory` for bit 93 of frame 17, or `17@wire`; `None` for another form.
fn flip(text: &str) -> Option<Result<Kind, FaultError>> {
    let (place, frame_fault) = match text.split_once('@')? {
        (number, "wire") => (number, FrameFault::FlipOnWire),
        (place, "memory") => {
            let (number, bit) = place.split_once('.')?;
            (number, FrameFault::Flip(bit.parse().ok()?))
        }
        _ => return None,
    };
    Some(frame(place).map(|frame| Kind::FrameFault(frame, frame_fault)))
}

fn time(text: &str) -> Result<Duration, FaultError> {
    node::parse_duration(text).ok_or_else(|| FaultError::Time(text.to_owned()))
}

/// A change of the cable, of a node or of a drive at some moment of the run.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Change {
    /// The cable is cut.
    Cut,
    /// It is mended.
    Mend,
    /// A node is killed.
    Kill(NodeRole),
    /// A node that was killed is started again.
    Restart(NodeRole),
    /// Something happens to the drive of an axis, counted from 1.
    Drive(u8, Disturbance),
}

/// Adds the faults to the cable's impairments, towards the robot and towards the PLC.
#[must_use]
pub fn links(faults: &[Fault], cable: Impairment) -> [Impairment; 2] {
    let mut links = [cable; 2];
    for fault in faults {
        for (link, side) in links.iter_mut().zip([Side::A, Side::B]) {
            if fault.from.is_none_or(|from| from == side) {
                match fault.kind {
                    Kind::Delay(more) => link.delay += more,
                    Kind::Jitter(jitter) => link.jitter = jitter,
                    Kind::Loss(ppm) => link.loss_ppm = ppm,
                    Kind::Duplicate(ppm) => link.duplicate_ppm = ppm,
                    Kind::Corrupt(ppm) => link.corrupt_ppm = ppm,
                    Kind::CorruptOnWire(ppm) => link.corrupt_on_wire_ppm = ppm,
                    // What has no room is refused by `check`.
                    Kind::FrameFault(frame, frame_fault) => _ = link.frame_faults.add(frame, frame_fault),
                    Kind::Reorder(ppm, by) => (link.reorder_ppm, link.reorder_by) = (ppm, by),
                    Kind::AtFrame(_) | Kind::Cut(..) | Kind::Kill(..) | Kind::Drive(..) => {}
                }
            }
        }
    }
    links
}

/// Returns the changes and their times, in order; times count from when the PLC found the robot ready.
#[must_use]
pub fn changes(faults: &[Fault]) -> Vec<(Duration, Change)> {
    let mut changes: Vec<_> = faults
        .iter()
        .flat_map(|fault| match fault.kind {
            Kind::Cut(start, end) => vec![(start, Change::Cut), (end, Change::Mend)],
            Kind::Kill(role, at) => vec![(at, Change::Kill(role))],
            Kind::Drive(fault) => fault.changes(),
            _ => Vec::new(),
        })
        .collect();
    changes.sort_by_key(|(at, _)| *at);
    changes
}

/// Returns the changes that begin with a frame.
pub fn at_frames(faults: &[Fault]) -> impl Iterator<Item = AtFrame> + '_ {
    faults.iter().filter_map(|fault| match fault.kind {
        Kind::AtFrame(at) => Some(at),
        _ => None,
    })
}

/// Returns a capture's comment on the faults; empty without faults.
#[must_use]
pub fn about(faults: &[Fault]) -> String {
    if faults.is_empty() { String::new() } else { format!("faults put in: {}", listed(faults)) }
}

/// Returns the faults as the user wrote them, with commas between them.
#[must_use]
pub fn listed(faults: &[Fault]) -> String {
    faults.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")
}

/// Converts the faults to the impairments of a cable between two processes. The host determines that cable's own
/// delay.
#[must_use]
pub fn impairment_plan(faults: &[Fault], seed: u64) -> ImpairmentPlan {
    let cut = |(at, change)| match change {
        Change::Cut => Some((at, true)),
        Change::Mend => Some((at, false)),
        Change::Kill(_) | Change::Restart(_) | Change::Drive(..) => None,
    };
    ImpairmentPlan {
        links: links(faults, Impairment::default()),
        cuts: changes(faults).into_iter().filter_map(cut).collect(),
        seed,
    }
}

/// Returns the changes of nodes and drives, which a cable does not make; in order, with times as in [`changes`].
#[must_use]
pub fn changes_of_nodes(faults: &[Fault]) -> Vec<(Duration, Change)> {
    let mut changes = changes(faults);
    changes.retain(|(_, change)| matches!(change, Change::Kill(_) | Change::Drive(..)));
    changes
}

/// Returns the end of the cable at which a node is.
#[must_use]
pub const fn end_of(node: NodeRole) -> Side {
    match node {
        NodeRole::Plc => Side::A,
        NodeRole::Robot => Side::B,
    }
}

#[cfg(test)]
mod tests;
