//! What [`handover`](crate::handover) is made of. Its tests have parts of their own with these names.

pub(crate) use std::sync::Arc;
pub(crate) use std::sync::atomic::{AtomicU8, AtomicU64, Ordering};

pub(crate) use rtrb::{Consumer, Producer};

pub(crate) use crate::Notifier;

pub(crate) fn ring_buffer<T>(capacity: usize) -> (Producer<T>, Consumer<T>) {
    rtrb::RingBuffer::new(capacity)
}
