//! Other MainDevices on the cable, recognised by the source addresses of their frames.
//!
//! A cable has one MainDevice. A second one hears the frames of the first where a switch connects them, or where it is
//! plugged into the far end of the cable: there a device's chip forwards them.

use machine::ethernet::Mac;
use machine::{Duration, Instant};

use crate::datagrams::{Datagram, Datagrams, ethercat};

/// A chip sets this bit in the first byte of the source address of a frame that passes it (ETG.1000.4): locally administered.
pub(crate) const PASSED: u8 = 0x02;

/// Another bit of that byte, inverted in the source address where the interface's own address is a locally administered one.
const OTHER_BIT: u8 = 0x04;

/// Registers of the EEPROM interface: a search writes there, and changes nothing by it.
const EEPROM_INTERFACE: core::ops::Range<u16> = 0x0500..0x0510;

/// Frames from one source within [`WINDOW`] that prove another MainDevice. A damaged source address comes once.
const EVIDENCE: u32 = 3;
const WINDOW: Duration = Duration::from_secs(2);

/// Sources that are counted at the same time.
const SOURCES: usize = 4;

/// Returns the source address of a MainDevice's frames, from the address of its interface.
///
/// It must differ from the interface's address when a chip has set the bit [`PASSED`]: a switch would otherwise send what is
/// for the interface to the devices.
pub(crate) const fn source_address(Mac([first, b, c, d, e, f]): Mac) -> Mac {
    let first = if first & PASSED == 0 { first } else { first & !PASSED ^ OTHER_BIT };
    Mac([first, b, c, d, e, f])
}

/// Returns the source address of an EtherCAT frame; `None` for any other frame.
pub(crate) fn source(frame: &[u8]) -> Option<Mac> {
    ethercat(frame)?;
    Some(Mac(*frame.get(6..)?.first_chunk()?))
}

/// Returns whether two source addresses are the same, apart from the bit that chips set.
pub(crate) fn is_same(Mac([a, a_rest @ ..]): Mac, Mac([b, b_rest @ ..]): Mac) -> bool {
    a & !PASSED == b & !PASSED && a_rest == b_rest
}

/// Returns whether a frame changes something at devices or exchanges process data. A search does neither.
fn drives(frame: &[u8]) -> bool {
    Datagrams::of(frame).any(|Datagram { command, register, .. }| match command {
        // APWR, APRW, FPWR, FPRW.
        2 | 3 | 5 | 6 => !EEPROM_INTERFACE.contains(&register),
        // NOP, APRD, FPRD, BRD; and commands that there are not.
        0 | 1 | 4 | 7 | 15.. => false,
        8..=14 => true,
    })
}

/// What was heard of other MainDevices.
#[derive(Debug)]
pub(crate) struct Foreign {
    /// Frames of others.
    heard: u64,
    sources: [Option<Heard>; SOURCES],
    last: Option<Instant>,
    found: Option<Mac>,
}

#[derive(Clone, Copy, Debug)]
struct Heard {
    source: Mac,
    since: Instant,
    frames: u32,
}

impl Foreign {
    pub(crate) const fn none() -> Self {
        Self { heard: 0, sources: [None; SOURCES], last: None, found: None }
    }

    /// Takes note of a frame of another MainDevice.
    pub(crate) fn hear(&mut self, now: Instant, source: Mac, frame: &[u8]) {
        self.heard += 1;
        if !drives(frame) {
            return;
        }
        self.last = Some(now);
        let is_known = |slot: &&mut Option<Heard>| slot.is_some_and(|heard| is_same(heard.source, source));
        let slot = match self.sources.iter_mut().find(is_known) {
            Some(slot) => Some(slot),
            None => self.sources.iter_mut().min_by_key(|slot| slot.map(|heard| heard.since)),
        };
        let Some(slot) = slot else { return };
        let new = Heard { source, since: now, frames: 0 };
        let heard = slot.get_or_insert(new);
        if !is_same(heard.source, source) || now.since(heard.since) > WINDOW {
            *heard = new;
        }
        heard.frames = heard.frames.saturating_add(1);
        // A frame that passed no chip shows the address as it was sent.
        let Mac([first, ..]) = source;
        if first & PASSED == 0 {
            heard.source = source;
        }
        if heard.frames >= EVIDENCE {
            self.found = Some(heard.source);
        }
    }

    /// Takes note of another MainDevice that was found elsewhere.
    pub(crate) const fn found_by_others(&mut self, now: Instant, mac: Mac) {
        (self.found, self.last) = (Some(mac), Some(now));
    }

    /// Returns the source address of another MainDevice, if there is one.
    pub(crate) const fn found(&self) -> Option<Mac> {
        self.found
    }

    /// Returns when another MainDevice was heard last, if ever.
    pub(crate) const fn last(&self) -> Option<Instant> {
        self.last
    }

    /// Forgets the other MainDevices.
    pub(crate) fn forget(&mut self) {
        (self.sources, self.found, self.last) = ([None; SOURCES], None, None);
    }

    /// Returns the number of frames of others.
    pub(crate) const fn heard(&self) -> u64 {
        self.heard
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const OTHER: Mac = Mac([0x00, 0x0E, 0x8C, 0, 0, 1]);

    /// Returns a frame with one datagram.
    fn frame(command: u8, register: u16) -> Vec<u8> {
        let [low, high] = register.to_le_bytes();
        let mut frame = vec![0xFF; 6];
        frame.extend(OTHER.0);
        frame.extend([0x88, 0xA4, 14, 0x10, command, 0, 0, 0, low, high, 2, 0, 0, 0, 0, 0, 0, 0]);
        frame
    }

    fn hears(frames: &[(u64, Mac)]) -> Option<Mac> {
        let mut foreign = Foreign::none();
        for (ms, source) in frames {
            foreign.hear(Instant::from_millis(*ms), *source, &frame(12, 0));
        }
        foreign.found()
    }

    #[test]
    fn three_frames_of_one_source_in_two_seconds_prove_another_main_device_and_damaged_sources_do_not() {
        let passed = Mac([0x02, 0x0E, 0x8C, 0, 0, 1]);
        assert_eq!(hears(&[(0, OTHER), (900, passed)]), None);
        assert_eq!(hears(&[(0, passed), (900, OTHER), (1_800, passed)]), Some(OTHER));
        assert_eq!(hears(&[(0, OTHER), (1_500, OTHER), (3_000, OTHER)]), None);
        let damaged: Vec<_> = (0..48).map(|n| (u64::from(n), Mac([0, 0, 0, 0, 0, n]))).collect();
        assert_eq!(hears(&damaged), None);
        let two: Vec<_> = (0..6).map(|n| (n, Mac([0, 0, 0, 0, 0, (n % 2) as u8]))).collect();
        assert!(hears(&two).is_some());
    }

    #[test]
    fn a_search_is_counted_and_is_not_another_main_device() {
        let mut foreign = Foreign::none();
        for (command, register) in [(1, 0x0010), (1, 0x0130), (7, 0x0130), (2, 0x0502), (1, 0x0508)] {
            for ms in 0..10 {
                foreign.hear(Instant::from_millis(ms), OTHER, &frame(command, register));
            }
        }
        assert_eq!((foreign.found(), foreign.heard()), (None, 50));
        for (command, register) in [(8, 0x0120), (2, 0x0010), (5, 0x0120), (12, 0x0500), (14, 0x0910)] {
            let mut foreign = Foreign::none();
            for ms in 0..3 {
                foreign.hear(Instant::from_millis(ms), OTHER, &frame(command, register));
            }
            assert_eq!(foreign.found(), Some(OTHER), "{command}");
        }
    }

    #[test]
    fn a_frame_cut_or_altered_anywhere_is_taken_without_a_panic() {
        let whole = frame(5, 0x0120);
        for len in 0..whole.len() {
            let cut = &whole[..len];
            let _ = (source(cut), drives(cut));
        }
        for place in 0..whole.len() {
            for value in 0..=u8::MAX {
                let mut altered = whole.clone();
                altered[place] = value;
                let _ = (source(&altered), drives(&altered));
            }
        }
    }

    #[test]
    fn the_source_address_differs_from_the_interface_s_also_after_a_chip_has_set_its_bit() {
        let real = Mac([0x00, 0x1B, 0x21, 1, 2, 3]);
        assert_eq!(source_address(real), real);
        let local = Mac([0x02, 0, 0, 0, 0, 1]);
        let Mac([first, rest @ ..]) = source_address(local);
        assert_eq!((first & PASSED, rest), (0, [0, 0, 0, 0, 1]));
        assert_ne!(first | PASSED, 0x02);
    }
}
