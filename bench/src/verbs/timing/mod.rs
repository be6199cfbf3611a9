//! `bench timing`: how regularly cyclic EtherNet/IP frames arrive, compared with the best that the host allows.
//!
//! An absolute figure would depend on the host as much as on the program. So the contenders send side by side on the
//! same cores, each on its own cable: a bare loop that sleeps until an absolute deadline and sends a datagram of the
//! same size, this project's adapter and scanner, and optionally a foreign adapter. A stall of the host affects all
//! of them at the same time. After each second they start again, in another phase to each other. Arrival times are
//! the kernel's, of frames as they leave the cable.

mod bare;
mod cable;
mod class1;
mod comparison;
mod evenness;

use std::ffi::OsString;
use std::panic::resume_unwind;
use std::thread;
use std::time::{Duration, SystemTime};

use machine::Instant;
use protocol_linux::clock;

use crate::out;
use crate::output::errln;
use crate::output::exit::{Exit, Failure};
use crate::stands::rig;
use cable::{Cable, Way};
use comparison::Comparison;
use evenness::{Evenness, Window};

/// Options of a comparison.
#[derive(clap::Args, Debug)]
pub struct TimingOptions {
    /// Turns of one second each.
    #[arg(long, value_name = "N", default_value_t = 30, value_parser = clap::value_parser!(u32).range(5..=3_600))]
    pub seconds: u32,
    /// An EtherNet/IP adapter of somebody else to compare with, with assemblies 100, 150 and 151 as the robot node has
    /// them: a command that is run at the other end of a cable of its own, where it has the address 192.168.64.2.
    #[arg(last = true, value_name = "COMMAND")]
    pub peer: Vec<OsString>,
}

/// Packet interval in both directions.
const INTERVAL: Duration = Duration::from_millis(1);

/// Measured time of each turn.
const TURN: Duration = Duration::from_secs(1);

/// Time from a turn's first frame to the first that counts: caches are warm by then.
const SETTLE: Duration = Duration::from_millis(100);

/// Measures, prints the table and the verdict.
pub fn run(options: &TimingOptions) -> Result<Exit, Failure> {
    rig::enter_user_namespace()?;
    let comparison = measure(options).map_err(|error| Failure::new(Exit::EnvironmentUnusable, error))?;
    out!("{comparison}");
    Ok(if comparison.fails() { Exit::TimingRegression } else { Exit::Pass })
}

fn measure(options: &TimingOptions) -> anyhow::Result<Comparison> {
    let (bare, ours) = (Cable::lay()?, Cable::lay()?);
    let adapter = class1::Adapter::start(&ours)?;
    let peer = match options.peer.split_first() {
        None => None,
        Some((program, arguments)) => {
            let cable = Cable::lay()?;
            let process = cable.spawn_at_robot(program, arguments)?;
            Some((cable, process))
        }
    };
    let mut turns = Vec::new();
    for turn in 0..options.seconds {
        errln!("turn {} of {}", turn + 1, options.seconds);
        turns.push(thread::scope(|scope| {
            let theirs = peer.as_ref().map(|(cable, _)| {
                scope.spawn(move || window(|| class1::exchange(cable, class1::Peer::Foreign, turn)))
            });
            let ours = scope.spawn(|| window(|| class1::exchange(&ours, class1::Peer::Ours, turn)));
            let mut common = window(|| bare::exchange(&bare))?;
            for exchange in theirs.into_iter().chain([ours]) {
                common = common.and(exchange.join().unwrap_or_else(|panic| resume_unwind(panic))?);
            }
            anyhow::Ok(common)
        })?);
    }
    adapter.stop()?;
    let (bare, ours) = (bare.arrivals()?, ours.arrivals()?);
    let evenness = |arrivals: &cable::Arrivals, way: Way| Evenness::of(arrivals.of(way), &turns, INTERVAL);
    let mut comparison = Comparison {
        bare: [Way::ToPlc, Way::ToRobot].map(|way| evenness(&bare, way)),
        ours: [Way::ToPlc, Way::ToRobot].map(|way| evenness(&ours, way)),
        peer: None,
    };
    if let Some((cable, process)) = peer {
        drop(process);
        comparison.peer = Some(evenness(&cable.arrivals()?, Way::ToPlc));
    }
    Ok(comparison)
}

/// Runs an exchange, which returns when it began, and returns the time that counts.
fn window(exchange: impl FnOnce() -> anyhow::Result<Instant>) -> anyhow::Result<Window> {
    let start = exchange()? + SETTLE;
    // Arrivals are stamped with the time of day.
    let ago = clock::now().since(start);
    let start = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH)?.saturating_sub(ago);
    Ok(Window { start, end: start + TURN })
}
