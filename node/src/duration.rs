//! Times as a person writes them.

use machine::Duration;

/// Parses the time of an option.
///
/// # Errors
///
/// The text does not give a time with its unit.
pub fn duration_argument(text: &str) -> Result<Duration, String> {
    parse_duration(text).ok_or_else(|| "must be a time such as 30s or 500ms".to_owned())
}

/// Parses a time with its unit, such as 100us, 2.5ms or 2s, up to a day.
#[must_use]
pub fn parse_duration(text: &str) -> Option<Duration> {
    let units = [("ns", 1e-9), ("us", 1e-6), ("µs", 1e-6), ("ms", 1e-3), ("s", 1.0)];
    let seconds = units
        .iter()
        .find_map(|(unit, scale)| Some(text.strip_suffix(unit)?.trim().parse::<f64>().ok()? * scale));
    // Nanoseconds are exact to weeks, which is more than a run takes.
    let seconds = seconds.filter(|seconds| (0.0..=86_400.0).contains(seconds));
    seconds.map(|seconds| Duration::from_nanos((seconds * 1e9).round() as u64))
}
