//! A scanner with many adapters, without a network: one cycle of the scanner is a hot path.

use std::net::{Ipv4Addr, SocketAddrV4};
use std::sync::{Arc, Mutex};

use ethernet_ip::{
    Adapter, AdapterConfig, ConnectionConfig, ConnectionId, ENCAPSULATION_PORT, IO_PORT, Scanner,
    ScannerConfig,
};
use hot_path::HotPaths;
use machine::wire::FRAME_CAPACITY;
use machine::{
    Duration, Instant, LinkEvent, Machine, Port, Source, StreamChange, StreamId, StreamRequest, Transmit,
};

use crate::samples::{DEVICE, LEN, PRODUCED};

const SCANNER: Ipv4Addr = Ipv4Addr::new(10, 0, 0, 1);
const MS: Duration = Duration::from_millis(1);

/// Numbers of stations: the second costs as much as each of the others.
const STATIONS: [u16; 3] = [1, 2, 64];

/// Adds one cycle of 1 ms for each number of stations: all inputs arrive, the PLC reads them and writes its outputs, which are
/// sent.
pub(crate) fn add(paths: &mut HotPaths) {
    for stations in STATIONS {
        let cell = Arc::new(Mutex::new(None));
        let prepare = move || {
            let mut place = cell.lock().unwrap();
            place.get_or_insert_with(|| Cell::connected(stations)).prepare();
            drop(place);
            Arc::clone(&cell)
        };
        paths.add(
            "EtherNet/IP scanner",
            format!("cycle of {stations}"),
            prepare,
            |cell: Arc<Mutex<Option<Cell>>>| cell.lock().unwrap().as_mut().unwrap().cycle(),
        );
    }
}

struct Cell {
    scanner: Scanner,
    connections: Vec<ConnectionId>,
    adapters: Vec<Adapter>,
    now: Instant,
    /// What the adapters send in this cycle.
    frames: Vec<(Source, Vec<u8>)>,
    /// What the scanner sent in this cycle.
    sent: Vec<(Transmit, Box<[u8; FRAME_CAPACITY]>)>,
    count: usize,
    buf: Box<[u8; FRAME_CAPACITY]>,
}

fn address(adapter: u16) -> Ipv4Addr {
    let [high, low] = adapter.to_be_bytes();
    Ipv4Addr::new(10, 0, 1 + high, low)
}

fn number(address: Ipv4Addr) -> usize {
    let [_, _, high, low] = address.octets();
    u16::from_be_bytes([high - 1, low]).into()
}

impl Cell {
    fn connected(stations: u16) -> Self {
        let config = ScannerConfig { vendor: 0xFFFF, serial_number: 1, first_id: 0x5C00_0000 };
        let mut scanner = Scanner::new(config);
        let connect = |adapter| {
            let config = ConnectionConfig::exclusive_owner(address(adapter), &DEVICE, 1_000);
            scanner.connect(config, Instant::ZERO + MS).unwrap()
        };
        let connections = (0..stations).map(connect).collect();
        let adapter = |adapter| {
            let mut adapter = Adapter::new(AdapterConfig {
                description: &DEVICE,
                serial_number: 7 + u32::from(adapter),
                address: address(adapter),
                mask: Ipv4Addr::new(255, 255, 0, 0),
                gateway: Ipv4Addr::UNSPECIFIED,
                mac: [2, 0, 0, 0, 1, adapter as u8],
                first_id: 0x0100_0000,
                originators: machine::Allowed::default(),
            });
            adapter.set_produced(PRODUCED, &[0xD0; LEN]).unwrap();
            adapter
        };
        let adapters = (0..stations).map(adapter).collect();
        let buf = Box::new([0; FRAME_CAPACITY]);
        let (frames, sent) = (Vec::new(), Vec::new());
        let mut cell =
            Self { scanner, connections, adapters, now: Instant::ZERO, frames, sent, count: 0, buf };
        let mut up = 0;
        while up < stations {
            up += cell.step();
            assert!(cell.now < Instant::from_millis(20_000), "not all come up");
        }
        for _ in 0..100 {
            cell.step();
        }
        cell
    }

    /// Lets 1 ms pass and everything arrive. Returns how many connections came up.
    fn step(&mut self) -> u16 {
        self.prepare();
        let mut up = 0;
        loop {
            for (from, bytes) in &self.frames {
                self.scanner.handle_frame(self.now, *from, bytes);
            }
            self.frames.clear();
            up += self.send();
            let has_opened = self.open_streams();
            let has_sent = self.deliver();
            self.collect();
            if !has_sent && !has_opened && self.frames.is_empty() {
                return up;
            }
        }
    }

    /// Lets 1 ms pass for the adapters, and keeps what they send.
    fn prepare(&mut self) {
        self.deliver();
        self.now += MS;
        for adapter in &mut self.adapters {
            adapter.handle_timeout(self.now);
        }
        self.collect();
    }

    /// Opens the TCP connections that the scanner wants: the number of each is that of the adapter.
    fn open_streams(&mut self) -> bool {
        let mut has_opened = false;
        while let Some(request) = self.scanner.poll_stream() {
            let StreamRequest::Connect { to, attempt } = request else { continue };
            assert_eq!(to.port(), ENCAPSULATION_PORT);
            let stream = StreamId(number(*to.ip()) as u32);
            let scanner = StreamChange::Accepted(SocketAddrV4::new(SCANNER, 50_000));
            self.adapters[stream.0 as usize].handle_stream(self.now, stream, scanner);
            self.scanner.handle_stream(self.now, stream, StreamChange::Connected(attempt));
            self.send();
            has_opened = true;
        }
        has_opened
    }

    fn collect(&mut self) {
        self.frames.clear();
        for (adapter, number) in self.adapters.iter_mut().zip(0..) {
            while adapter.poll_event().is_some() {}
            while let Some(Transmit { port, to, len }) = adapter.poll_transmit(self.now, &mut *self.buf) {
                let peer = to.map(|_| SocketAddrV4::new(address(number), IO_PORT));
                self.frames.push((Source { port, peer }, self.buf[..len].to_vec()));
            }
        }
    }

    /// One cycle of the scanner, as a PLC's driver runs it.
    fn cycle(&mut self) -> usize {
        for (from, bytes) in &self.frames {
            self.scanner.handle_frame(self.now, *from, bytes);
        }
        let mut sum = 0;
        for id in &self.connections {
            let connection = self.scanner.connection_mut(*id).unwrap();
            let first = connection.input().map_or(0, |input| input[0]);
            sum += usize::from(first);
            connection.set_output(&[first; LEN]).unwrap();
        }
        self.send();
        assert!(self.scanner.poll_timeout().is_some_and(|due| due > self.now));
        sum
    }

    fn send(&mut self) -> u16 {
        self.scanner.handle_timeout(self.now);
        while let Some(transmit) = self.scanner.poll_transmit(self.now, &mut *self.buf) {
            if self.count == self.sent.len() {
                self.sent.push((transmit, self.buf.clone()));
            }
            let (sent, bytes) = &mut self.sent[self.count];
            *sent = transmit;
            bytes[..transmit.len].copy_from_slice(&self.buf[..transmit.len]);
            self.count += 1;
        }
        let mut up = 0;
        while let Some((_, event)) = self.scanner.poll_event() {
            up += u16::from(event == LinkEvent::Up);
        }
        up
    }

    /// Gives the adapters what the scanner sent. Returns whether there was anything.
    fn deliver(&mut self) -> bool {
        let count = std::mem::take(&mut self.count);
        for (Transmit { port, to, len }, frame) in &self.sent[..count] {
            let number = match (port, to) {
                (Port::Stream(stream), _) => stream.0 as usize,
                (_, Some(to)) => number(*to.ip()),
                _ => continue,
            };
            let peer = to.map(|_| SocketAddrV4::new(SCANNER, IO_PORT));
            let from = Source { port: *port, peer };
            self.adapters[number].handle_frame(self.now, from, &frame[..*len]);
        }
        count > 0
    }
}
