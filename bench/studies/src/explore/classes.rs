//! Classes of outcomes, and their counts by type, kind of fault and frame.

use std::collections::BTreeMap;

use super::fault::What;
use super::runs::Job;

/// How a run ended, from the best to the worst.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub(super) enum Class {
    /// It passed in the same time as without a fault.
    Same,
    /// It passed, in another time, within the bound.
    Late,
    /// It failed with a reason, and a run after it passed.
    Refused,
    /// It passed, later than the bound.
    TooLate,
    /// It never ended, or no run passed after it.
    Stuck,
    /// It ended without an error, but the verification found a difference from the plan.
    Altered,
    /// It broke a law of the cell: an arm went beyond a mark before the others had come, two were in one zone, or the failure
    /// names no station.
    LawBroken,
    /// The program panicked.
    Panicked,
}

impl Class {
    pub(super) const ALL: [Self; 8] = [
        Self::Same,
        Self::Late,
        Self::Refused,
        Self::TooLate,
        Self::Stuck,
        Self::Altered,
        Self::LawBroken,
        Self::Panicked,
    ];

    /// Returns its name in files and tables.
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Same => "same",
            Self::Late => "late",
            Self::Refused => "refused",
            Self::TooLate => "too late",
            Self::Stuck => "stuck",
            Self::Altered => "altered",
            Self::LawBroken => "law broken",
            Self::Panicked => "panicked",
        }
    }

    pub(super) fn of_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|class| class.name() == name)
    }

    /// Returns whether this outcome is an error of the program.
    pub(super) fn is_wrong(self) -> bool {
        self > Self::Refused
    }
}

/// How one run ended.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) struct Outcome {
    pub(super) class: Class,
    /// Its time minus that of the run without a fault, in ns, if it passed.
    pub(super) later_ns: i64,
    /// Why it did not pass; empty if it did.
    pub(super) reason: String,
}

impl Outcome {
    pub(super) const fn new(class: Class, reason: String) -> Self {
        Self { class, later_ns: 0, reason }
    }

    /// Returns the outcome of a saved run, whose fields are type, faults, class, time and reason.
    pub(super) fn of_fields(fields: &[String]) -> Option<Self> {
        let [_, _, class, later_ns, reason] = fields else { return None };
        let (class, later_ns) = (Class::of_name(class)?, later_ns.parse().ok()?);
        Some(Self { class, later_ns, reason: reason.clone() })
    }
}

/// Counts of one type and one kind of fault, or of two kinds.
#[derive(Clone, Default, Debug)]
pub(super) struct Row {
    counts: [u64; Class::ALL.len()],
    /// Earliest and latest end of those that passed, in ns.
    pub(super) later_ns: [i64; 2],
}

impl Row {
    pub(super) fn of(&self, class: Class) -> u64 {
        self.counts.get(class as usize).copied().unwrap_or(0)
    }

    pub(super) fn runs(&self) -> u64 {
        self.counts.iter().sum()
    }
}

/// Runs that did not pass for the same reason.
#[derive(Clone, Debug)]
pub(super) struct Reason {
    pub(super) class: Class,
    /// The reason of the first one.
    pub(super) text: String,
    pub(super) runs: u64,
    pub(super) first: Job,
}

/// The index of a type, and the faults of a run: the index of the station and the kind of each.
pub(super) type RowKey = (usize, Vec<(usize, What)>);

/// The counts of an exploration.
#[derive(Clone, Default, Debug)]
pub(super) struct Classes {
    /// By type, and stations and kinds of faults.
    pub(super) rows: BTreeMap<RowKey, Row>,
    /// Worst class by type, station, direction and kind, for each frame.
    pub(super) frames: BTreeMap<(usize, usize, usize, What), BTreeMap<u64, Class>>,
    /// By reason without its digits: one reason differs from the next by its numbers.
    reasons: BTreeMap<(Class, String), Reason>,
}

impl Classes {
    pub(super) fn count(&mut self, job: &Job, outcome: &Outcome) {
        let Outcome { class, later_ns, reason } = outcome;
        let kinds = job.faults.iter().map(|fault| (fault.station, fault.what)).collect();
        let row = self.rows.entry((job.type_index, kinds)).or_default();
        if let Some(count) = row.counts.get_mut(*class as usize) {
            *count += 1;
        }
        let [earliest, latest] = &mut row.later_ns;
        (*earliest, *latest) = ((*earliest).min(*later_ns), (*latest).max(*later_ns));
        for fault in &job.faults {
            let line = (job.type_index, fault.station, fault.direction, fault.what);
            let frames = self.frames.entry(line).or_default();
            let worst = frames.entry(fault.frame).or_insert(*class);
            *worst = (*worst).max(*class);
        }
        if !reason.is_empty() {
            let kind = reason.chars().map(|letter| if letter.is_ascii_digit() { '#' } else { letter });
            let first = || Reason { class: *class, text: reason.clone(), runs: 0, first: job.clone() };
            self.reasons.entry((*class, kind.collect())).or_insert_with(first).runs += 1;
        }
    }

    /// Returns the reasons: those of wrong runs first, then the most frequent ones.
    pub(super) fn reasons(&self) -> Vec<&Reason> {
        let mut reasons: Vec<_> = self.reasons.values().collect();
        reasons.sort_by_key(|reason| std::cmp::Reverse((reason.class.is_wrong(), reason.runs)));
        reasons
    }

    /// Returns how many runs ended so.
    pub(super) fn of(&self, class: Class) -> u64 {
        self.rows.values().map(|row| row.of(class)).sum()
    }

    pub(super) fn runs(&self) -> u64 {
        self.rows.values().map(Row::runs).sum()
    }

    pub(super) fn wrong(&self) -> u64 {
        Class::ALL.into_iter().filter(|class| class.is_wrong()).map(|class| self.of(class)).sum()
    }
}
