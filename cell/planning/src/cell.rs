//! Planning for a cell of several stations: each station's motions by its own arm, and the marks at which they meet.

use std::fmt;
use std::path::Path;

use ::arm::{Frame, Joints};
use protocol::image::MotionKind;
use setup::{Cell, Setup, Station};

use crate::application::Application;
use crate::arms::{ArmsApplication, Mark};
use crate::compact_form::check_alone;
use crate::error::Error;
use crate::load::{ARMS_APPLICATIONS, Found, application};
use crate::mark_outputs::{self, outputs_of_waits};
use crate::mark_signal::{OUTPUTS, output_bit};
use crate::motion::Motion;
use crate::plan::Plan;
use crate::reach::Reached;
use crate::resolve::arms_in;
use crate::shared_zone::{self, ArmVolume, NoTurns, StationZones};

/// How far apart the bases of two arms may be in the cell, in mm and in degrees: files round both.
const SAME_BASE: [f64; 2] = [0.05, 0.01];

/// The applications of all stations of a cell, in the order of its stations.
#[derive(Clone, PartialEq, Debug)]
pub struct FoundCell {
    /// The cell's name in messages: its file's path, or the built-in's name.
    pub origin: String,
    /// The marks at which the arms wait for each other; none if each station has an application of its own.
    pub marks: Vec<Mark>,
    /// What each station is to do; of an application for several arms, the text of the whole and the part of its arm.
    pub stations: Vec<Found>,
}

/// The motions of a cell.
#[derive(Clone, Debug)]
pub struct PlannedCell {
    /// The marks at which the arms wait for each other.
    pub marks: Vec<Mark>,
    /// Names of the shared zones, in the order of the setup.
    pub zones: Vec<String>,
    /// The stations, in the order of the setup.
    pub stations: Vec<PlannedStation>,
}

/// The motions of one station of a cell.
#[derive(Clone, Debug)]
pub struct PlannedStation {
    /// Its name in the setup.
    pub name: String,
    /// The station as a setup of its own.
    pub setup: Setup,
    /// Its place in an EtherCAT line, if its setup gives one.
    pub position: Option<u16>,
    /// What it is to do.
    pub application: Application,
    /// Its motions, and in [`Plan::waits`] where among them it waits at which mark.
    pub plan: Plan,
    /// Where its arm stands at the ends of its motions.
    pub reached: Reached,
    /// Data of it that the PLC needs for shared zones; `None` if the cell has none.
    pub zones: Option<StationZones>,
}

/// Finds a setup with any number of stations, and the applications that its stations run. A setup of one robot is a cell of
/// one station.
///
/// # Errors
/// Those of [`setup::cell()`], of [`application()`] and of [`ArmsApplication::parse`]; a station whose arm the application does
/// not have, and an arm without a station.
pub fn cell_with_applications(name: &str) -> Result<(Cell, FoundCell), Error> {
    let (cell, directory) = setup::cell(name)?;
    let found = applications_of(name, &cell, directory.as_deref())?;
    Ok((cell, found))
}

/// Finds a setup and its applications like [`cell_with_applications`]; `instead` replaces them by one for all arms: a built-in
/// one's name, or a path from the working directory.
///
/// # Errors
/// Those of [`cell_with_applications`].
pub fn cell_and_application(name: &str, instead: Option<&str>) -> Result<(Cell, FoundCell), Error> {
    let Some(application) = instead else { return cell_with_applications(name) };
    let (mut cell, _) = setup::cell(name)?;
    cell.application = Some(application.to_owned());
    let found = applications_of(name, &cell, None)?;
    Ok((cell, found))
}

/// Finds the applications that the stations of a cell run, whose paths are relative to `directory`; `name` is the setup's name or path,
/// for messages.
///
/// # Errors
/// Those of [`application()`] and of [`ArmsApplication::parse`]; a station whose arm the application does not have, and an arm
/// without a station.
pub fn applications_of(name: &str, cell: &Cell, directory: Option<&Path>) -> Result<FoundCell, Error> {
    let origin = setup::built_in_setup(name)
        .map_or_else(|| name.to_owned(), |(known, _)| format!("built-in setup {known}"));
    let (marks, stations) = match &cell.application {
        Some(application) => of_one_application(&origin, cell, application, directory)?,
        None => {
            let own = |station: &Station| application(&station.application, directory);
            (Vec::new(), cell.stations.iter().map(own).collect::<Result<_, _>>()?)
        }
    };
    Ok(FoundCell { origin, marks, stations })
}

/// Finds the application of all stations, and gives each station the part of its arm.
fn of_one_application(
    origin: &str,
    cell: &Cell,
    name: &str,
    directory: Option<&Path>,
) -> Result<(Vec<Mark>, Vec<Found>), Error> {
    let refused =
        |key: String, problem: String| setup::Error::Value { origin: origin.to_owned(), key, problem };
    let setup::Text { origin: of_text, path, text } =
        setup::find("application", ARMS_APPLICATIONS, name, directory)?;
    if arms_in(&text).is_empty() {
        // What is wrong in it comes first.
        Application::parse(&of_text, &text)?;
        let problem = format!("{of_text} is for one arm; leave the key out, and write it at a station");
        return Err(refused("application".to_owned(), problem).into());
    }
    let arms = ArmsApplication::parse(&of_text, &text)?;
    let mut stations = Vec::with_capacity(cell.stations.len());
    for (index, station) in cell.stations.iter().enumerate() {
        let key = || format!("station.{}.application", station.name);
        let wanted = &station.application;
        let Some(arm) = arms.arms.iter().find(|arm| arm.name == *wanted) else {
            let known: Vec<_> = arms.arms.iter().map(|arm| arm.name.as_str()).collect();
            let problem = format!("`{wanted}` is not an arm of {of_text}: it has {}", known.join(", "));
            return Err(refused(key(), problem).into());
        };
        if let Some(other) = cell.stations.iter().take(index).find(|other| other.application == *wanted) {
            let problem = format!("station `{}` is arm `{wanted}` too; each arm is one station", other.name);
            return Err(refused(key(), problem).into());
        }
        stations.push(Found {
            origin: of_text.clone(),
            path: path.clone(),
            text: text.clone(),
            application: arm.application.clone(),
        });
    }
    let is_missing = |arm: &&str| !cell.stations.iter().any(|station| station.application == **arm);
    if let Some(missing) = arms.arms.iter().map(|arm| arm.name.as_str()).find(is_missing) {
        let problem =
            format!("arm `{missing}` of {of_text} has no station; add one with application = \"{missing}\"");
        return Err(refused("station".to_owned(), problem).into());
    }
    Ok((arms.marks, stations))
}

impl FoundCell {
    /// Plans the motions of each station on its own arm, and follows them with it: like [`Found::plan`] and [`Found::reach`].
    ///
    /// # Errors
    /// Those of both, which name the station's setup; bases of two arms that are not one place in the cell; arms that cannot take
    /// turns in shared zones.
    pub fn plan(&self, cell: &Cell) -> Result<PlannedCell, Error> {
        if cell.application.is_some() {
            self.check_bases(cell)?;
        }
        let stations = cell.stations.iter().zip(&self.stations).map(|(station, found)| {
            let setup = cell.setup_of(station);
            check_alone(&found.application, &setup, &self.marks).map_err(|refused| Error::Unplannable {
                origin: found.origin.clone(),
                setup: setup.name.clone(),
                refused: Box::new(refused.into()),
            })?;
            let plan = found.plan(&setup)?;
            let reached = found.reach(&plan, &setup)?;
            let (name, application) = (station.name.clone(), found.application.clone());
            let position = station.position;
            Ok(PlannedStation { name, setup, position, application, plan, reached, zones: None })
        });
        let mut stations = stations.collect::<Result<Vec<_>, Error>>()?;
        share_zones(cell, &mut stations).map_err(|found| Error::NoTurns {
            origin: self.origin.clone(),
            key: found.key(),
            found: Box::new(found),
        })?;
        mark_outputs::assign(&mut stations.iter_mut().map(|station| &mut station.plan).collect::<Vec<_>>());
        let zones = cell.shared_zones.iter().map(|zone| zone.name.clone()).collect();
        Ok(PlannedCell { marks: self.marks.clone(), zones, stations })
    }

    /// Returns the name of the application of all stations, or those of each, one after the other.
    #[must_use]
    pub fn application_name(&self, cell: &Cell) -> String {
        name_for_all(cell, self.stations.iter().map(|found| &found.application))
    }

    /// Returns the text of the application of all stations, or those of each with its station's name in a comment before it.
    #[must_use]
    pub fn text(&self, cell: &Cell) -> String {
        let texts = self.stations.iter().map(|station| station.text.as_str());
        if cell.application.is_some() {
            return texts.take(1).collect();
        }
        cell.names().zip(texts).map(|(name, text)| format!("# station {name}\n{text}\n")).collect()
    }

    /// Checks that the frames of one application are at one place in the cell for all its arms.
    fn check_bases(&self, cell: &Cell) -> Result<(), Error> {
        let mut first = None;
        for (station, found) in cell.stations.iter().zip(&self.stations) {
            let number = found.application.base;
            let base = match number {
                0 => Some(Frame::IDENTITY),
                _ => {
                    let listed = station.robot.bases.iter().find(|base| base.number == number);
                    listed.map(|base| Frame::from_mm_deg(base.mm_deg.value))
                }
            };
            // A base that the robot does not have is refused while planning.
            let Some(base) = base else { continue };
            let place = Frame::from_mm_deg(station.root_mm_deg.value) * base;
            let Some((other, there)) = first else {
                first = Some((&station.name, place));
                continue;
            };
            let off = there.offset_to(&place);
            if off[0] > SAME_BASE[0] || off[1] > SAME_BASE[1] {
                let key = format!("station.{}.robot.bases", station.name);
                let problem = format!(
                    "base {number} lies {:.2} mm and {:.2}° from that of `{other}` in the cell; one application needs one \
                     place: correct it or a root_mm_deg",
                    off[0], off[1]
                );
                return Err(setup::Error::Value { origin: self.origin.clone(), key, problem }.into());
            }
        }
        Ok(())
    }
}

/// Finds the visits of all arms in shared zones, and checks that they can take turns there. Without zones it only checks that the
/// arms start beside each other.
fn share_zones(cell: &Cell, stations: &mut [PlannedStation]) -> Result<(), NoTurns> {
    let volume =
        |(planned, station): (&PlannedStation, &Station)| ArmVolume::new(cell, station, &planned.tools());
    let volumes: Vec<_> = stations.iter().zip(&cell.stations).map(volume).collect();
    check_starts(stations, &volumes)?;
    if cell.shared_zones.is_empty() {
        return Ok(());
    }
    for (planned, volume) in stations.iter_mut().zip(volumes) {
        // The check of the setup has found a radius of each arm, and planning the arm.
        let Some(volume) = volume else { continue };
        let start = planned.reached.start;
        // With its joints the way there is known, wherever the arm comes from.
        if let Some(motion) = &mut planned.plan.to_start.from_anywhere {
            let kind = MotionKind::PtpJoint;
            *motion = Motion { kind, joints_deg: Some(start), configuration: None, ..motion.clone() };
        }
        let (visits, from_end) = shared_zone::find(&volume, &planned.plan, &planned.reached, &planned.setup);
        planned.plan.visits = visits;
        planned.zones = Some(StationZones { volume, start, from_end });
    }
    check_places(cell, stations)?;
    let arms: Vec<_> = stations.iter().map(|station| (station.name.as_str(), &station.plan)).collect();
    let zones: Vec<_> = cell.shared_zones.iter().map(|zone| zone.name.clone()).collect();
    shared_zone::check_turns(&arms, &zones)
}

/// Checks that no two arms are in each other at their starts.
fn check_starts(stations: &[PlannedStation], volumes: &[Option<ArmVolume>]) -> Result<(), NoTurns> {
    let placed: Vec<_> =
        stations.iter().zip(volumes).filter_map(|(it, volume)| Some((it, volume.as_ref()?))).collect();
    for (index, (station, volume)) in placed.iter().enumerate() {
        for (other, others) in placed.iter().take(index) {
            let distance_mm = volume.distance_mm(&station.reached.start, others, &other.reached.start);
            if distance_mm < 0.0 {
                let stations = [other.name.clone(), station.name.clone()];
                return Err(NoTurns::InTheWay { stations, depth_mm: -distance_mm });
            }
        }
    }
    Ok(())
}

/// Checks that all arms start and end outside of the zones.
fn check_places(cell: &Cell, stations: &[PlannedStation]) -> Result<(), NoTurns> {
    let placed: Vec<_> = stations.iter().filter_map(|it| Some((it, it.zones.as_ref()?))).collect();
    let standing = |of: &dyn Fn(&PlannedStation) -> Joints, zone: usize| -> Vec<String> {
        let those = placed.iter().filter(|(station, zones)| zones.volume.at(&of(station)).contains(zone));
        those.map(|(station, _)| station.name.clone()).collect()
    };
    let end = |station: &PlannedStation| {
        let Reached { start, targets, .. } = &station.reached;
        *targets.last().unwrap_or(start)
    };
    for (number, zone) in cell.shared_zones.iter().enumerate() {
        let zone = zone.name.clone();
        let stations = standing(&|station| station.reached.start, number);
        if !stations.is_empty() {
            return Err(NoTurns::StartsIn { stations, zone });
        }
        if let Some(station) = standing(&end, number).into_iter().next() {
            return Err(NoTurns::EndsIn { station, zone });
        }
    }
    Ok(())
}

/// Returns the name of the application of all stations, given the part of each, or those of each, one after the other.
fn name_for_all<'a>(cell: &Cell, mut applications: impl Iterator<Item = &'a Application>) -> String {
    if cell.application.is_none() {
        return applications.map(|application| application.name.as_str()).collect::<Vec<_>>().join(", ");
    }
    // The part of an arm is named by the application and the arm.
    let part = applications.next().map_or("", |application| &application.name);
    let arm = cell.stations.first().map_or("", |station| &station.application);
    part.strip_suffix(arm).and_then(|name| name.strip_suffix('-')).unwrap_or(part).to_owned()
}

impl PlannedStation {
    /// Returns the numbers of the tools of its motions, in ascending order.
    fn tools(&self) -> Vec<u8> {
        let mut tools: Vec<u8> = self.plan.motions.iter().map(|motion| motion.tool).collect();
        tools.sort_unstable();
        tools.dedup();
        tools
    }
}

impl PlannedCell {
    /// Returns the station of this name.
    #[must_use]
    pub fn station(&self, name: &str) -> Option<&PlannedStation> {
        self.stations.iter().find(|station| station.name == name)
    }

    /// Returns the name of the application of all stations, or those of each, one after the other.
    #[must_use]
    pub fn application_name(&self, cell: &Cell) -> String {
        name_for_all(cell, self.stations.iter().map(|station| &station.application))
    }

    /// Returns the stations that wait at a mark, with how many motions each has executed there.
    pub fn waiting_at(&self, mark: u32) -> impl Iterator<Item = (&PlannedStation, usize)> {
        self.stations.iter().flat_map(move |station| {
            let here = station.plan.waits.iter().filter(move |wait| wait.mark == mark);
            here.map(move |wait| (station, wait.after))
        })
    }
}

impl PlannedCell {
    /// Says by which outputs the stored programs of RC meet.
    fn show_signals(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let of_station = |station: &PlannedStation| {
            let bits = outputs_of_waits(&station.plan.waits);
            let outputs = (0..OUTPUTS).filter(|output| bits & output_bit(*output) != 0);
            let outputs: Vec<_> = outputs.map(|output| output.to_string()).collect();
            (!outputs.is_empty()).then(|| format!("{} {}", station.name, outputs.join(" and ")))
        };
        let listed: Vec<_> = self.stations.iter().filter_map(of_station).collect();
        if listed.is_empty() {
            return Ok(());
        }
        writeln!(f, "  RC: programs meet by digital outputs: {}", listed.join(", "))
    }

    /// Lists the shared zones, with the motions of each station in them.
    fn show_zones(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.zones.is_empty() {
            return Ok(());
        }
        writeln!(f, "shared zones")?;
        let width = self.zones.iter().map(|zone| zone.chars().count()).max().unwrap_or(0);
        for (number, zone) in self.zones.iter().enumerate() {
            let in_zone = self.stations.iter().filter_map(|station| {
                let here = station.plan.visits.iter().filter(|visit| visit.zone == number);
                let ranges = here.map(|visit| format!("{} to {}", visit.after + 1, visit.until));
                let ranges: Vec<_> = ranges.collect();
                (!ranges.is_empty()).then(|| format!("{} in motions {}", station.name, ranges.join(" and ")))
            });
            let visits: Vec<_> = in_zone.collect();
            let visits = if visits.is_empty() { "nobody".to_owned() } else { visits.join(", ") };
            writeln!(f, "  {zone:width$}  {visits}")?;
        }
        Ok(())
    }
}

/// Lists the marks, with the motion of each station after which it waits there, and the shared zones.
impl fmt::Display for PlannedCell {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if !self.marks.is_empty() || self.zones.is_empty() {
            writeln!(f, "marks")?;
        }
        let width = self.marks.iter().map(|mark| mark.name.chars().count()).max().unwrap_or(0);
        for mark in &self.marks {
            let first_cycle = |waiting: Vec<(&PlannedStation, usize)>| {
                let mut told: Vec<String> = Vec::new();
                for (station, after) in waiting {
                    let begin = format!("{} after motion ", station.name);
                    if !told.iter().any(|it| it.starts_with(&begin)) {
                        told.push(format!("{begin}{after}"));
                    }
                }
                told.join(", ")
            };
            let waiting = first_cycle(self.waiting_at(mark.number).collect());
            let together = if mark.together { "; together from here to the next" } else { "" };
            writeln!(f, "  {:>4}  {:width$}  {waiting}{together}", mark.number, mark.name)?;
        }
        self.show_signals(f)?;
        self.show_zones(f)
    }
}
