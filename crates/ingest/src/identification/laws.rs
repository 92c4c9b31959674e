//! Selects the resistance law that a recording follows: viscous resistance, dry friction, or both.
//!
//! Each single-term law is the combined law with the other term fixed at 0, so that it is rejected by an F test against
//! the combined law: `F = (S_one - S_both) / variance`, where S are sums of squared residuals and the variance is that
//! of independent residuals equivalent to those of the combined law. The limit corresponds to three standard errors and
//! is widened as for Student's distribution. A law is also rejected if the slow component of its residuals exceeds what
//! noise explains: then some other resistance acts on the motion.

use nalgebra::SVector;
use trilink_robot::decay::DecayLaw;
use trilink_statistics::{Estimate, fisher, normal_tail};
use trilink_tables::{Columns as _, DecayFit, LawStatus, RobotParameterRow};

use super::{Curve, REJECTION_DEVIATIONS};
use crate::checks::{Check, Finding};

/// Laws fitted to one recording, with the tests that compare them.
pub(super) struct Laws<const N: usize> {
    /// Fitted curves in the order of [`DecayLaw::ALL`]; `None` if the fit of a law has no minimum.
    pub curves: [Option<Curve<N>>; 3],
    /// Parameter indices of the viscous and the dry term.
    pub terms: [usize; 2],
    /// Ratio of the actual standard errors to those that follow from the residuals.
    pub widening: f64,
    /// Minimum noise of a recording, in the unit of the fitted quantity.
    pub min_noise: f64,
}

/// Wording used for the fitted laws and their residuals in messages.
pub(super) struct Words {
    pub laws: [&'static str; 3],
    /// Name of the motion in messages, such as "a roll".
    pub motion: &'static str,
    /// Function that formats the RMS residual of a fit.
    pub rms: fn(&DecayFit) -> String,
}

impl<const N: usize> Laws<N> {
    /// Returns the row with the fits of all laws (in the order of [`DecayLaw::ALL`]), the limits of their tests, and
    /// the preferred law, if there is one.
    pub(super) fn row(
        &self,
        [viscous, coulomb, coulomb_viscous]: [DecayFit; 3],
    ) -> RobotParameterRow {
        let row = RobotParameterRow {
            viscous,
            coulomb,
            coulomb_viscous,
            misfit_over_noise_limit: self.misfit_limit(),
            f_limit: self.f_limit(),
            repeats: 1,
            ..RobotParameterRow::blank()
        };
        let preferred = preferred(&row);
        RobotParameterRow {
            law: preferred.ok(),
            status: preferred.err().unwrap_or(LawStatus::Ok),
            ..row
        }
    }

    pub(super) fn curve(&self, law: DecayLaw) -> Option<&Curve<N>> {
        self.curves[law as usize].as_ref()
    }

    /// Returns the F statistic of a single-term law against the combined law; NaN for the combined law itself. If the
    /// single-term law cannot be fitted, F is the square of `value / standard error` of the term that it lacks, from
    /// the fit of the combined law.
    pub(super) fn f(&self, law: DecayLaw) -> f64 {
        let Some(both) = self.curve(DecayLaw::CoulombViscous) else { return f64::NAN };
        let [viscous, dry] = self.terms;
        let other = match law {
            DecayLaw::Viscous => dry,
            DecayLaw::Coulomb => viscous,
            DecayLaw::CoulombViscous => return f64::NAN,
        };
        let widening = self.widening.powi(2);
        self.curve(law).map_or_else(
            || both.parameters[other].powi(2) / (widening * both.covariance[(other, other)]),
            |one| {
                let variance = widening * both.variance.max(self.min_noise.powi(2));
                (one.squares - both.squares).max(0.0) / variance
            },
        )
    }

    /// Returns the limit of the F statistic above which a law is rejected.
    pub(super) fn f_limit(&self) -> f64 {
        let freedom = self.curve(DecayLaw::CoulombViscous).map_or(f64::NAN, |both| both.freedom);
        fisher(2.0 * normal_tail(REJECTION_DEVIATIONS), [1.0, freedom])
    }

    /// Returns the limit of the ratio between the slow component of a law's residuals and the noise.
    fn misfit_limit(&self) -> f64 {
        self.curves.iter().flatten().next().map_or(f64::NAN, |curve| curve.limit)
    }

    /// Returns whether a law is adequate, that is, not rejected; `None` if the law is not rejected but could not be
    /// fitted.
    pub(super) fn is_adequate(&self, law: DecayLaw) -> Option<bool> {
        if self.f(law) > self.f_limit() {
            return Some(false);
        }
        let curve = self.curve(law)?;
        // A significantly negative coefficient would drive the motion, which friction cannot do.
        let drives = self.terms.into_iter().any(|index| {
            let se = self.widening * curve.covariance[(index, index)].sqrt();
            curve.parameters[index] < -REJECTION_DEVIATIONS * se
        });
        let is_rejected = curve.times_noise > self.misfit_limit() || drives;
        Some(!is_rejected)
    }

    /// Returns the parameters of a law, extracted by `give`, with the goodness of fit.
    pub(super) fn fit(&self, law: DecayLaw, give: impl FnOnce(&Curve<N>) -> DecayFit) -> DecayFit {
        let f = self.f(law);
        let adequate = self.is_adequate(law);
        let Some(curve) = self.curve(law) else {
            return DecayFit { f, adequate, ..DecayFit::blank() };
        };
        DecayFit { misfit_over_noise: curve.times_noise, f, adequate, ..give(curve) }
    }

    /// Returns a quantity with its standard error, given its derivatives with respect to the parameters.
    pub(super) fn estimate(
        &self,
        curve: &Curve<N>,
        value: f64,
        slopes: SVector<f64, N>,
    ) -> Estimate {
        Estimate::new(value, self.widening * curve.se(slopes))
    }
}

/// Returns the law that a recording prefers, which is the adequate law with the fewest terms, or the reason why there
/// is none. Only the fits of the row are used.
pub(super) fn preferred(row: &RobotParameterRow) -> Result<DecayLaw, LawStatus> {
    match row.laws().map(|(_, fit)| fit.adequate) {
        [Some(false), Some(false), Some(true)] => Ok(DecayLaw::CoulombViscous),
        [Some(false), Some(false), _] => Err(LawStatus::NoneFits),
        [Some(true), Some(false), _] => Ok(DecayLaw::Viscous),
        [Some(false), Some(true), _] => Ok(DecayLaw::Coulomb),
        _ => Err(LawStatus::NotDistinguished),
    }
}

/// Checks whether the configured law is adequate and whether the recording distinguishes it from the other laws. Only
/// the fits of the row are used.
pub(super) fn checks(row: &RobotParameterRow, words: &Words, configured: DecayLaw) -> Vec<Finding> {
    let preferred = preferred(row);
    let (value, message) = compare(row, words, preferred, configured);
    let holds = preferred == Ok(configured);
    let comparison = Finding::new(Check::DecayLaw, holds, value, row.f_limit, message);
    decay_check(row, words, configured).into_iter().chain([comparison]).collect()
}

/// Checks that the residuals of the fit of a law are noise; `None` if there is no such fit.
pub(super) fn decay_check(
    row: &RobotParameterRow,
    words: &Words,
    law: DecayLaw,
) -> Option<Finding> {
    let fit = row.laws()[law as usize].1;
    let name = words.laws[law as usize];
    let found = fit.misfit_over_noise;
    let needed = row.misfit_over_noise_limit;
    if found.is_nan() {
        return None;
    }
    let rms = (words.rms)(fit);
    let holds = found <= needed;
    let message = if holds {
        format!("the recording deviates from {name} by {rms} (RMS)")
    } else {
        format!(
            "the recording does not follow {name}: the deviation is {rms} (RMS), and its slowly varying part is \
             {found:.1} times the noise, above the limit {needed:.1}"
        )
    };
    Some(Finding::new(Check::Decay, holds, found, needed, message))
}

/// Returns a message that no law was identified. If the reason is that the recording does not distinguish the laws, the
/// message also gives the F statistics and advice on a better recording.
fn undecided(row: &RobotParameterRow, words: &Words, status: LawStatus) -> String {
    let Words { laws: [viscous, dry, both], motion, .. } = words;
    if status == LawStatus::NoneFits {
        return format!("the recording follows neither {viscous}, nor {dry}, nor {both}");
    }
    let f = [row.viscous.f, row.coulomb.f];
    let found = if f.iter().all(|f| f.is_finite()) {
        format!(
            "the F statistics of these one-term laws against the law with both the viscous and the dry term are \
             {:.1} and {:.1}, and one of the two would have to exceed {:.1}",
            f[0], f[1], row.f_limit
        )
    } else {
        "the law with both the viscous and the dry term, against which the one-term laws are compared, cannot be \
         fitted"
            .to_owned()
    };
    format!(
        "the recording does not distinguish {viscous} from {dry}: {found}; record {motion} that is faster, longer or \
         less noisy"
    )
}

/// Compares the configured law with the others. Returns the F statistic that decides between them and a message.
fn compare(
    row: &RobotParameterRow,
    words: &Words,
    preferred: Result<DecayLaw, LawStatus>,
    configured: DecayLaw,
) -> (f64, String) {
    let laws = [configured, DecayLaw::Viscous, DecayLaw::Coulomb];
    let [name, viscous, dry] = laws.map(|law| words.laws[law as usize]);
    let fits = row.laws();
    let [f, f_viscous, f_dry] = laws.map(|law| fits[law as usize].1.f);
    let limit = row.f_limit;
    match preferred {
        Err(status) => (f_dry.max(f_viscous), undecided(row, words, status)),
        Ok(DecayLaw::CoulombViscous) if configured == DecayLaw::CoulombViscous => (
            f_dry.min(f_viscous),
            format!(
                "the recording follows {name}: the F statistic is {f_viscous:.1} against {viscous} alone, and \
                 {f_dry:.1} against {dry} alone"
            ),
        ),
        Ok(law) if law == configured && f.is_nan() => {
            (f, format!("the recording follows {name}; the law with both terms cannot be fitted"))
        }
        Ok(law) if law == configured => (
            f,
            format!(
                "{} adds nothing significant to {name}: the F statistic is {f:.1}",
                missing_term(configured)
            ),
        ),
        Ok(law) if configured == DecayLaw::CoulombViscous => {
            let f = fits[law as usize].1.f;
            let message = format!(
                "the recording follows {}: {} adds nothing significant to this law (the F statistic is {f:.1}, the \
                 limit {limit:.1}), but the robot is configured with {name}",
                words.laws[law as usize],
                missing_term(law),
            );
            (f, message)
        }
        Ok(law) => (
            f,
            format!(
                "the recording rejects {name}: the F statistic against the law that also has {} is {f:.1}, above the \
                 limit {limit:.1}; the recording follows {}",
                missing_term(configured),
                words.laws[law as usize]
            ),
        ),
    }
}

/// Returns the name of the resistance that a single-term law lacks.
fn missing_term(law: DecayLaw) -> &'static str {
    match law {
        DecayLaw::Viscous => "dry friction",
        _ => "viscous resistance",
    }
}
