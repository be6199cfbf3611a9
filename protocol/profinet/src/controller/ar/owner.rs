//! The methods for the owner of an AR: its data, its state, its end.

use core::fmt;

use machine::{Counters, Instant};

use super::Ar;
use super::acyclic::Acyclic;
use crate::connect::DiffModule;
use crate::provided::DataError;

impl Ar {
    /// Returns whether data are exchanged in both directions.
    #[must_use]
    pub const fn is_up(&self) -> bool {
        self.up
    }

    /// Returns the differences between the device's modules and the description, by the answer to the last Connect or the
    /// ApplicationReady after it; empty if there are none.
    #[must_use]
    pub fn module_diff(&self) -> &[DiffModule] {
        &self.diff
    }

    /// Writes what the device says of itself by DCP: its name, MAC address and identity; nothing before it was found.
    ///
    /// # Errors
    ///
    /// That of the writer.
    pub fn write_identity(&self, words: &mut dyn fmt::Write) -> fmt::Result {
        let Some(mac) = self.discovery.device() else { return Ok(()) };
        write!(words, "`{}` ({mac})", self.discovery.name().escape_ascii())?;
        match self.discovery.identity() {
            Some((vendor, device)) => {
                write!(words, ", VendorID 0x{vendor:04X}, DeviceID 0x{device:04X}")
            }
            None => words.write_str(", which reports no VendorID and DeviceID"),
        }
    }

    /// Returns the numbers of frames of this AR since its start.
    #[must_use]
    pub fn counters(&self) -> Counters {
        let mut counters = self.counters;
        if let Some(link) = &self.link {
            link.count(&mut counters);
        }
        counters
    }

    /// Returns the newest input data of a submodule; `None` while the AR is not up, or while the device marks them as
    /// bad.
    #[must_use]
    pub fn input(&self, slot: u16, subslot: u16) -> Option<&[u8]> {
        self.plan.layout.input.data(self.c_sdu()?, slot, subslot)
    }

    /// Returns the newest input data of every submodule that has data, as ((slot, subslot), data) by ascending slot and
    /// subslot; `None` for data that the device marks as bad. Empty while the AR is not up.
    pub fn inputs(&self) -> impl Iterator<Item = ((u16, u16), Option<&[u8]>)> {
        self.c_sdu().into_iter().flat_map(|c_sdu| self.plan.layout.input.all_data(c_sdu))
    }

    fn c_sdu(&self) -> Option<&[u8]> {
        self.link.as_ref().filter(|_| self.up)?.receiver.usable_data()
    }

    /// Sets the output data of a submodule, for the next cyclic frame and every one after it. Until then they are zeros,
    /// and bad.
    pub fn set_output(&mut self, slot: u16, subslot: u16, data: &[u8]) -> Result<(), DataError> {
        self.output.set(slot, subslot, data)?;
        self.write_output();
        Ok(())
    }

    /// Sets the output data of all submodules: calls `write` with slot, subslot and place of each, by ascending slot and
    /// subslot.
    pub fn set_outputs(&mut self, write: impl FnMut(u16, u16, &mut [u8])) {
        self.output.set_all(write);
        self.write_output();
    }

    /// Sets the output data of those submodules for which `write` returns true, by ascending slot and subslot; the others stay
    /// as they are.
    pub fn set_outputs_of(&mut self, write: impl FnMut(u16, u16, &mut [u8]) -> bool) {
        self.output.set_some(write);
        self.write_output();
    }

    /// Takes all output data back: from the next cyclic frame on they are zeros and bad.
    pub fn withdraw_outputs(&mut self) {
        self.output.withdraw();
        self.write_output();
    }

    /// Releases the AR as the standard requires, or gives up the attempt to connect. [`LinkEvent::Down`](machine::LinkEvent::Down) reports the end;
    /// nothing is sent afterwards.
    pub fn disconnect(&mut self, now: Instant) {
        self.acyclic = Acyclic::Active;
        self.release(now);
    }
}
