//! The results of a cell with several stations in formats of other programs.

use crate::cell_table;
use crate::export_text::{markdown_row, markdown_text, quoted, unfinished};
use crate::figures::rounded;
use plc_node::ExecutionType;
use records::cell_results::CellResults;
use records::schedule::repetitions;

const CSV_HEADER: &str = "setup,application,mode,seed,override,type,station,runs,failed,aet_ms,mad_ms,min_ms,max_ms,robot_aet_ms,\
    blends_suppressed,waiting_ms,zone_waiting_ms,start_skew_us,mark_skew_us,relative_pose_mm,aeti\n";

/// Formats a line per type and station, as the CSV of one robot. What is the same for all stations of a type is in every
/// line of it.
pub(super) fn csv(results: &CellResults) -> String {
    let mut text = String::from(CSV_HEADER);
    let number = |value: Option<f64>| value.map_or_else(String::new, |value| rounded(value, 3).to_string());
    for execution_type in ExecutionType::ALL {
        let Some(result) = results.results.get(execution_type) else { continue };
        let samples = || result.samples_ms.iter().copied();
        for (station, own) in results.stations.iter().zip(&result.stations) {
            let robot = &own.robot_samples_ms;
            let robot_aet_ms = (!robot.is_empty()).then(|| robot.iter().sum::<f64>() / robot.len() as f64);
            let fields = [
                quoted(&results.setup),
                quoted(&results.application),
                results.mode.clone(),
                results.seed.to_string(),
                quoted(results.overrides.as_deref().unwrap_or("100")),
                execution_type.to_string(),
                quoted(&station.name),
                result.samples_ms.len().to_string(),
                result.failed.len().to_string(),
                number(result.aet_ms),
                number(result.mad_ms),
                number(samples().reduce(f64::min)),
                number(samples().reduce(f64::max)),
                number(robot_aet_ms),
                own.blends_suppressed.iter().sum::<u32>().to_string(),
                number(own.mean_waiting_ms()),
                number(own.mean_zone_waiting_ms()),
                number(result.mean_start_skew_us()),
                number(result.worst_mark_skew_us()),
                number(result.worst_relative_pose_mm()),
                number(results.aet_improvement),
            ];
            text += &fields.join(",");
            text.push('\n');
        }
    }
    text
}

/// Formats a heading, the table of the screen and what stands below it.
pub(super) fn markdown(results: &CellResults) -> String {
    let CellResults { setup, title, application, mode, .. } = results;
    let about = format!(
        "{}, {}, {mode} mode, {}{}",
        markdown_text(application),
        repetitions(results.reps),
        markdown_text(&results.conditions(", ")),
        unfinished(results.status)
    );
    let header = cell_table::header(results);
    let alignments: Vec<_> =
        header.iter().enumerate().map(|(at, _)| if at == 0 { "---" } else { "---:" }).collect();
    let mut lines = vec![
        format!("### Setup {}: {}", markdown_text(setup), markdown_text(title)),
        String::new(),
        about,
        String::new(),
    ];
    lines.extend([markdown_row(&header), markdown_row(&alignments)]);
    lines.extend(cell_table::rows(results).iter().map(|row| markdown_row(row)));
    lines.push(String::new());
    lines.extend(cell_table::sentences(results).iter().map(|sentence| format!("- {sentence}")));
    lines.join("\n") + "\n"
}
