//! The code in its parts, for the dialects: types, functions and function blocks, with their sections and bodies in pieces.

use std::collections::HashMap;

use ::structured_text::{Piece, PieceKind, pieces};

use crate::Refused;

/// A section of variables.
pub(crate) struct VariableSection<'a> {
    /// `VAR`, `VAR_INPUT`, …
    pub(crate) role: Piece<'a>,
    pub(crate) is_constant: bool,
    /// Declarations, up to `END_VAR`.
    pub(crate) declarations: Vec<Piece<'a>>,
    pub(crate) end: Piece<'a>,
}

/// A type, function or function block, with the comment before it.
pub(crate) enum CodePart<'a> {
    Type {
        comment: &'a str,
        name: &'a str,
        /// From `STRUCT` or `ARRAY` on, without `END_TYPE`.
        body: Vec<Piece<'a>>,
    },
    Unit(Unit<'a>),
}

/// A function or a function block.
pub(crate) struct Unit<'a> {
    pub(crate) comment: &'a str,
    pub(crate) name: &'a str,
    /// Type of the result; `None` for a function block.
    pub(crate) result: Option<&'a str>,
    pub(crate) sections: Vec<VariableSection<'a>>,
    pub(crate) body: Vec<Piece<'a>>,
    pub(crate) end: Piece<'a>,
}

/// The code in its parts.
pub(crate) struct Parts<'a> {
    pub(crate) parts: Vec<CodePart<'a>>,
    /// Arrays by the names of their types.
    arrays: HashMap<&'a str, String>,
    /// Names of structures and function blocks.
    composed: Vec<&'a str>,
    /// Parameters of the functions.
    functions: HashMap<&'a str, Vec<&'a str>>,
}

impl<'a> Parts<'a> {
    /// Splits the code.
    ///
    /// # Errors
    /// It is not in the form of the templates.
    pub(crate) fn split(text: &'a str, maker: &'static str) -> Result<Self, Refused> {
        let fault = |text: String| Refused::Rewrite { maker, text };
        let all = pieces(text).map_err(|mistake| fault(mistake.to_string()))?;
        let mut found = Self {
            parts: Vec::new(),
            arrays: HashMap::new(),
            composed: Vec::new(),
            functions: HashMap::new(),
        };
        let mut rest = all.as_slice();
        while let Some(part) = found.next_part(&mut rest).map_err(&fault)? {
            found.parts.push(part);
        }
        Ok(found)
    }

    fn next_part(&mut self, rest: &mut &[Piece<'a>]) -> Result<Option<CodePart<'a>>, String> {
        let Some(first) = rest.first().copied() else { return Ok(None) };
        let comment = first.before.trim();
        if first.is_word("TYPE") {
            let [_, name, _] = take(rest, 3)? else { return Err("a type without its name".into()) };
            let name = name.text;
            let body = until(rest, "END_TYPE")?.to_vec();
            take(rest, 1)?;
            match body.first() {
                Some(first) if first.is_word("ARRAY") => {
                    let array = without_end(&body);
                    self.arrays.insert(name, joined(array).trim().to_owned());
                }
                _ => self.composed.push(name),
            }
            return Ok(Some(CodePart::Type { comment, name, body }));
        }
        let is_function = first.is_word("FUNCTION");
        if !is_function && !first.is_word("FUNCTION_BLOCK") {
            return Err(format!("`{}` where a declaration begins", first.text));
        }
        let [_, name] = take(rest, 2)? else { return Err("a block without its name".into()) };
        let name = name.text;
        let result = match is_function {
            true => take(rest, 2)?.get(1).map(|result| result.text),
            false => None,
        };
        let mut sections = Vec::new();
        while rest.first().is_some_and(|piece| piece.kind == PieceKind::Word && piece.text.starts_with("VAR"))
        {
            sections.push(section(rest)?);
        }
        let body = until(rest, if is_function { "END_FUNCTION" } else { "END_FUNCTION_BLOCK" })?.to_vec();
        let [end] = take(rest, 1)? else { return Err("a block without its end".into()) };
        let unit = Unit { comment, name, result, sections, body, end: *end };
        if is_function {
            self.functions.insert(name, unit.parameters());
        } else {
            self.composed.push(name);
        }
        Ok(Some(CodePart::Unit(unit)))
    }

    /// Returns whether a type's name stands for an array.
    pub(crate) fn is_array(&self, name: &str) -> bool {
        self.arrays.contains_key(name)
    }

    /// Returns the parameters of a function.
    pub(crate) fn parameters(&self, function: &str) -> Option<&[&'a str]> {
        self.functions.get(function).map(Vec::as_slice)
    }

    /// Writes declarations of variables or members, with arrays in the place of their names, and names of structures and blocks in
    /// the marks of a dialect.
    pub(crate) fn write_declarations(&self, of: &[Piece<'a>], quote: &str, text: &mut String) {
        let mut is_type = false;
        for (index, piece) in of.iter().enumerate() {
            text.push_str(piece.before);
            if piece.is_symbol(":") {
                is_type = true;
            } else if piece.is_symbol(";") || piece.is_symbol(":=") {
                is_type = false;
            }
            // The name of a structure's own type follows its `:` as STRUCT.
            match self.arrays.get(piece.text) {
                Some(array) if is_type => text.push_str(array),
                _ if is_type && index > 0 && self.composed.contains(&piece.text) => {
                    text.extend([quote, piece.text, quote]);
                }
                _ => text.push_str(piece.text),
            }
        }
    }
}

impl<'a> CodePart<'a> {
    /// Returns its name, and the names of its members or variables.
    pub(crate) fn declared_names(&self) -> (&'a str, Vec<&'a str>) {
        match self {
            Self::Type { name, body, .. } => (name, declared(body)),
            Self::Unit(unit) => (unit.name, unit.variables()),
        }
    }
}

impl<'a> Unit<'a> {
    /// Returns the names of its variables.
    pub(crate) fn variables(&self) -> Vec<&'a str> {
        self.sections.iter().flat_map(|section| declared(&section.declarations)).collect()
    }

    /// Returns the names of its inputs and in-outs, in order.
    fn parameters(&self) -> Vec<&'a str> {
        let sections = self.sections.iter();
        let of_call = sections.filter(|section| ["VAR_INPUT", "VAR_IN_OUT"].contains(&section.role.text));
        of_call.flat_map(|section| declared(&section.declarations)).collect()
    }
}

fn section<'a>(rest: &mut &[Piece<'a>]) -> Result<VariableSection<'a>, String> {
    let [role] = take(rest, 1)? else { return Err("a section without its beginning".into()) };
    let role = *role;
    let is_constant = rest.first().is_some_and(|piece| piece.is_word("CONSTANT"));
    take(rest, usize::from(is_constant))?;
    let declarations = until(rest, "END_VAR")?.to_vec();
    let [end] = take(rest, 1)? else { return Err("a section without its end".into()) };
    Ok(VariableSection { role, is_constant, declarations, end: *end })
}

/// Returns the names before the `:` of each declaration.
fn declared<'a>(pieces: &[Piece<'a>]) -> Vec<&'a str> {
    let mut names = Vec::new();
    let mut is_name = true;
    for piece in pieces {
        match piece.kind {
            PieceKind::Symbol if piece.text == ":" => is_name = false,
            PieceKind::Symbol if piece.text == ";" => is_name = true,
            PieceKind::Word if is_name && !piece.text.starts_with("END_") && !piece.is_word("STRUCT") => {
                names.push(piece.text);
            }
            _ => {}
        }
    }
    names
}

fn take<'s, 'a>(rest: &mut &'s [Piece<'a>], count: usize) -> Result<&'s [Piece<'a>], String> {
    let (taken, left) = rest.split_at_checked(count).ok_or("the code ends within a declaration")?;
    *rest = left;
    Ok(taken)
}

fn until<'s, 'a>(rest: &mut &'s [Piece<'a>], word: &str) -> Result<&'s [Piece<'a>], String> {
    let found = rest.iter().position(|piece| piece.is_word(word));
    take(rest, found.ok_or_else(|| format!("no `{word}`"))?)
}

fn without_end<'s, 'a>(body: &'s [Piece<'a>]) -> &'s [Piece<'a>] {
    match body.split_last() {
        Some((last, rest)) if last.is_symbol(";") => rest,
        _ => body,
    }
}

/// Joins pieces as they were written.
pub(crate) fn joined(pieces: &[Piece<'_>]) -> String {
    let mut text = String::new();
    for piece in pieces {
        text.extend([piece.before, piece.text]);
    }
    text
}
