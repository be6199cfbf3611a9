//! `bench study`: a file says what varies, and many jobs in virtual time give rows. The other studies are built on the same jobs.
//!
//! ```text
//! file       the format of a study's file
//! key        the keys of a setup, which a study varies
//! axis       the values of one key: a list, a range, or draws from a distribution
//! checks     the values of the file
//! application  of the only robot, or of all stations, and those that a study varies
//! setup_table  the setup with other values of some keys; hex: bytes as text
//! plan       the jobs of a study, each made from its number; point is one of its grid, job executes one
//! figure     the value of a row's figure, of one robot or of several stations
//! rows       rows.csv and jobs.csv, appended job by job, and read back
//! folder     what stands beside the rows: the study, its program, its shard
//! finding    rows that a study looks for
//! estimate   how long a study takes, and how much disk
//! observations  the rows as figures of each job
//! report     each factor against each figure; identify: the parameters that the paper's figures point to
//! claim      the study and the program that a verb's directory belongs to
//! lines      files of whole lines, which one process appends to
//! listed     the jobs of verbs that list them: sweep, sensitivity, buses, calibrate
//! numbered   the jobs of verbs that number them: explore, judge, soak, long
//! run, merge, status, submit, report    the verbs
//! ```

mod application;
mod axis;
mod checks;
pub mod claim;
mod estimate;
mod figure;
pub mod file;
mod finding;
pub(crate) mod folder;
mod hex;
mod identify;
pub mod job;
pub mod key;
pub(crate) mod lines;
pub mod listed;
mod merge;
pub mod numbered;
mod observations;
pub mod plan;
pub mod point;
mod report;
mod rows;
mod run;
mod setup_table;
mod shard;
mod status;
mod submit;

use std::path::PathBuf;

use clap::{Args, Subcommand};

use records::exit::{Exit, Failure};

pub use folder::RerunJob;
pub use shard::Shard;
pub use submit::Engine;

/// Verbs of a study.
#[derive(Subcommand, Debug)]
pub enum StudyVerb {
    /// Execute the jobs of a study on this machine's cores, or one shard of them. Given again, it goes on where it ended.
    Run(StudyRunOptions),
    /// Hand the shards of a study to an engine: this machine, Slurm, HyperQueue or Kubernetes.
    Submit(SubmitOptions),
    /// Show how far a study is, from its directory or from the directory above those of its shards.
    Status(StatusOptions),
    /// Merge the rows of all shards in one order, and print their digest.
    Merge(MergeOptions),
    /// Write a page and JSON: each varied key against each figure, and what the paper's figures say about drawn keys.
    Report(ReportOptions),
    /// Execute one job again as a measured run that keeps everything: samples, report, race, traces and captures.
    Rerun(RerunOptions),
}

/// Options of a study's run.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  bench study run table-2.toml --out table-2
  bench study run table-2.toml --out table-2/shard-0 --shard 0/7
  seq 0 6 | xargs -P 7 -I{} bench study run table-2.toml --out table-2/shard-{} --shard {}/7 --threads 1
  bench study merge table-2/shard-* --out table-2/all")]
pub struct StudyRunOptions {
    /// The study's file.
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// Directory for the rows [default: runs/TIME-SETUP-study].
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Execute only shard I of N, counted from 0.
    #[arg(long, value_name = "I/N", default_value_t = Shard::WHOLE)]
    pub shard: Shard,
    /// Jobs at a time [default: one a core].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub threads: Option<u16>,
    /// Print the result only: no estimate, no progress.
    #[arg(long, short)]
    pub quiet: bool,
}

/// Options of handing a study to an engine.
#[derive(Args, Debug)]
#[command(
    override_usage = "bench study submit [OPTIONS] --engine <ENGINE> --shards <N>\n           --out <DIR> <FILE>"
)]
pub struct SubmitOptions {
    /// The study's file.
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// The engine that runs the shards.
    #[arg(long, value_enum)]
    pub engine: Engine,
    /// Number of shards.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub shards: u32,
    /// Directory in which each shard has its own; every machine must see it under this path.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Only print what would be handed over.
    #[arg(long)]
    pub print: bool,
    /// HyperQueue: directory of the server to submit to; without it, a local cluster is started.
    #[arg(long, value_name = "DIR")]
    pub server_dir: Option<PathBuf>,
    /// HyperQueue: the Python that has the package `hyperqueue`.
    #[arg(long, value_name = "PROGRAM", default_value = "python3")]
    pub python: PathBuf,
    /// Kubernetes: image with the program `bench`.
    #[arg(long, value_name = "NAME")]
    pub image: Option<String>,
    /// Kubernetes: claim of a volume that all pods can write; it is mounted at the directory of `--out`.
    #[arg(long, value_name = "CLAIM")]
    pub volume: Option<String>,
}

/// Options of a study's status.
#[derive(Args, Debug)]
pub struct StatusOptions {
    /// A study's directory, or one that contains those of its shards.
    #[arg(value_name = "DIR")]
    pub directory: PathBuf,
}

/// Options of a merge.
#[derive(Args, Debug)]
pub struct MergeOptions {
    /// Directories of all shards.
    #[arg(value_name = "DIR", required = true, num_args = 1..)]
    pub directories: Vec<PathBuf>,
    /// Directory for the merged rows.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
}

/// Options of a study's report.
#[derive(Args, Debug)]
pub struct ReportOptions {
    /// A study's directory, of a run or of a merge, or one that contains those of its shards; the report goes there.
    #[arg(value_name = "DIR")]
    pub directory: PathBuf,
}

/// Options of a job that is executed again.
#[derive(Args, Debug)]
pub struct RerunOptions {
    /// The study's directory, of a run or of a merge.
    #[arg(value_name = "DIR")]
    pub directory: PathBuf,
    /// The job's address, as in the rows.
    #[arg(value_name = "JOB")]
    pub job: String,
    /// Directory for the job's setup and its run [default: DIR/JOB].
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}

/// Runs a verb of a study; `commit` is the one that this program was built from. A job that is to be executed again is returned,
/// since only a measured run keeps everything.
///
/// # Errors
///
/// The study's file, its setup or an option is invalid, or a file cannot be read or written.
pub fn run(verb: &StudyVerb, commit: &str) -> Result<Result<Exit, RerunJob>, Failure> {
    match verb {
        StudyVerb::Run(options) => run::run(options, commit).map(Ok),
        StudyVerb::Submit(options) => submit::run(options).map(Ok),
        StudyVerb::Status(options) => status::run(&options.directory).map(Ok),
        StudyVerb::Merge(options) => merge::run(options).map(Ok),
        StudyVerb::Report(options) => report::run(&options.directory).map(Ok),
        StudyVerb::Rerun(options) => folder::rerun(options, commit).map(Err),
    }
}
