//! The counts of judged lists, and their line in the file of the jobs.

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

/// The counts of some lists.
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

    /// Adds the counts of later lists.
    pub(super) fn add(&mut self, later: Self) {
        self.lists += later.lists;
        self.cycles += later.cycles;
        self.plant += later.plant;
        self.motions += later.motions;
        for (sum, later) in self.ended.iter_mut().zip(later.ended) {
            *sum += later;
        }
        self.broken.extend(later.broken);
    }

    /// Returns how many lists broke each law first, for the laws that were broken.
    pub(super) fn by_class(&self) -> Vec<(Class, usize)> {
        let count = |class| self.broken.iter().filter(|one| one.class == class).count();
        let counts = Class::ALL.into_iter().map(|class| (class, count(class)));
        counts.filter(|(_, count)| *count > 0).collect()
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

#[cfg(test)]
mod tests {
    use super::*;

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
