//! The final table: measured figures next to the paper's, with calibrated ones marked.

use comfy_table::Cell;
use plc_node::ExecutionType;

use crate::output::progress::label;
use crate::output::quality;
use crate::output::screen::{self, drawn, styled};
use crate::output::verdicts;
use crate::records::calibrated::{SKILL_OVERHEAD, figure};
use crate::records::lateness::CycleLateness;
use crate::records::results::{Allocations, PaperFigure, Results};
use crate::records::schedule::repetitions;

/// Mark of a figure that a number of the setup was calibrated to.
const CALIBRATED: &str = "*";

/// Formats the whole report for the screen.
#[must_use]
pub fn render(results: &Results) -> String {
    let mut text = format!(
        "Setup {}: {}\n{}, {}, {} mode, {}\n\n",
        results.setup,
        results.title,
        results.application,
        repetitions(results.reps),
        results.mode,
        results.seed_and_override(", ")
    );
    text.push_str(&figures(results));
    text.push_str("\n\n");
    text.push_str(&legend(results));
    if let Some(table) = quality::table(results) {
        text.push_str("\n\n");
        text.push_str(&table);
    }
    text
}

fn figures(results: &Results) -> String {
    let mut table = styled();
    let mut header = vec!["ms", "AET", "MAD", "n"];
    let has_without = results.without_skill_overhead.is_some();
    if has_without {
        header.extend(["AET, h = 0", "MAD, h = 0"]);
    }
    if results.paper.is_some() {
        header.extend(["paper AET", "paper MAD", "AET − paper"]);
    }
    table.set_header(header);
    for execution_type in ExecutionType::ALL {
        let Some(result) = results.results.get(execution_type) else { continue };
        let found = results.figure(execution_type);
        let mark = |is_calibrated| if is_calibrated { CALIBRATED } else { " " };
        let aet_mark = mark(results.is_aet_calibrated(execution_type));
        let mad_mark = mark(results.is_mad_calibrated(execution_type));
        let mut row = vec![
            label(execution_type),
            found.map_or_else(none, |found| format!("{}{}", millis(found.aet_ms), aet_mark)),
            found.map_or_else(none, |found| format!("{}{}", millis(found.mad_ms), mad_mark)),
            result.samples_ms.len().to_string(),
        ];
        if let Some(without) = &results.without_skill_overhead {
            let figure = without.results.get(execution_type);
            row.push(figure.map_or_else(none, |figure| millis(figure.aet_ms)));
            row.push(figure.map_or_else(none, |figure| millis(figure.mad_ms)));
        }
        if let Some(paper) = &results.paper {
            let paper = paper.get(execution_type);
            row.push(paper.map_or_else(none, |paper| format!("{:.0}", paper.aet_ms)));
            row.push(paper.map_or_else(none, |paper| millis(paper.mad_ms)));
            row.push(found.zip(paper.copied()).map_or_else(none, deviation));
        }
        table.add_row(row);
    }
    table.add_row(improvement(results, has_without));
    drawn(table)
}

fn improvement(results: &Results, has_without: bool) -> Vec<Cell> {
    let percent = |share: Option<f64>, digits: usize| {
        Cell::new(share.map_or_else(none, |share| format!("{:.*} %", digits, share * 100.0)))
    };
    let mark = if results.is_calibrated(SKILL_OVERHEAD) { CALIBRATED } else { " " };
    let own = results.aet_improvement.map_or_else(none, |share| format!("{:.1} %{mark}", share * 100.0));
    let mut row = vec![Cell::new("AETi"), Cell::new(own), Cell::new(""), Cell::new("")];
    if has_without {
        let without = results.without_skill_overhead.as_ref().and_then(|without| without.aet_improvement);
        row.extend([percent(without, 1), Cell::new("")]);
    }
    if let Some(paper) = &results.paper {
        let paper = paper.sm.zip(paper.cm);
        let share = paper.map(|(sm, cm)| crate::records::statistics::aet_improvement(sm.aet_ms, cm.aet_ms));
        row.extend([percent(share, 0), Cell::new(""), Cell::new("")]);
    }
    row
}

fn legend(results: &Results) -> String {
    let mut lines = Vec::new();
    if !results.calibrated.is_empty() {
        lines.push(format!("{CALIBRATED} calibrated on the paper's figure beside it, so no prediction:"));
        for calibrated in &results.calibrated {
            let met = figure(&calibrated.key, &results.calibrated);
            lines.push(format!("    {} = {} from {met}", calibrated.key, calibrated.value));
        }
    }
    if let Some(reason) = &results.no_paper {
        lines.push(screen::sentences([format!("No columns of the paper: {reason}.").as_str()]));
    }
    if let Some(sentence) = verdicts::by_construction(results) {
        lines.push(screen::sentences([sentence.as_str()]));
    }
    let distances = verdicts::distance_sentences(results);
    if !distances.is_empty() {
        lines.push(screen::sentences(distances.iter().map(String::as_str)));
    }
    if results.without_skill_overhead.is_some() {
        let whence = if results.mode == "real" { ", from a virtual run" } else { "" };
        lines.push(format!(
            "  h = 0: a skill call costs nothing but its motion and the cycles it waits for{whence}."
        ));
    }
    if let Some(attached) = &results.attached {
        lines.push(screen::sentences([format!("Measured on nodes that ran already: {attached}.").as_str()]));
    }
    let suppressed: u32 = ExecutionType::ALL
        .iter()
        .filter_map(|execution_type| results.results.get(*execution_type))
        .flat_map(|result| &result.blends_suppressed)
        .sum();
    if suppressed > 0 {
        lines.push(format!(
            "  {suppressed} blends became stops, because the next motion was not there in time."
        ));
    }
    if results.mode == "real" {
        let (plc, robot) = (lateness(&results.cycle.plc), lateness(&results.cycle.robot));
        lines.push(format!("  Cycles late by p50 / p99 / max: PLC {plc}; robot {robot}."));
    }
    if let Some(after) = results.connected_after_ms {
        let allocations =
            results.cyclic_allocations.map_or_else(String::new, |Allocations { plc, robot }| {
                format!("; allocations in the cyclic threads since: PLC {plc}, robot {robot}")
            });
        lines.push(format!("  Connected {after:.0} ms after the start of the nodes{allocations}."));
    }
    let bus = results.bus;
    let mut frames = format!(
        "  Cyclic frames: {} sent, {} received, {} lost",
        bus.frames_sent, bus.frames_received, bus.lost
    );
    if bus.skipped > 0 {
        frames += &format!("; {} cycles skipped by a node that its host held up", bus.skipped);
    }
    lines.push(frames + ".");
    if results.repeated > 0 {
        lines.push(format!(
            "  Repetitions run again, because the host held a node up until the connection was lost: {}.",
            results.repeated
        ));
    }
    if let Some(faults) = &results.faults {
        lines.push(format!("  {faults}"));
    }
    lines.join("\n")
}

fn lateness(cycle: &CycleLateness) -> String {
    if cycle.buckets.is_empty() && cycle.max_us == 0.0 {
        // The robot is real hardware, or a node that the bench is not attached to.
        return "not reported".to_owned();
    }
    let CycleLateness { p50_us, p99_us, max_us, missed, .. } = cycle;
    format!("{p50_us:.0} / {p99_us:.0} / {max_us:.0} µs, {missed} missed")
}

fn millis(value: f64) -> String {
    format!("{value:.1}")
}

fn none() -> String {
    "–".to_owned()
}

fn deviation((found, paper): (PaperFigure, PaperFigure)) -> String {
    let difference = found.aet_ms - paper.aet_ms;
    format!("{difference:+.1} ({:+.2} %)", difference / paper.aet_ms * 100.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::records::conditions::Measured;
    use crate::records::mode::Mode;
    use crate::records::paper::Standing;
    use crate::records::schedule::Schedule;
    use setup::Provenance;
    use std::time::Duration;

    fn results(mode: Mode, types: &[ExecutionType]) -> Results {
        let (mut setup, found) = planning::setup_with_application("A").unwrap();
        let standing = Standing::of(&setup, &found.application, None, &[]);
        let cycle = setup::Sourced { from: Provenance::Calibrated, ..setup.robot.cycle_us.varied(1) };
        setup.robot.continuous_start_cycles = Some(cycle);
        let mut results = Results::new(&setup, "pick-and-place", mode, &Schedule::new(types, 2, 7))
            .beside_the_paper(&setup, standing);
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
        pick-and-place, 2 repetitions, virtual mode, seed 7

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
            robot.continuous_start_cycles = 1 from CM's AET less RC's
            robot.interpreter_quantum_us = 1 from the MADs of RC and SM
          CM's AET is RC's by construction, but for the one robot cycle of robot.continuous_start_cycles:
          the same motions by the same law, and one call each. The model predicts only that the PLC sends
          them in time.
          h = 0: a skill call costs nothing but its motion and the cycles it waits for.
          Cyclic frames: 0 sent, 0 received, 0 lost.
        ");
    }

    #[test]
    fn a_copy_with_another_speed_has_no_columns_of_the_paper_and_says_why_in_one_line() {
        let (mut setup, found) = planning::setup_with_application("A").unwrap();
        setup.motions.velocity_percent.value = 50.0;
        let standing = Standing::of(&setup, &found.application, None, &[]);
        let schedule = Schedule::new(&[ExecutionType::Rc], 2, 7);
        let table = render(
            &Results::new(&setup, "pick-and-place", Mode::Virtual, &schedule)
                .beside_the_paper(&setup, standing),
        );
        assert!(!table.contains("3725") && !table.contains("calibrated"), "{table}");
        let line = table.lines().find(|line| line.contains("paper")).unwrap();
        assert!(
            line.starts_with("  No columns of the paper: motions.velocity_percent is 50.0 and in"),
            "{line}"
        );
    }

    #[test]
    fn repetitions_that_were_run_again_are_reported() {
        let told = |repeated| {
            let table = render(&Results { repeated, ..results(Mode::Real, &[ExecutionType::Rc]) });
            table.lines().find(|line| line.contains("again")).map(str::to_owned)
        };
        assert_eq!(told(0), None);
        insta::assert_snapshot!(told(2).unwrap(), @"  Repetitions run again, because the host held a node up until the connection was lost: 2.");
    }

    #[test]
    fn a_type_that_was_not_requested_has_no_row_and_one_without_samples_has_no_figure() {
        insta::assert_snapshot!(render(&results(Mode::Real, &[ExecutionType::Rc])), @"
        Setup A: Siemens S7-1517, PROFINET, KUKA KR 6 R500 (SCARA)
        pick-and-place, 2 repetitions, real mode, seed 7

        ────────────────────────────────────────────────────────────
         ms     AET   MAD   n   paper AET   paper MAD   AET − paper
        ────────────────────────────────────────────────────────────
         RC       –     –   0        3725         3.6             –
         AETi     –                  42 %
        ────────────────────────────────────────────────────────────

        * calibrated on the paper's figure beside it, so no prediction:
            motions.velocity_percent = 1 from RC's AET
            robot.skill_overhead_us = 1 from SM's AET
            robot.continuous_start_cycles = 1 from CM's AET less RC's
            robot.interpreter_quantum_us = 1 from the MADs of RC and SM
          Cycles late by p50 / p99 / max: PLC not reported; robot not reported.
          Cyclic frames: 0 sent, 0 received, 0 lost.
        ");
    }
}
