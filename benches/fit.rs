//! Benchmark of one start of a fit of `skid-roll` to a campaign with twelve frequencies, with single and with repeated
//! trials, on one thread.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use trilink_fit::{FitInput, Measurement, Objective, search};
use trilink_robot::metrics::GaitMetrics;
use trilink_robot::{AnyGait, Laws, MAX_JOINTS, Model};
use trilink_tables::config::Config;

const DATA: [(&str, &str); 3] = [
    ("kinematic-symmetric", include_str!("../crates/fit/tests/fixtures/kinematic-symmetric.csv")),
    ("kinematic-skewed", include_str!("../crates/fit/tests/fixtures/kinematic-skewed.csv")),
    (
        "semi-passive-symmetric",
        include_str!("../crates/fit/tests/fixtures/semi-passive-symmetric.csv"),
    ),
];

fn measurements(data: &str) -> Vec<Measurement> {
    let row = |line: &str| {
        let number = |text: &str| text.parse().unwrap_or(f64::NAN);
        let fields: Vec<f64> = line.split(',').map(number).collect();
        let [d_m, v_m_s, sigma0, sigma1, sigma2, alpha1_deg] =
            std::array::from_fn(|i| fields[i + 1]);
        let alpha1_rad = f64::to_radians(alpha1_deg);
        let metrics =
            GaitMetrics::from_array([d_m, v_m_s, sigma0, sigma1, sigma2, alpha1_rad, 0.0]);
        let gait = Config::default().campaign_setup("kinematic-symmetric").expect("the paper's").1;
        Measurement {
            campaign: 0,
            trial: String::new(),
            day: String::new(),
            frequency_rad_s: fields[0],
            omega_rad_s: fields[0],
            cycles: 0,
            metrics,
            errors: GaitMetrics::NONE,
            gait: AnyGait::from(gait).joints.map(Option::unwrap_or_default),
            gait_errors_rad: [[0.0; 3]; MAX_JOINTS],
            lacks_debiased: false,
            is_filtered: false,
        }
    };
    data.lines().skip(1).map(row).collect()
}

/// Returns a hundred repeats of each measurement, each with all metrics scaled by a factor between 0.99 and 1.01.
fn repeated(once: &[Measurement]) -> Vec<Measurement> {
    let differing = |(number, trial): (usize, &Measurement)| {
        let factor = 1.0 + 0.02 * ((0.618 * number as f64).fract() - 0.5);
        let metrics = GaitMetrics::from_array(trial.metrics.to_array().map(|of| factor * of));
        Measurement { metrics, ..trial.clone() }
    };
    let trials = once.iter().flat_map(|trial| std::iter::repeat_n(trial, 100));
    trials.enumerate().map(differing).collect()
}

fn one_start(criterion: &mut Criterion) {
    let config = Config::default();
    for (campaign, data) in DATA {
        let (mut robot, gait) = config.campaign_setup(campaign).expect("the paper's campaign");
        (robot.stiffness_nm_rad, robot.damping_nm_s_rad) = (0.137, 0.006);
        let weights = config.campaign[campaign].weights;
        let gait_input = config.fit.gait_input;
        let objective = |measurements: Vec<Measurement>| {
            let robot = robot.clone();
            Objective::new(Laws::SKID_ROLL, robot, gait, weights, gait_input, measurements)
        };
        let once = measurements(data);
        let often = repeated(&measurements(data));
        let parameters =
            FitInput::new(&config, campaign, Model::SKID_ROLL).expect("a campaign").free();
        for (name, measurements) in [("one start", once), ("one start, many repeats", often)] {
            let objective = objective(measurements);
            criterion.bench_function(&format!("{name}, {campaign}"), |bencher| {
                bencher.iter(|| black_box(search(&objective, &parameters, 1)));
            });
        }
    }
}

criterion_group!(benches, one_start);
criterion_main!(benches);
