//! Messages between the rig and its nodes: startup, runs, reports, end.

use std::time::Duration;

use ::node::message::{Instruction, Message};
use ::node::report::NodeReport;
use plc_node::process::{PlcInstruction, PlcMessage};
use robot_node::process::RobotMessage;
use tokio::time::{sleep_until, timeout};

use super::node::Node;
use super::node_process::NodeEvent;
use super::rig_node::RigNode;
use super::robot::RigRobot;
use super::silence::Look;
use super::wanted_cell::WantedCells;
use super::{Links, Reports, Rig, RigError};

/// Longest wait for the nodes to connect. A real connection takes less than a second.
const CONNECT: Duration = Duration::from_secs(10);

/// Time in s for which the PLC may wait for a robot that owes progress between two runs.
const LONGEST_WAIT_S: u32 = 10;

/// Longest wait for a node to answer or to end; after that it counts as hanging.
pub(super) const ANSWER: Duration = Duration::from_secs(1);

/// What the rig waits for before a run, and what it learned so far.
#[derive(Debug)]
pub(super) struct Startup<'a> {
    /// The cell that already running nodes must have.
    cell: Option<WantedCells<'a>>,
    /// Why the last attempt to connect failed.
    last_attempt: Option<String>,
}

impl<'a> Startup<'a> {
    pub(super) const fn new(cell: Option<WantedCells<'a>>) -> Self {
        Self { cell, last_attempt: None }
    }

    fn note(&mut self, event: NodeEvent) {
        let NodeEvent::Plc(station, message) = event else { return };
        let reason = match message {
            Message::LinkDown { reason } => reason,
            Message::Waiting { reason, .. } => format!("the PLC waits for {reason}"),
            Message::Node(message @ (PlcMessage::ImageBad | PlcMessage::ImageGood)) => message.to_string(),
            _ => return,
        };
        self.last_attempt = Some(match station {
            Some(station) => format!("station {station}: {reason}"),
            None => reason,
        });
    }
}

impl Rig {
    /// Waits until every node so far has sent its first message, and checks its setup.
    pub(super) async fn wait_for_hellos(&mut self, startup: &mut Startup<'_>) -> Result<(), RigError> {
        let nodes = 1 + self.robots.iter().filter(|robot| robot.node.is_some()).count();
        let all_hellos = async {
            while self.hellos.len() < nodes {
                startup.note(self.next_event().await?);
            }
            self.check_hellos(startup.cell.as_ref())
        };
        let result = timeout(CONNECT, all_hellos).await;
        result.unwrap_or_else(|_| Err(self.not_connected(startup)))
    }

    /// Waits until the PLC finds the robot ready. The arm may still be moving to the application's start.
    pub(super) async fn wait_until_connected(&mut self, mut startup: Startup<'_>) -> Result<(), RigError> {
        self.wait_for_hellos(&mut startup).await?;
        let connected = async {
            while !self.is_connected() {
                startup.note(self.next_event().await?);
            }
            Ok(())
        };
        let connected = timeout(CONNECT, connected).await;
        connected.unwrap_or_else(|_| Err(self.not_connected(&startup)))
    }

    /// Waits until the arm is at the application's start, so that a run can begin at once. It may take as long as it likes
    /// there, but a PLC that only waits is an error.
    pub(super) async fn wait_until_at_start(&mut self) -> Result<(), RigError> {
        while !(self.is_connected() && self.links.ready) {
            if let NodeEvent::Plc(station, Message::Waiting { seconds, reason, is_owed: true }) =
                self.next_event().await?
                && seconds >= LONGEST_WAIT_S
            {
                return Err(RigError::NotReady { station, seconds, reason });
            }
        }
        Ok(())
    }

    /// Returns whether all nodes are connected and the robots follow the PLC.
    fn is_connected(&self) -> bool {
        let Links { ready, moving_to_start } = self.links;
        self.robots.iter().all(RigRobot::is_connected) && (ready || moving_to_start)
    }

    fn not_connected(&self, startup: &Startup<'_>) -> RigError {
        let nodes = self.silence.unanswered(|node| self.is_present(node));
        if !nodes.is_empty() {
            return RigError::Silent { nodes };
        }
        let reason = startup.last_attempt.clone().unwrap_or_else(|| {
            let state = |is_up: bool| if is_up { "connected" } else { "not connected" };
            let of_robot = |robot: &RigRobot| {
                let station = robot.station.as_ref().map_or_else(String::new, |name| format!(" of {name}"));
                format!("the PLC is {}, the robot{station} {}", state(robot.is_up_by_plc), state(robot.is_up))
            };
            let robots: Vec<_> = self.robots.iter().filter(|robot| !robot.is_connected()).collect();
            let robots = if robots.is_empty() { self.robots.iter().collect() } else { robots };
            let states = robots.into_iter().map(of_robot).collect::<Vec<_>>().join("; ");
            let all = if self.robots.len() == 1 { "both" } else { "all" };
            format!("{all} nodes answer; {states}")
        });
        let nodes =
            std::iter::once(&self.plc).chain(self.robots.iter().filter_map(|robot| robot.node.as_ref()));
        let last_stderr = nodes.flat_map(Node::last_stderr).collect();
        RigError::NotConnected { waited: CONNECT, reason, last_stderr }
    }

    /// Returns the PLC's next message about its runs, and the station that it is about. A lost connection and an ended node are
    /// errors; in a run of several stations the PLC decides what becomes of it, and the end of a robot is its reason.
    pub(super) async fn next_plc_message(&mut self) -> Result<(Option<String>, PlcMessage), RigError> {
        let is_one = self.robots.len() == 1;
        loop {
            match self.next_event().await? {
                NodeEvent::Plc(station, Message::Node(message)) => return Ok((station, message)),
                NodeEvent::Plc(_, Message::LinkDown { reason }) if is_one => {
                    return Err(RigError::ConnectionLost { seen_by: self.name(RigNode::Plc), reason });
                }
                NodeEvent::Robot(station, Message::LinkDown { reason }) if is_one => {
                    let seen_by = self.name(RigNode::Robot(station));
                    return Err(RigError::ConnectionLost { seen_by, reason });
                }
                _ => {}
            }
        }
    }

    /// Returns the next message of either node, and updates the rig's state from it.
    pub(super) async fn next_event(&mut self) -> Result<NodeEvent, RigError> {
        loop {
            // All readers report the end of their node before they close the channel.
            let event = loop {
                tokio::select! {
                    biased;
                    event = self.events.recv() => break event.unwrap_or(NodeEvent::Ended(RigNode::Plc)),
                    (station, change) = self.changes.next() => self.change(station, change).await,
                    () = sleep_until(self.silence.next_look()) => self.look().await?,
                }
            };
            self.hear(&event);
            self.note(&event);
            self.feed_live(&event);
            match self.failure(&event).await {
                // The PLC sees it too, and says what becomes of the others.
                Some(error) if self.is_running && self.robots.len() > 1 && event.is_end_of_robot() => {
                    self.lost.get_or_insert(error);
                }
                Some(error) => return Err(error),
                None => return Ok(event),
            }
        }
    }

    /// Looks whether a node is silent, and asks one for its report that has sent nothing for some time.
    async fn look(&mut self) -> Result<(), RigError> {
        let present: Vec<_> = self.nodes().filter(|node| self.is_present(*node)).collect();
        let nodes = match self.silence.look(|node| present.contains(&node)) {
            Look::Silent(nodes) => return Err(RigError::Silent { nodes }),
            Look::Ask(nodes) => nodes,
        };
        for id in nodes {
            if let Some(node) = self.node(id) {
                node.send(&Instruction::<()>::Report).await;
                self.await_report(id);
            }
        }
        Ok(())
    }

    fn is_present(&self, id: RigNode) -> bool {
        let node = match id {
            RigNode::Plc => Some(&self.plc),
            RigNode::Robot(station) => self.robots.get(station).and_then(|robot| robot.node.as_ref()),
        };
        node.is_some_and(|node| !node.has_ended()) && !self.killed.contains(&id)
    }

    /// Notes that a node has sent something, and prints what a node waits for.
    fn hear(&mut self, event: &NodeEvent) {
        let (id, news) = match event {
            NodeEvent::Plc(_, Message::Report(_)) => (RigNode::Plc, None),
            NodeEvent::Robot(station, Message::Report(_)) => (RigNode::Robot(*station), None),
            NodeEvent::Plc(None, message) => (RigNode::Plc, Some(message.to_string())),
            NodeEvent::Plc(Some(station), message) => (RigNode::Plc, Some(format!("{station}: {message}"))),
            NodeEvent::Robot(station, message) => (RigNode::Robot(*station), Some(message.to_string())),
            NodeEvent::UnreadableLine { node, line } => (*node, Some(line.clone())),
            NodeEvent::OtherProtocol { .. } | NodeEvent::Ended(_) => return,
        };
        let name = self.name(id).to_string();
        let is_for_user = match event {
            NodeEvent::Plc(_, Message::Remark { .. }) | NodeEvent::Robot(_, Message::Remark { .. }) => true,
            NodeEvent::Plc(station, Message::Waiting { seconds, reason, .. }) => {
                let who = format!("{name} {}", station.as_deref().unwrap_or_default());
                self.wait_lines.is_due(Some(&who), *seconds, reason)
            }
            NodeEvent::Robot(_, Message::Waiting { seconds, reason, .. }) => {
                self.wait_lines.is_due(Some(&name), *seconds, reason)
            }
            _ => false,
        };
        if let (true, Some(voice), Some(news)) = (is_for_user, &self.voice, &news) {
            voice.say(&format!("{name}: {news}"));
        }
        self.silence.hear(id, news.and_then(|news| news.lines().next().map(str::to_owned)));
    }

    /// Updates the rig's state from a message.
    fn note(&mut self, event: &NodeEvent) {
        match event {
            NodeEvent::Plc(_, Message::Hello(hello)) => self.hellos.push((RigNode::Plc, hello.clone())),
            NodeEvent::Robot(station, Message::Hello(hello)) => {
                self.hellos.push((RigNode::Robot(*station), hello.clone()));
            }
            NodeEvent::Plc(_, Message::Report(report)) => self.take_report(RigNode::Plc, report),
            NodeEvent::Robot(station, Message::Report(report)) => {
                self.take_report(RigNode::Robot(*station), report);
            }
            NodeEvent::Plc(_, Message::Farewell { report: Some(report), .. }) => {
                self.reports.take(RigNode::Plc, report);
            }
            NodeEvent::Robot(station, Message::Farewell { report: Some(report), .. }) => {
                self.reports.take(RigNode::Robot(*station), report);
            }
            NodeEvent::Robot(
                station,
                Message::Node(RobotMessage::Executed { number, motions, began_ns, quality, account, .. }),
            ) => {
                if let Some(robot) = self.robots.get_mut(*station) {
                    robot.skills.add(*number, *motions, *began_ns, *quality, *account);
                }
            }
            NodeEvent::Robot(station, message @ (Message::LinkUp | Message::LinkDown { .. })) => {
                if let Some(robot) = self.robots.get_mut(*station) {
                    robot.is_up = *message == Message::LinkUp;
                }
            }
            NodeEvent::Plc(station, message) => self.note_of_plc(station.as_deref(), message),
            NodeEvent::Ended(RigNode::Robot(station)) => {
                self.network.iter().for_each(|network| network.power_off(*station));
            }
            _ => {}
        }
    }

    /// Updates the rig's state from a message of the PLC about a station, or about all.
    fn note_of_plc(&mut self, station: Option<&str>, message: &Message<PlcMessage>) {
        let is_one = self.robots.len() == 1;
        let concerned = self.robots.iter_mut();
        let concerned = concerned.filter(|it| station.is_none() || it.station.as_deref() == station);
        match message {
            Message::Remark { text } => {
                let remark = station.map_or_else(|| text.clone(), |station| format!("{station}: {text}"));
                if !self.remarks.contains(&remark) {
                    self.remarks.push(remark);
                }
            }
            Message::Identity { text } => concerned.for_each(|robot| robot.identity = Some(text.clone())),
            Message::LinkUp => concerned.for_each(|robot| robot.is_up_by_plc = true),
            Message::LinkDown { .. } => {
                concerned.for_each(|robot| robot.is_up_by_plc = false);
                self.links = Links::default();
            }
            // Of several stations, each has numbers of its own.
            Message::Node(PlcMessage::Started { after, .. }) if is_one => {
                concerned.for_each(|robot| robot.skills.begin_after(*after));
            }
            Message::Node(PlcMessage::MovingToStart) => {
                self.links = Links { ready: false, moving_to_start: true };
            }
            Message::Node(PlcMessage::Ready) => {
                self.links = Links { ready: true, moving_to_start: false };
            }
            Message::Node(PlcMessage::Passed { mark, came_ns, passed_ns }) => {
                concerned.for_each(|robot| robot.pass(*mark, *came_ns, *passed_ns));
            }
            Message::Node(PlcMessage::Finished(run)) => {
                concerned.for_each(|robot| robot.finish(*run));
                self.is_running = !self.robots.iter().all(|robot| robot.finished.is_some());
                self.links = Links::default();
            }
            Message::Node(PlcMessage::Failed { .. }) => {
                self.is_running = false;
                self.links = Links::default();
            }
            _ => {}
        }
    }

    /// Returns the error that a message of a node reports, or that its end is.
    async fn failure(&mut self, event: &NodeEvent) -> Option<RigError> {
        let id = match event {
            NodeEvent::Robot(station, _) => RigNode::Robot(*station),
            NodeEvent::Plc(..) => RigNode::Plc,
            NodeEvent::Ended(node)
            | NodeEvent::UnreadableLine { node, .. }
            | NodeEvent::OtherProtocol { node, .. } => *node,
        };
        let name = || self.name(id);
        match event {
            NodeEvent::Plc(_, Message::Busy { controller })
            | NodeEvent::Robot(_, Message::Busy { controller }) => {
                Some(RigError::Busy { node: name(), controller: *controller })
            }
            NodeEvent::Plc(_, Message::Denied { reason })
            | NodeEvent::Robot(_, Message::Denied { reason }) => {
                Some(RigError::Denied { node: name(), reason: reason.clone() })
            }
            NodeEvent::Ended(_) if self.killed.contains(&id) => {
                let killed = RigError::KilledByFault { node: name() };
                // Its end is noticed once, as that of every node.
                if let Some(node) = self.node(id) {
                    let _ = node.end_error().await;
                }
                Some(killed)
            }
            NodeEvent::Ended(_) => {
                let ended = RigError::NodeEnded { node: name(), status: None, last_stderr: Vec::new() };
                Some(match self.node(id) {
                    Some(node) => node.end_error().await,
                    None => ended,
                })
            }
            NodeEvent::UnreadableLine { line, .. } => {
                Some(RigError::UnreadableLine { node: name(), line: line.clone() })
            }
            NodeEvent::OtherProtocol { protocol, .. } => {
                Some(RigError::OtherProtocol { node: name(), protocol: *protocol })
            }
            NodeEvent::Plc(..) | NodeEvent::Robot(..) => None,
        }
    }

    /// Finds the cause of a lost connection or of a failed run: a node that died, or a host that stalled one. The
    /// affected node cannot report either, so both nodes are asked.
    pub(super) async fn with_cause(&mut self, error: RigError) -> RigError {
        if let RigError::Silent { nodes } = &error {
            // They have had their time to answer, so the rig does not wait for them again when they end.
            let silent: Vec<_> =
                self.nodes().filter(|id| nodes.iter().any(|it| it.node == self.name(*id))).collect();
            silent.into_iter().for_each(|id| self.kill_node(id));
        }
        if !matches!(error, RigError::ConnectionLost { .. } | RigError::RunFailed { .. }) {
            return error;
        }
        if let Some(lost) = self.lost.take() {
            return lost;
        }
        let before = self.before_run.clone();
        match self.ask_for_reports().await {
            Ok(()) => match self.held_up_since(&before) {
                (id, held) if held >= self.watchdog / 2 => {
                    RigError::HeldUp { node: self.name(id), held, error: Box::new(error) }
                }
                _ => error,
            },
            Err(
                better @ (RigError::NodeEnded { .. }
                | RigError::KilledByFault { .. }
                | RigError::Detached { .. }),
            ) => better,
            Err(RigError::NoAnswer { node, .. }) => {
                // It has already had its time to answer, so the rig does not wait for it again when it ends.
                let silent = self.nodes().find(|id| self.name(*id) == node);
                silent.into_iter().for_each(|id| self.kill_node(id));
                error
            }
            Err(_) => error,
        }
    }

    /// Returns the node whose cycle was latest since those reports, and by how much. A running node that sends
    /// nothing during the watchdog time was late by about that time.
    fn held_up_since(&self, before: &Reports) -> (RigNode, Duration) {
        let Reports { plc, robots } = self.reports.since(before);
        let latest = |report: &NodeReport| Duration::from_secs_f64(report.cycle.max_us.max(0.0) / 1e6);
        let mut latest_of_all = (RigNode::Plc, latest(&plc));
        for (station, robot) in robots.iter().enumerate() {
            if latest(robot) > latest_of_all.1 {
                latest_of_all = (RigNode::Robot(station), latest(robot));
            }
        }
        latest_of_all
    }

    /// Waits until the nodes have reconnected after the host stalled one. Returns any other error, since it is
    /// permanent.
    pub(super) async fn reconnect_after(&mut self, error: RigError) -> Result<(), RigError> {
        match error {
            RigError::HeldUp { .. } => {
                self.wait_until_connected(Startup::new(None)).await?;
                self.wait_until_at_start().await
            }
            lasting => Err(lasting),
        }
    }

    /// Tells a node to stop and waits until it has ended and was reaped.
    pub(super) async fn end(&mut self, id: RigNode) -> Result<(), RigError> {
        let name = self.name(id);
        let Some(node) = self.node(id).filter(|node| !node.has_ended()) else {
            return Ok(());
        };
        node.send(&Instruction::<()>::Stop).await;
        let end = async {
            loop {
                match self.next_event().await {
                    Ok(_) => {}
                    Err(RigError::NodeEnded { node: ended, status: Some(status), .. })
                        if ended == name && status.success() =>
                    {
                        return Ok(());
                    }
                    Err(error) => return Err(error),
                }
            }
        };
        let ended = timeout(ANSWER, end).await;
        ended.unwrap_or(Err(RigError::NoAnswer { node: name, waited: ANSWER }))
    }

    pub(super) async fn tell_plc(&mut self, instruction: &Instruction<PlcInstruction>) {
        self.plc.send(instruction).await;
    }

    fn kill_node(&mut self, id: RigNode) {
        self.node(id).into_iter().for_each(Node::kill);
    }
}
