//! Moving average, and selection of its window width.

use trilink_statistics::median_high;

use super::derivative::WEIGHTS;
use super::gaps::runs;

/// Range of window widths of the moving average, samples.
const WINDOWS: std::ops::RangeInclusive<usize> = 5..=30;
/// Window width for trials without a commanded frequency, samples.
pub(crate) const WINDOW_WITHOUT_GAIT: usize = 9;
/// Weight of attenuated joint rate relative to noise of the same power: noise can be removed from the skid ratio
/// afterwards, attenuation cannot.
const ATTENUATION_WEIGHT: f64 = 10.0;

/// Averages over `window` samples around each sample. To be centred, an even window extends half a sample further on
/// both sides, with half the weight at its ends. At the ends of every run without gaps the window shrinks
/// symmetrically; missing samples stay missing.
pub(crate) fn moving_average(series: &[f64], window: usize) -> Vec<f64> {
    let half = window / 2;
    let mut smooth = vec![f64::NAN; series.len()];
    for (start, end) in runs(series) {
        let run = &series[start..end];
        for (i, smooth) in smooth[start..end].iter_mut().enumerate() {
            let reach = i.min(run.len() - 1 - i);
            *smooth = if reach < half {
                average(run, i, reach, 2 * reach + 1)
            } else {
                average(run, i, half, window)
            };
        }
    }
    smooth
}

/// Returns the average over `window` samples around sample `i`, which extend `reach` samples to either side. Deviations
/// from the central sample are summed, which keeps a constant series exactly constant.
fn average(run: &[f64], i: usize, reach: usize, window: usize) -> f64 {
    let middle = run[i];
    let inner = reach - usize::from(window.is_multiple_of(2));
    let sum = (1..=inner).map(|k| deviations(run, i, k)).sum::<f64>();
    let ends = (inner + 1..=reach).map(|k| 0.5 * deviations(run, i, k)).sum::<f64>();
    middle + (sum + ends) / window as f64
}

/// Returns the sum of the deviations, from sample `i`, of the two samples `k` before and after it.
fn deviations(run: &[f64], i: usize, k: usize) -> f64 {
    let middle = run[i];
    (run[i - k] - middle) + (run[i + k] - middle)
}

/// Returns the gain of the moving average for a sine with a phase step of `step_rad` per sample: the Dirichlet kernel,
/// for an even window with half weights at its ends.
pub(crate) fn response(window: usize, step_rad: f64) -> f64 {
    let half = 0.5 * step_rad;
    if half.sin().abs() < 1e-12 {
        return 1.0;
    }
    let kernel = (window as f64 * half).sin() / (window as f64 * half.sin());
    if window % 2 == 1 { kernel } else { kernel * half.cos() }
}

/// Weights of third differences, to which motion that is slow compared with the sampling rate contributes nothing.
pub(crate) const THIRD: [f64; 4] = [-1.0, 3.0, -3.0, 1.0];
/// Sum of the squared weights of third differences: the factor by which they amplify the variance of white noise.
pub(crate) const THIRD_GAIN: f64 = 20.0;

/// Iterates over the third differences of a series.
pub(crate) fn third_differences(series: &[f64]) -> impl Iterator<Item = f64> {
    series.windows(THIRD.len()).map(|w| w.iter().zip(THIRD).map(|(x, weight)| x * weight).sum())
}

/// Returns the standard deviation of the noise in a series, in the unit of the series. The median of absolute third
/// differences is used, which is robust to outliers.
pub(crate) fn noise(series: &[f64]) -> f64 {
    let differences = third_differences(series).map(f64::abs);
    let differences: Vec<f64> = differences.filter(|difference| !difference.is_nan()).collect();
    if differences.is_empty() {
        return 0.0;
    }
    // The median modulus of a standard normal deviate is 0.6745.
    median_high(differences) / (0.6745 * THIRD_GAIN.sqrt())
}

/// Noise and harmonics of a joint angle, from which the width of the smoothing window is chosen.
pub(crate) struct JointSignal {
    /// Standard deviation of the noise in the unsmoothed angle, rad.
    pub noise_rad: f64,
    /// Amplitudes of the harmonics of the angle, beginning with the first, rad.
    pub harmonics_rad: Vec<f64>,
}

/// Returns the window width with the smallest expected error of the joint rates, which dominate the wheel velocities:
/// residual noise plus the weighted attenuation of the rates. `step_rad` is the phase step of the gait per frame.
pub(crate) fn best_window(joints: &[JointSignal], step_rad: f64) -> usize {
    WINDOWS
        .min_by(|a, b| {
            expected_error(joints, step_rad, *a).total_cmp(&expected_error(joints, step_rad, *b))
        })
        .unwrap_or(WINDOW_WITHOUT_GAIT)
}

/// Returns the variance of the derivative, per sample, of white noise of variance 1 smoothed with a window.
fn noise_gain(window: usize) -> f64 {
    let half = window / 2;
    let mut average = vec![1.0 / window as f64; 2 * half + 1];
    if window.is_multiple_of(2) {
        average[0] *= 0.5;
        average[2 * half] *= 0.5;
    }
    let mut both = vec![0.0; average.len() + WEIGHTS.len() - 1];
    for (i, a) in average.iter().enumerate() {
        for (j, d) in WEIGHTS.iter().enumerate() {
            both[i + j] += a * d;
        }
    }
    both.iter().map(|weight| weight * weight).sum()
}

/// Returns the expected squared error of the joint rates for a window width.
fn expected_error(joints: &[JointSignal], step_rad: f64, window: usize) -> f64 {
    let gain = noise_gain(window);
    let errors = joints.iter().map(|joint| {
        let losses = joint.harmonics_rad.iter().zip(1..).map(|(amplitude, k)| {
            let step = f64::from(k) * step_rad;
            0.5 * ((1.0 - response(window, step)) * step * amplitude).powi(2)
        });
        let lost: f64 = losses.sum();
        gain * joint.noise_rad.powi(2) + ATTENUATION_WEIGHT * lost
    });
    errors.sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    const NAN: f64 = f64::NAN;

    #[test]
    fn constants_and_straight_lines_are_unchanged_to_the_ends() {
        for window in WINDOWS {
            let constant = vec![0.1; 50];
            assert_eq!(moving_average(&constant, window), constant);
            let line: Vec<f64> = (0..50).map(|i| 3.0 - 0.25 * f64::from(i)).collect();
            for (smooth, value) in moving_average(&line, window).iter().zip(&line) {
                assert!((smooth - value).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn missing_stays_missing_and_does_not_spread() {
        let series = [1.0, NAN, 2.0, 3.0, 4.0, NAN, NAN, 5.0];
        let smooth = moving_average(&series, 5);
        for (smooth, value) in smooth.iter().zip(series) {
            assert!(smooth.is_nan() == value.is_nan());
            assert!(value.is_nan() || (smooth - value).abs() < 1e-15);
        }
    }

    #[test]
    fn a_sine_is_attenuated_as_the_dirichlet_kernel_predicts() {
        for window in WINDOWS {
            for step in [0.004, 0.05, 0.15, 0.7] {
                let wave: Vec<f64> = (0..200).map(|i| (step * f64::from(i) + 0.3).cos()).collect();
                let smooth = moving_average(&wave, window);
                let left = response(window, step);
                for i in 30..170 {
                    assert!((smooth[i] - left * wave[i]).abs() < 1e-12, "{window} {step}");
                }
            }
        }
        let kernel = |n: f64, w: f64| (n * w / 2.0).sin() / (n * (w / 2.0).sin());
        assert!((response(7, 0.2) - kernel(7.0, 0.2)).abs() < 1e-15);
    }

    #[test]
    fn the_noise_gain_is_that_of_both_filters_combined() {
        // Computed explicitly for a five-sample average followed by the fourth-order derivative.
        let average = [0.2; 5];
        let derivative = [1.0 / 12.0, -8.0 / 12.0, 0.0, 8.0 / 12.0, -1.0 / 12.0];
        let mut both = [0.0; 9];
        for i in 0..5 {
            for j in 0..5 {
                both[i + j] += average[i] * derivative[j];
            }
        }
        let expected: f64 = both.iter().map(|w| w * w).sum();
        assert!((noise_gain(5) - expected).abs() < 1e-15);
    }

    #[test]
    fn faster_gaits_get_narrower_windows_and_noisier_ones_wider() {
        let window = |omega: f64, noise_rad: f64| {
            let joint = JointSignal { noise_rad, harmonics_rad: vec![0.5] };
            best_window(&[joint], omega / 120.0)
        };
        assert!(window(0.5, 2e-3) > window(3.9, 2e-3));
        assert!(window(3.9, 2e-3) > window(12.0, 2e-3));
        assert!(window(3.9, 4e-3) > window(3.9, 1e-3));
        assert!((5..=30).contains(&window(100.0, 1e-6)) && window(0.01, 1.0) == 30);
    }

    #[test]
    fn the_noise_of_a_slow_wave_is_found() {
        // A deterministic sequence with sufficiently small autocorrelation.
        let mut state = 1_u32;
        let mut deviate = || {
            (0..12)
                .map(|_| {
                    state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    f64::from(state >> 8) / f64::from(1 << 24)
                })
                .sum::<f64>()
                - 6.0
        };
        let series: Vec<f64> =
            (0..20_000).map(|i| (0.03 * f64::from(i)).sin() + 2e-3 * deviate()).collect();
        assert!((noise(&series) / 2e-3 - 1.0).abs() < 0.05);
    }
}
