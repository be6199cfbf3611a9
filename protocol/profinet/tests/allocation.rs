//! Once data go both ways, neither the IO-Controller nor the IO-Device takes memory from the heap, not even for
//! damaged frames. It counts what the whole process allocates, so it is alone in its file and has no
//! test harness, whose own thread allocates when it likes.

#![expect(clippy::expect_used, reason = "a test without a harness")]

use std::alloc::System;
use std::net::{Ipv4Addr, SocketAddrV4};
use std::time::Duration;

use machine::LinkEvent;
use machine::arp::ArpPacket;
use machine::ethernet::Mac;
use machine::wire::FRAME_CAPACITY;
use machine::{Instant, Machine, Port, Source};
use profinet::rt::Transport;
use profinet::{Ar, ArConfig, ArId, Controller, ControllerConfig, Device, DeviceConfig, Parameter};
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};

#[expect(dead_code, reason = "other tests use the others")]
#[path = "profinet/samples.rs"]
mod samples;

use samples::LEN;

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

const CONTROLLER: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 1);
const DEVICE: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 2);
const STATIONS: [(Mac, Ipv4Addr); 2] =
    [(Mac([2, 0, 0, 0, 0, 1]), CONTROLLER), (Mac([2, 0, 0, 0, 0, 2]), DEVICE)];
const MASK: Ipv4Addr = Ipv4Addr::new(255, 255, 255, 0);

/// Hands over what one machine has to send, and answers what it asks by ARP as the other one's host would; returns whether
/// there was anything.
fn hand_over(
    now: Instant,
    from: &mut impl Machine,
    source: Ipv4Addr,
    to: &mut impl Machine,
    buf: &mut [u8],
) -> bool {
    let Some(transmit) = from.poll_transmit(now, buf) else { return false };
    let peer = match (transmit.port, transmit.to) {
        (Port::Udp(port), Some(_)) => Some(SocketAddrV4::new(source, port)),
        _ => None,
    };
    let frame = buf.get(..transmit.len).unwrap_or_default();
    if let Some(Ok(question)) = ArpPacket::from_frame(frame)
        && let Some((mac, _)) = STATIONS.iter().find(|(_, address)| *address == question.target_address)
        && question.sender_mac != *mac
        && !question.is_probe()
    {
        let mut answer = [0; 64];
        let len = question.answer(*mac).emit_frame(&mut answer).expect("60 bytes");
        from.handle_frame(
            now,
            Source { port: Port::Ethernet, peer: None },
            answer.get(..len).unwrap_or_default(),
        );
    }
    let port = transmit.to.map_or(transmit.port, |to| Port::Udp(to.port()));
    to.handle_frame(now, Source { port, peer }, buf.get(..transmit.len).unwrap_or_default());
    true
}

/// Both on a cable that needs neither time nor memory.
struct Cable {
    controller: Controller,
    ar: ArId,
    device: Device,
    now: Instant,
    buf: [u8; FRAME_CAPACITY],
}

impl Cable {
    fn ar(&self) -> &Ar {
        self.controller.ar(self.ar).expect("the AR is there")
    }

    /// Sets what the controller and the device send.
    fn set(&mut self, output: u8, input: u8) {
        let ar = self.controller.ar_mut(self.ar).expect("the AR is there");
        ar.set_output(1, 1, &[output; LEN]).expect("256 bytes");
        self.device.set_input(1, 1, &[input; LEN]).expect("256 bytes");
    }

    fn run_until(&mut self, until: Instant) {
        let Self { controller, device, now, buf, .. } = self;
        loop {
            while hand_over(*now, controller, CONTROLLER, device, buf)
                || hand_over(*now, device, DEVICE, controller, buf)
            {}
            while controller.poll_event().is_some() {}
            while let Some(event) = device.poll_event() {
                if matches!(event, LinkEvent::SetAddress { .. }) {
                    device.address_set(*now, true);
                }
            }
            let next = [controller.poll_timeout(), device.poll_timeout()].into_iter().flatten().min();
            match next {
                _ if *now >= until => return,
                Some(next) => *now = next.max(*now),
                None => return,
            }
            if controller.poll_timeout().is_some_and(|at| at <= *now) {
                controller.handle_timeout(*now);
            }
            if device.poll_timeout().is_some_and(|at| at <= *now) {
                device.handle_timeout(*now);
            }
        }
    }
}

fn main() {
    for transport in [Transport::Udp, Transport::Rt1] {
        let config = ControllerConfig {
            mac: Mac([2, 0, 0, 0, 0, 1]),
            station_name: "controller".into(),
            address: CONTROLLER,
            mask: MASK,
            description: samples::CONTROLLER,
            seed: 1,
        };
        let mut controller = Controller::new(config).expect("a valid configuration");
        let config = ArConfig {
            station_name: "device".into(),
            mac: None,
            address: DEVICE,
            description: samples::DEVICE,
            parameters: vec![Parameter::interface_adjust()],
            transport,
            cycle: Duration::from_millis(1),
            watchdog_cycles: 20,
        };
        let ar = controller.connect(config, Instant::ZERO).expect("a valid configuration");
        let device = DeviceConfig {
            mac: Mac([2, 0, 0, 0, 0, 2]),
            station_name: b"device".to_vec(),
            permanent: None,
            address: None,
            mask: MASK,
            description: samples::DEVICE,
            controllers: machine::Allowed::default(),
        };
        let mut cable = Cable {
            controller,
            ar,
            device: Device::new(device, Instant::ZERO),
            now: Instant::ZERO,
            buf: [0; FRAME_CAPACITY],
        };
        cable.set(1, 2);
        cable.run_until(Instant::from_millis(400));
        assert_eq!(cable.ar().input(1, 1), Some(&[2; LEN][..]), "{transport:?}");

        let region = Region::new(ALLOCATOR);
        for second in 0..10_u8 {
            cable.set(second, second);
            for port in [Port::Ethernet, Port::Udp(34_962), Port::Udp(34_964)] {
                let stranger = Source { port, peer: Some(SocketAddrV4::new(DEVICE, 1)) };
                cable.controller.handle_frame(cable.now, stranger, &[second; 200]);
                let stranger = Source { port, peer: Some(SocketAddrV4::new(CONTROLLER, 1)) };
                cable.device.handle_frame(cable.now, stranger, &[second; 200]);
            }
            let until = cable.now + Duration::from_secs(1);
            cable.run_until(until);
        }
        let stats = region.change();
        assert_eq!(cable.ar().input(1, 1), Some(&[9; LEN][..]));
        assert!(cable.ar().counters().received > 9_900);
        assert_eq!((stats.allocations, stats.reallocations), (0, 0), "{transport:?}");
    }
}
