//! What a run says about the paper: how far its figures are from the published ones, which follow by construction, and
//! which of the paper's claims it supports.

use plc_node::ExecutionType;
use serde::Serialize;

use crate::figures::{rounded, signed};
use records::arms::Arms;
use records::calibrated::START_CYCLES;
use records::distance::{Distance, Estimate, REPRODUCED_WITHIN, distances};
use records::quality::MotionQuality;
use records::results::Results;

/// Returns the distances in sentences: first what the model does not reproduce, then the rest.
#[must_use]
pub fn distance_sentences(results: &Results) -> Vec<String> {
    let all = distances(results);
    let too_large = all.iter().filter(|distance| distance.is_too_large()).map(|distance| {
        format!(
            "Beyond {REPRODUCED_WITHIN:.0} standard errors of the paper: {} is {} ms, in the paper {} ms: {}.",
            name(distance),
            estimate(distance, distance.run),
            estimate(distance, distance.paper),
            in_errors(distance)
        )
    });
    let within: Vec<_> = all
        .iter()
        .filter(|distance| !distance.is_too_large())
        .map(|distance| format!("{}\u{a0}{}", name(distance), in_errors(distance)))
        .collect();
    let within = (!within.is_empty()).then(|| {
        format!("Within {REPRODUCED_WITHIN:.0} standard errors of the paper: {}.", within.join(", "))
    });
    too_large.chain(within).collect()
}

/// A row of the report's table of distances.
#[derive(Serialize)]
pub struct DistanceRow {
    figure: String,
    is_calibrated: bool,
    is_too_large: bool,
    paper: String,
    run: String,
    difference: String,
    errors: String,
}

/// Returns the distances as rows of a table, in ms and in standard errors.
#[must_use]
pub fn distance_rows(results: &Results) -> Vec<DistanceRow> {
    let row = |distance: &Distance| DistanceRow {
        figure: distance.figure.clone(),
        is_calibrated: distance.is_calibrated,
        is_too_large: distance.is_too_large(),
        paper: estimate(distance, distance.paper),
        run: estimate(distance, distance.run),
        difference: signed(distance.run.ms - distance.paper.ms),
        errors: in_errors(distance),
    };
    distances(results).iter().map(row).collect()
}

/// Names the figures that the model does not reproduce, for a sentence; `None` if there are no distances.
#[must_use]
pub fn not_reproduced(results: &Results) -> Option<String> {
    let all = distances(results);
    let names: Vec<_> = all
        .iter()
        .filter(|distance| distance.is_too_large())
        .map(|distance| distance.figure.as_str())
        .collect();
    (!all.is_empty()).then(|| match names[..] {
        [] => format!(
            "No figure of this run is more than {REPRODUCED_WITHIN:.0} standard errors from the paper's."
        ),
        _ => {
            format!("More than {REPRODUCED_WITHIN:.0} standard errors from the paper: {}.", names.join(", "))
        }
    })
}

fn name(distance: &Distance) -> String {
    let unbroken = distance.figure.replace(' ', "\u{a0}");
    format!("{unbroken}{}", if distance.is_calibrated { "*" } else { "" })
}

fn estimate(distance: &Distance, estimate: Estimate) -> String {
    let Estimate { ms, error_ms } = estimate;
    let is_difference = distance.figure.contains('−');
    let value = if is_difference { signed(ms) } else { format!("{ms:.1}") };
    format!("{value} ± {error_ms:.1}")
}

fn in_errors(distance: &Distance) -> String {
    signed(distance.in_errors())
}

/// Returns why CM's AET is RC's, for a run of the paper's cell; `None` for any other run.
#[must_use]
pub fn by_construction(results: &Results) -> Option<String> {
    let has = |execution_type| results.results.get(execution_type).is_some();
    if results.paper.is_none()
        || !results.has_modelled_robot()
        || !has(ExecutionType::Rc)
        || !has(ExecutionType::Cm)
    {
        return None;
    }
    let cycles = results.calibrated.iter().find(|calibrated| calibrated.key == START_CYCLES);
    let but_for = match cycles {
        Some(cycles) if cycles.value == 1.0 => {
            format!(", but for the one robot cycle of {START_CYCLES}")
        }
        Some(cycles) => format!(", but for the {} robot cycles of {START_CYCLES}", cycles.value),
        None => String::new(),
    };
    Some(format!(
        "CM's AET is RC's by construction{but_for}: the same motions by the same law, and one call each. The model \
         predicts only that the PLC sends them in time."
    ))
}

/// What a run of the paper's cell says about a claim of the paper.
#[derive(Serialize)]
pub struct Claim {
    /// The claim, in the paper's words.
    pub claim: &'static str,
    /// What the run says about it.
    pub verdict: PaperVerdict,
    /// The figures behind the verdict.
    pub figures: String,
}

/// What the figures of a run say about a claim; serialised as the report shows it.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize)]
pub enum PaperVerdict {
    /// They agree with it.
    #[serde(rename = "supports it")]
    Supported,
    /// The mean agrees with it, the peak does not.
    #[serde(rename = "supports it by the mean only")]
    ByTheMeanOnly,
    /// They do not agree with it.
    #[serde(rename = "does not support it")]
    NotSupported,
}

impl PaperVerdict {
    const fn of(is_supported: bool) -> Self {
        if is_supported { Self::Supported } else { Self::NotSupported }
    }
}

/// Returns the paper's claims that this run can check.
#[must_use]
pub fn claims(results: &Results) -> Vec<Claim> {
    if results.paper.is_none() {
        return Vec::new();
    }
    let quality = |execution_type| results.results.get(execution_type).and_then(|result| result.quality);
    let qualities = quality(ExecutionType::Sm).zip(quality(ExecutionType::Cm));
    let of_qualities = qualities.into_iter().flat_map(|(sm, cm)| [energy(&sm, &cm), stress(&sm, &cm)]);
    of_qualities.chain(results.arms.as_ref().map(kinematics)).collect()
}

fn energy(sm: &MotionQuality, cm: &MotionQuality) -> Claim {
    let [sm_ms, cm_ms] = [sm, cm].map(|quality| quality.energy_proxy_s * 1e3);
    Claim {
        claim: "Without stops the robot uses less energy.",
        verdict: PaperVerdict::of(cm_ms < sm_ms),
        figures: format!(
            "Energy proxy of CM {cm_ms:.0} ms, of SM {sm_ms:.0} ms. It knows neither friction nor what a drive feeds back."
        ),
    }
}

fn stress(sm: &MotionQuality, cm: &MotionQuality) -> Claim {
    // As they are shown, so that the verdict agrees with the figures beside it.
    let rms = |quality: &MotionQuality| rounded(quality.tool_jerk_mm_s3.rms / 1e3, 0);
    let peak = |quality: &MotionQuality| rounded(quality.tool_jerk_mm_s3.peak / 1e3, 0);
    let joint = |quality: &MotionQuality| rounded(quality.joint_jerk.rms * 1e2, 1);
    Claim {
        claim: "Without stops there is less mechanical stress.",
        verdict: match (rms(cm) < rms(sm) && joint(cm) < joint(sm), peak(cm) < peak(sm)) {
            (true, true) => PaperVerdict::Supported,
            (true, false) => PaperVerdict::ByTheMeanOnly,
            (false, _) => PaperVerdict::NotSupported,
        },
        figures: format!(
            "Jerk of the tool while it moves, root mean square: CM {:.0} m/s³, SM {:.0}; peak: CM {:.0}, SM {:.0}. Jerk of the \
             worst joint, root mean square: CM {:.1} % of rated, SM {:.1} %.",
            rms(cm),
            rms(sm),
            peak(cm),
            peak(sm),
            joint(cm),
            joint(sm)
        ),
    }
}

fn kinematics(arms: &Arms) -> Claim {
    let Arms { a_ms, b_ms, b_as_a_ms, a_as_b_ms } = arms;
    let shares = arms.shares();
    let [as_a, as_b] = shares.map(|share| format!("{:.0}\u{a0}%", share * 100.0).replace('-', "−"));
    Claim {
        claim: "The setups' AETs differ because of the kinematics of the robots.",
        verdict: PaperVerdict::of(shares.iter().all(|share| *share > 0.5)),
        figures: format!(
            "RC takes {a_ms:.0} ms on Setup A and {b_ms:.0} ms on Setup B. With A's programmed motions B's arm takes \
             {b_as_a_ms:.0} ms: {as_a} of the difference is left. With B's, A's arm takes {a_as_b_ms:.0} ms: {as_b} is left. \
             The rest is the programmed speed, which the paper does not state."
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use records::conditions::Measured;
    use records::mode::Mode;
    use records::paper::PaperComparison;
    use records::schedule::Schedule;
    use std::time::Duration;

    /// Returns a run of Setup B in which the samples of each type scatter by its MAD about its AET, in µs.
    fn run(figures: [(u64, u64); 3], repetitions: u32) -> Results {
        let (mut setup, found) = planning::setup_with_application("B").unwrap();
        let comparison = PaperComparison::of(&setup, &found.application, None, &[]);
        setup.robot.interpreter_quantum_us.from = setup::Provenance::Datasheet;
        let schedule = Schedule::new(&ExecutionType::ALL, repetitions, 7);
        let mut results =
            Results::new(&setup, "pick-and-place", Mode::Virtual, &schedule).with_paper(&setup, comparison);
        for (execution_type, (aet, mad)) in ExecutionType::ALL.into_iter().zip(figures) {
            for repetition in 0..repetitions {
                let micros = if repetition % 2 == 0 { aet - mad } else { aet + mad };
                results.record(execution_type, &Measured::lasting(Duration::from_micros(micros))).unwrap();
            }
        }
        results
    }

    #[test]
    fn a_figure_far_from_the_papers_is_named_with_its_distance_and_the_others_with_theirs() {
        let results = run([(7_617_000, 9_900), (8_971_000, 20_800), (7_617_000, 9_900)], 1_000);
        let sentences = distance_sentences(&results).join("\n").replace('\u{a0}', " ");
        insta::assert_snapshot!(sentences, @"
        Beyond 2 standard errors of the paper: CM MAD is 9.9 ± 0.2 ms, in the paper 15.3 ± 1.5 ms: −3.6.
        Within 2 standard errors of the paper: RC AET* +0.0, SM AET* +0.0, CM AET +0.0, RC MAD* +0.0, SM MAD +0.0, CM − RC +0.0.
        ");
        let few = run([(7_617_000, 9_900), (8_971_000, 20_800), (7_617_000, 9_900)], 4);
        assert_eq!(distance_sentences(&few), Vec::<String>::new(), "too few for an error");
    }

    #[test]
    fn claims_are_held_against_the_runs_own_figures() {
        let mut results = run([(7_617_000, 9_900), (8_971_000, 20_800), (7_617_000, 9_900)], 5);
        assert!(claims(&results).is_empty(), "without figures of the motion");
        let quality = |rms: f64, energy_proxy_s| MotionQuality {
            tool_jerk_mm_s3: records::quality::Load { peak: 600e3, rms },
            joint_jerk: records::quality::Load { peak: 0.5, rms: rms / 1e6 },
            energy_proxy_s,
            ..MotionQuality::default()
        };
        for (execution_type, rms, energy) in
            [(ExecutionType::Sm, 127e3, 0.275), (ExecutionType::Cm, 142e3, 0.253)]
        {
            results.results.entry(execution_type).as_mut().unwrap().quality = Some(quality(rms, energy));
        }
        results.arms = Some(Arms { a_ms: 3725.0, b_ms: 7617.0, b_as_a_ms: 4624.0, a_as_b_ms: 7700.0 });
        let told = |results: &Results| {
            let line = |claim: Claim| format!("{} {:?} {}", claim.claim, claim.verdict, claim.figures);
            claims(results).into_iter().map(line).collect::<Vec<_>>().join("\n").replace('\u{a0}', " ")
        };
        insta::assert_snapshot!(told(&results), @"
        Without stops the robot uses less energy. Supported Energy proxy of CM 253 ms, of SM 275 ms. It knows neither friction nor what a drive feeds back.
        Without stops there is less mechanical stress. NotSupported Jerk of the tool while it moves, root mean square: CM 142 m/s³, SM 127; peak: CM 600, SM 600. Jerk of the worst joint, root mean square: CM 14.2 % of rated, SM 12.7 %.
        The setups' AETs differ because of the kinematics of the robots. NotSupported RC takes 3725 ms on Setup A and 7617 ms on Setup B. With A's programmed motions B's arm takes 4624 ms: 23 % of the difference is left. With B's, A's arm takes 7700 ms: −2 % is left. The rest is the programmed speed, which the paper does not state.
        ");
        results.paper = None;
        assert_eq!(told(&results), "", "another cell says nothing about the paper");
    }

    #[test]
    fn stress_that_is_less_on_average_but_not_at_its_peak_supports_the_claim_by_the_mean_only() {
        let moving = |rms: f64, peak: f64| MotionQuality {
            tool_jerk_mm_s3: records::quality::Load { peak: peak * 1e3, rms: rms * 1e3 },
            joint_jerk: records::quality::Load { peak: 0.5, rms: rms / 1e3 },
            ..MotionQuality::default()
        };
        let sm = moving(97.0, 610.0);
        let verdict = |rms, peak| stress(&sm, &moving(rms, peak)).verdict;
        assert_eq!(verdict(92.0, 653.0), PaperVerdict::ByTheMeanOnly);
        assert_eq!(verdict(92.0, 609.9), PaperVerdict::ByTheMeanOnly, "shown as the same");
        assert_eq!(verdict(92.0, 600.0), PaperVerdict::Supported);
        assert_eq!(verdict(98.0, 600.0), PaperVerdict::NotSupported);
        let shown = serde_json::to_value(stress(&sm, &moving(92.0, 653.0))).unwrap();
        assert_eq!(shown["verdict"], "supports it by the mean only");
    }
}
