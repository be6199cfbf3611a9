//! The links to the stations: what the buses report, and the images that they are given.

use machine::Instant;
use protocol::bus_polls::BusPolls;
use protocol::fieldbus::{ControllerBus, LinkEvent, StationId};

use super::PlcNode;
use crate::program::PlcProgram;
use crate::station::RobotImage;
use crate::{FailureCause, PlcEvent};

impl<B: ControllerBus, P: PlcProgram> PlcNode<B, P> {
    /// Handles what a bus has received and reported.
    pub(super) fn after_bus(&mut self, now: Instant, bus: usize) {
        while let Some(id) = self.buses.get_mut(bus).and_then(ControllerBus::poll_arrival) {
            let Some(index) = self.index_of(bus, id) else { continue };
            let received = self.received_of(index);
            if let Some(station) = self.stations.get_mut(index) {
                station.life.note_arrival(now, received);
                station.note_stamp(now, || self.buses.get(bus)?.input(id));
            }
        }
        self.note_pending(now, bus);
        self.drain_bus(bus);
    }

    /// Returns the number of frames received from a station.
    pub(super) fn received_of(&self, station: usize) -> u64 {
        self.bus_of(station).map_or(0, |(bus, id)| bus.received(id))
    }

    /// Takes over the image of each station.
    pub(super) fn read_inputs(&mut self, now: Instant) {
        for index in 0..self.stations.len() {
            let leads = self.program.leads();
            let received = self.received_of(index);
            let at = self.places.get(index).copied();
            let at = at.and_then(|(bus, id)| Some((self.buses.get(bus)?, id)));
            let Some(station) = self.stations.get_mut(index) else { return };
            let is_repeated =
                !leads && at.is_some_and(|(bus, id)| station.has_again(|image| bus.repeats(id, image)));
            let image = at.filter(|_| !is_repeated).and_then(|(bus, id)| bus.input(id));
            if leads {
                station.keep_received(image);
            }
            let input = if is_repeated { RobotImage::Repeated } else { RobotImage::Read(image.as_ref()) };
            if let Some(cause) = station.read_inputs(now, input, received, &mut self.events) {
                self.fail(Some(index), cause);
            }
            if let Some(cause) = self.stations.get(index).and_then(|station| station.trouble(received)) {
                self.fail(Some(index), cause);
            }
        }
    }

    fn index_of(&self, bus: usize, id: StationId) -> Option<usize> {
        self.on_bus.get(bus)?.get(usize::from(id.0)).copied().filter(|index| *index < self.stations.len())
    }

    /// Passes on the events of a bus. A lost connection fails a run at once, not with the next scan.
    pub(super) fn drain_bus(&mut self, bus: usize) {
        if !self.take_may_report(bus) {
            return;
        }
        while let Some((id, event)) = self.buses.get_mut(bus).and_then(B::poll_event) {
            let Some(index) = self.index_of(bus, id) else { continue };
            self.events.push(index, PlcEvent::Link(event));
            match event {
                LinkEvent::Up => {
                    if let Some(station) = self.stations.get_mut(index) {
                        station.connect();
                    }
                }
                LinkEvent::Down(down) => {
                    if let Some(station) = self.stations.get_mut(index) {
                        station.note_down(down);
                    }
                    self.fail(Some(index), FailureCause::ConnectionLost(down));
                    self.disarm(index);
                }
                LinkEvent::SetAddress { .. }
                | LinkEvent::Store
                | LinkEvent::Foreign(_)
                | LinkEvent::Owner(_)
                | LinkEvent::Conflict(_)
                | LinkEvent::Health => {}
            }
        }
    }

    /// Removes every command from a station's image, because the bus repeats its last image on the next connection.
    pub(super) fn disarm(&mut self, index: usize) {
        let Some(station) = self.stations.get_mut(index) else { return };
        station.disarm();
        self.write_output(index);
        if self.stations.iter().all(|station| !station.is_connected()) {
            self.scan.drop_outputs();
        }
    }

    fn write_output(&mut self, index: usize) {
        let Some((bus, id)) = self.places.get(index).copied() else { return };
        if let Some(polled) = self.polled.get_mut(bus) {
            *polled = BusPolls::called();
        }
        if let (Some(bus), Some(station)) = (self.buses.get_mut(bus), self.stations.get(index)) {
            bus.set_output(id, station.outputs());
        }
    }

    /// Writes outputs that were due before this instant. No bus was called since, so that nothing has left without them.
    pub(super) fn write_overdue(&mut self, now: Instant) {
        if self.scan.is_overdue(now) {
            self.write_outputs(now);
        }
    }

    pub(super) fn write_outputs(&mut self, now: Instant) {
        if self.scan.take_outputs(now) {
            (0..self.stations.len()).for_each(|station| self.write_output(station));
        }
    }
}
