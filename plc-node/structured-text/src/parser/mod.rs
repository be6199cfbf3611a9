//! Tokens → tree.

mod declarations;
mod expressions;
mod statements;

use crate::lexer::{Kind, Token, tokens};
use std::collections::HashMap;

use crate::syntax::{Declaration, Dialect, TypeName};
use crate::{Mistake, Place};

/// Replacements of the parser.
#[derive(Default)]
pub(crate) struct Normal {
    pub(crate) arrays: HashMap<String, TypeName>,
    pub(crate) parameters: HashMap<String, Vec<String>>,
}

/// Deepest nesting of statements and expressions: the checker and the execution recurse as deep.
const DEEPEST: u32 = 64;

/// Words that name nothing else: those of the subset, and reserved words of the standard that compilers refuse as names.
const KEYWORDS: [&str; 77] = [
    "ACTION",
    "AND",
    "ARRAY",
    "AT",
    "BY",
    "CASE",
    "CONFIGURATION",
    "CONSTANT",
    "CONTINUE",
    "DATE",
    "DO",
    "DT",
    "ELSE",
    "ELSIF",
    "EN",
    "END_CASE",
    "END_FOR",
    "END_FUNCTION",
    "END_FUNCTION_BLOCK",
    "END_IF",
    "END_PROGRAM",
    "END_REPEAT",
    "END_STRUCT",
    "END_TYPE",
    "END_VAR",
    "END_WHILE",
    "ENO",
    "EXIT",
    "FALSE",
    "FOR",
    "FROM",
    "FUNCTION",
    "FUNCTION_BLOCK",
    "F_EDGE",
    "IF",
    "LINT",
    "LREAL",
    "LWORD",
    "MOD",
    "NON_RETAIN",
    "NOT",
    "NULL",
    "OF",
    "ON",
    "OR",
    "PROGRAM",
    "READ_ONLY",
    "READ_WRITE",
    "REF",
    "REF_TO",
    "REPEAT",
    "RESOURCE",
    "RETAIN",
    "RETURN",
    "R_EDGE",
    "STEP",
    "STRING",
    "STRUCT",
    "TASK",
    "THEN",
    "TIME",
    "TO",
    "TOD",
    "TRANSITION",
    "TRUE",
    "TYPE",
    "ULINT",
    "UNTIL",
    "VAR",
    "VAR_GLOBAL",
    "VAR_INPUT",
    "VAR_IN_OUT",
    "VAR_OUTPUT",
    "VAR_TEMP",
    "WHILE",
    "WITH",
    "XOR",
];

/// Parses a text.
///
/// # Errors
/// The text is not a sequence of the subset's declarations.
pub(crate) fn parse(text: &str, dialect: Dialect) -> Result<Vec<Declaration>, Mistake> {
    Parser::new(text, dialect, None)?.declarations()
}

/// A text under way.
pub(crate) struct Parser {
    dialect: Dialect,
    /// Replacements in a tree that is compared; `None` in one that is compiled.
    normal: Option<Normal>,
    tokens: Vec<Token>,
    next: usize,
    depth: u32,
    /// Operators of the statement or declaration so far.
    operators: u32,
}

type Parsed<T> = Result<T, Mistake>;

impl Parser {
    /// Begins to parse a text. One that is compared gets no places.
    pub(crate) fn new(text: &str, dialect: Dialect, normal: Option<Normal>) -> Parsed<Self> {
        let mut tokens = tokens(text, dialect)?;
        if normal.is_some() {
            tokens.iter_mut().for_each(|token| token.place = Place::default());
        }
        Ok(Self { dialect, normal, tokens, next: 0, depth: 0, operators: 0 })
    }

    /// Returns what was found to be replaced.
    pub(crate) fn into_normal(self) -> Normal {
        self.normal.unwrap_or_default()
    }

    /// Skips `VERSION : 0.1` of SCL.
    fn skip_version(&mut self) {
        if self.dialect == Dialect::Scl && self.take_word("VERSION") {
            self.next += usize::from(self.take_symbol(":"));
        }
    }

    fn peek(&self) -> Option<&Kind> {
        self.tokens.get(self.next).map(|token| &token.kind)
    }

    /// Returns the place of the next token; after the last one its place.
    fn place(&self) -> Place {
        let last = self.tokens.len().saturating_sub(1);
        self.tokens.get(self.next.min(last)).map_or(Place { line: 1, column: 1 }, |token| token.place)
    }

    fn mistake<T>(&self, expected: &str) -> Parsed<T> {
        let found = match self.peek() {
            None => "the end of the text".into(),
            Some(Kind::Word(word)) => format!("`{word}`"),
            Some(Kind::Symbol(symbol)) => format!("`{symbol}`"),
            Some(Kind::Integer(_, value)) => format!("`{value}`"),
            Some(Kind::Real(_, value)) => format!("`{value}`"),
        };
        Err(Mistake::new(self.place(), format!("{found}: expected {expected}")))
    }

    fn is_word(&self, word: &str) -> bool {
        matches!(self.peek(), Some(Kind::Word(found)) if found.eq_ignore_ascii_case(word))
    }

    fn is_symbol(&self, symbol: &str) -> bool {
        matches!(self.peek(), Some(Kind::Symbol(found)) if *found == symbol)
    }

    fn take_word(&mut self, word: &str) -> bool {
        let found = self.is_word(word);
        self.next += usize::from(found);
        found
    }

    fn take_symbol(&mut self, symbol: &str) -> bool {
        let found = self.is_symbol(symbol);
        self.next += usize::from(found);
        found
    }

    fn word(&mut self, word: &str) -> Parsed<()> {
        if self.take_word(word) { Ok(()) } else { self.mistake(&format!("`{word}`")) }
    }

    fn symbol(&mut self, symbol: &str) -> Parsed<()> {
        if self.take_symbol(symbol) { Ok(()) } else { self.mistake(&format!("`{symbol}`")) }
    }

    fn name(&mut self) -> Parsed<(String, Place)> {
        let place = self.place();
        match self.peek() {
            Some(Kind::Word(word)) if !KEYWORDS.iter().any(|keyword| keyword.eq_ignore_ascii_case(word)) => {
                let word = word.clone();
                self.next += 1;
                Ok((word, place))
            }
            _ => self.mistake("a name"),
        }
    }

    /// Parses one level deeper.
    fn deeper<T>(&mut self, parse: impl FnOnce(&mut Self) -> Parsed<T>) -> Parsed<T> {
        if self.depth >= DEEPEST {
            return Err(Mistake::new(self.place(), format!("nested deeper than {DEEPEST} levels; split it")));
        }
        self.depth += 1;
        let parsed = parse(self);
        self.depth -= 1;
        parsed
    }
}
