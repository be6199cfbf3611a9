//! Lines from a node, which may be anything: bounded in length, whatever the other end sends.

use tokio::io::{AsyncBufRead, AsyncBufReadExt as _};

/// Longest message in bytes. The longest reports have some thousand.
const MESSAGE: usize = 256 << 10;

/// Longest first message in bytes: it has the texts of a setup and an application, each a file of at most 16 MiB.
const HELLO: usize = 40 << 20;

/// Start of a first message.
const HELLO_START: &[u8] = b"{\"hello\":";

/// Bytes of a line that is too long which an error shows.
const SHOWN: usize = 200;

/// A line of a node.
#[derive(PartialEq, Eq, Debug)]
pub(super) enum BoundedLine {
    /// The line, without its end.
    Whole(String),
    /// The beginning of one that is longer than any message.
    TooLong(String),
}

/// Reads the next line; `None` at the end, or where reading fails.
pub(super) async fn next_line(from: &mut (impl AsyncBufRead + Unpin)) -> Option<BoundedLine> {
    let mut line = Vec::new();
    loop {
        let limit = if line.starts_with(HELLO_START) { HELLO } else { MESSAGE };
        let piece = from.fill_buf().await.ok()?;
        if piece.is_empty() {
            return (!line.is_empty()).then(|| BoundedLine::Whole(text(&line)));
        }
        let end = piece.iter().position(|byte| *byte == b'\n');
        let taken = piece.get(..end.unwrap_or(piece.len())).unwrap_or_default();
        line.extend_from_slice(taken);
        let used = taken.len() + usize::from(end.is_some());
        from.consume(used);
        let limit = if line.starts_with(HELLO_START) { HELLO } else { limit };
        if line.len() > limit {
            line.truncate(SHOWN);
            return Some(BoundedLine::TooLong(format!("{}…", text(&line))));
        }
        if end.is_some() {
            return Some(BoundedLine::Whole(text(line.strip_suffix(b"\r").unwrap_or(&line))));
        }
    }
}

/// Returns the beginning of a line, as an error shows it.
pub(super) fn beginning(line: &str) -> String {
    match line.char_indices().nth(SHOWN) {
        Some((at, _)) => format!("{}…", line.get(..at).unwrap_or_default()),
        None => line.to_owned(),
    }
}

fn text(line: &[u8]) -> String {
    String::from_utf8_lossy(line).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use tokio::io::BufReader;

    fn lines(bytes: &[u8]) -> Vec<BoundedLine> {
        let runtime = tokio::runtime::Builder::new_current_thread().build().unwrap();
        runtime.block_on(async {
            let mut from = BufReader::new(bytes);
            let mut lines = Vec::new();
            while let Some(line) = next_line(&mut from).await {
                let is_end = matches!(line, BoundedLine::TooLong(_));
                lines.push(line);
                if is_end {
                    break;
                }
            }
            lines
        })
    }

    #[test]
    fn a_line_longer_than_any_message_ends_the_reading_and_only_its_beginning_is_kept() {
        let whole = |text: &str| BoundedLine::Whole(text.to_owned());
        assert_eq!(lines(b"\"a\"\r\n\n\"b\""), [whole("\"a\""), whole(""), whole("\"b\"")]);
        let flood = vec![b'x'; 3 * MESSAGE];
        let found = lines(&flood);
        assert_eq!(found, [BoundedLine::TooLong(format!("{}…", "x".repeat(SHOWN)))]);
        let hello = [HELLO_START, &vec![b' '; 2 * MESSAGE], b"7}\n"].concat();
        assert!(matches!(&lines(&hello)[..], [BoundedLine::Whole(line)] if line.len() > 2 * MESSAGE));
        assert_eq!(beginning(&"é".repeat(300)).chars().count(), SHOWN + 1);
    }
}
