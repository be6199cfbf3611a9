//! `bench trajectory`: a finely planned path as one MoveContinuousSkill in virtual time, and how fast the arm drives it.
//!
//! ```text
//! points    the path: a list of coordinates; gcode reads the other form
//! form      motions in slots, or compact points
//! figures   speed, deviation and what limits them, from the robot's ticks
//! picture   the speed over the path
//! ```

mod figures;
mod form;
mod gcode;
mod picture;
mod points;

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context as _, anyhow};
use clap::{Args, ValueEnum};
use plc_node::ExecutionType;
use protocol::image::{Motion, MotionKind};
use records::exit::{Exit, Failure};
use records::run_directory::{Durability, check_replaceable, replace};
use records::schedule::Step;
use records::trace::{Recording, RobotTick};
use report::{errln, outln};
use robot_node::RobotConfig;
use robot_node::motion::Segment;
use serde::Serialize;
use setup::{Refill, Setup};
use stands::virtual_run::{Extras, VirtualRun, Work};

use crate::outputs::{self, Own};
use crate::setup_option::SetupOption;

pub use figures::{AcceptedPerCycle, SpeedLimit, SpeedLimits, TrajectoryFigures};
pub use form::SentForm;
pub use points::{LineError, PathPoint, PathPoints};

use figures::ProgrammedPath;
use form::SentPath;

/// Version of the JSON.
const SCHEMA_VERSION: u32 = 1;

/// Velocity and acceleration of the PTP to the first point, in 0.01 % of the rated ones.
const APPROACH: u16 = 5_000;

const EXAMPLES: &str = "\
Examples:
  bench trajectory circle.csv --speed 500 --queue 64 --refill accepted
      points as a spline on Setup A, with 64 motions known
  bench trajectory part.ngc --as lin --spacing 0.5 --export-svg part.svg
      G-code as lines of half a millimetre, and a picture of the speed";

/// Form of the steps from point to point.
#[derive(Clone, Copy, PartialEq, Eq, Debug, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum StepKind {
    /// Lines with a corner at each point.
    Lin,
    /// One curve through all points.
    Spline,
}

/// The count by which the PLC refills slots.
#[derive(Clone, Copy, PartialEq, Eq, Debug, ValueEnum)]
pub enum RefillBy {
    /// Motions that are executed, as in the paper.
    Executed,
    /// Motions that the robot has accepted.
    Accepted,
}

/// Options of a trajectory.
#[derive(Args, Debug)]
#[command(after_help = EXAMPLES)]
pub struct TrajectoryOptions {
    /// The path: coordinates (.csv: x,y,z or x,y,z,a,b,c in mm and degrees) or G-code (.ngc, .nc, .gcode, .tap).
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// Which setup.
    #[command(flatten)]
    pub setup: SetupOption,
    /// Form of the steps from point to point.
    #[arg(long = "as", value_name = "KIND", default_value = "spline")]
    pub kind: StepKind,
    /// Cut longer steps into equal ones of at most this length, and arcs of G-code into such points [default: as in the file; 1 on
    /// arcs].
    #[arg(long, value_name = "MM", value_parser = above_zero)]
    pub spacing: Option<f64>,
    /// Programmed speed in mm/s [default: F of the G-code, else 250].
    #[arg(long, value_name = "MM_S", value_parser = above_zero)]
    pub speed: Option<f64>,
    /// Programmed acceleration in mm/s² [default: the highest of the setup].
    #[arg(long, value_name = "MM_S2", value_parser = above_zero)]
    pub acceleration: Option<f64>,
    /// Approximation distance of lines in mm. A spline passes through its points.
    #[arg(long, value_name = "MM", default_value_t = 0.5, value_parser = above_zero)]
    pub zone: f64,
    /// Angles a, b, c of the tool in degrees where the file gives none.
    #[arg(long, value_name = "A,B,C", default_value = "0,0,180", value_parser = angles)]
    pub turn: [f64; 3],
    /// Number of the tool.
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u8).range(0..=15))]
    pub tool: u8,
    /// Number of the base.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(0..=15))]
    pub base: u8,
    /// The count by which the PLC refills slots [default: that of the setup].
    #[arg(long, value_name = "COUNT")]
    pub refill: Option<RefillBy>,
    /// Motions that the robot keeps, 5 to 200 [default: that of the setup].
    #[arg(long, value_name = "N")]
    pub queue: Option<u32>,
    /// Form of the image's bytes 36..256: motions in five slots, or compact points.
    #[arg(long, value_name = "FORM", default_value = "full")]
    pub form: SentForm,
    /// Length of a step of compact points in µm, 0.01 to 10 [default: the finest that carries the longest step].
    #[arg(long, value_name = "UM", value_parser = above_zero)]
    pub resolution: Option<f64>,
    /// Seed of the clocks and phases.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Write the figures as JSON.
    #[arg(long, value_name = "FILE")]
    pub export_json: Option<PathBuf>,
    /// Write each robot cycle: time, place, speed and counts.
    #[arg(long, value_name = "FILE")]
    pub export_csv: Option<PathBuf>,
    /// Draw the speed over the path.
    #[arg(long, value_name = "FILE")]
    pub export_svg: Option<PathBuf>,
}

fn above_zero(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|number: &f64| number.is_finite() && *number > 0.0);
    number.ok_or_else(|| format!("`{text}`: must be a number above 0"))
}

fn angles(text: &str) -> Result<[f64; 3], String> {
    let all: Option<Vec<f64>> = text.split(',').map(|text| text.trim().parse().ok()).collect();
    let all = all.and_then(|all| <[f64; 3]>::try_from(all).ok());
    all.filter(|all| all.iter().all(|angle| angle.abs() <= 360.0))
        .ok_or_else(|| format!("`{text}`: must be three angles in degrees, such as 0,0,180"))
}

/// The JSON.
#[derive(Serialize)]
struct Export<'a> {
    schema_version: u32,
    setup: &'a str,
    file: String,
    steps: StepKind,
    points: usize,
    programmed_mm_s: f64,
    programmed_mm_s2: f64,
    zone_mm: f64,
    queue_motions: u32,
    refill: Refill,
    form: SentForm,
    resolution_um: Option<f64>,
    seed: u64,
    #[serde(flatten)]
    figures: &'a TrajectoryFigures,
    digits_needed: Option<u32>,
}

/// Drives the path and prints its figures.
///
/// # Errors
///
/// The file, the setup or an option cannot be used, a motion is refused, or the run fails.
pub fn run(options: &TrajectoryOptions) -> Result<Exit, Failure> {
    let asked = [
        ("--export-json", options.export_json.as_deref()),
        ("--export-csv", options.export_csv.as_deref()),
        ("--export-svg", options.export_svg.as_deref()),
    ];
    let read = [("the path", Some(options.file.as_path())), ("the setup", options.setup.file())];
    outputs::check(&asked, &read, Own::default())?;
    asked.iter().filter_map(|(_, file)| *file).try_for_each(check_replaceable)?;
    let usage = |error| Failure::new(Exit::Usage, error);
    let (setup, _) = setup::setup_with_directory(options.setup.name())?;
    let setup = options.vary(setup);
    setup::check(&setup)?;
    let path = options.read().map_err(usage)?;
    let mut programmed = options.programmed(&setup, &path);
    let motions = options.motions(&setup, &path, programmed).map_err(usage)?;
    let failed = |error| Failure::new(Exit::RunFailed, error);
    let sent = options.sent(motions, &path).map_err(usage)?;
    programmed.resolution_um = sent.resolution_um;
    let recording = drive(&setup, sent, options.seed).map_err(failed)?;
    let counted = programmed.resolution_um.map(|_| form::with_first_point(recording.robot_ticks()));
    let ticks = counted.as_deref().unwrap_or_else(|| recording.robot_ticks());
    if recording.is_cut_off() {
        errln!(
            "warning: the path takes longer than the recorded time; the figures are those of its first part"
        );
    }
    let figures = TrajectoryFigures::of(&setup, &path, programmed, ticks).ok_or_else(|| {
        failed(anyhow!("the path is too short to measure a speed on it: less than three robot cycles"))
    })?;
    let jerk = setup.robot.path_jerk_mm_s3.value;
    let digits = figures.limits.digits_needed(&path, figures.spacing_mm, jerk);
    options.print(&setup, &path, programmed, &figures, digits);
    let export = Export {
        schema_version: SCHEMA_VERSION,
        setup: &setup.name,
        file: options.file.display().to_string(),
        steps: options.kind,
        points: path.points.len(),
        programmed_mm_s: programmed.speed_mm_s,
        programmed_mm_s2: programmed.acceleration_mm_s2,
        zone_mm: options.zone,
        queue_motions: setup.robot.queue_holds(),
        refill: setup.plc.refills_by(),
        form: options.form,
        resolution_um: programmed.resolution_um,
        seed: options.seed,
        figures: &figures,
        digits_needed: digits,
    };
    if let Some(file) = &options.export_json {
        write(file, &outputs::json(&export)?)?;
    }
    if let Some(file) = &options.export_csv {
        write(file, &rows(ticks))?;
    }
    if let Some(file) = &options.export_svg {
        write(file, &picture::draw(ticks, programmed.speed_mm_s)?)?;
    }
    Ok(Exit::Pass)
}

fn write(file: &Path, text: &str) -> anyhow::Result<()> {
    replace(file, text, Durability::Written)
}

/// Largest file of a path in bytes: some five million points, more than the recorded time has room for.
const MOST_BYTES: u64 = 256 << 20;

/// Columns of `--export-csv`.
pub const CSV_HEADER: &str = "t_ms,x_mm,y_mm,z_mm,path_speed_mm_s,executed,accepted,blends_suppressed";

/// Returns the robot's cycles on the path as CSV.
fn rows(ticks: &[RobotTick]) -> String {
    let mut text = format!("{CSV_HEADER}\n");
    for tick in figures::on_path(ticks) {
        let [x, y, z, ..] = tick.sample.pose;
        let sample = &tick.sample;
        let (speed, executed, accepted) = (sample.path_speed_mm_s, sample.executed, sample.accepted);
        let _ = writeln!(
            text,
            "{:.6},{x},{y},{z},{speed},{executed},{accepted},{}",
            tick.at_ms, sample.blends_suppressed
        );
    }
    text
}

/// Executes the path as one skill.
fn drive(setup: &Setup, sent: SentPath, seed: u64) -> anyhow::Result<Recording> {
    let work = Work::sent(setup, sent.source, sent.to_start)?;
    let mut run = VirtualRun::start_on(setup, work, seed, &Extras::default())?;
    let mut recording = Recording::default();
    let step =
        Step { execution_type: ExecutionType::Cm, repetition: 1, pause: Duration::ZERO, overrides: None };
    run.execute_recorded(step, &mut recording)?;
    Ok(recording)
}

impl TrajectoryOptions {
    fn vary(&self, mut setup: Setup) -> Setup {
        if let Some(queue) = self.queue {
            setup = setup.with_queue_motions(queue);
        }
        if self.form == SentForm::Compact {
            setup = setup.with_compact_points();
        }
        match self.refill {
            Some(RefillBy::Executed) => setup.with_refill(Refill::Executed),
            Some(RefillBy::Accepted) => setup.with_refill(Refill::Accepted),
            None => setup,
        }
    }

    fn read(&self) -> anyhow::Result<PathPoints> {
        let file = &self.file;
        let extension = file.extension().and_then(|it| it.to_str()).unwrap_or_default().to_ascii_lowercase();
        let text = || {
            setup::read_plain_text_within(file, MOST_BYTES)
                .with_context(|| format!("cannot read {}", file.display()))
        };
        let points = match extension.as_str() {
            "csv" => PathPoints::from_csv(&text()?),
            "ngc" | "nc" | "gcode" | "tap" => gcode::read(&text()?, self.spacing),
            _ => anyhow::bail!("{}: must end with .csv, .ngc, .nc, .gcode or .tap", file.display()),
        };
        let spaced = points.and_then(|points| match self.spacing {
            Some(spacing) => points.spaced(spacing),
            None => Ok(points),
        });
        spaced.map_err(|error| anyhow!("{}:{}: {}", file.display(), error.line, error.problem))
    }

    fn programmed(&self, setup: &Setup, path: &PathPoints) -> ProgrammedPath {
        let of_file = path.points.iter().filter_map(|point| point.speed).fold(0.0, f64::max);
        let speed = self.speed.unwrap_or(if of_file > 0.0 { of_file } else { 250.0 });
        ProgrammedPath {
            speed_mm_s: speed,
            acceleration_mm_s2: self.acceleration.unwrap_or(setup.robot.path_acceleration_mm_s2.value),
            is_lines: self.kind == StepKind::Lin,
            resolution_um: None,
        }
    }

    /// Returns the motions in the form in which the PLC sends them.
    fn sent(&self, motions: Vec<Motion>, path: &PathPoints) -> anyhow::Result<SentPath> {
        match self.form {
            SentForm::Full if self.resolution.is_some() => {
                Err(anyhow!("--resolution is of compact points; add --form compact"))
            }
            SentForm::Full => Ok(SentPath::full(motions)),
            SentForm::Compact => SentPath::compact(&motions, path, self.turn, self.resolution)
                .with_context(|| format!("{}: no compact points", self.file.display())),
        }
    }

    /// Returns the motions: a PTP to the first point, and one to each other. Each is checked as the robot does.
    fn motions(
        &self,
        setup: &Setup,
        path: &PathPoints,
        programmed: ProgrammedPath,
    ) -> anyhow::Result<Vec<Motion>> {
        let config = RobotConfig::from_setup(setup)?;
        let whole = |what: &str, value: f64, unit: &str| {
            let rounded = value.round();
            match rounded {
                1.0..=65535.0 => Ok(rounded as u16),
                _ => Err(anyhow!("{what}: {value} {unit} does not fit the process image: 1 to 65535")),
            }
        };
        let acceleration = whole("--acceleration", programmed.acceleration_mm_s2, "mm/s²")?;
        let approximation = whole("--zone", self.zone * 100.0, "× 0.01 mm")?;
        let mut from = config.home;
        let mut motions = Vec::with_capacity(path.points.len());
        for (index, point) in path.points.iter().enumerate() {
            let speed = self.speed.or(point.speed).unwrap_or(programmed.speed_mm_s);
            let [[x, y, z], [a, b, c]] = [point.place, point.turn.unwrap_or(self.turn)];
            let common = Motion {
                target: [x, y, z, a, b, c].map(|coordinate| coordinate as f32),
                tool: self.tool,
                base: self.base,
                ..Motion::EMPTY
            };
            let motion = match (index, self.kind) {
                (0, _) => Motion {
                    kind: MotionKind::PtpCartesian,
                    velocity: APPROACH,
                    acceleration: APPROACH,
                    ..common
                },
                (_, kind) => Motion {
                    kind: if kind == StepKind::Lin { MotionKind::LinCartesian } else { MotionKind::Spline },
                    velocity: whole("speed", speed * 10.0, "× 0.1 mm/s")?,
                    acceleration,
                    approximation,
                    ..common
                },
            };
            let segment = Segment::prepare(&motion, &from, &config).map_err(|violation| {
                let fault = violation.finding().in_words(violation.number());
                anyhow!("{}:{}: the robot would refuse this point: {fault}", self.file.display(), point.line)
            })?;
            from = segment.end;
            motions.push(motion);
        }
        Ok(motions)
    }

    fn print(
        &self,
        setup: &Setup,
        path: &PathPoints,
        programmed: ProgrammedPath,
        figures: &TrajectoryFigures,
        digits: Option<u32>,
    ) {
        let TrajectoryFigures { length_mm, spacing_mm, ramp_mm, mean_mm_s, lowest_mm_s, .. } = figures;
        let limits = &figures.limits;
        let refill = match setup.plc.refills_by() {
            Refill::Executed => "executed",
            Refill::Accepted => "accepted",
        };
        let form = programmed
            .resolution_um
            .map_or_else(String::new, |step| format!(", compact points in steps of {step} µm"));
        outln!("Setup {}: {}", setup.name, setup.title);
        outln!(
            "{} points on {length_mm:.1} mm, {spacing_mm:.3} mm apart, as {}, {:.0} mm/s and {:.0} mm/s²; queue of {}, refill by {refill}{form}; virtual mode, seed {}\n",
            path.points.len(),
            if programmed.is_lines { "lines" } else { "a spline" },
            programmed.speed_mm_s,
            programmed.acceleration_mm_s2,
            setup.robot.queue_holds(),
            self.seed
        );
        outln!("mean speed          {mean_mm_s:>8.1} mm/s   without the first and the last {ramp_mm:.0} mm");
        outln!("lowest speed        {lowest_mm_s:>8.1} mm/s");
        outln!("blends suppressed   {:>8}", figures.suppressed);
        outln!(
            "deviation           {:>8.3} mm     largest distance of a point from the driven path",
            figures.deviation_mm
        );
        let accepted = figures.accepted_per_cycle;
        outln!("accepted per cycle  {:>8.2}        at most {}", accepted.mean, accepted.most);
        let limit = serde_json::to_string(&figures.limited_by).unwrap_or_default();
        outln!("limited by          {:>8}", limit.trim_matches('"'));
        let resolution = limits.resolution.map_or_else(|| "–".to_owned(), |speed| format!("{speed:.0}"));
        outln!(
            "\nlimits in mm/s: programmed {:.0}, taking {:.0}, look-ahead {:.0}, resolution of the file {resolution}",
            limits.programmed,
            limits.taking,
            limits.look_ahead
        );
        if let (Some(digits), Some(decimals)) = (digits, path.decimals) {
            errln!(
                "warning: {decimals} digits after the decimal point allow {resolution} mm/s on steps of {spacing_mm:.3} mm; write {digits}"
            );
        }
    }
}
