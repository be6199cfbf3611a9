//! `bench study report`: each varied key against each figure, with intervals and pictures, and what the paper's figures say about
//! the drawn keys; as a page and as JSON.
//!
//! ```text
//! effects  effect of each key on each figure
//! picture  both as pictures
//! page     report.html
//! ```

mod effects;
mod page;
mod picture;

use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow};
use records::exit::{Exit, Failure};
use records::occupied::holds_run;
use records::run_directory::{Durability, replace};
use report::outln;
use serde::Serialize;

use super::folder::{Manifest, STUDY, of_host};
use super::identify::Identification;
use super::merge::check_same_study;
use super::observations::Observations;
use super::plan::StudyPlan;
use super::status::shards;
use crate::outputs;
use effects::KeyEffects;

/// Version of the report's JSON.
const SCHEMA_VERSION: u32 = 1;

const PAGE: &str = "report.html";
const JSON: &str = "report.json";

/// Report of a study.
#[derive(Debug, Serialize)]
struct StudyReport {
    /// Version of this format.
    schema_version: u32,
    /// Digest of everything that determines the jobs besides the program.
    study: String,
    /// Program that executed the jobs.
    program: String,
    /// The setup's name.
    setup: String,
    /// The setup's title.
    title: String,
    /// Jobs of the whole study.
    jobs: u64,
    /// Jobs that are done.
    done: usize,
    /// Jobs that did not pass; they are in no figure.
    not_passed: usize,
    /// Effects of each key.
    effects: Vec<KeyEffects>,
    /// Figures that are the same in all jobs.
    constant: Vec<String>,
    /// Identification of the drawn keys by the paper's figures.
    identification: Option<Identification>,
    /// Why nothing is said about them.
    not_identified: Option<String>,
}

/// Writes the report of a directory's rows, or of those of the shards in it.
///
/// # Errors
///
/// No study is there, its rows cannot be read, or the report cannot be written.
pub(super) fn run(directory: &Path) -> Result<Exit, Failure> {
    let usage = |error| Failure::new(Exit::Usage, error);
    let shards = shards(directory).map_err(usage)?;
    if holds_run(directory) {
        return Err(usage(anyhow!("{}: holds a run; name a study's directory", directory.display())));
    }
    check_same_study(&shards).map_err(usage)?;
    let (first, manifest) = shards.first().context("a study without a directory")?;
    let plan = StudyPlan::read(&first.join(STUDY), manifest.program.clone())?;
    let directories: Vec<PathBuf> = shards.iter().map(|(path, _)| path.clone()).collect();
    let observations = Observations::read(&plan, &directories).map_err(usage)?;
    let report = StudyReport::of(&plan, manifest, &observations);
    let json = outputs::json(&report)?;
    replace(&directory.join(JSON), &json, Durability::Written).map_err(of_host)?;
    replace(&directory.join(PAGE), &page::page(&report)?, Durability::Written).map_err(of_host)?;
    for sentence in page::sentences(&report) {
        outln!("{sentence}");
    }
    outln!("Page: {}; figures: {}.", directory.join(PAGE).display(), directory.join(JSON).display());
    Ok(Exit::Pass)
}

impl StudyReport {
    fn of(plan: &StudyPlan, manifest: &Manifest, observations: &Observations) -> Self {
        let (effects, constant) = effects::effects(&plan.axes, observations);
        let (identification, not_identified) = match Identification::of(plan, observations) {
            Ok(identification) => (Some(identification), None),
            Err(reason) => (None, Some(reason)),
        };
        Self {
            schema_version: SCHEMA_VERSION,
            study: manifest.study.clone(),
            program: manifest.program.clone(),
            setup: plan.base.name.clone(),
            title: plan.base.title.clone(),
            jobs: manifest.jobs,
            done: observations.jobs.len(),
            not_passed: observations.failed,
            effects,
            constant,
            identification,
            not_identified,
        }
    }
}
