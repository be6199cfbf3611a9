//! Records the trace of a virtual run: samples both nodes after each of their cycles.

use std::cell::RefCell;
use std::rc::Rc;
use std::time::Duration;

use super::cell::{CellNode, RobotId, VirtualCell};
use machine::Instant;
use plc_node::PlcEvent;

use super::Nodes;
use records::trace::{Frame, PlcScan, Recording, RobotTick};

/// Interval between samples; shorter than any cycle, so that no cycle is missed. Sampling takes no virtual time.
const LOOK: Duration = Duration::from_micros(100);

/// Frames of the tap that are not in the recording yet; `None` while nothing is recorded.
pub(crate) type SharedFrames = Rc<RefCell<Option<Vec<(Instant, Frame)>>>>;

/// A run that is being recorded.
#[derive(Debug)]
pub(crate) struct Watch<'a> {
    recording: &'a mut Recording,
    /// True time of the start edge; nothing is recorded before it.
    start: Option<Instant>,
    last_tick: Option<Instant>,
    last_scan: u64,
    frames: Option<SharedFrames>,
}

impl Drop for Watch<'_> {
    fn drop(&mut self) {
        if let Some(frames) = &self.frames {
            *frames.borrow_mut() = None;
        }
    }
}

impl<'a> Watch<'a> {
    pub(crate) fn new(recording: &'a mut Recording, frames: Option<SharedFrames>) -> Self {
        if let Some(frames) = &frames {
            *frames.borrow_mut() = Some(Vec::new());
        }
        Self { recording, start: None, last_tick: None, last_scan: 0, frames }
    }

    /// Returns the PLC's next event up to `until` in true time, and records what happens meanwhile.
    pub(crate) fn next_plc_event(&mut self, nodes: &mut Nodes, until: Instant) -> Option<PlcEvent> {
        while nodes.cell().now() < until {
            let event = nodes.next_event(until.min(nodes.cell().now() + LOOK));
            let cell = nodes.cell();
            if let Some(PlcEvent::Started { at, .. }) = event {
                self.start = Some(true_time(cell, CellNode::Plc, at));
            }
            self.record(cell);
            if event.is_some() {
                return event;
            }
        }
        None
    }

    fn record(&mut self, cell: &VirtualCell) {
        let Some(start) = self.start else { return };
        let since = |at: Instant| at.as_nanos() as f64 - start.as_nanos() as f64;
        if let Some(frames) = &self.frames {
            for (at, frame) in frames.borrow_mut().iter_mut().flat_map(|frames| frames.drain(..)) {
                if at >= start {
                    self.recording.frame(Frame { at_us: since(at) / 1e3, ..frame });
                }
            }
        }
        let (plc, robot) = (cell.plc(), cell.robot(RobotId::FIRST));
        if plc.scans() != self.last_scan {
            self.last_scan = plc.scans();
            let at_us = (since(cell.now()) / 1e3).round() as i64;
            let true_ns = true_time(cell, CellNode::Plc, plc.scanned_at()).as_nanos();
            self.recording.plc(PlcScan { at_us, true_ns, sample: plc.sample() });
        }
        if self.last_tick != Some(robot.ticked_at()) {
            self.last_tick = Some(robot.ticked_at());
            let at = true_time(cell, CellNode::Robot(RobotId::FIRST), robot.ticked_at());
            let (at_ms, true_ns) = (since(at) / 1e6, at.as_nanos());
            self.recording.robot(RobotTick { at_ms, true_ns, sample: robot.sample() });
        }
    }
}

/// Converts a node's clock of less than a cycle ago to true time: the drift since then is far below a nanosecond.
fn true_time(cell: &VirtualCell, node: CellNode, local: Instant) -> Instant {
    let ago = cell.local_time(node).as_nanos().saturating_sub(local.as_nanos());
    Instant::from_nanos(cell.now().as_nanos().saturating_sub(ago))
}
