//! The runs of an exploration: one fault at each frame of each station, or faults drawn by a seed.

use rand_core::SeedableRng;
use rand_pcg::Pcg64Mcg;

use super::fault::{AtFrame, Extent, Injected, What, below};

/// One frame of so many is held as an old one: each such run takes up to a minute of the cell's time.
const OLD_SHARE: u64 = 8;

/// One run to be made.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) struct Job {
    /// Number of the execution type among those of the exploration.
    pub(super) type_index: usize,
    /// Its faults, in the order of their kinds.
    pub(super) faults: Vec<Injected>,
}

/// Returns a job for each kind of fault at every n-th frame of each station. `extents` are those of each type without a fault.
pub(super) fn singles(extents: &[Vec<Extent>], kinds: &[What], every: u64, seed: u64) -> Vec<Job> {
    let mut jobs = Vec::new();
    for (type_index, stations) in extents.iter().enumerate() {
        for (station, extent) in stations.iter().enumerate() {
            for what in kinds.iter().filter(|what| extent.has(**what)) {
                let at_frames = frames_of(*what, station, extent, every);
                jobs.extend(
                    at_frames
                        .map(|at| Job { type_index, faults: vec![Injected::new(*what, at, seed, extent)] }),
                );
            }
        }
    }
    jobs
}

/// Returns every n-th frame of a station with which a fault of this kind can begin.
fn frames_of(what: What, station: usize, extent: &Extent, every: u64) -> impl Iterator<Item = AtFrame> {
    // The frames to the robot stand for the time in which a drive can fail.
    let directions = if what.is_of_drives() { 1 } else { 2 };
    extent.frames.into_iter().enumerate().take(directions).flat_map(move |(direction, frames)| {
        let every = if what == What::HoldOld { every.saturating_mul(OLD_SHARE) } else { every };
        // Old frames are not all those from switching on.
        let first = if what == What::HoldOld { 1 + every.min(frames) / 2 } else { 1 };
        let numbers = (first..=frames).step_by(usize::try_from(every).unwrap_or(usize::MAX));
        numbers.map(move |frame| (station, direction, frame))
    })
}

/// Returns so many jobs with so many faults each, drawn evenly among types, stations, kinds, directions and frames.
pub(super) fn drawn(
    extents: &[Vec<Extent>],
    kinds: &[What],
    [count, faults]: [usize; 2],
    seed: u64,
) -> Vec<Job> {
    let mut random = Pcg64Mcg::seed_from_u64(seed.rotate_left(41) ^ 0x9A1);
    let mut draw = |limit: usize| below(&mut random, limit as u64) as usize;
    let mut job = || {
        let type_index = draw(extents.len());
        let stations = extents.get(type_index)?;
        let mut fault = || {
            let station = if stations.len() > 1 { draw(stations.len()) } else { 0 };
            let extent = stations.get(station)?;
            let kinds: Vec<_> = kinds.iter().copied().filter(|what| extent.has(*what)).collect();
            let what = *kinds.get(draw(kinds.len()))?;
            let direction = draw(2);
            let frame = 1 + draw(*extent.frames.get(direction)? as usize) as u64;
            Some(Injected::new(what, (station, direction, frame), seed, extent))
        };
        let mut faults = (0..faults).map(|_| fault()).collect::<Option<Vec<_>>>()?;
        faults.sort_by_key(|fault| fault.what);
        Some(Job { type_index, faults })
    };
    (0..count).map_while(|_| job()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::explore::fault::{FaultTexts, Lengths, OLD_MS};

    const LENGTHS: Lengths = Lengths { hold: 3, cut: 10, restart: 100 };

    const fn extent(frames: [u64; 2]) -> Extent {
        Extent { frames, run_us: 3_000_000, axes: 4, has_drives: true }
    }

    /// Returns the extents of types of one robot.
    fn alone<const N: usize>(frames: [[u64; 2]; N]) -> Vec<Vec<Extent>> {
        frames.into_iter().map(|frames| vec![extent(frames)]).collect()
    }

    #[test]
    fn single_faults_meet_every_frame_of_both_directions_once() {
        let texts = FaultTexts { lengths: LENGTHS, stations: Vec::new() };
        let jobs = singles(&alone([[3, 2], [1, 1]]), &[What::Lose, What::Cut], 1, 1);
        let mut texts: Vec<_> = jobs.iter().map(|job| (job.type_index, texts.of(&job.faults[0]))).collect();
        assert_eq!(texts.len(), 2 * (5 + 2));
        texts.sort();
        texts.dedup();
        assert_eq!(texts.len(), 14);
        assert_eq!(singles(&alone([[3, 2]]), &[What::Lose], 2, 1).len(), 3);
    }

    #[test]
    fn old_frames_are_held_for_all_three_times_at_one_frame_of_eight() {
        let jobs = singles(&alone([[800, 0]]), &[What::HoldOld], 1, 1);
        assert_eq!(jobs.len(), 100);
        let held: Vec<_> = jobs.iter().map(|job| job.faults[0].lasts_ms()).collect();
        for range in OLD_MS {
            assert!(held.iter().filter(|ms| range.contains(ms)).count() > 10, "{held:?}");
        }
        assert!(held.iter().all(|ms| OLD_MS.iter().any(|range| range.contains(ms))), "{held:?}");
    }

    #[test]
    fn the_same_seed_draws_the_same_pairs_and_their_frames_are_those_of_the_run() {
        let (frames, extents) = ([[9, 4], [1, 30]], alone([[9, 4], [1, 30]]));
        let jobs = drawn(&extents, &What::ALL, [300, 2], 7);
        assert_eq!(jobs, drawn(&extents, &What::ALL, [300, 2], 7));
        assert_ne!(jobs, drawn(&extents, &What::ALL, [300, 2], 8));
        assert_eq!(jobs.len(), 300);
        for Job { type_index, faults } in &jobs {
            assert_eq!(faults.len(), 2);
            assert!(
                faults.iter().all(|fault| (1..=frames[*type_index][fault.direction]).contains(&fault.frame))
            );
        }
        assert!(What::ALL.iter().all(|what| jobs.iter().any(|job| job.faults[1].what == *what)));
    }

    #[test]
    fn faults_of_a_cell_meet_every_station_and_drives_only_where_there_are_some() {
        let without = |frames| Extent { has_drives: false, ..extent(frames) };
        let cell = [vec![extent([30, 20]), without([7, 5])]];
        let kinds = [What::Lose, What::DriveStop];
        let jobs = singles(&cell, &kinds, 1, 1);
        let count = |jobs: &[Job], station: usize, what: What| {
            let of = |job: &&Job| job.faults.iter().any(|it| (it.station, it.what) == (station, what));
            jobs.iter().filter(of).count()
        };
        let counts = [(0, What::Lose), (0, What::DriveStop), (1, What::Lose), (1, What::DriveStop)];
        assert_eq!(counts.map(|(station, what)| count(&jobs, station, what)), [50, 30, 12, 0]);
        let jobs = drawn(&cell, &kinds, [400, 1], 5);
        let [left, stops, right, none] = counts.map(|(station, what)| count(&jobs, station, what));
        assert!(left > 60 && stops > 60 && right > 150 && none == 0, "{left} {stops} {right} {none}");
    }

    #[test]
    fn blocks_of_20_to_500_ms_meet_every_axis_and_every_part_of_the_run() {
        let jobs = drawn(&alone([[2_000, 1_000]]), &[What::DriveBlock], [400, 1], 3);
        let drives: Vec<_> = jobs.iter().map(|job| job.faults[0].drive).collect();
        for axis in 1..=4 {
            let of_axis = drives.iter().filter(|drive| drive.axis == axis);
            assert!((60..=140).contains(&of_axis.count()), "axis {axis}");
        }
        for tenth in 0..10 {
            let of_tenth = drives.iter().filter(|drive| drive.at_us * 10 / 3_000_001 == tenth);
            assert!((20..=65).contains(&of_tenth.count()), "tenth {tenth}");
        }
        let lengths = || drives.iter().map(|drive| drive.length_ms);
        assert!(lengths().all(|length_ms| (20..=500).contains(&length_ms)));
        assert!(lengths().min() < Some(40) && lengths().max() > Some(480));
    }
}
