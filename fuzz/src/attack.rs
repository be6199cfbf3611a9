//! An attack of a stranger on one station of a pair: the fuzzer chooses the stranger's frames.

use std::collections::HashMap;
use std::hash::Hash;
use std::net::{Ipv4Addr, SocketAddrV4};
use std::sync::{Mutex, PoisonError};

use machine::Instant;
use machine::arp::ArpPacket;
use machine::ethernet::Mac;
use virtual_time::hostile::{PairRun, Phases, RunRecord, Script, StationPair, Stranger};

/// Returns phases long enough for a connection that is up after `up_ms`, some frames of the watchdogs, and the disconnect.
pub(crate) const fn phases(up_ms: u64) -> Phases {
    Phases {
        up: Instant::from_millis(up_ms),
        disconnect: Instant::from_millis(up_ms + 28),
        end: Instant::from_millis(up_ms + 38),
    }
}

/// Runs of pairs without a stranger, by what distinguishes the pairs.
pub(crate) type RunsAlone<K> = Mutex<HashMap<K, &'static RunRecord>>;

/// Returns the record of a pair's run without a stranger. It runs once.
pub(crate) fn alone<K: Eq + Hash, P: StationPair>(
    known: &RunsAlone<K>,
    key: K,
    phases: Phases,
    pair: impl FnOnce() -> PairRun<P>,
) -> &'static RunRecord {
    let mut known = known.lock().unwrap_or_else(PoisonError::into_inner);
    known.entry(key).or_insert_with(|| Box::leak(Box::new(pair().run_whole(None, phases).0)))
}

/// An attack on one station.
pub(crate) struct Attack {
    /// MAC and IP addresses of the pair.
    pub(crate) stations: [(Mac, Ipv4Addr); 2],
    /// When the pair connects and disconnects.
    pub(crate) phases: Phases,
    /// Index of the attacked station.
    pub(crate) target: usize,
    /// Whether the stations list each other. If not, the first station to connect is the owner, and the stranger starts at
    /// `connected`.
    pub(crate) listed: bool,
    /// When the connection is accepted.
    pub(crate) connected: Instant,
    /// Whether the stranger sends from the addresses of the target's partner.
    pub(crate) forges: bool,
    /// Address to which the stranger connects over TCP.
    pub(crate) listen: Option<SocketAddrV4>,
}

impl Attack {
    /// Runs the pair with this attack and checks that it changes nothing, compared with the run `alone`. A stranger that
    /// forges addresses may end the connection; then only a panic is an error.
    pub(crate) fn run<P: StationPair>(self, pair: PairRun<P, Script>, alone: &RunRecord, choices: Script) {
        let (start, end) = match (self.forges, self.listed) {
            (true, _) | (false, true) => (Instant::ZERO, self.phases.end),
            (false, false) => (self.connected, self.phases.disconnect),
        };
        let targets = [self.stations[self.target]; 2];
        // Whoever claims an address of the pair by ARP ends the connection, as it must.
        let mut heard = alone.sent.concat();
        heard.retain(|sent| ArpPacket::from_frame(&sent.frame).is_none());
        let stranger = Stranger::choosing(choices, &heard, targets, self.listen, (start, end));
        if self.forges {
            pair.run_with_forger(stranger, self.stations[1 - self.target], self.phases.end);
            return;
        }
        let (disturbed, _) = pair.run_whole(Some(stranger), self.phases);
        assert!(*alone == disturbed, "a stranger changed something: {}", alone.difference::<P>(&disturbed));
    }
}
