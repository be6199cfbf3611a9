//! The stations that a switch has seen, by MAC address: a look-up costs the same however many they are.

use alloc::vec;
use alloc::vec::Vec;

use machine::ethernet::Mac;

/// Most MAC addresses that a switch remembers; frames to further ones go to all ports. Small industrial switches have 1 K
/// to 8 K places.
const MOST_ADDRESSES: usize = 4096;

/// Places of the smallest table, a power of two.
const LEAST_PLACES: usize = 16;

/// The port at which each station was last seen: a hash table with linear probing, at most half full.
#[derive(Debug)]
pub(super) struct LearnedPorts {
    places: Vec<Option<(Mac, usize)>>,
    len: usize,
}

impl LearnedPorts {
    pub(super) const fn new() -> Self {
        Self { places: Vec::new(), len: 0 }
    }

    /// Returns the port of a station.
    pub(super) fn get(&self, mac: Mac) -> Option<usize> {
        self.places.get(self.place_of(mac))?.map(|(_, port)| port)
    }

    /// Notes the port of a station, if it is known or there is room for it.
    pub(super) fn insert(&mut self, mac: Mac, port: usize) {
        let place = self.place_of(mac);
        if let Some(Some((_, known))) = self.places.get_mut(place) {
            *known = port;
            return;
        }
        if self.len >= MOST_ADDRESSES {
            return;
        }
        if 2 * (self.len + 1) > self.places.len() {
            let larger = vec![None; (2 * self.places.len()).max(LEAST_PLACES)];
            for known in core::mem::replace(&mut self.places, larger).into_iter().flatten() {
                self.put(known);
            }
        }
        self.put((mac, port));
        self.len += 1;
    }

    fn put(&mut self, entry: (Mac, usize)) {
        let place = self.place_of(entry.0);
        if let Some(place) = self.places.get_mut(place) {
            *place = Some(entry);
        }
    }

    /// Returns the place that a station has, or would get.
    fn place_of(&self, mac: Mac) -> usize {
        let mask = self.places.len().wrapping_sub(1);
        let mut place = hash(mac) & mask;
        while self.places.get(place).is_some_and(|known| known.is_some_and(|(other, _)| other != mac)) {
            place = (place + 1) & mask;
        }
        place
    }
}

/// Spreads addresses that differ in their last bytes, by the golden ratio (Knuth, The Art of Computer Programming, 6.4).
fn hash(Mac([a, b, c, d, e, f]): Mac) -> usize {
    let bits = u64::from_be_bytes([0, 0, a, b, c, d, e, f]);
    (bits.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 48) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn mac(number: u16) -> Mac {
        let [high, low] = number.to_be_bytes();
        Mac([2, 0, 0, 0, high, low])
    }

    #[test]
    fn each_station_has_the_port_at_which_it_was_seen_last_and_those_beyond_the_limit_none() {
        let mut learned = LearnedPorts::new();
        assert_eq!(learned.get(mac(0)), None);
        for number in 0..5_000 {
            learned.insert(mac(number), usize::from(number) % 7);
        }
        learned.insert(mac(3), 6);
        learned.insert(mac(4_500), 6);
        for number in 0..5_000 {
            let port = if number == 3 { 6 } else { usize::from(number) % 7 };
            assert_eq!(learned.get(mac(number)), (number < 4_096).then_some(port), "{number}");
        }
    }
}
