//! Random single motions along a path, by where they lead: away from all singular positions, past the axis of the
//! shoulder, near a straight wrist, or as a turn at one place.

#![expect(clippy::disallowed_methods, reason = "last bits of a random motion decide nothing")]

use protocol::image::{Motion, MotionKind};
use rand_core::Rng as _;
use rand_pcg::Pcg64Mcg;
use robot_node::RobotConfig;
use robot_node::arm::{AXES, Frame, Joints, Rotation, distance};
use robot_node::motion::Segment;
use setup::{Kinematics, Setup};

/// Kinds of motions that are drawn.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Passage {
    /// Lines away from singular positions.
    Line,
    /// Circles away from singular positions.
    Circle,
    /// Turns at one place, away from singular positions.
    Turn,
    /// Lines that pass 5 to 90 mm beside the place where the wrist is on the shoulder's axis.
    Shoulder,
    /// Lines on which the wrist is bent by 0.5 to 30° at least.
    Wrist,
    /// Turns at one place on which it is so.
    WristTurn,
}

impl Passage {
    pub(crate) const ALL: [(&'static str, Self); 6] = [
        ("LIN", Self::Line),
        ("CIRC", Self::Circle),
        ("turn at one place", Self::Turn),
        ("LIN past the shoulder", Self::Shoulder),
        ("LIN near the wrist", Self::Wrist),
        ("turn near the wrist", Self::WristTurn),
    ];

    /// Returns whether the arm passes a singular position on it. A SCARA has none that it passes.
    pub(crate) const fn is_singular(self) -> bool {
        matches!(self, Self::Shoulder | Self::Wrist | Self::WristTurn)
    }

    const fn only_turns(self) -> bool {
        matches!(self, Self::Turn | Self::WristTurn)
    }

    /// Returns whether an arm that comes so near to its singular positions is of this kind.
    fn is(self, nearness: &Nearness) -> bool {
        let Nearness { shoulder_mm, wrist_deg, elbow_deg } = *nearness;
        let beside_shoulder = (5.0..90.0).contains(&shoulder_mm);
        let beside_wrist = (0.5..30.0).contains(&wrist_deg);
        elbow_deg > 20.0
            && match self {
                Self::Line | Self::Circle | Self::Turn => shoulder_mm > 90.0 && wrist_deg > 30.0,
                Self::Shoulder => beside_shoulder && wrist_deg > 30.0,
                Self::Wrist | Self::WristTurn => beside_wrist && shoulder_mm > 90.0,
            }
    }
}

/// Distances of an arm from its singular positions. One that it does not have is far.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Nearness {
    /// From the wrist to the cylinder about axis 1 on which it may not be, in mm.
    shoulder_mm: f64,
    /// Angle between axes 4 and 6 (UR: between axis 6 and the parallel ones).
    wrist_deg: f64,
    /// Angle by which the elbow is bent.
    elbow_deg: f64,
}

impl Nearness {
    const FAR: Self = Self { shoulder_mm: f64::INFINITY, wrist_deg: f64::INFINITY, elbow_deg: f64::INFINITY };

    /// At these joints of a setup's arm.
    pub(crate) fn at(joints: &Joints, config: &RobotConfig, setup: &Setup) -> Self {
        let off_straight = |degrees: f64| degrees.to_radians().sin().abs().asin().to_degrees();
        let beside = |before_flange: f64, radius: f64| {
            let flange = config.arm.forward(joints);
            let [x, y] = [0, 1].map(|i| flange.position[i] - before_flange * flange.rotation.z_axis()[i]);
            (x.hypot(y) - radius).abs()
        };
        match &setup.robot.kinematics {
            // Its range ends before its folded elbow: only the stretched one counts.
            Kinematics::Scara(_) => Self { elbow_deg: off_straight(joints[1]), ..Self::FAR },
            Kinematics::Opw(arm) => {
                let model = |axis: usize| {
                    joints[axis] * f64::from(arm.signs.value[axis]) - arm.offsets_deg.value[axis]
                };
                let lean = (arm.a2_mm.value / arm.c3_mm.value).atan().to_degrees();
                Self {
                    shoulder_mm: beside(arm.c4_mm.value, arm.b_mm.value.abs()),
                    wrist_deg: off_straight(model(4)),
                    elbow_deg: off_straight(model(2) + lean),
                }
            }
            Kinematics::ThreeParallel(arm) => Self {
                shoulder_mm: beside(arm.d6_mm.value, arm.d4_mm.value.abs()),
                wrist_deg: off_straight(joints[4] - arm.offsets_deg.value[4]),
                elbow_deg: off_straight(joints[2] - arm.offsets_deg.value[2]),
            },
        }
    }

    fn and(self, other: Self) -> Self {
        Self {
            shoulder_mm: self.shoulder_mm.min(other.shoulder_mm),
            wrist_deg: self.wrist_deg.min(other.wrist_deg),
            elbow_deg: self.elbow_deg.min(other.elbow_deg),
        }
    }
}

/// A list of random motions that is the same every time.
pub(crate) struct Drawn<'a> {
    random: Pcg64Mcg,
    config: &'a RobotConfig,
    setup: &'a Setup,
}

impl<'a> Drawn<'a> {
    pub(crate) fn new(seed: u64, config: &'a RobotConfig, setup: &'a Setup) -> Self {
        Self { random: Pcg64Mcg::new(u128::from(seed) << 1 | 1), config, setup }
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.random.next_u64() as f64 / u64::MAX as f64)
    }

    /// Between two figures, a small one as often as a large one.
    fn scale(&mut self, low: f64, high: f64) -> f64 {
        low * (high / low).powf(self.between(0.0, 1.0))
    }

    fn direction(&mut self) -> [f64; 3] {
        loop {
            let direction: [f64; 3] = core::array::from_fn(|_| self.between(-1.0, 1.0));
            let length = distance(direction, [0.0; 3]);
            if (0.1..1.0).contains(&length) {
                return direction.map(|part| part / length);
            }
        }
    }

    /// Joints that fit a kind, well within their ranges.
    fn middle(&mut self, kind: Passage) -> Joints {
        let limits = self.config.arm.limits();
        let ends: [[f64; 2]; AXES] = core::array::from_fn(|axis| {
            let [lower, upper] = [limits.lower[axis].max(-180.0), limits.upper[axis].min(180.0)];
            [0.1, 0.9].map(|share| lower + share * (upper - lower))
        });
        loop {
            let joints = core::array::from_fn(|axis| match axis < self.config.arm.axes() {
                true => self.between(ends[axis][0], ends[axis][1]),
                false => 0.0,
            });
            if kind.is(&Nearness::at(&joints, self.config, self.setup)) {
                return joints;
            }
        }
    }

    /// A motion of this kind and the joints that it starts from; none where the drawn one is of another kind, or refused.
    pub(crate) fn motion(&mut self, kind: Passage) -> Option<(Motion, Joints)> {
        let middle = self.middle(kind);
        let pose = self.config.arm.forward(&middle);
        let is_upright = self.config.arm.axes() == 4;
        let (way, turn) = match kind.only_turns() {
            true => (0.0, self.scale(20.0, 150.0)),
            false => (
                self.scale(20.0, 500.0),
                if self.between(0.0, 1.0) < 0.3 { 0.0 } else { self.scale(5.0, 90.0) },
            ),
        };
        let (direction, bulge) = (self.direction(), self.direction());
        let axis = if is_upright { [0.0, 0.0, 1.0] } else { self.direction() };
        let at = |share: f64| Frame {
            position: core::array::from_fn(|i| pose.position[i] + share * way * direction[i]),
            rotation: Rotation::about(axis, share * turn) * pose.rotation,
        };
        let [from, to] = [at(-0.5), at(0.5)].map(Frame::to_mm_deg);
        let [velocity, acceleration] = [self.scale(0.15, 1.0), self.scale(0.15, 1.0)];
        let path = [10.0 * self.config.path_velocity_mm_s, self.config.path_acceleration_mm_s2];
        let motion = Motion {
            kind: if kind == Passage::Circle { MotionKind::Circular } else { MotionKind::LinCartesian },
            target: to.map(|coordinate| coordinate as f32),
            auxiliary: core::array::from_fn(|i| match kind {
                Passage::Circle => (pose.position[i] + 0.3 * way * bulge[i]) as f32,
                _ => 0.0,
            }),
            velocity: (velocity * path[0]) as u16,
            acceleration: (acceleration * path[1]) as u16,
            ..Motion::EMPTY
        };
        let to_start = Motion {
            kind: MotionKind::LinCartesian,
            target: from.map(|coordinate| coordinate as f32),
            auxiliary: [0.0; 3],
            ..motion
        };
        let start = Segment::prepare(&to_start, &middle, self.config).ok()?.end;
        Segment::prepare(&motion, &start, self.config).ok()?;
        Some((motion, start))
    }

    /// Returns whether joints along a path make it one of a kind.
    pub(crate) fn is_of(&self, kind: Passage, joints: impl Iterator<Item = Joints>) -> bool {
        let nearest = joints.fold(Nearness::FAR, |nearest, joints| {
            nearest.and(Nearness::at(&joints, self.config, self.setup))
        });
        kind.is(&nearest)
    }
}
