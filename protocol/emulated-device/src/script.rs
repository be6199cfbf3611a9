//! The form of a script: inputs over time, and faults at times.
//!
//! ```toml
//! [[inputs]]
//! place = "1.1"          # slot.subslot, assembly, or index:subindex; see the list at the start
//! byte = 2
//! type = "uint16"
//! ramp = { from = 0, to = 100, seconds = 2 }
//!
//! [[faults]]
//! at = 1.2               # seconds after the start
//! seconds = 0.5
//! kind = "silent"
//! ```

use ethercat_subdevice::MailFault;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

/// Inputs of a device over time, and its faults.
#[derive(Clone, PartialEq, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(any(test, feature = "schema"), derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct DeviceScript {
    /// Inputs; later ones are written over earlier ones.
    #[serde(default)]
    pub inputs: Vec<ScriptedInput>,
    /// Faults.
    #[serde(default)]
    pub faults: Vec<ScriptedFault>,
}

/// Input over time. It has one of `value`, `ramp`, `counter`, `table` and `echo`.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[cfg_attr(any(test, feature = "schema"), derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct ScriptedInput {
    /// Place of the inputs, as the device lists it.
    pub place: String,
    /// First byte in the place.
    #[serde(default)]
    pub byte: u32,
    /// Bit in that byte, 0 for the lowest; for `bool`.
    #[serde(default)]
    pub bit: u8,
    /// Type of the value, in the byte order of the bus; for an echo without a type, all bytes of the place.
    #[serde(rename = "type", default, skip_serializing_if = "Option::is_none")]
    pub value_type: Option<ValueType>,
    /// Constant.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub value: Option<f64>,
    /// Straight line from one value to another, again and again.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ramp: Option<RampSource>,
    /// Number that counts up; it wraps around at the end of its type.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub counter: Option<CounterSource>,
    /// Pairs of seconds after the start and the value from then on.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub table: Option<Vec<(f64, f64)>>,
    /// Outputs that come back as inputs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub echo: Option<EchoSource>,
}

/// Type of a value.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[cfg_attr(any(test, feature = "schema"), derive(schemars::JsonSchema))]
#[serde(rename_all = "lowercase")]
pub enum ValueType {
    /// One bit: any value but 0 sets it.
    Bool,
    /// Unsigned number of 8 bits.
    Uint8,
    /// Unsigned number of 16 bits.
    Uint16,
    /// Unsigned number of 32 bits.
    Uint32,
    /// Signed number of 8 bits.
    Int8,
    /// Signed number of 16 bits.
    Int16,
    /// Signed number of 32 bits.
    Int32,
    /// Floating-point number of 32 bits.
    Real32,
    /// Floating-point number of 64 bits.
    Real64,
}

impl ValueType {
    /// Returns the bytes of a value; a bit is in one.
    #[must_use]
    pub const fn bytes(self) -> usize {
        match self {
            Self::Bool | Self::Uint8 | Self::Int8 => 1,
            Self::Uint16 | Self::Int16 => 2,
            Self::Uint32 | Self::Int32 | Self::Real32 => 4,
            Self::Real64 => 8,
        }
    }
}

/// Source of a value over time, as inputs and outputs of scripts have it.
#[derive(Clone, Copy, Debug)]
pub struct SourceOverTime<'a> {
    /// Constant.
    pub value: Option<f64>,
    /// Straight line.
    pub ramp: Option<RampSource>,
    /// Number that counts up.
    pub counter: Option<CounterSource>,
    /// Pairs of seconds and value.
    pub table: Option<&'a [(f64, f64)]>,
}

/// Straight line from one value to another.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
#[cfg_attr(any(test, feature = "schema"), derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct RampSource {
    /// First value.
    pub from: f64,
    /// Last value, after which it starts over.
    pub to: f64,
    /// Time from the first to the last value.
    pub seconds: f64,
}

/// Number that counts up.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
#[cfg_attr(any(test, feature = "schema"), derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct CounterSource {
    /// Step.
    #[serde(default = "one")]
    pub step: f64,
    /// Time between steps.
    pub seconds: f64,
}

fn one() -> f64 {
    1.0
}

/// Outputs that come back as inputs.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[cfg_attr(any(test, feature = "schema"), derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct EchoSource {
    /// Place of the outputs.
    pub place: String,
    /// First byte in the place.
    #[serde(default)]
    pub byte: u32,
}

/// Fault at a time.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[cfg_attr(any(test, feature = "schema"), derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct ScriptedFault {
    /// Seconds after the start; from standard input, seconds from now.
    #[serde(default)]
    pub at: f64,
    /// Time after which it ends; left out, it stays.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seconds: Option<f64>,
    /// Kind of fault.
    pub kind: FaultKind,
    /// Slot of a missing module or an alarm.
    #[serde(default)]
    pub slot: u16,
    /// Subslot of an alarm.
    #[serde(default = "first_subslot")]
    pub subslot: u16,
    /// Channel of an alarm; 0x8000 for the submodule as a whole.
    #[serde(default = "whole_submodule")]
    pub channel: u16,
    /// ChannelErrorType of an alarm, error code of an emergency, or AL status code of a fall out of OP.
    #[serde(default)]
    pub code: u16,
    /// Milliseconds by which frames are answered later.
    #[serde(default)]
    pub delay_ms: u32,
    /// Place of the inputs that have a wrong size or do not change; left out, the first place or all.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub place: Option<String>,
}

/// First subslot of a module.
const fn first_subslot() -> u16 {
    1
}

/// ChannelNumber of a submodule as a whole (IEC 61158-6-10, ChannelNumber).
const fn whole_submodule() -> u16 {
    0x8000
}

/// Kind of fault.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[cfg_attr(any(test, feature = "schema"), derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum FaultKind {
    /// It neither receives nor sends.
    Silent,
    /// It answers later, by `delay_ms`.
    Slow,
    /// It refuses connections, and on EtherCAT the state OP.
    Refuse,
    /// It restarts with another device ID, product code or revision.
    WrongIdentity,
    /// It restarts with one byte of inputs more.
    WrongSize,
    /// It restarts without the module in `slot`.
    ModuleGone,
    /// Inputs do not change.
    StuckInputs,
    /// PROFINET: diagnosis of a channel appears, and disappears at the end.
    Alarm,
    /// EtherCAT: an emergency by CoE.
    Emergency,
    /// EtherCAT: it falls to SAFE-OP with an AL status code.
    OutOfOp,
    /// EtherCAT: its process data do not count in the working counter.
    WorkingCounter,
    /// EtherCAT: no answer comes by the mailbox.
    MailboxLost,
    /// EtherCAT: the answer to a request by the mailbox comes after the next request.
    MailboxLate,
    /// EtherCAT: each answer by the mailbox comes twice.
    MailboxDoubled,
    /// EtherCAT: all answers by the mailbox have the same counter.
    MailboxCounter,
    /// EtherCAT: the header of answers by the mailbox has a length beyond it.
    MailboxLength,
    /// EtherCAT: the header of answers by the mailbox names another protocol.
    MailboxProtocol,
    /// EtherCAT: segments of objects have the wrong toggle bit.
    MailboxToggle,
    /// EtherCAT: requests by the mailbox are answered by an error of the mailbox.
    MailboxError,
}

impl FaultKind {
    /// Returns the fault of a mailbox that it is.
    pub(crate) const fn mail_fault(self) -> Option<MailFault> {
        Some(match self {
            Self::MailboxLost => MailFault::Lost,
            Self::MailboxLate => MailFault::Late,
            Self::MailboxDoubled => MailFault::Doubled,
            Self::MailboxCounter => MailFault::Counter,
            Self::MailboxLength => MailFault::Length,
            Self::MailboxProtocol => MailFault::Protocol,
            Self::MailboxToggle => MailFault::Toggle,
            Self::MailboxError => MailFault::Error,
            _ => return None,
        })
    }
}

/// Reason why a text is not a script, or does not fit the device.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
#[error("script: {0}")]
pub struct ScriptError(String);

impl ScriptError {
    /// Makes the error of this fault and remedy.
    #[must_use]
    pub const fn new(fault: String) -> Self {
        Self(fault)
    }
}

/// Longest script in bytes.
const MOST_BYTES: usize = 1 << 20;

/// Longest time in seconds: a year.
const MOST_SECONDS: f64 = 366.0 * 86_400.0;

/// Reads a script of any form from TOML.
///
/// # Errors
///
/// It is longer than 1 MiB, is not TOML, or has a key that this form does not have.
pub fn read_script<S: DeserializeOwned>(text: &str) -> Result<S, ScriptError> {
    if text.len() > MOST_BYTES {
        return Err(ScriptError(format!("{} bytes: must be at most {MOST_BYTES}", text.len())));
    }
    toml::from_str(text).map_err(|error| ScriptError(error.to_string().trim_end().to_owned()))
}

impl DeviceScript {
    /// Reads a script from a TOML file.
    ///
    /// # Errors
    ///
    /// It is longer than 1 MiB, is not TOML, or has a key or value that a script does not have.
    pub fn from_toml(text: &str) -> Result<Self, ScriptError> {
        let script: Self = read_script(text)?;
        script.faults.iter().try_for_each(ScriptedFault::check)?;
        script.inputs.iter().try_for_each(ScriptedInput::check)?;
        Ok(script)
    }
}

fn check_seconds(name: &str, seconds: f64, least: f64) -> Result<(), ScriptError> {
    if (least..=MOST_SECONDS).contains(&seconds) {
        return Ok(());
    }
    Err(ScriptError(format!("{name} {seconds}: must be {least} to {MOST_SECONDS} seconds")))
}

impl ScriptedFault {
    pub(crate) fn check(&self) -> Result<(), ScriptError> {
        check_seconds("at", self.at, 0.0)?;
        self.seconds.map_or(Ok(()), |seconds| check_seconds("seconds", seconds, 0.0))
    }
}

impl SourceOverTime<'_> {
    /// Returns the value after so many seconds.
    #[must_use]
    pub fn value_at(&self, seconds: f64) -> f64 {
        if let Some(ramp) = self.ramp {
            let share = (seconds / ramp.seconds).fract();
            return ramp.from + (ramp.to - ramp.from) * share;
        }
        if let Some(counter) = self.counter {
            return counter.step * (seconds / counter.seconds).floor();
        }
        if let Some(table) = self.table {
            let past = table.iter().take_while(|(from, _)| *from <= seconds);
            return past.last().map_or(0.0, |(_, value)| *value);
        }
        self.value.unwrap_or(0.0)
    }

    /// Returns the number of sources; a signal has one.
    #[must_use]
    pub fn count(&self) -> usize {
        let given = [self.value.is_some(), self.ramp.is_some(), self.counter.is_some(), self.table.is_some()];
        given.iter().filter(|given| **given).count()
    }

    /// Checks times and tables.
    ///
    /// # Errors
    ///
    /// A time is too short or too long, or a table is not in order.
    pub fn check(&self, name: &str) -> Result<(), ScriptError> {
        // A shorter time is below what a device keeps.
        const SHORTEST: f64 = 1e-4;
        self.ramp.map_or(Ok(()), |ramp| check_seconds("ramp seconds", ramp.seconds, SHORTEST))?;
        self.counter.map_or(Ok(()), |counter| check_seconds("counter seconds", counter.seconds, SHORTEST))?;
        let Some(table) = self.table else { return Ok(()) };
        if table.is_empty() || table.windows(2).any(|pair| matches!(pair, [one, next] if one.0 >= next.0)) {
            return Err(ScriptError(format!("table of `{name}`: must have rows with ascending seconds")));
        }
        table.iter().try_for_each(|(seconds, _)| check_seconds("table seconds", *seconds, 0.0))
    }
}

impl ScriptedInput {
    /// Returns the value after so many seconds; 0 for an echo.
    pub(crate) fn value_at(&self, seconds: f64) -> f64 {
        self.source().value_at(seconds)
    }

    fn source(&self) -> SourceOverTime<'_> {
        let Self { value, ramp, counter, table, .. } = self;
        SourceOverTime { value: *value, ramp: *ramp, counter: *counter, table: table.as_deref() }
    }

    pub(crate) fn check(&self) -> Result<(), ScriptError> {
        let source = self.source();
        let place = &self.place;
        match source.count() + usize::from(self.echo.is_some()) {
            1 => {}
            count => {
                return Err(ScriptError(format!(
                    "input `{place}` has {count} sources: give one of value, ramp, counter, table, echo"
                )));
            }
        }
        if self.value_type.is_none() && self.echo.is_none() {
            return Err(ScriptError(format!(
                "input `{place}` has no type; add one, such as type = \"uint16\""
            )));
        }
        if self.bit > 7 {
            return Err(ScriptError(format!("bit {} of `{place}`: must be 0 to 7", self.bit)));
        }
        source.check(place)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `INSTA_UPDATE=always` writes it again, as for snapshots.
    #[test]
    #[expect(clippy::disallowed_methods, reason = "the test compares a file of the repository")]
    fn the_committed_schema_matches_the_script() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../cell/schemas/device-script.schema.json");
        let schema = serde_json::to_string_pretty(&schemars::schema_for!(DeviceScript)).unwrap() + "\n";
        if std::env::var("INSTA_UPDATE").is_ok_and(|update| update == "always") {
            std::fs::write(path, &schema).unwrap();
        }
        let message = "the script changed: INSTA_UPDATE=always cargo test -p emulated-device";
        assert!(std::fs::read_to_string(path).unwrap_or_default() == schema, "{message}");
    }

    #[test]
    fn a_script_that_no_device_could_follow_is_refused_with_its_key() {
        for (text, expected) in [
            ("[[inputs]]\nplace = \"1\"\ntype = \"uint8\"", "has 0 sources"),
            (
                "[[inputs]]\nplace = \"1\"\ntype = \"uint8\"\nvalue = 1\necho = { place = \"2\" }",
                "has 2 sources",
            ),
            ("[[inputs]]\nplace = \"1\"\nvalue = 1", "has no type"),
            (
                "[[inputs]]\nplace = \"1\"\ntype = \"uint8\"\nramp = { from = 0, to = 1, seconds = 0 }",
                "ramp seconds 0",
            ),
            ("[[inputs]]\nplace = \"1\"\ntype = \"uint8\"\ntable = [[1, 2], [1, 3]]", "ascending"),
            ("[[inputs]]\nplace = \"1\"\ntype = \"uint8\"\nvalue = 1\nbit = 8", "bit 8"),
            ("[[faults]]\nat = nan\nkind = \"silent\"", "at NaN"),
            ("[[faults]]\nat = 1\nkind = \"loud\"", "unknown variant `loud`"),
            ("[[fault]]\nat = 1\nkind = \"silent\"", "unknown field `fault`"),
        ] {
            let error = DeviceScript::from_toml(text).unwrap_err().to_string();
            assert!(error.contains(expected), "{text}: {error}");
        }
    }
}
