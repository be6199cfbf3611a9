//! The form of a script: outputs over time.
//!
//! ```toml
//! run = 0.5              # seconds after the start from which outputs count; left out, --run decides
//!
//! [[outputs]]
//! name = "Speed"
//! ramp = { from = 0, to = 100, seconds = 2 }
//! ```

use emulated_device::{CounterSource, RampSource, ScriptError, SourceOverTime, read_script};
use serde::{Deserialize, Serialize};

/// Outputs to a device over time.
#[derive(Clone, PartialEq, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct OutputScript {
    /// Seconds after the start from which outputs count.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub run: Option<f64>,
    /// Outputs; later ones are written over earlier ones.
    #[serde(default)]
    pub outputs: Vec<ScriptedOutput>,
}

/// Output over time. It has one of `value`, `ramp`, `counter` and `table`.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct ScriptedOutput {
    /// Name of the output, as the device lists it.
    pub name: String,
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
}

impl OutputScript {
    /// Reads a script from a TOML file.
    ///
    /// # Errors
    ///
    /// It is longer than 1 MiB, is not TOML, or has a key or value that a script does not have.
    pub fn from_toml(text: &str) -> Result<Self, ScriptError> {
        let script: Self = read_script(text)?;
        // A year, as other times of scripts.
        if script.run.is_some_and(|run| !(0.0..=366.0 * 86_400.0).contains(&run)) {
            return Err(ScriptError::new("run: must be seconds after the start, at most a year".to_owned()));
        }
        script.outputs.iter().try_for_each(ScriptedOutput::check)?;
        Ok(script)
    }
}

impl ScriptedOutput {
    pub(crate) fn source(&self) -> SourceOverTime<'_> {
        let Self { value, ramp, counter, table, .. } = self;
        SourceOverTime { value: *value, ramp: *ramp, counter: *counter, table: table.as_deref() }
    }

    fn check(&self) -> Result<(), ScriptError> {
        let name = device_files::excerpt(&self.name);
        match self.source().count() {
            1 => self.source().check(&name),
            count => Err(ScriptError::new(format!(
                "output `{name}` has {count} sources: give one of value, ramp, counter, table"
            ))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `INSTA_UPDATE=always` writes it again, as for snapshots.
    #[test]
    #[expect(clippy::disallowed_methods, reason = "the test compares a file of the repository")]
    fn the_committed_schema_matches_the_script() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../cell/schemas/output-script.schema.json");
        let schema = serde_json::to_string_pretty(&schemars::schema_for!(OutputScript)).unwrap() + "\n";
        if std::env::var("INSTA_UPDATE").is_ok_and(|update| update == "always") {
            std::fs::write(path, &schema).unwrap();
        }
        let message = "the script changed: INSTA_UPDATE=always cargo test -p driven-device";
        assert!(std::fs::read_to_string(path).unwrap_or_default() == schema, "{message}");
    }

    #[test]
    fn a_script_that_nothing_could_follow_is_refused_with_its_key() {
        for (text, expected) in [
            ("[[outputs]]\nname = \"a\"", "script: output `a` has 0 sources"),
            ("[[outputs]]\nname = \"a\"\nvalue = 1\ntable = [[0, 1]]", "has 2 sources"),
            (
                "[[outputs]]\nname = \"a\"\ntable = [[1, 2], [1, 3]]",
                "script: table of `a`: must have rows with ascending seconds",
            ),
            ("run = -1", "run: must be"),
            ("[[inputs]]\nname = \"a\"\nvalue = 1", "unknown field `inputs`"),
        ] {
            let error = OutputScript::from_toml(text).unwrap_err().to_string();
            assert!(error.contains(expected) && error.matches("script").count() == 1, "{text}: {error}");
        }
    }
}
