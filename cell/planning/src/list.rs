//! Motion lists as text, for sequences that are too long to be planned or kept in memory: one motion a line.
//!
//! ```text
//! # comments and empty lines are skipped
//! kind,x,y,z,a,b,c,aux_x,aux_y,aux_z,velocity,acceleration,approximation,tool,base,status,turn,deceleration,jerk
//! lin,0,0,30,0,0,180,0,0,0,4463,2500,1000,0,1,,,0,0
//! ptp,0,90,150,0,0,180,0,0,0,2232,5000,0,0,1,2,35,2500,0
//! ptp-joint,-60,90,150,0,0,0,0,0,0,2232,5000,0,0,1,,,0,0
//! ```
//!
//! The columns are the fields of [`image::Motion`](protocol::image::Motion) in the units of the wire, so that a list
//! contains exactly what the robot receives: mm and degrees, or joints; velocity in 0.1 mm/s, acceleration in mm/s², for
//! a PTP both in 0.01 % of the rated values; the approximation distance in 0.01 mm. Status and turn are empty where a
//! motion has no configuration, turn where any will do. Deceleration has the unit of the acceleration, jerk 10 mm/s³ or
//! 0.01 %; 0 is the robot's own. The first line that is no comment names the columns; a list without the last four is
//! read as well.

use std::fmt::Display;
use std::io::{self, BufRead, Read, Write};
use std::str::FromStr;

use protocol::image::{Configuration, Motion, MotionKind};

/// The first line of every list: the columns in their order.
pub const COLUMNS: &str = "kind,x,y,z,a,b,c,aux_x,aux_y,aux_z,velocity,acceleration,approximation,tool,base,status,turn,\
    deceleration,jerk";

/// The last columns, which a list may lack.
const OPTIONAL: &str = ",status,turn,deceleration,jerk";

/// Number of columns with decimals: target and auxiliary point or force.
const DECIMAL_COLUMNS: usize = 9;

/// Highest number of a tool or base.
const HIGHEST_FRAME: u8 = 15;

/// The longest line in bytes; the numbers of a motion take half of it.
const LONGEST_LINE: u64 = 1024;

/// Returns the name of a kind in a list; none for an empty slot and an unknown kind, which a list cannot hold.
const fn list_name(kind: MotionKind) -> Option<&'static str> {
    Some(match kind {
        MotionKind::LinCartesian => "lin",
        MotionKind::PtpCartesian => "ptp",
        MotionKind::PtpJoint => "ptp-joint",
        MotionKind::Circular => "circ",
        MotionKind::Spline => "spline",
        MotionKind::LinForceCartesian => "lin-force",
        MotionKind::None | MotionKind::Unknown(_) => return None,
    })
}

/// Why a motion list cannot be read on.
#[derive(Debug, thiserror::Error)]
pub enum ListError {
    /// The file cannot be read.
    #[error("cannot read {origin} after line {line}")]
    Read {
        /// The file.
        origin: String,
        /// The last line that was read, from 1.
        line: u64,
        /// What the system says.
        source: io::Error,
    },
    /// A line is no motion.
    #[error("{origin}:{line}: {problem}")]
    Line {
        /// The file.
        origin: String,
        /// The line, from 1.
        line: u64,
        /// What was found and what was expected.
        problem: String,
    },
}

/// The motions of a list, read as they are asked for; it holds one line.
///
/// Nothing comes after an error.
#[derive(Debug)]
pub struct MotionLines<R> {
    reader: R,
    origin: String,
    line: u64,
    text: String,
    /// The line of the columns; empty before it was read.
    header: String,
    ended: bool,
}

impl<R: BufRead> MotionLines<R> {
    /// Creates a reader of a list, which messages call `origin`.
    pub fn new(reader: R, origin: impl Into<String>) -> Self {
        let origin = origin.into();
        Self { reader, origin, line: 0, text: String::new(), header: String::new(), ended: false }
    }

    /// Reads up to the next line that is neither empty nor a comment; false at the end.
    fn advance(&mut self) -> Result<bool, ListError> {
        loop {
            self.text.clear();
            let read = self.reader.by_ref().take(LONGEST_LINE).read_line(&mut self.text);
            let read = read.map_err(|source| ListError::Read {
                origin: self.origin.clone(),
                line: self.line,
                source,
            })?;
            if read == 0 {
                return Ok(false);
            }
            self.line += 1;
            if read as u64 == LONGEST_LINE && !self.text.ends_with('\n') {
                return Err(self.wrong(format!("the line is longer than {LONGEST_LINE} bytes")));
            }
            let text = self.text.trim();
            if !text.is_empty() && !text.starts_with('#') {
                return Ok(true);
            }
        }
    }

    fn read(&mut self) -> Result<Option<Motion>, ListError> {
        if self.header.is_empty() {
            if !self.advance()? {
                return Err(self.wrong(format!("the list is empty; it starts with the line `{COLUMNS}`")));
            }
            let found = self.text.trim();
            if ![Some(COLUMNS), COLUMNS.strip_suffix(OPTIONAL)].contains(&Some(found)) {
                return Err(self.wrong(format!("found `{found}`; a list starts with the line `{COLUMNS}`")));
            }
            found.clone_into(&mut self.header);
        }
        if !self.advance()? {
            return Ok(None);
        }
        parse(&self.header, self.text.trim()).map(Some).map_err(|problem| self.wrong(problem))
    }

    fn wrong(&self, problem: String) -> ListError {
        ListError::Line { origin: self.origin.clone(), line: self.line.max(1), problem }
    }
}

impl<R: BufRead> Iterator for MotionLines<R> {
    type Item = Result<Motion, ListError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.ended {
            return None;
        }
        let next = self.read().transpose();
        self.ended = !matches!(next, Some(Ok(_)));
        next
    }
}

fn parse(header: &str, text: &str) -> Result<Motion, String> {
    let mut columns = header.split(',').zip(text.split(','));
    let columns_wanted = header.split(',').count();
    let found = text.split(',').count();
    if found != columns_wanted {
        let advice = decimal_comma(header, text);
        return Err(format!("found {found} columns; a motion has {columns_wanted}: {header}{advice}"));
    }
    let mut column = || columns.next().map(|(name, text)| (name, text.trim())).unwrap_or_default();
    let (_, kind) = column();
    let known = MotionKind::standard().find(|known| list_name(*known) == Some(kind));
    let kind = known.ok_or_else(|| {
        let names = MotionKind::standard().filter_map(list_name).collect::<Vec<_>>().join(", ");
        format!("kind: found `{kind}`; expected one of {names}")
    })?;
    let mut motion = Motion { kind, ..Motion::EMPTY };
    for coordinate in motion.target.iter_mut().chain(&mut motion.auxiliary) {
        let (name, text) = column();
        let number = text.parse().ok().filter(|number: &f32| number.is_finite());
        *coordinate = number.ok_or_else(|| format!("{name}: found `{text}`; expected a number"))?;
        if name.starts_with("aux") && *coordinate != 0.0 && !motion.kind.has_auxiliary() {
            return Err(format!("{name}: found `{text}`; expected 0, this kind has no point and no force"));
        }
    }
    for number in [&mut motion.velocity, &mut motion.acceleration, &mut motion.approximation] {
        let (name, text) = column();
        *number = whole(name, text, u16::MAX)?;
    }
    for number in [&mut motion.tool, &mut motion.base] {
        let (name, text) = column();
        *number = whole(name, text, HIGHEST_FRAME)?;
    }
    motion.configuration = configuration(&mut columns, motion.kind)?;
    for number in [&mut motion.deceleration, &mut motion.jerk] {
        let Some((name, text)) = columns.next() else { break };
        *number = whole(name, text.trim(), u16::MAX)?;
        if *number > 0 && motion.kind.has_auxiliary() {
            return Err(format!("{name}: found `{number}`; expected 0, this kind has no room for it"));
        }
    }
    Ok(motion)
}

/// Returns how a number with a decimal comma should be written, if one comma too many can be a decimal one; without the number
/// if several can.
fn decimal_comma(header: &str, text: &str) -> String {
    const UNKNOWN: &str = "; write decimals with a point, not a comma";
    let columns: Vec<_> = text.split(',').map(str::trim).collect();
    match columns.len().saturating_sub(header.split(',').count()) {
        1 => (),
        2..=DECIMAL_COLUMNS => return UNKNOWN.to_owned(),
        _ => return String::new(),
    }
    let is_digits = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    let mut candidates = (0..columns.len() - 1).filter_map(|at| {
        let (&[whole, fraction], before) = (columns.get(at..at + 2)?, columns.get(..at)?) else {
            return None;
        };
        if !is_digits(whole.trim_start_matches('-')) || !is_digits(fraction) {
            return None;
        }
        let decimal = format!("{whole}.{fraction}");
        let with_point = [before, &[decimal.as_str()], columns.get(at + 2..)?].concat().join(",");
        parse(header, &with_point).ok().map(|_| format!("; write {decimal}, not {whole},{fraction}"))
    });
    match (candidates.next(), candidates.next()) {
        (Some(advice), None) => advice,
        (advice, _) => advice.map_or_else(String::new, |_| UNKNOWN.to_owned()),
    }
}

/// Reads status and turn, of which both or the turn may be empty.
fn configuration<'t>(
    columns: &mut impl Iterator<Item = (&'t str, &'t str)>,
    kind: MotionKind,
) -> Result<Option<Configuration>, String> {
    let (Some((_, status)), Some((_, turn))) = (columns.next(), columns.next()) else { return Ok(None) };
    let (status, turn) = (status.trim(), turn.trim());
    if status.is_empty() && turn.is_empty() {
        return Ok(None);
    }
    if kind.has_auxiliary() {
        return Err(format!("status: found `{status}`; expected nothing, this kind has no room for it"));
    }
    let status = whole("status", status, Configuration::HIGHEST_STATUS)?;
    let turn = if turn.is_empty() { None } else { Some(whole("turn", turn, u8::MAX)?) };
    Ok(Some(Configuration { status, turn }))
}

fn whole<N>(name: &str, text: &str, highest: N) -> Result<N, String>
where
    N: FromStr + PartialOrd + Display,
{
    let number = text.parse().ok().filter(|number: &N| *number <= highest);
    number.ok_or_else(|| format!("{name}: found `{text}`; expected a whole number from 0 to {highest}"))
}

/// Writes the line that names the columns.
///
/// # Errors
/// Those of the writer.
pub fn write_header(writer: &mut impl Write) -> io::Result<()> {
    writeln!(writer, "{COLUMNS}")
}

/// Writes a motion as one line, from which [`MotionLines`] reads the very same motion.
///
/// # Errors
/// Those of the writer, and [`io::ErrorKind::InvalidInput`] for a motion of no known kind.
pub fn write_motion(writer: &mut impl Write, motion: &Motion) -> io::Result<()> {
    let name = list_name(motion.kind).ok_or_else(|| io::Error::from(io::ErrorKind::InvalidInput))?;
    write!(writer, "{name}")?;
    for coordinate in motion.target.iter().chain(&motion.auxiliary) {
        write!(writer, ",{coordinate}")?;
    }
    let Motion { velocity, acceleration, approximation, tool, base, deceleration, jerk, .. } = motion;
    write!(writer, ",{velocity},{acceleration},{approximation},{tool},{base},")?;
    match motion.configuration {
        Some(Configuration { status, turn: Some(turn) }) => write!(writer, "{status},{turn}")?,
        Some(Configuration { status, turn: None }) => write!(writer, "{status},")?,
        None => write!(writer, ",")?,
    }
    writeln!(writer, ",{deceleration},{jerk}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn refused(lines: &str) -> String {
        MotionLines::new(lines.as_bytes(), "dots.csv").find_map(Result::err).unwrap().to_string()
    }

    fn any_motion() -> impl Strategy<Value = Motion> {
        let coordinate = || -1e6..1e6_f32;
        let numbers = (any::<u16>(), any::<u16>(), any::<u16>(), 0..16_u8, 0..16_u8);
        (
            proptest::sample::select(MotionKind::standard().collect::<Vec<_>>()),
            proptest::array::uniform6(coordinate()),
            proptest::array::uniform3(coordinate()),
            numbers,
            proptest::option::of((0..=Configuration::HIGHEST_STATUS, any::<Option<u8>>())),
            any::<[u16; 2]>(),
        )
            .prop_map(|(kind, target, auxiliary, numbers, configuration, [deceleration, jerk])| {
                let (velocity, acceleration, approximation, tool, base) = numbers;
                let configuration = configuration.map(|(status, turn)| Configuration { status, turn });
                Motion {
                    kind,
                    target,
                    auxiliary: if kind.has_auxiliary() { auxiliary } else { [0.0; 3] },
                    configuration: configuration.filter(|_| !kind.has_auxiliary()),
                    velocity,
                    acceleration,
                    deceleration: if kind.has_auxiliary() { 0 } else { deceleration },
                    jerk: if kind.has_auxiliary() { 0 } else { jerk },
                    approximation,
                    tool,
                    base,
                }
            })
    }

    proptest! {
        #[test]
        fn a_list_gives_back_the_very_motions_that_were_written(
            motions in proptest::collection::vec(any_motion(), 0..20),
        ) {
            let mut text = b"# made by a test\n\n".to_vec();
            write_header(&mut text).unwrap();
            motions.iter().for_each(|motion| write_motion(&mut text, motion).unwrap());
            let read: Result<Vec<_>, _> = MotionLines::new(&text[..], "test").collect();
            prop_assert_eq!(read.unwrap(), motions);
        }

        #[test]
        fn no_text_makes_it_panic(text in ".{0,200}") {
            let list = format!("{COLUMNS}\n{text}\n");
            let _ = MotionLines::new(list.as_bytes(), "test").count();
            let _ = MotionLines::new(text.as_bytes(), "test").count();
        }
    }

    #[test]
    fn the_page_of_lists_names_every_kind() {
        let page = include_str!("../../../docs/applications.md");
        let sentence = page.lines().find(|line| line.starts_with("`kind` is ")).unwrap();
        let (kinds, _) = sentence.split_once(". ").unwrap();
        let documented = kinds.split('`').skip(3).step_by(2);
        assert!(documented.eq(MotionKind::standard().filter_map(list_name)), "{kinds}");
    }

    #[test]
    fn a_list_without_the_optional_columns_is_read_as_before() {
        let list = "kind,x,y,z,a,b,c,aux_x,aux_y,aux_z,velocity,acceleration,approximation,tool,base\n\
                    lin,0,0,30,0,0,180,0,0,0,4463,2500,1000,0,1\n";
        let read: Result<Vec<_>, _> = MotionLines::new(list.as_bytes(), "test").collect();
        let read = read.unwrap();
        assert_eq!((read.len(), read[0].configuration, read[0].base), (1, None, 1));
    }

    #[test]
    fn what_is_no_motion_is_refused_with_line_column_and_expectation() {
        let line = "lin,0,0,30,0,0,180,0,0,0,4463,2500,1000,0,1,2,35,0,7";
        let with = |from: &str, to: &str| refused(&format!("{COLUMNS}\n{}\n", line.replacen(from, to, 1)));
        assert_eq!(
            with("lin", "line"),
            "dots.csv:2: kind: found `line`; expected one of lin, ptp, ptp-joint, circ, spline, lin-force"
        );
        assert_eq!(with("30", "NaN"), "dots.csv:2: z: found `NaN`; expected a number");
        assert_eq!(
            with("4463", "446.3"),
            "dots.csv:2: velocity: found `446.3`; expected a whole number from 0 to 65535"
        );
        assert_eq!(
            with("1000,0,1,", "1000,0,16,"),
            "dots.csv:2: base: found `16`; expected a whole number from 0 to 15"
        );
        assert_eq!(
            with("1000,0,1,2,35,0,7", "1000"),
            format!("dots.csv:2: found 13 columns; a motion has 19: {COLUMNS}")
        );
        assert_eq!(
            with("180,0,", "179,5,0,"),
            format!(
                "dots.csv:2: found 20 columns; a motion has 19: {COLUMNS}; write decimals with a point, not a comma"
            ),
            "the comma may be any of several"
        );
        let circle = "circ,7,8.5,9.5,0.5,1.5,2.5,3.5,4.5,5.5,4463,2500,1000,0,1,,,0,0";
        assert_eq!(
            refused(&format!("{COLUMNS}\n{}\n", circle.replacen("7,", "-7,25,", 1))),
            format!("dots.csv:2: found 20 columns; a motion has 19: {COLUMNS}; write -7.25, not -7,25")
        );
        assert_eq!(
            refused(&format!("{COLUMNS}\n{circle},1\n")),
            format!("dots.csv:2: found 20 columns; a motion has 19: {COLUMNS}"),
            "whole numbers have no decimals"
        );
        assert_eq!(
            with("1,2,35", "1,,35"),
            "dots.csv:2: status: found ``; expected a whole number from 0 to 63"
        );
        assert_eq!(
            with("180,0,", "180,7,"),
            "dots.csv:2: aux_x: found `7`; expected 0, this kind has no point and no force"
        );
        assert_eq!(
            with("lin", "circ"),
            "dots.csv:2: status: found `2`; expected nothing, this kind has no room for it"
        );
        let circle = line.replacen("lin", "circ", 1).replacen("2,35,", ",,", 1);
        assert_eq!(
            refused(&format!("{COLUMNS}\n{circle}\n")),
            "dots.csv:2: jerk: found `7`; expected 0, this kind has no room for it"
        );
        assert_eq!(
            refused("x,y\n"),
            format!("dots.csv:1: found `x,y`; a list starts with the line `{COLUMNS}`")
        );
        assert_eq!(
            refused(""),
            format!("dots.csv:1: the list is empty; it starts with the line `{COLUMNS}`")
        );
        assert_eq!(
            refused(&format!("# {}", "x".repeat(2_000))),
            "dots.csv:1: the line is longer than 1024 bytes"
        );
    }
}
