//! Limit of answers over UDP: the sender of a request can be forged, and an answer is longer than its request.

use core::net::Ipv4Addr;

use machine::{Duration, Instant};

/// Time in which answers are counted.
const WINDOW: Duration = Duration::from_secs(1);

/// Largest number of answers in a [`WINDOW`]. Assumed: a few tools that each ask several times a second.
const MOST: u8 = 64;

/// Largest number of answers to one host in a [`WINDOW`], so that one host does not use up those of the others.
const MOST_OF_ONE_HOST: u8 = 16;

/// Hosts that are counted apart in a [`WINDOW`]; further ones share the rest.
const HOSTS: usize = 8;

/// Answers of the present second.
#[derive(Clone, Copy, Default, Debug)]
pub(super) struct AnswerLimit {
    since: Option<Instant>,
    answered: u8,
    hosts: [Option<(Ipv4Addr, u8)>; HOSTS],
}

impl AnswerLimit {
    /// Counts a request of a host. Returns whether it is answered.
    pub(super) fn allow(&mut self, now: Instant, host: Ipv4Addr) -> bool {
        if self.since.is_none_or(|since| now.since(since) >= WINDOW) {
            *self = Self { since: Some(now), ..Self::default() };
        }
        if self.answered >= MOST {
            return false;
        }
        let is_its = |place: &&mut Option<(Ipv4Addr, u8)>| place.is_none_or(|(counted, _)| counted == host);
        if let Some(place) = self.hosts.iter_mut().find(is_its) {
            let answered = place.map_or(0, |(_, answered)| answered);
            if answered >= MOST_OF_ONE_HOST {
                return false;
            }
            *place = Some((host, answered + 1));
        }
        self.answered += 1;
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_host_gets_sixteen_answers_a_second_and_all_together_sixty_four() {
        let mut limit = AnswerLimit::default();
        let host = |number: u8| Ipv4Addr::new(10, 0, 0, number);
        let mut count = |at, number, requests| {
            (0..requests).filter(|_| limit.allow(Instant::from_millis(at), host(number))).count()
        };
        assert_eq!(count(0, 1, 1_000), 16);
        assert_eq!(count(500, 2, 3), 3, "another host");
        assert_eq!((3..20).map(|number| count(900, number, 10)).sum::<usize>(), 45);
        assert_eq!(count(999, 30, 1), 0);
        assert_eq!(count(1_000, 1, 1_000), 16, "the next second");
    }
}
