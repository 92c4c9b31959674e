//! Coverage of the standard errors of trial means where the noise of the coordinates is not white: filtered or up-sampled
//! before the export, correlated over many frames, periodic.

use std::f64::consts::{PI, SQRT_2, TAU};

use trilink_mocap::Recording;
use trilink_synth::Format;

use super::coverage::{Distortion, shares};
use super::*;

/// Filters a series forwards and backwards with a second-order Butterworth low-pass filter, as is done before an export
/// (bilinear transform; Winter, *Biomechanics and Motor Control of Human Movement*, section 2.2.4). `cutoff` is the
/// frequency at which the amplitude is halved, as a fraction of the frame rate.
pub(crate) fn low_passed(series: &[f64], cutoff: f64) -> Vec<f64> {
    let c = 1.0 / (PI * cutoff).tan();
    let scale = 1.0 / (1.0 + SQRT_2 * c + c * c);
    let feedback = [2.0 * scale * (1.0 - c * c), scale * (1.0 - SQRT_2 * c + c * c)];
    let pass = |series: Vec<f64>| {
        let mut x = [series[0]; 2];
        let mut y = [series[0]; 2];
        let filtered = series.into_iter().map(move |new| {
            let out = scale * (new + 2.0 * x[0] + x[1]) - feedback[0] * y[0] - feedback[1] * y[1];
            x = [new, x[0]];
            y = [out, y[0]];
            out
        });
        filtered.collect::<Vec<f64>>()
    };
    let mut series = pass(series.to_vec());
    series.reverse();
    series = pass(series);
    series.reverse();
    series
}

/// Changes the series of every coordinate of every marker, in which gaps are filled first and are gaps again afterwards.
/// A changed series with twice as many samples has twice the frame rate.
fn with_series(recording: &Recording, mut change: impl FnMut(Vec<f64>) -> Vec<f64>) -> Recording {
    let markers = recording.labels.len();
    let mut series = Vec::new();
    for marker in 0..markers {
        for axis in 0..3 {
            let rows = 0..recording.frames.len();
            let seen: Vec<f64> = rows.map(|row| recording.position_mm(row, marker)[axis]).collect();
            let mut filled = crate::signals::fill(&seen, usize::MAX);
            let ends =
                [seen.iter().position(|x| !x.is_nan()), seen.iter().rposition(|x| !x.is_nan())];
            let [Some(first), Some(last)] = ends else {
                series.push((filled, seen));
                continue;
            };
            let [at_first, at_last] = [filled[first], filled[last]];
            filled[..first].fill(at_first);
            filled[last..].fill(at_last);
            series.push((change(filled), seen));
        }
    }
    let rows = series.iter().map(|(changed, _)| changed.len()).max().unwrap();
    let factor = rows / recording.frames.len();
    let value = |row: usize, (changed, seen): &(Vec<f64>, Vec<f64>)| {
        if seen[row / factor].is_nan() { f64::NAN } else { changed[row] }
    };
    let positions_mm = (0..rows).flat_map(|row| {
        series.chunks(3).map(move |axes| [0, 1, 2].map(|axis| value(row, &axes[axis])))
    });
    Recording {
        rate_hz: recording.rate_hz.map(|rate_hz| rate_hz * factor as f64),
        frames: (1..=rows as i64).collect(),
        positions_mm: positions_mm.collect(),
        ..recording.clone()
    }
}

/// Returns a series with a sample between neighbouring samples by the natural cubic spline, and the last sample twice.
fn doubled(series: Vec<f64>) -> Vec<f64> {
    let n = series.len();
    // Second derivatives at the samples by the tridiagonal system (1, 4, 1).
    let mut right = vec![0.0; n];
    let mut upper = vec![0.0; n];
    for i in 1..n - 1 {
        let pivot = 4.0 - upper[i - 1];
        upper[i] = 1.0 / pivot;
        right[i] = (6.0 * (series[i - 1] - 2.0 * series[i] + series[i + 1]) - right[i - 1]) / pivot;
    }
    for i in (1..n - 1).rev() {
        right[i] -= upper[i] * right[i + 1];
    }
    let between = |i: usize| match i + 1 < n {
        true => 0.5 * (series[i] + series[i + 1]) - (right[i] + right[i + 1]) / 16.0,
        false => series[i],
    };
    (0..n).flat_map(|i| [series[i], between(i)]).collect()
}

/// Returns a generator of standard normal deviates.
fn normal(seed: u64) -> impl FnMut() -> f64 {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    move || StandardNormal.sample(&mut random)
}

/// Adds noise of standard deviation `sd_mm` that is correlated over `frames` frames (autoregressive, first order).
fn correlated(sd_mm: f64, frames: f64) -> impl Fn(u64, Recording) -> Recording {
    move |seed, recording| {
        let mut normal = normal(seed);
        let keep = (-1.0 / frames).exp();
        with_series(&recording, |mut series| {
            let mut noise = sd_mm * normal();
            for value in &mut series {
                *value += noise;
                noise = keep * noise + sd_mm * (1.0 - keep * keep).sqrt() * normal();
            }
            series
        })
    }
}

/// Adds a vibration of `sd_mm` at `frequency_hz`, with a phase of its own in every coordinate.
fn vibrating(sd_mm: f64, frequency_hz: f64) -> impl Fn(u64, Recording) -> Recording {
    move |seed, recording| {
        let mut normal = normal(seed);
        let step_rad = TAU * frequency_hz / recording.rate_hz.unwrap();
        with_series(&recording, |mut series| {
            let phase_rad = 10.0 * normal();
            for (value, frame) in series.iter_mut().zip(0..) {
                *value += SQRT_2 * sd_mm * (phase_rad + step_rad * f64::from(frame)).sin();
            }
            series
        })
    }
}

#[test]
#[ignore = "8 kinds of noise, 12 folders each: some minutes"]
fn standard_errors_hold_where_noise_is_not_white_or_are_missing() {
    let filtered = |cutoff_hz: f64| {
        move |_: u64, recording: Recording| {
            let cutoff = cutoff_hz / recording.rate_hz.unwrap();
            with_series(&recording, |series| low_passed(&series, cutoff))
        }
    };
    let kinds: [(&str, Box<Distortion>); 8] = [
        ("white", Box::new(|_, recording| recording)),
        ("low-pass 6 Hz", Box::new(filtered(6.0))),
        ("low-pass 10 Hz", Box::new(filtered(10.0))),
        ("spline to 240 Hz", Box::new(|_, recording| with_series(&recording, doubled))),
        ("correlated, 6 frames", Box::new(correlated(0.2, 6.0))),
        ("correlated, 36 frames", Box::new(correlated(0.2, 36.0))),
        ("vibration at 7 Hz", Box::new(vibrating(0.1, 7.0))),
        ("vibration at 25 Hz", Box::new(vibrating(0.1, 25.0))),
    ];
    let mut outside = Vec::new();
    for (kind, distort) in &kinds {
        let mut sums = BTreeMap::new();
        for ((_, name), share) in shares(0..12, &[2.0, 3.9, 5.2], Format::Csv, Some(&**distort)) {
            let name = name.split(" of ").next().unwrap().to_owned();
            let sum = sums.entry(name).or_insert([0; 3]);
            (0..3).for_each(|i| sum[i] += share[i]);
        }
        for (name, [within, known, all]) in sums {
            println!("{kind:24} {name:14} {within} of {known} of {all}");
            if *kind == "white" {
                assert_eq!(known, all, "{name}");
            }
            // Three standard deviations of a binomial count below 95 %.
            let expected = 0.95 * known as f64;
            if (within as f64) < expected - 3.0 * (0.05 * expected).sqrt() {
                outside.push(format!("{kind}: {name} {within} of {known}"));
            }
        }
    }
    assert!(outside.is_empty(), "{outside:?}");
}
