//! Findings of a capture, for people and as JSON.

use std::time::Duration;

use machine::Lateness;
use plc_node::ExecutionType;
use records::counted::counted;
use records::origin::MeasuredPeer;
use records::results::PerType;
use records::statistics::AetMad;
use serde::Serialize;

use crate::address::EndAddress;
use crate::content::ImageDirection;
use crate::flow::{Flow, FrameCounts};
use crate::repetition::{Repetitions, TypeTraits};
use crate::station::WatchedRobot;
use crate::traffic::{PacketCounts, Traffic};
use crate::unmeasurable::Unmeasurable;

/// Version of the format of [`Findings`] as JSON.
pub const FINDINGS_VERSION: u32 = 1;

/// All that a capture shows of a PLC and a robot. Times are by the clock of the capture.
#[derive(Clone, PartialEq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Findings {
    /// Version of this format.
    pub schema_version: u32,
    /// The bus that carries the cyclic frames.
    pub bus: String,
    /// The PLC.
    pub plc: MeasuredPeer,
    /// The robot.
    pub robot: MeasuredPeer,
    /// Source of the directions: `connection`, its start, or `content`.
    pub directions_by: &'static str,
    /// Time from the first packet to the last one.
    pub duration_ms: f64,
    /// Packets of any kind.
    pub packets: u64,
    /// Frames from the PLC.
    pub commands: DirectionFindings,
    /// Frames from the robot.
    pub feedbacks: DirectionFindings,
    /// Results of each type; types without a repetition are absent.
    pub results: PerType<TypeFindings>,
    /// Skills that ended with `DONE`.
    pub skills_done: u64,
    /// Skills that a halt or a cancel ended.
    pub skills_aborted: u64,
    /// Skills that ended with an error, or were refused.
    pub skills_failed: u64,
    /// Skills whose end is not in the capture.
    pub skills_unfinished: u64,
    /// Remarkable things, as sentences.
    pub remarks: Vec<String>,
}

/// Frames of one direction.
#[derive(Clone, PartialEq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct DirectionFindings {
    /// Frames, each once.
    pub frames: u64,
    /// Frames that the capture has twice or more often, as many mirror ports make them.
    pub doubled: u64,
    /// Frames that the counters skip: not captured, or not sent.
    pub missing: u64,
    /// Frames after a later one.
    pub disordered: u64,
    /// Images with a wrong check.
    pub altered: u64,
    /// Time from frame to frame that was agreed, in ms.
    pub cycle_ms: f64,
    /// Intervals between frames, in ms: mean, shortest, median, 99 %, longest.
    pub interval_ms: [f64; 5],
    /// Lateness of frames in ms: median, 99 %, largest.
    pub late_ms: [f64; 3],
}

/// Results of one type.
#[derive(Clone, PartialEq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct TypeFindings {
    /// Mean of the execution times, in ms; null without repetitions.
    pub aet_ms: Option<f64>,
    /// Mean absolute deviation from the mean, in ms; null without repetitions.
    pub mad_ms: Option<f64>,
    /// The repetitions, in order.
    pub repetitions: Vec<RepetitionFindings>,
    /// Errors of failed repetitions, each with the number of repetitions before it.
    pub failed: Vec<(u32, String)>,
    /// Repetitions that were left before their end, or that the capture has only in part.
    pub incomplete: u32,
    /// Time from a skill's command to the first feedback with its number.
    pub to_feedback: Option<Reaction>,
    /// Time from a skill's command to the first feedback in which the arm moves.
    pub to_motion: Option<Reaction>,
    /// Most slots with a motion that was still to be executed.
    pub slots_used: u32,
    /// Feedbacks of a robot that had executed all motions written, and had others to come.
    pub starved_feedbacks: u32,
}

/// A repetition.
#[derive(Clone, Copy, PartialEq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct RepetitionFindings {
    /// Time from the first packet to its command, in ms.
    pub begin_ms: f64,
    /// Time from its first command to its last feedback, in ms.
    pub execution_ms: f64,
    /// The robot's own measure, in ms.
    pub robot_execution_ms: f64,
    /// Motions that ended in a stop because the next motion did not arrive in time.
    pub blends_suppressed: u32,
    /// Largest error of the execution time, from the intervals between frames at start and end, in ms.
    pub uncertainty_ms: f64,
}

/// Reaction times in ms, over all skills of the type.
#[derive(Clone, Copy, PartialEq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Reaction {
    /// Median.
    pub median_ms: f64,
    /// 99 %.
    pub p99_ms: f64,
    /// Longest.
    pub max_ms: f64,
}

fn millis(nanos: u64) -> f64 {
    nanos as f64 / 1e6
}

fn quantile(lateness: &Lateness, quantile: f64) -> f64 {
    lateness.quantile(quantile).as_secs_f64() * 1e3
}

fn longest(lateness: &Lateness) -> f64 {
    lateness.max().as_secs_f64() * 1e3
}

impl Reaction {
    fn of(times: &Lateness) -> Option<Self> {
        let [median_ms, p99_ms] = [0.5, 0.99].map(|share| quantile(times, share));
        (times.runs() > 0).then(|| Self { median_ms, p99_ms, max_ms: longest(times) })
    }
}

/// Returns the findings of a station whose capture has ended.
pub(crate) fn of_station(
    traffic: &Traffic,
    station: &WatchedRobot,
    duration_ns: u64,
) -> Result<Findings, Unmeasurable> {
    let Some(plc) = station.plcs.first().copied() else {
        return Err(Unmeasurable::NoImage { frames: traffic.counts.cyclic });
    };
    let [altered_commands, altered_feedbacks] = station.altered();
    let flows = |direction: ImageDirection| {
        let is_of = move |flow: &&Flow| {
            let robot = if direction == ImageDirection::Command { flow.key.to } else { flow.key.from };
            flow.direction() == Some(direction) && robot == station.robot && flow.key.bus == station.bus
        };
        traffic.flows.values().filter(is_of)
    };
    let (commands, feedbacks) = (flows(ImageDirection::Command), flows(ImageDirection::Feedback));
    let connections = commands.clone().count();
    let is_agreed = commands.clone().chain(feedbacks.clone()).all(Flow::is_agreed);
    let mut results = PerType::default();
    for execution_type in ExecutionType::ALL {
        *results.entry(execution_type) = of_type(&station.repetitions, execution_type);
    }
    let findings = Findings {
        schema_version: FINDINGS_VERSION,
        bus: station.bus.to_string(),
        plc: peer(traffic, ImageDirection::Command, plc),
        robot: peer(traffic, ImageDirection::Feedback, station.robot),
        directions_by: if is_agreed { "connection" } else { "content" },
        duration_ms: millis(duration_ns),
        packets: traffic.counts.packets,
        commands: direction(commands, altered_commands),
        feedbacks: direction(feedbacks, altered_feedbacks),
        skills_done: station.skills.done,
        skills_aborted: station.skills.aborted,
        skills_failed: station.skills.failed,
        skills_unfinished: station.skills.unfinished,
        results,
        remarks: remarks(traffic, station, connections),
    };
    let is_some = |one| findings.results.get(one).is_some_and(|of_type| !of_type.repetitions.is_empty());
    if ExecutionType::ALL.into_iter().any(is_some) {
        return Ok(findings);
    }
    let mut found = vec![format!("{} done", counted(findings.skills_done, "skill"))];
    found.extend(findings.remarks);
    Err(Unmeasurable::NoRepetition(found.join("; ")))
}

fn peer(traffic: &Traffic, direction: ImageDirection, address: EndAddress) -> MeasuredPeer {
    let traits = traffic.relations.traits_of(direction, address);
    let mac = traffic.macs.get(&address).copied().or(traits.mac);
    let seen = traffic.seen.traits_of(address, mac, traits.identity);
    MeasuredPeer {
        address: Some(address.to_string()),
        mac: mac.map(|mac| mac.to_string()),
        name: traits.name.filter(|name| !name.is_empty()).or(seen.name),
        identity: seen.identity,
    }
}

/// Returns the frames of all connections of a direction; intervals and lateness are those of the longest one.
fn direction<'a>(flows: impl Iterator<Item = &'a Flow> + Clone, altered: u64) -> DirectionFindings {
    let mut counts = FrameCounts::default();
    flows.clone().for_each(|flow| counts.add(flow.counts()));
    let pace =
        flows.max_by_key(|flow| flow.counts().frames).map(|flow| flow.pace().clone()).unwrap_or_default();
    let (intervals, lateness) = (pace.intervals(), pace.lateness());
    DirectionFindings {
        frames: counts.frames,
        doubled: counts.doubled,
        missing: counts.missing,
        disordered: counts.disordered,
        altered,
        cycle_ms: millis(pace.cycle_ns()),
        interval_ms: [
            pace.mean_ns().unwrap_or_default() / 1e6,
            millis(pace.shortest_ns().unwrap_or_default()),
            quantile(intervals, 0.5),
            quantile(intervals, 0.99),
            longest(intervals),
        ],
        late_ms: [quantile(lateness, 0.5), quantile(lateness, 0.99), longest(lateness)],
    }
}

fn of_type(repetitions: &Repetitions, execution_type: ExecutionType) -> Option<TypeFindings> {
    let finished = repetitions.finished.iter().filter(|one| one.execution_type == execution_type);
    let of_type = repetitions.failed.iter().filter(|one| one.execution_type == execution_type);
    let figure = AetMad::of(finished.clone().map(|one| Duration::from_nanos(one.time_ns)));
    let TypeTraits { seen, moved, slots_used, starved, incomplete, .. } =
        repetitions.traits.get(execution_type).cloned().unwrap_or_default();
    let failed = of_type.map(|failed| {
        let before = finished.clone().filter(|one| one.commanded_ns < failed.commanded_ns).count();
        (u32::try_from(before).unwrap_or(u32::MAX), failed.error.clone())
    });
    let found = TypeFindings {
        aet_ms: figure.map(|figure| figure.aet_ms),
        mad_ms: figure.map(|figure| figure.mad_ms),
        failed: failed.collect(),
        repetitions: finished
            .map(|one| RepetitionFindings {
                begin_ms: millis(one.commanded_ns),
                execution_ms: millis(one.time_ns),
                robot_execution_ms: millis(one.robot_ns),
                blends_suppressed: one.blends_suppressed,
                uncertainty_ms: millis(one.uncertainty_ns),
            })
            .collect(),
        incomplete,
        to_feedback: Reaction::of(&seen),
        to_motion: Reaction::of(&moved),
        slots_used,
        starved_feedbacks: starved,
    };
    (!found.repetitions.is_empty() || !found.failed.is_empty() || found.incomplete > 0).then_some(found)
}

fn remarks(traffic: &Traffic, station: &WatchedRobot, connections: usize) -> Vec<String> {
    let PacketCounts { cut, backwards, not_followed, .. } = traffic.counts;
    let repetitions = &station.repetitions;
    let mut remarks = Vec::new();
    let mut add = |is_so: bool, text: String| {
        if is_so {
            remarks.push(text);
        }
    };
    let under_way = station.watch.under_way();
    add(under_way > 0, "a skill was under way when the capture began".to_owned());
    for execution_type in ExecutionType::ALL {
        let incomplete = repetitions.traits.get(execution_type).map_or(0, |traits| traits.incomplete);
        let name = execution_type.to_string().to_uppercase();
        let unanswered = repetitions.traits.get(execution_type).map_or(0, |traits| traits.unanswered);
        add(
            unanswered > 0,
            format!(
                "{} of {name} end with the feedback: the PLC leaves EXECUTE set after it",
                counted(unanswered, "repetition")
            ),
        );
        add(
            incomplete > 0,
            format!("{} of {name} not complete in the capture", counted(incomplete, "repetition")),
        );
    }
    if let Some(total) = repetitions.other_total {
        let total = counted(total, "motion");
        add(
            true,
            format!(
                "a MoveContinuous has {total}, the plan has not: choose its application by --application"
            ),
        );
    }
    let others = repetitions.other_motions;
    let has_sm = repetitions.finished.iter().any(|one| one.execution_type == ExecutionType::Sm);
    let hint = if has_sm { "" } else { "; --application chooses another plan" };
    let motions = counted(others, "single motion");
    add(others > 0, format!("{motions} not in the plan, such as a move to the start{hint}"));
    add(
        repetitions.not_kept > 0,
        format!("{} beyond 100,000 not kept", counted(repetitions.not_kept, "repetition")),
    );
    add(connections > 1, format!("the PLC connected {connections} times"));
    add(
        cut > 0,
        format!("{} cut by the snapshot length: capture whole frames", counted(cut, "cyclic frame")),
    );
    add(
        backwards > 0,
        format!(
            "{} earlier than the one before: two clocks, or joined captures",
            counted(backwards, "packet")
        ),
    );
    add(
        not_followed > 0,
        format!("{} of further connections not read", counted(not_followed, "cyclic frame")),
    );
    let unknown = traffic.flows.values().filter(|flow| flow.is_unknown()).count();
    add(unknown > 0, format!("{} without the process image", counted(unknown, "cyclic connection")));
    remarks
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `INSTA_UPDATE=always` writes it again, as for snapshots.
    #[test]
    fn the_committed_schema_matches_the_findings() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../schemas/findings.schema.json");
        let schema = serde_json::to_string_pretty(&schemars::schema_for!(Findings)).unwrap() + "\n";
        if std::env::var("INSTA_UPDATE").is_ok_and(|update| update == "always") {
            std::fs::write(path, &schema).unwrap();
        }
        assert!(
            std::fs::read_to_string(path).unwrap_or_default() == schema,
            "the findings changed: count FINDINGS_VERSION up where a reader breaks, then INSTA_UPDATE=always cargo test -p tap"
        );
    }
}
