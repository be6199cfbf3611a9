//! A connected AR: both cyclic connections and the alarm connection.

use core::net::SocketAddrV4;

use super::alarms::Alarms;
use super::connect_plan::{ConnectPlan, INPUT, OUTPUT};
use super::{Ar, ArConfig, Refusal, down_reasons};
use crate::connect::{ConnectResponse, DiffModule, ModuleState};
use crate::provided::Provided;
use crate::rt::{self, CyclicReceiver, CyclicSender, IoxStatus, Route, Transport, UDP_PORT};
use machine::Counters;
use machine::Instant;
use machine::ethernet::Mac;

/// A connected AR.
#[derive(Debug)]
pub(super) struct CyclicLink {
    /// The device's MAC address in cyclic frames and alarms.
    pub(super) device: Mac,
    pub(super) sender: CyclicSender,
    pub(super) receiver: CyclicReceiver,
    pub(super) alarms: Alarms,
}

impl CyclicLink {
    /// Creates the AR that the device granted, if its answer fits the request. The MAC addresses are those of the
    /// controller and of the station that was found, which is also the one that answered.
    pub(super) fn new(
        now: Instant,
        (own, device): (Mac, Mac),
        config: &ArConfig,
        plan: &ConnectPlan,
        output: &Provided,
        granted: &ConnectResponse,
    ) -> Result<Self, Refusal> {
        let unfit = Refusal { code: 0, text: down_reasons::UNFIT_ANSWER };
        let asked = &plan.connect.ar;
        if (granted.ar.uuid, granted.ar.session) != (asked.uuid, asked.session) {
            return Err(unfit);
        }
        let frame_id = |reference| {
            let iocr = granted.iocrs.iter().find(|iocr| iocr.reference == reference);
            match iocr.map(|iocr| iocr.frame_id) {
                Some(frame_id) if rt::is_cyclic(frame_id) => Ok(frame_id),
                Some(frame_id) => Err(Refusal { code: frame_id.into(), text: down_reasons::WRONG_FRAME_ID }),
                None => Err(unfit),
            }
        };
        let route = match config.transport {
            Transport::Rt1 => Route::Ethernet { source: own, destination: device },
            Transport::Udp => {
                Route::Udp(SocketAddrV4::new(config.address, responder_port(granted.ar.responder_rt_port)))
            }
        };
        let first = plan.time.first(now, own);
        let output_len = usize::from(plan.layout.output.c_sdu_len);
        let input_len = usize::from(plan.layout.input.c_sdu_len);
        let own_reference = plan.connect.alarm_cr.map_or(0, |alarm_cr| alarm_cr.local_reference);
        let device_reference = granted.alarm_cr.map_or(0, |alarm_cr| alarm_cr.local_reference);
        let mut link = Self {
            device,
            sender: CyclicSender::new(route, frame_id(OUTPUT)?, plan.time, output_len, first),
            receiver: CyclicReceiver::new(frame_id(INPUT)?, plan.time, input_len, plan.hold, now),
            alarms: Alarms::new(route, (own_reference, device_reference)),
        };
        link.write_output(plan, output);
        Ok(link)
    }

    /// Writes the outputs into the next and all later frames.
    pub(super) fn write_output(&mut self, plan: &ConnectPlan, output: &Provided) {
        plan.layout.output.write_data(output, self.sender.c_sdu_mut());
    }

    /// Sets the consumer status: the controller accepts the device's data.
    pub(super) fn accept_input(&mut self, plan: &ConnectPlan) {
        plan.layout.output.write_consumer_statuses(IoxStatus::GOOD, self.sender.c_sdu_mut());
    }

    /// Adds what this AR counted.
    pub(super) const fn count(&self, counters: &mut Counters) {
        counters.sent += self.sender.sent();
        counters.skipped += self.sender.skipped();
        counters.received += self.receiver.received();
        counters.lost += self.receiver.lost();
        counters.late += self.receiver.late();
    }
}

impl Ar {
    /// Returns the number of cyclic frames received since its start.
    #[must_use]
    pub fn received(&self) -> u64 {
        self.counters.received + self.link.as_ref().map_or(0, |link| link.receiver.received())
    }
}

/// Returns the UDP port at which the device takes cyclic frames and alarms: the one that it names, as long as that is above
/// the ports of other services (IEC 61158-6-10, CMResponderUDPRTPort).
const fn responder_port(named: u16) -> u16 {
    const LAST_OF_SERVICES: u16 = 0x3FF;
    if named > LAST_OF_SERVICES { named } else { UDP_PORT }
}

/// Returns the first module or submodule of the device that cannot be driven, and in which way.
pub(super) fn unusable(diff: &[DiffModule]) -> Option<Refusal> {
    diff.iter().find_map(|module| {
        let place = |subslot: u16| u32::from(module.slot) << 16 | u32::from(subslot);
        match module.state {
            ModuleState::NoModule => {
                return Some(Refusal { code: place(0), text: down_reasons::NO_MODULE });
            }
            ModuleState::WrongModule => {
                return Some(Refusal { code: place(0), text: down_reasons::WRONG_MODULE });
            }
            _ => {}
        }
        let submodule = module.submodules.iter().find(|submodule| !submodule.state.is_usable())?;
        Some(Refusal { code: place(submodule.subslot), text: down_reasons::WRONG_SUBMODULE })
    })
}
