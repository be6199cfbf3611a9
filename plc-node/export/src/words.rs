//! A motion as eleven words, each with its four bytes as they are on a big-endian bus.

use protocol::image::{Command, IMAGE_LEN, Motion, Order};

/// Words of a motion.
pub(crate) const WORDS: usize = 11;

/// Where the first slot is in a command.
const FIRST_SLOT: usize = 36;

/// Returns the words of a motion.
pub(crate) fn words(motion: &Motion) -> [u32; WORDS] {
    let mut command = Command::default();
    command.set_slot(0, *motion);
    let mut image = [0; IMAGE_LEN];
    Order::BigEndian.emit_command(&command, &mut image);
    let mut words = [0; WORDS];
    let (chunks, _) = image.get(FIRST_SLOT..).unwrap_or_default().as_chunks::<4>();
    for (word, bytes) in words.iter_mut().zip(chunks) {
        *word = u32::from_be_bytes(*bytes);
    }
    words
}
