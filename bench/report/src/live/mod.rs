//! The live view: a page that shows a run in progress. The bench itself serves it.
//!
//! ```text
//! nodes' cyclic threads ── ring ── nodes' writers ── trace-*.rows ──┐ rows
//! run (session, rig) ── feed ───────────────────────────────────────┤
//!                                                                   ▼
//!                                            frames, parts ──▶ state ──▶ hub ──▶ server ──▶ pages
//! ```
//!
//! Data flows one way: nothing that a page does reaches the run. The view has a thread with an event loop of its own. The
//! channel to it is bounded; events that do not fit are dropped. The cyclic threads do no more than for every recorded
//! repetition: they write each cycle to a ring.

mod address;
mod connection;
mod frames;
mod hub;
mod page;
mod parts;
mod rows;
mod server;
mod state;

use std::collections::VecDeque;
use std::io;
use std::net::{SocketAddr, TcpListener};
use std::path::Path;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use tokio::sync::mpsc;
use tokio::time::MissedTickBehavior;

pub use address::{AddressError, DEFAULT, LiveAddress};
pub use page::{About, AboutArms};

use connection::LimitedListener;
use frames::LiveFrames;
use records::cell_results::CellResults;
use records::counted::counted;
use records::feed::{Feed, FeedEvent};
use records::results::{Results, Status};
use rows::{Rows, RowsError};
use server::Served;
use state::{Ended, Frame, Line, Part, Repetition, ReportText};

/// Interval at which rows are read: 30 times a second.
const EVERY: Duration = Duration::from_millis(33);

/// Time for open pages to receive the last events.
const LAST_EVENTS: Duration = Duration::from_millis(300);

/// Why there is no live view.
#[derive(Debug, thiserror::Error)]
pub enum LiveError {
    /// The address cannot be used.
    #[error(
        "cannot serve the live view on {address}: {error}; `--live 127.0.0.1:PORT` takes another port, `--live 127.0.0.1:0` \
         any that is free"
    )]
    Address {
        /// The address.
        address: LiveAddress,
        /// The kernel's error.
        error: io::Error,
    },
    /// The server does not start.
    #[error("cannot start the server of the live view: {0}")]
    Server(#[source] io::Error),
}

/// An address that is taken, before the run begins.
#[derive(Debug)]
pub struct Reserved {
    listener: TcpListener,
    address: SocketAddr,
}

impl Reserved {
    /// Takes an address.
    ///
    /// # Errors
    ///
    /// Another program has it.
    pub fn open(address: LiveAddress) -> Result<Self, LiveError> {
        let failed = |error| LiveError::Address { address, error };
        let listener = TcpListener::bind(address.socket()).map_err(failed)?;
        listener.set_nonblocking(true).map_err(failed)?;
        let address = listener.local_addr().map_err(failed)?;
        Ok(Self { listener, address })
    }
}

/// Directory in which a run is saved.
#[derive(Clone, Copy, Debug)]
pub struct SavedRun<'a> {
    /// The directory.
    pub directory: &'a Path,
    /// Presence of a report once the run has ended.
    pub has_report: bool,
}

/// The served view.
#[derive(Debug)]
pub struct Live {
    feed: Feed,
    last: mpsc::UnboundedSender<Part>,
    address: SocketAddr,
    thread: JoinHandle<()>,
}

impl Live {
    /// Starts serving a run whose nodes write their rows into `directory`; without one no arm is drawn.
    ///
    /// # Errors
    ///
    /// The page cannot be made, or the thread or its event loop does not start.
    pub fn start(reserved: Reserved, about: &About<'_>, directory: Option<&Path>) -> anyhow::Result<Self> {
        let Reserved { listener, address } = reserved;
        let (page, axes) = page::render(about)?;
        let served = Served::new(&page);
        let (feed, events) = Feed::new();
        let (last, ended) = mpsc::unbounded_channel();
        let stations = about.arms.stations();
        let is_only = stations.len() == 1;
        let arm = |(index, (axes, station)): (usize, (&usize, &String))| ViewedArm {
            rows: directory.map(|directory| Rows::of_station(directory, station, is_only)),
            frames: LiveFrames::new(index, *axes),
        };
        let view = View {
            events,
            ended,
            served,
            arms: axes.iter().zip(&stations).enumerate().map(arm).collect(),
            reps: about.reps,
            repetition: None,
            started_ns: None,
            opened: Instant::now(),
        };
        let failed = LiveError::Server;
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(failed)?;
        let body = move || runtime.block_on(view.serve(listener));
        let thread = std::thread::Builder::new().name("live".to_owned()).spawn(body).map_err(failed)?;
        Ok(Self { feed, last, address, thread })
    }

    /// Returns the address that is served.
    #[must_use]
    pub const fn address(&self) -> SocketAddr {
        self.address
    }

    /// Returns the end of the channel into which the run sends its events.
    #[must_use]
    pub fn feed(&self) -> Feed {
        self.feed.clone()
    }

    /// Sends the pages how the run ended. It is served until [`Self::close`].
    pub fn end(&self, results: Result<&Results, &anyhow::Error>, saved: SavedRun<'_>) {
        let of_results = |results: &Results| Part {
            ended: Some(ended(results.status, results.saved_of_all(), saved)),
            ..parts::table(results)
        };
        self.end_with(results.map_or_else(broke_off, of_results));
    }

    /// Does the same with the results of a cell with several stations.
    pub fn end_cell(&self, results: Result<&CellResults, &anyhow::Error>, saved: SavedRun<'_>) {
        let of_results = |results: &CellResults| Part {
            ended: Some(ended(results.status, results.saved_of_all(), saved)),
            ..parts::cell_table(results)
        };
        self.end_with(results.map_or_else(broke_off, of_results));
    }

    fn end_with(&self, last: Part) {
        let _ = self.last.send(last);
    }

    /// Sends the pages the report of the run in this directory, if it has one, and stops serving.
    pub fn close(self, directory: Option<&Path>) {
        let Self { feed, last, thread, .. } = self;
        if let Some(report) = directory.and_then(ReportText::read) {
            let _ = last.send(Part { report: Some(report), ..Part::default() });
        }
        // The thread ends with the sender, also where a feed is still open.
        drop((last, feed));
        // It can only have panicked, which it has said; the run's results do not depend on it.
        let _ = thread.join();
    }
}

/// Returns the path of the report in the directory of a run. It is written just after the end of the run; a browser follows no link from a
/// served page to a file, so the page gets its text, too.
fn report_path(saved: &Path) -> Option<String> {
    let path = saved.canonicalize().ok()?.join(crate::pages::FILE);
    Some(path.display().to_string())
}

/// Returns the last part of a run that an error ended.
fn broke_off(error: &anyhow::Error) -> Part {
    let ended = Ended { is_problem: true, text: format!("The run broke off: {error:#}."), report: None };
    Part { ended: Some(ended), ..Part::default() }
}

fn ended(status: Status, (done, all): (usize, usize), saved: SavedRun<'_>) -> Ended {
    let shown = saved.directory.display();
    let (is_problem, text) = match status {
        Status::Complete | Status::Running => {
            (false, format!("Done: {}, saved in {shown}.", counted(all, "repetition")))
        }
        Status::Failed => (true, format!("A repetition failed; {done} of {all} are saved in {shown}.")),
        Status::Interrupted => (true, format!("Interrupted, {done} of {all} repetitions saved in {shown}.")),
    };
    Ended { is_problem, text, report: saved.has_report.then(|| report_path(saved.directory)).flatten() }
}

/// What the view's thread has.
struct View {
    events: mpsc::Receiver<FeedEvent>,
    /// How the run ended, and its report; closed when nothing follows.
    ended: mpsc::UnboundedReceiver<Part>,
    served: Served,
    arms: Vec<ViewedArm>,
    reps: u32,
    repetition: Option<Repetition>,
    /// Start edge of the repetition that is shown: a PLC reports it for each station.
    started_ns: Option<u64>,
    opened: Instant,
}

/// An arm of the view.
struct ViewedArm {
    /// Rows of the PLC and of the robot.
    rows: Option<[Rows; 2]>,
    frames: LiveFrames,
}

impl ViewedArm {
    fn read(&mut self) -> Result<VecDeque<Frame>, RowsError> {
        let Some([plc, robot]) = &mut self.rows else { return Ok(VecDeque::new()) };
        let (plc, robot) = (plc.read()?, robot.read()?);
        Ok(self.frames.add(plc, robot))
    }
}

impl View {
    /// Serves until the run has ended.
    async fn serve(mut self, listener: TcpListener) {
        let listener = match tokio::net::TcpListener::from_std(listener) {
            Ok(listener) => LimitedListener::new(listener),
            Err(error) => return crate::errln!("warning: {}", LiveError::Server(error)),
        };
        let server = tokio::spawn(axum::serve(listener, server::routes(self.served.clone())).into_future());
        let mut ticks = tokio::time::interval(EVERY);
        ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            tokio::select! {
                last = self.ended.recv() => match last {
                    Some(last) => self.publish_last(last),
                    None => break,
                },
                Some(event) = self.events.recv() => self.handle(event),
                _ = ticks.tick() => self.read_rows(),
            }
        }
        self.served.hub().close();
        tokio::time::sleep(LAST_EVENTS).await;
        server.abort();
    }

    /// Publishes everything that was before the end, then the end.
    fn publish_last(&mut self, last: Part) {
        while let Ok(event) = self.events.try_recv() {
            self.handle(event);
        }
        self.read_rows();
        self.served.hub().publish(last);
    }

    fn handle(&mut self, event: FeedEvent) {
        let part = match event {
            FeedEvent::Next { execution_type, repetition: number } => {
                let repetition = Repetition { key: execution_type.to_string(), number, reps: self.reps };
                self.repetition = Some(repetition);
                // The arm may still move back to the start: the repetition before is shown until the start edge.
                return;
            }
            FeedEvent::Started { at_ns } => {
                if self.started_ns.replace(at_ns) == Some(at_ns) {
                    return;
                }
                self.arms.iter_mut().for_each(|arm| arm.frames.start(at_ns));
                Part { repetition: self.repetition.clone(), ..Part::default() }
            }
            FeedEvent::MotionsDone { length_ns } => {
                Part { end_ms: Some(length_ns as f64 / 1e6), ..Part::default() }
            }
            FeedEvent::Results(results) => parts::table(&results),
            FeedEvent::CellResults(results) => parts::cell_table(&results),
            FeedEvent::Report(robot, report) => {
                let key = robot.map_or_else(|| page::PLC.to_owned(), page::robot_key);
                Part { nodes: [(key, parts::node(&report))].into(), ..Part::default() }
            }
            FeedEvent::Note { is_problem, text } => self.line(is_problem, text),
        };
        self.served.hub().publish(part);
    }

    /// Reads the new rows and publishes their frames.
    fn read_rows(&mut self) {
        for index in 0..self.arms.len() {
            let Some(arm) = self.arms.get_mut(index) else { return };
            let part = match arm.read() {
                Ok(frames) => Part { frames, ..Part::default() },
                Err(error) => {
                    arm.rows = None;
                    self.line(true, format!("the arm is not followed any more: {error}"))
                }
            };
            self.served.hub().publish(part);
        }
    }

    fn line(&self, is_problem: bool, text: String) -> Part {
        let seconds = self.opened.elapsed().as_secs();
        let at = format!("{}:{:02}", seconds / 60, seconds % 60);
        Part { log: [Line { at, is_problem, text }].into(), ..Part::default() }
    }
}
