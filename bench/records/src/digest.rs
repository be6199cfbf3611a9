//! Digests of what is saved of a run, to notice that a value or a file was changed by accident. They do not stop anyone who
//! computes them again.
//!
//! Each value of `results.json` has one, and so have the files beside it that say what was run. A field that a later version
//! adds is covered without a change here.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use serde::{Deserialize, Serialize};
use serde_json::Value;
use sha2::{Digest as _, Sha256};

/// The key of the digests in `results.json`. They do not cover themselves.
const OWN_KEY: &str = "digests";

/// The value whose entries have a digest each: the results of each type.
const BY_ENTRY: &str = "results";

/// Bytes of a SHA-256 that are kept: two values share 64 bits by accident once in 2^64.
const KEPT_BYTES: usize = 8;

/// The first 64 bits of the SHA-256 of each value of `results.json` and of files beside it, in hexadecimal.
#[derive(Clone, PartialEq, Eq, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(transparent)]
pub struct Digests(BTreeMap<String, String>);

/// A value or a file that does not fit its digest.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Mismatch {
    /// A value of `results.json`.
    Value {
        /// Its key.
        key: String,
        /// The value if it is a short one, as JSON.
        value: Option<String>,
        /// Its digest; `None` if the value is missing.
        found: Option<String>,
        /// The saved digest; `None` if the value was added.
        saved: Option<String>,
    },
    /// A file beside it.
    File {
        /// Its name.
        name: String,
        /// Its digest.
        found: String,
        /// The saved digest.
        saved: String,
    },
}

impl Digests {
    /// Computes the digests of files, each with its name and content.
    #[must_use]
    pub fn of_files(files: &[(&str, &str)]) -> Self {
        let digest = |(name, content): &(&str, &str)| ((*name).to_owned(), digest_of(content));
        Self(files.iter().map(digest).collect())
    }

    /// Returns the digests of the same files and those of these results.
    #[must_use]
    pub fn with_values(&self, results: &Value) -> Self {
        let files = self.0.iter().filter(|(name, _)| is_file(name));
        let files = files.map(|(name, digest)| (name.clone(), digest.clone()));
        Self(files.chain(values(results).map(|(key, value)| (key, of_value(value)))).collect())
    }

    /// Compares results and files with their digests; `read` returns the content of a file beside the results.
    ///
    /// # Errors
    ///
    /// The first value or file that does not fit its digest.
    pub fn check(&self, results: &Value, read: impl Fn(&str) -> Option<Vec<u8>>) -> Result<(), Mismatch> {
        for (name, saved) in self.0.iter().filter(|(name, _)| is_file(name)) {
            // Who reads a run notices a missing file; a changed one looks like that of the run.
            let Some(content) = read(name) else { continue };
            let found = digest_of(content);
            if found != *saved {
                return Err(Mismatch::File { name: name.clone(), found, saved: saved.clone() });
            }
        }
        let found: BTreeMap<_, _> = values(results).collect();
        for (key, value) in &found {
            let (digest, saved) = (of_value(value), self.0.get(key));
            if saved != Some(&digest) {
                let value = (!value.is_array() && !value.is_object()).then(|| value.to_string());
                let (found, saved) = (Some(digest), saved.cloned());
                return Err(Mismatch::Value { key: key.clone(), value, found, saved });
            }
        }
        match self.0.iter().find(|(key, _)| !is_file(key) && !found.contains_key(*key)) {
            None => Ok(()),
            Some((key, saved)) => Err(Mismatch::Value {
                key: key.clone(),
                value: None,
                found: None,
                saved: Some(saved.clone()),
            }),
        }
    }
}

/// Returns whether a digest is that of a file: its name has an extension, and a key of results is one word, or two with
/// `results.` before.
fn is_file(name: &str) -> bool {
    name.contains('.') && !name.starts_with("results.")
}

/// Returns the values that have a digest each, with their keys.
fn values(results: &Value) -> impl Iterator<Item = (String, &Value)> {
    let all = results.as_object().into_iter().flatten().filter(|(key, _)| *key != OWN_KEY);
    all.flat_map(|(key, value)| match value.as_object() {
        Some(entries) if key == BY_ENTRY => {
            entries.iter().map(|(entry, value)| (format!("{BY_ENTRY}.{entry}"), value)).collect()
        }
        _ => vec![(key.clone(), value)],
    })
}

fn of_value(value: &Value) -> String {
    let mut text = String::new();
    write_value(&mut text, value);
    digest_of(text)
}

/// Writes a value in a form that does not depend on spaces, on the order of keys, or on whether a whole number is written with
/// a point.
fn write_value(text: &mut String, value: &Value) {
    // Writing to a string never fails.
    let _ = match value {
        Value::Null => write!(text, "null,"),
        Value::Bool(value) => write!(text, "{value},"),
        Value::Number(number) => match number.as_u64() {
            Some(whole) => write!(text, "{whole},"),
            // Rust writes the fewest digits that give the same number back, and no point after a whole one.
            None => write!(text, "{},", number.as_f64().unwrap_or(f64::NAN)),
        },
        Value::String(value) => write!(text, "{}:{value},", value.len()),
        Value::Array(elements) => {
            let written = write!(text, "[{}:", elements.len());
            elements.iter().for_each(|element| write_value(text, element));
            written
        }
        Value::Object(entries) => {
            let written = write!(text, "{{{}:", entries.len());
            // With some features of `serde_json` a map has the order of the file.
            let sorted: BTreeMap<_, _> = entries.iter().collect();
            for (key, value) in sorted {
                let _ = write!(text, "{}:{key},", key.len());
                write_value(text, value);
            }
            written
        }
    };
}

/// Returns the digest of a content: the beginning of its SHA-256, as 16 hexadecimal digits.
#[must_use]
pub fn digest_of(content: impl AsRef<[u8]>) -> String {
    Sha256::digest(content).iter().take(KEPT_BYTES).fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn results() -> Value {
        json!({
            "mode": "virtual", "seed": 7, "reps": 2, "a_later_field": { "x": [1.5, null], "y": true },
            "results": { "rc": { "samples_ms": [3720.0, 3728.25] }, "cm": { "samples_ms": [] } },
        })
    }

    fn sealed() -> Digests {
        Digests::of_files(&[("setup.toml", "schema = 1\n")]).with_values(&results())
    }

    fn read(name: &str) -> Option<Vec<u8>> {
        (name == "setup.toml").then(|| b"schema = 1\n".to_vec())
    }

    #[test]
    fn the_digest_of_a_text_is_the_beginning_of_its_sha_256() {
        // FIPS 180-4, example of one block: "abc".
        assert_eq!(Digests::of_files(&[("a.txt", "abc")]).0["a.txt"], "ba7816bf8f01cfea");
    }

    #[test]
    fn what_was_written_fits_however_it_is_spaced_ordered_or_written() {
        let text = r#"{"seed":7.0,"results":{"cm":{"samples_ms":[]},"rc":{"samples_ms":[3720,3728.250]}},
            "a_later_field":{"y":true,"x":[15e-1,null]},"reps":2,"digests":{},"mode":"virtual"}"#;
        assert_eq!(sealed().check(&results(), read), Ok(()));
        assert_eq!(sealed().check(&serde_json::from_str(text).unwrap(), read), Ok(()));
    }

    #[test]
    fn any_changed_missing_or_added_value_is_found_with_its_key() {
        let key = |change: &dyn Fn(&mut Value)| {
            let mut changed = results();
            change(&mut changed);
            match sealed().check(&changed, read).unwrap_err() {
                Mismatch::Value { key, .. } => key,
                Mismatch::File { name, .. } => panic!("{name}"),
            }
        };
        assert_eq!(key(&|it| it["mode"] = json!("real")), "mode");
        assert_eq!(key(&|it| it["seed"] = json!("7")), "seed");
        assert_eq!(key(&|it| it["a_later_field"]["x"][0] = json!(1.500_000_000_000_000_2)), "a_later_field");
        assert_eq!(key(&|it| it["a_later_field"]["x"] = json!([null, 1.5])), "a_later_field");
        assert_eq!(key(&|it| it["results"]["rc"]["samples_ms"] = json!([3720.0])), "results.rc");
        assert_eq!(key(&|it| drop(it.as_object_mut().unwrap().remove("reps"))), "reps");
        assert_eq!(key(&|it| it["more"] = json!(null)), "more");
        assert_eq!(key(&|it| it["results"]["sm"] = json!({})), "results.sm");
    }

    #[test]
    fn a_changed_file_is_found_with_its_name() {
        let mismatch = sealed().check(&results(), |_| Some(b"schema = 2\n".to_vec())).unwrap_err();
        assert!(matches!(mismatch, Mismatch::File { ref name, .. } if name == "setup.toml"), "{mismatch:?}");
        assert_eq!(sealed().check(&results(), |_| None), Ok(()), "the report names a missing file");
    }
}
