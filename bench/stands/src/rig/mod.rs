//! The rig: all nodes as processes of their own, on cables between networks that the rig makes.
//!
//! ```text
//!            bench (tokio, one thread)
//!   pipes ┌──────────┴──────────┐ pipes
//!   plc-node   plc0 ══ veth ══ robot0   robot-node
//!   └ network namespace ┘   └ network namespace ┘
//! ```
//!
//! A pair is a cell with one robot. Of a cell with several, those on buses with one address of the PLC share a switch at one
//! interface of the PLC; an EtherCAT segment has an interface of its own.
//!
//! The nodes are this same program, started again: nothing else has to be built or installed. The namespaces are
//! unnamed and the nodes die with the bench, so nothing is left behind however any of them ends. The nodes have a
//! process group of their own, so that Ctrl-C reaches only the bench, which ends them in order. An ordinary user gets
//! all this through a user namespace, see [`enter_user_namespace`].
//!
//! Alternatively the nodes already run somewhere, and the rig only controls them over TCP: [`Rig::attach`].
//!
//! Here tokio serves pipes, connections, processes and timeouts. The cyclic threads run in the other processes, without
//! tokio.

mod asked_reports;
mod attach;
mod attached_node;
mod bounded_lines;
mod cable;
mod cell_stand;
mod changes;
mod config;
mod error;
mod executions;
mod frames;
mod layout;
mod live_feed;
mod messages;
mod network;
mod node;
mod node_process;
mod reports;
mod rig_node;
mod robot;
mod silence;
mod stand;
mod wanted_cell;

pub use config::RigConfig;
pub use error::RigError;
pub use frames::FrameLog;
pub use layout::RigLayout;
pub use reports::Reports;
pub use rig_node::NodeName;
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
use changes::Changes;
use messages::Startup;
use network::{NetworkOptions, RigNetwork, plc_interface};
use node_process::{NodeEvent, NodeProcess};
use reports::FirstReports;
use rig_node::RigNode;
use robot::RigRobot;
use silence::Silence;

use ::node::wait_lines::WaitLines;
use records::faults::{Change, FaultReport};
use records::feed::Feed;
use records::trace::Window;
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
    let layout = RigLayout::of_one();
    let network = NetworkOptions { layout: &layout, capture: None, faults: &[], seed: 0, frames: None };
    let network = RigNetwork::set_up(network)?;
    let open = || {
        let interface = Interface::open(&plc_interface(0))?;
        let profinet = OpenPort::open_all(&interface, profinet::PORTS);
        let ports = profinet.and_then(|_| OpenPort::open_all(&interface, ethernet_ip::PORTS));
        Ok::<_, RigError>(ports.map(drop))
    };
    network.plc().run(open)?
}

/// All connected nodes.
#[derive(Debug)]
pub struct Rig {
    plc: Node,
    /// The robots, in the order of their stations.
    robots: Vec<RigRobot>,
    events: mpsc::Receiver<NodeEvent>,
    hellos: Vec<(RigNode, Hello)>,
    reports: Reports,
    /// The nodes' reports from before this rig.
    before: Reports,
    /// The nodes' reports from before the current run.
    before_run: Reports,
    /// The nodes' reports at the start of the current run.
    first_reports: FirstReports,
    /// Time for which each node has sent nothing.
    silence: Silence,
    /// The PLC's remarks on the connections.
    remarks: Vec<String>,
    /// Prints lines beside the progress; `None` where nobody reads them.
    voice: Option<Voice>,
    /// Which reports of the nodes' waits it prints.
    wait_lines: WaitLines,
    /// Reports asked for and not received, of each node.
    awaited: Vec<u32>,
    traced: Vec<Window>,
    recording: bool,
    /// Whether a run was started whose end or failure was not reported yet.
    is_running: bool,
    /// The end of a robot in a run of several, of which the PLC has not yet said what becomes of it.
    lost: Option<RigError>,
    links: Links,
    /// Watchdog time of the connection.
    watchdog: Duration,
    /// Attempts of the current repetition.
    tries: u32,
    /// Why repetitions were run again.
    repeated: Vec<String>,
    /// Changes of the nodes that faults will make.
    changes: Changes,
    /// Nodes that a fault has killed.
    killed: Vec<RigNode>,
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
    network: Option<RigNetwork>,
}

impl Rig {
    /// Creates the network, starts all nodes and waits until the PLC finds every robot ready.
    ///
    /// # Errors
    ///
    /// The host does not allow something, a node does not start, or the nodes do not connect.
    pub async fn start(config: &RigConfig) -> Result<Self, RigError> {
        let started = Instant::now();
        let RigConfig { layout, capture, faults, seed, frames: frames_log, .. } = config;
        let (capture, frames) = (capture.as_ref(), frames_log.as_ref());
        let network = NetworkOptions { layout, capture, faults, seed: *seed, frames };
        let network = RigNetwork::set_up(network)?;
        // Room for all messages of the nodes while the bench writes a file.
        let (sender, events) = mpsc::channel(1_024);
        let program = config.program.clone().unwrap_or_else(|| PathBuf::from("/proc/self/exe"));
        let mut robots = Vec::with_capacity(layout.robots());
        for (index, (station, space)) in layout.names().zip(network.robots()).enumerate() {
            let mut robot = RigRobot::of(station.map(str::to_owned));
            let interface = layout.robot_interfaces(index);
            let args = config.robot_args(&interface, index, station);
            let named = (RigNode::Robot(index), robot.name());
            let node = NodeProcess::spawn(named, &program, ROBOT_NODE, args, space, sender.clone())?;
            robot.node = Some(Node::Process(node));
            robots.push(robot);
        }
        let args = config.plc_args(&layout.interface_option(plc_interface));
        let named = (RigNode::Plc, NodeRole::Plc.into());
        let plc = NodeProcess::spawn(named, &program, PLC_NODE, args, network.plc(), sender)?;
        let mut rig = Self::of(Node::Process(plc), robots, events, Some(network), config.watchdog);
        rig.feed.clone_from(&config.feed);
        rig.voice.clone_from(&config.voice);
        rig.wait_until_connected(Startup::new(None)).await?;
        rig.connected_after = Some(started.elapsed());
        rig.wait_until_at_start().await?;
        rig.changes = Changes::from_now(layout, faults);
        if let Some(network) = &mut rig.network {
            network.set_ready();
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
        robots: Vec<RigRobot>,
        events: mpsc::Receiver<NodeEvent>,
        network: Option<RigNetwork>,
        watchdog: Duration,
    ) -> Self {
        let names = robots.iter().map(RigRobot::name);
        let silence = Silence::from_now(std::iter::once(NodeRole::Plc.into()).chain(names));
        let reports = Reports::of_robots(robots.len());
        Self {
            plc,
            awaited: vec![0; robots.len() + 1],
            robots,
            events,
            hellos: Vec::new(),
            before: reports.clone(),
            before_run: reports.clone(),
            reports,
            first_reports: FirstReports::default(),
            silence,
            remarks: Vec::new(),
            voice: None,
            wait_lines: WaitLines::default(),
            traced: Vec::new(),
            recording: false,
            trace_directory: None,
            frames: None,
            feed: None,
            writes_all: false,
            is_running: false,
            lost: None,
            links: Links::default(),
            watchdog,
            tries: 0,
            repeated: Vec::new(),
            changes: Changes::default(),
            killed: Vec::new(),
            connected_after: None,
            network,
        }
    }

    /// Returns all nodes, the PLC first, also those that are not ours.
    fn nodes(&self) -> impl Iterator<Item = RigNode> + Clone + use<> {
        RigNode::all(self.robots.len())
    }

    /// Returns the name of a node in messages.
    fn name(&self, id: RigNode) -> NodeName {
        match id {
            RigNode::Plc => NodeRole::Plc.into(),
            RigNode::Robot(station) => {
                self.robots.get(station).map_or_else(|| NodeRole::Robot.into(), RigRobot::name)
            }
        }
    }

    fn node(&mut self, id: RigNode) -> Option<&mut Node> {
        match id {
            RigNode::Plc => Some(&mut self.plc),
            RigNode::Robot(station) => self.robots.get_mut(station).and_then(|robot| robot.node.as_mut()),
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
        self.network.as_ref().map_or(Ok(()), |network| network.pause_capture(paused))
    }

    /// Starts or stops recording the cycles of the next runs, and the frames if configured.
    ///
    /// # Errors
    ///
    /// The host does not let the rig listen to its own interfaces.
    pub async fn record(&mut self, on: bool) -> Result<(), RigError> {
        if self.trace_directory.is_some() && self.recording != on {
            self.recording = on;
            if let Some(network) = &mut self.network {
                network.watch(on)?;
            }
            if !self.writes_all {
                self.set_tracing(on).await;
            }
        }
        Ok(())
    }

    /// Tells the nodes to write their cycles, or to stop that.
    async fn set_tracing(&mut self, on: bool) {
        for id in self.nodes() {
            if let Some(node) = self.node(id) {
                node.send(&Instruction::<PlcInstruction>::Record(on)).await;
            }
        }
    }

    /// Returns the result of the faults so far; `None` without faults.
    fn fault_report(&self) -> Option<FaultReport> {
        self.network.as_ref().and_then(RigNetwork::fault_report)
    }

    /// Makes a change that a fault asks for at a station. The cables make their own.
    async fn change(&mut self, station: usize, change: Change) {
        match change {
            Change::Kill(NodeRole::Plc) => self.kill(RigNode::Plc),
            Change::Kill(NodeRole::Robot) => self.kill(RigNode::Robot(station)),
            Change::Drive(axis, disturbance) => {
                if let Some(robot) = self.node(RigNode::Robot(station)) {
                    robot.send(&Instruction::Node(RobotInstruction::Disturb { axis, disturbance })).await;
                }
            }
            // A restart is for virtual time, and the options refuse it here.
            Change::Cut | Change::Mend | Change::Restart(_) => {}
        }
    }

    fn kill(&mut self, id: RigNode) {
        self.killed.push(id);
        if let Some(network) = &self.network {
            network.note_killed(id);
        }
        if let Some(node) = self.node(id) {
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
        if let Some(network) = &mut self.network {
            network.discard_capture();
        }
    }

    /// Closes the connections in order, ends all nodes, then the captures. Nodes that already ran keep running.
    ///
    /// # Errors
    ///
    /// A node did not end by itself and was killed, or a capture could not be written. Nothing is left behind in
    /// either case.
    pub async fn stop(&mut self) -> Result<Option<FaultReport>, RigError> {
        // The aborted run is not reported any more.
        self.is_running = false;
        let Some(mut network) = self.network.take() else {
            let mut robots = self.robots.iter().filter_map(|robot| robot.node.as_ref());
            if !self.plc.has_ended() && !robots.any(Node::has_ended) {
                self.ask_for_reports().await?;
            }
            return Ok(None);
        };
        // The controller first: it releases the connections, so the devices see an orderly end.
        let mut ended = Ok(());
        for id in self.nodes() {
            ended = ended.and(self.end(id).await);
        }
        let faults = network.end_capture();
        // A node's error comes first: it explains the effect on a capture.
        ended?;
        faults
    }
}

/// The PLC's last messages about the readiness of the robots.
#[derive(Clone, Copy, Debug, Default)]
struct Links {
    /// The PLC found every robot ready, and the arms are at the start.
    ready: bool,
    /// The PLC found the robots ready, and moves an arm to the start.
    moving_to_start: bool,
}

/// A message of a PLC's process.
type FromPlc = Message<PlcMessage>;
/// A message of a robot's process.
type FromRobot = Message<RobotMessage>;
