//! Tests of the adequacy of fitted models, and of the assumptions behind their confidence intervals.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use trilink_fit::{FitData, Fitted, fit};
use trilink_mechanics::{FIT_ACCURACY, Laws, Model, Problem};
use trilink_robot::Quantity;
use trilink_robot::metrics::{GaitMetrics, Metric};
use trilink_statistics::Estimate;
use trilink_tables::config::{Config, SigmaKind};
use trilink_tables::{
    Comparison, ComparisonRow, FitRow, Misfit, NoIntervalReason, Outcome, TrialRow, TrialStatus,
    UndecidedReason,
};

use crate::common::noisy_trial;

/// Relative noise of d and v, and of the skid ratios.
const NOISE: [f64; 2] = [0.01, 0.03];

/// Returns the default configuration with a single campaign and the given models.
fn config(campaign: &str, models: &[Model]) -> Config {
    let mut config = Config::default();
    config.campaign.retain(|name, _| name == campaign);
    config.campaign.values_mut().for_each(|campaign| campaign.models = models.to_vec());
    config.fit.starts = 1;
    config.fit.bootstrap = 20;
    config.fit.profiles = false;
    config.fit.sigma = SigmaKind::Raw;
    config
}

/// Creates trials from given metrics with added noise, and with standard errors that match this noise.
fn trials(campaign: &str, motions: &[(f64, GaitMetrics)], seed: u64) -> Vec<TrialRow> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    motions.iter().map(|motion| noisy_trial(campaign, motion, NOISE, &mut random)).collect()
}

/// Reads the metrics of a campaign under dry friction, which no viscous model describes.
fn dry(campaign: &str) -> Vec<(f64, GaitMetrics)> {
    let rows = include_str!("../../../mechanics/tests/fixtures/friction_sweep.csv").lines();
    rows.filter_map(|line| line.strip_prefix(campaign)?.strip_prefix(','))
        .map(|row| {
            let numbers: Vec<f64> =
                row.split(',').filter_map(|number| number.parse().ok()).collect();
            let [omega_rad_s, d_m, v_m_s, s0, s1, s2, dtheta_rad] = numbers.try_into().unwrap();
            let metrics = [d_m, v_m_s, s0, s1, s2, f64::NAN, dtheta_rad];
            (omega_rad_s, GaitMetrics::from_array(metrics))
        })
        .collect()
}

/// Solves for the metrics of a campaign under the model skid-roll with known coefficients.
fn viscous(campaign: &str) -> Vec<(f64, GaitMetrics)> {
    let (mut robot, gait) = Config::default().campaign_setup(campaign).unwrap();
    robot.skid_kg_s = [104.0, 34.0, 45.0];
    let motion = |omega_rad_s: f64| {
        let problem = Problem::new(robot.clone(), gait, Laws::SKID_ROLL, omega_rad_s);
        (omega_rad_s, problem.solve(FIT_ACCURACY).unwrap().metrics)
    };
    (1..=12).map(|i| motion(0.5 * f64::from(i))).collect()
}

const CAMPAIGN: &str = "kinematic-symmetric";

fn fitted(config: &Config, trials: Vec<TrialRow>) -> Fitted {
    let mut config = config.clone();
    // The trials have no measured gait.
    config.fit.gait_input = trilink_tables::config::GaitInput::Commanded;
    fit(&config, &FitData::from(trials), &|_| {})
}

fn sentence(rows: &[ComparisonRow], fits: &[FitRow]) -> String {
    Comparison::new(rows, fits).expect("rows").to_string()
}

#[test]
fn no_viscous_model_fits_a_robot_with_dry_friction_and_it_says_where() {
    for campaign in ["kinematic-skewed", CAMPAIGN] {
        let config = config(campaign, &[Model::SKID, Model::SKID_ROLL]);
        let trials = trials(campaign, &dry(campaign), 1);
        let Fitted { fits, comparison, .. } = fitted(&config, trials);
        for fit in &fits {
            assert_eq!(fit.adequate, Some(false), "{campaign} {fit:?}");
            assert!(fit.lack_of_fit > 2.0 * fit.lack_of_fit_limit, "{campaign} {fit:?}");
            assert!(matches!(fit.misfit, Some(Misfit::Off(_))), "{campaign} {fit:?}");
            let limits = Quantity::Skid.of_each().map(|of| [fit.lower[of], fit.upper[of]]);
            assert!(limits.as_flattened().iter().all(|limit| limit.is_nan()), "{limits:?}");
            assert_eq!(fit.no_interval, Some(NoIntervalReason::Inadequate.into()));
        }
        assert_eq!(comparison[0].outcome, Outcome::NoneFits);
        let sentence = sentence(&comparison, &fits);
        assert!(sentence.contains("rad/s") && !sentence.contains("prefer"), "{sentence}");
    }
}

#[test]
fn the_true_model_fits_and_a_wrong_one_does_not() {
    let mut config = config(CAMPAIGN, &[Model::SKID, Model::SKID_ROLL]);
    config.fit.bootstrap = 0;
    let motions = viscous(CAMPAIGN);
    let adequate = |seed| {
        let Fitted { fits, comparison, .. } = fitted(&config, trials(CAMPAIGN, &motions, seed));
        assert_eq!(fits[0].adequate, Some(false), "{:?}", fits[0]);
        let is_adequate = fits[1].adequate == Some(true);
        let is_preferred = comparison[1].outcome == Outcome::Clear && comparison[1].preferred;
        assert_eq!(is_adequate, is_preferred, "{comparison:?}");
        let ratio = fits[1].lack_of_fit;
        assert!((0.5..2.0).contains(&ratio), "{ratio}");
        is_adequate
    };
    let adequate = (0..10).filter(|seed| adequate(*seed)).count();
    assert!(adequate >= 8, "{adequate}");
}

#[test]
fn with_filtered_coordinates_the_adequacy_is_not_known() {
    let config = config(CAMPAIGN, &[Model::SKID, Model::SKID_ROLL]);
    let mut trials = trials(CAMPAIGN, &viscous(CAMPAIGN), 1);
    trials[3].noise_white = Some(false);
    let Fitted { fits, comparison, .. } = fitted(&config, trials);
    for fit in &fits {
        assert!(fit.adequate.is_none() && fit.lack_of_fit.is_nan(), "{fit:?}");
        assert!(matches!(fit.misfit, Some(Misfit::Rms(_))), "{fit:?}");
    }
    let sentence = sentence(&comparison, &fits);
    let why = "whether it fits is unknown, because coordinates were filtered before the export in 1 of 12 trials \
         (W026: export unfiltered coordinates)";
    assert!(sentence.contains(why), "{sentence}");
}

#[test]
fn without_repeats_cycles_or_errors_there_is_no_interval() {
    let mut trials = trials(CAMPAIGN, &viscous(CAMPAIGN), 1);
    let config = config(CAMPAIGN, &[Model::SKID_ROLL]);
    // First the noise of one metric is unknown, then that of every metric.
    trials.iter_mut().for_each(|trial| trial.metrics_se.sigma[1] = f64::NAN);
    let one = fitted(&config, trials.clone());
    trials.iter_mut().for_each(|trial| trial.metrics_se = GaitMetrics::MISSING);
    let none = fitted(&config, trials);
    let all = ["d", "v", "sigma0", "sigma1", "sigma2"];
    for (fitted, metrics) in [(&one, &all[3..4]), (&none, &all)] {
        let fit = &fitted.fits[0];
        for of in Quantity::Skid.of_each() {
            let missing = [fit.lower[of], fit.upper[of], fit.scatter[of], fit.systematic[of]];
            assert!(missing.iter().all(|limit| limit.is_nan()), "{missing:?}");
        }
        let why = fit.no_interval.as_ref().expect("a reason");
        assert_eq!(why.reason, NoIntervalReason::UnknownNoise);
        assert_eq!(why.of, metrics);
    }
    assert!(one.fits[0].lack_of_fit > 0.0);
    assert_eq!((none.fits[0].adequate, none.bootstrap.len()), (None, 0));
    let sentence = sentence(&none.comparison, &none.fits);
    assert!(sentence.contains("is unknown"), "{sentence}");
}

#[test]
fn models_with_as_many_coefficients_as_measurements_are_neither_tested_nor_preferred() {
    let mut config = config(CAMPAIGN, &[Model::SKID, Model::SKID_ROLL]);
    let weights = &mut config.campaign.get_mut(CAMPAIGN).unwrap().weights;
    weights.d = 0.0;
    weights.v = 0.0;
    let trials = trials(CAMPAIGN, &viscous(CAMPAIGN)[5..6], 1);
    let Fitted { fits, comparison, .. } = fitted(&config, trials.clone());
    for fit in &fits {
        assert!(fit.j < 1e-9 && fit.adequate.is_none() && fit.misfit.is_none(), "{fit:?}");
    }
    let sentence = sentence(&comparison, &fits);
    let start = "The data do not clearly prefer one model; ";
    let end = "is unknown, because there are no more measurements than free parameters.";
    assert!(sentence.starts_with(start) && sentence.ends_with(end), "{sentence}");
    assert!(sentence.contains("lowest of all in 10 of 20 replicates"), "{sentence}");
    // A model with a tested adequacy ranks before one that could not be tested.
    let weights = &mut config.campaign.get_mut(CAMPAIGN).unwrap().weights;
    weights.d = 10.0;
    weights.v = 1.0;
    config.campaign.get_mut(CAMPAIGN).unwrap().models =
        vec![Model::new("coulomb-viscous"), Model::SKID_ROLL];
    let Fitted { fits, comparison, .. } = fitted(&config, trials);
    assert_eq!([0, 1].map(|i| fits[i].adequate), [None, Some(true)]);
    assert_eq!([0, 1].map(|i| comparison[i].preferred), [false, true]);
}

#[test]
fn a_fit_to_the_only_remaining_trial_says_so_and_names_its_misfit() {
    let config = config(CAMPAIGN, &[Model::SKID_ROLL]);
    let mut trials = trials(CAMPAIGN, &viscous(CAMPAIGN)[5..7], 1);
    trials[1].status = TrialStatus::Failed;
    let Fitted { fits, comparison, .. } = fitted(&config, trials.clone());
    assert_eq!(fits[0].adequate, Some(true), "{:?}", fits[0]);
    assert!(fits[0].notes.few_frequencies);
    let begins =
        "Fitted to 1 of 2 trials: the others have no metrics. Only skid-roll has been fitted";
    let sentence = sentence(&comparison, &fits);
    assert!(sentence.starts_with(begins), "{sentence}");
    // Three of the four measurements agree with the model.
    for factor in [1.04, 1.1] {
        let mut trials = trials.clone();
        trials[0].metrics.d_m *= factor;
        trials[0].metrics.v_m_s *= factor;
        let fit = &fitted(&config, trials).fits[0];
        let Some(Misfit::Off(runs)) = &fit.misfit else { panic!("{fit:?}") };
        // A single trial does not tell how much trials differ, unless they would have to differ by more than 10 %.
        match fit.adequate {
            None => {
                let undecided = fit.undecided.as_ref().map(|why| why.reason);
                assert_eq!(undecided, Some(UndecidedReason::NoRepeats));
                assert_eq!(fit.no_interval, Some(NoIntervalReason::UnknownVariation.into()));
            }
            Some(is_adequate) => assert!(!is_adequate, "{fit:?}"),
        }
        assert!(
            runs[0].metric != Metric::V && runs[0].most > 1e-3 && runs[0].to_rad_s == 3.0,
            "{fit:?}"
        );
        assert!(fit.notes.is_empty());
    }
}

#[test]
fn with_absurd_standard_errors_the_adequacy_is_not_known() {
    let mut trials = trials(CAMPAIGN, &viscous(CAMPAIGN), 1);
    trials[0].metrics_se.d_m = 1e308;
    let Fitted { fits, comparison, .. } = fitted(&config(CAMPAIGN, &[Model::SKID_ROLL]), trials);
    assert_eq!(fits[0].adequate, None, "{:?}", fits[0]);
    assert!(matches!(fits[0].misfit, Some(Misfit::Rms(_))), "{:?}", fits[0]);
    for of in Quantity::Skid.of_each() {
        assert!(fits[0].lower[of].is_nan() && fits[0].upper[of].is_nan(), "{:?}", fits[0]);
    }
    let sentence = sentence(&comparison, &fits);
    assert!(sentence.contains("whether it fits is unknown"), "{sentence}");
}

#[test]
fn raw_skid_ratios_replace_unknown_debiased_ones_and_the_notes_say_so() {
    let mut trials = trials(CAMPAIGN, &viscous(CAMPAIGN), 1);
    let mut config = config(CAMPAIGN, &[Model::SKID_ROLL]);
    let raw = fitted(&config, trials.clone());
    assert!(raw.fits[0].notes.is_empty());
    config.fit.sigma = SigmaKind::Debiased;
    let substituted = fitted(&config, trials.clone());
    for of in Quantity::Skid.of_each() {
        assert_eq!(substituted.fits[0].parameters[of], raw.fits[0].parameters[of]);
    }
    assert_eq!(substituted.comparison[0].j_sigma, raw.comparison[0].j_sigma);
    assert_eq!(substituted.fits[0].notes.raw_skid_trials[..2], ["at-0.5", "at-1"]);
    // Debiased skid ratios that do not exceed the noise.
    for trial in &mut trials {
        trial.sigma_debiased = [Estimate { value: 0.0, se: 0.001 }; 3];
    }
    let missing = &fitted(&config, trials).fits[0].notes.missing_metrics;
    assert_eq!(missing, &Metric::SIGMA[..3]);
}

#[test]
fn the_uncertainty_of_robot_parameters_is_part_of_the_interval() {
    let trials = trials(CAMPAIGN, &viscous(CAMPAIGN), 1);
    let mut config = config(CAMPAIGN, &[Model::SKID_ROLL]);
    let exact = fitted(&config, trials.clone()).fits.remove(0);
    let robot = config.robot.get_mut("kinematic").unwrap().three_links_mut().unwrap();
    robot.set_deviation(Quantity::Roll, [0.06, 0.03, 0.03]);
    let uncertain = fitted(&config, trials).fits.remove(0);
    for of in Quantity::Skid.of_each() {
        assert_eq!(exact.parameters[of], uncertain.parameters[of]);
        assert_eq!(exact.scatter[of], uncertain.scatter[of]);
        assert!(exact.scatter[of] > 0.0);
        assert!(uncertain.systematic[of] > 0.1 * uncertain.parameters[of], "{uncertain:?}");
        assert!(uncertain.lower[of] < exact.lower[of] && uncertain.upper[of] > exact.upper[of]);
    }
}
