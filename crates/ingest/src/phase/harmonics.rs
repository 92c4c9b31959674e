//! Harmonic regression: least-squares fit of an offset and several harmonics of a known frequency.
//!
//! Frames are evenly spaced, and so are their phases: all blocks of frames share one table of cosines and sines, and
//! the harmonics are rotated by the phase at which each block starts.

use std::ops::Range;

use nalgebra::{Cholesky, DMatrix, DVector, Dyn, SVector};
use trilink_statistics::{extremes, seen};

/// Number of harmonics used to estimate frequency and phase from a joint angle.
pub const GAIT_HARMONICS: usize = 5;
/// Minimum number of samples per fitted term (offset, cosine or sine).
pub(super) const MIN_SAMPLES_PER_TERM: usize = 3;
/// Number of frames in a block; all blocks share one table of cosines and sines.
const BLOCK: usize = 16;
/// Number of terms summed in parallel (SIMD lanes).
const LANES: usize = 4;

/// Phase of the gait as a linear function of the frame: `step_rad * i + offset_rad`, where i counts frames from the
/// first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinearPhase {
    pub step_rad: f64,
    pub offset_rad: f64,
}

impl LinearPhase {
    /// Returns the phase at a frame, rad. The frame may be fractional.
    pub fn at(&self, frame: f64) -> f64 {
        self.step_rad * frame + self.offset_rad
    }

    /// Returns the frame at which the phase is `phase_rad`, in general a fractional number.
    pub(crate) fn frame_at(&self, phase_rad: f64) -> f64 {
        (phase_rad - self.offset_rad) / self.step_rad
    }

    /// Creates a phase that is zero at the centre of a range of frames, where the estimates of frequency and phase are
    /// least correlated.
    pub fn centred(range: &Range<usize>, step_rad: f64) -> Self {
        let middle = 0.5 * (range.start + range.end) as f64;
        Self { step_rad, offset_rad: -step_rad * middle }
    }
}

/// Fourier series `offset + sum of amplitude_k cos(k phase + phase_k)`.
#[derive(Debug, Clone)]
pub struct Harmonics {
    /// Offset, then the cosine and sine coefficients of every harmonic.
    terms: Vec<f64>,
}

impl Harmonics {
    /// Fits `count` harmonics by least squares to the visible samples in a range; `None` if there are too few samples
    /// or they cover too little of the cycle.
    pub fn fit(
        series: &[f64],
        range: Range<usize>,
        phase: &LinearPhase,
        count: usize,
    ) -> Option<Self> {
        Regression::new(series, range, phase, count).map(|regression| regression.harmonics)
    }

    /// Returns the offset (mean over a cycle).
    pub fn offset(&self) -> f64 {
        self.terms[0]
    }

    /// Returns the amplitude of harmonic `k`, counted from 1.
    pub fn amplitude(&self, k: usize) -> f64 {
        self.terms[2 * k - 1].hypot(self.terms[2 * k])
    }

    /// Returns the phase of the first harmonic, rad, in (-pi, pi].
    pub fn phase_rad(&self) -> f64 {
        (-self.terms[2]).atan2(self.terms[1])
    }

    /// Returns half the peak-to-peak range over a cycle.
    pub fn half_range(&self) -> f64 {
        let [low, high] = self.extremes();
        0.5 * (high - low)
    }

    /// Returns the minimum and the maximum over a cycle.
    pub fn extremes(&self) -> [f64; 2] {
        const POINTS: usize = 360;
        let phase =
            LinearPhase { step_rad: std::f64::consts::TAU / POINTS as f64, offset_rad: 0.0 };
        extremes(self.over(0..POINTS, &phase))
    }

    /// Returns the values at all frames in a range.
    pub fn over(&self, range: Range<usize>, phase: &LinearPhase) -> Vec<f64> {
        Grid::new(phase, self.count()).evaluate(&self.terms, range)
    }

    /// Returns the components of the series, scaled so that their squares sum to the mean square over a cycle, and so
    /// that their products with the components of another series sum to the mean product.
    pub fn components(mut self) -> Vec<f64> {
        self.terms[1..].iter_mut().for_each(|term| *term *= std::f64::consts::FRAC_1_SQRT_2);
        self.terms
    }

    /// Returns the value, at phase zero, of the series with the given components.
    pub(crate) fn value_at_zero(components: &[f64]) -> f64 {
        let cosines = components[1..].iter().step_by(2).sum::<f64>();
        components[0] + std::f64::consts::SQRT_2 * cosines
    }

    fn count(&self) -> usize {
        self.terms.len() / 2
    }

    /// Returns the derivative of the series with respect to the phase.
    pub fn slope(&self) -> Self {
        let mut terms = vec![0.0; self.terms.len()];
        for k in 1..=self.count() {
            terms[2 * k - 1] = k as f64 * self.terms[2 * k];
            terms[2 * k] = -(k as f64) * self.terms[2 * k - 1];
        }
        Self { terms }
    }
}

/// Fills `terms` with 1, cos p, sin p, cos 2p, sin 2p, ... of the phase p.
fn basis(phase_rad: f64, terms: &mut [f64]) {
    let (sin, cos) = phase_rad.sin_cos();
    let mut c = 1.0;
    let mut s = 0.0;
    terms[0] = 1.0;
    for pair in terms[1..].chunks_exact_mut(2) {
        (c, s) = (c * cos - s * sin, s * cos + c * sin);
        pair.copy_from_slice(&[c, s]);
    }
}

/// Table of harmonics at evenly spaced phases, for computing sums over frames.
struct Grid<'c> {
    phase: &'c LinearPhase,
    /// Values of the harmonic terms (cosines and sines) at each frame of a block that starts at phase 0.
    table: Vec<f64>,
    /// Number of terms per frame.
    width: usize,
}

impl<'c> Grid<'c> {
    fn new(phase: &'c LinearPhase, count: usize) -> Self {
        let width = 2 * count + 1;
        let mut table = vec![0.0; BLOCK * width];
        for (i, row) in table.chunks_exact_mut(width).enumerate() {
            basis(phase.step_rad * i as f64, row);
        }
        Self { phase, table, width }
    }

    /// Returns, for each term, the sum over the frames in a range of its products with `values`, which has one value
    /// for each of these frames; missing values count as zero.
    fn project(&self, values: &[f64], range: Range<usize>) -> Vec<f64> {
        let [mut sums, mut turn, mut block_sums] = [(); 3].map(|()| vec![0.0; self.width]);
        for (values, first) in values.chunks(BLOCK).zip(range.step_by(BLOCK)) {
            block_sums.fill(0.0);
            for (value, row) in values.iter().zip(self.table.chunks_exact(self.width)) {
                let value = if value.is_nan() { 0.0 } else { *value };
                block_sums.iter_mut().zip(row).for_each(|(sum, term)| *sum += value * term);
            }
            basis(self.phase.at(first as f64), &mut turn);
            sums[0] += block_sums[0];
            for k in (1..self.width).step_by(2) {
                let [c, s] = [turn[k], turn[k + 1]];
                let [cos, sin] = [block_sums[k], block_sums[k + 1]];
                sums[k] += c * cos - s * sin;
                sums[k + 1] += s * cos + c * sin;
            }
        }
        sums
    }

    /// Returns the linear combination of the terms with coefficients `factors` at every frame in a range.
    fn evaluate(&self, factors: &[f64], range: Range<usize>) -> Vec<f64> {
        let mut values = Vec::with_capacity(range.len());
        let [mut turn, mut turned] = [(); 2].map(|()| vec![0.0; self.width]);
        turned[0] = factors[0];
        for first in range.clone().step_by(BLOCK) {
            basis(self.phase.at(first as f64), &mut turn);
            for k in (1..self.width).step_by(2) {
                let [c, s] = [turn[k], turn[k + 1]];
                let [cos, sin] = [factors[k], factors[k + 1]];
                turned[k] = cos * c + sin * s;
                turned[k + 1] = sin * c - cos * s;
            }
            let rows = self.table.chunks_exact(self.width).take(range.end - first);
            values.extend(rows.map(|row| {
                let mut sums = [0.0; LANES];
                for (factors, terms) in turned.chunks(LANES).zip(row.chunks(LANES)) {
                    let products = factors.iter().zip(terms).map(|(factor, term)| factor * term);
                    sums.iter_mut().zip(products).for_each(|(sum, product)| *sum += product);
                }
                sums.iter().sum::<f64>()
            }));
        }
        values
    }

    /// Computes the Gram matrix of the terms, summed over those frames in a range at which `series` is visible.
    /// Products of harmonics are sums of harmonics of up to twice the order, whose sums over all frames have a closed
    /// form.
    fn gram(&self, series: &[f64], range: &Range<usize>) -> DMatrix<f64> {
        let highest = self.width - 1;
        let frames = range.len() as f64;
        let middle = self.phase.at(range.start as f64 + 0.5 * (frames - 1.0));
        let mut sums = vec![0.0; 2 * highest + 1];
        basis(middle, &mut sums);
        sums[0] = frames;
        for k in 1..=highest {
            let half = 0.5 * k as f64 * self.phase.step_rad;
            let kernel = (frames * half).sin() / half.sin();
            sums[2 * k - 1] *= kernel;
            sums[2 * k] *= kernel;
        }
        let mut terms = vec![0.0; sums.len()];
        for i in range.clone().filter(|&i| series[i].is_nan()) {
            basis(self.phase.at(i as f64), &mut terms);
            sums.iter_mut().zip(&terms).for_each(|(sum, term)| *sum -= term);
        }
        let harmonic_sums = HarmonicSums(sums);
        DMatrix::from_fn(self.width, self.width, |a, b| harmonic_sums.product(a, b))
    }
}

/// Sums over frames of 1, cos p, sin p, cos 2p, sin 2p, ... of the phase p.
struct HarmonicSums(Vec<f64>);

impl HarmonicSums {
    fn cos(&self, k: usize) -> f64 {
        if k == 0 { self.0[0] } else { self.0[2 * k - 1] }
    }

    fn sin(&self, k: usize) -> f64 {
        if k == 0 { 0.0 } else { self.0[2 * k] }
    }

    /// Returns the sum over frames of the product of two terms: term 2k - 1 is the cosine of harmonic k, term 2k its
    /// sine.
    fn product(&self, a: usize, b: usize) -> f64 {
        let j = a.div_ceil(2);
        let k = b.div_ceil(2);
        let sum = j + k;
        let difference = j.abs_diff(k);
        let sign = if j >= k { 1.0 } else { -1.0 };
        match (a % 2 == 1 || a == 0, b % 2 == 1 || b == 0) {
            (true, true) => 0.5 * (self.cos(difference) + self.cos(sum)),
            (false, false) => 0.5 * (self.cos(difference) - self.cos(sum)),
            (false, true) => 0.5 * (self.sin(sum) + sign * self.sin(difference)),
            (true, false) => 0.5 * (self.sin(sum) - sign * self.sin(difference)),
        }
    }
}

/// Harmonic fit with the quantities needed to refine its frequency.
pub(super) struct Regression<'s> {
    pub harmonics: Harmonics,
    series: &'s [f64],
    range: Range<usize>,
    phase: LinearPhase,
    factor: Cholesky<f64, Dyn>,
}

impl<'s> Regression<'s> {
    pub(super) fn new(
        series: &'s [f64],
        range: Range<usize>,
        phase: &LinearPhase,
        count: usize,
    ) -> Option<Self> {
        let samples = &series[range.clone()];
        let grid = Grid::new(phase, count);
        if seen(samples).count() < MIN_SAMPLES_PER_TERM * grid.width {
            return None;
        }
        // If the samples cover too little of the cycle, the harmonics are nearly collinear.
        let factor = Cholesky::new(grid.gram(series, &range)).filter(|factor| {
            let diagonal = factor.l_dirty().diagonal();
            diagonal.min() > 1e-4 * diagonal.max()
        })?;
        let right = DVector::from_vec(grid.project(samples, range.clone()));
        let terms = factor.solve(&right).data.into();
        Some(Self { harmonics: Harmonics { terms }, series, range, phase: *phase, factor })
    }

    /// Returns five sums for the Gauss-Newton equation of the phase step, which are additive over joints: the products
    /// of the residuals and the derivative D of the fit with respect to the step; the squares of the component of D
    /// that the harmonics do not explain; the squared residuals; the products of neighbouring residuals; and the
    /// degrees of freedom (number of samples minus number of terms). In D, time is relative to the zero of the phase.
    pub(super) fn step_equation(&self) -> SVector<f64, 5> {
        let origin = self.phase.frame_at(0.0);
        let grid = Grid::new(&self.phase, self.harmonics.count());
        let fitted = grid.evaluate(&self.harmonics.terms, self.range.clone());
        let mut slopes = grid.evaluate(&self.harmonics.slope().terms, self.range.clone());
        let [mut gradient, mut curvature, mut squares, mut neighbours] = [0.0; 4];
        let mut previous = 0.0;
        let mut count = 0.0;
        for ((i, fitted), slope) in self.range.clone().zip(fitted).zip(&mut slopes) {
            let residual = self.series[i] - fitted;
            if residual.is_nan() {
                previous = 0.0;
                *slope = 0.0;
                continue;
            }
            *slope *= i as f64 - origin;
            gradient += residual * *slope;
            curvature += *slope * *slope;
            squares += residual * residual;
            neighbours += residual * previous;
            previous = residual;
            count += 1.0;
        }
        let explained = DVector::from_vec(grid.project(&slopes, self.range.clone()));
        curvature -= explained.dot(&self.factor.solve(&explained));
        [gradient, curvature, squares, neighbours, count - grid.width as f64].into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sum_of_harmonics_is_found_whatever_is_missing() {
        let phase = LinearPhase { step_rad: 0.0325, offset_rad: -0.7 };
        let wave = |i: usize| {
            let phase = phase.at(i as f64);
            0.3 + 0.5 * (phase + 2.0).cos() + 0.02 * (3.0 * phase - 1.0).cos()
        };
        let mut series: Vec<f64> = (0..900).map(wave).collect();
        series[100..160].fill(f64::NAN);
        let fit = Harmonics::fit(&series, 30..880, &phase, 5).unwrap();
        assert!((fit.offset() - 0.3).abs() < 1e-12);
        assert!((fit.amplitude(1) - 0.5).abs() < 1e-12);
        assert!((fit.amplitude(3) - 0.02).abs() < 1e-12);
        assert!((fit.phase_rad() - 2.0).abs() < 1e-12);
        let values = fit.over(100..300, &phase);
        for (value, i) in values.iter().zip(100..) {
            assert!((value - wave(i)).abs() < 1e-12);
        }
        let squares: f64 = fit.components().iter().map(|x| x * x).sum();
        assert!((squares - (0.09 + 0.125 + 2e-4)).abs() < 1e-12);
    }

    #[test]
    fn the_gram_matrix_is_the_sum_of_the_products_of_the_terms() {
        const COUNT: usize = 7;
        let phase = LinearPhase { step_rad: 0.21, offset_rad: 0.4 };
        let series: Vec<f64> = (0..90).map(|i| if i % 11 == 3 { f64::NAN } else { 1.0 }).collect();
        let gram = Grid::new(&phase, COUNT).gram(&series, &(5..80));
        let mut terms = [0.0; 2 * COUNT + 1];
        let mut expected = DMatrix::zeros(terms.len(), terms.len());
        for i in (5..80).filter(|i| i % 11 != 3) {
            basis(phase.at(i.into()), &mut terms);
            let terms = DVector::from_row_slice(&terms);
            expected += &terms * terms.transpose();
        }
        assert!((gram - expected).amax() < 1e-11);
    }

    #[test]
    fn half_the_range_of_a_cosine_is_its_amplitude() {
        let phase = LinearPhase { step_rad: 0.05, offset_rad: 0.1 };
        let series: Vec<f64> = (0..400).map(|i| 1.0 + 0.4 * phase.at(i.into()).cos()).collect();
        let fit = Harmonics::fit(&series, 0..400, &phase, 5).unwrap();
        assert!((fit.half_range() - 0.4).abs() < 1e-4 * 0.4);
    }

    #[test]
    fn a_small_fraction_of_a_cycle_gives_no_fit() {
        let phase = LinearPhase { step_rad: 1e-3, offset_rad: 0.0 };
        let series: Vec<f64> = (0..200).map(|i| phase.at(i.into()).cos()).collect();
        assert!(Harmonics::fit(&series, 0..200, &phase, 5).is_none());
        assert!(Harmonics::fit(&series, 0..10, &phase, 5).is_none());
    }
}
