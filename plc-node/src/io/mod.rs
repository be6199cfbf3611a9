//! `plc-node io`: drives the device of a GSDML, EDS or ESI on a real network.

#![expect(
    clippy::disallowed_methods,
    clippy::disallowed_types,
    reason = "this is the process that drives a device, with its threads and the file of its record"
)]

mod answers;
mod owner;
mod report;
mod target;
mod target_error;

use std::io::BufRead as _;
use std::net::Ipv4Addr;
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

use anyhow::Context as _;
use device_files::{ChosenDevice, choose};
use driven_device::{DriveConfig, DriveError, DrivenDevice, OutputScript, ScriptError};
use machine::Duration;
use node::Outcome;
use node::device_options::{ChoiceOptions, is_usage as is_of_file, read_device_file, read_toml};
use node::errln;
use node::output::to_stdout;
use protocol_linux::{Driver, Interface, Notifier, clock};

use self::owner::{IoInstruction, IoOwner};
use self::report::{Printer, Report};
use self::target::DeviceTarget;
use self::target_error::TargetError;

/// The controller of the device of a file.
#[derive(clap::Args, Clone, Debug)]
#[command(after_help = EXAMPLES)]
pub struct IoCommand {
    /// The file: a GSDML (PROFINET), an EDS (EtherNet/IP) or an ESI (EtherCAT).
    #[arg(long, value_name = "FILE")]
    device: PathBuf,
    #[command(flatten)]
    choice: ChoiceOptions,
    /// The network interface.
    #[arg(long, value_name = "IF", required_unless_present = "print_config")]
    interface: Option<String>,
    /// The device: its station name on PROFINET, its address on EtherNet/IP, its position on EtherCAT, from 1.
    ///
    /// Without it, the only one with the file's identity.
    #[arg(long, value_name = "NAME|ADDRESS|POSITION")]
    at: Option<String>,
    /// PROFINET: the IP address that the device gets; without it, the one that it has.
    #[arg(long, value_name = "ADDRESS")]
    address: Option<Ipv4Addr>,
    /// Set an output. Repeat it for each.
    #[arg(long = "set", value_name = "NAME=VALUE", value_parser = assignment)]
    sets: Vec<(String, String)>,
    /// Outputs over time, a TOML file.
    #[arg(long, value_name = "FILE.toml")]
    script: Option<PathBuf>,
    /// Run the outputs from the start.
    ///
    /// Without it the device gets zeros, marked as not valid, until the line `run` on standard input.
    #[arg(long)]
    run: bool,
    /// Read a parameter by its name. Repeat it for each.
    #[arg(long = "read", value_name = "NAME")]
    reads: Vec<String>,
    /// Write a parameter by its name. Repeat it for each.
    #[arg(long = "write", value_name = "NAME=VALUE", value_parser = assignment)]
    writes: Vec<(String, String)>,
    /// The interval of the cyclic data; without it, that of the file.
    #[arg(long, value_name = "TIME", value_parser = node::duration_argument)]
    interval: Option<Duration>,
    /// EtherNet/IP: the packet interval (RPI) of the outputs, in place of --interval.
    #[arg(long, value_name = "TIME", value_parser = node::duration_argument)]
    rpi_out: Option<Duration>,
    /// EtherNet/IP: the packet interval (RPI) of the inputs, in place of --interval.
    #[arg(long, value_name = "TIME", value_parser = node::duration_argument)]
    rpi_in: Option<Duration>,
    /// Write each event to this file too, as JSON, one per line.
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    /// End after this time.
    #[arg(long = "for", value_name = "TIME", value_parser = node::duration_argument)]
    length: Option<Duration>,
    /// Print events as JSON, one per line.
    #[arg(long)]
    json: bool,
}

const EXAMPLES: &str = "\
Examples:
  plc-node io --device device.eds --interface eth1 --at 192.168.0.2
  plc-node io --device GSDML-V2.35-Maker-Device-20230101.xml --interface eth1 --at valves --run --set 2.1/Valve=1
  plc-node io --device terminal.xml --interface eth1 --at 3 --for 30s --json   the third device on the cable

Standard input takes `run`, `stop`, `set NAME=VALUE`, `read NAME` and `write NAME=VALUE`, one per line.
Exit codes: 4 if the device differs from the file or refuses, or the connection is lost at the end; 5 if it does not answer.";

fn assignment(text: &str) -> Result<(String, String), String> {
    let (name, value) = text.split_once('=').ok_or("must be NAME=VALUE")?;
    Ok((name.to_owned(), value.to_owned()))
}

/// Returns true for an error that the user corrects in file, choice, script or options.
pub fn is_usage(error: &anyhow::Error) -> bool {
    is_of_file(error)
        || error.is::<ScriptError>()
        || error.downcast_ref::<DriveError>().is_some_and(|error| *error != DriveError::NoAddress)
        || error.downcast_ref::<TargetError>().is_some_and(TargetError::is_usage)
}

/// Reports that wait to be printed. More are lost; the cycle goes on.
const REPORTS: usize = 256;

impl IoCommand {
    /// Drives the device until the time is over or the program is ended.
    ///
    /// # Errors
    ///
    /// File, choice, script or names fit no device, or the network cannot be used.
    pub fn execute(self) -> anyhow::Result<Outcome> {
        let file = read_device_file(&self.device)?;
        let choice = self.choice.to_choice()?;
        if self.choice.print_config {
            let chosen = choose(&file, &choice)?;
            to_stdout(format_args!("{}", chosen.choice().to_toml()))?;
            return Ok(Outcome::Done);
        }
        let script = read_toml(self.script.as_deref(), OutputScript::from_toml)?;
        let interface = Interface::find(self.interface.as_deref().unwrap_or_default())?;
        interface.set_up()?;
        let target = DeviceTarget::find(&file, &choice, &interface, self.at.as_deref(), self.address)?;
        let config = self.config(&interface, &target);
        let (chosen, unknown) = target::choose_device(&file, &choice, &interface, &config)?;
        unknown.iter().for_each(|difference| errln!("warning: {difference}"));
        let mut device = DrivenDevice::new(file, chosen, script, &config, clock::now())?;
        for (name, value) in &self.sets {
            device.set(name, value)?;
        }
        self.reads.iter().try_for_each(|name| device.read_parameter(name))?;
        self.writes.iter().try_for_each(|(name, value)| device.write_parameter(name, value))?;
        self.drive(device, &interface, !unknown.is_empty())
    }

    fn config(&self, interface: &Interface, target: &DeviceTarget) -> DriveConfig {
        DriveConfig {
            mac: interface.mac(),
            address: interface.address(),
            mask: interface.mask().unwrap_or(Ipv4Addr::new(255, 255, 255, 0)),
            device_address: target.address,
            station_name: target.station_name.clone(),
            position: target.position,
            interval: self.interval,
            output_interval: self.rpi_out,
            input_interval: self.rpi_in,
            // Frames of a connection from before a restart are not taken for those of a new one.
            seed: clock::now().as_nanos(),
            is_running: self.run,
            report_every: Duration::from_millis(100),
        }
    }

    fn drive(
        &self,
        device: DrivenDevice,
        interface: &Interface,
        has_unknown: bool,
    ) -> anyhow::Result<Outcome> {
        let record = match &self.record {
            Some(path) => Some(
                std::fs::File::create(path).with_context(|| format!("cannot write {}", path.display()))?,
            ),
            None => None,
        };
        let mut printer = Printer::new(&device, self.json, record);
        printer.list(&device)?;
        let (reports, printed) = sync_channel(REPORTS);
        let (instructions, taken) = sync_channel(REPORTS);
        let printing = std::thread::spawn(move || print(&printed, printer));
        let refusals = reports.clone();
        std::thread::spawn(move || read_instructions(&instructions, &refusals));
        let end = self.length.map(|length| clock::now() + length);
        let mut owner = IoOwner::new(reports, taken, end);
        let mut driver = Driver::new(device, interface.clone(), Notifier::new()?)?;
        driver.run(&mut owner)?;
        let device = driver.machine();
        owner.finish(device, driver.statistics());
        drop(owner);
        // The thread of standard input may wait for a line for ever; the printer ends with the last report.
        let _ = printing.join();
        Ok(outcome(device, has_unknown))
    }
}

fn outcome(device: &DrivenDevice, has_unknown: bool) -> Outcome {
    match (device.differs() || has_unknown, device.has_been_up()) {
        (true, _) => Outcome::RunFailed,
        (false, false) => Outcome::EnvironmentUnusable,
        (false, true) if device.was_lost() => Outcome::RunFailed,
        (false, true) => Outcome::Done,
    }
}

/// Prints reports until the last one.
fn print(reports: &Receiver<Report>, mut printer: Printer) {
    for report in reports {
        let is_last = matches!(report, Report::Ended(..));
        if printer.print(&report).is_err() || is_last {
            return;
        }
    }
}

/// Reads instructions from standard input, one in a line.
fn read_instructions(instructions: &SyncSender<IoInstruction>, refusals: &SyncSender<Report>) {
    for line in std::io::stdin().lock().lines().map_while(Result::ok) {
        if line.trim().is_empty() {
            continue;
        }
        let sent = match IoInstruction::parse(&line) {
            Ok(instruction) => instructions.send(instruction).is_ok(),
            Err(error) => refusals.send(Report::Refused(error)).is_ok(),
        };
        if !sent {
            return;
        }
    }
}

/// Device without a choice left, and what the wire has beside the file.
type Choice = (ChosenDevice, Vec<String>);
