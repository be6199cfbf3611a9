//! The event loop of a verb, and the signals that end it.

use std::process;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use anyhow::Context as _;
use tokio::runtime::{Builder, Runtime};
#[cfg(unix)]
use tokio::signal::unix::{SignalKind, signal};

use records::exit::Exit;
use report::errln;

/// Creates the event loop: one thread, with timers and pipes.
pub fn event_loop() -> anyhow::Result<Runtime> {
    Builder::new_current_thread().enable_all().build().context("cannot start the bench's event loop")
}

/// Resolves at the first Ctrl-C, SIGTERM or SIGHUP; under `nohup`, SIGHUP does nothing.
#[cfg(unix)]
pub fn interrupt() -> anyhow::Result<impl Future<Output = ()>> {
    let mut interrupted = signal(SignalKind::interrupt()).context("cannot listen for Ctrl-C")?;
    let mut terminated = signal(SignalKind::terminate()).context("cannot listen for SIGTERM")?;
    #[cfg(all(feature = "real", target_os = "linux"))]
    let ignores_hang_up = protocol_linux::ignores_hang_up();
    #[cfg(not(all(feature = "real", target_os = "linux")))]
    let ignores_hang_up = true;
    let mut hung_up = match ignores_hang_up {
        true => None,
        false => Some(signal(SignalKind::hangup()).context("cannot listen for SIGHUP")?),
    };
    #[cfg(all(feature = "real", target_os = "linux"))]
    protocol_linux::handle_stop();
    Ok(async move {
        let hang_up = async {
            match &mut hung_up {
                Some(signal) => _ = signal.recv().await,
                None => std::future::pending().await,
            }
        };
        tokio::select! {
            _ = interrupted.recv() => {}
            _ = terminated.recv() => {}
            () = hang_up => {}
        }
    })
}

/// Resolves at the first Ctrl-C.
#[cfg(not(unix))]
pub fn interrupt() -> anyhow::Result<impl Future<Output = ()>> {
    Ok(async {
        // If nobody can listen, Ctrl-C ends the program.
        if tokio::signal::ctrl_c().await.is_err() {
            std::future::pending::<()>().await;
        }
    })
}

/// Time in which a second signal belongs to the first: `timeout` sends two.
const TOGETHER: Duration = Duration::from_millis(500);

/// Returns a flag that the first Ctrl-C or SIGTERM sets, so that jobs can end and the results so far be printed. A later
/// one ends the process, since a job may be long.
pub fn watch_for_interrupt() -> anyhow::Result<Arc<AtomicBool>> {
    let runtime = event_loop()?;
    let first = runtime.block_on(async { interrupt() })?;
    let flag = Arc::new(AtomicBool::new(false));
    let set = Arc::clone(&flag);
    thread::spawn(move || {
        runtime.block_on(async {
            first.await;
            set.store(true, Ordering::Relaxed);
            tokio::time::sleep(TOGETHER).await;
            errln!("finishing the current jobs; press Ctrl-C again to stop now");
            if let Ok(second) = interrupt() {
                second.await;
                process::exit(Exit::Interrupted as i32);
            }
        });
    });
    Ok(flag)
}

/// Reports how much was done before an interrupt.
pub fn interrupted(done: usize, all: usize, things: &str) -> Exit {
    errln!("interrupted, {done} of {all} {things}");
    Exit::Interrupted
}
