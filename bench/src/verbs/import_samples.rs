//! `bench import-samples`: makes a run of the execution times that were read out of a PLC.

use std::path::PathBuf;
use std::time::SystemTime;

use anyhow::{Context, anyhow};
use clap::Args;
use planning::Found;
use plc_node::ExecutionType;

use crate::verbs::measured_elsewhere::{MeasuredElsewhere, file_name};
use records::exit::{Exit, Failure};
use records::imported_samples::{self, ImportedSamples};
use records::origin::{MeasuredPeer, OriginKind, SampleOrigin};
use records::sample_unit::{fitting_unit, is_plausible};
use records::schedule::Schedule;
use report::errln;
use setup::Setup;
use stands::virtual_run;
use studies::setup_option::SetupOption;

/// Longest table in bytes.
const MAX_LEN: u64 = 64 << 20;

/// Options of an import.
#[derive(Args, Debug)]
pub struct ImportOptions {
    /// A table with the columns type, repetition and sample_us; separated by comma, semicolon or tab.
    ///
    /// The column's name says the unit of the times: sample_ns, sample_us, sample_ms or sample_s.
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// The setup that was measured.
    #[command(flatten)]
    pub setup: SetupOption,
    /// The application that was run, instead of the setup's: a built-in one's name, or the path of a .toml file.
    #[arg(long, value_name = "NAME|PATH")]
    pub application: Option<String>,
    /// Identity of the PLC: maker, type, firmware.
    #[arg(long, value_name = "TEXT")]
    pub plc: Option<String>,
    /// Identity of the robot: maker, type, firmware.
    #[arg(long, value_name = "TEXT")]
    pub robot: Option<String>,
    /// Take times that are far from those of a virtual run of the setup.
    #[arg(long)]
    pub any_times: bool,
    /// The run's directory, new or without a run [default: below runs/, by time and setup].
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}

/// Reads the table, saves the run and prints its figures.
///
/// # Errors
///
/// The file or the setup cannot be read, a sample is missing or wrong, or the run cannot be saved. Then nothing is written.
pub fn run(options: &ImportOptions) -> Result<Exit, Failure> {
    let ImportOptions { file, setup, application, plc, robot, any_times, out } = options;
    let (setup, found) = setup.load_with(application.as_deref())?;
    found.plan(&setup)?;
    let text = read(options).map_err(|error| Failure::new(Exit::Usage, error))?;
    let refused = |error| Failure::new(Exit::Usage, anyhow!("{}: {error}", file.display()));
    let samples = imported_samples::parse(&text).map_err(|error| refused(anyhow!(error)))?;
    if !any_times {
        check_times(&samples, &setup, &found).map_err(refused)?;
    }
    let named =
        |identity: &Option<String>| MeasuredPeer { identity: identity.clone(), ..MeasuredPeer::default() };
    let origin = SampleOrigin {
        kind: OriginKind::Import,
        file: file_name(file),
        bus: None,
        plc: named(plc),
        robot: named(robot),
    };
    let began = SystemTime::now();
    let measured = MeasuredElsewhere { setup: &setup, found: &found, origin, types: &samples.types, began };
    measured.save(out.as_deref(), measured.results())
}

fn read(ImportOptions { file, .. }: &ImportOptions) -> anyhow::Result<String> {
    let shown = file.display();
    let bytes = setup::read_plain_file(file, MAX_LEN).with_context(|| format!("cannot read {shown}"))?;
    String::from_utf8(bytes).map_err(|_| anyhow!("{shown} is not text in UTF-8: save it as CSV in UTF-8"))
}

/// Refuses times that are of another magnitude than those of a virtual run: their column has another unit, or they are of another
/// setup or application.
fn check_times(samples: &ImportedSamples, setup: &Setup, found: &Found) -> anyhow::Result<()> {
    let ImportedSamples { unit, types } = samples;
    let read: Vec<_> = ExecutionType::ALL.into_iter().filter(|one| types.get(*one).is_some()).collect();
    let expected = match virtual_run::whole(setup, &found.application, &Schedule::new(&read, 1, 1)) {
        Ok(results) => results,
        Err(error) => {
            errln!("warning: the times are not compared with a virtual run, which failed: {error:#}");
            return Ok(());
        }
    };
    for execution_type in read {
        let Some(expected) = expected.figure(execution_type).map(|figure| figure.aet_ms) else { continue };
        let times = types.get(execution_type).into_iter().flat_map(|measured| measured.repetitions.iter());
        let implausible = times
            .enumerate()
            .filter_map(|(at, time)| Some((at + 1, time.as_ref().ok()?.execution_ms)))
            .find(|(_, time)| !is_plausible(*time, expected));
        if let Some((repetition, time)) = implausible {
            let name = execution_type.to_string().to_uppercase();
            let remedy = match fitting_unit(*unit, time, expected) {
                Some(other) => format!("if its column has another unit, name it {}", other.column()),
                None => "look at --setup and --application".to_owned(),
            };
            return Err(anyhow!(
                "{name} sample {repetition} is {} ms by the column {}, and {expected:.0} ms in a virtual run of this setup: {remedy}; \
                 --any-times takes the times as they are",
                time,
                unit.column()
            ));
        }
    }
    Ok(())
}
