//! Execution times that were read out of a PLC, as a table of text: `type,repetition,sample_us`, or with `sample_ns`, `sample_ms` or
//! `sample_s` for another unit.
//!
//! Engineering tools and spreadsheets write such tables in several ways. So the separator may be a comma, a semicolon or a tab, the
//! decimal sign a point or, unless it is the separator, a comma; blank lines, quotes and a byte-order mark are skipped; a type is its
//! name or the number that `SB_Core` has for it. Repetitions count from 1, or from 0 as an array does. A time of 0 is not a repetition: so
//! the whole array may be read out.

use std::collections::BTreeMap;

use plc_node::ExecutionType;

use crate::origin::{MeasuredTime, MeasuredType};
use crate::results::PerType;
use crate::sample_unit::SampleUnit;

/// Columns of the table beside that of the times.
const COLUMNS: [&str; 2] = ["type", "repetition"];

/// Longest time in ns: what UDINT holds in µs.
const MAX_NS: f64 = 4_294_967_295e3;

/// Highest repetition of a type.
const MAX_REPETITION: u32 = 1_000_000;

/// Reason why a table is refused.
#[derive(Clone, PartialEq, Debug, thiserror::Error)]
pub enum ImportError {
    /// The first line does not name the columns.
    #[error(
        "the first line is `{0}`: expected the columns type, repetition and sample_us; sample_ns, sample_ms or sample_s for times in \
         another unit"
    )]
    Head(String),
    /// The first line names times of several units.
    #[error("the table has the columns {0} and {1}: leave one of them")]
    TwoUnits(&'static str, &'static str),
    /// A line lacks a column, or has too many.
    #[error("line {line} has {found} fields, the first line {expected}: give each sample a line")]
    Fields {
        /// Number of the line, from 1.
        line: usize,
        /// Fields in it.
        found: usize,
        /// Fields of the first line.
        expected: usize,
    },
    /// A value is wrong.
    #[error("line {line}: {column} is `{value}`: expected {expected}")]
    Value {
        /// Number of the line, from 1.
        line: usize,
        /// The column.
        column: &'static str,
        /// The value.
        value: String,
        /// What it must be.
        expected: &'static str,
    },
    /// A repetition is there twice.
    #[error(
        "line {line}: {execution_type} repetition {repetition} is there twice: give each repetition once"
    )]
    Twice {
        /// Number of the line, from 1.
        line: usize,
        /// The type, in capitals.
        execution_type: String,
        /// The repetition.
        repetition: u32,
    },
    /// A repetition is missing.
    #[error(
        "{execution_type} has repetitions up to {last}, but not {missing}: read the samples out again, or number them anew"
    )]
    Missing {
        /// The type, in capitals.
        execution_type: String,
        /// First missing repetition.
        missing: u32,
        /// Last repetition that is there.
        last: u32,
    },
    /// There are no samples.
    #[error("the table has no samples: expected a line such as rc,1,3725000")]
    Empty,
}

/// A table whose head was read.
#[derive(Debug)]
struct SampleTable {
    separator: char,
    /// Number of columns, and where type, repetition and time are.
    width: usize,
    places: [usize; 3],
    unit: SampleUnit,
}

impl SampleTable {
    fn of(head: &str) -> Result<Self, ImportError> {
        let wrong = || ImportError::Head(shortened(head.trim()));
        let mut separators = [';', '\t', ','].into_iter();
        let separator = separators.find(|separator| head.contains(*separator)).ok_or_else(wrong)?;
        let names: Vec<_> = fields(head, separator).map(str::to_ascii_lowercase).collect();
        let place = |column: &str| names.iter().position(|name| name == column);
        let mut units = SampleUnit::ALL.into_iter().filter(|unit| place(unit.column()).is_some());
        let unit = units.next().ok_or_else(wrong)?;
        if let Some(other) = units.next() {
            return Err(ImportError::TwoUnits(unit.column(), other.column()));
        }
        let [kind, repetition] = COLUMNS.map(place);
        let places = kind.zip(repetition).zip(place(unit.column())).ok_or_else(wrong)?;
        let ((kind, repetition), time) = places;
        Ok(Self { separator, width: names.len(), places: [kind, repetition, time], unit })
    }
}

fn fields(line: &str, separator: char) -> impl Iterator<Item = &str> {
    line.split(separator).map(|field| field.trim().trim_matches('"').trim())
}

/// A table that was read.
#[derive(Clone, PartialEq, Debug)]
pub struct ImportedSamples {
    /// Unit of its times.
    pub unit: SampleUnit,
    /// Its times by type, in order of the repetitions.
    pub types: PerType<MeasuredType>,
}

/// Reads a table of samples.
///
/// # Errors
///
/// Something in it is missing, twice or wrong.
pub fn parse(text: &str) -> Result<ImportedSamples, ImportError> {
    let text = text.strip_prefix('\u{FEFF}').unwrap_or(text);
    let mut lines = (1..).zip(text.lines()).filter(|(_, line)| !line.trim().is_empty());
    let Some((_, head)) = lines.next() else { return Err(ImportError::Empty) };
    let table = SampleTable::of(head)?;
    let mut samples = BTreeMap::<ExecutionType, BTreeMap<u32, f64>>::new();
    for (line, text) in lines {
        let values: Vec<_> = fields(text, table.separator).collect();
        if values.iter().all(|value| value.is_empty()) {
            continue;
        }
        if values.len() != table.width {
            return Err(ImportError::Fields { line, found: values.len(), expected: table.width });
        }
        let [kind, repetition, time] =
            table.places.map(|place| values.get(place).copied().unwrap_or_default());
        let execution_type = read_type(line, kind)?;
        let repetition = read_repetition(line, repetition)?;
        let nanos = read_time(line, time, &table)?;
        if nanos == 0.0 {
            // An element of the array that no repetition has filled.
            continue;
        }
        if samples.entry(execution_type).or_default().insert(repetition, nanos).is_some() {
            return Err(ImportError::Twice { line, execution_type: capitals(execution_type), repetition });
        }
    }
    let mut types = PerType::default();
    for (execution_type, of_type) in samples {
        *types.entry(execution_type) = Some(in_order(execution_type, &of_type)?);
    }
    if types == PerType::default() {
        return Err(ImportError::Empty);
    }
    Ok(ImportedSamples { unit: table.unit, types })
}

/// Returns the samples of a type in order, none of them missing.
fn in_order(
    execution_type: ExecutionType,
    samples: &BTreeMap<u32, f64>,
) -> Result<MeasuredType, ImportError> {
    let first = u32::from(!samples.contains_key(&0));
    let last = samples.keys().next_back().copied().unwrap_or_default();
    let mut repetitions = Vec::with_capacity(samples.len());
    for (wanted, (found, nanos)) in (first..).zip(samples) {
        if *found != wanted {
            let execution_type = capitals(execution_type);
            return Err(ImportError::Missing { execution_type, missing: wanted, last });
        }
        // Whole nanoseconds, as all samples are.
        let execution_ms = nanos.round() / 1e6;
        repetitions.push(Ok(MeasuredTime {
            execution_ms,
            robot_execution_ms: None,
            blends_suppressed: None,
        }));
    }
    Ok(MeasuredType { repetitions })
}

fn read_type(line: usize, value: &str) -> Result<ExecutionType, ImportError> {
    match value.to_ascii_lowercase().as_str() {
        "rc" | "1" => Ok(ExecutionType::Rc),
        "sm" | "2" => Ok(ExecutionType::Sm),
        "cm" | "3" => Ok(ExecutionType::Cm),
        _ => Err(wrong(line, COLUMNS[0], value, "RC, SM, CM, or 1, 2, 3")),
    }
}

fn read_repetition(line: usize, value: &str) -> Result<u32, ImportError> {
    let number = value.parse().ok().filter(|number| *number <= MAX_REPETITION);
    number.ok_or_else(|| wrong(line, COLUMNS[1], value, "a whole number, from 1 to 1,000,000"))
}

/// Reads a time. Returns ns.
fn read_time(line: usize, value: &str, table: &SampleTable) -> Result<f64, ImportError> {
    let is_decimal = table.separator != ',' && value.matches(',').count() == 1 && !value.contains('.');
    let text = if is_decimal { value.replace(',', ".") } else { value.to_owned() };
    let number = text.parse().ok().map(|number: f64| number * table.unit.nanos());
    let nanos = number.filter(|nanos| *nanos >= 0.0 && *nanos <= MAX_NS);
    nanos.ok_or_else(|| wrong(line, table.unit.column(), value, table.unit.range()))
}

fn wrong(line: usize, column: &'static str, value: &str, expected: &'static str) -> ImportError {
    ImportError::Value { line, column, value: shortened(value), expected }
}

/// Returns a text for a message.
fn shortened(text: &str) -> String {
    const LONGEST: usize = 60;
    let short: String = text.chars().take(LONGEST).collect();
    if short.len() < text.len() { short + "…" } else { short }
}

fn capitals(execution_type: ExecutionType) -> String {
    execution_type.to_string().to_uppercase()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn times(text: &str) -> Result<Vec<(ExecutionType, Vec<f64>)>, String> {
        let types = parse(text).map_err(|error| error.to_string())?.types;
        let of = |one| Some((one, types.get(one)?));
        let all = ExecutionType::ALL.into_iter().filter_map(of);
        let ms = |measured: &MeasuredType| {
            measured.repetitions.iter().flatten().map(|one| one.execution_ms).collect()
        };
        Ok(all.map(|(one, measured)| (one, ms(measured))).collect())
    }

    #[test]
    fn tables_of_spreadsheets_and_of_arrays_are_read() {
        use ExecutionType::{Cm, Rc};
        let expected = Ok(vec![(Rc, vec![3725.0, 3726.5]), (Cm, vec![3729.0005])]);
        assert_eq!(
            times("type,repetition,sample_us\nrc,1,3725000\nrc,2,3726500\ncm,1,3729000.5\n"),
            expected
        );
        let german = "\u{FEFF}Sample_us;Type;Repetition;note\r\n\r\n\"3726500\";1;1;\r\n3725000,0;RC;0;x\r\n3729000,5;3;0;\r\n0;3;1;\r\n;;;\r\n";
        assert_eq!(times(german), expected);
        assert_eq!(
            times("type\trepetition\tsample_us\nCM\t1\t3729000,5\nRC\t1\t3725000\nRC\t2\t3726500"),
            expected
        );
    }

    #[test]
    fn the_name_of_the_column_says_the_unit_of_its_times() {
        let expected = Ok(vec![(ExecutionType::Rc, vec![3725.0005, 3726.5])]);
        for (column, first, second) in [
            ("sample_ns", "3725000500", "3726500000"),
            ("sample_us", "3725000.5", "3726500"),
            ("Sample_ms", "3725.0005", "3.7265e3"),
            ("SAMPLE_S", "3.7250005", "3.7265"),
        ] {
            assert_eq!(
                times(&format!("repetition,type,{column}\n1,rc,{first}\n2,rc,{second}\n")),
                expected,
                "{column}"
            );
        }
        assert_eq!(times("type;repetition;sample_s\nRC;1;3,7250005\nRC;2;3,7265\n"), expected);
    }

    #[test]
    fn what_is_wrong_with_a_table_is_said_with_its_line() {
        let wrong = [
            "",
            "type,repetition,sample_us\n",
            "rc,1,3725000\n",
            "type,repetition,sample_us\nrc,1\n",
            "type,repetition,sample_us\nxx,1,3725000\n",
            "type,repetition,sample_us\nrc,-1,3725000\n",
            "type,repetition,sample_us\nrc,1,0\n",
            "type;repetition;sample_us\nrc;1;3.725.000\n",
            "type,repetition,sample_us\nrc,1,inf\n",
            "type,repetition,sample_s\nrc,1,4295\n",
            "type,repetition,sample\nrc,1,3725\n",
            "type,repetition,sample_ms,sample_us\nrc,1,3725,3725000\n",
            "type,repetition,sample_us\nrc,1,1000\nRC,1,1000\n",
            "type,repetition,sample_us\nsm,1,1000\nsm,2,1000\nsm,3,0\nsm,4,1000\nsm,5,1000\nsm,6,0\n",
            "type,repetition,sample_us\nsm,2,1000\nsm,3,1000\n",
        ];
        let said: Vec<_> = wrong.into_iter().map(|text| times(text).unwrap_err()).collect();
        insta::assert_snapshot!(said.join("\n"), @r"
        the table has no samples: expected a line such as rc,1,3725000
        the table has no samples: expected a line such as rc,1,3725000
        the first line is `rc,1,3725000`: expected the columns type, repetition and sample_us; sample_ns, sample_ms or sample_s for times in another unit
        line 2 has 2 fields, the first line 3: give each sample a line
        line 2: type is `xx`: expected RC, SM, CM, or 1, 2, 3
        line 2: repetition is `-1`: expected a whole number, from 1 to 1,000,000
        the table has no samples: expected a line such as rc,1,3725000
        line 2: sample_us is `3.725.000`: expected a time in µs, up to 4,294,967,295
        line 2: sample_us is `inf`: expected a time in µs, up to 4,294,967,295
        line 2: sample_s is `4295`: expected a time in s, up to 4,294.967295
        the first line is `type,repetition,sample`: expected the columns type, repetition and sample_us; sample_ns, sample_ms or sample_s for times in another unit
        the table has the columns sample_us and sample_ms: leave one of them
        line 3: RC repetition 1 is there twice: give each repetition once
        SM has repetitions up to 5, but not 3: read the samples out again, or number them anew
        SM has repetitions up to 3, but not 1: read the samples out again, or number them anew
        ");
    }
}
