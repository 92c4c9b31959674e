//! Comparison of fits with the best known objectives for data from an independent program.

use std::f64::consts::TAU;

use trilink_fit::{FitData, FitInput, Fitted, Objective, fit};
use trilink_mechanics::{Laws, Model, Problem, REFERENCE_ACCURACY};
use trilink_robot::decay::DecayLaw;
use trilink_robot::metrics::{GaitMetrics, MotionStatus, padded};
use trilink_robot::{JointCommand, Parameter, Quantity, Robot};
use trilink_statistics::Estimate;
use trilink_tables::config::{
    Campaign, Config, Free, GaitInput, ParameterSource, SigmaKind, Weights,
};
use trilink_tables::trial::TrialKind;
use trilink_tables::{
    Columns as _, Comparison, FitRow, FitStatus, JointGait, LawStatus, PredictionSource,
    RobotParameterRow, TrialRow, TrialStatus,
};

/// Campaign simulated by the reference program: metrics at twelve frequencies with 3 % noise.
struct Reference {
    campaign: &'static str,
    data: &'static str,
    best_j: f64,
    best_skid_kg_s: [f64; 3],
}

const REFERENCES: [Reference; 3] = [
    Reference {
        campaign: "kinematic-symmetric",
        data: include_str!("../fixtures/kinematic-symmetric.csv"),
        best_j: 0.26140684,
        best_skid_kg_s: [100.688, 33.889, 43.584],
    },
    Reference {
        campaign: "kinematic-skewed",
        data: include_str!("../fixtures/kinematic-skewed.csv"),
        best_j: 0.30575846,
        best_skid_kg_s: [73.172, 90.566, 94.340],
    },
    Reference {
        campaign: "semi-passive-symmetric",
        data: include_str!("../fixtures/semi-passive-symmetric.csv"),
        best_j: 1.54518436,
        best_skid_kg_s: [424.980, 196.798, 70.610],
    },
];

fn trials(reference: &Reference) -> Vec<TrialRow> {
    reference
        .data
        .lines()
        .skip(1)
        .map(|line| {
            let fields: Vec<f64> =
                line.split(',').map(|field| field.parse().unwrap_or(f64::NAN)).collect();
            let alpha1_rad = if fields[6].is_nan() { 30.0 } else { fields[6] }.to_radians();
            TrialRow {
                campaign: reference.campaign.to_owned(),
                omega_rad_s: fields[0],
                metrics: GaitMetrics {
                    d_m: fields[1],
                    v_m_s: fields[2],
                    sigma: padded(&fields[3..6]),
                    alpha_rad: padded(&[alpha1_rad]),
                    dtheta_rad: 0.0,
                },
                ..TrialRow::blank()
            }
        })
        .collect()
}

/// Returns the default configuration with only the reference's campaign.
fn config(reference: &Reference) -> Config {
    let mut config = Config::default();
    config.campaign.retain(|name, _| name == reference.campaign);
    config.campaign.values_mut().for_each(|campaign: &mut Campaign| {
        campaign.models = vec![Model::SKID_ROLL];
    });
    config.fit.starts = 32;
    // The reference's trials follow the command exactly.
    config.fit.gait_input = GaitInput::Commanded;
    config.fit.bootstrap = 0;
    config.fit.profiles = false;
    config
}

#[test]
fn the_reference_s_best_coefficients_have_its_objective() {
    for reference in &REFERENCES {
        let config = config(reference);
        let campaign = &config.campaign[reference.campaign];
        let (robot, gait) = config.campaign_setup(reference.campaign).unwrap();
        let rows = trials(reference);
        let measurements = rows
            .iter()
            .filter_map(|row| trilink_fit::Measurement::new(row, SigmaKind::Raw))
            .collect();
        let objective = Objective::new(
            Laws::SKID_ROLL,
            robot,
            gait,
            campaign.weights,
            GaitInput::Commanded,
            measurements,
        );
        let input = FitInput::new(&config, reference.campaign, Model::SKID_ROLL).unwrap();
        let parameters = input.free();
        let j = objective.evaluator(parameters).cost(&reference.best_skid_kg_s);
        // The coefficients are known to six digits, and the objective has a kink there.
        let difference = (j - reference.best_j).abs() / reference.best_j;
        assert!(difference < 2e-5, "{}: {j}", reference.campaign);
    }
}

#[test]
fn thirty_of_thirty_two_starts_end_at_the_reference_s_best_objective() {
    for reference in &REFERENCES {
        let mut config = config(reference);
        config.fit.sigma = SigmaKind::Raw;
        let fitted = fit(&config, &trials(reference).into(), &|_| {});
        let found = &fitted.fits[0];
        assert_eq!(found.status, FitStatus::Ok);
        let best = |j: f64| (j - reference.best_j).abs() < 1e-6 * reference.best_j;
        assert!(best(found.j), "{}: {} after {} solves", reference.campaign, found.j, found.solves);
        let reached = fitted.starts.iter().filter(|start| best(start.j)).count();
        assert!(reached >= 30, "{}: {reached} of 32: {:?}", reference.campaign, fitted.starts);
        // The effort is limited, too: a start needs about ten evaluations at twelve frequencies.
        assert!(found.solves < 32 * 12 * 20, "{}: {}", reference.campaign, found.solves);
        let skid = Quantity::Skid.of_each().map(|skid| found.parameters[skid]);
        for (found, known) in skid.iter().zip(reference.best_skid_kg_s) {
            assert!((found - known).abs() < 1e-4 * known, "{}: {skid:?}", reference.campaign);
        }
    }
}

#[test]
fn a_fit_to_servos_that_do_not_follow_their_command_needs_the_measured_gait() {
    // Trials simulated by the model itself, with an actual gait that is 3 % smaller than commanded.
    let reference = &REFERENCES[2];
    let mut config = config(reference);
    config.fit.starts = 4;
    let (mut robot, mut gait) = config.campaign_setup(reference.campaign).unwrap();
    robot.skid_kg_s = reference.best_skid_kg_s;
    let joint = gait.joints[1].as_mut().unwrap();
    joint.amplitude_rad *= 0.97;
    let offset_rad = joint.offset_rad;
    let amplitude_rad = joint.amplitude_rad;
    let mut rows = trials(reference);
    for row in &mut rows {
        let problem = Problem::new(robot.clone(), gait, Laws::SKID_ROLL, row.omega_rad_s);
        let metrics = problem.solve(REFERENCE_ACCURACY).unwrap().metrics;
        row.metrics = GaitMetrics { dtheta_rad: row.metrics.dtheta_rad, ..metrics };
        row.gait[1] = JointGait { offset_rad, amplitude_rad, phase_rad: 0.0, ..row.gait[1] };
    }
    config.fit.sigma = SigmaKind::Raw;
    let mut max_error = |input: GaitInput| {
        config.fit.gait_input = input;
        let found = fit(&config, &rows.clone().into(), &|_| {}).fits.remove(0);
        let skid = Quantity::Skid.of_each().map(|skid| found.parameters[skid]);
        let pairs = skid.iter().zip(reference.best_skid_kg_s);
        pairs.map(|(c, known)| (c / known - 1.0).abs()).fold(0.0, f64::max)
    };
    let commanded = max_error(GaitInput::Commanded);
    let measured = max_error(GaitInput::Measured);
    // Fits to noise-free data recover every coefficient.
    assert!(measured < 1e-3 && commanded > 0.01, "{measured} {commanded}");
}

#[test]
fn a_user_defined_model_is_fitted_as_a_shipped_one_with_the_same_laws() {
    let reference = &REFERENCES[0];
    let mut config = quick(reference);
    let own = Model::new("ours");
    config.model.insert(own, config.model[&Model::SKID_ROLL].clone());
    let campaign = config.campaign.get_mut(reference.campaign).unwrap();
    campaign.models = vec![Model::SKID_ROLL, own];
    let Fitted { fits, predictions, .. } = fit(&config, &named(reference).into(), &|_| {});
    let [shipped, ours] = fits.as_slice() else { panic!("{fits:?}") };
    assert_eq!((shipped.model, ours.model), (Model::SKID_ROLL, own));
    assert_eq!((ours.j, &ours.free), (shipped.j, &shipped.free));
    assert_eq!(
        Quantity::Skid.of_each().map(|skid| ours.parameters[skid]),
        Quantity::Skid.of_each().map(|skid| shipped.parameters[skid])
    );
    let distances = |model: Model| {
        predictions
            .iter()
            .filter(move |row| row.model == model)
            .map(|row| row.metrics.d_m.to_bits())
    };
    assert!(distances(own).eq(distances(Model::SKID_ROLL)) && distances(own).count() > 100);
    // A model with its own gait input does not depend on the gait input of the other fits.
    config.model.get_mut(&own).unwrap().input = Some(GaitInput::Commanded);
    config.fit.gait_input = GaitInput::Measured;
    let Fitted { fits, alternatives, .. } = fit(&config, &named(reference).into(), &|_| {});
    let ours = fits.iter().find(|row| row.model == own).unwrap();
    assert_eq!((ours.gait_input, ours.j), (GaitInput::Commanded, shipped.j));
    assert!(alternatives.iter().all(|row| row.model != own));
}

#[test]
fn fits_to_data_of_dry_friction_recover_its_coefficients() {
    let reference = &REFERENCES[1];
    let mut config = quick(reference);
    config.fit.starts = 1;
    let model = Model::new("coulomb");
    config.campaign.get_mut(reference.campaign).unwrap().models = vec![model, Model::SKID_ROLL];
    let (robot, gait) = config.campaign_setup(reference.campaign).unwrap();
    let planted = [2.2, 0.7, 1.0];
    let truth = Robot { skid_dry_n: planted, ..robot };
    let mut rows = named(reference);
    for row in &mut rows {
        let problem = Problem::new(truth.clone(), gait, Laws::COULOMB, row.omega_rad_s);
        row.metrics = problem.solve(REFERENCE_ACCURACY).unwrap().metrics;
    }
    let Fitted { fits, predictions, .. } = fit(&config, &rows.into(), &|_| {});
    let fit_of = |model| fits.iter().find(|row| row.model == model).unwrap();
    let dry = fit_of(model);
    let viscous = fit_of(Model::SKID_ROLL);
    assert_eq!(dry.free, Quantity::SkidDry.of_each());
    for (parameter, planted) in Quantity::SkidDry.of_each().into_iter().zip(planted) {
        let found = dry.parameters[parameter];
        assert!((found / planted - 1.0).abs() < 1e-3, "{parameter}: {found}");
    }
    assert_eq!(dry.parameters[Quantity::Transition.one()], 0.005);
    assert!(dry.parameters[Quantity::Skid.parameter(0)].is_nan());
    assert!(viscous.parameters[Quantity::SkidDry.parameter(0)].is_nan());
    assert!(dry.j < 1e-3 * viscous.j, "{} {}", dry.j, viscous.j);
    assert!(predictions.iter().any(|row| row.model == model && row.metrics.d_m > 0.0));
}

#[test]
fn the_fit_to_the_other_gait_is_an_alternative_with_its_own_intervals() {
    let reference = &REFERENCES[1];
    let mut config = quick(reference);
    let (_, gait) = config.campaign_setup(reference.campaign).unwrap();
    let campaign = config.campaign.get_mut(reference.campaign).unwrap();
    campaign.models = vec![Model::NO_SKID_MEASURED, Model::SKID_ROLL];
    let mut rows = named(reference);
    for row in &mut rows {
        row.gait = gait.joints.map(|joint| {
            let JointCommand { offset_rad, amplitude_rad, phase_rad, .. } = joint.unwrap();
            let amplitude_rad = 0.98 * amplitude_rad;
            JointGait { offset_rad, amplitude_rad, phase_rad, ..row.gait[0] }
        });
    }
    let mut fitted = |gait_input: GaitInput| {
        config.fit.gait_input = gait_input;
        fit(&config, &rows.clone().into(), &|_| {})
    };
    let by_input = GaitInput::ALL.map(|input| (input, fitted(input)));
    let skid = |row: &FitRow| Quantity::Skid.of_each().map(|skid| row.parameters[skid]);
    for (input, Fitted { fits, alternatives, .. }) in &by_input {
        assert_eq!(
            fits.iter().map(|row| row.gait_input).collect::<Vec<_>>(),
            [GaitInput::Measured, *input]
        );
        // A model that is configured to be driven by the measured gait has no alternative fit.
        let [alternative] = alternatives.as_slice() else { panic!("{alternatives:?}") };
        assert_eq!((alternative.model, alternative.gait_input), (Model::SKID_ROLL, input.other()));
        let known = by_input.iter().find(|(other, _)| *other == input.other());
        let known = &known.unwrap().1.fits[1];
        assert!((alternative.j / known.j - 1.0).abs() < 1e-9, "{} {}", alternative.j, known.j);
        for (found, known) in skid(alternative).into_iter().zip(skid(known)) {
            assert!((found / known - 1.0).abs() < 1e-6, "{found} {known}");
        }
        // The resamples are the same; the profiles, which can make an interval open, are those of the main fit.
        for skid in Quantity::Skid.of_each() {
            for (found, known) in
                [(alternative.lower, known.lower), (alternative.upper, known.upper)]
            {
                let is_same = (found[skid] / known[skid] - 1.0).abs() < 1e-3;
                assert!(
                    is_same || known[skid].is_nan(),
                    "{skid:?} {} {}",
                    found[skid],
                    known[skid]
                );
            }
        }
    }
}

#[test]
fn a_curve_passes_through_the_predictions_for_the_trials_own_gaits() {
    let reference = &REFERENCES[0];
    let mut config = quick(reference);
    config.fit.starts = 1;
    config.fit.bootstrap = 0;
    config.fit.profiles = false;
    config.fit.gait_input = GaitInput::Measured;
    let (robot, gait) = config.campaign_setup(reference.campaign).unwrap();
    // The prediction curve has 112 points, so that its step is 1/111 of the range.
    let trials = [(1.0, 0.95, 3.2), (2.0, 1.01, -3.1), (4.0, 0.98, 3.1)];
    let trial = |(omega_rad_s, amplitude_ratio, turned): (f64, f64, f64)| {
        let mut gait = gait;
        for joint in gait.joints.iter_mut().flatten() {
            joint.amplitude_rad *= amplitude_ratio;
            joint.offset_rad += 0.02 * (amplitude_ratio - 1.0);
            joint.phase_rad += 0.01 * turned;
        }
        let robot = robot.clone();
        let problem = Problem::new(robot, gait, Laws::SKID_ROLL, omega_rad_s);
        let metrics = problem.solve(REFERENCE_ACCURACY).unwrap().metrics;
        let mut row = TrialRow { omega_rad_s, metrics, ..named(reference).remove(0) };
        row.trial = format!("at-{omega_rad_s}");
        row.omega_commanded_rad_s = omega_rad_s;
        for (joint, found) in gait.joints.iter().flatten().zip(&mut row.gait) {
            let JointCommand { offset_rad, amplitude_rad, phase_rad, .. } = *joint;
            // Phases that differ by a full turn are equivalent.
            let phase_rad = phase_rad + if turned < 0.0 { TAU } else { 0.0 };
            *found = JointGait { offset_rad, amplitude_rad, phase_rad, ..*found };
        }
        row
    };
    let rows: Vec<TrialRow> = trials.map(trial).into();
    let predictions = fit(&config, &rows.into(), &|_| {}).predictions;
    let with_source =
        |source: PredictionSource| predictions.iter().filter(move |row| row.source == source);
    let curve: Vec<_> = with_source(PredictionSource::Curve).collect();
    for (trial, at) in with_source(PredictionSource::Trial).zip([0, 37, 111]) {
        assert!((curve[at].omega_rad_s - trial.omega_rad_s).abs() < 1e-12);
        let (found, known) = (curve[at].metrics.to_array(), trial.metrics.to_array());
        for (found, known) in found.into_iter().zip(known) {
            assert!((found - known).abs() < 1e-6 * known.abs().max(0.1), "{found} {known}");
        }
    }
    // Between two trials, the prediction curve uses the mean of their gaits, not the command.
    let alpha1_rad = 0.5 * (0.95 + 1.01) * 30_f64.to_radians();
    let mut deviations = curve.iter().map(|row| row.metrics.alpha_rad[0] - alpha1_rad);
    assert!(deviations.any(|deviation| deviation.abs() < 1e-3));
    assert!(curve[5].metrics.alpha_rad[0] < alpha1_rad);
}

#[test]
fn a_campaign_without_trials_is_a_row_that_says_so() {
    let config = config(&REFERENCES[0]);
    let fitted = fit(&config, &FitData::default(), &|_| {});
    assert_eq!(fitted.fits.len(), 1);
    let fit = &fitted.fits[0];
    assert_eq!((fit.status, fit.failure.as_str()), (FitStatus::Failed, "no trial with metrics"));
    assert!(fitted.predictions.is_empty());
}

/// Returns the reference's trials with names, frequencies and standard errors added.
fn named(reference: &Reference) -> Vec<TrialRow> {
    let mut rows = trials(reference);
    for (number, row) in rows.iter_mut().enumerate() {
        row.trial = format!("trial-{number}");
        row.kind = TrialKind::Gait;
        row.omega_commanded_rad_s = row.omega_rad_s;
        row.cycles = 5;
        row.metrics_se.d_m = 0.03 * row.metrics.d_m;
        row.metrics_se.v_m_s = 0.03 * row.metrics.v_m_s;
        row.metrics_se.sigma = row.metrics.sigma.map(|sigma| 0.03 * sigma);
    }
    rows
}

/// Returns a configuration for a quick fit, with two starts, few replicates and profiles.
fn quick(reference: &Reference) -> Config {
    let mut config = config(reference);
    config.fit.sigma = SigmaKind::Raw;
    config.fit.starts = 2;
    config.fit.bootstrap = 10;
    config.fit.profiles = true;
    config
}

#[test]
fn neither_the_threads_nor_the_order_of_the_trials_change_a_bit() {
    let reference = &REFERENCES[0];
    let config = quick(reference);
    let rows = named(reference);
    let with_threads = |threads: usize, rows: Vec<TrialRow>| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| fit(&config, &rows.into(), &|_| {}))
    };
    // Missing values (NaN) are not equal to themselves, so compare the debug format, which represents numbers exactly.
    let text = |fitted: &Fitted| format!("{fitted:?}");
    let one = with_threads(1, rows.clone());
    assert_eq!(one.bootstrap.len(), 10);
    assert!(!one.profiles.is_empty());
    let mut turned = rows.clone();
    turned.rotate_left(5);
    turned.swap(0, 3);
    assert!(text(&one) == text(&with_threads(3, turned)));
}

#[test]
fn failed_trials_and_missing_metrics_are_left_out_and_the_others_fitted() {
    let reference = &REFERENCES[0];
    let config = quick(reference);
    let mut rows = named(reference);
    let whole = fit(&config, &rows.clone().into(), &|_| {}).fits.remove(0);
    assert_eq!(whole.trials, 12);
    let blank = |trial: &str, status: TrialStatus| TrialRow {
        trial: trial.to_owned(),
        campaign: reference.campaign.to_owned(),
        status,
        ..TrialRow::blank()
    };
    rows.push(blank("nothing", TrialStatus::Ok));
    rows.push(TrialRow { status: TrialStatus::Failed, ..rows[0].clone() });
    rows[13].metrics.d_m = 9.0;
    let same = fit(&config, &rows.clone().into(), &|_| {}).fits.remove(0);
    assert_eq!((same.trials, same.j), (12, whole.j));
    // Remove a whole frequency and a single metric.
    rows.remove(4);
    rows[2].metrics.sigma[1] = f64::NAN;
    let fitted = fit(&config, &rows.into(), &|_| {});
    let fit = &fitted.fits[0];
    assert_eq!((fit.trials, fit.status), (11, FitStatus::Ok));
    assert!(
        (fit.parameters[Quantity::Skid.parameter(0)]
            / whole.parameters[Quantity::Skid.parameter(0)]
            - 1.0)
            .abs()
            < 0.1
    );
    // d and v of a trial are one measurement.
    assert_eq!(fitted.comparison[0].terms, 4 * 11 - 1);
}

#[test]
fn bounds_that_exclude_the_configured_start_are_respected_and_marked() {
    let reference = &REFERENCES[0];
    let mut config = quick(reference);
    // The configured robot has 100, 50, 50 kg/s; the minimum is at 101, 34, 44 kg/s.
    config.fit.skid_bounds_kg_s = [55.0, 90.0];
    let fitted = fit(&config, &named(reference).into(), &|_| {});
    let fit = &fitted.fits[0];
    assert_eq!(fit.status, FitStatus::Ok);
    let [skid0, skid1, skid2] = Quantity::Skid.of_each();
    assert!((55.0..90.0).contains(&fit.parameters[skid0]));
    assert_eq!([skid1, skid2].map(|skid| fit.parameters[skid]), [55.0, 55.0]);
    assert_eq!(fit.at_bound, [skid1, skid2]);
    for start in &fitted.starts {
        assert!(
            Quantity::Skid.of_each().iter().all(|skid| (55.0..=90.0).contains(&start.began[*skid]))
        );
    }
    // Limits beyond the bounds are reported as unknown.
    assert!(fit.lower[skid1].is_nan() && fit.lower[skid2].is_nan());
    assert!(fit.practically_not.contains(&skid1));
}

#[test]
fn a_model_without_a_motion_says_so_and_the_others_are_fitted() {
    let reference = &REFERENCES[0];
    let mut config = quick(reference);
    let campaign = config.campaign.get_mut(reference.campaign).unwrap();
    campaign.models = vec![Model::NO_SKID_MEASURED, Model::NO_SKID, Model::SKID_ROLL];
    let mut rows = named(reference);
    // A slightly different gait passes through a singular shape without meeting condition (5).
    for row in &mut rows {
        row.gait =
            [(0.0, 0.5, 0.01), (0.01, 0.52, -1.5)].map(|(offset_rad, amplitude_rad, phase_rad)| {
                JointGait { offset_rad, amplitude_rad, phase_rad, ..JointGait::blank() }
            });
    }
    let fitted = fit(&config, &rows.into(), &|_| {});
    let statuses: Vec<FitStatus> = fitted.fits.iter().map(|fit| fit.status).collect();
    assert_eq!(statuses, [FitStatus::Singular, FitStatus::Ok, FitStatus::Ok]);
    let failure = &fitted.fits[0].failure;
    assert!(failure.starts_with("at 0.500 rad/s: no skid-free motion exists"), "{failure}");
    assert!(fitted.fits[0].j.is_nan() && fitted.comparison[0].j.is_nan());
    let sentence = Comparison::new(&fitted.comparison, &fitted.fits).expect("rows").to_string();
    assert!(sentence.starts_with("The data prefer skid-roll: J = 0.2614"), "{sentence}");
    assert_eq!(fitted.comparison[2].wins, 1.0);
    // Ten replicates for each model that has a fit.
    assert_eq!(fitted.bootstrap.len(), 20);
}

#[test]
fn the_ideal_robot_is_driven_by_the_command_where_the_measured_gait_drives_the_others() {
    for (reference, d_m) in [(&REFERENCES[0], 0.663466), (&REFERENCES[1], 0.122405)] {
        let mut config = quick(reference);
        config.fit.gait_input = Config::default().fit.gait_input;
        let models = vec![Model::NO_SKID, Model::NO_SKID_MEASURED, Model::SKID_ROLL];
        config.campaign.get_mut(reference.campaign).unwrap().models = models;
        let (_, command) = config.campaign_setup(reference.campaign).unwrap();
        let mut rows = named(reference);
        for row in &mut rows {
            row.gait = command.joints.map(|joint| {
                let JointCommand { offset_rad, amplitude_rad, phase_rad, .. } = joint.unwrap();
                JointGait { offset_rad, amplitude_rad, phase_rad, ..JointGait::blank() }
            });
            row.gait[1].amplitude_rad *= 0.97;
        }
        let Fitted { fits, alternatives, predictions, .. } = fit(&config, &rows.into(), &|_| {});
        let inputs: Vec<GaitInput> = fits.iter().map(|fit| fit.gait_input).collect();
        let measured = GaitInput::Measured;
        assert_eq!(inputs, [GaitInput::Commanded, measured, measured]);
        assert!(fits[0].status.is_ok() && fits[0].j != fits[1].j, "{} {}", fits[0].j, fits[1].j);
        assert!(alternatives.iter().all(|fit| fit.model == Model::SKID_ROLL));
        let ideal = predictions.iter().filter(|row| row.model == Model::NO_SKID);
        assert!(ideal.clone().count() > 100);
        for row in ideal {
            let found = row.metrics.d_m;
            assert!((found - d_m).abs() < 1e-6, "{found} at {} rad/s", row.omega_rad_s);
        }
    }
}

#[test]
fn trials_without_a_measured_gait_leave_the_models_that_need_it_without_a_fit() {
    let reference = &REFERENCES[1];
    let mut config = quick(reference);
    let campaign = config.campaign.get_mut(reference.campaign).unwrap();
    campaign.models = vec![Model::NO_SKID_MEASURED, Model::SKID_ROLL];
    let fitted = fit(&config, &named(reference).into(), &|_| {});
    let FitRow { status, failure, .. } = &fitted.fits[0];
    assert_eq!(*status, FitStatus::Failed);
    let expected = "at 0.500 rad/s: the offset, amplitude and phase of the commanded joints";
    assert!(failure.starts_with(expected), "{failure}");
    assert_eq!(fitted.fits[1].status, FitStatus::Ok);
    assert_eq!(fitted.alternatives[0].failure, *failure);
    let ideal = fitted.predictions.iter().filter(|row| row.model == Model::NO_SKID_MEASURED);
    assert!(ideal.clone().count() > 0);
    assert!(ideal.into_iter().all(|row| row.status == MotionStatus::Failed));
}

#[test]
fn stiffness_and_damping_that_only_act_together_are_not_identifiable() {
    // alpha_1 at a single frequency is one measurement for two coefficients.
    let reference = &REFERENCES[2];
    let mut config = quick(reference);
    let campaign = config.campaign.get_mut(reference.campaign).unwrap();
    campaign.free =
        [(Model::SKID_ROLL, Free(vec![Quantity::Stiffness.one(), Quantity::Damping.one()]))].into();
    campaign.weights = Weights { d: 0.0, v: 0.0, sigma: 0.0, alpha: 1.0 };
    let mut rows = named(reference);
    rows.drain(4..);
    rows.drain(..3);
    rows[0].metrics_se.alpha_rad[0] = 0.01 * rows[0].metrics.alpha_rad[0];
    let fitted = fit(&config, &rows.into(), &|_| {});
    let fit = &fitted.fits[0];
    assert_eq!(fit.status, FitStatus::Ok);
    assert!(fit.j < 1e-6, "{}", fit.j);
    assert!(!fit.identifiable.contains(&Quantity::Damping.one()), "{fit:?}");
}

#[test]
fn a_coefficient_without_effect_on_the_measurements_is_structurally_not_identifiable() {
    // Only alpha_1 has a weight; it is commanded by the gait, so that no skid coefficient changes it.
    let reference = &REFERENCES[0];
    let mut config = quick(reference);
    let campaign = config.campaign.get_mut(reference.campaign).unwrap();
    campaign.weights = Weights { d: 0.0, v: 0.0, sigma: 0.0, alpha: 1.0 };
    let fitted = fit(&config, &named(reference).into(), &|_| {});
    let fit = &fitted.fits[0];
    assert_eq!(fit.structurally_not, Quantity::Skid.of_each());
    assert!(fit.lower.iter().chain(fit.upper.iter()).all(|(_, limit)| limit.is_nan()));
}

#[test]
fn fits_to_noise_free_trials_recover_the_free_parameters() {
    let reference = &REFERENCES[2];
    let mut config = quick(reference);
    config.fit.starts = 4;
    let (robot, gait) = config.campaign_setup(reference.campaign).unwrap();
    let model = Model::SKID_ROLL;
    for (free, planted) in [
        (
            [&Quantity::Skid.of_each()[..], &[Quantity::Roll.sum()]].concat(),
            vec![Quantity::Roll.sum()],
        ),
        (
            vec![Quantity::Roll.parameter(0), Quantity::Skid.parameter(2)],
            vec![Quantity::Roll.parameter(0), Quantity::Skid.parameter(2)],
        ),
        (
            vec![Quantity::Stiffness.one(), Quantity::Damping.one()],
            vec![Quantity::Stiffness.one(), Quantity::Damping.one()],
        ),
    ] {
        let mut truth = robot.clone();
        for coefficient in &planted {
            coefficient.set(&mut truth, 1.3 * coefficient.value_in(&robot));
        }
        let mut rows = named(reference);
        for row in &mut rows {
            let omega_rad_s = row.omega_rad_s;
            let problem = Problem::new(truth.clone(), gait, Laws::SKID_ROLL, omega_rad_s);
            let metrics = problem.solve(REFERENCE_ACCURACY).unwrap().metrics;
            row.metrics = GaitMetrics { dtheta_rad: row.metrics.dtheta_rad, ..metrics };
        }
        let campaign = config.campaign.get_mut(reference.campaign).unwrap();
        campaign.free = [(model, Free(free.clone()))].into();
        let fitted = fit(&config, &rows.into(), &|_| {});
        let found = &fitted.fits[0];
        assert!(found.j < 1e-6, "{free:?}: {}", found.j);
        assert_eq!(found.identifiable, found.free, "{free:?}");
        let known = |of: &Parameter| Laws::SKID_ROLL.is_relevant(*of, &gait);
        for coefficient in Parameter::ALL.into_iter().filter(known) {
            let (found, known) = (found.parameters[coefficient], coefficient.value_in(&truth));
            assert!(
                (found / known - 1.0).abs() < 1e-3,
                "{free:?} {coefficient:?}: {found} {known}"
            );
        }
    }
}

#[test]
fn measured_robot_parameters_replace_configured_ones() {
    let reference = &REFERENCES[2];
    let mut config = quick(reference);
    config.fit.robot_parameters = ParameterSource::Measured;
    let release = RobotParameterRow {
        robot: "semi-passive".to_owned(),
        stiffness_nm_rad: Estimate::new(0.15, f64::NAN),
        damping_nm_s_rad: Estimate::new(0.0065, f64::NAN),
        law: Some(DecayLaw::Viscous),
        status: LawStatus::Ok,
        ..RobotParameterRow::blank()
    };
    let data = FitData { robots: vec![release], ..FitData::from(named(reference)) };
    let fit = fit(&config, &data, &|_| {}).fits.remove(0);
    let joint = [Quantity::Stiffness.one(), Quantity::Damping.one()];
    assert_eq!(joint.map(|of| fit.parameters[of]), [0.15, 0.0065]);
    // There is no coast-down trial.
    let roll = [Quantity::Roll.parameter(0), Quantity::Roll.sum()];
    assert_eq!(roll.map(|of| fit.parameters[of]), [0.6, 1.2]);
    assert_eq!(fit.measured, joint);
}
