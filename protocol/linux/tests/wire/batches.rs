//! How a driver takes the frames that wait at several ports, and the buffers in which they wait.

use std::net::{SocketAddrV4, UdpSocket};
use std::ops::ControlFlow;

use machine::{Instant, Machine, Port, PortRequest, Source, Transmit};
use protocol_linux::{Driver, Interface, Notifier, OpenPort, Owner, Statistics};
use socket2::SockRef;

use super::test_network::{ADDRESSES, TestNetwork};

/// Frames that wait at each port when the driver starts: a batch of one port.
const WAITING: usize = 64;

const PORTS: [u16; 2] = [4_001, 4_002];

/// What the driver handed to the machine.
#[derive(Clone, Copy, PartialEq, Debug)]
enum Call {
    Frame(Port),
    Timeout,
}

/// A machine that has something to do at once after each frame.
#[derive(Debug, Default)]
struct Busy {
    due: Option<Instant>,
    calls: Vec<Call>,
}

impl Busy {
    fn frames(&self) -> impl Iterator<Item = Port> {
        self.calls.iter().filter_map(|call| if let Call::Frame(port) = call { Some(*port) } else { None })
    }
}

impl Machine for Busy {
    type Event = ();

    fn ports(&self) -> &[PortRequest] {
        &[PortRequest::Udp(PORTS[0]), PortRequest::Udp(PORTS[1])]
    }

    fn handle_frame(&mut self, now: Instant, from: Source, _: &[u8]) {
        self.due = Some(now);
        self.calls.push(Call::Frame(from.port));
    }

    fn handle_timeout(&mut self, _: Instant) {
        self.due = None;
        self.calls.push(Call::Timeout);
    }

    fn poll_transmit(&mut self, _: Instant, _: &mut [u8]) -> Option<Transmit> {
        None
    }

    fn poll_event(&mut self) -> Option<()> {
        None
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.due
    }
}

/// Ends once the machine has all frames.
struct UntilAll;

impl Owner<Busy> for UntilAll {
    fn wake(&mut self, _: Instant, machine: &mut Busy, _: &Statistics) -> ControlFlow<()> {
        if machine.frames().count() < PORTS.len() * WAITING {
            ControlFlow::Continue(())
        } else {
            ControlFlow::Break(())
        }
    }

    fn event(&mut self, _: Instant, _: &mut Busy, (): ()) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }
}

/// Returns what a machine was called for whose frames all wait when its driver starts.
fn calls() -> Vec<Call> {
    let network = TestNetwork::new();
    let client = network.run(1, |_: &Interface| UdpSocket::bind((ADDRESSES[1], 0)).unwrap());
    network.run(0, |interface| {
        let mut driver = Driver::new(Busy::default(), interface.clone(), Notifier::new().unwrap()).unwrap();
        for _ in 0..WAITING {
            for port in PORTS {
                client.send_to(b"frame", SocketAddrV4::new(ADDRESSES[0], port)).unwrap();
            }
        }
        driver.run(&mut UntilAll).unwrap();
        driver.into_machine().calls
    })
}

pub(crate) fn a_deadline_that_passes_while_frames_are_taken_is_met_before_the_rest_of_them() {
    let calls = calls();
    let in_a_row = calls.split(|call| *call == Call::Timeout).map(<[_]>::len).max();
    assert!(in_a_row <= Some(2), "{in_a_row:?} frames in a row of {}", calls.len());
}

pub(crate) fn a_port_whose_frames_are_left_for_a_deadline_does_not_keep_the_others_waiting() {
    let busy = Busy { due: None, calls: calls() };
    for port in PORTS {
        let first = busy.frames().position(|from| from == Port::Udp(port));
        assert!(
            first.is_some_and(|first| first < WAITING),
            "port {port}: its first frame is number {first:?}"
        );
    }
}

pub(crate) fn frames_wait_in_as_large_a_buffer_as_datagrams() {
    let network = TestNetwork::new();
    let [raw, udp] = network.run(0, |interface| {
        let raw = PortRequest::Ethernet { ether_type: 0x8892, groups: &[] };
        [raw, PortRequest::Udp(PORTS[0])].map(|request| {
            let port = OpenPort::open(interface, request).unwrap();
            SockRef::from(&port).recv_buffer_size().unwrap()
        })
    });
    assert_eq!(raw, udp);
}
