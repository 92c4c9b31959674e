//! Tables of all trials, written by the ingest stage.

use serde::Serialize;
use trilink_robot::JointCommand;
use trilink_robot::metrics::GaitMetrics;
use trilink_statistics::Estimate;

use crate::config::SigmaKind;
use crate::trial::TrialKind;
use crate::{Severity, TrialStatus, rows};

rows! {
    /// One trial: `trials.parquet`. Standard errors end in `_se`.
    #[derive(Serialize)]
    pub struct TrialRow {
        /// Its id, with its folder's name in front where another folder has the same.
        pub trial: String,
        /// Where it is: its folder as seen from the configuration, and its id and its marker file in
        /// the folder's list.
        pub folder: String,
        pub id: String,
        pub file: String,
        /// Empty for trials that are not of kind `gait`.
        pub campaign: String,
        pub kind: TrialKind,
        pub omega_commanded_rad_s: f64,
        /// Measured, by harmonic regression on the commanded joints.
        pub omega_rad_s: f64,
        pub omega_rad_s_se: f64,
        /// Cycles that the means are taken over.
        pub cycles: i64,
        /// Means over the cycles, and their standard errors.
        pub metrics: GaitMetrics,
        pub metrics_se: GaitMetrics as "{}_se" after "{}",
        /// Skid ratios without what the markers' noise makes of them.
        pub sigma_debiased: [Estimate; 3] as "sigma{}_debiased{}" after "sigma2_se",
        /// Measured gait of the joints.
        pub gait: [JointGait; 2] as "phi{}_{}",
        /// Part of all markers' frames that the cameras saw.
        pub coverage: f64,
        /// Mean residual of the rigid fits, mm.
        pub residual_mm: f64,
        /// Whether the markers' noise is white, as all errors take it to be; a filter before the export ends that.
        /// Missing where too little was seen to tell.
        pub noise_white: Option<bool>,
        /// Width of the moving average, samples.
        pub smoothing_window: i64,
        /// What it leaves of the speeds of the gait's first three harmonics. Only the raw skid
        /// ratios and the tables of smoothed coordinates and speeds lose the rest.
        pub smoothing_left1: f64,
        pub smoothing_left2: f64,
        pub smoothing_left3: f64,
        pub status: TrialStatus,
        pub message: String,
    }
}

impl TrialRow {
    /// Measured skid ratios of wheels 0, 1, 2. A debiased one of which nothing is left above the
    /// noise is missing; the raw one replaces a debiased one that is not known.
    pub fn sigma(&self, kind: SigmaKind) -> [Estimate; 3] {
        std::array::from_fn(|wheel| {
            let raw = Estimate::new(self.metrics.sigma[wheel], self.metrics_se.sigma[wheel]);
            let debiased = self.sigma_debiased[wheel];
            match kind {
                SigmaKind::Debiased if debiased.value > 0.0 => debiased,
                SigmaKind::Debiased if !debiased.value.is_nan() => Estimate::MISSING,
                SigmaKind::Debiased | SigmaKind::Raw => raw,
            }
        })
    }

    /// Whether [`TrialRow::sigma`] gives raw skid ratios instead of debiased ones.
    pub fn lacks_debiased(&self) -> bool {
        let both = self.metrics.sigma.iter().zip(&self.sigma_debiased);
        both.into_iter().any(|(raw, debiased)| raw.is_finite() && debiased.value.is_nan())
    }
}

rows! {
    /// What a joint does: `phi = offset + amplitude cos(omega t + phase)`, the phase of a
    /// commanded joint being that of its command.
    #[derive(Copy, Serialize)]
    pub struct JointGait {
        pub offset_rad: f64,
        pub amplitude_rad: f64,
        pub phase_rad: f64,
        /// What else it does in every cycle: RMS of its harmonics above the first.
        pub harmonics_rad: f64,
        pub offset_rad_se: f64,
        pub amplitude_rad_se: f64,
        pub phase_rad_se: f64,
    }
}

impl JointGait {
    /// The command that would give it, but for the harmonics.
    pub fn command(&self) -> JointCommand {
        let Self { offset_rad, amplitude_rad, phase_rad, .. } = *self;
        JointCommand::new(offset_rad, amplitude_rad, phase_rad)
    }

    /// Standard errors of offset, amplitude and phase.
    pub fn errors_rad(&self) -> [f64; 3] {
        [self.offset_rad_se, self.amplitude_rad_se, self.phase_rad_se]
    }
}

rows! {
    /// One check of one trial: `checks.parquet`.
    #[derive(Serialize)]
    pub struct CheckRow {
        pub trial: String,
        /// Code and name, such as `W003 residual`.
        pub check: String,
        pub severity: Severity,
        pub value: f64,
        pub limit: f64,
        pub message: String,
    }
}
