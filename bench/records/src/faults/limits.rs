//! What faults a setup, a cable and a mode can have.

use std::time::Duration;

use setup::{Cell, Setup, meant_or_all};
use virtual_time::{FrameFaults, Impairment, Side};

use super::{Fault, Kind, NoSuchDrive, links};

/// Checks whether a setup and a cable can have these faults, and beside each other.
///
/// # Errors
///
/// The first of them that cannot be.
pub fn check(faults: &[Fault], setup: &Setup) -> Result<(), UnfitFault> {
    check_drives(faults, setup)?;
    check_repeated(faults)?;
    Ok(check_frame_faults(faults)?)
}

/// Faults that a setup or a cable cannot have.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
#[error(transparent)]
pub enum UnfitFault {
    /// The robot does not have the drive.
    Drive(#[from] NoSuchDrive),
    /// Two set the same number.
    Repeated(#[from] Repeated),
    /// There are too many of single frames.
    TooMany(#[from] TooManyFrameFaults),
}

/// Checks whether faults of a setup with one robot name no station.
///
/// # Errors
///
/// The first that does.
pub fn check_one_robot(faults: &[Fault], setup: &str) -> Result<(), WrongStation> {
    let named = faults.iter().find(|fault| fault.station().is_some());
    named.map_or(Ok(()), |fault| {
        Err(WrongStation::OneRobot { fault: fault.to_string(), setup: setup.to_owned() })
    })
}

/// Checks whether the faults of a cell name its stations, and whether these, their cables and their drives can have them, and
/// beside each other.
///
/// # Errors
///
/// The first of them that cannot be.
pub fn check_cell(faults: &[Fault], cell: &Cell) -> Result<(), UnfitForCell> {
    let names: Vec<_> = cell.names().map(str::to_owned).collect();
    for fault in faults {
        let (text, stations) = (fault.to_string(), names.clone());
        match fault.station() {
            None if fault.is_of_plc() => {}
            None => return Err(WrongStation::Missing { fault: text, stations }.into()),
            Some(_) if fault.is_of_plc() => return Err(WrongStation::OfPlc { fault: text }.into()),
            Some(station) if cell.station(station).is_none() => {
                let (setup, station) = (cell.name.clone(), station.to_owned());
                return Err(WrongStation::Unknown { fault: text, setup, station, stations }.into());
            }
            Some(_) => {}
        }
    }
    for station in &cell.stations {
        let of_station: Vec<_> =
            faults.iter().filter(|fault| fault.station() == Some(&station.name)).cloned().collect();
        check(&of_station, &cell.setup_of(station))?;
    }
    Ok(())
}

/// Faults that a cell cannot have.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
#[error(transparent)]
pub enum UnfitForCell {
    /// They are at no station of it.
    Station(#[from] WrongStation),
    /// A station cannot have them.
    UnfitFault(#[from] UnfitFault),
}

/// A fault that is not at a station where it can be.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub enum WrongStation {
    /// A setup with one robot has no names of stations.
    #[error("setup {setup} has one robot: write `{fault}` without the station and its `/`")]
    OneRobot {
        /// The fault.
        fault: String,
        /// The setup's name.
        setup: String,
    },
    /// It names no station, and there are several.
    #[error("`{fault}` names no station: write {}", stations.iter().map(|name| format!("{name}/{fault}")).collect::<Vec<_>>().join(" or "))]
    Missing {
        /// The fault.
        fault: String,
        /// Names of the stations.
        stations: Vec<String>,
    },
    /// The PLC is of no station.
    #[error("`{fault}` ends the PLC of all stations: write it without the station and its `/`")]
    OfPlc {
        /// The fault.
        fault: String,
    },
    /// The setup has another set of stations.
    #[error("`{fault}`: setup {setup} has no station `{station}`: {}", meant_or_all(station, &stations.iter().map(String::as_str).collect::<Vec<_>>()))]
    Unknown {
        /// The fault.
        fault: String,
        /// The setup's name.
        setup: String,
        /// The name.
        station: String,
        /// Names of the stations.
        stations: Vec<String>,
    },
}

/// Checks whether the robot of a setup has the drives that the faults are for.
fn check_drives(faults: &[Fault], setup: &Setup) -> Result<(), NoSuchDrive> {
    faults.iter().try_for_each(|fault| match fault.kind {
        Kind::Drive(fault) => fault.check(setup),
        _ => Ok(()),
    })
}

/// Checks whether the cable has room for so many faults of single frames in either direction.
fn check_frame_faults(faults: &[Fault]) -> Result<(), TooManyFrameFaults> {
    let frame_faults = |side| {
        let of = |fault: &&Fault| matches!(fault.kind, Kind::FrameFault(..)) && fault.from == Some(side);
        faults.iter().filter(of).count()
    };
    match [Side::A, Side::B].map(frame_faults).into_iter().max().unwrap_or(0) {
        0..=FrameFaults::MOST => Ok(()),
        found => Err(TooManyFrameFaults { found }),
    }
}

/// More frames of one direction are lost, doubled, held or flipped than there is room for.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
#[error(
    "{found} faults of single frames in one direction, and there is room for {}: ask for fewer",
    FrameFaults::MOST
)]
pub struct TooManyFrameFaults {
    found: usize,
}

/// Checks whether each direction of the cable gets each of its numbers from one fault only. Delays add up.
fn check_repeated(faults: &[Fault]) -> Result<(), Repeated> {
    for (index, fault) in faults.iter().enumerate() {
        let Some(number) = fault.sets() else { continue };
        let is_same = |other: &&Fault| {
            let is_of_one_direction = match (other.from, fault.from) {
                (Some(other), Some(from)) => other == from,
                _ => true,
            };
            other.sets() == Some(number) && is_of_one_direction
        };
        if let Some(first) = faults.iter().take(index).find(is_same) {
            return Err(Repeated { first: first.to_string(), second: fault.to_string(), number });
        }
    }
    Ok(())
}

/// Two faults that set the same number of one direction.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
#[error(
    "`{first}` and `{second}` both set the {number} of one direction: leave one out, or limit each to a direction of its own, as \
     in to-robot:loss=0.001 and to-plc:loss=0.01"
)]
pub struct Repeated {
    first: String,
    second: String,
    number: &'static str,
}

impl Fault {
    /// Returns the number of a direction that it sets; `None` if others may stand beside it.
    const fn sets(&self) -> Option<&'static str> {
        match self.kind {
            Kind::Jitter(_) => Some("jitter"),
            Kind::Loss(_) => Some("loss"),
            Kind::Duplicate(_) => Some("share of duplicates"),
            Kind::Reorder(..) => Some("reordering"),
            Kind::Corrupt(_) => Some("corruption in memory"),
            Kind::CorruptOnWire(_) => Some("corruption on the wire"),
            Kind::Delay(_)
            | Kind::FrameFault(..)
            | Kind::AtFrame(_)
            | Kind::Cut(..)
            | Kind::Kill(..)
            | Kind::Drive(_) => None,
        }
    }
}

/// Longest time for which a cable between two processes holds a frame: it keeps frames in memory of fixed size.
const LONGEST_HOLD: Duration = Duration::from_secs(1);

/// Checks whether a cable between two processes can do these faults.
///
/// # Errors
///
/// They hold frames for longer than it can, or begin with a frame.
pub fn check_real(faults: &[Fault]) -> Result<(), NotReal> {
    if let Some(fault) = faults.iter().find(|fault| matches!(fault.kind, Kind::AtFrame(_))) {
        return Err(NotReal::AtFrame(fault.to_string()));
    }
    let hold =
        |link: &Impairment| link.delay + link.jitter + link.reorder_by.max(link.frame_faults.longest_hold());
    let longest = links(faults, Impairment::default()).iter().map(hold).max().unwrap_or_default();
    if longest > LONGEST_HOLD { Err(NotReal::HeldTooLong { longest }) } else { Ok(()) }
}

/// What a cable between two processes cannot do.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub enum NotReal {
    /// Frames would be held for longer than their memory allows.
    #[error(
        "these faults hold frames for up to {longest:?}, and a cable between two processes for {LONGEST_HOLD:?} at most: ask \
         for less, or add --mode virtual"
    )]
    HeldTooLong {
        /// Longest time asked for.
        longest: Duration,
    },
    /// A cut or a restart begins with a frame.
    #[error("`{0}` is for virtual time only: add --mode virtual, or give a time, as in cut-at=2s..2.1s")]
    AtFrame(String),
}
