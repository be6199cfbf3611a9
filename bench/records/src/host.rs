//! Description of the computer of a run, for `host.json`.

use std::fs;
use std::time::{SystemTime, UNIX_EPOCH};

use serde::Serialize;

/// Scheduling of the nodes' cyclic threads if the host refused nothing.
const GRANTED: &str = "SCHED_FIFO, memory locked";

/// What the figures of a real run depend on besides the program.
#[derive(Clone, PartialEq, Eq, Debug, Serialize)]
pub struct Host {
    /// Start of the run, UTC, ISO 8601.
    pub date: String,
    /// This program's version.
    pub version: &'static str,
    /// Commit that it was built from, with `-modified` if a file differed from it; null if it was built outside a
    /// repository.
    pub commit: Option<&'static str>,
    /// Whether it was built with debug assertions.
    pub debug_assertions: bool,
    /// The kernel's release.
    pub kernel: Option<String>,
    /// The processor's name.
    pub cpu: Option<String>,
    /// Cores that this process may use.
    pub cores: Option<usize>,
    /// The kernel's clock source.
    pub clock_source: Option<String>,
    /// The first core's frequency governor; null on a virtual machine.
    pub governor: Option<String>,
    /// Scheduling class of the nodes' cyclic threads; null in virtual mode.
    pub scheduling: Option<String>,
}

impl Host {
    /// Reads the description of this computer. What cannot be read is null.
    #[must_use]
    pub fn read(now: SystemTime, commit: &'static str) -> Self {
        let line = |path| fs::read_to_string(path).ok().map(|text| text.trim().to_owned());
        let cpu = fs::read_to_string("/proc/cpuinfo").ok().and_then(|text| {
            let name = text.lines().find(|line| line.starts_with("model name"))?;
            Some(name.split_once(':')?.1.trim().to_owned())
        });
        Self {
            date: date(now),
            version: env!("CARGO_PKG_VERSION"),
            commit: Some(commit).filter(|commit| !commit.is_empty()),
            debug_assertions: cfg!(debug_assertions),
            kernel: line("/proc/sys/kernel/osrelease"),
            cpu,
            cores: std::thread::available_parallelism().ok().map(usize::from),
            clock_source: line("/sys/devices/system/clocksource/clocksource0/current_clocksource"),
            governor: line("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor"),
            scheduling: None,
        }
    }

    /// Returns the description with what the nodes' cyclic threads were refused.
    #[must_use]
    pub fn with_scheduling(self, refused: &[String]) -> Self {
        let scheduling = if refused.is_empty() { GRANTED.to_owned() } else { refused.join("; ") };
        Self { scheduling: Some(scheduling), ..self }
    }

    /// Returns the description as JSON, with a newline at the end.
    pub fn to_json(&self) -> serde_json::Result<String> {
        serde_json::to_string_pretty(self).map(|json| json + "\n")
    }
}

/// Formats a time in ISO 8601, UTC, in seconds: `2026-11-21T03:17:00Z`.
#[must_use]
pub fn date(time: SystemTime) -> String {
    let seconds = time.duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
    let (year, month, day) = civil(seconds / 86_400);
    let (hour, minute, second) = (seconds / 3_600 % 24, seconds / 60 % 60, seconds % 60);
    format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}Z")
}

/// Converts days since 1970-01-01 to year, month and day in the Gregorian calendar.
const fn civil(mut day: u64) -> (u64, u64, u64) {
    let mut year = 1970;
    while day >= days_in_year(year) {
        day -= days_in_year(year);
        year += 1;
    }
    let mut month = 1;
    while day >= days_in_month(year, month) {
        day -= days_in_month(year, month);
        month += 1;
    }
    (year, month, day + 1)
}

const fn is_leap(year: u64) -> bool {
    year.is_multiple_of(4) && (!year.is_multiple_of(100) || year.is_multiple_of(400))
}

const fn days_in_year(year: u64) -> u64 {
    if is_leap(year) { 366 } else { 365 }
}

const fn days_in_month(year: u64, month: u64) -> u64 {
    match month {
        2 if is_leap(year) => 29,
        2 => 28,
        4 | 6 | 9 | 11 => 30,
        _ => 31,
    }
}

/// Processor time of all cores since the computer started, in ticks of the kernel's clock.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct ProcessorTime {
    /// Time taken by other virtual machines.
    pub stolen: u64,
    /// Total time.
    pub all: u64,
}

impl ProcessorTime {
    /// Reads the current values; `None` if the kernel does not provide them.
    pub fn now() -> Option<Self> {
        Self::parse(&fs::read_to_string("/proc/stat").ok()?)
    }

    /// Parses the first line of `/proc/stat`: user, nice, system, idle, iowait, irq, softirq, steal (proc(5)).
    pub fn parse(stat: &str) -> Option<Self> {
        let line = stat.lines().next()?.strip_prefix("cpu ")?;
        let ticks: Vec<u64> = line.split_whitespace().take(8).map_while(|field| field.parse().ok()).collect();
        Some(Self { stolen: *ticks.get(7)?, all: ticks.iter().sum() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn dates_are_those_of_the_calendar() {
        let at = |seconds| date(UNIX_EPOCH + Duration::from_secs(seconds));
        assert_eq!(at(0), "1970-01-01T00:00:00Z");
        assert_eq!(at(951_782_400), "2000-02-29T00:00:00Z");
        assert_eq!(at(1_709_251_199), "2024-02-29T23:59:59Z");
        assert_eq!(at(1_709_251_200), "2024-03-01T00:00:00Z");
    }
}
