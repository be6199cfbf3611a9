//! The run directory of a measurement that no bench ran.

use std::path::{Path, PathBuf};
use std::time::SystemTime;

use planning::Found;
use setup::Setup;

use crate::COMMIT;
use records::exit::{Exit, Failure};
use records::host::Host;
use records::origin::{MeasuredType, SampleOrigin};
use records::paper::PaperComparison;
use records::results::{PerType, Results};
use records::run_directory::{self, Durability, RunDirectory};
use report::pages::{self, Pages, WantedPages};
use report::{errln, outln, table};

/// A measurement that no bench ran.
pub(super) struct MeasuredElsewhere<'a> {
    pub(super) setup: &'a Setup,
    pub(super) found: &'a Found,
    pub(super) origin: SampleOrigin,
    pub(super) types: &'a PerType<MeasuredType>,
    pub(super) began: SystemTime,
}

impl MeasuredElsewhere<'_> {
    /// Returns the results, without simulated figures.
    pub(super) fn results(&self) -> Results {
        let (setup, application) = (self.setup, &self.found.application);
        let comparison = PaperComparison::of(setup, application, None, &[]);
        let results = Results::measured(setup, &application.name, self.origin.clone(), self.types);
        results.with_paper(setup, comparison).without_calibration()
    }

    /// Saves the run in this directory or one below `runs`, and prints its table.
    pub(super) fn save(&self, out: Option<&Path>, results: Results) -> Result<Exit, Failure> {
        let mode = self.origin.kind.mode();
        let path = out
            .map_or_else(|| run_directory::default_path(&self.setup.name, mode, self.began), PathBuf::from);
        let mut directory =
            RunDirectory::create(&path, self.setup, &self.found.text, None, Durability::Synced)?;
        let results = Results { digests: Some(directory.digests().clone()), ..results };
        let saved = self.host_json().and_then(|host| directory.write_host(&host));
        let saved = saved.and_then(|()| directory.save_measured(self.types, &results));
        if let Err(error) = saved {
            directory.discard();
            return Err(error.into());
        }
        outln!("{}", table::render(&results));
        let shown = path.display();
        outln!("  Saved in {shown}.");
        match pages::write(&path, WantedPages::BOTH) {
            Ok(Pages { report, .. }) => outln!("  Report: {}.", report.display()),
            Err(Failure { error, .. }) => {
                errln!("warning: the results are saved, but their report is not: {error:#}")
            }
        }
        Ok(Exit::Pass)
    }

    /// Describes when it was measured, and by which version it was read. This computer measured nothing.
    fn host_json(&self) -> anyhow::Result<String> {
        let host = Host::read(self.began, COMMIT);
        let host = Host {
            kernel: None,
            cpu: None,
            cores: None,
            clock_source: None,
            governor: None,
            scheduling: None,
            ..host
        };
        Ok(host.to_json()?)
    }
}

/// Returns the name of a file without its directory.
pub(super) fn file_name(path: &Path) -> String {
    path.file_name().map_or_else(|| path.display().to_string(), |name| name.to_string_lossy().into_owned())
}
