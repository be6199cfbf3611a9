//! The result of a run in two sentences, which claim no more than the confidence intervals allow.

use plc_node::ExecutionType;

use super::first_look::{differences, range, signed_range};
use records::interval::{FEWEST, Mean};
use records::ratio::Ratio;
use records::results::Results;
use records::schedule::repetitions;

/// Means of the three types, in ms.
#[derive(Clone, Copy)]
struct Means {
    rc: f64,
    sm: f64,
    cm: f64,
}

/// Returns the sentences; `None` if a type has no sample.
pub(super) fn sentences(results: &Results) -> Option<String> {
    let mean = |execution_type| Some(results.figure(execution_type)?.aet_ms);
    let [rc, sm, cm] = ExecutionType::ALL.map(mean);
    let means = Means { rc: rc?, sm: sm?, cm: cm? };
    let samples =
        |execution_type| results.results.get(execution_type).map_or(&[][..], |result| &result.samples_ms[..]);
    let fewest = ExecutionType::ALL.into_iter().map(|execution_type| samples(execution_type).len()).min()?;
    if fewest < FEWEST {
        return Some(without_intervals(means, fewest));
    }
    let published = results.improvement().paper.map(|share| share * 100.0);
    let ratio = Ratio::of(samples(ExecutionType::Cm), samples(ExecutionType::Sm), results.seed)?;
    let (_, difference) = *differences(results).first()?;
    Some(format!("{} {}", against_single_skills(ratio, published), against_program(difference, means.rc)))
}

fn without_intervals(Means { rc, sm, cm }: Means, fewest: usize) -> String {
    let than = |other: f64| {
        format!(
            "{:.1}\u{a0}% {}",
            ((cm - other) / other * 100.0).abs(),
            if cm < other { "less" } else { "more" }
        )
    };
    format!(
        "By the means, CM takes {} time than SM and {} than RC. {} of each type are too few for confidence intervals: it \
         takes {FEWEST}.",
        than(sm),
        than(rc),
        repetitions(fewest as u32)
    )
}

/// Returns what the ratio of CM and SM shows; `published` is the share in percent that the paper's CM saves.
fn against_single_skills(Ratio { ratio, low, high }: Ratio, published: Option<f64>) -> String {
    let percent = |ratio: f64| (1.0 - ratio) * 100.0;
    let (least, most) = (percent(high), percent(low));
    let published = published.map(|share| format!("; published: {share:.0}\u{a0}%")).unwrap_or_default();
    if (low..=high).contains(&1.0) {
        return format!(
            "This run shows no difference between CM and SM: CM saves {}\u{a0}% of SM's time (95\u{a0}% interval{published}).",
            range((least, most))
        );
    }
    let (way, ends) = if least > 0.0 { ("less", (least, most)) } else { ("more", (-most, -least)) };
    format!(
        "CM takes {:.1}\u{a0}% {way} time than SM (95\u{a0}% interval {}\u{a0}%{published}).",
        percent(ratio).abs(),
        range(ends)
    )
}

/// Returns what the difference of CM and RC shows.
fn against_program(difference: Mean, rc_ms: f64) -> String {
    let (low, high) = difference.interval_ms();
    if low <= 0.0 && high >= 0.0 {
        return format!(
            "Between CM and RC it shows no difference: CM\u{a0}−\u{a0}RC is {}\u{a0}ms.",
            signed_range((low, high))
        );
    }
    let (way, ends) = if low > 0.0 { ("longer", (low, high)) } else { ("less", (-high, -low)) };
    format!(
        "CM takes {:.1}\u{a0}ms ({:.2}\u{a0}%) {way} than RC (95\u{a0}% interval {}\u{a0}ms).",
        difference.ms.abs(),
        (difference.ms / rc_ms * 100.0).abs(),
        range(ends)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mean(samples: &[f64]) -> Mean {
        Mean::of(samples).unwrap()
    }

    #[test]
    fn a_difference_that_its_interval_does_not_show_is_not_claimed() {
        let (near, far) = ([1.0, 2.0, 3.0, 4.0, 5.0], [11.0, 12.0, 13.0, 14.0, 15.0]);
        let plain = |text: String| text.replace('\u{a0}', " ");
        let same = plain(against_program(mean(&near).less(mean(&[2.0, 3.0, 4.0, 5.0, 6.0])), 100.0));
        assert_eq!(same, "Between CM and RC it shows no difference: CM − RC is −3.3 to +1.3 ms.");
        let more = plain(against_program(mean(&far).less(mean(&near)), 100.0));
        assert_eq!(more, "CM takes 10.0 ms (10.00 %) longer than RC (95 % interval 7.7 to 12.3 ms).");
        let less = plain(against_program(mean(&near).less(mean(&far)), 100.0));
        assert_eq!(less, "CM takes 10.0 ms (10.00 %) less than RC (95 % interval 7.7 to 12.3 ms).");
        let ratio = |ratio, low, high| plain(against_single_skills(Ratio { ratio, low, high }, Some(42.4)));
        assert_eq!(
            ratio(0.6, 0.55, 0.65),
            "CM takes 40.0 % less time than SM (95 % interval 35.0 to 45.0 %; published: 42 %)."
        );
        assert_eq!(
            ratio(1.2, 1.1, 1.3),
            "CM takes 20.0 % more time than SM (95 % interval 10.0 to 30.0 %; published: 42 %)."
        );
        assert_eq!(
            ratio(0.99, 0.95, 1.03),
            "This run shows no difference between CM and SM: CM saves −3.0 to 5.0 % of SM's time (95 % interval; published: 42 %)."
        );
    }

    #[test]
    fn a_few_repetitions_claim_no_interval() {
        let told = without_intervals(Means { rc: 100.0, sm: 200.0, cm: 101.0 }, 2).replace('\u{a0}', " ");
        assert_eq!(
            told,
            "By the means, CM takes 49.5 % less time than SM and 1.0 % more than RC. 2 repetitions of each type are too few \
             for confidence intervals: it takes 5."
        );
    }
}
