//! Nothing is allocated while data are exchanged: counted by the allocator itself.

use std::net::Ipv4Addr;

use driven_device::{DriveEvent, DrivenBus};
use emulated_device::{DeviceEvent, EmulatedDevice};
use machine::ethernet::Mac;
use machine::{
    Instant, LinkEvent, Machine, Port, PortRequest, Source, StreamChange, StreamId, StreamRequest, Transmit,
};
use protocol_linux::allocation::{self, AllocationCounter};
use virtual_time::{Event, Pair, Side};

use crate::cell::{devices, drive_config, driven, emulated, pair_config};

#[global_allocator]
static ALLOCATOR: AllocationCounter = AllocationCounter;

/// Driven device with the number of allocations that its calls made.
struct Counted {
    device: DrivenBus,
    allocations: u64,
}

impl Counted {
    fn call<T>(&mut self, call: impl FnOnce(&mut DrivenBus) -> T) -> T {
        let before = allocation::count();
        let result = call(&mut self.device);
        self.allocations += allocation::count() - before;
        result
    }
}

impl Machine for Counted {
    type Event = (usize, DriveEvent);

    fn ports(&self) -> &[PortRequest] {
        self.device.ports()
    }

    fn dscp(&self, port: Port) -> u8 {
        self.device.dscp(port)
    }

    fn group(&self, port: Port, index: usize) -> Option<Ipv4Addr> {
        self.device.group(port, index)
    }

    fn neighbour(&self, address: Ipv4Addr) -> Option<Mac> {
        Machine::neighbour(&self.device, address)
    }

    fn handle_wrong_neighbour(&mut self, now: Instant, address: Ipv4Addr, found: Mac) {
        self.call(|device| device.handle_wrong_neighbour(now, address, found));
    }

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        self.call(|device| device.handle_frame(now, from, frame));
    }

    fn handle_broadcast(&mut self, now: Instant, from: Source, frame: &[u8]) {
        self.call(|device| device.handle_broadcast(now, from, frame));
    }

    fn handle_stream(&mut self, now: Instant, stream: StreamId, change: StreamChange) {
        self.call(|device| device.handle_stream(now, stream, change));
    }

    fn poll_stream(&mut self) -> Option<StreamRequest> {
        self.call(Machine::poll_stream)
    }

    fn handle_timeout(&mut self, now: Instant) {
        self.call(|device| device.handle_timeout(now));
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        self.call(|device| device.poll_transmit(now, buf))
    }

    fn poll_event(&mut self) -> Option<(usize, DriveEvent)> {
        self.call(Machine::poll_event)
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.device.poll_timeout()
    }
}

fn run_to(pair: &mut Pair<Counted, EmulatedDevice>, millis: u64) {
    while let Some(event) = pair.next_event(Instant::from_millis(millis)) {
        if let Event::B(DeviceEvent::Link(LinkEvent::SetAddress { address, mask, .. })) = event {
            pair.set_address(Side::B, Some(address));
            pair.command_b(|device, now| device.address_set(now, Some(address), mask));
        }
    }
}

#[test]
fn ten_seconds_of_cyclic_data_and_of_scripted_outputs_allocate_nothing() {
    let inputs = ["place = \"101\"", "place = \"1.1\"", "place = \"0x6000:11\""];
    // The whole of an assembly is bytes, which no script sets.
    let outputs = [None, Some("2.1/2 analog outputs"), Some("Outputs/Output")];
    for ((chosen, place), output) in devices().iter().zip(inputs).zip(outputs) {
        let device_script =
            format!("[[inputs]]\n{place}\ntype = \"uint8\"\ncounter = {{ seconds = 0.001 }}\n");
        let ramp = "ramp = { from = 0, to = 1000, seconds = 1 }";
        let script =
            output.map_or_else(String::new, |name| format!("[[outputs]]\nname = \"{name}\"\n{ramp}\n"));
        let device = driven(chosen, &script, &drive_config());
        let emulated = emulated(chosen.device.clone(), &device_script);
        let mut pair = Pair::new(Counted { device, allocations: 0 }, emulated, pair_config());
        run_to(&mut pair, 5_000);
        let bus = pair.a().device.bus();
        assert!(pair.a().device.devices()[0].is_up(), "{bus}");
        let before = pair.a().device.devices()[0].counters().received;
        assert!(allocation::arm(), "the counter is installed");
        pair.command_a(|counted, _| counted.allocations = 0);
        run_to(&mut pair, 15_000);
        assert!(pair.a().device.devices()[0].counters().received - before > 900, "{bus}");
        assert_eq!(pair.a().allocations, 0, "{bus}");
        allocation::disarm();
    }
}
