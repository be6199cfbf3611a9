//! `bench from-capture`: measures a PLC and a robot of any make from a capture of their frames.

use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use anyhow::{Context, anyhow};
use capture_file::reader::{CaptureError, CaptureReader, ETHERNET};
use clap::Args;
use plc_node::ExecutionType;
use tap::{CaptureObserver, DirectionFindings, EndAddress, ExpectedRun, Findings, TapConfig, TypeFindings};

use crate::verbs::measured_elsewhere::{MeasuredElsewhere, file_name};
use records::counted::counted;
use records::exit::{Exit, Failure};
use records::occupied;
use records::origin::{MeasuredTime, MeasuredType, OriginKind, SampleOrigin};
use records::results::{Frames, PerType, Results};
use records::run_directory::{Durability, replace};
use studies::outputs::{self, Own};
use studies::setup_option::SetupOption;

/// Bytes that are read at once.
const BUFFER: usize = 1 << 20;

/// Options of a measurement from a capture.
#[derive(Args, Debug)]
pub struct FromCaptureOptions {
    /// The capture, as pcap or pcapng, of both directions between PLC and robot.
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// The setup that was measured.
    #[command(flatten)]
    pub setup: SetupOption,
    /// The application that was run, instead of the setup's: a built-in one's name, or the path of a .toml file.
    #[arg(long, value_name = "NAME|PATH")]
    pub application: Option<String>,
    /// The robot to measure if the capture has several, by the IP or MAC address that its cyclic frames have.
    #[arg(long, value_name = "ADDRESS")]
    pub robot: Option<EndAddress>,
    /// Write all that was found to this file as well.
    #[arg(long, value_name = "FILE")]
    pub export_json: Option<PathBuf>,
    /// The run's directory, new or without a run [default: below runs/, by time and setup].
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}

/// Contents of a capture file besides what the observer took of it.
#[derive(Debug, Default)]
struct FileRemarks {
    /// Time of the first packet, in ns since 1970.
    began_ns: Option<u64>,
    /// Packets of interfaces that are not Ethernet.
    other_links: u64,
    /// Packets without a time.
    untimed: u64,
    /// Cut or damage of the file.
    broken: Option<CaptureError>,
}

/// Reads the capture, saves the run and prints its figures.
///
/// # Errors
///
/// The capture or the setup cannot be read, nothing can be measured, or the run cannot be saved. Then nothing is written.
pub fn run(options: &FromCaptureOptions) -> Result<Exit, Failure> {
    let (setup, found) = options.setup.load_with(options.application.as_deref())?;
    let plan = found.plan(&setup)?;
    let read = [
        ("the capture", Some(options.file.as_path())),
        ("the setup", options.setup.file()),
        ("the application", found.path.as_deref()),
    ];
    let own = Own { directory: options.out.as_deref(), files: occupied::RUN.results };
    outputs::check(&[("--export-json", options.export_json.as_deref())], &read, own)?;
    let config = TapConfig {
        expected: ExpectedRun::of(&plan, &setup),
        cycle: Duration::from_micros(setup.bus.cycle_us.value.into()),
        robot: options.robot,
    };
    let usage = |error: anyhow::Error| Failure::new(Exit::Usage, error);
    let (mut findings, remarks) = observe(&options.file, config).map_err(usage)?;
    findings.remarks.extend(remarks.sentences());
    let types = measured(&findings);
    let origin = SampleOrigin {
        kind: OriginKind::Capture,
        file: file_name(&options.file),
        bus: Some(findings.bus.clone()),
        plc: findings.plc.clone(),
        robot: findings.robot.clone(),
    };
    let began =
        remarks.began_ns.map_or_else(SystemTime::now, |nanos| UNIX_EPOCH + Duration::from_nanos(nanos));
    let measured = MeasuredElsewhere { setup: &setup, found: &found, origin, types: &types, began };
    let results = Results {
        bus: Frames {
            frames_sent: findings.commands.frames,
            frames_received: findings.feedbacks.frames,
            lost: findings.commands.missing + findings.feedbacks.missing,
            ..Frames::default()
        },
        connection_remarks: sentences(&findings),
        ..measured.results()
    };
    let exit = measured.save(options.out.as_deref(), results)?;
    if let Some(path) = &options.export_json {
        replace(path, outputs::json(&findings)?, Durability::Written)?;
    }
    Ok(exit)
}

/// Reads a capture to its end. One that is cut or damaged is measured up to there.
fn observe(path: &Path, config: TapConfig) -> anyhow::Result<(Findings, FileRemarks)> {
    let shown = path.display();
    let file = setup::open_plain_file(path).with_context(|| format!("cannot read {shown}"))?;
    let reader = CaptureReader::new(BufReader::with_capacity(BUFFER, file));
    let mut reader = reader.map_err(|error| anyhow!("{shown}: {error}"))?;
    let mut observer = CaptureObserver::new(config);
    let mut remarks = FileRemarks::default();
    loop {
        match reader.next_packet() {
            Ok(Some(packet)) if packet.link_type == ETHERNET => {
                remarks.began_ns.get_or_insert(packet.nanos);
                observer.handle_packet(packet.nanos, packet.data, packet.is_cut());
            }
            Ok(Some(_)) => remarks.other_links += 1,
            Ok(None) => break,
            Err(CaptureError::Io(error)) => {
                return Err(error).with_context(|| format!("cannot read {shown}"));
            }
            Err(broken) => remarks.broken = Some(broken),
        }
    }
    remarks.untimed = reader.untimed();
    match observer.finish() {
        Ok(findings) => Ok((findings, remarks)),
        Err(error) => {
            let of_file = remarks.sentences().into_iter().map(|remark| format!("; {remark}"));
            Err(anyhow!("{shown}: {error}{}", of_file.collect::<String>()))
        }
    }
}

impl FileRemarks {
    fn sentences(&self) -> Vec<String> {
        let mut sentences = Vec::new();
        if self.other_links > 0 {
            let packets = counted(self.other_links, "packet");
            sentences
                .push(format!("{packets} not from Ethernet: capture on the interface itself, not on `any`"));
        }
        if self.untimed > 0 {
            sentences.push(format!("{} without a time left out", counted(self.untimed, "packet")));
        }
        sentences
            .extend(self.broken.as_ref().map(|broken| format!("{broken}; what comes before is measured")));
        sentences
    }
}

/// Returns the repetitions in order, failed ones among them.
fn measured(findings: &Findings) -> PerType<MeasuredType> {
    let mut types = PerType::default();
    for execution_type in ExecutionType::ALL {
        let Some(of_type) = findings.results.get(execution_type) else { continue };
        let mut failed = of_type.failed.iter().peekable();
        let mut repetitions = Vec::new();
        for (number, one) in (0..).zip(&of_type.repetitions) {
            while let Some((_, error)) = failed.next_if(|(before, _)| *before <= number) {
                repetitions.push(Err(error.clone()));
            }
            repetitions.push(Ok(MeasuredTime {
                execution_ms: one.execution_ms,
                robot_execution_ms: Some(one.robot_execution_ms),
                blends_suppressed: Some(one.blends_suppressed),
            }));
        }
        repetitions.extend(failed.map(|(_, error)| Err(error.clone())));
        if !repetitions.is_empty() {
            *types.entry(execution_type) = Some(MeasuredType { repetitions });
        }
    }
    types
}

/// Returns what was found besides the execution times, as parts of sentences.
fn sentences(findings: &Findings) -> Vec<String> {
    let by = match findings.directions_by {
        "connection" => "directions and images found by the start of the connection",
        _ => "directions and images found by content: the start of the connection is not in the capture",
    };
    let Findings { packets, duration_ms, .. } = findings;
    let mut sentences = vec![
        format!("{packets} packets in {:.3} s; {by}", duration_ms / 1e3),
        direction("commands", &findings.commands),
        direction("feedbacks", &findings.feedbacks),
    ];
    let of_type = |one: ExecutionType| Some(reactions(one, findings.results.get(one)?));
    sentences.extend(ExecutionType::ALL.into_iter().filter_map(of_type));
    sentences.push(format!(
        "skills done {}, aborted {}, failed {}, without an end {}",
        findings.skills_done, findings.skills_aborted, findings.skills_failed, findings.skills_unfinished
    ));
    sentences.extend(findings.remarks.iter().cloned());
    sentences
}

fn direction(name: &str, direction: &DirectionFindings) -> String {
    let DirectionFindings { frames, doubled, missing, disordered, altered, cycle_ms, .. } = direction;
    let [mean, shortest, median, p99, longest] = direction.interval_ms;
    let [late, late_99, latest] = direction.late_ms;
    format!(
        "{name}: {frames} frames, {doubled} doubled, {missing} missing, {disordered} out of order, {altered} altered; every \
         {cycle_ms:.3} ms, intervals {mean:.3} ms on average ({shortest:.3} to {longest:.3}, median {median:.3}, 99 % {p99:.3}); \
         late by {late:.3} / {late_99:.3} / {latest:.3} ms (p50 / p99 / max)"
    )
}

fn reactions(execution_type: ExecutionType, found: &TypeFindings) -> String {
    let reaction = |name: &str, reaction: Option<tap::Reaction>| {
        reaction
            .map(|it| format!("{name} {:.3} ms (99 % {:.3}, max {:.3})", it.median_ms, it.p99_ms, it.max_ms))
    };
    let mut parts = vec![counted(found.repetitions.len() as u64, "repetition")];
    parts.extend(reaction("command to feedback", found.to_feedback));
    parts.extend(reaction("command to motion", found.to_motion));
    parts.push(format!("slots used {}", found.slots_used));
    parts.push(format!("starved in {}", counted(u64::from(found.starved_feedbacks), "feedback")));
    let uncertainty = found.repetitions.iter().map(|one| one.uncertainty_ms).fold(0.0, f64::max);
    parts.push(format!("each time within {uncertainty:.3} ms"));
    format!("{}: {}", execution_type.to_string().to_uppercase(), parts.join(", "))
}
