//! The controller against a scripted peer: one that does what a device does, or leaves out what the script says.

mod answers;
mod calls;
mod counters;
mod dissected;
mod health;
mod life;
mod peer;
mod silence;
mod startup;
mod station;
mod strangers;

use std::net::{Ipv4Addr, SocketAddrV4};

use machine::ethernet::Mac;
use machine::wire::FRAME_CAPACITY;
use machine::{DownCause, Duration, Instant, LinkEvent, Machine, Port, Source, Transmit};
use profinet::RPC_PORT;
use profinet::rpc::{Header, Kind};
use profinet::rt::Transport;
use profinet::{Ar, ArConfig, ArId, Controller, ControllerConfig, Parameter};

use crate::{is_arp, is_lldp, samples, tshark};
use peer::{PeerScript, ScriptedPeer};

const CONTROLLER: Mac = Mac([2, 0, 0, 0, 0, 1]);
const DEVICE: Mac = Mac([2, 0, 0, 0, 0, 2]);
const CONTROLLER_ADDRESS: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 1);
const DEVICE_ADDRESS: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 2);

fn controller() -> Controller {
    controller_with(1)
}

fn controller_with(seed: u64) -> Controller {
    Controller::new(ControllerConfig { seed, ..controller_config() }).unwrap()
}

fn controller_config() -> ControllerConfig {
    ControllerConfig {
        mac: CONTROLLER,
        station_name: "controller".into(),
        address: CONTROLLER_ADDRESS,
        mask: Ipv4Addr::new(255, 255, 255, 0),
        description: samples::CONTROLLER,
        seed: 1,
    }
}

fn ar(transport: Transport) -> ArConfig {
    ArConfig {
        station_name: "device".into(),
        mac: None,
        address: DEVICE_ADDRESS,
        description: samples::DEVICE,
        parameters: vec![Parameter { slot: 1, subslot: 1, index: 1, data: vec![1, 2, 3, 4] }],
        transport,
        cycle: Duration::from_millis(1),
        watchdog_cycles: 20,
    }
}

/// Controller and peer on a cable without delay.
struct Cell {
    controller: Controller,
    ar: ArId,
    peer: ScriptedPeer,
    now: Instant,
    events: Vec<LinkEvent>,
    frames: usize,
    /// The frames both ways, as on the cable.
    tap: Vec<Vec<u8>>,
}

impl Cell {
    fn new(transport: Transport, script: PeerScript) -> Self {
        Self::with(ar(transport), script)
    }

    fn with(config: ArConfig, script: PeerScript) -> Self {
        let mut controller = controller();
        let ar = controller.connect(config, Instant::ZERO).unwrap();
        let mut cell = Self {
            controller,
            ar,
            peer: ScriptedPeer::new(script),
            now: Instant::ZERO,
            events: Vec::new(),
            frames: 0,
            tap: Vec::new(),
        };
        // Up to the end of the Identify window, so that the steps after it are at the same times as their tests count.
        cell.run_until(Instant::from_millis(200) - Duration::from_nanos(1));
        cell
    }

    fn ar(&mut self) -> &mut Ar {
        self.controller.ar_mut(self.ar).unwrap()
    }

    /// Returns the first byte of the input data, if they are good.
    fn input(&mut self) -> Option<u8> {
        self.ar().input(1, 1).map(|data| data[0])
    }

    fn deliver(&mut self, (source, frame): (Source, Vec<u8>)) {
        self.tap_from_peer(&source, &frame);
        self.controller.handle_frame(self.now, source, &frame);
        self.drain();
    }

    fn tap_to_peer(&mut self, transmit: &Transmit, bytes: &[u8]) {
        self.keep(match (transmit.port, transmit.to) {
            (Port::Udp(port), Some(to)) => {
                let from = (CONTROLLER, SocketAddrV4::new(CONTROLLER_ADDRESS, port));
                tshark::frame(from, (DEVICE, to), bytes)
            }
            _ => bytes.to_vec(),
        });
    }

    fn tap_from_peer(&mut self, source: &Source, bytes: &[u8]) {
        self.keep(match (source.port, source.peer) {
            (Port::Udp(port), Some(mut from)) => {
                let to = (CONTROLLER, SocketAddrV4::new(CONTROLLER_ADDRESS, port));
                let is_answer = Header::parse(bytes).is_ok_and(|(header, _)| header.kind == Kind::Response);
                if port == RPC_PORT && is_answer {
                    // tshark finds the call of an answer only by the port that was called.
                    from.set_port(RPC_PORT);
                }
                tshark::frame((DEVICE, from), to, bytes)
            }
            _ => bytes.to_vec(),
        });
    }

    /// Keeps the first frames; long runs need no more.
    fn keep(&mut self, frame: Vec<u8>) {
        if self.tap.len() < 1_000 {
            self.tap.push(frame);
        }
    }

    /// Returns the next frame of the controller, except its announcements.
    fn poll(&mut self, buf: &mut [u8]) -> Option<Transmit> {
        let frames = core::iter::from_fn(|| {
            self.controller
                .poll_transmit(self.now, buf)
                .map(|transmit| (transmit, is_lldp(transmit.port, buf)))
        });
        frames.into_iter().find_map(|(transmit, is_lldp)| (!is_lldp).then_some(transmit))
    }

    fn drain(&mut self) {
        let mut buf = [0; FRAME_CAPACITY];
        for round in 0.. {
            assert!(round < 100, "the controller sends without end");
            let Some(transmit) = self.poll(&mut buf) else { break };
            let is_step = !is_arp(transmit.port, &buf[..transmit.len]);
            if is_step {
                self.frames += 1;
                self.tap_to_peer(&transmit, &buf[..transmit.len]);
            }
            for answer in self.peer.receive(self.now, &transmit, &buf[..transmit.len]) {
                if is_step {
                    self.tap_from_peer(&answer.0, &answer.1);
                }
                self.controller.handle_frame(self.now, answer.0, &answer.1);
            }
        }
        while let Some((ar, event)) = self.controller.poll_event() {
            assert_eq!(ar, self.ar);
            self.events.push(event);
        }
    }

    fn run_until(&mut self, until: Instant) {
        self.drain();
        while let Some(at) = self.controller.poll_timeout().filter(|at| *at <= until) {
            assert!(at > self.now || self.now == Instant::ZERO, "{at:?} is not after {:?}", self.now);
            self.now = at;
            self.controller.handle_timeout(at);
            self.drain();
        }
        self.now = until;
    }

    /// Runs for so many ms and returns the events of that time.
    fn run(&mut self, millis: u64) -> Vec<LinkEvent> {
        self.run_until(self.now + Duration::from_millis(millis));
        core::mem::take(&mut self.events)
    }

    /// Runs for so many ms and compares what is reported meanwhile: cause, status, and how the words begin.
    fn goes_down(&mut self, millis: u64, expected: &[(DownCause, u32, &str)]) {
        let events = self.run(millis);
        let is_it = |(event, (cause, code, words)): (&LinkEvent, &(DownCause, u32, &str))| match event {
            LinkEvent::Down(down) => {
                (down.cause, down.code) == (*cause, *code) && down.text.starts_with(words)
            }
            _ => false,
        };
        let same = events.len() == expected.len() && events.iter().zip(expected).all(is_it);
        assert!(same, "{events:?} instead of {expected:?}");
    }
}
