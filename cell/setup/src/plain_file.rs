//! Files of a user, read as a whole: a pipe, a device or an endless file in their place is refused before it is opened.

use std::fs;
use std::io::{Error, ErrorKind, Read as _, Result};
use std::path::Path;

/// Largest file in bytes that is read as a whole: a setup, an application, a token, a study, a case.
pub const MOST_FILE_BYTES: u64 = 16 << 20;

/// Reads a file of at most `most` bytes.
///
/// # Errors
///
/// The system's error, or [`ErrorKind::InvalidInput`] for what is not a plain file or is too large.
pub fn read_plain_file(path: &Path, most: u64) -> Result<Vec<u8>> {
    let file = open_plain_file(path)?;
    let len = file.metadata()?.len();
    let mut bytes = Vec::new();
    // Some files of the system say that they are empty, and are not.
    file.take(most + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > most {
        let megabytes = len.max(bytes.len() as u64).div_ceil(1 << 20);
        let reason = format!("it has {megabytes} MiB; such a file has {} MiB at most", most >> 20);
        return Err(Error::new(ErrorKind::InvalidInput, reason));
    }
    Ok(bytes)
}

/// Opens a file that is read part by part, and more than once.
///
/// # Errors
///
/// The system's error, or [`ErrorKind::InvalidInput`] for what is not a plain file.
pub fn open_plain_file(path: &Path) -> Result<fs::File> {
    let about = fs::metadata(path)?;
    // Opening a pipe or a device could wait for ever.
    if !about.is_file() && !about.is_dir() {
        let reason = "it is a pipe or a device; give the path of a file";
        return Err(Error::new(ErrorKind::InvalidInput, reason));
    }
    fs::File::open(path)
}

/// Reads a text file of at most [`MOST_FILE_BYTES`].
///
/// # Errors
///
/// Those of [`read_plain_file`], and [`ErrorKind::InvalidData`] for what is not UTF-8.
pub fn read_plain_text(path: &Path) -> Result<String> {
    read_plain_text_within(path, MOST_FILE_BYTES)
}

/// Reads a text file of at most `most` bytes.
///
/// # Errors
///
/// Those of [`read_plain_text`].
pub fn read_plain_text_within(path: &Path, most: u64) -> Result<String> {
    let bytes = read_plain_file(path, most)?;
    String::from_utf8(bytes)
        .map_err(|_| Error::new(ErrorKind::InvalidData, "it is not text in UTF-8: save it as UTF-8"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_device_a_large_file_and_another_encoding_are_refused_and_a_plain_file_is_read() {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("file");
        let said = |path: &Path| read_plain_text(path).unwrap_err().to_string();
        fs::write(&path, "text").unwrap();
        assert_eq!(read_plain_text(&path).unwrap(), "text");
        fs::write(&path, b"sp\xe4ter").unwrap();
        assert_eq!(said(&path), "it is not text in UTF-8: save it as UTF-8");
        fs::File::create(&path).unwrap().set_len(MOST_FILE_BYTES + 1).unwrap();
        assert_eq!(said(&path), "it has 17 MiB; such a file has 16 MiB at most");
        #[cfg(unix)]
        assert_eq!(said(Path::new("/dev/zero")), "it is a pipe or a device; give the path of a file");
        assert_eq!(read_plain_text(&place.path().join("none")).unwrap_err().kind(), ErrorKind::NotFound);
    }
}
