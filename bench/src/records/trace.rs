//! What both nodes did during one run of each type, tick by tick; [`tables`] stores it in files.
//!
//! Times count from the PLC's start edge, in virtual mode in true time.

pub mod tables;

use machine::Instant;
use plc_node::ExecutionType;
use protocol::image::State;
use virtual_time::Side;

use crate::records::results::PerType;

/// Time of a run, by the clock that both nodes of a real run share.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Window {
    /// Its execution type.
    pub execution_type: ExecutionType,
    /// Time of the scan with the start edge, in ns.
    pub start_ns: u64,
    /// Its length in ns; `None` if it failed.
    pub length_ns: Option<u64>,
}

impl Window {
    /// Returns whether an instant is in it.
    fn has(&self, at_ns: u64) -> bool {
        let since = at_ns.checked_sub(self.start_ns);
        since.is_some_and(|since| since <= self.length_ns.unwrap_or(u64::MAX))
    }
}

/// Capacity for a minute of each; what comes later is not recorded.
const ROBOT_ROOM: usize = 15_000;
const PLC_ROOM: usize = 60_000;
/// Four frames a millisecond: one each way, each seen at both ends.
pub(crate) const FRAME_ROOM: usize = 240_000;

/// One interpolation cycle of the robot.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct RobotTick {
    /// Time since the start edge, in ms.
    pub at_ms: f64,
    /// State of the skill execution.
    pub state: State,
    /// The last command number that the robot received.
    pub command: u16,
    /// Motions of the skill that the robot has executed.
    pub executed: u32,
    /// Motions of the skill that the robot has accepted.
    pub accepted: u32,
    /// Motions of the skill that ended in a stop because the next motion did not arrive in time.
    pub blends_suppressed: u16,
    /// Speed of the tool along its path in mm/s.
    pub path_speed_mm_s: f32,
    /// Pose of the tool in the base frame: x, y, z in mm; a, b, c in degrees.
    pub pose: [f32; 6],
    /// Joint values in degrees; in mm for a linear axis.
    pub joints: [f32; 6],
}

impl RobotTick {
    /// Converts a sample of the robot node, taken `at_ms` after the start edge.
    #[must_use]
    pub const fn new(at_ms: f64, sample: &robot_node::Sample) -> Self {
        Self {
            at_ms,
            state: sample.state,
            command: sample.number,
            executed: sample.executed,
            accepted: sample.accepted,
            blends_suppressed: sample.blends_suppressed,
            path_speed_mm_s: sample.path_speed_mm_s,
            pose: sample.pose,
            joints: sample.joints,
        }
    }

    /// Returns the motions that wait in the robot or are being executed.
    #[must_use]
    pub const fn queued(&self) -> u32 {
        self.accepted.saturating_sub(self.executed)
    }
}

/// One scan of the PLC.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct PlcScan {
    /// Time since the scan with the start edge, in µs.
    pub at_us: i64,
    /// Scans since the node started.
    pub scan: u64,
    /// Number of the last command.
    pub command: u16,
    /// Total motions of the skill: `totalNo`.
    pub total: u32,
    /// Motions of the skill written into the slots so far.
    pub written: u32,
    /// Motions in the slots that the robot has not executed yet.
    pub in_slots: u32,
}

impl PlcScan {
    /// Converts a sample of the PLC node, taken `at_us` after the start edge.
    #[must_use]
    pub const fn new(at_us: i64, sample: &plc_node::Sample) -> Self {
        Self {
            at_us,
            scan: sample.scans,
            command: sample.number,
            total: sample.total,
            written: sample.written,
            in_slots: sample.queue_fill,
        }
    }
}

/// A frame at one end of the cable.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Frame {
    /// Time since the start edge, in µs.
    pub at_us: f64,
    /// The end of the cable; A is the PLC's.
    pub end: Side,
    /// Whether it was sent at this end; otherwise it was received.
    pub sent: bool,
    /// The protocol that carries it.
    pub carrier: &'static str,
    /// Length of the frame, without the headers around it, in bytes.
    pub bytes: usize,
    /// Whether the cable impaired it.
    pub faulty: bool,
}

/// Recording of one run. Its memory is allocated when it is created: recording a tick allocates nothing.
#[derive(Clone, PartialEq, Debug)]
pub struct Recording {
    robot: Vec<RobotTick>,
    plc: Vec<PlcScan>,
    /// Kept in memory only, for a timeline.
    frames: Vec<Frame>,
}

impl Default for Recording {
    fn default() -> Self {
        Self { robot: Vec::with_capacity(ROBOT_ROOM), plc: Vec::with_capacity(PLC_ROOM), frames: Vec::new() }
    }
}

impl Recording {
    /// Adds a tick, if there is room.
    pub fn robot(&mut self, tick: RobotTick) {
        if self.robot.len() < self.robot.capacity() {
            self.robot.push(tick);
        }
    }

    /// Adds a scan, if there is room.
    pub fn plc(&mut self, scan: PlcScan) {
        if self.plc.len() < self.plc.capacity() {
            self.plc.push(scan);
        }
    }

    /// Adds a frame, if there is room; a minute of frames fits.
    pub fn frame(&mut self, frame: Frame) {
        if self.frames.len() < FRAME_ROOM {
            self.frames.push(frame);
        }
    }

    /// Returns the frames at both ends in order; none if they were not recorded, or if the recording was read from
    /// the tables.
    #[must_use]
    pub fn frames(&self) -> &[Frame] {
        &self.frames
    }

    /// Returns the robot's ticks in order.
    #[must_use]
    pub fn robot_ticks(&self) -> &[RobotTick] {
        &self.robot
    }

    /// Returns the PLC's scans in order.
    #[must_use]
    pub fn plc_scans(&self) -> &[PlcScan] {
        &self.plc
    }
}

/// A recording per type: of its first repetition.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct Trace {
    /// The recordings.
    pub types: PerType<Recording>,
}

impl Trace {
    /// Assigns frames to the runs in which they passed, by the clock that both nodes of a real run share.
    pub fn add_frames(&mut self, windows: &[Window], frames: Vec<(Instant, Frame)>) {
        for (at, frame) in frames {
            let at_ns = at.as_nanos();
            let Some(window) = windows.iter().rev().find(|window| window.has(at_ns)) else { continue };
            if let Some(recording) = self.types.entry(window.execution_type) {
                recording.frame(Frame { at_us: (at_ns - window.start_ns) as f64 / 1e3, ..frame });
            }
        }
    }
}

impl Recording {
    const fn empty() -> Self {
        Self { robot: Vec::new(), plc: Vec::new(), frames: Vec::new() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_recording_drops_further_scans_and_does_not_grow() {
        let mut recording = Recording { robot: Vec::new(), plc: Vec::with_capacity(2), frames: Vec::new() };
        let room = recording.plc.capacity();
        for scan in 0..room as u64 + 3 {
            recording.plc(PlcScan { at_us: 0, scan, command: 0, total: 0, written: 0, in_slots: 0 });
        }
        assert_eq!((recording.plc.len(), recording.plc.capacity()), (room, room));
    }
}
