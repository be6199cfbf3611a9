//! SIGINT and SIGTERM as a descriptor to poll, or as the end of the process with an exit code of its own.

use std::fmt;
use std::os::fd::{AsFd, BorrowedFd, FromRawFd, OwnedFd};
use std::sync::atomic::{AtomicI32, Ordering};

/// A request to stop.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum StopSignal {
    /// Ctrl-C.
    Interrupt,
    /// SIGTERM, which `kill` and a supervisor send.
    Terminate,
}

impl fmt::Display for StopSignal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Interrupt => "SIGINT",
            Self::Terminate => "SIGTERM",
        })
    }
}

/// Receives SIGINT and SIGTERM, which no longer end the process.
#[derive(Debug)]
pub struct StopSignals(OwnedFd);

impl StopSignals {
    /// Blocks the two signals for the whole process. Call it before any other thread exists: threads inherit the mask
    /// from the thread that creates them.
    pub fn block() -> std::io::Result<Self> {
        // SAFETY: `set` is initialised by sigemptyset before it is used and outlives the calls; signalfd returns a
        // new descriptor that nobody else owns.
        unsafe {
            let mut set = std::mem::MaybeUninit::uninit();
            libc::sigemptyset(set.as_mut_ptr());
            libc::sigaddset(set.as_mut_ptr(), libc::SIGINT);
            libc::sigaddset(set.as_mut_ptr(), libc::SIGTERM);
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

    /// Returns the next signal, if one came.
    #[must_use]
    pub fn take(&self) -> Option<StopSignal> {
        let mut info = [0; size_of::<libc::signalfd_siginfo>()];
        let len = rustix::io::read(&self.0, &mut info).ok()?;
        // The number is the first field, ssi_signo: u32.
        let number = info.get(..len)?.first_chunk::<4>()?;
        Some(if u32::from_ne_bytes(*number) == libc::SIGINT as u32 {
            StopSignal::Interrupt
        } else {
            StopSignal::Terminate
        })
    }
}

impl AsFd for StopSignals {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.0.as_fd()
    }
}

/// Exit code at SIGINT and SIGTERM; 0 where the program handles them itself.
static EXIT_CODE: AtomicI32 = AtomicI32::new(0);

/// Ends the process at SIGINT or SIGTERM with this exit code, until [`handle_stop`] is called or the signals are blocked by
/// [`StopSignals::block`]. A shell sees the same end for both signals then.
pub fn exit_on_stop(code: u8) {
    extern "C" fn end(_signal: libc::c_int) {
        let code = EXIT_CODE.load(Ordering::Relaxed);
        if code != 0 {
            // SAFETY: `_exit` may be called in a signal handler.
            unsafe { libc::_exit(code) }
        }
    }
    EXIT_CODE.store(code.into(), Ordering::Relaxed);
    for signal in [libc::SIGINT, libc::SIGTERM] {
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

/// Leaves SIGINT and SIGTERM to handlers of the program's own. These call the handler that was there before, which then
/// does nothing.
pub fn handle_stop() {
    EXIT_CODE.store(0, Ordering::Relaxed);
}
