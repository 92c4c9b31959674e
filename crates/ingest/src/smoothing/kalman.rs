//! Smoothing by a state-space model: harmonics of the gait plus an integrated Wiener process (a motion driven by white
//! jerk or white snap), observed with white noise.
//!
//! The Kalman filter and the fixed-interval smoother give the conditional mean and covariance of the motion. The
//! amplitudes of the harmonics and the initial state enter as regression effects of the filter's innovations (de Jong,
//! *Annals of Statistics* 19 (1991) 1073). The amplitudes from the second harmonic upwards have a normal prior whose
//! variance decreases as a power of the harmonic (Wahba, *Spline Models for Observational Data*, 1990, section 2.1:
//! periodic splines), so that the data determine how many harmonics matter; the other amplitudes and the initial state
//! have no prior. The variance of the noise is concentrated out of the likelihood. The density of the white process,
//! its order and the prior maximise the likelihood, penalised by the number of effects without prior (AIC). A missing
//! sample is a frame without a measurement. Time is counted in frames, and variances are relative to that of the noise.

use nalgebra::{ComplexField, SMatrix, SVector};

/// Real or complex values of a series; a complex series contains two coordinates with equal and independent noise.
pub(super) trait Scalar: ComplexField<RealField = f64> + Copy {
    /// Number of real coordinates.
    const DIMENSIONS: usize;

    fn is_missing(self) -> bool {
        self.real().is_nan() || self.imaginary().is_nan()
    }
}

impl Scalar for f64 {
    const DIMENSIONS: usize = 1;
}

impl Scalar for nalgebra::Complex<f64> {
    const DIMENSIONS: usize = 2;
}

/// Known functions of time whose amplitudes are estimated.
pub(super) trait Regressors<T> {
    /// Harmonic to which each regressor belongs, in descending order.
    fn harmonics(&self) -> &[usize];

    /// Stores the values at a frame, and the derivatives per frame.
    fn at(&self, frame: usize, values: &mut [T], rates: &mut [T]);
}

/// Pivot, relative to the diagonal element, below which a regressor is a combination of the preceding ones.
const MIN_PIVOT: f64 = 1e-11;

/// Model with its parameters.
pub(super) struct Fit<T> {
    /// Order of the derivative that is white noise: 3 for white jerk, 4 for white snap.
    order: usize,
    /// Half-amplitude (-6 dB) frequency of the smoother of the Wiener process, rad/frame: the frequency at which the spectra of the
    /// process and of the noise are equal.
    cutoff_rad: f64,
    /// Variance of the noise in a coordinate.
    variance: f64,
    aic: f64,
    /// Amplitudes of the regressors, then the initial state of the Wiener process.
    amplitudes: Vec<T>,
    /// Columns whose products with their conjugates sum to the covariance of `amplitudes` relative to the noise.
    factor: Vec<Vec<T>>,
}

/// Smoothed series with derivatives per frame.
pub(super) struct Smoothed<T> {
    pub value: Vec<T>,
    pub rate: Vec<T>,
    /// Part of the value and the rate without the regressors.
    pub trend: Vec<[T; 2]>,
    /// Variances of the value and of the rate of a coordinate, and their covariance.
    pub variance: Vec<[f64; 3]>,
}

/// Advances a state by a frame: a Taylor series.
fn advance<T: Scalar, const M: usize>(state: &mut [T; M]) {
    for i in 0..M {
        let mut factor = 1.0;
        for j in i + 1..M {
            factor /= (j - i) as f64;
            state[i] += state[j].scale(factor);
        }
    }
}

/// Applies the transpose of [`advance`].
fn advance_transposed<T: Scalar, const M: usize>(state: &mut [T; M]) {
    for j in (0..M).rev() {
        let mut factor = 1.0;
        for i in (0..j).rev() {
            factor /= (j - i) as f64;
            let earlier = state[i];
            state[j] += earlier.scale(factor);
        }
    }
}

fn transition<const M: usize>() -> SMatrix<f64, M, M> {
    SMatrix::from_fn(|i, j| {
        let mut column = [0.0; M];
        column[j] = 1.0;
        advance(&mut column);
        column[i]
    })
}

/// Returns the covariance that a white process of unit density adds to the state within a frame.
fn diffusion<const M: usize>() -> SMatrix<f64, M, M> {
    let factorial = |n: usize| (1..=n).map(|i| i as f64).product::<f64>();
    SMatrix::from_fn(|i, j| {
        1.0 / (factorial(M - 1 - i) * factorial(M - 1 - j) * (2 * M - 1 - i - j) as f64)
    })
}

/// Covariance of the predicted state, with the gain and the precision of the innovation in a frame (zero without a
/// measurement).
#[derive(Clone, Copy)]
struct Gain<const M: usize> {
    predicted: SMatrix<f64, M, M>,
    gain: SVector<f64, M>,
    precision: f64,
}

/// Covariance recursion of the Kalman filter; the state before the first frame is known exactly.
struct Riccati<const M: usize> {
    transition: SMatrix<f64, M, M>,
    diffusion: SMatrix<f64, M, M>,
    predicted: SMatrix<f64, M, M>,
}

impl<const M: usize> Riccati<M> {
    fn new(cutoff_rad: f64) -> Self {
        Self {
            transition: transition(),
            diffusion: diffusion() * cutoff_rad.powi(2 * M as i32),
            predicted: SMatrix::zeros(),
        }
    }

    fn next(&mut self, is_missing: bool) -> Gain<M> {
        let predicted = self.predicted;
        let variance = predicted[(0, 0)] + 1.0;
        let (precision, gain) = if is_missing {
            (0.0, SVector::zeros())
        } else {
            (1.0 / variance, predicted.column(0) / variance)
        };
        let filtered = predicted - gain * gain.transpose() * variance;
        self.predicted = self.transition * filtered * self.transition.transpose() + self.diffusion;
        Gain { predicted, gain, precision }
    }
}

/// Processes a sample: returns the innovation and advances the state.
fn innovate<T: Scalar, const M: usize>(state: &mut [T; M], sample: T, gain: &Gain<M>) -> T {
    let innovation = if gain.precision > 0.0 { sample - state[0] } else { T::zero() };
    for (state, gain) in state.iter_mut().zip(gain.gain.iter()) {
        *state += innovation.scale(*gain);
    }
    advance(state);
    innovation
}

/// Prior of the amplitudes from the second harmonic upwards, relative to the noise: independent and normal, with the
/// standard deviation `second (2 / k)^decay` for harmonic k.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Prior {
    second: f64,
    decay: f64,
}

impl Prior {
    /// Grid of standard deviations of the second harmonic, decades.
    const DECADES: [f64; 15] =
        [-2.0, -1.5, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 4.5, 5.0];
    const DECAYS: [f64; 6] = [1.0, 2.0, 3.0, 4.0, 6.0, 8.0];

    fn on_grid([decade, decay]: [usize; 2]) -> Self {
        Self { second: 10_f64.powf(Self::DECADES[decade]), decay: Self::DECAYS[decay] }
    }

    /// Returns the precision of the amplitudes of a harmonic.
    fn precision(self, harmonic: usize) -> f64 {
        (self.second * (2.0 / harmonic as f64).powf(self.decay)).powi(-2)
    }
}

/// Returns the number of regressors whose amplitudes have a prior.
fn random_effects(harmonics: &[usize]) -> usize {
    harmonics.iter().take_while(|k| **k >= 2).count()
}

/// Products of the innovations of the columns (regressors, initial states, then the series), lower triangle.
struct Normal<T> {
    /// Number of columns without the series.
    columns: usize,
    products: Vec<T>,
    log_variances: f64,
    samples: usize,
}

fn normal_equations<T: Scalar, const M: usize>(
    series: &[T],
    regressors: &impl Regressors<T>,
    cutoff_rad: f64,
) -> Normal<T> {
    let count = regressors.harmonics().len();
    let columns = count + M;
    let width = columns + 1;
    let mut states = vec![[T::zero(); M]; width];
    for (i, state) in states[count..columns].iter_mut().enumerate() {
        state[i] = -T::one();
    }
    let mut riccati = Riccati::<M>::new(cutoff_rad);
    let mut products = vec![T::zero(); width * width];
    let mut samples = vec![T::zero(); width];
    let mut rates = vec![T::zero(); count];
    let mut innovations = vec![T::zero(); width];
    let mut log_variances = 0.0;
    let mut seen = 0;
    for (frame, sample) in series.iter().enumerate() {
        let is_missing = sample.is_missing();
        let gain = riccati.next(is_missing);
        if is_missing {
            states.iter_mut().for_each(advance);
            continue;
        }
        regressors.at(frame, &mut samples[..count], &mut rates);
        samples[columns] = *sample;
        for ((state, sample), innovation) in states.iter_mut().zip(&samples).zip(&mut innovations) {
            *innovation = innovate(state, *sample, &gain);
        }
        seen += 1;
        log_variances -= gain.precision.ln();
        for (i, row) in products.chunks_exact_mut(width).enumerate() {
            let left = innovations[i].conjugate().scale(gain.precision);
            for (product, right) in row[..=i].iter_mut().zip(&innovations) {
                *product += left * *right;
            }
        }
    }
    Normal { columns, products, log_variances, samples: seen }
}

impl<T: Scalar> Normal<T> {
    /// Replaces `factor` by the Cholesky factor of the products with the prior's precisions. Columns that depend
    /// linearly on preceding ones are left out: their pivots are infinite.
    fn factorise(&self, precisions: &[f64], factor: &mut Vec<T>) {
        let width = self.columns + 1;
        factor.clone_from(&self.products);
        for j in 0..self.columns {
            let prior = precisions.get(j).copied().unwrap_or(0.0);
            let diagonal = factor[j * width + j].real() + prior;
            let row = &factor[j * width..j * width + j];
            let pivot = diagonal - row.iter().map(|x| x.modulus_squared()).sum::<f64>();
            let root = if pivot > MIN_PIVOT * diagonal { pivot.sqrt() } else { f64::INFINITY };
            factor[j * width + j] = T::from_real(root);
            for i in j + 1..width {
                let (upper, lower) = factor.split_at_mut(i * width);
                let mut sum = lower[j];
                for (left, right) in lower[..j].iter().zip(&upper[j * width..]) {
                    sum -= *left * right.conjugate();
                }
                lower[j] = sum.unscale(root);
            }
        }
    }

    /// Returns AIC and noise variance, given the precisions of the random amplitudes. Fixed amplitudes and initial
    /// states are maximum-likelihood estimates, and random amplitudes are integrated out.
    fn criterion(&self, precisions: &[f64], factor: &mut Vec<T>) -> (f64, f64) {
        self.factorise(precisions, factor);
        let width = self.columns + 1;
        let last = &factor[self.columns * width..];
        let dimensions = T::DIMENSIONS as f64;
        let count = self.samples as f64 * dimensions;
        let fixed = dimensions * (self.columns - precisions.len()) as f64;
        let explained = last[..self.columns].iter().map(|x| x.modulus_squared()).sum::<f64>();
        let squares = (last[self.columns].real() - explained).max(f64::MIN_POSITIVE);
        let log_determinant: f64 = precisions
            .iter()
            .enumerate()
            .map(|(j, precision)| 2.0 * factor[j * width + j].real().ln() - precision.ln())
            .sum();
        let aic = count * (squares / count).ln()
            + dimensions * (self.log_variances + log_determinant)
            + 2.0 * fixed;
        (aic, squares / (count - fixed))
    }

    /// Returns the fit with the prior of lowest AIC, found by steps on the grid from `start`, which is updated.
    fn fit(
        &self,
        order: usize,
        cutoff_rad: f64,
        harmonics: &[usize],
        start: &mut [usize; 2],
    ) -> Option<Fit<T>> {
        let random = &harmonics[..random_effects(harmonics)];
        let fixed = self.columns - random.len();
        if self.samples < 2 * fixed + 2 {
            return None;
        }
        let mut factor = Vec::new();
        let mut precisions = vec![0.0; random.len()];
        let mut at = |point: [usize; 2], factor: &mut Vec<T>| {
            let prior = Prior::on_grid(point);
            for (precision, harmonic) in precisions.iter_mut().zip(random) {
                *precision = prior.precision(*harmonic);
            }
            self.criterion(&precisions, factor)
        };
        let mut lowest = at(*start, &mut factor).0;
        let mut is_improved = !random.is_empty();
        while is_improved {
            is_improved = false;
            for [decade, decay] in [[1, 0], [-1, 0], [0, 1], [0, -1]] {
                let next =
                    [start[0].checked_add_signed(decade), start[1].checked_add_signed(decay)];
                let [Some(decade), Some(decay)] = next else { continue };
                if decade < Prior::DECADES.len() && decay < Prior::DECAYS.len() {
                    let aic = at([decade, decay], &mut factor).0;
                    if aic < lowest {
                        (lowest, *start, is_improved) = (aic, [decade, decay], true);
                    }
                }
            }
        }
        let (aic, variance) = at(*start, &mut factor);
        let width = self.columns + 1;
        // Solves the transposed triangular system.
        let solve = |right: &mut [T]| {
            for i in (0..self.columns).rev() {
                let mut sum = right[i];
                for k in i + 1..self.columns {
                    sum -= factor[k * width + i].conjugate() * right[k];
                }
                right[i] = sum.unscale(factor[i * width + i].real());
            }
        };
        let last = &factor[self.columns * width..][..self.columns];
        let mut amplitudes: Vec<T> = last.iter().map(|x| x.conjugate()).collect();
        solve(&mut amplitudes);
        let factor = (0..self.columns)
            .map(|column| {
                let mut unit = vec![T::zero(); self.columns];
                unit[column] = T::one();
                solve(&mut unit);
                unit
            })
            .collect();
        Some(Fit { order, cutoff_rad, variance, aic, amplitudes, factor })
    }
}

/// Number of cutoff frequencies per decade in the first search.
const PER_DECADE: usize = 4;
/// Number of refinements of the cutoff frequency, each of which halves the step.
const REFINEMENTS: usize = 2;

/// Fits the model with the lowest AIC; `None` if the series has too few samples. The cutoff frequency is at most
/// `max_cutoff_rad`, rad/frame.
pub(super) fn fit<T: Scalar>(
    series: &[T],
    regressors: &impl Regressors<T>,
    max_cutoff_rad: f64,
) -> Option<Fit<T>> {
    let jerk = fit_order::<T, 3>(series, regressors, max_cutoff_rad);
    let snap = fit_order::<T, 4>(series, regressors, max_cutoff_rad);
    lower(jerk, snap)
}

/// Returns the fit with the lower AIC.
fn lower<T>(a: Option<Fit<T>>, b: Option<Fit<T>>) -> Option<Fit<T>> {
    [a, b].into_iter().flatten().min_by(|a, b| a.aic.total_cmp(&b.aic))
}

fn fit_order<T: Scalar, const M: usize>(
    series: &[T],
    regressors: &impl Regressors<T>,
    max_cutoff_rad: f64,
) -> Option<Fit<T>> {
    let mut prior = [Prior::DECADES.len() / 2, Prior::DECAYS.len() / 2];
    let mut at = |log: f64| {
        let cutoff_rad = log.exp();
        let normal = normal_equations::<T, M>(series, regressors, cutoff_rad);
        normal.fit(M, cutoff_rad, regressors.harmonics(), &mut prior)
    };
    let max = max_cutoff_rad.ln();
    let min = (1.0 / series.len() as f64).ln().min(max);
    let mut step = std::f64::consts::LN_10 / PER_DECADE as f64;
    let steps = ((max - min) / step).ceil() as usize;
    let mut best = (0..=steps).map(|i| at(max - step * i as f64)).fold(None, lower);
    for _ in 0..REFINEMENTS {
        step *= 0.5;
        let middle = best.as_ref()?.cutoff_rad.ln();
        for log in [middle - step, middle + step] {
            if log <= max {
                best = lower(best, at(log));
            }
        }
    }
    best
}

/// Smooths a series with a fitted model.
pub(super) fn smooth<T: Scalar>(
    series: &[T],
    regressors: &impl Regressors<T>,
    fit: &Fit<T>,
) -> Smoothed<T> {
    if fit.order == 3 {
        smooth_order::<T, 3>(series, regressors, fit)
    } else {
        smooth_order::<T, 4>(series, regressors, fit)
    }
}

fn smooth_order<T: Scalar, const M: usize>(
    series: &[T],
    regressors: &impl Regressors<T>,
    fit: &Fit<T>,
) -> Smoothed<T> {
    let mut riccati = Riccati::<M>::new(fit.cutoff_rad);
    let gains: Vec<Gain<M>> =
        series.iter().map(|sample| riccati.next(sample.is_missing())).collect();
    let mut pass = Pass { gains: &gains, predictions: Vec::new(), regressors, buffer: Vec::new() };
    let (value, trend): (Vec<[T; 2]>, Vec<[T; 2]>) = {
        let smoothed = pass.smoothed(&fit.amplitudes, |frame| series[frame]);
        smoothed.into_iter().unzip()
    };
    let mut variance = conditional_variances(&gains);
    for column in &fit.factor {
        let errors = pass.smoothed(column, |_| T::zero());
        for (variance, ([value, rate], _)) in variance.iter_mut().zip(errors) {
            variance[0] += value.modulus_squared();
            variance[1] += rate.modulus_squared();
            variance[2] += (value * rate.conjugate()).real();
        }
    }
    for variance in variance.iter_mut().flatten() {
        *variance *= fit.variance;
    }
    let (value, rate) = value.into_iter().map(|[value, rate]| (value, rate)).unzip();
    Smoothed { value, rate, trend, variance }
}

/// Smoothing with known amplitudes.
struct Pass<'g, T, R, const M: usize> {
    gains: &'g [Gain<M>],
    predictions: Vec<([T; M], T)>,
    regressors: &'g R,
    buffer: Vec<T>,
}

impl<T: Scalar, R: Regressors<T>, const M: usize> Pass<'_, T, R, M> {
    /// Returns the sum of the regressors with the given amplitudes at a frame, and its derivative.
    fn regression(&mut self, amplitudes: &[T], frame: usize) -> [T; 2] {
        let all = self.regressors.harmonics().len();
        self.buffer.resize(2 * all, T::zero());
        let (values, rates) = self.buffer.split_at_mut(all);
        self.regressors.at(frame, values, rates);
        let mut sum = [T::zero(); 2];
        for ((amplitude, value), rate) in amplitudes.iter().zip(values).zip(rates) {
            sum[0] += *amplitude * *value;
            sum[1] += *amplitude * *rate;
        }
        sum
    }

    /// Returns, for each frame, the value and the rate, and the parts of them that are not due to the regressors.
    fn smoothed(&mut self, amplitudes: &[T], series: impl Fn(usize) -> T) -> Vec<([T; 2], [T; 2])> {
        let (amplitudes, initial) = amplitudes.split_at(amplitudes.len() - M);
        let mut state = [T::zero(); M];
        state.copy_from_slice(initial);
        self.predictions.clear();
        let mut smoothed = Vec::with_capacity(self.gains.len());
        for (frame, gain) in self.gains.iter().enumerate() {
            let regression = self.regression(amplitudes, frame);
            let predicted = state;
            let innovation = innovate(&mut state, series(frame) - regression[0], gain);
            self.predictions.push((predicted, innovation));
            smoothed.push((regression, [T::zero(); 2]));
        }
        let mut adjoint = [T::zero(); M];
        for ((gain, (predicted, innovation)), (value, trend)) in
            self.gains.iter().zip(&self.predictions).zip(&mut smoothed).rev()
        {
            advance_transposed(&mut adjoint);
            let mut projected = T::zero();
            for (adjoint, gain) in adjoint.iter().zip(gain.gain.iter()) {
                projected += adjoint.scale(*gain);
            }
            adjoint[0] += innovation.scale(gain.precision) - projected;
            for (i, trend) in trend.iter_mut().enumerate() {
                *trend = predicted[i];
                for (j, adjoint) in adjoint.iter().enumerate() {
                    *trend += adjoint.scale(gain.predicted[(i, j)]);
                }
                value[i] += *trend;
            }
        }
        smoothed
    }
}

/// Returns, for each frame, the variances of the value and the rate of the Wiener process, given its initial state, and
/// their covariance.
fn conditional_variances<const M: usize>(gains: &[Gain<M>]) -> Vec<[f64; 3]> {
    let transition = transition::<M>();
    let mut information = SMatrix::<f64, M, M>::zeros();
    let mut variances = vec![[0.0; 3]; gains.len()];
    for (Gain { predicted, gain, precision }, variance) in gains.iter().zip(&mut variances).rev() {
        let mut closed = transition;
        for i in 0..M {
            let along = (transition.row(i) * gain)[0];
            closed[(i, 0)] -= along;
        }
        information = closed.transpose() * information * closed;
        information[(0, 0)] += precision;
        let smoothed = predicted - predicted * information * predicted;
        *variance = [smoothed[(0, 0)], smoothed[(1, 1)], smoothed[(0, 1)]];
    }
    variances
}

#[cfg(test)]
mod tests {
    use nalgebra::{Complex, DMatrix, DVector};
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    use super::*;

    /// First and second harmonics of a phase that advances by `step_rad` per frame.
    struct Two {
        step_rad: f64,
    }

    impl Regressors<f64> for Two {
        fn harmonics(&self) -> &[usize] {
            &[2, 2, 1, 1]
        }

        fn at(&self, frame: usize, values: &mut [f64], rates: &mut [f64]) {
            for (i, k) in [2.0, 1.0].into_iter().enumerate() {
                let rate = k * self.step_rad;
                let (sin, cos) = (rate * frame as f64).sin_cos();
                values[2 * i..2 * i + 2].copy_from_slice(&[cos, sin]);
                rates[2 * i..2 * i + 2].copy_from_slice(&[-rate * sin, rate * cos]);
            }
        }
    }

    fn normal(random: &mut rand_chacha::ChaCha8Rng) -> f64 {
        StandardNormal.sample(random)
    }

    /// Noisy samples of a wave with two harmonics on a parabola, with gaps.
    fn wave(frames: usize, step_rad: f64, noise: f64, seed: u64) -> (Vec<f64>, Vec<[f64; 2]>) {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        let truth = (0..frames).map(|frame| {
            let t = frame as f64;
            let p = step_rad * t;
            let value = 0.3 + 0.01 * t - 2e-5 * t * t + p.cos() + 0.1 * (2.0 * p + 0.4).sin();
            let rate = 0.01 - 4e-5 * t + step_rad * (0.2 * (2.0 * p + 0.4).cos() - p.sin());
            [value, rate]
        });
        let truth: Vec<[f64; 2]> = truth.collect();
        let sample = |(i, [value, _]): (usize, &[f64; 2])| {
            let sample = value + noise * normal(&mut random);
            if i % 17 < 2 { f64::NAN } else { sample }
        };
        (truth.iter().enumerate().map(sample).collect(), truth)
    }

    /// The covariance of the integrated Wiener process between two times is an integral of products of powers, and the
    /// conditional mean and variance follow from the covariance of all samples.
    #[test]
    fn the_smoother_gives_the_conditional_mean_and_variance() {
        const M: usize = 3;
        let regressors = Two { step_rad: 0.3 };
        let (series, _) = wave(60, 0.3, 0.1, 3);
        let cutoff_rad = 0.2_f64;
        let mut prior = [4, 1];
        let fit = normal_equations::<f64, M>(&series, &regressors, cutoff_rad)
            .fit(M, cutoff_rad, regressors.harmonics(), &mut prior)
            .expect("enough samples");
        let smoothed = smooth(&series, &regressors, &fit);

        let taylor = |frame: usize| {
            let t = frame as f64;
            [1.0, t, 0.5 * t * t]
        };
        // The integral from 0 to min(s, t) of the products of two kernels (s - x)^2 / 2 by Gauss's formula, exact for
        // this polynomial, and of their derivatives with respect to s and t.
        let covariance = |s: f64, t: f64, [ds, dt]: [usize; 2]| {
            let kernel = |age: f64, derivative| if derivative == 0 { 0.5 * age * age } else { age };
            let half = 0.5 * s.min(t);
            let node = 0.6_f64.sqrt();
            let nodes = [(-node, 5.0 / 9.0), (0.0, 8.0 / 9.0), (node, 5.0 / 9.0)];
            let sum: f64 = nodes
                .iter()
                .map(|(x, w)| {
                    let x = half * (1.0 + x);
                    w * kernel(s - x, ds) * kernel(t - x, dt)
                })
                .sum();
            cutoff_rad.powi(6) * half * sum
        };
        let seen: Vec<usize> = (0..series.len()).filter(|&i| !series[i].is_nan()).collect();
        let n = seen.len();
        let mut columns = DMatrix::zeros(n, 7);
        let mut values = [0.0; 4];
        let mut rates = [0.0; 4];
        for (row, frame) in seen.iter().enumerate() {
            regressors.at(*frame, &mut values, &mut rates);
            let all = values.into_iter().chain(taylor(*frame));
            all.enumerate().for_each(|(j, x)| columns[(row, j)] = x);
        }
        let at = |i: usize| seen[i] as f64;
        let noise = DMatrix::from_fn(n, n, |i, j| {
            covariance(at(i), at(j), [0, 0]) + f64::from(u8::from(i == j))
        });
        let inverse = noise.try_inverse().expect("positive definite");
        let mut information = columns.transpose() * &inverse * &columns;
        let precision = Prior::on_grid(prior).precision(2);
        (0..2).for_each(|i| information[(i, i)] += precision);
        let of_effects = information.try_inverse().expect("positive definite");
        let samples = DVector::from_iterator(n, seen.iter().map(|&i| series[i]));
        let effects = &of_effects * columns.transpose() * &inverse * &samples;
        let residual = &inverse * (&samples - &columns * &effects);
        for frame in [0, 1, 17, 18, 30, 59] {
            regressors.at(frame, &mut values, &mut rates);
            let t = frame as f64;
            for (derivative, own) in [(0, values), (1, rates)] {
                let taylor = if derivative == 0 { taylor(frame) } else { [0.0, 1.0, t] };
                let row = DVector::from_iterator(7, own.into_iter().chain(taylor));
                let cross = DVector::from_fn(n, |i, _| covariance(t, at(i), [derivative, 0]));
                let mean = row.dot(&effects) + cross.dot(&residual);
                let found = [&smoothed.value, &smoothed.rate][derivative];
                assert!((found[frame] - mean).abs() < 1e-8, "{frame} {derivative}: {mean}");
                let error = &row - columns.transpose() * &inverse * &cross;
                let variance = covariance(t, t, [derivative; 2])
                    - (&cross.transpose() * &inverse * &cross)[0]
                    + error.dot(&(&of_effects * &error));
                let found = smoothed.variance[frame][derivative] / fit.variance;
                assert!((found / variance - 1.0).abs() < 1e-6, "{frame} {derivative}: {variance}");
            }
        }
    }

    #[test]
    fn errors_are_as_large_as_stated() {
        let mut squares = [0.0; 2];
        let mut count = 0.0;
        for seed in 0..10 {
            let regressors = Two { step_rad: 0.1 };
            let (series, truth) = wave(400, 0.1, 0.02, seed);
            let found = fit(&series, &regressors, 1.0).expect("enough samples");
            let smoothed = smooth(&series, &regressors, &found);
            for (i, [value, rate]) in truth.into_iter().enumerate() {
                let [variance, rate_variance, _] = smoothed.variance[i];
                squares[0] += (smoothed.value[i] - value).powi(2) / variance;
                squares[1] += (smoothed.rate[i] - rate).powi(2) / rate_variance;
                count += 1.0;
            }
        }
        for square in squares {
            assert!((0.5..2.0).contains(&(square / count)), "{}", square / count);
        }
    }

    #[test]
    fn two_coordinates_are_smoothed_as_one_complex_series() {
        struct Trend;
        impl<T> Regressors<T> for Trend {
            fn harmonics(&self) -> &[usize] {
                &[]
            }

            fn at(&self, _: usize, _: &mut [T], _: &mut [T]) {}
        }
        let (series, _) = wave(100, 0.05, 0.05, 1);
        let complex: Vec<Complex<f64>> =
            series.iter().map(|x| Complex::new(*x, 2.0 * *x)).collect();
        let equations = normal_equations::<f64, 4>(&series, &Trend, 0.1);
        let fit = equations.fit(4, 0.1, &[], &mut [0, 0]).expect("enough samples");
        let real = smooth(&series, &Trend, &fit);
        let equations = normal_equations::<Complex<f64>, 4>(&complex, &Trend, 0.1);
        let fit = equations.fit(4, 0.1, &[], &mut [0, 0]).expect("enough samples");
        let both = smooth(&complex, &Trend, &fit);
        for (real, both) in real.value.iter().zip(&both.value) {
            assert!((both.re - real).abs() < 1e-12 && (both.im - 2.0 * real).abs() < 1e-12);
        }
        // The noise of both coordinates is pooled.
        for (real, both) in real.variance.iter().zip(&both.variance) {
            assert!((both[0] / real[0] - 2.5).abs() < 1e-9, "{}", both[0] / real[0]);
        }
    }

    #[test]
    fn series_without_enough_samples_have_no_fit() {
        let regressors = Two { step_rad: 0.1 };
        assert!(fit(&[f64::NAN; 50], &regressors, 1.0).is_none());
        assert!(fit(&[1.0; 8], &regressors, 1.0).is_none());
        assert!(fit(&[], &regressors, 1.0).is_none());
    }
}
