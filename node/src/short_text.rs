//! A short text that the cyclic thread can build without allocation.

use std::fmt;

/// Capacity in bytes.
const ROOM: usize = 768;

/// A text of bounded length. What does not fit is cut off at a character boundary.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct ShortText {
    text: [u8; ROOM],
    len: usize,
}

impl ShortText {
    /// Returns the text.
    #[must_use]
    pub fn as_str(&self) -> &str {
        let text = self.text.get(..self.len).unwrap_or_default();
        std::str::from_utf8(text).unwrap_or_default()
    }
}

impl Default for ShortText {
    fn default() -> Self {
        Self { text: [0; ROOM], len: 0 }
    }
}

impl fmt::Write for ShortText {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        let room = ROOM - self.len;
        let fits = text.floor_char_boundary(room.min(text.len()));
        let (taken, rest) = text.split_at(fits);
        if let Some(place) = self.text.get_mut(self.len..self.len + fits) {
            place.copy_from_slice(taken.as_bytes());
            self.len += fits;
        }
        if rest.is_empty() { Ok(()) } else { Err(fmt::Error) }
    }
}

impl fmt::Debug for ShortText {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.as_str().fmt(f)
    }
}

#[cfg(test)]
mod tests {
    use std::fmt::Write as _;

    use super::*;

    #[test]
    fn a_text_that_is_too_long_is_cut_after_a_whole_character() {
        let mut words = ShortText::default();
        assert!(write!(words, "every {} µs and", 100).is_ok());
        assert_eq!(words.as_str(), "every 100 µs and");
        assert!(words.write_str(&"µ".repeat(ROOM)).is_err());
        assert!(words.as_str().ends_with('µ') && words.as_str().len() >= ROOM - 1);
    }
}
