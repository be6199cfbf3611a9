//! The counts of a life or of all lives, and the line of a life in the file of the jobs.

use std::time::Duration;

use records::counted::counted;

use crate::engine::lines::field;

/// Names of the columns of a life.
pub(super) const HEAD: &str = "life,seed,plant_ns,passed,refused,altered,reason,difference";

/// Counts of one cell, or of all.
#[derive(Clone, Default, PartialEq, Debug)]
pub(super) struct Counts {
    pub(super) plant: Duration,
    pub(super) passed: u64,
    /// Repetitions that failed with a reason, and the first reason.
    pub(super) refused: u64,
    pub(super) reason: Option<String>,
    /// Repetitions that ended, but differ from the plan, and the first difference.
    pub(super) altered: u64,
    pub(super) difference: Option<String>,
    /// An interrupt ended the life before its time.
    pub(super) is_cut: bool,
}

impl Counts {
    /// Counts a repetition that differs from the plan.
    pub(super) fn differ(&mut self, seed: u64, error: &anyhow::Error) {
        self.altered += 1;
        self.difference.get_or_insert_with(|| format!("seed {seed}: {error:#}"));
    }

    /// Counts a repetition that failed with a reason.
    pub(super) fn refuse(&mut self, seed: u64, error: &anyhow::Error) {
        self.refused += 1;
        self.reason.get_or_insert_with(|| format!("seed {seed}: {error:#}"));
    }

    pub(super) fn add(&mut self, other: Self) {
        self.plant += other.plant;
        self.passed += other.passed;
        self.refused += other.refused;
        self.altered += other.altered;
        self.reason = self.reason.take().or(other.reason);
        self.difference = self.difference.take().or(other.difference);
    }

    pub(super) fn summary(&self, lives: u64, host: Duration) -> String {
        let Self { plant, passed, refused, reason, altered, difference, .. } = self;
        let hours = plant.as_secs_f64() / 3_600.0;
        let first =
            |text: &Option<String>| text.as_ref().map_or_else(String::new, |text| format!(" ({text})"));
        let lives = if lives == 1 { "1 life".to_owned() } else { format!("{lives} lives") };
        let were = if *refused == 1 { "was" } else { "were" };
        format!(
            "{hours:.1} hours of the plant in {lives}, {:.0} s here: {} passed, {refused} {were} refused{}, {altered} altered{}.",
            host.as_secs_f64(),
            counted(*passed, "repetition"),
            first(reason),
            first(difference)
        )
    }

    /// Returns the line of a whole life without its number; `None` for one that was cut.
    pub(super) fn line(&self, seed: u64) -> Option<String> {
        let Self { plant, passed, refused, altered, reason, difference, is_cut } = self;
        let [reason, difference] =
            [reason, difference].map(|text| field(text.as_deref().unwrap_or_default()));
        let nanos = plant.as_nanos();
        (!is_cut).then(|| format!("{seed},{nanos},{passed},{refused},{altered},{reason},{difference}"))
    }

    /// Returns the counts of a saved life.
    pub(super) fn of_fields(fields: &[String]) -> Option<Self> {
        let [_, nanos, passed, refused, altered, reason, difference] = fields else { return None };
        let count = |field: &String| field.parse().ok();
        let text = |field: &String| (!field.is_empty()).then(|| field.clone());
        Some(Self {
            plant: Duration::from_nanos(count(nanos)?),
            passed: count(passed)?,
            refused: count(refused)?,
            reason: text(reason),
            altered: count(altered)?,
            difference: text(difference),
            is_cut: false,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::lines::fields;

    #[test]
    fn one_is_counted_as_one() {
        let counts = Counts { passed: 1, refused: 1, altered: 0, ..Counts::default() };
        insta::assert_snapshot!(counts.summary(1, Duration::ZERO), @"0.0 hours of the plant in 1 life, 0 s here: 1 repetition passed, 1 was refused, 0 altered.");
        insta::assert_snapshot!(Counts::default().summary(2, Duration::ZERO), @"0.0 hours of the plant in 2 lives, 0 s here: 0 repetitions passed, 0 were refused, 0 altered.");
    }

    #[test]
    fn the_counts_of_a_life_are_read_back_from_its_line_and_a_cut_one_has_none() {
        let mut life =
            Counts { plant: Duration::from_millis(60_004), passed: 12, refused: 2, ..Counts::default() };
        life.reason = Some("seed 7: no \"frame\", and no answer".to_owned());
        let line = life.line(7).unwrap();
        insta::assert_snapshot!(line, @r#"7,60004000000,12,2,0,"seed 7: no ""frame"", and no answer","#);
        assert_eq!(HEAD.split(',').count(), 1 + fields(&line).len());
        assert_eq!(Counts::of_fields(&fields(&line)), Some(life.clone()));
        assert_eq!(Counts::of_fields(&fields(&line)[1..]), None);
        assert_eq!(Counts { is_cut: true, ..life }.line(7), None);
    }
}
