//! A stranger changes nothing between a scanner and its adapter.
//!
//! The pair connects, exchanges data and parts, once alone and once while a host with another address sends altered
//! copies of all its messages and frames, also of those that the pair sends later, to both: over UDP and over up to 24 TCP
//! connections with sessions of their own. The pair must send the same bytes at the same instants and report the same
//! events, and while data are exchanged nothing of the stranger may cost heap memory. `STRANGER_RUNS` sets the number of
//! runs.

#![expect(clippy::unwrap_used, reason = "a test fails by a panic")]

use std::net::SocketAddrV4;

use ethernet_ip::ENCAPSULATION_PORT;
use machine::Instant;
use protocol_linux::allocation::{self, AllocationCounter};
use virtual_time::hostile::{Phases, Random, Stranger};

#[path = "ethernet_ip/samples.rs"]
mod samples;

#[path = "strangers/pair.rs"]
mod pair;

use pair::{STATIONS, ScannerAndAdapter};

#[global_allocator]
static ALLOCATOR: AllocationCounter = AllocationCounter;

const PHASES: Phases = Phases {
    up: Instant::from_millis(50),
    disconnect: Instant::from_millis(350),
    end: Instant::from_millis(360),
};

#[test]
fn a_stranger_that_sends_altered_copies_of_all_frames_changes_nothing_and_costs_no_memory() {
    let runs = std::env::var("STRANGER_RUNS").ok().and_then(|runs| runs.parse().ok()).unwrap_or(6);
    let mut total = [0_u64; 2];
    assert!(allocation::arm(), "allocations are not counted");
    // Without a list the stranger may own the outputs as long as nobody else does: it begins when the scanner's
    // Forward_Open is answered, and ends with the connection. With it the stranger begins at once.
    for (listed, start_us, end_us) in [(false, 400, 350_000), (true, 0, 360_000)] {
        let (alone, _) = ScannerAndAdapter::new::<Random>(listed, allocation::count).run_whole(None, PHASES);
        assert!(alone.images[60..350].iter().all(|image| image[0].is_some() && image[1].is_some()));
        let heard = alone.sent.concat();
        for seed in 0..runs {
            let time = (Instant::from_micros(start_us), Instant::from_micros(end_us));
            let listen = Some(SocketAddrV4::new(STATIONS[1].1, ENCAPSULATION_PORT));
            let stranger = Stranger::new(seed, &heard, STATIONS, listen, time);
            let (disturbed, foreign) =
                ScannerAndAdapter::new(listed, allocation::count).run_whole(Some(stranger), PHASES);
            assert!(
                alone == disturbed,
                "listed: {listed}, seed {seed}: {}",
                alone.difference::<ScannerAndAdapter>(&disturbed)
            );
            total = [total[0] + foreign[0], total[1] + foreign[1]];
            // One with the address of a partner may end the connection, and nobody may panic.
            for side in [0, 1] {
                let time = (Instant::ZERO, PHASES.end);
                let forger = Stranger::new(seed, &heard, [STATIONS[side]; 2], listen, time);
                ScannerAndAdapter::new(listed, allocation::count).run_with_forger(
                    forger,
                    STATIONS[1 - side],
                    PHASES.end,
                );
            }
        }
    }
    assert!(total.iter().all(|frames| *frames > 500 * runs), "{total:?}");
    println!(
        "frames of strangers: {} to the scanner, {} to the adapter; nothing changed",
        total[0], total[1]
    );
}
