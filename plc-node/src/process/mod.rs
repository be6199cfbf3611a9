//! The PLC node as a process: its options, its messages, and the PLC on a real bus.
//!
//! By hand it runs a number of repetitions and prints them. With `--control` or `--json` it says what happens in one line
//! of JSON a message, and runs one repetition for each instruction that comes over TCP or on standard input.

mod cell;
mod message;
mod modes;

use std::fmt;
use std::path::PathBuf;

use machine::{Duration, Instant, InterfaceId, Lateness};
use node::Outcome;
use node::list::{List, flat};
use node::role::NodeRole;
use node::run::{Prepared, RunOptions};
use node::{Node, Waiting};
use protocol::fieldbus::{ControllerBus, Counters, LinkEvent};
use protocol::image::Checks;
use protocol::one_station::OneStation;
use protocol_linux::{Interface, OpenPort};

pub use message::{PlcInstruction, PlcMessage, PlcOrder, PlcRefusal};
use modes::{OnInstruction, Standalone};

use crate::{
    AnyProgram, ExecutionType, Override, OverrideSchedule, PlcConfig, PlcEvent, PlcNode, PlcProgram,
    PlcReport, Sample, StartError, Station, WaitingFor, bus,
};

/// Options of `plc-node run`.
#[derive(clap::Args, Debug)]
pub(crate) struct Run {
    #[command(flatten)]
    options: RunOptions,
    /// Repetitions of each execution type.
    #[arg(long, value_name = "N", default_value_t = 1, conflicts_with = "control", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    reps: u32,
    /// Execution types to run, interleaved in this order; commas or blanks between them.
    #[arg(
        long,
        value_name = "TYPE",
        num_args = 1..,
        default_value = "rc,sm,cm",
        conflicts_with = "control"
    )]
    types: Vec<List<ExecutionType>>,
    /// Override in % of every programmed speed, 0 to 100.
    ///
    /// A time after the start of each repetition says when it changes: 50, 50@2s or 80,0@2s,100@3s. At 0 the arm stops on its
    /// path.
    #[arg(long = "override", value_name = "PERCENT[@TIME],...", conflicts_with = "control")]
    overrides: Option<OverrideSchedule>,
    /// Execute exported code in the place of the PLC's function blocks: the directory that `export --for st` wrote.
    #[arg(long = "program", value_name = "DIR")]
    program: Option<PathBuf>,
}

impl Run {
    /// Runs the node until it is done.
    pub(crate) fn execute(self) -> anyhow::Result<Outcome> {
        let code = self.program.as_deref().map(crate::read_program).transpose()?;
        if self.options.has_several_stations() {
            anyhow::ensure!(
                code.is_none(),
                "--program executes the code of one robot: name a setup with one station"
            );
            return self.execute_cell();
        }
        let prepared = self.options.prepare()?;
        let (setup, plan, interface) = (&prepared.setup, &prepared.plan, prepared.interface());
        // On a real clock the scan takes what it takes.
        let config = PlcConfig { scan_cost: Duration::ZERO, ..PlcConfig::of_plan(setup, plan) };
        let start = node::run::first_cycle();
        // The clock makes every start of this PLC a new one to the robot.
        let nonce = start.as_nanos();
        if self.options.direct {
            let bus = prepared.direct(NodeRole::Plc, start)?;
            let node = PlcNode::of_code(config, code, OneStation::new(bus), start)?;
            return self.supervise(prepared, "images without a protocol", node);
        }
        // A PLC has its address from its project.
        prepared.take_address(NodeRole::Plc)?;
        let endpoint = bus::role(&setup.bus.kind);
        let mut bus = bus::open(&setup.bus, interface.mac(), nonce, start)?;
        do_without_arp(&mut bus, interface);
        self.supervise(prepared, endpoint, PlcNode::of_code(config, code, bus, start)?)
    }

    fn supervise<B: ControllerBus + Send + fmt::Debug + 'static>(
        &self,
        prepared: Prepared,
        endpoint: &str,
        node: PlcNode<B, AnyProgram>,
    ) -> anyhow::Result<Outcome> {
        if self.options.takes_instructions() {
            prepared.supervise(&self.options, NodeRole::Plc, endpoint, node, &mut OnInstruction::default())
        } else {
            let mut standalone = Standalone::new(&flat(&self.types), self.reps, self.overrides);
            prepared.supervise(&self.options, NodeRole::Plc, endpoint, node, &mut standalone)
        }
    }
}

/// Has a scanner run without the privilege that ARP needs, where it is missing.
fn do_without_arp(bus: &mut bus::PlcBus, interface: &Interface) {
    if let bus::PlcBus::EthernetIp(scanner) = bus
        && OpenPort::open(interface, machine::arp::ETHERNET).is_err()
    {
        scanner.stop_conflict_detection();
    }
}

/// Returns the index of the station because of which a run does not start; `None` if no station is the reason.
fn station_of(stations: &[Station], error: StartError) -> Option<usize> {
    match error {
        StartError::NotConnected => stations.iter().position(|station| !station.is_connected()),
        StartError::NotReady { .. } => stations.iter().position(Station::is_preparing),
        StartError::NoSync(station) => Some(station),
        StartError::Running(_) | StartError::NoMotions(_) => None,
    }
}

impl<B, P> Node for PlcNode<B, P>
where
    B: ControllerBus + Send + fmt::Debug + 'static,
    P: PlcProgram + 'static,
{
    type Order = PlcOrder;
    type Answer = PlcRefusal;
    type Sample = Sample;

    fn link_event(report: &PlcReport) -> Option<LinkEvent> {
        match report.event {
            PlcEvent::Link(event) => Some(event),
            _ => None,
        }
    }

    fn station(report: &PlcReport) -> Option<usize> {
        report.station
    }

    fn stations(&self) -> usize {
        Self::stations(self).len()
    }

    fn waiting(report: &PlcReport) -> Option<Waiting> {
        let PlcEvent::Waiting { for_what, seconds } = &report.event else { return None };
        let is_for_connection = matches!(for_what, WaitingFor::Connection { .. });
        let is_owed = for_what.is_owed();
        Some(Waiting { seconds: *seconds, for_what: for_what.to_string(), is_for_connection, is_owed })
    }

    fn order(&mut self, now: Instant, order: PlcOrder) -> Option<Self::Answer> {
        match order {
            PlcOrder::Start(execution_type, overrides) => {
                let started = self.start(now, execution_type);
                if started.is_ok() {
                    self.schedule_overrides(overrides);
                }
                started.err().map(|error| PlcRefusal::Start {
                    execution_type,
                    error,
                    station: station_of(self.stations(), error),
                })
            }
            PlcOrder::SetOverride(percent) => match Override::from_percent(percent) {
                Ok(to) => {
                    self.set_override(now, to);
                    None
                }
                Err(error) => Some(PlcRefusal::Override(error)),
            },
            PlcOrder::Abort => {
                self.abort(now);
                None
            }
        }
    }

    /// A PLC has its addresses from its project.
    fn address_set(&mut self, _now: Instant, _on: InterfaceId, _done: bool) {}

    fn explain(&self, report: &PlcReport, words: &mut dyn fmt::Write) -> fmt::Result {
        Self::explain(self, report.station.unwrap_or_default(), words)
    }

    fn remark(&self, report: &PlcReport, words: &mut dyn fmt::Write) -> fmt::Result {
        Self::remark(self, report.station.unwrap_or_default(), words)
    }

    /// A bus reports a change of its device's health only so often, so it is also asked whenever a run or a wait is reported.
    fn may_remark(report: &PlcReport) -> bool {
        match &report.event {
            PlcEvent::Waiting { for_what, .. } => !matches!(for_what, WaitingFor::Connection { .. }),
            event => matches!(
                event,
                PlcEvent::Link(LinkEvent::Up | LinkEvent::Health)
                    | PlcEvent::Ready
                    | PlcEvent::Started { .. }
                    | PlcEvent::Finished(_)
                    | PlcEvent::Failed(_)
            ),
        }
    }

    fn write_identity(&self, report: &PlcReport, words: &mut dyn fmt::Write) -> fmt::Result {
        Self::write_identity(self, report.station.unwrap_or_default(), words)
    }

    fn disconnect(&mut self, now: Instant) {
        Self::disconnect(self, now);
    }

    fn lateness(&self) -> &Lateness {
        Self::lateness(self)
    }

    fn counters(&self) -> Counters {
        Self::counters(self)
    }

    fn checks(&self) -> Checks {
        Self::checks(self)
    }

    fn cycle_number(&self) -> u64 {
        self.scans()
    }

    fn sample(&self, station: usize, now: Instant) -> (Instant, Sample) {
        (now, self.sample_of(station))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use protocol::buses::ProfinetController;

    #[test]
    fn the_bus_is_asked_for_remarks_with_each_report_of_a_connected_robot() {
        let waiting = |for_what| PlcEvent::Waiting { for_what, seconds: 2 };
        for (event, is_asked) in [
            (PlcEvent::Link(LinkEvent::Up), true),
            (PlcEvent::Link(LinkEvent::Health), true),
            (PlcEvent::Ready, true),
            (waiting(WaitingFor::Resume), true),
            // Without a connection nothing is remarkable about it, and nothing has ended either.
            (waiting(WaitingFor::Connection { last: None }), false),
            (PlcEvent::MovingToStart, false),
        ] {
            let report = PlcReport { station: Some(0), event };
            let may_remark = <PlcNode<ProfinetController, AnyProgram> as Node>::may_remark(&report);
            assert_eq!(may_remark, is_asked, "{report:?}");
        }
    }
}
