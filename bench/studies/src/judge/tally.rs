//! The counts of judged lists, and their line in the file of the jobs.

use std::collections::BTreeMap;
use std::time::Duration;

use ::judge::{Class, Tally};

/// A list that broke a law.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct BrokenList {
    /// Number of the list.
    pub(super) number: u64,
    /// The first law that it broke.
    pub(super) class: Class,
}

/// Number of lists that are kept of each law: their cases are written, and then shrunk.
pub(super) const CASES: usize = 3;

/// The counts of one job.
#[derive(Clone, PartialEq, Debug, Default)]
pub(super) struct ListsTally {
    pub(super) lists: u64,
    pub(super) cycles: u64,
    pub(super) plant: Duration,
    pub(super) motions: u64,
    /// Skills that are done, were aborted, ended by an error.
    pub(super) ended: [u64; 3],
    /// Lists that broke a law, by number.
    pub(super) broken: Vec<BrokenList>,
}

impl ListsTally {
    /// Names of the columns, after the number of the job.
    pub(super) const HEAD: &'static str =
        "job,lists,robot_cycles,plant_ns,motions,done,aborted,failed,broken";

    pub(super) fn of(tally: Tally) -> Self {
        let Tally { cases: lists, cycles, plant, motions, ended, found } = tally;
        let broken =
            |(number, violation): (u64, ::judge::Violation)| BrokenList { number, class: violation.class };
        Self { lists, cycles, plant, motions, ended, broken: found.into_iter().map(broken).collect() }
    }

    /// Returns the line of a job without its number; a broken list is `NUMBER:LAW`.
    pub(super) fn line(&self) -> String {
        let Self { lists, cycles, plant, motions, ended: [done, aborted, failed], broken } = self;
        let broken: Vec<_> =
            broken.iter().map(|one| format!("{}:{}", one.number, one.class.name())).collect();
        let (nanos, broken) = (plant.as_nanos(), broken.join(" "));
        format!("{lists},{cycles},{nanos},{motions},{done},{aborted},{failed},{broken}")
    }

    /// Returns the counts of a saved job.
    pub(super) fn of_fields(fields: &[String]) -> Option<Self> {
        let [lists, cycles, nanos, motions, done, aborted, failed, broken] = fields else { return None };
        let count = |field: &String| field.parse().ok();
        let one = |text: &str| {
            let (number, law) = text.split_once(':')?;
            let class = Class::ALL.into_iter().find(|class| class.name() == law)?;
            Some(BrokenList { number: number.parse().ok()?, class })
        };
        Some(Self {
            lists: count(lists)?,
            cycles: count(cycles)?,
            plant: Duration::from_nanos(count(nanos)?),
            motions: count(motions)?,
            ended: [count(done)?, count(aborted)?, count(failed)?],
            broken: broken.split_whitespace().map(one).collect::<Option<_>>()?,
        })
    }
}

/// The sums of all jobs. Its size does not grow with the lists that break a law.
#[derive(Clone, PartialEq, Debug, Default)]
pub(super) struct TotalTally {
    pub(super) lists: u64,
    pub(super) cycles: u64,
    pub(super) plant: Duration,
    pub(super) motions: u64,
    /// Skills that are done, were aborted, ended by an error.
    pub(super) ended: [u64; 3],
    /// Lists that broke each law first, for the laws that were broken.
    pub(super) by_class: BTreeMap<Class, u64>,
    /// The first [`CASES`] lists of each law, in the order of the lists.
    pub(super) first: Vec<BrokenList>,
}

impl TotalTally {
    /// Adds the counts of the next job; returns those of its broken lists that are among the first of their law.
    pub(super) fn add(&mut self, job: ListsTally) -> &[BrokenList] {
        self.lists += job.lists;
        self.cycles += job.cycles;
        self.plant += job.plant;
        self.motions += job.motions;
        for (sum, of_job) in self.ended.iter_mut().zip(job.ended) {
            *sum += of_job;
        }
        let before = self.first.len();
        for broken in job.broken {
            let count = self.by_class.entry(broken.class).or_default();
            *count += 1;
            if *count <= CASES as u64 {
                self.first.push(broken);
            }
        }
        self.first.get(before..).unwrap_or_default()
    }

    /// Returns how many lists broke a law.
    pub(super) fn broken(&self) -> u64 {
        self.by_class.values().sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_lists_of_each_law_are_kept_however_many_break_it() {
        let mut total = TotalTally::default();
        let mut kept = Vec::new();
        for job in 0..1_000 {
            let class = |number| if number % 250 == 7 { Class::Stuck } else { Class::JointJerk };
            let broken =
                (job * 250..(job + 1) * 250).map(|number| BrokenList { number, class: class(number) });
            let job = ListsTally { lists: 250, broken: broken.collect(), ..ListsTally::default() };
            kept.extend(total.add(job).iter().map(|one| one.number));
        }
        assert_eq!(kept, [0, 1, 2, 7, 257, 507]);
        assert_eq!(total.first.iter().map(|one| one.number).collect::<Vec<_>>(), kept);
        let counts: Vec<_> = total.by_class.iter().map(|(class, count)| (class.name(), *count)).collect();
        assert_eq!(counts, [("joint-jerk", 249_000), ("stuck", 1_000)]);
        assert_eq!((total.lists, total.broken()), (250_000, 250_000));
    }

    #[test]
    fn the_counts_of_a_job_are_read_back_from_its_line() {
        let broken = [(4_421, Class::JointJerk), (4_477, Class::Stuck)];
        let tally = ListsTally {
            lists: 250,
            cycles: 9,
            plant: Duration::from_millis(36),
            motions: 7,
            ended: [3, 2, 1],
            broken: broken.map(|(number, class)| BrokenList { number, class }).into(),
        };
        let line = tally.line();
        insta::assert_snapshot!(line, @"250,9,36000000,7,3,2,1,4421:joint-jerk 4477:stuck");
        let fields = |line: &str| line.split(',').map(str::to_owned).collect::<Vec<_>>();
        assert_eq!(ListsTally::of_fields(&fields(&line)), Some(tally));
        assert_eq!(ListsTally::HEAD.split(',').count(), 1 + fields(&line).len());
        for wrong in ["250,9,36000000,7,3,2,1", "250,9,36000000,7,3,2,1,4421:gravity", "x,9,3,7,3,2,1,"] {
            assert_eq!(ListsTally::of_fields(&fields(wrong)), None, "{wrong}");
        }
    }
}
