//! Confidence intervals for the coefficients, with random and systematic components.
//!
//! - *Scatter* (random): differences between cycles, between trials and between days ([`super::variation`]). Quantiles
//!   of a parametric bootstrap, widened for the degrees of freedom of the estimated variances, or the limits from the
//!   objective profiles where the replicates do not vary.
//! - *Systematic*: errors that are common to all trials and that repeats do not reveal.
//!   - Model error: the variance of a jackknife over blocks of neighbouring frequencies, which exceeds that of the
//!     scatter if no single set of coefficients describes all blocks. Only the excess over [`MAX_CHANCE_RATIO`] times
//!     the scatter's variance counts. The jackknife needs at least [`FitNotes::MIN_FREQUENCIES`] frequencies and is
//!     omitted otherwise.
//!   - Robot parameters: the shift of the fit when each parameter is increased by its standard deviation, as configured
//!     or as estimated from joint-release and coast-down trials.
//!   - Gait, where the command drives the model: servos do not follow the command exactly, and a fit to the measured
//!     gait gives other coefficients. The interval is extended by this shift, only on the side of the shift, since a
//!     wider symmetric interval would not correct a known shift. Where the measured gait drives the model, the errors
//!     of that gait are part of the scatter.
//!
//! The systematic standard deviations of the coefficients' logarithms are added in quadrature; 1.96 times the result is
//! added in quadrature to the half width due to the scatter. The parts are also given as standard uncertainties of Type
//! A and Type B in the terms of the GUM ([`StandardUncertainty`]). There is no interval if the noise is unknown, nor
//! for an inadequate model, which has no true coefficients that an interval could contain.
//!
//! References: B. Efron and R. J. Tibshirani, *An Introduction to the Bootstrap*, Chapman & Hall
//! 1993, section 11.5 (jackknife of blocks: section 8.6); for the uncorrected shift S. D. Phillips,
//! K. R. Eberhardt and B. Parry, J. Res. NIST 102 (1997) 577; *Guide to the expression of uncertainty in measurement*
//! (GUM), JCGM 100:2008, annex G.

use rayon::prelude::*;
use trilink_statistics::{HALF_WIDTH_95, SIDES_95, mean, quantiles, student};
use trilink_tables::{FitNotes, NoInterval, NoIntervalReason};

use super::adequacy::Adequacy;
use super::fitted_point::FittedPoint;
use super::input::FreeParameter;
use super::measurement::Measurement;
use super::objective::Objective;
use super::profile::{Class, Profile};
use super::robots::Robots;
use super::starts::{Start, search_from};
use super::variation::{Variation, VariationFrom};

/// Maximum number of frequency blocks per campaign.
const MAX_BLOCKS: usize = 6;
/// Ratio of the jackknife variance to the scatter variance that 95 of 100 fits of a true model do not exceed, from the
/// 534 coefficients of 60 simulated nightly runs (crates/fit/tests/it/coverage.rs). It is larger than for least squares
/// (2.2), because least-absolute-deviations estimates jump from breakpoint to breakpoint.
const MAX_CHANCE_RATIO: f64 = 6.0;

/// Confidence intervals for the free parameters, in the order of the parameters.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Intervals {
    /// Lower and upper limits; NaN where the interval is open on that side, and everywhere if there are no intervals
    /// for the reason in `why_none`.
    pub limits: [Vec<f64>; 2],
    /// Half widths due to the scatter alone.
    pub scatter: Vec<f64>,
    /// Half widths due to the systematic component alone.
    pub systematic: Vec<f64>,
    pub uncertainties: Vec<StandardUncertainty>,
    pub why_none: Option<NoInterval>,
}

/// Standard uncertainty of a coefficient in the terms of the GUM; NaN where the interval is open or unknown. The shift
/// from the fit with the measured gait, which extends one side of an interval, is not part of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct StandardUncertainty {
    /// Standard uncertainty from random errors (Type A), in the unit of the coefficient.
    pub type_a: f64,
    /// Standard uncertainty from systematic errors (Type B), in the unit of the coefficient.
    pub type_b: f64,
    /// Effective degrees of freedom of the combined standard uncertainty.
    pub degrees_of_freedom: f64,
    /// Ratio of the half width of the interval to the combined standard uncertainty.
    pub coverage_factor: f64,
}

impl StandardUncertainty {
    const UNKNOWN: Self = Self {
        type_a: f64::NAN,
        type_b: f64::NAN,
        degrees_of_freedom: f64::NAN,
        coverage_factor: f64::NAN,
    };

    /// Creates the uncertainty of a coefficient with the value `fitted` from the widths of the interval of its
    /// logarithm. `freedom` is the number of degrees of freedom of the random part. By the Welch-Satterthwaite formula
    /// (GUM, eq. G.2b), in which a systematic part has infinitely many degrees of freedom, the combined uncertainty u_c
    /// has `freedom (u_c / u_A)^4`.
    fn new(fitted: f64, widths: &Widths, freedom: f64) -> Self {
        let Widths { random_deviation, systematic_deviation, expanded, .. } = *widths;
        let combined = random_deviation.hypot(systematic_deviation);
        if combined.is_nan() {
            return Self::UNKNOWN;
        }
        let is_certain = combined == 0.0;
        Self {
            type_a: fitted * random_deviation,
            type_b: fitted * systematic_deviation,
            degrees_of_freedom: if is_certain {
                f64::NAN
            } else {
                freedom * (combined / random_deviation).powi(4)
            },
            coverage_factor: expanded / combined,
        }
    }
}

/// Shifts of the logarithms of the free parameters due to errors that are common to all trials.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Systematic {
    /// Shifts in the fits that each leave out one block of frequencies.
    pub blocks: Vec<Vec<f64>>,
    /// Shifts in the fits that each increase one uncertain robot parameter by its standard deviation.
    pub assumed: Vec<Vec<f64>>,
    /// Shifts in the fit to the measured gait; `None` unless the command drives the model.
    pub gait: Option<Vec<f64>>,
}

impl Systematic {
    /// Refits without each block of frequencies in turn, and with each of the perturbed robots. Returns the shifts of
    /// these refits from the fit, and the number of periodic solutions computed.
    pub(crate) fn new(point: &FittedPoint, perturbed_robots: &[Robots]) -> (Self, usize) {
        let objective = point.evaluator.objective;
        let mut blocks = frequency_blocks(&objective.measurements);
        blocks.retain(|of_campaign| of_campaign.len() >= FitNotes::MIN_FREQUENCIES);
        let without: Vec<Start> =
            blocks.concat().par_iter().map(|block| point.refit_without(block)).collect();
        let assumed: Vec<Start> = perturbed_robots
            .par_iter()
            .map(|robots| {
                let perturbed = Objective { robots: robots.clone(), ..objective.clone() };
                let evaluator = perturbed.evaluator(point.evaluator.parameters.clone());
                search_from(evaluator, point.values.clone())
            })
            .collect();
        let solves = without.iter().chain(&assumed).map(|refit| refit.solves).sum();
        let [blocks, assumed] = [without, assumed]
            .map(|refits| refits.iter().map(|refit| point.shift_to(&refit.ended)).collect());
        (Self { blocks, assumed, gait: None }, solves)
    }
}

/// Divides each campaign into blocks of neighbouring frequencies; returns the measurement indices by campaign and
/// block. The measurements must be sorted by [`Measurement::order`].
pub(super) fn frequency_blocks(sorted: &[Measurement]) -> Vec<Vec<Vec<usize>>> {
    let frequencies = Measurement::frequencies(sorted);
    let campaign = |trials: &[usize]| sorted[trials[0]].campaign;
    let campaigns = frequencies.chunk_by(|a, b| campaign(a) == campaign(b));
    campaigns
        .map(|frequencies| {
            let count = MAX_BLOCKS.min(frequencies.len());
            let blocks = (0..count).map(|number| {
                let [from, to] = [number, number + 1].map(|edge| edge * frequencies.len() / count);
                frequencies[from..to].concat()
            });
            blocks.collect()
        })
        .collect()
}

/// Half widths of an interval below and above the fitted value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Widths {
    /// Half widths due to the systematic component alone.
    pub systematic: [f64; 2],
    /// Half widths due to scatter and systematic component together.
    pub total: [f64; 2],
    /// Standard deviation due to the scatter; NaN if one of the sides is open.
    random_deviation: f64,
    /// Standard deviation due to the systematic component, without the shift from the fit with the measured gait.
    systematic_deviation: f64,
    /// Mean of the two half widths due to scatter and systematic component, without that shift.
    expanded: f64,
}

impl Widths {
    /// Computes the widths from the changes of a quantity in the replicates, and from its changes in the three kinds of
    /// refits that [`Systematic`] describes.
    pub(crate) fn from_changes(
        replicates: Vec<f64>,
        blocks: &[f64],
        assumed: &[f64],
        gait: f64,
    ) -> Self {
        let [low, high] = quantiles(replicates, SIDES_95);
        // Make sure that the interval contains the fitted value.
        Self::new([-low, high].map(|width| width.max(0.0)), blocks, assumed, gait, 1.0)
    }

    /// Computes the widths from the half widths due to the scatter, and from the changes in the three kinds of refits
    /// that [`Systematic`] describes.
    fn new(scatter: [f64; 2], blocks: &[f64], assumed: &[f64], gait: f64, widening: f64) -> Self {
        let [below, above] = scatter;
        let random_deviation = (below + above) / 2.0 / HALF_WIDTH_95 / widening;
        let deviation = if random_deviation.is_finite() {
            random_deviation
        } else {
            below.max(above).max(0.0) / HALF_WIDTH_95 / widening
        };
        let systematic_deviation = systematic_deviation(blocks, assumed, deviation);
        let common = HALF_WIDTH_95 * systematic_deviation;
        let gait = [(-gait).max(0.0), gait.max(0.0)];
        let [below, above] = [below.hypot(common), above.hypot(common)];
        Self {
            systematic: gait.map(|gait| common + gait),
            total: [below + gait[0], above + gait[1]],
            random_deviation,
            systematic_deviation,
            expanded: (below + above) / 2.0,
        }
    }
}

/// Returns the systematic standard deviation for the given shifts; `scatter` is the random standard deviation.
fn systematic_deviation(blocks: &[f64], assumed: &[f64], scatter: f64) -> f64 {
    let assumed: f64 = assumed.iter().map(|shift| shift.powi(2)).sum();
    if blocks.is_empty() {
        return assumed.sqrt();
    }
    let count = blocks.len() as f64;
    let mean = mean(blocks.iter().copied());
    let squares: f64 = blocks.iter().map(|shift| (shift - mean).powi(2)).sum();
    let jackknife = (count - 1.0) / count * squares;
    let chance = MAX_CHANCE_RATIO * scatter.powi(2);
    ((jackknife - chance).max(0.0) + assumed).sqrt()
}

impl Intervals {
    pub(crate) const NONE: Self = Self {
        limits: [Vec::new(), Vec::new()],
        scatter: Vec::new(),
        systematic: Vec::new(),
        uncertainties: Vec::new(),
        why_none: None,
    };

    /// Computes the intervals for a fit from its replicates and its profiles (one per parameter, or none).
    pub(crate) fn new(
        point: &FittedPoint,
        profiles: &[Profile],
        replicates: &[Start],
        variation: &Variation,
        adequacy: &Adequacy,
        systematic: &Systematic,
    ) -> Self {
        let parameters = &point.evaluator.parameters;
        let none = || vec![f64::NAN; parameters.len()];
        let unknown_noise = variation.resampler.metrics_without_noise(point.evaluator.objective);
        let mut all = Self {
            limits: [none(), none()],
            scatter: none(),
            systematic: none(),
            uncertainties: vec![StandardUncertainty::UNKNOWN; parameters.len()],
            why_none: None,
        };
        if parameters.is_empty() {
            return all;
        }
        if !unknown_noise.is_empty() {
            let of = unknown_noise.into_iter().map(str::to_owned).collect();
            all.why_none = Some(NoInterval { reason: NoIntervalReason::UnknownNoise, of });
            return all;
        }
        if replicates.is_empty() && profiles.is_empty() {
            all.why_none = Some(NoIntervalReason::NotAskedFor.into());
            return all;
        }
        let freedoms = variation.degrees_of_freedom(point);
        for (index, free) in parameters.iter().enumerate() {
            let fitted = point.values[index];
            let widening = student(freedoms[index]);
            let scatter = [0, 1].map(|side| {
                let limit = scatter_limit(profiles, replicates, index, free, side);
                limit.log_ratio(fitted, widening)
            });
            let scatter = scatter.map(f64::abs);
            let [blocks, assumed] = [&systematic.blocks, &systematic.assumed]
                .map(|all| all.iter().map(|shifts| shifts[index]).collect::<Vec<f64>>());
            let gait = systematic.gait.as_ref().map_or(0.0, |shifts| shifts[index]);
            let widths = Widths::new(scatter, &blocks, &assumed, gait, widening);
            all.scatter[index] = half_width(fitted, scatter);
            all.systematic[index] = half_width(fitted, widths.systematic);
            all.uncertainties[index] = StandardUncertainty::new(fitted, &widths, freedoms[index]);
            let [below, above] = widths.total;
            for (side, signed) in [-below, above].into_iter().enumerate() {
                let limit = fitted * signed.exp();
                let is_open = free.is_at_bound(limit)[side];
                all.limits[side][index] = if is_open { f64::NAN } else { limit };
            }
        }
        let why_none = match adequacy.is_adequate {
            Some(false) => Some(NoIntervalReason::Inadequate),
            None if variation.from == VariationFrom::Nothing => {
                Some(NoIntervalReason::UnknownVariation)
            }
            _ => None,
        };
        if let Some(reason) = why_none {
            all.limits = [none(), none()];
            all.why_none = Some(reason.into());
        }
        all
    }
}

/// Returns half the width of an interval, given the distances of its limits from the fitted value on a log scale.
fn half_width(fitted: f64, [below, above]: [f64; 2]) -> f64 {
    0.5 * fitted * (above.exp() - (-below).exp())
}

/// Limit of an interval due to the scatter alone.
#[derive(Debug, Clone, Copy, PartialEq)]
enum ScatterLimit {
    /// Quantile of the replicates, before it is widened for the degrees of freedom.
    Resampled(f64),
    /// Value at which the profile crosses the confidence threshold.
    Profiled(f64),
    /// No limit on this side.
    Open,
}

impl ScatterLimit {
    /// Returns the logarithm of the ratio of the limit to the fitted value; NaN where the side is open.
    fn log_ratio(self, fitted: f64, widening: f64) -> f64 {
        match self {
            Self::Resampled(limit) => widening * (limit / fitted).ln(),
            Self::Profiled(limit) => (limit / fitted).ln(),
            Self::Open => f64::NAN,
        }
    }
}

/// Returns the limit due to the scatter on one side (0: lower, 1: upper). The side is open if the coefficient is not
/// identifiable. The profile gives the limit where replicates are at a bound, since the bootstrap is inconsistent there
/// (D. W. K. Andrews, Econometrica 68 (2000) 399).
fn scatter_limit(
    profiles: &[Profile],
    replicates: &[Start],
    index: usize,
    free: &FreeParameter,
    side: usize,
) -> ScatterLimit {
    let ends = replicates.iter().map(|refit| refit.ended[index]).collect();
    let [low, high] = quantiles(ends, SIDES_95);
    let is_within = [low, high].iter().all(|limit| !free.is_at_bound(*limit).contains(&true));
    let profile = profiles.get(index);
    if profile.is_some_and(|profile| profile.class != Class::Identifiable) {
        return ScatterLimit::Open;
    }
    if low < high && is_within {
        return ScatterLimit::Resampled([low, high][side]);
    }
    profile
        .and_then(|profile| profile.interval[side])
        .filter(|limit| !free.is_at_bound(*limit)[side])
        .map_or(ScatterLimit::Open, ScatterLimit::Profiled)
}

#[cfg(test)]
mod tests {
    use trilink_tables::Stopped;

    use trilink_robot::Quantity;

    use super::*;

    #[test]
    fn replicates_that_do_not_move_give_the_limits_of_the_profile() {
        let free = FreeParameter { parameter: Quantity::Damping.one(), bounds: [1e-4, 1.0] };
        let replicate = |value: f64| Start {
            began: Vec::new(),
            ended: vec![value],
            cost: 1.0,
            solves: 0,
            stopped: Stopped::Converged,
        };
        let still = [0.5; 40].map(replicate);
        let mut moved = still.clone();
        moved.iter_mut().step_by(2).for_each(|refit| refit.ended = vec![0.52]);
        let profile = Profile {
            points: Vec::new(),
            limit: 1.0,
            interval: [Some(0.49), Some(0.53)],
            class: Class::Identifiable,
            solves: 0,
        };
        let limits = |profiles: &[Profile], replicates: &[Start]| {
            [0, 1].map(|side| scatter_limit(profiles, replicates, 0, &free, side))
        };
        use ScatterLimit::{Open, Profiled, Resampled};
        let profiles = [profile];
        assert_eq!(limits(&profiles, &moved), [Resampled(0.5), Resampled(0.52)]);
        assert_eq!(limits(&profiles, &still), [Profiled(0.49), Profiled(0.53)]);
        assert_eq!(limits(&profiles, &[]), [Profiled(0.49), Profiled(0.53)]);
        assert_eq!(limits(&[], &still), [Open; 2]);
        // Some replicates end at the upper bound.
        let mut cut_off = moved.clone();
        cut_off[..4].iter_mut().for_each(|refit| refit.ended = vec![1.0]);
        assert_eq!(limits(&[], &cut_off), [Open; 2]);
        assert_eq!(limits(&profiles, &cut_off), [Profiled(0.49), Profiled(0.53)]);
        let [profile] = profiles;
        let interval = [Some(0.3), None];
        let half_open = [Profile { interval, class: Class::PracticallyNot, ..profile }];
        for replicates in [&moved, &still, &cut_off] {
            assert_eq!(limits(&half_open, replicates), [Open; 2]);
        }
        assert_eq!(Resampled(2.0).log_ratio(1.0, 0.5), 0.5 * 2.0_f64.ln());
        assert_eq!(Profiled(2.0).log_ratio(1.0, 0.5), 2.0_f64.ln());
    }

    #[test]
    fn uncertainties_are_combined_as_in_the_gum() {
        // Two contributions: u_A = 3 % with 8 degrees of freedom, and u_B = 4 % from a robot parameter.
        let widening = student(8.0);
        let half = 0.03 * widening * HALF_WIDTH_95;
        let widths = Widths::new([half; 2], &[], &[0.04], 0.1, widening);
        let found = StandardUncertainty::new(200.0, &widths, 8.0);
        assert!((found.type_a - 6.0).abs() < 1e-12 && (found.type_b - 8.0).abs() < 1e-12);
        // u_c = 5 %: 8 (5 / 3)^4 degrees of freedom.
        assert!((found.degrees_of_freedom - 61.728395).abs() < 1e-5, "{found:?}");
        // 97.5 % quantile of Student's t distribution with 8 degrees of freedom: 2.306004.
        let expanded = (0.03_f64 * 2.306004).hypot(0.04 * HALF_WIDTH_95);
        assert!((found.coverage_factor - expanded / 0.05).abs() < 1e-5, "{found:?}");
        // The factor of the interval is at least that of the effective degrees of freedom.
        assert!(found.coverage_factor > HALF_WIDTH_95 * student(found.degrees_of_freedom));
        // The shift with the gait extends the interval alone.
        assert!((widths.total[1] - widths.total[0] - 0.1).abs() < 1e-12);

        let random = Widths::new([half; 2], &[], &[], 0.0, widening);
        let random = StandardUncertainty::new(200.0, &random, 8.0);
        assert!((random.coverage_factor - 2.306004).abs() < 1e-5, "{random:?}");
        assert!((random.degrees_of_freedom - 8.0).abs() < 1e-12);
        let common = Widths::new([0.0; 2], &[], &[0.04], 0.0, 1.0);
        let common = StandardUncertainty::new(200.0, &common, 8.0);
        assert_eq!((common.type_a, common.degrees_of_freedom), (0.0, f64::INFINITY));
        assert!((common.coverage_factor - HALF_WIDTH_95).abs() < 1e-12);
        let open = Widths::new([half, f64::NAN], &[], &[0.04], 0.0, widening);
        assert!(StandardUncertainty::new(200.0, &open, 8.0).coverage_factor.is_nan());
        let certain = Widths::new([0.0; 2], &[], &[], 0.0, 1.0);
        let certain = StandardUncertainty::new(200.0, &certain, 8.0);
        assert!(certain.type_a == 0.0 && certain.degrees_of_freedom.is_nan());
    }

    #[test]
    fn only_the_variance_of_the_blocks_in_excess_of_chance_counts() {
        let blocks = [-0.03, 0.02, -0.01, 0.03, -0.02, 0.01];
        let jackknife = (5.0_f64 / 6.0 * 28e-4).sqrt();
        assert!((systematic_deviation(&blocks, &[], 0.0) - jackknife).abs() < 1e-12);
        assert_eq!(systematic_deviation(&blocks, &[], jackknife / 1.9), 0.0);
        assert!((systematic_deviation(&blocks, &[0.03, -0.04], jackknife) - 0.05).abs() < 1e-12);
        assert_eq!(systematic_deviation(&[], &[], 0.1), 0.0);
    }
}
