//! What the configuration of an AR determines: layout of the frames, times, and the Connect request.

use alloc::vec;
use alloc::vec::Vec;
use core::net::Ipv4Addr;

use super::super::config::{ArConfig, ConfigError, ControllerConfig, Parameter, check_name};
use super::layout::{Direction, Layout};
use crate::connect::{
    AlarmCr, Ar, ArProperties, ConnectRequest, ExpectedModule, ExpectedSubmodule, Iocr, IocrType, RtClass,
};
use crate::description::Description;
use crate::rt::{CycleTime, FRAME_IDS_RT_CLASS_1_UDP, FRAME_IDS_RT_CLASS_2, Transport, UDP_PORT};
use crate::status::{Service, Status, Violation};
use crate::tag;
use crate::{ETHER_TYPE, LT_UDP, Uuid, rpc};
use machine::Duration;
use machine::ethernet::Mac;

/// CMInitiatorActivityTimeoutFactor, in 100 ms: the device ends a connection whose establishment makes no progress for so
/// long.
const ACTIVITY_TIMEOUT: u16 = 200;

/// First FrameID of RT_CLASS_1.
const FIRST_FRAME_ID: u16 = *FRAME_IDS_RT_CLASS_2.start();
/// First FrameID of RT_CLASS_1 in its former numbering, and of RT_CLASS_UDP.
const FIRST_FRAME_ID_LEGACY: u16 = *FRAME_IDS_RT_CLASS_1_UDP.start();

/// What a configuration determines for all connections of an AR.
#[derive(Debug)]
pub(super) struct ConnectPlan {
    pub(super) layout: Layout,
    pub(super) time: CycleTime,
    pub(super) hold: Duration,
    /// The Connect request; only the session key changes from connection to connection, and what the device refuses.
    pub(super) connect: ConnectRequest,
}

/// What was changed in the Connect of one attempt because the device refused it.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub(super) struct PlanChanges {
    startup_mode: bool,
    rt_class: bool,
}

/// IOCRReference of the input.
pub(super) const INPUT: u16 = 1;
/// IOCRReference of the output.
pub(super) const OUTPUT: u16 = 2;

impl ConnectPlan {
    /// Creates the plan. `number` distinguishes the ARs of one controller, from 0.
    pub(super) fn new(
        own: &ControllerConfig,
        config: &ArConfig,
        number: u16,
        ar: Uuid,
    ) -> Result<Self, ConfigError> {
        check_name(&config.station_name)?;
        if let Some(Parameter { slot, index, data, .. }) =
            config.parameters.iter().find(|parameter| parameter.data.len() > rpc::LONGEST_RECORD)
        {
            return Err(ConfigError::Parameter { slot: *slot, index: *index, len: data.len() });
        }
        let subnet = |address: Ipv4Addr| address.to_bits() & own.mask.to_bits();
        if subnet(own.address) != subnet(config.address) {
            return Err(ConfigError::Subnet { address: own.address, device: config.address, mask: own.mask });
        }
        let time = CycleTime::new(config.cycle, config.transport)?;
        if time.counts() < u32::from(config.description.min_device_interval) {
            let shortest =
                CycleTime { send_clock_factor: config.description.min_device_interval, reduction_ratio: 1 };
            return Err(ConfigError::ShortCycle { cycle: config.cycle, shortest: shortest.period() });
        }
        let (cycles, most) = (config.watchdog_cycles, config.transport.max_hold_factor(time.period()));
        let hold = time.multiplied(cycles);
        if !(1..=most).contains(&cycles) {
            return Err(ConfigError::Watchdog { cycles, time: hold, most, longest: time.multiplied(most) });
        }
        let expected = expected(&config.description);
        let layout = Layout::new(&expected, config.transport).map_err(ConfigError::TooMuchData)?;
        let connect = ConnectRequest {
            ar: ar_block(own, ar),
            iocrs: vec![
                iocr(config, number, time, IocrType::Input, &layout.input),
                iocr(config, number, time, IocrType::Output, &layout.output),
            ],
            alarm_cr: Some(alarm_cr(config.transport, number)),
            expected,
        };
        Ok(Self { layout, time, hold, connect })
    }
}

impl ConnectPlan {
    /// Changes the Connect if a device may have refused it because its stack is older than what we ask for: advanced startup
    /// mode becomes legacy, RT_CLASS_1 gets its former number and FrameIDs, or each the other way round. `changes` are those
    /// of this attempt; each is made once. Returns whether the Connect is to be called again.
    pub(super) fn change(&mut self, changes: &mut PlanChanges, refusal: Status) -> bool {
        let refused = |violation: Violation| violation.status(Service::Connect) == refusal;
        let ConnectRequest { ar, iocrs, .. } = &mut self.connect;
        if refused(Violation::ArProperties) && !core::mem::replace(&mut changes.startup_mode, true) {
            ar.properties.0 ^= ArProperties::ADVANCED_STARTUP;
            return true;
        }
        let is_class_1 = iocrs.iter().all(|iocr| iocr.rt_class != RtClass::Udp);
        if is_class_1
            && refused(Violation::IocrProperties)
            && !core::mem::replace(&mut changes.rt_class, true)
        {
            for iocr in iocrs {
                iocr.rt_class = match iocr.rt_class {
                    RtClass::Class1 => RtClass::Legacy1,
                    _ => RtClass::Class1,
                };
                // From 0x8000 on, or from 0xC000 on.
                iocr.frame_id ^= FIRST_FRAME_ID ^ FIRST_FRAME_ID_LEGACY;
            }
            return true;
        }
        false
    }
}

fn ar_block(own: &ControllerConfig, uuid: Uuid) -> Ar {
    Ar {
        ar_type: Ar::IOCAR_SINGLE,
        uuid,
        session: 0,
        initiator_mac: own.mac,
        initiator_object: rpc::object(rpc::INSTANCE, own.description.identity),
        properties: ArProperties(
            ArProperties::ACTIVE
                | ArProperties::PARAMETERIZATION_BY_INITIATOR
                | ArProperties::ADVANCED_STARTUP,
        ),
        activity_timeout: ACTIVITY_TIMEOUT,
        initiator_rt_port: UDP_PORT,
        initiator_name: own.station_name.as_bytes().to_vec(),
    }
}

const fn alarm_cr(transport: Transport, number: u16) -> AlarmCr {
    AlarmCr {
        alarm_cr_type: 1,
        lt: lt(transport),
        properties: match transport {
            Transport::Rt1 => 0,
            Transport::Udp => AlarmCr::OVER_UDP,
        },
        rta_timeout: 1,
        rta_retries: 3,
        // A Siemens controller counts from 0 too, and keeps the number from one connection to the next.
        local_reference: number,
        max_data_length: 256,
        tag_high: tag::RT.0,
        tag_low: tag::ALARM_LOW.0,
    }
}

const fn lt(transport: Transport) -> u16 {
    match transport {
        Transport::Rt1 => ETHER_TYPE,
        Transport::Udp => LT_UDP,
    }
}

fn expected(description: &Description) -> Vec<ExpectedModule> {
    let module = |module: &crate::description::Module| ExpectedModule {
        slot: module.slot,
        ident: module.ident,
        properties: 0,
        submodules: module
            .submodules
            .iter()
            .map(|submodule| ExpectedSubmodule {
                subslot: submodule.subslot,
                ident: submodule.ident,
                properties: 0,
                input_len: (submodule.input_len > 0 || submodule.output_len == 0)
                    .then_some(submodule.input_len),
                output_len: (submodule.output_len > 0).then_some(submodule.output_len),
            })
            .collect(),
    };
    description.modules.iter().map(module).collect()
}

/// Returns the number of the AR of RT_CLASS_1 to which a FrameID belongs, if any: two for each AR, in either numbering.
pub(super) const fn number_of(frame_id: u16) -> u16 {
    (frame_id & !(FIRST_FRAME_ID | FIRST_FRAME_ID_LEGACY)) / 2
}

fn iocr(config: &ArConfig, number: u16, time: CycleTime, iocr_type: IocrType, direction: &Direction) -> Iocr {
    let (rt_class, lowest) = match config.transport {
        Transport::Rt1 => (RtClass::Class1, FIRST_FRAME_ID),
        Transport::Udp => (RtClass::Udp, FIRST_FRAME_ID_LEGACY),
    };
    // Those of the inputs must differ within a controller; a device may choose others for its outputs.
    let first_frame_id = lowest + 2 * number;
    let (reference, frame_id) = match iocr_type {
        IocrType::Input => (INPUT, first_frame_id),
        _ => (OUTPUT, first_frame_id + 1),
    };
    Iocr {
        iocr_type,
        reference,
        lt: lt(config.transport),
        rt_class,
        properties: 0,
        data_length: direction.c_sdu_len,
        frame_id,
        send_clock_factor: time.send_clock_factor,
        reduction_ratio: time.reduction_ratio,
        phase: 1,
        sequence: 0,
        frame_send_offset: Iocr::BEST_EFFORT,
        watchdog_factor: config.watchdog_cycles,
        data_hold_factor: config.watchdog_cycles,
        tag_header: tag::RT.0,
        multicast_mac: Mac::default(),
        objects: direction.objects.clone(),
        consumer_statuses: direction.consumer_statuses.clone(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::block::BlockReader;
    use crate::captured;
    use crate::record::{Address, WriteRequest};
    use crate::rpc::{ARGS_LEN, HEADER_LEN};
    use crate::samples;
    use alloc::string::String;

    #[test]
    fn for_the_same_device_the_connect_is_that_of_the_siemens_controller() {
        let datagram = captured::datagram(captured::CONNECT_REQ);
        let theirs = ConnectRequest::parse(&datagram[HEADER_LEN + ARGS_LEN..]).unwrap();
        let own = ControllerConfig {
            mac: theirs.ar.initiator_mac,
            station_name: String::from_utf8(theirs.ar.initiator_name.clone()).unwrap(),
            address: Ipv4Addr::new(172, 16, 2, 100),
            mask: Ipv4Addr::new(255, 255, 255, 0),
            description: samples::CONTROLLER,
            seed: 0,
        };
        let config = ArConfig {
            station_name: "rt-labs-dev".into(),
            mac: None,
            address: Ipv4Addr::new(172, 16, 2, 10),
            description: samples::P_NET,
            parameters: Vec::new(),
            transport: Transport::Rt1,
            cycle: Duration::from_millis(32),
            watchdog_cycles: 3,
        };
        let mut ours = ConnectPlan::new(&own, &config, 0, theirs.ar.uuid).unwrap().connect;
        ours.ar.session = theirs.ar.session;
        ours.ar.initiator_object = theirs.ar.initiator_object;
        assert_eq!(ours, theirs);
    }

    #[test]
    fn the_interface_adjust_is_the_first_record_of_the_siemens_controllers_multiple_write() {
        let datagram = captured::datagram(captured::WRITE_REQ);
        let blocks = &datagram[HEADER_LEN + ARGS_LEN..];
        let multiple = WriteRequest::parse(&mut BlockReader::new(blocks)).unwrap();
        let first = multiple.writes().next().unwrap().unwrap();
        let Parameter { slot, subslot, index, data } = Parameter::interface_adjust();
        let Address { slot: s, subslot: ss, index: i, .. } = first.address;
        assert_eq!((slot, subslot, index, &data[..]), (s, ss, i, first.record));
    }
}
