//! The place of a key in its text.

use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Returns the line of a key, counted from 1, by its path: `robot.tools[2].mm_deg`, or `station.left.robot` for the station
/// of that name. A key that is not there has the line of the last part that is; `None` if no part is.
pub(crate) fn line_of(text: &str, path: &str) -> Option<usize> {
    let document = DeTable::parse(text).ok()?;
    let mut begin = None;
    let mut table = document.get_ref();
    let mut parts = path.split('.').peekable();
    while let Some(part) = parts.next() {
        let (name, index) = match part.strip_suffix(']').and_then(|part| part.split_once('[')) {
            Some((name, index)) => (name, index.parse().ok()),
            None => (part, None),
        };
        let Some((key, value)) = table.iter().find(|(key, _)| key.get_ref() == name) else { break };
        begin = Some(key.span().start);
        let inner = match value.get_ref() {
            DeValue::Array(list) => {
                let named = parts.peek().copied();
                let is_meant = |(at, one): &(usize, &Spanned<DeValue<'_>>)| {
                    index.map_or_else(|| has_name(one, named), |index: usize| index == *at)
                };
                let Some((_, one)) = list.iter().enumerate().find(is_meant) else { break };
                if index.is_none() {
                    parts.next();
                }
                begin = Some(one.span().start);
                one
            }
            _ => value,
        };
        let DeValue::Table(next) = inner.get_ref() else { break };
        table = next;
    }
    text.get(..begin?).map(|before| before.matches('\n').count() + 1)
}

/// Returns whether an element of a list is a table of this name.
fn has_name(element: &Spanned<DeValue<'_>>, name: Option<&str>) -> bool {
    let DeValue::Table(table) = element.get_ref() else { return false };
    let found = table.iter().find(|(key, _)| key.get_ref() == "name");
    matches!(found.map(|(_, value)| value.get_ref()), Some(DeValue::String(found)) if Some(found.as_ref()) == name)
}

#[cfg(test)]
mod tests {
    use super::line_of;

    #[test]
    fn a_key_is_found_by_its_path_in_tables_lists_and_stations() {
        let text = "\
name = 'one'
[robot]
axes = { lower = [1, 2],
  upper = [3] }
[robot.kinematics]
link_1_mm = { value = 3 }
[[robot.tools]]
number = 1
[[robot.tools]]
number = 2
mm_deg = 3
[[station]]
name = 'left'
[[station]]
name = 'right'
[station.robot]
cycle_us = 4
";
        for (path, line) in [
            ("name", Some(1)),
            ("robot.axes.upper", Some(4)),
            ("robot.kinematics.link_1_mm", Some(6)),
            ("robot.kinematics.link_9_mm", Some(5)),
            ("robot.tools[0].number", Some(8)),
            ("robot.tools[1].mm_deg", Some(11)),
            ("station.right.robot.cycle_us", Some(17)),
            ("station.left.robot.cycle_us", Some(12)),
            ("station.nobody", Some(12)),
            ("paper.rc.aet_ms", None),
        ] {
            assert_eq!(line_of(text, path), line, "{path}");
        }
    }
}
