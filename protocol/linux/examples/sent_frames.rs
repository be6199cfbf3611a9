//! Measures what a sent frame costs the thread of a driver: `sent_frames [raw|udp] [STATIONS] [CYCLES]`, as root.
//!
//! A machine sends a frame to each of its stations every millisecond over a cable of two namespaces, where nobody answers. The
//! example prints the processor time of a cycle. Difference of two numbers of stations, divided by that of the stations: the
//! cost of a frame.

#![expect(clippy::print_stdout, reason = "an example prints its result")]

use std::net::{Ipv4Addr, SocketAddrV4, UdpSocket};
use std::ops::ControlFlow;

use machine::{Cycle, Duration, Instant, Machine, Port, PortRequest, Source, Transmit};
use protocol_linux::namespace::NetworkNamespace;
use protocol_linux::{Driver, Interface, Notifier, Owner, Statistics, clock, scheduling, veth};
use rustix::time::{ClockId, clock_gettime};

const ETHER_TYPE: u16 = 0x88B5;
const UDP: u16 = 4_000;
const PORTS: &[PortRequest] =
    &[PortRequest::Ethernet { ether_type: ETHER_TYPE, groups: &[] }, PortRequest::Udp(UDP)];
const NEAR: Ipv4Addr = Ipv4Addr::new(10, 0, 0, 1);
const FAR: Ipv4Addr = Ipv4Addr::new(10, 0, 0, 2);
const MASK: Ipv4Addr = Ipv4Addr::new(255, 255, 255, 0);
/// Bytes of a frame: an image and its headers.
const LEN: usize = 300;
/// Cycles before the measured ones.
const WARM_UP: u64 = 200;

/// Sends a frame to each station in every cycle.
struct Stations {
    is_raw: bool,
    stations: usize,
    left: usize,
    cycle: Cycle,
    cycles: u64,
}

impl Machine for Stations {
    type Event = ();

    fn ports(&self) -> &[PortRequest] {
        PORTS
    }

    fn handle_frame(&mut self, _: Instant, _: Source, _: &[u8]) {}

    fn handle_timeout(&mut self, now: Instant) {
        if self.cycle.tick(now).is_some() {
            self.cycles += 1;
            self.left = self.stations;
        }
    }

    fn poll_transmit(&mut self, _: Instant, buf: &mut [u8]) -> Option<Transmit> {
        self.left = self.left.checked_sub(1)?;
        let frame = buf.get_mut(..LEN)?;
        frame.fill(0);
        frame.get_mut(..14)?.copy_from_slice(&[2, 0, 0, 0, 0, 9, 2, 0, 0, 0, 0, 8, 0x88, 0xB5]);
        let (port, to) = match self.is_raw {
            true => (Port::Ethernet, None),
            false => (Port::Udp(UDP), Some(SocketAddrV4::new(FAR, UDP))),
        };
        Some(Transmit { port, to, len: LEN })
    }

    fn poll_event(&mut self) -> Option<()> {
        None
    }

    fn poll_timeout(&self) -> Option<Instant> {
        Some(self.cycle.next())
    }
}

/// Reads the processor time of the thread at the first measured cycle, and ends at the last one.
struct Stopwatch {
    last: u64,
    from: Option<(u64, u64)>,
}

impl Owner<Stations> for Stopwatch {
    fn wake(&mut self, _: Instant, machine: &mut Stations, _: &Statistics) -> ControlFlow<()> {
        if machine.cycles >= WARM_UP && self.from.is_none() {
            self.from = Some((machine.cycles, processor_ns()));
        }
        if machine.cycles < self.last { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
    }

    fn event(&mut self, _: Instant, _: &mut Stations, (): ()) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }
}

/// Returns the processor time of this thread, in ns.
fn processor_ns() -> u64 {
    let now = clock_gettime(ClockId::ThreadCPUTime);
    now.tv_sec as u64 * 1_000_000_000 + now.tv_nsec as u64
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let is_raw = arguments.next().is_none_or(|kind| kind == "raw");
    let stations = arguments.next().map_or(Ok(1), |text| text.parse())?;
    let cycles: u64 = arguments.next().map_or(Ok(2_000), |text| text.parse())?;
    let [near, far] = [NetworkNamespace::new()?, NetworkNamespace::new()?];
    veth::connect(&near, "near0", &far, "far0")?;
    let up = |name, address| {
        let interface = Interface::open(name)?;
        interface.set_address(address, MASK)?;
        interface.set_up()?;
        Ok::<_, protocol_linux::InterfaceError>(interface)
    };
    // Nobody reads it: what finds no room is dropped, and no ICMP comes back.
    let sink = far.run(|| up("far0", FAR).map(|_| UdpSocket::bind((FAR, UDP))))??;
    let driver = near.run(|| {
        let cycle = Cycle::new(clock::now() + Duration::from_millis(50), Duration::from_millis(1));
        let machine = Stations { is_raw, stations, left: 0, cycle, cycles: 0 };
        let interface = up("near0", NEAR)?;
        let _ = interface.has_carrier()?;
        Ok::<_, Box<dyn std::error::Error + Send + Sync>>(Driver::new(machine, interface, Notifier::new()?)?)
    })?;
    let mut driver = driver.map_err(|error| error.to_string())?;
    let _ = scheduling::make_real_time();
    let mut stopwatch = Stopwatch { last: WARM_UP + cycles, from: None };
    driver.run(&mut stopwatch)?;
    let end = processor_ns();
    drop(sink);
    let (first, start) = stopwatch.from.unwrap_or_default();
    let statistics = driver.statistics();
    let per_cycle = (end - start) / (driver.machine().cycles - first).max(1);
    println!(
        "{stations} stations: {per_cycle} ns a cycle, {} sent, {} errors",
        statistics.sent, statistics.send_errors
    );
    Ok(())
}
