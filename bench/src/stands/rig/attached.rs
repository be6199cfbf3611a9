//! A node that somebody else started, reached over its control port: a container, another machine, or the one node of
//! which the peer is real hardware.

use std::str::FromStr;
use std::time::Duration;

use plc_node::process::PlcInstruction;
use protocol_linux::message::Instruction;
use robot_node::process::RobotInstruction;
use serde::Serialize;
use setup::Setup;
use tokio::io::AsyncWriteExt as _;
use tokio::net::TcpStream;
use tokio::net::tcp::OwnedWriteHalf;
use tokio::sync::mpsc;
use tokio::time::{Instant, sleep, timeout, timeout_at};

use super::conversation::Beginning;
use super::node::{Said, listen};
use super::party::Party;
use super::{Rig, RigError, Which};

/// How long a node may take to come up that is started together with the bench.
const PATIENCE: Duration = Duration::from_secs(10);

/// How long an address may take to answer before it is tried again: one that is not there yet never does.
const ATTEMPT: Duration = Duration::from_secs(2);

/// From an attempt that was refused to the next.
const RETRY: Duration = Duration::from_millis(200);

/// Where to reach nodes that run already.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Attach {
    /// Host and port of the PLC's control port.
    pub plc: String,
    /// Those of the robot's; none where the robot is no node of ours.
    pub robot: Option<String>,
}

/// What is wrong with the text of an [`Attach`].
#[derive(Debug, thiserror::Error)]
pub enum AttachError {
    /// A part is no node's address.
    #[error("`{0}` is not plc=HOST:PORT or robot=HOST:PORT")]
    Part(String),
    /// A node is named twice.
    #[error("{0}=… is there twice")]
    Twice(&'static str),
    /// The PLC, which starts and times every run, is not named.
    #[error("plc=HOST:PORT is missing: the PLC starts and times every run")]
    NoPlc,
}

impl FromStr for Attach {
    type Err = AttachError;

    fn from_str(text: &str) -> Result<Self, AttachError> {
        let (mut plc, mut robot) = (None, None);
        for part in text.split(',') {
            let wrong = || AttachError::Part(part.to_owned());
            let (node, address) = part.split_once('=').ok_or_else(wrong)?;
            let (host, port) = address.rsplit_once(':').ok_or_else(wrong)?;
            if host.is_empty() || port.parse::<u16>().is_err() {
                return Err(wrong());
            }
            let (name, place) = match node {
                "plc" => ("plc", &mut plc),
                "robot" => ("robot", &mut robot),
                _ => return Err(wrong()),
            };
            if place.replace(address.to_owned()).is_some() {
                return Err(AttachError::Twice(name));
            }
        }
        Ok(Self { plc: plc.ok_or(AttachError::NoPlc)?, robot })
    }
}

impl Rig {
    /// Takes control of nodes that run `setup` already and waits until the PLC finds the robot ready. They run on when
    /// the rig ends.
    ///
    /// # Errors
    ///
    /// A node that is not there, is not the one that is wanted or has another controller; or a connection between them
    /// that does not come about.
    pub async fn attach(to: &Attach, setup: &Setup) -> Result<Self, RigError> {
        let (sayings, said) = mpsc::channel(1_024);
        let mut plc = AttachedNode::reach(Which::Plc, &to.plc, sayings.clone()).await?;
        // Whoever says nothing yields the control port to the next that comes.
        plc.tell(&Instruction::<PlcInstruction>::Report).await;
        let mut rig = Self::of(Party::Attached(plc), None, said, None, setup.bus.watchdog());
        let mut beginning = Beginning::new(Some(&setup.name));
        // One after the other: what is wrong with the PLC is often wrong with both, and is told of the PLC then.
        rig.meet(&mut beginning).await?;
        if let Some(address) = &to.robot {
            let mut robot = AttachedNode::reach(Which::Robot, address, sayings).await?;
            robot.tell(&Instruction::<RobotInstruction>::Report).await;
            rig.robot = Some(Party::Attached(robot));
        }
        rig.wait_until_ready(beginning).await?;
        rig.ask_for_reports().await?;
        rig.before = rig.reports.clone();
        Ok(rig)
    }

    /// What is reached by an address may be the other node, or run another setup.
    pub(super) fn check_hellos(&self, setup: Option<&str>) -> Result<(), RigError> {
        for (which, node) in [(Which::Plc, Some(&self.plc)), (Which::Robot, self.robot.as_ref())] {
            let hello = self.hellos.iter().find(|(from, _)| *from == which);
            let (Some(Party::Attached(node)), Some((_, hello)), Some(setup)) = (node, hello, setup) else {
                continue;
            };
            if hello.node != which.to_string() || hello.setup != setup {
                return Err(RigError::Other {
                    address: node.address().to_owned(),
                    found: format!("{} of setup {}", hello.node, hello.setup),
                    wanted: format!("{which} of setup {setup}"),
                });
            }
        }
        Ok(())
    }
}

/// The conversation with one of them.
#[derive(Debug)]
pub(super) struct AttachedNode {
    which: Which,
    address: String,
    stream: OwnedWriteHalf,
    ended: bool,
}

impl AttachedNode {
    /// Connects, again and again until the node is there.
    pub(super) async fn reach(
        which: Which,
        address: &str,
        sayings: mpsc::Sender<Said>,
    ) -> Result<Self, RigError> {
        let until = Instant::now() + PATIENCE;
        let mut reason = "no answer".to_owned();
        let reached = async {
            loop {
                match timeout(ATTEMPT, TcpStream::connect(address)).await {
                    Ok(Ok(stream)) => return stream,
                    Ok(Err(error)) => reason = error.to_string(),
                    Err(_) => {}
                }
                sleep(RETRY).await;
            }
        };
        let reached = timeout_at(until, reached).await;
        let unreachable =
            |reason| RigError::Unreachable { which, address: address.to_owned(), waited: PATIENCE, reason };
        let stream = reached.map_err(|_| unreachable(reason))?;
        stream.set_nodelay(true).map_err(|error| unreachable(error.to_string()))?;
        let (from, stream) = stream.into_split();
        listen(which, from, sayings);
        Ok(Self { which, address: address.to_owned(), stream, ended: false })
    }

    /// Tells the node something. If it cannot hear, it has gone, and that is told by [`Said::Ended`].
    pub(super) async fn tell<O: Serialize>(&mut self, instruction: &Instruction<O>) {
        let mut line = serde_json::to_vec(instruction).unwrap_or_default();
        line.push(b'\n');
        let _ = self.stream.write_all(&line).await;
    }

    pub(super) const fn has_ended(&self) -> bool {
        self.ended
    }

    pub(super) fn obituary(&mut self) -> RigError {
        self.ended = true;
        RigError::Detached { which: self.which, address: self.address.clone() }
    }

    pub(super) fn address(&self) -> &str {
        &self.address
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_robot_may_be_missing_and_the_plc_may_not() {
        let attach = |text: &str| text.parse::<Attach>().map_err(|error| error.to_string());
        let both = Attach { plc: "10.0.0.1:7700".to_owned(), robot: Some("[fe80::1]:7700".to_owned()) };
        assert_eq!(attach("robot=[fe80::1]:7700,plc=10.0.0.1:7700"), Ok(both));
        assert_eq!(attach("plc=cell:1"), Ok(Attach { plc: "cell:1".to_owned(), robot: None }));
        for wrong in [
            "",
            "plc",
            "plc=",
            "plc=cell",
            "plc=:1",
            "plc=cell:70000",
            "cell=a:1",
            "robot=a:1",
            "plc=a:1,plc=a:1",
        ] {
            assert!(attach(wrong).is_err(), "{wrong}");
        }
    }
}
