//! The PLC as EtherCAT MainDevice: an image is the process data of a SubDevice in its direction.

use core::fmt;

use device_files::ChosenDevice;
use ethercat_maindevice::{Config, ExpectedDevice, MainDevice, SubDeviceId};
use machine::ethernet::Mac;
use machine::{Counters, Duration, Instant, LinkEvent, Machine, Pending, PortRequest, Source, Transmit};
use protocol::buses::Stations;
use protocol::fieldbus::{ControllerBus, StationId};
use protocol::image::{IMAGE_LEN, Image, Order};
use protocol::stations::ETHERCAT_ROBOT;
use setup::{Bus, Ethercat};

use super::BusError;

/// A MainDevice with a SubDevice for each station.
#[derive(Debug)]
pub struct EthercatMainDevice {
    main: MainDevice,
    stations: Stations<SubDeviceId>,
}

/// Returns the SubDevice that a setup expects.
pub(super) fn expected(ethercat: &Ethercat) -> ExpectedDevice {
    match &ethercat.device {
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
    }
}

impl EthercatMainDevice {
    /// Creates the MainDevice of a bus. It looks for its SubDevices from `start` on, and starts those of a file as the file says.
    pub(super) fn new(
        bus: &Bus,
        devices: Vec<(ExpectedDevice, Option<&ChosenDevice>)>,
        mac: Mac,
        start: Instant,
    ) -> Result<Self, BusError> {
        let cycle = Duration::from_micros(bus.cycle_us.value.into());
        let (devices, of_files): (Vec<_>, Vec<_>) = devices.into_iter().unzip();
        let config = Config { mac, devices, cycle, watchdog: bus.watchdog() };
        let mut main =
            MainDevice::new(config, start).map_err(|error| BusError::TooMany(error.to_string()))?;
        for (id, of_file) in main.ids().zip(of_files) {
            if let Some(ChosenDevice::Esi(device)) = of_file {
                let writes = driven_device::startup_writes(device);
                main.set_startup(id, writes.map_err(|error| BusError::Device(error.to_string()))?);
            }
        }
        Ok(Self { stations: Stations::new(main.ids().collect()), main })
    }
}

impl Machine for EthercatMainDevice {
    type Event = (StationId, LinkEvent);

    fn ports(&self) -> &[PortRequest] {
        self.main.ports()
    }

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        self.main.handle_frame(now, from, frame);
    }

    fn handle_timeout(&mut self, now: Instant) {
        self.main.handle_timeout(now);
    }

    fn pending(&self, now: Instant) -> Pending {
        self.main.pending(now)
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        self.main.poll_transmit(now, buf)
    }

    fn poll_event(&mut self) -> Option<Self::Event> {
        let (device, event) = self.main.poll_event()?;
        Some((self.stations.of(device)?, event))
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.main.poll_timeout()
    }
}

impl ControllerBus for EthercatMainDevice {
    fn stations(&self) -> u16 {
        self.stations.count()
    }

    fn byte_order(&self) -> Order {
        Order::LittleEndian
    }

    /// The device's data may be shorter or longer than the image.
    fn set_output(&mut self, station: StationId, image: &Image) {
        let Some(device) = self.stations.connection(station) else { return };
        let outputs = self.main.outputs_mut(device);
        let len = outputs.len().min(IMAGE_LEN);
        if let (Some(place), Some(bytes)) = (outputs.get_mut(..len), image.get(..len)) {
            place.copy_from_slice(bytes);
        }
    }

    /// The device's data may be shorter or longer than the image.
    fn input(&self, station: StationId) -> Option<Image> {
        let inputs = self.main.inputs(self.stations.connection(station)?)?;
        let mut image = [0; IMAGE_LEN];
        let len = inputs.len().min(IMAGE_LEN);
        image.get_mut(..len)?.copy_from_slice(inputs.get(..len)?);
        Some(image)
    }

    fn repeats(&self, station: StationId, image: &Image) -> bool {
        let device = self.stations.connection(station);
        let Some(inputs) = device.and_then(|device| self.main.inputs(device)) else { return false };
        let (same, rest) = image.split_at(inputs.len().min(IMAGE_LEN));
        inputs.get(..same.len()) == Some(same) && rest.iter().all(|byte| *byte == 0)
    }

    fn poll_arrival(&mut self) -> Option<StationId> {
        let main = &mut self.main;
        core::iter::from_fn(|| main.poll_received()).find_map(|connection| self.stations.of(connection))
    }

    fn disconnect(&mut self, now: Instant, station: StationId) {
        if let Some(device) = self.stations.connection(station) {
            self.main.disconnect(now, device);
        }
    }

    fn explain(&self, station: StationId, words: &mut dyn fmt::Write) -> fmt::Result {
        self.stations.connection(station).map_or(Ok(()), |device| self.main.explain(device, words))
    }

    fn write_identity(&self, station: StationId, words: &mut dyn fmt::Write) -> fmt::Result {
        self.stations.connection(station).map_or(Ok(()), |device| self.main.write_identity(device, words))
    }

    fn counters(&self, station: StationId) -> Counters {
        let Some(device) = self.stations.connection(station) else { return Counters::default() };
        let own = self.main.counters(device);
        if station == StationId::FIRST { own + self.main.cable_counters() } else { own }
    }
}
