//! Tests whether the marker noise is white, as all standard errors assume and as camera noise nearly is. Low-pass
//! filtering before the export cuts off the noise spectrum far below the Nyquist frequency, so that differences between
//! neighbouring frames underestimate the noise at low frequencies.
//!
//! The distance between two markers of a link changes only by noise. Its Hadamard variance (of second differences of
//! adjacent means; W. J. Riley, *Handbook of Frequency Stability Analysis*, NIST Special Publication 1065, 2008,
//! section 5.2) is inversely proportional to the number of averaged samples if the noise is white, and is unaffected by
//! a linear drift.

use trilink_mocap::Recording;
use trilink_statistics::{MAD_TO_DEVIATION, mean, median, median_high, seen};

use super::layout::Layout;

/// Averaging time, s. Second differences of means over this time respond to noise around 5 Hz, which low-pass filters
/// leave in the coordinates.
const AVERAGED_S: f64 = 0.1;
/// Deviation, in standard deviations, of the distance between two markers from its median, beyond which the distance is
/// an outlier, as when a marker jumps.
const OUTLIER_DEVIATIONS: f64 = 6.0;
/// Minimum number of second differences for a variance estimate.
const MIN_DIFFERENCES: usize = 5;
/// Minimum standard deviation of camera noise, mm; anything smaller is rounding.
const MIN_NOISE_MM: f64 = 0.005;
/// Sum of the squared weights of a second difference.
const SECOND_GAIN: f64 = 6.0;
/// Median of the square of a standard normal deviate.
const MEDIAN_SQUARE: f64 = 0.4549;

/// Returns the standard deviation of the noise in means over [`AVERAGED_S`], divided by the value expected for white
/// noise from the differences between neighbouring frames; about 1 if the noise is white. The result is the median over
/// pairs of markers on the same link; NaN if there are too few frames or too little noise. `frames` is the number of
/// frames, including those missing from the file.
pub(crate) fn slow_noise_ratio(
    file: &Recording,
    layout: &Layout,
    rate_hz: f64,
    [first_frame, frames]: [i64; 2],
) -> f64 {
    let averaged = ((AVERAGED_S * rate_hz).round() as usize).max(2);
    // Each marker of a link is paired with the next one.
    let pairs = layout.iter().flat_map(|markers| {
        let next = (1..markers.len()).chain((markers.len() > 2).then_some(0));
        next.enumerate().map(|(one, other)| [one, other].map(|marker| markers[marker].column))
    });
    let mut ratios = Vec::new();
    for pair in pairs {
        let mut distances_mm = vec![f64::NAN; frames as usize];
        for (row, frame) in file.frames.iter().enumerate() {
            let [one, other] = pair.map(|column| file.position_mm(row, column));
            let squares = [0, 1, 2].map(|axis| (one[axis] - other[axis]).powi(2));
            distances_mm[(frame - first_frame) as usize] = squares.iter().sum::<f64>().sqrt();
        }
        reject_outliers(&mut distances_mm);
        ratios.extend(variance_ratio(&distances_mm, averaged));
    }
    median(ratios).sqrt()
}

/// Returns the same ratio as [`slow_noise_ratio`] from other series that change only by noise, with one value per frame,
/// mm: the gaps between the joints of links that are rigid bodies, whose points have constant distances.
pub(crate) fn slow_gap_ratio(gaps_mm: impl Iterator<Item = Vec<f64>>, rate_hz: f64) -> f64 {
    let averaged = ((AVERAGED_S * rate_hz).round() as usize).max(2);
    let ratios = gaps_mm.filter_map(|mut gaps_mm| {
        reject_outliers(&mut gaps_mm);
        variance_ratio(&gaps_mm, averaged)
    });
    median(ratios.collect()).sqrt()
}

fn reject_outliers(distances_mm: &mut [f64]) {
    let middle = median_high(seen(distances_mm).collect());
    let deviations = seen(distances_mm).map(|distance| (distance - middle).abs());
    let spread = median_high(deviations.collect());
    let max_deviation = OUTLIER_DEVIATIONS * MAD_TO_DEVIATION * spread;
    for distance in distances_mm {
        if (*distance - middle).abs() > max_deviation {
            *distance = f64::NAN;
        }
    }
}

/// Returns the ratio of two estimates of the noise variance of a distance: one from means over `averaged` frames, on
/// the assumption of white noise, and one from neighbouring frames. The former is a median, which is robust to steps;
/// the latter is a mean, which a few noisy frames raise as much as they raise the former. `None` if there are too few
/// frames or too little noise.
fn variance_ratio(distances_mm: &[f64], averaged: usize) -> Option<f64> {
    let fast: Vec<f64> =
        distances_mm.windows(3).map(|w| second_difference(w[0], w[1], w[2])).collect();
    let fast = mean(seen(&fast).map(|difference| difference * difference)) / SECOND_GAIN;
    // Means over blocks of which at least half is visible, and their variances relative to that of a sample.
    let means = distances_mm.chunks_exact(averaged).map(|samples| {
        let count = seen(samples).count();
        let is_known = 2 * count >= averaged;
        if is_known { [mean(seen(samples)), 1.0 / count as f64] } else { [f64::NAN; 2] }
    });
    let means: Vec<[f64; 2]> = means.collect();
    let slow = means.windows(3).map(|w| {
        let difference = second_difference(w[0][0], w[1][0], w[2][0]);
        difference * difference / (w[0][1] + 4.0 * w[1][1] + w[2][1])
    });
    let slow: Vec<f64> = slow.filter(|square| !square.is_nan()).collect();
    if slow.len() < MIN_DIFFERENCES || fast.is_nan() {
        return None;
    }
    let slow = median(slow) / MEDIAN_SQUARE;
    (slow > MIN_NOISE_MM * MIN_NOISE_MM).then_some(slow / fast)
}

fn second_difference(first: f64, second: f64, third: f64) -> f64 {
    first - 2.0 * second + third
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    use super::*;
    use crate::markers::layout::LinkMarker;
    use crate::tests::coloured::low_passed;

    const FRAMES: usize = 1800;

    fn normal(seed: u64) -> impl FnMut() -> f64 {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        move || StandardNormal.sample(&mut random)
    }

    /// Creates a recording of three markers on a link that moves along a circle, with noise of standard deviation
    /// `noise_mm`. `change` transforms the time series of each coordinate.
    fn recording(noise_mm: f64, change: impl Fn(Vec<f64>) -> Vec<f64>) -> Recording {
        let mut noise = normal(5);
        let layout = [[0.0, 0.0, 50.0], [60.0, 10.0, 60.0], [-20.0, 50.0, 55.0]];
        let mut series = Vec::new();
        for [x, y, z] in layout {
            for axis in 0..3 {
                let coordinates = (0..FRAMES).map(|i| {
                    let (sin, cos) = (0.01 * i as f64).sin_cos();
                    let position =
                        [400.0 * cos + cos * x - sin * y, 400.0 * sin + sin * x + cos * y, z];
                    position[axis] + noise_mm * noise()
                });
                series.push(change(coordinates.collect()));
            }
        }
        let labels = ["A", "B", "C"].map(str::to_owned).into();
        let positions_mm = (0..FRAMES)
            .flat_map(|i| [0, 3, 6].map(|first| [0, 1, 2].map(|axis| series[first + axis][i])))
            .collect();
        Recording::new(Some(120.0), (1..=FRAMES as i64).collect(), labels, positions_mm)
    }

    /// Returns the slow-noise ratio of the recording's three markers.
    fn ratio(file: &Recording) -> f64 {
        let marker = |column| LinkMarker { column, local_position_mm: [0.0; 2], height_mm: 0.0 };
        let layout = vec![[0, 1, 2].map(marker).to_vec(), Vec::new(), Vec::new()];
        let first = file.frames[0];
        let frames = file.frames[file.frames.len() - 1] - first + 1;
        slow_noise_ratio(file, &layout, 120.0, [first, frames])
    }

    fn occlude(file: &mut Recording) {
        let mut state = normal(9);
        for position in &mut file.positions_mm {
            if state() > 1.6 {
                *position = [f64::NAN; 3];
            }
        }
    }

    #[test]
    fn white_noise_is_white_with_gaps_few_digits_jumps_and_a_marker_that_moves() {
        for noise_mm in [0.03, 0.2, 1.0] {
            let white = recording(noise_mm, |series| series);
            assert!((ratio(&white) - 1.0).abs() < 0.2, "{noise_mm}: {}", ratio(&white));
            let mut gaps = white.clone();
            occlude(&mut gaps);
            assert!((ratio(&gaps) - 1.0).abs() < 0.25, "{noise_mm}: {}", ratio(&gaps));
            let mut jumped = white.clone();
            for row in (0..FRAMES).step_by(37) {
                jumped.positions_mm[3 * row + 1][0] += 20.0;
            }
            assert!((ratio(&jumped) - 1.0).abs() < 0.25, "{noise_mm}: {}", ratio(&jumped));
            let mut moved = white.clone();
            (1000..FRAMES).for_each(|row| moved.positions_mm[3 * row + 2][1] += 2.0 * noise_mm);
            assert!(ratio(&moved) < 1.3, "{noise_mm}: {}", ratio(&moved));
            for digit_mm in [0.001, 0.01, 0.1, 1.0] {
                let rounded = recording(noise_mm, |series| {
                    series.iter().map(|x| (x / digit_mm).round() * digit_mm).collect()
                });
                let ratio = ratio(&rounded);
                assert!(ratio.is_nan() || ratio < 1.4, "{noise_mm} {digit_mm}: {ratio}");
            }
        }
    }

    #[test]
    fn noise_that_was_filtered_before_the_export_is_not_white() {
        for (cutoff_hz, minimum) in
            [(6.0, 20.0), (10.0, 15.0), (15.0, 8.0), (20.0, 5.0), (30.0, 2.5)]
        {
            let mut filtered = recording(0.2, |series| {
                let filtered = low_passed(&series, cutoff_hz / 120.0).into_iter();
                filtered.map(|x| (100.0 * x).round() / 100.0).collect()
            });
            assert!(ratio(&filtered) > minimum, "{cutoff_hz} Hz: {}", ratio(&filtered));
            occlude(&mut filtered);
            assert!(ratio(&filtered) > minimum, "{cutoff_hz} Hz: {}", ratio(&filtered));
        }
    }

    #[test]
    fn the_ratio_is_nan_without_noise_or_with_too_few_frames() {
        assert!(ratio(&recording(0.0, |series| series)).is_nan());
        assert!(ratio(&recording(0.0, |series| low_passed(&series, 6.0 / 120.0))).is_nan());
        let mut few = recording(0.2, |series| series);
        few.frames.truncate(70);
        few.positions_mm.truncate(3 * 70);
        assert!(ratio(&few).is_nan());
    }
}
