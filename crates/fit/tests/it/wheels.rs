//! Fits with one set of coefficients for robots that have wheels in common: a twistcar and a roller racer.

use std::path::Path;

use trilink_fit::fit;
use trilink_mechanics::{Laws, Model};
use trilink_robot::{Parameter, Quantity};
use trilink_tables::config::{
    Config, Free, GaitInput, LinkConfig, RobotConfig, Robots, SharedFits, SigmaKind,
};
use trilink_tables::{FitRow, NotTested, NotTestedReason, SharedFitRow, Sharing, TrialRow};

use crate::chains::trials;

const NOISE: f64 = 0.01;
const PAIR: [&str; 2] = ["twistcar", "racer"];
/// Coefficients of the front wheels, of the twistcar's rear wheel and of the seat's wheel, kg/s.
const SKID_KG_S: [f64; 3] = [50.0, 100.0, 130.0];

/// Returns a link of a robot: 0 is the first.
fn link<'c>(config: &'c mut Config, robot: &str, number: usize) -> &'c mut LinkConfig {
    &mut config.robot.get_mut(robot).unwrap().chain_mut().unwrap().links[number]
}

/// Returns the configuration of the twistcar and the roller racer of the gallery, which have a front wheel in common, and
/// of a second twistcar (`copy`) whose rear wheel is that of the racer's seat.
fn config(robots: &[&str]) -> Config {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/robots");
    let load = |file: &str| Config::load(&folder.join(file)).unwrap();
    let mut config = Config::load(&folder.join("twistcar.toml")).unwrap();
    let racer = load("roller-racer.toml");
    config.robot.extend(racer.robot);
    config.gait.extend(racer.gait);
    config.campaign.extend(racer.campaign);
    let twistcar = config.robot["twistcar"].clone();
    config.robot.insert("copy".to_owned(), twistcar);
    let mut campaign = config.campaign["twistcar"].clone();
    campaign.robot = "copy".to_owned();
    config.campaign.insert("copy".to_owned(), campaign);
    config.campaign.retain(|name, _| robots.contains(&name.as_str()));
    for campaign in config.campaign.values_mut() {
        campaign.models = vec![Model::SKID_ROLL];
    }
    for (robot, number, wheel) in
        [("twistcar", 0, "front"), ("racer", 0, "front"), ("racer", 1, "seat"), ("copy", 1, "seat")]
    {
        let link = link(&mut config, robot, number);
        link.wheel = Some(wheel.to_owned());
        if wheel == "seat" {
            link.skid_kg_s = Some(SKID_KG_S[2]);
        }
    }
    (config.fit.starts, config.fit.bootstrap, config.fit.profiles) = (2, 0, false);
    (config.fit.sigma, config.fit.gait_input) = (SigmaKind::Raw, GaitInput::Commanded);
    let robots = robots.iter().map(|robot| robot.to_string()).collect();
    config.fit.shared = Some(SharedFits { robot: Robots(robots) });
    config
}

fn set_free(config: &mut Config, model: Model, free: &[&str]) {
    let free = toml::Value::from(free.to_vec()).try_into::<Free>().unwrap();
    for campaign in config.campaign.values_mut() {
        campaign.free.insert(model, free.clone());
    }
}

/// Returns trials of all campaigns with the configured coefficients.
fn all_trials(config: &Config, laws: Laws, noise: f64) -> Vec<TrialRow> {
    let campaigns = config.campaign.keys().zip(7..);
    campaigns.flat_map(|(campaign, seed)| trials(config, campaign, laws, noise, seed)).collect()
}

/// Returns the rows of the shared fits with a configuration that starts from other coefficients than those of the trials.
fn shared(config: &Config, trials: Vec<TrialRow>) -> Vec<SharedFitRow> {
    let mut config = config.clone();
    let chains = config.robot.values_mut().filter_map(RobotConfig::chain_mut);
    for link in chains.flat_map(|chain| &mut chain.links) {
        link.skid_kg_s = link.skid_kg_s.map(|skid| 1.3 * skid);
    }
    fit(&config, &trials.into(), &|_| {}).shared
}

fn check(row: &FitRow, expected: &[(Parameter, f64)], tolerance: f64) {
    assert!(row.status.is_ok(), "{}", row.failure);
    assert_eq!(row.free, expected.iter().map(|(parameter, _)| *parameter).collect::<Vec<_>>());
    for (parameter, planted) in expected {
        let found = row.parameters[*parameter];
        let error = (found / planted - 1.0).abs();
        assert!(error < tolerance, "{parameter} = {found}, not {planted}");
    }
}

fn skid<const N: usize>(planted: [f64; N]) -> [(Parameter, f64); N] {
    std::array::from_fn(|wheel| (Quantity::Skid.parameter(wheel), planted[wheel]))
}

#[test]
fn robots_with_a_common_wheel_are_fitted_together() {
    let config = config(&PAIR);
    let rows = shared(&config, all_trials(&config, Laws::SKID_ROLL, 0.0));
    let [row] = &rows[..] else { panic!("{rows:?}") };
    assert_eq!(row.robot, "twistcar and racer");
    assert_eq!(row.campaigns, ["racer", "twistcar"]);
    assert_eq!(row.wheels, ["twistcar front = racer handlebar", "twistcar rear", "racer seat"]);
    assert_eq!(row.joints, ["twistcar joint 1"]);
    check(&row.fit, &skid(SKID_KG_S), 1e-3);
    assert!(row.fit.j < 1e-5, "{}", row.fit.j);
    assert_eq!(row.not_tested, Some(NotTestedReason::NothingLeft.into()));
}

#[test]
fn sharing_is_kept_for_equal_wheels_and_refused_for_different_ones() {
    let config = config(&PAIR);
    for (racer_kg_s, expected) in [(50.0, Sharing::Kept), (80.0, Sharing::Refused)] {
        let mut truth = config.clone();
        link(&mut truth, "racer", 0).skid_kg_s = Some(racer_kg_s);
        let data = all_trials(&truth, Laws::SKID_ROLL, NOISE).into();
        let fitted = fit(&config, &data, &|_| {});
        let row = &fitted.shared[0];
        assert_eq!(row.fit.sharing, Some(expected), "{row:?}");
        assert_eq!(row.p_value < 0.05, expected == Sharing::Refused, "{row:?}");
        assert!(fitted.fits.iter().all(|fit| fit.sharing == Some(expected)));
        if expected == Sharing::Kept {
            check(&row.fit, &skid(SKID_KG_S), 0.1);
        }
    }
}

#[test]
fn three_robots_in_a_row_are_one_group() {
    let config = config(&["copy", "racer", "twistcar"]);
    let rows = shared(&config, all_trials(&config, Laws::SKID_ROLL, 0.0));
    let [row] = &rows[..] else { panic!("{rows:?}") };
    assert_eq!(row.robot, "copy and racer and twistcar");
    let wheels = [
        "copy front",
        "copy rear = racer seat",
        "racer handlebar = twistcar front",
        "twistcar rear",
    ];
    assert_eq!(row.wheels, wheels);
    let [front, rear, seat] = SKID_KG_S;
    check(&row.fit, &skid([front, seat, front, rear]), 1e-3);
}

#[test]
fn wheels_under_different_loads_share_coefficients_of_friction() {
    let mut config = config(&PAIR);
    let coulomb = Model::new("coulomb");
    for campaign in config.campaign.values_mut() {
        campaign.models = vec![coulomb];
    }
    for (robot, loads_n) in PAIR.into_iter().zip([[3.0, 10.0], [6.0, 12.0]]) {
        config.robot.get_mut(robot).unwrap().chain_mut().unwrap().transition_m_s = Some(0.02);
        for (number, load_n) in loads_n.into_iter().enumerate() {
            let link = link(&mut config, robot, number);
            (link.load_n, link.skid_dry_n) = (Some(load_n), Some(0.3));
        }
    }
    set_free(&mut config, coulomb, &["skid_dry"]);
    let trials = all_trials(&config, Laws::COULOMB, 0.0);
    let row = &shared(&config, trials)[0];
    let forces_n = [3.0, 10.0, 12.0].map(|load_n| 0.3 * load_n);
    let expected: [_; 3] =
        std::array::from_fn(|wheel| (Quantity::SkidDry.parameter(wheel), forces_n[wheel]));
    check(&row.fit, &expected, 1e-3);
    assert!(row.fit.j < 1e-4, "{}", row.fit.j);
}

#[test]
fn joints_of_later_robots_have_numbers_after_those_of_the_first() {
    let mut config = config(&["twistcar"]);
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/robots");
    let rotor_car = Config::load(&folder.join("rotor-car.toml")).unwrap();
    config.robot.extend(rotor_car.robot);
    config.gait.extend(rotor_car.gait);
    config.campaign.extend(rotor_car.campaign);
    let campaign = config.campaign.get_mut("rotor-car").unwrap();
    campaign.models = vec![Model::SKID_ROLL];
    link(&mut config, "rotor-car", 0).wheel = Some("front".to_owned());
    let robots = ["twistcar", "rotor-car"].map(str::to_owned);
    config.fit.shared = Some(SharedFits { robot: Robots(robots.into()) });
    set_free(&mut config, Model::SKID_ROLL, &["skid0", "stiffness1"]);
    let row = &shared(&config, all_trials(&config, Laws::SKID_ROLL, 0.0))[0];
    assert_eq!(row.joints, ["twistcar joint 1", "rotor-car joint 1"]);
    let stiffness = Quantity::Stiffness.parameter(2);
    assert_eq!(row.part(stiffness), Some("rotor-car joint 1"));
    check(&row.fit, &[(Quantity::Skid.parameter(0), 50.0), (stiffness, 0.1)], 1e-3);
}

#[test]
fn an_uncertain_number_of_one_robot_widens_the_intervals() {
    let mut config = config(&PAIR);
    config.fit.bootstrap = 20;
    let data = all_trials(&config, Laws::SKID_ROLL, NOISE);
    let systematic = |config: &Config| {
        let row = fit(config, &data.clone().into(), &|_| {}).shared.remove(0).fit;
        Quantity::Skid.of_each().map(|skid| row.systematic[skid])
    };
    let exact = systematic(&config);
    let sd = toml::from_str("mass_kg = \"5 %\"").unwrap();
    link(&mut config, "racer", 1).standard_deviation = sd;
    let uncertain = systematic(&config);
    // The seat's wheel is the last.
    assert!(uncertain[2] > exact[2] + 1.0, "{exact:?} {uncertain:?}");
    assert!((uncertain[1] - exact[1]).abs() < 0.5 * (uncertain[2] - exact[2]), "{uncertain:?}");
}

#[test]
fn a_sum_over_wheels_is_fitted_only_if_the_robots_have_the_same_ones() {
    let mut config = config(&["copy", "twistcar"]);
    link(&mut config, "copy", 0).wheel = Some("front".to_owned());
    set_free(&mut config, Model::SKID_ROLL, &["skid0", "roll"]);
    let trials = all_trials(&config, Laws::SKID_ROLL, 0.0);
    let row = &shared(&config, trials.clone())[0];
    assert_eq!(row.not_tested, Some(NotTested::new(NotTestedReason::SumOfWheels, "roll")));
    assert!(row.fit.failure.contains("list the coefficients of the wheels (roll0"), "{row:?}");
    for robot in ["copy", "twistcar"] {
        let link = link(&mut config, robot, 1);
        (link.wheel, link.skid_kg_s) = (Some("rear".to_owned()), Some(100.0));
    }
    let trials = all_trials(&config, Laws::SKID_ROLL, 0.0);
    let row = &shared(&config, trials)[0];
    check(&row.fit, &[(Quantity::Skid.parameter(0), 50.0), (Quantity::Roll.sum(), 0.9)], 1e-3);
}

#[test]
fn a_name_that_no_other_robot_uses_connects_none() {
    let mut config = config(&PAIR);
    link(&mut config, "twistcar", 0).wheel = Some("another".to_owned());
    assert!(shared(&config, all_trials(&config, Laws::SKID_ROLL, 0.0)).is_empty());
}
