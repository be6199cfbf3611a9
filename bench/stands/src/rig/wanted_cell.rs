//! The setup and application that attached nodes must run: those of the bench, in every value.

use ::node::message::CellText;
use ::node::role::NodeRole;
use setup::{Difference, Setup};

/// The cell that nodes must run.
#[derive(Clone, Copy, Debug)]
pub(super) struct WantedCell<'a> {
    pub(super) setup: &'a Setup,
    /// The application's file.
    pub(super) application: &'a str,
}

impl WantedCell<'_> {
    /// Returns the first difference from what a node runs, in words; `None` if it runs the same.
    pub(super) fn difference(self, role: NodeRole, cell: &CellText) -> Option<String> {
        let setup = match setup::setup_from_text("the node's setup", &cell.setup) {
            Ok(setup) => setup,
            Err(error) => return Some(format!("its setup cannot be read here: {error}")),
        };
        let differences = match setup.differences(self.setup) {
            Ok(differences) => differences,
            Err(error) => return Some(error.to_string()),
        };
        // Each side has its own path of the application's file, and the PLC decides how frames are sent.
        let is_free = |key: &str| key == "application" || key == CYCLIC && role == NodeRole::Robot;
        let of_setup = differences.into_iter().find(|difference| !is_free(&difference.key));
        of_setup.map(|difference| in_words("setup", difference)).or_else(|| {
            match setup::text_differences(&cell.application, self.application) {
                Some(differences) => {
                    differences.into_iter().next().map(|difference| in_words("application", difference))
                }
                None => Some("its application is no TOML".to_owned()),
            }
        })
    }
}

/// Key of a setup that the option `--cyclic` of `plc-node` replaces, and that a device takes from its controller.
const CYCLIC: &str = "bus.profinet.cyclic";

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
