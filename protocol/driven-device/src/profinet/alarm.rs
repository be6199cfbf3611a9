//! Alarms in the words of the GSDML (IEC 61158-6-10, AlarmNotification-PDU; ChannelDiagnosisData).

use std::fmt::Write as _;

use device_files::Gsdml;
use profinet::ReceivedAlarm;
use profinet::record::{Diagnosis, parse_diagnosis};

/// UserStructureIdentifiers of diagnosis by channel, and of the same with more values.
const CHANNEL: u16 = 0x8000;
const EXTENDED_CHANNEL: u16 = 0x8002;
const QUALIFIED_CHANNEL: u16 = 0x8003;

/// ChannelNumber of the submodule as a whole.
const WHOLE_SUBMODULE: u16 = 0x8000;

/// ChannelProperties: bits 11 and 12 say whether the error appears or disappears, bits 9 and 10 ask for maintenance.
const DISAPPEARS: [u16; 2] = [2, 3];

/// Says an alarm in the words of the file: where it comes from, what it is and whether it ends.
pub(crate) fn describe(gsdml: &Gsdml, alarm: &ReceivedAlarm) -> String {
    let head = &alarm.head;
    let mut words = format!("{} alarm of subslot {}.{}", kind(head.alarm_type), head.slot, head.subslot);
    let mut rest = alarm.items.as_slice();
    if let Some(identifier) = word(&mut rest) {
        structure(gsdml, identifier, rest, &mut words);
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
    match identifier {
        CHANNEL | EXTENDED_CHANNEL | QUALIFIED_CHANNEL => channels(gsdml, identifier, data, words),
        _ => unit(gsdml, identifier, data, words),
    }
}

fn channels(gsdml: &Gsdml, identifier: u16, mut rest: &[u8], words: &mut String) {
    while let (Some(channel), Some(properties), Some(error)) =
        (word(&mut rest), word(&mut rest), word(&mut rest))
    {
        let extended = (identifier != CHANNEL).then(|| word(&mut rest)).flatten();
        // ExtChannelAddValue, and the qualifier.
        let more = match identifier {
            EXTENDED_CHANNEL => 4,
            QUALIFIED_CHANNEL => 8,
            _ => 0,
        };
        rest = rest.get(more..).unwrap_or_default();
        let place = match channel {
            WHOLE_SUBMODULE => "submodule".to_owned(),
            channel => format!("channel {channel}"),
        };
        let specifier = properties >> 11 & 3;
        let state = if DISAPPEARS.contains(&specifier) { "disappears" } else { "appears" };
        let maintenance = match properties >> 9 & 3 {
            1 => ", maintenance required",
            2 => ", maintenance demanded",
            _ => "",
        };
        // Writing to a String cannot fail.
        let _ = write!(words, "; {place}: {} {state}{maintenance}", name(gsdml, error, extended));
    }
}

/// Returns the name of an error: that of the file, else that of the standard, else its number.
fn name(gsdml: &Gsdml, error: u16, extended: Option<u16>) -> String {
    let of_file = |extended: Option<u16>| {
        gsdml.channel_diagnosis.iter().find(|it| it.error_type == error && it.extended_type == extended)
    };
    let found = extended.and_then(|extended| of_file(Some(extended))).or_else(|| of_file(None));
    let code = extended
        .map_or_else(|| format!("0x{error:04X}"), |extended| format!("0x{error:04X}/0x{extended:04X}"));
    match (found, standard(error)) {
        (Some(found), _) => match &found.help {
            Some(help) => format!("{} ({code}; {help})", found.name),
            None => format!("{} ({code})", found.name),
        },
        (None, Some(name)) => format!("{name} ({code})"),
        (None, None) => format!("error {code}"),
    }
}

/// Returns the standard's name of a ChannelErrorType (IEC 61158-6-10, ChannelErrorType).
const fn standard(error: u16) -> Option<&'static str> {
    Some(match error {
        1 => "short circuit",
        2 => "undervoltage",
        3 => "overvoltage",
        4 => "overload",
        5 => "overtemperature",
        6 => "line break",
        7 => "upper limit exceeded",
        8 => "lower limit exceeded",
        9 => "error",
        16 => "parameter error",
        17 => "power supply error",
        18 => "fuse blown",
        20 => "ground fault",
        21 => "reference point lost",
        22 => "process event lost",
        23 => "threshold error",
        24 => "output disabled",
        26 => "external error",
        28 => "temporary fault",
        _ => return None,
    })
}

fn unit(gsdml: &Gsdml, identifier: u16, data: &[u8], words: &mut String) {
    let known = gsdml.unit_diagnosis.iter().find(|it| it.identifier == identifier);
    let name = known.and_then(|it| it.name.clone()).unwrap_or_else(|| format!("data 0x{identifier:04X}"));
    let _ = write!(words, "; {name}: ");
    let _ = data.iter().try_for_each(|byte| write!(words, "{byte:02x}"));
}

fn word(rest: &mut &[u8]) -> Option<u16> {
    let (first, after) = rest.split_first_chunk::<2>()?;
    *rest = after;
    Some(u16::from_be_bytes(*first))
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
