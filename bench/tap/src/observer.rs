//! The machine that takes frames and returns what they show.

use std::collections::BTreeMap;
use std::time::Duration;

use machine::ethernet::Mac;

use crate::address::Address;
use crate::content::Direction;
use crate::cyclic::{CyclicFrame, FlowKey};
use crate::expected::ExpectedRun;
use crate::findings::{self, Findings};
use crate::flow::Flow;
use crate::packet::Packet;
use crate::relation::Relations;
use crate::station::Station;

/// Connections and robots that are followed. More are counted.
const MAX_FLOWS: usize = 256;
const MAX_STATIONS: usize = 32;

/// What an observer is to look for.
#[derive(Clone, PartialEq, Debug)]
pub struct TapConfig {
    /// The skills of a repetition.
    pub expected: ExpectedRun,
    /// Cycle of the bus, where neither the start of the connection nor the frames tell it.
    pub cycle: Duration,
    /// The robot to measure, if there are several.
    pub robot: Option<Address>,
}

/// Reason why a capture cannot be measured.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub enum Unmeasurable {
    /// There are no cyclic frames.
    #[error(
        "no cyclic frame of PROFINET or EtherNet/IP among {packets} packets: capture on the cable between PLC and robot, or at a \
         mirror port"
    )]
    NoCyclicFrames {
        /// Packets in the capture.
        packets: u64,
    },
    /// No cyclic frame has the image.
    #[error(
        "{frames} cyclic frames, none with the process image: begin the capture before the PLC connects, or have both ends send \
         the check"
    )]
    NoImage {
        /// Cyclic frames in the capture.
        frames: u64,
    },
    /// Only one direction is there.
    #[error("only frames {present} are in the capture, none {missing}: mirror both directions of the port")]
    OneDirection {
        /// The direction that is there.
        present: &'static str,
        /// The other one.
        missing: &'static str,
    },
    /// Several robots.
    #[error("{} robots are in the capture, {}: choose one by --robot", .0.len(), listed(.0))]
    SeveralRobots(Vec<Address>),
    /// The chosen robot is not there.
    #[error("no robot {wanted} in the capture: it has {}", listed(found))]
    OtherRobots {
        /// The chosen one.
        wanted: Address,
        /// Those that are there.
        found: Vec<Address>,
    },
    /// Several PLCs command the robot.
    #[error("{} PLCs command the robot {robot}, {}: capture with one of them", plcs.len(), listed(plcs))]
    SeveralPlcs {
        /// The robot.
        robot: Address,
        /// The PLCs.
        plcs: Vec<Address>,
    },
    /// No repetition is complete.
    #[error("no complete repetition in the capture: {0}")]
    NoRepetition(String),
}

fn listed(addresses: &[Address]) -> String {
    addresses.iter().map(ToString::to_string).collect::<Vec<_>>().join(" and ")
}

/// Packets of a capture, by what became of them.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub(crate) struct PacketCounts {
    pub(crate) packets: u64,
    pub(crate) cyclic: u64,
    /// Cyclic frames without their end, because the snapshot length was too short.
    pub(crate) cut: u64,
    /// Packets that are earlier than the one before.
    pub(crate) backwards: u64,
    /// Cyclic frames of connections beyond those that are followed.
    pub(crate) not_followed: u64,
}

/// Measures a PLC and a robot from captured frames.
#[derive(Debug)]
pub struct Observer {
    pub(crate) config: TapConfig,
    pub(crate) relations: Relations,
    pub(crate) flows: BTreeMap<FlowKey, Flow>,
    /// Interfaces of the senders of cyclic frames.
    pub(crate) macs: BTreeMap<Address, Mac>,
    stations: Vec<Station>,
    pub(crate) counts: PacketCounts,
    first_ns: Option<u64>,
    last_ns: u64,
}

impl Observer {
    /// Creates an observer that has seen nothing.
    #[must_use]
    pub fn new(config: TapConfig) -> Self {
        Self {
            config,
            relations: Relations::default(),
            flows: BTreeMap::new(),
            macs: BTreeMap::new(),
            stations: Vec::new(),
            counts: PacketCounts::default(),
            first_ns: None,
            last_ns: 0,
        }
    }

    /// Takes the next packet, an Ethernet frame, with its time in ns since any moment; `is_cut` where its end was not captured.
    pub fn handle_packet(&mut self, nanos: u64, frame: &[u8], is_cut: bool) {
        let first = *self.first_ns.get_or_insert(nanos);
        let now_ns = nanos.saturating_sub(first);
        self.counts.packets += 1;
        self.counts.backwards += u64::from(now_ns < self.last_ns);
        // Captures of two interfaces that were joined may go back by some µs. Time never does.
        self.last_ns = self.last_ns.max(now_ns);
        let Ok(packet) = Packet::parse(frame) else { return };
        if self.relations.read(&packet) {
            self.agree();
        }
        let Some(cyclic) = CyclicFrame::of(&packet) else { return };
        self.counts.cyclic += 1;
        if is_cut {
            self.counts.cut += 1;
            return;
        }
        self.handle_cyclic(&packet, &cyclic);
    }

    fn handle_cyclic(&mut self, packet: &Packet<'_>, frame: &CyclicFrame<'_>) {
        if !self.flows.contains_key(&frame.key) {
            if self.flows.len() >= MAX_FLOWS {
                self.counts.not_followed += 1;
                return;
            }
            let cycle_ns = u64::try_from(self.config.cycle.as_nanos()).unwrap_or(u64::MAX);
            let mut flow = Flow::new(frame.key, cycle_ns);
            if let Some(agreement) = self.relations.agreement(&frame.key) {
                flow.agree(agreement);
            }
            self.flows.insert(frame.key, flow);
            self.macs.insert(frame.key.from, packet.source);
        }
        let Some(flow) = self.flows.get_mut(&frame.key) else { return };
        let Some(new) = flow.handle_frame(self.last_ns, frame) else { return };
        let FlowKey { bus, from, to, .. } = frame.key;
        let robot = match new.direction {
            Direction::Command => to,
            Direction::Feedback => from,
        };
        let at = self.stations.iter().position(|station| (station.bus, station.robot) == (bus, robot));
        let at = at.unwrap_or_else(|| {
            if self.stations.len() < MAX_STATIONS && !robot.is_group() {
                self.stations.push(Station::new(bus, robot, &self.config.expected));
            }
            self.stations.len().saturating_sub(1)
        });
        let station = self.stations.get_mut(at).filter(|station| station.robot == robot);
        if let Some(station) = station {
            station.handle_image(self.last_ns, &frame.key, &new);
        }
    }

    /// Applies the connection that was set up last to frames that are known already: numbers may be used again.
    fn agree(&mut self) {
        for flow in self.flows.values_mut() {
            if let Some(agreement) = self.relations.newest_agreement(&flow.key) {
                flow.agree(agreement);
            }
        }
    }

    /// Ends the capture and returns what it shows.
    ///
    /// # Errors
    ///
    /// Nothing can be measured, or it is not clear of whom.
    pub fn finish(mut self) -> Result<Findings, Unmeasurable> {
        self.stations.iter_mut().for_each(Station::end);
        let stations = std::mem::take(&mut self.stations);
        let station = self.chosen(stations)?;
        findings::of_station(&self, &station, self.last_ns)
    }

    fn chosen(&self, mut stations: Vec<Station>) -> Result<Station, Unmeasurable> {
        if self.counts.cyclic == 0 {
            return Err(Unmeasurable::NoCyclicFrames { packets: self.counts.packets });
        }
        let all: Vec<_> = stations.iter().map(|station| station.robot).collect();
        if let Some(wanted) = self.config.robot {
            stations.retain(|station| station.robot == wanted);
            if stations.is_empty() && !all.is_empty() {
                return Err(Unmeasurable::OtherRobots { wanted, found: all });
            }
        } else if all.len() > 1 {
            return Err(Unmeasurable::SeveralRobots(all));
        }
        let station = stations.pop().ok_or(Unmeasurable::NoImage { frames: self.counts.cyclic })?;
        let (to_robot, to_plc) = ("to the robot", "to the PLC");
        match (station.commands, station.feedbacks) {
            (0, _) => return Err(Unmeasurable::OneDirection { present: to_plc, missing: to_robot }),
            (_, 0) => return Err(Unmeasurable::OneDirection { present: to_robot, missing: to_plc }),
            _ => {}
        }
        if station.plcs.len() > 1 {
            let Station { robot, plcs, .. } = station;
            return Err(Unmeasurable::SeveralPlcs { robot, plcs });
        }
        Ok(station)
    }
}
