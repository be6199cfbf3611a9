//! `bench new`: the files of a cell of one's own, from built-in ones.

mod comments;

use std::fs::OpenOptions;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow};
use clap::Args;

use records::exit::{Exit, Failure};
use report::in_shell;
use report::outln;
use studies::directory;
use studies::engine::file::EXAMPLES;

/// Files of a cell.
const SETUP: &str = "setup.toml";
const APPLICATION: &str = "application.toml";

/// A study of the cell.
const STUDY: &str = "study.toml";

/// A file's schema beside it, for editors: its name and text.
type Schema = (&'static str, &'static str);

const STUDY_SCHEMA: Schema = ("study.schema.json", include_str!("../../../schemas/study.schema.json"));

/// Built-in files that cells of one kind begin with.
struct CellKind {
    setups: &'static [(&'static str, &'static str)],
    setup_schema: Schema,
    applications: &'static [(&'static str, &'static str)],
    application_schema: Schema,
    /// Number of arms that an application is for, in messages.
    arms: &'static str,
    /// The example that a new study begins with, and what it shows.
    study: (&'static str, &'static str),
    shows: &'static str,
}

const ONE_ARM: CellKind = CellKind {
    setups: setup::SETUPS,
    setup_schema: ("setup.schema.json", include_str!("../../../../cell/schemas/setup.schema.json")),
    applications: planning::APPLICATIONS,
    application_schema: (
        "application.schema.json",
        include_str!("../../../../cell/schemas/application.schema.json"),
    ),
    arms: "one arm",
    study: EXAMPLES[1],
    shows: "how much later each type ends with other zones",
};

const SEVERAL_ARMS: CellKind = CellKind {
    setups: setup::CELLS,
    setup_schema: ("cell.schema.json", include_str!("../../../../cell/schemas/cell.schema.json")),
    applications: planning::ARMS_APPLICATIONS,
    application_schema: (
        "arms-application.schema.json",
        include_str!("../../../../cell/schemas/arms-application.schema.json"),
    ),
    arms: "several arms",
    study: EXAMPLES[4],
    shows: "how much later all arms end if one of them has a slower controller",
};

impl CellKind {
    fn schemas(&self) -> [Schema; 3] {
        [self.setup_schema, self.application_schema, STUDY_SCHEMA]
    }

    /// Returns a study of the setup beside it.
    fn own_study(&self) -> String {
        let (name, text) = self.study;
        let is_built_in = |line: &str| line.starts_with("setup = ");
        let line = |line: &str| {
            if is_built_in(line) { format!("setup = \"{SETUP}\"\n") } else { format!("{line}\n") }
        };
        text.replace(&format!("{name}.toml"), STUDY).lines().map(line).collect()
    }
}

/// Options of a new cell.
#[derive(Args, Debug)]
pub struct NewOptions {
    /// The directory to write setup.toml, application.toml and study.toml into; its name is the cell's.
    #[arg(value_name = "DIR")]
    pub directory: PathBuf,
    /// The built-in setup to begin with, also one of several stations.
    #[arg(long, value_name = "NAME", default_value = "A")]
    pub setup: String,
    /// The built-in application to begin with [default: the setup's].
    #[arg(long, value_name = "NAME")]
    pub application: Option<String>,
}

/// Writes a setup and an application in which every key is explained, and a study of them.
///
/// # Errors
///
/// There is no such built-in setup or application, the directory holds a cell, or it cannot be written.
pub fn run(options: &NewOptions) -> Result<Exit, Failure> {
    let directory = &options.directory;
    let name = directory.file_name().map(|name| name.to_string_lossy().into_owned());
    let name = name.ok_or_else(|| usage(format!("{} names no directory", directory.display())))?;
    let kind = if setup::built_in(setup::CELLS, &options.setup).is_some() { SEVERAL_ARMS } else { ONE_ARM };
    let setup = setup::built_in(kind.setups, &options.setup).map(|(_, text)| text).ok_or_else(|| {
        let known = [setup::SETUPS, setup::CELLS].concat();
        unknown("setup", &known, &options.setup)
    })?;
    let (cell, _) = setup::cell(&options.setup)?;
    let of_setup = cell.application.or(cell.stations.into_iter().next().map(|station| station.application));
    let application = options.application.clone().or(of_setup).unwrap_or_default();
    let application = setup::built_in(kind.applications, &application)
        .ok_or_else(|| unknown(&format!("application for {}", kind.arms), kind.applications, &application))?
        .1;
    let setup = comments::explained(&own_setup(setup, &name, &options.setup), comments::SETUPS);
    let application = comments::explained(&named(application, &name), comments::APPLICATIONS);
    for file in [SETUP, APPLICATION, STUDY].into_iter().chain(kind.schemas().map(|(schema, _)| schema)) {
        if directory.join(file).exists() {
            return Err(usage(format!(
                "{} holds a cell already; name another directory",
                directory.display()
            )));
        }
    }
    directory::make(directory)?;
    let texts = [(SETUP, setup), (APPLICATION, application), (STUDY, kind.own_study())];
    for ((file, text), (schema, schema_text)) in texts.into_iter().zip(kind.schemas()) {
        write(&directory.join(file), &format!("#:schema {schema}\n{text}"))?;
        write(&directory.join(schema), schema_text)?;
    }
    let setup = directory.join(SETUP).display().to_string();
    let application = directory.join(APPLICATION).display().to_string();
    outln!("Saved {setup}, the cell, and {application}, what it does. Change them, then:");
    let (setup, application) = (in_shell(&setup), in_shell(&application));
    outln!("  bench --setup {setup} --mode virtual     checks both and measures");
    let study = in_shell(directory.join(STUDY).display());
    outln!("  bench study run {study}     varies it: {}", kind.shows);
    outln!(
        "  plc-node plan {application} --setup {setup}     shows the motions, and whether the arm reaches them"
    );
    Ok(Exit::Pass)
}

fn usage(problem: String) -> Failure {
    Failure::new(Exit::Usage, anyhow!(problem))
}

fn unknown(what: &str, all: &[(&str, &str)], name: &str) -> Failure {
    let known: Vec<_> = all.iter().map(|(known, _)| *known).collect();
    usage(format!("no built-in {what} is named `{name}`; choose one of {}", known.join(", ")))
}

/// Returns the setup under another name, with the application beside it, and without what the paper says of the built-in
/// cell: its figures, and numbers that were calibrated to them.
fn own_setup(setup: &str, name: &str, from: &str) -> String {
    let (mut is_top, mut is_paper) = (true, false);
    let mut text = String::new();
    for line in named(setup, name).lines() {
        if line.starts_with('[') {
            (is_top, is_paper) = (false, line.starts_with("[paper]"));
        }
        if is_paper {
            continue;
        }
        match (comments::key(line), line.split_once("from = \"calibrated\"")) {
            (Some("application"), _) if is_top => text.push_str(&format!("application = \"{APPLICATION}\"")),
            (_, Some((value, _))) => {
                text.push_str(&format!("{value}from = \"assumed\", note = \"taken from Setup {from}\" }}"));
            }
            _ => text.push_str(line),
        }
        text.push('\n');
    }
    text
}

/// Returns a file with another `name` and `title`.
fn named(toml: &str, name: &str) -> String {
    let mut is_top = true;
    let line = |line: &str| {
        is_top = is_top && !line.starts_with('[');
        match comments::key(line).filter(|_| is_top) {
            Some("name") => format!("name = {}\n", quoted(name)),
            Some("title") => format!("title = {}\n", quoted(&format!("my cell {name}"))),
            _ => format!("{line}\n"),
        }
    };
    toml.lines().map(line).collect()
}

fn quoted(text: &str) -> String {
    toml_edit::Value::from(text).to_string()
}

fn write(path: &Path, text: &str) -> anyhow::Result<()> {
    let file = OpenOptions::new().write(true).create_new(true).open(path);
    file.and_then(|mut file| file.write_all(text.as_bytes()))
        .with_context(|| format!("cannot write {}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the keys of a file that no comment of their table explains, each with its table's header.
    fn not_explained(text: &str) -> Vec<String> {
        let (mut header, mut missing) = ("", Vec::new());
        let mut explained = std::collections::BTreeSet::new();
        for line in text.lines() {
            if line.starts_with('[') {
                header = comments::header_of(line);
            } else if let Some((keys, _)) = line.strip_prefix("# ").and_then(|line| line.split_once(':')) {
                explained.extend(keys.split([',', ' ']).map(|key| (header, key)));
            } else if let Some(key) = comments::key(line).filter(|key| !explained.contains(&(header, *key))) {
                missing.push(format!("{header} {key}"));
            }
        }
        missing
    }

    #[test]
    fn every_key_of_a_new_setup_is_explained_and_nothing_is_left_of_the_paper() {
        for (name, text) in setup::SETUPS.iter().chain(setup::CELLS) {
            let own = own_setup(text, "mine", name);
            let explained = comments::explained(&own, comments::SETUPS);
            assert_eq!(not_explained(&explained), Vec::<String>::new(), "{explained}");
            assert!(!explained.contains("calibrated\"") && !explained.contains("[paper]"), "{explained}");
        }
    }

    #[test]
    fn every_step_of_a_new_application_is_explained() {
        for (_, text) in planning::APPLICATIONS.iter().chain(planning::ARMS_APPLICATIONS) {
            let explained = comments::explained(&named(text, "mine"), comments::APPLICATIONS);
            let missing = not_explained(&explained);
            // The user gives the names of frames, tools and the like; what belongs to them is explained at their header.
            let is_fixed =
                |key: &String| key.starts_with("[[") || key.starts_with("[ways]") || key.starts_with(' ');
            assert!(!missing.iter().any(is_fixed), "{missing:?}\n{explained}");
            assert!(explained.contains("# mm_deg: x, y, z, then a, b, c"), "{explained}");
        }
    }
}
