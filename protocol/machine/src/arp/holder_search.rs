//! Finds the stations that have each of several addresses, as a machine.

use alloc::vec::Vec;
use core::net::Ipv4Addr;

use super::{ArpPacket, ETHERNET, Holders};
use crate::ethernet::Mac;
use crate::search::SearchEnded;
use crate::{Duration, Instant, Machine, Port, PortRequest, Source, Transmit};

/// Time from the first question about an address to the first one about the next address.
const STAGGER: Duration = Duration::from_millis(1);

/// Time for answers after the last question is done. Small devices answer within tens of ms.
const LAST_ANSWERS: Duration = Duration::from_millis(150);

/// Asks by ARP who has each of several addresses, three times each. It reports [`SearchEnded`].
///
/// For n addresses it takes n ms and about 200 ms.
#[derive(Clone, Debug)]
pub struct HolderSearch {
    own: Ipv4Addr,
    holders: Vec<(Ipv4Addr, Holders)>,
    /// Number of addresses about which questions have begun.
    begun: usize,
    /// When the questions about the next address begin, or when the search ends.
    due: Option<Instant>,
    is_ending: bool,
    report_end: bool,
}

impl HolderSearch {
    /// Creates a search that begins at `start`, by the station `mac` with the address `own`; without one it probes.
    #[must_use]
    pub fn new(mac: Mac, own: Option<Ipv4Addr>, addresses: Vec<Ipv4Addr>, start: Instant) -> Self {
        let holders = addresses.into_iter().map(|address| (address, Holders::new(mac))).collect();
        let own = own.unwrap_or(Ipv4Addr::UNSPECIFIED);
        Self { own, holders, begun: 0, due: Some(start), is_ending: false, report_end: false }
    }

    /// Returns each address with the stations that said that they have it, in the order in which they answered. This station
    /// itself is left out.
    pub fn found(&self) -> impl Iterator<Item = (Ipv4Addr, Vec<Mac>)> {
        self.holders.iter().map(|(address, holders)| (*address, holders.found().collect()))
    }

    fn begin_next(&mut self, now: Instant) {
        if let Some((address, holders)) = self.holders.get_mut(self.begun) {
            // A question from the address that it asks for would be an announcement.
            if *address == self.own {
                holders.probe(now, *address)
            } else {
                holders.ask(now, self.own, *address)
            }
            self.begun += 1;
        }
        self.due = (self.begun < self.holders.len()).then(|| now + STAGGER);
    }
}

impl Machine for HolderSearch {
    type Event = SearchEnded;

    fn ports(&self) -> &[PortRequest] {
        &[ETHERNET]
    }

    fn handle_frame(&mut self, _now: Instant, from: Source, frame: &[u8]) {
        if from.port != Port::Ethernet || self.is_ending && self.due.is_none() {
            return;
        }
        let Some(Ok(packet)) = ArpPacket::from_frame(frame) else { return };
        for (_, holders) in self.holders.iter_mut().filter(|(address, _)| *address == packet.sender_address) {
            holders.handle(&packet);
        }
    }

    fn handle_timeout(&mut self, now: Instant) {
        for (_, holders) in &mut self.holders {
            holders.handle_timeout(now);
        }
        if self.due.is_some_and(|due| due <= now) {
            if self.is_ending {
                (self.due, self.report_end) = (None, true);
                return;
            }
            self.begin_next(now);
        }
        if !self.is_ending
            && self.begun == self.holders.len()
            && self.holders.iter().all(|(_, holders)| holders.is_done())
        {
            (self.is_ending, self.due) = (true, Some(now + LAST_ANSWERS));
        }
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        let len = self.holders.iter_mut().find_map(|(_, holders)| holders.poll_transmit(now, buf))?;
        Some(Transmit { port: Port::Ethernet, to: None, len })
    }

    fn poll_event(&mut self) -> Option<SearchEnded> {
        core::mem::take(&mut self.report_end).then_some(SearchEnded)
    }

    fn poll_timeout(&self) -> Option<Instant> {
        let holders = self.holders.iter().filter_map(|(_, holders)| holders.poll_timeout()).min();
        Instant::earlier(self.due, holders)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const OWN: Mac = Mac([2, 0, 0, 0, 0, 1]);
    const DEVICES: [Mac; 2] = [Mac([2, 0, 0, 0, 0, 2]), Mac([2, 0, 0, 0, 0, 3])];

    const FROM: Source = Source { port: Port::Ethernet, peer: None };

    fn address(host: u8) -> Ipv4Addr {
        Ipv4Addr::new(192, 168, 0, host)
    }

    /// Runs a search in which the devices answer each question about address 2. Returns it, its questions and its end.
    fn run(own: Option<Ipv4Addr>, addresses: Vec<Ipv4Addr>) -> (HolderSearch, Vec<ArpPacket>, Instant) {
        let mut search = HolderSearch::new(OWN, own, addresses, Instant::ZERO);
        let mut questions = Vec::new();
        let mut now = Instant::ZERO;
        while search.poll_event().is_none() {
            now = search.poll_timeout().unwrap();
            search.handle_timeout(now);
            let mut buf = [0; 64];
            while let Some(Transmit { len, .. }) = search.poll_transmit(now, &mut buf) {
                let question = ArpPacket::from_frame(&buf[..len]).unwrap().unwrap();
                questions.push(question);
                for mac in DEVICES.iter().filter(|_| question.target_address == address(2)) {
                    let len = question.answer(*mac).emit_frame(&mut buf).unwrap();
                    search.handle_frame(now, FROM, &buf[..len]);
                }
            }
        }
        assert_eq!((search.poll_timeout(), search.poll_event()), (None, None));
        (search, questions, now)
    }

    #[test]
    fn each_address_is_asked_for_three_times_and_all_that_have_it_are_kept() {
        let (search, questions, end) = run(Some(address(1)), vec![address(2), address(3)]);
        let found: Vec<_> = search.found().collect();
        assert_eq!(found, [(address(2), DEVICES.to_vec()), (address(3), Vec::new())]);
        let about = |host| questions.iter().filter(|it| it.target_address == address(host)).count();
        assert_eq!((about(2), about(3)), (3, 3));
        assert!(questions.iter().all(|it| it.sender_address == address(1)));
        assert_eq!(end, Instant::from_millis(1 + 60 + 150));
    }

    #[test]
    fn the_own_address_and_any_address_without_an_own_one_are_probed() {
        for own in [Some(address(2)), None] {
            let (search, questions, _) = run(own, vec![address(2)]);
            assert!(questions.iter().all(ArpPacket::is_probe), "{questions:?}");
            assert_eq!(search.found().next(), Some((address(2), DEVICES.to_vec())));
        }
    }

    #[test]
    fn a_search_for_no_address_ends_and_asks_nothing() {
        let (search, questions, _) = run(None, Vec::new());
        assert_eq!((search.found().count(), questions.len()), (0, 0));
    }
}
