//! `bench study run`: executes the jobs of a study that its directory does not have yet.

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::thread;
use std::time::SystemTime;

use anyhow::anyhow;

use records::exit::{Exit, Failure};
use records::free_space::free_space;
use records::run_directory;
use records::schedule::Schedule;
use report::{errln, in_shell, outln};

use super::StudyRunOptions;
use super::estimate::StudyEstimate;
use super::finding::Findings;
use super::folder::{self, Manifest, of_host, of_journal};
use super::job::{JobInputs, JobRows};
use super::plan::{JobAddress, StudyJob, StudyPlan};
use super::rows::{Columns, RowsJournal, SavedJob, Tail, read};
use crate::event_loop::{interrupted, watch_for_interrupt};
use crate::jobs::Pool;

/// Runs a study, or one shard of it.
///
/// # Errors
///
/// The study is invalid or too large for this machine, the directory is another one's, or the disk does not take the rows.
pub(super) fn run(options: &StudyRunOptions, commit: &str) -> Result<Exit, Failure> {
    let started = SystemTime::now();
    let plan = StudyPlan::read(&options.file, folder::program(commit)?)?;
    let columns = Columns::of(&plan);
    let default = || run_directory::default_path(&plan.base.name, "study", started);
    let directory = options.out.clone().unwrap_or_else(default);
    let (jobs, of_study) = checked_count(options, &plan, &columns, &directory)?;
    folder::prepare(&directory, &plan, &Manifest::of(&plan, options.shard, of_study))?;
    let mut findings = Findings::of(&plan.file.finding, &columns);
    let mut known = HashSet::new();
    let journal = RowsJournal::open(&directory, columns.clone(), |job: &SavedJob<'_>| {
        known.insert(job.address);
        findings.add(job);
    });
    let mut journal = journal.map_err(of_journal)?;
    let is_interrupted = watch_for_interrupt()?;
    let pool =
        Pool { name: "study", quiet: options.quiet, threads: options.threads, interrupted: &is_interrupted };
    let mut not_saved = None;
    let ran = pool.each_number(
        jobs,
        |number| Ok(execute(&plan, plan.job(options.shard.job(number.into())), &known)),
        |_, executed| {
            let Some((job, rows)) = executed else { return Ok(()) };
            journal.add(job.address, job.seed, &job.point.values, &rows).inspect_err(|_| {
                not_saved = Some(());
            })
        },
    );
    drop(journal);
    if let Err(error) = ran {
        let error =
            error.context(format!("the study ends here; {} has all jobs before", directory.display()));
        return Err(if not_saved.is_some() { of_host(error) } else { error.into() });
    }
    let findings = counted(&directory, &plan, &columns)?;
    findings.lines(&directory).iter().for_each(|line| outln!("{line}"));
    outln!("Saved in {}.", directory.display());
    let done = findings.jobs;
    if is_interrupted.load(Ordering::Relaxed) && done < jobs {
        outln!("The same command with --out {} goes on.", in_shell(directory.display()));
        return Ok(interrupted(
            usize::try_from(done).unwrap_or(usize::MAX),
            usize::try_from(jobs).unwrap_or(usize::MAX),
            "jobs",
        ));
    }
    Ok(if findings.failed > 0 { Exit::RunFailed } else { Exit::Pass })
}

/// Returns the jobs of the shard and of the study, and says what they need; refuses what this machine cannot hold.
fn checked_count(
    options: &StudyRunOptions,
    plan: &StudyPlan,
    columns: &Columns,
    directory: &Path,
) -> Result<(u64, u64), Failure> {
    let cores = || thread::available_parallelism().map_or(1, usize::from);
    let threads = options.threads.map_or_else(cores, usize::from);
    let of_study = plan.jobs();
    let of_shard = of_study.map(|jobs| options.shard.jobs(jobs));
    let estimate = StudyEstimate::of(of_shard, columns, threads);
    let refusal = estimate.refusal(free_space(&existing(directory)));
    let counts = of_shard
        .and_then(|jobs| u64::try_from(jobs).ok())
        .zip(of_study.and_then(|jobs| u64::try_from(jobs).ok()));
    match (refusal, counts) {
        (None, Some(counts)) => {
            if !options.quiet {
                errln!("{estimate}.");
            }
            Ok(counts)
        }
        (refusal, _) => {
            let refusal = refusal.unwrap_or_else(|| "too many jobs to count".to_owned());
            Err(Failure::new(Exit::Usage, anyhow!("{}: {estimate}; {refusal}", options.file.display())))
        }
    }
}

/// Returns the deepest directory of a path that exists.
fn existing(directory: &Path) -> PathBuf {
    let absolute = std::path::absolute(directory).unwrap_or_else(|_| directory.to_owned());
    absolute.ancestors().find(|ancestor| ancestor.is_dir()).map_or(absolute.clone(), Path::to_owned)
}

/// Executes a job, unless it is done.
fn execute(plan: &StudyPlan, job: StudyJob, known: &HashSet<JobAddress>) -> Option<(StudyJob, JobRows)> {
    if known.contains(&job.address) {
        return None;
    }
    let schedule = Schedule::new(&plan.types, plan.file.study.reps, job.seed);
    let rows = match &job.point.made {
        Ok(made) => JobInputs {
            subject: made.subject(),
            schedule: &schedule,
            faults: &made.faults,
            figures: &plan.figures,
        }
        .execute(),
        Err(reason) => JobInputs::refused(&schedule, reason.clone()),
    };
    Some((job, rows))
}

/// Reads the rows of a directory again and counts what is in them.
fn counted(directory: &Path, plan: &StudyPlan, columns: &Columns) -> anyhow::Result<Findings> {
    let mut findings = Findings::of(&plan.file.finding, columns);
    read(directory, columns, Tail::MayBeCut, |job| findings.add(job))?;
    Ok(findings)
}
