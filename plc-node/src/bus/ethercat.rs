//! The PLC as EtherCAT MainDevice: the image is the process data of one SubDevice in its direction.

use core::fmt;

use ethercat_maindevice::{Config, ExpectedDevice, GroupMainDevice};
use machine::ethernet::Mac;
use machine::{Counters, Duration, Instant, LinkEvent, Machine, PortRequest, Source, Transmit};
use protocol::fieldbus::Fieldbus;
use protocol::image::{IMAGE_LEN, Image, Order};
use protocol::stations::ETHERCAT_ROBOT;
use setup::{Bus, Ethercat};

/// A MainDevice with one SubDevice, the robot.
#[derive(Debug)]
pub struct EthercatMainDevice(GroupMainDevice);

impl EthercatMainDevice {
    /// Creates the MainDevice of a setup. It looks for the robot from `start` on.
    pub(super) fn new(bus: &Bus, ethercat: &Ethercat, mac: Mac, start: Instant) -> Self {
        let device = match &ethercat.device {
            Some(device) => ExpectedDevice {
                vendor: device.vendor,
                product: device.product,
                revision: device.revision,
                output_bytes: device.output_bytes.into(),
                input_bytes: device.input_bytes.into(),
            },
            None => ExpectedDevice {
                vendor: ETHERCAT_ROBOT.vendor_id,
                product: ETHERCAT_ROBOT.product_code,
                revision: Some(ETHERCAT_ROBOT.revision),
                output_bytes: IMAGE_LEN,
                input_bytes: IMAGE_LEN,
            },
        };
        let cycle = Duration::from_micros(bus.cycle_us.value.into());
        let config = Config { mac, devices: vec![device], cycle, watchdog: bus.watchdog() };
        Self(GroupMainDevice::new(config, start))
    }
}

impl Machine for EthercatMainDevice {
    type Event = LinkEvent;

    fn ports(&self) -> &[PortRequest] {
        self.0.ports()
    }

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        self.0.handle_frame(now, from, frame);
    }

    fn handle_timeout(&mut self, now: Instant) {
        self.0.handle_timeout(now);
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        self.0.poll_transmit(now, buf)
    }

    fn poll_event(&mut self) -> Option<LinkEvent> {
        self.0.poll_event()
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.0.poll_timeout()
    }
}

impl Fieldbus for EthercatMainDevice {
    fn byte_order(&self) -> Order {
        Order::LittleEndian
    }

    /// The device's data may be shorter or longer than the image.
    fn set_output(&mut self, image: &Image) {
        self.0.outputs_mut().iter_mut().zip(image).for_each(|(place, byte)| *place = *byte);
    }

    /// The device's data may be shorter or longer than the image.
    fn input(&self) -> Option<Image> {
        let inputs = self.0.inputs()?;
        let mut image = [0; IMAGE_LEN];
        image.iter_mut().zip(inputs).for_each(|(place, byte)| *place = *byte);
        Some(image)
    }

    fn disconnect(&mut self, now: Instant) {
        self.0.disconnect(now);
    }

    fn explain(&self, words: &mut dyn fmt::Write) -> fmt::Result {
        self.0.explain(words)
    }

    fn counters(&self) -> Counters {
        self.0.counters()
    }
}
