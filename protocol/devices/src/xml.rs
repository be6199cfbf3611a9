//! Writing XML.

use std::fmt::{self, Write};

/// XML being written. It contains only our own names and numbers, so nothing needs to be escaped.
#[derive(Default, Debug)]
pub(crate) struct Xml {
    pub(crate) text: String,
    depth: usize,
    /// Texts that elements refer to by identifier, in formats that keep texts apart.
    pub(crate) texts: Vec<(String, String)>,
}

impl Xml {
    /// Writes a line at the present depth.
    pub(crate) fn line(&mut self, line: impl fmt::Display) -> fmt::Result {
        writeln!(self.text, "{:1$}{line}", "", 2 * self.depth)
    }

    /// Writes an element without content.
    pub(crate) fn empty(&mut self, element: impl fmt::Display) -> fmt::Result {
        self.line(format_args!("<{element}/>"))
    }

    /// Writes an element with a text.
    pub(crate) fn leaf(&mut self, name: &str, content: &str) -> fmt::Result {
        self.line(format_args!("<{name}>{content}</{name}>"))
    }

    /// Writes an element with what `inner` writes.
    pub(crate) fn within(
        &mut self,
        name: &str,
        attributes: impl fmt::Display,
        inner: impl FnOnce(&mut Self) -> fmt::Result,
    ) -> fmt::Result {
        let attributes = attributes.to_string();
        let space = if attributes.is_empty() { "" } else { " " };
        self.line(format_args!("<{name}{space}{attributes}>"))?;
        self.depth += 1;
        inner(self)?;
        self.depth -= 1;
        self.line(format_args!("</{name}>"))
    }
}
