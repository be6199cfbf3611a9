//! The event loop of a verb, and the signals that end it.

use anyhow::Context as _;
use tokio::runtime::{Builder, Runtime};
use tokio::signal::unix::{SignalKind, signal};

/// Creates the event loop: one thread, with timers and pipes.
pub(super) fn event_loop() -> anyhow::Result<Runtime> {
    Builder::new_current_thread().enable_all().build().context("cannot start the bench's event loop")
}

/// Resolves at the first Ctrl-C or SIGTERM.
pub(super) fn interrupt() -> anyhow::Result<impl Future<Output = ()>> {
    let mut interrupted = signal(SignalKind::interrupt()).context("cannot listen for Ctrl-C")?;
    let mut terminated = signal(SignalKind::terminate()).context("cannot listen for SIGTERM")?;
    Ok(async move {
        tokio::select! {
            _ = interrupted.recv() => {}
            _ = terminated.recv() => {}
        }
    })
}
