//! The results of a sweep as sentences.

use super::table::{depths, percent, slots};
use super::{Sweep, SweepPoint};
use records::counted::counted;

/// Returns sentences on why this number of slots suffices, and up to where.
#[must_use]
pub fn sentences(sweep: &Sweep) -> Vec<String> {
    [threshold(sweep), reach(sweep), first_loss(sweep), short_sight(sweep)].into_iter().flatten().collect()
}

fn motion_ms(sweep: &Sweep, point: &SweepPoint) -> f64 {
    point.rc_ms / f64::from(sweep.motions)
}

/// Returns the points of the deepest queue.
fn deepest(sweep: &Sweep) -> impl Iterator<Item = &SweepPoint> {
    let deepest = depths(sweep).into_iter().max();
    sweep.points.iter().filter(move |point| Some(point.depth) == deepest)
}

/// Returns a sentence on the shortest motion that the round trip allows.
fn threshold(sweep: &Sweep) -> Option<String> {
    let of_setup = deepest(sweep).filter(|point| point.bus_cycle_ms == sweep.bus_cycle_ms);
    let points: Vec<&SweepPoint> = of_setup.collect();
    let shortest = points.iter().min_by(|a, b| a.rc_ms.total_cmp(&b.rc_ms))?;
    let SweepPoint { depth, round_trip_ms, bus_cycle_ms, length_mm, .. } = shortest;
    let ahead = depth.checked_sub(2).filter(|ahead| *ahead > 0)?;
    Some(format!(
        "At this setup's bus cycle of {bus_cycle_ms} ms a slot has its next motion at most {round_trip_ms:.1} ms after the one \
         before it is executed. The robot then still has at least {ahead} of {depth} motions before it must know of that one, \
         so {} suffice wherever a motion takes {:.1} ms; one of {length_mm} mm takes {:.0} ms.",
        slots(*depth),
        round_trip_ms / f64::from(ahead),
        motion_ms(sweep, shortest)
    ))
}

/// Returns a sentence on the longest bus cycle at which each depth loses nothing at any length.
fn reach(sweep: &Sweep) -> Option<String> {
    let reach = |depth: u32| {
        let of_depth = || sweep.points.iter().filter(move |point| point.depth == depth);
        let first_lost = of_depth()
            .filter(|point| point.loses())
            .map(|point| point.bus_cycle_ms)
            .fold(f64::INFINITY, f64::min);
        let kept = of_depth().map(|point| point.bus_cycle_ms).filter(|cycle| *cycle < first_lost);
        let kept = kept.fold(0.0, f64::max);
        if kept > 0.0 {
            format!("with {} {kept} ms", slots(depth))
        } else {
            format!("with {} none", slots(depth))
        }
    };
    let reaches: Vec<String> = depths(sweep).into_iter().map(reach).collect();
    (!reaches.is_empty()).then(|| {
        format!(
            "The longest bus cycle at which CM loses nothing, whichever of these lengths: {}.",
            reaches.join(", ")
        )
    })
}

/// Returns a sentence on the point at which the deepest queue loses first.
fn first_loss(sweep: &Sweep) -> Option<String> {
    let first = deepest(sweep)
        .filter(|point| point.loses())
        .min_by(|a, b| a.bus_cycle_ms.total_cmp(&b.bus_cycle_ms).then(b.length_mm.total_cmp(&a.length_mm)))?;
    let motion_ms = motion_ms(sweep, first);
    Some(format!(
        "{} lose first at a bus cycle of {} ms with motions of {} mm: the round trip of up to {:.0} ms is {:.1} of their \
         {motion_ms:.0} ms; CM then takes {} more than RC.",
        slots(first.depth),
        first.bus_cycle_ms,
        first.length_mm,
        first.round_trip_ms,
        first.round_trip_ms / motion_ms,
        percent(first.loss())
    ))
}

/// Returns a sentence on the points at which CM loses time but no blend.
fn short_sight(sweep: &Sweep) -> Option<String> {
    let short = || sweep.points.iter().filter(|point| point.looks_too_short());
    let deepest = short().map(|point| point.depth).max()?;
    let most = short().map(SweepPoint::loss).fold(0.0, f64::max);
    let points = counted(short().count(), "point");
    Some(format!(
        "At {points}, with at most {}, CM loses up to {} but no blend: the robot plans for a stop at the end of the \
         motions that it knows, and knows too few to be as quick as with its whole program.",
        slots(deepest),
        percent(most)
    ))
}
