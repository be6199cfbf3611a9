//! Trees of whole programs, to compare what two dialects of the language say.

use std::collections::HashMap;

use crate::parser::{Normal, Parser, parse};
use crate::syntax::{Declaration, Dialect};
use crate::{Mistake, Source};

/// A program's tree without places and comments. Names of arrays are replaced by the arrays, and each parameter of a function has
/// its name, so that it depends on what is said and not on how a dialect writes it.
#[derive(Clone, PartialEq, Debug)]
pub struct Tree(Vec<Declaration>);

impl Tree {
    /// Parses texts of a dialect, in the order of their declarations.
    ///
    /// # Errors
    /// The first mistake, with its file and place.
    pub fn parse(sources: &[Source<'_>], dialect: Dialect) -> Result<Self, Mistake> {
        let mut normal = Normal::default();
        let mut found = Vec::new();
        for Source { file, text } in sources {
            let in_file = |mistake: Mistake| mistake.in_file(file);
            let mut parser = Parser::new(text, dialect, Some(normal)).map_err(in_file)?;
            found.extend(parser.declarations().map_err(in_file)?);
            normal = parser.into_normal();
        }
        Ok(Self(joined(found)))
    }

    /// Returns the number of types, functions and function blocks.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.0.len()
    }

    /// Returns whether there are none.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

/// Parses texts of a dialect with their places.
pub(crate) fn parse_all(
    sources: &[Source<'_>],
    dialect: Dialect,
) -> Result<Vec<(String, Declaration)>, Mistake> {
    let mut found = Vec::new();
    for Source { file, text } in sources {
        let declarations = parse(text, dialect).map_err(|mistake| mistake.in_file(file))?;
        found.extend(declarations.into_iter().map(|declaration| ((*file).to_owned(), declaration)));
    }
    Ok(found)
}

/// Gives units that were declared first their bodies, which follow under the same names.
pub(crate) fn joined(declarations: Vec<Declaration>) -> Vec<Declaration> {
    let mut found: Vec<Declaration> = Vec::with_capacity(declarations.len());
    let mut by_name = HashMap::new();
    for declaration in declarations {
        if let Declaration::Unit(unit) = declaration {
            let key = unit.name.to_ascii_lowercase();
            match by_name.get(&key).and_then(|index: &usize| found.get_mut(*index)) {
                Some(Declaration::Unit(before)) if before.body.is_empty() && unit.variables.is_empty() => {
                    before.body = unit.body;
                }
                _ => {
                    by_name.insert(key, found.len());
                    found.push(Declaration::Unit(unit));
                }
            }
        } else {
            found.push(declaration);
        }
    }
    found
}
