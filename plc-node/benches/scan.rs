//! The PLC's scan, over a connection without a bus protocol.

#![expect(clippy::unwrap_used, reason = "a benchmark ends by panicking")]

use machine::wire::FRAME_CAPACITY;
use machine::{Duration, Instant, Multihomed as _};
use planning::PROGRAM;
use plc_node::{PlcConfig, PlcNode};
use protocol::direct::Direct;
use protocol::one_station::OneStation;

const SCANS: u32 = 10;

fn main() {
    hot_path::main(|paths| {
        paths.add("PLC", format!("{SCANS} scans"), plc, |mut plc: PlcNode<OneStation<Direct>>| {
            let mut buf = [0; FRAME_CAPACITY];
            let end = Instant::ZERO + Duration::from_millis(1) * SCANS;
            while let Some(now) = plc.poll_timeout().filter(|due| *due < end) {
                plc.handle_timeout(now);
                while plc.poll_transmit(now, &mut buf).is_some() {}
                while plc.poll_event().is_some() {}
            }
            plc
        });
    });
}

fn plc() -> PlcNode<OneStation<Direct>> {
    let (setup, application) = planning::setup_with_application("A").unwrap();
    let motions = application.plan(&setup).unwrap().wire_motions(&setup);
    let cycle = Duration::from_millis(1);
    let bus = Direct::new(Instant::ZERO, cycle, cycle * 20);
    PlcNode::new(PlcConfig::from_setup(&setup, motions, PROGRAM), OneStation::new(bus), Instant::ZERO)
}
