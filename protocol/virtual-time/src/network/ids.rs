//! The numbers of a network's parts.

/// A node of a [`Network`](super::Network).
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Debug)]
pub struct NodeId(pub(crate) usize);

/// An interface of a node's host.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Debug)]
pub struct NicId(pub(super) usize);

/// A cable of a [`Network`](super::Network).
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Debug)]
pub struct CableId(pub(crate) usize);

/// A switch of a [`Network`](super::Network).
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Debug)]
pub struct SwitchId(pub(super) usize);

impl SwitchId {
    /// The switch that was added first.
    pub const FIRST: Self = Self(0);
}

impl NodeId {
    /// Returns the node's number: nodes are numbered from 0 in the order in which they were added.
    #[must_use]
    pub const fn index(self) -> usize {
        self.0
    }
}

impl CableId {
    /// Returns the cable's number: cables are numbered from 0 in the order in which they were connected.
    #[must_use]
    pub const fn index(self) -> usize {
        self.0
    }
}

/// What an end of a cable is plugged into.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Plug {
    /// An interface of a node's host.
    Nic(NicId),
    /// A port of its own at a switch.
    Switch(SwitchId),
}

impl Plug {
    pub(super) const fn is_switch(self) -> bool {
        matches!(self, Self::Switch(_))
    }
}
