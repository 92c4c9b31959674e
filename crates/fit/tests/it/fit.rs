//! Fits against the best known objective of data made by an independent program.

use std::f64::consts::TAU;

use trilink_fit::{FitData, FitInput, Fitted, Objective, fit};
use trilink_mechanics::{Laws, Model, Problem, REFERENCE_ACCURACY};
use trilink_robot::decay::DecayLaw;
use trilink_robot::metrics::{GaitMetrics, MotionStatus};
use trilink_robot::{JointCommand, Parameter, Quantity, Robot};
use trilink_statistics::Estimate;
use trilink_tables::config::{
    Campaign, Config, Free, GaitInput, ParameterSource, SigmaKind, Weights,
};
use trilink_tables::trial::TrialKind;
use trilink_tables::{
    Columns as _, Comparison, FitRow, FitStatus, JointGait, PredictionSource, RobotParameterRow,
    TrialRow, TrialStatus,
};

/// The reference's campaign: metrics at twelve frequencies with 3 % noise.
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
                    sigma: [fields[3], fields[4], fields[5]],
                    alpha1_rad,
                    dtheta_rad: 0.0,
                },
                ..TrialRow::blank()
            }
        })
        .collect()
}

/// The paper's configuration with this one campaign.
fn config(reference: &Reference) -> Config {
    let mut config = Config::default();
    config.campaign.retain(|name, _| name == reference.campaign);
    config.campaign.values_mut().for_each(|campaign: &mut Campaign| {
        campaign.models = vec![Model::SKID_ROLL];
    });
    config.fit.starts = 32;
    // The reference's trials are those of the command.
    config.fit.gait_input = GaitInput::Commanded;
    (config.fit.bootstrap, config.fit.profiles) = (0, false);
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
        let (weights, gait_input) = (campaign.weights, GaitInput::Commanded);
        let objective =
            Objective::new(Laws::SKID_ROLL, robot, gait, weights, gait_input, measurements);
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
        // The work is bounded too: a start takes some ten evaluations of twelve motions.
        assert!(found.solves < 32 * 12 * 20, "{}: {}", reference.campaign, found.solves);
        let skid = Quantity::Skid.of_each().map(|skid| found.parameters[skid]);
        for (found, known) in skid.iter().zip(reference.best_skid_kg_s) {
            assert!((found - known).abs() < 1e-4 * known, "{}: {skid:?}", reference.campaign);
        }
    }
}

#[test]
fn a_fit_to_servos_that_miss_their_command_needs_the_measured_gait() {
    // Trials of the model itself under a gait that is 3 % smaller than commanded.
    let reference = &REFERENCES[2];
    let mut config = config(reference);
    config.fit.starts = 4;
    let (mut robot, mut gait) = config.campaign_setup(reference.campaign).unwrap();
    robot.skid_kg_s = reference.best_skid_kg_s;
    let joint = gait.joints[1].as_mut().unwrap();
    joint.amplitude_rad *= 0.97;
    let (offset_rad, amplitude_rad) = (joint.offset_rad, joint.amplitude_rad);
    let mut rows = trials(reference);
    for row in &mut rows {
        let (robot, omega_rad_s) = (robot.clone(), row.omega_rad_s);
        let problem = Problem { robot, gait, laws: Laws::SKID_ROLL, omega_rad_s };
        let metrics = problem.solve(REFERENCE_ACCURACY).unwrap().metrics;
        row.metrics = GaitMetrics { dtheta_rad: row.metrics.dtheta_rad, ..metrics };
        row.gait[1] = JointGait { offset_rad, amplitude_rad, phase_rad: 0.0, ..row.gait[1] };
    }
    config.fit.sigma = SigmaKind::Raw;
    let mut missed = |input: GaitInput| {
        config.fit.gait_input = input;
        let found = fit(&config, &rows.clone().into(), &|_| {}).fits.remove(0);
        let skid = Quantity::Skid.of_each().map(|skid| found.parameters[skid]);
        let missed =
            skid.iter().zip(reference.best_skid_kg_s).map(|(c, known)| (c / known - 1.0).abs());
        missed.fold(0.0, f64::max)
    };
    let (commanded, measured) = (missed(GaitInput::Commanded), missed(GaitInput::Measured));
    // Noise-free data give every coefficient back.
    assert!(measured < 1e-3 && commanded > 0.01, "{measured} {commanded}");
}

#[test]
fn a_model_of_one_s_own_is_fitted_as_a_shipped_one_with_its_laws() {
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
    let of = |model: Model| {
        predictions
            .iter()
            .filter(move |row| row.model == model)
            .map(|row| row.metrics.d_m.to_bits())
    };
    assert!(of(own).eq(of(Model::SKID_ROLL)) && of(own).count() > 100);
    // With a gait of its own it does not depend on that of the other fits.
    config.model.get_mut(&own).unwrap().input = Some(GaitInput::Commanded);
    config.fit.gait_input = GaitInput::Measured;
    let Fitted { fits, alternatives, .. } = fit(&config, &named(reference).into(), &|_| {});
    let ours = fits.iter().find(|row| row.model == own).unwrap();
    assert_eq!((ours.gait_input, ours.j), (GaitInput::Commanded, shipped.j));
    assert!(alternatives.iter().all(|row| row.model != own));
}

#[test]
fn data_of_dry_friction_give_back_its_coefficients() {
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
        let (robot, laws, omega_rad_s) = (truth.clone(), Laws::COULOMB, row.omega_rad_s);
        let problem = Problem { robot, gait, laws, omega_rad_s };
        row.metrics = problem.solve(REFERENCE_ACCURACY).unwrap().metrics;
    }
    let Fitted { fits, predictions, .. } = fit(&config, &rows.into(), &|_| {});
    let of = |model| fits.iter().find(|row| row.model == model).unwrap();
    let (dry, viscous) = (of(model), of(Model::SKID_ROLL));
    assert_eq!(dry.free, Quantity::SkidDry.of_each());
    for (parameter, planted) in Quantity::SkidDry.of_each().into_iter().zip(planted) {
        let found = dry.parameters[parameter];
        assert!((found / planted - 1.0).abs() < 1e-3, "{parameter}: {found}");
    }
    assert_eq!(dry.parameters[Quantity::Transition.one()], 0.005);
    assert!(dry.parameters[Quantity::Skid.of(0)].is_nan());
    assert!(viscous.parameters[Quantity::SkidDry.of(0)].is_nan());
    assert!(dry.j < 1e-3 * viscous.j, "{} {}", dry.j, viscous.j);
    assert!(predictions.iter().any(|row| row.model == model && row.metrics.d_m > 0.0));
}

#[test]
fn what_the_other_gait_gives_stands_beside_with_its_intervals() {
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
        // A model that is always driven by the measured gait has no alternative.
        let [alternative] = alternatives.as_slice() else { panic!("{alternatives:?}") };
        assert_eq!((alternative.model, alternative.gait_input), (Model::SKID_ROLL, input.other()));
        let known = by_input.iter().find(|(other, _)| *other == input.other());
        let known = &known.unwrap().1.fits[1];
        assert!((alternative.j / known.j - 1.0).abs() < 1e-9, "{} {}", alternative.j, known.j);
        for (found, known) in skid(alternative).into_iter().zip(skid(known)) {
            assert!((found / known - 1.0).abs() < 1e-6, "{found} {known}");
        }
        // Of the same resamples; the profiles, which can open an interval, are the main fit's.
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
fn a_curve_goes_through_what_is_predicted_for_the_trials_own_gaits() {
    let reference = &REFERENCES[0];
    let mut config = quick(reference);
    (config.fit.starts, config.fit.bootstrap, config.fit.profiles) = (1, 0, false);
    config.fit.gait_input = GaitInput::Measured;
    let (robot, gait) = config.campaign_setup(reference.campaign).unwrap();
    // The curve's steps are a 111th of the range.
    let trials = [(1.0, 0.95, 3.2), (2.0, 1.01, -3.1), (4.0, 0.98, 3.1)];
    let trial = |(omega_rad_s, part, turned): (f64, f64, f64)| {
        let mut gait = gait;
        for joint in gait.joints.iter_mut().flatten() {
            joint.amplitude_rad *= part;
            joint.offset_rad += 0.02 * (part - 1.0);
            joint.phase_rad += 0.01 * turned;
        }
        let robot = robot.clone();
        let problem = Problem { robot, gait, laws: Laws::SKID_ROLL, omega_rad_s };
        let metrics = problem.solve(REFERENCE_ACCURACY).unwrap().metrics;
        let mut row = TrialRow { omega_rad_s, metrics, ..named(reference).remove(0) };
        (row.trial, row.omega_commanded_rad_s) = (format!("at-{omega_rad_s}"), omega_rad_s);
        for (joint, found) in gait.joints.iter().flatten().zip(&mut row.gait) {
            let JointCommand { offset_rad, amplitude_rad, phase_rad, .. } = *joint;
            // A turn more is the same phase.
            let phase_rad = phase_rad + if turned < 0.0 { TAU } else { 0.0 };
            *found = JointGait { offset_rad, amplitude_rad, phase_rad, ..*found };
        }
        row
    };
    let rows: Vec<TrialRow> = trials.map(trial).into();
    let predictions = fit(&config, &rows.into(), &|_| {}).predictions;
    let of = |source: PredictionSource| predictions.iter().filter(move |row| row.source == source);
    let curve: Vec<_> = of(PredictionSource::Curve).collect();
    for (trial, at) in of(PredictionSource::Trial).zip([0, 37, 111]) {
        assert!((curve[at].omega_rad_s - trial.omega_rad_s).abs() < 1e-12);
        let (found, known) = (curve[at].metrics.to_array(), trial.metrics.to_array());
        for (found, known) in found.into_iter().zip(known) {
            assert!((found - known).abs() < 1e-6 * known.abs().max(0.1), "{found} {known}");
        }
    }
    // Between two trials it is between what their gaits give, not what the command does.
    let alpha1_rad = 0.5 * (0.95 + 1.01) * 30_f64.to_radians();
    let halfway = curve.iter().map(|row| row.metrics.alpha1_rad - alpha1_rad);
    assert!(
        halfway.clone().any(|off| off.abs() < 1e-3) && curve[5].metrics.alpha1_rad < alpha1_rad
    );
}

#[test]
fn a_campaign_without_trials_is_a_row_that_says_so() {
    let config = config(&REFERENCES[0]);
    let fitted = fit(&config, &FitData::default(), &|_| {});
    assert_eq!(fitted.fits.len(), 1);
    assert_eq!(fitted.fits[0].status.to_string(), "failed: no trial with metrics");
    assert!(fitted.predictions.is_empty());
}

/// The reference's trials with names, frequencies and errors.
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

/// Fits of two starts and few replicates.
fn quick(reference: &Reference) -> Config {
    let mut config = config(reference);
    config.fit.sigma = SigmaKind::Raw;
    (config.fit.starts, config.fit.bootstrap, config.fit.profiles) = (2, 10, true);
    config
}

#[test]
fn neither_threads_nor_the_order_of_the_trials_change_a_bit() {
    let reference = &REFERENCES[0];
    let config = quick(reference);
    let rows = named(reference);
    let with_threads = |threads: usize, rows: Vec<TrialRow>| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| fit(&config, &rows.into(), &|_| {}))
    };
    // Missing values are not equal to themselves, so the text is compared; it has all digits.
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
    // A whole frequency and a single metric.
    rows.remove(4);
    rows[2].metrics.sigma[1] = f64::NAN;
    let fitted = fit(&config, &rows.into(), &|_| {});
    let fit = &fitted.fits[0];
    assert_eq!((fit.trials, &fit.status), (11, &FitStatus::Ok));
    assert!(
        (fit.parameters[Quantity::Skid.of(0)] / whole.parameters[Quantity::Skid.of(0)] - 1.0).abs()
            < 0.1
    );
    // d and v of a trial are one measurement.
    assert_eq!(fitted.comparison[0].terms, 4 * 11 - 1);
}

#[test]
fn bounds_that_exclude_the_configured_start_are_respected_and_marked() {
    let reference = &REFERENCES[0];
    let mut config = quick(reference);
    // The robot has 100, 50, 50 kg/s and the best is 101, 34, 44 kg/s.
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
    // What lies beyond the bounds is not known.
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
    // A gait that is a little off crosses the singular shape without meeting condition (5).
    for row in &mut rows {
        row.gait =
            [(0.0, 0.5, 0.01), (0.01, 0.52, -1.5)].map(|(offset_rad, amplitude_rad, phase_rad)| {
                JointGait { offset_rad, amplitude_rad, phase_rad, ..JointGait::blank() }
            });
    }
    let fitted = fit(&config, &rows.into(), &|_| {});
    let statuses: Vec<String> = fitted.fits.iter().map(|fit| fit.status.to_string()).collect();
    assert!(statuses[0].starts_with("singular: at 0.500 rad/s"), "{statuses:?}");
    assert_eq!(statuses[1..], ["ok", "ok"]);
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
    let status = fitted.fits[0].status.to_string();
    let expected = "failed: at 0.500 rad/s the offset, amplitude and phase of the commanded joints";
    assert!(status.starts_with(expected), "{status}");
    assert_eq!(fitted.fits[1].status, FitStatus::Ok);
    assert_eq!(fitted.alternatives[0].status.to_string(), status);
    let of_first = fitted.predictions.iter().filter(|row| row.model == Model::NO_SKID_MEASURED);
    assert!(of_first.clone().count() > 0);
    assert!(of_first.into_iter().all(|row| row.status == MotionStatus::Failed));
}

#[test]
fn stiffness_and_damping_that_only_act_together_are_not_identifiable() {
    // With the weight on alpha_1 at a single frequency there is one number for two coefficients.
    let reference = &REFERENCES[2];
    let mut config = quick(reference);
    let campaign = config.campaign.get_mut(reference.campaign).unwrap();
    campaign.free =
        [(Model::SKID_ROLL, Free(vec![Quantity::Stiffness.one(), Quantity::Damping.one()]))].into();
    campaign.weights = Weights { d: 0.0, v: 0.0, sigma: 0.0, alpha: 1.0 };
    let mut rows = named(reference);
    rows.drain(4..);
    rows.drain(..3);
    rows[0].metrics_se.alpha1_rad = 0.01 * rows[0].metrics.alpha1_rad;
    let fitted = fit(&config, &rows.into(), &|_| {});
    let fit = &fitted.fits[0];
    assert_eq!(fit.status, FitStatus::Ok);
    assert!(fit.j < 1e-6, "{}", fit.j);
    assert!(!fit.identifiable.contains(&Quantity::Damping.one()), "{fit:?}");
}

#[test]
fn a_coefficient_that_nothing_measured_depends_on_is_structurally_not_identifiable() {
    // The weight is on alpha_1 alone, which the gait commands: no skid coefficient moves it.
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
fn noise_free_trials_give_back_whatever_is_free() {
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
            vec![Quantity::Roll.of(0), Quantity::Skid.of(2)],
            vec![Quantity::Roll.of(0), Quantity::Skid.of(2)],
        ),
        (
            vec![Quantity::Stiffness.one(), Quantity::Damping.one()],
            vec![Quantity::Stiffness.one(), Quantity::Damping.one()],
        ),
    ] {
        let mut truth = robot.clone();
        for coefficient in &planted {
            coefficient.set(&mut truth, 1.3 * coefficient.of(&robot));
        }
        let mut rows = named(reference);
        for row in &mut rows {
            let omega_rad_s = row.omega_rad_s;
            let problem =
                Problem { robot: truth.clone(), gait, laws: Laws::SKID_ROLL, omega_rad_s };
            let metrics = problem.solve(REFERENCE_ACCURACY).unwrap().metrics;
            row.metrics = GaitMetrics { dtheta_rad: row.metrics.dtheta_rad, ..metrics };
        }
        let campaign = config.campaign.get_mut(reference.campaign).unwrap();
        campaign.free = [(model, Free(free.clone()))].into();
        let fitted = fit(&config, &rows.into(), &|_| {});
        let found = &fitted.fits[0];
        assert!(found.j < 1e-6, "{free:?}: {}", found.j);
        assert_eq!(found.identifiable, found.free, "{free:?}");
        let known = |of: &Parameter| Laws::SKID_ROLL.know(*of, &gait);
        for coefficient in Parameter::ALL.into_iter().filter(known) {
            let (found, known) = (found.parameters[coefficient], coefficient.of(&truth));
            assert!(
                (found / known - 1.0).abs() < 1e-3,
                "{free:?} {coefficient:?}: {found} {known}"
            );
        }
    }
}

#[test]
fn measured_parameters_of_the_robot_take_the_place_of_configured_ones() {
    let reference = &REFERENCES[2];
    let mut config = quick(reference);
    config.fit.robot_parameters = ParameterSource::Measured;
    let release = RobotParameterRow {
        robot: "semi-passive".to_owned(),
        stiffness_nm_rad: Estimate::new(0.15, f64::NAN),
        damping_nm_s_rad: Estimate::new(0.0065, f64::NAN),
        law: Some(DecayLaw::Viscous),
        status: FitStatus::Ok,
        ..RobotParameterRow::blank()
    };
    let data = FitData { robots: vec![release], ..FitData::from(named(reference)) };
    let fit = fit(&config, &data, &|_| {}).fits.remove(0);
    let joint = [Quantity::Stiffness.one(), Quantity::Damping.one()];
    assert_eq!(joint.map(|of| fit.parameters[of]), [0.15, 0.0065]);
    // There is no coast-down.
    let roll = [Quantity::Roll.of(0), Quantity::Roll.sum()];
    assert_eq!(roll.map(|of| fit.parameters[of]), [0.6, 1.2]);
    assert_eq!(fit.measured, joint);
}
