//! Connection paths of an EDS, such as `20 04 24 97 2C 96 2C 64` (CIP volume 1, C-1.4).

use crate::eds::{EdsParameter, EdsReference};
use crate::fault::excerpt;

/// Connection points that a path names.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct ConnectionPoints {
    /// Configuration assembly; none if the path leaves it out.
    pub(super) configuration: Option<u32>,
    /// Assembly of the data to the device.
    pub(super) consumed: u32,
    /// Assembly of the data from the device.
    pub(super) produced: u32,
}

/// Class of assemblies (CIP volume 1, 5-5).
const ASSEMBLY: u32 = 4;

/// Logical segments of a path that name more than a point would need.
const MOST_SEGMENTS: usize = 16;

/// Parses a path into its points.
///
/// # Errors
///
/// What is not understood in it.
pub(super) fn points(path: &str, parameters: &[EdsParameter]) -> Result<ConnectionPoints, String> {
    let bytes = bytes(path, parameters)?;
    let mut rest = bytes.as_slice();
    let (mut class, mut instance, mut points) = (None, None, Vec::new());
    while let Some((segment, after)) = rest.split_first() {
        if points.len() > MOST_SEGMENTS {
            return Err("more segments than a connection needs".to_owned());
        }
        // Logical segments: 8-bit value, or a pad byte and a 16-bit one.
        let (value, after) = match (segment & 0x03, after) {
            (0, [value, after @ ..]) => (u32::from(*value), after),
            (1, [_, low, high, after @ ..]) => (u32::from(u16::from_le_bytes([*low, *high])), after),
            _ => return Err(format!("segment 0x{segment:02X} is cut")),
        };
        match segment & 0xFC {
            0x20 => class = Some(value),
            0x24 => instance = Some(value),
            0x2C => points.push(value),
            // The electronic key: its format, and eight bytes.
            0x34 if after.len() >= 8 => {
                rest = after.get(8..).unwrap_or_default();
                continue;
            }
            _ => {
                return Err(format!(
                    "segment 0x{segment:02X}: only class, instance and connection points are known"
                ));
            }
        }
        rest = after;
    }
    if class != Some(ASSEMBLY) {
        return Err("the path does not name the class of assemblies".to_owned());
    }
    match (instance, points.as_slice()) {
        (configuration, [consumed, produced]) => {
            Ok(ConnectionPoints { configuration, consumed: *consumed, produced: *produced })
        }
        (Some(consumed), [produced]) => {
            Ok(ConnectionPoints { configuration: None, consumed, produced: *produced })
        }
        _ => Err(format!("{} connection points: expected two", points.len())),
    }
}

/// Returns the bytes of a path, with the defaults of parameters that it names.
fn bytes(path: &str, parameters: &[EdsParameter]) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    for word in path.split_whitespace() {
        let word = word.trim_matches(['[', ']']);
        if let Some(EdsReference::Parameter(number)) = EdsReference::parse(word) {
            let parameter = parameters.iter().find(|parameter| parameter.number == number);
            let default = parameter.and_then(EdsParameter::default_number);
            let byte = default.and_then(|value| u8::try_from(value).ok());
            bytes.push(byte.ok_or_else(|| format!("`{}` has no default of one byte", excerpt(word)))?);
            continue;
        }
        let byte = u8::from_str_radix(word, 16);
        bytes.push(byte.map_err(|_| format!("`{}` is not a byte", excerpt(word)))?);
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(path: &str) -> Result<(Option<u32>, u32, u32), String> {
        points(path, &[]).map(|points| (points.configuration, points.consumed, points.produced))
    }

    #[test]
    fn paths_of_each_form_name_their_points() {
        assert_eq!(found("20 04 24 97 2C 96 2C 64"), Ok((Some(0x97), 0x96, 0x64)));
        assert_eq!(found("20 04 2C 96 2C 64"), Ok((None, 0x96, 0x64)));
        assert_eq!(found("20 04 24 96 2C 64"), Ok((None, 0x96, 0x64)));
        assert_eq!(found("21 00 04 00 25 00 2C 01 2D 00 2D 01 2D 00 2E 01"), Ok((Some(0x12C), 0x12D, 0x12E)));
        assert_eq!(
            found("34 04 01 00 02 00 03 00 01 01 20 04 24 97 2C 96 2C 64"),
            Ok((Some(0x97), 0x96, 0x64))
        );
    }

    #[test]
    fn a_path_that_names_no_two_points_is_refused() {
        for path in
            ["", "20 04", "20 06 24 01", "20 04 24 97 2C", "2D", "zz", "Param9", "91 02 41 42", "34 04 01"]
        {
            assert!(found(path).is_err(), "{path}");
        }
    }
}
