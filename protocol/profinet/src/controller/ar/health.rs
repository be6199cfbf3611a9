//! Health of a device, as its alarms and the DataStatus of its frames show it.

use core::fmt;

use machine::{Duration, Instant, LinkEvent};

use super::{Acyclic, Ar};
use crate::alarm::Notification;
use crate::record::{DiagnosisItem, diagnosis_items};
use crate::rt::DataStatus;

/// AlarmType (IEC 61158-6-10).
const DIAGNOSIS: u16 = 0x01;
const PROCESS: u16 = 0x02;
const PULL: u16 = 0x03;
const DIAGNOSIS_ENDS: u16 = 0x0C;
const PULL_MODULE: u16 = 0x1F;

/// Most faults that are named; of further ones only the number is known.
const MOST_FAULTS: usize = 8;

/// Least time between two reports of a change: a device whose state flutters fills no log.
const REPORT_AT_MOST_EACH: Duration = Duration::from_secs(1);

/// Source of an alarm: slot and subslot.
type Place = (u16, u16);

/// Faults that have appeared and not disappeared, and process alarms, on one connection.
#[derive(Default, Debug)]
pub(super) struct DeviceHealth {
    faults: [Option<(Place, DiagnosisItem)>; MOST_FAULTS],
    /// Faults beyond the named ones.
    more: u32,
    /// Place of the last process alarm, and number of all.
    process: Option<(Place, u32)>,
    /// Bits that a well device sets and the last frame had not.
    missing_bits: u8,
    /// True while a change has not been reported.
    has_changed: bool,
    /// Earliest time of the next report.
    quiet_until: Instant,
}

impl DeviceHealth {
    /// Takes over what an alarm says.
    pub(super) fn note(&mut self, notification: &Notification<'_>) {
        let head = &notification.head;
        self.has_changed |=
            matches!(head.alarm_type, DIAGNOSIS | PROCESS | PULL | DIAGNOSIS_ENDS | PULL_MODULE);
        let place = (head.slot, head.subslot);
        match head.alarm_type {
            PROCESS => {
                let number = self.process.map_or(0, |(_, number)| number);
                self.process = Some((place, number.saturating_add(1)));
            }
            PULL => self.remove(|at| at == place),
            PULL_MODULE => self.remove(|at| at.0 == place.0),
            DIAGNOSIS | DIAGNOSIS_ENDS => {
                let ends = head.alarm_type == DIAGNOSIS_ENDS;
                let Some((identifier, data)) = notification.items.split_first_chunk() else {
                    // The whole submodule is well again.
                    if ends {
                        self.remove(|at| at == place);
                    }
                    return;
                };
                for item in diagnosis_items(u16::from_be_bytes(*identifier), data) {
                    self.note_item(place, item, ends || item.disappears());
                }
            }
            _ => {}
        }
    }

    fn note_item(&mut self, place: Place, item: DiagnosisItem, ends: bool) {
        let is_same = |(at, known): &(Place, DiagnosisItem)| *at == place && known.is_same_fault(&item);
        let known = self.faults.iter().position(|fault| fault.as_ref().is_some_and(is_same));
        let free = || self.faults.iter().position(Option::is_none);
        let named = known.or_else(|| if ends { None } else { free() });
        match named.and_then(|index| self.faults.get_mut(index)) {
            Some(fault) => *fault = (!ends).then_some((place, item)),
            None if ends => self.more = self.more.saturating_sub(1),
            None => self.more = self.more.saturating_add(1),
        }
    }

    fn remove(&mut self, is_gone: impl Fn(Place) -> bool) {
        for fault in &mut self.faults {
            fault.take_if(|(place, _)| is_gone(*place));
        }
    }

    /// Forgets the connection, but not when a change was last reported.
    pub(super) fn clear(&mut self) {
        *self = Self { quiet_until: self.quiet_until, ..Self::default() };
    }

    fn write(&self, status: DataStatus, words: &mut dyn fmt::Write) -> fmt::Result {
        let mut separator = "the device reports ";
        let mut begin =
            |words: &mut dyn fmt::Write| words.write_str(core::mem::replace(&mut separator, "; "));
        for ((slot, subslot), item) in self.faults.iter().flatten() {
            begin(words)?;
            write!(words, "a fault in slot {slot}, subslot {subslot}, {item}")?;
        }
        if self.more > 0 {
            begin(words)?;
            write!(words, "{} more faults", self.more)?;
        }
        if let Some(((slot, subslot), number)) = self.process {
            begin(words)?;
            write!(
                words,
                "a process alarm of slot {slot}, subslot {subslot}, number {number} on this connection"
            )?;
        }
        if !status.contains(DataStatus::NORMAL) {
            begin(words)?;
            write!(words, "a problem by its frames (DataStatus 0x{:02X}); look at its diagnosis", status.0)?;
        }
        if !status.contains(DataStatus::PRIMARY) {
            begin(words)?;
            write!(words, "that it is the backup of a redundant pair (DataStatus 0x{:02X})", status.0)?;
        }
        Ok(())
    }
}

impl Ar {
    /// Reports a change of the device's health after a frame with this status.
    pub(super) fn follow_health(&mut self, now: Instant, status: DataStatus) {
        let health = &mut self.health;
        let missing_bits = !status.0 & (DataStatus::NORMAL | DataStatus::PRIMARY);
        health.has_changed |= missing_bits != health.missing_bits;
        health.missing_bits = missing_bits;
        if health.has_changed && now >= health.quiet_until {
            (health.has_changed, health.quiet_until) = (false, now + REPORT_AT_MOST_EACH);
            self.acyclic = Acyclic::Active;
            self.events.push_back(LinkEvent::Health);
        }
    }

    /// Writes what is wrong with the device by its alarms and the status of its frames; nothing while it is well or not connected.
    ///
    /// # Errors
    /// That of the writer.
    pub fn remark(&self, words: &mut dyn fmt::Write) -> fmt::Result {
        match self.link.as_ref().filter(|_| self.up) {
            Some(link) => self.health.write(link.receiver.data_status(), words),
            None => Ok(()),
        }
    }
}
