//! Lets a machine and its future share a value: while the machine polls the future, the value is in a thread-local place.
//!
//! Neither needs a lock or a pointer to the other, and the machine can move to another thread between two polls.

use std::cell::RefCell;
use std::mem::swap;
use std::thread::LocalKey;

/// The thread-local place of the shared value.
pub(crate) type Place<T> = LocalKey<RefCell<T>>;

/// Runs `poll` while `value` is in its place. The value comes back even if `poll` panics.
pub(crate) fn lend<T, R>(place: &'static Place<T>, value: &mut T, poll: impl FnOnce() -> R) -> R {
    place.with_borrow_mut(|place| swap(place, value));
    let _lent = Lent { place, value };
    poll()
}

struct Lent<'a, T: 'static> {
    place: &'static Place<T>,
    value: &'a mut T,
}

impl<T> Drop for Lent<'_, T> {
    fn drop(&mut self) {
        self.place.with_borrow_mut(|place| swap(place, self.value));
    }
}
