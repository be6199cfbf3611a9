//! Stores answers, so that a repeated request gets the same answer and is not executed twice. A caller is a pair of station
//! and activity: two stations with the same activity are two callers.

use core::net::{Ipv4Addr, SocketAddrV4};

use crate::RPC_PORT;
use crate::block::BlockWriter;
use crate::rpc::{Header, Kind, Message, ResponseArgs};
use crate::status::Status;
use machine::wire::Overflow;
use machine::{Port, Transmit};

/// Number of callers whose last answer is stored.
const CALLERS: usize = 4;

/// A request to be answered.
#[derive(Clone, Copy, Debug)]
pub(super) struct Call<'a> {
    pub(super) request: &'a Header,
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
    /// Its caller has made another call since then.
    Old,
}

impl Answers {
    pub(super) fn new() -> Self {
        let answer = |_| Answer { message: Message::new(), to: None, last_use: 0 };
        Self { callers: core::array::from_fn(answer), uses: 0, pending: false }
    }

    /// Looks up a request. If it was answered, queues the answer again, to the port that the request came from.
    pub(super) fn look_up(&mut self, request: &Header, from: SocketAddrV4) -> RequestStatus {
        let Some(answer) = self.callers.iter_mut().find(|answer| answer.is_of(request, from)) else {
            return RequestStatus::New;
        };
        let Some(last) = answer.message.header() else { return RequestStatus::New };
        let ahead = request.sequence.wrapping_sub(last.sequence);
        match ahead {
            0 if last.operation == request.operation && last.interface == request.interface => {
                answer.to = Some(from);
                answer.message.repeat();
                self.pending = true;
                RequestStatus::Answered
            }
            // A caller that does not number its calls is also served.
            0 => RequestStatus::New,
            1..=0x7FFF_FFFF => RequestStatus::New,
            _ => RequestStatus::Old,
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
        Call { request, from, controller }: Call<'_>,
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
