//! How the flange of the arm follows from the tool that a motion leads.

use crate::Frame;

/// How the flange follows from the tool.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Flange(Option<Frame>);

impl Flange {
    /// For this tool frame. The flange itself, the common case, costs no multiplication.
    #[must_use]
    pub fn of_tool(tool: &Frame) -> Self {
        Self((*tool != Frame::IDENTITY).then(|| tool.inverse()))
    }

    /// The flange, when the tool is at `tool` in the root.
    #[must_use]
    #[inline]
    pub fn when_tool_at(&self, tool: Frame) -> Frame {
        self.0.map_or(tool, |from_tool| tool * from_tool)
    }
}
