//! The table of the comparison, and its verdict on our frames.

use std::fmt;

use node::screen;

use super::evenness::{Evenness, quantile};
use crate::records::ratio::{Ratio, RatioVerdict};

/// Largest deviation of the mean interval, in ppm.
const MEAN_PPM: f64 = 20.0;
/// Largest ratio of our 99th percentile to the bare loop's.
const OF_BARE: f64 = 1.2;
/// Largest ratio of our 99th percentile to a peer's.
const OF_PEER: f64 = 1.0;

/// Number of resamples of the turns.
const RESAMPLES: usize = 1_000;
/// Seed of the resamples.
const SEED: u64 = 1;

/// All contenders of one run. In pairs, T→O is first and O→T second.
#[derive(Clone, PartialEq, Debug)]
pub(super) struct Comparison {
    pub(super) bare: [Evenness; 2],
    pub(super) ours: [Evenness; 2],
    /// T→O of a foreign adapter.
    pub(super) peer: Option<Evenness>,
}

/// A limit, and whether it is kept.
struct Check {
    what: &'static str,
    figure: String,
    limit: f64,
    verdict: RatioVerdict,
}

impl Comparison {
    /// Returns whether the limit is certainly exceeded.
    pub(super) fn fails(&self) -> bool {
        self.checks().iter().any(|check| check.verdict == RatioVerdict::Beyond)
    }

    fn checks(&self) -> Vec<Check> {
        let [t_o, o_t] = &self.ours;
        let [bare_t_o, bare_o_t] = &self.bare;
        let mut checks = vec![
            mean("mean interval T→O, ppm off", t_o),
            mean("mean interval O→T, ppm off", o_t),
            ratio("p99 T→O by the bare loop's", t_o, bare_t_o, OF_BARE),
            ratio("p99 O→T by the bare loop's", o_t, bare_o_t, OF_BARE),
        ];
        checks.extend(self.peer.as_ref().map(|peer| ratio("p99 T→O by the peer's", t_o, peer, OF_PEER)));
        checks
    }
}

fn mean(what: &'static str, evenness: &Evenness) -> Check {
    let within = evenness.mean_ppm.abs() <= MEAN_PPM;
    let verdict = if within { RatioVerdict::Within } else { RatioVerdict::Beyond };
    Check { what, figure: format!("{:.1}", evenness.mean_ppm.abs()), limit: MEAN_PPM, verdict }
}

/// Returns the ratio of the 99th percentiles of all intervals. Whole turns are resampled, the same ones of both: a
/// stall of the host is in one turn, at the same time for both.
fn ratio(what: &'static str, ours: &Evenness, theirs: &Evenness, limit: f64) -> Check {
    let p99 = |turns: &[&Vec<f64>]| quantile(turns, 0.99).unwrap_or(f64::NAN);
    let turns: Vec<_> = ours.turns_us.iter().cloned().zip(theirs.turns_us.iter().cloned()).collect();
    match Ratio::of_pairs(&turns, RESAMPLES, SEED, p99) {
        Some(found) => {
            let Ratio { ratio, low, high } = found;
            let figure = format!("{ratio:.2} (95 %: {low:.2} to {high:.2})");
            Check { what, figure, limit, verdict: found.against(limit) }
        }
        None => {
            let figure = "too few frames".to_owned();
            Check { what, figure, limit, verdict: RatioVerdict::Inconclusive }
        }
    }
}

impl fmt::Display for Comparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut table = screen::ruled();
        table.set_header(["over 1 ms by, µs", "mean, ppm", "p50", "p99", "max", "missing"]);
        let [bare_t_o, bare_o_t] = &self.bare;
        let [t_o, o_t] = &self.ours;
        let rows = [
            ("bare loop T→O", Some(bare_t_o)),
            ("bare loop O→T", Some(bare_o_t)),
            ("ours T→O", Some(t_o)),
            ("ours O→T", Some(o_t)),
            ("peer T→O", self.peer.as_ref()),
        ];
        for (name, evenness) in rows {
            let Some(evenness) = evenness else { continue };
            let share =
                |share| evenness.quantile_us(share).map_or_else(|| "–".to_owned(), |us| format!("{us:.1}"));
            table.add_row([
                name.to_owned(),
                format!("{:+.2}", evenness.mean_ppm),
                share(0.5),
                share(0.99),
                share(1.0),
                evenness.missing.to_string(),
            ]);
        }
        writeln!(f, "{}\n", screen::drawn(&screen::numbers_right(table)))?;
        for Check { what, figure, limit, verdict } in self.checks() {
            let verdict = match verdict {
                RatioVerdict::Within => "pass",
                RatioVerdict::Beyond => "FAIL",
                RatioVerdict::Inconclusive => "inconclusive: more turns (--seconds) may tell",
            };
            writeln!(f, "{what}: {figure}, limit {limit}: {verdict}")?;
        }
        Ok(())
    }
}
