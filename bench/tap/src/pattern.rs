//! Sequences of skills that follow the plan, found wherever they begin.
//!
//! The search is that of D. E. Knuth, J. H. Morris and V. R. Pratt (SIAM Journal on Computing 6, 1977): a skill that does not continue one
//! repetition may still continue another that began later, as in a capture that begins within a repetition.

use std::collections::VecDeque;

/// A sequence of skills to find, with the records of those found so far.
#[derive(Clone, Debug)]
pub(crate) struct Pattern<K, R> {
    keys: Vec<K>,
    /// For each prefix, the length of the longest other prefix that ends it.
    borders: Vec<usize>,
    is_same: fn(&K, &K) -> bool,
    found: VecDeque<R>,
}

/// Result of a skill.
#[derive(Clone, PartialEq, Debug)]
pub(crate) struct Matched<R> {
    /// Records of the whole sequence, if it is complete.
    pub(crate) complete: Option<Vec<R>>,
    /// Set if the skill is part of a sequence.
    pub(crate) is_part: bool,
    /// Set if an earlier sequence was left before its end.
    pub(crate) has_left: bool,
}

impl<K, R> Pattern<K, R> {
    /// Creates the search for these skills.
    pub(crate) fn new(keys: Vec<K>, is_same: fn(&K, &K) -> bool) -> Self {
        let mut borders: Vec<usize> = Vec::with_capacity(keys.len());
        let mut border = 0;
        for (index, key) in keys.iter().enumerate() {
            while border > 0 && !keys.get(border).is_some_and(|other| is_same(other, key)) {
                border = borders.get(border - 1).copied().unwrap_or_default();
            }
            if index > 0 && keys.get(border).is_some_and(|other| is_same(other, key)) {
                border += 1;
            }
            borders.push(border);
        }
        Self { keys, borders, is_same, found: VecDeque::new() }
    }

    /// Takes the next skill.
    pub(crate) fn add(&mut self, key: &K, record: R) -> Matched<R> {
        let before = self.found.len();
        while !self.found.is_empty() && !self.continues_with(key) {
            let border = self.borders.get(self.found.len() - 1).copied().unwrap_or_default();
            let dropped = self.found.len() - border.min(self.found.len() - 1);
            self.found.drain(..dropped);
        }
        let has_left = self.found.len() < before;
        if !self.continues_with(key) {
            return Matched { complete: None, is_part: false, has_left };
        }
        self.found.push_back(record);
        let complete = (self.found.len() == self.keys.len()).then(|| self.found.drain(..).collect());
        Matched { complete, is_part: true, has_left }
    }

    /// Leaves the sequence; returns whether one had begun.
    pub(crate) fn leave(&mut self) -> bool {
        let has_begun = !self.found.is_empty();
        self.found.clear();
        has_begun
    }

    /// Returns how many skills of a sequence were found.
    pub(crate) fn len(&self) -> usize {
        self.found.len()
    }

    fn continues_with(&self, key: &K) -> bool {
        self.keys.get(self.found.len()).is_some_and(|next| (self.is_same)(next, key))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ends(pattern: &str, text: &str) -> (Vec<(usize, usize)>, usize) {
        let mut search = Pattern::new(pattern.chars().collect(), |a, b| a == b);
        let mut left = 0;
        let mut found = Vec::new();
        for (at, key) in text.chars().enumerate() {
            let matched = search.add(&key, at);
            left += usize::from(matched.has_left);
            if let Some(all) = matched.complete {
                assert!(all.windows(2).all(|pair| pair[0] + 1 == pair[1]), "{all:?}");
                found.push((all[0], at));
            }
        }
        (found, left)
    }

    #[test]
    fn a_sequence_is_found_wherever_the_text_begins() {
        assert_eq!(ends("abcab", "xabcab.abcab"), (vec![(1, 5), (7, 11)], 0));
        // The capture begins within a repetition whose rest looks like the start of the next one.
        assert_eq!(ends("abcab", "ababcab"), (vec![(2, 6)], 1));
        assert_eq!(ends("aab", "aaab"), (vec![(1, 3)], 1));
        assert_eq!(ends("a", "aba"), (vec![(0, 0), (2, 2)], 0));
        assert_eq!(ends("abc", "ababab"), (vec![], 2));
    }

    #[test]
    fn the_search_finds_what_comparing_at_every_place_finds() {
        // All texts of two letters up to 10, all patterns up to 4, without overlapping finds.
        let strings = |length: u32| {
            (0..1_u32 << length).map(move |bits| {
                (0..length).map(|at| if bits >> at & 1 == 1 { 'a' } else { 'b' }).collect::<String>()
            })
        };
        for pattern in (1..=4).flat_map(strings) {
            for text in strings(10) {
                let mut expected = Vec::new();
                let mut at = 0;
                while at + pattern.len() <= text.len() {
                    if text[at..].starts_with(&pattern) {
                        expected.push((at, at + pattern.len() - 1));
                        at += pattern.len();
                    } else {
                        at += 1;
                    }
                }
                assert_eq!(ends(&pattern, &text).0, expected, "{pattern} in {text}");
            }
        }
    }
}
