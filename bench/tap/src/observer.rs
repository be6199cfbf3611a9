//! The machine that takes frames and returns what they show.

use std::time::Duration;

use crate::address::EndAddress;
use crate::content::ImageDirection;
use crate::cyclic::{CyclicFrame, FlowKey};
use crate::expected::ExpectedRun;
use crate::findings::{self, Findings};
use crate::flow::Flow;
use crate::packet::EthernetPacket;
use crate::station::WatchedRobot;
use crate::traffic::Traffic;
use crate::unmeasurable::Unmeasurable;

/// Connections and robots that are followed. More are counted.
const MAX_FLOWS: usize = 256;
const MAX_STATIONS: usize = 32;

/// Time in ns by which packets of one capture may be out of order.
const MAX_BACK_NS: i128 = 1_000_000_000;

/// Plan, cycle and robot that an observer looks for.
#[derive(Clone, PartialEq, Debug)]
pub struct TapConfig {
    /// The skills of a repetition.
    pub expected: ExpectedRun,
    /// Cycle of the bus, where neither the start of the connection nor the frames tell it.
    pub cycle: Duration,
    /// The robot to measure, if there are several.
    pub robot: Option<EndAddress>,
}

/// Measures a PLC and a robot from captured frames.
#[derive(Debug)]
pub struct CaptureObserver {
    config: TapConfig,
    traffic: Traffic,
    stations: Vec<WatchedRobot>,
    /// Time of a packet minus this is the time since the first packet.
    base_ns: Option<i128>,
    last_ns: u64,
}

impl CaptureObserver {
    /// Creates an observer that has seen nothing.
    #[must_use]
    pub fn new(config: TapConfig) -> Self {
        Self { config, traffic: Traffic::default(), stations: Vec::new(), base_ns: None, last_ns: 0 }
    }

    /// Takes the next packet, an Ethernet frame, with its time in ns since any moment; `is_cut` where its end was not captured.
    pub fn handle_packet(&mut self, nanos: u64, frame: &[u8], is_cut: bool) {
        let nanos = i128::from(nanos);
        let base = self.base_ns.get_or_insert(nanos);
        let last = i128::from(self.last_ns);
        let back = last - (nanos - *base);
        self.traffic.counts.packets += 1;
        self.traffic.counts.backwards += u64::from(back > 0);
        if back > MAX_BACK_NS {
            // Another capture was joined to this one: its time goes on from here.
            *base = nanos - last;
        }
        // Captures of two interfaces that were joined may go back by some µs. Time never does.
        self.last_ns = self.last_ns.max(u64::try_from(nanos - *base).unwrap_or_default());
        let Ok(packet) = EthernetPacket::parse(frame) else { return };
        self.traffic.seen.read(&packet);
        if self.traffic.relations.read(&packet) {
            self.traffic.agree();
        }
        let Some(cyclic) = CyclicFrame::of(&packet) else { return };
        self.traffic.counts.cyclic += 1;
        if is_cut {
            self.traffic.counts.cut += 1;
            return;
        }
        self.handle_cyclic(&packet, &cyclic);
    }

    fn handle_cyclic(&mut self, packet: &EthernetPacket<'_>, frame: &CyclicFrame<'_>) {
        if !self.traffic.flows.contains_key(&frame.key) {
            if self.traffic.flows.len() >= MAX_FLOWS {
                self.traffic.counts.not_followed += 1;
                return;
            }
            let cycle_ns = u64::try_from(self.config.cycle.as_nanos()).unwrap_or(u64::MAX);
            let mut flow = Flow::new(frame.key, cycle_ns);
            if let Some(agreement) = self.traffic.relations.agreement(&frame.key) {
                flow.agree(agreement);
            }
            self.traffic.flows.insert(frame.key, flow);
            self.traffic.macs.insert(frame.key.from, packet.source);
        }
        let Some(flow) = self.traffic.flows.get_mut(&frame.key) else { return };
        let Some(new) = flow.handle_frame(self.last_ns, frame) else { return };
        let FlowKey { bus, from, to, .. } = frame.key;
        let robot = match new.direction {
            ImageDirection::Command => to,
            ImageDirection::Feedback => from,
        };
        let at = self.stations.iter().position(|station| (station.bus, station.robot) == (bus, robot));
        let at = at.unwrap_or_else(|| {
            if self.stations.len() < MAX_STATIONS && !robot.is_group() {
                self.stations.push(WatchedRobot::new(bus, robot, &self.config.expected));
            }
            self.stations.len().saturating_sub(1)
        });
        let station = self.stations.get_mut(at).filter(|station| station.robot == robot);
        if let Some(station) = station {
            station.handle_image(self.last_ns, &frame.key, &new);
        }
    }

    /// Ends the capture and returns what it shows.
    ///
    /// # Errors
    ///
    /// Nothing can be measured, or it is not clear of whom.
    pub fn finish(mut self) -> Result<Findings, Unmeasurable> {
        self.stations.iter_mut().for_each(WatchedRobot::end);
        let stations = std::mem::take(&mut self.stations);
        let station = self.chosen(stations)?;
        findings::of_station(&self.traffic, &station, self.last_ns)
    }

    fn chosen(&self, mut stations: Vec<WatchedRobot>) -> Result<WatchedRobot, Unmeasurable> {
        if self.traffic.counts.cyclic == 0 {
            return Err(Unmeasurable::NoCyclicFrames { packets: self.traffic.counts.packets });
        }
        let all: Vec<_> = stations.iter().map(|station| station.robot).collect();
        if let Some(wanted) = self.config.robot {
            stations.retain(|station| station.robot == wanted);
            if stations.is_empty() && !all.is_empty() {
                return Err(Unmeasurable::OtherRobots { wanted, found: all });
            }
        } else if all.iter().any(|robot| Some(robot) != all.first()) {
            return Err(Unmeasurable::SeveralRobots(all));
        }
        if let [first, _, ..] = stations.as_slice() {
            let buses = stations.iter().map(|station| station.bus).collect();
            return Err(Unmeasurable::SharedAddress { robot: first.robot, buses });
        }
        let station = stations.pop().ok_or(Unmeasurable::NoImage { frames: self.traffic.counts.cyclic })?;
        let (to_robot, to_plc) = ("to the robot", "to the PLC");
        match (station.commands, station.feedbacks) {
            (0, _) => return Err(Unmeasurable::OneDirection { present: to_plc, missing: to_robot }),
            (_, 0) => return Err(Unmeasurable::OneDirection { present: to_robot, missing: to_plc }),
            _ => {}
        }
        if station.plcs.len() > 1 {
            let WatchedRobot { robot, plcs, .. } = station;
            return Err(Unmeasurable::SeveralPlcs { robot, plcs });
        }
        Ok(station)
    }
}
