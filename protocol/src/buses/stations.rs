//! Which connection of a stack is which station.

use alloc::collections::BTreeMap;
use alloc::vec::Vec;

use crate::fieldbus::StationId;

/// The connections of a stack, by their stations.
#[derive(Clone, Debug)]
pub struct Stations<C> {
    connections: Vec<C>,
    stations: BTreeMap<C, StationId>,
    /// Frames that each station's connection had received when it was last asked, and where to go on asking.
    received: Vec<u64>,
    next: usize,
}

impl<C: Copy + Ord> Stations<C> {
    /// Numbers these connections.
    #[must_use]
    pub fn new(connections: Vec<C>) -> Self {
        let stations = connections.iter().copied().zip((0..).map(StationId)).collect();
        Self { received: alloc::vec![0; connections.len()], connections, stations, next: 0 }
    }

    /// Returns the number of stations.
    #[must_use]
    pub fn count(&self) -> u16 {
        u16::try_from(self.connections.len()).unwrap_or(u16::MAX)
    }

    /// Returns the connection to a station.
    #[must_use]
    pub fn connection(&self, station: StationId) -> Option<C> {
        self.connections.get(usize::from(station.0)).copied()
    }

    /// Returns the station of a connection.
    #[must_use]
    pub fn of(&self, connection: C) -> Option<StationId> {
        self.stations.get(&connection).copied()
    }

    /// Returns the next station whose number of received frames has changed since it was last asked for.
    pub fn poll_arrival(&mut self, received: impl Fn(C) -> u64) -> Option<StationId> {
        while let Some((connection, before)) =
            self.connections.get(self.next).zip(self.received.get_mut(self.next))
        {
            let station = StationId(u16::try_from(self.next).unwrap_or(u16::MAX));
            self.next += 1;
            let now = received(*connection);
            if core::mem::replace(before, now) != now {
                return Some(station);
            }
        }
        self.next = 0;
        None
    }
}
