//! The rig: both nodes as processes of their own, on a cable between two networks that the rig makes.
//!
//! ```text
//!            bench (tokio, one thread)
//!   pipes ┌──────────┴──────────┐ pipes
//!   plc-node   plc0 ══ veth ══ robot0   robot-node
//!   └ network namespace ┘   └ network namespace ┘
//! ```
//!
//! The nodes are this very program, started again: nothing else has to be built or installed. The namespaces have no
//! name and the nodes die with the bench, so nothing is left behind however any of them ends; both nodes are in
//! process groups of their own, so that Ctrl-C reaches the bench alone and the bench ends them in order. An ordinary
//! user gets all this through a user namespace, see [`enter_user_namespace`].
//!
//! Or both nodes run already, wherever that is, and the rig only speaks with them, over TCP: [`Rig::attach`].
//!
//! tokio serves pipes, connections, processes and timeouts here. The cyclic threads are in the other processes and know
//! nothing of it.

mod attached;
mod cable;
mod error;
mod frames;
mod kills;
mod node;
mod party;
mod stand;

pub use attached::{Attach, AttachError};
pub use error::{RigError, Which};
pub use frames::FrameLog;

use std::ffi::OsString;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use plc_node::ExecutionType;
use plc_node::process::{FinishedRun, PlcInstruction, PlcMessage};
use protocol::virtual_time::Side;
use protocol_linux::capture::Keep;
use protocol_linux::message::{Hello, Instruction, Message};
use protocol_linux::report::NodeReport;
use protocol_linux::{Interface, PortError, Wire};
use robot_node::Quality;
use robot_node::process::{RobotInstruction, RobotMessage};
use setup::Cyclic;
use tokio::sync::mpsc;
use tokio::time::{Instant, timeout, timeout_at};

use cable::{Cable, Fittings};
use kills::Kills;
use node::{NodeProcess, Said};
use party::Party;

use crate::faults::{Fault, FaultReport};
use crate::trace::{self, Window};

/// This program is also both nodes; an allocator that counts shows that their cyclic threads allocate nothing.
#[global_allocator]
static ALLOCATOR: protocol_linux::allocation::AllocationCounter =
    protocol_linux::allocation::AllocationCounter;

/// First arguments with which this program is a node; no option of the bench begins like that.
const PLC_NODE: &str = "__plc-node";
const ROBOT_NODE: &str = "__robot-node";

/// How long a connection may take before the rig gives up. A real one takes less than a second.
const CONNECT: Duration = Duration::from_secs(10);

/// How long a node may take to answer a question or to end, beyond which it counts as hanging.
const ANSWER: Duration = Duration::from_secs(1);

/// How long after the first bad news the rig waits for news that explain it: a lost connection is often a dead node.
const EXPLANATION: Duration = Duration::from_millis(300);

/// The longest run; a PLC gives up a silent robot long before.
const LONGEST_RUN: Duration = Duration::from_secs(3_600);

/// Runs a node if this process was started as one. Call it first in `main`.
#[must_use]
pub fn run_as_node() -> Option<ExitCode> {
    let mut args = std::env::args_os().skip(1);
    let first = args.next()?;
    let main = match first.to_str()? {
        PLC_NODE => plc_node::process::main,
        ROBOT_NODE => robot_node::process::main,
        _ => return None,
    };
    Some(main(std::iter::once(first).chain(args).collect::<Vec<_>>()))
}

/// Makes this process root of a user namespace of its own, so that it may make networks; does nothing where it may
/// already. Call it while the process has one thread: before tokio starts, and before any other thread.
pub fn enter_user_namespace() -> Result<(), RigError> {
    Ok(protocol_linux::namespace::enter_user_namespace()?)
}

/// Tries what the rig needs of the host and leaves nothing behind: a cable between two networks, and on it the sockets
/// of both buses.
///
/// # Errors
///
/// The outer one says why there is no cable, the inner one why there are no sockets on it.
pub fn try_cable() -> Result<Result<(), PortError>, RigError> {
    let cable = Cable::lay(Fittings::default())?;
    let open = || {
        let interface = Interface::open(cable::PLC)?;
        let ports = Wire::profinet(&interface).and_then(|_| Wire::ethernet_ip(&interface));
        Ok::<_, RigError>(ports.map(drop))
    };
    cable.plc().run(open)?
}

/// What the rig is to run.
#[derive(Clone, Debug)]
pub struct RigConfig {
    /// A built-in setup's name, or the path of a file.
    pub setup: OsString,
    /// How PROFINET's cyclic frames travel, instead of what the setup says.
    pub cyclic: Option<Cyclic>,
    /// Seed of the robot's interpreter.
    pub seed: u64,
    /// Records what passes both interfaces into this directory, from before the first frame, and how much of it.
    pub capture: Option<(PathBuf, Keep)>,
    /// Where each node writes its recorded cycles, in this directory; they record while [`Rig::record`] asks for it.
    pub trace: Option<PathBuf>,
    /// Takes up what passes both interfaces while cycles are recorded.
    pub frames: Option<FrameLog>,
    /// Faults of the cable and of the nodes; `seed` decides which frames they hit.
    pub faults: Vec<Fault>,
    /// The program that both nodes are; none for this one.
    pub program: Option<PathBuf>,
    /// Exchange images without a protocol, for tests that are not about a bus.
    pub direct: bool,
}

impl RigConfig {
    /// A rig of this setup with nothing special about it.
    pub fn new(setup: impl Into<OsString>) -> Self {
        Self {
            setup: setup.into(),
            cyclic: None,
            seed: 1,
            capture: None,
            trace: None,
            frames: None,
            faults: Vec::new(),
            program: None,
            direct: false,
        }
    }

    fn args(&self, interface: &str, rows: &str) -> Vec<OsString> {
        let mut args: Vec<OsString> = ["run", "--json", "--interface", interface].map(OsString::from).into();
        args.extend(["--setup".into(), self.setup.clone()]);
        if let Some(cyclic) = self.cyclic {
            let name = match cyclic {
                Cyclic::Udp => "udp",
                Cyclic::Rt1 => "rt1",
            };
            args.extend(["--cyclic".into(), name.into()]);
        }
        if let Some(directory) = &self.trace {
            args.extend(["--trace-file".into(), directory.join(rows).into()]);
        }
        if self.direct {
            args.push("--direct".into());
        }
        args
    }
}

/// Both nodes, connected.
#[derive(Debug)]
pub struct Rig {
    plc: Party,
    /// None where the robot is no node of ours.
    robot: Option<Party>,
    said: mpsc::Receiver<Said>,
    hellos: Vec<Hello>,
    reports: Reports,
    /// What the nodes had done before this rig.
    before: Reports,
    /// In the present run, or in the last one.
    moved: Moved,
    traced: Vec<Window>,
    recording: bool,
    is_traced: bool,
    kills: Kills,
    /// None where the nodes ran already.
    connected_after: Option<Duration>,
    /// Last, so that it outlives the nodes; none where somebody else laid it.
    cable: Option<Cable>,
}

/// What both nodes reported of themselves last.
#[derive(Clone, PartialEq, Default, Debug)]
pub struct Reports {
    /// The PLC's.
    pub plc: NodeReport,
    /// The robot's; empty where the robot is no node of ours.
    pub robot: NodeReport,
}

impl Reports {
    fn since(&self, before: &Self) -> Self {
        Self { plc: self.plc.since(&before.plc), robot: self.robot.since(&before.robot) }
    }
}

impl Rig {
    /// Lays the cable, starts both nodes and waits until the PLC finds the robot ready.
    ///
    /// # Errors
    ///
    /// What the host does not allow, a node that does not start, or a connection that does not come about.
    pub async fn start(config: &RigConfig) -> Result<Self, RigError> {
        let started = Instant::now();
        let RigConfig { capture, faults, seed, frames, .. } = config;
        let (capture, frames) = (capture.as_ref(), frames.as_ref());
        let cable = Cable::lay(Fittings { capture, faults, seed: *seed, frames })?;
        // Room for all that two nodes say while the bench writes a file.
        let (sayings, said) = mpsc::channel(1_024);
        let program = config.program.clone().unwrap_or_else(|| PathBuf::from("/proc/self/exe"));
        let robot_args = [
            config.args(cable::ROBOT, trace::ROBOT_ROWS),
            vec!["--seed".into(), config.seed.to_string().into()],
        ]
        .concat();
        let robot = NodeProcess::spawn(
            Which::Robot,
            &program,
            ROBOT_NODE,
            robot_args,
            cable.robot(),
            sayings.clone(),
        )?;
        let plc = NodeProcess::spawn(
            Which::Plc,
            &program,
            PLC_NODE,
            config.args(cable::PLC, trace::PLC_ROWS),
            cable.plc(),
            sayings,
        )?;
        let mut rig = Self::of(Party::Process(plc), Some(Party::Process(robot)), said, Some(cable));
        rig.wait_until_ready(started, None).await?;
        rig.connected_after = Some(started.elapsed());
        rig.kills = Kills::from_now(faults);
        if let Some(cable) = &rig.cable {
            cable.set_ready();
        }
        rig.is_traced = config.trace.is_some();
        Ok(rig)
    }

    fn of(plc: Party, robot: Option<Party>, said: mpsc::Receiver<Said>, cable: Option<Cable>) -> Self {
        Self {
            plc,
            robot,
            said,
            hellos: Vec::new(),
            reports: Reports::default(),
            before: Reports::default(),
            moved: Moved::default(),
            traced: Vec::new(),
            recording: false,
            is_traced: false,
            kills: Kills::default(),
            connected_after: None,
            cable,
        }
    }

    /// From the start of the nodes until the PLC found the robot ready; none where they ran already.
    #[must_use]
    pub const fn connected_after(&self) -> Option<Duration> {
        self.connected_after
    }

    /// What the host did not grant the nodes, in words, each once.
    pub fn warnings(&self) -> Vec<&str> {
        let mut warnings: Vec<_> = self.hellos.iter().filter_map(|hello| hello.warning.as_deref()).collect();
        warnings.dedup();
        warnings
    }

    /// What both nodes reported of themselves last, after the last run, without what was before this rig.
    #[must_use]
    pub fn reports(&self) -> Reports {
        self.reports.since(&self.before)
    }

    /// Lets frames pass without capturing them, or captures them again.
    pub fn pause_capture(&self, paused: bool) {
        if let Some(cable) = &self.cable {
            cable.pause_capture(paused);
        }
    }

    /// Records the cycles of the runs to come, and the frames where they are wanted, or no more.
    ///
    /// # Errors
    ///
    /// The host does not let the rig listen to its own interfaces.
    pub async fn record(&mut self, on: bool) -> Result<(), RigError> {
        if self.is_traced && self.recording != on {
            self.recording = on;
            if let Some(cable) = &mut self.cable {
                cable.watch(on)?;
            }
            self.plc.tell(&Instruction::<PlcInstruction>::Record(on)).await;
            if let Some(robot) = &mut self.robot {
                robot.tell(&Instruction::<RobotInstruction>::Record(on)).await;
            }
        }
        Ok(())
    }

    /// What came of the faults so far; none where none were asked for.
    #[must_use]
    pub fn fault_report(&self) -> Option<FaultReport> {
        self.cable.as_ref().and_then(Cable::fault_report)
    }

    fn kill(&mut self, side: Side) {
        let node = match side {
            Side::A => Some(&mut self.plc),
            Side::B => self.robot.as_mut(),
        };
        if let Some(cable) = &self.cable {
            cable.note_killed(side);
        }
        if let Some(node) = node {
            node.kill();
        }
    }

    /// When the recorded runs were.
    #[must_use]
    pub fn traced(&self) -> &[Window] {
        &self.traced
    }

    /// The captures are not wanted: where they are in memory, they are not written.
    pub fn discard_capture(&mut self) {
        if let Some(cable) = &mut self.cable {
            cable.discard_capture();
        }
    }

    /// Process numbers of the PLC's and of the robot's node, while they run.
    #[must_use]
    pub fn processes(&self) -> [Option<u32>; 2] {
        [self.plc.id(), self.robot.as_ref().and_then(Party::id)]
    }

    /// Runs the sequence once.
    ///
    /// # Errors
    ///
    /// The run failed, the connection was lost, or a node ended: within two seconds of it.
    pub async fn execute(&mut self, execution_type: ExecutionType) -> Result<FinishedRun, RigError> {
        self.moved = Moved::default();
        self.tell_plc(&Instruction::Node(PlcInstruction::Start { execution_type })).await;
        let finished = async {
            loop {
                match self.next_plc_message().await? {
                    PlcMessage::Finished(run) => return Ok(run),
                    PlcMessage::Failed { execution_type, reason } => {
                        return Err(RigError::RunFailed { execution_type, reason });
                    }
                    PlcMessage::Started { execution_type, at_ns } if self.recording => {
                        self.traced.push(Window { of: execution_type, start_ns: at_ns, length_ns: None });
                    }
                    PlcMessage::Ready | PlcMessage::Started { .. } => {}
                }
            }
        };
        let result = match timeout(LONGEST_RUN, finished).await {
            Ok(result) => result,
            Err(_) => Err(RigError::NoAnswer { which: Which::Plc, waited: LONGEST_RUN }),
        };
        let run = match result {
            Ok(run) => run,
            Err(error) => return Err(self.explained(error).await),
        };
        if self.recording
            && let Some(window) = self.traced.last_mut()
        {
            window.length_ns = Some(run.execution_time_ns);
        }
        self.ask_for_reports().await?;
        Ok(run)
    }

    /// How well the arm moved in the last run, of so many motions; none if the robot did not speak of all of them.
    #[must_use]
    pub fn quality_of(&self, motions: u32) -> Option<Quality> {
        (self.moved.motions == motions).then_some(self.moved.quality)
    }

    /// Ends the connection in order, then both nodes, then the capture. Nodes that ran before the rig run on.
    ///
    /// # Errors
    ///
    /// A node that did not end by itself was killed, or the capture could not be written. Nothing is left behind
    /// then either.
    pub async fn stop(mut self) -> Result<Reports, RigError> {
        let Some(mut cable) = self.cable.take() else {
            if !self.plc.has_ended() && !self.robot.as_ref().is_some_and(Party::has_ended) {
                self.ask_for_reports().await?;
            }
            return Ok(self.reports());
        };
        // The controller goes first: it releases the connection, and the device sees it go in order.
        let plc = self.end(Which::Plc).await;
        let robot = self.end(Which::Robot).await;
        cable.end_capture()?;
        plc.and(robot).map(|()| self.reports())
    }

    /// Waits for every node to introduce itself, as one that runs `setup` where that is given, and for the PLC to find
    /// the robot ready.
    async fn wait_until_ready(&mut self, started: Instant, setup: Option<&str>) -> Result<(), RigError> {
        let nodes = 1 + usize::from(self.robot.is_some());
        let mut last = None;
        let ready = async {
            let mut robot_ready = false;
            while !robot_ready || self.hellos.len() < nodes {
                match self.next_saying().await? {
                    Said::Plc(Message::Hello(hello)) => self.check(Which::Plc, &hello, setup)?,
                    Said::Robot(Message::Hello(hello)) => self.check(Which::Robot, &hello, setup)?,
                    Said::Plc(Message::Node(PlcMessage::Ready)) => robot_ready = true,
                    // Before the connection is up, the PLC says so of each attempt that fails.
                    Said::Plc(Message::LinkDown { reason }) => last = Some(reason),
                    _ => {}
                }
            }
            Ok::<_, RigError>(())
        };
        let ready = timeout_at(started + CONNECT, ready).await;
        match ready {
            Ok(result) => result?,
            Err(_) => {
                let reason = last.unwrap_or_else(|| "the nodes said nothing of it".to_owned());
                let nodes = [Some(&self.plc), self.robot.as_ref()];
                let last_words = nodes.into_iter().flatten().flat_map(Party::last_words).collect();
                return Err(RigError::NotConnected { waited: CONNECT, reason, last_words });
            }
        }
        Ok(())
    }

    /// What the PLC says next of its runs. A lost connection and an ended node are errors.
    async fn next_plc_message(&mut self) -> Result<PlcMessage, RigError> {
        loop {
            match self.next_saying().await? {
                Said::Plc(Message::Node(message)) => return Ok(message),
                Said::Plc(Message::LinkDown { reason }) => {
                    return Err(RigError::ConnectionLost { seen_by: Which::Plc, reason });
                }
                Said::Robot(Message::LinkDown { reason }) => {
                    return Err(RigError::ConnectionLost { seen_by: Which::Robot, reason });
                }
                _ => {}
            }
        }
    }

    /// What either node says next; what concerns the rig itself is taken note of.
    async fn next_saying(&mut self) -> Result<Said, RigError> {
        // Both readers say that their node ended before they let go of the channel.
        let said = loop {
            tokio::select! {
                said = self.said.recv() => break said.unwrap_or(Said::Ended(Which::Plc)),
                node = self.kills.next() => self.kill(node),
            }
        };
        match &said {
            Said::Plc(Message::Hello(hello)) | Said::Robot(Message::Hello(hello)) => {
                self.hellos.push(hello.clone());
            }
            Said::Plc(Message::Report(report) | Message::Farewell { report: Some(report), .. }) => {
                self.reports.plc = report.clone();
            }
            Said::Robot(Message::Report(report) | Message::Farewell { report: Some(report), .. }) => {
                self.reports.robot = report.clone();
            }
            Said::Robot(Message::Node(RobotMessage::Executed { motions, quality, .. })) => {
                self.moved.motions = self.moved.motions.saturating_add(*motions);
                self.moved.quality = self.moved.quality.then(*quality);
            }
            Said::Plc(Message::Busy { controller }) => {
                return Err(RigError::Busy { which: Which::Plc, controller: *controller });
            }
            Said::Robot(Message::Busy { controller }) => {
                return Err(RigError::Busy { which: Which::Robot, controller: *controller });
            }
            Said::Ended(which) => {
                return Err(match self.node(*which) {
                    Some(node) => node.obituary().await,
                    None => RigError::NodeEnded { which: *which, status: None, last_words: Vec::new() },
                });
            }
            Said::Gibberish { which, line } => {
                return Err(RigError::Gibberish { which: *which, line: line.clone() });
            }
            _ => {}
        }
        Ok(said)
    }

    /// A lost connection is often the work of a node that died: if that is so, the node's end is the better story.
    async fn explained(&mut self, error: RigError) -> RigError {
        if !matches!(error, RigError::ConnectionLost { .. } | RigError::RunFailed { .. }) {
            return error;
        }
        let end = async {
            loop {
                if let Err(better @ (RigError::NodeEnded { .. } | RigError::Detached { .. })) =
                    self.next_saying().await
                {
                    return better;
                }
            }
        };
        timeout(EXPLANATION, end).await.unwrap_or(error)
    }

    async fn ask_for_reports(&mut self) -> Result<(), RigError> {
        self.tell_plc(&Instruction::Report).await;
        if let Some(robot) = &mut self.robot {
            robot.tell(&Instruction::<RobotInstruction>::Report).await;
        }
        let (mut plc, mut robot) = (false, self.robot.is_none());
        let both = async {
            while !(plc && robot) {
                match self.next_saying().await? {
                    Said::Plc(Message::Report(_)) => plc = true,
                    Said::Robot(Message::Report(_)) => robot = true,
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
    async fn end(&mut self, which: Which) -> Result<(), RigError> {
        let Some(node) = self.node(which).filter(|node| !node.has_ended()) else {
            return Ok(());
        };
        node.tell(&Instruction::<()>::Stop).await;
        let end = async {
            loop {
                match self.next_saying().await {
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

    async fn tell_plc(&mut self, instruction: &Instruction<PlcInstruction>) {
        self.plc.tell(instruction).await;
    }

    const fn node(&mut self, which: Which) -> Option<&mut Party> {
        match which {
            Which::Plc => Some(&mut self.plc),
            Which::Robot => self.robot.as_mut(),
        }
    }
}

/// What the robot said of its motions in a run.
#[derive(Clone, Copy, Debug, Default)]
struct Moved {
    motions: u32,
    quality: Quality,
}

/// What a PLC's process says.
type PlcSaying = Message<PlcMessage>;
/// What a robot's process says.
type RobotSaying = Message<RobotMessage>;
