//! Moving average, and how wide it should be.

use trilink_statistics::median_high;

use super::derivative::WEIGHTS;
use super::gaps::runs;

/// Narrowest and widest window, samples.
const WINDOWS: std::ops::RangeInclusive<usize> = 5..=30;
/// Window of trials without a commanded frequency, samples.
pub(crate) const WINDOW_WITHOUT_GAIT: usize = 9;
/// How much more an attenuated speed counts than noise of the same power: noise can be taken
/// out of the skid ratio afterwards, attenuation cannot.
const ATTENUATION_WEIGHT: f64 = 10.0;

/// Averages over `window` samples about each sample. An even window reaches half a sample
/// further to both sides, with half the weight there, so that it is centred as well. At the
/// ends of every stretch without gaps the window shrinks from both sides; what is missing
/// stays missing.
pub(crate) fn moving_average(series: &[f64], window: usize) -> Vec<f64> {
    let half = window / 2;
    let mut smooth = vec![f64::NAN; series.len()];
    for (start, end) in runs(series) {
        let run = &series[start..end];
        for (i, smooth) in smooth[start..end].iter_mut().enumerate() {
            let reach = i.min(run.len() - 1 - i);
            *smooth = match reach < half {
                true => average(run, i, reach, 2 * reach + 1),
                false => average(run, i, half, window),
            };
        }
    }
    smooth
}

/// The average over `window` samples about one, which reach so far to both sides. Deviations
/// from the middle keep a constant exactly constant.
fn average(run: &[f64], i: usize, reach: usize, window: usize) -> f64 {
    let middle = run[i];
    let pair = |k: usize| (run[i - k] - middle) + (run[i + k] - middle);
    let inner = reach - usize::from(window.is_multiple_of(2));
    let sum = (1..=inner).map(pair).sum::<f64>();
    let ends = (inner + 1..=reach).map(|k| 0.5 * pair(k)).sum::<f64>();
    middle + (sum + ends) / window as f64
}

/// What the moving average leaves of a sine of `step_rad` per sample: the Dirichlet kernel,
/// for an even window with half weights at its ends.
pub(crate) fn response(window: usize, step_rad: f64) -> f64 {
    let half = 0.5 * step_rad;
    if half.sin().abs() < 1e-12 {
        return 1.0;
    }
    let kernel = (window as f64 * half).sin() / (window as f64 * half.sin());
    if window % 2 == 1 { kernel } else { kernel * half.cos() }
}

/// Weights of third differences, in which motion far slower than the sampling leaves nothing, and
/// the sum of their squares: how many times the variance of white noise theirs is.
pub(crate) const THIRD: [f64; 4] = [-1.0, 3.0, -3.0, 1.0];
pub(crate) const THIRD_GAIN: f64 = 20.0;

pub(crate) fn third_differences(series: &[f64]) -> impl Iterator<Item = f64> {
    let difference = |w: &[f64]| w.iter().zip(THIRD).map(|(x, weight)| x * weight).sum();
    series.windows(THIRD.len()).map(difference)
}

/// Noise of a series of positions, in its own unit. The median of third differences bears outliers.
pub(crate) fn noise(series: &[f64]) -> f64 {
    let differences = third_differences(series).map(f64::abs);
    let differences: Vec<f64> = differences.filter(|difference| !difference.is_nan()).collect();
    if differences.is_empty() {
        return 0.0;
    }
    // The median of a normal deviate's modulus is 0.6745.
    median_high(differences) / (0.6745 * THIRD_GAIN.sqrt())
}

/// A joint as the choice of the window sees it.
pub(crate) struct JointSignal {
    /// Of the unsmoothed angle, rad.
    pub noise_rad: f64,
    /// Amplitudes of its harmonics, the first one first, rad.
    pub harmonics_rad: Vec<f64>,
}

/// The window with the smallest expected error of the joints' rates, which dominate that of
/// the wheels' velocities: noise that is left and, weighted, speed that is lost.
/// `step_rad` is the gait's phase per frame.
pub(crate) fn best_window(joints: &[JointSignal], step_rad: f64) -> usize {
    let error = |window: usize| -> f64 {
        let gain = noise_gain(window);
        let lost = |(amplitude, k): (&f64, i32)| {
            let step = f64::from(k) * step_rad;
            0.5 * ((1.0 - response(window, step)) * step * amplitude).powi(2)
        };
        let of_joint = |joint: &JointSignal| {
            let lost: f64 = joint.harmonics_rad.iter().zip(1..).map(lost).sum();
            gain * joint.noise_rad.powi(2) + ATTENUATION_WEIGHT * lost
        };
        joints.iter().map(of_joint).sum()
    };
    WINDOWS.min_by(|a, b| error(*a).total_cmp(&error(*b))).unwrap_or(WINDOW_WITHOUT_GAIT)
}

/// Variance of the derivative per sample that white noise of variance 1 leaves.
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
    fn a_sine_is_attenuated_as_the_dirichlet_kernel_says() {
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
    fn the_noise_gain_is_that_of_the_two_filters_in_turn() {
        // By hand for the average of five and the derivative of fourth order.
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
        // A known sequence of +-1 in which successive values are uncorrelated enough.
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
