//! Faults of a choice, with what can be chosen.

use std::fmt;

use crate::fault::{excerpt, shortened};

/// Reason why a choice makes no device.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct ChoiceError {
    /// Option that is at fault, such as `--access-point`.
    pub option: &'static str,
    /// Value found and remedy.
    pub fault: String,
    /// Values from which the user can choose.
    pub choices: Vec<ChoiceOption>,
}

/// Value that an option takes.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct ChoiceOption {
    /// Value, as the option takes it.
    pub value: String,
    /// Name in the file.
    pub name: String,
}

/// Values that an error lists; `plc-node describe` lists them all.
const MOST_LISTED: usize = 24;

/// Longest value that is listed whole, so that it can be typed.
const MOST_TYPED: usize = 200;

impl ChoiceError {
    pub(super) fn new(option: &'static str, fault: impl Into<String>) -> Self {
        Self { option, fault: fault.into(), choices: Vec::new() }
    }

    pub(super) fn with(mut self, choices: impl IntoIterator<Item = (String, String)>) -> Self {
        self.choices = choices.into_iter().map(|(value, name)| ChoiceOption { value, name }).collect();
        self
    }
}

impl fmt::Display for ChoiceError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.option, self.fault)?;
        for ChoiceOption { value, name } in self.choices.iter().take(MOST_LISTED) {
            write!(f, "\n  {}  {}", shortened(value, MOST_TYPED), excerpt(name))?;
        }
        match self.choices.len().saturating_sub(MOST_LISTED) {
            0 => Ok(()),
            more => write!(f, "\n  and {more} more, which `plc-node describe` lists"),
        }
    }
}

impl std::error::Error for ChoiceError {}

/// Refuses an option that belongs to another format.
pub(super) fn refuse(option: &'static str, is_given: bool, format: &str) -> Result<(), ChoiceError> {
    if !is_given {
        return Ok(());
    }
    Err(ChoiceError::new(option, format!("not an option of {format}; leave it out")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_list_is_cut_and_names_of_a_file_reach_no_terminal_control() {
        let long = "x".repeat(100);
        let text = ChoiceError::new("--module", "x").with([(long.clone(), String::new())]).to_string();
        assert!(text.contains(&long), "a value that is cut cannot be typed: {text}");
        let choices = (0..30).map(|number| (number.to_string(), "a\x1b[2J".to_owned()));
        let text = ChoiceError::new("--module", "x").with(choices).to_string();
        assert_eq!(text.lines().count(), 1 + MOST_LISTED + 1);
        assert!(text.ends_with("and 6 more, which `plc-node describe` lists"), "{text}");
        assert!(!text.contains('\x1b'), "{text}");
    }
}
