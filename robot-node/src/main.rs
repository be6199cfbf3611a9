//! `robot-node`: see [`robot_node::process`].

use std::process::ExitCode;

#[cfg(all(feature = "real", target_os = "linux"))]
#[global_allocator]
static ALLOCATOR: protocol_linux::allocation::AllocationCounter =
    protocol_linux::allocation::AllocationCounter;

#[cfg(all(feature = "real", target_os = "linux"))]
fn main() -> ExitCode {
    robot_node::process::main(std::env::args_os())
}

#[cfg(not(all(feature = "real", target_os = "linux")))]
fn main() -> ExitCode {
    node::errln!(
        "error: this robot-node was built without real networks; build it on Linux with the feature `real`"
    );
    node::Outcome::EnvironmentUnusable.into()
}
