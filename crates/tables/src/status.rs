//! What became of a trial, a check, a fit or a prediction.

use trilink_base::{Named, named};

named! {
    /// What became of a trial.
    pub enum TrialStatus {
        Ok = "ok",
        /// A check warns.
        Flagged = "flagged",
        /// It has no metrics.
        Failed = "failed",
    }
}

named! {
    /// How a run ended.
    pub enum RunStatus {
        /// It has not, or it was killed.
        Running = "running",
        Ok = "ok",
        /// Something needs a person.
        Attention = "attention",
        /// It did not come to its end.
        Failed = "failed",
        Interrupted = "interrupted",
    }
}

named! {
    /// How bad it is what a check found.
    pub enum Severity {
        Ok = "ok",
        /// Something was found that needs nobody.
        Info = "info",
        Warning = "warning",
        Error = "error",
    }
}

named! {
    /// Whether one set of coefficients describes all campaigns of a robot.
    pub enum Sharing {
        /// Nothing speaks against it.
        Kept = "kept",
        /// The campaigns' own coefficients are nearer by more than chance.
        Refused = "refused",
    }
}

named! {
    /// Where a model predicts.
    pub enum PredictionSource {
        /// At the trials' frequencies.
        Trial = "trial",
        /// On a fine grid.
        Curve = "curve",
    }
}

named! {
    /// Why a search ended.
    pub enum Stopped {
        Converged = "converged",
        /// Another search with a lower number goes on from the same point, and both end there.
        Joined = "joined an earlier start",
        NothingFree = "nothing is free",
        NoMotion = "no motion exists here",
        TooManySteps = "too many steps",
    }
}

impl Stopped {
    /// Whether the search has not found a minimum.
    pub fn is_failure(self) -> bool {
        matches!(self, Self::NoMotion | Self::TooManySteps)
    }
}

/// What became of a fit.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum FitStatus {
    Ok,
    /// Why there is none.
    Failed(String),
}

impl FitStatus {
    /// Whether there is a fit.
    pub fn is_ok(&self) -> bool {
        *self == Self::Ok
    }
}

impl FitStatus {
    /// What there is, or nothing and why.
    pub fn split<T>(found: Result<T, String>) -> (Option<T>, Self) {
        match found {
            Ok(found) => (Some(found), Self::Ok),
            Err(reason) => (None, Self::Failed(reason)),
        }
    }
}

impl Named for FitStatus {
    fn first() -> Self {
        Self::Failed(String::new())
    }

    fn as_name(&self) -> &str {
        match self {
            Self::Ok => "ok",
            Self::Failed(reason) => reason,
        }
    }

    fn of_name(name: &str) -> Option<Self> {
        Some(if name == Self::Ok.as_name() { Self::Ok } else { Self::Failed(name.to_owned()) })
    }
}

impl serde::Serialize for FitStatus {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.as_name())
    }
}

impl std::fmt::Display for FitStatus {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.pad(self.as_name())
    }
}
