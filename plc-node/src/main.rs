//! `plc-node`: see [`plc_node::command_line`].

use std::process::ExitCode;

#[cfg(all(feature = "real", target_os = "linux"))]
#[global_allocator]
static ALLOCATOR: protocol_linux::allocation::AllocationCounter =
    protocol_linux::allocation::AllocationCounter;

fn main() -> ExitCode {
    plc_node::command_line::main(std::env::args_os())
}
