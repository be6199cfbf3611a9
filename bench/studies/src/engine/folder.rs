//! A study's directory: what its rows belong to, in `study.json`, and all that is needed to make its jobs again.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow, bail};
use planning::FoundCell;
use serde::{Deserialize, Serialize};
use serde_json::json;
use setup::Cell;
use sha2::{Digest as _, Sha256};

use records::cell_directory::{APPLICATION, inputs};
use records::exit::{Exit, Failure};
use records::occupied::{Files, Occupied};
use records::run_directory::{Durability, make_for_study, replace};

use super::RerunOptions;
use super::file::StudyFile;
use super::hex::hex;
use super::plan::{JobAddress, StudyPlan};
use super::rows::Columns;
use super::shard::Shard;
use crate::outputs;
use crate::study_files::{JOBS, MANIFEST, ROWS};

/// Version of `study.json` and of the rows.
const SCHEMA_VERSION: u32 = 1;

/// The study as it is executed.
pub(super) const STUDY: &str = "study.toml";
const SETUP: &str = "setup.toml";
/// Frictionless description of the rows' columns.
const ROWS_SCHEMA: &str = "rows.schema.json";

/// Study, program and shard of a directory's rows.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub(super) struct Manifest {
    /// Version of this format.
    pub schema_version: u32,
    /// Digest of everything that determines the jobs besides the program.
    pub study: String,
    /// Program that executed them.
    pub program: String,
    /// The shard; `0/1` for a whole or merged study.
    pub shard: Shard,
    /// Jobs of the whole study.
    pub jobs: u64,
    /// Rows of each job.
    pub rows_per_job: u64,
    /// Options of the verb that has these jobs; empty for the study of a file.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub command: String,
}

impl Manifest {
    /// Returns the description of a shard of a study with this many jobs.
    #[must_use]
    pub(super) fn of(plan: &StudyPlan, shard: Shard, jobs: u64) -> Self {
        Self {
            schema_version: SCHEMA_VERSION,
            study: plan.identity.clone(),
            program: plan.program.clone(),
            shard,
            jobs,
            rows_per_job: plan.rows_per_job(),
            command: String::new(),
        }
    }

    /// Returns the description of jobs that a verb lists itself.
    #[must_use]
    pub(super) const fn of_listed(study: String, command: String, program: String) -> Self {
        let (schema_version, shard) = (SCHEMA_VERSION, Shard::WHOLE);
        Self { schema_version, study, program, shard, jobs: 0, rows_per_job: Columns::ANY, command }
    }

    /// Reads the description of a directory; `None` if it has none.
    ///
    /// # Errors
    ///
    /// It cannot be read or is of another version.
    pub(super) fn read(directory: &Path) -> anyhow::Result<Option<Self>> {
        let path = directory.join(MANIFEST);
        let text = match std::fs::read_to_string(&path) {
            Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => {
                return Ok(None);
            }
            read => read.with_context(|| format!("cannot read {}", path.display()))?,
        };
        let value: serde_json::Value = serde_json::from_str(&text)
            .with_context(|| format!("{}: not a study's description", path.display()))?;
        let version = value.get("schema_version").and_then(serde_json::Value::as_u64).unwrap_or(0);
        if version != u64::from(SCHEMA_VERSION) {
            bail!(
                "{}: rows of version {version}, and this program continues version {SCHEMA_VERSION}; use another --out",
                directory.display()
            );
        }
        let manifest = serde_json::from_value(value);
        Ok(Some(manifest.with_context(|| format!("{}: broken; use another --out", path.display()))?))
    }

    /// Returns the description of a directory that has one.
    ///
    /// # Errors
    ///
    /// It has none, or an unreadable one.
    pub(super) fn of_directory(directory: &Path) -> anyhow::Result<Self> {
        Self::read(directory)?
            .with_context(|| format!("{}: no study here ({MANIFEST} is missing)", directory.display()))
    }

    /// Compares with the description that a directory has already.
    pub(super) fn check_same(&self, known: &Self, directory: &Path) -> anyhow::Result<()> {
        let shown = directory.display();
        let has_other_options = known.command != self.command && !known.command.is_empty();
        if known.study != self.study && has_other_options {
            bail!("{shown}: has jobs of other options; use another --out, or these: {}", known.command);
        }
        if known.study != self.study {
            bail!("{shown}: has rows of another study; use another --out");
        }
        if known.program != self.program {
            bail!(
                "{shown}: has rows of program {}, and this is {}; use that program, or another --out",
                known.program,
                self.program
            );
        }
        if known.shard != self.shard {
            bail!(
                "{shown}: has shard {} of this study, and this is {}; give each shard a directory of its own",
                known.shard,
                self.shard
            );
        }
        Ok(())
    }
}

/// Writes what stands beside the rows into a directory, unless it has that already.
///
/// # Errors
///
/// The directory holds another study, a run or other files of these names, or cannot be written.
pub(super) fn prepare(directory: &Path, plan: &StudyPlan, manifest: &Manifest) -> Result<(), Failure> {
    let usage = |error| Failure::new(Exit::Usage, error);
    if let Some(known) = Manifest::read(directory).map_err(usage)? {
        manifest.check_same(&known, directory).map_err(usage)?;
    }
    let study = toml::to_string(&StudyFile { study: section(plan), ..plan.file.clone() });
    let study = study.context("cannot write the study as TOML")?;
    let (cell, varied) = plan.saved_applications().unwrap_or_else(|| (plan.base.clone(), Vec::new()));
    let executed = match &plan.application {
        Some(found) => executed(&plan.base, found)?,
        None => vec![(SETUP.to_owned(), setup::cell_to_toml(&cell)?)],
    };
    let schema = format!("{:#}\n", frictionless(&Columns::of(plan)));
    let described = outputs::json(manifest)?;
    let mut inputs = vec![(ROWS_SCHEMA, schema.as_str()), (MANIFEST, &described)];
    inputs.extend(executed.iter().chain(&varied).map(|(name, text)| (name.as_str(), text.as_str())));
    // What is looked for may change from call to call.
    let files = Files { inputs: &inputs, results: &[ROWS, JOBS] };
    Occupied::check(directory, files).map_err(|error| usage(error.into()))?;
    make_for_study(directory, files)?;
    for (name, text) in inputs.into_iter().chain([(STUDY, study.as_str())]) {
        if std::fs::read_to_string(directory.join(name)).is_ok_and(|known| known == text) {
            continue;
        }
        replace(&directory.join(name), text, Durability::Written).map_err(of_host)?;
    }
    Ok(())
}

/// Returns the failure of a host: its disk, its memory.
pub(super) fn of_host(error: anyhow::Error) -> Failure {
    Failure::new(Exit::EnvironmentUnusable, error)
}

/// Returns the failure of a journal that cannot be opened: the host's where the system refused a file, otherwise the user's.
pub(super) fn of_journal(error: anyhow::Error) -> Failure {
    if error.chain().any(|cause| cause.is::<std::io::Error>()) {
        of_host(error)
    } else {
        Failure::new(Exit::Usage, error)
    }
}

/// Returns the setup and its applications as files, each with its name.
fn executed(cell: &Cell, found: &FoundCell) -> anyhow::Result<Vec<(String, String)>> {
    let texts: Vec<String> = found.stations.iter().map(|station| station.text.clone()).collect();
    inputs(cell, &texts)
}

/// Returns what is executed, by the files beside the rows.
fn section(plan: &StudyPlan) -> super::file::StudySection {
    // Where each station has an application of its own, the setup names them.
    let is_named_here = plan.base.is_one() || plan.base.application.is_some();
    let application = (plan.application.is_some() && is_named_here).then(|| APPLICATION.to_owned());
    super::file::StudySection { setup: SETUP.to_owned(), application, ..plan.file.study.clone() }
}

/// Describes the columns of the rows by the Table Schema of Frictionless, with units.
fn frictionless(columns: &Columns) -> serde_json::Value {
    let text = |name: &str, about: &str| json!({ "name": name, "type": "string", "description": about });
    let whole = |name: &str, about: &str| json!({ "name": name, "type": "integer", "description": about });
    let figure = |figure: &super::file::RowFigure| {
        let kind = if figure.is_whole() { "integer" } else { "number" };
        json!({ "name": figure.column(), "type": kind, "unit": figure.unit() })
    };
    let usual = super::file::RowFigure::USUAL.len().min(columns.figures.len());
    let (usual, more) = columns.figures.split_at(usual);
    let mut fields = vec![
        text("job", "address of the job: what it executed, with which seed and program"),
        whole("seed", "seed of clocks, phases and pauses"),
        json!({ "name": "type", "type": "string", "constraints": { "enum": ["rc", "sm", "cm"] } }),
        whole("repetition", "number among the repetitions of the type, from 1"),
    ];
    fields.extend(usual.iter().map(figure));
    fields.push(json!({
        "name": "status", "type": "string",
        "constraints": { "enum": ["passed", "failed", "not-run", "refused"] },
    }));
    fields.extend(more.iter().map(figure));
    json!({
        "fields": fields,
        "missingValues": [""],
        "primaryKey": ["job", "type", "repetition"],
        "foreignKeys": [{ "fields": ["job"], "reference": { "resource": "jobs", "fields": ["job"] } }],
    })
}

/// Returns the program's name in addresses: its commit, or the digest of its file where the sources differ from a commit.
///
/// # Errors
///
/// The program's file cannot be read.
pub(super) fn program(commit: &str) -> anyhow::Result<String> {
    if !commit.is_empty() && !commit.ends_with("-modified") {
        return Ok(commit.to_owned());
    }
    let path = std::env::current_exe().context("cannot find this program's file")?;
    let bytes = std::fs::read(&path).with_context(|| format!("cannot read {}", path.display()))?;
    Ok(format!("sha256:{}", hex(&Sha256::digest(bytes))))
}

/// A job that is to be executed again as a measured run.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct RerunJob {
    /// Arguments of the bench.
    pub arguments: Vec<String>,
}

/// Finds a job by its address, writes its setup and application, and returns how a measured run executes it.
///
/// # Errors
///
/// The directory holds no study, the study has no such job, or the job was refused.
pub(super) fn rerun(options: &RerunOptions, commit: &str) -> Result<RerunJob, Failure> {
    let RerunOptions { directory, job, out } = options;
    let usage = |error| Failure::new(Exit::Usage, error);
    let address = JobAddress::parse(job)
        .ok_or_else(|| usage(anyhow!("`{job}`: must be the 16 digits of a job, as in {ROWS}")))?;
    let manifest = Manifest::of_directory(directory).map_err(usage)?;
    let program = program(commit)?;
    if program != manifest.program {
        report::errln!("warning: the rows are of program {}, and this is {program}", manifest.program);
    }
    let plan = StudyPlan::read(&directory.join(STUDY), manifest.program)?;
    let jobs = plan.jobs().unwrap_or(u128::MAX);
    let found = (0..jobs).map(|number| plan.job(number)).find(|job| job.address == address);
    let found =
        found.ok_or_else(|| usage(anyhow!("{}: its study has no job {address}", directory.display())))?;
    let made =
        found.point.made.as_ref().map_err(|reason| usage(anyhow!("job {address} was refused: {reason}")))?;
    let out = out.clone().unwrap_or_else(|| directory.join(address.to_string()));
    let cell = out.join("cell");
    std::fs::create_dir_all(&cell)
        .with_context(|| format!("cannot make the directory {}", cell.display()))
        .map_err(of_host)?;
    for (name, text) in executed(&made.cell, &made.application)? {
        replace(&cell.join(name), text, Durability::Written)?;
    }
    let types: Vec<String> = plan.types.iter().map(ToString::to_string).collect();
    let shown = |path: PathBuf| path.display().to_string();
    let mut arguments = [
        "bench".to_owned(),
        format!("--setup={}", shown(cell.join(SETUP))),
        "--mode=virtual".to_owned(),
        format!("--types={}", types.join(",")),
        format!("--reps={}", plan.file.study.reps),
        format!("--seed={}", found.seed),
        "--capture=always".to_owned(),
        "--trace".to_owned(),
        format!("--out={}", shown(out.join("run"))),
    ]
    .to_vec();
    arguments.extend(made.faults.iter().map(|fault| format!("--fault={fault}")));
    Ok(RerunJob { arguments })
}
