//! The setup and application that attached nodes must run: those of the bench, in every value.

use ::node::message::CellText;
use ::node::role::NodeRole;
use setup::{Cell, Difference, Setup};

/// The setup and application of a node.
#[derive(Clone, Copy, Debug)]
pub(super) struct WantedCell<'a> {
    pub(super) setup: WantedSetup<'a>,
    /// The text of the application, or those of all stations.
    pub(super) application: &'a str,
}

/// A setup, or one of several stations.
#[derive(Clone, Copy, Debug)]
pub(super) enum WantedSetup<'a> {
    One(&'a Setup),
    Several(&'a Cell),
}

/// Those of each node of a rig.
#[derive(Clone, Debug)]
pub(super) struct WantedCells<'a> {
    pub(super) plc: WantedCell<'a>,
    /// In the order of the stations.
    pub(super) robots: Vec<WantedCell<'a>>,
}

impl<'a> WantedCells<'a> {
    /// Returns what both nodes of a setup with one robot must run.
    pub(super) fn of_one(setup: &'a Setup, application: &'a str) -> Self {
        let plc = WantedCell { setup: WantedSetup::One(setup), application };
        Self { plc, robots: vec![plc] }
    }
}

impl WantedSetup<'_> {
    pub(super) fn name(&self) -> &str {
        match self {
            Self::One(setup) => &setup.name,
            Self::Several(cell) => &cell.name,
        }
    }

    /// Returns the differences of a node's setup, in words where it cannot be read.
    fn differences(self, text: &str) -> Result<Vec<Difference>, String> {
        let unreadable = |error: setup::Error| format!("its setup cannot be read here: {error}");
        let differences = match self {
            Self::One(wanted) => {
                setup::setup_from_text(ORIGIN, text).map_err(unreadable)?.differences(wanted)
            }
            Self::Several(wanted) => {
                setup::cell_from_text(ORIGIN, text).map_err(unreadable)?.differences(wanted)
            }
        };
        differences.map_err(|error| error.to_string())
    }

    /// Returns whether a key names the application's file, of which each side has its own path.
    fn is_file(self, key: &str) -> bool {
        match self {
            Self::One(_) => key == APPLICATION,
            // Beside an application for all, a station's key names its arm.
            Self::Several(cell) if cell.application.is_some() => key == APPLICATION,
            Self::Several(_) => key.rsplit_once('.').is_some_and(|(station, last)| {
                last == APPLICATION
                    && station.strip_prefix("station.").is_some_and(|name| !name.contains('.'))
            }),
        }
    }
}

impl WantedCell<'_> {
    /// Returns the first difference from what a node runs, in words; `None` if it runs the same.
    pub(super) fn difference(self, role: NodeRole, cell: &CellText) -> Option<String> {
        let differences = match self.setup.differences(&cell.setup) {
            Ok(differences) => differences,
            Err(words) => return Some(words),
        };
        // The PLC decides how frames are sent.
        let is_free = |key: &str| self.setup.is_file(key) || is_cyclic(key) && role == NodeRole::Robot;
        let of_setup = differences.into_iter().find(|difference| !is_free(&difference.key));
        of_setup.map(|difference| in_words("setup", difference)).or_else(|| {
            match setup::text_differences(&cell.application, self.application) {
                Some(differences) => {
                    differences.into_iter().next().map(|difference| in_words("application", difference))
                }
                None if cell.application == self.application => None,
                None => Some("its application is not TOML".to_owned()),
            }
        })
    }
}

/// Name of a node's setup in messages.
const ORIGIN: &str = "the node's setup";

/// Key of an application's file.
const APPLICATION: &str = "application";

/// Key of a setup that the option `--cyclic` of `plc-node` replaces, and that a device takes from its controller.
const CYCLIC: &str = "bus.profinet.cyclic";

/// Returns whether a key is [`CYCLIC`], of a robot or of a station.
fn is_cyclic(key: &str) -> bool {
    let of_station = key.strip_prefix("station.").and_then(|key| key.split_once('.'));
    of_station.map_or(key, |(_, rest)| rest) == CYCLIC
}

/// Most characters of a value in a message.
const SHOWN: usize = 60;

fn in_words(file: &str, Difference { key, first, second }: Difference) -> String {
    let text = |value: Option<String>| {
        let value = value.unwrap_or_else(|| "missing".to_owned());
        match value.char_indices().nth(SHOWN) {
            Some((end, _)) => format!("{}…", value.get(..end).unwrap_or_default()),
            None => value,
        }
    };
    format!("in its {file}, `{key}` is {}, and here {}", text(first), text(second))
}
