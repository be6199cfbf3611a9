//! `plc-node`: see [`plc_node::process`].

use std::process::ExitCode;

#[global_allocator]
static ALLOCATOR: protocol_linux::allocation::AllocationCounter =
    protocol_linux::allocation::AllocationCounter;

fn main() -> ExitCode {
    plc_node::process::main(std::env::args_os())
}
