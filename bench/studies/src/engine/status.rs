//! `bench study status`: how far a study is.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow};
use node::screen;

use records::exit::{Exit, Failure};
use report::outln;

use super::folder::Manifest;
use crate::study_files::JOBS;

/// Shows the progress of a directory, or of all directories in it.
///
/// # Errors
///
/// No study is found, or its files cannot be read.
pub(super) fn run(directory: &Path) -> Result<Exit, Failure> {
    let shards = shards(directory).map_err(|error| Failure::new(Exit::Usage, error))?;
    let mut table = screen::ruled();
    table.set_header(["shard", "jobs", "done", "not passed", "directory"]);
    let (mut all, mut done, mut failed, mut jobs, mut expected) = (0, 0, 0, 0, 0);
    for (path, manifest) in &shards {
        let of_shard = u64::try_from(manifest.shard.jobs(manifest.jobs.into())).unwrap_or(u64::MAX);
        let (done_here, failed_here) = count(path)?;
        (all, done, failed) = (all + of_shard, done + done_here, failed + failed_here);
        (jobs, expected) = (manifest.jobs, manifest.shard.count);
        let numbers = [of_shard, done_here, failed_here].map(|number| number.to_string());
        let [of_shard, done_here, failed_here] = numbers;
        table.add_row([
            manifest.shard.to_string(),
            of_shard,
            done_here,
            failed_here,
            path.display().to_string(),
        ]);
    }
    outln!("{}", screen::drawn(&table));
    let found = shards.len();
    outln!("{done} of {all} jobs are done, {failed} did not pass; {found} of {expected} shards are here.");
    if done == jobs {
        outln!("The study is complete: bench study merge {} --out DIR", names(&shards));
    }
    Ok(if failed > 0 { Exit::RunFailed } else { Exit::Pass })
}

fn names(shards: &[(PathBuf, Manifest)]) -> String {
    shards.iter().map(|(path, _)| report::in_shell(path.display())).collect::<Vec<_>>().join(" ")
}

/// Returns whether the directories of the shards in this one have all jobs of their study.
pub(super) fn is_complete(directory: &Path) -> bool {
    let Ok(shards) = shards(directory) else { return false };
    let done = shards.iter().map(|(path, _)| count(path).map_or(0, |(done, _)| done)).sum::<u64>();
    shards.first().is_some_and(|(_, manifest)| manifest.jobs == done)
}

/// Returns the directories with rows: this one, or those in it.
pub(super) fn shards(directory: &Path) -> anyhow::Result<Vec<(PathBuf, Manifest)>> {
    if let Some(manifest) = Manifest::read(directory)? {
        return Ok(vec![(directory.to_owned(), manifest)]);
    }
    let entries =
        std::fs::read_dir(directory).with_context(|| format!("cannot read {}", directory.display()))?;
    let mut found = Vec::new();
    for entry in entries {
        let path = entry.with_context(|| format!("cannot read {}", directory.display()))?.path();
        // A merged study is complete in itself.
        if let Some(manifest) = Manifest::read(&path)?.filter(|manifest| manifest.shard.count > 1) {
            found.push((path, manifest));
        }
    }
    if found.is_empty() {
        return Err(anyhow!("{}: no study here, and none in its directories", directory.display()));
    }
    found.sort_by_key(|(_, manifest)| manifest.shard.index);
    Ok(found)
}

/// Counts the jobs of a directory, and those that did not pass.
fn count(directory: &Path) -> anyhow::Result<(u64, u64)> {
    let path = directory.join(JOBS);
    let text = match std::fs::read_to_string(&path) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok((0, 0)),
        read => read.with_context(|| format!("cannot read {}", path.display()))?,
    };
    let whole = text.split_inclusive('\n').skip(1).filter(|line| line.ends_with('\n'));
    Ok(whole
        .fold((0, 0), |(jobs, failed), line| (jobs + 1, failed + u64::from(!line.trim_end().ends_with(',')))))
}
