//! Text → tokens.

use std::borrow::Cow;

use crate::{Dialect, Mistake, Place};

/// Kind of a token, with its value.
#[derive(Clone, PartialEq, Debug)]
pub(crate) enum Kind {
    /// An identifier or a keyword, as it is written.
    Word(String),
    /// An integer, with the type in front of its `#` if there is one: `UDINT#16#FF`.
    Integer(Option<String>, u64),
    /// A real number, with the type in front of its `#` if there is one.
    Real(Option<String>, f32),
    /// An operator or a separator.
    Symbol(&'static str),
}

/// A token with its place.
#[derive(Clone, PartialEq, Debug)]
pub(crate) struct Token {
    /// Kind and value.
    pub(crate) kind: Kind,
    /// Place of its first character.
    pub(crate) place: Place,
}

/// Longest text that is read, in bytes: some 100,000 motions.
const LONGEST: usize = 32 << 20;

/// Symbols, longer ones before those that they begin with.
const SYMBOLS: [&str; 22] = [
    ":=", "=>", "<=", ">=", "<>", "..", "(", ")", "[", "]", ":", ";", ",", ".", "+", "-", "*", "/", "=", "<",
    ">", "&",
];

/// Splits a text into tokens.
///
/// # Errors
/// A character, number or comment is malformed.
pub(crate) fn tokens(text: &str, dialect: Dialect) -> Result<Vec<Token>, Mistake> {
    if text.len() > LONGEST {
        return Err(Mistake::new(
            Place { line: 1, column: 1 },
            format!("{} bytes: at most {LONGEST} are read", text.len()),
        ));
    }
    let mut lexer = Lexer::new(text, dialect);
    let mut tokens = Vec::new();
    while let Some(token) = lexer.next()? {
        tokens.push(token);
    }
    Ok(tokens)
}

/// A text under way.
pub(crate) struct Lexer<'a> {
    rest: &'a str,
    place: Place,
    dialect: Dialect,
}

impl<'a> Lexer<'a> {
    pub(crate) const fn new(text: &'a str, dialect: Dialect) -> Self {
        Self { rest: text, place: Place { line: 1, column: 1 }, dialect }
    }

    /// Returns what was not taken yet.
    pub(crate) const fn rest(&self) -> &'a str {
        self.rest
    }

    /// Takes `length` bytes, which end at a character's end.
    fn take(&mut self, length: usize) -> &'a str {
        let (taken, rest) = self.rest.split_at_checked(length).unwrap_or((self.rest, ""));
        let characters = |text: &str| u32::try_from(text.chars().count()).unwrap_or(u32::MAX);
        if let Some((lines, last)) = taken.rsplit_once('\n') {
            let ends = u32::try_from(lines.matches('\n').count()).unwrap_or(u32::MAX).saturating_add(1);
            self.place = Place {
                line: self.place.line.saturating_add(ends),
                column: characters(last).saturating_add(1),
            };
        } else {
            self.place.column = self.place.column.saturating_add(characters(taken));
        }
        self.rest = rest;
        taken
    }

    fn take_while(&mut self, accepts: impl Fn(char) -> bool) -> &'a str {
        let length = self.rest.find(|character| !accepts(character)).unwrap_or(self.rest.len());
        self.take(length)
    }

    /// Skips white space and comments.
    pub(crate) fn skip_comments(&mut self) -> Result<(), Mistake> {
        loop {
            self.take_while(|character| character.is_ascii_whitespace());
            if let Some(comment) = self.rest.strip_prefix("(*") {
                let unended = || Mistake::new(self.place, "comment without its end `*)`");
                let length = comment.find("*)").ok_or_else(unended)?;
                self.take(length + "(**)".len());
            } else if self.dialect == Dialect::Scl && self.rest.starts_with('{') {
                let unended = || Mistake::new(self.place, "pragma without its end `}`");
                let length = self.rest.find('}').ok_or_else(unended)?;
                self.take(length + 1);
            } else if self.rest.starts_with("//") {
                self.take_while(|character| character != '\n');
            } else {
                return Ok(());
            }
        }
    }

    pub(crate) fn next(&mut self) -> Result<Option<Token>, Mistake> {
        self.skip_comments()?;
        let place = self.place;
        let Some(first) = self.rest.chars().next() else { return Ok(None) };
        let kind = if let Some(name) = self.scl_name() {
            Kind::Word(name?)
        } else if first.is_ascii_digit() {
            self.number(None)?
        } else if first.is_ascii_alphabetic() || first == '_' {
            let word = self.take_while(|character| character.is_ascii_alphanumeric() || character == '_');
            if self.rest.starts_with('#') {
                self.take(1);
                self.number(Some(word.into()))?
            } else {
                Kind::Word(word.into())
            }
        } else if let Some(symbol) = SYMBOLS.into_iter().find(|symbol| self.rest.starts_with(symbol)) {
            self.take(symbol.len());
            Kind::Symbol(symbol)
        } else {
            return Err(Mistake::new(place, format!("unexpected character {first:?}")));
        };
        Ok(Some(Token { kind, place }))
    }

    /// Takes `"name"` or `#name` of SCL.
    fn scl_name(&mut self) -> Option<Result<String, Mistake>> {
        let mark = self
            .rest
            .chars()
            .next()
            .filter(|mark| self.dialect == Dialect::Scl && matches!(mark, '"' | '#'))?;
        let place = self.place;
        self.take(1);
        let name = self.take_while(|character| character.is_ascii_alphanumeric() || character == '_');
        let is_ended = mark == '#' || self.rest.starts_with('"');
        self.take(usize::from(mark == '"' && is_ended));
        Some(match name {
            "" => Err(Mistake::new(place, "name expected")),
            _ if !is_ended => Err(Mistake::new(place, "name without its end `\"`")),
            name => Ok(name.into()),
        })
    }

    fn number(&mut self, of_type: Option<String>) -> Result<Kind, Mistake> {
        let place = self.place;
        let bad = || Mistake::new(place, "malformed number");
        let sign = if of_type.is_some() && self.rest.starts_with('-') { self.take(1) } else { "" };
        let digits = self.take_while(|character| character.is_ascii_digit() || character == '_');
        // Most numbers of a long list of motions have no separators, and need no copy.
        let digits = if digits.contains('_') { Cow::Owned(digits.replace('_', "")) } else { digits.into() };
        if let Some(of_type) = &of_type
            && of_type.eq_ignore_ascii_case("BOOL")
            && digits.is_empty()
        {
            let word = self.take_while(|character| character.is_ascii_alphabetic());
            let value = u64::from(word.eq_ignore_ascii_case("TRUE"));
            let is_bool = value == 1 || word.eq_ignore_ascii_case("FALSE");
            return if is_bool { Ok(Kind::Integer(Some("BOOL".into()), value)) } else { Err(bad()) };
        }
        if self.rest.starts_with('#') {
            self.take(1);
            let base: u32 = digits.parse().map_err(|_| bad())?;
            let digits = self
                .take_while(|character| character.is_ascii_alphanumeric() || character == '_')
                .replace('_', "");
            if !matches!(base, 2 | 8 | 16) || !sign.is_empty() {
                return Err(bad());
            }
            return Ok(Kind::Integer(of_type, u64::from_str_radix(&digits, base).map_err(|_| bad())?));
        }
        let is_real = self.rest.starts_with('.') && !self.rest.starts_with("..");
        if !is_real {
            let value = digits.parse().map_err(|_| bad())?;
            // Negative typed literals are of signed types only; the parser has the sign as an operator elsewhere.
            return if sign.is_empty() && !self.rest.starts_with(|next: char| next.is_ascii_alphabetic()) {
                Ok(Kind::Integer(of_type, value))
            } else {
                Err(bad())
            };
        }
        self.take(1);
        let mut number =
            format!("{sign}{digits}.{}", self.take_while(|character| character.is_ascii_digit()));
        if self.rest.starts_with(['E', 'e']) {
            number.push_str(self.take(1));
            if self.rest.starts_with(['+', '-']) {
                number.push_str(self.take(1));
            }
            number.push_str(self.take_while(|character| character.is_ascii_digit()));
        }
        let value: f32 = number.parse().map_err(|_| bad())?;
        if value.is_finite() { Ok(Kind::Real(of_type, value)) } else { Err(bad()) }
    }
}
