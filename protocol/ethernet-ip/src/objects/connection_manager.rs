//! Connection Manager, class 06: counters of the requests to open and close (volume 1, 3-5).

use super::super::Writer;
use super::super::cip::{Extended, Violation};
use super::{Device, Object, parse_exact};

/// Attributes 1 to 8.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub(in super::super) struct ManagerCounters {
    counts: [u16; 8],
}

impl ManagerCounters {
    /// Counts a Forward_Open and, if it was refused, the reason.
    pub(in super::super) fn opened(&mut self, refused: Option<Violation>) {
        let [requests, format, resource, other, ..] = &mut self.counts;
        *requests = requests.wrapping_add(1);
        let reject = match refused {
            None => return,
            Some(Violation::TooShort | Violation::TooLong | Violation::InvalidSegmentInPath) => format,
            Some(violation) => match violation.status().extended {
                Some(Extended::OutOfConnections | Extended::TargetOutOfConnections) => resource,
                _ => other,
            },
        };
        *reject = reject.wrapping_add(1);
    }

    /// Counts a Forward_Close and, if it was refused, the reason.
    pub(in super::super) fn closed(&mut self, refused: Option<Violation>) {
        let [_, _, _, _, requests, format, other, _] = &mut self.counts;
        *requests = requests.wrapping_add(1);
        let reject = match refused {
            None => return,
            Some(Violation::TooShort | Violation::TooLong) => format,
            Some(_) => other,
        };
        *reject = reject.wrapping_add(1);
    }

    /// Counts a connection that timed out.
    pub(in super::super) fn timed_out(&mut self) {
        let [.., timeouts] = &mut self.counts;
        *timeouts = timeouts.wrapping_add(1);
    }
}

pub(super) struct ConnectionManager;

impl Object for ConnectionManager {
    const REVISION: u16 = 1;
    const ATTRIBUTES: &'static [u16] = &[1, 2, 3, 4, 5, 6, 7, 8];
    /// Volume 1, table 3-5.4.
    const CLASS_ATTRIBUTES: &'static [u16] = &[1, 2, 6, 7];
    const SETS_LISTS: bool = true;

    fn listed_len(attribute: u16) -> Option<usize> {
        Self::ATTRIBUTES.contains(&attribute).then_some(2)
    }

    fn get(
        device: &Device,
        _instance: u32,
        attribute: u16,
        writer: &mut Writer<'_>,
    ) -> Result<(), Violation> {
        let index = usize::from(attribute).checked_sub(1);
        let count = index.and_then(|index| device.manager.counts.get(index));
        writer.u16(*count.ok_or(Violation::UnknownAttribute)?);
        Ok(())
    }

    /// Sets a counter, which continues from the new value.
    fn set(device: &mut Device, _instance: u32, attribute: u16, data: &[u8]) -> Result<(), Violation> {
        let value = u16::from_le_bytes(parse_exact(data)?);
        let index = usize::from(attribute).checked_sub(1);
        let count = index.and_then(|index| device.manager.counts.get_mut(index));
        *count.ok_or(Violation::UnknownAttribute)? = value;
        Ok(())
    }
}
