//! The reference of the comparison: a loop at each end that sleeps until an absolute deadline or a frame, and does
//! nothing but send frames of the same size and take their times.

use std::net::{Ipv4Addr, SocketAddrV4};
use std::os::fd::AsFd as _;
use std::time::Duration;

use machine::ethernet::Mac;
use machine::{Instant, PortRequest};
use protocol_linux::{Interface, OpenPort, Received, clock, scheduling};
use rustix::event::{PollFd, PollFlags, Timespec, poll};

use super::cable::{Cable, PLC, ROBOT};
use super::stopwatch::RoundTrip;
use super::{INTERVAL, SETTLE, TURN};

/// Port of the datagrams, which no bus uses.
const UDP_PORT: u16 = 2_223;

/// EtherType of the raw frames: IEEE 802's for local experiments.
const ETHER_TYPE: u16 = 0x88B5;

/// Time for the two threads to start.
const LEAD: Duration = Duration::from_millis(10);

/// Largest frame.
const CAPACITY: usize = 1_514;

/// How a bus carries its cyclic frames, and with which length.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Wire {
    /// A datagram with so many bytes of payload.
    Udp(usize),
    /// An Ethernet frame of so many bytes.
    Ethernet(usize),
}

/// When the robot's end sends.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum AnswerTime {
    /// In cycles of its own, this time before the PLC's.
    InItsCycle(Duration),
    /// At once, as a frame returns to a MainDevice.
    AtOnce,
}

/// What was measured in a turn.
#[derive(Debug)]
pub(super) struct Exchanged {
    pub(super) start: Instant,
    pub(super) round_trips: Vec<RoundTrip>,
}

/// Sends in both directions for a turn.
pub(super) fn exchange(cable: &Cable, wire: Wire, answers: AnswerTime) -> anyhow::Result<Exchanged> {
    let start = clock::now() + LEAD;
    let macs = (cable.plc.run(|plc| Ok(plc.mac()))?, cable.robot.run(|robot| Ok(robot.mac()))?);
    let end = start + SETTLE + TURN;
    let round_trips = std::thread::scope(|scope| {
        let robot = scope.spawn(|| {
            cable.robot.run(|interface| {
                let due = (answers != AnswerTime::AtOnce).then_some(start);
                let end = Loop { due, end, ..Loop::open(&interface, wire, macs.0, PLC)? };
                end.answer()
            })
        });
        let plc = cable.plc.run(|interface| {
            let phase = match answers {
                AnswerTime::InItsCycle(phase) => phase,
                AnswerTime::AtOnce => Duration::ZERO,
            };
            let end = Loop { due: Some(start + phase), end, ..Loop::open(&interface, wire, macs.1, ROBOT)? };
            end.ask()
        });
        robot.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)).and(plc)
    })?;
    Ok(Exchanged { start, round_trips })
}

/// Times in a frame: when it was sent, and how long the one took that its sender received last, in ns.
const TIMES: usize = 16;

/// One end.
struct Loop {
    port: OpenPort,
    to: Option<SocketAddrV4>,
    /// What is sent; the times follow its header.
    frame: Vec<u8>,
    header: usize,
    /// When to send next, if not at once.
    due: Option<Instant>,
    end: Instant,
}

/// Why a loop wakes.
enum Woken {
    /// A frame arrived: how long it took, and the time that it carried.
    Frame {
        took: Duration,
        carried: Duration,
    },
    Due,
    End,
}

impl Loop {
    fn open(interface: &Interface, wire: Wire, mac: Mac, address: Ipv4Addr) -> anyhow::Result<Self> {
        let (request, header, len, to) = match wire {
            Wire::Udp(len) => {
                (PortRequest::Udp(UDP_PORT), Vec::new(), len, Some(SocketAddrV4::new(address, UDP_PORT)))
            }
            Wire::Ethernet(len) => {
                let request = PortRequest::Ethernet { ether_type: ETHER_TYPE, groups: &[] };
                let header = [&mac.0[..], &interface.mac().0, &ETHER_TYPE.to_be_bytes()].concat();
                (request, header, len, None)
            }
        };
        let port = OpenPort::open(interface, request)?;
        // The contenders' threads report the same warning, if there is one.
        let _ = scheduling::make_real_time();
        let mut frame = header.clone();
        frame.resize(len.clamp(header.len() + TIMES, CAPACITY), 0);
        Ok(Self { port, to, frame, header: header.len(), due: None, end: Instant::ZERO })
    }

    /// Sends in cycles or at once; each frame contains the transmission time of the last frame from the other end.
    fn answer(mut self) -> anyhow::Result<Vec<RoundTrip>> {
        let mut last = Duration::ZERO;
        loop {
            match self.wait()? {
                Woken::Frame { took, .. } => {
                    last = took;
                    if self.due.is_none() {
                        self.send(last);
                    }
                }
                Woken::Due => self.send(last),
                Woken::End => return Ok(Vec::new()),
            }
        }
    }

    /// Sends in cycles, and notes how long each frame took there and the answer back.
    fn ask(mut self) -> anyhow::Result<Vec<RoundTrip>> {
        let mut round_trips = Vec::with_capacity(4_096);
        loop {
            match self.wait()? {
                Woken::Frame { took, carried } => {
                    round_trips.push(RoundTrip { at: clock::now(), on_the_way: carried + took, whole: None });
                }
                Woken::Due => self.send(Duration::ZERO),
                Woken::End => return Ok(round_trips),
            }
        }
    }

    /// Sleeps until a frame arrives or the next one is due.
    fn wait(&mut self) -> anyhow::Result<Woken> {
        let mut buffer = [0; CAPACITY];
        loop {
            let now = clock::now();
            if let Some(due) = self.due.filter(|due| *due <= now) {
                self.due = Some(due.next_on_grid(INTERVAL, now).0);
                return Ok(Woken::Due);
            }
            if now >= self.end {
                return Ok(Woken::End);
            }
            let left = self.due.map_or(self.end, |due| due.min(self.end)).since(now);
            let left = Timespec { tv_sec: left.as_secs() as i64, tv_nsec: left.subsec_nanos().into() };
            match poll(&mut [PollFd::from_borrowed_fd(self.port.as_fd(), PollFlags::IN)], Some(&left)) {
                Ok(0) | Err(rustix::io::Errno::INTR) => continue,
                Ok(_) => {}
                Err(error) => return Err(error.into()),
            }
            if let Ok(Received::Frame { len, .. }) = self.port.receive(&mut buffer) {
                let now = clock::now();
                let times = buffer.get(self.header..len).and_then(|payload| payload.first_chunk::<TIMES>());
                if let Some(times) = times {
                    let (sent, carried) = times.split_at(TIMES / 2);
                    let number = |bytes: &[u8]| u64::from_le_bytes(bytes.try_into().unwrap_or_default());
                    let took = now.since(Instant::from_nanos(number(sent)));
                    return Ok(Woken::Frame { took, carried: Duration::from_nanos(number(carried)) });
                }
            }
        }
    }

    fn send(&mut self, last: Duration) {
        let times = [clock::now().as_nanos(), u64::try_from(last.as_nanos()).unwrap_or(u64::MAX)];
        let bytes = times.into_iter().flat_map(u64::to_le_bytes);
        self.frame.iter_mut().skip(self.header).zip(bytes).for_each(|(place, byte)| *place = byte);
        // If the kernel refuses one at some moment, that frame is missing in the table.
        let _ = self.port.send(&self.frame, self.to, 0);
    }
}
