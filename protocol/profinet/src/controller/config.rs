//! What a controller is told: who it is, which device it drives and how.

use alloc::string::String;
use alloc::vec;
use alloc::vec::Vec;
use core::net::Ipv4Addr;

use super::layout::{Direction, Layout};
use crate::ETHER_TYPE;
use crate::connect::{
    AlarmCr, Ar, ArProperties, ConnectRequest, ExpectedModule, ExpectedSubmodule, Iocr, IocrType, RtClass,
};
use crate::description::{Description, INTERFACE_SUBSLOT, PLC};
use crate::rt::{CycleTime, Transport, UDP_PORT, UnfitCycle};
use crate::tag;
use crate::{LT_UDP, Uuid, is_station_name, rpc};
use machine::Duration;
use machine::ethernet::Mac;

/// CMInitiatorActivityTimeoutFactor, in 100 ms: the device gives a connection up that stands still for so long.
const ACTIVITY_TIMEOUT: u16 = 200;

/// LocalAlarmReference: the number of the AR's alarm endpoint. There is one AR; a Siemens controller counts from 0 too,
/// and keeps the number from one connection to the next.
const ALARM_REFERENCE: u16 = 0;

/// Everything that a [`Controller`](super::Controller) is told.
#[derive(Clone, Debug)]
pub struct ControllerConfig {
    /// MAC address of its interface.
    pub mac: Mac,
    /// Its own station name.
    pub station_name: String,
    /// Its own IP address.
    pub address: Ipv4Addr,
    /// Subnet mask that the device gets with its address.
    pub mask: Ipv4Addr,
    /// Station name of the device, by which it is found.
    pub device_station_name: String,
    /// IP address that the device is to have.
    pub device_address: Ipv4Addr,
    /// The device: identity, modules, submodules.
    pub description: Description,
    /// Parameter records that the device gets before data are exchanged.
    pub parameters: Vec<Parameter>,
    /// What carries the cyclic frames.
    pub transport: Transport,
    /// Time from one cyclic frame to the next, both ways.
    pub cycle: Duration,
    /// After how many cycles without a frame either side gives the connection up.
    pub watchdog_cycles: u16,
    /// Seed of the UUIDs and transaction numbers, mixed with the start time.
    pub seed: u64,
}

/// A record that the controller writes while it starts the device up.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Parameter {
    /// Slot number.
    pub slot: u16,
    /// Subslot number.
    pub subslot: u16,
    /// Index of the record.
    pub index: u16,
    /// The record's bytes.
    pub data: Vec<u8>,
}

impl Parameter {
    /// PDInterfaceAdjust, which Siemens controllers write to every device: the names of its ports are to be unique
    /// within the station only (MultipleInterfaceMode.NameOfDevice).
    #[must_use]
    pub fn interface_adjust() -> Self {
        // BlockType 0x0250, BlockLength 8, version 1.0, padding, MultipleInterfaceMode 1.
        let data = vec![0x02, 0x50, 0, 8, 1, 0, 0, 0, 0, 0, 0, 1];
        Self { slot: 0, subslot: INTERFACE_SUBSLOT, index: 0x8071, data }
    }
}

/// A configuration that no connection can come of.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub enum ConfigError {
    /// The cycle cannot be expressed.
    #[error(transparent)]
    Cycle(#[from] UnfitCycle),
    /// The watchdog is zero or longer than the standard allows.
    #[error(
        "a watchdog of {cycles} cycles is {} ms; choose 1 cycle or more and at most {} ms", time.as_millis(),
        limit.as_millis()
    )]
    Watchdog {
        /// The cycles asked for.
        cycles: u16,
        /// The time that they take.
        time: Duration,
        /// The longest time that the transport has.
        limit: Duration,
    },
    /// A station name is empty or has what DCP does not allow.
    #[error(
        "the station name {0:?} is not one: lower-case letters, digits and hyphens, in parts of up to 63 characters \
         separated by dots, 240 in all"
    )]
    StationName(String),
    /// The two stations cannot reach each other.
    #[error(
        "{address} and {device} are not in one subnet (mask {mask}): without a router they cannot reach each other"
    )]
    Subnet {
        /// Address of the controller.
        address: Ipv4Addr,
        /// Address of the device.
        device: Ipv4Addr,
        /// Subnet mask of both.
        mask: Ipv4Addr,
    },
    /// The modules have more data than a frame holds.
    #[error(
        "the modules make {0} bytes of cyclic data in one direction, a frame holds 1440: leave modules out"
    )]
    TooMuchData(usize),
    /// A parameter record is longer than one Write carries.
    #[error(
        "parameter record {index} of slot {slot} has {len} bytes, more than the 4096 that fit: shorten it"
    )]
    Parameter {
        /// Slot number.
        slot: u16,
        /// Index of the record.
        index: u16,
        /// Its length in bytes.
        len: usize,
    },
}

/// The longest parameter record in bytes: with its head it fits [`rpc::BODY_CAPACITY`].
const MAX_PARAMETER_LEN: usize = 4096;

/// What follows from a configuration once and for all.
#[derive(Debug)]
pub(super) struct Plan {
    pub(super) layout: Layout,
    pub(super) time: CycleTime,
    pub(super) hold: Duration,
    /// The Connect request, but for what changes from session to session.
    pub(super) connect: ConnectRequest,
}

/// IOCRReference of the input.
pub(super) const INPUT: u16 = 1;
/// IOCRReference of the output.
pub(super) const OUTPUT: u16 = 2;

impl Plan {
    pub(super) fn new(config: &ControllerConfig, ar: Uuid) -> Result<Self, ConfigError> {
        for name in [&config.station_name, &config.device_station_name] {
            if name.is_empty() || !is_station_name(name.as_bytes()) {
                return Err(ConfigError::StationName(name.clone()));
            }
        }
        if let Some(Parameter { slot, index, data, .. }) =
            config.parameters.iter().find(|parameter| parameter.data.len() > MAX_PARAMETER_LEN)
        {
            return Err(ConfigError::Parameter { slot: *slot, index: *index, len: data.len() });
        }
        let subnet = |address: Ipv4Addr| address.to_bits() & config.mask.to_bits();
        if subnet(config.address) != subnet(config.device_address) {
            return Err(ConfigError::Subnet {
                address: config.address,
                device: config.device_address,
                mask: config.mask,
            });
        }
        let time = CycleTime::new(config.cycle, config.transport)?;
        let (cycles, limit) = (config.watchdog_cycles, config.transport.max_hold_time());
        let hold = time.times(cycles);
        if hold.is_zero() || hold > limit {
            return Err(ConfigError::Watchdog { cycles, time: hold, limit });
        }
        let expected = expected(&config.description);
        let layout = Layout::new(&expected, config.transport).map_err(ConfigError::TooMuchData)?;
        let connect = ConnectRequest {
            ar: Ar {
                ar_type: Ar::IOCAR_SINGLE,
                uuid: ar,
                session: 0,
                initiator_mac: config.mac,
                initiator_object: rpc::object(1, PLC.identity),
                properties: ArProperties(
                    ArProperties::ACTIVE
                        | ArProperties::PARAMETERIZATION_BY_INITIATOR
                        | ArProperties::ADVANCED_STARTUP,
                ),
                activity_timeout: ACTIVITY_TIMEOUT,
                initiator_rt_port: UDP_PORT,
                initiator_name: config.station_name.as_bytes().to_vec(),
            },
            iocrs: vec![
                iocr(config, time, IocrType::Input, &layout.input),
                iocr(config, time, IocrType::Output, &layout.output),
            ],
            alarm_cr: Some(AlarmCr {
                alarm_cr_type: 1,
                lt: lt(config.transport),
                properties: match config.transport {
                    Transport::Rt1 => 0,
                    Transport::Udp => AlarmCr::OVER_UDP,
                },
                rta_timeout: 1,
                rta_retries: 3,
                local_reference: ALARM_REFERENCE,
                max_data_length: 256,
                tag_high: tag::RT.0,
                tag_low: tag::ALARM_LOW.0,
            }),
            expected,
        };
        Ok(Self { layout, time, hold, connect })
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

fn iocr(config: &ControllerConfig, time: CycleTime, iocr_type: IocrType, direction: &Direction) -> Iocr {
    let (rt_class, first_frame_id) = match config.transport {
        Transport::Rt1 => (RtClass::Class1, 0x8000),
        Transport::Udp => (RtClass::Udp, 0xC000),
    };
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
    use crate::description::{Module, ROBOT, Submodule};
    use crate::record::{Address, WriteRequest};
    use crate::rpc::{ARGS_LEN, HEADER_LEN};

    const fn submodule(subslot: u16, ident: u32, input_len: u16, output_len: u16) -> Submodule {
        Submodule { subslot, ident, input_len, output_len, parameters: &[] }
    }

    /// The modules of the p-net sample device that the captured Connect expects.
    const P_NET: &[Module] = &[
        Module {
            slot: 0,
            ident: 1,
            submodules: &[
                submodule(1, 1, 0, 0),
                submodule(0x8000, 0x8000, 0, 0),
                submodule(0x8001, 0x8001, 0, 0),
            ],
        },
        Module { slot: 1, ident: 0x30, submodules: &[submodule(1, 0x130, 1, 0)] },
        Module { slot: 2, ident: 0x31, submodules: &[submodule(1, 0x131, 0, 1)] },
        Module { slot: 3, ident: 0x32, submodules: &[submodule(1, 0x132, 1, 1)] },
        Module { slot: 4, ident: 0x40, submodules: &[submodule(1, 0x140, 8, 8)] },
    ];

    #[test]
    fn for_the_same_device_the_connect_is_that_of_the_siemens_controller() {
        let datagram = captured::datagram(captured::CONNECT_REQ);
        let theirs = ConnectRequest::parse(&datagram[HEADER_LEN + ARGS_LEN..]).unwrap();
        let config = ControllerConfig {
            mac: theirs.ar.initiator_mac,
            station_name: String::from_utf8(theirs.ar.initiator_name.clone()).unwrap(),
            address: Ipv4Addr::new(172, 16, 2, 100),
            mask: Ipv4Addr::new(255, 255, 255, 0),
            device_station_name: "rt-labs-dev".into(),
            device_address: Ipv4Addr::new(172, 16, 2, 10),
            description: Description { modules: P_NET, ..ROBOT },
            parameters: Vec::new(),
            transport: Transport::Rt1,
            cycle: Duration::from_millis(32),
            watchdog_cycles: 3,
            seed: 0,
        };
        let mut ours = Plan::new(&config, theirs.ar.uuid).unwrap().connect;
        ours.ar.session = theirs.ar.session;
        ours.ar.initiator_object = theirs.ar.initiator_object;
        assert_eq!(ours, theirs);
    }

    #[test]
    fn the_interface_adjust_is_the_first_record_of_the_siemens_controllers_multiple_write() {
        let datagram = captured::datagram(captured::WRITE_REQ);
        let blocks = &datagram[HEADER_LEN + ARGS_LEN..];
        let multiple = WriteRequest::parse(&mut BlockReader::new(blocks)).unwrap();
        let first = multiple.parts().next().unwrap().unwrap();
        let Parameter { slot, subslot, index, data } = Parameter::interface_adjust();
        let Address { slot: s, subslot: ss, index: i, .. } = first.address;
        assert_eq!((slot, subslot, index, &data[..]), (s, ss, i, first.record));
    }
}
