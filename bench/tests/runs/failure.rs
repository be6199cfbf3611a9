//! The reason why a run with a fault fails, in virtual time.

use std::time::Duration;

use planning::Application;
use plc_node::ExecutionType;
use records::schedule::Step;
use setup::Setup;
use stands::Stand as _;
use stands::virtual_run::{Extras, VirtualRun};

/// Runs CM once with a fault, and returns the reason of its failure.
pub(crate) fn failure(setup: &Setup, application: &Application, fault: &str) -> Option<String> {
    let extras = Extras { faults: vec![fault.parse().unwrap()], ..Extras::default() };
    let mut run = VirtualRun::start_with(setup, application, 1, &extras).unwrap();
    let pause = Duration::from_millis(50);
    let step = Step { execution_type: ExecutionType::Cm, repetition: 2, pause, overrides: None };
    let runtime = tokio::runtime::Builder::new_current_thread().build().unwrap();
    runtime.block_on(run.execute(step)).err().map(|error| format!("{error:#}"))
}
