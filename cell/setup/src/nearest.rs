//! The name that was probably meant, where one does not exist.

/// Least similarity of a name to one that was mistyped, from 0 to 1 (Jaro and Winkler).
const SIMILAR: f64 = 0.85;

/// Returns the name that is most like `found`; `None` if none is, or several are alike.
#[must_use]
pub fn nearest<'a>(found: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let found = found.to_lowercase();
    let rate = |name: &'a str| (strsim::jaro_winkler(&found, &name.to_lowercase()), name);
    let mut rated: Vec<_> = known.into_iter().map(rate).collect();
    rated.sort_by(|(one, _), (other, _)| other.total_cmp(one));
    match rated[..] {
        [(best, _), (second, _), ..] if best <= second => None,
        [(best, name), ..] if best >= SIMILAR => Some(name),
        _ => None,
    }
}

/// Returns what to write in place of a name that does not exist: the one that was probably meant, or all.
#[must_use]
pub fn meant_or_all(found: &str, known: &[&str]) -> String {
    match (nearest(found, known.iter().copied()), known) {
        (Some(meant), _) => format!("did you mean `{meant}`?"),
        (None, []) => "there is none".to_owned(),
        (None, known) => format!("there is {}", known.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_typing_error_is_near_to_the_name_that_was_meant_and_another_word_is_not() {
        let known = ["home", "grip", "carrier-rim", "above-assembly", "nest-up"];
        for (found, meant) in [
            ("carrier-rin", "carrier-rim"),
            ("nest-upp", "nest-up"),
            ("gripp", "grip"),
            ("abov-assembly", "above-assembly"),
            ("Home", "home"),
            ("hoem", "home"),
        ] {
            assert_eq!(nearest(found, known), Some(meant));
        }
        for found in ["table", "x", "", "release"] {
            assert_eq!(nearest(found, known), None, "{found}");
        }
        assert_eq!(nearest("link_one_mm", ["link_1_mm", "link_2_mm"]), None, "both are as near");
        assert_eq!(meant_or_all("x", &known[..2]), "there is home, grip");
    }
}
