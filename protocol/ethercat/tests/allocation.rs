//! Nothing is allocated while frames pass devices in OP: counted by the allocator itself.

#![expect(clippy::unwrap_used, clippy::expect_used, reason = "a test fails by a panic")]
#![expect(unreachable_pub, reason = "a test program has no users")]

use ethercat_subdevice::{DeviceConfig, DeviceId, Event, Segment};
use machine::{Duration, Instant, Machine, Port, Source};
use protocol_linux::allocation::{self, AllocationCounter};

#[path = "ethercat/devices.rs"]
#[expect(dead_code, reason = "one of its devices is enough here")]
mod devices;
#[path = "ethercat/raw_main_device.rs"]
#[expect(dead_code, reason = "it does more than bring a device to OP")]
mod raw_main_device;

use devices::BRIDGE;
use raw_main_device::{LRW, RawMainDevice, frame};

#[global_allocator]
static ALLOCATOR: AllocationCounter = AllocationCounter;

const BRIDGE_ID: DeviceId = DeviceId(0);

/// Returns a bridge in OP, its 512 bytes mapped to logical address 0, with a SYNC0 signal each millisecond.
fn operating() -> RawMainDevice {
    let mut segment = Segment::new();
    segment.add(&DeviceConfig::new(&BRIDGE));
    let mut main_device = RawMainDevice::start(segment);
    main_device.write(0x0600, &[0, 0, 0, 0, 0, 1, 0, 7, 0x00, 0x11, 0, 2, 1, 0, 0, 0]);
    main_device.write(0x0610, &[0, 1, 0, 0, 0, 1, 0, 7, 0x00, 0x14, 0, 1, 1, 0, 0, 0]);
    main_device.write(0x0990, &1_000_000_u64.to_le_bytes());
    main_device.write(0x09A0, &1_000_000_u32.to_le_bytes());
    main_device.write(0x0981, &[0x03]);
    main_device.operate();
    main_device
}

#[test]
fn ten_thousand_cycles_with_process_data_and_sync_signals_allocate_nothing() {
    let RawMainDevice { mut segment, mut now, .. } = operating();
    let request = frame(LRW, 0, &[0x5A; 512]);
    let mut reply = [0; 4096];
    let (mut signals, mut counted) = (0, 0_u32);
    let mut cycle = |segment: &mut Segment, now: Instant| {
        segment.handle_timeout(now);
        segment.handle_frame(now, Source { port: Port::Ethernet, peer: None }, &request);
        let sent = segment.poll_transmit(now, &mut reply).expect("a reply");
        counted += u32::from(reply[sent.len - 2]);
        while let Some((_, event)) = segment.poll_event() {
            signals += u32::from(matches!(event, Event::Sync0 { .. }));
        }
        segment.set_inputs(BRIDGE_ID, &reply[26..282]).unwrap();
        assert!(segment.poll_timeout().is_some());
    };
    for _ in 0..10 {
        cycle(&mut segment, now);
        now += Duration::from_millis(1);
    }
    assert!(allocation::arm(), "the counter is installed");
    for _ in 0..10_000 {
        cycle(&mut segment, now);
        now += Duration::from_millis(1);
    }
    assert_eq!(allocation::count(), 0, "allocations in 10 000 cycles");
    assert_eq!((signals, counted), (10_009, 3 * 10_010));
    assert_eq!(segment.outputs(BRIDGE_ID), Some(&[0x5A; 256][..]));
    let probe = vec![0_u8; usize::from(now.as_nanos() > 0)];
    assert!(allocation::count() > 0 && probe.first().copied().unwrap() == 0, "the counter counts");
}
