//! Whole virtual runs, planned too: every PLC scan, robot cycle and frame of both nodes.

#![expect(clippy::unwrap_used, reason = "a benchmark ends by panicking")]

use plc_node::ExecutionType;
use records::schedule::Schedule;
use stands::virtual_run::whole;

fn main() {
    hot_path::main(|paths| {
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
