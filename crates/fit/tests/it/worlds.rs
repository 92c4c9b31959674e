//! Fits to the trials of simulated laboratories, in which trials and days differ ([`super::laboratory`]).

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use trilink_fit::{FitData, Fitted, fit};
use trilink_robot::metrics::{GaitMetrics, padded};
use trilink_robot::{Gait, Model, Quantity, Robot};
use trilink_statistics::{HALF_WIDTH_95, student};
use trilink_tables::config::{Config, GaitInput, RobotConfig, SigmaKind};
use trilink_tables::{Columns as _, CycleRow, TrialRow, UndecidedReason};

use super::laboratory::{Floor, steady_metrics};

const CAMPAIGN: &str = "kinematic-symmetric";
const CYCLES: usize = 6;
/// Relative noise of a cycle: of d and v, and of the skid ratios.
const CYCLE_NOISE: [f64; 2] = [0.004, 0.012];
/// Step of the logarithm of a robot parameter for numerical derivatives.
const STEP: f64 = 0.02;
/// Number of friction coefficients, which are the first of [`PARAMETERS`].
const COEFFICIENTS: usize = 6;
/// Robot parameters that vary.
const PARAMETERS: [(Quantity, usize); 15] = [
    (Quantity::Skid, 0),
    (Quantity::Skid, 1),
    (Quantity::Skid, 2),
    (Quantity::Roll, 0),
    (Quantity::Roll, 1),
    (Quantity::Roll, 2),
    (Quantity::Inertia, 0),
    (Quantity::Inertia, 1),
    (Quantity::Inertia, 2),
    (Quantity::H, 0),
    (Quantity::H, 1),
    (Quantity::L, 0),
    (Quantity::L, 1),
    (Quantity::B, 0),
    (Quantity::B, 1),
];
const SIX_RAD_S: [f64; 6] = [0.5, 1.5, 2.5, 3.5, 4.5, 5.5];
const EIGHT_RAD_S: [f64; 8] = [0.5, 1.0, 1.5, 2.5, 3.0, 3.5, 4.5, 5.5];
const TWELVE_RAD_S: [f64; 12] = [0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 4.5, 5.0, 5.5, 6.0];
/// Frequencies so low that the robot hardly skids.
const SLOW_RAD_S: [f64; 6] = [0.3, 0.4, 0.5, 0.6, 0.7, 0.8];
/// Factor of the friction of trials that are unlike their repeats.
const UNLIKE: f64 = 1.5;
/// Declared standard uncertainties of the robot parameters: of the inertia and the roll resistance, relative; of h, l
/// and b, m.
const INERTIA_SD: f64 = 0.05;
const ROLL_SD: f64 = 0.1;
const LENGTH_SD_M: f64 = 0.001;

/// Laboratory, in which the friction coefficients of a trial are those of the population times random factors.
#[derive(Debug, Clone)]
struct World {
    omegas_rad_s: &'static [f64],
    days: usize,
    /// Number of trials at each frequency on each day.
    repeats: usize,
    /// Relative standard deviations of friction between days and between the trials of a day.
    day_sd: f64,
    trial_sd: f64,
    /// Whether all coefficients of a trial have the same factor.
    is_common: bool,
    floor: Floor,
    /// Number of trials with [`UNLIKE`] times the friction, each at another frequency.
    unlike: usize,
    /// Whether the robot parameters differ from the configured ones by random errors of their declared uncertainty.
    has_errors: bool,
}

const FLOORS: [Floor; 3] = [
    Floor::Viscous,
    Floor::Saturating { speed_m_s: 0.02 },
    Floor::Power { exponent: 0.5, speed_m_s: 0.02 },
];

/// Steady metrics d, v and sigma as functions of the robot parameters, at one frequency: logarithms, with their first
/// and second derivatives with respect to the logarithm of each parameter.
struct Response {
    logarithms: [f64; 5],
    slopes: Vec<[f64; 5]>,
    curvatures: Vec<[f64; 5]>,
}

fn setup() -> (Config, Robot, Gait) {
    let mut config = Config::default();
    config.campaign.retain(|name, _| name == CAMPAIGN);
    config.fit.starts = 1;
    config.fit.sigma = SigmaKind::Raw;
    config.fit.gait_input = GaitInput::Commanded;
    let (mut robot, gait) = config.campaign_setup(CAMPAIGN).expect("a campaign");
    robot.skid_kg_s = [104.0, 34.0, 45.0];
    (config, robot, gait)
}

/// Returns the configuration with the standard uncertainties of the robot parameters.
fn declare(config: &mut Config) {
    let (_, robot, _) = setup();
    let declared = config
        .robot
        .get_mut("kinematic")
        .and_then(RobotConfig::three_links_mut)
        .expect("the robot of the campaign");
    declared.set_deviation(Quantity::Inertia, robot.inertia_kg_m2.map(|value| INERTIA_SD * value));
    declared.set_deviation(Quantity::Roll, robot.roll_kg_s.map(|value| ROLL_SD * value));
    for quantity in [Quantity::H, Quantity::L, Quantity::B] {
        declared.set_deviation(quantity, [LENGTH_SD_M; 2]);
    }
}

/// Draws the logarithms of the ratios of the robot parameters to the configured ones, from their declared uncertainties.
fn errors_of_parameters(random: &mut ChaCha8Rng) -> [f64; PARAMETERS.len()] {
    let (_, mut robot, _) = setup();
    PARAMETERS.map(|(quantity, index)| {
        let value = quantity.numbers_mut(&mut robot)[index];
        let normal: f64 = StandardNormal.sample(random);
        let sd = match quantity {
            Quantity::Skid => 0.0,
            Quantity::Roll => ROLL_SD,
            Quantity::Inertia => INERTIA_SD,
            _ => LENGTH_SD_M / value,
        };
        (sd * normal).ln_1p()
    })
}

/// Returns the response at a frequency to the friction coefficients or, if the robot `has_errors`, to all parameters. The
/// first call for a frequency integrates the motions, in parallel.
fn response(floor: Floor, has_errors: bool, omega_rad_s: f64) -> Arc<Response> {
    type Known = BTreeMap<(usize, bool, u64), Arc<Response>>;
    static KNOWN: Mutex<Known> = Mutex::new(BTreeMap::new());
    let index = FLOORS.iter().position(|of| *of == floor).expect("one of the floors");
    let key = (index, has_errors, omega_rad_s.to_bits());
    if let Some(known) = KNOWN.lock().expect("no panic").get(&key) {
        return Arc::clone(known);
    }
    let numbers = if has_errors { PARAMETERS.len() } else { COEFFICIENTS };
    let response = Arc::new(Response::new(floor, omega_rad_s, &PARAMETERS[..numbers]));
    KNOWN.lock().expect("no panic").insert(key, Arc::clone(&response));
    response
}

impl Response {
    fn new(floor: Floor, omega_rad_s: f64, numbers: &[(Quantity, usize)]) -> Self {
        let (_, robot, gait) = setup();
        let logarithms = |step: Option<((Quantity, usize), f64)>| -> [f64; 5] {
            let mut robot = robot.clone();
            if let Some(((quantity, index), step)) = step {
                quantity.numbers_mut(&mut robot)[index] *= step.exp();
            }
            let metrics = steady_metrics(&robot, floor, &gait, omega_rad_s).to_array();
            std::array::from_fn(|i| metrics[i].ln())
        };
        let sides = numbers.iter().flat_map(|of| [Some((*of, -STEP)), Some((*of, STEP))]);
        let steps: Vec<_> = [None].into_iter().chain(sides).collect();
        let found: Vec<[f64; 5]> = steps.into_par_iter().map(logarithms).collect();
        let middle = found[0];
        let sides = found[1..].chunks_exact(2).map(|sides| [sides[0], sides[1]]);
        let slope = |[low, high]: [[f64; 5]; 2]| -> [f64; 5] {
            std::array::from_fn(|i| (high[i] - low[i]) / (2.0 * STEP))
        };
        let curvature = |[low, high]: [[f64; 5]; 2]| -> [f64; 5] {
            std::array::from_fn(|i| (high[i] - 2.0 * middle[i] + low[i]) / STEP.powi(2))
        };
        Self {
            logarithms: middle,
            slopes: sides.clone().map(slope).collect(),
            curvatures: sides.map(curvature).collect(),
        }
    }

    /// Returns the metrics after changes in the logarithms of the robot parameters, to second order.
    fn metrics(&self, shifts: [f64; PARAMETERS.len()]) -> [f64; 5] {
        std::array::from_fn(|i| {
            let changes = (0..self.slopes.len()).map(|k| {
                self.slopes[k][i] * shifts[k] + 0.5 * self.curvatures[k][i] * shifts[k].powi(2)
            });
            (self.logarithms[i] + changes.sum::<f64>()).exp()
        })
    }
}

impl World {
    /// Simulates the trials of the world.
    fn trials(&self, seed: u64) -> FitData {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut data = FitData::default();
        let robot =
            if self.has_errors { errors_of_parameters(&mut random) } else { Default::default() };
        for day in 0..self.days {
            let of_day = self.factors(self.day_sd, &mut random);
            for (frequency, &omega_rad_s) in self.omegas_rad_s.iter().enumerate() {
                for repeat in 0..self.repeats {
                    let of_trial = self.factors(self.trial_sd, &mut random);
                    let is_unlike = frequency < self.unlike && repeat == 0;
                    let unlike = if is_unlike { UNLIKE.ln() } else { 0.0 };
                    let name = format!("{omega_rad_s}-{day}-{repeat}");
                    let mut shifts = robot;
                    for k in 0..COEFFICIENTS {
                        shifts[k] += of_day[k] + of_trial[k] + unlike;
                    }
                    let exact = response(self.floor, self.has_errors, omega_rad_s).metrics(shifts);
                    add_trial(name, day, omega_rad_s, exact, &mut random, &mut data);
                }
            }
        }
        data
    }

    /// Draws the logarithms of the factors of all friction coefficients.
    fn factors(&self, sd: f64, random: &mut ChaCha8Rng) -> [f64; COEFFICIENTS] {
        let common: f64 = StandardNormal.sample(random);
        std::array::from_fn(|_| {
            let own: f64 = StandardNormal.sample(random);
            sd * if self.is_common { common } else { own }
        })
    }

    /// Fits models to `campaigns` simulations.
    fn fits(&self, models: &[Model], campaigns: u64) -> Vec<Fitted> {
        self.fits_with(models, campaigns, |_| {})
    }

    /// Fits models to `campaigns` simulations with a changed configuration.
    fn fits_with(
        &self,
        models: &[Model],
        campaigns: u64,
        change: impl Fn(&mut Config),
    ) -> Vec<Fitted> {
        let (mut config, ..) = setup();
        change(&mut config);
        config.campaign.values_mut().for_each(|campaign| campaign.models = models.to_vec());
        let data: Vec<FitData> = (0..campaigns).map(|seed| self.trials(seed)).collect();
        data.par_iter().map(|data| fit(&config, data, &|_| {})).collect()
    }
}

/// Adds a trial with noisy cycles around the `exact` metrics d, v and sigma.
fn add_trial(
    name: String,
    day: usize,
    omega_rad_s: f64,
    exact: [f64; 5],
    random: &mut ChaCha8Rng,
    data: &mut FitData,
) {
    let cycles: Vec<[f64; 5]> = (0..CYCLES)
        .map(|_| {
            let [distance, skid] = CYCLE_NOISE;
            let mut normal = || -> f64 { StandardNormal.sample(random) };
            let d = distance * normal();
            let noise = [d, d, skid * normal(), skid * normal(), skid * normal()];
            std::array::from_fn(|i| exact[i] * (1.0 + noise[i]))
        })
        .collect();
    let count = CYCLES as f64;
    let mean: [f64; 5] =
        std::array::from_fn(|i| cycles.iter().map(|cycle| cycle[i]).sum::<f64>() / count);
    let error: [f64; 5] = std::array::from_fn(|i| {
        let squares: f64 = cycles.iter().map(|cycle| (cycle[i] - mean[i]).powi(2)).sum();
        student(count - 1.0) * (squares / (count - 1.0) / count).sqrt()
    });
    data.trials.push(TrialRow {
        trial: name.clone(),
        day: format!("day {day}"),
        campaign: CAMPAIGN.to_owned(),
        omega_commanded_rad_s: omega_rad_s,
        omega_rad_s,
        cycles: CYCLES as i64,
        metrics: metrics(mean),
        metrics_se: metrics(error),
        ..TrialRow::blank()
    });
    let rows = cycles.into_iter().zip(0..).map(|(cycle, number)| CycleRow {
        trial: name.clone(),
        cycle: number,
        metrics: metrics(cycle),
        used: true,
        ..CycleRow::blank()
    });
    let rows = rows.collect();
    data.cycles.insert(name, rows);
}

fn metrics([d_m, v_m_s, sigma @ ..]: [f64; 5]) -> GaitMetrics {
    GaitMetrics { d_m, v_m_s, sigma: padded(&sigma), ..GaitMetrics::MISSING }
}

/// Results of many fits of the true model.
#[derive(Debug, Default)]
struct Outcome {
    kept: usize,
    refused: usize,
    undecided: usize,
    intervals: usize,
    held: usize,
    /// Mean half width of the logarithm of a coefficient.
    half_width: f64,
    /// RMS error of the logarithm of a coefficient.
    error: f64,
}

fn outcome(fits: &[Fitted]) -> Outcome {
    let (_, robot, _) = setup();
    let mut found = Outcome::default();
    let mut count = 0.0;
    for fitted in fits {
        let row = &fitted.fits[0];
        match row.adequate {
            Some(true) => found.kept += 1,
            Some(false) => found.refused += 1,
            None => found.undecided += 1,
        }
        for (wheel, truth) in robot.skid_kg_s.into_iter().enumerate() {
            let skid = Quantity::Skid.parameter(wheel);
            let [low, high] = [row.lower[skid], row.upper[skid]];
            found.error += (row.parameters[skid] / truth).ln().powi(2);
            count += 1.0;
            if low.is_finite() && high.is_finite() {
                found.intervals += 1;
                found.held += usize::from((low..=high).contains(&truth));
                found.half_width += 0.5 * (high / low).ln();
            }
        }
    }
    found.half_width /= found.intervals as f64;
    found.error = (found.error / count).sqrt();
    found
}

const TIDY: World = World {
    omegas_rad_s: &SIX_RAD_S,
    days: 1,
    repeats: 1,
    day_sd: 0.0,
    trial_sd: 0.0,
    is_common: false,
    floor: Floor::Viscous,
    unlike: 0,
    has_errors: false,
};
const SINGLES: World = World { trial_sd: 0.02, ..TIDY };
const REPEATS: World = World { trial_sd: 0.02, repeats: 3, ..TIDY };
const DAYS: World = World { days: 3, day_sd: 0.05, trial_sd: 0.01, ..TIDY };

fn without_limits(config: &mut Config) {
    config.fit.bootstrap = 0;
    config.fit.profiles = false;
}

/// Returns the world with the same factor for all coefficients of a trial, or with independent ones.
fn both(world: &World) -> [World; 2] {
    [false, true].map(|is_common| World { is_common, ..world.clone() })
}

#[test]
fn the_true_model_is_not_refused_because_trials_differ() {
    for (trial_sd, campaigns) in [(0.003, 12), (0.02, 12)] {
        for world in both(&World { trial_sd, ..TIDY }) {
            let found = outcome(&world.fits_with(&[Model::SKID_ROLL], campaigns, without_limits));
            assert!(found.refused <= 1, "{world:?} {found:?}");
        }
    }
}

#[test]
fn without_repeats_a_misfit_beyond_the_noise_of_the_cycles_is_undecided() {
    let fits = SINGLES.fits_with(&[Model::SKID_ROLL], 4, |config| config.fit.bootstrap = 20);
    for fit in fits.iter().map(|fitted| &fitted.fits[0]).filter(|fit| fit.adequate.is_none()) {
        let undecided = fit.undecided.as_ref().expect("a reason");
        assert_eq!(undecided.reason, UndecidedReason::NoRepeats);
        assert_eq!(undecided.of, ["0.50 rad/s", "3.50 rad/s", "5.50 rad/s"]);
        // The limits are those of the noise that the residuals show.
        assert_eq!(fit.no_interval, None);
    }
    assert!(fits.iter().any(|fitted| fitted.fits[0].adequate.is_none()));
}

#[test]
fn a_law_that_is_not_viscous_is_refused() {
    for floor in &FLOORS[1..] {
        for world in [&TIDY, &REPEATS, &DAYS] {
            let world = World { floor: *floor, ..world.clone() };
            let found = outcome(&world.fits_with(&[Model::SKID_ROLL], 6, without_limits));
            assert_eq!(found.refused, 6, "{world:?} {found:?}");
        }
    }
}

#[test]
fn trials_unlike_their_repeats_are_left_out_and_named() {
    let omegas_rad_s = &EIGHT_RAD_S;
    let world = World { omegas_rad_s, repeats: 3, trial_sd: 0.005, unlike: 5, ..TIDY };
    let fits = world.fits_with(&[Model::SKID_ROLL], 10, |config| config.fit.bootstrap = 60);
    for fitted in &fits {
        let notes = &fitted.fits[0].notes;
        let expected = ["0.5-0-0", "1-0-0", "1.5-0-0", "2.5-0-0", "3-0-0"];
        assert_eq!(notes.unlike_repeats, expected, "{notes}");
    }
    let found = outcome(&fits);
    assert!(found.refused <= 1 && found.held >= 26, "{found:?}");
    let floor = FLOORS[1];
    let found =
        outcome(&World { floor, ..world }.fits_with(&[Model::SKID_ROLL], 6, without_limits));
    assert_eq!(found.refused, 6, "{found:?}");
}

#[test]
fn declared_uncertainties_of_the_robot_explain_a_misfit() {
    for world in [TIDY, REPEATS] {
        let world = World { has_errors: true, ..world };
        let fits = world.fits_with(&[Model::SKID_ROLL], 12, |config| {
            declare(config);
            config.fit.bootstrap = 60;
        });
        let found = outcome(&fits);
        let coverage = found.held as f64 / found.intervals as f64;
        assert!(found.refused <= 1 && coverage > 0.85, "{world:?} {found:?}");
    }
}

#[test]
fn slow_trials_without_a_weight_of_the_skid_ratios_determine_no_coefficient() {
    let world = World { omegas_rad_s: &SLOW_RAD_S, ..TIDY };
    let (_, robot, _) = setup();
    let fits = world.fits_with(&[Model::SKID_ROLL], 10, |config| {
        config.fit.bootstrap = 60;
        config.campaign.values_mut().for_each(|campaign| campaign.weights.sigma = 0.0);
    });
    for fit in fits.iter().map(|fitted| &fitted.fits[0]) {
        for (wheel, truth) in robot.skid_kg_s.into_iter().enumerate() {
            let skid = Quantity::Skid.parameter(wheel);
            let [low, high] = [fit.lower[skid], fit.upper[skid]];
            println!(
                "{wheel} {truth} {} {low} {high} {:?}",
                fit.parameters[skid], fit.practically_not
            );
            let is_excluded = low > truth || high < truth;
            assert!(!is_excluded, "{fit:?}");
        }
    }
}

#[test]
fn limits_from_one_day_hold_for_that_day_unless_the_spread_of_days_is_configured() {
    let world = World { day_sd: 0.05, ..REPEATS };
    let mut coverage = [0.0; 2];
    for (day_sd, coverage) in [0.0, 0.05].into_iter().zip(&mut coverage) {
        let fits = world.fits_with(&[Model::SKID_ROLL], 10, |config| {
            config.fit.day_sd = day_sd;
            config.fit.bootstrap = 60;
            config.fit.profiles = false;
        });
        for fit in fits.iter().map(|fitted| &fitted.fits[0]) {
            assert_eq!(fit.single_day, day_sd == 0.0 && fit.no_interval.is_none(), "{fit:?}");
        }
        let found = outcome(&fits);
        *coverage = found.held as f64 / found.intervals as f64;
    }
    assert!(coverage[0] < 0.6 && coverage[1] > 0.8, "{coverage:?}");
}

/// Prints a table, too.
#[test]
#[ignore = "minutes: cargo test --release -p trilink-fit --test it worlds:: -- --ignored --nocapture"]
fn limits_hold_the_population_mean_in_nine_to_ten_of_ten_campaigns() {
    println!("| world | factors | kept | refused | undecided | coverage | width over known |");
    let six_days = World { days: 6, ..DAYS };
    let twelve = World { omegas_rad_s: &TWELVE_RAD_S, ..DAYS };
    for (name, world) in [
        ("one day, tidy", TIDY),
        ("six single trials, 0.3 %", World { trial_sd: 0.003, ..TIDY }),
        ("six single trials, 2 %", SINGLES),
        ("6 frequencies, 3 trials each, 2 %", REPEATS),
        ("3 days x 6", DAYS),
        ("3 days x 12", twelve),
        ("6 days x 6", six_days),
    ] {
        for world in both(&world) {
            let factors = if world.is_common { "common" } else { "independent" };
            let found = outcome(&world.fits(&[Model::SKID_ROLL], 60));
            let coverage = found.held as f64 / found.intervals as f64;
            println!(
                "| {name} | {factors} | {} | {} | {} | {coverage:.3} | {:.2} |",
                found.kept,
                found.refused,
                found.undecided,
                found.half_width / (HALF_WIDTH_95 * found.error)
            );
            assert!((0.9..=1.0).contains(&coverage), "{world:?} {found:?}");
            assert!(found.refused <= 4, "{world:?} {found:?}");
            for floor in &FLOORS[1..] {
                let world = World { floor: *floor, ..world.clone() };
                let found = outcome(&world.fits_with(&[Model::SKID_ROLL], 40, without_limits));
                let Outcome { kept, refused, undecided, .. } = found;
                println!("| {name}, {floor:?} | {factors} | {kept} | {refused} | {undecided} |");
                assert!(refused + undecided >= 36, "{world:?} {found:?}");
                let has_repeats = world.days * world.repeats > 1;
                assert!(refused >= 36 || !has_repeats, "{world:?} {found:?}");
            }
        }
    }
}
