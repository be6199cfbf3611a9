//! The lines of `samples.csv`, read back.

use plc_node::ExecutionType;

/// A repetition. Columns that an older version did not write are `None`.
#[derive(Clone, PartialEq, Debug)]
pub(super) struct Row {
    pub(super) execution_type: ExecutionType,
    /// Its number among the repetitions of its type, counted from 1.
    pub(super) repetition: u32,
    /// Its station, in a run of several.
    pub(super) station: Option<String>,
    pub(super) execution_ms: Option<f64>,
    pub(super) robot_execution_ms: Option<f64>,
    pub(super) blends_suppressed: Option<f64>,
    pub(super) plc_missed: Option<f64>,
    pub(super) robot_missed: Option<f64>,
    /// Why it failed, if it did.
    pub(super) error: Option<String>,
}

impl Row {
    /// Returns what messages call it.
    pub(super) fn name(&self) -> String {
        format!("{} {}", self.execution_type.to_string().to_uppercase(), self.repetition)
    }
}

/// All complete lines, and what is wrong with the first that is not.
#[derive(Debug)]
pub(super) struct Rows {
    pub(super) rows: Vec<Row>,
    /// What is wrong with the first line that is not a repetition; the lines after it are not read.
    pub(super) broken: Option<String>,
}

impl Rows {
    /// Reads the text of the file.
    pub(super) fn parse(text: &str) -> Self {
        let mut lines = text.split_inclusive('\n').enumerate();
        let head = lines.next().map(|(_, head)| fields(head.trim_end())).unwrap_or_default();
        let mut rows = Vec::new();
        for (index, line) in lines {
            match line.strip_suffix('\n').and_then(|line| row(&head, line)) {
                Some(row) => rows.push(row),
                None => {
                    let broken = Some(format!("line {} is not a complete repetition", index + 1));
                    return Self { rows, broken };
                }
            }
        }
        Self { rows, broken: None }
    }

    /// Leaves the lines of a station, and those of failed repetitions, which are of all stations.
    pub(super) fn of_station(mut self, name: &str) -> Self {
        self.rows.retain(|row| row.error.is_some() || row.station.as_deref() == Some(name));
        self
    }
}

fn row(head: &[String], line: &str) -> Option<Row> {
    let fields = fields(line);
    if fields.len() != head.len() {
        return None;
    }
    let text = |name: &str| {
        let index = head.iter().position(|column| column == name)?;
        fields.get(index).filter(|field| !field.is_empty())
    };
    // A number that is no number makes the line a broken one.
    let number = |name: &str| text(name).map_or(Some(None), |field| field.parse().ok().map(Some));
    let kind = text("type")?;
    let row = Row {
        execution_type: ExecutionType::ALL.into_iter().find(|one| one.to_string() == *kind)?,
        repetition: text("repetition")?.parse().ok()?,
        station: text("station").cloned(),
        execution_ms: number("execution_ms")?,
        robot_execution_ms: number("robot_execution_ms")?,
        blends_suppressed: number("blends_suppressed")?,
        plc_missed: number("plc_missed")?,
        robot_missed: number("robot_missed")?,
        error: text("error").cloned(),
    };
    (row.execution_ms.is_some() || row.error.is_some()).then_some(row)
}

/// Splits a line at its commas. A field in quotes may have commas, and quotes that are doubled.
fn fields(line: &str) -> Vec<String> {
    let mut fields = vec![String::new()];
    let mut is_quoted = false;
    let mut characters = line.chars().peekable();
    while let Some(character) = characters.next() {
        let Some(field) = fields.last_mut() else { break };
        match character {
            '"' if is_quoted && characters.next_if_eq(&'"').is_some() => field.push('"'),
            '"' => is_quoted = !is_quoted,
            ',' if !is_quoted => fields.push(String::new()),
            other => field.push(other),
        }
    }
    fields
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEAD: &str =
        "type,repetition,execution_ms,robot_execution_ms,blends_suppressed,plc_missed,robot_missed,error\n";

    #[test]
    fn a_failed_repetition_has_its_error_with_commas_and_quotes() {
        let text =
            format!("{HEAD}sm,2,,,,,,\"the robot said \"\"no\"\", and stopped\"\nrc,3,3720.5,3716,0,0,1,\n");
        let Rows { rows, broken } = Rows::parse(&text);
        assert_eq!(broken, None);
        assert_eq!(rows[0].error.as_deref(), Some("the robot said \"no\", and stopped"));
        assert_eq!((rows[0].name().as_str(), rows[0].execution_ms), ("SM 2", None));
        assert_eq!(
            (rows[1].execution_ms, rows[1].robot_missed, &rows[1].error),
            (Some(3720.5), Some(1.0), &None)
        );
    }

    #[test]
    fn a_line_that_is_cut_anywhere_is_broken_and_the_lines_before_it_are_read() {
        let line = "rc,2,3728,3724,0,0,0,\n";
        for cut in 1..line.len() {
            let text = format!("{HEAD}rc,1,3720,3716,0,0,0,\n{}", &line[..cut]);
            let Rows { rows, broken } = Rows::parse(&text);
            assert_eq!(rows.len(), 1, "{text}");
            assert_eq!(broken.as_deref(), Some("line 3 is not a complete repetition"));
        }
    }

    #[test]
    fn columns_are_found_by_their_names() {
        let text = "type,repetition,execution_ms,positions,error\ncm,1,3727,drives,\n";
        let Rows { rows, .. } = Rows::parse(text);
        assert_eq!((rows[0].execution_ms, rows[0].robot_execution_ms), (Some(3727.0), None));
    }
}
