//! A stranger changes nothing between an IO-Controller and its IO-Device.
//!
//! The pair connects, exchanges data and parts, once alone and once while a station with other addresses sends altered
//! copies of all its frames, also of those that the pair sends later, to both. The pair must send the same bytes at the
//! same instants and report the same events, and while data are exchanged no frame of the stranger may cost heap memory.
//! It counts what the whole process allocates, so it has no test harness. `STRANGER_RUNS` sets the number of runs.

#![expect(clippy::expect_used, reason = "a test without a harness")]

use std::alloc::System;

use machine::Instant;
use machine::arp::ArpPacket;
use profinet::rt::Transport;
use stats_alloc::{INSTRUMENTED_SYSTEM, StatsAlloc};
use virtual_time::hostile::{Phases, Random, Stranger};

#[expect(dead_code, reason = "other tests use the others")]
#[path = "profinet/samples.rs"]
mod samples;

#[path = "strangers/pair.rs"]
mod pair;

use pair::{ControllerAndDevice, STATIONS};

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

const PHASES: Phases = Phases {
    up: Instant::from_millis(350),
    disconnect: Instant::from_millis(650),
    end: Instant::from_millis(660),
};

fn allocations() -> u64 {
    let stats = INSTRUMENTED_SYSTEM.stats();
    (stats.allocations + stats.reallocations) as u64
}

fn main() {
    let runs = std::env::var("STRANGER_RUNS").ok().and_then(|runs| runs.parse().ok()).unwrap_or(6);
    let mut total = [0_u64; 2];
    for transport in [Transport::Rt1, Transport::Udp] {
        // Without lists a station may be a controller or a device like any other while there is no connection: the stranger
        // begins when the device has accepted the Connect, and ends with the connection.
        for (listed, start_us, end_us) in [(false, 300_000, 650_000), (true, 0, 660_000)] {
            let (alone, _) =
                ControllerAndDevice::new::<Random>(transport, listed, allocations).run_whole(None, PHASES);
            assert!(alone.images[360..650].iter().all(|image| image[0].is_some() && image[1].is_some()));
            let heard = alone.sent.concat();
            // Whoever claims an address of the pair by ARP ends the connection, as it must.
            let mut without_claims = heard.clone();
            without_claims.retain(|sent| ArpPacket::from_frame(&sent.frame).is_none());
            for seed in 0..runs {
                let time = (Instant::from_micros(start_us), Instant::from_micros(end_us));
                let stranger = Stranger::new(seed, &without_claims, STATIONS, None, time);
                let (disturbed, foreign) = ControllerAndDevice::new(transport, listed, allocations)
                    .run_whole(Some(stranger), PHASES);
                assert!(
                    alone == disturbed,
                    "{transport:?}, listed: {listed}, seed {seed}: {}",
                    alone.difference::<ControllerAndDevice>(&disturbed)
                );
                total = [total[0] + foreign[0], total[1] + foreign[1]];
                // One with the addresses of a partner may end the connection, and nobody may panic.
                for side in [0, 1] {
                    let time = (Instant::ZERO, PHASES.end);
                    let forger = Stranger::new(seed, &heard, [STATIONS[side]; 2], None, time);
                    ControllerAndDevice::new(transport, listed, allocations).run_with_forger(
                        forger,
                        STATIONS[1 - side],
                        PHASES.end,
                    );
                }
            }
        }
    }
    assert!(total.iter().all(|frames| *frames > 1_000 * runs), "{total:?}");
    println!(
        "frames of strangers: {} to the controller, {} to the device; nothing changed",
        total[0], total[1]
    );
}
