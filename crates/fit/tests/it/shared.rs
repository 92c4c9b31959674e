//! Fits with one set of coefficients for all campaigns of a robot, and the test of whether the coefficients are shared.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use trilink_fit::{FitData, Fitted, fit};
use trilink_mechanics::{FIT_ACCURACY, Laws, Model, Problem};
use trilink_robot::metrics::GaitMetrics;
use trilink_robot::{Quantity, Robot};
use trilink_tables::config::{Config, Free, GaitInput, Robots, SharedFits, SigmaKind};
use trilink_tables::{FitRow, Misfit, NotTested, NotTestedReason, SharedFitRow, Sharing, TrialRow};

use crate::common::noisy_trial;

/// Relative noise of d and v (first) and of the skid ratios (second).
const NOISE: [f64; 2] = [0.01, 0.02];
const CAMPAIGNS: [&str; 2] = ["kinematic-skewed", "kinematic-symmetric"];
const COULOMB: &str = "coulomb";

/// Frequencies of a campaign, rad/s, with the metrics of the steady-state motion at each.
type Motions = Vec<(f64, GaitMetrics)>;

/// Returns a configuration with the kinematic robot's campaigns, the given models, and shared fits.
fn config(models: &[Model]) -> Config {
    let mut config = Config::default();
    config.campaign.retain(|name, _| CAMPAIGNS.contains(&name.as_str()));
    config.campaign.values_mut().for_each(|campaign| campaign.models = models.to_vec());
    (config.fit.starts, config.fit.bootstrap, config.fit.profiles) = (1, 0, false);
    // The trials have no measured gait.
    (config.fit.sigma, config.fit.gait_input) = (SigmaKind::Raw, GaitInput::Commanded);
    config.fit.shared = Some(SharedFits { robot: Robots(vec!["kinematic".to_owned()]) });
    config
}

/// Solves for the metrics of a campaign under the given laws, with `change` applied to its robot.
fn motions(campaign: &str, laws: Laws, change: impl Fn(&mut Robot)) -> Motions {
    let (mut robot, gait) = Config::default().campaign_setup(campaign).unwrap();
    change(&mut robot);
    let motion = |omega_rad_s: f64| {
        let problem = Problem::new(robot.clone(), gait, laws, omega_rad_s);
        (omega_rad_s, problem.solve(FIT_ACCURACY).unwrap().metrics)
    };
    (0..13).map(|i| motion(0.5 + 0.45 * f64::from(i))).collect()
}

/// Solves for the metrics of both campaigns under dry friction.
fn dry() -> [Motions; 2] {
    CAMPAIGNS.map(|campaign| {
        motions(campaign, Laws::COULOMB, |robot| {
            (robot.skid_dry_n, robot.transition_m_s) = ([1.8, 0.9, 0.9], 0.005);
        })
    })
}

/// Solves for the metrics of both campaigns under viscous resistance, with the given coefficients for each campaign.
fn viscous(skid_kg_s: [[f64; 3]; 2]) -> [Motions; 2] {
    [0, 1].map(|i| motions(CAMPAIGNS[i], Laws::SKID_ROLL, |robot| robot.skid_kg_s = skid_kg_s[i]))
}

/// Creates trials of both campaigns with `noise_factor` times the noise in [`NOISE`], and with standard errors that
/// match this noise.
fn trials(motions: &[Motions; 2], noise_factor: f64, seed: u64) -> FitData {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let noise = NOISE.map(|noise| noise_factor * noise);
    let mut rows = Vec::new();
    for (campaign, motions) in CAMPAIGNS.iter().zip(motions) {
        for motion in motions {
            rows.push(TrialRow {
                trial: format!("{campaign}-{}", motion.0),
                ..noisy_trial(campaign, motion, noise, &mut random)
            });
        }
    }
    FitData::from(rows)
}

fn fitted(models: &[Model], data: &FitData) -> Fitted {
    fit(&config(models), data, &|_| {})
}

/// Counts, for each model, in how many of `seeds` simulations the sharing test keeps the assumption of shared
/// coefficients (first) and in how many it rejects this assumption (second); `what` labels the printed results.
fn counts(what: &str, models: &[Model], motions: &[Motions; 2], seeds: u64) -> Vec<[usize; 2]> {
    let all: Vec<Vec<SharedFitRow>> = (0..seeds)
        .into_par_iter()
        .map(|seed| fitted(models, &trials(motions, 1.0, seed)).shared)
        .collect();
    let of_model = |(i, model): (usize, &Model)| {
        let of: Vec<&SharedFitRow> = all.iter().map(|rows| &rows[i]).collect();
        let count = |sharing| of.iter().filter(|row| row.fit.sharing == Some(sharing)).count();
        let first = &of[0];
        println!(
            "{what}: {model}: kept {}, refused {}, of {seeds}; J {:.4} against {:.4}, rise {:.4} limit \
             {:.4} p {:.3} {:?} free {:?}",
            count(Sharing::Kept),
            count(Sharing::Refused),
            first.fit.j,
            first.j_separate,
            first.rise,
            first.rise_limit,
            first.p_value,
            first.not_tested,
            first.fit.free.iter().map(|of| first.fit.parameters[*of]).collect::<Vec<_>>(),
        );
        let mut p: Vec<f64> = of.iter().map(|row| row.p_value).collect();
        p.sort_by(f64::total_cmp);
        println!("  p {p:.3?}");
        [count(Sharing::Kept), count(Sharing::Refused)]
    };
    models.iter().enumerate().map(of_model).collect()
}

#[test]
#[ignore = "minutes: cargo test --release -p trilink-fit --test it shared:: -- --ignored --nocapture"]
fn the_sharing_test_is_nearly_always_right() {
    let models = [Model::SKID_ROLL, Model::new(COULOMB)];
    let [[_, refused], [kept, _]] = counts("dry", &models, &dry(), 24)[..] else { panic!() };
    assert!(refused >= 22 && kept >= 22, "{refused} {kept}");
    let one_set = viscous([[100.0, 40.0, 50.0]; 2]);
    let [[kept, _]] = counts("one set", &models[..1], &one_set, 60)[..] else { panic!() };
    assert!(kept >= 54, "{kept}");
    for (what, sets) in [
        ("two sets", [[100.0, 90.0, 95.0], [100.0, 34.0, 45.0]]),
        ("two near sets", [[100.0, 45.0, 50.0], [100.0, 40.0, 50.0]]),
    ] {
        let [[_, refused]] = counts(what, &models[..1], &viscous(sets), 24)[..] else { panic!() };
        assert!(refused >= 20, "{what}: {refused}");
    }
}

/// Returns the shared fits for simulated data of both campaigns.
fn shared(
    models: &[Model],
    motions: &[Motions; 2],
    noise_factor: f64,
    seed: u64,
) -> Vec<SharedFitRow> {
    fitted(models, &trials(motions, noise_factor, seed)).shared
}

#[test]
fn a_shared_fit_to_noise_free_data_recovers_the_coefficients() {
    let planted = [100.0, 40.0, 50.0];
    let rows = shared(&[Model::SKID_ROLL], &viscous([planted; 2]), 0.0, 0);
    let [row] = rows.as_slice() else { panic!("{rows:?}") };
    assert_eq!(
        (row.robot.as_str(), &row.campaigns[..]),
        ("kinematic", &CAMPAIGNS.map(String::from)[..])
    );
    for (parameter, planted) in Quantity::Skid.of_each().into_iter().zip(planted) {
        let found = row.fit.parameters[parameter];
        assert!((found / planted - 1.0).abs() < 1e-3, "{parameter}: {found}");
    }
    assert!(row.fit.j < 1e-5, "{}", row.fit.j);
    assert_eq!((row.fit.sharing, row.fit.trials), (None, 26));
    assert_eq!(row.not_tested, Some(NotTestedReason::NothingLeft.into()));
}

#[test]
fn sharing_is_kept_for_equal_coefficients_and_refused_for_different_ones() {
    for (sets, expected) in [
        ([[100.0, 40.0, 50.0]; 2], Sharing::Kept),
        ([[75.0, 91.0, 95.0], [104.0, 34.0, 45.0]], Sharing::Refused),
    ] {
        let Fitted { fits, shared, .. } =
            fitted(&[Model::SKID_ROLL], &trials(&viscous(sets), 1.0, 4));
        let row = &shared[0];
        assert_eq!(row.fit.sharing, Some(expected), "{row:?}");
        assert!(fits.iter().all(|fit| fit.sharing == Some(expected)));
        let separate: f64 = fits.iter().map(|fit| fit.j).sum();
        assert_eq!(row.j_separate, separate);
        assert!((row.fit.j - separate - row.rise).abs() < 1e-6, "{row:?}");
        let is_rare = expected == Sharing::Refused;
        assert_eq!((row.rise > row.rise_limit, row.p_value < 0.05), (is_rare, is_rare), "{row:?}");
        assert_eq!(row.fit.adequate, Some(!is_rare), "{row:?}");
        let runs = if let Some(Misfit::Off(runs)) = &row.fit.misfit { &runs[..] } else { &[] };
        let names_a_campaign = runs.iter().any(|run| CAMPAIGNS.contains(&&*run.campaign));
        assert_eq!(names_a_campaign, is_rare, "{row:?}");
    }
}

#[test]
fn with_dry_friction_shared_viscous_coefficients_are_refused_and_shared_dry_ones_are_kept() {
    let models = [Model::SKID_ROLL, Model::new(COULOMB)];
    let Fitted { fits, shared, .. } = fitted(&models, &trials(&dry(), 1.0, 1));
    let [viscous, dry] = shared.as_slice() else { panic!("{shared:?}") };
    assert_eq!(viscous.fit.sharing, Some(Sharing::Refused), "{viscous:?}");
    assert_eq!(dry.fit.sharing, Some(Sharing::Kept), "{dry:?}");
    for (parameter, planted) in Quantity::SkidDry.of_each().into_iter().zip([1.8, 0.9, 0.9]) {
        let found = dry.fit.parameters[parameter];
        assert!((found / planted - 1.0).abs() < 0.03, "{parameter}: {found}");
    }
    // The viscous coefficients of the campaigns differ.
    let viscous_skid = |campaign: &str| {
        let is_of = |fit: &&FitRow| fit.campaign == campaign && fit.model == Model::SKID_ROLL;
        let fit = fits.iter().find(is_of).unwrap();
        Quantity::Skid.of_each().map(|skid| fit.parameters[skid])
    };
    let [skewed, symmetric] = CAMPAIGNS.map(viscous_skid);
    let log_ratio = (0..3).map(|i| (skewed[i] / symmetric[i]).ln().abs()).fold(0.0, f64::max);
    assert!(log_ratio > 0.3, "{skewed:?} {symmetric:?}");
}

#[test]
fn a_shared_fit_has_intervals_and_does_not_change_the_separate_fits() {
    let mut config = config(&[Model::SKID_ROLL]);
    config.fit.bootstrap = 20;
    config.fit.profiles = true;
    let data = trials(&viscous([[100.0, 40.0, 50.0]; 2]), 1.0, 2);
    let with = fit(&config, &data, &|_| {});
    let row = &with.shared[0].fit;
    for (parameter, planted) in Quantity::Skid.of_each().into_iter().zip([100.0, 40.0, 50.0]) {
        let limits = row.lower[parameter]..row.upper[parameter];
        // Limits from only 20 replicates are uncertain.
        let widened = 0.9 * limits.start..1.1 * limits.end;
        assert!(widened.contains(&planted) && limits.contains(&row.parameters[parameter]));
        let own = with.fits.iter().map(|fit| fit.scatter[parameter]).fold(f64::INFINITY, f64::min);
        assert!(row.scatter[parameter] < 1.5 * own, "{} {own}", row.scatter[parameter]);
    }
    assert_eq!(row.identifiable, Quantity::Skid.of_each());
    config.fit.shared = None;
    let mut without = fit(&config, &data, &|_| {});
    assert!(without.shared.is_empty());
    without.fits.iter_mut().for_each(|fit| fit.sharing = Some(Sharing::Kept));
    assert_eq!(format!("{:?}", without.fits), format!("{:?}", with.fits));
}

#[test]
fn campaigns_with_different_free_coefficients_are_fitted_together_and_not_tested() {
    let mut config = config(&[Model::SKID_ROLL]);
    let campaign = config.campaign.get_mut(CAMPAIGNS[0]).unwrap();
    campaign.free.insert(Model::SKID_ROLL, Free(vec![Quantity::Skid.parameter(1)]));
    let data = trials(&viscous([[100.0, 40.0, 50.0]; 2]), 1.0, 3);
    let row = &fit(&config, &data, &|_| {}).shared[0];
    assert_eq!((row.fit.free.len(), row.fit.sharing), (3, None));
    let why = NotTested::new(NotTestedReason::OtherFree, CAMPAIGNS[0]);
    assert_eq!(row.not_tested, Some(why));
}
