//! How the rig takes control of nodes that already run.

use ::node::message::Instruction;
use ::node::role::NodeRole;
use ::node::token::ControlToken;
use plc_node::process::PlcInstruction;
use robot_node::process::RobotInstruction;
use setup::Setup;
use tokio::sync::mpsc;

use super::attached_node::AttachedNode;
use super::messages::Startup;
use super::node::Node;
use super::wanted_cell::WantedCell;
use super::{Rig, RigError};
use crate::Attach;
use records::attached::{Attached, AttachedAt};
use records::voice::Voice;

impl Rig {
    /// Takes control of nodes that already run `setup`, by their token if they have one, and waits until the PLC finds the robot ready. They keep
    /// running when the rig ends.
    ///
    /// # Errors
    ///
    /// A node does not answer, is not the requested one, runs another cell or has another controller; or the nodes do not
    /// connect to each other.
    pub async fn attach(
        to: &Attach,
        token: Option<&ControlToken>,
        setup: &Setup,
        application: &str,
        voice: Option<&Voice>,
    ) -> Result<Self, RigError> {
        let (sender, events) = mpsc::channel(1_024);
        let mut plc = AttachedNode::reach(NodeRole::Plc, &to.plc, token, sender.clone()).await?;
        // A controller that has sent no line loses the control port to the next one.
        plc.send(&Instruction::<PlcInstruction>::Report).await;
        let mut rig = Self::of(Node::Attached(plc), None, events, None, setup.bus.watchdog());
        rig.voice = voice.cloned();
        let mut startup = Startup::new(Some(WantedCell { setup, application }));
        // One after the other: an error of the PLC's is often an error of both, and is then reported of the PLC.
        rig.wait_for_hellos(&mut startup).await?;
        if let Some(address) = &to.robot {
            let mut robot = AttachedNode::reach(NodeRole::Robot, address, token, sender).await?;
            robot.send(&Instruction::<RobotInstruction>::Report).await;
            rig.robot = Some(Node::Attached(robot));
        }
        rig.wait_until_connected(startup).await?;
        rig.wait_until_at_start().await?;
        rig.ask_for_reports().await?;
        rig.before = rig.reports.clone();
        Ok(rig)
    }

    /// Returns where the nodes are and what they say of their hosts; `None` if this rig started them.
    pub(super) fn attached_nodes(&self) -> Option<Attached> {
        let at = |role: NodeRole, node: &Node| {
            let Node::Attached(node) = node else { return None };
            let hello = self.hellos.iter().find(|(from, _)| *from == role);
            let host = hello.and_then(|(_, hello)| hello.host.as_ref());
            Some(AttachedAt {
                address: node.address().to_owned(),
                version: host.map(|host| host.version.clone()),
                host: host.map(|host| format!("{}, {}", host.name, host.kernel)),
            })
        };
        let robot = self.robot.as_ref().and_then(|robot| at(NodeRole::Robot, robot));
        Some(Attached { plc: at(NodeRole::Plc, &self.plc)?, robot })
    }

    /// Checks what answers: at an address may be the other node, or a node with another setup or application.
    pub(super) fn check_hellos(&self, wanted: Option<WantedCell<'_>>) -> Result<(), RigError> {
        for (role, node) in [(NodeRole::Plc, Some(&self.plc)), (NodeRole::Robot, self.robot.as_ref())] {
            let hello = self.hellos.iter().find(|(from, _)| *from == role);
            let (Some(Node::Attached(node)), Some((_, hello)), Some(wanted)) = (node, hello, wanted) else {
                continue;
            };
            let name = &wanted.setup.name;
            let address = node.address().to_owned();
            if hello.node != role || hello.setup != *name {
                return Err(RigError::Other {
                    address,
                    found: format!("{} of setup {}", hello.node, hello.setup),
                    wanted: format!("{role} of setup {name}"),
                });
            }
            let difference = hello.cell.as_ref().map_or_else(
                || Some("it does not say what it runs: its version is older".to_owned()),
                |cell| wanted.difference(role, cell),
            );
            if let Some(difference) = difference {
                return Err(RigError::OtherCell { role, address, difference });
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
