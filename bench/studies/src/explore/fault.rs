//! The faults of an exploration: one at each frame, or pairs drawn by a seed.

use std::fmt;
use std::ops::Range;
use std::str::FromStr;

use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

use records::faults::Fault;

/// Bits of the longest frame. The bit to flip is drawn below this number; behind a frame's end it is counted from the start
/// again.
const BITS: u64 = 12_000;

/// Times in ms for which an old frame is held. PROFINET takes one of 1.92 to 2.05 s for new; 32.8 s is half the range of a life
/// counter that counts every millisecond, and 65.5 s the whole.
const OLD_MS: [Range<u64>; 3] = [2_000..2_101, 32_000..33_001, 64_000..65_001];

/// The longest of them.
pub(super) const LONGEST_HOLD_MS: u64 = 65_000;

/// One frame of so many is held as an old one: each such run takes up to a minute of the cell's time.
const OLD_SHARE: u64 = 8;

/// Shortest and longest time for which a shaft is held, in ms.
const BLOCK_MS: [u64; 2] = [20, 500];

/// Kind of a fault that begins with one frame, or at its time.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub enum What {
    /// The frame is lost.
    Lose,
    /// It arrives twice.
    Double,
    /// It is held back, so that later ones overtake it.
    Hold,
    /// It is held back for seconds, so that it arrives in a later run.
    HoldOld,
    /// A bit of it flips behind the checksums of Ethernet and UDP.
    FlipInMemory,
    /// A bit of it flips on the wire.
    FlipOnWire,
    /// The cable is cut for a time.
    Cut,
    /// The robot node ends, and is started again.
    RestartRobot,
    /// The PLC node ends, and is started again.
    RestartPlc,
    /// Something holds an axis for 20 to 500 ms.
    DriveBlock,
    /// A drive has a fault.
    DriveFault,
    /// A drive stops without a command.
    DriveStop,
}

impl What {
    pub(super) const ALL: [Self; 12] = [
        Self::Lose,
        Self::Double,
        Self::Hold,
        Self::HoldOld,
        Self::FlipInMemory,
        Self::FlipOnWire,
        Self::Cut,
        Self::RestartRobot,
        Self::RestartPlc,
        Self::DriveBlock,
        Self::DriveFault,
        Self::DriveStop,
    ];

    /// Returns whether it needs drives behind the robot controller.
    pub(super) const fn is_of_drives(self) -> bool {
        matches!(self, Self::DriveBlock | Self::DriveFault | Self::DriveStop)
    }

    /// Returns its name in options.
    const fn name(self) -> &'static str {
        match self {
            Self::Lose => "lose",
            Self::Double => "double",
            Self::Hold => "hold",
            Self::HoldOld => "hold-old",
            Self::FlipInMemory => "flip-memory",
            Self::FlipOnWire => "flip-wire",
            Self::Cut => "cut",
            Self::RestartRobot => "restart-robot",
            Self::RestartPlc => "restart-plc",
            Self::DriveBlock => "drive-block",
            Self::DriveFault => "drive-fault",
            Self::DriveStop => "drive-stop",
        }
    }

    /// Returns what it is called in tables.
    pub(super) const fn label(self) -> &'static str {
        match self {
            Self::Lose => "lost",
            Self::Double => "twice",
            Self::Hold => "held back",
            Self::HoldOld => "held for seconds",
            Self::FlipInMemory => "bit in memory",
            Self::FlipOnWire => "bit on the wire",
            Self::Cut => "cable cut",
            Self::RestartRobot => "robot restarts",
            Self::RestartPlc => "PLC restarts",
            Self::DriveBlock => "axis is held",
            Self::DriveFault => "drive fault",
            Self::DriveStop => "drive stops",
        }
    }
}

impl fmt::Display for What {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for What {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        let known = Self::ALL.into_iter().find(|known| known.name() == name);
        known.ok_or_else(|| {
            let names = Self::ALL.map(Self::name).join(", ");
            format!("there is no kind of fault `{name}`: {names}")
        })
    }
}

/// How long the faults last that have a duration, in ms.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lengths {
    pub(super) hold: u32,
    pub(super) cut: u32,
    pub(super) restart: u32,
}

/// One fault.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Injected {
    pub(super) what: What,
    /// 0 is to the robot, 1 to the PLC.
    pub(super) direction: usize,
    /// Number of the frame in its direction, counted from 1.
    pub(super) frame: u64,
    /// Which bit of it flips.
    bit: u64,
    /// Draws how long an old frame is held.
    draw: u64,
    /// What a fault of a drive needs.
    drive: OfDrive,
}

/// Axis, instant and length of a fault of a drive.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
struct OfDrive {
    /// Counted from 1.
    axis: u64,
    /// Time from when the robot is ready, in µs.
    at_us: u64,
    /// Time for which a shaft is held, in ms.
    length_ms: u64,
}

/// The run without a fault, as far as faults are drawn from it.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Extent {
    /// Frames to the robot and to the PLC.
    pub(super) frames: [u64; 2],
    /// Time from when the robot was ready to the end, in µs.
    pub(super) run_us: u64,
    /// Axes of the arm.
    pub(super) axes: u64,
}

impl Injected {
    /// Creates a fault; `seed` determines which bit flips, and of drives axis and length. A fault of a drive is as far in the
    /// run as the frame.
    pub(super) fn new(what: What, direction: usize, frame: u64, seed: u64, extent: &Extent) -> Self {
        let mut random = Pcg64Mcg::seed_from_u64(seed.rotate_left(23) ^ frame << 1 ^ direction as u64);
        let bit = below(&mut random, BITS);
        let draw = random.next_u64();
        let frames = extent.frames.get(direction).copied().unwrap_or(1).max(1);
        let at_us = u128::from(extent.run_us) * u128::from(frame) / u128::from(frames);
        let [shortest, longest] = BLOCK_MS;
        let drive = OfDrive {
            axis: 1 + below(&mut random, extent.axes),
            at_us: u64::try_from(at_us).unwrap_or(u64::MAX),
            length_ms: shortest + below(&mut random, longest - shortest + 1),
        };
        Self { what, direction, frame, bit, draw, drive }
    }

    /// Returns for how long an old frame is held, in ms.
    fn old_ms(&self) -> u64 {
        let mut random = Pcg64Mcg::seed_from_u64(self.draw);
        let range = OLD_MS.get(below(&mut random, OLD_MS.len() as u64) as usize);
        range.map_or(0, |range| range.start + below(&mut random, range.end - range.start))
    }

    /// Returns for how long after the run with its frame the fault still acts, in ms.
    pub(super) fn lasts_ms(&self) -> u64 {
        if self.what == What::HoldOld { self.old_ms() } else { 0 }
    }

    /// Returns the fault as `--fault` takes it.
    pub(super) fn text(&self, lengths: Lengths) -> String {
        let Self { what, direction, frame, bit, drive: OfDrive { axis, at_us, length_ms }, .. } = *self;
        let to = if direction == 0 { "to-robot" } else { "to-plc" };
        let Lengths { hold, cut, restart } = lengths;
        match what {
            What::Lose => format!("{to}:lose-frame={frame}"),
            What::Double => format!("{to}:double-frame={frame}"),
            What::Hold => format!("{to}:hold-frame={frame}@{hold}ms"),
            What::HoldOld => format!("{to}:hold-frame={frame}@{}ms", self.old_ms()),
            What::FlipInMemory => format!("{to}:flip-frame={frame}.{bit}@memory"),
            What::FlipOnWire => format!("{to}:flip-frame={frame}@wire"),
            What::Cut => format!("{to}:cut-frame={frame}@{cut}ms"),
            What::RestartRobot => format!("{to}:restart-robot={frame}@{restart}ms"),
            What::RestartPlc => format!("{to}:restart-plc={frame}@{restart}ms"),
            What::DriveBlock => {
                format!("drive-block={axis}@{at_us}us..{}us", at_us + 1_000 * length_ms)
            }
            What::DriveFault => format!("drive-fault={axis}@{at_us}us"),
            What::DriveStop => format!("drive-stop={axis}@{at_us}us"),
        }
    }

    /// Returns the fault as the cable takes it.
    pub(super) fn fault(&self, lengths: Lengths) -> anyhow::Result<Fault> {
        Ok(self.text(lengths).parse()?)
    }
}

/// One run to be made.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) struct Job {
    /// Number of the execution type among those of the exploration.
    pub(super) type_index: usize,
    /// Its faults, in the order of their kinds.
    pub(super) faults: Vec<Injected>,
}

/// Returns a job for each kind of fault at every n-th frame. `extents` are those of each type without a fault.
pub(super) fn singles(extents: &[Extent], kinds: &[What], every: u64, seed: u64) -> Vec<Job> {
    let mut jobs = Vec::new();
    for (type_index, extent) in extents.iter().enumerate() {
        for what in kinds {
            // The frames to the robot stand for the time in which a drive can fail.
            let directions = if what.is_of_drives() { 1 } else { 2 };
            for (direction, frames) in extent.frames.iter().enumerate().take(directions) {
                let every = if *what == What::HoldOld { every.saturating_mul(OLD_SHARE) } else { every };
                // Old frames are not all those from switching on.
                let first = if *what == What::HoldOld { 1 + every.min(*frames) / 2 } else { 1 };
                let numbers = (first..=*frames).step_by(usize::try_from(every).unwrap_or(usize::MAX));
                jobs.extend(numbers.map(|frame| Job {
                    type_index,
                    faults: vec![Injected::new(*what, direction, frame, seed, extent)],
                }));
            }
        }
    }
    jobs
}

/// Returns so many jobs with so many faults each, drawn evenly among types, kinds, directions and frames.
pub(super) fn drawn(extents: &[Extent], kinds: &[What], [count, faults]: [usize; 2], seed: u64) -> Vec<Job> {
    let mut random = Pcg64Mcg::seed_from_u64(seed.rotate_left(41) ^ 0x9A1);
    let mut draw = |limit: usize| below(&mut random, limit as u64) as usize;
    let mut job = || {
        let type_index = draw(extents.len());
        let extent = extents.get(type_index)?;
        let mut fault = || {
            let what = *kinds.get(draw(kinds.len()))?;
            let direction = draw(2);
            let frame = 1 + draw(*extent.frames.get(direction)? as usize) as u64;
            Some(Injected::new(what, direction, frame, seed, extent))
        };
        let mut faults = (0..faults).map(|_| fault()).collect::<Option<Vec<_>>>()?;
        faults.sort_by_key(|fault| fault.what);
        Some(Job { type_index, faults })
    };
    (0..count).map_while(|_| job()).collect()
}

fn below(random: &mut Pcg64Mcg, bound: u64) -> u64 {
    ((u128::from(random.next_u64()) * u128::from(bound)) >> 64) as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    const LENGTHS: Lengths = Lengths { hold: 3, cut: 10, restart: 100 };

    const fn extent(frames: [u64; 2]) -> Extent {
        Extent { frames, run_us: 3_000_000, axes: 4 }
    }

    #[test]
    fn every_fault_has_a_text_that_the_option_takes_and_a_name_that_is_read_back() {
        for what in What::ALL {
            let fault = Injected::new(what, 1, 17, 1, &extent([99, 99]));
            assert_eq!(fault.fault(LENGTHS).unwrap().to_string(), fault.text(LENGTHS));
            assert_eq!(what.to_string().parse(), Ok(what));
        }
        assert!("loose".parse::<What>().unwrap_err().contains("lose, double, hold"));
    }

    #[test]
    fn single_faults_meet_every_frame_of_both_directions_once() {
        let jobs = singles(&[[3, 2], [1, 1]].map(extent), &[What::Lose, What::Cut], 1, 1);
        let mut texts: Vec<_> =
            jobs.iter().map(|job| (job.type_index, job.faults[0].text(LENGTHS))).collect();
        assert_eq!(texts.len(), 2 * (5 + 2));
        texts.sort();
        texts.dedup();
        assert_eq!(texts.len(), 14);
        assert_eq!(singles(&[extent([3, 2])], &[What::Lose], 2, 1).len(), 3);
    }

    #[test]
    fn old_frames_are_held_for_all_three_times_at_one_frame_of_eight() {
        let jobs = singles(&[extent([800, 0])], &[What::HoldOld], 1, 1);
        assert_eq!(jobs.len(), 100);
        let held: Vec<_> = jobs.iter().map(|job| job.faults[0].lasts_ms()).collect();
        for range in OLD_MS {
            assert!(held.iter().filter(|ms| range.contains(ms)).count() > 10, "{held:?}");
        }
        assert!(held.iter().all(|ms| OLD_MS.iter().any(|range| range.contains(ms))), "{held:?}");
    }

    #[test]
    fn the_same_seed_draws_the_same_pairs_and_their_frames_are_those_of_the_run() {
        let (frames, extents) = ([[9, 4], [1, 30]], [[9, 4], [1, 30]].map(extent));
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
    fn blocks_of_20_to_500_ms_meet_every_axis_and_every_part_of_the_run() {
        let jobs = drawn(&[extent([2_000, 1_000])], &[What::DriveBlock], [400, 1], 3);
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
