//! The paper's two arms compared: how much of the difference between the setups the arms themselves make.

use serde::{Deserialize, Serialize};

/// AET of RC on the paper's two arms, in virtual time, and on each with the motions as they are programmed on the other.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Arms {
    /// Setup A, in ms.
    pub a_ms: f64,
    /// Setup B, in ms.
    pub b_ms: f64,
    /// Setup B's arm with Setup A's programmed motions, in ms.
    pub b_as_a_ms: f64,
    /// Setup A's arm with Setup B's programmed motions, in ms.
    pub a_as_b_ms: f64,
}

impl Arms {
    /// Returns the shares of the difference between the setups that are left where both arms run one setup's programmed
    /// motions: those of A, and those of B.
    #[must_use]
    pub fn shares(&self) -> [f64; 2] {
        let difference_ms = self.b_ms - self.a_ms;
        [(self.b_as_a_ms - self.a_ms) / difference_ms, (self.b_ms - self.a_as_b_ms) / difference_ms]
    }
}
