//! Confidence intervals in two parts.
//!
//! - *Scatter*: what cycles and repeats differ by. The quantiles of the bootstrap, corrected for
//!   noise that counts twice ([`super::noise_correction`]), or where none moves the profiles'
//!   limits.
//! - *Systematic*: what all trials share, and no repeat shows.
//!   - What the fit takes the model for: a jackknife over blocks of neighbouring frequencies
//!     spreads by more than the scatter if no one set of coefficients describes them all. Only
//!     what exceeds [`BY_CHANCE`] times the scatter's variance counts. Fewer than
//!     [`FitNotes::LEAST_FREQUENCIES`] do not tell it, and it is missing.
//!   - What is assumed of the robot: every standard deviation that the configuration gives, or
//!     that joint-release and coast-down trials have, moves the fit by so much.
//!   - The gait, where the command drives the model: servos miss it, and the measured gait gives
//!     other coefficients. An interval reaches as much further to that side, since a known shift
//!     is not corrected by a wider symmetric interval. Where the measured gait drives the model
//!     its errors are part of the scatter.
//!
//! Standard deviations of logarithms add up as squares, and as 1.96 of them with the scatter's half
//! width. Without anything that tells the noise there is no interval, nor for a model that does not
//! fit: there is no true coefficient for it to hold.
//!
//! References: B. Efron and R. J. Tibshirani, *An Introduction to the Bootstrap*, Chapman & Hall
//! 1993, section 11.5 (jackknife of blocks: section 8.6); for the uncorrected shift S. D. Phillips,
//! K. R. Eberhardt and B. Parry, J. Res. NIST 102 (1997) 577.

use rayon::prelude::*;
use trilink_robot::Robot;
use trilink_statistics::{HALF_WIDTH_95, SIDES_95, mean, quantiles};
use trilink_tables::{FitNotes, NoInterval, NoIntervalReason};

use super::adequacy::Adequacy;
use super::fitted_point::FittedPoint;
use super::input::FreeParameter;
use super::measurement::Measurement;
use super::noise_correction::NoiseCorrection;
use super::objective::Objective;
use super::profile::{Class, Profile};
use super::resampler::Resampler;
use super::starts::{Start, search_from};

/// Blocks of frequencies of a campaign.
const BLOCKS: usize = 6;
/// What a jackknife's variance over that of the scatter is at most in 95 of 100 fits of a model that
/// is true, of the 534 coefficients of sixty nights (crates/fit/tests/it/coverage.rs): more than of least squares
/// (2.2), because least absolute deviations go from breakpoint to breakpoint.
const BY_CHANCE: f64 = 6.0;

/// Of the free parameters, in their order.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Intervals {
    /// NaN where a side is open, or for the reason in `why_none`.
    pub limits: [Vec<f64>; 2],
    /// Half widths by one part alone.
    pub scatter: Vec<f64>,
    pub systematic: Vec<f64>,
    pub why_none: Option<NoInterval>,
}

/// Shifts of the free parameters' logarithms by what all trials share.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Systematic {
    /// Of the fit without each block of frequencies.
    pub blocks: Vec<Vec<f64>>,
    /// Of the fit with each assumption off by its standard deviation.
    pub assumed: Vec<Vec<f64>>,
    /// Of the fit to the measured gait, where the command drives the model.
    pub gait: Option<Vec<f64>>,
}

impl Systematic {
    /// Refits without blocks of frequencies and with the other `robots`; and the motions solved.
    pub(crate) fn new(point: &FittedPoint, robots: &[Robot]) -> (Self, usize) {
        let objective = point.evaluator.objective;
        let mut blocks = blocks(&objective.measurements);
        blocks.retain(|of_campaign| of_campaign.len() >= FitNotes::LEAST_FREQUENCIES);
        let without: Vec<Start> =
            blocks.concat().par_iter().map(|block| point.refit_without(block)).collect();
        let with = |robot: &Robot| {
            let other = Objective { robot: robot.clone(), ..objective.clone() };
            let evaluator = other.evaluator(point.evaluator.parameters.clone());
            search_from(evaluator, point.values.clone())
        };
        let assumed: Vec<Start> = robots.par_iter().map(with).collect();
        let solves = without.iter().chain(&assumed).map(|refit| refit.solves).sum();
        let shifts =
            |refits: &[Start]| refits.iter().map(|refit| point.shift_to(&refit.ended)).collect();
        (Self { blocks: shifts(&without), assumed: shifts(&assumed), gait: None }, solves)
    }
}

/// Indices of the measurements of blocks of neighbouring frequencies, of each campaign.
pub(super) fn blocks(sorted: &[Measurement]) -> Vec<Vec<Vec<usize>>> {
    let frequencies = Measurement::frequencies(sorted);
    let campaign = |trials: &Vec<usize>| sorted[trials[0]].campaign;
    let of_campaign = |frequencies: &[Vec<usize>]| {
        let count = BLOCKS.min(frequencies.len());
        let block = |number: usize| -> Vec<usize> {
            let [from, to] = [number, number + 1].map(|edge| edge * frequencies.len() / count);
            frequencies[from..to].concat()
        };
        (0..count).map(block).collect()
    };
    frequencies.chunk_by(|a, b| campaign(a) == campaign(b)).map(of_campaign).collect()
}

/// How far a quantity may be off to either side.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Widths {
    /// By what all trials share alone.
    pub shared: [f64; 2],
    /// By that and by scatter.
    pub total: [f64; 2],
}

impl Widths {
    /// From its changes in the replicates, and its shifts as in [`Systematic`].
    pub(crate) fn of_changes(
        replicates: Vec<f64>,
        blocks: &[f64],
        assumed: &[f64],
        gait: f64,
    ) -> Self {
        let [low, high] = quantiles(replicates, SIDES_95);
        // The fit is in its interval.
        Self::new([-low, high].map(|width| width.max(0.0)), blocks, assumed, gait)
    }

    /// From its widths by scatter, and its shifts as in [`Systematic`].
    fn new(scatter: [f64; 2], blocks: &[f64], assumed: &[f64], gait: f64) -> Self {
        let [below, above] = scatter;
        let deviation = match (below + above) / 2.0 {
            half if half.is_finite() => half / HALF_WIDTH_95,
            _ => below.max(above) / HALF_WIDTH_95,
        };
        let common = HALF_WIDTH_95 * deviation_by_shifts(blocks, assumed, deviation.max(0.0));
        let gait = [(-gait).max(0.0), gait.max(0.0)];
        Self {
            shared: gait.map(|gait| common + gait),
            total: [below.hypot(common) + gait[0], above.hypot(common) + gait[1]],
        }
    }
}

/// Standard deviation by shifts that all trials share, given that by scatter.
fn deviation_by_shifts(blocks: &[f64], assumed: &[f64], scatter: f64) -> f64 {
    let assumed: f64 = assumed.iter().map(|shift| shift.powi(2)).sum();
    if blocks.is_empty() {
        return assumed.sqrt();
    }
    let count = blocks.len() as f64;
    let mean = mean(blocks.iter().copied());
    let squares: f64 = blocks.iter().map(|shift| (shift - mean).powi(2)).sum();
    let jackknife = (count - 1.0) / count * squares;
    let chance = BY_CHANCE * scatter.powi(2);
    ((jackknife - chance).max(0.0) + assumed).sqrt()
}

impl Intervals {
    pub(crate) const NONE: Self = Self {
        limits: [Vec::new(), Vec::new()],
        scatter: Vec::new(),
        systematic: Vec::new(),
        why_none: None,
    };

    /// Of a fit with its profiles (one per parameter, or none) and replicates.
    pub(crate) fn new(
        point: &FittedPoint,
        profiles: &[Profile],
        replicates: &[Start],
        resampler: &Resampler,
        adequacy: &Adequacy,
        systematic: &Systematic,
    ) -> Self {
        let parameters = &point.evaluator.parameters;
        let none = || vec![f64::NAN; parameters.len()];
        let lacking = resampler.without_noise(point.evaluator.objective);
        let mut all =
            Self { limits: [none(), none()], scatter: none(), systematic: none(), why_none: None };
        if parameters.is_empty() {
            return all;
        }
        if !lacking.is_empty() {
            let of = lacking.into_iter().map(str::to_owned).collect();
            all.why_none = Some(NoInterval { reason: NoIntervalReason::UnknownNoise, of });
            return all;
        }
        if replicates.is_empty() && profiles.is_empty() {
            all.why_none = Some(NoIntervalReason::NotAskedFor.into());
            return all;
        }
        let correction = NoiseCorrection::of(point, resampler).spread;
        for (index, free) in parameters.iter().enumerate() {
            let fitted = point.values[index];
            let scatter = [0, 1].map(|side| {
                let limit = scatter_limit(profiles, replicates, index, free, side);
                limit.log_ratio(fitted, correction)
            });
            let scatter = scatter.map(f64::abs);
            let of = |all: &[Vec<f64>]| all.iter().map(|shifts| shifts[index]).collect::<Vec<_>>();
            let shift = systematic.gait.as_ref().map_or(0.0, |shifts| shifts[index]);
            let Widths { shared, total } =
                Widths::new(scatter, &of(&systematic.blocks), &of(&systematic.assumed), shift);
            let half_width =
                |[below, above]: [f64; 2]| 0.5 * fitted * (above.exp() - (-below).exp());
            all.scatter[index] = half_width(scatter);
            all.systematic[index] = half_width(shared);
            for (side, signed) in [-total[0], total[1]].into_iter().enumerate() {
                let limit = fitted * signed.exp();
                let is_open = free.is_at_bound(limit)[side];
                all.limits[side][index] = if is_open { f64::NAN } else { limit };
            }
        }
        if adequacy.is_adequate == Some(false) {
            all.limits = [none(), none()];
            all.why_none = Some(NoIntervalReason::Inadequate.into());
        }
        all
    }
}

/// A limit by scatter alone.
#[derive(Debug, Clone, Copy, PartialEq)]
enum ScatterLimit {
    /// Quantile of the replicates, before their noise correction.
    Resampled(f64),
    /// Where the profile crosses its limit.
    Profiled(f64),
    /// Nothing ends the interval on this side.
    Open,
}

impl ScatterLimit {
    /// Its logarithm less that of the fitted value; NaN where it is open.
    fn log_ratio(self, fitted: f64, correction: f64) -> f64 {
        match self {
            Self::Resampled(limit) => correction * (limit / fitted).ln(),
            Self::Profiled(limit) => (limit / fitted).ln(),
            Self::Open => f64::NAN,
        }
    }
}

/// The limit by scatter on one side: open if the coefficient is not identifiable, by the profile
/// where replicates are at a bound, since the bootstrap is inconsistent there (D. W. K. Andrews,
/// Econometrica 68 (2000) 399).
fn scatter_limit(
    profiles: &[Profile],
    replicates: &[Start],
    index: usize,
    free: &FreeParameter,
    side: usize,
) -> ScatterLimit {
    let ends = replicates.iter().map(|refit| refit.ended[index]).collect();
    let quantiles = quantiles(ends, SIDES_95);
    let is_within = quantiles.iter().all(|limit| !free.is_at_bound(*limit).contains(&true));
    let resampled = Some(quantiles).filter(|[low, high]| low < high && is_within);
    let is_inside = |limit: &f64| !free.is_at_bound(*limit)[side];
    match (profiles.get(index), resampled) {
        (Some(profile), _) if profile.class != Class::Identifiable => ScatterLimit::Open,
        (_, Some(resampled)) => ScatterLimit::Resampled(resampled[side]),
        (Some(profile), None) => profile.interval[side]
            .filter(is_inside)
            .map_or(ScatterLimit::Open, ScatterLimit::Profiled),
        (None, None) => ScatterLimit::Open,
    }
}

#[cfg(test)]
mod tests {
    use trilink_tables::Stopped;

    use trilink_robot::Quantity;

    use super::*;

    #[test]
    fn replicates_that_do_not_move_give_no_width_of_zero() {
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
    fn blocks_count_by_what_they_differ_by_more_than_chance() {
        let blocks = [-0.03, 0.02, -0.01, 0.03, -0.02, 0.01];
        let jackknife = (5.0_f64 / 6.0 * 28e-4).sqrt();
        assert!((deviation_by_shifts(&blocks, &[], 0.0) - jackknife).abs() < 1e-12);
        assert_eq!(deviation_by_shifts(&blocks, &[], jackknife / 1.9), 0.0);
        assert!((deviation_by_shifts(&blocks, &[0.03, -0.04], jackknife) - 0.05).abs() < 1e-12);
        assert_eq!(deviation_by_shifts(&[], &[], 0.1), 0.0);
    }
}
