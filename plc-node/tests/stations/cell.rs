//! A PLC with two scripted robots, each on a cable without a protocol.

use machine::{Duration, Instant, InterfaceId};
use planning::{MarkSignal, Stop, ToStart, WaitAt, assign_mark_signals};
use plc_node::{
    ArmInStep, ExecutionType, MotionList, PlacedStation, PlcEvent, PlcNode, PlcProgram, PlcReport, Scan,
    Sequences, StationConfig, StationWork, WaitLimits,
};
use protocol::direct::Direct;
use protocol::fieldbus::StationId;
use protocol::image::{Motion, MotionKind};
use protocol::one_station::OneStation;
use virtual_time::{CableId, Clock, Either, Event, Impairment, Network, NodeId, Plug};

use crate::robot::{CYCLE, Robot, RobotScript};

pub(crate) const MS: Duration = Duration::from_millis(1);
const WATCHDOG: Duration = Duration::from_millis(20);
pub(crate) const CABLE: Duration = Duration::from_micros(25);
pub(crate) const LEFT: usize = 0;
pub(crate) const RIGHT: usize = 1;

/// Returns motions that differ from each other and from those of the other station.
pub(crate) fn motions(station: usize, count: u16) -> Vec<Motion> {
    let motion = |index: u16| Motion {
        kind: if index.is_multiple_of(3) { MotionKind::PtpJoint } else { MotionKind::LinCartesian },
        target: [100.0 * station as f32 + f32::from(index), 1.0, 2.0, 3.0, 4.0, 5.0],
        velocity: 1_000 * station as u16 + index + 1,
        acceleration: 100,
        ..Motion::EMPTY
    };
    (0..count).map(motion).collect()
}

pub(crate) fn work(motions: Vec<Motion>, waits: Vec<WaitAt>, stops: Vec<Stop>) -> StationWork {
    let motions = Box::new(MotionList::from(motions));
    StationWork {
        program: 1,
        queue_depth: 5,
        refill: setup::Refill::Executed,
        motions,
        stops,
        waits,
        visits: Vec::new(),
        zones: None,
    }
}

pub(crate) const fn wait(mark: u32, after: usize, after_action: bool) -> WaitAt {
    WaitAt { mark, after, after_action, signal: None }
}

pub(crate) fn placed(bus: usize, id: u16, name: &str) -> PlacedStation {
    let config = StationConfig {
        name: name.into(),
        wait_limits: WaitLimits { answer_scans: 300, silent_scans: 600 },
        answer_timeout: MS * 300,
        robot_cycle: CYCLE,
        arm: None,
        to_start: ToStart::default(),
        longest_stop: MS * 100,
    };
    PlacedStation { bus, id: StationId(id), config }
}

pub(crate) fn scan() -> Scan {
    Scan::new(Instant::ZERO, MS, Duration::from_micros(150))
}

pub(crate) type Plc<P> = PlcNode<OneStation<Direct>, P>;
type Node<P> = Either<Plc<P>, Robot<Direct>>;

pub(crate) struct Cell<P: PlcProgram = Sequences> {
    network: Network<Node<P>>,
    plc: NodeId,
    robots: [NodeId; 2],
    cables: Vec<CableId>,
}

fn end(first_us: u64) -> Direct {
    Direct::new(Instant::from_micros(first_us), MS, WATCHDOG)
}

/// Returns a cell whose stations have this work.
pub(crate) fn cell(work: [StationWork; 2]) -> Cell {
    let programs = [LEFT, RIGHT].map(|station| stored(&work[station]));
    let mut cell = cell_with(Sequences::new(work.into()), [placed(0, 0, "left"), placed(1, 0, "right")]);
    for (station, programs) in programs.into_iter().enumerate() {
        cell.robot(station, |robot| (robot.programs, robot.meetings) = programs);
    }
    cell
}

/// Gives the waits of both arms the outputs by which their stored programs meet.
pub(crate) fn meeting_by_outputs(mut work: [StationWork; 2]) -> [StationWork; 2] {
    let [left, right] = &mut work;
    assert!(assign_mark_signals(&mut [&mut left.waits, &mut right.waits], 1));
    work
}

/// Returns the number of motions of each program for RC, and the marks of the first one.
fn stored(work: &StationWork) -> (Vec<u32>, Vec<(u32, MarkSignal)>) {
    let meetings: Vec<_> =
        work.waits.iter().filter_map(|wait| Some((wait.after as u32, wait.signal?))).collect();
    if meetings.is_empty() { (sections(work), meetings) } else { (vec![work.motions.total()], meetings) }
}

/// Returns the number of motions of each program between two marks.
fn sections(work: &StationWork) -> Vec<u32> {
    let ends = work.waits.iter().map(|wait| wait.after as u32).chain([work.motions.total()]);
    let mut begin = 0;
    let sections = ends.map(|end| end - std::mem::replace(&mut begin, end));
    sections.filter(|motions| *motions > 0).collect()
}

/// Returns a cell whose stations have this work, with arms in step, on cables that do this to frames; the robots' clocks drift.
pub(crate) fn cell_in_step(work: [StationWork; 2], arms: Vec<ArmInStep>, link: Impairment) -> Cell {
    let programs = [LEFT, RIGHT].map(|station| stored(&work[station]));
    let plc = plc(Sequences::new(work.into()), [placed(0, 0, "left"), placed(1, 0, "right")]);
    let clocks = CLOCKS.map(|(offset_ns, drift_ppb)| Clock { offset_ns, drift_ppb });
    let mut cell = cell_of(plc.in_step(arms), clocks, link);
    for (station, programs) in programs.into_iter().enumerate() {
        cell.robot(station, |robot| (robot.programs, robot.meetings) = programs);
    }
    cell
}

/// Offsets and drifts of the robots' clocks in such a cell.
pub(crate) const CLOCKS: [(u64, i32); 2] = [(7_000_000_000, 30_000), (123_456_789, -30_000)];

pub(crate) fn cell_with<P: PlcProgram>(program: P, stations: [PlacedStation; 2]) -> Cell<P> {
    let link = Impairment { delay: CABLE, ..Impairment::default() };
    cell_of(plc(program, stations), [Clock::default(); 2], link)
}

fn plc<P: PlcProgram>(program: P, stations: [PlacedStation; 2]) -> Plc<P> {
    let buses = vec![OneStation::new(end(300)), OneStation::new(end(400))];
    PlcNode::with_program(scan(), buses, stations.into(), program)
}

fn cell_of<P: PlcProgram>(plc: Plc<P>, clocks: [Clock; 2], link: Impairment) -> Cell<P> {
    let mut network = Network::new(1);
    let plc = network.add_node("plc", Either::A(plc), Clock::default());
    let mut cables = Vec::new();
    let robots = [LEFT, RIGHT].map(|station| {
        let clock = clocks[station];
        let first_us = clock.offset_ns / 1_000;
        let script = RobotScript::new(Instant::from_micros(first_us + 1_900 + 700 * station as u64));
        let robot = Robot { script, bus: end(first_us + 700 + 50 * station as u64) };
        let robot = network.add_node("robot", Either::B(robot), clock);
        let ours = network.add_nic(plc, &[InterfaceId(station as u8)], None, None);
        let its = network.add_nic(robot, &[InterfaceId::FIRST], None, None);
        cables.extend(network.connect([Plug::Nic(ours), Plug::Nic(its)], [link; 2]));
        robot
    });
    Cell { network, plc, robots, cables }
}

impl<P: PlcProgram> Cell<P> {
    pub(crate) fn now(&self) -> Instant {
        self.network.now()
    }

    pub(crate) fn plc<R>(&mut self, call: impl FnOnce(&mut Plc<P>, Instant) -> R) -> R {
        let call = |node: &mut Node<P>, now| match node {
            Either::A(plc) => call(plc, now),
            Either::B(_) => panic!("a robot"),
        };
        self.network.command(self.plc, call).unwrap()
    }

    pub(crate) fn robot<R>(&mut self, station: usize, call: impl FnOnce(&mut RobotScript) -> R) -> R {
        let call = |node: &mut Node<P>, _| match node {
            Either::A(_) => panic!("the PLC"),
            Either::B(robot) => call(&mut robot.script),
        };
        self.network.command(self.robots[station], call).unwrap()
    }

    pub(crate) fn set_cut(&mut self, station: usize, cut: bool) {
        self.network.set_cut(self.cables[station], cut);
    }

    /// Returns what the PLC reports within this time.
    pub(crate) fn reports(&mut self, within: Duration) -> Vec<PlcReport> {
        let until = self.now() + within;
        let mut reports = Vec::new();
        while let Some((_, event)) = self.network.next_event(until) {
            if let Event::A(report) = event {
                reports.push(report);
            }
        }
        reports
    }

    /// Runs until the PLC reports what is wanted, for at most 20 s.
    pub(crate) fn wait_for<T>(&mut self, mut wanted: impl FnMut(&PlcReport) -> Option<T>) -> T {
        let until = self.now() + MS * 20_000;
        let mut others = Vec::new();
        while let Some((_, event)) = self.network.next_event(until) {
            if let Event::A(report) = event {
                if let Some(found) = wanted(&report) {
                    return found;
                }
                others.push(report);
            }
        }
        panic!("it never came; there were {others:?}");
    }

    pub(crate) fn until_ready(&mut self) {
        if !self.plc(|plc, _| plc.is_ready()) {
            self.wait_for(|report| (report.event == PlcEvent::Ready).then_some(()));
        }
    }

    pub(crate) fn start(&mut self, execution_type: ExecutionType) {
        self.until_ready();
        [LEFT, RIGHT].into_iter().for_each(|station| self.robot(station, RobotScript::clear));
        self.plc(|plc, now| plc.start(now, execution_type)).unwrap();
    }

    /// Runs to the end and returns the motions that each station executed.
    pub(crate) fn run(&mut self, execution_type: ExecutionType) -> [u32; 2] {
        self.start(execution_type);
        let mut motions = [None; 2];
        self.wait_for(|report| {
            match (report.station, report.event) {
                (Some(station), PlcEvent::Finished(execution)) => motions[station] = Some(execution.motions),
                (_, PlcEvent::Failed(failure)) => panic!("{execution_type}: {failure}"),
                _ => {}
            }
            Some([motions[LEFT]?, motions[RIGHT]?])
        })
    }

    /// Waits for the end of a run that fails. Returns the station that the event names, and the failure.
    pub(crate) fn failure(&mut self) -> (Option<usize>, plc_node::Failure) {
        self.wait_for(|report| match report.event {
            PlcEvent::Failed(failure) => Some((report.station, failure)),
            PlcEvent::Finished(execution) => panic!("finished: {execution:?}"),
            _ => None,
        })
    }
}
