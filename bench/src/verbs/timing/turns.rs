//! The turns: in each, one bus and the bare loop exchange frames side by side for a second.

use std::time::{Duration, SystemTime};

use machine::Instant;
use protocol_linux::clock;
use setup::{BusKind, Setup};

use super::bare::{self, AnswerTime, Wire};
use super::cable::{Arrivals, Cable, TimedWay};
use super::comparison::{Comparison, Ends};
use super::connection::{Connection, TimedPeer};
use super::evenness::{Evenness, Window};
use super::stopwatch::RoundTrip;
use super::{INTERVAL, SETTLE, TURN};

/// A bus, and what its turns measured so far.
#[derive(Debug)]
pub(super) struct BusMeasurement<'a> {
    name: &'static str,
    pub(super) setup: &'a Setup,
    wire: Wire,
    windows: Vec<Window>,
    /// Of each turn, time on the way in µs.
    ours_us: Vec<Vec<f64>>,
    bare_us: Vec<Vec<f64>>,
    /// Of each turn, time from sending to receiving in µs, with the wait for the robot's next frame.
    reactions_us: Vec<Vec<f64>>,
}

impl<'a> BusMeasurement<'a> {
    pub(super) fn new(name: &'static str, setup: &'a Setup, wire: Wire) -> Self {
        let [ours_us, bare_us, reactions_us] = [const { Vec::new() }; 3];
        Self { name, setup, wire, windows: Vec::new(), ours_us, bare_us, reactions_us }
    }
}

/// The cables on which the turns take place.
#[derive(Debug)]
pub(super) struct Turns {
    bare: Cable,
    ours: Cable,
}

impl Turns {
    pub(super) fn new() -> anyhow::Result<Self> {
        Ok(Self { bare: Cable::set_up()?, ours: Cable::set_up()? })
    }

    /// Takes one turn; `foreign` is the cable to an adapter of somebody else and the setup for it.
    pub(super) fn take(
        &self,
        measurement: &mut BusMeasurement<'_>,
        turn: u32,
        foreign: Option<(&Cable, Setup)>,
    ) -> anyhow::Result<()> {
        let ours = Connection::open(&self.ours, &measurement.setup.bus, TimedPeer::Ours, turn)?;
        let foreign = match &foreign {
            Some((cable, setup)) => Some(Connection::open(cable, &setup.bus, TimedPeer::Foreign, turn)?),
            None => None,
        };
        let answers = match measurement.setup.bus.kind {
            BusKind::Ethercat(_) => AnswerTime::AtOnce,
            BusKind::Profinet(..) | BusKind::EthernetIp(..) => AnswerTime::InItsCycle(ours.phase()),
        };
        let bare = bare::exchange(&self.bare, measurement.wire, answers)?;
        let start = (bare.start + SETTLE).max(ours.up_at() + SETTLE);
        measurement.windows.push(window(start)?);
        let within = |trips: &[RoundTrip], time: fn(&RoundTrip) -> Option<Duration>| {
            let counted = trips.iter().filter(|trip| trip.at >= start && trip.at < start + TURN);
            counted.filter_map(time).map(|time| time.as_secs_f64() * 1e6).collect::<Vec<_>>()
        };
        let trips = ours.close()?;
        if let Some(foreign) = foreign {
            foreign.close()?;
        }
        measurement.ours_us.push(within(&trips, |trip| Some(trip.on_the_way)));
        measurement.reactions_us.push(within(&trips, |trip| trip.whole));
        measurement.bare_us.push(within(&bare.round_trips, |trip| Some(trip.on_the_way)));
        Ok(())
    }

    /// Ends the cables' logs and compares each bus with the bare loop in its turns.
    pub(super) fn compare(
        self,
        measurements: Vec<BusMeasurement<'_>>,
        foreign: Option<&Arrivals>,
    ) -> anyhow::Result<Vec<Comparison>> {
        let (bare, ours) = (self.bare.arrivals()?, self.ours.arrivals()?);
        let compare = |measurement: BusMeasurement<'_>| {
            let evenness =
                |arrivals: &Arrivals, way| Evenness::of(arrivals.of(way), &measurement.windows, INTERVAL);
            let ends = |arrivals, round_trips_us| Ends {
                to_plc: evenness(arrivals, TimedWay::ToPlc),
                to_robot: evenness(arrivals, TimedWay::ToRobot),
                round_trips_us,
            };
            let has_peer = matches!(measurement.setup.bus.kind, BusKind::EthernetIp(..));
            Comparison {
                bus: measurement.name,
                peer: foreign.filter(|_| has_peer).map(|arrivals| evenness(arrivals, TimedWay::ToPlc)),
                bare: ends(&bare, measurement.bare_us.clone()),
                ours: ends(&ours, measurement.ours_us.clone()),
                reactions_us: measurement.reactions_us.clone(),
            }
        };
        Ok(measurements.into_iter().map(compare).collect())
    }
}

/// Returns the turn that began at `start` by the clock that stamps arrivals: the time of day.
fn window(start: Instant) -> anyhow::Result<Window> {
    let ago = clock::now().since(start);
    let start = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH)?.saturating_sub(ago);
    Ok(Window { start, end: start + TURN })
}
