//! G-code as points: G0 to G3 in the plane G17, G20 and G21, G90 and G91, F, I, J and R. Other words are refused.

use std::f64::consts::TAU;

use super::points::{LineError, PathPoint, PathPoints, coordinate, distance};

const INCH_MM: f64 = 25.4;

/// Largest difference of the radii at start and end of an arc, in mm: what four decimals of an inch round away, and more.
const RADII_DIFFER_MM: f64 = 0.01;

/// Length of a step along an arc without a spacing, in mm.
const ARC_STEP_MM: f64 = 1.0;

/// Motion that the next coordinates give.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum MotionCode {
    Rapid,
    Line,
    Arc { is_clockwise: bool },
}

/// Values that hold until another word changes them.
struct Modal {
    place: [f64; 3],
    mode: Option<MotionCode>,
    unit_mm: f64,
    is_relative: bool,
    feed_mm_s: Option<f64>,
    decimals: Option<u32>,
}

/// The words of a line.
#[derive(Default)]
struct Words {
    axes: [Option<f64>; 3],
    centre: [Option<f64>; 2],
    radius: Option<f64>,
    feed: Option<f64>,
}

/// Reads G-code. Arcs become points of `spacing_mm`.
pub(super) fn read(text: &str, spacing_mm: Option<f64>) -> Result<PathPoints, LineError> {
    let mut found = PathPoints::default();
    let mut modal = Modal {
        place: [0.0; 3],
        mode: None,
        unit_mm: 1.0,
        is_relative: false,
        feed_mm_s: None,
        decimals: Some(0),
    };
    for (index, text) in text.lines().enumerate() {
        let line = index + 1;
        let wrong = |problem: String| LineError::new(line, problem);
        let words = modal.take(&content(text).map_err(wrong)?).map_err(wrong)?;
        if words.axes.iter().chain(&words.centre).all(Option::is_none) {
            continue;
        }
        let mode = modal
            .mode
            .ok_or_else(|| wrong("coordinates before G0, G1, G2 or G3: write one of them".into()))?;
        if mode != MotionCode::Rapid && modal.feed_mm_s.is_none() {
            return Err(wrong("a motion without a feed: write F before it".into()));
        }
        let speed = modal.feed_mm_s.filter(|_| mode != MotionCode::Rapid);
        let to = modal.target(&words);
        let point = |place| PathPoint { line, place, turn: None, speed };
        if let MotionCode::Arc { is_clockwise } = mode {
            let arc = Arc::of(modal.place, to, &words, modal.unit_mm, is_clockwise).map_err(wrong)?;
            let steps = (arc.length() / spacing_mm.unwrap_or(ARC_STEP_MM) - 1e-9).ceil().max(1.0);
            for step in 1..steps as usize {
                found.push(point(arc.at(step as f64 / steps)))?;
            }
            modal.decimals = None;
        } else if to == modal.place && !found.points.is_empty() {
            continue;
        }
        found.push(point(to))?;
        modal.place = to;
    }
    found.decimals = modal.decimals;
    found.checked()
}

/// Returns a line without its comments and blanks, in capitals.
fn content(text: &str) -> Result<String, String> {
    let (mut found, mut is_comment) = (String::new(), false);
    for character in text.chars() {
        match character {
            '(' => is_comment = true,
            ')' if is_comment => is_comment = false,
            _ if is_comment => {}
            ';' => return Ok(found),
            _ if character.is_whitespace() => {}
            _ => found.push(character.to_ascii_uppercase()),
        }
    }
    if is_comment { Err("a comment without its `)`: close it".into()) } else { Ok(found) }
}

impl Modal {
    /// Takes the words of a line.
    fn take(&mut self, text: &str) -> Result<Words, String> {
        let mut words = Words::default();
        let mut rest = if text == "%" { "" } else { text };
        while let Some(letter) = rest.chars().next() {
            let after = rest.get(letter.len_utf8()..).unwrap_or_default();
            let end = after.find(|c: char| !(c.is_ascii_digit() || "+-.".contains(c))).unwrap_or(after.len());
            let (number, next) = after.split_at(end);
            rest = next;
            let value = coordinate(&letter.to_string(), number)?;
            let digits = number.split_once('.').map_or(0, |(_, digits)| digits.len() as u32);
            match letter {
                'N' => {}
                'G' => self.take_code(number, value)?,
                'F' if value > 0.0 => words.feed = Some(value),
                'X' | 'Y' | 'Z' => {
                    self.decimals = self.decimals.map(|most| most.max(digits));
                    words.axes[(letter as usize) - ('X' as usize)] = Some(value);
                }
                'I' | 'J' => words.centre[(letter as usize) - ('I' as usize)] = Some(value),
                'R' => words.radius = Some(value),
                'F' => return Err(format!("F{number}: must be above 0")),
                _ => {
                    return Err(format!(
                        "word `{letter}{number}`: known are G0 to G3, G17, G20, G21, G90, G91, F, I, J, R, N and X, Y, Z"
                    ));
                }
            }
        }
        // The unit of the line may stand after the feed.
        self.feed_mm_s = words.feed.map_or(self.feed_mm_s, |feed| Some(feed * self.unit_mm / 60.0));
        Ok(words)
    }

    fn take_code(&mut self, number: &str, value: f64) -> Result<(), String> {
        const CODES: [f64; 9] = [0.0, 1.0, 2.0, 3.0, 17.0, 20.0, 21.0, 90.0, 91.0];
        match CODES.iter().position(|code| *code == value) {
            Some(0) => self.mode = Some(MotionCode::Rapid),
            Some(1) => self.mode = Some(MotionCode::Line),
            Some(2) => self.mode = Some(MotionCode::Arc { is_clockwise: true }),
            Some(3) => self.mode = Some(MotionCode::Arc { is_clockwise: false }),
            Some(4) => {}
            Some(5) => (self.unit_mm, self.decimals) = (INCH_MM, None),
            Some(6) => self.unit_mm = 1.0,
            Some(7) => self.is_relative = false,
            Some(8) => self.is_relative = true,
            _ => return Err(format!("G{number}: known are G0 to G3, G17, G20, G21, G90 and G91")),
        }
        Ok(())
    }

    fn target(&self, words: &Words) -> [f64; 3] {
        std::array::from_fn(|i| match words.axes[i] {
            Some(value) if self.is_relative => self.place[i] + value * self.unit_mm,
            Some(value) => value * self.unit_mm,
            None => self.place[i],
        })
    }
}

/// An arc in the xy plane, along which z rises evenly.
struct Arc {
    centre: [f64; 2],
    radius: f64,
    from: f64,
    sweep: f64,
    ends: [[f64; 3]; 2],
}

impl Arc {
    fn of(
        from: [f64; 3],
        to: [f64; 3],
        words: &Words,
        unit_mm: f64,
        is_clockwise: bool,
    ) -> Result<Self, String> {
        let sign = if is_clockwise { -1.0 } else { 1.0 };
        let centre = match (words.radius, words.centre) {
            (Some(_), [None, None]) | (None, [Some(_), _] | [_, Some(_)]) => {
                Self::centre(from, to, words, unit_mm, sign)?
            }
            (Some(_), _) => return Err("R beside I or J: leave one of them out".into()),
            (None, _) => return Err("an arc without I, J or R: write its centre or its radius".into()),
        };
        let flat = |place: [f64; 3]| distance(&[place[0], place[1], 0.0], &[centre[0], centre[1], 0.0]);
        let [radius, end] = [flat(from), flat(to)];
        if radius == 0.0 || (radius - end).abs() > RADII_DIFFER_MM.max(1e-3 * radius) {
            return Err(format!(
                "radius {radius:.4} mm at the start and {end:.4} mm at the end: correct I and J"
            ));
        }
        let angle = |place: [f64; 3]| libm::atan2(place[1] - centre[1], place[0] - centre[0]);
        let turned = (sign * (angle(to) - angle(from))).rem_euclid(TAU);
        // From a place to itself it is a whole turn.
        let turned = if turned < 1e-9 || TAU - turned < 1e-9 { TAU } else { turned };
        Ok(Self { centre, radius, from: angle(from), sweep: sign * turned, ends: [from, to] })
    }

    fn centre(
        from: [f64; 3],
        to: [f64; 3],
        words: &Words,
        unit_mm: f64,
        sign: f64,
    ) -> Result<[f64; 2], String> {
        let Some(radius) = words.radius.map(|radius| radius * unit_mm) else {
            let [i, j] = words.centre.map(|value| value.unwrap_or(0.0) * unit_mm);
            return Ok([from[0] + i, from[1] + j]);
        };
        let (x, y) = (to[0] - from[0], to[1] - from[1]);
        let chord = libm::hypot(x, y);
        let rest = radius * radius - chord * chord / 4.0;
        if chord == 0.0 {
            return Err("a whole circle with R: its centre is unknown; write I and J".into());
        }
        if rest < -RADII_DIFFER_MM * radius.abs() {
            return Err(format!("R {radius} mm: must be at least half the distance {chord:.4} mm"));
        }
        // A negative radius is the longer arc.
        let height = rest.max(0.0).sqrt() * sign * radius.signum();
        Ok([from[0] + x / 2.0 - height * y / chord, from[1] + y / 2.0 + height * x / chord])
    }

    fn length(&self) -> f64 {
        libm::hypot(self.radius * self.sweep, self.ends[1][2] - self.ends[0][2])
    }

    fn at(&self, share: f64) -> [f64; 3] {
        let angle = self.from + share * self.sweep;
        let z = self.ends[0][2] + share * (self.ends[1][2] - self.ends[0][2]);
        [self.centre[0] + self.radius * libm::cos(angle), self.centre[1] + self.radius * libm::sin(angle), z]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(text: &str) -> String {
        read(text, None).unwrap_err().to_string()
    }

    #[test]
    fn words_that_are_not_served_and_broken_arcs_are_refused_with_their_line() {
        insta::assert_snapshot!([
            refused("G1 X1 F100\nM3 S100\n"),
            refused("G18\n"),
            refused("X1 Y1\n"),
            refused("G1 X1 Y1\n"),
            refused("G0 X0 (open\n"),
            refused("G0 X0 Y0\nG2 X10 Y0 F100\n"),
            refused("G0 X0 Y0\nG2 X10 Y0 I3 J0 F100\n"),
            refused("G0 X0 Y0\nG2 X0 Y0 R3 F100\n"),
            refused("G0 X0 Y0\nG2 X10 Y0 R3 F100\n"),
            refused("G0 X0 Y0\nG1 X1..2 F100\n"),
            refused("G0 X0 Y0\nG1 X1 F-5\n"),
        ].join("\n"), @"
        line 2: word `M3`: known are G0 to G3, G17, G20, G21, G90, G91, F, I, J, R, N and X, Y, Z
        line 1: G18: known are G0 to G3, G17, G20, G21, G90 and G91
        line 1: coordinates before G0, G1, G2 or G3: write one of them
        line 1: a motion without a feed: write F before it
        line 1: a comment without its `)`: close it
        line 2: an arc without I, J or R: write its centre or its radius
        line 2: radius 3.0000 mm at the start and 7.0000 mm at the end: correct I and J
        line 2: a whole circle with R: its centre is unknown; write I and J
        line 2: R 3 mm: must be at least half the distance 10.0000 mm
        line 2: X `1..2`: must be a number, such as 12.5
        line 2: F-5: must be above 0
        ");
    }

    #[test]
    fn arcs_by_centre_and_by_radius_are_the_same_and_keep_their_distance() {
        let by_centre =
            read("G21 G90 G17\nG0 X10 Y0\nG3 X0 Y10 I-10 J0 F600\nG1 X0 Y20\n", Some(0.5)).unwrap();
        let by_radius = read("G0X10Y0\ng3x0y10r10f600\nG91 G1 Y10\n", Some(0.5)).unwrap();
        assert_eq!(by_centre.points.len(), by_radius.points.len());
        for (one, other) in by_centre.points.iter().zip(&by_radius.points) {
            assert!(distance(&one.place, &other.place) < 1e-9, "{one:?} {other:?}");
        }
        let on_arc = &by_centre.points[..by_centre.points.len() - 1];
        assert!(on_arc.iter().all(|point| (libm::hypot(point.place[0], point.place[1]) - 10.0).abs() < 1e-9));
        assert_eq!(by_centre.points[1].speed, Some(10.0));
        let longer = read("G0X10Y0\nG3X0Y10R-10F600\n", Some(0.5)).unwrap();
        assert!(
            (longer.length_mm() - 3.0 * by_centre.length_mm() + 30.0).abs() < 0.02,
            "{}",
            longer.length_mm()
        );
        let inches = read("G20\nG0 X1 Y0\nG2 X1 Y0 I-1 J0 F60\n", None).unwrap();
        assert!((inches.length_mm() - 25.4 * TAU).abs() < 0.05);
    }
}
