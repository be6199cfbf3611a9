//! The check that the arms of a cell can take turns in its shared zones, whatever the order of events, and never wait in a ring.
//!
//! An arm does in its order: it waits for a zone that another arm is in, it waits at a mark for the other arms of that mark, and it
//! leaves zones. Leaving and passing a mark never keep another arm from going on, so only the order in which arms take zones
//! decides. Where no arm waits for anything while it is in a zone, no ring is possible; otherwise all orders are tried.

use std::collections::BTreeSet;
use std::fmt;

use crate::plan::Plan;

/// Most states of all arms together that are tried.
const MOST_STATES: usize = 500_000;

/// Reason for which arms cannot take turns in the shared zones.
#[derive(Clone, PartialEq, Debug)]
pub enum NoTurns {
    /// An arm starts in a zone, so that nobody can grant it.
    StartsIn {
        /// The stations that do.
        stations: Vec<String>,
        /// The zone.
        zone: String,
    },
    /// An arm ends in a zone, and nobody else can enter it any more.
    EndsIn {
        /// The station.
        station: String,
        /// The zone.
        zone: String,
    },
    /// Two arms would be in each other at their starts.
    InTheWay {
        /// The stations.
        stations: [String; 2],
        /// Depth of their volumes in each other, in mm.
        depth_mm: f64,
    },
    /// Arms wait for each other in a ring: each station, what it waits for, and the last one for the first.
    Ring {
        /// The stations with what each waits for.
        waiting: Vec<(String, Waited)>,
    },
    /// There are more orders than can be tried.
    TooMany,
}

/// An event for which a station waits.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Waited {
    /// The arms of a mark.
    Mark(u32),
    /// A shared zone.
    Zone(String),
}

impl fmt::Display for NoTurns {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::StartsIn { stations, zone } if stations.len() > 1 => {
                let stations = stations.join("`, `");
                write!(f, "the arms `{stations}` all start in it; move their starts or zone `{zone}`")
            }
            Self::StartsIn { stations, zone } => {
                let station = stations.first().map_or("", String::as_str);
                write!(f, "arm `{station}` starts in it; move its start or zone `{zone}`")
            }
            Self::EndsIn { station, zone } => {
                write!(f, "arm `{station}` ends in zone `{zone}`; add a step that leads it out")
            }
            Self::InTheWay { stations: [one, other], depth_mm } => write!(
                f,
                "at their starts the arms `{one}` and `{other}` are {depth_mm:.1} mm in each other; move a start or a root_mm_deg"
            ),
            Self::Ring { waiting } => {
                let next = waiting.iter().cycle().skip(1);
                for (index, ((station, waited), (other, _))) in waiting.iter().zip(next).enumerate() {
                    let gap = if index == 0 { "" } else { ", " };
                    match waited {
                        Waited::Mark(mark) => {
                            write!(f, "{gap}arm `{station}` waits at mark {mark} for `{other}`")?
                        }
                        Waited::Zone(zone) => {
                            write!(f, "{gap}arm `{station}` waits for zone `{zone}`, which `{other}` is in")?
                        }
                    }
                }
                f.write_str(": let an arm leave its zone before it waits")
            }
            Self::TooMany => write!(
                f,
                "more than {MOST_STATES} orders in which arms wait for marks and zones while they are in a zone; let them leave \
                 first"
            ),
        }
    }
}

impl NoTurns {
    /// Returns the key of the setup at which the fault is reported.
    pub(crate) fn key(&self) -> String {
        match self {
            Self::StartsIn { zone, .. } | Self::EndsIn { zone, .. } => format!("shared_zone.{zone}"),
            Self::InTheWay { stations: [_, other], .. } => format!("station.{other}.root_mm_deg"),
            Self::Ring { .. } | Self::TooMany => "shared_zone".to_owned(),
        }
    }
}

/// An action of an arm that concerns others.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
enum Event {
    // The order is that at one place: the PLC sees the arm leave, then it passes marks, then it asks for zones.
    Leave(usize),
    Mark(u32),
    Enter(usize),
}

/// The events of an arm in its order.
fn events(plan: &Plan) -> Vec<Event> {
    let leaves = plan.visits.iter().map(|visit| (visit.until, 0, Event::Leave(visit.zone)));
    let marks = plan.waits.iter().map(|wait| (wait.after, 1, Event::Mark(wait.mark)));
    let enters = plan.visits.iter().map(|visit| (visit.after, 2, Event::Enter(visit.zone)));
    let mut events: Vec<_> = leaves.chain(marks).chain(enters).collect();
    // Marks at one place keep their order.
    events.sort_by_key(|(after, kind, _)| (*after, *kind));
    events.into_iter().map(|(.., event)| event).collect()
}

/// Checks that the arms, each with the name of its station, can take turns in the zones of these names in every order of events.
///
/// # Errors
///
/// [`NoTurns::Ring`], [`NoTurns::TooMany`]
pub fn check_turns(arms: &[(&str, &Plan)], zones: &[String]) -> Result<(), NoTurns> {
    let name = |zone: usize| zones.get(zone).cloned().unwrap_or_default();
    let all: Vec<Vec<Event>> = arms.iter().map(|(_, plan)| events(plan)).collect();
    if all.iter().all(|events| waits_nowhere_in_a_zone(events)) {
        return Ok(());
    }
    let orders = Orders { arms: &all };
    match orders.ring()? {
        None => Ok(()),
        Some(ring) => {
            let waiting = ring.into_iter().filter_map(|(arm, event)| {
                let waited = match event {
                    Event::Mark(mark) => Waited::Mark(mark),
                    Event::Enter(zone) | Event::Leave(zone) => Waited::Zone(name(zone)),
                };
                Some((arms.get(arm)?.0.to_owned(), waited))
            });
            Err(NoTurns::Ring { waiting: waiting.collect() })
        }
    }
}

/// Returns whether an arm waits for nothing while it is in a zone.
fn waits_nowhere_in_a_zone(events: &[Event]) -> bool {
    let mut inside = 0_usize;
    events.iter().all(|event| match event {
        Event::Leave(_) => {
            inside = inside.saturating_sub(1);
            true
        }
        Event::Mark(_) => inside == 0,
        Event::Enter(_) => {
            inside += 1;
            inside == 1
        }
    })
}

/// All orders of the events of some arms.
struct Orders<'a> {
    arms: &'a [Vec<Event>],
}

/// Number of events that each arm has done.
type Done = Vec<u32>;

impl Orders<'_> {
    fn next(&self, arm: usize, done: &[u32]) -> Option<Event> {
        let at = usize::try_from(*done.get(arm)?).ok()?;
        self.arms.get(arm)?.get(at).copied()
    }

    /// Returns the arm that is in a zone.
    fn holder(&self, zone: usize, done: &[u32]) -> Option<usize> {
        self.arms.iter().zip(done).position(|(events, done)| {
            let before = events.iter().take(usize::try_from(*done).unwrap_or(usize::MAX));
            before.fold(false, |is_in, event| match event {
                Event::Enter(entered) if *entered == zone => true,
                Event::Leave(left) if *left == zone => false,
                _ => is_in,
            })
        })
    }

    /// Returns an arm that has a mark still to come, and does not wait there.
    fn missing_at(&self, mark: u32, done: &[u32]) -> Option<usize> {
        self.arms.iter().zip(done).enumerate().position(|(arm, (events, done_here))| {
            let rest = events.iter().skip(usize::try_from(*done_here).unwrap_or(usize::MAX));
            self.next(arm, done) != Some(Event::Mark(mark))
                && rest.into_iter().any(|it| *it == Event::Mark(mark))
        })
    }

    /// Lets all arms do what keeps nobody from anything: they leave zones, and pass marks at which all are.
    fn settle(&self, done: &mut Done) {
        loop {
            let mut is_settled = true;
            for arm in 0..self.arms.len() {
                let passed: Vec<usize> = match self.next(arm, done) {
                    Some(Event::Leave(_)) => vec![arm],
                    Some(Event::Mark(mark)) if self.missing_at(mark, done).is_none() => (0..self.arms.len())
                        .filter(|it| self.next(*it, done) == Some(Event::Mark(mark)))
                        .collect(),
                    _ => continue,
                };
                is_settled = false;
                for arm in passed {
                    if let Some(done) = done.get_mut(arm) {
                        *done += 1;
                    }
                }
            }
            if is_settled {
                return;
            }
        }
    }

    /// Returns the ring of arms that wait for each other in some order, if there is one.
    fn ring(&self) -> Result<Option<Vec<(usize, Event)>>, NoTurns> {
        let mut known = BTreeSet::new();
        let mut open = vec![vec![0; self.arms.len()]];
        while let Some(mut done) = open.pop() {
            self.settle(&mut done);
            if !known.insert(done.clone()) {
                continue;
            }
            if known.len() > MOST_STATES {
                return Err(NoTurns::TooMany);
            }
            let mut can_go_on = false;
            for arm in 0..self.arms.len() {
                if let Some(Event::Enter(zone)) = self.next(arm, &done)
                    && self.holder(zone, &done).is_none_or(|holder| holder == arm)
                {
                    let mut then = done.clone();
                    if let Some(then) = then.get_mut(arm) {
                        *then += 1;
                    }
                    open.push(then);
                    can_go_on = true;
                }
            }
            let waits = (0..self.arms.len()).any(|arm| self.next(arm, &done).is_some());
            if waits && !can_go_on {
                return Ok(Some(self.ring_in(&done)));
            }
        }
        Ok(None)
    }

    /// Follows who waits for whom until an arm comes again.
    fn ring_in(&self, done: &[u32]) -> Vec<(usize, Event)> {
        let waits_for = |arm: usize| {
            let event = self.next(arm, done)?;
            let other = match event {
                Event::Mark(mark) => self.missing_at(mark, done),
                Event::Enter(zone) => self.holder(zone, done),
                Event::Leave(_) => None,
            };
            Some((event, other?))
        };
        let mut at = (0..self.arms.len()).find(|arm| self.next(*arm, done).is_some());
        let mut passed: Vec<(usize, Event)> = Vec::new();
        while let Some((arm, (event, other))) = at.and_then(|arm| Some((arm, waits_for(arm)?))) {
            if let Some(first) = passed.iter().position(|(known, _)| *known == arm) {
                return passed.split_off(first);
            }
            passed.push((arm, event));
            at = Some(other);
        }
        passed
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::WaitAt;
    use crate::plan::ZoneVisit;

    /// A plan with these waits (mark, after) and visits (zone, after, until).
    fn plan(waits: &[(u32, usize)], visits: &[(usize, usize, usize)]) -> Plan {
        let wait = |(mark, after): &(u32, usize)| WaitAt {
            mark: *mark,
            after: *after,
            after_action: false,
            signal: None,
        };
        let visit = |(zone, after, until): &(usize, usize, usize)| ZoneVisit {
            zone: *zone,
            after: *after,
            until: *until,
        };
        Plan {
            waits: waits.iter().map(wait).collect(),
            visits: visits.iter().map(visit).collect(),
            ..Plan::default()
        }
    }

    fn said(arms: &[Plan]) -> String {
        let names = ["left", "right", "third"];
        let arms: Vec<_> = names.iter().copied().zip(arms).collect();
        let zones = ["table", "rack"].map(str::to_owned);
        check_turns(&arms, &zones).map_or_else(|ring| ring.to_string(), |()| "they take turns".to_owned())
    }

    #[test]
    fn zones_and_marks_that_wait_for_each_other_are_a_ring_and_the_same_in_turn_are_none() {
        let crossed = [plan(&[], &[(0, 1, 4), (1, 2, 3)]), plan(&[], &[(1, 1, 4), (0, 2, 3)])];
        let in_turn = [plan(&[], &[(0, 1, 4), (1, 2, 3)]), plan(&[], &[(0, 1, 4), (1, 2, 3)])];
        // The left arm waits at a mark in the zone that the right one needs before it comes there.
        let marked = [plan(&[(1, 2)], &[(0, 1, 3)]), plan(&[(1, 3)], &[(0, 1, 2)])];
        let mark_first = [plan(&[(1, 1)], &[(0, 1, 3)]), plan(&[(1, 3)], &[(0, 1, 2)])];
        // Whether the right arm is there first decides, so that it must be refused.
        let by_chance = [plan(&[(1, 2)], &[(0, 1, 3)]), plan(&[(1, 4)], &[(0, 1, 2)])];
        let of_three =
            [plan(&[(1, 2)], &[(0, 1, 3)]), plan(&[(1, 1), (2, 2)], &[]), plan(&[(2, 4)], &[(0, 1, 3)])];
        let cells = [&crossed[..], &in_turn, &marked, &mark_first, &by_chance, &of_three];
        insta::assert_snapshot!(cells.map(said).join("\n"), @"
        arm `left` waits for zone `rack`, which `right` is in, arm `right` waits for zone `table`, which `left` is in: let an arm leave its zone before it waits
        they take turns
        arm `left` waits at mark 1 for `right`, arm `right` waits for zone `table`, which `left` is in: let an arm leave its zone before it waits
        they take turns
        arm `left` waits at mark 1 for `right`, arm `right` waits for zone `table`, which `left` is in: let an arm leave its zone before it waits
        they take turns
        ");
    }
}
