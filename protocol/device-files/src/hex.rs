//! Bytes as hexadecimal digits in JSON.

use serde::Serializer;

/// Serializes bytes as digits such as `08ff`.
pub(crate) fn serialize<S: Serializer>(bytes: &[u8], serializer: S) -> Result<S::Ok, S::Error> {
    let digits: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
    serializer.serialize_str(&digits)
}
