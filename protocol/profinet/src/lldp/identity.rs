//! The texts that name a station in LLDP: what a port is called, and what kind of station it is.

use core::fmt::{self, Write as _};

use crate::description::Description;
use machine::ethernet::Mac;

/// A text in memory of its own. What does not fit is left out.
#[derive(Clone, Copy, Debug)]
pub(super) struct Text {
    bytes: [u8; Self::CAPACITY],
    len: usize,
}

impl Text {
    const CAPACITY: usize = 255;

    pub(super) const fn new() -> Self {
        Self { bytes: [0; Self::CAPACITY], len: 0 }
    }

    pub(super) fn push(&mut self, bytes: &[u8]) {
        for (to, from) in self.bytes.iter_mut().skip(self.len).zip(bytes) {
            *to = *from;
            self.len += 1;
        }
    }

    pub(super) fn as_bytes(&self) -> &[u8] {
        self.bytes.get(..self.len).unwrap_or_default()
    }

    /// Returns what kind of station this is: type, order ID and serial number, each filled up with blanks, then the
    /// revisions of hardware and software (IEC 61158-6-10, SystemIdentification).
    pub(super) fn system(description: &Description) -> Self {
        let Description { station_type, order_id, serial_number, hardware_revision, .. } = description;
        let [major, minor, patch] = description.software_revision;
        let mut text = Self::new();
        // A text takes whatever is written.
        let _ = write!(
            text,
            "{station_type:<25} {order_id:<20} {serial_number:<16} {hardware_revision:>5} \
             V{major:>3}{minor:>3}{patch:>3}"
        );
        text
    }

    /// Returns a MAC address as the name of a station that has none (IEC 61158-6-10, LLDP substitutions).
    pub(super) fn mac(Mac([a, b, c, d, e, f]): Mac) -> Self {
        let mut text = Self::new();
        let _ = write!(text, "{a:02X}-{b:02X}-{c:02X}-{d:02X}-{e:02X}-{f:02X}");
        text
    }
}

impl fmt::Write for Text {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.push(text.as_bytes());
        Ok(())
    }
}
