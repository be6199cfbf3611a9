//! The owner of emulated devices: passes their events to the printer, and instructions to the devices.

use std::fmt;
use std::net::Ipv4Addr;
use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender};

use arrayvec::ArrayVec;
use emulated_device::{DeviceEvent, EmulatedDevice, EmulatedDevices, ScriptedFault, ScriptedInput};
use machine::{Instant, LinkEvent};
use node::Outcome;
use protocol_linux::{Interface, Owner, Statistics};
use serde::Deserialize;
use serde_json::json;

/// Bytes of outputs that a report shows.
const MOST_SHOWN: usize = 512;

/// Instruction from standard input.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum EmulationInstruction {
    /// Sets an input.
    Set(ScriptedInput),
    /// Begins a fault, whose time counts from now.
    Fault(ScriptedFault),
}

/// Instruction, and the device that it is for.
#[derive(Clone, Debug, Deserialize)]
pub(super) struct AddressedInstruction {
    /// Number of the device, from 1; the only one needs none.
    device: Option<usize>,
    #[serde(flatten)]
    instruction: EmulationInstruction,
}

/// Line that is printed.
#[derive(Clone, Debug)]
#[expect(clippy::large_enum_variant, reason = "a report is made without an allocation")]
pub(super) enum Report {
    /// An event of the device, and the station name it has then.
    Event(DeviceEvent),
    /// The outputs, their length, and whether they count.
    Outputs(ArrayVec<u8, MOST_SHOWN>, usize, bool),
    /// The address that the controller gave.
    Address(Ipv4Addr, bool),
    /// An instruction that was refused.
    Refused(String),
}

pub(super) struct EmulationOwner {
    /// Interfaces of the devices; one for all devices of an EtherCAT cable.
    pub(super) interfaces: Vec<Interface>,
    /// Reports with the number of their device, from 0.
    pub(super) reports: SyncSender<(usize, Report)>,
    pub(super) instructions: Receiver<AddressedInstruction>,
    /// Set by a signal that asks the devices to end.
    pub(super) is_stopped: Arc<AtomicBool>,
    /// How the devices ended.
    pub(super) outcome: Outcome,
    pub(super) end: Option<Instant>,
}

impl EmulationOwner {
    /// Passes a report on. One that finds no room is lost, so that the devices go on.
    fn report(&self, number: usize, report: Report) {
        let _ = self.reports.try_send((number, report));
    }

    fn instruct(&self, now: Instant, devices: &mut EmulatedDevices, addressed: AddressedInstruction) {
        let AddressedInstruction { device, instruction } = addressed;
        let count = devices.devices().len();
        let number = match device {
            Some(number @ 1..) if number <= count => number - 1,
            None if count == 1 => 0,
            _ => {
                let reason = format!("`device` must be the number of a device, 1 to {count}");
                return self.report(0, Report::Refused(reason));
            }
        };
        let done = devices.change(number, |device| match instruction {
            EmulationInstruction::Set(input) => device.set_input(input),
            EmulationInstruction::Fault(fault) => device.add_fault(fault, now),
        });
        if let Some(Err(error)) = done {
            self.report(number, Report::Refused(error.to_string()));
        }
    }
}

impl Owner<EmulatedDevices> for EmulationOwner {
    fn wake(&mut self, now: Instant, devices: &mut EmulatedDevices, _: &Statistics) -> ControlFlow<()> {
        while let Ok(instruction) = self.instructions.try_recv() {
            self.instruct(now, devices, instruction);
        }
        if self.is_stopped.load(Ordering::Relaxed) {
            self.outcome = Outcome::Interrupted;
            return ControlFlow::Break(());
        }
        match self.end {
            Some(end) if end <= now => ControlFlow::Break(()),
            _ => ControlFlow::Continue(()),
        }
    }

    fn event(
        &mut self,
        now: Instant,
        devices: &mut EmulatedDevices,
        (number, event): (usize, DeviceEvent),
    ) -> ControlFlow<()> {
        match event {
            DeviceEvent::Link(LinkEvent::SetAddress { address, mask, .. }) => {
                let interface = self.interfaces.get(number);
                let done = interface.is_some_and(|interface| interface.set_address(address, mask).is_ok());
                devices.change(number, |device| device.address_set(now, done.then_some(address), mask));
                self.report(number, Report::Address(address, done));
            }
            DeviceEvent::Link(LinkEvent::Store) => {
                devices.change(number, |device| device.keep(now));
            }
            DeviceEvent::Outputs => {
                let outputs = devices.devices().get(number).map(EmulatedDevice::outputs);
                let Some((outputs, is_valid)) = outputs else { return ControlFlow::Continue(()) };
                let shown = outputs.iter().copied().take(MOST_SHOWN).collect();
                self.report(number, Report::Outputs(shown, outputs.len(), is_valid));
            }
            event => self.report(number, Report::Event(event)),
        }
        ControlFlow::Continue(())
    }

    fn deadline(&self) -> Option<Instant> {
        // The device's own tick wakes the thread for instructions and signals.
        self.end
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Event(DeviceEvent::Link(LinkEvent::Up)) => f.write_str("up: data are exchanged"),
            Self::Event(DeviceEvent::Link(LinkEvent::Down(down))) => write!(f, "down: {down}"),
            Self::Event(DeviceEvent::Link(LinkEvent::Owner(owner))) => write!(f, "{owner}"),
            Self::Event(DeviceEvent::Link(LinkEvent::Foreign(request))) => write!(f, "{request}"),
            Self::Event(DeviceEvent::Link(LinkEvent::Conflict(conflict))) => write!(f, "{conflict}"),
            Self::Event(DeviceEvent::Link(event)) => write!(f, "{event:?}"),
            Self::Event(DeviceEvent::State(state, code)) => write!(f, "state {state}, {code}"),
            Self::Event(DeviceEvent::ObjectWritten(index, subindex)) => {
                write!(f, "object 0x{index:04X}:{subindex:02X} was written")
            }
            Self::Event(DeviceEvent::Fault(kind, begins)) => {
                write!(f, "fault {kind:?} {}", if *begins { "begins" } else { "ends" })
            }
            Self::Event(DeviceEvent::Outputs) => Ok(()),
            Self::Outputs(bytes, len, is_valid) => {
                f.write_str(if *is_valid { "outputs " } else { "outputs without a controller " })?;
                bytes.iter().try_for_each(|byte| write!(f, "{byte:02x}"))?;
                if bytes.len() < *len { write!(f, "... ({len} bytes)") } else { Ok(()) }
            }
            Self::Address(address, true) => write!(f, "address {address}"),
            Self::Address(address, false) => write!(f, "address {address} cannot be set; run as root"),
            Self::Refused(reason) => write!(f, "refused: {reason}"),
        }
    }
}

impl Report {
    /// Returns the report as one JSON object.
    pub(super) fn to_json(&self) -> serde_json::Value {
        match self {
            Self::Outputs(bytes, len, is_valid) => {
                let hex: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
                json!({ "outputs": { "bytes": hex, "length": len, "is_valid": is_valid } })
            }
            Self::Event(DeviceEvent::State(state, code)) => {
                json!({ "state": { "name": state.to_string(), "code": code.0 } })
            }
            Self::Event(DeviceEvent::Link(LinkEvent::Up)) => json!({ "up": true }),
            Self::Event(DeviceEvent::Link(LinkEvent::Down(down))) => {
                json!({ "up": false, "reason": down.to_string() })
            }
            Self::Event(DeviceEvent::Fault(kind, begins)) => {
                json!({ "fault": { "kind": kind, "begins": begins } })
            }
            Self::Address(address, done) => {
                json!({ "address": { "address": address.to_string(), "is_set": done } })
            }
            Self::Refused(reason) => json!({ "refused": reason }),
            Self::Event(_) => json!({ "event": self.to_string() }),
        }
    }
}
