//! Nothing is allocated while several devices are in OP: counted by the allocator itself.

#![expect(clippy::indexing_slicing, reason = "a test fails by a panic")]

use ethercat_maindevice::{Config, ExpectedDevice, MainDevice, SubDeviceId};
use ethercat_subdevice::description::{DataType, Description, Pdo, PdoEntry};
use ethercat_subdevice::{DeviceConfig, Segment};
use machine::ethernet::Mac;
use machine::{Duration, Instant, LinkEvent, Machine, Port, Source};
use protocol_linux::allocation::{self, AllocationCounter};

#[global_allocator]
static ALLOCATOR: AllocationCounter = AllocationCounter;

const DEVICES: usize = 5;
const FROM: Source = Source { port: Port::Ethernet, peer: None };

const fn numbers(index: u16) -> PdoEntry {
    PdoEntry { index, subindex: 1, bits: 64, data_type: DataType::Unsigned64, name: "Number" }
}

static DEVICE: Description = Description {
    vendor_id: 0x0000_0F00,
    product_code: 7,
    revision: 3,
    order_code: "NUMBERS",
    name: "Eight bytes each way",
    group: "Test devices",
    device_type: 0,
    hardware_version: "1",
    software_version: "1",
    outputs: &[Pdo { index: 0x1600, name: "Outputs", entries: &[numbers(0x7000)] }],
    inputs: &[Pdo { index: 0x1A00, name: "Inputs", entries: &[numbers(0x6000)] }],
    mailbox: None,
    objects: &[],
    optional_outputs: &[],
    optional_inputs: &[],
    clock_modes: &[],
    numbers_names: true,
};

/// Runs for 1 ms: passes frames both ways until there are none. Returns how many devices came up.
fn cycle(main: &mut MainDevice, segment: &mut Segment, now: Instant, buf: &mut [u8]) -> usize {
    main.handle_timeout(now);
    while let Some(sent) = main.poll_transmit(now, buf) {
        segment.handle_frame(now, FROM, &buf[..sent.len]);
        segment.handle_timeout(now);
        while let Some(reply) = segment.poll_transmit(now, buf) {
            main.handle_frame(now, FROM, &buf[..reply.len]);
        }
    }
    while segment.poll_event().is_some() {}
    let mut up = 0;
    while let Some((_, event)) = main.poll_event() {
        up += usize::from(event == LinkEvent::Up);
    }
    up
}

#[test]
fn ten_thousand_cycles_of_five_devices_allocate_nothing() {
    let device = ExpectedDevice {
        vendor: DEVICE.vendor_id,
        product: DEVICE.product_code,
        revision: None,
        output_bytes: 8,
        input_bytes: 8,
    };
    let cycle_time = Duration::from_millis(1);
    let config = Config {
        mac: Mac([2, 0, 0, 0, 0, 1]),
        devices: vec![device; DEVICES],
        cycle: cycle_time,
        watchdog: cycle_time * 20,
    };
    let mut main = MainDevice::new(config, Instant::ZERO).unwrap();
    let mut segment = Segment::new();
    for _ in 0..DEVICES {
        segment.add(&DeviceConfig::new(&DEVICE));
    }
    let (mut now, mut up, mut buf) = (Instant::ZERO, 0, vec![0; 1514]);
    while up < DEVICES {
        up += cycle(&mut main, &mut segment, now, &mut buf);
        now += cycle_time;
        assert!(now < Instant::from_millis(60_000), "{up} are up");
    }
    // Every place for a frame on its way is used once.
    for _ in 0..300 {
        cycle(&mut main, &mut segment, now, &mut buf);
        now += cycle_time;
    }
    let before = main.counters(SubDeviceId(4)).received;
    assert!(allocation::arm(), "the counter is installed");
    for _ in 0..10_000 {
        main.outputs_mut(SubDeviceId(4)).fill(7);
        cycle(&mut main, &mut segment, now, &mut buf);
        now += cycle_time;
    }
    assert_eq!(allocation::count(), 0, "allocations in 10 000 cycles");
    assert_eq!(main.counters(SubDeviceId(4)).received - before, 10_000);
    let probe = vec![0_u8; usize::from(now.as_nanos() > 0)];
    assert!(allocation::count() > 0 && probe[0] == 0, "the counter counts");
}
