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
    text_of(read_plain_file(path, most)?).map_err(|fault| Error::new(ErrorKind::InvalidData, fault))
}

/// Bytes from which the encoding of a file is recognized.
const ENCODING_BYTES: usize = 64;

/// Decodes the text of a file.
///
/// # Errors
///
/// The fault in the encoding, with the line and the remedy. UTF-16 without a byte order mark is mostly valid UTF-8, with a NUL beside each
/// letter.
pub(crate) fn text_of(bytes: Vec<u8>) -> std::result::Result<String, String> {
    let start = bytes.get(..ENCODING_BYTES).unwrap_or(&bytes);
    let nuls = start.iter().filter(|byte| **byte == 0).count();
    let has_mark = start.starts_with(&[0xFF, 0xFE]) || start.starts_with(&[0xFE, 0xFF]);
    if nuls > start.len() * 5 / 8 {
        return Err("the file is in UTF-32: save it as UTF-8".to_owned());
    }
    if has_mark || nuls > start.len() / 4 {
        return Err("the file is in UTF-16: save it as UTF-8".to_owned());
    }
    let at_fault = |bytes: &[u8], at: usize, what: &str| {
        let line = 1 + bytes.iter().take(at).filter(|byte| **byte == b'\n').count();
        let byte = bytes.get(at).copied().unwrap_or_default();
        format!("line {line} has the byte 0x{byte:02X}, which is not {what}: save the file as UTF-8")
    };
    let text = String::from_utf8(bytes)
        .map_err(|error| at_fault(error.as_bytes(), error.utf8_error().valid_up_to(), "UTF-8"))?;
    if let Some(at) = text.find('\0') {
        return Err(at_fault(text.as_bytes(), at, "text"));
    }
    if text.contains('\r') && !text.contains('\n') {
        return Err("its lines end with CR alone: save the file with line ends LF or CRLF".to_owned());
    }
    Ok(text)
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
        assert_eq!(said(&path), "line 1 has the byte 0xE4, which is not UTF-8: save the file as UTF-8");
        for to_bytes in [u16::to_le_bytes, u16::to_be_bytes] {
            let wide: Vec<u8> = "schema = 1\n# 15 mm²\n".encode_utf16().flat_map(to_bytes).collect();
            fs::write(&path, wide).unwrap();
            assert_eq!(said(&path), "the file is in UTF-16: save it as UTF-8");
        }
        for to_bytes in [u32::to_le_bytes, u32::to_be_bytes] {
            let wide: Vec<u8> =
                "schema = 1\n# 15 mm²\n".chars().flat_map(|letter| to_bytes(letter.into())).collect();
            fs::write(&path, wide).unwrap();
            assert_eq!(said(&path), "the file is in UTF-32: save it as UTF-8");
        }
        fs::write(&path, "schema = 1\r\nname = \"A\"\r\n").unwrap();
        assert!(read_plain_text(&path).is_ok(), "CRLF is a line end");
        fs::write(&path, "schema = 1\rname = \"A\"\r").unwrap();
        assert_eq!(said(&path), "its lines end with CR alone: save the file with line ends LF or CRLF");
        fs::write(&path, "schema = 1\nname = \"A\0\"\n").unwrap();
        assert_eq!(said(&path), "line 2 has the byte 0x00, which is not text: save the file as UTF-8");
        fs::File::create(&path).unwrap().set_len(MOST_FILE_BYTES + 1).unwrap();
        assert_eq!(said(&path), "it has 17 MiB; such a file has 16 MiB at most");
        #[cfg(unix)]
        assert_eq!(said(Path::new("/dev/zero")), "it is a pipe or a device; give the path of a file");
        assert_eq!(read_plain_text(&place.path().join("none")).unwrap_err().kind(), ErrorKind::NotFound);
    }
}
