//! Statuses of trials, runs, checks, fits and searches.

use trilink_base::named;

named! {
    /// Status of a trial.
    pub enum TrialStatus {
        Ok = "ok",
        /// A check warns about the trial, but the trial has metrics.
        Flagged = "flagged",
        /// The trial has no metrics.
        Failed = "failed",
        /// A pattern in `ignore` of `trials.toml` matches the marker file, which was not read.
        Ignored = "ignored",
    }
}

impl TrialStatus {
    /// Returns whether trials with this status have metrics.
    pub fn has_metrics(self) -> bool {
        matches!(self, Self::Ok | Self::Flagged)
    }
}

named! {
    /// Status of a run.
    pub enum RunStatus {
        /// The run has not ended, or was killed.
        Running = "running",
        Ok = "ok",
        /// The run is complete, but its results need human review: a trial failed, or a finding concerns a whole
        /// campaign or folder.
        Attention = "attention",
        /// The run stopped with an error.
        Failed = "failed",
        Interrupted = "interrupted",
    }
}

named! {
    /// Severity of a check's finding.
    pub enum Severity {
        Ok = "ok",
        /// The finding needs no action.
        Info = "info",
        Warning = "warning",
        Error = "error",
    }
}

named! {
    /// Whether one set of coefficients describes all campaigns that are fitted together.
    pub enum Sharing {
        /// The trials do not contradict the shared coefficients.
        Kept = "kept",
        /// Separate coefficients fit significantly better.
        Refused = "refused",
    }
}

named! {
    /// Origin of the frequency at which a model's metrics are predicted.
    pub enum PredictionSource {
        /// Predicted at the frequency of a trial.
        Trial = "trial",
        /// Predicted at a frequency of a fine grid, for a curve.
        Curve = "curve",
    }
}

named! {
    /// Reason why one of the searches of a multi-start fit ended.
    pub enum Stopped {
        Converged = "converged",
        /// The search approached the same point as the search from an earlier start, so only the earlier one was
        /// completed; its result counts for both starts.
        Joined = "joined an earlier start",
        NothingFree = "nothing is free",
        NoMotion = "no motion exists here",
        TooManySteps = "too many steps",
    }
}

impl Stopped {
    /// Returns whether the search ended without finding a minimum.
    pub fn is_failure(self) -> bool {
        matches!(self, Self::NoMotion | Self::TooManySteps)
    }
}

named! {
    /// Status of a fit.
    pub enum FitStatus {
        Ok = "ok",
        /// The gait of a trial passes through a singular shape, so that the model has no motion for this trial.
        Singular = "singular",
        /// The solver found no periodic motion of the model for a trial.
        Diverged = "diverged",
        /// There is nothing to fit, or the gait of a trial is not known.
        Failed = "failed",
    }
}

impl FitStatus {
    /// Returns whether there is a fit.
    pub fn is_ok(self) -> bool {
        self == Self::Ok
    }
}

named! {
    /// Whether a joint release or a coast-down identifies the law of its decay.
    pub enum LawStatus {
        Ok = "ok",
        /// Every law is rejected.
        NoneFits = "no law fits",
        /// Neither the viscous nor the dry law is rejected in favour of the law with both terms.
        NotDistinguished = "laws not distinguished",
        /// A constant force acts on the coasting robot, and no coast-down in the opposite direction tells whether it is
        /// dry friction or gravity along a sloping floor.
        DryOrSlope = "dry friction or slope",
    }
}

named! {
    /// Whether coast-downs determine the slope of the floor along the direction of travel.
    pub enum SlopeStatus {
        Ok = "ok",
        /// No robot coasted in opposite directions, so that the slope cannot be separated from dry friction.
        OneDirection = "one direction",
        /// The coast-downs scatter too much, or their directions differ too little.
        Imprecise = "imprecise",
        /// The motion follows no combination of viscous resistance and a constant force.
        NoneFits = "no law fits",
    }
}

impl LawStatus {
    /// Returns whether the law is identified.
    pub fn is_ok(self) -> bool {
        self == Self::Ok
    }
}
