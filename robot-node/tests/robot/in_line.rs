//! Two robots in an EtherCAT line, each a node of its own with its own cables, in virtual time.

use std::time::Duration;

use machine::ethernet::Mac;
use machine::{Instant, InterfaceId, LinkEvent};
use planning::{FoundCell, PlannedCell, PlannedStation};
use plc_node::bus::PlcBus;
use plc_node::{
    ArmInStep, ExecutionType, PlacedStation, PlcConfig, PlcEvent, PlcNode, PlcReport, Scan, Sequences,
};
use protocol::fieldbus::StationId;
use robot_node::bus::RobotBus;
use robot_node::{Program, RobotConfig, RobotEvent, RobotInLine, RobotNode};
use setup::Cell;
use virtual_time::{CableId, Clock, Either, Event, Impairment, Network, NodeId, Plug};

type Plc = PlcNode<PlcBus>;
type Node = Either<Plc, Either<RobotInLine, RobotNode<RobotBus>>>;

const MS: Duration = Duration::from_millis(1);

/// Time that a frame takes by half a metre of cable and two ports.
const CABLE: Duration = Duration::from_micros(2);

/// Setup F with both of its robots on EtherCAT, the left one first.
fn planned() -> (Cell, FoundCell, PlannedCell) {
    let (mut cell, found) = planning::cell_with_applications("F").unwrap();
    cell.stations[0].bus = cell.stations[1].bus.clone();
    let planned = found.plan(&cell).unwrap();
    (cell, found, planned)
}

fn plc(cell: &Cell, planned: &PlannedCell) -> Plc {
    let (first, others) = (&cell.stations[0].bus, [&cell.stations[1].bus]);
    let start = Instant::from_micros(300);
    let bus = plc_node::bus::open_all(first, &others, Mac([2, 0, 0, 0, 1, 0]), 1, start).unwrap();
    let (mut placed, mut works) = (Vec::new(), Vec::new());
    for (place, station) in (0..).zip(&planned.stations) {
        let PlannedStation { name, plan, zones, .. } = station;
        let (config, work) = PlcConfig::of_station(station).into_station(name, &plan.waits);
        placed.push(PlacedStation { bus: 0, id: StationId(place), config });
        works.push(work.in_zones(&plan.visits, zones.as_ref()));
    }
    let cycle = Duration::from_micros(cell.plc.scan_cycle_us.value.into());
    let scan = Scan::new(Instant::from_micros(100), cycle, Duration::ZERO);
    let arms = ArmInStep::all(planned).unwrap();
    PlcNode::with_program(scan, vec![bus], placed, Sequences::new(works)).in_step(arms)
}

/// Returns the robot of a station and its programs, without its bus.
fn robot(found: &FoundCell, planned: &PlannedCell, index: usize) -> (RobotConfig, Vec<(u16, Program)>) {
    let PlannedStation { setup, plan, .. } = &planned.stations[index];
    let to_start = plan.wire_to_start(setup);
    let config = RobotConfig::from_setup(setup).unwrap();
    let config = config.in_cell_of(&found.stations[index].application, &to_start).unwrap();
    (config, Program::stored(plan, setup))
}

/// The PLC, the left robot at its cable, and the right robot at the left one's second port.
struct TwoInLine {
    network: Network<Node>,
    plc: NodeId,
    left: NodeId,
    /// Between the robots.
    cable: CableId,
    /// Ends of connections, by the left robot itself.
    left_lost: usize,
}

impl TwoInLine {
    fn new() -> Self {
        let (cell, found, planned) = planned();
        let mut network = Network::new(1);
        let plc = network.add_node("the PLC", Either::A(plc(&cell, &planned)), Clock::default());
        let bus = |index: u8| {
            let start = Instant::from_micros(700 + u64::from(index));
            robot_node::bus::open(&cell.stations[0].bus, Mac([2, 0, 0, 0, 0, index]), None, 1, || start)
        };
        let start = Instant::from_micros(2_200);
        let RobotBus::Ethercat(sub_device) = bus(1) else { panic!("F's right robot is on EtherCAT") };
        let (config, programs) = robot(&found, &planned, 0);
        let left = RobotInLine::new(RobotNode::new(config, programs, sub_device, 1, start));
        let left = network.add_node("the left robot", Either::B(Either::A(left)), Clock::default());
        let (config, programs) = robot(&found, &planned, 1);
        let right = RobotNode::new(config, programs, bus(2), 2, start);
        let right = network.add_node("the right robot", Either::B(Either::B(right)), Clock::default());
        let mut nic = |node, interface| Plug::Nic(network.add_nic(node, &[interface], None, None));
        let ends = [
            [nic(plc, InterfaceId::FIRST), nic(left, InterfaceId::FIRST)],
            [nic(left, InterfaceId(1)), nic(right, InterfaceId::FIRST)],
        ];
        let link = Impairment { delay: CABLE, ..Impairment::default() };
        let [_, cable] = ends.map(|ends| network.connect(ends, [link; 2]).unwrap());
        let mut line = Self { network, plc, left, cable, left_lost: 0 };
        line.set_link(true);
        line
    }

    /// Cuts the cable between the robots or mends it; the left one's port notices.
    fn set_cut(&mut self, cut: bool) {
        self.network.set_cut(self.cable, cut);
        self.set_link(!cut);
    }

    fn set_link(&mut self, is_up: bool) {
        self.network.command(self.left, |node, _| match node {
            Either::B(Either::A(robot)) => robot.set_link(is_up),
            _ => panic!("not the left robot"),
        });
    }

    /// Runs until the PLC reports what is wanted, or to the end.
    fn until(&mut self, within: Duration, mut wanted: impl FnMut(&PlcReport) -> bool) -> bool {
        let until = self.network.now() + within;
        while let Some((_, event)) = self.network.next_event(until) {
            match event {
                Event::A(report) if wanted(&report) => return true,
                Event::B(Event::A(RobotEvent::Link(LinkEvent::Down(_)))) => self.left_lost += 1,
                _ => {}
            }
        }
        false
    }

    fn run(&mut self) -> Vec<PlcReport> {
        self.network.command(self.plc, |node, now| match node {
            Either::A(plc) => plc.start(now, ExecutionType::Rc).unwrap(),
            Either::B(_) => panic!("not the PLC"),
        });
        let mut ends = Vec::new();
        self.until(MS * 60_000, |report| {
            if matches!(report.event, PlcEvent::Finished(_) | PlcEvent::Failed(_)) {
                ends.push(*report);
            }
            ends.len() == 2 || matches!(report.event, PlcEvent::Failed(_))
        });
        ends
    }
}

#[test]
fn a_cut_between_two_robots_in_line_takes_the_second_one_only_and_both_run_once_it_is_mended() {
    let mut line = TwoInLine::new();
    let is_ready = |report: &PlcReport| report.event == PlcEvent::Ready;
    assert!(line.until(MS * 20_000, is_ready), "both robots through both ports of the left one");
    let ends = line.run();
    assert!(ends.len() == 2 && ends.iter().all(|it| matches!(it.event, PlcEvent::Finished(_))), "{ends:?}");
    line.set_cut(true);
    let is_down = |report: &PlcReport| {
        matches!(report.event, PlcEvent::Link(LinkEvent::Down(_))).then_some(report.station)
    };
    let mut lost = Vec::new();
    assert!(!line.until(MS * 5_000, |report| {
        lost.extend(is_down(report));
        false
    }));
    assert_eq!(
        (lost, line.left_lost),
        (vec![Some(1)], 0),
        "the right one is lost, and the left one stays in OP"
    );
    line.set_cut(false);
    assert!(line.until(MS * 20_000, is_ready), "the right one comes back");
    let ends = line.run();
    assert!(ends.len() == 2 && ends.iter().all(|it| matches!(it.event, PlcEvent::Finished(_))), "{ends:?}");
    assert_eq!(line.left_lost, 0);
}
