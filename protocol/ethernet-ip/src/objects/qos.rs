//! QoS, class 48: the DSCP of each kind of traffic (volume 2, 5-7).

use super::super::Writer;
use super::super::cip::Violation;
use super::super::connection::Priority;
use super::{Device, Object, parse_exact};

/// DSCP values, 0 to 63. The driver writes them into the IP header.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(in super::super) struct Qos {
    urgent: u8,
    scheduled: u8,
    high: u8,
    low: u8,
    explicit: u8,
}

impl Default for Qos {
    /// Returns the defaults of volume 2, table 5-7.4.
    fn default() -> Self {
        Self { urgent: 55, scheduled: 47, high: 43, low: 31, explicit: 27 }
    }
}

impl Qos {
    /// Returns the DSCP of explicit messages.
    pub(in super::super) const fn explicit(&self) -> u8 {
        self.explicit
    }

    /// Returns the DSCP of cyclic data of this priority.
    pub(in super::super) const fn cyclic(&self, priority: Priority) -> u8 {
        match priority {
            Priority::Low => self.low,
            Priority::High => self.high,
            Priority::Scheduled => self.scheduled,
            Priority::Urgent => self.urgent,
        }
    }

    const fn value_mut(&mut self, attribute: u16) -> Option<&mut u8> {
        Some(match attribute {
            4 => &mut self.urgent,
            5 => &mut self.scheduled,
            6 => &mut self.high,
            7 => &mut self.low,
            8 => &mut self.explicit,
            _ => return None,
        })
    }
}

pub(super) struct QosObject;

impl Object for QosObject {
    const REVISION: u16 = 1;
    const ATTRIBUTES: &'static [u16] = &[4, 5, 6, 7, 8];

    fn get(
        device: &Device,
        _instance: u32,
        attribute: u16,
        writer: &mut Writer<'_>,
    ) -> Result<(), Violation> {
        let mut qos = device.qos;
        writer.u8(*qos.value_mut(attribute).ok_or(Violation::UnknownAttribute)?);
        Ok(())
    }

    fn set(device: &mut Device, _instance: u32, attribute: u16, data: &[u8]) -> Result<(), Violation> {
        let locked = device.locked;
        let place = device.qos.value_mut(attribute).ok_or(Violation::UnknownAttribute)?;
        match parse_exact(data)? {
            // After such a change, the frames of the owner's next connection would have no priority.
            [dscp @ 0..=63] if locked && dscp != *place => Err(Violation::InUse),
            [dscp @ 0..=63] => {
                *place = dscp;
                Ok(())
            }
            _ => Err(Violation::BadAttributeValue),
        }
    }
}
