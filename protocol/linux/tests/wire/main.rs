//! Machines on real sockets, in network namespaces that the tests create and that disappear with them.
//!
//! The tests need root or user namespaces, and fail without. No test asserts a time, because a shared host stalls.

#![expect(clippy::unwrap_used, clippy::expect_used, reason = "a test fails by panicking")]

mod ethernet_ip;
mod machines;
mod streams;

use std::net::{Ipv4Addr, SocketAddrV4};
use std::ops::ControlFlow;
use std::time::Duration;

use machine::{Instant, Machine, PortRequest};
use machines::{Cable, Echo, Station};
use protocol::fieldbus::LinkEvent;
use protocol_linux::namespace::NetworkNamespace;
use protocol_linux::{
    CyclicThread, Driver, DriverError, Finished, Interface, Notifier, OpenPort, Outbox, Task, clock, veth,
};

#[global_allocator]
static ALLOCATOR: protocol_linux::allocation::AllocationCounter =
    protocol_linux::allocation::AllocationCounter;

const MASK: Ipv4Addr = Ipv4Addr::new(255, 255, 255, 0);
const ADDRESSES: [Ipv4Addr; 2] = [Ipv4Addr::new(10, 0, 0, 1), Ipv4Addr::new(10, 0, 0, 2)];

struct Bed {
    ends: [(NetworkNamespace, &'static str); 2],
}

impl Bed {
    fn lay() -> Self {
        let new = || {
            NetworkNamespace::new()
                .expect("this test makes network namespaces: run it as root, or under `unshare -Ur`")
        };
        let ends = [(new(), "left0"), (new(), "right0")];
        veth::connect(&ends[0].0, ends[0].1, &ends[1].0, ends[1].1).unwrap();
        for ((namespace, name), address) in ends.iter().zip(ADDRESSES) {
            let prepare = || {
                let interface = Interface::open(name).unwrap();
                assert_eq!(interface.address(), None);
                interface.set_address(address, MASK).unwrap();
                interface.set_address(address, MASK).unwrap();
                interface.set_up().unwrap();
                assert_eq!((interface.address(), interface.mask()), (Some(address), Some(MASK)));
            };
            namespace.run(prepare).unwrap();
        }
        Self { ends }
    }

    fn start<M: Machine<Event = LinkEvent> + Send + 'static>(
        &self,
        end: usize,
        machine: impl FnOnce(&Interface) -> M + Send,
    ) -> CyclicThread<M, Watch> {
        let (namespace, name) = &self.ends[end];
        namespace
            .run(|| {
                let interface = Interface::open(name).unwrap();
                let machine = machine(&interface);
                let (waker, reader) = (Notifier::new().unwrap(), Notifier::new().unwrap());
                let driver = Driver::new(machine, interface, waker.clone()).unwrap();
                CyclicThread::start(driver, Watch::default(), waker, reader).unwrap()
            })
            .unwrap()
    }
}

/// Counts events of the link, and ends on request.
#[derive(Default, Debug)]
struct Watch {
    ups: u64,
    downs: u64,
    allocations_at_up: u64,
}

impl<M: Machine<Event = LinkEvent>> Task<M> for Watch {
    type Command = ();
    type News = LinkEvent;

    fn event(
        &mut self,
        _: Instant,
        _: &mut M,
        event: LinkEvent,
        news: &mut Outbox<LinkEvent>,
    ) -> ControlFlow<()> {
        match event {
            LinkEvent::Up => self.ups += 1,
            _ => self.downs += 1,
        }
        self.allocations_at_up = protocol_linux::allocation::count();
        news.tell(event);
        ControlFlow::Continue(())
    }
}

fn stop<M: Machine<Event = LinkEvent> + Send + 'static>(
    mut thread: CyclicThread<M, Watch>,
) -> Finished<M, Watch> {
    thread.send(()).unwrap();
    let finished = thread.join().unwrap();
    finished.result.as_ref().unwrap();
    finished
}

/// Runs two stations for a second and compares what one sent with what the other received.
fn exchange(cable: Cable) {
    let bed = Bed::lay();
    let station = |peer: usize| {
        move |interface: &Interface| {
            let peer = SocketAddrV4::new(ADDRESSES[peer], machines::UDP_PORT);
            Station::new(cable, interface.mac(), peer, clock::now())
        }
    };
    let (left, right) = (bed.start(0, station(1)), bed.start(1, station(0)));
    if let Some(warning) = left.warning() {
        eprintln!("{warning}");
    }
    std::thread::sleep(Duration::from_secs(1));
    let (left, right) = (stop(left), stop(right));
    for (sender, receiver) in [(&left, &right), (&right, &left)] {
        let sent = sender.driver.machine().counters().sent;
        let received = receiver.driver.machine().counters().received;
        assert!(sent > 100 && received * 10 >= sent * 9, "{received} of {sent} images arrived");
        assert_eq!(receiver.task.ups, 1);
        assert_eq!(receiver.driver.machine().counters().malformed, 0);
        assert_eq!(sender.driver.statistics().send_errors, 0);
        assert_eq!(receiver.driver.statistics().allocations, Some(0), "the cyclic thread allocated");
        let lateness = &receiver.driver.statistics().lateness;
        eprintln!(
            "{cable:?}: sent {sent}, received {received}; woke late p50 {:?} p99 {:?} max {:?}",
            lateness.quantile(0.5),
            lateness.quantile(0.99),
            lateness.max()
        );
    }
}

#[test]
fn two_stations_exchange_images_over_raw_ethernet() {
    exchange(Cable::Untagged);
}

#[test]
fn two_stations_exchange_images_in_priority_tagged_frames() {
    exchange(Cable::PriorityTagged);
}

#[test]
fn two_stations_exchange_images_over_udp() {
    exchange(Cable::Udp);
}

#[test]
fn frames_of_another_vlan_are_discarded() {
    let bed = Bed::lay();
    let station = |cable| {
        move |interface: &Interface| {
            let nobody = SocketAddrV4::new(Ipv4Addr::UNSPECIFIED, 0);
            Station::new(cable, interface.mac(), nobody, clock::now())
        }
    };
    let (left, right) = (bed.start(0, station(Cable::Vlan(5))), bed.start(1, station(Cable::Untagged)));
    std::thread::sleep(Duration::from_millis(300));
    let (left, right) = (stop(left), stop(right));
    assert!(left.driver.machine().counters().sent > 10);
    assert_eq!(right.driver.machine().counters().received, 0);
    assert!(left.driver.machine().counters().received > 10);
}

#[test]
fn nearly_all_cyclic_requests_are_answered() {
    let bed = Bed::lay();
    let (left, right) = (bed.start(0, Echo::asks), bed.start(1, Echo::answers));
    std::thread::sleep(Duration::from_secs(1));
    let (left, _) = (stop(left), stop(right));
    let round_trip = &left.driver.machine().round_trip;
    assert!(round_trip.runs() * 10 >= left.driver.machine().asked * 9);
    eprintln!(
        "round trip of {} frames: p50 {:?} p99 {:?} max {:?}",
        round_trip.runs(),
        round_trip.quantile(0.5),
        round_trip.quantile(0.99),
        round_trip.max()
    );
}

#[test]
fn a_driver_ends_with_an_error_when_its_interface_is_removed() {
    let bed = Bed::lay();
    let station = |interface: &Interface| {
        let nobody = SocketAddrV4::new(Ipv4Addr::UNSPECIFIED, 0);
        Station::new(Cable::Untagged, interface.mac(), nobody, clock::now())
    };
    let left = bed.start(0, station);
    let Bed { ends: [keep, gone] } = bed;
    // A veth end is removed with its namespace, and takes the other end with it.
    drop(gone);
    let finished = left.join().unwrap();
    assert!(matches!(finished.result, Err(DriverError::InterfaceGone { .. })), "{:?}", finished.result);
    drop(keep);
}

#[test]
fn the_error_for_a_taken_udp_port_names_the_port() {
    let bed = Bed::lay();
    let (namespace, name) = &bed.ends[0];
    let message = namespace
        .run(|| {
            let interface = Interface::open(name).unwrap();
            let _first = OpenPort::open(&interface, PortRequest::Udp(4000)).unwrap();
            OpenPort::open(&interface, PortRequest::Udp(4000)).unwrap_err().to_string()
        })
        .unwrap();
    assert!(message.contains("UDP port 4000") && message.contains(" at 0.0.0.0:4000;"), "{message}");
}
