//! Tests of recommended trials: they narrow the confidence intervals as predicted, and more than other trials do.

use std::path::Path;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde_json::Value;
use trilink_base::cancel::{CancelToken, Cancelled};
use trilink_fit::design::{
    Advice, AdviceError, Aim, Candidate, Optimality, Prediction, advise, tell,
};
use trilink_fit::{FitData, FitInput, Fitted, KnownFit, fit};
use trilink_mechanics::{FIT_ACCURACY, Model, Problem};
use trilink_robot::metrics::{GaitMetrics, padded};
use trilink_robot::{Laws, Parameter, Quantity};
use trilink_tables::config::{Config, Free, GaitInput, ModelConfig, SigmaKind};
use trilink_tables::{FitRow, TrialRow};

use crate::common::{noisy_trial, small_run, small_settings, succeed, text, trilink};

const CAMPAIGN: &str = "kinematic-symmetric";
const SKID_KG_S: [f64; 3] = [104.0, 34.0, 45.0];
/// Relative noise of d and v, and relative noise of the skid ratios, at a gait frequency of 3 rad/s; both are
/// proportional to the frequency.
const NOISE: [f64; 2] = [0.01, 0.03];
/// Frequencies of the existing trials, rad/s.
const MADE_RAD_S: [f64; 5] = [2.0, 2.7, 3.4, 4.2, 5.0];
const CANDIDATES: usize = 12;
const ADD: usize = 3;

fn config(model: Model) -> Config {
    let mut config = Config::default();
    config.campaign.retain(|name, _| name == CAMPAIGN);
    config.campaign.get_mut(CAMPAIGN).unwrap().models = vec![model];
    (config.fit.starts, config.fit.bootstrap, config.fit.profiles) = (1, 200, false);
    // The trials have no measured gait.
    (config.fit.sigma, config.fit.gait_input) = (SigmaKind::Raw, GaitInput::Commanded);
    config
}

/// Returns `omega_rad_s` together with the metrics of the true motion at this frequency.
fn motion(omega_rad_s: f64) -> (f64, GaitMetrics) {
    let (mut robot, gait) = Config::default().campaign_setup(CAMPAIGN).unwrap();
    robot.skid_kg_s = SKID_KG_S;
    let problem = Problem::new(robot, gait, Laws::SKID_ROLL, omega_rad_s);
    (omega_rad_s, problem.solve(FIT_ACCURACY).unwrap().metrics)
}

/// Returns trials at these frequencies with independent noise.
fn trials(omegas_rad_s: &[f64], seed: u64) -> Vec<TrialRow> {
    trials_with(NOISE, omegas_rad_s, seed)
}

fn trials_with(noise: [f64; 2], omegas_rad_s: &[f64], seed: u64) -> Vec<TrialRow> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let trial = |(number, omega_rad_s): (usize, &f64)| {
        let noise = noise.map(|noise| noise * omega_rad_s / 3.0);
        let row = noisy_trial(CAMPAIGN, &motion(*omega_rad_s), noise, &mut random);
        TrialRow { trial: format!("{number}-{seed}"), ..row }
    };
    omegas_rad_s.iter().enumerate().map(trial).collect()
}

fn fitted(config: &Config, trials: &[TrialRow]) -> (KnownFit, FitData) {
    let data = FitData::from(trials.to_vec());
    let Fitted { mut fits, bootstrap, .. } = fit(config, &data, &|_| {});
    (KnownFit { row: fits.remove(0), alternative: None, replicates: bootstrap }, data)
}

fn candidates() -> Vec<Candidate> {
    let (_, command) = Config::default().setup(CAMPAIGN).unwrap();
    let at = |i: usize| 0.5 + 5.5 * i as f64 / (CANDIDATES - 1) as f64;
    let of = |i| Candidate { campaign: CAMPAIGN.to_owned(), command, omega_rad_s: at(i) };
    (0..CANDIDATES).map(of).collect()
}

fn advised(config: &Config, (known, data): &(KnownFit, FitData), aim: Aim) -> Advice {
    let model = known.row.model;
    let input = FitInput::new(config, CAMPAIGN, model).unwrap();
    let advice = known.with_information(&input, data, |information| {
        advise(information, &known.row, &candidates(), aim, [ADD, 1], &CancelToken::default())
    });
    advice.unwrap().unwrap()
}

fn omegas(advice: &Advice) -> Vec<f64> {
    let all = advice.trials.iter();
    all.flat_map(|of| vec![of.omega_rad_s; of.repeats as usize]).collect()
}

/// Returns the mean logarithm of the relative half widths of the fitted coefficients' confidence intervals.
fn mean_logarithm(row: &FitRow) -> f64 {
    let of = |parameter: &Parameter| {
        (0.5 * (row.upper[*parameter] - row.lower[*parameter]) / row.parameters[*parameter]).ln()
    };
    row.free.iter().map(of).sum::<f64>() / row.free.len() as f64
}

#[test]
fn cancelled_advice_ends_at_once() {
    let config = config(Model::SKID_ROLL);
    let (known, data) = fitted(&config, &trials(&MADE_RAD_S, 1));
    let input = FitInput::new(&config, CAMPAIGN, known.row.model).unwrap();
    let cancel = CancelToken::default();
    cancel.cancel();
    let (aim, size) = (Aim::Coefficients(Optimality::Determinant), [ADD, 1]);
    let results = known.with_information(&input, &data, |information| {
        let advice = advise(information, &known.row, &candidates(), aim, size, &cancel);
        [advice, tell(information, information, &candidates(), size, &cancel)]
    });
    for result in results.unwrap() {
        assert_eq!(result, Err(AdviceError::Cancelled(Cancelled)));
    }
}

/// Returns the logarithms of the factors by which additional trials narrow the confidence intervals, for one random
/// seed: as predicted, with the recommended trials, and with evenly spread trials. `None` if an interval is unknown.
fn narrowed(seed: u64) -> Option<[f64; 3]> {
    let config = config(Model::SKID_ROLL);
    let made = trials(&MADE_RAD_S, seed);
    let known = fitted(&config, &made);
    let advice = advised(&config, &known, Aim::Coefficients(Optimality::Determinant));
    let now = mean_logarithm(&known.0.row);
    let predicted = advice.expected.iter().map(|of| (of.expected_half_width / of.half_width).ln());
    let predicted = predicted.sum::<f64>() / advice.expected.len() as f64;
    let with = |omegas_rad_s: &[f64]| {
        let more = trials(omegas_rad_s, seed + 1_000);
        mean_logarithm(&fitted(&config, &[&made[..], &more[..]].concat()).0.row) - now
    };
    let evenly: Vec<f64> = (0..ADD).map(|i| 0.5 + 5.5 * (i as f64 + 0.5) / ADD as f64).collect();
    let all = [predicted, with(&omegas(&advice)), with(&evenly)];
    all.iter().all(|of| of.is_finite()).then_some(all)
}

/// Returns the geometric means of the three factors whose logarithms `of` returns, over the seeds for which it is not
/// `None`, and the number of these seeds.
fn mean_factors(of: fn(u64) -> Option<[f64; 3]>, seeds: u64) -> ([f64; 3], usize) {
    let all: Vec<[f64; 3]> = (0..seeds).into_par_iter().filter_map(of).collect();
    let mean = |i: usize| (all.iter().map(|of| of[i]).sum::<f64>() / all.len() as f64).exp();
    ([0, 1, 2].map(mean), all.len())
}

#[test]
fn advised_trials_shrink_the_intervals_as_predicted_and_more_than_others() {
    let ([predicted, found, evenly], count) = mean_factors(narrowed, 2);
    assert!(count == 2 && (found / predicted - 1.0).abs() < 0.4, "{predicted} {found}");
    assert!(found < evenly, "{predicted} {found} {evenly}");
}

#[test]
#[ignore = "takes minutes where nothing is optimised"]
fn over_thirty_seeds_recommended_trials_shrink_the_intervals_as_predicted() {
    let ([predicted, found, evenly], count) = mean_factors(narrowed, 30);
    println!("{count} seeds: predicted {predicted:.3}, found {found:.3}, evenly {evenly:.3}");
    assert!((found / predicted - 1.0).abs() < 0.2, "{predicted} {found}");
    assert!(found < evenly && count >= 20, "{predicted} {found} {evenly} {count}");
}

/// Runs a command on one thread, because many commands run at the same time; returns `None` if it fails.
fn tried(folder: &Path, arguments: &[&str]) -> Option<String> {
    let output = trilink(folder, &[arguments, &["--threads", "1"]].concat());
    (output.status.code() < Some(2)).then(|| text(&output.stdout))
}

/// Returns the logarithms of the factors by which the confidence intervals shrink, like [`narrowed`], but computed from
/// marker files: five trials of the semi-passive robot, and three additional trials. `None` if a command fails or an
/// interval is unknown.
fn narrowed_of_markers(seed: u64) -> Option<[f64; 3]> {
    const CAMPAIGN: &str = "semi-passive-symmetric";
    let folder = tempfile::tempdir().unwrap();
    let mut config = Config::default();
    config.campaign.retain(|name, _| name == CAMPAIGN);
    config.campaign.get_mut(CAMPAIGN).unwrap().models = vec![Model::SKID_ROLL];
    (config.fit.starts, config.fit.bootstrap, config.fit.profiles) = (1, 200, false);
    config.paths.raw = vec!["raw/*".into()];
    std::fs::write(folder.path().join("pipeline.toml"), toml::to_string(&config).unwrap()).unwrap();
    let [seed, other_seed] = [seed, 1_000 + seed].map(|seed| seed.to_string());
    let made = "0.5,1.9,3.25,4.6,6";
    tried(folder.path(), &["synth", "raw/made", "--omega", made, "--seed", &seed, "--quiet"])?;
    let half_widths = || -> Option<f64> {
        tried(folder.path(), &["run", "--quiet"])?;
        let fits = succeed(folder.path(), &["inspect", "fits", "--json"]);
        let fits: Value = serde_json::from_str(&fits).unwrap();
        let number = |of: usize, end: &str| fits[0][format!("skid{of}_kg_s_{end}")].as_f64();
        let logarithm = |of: usize| Some((0.5 * (number(of, "hi")? - number(of, "lo")?)).ln());
        Some((logarithm(0)? + logarithm(1)? + logarithm(2)?) / 3.0)
    };
    let now = half_widths()?;
    let design = ["design", CAMPAIGN, "--model", "skid-roll", "--omega", "0.5..6/12", "--json"];
    let advice: Value = serde_json::from_str(&tried(folder.path(), &design)?).unwrap();
    let expected =
        |of: &Value| Some((of["expected_half_width"].as_f64()? / of["half_width"].as_f64()?).ln());
    let expected: Option<Vec<f64>> =
        advice["expected"].as_array().unwrap().iter().map(expected).collect();
    let expected = expected?;
    let trials = advice["trials"].as_array().unwrap().iter();
    let advised: Vec<String> = trials.map(|of| of["omega_rad_s"].to_string()).collect();
    let with = |omegas: &str| {
        let more = ["synth", "raw/more", "--omega", omegas, "--seed", &seed];
        let more = [&more[..], &["--noise-seed", &other_seed, "--quiet"]].concat();
        tried(folder.path(), &more)?;
        let found = half_widths();
        std::fs::remove_dir_all(folder.path().join("raw/more")).unwrap();
        found
    };
    let predicted = expected.iter().sum::<f64>() / expected.len() as f64;
    Some([predicted, with(&advised.join(","))? - now, with("1.5,3.5,5.5")? - now])
}

#[test]
#[ignore = "ninety runs: minutes"]
fn over_thirty_simulated_campaigns_recommended_trials_shrink_the_intervals_as_predicted() {
    let ([predicted, found, evenly], count) = mean_factors(narrowed_of_markers, 30);
    println!("{count} seeds: predicted {predicted:.3}, found {found:.3}, evenly {evenly:.3}");
    assert!((found / predicted - 1.0).abs() < 0.2, "{predicted} {found}");
    assert!(found < evenly && count >= 20, "{predicted} {found} {evenly} {count}");
}

/// Removes the skid ratios from trials.
fn of_distance_only(mut rows: Vec<TrialRow>) -> Vec<TrialRow> {
    for row in &mut rows {
        row.metrics.sigma = padded(&[]);
        row.metrics_se.sigma = padded(&[]);
    }
    rows
}

#[test]
fn recommended_trials_identify_what_one_frequency_cannot() {
    const PRECISE: [f64; 2] = [0.001, 0.001];
    let mut config = config(Model::SKID_ROLL);
    config.fit.profiles = true;
    let free = Free(vec![Quantity::Skid.parameter(0), Quantity::Skid.parameter(1)]);
    config.campaign.get_mut(CAMPAIGN).unwrap().free.insert(Model::SKID_ROLL, free);
    // A single distance cannot identify two coefficients.
    let made = of_distance_only(trials_with(PRECISE, &[2.0; 4], 3));
    let known = fitted(&config, &made);
    assert!(!known.0.row.practically_not.is_empty(), "{:?}", known.0.row);
    let advice = advised(&config, &known, Aim::Coefficients(Optimality::Determinant));
    assert!(!advice.undetermined.is_empty() && advice.is_best_of_all);
    for untold in &advice.undetermined {
        let trial = untold.trial.as_ref().expect("a trial tells it");
        assert!((trial.omega_rad_s - 2.0).abs() > 0.4, "{untold:?}");
        assert!(untold.deviation_with < 0.5 * untold.deviation, "{untold:?}");
        assert!(untold.exchanged.len() == 1, "{untold:?}");
    }
    let more = of_distance_only(trials_with(PRECISE, &omegas(&advice), 4));
    let (then, _) = fitted(&config, &[made, more].concat());
    let row = &then.row;
    assert!(row.practically_not.is_empty() && row.structurally_not.is_empty(), "{row:?}");
    for (parameter, expected) in row.free.iter().zip(&advice.expected) {
        let half_width = 0.5 * (row.upper[*parameter] - row.lower[*parameter]);
        assert!(half_width < 0.5 * row.parameters[*parameter], "{row:?}");
        let expected = expected.expected_half_width / expected.value;
        let ratio = half_width / row.parameters[*parameter] / expected;
        // The expectation knows the noise; the fit estimates it from a few repeats.
        assert!((0.4..4.0).contains(&ratio), "{ratio} {row:?}");
    }
}

#[test]
fn trials_recommended_for_a_prediction_make_it_more_certain() {
    let config = config(Model::SKID_ROLL);
    let known = fitted(&config, &trials(&MADE_RAD_S, 1));
    let prediction = Prediction::parse("sigma1 at 5.5").unwrap();
    let of = |aim: Aim| {
        let advice = advised(&config, &known, aim);
        let row = advice.expected.last().unwrap();
        row.clone()
    };
    let row = of(Aim::Prediction(prediction));
    assert_eq!(row.quantity, "sigma1 at 5.5");
    assert!(row.expected_half_width < 0.85 * row.half_width, "{row:?}");
    assert!(row.expected_half_width < 1.02 * row.evenly_half_width, "{row:?}");
    // The bands of predictions agree with the present half widths.
    let input = FitInput::new(&config, CAMPAIGN, Model::SKID_ROLL).unwrap();
    let (fit, data) = &known;
    let half_width = fit.with_bands(&input, data, |bands| {
        let (mut robot, gait) = config.campaign_setup(CAMPAIGN).unwrap();
        fit.row.free.iter().for_each(|of| of.set(&mut robot, fit.row.parameters[*of]));
        let laws = Laws::SKID_ROLL;
        let problem = Problem::new(robot, gait, laws, 5.5);
        let mut solver = trilink_mechanics::Solver::default();
        let metrics = solver.solve(&problem, FIT_ACCURACY).unwrap();
        let [low, high] = bands.limits(solver, &problem, metrics).unwrap();
        0.5 * (high.sigma[1] - low.sigma[1])
    });
    let now = advised(&config, &known, Aim::Prediction(prediction)).expected;
    let ratio = now.last().unwrap().half_width / half_width.unwrap();
    assert!((0.5..2.0).contains(&ratio), "{ratio}");
}

#[test]
fn models_are_discriminated_where_they_differ() {
    // Two models with the same law, one of which fixes a coefficient at 50 kg/s.
    let held = Model::new("held");
    let [one, other] = [Model::SKID_ROLL, held].map(|model| {
        let mut config = config(model);
        config.fit.bootstrap = 20;
        let Laws { skid, roll } = Laws::SKID_ROLL;
        let free = Some(Free(vec![Quantity::Skid.parameter(0), Quantity::Skid.parameter(1)]));
        config.model.insert(held, ModelConfig { skid, roll, input: None, free });
        let known = fitted(&config, &trials_with([0.05, 0.1], &MADE_RAD_S, 1));
        (FitInput::new(&config, CAMPAIGN, model).unwrap(), known)
    });
    let of = |candidates: &[Candidate], add: usize| {
        let (input, (known, data)) = &one;
        known.with_information(input, data, |one| {
            let (input, (known, data)) = &other;
            known.with_information(input, data, |other| {
                tell(one, other, candidates, [add, 1], &CancelToken::default())
            })
        })
    };
    let best = of(&candidates(), 1).unwrap().unwrap().unwrap();
    // No other trial discriminates better between the models.
    for candidate in candidates().into_iter().step_by(3) {
        let alone = of(&[candidate], 1).unwrap().unwrap().unwrap();
        assert!(alone.standard_errors <= best.standard_errors * (1.0 + 1e-9));
    }
    let more = of(&candidates(), 4).unwrap().unwrap().unwrap();
    assert!(more.standard_errors > best.standard_errors, "{more:?}");
}

#[test]
fn the_command_prints_its_recommendation_and_errors() {
    let mut settings = small_settings();
    (settings.fit.bootstrap, settings.fit.gait_input) = (60, GaitInput::Measured);
    let folder = small_run(&settings, "1");
    let begin = ["design", CAMPAIGN, "--model", "skid-roll"];
    let all = |more: &[&'static str]| [&begin[..], more].concat();
    let said = succeed(folder.path(), &all(&["--add", "2", "--omega", "1..6/6"]));
    for needed in ["omega rad/s", "half widths", "skid0", "spread evenly"] {
        assert!(said.contains(needed), "{said}");
    }
    let json = succeed(folder.path(), &all(&["--json", "--for", "d at 2.5"]));
    let json: Value = serde_json::from_str(&json).unwrap();
    let trials: i64 =
        json["trials"].as_array().unwrap().iter().map(|of| of["repeats"].as_i64().unwrap()).sum();
    assert_eq!(trials, 3);
    assert_eq!(json["expected"][3]["quantity"], "d at 2.5");
    let csv = succeed(folder.path(), &all(&["--csv", "--add", "1", "--amplitude-deg", "20,30"]));
    assert!(csv.starts_with("campaign,omega_rad_s,phi1_amplitude_rad,"), "{csv}");
    for (arguments, needed) in [
        (all(&["--for", "d"]), "found `d`, needed `METRIC at RAD_S`"),
        (all(&["--for", "speed at 2"]), "sigma0"),
        (all(&["--candidates", "semi-passive-symmetric"]), "no campaign `semi-passive-symmetric`"),
        (all(&["--tell", "skid-roll"]), "needed a model other than"),
        (all(&["--tell", "skid"]), "only of no-skid, skid-roll; list skid under"),
        (all(&["--add", "0"]), "0 is not in 1..=50"),
        (
            all(&["--omega", "1,2"]),
            "trials can be added: each of the 2 candidates up to 1 times (--repeats)",
        ),
        (
            vec!["design", CAMPAIGN, "--model", "no-skid"],
            "kinematic-symmetric no-skid: the model does not fit",
        ),
        (vec!["design", "kinematic", "--model", "skid-roll"], "no fit of campaign kinematic"),
    ] {
        let output = trilink(folder.path(), &arguments);
        let stderr = text(&output.stderr);
        assert!(
            output.status.code() == Some(2) && stderr.contains(needed),
            "{arguments:?}: {stderr}"
        );
    }
    let empty = tempfile::tempdir().unwrap();
    let output = trilink(empty.path(), &begin);
    let stderr = text(&output.stderr);
    assert!(
        output.status.code() == Some(2)
            && stderr.contains("no pipeline.toml and no trials in the current folder"),
        "{stderr}"
    );
}
