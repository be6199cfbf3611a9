//! The carrier of an interface, for a node that passes frames on there: reported as soon as the kernel announces a change.

use std::os::fd::{AsFd, BorrowedFd};

use protocol_linux::{Interface, LinkChanges};

/// Reports the carrier of an interface at the start and after each change.
#[derive(Debug)]
pub(crate) struct CarrierReport {
    interface: Interface,
    changes: LinkChanges,
    /// The last report.
    reported: Option<bool>,
    /// Set while the carrier may differ from the last report.
    is_due: bool,
}

impl CarrierReport {
    /// Starts to watch an interface.
    pub(crate) fn of(interface: Interface) -> std::io::Result<Self> {
        Ok(Self { interface, changes: LinkChanges::listen()?, reported: None, is_due: true })
    }

    /// Notes that the kernel has announced a change of some interface.
    pub(crate) fn note_change(&mut self) {
        self.changes.clear();
        self.is_due = true;
    }

    /// Forgets the last report, so that it is made again.
    pub(crate) const fn repeat(&mut self) {
        (self.reported, self.is_due) = (None, true);
    }

    /// Returns whether the interface has a carrier, if that is news.
    pub(crate) fn take(&mut self) -> Option<bool> {
        if !std::mem::take(&mut self.is_due) {
            return None;
        }
        // An interface that is gone has none.
        let is_up = self.interface.has_carrier().unwrap_or(false);
        (self.reported.replace(is_up) != Some(is_up)).then_some(is_up)
    }
}

impl AsFd for CarrierReport {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.changes.as_fd()
    }
}
