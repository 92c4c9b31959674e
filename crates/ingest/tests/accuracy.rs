//! How near the ingest of synthetic trials comes to what was planted, and whether its standard
//! errors say so.

#![allow(clippy::unwrap_used)]

use rayon::prelude::*;
use serde_json::Value;
use trilink_ingest::process_trial;
use trilink_statistics::Estimate;
use trilink_synth::{OMEGAS_RAD_S, Recipe, synthesise};
use trilink_tables::TrialRow;
use trilink_tables::config::Config;
use trilink_tables::trial::{TRUTH_FILE, TrialKind};

/// Skid that is slower than this, m/s RMS, is not asked to be right to a part.
const SLOW_M_S: f64 = 0.002;

/// Differences of one trial from the truth.
struct Differences {
    trial: String,
    /// Parts of the truth.
    d: f64,
    v: f64,
    /// Of alpha_1 and of the measured joints' offsets and amplitudes.
    degrees: Vec<f64>,
    /// Of each wheel's debiased skid ratio: part of the truth, standard errors, true speed.
    skid: [(f64, f64, f64); 3],
}

fn differences(seed: u64, omegas_rad_s: &[f64]) -> Vec<Differences> {
    let config = Config::default();
    let folder = tempfile::tempdir().unwrap();
    let recipe = Recipe { omegas_rad_s: omegas_rad_s.into(), ..Recipe::new(seed) };
    let trials = synthesise(&config, folder.path(), &recipe, &|_| Ok(())).unwrap();
    let truth = std::fs::read_to_string(folder.path().join(TRUTH_FILE)).unwrap();
    let truth: Value = serde_json::from_str(&truth).unwrap();
    trials
        .par_iter()
        .filter(|trial| trial.kind == TrialKind::Gait)
        .map(|trial| {
            let row = process_trial(folder.path(), trial, &config).unwrap().row;
            let campaign = trial.campaign.as_ref().unwrap();
            let robot = config.campaign_setup(campaign).unwrap().0;
            compare(&row, &truth["trials"][&trial.id], robot.l_m)
        })
        .collect()
}

fn compare(row: &TrialRow, truth: &Value, l_m: f64) -> Differences {
    let number = |value: &Value| value.as_f64().unwrap();
    let part = |found: f64, truth: &Value| found / number(truth) - 1.0;
    let mut degrees = vec![(row.metrics.alpha1_rad - number(&truth["alpha1_rad"])).to_degrees()];
    for (joint, found) in row.gait.iter().enumerate() {
        let planted = &truth["gait"][joint];
        if !planted.is_null() {
            degrees.push((found.offset_rad - number(&planted["offset_rad"])).to_degrees());
            degrees.push((found.amplitude_rad - number(&planted["amplitude_rad"])).to_degrees());
        }
    }
    let skid = |wheel: usize| {
        let Estimate { value, se } = row.sigma_debiased[wheel];
        let known = number(&truth["sigma"][wheel]);
        (value / known - 1.0, (value - known) / se, known * l_m * row.omega_commanded_rad_s)
    };
    Differences {
        trial: row.trial.clone(),
        d: part(row.metrics.d_m, &truth["d_m"]),
        v: part(row.metrics.v_m_s, &truth["v_m_s"]),
        degrees,
        skid: std::array::from_fn(skid),
    }
}

/// Holds every trial to the bounds; gives the part of the skid ratios that lie within two of
/// their standard errors of the truth.
fn within_two_errors(all: &[Differences]) -> f64 {
    for Differences { trial, d, v, degrees, skid } in all {
        assert!(d.abs() < 0.002 && v.abs() < 0.002, "{trial}: d {d}, v {v}");
        assert!(degrees.iter().all(|degrees| degrees.abs() < 0.1), "{trial}: {degrees:?}");
        for (part, _, speed_m_s) in skid {
            assert!(part.abs() < 0.05 || *speed_m_s < SLOW_M_S, "{trial}: {skid:?}");
        }
    }
    let skid = || all.iter().flat_map(|trial| &trial.skid);
    skid().filter(|(_, errors, _)| errors.abs() < 2.0).count() as f64 / skid().count() as f64
}

#[test]
fn every_trial_is_within_its_bounds_and_most_skid_ratios_within_two_errors() {
    let omegas_rad_s = [0.5, 1.0, 3.9, 6.0];
    let all: Vec<_> = (1..4).flat_map(|seed| differences(seed, &omegas_rad_s)).collect();
    assert_eq!(all.len(), 36);
    let within = within_two_errors(&all);
    assert!(within > 0.85, "{within}");
}

#[test]
#[ignore = "50 folders: some minutes"]
fn of_1950_trials_nine_skid_ratios_in_ten_are_within_two_errors() {
    let all: Vec<_> = (0..50).flat_map(|seed| differences(seed, &OMEGAS_RAD_S)).collect();
    let within = within_two_errors(&all);
    let worst = |value: &dyn Fn(&Differences) -> f64| all.iter().map(value).fold(0.0, f64::max);
    println!("d {:.5}", worst(&|trial| trial.d.abs()));
    println!(
        "degrees {:.4}",
        worst(&|trial| trial.degrees.iter().fold(0.0, |a, b| a.max(b.abs())))
    );
    println!("within two errors {within:.3}");
    assert!(within > 0.9, "{within}");
}
