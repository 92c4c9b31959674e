//! Robot parameters identified from joint-release and coast-down trials, written by the ingest stage.

use serde::Serialize;
use trilink_robot::Quantity;
use trilink_robot::decay::{DecayLaw, Swing};
use trilink_statistics::Estimate;

use super::trials::is_empty;
use crate::trial::TrialKind;
use crate::{LawStatus, Numbered, SlopeStatus, rows};

rows! {
    /// Robot parameters measured by one trial of kind `joint-release` or `coast-down`: row of
    /// `robot_parameters.parquet`. Quantities that the kind of trial does not measure are missing. Names of
    /// columns with standard errors end in `_se`; those with configured values contain `configured`.
    #[derive(Serialize)]
    pub struct RobotParameterRow {
        pub trial: String,
        pub kind: TrialKind,
        pub robot: String,
        /// Decay law that the recording follows; missing if none was identified. Parameters whose column
        /// names do not contain the name of a law are estimated with this law.
        pub law: Option<DecayLaw>,
        /// Released joint, counted from the front from 1 on; 0 for a coast-down.
        pub joint: i64,
        /// Configured moment of inertia of the swinging links about the released joint, kg m^2.
        pub inertia_kg_m2: f64,
        pub natural_rad_s: Estimate,
        /// Damping ratio from a fit of the whole decay.
        pub damping_ratio: Estimate,
        /// Damping ratio from the logarithmic decrement.
        pub damping_ratio_decrement: Estimate,
        pub rest_angle_rad: Estimate,
        pub rest_angle_configured_rad: f64,
        /// Time from the first frame to the release, s. At the time `t` after the release, the fitted angle
        /// is `rest_angle + exp(-zeta omega_n t) (cosine cos(omega_d t) + sine sin(omega_d t))`. With dry
        /// friction, this holds only up to the first turning point, and the centre of the swing is offset
        /// from the rest angle ([`Swing`]).
        pub released_s: f64,
        pub decay_cosine_rad: f64,
        pub decay_sine_rad: f64,
        /// Stiffness k_tau of the passive joint (eq. 11 of the paper), N m/rad.
        pub stiffness_nm_rad: Estimate,
        pub stiffness_configured_nm_rad: f64,
        /// Damping c_tau of the passive joint (eq. 11 of the paper), N m s/rad.
        pub damping_nm_s_rad: Estimate,
        pub damping_configured_nm_s_rad: f64,
        /// Dry friction torque in the joint, N m.
        pub joint_dry_nm: Estimate,
        /// Configured mass of the whole robot, kg.
        pub mass_kg: f64,
        /// Decay rate of the coasting robot's speed, 1/s.
        pub decay_1_s: Estimate,
        /// Sum over the wheels of the coefficients c^R of viscous roll resistance (eq. 14 of the paper), kg/s.
        pub roll_sum_kg_s: Estimate,
        pub roll_sum_configured_kg_s: f64,
        /// Coefficients of viscous rolling resistance of the wheels of links 0, 1, 2, kg/s: the measured sum, divided
        /// among the wheels in proportion to their configured coefficients.
        pub roll_kg_s: [Estimate; 3] as "roll{}_kg_s{}",
        /// Coefficients of viscous rolling resistance of the wheels of further links, kg/s.
        #[serde(skip_serializing_if = "is_empty")]
        pub more_roll_kg_s: Numbered<Estimate, 3> as "roll{}_kg_s{}",
        /// Sum of the dry rolling friction over the wheels, N.
        pub roll_dry_sum_n: Estimate,
        pub roll_dry_sum_configured_n: f64,
        /// Direction in which the robot coasts, from the x axis of the laboratory, rad.
        pub heading_rad: f64,
        /// Correlation between the errors of the viscous and the dry term of the law with both.
        pub roll_correlation: f64,
        /// Slope of the floor along the direction of travel, rad; positive if the robot coasts uphill.
        pub slope_along_rad: Estimate,
        /// Slope of the floor along the x axis of the laboratory, rad; positive if the floor rises with x.
        pub slope_x_rad: Estimate,
        /// Slope of the floor along the y axis of the laboratory, rad; positive if the floor rises with y.
        pub slope_y_rad: Estimate,
        /// Whether the slope along the direction of travel is determined; missing for a joint release.
        pub slope_status: Option<SlopeStatus>,
        /// Number of coast-downs of the folder from which this trial's resistance was estimated jointly: 1 if from
        /// this trial alone, 0 for a joint release.
        pub pooled_trials: i64,
        /// Fit of the law with viscous resistance only; given even if the recording does not follow this law.
        pub viscous: DecayFit as "viscous_{}",
        /// Fit of the law with dry friction only; given even if the recording does not follow this law.
        pub coulomb: DecayFit as "coulomb_{}",
        /// Fit of the law that combines viscous resistance and dry friction; given even if the recording does not
        /// follow this law.
        pub coulomb_viscous: DecayFit as "coulomb_viscous_{}",
        /// Value of `misfit_over_noise` above which a law is rejected.
        pub misfit_over_noise_limit: f64,
        /// Value of the F statistic `f` above which a law is rejected.
        pub f_limit: f64,
        /// Number of trials of the same robot, kind and law, whose scatter the standard errors include; if it is 1,
        /// the standard errors reflect only the noise of the recording.
        pub repeats: i64,
        /// Whether a law was identified; if not, the measured values are missing.
        pub status: LawStatus,
    }
}

impl RobotParameterRow {
    /// Returns the fitted free oscillation of a released joint.
    pub fn swing(&self) -> Swing {
        let natural_rad_s = self.natural_rad_s.value;
        let ratio = nan_to_zero(self.damping_ratio.value);
        Swing {
            rest_rad: self.rest_angle_rad.value,
            cosine_rad: self.decay_cosine_rad,
            sine_rad: self.decay_sine_rad,
            viscous_1_s: ratio * natural_rad_s,
            damped_rad_s: natural_rad_s * (1.0 - ratio.powi(2)).sqrt(),
            dry_rad: nan_to_zero(self.joint_dry_nm.value / self.stiffness_nm_rad.value),
        }
    }

    /// Returns the fitted angle of a released joint at a time after the release, rad.
    pub fn decay_rad(&self, after_s: f64) -> f64 {
        self.swing().angle_rad(after_s).0
    }

    /// Returns the laws with their fits.
    pub fn laws(&self) -> [(DecayLaw, &DecayFit); 3] {
        let [viscous, coulomb, both] = DecayLaw::ALL;
        [(viscous, &self.viscous), (coulomb, &self.coulomb), (both, &self.coulomb_viscous)]
    }

    /// Returns what the standard errors include, and what was assumed about the floor.
    pub fn basis(&self) -> String {
        let errors = match self.repeats {
            ..2 => "no repeats: errors from noise alone".to_owned(),
            repeats => format!("scatter of {repeats} repeats"),
        };
        match self.slope_status {
            Some(status) if status != SlopeStatus::Ok && self.law.is_some() => {
                format!("{errors}; floor taken as level ({status})")
            }
            _ => errors,
        }
    }

    /// Returns the quantities that the trial measures, in the order in which they are displayed.
    pub fn quantities(&self) -> impl Iterator<Item = RobotQuantity> {
        let stiffness = (self.stiffness_nm_rad, self.stiffness_configured_nm_rad);
        let damping = (self.damping_nm_s_rad, self.damping_configured_nm_s_rad);
        let roll = (self.roll_sum_kg_s, self.roll_sum_configured_kg_s);
        let roll_dry = (self.roll_dry_sum_n, self.roll_dry_sum_configured_n);
        let [along, x, y] = [self.slope_along_rad, self.slope_x_rad, self.slope_y_rad]
            .map(|Estimate { value, se }| Estimate::new(value.to_degrees(), se.to_degrees()));
        [
            ("omega_n", "rad/s", (self.natural_rad_s, f64::NAN)),
            ("zeta", "", (self.damping_ratio, f64::NAN)),
            ("k_tau", Quantity::Stiffness.one().unit(), stiffness),
            ("c_tau", Quantity::Damping.one().unit(), damping),
            ("T_tau", "N m", (self.joint_dry_nm, f64::NAN)),
            ("sum c_R", Quantity::Roll.sum().unit(), roll),
            ("sum F_R", Quantity::RollDry.sum().unit(), roll_dry),
            ("slope", "deg", (along, f64::NAN)),
            ("slope x", "deg", (x, f64::NAN)),
            ("slope y", "deg", (y, f64::NAN)),
        ]
        .into_iter()
        .map(|(name, unit, (measured, configured))| RobotQuantity {
            name,
            unit,
            measured,
            configured,
        })
        .filter(|quantity| !quantity.measured.value.is_nan())
    }
}

/// Converts NaN, which stands for a term that the law lacks, to 0.
fn nan_to_zero(value: f64) -> f64 {
    if value.is_nan() { 0.0 } else { value }
}

rows! {
    /// Fit of a decay law to a recording.
    #[derive(Copy, Serialize)]
    pub struct DecayFit {
        /// RMS residual of the path in a coast-down, m.
        pub misfit_m: f64,
        /// RMS residual of the angle of a released joint, rad.
        pub misfit_rad: f64,
        /// Slowly varying part of the residuals, relative to the level that noise explains.
        pub misfit_over_noise: f64,
        /// F statistic of the test of this law against the law that combines viscous resistance and dry
        /// friction.
        pub f: f64,
        /// Whether the law is adequate, that is, not rejected; missing if this could not be tested.
        pub adequate: Option<bool>,
        pub roll_sum_kg_s: Estimate,
        pub roll_dry_sum_n: Estimate,
        pub stiffness_nm_rad: Estimate,
        pub damping_nm_s_rad: Estimate,
        pub joint_dry_nm: Estimate,
    }
}

/// Robot quantity that a trial measures, with its configured value.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RobotQuantity {
    /// Symbol of the quantity in plain ASCII letters.
    pub name: &'static str,
    pub unit: &'static str,
    pub measured: Estimate,
    /// Configured value; NaN if there is none.
    pub configured: f64,
}

impl RobotQuantity {
    /// Returns the ratio of the measured to the configured value.
    pub fn times_configured(&self) -> f64 {
        self.measured.value / self.configured
    }
}
