//! The rig: both nodes as processes of their own, on a cable between two networks that the rig makes.
//!
//! ```text
//!            bench (tokio, one thread)
//!   pipes ┌──────────┴──────────┐ pipes
//!   plc-node   plc0 ══ veth ══ robot0   robot-node
//!   └ network namespace ┘   └ network namespace ┘
//! ```
//!
//! The nodes are this same program, started again: nothing else has to be built or installed. The namespaces are
//! unnamed and the nodes die with the bench, so nothing is left behind however any of them ends. Both nodes have a
//! process group of their own, so that Ctrl-C reaches only the bench, which ends them in order. An ordinary user gets
//! all this through a user namespace, see [`enter_user_namespace`].
//!
//! Alternatively both nodes already run somewhere, and the rig only controls them over TCP: [`Rig::attach`].
//!
//! Here tokio serves pipes, connections, processes and timeouts. The cyclic threads run in the other processes, without
//! tokio.

mod attach;
mod attached_node;
mod cable;
mod changes;
mod config;
mod error;
mod executions;
mod frames;
mod live_feed;
mod messages;
mod node;
mod node_process;
mod reports;
mod silence;
mod stand;
mod wanted_cell;

pub use config::RigConfig;
pub use error::RigError;
pub use frames::FrameLog;
pub use reports::Reports;
pub use silence::SilentNode;

use std::io;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use ::node::message::{Hello, Instruction, Message};
use ::node::role::NodeRole;
use plc_node::process::{PlcInstruction, PlcMessage};
use protocol_linux::{Interface, OpenPort, PortError};
use robot_node::process::{RobotInstruction, RobotMessage};
use tokio::sync::mpsc;
use tokio::time::Instant;

use self::node::Node;
use cable::{Cable, CableOptions};
use changes::Changes;
use messages::Startup;
use node_process::{NodeEvent, NodeProcess};
use reports::FirstReports;
use silence::Silence;

use crate::Stand as _;
use records::conditions::{Health, ToldSkills};
use records::faults::{self, Change, FaultReport};
use records::feed::Feed;
use records::trace::{Window, tables};
use records::voice::Voice;

/// This program is also both nodes; with a counting allocator it can show that their cyclic threads allocate nothing.
#[global_allocator]
static ALLOCATOR: protocol_linux::allocation::AllocationCounter =
    protocol_linux::allocation::AllocationCounter;

/// First arguments that make this program a node; no option of the bench begins like that.
const PLC_NODE: &str = "__plc-node";
const ROBOT_NODE: &str = "__robot-node";

/// Runs a node if this process was started as one. Call it first in `main`.
#[must_use]
pub fn run_as_node() -> Option<ExitCode> {
    let mut args = std::env::args_os().skip(1);
    let first = args.next()?;
    let main = match first.to_str()? {
        PLC_NODE => plc_node::command_line::main,
        ROBOT_NODE => robot_node::process::main,
        _ => return None,
    };
    Some(main(std::iter::once(first).chain(args).collect::<Vec<_>>()))
}

/// Makes this process root of a new user namespace, so that it may create networks; does nothing if it already may.
/// Call it while the process has one thread: before tokio or any other thread starts.
pub fn enter_user_namespace() -> Result<(), RigError> {
    Ok(protocol_linux::namespace::enter_user_namespace()?)
}

/// Tests what the rig needs from the host and leaves nothing behind: a cable between two networks, and on it the
/// sockets of all buses; EtherCAT needs one of PROFINET's kind.
///
/// # Errors
///
/// The outer error: the cable cannot be created. The inner error: its sockets cannot be opened.
pub fn try_cable() -> Result<Result<(), PortError>, RigError> {
    let cable = Cable::set_up(CableOptions::default())?;
    let open = || {
        let interface = Interface::open(cable::PLC)?;
        let profinet = OpenPort::open_all(&interface, profinet::PORTS);
        let ports = profinet.and_then(|_| OpenPort::open_all(&interface, ethernet_ip::PORTS));
        Ok::<_, RigError>(ports.map(drop))
    };
    cable.plc().run(open)?
}

/// Both connected nodes.
#[derive(Debug)]
pub struct Rig {
    plc: Node,
    /// `None` if the robot is not one of our nodes.
    robot: Option<Node>,
    events: mpsc::Receiver<NodeEvent>,
    hellos: Vec<(NodeRole, Hello)>,
    reports: Reports,
    /// The nodes' reports from before this rig.
    before: Reports,
    /// The nodes' reports from before the current run.
    before_run: Reports,
    /// The nodes' reports at the start of the current run.
    first_reports: FirstReports,
    /// How long each node has sent nothing.
    silence: Silence,
    /// What the PLC found remarkable about the connection.
    remarks: Vec<String>,
    /// Prints lines beside the progress; `None` where nobody reads them.
    voice: Option<Voice>,
    /// Reports asked for and not received: PLC, robot.
    awaited: [u32; 2],
    /// What the robot node told of its skills in the current run, or in the last one.
    told: ToldSkills,
    traced: Vec<Window>,
    recording: bool,
    /// Whether a run was started whose end or failure was not reported yet.
    is_running: bool,
    links: Links,
    /// Watchdog time of the connection.
    watchdog: Duration,
    /// Why repetitions were run again.
    repeated: Vec<String>,
    /// Changes of the nodes that faults will make.
    changes: Changes,
    /// Nodes that a fault has killed.
    killed: Vec<NodeRole>,
    /// `None` if the nodes already ran.
    connected_after: Option<Duration>,
    /// Where the nodes write their recorded cycles; `None` if they do not.
    trace_directory: Option<PathBuf>,
    /// Log of the frames while cycles are recorded.
    frames: Option<FrameLog>,
    /// The live view; `None` if there is none.
    feed: Option<Feed>,
    /// Whether the nodes write all their cycles, and not only those of recorded runs.
    writes_all: bool,
    /// The last field, so that it is dropped after the nodes; `None` if the rig did not create it.
    cable: Option<Cable>,
}

impl Rig {
    /// Creates the cable, starts both nodes and waits until the PLC finds the robot ready.
    ///
    /// # Errors
    ///
    /// The host does not allow something, a node does not start, or the nodes do not connect.
    pub async fn start(config: &RigConfig) -> Result<Self, RigError> {
        let started = Instant::now();
        let RigConfig { capture, faults, seed, frames: frames_log, .. } = config;
        let (capture, frames) = (capture.as_ref(), frames_log.as_ref());
        let cable = Cable::set_up(CableOptions { capture, faults, seed: *seed, frames })?;
        // Room for all messages of two nodes while the bench writes a file.
        let (sender, events) = mpsc::channel(1_024);
        let program = config.program.clone().unwrap_or_else(|| PathBuf::from("/proc/self/exe"));
        let robot_args = [
            config.args(cable::ROBOT, tables::ROBOT_ROWS),
            vec!["--seed".into(), config.seed.to_string().into()],
        ]
        .concat();
        let robot = NodeProcess::spawn(
            NodeRole::Robot,
            &program,
            ROBOT_NODE,
            robot_args,
            cable.robot(),
            sender.clone(),
        )?;
        let plc = NodeProcess::spawn(
            NodeRole::Plc,
            &program,
            PLC_NODE,
            config.args(cable::PLC, tables::PLC_ROWS),
            cable.plc(),
            sender,
        )?;
        let mut rig =
            Self::of(Node::Process(plc), Some(Node::Process(robot)), events, Some(cable), config.watchdog);
        rig.feed.clone_from(&config.feed);
        rig.voice.clone_from(&config.voice);
        rig.wait_until_connected(Startup::new(None)).await?;
        rig.connected_after = Some(started.elapsed());
        rig.wait_until_at_start().await?;
        rig.changes = Changes::from_now(faults);
        if let Some(cable) = &mut rig.cable {
            cable.set_ready();
        }
        rig.trace_directory.clone_from(&config.trace);
        rig.frames.clone_from(frames_log);
        if config.writes_all && config.trace.is_some() {
            rig.writes_all = true;
            rig.set_tracing(true).await;
        }
        Ok(rig)
    }

    fn of(
        plc: Node,
        robot: Option<Node>,
        events: mpsc::Receiver<NodeEvent>,
        cable: Option<Cable>,
        watchdog: Duration,
    ) -> Self {
        Self {
            plc,
            robot,
            events,
            hellos: Vec::new(),
            reports: Reports::default(),
            before: Reports::default(),
            before_run: Reports::default(),
            first_reports: FirstReports::default(),
            silence: Silence::from_now(),
            remarks: Vec::new(),
            voice: None,
            awaited: [0; 2],
            told: ToldSkills::default(),
            traced: Vec::new(),
            recording: false,
            trace_directory: None,
            frames: None,
            feed: None,
            writes_all: false,
            is_running: false,
            links: Links::default(),
            watchdog,
            repeated: Vec::new(),
            changes: Changes::default(),
            killed: Vec::new(),
            connected_after: None,
            cable,
        }
    }

    /// Returns what the host refused the nodes, each once.
    pub fn warnings(&self) -> Vec<&str> {
        let mut warnings: Vec<_> =
            self.hellos.iter().filter_map(|(_, hello)| hello.warning.as_deref()).collect();
        warnings.dedup();
        warnings
    }

    /// Returns both nodes' reports after the last run, without what was before this rig.
    #[must_use]
    pub fn reports(&self) -> Reports {
        self.reports.since(&self.before)
    }

    /// Pauses the captures, or continues them.
    ///
    /// # Errors
    ///
    /// The kernel's error; the captures then go on as before.
    pub fn pause_capture(&self, paused: bool) -> io::Result<()> {
        self.cable.as_ref().map_or(Ok(()), |cable| cable.pause_capture(paused))
    }

    /// Starts or stops recording the cycles of the next runs, and the frames if configured.
    ///
    /// # Errors
    ///
    /// The host does not let the rig listen to its own interfaces.
    pub async fn record(&mut self, on: bool) -> Result<(), RigError> {
        if self.trace_directory.is_some() && self.recording != on {
            self.recording = on;
            if let Some(cable) = &mut self.cable {
                cable.watch(on)?;
            }
            if !self.writes_all {
                self.set_tracing(on).await;
            }
        }
        Ok(())
    }

    /// Tells the nodes to write their cycles, or to stop that.
    async fn set_tracing(&mut self, on: bool) {
        self.plc.send(&Instruction::<PlcInstruction>::Record(on)).await;
        if let Some(robot) = &mut self.robot {
            robot.send(&Instruction::<RobotInstruction>::Record(on)).await;
        }
    }

    /// Returns the result of the faults so far; `None` without faults.
    fn fault_report(&self) -> Option<FaultReport> {
        self.cable.as_ref().and_then(Cable::fault_report)
    }

    /// Makes a change that a fault asks for. The cable makes its own.
    async fn change(&mut self, change: Change) {
        match change {
            Change::Kill(role) => self.kill(role),
            Change::Drive(axis, disturbance) => {
                if let Some(robot) = &mut self.robot {
                    robot.send(&Instruction::Node(RobotInstruction::Disturb { axis, disturbance })).await;
                }
            }
            // A restart is for virtual time, and the options refuse it here.
            Change::Cut | Change::Mend | Change::Restart(_) => {}
        }
    }

    fn kill(&mut self, role: NodeRole) {
        self.killed.push(role);
        let node = match role {
            NodeRole::Plc => Some(&mut self.plc),
            NodeRole::Robot => self.robot.as_mut(),
        };
        if let Some(cable) = &self.cable {
            cable.note_killed(faults::end_of(role));
        }
        if let Some(node) = node {
            node.kill();
        }
    }

    /// Returns the times of the recorded runs.
    #[must_use]
    pub fn traced(&self) -> &[Window] {
        &self.traced
    }

    /// Discards captures that are held in memory.
    pub fn discard_capture(&mut self) {
        if let Some(cable) = &mut self.cable {
            cable.discard_capture();
        }
    }

    /// Returns the process numbers of the PLC's and of the robot's node, while they run.
    #[must_use]
    pub fn processes(&self) -> [Option<u32>; 2] {
        [self.plc.id(), self.robot.as_ref().and_then(Node::id)]
    }

    /// Closes the connection in order, ends both nodes, then the captures, and returns the conditions up to then.
    /// Nodes that already ran keep running.
    ///
    /// # Errors
    ///
    /// A node did not end by itself and was killed, or the capture could not be written. Nothing is left behind in
    /// either case.
    pub async fn stop(mut self) -> Result<Health, RigError> {
        let Some(mut cable) = self.cable.take() else {
            if !self.plc.has_ended() && !self.robot.as_ref().is_some_and(Node::has_ended) {
                self.ask_for_reports().await?;
            }
            return Ok(self.health());
        };
        // The controller first: it releases the connection, so the device sees an orderly end.
        let plc = self.end(NodeRole::Plc).await;
        let robot = self.end(NodeRole::Robot).await;
        let faults = cable.end_capture();
        // A node's error comes first: it explains the effect on a capture.
        plc.and(robot)?;
        Ok(Health { faults: faults?, ..self.health() })
    }
}

/// The nodes' last messages about their connection.
#[derive(Clone, Copy, Debug, Default)]
struct Links {
    plc: bool,
    robot: bool,
    /// The PLC found the robot ready, and the arm is at the start.
    ready: bool,
    /// The PLC found the robot ready, and moves the arm to the start.
    moving_to_start: bool,
}

/// A message of a PLC's process.
type FromPlc = Message<PlcMessage>;
/// A message of a robot's process.
type FromRobot = Message<RobotMessage>;
