//! The steps from an unknown station to data exchange, and back.

use rand_core::Rng;

use super::acyclic::Acyclic;
use super::call::AnswerOutcome;
use super::discovery::Progress;
use super::link::{Link, unusable};
use super::{Ar, Phase, READY_WITHIN, RELEASED_WITHIN, Refusal, down_reasons, random_uuid};
use crate::Uuid;
use crate::block::{BlockReader, BlockWriter};
use crate::connect::{self, ConnectResponse};
use crate::control::{Command, Control};
use crate::dcp::Pdu;
use crate::record::{Address, WriteRequest, WriteResponse};
use crate::rpc::{Header, Operation, RequestArgs, ResponseArgs};
use crate::status::{Service, Violation};
use machine::Instant;
use machine::ethernet::Mac;
use machine::{Down, DownCause, LinkEvent};

/// ArgsMaximum: the longest answer, in bytes of blocks, that we take.
const LONGEST_ANSWER: u32 = 4096;

impl Ar {
    /// Starts an attempt.
    pub(super) fn look(&mut self, now: Instant) {
        self.phase = Phase::Looking;
        self.diff.clear();
        self.discovery.begin(now, self.random.next_u32());
    }

    /// Takes an answer to DCP. Returns whether it belongs to this AR.
    pub(in super::super) fn handle_dcp(&mut self, now: Instant, from: Mac, pdu: &Pdu<'_>) -> bool {
        self.acyclic = Acyclic::Active;
        match self.discovery.handle(now, from, pdu) {
            Progress::Found(_) if self.phase == Phase::Looking => self.connect(now),
            Progress::Refused(refusal) if self.phase == Phase::Looking => self.refuse(now, refusal),
            Progress::Pending | Progress::Found(_) => {}
            // Once the device is called, another station of its name is no reason to stop.
            Progress::Refused(_) | Progress::Foreign => return false,
        }
        true
    }

    fn connect(&mut self, now: Instant) {
        let activity = random_uuid(&mut self.random);
        self.caller.begin(activity);
        // A controller that starts anew keeps its AR, and so its ARUUID and its alarm endpoint; the session key alone
        // tells one connection of the AR from the next (IEC 61158-6-10, CMInitiator).
        let request = &mut self.plan.connect;
        request.ar.session = request.ar.session.wrapping_add(1);
        let request = &self.plan.connect;
        let called = self.caller.call(now, Operation::Connect, |body| {
            RequestArgs::emit(LONGEST_ANSWER, body, |writer| request.emit(writer))
        });
        self.phase = Phase::Connecting;
        if called.is_err() {
            self.refuse(now, Refusal { code: 0, text: down_reasons::TOO_LONG });
        }
    }

    /// Takes an answer of the device, or a report on a call of ours. Returns whether it belongs to this AR.
    pub(in super::super) fn handle_answer(&mut self, now: Instant, header: &Header, body: &[u8]) -> bool {
        self.acyclic = Acyclic::Active;
        let answered = match self.caller.handle(now, header, body) {
            AnswerOutcome::Pending => return true,
            AnswerOutcome::Foreign => return false,
            AnswerOutcome::Refused(code) => Err(Some(Refusal { code, text: down_reasons::REJECTED })),
            AnswerOutcome::Answer(header, body) => match ResponseArgs::parse(&header, body) {
                Ok(args) if args.status.is_ok() => {
                    read(self.phase, args.blocks, &self.plan.connect.ar).map_err(Some)
                }
                Ok(args) => Err(Some(Refusal { code: args.status.0, text: args.status.text() })),
                Err(_) => Err(None),
            },
        };
        match answered {
            Ok(answer) => self.go_on(now, answer),
            Err(_) if matches!(self.phase, Phase::Releasing { .. }) => self.stop(),
            Err(refusal) => {
                let unfit = Refusal { code: 0, text: down_reasons::UNFIT_ANSWER };
                self.counters.malformed += u64::from(refusal.is_none());
                self.refuse(now, refusal.unwrap_or(unfit));
            }
        }
        true
    }

    /// Takes the next step after a good answer.
    fn go_on(&mut self, now: Instant, answer: Answer) {
        match (self.phase, answer) {
            (Phase::Connecting, Answer::Connected(granted)) => self.connected(now, granted),
            (Phase::Writing { parameter }, Answer::Done) => self.write(now, parameter + 1),
            (Phase::Ending { ready: true }, Answer::Done) => self.exchange(now),
            (Phase::Ending { ready: false }, Answer::Done) => {
                self.phase = Phase::Readying { until: now + READY_WITHIN };
            }
            (Phase::Releasing { .. }, _) => self.stop(),
            _ => {}
        }
    }

    fn connected(&mut self, now: Instant, granted: ConnectResponse) {
        let macs = (self.own, self.discovery.device());
        let link = match Link::new(now, macs, &self.config, &self.plan, &self.output, &granted) {
            Ok(link) => link,
            Err(refusal) => return self.refuse(now, refusal),
        };
        self.link = Some(link);
        self.diff = granted.diff;
        if let Some(refusal) = unusable(&self.diff) {
            return self.refuse(now, refusal);
        }
        self.write(now, 0);
    }

    /// Writes the parameter record of this index, or ends the parameters if there is none.
    fn write(&mut self, now: Instant, index: usize) {
        let ar = self.plan.connect.ar.uuid;
        let Some(parameter) = self.config.parameters.get(index) else {
            self.phase = Phase::Ending { ready: false };
            return self.control(now, Operation::Control, Command::PrmEnd);
        };
        let request = WriteRequest {
            address: Address {
                sequence: u16::try_from(index).unwrap_or(u16::MAX),
                ar,
                api: connect::API,
                slot: parameter.slot,
                subslot: parameter.subslot,
                index: parameter.index,
            },
            record: &parameter.data,
        };
        self.phase = Phase::Writing { parameter: index };
        let called = self.caller.call(now, Operation::Write, |body| {
            RequestArgs::emit(LONGEST_ANSWER, body, |writer| request.emit(writer))
        });
        if called.is_err() {
            self.refuse(now, Refusal { code: 0, text: down_reasons::TOO_LONG });
        }
    }

    fn control(&mut self, now: Instant, operation: Operation, command: Command) {
        let ar = &self.plan.connect.ar;
        let control = Control { command, ar: ar.uuid, session: ar.session, properties: 0 };
        let write = |writer: &mut BlockWriter<'_>| control.emit_request(writer);
        let called = self.caller.call(now, operation, |body| RequestArgs::emit(LONGEST_ANSWER, body, write));
        debug_assert!(called.is_ok(), "32 bytes fit into a call");
    }

    /// Returns ARUUID and SessionKey while the device may call.
    pub(in super::super) fn expects_call(&self) -> Option<(Uuid, u16)> {
        let ar = &self.plan.connect.ar;
        let expects = matches!(self.phase, Phase::Ending { .. } | Phase::Readying { .. } | Phase::Exchanging);
        expects.then_some((ar.uuid, ar.session))
    }

    /// Handles ApplicationReady: the device is ready for cyclic data.
    pub(in super::super) fn application_ready(&mut self, now: Instant) {
        self.acyclic = Acyclic::Active;
        match self.phase {
            Phase::Ending { .. } => self.phase = Phase::Ending { ready: true },
            Phase::Readying { .. } => self.exchange(now),
            _ => {}
        }
    }

    fn exchange(&mut self, now: Instant) {
        self.phase = Phase::Exchanging;
        if let Some(link) = &mut self.link {
            link.accept_input(&self.plan);
            link.receiver.rearm(now);
        }
    }

    /// Handles a call that the device did not answer.
    pub(super) fn give_up_call(&mut self, now: Instant) {
        if matches!(self.phase, Phase::Releasing { .. }) {
            return self.stop();
        }
        let down = Down { cause: DownCause::NoAnswer, code: 0, text: down_reasons::NO_RPC };
        self.fail(now, down, Some(Violation::InitiatorTimeout.status(Service::Abort)));
    }

    /// Refuses a device that is there but cannot be driven.
    fn refuse(&mut self, now: Instant, Refusal { code, text }: Refusal) {
        let down = Down { cause: DownCause::Refused, code, text };
        self.fail(now, down, Some(Violation::ArRemoved.status(Service::Abort)));
    }

    /// Ends the AR as the standard wants it.
    pub(super) fn release(&mut self, now: Instant) {
        if matches!(self.phase, Phase::Stopped | Phase::Releasing { .. }) {
            return;
        }
        self.up = false;
        self.silent_at = None;
        self.discovery.stop();
        self.caller.cancel();
        if self.link.is_none() {
            return self.stop();
        }
        self.drop_link();
        self.phase = Phase::Releasing { until: now + RELEASED_WITHIN };
        self.control(now, Operation::Release, Command::Release);
    }

    pub(super) fn stop(&mut self) {
        self.caller.cancel();
        self.phase = Phase::Stopped;
        let down = Down { cause: DownCause::ClosedHere, code: 0, text: "" };
        self.events.push_back(LinkEvent::Down(down));
    }
}

/// What a good answer says.
enum Answer {
    Connected(ConnectResponse),
    Done,
}

/// Reads the blocks of an answer in this phase, and checks that they are about this AR.
fn read(phase: Phase, blocks: &[u8], ar: &connect::Ar) -> Result<Answer, Refusal> {
    let unfit = Refusal { code: 0, text: down_reasons::UNFIT_ANSWER };
    let control = |command| match Control::parse_response(blocks) {
        Ok(done) if (done.command, done.ar, done.session) == (command, ar.uuid, ar.session) => {
            Ok(Answer::Done)
        }
        _ => Err(unfit),
    };
    match phase {
        Phase::Connecting => ConnectResponse::parse(blocks).map(Answer::Connected).map_err(|_| unfit),
        Phase::Writing { .. } => match WriteResponse::parse(&mut BlockReader::new(blocks)) {
            Ok(written) if written.address.ar != ar.uuid => Err(unfit),
            Ok(written) if written.status.is_ok() => Ok(Answer::Done),
            Ok(written) => Err(Refusal { code: written.status.0, text: written.status.text() }),
            Err(_) => Err(unfit),
        },
        Phase::Ending { .. } => control(Command::PrmEnd),
        Phase::Releasing { .. } => control(Command::Release),
        _ => Ok(Answer::Done),
    }
}
