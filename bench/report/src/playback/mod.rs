//! A run as `motion.mcap`: the arm's joints, the path of its tool and the speed along it, for Foxglove and Rerun.
//!
//! The messages are those of ROS 2, because both programs show them as joints and poses; Rerun shows messages in JSON as
//! text. Time zero of each type is the start edge of its first repetition, so that the types play side by side:
//!
//! ```text
//! /rc/joint_states      sensor_msgs/JointState     every robot cycle, in rad and rad/s, m and m/s on a linear axis
//! /rc/tool              geometry_msgs/PoseStamped  every robot cycle, in m, in the frame `base`
//! /rc/path_speed        std_msgs/Float64           every robot cycle, in m/s
//! /rc/programmed_speed  std_msgs/Float64           every robot cycle, in m/s
//! /rc/path              nav_msgs/Path              once, the whole way of the tool, which Foxglove draws
//! /rc/path_points       sensor_msgs/PointCloud2    once, the same with the speed there, which Rerun draws too
//! /sm/…, /cm/…
//! /log                  rcl_interfaces/Log         once, a warning, only where the recordings lack something
//! ```
//!
//! In a cell with several stations each has its own topics, `/rc/left/joint_states`, and all poses are in the frame `cell`.
//!
//! The metadata record `skillbench` has `setup`, `positions` (`drives` or `set-points`), and `complete` (`yes` or `no`) with
//! what is `lacking`.

mod programmed;
mod ros2;

use std::collections::BTreeMap;
use std::io::Cursor;
use std::time::Duration;

use mcap::records::{MessageHeader, Metadata};
use mcap::{McapResult, WriteOptions, Writer};
use planning::Plan;
use plc_node::ExecutionType;
use robot_node::Positions;
use robot_node::arm::{Frame, Rotation};
use setup::{Kinematics, Setup};

use records::trace::{RobotTick, Trace};
use ros2::{Joint, Message, RosPose};

/// The file, in the run directory.
pub const FILE: &str = "motion.mcap";

/// Frame of the poses: the base in which the motions are programmed.
const FRAME: &str = "base";
/// Frame of the poses of several stations: the cell.
const CELL_FRAME: &str = "cell";

/// A station and its trace.
#[derive(Clone, Copy, Debug)]
pub struct PlaybackStation<'a> {
    /// Its name, and the frame in the cell of the base in which its motions are programmed; `None` for the only one.
    pub placed: Option<(&'a str, Frame)>,
    /// Its trace.
    pub trace: &'a Trace,
    /// Its setup.
    pub setup: &'a Setup,
    /// Its plan.
    pub plan: &'a Plan,
}

/// Name of the file's metadata record.
const METADATA: &str = "skillbench";

/// Encodes a trace as an MCAP file.
///
/// # Errors
///
/// None is known; the writer's interface allows for one.
pub fn bytes(trace: &Trace, setup: &Setup, plan: &Plan) -> McapResult<Vec<u8>> {
    bytes_of(&setup.name, &[PlaybackStation { placed: None, trace, setup, plan }])
}

/// Encodes the traces of the stations of a setup as one MCAP file.
///
/// # Errors
///
/// None is known; the writer's interface allows for one.
pub fn bytes_of(setup: &str, stations: &[PlaybackStation<'_>]) -> McapResult<Vec<u8>> {
    let options = WriteOptions::new()
        .compression(None)
        .profile("ros2")
        .library(concat!("skillbench ", env!("CARGO_PKG_VERSION")));
    let mut file =
        PlaybackFile { writer: options.create(Cursor::new(Vec::new()))?, sequences: BTreeMap::new() };
    file.say_what_is_lacking(setup, stations)?;
    let arms: Vec<_> = stations.iter().map(|station| Arm::of(station.setup)).collect();
    let mut moments = Vec::new();
    for (station, arm) in stations.iter().zip(&arms) {
        let motions = station.plan.wire_motions(station.setup);
        for execution_type in ExecutionType::ALL {
            let ticks = ticks(station.trace, execution_type);
            if ticks.is_empty() {
                continue;
            }
            let channels = Channels::open(&mut file, execution_type, station)?;
            // Before its first motion, the robot reports its pose in an undefined base.
            let moved: Vec<_> =
                ticks.iter().skip_while(|(_, tick)| tick.sample.path_speed_mm_s == 0.0).collect();
            let way: Vec<_> = moved.iter().map(|(at, tick)| (*at, station.pose(tick))).collect();
            file.write(channels.path, Duration::ZERO, &Message::path(station.frame(), &way))?;
            let points: Vec<_> = moved.iter().map(|(_, tick)| station.point(tick)).collect();
            file.write(channels.points, Duration::ZERO, &Message::points(station.frame(), &points))?;
            let speeds = programmed::speeds_mm_s(ticks.iter().map(|(_, tick)| &tick.sample), &motions);
            let joints = arm.joint_states(&ticks);
            let of_ticks = ticks.into_iter().zip(joints).zip(speeds);
            moments
                .extend(of_ticks.map(|(((at, tick), joints), speed)| {
                    (at, (channels, station, arm), tick, joints, speed)
                }));
        }
    }
    // So far the types follow each other; players need messages in order of time.
    moments.sort_by_key(|(at, ..)| *at);
    for (at, (channels, station, arm), tick, joints, programmed_mm_s) in moments {
        let frame = station.frame();
        file.write(channels.joints, at, &Message::joint_state(at, frame, &arm.names, &joints))?;
        file.write(channels.tool, at, &Message::pose(at, frame, &station.pose(tick)))?;
        file.write(channels.speed, at, &Message::float(f64::from(tick.sample.path_speed_mm_s) / 1e3))?;
        file.write(channels.programmed, at, &Message::float(programmed_mm_s / 1e3))?;
    }
    file.writer.finish()?;
    Ok(file.writer.into_inner().into_inner())
}

/// Returns the robot's cycles of a run with their times. A cycle that began before the start edge is not part of the
/// run.
fn ticks(trace: &Trace, execution_type: ExecutionType) -> Vec<(Duration, &RobotTick)> {
    let all = trace.types.get(execution_type).map_or(&[][..], |recording| recording.robot_ticks());
    let since_start = |tick: &RobotTick| Duration::from_nanos((tick.at_ms * 1e6).round() as u64);
    all.iter().filter(|tick| tick.at_ms >= 0.0).map(|tick| (since_start(tick), tick)).collect()
}

impl PlaybackStation<'_> {
    const fn frame(&self) -> &'static str {
        if self.placed.is_some() { CELL_FRAME } else { FRAME }
    }

    fn pose(&self, tick: &RobotTick) -> RosPose {
        let [x, y, z, a, b, c] = tick.sample.pose.map(f64::from);
        let tool = Frame { position: [x, y, z], rotation: Rotation::from_angles([a, b, c]) };
        let tool = self.placed.map_or(tool, |(_, base)| base * tool);
        RosPose { position_m: tool.position.map(|mm| mm / 1e3), orientation: tool.rotation.quaternion() }
    }

    /// Returns the tool's position x, y, z in m and its speed in m/s.
    fn point(&self, tick: &RobotTick) -> [f32; 4] {
        let speed = tick.sample.path_speed_mm_s / 1e3;
        let [x, y, z] = match self.placed {
            // As exact as the image has it.
            None => {
                let [x, y, z, ..] = tick.sample.pose;
                [x, y, z].map(|mm| mm / 1e3)
            }
            Some(_) => self.pose(tick).position_m.map(|metres| metres as f32),
        };
        [x, y, z, speed]
    }
}

/// The joints of the arm.
struct Arm {
    names: Vec<String>,
    linear: Option<usize>,
}

impl Arm {
    fn of(setup: &Setup) -> Self {
        let (axes, linear) = match &setup.robot.kinematics {
            Kinematics::Scara(_) => (4, Some(2)),
            Kinematics::Opw(_) | Kinematics::ThreeParallel(_) => (6, None),
        };
        Self { names: (1..=axes).map(|axis| format!("joint_{axis}")).collect(), linear }
    }

    /// Returns the joints in each cycle; their speeds are differences between the previous and the next cycle.
    fn joint_states(&self, ticks: &[(Duration, &RobotTick)]) -> Vec<Vec<Joint>> {
        let last = ticks.len().saturating_sub(1);
        let around = |index: usize| (ticks.get(index.saturating_sub(1)), ticks.get((index + 1).min(last)));
        let of_tick = |(index, (_, tick)): (usize, &(Duration, &RobotTick))| {
            let joint = |axis| {
                let speed = match around(index) {
                    (Some((from, before)), Some((to, behind))) if to > from => {
                        (self.value(behind, axis) - self.value(before, axis)) / (*to - *from).as_secs_f64()
                    }
                    _ => 0.0,
                };
                Joint { position: self.value(tick, axis), speed }
            };
            (0..self.names.len()).map(joint).collect()
        };
        ticks.iter().enumerate().map(of_tick).collect()
    }

    /// Returns the value of a joint in rad or m.
    fn value(&self, tick: &RobotTick, axis: usize) -> f64 {
        let value = tick.sample.joints.get(axis).copied().unwrap_or_default();
        if self.linear == Some(axis) { value / 1e3 } else { value.to_radians() }
    }
}

/// The channels of one type.
#[derive(Clone, Copy)]
struct Channels {
    joints: u16,
    tool: u16,
    speed: u16,
    programmed: u16,
    path: u16,
    points: u16,
}

impl Channels {
    fn open(
        file: &mut PlaybackFile,
        execution_type: ExecutionType,
        station: &PlaybackStation<'_>,
    ) -> McapResult<Self> {
        let of = station.placed.map_or_else(String::new, |(name, _)| format!("{name}/"));
        let mut open = |topic: &str, schema| file.open(&format!("/{execution_type}/{of}{topic}"), schema);
        Ok(Self {
            joints: open("joint_states", ros2::JOINT_STATE)?,
            tool: open("tool", ros2::POSE_STAMPED)?,
            speed: open("path_speed", ros2::FLOAT)?,
            programmed: open("programmed_speed", ros2::FLOAT)?,
            path: open("path", ros2::PATH)?,
            points: open("path_points", ros2::POINT_CLOUD)?,
        })
    }
}

struct PlaybackFile {
    writer: Writer<Cursor<Vec<u8>>>,
    /// Sequence number of each channel's next message.
    sequences: BTreeMap<u16, u32>,
}

impl PlaybackFile {
    /// Writes the metadata, and the warning if the recordings are not complete.
    fn say_what_is_lacking(&mut self, setup: &str, stations: &[PlaybackStation<'_>]) -> McapResult<()> {
        let said = stations.iter().filter_map(|station| {
            let lacking = station.trace.incomplete()?;
            Some(station.placed.map_or_else(|| lacking.clone(), |(name, _)| format!("{name}: {lacking}")))
        });
        let said: Vec<_> = said.collect();
        let lacking = (!said.is_empty()).then(|| said.join(" "));
        let complete = if lacking.is_none() { "yes" } else { "no" };
        let drives = stations.iter().find_map(|station| station.setup.robot.drives);
        let positions = Positions::of(drives).to_string();
        let mut metadata =
            BTreeMap::from([("setup", setup), ("complete", complete), ("positions", &positions)]);
        metadata.extend(lacking.as_deref().map(|lacking| ("lacking", lacking)));
        let metadata = metadata.into_iter().map(|(key, value)| (key.to_owned(), value.to_owned())).collect();
        self.writer.write_metadata(&Metadata { name: METADATA.to_owned(), metadata })?;
        let Some(lacking) = lacking else { return Ok(()) };
        let log = self.open("/log", ros2::LOG)?;
        self.write(log, Duration::ZERO, &Message::warning(&lacking))
    }

    fn open(&mut self, topic: &str, schema: ros2::Schema) -> McapResult<u16> {
        let schema = self.writer.add_schema(schema.name, "ros2msg", schema.definition.as_bytes())?;
        self.writer.add_channel(schema, topic, "cdr", &BTreeMap::new())
    }

    fn write(&mut self, channel_id: u16, at: Duration, message: &Message) -> McapResult<()> {
        let log_time = u64::try_from(at.as_nanos()).unwrap_or(u64::MAX);
        let next = self.sequences.entry(channel_id).or_default();
        let header = MessageHeader { channel_id, sequence: *next, log_time, publish_time: log_time };
        *next += 1;
        self.writer.write_to_known_channel(&header, message.as_bytes())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use records::results::PerType;
    use records::trace::{PlcScan, Recording};

    /// What a file says of its recordings: its metadata, and the bytes of its warnings.
    fn said(scans: impl Iterator<Item = u64>) -> (BTreeMap<String, String>, Vec<Vec<u8>>) {
        let (setup, found) = planning::setup_with_application("A").unwrap();
        let mut recording = Recording::default();
        scans.for_each(|scan| {
            let at_us = scan as i64 * 1_000;
            let sample = plc_node::Sample { scan, ..plc_node::Sample::default() };
            recording.plc(PlcScan { at_us, true_ns: 0, sample });
        });
        let trace = Trace { types: PerType { cm: Some(recording), ..PerType::default() } };
        let bytes = bytes(&trace, &setup, &found.plan(&setup).unwrap()).unwrap();
        let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
        let [index] = &summary.metadata_indexes[..] else { panic!("one metadata record") };
        let metadata = mcap::read::metadata(&bytes, index).unwrap().metadata;
        let messages = mcap::MessageStream::new(&bytes).unwrap().map(Result::unwrap);
        let of_log = messages.filter(|message| message.channel.topic == "/log");
        (metadata, of_log.map(|message| message.data.into_owned()).collect())
    }

    #[test]
    fn a_file_of_incomplete_recordings_says_so_in_its_metadata_and_in_a_warning() {
        let (metadata, warnings) = said((0..90).filter(|scan| !(20..25).contains(scan)));
        let said = "The recording of CM lacks 5 scans of the PLC.";
        let wanted = [("complete", "no"), ("lacking", said), ("positions", "set-points"), ("setup", "A")];
        assert!(
            metadata.iter().map(|(key, value)| (key.as_str(), value.as_str())).eq(wanted),
            "{metadata:?}"
        );
        let [warning] = &warnings[..] else { panic!("one warning") };
        let lacking = metadata["lacking"].as_bytes();
        assert!(warning.windows(lacking.len()).any(|part| part == lacking), "{warning:02x?}");
    }

    #[test]
    fn a_file_of_complete_recordings_says_that_and_warns_of_nothing() {
        let (metadata, warnings) = said(0..90);
        assert_eq!((metadata["complete"].as_str(), metadata.get("lacking")), ("yes", None));
        assert_eq!(warnings, Vec::<Vec<u8>>::new());
    }
}
