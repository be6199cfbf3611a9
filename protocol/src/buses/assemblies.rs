//! EtherNet/IP: the image is the data of one assembly in its direction.

use core::fmt;
use core::net::Ipv4Addr;

use ethernet_ip::{Adapter, Connection, ConnectionConfig, ConnectionId, Scanner, ScannerConfig};
use machine::ethernet::Mac;
use machine::{Counters, Instant};

use super::machine_with_one_connection;
use crate::fieldbus::Fieldbus;
use crate::image::{IMAGE_LEN, Image, Order};
use crate::stations::{COMMAND, FEEDBACK};

/// A scanner with one connection.
#[derive(Debug)]
pub struct EthernetIpScanner {
    scanner: Scanner,
    connection: Option<ConnectionId>,
}

impl EthernetIpScanner {
    /// Creates a scanner that begins to connect at `start`.
    #[must_use]
    pub fn new(config: ScannerConfig, connection: ConnectionConfig, start: Instant) -> Self {
        let mut scanner = Scanner::new(config);
        // A scanner without connections has room for one.
        let connection = scanner.connect(connection, start).ok();
        Self { scanner, connection }
    }

    /// Creates one that also detects address conflicts: of its own address, on the interface `mac`, and of the adapter's.
    #[must_use]
    pub fn with_conflict_detection(
        config: ScannerConfig,
        (mac, address, mask): (Mac, Ipv4Addr, Ipv4Addr),
        connection: ConnectionConfig,
        start: Instant,
    ) -> Self {
        let mut scanner = Scanner::new(config).with_conflict_detection(mac, address, mask, start);
        let connection = scanner.connect(connection, start).ok();
        Self { scanner, connection }
    }

    /// Detects no address conflicts, as a scanner without raw Ethernet. Call it before the scanner runs.
    pub fn stop_conflict_detection(&mut self) {
        self.scanner.stop_conflict_detection();
    }

    /// Returns the connection to the adapter.
    #[must_use]
    pub fn connection(&self) -> Option<&Connection> {
        self.scanner.connection(self.connection?)
    }

    fn connection_mut(&mut self) -> Option<&mut Connection> {
        self.scanner.connection_mut(self.connection?)
    }
}

machine_with_one_connection!(EthernetIpScanner, scanner);

impl Fieldbus for EthernetIpScanner {
    fn byte_order(&self) -> Order {
        Order::LittleEndian
    }

    /// The assembly may be shorter or longer than the image.
    fn set_output(&mut self, image: &Image) {
        if let Some(connection) = self.connection_mut() {
            for (place, byte) in connection.output_mut().iter_mut().zip(image) {
                *place = *byte;
            }
        }
    }

    /// The assembly may be shorter or longer than the image.
    fn input(&self) -> Option<Image> {
        let mut image = [0; IMAGE_LEN];
        let data = self.connection()?.input()?;
        for (place, byte) in image.iter_mut().zip(data) {
            *place = *byte;
        }
        Some(image)
    }

    fn disconnect(&mut self, now: Instant) {
        if let Some(connection) = self.connection_mut() {
            connection.disconnect(now);
        }
    }

    fn explain(&self, words: &mut dyn fmt::Write) -> fmt::Result {
        self.connection().map_or(Ok(()), |connection| connection.explain(words))
    }

    fn remark(&self, words: &mut dyn fmt::Write) -> fmt::Result {
        self.connection().map_or(Ok(()), |connection| connection.remark(words))
    }

    fn counters(&self) -> Counters {
        self.connection().map(Connection::counters).unwrap_or_default() + self.scanner.counters()
    }
}

/// An adapter that is described by [`ETHERNET_IP_ROBOT`](crate::stations::ETHERNET_IP_ROBOT).
impl Fieldbus for Adapter {
    fn byte_order(&self) -> Order {
        Order::LittleEndian
    }

    fn set_output(&mut self, image: &Image) {
        let taken = self.set_produced(FEEDBACK, image);
        debug_assert!(taken.is_ok(), "an adapter with another description: {taken:?}");
    }

    fn input(&self) -> Option<Image> {
        self.consumed(COMMAND)?.try_into().ok()
    }

    fn disconnect(&mut self, now: Instant) {
        self.disconnect(now);
    }

    fn remark(&self, words: &mut dyn fmt::Write) -> fmt::Result {
        self.remark(words)
    }

    fn counters(&self) -> Counters {
        self.counters()
    }
}
