//! Which of the reports of a wait a person sees: a node reports every ten seconds, and a wait may last for days.

/// Longest time between two lines about one wait, in s.
const LONGEST_PAUSE_S: u32 = 3600;

/// The waits of a node's stations that are printed, and when each is printed next.
#[derive(Clone, Default, Debug)]
pub struct WaitLines {
    stations: Vec<Printed>,
}

/// The last line about the wait at a station.
#[derive(Clone, Debug)]
struct Printed {
    station: Option<String>,
    /// The reason without its digits: another count in it is the same reason.
    reason: String,
    /// Length of the wait in the last line, in s.
    at_s: u32,
    /// Length of the wait in the last report, in s.
    reported_s: u32,
}

impl WaitLines {
    /// Takes the report of a wait at a station. Returns whether it is to be printed: it is the first of this wait, its reason is another one, or
    /// the wait is twice as long as in the last line, and at the latest after an hour.
    pub fn is_due(&mut self, station: Option<&str>, seconds: u32, reason: &str) -> bool {
        let reason: String = reason.chars().filter(|letter| !letter.is_ascii_digit()).collect();
        let Some(printed) = self.stations.iter_mut().find(|wait| wait.station.as_deref() == station) else {
            let station = station.map(str::to_owned);
            self.stations.push(Printed { station, reason, at_s: seconds, reported_s: seconds });
            return true;
        };
        let is_same = printed.reason == reason && seconds >= printed.reported_s;
        printed.reported_s = seconds;
        let next_s = printed.at_s.saturating_add(printed.at_s.min(LONGEST_PAUSE_S));
        if is_same && seconds < next_s {
            return false;
        }
        (printed.reason, printed.at_s) = (reason, seconds);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::WaitLines;

    fn printed(lines: &mut WaitLines, seconds: impl IntoIterator<Item = u32>, reason: &str) -> Vec<u32> {
        seconds.into_iter().filter(|seconds| lines.is_due(None, *seconds, reason)).collect()
    }

    #[test]
    fn a_long_wait_is_printed_ever_more_rarely_and_at_least_once_an_hour() {
        let day = std::iter::once(2).chain((10..=86_400).step_by(10));
        let lines = printed(&mut WaitLines::default(), day, "a PLC");
        assert_eq!(lines[..11], [2, 10, 20, 40, 80, 160, 320, 640, 1280, 2560, 5120]);
        assert!(lines[11..].windows(2).all(|pair| pair[1] - pair[0] == 3600), "{lines:?}");
        assert_eq!(lines.len(), 11 + 22);
    }

    #[test]
    fn another_reason_or_another_wait_is_printed_at_once_and_another_count_is_not() {
        let mut lines = WaitLines::default();
        assert_eq!(printed(&mut lines, (10..=300).step_by(10), "a PLC"), [10, 20, 40, 80, 160]);
        assert_eq!(printed(&mut lines, [310, 320], "an override above 0"), [310]);
        assert_eq!(printed(&mut lines, [10, 20, 30], "an override above 0"), [10, 20], "it waits anew");
        assert!(lines.is_due(None, 40, "an image with a right check: 40 were altered"));
        assert!(!lines.is_due(None, 50, "an image with a right check: 50 were altered"));
    }

    #[test]
    fn each_station_has_a_wait_of_its_own() {
        let mut lines = WaitLines::default();
        for seconds in [10, 20] {
            assert!(
                lines.is_due(Some("left"), seconds, "a PLC") && lines.is_due(Some("right"), seconds, "a PLC")
            );
        }
        assert!(!lines.is_due(Some("left"), 30, "a PLC"));
    }
}
