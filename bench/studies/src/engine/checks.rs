//! Values of a study's file, checked before anything runs.

use anyhow::Context as _;

use super::axis::Axis;
use super::file::{self, RowFigure, Scalar, StudyFile};
use super::key::SetupKeys;
use records::faults::{self, Fault};
use setup::Cell;

/// Most repetitions of a job, as of a run.
const MOST_REPETITIONS: u32 = 100_000;

/// Checks what stands in the file alone.
pub(super) fn check(file: &StudyFile) -> anyhow::Result<()> {
    let StudyFile { schema, study, .. } = file;
    if *schema != file::SCHEMA {
        anyhow::bail!("`schema` = {schema}: this program reads studies of version {}", file::SCHEMA);
    }
    if !(1..=MOST_REPETITIONS).contains(&study.reps) {
        anyhow::bail!("`study.reps` = {}: must be 1 to {MOST_REPETITIONS}", study.reps);
    }
    if study.types.is_empty() {
        anyhow::bail!("`study.types` is empty; name rc, sm or cm, or leave it out for all three");
    }
    Ok(())
}

/// Returns the figures in the rows, the usual ones first, and checks those that are asked for and looked for.
pub(super) fn figures(file: &StudyFile, cell: &Cell) -> anyhow::Result<Vec<RowFigure>> {
    let (name, count) = (&cell.name, cell.stations.len());
    let mut columns = RowFigure::USUAL.to_vec();
    if !cell.is_one() {
        columns.extend(RowFigure::OF_CELL);
    }
    for figure in &file.record.figures {
        let column = figure.column();
        if cell.is_one() && RowFigure::OF_CELL.contains(figure) {
            anyhow::bail!(
                "`record.figures` {column}: needs several stations, and setup {name} has one; remove it"
            );
        }
        if !cell.is_one() && figure.is_of_one_robot() {
            anyhow::bail!(
                "`record.figures` {column}: needs a setup of one robot, and setup {name} has {count} stations; remove it"
            );
        }
        if !columns.contains(figure) {
            columns.push(*figure);
        }
    }
    for finding in &file.finding {
        let name = finding.figure.column();
        if finding.above.is_some() == finding.below.is_some() {
            anyhow::bail!("[[finding]] `{name}`: give exactly one of `above` and `below`");
        }
        if !columns.contains(&finding.figure) {
            anyhow::bail!("[[finding]] `{name}`: not in the rows; add it to `record.figures`");
        }
    }
    Ok(columns)
}

/// Checks that the setup can have these faults, which with several stations name theirs.
pub(super) fn check_faults(faults: &[Fault], cell: &Cell) -> anyhow::Result<()> {
    match cell.stations.as_slice() {
        [station] if cell.is_one() => Ok(faults::check(faults, &cell.setup_of(station))?),
        _ => Ok(faults::check_cell(faults, cell)?),
    }
}

/// Checks the varied keys and their values.
pub(super) fn axes(file: &StudyFile, keys: &SetupKeys) -> anyhow::Result<Vec<Axis>> {
    let mut axes: Vec<Axis> = Vec::new();
    for variation in &file.vary {
        let axis = Axis::of(variation, keys)?;
        if axes.iter().any(|other| other.path == axis.path) {
            anyhow::bail!("[[vary]] `{}`: varied twice; put all its values into one section", axis.path);
        }
        let within = |part: &Axis, whole: &Axis| {
            part.path.strip_prefix(&whole.path).is_some_and(|rest| rest.starts_with('.'))
        };
        if let Some(other) = axes.iter().find(|other| within(other, &axis) || within(&axis, other)) {
            let [part, whole] =
                if within(other, &axis) { [&other.path, &axis.path] } else { [&axis.path, &other.path] };
            anyhow::bail!("[[vary]] `{part}`: a part of `{whole}`, which is varied too; remove one of them");
        }
        if axis.key.is_none() {
            let texts = variation.values.iter().flatten().filter_map(Scalar::text);
            texts.map(parsed_faults).try_for_each(|faults| faults.map(drop))?;
        }
        axes.push(axis);
    }
    Ok(axes)
}

/// Parses faults that are separated by blanks or commas.
pub(super) fn parsed_faults(text: &str) -> anyhow::Result<Vec<Fault>> {
    Ok(node::list::values(text).map(str::parse).collect::<Result<_, _>>()?)
}

/// Parses `1..=1000` or a single number.
pub(super) fn seeds(text: &str) -> anyhow::Result<(u64, u64)> {
    let number = |text: &str| text.trim().replace('_', "").parse::<u64>();
    let bounds = match text.split_once("..=") {
        Some((first, last)) => number(first).ok().zip(number(last).ok()),
        None => number(text).ok().map(|seed| (seed, seed)),
    };
    // The number of seeds must fit, too.
    let is_usable = |(first, last): &(u64, u64)| first <= last && last - first < u64::MAX;
    bounds.filter(is_usable).with_context(|| {
        format!(
            "`study.seeds` = \"{text}\": expected a number, or two such as \"1..=1000\", the lower one first"
        )
    })
}
