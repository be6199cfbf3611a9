//! `robot-node emulate`: devices of GSDML, EDS or ESI files on a real network.

#![expect(clippy::disallowed_methods, reason = "this is the process of emulated devices, with its threads")]

mod arguments;
mod network;
mod owner;

use std::io::BufRead as _;
use std::net::Ipv4Addr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

use anyhow::Context as _;
use device_files::{ChosenDevice, without_controls};
use emulated_device::{
    DataPlace, EmulatedDevice, EmulatedDevices, EmulationConfig, EmulationError, ScriptError,
};
use machine::Duration;
use node::Outcome;
use node::address_check::{AddressCheckError, check_address};
use node::device_options::is_usage as is_of_file;
use node::errln;
use node::output::to_stdout;
use protocol_linux::{Driver, FormerAddress, Interface, Notifier, StopSignals, clock};

use self::arguments::{AllDevices, ArgumentError, DeviceGroup, check_addresses, groups};
use self::network::DeviceNetwork;
use self::owner::{AddressedInstruction, EmulationOwner, Report};

/// Devices of files.
#[derive(clap::Args, Clone, Debug)]
#[command(after_help = EXAMPLES)]
pub struct EmulateCommand {
    #[command(flatten)]
    devices: AllDevices,
    /// The network interface.
    #[arg(long, value_name = "IF", required_unless_present = "print_config")]
    interface: Option<String>,
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
  robot-node emulate device.eds --count 64 --address 192.168.0.10 --interface eth1   64 of them, each with a MAC address of its own
  robot-node emulate terminal.xml --device-name EL1 drive.xml --interface eth1   one after the other on an EtherCAT cable
  echo '{\"set\": {\"place\": \"100\", \"type\": \"uint16\", \"value\": 5}}' | robot-node emulate device.eds --interface eth1 --json

Repeat FILE for several devices of one bus; the options of a device are those after its FILE. Instructions for one of several devices
name it: {\"device\": 2, \"set\": ...}.";

/// Returns true for an error that the user corrects in file, choice or script.
pub fn is_usage(error: &anyhow::Error) -> bool {
    let needs_address = matches!(error.downcast_ref(), Some(EmulationError::NoAddress));
    is_of_file(error)
        || error.is::<ScriptError>()
        || error.is::<ArgumentError>()
        || error.is::<EmulationError>() && !needs_address
}

/// Reports that wait to be printed. More are lost; the cycle goes on.
const REPORTS: usize = 256;

impl EmulateCommand {
    /// Emulates the devices until the time is over or the program is ended.
    ///
    /// # Errors
    ///
    /// File, choice or script make no device, or the network cannot be used.
    pub fn execute(self) -> anyhow::Result<Outcome> {
        let groups = groups(&self.devices)?;
        if self.devices.0.iter().any(|of| of.device.choice.print_config) {
            let [group] = groups.as_slice() else { return Err(ArgumentError::SeveralConfigs.into()) };
            to_stdout(format_args!("{}", group.chosen.choice().to_toml()))?;
            return Ok(Outcome::Done);
        }
        let host = Interface::find(self.interface.as_deref().unwrap_or_default())?;
        // Other threads inherit that the signals are blocked.
        let signals = StopSignals::block().context("taking over SIGINT and SIGTERM")?;
        let former_address = FormerAddress::of(&host);
        host.set_up()?;
        let is_several = groups.iter().map(|group| group.count).sum::<usize>() > 1;
        let configs = configs(&groups, &host, is_several);
        check_addresses(&configs)?;
        // All devices of an EtherCAT cable are at one interface.
        let is_line = groups.iter().any(|group| matches!(group.chosen, ChosenDevice::Esi(_)));
        let has_own = !is_line && configs.iter().any(|config| config.mac != host.mac());
        let network = has_own.then(|| DeviceNetwork::set_up(&host, &configs)).transpose()?;
        let interfaces = network.as_ref().map_or_else(|| vec![host.clone()], |own| own.interfaces.clone());
        groups.iter().for_each(|group| introduce(&group.chosen));
        let prepared = || -> anyhow::Result<EmulatedDevices> {
            for (interface, config) in interfaces.iter().zip(&configs).filter(|_| !is_line) {
                find_twin(interface, config.address)?;
            }
            let chosen = groups.iter().flat_map(|group| std::iter::repeat_n(group, group.count));
            let now = clock::now();
            let devices = chosen.zip(&configs).map(|(group, config)| {
                EmulatedDevice::new(group.chosen.clone(), group.script.clone(), config.clone(), now)
            });
            Ok(EmulatedDevices::new(devices.collect::<Result<_, _>>()?)?)
        };
        let devices = within(network.as_ref(), prepared)?;
        list(&devices, &groups, self.json)?;
        let (reports, printed) = sync_channel(REPORTS);
        let (instructions, taken) = sync_channel(REPORTS);
        let is_json = self.json;
        std::thread::spawn(move || print(&printed, is_json, is_several));
        let errors = reports.clone();
        if is_json {
            std::thread::spawn(move || read_instructions(&instructions, &errors));
        }
        let notifier = Notifier::new()?;
        let mut owner = EmulationOwner {
            interfaces: interfaces.clone(),
            reports,
            instructions: taken,
            is_stopped: stop_at_signal(signals, notifier.clone()),
            outcome: Outcome::Done,
            end: self.length.map(|length| clock::now() + length),
        };
        within(network.as_ref(), || Ok(Driver::new(devices, interfaces, notifier)?.run(&mut owner)?))?;
        drop(former_address);
        Ok(owner.outcome)
    }
}

/// Returns the settings of all devices.
fn configs(groups: &[DeviceGroup], host: &Interface, is_several: bool) -> Vec<EmulationConfig> {
    let common = EmulationConfig {
        mac: host.mac(),
        address: host.address(),
        mask: host.mask().unwrap_or(Ipv4Addr::new(255, 255, 255, 0)),
        gateway: host.gateway().unwrap_or(Ipv4Addr::UNSPECIFIED),
        station_name: None,
        permanent: None,
        serial_number: 0,
        // Frames of a connection from before a restart are not taken for those of a new one.
        first_id: clock::now().as_nanos() as u32,
    };
    let of_group = |group: &DeviceGroup| {
        (0..group.count).map(|index| group.config(index, !is_several, &common)).collect::<Vec<_>>()
    };
    groups.iter().flat_map(of_group).collect()
}

/// Runs something in the network of the devices, or in that of this thread.
fn within<T: Send>(
    network: Option<&DeviceNetwork>,
    work: impl FnOnce() -> anyhow::Result<T> + Send,
) -> anyhow::Result<T> {
    match network {
        Some(own) => own.network.run(work)?,
        None => work(),
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
fn find_twin(interface: &Interface, address: Option<Ipv4Addr>) -> anyhow::Result<()> {
    let Some(address) = address else { return Ok(()) };
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
fn list(devices: &EmulatedDevices, groups: &[DeviceGroup], is_json: bool) -> anyhow::Result<()> {
    let is_several = devices.devices().len() > 1;
    let mut text = String::new();
    for DeviceGroup { first, count, .. } in groups {
        let Some(device) = devices.devices().get(first - 1) else { continue };
        let last = first + count - 1;
        let (inputs, outputs) = device.places();
        if is_json {
            for number in *first..=last {
                let started =
                    serde_json::json!({ "bus": device.bus(), "inputs": inputs, "outputs": outputs });
                let line = numbered(serde_json::json!({ "started": started }), is_several.then_some(number));
                text.push_str(&format!("{line}\n"));
            }
            continue;
        }
        match count {
            _ if !is_several => {}
            1 => text.push_str(&format!("device {first}\n")),
            _ => text.push_str(&format!("devices {first} to {last}\n")),
        }
        for (direction, places) in [("inputs", inputs), ("outputs", outputs)] {
            for DataPlace { place, name, bits, .. } in places {
                let size = if bits % 8 == 0 { format!("{} bytes", bits / 8) } else { format!("{bits} bits") };
                let name = without_controls(name);
                text.push_str(&format!("{direction} {place}: {size} {}\n", name.trim_end()));
            }
        }
    }
    let bus = devices.devices().first().map_or("", EmulatedDevice::bus);
    match (is_json, is_several) {
        (true, _) => {}
        (false, false) => text.push_str(&format!("{bus} device waits for a controller\n")),
        (false, true) => {
            text.push_str(&format!("{} {bus} devices wait for a controller\n", devices.devices().len()));
        }
    }
    to_stdout(format_args!("{text}"))?;
    Ok(())
}

/// Prints reports until the program ends, with the number of the device where there are several.
fn print(reports: &Receiver<(usize, Report)>, is_json: bool, is_several: bool) {
    for (number, report) in reports {
        let number = is_several.then_some(number + 1);
        let printed = match (is_json, number) {
            (true, _) => to_stdout(format_args!("{}\n", numbered(report.to_json(), number))),
            (false, Some(number)) => to_stdout(format_args!("device {number}: {report}\n")),
            (false, None) => to_stdout(format_args!("{report}\n")),
        };
        if printed.is_err() {
            return;
        }
    }
}

/// Adds the number of a device to an object.
fn numbered(mut object: serde_json::Value, number: Option<usize>) -> serde_json::Value {
    if let (Some(number), Some(object)) = (number, object.as_object_mut()) {
        object.insert("device".to_owned(), number.into());
    }
    object
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
fn read_instructions(instructions: &SyncSender<AddressedInstruction>, errors: &SyncSender<(usize, Report)>) {
    for line in std::io::stdin().lock().lines().map_while(Result::ok) {
        let sent = match serde_json::from_str::<AddressedInstruction>(&line) {
            Ok(instruction) => instructions.send(instruction).is_ok(),
            Err(error) => errors.send((0, Report::Refused(error.to_string()))).is_ok(),
        };
        if !sent {
            return;
        }
    }
}
