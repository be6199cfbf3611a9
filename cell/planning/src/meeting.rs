//! Whether the arms of an application meet at every mark, or wait for each other for ever.

use std::fmt;

use crate::arms::{ArmApplication, ArmsApplication};

/// Why arms do not meet.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum NoMeeting {
    /// No arm has the mark.
    Nobody {
        /// The mark.
        mark: u32,
    },
    /// Only one arm has the mark.
    OnlyOne {
        /// The mark.
        mark: u32,
        /// The arm.
        arm: String,
    },
    /// Arms wait for each other in a ring: each arm and the mark at which it waits for the next one.
    Ring {
        /// The arms with their marks; the last one waits for the first.
        waiting: Vec<(String, u32)>,
    },
    /// The arms of a mark are to move together to the next mark, which is not the same one for them.
    NotTogether {
        /// The mark from which they move together.
        mark: u32,
        /// Each arm and its next mark.
        next: Vec<(String, Option<u32>)>,
    },
}

impl NoMeeting {
    /// Returns the mark at which they do not meet.
    #[must_use]
    pub fn mark(&self) -> u32 {
        match self {
            Self::Nobody { mark } | Self::OnlyOne { mark, .. } | Self::NotTogether { mark, .. } => *mark,
            Self::Ring { waiting } => waiting.first().map_or(0, |(_, mark)| *mark),
        }
    }
}

impl fmt::Display for NoMeeting {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Nobody { .. } => {
                f.write_str("no arm waits there; add it to the steps of two arms, or remove it")
            }
            Self::OnlyOne { mark, arm } => write!(
                f,
                "only arm `{arm}` waits there, and nobody comes; add {{ mark = {mark} }} to another arm, or remove it"
            ),
            Self::Ring { waiting } => {
                let next = waiting.iter().cycle().skip(1);
                for (index, ((arm, mark), (other, _))) in waiting.iter().zip(next).enumerate() {
                    let gap = if index == 0 { "" } else { ", " };
                    write!(f, "{gap}arm `{arm}` waits at mark {mark} for `{other}`")?;
                }
                f.write_str(": give them one order in all arms")
            }
            Self::NotTogether { next, .. } => {
                f.write_str("its arms move together to their next mark, which must be the same: ")?;
                for (index, (arm, mark)) in next.iter().enumerate() {
                    let gap = if index == 0 { "" } else { ", " };
                    match mark {
                        Some(mark) => write!(f, "{gap}`{arm}` has mark {mark}")?,
                        None => write!(f, "{gap}`{arm}` has none")?,
                    }
                }
                Ok(())
            }
        }
    }
}

/// Checks that every mark is one of two arms at least, and that no order of events leaves an arm waiting.
///
/// An arm waits at its next mark until all arms of that mark are there. So it does not matter how fast each is: either all
/// pass all their marks, or some wait in a ring.
pub(crate) fn check(application: &ArmsApplication) -> Result<(), NoMeeting> {
    let arms = &application.arms;
    for mark in application.marks.iter().map(|mark| mark.number) {
        let mut those = arms.iter().filter(|arm| arm.marks().any(|it| it == mark));
        match (those.next(), those.next()) {
            (Some(_), Some(_)) => {}
            (Some(arm), None) => return Err(NoMeeting::OnlyOne { mark, arm: arm.name.clone() }),
            _ => return Err(NoMeeting::Nobody { mark }),
        }
    }
    let mut waits: Vec<_> = arms.iter().map(|arm| (arm, arm.marks().peekable())).collect();
    loop {
        let next: Vec<(&ArmApplication, Option<u32>)> =
            waits.iter_mut().map(|(arm, marks)| (*arm, marks.peek().copied())).collect();
        let has = |arm: &ArmApplication, mark| arm.marks().any(|it| it == mark);
        // An arm of the mark that is not there has it still to come: it has each mark once, and marks pass for all at once.
        let is_complete = |mark| next.iter().all(|(arm, at)| *at == Some(mark) || !has(arm, mark));
        let Some(passes) = next.iter().filter_map(|(_, at)| *at).find(|mark| is_complete(*mark)) else {
            return ring(&next).map_or(Ok(()), Err);
        };
        for (_, marks) in &mut waits {
            marks.next_if_eq(&passes);
        }
        let mark = application.marks.iter().find(|mark| mark.number == passes);
        if mark.is_some_and(|mark| mark.together) {
            together(
                passes,
                &waits.iter_mut().map(|(arm, marks)| (*arm, marks.peek().copied())).collect::<Vec<_>>(),
            )?;
        }
    }
}

/// Checks that the arms which have passed a mark from which they move together have one next mark.
fn together(mark: u32, next: &[(&ArmApplication, Option<u32>)]) -> Result<(), NoMeeting> {
    let those: Vec<_> = next.iter().filter(|(arm, _)| arm.marks().any(|it| it == mark)).collect();
    let first = those.first().and_then(|(_, next)| *next);
    if first.is_some() && those.iter().all(|(_, next)| *next == first) {
        return Ok(());
    }
    let next = those.iter().map(|(arm, next)| (arm.name.clone(), *next)).collect();
    Err(NoMeeting::NotTogether { mark, next })
}

/// Returns a ring of arms that wait for each other, if any arm still waits: each for one that does not come to its mark, and
/// waits itself.
fn ring(next: &[(&ArmApplication, Option<u32>)]) -> Option<NoMeeting> {
    let waits_for = |index: usize| {
        let mark = next.get(index)?.1?;
        next.iter().position(|(arm, at)| *at != Some(mark) && arm.marks().any(|it| it == mark))
    };
    let mut at = next.iter().position(|(_, mark)| mark.is_some())?;
    let mut passed = Vec::new();
    while !passed.contains(&at) {
        passed.push(at);
        at = waits_for(at)?;
    }
    let first = passed.iter().position(|index| *index == at)?;
    let waiting = passed.iter().skip(first).filter_map(|index| {
        let (arm, mark) = next.get(*index)?;
        Some((arm.name.clone(), (*mark)?))
    });
    Some(NoMeeting::Ring { waiting: waiting.collect() })
}
