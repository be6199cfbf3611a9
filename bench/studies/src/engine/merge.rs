//! `bench study merge`: the rows of all shards in one order, whatever order they were made in.
//!
//! Jobs are sorted by their address, in parts that fit into memory; the parts are merged from files.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::fs::File;
use std::io::{BufRead as _, BufReader, BufWriter, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow, bail};
use sha2::{Digest as _, Sha256};

use records::exit::{Exit, Failure};
use records::run_directory::Durability;
use records::run_directory::Replacement;
use report::outln;

use super::MergeOptions;
use super::finding::Findings;
use super::folder::{self, Manifest, of_host};
use super::hex::hex;
use super::plan::{JobAddress, StudyPlan};
use super::rows::{Columns, SavedJob, Tail, read};
use super::shard::Shard;
use crate::study_files::{JOBS, ROWS};

/// Bytes of rows that are sorted in memory; beyond, parts go through files.
const IN_MEMORY: usize = 64 << 20;

/// Merges the shards of a study.
///
/// # Errors
///
/// They are of different studies or programs, one is missing or incomplete, or the result cannot be written.
pub(super) fn run(options: &MergeOptions) -> Result<Exit, Failure> {
    let usage = |error| Failure::new(Exit::Usage, error);
    let manifests = manifests(&options.directories).map_err(usage)?;
    let Some((first_directory, first)) = manifests.first() else {
        return Err(usage(anyhow!("name the directories of all shards")));
    };
    if options.directories.iter().any(|directory| is_same(directory, &options.out)) {
        return Err(usage(anyhow!(
            "--out {}: is merged itself; name another directory",
            options.out.display()
        )));
    }
    let plan = StudyPlan::read(&first_directory.join("study.toml"), first.program.clone())?;
    let columns = Columns::of(&plan);
    let merged = Manifest { shard: Shard::WHOLE, ..first.clone() };
    if Manifest::of(&plan, Shard::WHOLE, first.jobs) != merged {
        return Err(usage(anyhow!(
            "{}: its files were changed; merge what was written",
            first_directory.display()
        )));
    }
    let mut sorter = Sorter::new(options.out.clone(), IN_MEMORY);
    let mut findings = Findings::of(&plan.file.finding, &columns);
    folder::prepare(&options.out, &plan, &merged)?;
    for (directory, _) in &manifests {
        let mut kept = Ok(());
        let ended = read(directory, &columns, Tail::IsWhole, |job| {
            findings.add(job);
            if kept.is_ok() {
                kept = sorter.add(job);
            }
        });
        ended.map_err(usage)?;
        kept.map_err(of_host)?;
    }
    if findings.jobs != first.jobs {
        let left = first.jobs.saturating_sub(findings.jobs);
        return Err(usage(anyhow!(
            "{left} of {} jobs are missing; run the same shards again, they go on where they ended",
            first.jobs
        )));
    }
    let digest = sorter.write(&columns, &options.out).map_err(of_host)?;
    findings.lines(&options.out).iter().for_each(|line| outln!("{line}"));
    outln!("digest sha256:{digest}");
    Ok(if findings.failed > 0 { Exit::RunFailed } else { Exit::Pass })
}

fn is_same(one: &Path, other: &Path) -> bool {
    crate::outputs::location(one) == crate::outputs::location(other)
}

/// Reads the descriptions of all shards and checks that they are each shard of one study once.
fn manifests(directories: &[PathBuf]) -> anyhow::Result<Vec<(PathBuf, Manifest)>> {
    let mut manifests: Vec<(PathBuf, Manifest)> = Vec::new();
    for directory in directories {
        manifests.extend(super::status::shards(directory)?);
    }
    check_same_study(&manifests)?;
    let count = manifests.first().map_or(0, |(_, manifest)| manifest.shard.count);
    let missing =
        (0..count).find(|index| manifests.iter().all(|(_, manifest)| manifest.shard.index != *index));
    if let Some(index) = missing {
        bail!("shard {index}/{count}: missing; name the directories of all {count} shards");
    }
    Ok(manifests)
}

/// Checks that directories have different shards of one study by one program.
pub(super) fn check_same_study(manifests: &[(PathBuf, Manifest)]) -> anyhow::Result<()> {
    let Some((other, known)) = manifests.first() else { return Ok(()) };
    for (index, (path, manifest)) in manifests.iter().enumerate() {
        let shown = format!("{} and {}", other.display(), path.display());
        if known.study != manifest.study {
            bail!("{shown}: are of different studies; merge the shards of one");
        }
        if known.program != manifest.program {
            bail!(
                "{shown}: are of programs {} and {}; run all shards by one",
                known.program,
                manifest.program
            );
        }
        if known.shard.count != manifest.shard.count {
            bail!("{shown}: are shards {} and {}; merge those of one split", known.shard, manifest.shard);
        }
        let mut before = manifests.iter().take(index);
        if let Some((other, _)) = before.find(|(_, earlier)| earlier.shard == manifest.shard) {
            bail!(
                "{} and {}: are both shard {}; name each once",
                other.display(),
                path.display(),
                manifest.shard
            );
        }
    }
    Ok(())
}

/// A job's text: its line among the jobs and its rows.
#[derive(PartialEq, Eq, PartialOrd, Ord)]
struct JobText {
    address: u64,
    line: String,
    rows: String,
}

/// Sorts jobs by their address, in memory as far as they fit.
struct Sorter {
    directory: PathBuf,
    in_memory: usize,
    jobs: Vec<JobText>,
    bytes: usize,
    parts: Vec<PathBuf>,
}

impl Sorter {
    const fn new(directory: PathBuf, in_memory: usize) -> Self {
        Self { directory, in_memory, jobs: Vec::new(), bytes: 0, parts: Vec::new() }
    }

    fn add(&mut self, job: &SavedJob<'_>) -> anyhow::Result<()> {
        let rows = job.rows.concat();
        self.bytes += rows.len() + job.line.len();
        self.jobs.push(JobText { address: job.address.0, line: job.line.to_owned(), rows });
        if self.bytes > self.in_memory { self.spill() } else { Ok(()) }
    }

    /// Writes what is in memory to a file, sorted.
    fn spill(&mut self) -> anyhow::Result<()> {
        let path = self.directory.join(format!("part-{}.tmp", self.parts.len()));
        let about = || format!("cannot write {}", path.display());
        self.jobs.sort_unstable();
        let mut file = BufWriter::new(File::create(&path).with_context(about)?);
        self.parts.push(path.clone());
        for JobText { line, rows, .. } in self.jobs.drain(..) {
            let count = rows.matches('\n').count();
            write!(file, "{count}\n{line}{rows}").with_context(about)?;
        }
        file.flush().with_context(about)?;
        self.bytes = 0;
        Ok(())
    }

    /// Writes both files in order; returns the digest of the rows.
    fn write(&mut self, columns: &Columns, directory: &Path) -> anyhow::Result<String> {
        let mut rows = Digested::create(&directory.join(ROWS), &columns.rows_head())?;
        let mut jobs = Digested::create(&directory.join(JOBS), &columns.jobs_head())?;
        let mut last = None;
        let mut put = |job: JobText| -> anyhow::Result<()> {
            if last.replace(job.address) == Some(job.address) {
                bail!("two jobs have the address {}; their rows would be mixed", JobAddress(job.address));
            }
            rows.add(&job.rows)?;
            jobs.add(&job.line)
        };
        if self.parts.is_empty() {
            self.jobs.sort_unstable();
            self.jobs.drain(..).try_for_each(&mut put)?;
        } else {
            if !self.jobs.is_empty() {
                self.spill()?;
            }
            let mut parts: Vec<_> =
                self.parts.iter().map(|path| SortedPart::open(path)).collect::<Result<_, _>>()?;
            let mut heap = BinaryHeap::new();
            for (index, part) in parts.iter_mut().enumerate() {
                heap.extend(part.next()?.map(|job| Reverse((job, index))));
            }
            while let Some(Reverse((job, index))) = heap.pop() {
                put(job)?;
                if let Some(part) = parts.get_mut(index) {
                    heap.extend(part.next()?.map(|job| Reverse((job, index))));
                }
            }
        }
        jobs.finish()?;
        rows.finish()
    }
}

impl Drop for Sorter {
    fn drop(&mut self) {
        for part in &self.parts {
            let _ = std::fs::remove_file(part);
        }
    }
}

/// A sorted part in a file.
struct SortedPart(BufReader<File>);

impl SortedPart {
    fn open(path: &Path) -> anyhow::Result<Self> {
        let file = File::open(path).with_context(|| format!("cannot read {}", path.display()))?;
        Ok(Self(BufReader::new(file)))
    }

    fn next(&mut self) -> anyhow::Result<Option<JobText>> {
        let mut count = String::new();
        if self.0.read_line(&mut count)? == 0 {
            return Ok(None);
        }
        let count: u64 = count.trim_end().parse().context("a part of the merge was changed meanwhile")?;
        let (mut line, mut rows) = (String::new(), String::new());
        self.0.read_line(&mut line)?;
        for _ in 0..count {
            self.0.read_line(&mut rows)?;
        }
        let address = line.get(..JobAddress::DIGITS).and_then(JobAddress::parse);
        let address = address.context("a part of the merge was changed meanwhile")?.0;
        Ok(Some(JobText { address, line, rows }))
    }
}

/// A file that is put in place as a whole, with its digest.
struct Digested {
    replacement: Replacement,
    buffer: Vec<u8>,
    digest: Sha256,
    path: PathBuf,
}

impl Digested {
    /// Bytes that are written at once.
    const AT_ONCE: usize = 1 << 20;

    fn create(path: &Path, head: &str) -> anyhow::Result<Self> {
        let replacement = Replacement::create(path)?;
        let mut file = Self { replacement, buffer: Vec::new(), digest: Sha256::new(), path: path.to_owned() };
        file.add(head)?;
        Ok(file)
    }

    fn add(&mut self, text: &str) -> anyhow::Result<()> {
        self.buffer.extend_from_slice(text.as_bytes());
        if self.buffer.len() >= Self::AT_ONCE { self.write() } else { Ok(()) }
    }

    fn write(&mut self) -> anyhow::Result<()> {
        self.digest.update(&self.buffer);
        let written = self.replacement.file().write_all(&self.buffer);
        self.buffer.clear();
        written.with_context(|| format!("cannot write {}", self.path.display()))
    }

    fn finish(mut self) -> anyhow::Result<String> {
        self.write()?;
        self.replacement.finish(Durability::Synced)?;
        Ok(hex(&self.digest.finalize()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::file::RowFigure;

    #[test]
    fn parts_in_files_give_the_same_digest_as_a_merge_in_memory() {
        let columns = Columns { figures: RowFigure::USUAL.to_vec(), keys: Vec::new(), rows_per_job: 2 };
        let merged = |in_memory: usize| {
            let place = tempfile::tempdir().unwrap();
            let mut sorter = Sorter::new(place.path().to_owned(), in_memory);
            for index in 0..1_000_u64 {
                // Scattered, as addresses are.
                let address = JobAddress(index.wrapping_mul(0x9E37_79B9_7F4A_7C15));
                let rows = [1, 2].map(|row| format!("{address},{index},cm,{row},1,1,0,passed\n"));
                let line = format!("{address},\n");
                sorter.add(&SavedJob { address, rows: &rows, line: &line }).unwrap();
            }
            let digest = sorter.write(&columns, place.path()).unwrap();
            drop(sorter);
            assert_eq!(std::fs::read_dir(place.path()).unwrap().count(), 2, "no parts are left");
            (digest, std::fs::read_to_string(place.path().join(ROWS)).unwrap())
        };
        let (digest, rows) = merged(usize::MAX);
        assert_eq!(hex(&Sha256::digest(&rows)), digest);
        assert!(rows.lines().skip(1).is_sorted());
        assert_eq!(merged(4_096).0, digest);
    }
}
