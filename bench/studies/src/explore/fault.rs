//! The faults of an exploration, each of one frame or one instant of a drive.

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
pub(super) const OLD_MS: [Range<u64>; 3] = [2_000..2_101, 32_000..33_001, 64_000..65_001];

/// The longest of them.
pub(super) const LONGEST_HOLD_MS: u64 = 65_000;

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

    /// Returns whether it needs drives of the robot controller.
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

/// Options of faults and names of stations, for the texts of faults.
#[derive(Clone, Debug)]
pub(super) struct FaultTexts {
    pub(super) lengths: Lengths,
    /// None of a robot that works alone.
    pub(super) stations: Vec<String>,
}

impl FaultTexts {
    /// Returns a fault as `--fault` takes it.
    pub(super) fn of(&self, fault: &Injected) -> String {
        let text = fault.text(self.lengths);
        self.stations.get(fault.station).map_or_else(|| text.clone(), |station| format!("{station}/{text}"))
    }

    /// Returns a fault as the cable takes it.
    pub(super) fn fault(&self, fault: &Injected) -> anyhow::Result<Fault> {
        Ok(self.of(fault).parse()?)
    }

    /// Returns the text after the name of a station and this mark, where there are several.
    pub(super) fn at(&self, station: usize, mark: &str, text: &str) -> String {
        self.stations.get(station).map_or_else(|| text.to_owned(), |name| format!("{name}{mark}{text}"))
    }
}

/// One fault.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Injected {
    pub(super) what: What,
    /// Number of its station, counted from 0.
    pub(super) station: usize,
    /// 0 is to the robot, 1 to the PLC.
    pub(super) direction: usize,
    /// Number of the frame in its direction, counted from 1.
    pub(super) frame: u64,
    /// Which bit of it flips.
    bit: u64,
    /// Draws how long an old frame is held.
    draw: u64,
    /// What a fault of a drive needs.
    pub(super) drive: OfDrive,
}

/// Axis, instant and length of a fault of a drive.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct OfDrive {
    /// Counted from 1.
    pub(super) axis: u64,
    /// Time from when the robot is ready, in µs.
    pub(super) at_us: u64,
    /// Time for which a shaft is held, in ms.
    pub(super) length_ms: u64,
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
    /// True if drives move them.
    pub(super) has_drives: bool,
}

impl Extent {
    pub(super) const fn has(&self, what: What) -> bool {
        self.has_drives || !what.is_of_drives()
    }
}

/// Frame of a fault: its station, its direction and its number.
pub(super) type AtFrame = (usize, usize, u64);

impl Injected {
    /// Creates a fault; `seed` determines which bit flips, and of drives axis and length. A fault of a drive is as far in the
    /// run as the frame.
    pub(super) fn new(what: What, (station, direction, frame): AtFrame, seed: u64, extent: &Extent) -> Self {
        let place = (station as u64) << 48 ^ frame << 1 ^ direction as u64;
        let mut random = Pcg64Mcg::seed_from_u64(seed.rotate_left(23) ^ place);
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
        Self { what, station, direction, frame, bit, draw, drive }
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

    /// Returns the fault as `--fault` takes it, without its station.
    fn text(&self, lengths: Lengths) -> String {
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
}

pub(super) fn below(random: &mut Pcg64Mcg, bound: u64) -> u64 {
    ((u128::from(random.next_u64()) * u128::from(bound)) >> 64) as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    const LENGTHS: Lengths = Lengths { hold: 3, cut: 10, restart: 100 };

    fn texts(stations: &[&str]) -> FaultTexts {
        FaultTexts { lengths: LENGTHS, stations: stations.iter().map(|name| (*name).to_owned()).collect() }
    }

    #[test]
    fn every_fault_has_a_text_that_the_option_takes_and_a_name_that_is_read_back() {
        for what in What::ALL {
            let fault = Injected::new(
                what,
                (1, 1, 17),
                1,
                &Extent { frames: [99, 99], run_us: 3_000_000, axes: 4, has_drives: true },
            );
            for (stations, begin) in [(&[] as &[&str], "to-plc:"), (&["left", "right"], "right/to-plc:")] {
                let (texts, begins) = (texts(stations), begin.trim_end_matches("to-plc:"));
                assert_eq!(texts.fault(&fault).unwrap().to_string(), texts.of(&fault));
                let begin = if what.is_of_drives() { begins } else { begin };
                assert!(texts.of(&fault).starts_with(begin), "{}", texts.of(&fault));
            }
            assert_eq!(what.to_string().parse(), Ok(what));
        }
        assert!("loose".parse::<What>().unwrap_err().contains("lose, double, hold"));
    }
}
