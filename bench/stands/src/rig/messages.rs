//! Messages between the rig and its nodes: startup, runs, reports, end.

use std::time::Duration;

use ::node::message::{Instruction, Message};
use ::node::report::NodeReport;
use ::node::role::NodeRole;
use plc_node::process::{PlcInstruction, PlcMessage};
use robot_node::process::{RobotInstruction, RobotMessage};
use tokio::time::{sleep_until, timeout};

use super::node::Node;
use super::node_process::NodeEvent;
use super::silence::Look;
use super::wanted_cell::WantedCell;
use super::{Links, Reports, Rig, RigError};

/// Longest wait for the nodes to connect. A real connection takes less than a second.
const CONNECT: Duration = Duration::from_secs(10);

/// Time in s for which the PLC may wait for a robot that owes progress between two runs.
const LONGEST_WAIT_S: u32 = 10;

/// Longest wait for a node to answer or to end; after that it counts as hanging.
const ANSWER: Duration = Duration::from_secs(1);

/// What the rig waits for before a run, and what it learned so far.
#[derive(Debug)]
pub(super) struct Startup<'a> {
    /// The cell that already running nodes must have.
    cell: Option<WantedCell<'a>>,
    /// Why the last attempt to connect failed.
    last_attempt: Option<String>,
}

impl<'a> Startup<'a> {
    pub(super) const fn new(cell: Option<WantedCell<'a>>) -> Self {
        Self { cell, last_attempt: None }
    }

    fn note(&mut self, event: NodeEvent) {
        match event {
            NodeEvent::Plc(Message::LinkDown { reason }) => self.last_attempt = Some(reason),
            NodeEvent::Plc(Message::Waiting { reason, .. }) => {
                self.last_attempt = Some(format!("the PLC waits for {reason}"));
            }
            NodeEvent::Plc(Message::Node(message @ (PlcMessage::ImageBad | PlcMessage::ImageGood))) => {
                self.last_attempt = Some(message.to_string());
            }
            _ => {}
        }
    }
}

impl Rig {
    /// Waits until every node so far has sent its first message, and checks its setup.
    pub(super) async fn wait_for_hellos(&mut self, startup: &mut Startup<'_>) -> Result<(), RigError> {
        let nodes = 1 + usize::from(self.robot.is_some());
        let all_hellos = async {
            while self.hellos.len() < nodes {
                startup.note(self.next_event().await?);
            }
            self.check_hellos(startup.cell)
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
            if let NodeEvent::Plc(Message::Waiting { seconds, reason, is_owed: true }) =
                self.next_event().await?
                && seconds >= LONGEST_WAIT_S
            {
                return Err(RigError::NotReady { seconds, reason });
            }
        }
        Ok(())
    }

    /// Returns whether both nodes are connected and the robot follows the PLC.
    const fn is_connected(&self) -> bool {
        let Links { plc, robot, ready, moving_to_start } = self.links;
        plc && (robot || self.robot.is_none()) && (ready || moving_to_start)
    }

    fn not_connected(&self, startup: &Startup<'_>) -> RigError {
        let nodes = self.silence.unanswered(|role| self.is_present(role));
        if !nodes.is_empty() {
            return RigError::Silent { nodes };
        }
        let reason = startup.last_attempt.clone().unwrap_or_else(|| {
            let Links { plc, robot, .. } = self.links;
            let state = |is_up: bool| if is_up { "connected" } else { "not connected" };
            format!("both nodes answer; the PLC is {}, the robot {}", state(plc), state(robot))
        });
        let nodes = [Some(&self.plc), self.robot.as_ref()];
        let last_stderr = nodes.into_iter().flatten().flat_map(Node::last_stderr).collect();
        RigError::NotConnected { waited: CONNECT, reason, last_stderr }
    }

    /// Returns the PLC's next message about its runs. A lost connection and an ended node are errors.
    pub(super) async fn next_plc_message(&mut self) -> Result<PlcMessage, RigError> {
        loop {
            match self.next_event().await? {
                NodeEvent::Plc(Message::Node(message)) => return Ok(message),
                NodeEvent::Plc(Message::LinkDown { reason }) => {
                    return Err(RigError::ConnectionLost { seen_by: NodeRole::Plc, reason });
                }
                NodeEvent::Robot(Message::LinkDown { reason }) => {
                    return Err(RigError::ConnectionLost { seen_by: NodeRole::Robot, reason });
                }
                _ => {}
            }
        }
    }

    /// Returns the next message of either node, and updates the rig's state from it.
    async fn next_event(&mut self) -> Result<NodeEvent, RigError> {
        // Both readers report the end of their node before they close the channel.
        let event = loop {
            tokio::select! {
                biased;
                event = self.events.recv() => break event.unwrap_or(NodeEvent::Ended(NodeRole::Plc)),
                change = self.changes.next() => self.change(change).await,
                () = sleep_until(self.silence.next_look()) => self.look().await?,
            }
        };
        self.hear(&event);
        self.note(&event);
        self.feed_live(&event);
        match self.failure(&event).await {
            Some(error) => Err(error),
            None => Ok(event),
        }
    }

    /// Looks whether a node is silent, and asks one for its report that has sent nothing for some time.
    async fn look(&mut self) -> Result<(), RigError> {
        let present = [NodeRole::Plc, NodeRole::Robot].map(|role| (role, self.is_present(role)));
        let nodes = match self.silence.look(|role| present.contains(&(role, true))) {
            Look::Silent(nodes) => return Err(RigError::Silent { nodes }),
            Look::Ask(nodes) => nodes,
        };
        for role in nodes {
            if let Some(node) = self.node(role) {
                node.send(&Instruction::<()>::Report).await;
                self.awaited[usize::from(role == NodeRole::Robot)] += 1;
            }
        }
        Ok(())
    }

    fn is_present(&self, role: NodeRole) -> bool {
        let node = match role {
            NodeRole::Plc => Some(&self.plc),
            NodeRole::Robot => self.robot.as_ref(),
        };
        node.is_some_and(|node| !node.has_ended()) && !self.killed.contains(&role)
    }

    /// Notes that a node has sent something, and prints what a node waits for.
    fn hear(&mut self, event: &NodeEvent) {
        let (role, news) = match event {
            NodeEvent::Plc(Message::Report(_)) => (NodeRole::Plc, None),
            NodeEvent::Robot(Message::Report(_)) => (NodeRole::Robot, None),
            NodeEvent::Plc(message) => (NodeRole::Plc, Some(message.to_string())),
            NodeEvent::Robot(message) => (NodeRole::Robot, Some(message.to_string())),
            NodeEvent::UnreadableLine { role, line } => (*role, Some(line.clone())),
            NodeEvent::Ended(_) => return,
        };
        let is_for_user = matches!(
            event,
            NodeEvent::Plc(Message::Waiting { .. } | Message::Remark { .. })
                | NodeEvent::Robot(Message::Waiting { .. } | Message::Remark { .. })
        );
        if let (true, Some(voice), Some(news)) = (is_for_user, &self.voice, &news) {
            voice.say(&format!("{role}: {news}"));
        }
        self.silence.hear(role, news.and_then(|news| news.lines().next().map(str::to_owned)));
    }

    /// Updates the rig's state from a message.
    fn note(&mut self, event: &NodeEvent) {
        match event {
            NodeEvent::Plc(Message::Hello(hello)) => self.hellos.push((NodeRole::Plc, hello.clone())),
            NodeEvent::Robot(Message::Hello(hello)) => self.hellos.push((NodeRole::Robot, hello.clone())),
            NodeEvent::Plc(Message::Report(report)) => self.take_report(NodeRole::Plc, report),
            NodeEvent::Robot(Message::Report(report)) => self.take_report(NodeRole::Robot, report),
            NodeEvent::Plc(Message::Farewell { report: Some(report), .. }) => {
                report.clone_into(&mut self.reports.plc);
            }
            NodeEvent::Robot(Message::Farewell { report: Some(report), .. }) => {
                report.clone_into(&mut self.reports.robot);
            }
            NodeEvent::Robot(Message::Node(RobotMessage::Executed {
                number,
                motions,
                quality,
                account,
                ..
            })) => self.told.add(*number, *motions, *quality, *account),
            NodeEvent::Plc(Message::Node(PlcMessage::Started { after, .. })) => self.told.begin_after(*after),
            NodeEvent::Plc(Message::Remark { text }) if !self.remarks.contains(text) => {
                self.remarks.push(text.clone());
            }
            NodeEvent::Plc(Message::LinkUp) => self.links.plc = true,
            NodeEvent::Plc(Message::LinkDown { .. }) => {
                self.links = Links { plc: false, ready: false, moving_to_start: false, ..self.links };
            }
            NodeEvent::Robot(Message::LinkUp) => self.links.robot = true,
            NodeEvent::Robot(Message::LinkDown { .. }) => self.links.robot = false,
            NodeEvent::Plc(Message::Node(PlcMessage::MovingToStart)) => {
                self.links = Links { ready: false, moving_to_start: true, ..self.links };
            }
            NodeEvent::Plc(Message::Node(PlcMessage::Ready)) => {
                self.links = Links { ready: true, moving_to_start: false, ..self.links };
            }
            NodeEvent::Plc(Message::Node(PlcMessage::Finished(_) | PlcMessage::Failed { .. })) => {
                self.is_running = false;
                self.links = Links { ready: false, moving_to_start: false, ..self.links };
            }
            _ => {}
        }
    }

    /// Returns the error that a message of a node reports, or that its end is.
    async fn failure(&mut self, event: &NodeEvent) -> Option<RigError> {
        let role = match event {
            NodeEvent::Robot(_) => NodeRole::Robot,
            NodeEvent::Plc(_) => NodeRole::Plc,
            NodeEvent::Ended(role) | NodeEvent::UnreadableLine { role, .. } => *role,
        };
        match event {
            NodeEvent::Plc(Message::Busy { controller }) | NodeEvent::Robot(Message::Busy { controller }) => {
                Some(RigError::Busy { role, controller: *controller })
            }
            NodeEvent::Plc(Message::Denied { reason }) | NodeEvent::Robot(Message::Denied { reason }) => {
                Some(RigError::Denied { role, reason: reason.clone() })
            }
            NodeEvent::Ended(_) if self.killed.contains(&role) => {
                // Its end is noticed once, as that of every node.
                if let Some(node) = self.node(role) {
                    let _ = node.end_error().await;
                }
                Some(RigError::KilledByFault { role })
            }
            NodeEvent::Ended(_) => Some(match self.node(role) {
                Some(node) => node.end_error().await,
                None => RigError::NodeEnded { role, status: None, last_stderr: Vec::new() },
            }),
            NodeEvent::UnreadableLine { line, .. } => {
                Some(RigError::UnreadableLine { role, line: line.clone() })
            }
            NodeEvent::Plc(_) | NodeEvent::Robot(_) => None,
        }
    }

    /// Finds the cause of a lost connection or of a failed run: a node that died, or a host that stalled one. The
    /// affected node cannot report either, so both nodes are asked.
    pub(super) async fn with_cause(&mut self, error: RigError) -> RigError {
        if let RigError::Silent { nodes } = &error {
            // They have had their time to answer, so the rig does not wait for them again when they end.
            for role in nodes.iter().map(|node| node.role).collect::<Vec<_>>() {
                self.node(role).into_iter().for_each(Node::kill);
            }
        }
        if !matches!(error, RigError::ConnectionLost { .. } | RigError::RunFailed { .. }) {
            return error;
        }
        let before = self.before_run.clone();
        match self.ask_for_reports().await {
            Ok(()) => match self.held_up_since(&before) {
                (role, held) if held >= self.watchdog / 2 => {
                    RigError::HeldUp { role, held, error: Box::new(error) }
                }
                _ => error,
            },
            Err(
                better @ (RigError::NodeEnded { .. }
                | RigError::KilledByFault { .. }
                | RigError::Detached { .. }),
            ) => better,
            Err(RigError::NoAnswer { role, .. }) => {
                // It has already had its time to answer, so the rig does not wait for it again when it ends.
                self.node(role).into_iter().for_each(Node::kill);
                error
            }
            Err(_) => error,
        }
    }

    /// Returns the node whose cycle was latest since those reports, and by how much. A running node that sends
    /// nothing during the watchdog time was late by about that time.
    fn held_up_since(&self, before: &Reports) -> (NodeRole, Duration) {
        let Reports { plc, robot } = self.reports.since(before);
        let latest = |report: &NodeReport| Duration::from_secs_f64(report.cycle.max_us.max(0.0) / 1e6);
        let (plc, robot) = (latest(&plc), latest(&robot));
        if plc >= robot { (NodeRole::Plc, plc) } else { (NodeRole::Robot, robot) }
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

    pub(super) async fn ask_for_reports(&mut self) -> Result<(), RigError> {
        self.request_reports().await;
        let both = async {
            while self.awaited != [0; 2] {
                self.next_event().await?;
            }
            Ok(())
        };
        let answered = timeout(ANSWER, both).await;
        let role = if self.awaited[0] == 0 { NodeRole::Robot } else { NodeRole::Plc };
        answered.unwrap_or(Err(RigError::NoAnswer { role, waited: ANSWER }))
    }

    /// Asks both nodes for a report without waiting for it.
    pub(super) async fn request_reports(&mut self) {
        self.tell_plc(&Instruction::Report).await;
        self.awaited[0] += 1;
        if let Some(robot) = &mut self.robot {
            robot.send(&Instruction::<RobotInstruction>::Report).await;
            self.awaited[1] += 1;
        }
    }

    fn take_report(&mut self, role: NodeRole, report: &NodeReport) {
        let index = usize::from(role == NodeRole::Robot);
        self.awaited[index] = self.awaited[index].saturating_sub(1);
        if self.first_reports.earlier[index] > 0 {
            self.first_reports.earlier[index] -= 1;
        } else if std::mem::take(&mut self.first_reports.is_awaited[index]) {
            report.clone_into(self.first_reports.with.of(role));
        }
        report.clone_into(self.reports.of(role));
    }

    /// Tells a node to stop and waits until it has ended and was reaped.
    pub(super) async fn end(&mut self, role: NodeRole) -> Result<(), RigError> {
        let Some(node) = self.node(role).filter(|node| !node.has_ended()) else {
            return Ok(());
        };
        node.send(&Instruction::<()>::Stop).await;
        let end = async {
            loop {
                match self.next_event().await {
                    Ok(_) => {}
                    Err(RigError::NodeEnded { role: ended, status: Some(status), .. })
                        if ended == role && status.success() =>
                    {
                        return Ok(());
                    }
                    Err(error) => return Err(error),
                }
            }
        };
        let ended = timeout(ANSWER, end).await;
        ended.unwrap_or(Err(RigError::NoAnswer { role, waited: ANSWER }))
    }

    pub(super) async fn tell_plc(&mut self, instruction: &Instruction<PlcInstruction>) {
        self.plc.send(instruction).await;
    }

    const fn node(&mut self, role: NodeRole) -> Option<&mut Node> {
        match role {
            NodeRole::Plc => Some(&mut self.plc),
            NodeRole::Robot => self.robot.as_mut(),
        }
    }
}
