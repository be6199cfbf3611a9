//! The tables of the comparison, and its verdicts on our frames.

use node::screen;

use super::evenness::{Evenness, quantile};
use records::ratio::{Ratio, RatioVerdict};

/// Largest deviation of the mean interval, in ppm.
const MEAN_PPM: f64 = 20.0;
/// Largest ratio to the bare loop's figure.
const OF_BARE: f64 = 1.2;
/// Largest ratio of our 99th percentile to a peer's.
const OF_PEER: f64 = 1.0;

/// Number of resamples of the turns.
const RESAMPLES: usize = 1_000;
/// Seed of the resamples.
const SEED: u64 = 1;

/// Both ends of a contender.
#[derive(Clone, PartialEq, Debug)]
pub(super) struct Ends {
    /// Frames from the robot's end.
    pub(super) to_plc: Evenness,
    /// Frames from the PLC's end.
    pub(super) to_robot: Evenness,
    /// Time on the way there and back in µs; a list per turn.
    pub(super) round_trips_us: Vec<Vec<f64>>,
}

/// One bus beside the bare loop in its turns.
#[derive(Clone, PartialEq, Debug)]
pub(super) struct Comparison {
    pub(super) bus: &'static str,
    pub(super) bare: Ends,
    pub(super) ours: Ends,
    /// Time until a number is back in µs, with the wait for the robot's next frame; a list per turn.
    pub(super) reactions_us: Vec<Vec<f64>>,
    /// Frames from a foreign adapter.
    pub(super) peer: Option<Evenness>,
}

/// A limit, and whether it is kept.
struct RatioCheck {
    what: &'static str,
    figure: String,
    limit: f64,
    verdict: RatioVerdict,
}

impl Comparison {
    /// Returns whether a limit is certainly exceeded.
    pub(super) fn fails(&self) -> bool {
        self.checks().iter().any(|check| check.verdict == RatioVerdict::Beyond)
    }

    fn checks(&self) -> Vec<RatioCheck> {
        let Self { ours, bare, .. } = self;
        let p99 = |what, ours: &Evenness, theirs: &Evenness, limit| {
            ratio(what, 0.99, &ours.turns_us, &theirs.turns_us, limit)
        };
        let mut checks = vec![
            mean("mean interval to PLC, ppm off", &ours.to_plc),
            mean("mean interval to robot, ppm off", &ours.to_robot),
            p99("p99 lateness to PLC, by bare", &ours.to_plc, &bare.to_plc, OF_BARE),
            p99("p99 lateness to robot, by bare", &ours.to_robot, &bare.to_robot, OF_BARE),
            ratio("round trip, by raw frames'", 0.5, &ours.round_trips_us, &bare.round_trips_us, OF_BARE),
        ];
        let of_peer = |peer| p99("p99 lateness to PLC, by peer's", &ours.to_plc, peer, OF_PEER);
        checks.extend(self.peer.as_ref().map(of_peer));
        checks
    }
}

fn mean(what: &'static str, evenness: &Evenness) -> RatioCheck {
    let within = evenness.mean_ppm.abs() <= MEAN_PPM;
    let verdict = if within { RatioVerdict::Within } else { RatioVerdict::Beyond };
    RatioCheck { what, figure: format!("{:.1}", evenness.mean_ppm.abs()), limit: MEAN_PPM, verdict }
}

/// Returns the ratio of a quantile of all figures. Whole turns are resampled, the same ones of both: a stall of the
/// host is in one turn, at the same time for both.
fn ratio(what: &'static str, share: f64, ours: &[Vec<f64>], theirs: &[Vec<f64>], limit: f64) -> RatioCheck {
    let quantile = |turns: &[&Vec<f64>]| quantile(turns, share).unwrap_or(f64::NAN);
    let turns: Vec<_> = ours.iter().cloned().zip(theirs.iter().cloned()).collect();
    match Ratio::of_pairs(&turns, RESAMPLES, SEED, quantile) {
        Some(found) if found.ratio.is_finite() => {
            let Ratio { ratio, low, high } = found;
            let figure = format!("{ratio:.2} ({low:.2} to {high:.2})");
            RatioCheck { what, figure, limit, verdict: found.against(limit) }
        }
        _ => {
            let figure = "too few frames".to_owned();
            RatioCheck { what, figure, limit, verdict: RatioVerdict::Inconclusive }
        }
    }
}

/// Returns all tables.
pub(super) fn render(comparisons: &[Comparison]) -> String {
    let note = "Lateness: by how much an interval between frames was longer than 1 ms. Round trip: time of the two frames \
                that bring a number to the robot and back; reaction: the same with the wait for the robot's next frame. \
                A bare frame is sent by a loop that does nothing else, in the same second. In brackets: 95 % interval.";
    [lateness(comparisons), round_trips(comparisons), verdicts(comparisons), screen::wrapped(note, 0, 0)]
        .join("\n\n")
}

fn figure(turns: &[Vec<f64>], share: f64) -> String {
    let turns: Vec<_> = turns.iter().collect();
    quantile(&turns, share).map_or_else(|| "–".to_owned(), |us| format!("{us:.1}"))
}

fn lateness(comparisons: &[Comparison]) -> String {
    let mut table = screen::ruled();
    table.set_header(["lateness, µs", "to", "from", "mean, ppm", "p50", "p99", "max", "missing"]);
    for Comparison { bus, bare, ours, peer, .. } in comparisons {
        let rows = [
            ("PLC", "bare", Some(&bare.to_plc)),
            ("PLC", "ours", Some(&ours.to_plc)),
            ("PLC", "peer", peer.as_ref()),
            ("robot", "bare", Some(&bare.to_robot)),
            ("robot", "ours", Some(&ours.to_robot)),
        ];
        for (to, from, evenness) in rows {
            let Some(evenness) = evenness else { continue };
            let [p50, p99, max] = [0.5, 0.99, 1.0].map(|share| figure(&evenness.turns_us, share));
            let mean = format!("{:+.2}", evenness.mean_ppm).replace('-', "−");
            let missing = evenness.missing.to_string();
            table.add_row([(*bus).to_owned(), to.to_owned(), from.to_owned(), mean, p50, p99, max, missing]);
        }
    }
    screen::drawn(&screen::numbers_right(table))
}

fn round_trips(comparisons: &[Comparison]) -> String {
    let mut table = screen::ruled();
    table.set_header([
        "round trip, µs",
        "raw\np50",
        "ours\np50",
        "raw\np99",
        "ours\np99",
        "reaction\np50",
        "p99",
    ]);
    for Comparison { bus, bare, ours, reactions_us, .. } in comparisons {
        let [raw, own] = [&bare.round_trips_us, &ours.round_trips_us];
        let figures =
            [(raw, 0.5), (own, 0.5), (raw, 0.99), (own, 0.99), (reactions_us, 0.5), (reactions_us, 0.99)];
        let figures = figures.map(|(turns, share)| figure(turns, share));
        table.add_row(std::iter::once((*bus).to_owned()).chain(figures));
    }
    screen::drawn(&screen::numbers_right(table))
}

fn verdicts(comparisons: &[Comparison]) -> String {
    let mut table = screen::ruled();
    table.set_header(["bus", "figure", "found", "limit", "verdict"]);
    for comparison in comparisons {
        for RatioCheck { what, figure, limit, verdict } in comparison.checks() {
            let verdict = match verdict {
                RatioVerdict::Within => "pass",
                RatioVerdict::Beyond => "FAIL",
                RatioVerdict::Inconclusive => "more --seconds may tell",
            };
            table.add_row([
                comparison.bus.to_owned(),
                what.to_owned(),
                figure,
                limit.to_string(),
                verdict.to_owned(),
            ]);
        }
    }
    screen::drawn(&table)
}
