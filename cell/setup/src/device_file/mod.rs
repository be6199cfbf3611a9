//! The robot's device from its file: a GSDML, an EDS or an ESI beside the setup, and the choice from it.
//!
//! The file is read once, with the setup. What it says becomes the keys by which a device is described by hand, such as
//! `[bus.profinet.device]`, and the chosen device itself; so a copy of the setup needs no other file.

mod ethercat;
mod ethernet_ip;
mod profinet;
mod ways;

use std::fmt::Display;
use std::path::Path;
use std::time::Duration;

use device_files::{ChoiceError, ChosenDevice, DeviceChoice, DeviceFile, excerpt, without_controls};
use protocol::image::IMAGE_LEN;

pub use ways::{UnfitRobotFile, ways_to_plug};

use crate::plain_file::{read_plain_file, read_plain_text_within};
use crate::problem::{Check, Problem, problem};
use crate::{Bus, BusKind};

/// Largest file of a choice in bytes.
const MOST_CHOICE_BYTES: u64 = 1 << 20;

/// Paths of the files that describe the robot's device, relative to the directory of the setup.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct DevicePaths {
    /// GSDML, EDS or ESI.
    pub device: String,
    /// Choice from it; without one, what the file leaves no choice in.
    pub config: Option<String>,
}

/// Name of a file in messages.
struct FileName(String);

/// Reads the files that a bus names, and fills in what they say.
pub(crate) fn read(bus: &mut Bus, directory: &Path) -> Check {
    let Some(paths) = bus.device_paths.take() else { return Ok(()) };
    let path = directory.join(&paths.device);
    let name = FileName(path_in_messages(&path));
    let unreadable = |error| {
        let text = format!("cannot read {}: {error}; the path is relative to the setup's directory", name.0);
        problem("bus.device", text)
    };
    let bytes = read_plain_file(&path, device_files::MOST_BYTES as u64).map_err(unreadable)?;
    let file =
        device_files::read(&name.0, bytes).map_err(|error| problem("bus.device", error.to_string()))?;
    let choice = read_choice(paths.config.as_deref(), directory)?;
    let key = if paths.config.is_some() { "bus.config" } else { "bus.device" };
    let refused = |text: String| problem(key, format!("{}: {text}", name.0));
    if !is_of(&file, &bus.kind) {
        let (found, wanted) = (file.bus(), bus.kind.name());
        return Err(refused(UnfitRobotFile::OtherBus { found, wanted }.to_string()));
    }
    let mut chosen = device_files::choose(&file, &choice).map_err(|error| refused(advise(&error, &name)))?;
    carries_image(&chosen).map_err(|text| {
        let ways = ways_to_plug(&file, &bus.kind);
        let ways = ways.map_or_else(
            |error| error.to_string(),
            |ways| format!("choose by `config` what carries them:\n  {}", ways.join("\n  ")),
        );
        refused(format!("{text}; {ways}"))
    })?;
    let filled = match (&file, &mut chosen, &mut bus.kind) {
        (DeviceFile::Gsdml(_), ChosenDevice::Gsdml(chosen), BusKind::Profinet(_, profinet)) => {
            profinet::fill(profinet, chosen, &name)
        }
        (DeviceFile::Eds(eds), ChosenDevice::Eds(chosen), BusKind::EthernetIp(_, ethernet_ip)) => {
            ethernet_ip::fill(ethernet_ip, eds, chosen, &name)
        }
        (DeviceFile::Esi(_), ChosenDevice::Esi(chosen), BusKind::Ethercat(ethercat)) => {
            ethercat::fill(ethercat, chosen, &name)
        }
        _ => Ok(()),
    };
    filled?;
    bus.device = Some(Box::new(chosen));
    Ok(())
}

fn is_of(file: &DeviceFile, kind: &BusKind) -> bool {
    matches!(
        (file, kind),
        (DeviceFile::Gsdml(_), BusKind::Profinet(..))
            | (DeviceFile::Eds(_), BusKind::EthernetIp(..))
            | (DeviceFile::Esi(_), BusKind::Ethercat(_))
    )
}

fn path_in_messages(path: &Path) -> String {
    without_controls(&path.display().to_string())
}

fn read_choice(path: Option<&str>, directory: &Path) -> Result<DeviceChoice, Problem> {
    let Some(path) = path else { return Ok(DeviceChoice::default()) };
    let path = directory.join(path);
    let refused = |error: &dyn Display| {
        let text = format!("cannot read {}: {error}", path_in_messages(&path));
        problem("bus.config", text)
    };
    let text = read_plain_text_within(&path, MOST_CHOICE_BYTES).map_err(|error| refused(&error))?;
    DeviceChoice::from_toml(&text).map_err(|error| refused(&error))
}

/// Returns the reason of a choice, and how to write a better one.
fn advise(error: &ChoiceError, name: &FileName) -> String {
    format!(
        "{error}\n  `plc-node io --device '{}' OPTIONS --print-config` prints the file for `config`",
        name.0
    )
}

/// Checks that a device exchanges an image each way.
fn carries_image(chosen: &ChosenDevice) -> Result<(), String> {
    if let ChosenDevice::Gsdml(device) = chosen {
        let mut all = device.modules.iter().flat_map(|module| &module.submodules);
        if let Some(safety) = all.find(|submodule| submodule.is_safety) {
            let name = excerpt(&safety.name);
            return Err(format!("`{name}` is PROFIsafe, which is not made; leave its module out"));
        }
    }
    if let ChosenDevice::Esi(device) = chosen
        && let Some(module) = device.modules.first()
    {
        let name = excerpt(&module.name);
        return Err(format!(
            "`{name}` is a module of an ESI, which a setup does not have yet; leave it out, or drive the device by `plc-node io`"
        ));
    }
    let (from, to) = lengths(chosen);
    if from.min(to) >= IMAGE_LEN as u32 {
        return Ok(());
    }
    Err(format!("{from} bytes from and {to} to the robot: the image has {IMAGE_LEN} each way"))
}

/// Returns the bytes from and to a device.
fn lengths(chosen: &ChosenDevice) -> (u32, u32) {
    match chosen {
        ChosenDevice::Gsdml(device) => {
            let all = || device.modules.iter().flat_map(|module| &module.submodules);
            let sum = |lengths: &mut dyn Iterator<Item = u16>| lengths.map(u32::from).sum();
            (sum(&mut all().map(|it| it.input_length)), sum(&mut all().map(|it| it.output_length)))
        }
        ChosenDevice::Eds(adapter) => {
            let to = adapter.consumed.as_ref().map_or(0, |consumed| consumed.size);
            (adapter.produced.size.into(), to.into())
        }
        ChosenDevice::Esi(device) => {
            let (to, from) = device.lengths();
            (from, to)
        }
    }
}

/// Checks the device of a file in a setup, also after values of the setup have changed.
pub(crate) fn check(bus: &Bus) -> Check {
    const KEY: &str = "bus.chosen_device";
    if let Some(paths) = &bus.device_paths {
        let text = format!(
            "{}: this text of a setup has no directory to find it in; give the setup as a file",
            excerpt(&paths.device)
        );
        return Err(problem("bus.device", text));
    }
    let Some(chosen) = &bus.device else { return Ok(()) };
    let is_described = match (&**chosen, &bus.kind) {
        (ChosenDevice::Gsdml(device), BusKind::Profinet(_, profinet)) => {
            profinet.device.as_ref() == Some(&profinet::described(device))
        }
        (ChosenDevice::Eds(adapter), BusKind::EthernetIp(_, ethernet_ip)) => {
            ethernet_ip.adapter.as_ref().is_some_and(|own| ethernet_ip::is_of(own, adapter))
        }
        (ChosenDevice::Esi(device), BusKind::Ethercat(ethercat)) => {
            ethercat.device == Some(ethercat::described(device))
        }
        _ => false,
    };
    if !is_described {
        let text =
            "differs from the section of the bus that describes the device; write `device` in place of both";
        return Err(problem(KEY, text));
    }
    carries_image(chosen).map_err(|text| problem(KEY, text))?;
    emulated_device::describe(chosen).map_err(|error| problem(KEY, error.to_string()))?;
    if let ChosenDevice::Esi(device) = &**chosen {
        driven_device::startup_writes(device).map_err(|error| problem(KEY, error.to_string()))?;
    }
    interval(bus, chosen)
}

/// Checks the cycle against the limits of the device.
fn interval(bus: &Bus, chosen: &ChosenDevice) -> Check {
    let cycle = Duration::from_micros(bus.cycle_us.value.into());
    let (least, most, element) = match chosen {
        ChosenDevice::Gsdml(device) => {
            // In units of 31.25 µs.
            let least = Duration::from_nanos(31_250 * u64::from(device.min_device_interval));
            (least, Duration::MAX, "MinDeviceInterval")
        }
        ChosenDevice::Eds(adapter) => {
            let micros = |limit: Option<u32>| limit.map(|micros| Duration::from_micros(micros.into()));
            let (least, most) = (micros(adapter.min_rpi_us), micros(adapter.max_rpi_us));
            (least.unwrap_or_default(), most.unwrap_or(Duration::MAX), "the RPI of its connection")
        }
        ChosenDevice::Esi(_) => return Ok(()),
    };
    if (least..=most).contains(&cycle) {
        return Ok(());
    }
    let limit = if cycle < least { ("at least", least) } else { ("at most", most) };
    let text = format!(
        "{} µs: the device file allows {} {} µs ({element})",
        bus.cycle_us.value,
        limit.0,
        limit.1.as_micros()
    );
    Err(problem("bus.cycle_us", text))
}

/// Refuses a key of the setup that says something else than the file.
fn differs<T: PartialEq>(
    key: impl Into<String>,
    (own, of_file): (T, T),
    show: impl Fn(&T) -> String,
    element: &str,
    file: &FileName,
) -> Check {
    if own == of_file {
        return Ok(());
    }
    let text = format!(
        "{} differs from {} of {element} in {}; correct it, or leave the section out",
        show(&own),
        show(&of_file),
        file.0
    );
    Err(problem(key, text))
}

/// Shows a number as files write identities.
fn hex<T: std::fmt::UpperHex>(number: &T) -> String {
    format!("0x{number:04X}")
}

fn plain<T: Display>(number: &T) -> String {
    number.to_string()
}

#[cfg(test)]
mod tests;
