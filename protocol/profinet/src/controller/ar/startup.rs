//! The steps from the search to data exchange, and the Release.

use alloc::vec::Vec;

use rand_core::Rng;

use super::acyclic::Acyclic;
use super::call::{AnswerOutcome, LONGEST_ANSWER};
use super::connect_plan::PlanChanges;
use super::link::CyclicLink;
use super::{
    Ar, ArPhase, PAUSE, READY_WITHIN, RELEASED_WITHIN, Refusal, SILENT_READY_WITHIN, commissioning,
    down_reasons, multiple_write, random_uuid,
};
use crate::Uuid;
use crate::block::{BlockReader, BlockWriter};
use crate::connect::{self, ConnectResponse};
use crate::control::{Command, Control};
use crate::dcp::Pdu;
use crate::record::{Address, PhysicalParameters, WriteRequest, WriteResponse, index};
use crate::rpc::{self, Header, Operation, RequestArgs, ResponseArgs};
use crate::status::{Service, Status, Violation};
use machine::Instant;
use machine::ethernet::Mac;
use machine::wire::Overflow;
use machine::{Down, DownCause, LinkEvent};

impl Ar {
    /// Starts an attempt to connect: searches for the device.
    pub(super) fn start_attempt(&mut self, now: Instant) {
        self.phase = ArPhase::Searching;
        self.diff.clear();
        self.instance.begin();
        self.changes = PlanChanges::default();
        self.discovery.begin(now, self.random.next_u32());
    }

    /// Handles a DCP answer or a Hello. Returns whether it belongs to this AR.
    pub(in super::super) fn handle_dcp(&mut self, now: Instant, from: Mac, pdu: &Pdu<'_>) -> bool {
        self.acyclic = Acyclic::Active;
        if self.discovery.is_hello(pdu) {
            return self.handle_hello(now, from);
        }
        let progress = self.discovery.handle(now, from, pdu);
        self.progress(now, progress)
    }

    /// Handles the Hello of a station of the device's name: it has come up, and can be searched for.
    fn handle_hello(&mut self, now: Instant, from: Mac) -> bool {
        let is_other = self.phase == ArPhase::Exchanging && self.discovery.device() != Some(from);
        if self.discovery.is_excluded(from) || is_other {
            if self.discovery.ignore(from) {
                self.report_ignored(from);
            }
            return false;
        }
        // However many Hellos come, a pause is not shorter than the first one.
        if let ArPhase::Pausing { until } = &mut self.phase {
            *until = (*until).min(now + PAUSE);
        }
        true
    }

    pub(super) fn connect(&mut self, now: Instant) {
        let activity = random_uuid(&mut self.random);
        self.caller.begin(activity, rpc::object(self.instance.number(), self.config.description.identity));
        // ARUUID and alarm endpoint stay the same for all connections of an AR; only the session key differs
        // (IEC 61158-6-10, CMInitiator).
        let request = &mut self.plan.connect;
        request.ar.session = request.ar.session.wrapping_add(1);
        let request = &self.plan.connect;
        let called = self.caller.call(now, Operation::Connect, |body| {
            RequestArgs::emit(LONGEST_ANSWER, body, |writer| request.emit(writer))
        });
        self.phase = ArPhase::Connecting;
        if called.is_err() {
            self.refuse(now, Refusal { code: 0, text: down_reasons::TOO_LONG });
        }
    }

    /// Handles a PDU of the device about one of our calls. Returns whether it belongs to this AR.
    pub(in super::super) fn handle_answer(&mut self, now: Instant, header: &Header, body: &[u8]) -> bool {
        self.acyclic = Acyclic::Active;
        let awaits_record = self.awaits_record();
        let answered = match self.caller.handle(now, header, body) {
            AnswerOutcome::Pending => return true,
            AnswerOutcome::Foreign => return false,
            // Whatever the answer, the connection has ended.
            AnswerOutcome::Refused(_) | AnswerOutcome::Answer(..)
                if matches!(self.phase, ArPhase::Releasing { .. }) =>
            {
                self.stop();
                return true;
            }
            // Whatever the answer, the submodule's diagnosis and provider status say the rest.
            AnswerOutcome::Refused(code) if awaits_record => {
                self.record_answered(now, Err(Status(code)));
                return true;
            }
            AnswerOutcome::Answer(header, body) if awaits_record => {
                let args = ResponseArgs::parse(&header, body);
                let record = args.map_or(Err(Status(0)), |args| commissioning::record_of(&args));
                self.record_answered(now, record);
                return true;
            }
            AnswerOutcome::Refused(_) | AnswerOutcome::Answer(..) if self.phase == ArPhase::Exchanging => {
                self.plug_answered(now);
                return true;
            }
            AnswerOutcome::Refused(code)
                if self.phase == ArPhase::Connecting
                    && self.instance.reject(code, self.discovery.instance()) =>
            {
                self.connect(now);
                return true;
            }
            AnswerOutcome::Refused(code) => Err(Some(Refusal { code, text: down_reasons::REJECTED })),
            AnswerOutcome::Answer(header, body) => match ResponseArgs::parse(&header, body) {
                Ok(args) if args.status.is_ok() => {
                    read(self.phase, args.blocks, &self.plan.connect.ar).map_err(Some)
                }
                Ok(args)
                    if self.phase == ArPhase::Connecting
                        && self.plan.change(&mut self.changes, args.status) =>
                {
                    // An analyser reports another FrameID under the same ARUUID as a fault.
                    self.plan.connect.ar.uuid = random_uuid(&mut self.random);
                    self.connect(now);
                    return true;
                }
                Ok(args) => Err(Some(Refusal { code: args.status.0, text: args.status.text() })),
                Err(_) => Err(None),
            },
        };
        match answered {
            Ok(answer) => self.continue_startup(now, answer),
            // A device that is ready has executed PrmEnd. It refuses a repetition, since its answer was lost.
            Err(_) if self.phase == (ArPhase::EndingParameters { ready: true }) => self.exchange(now),
            Err(Some(refusal)) if self.goes_on_without_record(now, refusal) => {}
            Err(refusal) => {
                let unfit = Refusal { code: 0, text: down_reasons::UNFIT_ANSWER };
                self.counters.malformed += u64::from(refusal.is_none());
                self.refuse(now, refusal.unwrap_or(unfit));
            }
        }
        true
    }

    /// Takes the next step after a positive answer.
    fn continue_startup(&mut self, now: Instant, answer: Answer) {
        match (self.phase, answer) {
            (ArPhase::Connecting, Answer::Connected(granted)) => self.connected(now, granted),
            (ArPhase::Writing { end, .. }, Answer::Done) => self.write(now, end),
            (ArPhase::Writing { parameter, end }, Answer::Written(statuses)) => {
                match self.refused_of_several(parameter, end, &statuses) {
                    None => self.write(now, end),
                    Some(refusal) => self.refuse(now, refusal),
                }
            }
            (ArPhase::EndingParameters { ready: true }, Answer::Done) => self.exchange(now),
            (ArPhase::EndingParameters { ready: false }, Answer::Done) => self.await_ready(now),
            _ => {}
        }
    }

    fn connected(&mut self, now: Instant, granted: ConnectResponse) {
        // Calls go to an IP address: who answered says who has it.
        let responder = granted.ar.responder_mac;
        if responder.is_group() {
            return self.refuse(now, Refusal { code: 0, text: down_reasons::UNFIT_ANSWER });
        }
        if self.discovery.device() != Some(responder) {
            return self.refuse_responder(now, responder);
        }
        let macs = (self.own, responder);
        let link = match CyclicLink::new(now, macs, &self.config, &self.plan, &self.output, &granted) {
            Ok(link) => link,
            Err(refusal) => return self.refuse(now, refusal),
        };
        self.link = Some(link);
        self.diff = granted.diff;
        if let Some(refusal) = self.unusable() {
            return self.refuse(now, refusal);
        }
        self.write(now, 0);
    }

    /// Writes the parameter record of this index; after the last one, calls PrmEnd.
    fn write(&mut self, now: Instant, index: usize) {
        let index = self.next_parameter(index);
        if index >= self.config.parameters.len() {
            self.phase = ArPhase::EndingParameters { ready: false };
            return self.control(now, Operation::Control, Command::PrmEnd);
        }
        let end = self.together_from(index);
        self.phase = ArPhase::Writing { parameter: index, end };
        let called = if end > index + 1 {
            self.call_multiple_write(now, index, end)
        } else {
            self.call_write(now, index)
        };
        if called.is_err() {
            self.refuse(now, Refusal { code: 0, text: down_reasons::TOO_LONG });
        }
    }

    /// Goes on after a Write that the device refused as a whole, if it can: records that were written together are written one by
    /// one, and a single one may not be needed.
    fn goes_on_without_record(&mut self, now: Instant, refusal: Refusal) -> bool {
        let ArPhase::Writing { parameter, end } = self.phase else { return false };
        if end > parameter + 1 {
            self.commissioning.writes_together = false;
            self.write(now, parameter);
            return true;
        }
        let goes_on =
            self.is_dispensable(parameter, refusal) || self.notes_refused_record(parameter, refusal);
        if goes_on {
            self.write(now, end);
        }
        goes_on
    }

    /// Returns whether the device refuses a record of an index that only describes how its interface is used: older stacks do not have
    /// PDInterfaceAdjust, and exchange data all the same.
    pub(super) fn is_dispensable(&self, parameter: usize, Refusal { code, .. }: Refusal) -> bool {
        let record = self.config.parameters.get(parameter);
        record.is_some_and(|record| PhysicalParameters::has(record.subslot, record.index))
            && Status(code).is_access_error()
    }

    /// Calls Write for the parameter record of this index.
    pub(super) fn call_write(&mut self, now: Instant, index: usize) -> Result<(), Overflow> {
        let Some(parameter) = self.config.parameters.get(index) else { return Ok(()) };
        let request = WriteRequest {
            address: Address {
                sequence: u16::try_from(index).unwrap_or(u16::MAX),
                ar: self.plan.connect.ar.uuid,
                api: connect::API,
                slot: parameter.slot,
                subslot: parameter.subslot,
                index: parameter.index,
            },
            record: &parameter.data,
        };
        self.caller.call(now, Operation::Write, |body| {
            RequestArgs::emit(LONGEST_ANSWER, body, |writer| request.emit(writer))
        })
    }

    pub(super) fn control(&mut self, now: Instant, operation: Operation, command: Command) {
        let ar = &self.plan.connect.ar;
        let control = Control { command, ar: ar.uuid, session: ar.session, properties: 0 };
        let write = |writer: &mut BlockWriter<'_>| control.emit_request(writer);
        let called = self.caller.call(now, operation, |body| RequestArgs::emit(LONGEST_ANSWER, body, write));
        debug_assert!(called.is_ok(), "32 bytes fit into a call");
    }

    /// Returns ARUUID and SessionKey while the device may call.
    pub(in super::super) fn expects_call(&self) -> Option<(Uuid, u16)> {
        let ar = &self.plan.connect.ar;
        let expects = matches!(
            self.phase,
            ArPhase::EndingParameters { .. } | ArPhase::AwaitingReady { .. } | ArPhase::Exchanging
        );
        expects.then_some((ar.uuid, ar.session))
    }

    /// Handles ApplicationReady: the device is ready for cyclic data. `blocks` are those of the call.
    pub(in super::super) fn application_ready(&mut self, now: Instant, blocks: &[u8]) {
        self.acyclic = Acyclic::Active;
        if matches!(self.phase, ArPhase::EndingParameters { .. } | ArPhase::AwaitingReady { .. }) {
            // What the device says of its modules now counts, and not what it said in its answer to Connect.
            match connect::parse_module_diff(blocks) {
                Ok(Some(diff)) => self.diff = diff,
                Ok(None) => {}
                Err(_) => self.counters.malformed += 1,
            }
            if let Some(refusal) = self.unusable() {
                return self.refuse(now, refusal);
            }
        }
        match self.phase {
            ArPhase::EndingParameters { .. } => self.phase = ArPhase::EndingParameters { ready: true },
            ArPhase::AwaitingReady { .. } => self.exchange(now),
            _ => {}
        }
    }

    fn await_ready(&mut self, now: Instant) {
        self.phase =
            ArPhase::AwaitingReady { until: now + READY_WITHIN, silent_until: now + SILENT_READY_WITHIN };
        if let Some(link) = &mut self.link {
            link.receiver.restart_watchdog(now);
        }
    }

    fn exchange(&mut self, now: Instant) {
        self.phase = ArPhase::Exchanging;
        if let Some(link) = &mut self.link {
            link.accept_input(&self.plan);
            link.receiver.restart_watchdog(now);
        }
        self.continue_plug(now);
    }

    /// Handles a call that the device did not answer.
    pub(super) fn give_up_call(&mut self, now: Instant) {
        if matches!(self.phase, ArPhase::Releasing { .. }) {
            return self.stop();
        }
        if self.phase == (ArPhase::EndingParameters { ready: true }) {
            return self.exchange(now);
        }
        if self.awaits_record() {
            return self.record_answered(now, Err(Status(0)));
        }
        if self.phase == ArPhase::Exchanging {
            return self.plug_answered(now);
        }
        let down = Down { cause: DownCause::NoAnswer, code: 0, text: self.no_answer() };
        self.fail(now, down, Some(Violation::InitiatorTimeout.status(Service::Abort)));
    }

    /// Ends the attempt: the device answers, but cannot be used.
    pub(super) fn refuse(&mut self, now: Instant, Refusal { code, text }: Refusal) {
        let down = Down { cause: DownCause::Refused, code, text };
        self.fail(now, down, Some(Violation::ArRemoved.status(Service::Abort)));
    }

    /// Ends the AR as the standard requires.
    pub(super) fn release(&mut self, now: Instant) {
        if matches!(self.phase, ArPhase::Stopped | ArPhase::Releasing { .. }) {
            return;
        }
        self.up = false;
        self.silent_at = None;
        self.discovery.stop();
        self.give_up_record();
        self.caller.cancel();
        if self.link.is_none() {
            return self.stop();
        }
        self.drop_link();
        self.phase = ArPhase::Releasing { until: now + RELEASED_WITHIN };
        self.control(now, Operation::Release, Command::Release);
    }

    pub(super) fn stop(&mut self) {
        self.caller.cancel();
        self.phase = ArPhase::Stopped;
        let down = Down { cause: DownCause::ClosedHere, code: 0, text: "" };
        self.events.push_back(LinkEvent::Down(down));
    }
}

/// Content of a positive answer.
enum Answer {
    Connected(ConnectResponse),
    Done,
    /// The status of each record of a MultipleWrite.
    Written(Vec<Status>),
}

/// Reads the blocks of an answer in this phase, and checks that they are about this AR.
fn read(phase: ArPhase, blocks: &[u8], ar: &connect::Ar) -> Result<Answer, Refusal> {
    let unfit = Refusal { code: 0, text: down_reasons::UNFIT_ANSWER };
    let control = |command| match Control::parse_response(blocks) {
        Ok(done) if (done.command, done.ar, done.session) == (command, ar.uuid, ar.session) => {
            Ok(Answer::Done)
        }
        _ => Err(unfit),
    };
    match phase {
        ArPhase::Connecting => ConnectResponse::parse(blocks).map(Answer::Connected).map_err(|_| unfit),
        ArPhase::Writing { .. } => match WriteResponse::parse(&mut BlockReader::new(blocks)) {
            Ok(written) if written.address.ar != ar.uuid => Err(unfit),
            Ok(written) if written.status.is_ok() && written.address.index == index::MULTIPLE_WRITE => {
                multiple_write::statuses(blocks, ar.uuid).map(Answer::Written).ok_or(unfit)
            }
            Ok(written) if written.status.is_ok() => Ok(Answer::Done),
            Ok(written) => Err(Refusal { code: written.status.0, text: written.status.text() }),
            Err(_) => Err(unfit),
        },
        ArPhase::EndingParameters { .. } => control(Command::PrmEnd),
        _ => Ok(Answer::Done),
    }
}
