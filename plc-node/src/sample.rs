//! What the PLC does in one scan, and its columns in a trace.

use std::fmt::Write as _;

use node::trace_row::{Fields, TraceSample};

/// What the PLC does in one scan.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct Sample {
    /// Scans since the node started.
    pub scan: u64,
    /// Number of the last command.
    pub command: u16,
    /// Total motions of the skill: `totalNo`.
    pub total: u32,
    /// Motions of the skill written into the slots so far.
    pub written: u32,
    /// Motions in the slots that the robot has not executed yet, 0..=5.
    pub in_slots: u32,
    /// Images of the robot that the PLC refused so far, because a byte was altered.
    pub altered: u64,
    /// Marks, at which arms wait for each other, that the arm has come to in this run.
    pub marks_come: u32,
    /// Marks that it has passed; fewer than it has come to while it waits.
    pub marks_passed: u32,
}

impl TraceSample for Sample {
    const COLUMNS: &'static str = "scan,command,total,written,in_slots,altered,marks_come,marks_passed";
    const ADDED: &'static str = ",marks_come,marks_passed";

    fn write(&self, line: &mut String) {
        let Self { scan, command, total, written, in_slots, altered, marks_come, marks_passed } = self;
        let _ = write!(
            line,
            "{scan},{command},{total},{written},{in_slots},{altered},{marks_come},{marks_passed}"
        );
    }

    fn read(fields: &mut Fields<'_>) -> Option<Self> {
        Some(Self {
            scan: fields.value()?,
            command: fields.value()?,
            total: fields.value()?,
            written: fields.value()?,
            in_slots: fields.value()?,
            altered: fields.value()?,
            // Older versions do not have them.
            marks_come: fields.text().map_or(Some(0), |value| value.parse().ok())?,
            marks_passed: fields.text().map_or(Some(0), |value| value.parse().ok())?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_column_has_a_name_and_is_read_as_it_was_written() {
        let sample = Sample {
            scan: 812,
            command: 3,
            total: 13,
            written: 6,
            in_slots: 5,
            altered: 2,
            marks_come: 2,
            marks_passed: 1,
        };
        let mut line = String::new();
        sample.write(&mut line);
        assert_eq!(line.split(',').count(), Sample::COLUMNS.split(',').count());
        assert_eq!(Fields::of(&line).sample(), Some(sample));
    }
}
