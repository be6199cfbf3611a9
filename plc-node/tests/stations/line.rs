//! Robots in line on one EtherCAT cable.

use ethercat_subdevice::{DeviceConfig, DeviceId, Event, Segment};
use machine::{Instant, Machine, PortRequest, Source, Transmit};
use protocol::fieldbus::LinkEvent;
use protocol::image::Order;
use protocol::stations::ETHERCAT_ROBOT;

use crate::robot::RobotScript;

/// SubDevices in line, each of a robot.
#[derive(Debug)]
pub(crate) struct Line {
    pub(crate) segment: Segment,
    pub(crate) scripts: Vec<RobotScript>,
}

impl Line {
    pub(crate) fn new(scripts: Vec<RobotScript>) -> Self {
        let mut segment = Segment::new();
        for serial_number in 1..=scripts.len() as u32 {
            segment.add(&DeviceConfig { serial_number, ..DeviceConfig::new(&ETHERCAT_ROBOT) });
        }
        Self { segment, scripts }
    }
}

impl Machine for Line {
    type Event = LinkEvent;

    fn ports(&self) -> &[PortRequest] {
        self.segment.ports()
    }

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        self.segment.handle_frame(now, from, frame);
    }

    fn handle_timeout(&mut self, now: Instant) {
        for (index, script) in self.scripts.iter_mut().enumerate() {
            let id = DeviceId(index);
            let input = self.segment.outputs(id).and_then(|outputs| outputs.try_into().ok());
            if let Some(image) = script.cycle(now, Order::LittleEndian, input) {
                self.segment.set_inputs(id, &image).unwrap();
            }
        }
        if self.segment.poll_timeout().is_some_and(|due| due <= now) {
            self.segment.handle_timeout(now);
        }
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        self.segment.poll_transmit(now, buf)
    }

    fn poll_event(&mut self) -> Option<LinkEvent> {
        while let Some((_, event)) = self.segment.poll_event() {
            assert!(matches!(event, Event::StateChanged { .. }), "{event:?}");
        }
        None
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.scripts
            .iter()
            .map(|script| Some(script.next()))
            .fold(self.segment.poll_timeout(), Instant::earlier)
    }
}
