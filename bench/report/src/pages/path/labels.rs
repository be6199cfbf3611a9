//! The motion numbers beside the targets: numbers at one place are combined, and a label that would cover another one is left
//! out.

use super::DrawnTarget;

/// Longest label in characters: a longer one ends with [`MORE`].
const LONGEST: usize = 12;

/// End of a label that does not show all numbers.
const MORE: &str = ", …";

/// Width of a character and height of a line, in parts of the text's size.
const CHARACTER: f64 = 0.65;
const LINE: f64 = 1.2;

/// Returns the targets' numbers and positions; numbers at the same position are combined.
pub(super) fn labels(
    targets: &[DrawnTarget],
    flat: impl Fn(&[f64; 3]) -> (f64, f64),
    near: f64,
) -> Vec<(Vec<usize>, (f64, f64))> {
    let mut labels: Vec<(Vec<usize>, (f64, f64))> = Vec::new();
    for target in targets {
        let at = flat(&target.at);
        let is_near = |other: &(f64, f64)| (other.0 - at.0).abs() < near && (other.1 - at.1).abs() < near;
        match labels.iter_mut().find(|(_, other)| is_near(other)) {
            Some((numbers, _)) => numbers.push(target.number),
            None => labels.push((vec![target.number], at)),
        }
    }
    labels
}

/// Formats ascending numbers as a label: `1, 3–5`, or the first of them: `8, 10, …`.
pub(super) fn written(numbers: &[usize]) -> String {
    let runs: Vec<_> = numbers.chunk_by(|before, after| before + 1 == *after).flat_map(run).collect();
    let whole = runs.join(", ");
    if whole.chars().count() <= LONGEST {
        return whole;
    }
    let mut label = String::new();
    for run in runs {
        let separator = if label.is_empty() { "" } else { ", " };
        let longer = format!("{label}{separator}{run}");
        if !label.is_empty() && longer.chars().count() + MORE.chars().count() > LONGEST {
            break;
        }
        label = longer;
    }
    label + MORE
}

fn run(run: &[usize]) -> Vec<String> {
    match run {
        [first, .., last] if last - first > 1 => vec![format!("{first}–{last}")],
        few => few.iter().map(ToString::to_string).collect(),
    }
}

/// The labels of a view so far. Lengths are in pixels.
pub(super) struct Placed {
    /// Size of the text.
    size: f64,
    /// The left, upper, right and lower edge of each.
    edges: Vec<[f64; 4]>,
}

impl Placed {
    pub(super) const fn new(size: f64) -> Self {
        Self { size, edges: Vec::new() }
    }

    /// Places a label at its upper left corner, or at its upper right one. Returns whether there is room for it.
    pub(super) fn place(&mut self, label: &str, (x, y): (f64, f64), is_right_corner: bool) -> bool {
        // With the gap between two labels.
        let width = (label.chars().count() as f64 + 0.5) * self.size * CHARACTER;
        let left = if is_right_corner { x - width } else { x };
        let edges = [left, y, left + width, y + self.size * LINE];
        let covers = |[left, top, right, bottom]: &[f64; 4]| {
            edges[0] < *right && *left < edges[2] && edges[1] < *bottom && *top < edges[3]
        };
        let has_room = !self.edges.iter().any(covers);
        if has_room {
            self.edges.push(edges);
        }
        has_room
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn motion_numbers_in_a_row_are_written_as_a_range() {
        assert_eq!(written(&[1, 2, 3, 4, 5]), "1–5");
        assert_eq!(written(&[6, 12]), "6, 12");
        assert_eq!(written(&[2, 3, 7, 8, 9]), "2, 3, 7–9");
    }

    #[test]
    fn more_numbers_than_a_label_has_room_for_end_with_a_mark() {
        assert_eq!(written(&[1, 3, 4, 5, 10, 11, 12]), "1, 3–5, …");
        assert_eq!(written(&[1806, 1810, 1894, 1898]), "1806, …");
        assert_eq!(written(&[123_456, 234_567]), "123456, …");
    }

    #[test]
    fn a_label_that_would_cover_another_one_has_no_room() {
        let mut placed = Placed::new(10.0);
        assert!(placed.place("12, 24", (0.0, 0.0), false));
        assert!(!placed.place("7", (40.0, 5.0), false), "in the label before");
        assert!(!placed.place("7", (50.0, 5.0), true), "its left end is in it");
        assert!(placed.place("7", (50.0, 5.0), false), "right of it");
        assert!(placed.place("7", (30.0, 12.0), false), "below it");
    }
}
