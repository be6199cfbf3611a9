//! The run command: from its options to its table and exit code.

use std::future::Future;
use std::path::PathBuf;
use std::thread::{self, JoinHandle};
use std::time::SystemTime;

use anyhow::{Context, anyhow};
use setup::{Application, Setup};
use tokio::signal::unix::{SignalKind, signal};

use crate::cli::{Mode, RunOptions};
use crate::exit::{Exit, Failure};
use crate::host::{Host, date};
use crate::plan::Plan;
use crate::progress::Progress;
use crate::results::{self, Results};
use crate::rig::{Rig, RigConfig, RigError};
use crate::run_directory::{Durability, RunDirectory};
use crate::session::{Ended, Session};
use crate::table;
use crate::virtual_run::{self, VirtualBus, VirtualRun};

/// Runs a setup and prints the table.
///
/// # Errors
///
/// The options, the setup, the machine or the disk does not allow it. A repetition that fails is none: its table is
/// printed as far as it goes, and the exit code says so.
pub fn run(options: &RunOptions) -> Result<Exit, Failure> {
    let (mut setup, application) = setup::setup_with_application(&options.setup)?;
    if let Some(cyclic) = options.cyclic {
        let Some(profinet) = &mut setup.bus.profinet else {
            let error = anyhow!("--cyclic is about PROFINET, and setup {} does not use it", setup.name);
            return Err(Failure::new(Exit::Usage, error));
        };
        profinet.cyclic = cyclic.into();
        setup::check(&setup)?;
    }
    let measurement = Measurement {
        plan: Plan::new(&options.types, options.reps, options.seed),
        options,
        setup,
        application,
    };
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .context("cannot start the bench's event loop")?;
    let (ended, directory) = runtime.block_on(measurement.run())?;
    println!("{}\n  Saved in {}.", table::render(&ended.results), directory.display());
    if let Some(error) = ended.failure {
        eprintln!("error: {error:#}");
    }
    Ok(ended.exit)
}

struct Measurement<'a> {
    options: &'a RunOptions,
    setup: Setup,
    application: Application,
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
            directory: RunDirectory::create(&path, &self.setup, &self.application, durability)?,
            export_json: self.options.export_json.clone(),
            progress: Progress::start(&self.plan, self.options.quiet),
        };
        let host = Host::look(started);
        session.directory.write_host(&host.to_json().context("cannot write the host as JSON")?)?;
        let interrupt = interrupt()?;
        let results = Results::new(&self.setup, &self.application.name, self.options.mode, &self.plan);
        let mut ended = match self.options.mode {
            Mode::Virtual => {
                let without_overhead = WithoutOverhead::start(&self.setup, &self.application, &self.plan);
                let bus = VirtualBus::OfSetup;
                let mut stand = VirtualRun::start(&self.setup, &self.application, self.options.seed, bus)?;
                let ended = session.run(&mut stand, &self.plan, results, interrupt).await?;
                Ended {
                    results: Results { without_skill_overhead: without_overhead.finish()?, ..ended.results },
                    ..ended
                }
            }
            Mode::Real => {
                let config = RigConfig {
                    cyclic: self.setup.bus.profinet.as_ref().map(|profinet| profinet.cyclic),
                    seed: self.options.seed,
                    ..RigConfig::new(&self.options.setup)
                };
                let unusable = |error: RigError| Failure::new(error.exit(), error);
                let mut interrupt = Box::pin(interrupt);
                let mut rig = tokio::select! {
                    () = &mut interrupt => return Err(Failure::new(Exit::Interrupted, anyhow!("interrupted"))),
                    rig = Rig::start(&config) => rig.map_err(unusable)?,
                };
                if !self.options.quiet {
                    rig.warnings().iter().for_each(|warning| eprintln!("warning: {warning}"));
                }
                let ended = session.run(&mut rig, &self.plan, results, interrupt).await?;
                let left = rig.stop().await;
                if ended.failure.is_none() {
                    left.map_err(unusable)?;
                }
                ended
            }
        };
        session.finish(&mut ended.results)?;
        Ok((ended, path))
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
fn interrupt() -> anyhow::Result<impl Future<Output = ()>> {
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
