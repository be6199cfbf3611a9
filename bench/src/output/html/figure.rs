//! A figure of a page, drawn twice: for a screen or paper, and for a phone.

use minijinja::Value;
use serde::Serialize;

use super::chart::Format;

/// A figure in both widths.
#[derive(Serialize)]
pub(crate) struct Figure {
    wide: Value,
    narrow: Value,
    /// Text alternative for readers who do not see the figure.
    about: &'static str,
}

impl Figure {
    /// Draws a figure in both widths; `None` if there is nothing to draw.
    pub(crate) fn draw(
        about: &'static str,
        draw: impl Fn(Format) -> anyhow::Result<Option<String>>,
    ) -> anyhow::Result<Option<Self>> {
        let (wide, narrow) = (draw(Format::Wide)?, draw(Format::Narrow)?);
        Ok(wide.zip(narrow).map(|(wide, narrow)| Self {
            wide: Value::from_safe_string(wide),
            narrow: Value::from_safe_string(narrow),
            about,
        }))
    }
}
