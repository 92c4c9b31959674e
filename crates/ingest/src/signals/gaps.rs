//! Fills short gaps with a smooth curve fitted to the samples on both sides.

/// Number of samples on each side of a gap to which the polynomial that fills it is fitted.
const NEIGHBOURS: usize = 8;
/// Maximum degree of the polynomial that fills a gap. With eight samples on each side, a gap of twelve frames at 120 Hz
/// and a gait at 6 rad/s, the error is about 1e-5 of the amplitude.
const MAX_DEGREE: usize = 5;
/// Maximum distance between a gap and the samples to which the polynomial is fitted, frames.
const MAX_DISTANCE: usize = 16;

/// Returns the series with gaps of at most `max_gap` samples filled. Samples missing at the ends stay missing.
pub(crate) fn fill(series: &[f64], max_gap: usize) -> Vec<f64> {
    let mut filled = series.to_vec();
    for pair in runs(series).windows(2) {
        let start = pair[0].1;
        let end = pair[1].0;
        if end - start <= max_gap {
            bridge(series, start, end, &mut filled[start..end]);
        }
    }
    filled
}

/// Returns the runs of consecutive visible samples, as half-open ranges.
pub(super) fn runs(series: &[f64]) -> Vec<(usize, usize)> {
    let mut runs = Vec::new();
    let mut end = 0;
    for run in series.chunk_by(|a, b| a.is_nan() == b.is_nan()) {
        end += run.len();
        if !run[0].is_nan() {
            runs.push((end - run.len(), end));
        }
    }
    runs
}

/// Fills the gap `start..end` with a polynomial fitted by least squares to the neighbouring samples.
fn bridge(series: &[f64], start: usize, end: usize, gap: &mut [f64]) {
    let before = (start.saturating_sub(MAX_DISTANCE)..start).rev();
    let after = end..(end + MAX_DISTANCE).min(series.len());
    let seen = |i: &usize| !series[*i].is_nan();
    let middle = 0.5 * (start + end - 1) as f64;
    let scale = (NEIGHBOURS + end - start) as f64;
    let position = |i: usize| (i as f64 - middle) / scale;
    let mut positions = [0.0; 2 * NEIGHBOURS];
    let mut values = [0.0; 2 * NEIGHBOURS];
    let mut count = 0;
    let near = before.filter(seen).take(NEIGHBOURS).chain(after.filter(seen).take(NEIGHBOURS));
    for i in near {
        positions[count] = position(i);
        values[count] = series[i];
        count += 1;
    }
    let degree = (count / 3).clamp(1, MAX_DEGREE);
    let curve = Polynomial::fit(&positions[..count], &values[..count], degree);
    for (i, value) in (start..end).zip(gap) {
        *value = curve.at(position(i));
    }
}

/// Least-squares polynomial as a sum of polynomials that are orthogonal on the samples (Forsythe 1957), so that no
/// linear system has to be solved.
struct Polynomial {
    /// For each degree k: coefficients `shift_k` and `scale_k` of the recurrence
    /// `p_{k+1} = (t - shift_k) p_k - scale_k p_{k-1}`, and the weight of `p_k`.
    terms: [(f64, f64, f64); MAX_DEGREE + 1],
    degree: usize,
}

impl Polynomial {
    /// Fits a polynomial of the given degree to samples, of which there must be more than `degree`.
    fn fit(positions: &[f64], values: &[f64], degree: usize) -> Self {
        let mut terms = [(0.0, 0.0, 0.0); MAX_DEGREE + 1];
        let mut previous = [0.0; 2 * NEIGHBOURS];
        let mut current = [1.0; 2 * NEIGHBOURS];
        let mut norm_before = f64::INFINITY;
        for term in terms.iter_mut().take(degree + 1) {
            let mut norm = 0.0;
            let mut moment = 0.0;
            let mut product = 0.0;
            for ((t, y), p) in positions.iter().zip(values).zip(&current) {
                norm += p * p;
                moment += t * p * p;
                product += y * p;
            }
            let shift = moment / norm;
            let scale = norm / norm_before;
            *term = (shift, scale, product / norm);
            norm_before = norm;
            for ((t, p), q) in positions.iter().zip(&mut current).zip(&mut previous) {
                (*p, *q) = ((t - shift) * *p - scale * *q, *p);
            }
        }
        Self { terms, degree }
    }

    fn at(&self, t: f64) -> f64 {
        let mut previous = 0.0;
        let mut current = 1.0;
        let mut sum = 0.0;
        for (shift, scale, weight) in &self.terms[..=self.degree] {
            sum += weight * current;
            (previous, current) = (current, (t - shift) * current - scale * previous);
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quintic_is_restored_exactly() {
        let quintic = |i: usize| {
            let t = i as f64 / 20.0 - 1.0;
            1.0 + t - 2.0 * t.powi(2) + 3.0 * t.powi(4) - t.powi(5)
        };
        let truth: Vec<f64> = (0..40).map(quintic).collect();
        let mut series = truth.clone();
        series[14..26].fill(f64::NAN);
        for (filled, truth) in fill(&series, 12).iter().zip(&truth) {
            assert!((filled - truth).abs() < 1e-11);
        }
    }

    #[test]
    fn the_longest_gap_at_the_highest_frequency_is_bridged_closely() {
        let wave = |i: usize| (6.0 * i as f64 / 120.0).cos();
        for start in (20..150).step_by(7) {
            let mut series: Vec<f64> = (0..200).map(wave).collect();
            series[start..start + 12].fill(f64::NAN);
            for (i, filled) in fill(&series, 12).iter().enumerate() {
                assert!((filled - wave(i)).abs() < 1e-4, "{i}");
            }
        }
    }

    #[test]
    fn longer_gaps_and_ends_stay_missing() {
        let mut series: Vec<f64> = (0..60).map(f64::from).collect();
        series[..3].fill(f64::NAN);
        series[20..33].fill(f64::NAN);
        series[40..52].fill(f64::NAN);
        series[58..].fill(f64::NAN);
        let missing: Vec<usize> = fill(&series, 12)
            .iter()
            .enumerate()
            .filter(|(_, x)| x.is_nan())
            .map(|(i, _)| i)
            .collect();
        let expected: Vec<usize> = (0..3).chain(20..33).chain(58..60).collect();
        assert_eq!(missing, expected);
    }

    #[test]
    fn one_sample_on_each_side_gives_a_straight_line() {
        let series = [1.0, f64::NAN, f64::NAN, 4.0];
        for (filled, expected) in fill(&series, 2).iter().zip([1.0, 2.0, 3.0, 4.0]) {
            assert!((filled - expected).abs() < 1e-12);
        }
    }
}
