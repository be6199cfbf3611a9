//! Reassembles fragmented requests, separately for each station: no station can spoil the request of another.

use core::net::Ipv4Addr;

use crate::rpc::{BODY_CAPACITY, Header, Reassembly, Received};

/// Largest number of stations whose requests are unfinished at the same time.
const STATIONS: usize = 4;

/// Unfinished requests, one for each station.
#[derive(Debug)]
pub(crate) struct Requests {
    places: [Place; STATIONS],
    uses: u64,
}

#[derive(Debug)]
struct Place {
    from: Option<Ipv4Addr>,
    last_use: u64,
    reassembly: Reassembly,
}

impl Requests {
    /// Allocates the memory of all places; nothing later allocates.
    pub(crate) fn new() -> Self {
        Self::with_capacity(BODY_CAPACITY)
    }

    /// Allocates the memory of all places for requests of at most this number of bytes.
    pub(crate) fn with_capacity(capacity: usize) -> Self {
        let place = |_| Place { from: None, last_use: 0, reassembly: Reassembly::with_capacity(capacity) };
        Self { places: core::array::from_fn(place), uses: 0 }
    }

    /// Handles a request or a fragment of one. A station without a place gets the place of the station that has been silent
    /// longest, but never the place of `kept`.
    pub(crate) fn take<'a>(
        &'a mut self,
        from: Ipv4Addr,
        kept: Option<Ipv4Addr>,
        header: &Header,
        body: &'a [u8],
    ) -> Received<'a> {
        if !header.is_fragment() {
            return Received::Whole(body);
        }
        let own = self.places.iter().position(|place| place.from == Some(from));
        let others = || {
            let places = self.places.iter().enumerate();
            let not_kept = places.filter(|(_, place)| place.from.is_none() || place.from != kept);
            not_kept.min_by_key(|(_, place)| place.last_use).map(|(index, _)| index)
        };
        let Some(place) = own.or_else(others).and_then(|index| self.places.get_mut(index)) else {
            return Received::Refused;
        };
        self.uses += 1;
        place.last_use = self.uses;
        if place.from.replace(from) != Some(from) {
            place.reassembly.clear();
        }
        place.reassembly.take(header, body)
    }
}
