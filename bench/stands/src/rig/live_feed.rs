//! Forwards the messages of the rig's nodes to the live view.

use ::node::message::Message;
use plc_node::process::PlcMessage;
use robot_node::process::RobotMessage;

use super::Rig;
use super::node_process::NodeEvent;
use super::rig_node::RigNode;
use records::feed::Feed;

impl Rig {
    /// Sends a message of a node to the live view. The rig has already handled it.
    pub(super) fn feed_live(&self, event: &NodeEvent) {
        let Some(feed) = &self.feed else { return };
        let reports = || self.reports();
        match event {
            NodeEvent::Plc(_, Message::Node(PlcMessage::Started { at_ns, .. })) => feed.started(*at_ns),
            NodeEvent::Plc(_, Message::Node(PlcMessage::Finished(run))) => {
                feed.motions_done(run.execution_time_ns)
            }
            NodeEvent::Plc(_, Message::Report(_) | Message::Farewell { report: Some(_), .. }) => {
                feed.report(None, reports().plc);
            }
            NodeEvent::Robot(station, Message::Report(_) | Message::Farewell { report: Some(_), .. }) => {
                if let Some(report) = reports().robots.get(*station) {
                    feed.report(Some(*station), report.clone());
                }
            }
            NodeEvent::Plc(station, message) => {
                let by = self.source(RigNode::Plc, station.as_deref());
                forward(feed, &by, message, is_alarm_of_plc);
            }
            NodeEvent::Robot(station, message) => {
                forward(feed, &self.source(RigNode::Robot(*station), None), message, is_alarm_of_robot);
            }
            NodeEvent::Ended(node) => {
                feed.note(format!("the node of the {} has ended", self.source(*node, None)));
            }
            NodeEvent::UnreadableLine { node, line } => {
                feed.alarm(format!("{}: {line}", self.source(*node, None)));
            }
            NodeEvent::OtherProtocol { node, protocol } => {
                feed.alarm(format!("{}: messages of protocol {protocol}", self.source(*node, None)));
            }
        }
    }

    /// Returns who sends a message, with the station that it is about where there are several.
    fn source(&self, node: RigNode, station: Option<&str>) -> String {
        let of_robot = |index: usize| self.robots.get(index).and_then(|robot| robot.station.as_deref());
        let station = match node {
            RigNode::Plc => station,
            RigNode::Robot(index) => of_robot(index),
        };
        let role = node.role();
        station
            .filter(|_| self.robots.len() > 1)
            .map_or_else(|| role.to_string(), |name| format!("{role}, {name}"))
    }
}

/// Forwards the text of a message that a person may want to read.
fn forward<M: std::fmt::Display>(
    feed: &Feed,
    by: &str,
    message: &Message<M>,
    is_alarm: impl Fn(&M) -> Option<bool>,
) {
    let is_alarm = match message {
        Message::LinkUp | Message::Owner { .. } | Message::Address { problem: None, .. } => Some(false),
        Message::LinkDown { .. }
        | Message::Address { .. }
        | Message::Foreign { .. }
        | Message::Waiting { .. }
        | Message::Remark { .. }
        | Message::Conflict { .. }
        | Message::Busy { .. }
        | Message::Denied { .. } => Some(true),
        Message::Hello(hello) => hello.warning.as_ref().map(|_| true),
        Message::Identity { .. } => Some(false),
        Message::Report(_) => None,
        Message::Farewell { problem, .. } => problem.as_ref().map(|_| true),
        Message::Node(message) => is_alarm(message),
    };
    match is_alarm {
        Some(true) => feed.alarm(format!("{by}: {message}")),
        Some(false) => feed.note(format!("{by}: {message}")),
        None => {}
    }
}

/// Returns whether a message of the PLC is an alarm; `None` if it is of no interest.
const fn is_alarm_of_plc(message: &PlcMessage) -> Option<bool> {
    match message {
        PlcMessage::ImageBad
        | PlcMessage::LifeStill
        | PlcMessage::Failed { .. }
        | PlcMessage::Refused { .. } => Some(true),
        PlcMessage::ImageGood => Some(false),
        PlcMessage::MovingToStart
        | PlcMessage::Ready
        | PlcMessage::Started { .. }
        | PlcMessage::Passed { .. }
        | PlcMessage::Finished(_) => None,
    }
}

/// Returns whether a message of the robot is an alarm; `None` if it is of no interest.
const fn is_alarm_of_robot(message: &RobotMessage) -> Option<bool> {
    match message {
        RobotMessage::ImagesAltered(is_refused) | RobotMessage::ImagesOutdated(is_refused) => {
            Some(*is_refused)
        }
        RobotMessage::LifeStill
        | RobotMessage::DrivesFailed(_)
        | RobotMessage::Trouble { .. }
        | RobotMessage::Refused { .. } => Some(true),
        RobotMessage::Executed { .. } => None,
    }
}
