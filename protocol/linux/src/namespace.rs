//! Unnamed network namespaces: each disappears when its last process ends, however that happens.

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
    /// The host does not let this user create namespaces.
    #[error(
        "this host does not let an ordinary user make a network of its own ({action}: {reason}); \
         {}",
        advice()
    )]
    NotPermitted {
        /// What was tried.
        action: &'static str,
        /// What the kernel said.
        reason: io::Error,
    },
    /// Any other error of the kernel.
    #[error("{action}: {reason}")]
    Failed {
        /// What was tried.
        action: &'static str,
        /// What the kernel said.
        reason: io::Error,
    },
}

impl NamespaceError {
    pub(crate) fn new(action: &'static str, reason: impl Into<io::Error>) -> Self {
        let reason = reason.into();
        match reason.kind() {
            // Over the limit user.max_user_namespaces the kernel returns ENOSPC.
            io::ErrorKind::PermissionDenied | io::ErrorKind::StorageFull => {
                Self::NotPermitted { action, reason }
            }
            _ => Self::Failed { action, reason },
        }
    }
}

/// A kernel setting that keeps an ordinary user from creating namespaces.
struct KernelSwitch {
    name: &'static str,
    shut: u64,
    open: u64,
}

const SWITCHES: [KernelSwitch; 3] = [
    KernelSwitch { name: "kernel.unprivileged_userns_clone", shut: 0, open: 1 },
    KernelSwitch { name: "user.max_user_namespaces", shut: 0, open: 10_000 },
    KernelSwitch { name: "kernel.apparmor_restrict_unprivileged_userns", shut: 1, open: 0 },
];

impl KernelSwitch {
    fn is_shut(&self) -> bool {
        let file = format!("/proc/sys/{}", self.name.replace('.', "/"));
        std::fs::read_to_string(file).is_ok_and(|value| value.trim().parse() == Ok(self.shut))
    }
}

/// Returns what to enable on this host, as far as its settings can be read.
fn advice() -> String {
    let shut: Vec<_> = SWITCHES
        .iter()
        .filter(|switch| switch.is_shut())
        .map(|KernelSwitch { name, open, .. }| format!("`sudo sysctl -w {name}={open}`"))
        .collect();
    if shut.is_empty() {
        let all: Vec<_> =
            SWITCHES.iter().map(|KernelSwitch { name, open, .. }| format!("{name}={open}")).collect();
        format!(
            "look at the sysctls {}, in a container at its seccomp profile, or run as root",
            all.join(", ")
        )
    } else {
        format!("to allow it: {}; or run as root", shut.join(" and "))
    }
}

/// Makes this process root of a new user namespace, unless it may already create network namespaces.
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

/// A network namespace without interfaces of the host. It exists until this value is dropped and its last process
/// ends.
#[derive(Debug)]
pub struct NetworkNamespace(OwnedFd);

impl NetworkNamespace {
    /// Creates one with nothing but a loopback. The calling thread stays in its own namespace.
    pub fn new() -> Result<Self, NamespaceError> {
        let make = || {
            unshare(UnshareFlags::NEWNET)
                .map_err(|e| NamespaceError::new("making a network namespace", e))?;
            // Only the nodes' frames are to be on the cable. Without IPv6 there is no neighbour discovery.
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

    /// Makes `command` start inside this namespace. The kernel kills it (SIGKILL) when the thread that spawns it
    /// ends.
    pub fn confine(&self, command: &mut Command) -> Result<(), NamespaceError> {
        let namespace =
            self.0.try_clone().map_err(|e| NamespaceError::new("holding a network namespace", e))?;
        let parent = getpid();
        let before_exec = move || {
            set_parent_process_death_signal(Some(Signal::KILL))?;
            // If the parent died before the call above, nothing would send the signal.
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

/// Runs `work` on a new thread: a namespace belongs to a thread, so the caller's stays as it is.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_refusal_names_what_to_enable() {
        for errno in [rustix::io::Errno::PERM, rustix::io::Errno::NOSPC] {
            let error = NamespaceError::new("making a user namespace", errno).to_string();
            assert!(error.contains("making a user namespace") && error.contains("sysctl"), "{error}");
            assert!(error.contains("run as root"), "{error}");
        }
    }

    #[test]
    fn other_failures_are_not_blamed_on_permissions() {
        let error = NamespaceError::new("making a veth pair", rustix::io::Errno::EXIST).to_string();
        assert!(error.starts_with("making a veth pair: File exists"), "{error}");
    }
}
