//! Silence of a node: what limits every wait of the rig, however long that wait may last.

use std::fmt;
use std::time::Duration;

use tokio::time::Instant;

use super::rig_node::{NodeName, RigNode};

/// Interval of the looks at the nodes. Looks are counted, and no time is measured, so that a bench that was stopped itself
/// does not report its nodes.
const LOOK: Duration = Duration::from_secs(1);

/// Looks without a message after which a node is asked for its report.
const ASK_AFTER: u32 = 5;

/// Looks without a message after which a node counts as silent.
const LIMIT: u32 = 10;

/// Looks after a question without a message, after which a node counts as silent together with another one.
const UNANSWERED: u32 = ASK_AFTER + 2;

/// When each node sent its last message, and which.
#[derive(Debug)]
pub(super) struct Silence {
    next_look: Instant,
    /// Each node, the PLC first.
    heard: Vec<Heard>,
}

#[derive(Clone, PartialEq, Eq, Debug)]
struct Heard {
    name: NodeName,
    /// Looks since then.
    looks: u32,
    /// The last message with news, as text.
    last: Option<String>,
}

/// A node that sends nothing.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct SilentNode {
    /// Which node.
    pub node: NodeName,
    /// Time without a message.
    pub silent: Duration,
    /// Its last message, as text; `None` if it has never sent one.
    pub last: Option<String>,
}

impl fmt::Display for SilentNode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { node, silent, last } = self;
        match last {
            Some(last) => write!(f, "the {node} has sent nothing for {} s, after `{last}`", silent.as_secs()),
            None => write!(f, "the {node} has not sent a message in {} s", silent.as_secs()),
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
    Ask(Vec<RigNode>),
    /// These nodes are silent.
    Silent(Vec<SilentNode>),
}

impl Silence {
    /// Begins now with these nodes, the PLC first.
    pub(super) fn from_now(nodes: impl Iterator<Item = NodeName>) -> Self {
        let heard = nodes.map(|name| Heard { name, looks: 0, last: None });
        Self { next_look: Instant::now() + LOOK, heard: heard.collect() }
    }

    /// Returns when to look next.
    pub(super) const fn next_look(&self) -> Instant {
        self.next_look
    }

    /// Takes a message of a node; `news` is its text, unless it only answers a question.
    pub(super) fn hear(&mut self, node: RigNode, news: Option<String>) {
        let Some(heard) = self.heard.get_mut(node.index()) else { return };
        heard.looks = 0;
        if news.is_some() {
            heard.last = news;
        }
    }

    /// Looks at these nodes.
    pub(super) fn look(&mut self, present: impl Fn(RigNode) -> bool) -> Look {
        self.next_look = Instant::now() + LOOK;
        for (node, heard) in RigNode::all(self.robots()).zip(&mut self.heard) {
            heard.looks += u32::from(present(node));
        }
        let there = || self.of(&present);
        if there().any(|(_, heard)| heard.looks >= LIMIT) {
            return Look::Silent(self.unanswered(present));
        }
        let asked = there().filter(|(_, heard)| heard.looks == ASK_AFTER);
        Look::Ask(asked.map(|(node, _)| node).collect())
    }

    /// Returns the nodes that did not answer when they were asked.
    pub(super) fn unanswered(&self, present: impl Fn(RigNode) -> bool) -> Vec<SilentNode> {
        let silent = self.of(&present).filter(|(_, heard)| heard.looks >= UNANSWERED);
        let silent = silent.map(|(_, Heard { name, looks, last })| SilentNode {
            node: name.clone(),
            silent: LOOK * *looks,
            last: last.clone(),
        });
        silent.collect()
    }

    /// Returns those of the nodes that are present.
    fn of(&self, present: impl Fn(RigNode) -> bool) -> impl Iterator<Item = (RigNode, &Heard)> {
        RigNode::all(self.robots()).zip(&self.heard).filter(move |(node, _)| present(*node))
    }

    const fn robots(&self) -> usize {
        self.heard.len().saturating_sub(1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ::node::role::NodeRole;

    fn pair() -> Silence {
        Silence::from_now([NodeRole::Plc, NodeRole::Robot].map(NodeName::from).into_iter())
    }

    #[tokio::test(start_paused = true)]
    async fn a_node_is_asked_after_five_looks_and_silent_after_ten_and_another_one_is_named_with_it() {
        let mut silence = pair();
        silence.hear(RigNode::Plc, Some("rc started".to_owned()));
        let mut looks = Vec::new();
        for look in 1..=10 {
            if look == 3 {
                silence.hear(RigNode::Robot(0), Some("connected".to_owned()));
            }
            looks.push(silence.look(|_| true));
        }
        assert_eq!(looks[4], Look::Ask(vec![RigNode::Plc]));
        assert_eq!(looks[6], Look::Ask(vec![RigNode::Robot(0)]));
        let Look::Silent(nodes) = &looks[9] else { panic!("{looks:?}") };
        insta::assert_snapshot!(in_words(nodes), @"the plc-node has sent nothing for 10 s, after `rc started`; the robot-node has sent nothing for 8 s, after `connected`");
    }

    #[tokio::test(start_paused = true)]
    async fn a_node_that_answers_is_waited_for_as_long_as_it_answers() {
        let mut silence = pair();
        for _ in 0..100 {
            match silence.look(|node| node == RigNode::Plc) {
                Look::Ask(nodes) => nodes.into_iter().for_each(|node| silence.hear(node, None)),
                silent @ Look::Silent(_) => panic!("{silent:?}"),
            }
        }
        for _ in 0..9 {
            silence.look(|node| node == RigNode::Plc);
        }
        let nodes = silence.unanswered(|node| node == RigNode::Plc);
        assert_eq!(in_words(&nodes), "the plc-node has not sent a message in 9 s");
    }
}
