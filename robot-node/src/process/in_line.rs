//! The robot in an EtherCAT line as a node: all but its second interface is the robot's own.

use std::convert::Infallible;
use std::fmt;

use machine::{Instant, InterfaceId, Lateness};
use node::{Node, Waiting};
use protocol::buses::EthercatSubDevice;
use protocol::fieldbus::{Counters, LinkEvent};
use protocol::image::Checks;

use super::RobotInstruction;
use crate::robot_in_line::ONWARD;
use crate::{RobotEvent, RobotInLine, RobotNode, Sample};

/// The robot's own node.
type Robot = RobotNode<EthercatSubDevice>;

impl Node for RobotInLine {
    type Order = RobotInstruction;
    type Answer = Infallible;
    type Sample = Sample;

    fn link_event(event: &RobotEvent) -> Option<LinkEvent> {
        <Robot as Node>::link_event(event)
    }

    fn waiting(event: &RobotEvent) -> Option<Waiting> {
        <Robot as Node>::waiting(event)
    }

    fn order(&mut self, now: Instant, order: RobotInstruction) -> Option<Infallible> {
        self.robot_mut().order(now, order)
    }

    fn address_set(&mut self, now: Instant, on: InterfaceId, done: bool) {
        Node::address_set(self.robot_mut(), now, on, done);
    }

    fn carrier_interface(&self) -> Option<InterfaceId> {
        Some(ONWARD)
    }

    fn set_carrier(&mut self, _now: Instant, is_up: bool) {
        self.set_link(is_up);
    }

    fn explain(&self, event: &RobotEvent, words: &mut dyn fmt::Write) -> fmt::Result {
        Node::explain(self.robot(), event, words)
    }

    fn may_explain(event: &RobotEvent) -> bool {
        <Robot as Node>::may_explain(event)
    }

    fn remark(&self, event: &RobotEvent, words: &mut dyn fmt::Write) -> fmt::Result {
        Node::remark(self.robot(), event, words)
    }

    fn may_remark(event: &RobotEvent) -> bool {
        <Robot as Node>::may_remark(event)
    }

    fn disconnect(&mut self, now: Instant) {
        Node::disconnect(self.robot_mut(), now);
    }

    fn lateness(&self) -> &Lateness {
        self.robot().lateness()
    }

    fn counters(&self) -> Counters {
        Node::counters(self.robot())
    }

    fn checks(&self) -> Checks {
        self.robot().checks()
    }

    fn cycle_number(&self) -> u64 {
        self.robot().cycle_number()
    }

    fn sample(&self, station: usize, now: Instant) -> (Instant, Sample) {
        Node::sample(self.robot(), station, now)
    }
}
