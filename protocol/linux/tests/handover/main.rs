//! What threads hand each other, in every order of their accesses that the memory model allows.
//!
//! [`handover`] is the program's own file, built here with parts of `loom`. Only two parts are stand-ins: the ring of the crate
//! `rtrb`, with the orders of accesses that it documents, and the notifier, which is a file of the kernel.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(unsafe_code, reason = "a ring keeps its items in cells; loom checks each access to them")]

#[path = "../../src/handover.rs"]
pub mod handover;
mod parts;

use handover::{EndRequest, Ending, Full, NoticeSender, Received, Receiver, ring};
use loom::sync::Arc;
use loom::sync::atomic::{AtomicU64, Ordering};
use loom::thread;
use parts::Notifier;

/// Tries every order of accesses in which threads interrupt each other at most three times.
fn in_every_order(body: impl Fn() + Sync + Send + 'static) {
    let mut model = loom::model::Builder::new();
    model.preemption_bound = Some(3);
    model.max_branches = 10_000;
    model.check(body);
}

/// Takes all items until the end, as the threads that write traces and captures do.
fn take_all<T>(receiver: &mut Receiver<T>) -> Vec<T> {
    let mut items = Vec::new();
    loop {
        match receiver.take() {
            Received::Item(item) => items.push(item),
            Received::Nothing => thread::yield_now(),
            Received::Ended => return items,
        }
    }
}

#[test]
fn each_item_is_either_received_once_in_order_or_counted_as_dropped() {
    for capacity in [1, 2] {
        in_every_order(move || {
            let (mut sender, mut receiver) = ring(capacity);
            let sending = thread::spawn(move || {
                (0..3_u64).filter(|item| sender.send(*item).is_ok()).collect::<Vec<_>>()
            });
            let received = take_all(&mut receiver);
            // Before the thread is joined: the end of the ring alone must make the count visible.
            assert_eq!(received.len() as u64 + receiver.dropped(), 3, "{received:?}");
            assert_eq!(received, sending.join().unwrap());
        });
    }
}

#[test]
fn a_sender_whose_writer_ended_first_fills_the_ring_and_then_counts() {
    in_every_order(|| {
        let (mut sender, mut receiver) = ring(1);
        let item = || Arc::new(());
        sender.send(item()).unwrap();
        let writing = thread::spawn(move || receiver.take());
        let results = [sender.send(item()), sender.send(item())];
        // Whether the first of them found a place depends on whether the writer was faster.
        assert_ne!(results, [Ok(()), Ok(())]);
        assert!(matches!(writing.join().unwrap(), Received::Item(_)));
        assert!(sender.send(item()).is_ok() || results.contains(&Ok(())));
        assert_eq!(sender.send(item()), Err(Full));
        // loom finds items that are not dropped with their ring.
    });
}

/// Takes items until `is_enough`, and sleeps while there are none, as a node does. Who is not notified after a look at an
/// empty ring sleeps for ever, which loom reports.
fn take_asleep<T>(
    receiver: &mut Receiver<T>,
    reader: &Notifier,
    is_enough: impl Fn(&[T], &Received<()>) -> bool,
) -> Vec<T> {
    let mut items = Vec::new();
    loop {
        let taken = match receiver.take() {
            Received::Item(item) => {
                items.push(item);
                Received::Item(())
            }
            Received::Nothing => Received::Nothing,
            Received::Ended => Received::Ended,
        };
        if is_enough(&items, &taken) {
            return items;
        }
        if taken == Received::Nothing {
            reader.wait();
            reader.clear();
        }
    }
}

#[test]
fn a_reader_that_sleeps_while_there_is_no_notice_receives_all_notices() {
    in_every_order(|| {
        let (sender, mut receiver) = ring(2);
        let reader = Notifier::new();
        let mut notices = NoticeSender::new(sender, reader.clone());
        let sending = thread::spawn(move || {
            notices.send(1);
            notices.send(2);
            // It stays: its end would notify as well.
            notices
        });
        let received = take_asleep(&mut receiver, &reader, |received, _| received.len() == 2);
        assert_eq!(received, [1, 2]);
        drop(sending.join().unwrap());
    });
}

#[test]
fn a_reader_that_sleeps_while_there_is_no_notice_learns_of_the_end_after_the_last() {
    in_every_order(|| {
        let (sender, mut receiver) = ring(2);
        let reader = Notifier::new();
        let mut notices = NoticeSender::new(sender, reader.clone());
        let sending = thread::spawn(move || notices.send(1));
        let received = take_asleep(&mut receiver, &reader, |_, taken| *taken == Received::Ended);
        assert_eq!(received, [1]);
        sending.join().unwrap();
    });
}

#[test]
fn a_cyclic_thread_that_takes_one_command_a_wake_gets_every_command() {
    in_every_order(|| {
        let (mut commands, mut ring) = ring(2);
        let waker = Notifier::new();
        let notifier = waker.clone();
        let cyclic = thread::spawn(move || {
            let mut taken = Vec::new();
            while taken.len() < 2 {
                if let Received::Item(command) = ring.take() {
                    taken.push(command);
                }
                // The owner's deadline: while a command waits, the thread does not sleep.
                if taken.len() < 2 && ring.is_empty() {
                    notifier.wait();
                }
                notifier.clear();
            }
            taken
        });
        for command in [1, 2] {
            commands.send(command).unwrap();
            waker.notify();
        }
        assert_eq!(cyclic.join().unwrap(), [1, 2]);
    });
}

#[test]
fn a_request_to_end_between_the_look_for_it_and_the_sleep_wakes_the_thread() {
    in_every_order(|| {
        let (end, waker) = (Arc::new(EndRequest::default()), Notifier::new());
        let (seen, notifier) = (Arc::clone(&end), waker.clone());
        let cable = thread::spawn(move || {
            while seen.get().is_none() {
                notifier.wait();
                notifier.clear();
            }
        });
        // A notice for another reason must not use up that of the end.
        waker.notify();
        end.set(Ending::Keep);
        waker.notify();
        cable.join().unwrap();
    });
}

#[test]
fn who_sees_the_request_to_end_sees_all_that_happened_before_it() {
    in_every_order(|| {
        let (end, frames) = (Arc::new(EndRequest::default()), Arc::new(AtomicU64::new(0)));
        let (seen, passed) = (Arc::clone(&end), Arc::clone(&frames));
        let recorder = thread::spawn(move || {
            // Read before the frames, as the recorder does.
            seen.get().map(|ending| (ending, passed.load(Ordering::Relaxed)))
        });
        frames.store(1, Ordering::Relaxed);
        end.set(Ending::Keep);
        let found = recorder.join().unwrap();
        assert!(matches!(found, None | Some((Ending::Keep, 1))), "{found:?}");
    });
}

#[test]
fn a_writer_that_finds_the_end_of_its_ring_knows_whether_its_captures_are_wanted() {
    for ending in [Ending::Keep, Ending::Discard] {
        in_every_order(move || {
            let end = Arc::new(EndRequest::default());
            let (mut sender, mut receiver) = ring(2);
            let of_cable = Arc::clone(&end);
            let cable = thread::spawn(move || {
                while of_cable.get().is_none() {
                    thread::yield_now();
                }
                sender.send(()).unwrap();
            });
            let of_writer = Arc::clone(&end);
            let writer = thread::spawn(move || (take_all(&mut receiver).len(), of_writer.get()));
            end.set(ending);
            cable.join().unwrap();
            assert_eq!(writer.join().unwrap(), (1, Some(ending)));
        });
    }
}

#[test]
fn the_ring_of_the_model_takes_and_gives_as_the_library_s_does() {
    for capacity in [1, 2, 5] {
        in_every_order(move || {
            let (mut model, mut from_model) = ring(capacity);
            let (mut library, mut from_library) = protocol_linux::handover::ring(capacity);
            // Turns of different lengths, so that the rings become full, become empty and wrap.
            for turn in 0..20_u64 {
                for item in 0..turn * 7 % 5 {
                    let results = (model.send(item), library.send(item));
                    assert_eq!(results.0.is_ok(), results.1.is_ok());
                }
                for _ in 0..turn * 3 % 4 {
                    assert_eq!(from_model.is_empty(), from_library.is_empty());
                    assert_eq!(format!("{:?}", from_model.take()), format!("{:?}", from_library.take()));
                }
            }
            drop((model, library));
            assert_eq!(from_model.dropped(), from_library.dropped());
            for _ in 0..=capacity {
                assert_eq!(format!("{:?}", from_model.take()), format!("{:?}", from_library.take()));
            }
        });
    }
}
