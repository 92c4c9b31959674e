//! Tables of all trials, written by the ingest stage.

use serde::Serialize;
use trilink_robot::metrics::GaitMetrics;
use trilink_robot::{JointCommand, MAX_JOINTS, MAX_LINKS};
use trilink_statistics::Estimate;

use crate::config::SigmaKind;
use crate::trial::TrialKind;
use crate::{Columns as _, Numbered, Severity, TrialStatus, rows};

pub(super) fn is_empty<T, const FIRST: usize>(values: &Numbered<T, FIRST>) -> bool {
    values.0.is_empty()
}

rows! {
    /// Results of one trial: row of `trials.parquet`. Names of columns with standard errors end in `_se`.
    #[derive(Serialize)]
    pub struct TrialRow {
        /// Unique name of the trial: its id, prefixed with the name of its folder unless the configuration names this
        /// folder alone.
        pub trial: String,
        /// Folder of the trial, relative to the configuration file.
        pub folder: String,
        /// Day of the recording: as listed, or the folder.
        pub day: String,
        /// Id of the trial in the folder's trial list.
        pub id: String,
        /// Name of the trial's marker file in the folder.
        pub file: String,
        /// Campaign of the trial; empty for trials that are not of kind `gait`.
        pub campaign: String,
        pub kind: TrialKind,
        pub omega_commanded_rad_s: f64,
        /// Frequency measured by harmonic regression on the angles of the commanded joints, rad/s.
        pub omega_rad_s: f64,
        pub omega_rad_s_se: f64,
        /// Number of cycles that are used for the trial means.
        pub cycles: i64,
        /// Trial means of the metrics: means over the used cycles.
        pub metrics: GaitMetrics,
        /// Standard errors of the trial means.
        pub metrics_se: GaitMetrics as "{}_se" after "{}",
        /// Debiased skid ratios: corrected for the effects of marker noise and smoothing.
        pub sigma_debiased: [Estimate; 3] as "sigma{}_debiased{}" after "sigma2_se",
        /// Measured gait of the joints.
        pub gait: [JointGait; 2] as "phi{}_{}",
        /// Debiased skid ratios of the other wheels.
        #[serde(skip_serializing_if = "is_empty")]
        pub more_sigma_debiased: Numbered<Estimate, 3> as "sigma{}_debiased{}",
        /// Measured gait of the joints behind the second.
        #[serde(skip_serializing_if = "is_empty")]
        pub more_gait: Numbered<JointGait, 3> as "phi{}_{}",
        /// Direction of travel over the used cycles, from the x axis of the laboratory, rad.
        pub heading_rad: f64,
        /// Fraction of all marker samples that were recorded, not occluded.
        pub coverage: f64,
        /// Mean, over links and frames, of the RMS residual of the rigid fit to a link's markers, mm.
        pub residual_mm: f64,
        /// Whether the marker noise is white, as all standard errors assume (filtering before the export
        /// violates this); missing if there are too few frames to test it.
        pub noise_white: Option<bool>,
        /// Width of the moving average that smooths the coordinates, samples; 0 with the Kalman smoother.
        pub smoothing_window: i64,
        /// Fraction of the first harmonic's velocity that the moving average retains; `smoothing_left2` and
        /// `smoothing_left3` are the fractions for the second and third harmonic. Smoothing affects only the raw skid
        /// ratios and the tables of smoothed coordinates and velocities.
        pub smoothing_left1: f64,
        pub smoothing_left2: f64,
        pub smoothing_left3: f64,
        pub status: TrialStatus,
        pub message: String,
    }
}

impl TrialRow {
    /// Returns the measured gait of the joints from front to rear; blank for joints that the robot lacks.
    pub fn joints(&self) -> [JointGait; MAX_JOINTS] {
        let mut all = self.gait.iter().chain(&*self.more_gait).copied();
        std::array::from_fn(|_| all.next().unwrap_or_else(JointGait::blank))
    }

    /// Returns the debiased skid ratios by the number of the link; missing for a link without a wheel.
    pub fn all_debiased(&self) -> [Estimate; MAX_LINKS] {
        let mut all = self.sigma_debiased.iter().chain(&*self.more_sigma_debiased).copied();
        std::array::from_fn(|_| all.next().unwrap_or(Estimate::MISSING))
    }

    /// Returns the measured skid ratios by the number of the link. If `kind` is debiased, a debiased ratio that is zero
    /// or below is returned as missing, and a raw ratio is returned for a wheel without a debiased one.
    pub fn sigma(&self, kind: SigmaKind) -> [Estimate; MAX_LINKS] {
        let all_debiased = self.all_debiased();
        std::array::from_fn(|wheel| {
            let raw = Estimate::new(self.metrics.sigma[wheel], self.metrics_se.sigma[wheel]);
            let debiased = all_debiased[wheel];
            match kind {
                SigmaKind::Debiased if debiased.value > 0.0 => debiased,
                SigmaKind::Debiased if !debiased.value.is_nan() => Estimate::MISSING,
                SigmaKind::Debiased | SigmaKind::Raw => raw,
            }
        })
    }

    /// Returns the commanded frequency, or else the measured one, rad/s; NaN if both are unknown.
    pub fn frequency_rad_s(&self) -> f64 {
        let commanded = self.omega_commanded_rad_s;
        if commanded > 0.0 { commanded } else { self.omega_rad_s }
    }

    /// Returns whether, for at least one wheel, [`TrialRow::sigma`] has to return the raw skid ratio because there is
    /// no debiased one.
    pub fn lacks_debiased(&self) -> bool {
        let both = self.metrics.sigma.into_iter().zip(self.all_debiased());
        both.into_iter().any(|(raw, debiased)| raw.is_finite() && debiased.value.is_nan())
    }
}

rows! {
    /// Measured gait of a joint: `phi = offset + amplitude cos(omega t + phase)`, with the time origin chosen
    /// so that a commanded joint has the phase of its command.
    #[derive(Copy, Serialize)]
    pub struct JointGait {
        pub offset_rad: f64,
        pub amplitude_rad: f64,
        pub phase_rad: f64,
        /// RMS of the joint angle's harmonics above the first, rad.
        pub harmonics_rad: f64,
        pub offset_rad_se: f64,
        pub amplitude_rad_se: f64,
        pub phase_rad_se: f64,
    }
}

impl JointGait {
    /// Returns a joint command with the measured offset, amplitude and phase.
    pub fn command(&self) -> JointCommand {
        let Self { offset_rad, amplitude_rad, phase_rad, .. } = *self;
        JointCommand::new(offset_rad, amplitude_rad, phase_rad)
    }

    /// Returns the standard errors of offset, amplitude and phase, rad.
    pub fn errors_rad(&self) -> [f64; 3] {
        [self.offset_rad_se, self.amplitude_rad_se, self.phase_rad_se]
    }
}

rows! {
    /// Result of one check of one trial: row of `checks.parquet`.
    #[derive(Serialize)]
    pub struct CheckRow {
        pub trial: String,
        /// Code and name of the check, such as `W004 residual`.
        pub check: String,
        pub severity: Severity,
        pub value: f64,
        pub limit: f64,
        pub message: String,
    }
}
