//! The PLC process of a setup with several stations: a bus on an interface for each kind of bus, and a station for each robot.

use anyhow::Context as _;
use machine::{Duration, Instant};
use node::Outcome;
use node::cell_run::PreparedCell;
use planning::PlannedStation;
use protocol::fieldbus::StationId;
use setup::{Bus, CellBus};

use super::{OnInstruction, Run, Standalone, do_without_arp};
use crate::bus::{self, PlcBus};
use crate::{ArmInStep, PlacedStation, PlcConfig, PlcNode, Scan, Sequences};
use node::list::flat;

impl Run {
    /// Runs the PLC node of several stations until it is done.
    pub(super) fn execute_cell(self) -> anyhow::Result<Outcome> {
        let prepared = self.options.prepare_cell()?;
        // A PLC has its addresses from its project.
        prepared.take_addresses()?;
        // The rehearsal of arms that move together takes its time: it comes before the first cycle.
        let arms = ArmInStep::all(&prepared.planned)?;
        let start = node::run::first_cycle();
        let buses = open_buses(&prepared, start)?;
        let node = plc(&prepared, buses, start, arms);
        let endpoint = endpoint(&prepared);
        if self.options.takes_instructions() {
            prepared.supervise(&self.options, &endpoint, node, &mut OnInstruction::default())
        } else {
            let mut standalone = Standalone::new(&flat(&self.types), self.reps, self.overrides);
            prepared.supervise(&self.options, &endpoint, node, &mut standalone)
        }
    }
}

/// Opens each bus on its interface.
fn open_buses(prepared: &PreparedCell, start: Instant) -> anyhow::Result<Vec<PlcBus>> {
    let PreparedCell { cell, buses, interfaces, .. } = prepared;
    let open = |(bus, interface): (&CellBus, &protocol_linux::Interface)| {
        let described: Vec<&Bus> = bus.descriptions(cell).collect();
        let (first, others) = described.split_first().context("a bus has a station")?;
        // The clock makes every start of this PLC a new one to the robots.
        let mut bus = bus::open_all(first, others, interface.mac(), start.as_nanos(), start)?;
        do_without_arp(&mut bus, interface);
        Ok(bus)
    };
    buses.iter().zip(interfaces).map(open).collect()
}

/// Creates the PLC with all stations, each with its motions and its marks.
fn plc(prepared: &PreparedCell, buses: Vec<PlcBus>, start: Instant, arms: Vec<ArmInStep>) -> PlcNode<PlcBus> {
    let mut works = Vec::new();
    let mut placed = Vec::new();
    for (index, planned) in prepared.planned.stations.iter().enumerate() {
        let PlannedStation { name, plan, .. } = planned;
        let (config, work) = PlcConfig::of_station(planned).into_station(name, &plan.waits);
        let (bus, id) = place(&prepared.buses, index);
        placed.push(PlacedStation { bus, id, config });
        works.push(work.in_zones(&plan.visits, planned.zones.as_ref()));
    }
    let scan_cycle = Duration::from_micros(prepared.cell.plc.scan_cycle_us.value.into());
    // On a real clock the scan takes what it takes.
    let scan = Scan::new(start, scan_cycle, Duration::ZERO);
    PlcNode::with_program(scan, buses, placed, Sequences::new(works)).in_step(arms)
}

/// Returns the index of a station's bus, and its number there.
fn place(buses: &[CellBus], station: usize) -> (usize, StationId) {
    let number = |bus: &CellBus| bus.stations.iter().position(|index| *index == station);
    let mut numbered = buses.iter().enumerate();
    let found = numbered.find_map(|(bus, on_it)| Some((bus, number(on_it)?)));
    let (bus, number) = found.unwrap_or((usize::MAX, 0));
    (bus, StationId(u16::try_from(number).unwrap_or(u16::MAX)))
}

/// Returns what the PLC is on each bus, and who is there.
fn endpoint(prepared: &PreparedCell) -> String {
    let on_bus = |bus: &CellBus| {
        let kind = bus.descriptions(&prepared.cell).next().map_or("", |bus| bus::role(&bus.kind));
        let stations = bus.stations.iter().filter_map(|index| prepared.cell.stations.get(*index));
        let names: Vec<_> = stations.map(|station| station.name.as_str()).collect();
        format!("{kind} of {}", names.join(" and "))
    };
    prepared.buses.iter().map(on_bus).collect::<Vec<_>>().join(", ")
}
