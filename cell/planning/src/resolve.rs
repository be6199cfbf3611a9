//! From the file to an [`Application`]: every name is looked up once, and every error names its line.

mod arms;
mod step;

use std::collections::BTreeMap;
use std::ops::Range;

use protocol::image::Configuration;
use setup::{Figure, control_character, meant_or_all};
use toml::Spanned;

use crate::application::{Application, Grid, Obstacle, Place, Surface, Tool, Ways, Zones};
use crate::arms::ArmsApplication;
use crate::error::{Error, line_of};
use crate::file::{self, File, Name};
use crate::geometry::{Cuboid, Point, Pose};

/// Version of the format that this reads.
const SCHEMA: u32 = 2;

/// Highest number of a tool or base frame that the wire carries: four bits.
const HIGHEST_FRAME: u8 = 15;

/// Highest status and turn of a configuration: three bits, and one for each of six axes.
const HIGHEST_STATUS: u8 = 7;
const HIGHEST_TURN: u8 = 63;

/// Largest number of cells of a grid: more are taken for a mistake.
const MOST_CELLS: u64 = 1_000_000;

impl Application {
    /// Reads an application from the text of `origin`, a file's path or a built-in's name.
    ///
    /// # Errors
    /// [`Error::Setup`] and [`Error::Value`] name the line, the key and what was expected there.
    pub fn parse(origin: &str, text: &str) -> Result<Self, Error> {
        let names = arms_in(text);
        if let Some(first) = names.first() {
            let problem = format!(
                "is for {} arms ({}): it needs a setup with [[station]], and `application = \"{first}\"` there",
                names.len(),
                names.join(", ")
            );
            // What is wrong in it comes first.
            ArmsApplication::parse(origin, text)?;
            let line =
                text.lines().position(|line| line.trim_start().starts_with("[[arm]]")).map_or(1, |it| it + 1);
            return Err(Error::Value { origin: origin.to_owned(), line, key: "arm".to_owned(), problem });
        }
        let file: File = setup::read(origin, text)?;
        Resolver { origin, text, file: &file }.application()
    }
}

/// Returns the names of the sections `[[arm]]` of a text; none of an application for one arm, or of a text that cannot be read.
pub(crate) fn arms_in(text: &str) -> Vec<String> {
    let Ok(table) = text.parse::<toml::Table>() else { return Vec::new() };
    let arms = table.get("arm").and_then(toml::Value::as_array).into_iter().flatten();
    arms.map(|arm| {
        let name = arm.get("name").and_then(toml::Value::as_str).unwrap_or_default();
        name.chars().filter(|character| !character.is_control()).collect()
    })
    .collect()
}

/// Largest coordinate, in mm (degrees): no robot reaches farther.
const FARTHEST_MM: f64 = 1e6;

struct Resolver<'a> {
    origin: &'a str,
    text: &'a str,
    file: &'a File,
}

impl Resolver<'_> {
    fn application(&self) -> Result<Application, Error> {
        let file = self.file;
        if *file.schema.get_ref() != SCHEMA {
            let found = file.schema.get_ref();
            return Err(self.wrong(
                &file.schema,
                "schema",
                format!("is {found}; this version reads {SCHEMA}"),
            ));
        }
        self.resolved()
    }

    /// Resolves a file whose version is known to be right.
    fn resolved(&self) -> Result<Application, Error> {
        let file = self.file;
        self.printable()?;
        for (name, grid) in &file.grids {
            if file.frames.contains_key(name) {
                return Err(self.wrong(grid, name, "is a grid and a frame; give one another name".into()));
            }
        }
        let grids =
            file.grids.iter().map(|(name, grid)| self.grid(name, grid)).collect::<Result<Vec<_>, _>>()?;
        let obstacles = file.obstacles.iter().map(|it| self.obstacle(it)).collect::<Result<Vec<_>, _>>()?;
        if let (Some(obstacle), None) = (file.obstacles.first(), &file.ways) {
            let problem = "an application with obstacles needs a table [ways]: clearance_mm, ceiling_mm, \
                           height_step_mm, ptp_radius_mm, detour_percent";
            return Err(self.wrong(obstacle, "obstacle", problem.into()));
        }
        let steps = file.steps.iter().map(|step| self.step(step)).collect::<Result<Vec<_>, _>>()?;
        match (steps.last(), file.steps.last()) {
            (Some(last), Some(at)) if !last.labels.accurate_stop => {
                let problem = format!("the last step, `{}`, must be labelled \"accurate-stop\"", last.name);
                return Err(self.wrong(&at.get_ref().labels, "labels", problem));
            }
            (None, _) => {
                return Err(self.wrong(
                    &file.start,
                    "step",
                    "there is none; an application needs one".into(),
                ));
            }
            _ => {}
        }
        Ok(Application {
            name: file.name.get_ref().clone(),
            title: file.title.get_ref().clone(),
            base: self.number(&file.bases, &file.base, "base")?,
            start: (self.place(&file.start, "start")?, self.tool(&file.tool)?),
            zones: self.zones()?,
            ways: file.ways.as_ref().map(|ways| self.ways(ways)).transpose()?,
            grids,
            obstacles,
            surfaces: file.surfaces.iter().map(|it| self.surface(it)).collect::<Result<Vec<_>, _>>()?,
            steps,
            waits: Vec::new(),
            unused: self.unused(),
        })
    }

    /// Returns the tools and bases that no step uses: a file that names them mostly means them for a step.
    fn unused(&self) -> Vec<String> {
        let file = self.file;
        let of_steps = file.steps.iter().filter_map(|step| step.get_ref().tool.as_ref());
        let used: Vec<_> = of_steps.chain([&file.tool]).map(Spanned::get_ref).collect();
        let tools =
            file.tools.keys().filter(|name| !used.contains(name)).map(|name| format!("tool `{name}`"));
        let of_steps = file.steps.iter().filter_map(|step| step.get_ref().base.as_ref());
        let used_bases: Vec<_> = of_steps.chain([&file.base]).map(Spanned::get_ref).collect();
        let bases = file.bases.keys().filter(|name| !used_bases.contains(name));
        tools.chain(bases.map(|name| format!("base `{name}`"))).collect()
    }

    /// Rejects control characters in names and descriptions: they would reach the terminal of whoever reads a message.
    fn printable(&self) -> Result<(), Error> {
        let file = self.file;
        for (key, text) in [("name", &file.name), ("title", &file.title)] {
            self.is_printable(text, key, text.get_ref())?;
        }
        for at in &file.steps {
            let step = at.get_ref();
            self.is_printable(at, "name", &step.name)?;
            self.is_printable(at, "does", &step.does)?;
        }
        for at in &file.obstacles {
            self.is_printable(at, "name", &at.get_ref().name)?;
        }
        for at in &file.surfaces {
            self.is_printable(at, "name", &at.get_ref().name)?;
        }
        file.frames.iter().try_for_each(|(name, at)| self.is_printable(at, "frames", name))?;
        file.grids.iter().try_for_each(|(name, at)| self.is_printable(at, "grids", name))?;
        file.actions.iter().try_for_each(|(name, at)| self.is_printable(at, "actions", name))?;
        let numbered = file.tools.iter().chain(&file.bases);
        numbered.into_iter().try_for_each(|(name, at)| self.is_printable(at, "tools or bases", name))
    }

    fn is_printable<T>(&self, at: &Spanned<T>, key: &str, text: &str) -> Result<(), Error> {
        control_character(text).map_or(Ok(()), |problem| Err(self.wrong(at, key, problem)))
    }

    fn zones(&self) -> Result<Zones, Error> {
        let zones = &self.file.zones;
        let not_negative = |value: &Option<Spanned<f64>>, key| match value {
            Some(value) => self.within(value, key, 0.0..655.35).map(Some),
            None => Ok(None),
        };
        Ok(Zones {
            approximation_mm: not_negative(&zones.approximation_mm, "approximation_mm")?,
            path_tolerance_mm: not_negative(&zones.path_tolerance_mm, "path_tolerance_mm")?.unwrap_or(0.0),
        })
    }

    fn ways(&self, ways: &file::Ways) -> Result<Ways, Error> {
        Ok(Ways {
            clearance_mm: self.within(&ways.clearance_mm, "clearance_mm", 0.0..1e4)?,
            ceiling_mm: self.within(&ways.ceiling_mm, "ceiling_mm", -1e4..1e4)?,
            height_step_mm: self.within(&ways.height_step_mm, "height_step_mm", 1.0..1e3)?,
            ptp_radius_mm: self.within(&ways.ptp_radius_mm, "ptp_radius_mm", 1.0..1e6)?,
            detour_percent: self.within(&ways.detour_percent, "detour_percent", 0.0..100.0)?,
        })
    }

    fn grid(&self, name: &str, at: &Spanned<file::Grid>) -> Result<Grid, Error> {
        let grid = at.get_ref();
        let cells: u64 = grid.count.iter().map(|&count| u64::from(count)).fold(1, u64::saturating_mul);
        if cells == 0 || cells > MOST_CELLS {
            let problem = format!("has {cells} cells; there must be 1 to {MOST_CELLS}");
            return Err(self.wrong(at, &format!("{name}.count"), problem));
        }
        if !grid.pitch_mm.iter().all(|pitch| pitch.abs() <= FARTHEST_MM) {
            let problem = format!("has a number that is not within ±{FARTHEST_MM}");
            return Err(self.wrong(at, &format!("{name}.pitch_mm"), problem));
        }
        let mut others = self.file.grids.iter().map(|(name, other)| (name, other.get_ref().count));
        let product =
            |count: [u32; 3]| count.iter().map(|&count| u64::from(count)).fold(1, u64::saturating_mul);
        if let Some((other, count)) = others.find(|(_, count)| product(*count) != cells) {
            let problem = format!(
                "has {cells} cells and grid `{other}` {}; all advance together and need the same number",
                product(count)
            );
            return Err(self.wrong(at, &format!("{name}.count"), problem));
        }
        Ok(Grid { name: name.to_owned(), count: grid.count, pitch_mm: grid.pitch_mm })
    }

    fn obstacle(&self, at: &Spanned<file::Obstacle>) -> Result<Obstacle, Error> {
        let obstacle = at.get_ref();
        for ((lower, upper), axis) in obstacle.lower_mm.iter().zip(&obstacle.upper_mm).zip(["x", "y", "z"]) {
            if !(lower.is_finite() && upper.is_finite() && lower < upper) {
                let problem = format!(
                    "lower_mm {} must be below upper_mm {} along {axis}, and both finite",
                    Figure(*lower),
                    Figure(*upper)
                );
                return Err(self.wrong(at, &format!("obstacle `{}`", obstacle.name), problem));
            }
        }
        let space = Cuboid { lower: obstacle.lower_mm.into(), upper: obstacle.upper_mm.into() };
        Ok(Obstacle { name: obstacle.name.clone(), space })
    }

    fn surface(&self, at: &Spanned<file::Surface>) -> Result<Surface, Error> {
        let surface = at.get_ref();
        let key = format!("surface `{}`", surface.name);
        let middle = self.place(&surface.middle, "middle")?;
        if middle.grid.is_some() {
            let problem = "stands on a grid; a surface does not move with the cells".into();
            return Err(self.wrong(&surface.middle, &key, problem));
        }
        let normal = Point::from(surface.normal).direction();
        let Some(normal) = normal.filter(|_| surface.normal.iter().all(|along| along.is_finite())) else {
            let problem = format!("normal {:?} gives no direction", surface.normal);
            return Err(self.wrong(at, &key, problem));
        };
        let radius = surface.radius_mm.as_ref();
        Ok(Surface {
            name: surface.name.clone(),
            middle: middle.pose.point,
            normal,
            radius_mm: radius.map(|radius| self.within(radius, "radius_mm", 0.1..1e4)).transpose()?,
            stiffness_n_per_mm: self.within(&surface.stiffness_n_per_mm, "stiffness_n_per_mm", 1e-3..1e5)?,
        })
    }

    fn tool(&self, name: &Name) -> Result<Tool, Error> {
        let number = self.number(&self.file.tools, name, "tool")?;
        Ok(Tool { name: name.get_ref().clone(), number })
    }

    fn number(
        &self,
        known: &BTreeMap<String, Spanned<u8>>,
        name: &Name,
        what: &'static str,
    ) -> Result<u8, Error> {
        let at = self.known(known, name, what, what)?;
        let number = *at.get_ref();
        if number > HIGHEST_FRAME {
            let problem = format!("is {number}; the wire carries {what} 0 to {HIGHEST_FRAME}");
            return Err(self.wrong(at, name.get_ref(), problem));
        }
        Ok(number)
    }

    /// Follows `on` from frame to frame down to the one that stands in the base.
    fn place(&self, name: &Name, key: &str) -> Result<Place, Error> {
        let mut place = Place {
            name: name.get_ref().clone(),
            pose: Pose::new([0.0; 6]),
            grid: None,
            joints_deg: None,
            configuration: None,
        };
        if let Some(frame) = self.file.frames.get(name.get_ref()) {
            place.joints_deg = frame.get_ref().joints_deg;
            place.configuration = self.configuration(name.get_ref(), frame.get_ref())?;
        }
        let mut shift = [0.0; 3];
        let mut at = name;
        let mut at_key = key;
        // A chain that is longer than the number of names contains a cycle.
        for _ in 0..=self.file.frames.len() + self.file.grids.len() {
            if let Some(index) = self.file.grids.keys().position(|grid| grid == at.get_ref()) {
                if place.grid.is_some() {
                    let problem = "a frame moves on one grid, not on two".into();
                    return Err(self.wrong(at, at_key, problem));
                }
                place.grid = Some(index);
                let grid = self.known(&self.file.grids, at, "grid", at_key)?;
                (at, at_key) = (&grid.get_ref().corner, "corner");
                continue;
            }
            let frame = self.known(&self.file.frames, at, "frame", at_key)?;
            let values = frame.get_ref();
            let numbers = values.mm_deg.iter().flatten().chain(values.shift_mm.iter().flatten());
            if !numbers.chain(values.joints_deg.iter().flatten()).all(|value| value.abs() <= FARTHEST_MM) {
                let problem = format!("has a number that is not within ±{FARTHEST_MM}");
                return Err(self.wrong(frame, at.get_ref(), problem));
            }
            for (shift, more) in shift.iter_mut().zip(values.shift_mm.unwrap_or_default()) {
                *shift += more;
            }
            match (&values.mm_deg, &values.on) {
                (Some(mm_deg), None) => {
                    let pose = Pose::new(*mm_deg);
                    place.pose = pose.at(pose.point + shift.into());
                    return Ok(place);
                }
                (None, Some(on)) => (at, at_key) = (on, "on"),
                _ => {
                    let problem = "needs either `mm_deg` or `on` (with `shift_mm`)".into();
                    return Err(self.wrong(frame, at.get_ref(), problem));
                }
            }
        }
        Err(self.wrong(at, at_key, format!("frame `{}` stands on itself", name.get_ref())))
    }

    /// Resolves a frame of a circle or a press, whose motions have no room for a configuration.
    fn unconfigured(&self, name: &Name, key: &str) -> Result<Place, Error> {
        let place = self.place(name, key)?;
        let Some(configuration) = place.configuration else { return Ok(place) };
        let problem = format!(
            "frame `{}` has a configuration ({configuration}), which a circle or a press cannot carry; name a frame \
             without one",
            place.name
        );
        Err(self.wrong(name, key, problem))
    }

    fn configuration(&self, name: &str, frame: &file::Frame) -> Result<Option<Configuration>, Error> {
        let Some(at) = &frame.configuration else { return Ok(None) };
        let file::Configuration { status, turn } = *at.get_ref();
        let problem = if status > HIGHEST_STATUS {
            format!("has status {status}; it must be 0 to {HIGHEST_STATUS}")
        } else if let Some(turn) = turn.filter(|turn| *turn > HIGHEST_TURN) {
            format!("has turn {turn}; it must be 0 to {HIGHEST_TURN}, a bit for each axis")
        } else if frame.joints_deg.is_some() {
            "stands beside joints_deg, which have one already; keep one of them".to_owned()
        } else {
            return Ok(Some(Configuration { status, turn }));
        };
        Err(self.wrong(at, &format!("{name}.configuration"), problem))
    }

    fn known<'m, T>(
        &self,
        all: &'m BTreeMap<String, T>,
        name: &Name,
        what: &str,
        key: &str,
    ) -> Result<&'m T, Error> {
        all.get(name.get_ref()).ok_or_else(|| {
            let known: Vec<&str> = all.keys().map(String::as_str).collect();
            let instead = meant_or_all(name.get_ref(), &known);
            self.wrong(name, key, format!("there is no {what} `{}`; {instead}", name.get_ref()))
        })
    }

    fn within(&self, value: &Spanned<f64>, key: &str, range: Range<f64>) -> Result<f64, Error> {
        let number = *value.get_ref();
        if (range.start..=range.end).contains(&number) {
            return Ok(number);
        }
        Err(self.wrong(
            value,
            key,
            format!("is {}; it must be {} to {}", Figure(number), range.start, range.end),
        ))
    }

    fn wrong<T>(&self, at: &Spanned<T>, key: &str, problem: String) -> Error {
        let line = line_of(self.text, at.span().start);
        Error::Value { origin: self.origin.to_owned(), line, key: key.to_owned(), problem }
    }
}
