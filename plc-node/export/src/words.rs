//! A motion as eleven words, each with its four bytes as they are on a big-endian bus.

use machine::wire::{BigEndian, Writer};
use protocol::image::{MOTION_LEN, Motion};

/// Words of a motion.
pub(crate) const WORDS: usize = MOTION_LEN / 4;

/// Returns the words of a motion.
pub(crate) fn words(motion: &Motion) -> [u32; WORDS] {
    let mut bytes = [0; MOTION_LEN];
    motion.emit(&mut Writer::<BigEndian>::new(&mut bytes));
    let mut words = [0; WORDS];
    let (chunks, _) = bytes.as_chunks::<4>();
    for (word, bytes) in words.iter_mut().zip(chunks) {
        *word = u32::from_be_bytes(*bytes);
    }
    words
}
