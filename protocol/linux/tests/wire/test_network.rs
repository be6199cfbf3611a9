//! Two networks with a cable between them, and machines that run at its ends.

use std::net::{Ipv4Addr, UdpSocket};
use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use machine::{Instant, Machine};
use networked_tests::End;
use protocol::fieldbus::LinkEvent;
use protocol_linux::handover::Received;
use protocol_linux::namespace::NetworkNamespace;
use protocol_linux::{CyclicThread, Driver, Finished, Interface, NoticeSender, Notifier, Task};

pub(crate) const MASK: Ipv4Addr = Ipv4Addr::new(255, 255, 255, 0);
pub(crate) const ADDRESSES: [Ipv4Addr; 2] = [Ipv4Addr::new(10, 0, 0, 1), Ipv4Addr::new(10, 0, 0, 2)];

/// Limit for each wait; a wait that takes longer hangs.
pub(crate) const TIMEOUT: Duration = Duration::from_secs(60);

pub(crate) struct TestNetwork {
    pub(crate) ends: [(NetworkNamespace, &'static str); 2],
}

impl TestNetwork {
    pub(crate) fn new() -> Self {
        let ends = ["left0", "right0"].map(|name| (NetworkNamespace::new().unwrap(), name));
        let end = |index: usize| {
            let (network, name) = &ends[index];
            End { network, name, address: Some(ADDRESSES[index]) }
        };
        networked_tests::cable([end(0), end(1)]);
        let network = Self { ends };
        for (index, address) in ADDRESSES.into_iter().enumerate() {
            let found = network.run(index, |interface| (interface.address(), interface.mask()));
            assert_eq!(found, (Some(address), Some(MASK)));
        }
        network.resolve_addresses();
        network
    }

    /// Sends a datagram each way. While the kernel asks for the MAC address of a datagram's receiver, later frames
    /// overtake the datagram.
    fn resolve_addresses(&self) {
        let [left, right] = [0, 1].map(|end| {
            let bind = |_: &Interface| UdpSocket::bind((ADDRESSES[end], 4_900)).unwrap();
            let socket = self.run(end, bind);
            socket.set_read_timeout(Some(TIMEOUT)).unwrap();
            socket
        });
        for (from, to) in [(&left, &right), (&right, &left)] {
            from.send_to(b"?", to.local_addr().unwrap()).unwrap();
            assert_eq!(to.recv(&mut [0; 8]).unwrap(), 1);
        }
    }

    /// Runs `job` at an end of the cable.
    pub(crate) fn run<T: Send>(&self, end: usize, job: impl FnOnce(&Interface) -> T + Send) -> T {
        let (namespace, name) = &self.ends[end];
        namespace.run(|| job(&Interface::open(name).unwrap())).unwrap()
    }

    /// Starts a machine at an end of the cable.
    pub(crate) fn start<M: Progress>(
        &self,
        end: usize,
        machine: impl FnOnce(&Interface) -> M + Send,
    ) -> Running<M> {
        let watch = Watch::default();
        let progress = Arc::clone(&watch.progress);
        let thread = self.run(end, |interface| {
            let machine = machine(interface);
            let (waker, reader) = (Notifier::new().unwrap(), Notifier::new().unwrap());
            let driver = Driver::new(machine, interface.clone(), waker.clone()).unwrap();
            CyclicThread::start(driver, watch, waker, reader).unwrap()
        });
        Running { thread, progress }
    }
}

/// A machine whose progress a test waits for.
pub(crate) trait Progress: Machine + Send + 'static {
    /// Returns the link event in an event.
    fn link(event: Self::Event) -> LinkEvent;

    /// Returns a count that only rises; what it counts is up to the machine.
    fn progress(&self) -> u64 {
        0
    }
}

/// A machine on its thread.
pub(crate) struct Running<M: Progress> {
    thread: CyclicThread<M, Watch>,
    progress: Arc<AtomicU64>,
}

impl<M: Progress> Running<M> {
    pub(crate) fn progress(&self) -> u64 {
        self.progress.load(Ordering::Relaxed)
    }

    /// Waits until the machine's progress reaches this count.
    pub(crate) fn until(&self, what: &str, count: u64) {
        let start = std::time::Instant::now();
        while self.progress() < count {
            assert!(start.elapsed() < TIMEOUT, "not within {TIMEOUT:?}: {what}, but {}", self.progress());
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// Waits until the machine reports that its link is up.
    pub(crate) fn until_up(&mut self) {
        let start = std::time::Instant::now();
        while self.thread.next_notice() != Received::Item(LinkEvent::Up) {
            assert!(start.elapsed() < TIMEOUT, "it does not come up");
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    pub(crate) fn stop(mut self) -> Finished<M, Watch> {
        self.thread.send(()).unwrap();
        let finished = self.join();
        finished.result.as_ref().unwrap();
        finished
    }

    pub(crate) fn join(self) -> Finished<M, Watch> {
        self.thread.join().unwrap()
    }
}

/// Publishes the machine's progress, counts how often the link came up, and ends on request.
#[derive(Default, Debug)]
pub(crate) struct Watch {
    pub(crate) ups: u64,
    progress: Arc<AtomicU64>,
}

impl<M: Progress> Task<M> for Watch {
    type Command = ();
    type Notice = LinkEvent;

    fn event(
        &mut self,
        _: Instant,
        _: &mut M,
        event: M::Event,
        notices: &mut NoticeSender<LinkEvent>,
    ) -> ControlFlow<()> {
        let event = M::link(event);
        self.ups += u64::from(event == LinkEvent::Up);
        notices.send(event);
        ControlFlow::Continue(())
    }

    fn inspect(&mut self, _: Instant, machine: &M) {
        self.progress.store(machine.progress(), Ordering::Relaxed);
    }
}
