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
use plc_node::ExecutionType;
use protocol::image::State;

use super::{PlcScan, Recording, RobotTick, Trace, Window};
use crate::records::run_directory::{Durability, replace};

/// File of the robot's ticks.
pub const ROBOT_FILE: &str = "trace-robot.csv";
/// File of the PLC's scans.
pub const PLC_FILE: &str = "trace-plc.csv";

/// File that the robot's node of a real run writes its rows to, until they are sorted into the tables.
pub const ROBOT_ROWS: &str = "trace-robot.rows";
/// File that the PLC's node writes its rows to.
pub const PLC_ROWS: &str = "trace-plc.rows";

const ROBOT_HEADER: &str = "type,t_ms,state,command,executed,accepted,queued,blends_suppressed,path_speed_mm_s,\
x_mm,y_mm,z_mm,a_deg,b_deg,c_deg,joint_1,joint_2,joint_3,joint_4,joint_5,joint_6,altered";
const PLC_HEADER: &str = "type,t_ms,scan,command,total,written,in_slots,altered";

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
        let (mut robot, mut plc) = (format!("{ROBOT_HEADER}\n"), format!("{PLC_HEADER}\n"));
        for execution_type in ExecutionType::ALL {
            let Some(recording) = self.types.get(execution_type) else { continue };
            for tick in &recording.robot {
                let RobotTick { at_ms, state, command, executed, accepted, .. } = tick;
                let _ = write!(
                    robot,
                    "{execution_type},{at_ms:.3},{state:?},{command},{executed},{accepted},{},{},{:.3}",
                    tick.queued(),
                    tick.blends_suppressed,
                    tick.path_speed_mm_s
                );
                for value in tick.pose.iter().chain(&tick.joints) {
                    let _ = write!(robot, ",{value:.4}");
                }
                let _ = writeln!(robot, ",{}", tick.altered);
            }
            for PlcScan { at_us, scan, command, total, written, in_slots, altered } in &recording.plc {
                let at_ms = *at_us as f64 / 1e3;
                let _ = writeln!(
                    plc,
                    "{execution_type},{at_ms:.3},{scan},{command},{total},{written},{in_slots},{altered}"
                );
            }
        }
        (robot, plc)
    }

    /// Sorts the rows that the nodes of a real run wrote into `directory` into the tables, and removes their files.
    ///
    /// # Errors
    ///
    /// They cannot be read, or contain something else.
    pub fn collect(directory: &Path, windows: &[Window]) -> anyhow::Result<Self> {
        let read = |path: &Path| {
            std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))
        };
        let paths = [ROBOT_ROWS, PLC_ROWS].map(|name| directory.join(name));
        let [robot, plc] = paths.each_ref().map(|path| read(path));
        let trace =
            Self::from_csv(&table(ROBOT_HEADER, &robot?, windows), &table(PLC_HEADER, &plc?, windows))?;
        for path in &paths {
            std::fs::remove_file(path).with_context(|| format!("cannot remove {}", path.display()))?;
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
        for row in rows(ROBOT_FILE, ROBOT_HEADER, robot)? {
            let (execution_type, tick) =
                row.robot_tick().ok_or(TraceError::Row { file: ROBOT_FILE, line: row.line })?;
            trace.types.entry(execution_type).get_or_insert_with(Recording::empty).robot.push(tick);
        }
        for row in rows(PLC_FILE, PLC_HEADER, plc)? {
            let (execution_type, scan) =
                row.plc_scan().ok_or(TraceError::Row { file: PLC_FILE, line: row.line })?;
            trace.types.entry(execution_type).get_or_insert_with(Recording::empty).plc.push(scan);
        }
        Ok(trace)
    }
}

/// Builds a table from the rows of each run: execution type and time since its start edge replace the clock's time. A
/// line that a killed node did not finish is left out.
fn table(header: &str, rows: &str, windows: &[Window]) -> String {
    let mut table = format!("{header}\n");
    for row in rows.lines() {
        let Some((at, rest)) = row.split_once(',') else { continue };
        let Ok(at_ns) = at.parse::<u64>() else { continue };
        let whole = row.matches(',').count() + 1 == header.matches(',').count();
        // The last one that matches: a failed run has no end.
        if let Some(window) = windows.iter().rev().find(|window| window.has(at_ns)).filter(|_| whole) {
            let at_ms = (at_ns - window.start_ns) as f64 / 1e6;
            let _ = writeln!(table, "{},{at_ms:.3},{rest}", window.execution_type);
        }
    }
    table
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

/// The fields of one line.
struct Row<'a> {
    line: usize,
    text: &'a str,
}

fn rows<'a>(
    file: &'static str,
    header: &str,
    text: &'a str,
) -> Result<impl Iterator<Item = Row<'a>>, TraceError> {
    let mut lines = text.lines();
    if lines.next() != Some(header) {
        return Err(TraceError::Columns { file });
    }
    Ok(lines.enumerate().map(|(index, text)| Row { line: index + 2, text }))
}

/// Parses the next field.
fn next<'a, T: std::str::FromStr>(fields: &mut impl Iterator<Item = &'a str>) -> Option<T> {
    fields.next()?.parse().ok()
}

impl Row<'_> {
    fn robot_tick(&self) -> Option<(ExecutionType, RobotTick)> {
        let mut fields = self.text.split(',');
        let execution_type = next(&mut fields)?;
        let at_ms = next(&mut fields)?;
        let state = match fields.next()? {
            "Halted" => State::Halted,
            "Ready" => State::Ready,
            "Running" => State::Running,
            "Suspended" => State::Suspended,
            _ => return None,
        };
        let (command, executed, accepted) = (next(&mut fields)?, next(&mut fields)?, next(&mut fields)?);
        let _queued: u32 = next(&mut fields)?;
        let mut tick = RobotTick {
            at_ms,
            state,
            command,
            executed,
            accepted,
            blends_suppressed: next(&mut fields)?,
            path_speed_mm_s: next(&mut fields)?,
            pose: [0.0; 6],
            joints: [0.0; 6],
            altered: 0,
        };
        for value in tick.pose.iter_mut().chain(&mut tick.joints) {
            *value = next(&mut fields)?;
        }
        tick.altered = next(&mut fields)?;
        fields.next().is_none().then_some((execution_type, tick))
    }

    fn plc_scan(&self) -> Option<(ExecutionType, PlcScan)> {
        let mut fields = self.text.split(',');
        let execution_type = next(&mut fields)?;
        let at_ms: f64 = next(&mut fields)?;
        let scan = PlcScan {
            at_us: (at_ms * 1e3).round() as i64,
            scan: next(&mut fields)?,
            command: next(&mut fields)?,
            total: next(&mut fields)?,
            written: next(&mut fields)?,
            in_slots: next(&mut fields)?,
            altered: next(&mut fields)?,
        };
        fields.next().is_none().then_some((execution_type, scan))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::records::results::PerType;

    fn trace() -> Trace {
        let mut recording = Recording::default();
        recording.robot(RobotTick {
            at_ms: 12.5,
            state: State::Running,
            command: 3,
            executed: 1,
            accepted: 5,
            blends_suppressed: 0,
            path_speed_mm_s: 441.75,
            pose: [1.0, -2.5, 3.0, 0.0, 0.0, 180.0],
            joints: [10.0, 20.0, 30.0, 40.0, 0.0, 0.0],
            altered: 1,
        });
        recording.plc(PlcScan {
            at_us: 13_000,
            scan: 812,
            command: 3,
            total: 13,
            written: 6,
            in_slots: 5,
            altered: 2,
        });
        Trace { types: PerType { cm: Some(recording), ..PerType::default() } }
    }

    #[test]
    fn the_tables_have_a_row_per_tick_and_a_unit_in_each_column_name() {
        let (robot, plc) = trace().to_csv();
        insta::assert_snapshot!(robot + &plc, @"
        type,t_ms,state,command,executed,accepted,queued,blends_suppressed,path_speed_mm_s,x_mm,y_mm,z_mm,a_deg,b_deg,c_deg,joint_1,joint_2,joint_3,joint_4,joint_5,joint_6,altered
        cm,12.500,Running,3,1,5,4,0,441.750,1.0000,-2.5000,3.0000,0.0000,0.0000,180.0000,10.0000,20.0000,30.0000,40.0000,0.0000,0.0000,1
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
        insta::assert_snapshot!(table(PLC_HEADER, rows, &windows), @"
        type,t_ms,scan,command,total,written,in_slots,altered
        rc,0.500,2,2,3,4,5,0
        sm,0.250,4,2,3,4,5,0
        ");
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
