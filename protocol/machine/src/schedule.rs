//! Whose turn it is among the connections of one machine, so that none of its calls walks over all of them.

use alloc::collections::VecDeque;
use alloc::vec::Vec;

use crate::Instant;

/// Mark of a task without a deadline.
const NONE: u32 = u32::MAX;

/// The deadlines of numbered tasks: a heap that knows the place of each task.
#[derive(Clone, Default, Debug)]
pub struct Deadlines {
    /// A binary heap. Equal deadlines have no order, so that those of one cycle cost the same however many they are.
    heap: Vec<(Instant, u16)>,
    /// Place in the heap for each number, or [`NONE`].
    places: Vec<u32>,
}

impl Deadlines {
    /// Creates a set without deadlines.
    #[must_use]
    pub const fn new() -> Self {
        Self { heap: Vec::new(), places: Vec::new() }
    }

    /// Sets or removes the deadline of a task. Allocates only for a number higher than all before.
    #[inline]
    pub fn set(&mut self, task: u16, deadline: Option<Instant>) {
        let place = self.places.get(usize::from(task)).map_or(NONE, |place| *place) as usize;
        let before = self.heap.get(place).map(|(at, _)| *at);
        if before != deadline {
            self.change(task, place, before, deadline);
        }
    }

    fn change(&mut self, task: u16, place: usize, before: Option<Instant>, deadline: Option<Instant>) {
        if usize::from(task) >= self.places.len() {
            let len = usize::from(task) + 1;
            self.places.resize(len, NONE);
            self.heap.reserve(len.saturating_sub(self.heap.len()));
        }
        match (before, deadline) {
            (None, None) => {}
            (None, Some(at)) => {
                self.heap.push((at, task));
                self.rise(self.heap.len() - 1, (at, task));
            }
            (Some(before), Some(at)) if at < before => self.rise(place, (at, task)),
            (Some(_), Some(at)) => self.sink(place, (at, task)),
            (Some(_), None) => self.remove(place, task),
        }
    }

    /// Returns the first deadline.
    #[inline]
    #[must_use]
    pub fn first(&self) -> Option<Instant> {
        self.heap.first().map(|(at, _)| *at)
    }

    /// Removes a first deadline that has passed at `now` and returns its task; of equal deadlines, any.
    #[inline]
    pub fn take_due(&mut self, now: Instant) -> Option<u16> {
        let (at, task) = *self.heap.first()?;
        if at > now {
            return None;
        }
        self.remove(0, task);
        Some(task)
    }

    /// Returns all tasks with their deadlines, in no particular order.
    pub fn iter(&self) -> impl Iterator<Item = (u16, Instant)> {
        self.heap.iter().map(|(at, task)| (*task, *at))
    }

    fn remove(&mut self, place: usize, task: u16) {
        if let Some(slot) = self.places.get_mut(usize::from(task)) {
            *slot = NONE;
        }
        let Some(last) = self.heap.pop() else { return };
        let Some(removed) = self.heap.get(place) else { return };
        if last.0 < removed.0 { self.rise(place, last) } else { self.sink(place, last) }
    }

    #[inline]
    fn put(&mut self, place: usize, entry: (Instant, u16)) {
        if let (Some(slot), Some(known)) =
            (self.heap.get_mut(place), self.places.get_mut(usize::from(entry.1)))
        {
            *slot = entry;
            *known = place as u32;
        }
    }

    /// Puts an entry at this place, or nearer to the first one.
    fn rise(&mut self, mut place: usize, entry: (Instant, u16)) {
        while let Some(parent) = place.checked_sub(1).map(|place| place / 2)
            && let Some(above) = self.heap.get(parent).copied()
            && entry.0 < above.0
        {
            self.put(place, above);
            place = parent;
        }
        self.put(place, entry);
    }

    /// Puts an entry at this place, or farther from the first one.
    fn sink(&mut self, mut place: usize, entry: (Instant, u16)) {
        loop {
            let left = 2 * place + 1;
            let Some(mut below) = self.heap.get(left).copied() else { break };
            let mut child = left;
            if let Some(right) = self.heap.get(left + 1).copied()
                && right.0 < below.0
            {
                (below, child) = (right, left + 1);
            }
            if entry.0 <= below.0 {
                break;
            }
            self.put(place, below);
            place = child;
        }
        self.put(place, entry);
    }
}

/// A set of numbered tasks, taken by ascending number.
#[derive(Clone, Default, Debug)]
pub struct Numbers {
    /// A bit for each number.
    words: Vec<u64>,
    /// No word before this one has a bit.
    lowest: usize,
}

impl Numbers {
    /// Creates an empty set.
    #[must_use]
    pub const fn new() -> Self {
        Self { words: Vec::new(), lowest: 0 }
    }

    /// Makes room for the numbers below `tasks`, so that [`insert`](Self::insert) does not allocate.
    pub fn reserve(&mut self, tasks: usize) {
        if tasks > self.words.len() * 64 {
            self.words.resize(tasks.div_ceil(64), 0);
        }
    }

    /// Adds a task. Allocates only for a number higher than all before.
    #[inline]
    pub fn insert(&mut self, task: u16) {
        let word = usize::from(task / 64);
        if word >= self.words.len() {
            self.reserve(usize::from(task) + 1);
        }
        if let Some(bits) = self.words.get_mut(word) {
            *bits |= 1 << (task % 64);
            self.lowest = self.lowest.min(word);
        }
    }

    /// Removes the lowest number and returns it.
    #[inline]
    pub fn take_first(&mut self) -> Option<u16> {
        while let Some(bits) = self.words.get_mut(self.lowest) {
            if *bits != 0 {
                let bit = bits.trailing_zeros() as u16;
                *bits &= *bits - 1;
                return Some(self.lowest as u16 * 64 + bit);
            }
            self.lowest += 1;
        }
        None
    }
}

/// A queue of numbered tasks, in which each waits at most once.
#[derive(Clone, Default, Debug)]
pub struct Turns {
    queue: VecDeque<u16>,
    waits: Vec<bool>,
}

impl Turns {
    /// Creates an empty queue.
    #[must_use]
    pub const fn new() -> Self {
        Self { queue: VecDeque::new(), waits: Vec::new() }
    }

    /// Makes room for the tasks with numbers below `tasks`, so that [`push`](Self::push) does not allocate.
    pub fn reserve(&mut self, tasks: usize) {
        if tasks > self.waits.len() {
            self.waits.resize(tasks, false);
            self.queue.reserve(tasks.saturating_sub(self.queue.len()));
        }
    }

    /// Puts a task at the end, unless it already waits. Allocates only for a number higher than all before.
    #[inline]
    pub fn push(&mut self, task: u16) {
        if usize::from(task) >= self.waits.len() {
            self.reserve(usize::from(task) + 1);
        }
        if let Some(waits) = self.waits.get_mut(usize::from(task))
            && !*waits
        {
            *waits = true;
            self.queue.push_back(task);
        }
    }

    /// Returns the first task, which stays.
    #[inline]
    #[must_use]
    pub fn first(&self) -> Option<u16> {
        self.queue.front().copied()
    }

    /// Removes the first task and returns it.
    #[inline]
    pub fn pop(&mut self) -> Option<u16> {
        let task = self.queue.pop_front()?;
        if let Some(waits) = self.waits.get_mut(usize::from(task)) {
            *waits = false;
        }
        Some(task)
    }

    /// Returns whether a task waits.
    #[inline]
    #[must_use]
    pub fn contains(&self, task: u16) -> bool {
        self.waits.get(usize::from(task)) == Some(&true)
    }

    /// Returns the tasks that wait, in their order.
    pub fn iter(&self) -> impl Iterator<Item = u16> {
        self.queue.iter().copied()
    }

    /// Returns whether no task waits.
    #[inline]
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.queue.is_empty()
    }
}

/// Which numbered tasks belong to a key, as an address; several may belong to one.
#[derive(Clone, Debug)]
pub struct Directory<K> {
    /// Ascending.
    entries: Vec<(K, u16)>,
}

impl<K> Default for Directory<K> {
    fn default() -> Self {
        Self { entries: Vec::new() }
    }
}

impl<K: Ord + Copy> Directory<K> {
    /// Creates an empty directory.
    #[must_use]
    pub const fn new() -> Self {
        Self { entries: Vec::new() }
    }

    /// Adds a task to a key.
    pub fn insert(&mut self, key: K, task: u16) {
        if let Err(place) = self.entries.binary_search(&(key, task)) {
            self.entries.insert(place, (key, task));
        }
    }

    /// Removes a task from a key.
    pub fn remove(&mut self, key: K, task: u16) {
        if let Ok(place) = self.entries.binary_search(&(key, task)) {
            self.entries.remove(place);
        }
    }

    /// Moves a task from one key to another.
    #[inline]
    pub fn replace(&mut self, task: u16, before: Option<K>, after: Option<K>) {
        if before == after {
            return;
        }
        if let Some(key) = before {
            self.remove(key, task);
        }
        if let Some(key) = after {
            self.insert(key, task);
        }
    }

    /// Returns the key of the entry at this index, by ascending key.
    #[must_use]
    pub fn key(&self, index: usize) -> Option<K> {
        self.entries.get(index).map(|(key, _)| *key)
    }

    /// Returns the tasks of a key, by ascending number.
    pub fn of(&self, key: K) -> impl Iterator<Item = u16> {
        let start = self.entries.partition_point(|(known, _)| *known < key);
        let from = self.entries.get(start..).unwrap_or_default();
        from.iter().take_while(move |(known, _)| *known == key).map(|(_, task)| *task)
    }

    /// Returns the task of a key after another one, or the first one.
    #[inline]
    #[must_use]
    pub fn next(&self, key: K, after: Option<u16>) -> Option<u16> {
        let is_before = |entry: &(K, u16)| match after {
            Some(task) => *entry <= (key, task),
            None => entry.0 < key,
        };
        let (known, task) = self.entries.get(self.entries.partition_point(is_before))?;
        (*known == key).then_some(*task)
    }
}

#[cfg(test)]
mod tests {
    use alloc::collections::BTreeMap;

    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn deadlines_come_in_their_order_whatever_was_set_changed_and_removed(
            steps in prop::collection::vec((0_u16..40, prop::option::of(0_u64..30)), 0..300),
        ) {
            let (mut deadlines, mut model) = (Deadlines::new(), BTreeMap::new());
            for (task, at) in steps {
                let at = at.map(Instant::from_nanos);
                deadlines.set(task, at);
                match at {
                    Some(at) => { model.insert(task, at); }
                    None => { model.remove(&task); }
                }
                prop_assert_eq!(deadlines.first(), model.values().min().copied());
                prop_assert_eq!(deadlines.iter().collect::<BTreeMap<_, _>>(), model.clone());
            }
            let now = Instant::from_nanos(20);
            let mut taken: Vec<_> = core::iter::from_fn(|| deadlines.take_due(now)).collect();
            prop_assert!(taken.is_sorted_by_key(|task| model.get(task)));
            taken.sort_unstable();
            let due: Vec<_> = model.iter().filter(|(_, at)| **at <= now).map(|(task, _)| *task).collect();
            prop_assert_eq!(taken, due);
        }
    }

    #[test]
    fn numbers_are_taken_by_ascending_number_also_those_added_meanwhile() {
        let mut numbers = Numbers::new();
        for task in [700, 3, 64, 3, u16::MAX] {
            numbers.insert(task);
        }
        assert_eq!((numbers.take_first(), numbers.take_first()), (Some(3), Some(64)));
        numbers.insert(5);
        let rest: Vec<_> = core::iter::from_fn(|| numbers.take_first()).collect();
        assert_eq!(rest, [5, 700, u16::MAX]);
    }

    #[test]
    fn a_task_waits_once_and_again_after_its_turn() {
        let mut turns = Turns::new();
        for task in [3, 1, 3, 2, 1] {
            turns.push(task);
        }
        assert_eq!((turns.pop(), turns.contains(3), turns.contains(1)), (Some(3), false, true));
        turns.push(3);
        assert_eq!(core::iter::from_fn(|| turns.pop()).collect::<Vec<_>>(), [1, 2, 3]);
        assert!(turns.is_empty());
    }

    #[test]
    fn the_tasks_of_a_key_are_found_by_ascending_number() {
        let mut directory = Directory::new();
        for (key, task) in [(7, 4), (5, 9), (7, 1), (7, 4), (9, 0)] {
            directory.insert(key, task);
        }
        directory.replace(9, Some(5), Some(7));
        assert_eq!(directory.of(7).collect::<Vec<_>>(), [1, 4, 9]);
        assert_eq!((directory.next(7, None), directory.next(7, Some(4))), (Some(1), Some(9)));
        assert_eq!((directory.next(7, Some(9)), directory.next(5, None)), (None, None));
        assert_eq!([0, 2, 3, 4].map(|index| directory.key(index)), [Some(7), Some(7), Some(9), None]);
    }
}
