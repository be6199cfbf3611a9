//! A robot that takes as long for each motion as a test says, on a cable without a protocol.
//!
//! It keeps to the handshake that `protocol::image` describes and to nothing else, so that these tests are about
//! the PLC. Faults are switched on by fields.

use machine::wire::BigEndian;
use machine::{Cycle, Duration, Instant, Machine, PortRequest, Source, Transmit};
use planning::ToStart;
use plc_node::{ExecutionType, MotionList, PlcConfig, PlcEvent, PlcNode, PlcReport};
use protocol::direct::Direct;
use protocol::fieldbus::{Fieldbus, LinkEvent};
use protocol::image::{
    Command, Control, ErrorNumber, Feedback, FeedbackSealer, IMAGE_LEN, Motion, MotionKind, Order, Skill,
    State, Status,
};
use protocol::one_station::OneStation;
use virtual_time::{Clock, Event, Impairment, Pair, PairConfig};

/// What the robot does wrong.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Fault {
    None,
    /// Its life counter stands still from this motion on.
    LifeStandsStill {
        at: u32,
    },
    /// It ends the skill with this error at this motion of the run.
    Error {
        at: u32,
        number: ErrorNumber,
    },
    /// It gives the skill up at this motion of the run.
    Abort {
        at: u32,
    },
    /// A byte of each of its images is altered on the way, from this motion on.
    Altered {
        at: u32,
    },
    /// From this motion on so many of its images are those of two seconds before, when it was executing nothing.
    Old {
        at: u32,
        images: u32,
    },
    /// It never takes a command up.
    Deaf,
    /// It sees a reset and does not follow.
    IgnoresReset,
    /// It counts no further motion and stays in this state.
    Stands {
        at: u32,
        state: State,
    },
    /// It waits this many cycles before the next motion.
    Pauses {
        cycles: u32,
    },
}

/// The scripted robot.
#[derive(Debug)]
pub(crate) struct ScriptedRobot {
    bus: Direct,
    cycle: Cycle,
    pub(crate) motion_cycles: u32,
    pub(crate) program_motions: u32,
    pub(crate) fault: Fault,
    feedback: Feedback,
    seen: u16,
    /// A reset counts once each time it is set.
    reset_armed: bool,
    runs_program: bool,
    total: u32,
    left: u32,
    /// Motions that it took from the slots, over all skills.
    pub(crate) taken: Vec<Motion>,
    pub(crate) executed_in_all: u32,
    pub(crate) halts: u32,
    /// The PLC's digital outputs whenever they changed: motions executed in all, when, and what they became.
    pub(crate) outputs: Vec<(u32, Instant, u16)>,
    /// Where its own program ends: its joints are what a target says, of whatever kind.
    pub(crate) program_end: [f32; 6],
    /// How many motions each skill had, and when it began.
    pub(crate) skills: Vec<(u32, Instant)>,
}

impl ScriptedRobot {
    pub(crate) fn new(bus: Direct, first: Instant, period: Duration) -> Self {
        Self {
            bus,
            cycle: Cycle::new(first, period),
            motion_cycles: 25,
            program_motions: 13,
            fault: Fault::None,
            feedback: Feedback::default(),
            seen: 0,
            reset_armed: true,
            runs_program: false,
            total: 0,
            left: 0,
            taken: Vec::new(),
            executed_in_all: 0,
            halts: 0,
            outputs: Vec::new(),
            program_end: [0.0; 6],
            skills: Vec::new(),
        }
    }

    /// Restarts its program while the bus continues: it knows no command any more.
    pub(crate) fn restart(&mut self) {
        self.feedback = Feedback { life: self.feedback.life, ..Feedback::default() };
        self.seen = 0;
    }

    /// Places the arm elsewhere, as if somebody had moved it by hand.
    pub(crate) fn place_at(&mut self, joints: [f32; 6]) {
        self.feedback.joints = joints;
    }

    pub(crate) const fn report(&mut self, joints: [f32; 6], pose: [f32; 6]) {
        (self.feedback.joints, self.feedback.pose) = (joints, pose);
    }

    pub(crate) const fn is_enabled(&self) -> bool {
        self.feedback.status.contains(Status::ENABLED)
    }

    fn end(&mut self, status: Status, state: State) {
        self.feedback.status = status | Status::AT_REST | Status::ENABLED;
        self.feedback.state = state;
    }

    fn tick(&mut self, now: Instant) {
        let stuck = matches!(self.fault, Fault::LifeStandsStill { at } if self.executed_in_all >= at);
        if !stuck {
            self.feedback.life = self.feedback.life.wrapping_add(1);
        }
        self.feedback.clock_ns = now.as_nanos();
        let Some(image) = self.bus.input() else { return };
        let command = Command::parse::<BigEndian>(&image).unwrap();
        self.feedback.life_echo = command.life;
        if self.outputs.last().map_or(0, |(_, _, outputs)| *outputs) != command.outputs {
            self.outputs.push((self.executed_in_all, now, command.outputs));
        }
        if matches!(self.feedback.state, State::Running | State::Suspended) {
            self.go_on(&command);
        } else {
            self.wait(now, &command);
        }
    }

    fn wait(&mut self, now: Instant, command: &Command) {
        let control = command.control;
        self.reset_armed |= !control.contains(Control::RESET);
        self.feedback.status.set(Status::ENABLED, control.contains(Control::ENABLE));
        self.feedback.status.set(Status::AT_REST, true);
        if control.contains(Control::HALT) {
            self.halts += 1;
            self.feedback.state = State::Halted;
        } else if control.contains(Control::RESET | Control::ENABLE) && self.reset_armed {
            self.reset_armed = false;
            if self.fault != Fault::IgnoresReset {
                self.feedback.status.set(Status::ERROR, false);
                self.feedback.state = State::Ready;
            }
        }
        let new = control.contains(Control::EXECUTE) && command.number != self.seen;
        if new && self.feedback.state == State::Ready && self.fault != Fault::Deaf {
            self.take_up(command);
            self.skills.push((self.total, now));
        }
    }

    fn take_up(&mut self, command: &Command) {
        self.seen = command.number;
        self.total = match command.skill {
            Skill::RunProgram => self.program_motions,
            _ => command.total,
        };
        self.left = self.motion_cycles;
        let Feedback { life, life_echo, joints, .. } = self.feedback;
        self.runs_program = command.skill == Skill::RunProgram;
        self.feedback = Feedback {
            joints,
            status: Status::BUSY | Status::ENABLED,
            state: State::Running,
            number: command.number,
            life,
            life_echo,
            ..Feedback::default()
        };
        self.accept(command);
    }

    fn accept(&mut self, command: &Command) {
        while self.feedback.accepted < command.written {
            self.taken.push(*command.slot(self.feedback.accepted));
            self.feedback.accepted += 1;
        }
    }

    fn go_on(&mut self, command: &Command) {
        if command.control.contains(Control::HALT) {
            self.halts += 1;
            return self.end(Status::ABORTED, State::Halted);
        }
        self.accept(command);
        if let Fault::Stands { at, state } = self.fault
            && self.executed_in_all >= at
        {
            self.feedback.state = state;
            return;
        }
        if let Fault::Pauses { cycles } = &mut self.fault
            && let Some(left) = cycles.checked_sub(1)
        {
            *cycles = left;
            return;
        }
        self.feedback.execution_ns += 4_000_000;
        self.left -= 1;
        if self.left > 0 {
            return;
        }
        self.left = self.motion_cycles;
        self.feedback.executed += 1;
        self.executed_in_all += 1;
        if self.runs_program {
            self.feedback.joints = self.program_end;
        } else if let Some(motion) = self.taken.last() {
            self.feedback.joints = motion.target;
        }
        match self.fault {
            Fault::Error { at, number } if self.executed_in_all == at => {
                self.feedback.error = number;
                self.feedback.error_motion = self.feedback.executed - 1;
                self.end(Status::ERROR, State::Halted);
            }
            Fault::Abort { at } if self.executed_in_all == at => self.end(Status::ABORTED, State::Halted),
            _ if self.feedback.executed == self.total => self.end(Status::DONE, State::Ready),
            _ => {}
        }
    }
}

impl Machine for ScriptedRobot {
    type Event = LinkEvent;

    fn ports(&self) -> &[PortRequest] {
        self.bus.ports()
    }

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        self.bus.handle_frame(now, from, frame);
    }

    fn handle_timeout(&mut self, now: Instant) {
        if self.cycle.tick(now).is_some() {
            self.tick(now);
            let mut image = [0; IMAGE_LEN];
            self.feedback.emit::<BigEndian>(&mut image);
            if let Fault::Old { at, images } = &mut self.fault
                && self.executed_in_all >= *at
                && *images > 0
            {
                *images -= 1;
                let life = self.feedback.life.wrapping_sub(511);
                let (state, status) = (State::Ready, Status::AT_REST | Status::ENABLED);
                Feedback { life, state, status, ..Feedback::default() }.emit::<BigEndian>(&mut image);
            }
            if let Fault::Altered { at } = self.fault {
                FeedbackSealer::default().seal(Order::BigEndian, &mut image);
                image[45] ^= u8::from(self.executed_in_all >= at);
            }
            self.bus.set_output(&image);
        }
        if self.bus.poll_timeout().is_some_and(|due| due <= now) {
            self.bus.handle_timeout(now);
        }
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        self.bus.poll_transmit(now, buf)
    }

    fn poll_event(&mut self) -> Option<LinkEvent> {
        self.bus.poll_event()
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.bus.poll_timeout().map(|bus| bus.min(self.cycle.next()))
    }
}

/// When each cycle starts, in µs after the origin: PLC's scan, PLC's bus, robot's bus, robot.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ScriptPhases(pub(crate) [u64; 4]);

pub(crate) const SCAN: Duration = Duration::from_millis(1);
pub(crate) const BUS: Duration = Duration::from_millis(1);
pub(crate) const ROBOT: Duration = Duration::from_millis(4);
pub(crate) const COST: Duration = Duration::from_micros(150);
pub(crate) const CABLE: Duration = Duration::from_micros(25);
pub(crate) const WATCHDOG: Duration = Duration::from_millis(20);

pub(crate) type Cell = Pair<PlcNode<OneStation<Direct>>, ScriptedRobot>;

/// Returns motions that differ from each other.
pub(crate) fn motions(count: u16) -> Vec<Motion> {
    let motion = |index: u16| Motion {
        kind: if index.is_multiple_of(3) { MotionKind::PtpCartesian } else { MotionKind::LinCartesian },
        velocity: index + 1,
        acceleration: 100,
        ..Motion::EMPTY
    };
    (0..count).map(motion).collect()
}

pub(crate) fn config(motions: Vec<Motion>) -> PlcConfig {
    PlcConfig {
        scan_cycle: SCAN,
        scan_cost: COST,
        answer_timeout: Duration::from_millis(200),
        silent_timeout: Duration::from_millis(50),
        robot_cycle: ROBOT,
        queue_depth: 5,
        refill: setup::Refill::Executed,
        program: 1,
        motions: Box::new(MotionList::from(motions)),
        arm: None,
        to_start: ToStart::default(),
        stops: Vec::new(),
    }
}

pub(crate) fn cell_with(config: PlcConfig, phases: ScriptPhases) -> Cell {
    cell_with_watchdog(config, phases, WATCHDOG)
}

pub(crate) fn cell_with_watchdog(config: PlcConfig, phases: ScriptPhases, watchdog: Duration) -> Cell {
    let [scan, plc_bus, robot_bus, robot] = phases.0.map(Instant::from_micros);
    let plc = PlcNode::new(config, OneStation::new(Direct::new(plc_bus, BUS, watchdog)), scan);
    let robot = ScriptedRobot::new(Direct::new(robot_bus, BUS, watchdog), robot, ROBOT);
    let cable = Impairment { delay: CABLE, ..Impairment::default() };
    let config =
        PairConfig { seed: 1, clocks: [Clock::default(); 2], links: [cable; 2], addresses: [None; 2] };
    Pair::new(plc, robot, config)
}

pub(crate) fn cell(motion_count: u16) -> Cell {
    cell_with(config(motions(motion_count)), ScriptPhases([0, 300, 700, 1_900]))
}

/// Runs until the PLC has this event, for at most ten seconds.
pub(crate) fn wait_for<T>(cell: &mut Cell, mut wanted: impl FnMut(PlcEvent) -> Option<T>) -> T {
    let until = cell.now() + Duration::from_secs(10);
    let mut others = Vec::new();
    while let Some(event) = cell.next_event(until) {
        if let Event::A(PlcReport { event, .. }) = event {
            if let Some(found) = wanted(event) {
                return found;
            }
            others.push(event);
        }
    }
    panic!("the event never came; there were {others:?}");
}

/// Lets time pass.
pub(crate) fn pause(cell: &mut Cell, time: Duration) {
    let until = cell.now() + time;
    while cell.next_event(until).is_some() {}
}

pub(crate) fn until_ready(cell: &mut Cell) {
    wait_for(cell, |event| (event == PlcEvent::Ready).then_some(()));
}

pub(crate) fn start(cell: &mut Cell, execution_type: ExecutionType) {
    cell.command_a(|plc, now| plc.start(now, execution_type)).unwrap();
}

pub(crate) fn run(cell: &mut Cell, execution_type: ExecutionType) -> plc_node::Execution {
    start(cell, execution_type);
    wait_for(cell, |event| match event {
        PlcEvent::Finished(execution) => Some(execution),
        PlcEvent::Failed(failure) => panic!("{failure}"),
        _ => None,
    })
}

pub(crate) fn run_to_failure(cell: &mut Cell, execution_type: ExecutionType) -> plc_node::Failure {
    start(cell, execution_type);
    wait_for_failure(cell)
}

pub(crate) fn wait_for_failure(cell: &mut Cell) -> plc_node::Failure {
    wait_for(cell, |event| match event {
        PlcEvent::Failed(failure) => Some(failure),
        PlcEvent::Finished(execution) => panic!("finished: {execution:?}"),
        _ => None,
    })
}
