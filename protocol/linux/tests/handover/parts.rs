//! Parts of the handover whose every access is seen by loom.

pub(crate) use loom::sync::Arc;
pub(crate) use loom::sync::atomic::{AtomicU8, AtomicU64, Ordering};

use loom::cell::UnsafeCell;
use loom::sync::atomic::{AtomicBool, AtomicUsize};
use loom::sync::{Condvar, Mutex};

/// A ring with the orders of accesses of `rtrb`: an item is published with the index behind it, and so is a free place; the end
/// is published with all that came before it.
#[derive(Debug)]
struct Ring<T> {
    places: Box<[UnsafeCell<Option<T>>]>,
    /// Number of the next item to take.
    head: AtomicUsize,
    /// Number of the next item to put in.
    tail: AtomicUsize,
    is_abandoned: AtomicBool,
}

// SAFETY: a place is accessed only by the thread that the indices give it to; loom fails where that does not hold.
unsafe impl<T: Send> Sync for Ring<T> {}
// SAFETY: as above.
unsafe impl<T: Send> Send for Ring<T> {}

impl<T> Ring<T> {
    /// Swaps what is at the place of an item of this number.
    fn swap(&self, number: usize, item: Option<T>) -> Option<T> {
        let place = &self.places[number % self.places.len()];
        place.with_mut(|place| {
            // SAFETY: loom has checked that no other thread accesses the place meanwhile; the pointer is valid in here.
            unsafe { std::mem::replace(&mut *place, item) }
        })
    }
}

pub(crate) fn ring_buffer<T>(capacity: usize) -> (Producer<T>, Consumer<T>) {
    let ring = Arc::new(Ring {
        places: (0..capacity).map(|_| UnsafeCell::new(None)).collect(),
        head: AtomicUsize::new(0),
        tail: AtomicUsize::new(0),
        is_abandoned: AtomicBool::new(false),
    });
    (Producer { ring: Arc::clone(&ring), tail: 0 }, Consumer { ring, head: 0 })
}

#[derive(Debug)]
pub(crate) struct Producer<T> {
    ring: Arc<Ring<T>>,
    tail: usize,
}

impl<T> Producer<T> {
    pub(crate) fn push(&mut self, item: T) -> Result<(), T> {
        if self.tail - self.ring.head.load(Ordering::Acquire) == self.ring.places.len() {
            return Err(item);
        }
        self.ring.swap(self.tail, Some(item));
        self.tail += 1;
        self.ring.tail.store(self.tail, Ordering::Release);
        Ok(())
    }
}

impl<T> Drop for Producer<T> {
    fn drop(&mut self) {
        self.ring.is_abandoned.store(true, Ordering::Release);
    }
}

#[derive(Debug)]
pub(crate) struct Consumer<T> {
    ring: Arc<Ring<T>>,
    head: usize,
}

impl<T> Consumer<T> {
    pub(crate) fn pop(&mut self) -> Result<T, ()> {
        if self.is_empty() {
            return Err(());
        }
        let item = self.ring.swap(self.head, None);
        self.head += 1;
        self.ring.head.store(self.head, Ordering::Release);
        item.ok_or(())
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.head == self.ring.tail.load(Ordering::Acquire)
    }

    pub(crate) fn is_abandoned(&self) -> bool {
        self.ring.is_abandoned.load(Ordering::Acquire)
    }
}

/// A notifier as the kernel's: notices are kept until they are cleared.
#[derive(Clone, Debug)]
pub(crate) struct Notifier(Arc<(Mutex<bool>, Condvar)>);

impl Notifier {
    pub(crate) fn new() -> Self {
        Self(Arc::new((Mutex::new(false), Condvar::new())))
    }

    pub(crate) fn notify(&self) {
        let (is_notified, wakes) = &*self.0;
        *is_notified.lock().unwrap() = true;
        wakes.notify_all();
    }

    pub(crate) fn clear(&self) {
        *self.0.0.lock().unwrap() = false;
    }

    /// Sleeps until there is a notice.
    pub(crate) fn wait(&self) {
        let (is_notified, wakes) = &*self.0;
        let mut notified = is_notified.lock().unwrap();
        while !*notified {
            notified = wakes.wait(notified).unwrap();
        }
    }
}
