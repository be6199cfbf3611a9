//! Purpose of both nodes' digests: they detect a fault between the nodes that no counter shows.

use machine::wire::BigEndian;
use machine::{Duration, Instant, Machine, PortRequest, Source, Transmit};
use planning::PROGRAM;
use plc_node::{ExecutionType, PlcConfig, PlcEvent, PlcNode, PlcReport};
use protocol::direct::Direct;
use protocol::fieldbus::{Counters, Fieldbus, LinkEvent};
use protocol::image::{Command, Digest, IMAGE_LEN, Image, Order};
use protocol::one_station::OneStation;
use robot_node::{RobotConfig, RobotNode};
use virtual_time::{Clock, Event, Impairment, Pair, PairConfig};

/// Replaces motion `at` of a sequence by the one two before it, as a wrong slot of the image would.
#[derive(Debug)]
struct WrongSlot {
    bus: Direct,
    at: Option<u32>,
    image: Image,
}

impl Machine for WrongSlot {
    type Event = LinkEvent;

    fn ports(&self) -> &[PortRequest] {
        self.bus.ports()
    }

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        self.bus.handle_frame(now, from, frame);
        let Some(image) = self.bus.input() else { return };
        let mut command = Command::parse::<BigEndian>(&image).unwrap();
        if let Some(at) = self.at.filter(|at| (at + 1..at + 4).contains(&command.written)) {
            command.set_slot(at, *command.slot(at - 2));
        }
        command.emit::<BigEndian>(&mut self.image);
    }

    fn handle_timeout(&mut self, now: Instant) {
        self.bus.handle_timeout(now);
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        self.bus.poll_transmit(now, buf)
    }

    fn poll_event(&mut self) -> Option<LinkEvent> {
        self.bus.poll_event()
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.bus.poll_timeout()
    }
}

impl Fieldbus for WrongSlot {
    fn byte_order(&self) -> Order {
        Order::BigEndian
    }

    fn set_output(&mut self, image: &Image) {
        self.bus.set_output(image);
    }

    fn input(&self) -> Option<Image> {
        self.bus.input().map(|_| self.image)
    }

    fn disconnect(&mut self, now: Instant) {
        self.bus.disconnect(now);
    }

    fn counters(&self) -> Counters {
        self.bus.counters()
    }
}

/// Returns the digests of PLC and robot after a pick and place, with or without a motion from the wrong slot.
fn digests(at: Option<u32>) -> [Digest; 2] {
    const MS: Duration = Duration::from_millis(1);
    let (setup, found) = planning::setup_with_application("A").unwrap();
    let motions = found.plan(&setup).unwrap().wire_motions(&setup);
    let bus = || Direct::new(Instant::ZERO, MS, MS * 100);
    let plc =
        PlcNode::new(PlcConfig::from_setup(&setup, motions, PROGRAM), OneStation::new(bus()), Instant::ZERO);
    let robot_bus = WrongSlot { bus: bus(), at, image: [0; IMAGE_LEN] };
    let robot_config = RobotConfig::from_setup(&setup).unwrap();
    let robot = RobotNode::new(robot_config, Vec::new(), robot_bus, 1, Instant::ZERO);
    let config = PairConfig {
        seed: 1,
        clocks: [Clock::default(); 2],
        links: [Impairment { delay: Duration::from_micros(25), ..Impairment::default() }; 2],
        addresses: [None; 2],
    };
    let mut pair = Pair::new(plc, robot, config);
    let until = Instant::from_millis(60_000);
    while let Some(event) = pair.next_event(until) {
        match event {
            Event::A(PlcReport { event: PlcEvent::Ready, .. }) => {
                pair.command_a(|plc, now| plc.start(now, ExecutionType::Cm)).unwrap();
            }
            Event::A(PlcReport { event: PlcEvent::Finished(execution), .. }) => {
                assert_eq!(execution.motions, 13, "no counter shows the fault");
                return [pair.a().sent(), *pair.b().controller().accepted()];
            }
            Event::A(PlcReport { event: PlcEvent::Failed(failure), .. }) => panic!("{failure}"),
            _ => {}
        }
    }
    panic!("the run did not end");
}

#[test]
fn a_motion_from_the_wrong_slot_changes_the_digests_and_nothing_else() {
    let [sent, accepted] = digests(None);
    assert_eq!((sent, sent.sum().motions), (accepted, 13));
    let [sent, accepted] = digests(Some(11));
    assert_eq!(sent.sum().motions, accepted.sum().motions);
    assert_ne!(sent.sum().value, accepted.sum().value);
}
