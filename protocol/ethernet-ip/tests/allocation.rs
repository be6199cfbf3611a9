//! Nothing is allocated in the cyclic paths of EtherNet/IP: counted by the allocator itself.

use std::net::{Ipv4Addr, SocketAddrV4};

use ethernet_ip::{Adapter, AdapterConfig, ConnectionConfig, Scanner, ScannerConfig};
use machine::LinkEvent;
use machine::wire::FRAME_CAPACITY;
use machine::{Duration, Instant, Machine, Port, Source, StreamChange, StreamId, StreamRequest};
use protocol_linux::allocation::{self, AllocationCounter};

const PLC: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 1);
const ROBOT: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 2);

#[path = "ethernet_ip/samples.rs"]
mod samples;

use samples::{CONSUMED, DEVICE};

#[global_allocator]
static ALLOCATOR: AllocationCounter = AllocationCounter;

/// Hands frames from one machine to the other, at once. Returns whether there were any.
fn hand_over<A: Machine, B: Machine>(
    now: Instant,
    from: &mut A,
    to: &mut B,
    source: Ipv4Addr,
    buf: &mut [u8],
) -> bool {
    let mut any = false;
    while let Some(transmit) = from.poll_transmit(now, buf) {
        any = true;
        let peer = match transmit.port {
            Port::Udp(port) => Some(SocketAddrV4::new(source, port)),
            _ => None,
        };
        let port = transmit.to.map_or(transmit.port, |to| Port::Udp(to.port()));
        to.handle_frame(now, Source { port, peer }, &buf[..transmit.len]);
    }
    any
}

#[test]
fn ten_thousand_cycles_and_a_request_in_each_allocate_nothing() {
    // Longer than a screen, because one counter of allocations watches the whole exchange.
    let mut scanner = Scanner::new(ScannerConfig { vendor: 0xFFFF, serial_number: 1, first_id: 1 });
    let config = ConnectionConfig::exclusive_owner(ROBOT, &DEVICE, 1_000);
    let id = scanner.connect(config, Instant::from_millis(1)).unwrap();
    let mut adapter = Adapter::new(AdapterConfig {
        description: &DEVICE,
        serial_number: 1,
        address: ROBOT,
        mask: Ipv4Addr::new(255, 255, 255, 0),
        gateway: Ipv4Addr::UNSPECIFIED,
        mac: [2, 0, 0, 0, 0, 2],
        first_id: 1,
        originators: machine::Allowed::default(),
    });
    let mut buf = vec![0; FRAME_CAPACITY];
    let (stream, viewer) = (StreamId(1), StreamId(2));
    let mut now = Instant::from_millis(1);
    adapter.handle_stream(now, viewer, StreamChange::Accepted(SocketAddrV4::new(PLC, 40_000)));
    let list_identity = {
        let mut message = [0; 24];
        message[0] = 0x63;
        message
    };
    let mut cycle = |scanner: &mut Scanner, adapter: &mut Adapter, now: Instant| {
        scanner.handle_timeout(now);
        adapter.handle_timeout(now);
        adapter.handle_frame(now, Source { port: Port::Stream(viewer), peer: None }, &list_identity);
        scanner.connection_mut(id).unwrap().output_mut().fill(now.as_nanos() as u8);
        loop {
            let mut any = hand_over(now, scanner, adapter, PLC, &mut buf);
            while let Some(request) = scanner.poll_stream() {
                if let StreamRequest::Connect { attempt, .. } = request {
                    adapter.handle_stream(
                        now,
                        stream,
                        StreamChange::Accepted(SocketAddrV4::new(PLC, 50_000)),
                    );
                    scanner.handle_stream(now, stream, StreamChange::Connected(attempt));
                    any = true;
                }
            }
            if !any & !hand_over(now, adapter, scanner, ROBOT, &mut buf) {
                break;
            }
        }
    };
    for _ in 0..100 {
        cycle(&mut scanner, &mut adapter, now);
        now += Duration::from_millis(1);
    }
    assert!(matches!(adapter.poll_event(), Some(LinkEvent::Owner(_))));
    assert_eq!(
        (scanner.poll_event(), adapter.poll_event()),
        (Some((id, LinkEvent::Up)), Some(LinkEvent::Up))
    );
    let received = adapter.counters().received;
    assert!(allocation::arm(), "the counter is installed");
    for _ in 0..10_000 {
        cycle(&mut scanner, &mut adapter, now);
        now += Duration::from_millis(1);
    }
    assert_eq!(allocation::count(), 0, "allocations in 10 000 cycles");
    assert_eq!(adapter.counters().received - received, 10_000);
    assert!(scanner.connection(id).unwrap().input().is_some() && adapter.consumed(CONSUMED).is_some());
    let probe = vec![0_u8; usize::from(now.as_nanos() > 0)];
    assert!(allocation::count() > 0 && probe.first().copied().unwrap() == 0, "the counter counts");
}
