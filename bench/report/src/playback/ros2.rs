//! The ROS 2 messages of a run, and their encoding.
//!
//! CDR, little-endian (OMG DDSI-RTPS 2.5, section 10.2; the classic encoding of section 7.4.1 of OMG DDS-XTypes):
//! four bytes that identify the encoding, then the fields in sequence, each aligned to its own size relative to the
//! end of these four bytes. Strings and sequences begin with a u32: the number of bytes with the terminating zero, or
//! the number of elements.

use std::time::Duration;

/// A message type: its name, and its definition followed by those of its parts.
#[derive(Clone, Copy)]
pub(super) struct Schema {
    pub(super) name: &'static str,
    pub(super) definition: &'static str,
}

/// Joins a definition and those of its parts, in the form of the schema encoding `ros2msg`.
macro_rules! definition {
    ($fields:literal $(, $part:literal: $of_part:literal)*) => {
        concat!($fields, $("================================================================================\n",
            "MSG: ", $part, "\n", $of_part,)*)
    };
}

pub(super) const JOINT_STATE: Schema = Schema {
    name: "sensor_msgs/msg/JointState",
    definition: definition!(
        "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n",
        "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id\n",
        "builtin_interfaces/Time": "int32 sec\nuint32 nanosec\n"
    ),
};

pub(super) const POSE_STAMPED: Schema = Schema {
    name: "geometry_msgs/msg/PoseStamped",
    definition: definition!(
        "std_msgs/Header header\ngeometry_msgs/Pose pose\n",
        "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id\n",
        "builtin_interfaces/Time": "int32 sec\nuint32 nanosec\n",
        "geometry_msgs/Pose": "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n",
        "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z\n",
        "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n"
    ),
};

pub(super) const PATH: Schema = Schema {
    name: "nav_msgs/msg/Path",
    definition: definition!(
        "std_msgs/Header header\ngeometry_msgs/PoseStamped[] poses\n",
        "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id\n",
        "builtin_interfaces/Time": "int32 sec\nuint32 nanosec\n",
        "geometry_msgs/PoseStamped": "std_msgs/Header header\ngeometry_msgs/Pose pose\n",
        "geometry_msgs/Pose": "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n",
        "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z\n",
        "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n"
    ),
};

pub(super) const POINT_CLOUD: Schema = Schema {
    name: "sensor_msgs/msg/PointCloud2",
    definition: definition!(
        "std_msgs/Header header\nuint32 height\nuint32 width\nsensor_msgs/PointField[] fields\nbool is_bigendian\n\
         uint32 point_step\nuint32 row_step\nuint8[] data\nbool is_dense\n",
        "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id\n",
        "builtin_interfaces/Time": "int32 sec\nuint32 nanosec\n",
        "sensor_msgs/PointField": "uint8 FLOAT32=7\nstring name\nuint32 offset\nuint8 datatype\nuint32 count\n"
    ),
};

pub(super) const FLOAT: Schema = Schema { name: "std_msgs/msg/Float64", definition: "float64 data\n" };

pub(super) const LOG: Schema = Schema {
    name: "rcl_interfaces/msg/Log",
    definition: definition!(
        "builtin_interfaces/Time stamp\nuint8 level\nstring name\nstring msg\nstring file\nstring function\nuint32 line\n",
        "builtin_interfaces/Time": "int32 sec\nuint32 nanosec\n"
    ),
};

/// Pose of the tool.
#[derive(Clone, Copy, Debug)]
pub(super) struct RosPose {
    /// x, y, z in m.
    pub(super) position_m: [f64; 3],
    /// The unit quaternion w, x, y, z.
    pub(super) orientation: [f64; 4],
}

/// State of a joint at an instant.
#[derive(Clone, Copy, Debug)]
pub(super) struct Joint {
    /// Position in rad or m.
    pub(super) position: f64,
    /// Speed in rad/s or m/s.
    pub(super) speed: f64,
}

/// An encoded message.
pub(super) struct Message(Vec<u8>);

/// The encapsulation header: CDR, little-endian, no options.
const CDR_LE: [u8; 4] = [0, 1, 0, 0];

impl Message {
    /// Encodes a [`JOINT_STATE`]. Efforts are unknown and left empty.
    pub(super) fn joint_state(at: Duration, frame: &str, names: &[String], joints: &[Joint]) -> Self {
        let mut message = Self::new();
        message.header(at, frame);
        message.u32(names.len() as u32);
        names.iter().for_each(|name| message.string(name));
        message.u32(joints.len() as u32);
        joints.iter().for_each(|joint| message.f64(joint.position));
        message.u32(joints.len() as u32);
        joints.iter().for_each(|joint| message.f64(joint.speed));
        message.u32(0);
        message
    }

    /// Encodes a [`POSE_STAMPED`].
    pub(super) fn pose(at: Duration, frame: &str, pose: &RosPose) -> Self {
        let mut message = Self::new();
        message.pose_stamped(at, frame, pose);
        message
    }

    /// Encodes a [`PATH`] of timed poses.
    pub(super) fn path(frame: &str, way: &[(Duration, RosPose)]) -> Self {
        let mut message = Self::new();
        message.header(Duration::ZERO, frame);
        message.u32(way.len() as u32);
        way.iter().for_each(|(at, pose)| message.pose_stamped(*at, frame, pose));
        message
    }

    /// Encodes a [`POINT_CLOUD`] of x, y and z in m and the speed there in m/s.
    pub(super) fn points(frame: &str, points: &[[f32; 4]]) -> Self {
        /// Value of `PointField::FLOAT32`.
        const FLOAT32: u8 = 7;
        const STEP: u32 = 16;
        let mut message = Self::new();
        message.header(Duration::ZERO, frame);
        let width = points.len() as u32;
        [1, width, 4].into_iter().for_each(|value| message.u32(value));
        for (name, offset) in ["x", "y", "z", "speed"].into_iter().zip([0, 4, 8, 12]) {
            message.string(name);
            message.u32(offset);
            message.u8(FLOAT32);
            message.u32(1);
        }
        message.u8(0);
        [STEP, STEP * width, STEP * width].into_iter().for_each(|value| message.u32(value));
        message.0.extend(points.iter().flatten().flat_map(|value| value.to_le_bytes()));
        message.u8(1);
        message
    }

    /// Encodes a [`FLOAT`].
    pub(super) fn float(value: f64) -> Self {
        let mut message = Self::new();
        message.f64(value);
        message
    }

    /// Encodes a [`LOG`]: a warning at time zero.
    pub(super) fn warning(text: &str) -> Self {
        const WARN: u8 = 30;
        let mut message = Self::new();
        [0, 0].into_iter().for_each(|value| message.u32(value));
        message.u8(WARN);
        ["skillbench", text, "", ""].into_iter().for_each(|text| message.string(text));
        message.u32(0);
        message
    }

    pub(super) fn as_bytes(&self) -> &[u8] {
        &self.0
    }

    fn new() -> Self {
        Self(CDR_LE.to_vec())
    }

    fn header(&mut self, at: Duration, frame: &str) {
        self.u32(at.as_secs() as u32);
        self.u32(at.subsec_nanos());
        self.string(frame);
    }

    fn pose_stamped(&mut self, at: Duration, frame: &str, pose: &RosPose) {
        self.header(at, frame);
        let [w, x, y, z] = pose.orientation;
        pose.position_m.into_iter().chain([x, y, z, w]).for_each(|value| self.f64(value));
    }

    fn string(&mut self, text: &str) {
        self.u32(text.len() as u32 + 1);
        self.0.extend_from_slice(text.as_bytes());
        self.0.push(0);
    }

    fn u8(&mut self, value: u8) {
        self.0.push(value);
    }

    fn u32(&mut self, value: u32) {
        self.align(4);
        self.0.extend_from_slice(&value.to_le_bytes());
    }

    fn f64(&mut self, value: f64) {
        self.align(8);
        self.0.extend_from_slice(&value.to_le_bytes());
    }

    fn align(&mut self, size: usize) {
        let body = self.0.len() - CDR_LE.len();
        self.0.resize(CDR_LE.len() + body.next_multiple_of(size), 0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(message: &Message) -> String {
        let hex = |word: &[u8]| word.iter().map(|byte| format!("{byte:02x}")).collect::<String>();
        message.as_bytes().chunks(4).map(hex).collect::<Vec<_>>().join(" ")
    }

    #[test]
    fn each_field_is_aligned_to_its_size_behind_the_four_bytes() {
        let joints = [Joint { position: 1.0, speed: 2.0 }, Joint { position: -0.5, speed: 0.0 }];
        let names = ["j1", "j2"].map(str::to_owned);
        let message = Message::joint_state(Duration::new(3, 7), "base", &names, &joints);
        // The words: header; stamp; frame with its length and padding; names; positions; speeds; efforts.
        insta::assert_snapshot!(words(&message), @"00010000 03000000 07000000 05000000 62617365 00000000 02000000 03000000 6a310000 03000000 6a320000 02000000 00000000 00000000 0000f03f 00000000 0000e0bf 02000000 00000000 00000000 00000040 00000000 00000000 00000000");
    }

    #[test]
    fn a_warning_has_its_text_behind_time_level_and_name() {
        // Header; time; level with padding; name, text, file and function, each with its length and padding; line.
        insta::assert_snapshot!(words(&Message::warning("gap")), @"00010000 00000000 00000000 1e000000 0b000000 736b696c 6c62656e 63680000 04000000 67617000 01000000 00000000 01000000 00000000 00000000");
    }

    #[test]
    fn a_point_has_sixteen_bytes_behind_the_names_of_its_fields() {
        let message = Message::points("base", &[[1.0, 2.0, 3.0, 0.5]]);
        // Header; stamp; frame; height and width; four fields, each a name with its length and padding, offset, type
        // with padding, and count; byte order with padding; bytes of a point, of a row and of all; the point; dense.
        insta::assert_snapshot!(words(&message), @"00010000 00000000 00000000 05000000 62617365 00000000 01000000 01000000 04000000 02000000 78000000 00000000 07000000 01000000 02000000 79000000 04000000 07000000 01000000 02000000 7a000000 08000000 07000000 01000000 06000000 73706565 64000000 0c000000 07000000 01000000 00000000 10000000 10000000 10000000 0000803f 00000040 00004040 0000003f 01");
    }
}
