//! Which connection of a stack is which station.

use alloc::collections::BTreeMap;
use alloc::vec::Vec;

use crate::fieldbus::StationId;

/// The connections of a stack, by their stations.
#[derive(Clone, Debug)]
pub struct Stations<C> {
    connections: Vec<C>,
    stations: BTreeMap<C, StationId>,
}

impl<C: Copy + Ord> Stations<C> {
    /// Numbers these connections.
    #[must_use]
    pub fn new(connections: Vec<C>) -> Self {
        let stations = connections.iter().copied().zip((0..).map(StationId)).collect();
        Self { connections, stations }
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
}
