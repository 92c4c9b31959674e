//! Harmonic regression: an offset and five harmonics of a known frequency.

use std::ops::Range;

use nalgebra::{Cholesky, Const, SMatrix, SVector};

pub(super) const HARMONICS: usize = 5;
const TERMS: usize = 2 * HARMONICS + 1;
/// Samples below which a fit is not attempted.
pub(super) const LEAST_SAMPLES: usize = 3 * TERMS;

/// 1, cos, sin, cos 2, sin 2, ...
type Terms = SVector<f64, TERMS>;
type Factor = Cholesky<f64, Const<TERMS>>;

/// The phase of the gait as a function of the frame: `step_rad * i + offset_rad`, where i
/// counts from the first frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Clock {
    pub step_rad: f64,
    pub offset_rad: f64,
}

impl Clock {
    pub fn phase(&self, frame: f64) -> f64 {
        self.step_rad * frame + self.offset_rad
    }

    /// The frame, usually between two, at which the phase is `phase_rad`.
    pub fn frame(&self, phase_rad: f64) -> f64 {
        (phase_rad - self.offset_rad) / self.step_rad
    }

    /// Zero phase in the middle of a range, where frequency and phase are least correlated.
    pub fn centred(range: &Range<usize>, step_rad: f64) -> Self {
        let middle = 0.5 * (range.start + range.end) as f64;
        Self { step_rad, offset_rad: -step_rad * middle }
    }
}

/// `offset + sum of amplitude_k cos(k phase + phase_k)`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Harmonics {
    terms: Terms,
}

impl Harmonics {
    /// Least squares over the samples of a range that are not missing; `None` if there are
    /// too few, or too few of the cycle.
    pub fn fit(series: &[f64], range: Range<usize>, clock: &Clock) -> Option<Self> {
        Regression::new(series, range, clock).map(|regression| regression.harmonics)
    }

    pub fn offset(&self) -> f64 {
        self.terms[0]
    }

    /// Amplitude of harmonic `k`, counted from 1.
    pub fn amplitude(&self, k: usize) -> f64 {
        self.terms[2 * k - 1].hypot(self.terms[2 * k])
    }

    /// Phase of the first harmonic, rad, in (-pi, pi].
    pub fn phase_rad(&self) -> f64 {
        (-self.terms[2]).atan2(self.terms[1])
    }

    pub fn at(&self, phase_rad: f64) -> f64 {
        self.terms.dot(&basis(phase_rad))
    }

    /// Half the peak-to-peak over a cycle.
    pub fn half_range(&self) -> f64 {
        const POINTS: usize = 360;
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for i in 0..POINTS {
            let value = self.at(std::f64::consts::TAU * i as f64 / POINTS as f64);
            low = low.min(value);
            high = high.max(value);
        }
        0.5 * (high - low)
    }

    /// Derivative with respect to the phase.
    fn slope(&self, basis: &Terms) -> f64 {
        (1..=HARMONICS)
            .map(|k| {
                let (cos, sin) = (2 * k - 1, 2 * k);
                k as f64 * (self.terms[sin] * basis[cos] - self.terms[cos] * basis[sin])
            })
            .sum()
    }
}

fn basis(phase_rad: f64) -> Terms {
    let (sin, cos) = phase_rad.sin_cos();
    let mut terms = Terms::zeros();
    terms[0] = 1.0;
    let (mut c, mut s) = (1.0, 0.0);
    for k in 1..=HARMONICS {
        (c, s) = (c * cos - s * sin, s * cos + c * sin);
        terms[2 * k - 1] = c;
        terms[2 * k] = s;
    }
    terms
}

/// A fit with what is needed to improve its frequency.
pub(super) struct Regression<'s> {
    pub harmonics: Harmonics,
    series: &'s [f64],
    range: Range<usize>,
    clock: Clock,
    factor: Factor,
}

/// What one joint says about the frequency.
#[derive(Debug, Default, Clone, Copy)]
pub(super) struct FrequencyInformation {
    /// Product of the residuals with the derivative with respect to the step.
    pub gradient: f64,
    /// Square of the part of that derivative which no harmonic explains.
    pub curvature: f64,
    /// Sum of squared residuals, and of products of neighbouring ones.
    pub squares: f64,
    pub neighbours: f64,
    /// Samples beyond the number of parameters.
    pub freedom: f64,
}

impl<'s> Regression<'s> {
    pub fn new(series: &'s [f64], range: Range<usize>, clock: &Clock) -> Option<Self> {
        let mut gram = SMatrix::<f64, TERMS, TERMS>::zeros();
        let mut right = Terms::zeros();
        let mut count = 0;
        for i in range.clone().filter(|&i| !series[i].is_nan()) {
            let basis = basis(clock.phase(i as f64));
            for row in 0..TERMS {
                for column in 0..=row {
                    gram[(row, column)] += basis[row] * basis[column];
                }
            }
            right += basis * series[i];
            count += 1;
        }
        if count < LEAST_SAMPLES {
            return None;
        }
        gram.fill_upper_triangle_with_lower_triangle();
        // Too little of the cycle makes the harmonics indistinguishable.
        let factor = Factor::new(gram).filter(|factor| {
            let diagonal = factor.l_dirty().diagonal();
            diagonal.min() > 1e-4 * diagonal.max()
        })?;
        let harmonics = Harmonics { terms: factor.solve(&right) };
        Some(Self { harmonics, series, range, clock: *clock, factor })
    }

    /// The Gauss-Newton system for the step; time counts from where the clock's phase is zero.
    pub fn frequency_information(&self) -> FrequencyInformation {
        let origin = self.clock.frame(0.0);
        let mut sum = FrequencyInformation::default();
        let mut explained = Terms::zeros();
        let mut previous = 0.0;
        let mut count = 0.0;
        for i in self.range.clone() {
            let frame = i as f64;
            let basis = basis(self.clock.phase(frame));
            let residual = self.series[i] - self.harmonics.terms.dot(&basis);
            if residual.is_nan() {
                previous = 0.0;
                continue;
            }
            let slope = (frame - origin) * self.harmonics.slope(&basis);
            explained += basis * slope;
            sum.gradient += residual * slope;
            sum.curvature += slope * slope;
            sum.squares += residual * residual;
            sum.neighbours += residual * previous;
            previous = residual;
            count += 1.0;
        }
        sum.curvature -= explained.dot(&self.factor.solve(&explained));
        sum.freedom = count - TERMS as f64;
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sum_of_harmonics_is_found_whatever_is_missing() {
        let clock = Clock { step_rad: 0.0325, offset_rad: -0.7 };
        let wave = |i: usize| {
            let phase = clock.phase(i as f64);
            0.3 + 0.5 * (phase + 2.0).cos() + 0.02 * (3.0 * phase - 1.0).cos()
        };
        let mut series: Vec<f64> = (0..900).map(wave).collect();
        series[100..160].fill(f64::NAN);
        let fit = Harmonics::fit(&series, 30..880, &clock).unwrap();
        assert!((fit.offset() - 0.3).abs() < 1e-12);
        assert!((fit.amplitude(1) - 0.5).abs() < 1e-12);
        assert!((fit.amplitude(3) - 0.02).abs() < 1e-12);
        assert!((fit.phase_rad() - 2.0).abs() < 1e-12);
        assert!((fit.at(clock.phase(130.0)) - wave(130)).abs() < 1e-12);
    }

    #[test]
    fn half_the_range_of_a_cosine_is_its_amplitude() {
        let clock = Clock { step_rad: 0.05, offset_rad: 0.1 };
        let series: Vec<f64> = (0..400).map(|i| 1.0 + 0.4 * clock.phase(i.into()).cos()).collect();
        let fit = Harmonics::fit(&series, 0..400, &clock).unwrap();
        assert!((fit.half_range() - 0.4).abs() < 1e-4 * 0.4);
    }

    #[test]
    fn a_small_part_of_a_cycle_gives_no_fit() {
        let clock = Clock { step_rad: 1e-3, offset_rad: 0.0 };
        let series: Vec<f64> = (0..200).map(|i| clock.phase(i.into()).cos()).collect();
        assert!(Harmonics::fit(&series, 0..200, &clock).is_none());
        assert!(Harmonics::fit(&series, 0..10, &clock).is_none());
    }
}
