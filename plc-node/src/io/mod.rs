//! `plc-node io`: drives the devices of GSDML, EDS or ESI files on a real network.

#![expect(
    clippy::disallowed_methods,
    clippy::disallowed_types,
    reason = "this is the process that drives a device, with its threads and the file of its record"
)]

mod answers;
mod detected;
mod device_arguments;
mod live_screen;
mod live_view;
mod owner;
mod report;
mod target;
mod target_error;
mod terminal;

use std::io::BufRead as _;
use std::net::Ipv4Addr;
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

use anyhow::Context as _;
use device_files::{ChosenDevice, choose};
use driven_device::{
    BusConfig, DriveConfig, DriveError, DrivenBus, DrivenDevice, FileDevice, OutputScript, ScriptError,
};
use machine::Duration;
use node::Outcome;
use node::device_options::{is_usage as is_of_file, read_device_file, read_toml};
use node::errln;
use node::output::to_stdout;
use protocol_linux::{Driver, Interface, Notifier, clock};

use self::device_arguments::{AllDevices, DeviceArguments};
use self::live_view::LiveView;
use self::owner::{IoInstruction, IoOwner};
use self::report::{Printer, Report};
use self::target::{DeviceTarget, NetworkSearch};
use self::target_error::TargetError;
use self::terminal::{TerminalSettings, read_keys, show};

/// The controller of devices of files.
#[derive(clap::Args, Clone, Debug)]
#[command(after_help = EXAMPLES)]
pub struct IoCommand {
    #[command(flatten)]
    devices: AllDevices,
    /// The network interface.
    #[arg(long, value_name = "IF", required_unless_present = "print_config")]
    interface: Option<String>,
    /// Set an output, with the name of its device in front where several have one: `valves/2.1/Valve=1`. Repeat it for each.
    #[arg(long = "set", value_name = "NAME=VALUE", value_parser = assignment)]
    sets: Vec<(String, String)>,
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
  plc-node io --interface eth1 --device valve.eds --at 192.168.0.2 --name left --device valve.eds --at 192.168.0.3 --name right --set left/Valve=1

On a terminal inputs and outputs are shown live: r runs and stops the outputs, up and down select one, Enter or a number sets it, `:` takes
an instruction, q ends. Elsewhere standard input takes `run`, `stop`, `set NAME=VALUE`, `read NAME` and `write NAME=VALUE`, one per line; `run NAME` and `stop NAME`
are for one of several devices.
Exit codes: 4 if a device differs from its file or refuses, or a connection is lost at the end; 5 if a device does not answer.";

fn assignment(text: &str) -> Result<(String, String), String> {
    let (name, value) = text.split_once('=').ok_or("must be NAME=VALUE")?;
    Ok((name.to_owned(), value.to_owned()))
}

/// Returns true for an error that the user corrects in file, choice, script or options.
pub fn is_usage(error: &anyhow::Error) -> bool {
    is_of_file(error)
        || error.is::<ScriptError>()
        || error.downcast_ref::<DriveError>().is_some_and(|error| !error.is_without_address())
        || error.downcast_ref::<TargetError>().is_some_and(TargetError::is_usage)
}

/// Reports that wait to be printed. More are lost; the cycle goes on.
const REPORTS: usize = 256;

impl IoCommand {
    /// Drives the devices until the time is over or the program is ended.
    ///
    /// # Errors
    ///
    /// File, choice, script or names fit no device, or the network cannot be used.
    pub fn execute(self) -> anyhow::Result<Outcome> {
        if self.devices.0.iter().any(|device| device.choice.print_config) {
            return self.print_config();
        }
        let interface = Interface::find(self.interface.as_deref().unwrap_or_default())?;
        interface.set_up()?;
        let bus = bus_config(&interface);
        let search = NetworkSearch::new(&interface);
        let (mut devices, mut has_unknown) = (Vec::new(), false);
        for of in &self.devices.0 {
            let (device, unknown) = self.find_device(of, (&interface, &search), &bus, &devices)?;
            let name = device_files::excerpt(&device.name);
            unknown.iter().for_each(|difference| errln!("warning: {name}: {difference}"));
            has_unknown |= !unknown.is_empty();
            devices.push(device);
        }
        let mut bus = DrivenBus::new(devices, &bus, clock::now())?;
        self.sets.iter().try_for_each(|(name, value)| bus.set(name, value))?;
        self.reads.iter().try_for_each(|name| bus.read_parameter(name))?;
        self.writes.iter().try_for_each(|(name, value)| bus.write_parameter(name, value))?;
        self.drive(bus, &interface, has_unknown)
    }

    /// Prints the whole choice of the device.
    fn print_config(&self) -> anyhow::Result<Outcome> {
        let [of] = self.devices.0.as_slice() else {
            return Err(TargetError::SeveralConfigs.into());
        };
        let chosen = choose(&read_device_file(&of.device)?, &of.choice.to_choice()?)?;
        to_stdout(format_args!("{}", chosen.choice().to_toml()))?;
        Ok(Outcome::Done)
    }

    /// Finds a device on the wire, and makes its choice. Returns it with what the wire has beside the file.
    fn find_device(
        &self,
        of: &DeviceArguments,
        (interface, search): (&Interface, &NetworkSearch<'_>),
        bus: &BusConfig,
        before: &[FileDevice],
    ) -> anyhow::Result<(FileDevice, Vec<String>)> {
        let file = read_device_file(&of.device)?;
        let choice = of.choice.to_choice()?;
        let script = read_toml(of.script.as_deref(), OutputScript::from_toml)?;
        let target = DeviceTarget::find(&file, &choice, search, of.at.as_deref(), of.address)?;
        let config = DriveConfig {
            device_address: target.address,
            station_name: target.station_name.clone(),
            position: target.position,
            interval: self.interval,
            output_interval: of.rpi_out,
            input_interval: of.rpi_in,
            is_running: self.run,
            report_every: Duration::from_millis(100),
        };
        let (chosen, unknown) = target::choose_device(&file, &choice, interface, bus, &config)?;
        let name = of.name.clone().unwrap_or_else(|| target.name(before));
        Ok((FileDevice { name, file, chosen, script, config }, unknown))
    }

    fn drive(&self, bus: DrivenBus, interface: &Interface, has_unknown: bool) -> anyhow::Result<Outcome> {
        let record = match &self.record {
            Some(path) => Some(
                std::fs::File::create(path).with_context(|| format!("cannot write {}", path.display()))?,
            ),
            None => None,
        };
        let settings = if self.json { None } else { TerminalSettings::of_terminal() };
        let is_live = settings.is_some();
        let mut printer = Printer::new(&bus, self.json, record);
        printer.list(&bus, is_live)?;
        let (reports, printed) = sync_channel(REPORTS);
        let (instructions, taken) = sync_channel(REPORTS);
        let input = reports.clone();
        let printing = if is_live {
            let view = LiveView::new(&bus, self.run);
            std::thread::spawn(move || read_keys(&input));
            std::thread::spawn(move || show(&printed, printer, view, &instructions))
        } else {
            std::thread::spawn(move || read_instructions(&instructions, &input));
            std::thread::spawn(move || print(&printed, printer))
        };
        let now = clock::now();
        let end = self.length.map(|length| now + length);
        let mut owner = IoOwner::new(reports, taken, end, is_live.then_some(now));
        let mut driver = Driver::new(bus, interface.clone(), Notifier::new()?)?;
        driver.run(&mut owner)?;
        let bus = driver.machine();
        owner.finish(bus, driver.statistics());
        drop(owner);
        // The thread of standard input may wait for a line for ever; the printer ends with the last report.
        let _ = printing.join();
        drop(settings);
        Ok(outcome(bus, has_unknown))
    }
}

fn bus_config(interface: &Interface) -> BusConfig {
    BusConfig {
        mac: interface.mac(),
        address: interface.address(),
        mask: interface.mask().unwrap_or(Ipv4Addr::new(255, 255, 255, 0)),
        // Frames of a connection from before a restart are not taken for those of a new one.
        seed: clock::now().as_nanos(),
    }
}

fn outcome(bus: &DrivenBus, has_unknown: bool) -> Outcome {
    let has = |what: fn(&DrivenDevice) -> bool| bus.devices().iter().any(what);
    if has_unknown || has(DrivenDevice::differs) {
        Outcome::RunFailed
    } else if has(|device| !device.has_been_up()) {
        Outcome::EnvironmentUnusable
    } else if has(DrivenDevice::was_lost) {
        Outcome::RunFailed
    } else {
        Outcome::Done
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
