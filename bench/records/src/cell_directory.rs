//! The directory of a run of a cell with several stations: its files have the names of those of one station.

use std::path::Path;
use std::time::Duration;

use setup::Cell;

use crate::cell_results::CellResults;
use crate::cell_sample::{CellSample, StationSample};
use crate::digest::Digests;
use crate::run_directory::{Durability, RunDirectory, quoted};
use crate::schedule::Step;
use crate::trace::CellTrace;

/// First line of the samples: a line for each repetition and station.
const SAMPLES_HEAD: &str = "type,repetition,station,execution_ms,robot_execution_ms,blends_suppressed,waiting_ms,start_skew_us,relative_pose_mm,error\n";

/// Name of the application of all stations, or of the only robot.
pub const APPLICATION: &str = "application.toml";

/// The directory of a run of a cell.
#[derive(Debug)]
pub struct CellDirectory {
    directory: RunDirectory,
    names: Vec<String>,
}

impl CellDirectory {
    /// Creates the directory, and writes the setup and the texts of its applications: the one for all stations, or that of each
    /// under its name.
    ///
    /// # Errors
    ///
    /// It has a file of a run, or cannot be written.
    pub fn create(
        path: &Path,
        cell: &Cell,
        applications: &[String],
        durability: Durability,
    ) -> anyhow::Result<Self> {
        let files = inputs(cell, applications)?;
        let inputs: Vec<_> = files.iter().map(|(name, text)| (name.as_str(), text.as_str())).collect();
        let directory = RunDirectory::begin(path, &inputs, SAMPLES_HEAD, durability)?;
        Ok(Self { directory, names: cell.names().map(str::to_owned).collect() })
    }

    /// Removes a run that ended before its first repetition began, as [`RunDirectory::discard`] does.
    pub fn discard(self) {
        self.directory.discard();
    }

    /// Returns the digests of the files that say what is run, for the results.
    #[must_use]
    pub const fn digests(&self) -> &Digests {
        self.directory.digests()
    }

    /// Returns its path.
    #[must_use]
    pub fn path(&self) -> &Path {
        self.directory.path()
    }

    /// Writes the description of the computer.
    ///
    /// # Errors
    ///
    /// The file cannot be written.
    pub fn write_host(&self, json: &str) -> anyhow::Result<()> {
        self.directory.write_host(json)
    }

    /// Writes a finished or failed repetition, and then the results so far.
    ///
    /// # Errors
    ///
    /// A file cannot be written.
    pub fn save(
        &mut self,
        step: &Step,
        outcome: &anyhow::Result<CellSample>,
        results: &CellResults,
    ) -> anyhow::Result<()> {
        self.directory.append(&sample_lines(&self.names, step, outcome))?;
        self.save_results(results)
    }

    /// Writes the tables of each station's robot, and of the PLC's scans for it.
    ///
    /// # Errors
    ///
    /// A file cannot be written.
    pub fn save_trace(&self, trace: &CellTrace) -> anyhow::Result<()> {
        let mut stations = self.names.iter().zip(&trace.stations);
        stations.try_for_each(|(name, trace)| trace.save_of(self.directory.path(), Some(name)))
    }

    /// Writes the results so far.
    ///
    /// # Errors
    ///
    /// The file cannot be written.
    pub fn save_results(&self, results: &CellResults) -> anyhow::Result<()> {
        self.directory.replace_results(&results.to_json()?)
    }
}

/// Returns the files that say what a cell runs, each with its text: the setup, and the texts of its applications. A cell made from
/// a setup of one robot has the files of that setup.
///
/// # Errors
///
/// The setup cannot be written as text.
pub fn inputs(cell: &Cell, applications: &[String]) -> anyhow::Result<Vec<(String, String)>> {
    let (mut cell, is_one) = (cell.clone(), cell.is_one());
    let mut files = Vec::with_capacity(1 + applications.len());
    if cell.application.is_some() {
        cell.application = Some(APPLICATION.to_owned());
        files.extend(applications.first().map(|text| (APPLICATION.to_owned(), text.clone())));
    } else {
        for (station, text) in cell.stations.iter_mut().zip(applications) {
            station.application =
                if is_one { APPLICATION.to_owned() } else { format!("application-{}.toml", station.name) };
            files.push((station.application.clone(), text.clone()));
        }
    }
    files.insert(0, ("setup.toml".to_owned(), setup::cell_to_toml(&cell)?));
    Ok(files)
}

/// Returns a line for each station, or one for a failed repetition.
fn sample_lines(names: &[String], step: &Step, outcome: &anyhow::Result<CellSample>) -> String {
    let Step { execution_type, repetition, .. } = step;
    let sample = match outcome {
        Ok(sample) => sample,
        Err(error) => return format!("{execution_type},{repetition},,,,,,,,{}\n", quoted(error)),
    };
    let millis = |time: Duration| time.as_nanos() as f64 / 1e6;
    let skew = sample.start_skew.map_or_else(String::new, |it| (it.as_nanos() as f64 / 1e3).to_string());
    let pose = sample.relative_pose_mm.map_or_else(String::new, |it| it.to_string());
    let line = |(name, one): (&String, &StationSample)| {
        format!(
            "{execution_type},{repetition},{name},{},{},{},{},{skew},{pose},\n",
            millis(sample.execution),
            millis(one.robot_execution),
            one.blends_suppressed,
            millis(one.waited),
        )
    };
    names.iter().zip(&sample.stations).map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use plc_node::ExecutionType;

    #[test]
    fn every_repetition_is_a_line_for_each_station_or_one_line_if_it_failed() {
        let step = |repetition| Step {
            execution_type: ExecutionType::Cm,
            repetition,
            pause: Duration::ZERO,
            overrides: None,
        };
        let station = |robot_us| StationSample {
            robot_execution: Duration::from_micros(robot_us),
            blends_suppressed: 0,
            waited: Duration::from_millis(12),
            waited_for_zones: None,
            came: Vec::new(),
        };
        let sample = CellSample {
            execution: Duration::from_micros(5_520_250),
            start_skew: Some(Duration::from_millis(19)),
            relative_pose_mm: Some(0.25),
            stations: vec![station(5_000_500), station(5_200_000)],
        };
        let failed = Err(anyhow::anyhow!("the robot said \"no\"\nand stopped").context("station left"));
        let names = ["left".to_owned(), "right".to_owned()];
        let lines = [sample_lines(&names, &step(1), &Ok(sample)), sample_lines(&names, &step(2), &failed)];
        insta::assert_snapshot!(lines.concat(), @r#"
        cm,1,left,5520.25,5000.5,0,12,19000,0.25,
        cm,1,right,5520.25,5200,0,12,19000,0.25,
        cm,2,,,,,,,,"station left: the robot said ""no"" and stopped"
        "#);
    }
}
