//! The numbers of a run's setup, each with its provenance.

use serde::Serialize;

use super::run::Run;

/// A number of the setup with its provenance.
#[derive(Serialize)]
pub(super) struct Number {
    key: String,
    value: String,
    from: String,
    note: String,
}

/// Returns every number with a provenance; calibrated ones first, known ones last.
pub(super) fn of(run: &Run) -> anyhow::Result<Vec<Number>> {
    let mut numbers = Vec::new();
    if let Some(setup) = &run.setup {
        sourced(&serde_json::to_value(setup)?, String::new(), &mut numbers);
    }
    let rank = |number: &Number| {
        ["calibrated", "assumed", "datasheet", "paper"].iter().position(|from| number.from == *from)
    };
    numbers.sort_by_key(rank);
    Ok(numbers)
}

fn sourced(value: &serde_json::Value, key: String, numbers: &mut Vec<Number>) {
    use serde_json::Value as Json;
    let below = |name: &str| if key.is_empty() { name.to_owned() } else { format!("{key}.{name}") };
    match value {
        Json::Object(object) => match (object.get("value"), object.get("from").and_then(Json::as_str)) {
            (Some(value), Some(from)) => {
                let note = object.get("note").and_then(Json::as_str).unwrap_or_default().replace('`', "");
                numbers.push(Number { key, value: written(value), from: from.to_owned(), note });
            }
            _ => object.iter().for_each(|(name, value)| sourced(value, below(name), numbers)),
        },
        Json::Array(items) => {
            items.iter().enumerate().for_each(|(index, item)| {
                let number = item.get("number").and_then(Json::as_u64).unwrap_or(index as u64 + 1);
                sourced(item, below(&number.to_string()), numbers);
            });
        }
        _ => {}
    }
}

fn written(value: &serde_json::Value) -> String {
    match value {
        serde_json::Value::Array(items) => items.iter().map(written).collect::<Vec<_>>().join(", "),
        serde_json::Value::Number(number) => match number.as_f64() {
            Some(number) => number.to_string().replace('-', "−"),
            None => number.to_string(),
        },
        serde_json::Value::String(text) => text.clone(),
        other => other.to_string(),
    }
}
