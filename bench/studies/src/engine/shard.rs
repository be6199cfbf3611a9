//! The part of a study that one process executes.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// One of several shards of a study: each job belongs to exactly one.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct Shard {
    /// Its number, from 0.
    pub index: u32,
    /// Number of shards.
    pub count: u32,
}

/// An invalid `--shard`.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub enum InvalidShard {
    /// Not two numbers.
    #[error("`{0}`: expected I/N, such as 0/7 for the first of seven shards")]
    Form(String),
    /// A number beyond the last shard.
    #[error("`{index}/{count}`: {count} shards have the numbers 0 to {}", count.saturating_sub(1))]
    Range {
        /// The given number.
        index: u32,
        /// The given count.
        count: u32,
    },
}

impl Shard {
    /// The whole study.
    pub const WHOLE: Self = Self { index: 0, count: 1 };

    /// Returns how many of a study's jobs are in this shard.
    #[must_use]
    pub fn jobs(self, of_study: u128) -> u128 {
        let (count, index) = (u128::from(self.count.max(1)), u128::from(self.index));
        of_study / count + u128::from(of_study % count > index)
    }

    /// Returns the number within the study of this shard's job with this number. Neighbours go to different shards, so that all
    /// take equally long.
    #[must_use]
    pub fn job(self, number: u128) -> u128 {
        number.saturating_mul(u128::from(self.count)).saturating_add(u128::from(self.index))
    }
}

impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.index, self.count)
    }
}

impl FromStr for Shard {
    type Err = InvalidShard;

    fn from_str(text: &str) -> Result<Self, InvalidShard> {
        let form = || InvalidShard::Form(text.to_owned());
        let (index, count) = text.split_once('/').ok_or_else(form)?;
        let (index, count) = (index.parse().map_err(|_| form())?, count.parse().map_err(|_| form())?);
        if count == 0 {
            return Err(form());
        }
        if index >= count {
            return Err(InvalidShard::Range { index, count });
        }
        Ok(Self { index, count })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_job_is_in_exactly_one_shard() {
        for count in [1, 7, 64] {
            for jobs in [0_u128, 1, 63, 64, 65, 1_000] {
                let shards = (0..count).map(|index| Shard { index, count });
                let mut all: Vec<u128> = shards
                    .flat_map(|shard| (0..shard.jobs(jobs)).map(move |number| shard.job(number)))
                    .collect();
                all.sort_unstable();
                assert_eq!(all, (0..jobs).collect::<Vec<_>>(), "{count} shards");
            }
        }
    }

    #[test]
    fn a_shard_out_of_range_is_refused() {
        let refused = |text: &str| text.parse::<Shard>().unwrap_err().to_string();
        assert_eq!("6/7".parse::<Shard>().unwrap().to_string(), "6/7");
        insta::assert_snapshot!(refused("7/7"), @"`7/7`: 7 shards have the numbers 0 to 6");
        for text in ["0/0", "3", "-1/3", "1/x", ""] {
            assert!(refused(text).contains("expected I/N"), "{text}");
        }
    }
}
