//! A plan for a person to read: labels, motions with their zones and reasons, continuous motions. Its warnings are sentences of their own.

use std::fmt;
use std::ops::Range;

use crate::application::{Action, Labels};
use crate::motion::Motion;
use crate::plan::{Plan, Reason};
use crate::planner::kind_name;
use crate::zone::Why;

/// Width of the longest label.
const LABEL: usize = "accurate path, accurate stop".len();

/// Smallest width of the column of reasons, in characters: a narrower one would have too many lines.
const LEAST_REASON: usize = 30;

/// The paper's planning step (section 4) that made a part of the plan.
const STEPS: [(&str, &str); 4] = [
    ("I", "paths of the process"),
    ("II", "linear pre- and post-movements"),
    ("III", "secondary motions"),
    ("IV", "continuous motions and their zones"),
];

impl fmt::Display for Plan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        show_wrapped(f, "", &format!("{} on setup {}: {}", self.name, self.setup, self.title))?;
        self.show_labels(f)?;
        writeln!(f, "\nplanning steps")?;
        STEPS.iter().try_for_each(|(step, makes)| writeln!(f, "  {step:3}  {makes}"))?;
        let shown = if f.alternate() { self.cycles.len() } else { 1 };
        for (cycle, range) in self.ranges().enumerate().take(shown) {
            self.show_cycle(f, cycle, range)?;
        }
        self.show_way_back(f)?;
        let (motions, continuous) = (self.motions.len(), self.continuous.len());
        writeln!(f)?;
        let mut count =
            format!("{} in {}", counted(motions, "motion"), counted(continuous, "continuous motion"));
        if self.cycles.len() > 1 {
            count += &format!(" in {} cycles, {shown} of them shown", self.cycles.len());
        }
        show_wrapped(f, "", &count)?;
        Ok(())
    }
}

impl Plan {
    /// Returns the range of motions of each cycle.
    fn ranges(&self) -> impl Iterator<Item = Range<usize>> + '_ {
        let ends = self.cycles.iter().skip(1).copied().chain([self.motions.len()]);
        self.cycles.iter().copied().zip(ends).map(|(begin, end)| begin..end)
    }

    fn show_labels(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "\nlabels at process level")?;
        let width = |length: &dyn Fn(&crate::plan::StepLabels) -> usize| {
            self.labels.iter().map(length).max().unwrap_or(0)
        };
        let step = width(&|it| it.step.chars().count());
        let labels = width(&|it| it.labels.to_string().len());
        for it in &self.labels {
            let line = format!("{:labels$}  {}", it.labels.to_string(), it.does);
            show_wrapped(f, &format!("  {:step$}  ", it.step), line.trim_end())?;
        }
        Ok(())
    }

    fn show_cycle(&self, f: &mut fmt::Formatter<'_>, cycle: usize, range: Range<usize>) -> fmt::Result {
        if self.cycles.len() > 1 {
            writeln!(f, "\ncycle {}", cycle + 1)?;
        }
        let name = self.motions.iter().map(|motion| motion.name.chars().count()).max().unwrap_or(0);
        let inside = self
            .continuous
            .iter()
            .enumerate()
            .filter(|(_, it)| it.motions.start >= range.start && it.motions.end <= range.end);
        if range.start == 0 {
            self.show_waits(f, 0, false)?;
        }
        for (number, continuous) in inside {
            writeln!(
                f,
                "\nstep IV: continuous motion {}, {}",
                number + 1,
                counted(continuous.motions.len(), "motion")
            )?;
            if is_narrow(f, name) {
                for index in continuous.motions.clone() {
                    if let Some(motion) = self.motions.get(index) {
                        self.show_narrow_motion(f, index, motion)?;
                    }
                    self.show_waits(f, index + 1, false)?;
                }
                if let Some(then) = &continuous.then {
                    show_wrapped(f, "  then  ", &described(then))?;
                }
                self.show_waits(f, continuous.motions.end, true)?;
                continue;
            }
            writeln!(
                f,
                "  {:>4}  {:4}  {:name$}  {:>23}  {:>20}  {:>9}  {:LABEL$}  zone mm  why",
                "no", "step", "motion", "x, y, z mm", "a, b, c °", "speed", "label"
            )?;
            for index in continuous.motions.clone() {
                if let Some(motion) = self.motions.get(index) {
                    self.show_motion(f, index, motion, name)?;
                }
                self.show_waits(f, index + 1, false)?;
            }
            if let Some(then) = &continuous.then {
                writeln!(f, "  then  {}", described(then))?;
            }
            self.show_waits(f, continuous.motions.end, true)?;
        }
        Ok(())
    }

    /// Writes the marks at which the arm waits once this many motions are executed, before or after the action there.
    fn show_waits(&self, f: &mut fmt::Formatter<'_>, motions: usize, after_action: bool) -> fmt::Result {
        let here = self.waits_after(motions).filter(|wait| wait.after_action == after_action);
        here.into_iter().try_for_each(|wait| show_wrapped(f, "  wait  ", &format!("at mark {}", wait.mark)))
    }

    /// Writes what comes before the next repetition, if it does not begin where this one ends.
    fn show_way_back(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let motions = &self.to_start.from_end;
        if motions.is_empty() {
            return Ok(());
        }
        writeln!(f)?;
        show_wrapped(
            f,
            "",
            "the end is not the start: the PLC moves the arm back before a repetition, not measured",
        )?;
        let name = motions.iter().map(|motion| motion.name.chars().count()).max().unwrap_or(0);
        for motion in motions {
            let [x, y, z, a, b, c] = motion.target.mm_deg().map(no_minus_zero);
            if is_narrow(f, name) {
                writeln!(f, "  {}", motion.name)?;
                writeln!(f, "        to {x:.1}, {y:.1}, {z:.1} mm; {a:.1}, {b:.1}, {c:.1}°")?;
                continue;
            }
            writeln!(
                f,
                "        {:name$}  {x:>7.1} {y:>7.1} {z:>7.1}  {a:>6.1} {b:>6.1} {c:>6.1}",
                motion.name
            )?;
        }
        Ok(())
    }

    fn show_motion(
        &self,
        f: &mut fmt::Formatter<'_>,
        index: usize,
        motion: &Motion,
        width: usize,
    ) -> fmt::Result {
        let [x, y, z, a, b, c] = motion.target.mm_deg().map(no_minus_zero);
        let (speed, label) = (speed(motion), self.label(index, motion));
        let mut reasons = self.reasons_of(index);
        let zone = reasons.next().map(|reason| &reason.why);
        writeln!(
            f,
            "  {:>4}  {:4}  {:width$}  {x:>7.1} {y:>7.1} {z:>7.1}  {a:>6.1} {b:>6.1} {c:>6.1}  {speed:>9}  {label:LABEL$}  {:>7.2}  {}",
            index + 1,
            motion.role.step(),
            motion.name,
            motion.zone_mm,
            zone.map(Why::to_string).unwrap_or_default(),
        )?;
        let indent = table_width(width);
        for detail in details(motion) {
            writeln!(f, "{:indent$}{detail}", "")?;
        }
        reasons.try_for_each(|reason| writeln!(f, "{:indent$}{}", "", reason.why))
    }

    /// Writes a motion over several lines, for screens on which the table does not fit.
    fn show_narrow_motion(&self, f: &mut fmt::Formatter<'_>, index: usize, motion: &Motion) -> fmt::Result {
        let [x, y, z, a, b, c] = motion.target.mm_deg().map(no_minus_zero);
        let step = motion.role.step();
        let heading = format!("{}, step {step}, {}", motion.name, self.label(index, motion));
        show_wrapped(f, &format!("  {:>4}  ", index + 1), heading.trim_end_matches(", "))?;
        writeln!(f, "        to {x:.1}, {y:.1}, {z:.1} mm; {a:.1}, {b:.1}, {c:.1}°")?;
        writeln!(f, "        at {}, zone {:.2} mm", speed(motion), motion.zone_mm)?;
        for detail in details(motion) {
            show_wrapped(f, "        ", &detail)?;
        }
        self.reasons_of(index).try_for_each(|reason| show_wrapped(f, "        ", &reason.why.to_string()))
    }

    /// Returns the labels of a motion as text.
    fn label(&self, index: usize, motion: &Motion) -> String {
        let zone = self.reasons_of(index).next().map(|reason| &reason.why);
        let stops = matches!(zone, Some(Why::AccurateStop { .. } | Why::LastGood));
        if stops && !motion.accurate_path {
            return "accurate stop".into();
        }
        Labels { accurate_path: motion.accurate_path, accurate_stop: stops }.to_string()
    }

    /// Returns the reasons of one motion; they are ordered by motion, that of the zone first.
    fn reasons_of(&self, motion: usize) -> impl Iterator<Item = &Reason> {
        let begin = self.reasons.partition_point(|reason| reason.motion < motion);
        self.reasons.iter().skip(begin).take_while(move |reason| reason.motion == motion)
    }
}

/// Returns the width in characters left of the reasons, if the longest name of a motion has this width.
const fn table_width(name: usize) -> usize {
    2 + 4 + 2 + 4 + 2 + name + 2 + 23 + 2 + 20 + 2 + 9 + 2 + LABEL + 2 + 7 + 2
}

/// Returns whether the table leaves no room for reasons on a screen of the formatter's width, if that is given.
fn is_narrow(f: &fmt::Formatter<'_>, name: usize) -> bool {
    f.width().is_some_and(|width| width < table_width(name) + LEAST_REASON)
}

/// Writes text after a prefix; further lines are as far to the right.
fn show_wrapped(f: &mut fmt::Formatter<'_>, prefix: &str, text: &str) -> fmt::Result {
    let indent = prefix.chars().count();
    let room = f.width().unwrap_or(usize::MAX).saturating_sub(indent);
    let mut line = String::new();
    let mut before = prefix.to_owned();
    for word in text.split(' ') {
        if !line.is_empty() && line.chars().count() + 1 + word.chars().count() > room {
            writeln!(f, "{before}{line}")?;
            (line, before) = (String::new(), " ".repeat(indent));
        }
        if !line.is_empty() {
            line.push(' ');
        }
        line.push_str(word);
    }
    writeln!(f, "{before}{line}")
}

fn speed(motion: &Motion) -> String {
    match motion.speed_mm_s {
        Some(speed) => format!("{speed} mm/s"),
        None => format!("{} %", motion.speed_percent),
    }
}

/// Returns what a motion has besides its target, one line each.
fn details(motion: &Motion) -> impl Iterator<Item = String> {
    let [x, y, z] = motion.auxiliary.map(no_minus_zero);
    let auxiliary = match kind_name(motion.kind) {
        "CIRC" => Some(format!("through {x:.1}, {y:.1}, {z:.1} mm")),
        "LIN force" => Some(format!("force {x:.1}, {y:.1}, {z:.1} N")),
        _ => None,
    };
    let configuration = motion.configuration.map(|it| format!("configuration: {it}"));
    let joints = motion.joints_deg.map(|joints| joints.map(|joint| format!("{joint:.1}")).join(", "));
    [auxiliary, configuration, joints.map(|joints| format!("joints {joints}"))].into_iter().flatten()
}

fn described(action: &Action) -> String {
    let switch = if action.set { "set" } else { "clear" };
    format!("{}: {switch} output {}, wait {} ms", action.name, action.output, action.wait_ms)
}

fn counted(number: usize, thing: &str) -> String {
    if number == 1 { format!("1 {thing}") } else { format!("{number} {thing}s") }
}

/// Returns 0.0 for a value that would be printed as -0.0, and any other value as it is.
fn no_minus_zero(value: f64) -> f64 {
    if value.abs() < 0.05 { 0.0 } else { value }
}
