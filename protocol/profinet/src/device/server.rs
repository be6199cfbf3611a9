//! The device as an RPC server: Connect, Release, Read, Write and Control; and as a client: its call ApplicationReady to the
//! controller.

use core::net::{Ipv4Addr, SocketAddrV4};

use super::admission::{Admission, admit};
use super::answers::{Call, RequestStatus};
use super::connect_report::ConnectReport;
use super::records::{Change, RECORD_CAPACITY, Records, Written, emit_write_answer};
use super::relation::{ALARM_REFERENCE, Endpoints, Relation, RelationPhase};
use super::{Core, closed_by_peer};
use crate::block::BlockReader;
use crate::connect::{
    AlarmCrResponse, ArProperties, ArResponse, ConnectRequest, ConnectResponse, Iocr, IocrResponse, IocrType,
};
use crate::control::{Command, Control};
use crate::record::{Address, LogEntry, PhysicalDevice, ReadRequest, ReadResponse, WriteRequest, index};
use crate::rpc::{
    CONTROLLER_INTERFACE, DEVICE_INTERFACE, ENDPOINT_MAPPER_INTERFACE, Header, Kind, Operation, RequestArgs,
    ResponseArgs, rpc_status,
};
use crate::rt::UDP_PORT;
use crate::status::{Service, Status, Violation};
use crate::{RPC_PORT, Uuid};
use machine::wire::Overflow;
use machine::{Instant, Peer, Requested, Sender};

/// MaxAlarmDataLength of the device: the smallest allowed.
const MAX_ALARM_DATA: u16 = 200;

/// The longest answer, in bytes of blocks, that the device accepts from the controller.
const MOST_ANSWER: u32 = 1308;

/// Returns whether calls to this interface are served here.
pub(super) fn is_served(interface: Uuid) -> bool {
    interface == DEVICE_INTERFACE || interface == ENDPOINT_MAPPER_INTERFACE
}

/// Returns the service that the status of a refusal names; `None` for an unknown operation.
const fn service(operation: Operation) -> Option<Service> {
    Some(match operation {
        Operation::Connect => Service::Connect,
        Operation::Release => Service::Release,
        Operation::Read | Operation::ReadImplicit => Service::Read,
        Operation::Write => Service::Write,
        Operation::Control => Service::Control,
        Operation::Unknown(_) => return None,
    })
}

impl Core {
    /// Handles a complete request.
    pub(super) fn handle_request(&mut self, now: Instant, from: SocketAddrV4, header: &Header, body: &[u8]) {
        let call = Call { now, request: header, body, from, controller: self.controller() };
        let status = self.answers.look_up(call);
        match status {
            RequestStatus::New | RequestStatus::Restarted => {}
            RequestStatus::Answered => return,
            RequestStatus::Old => {
                self.counters.foreign += 1;
                return;
            }
        }
        if header.interface == ENDPOINT_MAPPER_INTERFACE {
            return self.handle_lookup(call, body);
        }
        let operation = Operation::from(header.operation);
        let Some(service) = service(operation) else {
            self.counters.foreign += 1;
            return self.reply(header, Kind::Reject, Some(rpc_status::OPERATION_RANGE), from);
        };
        let args = match RequestArgs::parse(header, body) {
            Ok(args) => args,
            Err(violation) => {
                self.counters.malformed += 1;
                let answered = self.answers.answer(call, 0, violation.status(service), |_| {});
                return self.count_overflow(answered);
            }
        };
        let maximum = args.maximum;
        let result = match operation {
            Operation::Connect => self
                .connect(now, from, args.blocks)
                .map(|response| self.answers.answer(call, maximum, Status::OK, |w| response.emit(w))),
            Operation::Release | Operation::Control => {
                self.control(now, *from.ip(), operation, args.blocks).map(|control| {
                    let answered =
                        self.answers.answer(call, maximum, Status::OK, |w| control.emit_response(w));
                    self.after_control(now, control.command);
                    answered
                })
            }
            Operation::Write => self.write(now, call, &args),
            _ => self.read(now, call, &args),
        };
        if status == RequestStatus::Restarted
            && operation == Operation::Connect
            && matches!(result, Err(Violation::StateConflict))
        {
            // It is the Connect of the present AR, delayed.
            self.counters.foreign += 1;
            return;
        }
        let answered = result.unwrap_or_else(|violation| self.refuse(call, maximum, service, violation));
        self.count_overflow(answered);
    }

    /// Answers a request that is refused, and counts it.
    fn refuse(
        &mut self,
        call: Call<'_>,
        maximum: u32,
        service: Service,
        violation: Violation,
    ) -> Result<(), Overflow> {
        match violation {
            Violation::ArUuidUnknown | Violation::StateConflict | Violation::OutOfArResources => {
                self.counters.foreign += 1;
            }
            _ => self.counters.malformed += 1,
        }
        self.answers.answer(call, maximum, violation.status(service), |_| {})
    }

    /// Counts an answer that does not fit and therefore is not sent. No answer of ours is that long.
    pub(super) const fn count_overflow(&mut self, answered: Result<(), Overflow>) {
        if answered.is_err() {
            self.counters.malformed += 1;
        }
    }

    fn connect(
        &mut self,
        now: Instant,
        from: SocketAddrV4,
        blocks: &[u8],
    ) -> Result<ConnectResponse, Violation> {
        if self.is_foreign(*from.ip()) {
            // Refused without parsing it, which would allocate while data are exchanged.
            self.refuse_foreign(now, *from.ip(), Requested::Connection);
            return Err(Violation::OutOfArResources);
        }
        let parsed = ConnectRequest::parse(blocks);
        let result = match &parsed {
            Ok(request) => self.admit_controller(now, from, request),
            Err(violation) => Err(*violation),
        };
        self.last_connect = Some(ConnectReport::new(*from.ip(), parsed.ok(), &result));
        result
    }

    fn admit_controller(
        &mut self,
        now: Instant,
        from: SocketAddrV4,
        request: &ConnectRequest,
    ) -> Result<ConnectResponse, Violation> {
        let ar = &request.ar;
        let log = |violation: Violation| {
            self.log_book.add(LogEntry { at: now, ar: ar.uuid, status: violation.status(Service::Connect) });
            violation
        };
        let admission = admit(request, &self.description).map_err(log)?;
        let peer = Peer { address: Some(*from.ip()), mac: Some(ar.initiator_mac), serial_number: None };
        if !self.controllers.allows(peer) {
            self.report_foreign(now, Sender::Ip(*from.ip()), Requested::Connection, None);
            return Err(Violation::InitiatorMac);
        }
        if let Some(relation) = &self.relation {
            if (relation.uuid, relation.session) == (ar.uuid, ar.session) {
                return Err(Violation::StateConflict);
            }
            if relation.initiator_mac != ar.initiator_mac {
                self.refuse_foreign(now, *from.ip(), Requested::Connection);
                return Err(Violation::OutOfArResources);
            }
            // The controller restarted, and connects before its watchdog expired.
            self.end(now, closed_by_peer(Violation::ReRun.status(Service::Abort)));
        }
        let endpoints = Endpoints { mac: self.mac, controller: *from.ip() };
        let mut relation = Relation::new(now, &endpoints, &self.description, request, &admission);
        relation.set_inputs(&self.inputs);
        self.relation = Some(relation);
        Ok(self.connect_response(request, admission))
    }

    fn connect_response(&self, request: &ConnectRequest, admission: Admission<'_>) -> ConnectResponse {
        let ar = &request.ar;
        let iocr_response = |iocr: &Iocr| IocrResponse {
            iocr_type: iocr.iocr_type,
            reference: iocr.reference,
            frame_id: match iocr.iocr_type {
                IocrType::Output => admission.output_frame_id,
                _ => iocr.frame_id,
            },
        };
        let is_advanced = ar.properties.has(ArProperties::ADVANCED_STARTUP);
        ConnectResponse {
            ar: ArResponse {
                ar_type: ar.ar_type,
                uuid: ar.uuid,
                session: ar.session,
                responder_mac: self.mac,
                responder_rt_port: UDP_PORT,
            },
            iocrs: request.iocrs.iter().map(iocr_response).collect(),
            alarm_cr: Some(AlarmCrResponse {
                alarm_cr_type: admission.alarm_cr.alarm_cr_type,
                local_reference: ALARM_REFERENCE,
                max_data_length: MAX_ALARM_DATA.min(admission.alarm_cr.max_data_length),
            }),
            diff: admission.diff,
            server: is_advanced.then(|| self.station.name().to_vec()),
        }
    }

    /// Returns the IP address of the controller that has the AR.
    pub(super) fn controller(&self) -> Option<Ipv4Addr> {
        self.relation.as_ref().map(|relation| relation.controller)
    }

    /// Returns whether there is an AR with another controller.
    fn is_foreign(&self, from: Ipv4Addr) -> bool {
        self.controller().is_some_and(|controller| controller != from)
    }

    /// Returns the AR that a control block or record names, if the request comes from its controller.
    fn relation_of(
        &mut self,
        now: Instant,
        from: Ipv4Addr,
        uuid: Uuid,
        what: Requested,
    ) -> Result<&mut Relation, Violation> {
        if self.is_foreign(from) {
            self.refuse_foreign(now, from, what);
            return Err(Violation::ArUuidUnknown);
        }
        self.relation.as_mut().filter(|relation| relation.uuid == uuid).ok_or(Violation::ArUuidUnknown)
    }

    fn refuse_foreign(&mut self, now: Instant, from: Ipv4Addr, what: Requested) {
        // Only the MAC address distinguishes the controller from another station with its IP address.
        let owner = self.relation.as_ref().map(|relation| match relation.controller {
            controller if controller == from => Sender::Mac(relation.initiator_mac),
            controller => Sender::Ip(controller),
        });
        self.report_foreign(now, Sender::Ip(from), what, owner);
    }

    fn control(
        &mut self,
        now: Instant,
        from: Ipv4Addr,
        operation: Operation,
        blocks: &[u8],
    ) -> Result<Control, Violation> {
        let control = Control::parse_request(blocks)?;
        let belongs = match control.command {
            Command::Release => operation == Operation::Release,
            Command::PrmEnd | Command::PrmBegin | Command::PrmEndPlug { .. } => {
                operation == Operation::Control
            }
            Command::ApplicationReady | Command::ApplicationReadyPlug { .. } => false,
        };
        if !belongs {
            return Err(Violation::UnknownBlocks);
        }
        let what = if control.command == Command::Release { Requested::End } else { Requested::Step };
        let relation = self.relation_of(now, from, control.ar, what)?;
        if relation.session != control.session {
            return Err(control.command.wrong_session());
        }
        match control.command {
            Command::PrmEnd => relation.prm_end(now)?,
            Command::PrmBegin => relation.prm_begin(now)?,
            // No submodule of this device can be plugged.
            Command::PrmEndPlug { .. } => return Err(Violation::StateConflict),
            Command::ApplicationReady | Command::ApplicationReadyPlug { .. } | Command::Release => {}
        }
        Ok(control)
    }

    /// Executes a control block after it was answered.
    fn after_control(&mut self, now: Instant, command: Command) {
        match command {
            Command::PrmEnd => self.call_ready(),
            Command::Release => self.end(now, closed_by_peer(Status::OK)),
            Command::PrmBegin
            | Command::ApplicationReady
            | Command::PrmEndPlug { .. }
            | Command::ApplicationReadyPlug { .. } => {}
        }
    }

    fn write(
        &mut self,
        now: Instant,
        call: Call<'_>,
        args: &RequestArgs<'_>,
    ) -> Result<Result<(), Overflow>, Violation> {
        let write = WriteRequest::parse(&mut BlockReader::new(args.blocks))?;
        self.relation_of(now, *call.from.ip(), write.address.ar, Requested::Write)?.restart_step_timeout(now);
        let status = if write.address.index == index::MULTIPLE_WRITE {
            for part in write.writes() {
                if part?.address.index == index::MULTIPLE_WRITE {
                    return Err(Violation::RecordIndex);
                }
            }
            for part in write.writes().flatten() {
                self.apply(now, &part);
            }
            Status::OK
        } else {
            self.apply(now, &write)
        };
        let written = Written { description: &self.description, maintenance: self.station.maintenance() };
        Ok(self.answers.answer(call, args.maximum, status, |w| {
            emit_write_answer(written, &write, status, w);
        }))
    }

    /// Executes the Write of one record.
    fn apply(&mut self, now: Instant, write: &WriteRequest<'_>) -> Status {
        let written = Written { description: &self.description, maintenance: self.station.maintenance() };
        match written.change(write) {
            Ok(Change::Maintenance(maintenance)) => {
                if self.station.set_maintenance(maintenance) {
                    self.ask_to_store();
                }
                Status::OK
            }
            Ok(Change::Physical(block)) => {
                if let Some(relation) = &mut self.relation {
                    let Address { slot, subslot, index, .. } = write.address;
                    relation.physical.write(slot, subslot, index, block);
                    let naming = relation.physical.naming();
                    self.set_naming(now, naming);
                }
                Status::OK
            }
            Ok(Change::Parameter) => Status::OK,
            Err(violation) => violation.status(Service::Write),
        }
    }

    fn read(
        &mut self,
        now: Instant,
        call: Call<'_>,
        args: &RequestArgs<'_>,
    ) -> Result<Result<(), Overflow>, Violation> {
        let read = ReadRequest::parse(&mut BlockReader::new(args.blocks))?;
        if Operation::from(call.request.operation) == Operation::Read {
            self.relation_of(now, *call.from.ip(), read.address.ar, Requested::Read)?
                .restart_step_timeout(now);
        }
        let mut record = [0; RECORD_CAPACITY];
        let found = self.records(now).read(&read, &mut record);
        let (status, len) = match found {
            Ok(len) => (Status::OK, len),
            Err(violation) => (violation.status(Service::Read), 0),
        };
        let record = record.get(..len).unwrap_or_default();
        Ok(self.answers.answer(call, args.maximum, status, |w| {
            ReadResponse { address: read.address, record }.emit(w);
        }))
    }

    fn records(&self, now: Instant) -> Records<'_> {
        Records {
            description: &self.description,
            maintenance: self.station.maintenance(),
            relation: self.relation.as_ref(),
            physical: PhysicalDevice {
                name: self.station.name(),
                mac: self.mac,
                ip: self.station.ip(),
                neighbour: self.station.neighbour(),
            },
            log_book: &self.log_book,
            diagnosis: &self.diagnosis,
            now,
        }
    }

    /// Calls ApplicationReady of the controller.
    fn call_ready(&mut self) {
        let Some(relation) = &self.relation else { return };
        self.calls = self.calls.wrapping_add(1);
        let activity = self.activity();
        let header =
            Header::request(Operation::Control, relation.initiator_object, CONTROLLER_INTERFACE, activity, 0);
        let control = relation.control(Command::ApplicationReady);
        let written =
            self.call.set(header, |body| RequestArgs::emit(MOST_ANSWER, body, |w| control.emit_request(w)));
        self.count_overflow(written);
        let Some(relation) = &self.relation else { return };
        self.call_to = Some(SocketAddrV4::new(relation.controller, RPC_PORT));
    }

    /// Returns a new activity for every call: the count, the device's start time, its MAC address.
    fn activity(&self) -> Uuid {
        let [a, b, c, d] = self.calls.to_be_bytes();
        let [.., e, f, g, h] = (self.start.as_nanos() / 1_000).to_be_bytes();
        let [i, j, k, l, m, n] = self.mac.0;
        // Version 1 and the usual variant, as a UUID that is made from time and node.
        Uuid([a, b, c, d, e, f, 0x10 | g >> 4, h, 0x80, 0, i, j, k, l, m, n])
    }

    /// Handles the controller's answer to ApplicationReady.
    pub(super) fn handle_response(&mut self, now: Instant, from: SocketAddrV4, header: &Header, body: &[u8]) {
        if self.is_foreign(*from.ip()) {
            self.counters.foreign += 1;
            return self.refuse_foreign(now, *from.ip(), Requested::Step);
        }
        let Some(relation) = &mut self.relation else {
            self.counters.foreign += 1;
            return;
        };
        let is_ours = self.call.header().is_some_and(|call| call.is_same_call(header));
        if !is_ours || !matches!(relation.phase, RelationPhase::Ready { .. }) {
            self.counters.foreign += 1;
            return;
        }
        let Ok(args) = ResponseArgs::parse(header, body) else {
            self.counters.malformed += 1;
            return;
        };
        if !args.status.is_ok() {
            self.call.clear();
            self.abort(now, Violation::RpcClientError);
            return;
        }
        let wanted = relation.control(Command::ApplicationReady);
        match Control::parse_response(args.blocks) {
            Ok(control)
                if (control.command, control.ar, control.session)
                    == (wanted.command, wanted.ar, wanted.session) =>
            {
                self.call.clear();
                relation.handle_confirmation(now);
                self.report_up();
            }
            Ok(_) => self.counters.foreign += 1,
            Err(_) => self.counters.malformed += 1,
        }
    }
}
