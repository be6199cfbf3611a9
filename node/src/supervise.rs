//! The thread beside the cyclic one: turns notices into messages, and instructions, signals and the end of standard
//! input into commands.
//!
//! Over a control port, controllers come and go while the node runs. The node sends each new one its current state,
//! and ends what the previous one had started.

use std::fmt::Display;

use machine::LinkEvent;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::link_state::Link;
use crate::message::{Hello, Instruction, Message};
use crate::output::to_stdout;
use crate::station_file::{Station, StationFile};
use crate::station_message::{Console, StationMessage};
use crate::wait_lines::WaitLines;
use crate::{Command, Input, Node, NodeError, NodeProcess, Notice, Outcome, ProcessEvent, ShortText, errln};

/// What one kind of node adds to the supervision of a node, with or without instructions.
pub trait OperatingMode<N: Node> {
    /// Messages of only this kind of node.
    type Message: Serialize + Display;
    /// Instructions of only this kind of node.
    type Instruction: DeserializeOwned;

    /// Handles an event that is not a [`LinkEvent`]: returns its message, if any, and what to do.
    fn event(&mut self, event: N::Event) -> (Option<Self::Message>, Next<N::Order>);

    /// Handles the connection coming up or going down.
    fn link(&mut self, _event: LinkEvent) -> Next<N::Order> {
        Next::Wait
    }

    /// Handles the node's answer to an order: returns its message and what to do.
    fn answer(&mut self, answer: N::Answer) -> (Self::Message, Next<N::Order>);

    /// Returns the index of the station that an answer is about; `None` where it is about the whole node.
    fn answered_station(_answer: &N::Answer) -> Option<usize> {
        None
    }

    /// Converts an instruction to an order.
    fn instruction(&mut self, instruction: Self::Instruction) -> N::Order;

    /// Returns the message that refuses an instruction for this reason, while everything goes on.
    fn refuse(&self, reason: String) -> Self::Message;

    /// Returns the state that a new controller has to know, besides whether the connection is up.
    fn greeting(&self) -> Option<Self::Message> {
        None
    }

    /// Handles the loss of a controller.
    fn controller_left(&mut self) -> Next<N::Order> {
        Next::Wait
    }
}

/// What to do next.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Next<O> {
    /// Nothing.
    Wait,
    /// Send the node an order.
    Order(O),
    /// Close the connection in order and end with this result.
    End(Outcome),
}

/// What the supervisor knows of a node before it runs.
#[derive(Debug)]
pub struct Supervised {
    /// Format of the messages on standard output.
    pub console: Console,
    /// The first message.
    pub hello: Hello,
    /// Names of the stations, in their order; empty where there is only one, which no message names.
    pub stations: Vec<String>,
    /// Where the node keeps what its bus sets permanently.
    pub station_file: Option<StationFile>,
}

/// Prints or sends what happens until the node ends, and ends it on request.
pub fn supervise<N: Node, C: OperatingMode<N>>(
    mut process: NodeProcess<N>,
    mode: &mut C,
    Supervised { console, hello, stations, station_file }: Supervised,
) -> Outcome {
    let hello = Hello { warning: process.warning().map(str::to_owned), ..hello };
    console.print::<C::Message>(&Message::Hello(hello.clone()).into());
    let port = process.control().map(|port| (port.address(), port.wants_token()));
    if let Some((Ok(address), wants_token)) = port {
        let who = if wants_token { "by who has the token" } else { "by any program on this computer" };
        log(format_args!("controlled over {address}, {who}"));
    }
    let mut supervisor = Supervisor {
        process: &mut process,
        mode,
        console,
        hello,
        station_file,
        links: (0..stations.len().max(1)).map(|_| Link::default()).collect(),
        stations,
        explanation: None,
        wait_lines: WaitLines::default(),
    };
    let result = supervisor.run();
    let (snapshot, ended) = match result {
        Ok(_) => process.finish(),
        // Without inputs nothing could stop the cyclic thread; it ends with the process.
        Err(NodeError::Inbox { .. }) => (None, Ok(())),
        Err(_) => process.finish(),
    };
    let problem = result.as_ref().err().or(ended.as_ref().err()).map(ToString::to_string);
    let report = snapshot.as_ref().map(Into::into);
    console.print::<C::Message>(&Message::Farewell { report, problem: problem.clone() }.into());
    if let Some(problem) = problem {
        errln!("error: {problem}");
    }
    match (result, ended) {
        (Ok(outcome), Ok(())) => outcome,
        (Err(NodeError::Driver(_)), _) | (_, Err(NodeError::Driver(_))) => Outcome::EnvironmentUnusable,
        _ => Outcome::Internal,
    }
}

struct Supervisor<'a, N: Node, C: OperatingMode<N>> {
    process: &'a mut NodeProcess<N>,
    mode: &'a mut C,
    console: Console,
    hello: Hello,
    station_file: Option<StationFile>,
    /// Names of the stations; empty where there is only one.
    stations: Vec<String>,
    /// The connection to each station, at least one.
    links: Vec<Link>,
    /// The node's text about the next event.
    explanation: Option<ShortText>,
    wait_lines: WaitLines,
}

impl<N: Node, C: OperatingMode<N>> Supervisor<'_, N, C> {
    /// Handles events until the cyclic thread has ended.
    fn run(&mut self) -> Result<Outcome, NodeError> {
        let mut outcome = Outcome::Done;
        loop {
            let next = match self.process.next_event()? {
                ProcessEvent::Notice(notice) => self.handle_notice(notice),
                ProcessEvent::Input(Input::Line(line)) => self.handle_instruction(&line),
                ProcessEvent::Input(Input::Attached(peer)) => {
                    log(format_args!("controlled by {peer}"));
                    self.send_state();
                    Next::Wait
                }
                ProcessEvent::Input(Input::Detached { peer, reason }) => {
                    log(format_args!("no longer controlled by {peer}: {reason}"));
                    self.mode.controller_left()
                }
                ProcessEvent::Input(Input::Refused { peer, reason, more }) => {
                    log(format_args!(
                        "{peer} did not get control: {reason} ({more} more since the last report)"
                    ));
                    Next::Wait
                }
                ProcessEvent::Input(Input::Link(_) | Input::Carrier(_)) => Next::Wait,
                ProcessEvent::Input(Input::Closed) => Next::End(Outcome::Done),
                ProcessEvent::Input(Input::Stop(_)) => Next::End(Outcome::Interrupted),
                ProcessEvent::Ended => return Ok(outcome),
            };
            // Sending fails only if the thread has ended, and the next event reports that.
            match next {
                Next::Wait => {}
                Next::Order(order) => drop(self.process.send(Command::Order(order))),
                Next::End(with) => {
                    if outcome == Outcome::Done {
                        outcome = with;
                    }
                    let _ = self.process.send(Command::Stop);
                }
            }
        }
    }

    fn handle_instruction(&mut self, line: &str) -> Next<N::Order> {
        match serde_json::from_str(line) {
            Ok(Instruction::Node(instruction)) => Next::Order(self.mode.instruction(instruction)),
            Ok(Instruction::Report) => {
                let _ = self.process.send(Command::Report);
                Next::Wait
            }
            Ok(Instruction::Record(on)) => {
                let _ = self.process.send(Command::Record(on));
                Next::Wait
            }
            Ok(Instruction::Token(_)) => {
                if let Some(port) = self.process.control() {
                    port.deny("this node was started without a control token");
                }
                Next::Wait
            }
            Ok(Instruction::Stop) => Next::End(Outcome::Done),
            Err(error) => {
                self.reject(line, &error);
                Next::Wait
            }
        }
    }

    /// Answers a line that is not an instruction. A controller that writes JSON may have a wrong value in it: it keeps control, and
    /// what it has started goes on. What is no JSON comes from no controller.
    fn reject(&mut self, line: &str, error: &serde_json::Error) {
        if is_json(line) {
            let refusal = self.mode.refuse(in_one_line(error));
            return self.send(None, Message::Node(refusal));
        }
        match self.process.control() {
            Some(port) => port.deny(format!("it sent a line that is not an instruction: {error}")),
            None => errln!("ignored, because it is not an instruction: `{line}`: {error}"),
        }
    }

    /// Sends a new controller what earlier ones received before: the node, the state of each connection, and the node's own
    /// state.
    fn send_state(&mut self) {
        let mut state = vec![StationMessage::from(Message::Hello(self.hello.clone()))];
        let about = |station: usize, message: Message<C::Message>| self.about(Some(station), message);
        for (station, link) in self.links.iter().enumerate() {
            state.extend(link.is_up.then(|| about(station, Message::LinkUp)));
            let identity = link.identity.clone();
            state.extend(identity.map(|text| about(station, Message::Identity { text })));
            state.extend(link.remark.clone().map(|text| about(station, Message::Remark { text })));
        }
        state.extend(self.mode.greeting().map(|greeting| Message::Node(greeting).into()));
        for (station, link) in self.links.iter().enumerate() {
            let waiting = link.waiting.as_ref().map(|waiting| link.waiting_message(waiting));
            state.extend(waiting.map(|message| about(station, message)));
        }
        if let Some(port) = self.process.control() {
            state.iter().for_each(|message| port.send(&message.to_json()));
        }
    }

    /// Names the station of a message, if there are several.
    fn about(&self, station: Option<usize>, message: Message<C::Message>) -> StationMessage<C::Message> {
        let name = station.and_then(|station| self.stations.get(station));
        StationMessage { station: name.cloned(), message }
    }

    fn handle_notice(&mut self, notice: Notice<N::Event, N::Answer>) -> Next<N::Order> {
        let (station, message, next) = match notice {
            Notice::Event(event) => {
                let station = N::station(&event);
                let (message, next) = self.handle_event(station, event);
                (station, message, next)
            }
            Notice::Explanation(words) => {
                self.explanation = Some(words);
                return Next::Wait;
            }
            Notice::Identity(station, text) => {
                let text = text.as_str().to_owned();
                if let Some(link) = self.links.get_mut(station) {
                    link.identity = Some(text.clone());
                }
                (Some(station), Some(Message::Identity { text }), Next::Wait)
            }
            Notice::Remark(station, text) => {
                let text = self.links.get_mut(station).and_then(|link| link.take_remark(text.as_str()));
                (Some(station), text.map(|text| Message::Remark { text }), Next::Wait)
            }
            Notice::Answer(answer) => {
                let station = C::answered_station(&answer);
                let (message, next) = self.mode.answer(answer);
                (station, Some(Message::Node(message)), next)
            }
            Notice::NoAddress(address, error) => {
                (None, Some(Message::Address { address, problem: Some(error.to_string()) }), Next::Wait)
            }
            Notice::Store(record) => {
                let stored = self.store(&(&record).into());
                let _ = self.process.send(Command::Stored(stored));
                return Next::Wait;
            }
            Notice::Snapshot(snapshot) => (None, Some(Message::Report((&snapshot).into())), Next::Wait),
        };
        if let Some(message) = message {
            self.send(station, message);
        }
        next
    }

    fn handle_event(
        &mut self,
        station: Option<usize>,
        event: N::Event,
    ) -> (Option<Message<C::Message>>, Next<N::Order>) {
        let index = station.unwrap_or_default();
        if let Some(link) = N::link_event(&event) {
            return self.handle_link(index, link);
        }
        if let Some(waiting) = N::waiting(&event) {
            let message = self.links.get(index).map(|link| link.waiting_message(&waiting));
            if let Some(link) = self.links.get_mut(index) {
                link.waiting = Some(waiting);
            }
            return (message, Next::Wait);
        }
        // What happens to the whole node ends every wait.
        for (number, link) in self.links.iter_mut().enumerate() {
            if station.is_none_or(|station| station == number) {
                link.waiting = None;
            }
        }
        let (message, next) = self.mode.event(event);
        (message.map(Message::Node), next)
    }

    fn handle_link(
        &mut self,
        station: usize,
        event: LinkEvent,
    ) -> (Option<Message<C::Message>>, Next<N::Order>) {
        let message = link_message(event, self.explanation.take());
        if let Some(link) = self.links.get_mut(station) {
            match event {
                LinkEvent::Up => *link = Link { is_up: true, ..Link::default() },
                LinkEvent::Down(_) => {
                    (link.is_up, link.remark, link.identity) = (false, None, None);
                    if let Some(Message::LinkDown { reason }) = &message {
                        link.last_down = Some(reason.clone());
                    }
                }
                LinkEvent::SetAddress { .. }
                | LinkEvent::Store
                | LinkEvent::Foreign(_)
                | LinkEvent::Owner(_)
                | LinkEvent::Conflict(_)
                | LinkEvent::Health => {}
            }
        }
        (message, self.mode.link(event))
    }

    /// Stores name and address that the bus set permanently. Returns whether that worked.
    fn store(&self, station: &Station) -> bool {
        let Some(file) = &self.station_file else { return false };
        match file.save(station) {
            Ok(()) => {
                if self.console == Console::Text {
                    log(format_args!("{station}, stored in {}", file.path().display()));
                }
                true
            }
            Err(error) => {
                errln!("cannot store name and address in {}: {error}", file.path().display());
                false
            }
        }
    }

    /// Sends a message to the controller. Results of its instructions go to it alone; messages about the node are
    /// also printed.
    fn send(&mut self, station: Option<usize>, message: Message<C::Message>) {
        let message = self.about(station, message);
        let port = self.process.control();
        let is_for_console =
            port.is_none() || !matches!(message.message, Message::Node(_) | Message::Report(_));
        if let Some(port) = port {
            port.send(&message.to_json());
        }
        if is_for_console && (self.console == Console::Json || self.is_due(&message)) {
            self.console.print(&message);
        }
    }

    /// Returns whether a person is to see the message: of a long wait only some.
    fn is_due(&mut self, message: &StationMessage<C::Message>) -> bool {
        match &message.message {
            Message::Waiting { seconds, reason, .. } => {
                self.wait_lines.is_due(message.station.as_deref(), *seconds, reason)
            }
            _ => true,
        }
    }
}

/// Returns whether the line is one JSON value.
fn is_json(line: &str) -> bool {
    serde_json::from_str::<serde::de::IgnoredAny>(line).is_ok()
}

/// Returns the error of a line. Its place is a column: there is one line alone.
fn in_one_line(error: &serde_json::Error) -> String {
    let (text, place) = (error.to_string(), format!(" at line {} column {}", error.line(), error.column()));
    match text.strip_suffix(&place) {
        // serde_json's words where neither a name nor an object with one name comes.
        Some("expected value") => {
            r#"expected an instruction, such as "report" or {"node":"abort"}"#.to_owned()
        }
        Some(reason) => format!("{reason} (before column {})", error.column()),
        None => text,
    }
}

/// Logs connects and disconnects of controllers to the node's console only.
fn log(words: std::fmt::Arguments<'_>) {
    // A full disk must not end a running node.
    let _ = to_stdout(format_args!("{words}\n"));
}

/// Returns the message about an event; `None` if what follows it, or its remark, is reported.
fn link_message<M>(event: LinkEvent, explanation: Option<ShortText>) -> Option<Message<M>> {
    Some(match event {
        LinkEvent::Up => Message::LinkUp,
        LinkEvent::Down(down) => Message::LinkDown {
            reason: explanation.map_or_else(|| down.to_string(), |words| words.as_str().to_owned()),
        },
        LinkEvent::SetAddress { address, .. } => Message::Address { address, problem: None },
        LinkEvent::Foreign(request) => Message::Foreign { request: request.to_string() },
        LinkEvent::Owner(owner) => Message::Owner { owner: owner.to_string() },
        LinkEvent::Conflict(conflict) => Message::Conflict { conflict: conflict.to_string() },
        LinkEvent::Store | LinkEvent::Health => return None,
    })
}
