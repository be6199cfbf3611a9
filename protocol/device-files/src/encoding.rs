//! Encodings of device files: UTF-8 with or without a byte order mark, UTF-16, Latin-1.

use crate::fault::{FileFault, excerpt};

/// Longest file in bytes, and longest text after decoding.
///
/// The largest public files have about 10 MB. The limits of the element tree follow from it, so that a reader stays below
/// 100 MiB.
pub const MOST_BYTES: usize = 24 << 20;

/// Code points of Windows-1252 for the bytes 0x80 to 0x9F, in which ISO 8859-1 has control characters only. Files that
/// declare ISO 8859-1 use them, as web pages do (WHATWG Encoding, 4.2).
const WINDOWS_1252: [char; 32] = [
    '\u{20AC}', '\u{81}', '\u{201A}', '\u{192}', '\u{201E}', '\u{2026}', '\u{2020}', '\u{2021}', '\u{2C6}',
    '\u{2030}', '\u{160}', '\u{2039}', '\u{152}', '\u{8D}', '\u{17D}', '\u{8F}', '\u{90}', '\u{2018}',
    '\u{2019}', '\u{201C}', '\u{201D}', '\u{2022}', '\u{2013}', '\u{2014}', '\u{2DC}', '\u{2122}', '\u{161}',
    '\u{203A}', '\u{153}', '\u{9D}', '\u{17E}', '\u{178}',
];

/// Decodes a file. An XML file says its encoding in the first line; a text without it is UTF-8, or else Latin-1.
pub(crate) fn decode(bytes: Vec<u8>) -> Result<String, FileFault> {
    if bytes.len() > MOST_BYTES {
        let fault = format!("{} bytes; at most {MOST_BYTES} are read", bytes.len());
        return Err(FileFault::of_file(fault));
    }
    match bytes.get(..2) {
        Some([0xFF, 0xFE]) => return utf_16(bytes.get(2..).unwrap_or_default(), u16::from_le_bytes),
        Some([0xFE, 0xFF]) => return utf_16(bytes.get(2..).unwrap_or_default(), u16::from_be_bytes),
        Some(b"<\0") => return utf_16(&bytes, u16::from_le_bytes),
        Some(b"\0<") => return utf_16(&bytes, u16::from_be_bytes),
        _ => {}
    }
    if bytes.starts_with(b"\xEF\xBB\xBF") {
        let bytes = bytes.get(3..).unwrap_or_default().to_vec();
        return String::from_utf8(bytes).map_err(|error| not_utf_8(error.as_bytes(), error.utf8_error()));
    }
    match declared(&bytes).as_deref() {
        Some("utf-8" | "utf8" | "us-ascii" | "ascii") => {
            String::from_utf8(bytes).map_err(|error| not_utf_8(error.as_bytes(), error.utf8_error()))
        }
        Some(
            "iso-8859-1" | "iso8859-1" | "iso_8859-1" | "latin1" | "latin-1" | "windows-1252" | "cp1252",
        ) => latin_1(&bytes),
        Some(name) => {
            let fault = format!("encoding `{}` is not supported; save it as UTF-8", excerpt(name));
            Err(FileFault::new(1, "xml", fault))
        }
        // XML without a declaration is UTF-8 (XML 1.0, 4.3.3).
        None if bytes.trim_ascii_start().starts_with(b"<") => {
            String::from_utf8(bytes).map_err(|error| not_utf_8(error.as_bytes(), error.utf8_error()))
        }
        None => String::from_utf8(bytes).or_else(|error| latin_1(error.as_bytes())),
    }
}

/// Returns the encoding of an XML declaration, in lower case.
fn declared(bytes: &[u8]) -> Option<String> {
    // A declaration of the three possible attributes is far shorter.
    const LONGEST_DECLARATION: usize = 256;
    let head = bytes.get(..LONGEST_DECLARATION.min(bytes.len()))?;
    let head: String = head.iter().map(|byte| char::from(*byte)).collect();
    let declaration = head.trim_start().strip_prefix("<?xml")?.split("?>").next()?.to_owned();
    let value = declaration.split_once("encoding")?.1.trim_start().strip_prefix('=')?.trim_start();
    let quote = value.chars().next().filter(|it| matches!(it, '"' | '\''))?;
    value.get(1..)?.split(quote).next().map(str::to_ascii_lowercase)
}

fn not_utf_8(bytes: &[u8], error: std::str::Utf8Error) -> FileFault {
    let valid = bytes.get(..error.valid_up_to()).unwrap_or_default();
    let line = 1 + valid.iter().filter(|byte| **byte == b'\n').count();
    let found = bytes.get(error.valid_up_to()).copied().unwrap_or_default();
    FileFault::new(line, "text", format!("byte 0x{found:02X} is not UTF-8; save the file as UTF-8"))
}

fn utf_16(bytes: &[u8], unit: fn([u8; 2]) -> u16) -> Result<String, FileFault> {
    let (pairs, rest) = bytes.as_chunks::<2>();
    let mut text = String::with_capacity(pairs.len());
    for decoded in char::decode_utf16(pairs.iter().map(|pair| unit(*pair))) {
        match decoded {
            Ok(character) if text.len() < MOST_BYTES => text.push(character),
            Ok(_) => return Err(too_long()),
            Err(error) => {
                let line = 1 + text.matches('\n').count();
                let unit = error.unpaired_surrogate();
                let fault = format!("unit 0x{unit:04X} is half of a UTF-16 pair; save the file as UTF-8");
                return Err(FileFault::new(line, "text", fault));
            }
        }
    }
    if !rest.is_empty() {
        return Err(FileFault::of_file("UTF-16 with an odd number of bytes; the file is cut"));
    }
    Ok(text)
}

fn latin_1(bytes: &[u8]) -> Result<String, FileFault> {
    let mut text = String::with_capacity(bytes.len());
    for byte in bytes {
        if text.len() >= MOST_BYTES {
            return Err(too_long());
        }
        text.push(match byte {
            0x80..=0x9F => WINDOWS_1252.get(usize::from(byte - 0x80)).copied().unwrap_or('\u{FFFD}'),
            byte => char::from(*byte),
        });
    }
    Ok(text)
}

fn too_long() -> FileFault {
    FileFault::of_file(format!("more than {MOST_BYTES} bytes as UTF-8; split the file"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_encoding_of_the_standards_gives_the_same_text() {
        let text = "<?xml version=\"1.0\" encoding=\"utf-16\"?>\n<A n=\"Größe\"/>";
        let units: Vec<u16> = text.encode_utf16().collect();
        let big: Vec<u8> = units.iter().flat_map(|unit| unit.to_be_bytes()).collect();
        let little: Vec<u8> = units.iter().flat_map(|unit| unit.to_le_bytes()).collect();
        assert_eq!(decode(big.clone()).as_deref(), Ok(text));
        assert_eq!(decode(little.clone()).as_deref(), Ok(text));
        assert_eq!(decode([&[0xFE, 0xFF][..], &big].concat()).as_deref(), Ok(text));
        assert_eq!(decode([&[0xFF, 0xFE][..], &little].concat()).as_deref(), Ok(text));
        assert_eq!(decode([&[0xEF, 0xBB, 0xBF][..], text.as_bytes()].concat()).as_deref(), Ok(text));
        let latin = b"<?xml version='1.0' encoding='ISO-8859-1'?><A n='Gr\xF6\xDFe 5 \x80'/>".to_vec();
        assert!(decode(latin).unwrap().contains("Größe 5 €"));
        assert_eq!(decode(b"$ Gr\xF6\xDFe".to_vec()).as_deref(), Ok("$ Größe"));
        assert_eq!(decode("$ Größe".into()).as_deref(), Ok("$ Größe"));
    }

    #[test]
    fn an_encoding_that_does_not_hold_is_refused_with_its_line() {
        let wrong = b"<?xml version=\"1.0\" encoding=\"utf-8\"?>\n<A>\n\xE4</A>".to_vec();
        let said = decode(wrong).unwrap_err().to_string();
        assert_eq!(said, "3: text: byte 0xE4 is not UTF-8; save the file as UTF-8");
        let other = b"<?xml version=\"1.0\" encoding=\"shift_jis\"?><A/>".to_vec();
        let said = decode(other).unwrap_err().to_string();
        assert_eq!(said, "1: xml: encoding `shift_jis` is not supported; save it as UTF-8");
        assert_eq!(decode(b"<\0A".to_vec()).unwrap_err().line, 0);
        assert_eq!(decode(b"<\0\x00\xD8A\0".to_vec()).unwrap_err().line, 1);
        assert!(decode(vec![b' '; MOST_BYTES + 1]).is_err());
        assert!(decode(vec![0xE4; MOST_BYTES]).is_err());
    }
}
