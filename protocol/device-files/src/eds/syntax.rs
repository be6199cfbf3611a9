//! Syntax of an EDS: sections, entries, fields, comments (CIP specification, volume 1, 7-3.3).

use std::cell::Cell;

use crate::fault::{FileFault, excerpt};

/// Sections, entries and fields together; the largest public files have some ten thousand.
const MOST_PARTS: usize = 400_000;
/// Bytes that a reader may keep of one file.
const MOST_KEPT: usize = 24 << 20;

/// File, cut into sections and entries.
pub(super) struct Sheet<'a> {
    pub(super) sections: Vec<SheetSection<'a>>,
    kept: Cell<usize>,
}

/// SheetSection such as `[Device]`.
pub(super) struct SheetSection<'a> {
    pub(super) name: &'a str,
    pub(super) line: usize,
    pub(super) entries: Vec<SheetEntry<'a>>,
}

/// SheetEntry such as `ProdCode = 1;`, with its fields.
pub(super) struct SheetEntry<'a> {
    pub(super) key: &'a str,
    pub(super) line: usize,
    fields: Vec<Field<'a>>,
}

/// Field of an entry.
struct Field<'a> {
    line: usize,
    text: FieldText<'a>,
}

enum FieldText<'a> {
    /// Number, name or nothing, as it stands in the file.
    Plain(&'a str),
    /// Text between quotation marks.
    Quoted(String),
}

impl<'a> Sheet<'a> {
    /// Parses a text.
    pub(super) fn parse(text: &'a str) -> Result<Self, FileFault> {
        let mut lexer = Lexer { text, at: 0, line: 1, parts: 0 };
        let mut sections: Vec<SheetSection<'a>> = Vec::new();
        loop {
            lexer.skip_blanks();
            lexer.count_part()?;
            match lexer.peek() {
                None => break,
                Some('[') => sections.push(lexer.section()?),
                Some(_) => {
                    let section = sections.last_mut();
                    let section =
                        section.ok_or_else(|| lexer.fault("file", "an entry before the first section"))?;
                    section.entries.push(lexer.entry(section.name)?);
                }
            }
        }
        Ok(Self { sections, kept: Cell::new(0) })
    }

    /// Returns the first section of a name, in any case.
    pub(super) fn section(&self, name: &str) -> Option<&SheetSection<'a>> {
        self.sections.iter().find(|section| section.name.eq_ignore_ascii_case(name))
    }

    /// Keeps a text for longer than the file.
    pub(super) fn keep(&self, text: &str) -> Result<String, FileFault> {
        self.charge(text.len())?;
        Ok(text.to_owned())
    }

    pub(super) fn charge(&self, bytes: usize) -> Result<(), FileFault> {
        let kept = self.kept.get().saturating_add(bytes);
        self.kept.set(kept);
        if kept > MOST_KEPT {
            return Err(FileFault::of_file(format!(
                "the description is larger than {MOST_KEPT} bytes; split the file"
            )));
        }
        Ok(())
    }
}

impl<'a> SheetSection<'a> {
    /// Returns the first entry of a key, in any case.
    pub(super) fn entry(&self, key: &str) -> Option<&SheetEntry<'a>> {
        self.entries.iter().find(|entry| entry.key.eq_ignore_ascii_case(key))
    }

    /// Returns the entries whose key is a word and a number, such as `Param12`.
    pub(super) fn numbered(&self, word: &str) -> impl Iterator<Item = (u32, &SheetEntry<'a>)> {
        self.entries.iter().filter_map(move |entry| Some((numbered(entry.key, word)?, entry)))
    }

    pub(super) fn finding(&self, fault: impl std::fmt::Display) -> FileFault {
        FileFault::new(self.line, format!("[{}]", excerpt(self.name)), fault)
    }
}

/// Returns the number of a key such as `Param12`.
pub(super) fn numbered(key: &str, word: &str) -> Option<u32> {
    let (head, digits) = key.split_at_checked(word.len())?;
    let is_number = !digits.is_empty() && digits.bytes().all(|it| it.is_ascii_digit());
    if is_number && head.eq_ignore_ascii_case(word) { digits.parse().ok() } else { None }
}

impl SheetEntry<'_> {
    /// Returns the number of fields.
    pub(super) fn count(&self) -> usize {
        self.fields.len()
    }

    /// Returns a field's text; empty for one that is not there.
    pub(super) fn field(&self, index: usize) -> &str {
        match self.fields.get(index).map(|field| &field.text) {
            Some(FieldText::Plain(text)) => text,
            Some(FieldText::Quoted(text)) => text,
            None => "",
        }
    }

    /// Returns a number; none for an empty field.
    pub(super) fn number<N: TryFrom<i64>>(&self, index: usize) -> Result<Option<N>, FileFault> {
        let text = self.field(index);
        if text.is_empty() {
            return Ok(None);
        }
        let digits = text.replace('_', "");
        let value = match digits.strip_prefix("0b").or_else(|| digits.strip_prefix("0B")) {
            Some(bits) => i64::from_str_radix(bits, 2).ok().and_then(|value| N::try_from(value).ok()),
            None => crate::xml::number(digits.strip_prefix('+').unwrap_or(&digits)),
        };
        let width = 8 * size_of::<N>();
        value.map(Some).ok_or_else(|| {
            self.finding(index, format!("`{}`: must be a number of {width} bits", excerpt(text)))
        })
    }

    /// Returns a fault of a field.
    pub(super) fn finding(&self, index: usize, fault: impl std::fmt::Display) -> FileFault {
        let line = self.fields.get(index).map_or(self.line, |field| field.line);
        FileFault::new(line, format!("{} field {}", excerpt(self.key), index + 1), fault)
    }
}

struct Lexer<'a> {
    text: &'a str,
    at: usize,
    line: usize,
    parts: usize,
}

impl<'a> Lexer<'a> {
    fn rest(&self) -> &'a str {
        self.text.get(self.at..).unwrap_or_default()
    }

    fn peek(&self) -> Option<char> {
        self.rest().chars().next()
    }

    fn next(&mut self) -> Option<char> {
        let next = self.peek()?;
        self.at += next.len_utf8();
        self.line += usize::from(next == '\n');
        Some(next)
    }

    fn fault(&self, element: impl Into<String>, fault: impl std::fmt::Display) -> FileFault {
        FileFault::new(self.line, element, fault)
    }

    fn count_part(&mut self) -> Result<(), FileFault> {
        self.parts += 1;
        if self.parts > MOST_PARTS {
            return Err(self.fault(
                "file",
                format!("more than {MOST_PARTS} sections, entries and fields; split the file"),
            ));
        }
        Ok(())
    }

    /// Skips blanks and comments, which begin with `$` and end with the line.
    fn skip_blanks(&mut self) {
        while let Some(next) = self.peek() {
            match next {
                '$' => {
                    while self.peek().is_some_and(|it| it != '\n') {
                        self.next();
                    }
                }
                // DOS files end with it.
                '\u{1A}' => {
                    self.next();
                }
                blank if blank.is_whitespace() || blank == '\0' => {
                    self.next();
                }
                _ => return,
            }
        }
    }

    fn section(&mut self) -> Result<SheetSection<'a>, FileFault> {
        let line = self.line;
        let rest = self.rest().get(1..).unwrap_or_default();
        let end = rest.find([']', '\n']).filter(|end| rest.get(*end..).is_some_and(|it| it.starts_with(']')));
        let Some(end) = end else { return Err(self.fault("section", "no `]` in this line; add it")) };
        let name = rest.get(..end).unwrap_or_default().trim();
        self.at += 1 + end + 1;
        Ok(SheetSection { name, line, entries: Vec::new() })
    }

    fn entry(&mut self, section: &str) -> Result<SheetEntry<'a>, FileFault> {
        let (line, start) = (self.line, self.at);
        while self.peek().is_some_and(|it| !matches!(it, '=' | ';' | '[' | '\n' | '$' | '"')) {
            self.next();
        }
        let key = self.text.get(start..self.at).unwrap_or_default().trim();
        self.skip_blanks();
        if self.peek() != Some('=') || key.is_empty() {
            let fault = format!("`{}`: expected an entry such as `Name = value;`", excerpt(key));
            return Err(FileFault::new(line, format!("[{}]", excerpt(section)), fault));
        }
        self.next();
        let mut fields = Vec::new();
        loop {
            let (field, is_last) = self.field(key)?;
            self.count_part()?;
            fields.push(field);
            if is_last {
                break;
            }
        }
        // `1,;` has one field: a comma before the end of an entry is common.
        if fields.len() > 1 && fields.last().is_some_and(|it| matches!(it.text, FieldText::Plain(""))) {
            fields.pop();
        }
        Ok(SheetEntry { key, line, fields })
    }

    /// Reads a field and the `,` or `;` after it.
    fn field(&mut self, key: &str) -> Result<(Field<'a>, bool), FileFault> {
        self.skip_blanks();
        let line = self.line;
        let text = if self.peek() == Some('"') {
            FieldText::Quoted(self.quoted(key)?)
        } else {
            FieldText::Plain(self.plain())
        };
        self.skip_blanks();
        match self.next() {
            Some(',') => Ok((Field { line, text }, false)),
            Some(';') => Ok((Field { line, text }, true)),
            found => {
                let found = found
                    .map_or("the end of the file".to_owned(), |it| format!("`{}`", excerpt(&it.to_string())));
                Err(self.fault(excerpt(key), format!("found {found}: expected `,` or `;`")))
            }
        }
    }

    fn plain(&mut self) -> &'a str {
        let start = self.at;
        let mut depth = 0_u32;
        while let Some(next) = self.peek() {
            match next {
                // A list within a field, such as the path of a safety connection.
                '{' => depth = depth.saturating_add(1),
                '}' => depth = depth.saturating_sub(1),
                ',' if depth > 0 => {}
                ',' | ';' | '$' | '"' | '[' | '=' => break,
                '\n' if depth == 0 => break,
                _ => {}
            }
            self.next();
        }
        self.text.get(start..self.at).unwrap_or_default().trim()
    }

    /// Reads texts between quotation marks; several after each other are one.
    fn quoted(&mut self, key: &str) -> Result<String, FileFault> {
        let mut text = String::new();
        while self.peek() == Some('"') {
            let line = self.line;
            self.next();
            loop {
                match self.next() {
                    Some('"') => break,
                    Some('\\') => match self.next() {
                        Some('n') => text.push('\n'),
                        Some('t') => text.push('\t'),
                        Some(other @ ('"' | '\\')) => text.push(other),
                        // A path of Windows, which its author did not escape.
                        Some(other) => text.extend(['\\', other]),
                        None => return Err(FileFault::new(line, excerpt(key), "no closing `\"`; add it")),
                    },
                    Some('\n') | None => {
                        return Err(FileFault::new(
                            line,
                            excerpt(key),
                            "no closing `\"` in this line; add it",
                        ));
                    }
                    Some(other) => text.push(other),
                }
            }
            self.skip_blanks();
        }
        Ok(text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_have_the_fields_that_commas_separate() {
        let text = "$ head\n[A b] $ c\n  X1 = 1, ,\"a,;$\" \"b\\\"\", {2,3},; Y=; z = 0x10 ;\n[C]\n";
        let sheet = Sheet::parse(text).unwrap();
        let section = sheet.section("a B").unwrap();
        let entry = section.entry("x1").unwrap();
        let fields: Vec<_> = (0..entry.count()).map(|index| entry.field(index)).collect();
        assert_eq!(fields, ["1", "", "a,;$b\"", "{2,3}"]);
        assert_eq!(section.entry("Y").unwrap().field(0), "");
        assert_eq!(section.entry("Z").unwrap().number::<u8>(0), Ok(Some(16)));
        assert_eq!(section.numbered("x").map(|(number, _)| number).collect::<Vec<_>>(), [1]);
        assert!(sheet.section("C").is_some_and(|section| section.line == 4));
    }

    #[test]
    fn a_fault_of_syntax_names_its_line_and_entry() {
        for (text, said) in [
            ("X=1;", "1: file: an entry before the first section"),
            ("[A\nX=1;", "1: section: no `]` in this line; add it"),
            ("[A]\nX=1\nY=2;", "3: X: found `Y`: expected `,` or `;`"),
            ("[A]\nX=1", "2: X: found the end of the file: expected `,` or `;`"),
            ("[A]\nX=\"a\n\";", "2: X: no closing `\"` in this line; add it"),
            ("[A]\nX;", "2: [A]: `X`: expected an entry such as `Name = value;`"),
        ] {
            assert_eq!(Sheet::parse(text).err().unwrap().to_string(), said);
        }
        let sheet = Sheet::parse("[A]\nX = 1,\n  300;").unwrap();
        let entry = sheet.section("A").unwrap().entry("X").unwrap();
        let said = entry.number::<u8>(1).unwrap_err().to_string();
        assert_eq!(said, "3: X field 2: `300`: must be a number of 8 bits");
    }
}
