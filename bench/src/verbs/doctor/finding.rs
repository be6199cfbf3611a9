//! Findings of checks, and their table.

use anyhow::Context as _;
use node::screen;
use records::exit::Failure;
use report::outln;
use serde::Serialize;

/// Verdict on one requirement.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Verdict {
    /// Real mode has what it needs.
    Good,
    /// Real mode runs, but its figures get worse.
    Limited,
    /// Real mode does not run.
    Missing,
    /// It could not be judged, since nothing of it was seen.
    NotSeen,
}

/// Result of checking one requirement.
#[derive(Clone, PartialEq, Eq, Debug, Serialize)]
pub(super) struct Finding {
    /// The requirement.
    pub(super) what: &'static str,
    /// The verdict on it.
    pub(super) verdict: Verdict,
    /// Value or state that was found.
    pub(super) found: String,
    /// Remedy; null if there is nothing to do.
    pub(super) fix: Option<String>,
}

impl Finding {
    pub(super) fn good(what: &'static str, found: impl Into<String>) -> Self {
        Self { what, verdict: Verdict::Good, found: found.into(), fix: None }
    }

    pub(super) fn limited(what: &'static str, found: impl Into<String>, fix: impl Into<String>) -> Self {
        Self { what, verdict: Verdict::Limited, found: found.into(), fix: Some(fix.into()) }
    }

    pub(super) fn missing(what: &'static str, found: impl Into<String>, fix: impl Into<String>) -> Self {
        Self { what, verdict: Verdict::Missing, found: found.into(), fix: Some(fix.into()) }
    }

    pub(super) fn not_seen(what: &'static str, found: impl Into<String>, fix: impl Into<String>) -> Self {
        Self { what, verdict: Verdict::NotSeen, found: found.into(), fix: Some(fix.into()) }
    }
}

/// Prints the findings; `ending` is the last line of the table.
pub(super) fn print(findings: &[Finding], as_json: bool, ending: &str) -> Result<(), Failure> {
    if as_json {
        let json = serde_json::to_string_pretty(findings).context("cannot write the findings as JSON")?;
        outln!("{json}");
    } else {
        outln!("{}", table(findings, ending));
    }
    Ok(())
}

fn table(findings: &[Finding], ending: &str) -> String {
    let longest = findings.iter().map(|finding| finding.what.chars().count()).max().unwrap_or(0);
    let line = |Finding { what, verdict, found, .. }: &Finding| {
        let verdict = match verdict {
            Verdict::Good => "good",
            Verdict::Limited => "limited",
            Verdict::Missing => "MISSING",
            Verdict::NotSeen => "not seen",
        };
        screen::wrapped(&format!(" {verdict:<8} {what:<longest$}  {found}"), 0, longest + 12)
    };
    let mut text = findings.iter().map(line).collect::<Vec<_>>().join("\n");
    // A remedy that neighbours share is printed once.
    let what_to_do = findings.iter().filter(|finding| finding.fix.is_some()).collect::<Vec<_>>();
    for same in what_to_do.chunk_by(|one, other| one.fix == other.fix) {
        let whats: Vec<_> = same.iter().map(|finding| finding.what).collect();
        if let Some(fix) = same.first().and_then(|finding| finding.fix.as_ref()) {
            text += "\n\n";
            text += &screen::wrapped(&format!("{}: {fix}", whats.join(", ")), 0, 0);
        }
    }
    text += "\n\n";
    text += &screen::wrapped(ending, 0, 0);
    text
}

/// Returns the worst verdict on this computer as the last line of its table.
pub(super) fn ending_of_host(findings: &[Finding]) -> &'static str {
    let has = |wanted| findings.iter().any(|finding| finding.verdict == wanted);
    if has(Verdict::Missing) {
        "Real mode does not run here; `--mode virtual` does."
    } else if has(Verdict::Limited) {
        "Real mode runs here, within these limits; `--mode virtual` has none."
    } else {
        "Real mode runs here as well as it can."
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table_of_host(findings: &[Finding]) -> String {
        table(findings, ending_of_host(findings))
    }

    #[test]
    fn the_table_has_a_line_per_finding_and_the_fixes_below() {
        let findings = [
            Finding::good("clock source", "tsc"),
            Finding::limited("steal", "3.0 %", "use a machine of your own"),
        ];
        insta::assert_snapshot!(table_of_host(&findings), @"
         good     clock source  tsc
         limited  steal         3.0 %

        steal: use a machine of your own

        Real mode runs here, within these limits; `--mode virtual` has none.
        ");
        let twice = ["real-time priority", "locked memory"]
            .map(|what| Finding::limited(what, "refused", "give this user `rtprio 49`"));
        assert_eq!(table_of_host(&twice).matches("rtprio 49").count(), 1);
        assert!(
            table_of_host(&twice)
                .contains("\nreal-time priority, locked memory: give this user `rtprio 49`\n")
        );
        let refused = Finding::missing("network namespaces", "refused", "run as root");
        assert!(table_of_host(&[refused]).ends_with("Real mode does not run here; `--mode virtual` does."));
    }
}
