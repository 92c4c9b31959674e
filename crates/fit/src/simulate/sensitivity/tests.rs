use trilink_mechanics::{REFERENCE_ACCURACY, Solver};
use trilink_robot::{Model, Parameter, Quantity as OfRobot, RollLaw, SkidLaw};
use trilink_tables::config::{Config, ModelConfig};

use super::*;

/// Dimensions of a quantity or a metric: powers of length, mass and time.
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
    Setup::new(Config::default(), campaign, model, &settings).expect("the paper's")
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
        let setup = setup(campaign, model, settings);
        let rows = of(&setup, 3.9, false, &Uncertain::default()).expect("a motion");
        for metric in SENSITIVE_METRICS {
            let of_metric = || rows.iter().filter(|row| row.metric == metric);
            if of_metric().any(|row| row.metric_value.abs() < NOTHING) {
                continue;
            }
            let known = dimensions(metric);
            for (base, known) in known.into_iter().enumerate() {
                // Masses, moments of inertia and coefficients of all kinds: of base 1.
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
fn derivatives_are_those_of_independent_differences() {
    for (campaign, model, settings) in [CASES[0], CASES[1], CASES[3]] {
        let setup = setup(campaign, model, settings);
        let rows = of(&setup, 3.9, false, &Uncertain::default()).expect("a motion");
        let problem = setup.problem(3.9);
        let mut solver = Solver::default();
        let mut at = |quantity: Quantity, value: f64| {
            let mut problem = problem.clone();
            quantity.set(&mut problem, value);
            let metrics = solver.solve(&problem, REFERENCE_ACCURACY).expect("a motion nearby");
            let [work_j, _] = solver.work_and_loss_j().expect("it is solved for");
            derivative::by_metric(&metrics, work_j)
        };
        for quantity in Quantity::all(&problem) {
            let value = quantity.of(&problem);
            // Of fourth order, over another step than the derivatives' own.
            let step = 2e-3 * if value == 0.0 { 1.0 } else { value.abs() };
            let [far, near, back, behind] =
                [2.0, 1.0, -1.0, -2.0].map(|steps| at(quantity, value + steps * step));
            let own = rows.iter().filter(|row| row.parameter == quantity.name());
            for (metric, row) in own.enumerate() {
                let known = 8.0 * (near[metric] - back[metric]) - (far[metric] - behind[metric]);
                let known = known / (12.0 * step * quantity.scale());
                // What a tenth of the parameter's relative change would make of the metric.
                let by = if value == 0.0 { 1.0 } else { row.parameter_value };
                let size = 0.1 * (row.metric_value / by).abs();
                let (miss, least) = ((row.derivative - known).abs(), known.abs().max(size));
                assert!(miss <= 1e-5 * least, "{campaign} {model} {row:?} {known}");
                if row.derivative_error.is_finite() {
                    assert!(row.derivative_error <= 1e-5 * least, "{row:?}");
                }
            }
        }
    }
}

#[test]
fn every_number_is_what_a_setting_of_its_name_gives() {
    let mut config = Config::default();
    let robot = config.robot.get_mut("kinematic").expect("the paper's");
    robot.set_load_n([8.0, 3.0, 7.0]);
    for robot in config.robot.values_mut() {
        robot.set(OfRobot::SkidStatic, [0.3, 0.2, 0.1]);
        robot.set(OfRobot::Stribeck, [0.02]);
        robot.set(OfRobot::RollDry, [0.01, 0.02, 0.03]);
    }
    let gait = config.gait.get_mut("skewed").expect("the paper's");
    let joint = gait.joint2.as_mut().expect("commanded");
    (joint.amplitude2_deg, joint.phase2_deg) = (Some(5.0), Some(20.0));
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
            Setup::new(config.clone(), campaign, model, settings).expect(campaign)
        };
        let problem = with(&[]).problem(3.0);
        let sums = Parameter::ALL.into_iter().filter(|of| of.is_sum()).map(Quantity::Robot);
        let all = Quantity::all(&problem).into_iter().chain(sums);
        for quantity in all.filter(|of| *of != Quantity::Omega) {
            let (name, value) = (quantity.name(), quantity.of(&problem) * quantity.scale());
            // As it is printed it changes nothing, and more of it is more of it.
            for part in [1.0, 1.01] {
                let set = with(&[format!("{name}={}", part * value)]).problem(3.0);
                for of in Quantity::all(&problem) {
                    let known = of.of(&problem);
                    let known = if of == quantity { part * known } else { known };
                    let is_part = matches!((of, quantity),
                        (Quantity::Robot(one), Quantity::Robot(all))
                            if one != all && one.is_part_of(all));
                    let known = if is_part { part * known } else { known };
                    let miss = (of.of(&set) - known).abs();
                    assert!(miss <= 1e-12 * known.abs(), "{campaign} {model} {name}: {of:?}");
                }
            }
            names.insert(name);
        }
    }
    assert!(names.len() > 35, "{names:?}");
}
