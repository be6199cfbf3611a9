//! What a block does while another block's skill is under way.

/// PLCopen's `BufferMode`, with its numbers.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Default, Debug)]
#[repr(u8)]
pub enum BufferMode {
    /// Cancels the skill that is under way, and the one that waits; starts once the arm stands.
    #[default]
    Aborting = 0,
    /// Waits until the skill that is under way is done. If that one is aborted or fails, so is this one.
    Buffered = 1,
    /// Refused, as all that blend: the robot blends motions of one skill, and a block is a skill of its own.
    BlendingLow = 2,
    /// Refused.
    BlendingPrevious = 3,
    /// Refused.
    BlendingNext = 4,
    /// Refused.
    BlendingHigh = 5,
}
