//! The devices of one bus under one controller: an IO-Controller, a scanner or a MainDevice.

use device_files::{ChosenDevice, excerpt};
use machine::Instant;

use crate::config::{BusConfig, DriveError};
use crate::device::DrivenDevice;
use crate::file_device::FileDevice;
use crate::stack::{Stack, named, open};

/// A controller and its devices. Its events have the number of their device, from 0.
#[derive(Debug)]
pub struct DrivenBus {
    pub(crate) stack: Stack,
    pub(crate) devices: Vec<DrivenDevice>,
    pub(crate) next_tick: Instant,
    /// True if the owner may have changed outputs.
    pub(crate) is_touched: bool,
}

impl DrivenBus {
    /// Makes the controller, which looks for its devices from now on.
    ///
    /// # Errors
    ///
    /// The devices are of several buses, or two of them are one; the bus does not carry what file or settings of a device say,
    /// or a script does not fit its device.
    pub fn new(devices: Vec<FileDevice>, bus: &BusConfig, now: Instant) -> Result<Self, DriveError> {
        check_names(&devices)?;
        let (stack, opened) = open(&devices, bus, now)?;
        let count = devices.len();
        let made = devices.into_iter().zip(opened).map(|(device, opened)| {
            let name = device.name.clone();
            DrivenDevice::new(device, opened, now).map_err(|error| named(count, &name, error))
        });
        Ok(Self { devices: made.collect::<Result<_, _>>()?, stack, next_tick: now, is_touched: false })
    }

    /// Returns the devices.
    #[must_use]
    pub fn devices(&self) -> &[DrivenDevice] {
        &self.devices
    }

    /// Returns the devices, for commands. Poll the bus afterwards.
    pub fn devices_mut(&mut self) -> &mut [DrivenDevice] {
        self.is_touched = true;
        &mut self.devices
    }

    /// Sets an output by its name, in front of which is that of its device where several devices have such an output:
    /// `valves/2.1/Valve`.
    ///
    /// # Errors
    ///
    /// No device has the output or several have it, or the value does not fit it.
    pub fn set(&mut self, name: &str, value: &str) -> Result<(), DriveError> {
        let (device, name) = self.device_of("output", name, DrivenDevice::has_output)?;
        device.set(name, value)
    }

    /// Reads a parameter by its name, as [`set`](Self::set) has names. Its answer is an event of its device.
    ///
    /// # Errors
    ///
    /// No device has it or several have it, or too many accesses wait.
    pub fn read_parameter(&mut self, name: &str) -> Result<(), DriveError> {
        let (device, name) = self.device_of("parameter", name, DrivenDevice::has_parameter)?;
        device.read_parameter(name)
    }

    /// Writes a parameter by its name, as [`set`](Self::set) has names. Its answer is an event of its device.
    ///
    /// # Errors
    ///
    /// No device has it or several have it, it is read-only, the value does not fit, or too many accesses wait.
    pub fn write_parameter(&mut self, name: &str, value: &str) -> Result<(), DriveError> {
        let (device, name) = self.device_of("parameter", name, DrivenDevice::has_parameter)?;
        device.write_parameter(name, value)
    }

    /// Starts or stops the outputs of the device of this name, or of all devices.
    ///
    /// # Errors
    ///
    /// No device has the name.
    pub fn run(&mut self, name: Option<&str>, is_running: bool) -> Result<(), DriveError> {
        let names = self.devices.iter().map(|device| device.name.as_str());
        let Some(name) = name else {
            self.devices_mut().iter_mut().for_each(|device| device.run(is_running));
            return Ok(());
        };
        let number = self.devices.iter().position(|device| device.name.eq_ignore_ascii_case(name));
        let unknown = || DriveError::unknown("device", name, names);
        let number = number.ok_or_else(unknown)?;
        if let Some(device) = self.devices_mut().get_mut(number) {
            device.run(is_running);
        }
        Ok(())
    }

    /// Ends all connections as the bus requires; [`DriveEvent::Down`](crate::DriveEvent::Down) reports each end.
    pub fn disconnect(&mut self, now: Instant) {
        for (number, device) in self.devices.iter_mut().enumerate() {
            device.is_leaving = true;
            self.stack.disconnect(now, number);
        }
    }

    /// Returns the name of the bus.
    #[must_use]
    pub const fn bus(&self) -> &'static str {
        self.stack.bus()
    }

    /// Returns the device that a name is of, and the name without that of the device. The name of the device may be left out
    /// if no other device has what is named.
    fn device_of<'n>(
        &mut self,
        kind: &'static str,
        name: &'n str,
        has: impl Fn(&DrivenDevice, &str) -> bool,
    ) -> Result<(&mut DrivenDevice, &'n str), DriveError> {
        let after = |device: &DrivenDevice| {
            let (before, rest) = name.split_at_checked(device.name.len())?;
            rest.strip_prefix('/').filter(|_| before.eq_ignore_ascii_case(&device.name))
        };
        let numbered = || self.devices.iter().enumerate();
        let prefixed = numbered().filter_map(|(number, it)| Some((it.name.len(), number, after(it)?)));
        // Of `a` and `a/b` the longer one.
        let place = match prefixed.max_by_key(|(len, ..)| *len) {
            // The only device may have a signal whose name begins with its own.
            Some((_, number, rest))
                if self.devices.len() > 1 || !self.devices.iter().any(|it| has(it, name)) =>
            {
                Some((number, rest))
            }
            _ if self.devices.len() == 1 => Some((0, name)),
            _ => {
                let mut having = numbered().filter(|(_, it)| has(it, name)).map(|(number, _)| (number, name));
                having.next().filter(|_| having.next().is_none())
            }
        };
        let Some((number, name)) = place else { return Err(self.which_device(kind, name, has)) };
        self.is_touched = true;
        let device = self.devices.get_mut(number);
        device.map(|device| (device, name)).ok_or_else(|| DriveError::unknown(kind, name, []))
    }

    fn which_device(
        &self,
        kind: &'static str,
        name: &str,
        has: impl Fn(&DrivenDevice, &str) -> bool,
    ) -> DriveError {
        let having: Vec<_> = self.devices.iter().filter(|it| has(it, name)).collect();
        let fault = if having.is_empty() { "no device has it" } else { "several devices have it" };
        let examples: Vec<_> = if having.is_empty() { self.devices.iter().collect() } else { having };
        let examples = examples.iter().take(MOST_EXAMPLES);
        let examples: Vec<_> =
            examples.map(|device| format!("{}/{}", excerpt(&device.name), excerpt(name))).collect();
        DriveError::WhichDevice { kind, name: excerpt(name), fault, examples: examples.join(", ") }
    }
}

/// Devices that a message names.
const MOST_EXAMPLES: usize = 4;

/// Refuses two devices of one name, and two that are one.
fn check_names(devices: &[FileDevice]) -> Result<(), DriveError> {
    for (number, device) in devices.iter().enumerate() {
        for other in devices.iter().take(number) {
            let name = excerpt(&device.name);
            if other.name.eq_ignore_ascii_case(&device.name) {
                return Err(DriveError::Twice(format!(
                    "two devices are called `{name}`; give each its own name"
                )));
            }
            if let Some(what) = is_one(device, other) {
                let other = excerpt(&other.name);
                return Err(DriveError::Twice(format!(
                    "devices `{other}` and `{name}` have one {what}; give each its own, or leave one out"
                )));
            }
        }
    }
    Ok(())
}

/// Returns what two devices share that makes them one.
fn is_one(device: &FileDevice, other: &FileDevice) -> Option<&'static str> {
    let (config, of_other) = (&device.config, &other.config);
    match (&device.chosen, &other.chosen) {
        (ChosenDevice::Eds(chosen), ChosenDevice::Eds(of_it)) => {
            let is_same =
                config.device_address == of_other.device_address && chosen.connection == of_it.connection;
            is_same.then_some("address and one connection")
        }
        (ChosenDevice::Gsdml(_), ChosenDevice::Gsdml(_)) => {
            let is_same = |name: &Option<String>| *name == config.station_name && name.is_some();
            is_same(&of_other.station_name).then_some("station name")
        }
        (ChosenDevice::Esi(_), ChosenDevice::Esi(_)) => {
            (config.position.is_some() && config.position == of_other.position).then_some("position")
        }
        _ => None,
    }
}
