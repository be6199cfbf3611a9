//! Setups of several stations: a cell of one PLC and as many robots as there are sections `[[station]]`.
//!
//! A [`Setup`] is one PLC, one bus and one robot. A [`Cell`] is one PLC with any number of stations, and gives a full `Setup`
//! for each of them, so that all that works on one robot works on a robot of a cell.

use serde::{Deserialize, Serialize};

use crate::{Bus, Motions, Paper, Plc, Provenance, Robot, Setup, SharedZone, Sourced};

/// Version of the file format of a cell with several stations.
pub(crate) const CELL_SCHEMA: u32 = 2;

/// Name of the station of a setup that has only one.
const ONLY_STATION: &str = "robot";

/// A PLC and its stations, with everything a user may change.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Cell {
    /// Version of this file format: 2.
    pub schema: u32,
    /// Short name. It is part of the name of a run's directory.
    pub name: String,
    /// Description of the cell.
    pub title: String,
    /// The application of all stations together: a built-in name, or a path relative to this file's directory. If left
    /// out, each station has an application of its own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub application: Option<String>,
    /// Published figures of this cell, if there are any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub paper: Option<Paper>,
    /// The PLC.
    pub plc: Plc,
    /// Volumes that only one arm may be in at a time.
    #[serde(default, rename = "shared_zone", skip_serializing_if = "Vec::is_empty")]
    pub shared_zones: Vec<SharedZone>,
    /// The stations, in the order in which the PLC numbers them.
    #[serde(rename = "station")]
    pub stations: Vec<Station>,
}

/// A robot of a cell, and how the PLC reaches it.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Station {
    /// Its name in commands, messages and files: a to z, 0 to 9 and hyphens, up to 32 characters.
    pub name: String,
    /// Name of its arm in the cell's application; without one, its own application: a built-in name, or a path.
    pub application: String,
    /// Where the arm's root stands in the cell: x, y, z in mm; a, b, c in degrees about z, y', x''.
    pub root_mm_deg: Sourced<[f64; 6]>,
    /// EtherCAT only: its place in the line of SubDevices, counted from 0; if left out, the order of the stations.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub position: Option<u16>,
    /// The fieldbus of this station. Stations with the same `kind` share one bus.
    pub bus: Bus,
    /// The robot and its controller.
    pub robot: Robot,
    /// How the motions of this station are programmed.
    pub motions: Motions,
}

impl From<Setup> for Cell {
    /// Makes a cell of one station named `robot`, which stands at the cell's origin.
    fn from(setup: Setup) -> Self {
        let Setup { schema, name, title, application, paper, plc, bus, robot, motions } = setup;
        let note = "the only robot: the cell begins where it stands".to_owned();
        let root_mm_deg = Sourced { value: [0.0; 6], from: Provenance::Assumed, note };
        let station = Station {
            name: ONLY_STATION.to_owned(),
            application,
            root_mm_deg,
            position: None,
            bus,
            robot,
            motions,
        };
        Self {
            schema,
            name,
            title,
            application: None,
            paper,
            plc,
            shared_zones: Vec::new(),
            stations: vec![station],
        }
    }
}

impl Cell {
    /// Returns whether this is a setup of schema 1, with its one station and no `[[station]]`.
    #[must_use]
    pub const fn is_one(&self) -> bool {
        self.schema != CELL_SCHEMA
    }

    /// Returns the station of this name.
    #[must_use]
    pub fn station(&self, name: &str) -> Option<&Station> {
        self.stations.iter().find(|station| station.name == name)
    }

    /// Returns the names of all stations, in their order.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.stations.iter().map(|station| station.name.as_str())
    }

    /// Returns the setups of all stations, in their order, as [`Cell::setup_of`] does.
    pub fn setups(&self) -> impl Iterator<Item = Setup> {
        self.stations.iter().map(|station| self.setup_of(station))
    }

    /// Returns a station as a setup of its own, as if it were alone with the PLC. Its name is those of the cell and of the
    /// station, `E-left`; its application is the file, which may be one for all stations. A cell made from a setup returns
    /// that setup.
    #[must_use]
    pub fn setup_of(&self, station: &Station) -> Setup {
        let is_one = self.is_one();
        let named = |text: &str, between: &str| {
            if is_one { text.to_owned() } else { format!("{text}{between}{}", station.name) }
        };
        Setup {
            schema: 1,
            name: named(&self.name, "-"),
            title: named(&self.title, ": "),
            application: self.application.as_ref().unwrap_or(&station.application).clone(),
            // Published figures are those of the whole cell.
            paper: self.paper.clone().filter(|_| is_one),
            plc: self.plc.clone(),
            bus: station.bus.clone(),
            robot: station.robot.clone(),
            motions: station.motions.clone(),
        }
    }

    /// Returns a station's place in the line of SubDevices, counted from 0; `None` on another bus than EtherCAT.
    #[must_use]
    pub fn ethercat_position(&self, station: &Station) -> Option<u16> {
        let is_ethercat = |it: &&Station| it.bus.kind.name() == ETHERCAT;
        if !is_ethercat(&station) {
            return None;
        }
        let before =
            self.stations.iter().take_while(|it| it.name != station.name).filter(is_ethercat).count();
        station.position.or_else(|| u16::try_from(before).ok())
    }
}

/// The bus whose stations have places instead of addresses.
pub(crate) const ETHERCAT: &str = "ethercat";
