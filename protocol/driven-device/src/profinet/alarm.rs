//! Alarms in the words of the GSDML (IEC 61158-6-10, AlarmNotification-PDU; ChannelDiagnosisData).

use std::fmt::Write as _;

use device_files::Gsdml;
use profinet::ReceivedAlarm;
use profinet::record::{
    ChannelFault, Diagnosis, DiagnosisItem, WHOLE_SUBMODULE, channel_error_name, diagnosis_items,
    parse_diagnosis,
};

/// Says an alarm in the words of the file: where it comes from, what it is and whether it ends.
pub(crate) fn describe(gsdml: &Gsdml, alarm: &ReceivedAlarm) -> String {
    let head = &alarm.head;
    let mut words = format!("{} alarm of subslot {}.{}", kind(head.alarm_type), head.slot, head.subslot);
    if let Some((identifier, data)) = alarm.items.split_first_chunk() {
        structure(gsdml, u16::from_be_bytes(*identifier), data, &mut words);
    }
    words
}

/// Says what a record of DiagnosisData has, in the words of the file.
pub(crate) fn earlier(gsdml: &Gsdml, record: &[u8]) -> Vec<String> {
    let Some(found) = parse_diagnosis(record) else {
        return vec![format!("its diagnosis record of {} bytes cannot be read", record.len())];
    };
    let describe = |it: Diagnosis| {
        let mut words = format!("diagnosis of subslot {}.{}", it.slot, it.subslot);
        structure(gsdml, it.identifier, &it.data, &mut words);
        words
    };
    found.into_iter().take(MOST_EARLIER).map(describe).collect()
}

/// Diagnoses of a device that are said.
const MOST_EARLIER: usize = 64;

/// Says data of a UserStructureIdentifier.
fn structure(gsdml: &Gsdml, identifier: u16, data: &[u8], words: &mut String) {
    for item in diagnosis_items(identifier, data) {
        match item {
            DiagnosisItem::Channel(fault) => channel(gsdml, &fault, words),
            DiagnosisItem::Maker(identifier) => unit(gsdml, identifier, data, words),
        }
    }
}

fn channel(gsdml: &Gsdml, fault: &ChannelFault, words: &mut String) {
    let place = match fault.channel {
        WHOLE_SUBMODULE => "submodule".to_owned(),
        channel => format!("channel {channel}"),
    };
    let state = if fault.disappears() { "disappears" } else { "appears" };
    // Bits 9 and 10 of ChannelProperties.
    let maintenance = match fault.properties >> 9 & 3 {
        1 => ", maintenance required",
        2 => ", maintenance demanded",
        _ => "",
    };
    // Writing to a String cannot fail.
    let _ = write!(words, "; {place}: {} {state}{maintenance}", name(gsdml, fault.error, fault.extended));
}

/// Returns the name of an error: that of the file, else that of the standard, else its number.
fn name(gsdml: &Gsdml, error: u16, extended: Option<u16>) -> String {
    let of_file = |extended: Option<u16>| {
        gsdml.channel_diagnosis.iter().find(|it| it.error_type == error && it.extended_type == extended)
    };
    let found = extended.and_then(|extended| of_file(Some(extended))).or_else(|| of_file(None));
    let code = extended
        .map_or_else(|| format!("0x{error:04X}"), |extended| format!("0x{error:04X}/0x{extended:04X}"));
    match (found, channel_error_name(error)) {
        (Some(found), _) => match &found.help {
            Some(help) => format!("{} ({code}; {help})", found.name),
            None => format!("{} ({code})", found.name),
        },
        (None, Some(name)) => format!("{name} ({code})"),
        (None, None) => format!("error {code}"),
    }
}

fn unit(gsdml: &Gsdml, identifier: u16, data: &[u8], words: &mut String) {
    let known = gsdml.unit_diagnosis.iter().find(|it| it.identifier == identifier);
    let name = known.and_then(|it| it.name.clone()).unwrap_or_else(|| format!("data 0x{identifier:04X}"));
    let _ = write!(words, "; {name}: ");
    let _ = data.iter().try_for_each(|byte| write!(words, "{byte:02x}"));
}

/// Returns the name of an AlarmType (IEC 61158-6-10, AlarmType).
fn kind(alarm_type: u16) -> String {
    match alarm_type {
        0x01 => "diagnosis",
        0x02 => "process",
        0x03 => "pull",
        0x04 => "plug",
        0x05 => "status",
        0x06 => "update",
        0x08 => "controlled by supervisor",
        0x09 => "released by supervisor",
        0x0A => "plug of a wrong submodule",
        0x0B => "return of submodule",
        0x0C => "end of diagnosis",
        0x0E => "port data change",
        0x1E => "upload and retrieval",
        0x1F => "pull of module",
        other => return format!("type 0x{other:04X}"),
    }
    .to_owned()
}
