//! Descriptions that live as long as the program, as the stacks take them.
//!
//! A description is made once for each device and for each fault that changes it, and a program emulates a fixed number of
//! devices; so its memory is not given back.

/// Makes a text that lives as long as the program, cut to the bytes that its field has.
pub(crate) fn text(text: &str, most: usize) -> &'static str {
    let mut end = text.len().min(most);
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    text.get(..end).unwrap_or_default().to_owned().leak()
}

/// Makes a list that lives as long as the program.
pub(crate) fn list<T>(list: Vec<T>) -> &'static [T] {
    list.leak()
}

/// Keeps the printable ASCII characters of a text, which is what the bus carries.
pub(crate) fn ascii(text: &str) -> String {
    text.chars().map(|it| if it == ' ' || it.is_ascii_graphic() { it } else { '?' }).collect()
}
