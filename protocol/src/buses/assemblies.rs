//! EtherNet/IP: the image is the data of one assembly in its direction.

use alloc::vec::Vec;
use core::fmt;
use core::net::Ipv4Addr;

use ethernet_ip::description::Role;
use ethernet_ip::{
    Adapter, Connection, ConnectionConfig, ConnectionId, Scanner, ScannerConfig, TooManyConnections,
};
use machine::ethernet::Mac;
use machine::{Counters, Instant, LinkStatus};

use super::{Stations, machine_with_stations};
use crate::fieldbus::{ControllerBus, Fieldbus, StationId};
use crate::image::{IMAGE_LEN, Image, Order};

/// A scanner with a connection to each station.
#[derive(Debug)]
pub struct EthernetIpScanner {
    scanner: Scanner,
    stations: Stations<ConnectionId>,
}

impl EthernetIpScanner {
    /// Creates a scanner that begins to connect at `start`.
    ///
    /// # Errors
    ///
    /// There are more connections than a scanner has.
    pub fn new(
        config: ScannerConfig,
        connections: Vec<ConnectionConfig>,
        start: Instant,
    ) -> Result<Self, TooManyConnections> {
        Self::connect(Scanner::new(config), connections, start)
    }

    /// Creates one that also detects address conflicts: of its own address, on the interface `mac`, and of the adapters'.
    ///
    /// # Errors
    ///
    /// There are more connections than a scanner has.
    pub fn with_conflict_detection(
        config: ScannerConfig,
        (mac, address, mask): (Mac, Ipv4Addr, Ipv4Addr),
        connections: Vec<ConnectionConfig>,
        start: Instant,
    ) -> Result<Self, TooManyConnections> {
        let scanner = Scanner::new(config).with_conflict_detection(mac, address, mask, start);
        Self::connect(scanner, connections, start)
    }

    fn connect(
        mut scanner: Scanner,
        connections: Vec<ConnectionConfig>,
        start: Instant,
    ) -> Result<Self, TooManyConnections> {
        let connections = connections.into_iter().map(|connection| scanner.connect(connection, start));
        let connections = connections.collect::<Result<Vec<_>, _>>()?;
        Ok(Self { scanner, stations: Stations::new(connections) })
    }

    /// Detects no address conflicts, as a scanner without raw Ethernet. Call it before the scanner runs.
    pub fn stop_conflict_detection(&mut self) {
        self.scanner.stop_conflict_detection();
    }

    /// Returns the connection to a station.
    #[must_use]
    pub fn connection(&self, station: StationId) -> Option<&Connection> {
        self.scanner.connection(self.stations.connection(station)?)
    }

    fn connection_mut(&mut self, station: StationId) -> Option<&mut Connection> {
        self.scanner.connection_mut(self.stations.connection(station)?)
    }
}

/// Returns the first assembly of an adapter with a role of this kind.
fn assembly(adapter: &Adapter, is_wanted: impl Fn(Role) -> bool) -> Option<u32> {
    let all = adapter.description().assemblies.iter();
    all.filter(|assembly| is_wanted(assembly.role)).map(|assembly| assembly.instance).next()
}

machine_with_stations!(EthernetIpScanner, scanner);

impl ControllerBus for EthernetIpScanner {
    fn stations(&self) -> u16 {
        self.stations.count()
    }

    fn byte_order(&self) -> Order {
        Order::LittleEndian
    }

    /// The assembly may be shorter or longer than the image.
    fn set_output(&mut self, station: StationId, image: &Image) {
        let connection = self.stations.connection(station);
        if let Some(output) = connection.and_then(|connection| self.scanner.output_mut(connection)) {
            let len = output.len().min(IMAGE_LEN);
            if let (Some(place), Some(bytes)) = (output.get_mut(..len), image.get(..len)) {
                place.copy_from_slice(bytes);
            }
        }
    }

    /// The assembly may be shorter or longer than the image.
    fn input(&self, station: StationId) -> Option<Image> {
        let mut image = [0; IMAGE_LEN];
        let data = self.connection(station)?.input()?;
        let len = data.len().min(IMAGE_LEN);
        image.get_mut(..len)?.copy_from_slice(data.get(..len)?);
        Some(image)
    }

    fn repeats(&self, station: StationId, image: &Image) -> bool {
        let Some(data) = self.connection(station).and_then(Connection::input) else { return false };
        let (same, rest) = image.split_at(data.len().min(IMAGE_LEN));
        data.get(..same.len()) == Some(same) && rest.iter().all(|byte| *byte == 0)
    }

    fn poll_arrival(&mut self) -> Option<StationId> {
        let scanner = &mut self.scanner;
        core::iter::from_fn(|| scanner.poll_received()).find_map(|connection| self.stations.of(connection))
    }

    fn disconnect(&mut self, now: Instant, station: StationId) {
        if let Some(connection) = self.connection_mut(station) {
            connection.disconnect(now);
        }
    }

    fn explain(&self, station: StationId, words: &mut dyn fmt::Write) -> fmt::Result {
        self.connection(station).map_or(Ok(()), |connection| connection.explain(words))
    }

    fn remark(&self, station: StationId, words: &mut dyn fmt::Write) -> fmt::Result {
        self.connection(station).map_or(Ok(()), |connection| connection.remark(words))
    }

    fn write_identity(&self, station: StationId, words: &mut dyn fmt::Write) -> fmt::Result {
        let identity = self.connection(station).and_then(Connection::identity);
        identity.map_or(Ok(()), |identity| write!(words, "{identity}"))
    }

    fn counters(&self, station: StationId) -> Counters {
        let own = self.connection(station).map(Connection::counters).unwrap_or_default();
        if station == StationId::FIRST { own + self.scanner.counters() } else { own }
    }

    fn received(&self, station: StationId) -> u64 {
        let own = self.connection(station).map_or(0, Connection::received);
        if station == StationId::FIRST { own + self.scanner.counters().received } else { own }
    }
}

/// An adapter that is described by [`ETHERNET_IP_ROBOT`](crate::stations::ETHERNET_IP_ROBOT), or by another description with at
/// least an image each way.
impl Fieldbus for Adapter {
    fn byte_order(&self) -> Order {
        Order::LittleEndian
    }

    /// The assembly may be longer than the image.
    fn set_output(&mut self, image: &Image) {
        let instance = assembly(self, Role::is_produced);
        let taken = instance.map(|instance| self.set_produced_start(instance, image));
        debug_assert!(matches!(taken, Some(Ok(()))), "an adapter with another description: {taken:?}");
    }

    fn input(&self) -> Option<Image> {
        self.consumed(assembly(self, Role::is_consumed)?)?.first_chunk::<IMAGE_LEN>().copied()
    }

    fn has_input(&self) -> bool {
        let data = assembly(self, Role::is_consumed).and_then(|instance| self.consumed(instance));
        data.is_some_and(|data| data.len() >= IMAGE_LEN)
    }

    fn disconnect(&mut self, now: Instant) {
        self.disconnect(now);
    }

    fn explain(&self, words: &mut dyn fmt::Write) -> fmt::Result {
        self.explain(words)
    }

    fn remark(&self, words: &mut dyn fmt::Write) -> fmt::Result {
        self.remark(words)
    }

    fn write_request(&self, words: &mut dyn fmt::Write) -> fmt::Result {
        self.write_request(words)
    }

    fn counters(&self) -> Counters {
        self.counters()
    }

    fn wants_link(&self) -> bool {
        true
    }

    fn set_link(&mut self, status: &LinkStatus) {
        self.set_link(*status);
    }
}
