//! Process steps: their labels, paths and actions.

use setup::Figure;
use toml::Spanned;

use super::Resolver;
use crate::application::{Action, Course, Labels, Segment, Step};
use crate::error::Error;
use crate::file::{self, Label, Name};

/// Highest digital output of the process image.
const HIGHEST_OUTPUT: u8 = 15;

impl Resolver<'_> {
    pub(super) fn step(&self, at: &Spanned<file::Step>) -> Result<Step, Error> {
        let step = at.get_ref();
        let labels = self.labels(step)?;
        let tool = step.tool.as_ref().unwrap_or(&self.file.tool);
        let then = step.then.as_ref().map(|name| self.action(name)).transpose()?;
        if let (Some(then), Some(name), false) = (&then, &step.then, labels.accurate_stop) {
            let problem = format!(
                "`{}` happens at rest, so step `{}` must be labelled \"accurate-stop\"",
                then.name, step.name
            );
            return Err(self.wrong(name, "then", problem));
        }
        Ok(Step {
            name: step.name.clone(),
            does: step.does.clone(),
            labels,
            tool: self.tool(tool)?,
            base: step.base.as_ref().map(|name| self.number(&self.file.bases, name, "base")).transpose()?,
            course: self.course(at)?,
            speed_mm_s: self.above_zero(step.speed_mm_s.as_ref(), "speed_mm_s", f64::MAX)?,
            speed_percent: self
                .above_zero(step.speed_percent.as_ref(), "speed_percent", 100.0)?
                .unwrap_or(100.0),
            then,
        })
    }

    /// Returns a speed above 0 and not above `highest`, if there is one.
    fn above_zero(
        &self,
        value: Option<&Spanned<f64>>,
        key: &str,
        highest: f64,
    ) -> Result<Option<f64>, Error> {
        let Some(value) = value else { return Ok(None) };
        let number = *value.get_ref();
        if number > 0.0 && number <= highest {
            return Ok(Some(number));
        }
        let most = if highest < f64::MAX { format!(" and at most {highest}") } else { String::new() };
        Err(self.wrong(value, key, format!("is {}; it must be above 0{most}", Figure(number))))
    }

    fn labels(&self, step: &file::Step) -> Result<Labels, Error> {
        let labels = step.labels.get_ref();
        let has = |label| labels.contains(&label);
        let problem = if labels.is_empty() {
            "is empty; expected some of \"blending\", \"accurate-path\", \"accurate-stop\""
        } else if has(Label::Blending) && has(Label::AccuratePath) {
            "a path is either blended or accurate; keep one of \"blending\" and \"accurate-path\""
        } else if has(Label::AccuratePath) && step.path.is_none() {
            "a step without `path` has no accurate path; label it \"blending\" or give it a path"
        } else {
            return Ok(Labels {
                accurate_path: has(Label::AccuratePath),
                accurate_stop: has(Label::AccurateStop),
            });
        };
        Err(self.wrong(&step.labels, "labels", format!("step `{}`: {problem}", step.name)))
    }

    fn course(&self, at: &Spanned<file::Step>) -> Result<Course, Error> {
        let step = at.get_ref();
        match (&step.reach, &step.path) {
            (None, None) => {
                let problem = "names no frame; give it `reach = \"FRAME\"` or `path = [...]`".into();
                Err(self.wrong(at, &format!("step `{}`", step.name), problem))
            }
            (Some(reach), Some(_)) => {
                Err(self.wrong(reach, "reach", format!("step `{}` has a `path` too; keep one", step.name)))
            }
            (Some(reach), None) => {
                let lengths = [&step.approach_mm, &step.retreat_mm].into_iter().flatten().next();
                if let Some(length) = lengths {
                    let problem =
                        format!("step `{}` has no `path` to extend; remove approach and retreat", step.name);
                    return Err(self.wrong(length, "approach_mm, retreat_mm", problem));
                }
                Ok(Course::Reach(self.place(reach, "reach")?))
            }
            (None, Some(path)) => {
                let segments =
                    path.get_ref().iter().map(|it| self.segment(it)).collect::<Result<Vec<_>, _>>()?;
                if segments.is_empty() {
                    return Err(self.wrong(path, "path", format!("step `{}`: is empty", step.name)));
                }
                if let (Some(approach), None) = (&step.approach_mm, &step.from) {
                    let problem = format!(
                        "step `{}` begins where the tool is; a pre-movement needs `from = \"FRAME\"`",
                        step.name
                    );
                    return Err(self.wrong(approach, "approach_mm", problem));
                }
                let length = |value: &Option<Spanned<f64>>, key| match value {
                    Some(value) => self.within(value, key, 0.0..1e4),
                    None => Ok(0.0),
                };
                Ok(Course::Follow {
                    from: step.from.as_ref().map(|name| self.place(name, "from")).transpose()?,
                    segments,
                    approach_mm: length(&step.approach_mm, "approach_mm")?,
                    retreat_mm: length(&step.retreat_mm, "retreat_mm")?,
                })
            }
        }
    }

    fn segment(&self, segment: &file::Segment) -> Result<Segment, Error> {
        Ok(match segment {
            file::Segment::Line(to) => Segment::Line(self.place(to, "line")?),
            file::Segment::Circle(circle) => Segment::Circle {
                through: self.unconfigured(&circle.through, "through")?,
                to: self.unconfigured(&circle.to, "to")?,
            },
            file::Segment::Spline(points) => {
                if points.get_ref().is_empty() {
                    return Err(self.wrong(points, "spline", "is empty; name its frames in order".into()));
                }
                let places = points.get_ref().iter().map(|name| self.place(name, "spline"));
                Segment::Spline(places.collect::<Result<_, _>>()?)
            }
            file::Segment::Press(press) => {
                Segment::Press { to: self.unconfigured(&press.to, "to")?, force_n: *press.force_n.get_ref() }
            }
        })
    }

    pub(super) fn action(&self, name: &Name) -> Result<Action, Error> {
        let at = self.known(&self.file.actions, name, "action", "then")?;
        let action = at.get_ref();
        if action.output > HIGHEST_OUTPUT {
            let problem = format!("is {}; the image has outputs 0 to {HIGHEST_OUTPUT}", action.output);
            return Err(self.wrong(at, &format!("{}.output", name.get_ref()), problem));
        }
        if !(0.0..=60_000.0).contains(&action.wait_ms) {
            let problem = format!("is {}; it must be 0 to 60000 ms", action.wait_ms);
            return Err(self.wrong(at, &format!("{}.wait_ms", name.get_ref()), problem));
        }
        Ok(Action {
            name: name.get_ref().clone(),
            output: action.output,
            set: action.set,
            wait_ms: action.wait_ms,
        })
    }
}
