//! Parts of a stage: which there are, and what they are called.

use std::fmt;
use std::ops::Range;

use serde::{Deserialize, Serialize};

/// Most parts of all trials: an array of jobs has no more.
const MOST_PARTS: usize = 100_000;

/// What parts are parts of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Division {
    /// All trials, in so many parts.
    Trials { of: usize },
    /// The replicates of a bootstrap.
    Replicates,
}

/// A part of a stage.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Part {
    pub division: Division,
    /// The number of a part of the trials, from 1 on; of the first replicate, from 0 on.
    pub from: usize,
    /// The number after the last one.
    pub to: usize,
}

impl Division {
    /// The parts that have these numbers.
    pub fn parts(self, numbers: Range<usize>) -> impl Iterator<Item = Part> {
        let step = match self {
            Self::Trials { .. } => 1,
            Self::Replicates => numbers.len().max(1),
        };
        numbers.step_by(step).map(move |from| Part { division: self, from, to: from + step })
    }
}

impl Part {
    /// Parses `3/8`, the third of eight parts of all trials.
    ///
    /// # Errors
    /// It is none.
    pub fn of_trials(text: &str) -> Result<Self, String> {
        let numbers = text.split_once('/').map(|(number, of)| (number.parse(), of.parse()));
        match numbers {
            Some((Ok(from), Ok(of))) if (1..=MOST_PARTS).contains(&of) => {
                let needed = || format!("found `{text}`, needed a part from 1/{of} to {of}/{of}");
                let part = Self { division: Division::Trials { of }, from, to: from + 1 };
                (1..=of).contains(&from).then_some(part).ok_or_else(needed)
            }
            _ => Err(format!(
                "found `{text}`, needed a part such as 3/8, the third of eight, of {MOST_PARTS} at \
                 most"
            )),
        }
    }

    /// Parses `0..500`, the first 500 replicates.
    ///
    /// # Errors
    /// There are none of these.
    pub fn of_replicates(text: &str) -> Result<Self, String> {
        let numbers = text.split_once("..").map(|(from, to)| (from.parse(), to.parse()));
        match numbers {
            Some((Ok(from), Ok(to))) if from < to => {
                Ok(Self { division: Division::Replicates, from, to })
            }
            _ => Err(format!("found `{text}`, needed replicates such as 0..500, the first 500")),
        }
    }

    /// Name of its folder.
    pub fn folder(self) -> String {
        let Self { division, from, to } = self;
        match division {
            Division::Trials { of } => format!("{from}-of-{of}"),
            Division::Replicates => format!("replicates-{from}-{to}"),
        }
    }

    /// The part whose folder has this name.
    pub fn of_folder(name: &str) -> Option<Self> {
        let part = match name.strip_prefix("replicates-") {
            Some(numbers) => Self::of_replicates(&numbers.replacen('-', "..", 1)),
            None => Self::of_trials(&name.replacen("-of-", "/", 1)),
        };
        part.ok().filter(|part| part.folder() == name)
    }

    /// Whether a trial falls on it.
    pub fn has(self, trial: &str) -> bool {
        let Division::Trials { of } = self.division else { return false };
        let hash = blake3::hash(trial.as_bytes());
        let first = hash.as_bytes().first_chunk().map_or(0, |bytes| u64::from_le_bytes(*bytes));
        first % of as u64 + 1 == self.from as u64
    }

    /// Whether they have something in common.
    pub fn meets(&self, other: &Self) -> bool {
        self.division == other.division && self.from < other.to && other.from < self.to
    }
}

impl TryFrom<String> for Part {
    type Error = String;

    fn try_from(name: String) -> Result<Self, String> {
        let needed =
            || format!("found part `{name}`, needed one such as 3-of-8 or replicates-0-500");
        Self::of_folder(&name).ok_or_else(needed)
    }
}

impl From<Part> for String {
    fn from(part: Part) -> Self {
        part.folder()
    }
}

impl fmt::Display for Part {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let Self { division, from, to } = self;
        match division {
            Division::Trials { of } => write!(f, "part {from}/{of}"),
            Division::Replicates => write!(f, "replicates {from}..{to}"),
        }
    }
}
