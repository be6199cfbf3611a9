//! Files of whole lines that one process at a time appends to. They are never rewritten; after a kill at most the end is a part.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, BufRead as _, BufReader, Write as _};
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use report::export_text::quoted;

/// Formats a field of a file that is read line by line: without line breaks, in quotes if necessary.
pub(crate) fn field(text: &str) -> String {
    quoted(&text.replace(['\n', '\r'], " "))
}

/// Returns the fields of a line of CSV.
pub(crate) fn fields(line: &str) -> Vec<String> {
    let (mut fields, mut field, mut is_quoted) = (Vec::new(), String::new(), false);
    let mut letters = line.trim_end_matches(['\n', '\r']).chars().peekable();
    while let Some(letter) = letters.next() {
        match letter {
            '"' if is_quoted && letters.peek() == Some(&'"') => field.extend(letters.next()),
            '"' => is_quoted = !is_quoted,
            ',' if !is_quoted => fields.push(std::mem::take(&mut field)),
            other => field.push(other),
        }
    }
    fields.push(field);
    fields
}

/// Opens a file and locks it until the handle is dropped.
///
/// # Errors
///
/// It cannot be written, or another process writes it.
pub(super) fn locked(path: &Path) -> anyhow::Result<File> {
    let lock = OpenOptions::new().create(true).append(true).open(path);
    let lock = lock.with_context(|| format!("cannot write {}", path.display()))?;
    match lock.try_lock() {
        Ok(()) => {}
        Err(TryLockError::WouldBlock) => bail!(
            "{}: another process writes here; give each shard a directory of its own",
            path.parent().unwrap_or(path).display()
        ),
        // Not every file system has locks; the claim of the directory still keeps other studies away.
        Err(TryLockError::Error(_)) => {}
    }
    Ok(lock)
}

/// A file that whole lines are appended to.
pub(super) struct Appended {
    path: PathBuf,
    file: File,
    len: u64,
}

impl Appended {
    /// Opens a file of which `whole` bytes are kept; 0 for one that gets its first line.
    pub(super) fn open(path: PathBuf, head: &str, whole: u64) -> anyhow::Result<Self> {
        let about = || format!("cannot write {}", path.display());
        let file = OpenOptions::new().create(true).append(true).open(&path).with_context(about)?;
        file.set_len(whole).with_context(about)?;
        let mut appended = Self { file, len: whole, path };
        if whole == 0 {
            appended.add(head)?;
        }
        Ok(appended)
    }

    /// Appends lines, all or none of them.
    pub(super) fn add(&mut self, lines: &str) -> anyhow::Result<()> {
        let saved = self.file.write_all(lines.as_bytes());
        if saved.is_err() {
            // If even this fails, the next start removes the part.
            let _ = self.file.set_len(self.len);
        } else {
            self.len += lines.len() as u64;
        }
        saved.with_context(|| format!("cannot write {}", self.path.display()))
    }

    /// Returns the length of its whole lines.
    pub(super) const fn len(&self) -> u64 {
        self.len
    }

    /// Writes by this handle, which has the lock.
    pub(super) fn hold(&mut self, lock: File) {
        self.file = lock;
    }

    /// Removes lines that were added after this length.
    pub(super) fn shorten(&mut self, len: u64) {
        if self.file.set_len(len).is_ok() {
            self.len = len;
        }
    }
}

/// The lines of a file after its first one.
pub(super) struct CsvLines {
    path: PathBuf,
    reader: Option<BufReader<File>>,
    len: u64,
    /// Bytes read so far.
    read: u64,
    /// A line that was looked at and belongs to what comes next.
    waiting: Option<String>,
}

impl CsvLines {
    /// Opens a file; one that is missing or has only a part of this first line has no lines.
    pub(super) fn open(path: &Path, head: &str) -> anyhow::Result<Self> {
        let about = || format!("cannot read {}", path.display());
        let none = Self { path: path.to_owned(), reader: None, len: 0, read: 0, waiting: None };
        let file = match File::open(path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(none),
            opened => opened.with_context(about)?,
        };
        let len = file.metadata().with_context(about)?.len();
        let mut reader = BufReader::with_capacity(1 << 16, file);
        let mut first = String::new();
        reader.read_line(&mut first).with_context(about)?;
        if first == head {
            return Ok(Self { reader: Some(reader), len, read: first.len() as u64, ..none });
        }
        // A kill may leave a part of the first line, and nothing else.
        if head.starts_with(&first) {
            return Ok(none);
        }
        bail!(
            "{}: has other columns, so it is from another study or version; use another --out",
            path.display()
        )
    }

    /// Returns the length of the file.
    pub(super) const fn len(&self) -> u64 {
        self.len
    }

    /// Returns how many bytes the lines so far have.
    pub(super) const fn read(&self) -> u64 {
        self.read
    }

    /// Returns the next line if it is wanted; otherwise it stays.
    pub(super) fn next_if(&mut self, is_wanted: impl Fn(&str) -> bool) -> anyhow::Result<Option<String>> {
        let Some(line) = self.next()? else { return Ok(None) };
        if is_wanted(&line) {
            return Ok(Some(line));
        }
        self.read -= line.len() as u64;
        self.waiting = Some(line);
        Ok(None)
    }

    /// Returns the next line with its end, which a line that a kill cut off does not have.
    pub(super) fn next(&mut self) -> anyhow::Result<Option<String>> {
        if let Some(line) = self.waiting.take() {
            self.read += line.len() as u64;
            return Ok(Some(line));
        }
        let Some(reader) = &mut self.reader else { return Ok(None) };
        let mut line = String::new();
        let read =
            reader.read_line(&mut line).with_context(|| format!("cannot read {}", self.path.display()))?;
        self.read += read as u64;
        Ok((read > 0).then_some(line))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_fields_of_a_line_are_those_that_were_written() {
        let texts = ["0000000000000001", "loss=0.1, \"x\"", "", "a\"b"];
        let line = texts.map(field).join(",") + "\n";
        assert_eq!(fields(&line), texts);
        assert_eq!(field("two\nlines"), "two lines");
    }
}
