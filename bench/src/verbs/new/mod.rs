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

/// The files' schemas beside them, for editors, each with its text. The first line of a file names its own.
const SCHEMAS: [(&str, &str); 3] = [
    ("setup.schema.json", include_str!("../../../../cell/schemas/setup.schema.json")),
    ("application.schema.json", include_str!("../../../../cell/schemas/application.schema.json")),
    ("study.schema.json", include_str!("../../../schemas/study.schema.json")),
];

/// The example that a new study begins with, and its name in its comments.
const STUDY_OF_ZONES: &str = EXAMPLES[1].1;
const ZONES_FILE: &str = "approximation-zones.toml";

/// Options of a new cell.
#[derive(Args, Debug)]
pub struct NewOptions {
    /// The directory to write setup.toml, application.toml and study.toml into; its name is the cell's.
    #[arg(value_name = "DIR")]
    pub directory: PathBuf,
    /// The built-in setup to begin with.
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
    let setup = built_in("setup", setup::SETUPS, &options.setup)?;
    let of_setup = setup::setup(&options.setup)?.application;
    let application = options.application.as_deref().unwrap_or(&of_setup);
    let application = built_in("application", planning::APPLICATIONS, application)?;
    let setup = comments::explained(&own_setup(setup, &name, &options.setup), comments::SETUPS);
    let application = comments::explained(&named(application, &name), comments::APPLICATIONS);
    for file in [SETUP, APPLICATION, STUDY].into_iter().chain(SCHEMAS.map(|(schema, _)| schema)) {
        if directory.join(file).exists() {
            return Err(usage(format!(
                "{} holds a cell already; name another directory",
                directory.display()
            )));
        }
    }
    directory::make(directory)?;
    for (file, text, (schema, schema_text)) in
        [(SETUP, setup, SCHEMAS[0]), (APPLICATION, application, SCHEMAS[1]), (STUDY, own_study(), SCHEMAS[2])]
    {
        write(&directory.join(file), &format!("#:schema {schema}\n{text}"))?;
        write(&directory.join(schema), schema_text)?;
    }
    let setup = directory.join(SETUP).display().to_string();
    let application = directory.join(APPLICATION).display().to_string();
    outln!("Saved {setup}, the cell, and {application}, what it does. Change them, then:");
    let (setup, application) = (in_shell(&setup), in_shell(&application));
    outln!("  bench --setup {setup} --mode virtual     checks both and measures");
    let study = in_shell(directory.join(STUDY).display());
    outln!("  bench study run {study}     varies it: how much later each type ends with other zones");
    outln!(
        "  plc-node plan {application} --setup {setup}     shows the motions, and whether the arm reaches them"
    );
    Ok(Exit::Pass)
}

/// Returns a study of the setup beside it.
fn own_study() -> String {
    STUDY_OF_ZONES.replace("setup = \"A\"", &format!("setup = \"{SETUP}\"")).replace(ZONES_FILE, STUDY)
}

fn usage(problem: String) -> Failure {
    Failure::new(Exit::Usage, anyhow!(problem))
}

fn built_in<'a>(what: &str, all: &[(&'static str, &'a str)], name: &str) -> Result<&'a str, Failure> {
    setup::built_in(all, name).map(|(_, text)| text).ok_or_else(|| {
        let known: Vec<_> = all.iter().map(|(known, _)| *known).collect();
        usage(format!("there is no built-in {what} `{name}`; there are {}", known.join(", ")))
    })
}

/// Returns the setup under another name, with the application beside it, and without what the paper says of the built-in
/// cell: its figures, and numbers that were calibrated to them.
fn own_setup(setup: &str, name: &str, from: &str) -> String {
    let mut is_paper = false;
    let mut text = String::new();
    for line in named(setup, name).lines() {
        if line.starts_with('[') {
            is_paper = line.starts_with("[paper]");
        }
        if is_paper {
            continue;
        }
        match (comments::key(line), line.split_once("from = \"calibrated\"")) {
            (Some("application"), _) => text.push_str(&format!("application = \"{APPLICATION}\"")),
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
                header = line;
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
        for (name, text) in setup::SETUPS {
            let own = own_setup(text, "mine", name);
            let explained = comments::explained(&own, comments::SETUPS);
            assert_eq!(not_explained(&explained), Vec::<String>::new(), "{explained}");
            assert!(!explained.contains("calibrated\"") && !explained.contains("[paper]"), "{explained}");
        }
    }

    #[test]
    fn every_step_of_a_new_application_is_explained() {
        for (_, text) in planning::APPLICATIONS {
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
