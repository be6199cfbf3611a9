//! What the rig and its nodes say to each other: the startup, runs, questions, the end.

use std::time::Duration;

use ::node::message::{Instruction, Message};
use ::node::report::NodeReport;
use plc_node::process::{PlcInstruction, PlcMessage};
use robot_node::process::{RobotInstruction, RobotMessage};
use tokio::time::timeout;

use super::node::Node;
use super::node_process::NodeEvent;
use super::{Links, Reports, Rig, RigError, Which};

/// How long a connection may take before the rig gives up. A real one takes less than a second.
const CONNECT: Duration = Duration::from_secs(10);

/// How long the arm may take to get to the application's start.
const TO_START: Duration = Duration::from_secs(600);

/// How long a node may take to answer a question or to end, beyond which it counts as hanging.
const ANSWER: Duration = Duration::from_secs(1);

/// What is waited for before a run, and what was heard of it.
#[derive(Debug)]
pub(super) struct Startup<'a> {
    /// The setup that nodes which ran before have to be of.
    setup: Option<&'a str>,
    /// Why the last attempt to connect failed.
    last_attempt: Option<String>,
}

impl<'a> Startup<'a> {
    pub(super) const fn new(setup: Option<&'a str>) -> Self {
        Self { setup, last_attempt: None }
    }

    fn hear(&mut self, said: NodeEvent) {
        if let NodeEvent::Plc(Message::LinkDown { reason }) = said {
            self.last_attempt = Some(reason);
        }
    }
}

impl Rig {
    /// Waits for every node that there is so far to introduce itself, as one of the wanted setup.
    pub(super) async fn meet(&mut self, startup: &mut Startup<'_>) -> Result<(), RigError> {
        let nodes = 1 + usize::from(self.robot.is_some());
        let all_met = async {
            while self.hellos.len() < nodes {
                startup.hear(self.next_event().await?);
            }
            self.check_hellos(startup.setup)
        };
        let met = timeout(CONNECT, all_met).await;
        met.unwrap_or_else(|_| Err(self.not_connected(startup)))
    }

    /// Waits for the PLC to find the robot ready. The arm may still be on its way to the application's start.
    pub(super) async fn wait_until_connected(&mut self, mut startup: Startup<'_>) -> Result<(), RigError> {
        self.meet(&mut startup).await?;
        let connected = async {
            while !self.is_connected() {
                startup.hear(self.next_event().await?);
            }
            Ok(())
        };
        let connected = timeout(CONNECT, connected).await;
        connected.unwrap_or_else(|_| Err(self.not_connected(&startup)))
    }

    /// Waits until the arm stands at the application's start, so that a run may begin at once.
    pub(super) async fn wait_until_at_start(&mut self) -> Result<(), RigError> {
        let at_start = async {
            while !(self.is_connected() && self.links.ready) {
                self.next_event().await?;
            }
            Ok(())
        };
        let at_start = timeout(TO_START, at_start).await;
        at_start.unwrap_or(Err(RigError::NoAnswer { which: Which::Plc, waited: TO_START }))
    }

    /// Whether both nodes are connected, and the robot follows the PLC.
    const fn is_connected(&self) -> bool {
        let Links { plc, robot, ready, moving_to_start } = self.links;
        plc && (robot || self.robot.is_none()) && (ready || moving_to_start)
    }

    fn not_connected(&self, startup: &Startup<'_>) -> RigError {
        let reason = startup.last_attempt.as_deref().unwrap_or("the nodes said nothing of it").to_owned();
        let nodes = [Some(&self.plc), self.robot.as_ref()];
        let last_stderr = nodes.into_iter().flatten().flat_map(Node::last_stderr).collect();
        RigError::NotConnected { waited: CONNECT, reason, last_stderr }
    }

    /// What the PLC says next of its runs. A lost connection and an ended node are errors.
    pub(super) async fn next_plc_message(&mut self) -> Result<PlcMessage, RigError> {
        loop {
            match self.next_event().await? {
                NodeEvent::Plc(Message::Node(message)) => return Ok(message),
                NodeEvent::Plc(Message::LinkDown { reason }) => {
                    return Err(RigError::ConnectionLost { seen_by: Which::Plc, reason });
                }
                NodeEvent::Robot(Message::LinkDown { reason }) => {
                    return Err(RigError::ConnectionLost { seen_by: Which::Robot, reason });
                }
                _ => {}
            }
        }
    }

    /// What either node says next; what concerns the rig itself is taken note of.
    async fn next_event(&mut self) -> Result<NodeEvent, RigError> {
        // Both readers say that their node ended before they let go of the channel.
        let said = loop {
            tokio::select! {
                said = self.said.recv() => break said.unwrap_or(NodeEvent::Ended(Which::Plc)),
                node = self.kills.next() => self.kill(node),
            }
        };
        match &said {
            NodeEvent::Plc(Message::Hello(hello)) => self.hellos.push((Which::Plc, hello.clone())),
            NodeEvent::Robot(Message::Hello(hello)) => self.hellos.push((Which::Robot, hello.clone())),
            NodeEvent::Plc(Message::Report(report) | Message::Farewell { report: Some(report), .. }) => {
                self.reports.plc = report.clone();
            }
            NodeEvent::Robot(Message::Report(report) | Message::Farewell { report: Some(report), .. }) => {
                self.reports.robot = report.clone();
            }
            NodeEvent::Robot(Message::Node(RobotMessage::Executed { motions, quality, .. })) => {
                self.moved.motions = self.moved.motions.saturating_add(*motions);
                self.moved.quality = self.moved.quality.then(*quality);
            }
            NodeEvent::Plc(Message::LinkUp) => self.links.plc = true,
            NodeEvent::Plc(Message::LinkDown { .. }) => {
                self.links = Links { plc: false, ready: false, moving_to_start: false, ..self.links }
            }
            NodeEvent::Robot(Message::LinkUp) => self.links.robot = true,
            NodeEvent::Robot(Message::LinkDown { .. }) => self.links.robot = false,
            NodeEvent::Plc(Message::Node(PlcMessage::MovingToStart)) => {
                self.links = Links { ready: false, moving_to_start: true, ..self.links };
            }
            NodeEvent::Plc(Message::Node(PlcMessage::Ready)) => {
                self.links = Links { ready: true, moving_to_start: false, ..self.links };
            }
            NodeEvent::Plc(Message::Node(PlcMessage::Finished(_))) => {
                self.is_running = false;
                self.links = Links { ready: false, moving_to_start: false, ..self.links };
            }
            NodeEvent::Plc(Message::Node(PlcMessage::Failed { .. })) => {
                self.is_running = false;
                self.links = Links { ready: false, moving_to_start: false, ..self.links };
            }
            NodeEvent::Plc(Message::Busy { controller }) => {
                return Err(RigError::Busy { which: Which::Plc, controller: *controller });
            }
            NodeEvent::Robot(Message::Busy { controller }) => {
                return Err(RigError::Busy { which: Which::Robot, controller: *controller });
            }
            NodeEvent::Ended(which) => {
                return Err(match self.node(*which) {
                    Some(node) => node.end_error().await,
                    None => RigError::NodeEnded { which: *which, status: None, last_stderr: Vec::new() },
                });
            }
            NodeEvent::UnreadableLine { which, line } => {
                return Err(RigError::UnreadableLine { which: *which, line: line.clone() });
            }
            _ => {}
        }
        Ok(said)
    }

    /// The better story of a lost connection or of a failed run: a node that died, or a host that held one up. Neither is
    /// told by whom it happened to, so both are asked.
    pub(super) async fn explained(&mut self, error: RigError) -> RigError {
        if !matches!(error, RigError::ConnectionLost { .. } | RigError::RunFailed { .. }) {
            return error;
        }
        let before = self.reports.clone();
        match self.ask_for_reports().await {
            Ok(()) => match self.held_up_since(&before) {
                (which, held) if held >= self.watchdog / 2 => {
                    RigError::HeldUp { which, held, error: Box::new(error) }
                }
                _ => error,
            },
            Err(better @ (RigError::NodeEnded { .. } | RigError::Detached { .. })) => better,
            Err(RigError::NoAnswer { which, .. }) => {
                // It has had its time; the end of the rig need not wait for it again.
                self.node(which).into_iter().for_each(Node::kill);
                error
            }
            Err(_) => error,
        }
    }

    /// The node whose cycle was latest since those reports, and by how much. A node that sends nothing for the time of the
    /// watchdog, and is there, came late by about as much.
    fn held_up_since(&self, before: &Reports) -> (Which, Duration) {
        let Reports { plc, robot } = self.reports.since(before);
        let latest = |report: &NodeReport| Duration::from_secs_f64(report.cycle.max_us.max(0.0) / 1e6);
        let (plc, robot) = (latest(&plc), latest(&robot));
        if plc >= robot { (Which::Plc, plc) } else { (Which::Robot, robot) }
    }

    /// Waits until the nodes have again the connection that a host took from them by holding one up. Any other error is
    /// there to stay, and comes back.
    pub(super) async fn recovered(&mut self, error: RigError) -> Result<(), RigError> {
        match error {
            RigError::HeldUp { .. } => {
                self.wait_until_connected(Startup::new(None)).await?;
                self.wait_until_at_start().await
            }
            lasting => Err(lasting),
        }
    }

    pub(super) async fn ask_for_reports(&mut self) -> Result<(), RigError> {
        self.tell_plc(&Instruction::Report).await;
        if let Some(robot) = &mut self.robot {
            robot.tell(&Instruction::<RobotInstruction>::Report).await;
        }
        let (mut plc, mut robot) = (false, self.robot.is_none());
        let both = async {
            while !(plc && robot) {
                match self.next_event().await? {
                    NodeEvent::Plc(Message::Report(_)) => plc = true,
                    NodeEvent::Robot(Message::Report(_)) => robot = true,
                    _ => {}
                }
            }
            Ok(())
        };
        let answered = timeout(ANSWER, both).await;
        let which = if plc { Which::Robot } else { Which::Plc };
        answered.unwrap_or(Err(RigError::NoAnswer { which, waited: ANSWER }))
    }

    /// Tells a node to stop and waits until it has, and has been reaped.
    pub(super) async fn end(&mut self, which: Which) -> Result<(), RigError> {
        let Some(node) = self.node(which).filter(|node| !node.has_ended()) else {
            return Ok(());
        };
        node.tell(&Instruction::<()>::Stop).await;
        let end = async {
            loop {
                match self.next_event().await {
                    Ok(_) => {}
                    Err(RigError::NodeEnded { which: ended, status: Some(status), .. })
                        if ended == which && status.success() =>
                    {
                        return Ok(());
                    }
                    Err(error) => return Err(error),
                }
            }
        };
        let ended = timeout(ANSWER, end).await;
        ended.unwrap_or(Err(RigError::NoAnswer { which, waited: ANSWER }))
    }

    pub(super) async fn tell_plc(&mut self, instruction: &Instruction<PlcInstruction>) {
        self.plc.tell(instruction).await;
    }

    const fn node(&mut self, which: Which) -> Option<&mut Node> {
        match which {
            Which::Plc => Some(&mut self.plc),
            Which::Robot => self.robot.as_mut(),
        }
    }
}
