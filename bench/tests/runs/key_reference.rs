//! The reference of all keys in `docs/keys.md` is made from the schemas of the file formats, and the schemas fit the files
//! that are shipped.

use std::collections::VecDeque;
use std::fmt::Write as _;

use serde_json::Value;

const SETUP: &str = include_str!("../../../cell/schemas/setup.schema.json");
const APPLICATION: &str = include_str!("../../../cell/schemas/application.schema.json");
const CELL: &str = include_str!("../../../cell/schemas/cell.schema.json");
const ARMS_APPLICATION: &str = include_str!("../../../cell/schemas/arms-application.schema.json");

const STUDY: &str = include_str!("../../schemas/study.schema.json");

const HEAD: &str = "\
# All keys of setups, applications and studies

Made from the types that read the files: `INSTA_UPDATE=always cargo test -p bench --test runs key_reference`. The same as JSON Schema, for
editors: [setup.schema.json](../cell/schemas/setup.schema.json) and
[application.schema.json](../cell/schemas/application.schema.json). `bench new DIR` writes both beside the files that it makes, whose
first line names them, so that an editor with a TOML language server (Taplo, *Even Better TOML*) completes keys, shows their meaning
and marks mistakes. Limits, units and examples: [setups.md](setups.md), [applications.md](applications.md). For several arms:
[cell.schema.json](../cell/schemas/cell.schema.json) and [arms-application.schema.json](../cell/schemas/arms-application.schema.json). For
studies: [study.schema.json](../bench/schemas/study.schema.json), [studies.md](studies.md).

◆: a number with its source, `{ value = 1000, from = \"paper\", note = \"section 6.2\" }`; `from` is `paper`, `datasheet`, `calibrated` or
`assumed`, and `note` may be left out.
";

/// One line of a table for each key of the file, in one table for each kind of section.
struct Reference<'a> {
    schema: &'a Value,
    /// The file, as part of anchors.
    file: &'a str,
    /// The schema and the name of a file whose sections are written already.
    before: Option<(&'a Value, &'a str)>,
    /// Sections that still have to be written.
    open: VecDeque<&'a str>,
    seen: Vec<&'a str>,
    text: String,
}

impl<'a> Reference<'a> {
    fn of(schema: &'a Value, file: &'a str) -> String {
        Self::written(schema, file, None)
    }

    /// Like `of`, for a file that shares sections with the one of `before`: they are written there.
    fn after(before: &'a Value, before_file: &'a str, schema: &'a Value, file: &'a str) -> String {
        Self::written(schema, file, Some((before, before_file)))
    }

    fn written(schema: &'a Value, file: &'a str, before: Option<(&'a Value, &'a str)>) -> String {
        let mut reference = Self {
            schema,
            file,
            before,
            open: VecDeque::new(),
            seen: Vec::new(),
            text: format!("\n## {file}\n\n"),
        };
        reference.table(schema);
        while let Some(name) = reference.open.pop_front() {
            let definition = &schema["$defs"][name];
            write!(reference.text, "\n### {file}: {name}\n\n{}\n\n", described(definition)).unwrap();
            match definition["oneOf"].as_array() {
                None => reference.table(definition),
                Some(variants) if variants.iter().all(|it| it.get("const").is_some()) => {
                    reference.text.push_str("| value | meaning |\n|---|---|\n");
                    for variant in variants {
                        let value = variant["const"].as_str().unwrap();
                        writeln!(reference.text, "| `\"{value}\"` | {} |", described(variant)).unwrap();
                    }
                }
                Some(variants) => {
                    for (number, variant) in variants.iter().enumerate() {
                        let gap = if number == 0 { "" } else { "\n" };
                        write!(reference.text, "{gap}{}\n\n", described(variant)).unwrap();
                        reference.table(variant);
                    }
                }
            }
        }
        reference.text
    }

    fn table(&mut self, schema: &'a Value) {
        self.text.push_str("| key | type | | meaning |\n|---|---|---|---|\n");
        let required: Vec<_> =
            schema["required"].as_array().into_iter().flatten().filter_map(Value::as_str).collect();
        for (key, value) in schema["properties"].as_object().unwrap() {
            let kind = self.kind(value);
            let optional = if required.contains(&key.as_str()) { "" } else { "optional" };
            // The key that tells one variant from another says what the variant says.
            let meaning =
                Some(described(value)).filter(|it| !it.is_empty()).unwrap_or_else(|| described(schema));
            writeln!(self.text, "| `{key}` | {kind} | {optional} | {meaning} |").unwrap();
        }
    }

    /// What a value of this schema is, in words.
    fn kind(&mut self, value: &'a Value) -> String {
        if let Some(name) = value["$ref"].as_str().map(|path| path.rsplit('/').next().unwrap()) {
            let definition = &self.schema["$defs"][name];
            if let Some(sourced) =
                definition["properties"].get("value").filter(|_| name.starts_with("Sourced"))
            {
                return format!("{} ◆", self.kind(sourced));
            }
            if definition.get("anyOf").is_some() {
                return self.kind(definition);
            }
            if let Some((before, file)) = self.before
                && before["$defs"].get(name) == Some(definition)
            {
                let anchor = format!("{file} {name}").to_lowercase().replace(' ', "-");
                return format!("[{name}](#{anchor})");
            }
            if !self.seen.contains(&name) {
                self.seen.push(name);
                self.open.push_back(name);
            }
            let anchor = format!("{} {name}", self.file).to_lowercase().replace(' ', "-");
            return format!("[{name}](#{anchor})");
        }
        if let Some(any) = value["anyOf"].as_array() {
            let kinds: Vec<_> =
                any.iter().filter(|it| it["type"] != "null").map(|it| self.kind(it)).collect();
            return kinds.join(" or ");
        }
        if let Some(constant) = value["const"].as_str() {
            return format!("`\"{constant}\"`");
        }
        let name = match &value["type"] {
            Value::Array(names) => names[0].as_str(),
            name => name.as_str(),
        };
        match name.unwrap() {
            "array" => {
                let item = self.kind(&value["items"]);
                match (value["minItems"].as_u64(), value["maxItems"].as_u64()) {
                    (Some(least), Some(most)) if least == most => format!("{most} × {item}"),
                    (Some(least), Some(most)) => format!("{least} to {most} × {item}"),
                    _ => format!("list of: {item}"),
                }
            }
            "object" if value["additionalProperties"] == true => "table".to_owned(),
            "object" => format!("table; each key a name: {}", self.kind(&value["additionalProperties"])),
            "string" => "text".to_owned(),
            "boolean" => "true or false".to_owned(),
            name => name.to_owned(),
        }
    }
}

/// The meaning, in one line, without the brackets of links between types.
fn described(value: &Value) -> String {
    value["description"].as_str().unwrap_or_default().replace('\n', " ").replace("[`", "`").replace("`]", "`")
}

/// What of a file does not fit its schema: the key, if any.
fn misfit(value: &Value, schema: &Value, root: &Value, key: &str) -> Option<String> {
    if let Some(path) = schema["$ref"].as_str() {
        return misfit(value, &root["$defs"][path.rsplit('/').next().unwrap()], root, key);
    }
    if let Some(choices) = ["oneOf", "anyOf"].iter().find_map(|choice| schema[choice].as_array()) {
        let fits = choices.iter().any(|choice| misfit(value, choice, root, key).is_none());
        return (!fits).then(|| key.to_owned());
    }
    if schema.get("const").is_some_and(|constant| constant != value) {
        return Some(key.to_owned());
    }
    let types = match &schema["type"] {
        Value::Array(types) => types.iter().filter_map(Value::as_str).collect(),
        one => one.as_str().into_iter().collect::<Vec<_>>(),
    };
    let is = match value {
        Value::Object(_) => types.contains(&"object"),
        Value::Array(_) => types.contains(&"array"),
        Value::String(_) => types.contains(&"string"),
        Value::Bool(_) => types.contains(&"boolean"),
        Value::Number(number) => types.contains(&"number") || types.contains(&"integer") && number.is_i64(),
        Value::Null => false,
    };
    if !is {
        return Some(key.to_owned());
    }
    let below = |name: &str| format!("{key}.{name}");
    match value {
        Value::Object(found) => {
            let required = schema["required"].as_array().into_iter().flatten().filter_map(Value::as_str);
            let missing = required.filter(|name| !found.contains_key(*name)).map(below).next();
            missing.or_else(|| {
                found.iter().find_map(|(name, value)| match schema["properties"].get(name) {
                    Some(schema) => misfit(value, schema, root, &below(name)),
                    None if schema["additionalProperties"] == Value::Bool(false) => Some(below(name)),
                    None => misfit(value, &schema["additionalProperties"], root, &below(name)),
                })
            })
        }
        Value::Array(found) => {
            let length = found.len() as u64;
            let is_within = schema["minItems"].as_u64().is_none_or(|least| length >= least)
                && schema["maxItems"].as_u64().is_none_or(|most| length <= most);
            let of_elements = || found.iter().find_map(|value| misfit(value, &schema["items"], root, key));
            if is_within { of_elements() } else { Some(key.to_owned()) }
        }
        _ => None,
    }
}

fn read(toml: &str) -> Value {
    serde_json::to_value(toml::from_str::<toml::Value>(toml).unwrap()).unwrap()
}

#[test]
fn the_documented_keys_are_those_of_the_schemas() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/keys.md");
    let schemas: [Value; 5] =
        [SETUP, APPLICATION, CELL, ARMS_APPLICATION, STUDY].map(|it| serde_json::from_str(it).unwrap());
    let [setup, application, cell, arms, study] = &schemas;
    let one = [HEAD, &Reference::of(setup, "Setup"), &Reference::of(application, "Application")].concat();
    let several = Reference::after(setup, "Setup", cell, "Setup of several stations")
        + &Reference::after(application, "Application", arms, "Application for several arms");
    let text = one + &several + &Reference::of(study, "Study");
    if std::env::var("INSTA_UPDATE").is_ok_and(|update| update == "always") {
        std::fs::write(path, &text).unwrap();
    }
    assert!(
        std::fs::read_to_string(path).unwrap() == text,
        "the keys changed: INSTA_UPDATE=always cargo test -p bench --test runs key_reference"
    );
    assert!(!text.contains("|  |\n"), "every key has a meaning");
}

#[test]
fn every_shipped_file_fits_its_schema_and_a_wrong_key_or_value_does_not() {
    let schemas: [Value; 5] =
        [SETUP, APPLICATION, CELL, ARMS_APPLICATION, STUDY].map(|it| serde_json::from_str(it).unwrap());
    let [setup, application, cell, arms, study] = &schemas;
    let shipped = [
        (setup::SETUPS, setup),
        (planning::APPLICATIONS, application),
        (setup::CELLS, cell),
        (planning::ARMS_APPLICATIONS, arms),
        (&studies::engine::file::EXAMPLES, study),
    ];
    for ((name, text), schema) in
        shipped.iter().flat_map(|(files, schema)| files.iter().map(move |it| (it, *schema)))
    {
        assert_eq!(misfit(&read(text), schema, schema, ""), None, "{name}");
    }
    for (from, to, key) in [
        ("scan_cost_us", "scan_costs_us", ".plc.scan_cost_us"),
        ("cycle_us = { value = 4000", "cycle_us = { value = 4000.5", ".robot.cycle_us.value"),
        ("value = [-132.0, -145.0, 0.0, -355.0]", "value = [-132.0]", ".robot.axes.lower_deg.value"),
        ("kind = \"scara\"", "kind = \"scarab\"", ".robot.kinematics"),
        ("from = \"paper\"", "from = \"papers\"", ".plc.scan_cycle_us.from"),
        ("[motions]", "[motions]\nspeed = 1", ".motions.speed"),
    ] {
        let changed = setup::SETUPS[0].1.replacen(from, to, 1);
        assert_eq!(misfit(&read(&changed), setup, setup, "").as_deref(), Some(key), "{to}");
    }
}
