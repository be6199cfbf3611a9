//! Both nodes of a virtual run on their cable, for every bus.
//!
//! In one file, because events, faults and runs change the same state.

mod silence;

use std::cell::RefCell;
use std::net::Ipv4Addr;
use std::rc::Rc;
use std::time::Duration;

use super::cell::{CellNode, NewNode, RobotId, VirtualCell};
use ::node::report::LatenessReport;
use ::node::role::NodeRole;
use anyhow::{Context as _, bail};
use capture_file::CableEvent;
use machine::{Instant, Lateness};
use plc_node::{ExecutionType, PlcEvent};
use protocol::fieldbus::{Down, DownCause, Fieldbus as _, LinkEvent};
use protocol::image::Digest;
use setup::Setup;
use virtual_time::{Carrier, Impairment, Side, Tapped};

pub(super) use silence::LONGEST_RUN;
pub use silence::NeverEnded;
pub(super) use silence::SILENCE;

use super::Work;
use super::changes::Changes;
use super::new_nodes::{Restart, addresses, new_buses, new_plc, new_robot};
use super::phases::Phases;
use super::watch::{SharedFrames, Watch};
use crate::Unreported;
use crate::capture::VirtualCapture;
use crate::frame_name;
use records::conditions::{Counts, Health, Measured, MotionTotals};
use records::faults::{self, Change, Fault, FaultReport};
use records::not_ready::NotReady;
use records::schedule::Step;
use records::trace::{Frame, Recording};

/// Longest wait for the connection; one that is not up by then never will be.
pub(super) const CONNECT: Duration = Duration::from_secs(60);

/// Longest time after a failed run until the robot is ready again.
const RECOVERY: Duration = Duration::from_secs(60);

/// Capture that the tap writes to; the run adds changes of the cable and ends it.
pub(super) type SharedCapture = Rc<RefCell<Option<VirtualCapture>>>;

/// Faults, capture and frame log of a pair.
pub(super) struct Surroundings<'a> {
    pub(super) faults: &'a [Fault],
    pub(super) capture: Option<SharedCapture>,
    pub(super) frames: Option<SharedFrames>,
}

/// Writes tapped frames to the capture and to the frame log.
fn tap(capture: Option<SharedCapture>, frames: Option<SharedFrames>) -> impl FnMut(Tapped<'_>) {
    move |tapped| {
        if let Some(capture) = &capture
            && let Some(capture) = &mut *capture.borrow_mut()
        {
            capture.see(&tapped);
        }
        if let Some(frames) = &frames
            && let Some(frames) = &mut *frames.borrow_mut()
        {
            frames.push((tapped.at, frame(&tapped)));
        }
    }
}

/// Converts a tapped frame to a timeline's frame; the watch sets its time since the start edge.
fn frame(tapped: &Tapped<'_>) -> Frame {
    Frame {
        at_us: 0.0,
        end: tapped.end,
        sent: tapped.end == tapped.from,
        name: match tapped.carrier {
            Carrier::Ethernet => frame_name::of_ethernet(tapped.frame),
            Carrier::Udp { source, to } => frame_name::of_udp([source.port(), to.port()], tapped.frame),
            Carrier::Tcp { source, to, .. } => frame_name::of_tcp([source.port(), to.port()], tapped.frame),
        },
        bytes: tapped.frame.len(),
        faulty: !tapped.effect.is_clean(),
    }
}

/// Both nodes on a cable, and the changes that the faults make.
pub struct Nodes {
    pub(super) cell: VirtualCell,
    /// IP addresses that the sides had at the start.
    addresses: [Option<Ipv4Addr>; 2],
    faults: Vec<Fault>,
    changes: Changes,
    /// What makes a node once more; `None` where no fault asks for it.
    restart: Option<Restart>,
    /// The first node that a fault has killed.
    killed: Option<NodeRole>,
    capture: Option<SharedCapture>,
    frames: Option<SharedFrames>,
    /// What the robot reported of the current run, or of the last one.
    moved: MotionTotals,
}

impl Nodes {
    /// Switches both nodes on, on the two ends of a cable. They do not know each other yet.
    ///
    /// # Errors
    ///
    /// The setup gives no bus endpoint for the PLC.
    pub(super) fn switch_on(
        setup: &Setup,
        work: Work,
        seed: u64,
        Surroundings { faults, capture, frames }: Surroundings<'_>,
    ) -> anyhow::Result<Self> {
        let Work { source, program, stops, to_start, robot, code, again } = work;
        let mut phases = Phases::of_one(setup, seed);
        let bus = &setup.bus;
        let (plc_bus, robot_bus) = new_buses(bus, seed, &mut phases)?;
        let plc_start = phases.first_at(Side::A, setup.plc.scan_cycle_us.value);
        let robot_start = phases.first_at(Side::B, setup.robot.cycle_us.value);
        let robot = new_robot(robot, (program, &stops), robot_bus, seed, robot_start);
        let plc = new_plc(setup, (source, stops, to_start), code.clone(), plc_bus, plc_start)?;
        let delay = Duration::from_micros(bus.cable_delay_us.value.into());
        let addresses = addresses(bus);
        let links = faults::links(faults, Impairment { delay, ..Impairment::default() });
        let [plc_clock, robot_clock] = phases.clocks();
        let [plc_address, robot_address] = addresses;
        let plc = NewNode { machine: plc, clock: plc_clock, address: plc_address };
        let robot = NewNode { machine: robot, clock: robot_clock, address: robot_address };
        let mut cell = VirtualCell::of_one(plc, robot, links, seed);
        if capture.is_some() || frames.is_some() {
            cell.set_tap(tap(capture.clone(), frames.clone()));
        }
        Ok(Self {
            cell,
            addresses,
            faults: faults.to_vec(),
            changes: Changes::of(faults),
            restart: again.map(|planned| Restart::of(setup, *planned, code, seed)),
            killed: None,
            capture,
            frames,
            moved: MotionTotals::default(),
        })
    }

    pub(super) const fn cell(&self) -> &VirtualCell {
        &self.cell
    }

    /// Returns the PLC's next event up to `until` in true time. Meanwhile it sets the addresses that the stations ask
    /// for, and applies the changes of the faults.
    pub fn next_event(&mut self, until: Instant) -> Option<PlcEvent> {
        loop {
            for side in [Side::A, Side::B] {
                self.cell.stop_at_frame(RobotId::FIRST, side, self.changes.next_frame(side));
            }
            let due = self.changes.next().filter(|at| *at <= until);
            if let Some(event) = self.cell.next_plc_event(due.unwrap_or(until), &mut self.moved) {
                return Some(event);
            }
            let cell = &self.cell;
            let sent = |side| cell.link_counters(RobotId::FIRST, side).sent;
            let at_frame = self.changes.take_at(cell.now(), sent);
            // Without a frame the cell stops at the instant that was asked for.
            let change = at_frame.or_else(|| due.and_then(|_| self.changes.take()))?;
            self.change(change);
        }
    }

    /// Returns why there is no connection, in the words of the bus if it has any.
    fn not_connected(&self, down: Down) -> NotReady {
        let mut words = String::new();
        let explained = self.cell.plc().explain(0, &mut words);
        if explained.is_err() || words.is_empty() {
            words = down.to_string();
        }
        match down.cause {
            DownCause::Refused => NotReady::OtherRobot(words),
            _ => NotReady::NotConnected(words),
        }
    }

    fn counts(&self) -> Counts {
        let (plc, robot) = (self.cell.plc(), self.cell.robot(RobotId::FIRST));
        Counts {
            missed: [plc.lateness().missed(), robot.lateness().missed()],
            runs: [plc.lateness().runs(), robot.lateness().runs()],
            bus: [plc.counters(), robot.bus().counters()],
            images: [plc.checks().into(), robot.checks().into()],
        }
    }

    fn change(&mut self, change: Change) {
        let lost = |cell: &VirtualCell| {
            [Side::A, Side::B].map(|side| cell.link_counters(RobotId::FIRST, side).lost).iter().sum()
        };
        let before: u64 = lost(&self.cell);
        match change {
            Change::Cut | Change::Mend => {
                let is_cut = self.changes.count_cut(change == Change::Cut);
                self.cell.set_cut(RobotId::FIRST, is_cut);
            }
            Change::Kill(node) => {
                self.killed.get_or_insert(node);
                self.cell.kill(cell_node(node));
            }
            Change::Restart(node) => return self.restart(node),
            Change::Drive(axis, disturbance) => {
                return self
                    .cell
                    .command_robot(RobotId::FIRST, |robot, _| robot.disturb_drive(axis, disturbance));
            }
        }
        let lost = lost(&self.cell) - before;
        let Some(capture) = &self.capture else { return };
        if let Some(capture) = &mut *capture.borrow_mut() {
            capture.note(match change {
                Change::Cut => CableEvent::Cut { lost_under_way: lost },
                Change::Mend => CableEvent::Mended,
                Change::Kill(node) => CableEvent::Killed(faults::end_of(node)),
                Change::Restart(_) | Change::Drive(..) => return,
            });
        }
    }

    /// Starts a node again that was killed, with the address that it had at the start.
    fn restart(&mut self, node: NodeRole) {
        let Some(restart) = &self.restart else { return };
        let place = cell_node(node);
        let now = self.cell.local_time(place);
        let [plc, robot] = self.addresses;
        match node {
            NodeRole::Plc => {
                let Ok(plc_node) = (restart.plc)(now) else { return };
                self.cell.set_address(place, plc);
                self.cell.restart_plc(plc_node);
            }
            NodeRole::Robot => {
                // Nobody moves the arm while its robot is off.
                let joints = self.cell.robot(RobotId::FIRST).sample().joints;
                let robot_node = (restart.robot)(now, joints);
                self.cell.set_address(place, robot);
                self.cell.restart_robot(RobotId::FIRST, robot_node);
            }
        }
        self.killed.take_if(|killed| *killed == node);
    }

    /// Waits until the nodes are connected and the robot is ready.
    pub(super) fn connect(&mut self) -> anyhow::Result<()> {
        let until = self.cell.now() + CONNECT;
        let (mut is_moving, mut waiting, mut last_attempt) = (false, None, None);
        while let Some(event) = self.next_event(until) {
            match event {
                PlcEvent::MovingToStart => is_moving = true,
                PlcEvent::Waiting { for_what, seconds } => {
                    waiting = Some(NotReady::Waiting { seconds, for_what: for_what.to_string() });
                }
                PlcEvent::Ready => {
                    self.changes.ready(self.cell.now());
                    return Ok(());
                }
                PlcEvent::Link(LinkEvent::Down(down)) => {
                    let is_final = self.faults.is_empty() || matches!(down.cause, DownCause::Refused);
                    let why = self.not_connected(down);
                    if is_final {
                        return Err(why.into());
                    }
                    // A cable with faults may spoil an attempt; the PLC makes the next one.
                    last_attempt = Some(why);
                }
                PlcEvent::Link(LinkEvent::Up) => last_attempt = None,
                PlcEvent::Failed(failure) => return Err(failure.into()),
                _ => {}
            }
        }
        let late = if is_moving { NotReady::StillMoving(CONNECT) } else { NotReady::Late(CONNECT) };
        Err(last_attempt.or(waiting).unwrap_or(late).into())
    }

    pub(super) fn execute(
        &mut self,
        step: Step,
        recording: Option<&mut Recording>,
    ) -> anyhow::Result<Measured> {
        self.until_at_start()?;
        let start = self.cell.now() + step.pause;
        self.pause(start, step.execution_type)?;
        self.cell.command_plc(|plc, _| plc.schedule_overrides(step.overrides));
        let before = self.counts();
        self.start_run(step.execution_type)?;
        let longest = self.cell.now() + LONGEST_RUN;
        let mut watch = recording.map(|recording| Watch::new(recording, self.frames.clone()));
        while self.cell.now() < longest {
            let (scans, until) = (self.cell.plc().scans(), self.cell.now() + SILENCE);
            let event = match &mut watch {
                Some(watch) => watch.next_plc_event(self, until),
                None => self.next_event(until),
            };
            let Some(event) = event else {
                self.check_scans(scans)?;
                continue;
            };
            match event {
                PlcEvent::Finished(execution) => {
                    let Some(moved) = self.moved.of(execution.motions) else {
                        // Without the robot's report the run could not be verified.
                        let reported = self.moved.motions;
                        return Err(Unreported { executed: execution.motions, reported }.into());
                    };
                    return Ok(Measured {
                        execution,
                        quality: Some(moved.quality),
                        account: Some(moved.account),
                        interference: self.counts().since(&before),
                    });
                }
                PlcEvent::Failed(failure) => return Err(failure.into()),
                // A PLC that executes a run says so only behind its end: this one is another.
                PlcEvent::Ready => {
                    bail!("the plc-node was started again during the run and knows nothing of it")
                }
                PlcEvent::Link(_)
                | PlcEvent::ImageBad
                | PlcEvent::ImageGood
                | PlcEvent::LifeStill
                | PlcEvent::MovingToStart
                | PlcEvent::Waiting { .. }
                | PlcEvent::Passed(_)
                | PlcEvent::Started { .. } => {}
            }
        }
        Err(NeverEnded::TooLong.into())
    }

    /// Returns the time since the robot was ready first.
    pub(super) fn since_ready(&self) -> Duration {
        self.changes.since_ready(self.now()).unwrap_or_default()
    }

    /// Waits until the robot is ready again after a run that failed.
    pub(super) fn recover(&mut self) -> anyhow::Result<()> {
        let until = self.cell.now() + RECOVERY;
        while !self.cell.plc().is_ready() {
            if self.next_event(until).is_none() {
                return Err(NotReady::Late(RECOVERY).into());
            }
        }
        Ok(())
    }

    pub(super) fn start_run(&mut self, execution_type: ExecutionType) -> anyhow::Result<()> {
        self.cell.command_plc(|plc, now| plc.start(now, execution_type)).context("cannot start the run")
    }

    pub(super) fn digests(&self) -> [Digest; 2] {
        [self.cell.plc().sent(), *self.cell.robot(RobotId::FIRST).controller().accepted()]
    }

    pub(super) fn health(&self) -> Health {
        let (plc, robot): (&Lateness, &Lateness) =
            (self.cell.plc().lateness(), self.cell.robot(RobotId::FIRST).lateness());
        Health {
            plc: (&LatenessReport::from(plc)).into(),
            robot: (&LatenessReport::from(robot)).into(),
            bus: self.cell.plc().counters(),
            robot_bus: self.cell.robot(RobotId::FIRST).bus().counters(),
            images: [self.cell.plc().checks().into(), self.cell.robot(RobotId::FIRST).checks().into()],
            connected_after: None,
            allocations: None,
            repeated: Vec::new(),
            remarks: Vec::from_iter(self.remark()),
            faults: (!self.faults.is_empty()).then(|| {
                let links = [Side::A, Side::B].map(|side| self.cell.link_counters(RobotId::FIRST, side));
                FaultReport::new(&self.faults, links, self.changes.since_ready(self.now()))
            }),
        }
    }

    /// Returns what the PLC's bus finds remarkable about the connection.
    fn remark(&self) -> Option<String> {
        let mut words = String::new();
        let written = self.cell.plc().remark(0, &mut words);
        (written.is_ok() && !words.is_empty()).then_some(words)
    }

    pub(super) fn now(&self) -> Instant {
        self.cell.now()
    }

    pub(super) fn frames_sent(&self) -> [u64; 2] {
        [Side::A, Side::B].map(|side| self.cell.link_counters(RobotId::FIRST, side).sent)
    }
}

/// Returns the place of a node in the cell.
const fn cell_node(node: NodeRole) -> CellNode {
    match node {
        NodeRole::Plc => CellNode::Plc,
        NodeRole::Robot => CellNode::Robot(RobotId::FIRST),
    }
}
