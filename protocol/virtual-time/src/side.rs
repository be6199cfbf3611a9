//! Which of the two machines of a pair.

/// One of the two machines of a [`Pair`](crate::Pair).
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub enum Side {
    /// The first machine; by convention the PLC.
    A,
    /// The second machine; by convention the robot.
    B,
}

impl Side {
    /// Returns 0 for A and 1 for B: the side's index in arrays with one entry per side.
    #[must_use]
    pub const fn index(self) -> usize {
        match self {
            Self::A => 0,
            Self::B => 1,
        }
    }

    /// Returns the other side.
    #[must_use]
    pub const fn other(self) -> Self {
        match self {
            Self::A => Self::B,
            Self::B => Self::A,
        }
    }
}
