//! The thread beside the cyclic one: turns news into messages, and instructions, signals and the end of standard
//! input into commands.

use std::fmt::Display;
use std::process::ExitCode;

use protocol::fieldbus::LinkEvent;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::message::{Console, Hello, Instruction, Message};
use crate::{Command, Happening, News, Node, NodeError, NodeProcess};

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
    console.tell::<C::Message>(&Message::Hello(Hello {
        warning: process.warning().map(str::to_owned),
        ..hello
    }));
    let told = converse(&mut process, conductor, console);
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
        eprintln!("error: {problem}");
    }
    match (told, ended) {
        (Ok(outcome), Ok(())) => outcome,
        (Err(NodeError::Driver(_)), _) | (_, Err(NodeError::Driver(_))) => Outcome::EnvironmentUnusable,
        _ => Outcome::Internal,
    }
}

/// Until the cyclic thread has ended.
fn converse<N: Node, C: Conductor<N>>(
    process: &mut NodeProcess<N>,
    conductor: &mut C,
    console: Console,
) -> Result<Outcome, NodeError> {
    let mut outcome = Outcome::Done;
    loop {
        let next = match process.next_happening()? {
            Happening::News(news) => tell(news, conductor, console),
            Happening::Line(line) => match serde_json::from_str(&line) {
                Ok(Instruction::Node(instruction)) => Next::Order(conductor.instruction(instruction)),
                Ok(Instruction::Report) => {
                    let _ = process.send(Command::Report);
                    Next::Wait
                }
                Ok(Instruction::Record(on)) => {
                    let _ = process.send(Command::Record(on));
                    Next::Wait
                }
                Ok(Instruction::Stop) => Next::End(Outcome::Done),
                Err(error) => {
                    eprintln!("not understood, and ignored: `{line}`: {error}");
                    Next::Wait
                }
            },
            Happening::Closed | Happening::Signal(_) => Next::End(Outcome::Done),
            Happening::Ended => return Ok(outcome),
        };
        // A ring that is full belongs to a thread that ended; that is the next thing that happens.
        match next {
            Next::Wait => {}
            Next::Order(order) => drop(process.send(Command::Order(order))),
            Next::End(with) => {
                if outcome == Outcome::Done {
                    outcome = with;
                }
                let _ = process.send(Command::Stop);
            }
        }
    }
}

fn tell<N: Node, C: Conductor<N>>(
    news: News<N::Event, N::Answer>,
    conductor: &mut C,
    console: Console,
) -> Next<N::Order> {
    let (message, next) = match news {
        News::Event(event) => match N::link_event(&event) {
            Some(link) => (Some(link_message(link)), conductor.link(link)),
            None => {
                let (message, next) = conductor.event(event);
                (message.map(Message::Node), next)
            }
        },
        News::Answer(answer) => {
            let (message, next) = conductor.answer(answer);
            (Some(Message::Node(message)), next)
        }
        News::NoAddress(address, error) => {
            (Some(Message::Address { address, problem: Some(error.to_string()) }), Next::Wait)
        }
        News::Snapshot(snapshot) => (Some(Message::Report((&snapshot).into())), Next::Wait),
    };
    if let Some(message) = message {
        console.tell(&message);
    }
    next
}

fn link_message<M>(event: LinkEvent) -> Message<M> {
    match event {
        LinkEvent::Up => Message::LinkUp,
        LinkEvent::Down(down) => Message::LinkDown { reason: down.to_string() },
        LinkEvent::SetAddress { address, .. } => Message::Address { address, problem: None },
    }
}
