//! The stacks' endpoints as [`Fieldbus`](crate::fieldbus::Fieldbus) and
//! [`ControllerBus`](crate::fieldbus::ControllerBus): how each bus carries the image.

mod assemblies;
mod endpoint;
mod process_data;
mod stations;
mod submodules;

pub use assemblies::EthernetIpScanner;
pub use endpoint::Endpoint;
pub use process_data::EthercatSubDevice;
pub use stations::Stations;
pub use submodules::ProfinetController;

/// Implements [`machine::Machine`] for a stack with a connection to each of its stations: the events name the station.
macro_rules! machine_with_stations {
    ($endpoint:ident, $machine:ident) => {
        impl machine::Machine for $endpoint {
            type Event = (crate::fieldbus::StationId, machine::LinkEvent);

            machine::forward_ports!($machine);

            fn handle_frame(&mut self, now: machine::Instant, from: machine::Source, frame: &[u8]) {
                self.$machine.handle_frame(now, from, frame);
            }

            fn handle_broadcast(&mut self, now: machine::Instant, from: machine::Source, frame: &[u8]) {
                self.$machine.handle_broadcast(now, from, frame);
            }

            fn handle_stream(
                &mut self,
                now: machine::Instant,
                stream: machine::StreamId,
                change: machine::StreamChange,
            ) {
                self.$machine.handle_stream(now, stream, change);
            }

            fn handle_wrong_neighbour(
                &mut self,
                now: machine::Instant,
                address: core::net::Ipv4Addr,
                found: machine::ethernet::Mac,
            ) {
                self.$machine.handle_wrong_neighbour(now, address, found);
            }

            fn handle_timeout(&mut self, now: machine::Instant) {
                self.$machine.handle_timeout(now);
            }

            fn pending(&self, now: machine::Instant) -> machine::Pending {
                self.$machine.pending(now)
            }

            fn poll_transmit(&mut self, now: machine::Instant, buf: &mut [u8]) -> Option<machine::Transmit> {
                self.$machine.poll_transmit(now, buf)
            }

            fn poll_event(&mut self) -> Option<Self::Event> {
                let (connection, event) = self.$machine.poll_event()?;
                Some((self.stations.of(connection)?, event))
            }

            fn poll_timeout(&self) -> Option<machine::Instant> {
                self.$machine.poll_timeout()
            }
        }
    };
}
use machine_with_stations;
