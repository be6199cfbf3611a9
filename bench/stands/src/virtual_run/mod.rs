//! All nodes in virtual time: the machines of a real run on a virtual cable.
//!
//! ```text
//! cell           the PLC and its robots in their network
//! cell_capture   the frames on their cables
//! cell_faults    when the faults of its stations change cables and nodes
//! cell_laws      what no fault may break: meeting at marks, one arm in a zone
//! cell_run       runs of a cell with several stations; cell_watch records them
//! new_cell       creates its nodes
//! nodes          the nodes on the cable: from event to event, from the start edge of a run to its end
//! changes        when the faults change cable, nodes and drives
//! new_nodes      both nodes, and once more where they are started again
//! phases         what the seed determines
//! reaction       a number from the PLC to the robot and back, without program and skill
//! watch          looks at both nodes after each of their ticks, for a trace
//! ```

mod cell;
mod cell_capture;
mod cell_faults;
mod cell_laws;
mod cell_run;
mod cell_watch;
mod changes;
mod new_cell;
mod new_nodes;
mod nodes;
#[cfg(test)]
mod old_frames;
mod phases;
mod reaction;
#[cfg(test)]
mod shared_zones;
mod watch;

use std::cell::RefCell;
use std::path::PathBuf;
use std::rc::Rc;
use std::time::Duration;

use anyhow::Context as _;
use capture_file::Retention;
use machine::Instant;
use machine::ethernet::Mac;
use planning::{Application, Stop, ToStart};
use plc_node::{ExecutionType, ExportedCode, MotionSource, PlcEvent, motion_source};
use protocol::image::{Digest, Motion};
use robot_node::RobotConfig;
use setup::Setup;

pub use cell_laws::BrokenLaw;
pub use cell_run::{CellRun, execute_each_of_cell};
pub use nodes::{NeverEnded, Nodes};
pub use reaction::reactions;

use nodes::{SharedCapture, Surroundings};

use crate::capture::{CableConfig, VirtualCapture};
use crate::planned_cell::PlannedCell;
use crate::verification::Verification;
use crate::{Finished, Stand, StandConfig, under_faults};
use records::conditions::{Health, Measured};
use records::exit::Failure;
use records::faults::{self, Fault};
use records::mode::Mode;
use records::not_ready::NotReady;
use records::plant_speed::PlantSpeed;
use records::results::{Results, Status};
use records::schedule::{Schedule, Step};
use records::trace::{Recording, Trace};
use watch::SharedFrames;

/// Locally administered addresses of the two stations.
const PLC_MAC: Mac = Mac([0x02, 0, 0, 0, 0, 1]);
const ROBOT_MAC: Mac = Mac([0x02, 0, 0, 0, 0, 2]);

/// Two connected nodes in virtual time.
pub struct VirtualRun {
    nodes: Nodes,
    trace: Trace,
    capture: Option<SharedCapture>,
    /// When it was started, by the host's clock.
    started: std::time::Instant,
}

/// The motions of both nodes, and the cell that the robot moves in.
pub struct Work {
    /// The motions that SM and CM send.
    source: Box<dyn MotionSource>,
    /// The motions that RC runs, from the robot's program store.
    program: Vec<Motion>,
    stops: Vec<Stop>,
    to_start: ToStart<Motion>,
    robot: RobotConfig,
    /// Exported code in the place of the PLC's function blocks.
    code: Option<ExportedCode>,
    /// The same once more, for nodes that are started again; only work that was planned has it.
    again: Option<Box<PlannedCell>>,
}

impl Work {
    fn of(PlannedCell { robot, motions, points, stops, to_start, .. }: PlannedCell) -> Self {
        let source = motion_source(motions.clone(), points);
        Self { source, program: motions, stops, to_start, robot, code: None, again: None }
    }

    /// Creates work for a run with these faults.
    fn with(planned: PlannedCell, faults: &[Fault]) -> Self {
        let restarts = faults::at_frames(faults).any(|at| at.restarted().is_some());
        let again = restarts.then(|| Box::new(planned.clone()));
        Self { again, ..Self::of(planned) }
    }

    /// Creates the work of motions that the PLC sends; the robot's program store is empty.
    pub fn sent(
        setup: &Setup,
        source: Box<dyn MotionSource>,
        to_start: ToStart<Motion>,
    ) -> anyhow::Result<Self> {
        let robot = RobotConfig::from_setup(setup)?;
        let (program, stops) = (Vec::new(), Vec::new());
        Ok(Self { source, program, stops, to_start, robot, code: None, again: None })
    }
}

/// Options of a virtual run besides its setup.
#[derive(Clone, Debug, Default)]
pub struct Extras {
    /// Faults of the cable and of the nodes.
    pub faults: Vec<Fault>,
    /// Directory for captures of both ends, and how much is kept.
    pub capture: Option<(PathBuf, Retention)>,
    /// Whether the frames of recorded repetitions are kept, for a timeline.
    pub frames: bool,
    /// Exported code in the place of the PLC's function blocks.
    pub code: Option<ExportedCode>,
}

impl VirtualRun {
    /// Connects both nodes of a setup by a virtual cable and waits until the robot is ready.
    ///
    /// # Errors
    ///
    /// The setup does not describe a robot, or the nodes do not connect.
    pub fn start(setup: &Setup, application: &Application, seed: u64) -> anyhow::Result<Self> {
        Self::start_with(setup, application, seed, &Extras::default())
    }

    /// Starts a run like [`VirtualRun::start`], with faults and captures.
    ///
    /// # Errors
    ///
    /// The same as for [`VirtualRun::start`], or a capture cannot be created.
    pub fn start_with(
        setup: &Setup,
        application: &Application,
        seed: u64,
        extras: &Extras,
    ) -> anyhow::Result<Self> {
        let work = Work::with(PlannedCell::of(setup, application)?, &extras.faults);
        let work = Work { code: extras.code.clone(), ..work };
        Self::start_on(setup, work, seed, extras)
    }

    /// Switches on both nodes of a cell that is planned already, which do not know each other yet:
    /// [`connect`](Self::connect) waits for that.
    pub fn switch_on(
        setup: &Setup,
        planned: PlannedCell,
        seed: u64,
        extras: &Extras,
    ) -> anyhow::Result<Self> {
        Self::new(setup, Work::with(planned, &extras.faults), seed, extras)
    }

    /// Waits until the nodes are connected and the robot is ready.
    pub fn connect(&mut self) -> anyhow::Result<()> {
        self.nodes.connect()
    }

    /// Returns the time since the robot was ready; times of faults count from there.
    pub fn since_ready(&self) -> Duration {
        self.nodes.since_ready()
    }

    /// Waits until the robot is ready again after a run that failed.
    pub fn recover(&mut self) -> anyhow::Result<()> {
        self.nodes.recover()
    }

    /// Starts a run like [`VirtualRun::start_with`], of motions that were planned elsewhere.
    pub fn start_on(setup: &Setup, work: Work, seed: u64, extras: &Extras) -> anyhow::Result<Self> {
        let mut run = Self::new(setup, work, seed, extras)?;
        if let Err(error) = run.nodes.connect() {
            // Captures matter most when a run failed.
            run.end_capture(true)?;
            return Err(error);
        }
        Ok(run)
    }

    fn new(setup: &Setup, work: Work, seed: u64, extras: &Extras) -> anyhow::Result<Self> {
        let started = std::time::Instant::now();
        let capture = extras.start_capture(setup)?;
        let frames = extras.frames.then(SharedFrames::default);
        let surroundings = Surroundings { faults: &extras.faults, capture: capture.clone(), frames };
        let nodes = Nodes::switch_on(setup, work, seed, surroundings)?;
        Ok(Self { nodes, trace: Trace::default(), capture, started })
    }

    /// Ends the captures, if any. Captures held in memory are written only if `wanted`.
    ///
    /// # Errors
    ///
    /// They could not be written.
    pub fn end_capture(&self, wanted: bool) -> anyhow::Result<()> {
        let capture = self.capture.as_ref().and_then(|capture| capture.borrow_mut().take());
        match capture.filter(|_| wanted) {
            Some(capture) => capture.finish().map_err(|(path, error)| {
                anyhow::Error::new(error).context(format!("cannot write the capture {}", path.display()))
            }),
            None => Ok(()),
        }
    }

    /// Returns the trace of the first repetition of each execution type so far.
    #[must_use]
    pub const fn trace(&self) -> &Trace {
        &self.trace
    }

    /// Sets the start edge of a run; [`run_for`](Self::run_for) continues it.
    pub fn begin(&mut self, execution_type: ExecutionType) -> anyhow::Result<()> {
        self.nodes.start_run(execution_type)
    }

    /// Runs for up to `time` of true time, or until the PLC's next event.
    pub fn run_for(&mut self, time: Duration) -> Option<PlcEvent> {
        self.nodes.next_event(self.nodes.now() + time)
    }

    /// Returns digests of the motions that the PLC sent in this run, and of those that the robot put on its path.
    pub fn digests(&self) -> [Digest; 2] {
        self.nodes.digests()
    }

    /// Returns how many frames were put into the cable towards the robot, and towards the PLC.
    pub fn frames_sent(&self) -> [u64; 2] {
        self.nodes.frames_sent()
    }

    /// Executes one step of a schedule without a recording.
    pub fn execute_unrecorded(&mut self, step: Step) -> anyhow::Result<Measured> {
        self.nodes.execute(step, None)
    }

    /// Executes one step of a schedule with a recording.
    pub fn execute_recorded(&mut self, step: Step, recording: &mut Recording) -> anyhow::Result<Measured> {
        self.nodes.execute(step, Some(recording))
    }

    /// Returns the true time since the nodes were switched on: what a plant would have taken.
    #[must_use]
    pub fn plant_time(&self) -> Duration {
        self.nodes.now().since(Instant::ZERO)
    }

    /// Returns how much faster than the plant it has been since the nodes were switched on.
    fn speed(&self) -> PlantSpeed {
        PlantSpeed { plant: self.plant_time(), host: self.started.elapsed() }
    }
}

/// Plans an application and executes a whole schedule of it without progress output, run directory or interrupts. The
/// results are not compared with the paper.
///
/// # Errors
///
/// The application cannot be planned, the nodes do not connect, or a repetition fails.
pub fn whole(setup: &Setup, application: &Application, schedule: &Schedule) -> anyhow::Result<Results> {
    whole_planned(setup, PlannedCell::of(setup, application)?, schedule)
}

/// Executes a whole schedule like [`whole`], of an application that is planned already.
///
/// # Errors
///
/// The nodes do not connect, or a repetition fails.
pub fn whole_planned(setup: &Setup, planned: PlannedCell, schedule: &Schedule) -> anyhow::Result<Results> {
    whole_with_speed(setup, planned, schedule).map(|(results, _)| results)
}

/// Executes a whole schedule like [`whole_planned`]; returns also how much faster than the plant that was.
///
/// # Errors
///
/// The same as for [`whole_planned`].
pub fn whole_with_speed(
    setup: &Setup,
    planned: PlannedCell,
    schedule: &Schedule,
) -> anyhow::Result<(Results, PlantSpeed)> {
    let mut results = Results::new(setup, &planned.name, Mode::Virtual, schedule);
    let ended = execute_each(setup, planned, schedule, &[], |step, measured, unverified| {
        results.add_unverified(unverified);
        Ok(results.record(step.execution_type, measured)?)
    })?;
    results.status = Status::Complete;
    results.set_health(&ended.0);
    Ok((results, ended.1))
}

/// Executes a whole schedule of an application that is planned already, with faults, verifies each repetition and passes it to
/// `done`, with what could not be verified. Returns the conditions at the end and how much faster than the plant it was.
///
/// # Errors
///
/// The nodes do not connect, a repetition fails or is not that of the plan, or `done` fails. Earlier repetitions were passed on.
pub fn execute_each(
    setup: &Setup,
    planned: PlannedCell,
    schedule: &Schedule,
    faults: &[Fault],
    mut done: impl FnMut(Step, &Measured, Vec<String>) -> anyhow::Result<()>,
) -> anyhow::Result<(Health, PlantSpeed)> {
    let mut verification = Verification::of(setup, planned.clone(), Mode::Virtual, faults)?;
    let extras = Extras { faults: faults.to_vec(), ..Extras::default() };
    let mut run = VirtualRun::start_on(setup, Work::with(planned, faults), schedule.seed, &extras)?;
    for step in schedule.steps() {
        let measured = run.nodes.execute(step, None)?;
        verification.check(&measured)?;
        done(step, &measured, verification.unverified(&measured))?;
    }
    Ok((run.nodes.health(), run.speed()))
}

impl Stand for VirtualRun {
    async fn start(config: &StandConfig<'_>) -> Result<Self, Failure> {
        let extras = Extras {
            faults: config.faults.to_vec(),
            capture: config.capture.map(|keep| (config.directory.to_owned(), keep)),
            frames: config.frames,
            code: config.code.map(|(_, code)| code.clone()),
        };
        let StandConfig { setup, application, seed, .. } = *config;
        let started = Self::start_with(setup, application, seed, &extras);
        started.map_err(|error| match error.downcast_ref::<NotReady>() {
            Some(_) if !config.faults.is_empty() => under_faults(error, config.faults),
            Some(NotReady::NotConnected(_)) => error
                .context("in virtual time only the setup can be the reason, such as its bus.watchdog_cycles")
                .into(),
            _ => error.into(),
        })
    }

    async fn execute(&mut self, step: Step) -> anyhow::Result<Measured> {
        let is_first = step.repetition == 1;
        let recording =
            is_first.then(|| self.trace.types.entry(step.execution_type).insert(Recording::default()));
        self.nodes.execute(step, recording)
    }

    fn health(&self) -> Health {
        self.nodes.health()
    }

    async fn finish(self, keeps_capture: bool) -> Finished {
        let speed = self.speed();
        Finished {
            capture: self.end_capture(keeps_capture),
            trace: Ok(Some(self.trace)),
            health: Ok(None),
            speed: Some(speed),
        }
    }
}

impl Extras {
    fn start_capture(&self, setup: &Setup) -> anyhow::Result<Option<SharedCapture>> {
        let Some((directory, keep)) = &self.capture else { return Ok(None) };
        let delay = Duration::from_micros(setup.bus.cable_delay_us.value.into());
        let config = CableConfig { macs: [PLC_MAC, ROBOT_MAC], delay, about: faults::about(&self.faults) };
        let capture = VirtualCapture::create(directory, config, *keep)
            .with_context(|| format!("cannot make captures in {}", directory.display()))?;
        Ok(Some(Rc::new(RefCell::new(Some(capture)))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use records::exit::Exit;

    /// Returns exit code and error of a run that does not begin.
    fn refused(setup: &Setup, application: &str, faults: &[&str]) -> (Exit, String) {
        let application = planning::application(application, None).unwrap().application;
        let faults: Vec<Fault> = faults.iter().map(|fault| fault.parse().unwrap()).collect();
        let directory = tempfile::tempdir().unwrap();
        let config = StandConfig {
            setup,
            application: &application,
            application_text: "",
            seed: 1,
            directory: directory.path(),
            capture: None,
            frames: false,
            code: None,
            faults: &faults,
            feed: None,
            voice: None,
            attach: None,
            token: None,
        };
        let runtime = tokio::runtime::Builder::new_current_thread().build().unwrap();
        let started = runtime.block_on(<VirtualRun as Stand>::start(&config));
        let Failure { exit, error } = started.err().unwrap();
        (exit, format!("{error:#}"))
    }

    #[test]
    fn faults_that_keep_a_run_from_beginning_fail_it_and_are_named() {
        let setup = setup::setup("A").unwrap();
        for fault in ["loss=1", "delay=10s"] {
            let (exit, said) = refused(&setup, "pick-and-place", &[fault]);
            assert_eq!(exit, Exit::RunFailed, "{said}");
            let begin =
                format!("the run did not begin with its faults ({fault}): no connection to the robot: ");
            assert!(said.starts_with(&begin), "{said}");
        }
    }

    #[test]
    fn a_setup_that_keeps_a_run_from_beginning_is_a_wrong_setup() {
        let mut setup = setup::setup("A").unwrap();
        setup.bus.watchdog_cycles.value = 1;
        let (exit, said) = refused(&setup, "pick-and-place", &[]);
        assert_eq!(exit, Exit::Usage, "{said}");
        assert!(said.contains("only the setup can be the reason, such as its bus.watchdog_cycles"), "{said}");
        let mut setup = setup::setup("A").unwrap();
        setup.motions.velocity_percent.value = 0.05;
        let (exit, said) = refused(&setup, "gluing", &[]);
        assert_eq!(exit, Exit::Usage, "{said}");
        assert!(
            said.contains("still on its way to the start") && said.contains("motions.velocity_percent"),
            "{said}"
        );
    }
}
