//! One motion of the image.
//!
//! ```text
//! 0..24  target          6 × f32   mm and degrees (x y z a b c), or joint values (degrees, mm on a linear axis)
//! 24..36 auxiliary       3 × f32   mm: CIRC's intermediate point; N: the force vector of LIN force; of other kinds:
//!   24   status          u8        bit 7: a configuration is given; bit 6: without a turn; bits 0 to 2: see Configuration
//!   25   turn            u8        bit i: axis i + 1 is below 0°
//!   26..28 deceleration  u16     as the acceleration; 0 is the same as the acceleration
//!   28..30 jerk        u16       10 mm/s³, or 0.01 % of the rated axis jerks for PTP; 0 is the robot's own
//!   30..36 reserved
//! 36..38 velocity        u16       0.1 mm/s, or 0.01 % of the rated axis speeds for PTP
//! 38..40 acceleration    u16       1 mm/s², or 0.01 % of the rated axis accelerations for PTP
//! 40..42 approximation   u16       0.01 mm; 0 is an exact stop
//! 42     kind            u8        MotionKind; 0 is an empty slot
//! 43     tool and base   u8        tool in the high four bits, base in the low four
//! ```

use super::{Configuration, MOTION_LEN, MotionKind};
use machine::wire::{ByteOrder, Reader, Truncated, Writer};

/// Length of the auxiliary bytes that no field uses, where there is neither a point nor a force.
const RESERVED: usize = 6;

/// One motion, in the units of the image.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Motion {
    /// Kind of motion.
    pub kind: MotionKind,
    /// Target: x, y, z in mm and the angles a, b, c (about z, y', x'') in degrees, in the base frame; or for
    /// [`MotionKind::PtpJoint`] the joints in degrees, a linear axis in mm.
    pub target: [f32; 6],
    /// The intermediate point of a circle in mm, or the force in N; otherwise zero. Only kinds that
    /// [have one](MotionKind::has_auxiliary) carry it.
    pub auxiliary: [f32; 3],
    /// Configuration in which the arm reaches a Cartesian target; `None` is the one nearest to the arm's present joints.
    /// Only kinds without an auxiliary point or force carry it.
    pub configuration: Option<Configuration>,
    /// Path velocity in 0.1 mm/s; for PTP 0.01 % of the rated axis speeds.
    pub velocity: u16,
    /// Path acceleration in 1 mm/s²; for PTP 0.01 % of the rated axis accelerations.
    pub acceleration: u16,
    /// Path deceleration in 1 mm/s²; for PTP 0.01 % of the rated axis accelerations; 0 is the same as the acceleration.
    /// Only kinds without an auxiliary point or force carry it.
    pub deceleration: u16,
    /// Path jerk in 10 mm/s³; for PTP 0.01 % of the rated axis jerks. 0 is the robot's own: the setup's path jerk, for PTP
    /// the share of the acceleration. Only kinds without an auxiliary point or force carry it.
    pub jerk: u16,
    /// Approximation distance in 0.01 mm: how far from the target the path may leave it to blend into the next
    /// motion; 0 is an exact stop.
    pub approximation: u16,
    /// Number of the tool frame, 0..=15.
    pub tool: u8,
    /// Number of the base frame, 0..=15.
    pub base: u8,
}

impl Motion {
    /// Content of an unused slot: all zero.
    pub const EMPTY: Self = Self {
        kind: MotionKind::None,
        target: [0.0; 6],
        auxiliary: [0.0; 3],
        configuration: None,
        velocity: 0,
        acceleration: 0,
        deceleration: 0,
        jerk: 0,
        approximation: 0,
        tool: 0,
        base: 0,
    };

    /// Parses the 44 bytes.
    pub fn parse<O: ByteOrder>(reader: &mut Reader<'_, O>) -> Result<Self, Truncated> {
        let slot = reader.array::<MOTION_LEN>()?;
        // The kind stands behind the fields whose meaning depends on it.
        let [.., kind, frames] = slot;
        let mut motion = Self { kind: kind.into(), tool: frames >> 4, base: frames & 0x0F, ..Self::EMPTY };
        let mut fields = Reader::<O>::new(&slot);
        for coordinate in &mut motion.target {
            *coordinate = fields.f32()?;
        }
        if motion.kind.has_auxiliary() {
            for coordinate in &mut motion.auxiliary {
                *coordinate = fields.f32()?;
            }
        } else {
            motion.configuration = Configuration::from_bytes(fields.array()?);
            motion.deceleration = fields.u16()?;
            motion.jerk = fields.u16()?;
            fields.skip(RESERVED)?;
        }
        motion.velocity = fields.u16()?;
        motion.acceleration = fields.u16()?;
        motion.approximation = fields.u16()?;
        Ok(motion)
    }

    /// Writes the 44 bytes.
    pub fn emit<O: ByteOrder>(&self, writer: &mut Writer<'_, O>) {
        for coordinate in &self.target {
            writer.f32(*coordinate);
        }
        if self.kind.has_auxiliary() {
            self.auxiliary.iter().for_each(|coordinate| writer.f32(*coordinate));
        } else {
            writer.bytes(&Configuration::to_bytes(self.configuration));
            writer.u16(self.deceleration);
            writer.u16(self.jerk);
            writer.zeros(RESERVED);
        }
        writer.u16(self.velocity);
        writer.u16(self.acceleration);
        writer.u16(self.approximation);
        writer.u8(self.kind.into());
        writer.u8(self.tool << 4 | self.base & 0x0F);
    }

    /// Returns the length in bytes in the image.
    #[must_use]
    pub const fn buffer_len(&self) -> usize {
        MOTION_LEN
    }

    /// Returns the path velocity in mm/s. Meaningful for Cartesian kinds.
    #[must_use]
    pub fn velocity_mm_s(&self) -> f64 {
        f64::from(self.velocity) / 10.0
    }

    /// Returns the share of the rated axis speeds, 1.0 for 100 %. Meaningful for PTP.
    #[must_use]
    pub fn velocity_share(&self) -> f64 {
        f64::from(self.velocity) / 10_000.0
    }

    /// Returns the path acceleration in mm/s². Meaningful for Cartesian kinds.
    #[must_use]
    pub fn acceleration_mm_s2(&self) -> f64 {
        f64::from(self.acceleration)
    }

    /// Returns the share of the rated axis accelerations, 1.0 for 100 %. Meaningful for PTP.
    #[must_use]
    pub fn acceleration_share(&self) -> f64 {
        f64::from(self.acceleration) / 10_000.0
    }

    /// Returns the path deceleration in mm/s²; none if it is that of the acceleration. Meaningful for Cartesian kinds.
    #[must_use]
    pub fn deceleration_mm_s2(&self) -> Option<f64> {
        (self.deceleration > 0).then(|| f64::from(self.deceleration))
    }

    /// Returns the deceleration's share of the rated axis accelerations; none if it is that of the acceleration.
    /// Meaningful for PTP.
    #[must_use]
    pub fn deceleration_share(&self) -> Option<f64> {
        (self.deceleration > 0).then(|| f64::from(self.deceleration) / 10_000.0)
    }

    /// Returns the path jerk in mm/s³; none if it is the robot's own. Meaningful for Cartesian kinds.
    #[must_use]
    pub fn jerk_mm_s3(&self) -> Option<f64> {
        (self.jerk > 0).then(|| f64::from(self.jerk) * 10.0)
    }

    /// Returns the share of the rated axis jerks; none if it is the robot's own. Meaningful for PTP.
    #[must_use]
    pub fn jerk_share(&self) -> Option<f64> {
        (self.jerk > 0).then(|| f64::from(self.jerk) / 10_000.0)
    }

    /// Returns the approximation distance in mm; 0 is an exact stop.
    #[must_use]
    pub fn approximation_mm(&self) -> f64 {
        f64::from(self.approximation) / 100.0
    }
}
