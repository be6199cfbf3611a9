//! Once data go both ways, neither the IO-Controller nor the IO-Device takes memory from the heap, not even for
//! damaged frames. It counts what the whole process allocates, so it is alone in its file and has no
//! test harness, whose own thread allocates when it likes.

#![expect(clippy::expect_used, reason = "a test without a harness")]

use std::alloc::System;
use std::net::{Ipv4Addr, SocketAddrV4};
use std::time::Duration;

use machine::LinkEvent;
use machine::ethernet::Mac;
use machine::wire::FRAME_CAPACITY;
use machine::{Instant, Machine, Port, Source};
use profinet::IO_DATA_LEN;
use profinet::description::ROBOT;
use profinet::rt::Transport;
use profinet::{Controller, ControllerConfig, Device, DeviceConfig, Parameter};
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

const PLC: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 1);
const ROBOT_ADDRESS: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 2);
const MASK: Ipv4Addr = Ipv4Addr::new(255, 255, 255, 0);

/// Hands over what one machine has to send; returns whether there was anything.
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
    let port = transmit.to.map_or(transmit.port, |to| Port::Udp(to.port()));
    to.handle_frame(now, Source { port, peer }, buf.get(..transmit.len).unwrap_or_default());
    true
}

/// Both on a cable that needs neither time nor memory.
struct Cable {
    controller: Controller,
    device: Device,
    now: Instant,
    buf: [u8; FRAME_CAPACITY],
}

impl Cable {
    fn run_until(&mut self, until: Instant) {
        let Self { controller, device, now, buf } = self;
        loop {
            while hand_over(*now, controller, PLC, device, buf)
                || hand_over(*now, device, ROBOT_ADDRESS, controller, buf)
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
            station_name: "plc".into(),
            address: PLC,
            mask: MASK,
            device_station_name: "robot".into(),
            device_address: ROBOT_ADDRESS,
            description: ROBOT,
            parameters: vec![Parameter::interface_adjust()],
            transport,
            cycle: Duration::from_millis(1),
            watchdog_cycles: 20,
            seed: 1,
        };
        let device = DeviceConfig {
            mac: Mac([2, 0, 0, 0, 0, 2]),
            station_name: b"robot".to_vec(),
            address: None,
            mask: MASK,
            description: ROBOT,
        };
        let mut cable = Cable {
            controller: Controller::new(config, Instant::ZERO).expect("a valid configuration"),
            device: Device::new(device, Instant::ZERO),
            now: Instant::ZERO,
            buf: [0; FRAME_CAPACITY],
        };
        cable.controller.set_output(&[1; IO_DATA_LEN]);
        cable.device.set_output(&[2; IO_DATA_LEN]);
        cable.run_until(Instant::from_millis(100));
        assert_eq!(cable.controller.input(), Some(&[2; IO_DATA_LEN]), "{transport:?}");

        let region = Region::new(ALLOCATOR);
        for second in 0..10_u8 {
            cable.controller.set_output(&[second; IO_DATA_LEN]);
            cable.device.set_output(&[second; IO_DATA_LEN]);
            for port in [Port::Ethernet, Port::Udp(34_962), Port::Udp(34_964)] {
                let stranger = Source { port, peer: Some(SocketAddrV4::new(ROBOT_ADDRESS, 1)) };
                cable.controller.handle_frame(cable.now, stranger, &[second; 200]);
                let stranger = Source { port, peer: Some(SocketAddrV4::new(PLC, 1)) };
                cable.device.handle_frame(cable.now, stranger, &[second; 200]);
            }
            let until = cable.now + Duration::from_secs(1);
            cable.run_until(until);
        }
        let stats = region.change();
        assert_eq!(cable.controller.input(), Some(&[9; IO_DATA_LEN]));
        assert!(cable.controller.counters().received > 9_900);
        assert_eq!((stats.allocations, stats.reallocations), (0, 0), "{transport:?}");
    }
}
