//! The thread beside the cyclic one: turns news into messages, and instructions, signals and the end of standard
//! input into commands.
//!
//! Over a control port controllers come and go while the node runs on. The node greets each with what it missed, and
//! gives up what the one that left had started.

use std::fmt::Display;
use std::process::ExitCode;

use machine::LinkEvent;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::message::{Console, Hello, Instruction, Message};
use crate::output::to_stdout;
use crate::{Command, News, Node, NodeError, NodeProcess, ProcessEvent, ShortText, errln};

/// What one kind of node adds to what all nodes do.
pub trait Conductor<N: Node> {
    /// What only this kind of node says.
    type Message: Serialize + Display;
    /// What only this kind of node is told.
    type Instruction: DeserializeOwned;

    /// An event that is no [`LinkEvent`], in words; and what to do about it.
    fn event(&mut self, event: N::Event) -> (Option<Self::Message>, Next<N::Order>);

    /// The connection came up or went down; what to do about it.
    fn link(&mut self, _event: LinkEvent) -> Next<N::Order> {
        Next::Wait
    }

    /// The node's answer to an order, in words; and what to do about it.
    fn answer(&mut self, answer: N::Answer) -> (Self::Message, Next<N::Order>);

    /// The order that an instruction means.
    fn instruction(&mut self, instruction: Self::Instruction) -> N::Order;

    /// What a controller has to know that comes now, besides whether there is a connection.
    fn greeting(&self) -> Option<Self::Message> {
        None
    }

    /// What to do about a controller that left.
    fn deserted(&mut self) -> Next<N::Order> {
        Next::Wait
    }
}

/// What to do next.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Next<O> {
    /// Nothing.
    Wait,
    /// Give the node an order.
    Order(O),
    /// End in order, with this result.
    End(Outcome),
}

/// How a node's process ended; the numbers are its exit codes, the same as the bench's.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Outcome {
    /// As asked.
    Done = 0,
    /// A fault of the program.
    Internal = 1,
    /// The command line or a setup is wrong.
    Usage = 2,
    /// A run failed.
    RunFailed = 4,
    /// The host lacks what the node needs: an interface, a permission, a port.
    EnvironmentUnusable = 5,
}

impl From<Outcome> for ExitCode {
    fn from(outcome: Outcome) -> Self {
        Self::from(outcome as u8)
    }
}

/// Tells what happens until the node ends, and ends it when asked to.
pub fn supervise<N: Node, C: Conductor<N>>(
    mut process: NodeProcess<N>,
    conductor: &mut C,
    console: Console,
    hello: Hello,
) -> Outcome {
    let hello = Hello { warning: process.warning().map(str::to_owned), ..hello };
    console.tell::<C::Message>(&Message::Hello(hello.clone()));
    if let Some(Ok(address)) = process.control().map(|port| port.address()) {
        note(format_args!("controlled over {address}, by whoever reaches it"));
    }
    let mut supervisor =
        Supervisor { process: &mut process, conductor, console, hello, linked: false, explanation: None };
    let told = supervisor.converse();
    let (snapshot, ended) = match told {
        Ok(_) => process.finish(),
        // Without an inbox nobody could end the cyclic thread; it dies with the process.
        Err(NodeError::Inbox { .. }) => (None, Ok(())),
        Err(_) => process.finish(),
    };
    let problem = told.as_ref().err().or(ended.as_ref().err()).map(ToString::to_string);
    let report = snapshot.as_ref().map(Into::into);
    console.tell::<C::Message>(&Message::Farewell { report, problem: problem.clone() });
    if let Some(problem) = problem {
        errln!("error: {problem}");
    }
    match (told, ended) {
        (Ok(outcome), Ok(())) => outcome,
        (Err(NodeError::Driver(_)), _) | (_, Err(NodeError::Driver(_))) => Outcome::EnvironmentUnusable,
        _ => Outcome::Internal,
    }
}

struct Supervisor<'a, N: Node, C> {
    process: &'a mut NodeProcess<N>,
    conductor: &'a mut C,
    console: Console,
    hello: Hello,
    /// Whether images are exchanged.
    linked: bool,
    /// What the node says of the event that comes next.
    explanation: Option<ShortText>,
}

impl<N: Node, C: Conductor<N>> Supervisor<'_, N, C> {
    /// Until the cyclic thread has ended.
    fn converse(&mut self) -> Result<Outcome, NodeError> {
        let mut outcome = Outcome::Done;
        loop {
            let next = match self.process.next_happening()? {
                ProcessEvent::News(news) => self.tell_news(news),
                ProcessEvent::Line(line) => self.obey(&line),
                ProcessEvent::Attached(peer) => {
                    note(format_args!("controlled by {peer}"));
                    self.greet();
                    Next::Wait
                }
                ProcessEvent::Detached { peer, reason } => {
                    note(format_args!("no longer controlled by {peer}: {reason}"));
                    self.conductor.deserted()
                }
                ProcessEvent::Closed | ProcessEvent::Signal(_) => Next::End(Outcome::Done),
                ProcessEvent::Ended => return Ok(outcome),
            };
            // A ring that is full belongs to a thread that ended; that is the next thing that happens.
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

    fn obey(&mut self, line: &str) -> Next<N::Order> {
        match serde_json::from_str(line) {
            Ok(Instruction::Node(instruction)) => Next::Order(self.conductor.instruction(instruction)),
            Ok(Instruction::Report) => {
                let _ = self.process.send(Command::Report);
                Next::Wait
            }
            Ok(Instruction::Record(on)) => {
                let _ = self.process.send(Command::Record(on));
                Next::Wait
            }
            Ok(Instruction::Stop) => Next::End(Outcome::Done),
            Err(error) => {
                match self.process.control() {
                    Some(port) => port.dismiss(format!("what it said is no instruction: {error}")),
                    None => errln!("not understood, and ignored: `{line}`: {error}"),
                }
                Next::Wait
            }
        }
    }

    /// Tells a controller that has just come what the others heard before it.
    fn greet(&mut self) {
        let hello = Message::<C::Message>::Hello(self.hello.clone());
        let link = self.linked.then_some(Message::LinkUp);
        let greeting = self.conductor.greeting().map(Message::Node);
        if let Some(port) = self.process.control() {
            for message in [Some(hello), link, greeting].into_iter().flatten() {
                port.tell(&message.to_json());
            }
        }
    }

    fn tell_news(&mut self, news: News<N::Event, N::Answer>) -> Next<N::Order> {
        let (message, next) = match news {
            News::Event(event) => match N::link_event(&event) {
                Some(link) => {
                    match link {
                        LinkEvent::Up => self.linked = true,
                        LinkEvent::Down(_) => self.linked = false,
                        LinkEvent::SetAddress { .. } => {}
                    }
                    (Some(link_message(link, self.explanation.take())), self.conductor.link(link))
                }
                None => {
                    let (message, next) = self.conductor.event(event);
                    (message.map(Message::Node), next)
                }
            },
            News::Explanation(words) => {
                self.explanation = Some(words);
                (None, Next::Wait)
            }
            News::Answer(answer) => {
                let (message, next) = self.conductor.answer(answer);
                (Some(Message::Node(message)), next)
            }
            News::NoAddress(address, error) => {
                (Some(Message::Address { address, problem: Some(error.to_string()) }), Next::Wait)
            }
            News::Snapshot(snapshot) => (Some(Message::Report((&snapshot).into())), Next::Wait),
        };
        if let Some(message) = message {
            self.tell(&message);
        }
        next
    }

    /// What a controller started is told to it alone; what concerns the node itself is printed as well.
    fn tell(&mut self, message: &Message<C::Message>) {
        let Some(port) = self.process.control() else { return self.console.tell(message) };
        port.tell(&message.to_json());
        if !matches!(message, Message::Node(_) | Message::Report(_)) {
            self.console.tell(message);
        }
    }
}

/// Tells whoever looks at the node about its controllers, which none of those needs to hear.
fn note(words: std::fmt::Arguments<'_>) {
    // A node that runs does not end because a disk is full.
    let _ = to_stdout(format_args!("{words}\n"));
}

fn link_message<M>(event: LinkEvent, explanation: Option<ShortText>) -> Message<M> {
    match event {
        LinkEvent::Up => Message::LinkUp,
        LinkEvent::Down(down) => Message::LinkDown {
            reason: explanation.map_or_else(|| down.to_string(), |words| words.as_str().to_owned()),
        },
        LinkEvent::SetAddress { address, .. } => Message::Address { address, problem: None },
    }
}
