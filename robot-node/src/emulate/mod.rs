//! `robot-node emulate`: the device of a GSDML, EDS or ESI on a real network.

#![expect(clippy::disallowed_methods, reason = "this is the process of an emulated device, with its threads")]

mod owner;

use std::io::BufRead as _;
use std::net::Ipv4Addr;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

use anyhow::Context as _;
use device_files::ChosenDevice;
use emulated_device::{
    DataPlace, DeviceScript, EmulatedDevice, EmulationConfig, EmulationError, ScriptError,
};
use machine::Duration;
use node::Outcome;
use node::address_check::{AddressCheckError, check_address};
use node::device_options::{DeviceOptions, is_usage as is_of_file, read_toml};
use node::errln;
use node::output::to_stdout;
use protocol_linux::{Driver, FormerAddress, Interface, Notifier, StopSignals, clock};

use self::owner::{EmulationInstruction, EmulationOwner, Report};

/// The device of a file.
#[derive(clap::Args, Clone, Debug)]
#[command(after_help = EXAMPLES)]
pub struct EmulateCommand {
    #[command(flatten)]
    device: DeviceOptions,
    /// The network interface.
    #[arg(long, value_name = "IF", required_unless_present = "print_config")]
    interface: Option<String>,
    /// Inputs and faults over time, a TOML file.
    #[arg(long, value_name = "FILE.toml")]
    script: Option<PathBuf>,
    /// PROFINET: the station name; without it, that of the file.
    #[arg(long, value_name = "NAME")]
    station_name: Option<String>,
    /// The serial number.
    #[arg(long, value_name = "N", default_value_t = 1)]
    serial_number: u32,
    /// End after this time.
    #[arg(long = "for", value_name = "TIME", value_parser = node::duration_argument)]
    length: Option<Duration>,
    /// Print events as JSON, one per line.
    ///
    /// Inputs and faults are JSON lines on standard input.
    #[arg(long)]
    json: bool,
}

const EXAMPLES: &str = "\
Examples:
  robot-node emulate device.eds --interface eth1
  robot-node emulate GSDML-V2.35-Maker-Device-20230101.xml --module 1=ID_8DI --print-config >device.toml
  robot-node emulate GSDML-V2.35-Maker-Device-20230101.xml --config device.toml --interface eth1 --script script.toml
  echo '{\"set\": {\"place\": \"100\", \"type\": \"uint16\", \"value\": 5}}' | robot-node emulate device.eds --interface eth1 --json";

/// Returns true for an error that the user corrects in file, choice or script.
pub fn is_usage(error: &anyhow::Error) -> bool {
    let needs_address = matches!(error.downcast_ref(), Some(EmulationError::NoAddress));
    is_of_file(error) || error.is::<ScriptError>() || error.is::<EmulationError>() && !needs_address
}

/// Reports that wait to be printed. More are lost; the cycle goes on.
const REPORTS: usize = 256;

impl EmulateCommand {
    /// Emulates the device until the time is over or the program is ended.
    ///
    /// # Errors
    ///
    /// File, choice or script make no device, or the network cannot be used.
    pub fn execute(self) -> anyhow::Result<Outcome> {
        let chosen = self.device.choose()?;
        if self.device.choice.print_config {
            to_stdout(format_args!("{}", chosen.choice().to_toml()))?;
            return Ok(Outcome::Done);
        }
        let script = read_toml(self.script.as_deref(), DeviceScript::from_toml)?;
        let interface = Interface::find(self.interface.as_deref().unwrap_or_default())?;
        // Other threads inherit that the signals are blocked.
        let signals = StopSignals::block().context("taking over SIGINT and SIGTERM")?;
        let former_address = FormerAddress::of(&interface);
        let start = clock::now();
        let config = EmulationConfig {
            mac: interface.mac(),
            address: interface.address(),
            mask: interface.mask().unwrap_or(Ipv4Addr::new(255, 255, 255, 0)),
            gateway: interface.gateway().unwrap_or(Ipv4Addr::UNSPECIFIED),
            station_name: self.station_name.map(String::into_bytes),
            permanent: None,
            serial_number: self.serial_number,
            // Frames of a connection from before a restart are not taken for those of a new one.
            first_id: start.as_nanos() as u32,
        };
        interface.set_up()?;
        find_twin(&chosen, &interface)?;
        introduce(&chosen);
        let device = EmulatedDevice::new(chosen, script, config, clock::now())?;
        list(&device, self.json)?;
        let (reports, printed) = sync_channel(REPORTS);
        let (instructions, taken) = sync_channel(REPORTS);
        let is_json = self.json;
        std::thread::spawn(move || print(&printed, is_json));
        let errors = reports.clone();
        if is_json {
            std::thread::spawn(move || read_instructions(&instructions, &errors));
        }
        let end = self.length.map(|length| clock::now() + length);
        let notifier = Notifier::new()?;
        let mut owner = EmulationOwner {
            interface: interface.clone(),
            reports,
            instructions: taken,
            is_stopped: stop_at_signal(signals, notifier.clone()),
            outcome: Outcome::Done,
            end,
        };
        let mut driver = Driver::new(device, interface, notifier)?;
        driver.run(&mut owner)?;
        drop(former_address);
        Ok(owner.outcome)
    }
}

/// Says whose identity the device has, and what it is not.
fn introduce(chosen: &ChosenDevice) {
    let (identity, limits) = match chosen {
        ChosenDevice::Gsdml(device) => (
            format!("vendor 0x{:04X}, device 0x{:04X}", device.vendor_id, device.device_id),
            "name and address are lost at the end; parameter records are accepted and not kept",
        ),
        ChosenDevice::Eds(adapter) => (
            format!("vendor {}, product code {}", adapter.vendor_id, adapter.product_code),
            "parameters of the file are not objects of the device",
        ),
        ChosenDevice::Esi(device) => (
            format!("vendor 0x{:08X}, product 0x{:08X}", device.vendor_id, device.product_code),
            "it answers after tens of µs, at the end of a line, without accurate distributed clocks",
        ),
    };
    errln!(
        "note: this takes the identity of another maker's device, {identity}; use it only on a network of your own"
    );
    errln!("note: an emulation claims no conformance; {limits}");
}

/// Looks for a station that has the same address.
fn find_twin(chosen: &ChosenDevice, interface: &Interface) -> anyhow::Result<()> {
    let Some(address) = interface.address().filter(|_| !matches!(chosen, ChosenDevice::Esi(_))) else {
        return Ok(());
    };
    match check_address(interface, address) {
        Err(taken @ AddressCheckError::Taken(_)) => Err(taken.into()),
        Err(error) => {
            errln!("warning: it is unknown whether another station has {address}: {error}");
            Ok(())
        }
        Ok(()) => Ok(()),
    }
}

/// Lists the places that a script may name.
fn list(device: &EmulatedDevice, is_json: bool) -> anyhow::Result<()> {
    let (inputs, outputs) = device.places();
    if is_json {
        let started =
            serde_json::json!({ "started": { "bus": device.bus(), "inputs": inputs, "outputs": outputs } });
        return Ok(to_stdout(format_args!("{started}\n"))?);
    }
    let mut text = String::new();
    for (direction, places) in [("inputs", inputs), ("outputs", outputs)] {
        for DataPlace { place, name, bits, .. } in places {
            let size = if bits % 8 == 0 { format!("{} bytes", bits / 8) } else { format!("{bits} bits") };
            let name: String = name.chars().map(|it| if it.is_control() { '\u{FFFD}' } else { it }).collect();
            text.push_str(&format!("{direction} {place}: {size} {}\n", name.trim_end()));
        }
    }
    to_stdout(format_args!("{text}{} device waits for a controller\n", device.bus()))?;
    Ok(())
}

/// Prints reports until the program ends.
fn print(reports: &Receiver<Report>, is_json: bool) {
    for report in reports {
        let printed = if is_json {
            to_stdout(format_args!("{}\n", report.to_json()))
        } else {
            to_stdout(format_args!("{report}\n"))
        };
        if printed.is_err() {
            return;
        }
    }
}

/// Waits for a signal in a thread of its own: to ask for one costs a system call, and the device has each cycle to itself. Returns
/// whether one came; `notifier` wakes the device then.
fn stop_at_signal(signals: StopSignals, notifier: Notifier) -> Arc<AtomicBool> {
    let is_stopped = Arc::new(AtomicBool::new(false));
    let stopped = Arc::clone(&is_stopped);
    std::thread::spawn(move || {
        if signals.wait().is_ok() {
            stopped.store(true, Ordering::Relaxed);
            notifier.notify();
        }
    });
    is_stopped
}

/// Reads instructions from standard input, one JSON object per line.
fn read_instructions(instructions: &SyncSender<EmulationInstruction>, errors: &SyncSender<Report>) {
    for line in std::io::stdin().lock().lines().map_while(Result::ok) {
        let sent = match serde_json::from_str::<EmulationInstruction>(&line) {
            Ok(instruction) => instructions.send(instruction).is_ok(),
            Err(error) => errors.send(Report::Refused(error.to_string())).is_ok(),
        };
        if !sent {
            return;
        }
    }
}
