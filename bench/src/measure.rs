//! The run command: from its options to its table and exit code.

use std::future::Future;
use std::path::PathBuf;
use std::thread::{self, JoinHandle};
use std::time::SystemTime;

use anyhow::{Context, anyhow};
use planning::{Application, Found};
use setup::Setup;
use tokio::signal::unix::{SignalKind, signal};

use crate::cli::{Capture, Mode, RunOptions};
use crate::exit::{Exit, Failure};
use crate::host::{Host, date};
use crate::plan::Plan;
use crate::progress::Progress;
use crate::report;
use crate::results::{self, Results};
use crate::rig::{Rig, RigConfig, RigError};
use crate::run_directory::{Durability, RunDirectory};
use crate::session::{Ended, Session};
use crate::table;
use crate::virtual_run::{self, VirtualBus, VirtualRun};

/// What passes the PLC's interface, in the run directory.
const CAPTURE: &str = "plc.pcapng";

/// What the nodes' cyclic threads have where nothing was refused.
const GRANTED: &str = "SCHED_FIFO, memory locked";

/// Runs a setup and prints the table.
///
/// # Errors
///
/// The options, the setup, the machine or the disk does not allow it. A repetition that fails is none: its table is
/// printed as far as it goes, and the exit code says so.
pub fn run(options: &RunOptions) -> Result<Exit, Failure> {
    let (mut setup, found) = planning::setup_with_application(&options.setup)?;
    if let Some(cyclic) = options.cyclic {
        let Some(profinet) = &mut setup.bus.profinet else {
            let error = anyhow!("--cyclic is about PROFINET, and setup {} does not use it", setup.name);
            return Err(Failure::new(Exit::Usage, error));
        };
        profinet.cyclic = cyclic.into();
        setup::check(&setup)?;
    }
    found.plan(&setup)?;
    if options.mode == Mode::Virtual && options.capture != Capture::Never {
        let error = anyhow!("--capture records a real network; in virtual mode there is none yet");
        return Err(Failure::new(Exit::Usage, error));
    }
    let measurement =
        Measurement { plan: Plan::new(&options.types, options.reps, options.seed), options, setup, found };
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .context("cannot start the bench's event loop")?;
    let (ended, directory) = runtime.block_on(measurement.run())?;
    println!("{}\n  Saved in {}.", table::render(&ended.results), directory.display());
    match report::write(&directory) {
        Ok(path) => println!("  Report: {}.", path.display()),
        Err(Failure { error, .. }) => eprintln!(
            "warning: the results are saved, but their report is not: {error:#}; `bench report {}` draws it again",
            directory.display()
        ),
    }
    if let Some(error) = ended.failure {
        eprintln!("error: {error:#}");
    }
    Ok(ended.exit)
}

struct Measurement<'a> {
    options: &'a RunOptions,
    setup: Setup,
    found: Found,
    plan: Plan,
}

impl Measurement<'_> {
    async fn run(&self) -> Result<(Ended, PathBuf), Failure> {
        let started = SystemTime::now();
        let path = self.options.out.clone().unwrap_or_else(|| self.default_directory(started));
        let durability = match self.options.mode {
            Mode::Real => Durability::Synced,
            Mode::Virtual => Durability::Written,
        };
        let mut session = Session {
            directory: RunDirectory::create(&path, &self.setup, &self.found.text, durability)?,
            export_json: self.options.export_json.clone(),
            progress: Progress::start(&self.plan, self.options.quiet),
        };
        let host = Host::look(started);
        session.write_host(&host)?;
        let interrupt = interrupt()?;
        let results = Results::new(&self.setup, &self.found.application.name, self.options.mode, &self.plan);
        let ended = match self.options.mode {
            Mode::Virtual => {
                let without_overhead =
                    WithoutOverhead::start(&self.setup, &self.found.application, &self.plan);
                let bus = VirtualBus::OfSetup;
                let mut stand =
                    VirtualRun::start(&self.setup, &self.found.application, self.options.seed, bus)?;
                let ended = session.run(&mut stand, &self.plan, results, interrupt).await?;
                stand.trace().save(session.directory.path())?;
                match ended.exit {
                    Exit::Pass => ended.beside(without_overhead.finish()?),
                    _ => ended,
                }
            }
            Mode::Real => {
                let ended = self.run_real(&mut session, host, results, interrupt).await?;
                match ended.exit {
                    // Afterwards, so that it takes no core from the nodes. Whoever interrupted the run, or has a node
                    // to look after, does not want to wait for it.
                    Exit::Pass => {
                        let started =
                            WithoutOverhead::start(&self.setup, &self.found.application, &self.plan);
                        ended.beside(started.finish()?)
                    }
                    _ => ended,
                }
            }
        };
        session.finish(&ended.results)?;
        Ok((ended, path))
    }

    /// Runs the plan on two processes, which read the setup as it stands in the run directory.
    async fn run_real(
        &self,
        session: &mut Session,
        host: Host,
        results: Results,
        interrupt: impl Future<Output = ()>,
    ) -> Result<Ended, Failure> {
        let capture = session.directory.path().join(CAPTURE);
        let config = RigConfig {
            seed: self.options.seed,
            capture: (self.options.capture != Capture::Never).then(|| capture.clone()),
            ..RigConfig::new(session.directory.path().join("setup.toml"))
        };
        let unusable = |error: RigError| Failure::new(error.exit(), error);
        let mut interrupt = std::pin::pin!(interrupt);
        let mut rig = tokio::select! {
            () = &mut interrupt => return Err(Failure::new(Exit::Interrupted, anyhow!("interrupted"))),
            rig = Rig::start(&config) => rig.map_err(unusable)?,
        };
        let refused = rig.warnings();
        let scheduling = if refused.is_empty() { GRANTED.to_owned() } else { refused.join("; ") };
        session.write_host(&Host { scheduling: Some(scheduling), ..host })?;
        refused.iter().for_each(|warning| session.progress.warn(warning));
        let mut ended = session.run(&mut rig, &self.plan, results, interrupt).await?;
        let connected_after = rig.connected_after();
        let stopped = rig.stop().await;
        if ended.failure.is_none() {
            // What both nodes counted at their end belongs together; on the way their reports come one by one.
            ended.results.set_health(&stopped.map_err(unusable)?.health(connected_after));
        }
        if self.options.capture == Capture::OnFailure && ended.exit != Exit::RunFailed {
            let removed = std::fs::remove_file(&capture);
            removed.with_context(|| format!("cannot remove the capture {}", capture.display()))?;
        }
        Ok(ended)
    }

    fn default_directory(&self, started: SystemTime) -> PathBuf {
        let time = date(started).replace([':', '-'], "");
        let name: String =
            self.setup.name.chars().map(|c| if c.is_alphanumeric() { c } else { '_' }).collect();
        let name = format!("runs/{time}-{name}-{}", self.options.mode.name());
        let taken = |path: &PathBuf| path.exists();
        let numbered = (2..).map(|number| PathBuf::from(format!("{name}-{number}")));
        std::iter::once(PathBuf::from(&name)).chain(numbered).find(|path| !taken(path)).unwrap_or_default()
    }
}

/// Resolves at the first Ctrl-C or SIGTERM.
pub(crate) fn interrupt() -> anyhow::Result<impl Future<Output = ()>> {
    let mut interrupted = signal(SignalKind::interrupt()).context("cannot listen for Ctrl-C")?;
    let mut terminated = signal(SignalKind::terminate()).context("cannot listen for SIGTERM")?;
    Ok(async move {
        tokio::select! {
            _ = interrupted.recv() => {}
            _ = terminated.recv() => {}
        }
    })
}

/// The virtual run without the calibrated overhead, on the other core meanwhile; none where there is no overhead.
struct WithoutOverhead(Option<JoinHandle<anyhow::Result<Results>>>);

impl WithoutOverhead {
    fn start(setup: &Setup, application: &Application, plan: &Plan) -> Self {
        if setup.robot.skill_overhead_us.value == 0 {
            return Self(None);
        }
        let (mut setup, application, plan) = (setup.clone(), application.clone(), plan.clone());
        setup.robot.skill_overhead_us.value = 0;
        Self(Some(thread::spawn(move || virtual_run::whole(&setup, &application, &plan))))
    }

    fn finish(self) -> anyhow::Result<Option<results::WithoutOverhead>> {
        let Some(thread) = self.0 else { return Ok(None) };
        let results = thread.join().map_err(|_| anyhow!("the virtual run without overhead broke off"))??;
        Ok(Some(results.as_without_overhead()))
    }
}
