//! The PLC: buses, stations, a program, and one scan over all of them.
//!
//! ```text
//! arms           arms in step, suspended and resumed
//! as_multihomed  the PLC as a machine on an interface for each bus: time and frames
//! led            a program that leads the stations itself, as exported code does
//! links          what the buses report, and the images that they are given
//! polled         calls of the buses, and questions to those that may have something
//! run            the way to the start of a run, its scans and its end
//! ```

mod arms;
mod as_multihomed;
mod led;
mod links;
mod polled;
mod run;

use machine::{Duration, Instant, Lateness};
use protocol::bus_polls::BusPolls;
use protocol::fieldbus::{ControllerBus, Counters, StationId};
use protocol::image::{Checks, Command, Digest};

use run::Run;

use crate::event::Events;
use crate::program::{AfterLoss, PlcProgram, SetOut};
use crate::sequences::Sequences;
use crate::station::{Station, StationConfig, StationState, WayToStart, Work};
use crate::{
    ExecutionType, FailureCause, Override, OverrideSchedule, PlcConfig, PlcEvent, Sample, Scan, StartError,
};

/// A PLC: its buses, its stations and its program.
///
/// While connected it keeps each robot enabled and leads it to `Ready` by itself: it halts a skill that is not one of its own
/// (left over from a failed run, or from before a restart of the PLC), resets the robot, and moves the arm to where a run
/// starts. In a run the stations are the program's.
#[derive(Debug)]
pub struct PlcNode<B, P = Sequences> {
    buses: Vec<B>,
    /// Knowledge of each bus since it was last called.
    polled: Vec<BusPolls>,
    stations: Vec<Station>,
    /// Where each station is: the index of its bus, and its number there.
    places: Vec<(usize, StationId)>,
    /// Index of each station, by bus and number.
    on_bus: Vec<Vec<usize>>,
    program: P,
    scan: Scan,
    scans: u64,
    /// When the last scan began.
    scanned_at: Instant,
    mode: ScanMode,
    run: Run,
    /// Changes of the override in the runs that start from now on; `None` leaves it unchanged.
    overrides: Option<OverrideSchedule>,
    events: Events,
}

/// What the PLC does in a scan, besides what each station does.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum ScanMode {
    /// No run is wanted.
    Idle,
    /// A run starts once every arm is where it begins.
    Starting(ExecutionType),
    /// A run is under way.
    Running,
}

/// A station of a PLC: on which of its buses, its number there, and what is known of it.
#[derive(Debug)]
pub struct PlacedStation {
    /// Index of its bus.
    pub bus: usize,
    /// Its number on the bus.
    pub id: StationId,
    /// What the PLC knows of it.
    pub config: StationConfig,
}

impl<B: ControllerBus> PlcNode<B> {
    /// Creates a PLC with one station, on a bus with one, whose first scan is at `start`.
    #[must_use]
    pub fn new(config: PlcConfig, bus: B, start: Instant) -> Self {
        let scan = Scan::new(start, config.scan_cycle, config.scan_cost);
        let (config, work) = config.into_station("", &[]);
        Self::with_program(scan, vec![bus], vec![the_station(config)], Sequences::new(vec![work]))
    }

    /// Returns the digest of the motions that the first station took from its source in this run, or in the last one: with SM and
    /// CM those that it sent. RC takes none.
    #[must_use]
    pub fn sent(&self) -> Digest {
        self.program.digest(0).copied().unwrap_or_default()
    }
}

/// Returns the only station of a PLC, the first on its bus.
const fn the_station(config: StationConfig) -> PlacedStation {
    PlacedStation { bus: 0, id: StationId::FIRST, config }
}

impl<B: ControllerBus, P: PlcProgram> PlcNode<B, P> {
    /// Creates a PLC with these buses, stations and program. Each bus is on an interface of its own, in this order. A station
    /// whose bus does not exist is never connected.
    #[must_use]
    pub fn with_program(scan: Scan, buses: Vec<B>, placed: Vec<PlacedStation>, program: P) -> Self {
        let mut on_bus: Vec<Vec<usize>> = buses.iter().map(|_| Vec::new()).collect();
        let mut places = Vec::with_capacity(placed.len());
        let mut stations = Vec::with_capacity(placed.len());
        for (index, PlacedStation { bus, id, config }) in placed.into_iter().enumerate() {
            if let Some(numbers) = on_bus.get_mut(bus) {
                let number = usize::from(id.0);
                numbers.resize(numbers.len().max(number + 1), usize::MAX);
                if let Some(place) = numbers.get_mut(number) {
                    *place = index;
                }
            }
            let order = buses.get(bus).map_or(protocol::image::Order::LittleEndian, |bus| bus.byte_order());
            places.push((bus, id));
            stations.push(Station::new(index, config, order, scan.period()));
        }
        let (count, period) = (stations.len(), scan.period());
        debug_assert!(period > Duration::ZERO, "a scan has a cycle");
        Self {
            polled: vec![BusPolls::called(); buses.len()],
            buses,
            places,
            on_bus,
            program,
            scan,
            scans: 0,
            scanned_at: Instant::ZERO,
            mode: ScanMode::Idle,
            run: Run::none(count),
            overrides: None,
            events: Events::for_stations(count),
            stations,
        }
    }

    /// Has the next scan set the start edge of a run, or move the arms to where the run starts if they are not there; the start
    /// edge then follows.
    ///
    /// # Errors
    /// A robot is not connected or not ready, a run is under way, or there is nothing to run.
    pub fn start(&mut self, _now: Instant, execution_type: ExecutionType) -> Result<(), StartError> {
        match self.mode {
            ScanMode::Running => return Err(StartError::Running(self.run.execution_type)),
            ScanMode::Starting(other) => return Err(StartError::Running(other)),
            ScanMode::Idle => {}
        }
        if self.stations.iter().any(|station| !station.is_connected()) {
            return Err(StartError::NotConnected);
        }
        if let Some(station) = self.stations.iter().find(|station| station.state == StationState::Preparing) {
            return Err(station.not_ready());
        }
        self.program.check(execution_type, &self.stations)?;
        self.mode = ScanMode::Starting(execution_type);
        Ok(())
    }

    /// Sets the override of every robot from the next scan on, whether a run is under way or not. It stays until it is set again,
    /// or until the next step of a run's schedule.
    pub fn set_override(&mut self, _now: Instant, to: Override) {
        self.stations.iter_mut().for_each(|station| station.group_mut().set_override(to));
    }

    /// Has every run that starts from now on change the override by this schedule; without one the override stays.
    pub fn schedule_overrides(&mut self, schedule: Option<OverrideSchedule>) {
        self.overrides = schedule;
    }

    /// Gives the run up: it fails at once, and the next scan halts the robots. Does nothing without a run.
    pub fn abort(&mut self, _now: Instant) {
        self.fail(None, FailureCause::Aborted);
    }

    /// Gives a run up and ends the connections.
    pub fn disconnect(&mut self, now: Instant) {
        self.write_overdue(now);
        self.fail(None, FailureCause::Aborted);
        for place in 0..self.places.len() {
            let Some((bus, id)) = self.places.get(place).copied() else { continue };
            if let Some(bus) = self.call(bus) {
                bus.disconnect(now, id);
            }
        }
        (0..self.buses.len()).for_each(|bus| self.drain_bus(bus));
        (0..self.stations.len()).for_each(|station| self.disarm(station));
    }

    /// Returns whether a run may start.
    #[must_use]
    pub fn is_ready(&self) -> bool {
        self.mode == ScanMode::Idle && self.stations.iter().all(Station::is_ready)
    }

    /// Returns whether the connections of all stations are up.
    #[must_use]
    pub fn is_connected(&self) -> bool {
        self.stations.iter().all(Station::is_connected)
    }

    /// Returns the lateness of the scans.
    #[must_use]
    pub const fn lateness(&self) -> &Lateness {
        self.scan.lateness()
    }

    /// Returns the numbers of images by the results of their checks, and of outdated ones, of all stations together.
    #[must_use]
    pub fn checks(&self) -> Checks {
        let all = self.stations.iter().map(Station::checks);
        all.fold(Checks::default(), |sum, one| Checks {
            altered: sum.altered + one.altered,
            unchecked: sum.unchecked + one.unchecked,
            outdated: sum.outdated + one.outdated,
        })
    }

    /// Returns the frame counters of all stations together.
    #[must_use]
    pub fn counters(&self) -> Counters {
        (0..self.stations.len()).fold(Counters::default(), |sum, station| sum + self.counters_of(station))
    }

    /// Returns the frame counters of a station.
    #[must_use]
    pub fn counters_of(&self, station: usize) -> Counters {
        self.bus_of(station).map_or_else(Counters::default, |(bus, id)| bus.counters(id))
    }

    /// Writes why a station refused the last connection, in the words of its bus.
    ///
    /// # Errors
    /// That of the writer.
    pub fn explain(&self, station: usize, words: &mut dyn std::fmt::Write) -> std::fmt::Result {
        self.bus_of(station).map_or(Ok(()), |(bus, id)| bus.explain(id, words))
    }

    /// Writes what is remarkable about the connection to a station.
    ///
    /// # Errors
    /// That of the writer.
    pub fn remark(&self, station: usize, words: &mut dyn std::fmt::Write) -> std::fmt::Result {
        self.bus_of(station).map_or(Ok(()), |(bus, id)| bus.remark(id, words))
    }

    /// Writes what the device of a station says of itself.
    ///
    /// # Errors
    /// That of the writer.
    pub fn write_identity(&self, station: usize, words: &mut dyn std::fmt::Write) -> std::fmt::Result {
        self.bus_of(station).map_or(Ok(()), |(bus, id)| bus.write_identity(id, words))
    }

    /// Returns the buses, in the order of the interfaces.
    #[must_use]
    pub fn buses(&self) -> &[B] {
        &self.buses
    }

    /// Returns the buses, for commands of their own; poll the PLC afterwards.
    pub fn buses_mut(&mut self) -> &mut [B] {
        self.polled.fill(BusPolls::called());
        &mut self.buses
    }

    /// Returns the stations.
    #[must_use]
    pub fn stations(&self) -> &[Station] {
        &self.stations
    }

    /// Returns the program.
    #[must_use]
    pub const fn program(&self) -> &P {
        &self.program
    }

    /// Returns the program, to give it other work between two runs.
    pub const fn program_mut(&mut self) -> &mut P {
        &mut self.program
    }

    /// Returns the command to the first station's robot as of the last scan.
    #[must_use]
    pub fn command(&self) -> Command {
        self.stations.first().map_or_else(Command::default, |station| *station.group().command())
    }

    /// Returns how many scans have run.
    #[must_use]
    pub const fn scans(&self) -> u64 {
        self.scans
    }

    /// Returns when the last scan began, by the PLC's clock.
    #[must_use]
    pub const fn scanned_at(&self) -> Instant {
        self.scanned_at
    }

    /// Returns what the PLC commanded the first station in its last scan.
    #[must_use]
    pub fn sample(&self) -> Sample {
        self.sample_of(0)
    }

    /// Returns what the PLC commanded a station in its last scan.
    #[must_use]
    pub fn sample_of(&self, index: usize) -> Sample {
        let station = self.stations.get(index);
        let scan = self.scans;
        let [marks_come, marks_passed] = self.program.marks(index);
        let sample = station.map_or(Sample { scan, ..Sample::default() }, |station| station.sample(scan));
        Sample { marks_come, marks_passed, ..sample }
    }

    fn bus_of(&self, station: usize) -> Option<(&B, StationId)> {
        let (bus, id) = self.places.get(station)?;
        Some((self.buses.get(*bus)?, *id))
    }

    /// Runs one scan: inputs, program, outputs.
    fn scan(&mut self, now: Instant) {
        self.scans += 1;
        self.scanned_at = now;
        self.read_inputs(now);
        match self.mode {
            ScanMode::Starting(execution_type) => self.start_when_ready(now, execution_type),
            ScanMode::Running => self.run(now),
            ScanMode::Idle => {}
        }
        let leads = self.program.leads();
        if !leads {
            self.go_on_to_start(now);
        }
        self.watch_silence();
        // A run that has just failed is followed by the halt in the same scan.
        if leads {
            self.lead(now)
        } else {
            self.prepare()
        }
        self.stations.iter_mut().for_each(Station::emit);
    }

    /// Moves on each arm that moves to where a run starts. None sets out before all robots are connected and are the arms of the setup.
    fn go_on_to_start(&mut self, now: Instant) {
        for index in 0..self.stations.len() {
            let Some(station) = self.stations.get(index) else { return };
            if self.mode == ScanMode::Running || station.state != StationState::MovingToStart {
                continue;
            }
            let set_out = if !station.is_to_set_out() {
                SetOut::Now
            } else if self.is_connected() && self.stations.iter().all(Station::is_arm_of_setup) {
                self.program.set_out(index, &self.stations)
            } else {
                // The missing or other robot is reported by its own station.
                SetOut::Wait
            };
            let Some(station) = self.stations.get_mut(index) else { return };
            if station.keep(set_out) {
                continue;
            }
            match station.go_on_to_start(now, &mut self.events) {
                WayToStart::UnderWay => {}
                WayToStart::Reached => {
                    station.state = StationState::Ready;
                    self.report_ready();
                }
                WayToStart::Failed(cause) => self.fail(Some(index), cause),
            }
        }
    }

    fn watch_silence(&mut self) {
        for index in 0..self.stations.len() {
            let work = match self.mode {
                ScanMode::Running if self.run.is_lost(index) => Work::None,
                ScanMode::Running => Work::Run { waits: self.program.waits(index) },
                ScanMode::Idle | ScanMode::Starting(_) => Work::None,
            };
            let received = self.received_of(index);
            let Some(station) = self.stations.get_mut(index) else { return };
            if let Some(cause) = station.watch_silence(work, received, &mut self.events) {
                self.fail(Some(index), cause);
            }
        }
    }

    /// Does the work of a scan at each station that no run has.
    fn prepare(&mut self) {
        for index in 0..self.stations.len() {
            let is_run = self.mode == ScanMode::Running;
            let is_lost = is_run && self.run.is_lost(index);
            let Some(station) = self.stations.get_mut(index) else { return };
            if is_run && !is_lost || station.state == StationState::MovingToStart {
                continue;
            }
            let was_ready = station.is_ready();
            // An arm that the run has lost stands where it is while others move.
            let is_new = station.prepare(!is_lost);
            if is_new {
                self.report_ready();
            } else if let (true, false, ScanMode::Starting(_)) =
                (was_ready, self.stations.get(index).is_some_and(Station::is_ready), self.mode)
            {
                self.fail(Some(index), FailureCause::RobotHalted);
            }
        }
    }

    /// Reports that a run may start, if it may.
    fn report_ready(&mut self) {
        if self.is_ready() {
            self.events.push_for_all(PlcEvent::Ready);
        }
    }

    /// Fails a run, if there is one, because of a station or of all, and has the next scans lead the robots to `Ready` again.
    fn fail(&mut self, station: Option<usize>, cause: FailureCause) {
        match self.mode {
            // It belongs to the run no more, and gets ready for the next one.
            ScanMode::Running if station.is_some_and(|index| self.run.is_lost(index)) => {}
            ScanMode::Running => {
                let after = station.map_or(AfterLoss::EndRun, |station| self.program.lose(station, cause));
                match (after, station) {
                    (AfterLoss::GoOn, Some(index)) => self.run.lose(index, cause),
                    _ => return self.end_run(station, cause),
                }
                if let Some(lost) = station.and_then(|index| self.stations.get_mut(index)) {
                    lost.prepare_again(false);
                }
            }
            ScanMode::Starting(execution_type) => {
                self.mode = ScanMode::Idle;
                for index in station.map_or(0..self.stations.len(), |index| index..index + 1) {
                    let Some(station) = self.stations.get_mut(index) else { continue };
                    station.prepare_again(station.state == StationState::MovingToStart);
                }
                self.report_failure(station, execution_type, 0, cause);
            }
            ScanMode::Idle => {
                // Nobody waits for it: the next run tries again and says what is wrong.
                let Some(station) = station.and_then(|index| self.stations.get_mut(index)) else { return };
                if station.state == StationState::MovingToStart {
                    station.prepare_again(true);
                }
            }
        }
    }
}
