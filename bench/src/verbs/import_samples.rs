//! `bench import-samples`: makes a run of the execution times that were read out of a PLC.

use std::path::PathBuf;
use std::time::SystemTime;

use anyhow::{Context, anyhow};
use clap::Args;

use crate::verbs::measured_elsewhere::{MeasuredElsewhere, file_name};
use records::exit::{Exit, Failure};
use records::imported_samples;
use records::origin::{MeasuredPeer, OriginKind, SampleOrigin};
use studies::setup_option::SetupOption;

/// Longest table in bytes.
const MAX_LEN: u64 = 64 << 20;

/// Options of an import.
#[derive(Args, Debug)]
pub struct ImportOptions {
    /// A table with the columns type, repetition and sample_us; separated by comma, semicolon or tab.
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
    let ImportOptions { file, setup, application, plc, robot, out } = options;
    let (setup, found) = setup.load_with(application.as_deref())?;
    found.plan(&setup)?;
    let text = read(options).map_err(|error| Failure::new(Exit::Usage, error))?;
    let types = imported_samples::parse(&text)
        .map_err(|error| Failure::new(Exit::Usage, anyhow!("{}: {error}", file.display())))?;
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
    let measured = MeasuredElsewhere { setup: &setup, found: &found, origin, types: &types, began };
    measured.save(out.as_deref(), measured.results())
}

fn read(ImportOptions { file, .. }: &ImportOptions) -> anyhow::Result<String> {
    let shown = file.display();
    let bytes = setup::read_plain_file(file, MAX_LEN).with_context(|| format!("cannot read {shown}"))?;
    String::from_utf8(bytes).map_err(|_| anyhow!("{shown} is not text in UTF-8: save it as CSV in UTF-8"))
}
