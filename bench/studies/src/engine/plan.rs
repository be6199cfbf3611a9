//! A study that was read and checked: its jobs, each made from its number, without a list of them.

use std::fmt::{self, Write as _};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use anyhow::{Context as _, anyhow};
use planning::FoundCell;
use plc_node::ExecutionType;
use sha2::{Digest as _, Sha256};

use records::exit::{Exit, Failure};
use records::faults::Fault;
use setup::Cell;

use super::application::{VariedApplications, nameless, text_of, with_application};
use super::axis::Axis;
use super::checks::{axes, check, check_faults, figures, parsed_faults, seeds};
use super::file::{RowFigure, Scalar, StudyFile, TypeName};
use super::hex::hex;
use super::key::{APPLICATION, SetupKeys};
use super::point::{GridPoint, MadePoint};
use super::setup_table::SetupTable;

/// Address of a job: the first 64 bits of the SHA-256 of everything that its rows depend on.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub struct JobAddress(pub u64);

impl fmt::Display for JobAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:016x}", self.0)
    }
}

impl JobAddress {
    /// Digits of an address.
    pub const DIGITS: usize = 16;

    /// Parses 16 hexadecimal digits.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        let is_hex = text.len() == Self::DIGITS && text.bytes().all(|byte| byte.is_ascii_hexdigit());
        is_hex.then(|| u64::from_str_radix(text, 16).ok().map(Self)).flatten()
    }
}

/// A study whose file, setup and application were read and checked.
pub struct StudyPlan {
    /// The file.
    pub file: StudyFile,
    /// The setup before anything is varied.
    pub base: Cell,
    /// The applications of all jobs; `None` where they are varied.
    pub application: Option<FoundCell>,
    /// The varied keys in the order of the file.
    pub axes: Vec<Axis>,
    /// Execution types of each job.
    pub types: Vec<ExecutionType>,
    /// Figures in the rows, the usual ones first.
    pub figures: Vec<RowFigure>,
    /// Program that executes the jobs: a commit, or the digest of the program's file.
    pub program: String,
    /// Digest of all that determines the jobs besides the program.
    pub identity: String,
    table: SetupTable,
    varied: Option<VariedApplications>,
    faults: Vec<Fault>,
    seeds: (u64, u64),
    /// Digest of what all jobs have in common.
    common: Sha256,
    /// The point of the grid that was used last: all its seeds use the same plan.
    last: Mutex<Option<Arc<GridPoint>>>,
}

/// A job, made from its number.
pub struct StudyJob {
    /// Its address.
    pub address: JobAddress,
    /// Its seed.
    pub seed: u64,
    /// Its point of the grid.
    pub point: Arc<GridPoint>,
}

fn usage(error: impl Into<anyhow::Error>) -> Failure {
    Failure::new(Exit::Usage, error)
}

impl StudyPlan {
    /// Reads a study's file, its setup and its application, and checks them.
    ///
    /// # Errors
    ///
    /// One of them cannot be read or is invalid.
    pub fn read(path: &Path, program: String) -> Result<Self, Failure> {
        let origin = path.display().to_string();
        let text = setup::read_plain_text(path)
            .with_context(|| format!("cannot read the study's file {origin}"))
            .map_err(usage)?;
        let file: StudyFile = setup::read(&origin, &text)?;
        let directory = path.parent().map(Path::to_owned);
        Self::of(file, directory.as_deref(), program)
            .map_err(|failure| Failure { error: failure.error.context(origin), ..failure })
    }

    /// Checks a study; paths in it are relative to `directory`.
    ///
    /// # Errors
    ///
    /// Its setup or application cannot be read, or a value in it is invalid.
    pub fn of(file: StudyFile, directory: Option<&Path>, program: String) -> Result<Self, Failure> {
        check(&file).map_err(usage)?;
        let section = &file.study;
        let name = located(&section.setup, setup::built_in_setup(&section.setup).is_some(), directory);
        let (base, of_setup) = setup::cell(&name)?;
        let keys = SetupKeys::of(&base)?;
        let axes = axes(&file, &keys).map_err(usage)?;
        let (base, of_applications) = match &section.application {
            Some(_) if axes.iter().any(|axis| axis.path == APPLICATION) => {
                return Err(usage(anyhow!("`study.application` is given and varied; remove one of them")));
            }
            Some(name) => (with_application(base, name), directory),
            None => (base, of_setup.as_deref()),
        };
        let varied = VariedApplications::of(&name, &axes, &base, [directory, of_applications]);
        let read = || planning::applications_of(&name, &base, of_applications);
        let application = varied.is_none().then(read).transpose()?;
        let faults = parsed_faults(&section.faults.join(" ")).map_err(usage)?;
        check_faults(&faults, &base).map_err(usage)?;
        let seeds = seeds(&section.seeds).map_err(usage)?;
        let mut types: Vec<ExecutionType> = Vec::new();
        for one in section.types.iter().map(|one: &TypeName| ExecutionType::from(*one)) {
            if !types.contains(&one) {
                types.push(one);
            }
        }
        let figures = figures(&file, &base).map_err(usage)?;
        let table = SetupTable::of(&base)?;
        let common = common(&file, &base, application.as_ref(), &types)?;
        let identity = identity(&file, &common)?;
        Ok(Self {
            base,
            application,
            axes,
            types,
            figures,
            program,
            identity,
            table,
            varied,
            faults,
            seeds,
            common,
            last: Mutex::new(None),
            file,
        })
    }

    /// Returns the number of jobs; `None` if it is beyond all counting.
    #[must_use]
    pub fn jobs(&self) -> Option<u128> {
        let seeds = u128::from(self.seeds.1 - self.seeds.0) + 1;
        self.axes.iter().try_fold(seeds, |product, axis| product.checked_mul(axis.len()))
    }

    /// Returns the setup as it stands beside the rows of a study that varies applications, and those that are files, each with the name
    /// of its copy there; `None` for one that varies none.
    #[must_use]
    pub fn saved_applications(&self) -> Option<(Cell, Vec<(String, String)>)> {
        self.varied.as_ref().map(|varied| varied.saved(&self.base, &self.axes))
    }

    /// Returns the number of rows of each job.
    #[must_use]
    pub fn rows_per_job(&self) -> u64 {
        self.types.len() as u64 * u64::from(self.file.study.reps)
    }

    /// Makes a job from its number: the seed changes fastest, then the last varied key.
    #[must_use]
    pub fn job(&self, number: u128) -> StudyJob {
        let seeds = u128::from(self.seeds.1 - self.seeds.0) + 1;
        let seed = self.seeds.0 + u64::try_from(number % seeds).unwrap_or(0);
        let point = self.point(number / seeds, seed);
        let mut digest = point.digest.clone();
        digest.update(format!("seed {seed}\nprogram {}\n", self.program));
        let address = digest.finalize().iter().take(8).fold(0, |sum, byte| (sum << 8) | u64::from(*byte));
        StudyJob { address: JobAddress(address), seed, point }
    }

    /// Returns a point of the grid, with the values that are drawn for this seed.
    fn point(&self, number: u128, seed: u64) -> Arc<GridPoint> {
        let seed = self.axes.iter().any(Axis::is_drawn).then_some(seed);
        let is_same = |point: &&Arc<GridPoint>| (point.number, point.seed) == (number, seed);
        // What a thread holds is whole, also if it panicked.
        let known =
            self.last.lock().unwrap_or_else(PoisonError::into_inner).as_ref().filter(is_same).cloned();
        known.unwrap_or_else(|| {
            let point = Arc::new(self.make(number, seed));
            *self.last.lock().unwrap_or_else(PoisonError::into_inner) = Some(Arc::clone(&point));
            point
        })
    }

    fn make(&self, number: u128, seed: Option<u64>) -> GridPoint {
        let mut rest = number;
        let mut values: Vec<Scalar> = self
            .axes
            .iter()
            .rev()
            .map(|axis| {
                let value = axis.value(rest % axis.len(), seed.unwrap_or_default());
                rest /= axis.len();
                value
            })
            .collect();
        values.reverse();
        let mut sorted: Vec<_> = self.axes.iter().map(|axis| axis.path.as_str()).zip(&values).collect();
        sorted.sort_by_key(|(path, _)| *path);
        let mut digest = self.common.clone();
        for (path, value) in sorted {
            digest.update(format!("{path} = {value}\n"));
        }
        let made = self.made(&values, &mut digest);
        GridPoint { number, seed, values, made, digest }
    }

    fn made(&self, values: &[Scalar], digest: &mut Sha256) -> Result<MadePoint, String> {
        let changes = self.axes.iter().zip(values);
        let changes = changes.filter_map(|(axis, value)| Some((axis.path.as_str(), axis.key?, value)));
        let cell = self.table.with(changes).map_err(|error| error.to_string())?;
        let mut faults = self.faults.clone();
        for (axis, value) in self.axes.iter().zip(values) {
            if let (None, Some(text)) = (axis.key, value.text()) {
                faults.extend(parsed_faults(text).map_err(|error| error.to_string())?);
            }
        }
        check_faults(&faults, &cell).map_err(|error| error.to_string())?;
        let application = match (&self.application, &self.varied) {
            (None, Some(varied)) => {
                let found = varied.find(&cell);
                let found = found.as_ref().as_ref().map_err(Clone::clone)?;
                digest.update(text_of(&cell, found));
                found.clone()
            }
            (Some(application), _) => application.clone(),
            (None, None) => return Err("the study has no application".to_owned()),
        };
        MadePoint::new(cell, application, faults)
    }
}

/// Returns a name as given, or the path of a file relative to `directory`.
fn located(name: &str, is_built_in: bool, directory: Option<&Path>) -> String {
    match directory {
        Some(directory) if !is_built_in => directory.join(name).display().to_string(),
        _ => name.to_owned(),
    }
}

/// Returns the digest of what all jobs have in common.
fn common(
    file: &StudyFile,
    base: &Cell,
    application: Option<&FoundCell>,
    types: &[ExecutionType],
) -> anyhow::Result<Sha256> {
    let mut options = format!("reps {}\ntypes", file.study.reps);
    types.iter().try_for_each(|one| write!(options, " {one}"))?;
    let faults = file.study.faults.join(" ");
    let text = application.map_or_else(String::new, |found| text_of(base, found));
    let mut digest = Sha256::new();
    digest.update("skillbench job 1\n");
    for part in [setup::cell_to_toml(&nameless(base))?.as_str(), &text, &options, &faults] {
        digest.update(format!("{}:", part.len()));
        digest.update(part);
    }
    Ok(digest)
}

/// Returns the digest of the whole study besides its program. What is looked for changes no row.
fn identity(file: &StudyFile, common: &Sha256) -> anyhow::Result<String> {
    let mut file = file.clone();
    file.study.setup.clear();
    file.study.application = None;
    file.finding.clear();
    let mut digest = common.clone();
    digest.update(toml::to_string(&file)?);
    Ok(hex(&digest.finalize()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(toml: &str) -> Result<StudyPlan, String> {
        let file = toml::from_str(toml).unwrap();
        StudyPlan::of(file, None, "test".to_owned()).map_err(|failure| format!("{:#}", failure.error))
    }

    const GRID: &str = "[study]\nsetup = 'A'\nseeds = '3..=5'\nreps = 1
        [[vary]]\nkey = 'motions.approximation_mm'\nvalues = [0, 20]
        [[vary]]\nkey = 'bus.cycle_us'\nvalues = [1000, 2000, 4000]\n";

    #[test]
    fn a_grid_has_every_combination_with_every_seed_once_and_each_has_an_address_of_its_own() {
        let plan = plan(GRID).unwrap();
        assert_eq!(plan.jobs(), Some(18));
        let jobs: Vec<StudyJob> = (0..18).map(|number| plan.job(number)).collect();
        let addresses: std::collections::BTreeSet<_> = jobs.iter().map(|job| job.address).collect();
        assert_eq!(addresses.len(), 18);
        let of = |job: &StudyJob| (job.point.values.clone(), job.seed);
        assert_eq!(of(&jobs[0]), (vec![Scalar::Number(0.0), Scalar::Integer(1_000)], 3));
        assert_eq!(of(&jobs[2]), (vec![Scalar::Number(0.0), Scalar::Integer(1_000)], 5));
        assert_eq!(of(&jobs[3]), (vec![Scalar::Number(0.0), Scalar::Integer(2_000)], 3));
        assert_eq!(of(&jobs[17]), (vec![Scalar::Number(20.0), Scalar::Integer(4_000)], 5));
        let made = jobs[17].point.made.as_ref().unwrap_or_else(|error| panic!("{error}"));
        let robot = &made.cell.stations[0];
        assert_eq!((robot.motions.approximation_mm.value, robot.bus.cycle_us.value), (20.0, 4_000));
        assert_eq!(robot.bus.cycle_us.from, setup::Provenance::Assumed);
    }

    #[test]
    fn an_address_depends_on_what_is_executed_and_not_on_where_a_job_is_in_the_grid() {
        let (all, other) = (plan(GRID).unwrap(), plan(&GRID.replace("[0, 20]", "[20]")).unwrap());
        assert_eq!(all.job(9).address, other.job(0).address);
        let swapped = GRID.split("[[vary]]").collect::<Vec<_>>();
        let swapped = format!("{}[[vary]]{}[[vary]]{}", swapped[0], swapped[2], swapped[1]);
        assert_eq!(plan(&swapped).unwrap().job(17).address, all.job(17).address);
        for (part, instead) in
            [("reps = 1", "reps = 2"), ("'A'", "'B'"), ("reps = 1", "reps = 1\ntypes = ['cm']")]
        {
            let changed = plan(&GRID.replacen(part, instead, 1)).unwrap();
            assert_ne!(changed.job(0).address, all.job(0).address, "{instead}");
            assert_ne!(changed.identity, all.identity, "{instead}");
        }
        let found = plan(&format!("{GRID}[[finding]]\nfigure = 'blends_suppressed'\nabove = 0")).unwrap();
        assert_eq!(found.identity, all.identity, "a finding changes no row");
    }

    #[test]
    fn the_address_of_a_job_of_one_robot_stays() {
        insta::assert_snapshot!(plan(GRID).unwrap().job(0).address, @"0d2c4bedd1726560");
    }

    #[test]
    fn a_point_that_the_setup_cannot_have_is_a_job_with_its_reason() {
        let plan =
            plan("[study]\nsetup = 'A'\n[[vary]]\nkey = 'bus.cycle_us'\nvalues = [1000, 3000]").unwrap();
        assert!(plan.job(0).point.made.is_ok());
        let refused = plan.job(1).point.made.as_ref().err().cloned().unwrap();
        assert!(refused.contains("bus.cycle_us") && refused.contains("3000"), "{refused}");
    }

    #[test]
    fn a_wrong_study_is_refused_with_key_value_and_remedy() {
        let cases = [
            "schema = 2\n[study]\nsetup = 'A'",
            "[study]\nsetup = 'A'\nreps = 0",
            "[study]\nsetup = 'A'\ntypes = []",
            "[study]\nsetup = 'A'\nseeds = '5..=1'",
            "[study]\nsetup = 'A'\n[[vary]]\nkey = 'plc.queue_depht'\nvalues = [1]",
            "[study]\nsetup = 'A'\n[[vary]]\nkey = 'plc.queue_depth'\nvalues = [1]\n[[vary]]\nkey = 'plc.queue_depth'\nvalues = [2]",
            "[study]\nsetup = 'A'\n[[finding]]\nfigure = 'joint_jerk'\nabove = 1.0",
            "[study]\nsetup = 'A'\n[[finding]]\nfigure = 'execution_ns'",
            "[study]\nsetup = 'A'\n[record]\nfigures = ['start_skew_us']",
            "[study]\nsetup = 'E'\n[record]\nfigures = ['frames_lost']",
            "[study]\nsetup = 'E'\n[[vary]]\nkey = 'station.lft.robot.cycle_us'\nvalues = [8000]",
            "[study]\nsetup = 'E'\nfaults = ['loss=0.1']",
        ];
        let refused = cases.map(|toml| plan(toml).err().unwrap_or_else(|| format!("taken: {toml}")));
        for (fault, said) in
            [("faults = ['loss=2']", "`2`"), ("[[vary]]\nkey = 'faults'\nvalues = ['los=0.1']", "`los=0.1`")]
        {
            let refused = plan(&format!("[study]\nsetup = 'A'\n{fault}")).err().unwrap();
            assert!(refused.contains(said), "{refused}");
        }
        insta::assert_snapshot!(refused.join("\n"), @r#"
`schema` = 2: this program reads studies of version 1
`study.reps` = 0: must be 1 to 100000
`study.types` is empty; name rc, sm or cm, or leave it out for all three
`study.seeds` = "5..=1": expected a number, or two such as "1..=1000", the lower one first
[[vary]] `plc.queue_depht`: not a number, text or truth of a setup; did you mean `plc.queue_depth`?
[[vary]] `plc.queue_depth`: varied twice; put all its values into one section
[[finding]] `joint_jerk`: not in the rows; add it to `record.figures`
[[finding]] `execution_ns`: give exactly one of `above` and `below`
`record.figures` start_skew_us: needs several stations, and setup A has one; remove it
`record.figures` frames_lost: needs a setup of one robot, and setup E has 2 stations; remove it
[[vary]] `station.lft.robot.cycle_us`: setup E has no station `lft`; did you mean `left`?
`loss=0.1` names no station: write left/loss=0.1 or right/loss=0.1
"#);
    }
}
