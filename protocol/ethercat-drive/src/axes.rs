//! The controller's side of several drives that move together. It switches them on together, and if one of them stops by
//! itself, it stops the others.

use alloc::vec;
use alloc::vec::Vec;
use core::fmt;

use crate::axis::{Axis, Power, Wanted};
use crate::error_code::ErrorCode;
use crate::process_data::{INPUT_LEN, Inputs, OUTPUT_LEN};

/// Why an axis does not follow its targets any more.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Cause {
    /// The drive has a fault.
    Fault(ErrorCode),
    /// The drive stops without a command.
    QuickStop,
    /// The drive switched the torque off without a command.
    SwitchedOff,
}

/// An axis that stopped without a command.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct AxisError {
    /// Which axis, from 1.
    pub axis: usize,
    /// Why.
    pub cause: Cause,
}

impl fmt::Display for AxisError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { axis, cause } = self;
        match cause {
            Cause::Fault(code) => write!(f, "drive of axis {axis}: {code}"),
            Cause::QuickStop => write!(f, "drive of axis {axis}: it stopped without a command"),
            Cause::SwitchedOff => write!(f, "drive of axis {axis}: it switched itself off"),
        }
    }
}

/// Several drives.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Axes {
    axes: Vec<Axis>,
    wanted: Wanted,
    /// Whether all drives have been on at the same time since the owner wanted that.
    were_on: bool,
    error: Option<AxisError>,
}

impl Axes {
    /// Creates the controller's side of so many drives, off.
    #[must_use]
    pub fn new(count: usize) -> Self {
        Self { axes: vec![Axis::default(); count], wanted: Wanted::Off, were_on: false, error: None }
    }

    /// Returns the axes in the order of their drives.
    #[must_use]
    pub fn axes(&self) -> &[Axis] {
        &self.axes
    }

    /// Returns whether all drives follow their targets.
    #[must_use]
    pub fn are_on(&self) -> bool {
        self.wanted == Wanted::On && self.axes.iter().all(|axis| axis.power() == Power::On)
    }

    /// Returns whether no drive has torque, a fault, or a motor that still turns.
    #[must_use]
    pub fn are_off(&self) -> bool {
        self.axes.iter().all(|axis| axis.power() == Power::Off)
    }

    /// Returns the first axis that stopped without a command since the last reset.
    #[must_use]
    pub const fn error(&self) -> Option<AxisError> {
        self.error
    }

    /// Sets what all drives have to do. Only [`Wanted::Reset`] ends an error.
    pub fn want(&mut self, wanted: Wanted) {
        if wanted == Wanted::Reset {
            self.error = None;
        }
        if self.error.is_none() && wanted != self.wanted {
            (self.wanted, self.were_on) = (wanted, false);
        }
    }

    /// Takes the inputs of all drives and writes their next outputs. `targets` are in increments.
    ///
    /// Process data of another length are left as they are.
    pub fn cycle(&mut self, inputs: &[u8], targets: &[i32], outputs: &mut [u8]) {
        self.receive(inputs);
        self.send(targets, outputs);
    }

    /// Takes the inputs of all drives. If one of them stopped without a command, the others get a quick stop from
    /// now on.
    pub fn receive(&mut self, inputs: &[u8]) {
        let was_on = self.were_on;
        let mut stopped = None;
        for (index, (axis, inputs)) in self.axes.iter_mut().zip(inputs.chunks_exact(INPUT_LEN)).enumerate() {
            let Some(inputs) = Inputs::parse(inputs) else { continue };
            axis.receive(&inputs);
            let cause = match axis.power() {
                Power::Fault(code) if self.wanted != Wanted::Reset => Some(Cause::Fault(code)),
                Power::Stopping if was_on => Some(Cause::QuickStop),
                Power::Off if was_on => Some(Cause::SwitchedOff),
                _ => None,
            };
            stopped = stopped.or(cause.map(|cause| AxisError { axis: index + 1, cause }));
        }
        if self.error.is_none() && stopped.is_some() {
            (self.error, self.wanted, self.were_on) = (stopped, Wanted::QuickStop, false);
        }
        self.were_on |= self.are_on();
    }

    /// Writes the next outputs of all drives. `targets` are in increments.
    pub fn send(&mut self, targets: &[i32], outputs: &mut [u8]) {
        let places = outputs.chunks_exact_mut(OUTPUT_LEN).zip(targets);
        for (axis, (outputs, target)) in self.axes.iter_mut().zip(places) {
            outputs.copy_from_slice(&axis.send(self.wanted, *target).bytes());
        }
    }
}
