//! A turn of the PLC: it connects to all stations, executes CM, and its cyclic thread is measured for a second.

use std::ops::ControlFlow;
use std::time::Duration;

use anyhow::{Context as _, bail};
use machine::{Instant, Lateness};
use planning::PROGRAM;
use plc_node::bus::PlcBus;
use plc_node::{
    ExecutionType, MotionList, PlacedStation, PlcConfig, PlcEvent, PlcNode, PlcReport, Scan, Sequences,
};
use protocol::fieldbus::StationId;
use protocol_linux::handover::Received;
use protocol_linux::{
    CyclicThread, Driver, Interface, NoticeSender, Notifier, Statistics, Task, allocation, clock,
};
use setup::Bus;
use stands::planned_station::PlannedStation;

use super::super::plant::ScalePlant;
use super::super::thread_time_ns;
use super::TURN;
use super::network::{PLC_INTERFACE, ScaleNetwork};

/// Longest time until all stations are connected and their arms are where the run starts.
const PATIENCE: Duration = Duration::from_secs(60);

/// Longest time for an answer of the cyclic thread, which answers at its next wake.
const ANSWER: Duration = Duration::from_secs(5);

/// Time from the start of the run to the first cycle that counts.
const SETTLE: Duration = Duration::from_millis(200);

/// Time between two looks for an answer.
const LOOK: Duration = Duration::from_millis(5);

type Plc = PlcNode<PlcBus>;

/// Figures of a turn.
#[derive(Debug)]
pub(super) struct Turn {
    /// Time until all stations were ready.
    pub(super) ready_in: Duration,
    pub(super) begin: Reading,
    pub(super) end: Reading,
}

impl Turn {
    pub(super) const fn cycles(&self) -> u64 {
        self.end.scans - self.begin.scans
    }

    /// Returns the processor time of a cycle.
    pub(super) fn cost_us(&self) -> f64 {
        (self.end.thread_time_ns - self.begin.thread_time_ns) as f64 / 1e3 / self.cycles().max(1) as f64
    }
}

/// Figures of the cyclic thread so far.
#[derive(Clone, Debug)]
pub(super) struct Reading {
    thread_time_ns: u64,
    scans: u64,
    pub(super) scans_missed: u64,
    pub(super) frames_sent: u64,
    pub(super) frames_received: u64,
    pub(super) allocations: u64,
    pub(super) lateness: Lateness,
}

/// Connects, runs and measures for a turn. `turn` makes the connections' numbers its own.
pub(super) fn run_turn(
    network: &ScaleNetwork,
    plant: &ScalePlant,
    stations: &[PlannedStation],
    turn: u32,
) -> anyhow::Result<Turn> {
    let started = clock::now();
    let mut thread = network.plc.run(|| start(plant, stations, turn))??;
    wait_for(&mut thread, PATIENCE, |notice| match notice {
        PlcNotice::Started => Some(Ok(())),
        PlcNotice::Failed(report) => Some(Err(report)),
        PlcNotice::Read(_) => None,
    })
    .context("the stations did not get ready")?
    .map_err(failed)?;
    let ready_in = clock::now().since(started);
    std::thread::sleep(SETTLE);
    let begin = read(&mut thread)?;
    std::thread::sleep(TURN);
    let end = read(&mut thread)?;
    thread.send(PlcOrder::End)?;
    let finished = thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
    finished.result?;
    Ok(Turn { ready_in, begin, end })
}

fn failed(PlcReport { station, event }: PlcReport) -> anyhow::Error {
    anyhow::anyhow!("station {} failed: {event:?}", station.unwrap_or_default())
}

fn read(thread: &mut CyclicThread<Plc, Execute>) -> anyhow::Result<Reading> {
    thread.send(PlcOrder::Read)?;
    wait_for(thread, ANSWER, |notice| match notice {
        PlcNotice::Read(reading) => Some(Ok(reading)),
        PlcNotice::Failed(report) => Some(Err(report)),
        PlcNotice::Started => None,
    })?
    .map_err(failed)
}

/// Waits for a notice of this kind.
fn wait_for<T>(
    thread: &mut CyclicThread<Plc, Execute>,
    limit: Duration,
    kind: impl Fn(PlcNotice) -> Option<T>,
) -> anyhow::Result<T> {
    let until = clock::now() + limit;
    loop {
        match thread.next_notice() {
            Received::Item(notice) => {
                if let Some(found) = kind(notice) {
                    return Ok(found);
                }
            }
            Received::Nothing if clock::now() >= until => bail!("the PLC did not answer within {limit:?}"),
            Received::Nothing => std::thread::sleep(LOOK),
            Received::Ended => bail!("the PLC's cyclic thread ended"),
        }
    }
}

fn start(
    plant: &ScalePlant,
    stations: &[PlannedStation],
    turn: u32,
) -> anyhow::Result<CyclicThread<Plc, Execute>> {
    let interface = Interface::open(PLC_INTERFACE)?;
    let described: Vec<&Bus> = stations.iter().map(|station| &station.setup.bus).collect();
    let (first, others) = described.split_first().context("a plant has a station")?;
    let start = clock::now();
    // Every start of this PLC is a new one to the robots.
    let seed = start.as_nanos() ^ u64::from(turn) << 32;
    let bus = plc_node::bus::open_all(first, others, interface.mac(), seed, start)?;
    let (mut placed, mut works) = (Vec::new(), Vec::new());
    for (number, station) in (0..).zip(stations) {
        let planned = station.planned.clone();
        let config = PlcConfig {
            motions: Box::new(MotionList::from(planned.motions)),
            to_start: planned.to_start,
            stops: planned.stops,
            ..PlcConfig::from_setup(&station.setup, Vec::new(), PROGRAM)
        };
        let (config, work) = config.into_station(&station.name, &station.waits);
        placed.push(PlacedStation { bus: 0, id: StationId(number), config });
        works.push(work);
    }
    // On a real clock the scan takes what it takes.
    let scan = Scan::new(start, Duration::from_micros(plant.cycle_us().into()), Duration::ZERO);
    let node = PlcNode::with_program(scan, vec![bus], placed, Sequences::new(works));
    let (waker, reader) = (Notifier::new()?, Notifier::new()?);
    let driver = Driver::new(node, interface, waker.clone())?;
    Ok(CyclicThread::start(driver, Execute { waiting: stations.len() }, waker, reader)?)
}

/// Orders to the cyclic thread.
#[derive(Clone, Copy, Debug)]
enum PlcOrder {
    Read,
    End,
}

/// Reports of the cyclic thread.
#[derive(Clone, Debug)]
#[expect(clippy::large_enum_variant, reason = "a box would be an allocation of the cyclic thread")]
enum PlcNotice {
    Started,
    Read(Reading),
    Failed(PlcReport),
}

/// Executes CM over and over.
#[derive(Debug)]
struct Execute {
    /// Stations that have not finished the run.
    waiting: usize,
}

impl Task<Plc> for Execute {
    type Command = PlcOrder;
    type Notice = PlcNotice;

    fn command(
        &mut self,
        now: Instant,
        plc: &mut Plc,
        statistics: &Statistics,
        instruction: PlcOrder,
        notices: &mut NoticeSender<PlcNotice>,
    ) -> ControlFlow<()> {
        match instruction {
            PlcOrder::Read => {
                let frames = plc.counters();
                notices.send(PlcNotice::Read(Reading {
                    thread_time_ns: thread_time_ns(),
                    scans: plc.lateness().runs(),
                    scans_missed: plc.lateness().missed(),
                    frames_sent: frames.sent,
                    frames_received: frames.received,
                    allocations: allocation::count(),
                    lateness: statistics.lateness.clone(),
                }));
                ControlFlow::Continue(())
            }
            PlcOrder::End => {
                plc.disconnect(now);
                ControlFlow::Break(())
            }
        }
    }

    fn event(
        &mut self,
        now: Instant,
        plc: &mut Plc,
        report: PlcReport,
        notices: &mut NoticeSender<PlcNotice>,
    ) -> ControlFlow<()> {
        match report.event {
            PlcEvent::Ready => {
                // It starts when all arms are where the run begins.
                let _ = plc.start(now, ExecutionType::Cm);
            }
            PlcEvent::Started { .. } => notices.send(PlcNotice::Started),
            PlcEvent::Finished(_) => {
                self.waiting -= 1;
                if self.waiting == 0 {
                    self.waiting = plc.stations().len();
                    let _ = plc.start(now, ExecutionType::Cm);
                }
            }
            PlcEvent::Failed(_) => notices.send(PlcNotice::Failed(report)),
            _ => {}
        }
        ControlFlow::Continue(())
    }
}
