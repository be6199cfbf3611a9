//! Runs many independent virtual runs on all cores, with a line of progress.

use std::io::{self, IsTerminal};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc;
use std::thread;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use report::errln;

/// Shortest interval between two lines of progress.
const PLAIN_LINE_EVERY: Duration = Duration::from_secs(2);

/// Results that wait for a slow disk; then the jobs wait.
const WAITING: usize = 1_024;

/// Runs all jobs, at most one per core at a time, and returns their results in the order of the jobs: `None` for a job
/// that was not started before `interrupted` was set. The first error ends it.
///
/// # Errors
///
/// The error of a job.
pub fn run<J: Sync, R: Send>(
    name: &str,
    quiet: bool,
    interrupted: &AtomicBool,
    jobs: &[J],
    work: impl Fn(&J) -> anyhow::Result<R> + Sync,
) -> anyhow::Result<Vec<Option<R>>> {
    let mut results: Vec<Option<R>> = jobs.iter().map(|_| None).collect();
    Pool { name, quiet, threads: None, interrupted }.each(jobs, work, |index, result| {
        if let Some(slot) = results.get_mut(index) {
            *slot = Some(result);
        }
        Ok(())
    })?;
    Ok(results)
}

/// Options for running jobs.
pub struct Pool<'a> {
    /// Beginning of the line of progress.
    pub name: &'a str,
    /// Whether there is none.
    pub quiet: bool,
    /// How many at a time; `None` for one per core.
    pub threads: Option<u16>,
    /// Set when no further job is to start.
    pub interrupted: &'a AtomicBool,
}

impl Pool<'_> {
    /// Runs all jobs until an interrupt, and calls `done` with the number and the result of each, in the order in which
    /// they end. The first error ends it.
    ///
    /// # Errors
    ///
    /// The error of a job, or of `done`.
    pub fn each<J: Sync, R: Send>(
        &self,
        jobs: &[J],
        work: impl Fn(&J) -> anyhow::Result<R> + Sync,
        mut done: impl FnMut(usize, R) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        let index = |number: u64| usize::try_from(number).unwrap_or(usize::MAX);
        let work = |number| jobs.get(index(number)).map(&work).transpose();
        self.each_number(jobs.len() as u64, work, |number, result| {
            result.map_or(Ok(()), |result| done(index(number), result))
        })
    }

    /// Runs jobs that are made from their numbers, 0 to `count` − 1, like [`each`](Self::each): no list of them is in memory.
    ///
    /// # Errors
    ///
    /// The error of a job, or of `done`.
    pub fn each_number<R: Send>(
        &self,
        count: u64,
        work: impl Fn(u64) -> anyhow::Result<R> + Sync,
        mut done: impl FnMut(u64, R) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        let next = AtomicU64::new(0);
        let cores = || thread::available_parallelism().map_or(1, usize::from);
        let most = usize::try_from(count.max(1)).unwrap_or(usize::MAX);
        let workers = self.threads.map_or_else(cores, usize::from).min(most);
        let mut progress = Progress::start(self.name, self.quiet, count);
        thread::scope(|scope| {
            let (ended, outcomes) = mpsc::sync_channel(WAITING);
            for _ in 0..workers {
                let (ended, next, work, interrupted) = (ended.clone(), &next, &work, self.interrupted);
                scope.spawn(move || {
                    while !interrupted.load(Ordering::Relaxed) {
                        let number = next.fetch_add(1, Ordering::Relaxed);
                        // After a job failed, the receiver of the results is gone.
                        if number >= count || ended.send((number, work(number))).is_err() {
                            break;
                        }
                    }
                });
            }
            drop(ended);
            for (number, outcome) in outcomes {
                done(number, outcome?)?;
                progress.step();
            }
            anyhow::Ok(())
        })?;
        progress.end();
        Ok(())
    }
}

/// Progress on standard error: a live line on a terminal, plain lines elsewhere.
#[derive(Debug)]
pub struct Progress {
    view: View,
    name: String,
    started: Instant,
    done: u64,
    all: u64,
}

#[derive(Debug)]
enum View {
    Live(ProgressBar),
    Plain { last_line: Instant },
    Quiet,
}

impl Progress {
    /// Starts a line that begins with `name`.
    #[must_use]
    pub fn start(name: &str, quiet: bool, all: u64) -> Self {
        let started = Instant::now();
        let view = if quiet {
            View::Quiet
        } else if io::stderr().is_terminal() {
            let style = ProgressStyle::with_template("{prefix} {bar:25} {pos:>4}/{len}  {msg}")
                .unwrap_or_else(|_| ProgressStyle::default_bar());
            let bar = ProgressBar::with_draw_target(Some(all), ProgressDrawTarget::stderr());
            View::Live(bar.with_style(style).with_prefix(name.to_owned()))
        } else {
            View::Plain { last_line: started }
        };
        Self { view, name: name.to_owned(), started, done: 0, all }
    }

    fn step(&mut self) {
        self.set(self.done + 1);
    }

    /// Shows how many are done.
    pub fn set(&mut self, done: u64) {
        let before = std::mem::replace(&mut self.done, done.clamp(1, self.all));
        let left = self.started.elapsed().as_secs_f64() / self.done as f64 * (self.all - self.done) as f64;
        let left = if left < 1.0 { String::new() } else { format!("{left:.0} s left") };
        match &mut self.view {
            View::Live(bar) => {
                bar.set_position(self.done);
                bar.set_message(left);
            }
            View::Plain { last_line } => {
                if is_due(last_line.elapsed(), before, self.done, self.all) {
                    *last_line = Instant::now();
                    errln!("{} {:>4}/{}  {left}", self.name, self.done, self.all);
                }
            }
            View::Quiet => {}
        }
    }

    /// Prints a line besides, unless there is no progress.
    pub fn line(&self, text: &str) {
        match &self.view {
            View::Live(bar) => bar.println(node::output::shown(text)),
            View::Plain { .. } => errln!("{text}"),
            View::Quiet => {}
        }
    }

    /// Removes a live line.
    pub fn end(&self) {
        if let View::Live(bar) = &self.view {
            bar.finish_and_clear();
        }
    }
}

/// Returns whether a plain line is printed this long after the last one: once for each count, and always for the last count.
fn is_due(since_last: Duration, before: u64, done: u64, all: u64) -> bool {
    done != before && (since_last >= PLAIN_LINE_EVERY || done == all)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_count_that_stays_prints_no_second_line_also_when_it_is_the_last() {
        let (soon, late) = (Duration::ZERO, PLAIN_LINE_EVERY);
        assert!(!is_due(soon, 7, 8, 10) && is_due(late, 7, 8, 10) && !is_due(late, 8, 8, 10));
        assert!(is_due(soon, 9, 10, 10) && !is_due(soon, 10, 10, 10) && !is_due(late, 10, 10, 10));
    }

    #[test]
    fn results_have_the_order_of_the_jobs_and_an_error_ends_the_rest() {
        let jobs: Vec<u64> = (0..100).collect();
        let square = |job: &u64| if *job == 200 { anyhow::bail!("too much") } else { Ok(job * job) };
        let go_on = AtomicBool::new(false);
        let squares = run("squares", true, &go_on, &jobs, square).unwrap();
        assert!(squares.iter().zip(&jobs).all(|(square, job)| *square == Some(job * job)));
        let failed = run("squares", true, &go_on, &[1, 200, 3], square).unwrap_err();
        assert_eq!(failed.to_string(), "too much");
    }

    #[test]
    fn after_an_interrupt_no_job_starts_and_those_that_ran_keep_their_results() {
        let (interrupted, jobs): (_, Vec<u64>) = (AtomicBool::new(false), (0..1_000).collect());
        let results = run("jobs", true, &interrupted, &jobs, |job| {
            interrupted.store(true, Ordering::Relaxed);
            Ok(*job)
        });
        let results = results.unwrap();
        assert_eq!(results.first(), Some(&Some(0)));
        let cores = thread::available_parallelism().unwrap().get();
        let done: Vec<u64> = results.iter().copied().flatten().collect();
        assert!((1..=cores).contains(&done.len()) && results.len() == jobs.len(), "{done:?}");
    }
}
