//! A trace as two tables in the run directory: a row per tick, a column per quantity, with the unit in its name; any
//! spreadsheet opens them:
//!
//! ```text
//! trace-robot.csv  every interpolation cycle: pose, joints, path speed, state, queue, images refused
//! trace-plc.csv    every scan: command, motions of the skill, motions in the slots, images refused
//! ```

use std::fmt::Write as _;
use std::path::Path;

use anyhow::Context as _;
use machine::Instant;
use node::trace_row::{Fields, TraceSample, read_rows};
use plc_node::ExecutionType;

use super::{PlcScan, Recording, RobotTick, Trace, Window};
use crate::run_directory::{Durability, replace};

/// File of the robot's ticks.
pub const ROBOT_FILE: &str = "trace-robot.csv";
/// File of the PLC's scans.
pub const PLC_FILE: &str = "trace-plc.csv";

/// File that the robot's node of a real run writes its rows to, until they are sorted into the tables.
pub const ROBOT_ROWS: &str = "trace-robot.rows";
/// File that the PLC's node writes its rows to.
pub const PLC_ROWS: &str = "trace-plc.rows";

/// Returns the header of a table: execution type, time since its start edge, and the columns of a sample.
fn header<S: TraceSample>() -> String {
    format!("type,t_ms,{}\n", S::COLUMNS)
}

/// Appends a row of a table.
fn write_row<S: TraceSample>(table: &mut String, execution_type: ExecutionType, at_ms: f64, sample: &S) {
    let _ = write!(table, "{execution_type},{at_ms:.3},");
    sample.write(table);
    table.push('\n');
}

impl Trace {
    /// Writes both tables into a run directory.
    ///
    /// # Errors
    ///
    /// They cannot be written.
    pub fn save(&self, directory: &Path) -> anyhow::Result<()> {
        let (robot, plc) = self.to_csv();
        replace(&directory.join(ROBOT_FILE), &robot, Durability::Written)?;
        replace(&directory.join(PLC_FILE), &plc, Durability::Written)
    }

    /// Returns the robot's table and the PLC's.
    #[must_use]
    pub fn to_csv(&self) -> (String, String) {
        let (mut robot, mut plc) = (header::<robot_node::Sample>(), header::<plc_node::Sample>());
        for execution_type in ExecutionType::ALL {
            let Some(recording) = self.types.get(execution_type) else { continue };
            for RobotTick { at_ms, sample } in &recording.robot {
                write_row(&mut robot, execution_type, *at_ms, sample);
            }
            for PlcScan { at_us, sample } in &recording.plc {
                write_row(&mut plc, execution_type, *at_us as f64 / 1e3, sample);
            }
        }
        (robot, plc)
    }

    /// Sorts the rows that the nodes of a real run wrote into `directory` by run, and removes their files. Rows between two
    /// runs are left out.
    ///
    /// # Errors
    ///
    /// They cannot be read, or contain something else.
    pub fn collect(directory: &Path, windows: &[Window]) -> anyhow::Result<Self> {
        let paths = [ROBOT_ROWS, PLC_ROWS].map(|name| directory.join(name));
        let [robot, plc] = paths.each_ref().map(|path| {
            std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))
        });
        let trace = Self::from_rows(&robot?, &plc?, windows)?;
        for path in &paths {
            std::fs::remove_file(path).with_context(|| format!("cannot remove {}", path.display()))?;
        }
        Ok(trace)
    }

    fn from_rows(robot: &str, plc: &str, windows: &[Window]) -> Result<Self, TraceError> {
        let mut trace = Self::default();
        for (at, sample) in read_rows(robot).map_err(|line| TraceError::Row { file: ROBOT_ROWS, line })? {
            if let Some((execution_type, since_ns)) = run_of(at, windows) {
                trace
                    .recording(execution_type)
                    .robot
                    .push(RobotTick { at_ms: since_ns as f64 / 1e6, sample });
            }
        }
        for (at, sample) in read_rows(plc).map_err(|line| TraceError::Row { file: PLC_ROWS, line })? {
            if let Some((execution_type, since_ns)) = run_of(at, windows) {
                let at_us = (since_ns as f64 / 1e3).round() as i64;
                trace.recording(execution_type).plc.push(PlcScan { at_us, sample });
            }
        }
        Ok(trace)
    }

    /// Reads both tables; the recordings have no room for more rows.
    ///
    /// # Errors
    ///
    /// A line does not have the columns of this version, or contains a wrong value.
    pub fn from_csv(robot: &str, plc: &str) -> Result<Self, TraceError> {
        let mut trace = Self::default();
        for row in rows(ROBOT_FILE, robot)? {
            let (execution_type, at_ms, sample) = row?;
            trace.recording(execution_type).robot.push(RobotTick { at_ms, sample });
        }
        for row in rows(PLC_FILE, plc)? {
            let (execution_type, at_ms, sample) = row?;
            let at_us = (at_ms * 1e3).round() as i64;
            trace.recording(execution_type).plc.push(PlcScan { at_us, sample });
        }
        Ok(trace)
    }

    /// Returns the recording of a type, to add what was read.
    fn recording(&mut self, execution_type: ExecutionType) -> &mut Recording {
        self.types.entry(execution_type).get_or_insert_with(Recording::empty)
    }
}

/// Returns the run in which a node's cycle was, and the time since its start edge in ns.
fn run_of(at: Instant, windows: &[Window]) -> Option<(ExecutionType, u64)> {
    let at_ns = at.as_nanos();
    // The last one that matches: a failed run has no end.
    let window = windows.iter().rev().find(|window| window.has(at_ns))?;
    Some((window.execution_type, at_ns - window.start_ns))
}

/// Why a table cannot be read.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub enum TraceError {
    /// It has other columns.
    #[error("{file} does not have the columns of this version; record the run again")]
    Columns {
        /// The file.
        file: &'static str,
    },
    /// A row has the wrong form.
    #[error("{file}:{line} is not a row of the table")]
    Row {
        /// The file.
        file: &'static str,
        /// Its line, counted from 1.
        line: usize,
    },
}

/// Reads the rows of a table: execution type, time since its start edge in ms, and the sample.
fn rows<S: TraceSample>(
    file: &'static str,
    text: &str,
) -> Result<impl Iterator<Item = Result<(ExecutionType, f64, S), TraceError>>, TraceError> {
    let rows = text.strip_prefix(&header::<S>()).ok_or(TraceError::Columns { file })?;
    let row = |line| {
        let mut fields = Fields::of(line);
        Some((fields.value()?, fields.value()?, fields.sample()?))
    };
    // The header is line 1.
    Ok(rows.lines().zip(2..).map(move |(text, line)| row(text).ok_or(TraceError::Row { file, line })))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::PerType;
    use protocol::image::State;

    fn trace() -> Trace {
        let mut recording = Recording::default();
        let sample = robot_node::Sample {
            state: State::Running,
            command: 3,
            executed: 1,
            accepted: 5,
            blends_suppressed: 0,
            path_speed_mm_s: 441.75,
            pose: [1.0, -2.5, 3.0, 0.0, 0.0, 180.0],
            joints: [10.0, 20.0, 30.0, 40.0, 0.0, 0.0],
            altered: 1,
            positions: robot_node::Positions::Drives,
        };
        recording.robot(RobotTick { at_ms: 12.5, sample });
        let sample =
            plc_node::Sample { scan: 812, command: 3, total: 13, written: 6, in_slots: 5, altered: 2 };
        recording.plc(PlcScan { at_us: 13_000, sample });
        Trace { types: PerType { cm: Some(recording), ..PerType::default() } }
    }

    #[test]
    fn the_tables_have_a_row_per_tick_and_a_unit_in_each_column_name() {
        let (robot, plc) = trace().to_csv();
        insta::assert_snapshot!(robot + &plc, @"
        type,t_ms,state,command,executed,accepted,queued,blends_suppressed,path_speed_mm_s,x_mm,y_mm,z_mm,a_deg,b_deg,c_deg,joint_1,joint_2,joint_3,joint_4,joint_5,joint_6,altered,positions
        cm,12.500,Running,3,1,5,4,0,441.750,1.0000,-2.5000,3.0000,0.0000,0.0000,180.0000,10.0000000,20.0000000,30.0000000,40.0000000,0.0000000,0.0000000,1,drives
        type,t_ms,scan,command,total,written,in_slots,altered
        cm,13.000,812,3,13,6,5,2
        ");
    }

    #[test]
    fn rows_of_a_real_run_are_sorted_by_run_and_rows_between_runs_are_left_out() {
        let window = |execution_type, start_ns, length_ns| Window { execution_type, start_ns, length_ns };
        let windows = [
            window(ExecutionType::Rc, 1_000_000, Some(2_000_000)),
            window(ExecutionType::Sm, 9_000_000, None),
        ];
        let rows =
            "900000,1,2,3,4,5,0\n1500000,2,2,3,4,5,0\n5000000,3,2,3,4,5,0\n9250000,4,2,3,4,5,0\n9300000,5,2";
        let trace = Trace::from_rows("", rows, &windows).unwrap();
        insta::assert_snapshot!(trace.to_csv().1, @"
        type,t_ms,scan,command,total,written,in_slots,altered
        rc,0.500,2,2,3,4,5,0
        sm,0.250,4,2,3,4,5,0
        ");
        let broken = Trace::from_rows("", "900000,1,2,3,4,5,0\n9300000,5,2\n", &windows).unwrap_err();
        assert_eq!(broken.to_string(), "trace-plc.rows:2 is not a row of the table");
    }

    #[test]
    fn tables_are_read_back_as_written_and_a_broken_line_is_reported() {
        let (robot, plc) = trace().to_csv();
        assert_eq!(Trace::from_csv(&robot, &plc), Ok(trace()));
        let broken = Trace::from_csv(&robot, &plc.replace("812", "-812")).unwrap_err().to_string();
        assert_eq!(broken, "trace-plc.csv:2 is not a row of the table");
        assert_eq!(Trace::from_csv("", &plc), Err(TraceError::Columns { file: ROBOT_FILE }));
    }
}
