//! PROFINET: the image is the data of all submodules in its direction, one after another by slot and subslot.

use alloc::vec::Vec;
use core::fmt;

use machine::{Counters, Instant};
use profinet::dcp::IpSuite;
use profinet::{Ar, ArConfig, ArId, ConfigError, Controller, ControllerConfig, Device};

use super::{Stations, machine_with_stations};
use crate::fieldbus::{ControllerBus, Fieldbus, StationAddress, StationId, ToStore};
use crate::image::{IMAGE_LEN, Image, Order};

/// An IO-Controller that drives an IO-Device for each station.
#[derive(Debug)]
pub struct ProfinetController {
    controller: Controller,
    stations: Stations<ArId>,
}

impl ProfinetController {
    /// Creates a controller that starts to look for its devices at `start`.
    ///
    /// # Errors
    ///
    /// PROFINET does not allow something of it.
    pub fn new(
        config: ControllerConfig,
        devices: Vec<ArConfig>,
        start: Instant,
    ) -> Result<Self, ConfigError> {
        let mut controller = Controller::new(config)?;
        let ars = devices.into_iter().map(|device| controller.connect(device, start));
        let ars = ars.collect::<Result<Vec<_>, _>>()?;
        Ok(Self { controller, stations: Stations::new(ars) })
    }

    /// Returns the AR with a station.
    #[must_use]
    pub fn ar(&self, station: StationId) -> Option<&Ar> {
        self.controller.ar(self.stations.connection(station)?)
    }

    fn ar_mut(&mut self, station: StationId) -> Option<&mut Ar> {
        self.controller.ar_mut(self.stations.connection(station)?)
    }
}

machine_with_stations!(ProfinetController, controller);

impl ControllerBus for ProfinetController {
    fn stations(&self) -> u16 {
        self.stations.count()
    }

    fn byte_order(&self) -> Order {
        Order::BigEndian
    }

    fn set_output(&mut self, station: StationId, image: &Image) {
        if let Some(ar) = self.stations.connection(station) {
            self.controller.set_outputs(ar, split(image));
        }
    }

    fn input(&self, station: StationId) -> Option<Image> {
        joined(self.ar(station)?.inputs())
    }

    fn repeats(&self, station: StationId, image: &Image) -> bool {
        self.ar(station).is_some_and(|ar| are_parts_of(image, ar.inputs()))
    }

    fn poll_arrival(&mut self) -> Option<StationId> {
        let controller = &mut self.controller;
        core::iter::from_fn(|| controller.poll_received()).find_map(|connection| self.stations.of(connection))
    }

    fn disconnect(&mut self, now: Instant, station: StationId) {
        if let Some(ar) = self.ar_mut(station) {
            ar.disconnect(now);
        }
    }

    fn explain(&self, station: StationId, words: &mut dyn fmt::Write) -> fmt::Result {
        self.ar(station).map_or(Ok(()), |ar| ar.explain(words))
    }

    fn remark(&self, station: StationId, words: &mut dyn fmt::Write) -> fmt::Result {
        self.ar(station).map_or(Ok(()), |ar| ar.remark(words))
    }

    fn write_identity(&self, station: StationId, words: &mut dyn fmt::Write) -> fmt::Result {
        self.ar(station).map_or(Ok(()), |ar| ar.write_identity(words))
    }

    fn counters(&self, station: StationId) -> Counters {
        let own = self.ar(station).map(Ar::counters).unwrap_or_default();
        if station == StationId::FIRST { own + self.controller.counters() } else { own }
    }

    fn received(&self, station: StationId) -> u64 {
        let own = self.ar(station).map_or(0, Ar::received);
        if station == StationId::FIRST { own + self.controller.counters().received } else { own }
    }
}

impl Fieldbus for Device {
    fn byte_order(&self) -> Order {
        Order::BigEndian
    }

    fn set_output(&mut self, image: &Image) {
        self.set_inputs(split(image));
    }

    fn input(&self) -> Option<Image> {
        joined(self.outputs())
    }

    fn has_input(&self) -> bool {
        let mut all = self.outputs().peekable();
        all.peek().is_some() && all.all(|(_, data)| data.is_some())
    }

    fn disconnect(&mut self, now: Instant) {
        self.disconnect(now);
    }

    fn write_request(&self, words: &mut dyn fmt::Write) -> fmt::Result {
        self.write_request(words)
    }

    fn counters(&self) -> Counters {
        self.counters()
    }

    fn received(&self) -> u64 {
        self.received()
    }

    fn address_set(&mut self, now: Instant, done: bool) {
        self.address_set(now, done);
    }

    fn to_store(&self) -> ToStore<'_> {
        let (name, address, maintenance) = self.to_store();
        let address =
            address.map(|IpSuite { address, mask, gateway }| StationAddress { address, mask, gateway });
        // DCP allows ASCII only.
        ToStore { name: name.and_then(|name| core::str::from_utf8(name).ok()), address, maintenance }
    }

    fn stored(&mut self, now: Instant, done: bool) {
        self.stored(now, done);
    }
}

/// Writes the next part of the image with each call, and zeros behind its end.
fn split(image: &Image) -> impl FnMut(u16, u16, &mut [u8]) {
    let mut rest = &image[..];
    move |_, _, place| {
        let (part, later) = rest.split_at(place.len().min(rest.len()));
        rest = later;
        if let Some((data, beyond)) = place.split_at_mut_checked(part.len()) {
            data.copy_from_slice(part);
            beyond.fill(0);
        }
    }
}

/// Joins the image from these data, with zeros behind their end; `None` without data, or if one of them is bad.
fn joined<'a>(all: impl Iterator<Item = ((u16, u16), Option<&'a [u8]>)>) -> Option<Image> {
    let mut all = all.peekable();
    all.peek()?;
    let mut image = [0; IMAGE_LEN];
    let mut rest = &mut image[..];
    for (_, data) in all {
        let data = data?;
        let (part, later) = rest.split_at_mut(data.len().min(rest.len()));
        part.copy_from_slice(data.get(..part.len()).unwrap_or_default());
        rest = later;
    }
    Some(image)
}

/// Returns whether an image would be [`joined`] from these data.
fn are_parts_of<'a>(image: &Image, all: impl Iterator<Item = ((u16, u16), Option<&'a [u8]>)>) -> bool {
    let (mut rest, mut has_data) = (&image[..], false);
    for (_, data) in all {
        let Some(data) = data else { return false };
        let (part, later) = rest.split_at(data.len().min(rest.len()));
        if data.get(..part.len()) != Some(part) {
            return false;
        }
        (rest, has_data) = (later, true);
    }
    has_data && rest.iter().all(|byte| *byte == 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_image_is_split_over_submodules_and_joined_again() {
        let image: Image = core::array::from_fn(|index| index as u8);
        let mut parts = [vec![0xFF; 10], vec![0xFF; 240], vec![0xFF; 10]];
        let mut write = split(&image);
        parts.iter_mut().for_each(|part| write(0, 0, part));
        assert_eq!(parts[0], image[..10]);
        assert_eq!(parts[2], [250, 251, 252, 253, 254, 255, 0, 0, 0, 0]);
        let all = || parts.iter().map(|part| ((0, 0), Some(&part[..])));
        assert_eq!(joined(all()), Some(image));
        assert_eq!(joined(all().chain([((0, 0), None)])), None, "one of them is bad");
        assert_eq!(joined(core::iter::empty()), None);
        assert!(are_parts_of(&image, all()));
        assert!(!are_parts_of(&image, all().chain([((0, 0), None)])), "one of them is bad");
        assert!(!are_parts_of(&image, core::iter::empty()) && !are_parts_of(&image, all().take(1)));
        for byte in 0..IMAGE_LEN {
            let mut other = image;
            other[byte] ^= 0x10;
            assert!(!are_parts_of(&other, all()), "byte {byte}");
        }
        let short = joined(all().take(1)).unwrap();
        assert!(are_parts_of(&short, all().take(1)));
        assert_eq!((&short[..10], &short[10..]), (&image[..10], &[0; IMAGE_LEN - 10][..]));
    }
}
