//! The stacks' endpoints as [`Fieldbus`](crate::fieldbus::Fieldbus): how each bus carries the image.

mod assemblies;
mod endpoint;
mod process_data;
mod submodules;

pub use assemblies::EthernetIpScanner;
pub use endpoint::Endpoint;
pub use process_data::EthercatSubDevice;
pub use submodules::ProfinetController;

/// Implements [`machine::Machine`] for an endpoint with one connection: all methods except the one for events.
macro_rules! machine_with_one_connection {
    ($endpoint:ident, $machine:ident) => {
        impl machine::Machine for $endpoint {
            type Event = machine::LinkEvent;

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

            fn poll_transmit(&mut self, now: machine::Instant, buf: &mut [u8]) -> Option<machine::Transmit> {
                self.$machine.poll_transmit(now, buf)
            }

            fn poll_event(&mut self) -> Option<machine::LinkEvent> {
                self.$machine.poll_event().map(|(_, event)| event)
            }

            fn poll_timeout(&self) -> Option<machine::Instant> {
                self.$machine.poll_timeout()
            }
        }
    };
}
use machine_with_one_connection;
