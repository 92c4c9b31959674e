//! Trials whose files have the poses of the links instead of markers.

use trilink_base::body;
use trilink_mocap::{LengthUnit, read_markers};
use trilink_synth::{Format, body_layout};
use trilink_tables::config::Markers;

use super::*;

/// Returns the rows of a few trials in a format, with the same motion and noise in every format.
fn rows(format: Format) -> Vec<TrialRow> {
    let mut config = Config::default();
    config.campaign.retain(|name, _| name != "kinematic-skewed");
    let folder = tempfile::tempdir().unwrap();
    let recipe = Recipe { omegas_rad_s: vec![1.0, 3.9], format, ..Recipe::new(5) };
    let trials = synthesise(&config, folder.path(), &recipe, &|_| Ok(())).unwrap();
    if format.has_bodies() {
        config.markers = body_layout(&config.markers);
    }
    let rows = trials.iter().map(|trial| check_trial(folder.path(), trial, &config));
    rows.map(|rows| rows.trials[0].clone()).collect()
}

#[test]
fn poses_of_every_system_give_the_metrics_that_markers_give() {
    let markers = rows(Format::Csv);
    let bodies = rows(Format::MotiveBodies);
    for (a, b) in markers.iter().zip(&bodies) {
        assert_eq!((&a.trial, a.status), (&b.trial, b.status), "{} {}", a.message, b.message);
        println!(
            "{} coverage {:.3} {:.3} white {:?}",
            a.trial, a.coverage, b.coverage, b.noise_white
        );
        assert_eq!(b.noise_white, Some(true), "{}", b.trial);
        if a.kind != TrialKind::Gait {
            continue;
        }
        for (name, a, se_a, b, se_b) in [
            ("d", a.metrics.d_m, a.metrics_se.d_m, b.metrics.d_m, b.metrics_se.d_m),
            (
                "alpha1",
                a.metrics.alpha_rad[0],
                a.metrics_se.alpha_rad[0],
                b.metrics.alpha_rad[0],
                b.metrics_se.alpha_rad[0],
            ),
            (
                "dtheta",
                a.metrics.dtheta_rad,
                a.metrics_se.dtheta_rad,
                b.metrics.dtheta_rad,
                b.metrics_se.dtheta_rad,
            ),
            ("omega", a.omega_rad_s, a.omega_rad_s_se, b.omega_rad_s, b.omega_rad_s_se),
        ]
        .into_iter()
        .chain((0..3).map(|i| {
            let [a, b] = [a, b].map(|row| row.sigma_debiased[i]);
            ("sigma", a.value, a.se, b.value, b.se)
        })) {
            println!("{name} {a:.6} +- {se_a:.6}, {b:.6} +- {se_b:.6}");
            // The poses come from the same motion and noise, but from all markers of a link.
            assert!((a - b).abs() < 1.5 * se_a.max(se_b), "{name}: {a} {b} +- {se_a} {se_b}");
            assert!((0.5..2.0).contains(&(se_b / se_a)), "{name}: {se_a} {se_b}");
        }
    }
    // The other formats have the same poses to their written digits.
    for format in [Format::Tracker, Format::Qualisys6d] {
        for (a, b) in bodies.iter().zip(rows(format)) {
            assert_eq!(
                (a.status, a.cycles),
                (b.status, b.cycles),
                "{format} {}: {}",
                a.trial,
                b.message
            );
            let tolerance_m = 0.05 * a.metrics_se.d_m;
            let difference_m = a.metrics.d_m - b.metrics.d_m;
            println!("{format} {} {:.2e} of {:.2e} m", a.trial, difference_m, a.metrics_se.d_m);
            assert!(a.kind != TrialKind::Gait || difference_m.abs() < tolerance_m, "{format}");
        }
    }
}

#[test]
fn a_body_that_the_file_does_not_have_is_named_and_an_alias_stands_for_it() {
    let mut config = Config::default();
    config.campaign.retain(|name, _| name == "kinematic-symmetric");
    let folder = tempfile::tempdir().unwrap();
    let format = Format::Tracker;
    let recipe = Recipe { omegas_rad_s: vec![3.9], format, ..Recipe::new(5) };
    let mut trials = synthesise(&config, folder.path(), &recipe, &|_| Ok(())).unwrap();
    config.markers = body_layout(&config.markers);
    let path = folder.path().join(&trials[0].file);
    let text = fs::read_to_string(&path).unwrap();
    fs::write(&path, text.replace("front", "Object1")).unwrap();
    let row = &check_trial(folder.path(), &trials[0], &config).trials[0];
    assert!(
        row.message.contains("the file has no marker `front`, which markers.link1"),
        "{}",
        row.message
    );
    assert!(row.message.contains("aliases = { Object1 = \"front\" }"), "{}", row.message);
    trials[0].aliases.insert("Object1".to_owned(), "front".to_owned());
    let row = &check_trial(folder.path(), &trials[0], &config).trials[0];
    assert_eq!(row.status, TrialStatus::Ok, "{}", row.message);
}

#[test]
fn a_body_whose_frame_is_turned_against_its_link_gives_the_same_motion() {
    let mut config = Config::default();
    config.campaign.retain(|name, _| name == "kinematic-skewed");
    let folder = tempfile::tempdir().unwrap();
    let format = Format::Tracker;
    let recipe = Recipe { omegas_rad_s: vec![3.9], format, ..Recipe::new(5) };
    let trial = &synthesise(&config, folder.path(), &recipe, &|_| Ok(())).unwrap()[0];
    let aligned = body_layout(&config.markers);
    config.markers = aligned.clone();
    let expected = check_trial(folder.path(), trial, &config).trials[0].clone();
    let path = folder.path().join(&trial.file);
    let recording = read_markers(&path, LengthUnit::Mm).unwrap();
    for [roll_deg, pitch_deg, yaw_deg] in [[0.0, 0.0, 30.0], [15.0, -30.0, 30.0]] {
        let mut layout = serde_json::to_value(&aligned).unwrap();
        for link in layout.as_object_mut().unwrap().values_mut() {
            for numbers in link.as_object_mut().unwrap().values_mut() {
                for (to, angle_deg) in [3, 4, 5].into_iter().zip([roll_deg, pitch_deg, yaw_deg]) {
                    numbers[to] = angle_deg.into();
                }
            }
        }
        let [roll, pitch, yaw] = [roll_deg, pitch_deg, yaw_deg].map(f64::to_radians);
        let turn = body::turned([(2, yaw), (1, pitch), (0, roll)]);
        let mut turned = recording.clone();
        for first in recording.bodies() {
            for row in 0..recording.frames.len() {
                let (origin_mm, link) = recording.pose(row, first);
                let along = |own: [f64; 3], i: usize| (0..3).map(|k| own[k] * link[k][i]).sum();
                let axes = turn.map(|own| [0, 1, 2].map(|i| along(own, i)));
                let at = row * recording.labels.len() + first;
                turned.positions_mm[at..at + body::POINTS]
                    .copy_from_slice(&body::points(origin_mm, &axes));
            }
        }
        fs::write(&path, format.encode(&trial.id, &turned)).unwrap();
        let untold = check_trial(folder.path(), trial, &config).trials[0].status;
        assert_eq!(untold, TrialStatus::Failed, "the layout is that of the aligned frames");
        let told = Config {
            markers: serde_json::from_value::<Markers>(layout).unwrap(),
            ..config.clone()
        };
        let row = &check_trial(folder.path(), trial, &told).trials[0];
        assert_eq!((row.status, row.cycles), (expected.status, expected.cycles), "{}", row.message);
        for (name, found, expected, se) in [
            ("d", row.metrics.d_m, expected.metrics.d_m, expected.metrics_se.d_m),
            (
                "alpha1",
                row.metrics.alpha_rad[0],
                expected.metrics.alpha_rad[0],
                expected.metrics_se.alpha_rad[0],
            ),
            (
                "dtheta",
                row.metrics.dtheta_rad,
                expected.metrics.dtheta_rad,
                expected.metrics_se.dtheta_rad,
            ),
        ] {
            println!("{name} {found} {expected} +- {se}");
            // The poses are equal to their written digits.
            assert!((found - expected).abs() < 0.05 * se, "{name}: {found} {expected} +- {se}");
        }
    }
}
