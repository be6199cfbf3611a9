//! A path as points: from a list of coordinates, or from G-code.
//!
//! ```text
//! x,y,z            or  x,y,z,a,b,c: mm and degrees, one point a line; the first line may name the columns
//! 210.00000,0.0,100.0
//! ```

use std::fmt;

/// A line of a file that cannot be used: what was found, and what would do.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub struct LineError {
    /// The line, from 1.
    pub line: usize,
    /// The fault, the value found and the remedy.
    pub problem: String,
}

impl fmt::Display for LineError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "line {}: {}", self.line, self.problem)
    }
}

impl LineError {
    pub(super) fn new(line: usize, problem: impl Into<String>) -> Self {
        Self { line, problem: problem.into() }
    }
}

/// A point of a path.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct PathPoint {
    /// The line that it comes from, from 1.
    pub line: usize,
    /// x, y, z in mm.
    pub place: [f64; 3],
    /// Angles a, b, c in degrees, if the file gives them.
    pub turn: Option<[f64; 3]>,
    /// Speed on the way to it in mm/s, if the file gives one.
    pub speed: Option<f64>,
}

/// The points of a path.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct PathPoints {
    /// In order, the start first.
    pub points: Vec<PathPoint>,
    /// Digits after the decimal point of the coordinates, if they are those of the file and no point between them was computed.
    pub decimals: Option<u32>,
}

/// Farthest coordinate in mm.
const FARTHEST_MM: f64 = 100_000.0;

/// Largest number of points.
const MOST_POINTS: usize = 5_000_000;

impl PathPoints {
    /// Reads a list of coordinates.
    ///
    /// # Errors
    ///
    /// A line is not a point.
    pub fn from_csv(text: &str) -> Result<Self, LineError> {
        let mut found = Self { points: Vec::new(), decimals: Some(0) };
        let content = |text: &str| {
            let text = text.trim();
            (!text.is_empty() && !text.starts_with('#')).then(|| text.to_owned())
        };
        let mut is_first = true;
        for (index, text) in text.lines().enumerate() {
            let (line, Some(text)) = (index + 1, content(text)) else { continue };
            let columns: Vec<&str> = text.split(',').map(str::trim).collect();
            let names = ["x", "y", "z", "a", "b", "c"];
            if std::mem::take(&mut is_first) && columns.first() == Some(&"x") {
                if columns != names[..3] && columns != names {
                    let problem = format!("columns `{text}`: must be `x,y,z` or `x,y,z,a,b,c`");
                    return Err(LineError::new(line, problem));
                }
                continue;
            }
            if columns.len() != 3 && columns.len() != 6 {
                let problem =
                    format!("{} columns in `{text}`: must be 3 (x,y,z) or 6 (x,y,z,a,b,c)", columns.len());
                return Err(LineError::new(line, problem));
            }
            let mut numbers = [0.0; 6];
            for ((number, text), name) in numbers.iter_mut().zip(&columns).zip(names) {
                *number = coordinate(name, text).map_err(|problem| LineError::new(line, problem))?;
                let digits = text.split(['e', 'E']).next().and_then(|text| text.split_once('.'));
                let digits = digits.map_or(0, |(_, digits)| digits.len() as u32);
                found.decimals = found.decimals.map(|most| most.max(digits));
            }
            let [x, y, z, a, b, c] = numbers;
            let turn = (columns.len() == 6).then_some([a, b, c]);
            found.push(PathPoint { line, place: [x, y, z], turn, speed: None })?;
        }
        found.checked()
    }

    /// Adds a point.
    pub(super) fn push(&mut self, point: PathPoint) -> Result<(), LineError> {
        if self.points.len() == MOST_POINTS {
            let problem = format!("more than {MOST_POINTS} points: split the file, or increase --spacing");
            return Err(LineError::new(point.line, problem));
        }
        self.points.push(point);
        Ok(())
    }

    /// Returns the points, if they are a path.
    pub(super) fn checked(self) -> Result<Self, LineError> {
        if self.points.len() < 3 {
            let line = self.points.last().map_or(1, |point| point.line);
            let problem = format!("{} points in the file: a path has at least 3", self.points.len());
            return Err(LineError::new(line, problem));
        }
        for pair in self.points.windows(2) {
            let [one, other] = pair else { continue };
            // As the image carries them.
            let is_same =
                (0..3).all(|i| one.place[i] as f32 == other.place[i] as f32) && one.turn == other.turn;
            if is_same {
                let problem =
                    format!("the same point as in line {}: remove it, or write more digits", one.line);
                return Err(LineError::new(other.line, problem));
            }
        }
        Ok(self)
    }

    /// Cuts each step that is longer than this, in mm, into equal ones.
    ///
    /// # Errors
    ///
    /// There are too many points then.
    pub fn spaced(&self, spacing_mm: f64) -> Result<Self, LineError> {
        let mut found = Self::default();
        let mut before: Option<PathPoint> = None;
        for point in &self.points {
            if let Some(from) = before {
                let steps =
                    (distance(&from.place, &point.place) / spacing_mm - 1e-9).ceil().max(1.0) as usize;
                for step in 1..steps {
                    let share = step as f64 / steps as f64;
                    let mix = |one: &[f64; 3], other: &[f64; 3]| {
                        std::array::from_fn(|i| one[i] + share * (other[i] - one[i]))
                    };
                    let turn =
                        from.turn.as_ref().zip(point.turn.as_ref()).map(|(one, other)| mix(one, other));
                    found.push(PathPoint { place: mix(&from.place, &point.place), turn, ..*point })?;
                }
            }
            found.push(*point)?;
            before = Some(*point);
        }
        found.decimals = self.decimals.filter(|_| found.points.len() == self.points.len());
        Ok(found)
    }

    /// Returns the length of the path from point to point, in mm.
    #[must_use]
    pub fn length_mm(&self) -> f64 {
        self.points.windows(2).map(|pair| distance(&pair[0].place, &pair[1].place)).sum()
    }
}

/// Returns a number of a file, in mm or degrees.
pub(super) fn coordinate(name: &str, text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|number: &f64| number.is_finite());
    let number = number.ok_or_else(|| format!("{name} `{text}`: must be a number, such as 12.5"))?;
    if number.abs() > FARTHEST_MM {
        return Err(format!("{name} {text}: must be -{FARTHEST_MM} to {FARTHEST_MM}"));
    }
    Ok(number)
}

/// Returns the distance of two places.
pub(super) fn distance(one: &[f64; 3], other: &[f64; 3]) -> f64 {
    (0..3).map(|i| (other[i] - one[i]) * (other[i] - one[i])).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(text: &str) -> String {
        PathPoints::from_csv(text).unwrap_err().to_string()
    }

    #[test]
    fn a_line_that_is_not_a_point_is_refused_with_what_was_found_and_what_would_do() {
        insta::assert_snapshot!([
            refused("x,y\n1,2\n"),
            refused("x,y,z\n1,2,3\n1,2\n"),
            refused("1,2,3\n1,two,3\n"),
            refused("1,2,3\n# a comment\n1,2,inf\n"),
            refused("1,2,3\n1,2,1e9\n"),
            refused("1,2,3\n2,2,3\n"),
            refused("1,2,3\n1.1,2,3\n1.1,2,3\n"),
        ].join("\n"), @"
        line 1: columns `x,y`: must be `x,y,z` or `x,y,z,a,b,c`
        line 3: 2 columns in `1,2`: must be 3 (x,y,z) or 6 (x,y,z,a,b,c)
        line 2: y `two`: must be a number, such as 12.5
        line 3: z `inf`: must be a number, such as 12.5
        line 2: z 1e9: must be -100000 to 100000
        line 2: 2 points in the file: a path has at least 3
        line 3: the same point as in line 2: remove it, or write more digits
        ");
    }

    #[test]
    fn the_decimals_are_those_of_the_longest_number_and_unknown_between_points() {
        let found = PathPoints::from_csv("x,y,z\n1.25,0,3\n2.5,0,3.125\n4,0,3\n").unwrap();
        assert_eq!(found.decimals, Some(3));
        assert_eq!(found.spaced(10.0).unwrap(), found);
        let cut = found.spaced(0.5).unwrap();
        assert_eq!((cut.points.len(), cut.decimals), (1 + 3 + 4, None));
        assert!(cut.points.windows(2).all(|pair| distance(&pair[0].place, &pair[1].place) <= 0.5));
    }
}
