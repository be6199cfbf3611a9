//! The nodes of a virtual run in their network: the PLC and the robots, each on a cable of its own to the PLC.

use std::net::Ipv4Addr;

use machine::ethernet::Mac;
use machine::{Instant, InterfaceId};
use plc_node::bus::PlcBus;
use plc_node::{AnyProgram, PlcEvent, PlcNode, PlcReport};
use protocol::fieldbus::{Fieldbus as _, LinkEvent};
use records::conditions::MotionTotals;
use robot_node::bus::RobotBus;
use robot_node::{RobotEvent, RobotNode};
use virtual_time::{
    CableId, Clock, Either, Event, Impairment, LinkCounters, Network, NicId, NodeId, Plug, Side,
    SwitchConfig, SwitchId, Tapped,
};

pub(super) type Plc = PlcNode<PlcBus, AnyProgram>;
type Robot = RobotNode<RobotBus>;

/// A robot of the cell, by its number from 0.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct RobotId(pub(super) usize);

impl RobotId {
    /// The only robot of a setup with one station.
    pub(super) const FIRST: Self = Self(0);
}

/// A node of the cell.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum CellNode {
    Plc,
    Robot(RobotId),
}

/// An event of a node.
pub(super) enum CellEvent {
    Plc(PlcReport),
    Robot(RobotId, RobotEvent),
}

/// A node before it is in the cell.
pub(super) struct NewNode<M> {
    pub(super) machine: M,
    pub(super) clock: Clock,
    /// The IP address that it has at the start.
    pub(super) address: Option<Ipv4Addr>,
}

/// A robot, and its cable: the PLC is at side A, the robot at side B.
struct Station {
    robot: NodeId,
    cable: CableId,
}

/// The PLC and its robots, in virtual time.
pub(super) struct VirtualCell {
    network: Network<Either<Plc, Robot>>,
    plc: NodeId,
    stations: Vec<Station>,
}

/// A host's interface of the PLC: it serves these buses, by their numbers.
pub(super) struct NewInterface {
    pub(super) serves: Vec<InterfaceId>,
    /// `None` on a cable of its own, where it takes every frame.
    pub(super) mac: Option<Mac>,
    pub(super) address: Option<Ipv4Addr>,
}

/// A robot before it is in the cell, and its cable.
pub(super) struct NewStation {
    pub(super) node: NewNode<Robot>,
    pub(super) name: String,
    /// Its MAC address on the switch; `None` on a cable of its own.
    pub(super) mac: Option<Mac>,
    /// Index of the PLC's interface.
    pub(super) on: usize,
    /// Its place in the line there, from 0.
    pub(super) line_place: usize,
    /// Impairments of the PLC's frames to it, and of its frames.
    pub(super) links: [Impairment; 2],
}

/// Adds the line of the robots without a MAC address at an interface of the PLC; `None` where there are not several.
fn line(
    network: &mut Network<Either<Plc, Robot>>,
    nics: &[NicId],
    robots: &[NewStation],
    on: usize,
) -> Option<SwitchId> {
    if robots.iter().filter(|robot| robot.mac.is_none() && robot.on == on).count() < 2 {
        return None;
    }
    let line = network.add_line();
    network.connect([Plug::Nic(*nics.get(on)?), Plug::Switch(line)], [Impairment::default(); 2]);
    Some(line)
}

const NODES_STAY: &str = "a node of the cell keeps its type and its number";

impl VirtualCell {
    /// Connects the PLC and a robot by a cable. `links` is what it does to the PLC's frames, and to the robot's.
    pub(super) fn of_one(
        plc: NewNode<Plc>,
        robot: NewNode<Robot>,
        links: [Impairment; 2],
        seed: u64,
    ) -> Self {
        let mut network = Network::new(seed);
        let plc_node = network.add_node("the PLC", Either::A(plc.machine), plc.clock);
        let robot_node = network.add_node("the robot", Either::B(robot.machine), robot.clock);
        let ends = [(plc_node, plc.address), (robot_node, robot.address)]
            .map(|(node, address)| Plug::Nic(network.add_nic(node, &[InterfaceId::FIRST], None, address)));
        let cable = network.connect(ends, links);
        let stations = cable.map(|cable| Station { robot: robot_node, cable });
        network.switch_on();
        Self { network, plc: plc_node, stations: Vec::from_iter(stations) }
    }

    /// Connects the PLC and its robots: those with a MAC address by a switch, others by a cable of their own, and where an interface of
    /// the PLC has several of these, in line.
    ///
    /// `bus.cable_delay_us` of a setup is the time of a whole way, one switch included. So it is all at the robot's cable; the
    /// switch and the PLC's cable take no time of their own.
    pub(super) fn of_many(
        plc: NewNode<Plc>,
        interfaces: Vec<NewInterface>,
        robots: Vec<NewStation>,
        seed: u64,
    ) -> Self {
        let mut network = Network::new(seed);
        let switch = network.add_switch(SwitchConfig::IDEAL);
        let plc_node = network.add_node("the PLC", Either::A(plc.machine), plc.clock);
        let nics: Vec<_> = interfaces
            .into_iter()
            .map(|NewInterface { serves, mac, address }| {
                let nic = network.add_nic(plc_node, &serves, mac, address);
                if mac.is_some() {
                    network.connect([Plug::Nic(nic), Plug::Switch(switch)], [Impairment::default(); 2]);
                }
                nic
            })
            .collect();
        let lines: Vec<_> = (0..nics.len()).map(|on| line(&mut network, &nics, &robots, on)).collect();
        let mut ends = Vec::with_capacity(robots.len());
        for NewStation { node, name, mac, on, line_place, links } in robots {
            let robot = network.add_node(name, Either::B(node.machine), node.clock);
            let nic = network.add_nic(robot, &[InterfaceId::FIRST], mac, node.address);
            let line = lines.get(on).copied().flatten().filter(|_| mac.is_none());
            let plc_end = match (mac, line, nics.get(on)) {
                (None, Some(line), _) => Plug::Switch(line),
                (None, None, Some(plc)) => Plug::Nic(*plc),
                _ => Plug::Switch(switch),
            };
            let place = line.map(|_| line_place);
            ends.push((place, ends.len(), robot, ([plc_end, Plug::Nic(nic)], links)));
        }
        // The order of its cables is that of a line.
        ends.sort_by_key(|(place, ..)| *place);
        let mut stations: Vec<_> = ends
            .into_iter()
            .filter_map(|(_, index, robot, (ends, links))| {
                Some((index, Station { robot, cable: network.connect(ends, links)? }))
            })
            .collect();
        stations.sort_by_key(|(index, _)| *index);
        let stations = stations.into_iter().map(|(_, station)| station).collect();
        network.switch_on();
        Self { network, plc: plc_node, stations }
    }

    fn station(&self, RobotId(number): RobotId) -> &Station {
        let Some(station) = self.stations.get(number) else { unreachable!("{NODES_STAY}") };
        station
    }

    fn id(&self, node: CellNode) -> NodeId {
        match node {
            CellNode::Plc => self.plc,
            CellNode::Robot(robot) => self.station(robot).robot,
        }
    }

    /// Returns the cables of the stations, in order.
    pub(super) fn cables(&self) -> Vec<CableId> {
        self.stations.iter().map(|station| station.cable).collect()
    }

    /// Returns the true time.
    pub(super) const fn now(&self) -> Instant {
        self.network.now()
    }

    /// Returns what a node's clock shows now.
    pub(super) fn local_time(&self, node: CellNode) -> Instant {
        self.network.local_time(self.id(node))
    }

    pub(super) fn plc(&self) -> &Plc {
        match self.network.machine(self.plc) {
            Some(Either::A(plc)) => plc,
            _ => unreachable!("{NODES_STAY}"),
        }
    }

    pub(super) fn robot(&self, robot: RobotId) -> &Robot {
        match self.network.machine(self.station(robot).robot) {
            Some(Either::B(robot)) => robot,
            _ => unreachable!("{NODES_STAY}"),
        }
    }

    /// Gives the PLC a command; `now` is by its own clock.
    pub(super) fn command_plc<R>(&mut self, command: impl FnOnce(&mut Plc, Instant) -> R) -> R {
        let done = self.network.command(self.plc, |node, now| match node {
            Either::A(plc) => Some(command(plc, now)),
            Either::B(_) => None,
        });
        let Some(Some(done)) = done else { unreachable!("{NODES_STAY}") };
        done
    }

    /// Gives a robot a command; `now` is by its own clock.
    pub(super) fn command_robot<R>(
        &mut self,
        id: RobotId,
        command: impl FnOnce(&mut Robot, Instant) -> R,
    ) -> R {
        let done = self.network.command(self.station(id).robot, |node, now| match node {
            Either::A(_) => None,
            Either::B(robot) => Some(command(robot, now)),
        });
        let Some(Some(done)) = done else { unreachable!("{NODES_STAY}") };
        done
    }

    /// Gives a node an IP address, as its operating system would.
    pub(super) fn set_address(&mut self, node: CellNode, address: Option<Ipv4Addr>) {
        self.network.set_address(self.id(node), InterfaceId::FIRST, address);
    }

    /// Cuts a robot's cable, or mends it.
    pub(super) fn set_cut(&mut self, robot: RobotId, cut: bool) {
        self.network.set_cut(self.station(robot).cable, cut);
    }

    /// Has a robot's cable do this to the frames of both sides from now on.
    #[cfg(test)]
    pub(super) fn set_links(&mut self, robot: RobotId, link: Impairment) {
        let cable = self.station(robot).cable;
        [Side::A, Side::B].into_iter().for_each(|side| self.network.set_impairment(cable, side, link));
    }

    /// Kills a node: it neither receives nor sends any more.
    pub(super) fn kill(&mut self, node: CellNode) {
        self.network.kill(self.id(node));
    }

    /// Starts another machine in place of the PLC's, which was killed.
    pub(super) fn restart_plc(&mut self, machine: Plc) {
        self.network.restart(self.plc, Either::A(machine));
    }

    /// Starts another machine in place of a robot's, which was killed.
    pub(super) fn restart_robot(&mut self, robot: RobotId, machine: Robot) {
        self.network.restart(self.station(robot).robot, Either::B(machine));
    }

    /// Stops once a side of a robot's cable has put so many frames into it.
    pub(super) fn stop_at_frame(&mut self, robot: RobotId, side: Side, frame: Option<u64>) {
        self.network.stop_at_frame(self.station(robot).cable, side, frame);
    }

    /// Returns what a robot's cable did to the frames of a side.
    pub(super) fn link_counters(&self, robot: RobotId, side: Side) -> LinkCounters {
        self.network.link_counters(self.station(robot).cable, side)
    }

    /// Shows every frame to `tap`, once when it is sent and once when it arrives.
    pub(super) fn set_tap(&mut self, tap: impl FnMut(Tapped<'_>) + 'static) {
        self.network.set_tap(tap);
    }

    /// Returns the next event up to `until` in true time.
    pub(super) fn next_event(&mut self, until: Instant) -> Option<CellEvent> {
        let (node, event) = self.network.next_event(until)?;
        Some(match event {
            Event::A(event) => CellEvent::Plc(event),
            Event::B(event) => {
                let number = self.stations.iter().position(|station| station.robot == node);
                CellEvent::Robot(RobotId(number.unwrap_or_default()), event)
            }
        })
    }

    /// Returns the PLC's next event up to `until` in true time. Meanwhile it sets the addresses that the stations ask for,
    /// and adds the robots' reports on their skills to `moved`.
    pub(super) fn next_plc_event(&mut self, until: Instant, moved: &mut MotionTotals) -> Option<PlcEvent> {
        loop {
            match self.next_event(until)? {
                CellEvent::Robot(id, RobotEvent::Link(LinkEvent::SetAddress { address, .. })) => {
                    self.set_address(CellNode::Robot(id), Some(address));
                    self.command_robot(id, |robot, now| robot.bus_mut().address_set(now, true));
                }
                CellEvent::Plc(PlcReport { event, .. }) => {
                    // The motion to the start is not part of the run.
                    if let PlcEvent::Started { .. } = event {
                        *moved = MotionTotals::default();
                    }
                    return Some(event);
                }
                CellEvent::Robot(_, RobotEvent::SkillFinished { executed, quality, account, .. }) => {
                    moved.add(executed, quality, account);
                }
                CellEvent::Robot(..) => {}
            }
        }
    }
}
