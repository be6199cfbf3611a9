//! A device on a cable: its description, and what belongs to this device alone.

use machine::Duration;

use crate::description::Description;
use crate::dictionary::PdoConfiguration;
use crate::esc::LocalClock;
use crate::layout::SyncManagerLayout;

/// A device to be added to a segment.
#[derive(Clone, Copy, Debug)]
pub struct DeviceConfig {
    /// What it is.
    pub description: &'static Description,
    /// Its serial number.
    pub serial_number: u32,
    /// Its station alias; 0 for none.
    pub alias: u16,
    /// Which parts of its process data the MainDevice may choose.
    pub pdo_configuration: PdoConfiguration,
    /// Where its sync managers are, in the order of their numbers; empty for places that follow from the description. Their
    /// lengths are those of mailbox and process data. Several of one direction of process data have these one after another; this
    /// is for devices without a mailbox, as the object dictionary has one sync manager for each direction.
    pub sync_managers: &'static [SyncManagerLayout],
    /// True if it refuses SAFE-OP after another list of modules in object 0xF030 than that in 0xF050.
    pub checks_modules: bool,
    /// Content of its EEPROM; empty for one that follows from the description.
    pub eeprom: &'static [u8],
    /// Time that its application takes to follow a request for a state.
    pub answer_delay: Duration,
    /// Time that a command to its EEPROM takes.
    pub eeprom_delay: Duration,
    /// Time that a frame takes through it, each time it passes.
    pub forwarding_delay: Duration,
    /// Time that a frame takes on the cable towards the MainDevice, each way.
    pub cable_delay: Duration,
    /// The port with the cable towards the MainDevice, 0 to 3. Port 0 is the right one. By another one, frames still pass the
    /// device and come back, but later than those at its other ports, and marked as circulating if nothing is plugged into port 0.
    pub upstream_port: usize,
    /// Its local clock.
    pub clock: LocalClock,
}

impl DeviceConfig {
    /// Returns a device without serial number and alias and with fixed process data, that answers at once.
    #[must_use]
    pub const fn new(description: &'static Description) -> Self {
        Self {
            description,
            serial_number: 0,
            alias: 0,
            pdo_configuration: PdoConfiguration::Fixed,
            sync_managers: &[],
            checks_modules: false,
            eeprom: &[],
            answer_delay: Duration::ZERO,
            eeprom_delay: Duration::ZERO,
            forwarding_delay: Duration::ZERO,
            cable_delay: Duration::ZERO,
            upstream_port: 0,
            clock: LocalClock { start_ns: 0, error_ppb: 0 },
        }
    }
}
