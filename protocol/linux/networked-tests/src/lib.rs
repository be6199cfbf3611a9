//! A harness for tests that make network namespaces, for root and for ordinary users.
//!
//! An ordinary user may make networks only as root of a user namespace, and a process enters one only while it has one
//! thread. The usual harness already runs its tests on threads, so this one replaces it: a test target with
//! `harness = false` lists its tests in `main`.
//!
//! ```no_run
//! # mod streams { pub fn a_client_is_answered() {} }
//! # fn a_frame_arrives() {}
//! fn main() -> std::process::ExitCode {
//!     networked_tests::run(networked_tests::tests![a_frame_arrives, streams::a_client_is_answered])
//! }
//! ```
//!
//! Options and output are those of the usual harness. On a host that does not allow ordinary users to make networks, the
//! tests count as ignored and the reason is printed. For root, and if [`REQUIRED`] is set, they fail there instead.

#![expect(clippy::print_stderr, reason = "a harness tells why it does not run its tests")]

mod cable;

use std::process::ExitCode;
use std::thread::available_parallelism;

use libtest_mimic::{Arguments, Trial};
use protocol_linux::namespace::{NamespaceError, NetworkNamespace, enter_user_namespace};

pub use cable::{End, cable};

/// Environment variable: if set, tests that cannot make networks fail for an ordinary user too.
pub const REQUIRED: &str = "NETWORKED_TESTS_REQUIRED";

/// Tests that run at once for each core: they wait for frames most of the time, each in networks of its own.
const TESTS_FOR_EACH_CORE: usize = 2;

/// A test with its name.
pub type Test = (&'static str, fn());

/// Lists tests by their paths.
#[macro_export]
macro_rules! tests {
    ($($test:path),+ $(,)?) => { [$((stringify!($test), $test as fn())),+] };
}

/// Runs the tests that the command line asks for, in a user namespace where this user needs one. Call it first in
/// `main`.
pub fn run(tests: impl IntoIterator<Item = Test>) -> ExitCode {
    run_beside(tests, [])
}

/// Runs tests like [`run`], and `others` that need no network and so run everywhere.
pub fn run_beside(tests: impl IntoIterator<Item = Test>, others: impl IntoIterator<Item = Test>) -> ExitCode {
    let mut arguments = Arguments::from_args();
    let cores = available_parallelism().map_or(1, usize::from);
    arguments.test_threads.get_or_insert(TESTS_FOR_EACH_CORE * cores);
    let is_root = rustix::process::getuid().is_root();
    let refusal = if arguments.list { None } else { make_networks().err() };
    if let Some(reason) = &refusal
        && (is_root || std::env::var_os(REQUIRED).is_some())
    {
        eprintln!("error: these tests make networks: {reason}");
        return ExitCode::FAILURE;
    }
    let others = others.into_iter().map(trial);
    let tests = tests.into_iter().map(|test| trial(test).with_ignored_flag(refusal.is_some()));
    let conclusion = libtest_mimic::run(&arguments, tests.chain(others).collect());
    if let Some(reason) = refusal {
        eprintln!("not run, because they make networks: {}; {reason}\n", conclusion.num_ignored);
    }
    conclusion.exit_code()
}

fn trial((name, test): Test) -> Trial {
    let run = move || {
        test();
        Ok(())
    };
    Trial::test(name, run)
}

/// Enters a user namespace if necessary, and tries to make a network: some hosts allow only the former.
fn make_networks() -> Result<(), NamespaceError> {
    enter_user_namespace()?;
    NetworkNamespace::new().map(drop)
}
