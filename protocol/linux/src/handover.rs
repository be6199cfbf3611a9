//! What threads hand each other without a lock: items over a wait-free ring, and the request to end.
//!
//! The order of the accesses in this file decides whether the last items arrive and whether their reader learns of the end.
//! `tests/handover` builds this file with the atomics of `loom`, which tries every order that the memory model allows.

use super::parts::{Arc, AtomicU8, AtomicU64, Consumer, Notifier, Ordering, Producer, ring_buffer};

/// Creates a ring for `capacity` items and returns its two ends, one for each thread.
#[must_use]
pub fn ring<T>(capacity: usize) -> (Sender<T>, Receiver<T>) {
    let (producer, consumer) = ring_buffer(capacity);
    let dropped = Arc::new(AtomicU64::new(0));
    (Sender { ring: producer, dropped: Arc::clone(&dropped) }, Receiver { ring: consumer, dropped })
}

/// The end of a ring that items go into. Dropping it ends the ring.
#[derive(Debug)]
pub struct Sender<T> {
    ring: Producer<T>,
    dropped: Arc<AtomicU64>,
}

/// The ring is full.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Full;

impl<T> Sender<T> {
    /// Sends an item. If the ring is full, the item is dropped and counted.
    pub fn send(&mut self, item: T) -> Result<(), Full> {
        self.ring.push(item).map_err(|_| {
            self.dropped.fetch_add(1, Ordering::Relaxed);
            Full
        })
    }
}

/// The end of a ring that items come out of.
#[derive(Debug)]
pub struct Receiver<T> {
    ring: Consumer<T>,
    dropped: Arc<AtomicU64>,
}

/// What a ring has for its receiver.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Received<T> {
    /// The next item.
    Item(T),
    /// No item so far.
    Nothing,
    /// No item, and none follows: the sender is gone.
    Ended,
}

impl<T> Receiver<T> {
    /// Takes the next item.
    pub fn take(&mut self) -> Received<T> {
        // Read before the ring: what was sent before the end is in the ring then.
        let is_last = self.ring.is_abandoned();
        match self.ring.pop() {
            Ok(item) => Received::Item(item),
            Err(_) if is_last => Received::Ended,
            Err(_) => Received::Nothing,
        }
    }

    /// Returns whether there is no item to take.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.ring.is_empty()
    }

    /// Returns how many items were dropped so far because the ring was full; all of them once
    /// [`take`](Self::take) returned [`Received::Ended`].
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.dropped.load(Ordering::Relaxed)
    }
}

/// Sends the notices of a thread to another thread, which sleeps until it is notified.
#[derive(Debug)]
pub struct NoticeSender<N> {
    // Dropped in this order: the reader is notified when it can see the ring's end, also after a panic.
    ring: Sender<N>,
    reader: NotifyAtEnd,
}

impl<N> NoticeSender<N> {
    /// Creates a sender that notifies `reader` of each notice and of its own end.
    pub(crate) fn new(ring: Sender<N>, reader: Notifier) -> Self {
        Self { ring, reader: NotifyAtEnd(reader) }
    }

    /// Sends a notice to the other thread. If the ring is full, the notice is dropped and counted.
    pub fn send(&mut self, notice: N) {
        let _ = self.ring.send(notice);
        self.reader.0.notify();
    }
}

#[derive(Debug)]
struct NotifyAtEnd(Notifier);

impl Drop for NotifyAtEnd {
    fn drop(&mut self) {
        self.0.notify();
    }
}

/// What becomes of a recording that ends.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Ending {
    /// All that was recorded is kept.
    Keep,
    /// What is not yet in a file is thrown away.
    Discard,
}

/// The request to another thread to end.
#[derive(Debug, Default)]
pub(crate) struct EndRequest(AtomicU8);

impl EndRequest {
    const KEEP: u8 = 1;
    const DISCARD: u8 = 2;

    /// Asks the other thread to end. Who sees the request sees all that this thread saw before.
    pub(crate) fn set(&self, ending: Ending) {
        let value = match ending {
            Ending::Keep => Self::KEEP,
            Ending::Discard => Self::DISCARD,
        };
        self.0.store(value, Ordering::Release);
    }

    /// Returns the request, if there is one.
    pub(crate) fn get(&self) -> Option<Ending> {
        match self.0.load(Ordering::Acquire) {
            Self::KEEP => Some(Ending::Keep),
            Self::DISCARD => Some(Ending::Discard),
            _ => None,
        }
    }
}
