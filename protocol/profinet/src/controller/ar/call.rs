//! A call to the device: one RPC at a time, repeated until it is answered or abandoned (C706, chapter 10).

use crate::Uuid;
use crate::rpc::{
    Header, Kind, Message, Operation, Reassembly, Received, flags, read_rpc_status, rpc_status,
};
use machine::wire::Overflow;
use machine::{Duration, Instant};

/// Pause before the first repetition of an unanswered call; it doubles up to [`REPEAT_AT_MOST`].
const REPEAT_AFTER: Duration = Duration::from_millis(200);
/// The longest pause between repetitions.
const REPEAT_AT_MOST: Duration = Duration::from_millis(800);
/// Time after which the first unanswered call is abandoned. It doubles up to [`UNHEARD_AT_MOST`] with each call that was abandoned,
/// since the device may be slow and not say so.
const UNHEARD_FOR: Duration = Duration::from_secs(3);
/// The longest time after which an unanswered call is abandoned.
const UNHEARD_AT_MOST: Duration = Duration::from_secs(12);
/// Time after which a call is abandoned even if the device reports that it is still working on it.
const UNFINISHED_FOR: Duration = Duration::from_secs(30);

/// ArgsMaximum: the longest answer, in bytes of blocks, that we accept.
pub(super) const LONGEST_ANSWER: u32 = 4096;

/// Result of a received PDU for the call.
#[derive(Debug)]
pub(super) enum AnswerOutcome<'a> {
    /// It is not about the call.
    Foreign,
    /// The call goes on.
    Pending,
    /// The call is answered: header of the answer and its whole body.
    Answer(Header, &'a [u8]),
    /// The call was refused by RPC itself, with this status.
    Refused(u32),
}

/// A caller's thread of calls to one interface.
#[derive(Debug)]
pub(super) struct Caller {
    request: Message,
    answer: Reassembly,
    object: Uuid,
    interface: Uuid,
    activity: Uuid,
    sequence: u32,
    wait: Option<Wait>,
    /// How long the device may be silent.
    patience: Duration,
    /// A short PDU that goes out before the request: a ping, or the acknowledgement of a fragment.
    reply: Option<Header>,
}

#[derive(Clone, Copy, Debug)]
struct Wait {
    repeat_at: Instant,
    pause: Duration,
    patience: Duration,
    give_up_at: Instant,
    last_resort: Instant,
    /// The device has confirmed the request: from now on the caller sends pings and does not repeat the request.
    working: bool,
}

impl Caller {
    /// Creates a caller without a call, for requests and answers whose bodies have at most this number of bytes. It allocates its memory here; nothing allocates later.
    pub(super) fn new(interface: Uuid, capacity: usize) -> Self {
        Self {
            request: Message::with_capacity(capacity),
            answer: Reassembly::with_capacity(capacity),
            object: Uuid::NIL,
            interface,
            activity: Uuid::NIL,
            sequence: 0,
            wait: None,
            patience: UNHEARD_FOR,
            reply: None,
        }
    }

    /// Returns the largest number of bytes of a request's body.
    pub(super) fn capacity(&self) -> usize {
        self.request.capacity()
    }

    /// Expects answers as soon as at the start again: the device answers in time.
    pub(super) const fn reset_patience(&mut self) {
        self.patience = UNHEARD_FOR;
    }

    /// Gives up the call, if there is one, and starts a new thread of calls, to this object.
    pub(super) fn begin(&mut self, activity: Uuid, object: Uuid) {
        self.cancel();
        (self.activity, self.sequence, self.object) = (activity, 0, object);
    }

    /// Gives up the call, if there is one.
    pub(super) fn cancel(&mut self) {
        self.request.clear();
        (self.wait, self.reply) = (None, None);
    }

    /// Starts a call; `write` writes the request's body into the buffer.
    pub(super) fn call(
        &mut self,
        now: Instant,
        operation: Operation,
        write: impl FnOnce(&mut [u8]) -> Result<usize, Overflow>,
    ) -> Result<(), Overflow> {
        self.cancel();
        let header = Header::request(operation, self.object, self.interface, self.activity, self.sequence);
        self.request.set(header, write)?;
        self.sequence = self.sequence.wrapping_add(1);
        self.wait = Some(Wait {
            repeat_at: now + REPEAT_AFTER,
            pause: REPEAT_AFTER,
            patience: self.patience,
            give_up_at: now + self.patience,
            last_resort: now + UNFINISHED_FOR,
            working: false,
        });
        Ok(())
    }

    /// Handles a PDU from any UDP port of the device.
    pub(super) fn handle<'a>(
        &'a mut self,
        now: Instant,
        header: &Header,
        body: &'a [u8],
    ) -> AnswerOutcome<'a> {
        let ours = self.request.header().is_some_and(|request| request.is_same_call(header));
        let Some(wait) = self.wait.as_mut().filter(|_| ours) else { return AnswerOutcome::Foreign };
        match header.kind {
            Kind::Response => {
                wait.restart_timeout(now);
                if header.is_fragment() && header.flags & flags::NO_FRAGMENT_ACK == 0 {
                    self.reply = Some(Header { kind: Kind::FragmentAck, flags: 0, flags2: 0, ..*header });
                }
                match self.answer.take(header, body) {
                    Received::Whole(whole) => {
                        self.wait = None;
                        self.request.clear();
                        AnswerOutcome::Answer(*header, whole)
                    }
                    Received::Part | Received::Refused | Received::TooLong => AnswerOutcome::Pending,
                }
            }
            Kind::Fault | Kind::Reject => match read_rpc_status(header, body).unwrap_or_default() {
                // It has no room for the call now. The call is repeated when it is due.
                rpc_status::SERVER_TOO_BUSY => {
                    wait.working = false;
                    wait.restart_timeout(now);
                    AnswerOutcome::Pending
                }
                status => {
                    self.cancel();
                    AnswerOutcome::Refused(status)
                }
            },
            Kind::Working => {
                wait.working = true;
                wait.restart_timeout(now);
                AnswerOutcome::Pending
            }
            Kind::NoCall => {
                wait.working = false;
                self.request.repeat();
                AnswerOutcome::Pending
            }
            Kind::FragmentAck | Kind::Ack | Kind::CancelAck => AnswerOutcome::Pending,
            Kind::Request | Kind::Ping | Kind::Cancel | Kind::Unknown(_) => AnswerOutcome::Foreign,
        }
    }

    /// Repeats the call if it is time to. Returns whether the call had to be abandoned.
    pub(super) fn handle_timeout(&mut self, now: Instant) -> bool {
        let Some(wait) = &mut self.wait else { return false };
        if now >= wait.give_up_at {
            self.patience = self.patience.saturating_mul(2).min(UNHEARD_AT_MOST);
            self.cancel();
            return true;
        }
        if now >= wait.repeat_at {
            wait.pause = wait.pause.saturating_mul(2).min(REPEAT_AT_MOST);
            wait.repeat_at = now + wait.pause;
            match self.request.header() {
                Some(request) if wait.working => {
                    self.reply = Some(Header { kind: Kind::Ping, flags: 0, ..*request });
                }
                _ => self.request.repeat(),
            }
        }
        false
    }

    /// Writes the next datagram of the call and returns its length.
    pub(super) fn poll_transmit(&mut self, datagram: &mut [u8]) -> Option<usize> {
        if let Some(reply) = self.reply.take() {
            return reply.emit(&[], datagram).ok();
        }
        self.request.poll(datagram)
    }

    /// Returns when the call is repeated or abandoned; none without a call.
    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        self.wait.map(|wait| wait.repeat_at.min(wait.give_up_at))
    }
}

impl Wait {
    /// Restarts the timeout: the device is alive and has received the call.
    fn restart_timeout(&mut self, now: Instant) {
        self.give_up_at = (now + self.patience).min(self.last_resort);
        self.repeat_at = now + self.pause;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rpc::{BODY_CAPACITY, DEVICE_INTERFACE, DataRepresentation, FRAGMENT_LEN};

    const ACTIVITY: Uuid = Uuid([7; 16]);

    fn calling() -> Caller {
        let mut caller = Caller::new(DEVICE_INTERFACE, BODY_CAPACITY);
        caller.begin(ACTIVITY, Uuid([1; 16]));
        caller
            .call(Instant::ZERO, Operation::Connect, |body| {
                body[..3].copy_from_slice(b"abc");
                Ok(3)
            })
            .unwrap();
        caller
    }

    fn sent(caller: &mut Caller) -> Option<Header> {
        let mut datagram = [0; 2000];
        let len = caller.poll_transmit(&mut datagram)?;
        Some(Header::parse(&datagram[..len]).unwrap().0)
    }

    #[test]
    fn an_unanswered_call_is_repeated_ever_more_slowly_and_then_given_up() {
        let mut caller = calling();
        let first = sent(&mut caller).unwrap();
        assert_eq!((first.kind, first.sequence, first.activity), (Kind::Request, 0, ACTIVITY));
        assert!(sent(&mut caller).is_none());
        let mut repeated_at = Vec::new();
        loop {
            let at = caller.poll_timeout().unwrap();
            if caller.handle_timeout(at) {
                assert_eq!(at, Instant::from_millis(3_000));
                break;
            }
            repeated_at.push(at.as_nanos() / 1_000_000);
            assert_eq!(sent(&mut caller).unwrap().sequence, 0);
        }
        assert_eq!(repeated_at, [200, 600, 1400, 2200]);
        assert_eq!(caller.poll_timeout(), None);
    }

    #[test]
    fn a_device_that_says_it_is_working_is_pinged_until_it_knows_the_call_no_more() {
        let mut caller = calling();
        let request = sent(&mut caller).unwrap();
        let now = Instant::from_millis(100);
        assert!(matches!(caller.handle(now, &request.answer(Kind::Working), &[]), AnswerOutcome::Pending));
        let at = caller.poll_timeout().unwrap();
        assert!(!caller.handle_timeout(at));
        let ping = sent(&mut caller).unwrap();
        assert_eq!((ping.kind, ping.flags, ping.is_same_call(&request)), (Kind::Ping, 0, true));
        assert!(matches!(caller.handle(at, &request.answer(Kind::NoCall), &[]), AnswerOutcome::Pending));
        assert_eq!(sent(&mut caller).unwrap().kind, Kind::Request);
    }

    #[test]
    fn each_call_that_was_given_up_makes_it_more_patient_until_the_device_answers_in_time() {
        let mut caller = calling();
        let mut given_up_after = Vec::new();
        for round in 0..5 {
            if round == 4 {
                caller.reset_patience();
            }
            caller.call(Instant::ZERO, Operation::Connect, |_| Ok(0)).unwrap();
            let mut at = caller.poll_timeout().unwrap();
            while !caller.handle_timeout(at) {
                at = caller.poll_timeout().unwrap();
            }
            given_up_after.push(at.as_nanos() / 1_000_000_000);
        }
        assert_eq!(given_up_after, [3, 6, 12, 12, 3]);
    }

    #[test]
    fn a_device_that_is_too_busy_is_called_again() {
        let mut caller = calling();
        let request = sent(&mut caller).unwrap();
        let reject = request.answer(Kind::Reject);
        let busy = rpc_status::SERVER_TOO_BUSY.to_be_bytes();
        for _ in 0..10 {
            let at = caller.poll_timeout().unwrap();
            assert!(!caller.handle_timeout(at));
            let again = sent(&mut caller).unwrap();
            assert_eq!((again.kind, again.sequence), (Kind::Request, request.sequence));
            assert!(matches!(caller.handle(at, &reject, &busy), AnswerOutcome::Pending));
            assert!(sent(&mut caller).is_none(), "not at once");
        }
        assert!(caller.poll_timeout().unwrap() > Instant::from_millis(3_000));
    }

    #[test]
    fn a_device_that_works_forever_is_given_up_after_30_s() {
        let mut caller = calling();
        let request = sent(&mut caller).unwrap();
        let mut now = Instant::ZERO;
        while !caller.handle_timeout(now) {
            caller.handle(now, &request.answer(Kind::Working), &[]);
            now = caller.poll_timeout().unwrap();
        }
        assert_eq!(now, Instant::from_millis(30_000));
    }

    #[test]
    fn an_answer_in_either_byte_order_ends_the_call_and_others_do_not() {
        for order in [DataRepresentation::BigEndian, DataRepresentation::LittleEndian] {
            let mut caller = calling();
            let request = sent(&mut caller).unwrap();
            let answer = Header { order, ..request.answer(Kind::Response) };
            let other = Header { sequence: 9, ..answer };
            assert!(matches!(caller.handle(Instant::ZERO, &other, b"no"), AnswerOutcome::Foreign));
            assert!(matches!(
                caller.handle(Instant::ZERO, &answer, b"yes"),
                AnswerOutcome::Answer(_, b"yes")
            ));
            assert!(matches!(caller.handle(Instant::ZERO, &answer, b"again"), AnswerOutcome::Foreign));
        }
    }

    #[test]
    fn an_answer_in_fragments_is_put_together_and_each_is_acknowledged_if_wanted() {
        let mut caller = calling();
        let request = sent(&mut caller).unwrap();
        let answer = Header { flags2: 2, server_boot: 77, ..request.answer(Kind::Response) };
        for (fragment, flags, is_wanted) in
            [(0, flags::FRAGMENT, true), (1, flags::FRAGMENT | flags::NO_FRAGMENT_ACK, false)]
        {
            let part = Header { flags, fragment, ..answer };
            assert!(matches!(
                caller.handle(Instant::ZERO, &part, &[1; FRAGMENT_LEN]),
                AnswerOutcome::Pending
            ));
            let ack = Header { kind: Kind::FragmentAck, flags: 0, flags2: 0, fragment, ..answer };
            assert_eq!(sent(&mut caller), is_wanted.then_some(ack));
        }
        let last = Header { flags: flags::FRAGMENT | flags::LAST_FRAGMENT, fragment: 2, ..answer };
        let AnswerOutcome::Answer(_, whole) = caller.handle(Instant::ZERO, &last, &[2; 5]) else {
            panic!("the last fragment ends the call");
        };
        assert_eq!(whole.len(), 2 * FRAGMENT_LEN + 5);
    }

    #[test]
    fn an_answer_that_is_no_fragment_is_not_acknowledged() {
        let mut caller = calling();
        let request = sent(&mut caller).unwrap();
        let answer = Header { flags: 0, ..request.answer(Kind::Response) };
        assert!(matches!(caller.handle(Instant::ZERO, &answer, b"yes"), AnswerOutcome::Answer(..)));
        assert_eq!(sent(&mut caller), None);
    }

    #[test]
    fn a_reject_says_why() {
        let mut caller = calling();
        let request = sent(&mut caller).unwrap();
        let reject = request.answer(Kind::Reject);
        let heard = caller.handle(Instant::ZERO, &reject, &[0x1C, 0x01, 0x00, 0x03]);
        assert!(matches!(heard, AnswerOutcome::Refused(0x1C01_0003)));
        assert_eq!(caller.poll_timeout(), None);
    }
}
