//! Accuracy of smoothed skid velocities, compared with the motion that was recorded.

use rayon::prelude::*;
use trilink_mechanics::{Problem, REFERENCE_ACCURACY, Solver};
use trilink_robot::{Model, Pose, in_world};
use trilink_tables::config::Smoothing;

use super::*;
use crate::geometry::Geometry;

const RATE_HZ: f64 = 120.0;
/// Factor by which the true motion is sampled more finely than the recording.
const FINE: usize = 8;

/// True motion of a trial.
struct Truth {
    campaign: &'static str,
    omega_rad_s: f64,
    robot: Robot,
    /// x, y, theta, phi1 and phi2 in every frame, m and rad.
    coordinates: Vec<[f64; 5]>,
    /// Skid velocities in every frame.
    skid_m_s: [Vec<f64>; 3],
    /// Skid ratios of the steady state.
    sigma: [f64; 3],
}

impl Truth {
    /// Simulates a trial from rest, with nine cycles in the steady state.
    fn new(campaign: &'static str, model: &str, omega_rad_s: f64) -> Self {
        let config = Config::default();
        let (robot, gait) = config.campaign_setup(campaign).unwrap();
        let laws = config.model[&Model::new(model)].laws();
        let problem = Problem::new(robot.clone(), gait, laws, omega_rad_s);
        let steady = Solver::default().settle(&problem, REFERENCE_ACCURACY).unwrap().motion;
        let decay = steady.floquet.unwrap_or(0.0).clamp(1e-12, 0.99);
        let transient = (3e-4_f64.ln() / decay.ln()).ceil().max(2.0);
        let duration_s = (transient + 9.5) * std::f64::consts::TAU / omega_rad_s;
        let fine_hz = RATE_HZ * FINE as f64;
        let fine = problem.varied_transient(&[], duration_s, fine_hz, 1e-8).unwrap();
        let fine: Vec<[f64; 5]> = fine.iter().map(coordinates).collect();
        let series = |i: usize| fine.iter().map(|q| q[i]).collect::<Vec<f64>>();
        let all = Coordinates {
            x_m: series(0),
            y_m: series(1),
            theta_rad: series(2),
            phi_rad: [series(3), series(4)].into(),
        };
        let skid_m_s = wheel_velocities(&Geometry::of_robot(&robot), &all, fine_hz).skid_m_s;
        Self {
            campaign,
            omega_rad_s,
            robot,
            coordinates: fine.into_iter().step_by(FINE).collect(),
            skid_m_s: skid_m_s
                .into_array_or(Vec::new())
                .map(|skid_m_s| skid_m_s.into_iter().step_by(FINE).collect()),
            sigma: [0, 1, 2].map(|wheel| steady.metrics.sigma[wheel]),
        }
    }
}

/// Records the markers with white noise, without tilt, vibration or occlusions.
fn recording(truth: &Truth, config: &Config, noise_mm: f64) -> trilink_mocap::Recording {
    let mut random = ChaCha8Rng::seed_from_u64(7);
    let layout = config.marker_layout(&config.campaign[truth.campaign].robot).unwrap();
    let markers: Vec<(usize, &String, [f64; 3])> = layout
        .links()
        .into_iter()
        .enumerate()
        .flat_map(|(link, markers)| markers.iter().map(move |(label, at)| (link, label, *at)))
        .collect();
    let mut positions_mm = Vec::new();
    for [x_m, y_m, theta_rad, phi_rad @ ..] in &truth.coordinates {
        let links =
            truth.robot.link_poses(Pose { x_m: *x_m, y_m: *y_m, theta_rad: *theta_rad }, *phi_rad);
        for (link, _, [x, y, z]) in &markers {
            let Pose { x_m, y_m, theta_rad } = links[*link];
            let [x, y] = in_world([1e3 * x_m, 1e3 * y_m], theta_rad, [*x, *y]);
            let mut noise = || {
                let z: f64 = StandardNormal.sample(&mut random);
                noise_mm * z
            };
            positions_mm.push([x + noise(), y + noise(), z + noise()]);
        }
    }
    let labels = markers.iter().map(|(_, label, _)| (*label).clone()).collect();
    let frames = (1..).take(truth.coordinates.len()).collect();
    trilink_mocap::Recording::new(Some(RATE_HZ), frames, labels, positions_mm)
}

/// Errors of one smoothing of a trial.
struct Errors {
    /// RMS error of the skid velocities over the used cycles, m/s.
    rms_m_s: f64,
    /// Largest error of a raw skid ratio.
    sigma: f64,
    /// Fraction of the skid velocities whose 95 % interval contains the true one.
    within: f64,
}

/// Returns the errors of a smoothing if the markers are recorded with white noise, or else by the cameras of synthetic
/// trials, with tilt, vibration and occlusions.
fn errors(truth: &Truth, noise_mm: Option<f64>, smoothing: Smoothing) -> Errors {
    let mut config = Config::default();
    config.ingest.smoothing = smoothing;
    // Noise of 1 mm is beyond the default.
    config.ingest.max_residual_mm = 2.0;
    let trial = gait_trial("a", truth.campaign, truth.omega_rad_s);
    let input = IngestInput::new(&config, &trial).unwrap();
    let file = match noise_mm {
        Some(noise_mm) => recording(truth, &config, noise_mm),
        None => {
            let bytes = trilink_synth::export(&config, &truth.robot, &truth.coordinates, 7);
            trilink_mocap::parse_markers(Path::new("a.csv"), &bytes, config.vicon.unit).unwrap()
        }
    };
    let processed =
        process_recording(file, &trial, &input, &mut PartialResult::new(&trial)).unwrap();
    let wheels = WheelFrames::from_table(&processed.wheels).unwrap();
    let period_s = std::f64::consts::TAU / processed.row.omega_rad_s;
    let (mut squares, mut count, mut within) = (0.0, 0.0, 0.0);
    for cycle in processed.cycles.iter().filter(|cycle| cycle.used) {
        let first = (cycle.start_s * RATE_HZ).ceil() as usize;
        let last = ((cycle.start_s + period_s) * RATE_HZ).floor() as usize;
        for i in first..=last.min(truth.coordinates.len() - 1) {
            for wheel in 0..3 {
                let found = wheels.velocities.skid_m_s[wheel][i];
                let error = found - truth.skid_m_s[wheel][i];
                squares += error * error;
                count += 1.0;
                if let Some(errors) = &wheels.errors {
                    let is_within = error.abs() < 1.96 * errors.skid_m_s[wheel][i];
                    within += f64::from(u8::from(is_within));
                }
            }
        }
    }
    let sigma = (0..3).map(|wheel| (processed.row.metrics.sigma[wheel] - truth.sigma[wheel]).abs());
    Errors {
        rms_m_s: (squares / count).sqrt(),
        sigma: sigma.fold(0.0, f64::max),
        within: within / count,
    }
}

/// Returns the errors of the moving average and of the Kalman smoother.
fn both(truth: &Truth, noise_mm: Option<f64>) -> [Errors; 2] {
    [Smoothing::MovingAverage, Smoothing::Kalman].map(|method| errors(truth, noise_mm, method))
}

#[test]
fn the_kalman_smoother_is_nearer_to_the_truth_under_dry_friction() {
    let truth = Truth::new("kinematic-symmetric", "coulomb", 3.9);
    for noise_mm in [Some(0.2), None] {
        let [average, kalman] = both(&truth, noise_mm);
        assert!(kalman.rms_m_s < average.rms_m_s / 1.3, "{}", kalman.rms_m_s / average.rms_m_s);
        assert!(kalman.sigma < average.sigma, "{} {}", kalman.sigma, average.sigma);
        let within = kalman.within;
        assert!(noise_mm.is_none() || (0.85..0.995).contains(&within), "{within}");
    }
}

#[test]
#[ignore = "72 trials with two smoothings: minutes; prints the table of docs/smoothing.md"]
fn the_kalman_smoother_is_nearer_to_the_truth_in_every_condition() {
    const NOISE_MM: [Option<f64>; 4] = [Some(0.1), Some(0.2), Some(1.0), None];
    let mut cases = Vec::new();
    for campaign in ["kinematic-skewed", "kinematic-symmetric", "semi-passive-symmetric"] {
        for model in ["skid-roll", "coulomb"] {
            cases.extend([1.5, 3.9, 5.2].map(|omega_rad_s| (campaign, model, omega_rad_s)));
        }
    }
    let found: Vec<_> = cases
        .par_iter()
        .map(|&(campaign, model, omega_rad_s)| {
            let truth = Truth::new(campaign, model, omega_rad_s);
            NOISE_MM.map(|noise_mm| both(&truth, noise_mm))
        })
        .collect();
    let mut gains = Vec::new();
    for ((campaign, model, omega_rad_s), conditions) in cases.iter().zip(&found) {
        print!("| {campaign} | {model} | {omega_rad_s} |");
        for [average, kalman] in conditions {
            let gain = average.rms_m_s / kalman.rms_m_s;
            let [rms, kalman_rms] = [average, kalman].map(|errors| 1e3 * errors.rms_m_s);
            print!(" {rms:.2} / {kalman_rms:.2} = {gain:.1} |");
        }
        let with_noise = conditions[..3].iter();
        gains.extend(with_noise.map(|[average, kalman]| average.rms_m_s / kalman.rms_m_s));
        let percent = conditions.each_ref().map(|[_, kalman]| 100.0 * kalman.within);
        println!(" {} |", percent.map(|percent| format!("{percent:.0}")).join(", "));
        for [average, kalman] in conditions {
            let is_nearer = kalman.sigma < average.sigma && kalman.rms_m_s < average.rms_m_s;
            assert!(is_nearer, "{campaign} {model} {omega_rad_s}");
        }
    }
    gains.sort_by(f64::total_cmp);
    let median = trilink_statistics::median(gains.clone());
    println!("lowest {:.2}, median {median:.2}, highest {:.2}", gains[0], gains[gains.len() - 1]);
    assert!(gains[0] >= 1.3 && median >= 3.0);
}

#[test]
fn the_kalman_smoother_leaves_out_the_same_frames_and_states_errors_in_all_others() {
    let (recording, trial) = symmetric(3.9);
    let text = with_rows(&recording.export(), |rows| drop(rows.drain(900..930)));
    let mut config = Config::default();
    let average = process_with(&text, &trial, &config).unwrap();
    config.ingest.smoothing = Smoothing::Kalman;
    let kalman = process_with(&text, &trial, &config).unwrap();
    assert_eq!((kalman.row.cycles, kalman.row.smoothing_window), (average.row.cycles, 0));
    assert!(kalman.row.smoothing_left1.is_nan());
    assert!(relative_error(kalman.row.metrics.d_m, average.row.metrics.d_m) < 1e-3);
    let [average, kalman] =
        [average, kalman].map(|trial| WheelFrames::from_table(&trial.wheels).unwrap());
    let errors = kalman.errors.unwrap();
    let mut missing = 0;
    for wheel in 0..3 {
        let velocities = [&kalman.velocities.roll_m_s, &kalman.velocities.skid_m_s];
        for (found, errors) in velocities.iter().zip([&errors.roll_m_s, &errors.skid_m_s]) {
            for (i, (velocity, error)) in found[wheel].iter().zip(&errors[wheel]).enumerate() {
                let is_missing = velocity.is_nan() && error.is_nan();
                assert!(is_missing || velocity.is_finite() && *error > 0.0, "{wheel} {i}");
                assert!(average.velocities.roll_m_s[wheel][i].is_nan() || !velocity.is_nan());
                missing += usize::from(velocity.is_nan());
            }
        }
    }
    assert!(missing >= 6 * 30, "{missing}");
}

#[test]
fn a_coast_down_gives_the_same_roll_resistance_with_either_smoothing() {
    let mut config = Config::default();
    config.campaign.retain(|name, _| name == "kinematic-symmetric");
    let folder = tempfile::tempdir().unwrap();
    let recipe = Recipe { omegas_rad_s: vec![4.0], ..Recipe::new(1) };
    let trials = synthesise(&config, folder.path(), &recipe, &|_| Ok(())).unwrap();
    let coast = trials.iter().find(|trial| trial.kind == TrialKind::CoastDown).unwrap();
    let [average, kalman] = [Smoothing::MovingAverage, Smoothing::Kalman].map(|smoothing| {
        config.ingest.smoothing = smoothing;
        process_trial(folder.path(), coast, &config).unwrap().parameters.unwrap().roll_sum_kg_s
    });
    let difference = (kalman.value - average.value).abs();
    assert!(difference < average.se, "{average:?} {kalman:?}");
}
