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
//! tokio serves pipes, processes and timeouts here. The cyclic threads are in the other processes and know nothing of
//! it.

mod cable;
mod error;
mod node;
mod stand;

pub use error::{RigError, Which};

use std::ffi::OsString;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use plc_node::ExecutionType;
use plc_node::process::{FinishedRun, PlcInstruction, PlcMessage};
use protocol_linux::message::{Hello, Instruction, Message};
use protocol_linux::report::NodeReport;
use robot_node::Quality;
use robot_node::process::{RobotInstruction, RobotMessage};
use setup::Cyclic;
use tokio::sync::mpsc;
use tokio::time::{Instant, timeout, timeout_at};

use cable::Cable;
use node::{NodeProcess, Said};

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

/// What the rig is to run.
#[derive(Clone, Debug)]
pub struct RigConfig {
    /// A built-in setup's name, or the path of a file.
    pub setup: OsString,
    /// How PROFINET's cyclic frames travel, instead of what the setup says.
    pub cyclic: Option<Cyclic>,
    /// Seed of the robot's interpreter.
    pub seed: u64,
    /// Records what passes the PLC's interface into this file, from before the first frame.
    pub capture: Option<PathBuf>,
    /// The program that both nodes are; none for this one.
    pub program: Option<PathBuf>,
    /// Exchange images without a protocol, for tests that are not about a bus.
    pub direct: bool,
}

impl RigConfig {
    /// A rig of this setup with nothing special about it.
    pub fn new(setup: impl Into<OsString>) -> Self {
        Self { setup: setup.into(), cyclic: None, seed: 1, capture: None, program: None, direct: false }
    }

    fn args(&self, interface: &str) -> Vec<OsString> {
        let mut args: Vec<OsString> = ["run", "--json", "--interface", interface].map(OsString::from).into();
        args.extend(["--setup".into(), self.setup.clone()]);
        if let Some(cyclic) = self.cyclic {
            let name = match cyclic {
                Cyclic::Udp => "udp",
                Cyclic::Rt1 => "rt1",
            };
            args.extend(["--cyclic".into(), name.into()]);
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
    plc: NodeProcess,
    robot: NodeProcess,
    said: mpsc::Receiver<Said>,
    hellos: Vec<Hello>,
    reports: Reports,
    connected_after: Duration,
    /// In the present run, or in the last one.
    moved: Moved,
    /// Last, so that it outlives the nodes.
    cable: Cable,
}

/// What both nodes reported of themselves last.
#[derive(Clone, PartialEq, Default, Debug)]
pub struct Reports {
    /// The PLC's.
    pub plc: NodeReport,
    /// The robot's.
    pub robot: NodeReport,
}

impl Rig {
    /// Lays the cable, starts both nodes and waits until the PLC finds the robot ready.
    ///
    /// # Errors
    ///
    /// What the host does not allow, a node that does not start, or a connection that does not come about.
    pub async fn start(config: &RigConfig) -> Result<Self, RigError> {
        let started = Instant::now();
        let cable = Cable::lay(config.capture.as_deref())?;
        // Room for all that two nodes say while the bench writes a file.
        let (sayings, said) = mpsc::channel(1_024);
        let program = config.program.clone().unwrap_or_else(|| PathBuf::from("/proc/self/exe"));
        let robot_args =
            [config.args(cable::ROBOT), vec!["--seed".into(), config.seed.to_string().into()]].concat();
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
            config.args(cable::PLC),
            cable.plc(),
            sayings,
        )?;
        let mut rig = Self {
            plc,
            robot,
            said,
            hellos: Vec::new(),
            reports: Reports::default(),
            connected_after: Duration::ZERO,
            moved: Moved::default(),
            cable,
        };
        rig.wait_until_ready(started).await?;
        Ok(rig)
    }

    /// From the start of the nodes until the PLC found the robot ready.
    #[must_use]
    pub const fn connected_after(&self) -> Duration {
        self.connected_after
    }

    /// What the host did not grant the nodes, in words, each once.
    pub fn warnings(&self) -> Vec<&str> {
        let mut warnings: Vec<_> = self.hellos.iter().filter_map(|hello| hello.warning.as_deref()).collect();
        warnings.dedup();
        warnings
    }

    /// What both nodes reported of themselves last: after the last run.
    #[must_use]
    pub const fn reports(&self) -> &Reports {
        &self.reports
    }

    /// Process numbers of the PLC's and of the robot's node, while they run.
    #[must_use]
    pub fn processes(&self) -> [Option<u32>; 2] {
        [self.plc.id(), self.robot.id()]
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
        self.ask_for_reports().await?;
        Ok(run)
    }

    /// How well the arm moved in the last run, of so many motions; none if the robot did not speak of all of them.
    #[must_use]
    pub fn quality_of(&self, motions: u32) -> Option<Quality> {
        (self.moved.motions == motions).then_some(self.moved.quality)
    }

    /// Ends the connection in order, then both nodes, then the capture.
    ///
    /// # Errors
    ///
    /// A node that did not end by itself was killed, or the capture could not be written. Nothing is left behind
    /// then either.
    pub async fn stop(mut self) -> Result<Reports, RigError> {
        // The controller goes first: it releases the connection, and the device sees it go in order.
        let plc = self.end(Which::Plc).await;
        let robot = self.end(Which::Robot).await;
        self.cable.end_capture()?;
        plc.and(robot).map(|()| self.reports.clone())
    }

    async fn wait_until_ready(&mut self, started: Instant) -> Result<(), RigError> {
        let mut last = None;
        let ready = async {
            loop {
                match self.next_saying().await? {
                    Said::Plc(Message::Node(PlcMessage::Ready)) => return Ok::<_, RigError>(()),
                    // Before the connection is up, the PLC says so of each attempt that fails.
                    Said::Plc(Message::LinkDown { reason }) => last = Some(reason),
                    _ => {}
                }
            }
        };
        let ready = timeout_at(started + CONNECT, ready).await;
        match ready {
            Ok(result) => result?,
            Err(_) => {
                let reason = last.unwrap_or_else(|| "the nodes said nothing of it".to_owned());
                let last_words = [self.plc.last_words(), self.robot.last_words()].concat();
                return Err(RigError::NotConnected { waited: CONNECT, reason, last_words });
            }
        }
        self.connected_after = started.elapsed();
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
        let said = self.said.recv().await.unwrap_or(Said::Ended(Which::Plc));
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
            Said::Ended(which) => return Err(self.node(*which).obituary().await),
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
                if let Err(better @ RigError::NodeEnded { .. }) = self.next_saying().await {
                    return better;
                }
            }
        };
        timeout(EXPLANATION, end).await.unwrap_or(error)
    }

    async fn ask_for_reports(&mut self) -> Result<(), RigError> {
        self.tell_plc(&Instruction::Report).await;
        self.robot.tell(&Instruction::<RobotInstruction>::Report).await;
        let (mut plc, mut robot) = (false, false);
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
        if self.node(which).has_ended() {
            return Ok(());
        }
        self.node(which).tell(&Instruction::<()>::Stop).await;
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

    const fn node(&mut self, which: Which) -> &mut NodeProcess {
        match which {
            Which::Plc => &mut self.plc,
            Which::Robot => &mut self.robot,
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
