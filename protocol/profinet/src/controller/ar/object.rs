//! Which instance of a device's object the calls go to.
//!
//! The last six bytes of a device's ObjectUUID are instance, DeviceID and VendorID. The GSDML file of the device names the
//! instance (ObjectUUID_LocalIndex): mostly 1, but drives also have 0. A device rejects calls to an object that it does not
//! have, so the others are tried then.

use crate::rpc::rpc_status;

/// The instance that most devices have.
const USUAL: u16 = 1;

/// The instance in use, and what was tried in this attempt to connect.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Instance {
    number: u16,
    rejected: u8,
}

impl Instance {
    pub(super) const fn new() -> Self {
        Self { number: USUAL, rejected: 0 }
    }

    /// Returns the instance to call.
    pub(super) const fn number(self) -> u16 {
        self.number
    }

    /// Starts an attempt to connect, with the instance that was used last.
    pub(super) const fn begin(&mut self) {
        self.rejected = 0;
    }

    /// Handles the Reject or Fault of a Connect: takes the next instance if this one does not exist. `reported` is the
    /// instance that the device reports by DCP. Returns whether the Connect is to be called again.
    pub(super) fn reject(&mut self, status: u32, reported: Option<u16>) -> bool {
        if !matches!(status, rpc_status::UNKNOWN_INTERFACE | rpc_status::OBJECT_NOT_FOUND) {
            return false;
        }
        let reported = reported.filter(|number| ![USUAL, 0].contains(number));
        let all = [Some(USUAL), reported, Some(0)];
        let mut known = all.into_iter().flatten().cycle();
        let count = all.into_iter().flatten().count();
        self.rejected += 1;
        if usize::from(self.rejected) >= count {
            return false;
        }
        let present = self.number;
        // The instance after the present one, which another device of this name may not have had at all.
        let found = known.by_ref().take(count).any(|number| number == present);
        self.number = known.next().filter(|_| found).unwrap_or(USUAL);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tried(instance: &mut Instance, status: u32, reported: Option<u16>) -> Vec<u16> {
        instance.begin();
        let mut tried = vec![instance.number()];
        while instance.reject(status, reported) {
            tried.push(instance.number());
        }
        tried
    }

    #[test]
    fn every_instance_is_tried_once_in_each_attempt() {
        let mut instance = Instance::new();
        let unknown = rpc_status::UNKNOWN_INTERFACE;
        assert_eq!(tried(&mut instance, unknown, None), [1, 0]);
        assert_eq!(tried(&mut instance, unknown, None), [0, 1]);
        assert_eq!(tried(&mut instance, unknown, Some(100)), [1, 100, 0]);
        assert_eq!(tried(&mut instance, rpc_status::OBJECT_NOT_FOUND, Some(0)), [0, 1]);
        assert_eq!(tried(&mut instance, rpc_status::SERVER_TOO_BUSY, Some(100)), [1]);
        let mut lost = Instance { number: 100, rejected: 0 };
        assert_eq!(tried(&mut lost, unknown, None), [100, 1]);
    }
}
