//! Shards of a stage: numbering and names.

use std::fmt;
use std::ops::Range;

use serde::{Deserialize, Serialize};

/// Maximum number of ingest shards, as large as the job arrays of clusters.
const MAX_SHARDS: usize = 100_000;

/// Division of a stage into shards.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Division {
    /// Ingest of all trials, divided into `of` shards.
    Trials { of: usize },
    /// Bootstrap replicates of the fits, divided into ranges.
    Replicates,
}

/// Part of the work of a stage: one of the numbered shards of an ingest, or a range of bootstrap replicates of the
/// fits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Shard {
    pub division: Division,
    /// Number of an ingest shard (from 1), or of the first bootstrap replicate (from 0).
    pub from: usize,
    /// End (exclusive) of the range of replicates that begins with `from`; for an ingest shard, `from + 1`.
    pub to: usize,
}

impl Division {
    /// Returns the shards with the given `numbers`: one shard per number for an ingest, but a single shard for a range
    /// of replicates.
    pub fn shards(self, numbers: Range<usize>) -> impl Iterator<Item = Shard> {
        let step = match self {
            Self::Trials { .. } => 1,
            Self::Replicates => numbers.len().max(1),
        };
        numbers.step_by(step).map(move |from| Shard { division: self, from, to: from + step })
    }
}

impl Shard {
    /// Parses an ingest shard, such as `3/8`, the third of eight.
    ///
    /// # Errors
    /// Returns a message if the text is not a valid shard.
    pub fn parse_trials(text: &str) -> Result<Self, String> {
        let numbers = text.split_once('/').map(|(number, of)| (number.parse(), of.parse()));
        match numbers {
            Some((Ok(from), Ok(of))) if (1..=MAX_SHARDS).contains(&of) => {
                if (1..=of).contains(&from) {
                    Ok(Self { division: Division::Trials { of }, from, to: from + 1 })
                } else {
                    Err(format!("found `{text}`, needed a shard from 1/{of} to {of}/{of}"))
                }
            }
            _ => Err(format!(
                "found `{text}`, needed a shard such as 3/8, the third of eight, with at most {MAX_SHARDS} shards"
            )),
        }
    }

    /// Parses a range of bootstrap replicates, such as `0..500`, the first 500.
    ///
    /// # Errors
    /// Returns a message if the text is not a range, or if the range is empty.
    pub fn parse_replicates(text: &str) -> Result<Self, String> {
        let numbers = text.split_once("..").map(|(from, to)| (from.parse(), to.parse()));
        match numbers {
            Some((Ok(from), Ok(to))) if from < to => {
                Ok(Self { division: Division::Replicates, from, to })
            }
            _ => Err(format!(
                "found `{text}`, needed a range of replicates such as 0..500, the first 500"
            )),
        }
    }

    /// Returns the name of the shard's folder.
    pub fn folder(self) -> String {
        let Self { division, from, to } = self;
        match division {
            Division::Trials { of } => format!("{from}-of-{of}"),
            Division::Replicates => format!("replicates-{from}-{to}"),
        }
    }

    /// Returns the shard to which a folder of this name belongs; `None` if it is not a shard's folder.
    pub fn from_folder(name: &str) -> Option<Self> {
        let shard = match name.strip_prefix("replicates-") {
            Some(numbers) => Self::parse_replicates(&numbers.replacen('-', "..", 1)),
            None => Self::parse_trials(&name.replacen("-of-", "/", 1)),
        };
        shard.ok().filter(|shard| shard.folder() == name)
    }

    /// Whether a trial belongs to this shard, as determined by a hash of the trial's id.
    pub fn has(self, trial: &str) -> bool {
        let Division::Trials { of } = self.division else { return false };
        let hash = blake3::hash(trial.as_bytes());
        let first = hash.as_bytes().first_chunk().map_or(0, |bytes| u64::from_le_bytes(*bytes));
        first % of as u64 + 1 == self.from as u64
    }

    /// Whether two shards of the same division overlap.
    pub fn overlaps(&self, other: &Self) -> bool {
        self.division == other.division && self.from < other.to && other.from < self.to
    }
}

impl TryFrom<String> for Shard {
    type Error = String;

    fn try_from(name: String) -> Result<Self, String> {
        Self::from_folder(&name).ok_or_else(|| {
            format!("found shard `{name}`, needed one such as 3-of-8 or replicates-0-500")
        })
    }
}

impl From<Shard> for String {
    fn from(shard: Shard) -> Self {
        shard.folder()
    }
}

impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let Self { division, from, to } = self;
        match division {
            Division::Trials { of } => write!(f, "shard {from}/{of}"),
            Division::Replicates => write!(f, "replicates {from}..{to}"),
        }
    }
}
