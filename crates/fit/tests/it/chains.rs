//! Fits to trials of chains: the robots of the gallery `docs/robots`.

use std::path::Path;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use trilink_fit::{Fitted, fit};
use trilink_mechanics::{Model, Problem, REFERENCE_ACCURACY, Solver};
use trilink_robot::metrics::{GaitMetrics, Metric};
use trilink_robot::{AnyRobot, Laws, Parameter, Quantity};
use trilink_tables::config::{Campaign, Config, Free, GaitInput, Robots, SharedFits, SigmaKind};
use trilink_tables::{Columns as _, FitRow, TrialRow};

/// Relative standard deviation of the noise of a trial's metrics.
const NOISE: f64 = 0.01;
const OMEGAS_RAD_S: [f64; 7] = [2.0, 2.8, 3.6, 4.4, 5.2, 6.0, 6.8];

/// Robot of the gallery.
struct Case {
    file: &'static str,
    campaign: &'static str,
    free: &'static [&'static str],
}

const CASES: [Case; 6] = [
    Case { file: "twistcar", campaign: "twistcar", free: &["skid"] },
    Case { file: "roller-racer", campaign: "racer", free: &["skid"] },
    Case { file: "elastic-snake", campaign: "elastic", free: &["skid"] },
    Case { file: "passive-snake", campaign: "passive", free: &["skid", "stiffness2"] },
    Case { file: "driven-snake", campaign: "snake", free: &["skid0", "roll"] },
    Case { file: "rotor-car", campaign: "rotor-car", free: &["skid"] },
];

impl Case {
    /// Returns the configuration, whose fits have the given number of bootstrap replicates.
    fn config(&self, bootstrap: usize) -> Config {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/robots");
        let mut config = Config::load(&folder.join(self.file).with_extension("toml")).unwrap();
        let campaign = config.campaign.get_mut(self.campaign).unwrap();
        campaign.models = vec![Model::SKID_ROLL];
        let free = toml::Value::from(self.free.to_vec()).try_into::<Free>().unwrap();
        campaign.free.insert(Model::SKID_ROLL, free);
        (config.fit.sigma, config.fit.gait_input) = (SigmaKind::Raw, GaitInput::Commanded);
        config.fit.bootstrap = bootstrap;
        config.fit.profiles = false;
        config
    }

    fn trials(&self, config: &Config, noise: f64, seed: u64) -> Vec<TrialRow> {
        trials(config, self.campaign, Laws::SKID_ROLL, noise, seed)
    }

    fn robot(&self, config: &Config) -> AnyRobot {
        config.chain_setup(self.campaign).unwrap().into()
    }
}

/// Returns trials of a campaign whose metrics deviate by noise from those under the given laws with the configured
/// coefficients.
pub(crate) fn trials(
    config: &Config,
    campaign: &str,
    laws: Laws,
    noise: f64,
    seed: u64,
) -> Vec<TrialRow> {
    let chain = config.chain_setup(campaign).unwrap();
    let (gait, robot) = (chain.gait(), AnyRobot::from(chain));
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let trial = |omega_rad_s: f64| {
        let problem = Problem::new(robot.clone(), gait, laws, omega_rad_s);
        let metrics = Solver::default().solve(&problem, REFERENCE_ACCURACY).unwrap();
        let mut row = TrialRow {
            trial: format!("{campaign}-at-{omega_rad_s}"),
            campaign: campaign.to_owned(),
            omega_commanded_rad_s: omega_rad_s,
            omega_rad_s,
            // So many that Student's t distribution widens the standard errors by nothing.
            cycles: 1000,
            metrics,
            metrics_se: GaitMetrics::MISSING,
            ..TrialRow::blank()
        };
        for metric in Metric::FITTED {
            let error: f64 = StandardNormal.sample(&mut random);
            row.metrics[metric] *= 1.0 + noise * error;
            row.metrics_se[metric] = noise * metrics[metric];
        }
        // d and v are one measurement.
        row.metrics.v_m_s = row.metrics.d_m * omega_rad_s / std::f64::consts::TAU;
        row
    };
    OMEGAS_RAD_S.map(trial).into()
}

fn fitted(config: &Config, trials: Vec<TrialRow>) -> (FitRow, Fitted) {
    let fitted = fit(config, &trials.into(), &|_| {});
    (fitted.fits[0].clone(), fitted)
}

#[test]
fn fits_without_noise_recover_the_coefficients_of_every_robot_of_the_gallery() {
    for case in CASES {
        let config = case.config(0);
        let robot = case.robot(&config);
        let (row, fitted) = fitted(&config, case.trials(&config, 0.0, 0));
        assert!(row.status.is_ok(), "{}: {}", case.file, row.failure);
        assert!(!row.free.is_empty(), "{}", case.file);
        for parameter in &row.free {
            let [found, planted] = [row.parameters[*parameter], robot.value(*parameter)];
            let error = (found / planted - 1.0).abs();
            assert!(error < 1e-3, "{}: {parameter} = {found}, not {planted}", case.file);
        }
        for row in &fitted.predictions {
            assert!(row.status.is_stable(), "{}: {row:?}", case.file);
        }
    }
}

#[test]
fn campaigns_of_one_robot_that_are_fitted_together_keep_their_own_commands() {
    let mut config = CASES[5].config(0);
    let (gait, campaign) = ("wobble", "rotor-car-2");
    let own = config.campaign[CASES[5].campaign].clone();
    let mut other = config.gait[&own.gait].clone();
    other
        .rotor
        .values_mut()
        .for_each(|rotor| rotor.amplitude_deg = rotor.amplitude_deg.map(|deg| 1.4 * deg));
    config.gait.insert(gait.to_owned(), other);
    let own = Campaign { gait: gait.to_owned(), ..own };
    let robot = own.robot.clone();
    config.campaign.insert(campaign.to_owned(), own);
    config.fit.shared = Some(SharedFits { robot: Robots(vec![robot]) });
    let mut trials = CASES[5].trials(&config, 0.0, 0);
    trials.extend(super::chains::trials(&config, campaign, Laws::SKID_ROLL, 0.0, 0));
    let row = &fit(&config, &trials.into(), &|_| {}).shared[0].fit;
    let robot = CASES[5].robot(&config);
    assert!(row.free.len() >= 2 && row.j < 1e-5, "{row:?}");
    for parameter in &row.free {
        let [found, planted] = [row.parameters[*parameter], robot.value(*parameter)];
        assert!((found / planted - 1.0).abs() < 1e-3, "{parameter} = {found}, not {planted}");
    }
}

#[test]
fn a_chain_lists_the_coefficients_of_its_own_wheels() {
    let free = |case: &Case| fitted(&case.config(0), case.trials(&case.config(0), 0.0, 0)).0.free;
    let skid = |count: usize| -> Vec<Parameter> {
        (0..count).map(|wheel| Quantity::Skid.parameter(wheel)).collect()
    };
    assert_eq!(free(&CASES[0]), skid(2));
    assert_eq!(free(&CASES[3]), [skid(3), vec![Quantity::Stiffness.parameter(2)]].concat());
}

/// Counts, over fits to noisy trials, the limits that contain the planted value of their coefficient, and all limits.
fn held(case: &Case, seeds: std::ops::Range<u64>) -> [usize; 2] {
    let config = case.config(100);
    let robot = case.robot(&config);
    let mut counts = [0; 2];
    for seed in seeds {
        let (row, _) = fitted(&config, case.trials(&config, NOISE, seed));
        for parameter in &row.free {
            let [low, high] = [row.lower[*parameter], row.upper[*parameter]];
            let planted = robot.value(*parameter);
            if low.is_finite() && high.is_finite() {
                counts[0] += usize::from((low..=high).contains(&planted));
                counts[1] += 1;
            }
        }
    }
    counts
}

/// Takes minutes in a release build; the smaller test below always runs.
#[test]
#[ignore = "slow"]
fn the_limits_of_the_coefficients_hold_them_for_every_robot_of_the_gallery() {
    let counts = CASES.map(|case| {
        let [held, all] = held(&case, 0..100);
        println!("{}: {held} of {all} limits hold the coefficient", case.file);
        [held, all]
    });
    assert!(counts.iter().all(|[held, all]| 10 * held >= 9 * all && *all > 0), "{counts:?}");
}

#[test]
fn the_limits_of_the_coefficients_of_a_chain_hold_them() {
    let [held, all] = held(&CASES[0], 0..10);
    assert!(held + 4 >= all && all >= 16, "{held} of {all}");
}
