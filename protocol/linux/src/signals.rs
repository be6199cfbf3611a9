//! SIGINT, SIGTERM and SIGHUP as a descriptor to poll, or as the end of the process with an exit code of its own.
//!
//! A closed terminal sends SIGHUP: what was measured is saved then, too. Under `nohup` that signal stays ignored. SIGXFSZ is
//! ignored in both ways, so that a write beyond `ulimit -f` fails like one to a full disk.

use std::fmt;
use std::os::fd::{AsFd, BorrowedFd, FromRawFd, OwnedFd};
use std::sync::atomic::{AtomicI32, Ordering};

use rustix::event::{PollFd, PollFlags, poll};
use rustix::io::retry_on_intr;

/// A request to stop.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum StopSignal {
    /// Ctrl-C.
    Interrupt,
    /// SIGTERM, which `kill` and a supervisor send.
    Terminate,
    /// SIGHUP: the terminal was closed.
    HangUp,
}

impl fmt::Display for StopSignal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Interrupt => "SIGINT",
            Self::Terminate => "SIGTERM",
            Self::HangUp => "SIGHUP",
        })
    }
}

/// Receives SIGINT, SIGTERM and SIGHUP, which no longer end the process.
#[derive(Debug)]
pub struct StopSignals(OwnedFd);

impl StopSignals {
    /// Blocks the signals for the whole process. Call it before any other thread exists: threads inherit the mask
    /// from the thread that creates them.
    pub fn block() -> std::io::Result<Self> {
        ignore_file_size_limit();
        // SAFETY: `set` is initialised by sigemptyset before it is used and outlives the calls; signalfd returns a
        // new descriptor that nobody else owns.
        unsafe {
            let mut set = std::mem::MaybeUninit::uninit();
            libc::sigemptyset(set.as_mut_ptr());
            libc::sigaddset(set.as_mut_ptr(), libc::SIGINT);
            libc::sigaddset(set.as_mut_ptr(), libc::SIGTERM);
            if !is_ignored(libc::SIGHUP) {
                libc::sigaddset(set.as_mut_ptr(), libc::SIGHUP);
            }
            let error = libc::pthread_sigmask(libc::SIG_BLOCK, set.as_ptr(), std::ptr::null_mut());
            if error != 0 {
                return Err(std::io::Error::from_raw_os_error(error));
            }
            let fd = libc::signalfd(-1, set.as_ptr(), libc::SFD_CLOEXEC | libc::SFD_NONBLOCK);
            if fd < 0 {
                return Err(std::io::Error::last_os_error());
            }
            Ok(Self(OwnedFd::from_raw_fd(fd)))
        }
    }

    /// Waits for the next signal.
    ///
    /// # Errors
    ///
    /// The system cannot wait.
    pub fn wait(&self) -> std::io::Result<StopSignal> {
        loop {
            if let Some(signal) = self.take() {
                return Ok(signal);
            }
            retry_on_intr(|| poll(&mut [PollFd::new(self, PollFlags::IN)], None))?;
        }
    }

    /// Returns the next signal, if one came.
    #[must_use]
    pub fn take(&self) -> Option<StopSignal> {
        let mut info = [0; size_of::<libc::signalfd_siginfo>()];
        let len = rustix::io::read(&self.0, &mut info).ok()?;
        // The number is the first field, ssi_signo: u32.
        let number = info.get(..len)?.first_chunk::<4>()?;
        Some(match u32::from_ne_bytes(*number).cast_signed() {
            libc::SIGINT => StopSignal::Interrupt,
            libc::SIGHUP => StopSignal::HangUp,
            _ => StopSignal::Terminate,
        })
    }
}

impl AsFd for StopSignals {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.0.as_fd()
    }
}

/// Exit code at a stop signal; 0 where the program handles them itself.
static EXIT_CODE: AtomicI32 = AtomicI32::new(0);

/// Ends the process at SIGINT, SIGTERM or SIGHUP with this exit code, until [`handle_stop`] is called or the signals are blocked by
/// [`StopSignals::block`]. A shell sees the same end for all of them then.
pub fn exit_on_stop(code: u8) {
    extern "C" fn end(_signal: libc::c_int) {
        let code = EXIT_CODE.load(Ordering::Relaxed);
        if code != 0 {
            // SAFETY: `_exit` may be called in a signal handler.
            unsafe { libc::_exit(code) }
        }
    }
    EXIT_CODE.store(code.into(), Ordering::Relaxed);
    ignore_file_size_limit();
    for signal in [libc::SIGINT, libc::SIGTERM, libc::SIGHUP] {
        if signal == libc::SIGHUP && is_ignored(signal) {
            continue;
        }
        // SAFETY: all zero is a valid `sigaction`, and `end` does only what a signal handler may. The call fails only for a
        // signal that does not exist.
        unsafe {
            let mut action: libc::sigaction = std::mem::zeroed();
            action.sa_sigaction = end as extern "C" fn(libc::c_int) as libc::sighandler_t;
            action.sa_flags = libc::SA_RESTART;
            libc::sigaction(signal, &raw const action, std::ptr::null_mut());
        }
    }
}

/// Leaves the stop signals to handlers of the program's own. These call the handler that was there before, which then
/// does nothing.
pub fn handle_stop() {
    EXIT_CODE.store(0, Ordering::Relaxed);
}

/// Returns whether whoever started the process has it ignore this signal.
#[must_use]
fn is_ignored(signal: libc::c_int) -> bool {
    // SAFETY: all zero is a valid `sigaction`; without a new action the call only writes the present one to it.
    unsafe {
        let mut action: libc::sigaction = std::mem::zeroed();
        libc::sigaction(signal, std::ptr::null(), &raw mut action);
        action.sa_sigaction == libc::SIG_IGN
    }
}

/// Returns whether SIGHUP is ignored, as under `nohup`: then it does not stop the program.
#[must_use]
pub fn ignores_hang_up() -> bool {
    is_ignored(libc::SIGHUP)
}

/// Lets a write beyond the limit of a file's size fail with an error in place of a signal that ends the process.
fn ignore_file_size_limit() {
    // SAFETY: ignoring a signal runs no code.
    unsafe {
        libc::signal(libc::SIGXFSZ, libc::SIG_IGN);
    }
}
