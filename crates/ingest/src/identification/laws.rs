//! Viscous resistance, dry friction, or both: which of them a recording follows.
//!
//! Each of the first two is the law with both where one parameter is 0, so that it is refused by what
//! this one adds: `F = (S_one - S_both) / variance` of the sums of squared residuals, with the
//! variance of residuals that are as large and as slow as those of the law with both. Beyond the
//! limit is what three standard errors are, widened as Student's distribution is. A law is refused,
//! too, if what is slow in its residuals is more than noise makes of it: then something else
//! resists the motion.

use nalgebra::SVector;
use trilink_robot::decay::DecayLaw;
use trilink_statistics::{Estimate, student};
use trilink_tables::{Columns as _, DecayFit};

use super::{Curve, REFUSED_BEYOND};
use crate::checks::{Check, Finding};

/// The laws as fitted to one recording, and what that tells of them.
pub(super) struct Laws<const N: usize> {
    /// In the order of [`DecayLaw::ALL`]; `None` of what has no minimum.
    pub curves: [Option<Curve<N>>; 3],
    /// Of the parameters, those of the viscous and of the dry part.
    pub parts: [usize; 2],
    /// How much larger the errors are than the residuals make them.
    pub widened: f64,
    pub least_noise: f64,
}

/// What the fitted laws are called, and what is off them.
pub(super) struct Words {
    pub laws: [&'static str; 3],
    /// Of the motion, such as a roll.
    pub motion: &'static str,
    pub off: fn(f64) -> String,
}

impl<const N: usize> Laws<N> {
    pub(super) fn curve(&self, law: DecayLaw) -> Option<&Curve<N>> {
        self.curves[law as usize].as_ref()
    }

    /// F of a law with one part against the one with both; NaN of this one. Where the first was not
    /// found, by the other part's standard error.
    pub(super) fn f(&self, law: DecayLaw) -> f64 {
        let Some(both) = self.curve(DecayLaw::CoulombViscous) else { return f64::NAN };
        let [viscous, dry] = self.parts;
        let other = match law {
            DecayLaw::Viscous => dry,
            DecayLaw::Coulomb => viscous,
            DecayLaw::CoulombViscous => return f64::NAN,
        };
        let widened = self.widened.powi(2);
        self.curve(law).map_or_else(
            || both.parameters[other].powi(2) / (widened * both.covariance[(other, other)]),
            |one| {
                let variance = widened * both.variance.max(self.least_noise.powi(2));
                (one.squares - both.squares).max(0.0) / variance
            },
        )
    }

    pub(super) fn f_limit(&self) -> f64 {
        let freedom = self.curve(DecayLaw::CoulombViscous).map_or(f64::NAN, |both| both.freedom);
        (REFUSED_BEYOND * student(freedom)).powi(2)
    }

    /// Of what is slow in the residuals of the viscous law over the noise.
    pub(super) fn misfit_limit(&self) -> f64 {
        self.curve(DecayLaw::Viscous).map_or(f64::NAN, |curve| curve.limit)
    }

    /// Whether a law is not refused; `None` if it could not be fitted and is not.
    pub(super) fn is_adequate(&self, law: DecayLaw) -> Option<bool> {
        if self.f(law) > self.f_limit() {
            return Some(false);
        }
        let curve = self.curve(law)?;
        // Friction that drives is none.
        let drives = |part: usize| {
            let value = curve.parameters[part];
            let se = self.widened * curve.covariance[(part, part)].sqrt();
            value < -REFUSED_BEYOND * se
        };
        let is_refused = curve.times_noise > curve.limit || self.parts.into_iter().any(drives);
        Some(!is_refused)
    }

    /// The law that the recording tells, of those that are not refused the one with the fewest
    /// parts; or why there is none.
    pub(super) fn preferred(&self, words: &Words) -> Result<DecayLaw, String> {
        let [is_viscous, is_dry, is_both] = DecayLaw::ALL.map(|law| self.is_adequate(law));
        let Words { laws: [viscous, dry, both], motion, .. } = words;
        match (is_viscous, is_dry) {
            (Some(false), Some(false)) if is_both == Some(true) => Ok(DecayLaw::CoulombViscous),
            (Some(false), Some(false)) => {
                Err(format!("the recording follows neither {viscous}, nor {dry}, nor {both}"))
            }
            (Some(true), Some(false)) => Ok(DecayLaw::Viscous),
            (Some(false), Some(true)) => Ok(DecayLaw::Coulomb),
            _ => {
                let f = [DecayLaw::Viscous, DecayLaw::Coulomb].map(|of| self.f(of));
                let limit = self.f_limit();
                let found = match f.iter().all(|f| f.is_finite()) {
                    true => format!(
                        "against both together F is {:.1} and {:.1}, needed more than {limit:.1} of \
                         one of them",
                        f[0], f[1]
                    ),
                    false => "both together cannot be fitted, needed to refuse one".to_owned(),
                };
                Err(format!(
                    "the recording does not tell {viscous} from {dry}: {found}; {motion} that is \
                     faster, longer or less noisy would tell"
                ))
            }
        }
    }

    /// What a law gives, and what is off it.
    pub(super) fn fit(&self, law: DecayLaw, give: impl FnOnce(&Curve<N>) -> DecayFit) -> DecayFit {
        let Some(curve) = self.curve(law) else { return DecayFit::blank() };
        let (f, adequate) = (self.f(law), self.is_adequate(law));
        DecayFit { misfit_over_noise: curve.times_noise, f, adequate, ..give(curve) }
    }

    /// A value that a law gives with its error, given the derivatives by the parameters.
    pub(super) fn estimate(
        &self,
        curve: &Curve<N>,
        value: f64,
        slopes: SVector<f64, N>,
    ) -> Estimate {
        Estimate::new(value, self.widened * curve.se(slopes))
    }

    /// Whether the law that the robot is configured with holds, and whether the recording tells it
    /// from the others.
    pub(super) fn checks(
        &self,
        words: &Words,
        preferred: &Result<DecayLaw, String>,
        configured: DecayLaw,
    ) -> Vec<Finding> {
        let named = |law: DecayLaw| words.laws[law as usize];
        // Of a law with one part.
        let lacking = |law: DecayLaw| match law {
            DecayLaw::Viscous => "dry friction",
            _ => "viscous resistance",
        };
        let decay = self
            .curve(configured)
            .map(|curve| curve.check(named(configured), &(words.off)(curve.misfit)));
        let [f, of_viscous, of_dry] =
            [configured, DecayLaw::Viscous, DecayLaw::Coulomb].map(|law| self.f(law));
        let limit = self.f_limit();
        let (value, message) = match preferred {
            Err(reason) => (of_dry.max(of_viscous), reason.clone()),
            Ok(DecayLaw::CoulombViscous) if configured == DecayLaw::CoulombViscous => (
                of_dry.min(of_viscous),
                format!(
                    "the recording follows {}: F is {of_viscous:.1} against {} alone, and \
                     {of_dry:.1} against {} alone",
                    named(configured),
                    named(DecayLaw::Viscous),
                    named(DecayLaw::Coulomb)
                ),
            ),
            Ok(law) if *law == configured => (
                f,
                format!(
                    "{} adds nothing to {}: F is {f:.1}",
                    lacking(configured),
                    named(configured)
                ),
            ),
            Ok(law) if configured == DecayLaw::CoulombViscous => (
                self.f(*law),
                format!(
                    "the recording follows {}: {} adds nothing to it (F is {:.1}, needed more than \
                     {limit:.1}), and the robot is configured with {}",
                    named(*law),
                    lacking(*law),
                    self.f(*law),
                    named(configured)
                ),
            ),
            Ok(law) => (
                f,
                format!(
                    "the recording refuses {}: F is {f:.1} against the law with {}, too, needed at \
                     most {limit:.1}; it follows {}",
                    named(configured),
                    lacking(configured),
                    named(*law)
                ),
            ),
        };
        let holds = *preferred == Ok(configured);
        decay
            .into_iter()
            .chain([Finding::new(Check::DecayLaw, holds, value, limit, message)])
            .collect()
    }
}
