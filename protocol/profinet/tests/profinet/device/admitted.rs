//! What a Connect may have at its bounds, and records that only one kind of subslot has.

use profinet::record::{Address, ReadRequest, index};

use super::*;

fn connected(change: impl FnOnce(&mut ConnectRequest)) -> (Status, Option<ConnectResponse>) {
    let mut request = connect_request(RtClass::Class1, true);
    change(&mut request);
    DeviceRig::new().connect(&request)
}

fn over_udp(iocr: &mut Iocr) {
    (iocr.rt_class, iocr.lt) = (RtClass::Udp, LT_UDP);
    iocr.frame_id |= 0xC000;
}

#[test]
fn the_controllers_port_matters_as_soon_as_one_way_goes_over_udp() {
    assert!(connected(|r| r.ar.initiator_rt_port = 0).0.is_ok(), "both over Ethernet");
    for index in [0, 1] {
        assert!(connected(|r| over_udp(&mut r.iocrs[index])).0.is_ok());
        let (status, _) = connected(|r| {
            over_udp(&mut r.iocrs[index]);
            r.ar.initiator_rt_port = 0x3FF;
        });
        assert_eq!(status, Violation::InitiatorRtPort.status(Service::Connect), "IOCR {index}");
    }
}

#[test]
fn a_frame_may_be_sent_at_any_time_within_the_send_clock() {
    for (offset, allowed) in [(0, true), (999_999, true), (1_000_000, false), (u32::MAX, true)] {
        let (status, _) = connected(|r| r.iocrs[1].frame_send_offset = offset);
        let violation = Violation::FrameSendOffset.status(Service::Connect);
        assert_eq!(status, if allowed { Status::OK } else { violation }, "{offset} ns");
    }
}

#[test]
fn the_frame_id_that_the_device_chooses_is_the_second_of_its_range_unless_the_input_has_it() {
    for (input, chosen) in [(0x8005, 0x8001), (0x8001, 0x8000), (0x8000, 0x8001)] {
        let (_, response) = connected(|r| {
            r.iocrs[0].frame_id = input;
            r.iocrs[1].frame_id = 0xFFFF;
        });
        assert_eq!(response.unwrap().iocrs[1].frame_id, chosen, "input 0x{input:04X}");
    }
}

#[test]
fn data_of_ports_and_interfaces_are_read_at_their_own_subslots_only() {
    let mut rig = DeviceRig::connected(RtClass::Class1);
    let (port, interface) = (index::PD_PORT_DATA_REAL, index::PD_INTERFACE_DATA_REAL);
    for (index, slot, subslot, is_there) in [
        (port, 0, 0x8001, true),
        (port, 0, 0x8000, false),
        (port, 0, 1, false),
        (port, 1, 1, false),
        (interface, 0, 0x8000, true),
        (interface, 0, 0x8001, false),
        (interface, 1, 1, false),
    ] {
        let address = Address { sequence: 0, ar: AR, api: 0, slot, subslot, index };
        let read = ReadRequest { address, most: 4_000, target_ar: Uuid::NIL };
        let (status, ..) = rig.call(Operation::Read, &emitted(|w| read.emit(w)));
        let wanted = if is_there { Status::OK } else { Status(0xDE80_B000) };
        assert_eq!(status, wanted, "0x{index:04X} of slot {slot}, subslot 0x{subslot:04X}");
    }
}
