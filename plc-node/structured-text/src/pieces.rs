//! A text in its pieces, for programs that rewrite it: every token with the white space and the comments before it.

use crate::lexer::{Kind, Lexer};
use crate::{Dialect, Mistake};

/// Kind of a piece.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum PieceKind {
    /// A name or a word of the language.
    Word,
    /// A literal number.
    Number,
    /// An operator or a separator.
    Symbol,
}

/// A token as it is written.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Piece<'a> {
    /// White space and comments before it.
    pub before: &'a str,
    /// The token.
    pub text: &'a str,
    /// Its kind.
    pub kind: PieceKind,
}

impl Piece<'_> {
    /// Returns whether it is this word, in whatever case.
    #[must_use]
    pub fn is_word(&self, word: &str) -> bool {
        self.kind == PieceKind::Word && self.text.eq_ignore_ascii_case(word)
    }

    /// Returns whether it is this operator or separator.
    #[must_use]
    pub fn is_symbol(&self, symbol: &str) -> bool {
        self.kind == PieceKind::Symbol && self.text == symbol
    }
}

/// Splits a text into its pieces.
///
/// # Errors
/// A character, number or comment is malformed.
pub fn pieces(text: &str) -> Result<Vec<Piece<'_>>, Mistake> {
    let mut lexer = Lexer::new(text, Dialect::Standard);
    let mut found = Vec::new();
    let mut from = 0;
    loop {
        lexer.skip_comments()?;
        let at = text.len() - lexer.rest().len();
        let Some(token) = lexer.next()? else { return Ok(found) };
        let end = text.len() - lexer.rest().len();
        let kind = match token.kind {
            Kind::Word(_) => PieceKind::Word,
            Kind::Integer(..) | Kind::Real(..) => PieceKind::Number,
            Kind::Symbol(_) => PieceKind::Symbol,
        };
        let slice = |from, to| text.get(from..to).unwrap_or_default();
        found.push(Piece { before: slice(from, at), text: slice(at, end), kind });
        from = end;
    }
}
