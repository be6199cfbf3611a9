//! Links from a page to files near it, which stay right when both are moved together.

use std::path::{Component, Path};

/// Returns the address of a file as seen from a page; `None` if either's directory cannot be found.
pub(super) fn from_page(page: &Path, file: &Path) -> Option<String> {
    let here = match page.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    Some(between(&here.canonicalize().ok()?, &file.canonicalize().ok()?))
}

/// Returns the address of a file as seen from a directory; both paths are absolute.
fn between(directory: &Path, file: &Path) -> String {
    let (from, to) = [directory, file].map(|path| path.components().collect::<Vec<_>>()).into();
    let shared = from.iter().zip(&to).take_while(|(one, other)| one == other).count();
    let up = from.iter().skip(shared).map(|_| "..".to_owned());
    let down = to.iter().skip(shared).map(|part| encoded(*part));
    up.chain(down).collect::<Vec<_>>().join("/")
}

/// Encodes all but the unreserved characters of RFC 3986, section 2.3.
fn encoded(part: Component<'_>) -> String {
    let byte = |byte: &u8| match *byte {
        plain if plain.is_ascii_alphanumeric() || b"-._~".contains(&plain) => char::from(plain).to_string(),
        other => format!("%{other:02X}"),
    };
    part.as_os_str().as_encoded_bytes().iter().map(byte).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_link_leads_up_and_down_and_holds_no_character_that_has_a_meaning_in_an_address() {
        let between = |directory: &str, file: &str| between(Path::new(directory), Path::new(file));
        assert_eq!(between("/a/b", "/a/b/c/report.html"), "c/report.html");
        assert_eq!(between("/a/b/pages", "/a/runs/1/report.html"), "../../runs/1/report.html");
        assert_eq!(between("/", "/a:b/50 %#?/\"ä\".html"), "a%3Ab/50%20%25%23%3F/%22%C3%A4%22.html");
    }
}
