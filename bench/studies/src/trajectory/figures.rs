//! Figures of a trajectory: speed, deviation and what limits it, from the robot's ticks.

use records::trace::RobotTick;
use serde::Serialize;
use setup::Setup;

use super::points::{PathPoints, distance};

/// Length at the start and at the end of the path that the mean and the lowest speed leave out, in mm, and its largest share.
const RAMP_MM: f64 = 100.0;
const MOST_RAMP: f64 = 0.25;

/// Ticks before and after the one at which a point is counted in which the arm passes it.
const NEAR_TICKS: usize = 8;

/// Share of the jerk that a constant speed may use, as in the robot's law; and the third difference of four values that are each
/// rounded by up to a half.
const TWISTING: f64 = 0.9;
const ROUNDED: f64 = 4.0;

/// Compact points of three coordinates that an image holds.
const POINTS: f64 = 30.0;

/// Share of a limit from which on the speed counts as limited by it; of that of the rounding, which is one for a mean error.
const REACHED: f64 = 0.8;
const REACHED_BY_ROUNDING: f64 = 0.5;

/// Limit of the speed.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum SpeedLimit {
    /// The programmed speed.
    Programmed,
    /// Motions taken in a robot cycle.
    Taking,
    /// Braking within the motions that are known.
    LookAhead,
    /// Rounding of the coordinates in the file.
    Resolution,
    /// The corners between lines.
    Corner,
    /// A joint, or the programmed acceleration where the path bends.
    Joint,
}

/// Highest speeds that each limit allows on steps of this length, in mm/s.
#[derive(Clone, Copy, PartialEq, Debug, Serialize)]
pub struct SpeedLimits {
    /// The programmed speed.
    pub programmed: f64,
    /// Motions taken in a robot cycle.
    pub taking: f64,
    /// Braking within the motions that are known.
    pub look_ahead: f64,
    /// Rounding of the coordinates; `None` where the file's are exact or points were computed.
    pub resolution: Option<f64>,
}

/// Motions that the robot has accepted in a cycle.
#[derive(Clone, Copy, PartialEq, Debug, Serialize)]
pub struct AcceptedPerCycle {
    /// Their mean over the middle of the path.
    pub mean: f64,
    /// Their largest number.
    pub most: u32,
}

/// Figures of one trajectory.
#[derive(Clone, PartialEq, Debug, Serialize)]
pub struct TrajectoryFigures {
    /// Length from point to point, in mm.
    pub length_mm: f64,
    /// Mean distance of two points, in mm.
    pub spacing_mm: f64,
    /// Length at the start and at the end that mean and lowest speed leave out, in mm.
    pub ramp_mm: f64,
    /// Mean speed of the tool between both.
    pub mean_mm_s: f64,
    /// Lowest speed of the tool there.
    pub lowest_mm_s: f64,
    /// Motions that ended in a stop because the next one came late.
    pub suppressed: u16,
    /// Largest distance of a point from the driven path, in mm.
    pub deviation_mm: f64,
    /// Motions accepted in a robot cycle.
    pub accepted_per_cycle: AcceptedPerCycle,
    /// Limit of the mean speed.
    pub limited_by: SpeedLimit,
    /// Speed that each limit allows.
    pub limits: SpeedLimits,
}

/// Programmed speed and acceleration.
#[derive(Clone, Copy, Debug)]
pub(super) struct ProgrammedPath {
    pub(super) speed_mm_s: f64,
    pub(super) acceleration_mm_s2: f64,
    pub(super) is_lines: bool,
    /// Length of a step of compact points, in µm; none in the full form.
    pub(super) resolution_um: Option<f64>,
}

/// Returns the ticks on the path, from where the arm stands at its first point.
pub(super) fn on_path(ticks: &[RobotTick]) -> &[RobotTick] {
    let first = ticks.iter().position(|tick| tick.sample.executed >= 1).unwrap_or(ticks.len());
    ticks.get(first..).unwrap_or_default()
}

/// Returns the way that the tool has gone at each tick, in mm.
pub(super) fn ways(ticks: &[RobotTick]) -> Vec<f64> {
    let steps = ticks.windows(2).map(|pair| distance(&place(&pair[0]), &place(&pair[1])));
    let mut way = 0.0;
    let after = steps.map(|step| {
        way += step;
        way
    });
    std::iter::once(0.0).chain(after).take(ticks.len()).collect()
}

pub(super) fn place(tick: &RobotTick) -> [f64; 3] {
    std::array::from_fn(|i| f64::from(tick.sample.pose[i]))
}

impl TrajectoryFigures {
    /// Returns the figures of a path that was driven in these ticks; `None` where the arm has not passed it.
    pub(super) fn of(
        setup: &Setup,
        path: &PathPoints,
        programmed: ProgrammedPath,
        ticks: &[RobotTick],
    ) -> Option<Self> {
        let ticks = on_path(ticks);
        let ways = ways(ticks);
        let whole = *ways.last()?;
        let ramp_mm = RAMP_MM.min(MOST_RAMP * whole);
        let middle = |way: &f64| (ramp_mm..=whole - ramp_mm).contains(way);
        let from = ways.iter().position(middle)?;
        let to = ways.iter().rposition(middle).filter(|to| *to > from)?;
        let (first, last) = (ticks.get(from)?, ticks.get(to)?);
        let seconds = |one: &RobotTick, other: &RobotTick| (other.at_ms - one.at_ms) / 1e3;
        let speeds =
            (from..to).map(|tick| (ways[tick + 1] - ways[tick]) / seconds(&ticks[tick], &ticks[tick + 1]));
        let accepted = (from..to).map(|tick| ticks[tick + 1].sample.accepted - ticks[tick].sample.accepted);
        let length_mm = path.length_mm();
        let spacing_mm = length_mm / (path.points.len() - 1) as f64;
        let mean_mm_s = (ways[to] - ways[from]) / seconds(first, last);
        let limits = SpeedLimits::of(setup, path, programmed, spacing_mm);
        Some(Self {
            length_mm,
            spacing_mm,
            ramp_mm,
            mean_mm_s,
            lowest_mm_s: speeds.fold(f64::INFINITY, f64::min),
            suppressed: ticks.last().map_or(0, |tick| tick.sample.blends_suppressed),
            deviation_mm: deviation(path, ticks),
            accepted_per_cycle: AcceptedPerCycle {
                mean: accepted.clone().map(f64::from).sum::<f64>() / (to - from) as f64,
                most: accepted.max().unwrap_or(0),
            },
            limited_by: limits.limiting(mean_mm_s, programmed.is_lines),
            limits,
        })
    }
}

/// Returns the largest distance of a point from the driven path: from the chords between ticks about the one at which its motion
/// counts as executed.
fn deviation(path: &PathPoints, ticks: &[RobotTick]) -> f64 {
    let mut at = 0;
    let mut most = 0.0_f64;
    for (point, number) in path.points.iter().zip(0_u32..) {
        while ticks.get(at).is_some_and(|tick| tick.sample.executed <= number) {
            at += 1;
        }
        let near = at.saturating_sub(NEAR_TICKS)..(at + NEAR_TICKS).min(ticks.len());
        let near = ticks.get(near).unwrap_or_default();
        let least = near.windows(2).map(|pair| from_chord(&point.place, &place(&pair[0]), &place(&pair[1])));
        most = most.max(least.fold(f64::INFINITY, f64::min));
    }
    most
}

/// Returns the distance of a place from a chord.
fn from_chord(point: &[f64; 3], one: &[f64; 3], other: &[f64; 3]) -> f64 {
    let chord: [f64; 3] = std::array::from_fn(|i| other[i] - one[i]);
    let square: f64 = chord.iter().map(|x| x * x).sum();
    let along: f64 = (0..3).map(|i| chord[i] * (point[i] - one[i])).sum();
    let share = if square > 0.0 { (along / square).clamp(0.0, 1.0) } else { 0.0 };
    distance(point, &std::array::from_fn(|i| one[i] + share * chord[i]))
}

impl SpeedLimits {
    fn of(setup: &Setup, path: &PathPoints, programmed: ProgrammedPath, spacing_mm: f64) -> Self {
        let robot = &setup.robot;
        let cycle_s = f64::from(robot.cycle_us.value) * 1e-6;
        let slots = f64::from(setup.plc.slots_in_use());
        let taken = if programmed.resolution_um.is_some() { 2.0 * slots } else { slots };
        let is_deep = f64::from(robot.queue_holds()) > slots;
        let known = match setup.plc.refills_by() {
            setup::Refill::Executed if programmed.resolution_um.is_some() => POINTS,
            setup::Refill::Executed => slots,
            setup::Refill::Accepted => f64::from(robot.queue_holds()),
        };
        let (a, jerk) = (programmed.acceleration_mm_s2, robot.path_jerk_mm_s3.value);
        // Braking takes v²/2a + v·a/2j.
        let (half, way) = (a * a / (2.0 * jerk), (known - 1.0) * spacing_mm);
        let of_file = path.decimals.map(|decimals| libm::pow(0.1, decimals.into()));
        let of_points = programmed.resolution_um.map(|step| step / 1_000.0);
        let rounded_to = [of_file, of_points].into_iter().flatten().reduce(f64::max);
        Self {
            programmed: programmed.speed_mm_s,
            taking: if is_deep { taken } else { 1.0 } * spacing_mm / cycle_s,
            look_ahead: (half * half + 2.0 * a * way).sqrt() - half,
            resolution: rounded_to.map(|rounded_to| {
                let farthest = path
                    .points
                    .iter()
                    .flat_map(|point| point.place)
                    .fold(0.0, |most: f64, x| most.max(x.abs()));
                let step = rounded_to.max(farthest * f64::from(f32::EPSILON) / 2.0);
                spacing_mm * libm::cbrt(TWISTING * jerk / (ROUNDED * step))
            }),
        }
    }

    fn limiting(&self, mean_mm_s: f64, is_lines: bool) -> SpeedLimit {
        let mut all = vec![
            (SpeedLimit::Programmed, self.programmed),
            (SpeedLimit::Taking, self.taking),
            (SpeedLimit::LookAhead, self.look_ahead),
        ];
        all.extend(self.resolution.map(|speed| (SpeedLimit::Resolution, speed)));
        let lowest = all.into_iter().min_by(|(_, one), (_, other)| one.total_cmp(other));
        match lowest {
            Some((SpeedLimit::Resolution, speed)) if mean_mm_s >= REACHED_BY_ROUNDING * speed => {
                SpeedLimit::Resolution
            }
            Some((limit, speed)) if mean_mm_s >= REACHED * speed => limit,
            // Bends by rounding slow the arm down before the mean error does.
            _ if self.resolution.is_some_and(|speed| mean_mm_s >= REACHED_BY_ROUNDING * speed) => {
                SpeedLimit::Resolution
            }
            _ if is_lines => SpeedLimit::Corner,
            _ => SpeedLimit::Joint,
        }
    }

    /// Returns how many digits after the decimal point the programmed speed needs, where the file has fewer.
    pub(super) fn digits_needed(&self, path: &PathPoints, spacing_mm: f64, jerk: f64) -> Option<u32> {
        let decimals = path.decimals?;
        if self.resolution? >= self.programmed {
            return None;
        }
        let step = TWISTING * jerk / ROUNDED * libm::pow(spacing_mm / self.programmed, 3.0);
        let digits = (-libm::log10(step)).ceil().max(0.0) as u32;
        (digits > decimals).then_some(digits)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_digits_of_a_file_limit_the_speed_as_the_jerk_of_their_rounding_does() {
        let setup = setup::setup("A").unwrap();
        let programmed = ProgrammedPath {
            speed_mm_s: 500.0,
            acceleration_mm_s2: 5_000.0,
            is_lines: false,
            resolution_um: None,
        };
        let path = PathPoints::from_csv("0.000,0,0\n0.250,0,0\n0.500,0,0\n").unwrap();
        let limits = SpeedLimits::of(&setup, &path, programmed, 0.25);
        let speed = limits.resolution.unwrap();
        assert!((120.0..122.0).contains(&speed), "{speed}");
        assert_eq!(limits.digits_needed(&path, 0.25, 500_000.0), Some(5));
        assert_eq!(limits.limiting(60.0, false), SpeedLimit::Taking, "{limits:?}");
        assert!((60.0..63.0).contains(&limits.taking), "{limits:?}");
    }

    #[test]
    fn a_point_is_as_far_from_a_chord_as_from_its_nearest_place() {
        let chord = ([0.0; 3], [2.0, 0.0, 0.0]);
        assert_eq!(from_chord(&[1.0, 3.0, 4.0], &chord.0, &chord.1), 5.0);
        assert_eq!(from_chord(&[5.0, 0.0, 4.0], &chord.0, &chord.1), 5.0);
        assert_eq!(from_chord(&[3.0, 4.0, 0.0], &chord.0, &chord.0), 5.0);
    }
}
