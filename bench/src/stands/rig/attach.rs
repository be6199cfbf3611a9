//! The option `--attach`: nodes that run already, and how the rig takes control of them.

use std::str::FromStr;

use ::node::message::Instruction;
use plc_node::process::PlcInstruction;
use robot_node::process::RobotInstruction;
use setup::Setup;
use tokio::sync::mpsc;

use super::attached_node::AttachedNode;
use super::messages::Startup;
use super::node::Node;
use super::{Rig, RigError, Which};

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
        let (events, said) = mpsc::channel(1_024);
        let mut plc = AttachedNode::reach(Which::Plc, &to.plc, events.clone()).await?;
        // Whoever says nothing yields the control port to the next that comes.
        plc.tell(&Instruction::<PlcInstruction>::Report).await;
        let mut rig = Self::of(Node::Attached(plc), None, said, None, setup.bus.watchdog());
        let mut startup = Startup::new(Some(&setup.name));
        // One after the other: what is wrong with the PLC is often wrong with both, and is told of the PLC then.
        rig.meet(&mut startup).await?;
        if let Some(address) = &to.robot {
            let mut robot = AttachedNode::reach(Which::Robot, address, events).await?;
            robot.tell(&Instruction::<RobotInstruction>::Report).await;
            rig.robot = Some(Node::Attached(robot));
        }
        rig.wait_until_connected(startup).await?;
        rig.wait_until_at_start().await?;
        rig.ask_for_reports().await?;
        rig.before = rig.reports.clone();
        Ok(rig)
    }

    /// What is reached by an address may be the other node, or run another setup.
    pub(super) fn check_hellos(&self, setup: Option<&str>) -> Result<(), RigError> {
        for (which, node) in [(Which::Plc, Some(&self.plc)), (Which::Robot, self.robot.as_ref())] {
            let hello = self.hellos.iter().find(|(from, _)| *from == which);
            let (Some(Node::Attached(node)), Some((_, hello)), Some(setup)) = (node, hello, setup) else {
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
