//! The figures of a measurement: for each bus and number of stations a row, and how the cost grows.

use serde::Serialize;

/// A measurement as it is saved.
#[derive(Clone, PartialEq, Debug, Serialize)]
pub(super) struct ScaleFigures {
    /// Version of this format.
    pub(super) schema_version: u32,
    /// `virtual` or `real`.
    pub(super) mode: &'static str,
    /// Seconds that each row was measured.
    pub(super) seconds: u32,
    pub(super) rows: Vec<ScaleRow>,
    pub(super) growth: Vec<Growth>,
}

/// One bus with a number of stations.
#[derive(Clone, PartialEq, Debug, Serialize)]
pub(super) struct ScaleRow {
    pub(super) bus: &'static str,
    pub(super) stations: u32,
    /// Cycles measured.
    pub(super) cycles: u64,
    /// Processor time of a cycle in µs, the median of the seconds. Real: of the PLC's cyclic thread, with what the kernel does for
    /// it. Virtual: of the whole cell.
    pub(super) cost_us: f64,
    /// Cyclic frames that the PLC sent in a cycle, and received.
    pub(super) frames_sent: f64,
    pub(super) frames_received: f64,
    /// Physical memory of this process in MiB; real: the robots are other processes.
    pub(super) memory_mib: f64,
    /// Real mode only.
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    pub(super) real: Option<RealRow>,
}

/// Figures of a real run only.
#[derive(Clone, PartialEq, Debug, Serialize)]
pub(super) struct RealRow {
    /// Time until all stations were connected and ready in ms, the longest of all turns.
    pub(super) ready_ms: f64,
    /// Lateness of the PLC's cyclic thread at its deadlines in µs, before any work.
    pub(super) late_p50_us: f64,
    pub(super) late_p99_us: f64,
    pub(super) late_max_us: f64,
    /// The same of a loop that only sleeps, in the seconds between.
    pub(super) bare_p50_us: f64,
    pub(super) bare_p99_us: f64,
    pub(super) bare_max_us: f64,
    /// 99th percentile of the PLC by that of the loop.
    pub(super) late_by_bare: f64,
    /// Scans that the PLC had no time for.
    pub(super) scans_missed: u64,
    /// Allocations of the cyclic thread in the seconds measured.
    pub(super) allocations: u64,
}

/// Growth of the cost of a bus with its stations.
#[derive(Clone, PartialEq, Debug, Serialize)]
pub(super) struct Growth {
    pub(super) bus: &'static str,
    /// The largest number of stations.
    pub(super) stations: u32,
    /// Cost of each further station in µs: (cost(N) − cost(1)) / (N − 1).
    pub(super) each_us: f64,
    /// Cost of the second station in µs: cost(2) − cost(1).
    pub(super) second_us: f64,
    /// The first by the second.
    pub(super) ratio: f64,
}

impl Growth {
    /// Returns the growth on each bus that was measured with 1, 2 and more stations.
    pub(super) fn of(rows: &[ScaleRow]) -> Vec<Self> {
        let mut buses: Vec<&'static str> = rows.iter().map(|row| row.bus).collect();
        buses.dedup();
        let on_bus = |bus| {
            let cost = |stations| {
                let row = rows.iter().find(|row| row.bus == bus && row.stations == stations);
                row.map(|row| row.cost_us)
            };
            let most = rows.iter().filter(|row| row.bus == bus).map(|row| row.stations).max()?;
            let (one, two, all) = (cost(1)?, cost(2)?, cost(most)?);
            let (each_us, second_us) = ((all - one) / f64::from(most.checked_sub(1)?), two - one);
            (most > 2).then_some(Self { bus, stations: most, each_us, second_us, ratio: each_us / second_us })
        };
        buses.into_iter().filter_map(on_bus).collect()
    }
}

/// Returns the median; 0 without values.
pub(super) fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    match (values.get(middle), values.len() % 2) {
        (Some(upper), 1) => *upper,
        (Some(upper), _) => {
            values.get(middle.wrapping_sub(1)).map_or(*upper, |lower| f64::midpoint(*lower, *upper))
        }
        (None, _) => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(bus: &'static str, stations: u32, cost_us: f64) -> ScaleRow {
        let (frames_sent, frames_received) = (f64::from(stations), f64::from(stations));
        ScaleRow {
            bus,
            stations,
            cycles: 1_000,
            cost_us,
            frames_sent,
            frames_received,
            memory_mib: 1.0,
            real: None,
        }
    }

    #[test]
    fn the_growth_is_the_cost_of_each_further_station_by_that_of_the_second_one() {
        let rows = [row("a", 1, 10.0), row("a", 2, 14.0), row("a", 64, 199.0), row("b", 1, 1.0)];
        let growth = Growth { bus: "a", stations: 64, each_us: 3.0, second_us: 4.0, ratio: 0.75 };
        assert_eq!(Growth::of(&rows), [growth]);
    }

    #[test]
    fn the_median_of_an_even_number_is_between_the_two_in_the_middle() {
        assert_eq!(
            [median(&mut [3.0, 1.0, 2.0]), median(&mut [4.0, 1.0, 2.0, 3.0]), median(&mut [])],
            [2.0, 2.5, 0.0]
        );
    }
}
