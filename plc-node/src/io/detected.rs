//! The modules that an EtherCAT device detects, read before its process data are configured.

use std::ops::ControlFlow;

use device_files::{ChosenSubDevice, SubDeviceHead};
use ethercat_maindevice::{Config, DetectedModule, ExpectedDevice, MainDevice, SubDeviceId};
use machine::ethernet::Mac;
use machine::{Duration, Instant, LinkEvent};
use protocol_linux::{Driver, Interface, Notifier, Owner, Statistics, clock};

use super::target_error::TargetError;
use crate::printable::printable;

/// Time between two looks for the list of modules.
const LOOK: Duration = Duration::from_millis(20);

/// Interval and watchdog of process data, which are not exchanged here.
const CYCLE: Duration = Duration::from_millis(2);
const WATCHDOG: Duration = Duration::from_millis(100);

/// Makes the MainDevice that reads the list of one device: at its position on the cable, from 1, or as the only one there.
fn module_search(
    head: SubDeviceHead,
    mac: Mac,
    position: Option<u16>,
    now: Instant,
) -> anyhow::Result<MainDevice> {
    let expected = ExpectedDevice {
        vendor: head.vendor_id,
        product: head.product_code,
        revision: None,
        output_bytes: 0,
        input_bytes: 0,
    };
    let config = Config { mac, devices: vec![expected], cycle: CYCLE, watchdog: WATCHDOG };
    Ok(match position {
        Some(position) => MainDevice::at_positions(&[position.saturating_sub(1)], config, now)?,
        None => MainDevice::new(config, now).map_err(|error| anyhow::anyhow!("{error}"))?,
    })
}

/// Lists the modules of a device by slot.
pub(super) fn list_modules(device: &ChosenSubDevice) -> String {
    let modules = device.modules.iter();
    let listed: Vec<_> = modules
        .map(|it| format!("slot {} {} (0x{:08X})", it.slot, printable(it.kind.as_bytes()), it.ident))
        .collect();
    if listed.is_empty() { "none".to_owned() } else { listed.join(", ") }
}

/// Takes a SubDevice to PRE-OP, and reads which modules it detects; the reason if it does not list them.
pub(super) fn detect_modules(
    head: SubDeviceHead,
    interface: &Interface,
    mac: Mac,
    position: Option<u16>,
    within: Duration,
) -> anyhow::Result<Result<Vec<(u8, u32)>, String>> {
    let mut machine = module_search(head, mac, position, clock::now())?;
    machine.ids().for_each(|id| machine.read_modules(id));
    let mut reader =
        DetectedModules { until: clock::now() + within, last: "it does not answer".to_owned(), found: None };
    let mut driver = Driver::new(machine, interface.clone(), Notifier::new()?)?;
    driver.run(&mut reader)?;
    let found = reader.found.ok_or(TargetError::NoModules(reader.last))?;
    Ok(found.map(|modules| modules.iter().map(|it| (it.slot, it.ident)).collect()))
}

/// Owner of the MainDevice by which modules are detected.
struct DetectedModules {
    until: Instant,
    /// Why there are none yet.
    last: String,
    found: Option<Result<Vec<DetectedModule>, String>>,
}

impl Owner<MainDevice> for DetectedModules {
    fn wake(&mut self, now: Instant, machine: &mut MainDevice, _: &Statistics) -> ControlFlow<()> {
        self.found = machine.take_modules(SubDeviceId(0));
        if self.found.is_some() || self.until <= now {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    }

    fn event(
        &mut self,
        _: Instant,
        machine: &mut MainDevice,
        (id, event): (SubDeviceId, LinkEvent),
    ) -> ControlFlow<()> {
        if let LinkEvent::Down(down) = event {
            let mut details = String::new();
            // A string takes every character.
            let _ = machine.explain(id, &mut details);
            self.last = format!("{down} {details}").trim_end().to_owned();
        }
        ControlFlow::Continue(())
    }

    fn deadline(&self) -> Option<Instant> {
        Some(self.until.min(clock::now() + LOOK))
    }
}
