//! `robot-node`: see [`robot_node::process`].

use std::process::ExitCode;

#[global_allocator]
static ALLOCATOR: protocol_linux::allocation::AllocationCounter =
    protocol_linux::allocation::AllocationCounter;

fn main() -> ExitCode {
    robot_node::process::main(std::env::args_os())
}
