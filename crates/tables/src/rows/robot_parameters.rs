//! Robot parameters identified from trials without a gait, written by the ingest stage.

use serde::Serialize;
use trilink_robot::Quantity;
use trilink_robot::decay::{DecayLaw, Swing};
use trilink_statistics::Estimate;

use crate::trial::TrialKind;
use crate::{FitStatus, rows};

rows! {
    /// What one trial of kind `joint-release` or `coast-down` says of its robot:
    /// `robot_parameters.parquet`. What the kind does not tell is missing. Standard errors end
    /// in `_se`; values of the configuration have `configured` in their names.
    #[derive(Serialize)]
    pub struct RobotParameterRow {
        pub trial: String,
        pub kind: TrialKind,
        pub robot: String,
        /// The law that the recording follows; what stands under no law's name follows from it.
        pub law: Option<DecayLaw>,
        /// The joint that was let go, 1 or 2; 0 for a coast-down.
        pub joint: i64,
        /// Moment of inertia of its link about it, from the configuration.
        pub inertia_kg_m2: f64,
        pub natural_rad_s: Estimate,
        /// From a fit of the whole decay, and from the logarithmic decrement.
        pub damping_ratio: Estimate,
        pub damping_ratio_decrement: Estimate,
        pub rest_angle_rad: Estimate,
        pub rest_angle_configured_rad: f64,
        /// The decay that was fitted: at `t` after `released_s`, which is after the first frame,
        /// `rest_angle + exp(-zeta omega_n t) (cosine cos(omega_d t) + sine sin(omega_d t))`, with
        /// dry friction only up to the first turning point, and about an angle offset from the rest angle
        /// ([`Swing`]).
        pub released_s: f64,
        pub decay_cosine_rad: f64,
        pub decay_sine_rad: f64,
        /// k_tau and c_tau of eq. 11.
        pub stiffness_nm_rad: Estimate,
        pub stiffness_configured_nm_rad: f64,
        pub damping_nm_s_rad: Estimate,
        pub damping_configured_nm_s_rad: f64,
        /// Torque of dry friction in the joint.
        pub joint_dry_nm: Estimate,
        /// Of the whole robot, from the configuration.
        pub mass_kg: f64,
        /// Rate at which the speed decays.
        pub decay_1_s: Estimate,
        /// Sum of c^R of eq. 14, and what the configured proportions make of it.
        pub roll_sum_kg_s: Estimate,
        pub roll_sum_configured_kg_s: f64,
        pub roll_kg_s: [Estimate; 3] as "roll{}_kg_s{}",
        /// Dry friction of the wheels together.
        pub roll_dry_sum_n: Estimate,
        pub roll_dry_sum_configured_n: f64,
        /// What each law gives, whether or not the recording follows it.
        pub viscous: DecayFit as "viscous_{}",
        pub coulomb: DecayFit as "coulomb_{}",
        pub coulomb_viscous: DecayFit as "coulomb_viscous_{}",
        /// Above these a law is refused.
        pub misfit_over_noise_limit: f64,
        pub f_limit: f64,
        /// Why no law was identified: the recording follows none, or does not discriminate between them;
        /// then the measured values are missing.
        pub status: FitStatus,
    }
}

impl RobotParameterRow {
    /// The fitted decay of a joint that was let go, from its release on.
    pub fn swing(&self) -> Swing {
        // Of a law without one of its parts that is missing.
        let part = |of: f64| if of.is_nan() { 0.0 } else { of };
        let [ratio, natural_rad_s] = [part(self.damping_ratio.value), self.natural_rad_s.value];
        Swing {
            rest_rad: self.rest_angle_rad.value,
            cosine_rad: self.decay_cosine_rad,
            sine_rad: self.decay_sine_rad,
            viscous_1_s: ratio * natural_rad_s,
            damped_rad_s: natural_rad_s * (1.0 - ratio.powi(2)).sqrt(),
            dry_rad: part(self.joint_dry_nm.value / self.stiffness_nm_rad.value),
        }
    }

    /// Its angle at a time after the release, rad.
    pub fn decay_rad(&self, after_s: f64) -> f64 {
        self.swing().angle_rad(after_s).0
    }

    /// What each law gives, with what the configuration has of it.
    pub fn laws(&self) -> [(DecayLaw, &DecayFit); 3] {
        let [viscous, coulomb, both] = DecayLaw::ALL;
        [(viscous, &self.viscous), (coulomb, &self.coulomb), (both, &self.coulomb_viscous)]
    }

    /// What the trial tells, in the order in which it is to be read.
    pub fn quantities(&self) -> impl Iterator<Item = RobotQuantity> {
        let stiffness = (self.stiffness_nm_rad, self.stiffness_configured_nm_rad);
        let damping = (self.damping_nm_s_rad, self.damping_configured_nm_s_rad);
        let roll = (self.roll_sum_kg_s, self.roll_sum_configured_kg_s);
        let roll_dry = (self.roll_dry_sum_n, self.roll_dry_sum_configured_n);
        [
            ("omega_n", "rad/s", (self.natural_rad_s, f64::NAN)),
            ("zeta", "", (self.damping_ratio, f64::NAN)),
            ("k_tau", Quantity::Stiffness.one().unit(), stiffness),
            ("c_tau", Quantity::Damping.one().unit(), damping),
            ("T_tau", "N m", (self.joint_dry_nm, f64::NAN)),
            ("sum c_R", Quantity::Roll.sum().unit(), roll),
            ("sum F_R", Quantity::RollDry.sum().unit(), roll_dry),
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

rows! {
    /// A law by which a motion dies away, fitted to a recording.
    #[derive(Copy, Serialize)]
    pub struct DecayFit {
        /// RMS residual of the path of a coast-down, and of the angle of a joint.
        pub misfit_m: f64,
        pub misfit_rad: f64,
        /// What is slow in the residuals over what noise makes of it.
        pub misfit_over_noise: f64,
        /// F of the law against the one with both parts.
        pub f: f64,
        /// Whether it is not refused.
        pub adequate: Option<bool>,
        pub roll_sum_kg_s: Estimate,
        pub roll_dry_sum_n: Estimate,
        pub stiffness_nm_rad: Estimate,
        pub damping_nm_s_rad: Estimate,
        pub joint_dry_nm: Estimate,
    }
}

/// A quantity that a trial tells of its robot.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RobotQuantity {
    /// Its symbol in plain letters, and its unit.
    pub name: &'static str,
    pub unit: &'static str,
    pub measured: Estimate,
    /// NaN if it is not in the configuration.
    pub configured: f64,
}

impl RobotQuantity {
    /// How many times as large as configured it is measured.
    pub fn times_configured(&self) -> f64 {
        self.measured.value / self.configured
    }
}
