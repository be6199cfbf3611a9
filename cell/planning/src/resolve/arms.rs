//! From the file of several arms to the application of each, with the marks at which they wait for each other.

use std::collections::BTreeSet;

use toml::Spanned;

use super::Resolver;
use crate::application::{Application, Wait};
use crate::arms::{ArmApplication, ArmsApplication, Mark};
use crate::arms_file::{Arm, ArmStep, ArmsFile};
use crate::error::{Error, line_of};
use crate::meeting;

/// Version of the format for several arms.
pub(super) const ARMS_SCHEMA: u32 = 3;

/// Highest number of a mark.
const HIGHEST_MARK: u32 = u16::MAX as u32;

impl ArmsApplication {
    /// Reads an application for several arms from the text of `origin`, a file's path or a built-in's name.
    ///
    /// # Errors
    /// [`Error::Setup`] and [`Error::Value`] name the line, the key and what was expected there.
    pub fn parse(origin: &str, text: &str) -> Result<Self, Error> {
        let file: ArmsFile = setup::read(origin, text)?;
        let reader = Reader { origin, text, file: &file };
        reader.check_head()?;
        let arms = file.arms.iter().map(|arm| reader.arm(arm.get_ref())).collect::<Result<Vec<_>, _>>()?;
        let marks = file.marks.iter().map(Spanned::get_ref).map(|mark| Mark {
            number: mark.number,
            name: mark.name.clone(),
            together: mark.together,
        });
        let (name, title) = (file.name.get_ref().clone(), file.title.get_ref().clone());
        let application = Self { name, title, marks: marks.collect(), arms };
        reader.check_meetings(&application)?;
        Ok(application)
    }
}

struct Reader<'a> {
    origin: &'a str,
    text: &'a str,
    file: &'a ArmsFile,
}

impl Reader<'_> {
    fn check_head(&self) -> Result<(), Error> {
        let file = self.file;
        if *file.schema.get_ref() != ARMS_SCHEMA {
            let problem =
                format!("is {}; an application with [[arm]] has {ARMS_SCHEMA}", file.schema.get_ref());
            return Err(self.wrong(&file.schema, "schema", problem));
        }
        let mut numbers = BTreeSet::new();
        for at in &file.marks {
            let mark = at.get_ref();
            let key = format!("mark {}", mark.number);
            let problem = if !(1..=HIGHEST_MARK).contains(&mark.number) {
                format!("its number must be 1 to {HIGHEST_MARK}")
            } else if !numbers.insert(mark.number) {
                "is listed twice; give each mark a number of its own".to_owned()
            } else if let Some(problem) = setup::control_character(&mark.name) {
                problem
            } else {
                continue;
            };
            return Err(self.wrong(at, &key, problem));
        }
        let mut names = BTreeSet::new();
        for arm in &file.arms {
            let name = &arm.get_ref().name;
            if let Some(problem) = setup::control_character(name.get_ref()) {
                return Err(self.wrong(name, "name", problem));
            }
            if !names.insert(name.get_ref()) {
                let problem =
                    format!("two arms are named `{}`; a setup could not tell them apart", name.get_ref());
                return Err(self.wrong(name, "name", problem));
            }
        }
        if file.arms.is_empty() {
            let problem = "lists no arm; an application needs one [[arm]] for each robot".into();
            return Err(self.wrong(&file.name, "arm", problem));
        }
        Ok(())
    }

    /// Resolves what one arm is to do.
    fn arm(&self, arm: &Arm) -> Result<ArmApplication, Error> {
        let (mut steps, mut marks) = (Vec::new(), Vec::new());
        for at in &arm.steps {
            let step = at.get_ref();
            match &step.mark {
                Some(mark) => {
                    self.check_wait(arm, &steps, mark, at)?;
                    marks.push((mark, step, steps.len()));
                }
                None if step.name.is_empty() => {
                    return Err(self.wrong(at, "name", "a step that moves needs a name".into()));
                }
                None => match step.clone().step() {
                    Some(step) => steps.push(Spanned::new(at.span(), step)),
                    None => {
                        let problem = format!("step `{}` needs labels, or a mark", step.name);
                        return Err(self.wrong(at, "labels", problem));
                    }
                },
            }
        }
        let file = self.file.of_arm(arm, steps);
        let resolver = Resolver { origin: self.origin, text: self.text, file: &file };
        let mut application = resolver.resolved()?;
        for (mark, step, after_steps) in marks {
            let then = step.then.as_ref().map(|name| resolver.action(name)).transpose()?;
            self.check_action(step, after_steps, &application)?;
            application.waits.push(Wait { mark: *mark.get_ref(), after_steps, then });
        }
        Ok(ArmApplication { name: arm.name.get_ref().clone(), application })
    }

    /// Checks a mark among the steps of an arm.
    fn check_wait(
        &self,
        arm: &Arm,
        before: &[Spanned<crate::file::Step>],
        mark: &Spanned<u32>,
        at: &Spanned<ArmStep>,
    ) -> Result<(), Error> {
        let (number, name) = (*mark.get_ref(), arm.name.get_ref());
        let step = at.get_ref();
        if let Some(problem) =
            setup::control_character(&step.name).or_else(|| setup::control_character(&step.does))
        {
            return Err(self.wrong(at, "name", problem));
        }
        if let Some(key) = step.key_of_a_motion() {
            let problem = format!("mark {number} does not move the arm: write {key} in a step of its own");
            return Err(self.wrong(mark, "mark", problem));
        }
        if !self.file.marks.iter().any(|mark| mark.get_ref().number == number) {
            let problem = format!("{number} is not listed; add [[mark]] with number = {number}");
            return Err(self.wrong(mark, "mark", problem));
        }
        let is_this =
            |step: &&Spanned<ArmStep>| step.get_ref().mark.as_ref().map(Spanned::get_ref) == Some(&number);
        if arm.steps.iter().filter(is_this).count() > 1 {
            let problem = format!("arm `{name}` has mark {number} twice; give each wait a mark of its own");
            return Err(self.wrong(mark, "mark", problem));
        }
        if let (Some(then), true) = (&step.then, before.is_empty()) {
            let problem = format!("`{}` needs a motion before it", then.get_ref());
            return Err(self.wrong(then, "then", problem));
        }
        Ok(())
    }

    /// Checks that there is one action at most at each stop.
    fn check_action(
        &self,
        step: &ArmStep,
        after_steps: usize,
        application: &Application,
    ) -> Result<(), Error> {
        let Some(name) = &step.then else { return Ok(()) };
        let before = after_steps.checked_sub(1).and_then(|index| application.steps.get(index)?.then.as_ref());
        let earlier = application.waits_after(after_steps).find_map(|wait| wait.then.as_ref());
        match before.or(earlier) {
            None => Ok(()),
            Some(action) => {
                let problem = format!(
                    "`{}` and `{}` at one stop; put a motion between them",
                    action.name,
                    name.get_ref()
                );
                Err(self.wrong(name, "then", problem))
            }
        }
    }

    /// Checks that the arms meet at every mark.
    fn check_meetings(&self, application: &ArmsApplication) -> Result<(), Error> {
        meeting::check(application).map_err(|wrong| {
            let listed = self.file.marks.iter().find(|at| at.get_ref().number == wrong.mark());
            let key = format!("mark {}", wrong.mark());
            match listed {
                Some(at) => self.wrong(at, &key, wrong.to_string()),
                None => self.wrong(&self.file.name, &key, wrong.to_string()),
            }
        })
    }

    fn wrong<T>(&self, at: &Spanned<T>, key: &str, problem: String) -> Error {
        let line = line_of(self.text, at.span().start);
        Error::Value { origin: self.origin.to_owned(), line, key: key.to_owned(), problem }
    }
}
