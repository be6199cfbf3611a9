//! The methods for the owner of a device: data of the submodules, counters, the end of the connection.

use alloc::vec::Vec;

use machine::{Counters, Instant, LinkEvent};

use super::super::alarm::Notification;
use super::super::dcp::IpSuite;
use super::super::lldp::{Naming, Neighbour};
use super::super::provided::DataError;
use super::super::record::{Diagnosis, Maintenance};
use super::super::requests::Requests;
use super::super::rpc::LONGEST_BODY;
use super::super::status::Violation;
use super::relation::Relation;
use super::{AlarmError, Core, Device};

impl Device {
    /// Takes records of up to 64 KiB, also several in a MultipleWrite; without this, requests of up to 8 KiB. Call it at the start.
    pub fn accept_long_records(&mut self) {
        self.requests = Requests::with_capacity(LONGEST_BODY);
    }

    /// Returns whether a controller has an AR with this device, whether or not data are exchanged yet.
    #[must_use]
    pub const fn has_controller(&self) -> bool {
        self.core.relation.is_some()
    }

    /// Returns the newest output data of a submodule; `None` while the device is not up, or while the controller marks
    /// them as bad.
    #[must_use]
    pub fn output(&self, slot: u16, subslot: u16) -> Option<&[u8]> {
        self.outputs().find_map(|(place, data)| (place == (slot, subslot)).then_some(data)).flatten()
    }

    /// Returns the newest output data of every submodule that has data, as ((slot, subslot), data) by ascending slot and
    /// subslot; `None` for data that the controller marks as bad. Empty while the device is not up.
    pub fn outputs(&self) -> impl Iterator<Item = ((u16, u16), Option<&[u8]>)> {
        self.core.relation.iter().flat_map(Relation::outputs)
    }

    /// Sets the input data of a submodule, for the next cyclic frame and every one after it. Until then they are zeros.
    pub fn set_input(&mut self, slot: u16, subslot: u16, data: &[u8]) -> Result<(), DataError> {
        self.core.inputs.set(slot, subslot, data)?;
        self.core.write_inputs();
        Ok(())
    }

    /// Sets the input data of all submodules: calls `write` with slot, subslot and place of each, by ascending slot and
    /// subslot.
    pub fn set_inputs(&mut self, write: impl FnMut(u16, u16, &mut [u8])) {
        self.core.inputs.set_all(write);
        self.core.write_inputs();
    }

    /// Sets the diagnosis of the device, for controllers that read its diagnosis. An alarm tells the connected one of a change.
    pub fn set_diagnosis(&mut self, diagnosis: Vec<Diagnosis>) {
        self.core.diagnosis = diagnosis;
    }

    /// Sends an alarm to the controller: one at a time for each priority, repeated until it is received. The device numbers it:
    /// the low eleven bits of its specifier are ignored.
    ///
    /// # Errors
    ///
    /// No controller exchanges data, its items are too long, or too many alarms wait.
    pub fn raise(&mut self, alarm: &Notification<'_>) -> Result<(), AlarmError> {
        let relation = self.core.relation.as_mut().filter(|relation| relation.is_up);
        relation.ok_or(AlarmError::NoController)?.alarms.raise(alarm)?;
        self.core.acyclic = true;
        Ok(())
    }

    /// Returns the station at the other end of the cable; `None` if none announced itself by LLDP, or not for a while.
    #[must_use]
    pub fn neighbour(&self) -> Option<&Neighbour> {
        self.core.station.neighbour()
    }

    /// Ends the connection by an error PDU.
    pub fn disconnect(&mut self, now: Instant) {
        self.core.abort(now, Violation::AbortRequested);
    }

    /// Returns the numbers of frames that were sent, received and refused since the start.
    #[must_use]
    pub fn counters(&self) -> Counters {
        self.core.counters()
    }

    /// Returns the number of cyclic frames received since the start.
    #[must_use]
    pub fn received(&self) -> u64 {
        let of_relation = self.core.relation.as_ref().map_or(0, |relation| relation.receiver.received());
        self.core.counters.received + of_relation
    }

    /// Reports that the owner did what [`LinkEvent::SetAddress`] asked for, or could not.
    pub fn address_set(&mut self, now: Instant, done: bool) {
        self.core.acyclic = true;
        let (changed, step) = self.core.station.address_set(now, done);
        self.core.claim_address(now);
        if changed {
            self.core.station.set_conflict(false);
            self.core.abort(now, Violation::AddressChanged);
        }
        self.core.ask_owner(now, step);
    }

    /// Returns what the owner has to store permanently at [`LinkEvent::Store`]: the station name; IP address, mask and
    /// gateway; and I&M1 to 4. `None` for what it has to remove from its storage.
    #[must_use]
    pub fn to_store(&self) -> (Option<&[u8]>, Option<IpSuite>, Option<&Maintenance>) {
        self.core.station.to_store()
    }

    /// Reports that the owner did what [`LinkEvent::Store`] asked for, or could not.
    pub fn stored(&mut self, now: Instant, done: bool) {
        self.core.acyclic = true;
        if self.core.station.stored(now, done) {
            self.core.abort(now, Violation::StationNameChanged);
        }
    }
}

impl Core {
    /// Sets how the station is named to its neighbour.
    pub(super) fn set_naming(&mut self, now: Instant, naming: Naming) {
        self.station.set_naming(now, naming);
        self.acyclic = true;
    }

    /// Reports as an event that the owner has to store something, unless that event is waiting.
    pub(super) fn ask_to_store(&mut self) {
        if !self.events.contains(&LinkEvent::Store) {
            self.report(LinkEvent::Store);
        }
    }
}
