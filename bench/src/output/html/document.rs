//! What all pages share: each is one self-contained file that includes its style.

use anyhow::Context as _;
use minijinja::Environment;
use minijinja::value::Serde;
use serde::Serialize;

const DOCUMENT: &str = include_str!("document.html");
const STYLE: &str = include_str!("style.css");

/// Fills a template, which extends `document.html`, with a page's content.
pub(crate) fn fill(template: &str, content: &impl Serialize) -> anyhow::Result<String> {
    let mut environment = Environment::new();
    let templates = [("document.html", DOCUMENT), ("style.css", STYLE), ("page.html", template)];
    for (name, source) in templates {
        environment
            .add_template(name, source)
            .with_context(|| format!("the template of {name} is broken"))?;
    }
    let page = environment.get_template("page.html").context("the page's template is broken")?;
    page.render(Serde(content)).context("cannot fill the page's template")
}
