use trilink_mechanics::REFERENCE_ACCURACY;
use trilink_robot::{Model, Parameter, Quantity as RobotQuantity, RollLaw, SkidLaw};
use trilink_tables::config::{Config, ModelConfig, RobotConfig};
use trilink_tables::{Columns as _, SENSITIVE_METRICS};

use super::super::Setup;
use super::*;

/// Returns the dimension of a quantity or metric as exponents of length, mass and time.
fn dimensions(name: &str) -> [f64; 3] {
    let numbers: Vec<_> = name.split(|c: char| c.is_ascii_digit()).collect();
    let name = numbers.join("");
    match name.as_str() {
        "h_m" | "l_m" | "b_m" | "d_m" => [1.0, 0.0, 0.0],
        "v_m_s" | "transition_m_s" | "stribeck_m_s" => [1.0, 0.0, -1.0],
        "mass_kg" => [0.0, 1.0, 0.0],
        "inertia_kg_m" => [2.0, 1.0, 0.0],
        "skid_kg_s" | "roll_kg_s" => [0.0, 1.0, -1.0],
        "skid_dry_n" | "skid_static_n" | "roll_dry_n" => [1.0, 1.0, -2.0],
        "stiffness_nm_rad" | "work_j" => [2.0, 1.0, -2.0],
        "damping_nm_s_rad" => [2.0, 1.0, -1.0],
        "omega_rad_s" => [0.0, 0.0, -1.0],
        _ => [0.0; 3],
    }
}

fn setup(campaign: &str, model: &str, settings: &[&str]) -> Setup {
    let settings: Vec<String> = settings.iter().map(|of| (*of).to_owned()).collect();
    Setup::new(Config::default(), campaign, model, &settings, None).expect("the paper's")
}

/// Returns the motion of a setup from which its sensitivities are computed.
fn motion(setup: &Setup, omega_rad_s: f64) -> Motion {
    Motion {
        problem: setup.problem(omega_rad_s),
        model: setup.model,
        metrics: SENSITIVE_METRICS.map(str::to_owned).to_vec(),
        extrapolation: Extrapolation::blank(),
    }
}

const CASES: [(&str, &str, &[&str]); 5] = [
    ("kinematic-skewed", "skid-roll", &[]),
    ("kinematic-symmetric", "coulomb-viscous", &[]),
    ("kinematic-skewed", "no-skid", &[]),
    ("semi-passive-symmetric", "no-skid-roll", &["rest_angle_deg=2"]),
    ("semi-passive-symmetric", "skid-roll", &[]),
];

#[test]
fn elasticities_add_up_to_the_dimensions_of_their_metrics() {
    for (campaign, model, settings) in CASES {
        let motion = motion(&setup(campaign, model, settings), 3.9);
        let rows = motion.sensitivities(false, &InputUncertainty::default()).expect("a motion");
        for metric in SENSITIVE_METRICS {
            let of_metric = || rows.iter().filter(|row| row.metric == metric);
            if of_metric().any(|row| row.metric_value.abs() < EPSILON) {
                continue;
            }
            let known = dimensions(metric);
            for (base, known) in known.into_iter().enumerate() {
                // For base 1 (mass) the sum extends over masses, moments of inertia and all coefficients.
                let terms = of_metric()
                    .map(|row| (dimensions(&row.parameter)[base], row.elasticity))
                    .filter(|(power, _)| *power != 0.0)
                    .map(|(power, elasticity)| power * elasticity);
                let sum: f64 = terms.sum();
                assert!((sum - known).abs() < 1e-6, "{campaign} {model} {metric} {base}: {sum}");
            }
        }
    }
}

#[test]
fn derivatives_equal_independent_finite_differences() {
    for (campaign, model, settings) in [CASES[0], CASES[1], CASES[3]] {
        let motion = motion(&setup(campaign, model, settings), 3.9);
        let rows = motion.sensitivities(false, &InputUncertainty::default()).expect("a motion");
        let problem = &motion.problem;
        let mut solver = Solver::default();
        let mut metrics_at = |quantity: Quantity, value: f64| {
            let mut problem = problem.clone();
            quantity.set(&mut problem, value);
            let metrics = solver.solve(&problem, REFERENCE_ACCURACY).expect("a motion nearby");
            let [work_j, _] = solver.work_and_loss_j().expect("it is solved for");
            motion.values(&metrics, work_j)
        };
        for quantity in Quantity::all(problem) {
            let value = quantity.value(problem);
            // Fourth-order differences.
            let step = 2e-3 * if value == 0.0 { 1.0 } else { value.abs() };
            let [far, near, back, behind] =
                [2.0, 1.0, -1.0, -2.0].map(|steps| metrics_at(quantity, value + steps * step));
            let own = rows.iter().filter(|row| row.parameter == quantity.name(&problem.robot));
            for (metric, row) in own.enumerate() {
                let known = 8.0 * (near[metric] - back[metric]) - (far[metric] - behind[metric]);
                let known = known / (12.0 * step * quantity.scale());
                // Scale for errors of the derivative: an elasticity of 0.1.
                let by = if value == 0.0 { 1.0 } else { row.parameter_value };
                let size = 0.1 * (row.metric_value / by).abs();
                let error = (row.derivative - known).abs();
                let scale = known.abs().max(size);
                assert!(error <= 1e-5 * scale, "{campaign} {model} {row:?} {known}");
            }
        }
    }
}

#[test]
fn errors_of_values_measured_with_one_instrument_are_added_and_others_are_combined_in_quadrature() {
    let rows = |same: bool| {
        let mut config = Config::default();
        let robot = config
            .robot
            .get_mut("kinematic")
            .and_then(RobotConfig::three_links_mut)
            .expect("the paper's");
        robot.set_deviation(RobotQuantity::H, [0.0005]);
        robot.set_deviation(RobotQuantity::L, [0.0005]);
        robot.set_deviation(RobotQuantity::B, [0.001]);
        if same {
            robot.set_same(RobotQuantity::H, "ruler");
            robot.set_same(RobotQuantity::L, "ruler");
        }
        let robot = config.robot["kinematic"].three_links().expect("the paper's").clone();
        let setup =
            Setup::new(config, "kinematic-symmetric", "skid-roll", &[], None).expect("the paper's");
        let uncertainty = InputUncertainty::configured(&robot, setup.laws, &setup.gait.into());
        motion(&setup, 4.0).sensitivities(false, &uncertainty).expect("a motion")
    };
    let [independent, shared] = [rows(false), rows(true)];
    for metric in ["d_m", "sigma0", "work_j"] {
        let of = |rows: &[SensitivityRow], name: &str| {
            let mut rows = rows.iter().filter(|row| row.metric == metric);
            rows.find(|row| row.parameter == name).expect("a row").clone()
        };
        let changes = [("h_m", 5e-4), ("l_m", 5e-4), ("b_m", 1e-3)]
            .map(|(name, sd)| of(&independent, name).derivative * sd);
        let [h, l, b] = changes;
        let in_quadrature = h.hypot(l).hypot(b);
        let together = (h + l).hypot(b);
        let found = of(&independent, "h_m").metric_deviation;
        assert!((found / in_quadrature - 1.0).abs() < 1e-9, "{metric}: {found} {in_quadrature}");
        let h_row = of(&shared, "h_m");
        let found = h_row.metric_deviation;
        assert!((found / together - 1.0).abs() < 1e-9, "{metric}: {found} {together}");
        assert!((found / in_quadrature - 1.0).abs() > 1e-4, "{metric}: {found} {in_quadrature}");
        // Both show the common error, and an equal part of its variance.
        assert_eq!(h_row.standard_deviation, 5e-4);
        let l_row = of(&shared, "l_m");
        assert_eq!(
            [h_row.contribution, h_row.variance_part],
            [l_row.contribution, l_row.variance_part]
        );
        assert!((h_row.contribution / (h + l).abs() - 1.0).abs() < 1e-9);
        let parts = h_row.variance_part + l_row.variance_part + of(&shared, "b_m").variance_part;
        assert!((parts - 1.0).abs() < 1e-9, "{parts}");
    }
}

#[test]
fn a_setting_changes_the_quantity_of_the_same_name() {
    let mut config = Config::default();
    let robot = config
        .robot
        .get_mut("kinematic")
        .and_then(RobotConfig::three_links_mut)
        .expect("the paper's");
    robot.set_load_n([8.0, 3.0, 7.0]);
    for robot in config.robot.values_mut().filter_map(RobotConfig::three_links_mut) {
        robot.set(RobotQuantity::SkidStatic, [0.3, 0.2, 0.1]);
        robot.set(RobotQuantity::Stribeck, [0.02]);
        robot.set(RobotQuantity::RollDry, [0.01, 0.02, 0.03]);
    }
    let gait = config.gait.get_mut("skewed").expect("the paper's");
    let joint = gait.joint2.as_mut().expect("commanded");
    joint.amplitude2_deg = Some(5.0);
    joint.phase2_deg = Some(20.0);
    let ours = ModelConfig {
        skid: SkidLaw::StribeckViscous,
        roll: RollLaw::CoulombViscous,
        input: None,
        free: None,
    };
    config.model.insert(Model::new("ours"), ours);
    let models = config.model.iter().filter(|(_, of)| !of.is_of_trials());
    let models: Vec<String> = models.map(|(name, _)| name.name().to_owned()).collect();
    let mut names = std::collections::BTreeSet::new();
    for (campaign, model) in
        config.campaign.keys().flat_map(|of| models.iter().map(move |model| (of, model)))
    {
        let with = |settings: &[String]| {
            Setup::new(config.clone(), campaign, model, settings, None).expect(campaign)
        };
        let problem = with(&[]).problem(3.0);
        let sums = Parameter::ALL.into_iter().filter(|of| of.is_sum()).map(Quantity::Robot);
        let all = Quantity::all(&problem).into_iter().chain(sums);
        for quantity in all.filter(|of| *of != Quantity::Omega) {
            let name = quantity.name(&problem.robot);
            let value = quantity.value(&problem) * quantity.scale();
            // Setting the current value changes nothing; setting a scaled value scales only this quantity.
            for factor in [1.0, 1.01] {
                let set = with(&[format!("{name}={}", factor * value)]).problem(3.0);
                for of in Quantity::all(&problem) {
                    let known = of.value(&problem);
                    let known = if of == quantity { factor * known } else { known };
                    let is_part = matches!((of, quantity),
                        (Quantity::Robot(one), Quantity::Robot(all))
                            if one != all && one.is_part_of(all));
                    let known = if is_part { factor * known } else { known };
                    let error = (of.value(&set) - known).abs();
                    assert!(error <= 1e-12 * known.abs(), "{campaign} {model} {name}: {of:?}");
                }
            }
            names.insert(name);
        }
    }
    assert!(names.len() > 35, "{names:?}");
}
