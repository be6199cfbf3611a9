//! A foreign PLC, seen from the robot's end: a robot without an arm answers it, and holds its first command suspended.

use machine::ethernet::{EthernetHeader, Mac};
use machine::{Duration, Instant, LinkEvent, StationConflict};
use profinet::dcp::{Content, Pdu, Service};
use protocol::fieldbus::{Down, DownCause, Fieldbus};
use protocol::image::{
    COMMAND_CHECK, Command, Control, Feedback, FeedbackSealer, IMAGE_LEN, Image, Skill, State, Status,
};
use robot_node::bus::RobotBus;

use super::images::ImageWatch;
use super::look::PeerWatch;
use super::{COMPLETE_AFTER, lost, sizes};
use crate::verbs::doctor::finding::Finding;

const NAME: &str = "name";
const ADDRESS: &str = "address";
const CONNECTION: &str = "connection";
const COMMAND: &str = "first command";

/// Largest number of names that are kept: those of a large plant's start, and no flood.
const MOST_NAMES: usize = 16;

/// Watches a PLC at the other end of a bus.
#[derive(Debug)]
pub(super) struct PlcWatch {
    /// The name of station that a PLC has to ask for; `None` on a bus without names.
    own_name: Option<String>,
    /// Names that were asked for by DCP, and by whom.
    names: Vec<(Mac, Vec<u8>)>,
    /// The address that the PLC set.
    address: Option<std::net::Ipv4Addr>,
    feedback: Feedback,
    sealer: FeedbackSealer,
    images: ImageWatch<COMMAND_CHECK>,
    command: Option<Command>,
    first_command: Option<Command>,
    is_up: bool,
    was_up: bool,
    /// Number of lost connections.
    lost: u32,
    down: Option<(Down, String)>,
    conflict: Option<StationConflict>,
}

impl PlcWatch {
    /// Creates a watch of a PLC that counts once in `scan_cycle`. `own_name` is the robot's name of station.
    pub(super) fn new(bus: &RobotBus, own_name: Option<String>, scan_cycle: Duration) -> Self {
        let mut status = Status::default();
        status.set(Status::AT_REST, true);
        Self {
            own_name,
            names: Vec::new(),
            address: None,
            feedback: Feedback { status, ..Feedback::default() },
            sealer: FeedbackSealer::default(),
            images: ImageWatch::new(bus.byte_order(), scan_cycle),
            command: None,
            first_command: None,
            is_up: false,
            was_up: false,
            lost: 0,
            down: None,
            conflict: None,
        }
    }

    /// Answers a command as a robot would that has no arm: it gets ready, and holds the first skill suspended. A refusal would end
    /// the PLC's program before it was watched for long enough.
    fn answer(&mut self, command: &Command) {
        let feedback = &mut self.feedback;
        feedback.life_echo = command.life;
        feedback.override_percent = command.override_percent.min(100);
        let has = |bits| command.control.contains(bits);
        feedback.status.set(Status::ENABLED, has(Control::ENABLE));
        if !has(Control::ENABLE) || has(Control::HALT) {
            feedback.state = State::Halted;
        } else if has(Control::CANCEL) || has(Control::RESET) && feedback.state == State::Halted {
            feedback.state = State::Ready;
        } else if has(Control::EXECUTE) && command.number != feedback.number && feedback.state == State::Ready
        {
            (feedback.number, feedback.state) = (command.number, State::Suspended);
            self.first_command.get_or_insert(*command);
        }
        let is_held = feedback.state == State::Suspended;
        feedback.status.set(Status::BUSY, is_held);
        feedback.status.set(Status::ABORTED, !is_held && self.first_command.is_some());
    }

    fn name(&self) -> Option<Finding> {
        let own = self.own_name.as_deref()?;
        let asked = |name: &[u8]| name.escape_ascii().to_string();
        let ours = self.names.iter().find(|(_, name)| name == own.as_bytes());
        Some(match (ours, self.names.as_slice()) {
            (Some((mac, _)), _) => Finding::good(NAME, format!("{mac} asks for `{own}`")),
            (None, [_, ..]) => {
                let others: Vec<_> = self
                    .names
                    .iter()
                    .map(|(mac, name)| format!("{mac} asks for `{}`", asked(name)))
                    .collect();
                let fix =
                    "give the device this name in the PLC's project, or set bus.profinet.robot_station_name";
                Finding::missing(NAME, format!("{}; nobody asks for `{own}`", others.join(", ")), fix)
            }
            (None, []) if self.was_up => Finding::good(NAME, format!("the PLC connected to `{own}`")),
            (None, []) => {
                let fix = "download the project to the PLC and set it to RUN; look whether a switch drops multicasts";
                Finding::not_seen(NAME, format!("nobody asks by DCP for `{own}`"), fix)
            }
        })
    }

    fn address(&self) -> Option<Finding> {
        self.own_name.as_ref()?;
        Some(match self.address {
            Some(address) => Finding::good(ADDRESS, format!("the PLC set {address}")),
            None if self.was_up => Finding::good(ADDRESS, "the PLC kept the address of this interface"),
            None => Finding::not_seen(ADDRESS, "the PLC set none", "see the step `name`"),
        })
    }

    fn connection(&self, bus: &RobotBus) -> Finding {
        let mut asked = String::new();
        // A string takes every character.
        let _ = bus.write_request(&mut asked);
        if let Some(conflict) = &self.conflict {
            let fix = "switch one of the two stations off, or give it another name or address";
            return Finding::missing(CONNECTION, conflict.to_string(), fix);
        }
        match (self.was_up, asked.is_empty(), &self.down) {
            (true, _, None) if self.lost > 0 => lost(self.lost),
            (true, false, Some((down, _))) if self.first_command.is_some() => {
                let fix = "the PLC may end after its first command; otherwise look at its program";
                Finding::limited(CONNECTION, format!("{asked}; then: {down}"), fix)
            }
            (true, _, None) => Finding::good(CONNECTION, asked),
            (_, false, down) => {
                let down = down.as_ref().map(
                    |(down, words)| {
                        if words.is_empty() { down.to_string() } else { words.clone() }
                    },
                );
                let found = down.map_or(asked.clone(), |down| format!("{asked}; then: {down}"));
                let fix =
                    "correct the device in the PLC's project: its description file, modules, sizes and cycle";
                Finding::missing(CONNECTION, found, fix)
            }
            _ => {
                let fix = "download the project to the PLC, set it to RUN, and compare its address of the robot with the setup";
                Finding::not_seen(CONNECTION, "no PLC asked for a connection", fix)
            }
        }
    }

    fn command(&self) -> Finding {
        if let Some(command) = &self.first_command {
            let Command { number, skill, total, written, override_percent, .. } = command;
            let what = match skill {
                Skill::RunProgram => format!("program {}", command.program),
                _ => format!("{written} of {total} motions written"),
            };
            let found = format!(
                "number {number}, {skill:?}, {what}, override {override_percent} %; held here, so nothing moves"
            );
            return if matches!(skill, Skill::Unknown(_) | Skill::None) {
                Finding::missing(COMMAND, found, "write a skill of docs/process-image.md into byte 6")
            } else {
                Finding::good(COMMAND, found)
            };
        }
        let Some(command) = self.command else {
            return Finding::not_seen(COMMAND, "no command image", "see the steps above");
        };
        let found = format!("none; control {:?}, number {}", command.control, command.number);
        let fix = if !command.control.contains(Control::ENABLE) {
            "start the PLC's program: it has to set ENABLE and RESET, and waits for the state Ready"
        } else if self.feedback.state == State::Ready {
            "start a skill in the PLC: a new command number together with EXECUTE"
        } else {
            "set RESET: the robot becomes Ready by it"
        };
        Finding::not_seen(COMMAND, found, fix)
    }
}

impl PeerWatch<RobotBus> for PlcWatch {
    fn link_event(&self, event: LinkEvent) -> Option<LinkEvent> {
        Some(event)
    }

    fn note(&mut self, _now: Instant, bus: &RobotBus, event: LinkEvent) {
        match event {
            LinkEvent::Up => (self.is_up, self.was_up, self.down) = (true, true, None),
            // The end of this look.
            LinkEvent::Down(Down { cause: DownCause::ClosedHere, .. }) => self.is_up = false,
            LinkEvent::Down(down) => {
                let mut words = String::new();
                // A string takes every character.
                let _ = bus.explain(&mut words);
                self.lost += u32::from(self.was_up);
                (self.is_up, self.down) = (false, Some((down, words)));
                self.images.disconnect();
            }
            LinkEvent::SetAddress { address, .. } => self.address = Some(address),
            LinkEvent::Conflict(conflict) => self.conflict = Some(conflict),
            LinkEvent::Store | LinkEvent::Foreign(_) | LinkEvent::Owner(_) | LinkEvent::Health => {}
        }
    }

    /// Keeps which names others ask for by DCP: a PLC with another name in its project never connects.
    fn overhear(&mut self, frame: &[u8]) {
        if self.own_name.is_none() {
            return;
        }
        let Ok((header, payload)) = EthernetHeader::parse(frame) else { return };
        let Ok(pdu) = Pdu::parse(payload) else { return };
        if header.ether_type != profinet::ETHER_TYPE || pdu.service != Service::IdentifyRequest {
            return;
        }
        for block in pdu.blocks().flatten() {
            let Content::NameOfStation(name) = block.content else { continue };
            let is_known =
                self.names.iter().any(|(mac, known)| (*mac, known.as_slice()) == (header.source, name));
            if !is_known && self.names.len() < MOST_NAMES {
                self.names.push((header.source, name.to_vec()));
            }
        }
    }

    fn scan(&mut self, now: Instant, bus: &mut RobotBus) {
        let order = bus.byte_order();
        let image = bus.input().filter(|_| self.is_up);
        if let Some((image, command)) =
            image.and_then(|image| Some((image, order.parse_command(&image).ok()?)))
            && self.images.take(now, &image, command.life, bus.counters().received)
        {
            self.command = Some(command);
            self.answer(&command);
        }
        self.feedback.life = self.feedback.life.wrapping_add(1);
        self.feedback.clock_ns = now.as_nanos();
        let mut output: Image = [0; IMAGE_LEN];
        order.emit_feedback(&self.feedback, &mut output);
        self.sealer.take_tail(&output);
        self.sealer.seal(order, &mut output);
        bus.set_output(&output);
    }

    fn is_complete(&self, now: Instant) -> bool {
        let is_watched = self.images.first_at().is_some_and(|first| now.since(first) >= COMPLETE_AFTER);
        is_watched && self.first_command.is_some()
    }

    fn disconnect(&self, now: Instant, bus: &mut RobotBus) {
        Fieldbus::disconnect(bus, now);
    }

    fn address_set(&self, now: Instant, bus: &mut RobotBus, done: bool) {
        Fieldbus::address_set(bus, now, done);
    }

    fn findings(&self, bus: &RobotBus) -> Vec<Finding> {
        let mut findings: Vec<_> = self.name().into_iter().chain(self.address()).collect();
        findings.extend([self.connection(bus), sizes(self.was_up)]);
        findings.extend(self.images.findings("PLC"));
        findings.push(self.command());
        findings
    }
}
