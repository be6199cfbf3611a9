//! Explains the keys of a setup or an application in comments, with the words of the reference in `docs/`.

use std::collections::BTreeSet;

use node::screen;

/// Where the keys of a setup are explained.
pub(super) const SETUPS: &str = include_str!("../../../../docs/setups.md");

/// Where the keys of an application are explained.
pub(super) const APPLICATIONS: &str = include_str!("../../../../docs/applications.md");

/// Headings of the keys above the first table: of a file for several stations or arms, and of any file.
const TOPS: [&str; 3] = ["## Several stations", "## Several arms", "## Top level"];

/// Tables of a station or an arm have the keys of those of the one robot, and some of their own.
const OF_ONE_OF_SEVERAL: [&str; 2] = ["station.", "arm."];

/// Width of the comments, in characters.
const WIDTH: usize = 100;

/// Keys that a row of the reference explains, with their unit and meaning.
struct KeyRow {
    keys: Vec<String>,
    unit: String,
    meaning: String,
}

impl KeyRow {
    fn is_about(&self, key: &str) -> bool {
        self.keys.iter().any(|known| known == key)
    }

    fn comment(&self) -> String {
        let unit = if self.unit.is_empty() { String::new() } else { format!(" [{}]", self.unit) };
        let keys = if self.keys.is_empty() { "any name" } else { &self.keys.join(", ") };
        let text = format!("# {keys}{unit}: {}", plain(&self.meaning));
        screen::wrapped_within(&text, 0, 4, WIDTH).replace("\n    ", "\n#   ")
    }
}

/// Returns the text of a TOML file with each key explained where it stands first, by the tables of `reference`. Lines that
/// are comments already are left out.
pub(super) fn explained(toml: &str, reference: &str) -> String {
    let mut text = String::new();
    let mut header = "";
    let mut told = BTreeSet::new();
    let is_of_several = toml.lines().any(|line| ["[[station]]", "[[arm]]"].contains(&header_of(line)));
    for line in toml.lines().filter(|line| !line.starts_with('#')).skip_while(|line| line.is_empty()) {
        if line.starts_with('[') {
            header = header_of(line);
            push_line(&mut text, line);
            // Where the keys are names that the user gives, what belongs to each of them is explained once.
            let (rows, keys) = (rows_about(reference, header, is_of_several), keys_below(toml, header));
            let is_about_keys = rows.iter().any(|row| keys.iter().any(|key| row.is_about(key)));
            if !is_about_keys && told.insert((header, String::new())) {
                rows.iter().for_each(|row| push_line(&mut text, &row.comment()));
            }
            continue;
        }
        if let Some(key) = key(line).filter(|key| !told.contains(&(header, (*key).to_owned())))
            && let Some(row) =
                rows_about(reference, header, is_of_several).iter().find(|row| row.is_about(key))
        {
            push_line(&mut text, &row.comment());
            told.extend(row.keys.iter().map(|key| (header, key.clone())));
        }
        push_line(&mut text, line);
    }
    text
}

/// Returns the header of a table without the comment behind it.
pub(super) fn header_of(line: &str) -> &str {
    line.split(" #").next().unwrap_or(line).trim_end()
}

fn push_line(text: &mut String, line: &str) {
    text.push_str(line);
    text.push('\n');
}

/// Returns the key that a line gives a value.
pub(super) fn key(line: &str) -> Option<&str> {
    let key = line.split_once(" = ")?.0;
    let is_key = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
    (!key.is_empty() && key.chars().all(is_key)).then_some(key)
}

/// Returns the keys of all tables with this header.
fn keys_below<'a>(toml: &'a str, header: &str) -> Vec<&'a str> {
    let mut is_below = header.is_empty();
    let mut keys = Vec::new();
    for line in toml.lines() {
        if line.starts_with('[') {
            is_below = header_of(line) == header;
        } else if is_below {
            keys.extend(key(line));
        }
    }
    keys
}

/// Returns the rows about the keys of the table with this header, those that it shares before those of its own; the empty header is
/// that of the keys above the first table.
fn rows_about(reference: &str, header: &str, is_of_several: bool) -> Vec<KeyRow> {
    let of_table = |header: &str| {
        let quoted = format!("`{header}`");
        rows(section(reference, |line| line.starts_with('#') && line.contains(&quoted)))
    };
    if header.is_empty() {
        let tops = TOPS.iter().skip(if is_of_several { 0 } else { TOPS.len() - 1 });
        return tops.flat_map(|top| rows(section(reference, |line| line == *top))).collect();
    }
    let shared = OF_ONE_OF_SEVERAL.iter().find(|prefix| header.contains(**prefix));
    let shared = shared.map(|prefix| header.replace(prefix, ""));
    shared.iter().flat_map(|header| of_table(header)).chain(of_table(header)).collect()
}

/// Returns the section of the reference below the first heading that `is_it`.
fn section(reference: &str, is_it: impl Fn(&str) -> bool) -> &str {
    let mut start = None;
    let mut offset = 0;
    for line in reference.split_inclusive('\n') {
        match start {
            None if is_it(line.trim_end()) => start = Some(offset + line.len()),
            Some(start) if line.starts_with("##") => return reference.get(start..offset).unwrap_or_default(),
            _ => {}
        }
        offset += line.len();
    }
    start.and_then(|start| reference.get(start..)).unwrap_or_default()
}

/// Returns the rows of the tables in a section that have columns `key` and `meaning`.
fn rows(section: &str) -> Vec<KeyRow> {
    let mut rows = Vec::new();
    let mut columns: Option<(usize, Option<usize>)> = None;
    for line in section.lines().filter(|line| !line.starts_with("|--")) {
        let Some(cells) = line.strip_prefix('|').map(cells) else {
            columns = None;
            continue;
        };
        let cell = |at: usize| cells.get(at).map_or("", String::as_str);
        match columns {
            None if cell(0) == "key" => {
                let column = |name| cells.iter().position(|cell| cell == name);
                columns = column("meaning").map(|meaning| (meaning, column("unit")));
            }
            Some((meaning, unit)) => rows.push(KeyRow {
                keys: cell(0).split('`').skip(1).step_by(2).map(str::to_owned).collect(),
                unit: unit.map_or("", cell).to_owned(),
                meaning: cell(meaning).to_owned(),
            }),
            None => {}
        }
    }
    rows
}

/// Splits the rest of a table's line into its cells. A `|` in a cell is escaped there.
fn cells(line: &str) -> Vec<String> {
    const BAR: &str = "\u{1}";
    line.replace("\\|", BAR).split('|').map(|cell| cell.trim().replace(BAR, "|")).collect()
}

/// Returns the words of a cell without the marks of Markdown: quotes of code, emphasis, targets of links.
fn plain(cell: &str) -> String {
    let mut text = String::new();
    let mut rest = cell;
    while let Some((before, behind)) = rest.split_once("](") {
        text.push_str(&before.replacen('[', "", 1));
        rest = behind.split_once(')').map_or("", |(_, rest)| rest);
    }
    text.push_str(rest);
    text.replace(['`', '*'], "")
}
