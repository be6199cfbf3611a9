//! The final table: measured figures next to the paper's, with calibrated ones marked.

use node::screen;
use plc_node::ExecutionType;

use crate::figures::{self, CALIBRATED, Figures};
use crate::quality;
use crate::verdicts;
use records::calibrated::figure;
use records::counted::counted;
use records::disturbances::Images;
use records::lateness::CycleLateness;
use records::origin::OriginKind;
use records::results::{Allocations, Frames, Results};
use records::schedule::repetitions;

/// Largest number of disturbed repetitions that are named.
const HELD_UP_SHOWN: usize = 5;

/// Formats the whole report for the screen.
#[must_use]
pub fn render(results: &Results) -> String {
    let title = format!("Setup {}: {}", results.setup, results.title);
    let about = format!(
        "{}, {}, {}, {}",
        results.application,
        repetitions(results.reps),
        results.mode_in_words(),
        results.conditions(", ")
    );
    let mut text = format!("{}\n{}\n\n", screen::wrapped(&title, 0, 2), screen::wrapped(&about, 0, 2));
    text.push_str(&figures(results));
    text.push_str("\n\n");
    text.push_str(&legend(results));
    if let Some(table) = quality::table(results) {
        text.push_str("\n\n");
        text.push_str(&table);
    }
    text
}

/// Formats AET and MAD of all types as a table.
#[must_use]
pub fn figures(results: &Results) -> String {
    let figures = Figures::of(results);
    let mut table = screen::ruled();
    table.set_header(figures.header());
    table.add_rows(figures.plain_rows());
    screen::drawn(&screen::numbers_right(table))
}

fn legend(results: &Results) -> String {
    let mut lines = Vec::new();
    let marked: Vec<_> = figures::marked(results).collect();
    if !marked.is_empty() {
        let meaning = format!("{CALIBRATED} calibrated on the paper's figure beside it, so no prediction:");
        lines.push(screen::wrapped(&meaning, 0, 2));
        for calibrated in marked {
            let met = figure(&calibrated.key, &results.calibrated);
            let line = format!("{} = {} from {met}", calibrated.key, calibrated.value);
            lines.push(screen::wrapped(&line, 4, 6));
        }
    }
    lines.extend(sentences(results).iter().map(|sentence| screen::wrapped(sentence, 2, 2)));
    lines.join("\n")
}

/// Returns what the figures mean and under which conditions they were measured.
pub(super) fn sentences(results: &Results) -> Vec<String> {
    let mut sentences = Vec::new();
    if let Some(reason) = &results.no_paper {
        sentences.push(format!("No columns of the paper: {reason}."));
    }
    sentences.extend(verdicts::by_construction(results));
    sentences.extend(verdicts::distance_sentences(results));
    if results.without_skill_overhead.is_some() {
        let whence = if results.mode == "real" { ", from a virtual run" } else { "" };
        sentences.push(format!(
            "h = 0: a skill call costs nothing but its motion and the cycles it waits for{whence}."
        ));
    }
    if let Some(attached) = &results.attached {
        sentences.push(format!("Measured on nodes that ran already: {attached}."));
    }
    sentences.extend(results.origin.as_ref().map(|origin| format!("{origin}.")));
    sentences.extend(not_verified(results));
    sentences.extend(conditions(results));
    sentences
}

/// Returns what was remarkable about the connection, as sentences.
pub(super) fn connection_remarks(results: &Results) -> impl Iterator<Item = String> {
    results.connection_remarks.iter().map(|remark| format!("Connection: {remark}."))
}

/// Returns what was not verified of the repetitions, as sentences.
pub(super) fn not_verified(results: &Results) -> impl Iterator<Item = String> {
    results.not_verified.iter().map(|what| format!("Not verified: {what}."))
}

/// Returns sentences on the nodes, the host and the bus: lateness, lost frames, disturbed repetitions.
fn conditions(results: &Results) -> Vec<String> {
    let mut sentences = Vec::new();
    let suppressed = results.blends_suppressed();
    if suppressed > 0 {
        sentences.push(format!(
            "{suppressed} blends became stops, because the next motion was not there in time."
        ));
    }
    if results.mode == "real" {
        let (plc, robot) = (lateness(&results.cycle.plc), lateness(&results.cycle.robot));
        sentences.push(format!("Cycles late by p50 / p99 / max: PLC {plc}; robot {robot}."));
    }
    if let Some(after) = results.connected_after_ms {
        let allocations =
            results.cyclic_allocations.map_or_else(String::new, |Allocations { plc, robot }| {
                format!("; allocations in the cyclic threads since: PLC {plc}, robot {robot}")
            });
        sentences.push(format!("Connected {after:.0} ms after the start of the nodes{allocations}."));
    }
    sentences.extend(connection_remarks(results));
    sentences.extend(has_counted_frames(results).then(|| cyclic_frames(&results.bus)));
    sentences.extend(images(&results.images));
    sentences.extend(held_up(results));
    if results.repeated > 0 {
        sentences.push(format!(
            "Repetitions run again, because the host stopped a node until the connection was lost: {}.",
            results.repeated
        ));
    }
    sentences.extend(results.faults.as_ref().map(ToString::to_string));
    sentences.extend(results.incomplete.iter().cloned());
    sentences
}

/// Returns whether anybody counted the frames of a run: a PLC whose samples were imported did not.
pub(super) fn has_counted_frames(results: &Results) -> bool {
    results.origin.as_ref().is_none_or(|origin| origin.kind == OriginKind::Capture)
}

/// Returns how many frames passed. The two directions have counts of their own: each node sends by its own clock.
pub(super) fn cyclic_frames(bus: &Frames) -> String {
    let Frames { frames_sent, frames_received, skipped, lost, foreign } = *bus;
    let mut text = format!(
        "Cyclic frames of the PLC: {frames_sent} sent to the robot, {frames_received} received from it; lost in both directions: {lost}"
    );
    if skipped > 0 {
        text += &format!("; {} skipped by a node that its host delayed", counted(skipped, "cycle"));
    }
    if foreign > 0 {
        text += &format!("; {} of another connection ignored", counted(foreign, "frame"));
    }
    text + "."
}

/// Returns which images were altered on the way or old, and whose images nothing protects against an alteration.
fn images(images: &Images) -> Option<String> {
    let Images { plc_altered, robot_altered, plc_unchecked, robot_unchecked, plc_outdated, robot_outdated } =
        *images;
    let mut sentences = Vec::new();
    if plc_altered + robot_altered > 0 {
        sentences.push(format!(
            "Images altered on the way, and refused by their check: {plc_altered} to the robot, {robot_altered} to the PLC."
        ));
    }
    if plc_outdated + robot_outdated > 0 {
        sentences.push(format!(
            "Old images, refused by their life counter: {plc_outdated} to the robot, {robot_outdated} to the PLC."
        ));
    }
    for (whose, unchecked) in [("PLC", plc_unchecked), ("robot", robot_unchecked)] {
        if unchecked > 0 {
            sentences.push(format!(
                "No check was given in {unchecked} images of the {whose}: an altered byte in these would not show."
            ));
        }
    }
    (!sentences.is_empty()).then(|| sentences.join(" "))
}

/// Returns which repetitions the host disturbed, and the figures without them.
fn held_up(results: &Results) -> Option<String> {
    let mut named = Vec::new();
    let mut without = Vec::new();
    for execution_type in ExecutionType::ALL {
        let Some(result) = results.results.get(execution_type) else { continue };
        let (held_up, good): (Vec<_>, Vec<_>) =
            (1..).zip(&result.missed_cycles).partition(|(_, missed)| missed.held_up);
        named.extend(held_up.iter().map(|(repetition, missed)| {
            format!("{execution_type} {repetition} (PLC {}, robot {} cycles)", missed.plc, missed.robot)
        }));
        let good: Vec<_> = good.iter().filter_map(|(at, _)| result.samples_ms.get(at - 1).copied()).collect();
        if !held_up.is_empty() && !good.is_empty() {
            let mean_ms = good.iter().sum::<f64>() / good.len() as f64;
            without.push(format!("{execution_type} {mean_ms:.1} ms over {}", good.len()));
        }
    }
    if named.is_empty() {
        return None;
    }
    let more = named.len().saturating_sub(HELD_UP_SHOWN);
    named.truncate(HELD_UP_SHOWN);
    let more = if more > 0 { format!(", and {more} more") } else { String::new() };
    let without = if without.is_empty() {
        String::new()
    } else {
        format!(" AET without these: {}.", without.join(", "))
    };
    Some(format!(
        "The host let a node miss more than 1 % of its cycles, so that these repetitions measure the host as well: {}{more}.{without}",
        named.join(", ")
    ))
}

fn lateness(cycle: &CycleLateness) -> String {
    if cycle.buckets.is_empty() && cycle.max_us == 0.0 {
        // The robot is real hardware, or a node that the bench is not attached to.
        return "not reported".to_owned();
    }
    let CycleLateness { p50_us, p99_us, max_us, missed, .. } = cycle;
    format!("{p50_us:.0} / {p99_us:.0} / {max_us:.0} µs, {missed} missed")
}

#[cfg(test)]
mod tests {
    use super::*;
    use records::conditions::Measured;
    use records::mode::Mode;
    use records::paper::PaperComparison;
    use records::schedule::Schedule;
    use setup::Provenance;
    use std::time::Duration;

    fn results(mode: Mode, types: &[ExecutionType]) -> Results {
        let (mut setup, found) = planning::setup_with_application("A").unwrap();
        let comparison = PaperComparison::of(&setup, &found.application, None, &[]);
        let cycle = setup::Sourced { from: Provenance::Calibrated, ..setup.robot.cycle_us.varied(1) };
        setup.robot.continuous_start_cycles = Some(cycle);
        let mut results = Results::new(&setup, "pick-and-place", mode, &Schedule::new(types, 2, 7))
            .with_paper(&setup, comparison);
        for calibrated in &mut results.calibrated {
            calibrated.value = 1.0;
        }
        results
    }

    fn run(micros: u64) -> Measured {
        let execution = Duration::from_micros(micros);
        Measured::lasting(execution)
    }

    #[test]
    fn figures_are_next_to_the_papers_and_the_calibrated_ones_are_marked() {
        let mut results = results(Mode::Virtual, &ExecutionType::ALL);
        for (execution_type, micros) in
            [(ExecutionType::Rc, 3_725_500), (ExecutionType::Sm, 6_480_000), (ExecutionType::Cm, 3_730_000)]
        {
            results.record(execution_type, &run(micros - 3_000)).unwrap();
            results.record(execution_type, &run(micros + 3_000)).unwrap();
        }
        let mut without = results.clone();
        without.record(ExecutionType::Sm, &run(4_900_000)).unwrap();
        results.without_skill_overhead = Some(without.as_without_overhead());
        insta::assert_snapshot!(render(&results), @"
        Setup A: Siemens S7-1517, PROFINET, KUKA KR 6 R500 (SCARA)
        pick-and-place, 2 repetitions, virtual mode, seed 7, positions = set-points

        ──────────────────────────────────────────────────────────────────────────────────────────────
         ms         AET    MAD   n   AET, h = 0   MAD, h = 0   paper AET   paper MAD      AET − paper
        ──────────────────────────────────────────────────────────────────────────────────────────────
         RC     3725.5*   3.0*   2       3725.5          3.0        3725         3.6   +0.5 (+0.01 %)
         SM     6480.0*   3.0*   2       5953.3        702.2        6477        11.3   +3.0 (+0.05 %)
         CM     3730.0*   3.0    2       3730.0          3.0        3729         3.3   +1.0 (+0.03 %)
         AETi   42.4 %*                  37.3 %                     42 %
        ──────────────────────────────────────────────────────────────────────────────────────────────

        * calibrated on the paper's figure beside it, so no prediction:
            motions.velocity_percent = 1 from RC's AET
            robot.skill_overhead_us = 1 from SM's AET
            robot.continuous_start_cycles = 1 from CM's AET minus RC's AET
            robot.interpreter_quantum_us = 1 from the MADs of RC and SM
          CM's AET is RC's by construction, but for the one robot cycle of robot.continuous_start_cycles:
          the same motions by the same law, and one call each. The model predicts only that the PLC sends
          them in time.
          h = 0: a skill call costs nothing but its motion and the cycles it waits for.
          Cyclic frames of the PLC: 0 sent to the robot, 0 received from it; lost in both directions: 0.
        ");
    }

    #[test]
    fn a_copy_with_another_speed_has_no_columns_of_the_paper_and_says_why_in_one_line() {
        let (mut setup, found) = planning::setup_with_application("A").unwrap();
        setup.motions.velocity_percent.value = 50.0;
        let comparison = PaperComparison::of(&setup, &found.application, None, &[]);
        let schedule = Schedule::new(&[ExecutionType::Rc], 2, 7);
        let table = render(
            &Results::new(&setup, "pick-and-place", Mode::Virtual, &schedule).with_paper(&setup, comparison),
        );
        assert!(!table.contains("3725") && !table.contains("calibrated"), "{table}");
        let line = table.lines().find(|line| line.contains("paper")).unwrap();
        assert!(
            line.starts_with("  No columns of the paper: motions.velocity_percent is 50.0 and in"),
            "{line}"
        );
    }

    #[test]
    fn the_two_directions_of_the_bus_have_counts_of_their_own_and_frames_of_others_are_named() {
        let bus = Frames { frames_sent: 100, frames_received: 102, ..Frames::default() };
        assert_eq!(
            cyclic_frames(&bus),
            "Cyclic frames of the PLC: 100 sent to the robot, 102 received from it; lost in both directions: 0."
        );
        let disturbed = cyclic_frames(&Frames { skipped: 2, lost: 1, foreign: 1, ..bus });
        assert!(disturbed.ends_with(
            "lost in both directions: 1; 2 cycles skipped by a node that its host delayed; 1 frame of another connection ignored."
        ), "{disturbed}");
    }

    #[test]
    fn repetitions_that_were_run_again_are_reported() {
        let told = |repeated| {
            let table = render(&Results { repeated, ..results(Mode::Real, &[ExecutionType::Rc]) });
            table.lines().find(|line| line.contains("again")).map(str::to_owned)
        };
        assert_eq!(told(0), None);
        insta::assert_snapshot!(told(2).unwrap(), @"  Repetitions run again, because the host stopped a node until the connection was lost: 2.");
    }

    #[test]
    fn a_type_that_was_not_requested_has_no_row_and_one_without_samples_has_no_figure() {
        insta::assert_snapshot!(render(&results(Mode::Real, &[ExecutionType::Rc])), @"
        Setup A: Siemens S7-1517, PROFINET, KUKA KR 6 R500 (SCARA)
        pick-and-place, 2 repetitions, real mode, seed 7, positions = set-points

        ────────────────────────────────────────────────────────────
         ms     AET   MAD   n   paper AET   paper MAD   AET − paper
        ────────────────────────────────────────────────────────────
         RC       –     –   0        3725         3.6             –
         AETi     –                  42 %
        ────────────────────────────────────────────────────────────

          Cycles late by p50 / p99 / max: PLC not reported; robot not reported.
          Cyclic frames of the PLC: 0 sent to the robot, 0 received from it; lost in both directions: 0.
        ");
    }
}
