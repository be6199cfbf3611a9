//! A checker of the part of JSON Schema (draft 2020-12) that the schema of the control port uses; any other keyword is an
//! error, so that none is skipped.

use serde_json::{Map, Value};

/// A schema and its definitions.
pub(crate) struct Schema<'a> {
    root: &'a Value,
}

impl<'a> Schema<'a> {
    pub(crate) fn new(root: &'a Value) -> Self {
        Self { root }
    }

    /// Checks a value against a definition.
    pub(crate) fn check(&self, definition: &str, value: &Value) -> Result<(), String> {
        self.matches(&self.root["$defs"][definition], value)
    }

    /// Returns the branches of a definition's `oneOf` to which a value conforms.
    pub(crate) fn branches(&self, definition: &str, value: &Value) -> Vec<usize> {
        let branches = self.root["$defs"][definition]["oneOf"].as_array().expect("oneOf");
        (0..branches.len()).filter(|branch| self.matches(&branches[*branch], value).is_ok()).collect()
    }

    pub(crate) fn branch_count(&self, definition: &str) -> usize {
        self.root["$defs"][definition]["oneOf"].as_array().expect("oneOf").len()
    }

    fn matches(&self, schema: &Value, value: &Value) -> Result<(), String> {
        let schema = schema.as_object().ok_or_else(|| format!("no schema for {value}"))?;
        schema.iter().try_for_each(|(keyword, wanted)| self.keyword(schema, keyword, wanted, value))
    }

    fn keyword(
        &self,
        schema: &Map<String, Value>,
        keyword: &str,
        wanted: &Value,
        value: &Value,
    ) -> Result<(), String> {
        let fits = |schema: &Value| self.matches(schema, value).is_ok();
        let schemas = || wanted.as_array().into_iter().flatten();
        let length = || value.as_array().map_or(u64::MAX, |array| array.len() as u64);
        let is_ok = match keyword {
            "description" => true,
            "$ref" => {
                let name = wanted.as_str().and_then(|path| path.strip_prefix("#/$defs/")).unwrap_or_default();
                return self.check(name, value);
            }
            "type" => match wanted {
                Value::Array(types) => types.iter().any(|name| has_type(name, value)),
                name => has_type(name, value),
            },
            "enum" => schemas().any(|known| known == value),
            "const" => wanted == value,
            "minimum" => value.as_f64().is_none_or(|value| Some(value) >= wanted.as_f64()),
            "maximum" => value.as_f64().is_none_or(|value| Some(value) <= wanted.as_f64()),
            "minItems" => length() >= wanted.as_u64().unwrap_or(u64::MAX),
            "maxItems" => !value.is_array() || length() <= wanted.as_u64().unwrap_or(0),
            "items" => {
                return value
                    .as_array()
                    .into_iter()
                    .flatten()
                    .try_for_each(|item| self.matches(wanted, item));
            }
            "prefixItems" => {
                let mut pairs = schemas().zip(value.as_array().into_iter().flatten());
                return pairs.try_for_each(|(schema, item)| self.matches(schema, item));
            }
            "oneOf" => schemas().filter(|schema| fits(schema)).count() == 1,
            "anyOf" => schemas().any(fits),
            "required" => schemas().all(|name| name.as_str().is_some_and(|name| value.get(name).is_some())),
            "additionalProperties" => {
                let known = |name: &String| schema["properties"].get(name).is_some();
                value.as_object().is_none_or(|object| object.keys().all(known))
            }
            "properties" => {
                let properties = wanted.as_object().into_iter().flatten();
                return properties
                    .filter_map(|(name, schema)| Some((schema, value.get(name)?)))
                    .try_for_each(|(schema, value)| self.matches(schema, value));
            }
            other => return Err(format!("the checker does not know `{other}`")),
        };
        if is_ok { Ok(()) } else { Err(format!("{value} breaks {keyword}: {wanted}")) }
    }
}

fn has_type(name: &Value, value: &Value) -> bool {
    match name.as_str().unwrap_or_default() {
        "null" => value.is_null(),
        "boolean" => value.is_boolean(),
        "string" => value.is_string(),
        "number" => value.is_number(),
        "integer" => value.is_u64() || value.is_i64(),
        "array" => value.is_array(),
        "object" => value.is_object(),
        _ => false,
    }
}
