//! Checks what real mode needs from a computer, what this one provides, and what to do about the rest.
//!
//! The computer's state is read first; functions with that state as arguments decide what follows from it.

mod addresses;
mod finding;
mod peer;

use std::time::Duration;

use anyhow::Context;
use clap::Args;
use node::interface_option::InterfaceOption;
use protocol_linux::wakeups::{self, Wakeups};

use crate::COMMIT;
use finding::{Finding, Verdict};
use peer::PeerOptions;
use records::exit::{Exit, Failure};
use records::host::{Host, ProcessorTime};
use records::listening::{self, Listening};
use report::errln;
use stands::rig;
use studies::setup_option::SetupOption;

/// Options of the look at this machine.
#[derive(Args, Debug)]
pub struct DoctorOptions {
    /// The setup whose cycles and watchdog the machine is held against.
    #[command(flatten)]
    pub setup: SetupOption,
    /// Time for which wake-ups are measured, in s.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=3_600))]
    pub seconds: u32,
    /// Ask on this interface, given by its name or its IPv4 address, whether two stations have an address of the setup; for
    /// several buses profinet=IF,ethernet-ip=IF.
    #[arg(long, value_name = "IF|ADDRESS|BUS=IF,...")]
    pub interface: Option<InterfaceOption>,
    /// Print JSON instead of a table.
    #[arg(long)]
    pub json: bool,
    /// The foreign end to look at in place of this machine.
    #[command(flatten)]
    peer: PeerOptions,
}

/// Checks this computer and prints the findings. Call it while the process has one thread.
///
/// # Errors
///
/// The setup cannot be used, or wake-ups cannot be measured. A computer on which real mode does not run is not an
/// error: its findings are printed, and the exit code reports it.
pub fn run(options: &DoctorOptions) -> Result<Exit, Failure> {
    if let (Some(role), Some(interface)) = (options.peer.role, &options.interface) {
        return peer::run(&options.peer, role, options.setup.name(), interface, options.json);
    }
    let setup = setup::setup(options.setup.name())?;
    // Before this process enters a namespace, from where it sees fewer files of others.
    let listening = listening(&listening::find_sockets());
    // Likewise: another namespace has other interfaces.
    let held = match &options.interface {
        Some(option) => {
            let names = option.for_buses(&[setup.bus.kind.name()]);
            let names = names.map_err(|error| Failure::new(Exit::Usage, error))?;
            names.into_iter().flat_map(|interface| addresses::check(interface, &setup)).collect()
        }
        None => Vec::new(),
    };
    let mut findings = networks();
    findings.extend(held);
    findings.push(listening);
    let host = Host::read(std::time::SystemTime::now(), COMMIT);
    findings.push(cores(host.cores));
    findings.push(clock_source(host.clock_source.as_deref()));
    findings.push(governor(host.governor.as_deref()));
    findings.push(ip(in_path("ip")));
    let scan = Duration::from_micros(setup.plc.scan_cycle_us.value.into());
    if !options.json {
        errln!("measuring wake-ups every {} µs for {} s …", scan.as_micros(), options.seconds);
    }
    let count = u64::from(options.seconds) * 1_000_000 / u64::from(setup.plc.scan_cycle_us.value.max(1));
    let before = ProcessorTime::now();
    let measured = wakeups::measure(scan, count).context("cannot measure wake-ups")?;
    findings.extend(stolen(before, ProcessorTime::now()));
    findings.extend(granted(&measured));
    findings.push(lateness(&measured, scan, setup.bus.watchdog()));
    finding::print(&findings, options.json, finding::ending_of_host(&findings))?;
    let runs = findings.iter().all(|finding| finding.verdict != Verdict::Missing);
    Ok(if runs { Exit::Pass } else { Exit::EnvironmentUnusable })
}

/// Checks namespaces, the cable between them, and the sockets of all buses.
fn networks() -> Vec<Finding> {
    const NAMESPACES: &str = "network namespaces";
    const SOCKETS: &str = "raw and UDP sockets";
    if let Err(error) = rig::enter_user_namespace() {
        return vec![Finding::missing(NAMESPACES, "refused", error.to_string())];
    }
    match rig::try_cable() {
        Err(error) => vec![Finding::missing(NAMESPACES, "refused", error.to_string())],
        Ok(sockets) => vec![
            Finding::good(NAMESPACES, "two of them with a virtual cable between"),
            match sockets {
                Ok(()) => Finding::good(SOCKETS, "PROFINET, EtherNet/IP and EtherCAT"),
                Err(error) => Finding::missing(SOCKETS, "refused", error.to_string()),
            },
        ],
    }
}

/// Shows which sockets of nodes and benches are open for others.
fn listening(found: &[Listening]) -> Finding {
    const WHAT: &str = "open to others";
    if found.is_empty() {
        return Finding::good(WHAT, "no port of a node or bench of yours");
    }
    let shown: Vec<_> =
        found.iter().map(|Listening { program, socket }| format!("{program}: {socket}")).collect();
    Finding::good(WHAT, shown.join("; "))
}

fn cores(cores: Option<usize>) -> Finding {
    const WHAT: &str = "processor cores";
    match cores {
        Some(cores @ 2..) => Finding::good(WHAT, cores.to_string()),
        Some(_) => {
            Finding::limited(WHAT, "one", "both nodes wait for each other; give the machine a second core")
        }
        None => Finding::limited(WHAT, "unknown", "look whether there are two at least: `nproc`"),
    }
}

/// Checks the clock source. Reading it without a system call costs some ten nanoseconds, otherwise a microsecond or
/// more.
fn clock_source(found: Option<&str>) -> Finding {
    const WHAT: &str = "clock source";
    match found {
        Some(fast @ ("tsc" | "kvm-clock" | "arch_sys_counter" | "hyperv_clocksource_tsc_page")) => {
            Finding::good(WHAT, fast)
        }
        Some(slow) => Finding::limited(
            WHAT,
            slow,
            "each look at it costs microseconds; where /sys/devices/system/clocksource/clocksource0/available_clocksource has tsc, boot with `clocksource=tsc`",
        ),
        None => Finding::limited(WHAT, "unknown", "is /sys mounted?"),
    }
}

fn governor(found: Option<&str>) -> Finding {
    const WHAT: &str = "frequency governor";
    match found {
        None => Finding::good(WHAT, "none, as on virtual machines"),
        Some("performance") => Finding::good(WHAT, "performance"),
        Some(other) => Finding::limited(
            WHAT,
            other,
            "cores that sleep for most of a cycle are slowed down; `sudo cpupower frequency-set -g performance`",
        ),
    }
}

/// Checks for `ip`. The rig does not need it: it talks to the kernel itself.
fn ip(found: bool) -> Finding {
    const WHAT: &str = "ip (iproute2)";
    if found {
        Finding::good(WHAT, "there; the bench itself does not need it")
    } else {
        Finding::good(WHAT, "not there, and not needed; only scripts/dev.sh interop wants it")
    }
}

fn in_path(program: &str) -> bool {
    let path = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&path).any(|directory| directory.join(program).is_file())
}

fn stolen(before: Option<ProcessorTime>, after: Option<ProcessorTime>) -> Option<Finding> {
    const WHAT: &str = "steal";
    let (before, after) = before.zip(after)?;
    let all = after.all.saturating_sub(before.all).max(1);
    let share = after.stolen.saturating_sub(before.stolen) as f64 / all as f64;
    let found = format!("{:.1} % of the time taken by other virtual machines", share * 100.0);
    Some(if share < 0.005 {
        Finding::good(WHAT, found)
    } else {
        Finding::limited(
            WHAT,
            found,
            "the hypervisor runs others meanwhile, and cycles come late then; use a machine of your own, or pin its cores",
        )
    })
}

fn granted(measured: &Wakeups) -> [Finding; 2] {
    let granted = measured.granted;
    let fix = granted.refused().unwrap_or_default();
    let finding = |what, is_there, name: &str| {
        if is_there { Finding::good(what, name) } else { Finding::limited(what, "refused", fix.clone()) }
    };
    [
        finding("real-time priority", granted.fifo, "SCHED_FIFO"),
        finding("locked memory", granted.memory, "mlockall"),
    ]
}

fn lateness(measured: &Wakeups, cycle: Duration, watchdog: Duration) -> Finding {
    const WHAT: &str = "wake-up lateness";
    let lateness = &measured.lateness;
    let micros = |duration: Duration| duration.as_nanos() as f64 / 1e3;
    let (p50, p99, max) = (lateness.quantile(0.5), lateness.quantile(0.99), lateness.max());
    let found = format!(
        "p50 {:.0} µs, p99 {:.0} µs, max {:.0} µs in {} cycles of {:.0} µs, {} of them missed",
        micros(p50),
        micros(p99),
        micros(max),
        lateness.runs() + lateness.missed(),
        micros(cycle),
        lateness.missed()
    );
    if max >= watchdog {
        Finding::limited(
            WHAT,
            found,
            format!(
                "it stalled for longer than the setup's watchdog of {} ms, so runs will fail: raise bus.watchdog_cycles in a setup of your own, and stop what else runs here",
                watchdog.as_millis()
            ),
        )
    } else if p99 > cycle / 4 {
        Finding::limited(
            WHAT,
            found,
            "one cycle in a hundred comes late by more than a quarter of its length: stop what else runs here, and see the lines above",
        )
    } else {
        Finding::good(WHAT, found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use machine::{Instant, Lateness, Tick};
    use protocol_linux::scheduling::Granted;

    const CYCLE: Duration = Duration::from_millis(1);
    const WATCHDOG: Duration = Duration::from_millis(20);

    fn woken(late_us: &[u64]) -> Wakeups {
        let mut lateness = Lateness::default();
        for micros in late_us {
            let late = Duration::from_micros(*micros);
            lateness.record(&Tick { due: Instant::ZERO, lateness: late, skipped: micros / 1_000 });
        }
        Wakeups { lateness, granted: Granted { fifo: true, memory: false } }
    }

    #[test]
    fn a_stall_is_compared_with_the_watchdog_and_the_p99_with_the_cycle() {
        let verdict = |late_us: &[u64]| lateness(&woken(late_us), CYCLE, WATCHDOG).verdict;
        assert_eq!(verdict(&[14; 200]), Verdict::Good);
        assert_eq!(verdict(&[[14; 197].as_slice(), &[400; 3]].concat()), Verdict::Limited);
        let stalled = lateness(&woken(&[14, 25_000]), CYCLE, WATCHDOG);
        assert_eq!(stalled.verdict, Verdict::Limited);
        insta::assert_snapshot!(stalled.fix.unwrap(), @"it stalled for longer than the setup's watchdog of 20 ms, so runs will fail: raise bus.watchdog_cycles in a setup of your own, and stop what else runs here");
    }

    #[test]
    fn steal_is_the_share_of_time_between_two_readings() {
        let look = |text: &str| ProcessorTime::parse(text);
        let before = look("cpu  100 0 100 700 0 0 0 100 0 0\ncpu0 1 2 3\n");
        assert_eq!(before, Some(ProcessorTime { stolen: 100, all: 1_000 }));
        let after = look("cpu  200 0 200 1490 0 0 0 110 0 0\n");
        assert_eq!(stolen(before, after).unwrap().found, "1.0 % of the time taken by other virtual machines");
        assert_eq!(stolen(before, before).unwrap().verdict, Verdict::Good);
        assert_eq!(look("cpu  100 0 x 700"), None);
    }

    #[test]
    fn every_finding_that_is_not_good_has_a_fix() {
        let findings = [
            cores(Some(1)),
            cores(None),
            clock_source(Some("hpet")),
            clock_source(None),
            governor(Some("powersave")),
            granted(&woken(&[1]))[1].clone(),
            stolen(Some(ProcessorTime { stolen: 0, all: 0 }), Some(ProcessorTime { stolen: 1, all: 2 }))
                .unwrap(),
        ];
        for finding in findings {
            assert!(finding.verdict != Verdict::Good && finding.fix.is_some(), "{finding:?}");
        }
    }
}
