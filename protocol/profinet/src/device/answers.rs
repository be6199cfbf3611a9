//! Stores answers, so that a repeated request gets the same answer and is not executed twice. A caller is a pair of station
//! and activity: two stations with the same activity are two callers.

use core::net::{Ipv4Addr, SocketAddrV4};

use crate::RPC_PORT;
use crate::block::BlockWriter;
use crate::rpc::{Header, Kind, Message, Operation, ResponseArgs};
use crate::status::Status;
use machine::wire::Overflow;
use machine::{Duration, Instant, Port, Transmit};

/// Number of callers whose last answer is stored.
const CALLERS: usize = 4;

/// Time for which an answer is that of the same request again: no client repeats a call for so long. Later it is a new call of
/// a caller that does not number its calls, such as a tool that reads the same record again and again.
const HELD_FOR: Duration = Duration::from_secs(30);

/// A request to be answered.
#[derive(Clone, Copy, Debug)]
pub(super) struct Call<'a> {
    pub(super) now: Instant,
    pub(super) request: &'a Header,
    /// Its body.
    pub(super) body: &'a [u8],
    pub(super) from: SocketAddrV4,
    /// Station whose newest answer stays stored, however many other stations call.
    pub(super) controller: Option<Ipv4Addr>,
}

/// The last answer to each of the most recent callers.
#[derive(Debug)]
pub(super) struct Answers {
    callers: [Answer; CALLERS],
    uses: u64,
    /// Whether there may be datagrams to send.
    pending: bool,
}

#[derive(Debug)]
struct Answer {
    message: Message,
    /// [`digest`] of the request's body.
    request: u64,
    /// When it was answered first.
    at: Instant,
    to: Option<SocketAddrV4>,
    last_use: u64,
}

/// Status of a request before it is executed.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum RequestStatus {
    /// It is new.
    New,
    /// It was answered before; the answer is queued again.
    Answered,
    /// Its caller has numbered calls higher before: either it restarted, or this is an old call that was delayed.
    Restarted,
    /// Its caller has made another call since then.
    Old,
}

impl Answers {
    pub(super) fn new() -> Self {
        let answer =
            |_| Answer { message: Message::new(), request: 0, at: Instant::ZERO, to: None, last_use: 0 };
        Self { callers: core::array::from_fn(answer), uses: 0, pending: false }
    }

    /// Looks up a request. If it was answered, queues the answer again, to the port that the request came from. The AR's
    /// controller must number its calls upwards, except that it may restart, which a Connect shows; all other callers may
    /// restart at any time.
    pub(super) fn look_up(&mut self, call: Call<'_>) -> RequestStatus {
        let Call { now, request, body, from, controller } = call;
        let Some(answer) = self.callers.iter_mut().find(|answer| answer.is_of(request, from)) else {
            return RequestStatus::New;
        };
        let Some(last) = answer.message.header() else { return RequestStatus::New };
        let ahead = request.sequence.wrapping_sub(last.sequence);
        let is_same = (last.operation, last.interface) == (request.operation, request.interface);
        let is_controller = controller == Some(*from.ip());
        let may_restart = !is_controller || Operation::from(request.operation) == Operation::Connect;
        match ahead {
            0 if is_same && now.since(answer.at) < HELD_FOR && answer.request == digest(body) => {
                answer.to = Some(from);
                answer.message.repeat();
                self.pending = true;
                RequestStatus::Answered
            }
            // A caller that does not number its calls is also served.
            0..=0x7FFF_FFFF => RequestStatus::New,
            _ if may_restart => RequestStatus::Restarted,
            _ => RequestStatus::Old,
        }
    }

    /// Forgets the answers to a station whose AR has ended: they no longer hold. The answer to its Release stays, for the
    /// case that it was lost.
    pub(super) fn forget(&mut self, station: Ipv4Addr) {
        let is_release = |last: &Header| Operation::from(last.operation) == Operation::Release;
        for answer in self.callers.iter_mut().filter(|answer| answer.to.is_some_and(|to| *to.ip() == station))
        {
            if !answer.message.header().is_some_and(is_release) {
                answer.message.clear();
                answer.to = None;
            }
        }
    }

    /// Returns whether the call of a ping was answered, and queues its answer again.
    pub(super) fn look_up_ping(&mut self, ping: &Header, from: SocketAddrV4) -> bool {
        let mut callers = self.callers.iter_mut();
        let answered = |answer: &&mut Answer| {
            answer.is_of(ping, from) && answer.message.header().is_some_and(|last| last.is_same_call(ping))
        };
        callers.find(answered).is_some_and(|answer| {
            answer.to = Some(from);
            answer.message.repeat();
            self.pending = true;
            true
        })
    }

    /// Answers a request with a status and blocks.
    pub(super) fn answer(
        &mut self,
        call: Call<'_>,
        maximum: u32,
        status: Status,
        blocks: impl FnOnce(&mut BlockWriter<'_>),
    ) -> Result<(), Overflow> {
        self.answer_with(call, |body| ResponseArgs::emit(status, maximum, body, blocks))
    }

    /// Answers a request with a body.
    pub(super) fn answer_with(
        &mut self,
        Call { now, request, body: asked, from, controller }: Call<'_>,
        body: impl FnOnce(&mut [u8]) -> Result<usize, Overflow>,
    ) -> Result<(), Overflow> {
        self.uses += 1;
        self.pending = true;
        let own = self.callers.iter().position(|answer| answer.is_of(request, from));
        let kept = controller.filter(|kept| kept != from.ip()).and_then(|kept| self.newest_of(kept));
        let oldest = || {
            let places = self.callers.iter().enumerate();
            let others = places.filter(|(index, _)| Some(*index) != kept);
            others.min_by_key(|(_, answer)| answer.last_use).map_or(0, |(index, _)| index)
        };
        let index = own.unwrap_or_else(oldest);
        let Some(answer) = self.callers.get_mut(index) else { return Ok(()) };
        answer.last_use = self.uses;
        answer.to = Some(from);
        answer.at = now;
        answer.request = digest(asked);
        answer.message.set(request.answer(Kind::Response), body)
    }

    /// Returns the place of the newest answer to a station.
    fn newest_of(&self, station: Ipv4Addr) -> Option<usize> {
        let places = self.callers.iter().enumerate();
        let own = places.filter(|(_, answer)| answer.to.is_some_and(|to| *to.ip() == station));
        own.max_by_key(|(_, answer)| answer.last_use).map(|(index, _)| index)
    }

    /// Writes the next datagram.
    pub(super) fn poll_transmit(&mut self, buf: &mut [u8]) -> Option<Transmit> {
        if !self.pending {
            return None;
        }
        let next = self.callers.iter_mut().find_map(|answer| {
            let to = answer.to?;
            let len = answer.message.poll(buf)?;
            Some(Transmit { port: Port::Udp(RPC_PORT), to: Some(to), len })
        });
        self.pending = next.is_some();
        next
    }
}

impl Answer {
    fn is_of(&self, request: &Header, from: SocketAddrV4) -> bool {
        self.to.is_some_and(|to| to.ip() == from.ip())
            && self.message.header().is_some_and(|last| last.activity == request.activity)
    }
}

/// Returns a number that two different bodies of requests hardly share (FNV-1a, 64 bits): it tells a repetition from another
/// call of a caller that numbers its calls anew.
fn digest(body: &[u8]) -> u64 {
    body.iter()
        .fold(0xCBF2_9CE4_8422_2325, |sum, byte| (sum ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01B3))
}
