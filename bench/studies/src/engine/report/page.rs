//! The page of a report.

use records::counted::counted;
use report::html::document::fill_with;
use report::html::figure::{Data, Figure};
use serde::Serialize;

use super::effects::{EffectLevel, FigureEffect, KeyEffects, WithMargin};
use super::{StudyReport, picture};
use crate::engine::identify::{Identification, KeyPair, ModelVariant};

const TEMPLATE: &str = include_str!("page.html");
const TABLE: &str = include_str!("table.html");

/// Variants whose posterior has pictures.
const DRAWN_VARIANTS: usize = 2;

#[derive(Serialize)]
struct ReportPage {
    setup: String,
    title: String,
    conditions: String,
    sentences: Vec<String>,
    keys: Vec<KeySection>,
    variants: Vec<PageTable>,
    models: Vec<ModelSection>,
    constant: Vec<String>,
}

#[derive(Serialize)]
struct KeySection {
    key: String,
    /// Meaning of its intervals.
    about: &'static str,
    figures: Vec<Figure>,
    tables: Vec<PageTable>,
}

#[derive(Serialize)]
struct ModelSection {
    name: String,
    about: String,
    figures: Vec<Figure>,
    tables: Vec<PageTable>,
}

#[derive(Serialize)]
struct PageTable {
    about: &'static str,
    columns: Vec<String>,
    rows: Vec<Vec<String>>,
}

impl PageTable {
    fn new(about: &'static str, columns: &[&str], rows: Vec<Vec<String>>) -> Self {
        Self { about, columns: columns.iter().map(|one| (*one).to_owned()).collect(), rows }
    }
}

/// Returns the page as HTML.
pub(super) fn page(report: &StudyReport) -> anyhow::Result<String> {
    let identification = report.identification.as_ref();
    let models = identification.map_or_else(|| Ok(Vec::new()), models)?;
    let page = ReportPage {
        setup: report.setup.clone(),
        title: report.title.clone(),
        conditions: format!(
            "Setup {} · {} of {} jobs, {} did not pass · virtual mode · program {}",
            report.setup, report.done, report.jobs, report.not_passed, report.program
        ),
        sentences: sentences(report),
        keys: report.effects.iter().map(key_section).collect::<anyhow::Result<_>>()?,
        variants: identification.map(variants).into_iter().collect(),
        models,
        constant: report.constant.clone(),
    };
    fill_with(TEMPLATE, &[("table.html", TABLE)], &page)
}

/// Returns the result in sentences.
pub(super) fn sentences(report: &StudyReport) -> Vec<String> {
    let mut sentences = vec![format!(
        "{} of {} are done, {} did not pass.",
        report.done,
        counted(usize::try_from(report.jobs).unwrap_or(usize::MAX), "job"),
        report.not_passed
    )];
    for effects in &report.effects {
        sentences.extend(largest(effects));
    }
    sentences.extend(report.not_identified.clone());
    let Some(found) = &report.identification else { return sentences };
    if let Some(best) = best(found) {
        let name = variant_name(best);
        if found.variants.len() > 1 {
            sentences.push(format!(
                "Of {} variants of the model, {name} has the highest evidence: probability {}.",
                found.variants.len(),
                number(best.probability)
            ));
        }
        for key in &best.posterior {
            let [from, to] = key.interval.map(number);
            sentences.push(format!(
                "{}: {} ({from} to {to}), {}.",
                key.key,
                number(key.mean),
                key.knowledge.text()
            ));
        }
        sentences.extend(best.pairs.iter().map(pair_sentence));
        let outside: Vec<&str> =
            best.predicted.iter().filter(|one| !one.is_within).map(|one| one.figure.as_str()).collect();
        let all = best.predicted.len();
        sentences.push(match outside.as_slice() {
            [] => format!("Each of the paper's {all} figures is where the other figures predict it."),
            some => format!(
                "Of the paper's {all} figures, {} not where the others predict: {}.",
                if some.len() == 1 { "1 is" } else { "these are" },
                some.join(", ")
            ),
        });
    }
    sentences
}

fn pair_sentence(KeyPair { keys: [first, second], correlation }: &KeyPair) -> String {
    format!(
        "Only a combination of {first} and {second} is known: their correlation is {}.",
        number(*correlation)
    )
}

/// Returns the largest effect of a key on an execution time.
fn largest(effects: &KeyEffects) -> Option<String> {
    let of = |figure: &FigureEffect| {
        let change = match figure.slope {
            Some(slope) => slope.over_range,
            None => figure.levels.last()?.change?,
        };
        (figure.figure == "AET")
            .then(|| (figure.execution_type.clone().unwrap_or_default().to_uppercase(), change))
    };
    let changes: Vec<_> = effects.figures.iter().filter_map(of).collect();
    let shown: Vec<String> =
        changes.iter().map(|(name, change)| format!("{name} {} ms", with_margin(change))).collect();
    let over = if effects.is_drawn {
        "from the lower to the upper bound"
    } else {
        "from the first to the last value"
    };
    (!shown.is_empty()).then(|| format!("{}, {over}: {}.", effects.key, shown.join(", ")))
}

fn key_section(effects: &KeyEffects) -> anyhow::Result<KeySection> {
    let mut figures = Vec::new();
    let mut names: Vec<&str> = effects.figures.iter().map(|effect| effect.figure).collect();
    names.dedup();
    for name in names {
        let of_figure: Vec<&FigureEffect> = effects.figures.iter().filter(|one| one.figure == name).collect();
        let data = data(&effects.key, &of_figure);
        figures.extend(picture::by_key(&effects.key, &of_figure)?.map(|figure| figure.with(data)));
    }
    let slope = |effect: &FigureEffect| {
        let slope = effect.slope?;
        let unit = effect.unit.to_owned();
        Some(vec![name(effect), unit, with_margin(&slope.over_range), with_margin(&slope.for_one)])
    };
    let slopes: Vec<_> = effects.figures.iter().filter_map(slope).collect();
    let columns = ["figure", "unit", "from the lower to the upper bound", "for one unit of the key"];
    Ok(KeySection {
        key: effects.key.clone(),
        about: if effects.is_drawn {
            "Means in ten equal parts of the range, with 95 % intervals over the seeds. The table has the straight line through the jobs, with the other drawn keys taken out."
        } else {
            "Means at each value, with 95 % intervals over the seeds. The change is that between jobs with the same seed and the same other values, so its interval is narrower."
        },
        figures,
        tables: if slopes.is_empty() {
            Vec::new()
        } else {
            vec![PageTable::new("Change of each figure:", &columns, slopes)]
        },
    })
}

fn name(effect: &FigureEffect) -> String {
    let of_type = effect.execution_type.as_ref().map(|name| format!("{} ", name.to_uppercase()));
    format!("{}{}", of_type.unwrap_or_default(), effect.figure)
}

fn data(key: &str, effects: &[&FigureEffect]) -> Data {
    let head = [key, "figure", "jobs", "mean", "change"].map(str::to_owned);
    let row = |effect: &FigureEffect, level: &EffectLevel| {
        let change = level.change.as_ref().map_or_else(String::new, with_margin);
        let mean = with_margin(&level.mean);
        vec![level.value.clone(), name(effect), level.jobs.to_string(), mean, change]
    };
    let rows = effects.iter().flat_map(|effect| effect.levels.iter().map(move |level| row(effect, level)));
    Data::new(head.into(), rows.collect())
}

fn best(found: &Identification) -> Option<&ModelVariant> {
    found.variants.iter().max_by(|one, other| one.log_evidence.total_cmp(&other.log_evidence))
}

fn variant_name(variant: &ModelVariant) -> String {
    let values: Vec<String> = variant.values.iter().map(|(key, value)| format!("{key} = {value}")).collect();
    if values.is_empty() { "the model".to_owned() } else { values.join(", ") }
}

fn variants(found: &Identification) -> PageTable {
    let best = best(found).map_or(0.0, |variant| variant.log_evidence);
    let row = |variant: &ModelVariant| {
        vec![
            variant_name(variant),
            variant.jobs.to_string(),
            variant.degree.to_string(),
            number(variant.log_evidence - best),
            number(variant.probability),
        ]
    };
    let columns = ["variant", "jobs", "degree", "log evidence, from the best", "probability"];
    PageTable::new("", &columns, found.variants.iter().map(row).collect())
}

fn models(found: &Identification) -> anyhow::Result<Vec<ModelSection>> {
    let mut sorted: Vec<&ModelVariant> = found.variants.iter().collect();
    sorted.sort_by(|one, other| other.log_evidence.total_cmp(&one.log_evidence));
    let section = |(index, variant): (usize, &&ModelVariant)| {
        let mut figures = Vec::new();
        if index < DRAWN_VARIANTS {
            figures.extend(picture::posteriors(&found.priors, variant)?);
            let column = |key: &String| found.priors.iter().position(|prior| prior.key == *key);
            for KeyPair { keys: [first, second], .. } in &variant.pairs {
                if let Some(keys) = column(first).zip(column(second)) {
                    figures.extend(picture::pair(&found.priors, variant, keys.into())?);
                }
            }
        }
        let pairs: Vec<String> = variant.pairs.iter().map(pair_sentence).collect();
        let tables = vec![posterior_table(found, variant), predicted_table(variant)];
        Ok(ModelSection { name: variant_name(variant), about: pairs.join(" "), figures, tables })
    };
    sorted.iter().enumerate().map(section).collect()
}

fn posterior_table(found: &Identification, variant: &ModelVariant) -> PageTable {
    let row =
        |(prior, key): (&crate::engine::identify::DrawnPrior, &crate::engine::identify::KeyPosterior)| {
            let interval = |[from, to]: [f64; 2]| format!("{} to {}", number(from), number(to));
            vec![
                key.key.clone(),
                interval(prior.interval),
                number(key.mean),
                interval(key.interval),
                number(key.ratio),
                key.knowledge.text().to_owned(),
            ]
        };
    let columns = ["key", "prior, 95 %", "mean", "posterior, 95 %", "deviation by the prior's", "so"];
    PageTable::new("", &columns, found.priors.iter().zip(&variant.posterior).map(row).collect())
}

fn predicted_table(variant: &ModelVariant) -> PageTable {
    let row = |one: &crate::engine::identify::PredictedFigure| {
        let [from, to] = one.interval_ms.map(number);
        vec![
            one.figure.clone(),
            number(one.paper_ms),
            number(one.predicted_ms),
            format!("{from} to {to}"),
            number(one.deviations),
            if one.is_within { "within" } else { "outside" }.to_owned(),
        ]
    };
    let columns = ["figure", "paper, ms", "predicted, ms", "95 %", "deviations", "so"];
    PageTable::new(
        "Each of the paper's figures, predicted from its other figures:",
        &columns,
        variant.predicted.iter().map(row).collect(),
    )
}

fn with_margin(value: &WithMargin) -> String {
    let Some(margin) = value.margin else { return number(value.value) };
    // Both have the same form, so that they can be compared.
    if value.value.abs() < 1.0 && (is_tiny(value.value) || is_tiny(margin)) {
        return format!("{} ± {}", in_powers(value.value), in_powers(margin));
    }
    format!("{} ± {}", number(value.value), number(margin))
}

/// Returns whether three decimal places show too few digits of a number.
fn is_tiny(value: f64) -> bool {
    value != 0.0 && value.abs() < 0.001
}

/// Formats a number as a power of ten with two digits.
fn in_powers(value: f64) -> String {
    if value == 0.0 { "0".to_owned() } else { format!("{value:.1e}").replace('-', "−") }
}

/// Formats a number with four digits, or as a whole one.
fn number(value: f64) -> String {
    let size = value.abs();
    let places = if size >= 1_000.0 {
        0
    } else if size >= 100.0 {
        1
    } else if size >= 10.0 {
        2
    } else {
        3
    };
    if is_tiny(value) { in_powers(value) } else { format!("{value:.places$}").replace('-', "−") }
}
