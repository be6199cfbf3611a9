//! No bytes make a reader panic.

use device_files::read;
use proptest::prelude::*;

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2_000))]

    #[test]
    fn no_bytes_make_a_reader_panic(bytes in proptest::collection::vec(any::<u8>(), 0..512)) {
        let _ = read("a", bytes);
    }

    /// Our own files with bytes exchanged, cut, doubled: most of it still has the form of a file.
    #[test]
    fn no_altered_file_makes_a_reader_panic(
        which in 0..3_usize,
        edits in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>(), 0..4_u8), 1..12),
    ) {
        let [eds, gsdml, esi] = devices::files();
        let mut bytes = [eds, gsdml, esi][which].1.clone().into_bytes();
        for (at, byte, kind) in edits {
            let at = at.index(bytes.len());
            match kind {
                0 => bytes[at] = byte,
                1 => bytes[at] = b"\"<>=&;,$[]#x09-"[usize::from(byte) % 15],
                2 => bytes.truncate(at.max(1)),
                _ => {
                    let end = (at + usize::from(byte)).min(bytes.len());
                    let copy = bytes[at..end].to_vec();
                    bytes.splice(at..at, copy);
                }
            }
        }
        if let Ok(file) = read("a", bytes) {
            prop_assert!(serde_json::to_string(&file).is_ok());
        }
    }
}
