//! How the rig takes control of nodes that already run.

use std::time::Duration;

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
use super::rig_node::RigNode;
use super::robot::RigRobot;
use super::wanted_cell::{WantedCell, WantedCells, WantedSetup};
use super::{Rig, RigError};
use crate::Attach;
use crate::cell_stand::CellConfig;
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
        let wanted = WantedCells::of_one(setup, application);
        let robot = (RigRobot::of(None), to.robot());
        Self::attach_all(&to.plc, vec![robot], token, wanted, setup.bus.watchdog(), voice).await
    }

    /// Takes control likewise of the nodes of a cell with several stations.
    ///
    /// # Errors
    ///
    /// The same.
    pub(super) async fn attach_cell(config: &CellConfig<'_>, to: &Attach) -> Result<Self, RigError> {
        let wanted = WantedCells {
            plc: WantedCell { setup: WantedSetup::Several(config.cell), application: config.applications },
            robots: config
                .stations
                .iter()
                .zip(config.texts)
                .map(|(station, text)| WantedCell {
                    setup: WantedSetup::One(&station.setup),
                    application: text,
                })
                .collect(),
        };
        let robots = config.stations.iter().map(|station| {
            let name = &station.name;
            (
                RigRobot::of(Some(name.clone())),
                to.robots.iter().find(|(of, _)| of == name).map(|(_, at)| at.as_str()),
            )
        });
        let watchdogs = config.stations.iter().map(|station| station.setup.bus.watchdog());
        let watchdog = watchdogs.min().unwrap_or_default();
        Self::attach_all(&to.plc, robots.collect(), config.token, wanted, watchdog, config.voice).await
    }

    async fn attach_all(
        plc: &str,
        robots: Vec<(RigRobot, Option<&str>)>,
        token: Option<&ControlToken>,
        wanted: WantedCells<'_>,
        watchdog: Duration,
        voice: Option<&Voice>,
    ) -> Result<Self, RigError> {
        let (sender, events) = mpsc::channel(1_024);
        let named = (RigNode::Plc, NodeRole::Plc.into());
        let mut plc = AttachedNode::reach(named, plc, token, sender.clone()).await?;
        // A controller that has sent no line loses the control port to the next one.
        plc.send(&Instruction::<PlcInstruction>::Report).await;
        let (robots, addresses): (Vec<_>, Vec<_>) = robots.into_iter().unzip();
        let mut rig = Self::of(Node::Attached(plc), robots, events, None, watchdog);
        rig.voice = voice.cloned();
        let mut startup = Startup::new(Some(wanted));
        // One after the other: an error of the PLC's is often an error of both, and is then reported of the PLC.
        rig.wait_for_hellos(&mut startup).await?;
        for (index, address) in addresses.into_iter().enumerate() {
            let (Some(robot), Some(address)) = (rig.robots.get_mut(index), address) else { continue };
            let named = (RigNode::Robot(index), robot.name());
            let mut node = AttachedNode::reach(named, address, token, sender.clone()).await?;
            node.send(&Instruction::<RobotInstruction>::Report).await;
            robot.node = Some(Node::Attached(node));
            rig.wait_for_hellos(&mut startup).await?;
        }
        drop(sender);
        rig.wait_until_connected(startup).await?;
        rig.wait_until_at_start().await?;
        rig.ask_for_reports().await?;
        rig.before = rig.reports.clone();
        Ok(rig)
    }

    /// Returns where a node is and what it says of its host; `None` if this rig started it, or if it is not ours.
    pub(super) fn attached_at(&self, id: RigNode) -> Option<AttachedAt> {
        let node = match id {
            RigNode::Plc => Some(&self.plc),
            RigNode::Robot(station) => self.robots.get(station).and_then(|robot| robot.node.as_ref()),
        };
        let Some(Node::Attached(node)) = node else { return None };
        let hello = self.hellos.iter().find(|(from, _)| *from == id);
        let host = hello.and_then(|(_, hello)| hello.host.as_ref());
        Some(AttachedAt {
            address: node.address().to_owned(),
            version: host.map(|host| host.version.clone()),
            host: host.map(|host| format!("{}, {}", host.name, host.kernel)),
        })
    }

    /// Returns where the nodes of a pair are; `None` if this rig started them.
    pub(super) fn attached_nodes(&self) -> Option<Attached> {
        let robot = self.attached_at(RigNode::Robot(0));
        let identity = self.robots.first().and_then(|robot| robot.identity.clone());
        Some(Attached { plc: self.attached_at(RigNode::Plc)?, robot, identity })
    }

    /// Checks what answers: at an address may be another node, or a node with another setup or application.
    pub(super) fn check_hellos(&self, wanted: Option<&WantedCells<'_>>) -> Result<(), RigError> {
        let Some(wanted) = wanted else { return Ok(()) };
        for id in self.nodes() {
            let of_node = match id {
                RigNode::Plc => Some(&wanted.plc),
                RigNode::Robot(station) => wanted.robots.get(station),
            };
            let hello = self.hellos.iter().find(|(from, _)| *from == id);
            let (Some(at), Some((_, hello)), Some(wanted)) = (self.attached_at(id), hello, of_node) else {
                continue;
            };
            let (role, name, address) = (id.role(), wanted.setup.name(), at.address);
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
                return Err(RigError::OtherCell { node: self.name(id), address, difference });
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
        let robots = vec![("robot".to_owned(), "[fe80::1]:7700".to_owned())];
        let both = Attach { plc: "10.0.0.1:7700".to_owned(), robots };
        assert_eq!(attach("robot=[fe80::1]:7700,plc=10.0.0.1:7700"), Ok(both));
        assert_eq!(attach("plc=cell:1"), Ok(Attach { plc: "cell:1".to_owned(), robots: Vec::new() }));
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
            "plc=a:1,robot=b:1,robot=c:1",
        ] {
            assert!(attach(wrong).is_err(), "{wrong}");
        }
    }
}
