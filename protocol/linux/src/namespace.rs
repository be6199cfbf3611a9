//! Namespaces without a name: a network of one's own that is gone when the last process in it is, however that ends.

use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::process::Command;

use rustix::process::{Signal, getgid, getpid, getppid, getuid, set_parent_process_death_signal};
use rustix::thread::{
    CapabilitySet, LinkNameSpaceType, UnshareFlags, capabilities, move_into_link_name_space,
};

/// Why a namespace cannot be made or used.
#[derive(Debug, thiserror::Error)]
pub enum NamespaceError {
    /// The host does not let this user make namespaces.
    #[error(
        "this host does not let an ordinary user make a network of its own ({action}: {source}); \
         {}",
        advice()
    )]
    NotPermitted {
        /// What was tried.
        action: &'static str,
        /// What the kernel said.
        source: io::Error,
    },
    /// Anything else that the kernel said.
    #[error("{action}: {source}")]
    Failed {
        /// What was tried.
        action: &'static str,
        /// What the kernel said.
        source: io::Error,
    },
}

impl NamespaceError {
    pub(crate) fn new(action: &'static str, source: impl Into<io::Error>) -> Self {
        let source = source.into();
        match source.kind() {
            // Over the limit of user.max_user_namespaces the kernel says ENOSPC.
            io::ErrorKind::PermissionDenied | io::ErrorKind::StorageFull => {
                Self::NotPermitted { action, source }
            }
            _ => Self::Failed { action, source },
        }
    }
}

/// A switch of the kernel that keeps an ordinary user from making namespaces.
struct Switch {
    name: &'static str,
    shut: u64,
    open: u64,
}

const SWITCHES: [Switch; 3] = [
    Switch { name: "kernel.unprivileged_userns_clone", shut: 0, open: 1 },
    Switch { name: "user.max_user_namespaces", shut: 0, open: 10_000 },
    Switch { name: "kernel.apparmor_restrict_unprivileged_userns", shut: 1, open: 0 },
];

impl Switch {
    fn is_shut(&self) -> bool {
        let file = format!("/proc/sys/{}", self.name.replace('.', "/"));
        std::fs::read_to_string(file).is_ok_and(|value| value.trim().parse() == Ok(self.shut))
    }
}

/// What to enable on this very host, as far as it can be seen.
fn advice() -> String {
    let shut: Vec<_> = SWITCHES
        .iter()
        .filter(|switch| switch.is_shut())
        .map(|Switch { name, open, .. }| format!("`sudo sysctl -w {name}={open}`"))
        .collect();
    if shut.is_empty() {
        let all: Vec<_> = SWITCHES.iter().map(|Switch { name, open, .. }| format!("{name}={open}")).collect();
        format!(
            "look at the sysctls {}, in a container at its seccomp profile, or run as root",
            all.join(", ")
        )
    } else {
        format!("to allow it: {}; or run as root", shut.join(" and "))
    }
}

/// Makes this process root of a user namespace of its own, unless it may make network namespaces as it is.
///
/// Call it first in `main`: the kernel allows it only while the process has one thread.
pub fn enter_user_namespace() -> Result<(), NamespaceError> {
    let wanted = CapabilitySet::SYS_ADMIN | CapabilitySet::NET_ADMIN | CapabilitySet::NET_RAW;
    if capabilities(None).is_ok_and(|sets| sets.effective.contains(wanted)) {
        return Ok(());
    }
    let (uid, gid) = (getuid().as_raw(), getgid().as_raw());
    unshare(UnshareFlags::NEWUSER).map_err(|e| NamespaceError::new("making a user namespace", e))?;
    let write = |file: &str, text: &str| {
        std::fs::write(format!("/proc/self/{file}"), text)
            .map_err(|e| NamespaceError::new("becoming root of the user namespace", e))
    };
    // An ordinary user may map its own group only after giving up setgroups (user_namespaces(7)).
    write("setgroups", "deny")?;
    write("uid_map", &format!("0 {uid} 1"))?;
    write("gid_map", &format!("0 {gid} 1"))
}

/// A network of its own: no interface of the host is in it. It lives as long as this value or a process in it does.
#[derive(Debug)]
pub struct NetworkNamespace(OwnedFd);

impl NetworkNamespace {
    /// A new one, empty but for its loopback. The calling thread stays where it is.
    pub fn new() -> Result<Self, NamespaceError> {
        let make = || {
            unshare(UnshareFlags::NEWNET)
                .map_err(|e| NamespaceError::new("making a network namespace", e))?;
            // Only what the nodes send is to be on the wire, and no neighbour discovery. Without IPv6 there is none.
            let _ = std::fs::write("/proc/sys/net/ipv6/conf/default/disable_ipv6", "1");
            std::fs::File::open("/proc/thread-self/ns/net")
                .map(|file| Self(file.into()))
                .map_err(|e| NamespaceError::new("opening the new network namespace", e))
        };
        on_own_thread(make)
    }

    /// Runs `work` on a thread inside this namespace and waits for it.
    pub fn run<T: Send>(&self, work: impl FnOnce() -> T + Send) -> Result<T, NamespaceError> {
        on_own_thread(|| {
            enter(self.0.as_fd()).map_err(|e| NamespaceError::new("entering a network namespace", e))?;
            Ok(work())
        })
    }

    /// Makes `command` start inside this namespace and die, by SIGKILL, with the thread that spawns it.
    pub fn confine(&self, command: &mut Command) -> Result<(), NamespaceError> {
        let namespace =
            self.0.try_clone().map_err(|e| NamespaceError::new("holding a network namespace", e))?;
        let parent = getpid();
        let before_exec = move || {
            set_parent_process_death_signal(Some(Signal::KILL))?;
            // If the parent died before that, nobody is left to send the signal.
            if getppid() != Some(parent) {
                return Err(io::Error::from(rustix::io::Errno::SRCH));
            }
            enter(namespace.as_fd()).map_err(io::Error::from)
        };
        // SAFETY: between fork and exec the closure makes three system calls and neither allocates nor locks.
        unsafe {
            std::os::unix::process::CommandExt::pre_exec(command, before_exec);
        }
        Ok(())
    }
}

impl AsFd for NetworkNamespace {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.0.as_fd()
    }
}

fn enter(namespace: BorrowedFd<'_>) -> rustix::io::Result<()> {
    move_into_link_name_space(namespace, Some(LinkNameSpaceType::Network))
}

fn unshare(flags: UnshareFlags) -> rustix::io::Result<()> {
    // SAFETY: only NEWUSER and NEWNET are used here, and they leave the table of descriptors alone.
    unsafe { rustix::thread::unshare_unsafe(flags) }
}

/// A namespace belongs to a thread; a thread of its own leaves the caller's as it was.
fn on_own_thread<T: Send>(
    work: impl FnOnce() -> Result<T, NamespaceError> + Send,
) -> Result<T, NamespaceError> {
    std::thread::scope(|scope| {
        let thread = std::thread::Builder::new()
            .spawn_scoped(scope, work)
            .map_err(|e| NamespaceError::new("starting a thread for a namespace", e))?;
        thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    })
}
