//! The machine: a stack of the bus, the script over time, and the faults between driver and stack.

use std::collections::VecDeque;
use std::net::Ipv4Addr;

use device_files::ChosenDevice;
use ethercat_subdevice::{AlState, AlStatusCode};
use machine::{Counters, Instant, LinkEvent, StreamId};
use profinet::Permanent;

use crate::config::{EmulationConfig, EmulationError};
use crate::faults::{Alteration, FaultPhase, HeldFrames, TimedFault};
use crate::image::{DataPlace, Image};
use crate::playback::PlacedInput;
use crate::script::{DeviceScript, FaultKind, ScriptError, ScriptedFault, ScriptedInput};
use crate::stack::{Stack, idents, open};

/// Event of an emulated device.
#[derive(Clone, PartialEq, Debug)]
pub enum DeviceEvent {
    /// Change of the connection, or a task for the owner.
    Link(LinkEvent),
    /// EtherCAT: state and error.
    State(AlState, AlStatusCode),
    /// EtherCAT: index and subindex of an object that was written.
    ObjectWritten(u16, u8),
    /// The outputs changed, or became valid or invalid.
    Outputs,
    /// A fault began (true) or ended.
    Fault(FaultKind, bool),
}

/// The device of a file, as a machine.
#[derive(Debug)]
pub struct EmulatedDevice {
    pub(crate) chosen: ChosenDevice,
    pub(crate) config: EmulationConfig,
    pub(crate) stack: Stack,
    pub(crate) alteration: Alteration,
    pub(crate) inputs: Image,
    pub(crate) outputs: Image,
    pub(crate) playback: Vec<PlacedInput>,
    pub(crate) faults: Vec<TimedFault>,
    pub(crate) held: HeldFrames,
    pub(crate) start: Instant,
    pub(crate) next_tick: Instant,
    pub(crate) events: VecDeque<DeviceEvent>,
    pub(crate) streams: Vec<StreamId>,
    pub(crate) closing: VecDeque<StreamId>,
    /// EtherCAT: true if another SubDevice comes after this one.
    pub(crate) leads_on: bool,
}

impl EmulatedDevice {
    /// Makes the device, which starts now.
    ///
    /// # Errors
    ///
    /// The device has a form that the stack does not have, or the script does not fit it.
    pub fn new(
        chosen: ChosenDevice,
        script: DeviceScript,
        config: EmulationConfig,
        now: Instant,
    ) -> Result<Self, EmulationError> {
        let alteration = Alteration::default();
        let (stack, inputs, outputs) = open(&chosen, &alteration, &config, now)?;
        let mut device = Self {
            chosen,
            config,
            stack,
            alteration,
            inputs,
            outputs,
            playback: Vec::new(),
            faults: Vec::new(),
            held: HeldFrames::default(),
            start: now,
            next_tick: now,
            events: VecDeque::new(),
            streams: Vec::new(),
            closing: VecDeque::new(),
            leads_on: false,
        };
        script.inputs.into_iter().try_for_each(|input| device.set_input(input))?;
        script.faults.into_iter().try_for_each(|fault| device.add_fault(fault, now))?;
        Ok(device)
    }

    /// Sets an input from now on, over what the script writes there.
    ///
    /// # Errors
    ///
    /// The device does not have the place, or the value does not fit into it.
    pub fn set_input(&mut self, input: ScriptedInput) -> Result<(), ScriptError> {
        let placed = PlacedInput::new(input, &self.inputs, &self.outputs)?;
        self.playback.retain(|known| !known.is_at(&placed));
        self.playback.push(placed);
        Ok(())
    }

    /// Adds a fault, whose times count from `from`.
    ///
    /// # Errors
    ///
    /// A device on this bus does not have such a fault, or not the place.
    pub fn add_fault(&mut self, fault: ScriptedFault, from: Instant) -> Result<(), ScriptError> {
        fault.check()?;
        self.check_fault(&fault)?;
        self.faults.retain(|known| known.phase != FaultPhase::Over);
        self.faults.push(TimedFault::new(fault, from));
        Ok(())
    }

    fn check_fault(&self, fault: &ScriptedFault) -> Result<(), ScriptError> {
        let kind = fault.kind;
        let bus = match kind {
            FaultKind::Alarm | FaultKind::ModuleGone => Some("PROFINET"),
            FaultKind::Emergency | FaultKind::OutOfOp | FaultKind::WorkingCounter => Some("EtherCAT"),
            kind if kind.mail_fault().is_some() => Some("EtherCAT"),
            _ => None,
        };
        if let Some(bus) = bus.filter(|bus| *bus != self.bus()) {
            return Err(ScriptError::new(format!("fault {kind:?} is only on {bus}; leave it out")));
        }
        if kind == FaultKind::WrongSize && self.inputs.bytes.is_empty() {
            return Err(ScriptError::new(
                "fault WrongSize: the device has no inputs; leave it out".to_owned(),
            ));
        }
        if let ChosenDevice::Gsdml(device) = &self.chosen {
            let is_missing = |slot| device.modules.iter().all(|module| module.slot != slot);
            if kind == FaultKind::ModuleGone && (fault.slot == 0 || is_missing(fault.slot)) {
                return Err(ScriptError::new(format!(
                    "fault ModuleGone: slot {} has no module; correct it",
                    fault.slot
                )));
            }
            if kind == FaultKind::Alarm && idents(device, fault).is_none() {
                let (slot, subslot) = (fault.slot, fault.subslot);
                return Err(ScriptError::new(format!(
                    "fault Alarm: subslot {slot}.{subslot} is empty; correct it"
                )));
            }
        }
        Ok(())
    }

    /// Returns the name of the bus.
    #[must_use]
    pub const fn bus(&self) -> &'static str {
        match self.stack {
            Stack::Profinet(_) => "PROFINET",
            Stack::EthernetIp(_) => "EtherNet/IP",
            Stack::Ethercat(..) => "EtherCAT",
        }
    }

    /// Returns the places of the inputs and of the outputs.
    #[must_use]
    pub fn places(&self) -> (&[DataPlace], &[DataPlace]) {
        (&self.inputs.places, &self.outputs.places)
    }

    /// Returns the bytes of an input place.
    #[must_use]
    pub fn input(&self, place: &str) -> Option<&[u8]> {
        self.inputs.of_place(place)
    }

    /// Returns the newest bytes of an output place; `None` while the controller sends none that count.
    #[must_use]
    pub fn output(&self, place: &str) -> Option<&[u8]> {
        self.outputs.of_place(place).filter(|_| self.outputs.does_count(place))
    }

    /// Returns all outputs, one place after another, and whether those of any place count.
    #[must_use]
    pub fn outputs(&self) -> (&[u8], bool) {
        (&self.outputs.bytes, self.outputs.has_data())
    }

    /// Returns the station name of PROFINET now.
    #[must_use]
    pub fn station_name(&self) -> Option<&[u8]> {
        match &self.stack {
            Stack::Profinet(device) => Some(device.station_name()),
            _ => None,
        }
    }

    /// Returns the counters of the stack since it started.
    #[must_use]
    pub fn counters(&self) -> Option<Counters> {
        match &self.stack {
            Stack::Profinet(device) => Some(device.counters()),
            Stack::EthernetIp(adapter) => Some(adapter.counters()),
            Stack::Ethercat(..) => None,
        }
    }

    /// Reports that the owner set the address of [`LinkEvent::SetAddress`], or could not.
    pub fn address_set(&mut self, now: Instant, address: Option<Ipv4Addr>, mask: Ipv4Addr) {
        if let Stack::Profinet(device) = &mut self.stack {
            device.address_set(now, address.is_some());
            if address.is_some() {
                (self.config.address, self.config.mask) = (address, mask);
            }
        }
    }

    /// Handles [`LinkEvent::Store`]: keeps name and address as long as the program runs.
    pub fn keep(&mut self, now: Instant) {
        if let Stack::Profinet(device) = &mut self.stack {
            let (name, address, maintenance) = device.to_store();
            let permanent =
                Permanent { name: name.map(<[u8]>::to_vec), address, maintenance: maintenance.copied() };
            self.config.permanent = Some(permanent);
            device.stored(now, true);
        }
    }
}
