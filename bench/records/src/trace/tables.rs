//! A trace as two tables in the run directory: a row per tick, a column per quantity, with the unit in its name; any
//! spreadsheet opens them:
//!
//! ```text
//! trace-robot.csv  every interpolation cycle: pose, joints, path speed, state, queue, images refused, law time driven
//! trace-plc.csv    every scan: command, motions of the skill, motions in the slots, images refused
//! ```
//!
//! Both end with `true_ns`. A cell with several stations has both for each station: `trace-robot-left.csv`.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::Context as _;
use machine::Instant;
use node::trace_row::{Fields, TraceSample, read_rows};
use plc_node::ExecutionType;

use super::{CellTrace, PlcScan, Recording, RobotTick, Trace, Window};
use crate::replacement::{Durability, replace};

/// File of the robot's ticks.
pub const ROBOT_FILE: &str = "trace-robot.csv";
/// File of the PLC's scans.
pub const PLC_FILE: &str = "trace-plc.csv";

/// File that the robot's node of a real run writes its rows to, until they are sorted into the tables.
pub const ROBOT_ROWS: &str = "trace-robot.rows";
/// File that the PLC's node writes its rows to.
pub const PLC_ROWS: &str = "trace-plc.rows";

/// Returns the name of the rows of a station's robot, where there are several.
#[must_use]
pub fn robot_rows(station: &str) -> String {
    format!("trace-robot-{station}.rows")
}

/// Returns the name of the PLC's rows for a station. Where there are several, the PLC's node makes it of [`PLC_ROWS`].
#[must_use]
pub fn plc_rows(station: &str, is_only: bool) -> String {
    if is_only { PLC_ROWS.to_owned() } else { format!("trace-plc-{station}.rows") }
}

/// Returns the header of a table: execution type, time since its start edge, the columns of a sample, and its instant.
fn header<S: TraceSample>() -> String {
    format!("type,t_ms,{},true_ns\n", S::COLUMNS)
}

/// Returns the header that older versions wrote.
fn older_header<S: TraceSample>() -> String {
    format!("type,t_ms,{}\n", S::COLUMNS.strip_suffix(S::ADDED).unwrap_or(S::COLUMNS))
}

/// Returns the name of a station's table: `trace-robot-left.csv`; without a station that of a setup of one.
#[must_use]
pub fn of_station(file: &str, station: Option<&str>) -> String {
    match (station, file.strip_suffix(".csv")) {
        (Some(station), Some(stem)) => format!("{stem}-{station}.csv"),
        _ => file.to_owned(),
    }
}

/// Appends a row of a table.
fn write_row<S: TraceSample>(
    table: &mut String,
    execution_type: ExecutionType,
    (at_ms, true_ns): (f64, u64),
    sample: &S,
) {
    let _ = write!(table, "{execution_type},{at_ms:.3},");
    sample.write(table);
    let _ = writeln!(table, ",{true_ns}");
}

impl Trace {
    /// Writes both tables into a run directory.
    ///
    /// # Errors
    ///
    /// They cannot be written.
    pub fn save(&self, directory: &Path) -> anyhow::Result<()> {
        self.save_of(directory, None)
    }

    /// Writes both tables of a station of a cell.
    ///
    /// # Errors
    ///
    /// They cannot be written.
    pub fn save_of(&self, directory: &Path, station: Option<&str>) -> anyhow::Result<()> {
        let (robot, plc) = self.to_csv();
        replace(&directory.join(of_station(ROBOT_FILE, station)), &robot, Durability::Written)?;
        replace(&directory.join(of_station(PLC_FILE, station)), &plc, Durability::Written)
    }

    /// Returns the robot's table and the PLC's.
    #[must_use]
    pub fn to_csv(&self) -> (String, String) {
        let (mut robot, mut plc) = (header::<robot_node::Sample>(), header::<plc_node::Sample>());
        for execution_type in ExecutionType::ALL {
            let Some(recording) = self.types.get(execution_type) else { continue };
            for RobotTick { at_ms, true_ns, sample } in &recording.robot {
                write_row(&mut robot, execution_type, (*at_ms, *true_ns), sample);
            }
            for PlcScan { at_us, true_ns, sample } in &recording.plc {
                write_row(&mut plc, execution_type, (*at_us as f64 / 1e3, *true_ns), sample);
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

    /// Does the same for the stations of a cell, each with rows of its own from its robot and from the PLC.
    ///
    /// # Errors
    ///
    /// The same.
    pub fn collect_stations(
        directory: &Path,
        stations: &[&str],
        windows: &[Window],
    ) -> anyhow::Result<CellTrace> {
        let read = |name: &str| {
            let path = directory.join(name);
            let text = std::fs::read_to_string(&path);
            let text = text.with_context(|| format!("cannot read {}", path.display()))?;
            std::fs::remove_file(&path).with_context(|| format!("cannot remove {}", path.display()))?;
            Ok::<_, anyhow::Error>(text)
        };
        let mut trace = CellTrace::default();
        for station in stations {
            let (robot, plc) = (read(&robot_rows(station))?, read(&plc_rows(station, stations.len() == 1))?);
            trace.stations.push(Self::from_rows(&robot, &plc, windows)?);
        }
        Ok(trace)
    }

    fn from_rows(robot: &str, plc: &str, windows: &[Window]) -> Result<Self, TraceError> {
        let mut trace = Self::default();
        for (at, sample) in read_rows(robot).map_err(|line| TraceError::Row { file: ROBOT_ROWS, line })? {
            if let Some((execution_type, since_ns)) = run_of(at, windows) {
                let (at_ms, true_ns) = (since_ns as f64 / 1e6, at.as_nanos());
                trace.recording(execution_type).robot.push(RobotTick { at_ms, true_ns, sample });
            }
        }
        for (at, sample) in read_rows(plc).map_err(|line| TraceError::Row { file: PLC_ROWS, line })? {
            if let Some((execution_type, since_ns)) = run_of(at, windows) {
                let at_us = (since_ns as f64 / 1e3).round() as i64;
                let true_ns = at.as_nanos();
                trace.recording(execution_type).plc.push(PlcScan { at_us, true_ns, sample });
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
            let (execution_type, at_ms, sample, true_ns) = row?;
            trace.recording(execution_type).robot.push(RobotTick { at_ms, true_ns, sample });
        }
        for row in rows(PLC_FILE, plc)? {
            let (execution_type, at_ms, sample, true_ns) = row?;
            let at_us = (at_ms * 1e3).round() as i64;
            trace.recording(execution_type).plc.push(PlcScan { at_us, true_ns, sample });
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

/// A row of a table: execution type, time since its start edge in ms, the sample, and its instant in ns.
type Row<S> = (ExecutionType, f64, S, u64);

/// Reads the rows of a table, also of one of an older version.
fn rows<S: TraceSample>(
    file: &'static str,
    text: &str,
) -> Result<impl Iterator<Item = Result<Row<S>, TraceError>>, TraceError> {
    let current = text.strip_prefix(&header::<S>());
    let is_older = current.is_none();
    let rows =
        current.or_else(|| text.strip_prefix(&older_header::<S>())).ok_or(TraceError::Columns { file })?;
    let row = move |line: &str| {
        let (line, true_ns) = if is_older { (line, "0") } else { line.rsplit_once(',')? };
        let mut fields = Fields::of(line);
        Some((fields.value()?, fields.value()?, fields.sample()?, true_ns.parse().ok()?))
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
            progress_us: 2_310_500,
        };
        recording.robot(RobotTick { at_ms: 12.5, true_ns: 7_012_500_000, sample });
        let sample = plc_node::Sample {
            scan: 812,
            command: 3,
            total: 13,
            written: 6,
            in_slots: 5,
            altered: 2,
            marks_come: 2,
            marks_passed: 1,
        };
        recording.plc(PlcScan { at_us: 13_000, true_ns: 7_013_000_017, sample });
        Trace { types: PerType { cm: Some(recording), ..PerType::default() } }
    }

    #[test]
    fn the_tables_have_a_row_per_tick_and_a_unit_in_each_column_name() {
        let (robot, plc) = trace().to_csv();
        insta::assert_snapshot!(robot + &plc, @"
        type,t_ms,state,command,executed,accepted,queued,blends_suppressed,path_speed_mm_s,x_mm,y_mm,z_mm,a_deg,b_deg,c_deg,joint_1,joint_2,joint_3,joint_4,joint_5,joint_6,altered,positions,progress,true_ns
        cm,12.500,Running,3,1,5,4,0,441.750,1.0000,-2.5000,3.0000,0.0000,0.0000,180.0000,10.0000000,20.0000000,30.0000000,40.0000000,0.0000000,0.0000000,1,drives,2310500,7012500000
        type,t_ms,scan,command,total,written,in_slots,altered,marks_come,marks_passed,true_ns
        cm,13.000,812,3,13,6,5,2,2,1,7013000017
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
        type,t_ms,scan,command,total,written,in_slots,altered,marks_come,marks_passed,true_ns
        rc,0.500,2,2,3,4,5,0,0,0,1500000
        sm,0.250,4,2,3,4,5,0,0,0,9250000
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

    #[test]
    fn tables_of_an_older_version_are_read_without_progress_and_instants() {
        let (robot, plc) = trace().to_csv();
        let shorter = |table: &str, columns: usize| -> String {
            let cut =
                |line: &str| line.rsplitn(columns + 1, ',').last().unwrap_or_default().to_owned() + "\n";
            table.lines().map(cut).collect()
        };
        let read = Trace::from_csv(&shorter(&robot, 2), &shorter(&plc, 3)).unwrap();
        let (found, whole) = (read.types.cm.unwrap(), trace().types.cm.unwrap());
        let sample = robot_node::Sample { progress_us: 0, ..whole.robot[0].sample };
        assert_eq!(found.robot, [RobotTick { true_ns: 0, sample, ..whole.robot[0] }]);
        let sample = plc_node::Sample { marks_come: 0, marks_passed: 0, ..whole.plc[0].sample };
        assert_eq!(found.plc, [PlcScan { true_ns: 0, sample, ..whole.plc[0] }]);
        let half = Trace::from_csv(&shorter(&robot, 1), &plc).unwrap_err();
        assert_eq!(half, TraceError::Columns { file: ROBOT_FILE });
    }
}
