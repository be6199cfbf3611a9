//! Records, and parts of them, that no device of the tests has as they are here: more ports, other places, other times.

use std::net::Ipv4Addr;

use machine::Instant;
use machine::ethernet::Mac;
use profinet::Uuid;
use profinet::connect::{ArProperties, IocrType, RtClass};
use profinet::dcp::IpSuite;
use profinet::lldp::Naming;
use profinet::record::{
    ArData, IocrData, LogBook, LogEntry, PhysicalDevice, PhysicalParameters, emit_ar_data, index,
};
use profinet::rt::DataStatus;
use profinet::status::Status;

use crate::samples::{self, emitted};

#[test]
fn every_port_is_named_by_three_digits_of_its_number() {
    let address = Ipv4Addr::new(192, 168, 64, 2);
    let device = PhysicalDevice {
        name: b"device",
        mac: Mac([2; 6]),
        ip: IpSuite { address, mask: address, gateway: address },
        neighbour: None,
    };
    for (subslot, name) in [(0x8001, b"port-001"), (0x8002, b"port-002"), (0x807B, b"port-123")] {
        let block = emitted(|w| device.emit_port(0, subslot, w));
        // The name follows the head, padding, slot and subslot, and its length.
        assert_eq!((block[12], &block[13..21]), (8, &name[..]));
    }
}

#[test]
fn the_times_of_the_log_book_are_in_units_of_31_25_us() {
    let mut book = LogBook::default();
    book.add(LogEntry { at: Instant::from_millis(5), ar: Uuid([3; 16]), status: Status(0x0102_0304) });
    let record = emitted(|w| book.emit(Instant::from_millis(1_000), w));
    assert_eq!(record[6..14], 32_000_u64.to_be_bytes(), "now");
    assert_eq!(record[14..16], [0, 1]);
    assert_eq!(record[16..24], 160_u64.to_be_bytes());
    assert_eq!(record[24..44], [[3; 16].as_slice(), &[1, 2, 3, 4]].concat());
}

#[test]
fn the_padding_of_ar_data_is_counted_from_the_start_of_its_block() {
    let iocr = IocrData {
        iocr_type: IocrType::Input,
        rt_class: RtClass::Class1,
        frame_id: 0x8001,
        cycle_counter: 1,
        data_status: DataStatus::RUNNING,
    };
    let ar = ArData {
        uuid: Uuid([1; 16]),
        ar_type: 1,
        properties: ArProperties(1),
        initiator_object: Uuid([2; 16]),
        initiator_name: b"plc",
        rt_ports: (0x8892, 0x8892),
        alarm_references: (0, 5),
        iocrs: [iocr; 2],
    };
    let alone = emitted(|w| emit_ar_data(&[ar], w));
    for before in 1..4 {
        let behind = emitted(|w| {
            w.zeros(before);
            emit_ar_data(&[ar], w);
        });
        assert_eq!(behind[before..], alone, "{before} bytes before it");
    }
}

#[test]
fn only_ports_have_port_data_and_only_the_interface_has_interface_data() {
    const PORT: [u16; 2] = [index::PD_PORT_DATA_CHECK, index::PD_PORT_DATA_ADJUST];
    for (subslot, is_port, is_interface) in [
        (1, false, false),
        (0x8000, false, true),
        (0x8001, true, false),
        (0x80FF, true, false),
        (0x8100, false, false),
    ] {
        assert_eq!(
            PORT.map(|index| PhysicalParameters::has(subslot, index)),
            [is_port; 2],
            "0x{subslot:04X}"
        );
        assert_eq!(PhysicalParameters::has(subslot, index::PD_INTERFACE_ADJUST), is_interface);
    }
}

#[test]
fn bit_0_of_the_mode_of_the_interface_says_how_the_station_is_named() {
    let mut parameters = PhysicalParameters::new(&samples::DEVICE);
    assert_eq!(parameters.naming(), Naming::Station);
    for (mode, naming) in
        [(0, Naming::Station), (1, Naming::Device), (2, Naming::Station), (3, Naming::Device)]
    {
        let block = [0x02, 0x50, 0, 8, 1, 0, 0, 0, 0, 0, 0, mode];
        parameters.write(0, 0x8000, index::PD_INTERFACE_ADJUST, &block);
        assert_eq!(parameters.naming(), naming, "mode {mode}");
    }
}
