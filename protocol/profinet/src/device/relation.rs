//! The application relation: one controller's connection, from its Connect to its end.
//!
//! ```text
//! Connect ──▶ Parameters ── PrmEnd ──▶ Ready ── ApplicationReady confirmed ──▶ Data
//! ```
//!
//! The device sends cyclic frames from the Connect on, with bad statuses until PrmEnd. The watchdog runs from the first
//! received frame on. Before that, and between the steps, the controller's activity timeout runs.

use alloc::vec::Vec;
use core::net::{Ipv4Addr, SocketAddrV4};

use super::admission::{Admission, transport};
use super::alarms::AlarmEndpoint;
use super::outgoing::OutgoingAlarms;
use super::process_data::ProcessData;
use crate::Uuid;
use crate::connect::{
    AlarmCr, Ar, ConnectRequest, DiffModule, ExpectedModule, ExpectedSubmodule, Iocr, Object,
};
use crate::control::{Command, Control};
use crate::description::Description;
use crate::provided::Provided;
use crate::record::{ArData, IoData, IocrData, PhysicalParameters};
use crate::rt::{
    CyclicReceiver, CyclicSender, IoxStatus, MAX_C_SDU_LEN, Received, Route, Transport, UDP_PORT,
};
use crate::status::Violation;
use machine::ethernet::Mac;
use machine::{Duration, Instant};

/// LocalAlarmReference of the device. It is the same in every AR: a controller may keep its ARUUID from session to session,
/// and an analyser reports another reference with the same ARUUID as a fault.
pub(super) const ALARM_REFERENCE: u16 = 0;

/// When ApplicationReady is repeated for the first time; the interval doubles each time.
const FIRST_REPETITION: Duration = Duration::from_millis(200);

/// State of the connection.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum RelationPhase {
    /// Parameters may be written, until PrmEnd.
    Parameters,
    /// ApplicationReady was sent; the controller has not confirmed it.
    Ready {
        /// When the call is repeated.
        repeat: Instant,
        /// Time until the repetition after that.
        interval: Duration,
    },
    /// Data are exchanged.
    Data,
}

/// The two ends of an AR.
#[derive(Clone, Copy, Debug)]
pub(super) struct Endpoints {
    /// MAC address of the device.
    pub(super) mac: Mac,
    /// IP address of the controller.
    pub(super) controller: Ipv4Addr,
}

/// One AR.
#[derive(Debug)]
pub(super) struct Relation {
    pub(super) uuid: Uuid,
    pub(super) session: u16,
    pub(super) initiator_mac: Mac,
    pub(super) initiator_object: Uuid,
    pub(super) controller: Ipv4Addr,
    pub(super) phase: RelationPhase,
    /// Whether the exchange of data was reported.
    pub(super) is_up: bool,
    pub(super) sender: CyclicSender,
    pub(super) receiver: CyclicReceiver,
    pub(super) alarms: AlarmEndpoint,
    /// What the controller wrote to the interface and the ports.
    pub(super) physical: PhysicalParameters,
    step_time: Duration,
    step_deadline: Option<Instant>,
    consumes: Transport,
    process: ProcessData,
    is_output_good: bool,
    expected: Vec<ExpectedModule>,
    diff: Vec<DiffModule>,
    /// The controller's description of itself.
    initiator: Ar,
    /// The input and the output IOCR, with the FrameIDs in use.
    iocrs: [Iocr; 2],
    alarm_reference: u16,
}

impl Relation {
    /// Creates the AR for an admitted Connect.
    pub(super) fn new(
        now: Instant,
        endpoints: &Endpoints,
        description: &Description,
        request: &ConnectRequest,
        admission: &Admission<'_>,
    ) -> Self {
        let Endpoints { mac, controller } = *endpoints;
        let ConnectRequest { ar, expected, .. } = request;
        let Admission { input, output, alarm_cr, output_frame_id, diff } = admission;
        let route = |transport| match transport {
            Transport::Rt1 => Route::Ethernet { source: mac, destination: ar.initiator_mac },
            Transport::Udp => Route::Udp(SocketAddrV4::new(controller, ar.initiator_rt_port)),
        };
        let process = ProcessData::new(description, expected, diff, input, output);
        let input_time = input.cycle_time();
        let input_route = route(transport(input));
        let mut sender = CyclicSender::new(
            input_route,
            input.frame_id,
            input_time,
            usize::from(input.data_length),
            input_time.first(now, mac),
        );
        process.write_statuses(false, sender.c_sdu_mut());
        let output_time = output.cycle_time();
        let receiver = CyclicReceiver::new(
            *output_frame_id,
            output_time,
            usize::from(output.data_length),
            output_time.multiplied(output.data_hold_factor),
            now,
        );
        let alarm_route = if alarm_cr.properties & AlarmCr::OVER_UDP != 0 {
            route(Transport::Udp)
        } else {
            route(Transport::Rt1)
        };
        let step_time = Duration::from_millis(100 * u64::from(ar.activity_timeout));
        Self {
            uuid: ar.uuid,
            session: ar.session,
            initiator_mac: ar.initiator_mac,
            initiator_object: ar.initiator_object,
            controller,
            phase: RelationPhase::Parameters,
            is_up: false,
            sender,
            receiver,
            alarms: AlarmEndpoint::new(
                alarm_route,
                ALARM_REFERENCE,
                alarm_cr.local_reference,
                OutgoingAlarms::new(
                    Duration::from_millis(100 * u64::from(alarm_cr.rta_timeout)),
                    alarm_cr.rta_retries,
                ),
            ),
            physical: PhysicalParameters::new(description),
            step_time,
            step_deadline: Some(now + step_time),
            consumes: transport(output),
            process,
            is_output_good: false,
            expected: expected.clone(),
            diff: diff.clone(),
            initiator: ar.clone(),
            iocrs: [(*input).clone(), Iocr { frame_id: *output_frame_id, ..(*output).clone() }],
            alarm_reference: alarm_cr.local_reference,
        }
    }

    /// Returns the modules that the controller expects.
    pub(super) fn expected(&self) -> &[ExpectedModule] {
        &self.expected
    }

    /// Returns the modules that differ from the expected ones.
    pub(super) fn diff(&self) -> &[DiffModule] {
        &self.diff
    }

    /// Returns what ARData says of it.
    pub(super) fn ar_data(&self) -> ArData<'_> {
        let iocr = |iocr: &Iocr, (cycle_counter, data_status)| IocrData {
            iocr_type: iocr.iocr_type,
            rt_class: iocr.rt_class,
            frame_id: iocr.frame_id,
            cycle_counter,
            data_status,
        };
        let [input, output] = &self.iocrs;
        let consumed = (self.receiver.cycle_counter(), self.receiver.data_status());
        ArData {
            uuid: self.uuid,
            ar_type: self.initiator.ar_type,
            properties: self.initiator.properties,
            initiator_object: self.initiator_object,
            initiator_name: &self.initiator.initiator_name,
            rt_ports: (self.initiator.initiator_rt_port, UDP_PORT),
            alarm_references: (ALARM_REFERENCE, self.alarm_reference),
            iocrs: [iocr(input, self.sender.last()), iocr(output, consumed)],
        }
    }

    /// Returns the input data of a submodule as they are sent, with the controller's status; `None` if it has none.
    pub(super) fn input_data(&self, slot: u16, subslot: u16) -> Option<IoData<'_>> {
        let ([input, output], received) = (&self.iocrs, self.received());
        let len = self.expected_submodule(slot, subslot)?.input_len?;
        io_data((slot, subslot), len, (input, self.sender.c_sdu()), (output, received))
    }

    /// Returns the output data of a submodule as they were received, with the own status, and whether they are in use; `None`
    /// if it has none.
    pub(super) fn output_data(&self, slot: u16, subslot: u16) -> Option<(IoData<'_>, bool)> {
        let ([input, output], received) = (&self.iocrs, self.received());
        let len = self.expected_submodule(slot, subslot)?.output_len?;
        let data = io_data((slot, subslot), len, (output, received), (input, self.sender.c_sdu()))?;
        let in_use = self.outputs().any(|(place, data)| place == (slot, subslot) && data.is_some());
        Some((data, in_use))
    }

    /// Returns the C_SDU of the last frame from the controller; before the first one, zeros: all statuses are bad.
    fn received(&self) -> &[u8] {
        static NONE: [u8; MAX_C_SDU_LEN] = [0; MAX_C_SDU_LEN];
        self.receiver.c_sdu().unwrap_or(&NONE)
    }

    fn expected_submodule(&self, slot: u16, subslot: u16) -> Option<&ExpectedSubmodule> {
        let module = self.expected.iter().find(|module| module.slot == slot)?;
        module.submodules.iter().find(|submodule| submodule.subslot == subslot)
    }

    /// Returns whether cyclic frames with this FrameID over that transport belong to this AR.
    pub(super) fn consumes(&self, transport: Transport, frame_id: u16) -> bool {
        self.consumes == transport && self.receiver.frame_id() == frame_id
    }

    /// Handles a cyclic frame, from the FrameID on.
    pub(super) fn handle_cyclic(&mut self, now: Instant, payload: &[u8]) -> Received {
        let received = self.receiver.handle_frame(now, payload);
        if received == Received::New {
            self.is_output_good =
                self.receiver.usable_data().is_some_and(|c_sdu| self.process.is_good(c_sdu));
            if self.phase == RelationPhase::Data {
                self.step_deadline = None;
            }
        }
        received
    }

    /// Returns the newest data of every submodule that has outputs; empty before the connection is up.
    pub(super) fn outputs(&self) -> impl Iterator<Item = ((u16, u16), Option<&[u8]>)> {
        let c_sdu = self.receiver.usable_data().filter(|_| self.is_up);
        c_sdu.into_iter().flat_map(|c_sdu| self.process.all_data(c_sdu))
    }

    /// Returns once that data are exchanged: `true` at the first call after it has begun.
    pub(super) fn take_up(&mut self) -> bool {
        let comes_up = !self.is_up && self.phase == RelationPhase::Data && self.is_output_good;
        self.is_up |= comes_up;
        comes_up
    }

    pub(super) fn set_inputs(&mut self, provided: &Provided) {
        self.process.write_data(provided, self.sender.c_sdu_mut());
    }

    /// Restarts the controller's activity timeout: its next request has arrived.
    pub(super) fn restart_step_timeout(&mut self, now: Instant) {
        if self.phase != RelationPhase::Data {
            self.step_deadline = Some(now + self.step_time);
        }
    }

    /// Handles PrmEnd: all parameters are written. The caller sends [`ready`](Self::ready).
    pub(super) fn prm_end(&mut self, now: Instant) -> Result<(), Violation> {
        if self.phase != RelationPhase::Parameters {
            return Err(Violation::StateConflict);
        }
        self.phase = RelationPhase::Ready { repeat: now + FIRST_REPETITION, interval: FIRST_REPETITION };
        self.restart_step_timeout(now);
        self.process.write_statuses(true, self.sender.c_sdu_mut());
        Ok(())
    }

    /// Handles PrmBegin: parameters will be written again.
    pub(super) fn prm_begin(&mut self, now: Instant) -> Result<(), Violation> {
        if self.phase != RelationPhase::Data {
            return Err(Violation::StateConflict);
        }
        self.phase = RelationPhase::Parameters;
        self.restart_step_timeout(now);
        Ok(())
    }

    /// Handles the controller's confirmation that the device is ready.
    pub(super) fn handle_confirmation(&mut self, now: Instant) {
        self.restart_step_timeout(now);
        self.phase = RelationPhase::Data;
        if self.receiver.received() > 0 {
            self.step_deadline = None;
        }
    }

    /// Returns the control block of this AR.
    pub(super) const fn control(&self, command: Command) -> Control {
        Control { command, ar: self.uuid, session: self.session, properties: 0 }
    }

    /// Returns whether ApplicationReady is to be repeated now.
    pub(super) fn must_repeat(&mut self, now: Instant) -> bool {
        match &mut self.phase {
            RelationPhase::Ready { repeat, interval } if *repeat <= now => {
                *interval = interval.saturating_mul(2);
                *repeat = now + *interval;
                true
            }
            _ => false,
        }
    }

    /// Returns the violation of a request that did not come in time, if any.
    pub(super) fn expired(&self, now: Instant) -> Option<Violation> {
        if self.receiver.received() > 0 && self.receiver.is_expired(now) {
            return Some(Violation::ConsumerExpired);
        }
        let late = self.step_deadline.is_some_and(|deadline| deadline <= now);
        late.then_some(match self.phase {
            RelationPhase::Ready { .. } => Violation::ApplicationReadyTimeout,
            RelationPhase::Parameters | RelationPhase::Data => Violation::InitiatorTimeout,
        })
    }

    pub(super) fn poll_timeout(&self) -> Instant {
        let mut next = self.sender.poll_timeout();
        if self.receiver.received() > 0 {
            next = next.min(self.receiver.poll_timeout());
        }
        if let RelationPhase::Ready { repeat, .. } = self.phase {
            next = next.min(repeat);
        }
        if let Some(repeat) = self.alarms.poll_timeout() {
            next = next.min(repeat);
        }
        self.step_deadline.map_or(next, |deadline| next.min(deadline))
    }
}

/// Returns the data of a submodule in one direction: data and provider status from the IOCR and frame of that direction, the
/// consumer status from those of the other one.
fn io_data<'a>(
    place: (u16, u16),
    len: u16,
    (iocr, frame): (&Iocr, &'a [u8]),
    (opposite, opposite_frame): (&Iocr, &[u8]),
) -> Option<IoData<'a>> {
    let is_here = |object: &&Object| (object.slot, object.subslot) == place;
    let start = usize::from(iocr.objects.iter().find(is_here)?.offset);
    let end = start + usize::from(len);
    let status = |frame: &[u8], at: usize| frame.get(at).copied().map(IoxStatus);
    let consumer = opposite.consumer_statuses.iter().find(is_here);
    Some(IoData {
        data: frame.get(start..end)?,
        provider: status(frame, end)?,
        consumer: consumer
            .and_then(|object| status(opposite_frame, object.offset.into()))
            .unwrap_or_default(),
    })
}
