//! Proof that the cyclic path allocates nothing: an allocator that counts the allocations of one thread.
//!
//! The program declares it, `#[global_allocator] static ALLOCATOR: AllocationCounter = AllocationCounter;`, and the
//! thread to be checked calls [`arm`]. The allocator counts and does not abort: an allocation too many is a finding
//! for the report, not a reason to stop a robot arm.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

thread_local! {
    static ARMED: Cell<bool> = const { Cell::new(false) };
    static COUNT: Cell<u64> = const { Cell::new(0) };
    static INSTALLED: Cell<bool> = const { Cell::new(false) };
}

/// The system's allocator with a count of each armed thread's allocations.
#[derive(Debug)]
pub struct AllocationCounter;

impl AllocationCounter {
    fn count() {
        // A thread that is ending has no counter any more; its count is not needed.
        let _ = ARMED.try_with(|armed| {
            if armed.get() {
                let _ = COUNT.try_with(|count| count.set(count.get() + 1));
            }
        });
    }
}

// SAFETY: every request goes to the system's allocator unchanged; the counters are plain cells of this thread,
// initialised at compile time, so that touching them allocates nothing.
unsafe impl GlobalAlloc for AllocationCounter {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        Self::count();
        // SAFETY: the caller's promise is passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        Self::count();
        // SAFETY: the caller's promise is passed on.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, new_size: usize) -> *mut u8 {
        Self::count();
        // SAFETY: the caller's promise is passed on.
        unsafe { System.realloc(pointer, layout, new_size) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller's promise is passed on.
        unsafe { System.dealloc(pointer, layout) }
    }
}

/// Starts to count this thread's allocations, from 0.
///
/// Returns false if the program's allocator is not [`AllocationCounter`]: a count of 0 means nothing then.
pub fn arm() -> bool {
    ARMED.set(true);
    COUNT.set(0);
    drop(std::hint::black_box(Box::new(0_u64)));
    INSTALLED.set(count() > 0);
    COUNT.set(0);
    INSTALLED.get()
}

/// Returns whether this thread's allocations are counted.
#[must_use]
pub fn is_armed() -> bool {
    INSTALLED.get() && ARMED.get()
}

/// Stops counting.
pub fn disarm() {
    ARMED.set(false);
}

/// Returns this thread's allocations since [`arm`].
#[must_use]
pub fn count() -> u64 {
    COUNT.get()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[global_allocator]
    static ALLOCATOR: AllocationCounter = AllocationCounter;

    #[test]
    fn only_the_armed_thread_is_counted_and_only_while_it_is_armed() {
        let before = Vec::<u8>::with_capacity(10);
        assert!(arm());
        let mut grown = std::hint::black_box(Vec::<u8>::with_capacity(10));
        grown.reserve(1_000);
        let here = count();
        std::thread::scope(|scope| {
            scope.spawn(|| drop(std::hint::black_box(vec![0; 100])));
        });
        disarm();
        assert_eq!(here, 2);
        let after = count();
        drop(std::hint::black_box((before, vec![1, 2, 3])));
        assert_eq!(count(), after);
    }
}
