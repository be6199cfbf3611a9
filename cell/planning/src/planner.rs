//! Steps I to IV of the paper's section 4, one cycle after another.

use protocol::image::{Configuration, MotionKind};
use setup::Setup;

use crate::application::{Action, Application, Course, Labels, Step, Tool};
use crate::error::Error;
use crate::geometry::{Point, Pose};
use crate::motion::{Arrival, Motion, Role};
use crate::path::Path;
use crate::plan::{Continuous, Plan, Reason, ToStart, WaitAt};
use crate::refusal::{LEAST_MM, LEAST_TURN_DEG, Refusal};
use crate::step_base::StepBase;
use crate::way::{Space, Way};
use crate::zone::{LEAST_ZONE_MM, Sizes, Why, swallowed_point};

/// Plans all cycles of an application on a setup: the paper's steps I to IV.
///
/// # Errors
/// [`Error::Refused`] names the step, the motion, the quantity and its limit; [`Error::NotCompact`] the first motion that has no compact
/// form on a setup whose PLC sends that.
pub fn plan(application: &Application, setup: &Setup) -> Result<Plan, Error> {
    let mut plan = Plan::empty(application, setup);
    let mut planner = Planner::new(application, setup);
    for cell in 0..application.cells() {
        planner.cycle(cell, &mut plan)?;
    }
    plan.to_start = planner.way_to_start()?;
    plan.wire_points(setup)?;
    Ok(plan)
}

/// Plans cycle after cycle. It remembers where the tool is and nothing else, so its memory does not grow.
#[derive(Debug)]
pub(crate) struct Planner<'a> {
    pub(crate) application: &'a Application,
    pub(crate) setup: &'a Setup,
    pub(crate) sizes: Sizes,
    /// Where the tool is, and which.
    here: (Pose, &'a Tool),
    /// What is known of the arm there.
    arrived: Arrival,
    /// Intermediate positions of this cycle so far.
    crossings: Vec<Point>,
    /// Motions planned so far, over all cycles.
    planned: u64,
}

impl<'a> Planner<'a> {
    pub(crate) fn new(application: &'a Application, setup: &'a Setup) -> Self {
        let programmed = setup.motions.approximation_mm.value;
        let sizes = Sizes {
            approximation_mm: application.zones.approximation_mm.unwrap_or(programmed),
            path_tolerance_mm: application.zones.path_tolerance_mm,
        };
        let (start, tool) = &application.start;
        let here = (application.pose(start, 0), tool);
        Self { application, setup, sizes, here, arrived: start.into(), crossings: Vec::new(), planned: 0 }
    }

    /// Returns the number of motions planned so far, over all cycles.
    pub(crate) const fn planned(&self) -> u64 {
        self.planned
    }

    /// Appends the motions of the steps in this cell of the grids. Where one is refused, those before it stay, ending in
    /// an exact stop.
    pub(crate) fn cycle(&mut self, cell: usize, plan: &mut Plan) -> Result<(), Error> {
        let first = plan.motions.len();
        plan.cycles.push(first);
        self.crossings.clear();
        let mut ways = Vec::new();
        let mut begin = first;
        // An action before the first step would have no motion to come after.
        let acted = plan.continuous.last().is_some_and(|it| it.motions.end == first && it.then.is_some());
        self.wait(0, acted, plan);
        let result = self.application.steps.iter().enumerate().try_for_each(|(index, step)| {
            self.step(index, step, cell, plan, &mut ways)?;
            let action = self.wait(index + 1, step.then.is_some(), plan);
            let ends = step.labels.accurate_stop || action.is_some();
            if ends && begin < plan.motions.len() {
                let motions = begin..plan.motions.len();
                begin = motions.end;
                plan.continuous.push(Continuous { motions, then: step.then.clone().or(action) });
            }
            Ok(())
        });
        if begin < plan.motions.len() {
            plan.continuous.push(Continuous { motions: begin..plan.motions.len(), then: None });
        }
        self.size_zones(first, plan, result.is_err(), ways);
        result
    }

    /// Appends the marks at which the arm waits after this many steps. `acted` says whether an action of the step comes first.
    /// Returns the action at one of the marks, if there is one.
    fn wait(&self, steps: usize, mut acted: bool, plan: &mut Plan) -> Option<Action> {
        let after = plan.motions.len();
        let mut action = None;
        for wait in self.application.waits_after(steps) {
            plan.waits.push(WaitAt { mark: wait.mark, after, after_action: acted, signal: None });
            if let Some(then) = &wait.then {
                acted = true;
                action.get_or_insert_with(|| then.clone());
            }
        }
        action
    }

    /// Plans step IV: sizes the zones of the motions from `first` on, and merges the reasons of the zones with those of
    /// the paths over obstacles.
    fn size_zones(&self, first: usize, plan: &mut Plan, refused: bool, ways: Vec<Reason>) {
        let mut ways = ways.into_iter().peekable();
        let end = plan.motions.len();
        let mut stops = plan.continuous.iter().filter(|it| it.motions.start >= first).peekable();
        for index in first..end {
            let stop = stops.next_if(|it| it.motions.end == index + 1);
            let mut swallowed = None;
            let mark = plan.waits_after(index + 1).next().map(|wait| wait.mark);
            let (zone, why) = match (stop, mark, plan.motions.get(index), plan.motions.get(index + 1)) {
                (Some(_), ..) if refused && index + 1 == end => (0.0, Why::LastGood),
                (Some(stop), ..) => {
                    let then = stop.then.as_ref().map(|then| then.name.clone());
                    (0.0, Why::AccurateStop { then })
                }
                (None, Some(mark), ..) => (0.0, Why::Mark { mark }),
                (None, None, Some(motion), Some(next)) => {
                    let (zone, why) = self.sizes.zone(index, motion, next);
                    swallowed = swallowed_point(index, motion, next, zone);
                    (zone, why)
                }
                (None, None, ..) => (0.0, Why::LastGood),
            };
            if let Some(motion) = plan.motions.get_mut(index) {
                motion.zone_mm = zone;
            }
            plan.reasons.extend(
                [Some(why), swallowed].into_iter().flatten().map(|why| Reason { motion: index, why }),
            );
            while let Some(reason) = ways.next_if(|reason| reason.motion <= index) {
                plan.reasons.push(reason);
            }
        }
    }

    fn step(
        &mut self,
        index: usize,
        step: &'a Step,
        cell: usize,
        plan: &mut Plan,
        reasons: &mut Vec<Reason>,
    ) -> Result<(), Error> {
        let rests = step.labels.accurate_stop || self.application.waits_after(index + 1).next().is_some();
        let into = &mut Destination { plan, reasons, index, step, rests, stops: false };
        self.take_tool(step, &step.tool)?;
        match &step.course {
            Course::Reach(place) => {
                let target = self.base_of(step).pose(self.application, place, cell);
                into.stops = into.rests;
                self.way(target, place.into(), "", into)
            }
            Course::Follow { .. } => self.follow(step, cell, into),
        }
    }

    fn base_of(&self, step: &Step) -> StepBase {
        StepBase::of(step, self.application, self.setup)
    }

    /// Plans the way to a path, its pre-movement, its motions and its post-movement.
    fn follow(&mut self, step: &'a Step, cell: usize, into: &mut Destination<'_>) -> Result<(), Error> {
        let Course::Follow { from, segments, approach_mm, retreat_mm } = &step.course else { return Ok(()) };
        let base = self.base_of(step);
        let start = from.as_ref().map_or(self.here.0, |from| base.pose(self.application, from, cell));
        let path = Path::plan(self.application, (step, base), start, segments, cell);
        let pre = path.pre_movement(*approach_mm);
        let post = path.post_movement(*retreat_mm);
        let first = from.as_ref().map_or_else(Arrival::default, Arrival::from);
        let (begin, arrival) = match &pre {
            // The joints are those of the path's beginning, and their signs too. A line leads there, so that elbow
            // and wrist are the same before it.
            Ok(Some(pre)) => {
                let status = |it: Configuration| Configuration { turn: None, ..it };
                let configuration = first.configuration.map(status);
                (pre.start, Arrival { joints_deg: None, configuration })
            }
            _ => (start, first),
        };
        if differ(self.here.0, begin) || self.arrived.may_differ_from(arrival) {
            // An accurate path is not blended where it begins.
            into.stops = step.labels.accurate_path && matches!(pre, Ok(None));
            self.way(begin, arrival, "before ", into)?;
            into.stops = false;
        }
        // A path that gives its pre-movement no direction is refused by its own number, one later.
        if let Some(pre) = pre.map_err(|refusal| self.refused(step, 1, refusal))? {
            let pre = Motion { configuration: first.configuration, ..pre };
            self.push(pre, &format!("LIN before {}", step.name), into)?;
        }
        let count = path.motions.len();
        for (number, motion) in path.motions.into_iter().enumerate() {
            let kind = kind_name(motion.kind);
            let name = match count {
                1 => format!("{kind} {}", step.name),
                _ => format!("{kind} {} {}/{count}", step.name, number + 1),
            };
            into.stops = into.rests && number + 1 == count && matches!(post, Ok(None));
            self.push(motion, &name, into)?;
        }
        into.stops = into.rests;
        if let Some(refusal) = path.refusal {
            return Err(self.refused(step, 0, refusal));
        }
        match post.map_err(|refusal| self.refused(step, 0, refusal))? {
            Some(post) => self.push(post, &format!("LIN after {}", step.name), into),
            None => Ok(()),
        }
    }

    /// Plans the motions to the start, from anywhere and from where the tool is now.
    pub(crate) fn way_to_start(&mut self) -> Result<ToStart, Error> {
        let (place, tool) = &self.application.start;
        let step = Step {
            name: "the start".to_owned(),
            does: String::new(),
            labels: Labels { accurate_path: false, accurate_stop: true },
            tool: tool.clone(),
            base: None,
            course: Course::Reach(place.clone()),
            speed_mm_s: None,
            speed_percent: 100.0,
            then: None,
        };
        self.take_tool(&step, tool)?;
        let start = self.application.pose(place, 0);
        let mut plan = Plan::default();
        let reasons = &mut Vec::new();
        let into =
            &mut Destination { plan: &mut plan, reasons, index: 0, step: &step, rests: true, stops: true };
        if differ(self.here.0, start) || self.arrived.may_differ_from(place.into()) {
            self.way(start, place.into(), "to ", into)?;
        }
        let from_anywhere = Motion {
            name: "PTP to the start".to_owned(),
            tool: tool.number,
            base: self.application.base,
            ..Motion::point_to_point(Role::ToStart, start, start, place.into())
        };
        let from_end =
            plan.motions.into_iter().map(|motion| Motion { role: Role::ToStart, ..motion }).collect();
        Ok(ToStart { from_anywhere: Some(from_anywhere), from_end })
    }

    /// Changes to a tool, whose tip is elsewhere; refuses a tool or a base that the robot does not have.
    fn take_tool(&mut self, step: &Step, tool: &'a Tool) -> Result<(), Error> {
        let robot = &self.setup.robot;
        let frame = |number: u8, frames: &[setup::Frame]| match number {
            0 => Some(Pose::new([0.0; 6])),
            _ => {
                frames.iter().find(|frame| frame.number == number).map(|frame| Pose::new(frame.mm_deg.value))
            }
        };
        let unknown = |what, number, frames: &[setup::Frame]| {
            let known = std::iter::once(0).chain(frames.iter().map(|frame| frame.number)).collect();
            self.refused(step, 0, Refusal::UnknownFrame { what, number, known })
        };
        for number in [Some(self.application.base), step.base].into_iter().flatten() {
            if frame(number, &robot.bases).is_none() {
                return Err(unknown("base", number, &robot.bases));
            }
        }
        let (here, old) = self.here;
        let [old_frame, new_frame] = [old, tool].map(|tool| {
            frame(tool.number, &robot.tools).ok_or_else(|| unknown("tool", tool.number, &robot.tools))
        });
        let (old_frame, new_frame) = (old_frame?, new_frame?);
        let here = if old.number == tool.number { here } else { here.change_tool(old_frame, new_frame) };
        self.here = (here, tool);
        Ok(())
    }

    /// Plans step III: a secondary motion, over intermediate positions if an obstacle is in the way.
    fn way(
        &mut self,
        target: Pose,
        arrival: Arrival,
        word: &str,
        into: &mut Destination<'_>,
    ) -> Result<(), Error> {
        let from = self.here.0;
        self.not_enclosed(target.point, &format!("the target of `PTP {word}{}`", into.step.name))
            .map_err(|refusal| self.refused(into.step, 0, refusal))?;
        let way = match &self.application.ways {
            Some(ways) => {
                let space = Space {
                    obstacles: &self.application.obstacles,
                    ways,
                    approximation_mm: self.sizes.approximation_mm,
                    bows_sideways: self.bows_sideways(),
                    blends: [into.blends_at_start(into.plan.motions.len()), !into.stops],
                };
                space
                    .way(from.point, target.point, &self.crossings)
                    .map_err(|refusal| self.refused(into.step, 0, refusal))?
            }
            None => Way::Direct,
        };
        if let Way::Over { points, obstacle, again } = way {
            let (name, top_mm) = self
                .application
                .obstacles
                .get(obstacle)
                .map_or(("", 0.0), |obstacle| (obstacle.name.as_str(), obstacle.space.upper.z));
            if let ([Some(via), None], false) = (points, again) {
                self.crossings.push(via);
            }
            for via in points.into_iter().flatten() {
                let motion =
                    Motion::point_to_point(Role::Crossing, self.here.0, target.at(via), Arrival::default());
                self.push(motion, &format!("PTP over the {name}"), into)?;
                let step_mm = self.application.ways.map_or(0.0, |ways| ways.height_step_mm);
                let why = Why::Over { obstacle: name.to_owned(), top_mm, step_mm, again };
                into.reasons.push(Reason { motion: into.plan.motions.len() - 1, why });
            }
        }
        let motion = Motion::point_to_point(Role::Way, self.here.0, target, arrival);
        self.push(motion, &format!("PTP {word}{}", into.step.name), into)
    }

    /// Returns whether a single axis of the arm moves the tool along the vertical of the base, so that a PTP bows
    /// sideways only.
    fn bows_sideways(&self) -> bool {
        let robot = &self.setup.robot;
        let mut bases = robot.bases.iter().filter(|base| base.number == self.application.base);
        let is_upright = bases.all(|base| matches!(base.mm_deg.value, [.., b, c] if b == 0.0 && c == 0.0));
        is_upright && matches!(robot.kinematics, setup::Kinematics::Scara(_))
    }

    /// Appends a motion, if nothing in it is beyond a limit.
    fn push(&mut self, motion: Motion, name: &str, into: &mut Destination<'_>) -> Result<(), Error> {
        let mut motion = Motion {
            name: name.to_owned(),
            step: into.index,
            speed_percent: into.step.speed_percent,
            tool: into.step.tool.number,
            base: self.application.base,
            ..motion
        };
        let index = into.plan.motions.len();
        let before = into.last_if_blended(&motion).filter(|_| self.sizes.approximation_mm >= LEAST_ZONE_MM);
        let is_bent = before.map(|before| before.bend_into(&mut motion)).is_some();
        if let Some(before) = into.plan.motions.last().filter(|_| is_bent) {
            // It was straight at its end so far.
            let blends = [into.blends_at_start(index - 1), true];
            self.check_obstacles(before, blends).map_err(|refusal| self.refused(into.step, 0, refusal))?;
        }
        let blends = [into.blends_at_start(index), !into.stops];
        self.check(&motion, blends).map_err(|refusal| self.refused(into.step, 0, refusal))?;
        let programmed = self.setup.motions.velocity_percent.value / 100.0 * motion.speed_percent / 100.0
            * self.setup.robot.path_velocity_mm_s.value;
        if let Some(wanted_mm_s) = motion.speed_mm_s.filter(|&wanted| wanted > programmed) {
            let why = Why::Slower { wanted_mm_s, programmed_mm_s: programmed };
            into.reasons.push(Reason { motion: index, why });
        }
        self.here.0 = motion.target;
        self.arrived = self.arrived.then(&motion);
        self.planned += 1;
        into.plan.motions.push(motion);
        Ok(())
    }

    /// Returns the error for the motion that would have come next, or `later` motions after it.
    fn refused(&self, step: &Step, later: u64, refusal: Refusal) -> Error {
        Error::Refused { step: step.name.clone(), motion: self.planned + 1 + later, refusal }
    }
}

/// Where the motions of a step go.
struct Destination<'p> {
    plan: &'p mut Plan,
    /// Reasons that are not of a zone.
    reasons: &'p mut Vec<Reason>,
    index: usize,
    step: &'p Step,
    /// Whether the arm rests at the end of the step: exactly there, or at a mark.
    rests: bool,
    /// Whether the arm stops exactly at the end of the motion or of the way that comes next.
    stops: bool,
}

impl Destination<'_> {
    /// Returns whether motion `index` may be blended with the one before.
    fn blends_at_start(&self, index: usize) -> bool {
        let before = index.checked_sub(1).and_then(|before| self.plan.motions.get(before));
        let stopped = self.plan.rests_after(index);
        !stopped && before.is_some_and(|before| !before.accurate_path && !before.kind.has_force())
    }

    /// Returns the last motion if it belongs to another step and is blended with the next one.
    fn last_if_blended(&mut self, next: &Motion) -> Option<&mut Motion> {
        let end = self.plan.motions.len();
        let stops = self.plan.rests_after(end);
        let last = self.plan.motions.last_mut()?;
        (!stops && last.step != next.step && !last.accurate_path && !next.accurate_path).then_some(last)
    }
}

/// Returns whether two poses differ so much that a motion is needed between them.
fn differ(from: Pose, to: Pose) -> bool {
    (to.point - from.point).length() >= LEAST_MM || from.turn_deg(to) >= LEAST_TURN_DEG
}

/// Returns the name of a kind of motion, for people.
pub(crate) const fn kind_name(kind: MotionKind) -> &'static str {
    match kind {
        MotionKind::LinCartesian => "LIN",
        MotionKind::PtpCartesian => "PTP",
        MotionKind::PtpJoint => "PTP joint",
        MotionKind::Circular => "CIRC",
        MotionKind::Spline => "SPLINE",
        MotionKind::LinForceCartesian => "LIN force",
        MotionKind::None | MotionKind::Unknown(_) => "-",
    }
}
