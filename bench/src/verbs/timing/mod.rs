//! `bench timing`: how evenly cyclic EtherNet/IP frames come, beside the best that the host allows.
//!
//! An absolute figure would say as much about the host as about the program. So the contenders send side by side, each
//! on a cable of its own, on the same cores: a bare loop that sleeps until an absolute deadline and sends a datagram of
//! the same size, the adapter and the scanner of this project, and where one is named the adapter of somebody else. A
//! stall of the host hits all of them at once. After each second they begin anew, in another phase to each other. Times
//! of arrival are the kernel's, of frames as they come out of the cable.

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

/// Packet interval, both ways.
const INTERVAL: Duration = Duration::from_millis(1);

/// What is measured of each turn.
const TURN: Duration = Duration::from_secs(1);

/// From the first frame of a turn to the first that counts: what is cold is warm by then.
const SETTLE: Duration = Duration::from_millis(100);

/// Measures, prints the table and judges it.
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

/// Runs an exchange, which tells when it began, and says what of it counts.
fn window(exchange: impl FnOnce() -> anyhow::Result<Instant>) -> anyhow::Result<Window> {
    let start = exchange()? + SETTLE;
    // Arrivals have the time of day.
    let ago = clock::now().since(start);
    let start = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH)?.saturating_sub(ago);
    Ok(Window { start, end: start + TURN })
}
