//! Grants of shared zones: which arm may be in which one.
//!
//! The PLC grants a zone to one arm at a time, in the order in which the arms ask. A grant ends once the PLC has *seen* that the arm
//! has left: by the motions that its robot counts as executed, or by its joints while it rests. It never ends by time, by a lost
//! connection, a halt or a fault: such an arm may be inside, or may still have got the motion that leads in.
//!
//! Fairness: an arm that leaves a zone and wants it again comes after all that asked meanwhile, so that no arm that asks
//! waits for more visits than there are other arms.

#[cfg(test)]
mod exploration;

use planning::{MOST_ZONES, ZoneSet};

/// The grants of the shared zones of a cell.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub struct Zones {
    /// The zones that each arm may be in.
    held: Vec<ZoneSet>,
    /// The zone that each arm asks for, and when it asked, as a number that grows.
    asked: Vec<Option<(usize, u64)>>,
    next: u64,
}

impl Zones {
    /// Creates the grants for a number of arms. Where they are is not known: each may be in every zone.
    #[must_use]
    pub fn unknown(arms: usize) -> Self {
        Self { held: vec![ZoneSet::ALL; arms], asked: vec![None; arms], next: 0 }
    }

    /// Returns the zones that an arm may be in.
    #[must_use]
    pub fn held(&self, arm: usize) -> ZoneSet {
        self.held.get(arm).copied().unwrap_or(ZoneSet::NONE)
    }

    /// Returns the zones that arms other than this one may be in.
    #[must_use]
    pub fn held_by_others(&self, arm: usize) -> ZoneSet {
        let others = self.held.iter().enumerate().filter(|(other, _)| *other != arm);
        others.fold(ZoneSet::NONE, |zones, (_, held)| zones.with(*held))
    }

    /// Notes where an arm is: in these zones and in no other.
    pub fn locate(&mut self, arm: usize, zones: ZoneSet) {
        if let Some(held) = self.held.get_mut(arm) {
            *held = zones;
        }
    }

    /// Asks for a zone, again in each scan until it is granted. Returns whether it is granted. An arm asks for one zone at a time.
    pub fn request(&mut self, arm: usize, zone: usize) -> bool {
        let Some(asked) = self.asked.get_mut(arm) else { return false };
        if zone >= MOST_ZONES {
            return false;
        }
        if asked.is_none_or(|(of, _)| of != zone) {
            *asked = Some((zone, self.next));
            self.next += 1;
        }
        let since = asked.map(|(_, since)| since);
        let is_first = self.asked.iter().flatten().all(|(other, at)| *other != zone || Some(*at) >= since);
        if !is_first || self.held_by_others(arm).contains(zone) {
            return false;
        }
        self.withdraw(arm);
        self.locate(arm, self.held(arm).with(ZoneSet::of(zone)));
        true
    }

    /// Withdraws what an arm asks for. What was granted stays.
    pub fn withdraw(&mut self, arm: usize) {
        if let Some(asked) = self.asked.get_mut(arm) {
            *asked = None;
        }
    }

    /// Grants all these zones to an arm at once, or none of them: for a way whose zones it does not leave one by one. Returns
    /// whether they are granted.
    pub fn request_all(&mut self, arm: usize, zones: ZoneSet) -> bool {
        if self.held_by_others(arm).meets(zones) {
            return false;
        }
        self.locate(arm, self.held(arm).with(zones));
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn nowhere(arms: usize) -> Zones {
        let mut zones = Zones::unknown(arms);
        (0..arms).for_each(|arm| zones.locate(arm, ZoneSet::NONE));
        zones
    }

    #[test]
    fn arms_get_a_zone_in_the_order_in_which_they_asked() {
        let mut zones = nowhere(3);
        assert!(zones.request(1, 0));
        assert!(!zones.request(2, 0) && !zones.request(0, 0));
        zones.locate(1, ZoneSet::NONE);
        assert!(!zones.request(0, 0), "the third arm asked first");
        assert!(zones.request(2, 0));
        zones.locate(2, ZoneSet::NONE);
        assert!(zones.request(0, 0));
    }

    #[test]
    fn an_arm_that_wants_the_zone_again_while_it_is_inside_comes_after_those_that_wait() {
        let mut zones = nowhere(2);
        assert!(zones.request(0, 0));
        assert!(zones.request(0, 0), "nobody else wants it");
        assert!(!zones.request(1, 0));
        assert!(!zones.request(0, 0), "the other arm waits");
        zones.locate(0, ZoneSet::NONE);
        assert!(zones.request(1, 0));
    }

    #[test]
    fn an_arm_whose_place_is_not_known_may_be_in_every_zone() {
        let mut zones = Zones::unknown(2);
        assert!(!zones.request(0, 0) && !zones.request_all(0, ZoneSet::of(3)));
        zones.locate(1, ZoneSet::of(1));
        assert!(zones.request(0, 0) && zones.request_all(0, ZoneSet::of(3)));
        assert!(!zones.request_all(0, ZoneSet::of(1).with(ZoneSet::of(2))), "all at once, or none");
        assert_eq!(zones.held_by_others(0), ZoneSet::of(1));
    }

    #[test]
    fn a_request_that_was_withdrawn_keeps_nobody_waiting() {
        let mut zones = nowhere(3);
        assert!(zones.request(0, 0) && !zones.request(1, 0) && !zones.request(2, 0));
        zones.withdraw(1);
        zones.locate(0, ZoneSet::NONE);
        assert!(zones.request(2, 0));
    }
}
