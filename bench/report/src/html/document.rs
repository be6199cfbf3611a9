//! What all pages share: each is one self-contained file that includes its style.

use anyhow::Context as _;
use minijinja::value::Serde;
use minijinja::{Environment, UndefinedBehavior};
use serde::Serialize;

const DOCUMENT: &str = include_str!("document.html");
const STYLE: &str = include_str!("style.css");
const FIGURE: &str = include_str!("figure.html");

/// Fills a template, which extends `document.html`, with a page's content.
pub fn fill(template: &str, content: &impl Serialize) -> anyhow::Result<String> {
    fill_with(template, &[], content)
}

/// Fills a template that includes parts, each with its name.
pub fn fill_with(template: &str, parts: &[(&str, &str)], content: &impl Serialize) -> anyhow::Result<String> {
    let mut environment = Environment::new();
    // A name that the content does not have is an error, and not an empty cell.
    environment.set_undefined_behavior(UndefinedBehavior::Strict);
    let templates =
        [("document.html", DOCUMENT), ("style.css", STYLE), ("figure.html", FIGURE), ("page.html", template)];
    for (name, source) in templates.iter().chain(parts).copied() {
        environment
            .add_template(name, source)
            .with_context(|| format!("the template of {name} is broken"))?;
    }
    let page = environment.get_template("page.html").context("the page's template is broken")?;
    page.render(Serde(content)).context("cannot fill the page's template")
}
