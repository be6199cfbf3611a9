//! Silence of a node: what limits every wait of the rig, however long that wait may last.

use std::fmt;
use std::time::Duration;

use ::node::role::NodeRole;
use tokio::time::Instant;

/// Interval of the looks at the nodes. Looks are counted, and no time is measured, so that a bench that was stopped itself
/// does not report its nodes.
const LOOK: Duration = Duration::from_secs(1);

/// Looks without a message after which a node is asked for its report.
const ASK_AFTER: u32 = 5;

/// Looks without a message after which a node counts as silent.
const LIMIT: u32 = 10;

/// Looks after a question without a message, after which a node counts as silent together with another one.
const UNANSWERED: u32 = ASK_AFTER + 2;

const ROLES: [NodeRole; 2] = [NodeRole::Plc, NodeRole::Robot];

/// When each node sent its last message, and which.
#[derive(Debug)]
pub(super) struct Silence {
    next_look: Instant,
    /// Of the PLC and of the robot.
    heard: [Heard; 2],
}

#[derive(Clone, PartialEq, Eq, Default, Debug)]
struct Heard {
    /// Looks since then.
    looks: u32,
    /// The last message with news, as text.
    last: Option<String>,
}

/// A node that sends nothing.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct SilentNode {
    /// Which node.
    pub role: NodeRole,
    /// Time without a message.
    pub silent: Duration,
    /// Its last message, as text; `None` if it has never sent one.
    pub last: Option<String>,
}

impl fmt::Display for SilentNode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { role, silent, last } = self;
        match last {
            Some(last) => write!(f, "the {role} has sent nothing for {} s, after `{last}`", silent.as_secs()),
            None => write!(f, "the {role} has not sent a message in {} s", silent.as_secs()),
        }
    }
}

/// Returns these nodes as text.
pub(super) fn in_words(nodes: &[SilentNode]) -> String {
    nodes.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
}

/// What follows from a look at the nodes.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) enum Look {
    /// Ask these nodes for a report; mostly none.
    Ask(Vec<NodeRole>),
    /// These nodes are silent.
    Silent(Vec<SilentNode>),
}

impl Silence {
    pub(super) fn from_now() -> Self {
        Self { next_look: Instant::now() + LOOK, heard: Default::default() }
    }

    /// Returns when to look next.
    pub(super) const fn next_look(&self) -> Instant {
        self.next_look
    }

    /// Takes a message of a node; `news` is its text, unless it only answers a question.
    pub(super) fn hear(&mut self, role: NodeRole, news: Option<String>) {
        let heard = &mut self.heard[index(role)];
        heard.looks = 0;
        if news.is_some() {
            heard.last = news;
        }
    }

    /// Looks at these nodes.
    pub(super) fn look(&mut self, present: impl Fn(NodeRole) -> bool) -> Look {
        self.next_look = Instant::now() + LOOK;
        let roles = || ROLES.into_iter().filter(|role| present(*role));
        roles().for_each(|role| self.heard[index(role)].looks += 1);
        if roles().any(|role| self.heard[index(role)].looks >= LIMIT) {
            return Look::Silent(self.silent(UNANSWERED, present));
        }
        Look::Ask(roles().filter(|role| self.heard[index(*role)].looks == ASK_AFTER).collect())
    }

    /// Returns the nodes that did not answer when they were asked.
    pub(super) fn unanswered(&self, present: impl Fn(NodeRole) -> bool) -> Vec<SilentNode> {
        self.silent(UNANSWERED, present)
    }

    fn silent(&self, looks: u32, present: impl Fn(NodeRole) -> bool) -> Vec<SilentNode> {
        let silent = |role: NodeRole| {
            let heard = &self.heard[index(role)];
            SilentNode { role, silent: LOOK * heard.looks, last: heard.last.clone() }
        };
        let roles = ROLES.into_iter().filter(|role| present(*role));
        roles.filter(|role| self.heard[index(*role)].looks >= looks).map(silent).collect()
    }
}

const fn index(role: NodeRole) -> usize {
    match role {
        NodeRole::Plc => 0,
        NodeRole::Robot => 1,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test(start_paused = true)]
    async fn a_node_is_asked_after_five_looks_and_silent_after_ten_and_another_one_is_named_with_it() {
        let mut silence = Silence::from_now();
        silence.hear(NodeRole::Plc, Some("rc started".to_owned()));
        let mut looks = Vec::new();
        for look in 1..=10 {
            if look == 3 {
                silence.hear(NodeRole::Robot, Some("connected".to_owned()));
            }
            looks.push(silence.look(|_| true));
        }
        assert_eq!(looks[4], Look::Ask(vec![NodeRole::Plc]));
        assert_eq!(looks[6], Look::Ask(vec![NodeRole::Robot]));
        let Look::Silent(nodes) = &looks[9] else { panic!("{looks:?}") };
        insta::assert_snapshot!(in_words(nodes), @"the plc-node has sent nothing for 10 s, after `rc started`; the robot-node has sent nothing for 8 s, after `connected`");
    }

    #[tokio::test(start_paused = true)]
    async fn a_node_that_answers_is_waited_for_as_long_as_it_answers() {
        let mut silence = Silence::from_now();
        for _ in 0..100 {
            match silence.look(|role| role == NodeRole::Plc) {
                Look::Ask(nodes) => nodes.into_iter().for_each(|role| silence.hear(role, None)),
                silent @ Look::Silent(_) => panic!("{silent:?}"),
            }
        }
        for _ in 0..9 {
            silence.look(|role| role == NodeRole::Plc);
        }
        let nodes = silence.unanswered(|role| role == NodeRole::Plc);
        assert_eq!(in_words(&nodes), "the plc-node has not sent a message in 9 s");
    }
}
