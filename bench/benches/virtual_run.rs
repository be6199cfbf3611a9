//! Whole virtual runs, planned too: every PLC scan, robot cycle and frame of both nodes. And runs of many stations, from the start to
//! the end of CM.

#![expect(clippy::unwrap_used, reason = "a benchmark ends by panicking")]

use bench::verbs::scale::plant::{ScalePlant, ScaledBus};
use plc_node::ExecutionType;
use records::schedule::Schedule;
use stands::virtual_run::{CellRun, whole};

/// Numbers of stations: the second costs as much as each of the others.
const STATIONS: [u32; 3] = [1, 2, 64];

fn main() {
    hot_path::main(|paths| {
        let each = ScaledBus::ALL.into_iter().flat_map(|bus| STATIONS.map(|count| (bus, count)));
        // Each frame of EtherCAT passes all devices, so its cost grows with the square of their number.
        for (bus, count) in each.filter(|(bus, count)| *bus != ScaledBus::Ethercat || *count <= 2) {
            let started =
                move || CellRun::start(&ScalePlant::on(bus).unwrap().stations(count).unwrap(), 1).unwrap();
            paths.add(
                "virtual cell",
                format!("CM of {count}, {}", bus.key()),
                started,
                |mut run: CellRun| {
                    let step = Schedule::new(&[ExecutionType::Cm], 1, 1).steps().next().unwrap();
                    run.execute(step).unwrap();
                    run
                },
            );
        }
        for setup in ["A", "B"] {
            let input = move || planning::setup_with_application(setup).unwrap();
            for execution_type in ExecutionType::ALL {
                paths.add(
                    "virtual run",
                    format!("one {execution_type}, Setup {setup}"),
                    input,
                    move |(setup, found)| {
                        whole(&setup, &found.application, &Schedule::new(&[execution_type], 1, 1)).unwrap()
                    },
                );
            }
            paths.add_timed("virtual run", format!("all 75 runs, Setup {setup}"), input, |(setup, found)| {
                whole(&setup, &found.application, &Schedule::new(&ExecutionType::ALL, 25, 1)).unwrap()
            });
        }
    });
}
