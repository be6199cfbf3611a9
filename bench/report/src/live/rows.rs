//! Reads the files that the nodes' writers append to, as they grow.

use std::fs::File;
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};

use machine::Instant;
use node::trace_row::{TraceSample, read_rows};
use records::trace::tables::{ROBOT_ROWS, plc_rows, robot_rows};

/// Bytes that are read at once at most: some seconds of a node.
const AT_ONCE: u64 = 1 << 18;

/// Why a file is not followed any more.
#[derive(Debug, thiserror::Error)]
pub(super) enum RowsError {
    #[error("cannot read {}: {error}", path.display())]
    Read { path: PathBuf, error: io::Error },
    #[error("{} contains something else than rows", path.display())]
    Row { path: PathBuf },
}

/// A file of rows, followed from its beginning.
#[derive(Debug)]
pub(super) struct Rows {
    path: PathBuf,
    file: Option<File>,
    /// The end of what was read: a line without its end.
    begun: String,
}

impl Rows {
    pub(super) fn new(path: &Path) -> Self {
        Self { path: path.to_owned(), file: None, begun: String::new() }
    }

    /// Returns the rows of the PLC and of the robot at a station. The robot of a setup without stations has no name; the PLC names
    /// its rows by station only where it serves several.
    pub(super) fn of_station(directory: &Path, station: &str, is_only: bool) -> [Self; 2] {
        let robot = if station.is_empty() { ROBOT_ROWS.to_owned() } else { robot_rows(station) };
        let names = [plc_rows(station, is_only), robot];
        names.map(|name| Self::new(&directory.join(name)))
    }

    /// Returns the rows that were added since the last call. There are none as long as there is no file.
    pub(super) fn read<S: TraceSample>(&mut self) -> Result<Vec<(Instant, S)>, RowsError> {
        let broken = |error: io::Error| RowsError::Read { path: self.path.clone(), error };
        if self.file.is_none() {
            self.file = match File::open(&self.path) {
                Ok(file) => Some(file),
                Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
                Err(error) => return Err(broken(error)),
            };
        }
        let Some(file) = &mut self.file else { return Ok(Vec::new()) };
        file.by_ref().take(AT_ONCE).read_to_string(&mut self.begun).map_err(broken)?;
        let rest = self.begun.rsplit_once('\n').map_or(self.begun.len(), |(_, rest)| rest.len());
        let rows = read_rows(&self.begun).map_err(|_| RowsError::Row { path: self.path.clone() })?;
        self.begun.drain(..self.begun.len() - rest);
        Ok(rows)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write as _;

    #[test]
    fn a_growing_file_is_read_once_and_a_line_only_when_it_is_whole() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("plc.rows");
        let mut rows = Rows::new(&path);
        let mut read = || {
            let rows = rows.read::<plc_node::Sample>().unwrap();
            rows.into_iter().map(|(at, sample)| (at.as_nanos(), sample.scan)).collect::<Vec<_>>()
        };
        assert_eq!(read(), []);
        let mut file = File::create(&path).unwrap();
        file.write_all(b"10,1,2,3,4,5,0\n20,2,2,3").unwrap();
        assert_eq!(read(), [(10, 1)]);
        assert_eq!(read(), []);
        file.write_all(b",4,5,0\n30,3,2,3,4,5,0\n").unwrap();
        assert_eq!(read(), [(20, 2), (30, 3)]);
    }

    #[test]
    fn the_rows_are_those_that_the_nodes_of_one_robot_of_one_station_and_of_several_write() {
        let names = |station, is_only| {
            let rows = Rows::of_station(Path::new("run"), station, is_only);
            rows.map(|rows| rows.path.display().to_string())
        };
        assert_eq!(names("", true), ["run/trace-plc.rows", "run/trace-robot.rows"]);
        assert_eq!(names("left", true), ["run/trace-plc.rows", "run/trace-robot-left.rows"]);
        assert_eq!(names("left", false), ["run/trace-plc-left.rows", "run/trace-robot-left.rows"]);
    }

    #[test]
    fn a_file_of_something_else_is_named() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("plc.rows");
        std::fs::write(&path, "no row\n").unwrap();
        let error = Rows::new(&path).read::<plc_node::Sample>().unwrap_err().to_string();
        assert!(error.contains("plc.rows contains something else"), "{error}");
    }
}
