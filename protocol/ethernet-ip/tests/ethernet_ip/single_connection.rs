//! A scanner with one connection, as a machine that reports of that connection alone.

use std::net::Ipv4Addr;

use ethernet_ip::{Connection, ConnectionConfig, ConnectionId, Scanner, ScannerConfig};
use machine::{
    Counters, Instant, LinkEvent, Machine, Port, PortRequest, Source, StreamChange, StreamId, StreamRequest,
    Transmit,
};

pub(crate) const SCANNER: ScannerConfig =
    ScannerConfig { vendor: 0xFFFF, serial_number: 1, first_id: 0x5C00_0000 };

#[derive(Debug)]
pub(crate) struct SingleConnection {
    scanner: Scanner,
    id: ConnectionId,
}

impl SingleConnection {
    pub(crate) fn new(config: ConnectionConfig, start: Instant) -> Self {
        Self::of(SCANNER, config, start)
    }

    pub(crate) fn of(scanner: ScannerConfig, config: ConnectionConfig, start: Instant) -> Self {
        let mut scanner = Scanner::new(scanner);
        let id = scanner.connect(config, start).unwrap();
        Self { scanner, id }
    }

    pub(crate) fn connection(&self) -> &Connection {
        self.scanner.connection(self.id).unwrap()
    }

    pub(crate) fn connection_mut(&mut self) -> &mut Connection {
        self.scanner.connection_mut(self.id).unwrap()
    }

    pub(crate) fn input(&self) -> Option<&[u8]> {
        self.connection().input()
    }

    pub(crate) fn set_output(&mut self, data: &[u8]) {
        self.connection_mut().set_output(data).unwrap();
    }

    pub(crate) fn disconnect(&mut self, now: Instant) {
        self.connection_mut().disconnect(now);
    }

    pub(crate) fn counters(&self) -> Counters {
        self.connection().counters() + self.scanner.counters()
    }
}

impl Machine for SingleConnection {
    type Event = LinkEvent;

    fn ports(&self) -> &[PortRequest] {
        self.scanner.ports()
    }

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        self.scanner.handle_frame(now, from, frame);
    }

    fn handle_stream(&mut self, now: Instant, stream: StreamId, change: StreamChange) {
        self.scanner.handle_stream(now, stream, change);
    }

    fn poll_stream(&mut self) -> Option<StreamRequest> {
        self.scanner.poll_stream()
    }

    fn dscp(&self, port: Port) -> u8 {
        self.scanner.dscp(port)
    }

    fn group(&self, port: Port, index: usize) -> Option<Ipv4Addr> {
        self.scanner.group(port, index)
    }

    fn handle_timeout(&mut self, now: Instant) {
        self.scanner.handle_timeout(now);
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        self.scanner.poll_transmit(now, buf)
    }

    fn poll_event(&mut self) -> Option<LinkEvent> {
        let (id, event) = self.scanner.poll_event()?;
        assert_eq!(id, self.id);
        Some(event)
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.scanner.poll_timeout()
    }
}
