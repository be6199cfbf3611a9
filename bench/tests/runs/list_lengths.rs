//! A list of fixed length is refused where it has one number more or one less, whichever list of a setup or an application
//! it is: the schemas say which there are.

use planning::{Application, ArmsApplication};
use serde_json::{Map, Value, json};

const SETUP: &str = include_str!("../../../cell/schemas/setup.schema.json");
const APPLICATION: &str = include_str!("../../../cell/schemas/application.schema.json");
const CELL: &str = include_str!("../../../cell/schemas/cell.schema.json");
const ARMS_APPLICATION: &str = include_str!("../../../cell/schemas/arms-application.schema.json");

/// Stands for a list in a text, until the list is put in its place.
const PLACE: &str = "the list";

/// One step from a schema towards a list in it.
#[derive(Clone, PartialEq, Debug)]
enum Step {
    /// This key of a table.
    Key(String),
    /// The elements of a list.
    Element,
    /// This one of several forms.
    Form(usize),
}

type Path = Vec<Step>;

/// Follows a reference to a definition.
fn resolved<'a>(schema: &'a Value, root: &'a Value) -> &'a Value {
    match schema["$ref"].as_str() {
        Some(path) => resolved(&root["$defs"][path.rsplit('/').next().unwrap()], root),
        None => schema,
    }
}

fn forms(schema: &Value) -> Option<&Vec<Value>> {
    ["oneOf", "anyOf"].iter().find_map(|name| schema[name].as_array())
}

/// Returns the smallest and the largest length of a list.
fn bounds(schema: &Value) -> Option<(usize, usize)> {
    let bound = |name: &str| schema[name].as_u64().map(|length| length as usize);
    bound("minItems").zip(bound("maxItems"))
}

/// Collects the paths to all lists that have a smallest and a largest length.
fn lists(schema: &Value, root: &Value, at: &Path, inside: &[&Value], found: &mut Vec<Path>) {
    let schema = resolved(schema, root);
    if inside.contains(&schema) {
        return;
    }
    let inside = [inside, &[schema]].concat();
    let mut below = |schema: &Value, step: Step| {
        lists(schema, root, &[at.as_slice(), &[step]].concat(), &inside, found);
    };
    for (index, form) in forms(schema).into_iter().flatten().enumerate() {
        below(form, Step::Form(index));
    }
    for (name, value) in schema["properties"].as_object().into_iter().flatten() {
        below(value, Step::Key(name.clone()));
    }
    if schema["additionalProperties"].is_object() {
        below(&schema["additionalProperties"], Step::Key("any-name".to_owned()));
    }
    if schema["items"].is_object() {
        below(&schema["items"], Step::Element);
    }
    if bounds(schema).is_some() {
        found.push(at.clone());
    }
}

/// Returns the schema at the end of a path.
fn at_end<'a>(schema: &'a Value, root: &'a Value, path: &[Step]) -> &'a Value {
    let schema = resolved(schema, root);
    let Some((step, rest)) = path.split_first() else { return schema };
    let next = match step {
        Step::Form(index) => &forms(schema).unwrap()[*index],
        Step::Element => &schema["items"],
        Step::Key(name) => schema["properties"].get(name).unwrap_or_else(|| &schema["additionalProperties"]),
    };
    at_end(next, root, rest)
}

/// Makes the smallest value that fits a schema and has the list at the end of the path; `list` takes the list's place.
fn smallest(schema: &Value, root: &Value, path: &[Step], list: &Value) -> Value {
    let schema = resolved(schema, root);
    let (step, rest) = path.split_first().map_or((None, path), |(step, rest)| (Some(step), rest));
    if let Some(forms) = forms(schema) {
        return match step {
            Some(Step::Form(index)) => smallest(&forms[*index], root, rest, list),
            // The last bus, EtherCAT, needs no other section.
            _ => {
                smallest(forms.iter().rfind(|form| form["type"] != "null").unwrap(), root, &[], &Value::Null)
            }
        };
    }
    if step.is_none() && !list.is_null() {
        return list.clone();
    }
    if let Some(constant) = schema.get("const") {
        return constant.clone();
    }
    if let Some(known) = schema["enum"].as_array() {
        return known[0].clone();
    }
    let kind = schema["type"].as_str().or_else(|| schema["type"][0].as_str()).unwrap();
    match (kind, schema["format"].as_str()) {
        ("object", _) => table(schema, root, step, rest, list),
        ("array", _) => {
            let item = |path| smallest(&schema["items"], root, path, list);
            match step {
                Some(Step::Element) => json!([item(rest)]),
                _ => {
                    let item = smallest(&schema["items"], root, &[], &Value::Null);
                    Value::Array(vec![item; schema["minItems"].as_u64().unwrap_or(0) as usize])
                }
            }
        }
        ("string", Some("ipv4")) => json!("192.0.2.1"),
        ("string", _) => json!("text"),
        ("boolean", _) => json!(true),
        ("integer" | "number", _) => json!(1),
        other => panic!("a schema has a type that this test does not know: {other:?}"),
    }
}

fn table(schema: &Value, root: &Value, step: Option<&Step>, rest: &[Step], list: &Value) -> Value {
    let mut table = Map::new();
    let required = schema["required"].as_array().into_iter().flatten().filter_map(Value::as_str);
    for name in required {
        let value = &schema["properties"][name];
        table.insert(name.to_owned(), smallest(value, root, &[], &Value::Null));
    }
    if let Some(Step::Key(name)) = step {
        let value = schema["properties"].get(name).unwrap_or_else(|| &schema["additionalProperties"]);
        table.insert(name.clone(), smallest(value, root, rest, list));
    }
    Value::Object(table)
}

/// Returns what a reader says of a text whose format it does not accept, without the text's own line; `None` if the format
/// is right, whatever the values are worth.
fn refusal(of: Kind, text: &str) -> Option<String> {
    let in_application = |error| match error {
        planning::Error::Setup(error) => Some(error),
        _ => None,
    };
    let error = match of {
        Kind::Setup => setup::setup_from_text("file", text).err()?,
        Kind::Cell => setup::cell_from_text("file", text).err()?,
        Kind::Application => in_application(Application::parse("file", text).err()?)?,
        Kind::ArmsApplication => in_application(ArmsApplication::parse("file", text).err()?)?,
    };
    let is_of_format = matches!(error, setup::Error::Format { .. });
    is_of_format.then(|| error.to_string().lines().next().unwrap().to_owned())
}

#[derive(Clone, Copy, PartialEq, Debug)]
enum Kind {
    Setup,
    Application,
    Cell,
    ArmsApplication,
}

/// The formats, each with its schema and how many lists of fixed length that has at least.
const FORMATS: [(Kind, &str, usize); 4] = [
    (Kind::Setup, SETUP, 5),
    (Kind::Application, APPLICATION, 9),
    (Kind::Cell, CELL, 6),
    (Kind::ArmsApplication, ARMS_APPLICATION, 9),
];

/// Returns the last key of a path that a person gave a meaning.
fn key(path: &Path) -> &str {
    let keys = path.iter().rev().filter_map(|step| match step {
        Step::Key(name) if name != "value" => Some(name.as_str()),
        _ => None,
    });
    keys.into_iter().next().unwrap()
}

#[test]
fn one_number_more_or_less_is_refused_in_every_list_of_fixed_length_with_its_key() {
    for (of, schema, least) in FORMATS {
        let schema: Value = serde_json::from_str(schema).unwrap();
        let mut paths = Vec::new();
        lists(&schema, &schema, &Vec::new(), &[], &mut paths);
        let mut tried = 0;
        for path in &paths {
            let (length, most) = bounds(at_end(&schema, &schema, path)).unwrap();
            if length != most {
                continue;
            }
            let document = toml::to_string(&smallest(&schema, &schema, path, &json!(PLACE))).unwrap();
            assert!(document.contains(PLACE), "{path:?}: {document}");
            // The format of a setup with [[station]] depends on the version.
            let version = if of == Kind::Cell { "schema = 2\n" } else { "schema = 1\n" };
            let document = document.replacen("schema = 1\n", version, 1);
            let said = |list: &[&str]| {
                let text = document.replace(&format!("\"{PLACE}\""), &format!("[{}]", list.join(", ")));
                refusal(of, &text)
            };
            assert_eq!(said(&vec!["1"; length]), None, "{path:?}: the right length is read, {document}");
            let of_key = |found: usize, said: Option<String>| {
                let said = said.unwrap_or_else(|| panic!("{path:?} took {found} numbers"));
                let expected = format!("found {found} numbers, expected {length}");
                assert!(said.contains(key(path)) && said.contains(&expected), "{path:?}: {said}");
                said
            };
            of_key(length - 1, said(&vec!["1"; length - 1]));
            assert!(!of_key(length + 1, said(&vec!["1"; length + 1])).contains("write"));
            let decimal = of_key(2 * length, said(&vec!["15,0"; length]));
            let are_integers = said(&vec!["1.5"; length]).is_some();
            assert_eq!(decimal.ends_with("; write 15.0, not 15,0"), !are_integers, "{path:?}: {decimal}");
            let one_more = vec!["1"; length + 1].join(",");
            assert!(!of_key(length + 1, said(&[&one_more])).contains("write"), "{path:?}");
            tried += 1;
        }
        assert!(tried >= least, "{of:?}: the schema has {tried} lists of fixed length");
    }
}

#[test]
fn a_list_with_a_number_for_each_joint_is_refused_with_one_more_or_less() {
    let schema: Value = serde_json::from_str(SETUP).unwrap();
    let mut paths = Vec::new();
    lists(&schema, &schema, &Vec::new(), &[], &mut paths);
    paths.retain(|path| bounds(at_end(&schema, &schema, path)).is_some_and(|(least, most)| least < most));
    assert!(paths.len() >= 6, "{paths:?}");
    for (name, text) in setup::SETUPS {
        for path in &paths {
            let document: toml::Table = toml::from_str(text).unwrap();
            let changed = |change: fn(&mut Vec<toml::Value>)| {
                let mut document = toml::Value::Table(document.clone());
                let mut at = &mut document;
                for step in path {
                    if let Step::Key(name) = step {
                        at = at.get_mut(name)?;
                    }
                }
                change(at.as_array_mut().unwrap());
                let text = toml::to_string(&document).unwrap();
                Some(setup::setup_from_text("file", &text).unwrap_err().to_string())
            };
            let Some(longer) = changed(|list| list.push(list[0].clone())) else { continue };
            let shorter = changed(|list| drop(list.pop())).unwrap();
            let joints = if matches!(*name, "A" | "C") { 4 } else { 6 };
            for (said, found) in [(longer, joints + 1), (shorter, joints - 1)] {
                let expected = format!("found {found} numbers, expected {joints}, one for each joint");
                assert!(said.contains(key(path)) && said.contains(&expected), "{name}: {said}");
            }
        }
    }
}

#[test]
fn a_decimal_comma_is_refused_with_line_key_and_the_right_number() {
    let (_, text) = planning::APPLICATIONS[0];
    let said = Application::parse(
        "file",
        &format!(
            "{text}\n[[obstacle]]\nname = \"post\"\nlower_mm = [15,0, -50,5, 0,0]\nupper_mm = [25.0, -40.0, 90.0]\n"
        ),
    );
    insta::assert_snapshot!(said.unwrap_err(), @"
    file:75: in `obstacle[1].lower_mm`: found 6 numbers, expected 3; write 15.0, not 15,0
       75 | lower_mm = [15,0, -50,5, 0,0]
    ");
}

#[test]
fn a_table_is_not_read_from_a_list_of_its_values() {
    let (_, text) = setup::SETUPS[0];
    let from = "{ value = 150, from = \"assumed\", note = \"a short program on a fast PLC\" }";
    assert!(text.contains(from));
    let said = setup::setup_from_text("file", &text.replacen(from, "[150, \"assumed\", \"fast\", 5]", 1));
    insta::assert_snapshot!(said.unwrap_err(), @r#"
    file:16: in `plc.scan_cost_us`: invalid type: list, expected a value with its source: { value = ..., from = "paper", "datasheet", "calibrated" or "assumed" }
       16 | scan_cost_us = [150, "assumed", "fast", 5]
    "#);
}
