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

mod attach;
mod attached_node;
mod cable;
mod config;
mod error;
mod executions;
mod frames;
mod kills;
mod messages;
mod node;
mod node_process;
mod stand;

pub use attach::{Attach, AttachError};
pub use config::RigConfig;
pub use error::{RigError, Which};
pub use frames::FrameLog;

use std::io;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use ::node::message::{Hello, Instruction, Message};
use ::node::report::NodeReport;
use plc_node::process::{PlcInstruction, PlcMessage};
use protocol_linux::{Interface, OpenPort, PortError};
use robot_node::process::{RobotInstruction, RobotMessage};
use tokio::sync::mpsc;
use tokio::time::Instant;
use virtual_time::Side;

use self::node::Node;
use cable::{Cable, Fittings};
use executions::ExecutedMotions;
use kills::Kills;
use messages::Startup;
use node_process::{NodeEvent, NodeProcess};

use crate::records::conditions::Health;
use crate::records::faults::FaultReport;
use crate::records::trace::{Window, tables};
use crate::stands::Stand as _;

/// This program is also both nodes; an allocator that counts shows that their cyclic threads allocate nothing.
#[global_allocator]
static ALLOCATOR: protocol_linux::allocation::AllocationCounter =
    protocol_linux::allocation::AllocationCounter;

/// First arguments with which this program is a node; no option of the bench begins like that.
const PLC_NODE: &str = "__plc-node";
const ROBOT_NODE: &str = "__robot-node";

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
        let profinet = OpenPort::open_all(&interface, profinet::PORTS);
        let ports = profinet.and_then(|_| OpenPort::open_all(&interface, ethernet_ip::PORTS));
        Ok::<_, RigError>(ports.map(drop))
    };
    cable.plc().run(open)?
}

/// Both nodes, connected.
#[derive(Debug)]
pub struct Rig {
    plc: Node,
    /// None where the robot is no node of ours.
    robot: Option<Node>,
    said: mpsc::Receiver<NodeEvent>,
    hellos: Vec<(Which, Hello)>,
    reports: Reports,
    /// What the nodes had done before this rig.
    before: Reports,
    /// In the present run, or in the last one.
    moved: ExecutedMotions,
    traced: Vec<Window>,
    recording: bool,
    /// A run was started, and neither its end nor its failure was heard of.
    is_running: bool,
    links: Links,
    /// How long the connection bears no frame.
    watchdog: Duration,
    /// Why repetitions were run again.
    repeated: Vec<String>,
    kills: Kills,
    /// None where the nodes ran already.
    connected_after: Option<Duration>,
    /// Where the nodes write their recorded cycles; none where they do not.
    trace_directory: Option<PathBuf>,
    /// Takes up the frames while cycles are recorded.
    frames: Option<FrameLog>,
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
        let RigConfig { capture, faults, seed, frames: frames_log, .. } = config;
        let (capture, frames) = (capture.as_ref(), frames_log.as_ref());
        let cable = Cable::lay(Fittings { capture, faults, seed: *seed, frames })?;
        // Room for all that two nodes say while the bench writes a file.
        let (events, said) = mpsc::channel(1_024);
        let program = config.program.clone().unwrap_or_else(|| PathBuf::from("/proc/self/exe"));
        let robot_args = [
            config.args(cable::ROBOT, tables::ROBOT_ROWS),
            vec!["--seed".into(), config.seed.to_string().into()],
        ]
        .concat();
        let robot = NodeProcess::spawn(
            Which::Robot,
            &program,
            ROBOT_NODE,
            robot_args,
            cable.robot(),
            events.clone(),
        )?;
        let plc = NodeProcess::spawn(
            Which::Plc,
            &program,
            PLC_NODE,
            config.args(cable::PLC, tables::PLC_ROWS),
            cable.plc(),
            events,
        )?;
        let mut rig =
            Self::of(Node::Process(plc), Some(Node::Process(robot)), said, Some(cable), config.watchdog);
        rig.wait_until_connected(Startup::new(None)).await?;
        rig.connected_after = Some(started.elapsed());
        rig.wait_until_at_start().await?;
        rig.kills = Kills::from_now(faults);
        if let Some(cable) = &rig.cable {
            cable.set_ready();
        }
        rig.trace_directory.clone_from(&config.trace);
        rig.frames.clone_from(frames_log);
        Ok(rig)
    }

    fn of(
        plc: Node,
        robot: Option<Node>,
        said: mpsc::Receiver<NodeEvent>,
        cable: Option<Cable>,
        watchdog: Duration,
    ) -> Self {
        Self {
            plc,
            robot,
            said,
            hellos: Vec::new(),
            reports: Reports::default(),
            before: Reports::default(),
            moved: ExecutedMotions::default(),
            traced: Vec::new(),
            recording: false,
            trace_directory: None,
            frames: None,
            is_running: false,
            links: Links::default(),
            watchdog,
            repeated: Vec::new(),
            kills: Kills::default(),
            connected_after: None,
            cable,
        }
    }

    /// What the host did not grant the nodes, in words, each once.
    pub fn warnings(&self) -> Vec<&str> {
        let mut warnings: Vec<_> =
            self.hellos.iter().filter_map(|(_, hello)| hello.warning.as_deref()).collect();
        warnings.dedup();
        warnings
    }

    /// What both nodes reported of themselves last, after the last run, without what was before this rig.
    #[must_use]
    pub fn reports(&self) -> Reports {
        self.reports.since(&self.before)
    }

    /// Lets frames pass without capturing them, or captures them again.
    ///
    /// # Errors
    ///
    /// What the kernel says; it goes on as before then.
    pub fn pause_capture(&self, paused: bool) -> io::Result<()> {
        self.cable.as_ref().map_or(Ok(()), |cable| cable.pause_capture(paused))
    }

    /// Records the cycles of the runs to come, and the frames where they are wanted, or no more.
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
            self.plc.tell(&Instruction::<PlcInstruction>::Record(on)).await;
            if let Some(robot) = &mut self.robot {
                robot.tell(&Instruction::<RobotInstruction>::Record(on)).await;
            }
        }
        Ok(())
    }

    /// What came of the faults so far; none where none were asked for.
    fn fault_report(&self) -> Option<FaultReport> {
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
        [self.plc.id(), self.robot.as_ref().and_then(Node::id)]
    }

    /// Ends the connection in order, then both nodes, then the capture, and says how it went until then. Nodes that ran
    /// before the rig run on.
    ///
    /// # Errors
    ///
    /// A node that did not end by itself was killed, or the capture could not be written. Nothing is left behind
    /// then either.
    pub async fn stop(mut self) -> Result<Health, RigError> {
        let Some(mut cable) = self.cable.take() else {
            if !self.plc.has_ended() && !self.robot.as_ref().is_some_and(Node::has_ended) {
                self.ask_for_reports().await?;
            }
            return Ok(self.health());
        };
        // The controller goes first: it releases the connection, and the device sees it go in order.
        let plc = self.end(Which::Plc).await;
        let robot = self.end(Which::Robot).await;
        let faults = cable.end_capture();
        // Why a node did not end well says more than what that did to a capture.
        plc.and(robot)?;
        Ok(Health { faults: faults?, ..self.health() })
    }
}

/// What the nodes said last of their connection.
#[derive(Clone, Copy, Debug, Default)]
struct Links {
    plc: bool,
    robot: bool,
    /// The PLC found the robot ready, and the arm stands at the start.
    ready: bool,
    /// The PLC found the robot ready, and moves the arm to the start.
    moving_to_start: bool,
}

/// What a PLC's process says.
type FromPlc = Message<PlcMessage>;
/// What a robot's process says.
type FromRobot = Message<RobotMessage>;
