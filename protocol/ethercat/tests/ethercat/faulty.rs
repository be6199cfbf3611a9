//! A segment behind a cable with faults in chosen frames.

use std::collections::VecDeque;

use ethercat_subdevice::datagram::Datagrams;
use ethercat_subdevice::{DeviceId, Event, Segment};
use machine::{Duration, Instant, Machine, Port, PortRequest, Source, Transmit};

/// Length in bytes of an Ethernet header without tag.
const ETHERNET: usize = 14;

/// What happens to a frame.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum FrameFault {
    /// It does not reach the devices.
    LoseRequest,
    /// It reaches the devices, and its reply is lost.
    LoseReply,
    /// Its reply comes this much later.
    Late(Duration),
    /// Its reply comes twice.
    Double,
    /// Its reply comes once more, this much later.
    AgainAfter(Duration),
    /// Its reply comes after that of the next frame.
    Swap,
    /// Its reply comes just before that of the frame which was sent this many frames later.
    HeldFor(u32),
    /// The working counters of its reply are this much too high.
    Count(i16),
}

/// A reply that waits.
#[derive(Debug)]
struct Waiting {
    due: Instant,
    /// How many other replies it waits for, the last of which goes after it.
    behind: u32,
    frame: Vec<u8>,
}

/// A segment that the test looks at afterwards, and faults by the numbers of frames.
pub struct Faulty<'a> {
    pub segment: &'a mut Segment,
    pub faults: Vec<(u64, FrameFault)>,
    /// Devices that copy their outputs to their inputs.
    pub echo: bool,
    received: u64,
    waiting: VecDeque<Waiting>,
}

impl<'a> Faulty<'a> {
    pub fn new(segment: &'a mut Segment, faults: Vec<(u64, FrameFault)>, echo: bool) -> Self {
        Self { segment, faults, echo, received: 0, waiting: VecDeque::new() }
    }

    fn fault(&mut self) -> Option<FrameFault> {
        let number = self.received;
        self.received += 1;
        self.faults.iter().find(|(at, _)| *at == number).map(|(_, fault)| *fault)
    }

    fn reply(&mut self, now: Instant, mut frame: Vec<u8>, fault: Option<FrameFault>) {
        let mut again = None;
        let (mut due, mut behind) = (now, 0);
        match fault {
            Some(FrameFault::LoseReply) => return,
            Some(FrameFault::Late(time)) => due = now + time,
            Some(FrameFault::Double) => again = Some(now),
            Some(FrameFault::AgainAfter(time)) => again = Some(now + time),
            Some(FrameFault::Swap) => behind = 2,
            Some(FrameFault::HeldFor(others)) => behind = others,
            Some(FrameFault::Count(change)) => {
                for mut datagram in Datagrams::of(&mut frame[ETHERNET..]).unwrap() {
                    datagram.count(change as u16);
                }
            }
            Some(FrameFault::LoseRequest) | None => {}
        }
        for waiting in &mut self.waiting {
            waiting.behind = waiting.behind.saturating_sub(1);
        }
        if let Some(due) = again {
            self.waiting.push_back(Waiting { due, behind: 0, frame: frame.clone() });
        }
        self.waiting.push_back(Waiting { due, behind, frame });
    }
}

impl Machine for Faulty<'_> {
    type Event = (DeviceId, Event);

    fn ports(&self) -> &[PortRequest] {
        self.segment.ports()
    }

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        let fault = self.fault();
        if fault == Some(FrameFault::LoseRequest) {
            return;
        }
        self.segment.handle_frame(now, from, frame);
        let mut buf = vec![0; 4096];
        while let Some(transmit) = self.segment.poll_transmit(now, &mut buf) {
            self.reply(now, buf[..transmit.len].to_vec(), fault);
        }
        if self.echo {
            for id in (0..self.segment.len()).map(DeviceId) {
                let outputs = self.segment.outputs(id).map(<[u8]>::to_vec);
                let copied = outputs.map(|data| self.segment.set_inputs(id, &data));
                assert!(matches!(copied, None | Some(Ok(()))), "{copied:?}");
            }
        }
    }

    fn handle_timeout(&mut self, now: Instant) {
        self.segment.handle_timeout(now);
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        let ready = self.waiting.iter().position(|waiting| waiting.due <= now && waiting.behind == 0);
        let Some(Waiting { frame, .. }) = ready.and_then(|at| self.waiting.remove(at)) else {
            return self.segment.poll_transmit(now, buf);
        };
        buf[..frame.len()].copy_from_slice(&frame);
        Some(Transmit { port: Port::Ethernet, to: None, len: frame.len() })
    }

    fn poll_event(&mut self) -> Option<Self::Event> {
        self.segment.poll_event()
    }

    fn poll_timeout(&self) -> Option<Instant> {
        let waiting = self.waiting.iter().filter(|waiting| waiting.behind == 0).map(|waiting| waiting.due);
        Instant::earlier(self.segment.poll_timeout(), waiting.min())
    }
}
