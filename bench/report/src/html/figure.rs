//! A figure of a page, drawn twice: for a screen or paper, and for a phone.

use minijinja::Value;
use serde::Serialize;

use super::chart::Format;

/// A figure in both widths.
#[derive(Serialize)]
pub struct Figure {
    wide: Value,
    narrow: Value,
    /// Text alternative for readers who do not see the figure.
    about: String,
    /// What the figure shows, as figures.
    data: Option<Data>,
}

/// A figure's content as a table.
#[derive(Serialize)]
pub struct Data {
    head: Vec<String>,
    rows: Vec<Vec<String>>,
    /// Whether rows are left out.
    is_cut_off: bool,
}

impl Data {
    /// Rows of a table at most; the run's files have all.
    const ROWS: usize = 100;

    /// Creates a table; the first cell of each row names it.
    pub fn new(head: Vec<String>, mut rows: Vec<Vec<String>>) -> Self {
        let is_cut_off = rows.len() > Self::ROWS;
        rows.truncate(Self::ROWS);
        Self { head, rows, is_cut_off }
    }
}

impl Figure {
    /// Draws a figure in both widths; `None` if there is nothing to draw.
    pub fn draw(
        about: &str,
        draw: impl Fn(Format) -> anyhow::Result<Option<String>>,
    ) -> anyhow::Result<Option<Self>> {
        let (wide, narrow) = (draw(Format::Wide)?, draw(Format::Narrow)?);
        Ok(wide.zip(narrow).map(|(wide, narrow)| Self {
            wide: Value::from_safe_string(wide),
            narrow: Value::from_safe_string(narrow),
            about: about.to_owned(),
            data: None,
        }))
    }

    /// Adds the figure's content as a table.
    #[must_use]
    pub fn with(self, data: Data) -> Self {
        Self { data: Some(data), ..self }
    }
}
