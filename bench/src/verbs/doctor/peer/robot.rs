//! A foreign robot, seen from the PLC's end: an idle PLC connects, sends images without enable, and reads the robot's.

use machine::{Duration, Instant, LinkEvent, StationConflict};
use plc_node::bus::PlcBus;
use profinet::connect::{DiffModule, ModuleState};
use protocol::fieldbus::{ControllerBus as _, Down, DownCause, StationId};
use protocol::image::{
    Command, CommandSealer, ErrorNumber, FEEDBACK_CHECK, Feedback, IMAGE_LEN, Image, State,
};

use super::images::ImageWatch;
use super::look::PeerWatch;
use super::{COMPLETE_AFTER, lost, sizes};
use crate::verbs::doctor::finding::Finding;

const CONNECTION: &str = "connection";
const MODULE: &str = "module";
const ECHO: &str = "answer";
const STATE: &str = "state";
const COMMAND: &str = "first command";

/// Largest number of scans that an echoed life counter may be old. Robots take their image over once in some cycles.
const OLDEST_ECHO: u16 = 1_000;

/// Watches a robot at the other end of a bus.
#[derive(Debug)]
pub(super) struct RobotWatch {
    station: StationId,
    command: Command,
    sealer: CommandSealer,
    images: ImageWatch<FEEDBACK_CHECK>,
    feedback: Option<Feedback>,
    /// Age of the last echoed life counter in scans, and whether the echo has moved.
    echo_age: u16,
    echo_moved: bool,
    is_up: bool,
    was_up: bool,
    /// Number of lost connections.
    lost: u32,
    down: Option<(Down, String)>,
    conflict: Option<StationConflict>,
}

impl RobotWatch {
    /// Creates a watch of this station, whose robot counts once in `robot_cycle`.
    pub(super) fn new(bus: &PlcBus, station: StationId, robot_cycle: Duration) -> Self {
        Self {
            station,
            command: Command::default(),
            sealer: CommandSealer::default(),
            images: ImageWatch::new(bus.byte_order(), robot_cycle),
            feedback: None,
            echo_age: 0,
            echo_moved: false,
            is_up: false,
            was_up: false,
            lost: 0,
            down: None,
            conflict: None,
        }
    }

    fn connection(&self, bus: &PlcBus) -> Finding {
        let mut remark = String::new();
        // A string takes every character.
        let _ = bus.remark(self.station, &mut remark);
        if let Some(conflict) = &self.conflict {
            let fix = "switch one of the two stations off, or give it another name or address";
            return Finding::missing(CONNECTION, conflict.to_string(), fix);
        }
        match (&self.down, self.was_up) {
            (None, true) if self.lost > 0 => lost(self.lost),
            (None, true) if remark.is_empty() => Finding::good(CONNECTION, "data are exchanged both ways"),
            (None, true) => Finding::limited(CONNECTION, remark, "the robot's cycle sets the pace of a run"),
            (Some((down, words)), _) => {
                let found = if words.is_empty() { down.to_string() } else { words.clone() };
                Finding::missing(CONNECTION, found, "correct what the message names, then look again")
            }
            (None, false) => {
                Finding::not_seen(CONNECTION, "the robot did not answer in time", "look at the steps above")
            }
        }
    }

    fn module(&self, bus: &PlcBus) -> Option<Finding> {
        let PlcBus::Profinet(controller) = bus else { return None };
        let diff = controller.ar(self.station).map(|ar| ar.module_diff()).unwrap_or_default();
        Some(if !diff.is_empty() {
            let found = diff.iter().map(described).collect::<Vec<_>>().join("; ");
            let fix = "plug the modules of the setup in the robot's project, or write the real ones into [bus.profinet.device]";
            Finding::missing(MODULE, found, fix)
        } else if self.was_up {
            Finding::good(MODULE, "every slot has the module that the setup expects")
        } else {
            Finding::not_seen(MODULE, "no answer to a Connect", "see the step `connection`")
        })
    }

    fn echo(&self) -> Finding {
        let Some(feedback) = &self.feedback else {
            return Finding::not_seen(ECHO, "no image with a right check", "see the steps above");
        };
        let found = format!("the robot echoes life counter {} of the PLC", feedback.life_echo);
        if !self.echo_moved {
            let fix = "let the robot's cyclic task copy command bytes 2 to 3 to feedback bytes 22 to 23 in each cycle";
            return Finding::missing(ECHO, format!("{found}, which does not move"), fix);
        }
        if self.echo_age > OLDEST_ECHO {
            let fix = "let the robot read the whole command image, in the byte order of the bus";
            return Finding::missing(ECHO, format!("{found}, {} scans late", self.echo_age), fix);
        }
        Finding::good(ECHO, format!("{found}, {} scans after it was sent", self.echo_age))
    }

    fn state(&self) -> Finding {
        let Some(Feedback { state, error, joints, status, .. }) = &self.feedback else {
            return Finding::not_seen(STATE, "no image with a right check", "see the steps above");
        };
        let joints: Vec<_> = joints.iter().map(|joint| format!("{joint:.1}")).collect();
        let found = format!("{state:?}, {status:?}, joints {}", joints.join(" "));
        if let State::Unknown(_) = state {
            return Finding::missing(
                STATE,
                found,
                "send 0 Halted, 1 Ready, 2 Running or 3 Suspended in byte 2",
            );
        }
        if *error != ErrorNumber::None {
            return Finding::limited(
                STATE,
                format!("{found}, error {}: {error}", u16::from(*error)),
                "reset it",
            );
        }
        if self.feedback.is_some_and(|feedback| feedback.joints.iter().any(|joint| !joint.is_finite())) {
            return Finding::missing(STATE, found, "send joints as REAL in the byte order of the bus");
        }
        Finding::good(STATE, found)
    }
}

fn described(module: &DiffModule) -> String {
    let slot = module.slot;
    match module.state {
        ModuleState::NoModule => return format!("slot {slot} is empty"),
        ModuleState::WrongModule => return format!("slot {slot} has another module, 0x{:08X}", module.ident),
        _ => {}
    }
    let submodules = module.submodules.iter().map(|submodule| {
        let (subslot, ident, state) = (submodule.subslot, submodule.ident, submodule.state.0);
        format!("slot {slot} subslot 0x{subslot:04X} has submodule 0x{ident:08X} (state 0x{state:04X})")
    });
    submodules.collect::<Vec<_>>().join("; ")
}

impl PeerWatch<PlcBus> for RobotWatch {
    fn link_event(&self, (station, event): (StationId, LinkEvent)) -> Option<LinkEvent> {
        (station == self.station).then_some(event)
    }

    fn note(&mut self, _now: Instant, bus: &PlcBus, event: LinkEvent) {
        match event {
            LinkEvent::Up => (self.is_up, self.was_up, self.down) = (true, true, None),
            // The end of this look.
            LinkEvent::Down(Down { cause: DownCause::ClosedHere, .. }) => self.is_up = false,
            LinkEvent::Down(down) => {
                let mut words = String::new();
                // A string takes every character.
                let _ = bus.explain(self.station, &mut words);
                self.lost += u32::from(self.was_up);
                (self.is_up, self.down) = (false, Some((down, words)));
                self.images.disconnect();
            }
            LinkEvent::Conflict(conflict) => self.conflict = Some(conflict),
            LinkEvent::SetAddress { .. }
            | LinkEvent::Store
            | LinkEvent::Foreign(_)
            | LinkEvent::Owner(_)
            | LinkEvent::Health => {}
        }
    }

    /// Sends an image without enable and without a command: it moves nothing.
    fn scan(&mut self, now: Instant, bus: &mut PlcBus) {
        let order = bus.byte_order();
        self.command.life = self.command.life.wrapping_add(1);
        let mut output: Image = [0; IMAGE_LEN];
        order.emit_command(&self.command, &mut output);
        self.sealer.take_tail(&output);
        self.sealer.seal(order, &mut output);
        bus.set_output(self.station, &output);
        let Some(image) = bus.input(self.station).filter(|_| self.is_up) else { return };
        let Ok(feedback) = order.parse_feedback(&image) else { return };
        if !self.images.take(now, &image, feedback.life, bus.counters(self.station).received) {
            return;
        }
        let before = self.feedback.replace(feedback);
        self.echo_moved |= before.is_some_and(|before| before.life_echo != feedback.life_echo);
        self.echo_age = self.command.life.wrapping_sub(feedback.life_echo);
    }

    fn is_complete(&self, now: Instant) -> bool {
        self.images.first_at().is_some_and(|first| now.since(first) >= COMPLETE_AFTER)
    }

    fn disconnect(&self, now: Instant, bus: &mut PlcBus) {
        (0..bus.stations()).for_each(|station| bus.disconnect(now, StationId(station)));
    }

    /// A PLC has its address from its project.
    fn address_set(&self, _now: Instant, _bus: &mut PlcBus, _done: bool) {}

    fn findings(&self, bus: &PlcBus) -> Vec<Finding> {
        let mut findings = vec![self.connection(bus)];
        findings.extend(self.module(bus));
        findings.push(sizes(self.was_up));
        findings.extend(self.images.findings("robot"));
        findings.extend([self.echo(), self.state()]);
        let found = "none was given: this look sends neither enable nor a command";
        findings.push(if self.was_up {
            Finding::good(COMMAND, found)
        } else {
            Finding::not_seen(COMMAND, found, "see the step `connection`")
        });
        findings
    }
}
