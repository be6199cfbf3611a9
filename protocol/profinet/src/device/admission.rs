//! Checks whether a Connect can be accepted: every field that the standard limits, and the modules.
//!
//! The checks follow the CheckingRules of IEC 61158-6-10 for each block; the answer contains the first violation.

use alloc::vec::Vec;

use crate::ETHER_TYPE;
use crate::LT_UDP;
use crate::connect::{
    AlarmCr, Ar, ArProperties, ConnectRequest, DiffModule, DiffSubmodule, ExpectedModule, ExpectedSubmodule,
    Iocr, IocrType, ModuleState, Object, RtClass, SubmoduleState,
};
use crate::description::Description;
use crate::rt::{COUNT_NANOS, FRAME_IDS_RT_CLASS_1_UDP, FRAME_IDS_RT_CLASS_2, MAX_C_SDU_LEN, Transport};
use crate::status::Violation;
use crate::tag;
use machine::ethernet::Tag;

/// A Connect that is accepted.
#[derive(Debug)]
pub(super) struct Admission<'a> {
    pub(super) input: &'a Iocr,
    pub(super) output: &'a Iocr,
    pub(super) alarm_cr: &'a AlarmCr,
    /// FrameID of the output IOCR: the proposed one if it is allowed, otherwise one of ours.
    pub(super) output_frame_id: u16,
    /// The modules that differ from the expected ones.
    pub(super) diff: Vec<DiffModule>,
}

/// Checks a Connect against the rules and against the device.
pub(super) fn admit<'a>(
    request: &'a ConnectRequest,
    description: &Description,
) -> Result<Admission<'a>, Violation> {
    check_ar(&request.ar)?;
    let of_type = |wanted| request.iocrs.iter().find(move |iocr| iocr.iocr_type == wanted);
    if request.iocrs.iter().any(|iocr| matches!(iocr.iocr_type, IocrType::Unknown(_))) {
        return Err(Violation::IocrType);
    }
    let input = of_type(IocrType::Input).ok_or(Violation::IocrMissing)?;
    let output = of_type(IocrType::Output).ok_or(Violation::IocrMissing)?;
    if request.iocrs.len() > 2 {
        return Err(Violation::IocrType);
    }
    if input.reference == output.reference {
        return Err(Violation::IocrReference);
    }
    let alarm_cr = request.alarm_cr.as_ref().ok_or(Violation::AlarmCrCount)?;
    for iocr in [input, output] {
        check_iocr(iocr, description)?;
        // The former numbering of FrameIDs belongs to the former startup.
        let is_mixed =
            iocr.rt_class == RtClass::Legacy1 && request.ar.properties.has(ArProperties::ADVANCED_STARTUP);
        check(!is_mixed, Violation::IocrProperties)?;
        check_objects(iocr, &request.expected)?;
    }
    if !frame_ids(input.rt_class).contains(&input.frame_id) {
        return Err(Violation::FrameId);
    }
    if transport(input) == Transport::Udp || transport(output) == Transport::Udp {
        check_rt_port(request.ar.initiator_rt_port)?;
    }
    check_alarm_cr(alarm_cr)?;
    let diff = compare(&request.expected, description)?;
    Ok(Admission { input, output, alarm_cr, output_frame_id: output_frame_id(input, output), diff })
}

/// Returns the transport of an IOCR's frames. [`admit`] has refused unknown classes.
pub(super) const fn transport(iocr: &Iocr) -> Transport {
    match iocr.rt_class {
        RtClass::Udp => Transport::Udp,
        _ => Transport::Rt1,
    }
}

const fn frame_ids(class: RtClass) -> core::ops::RangeInclusive<u16> {
    match class {
        RtClass::Class1 => FRAME_IDS_RT_CLASS_2,
        _ => FRAME_IDS_RT_CLASS_1_UDP,
    }
}

fn output_frame_id(input: &Iocr, output: &Iocr) -> u16 {
    let range = frame_ids(output.rt_class);
    let fits = |id: &u16| range.contains(id) && *id != input.frame_id;
    let first = *range.start();
    [output.frame_id, first | 1, first].into_iter().find(fits).unwrap_or(first)
}

fn check_ar(ar: &Ar) -> Result<(), Violation> {
    // Instance, device and vendor follow in the last six bytes.
    const OBJECT: [u8; 10] = [0xDE, 0xA0, 0x00, 0x00, 0x6C, 0x97, 0x11, 0xD1, 0x82, 0x71];
    let unsupported = ar.properties.has(ArProperties::DEVICE_ACCESS);
    check(ar.ar_type == Ar::IOCAR_SINGLE, Violation::ArType)?;
    check(!ar.uuid.is_nil(), Violation::ArUuid)?;
    check(!ar.initiator_mac.is_group(), Violation::InitiatorMac)?;
    check(ar.initiator_object.0.starts_with(&OBJECT), Violation::InitiatorObject)?;
    check(ar.properties.state() == ArProperties::ACTIVE && !unsupported, Violation::ArProperties)?;
    check((1..=1000).contains(&ar.activity_timeout), Violation::ActivityTimeout)
}

fn check_rt_port(port: u16) -> Result<(), Violation> {
    check(port > 0x3FF, Violation::InitiatorRtPort)
}

fn check_iocr(iocr: &Iocr, description: &Description) -> Result<(), Violation> {
    let (lt, transport) = match iocr.rt_class {
        RtClass::Legacy1 | RtClass::Class1 => (ETHER_TYPE, Transport::Rt1),
        RtClass::Udp => (LT_UDP, Transport::Udp),
        RtClass::Unknown(_) => return Err(Violation::IocrProperties),
    };
    check(iocr.lt == lt, Violation::IocrLt)?;
    let data_length = usize::from(iocr.data_length);
    check((transport.min_c_sdu_len()..=MAX_C_SDU_LEN).contains(&data_length), Violation::IocrDataLength)?;
    let clock = iocr.send_clock_factor;
    check(clock.is_power_of_two() && clock <= 128, Violation::SendClockFactor)?;
    let ratio = iocr.reduction_ratio;
    let whole = transport == Transport::Udp || ratio.is_power_of_two();
    check(whole && (1..=transport.max_reduction_ratio()).contains(&ratio), Violation::ReductionRatio)?;
    check((1..=ratio).contains(&iocr.phase), Violation::Phase)?;
    let time = iocr.cycle_time();
    let served = u32::from(description.min_device_interval)..=transport.max_counts();
    check(served.contains(&time.counts()), Violation::ReductionRatio)?;
    let offset = iocr.frame_send_offset;
    let send_clock_ns = u64::from(clock) * COUNT_NANOS;
    check(offset == Iocr::BEST_EFFORT || u64::from(offset) < send_clock_ns, Violation::FrameSendOffset)?;
    let factors = 1..=transport.max_hold_factor(time.period());
    check(factors.contains(&iocr.watchdog_factor), Violation::WatchdogFactor)?;
    check(factors.contains(&iocr.data_hold_factor), Violation::DataHoldFactor)?;
    check(transport == Transport::Udp || is_tag(iocr.tag_header, tag::RT), Violation::IocrTagHeader)
}

/// Returns whether it is this tag, whatever its DEI is: its priority, and no VLAN, since frames are sent in none.
const fn is_tag(header: u16, tag: Tag) -> bool {
    const DEI: u16 = 0x1000;
    header & !DEI == tag.0
}

/// Checks that every object is an expected submodule and that no two share a byte of the frame.
fn check_objects(iocr: &Iocr, expected: &[ExpectedModule]) -> Result<(), Violation> {
    let mut taken = [false; MAX_C_SDU_LEN];
    let data_length = usize::from(iocr.data_length);
    let mut take = |object: &Object, len: usize, violation| {
        let start = usize::from(object.offset);
        let end = start.saturating_add(len);
        let place = taken.get_mut(start..end).filter(|_| end <= data_length).ok_or(violation)?;
        check(!place.contains(&true), violation)?;
        place.fill(true);
        Ok(())
    };
    let is_input = iocr.iocr_type == IocrType::Input;
    for object in &iocr.objects {
        let submodule = find(object, expected, Violation::IoDataSlot, Violation::IoDataSubslot)?;
        let len = if is_input { submodule.input_len } else { submodule.output_len };
        let len = len.ok_or(Violation::IoDataSubslot)?;
        take(object, usize::from(len) + 1, Violation::IoDataOffset)?;
    }
    for object in &iocr.consumer_statuses {
        let submodule = find(object, expected, Violation::IocsSlot, Violation::IocsSubslot)?;
        // A consumer status travels in the opposite direction of its data.
        let data = if is_input { submodule.output_len } else { submodule.input_len };
        check(data.is_some(), Violation::IocsSubslot)?;
        take(object, 1, Violation::IocsOffset)?;
    }
    Ok(())
}

fn find<'a>(
    object: &Object,
    expected: &'a [ExpectedModule],
    no_slot: Violation,
    no_subslot: Violation,
) -> Result<&'a ExpectedSubmodule, Violation> {
    let module = expected.iter().find(|module| module.slot == object.slot).ok_or(no_slot)?;
    let mut submodules = module.submodules.iter();
    submodules.find(|submodule| submodule.subslot == object.subslot).ok_or(no_subslot)
}

fn check_alarm_cr(alarm_cr: &AlarmCr) -> Result<(), Violation> {
    let over_udp = alarm_cr.properties & AlarmCr::OVER_UDP != 0;
    let lt = if over_udp { LT_UDP } else { ETHER_TYPE };
    check(alarm_cr.alarm_cr_type == 1, Violation::AlarmCrType)?;
    check(alarm_cr.lt == lt, Violation::AlarmCrLt)?;
    check(alarm_cr.properties & !3 == 0, Violation::AlarmCrProperties)?;
    check((1..=100).contains(&alarm_cr.rta_timeout), Violation::RtaTimeoutFactor)?;
    check((3..=15).contains(&alarm_cr.rta_retries), Violation::RtaRetries)?;
    check((200..=1432).contains(&alarm_cr.max_data_length), Violation::MaxAlarmDataLength)?;
    check(over_udp || is_tag(alarm_cr.tag_high, tag::RT), Violation::AlarmCrTagHeaderHigh)?;
    check(over_udp || is_tag(alarm_cr.tag_low, tag::ALARM_LOW), Violation::AlarmCrTagHeaderLow)
}

/// Compares the expected modules with the device's. A submodule of the right kind but with other lengths is a
/// configuration error, not another module.
fn compare(expected: &[ExpectedModule], description: &Description) -> Result<Vec<DiffModule>, Violation> {
    let mut diff = Vec::new();
    for module in expected {
        let real = description.module(module.slot);
        let mut submodules = Vec::new();
        for submodule in &module.submodules {
            check(submodule.properties & ExpectedSubmodule::CHANGES == 0, Violation::SubmoduleProperties)?;
            let real_submodule = real.and_then(|real| real.submodule(submodule.subslot));
            match real_submodule {
                Some(real) if real.ident == submodule.ident => {
                    let lens = (submodule.input_len.unwrap_or(0), submodule.output_len.unwrap_or(0));
                    check(lens == (real.input_len, real.output_len), Violation::SubmoduleDataLength)?;
                }
                Some(real) => submodules.push(DiffSubmodule {
                    subslot: submodule.subslot,
                    ident: real.ident,
                    state: SubmoduleState::WRONG,
                }),
                None => submodules.push(DiffSubmodule {
                    subslot: submodule.subslot,
                    ident: 0,
                    state: SubmoduleState::NONE,
                }),
            }
        }
        let (slot, ident) = (module.slot, real.map_or(0, |real| real.ident));
        let state = match real {
            None => ModuleState::NoModule,
            Some(real) if real.ident != module.ident => ModuleState::WrongModule,
            Some(_) if submodules.is_empty() => continue,
            Some(_) => ModuleState::ProperModule,
        };
        if state == ModuleState::WrongModule {
            // In a wrong module no submodule can be used, whatever its number.
            submodules = all_wrong(module, description);
        }
        diff.push(DiffModule { slot, ident, state, submodules });
    }
    Ok(diff)
}

fn all_wrong(module: &ExpectedModule, description: &Description) -> Vec<DiffSubmodule> {
    let wrong = |expected: &ExpectedSubmodule| {
        let real = description.submodule(module.slot, expected.subslot);
        let state = if real.is_some() { SubmoduleState::WRONG } else { SubmoduleState::NONE };
        DiffSubmodule { subslot: expected.subslot, ident: real.map_or(0, |real| real.ident), state }
    };
    module.submodules.iter().map(wrong).collect()
}

const fn check(holds: bool, violation: Violation) -> Result<(), Violation> {
    if holds { Ok(()) } else { Err(violation) }
}
