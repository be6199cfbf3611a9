//! A controller with many devices, without a network: one cycle of the controller is a hot path.

use std::net::{Ipv4Addr, SocketAddrV4};
use std::sync::{Arc, Mutex};

use hot_path::HotPaths;
use machine::arp::ArpPacket;
use machine::ethernet::Mac;
use machine::wire::FRAME_CAPACITY;
use machine::{Duration, Instant, LinkEvent, Machine, Port, Source, Transmit};
use profinet::rt::Transport;
use profinet::{ArConfig, ArId, Controller, ControllerConfig, Device, DeviceConfig};

use crate::samples::{self, LEN};

const MASK: Ipv4Addr = Ipv4Addr::new(255, 255, 0, 0);
const CONTROLLER: Ipv4Addr = Ipv4Addr::new(10, 0, 0, 1);
const MS: Duration = Duration::from_millis(1);

/// Numbers of stations: the second costs as much as each of the others.
const STATIONS: [u16; 3] = [1, 2, 64];

/// Adds one cycle of 1 ms for each number of stations: all inputs arrive, the PLC reads them and writes its outputs, which are
/// sent.
pub(crate) fn add(paths: &mut HotPaths) {
    for stations in STATIONS {
        for (name, transport) in [("rt1", Transport::Rt1), ("udp", Transport::Udp)] {
            let cell = Arc::new(Mutex::new(None));
            let prepare = move || {
                let mut place = cell.lock().unwrap();
                place.get_or_insert_with(|| Cell::connected(stations, transport)).prepare();
                drop(place);
                Arc::clone(&cell)
            };
            paths.add(
                "PROFINET controller",
                format!("cycle of {stations}, {name}"),
                prepare,
                |cell: Arc<Mutex<Option<Cell>>>| cell.lock().unwrap().as_mut().unwrap().cycle(),
            );
        }
    }
}

struct Frame {
    from: Source,
    bytes: Vec<u8>,
}

struct Cell {
    controller: Controller,
    ars: Vec<ArId>,
    devices: Vec<Device>,
    now: Instant,
    /// What the devices send in this cycle.
    frames: Vec<Frame>,
    /// What the controller sent in this cycle.
    sent: Vec<(Transmit, Box<[u8; FRAME_CAPACITY]>)>,
    count: usize,
    buf: Box<[u8; FRAME_CAPACITY]>,
}

fn address(device: u16) -> Ipv4Addr {
    let [high, low] = device.to_be_bytes();
    Ipv4Addr::new(10, 0, 1 + high, low)
}

fn mac(device: u16) -> Mac {
    let [high, low] = device.to_be_bytes();
    Mac([2, 0, 0, 1, high, low])
}

impl Cell {
    fn connected(stations: u16, transport: Transport) -> Self {
        let mut controller = Controller::new(ControllerConfig {
            mac: Mac([2, 0, 0, 0, 0, 1]),
            station_name: "controller".into(),
            address: CONTROLLER,
            mask: MASK,
            description: samples::CONTROLLER,
            seed: 1,
        })
        .unwrap();
        let connect = |device| {
            let config = ArConfig {
                station_name: format!("device-{device}"),
                mac: None,
                address: address(device),
                description: samples::DEVICE,
                parameters: Vec::new(),
                transport,
                cycle: MS,
                watchdog_cycles: 10,
            };
            controller.connect(config, Instant::ZERO).unwrap()
        };
        let ars = (0..stations).map(connect).collect();
        let device = |device| {
            let config = DeviceConfig {
                mac: mac(device),
                station_name: format!("device-{device}").into(),
                permanent: None,
                address: None,
                mask: MASK,
                description: samples::DEVICE,
                controllers: machine::Allowed::default(),
            };
            let mut device = Device::new(config, Instant::ZERO);
            device.set_input(1, 1, &[0xD0; LEN]).unwrap();
            device
        };
        let devices = (0..stations).map(device).collect();
        let buf = Box::new([0; FRAME_CAPACITY]);
        let mut cell = Self {
            controller,
            ars,
            devices,
            now: Instant::ZERO,
            frames: Vec::new(),
            sent: Vec::new(),
            count: 0,
            buf,
        };
        while !cell.ars.iter().all(|ar| cell.controller.ar(*ar).unwrap().is_up()) {
            cell.step();
            assert!(cell.now < Instant::from_millis(20_000), "not all come up");
        }
        for _ in 0..100 {
            cell.step();
        }
        cell
    }

    /// Lets 1 ms pass and everything arrive.
    fn step(&mut self) {
        self.prepare();
        loop {
            self.cycle();
            let has_sent = self.deliver();
            self.collect();
            if !has_sent && self.frames.is_empty() {
                return;
            }
        }
    }

    /// Lets 1 ms pass for the devices, and keeps what they send.
    fn prepare(&mut self) {
        self.deliver();
        self.now += MS;
        for device in &mut self.devices {
            device.handle_timeout(self.now);
        }
        self.collect();
    }

    fn collect(&mut self) {
        self.frames.clear();
        for (device, number) in self.devices.iter_mut().zip(0..) {
            while let Some(event) = device.poll_event() {
                if let LinkEvent::SetAddress { .. } = event {
                    device.address_set(self.now, true);
                }
            }
            while let Some(Transmit { port, to, len }) = device.poll_transmit(self.now, &mut *self.buf) {
                let peer = match port {
                    Port::Udp(port) => Some(SocketAddrV4::new(address(number), port)),
                    _ => None,
                };
                let port = to.map_or(port, |to| Port::Udp(to.port()));
                let bytes = self.buf[..len].to_vec();
                self.frames.push(Frame { from: Source { port, peer }, bytes });
            }
        }
    }

    /// One cycle of the controller, as a PLC's driver runs it.
    fn cycle(&mut self) -> usize {
        let Self { controller, now, frames, .. } = self;
        for Frame { from, bytes } in frames.iter() {
            controller.handle_frame(*now, *from, bytes);
        }
        let mut sum = 0;
        for ar in &self.ars {
            let ar = controller.ar_mut(*ar).unwrap();
            let first = ar.input(1, 1).map_or(0, |input| input[0]);
            sum += usize::from(first);
            ar.set_output(1, 1, &[first; LEN]).unwrap();
        }
        controller.handle_timeout(*now);
        while let Some(transmit) = self.controller.poll_transmit(self.now, &mut *self.buf) {
            if self.count == self.sent.len() {
                self.sent.push((transmit, self.buf.clone()));
            }
            let (sent, bytes) = &mut self.sent[self.count];
            *sent = transmit;
            bytes[..transmit.len].copy_from_slice(&self.buf[..transmit.len]);
            self.count += 1;
        }
        while self.controller.poll_event().is_some() {}
        assert!(self.controller.poll_timeout().is_some_and(|due| due > self.now));
        sum
    }

    /// Gives the devices what the controller sent. Returns whether there was anything.
    fn deliver(&mut self) -> bool {
        let sent = std::mem::take(&mut self.sent);
        let count = std::mem::take(&mut self.count);
        for (Transmit { port, to, len }, frame) in &sent[..count] {
            let frame = &frame[..*len];
            let number = match to {
                Some(to) => {
                    let [_, _, high, low] = to.ip().octets();
                    Some(u16::from_be_bytes([high - 1, low]))
                }
                None if frame[..4] == [2, 0, 0, 1] => Some(u16::from_be_bytes([frame[4], frame[5]])),
                None => None,
            };
            let port = to.map_or(*port, |to| Port::Udp(to.port()));
            let from = Source { port, peer: to.map(|to| SocketAddrV4::new(CONTROLLER, to.port())) };
            match number {
                Some(number) => self.devices[usize::from(number)].handle_frame(self.now, from, frame),
                None => self.devices.iter_mut().for_each(|device| device.handle_frame(self.now, from, frame)),
            }
            self.answer(frame);
        }
        self.sent = sent;
        count > 0
    }

    /// Answers a question by ARP as the host of the device would.
    fn answer(&mut self, frame: &[u8]) {
        let Some(Ok(question)) = ArpPacket::from_frame(frame) else { return };
        let devices = 0..self.devices.len() as u16;
        let Some(asked) = devices.into_iter().find(|device| address(*device) == question.target_address)
        else {
            return;
        };
        if question.is_probe() {
            return;
        }
        let mut answer = [0; 64];
        let len = question.answer(mac(asked)).emit_frame(&mut answer).unwrap();
        let from = Source { port: Port::Ethernet, peer: None };
        self.controller.handle_frame(self.now, from, &answer[..len]);
    }
}
