//! Layouts estimated from synthetic trials, compared with the true layouts.

use rayon::prelude::*;
use trilink_statistics::median;
use trilink_synth::{Recipe, synthesise};
use trilink_tables::config::{CommandConfig, GaitConfig, JointKind, RobotConfig};

use super::*;

fn trials(recipe: &Recipe) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    synthesise(&Config::default(), folder.path(), recipe, &|_| Ok(())).unwrap();
    folder
}

/// Returns a link of three by its number.
fn of_number(found: &Calibration, link: usize) -> &LinkCalibration {
    &found.layout.links[[1, 0, 2][link]]
}

/// Returns the largest error in a link's marker positions, mm, and the error in their rotation about the link's joint,
/// rad.
fn errors(found: &Calibration, link: usize) -> (f64, f64) {
    let truth = Config::default().markers;
    let joint_mm = [0.0, -112.0, 112.0][link];
    let pairs: Vec<([f64; 2], [f64; 2])> = of_number(found, link)
        .markers
        .iter()
        .map(|marker| {
            let [x, y, z] = marker.position_mm.map(|measured| measured.value);
            let [tx, ty, tz] = truth.links()[link][&marker.label];
            assert!((z - tz).abs() < 0.2, "{}: {z}", marker.label);
            ([x - joint_mm, y], [tx - joint_mm, ty])
        })
        .collect();
    let (cross, dot) = pairs.iter().fold((0.0, 0.0), |(cross, dot), ([x, y], [tx, ty])| {
        (cross + tx * y - ty * x, dot + tx * x + ty * y)
    });
    let turned = if link == 0 { 0.0 } else { f64::atan2(cross, dot) };
    let (sin, cos) = turned.sin_cos();
    let errors_mm = pairs
        .iter()
        .map(|([x, y], [tx, ty])| (x - cos * tx + sin * ty).hypot(y - sin * tx - cos * ty));
    (errors_mm.fold(0.0, f64::max), turned)
}

#[test]
fn layouts_and_h_are_found_to_a_fifth_of_a_millimetre() {
    for seed in 1..=3 {
        let folder = trials(&Recipe { omegas_rad_s: vec![2.0, 3.9], ..Recipe::new(seed) });
        for gait in ["kinematic-symmetric", "semi-passive-symmetric"] {
            for omega in ["2.00", "3.90"] {
                let id = format!("{gait}-{omega}-r1");
                let found = calibrate(&Config::default(), folder.path(), &id).unwrap();
                let h_mm = found.layout.h_mm().unwrap();
                assert!((h_mm.value - 144.0).abs() < 0.15 && h_mm.se < 0.15, "{id}: {h_mm:?}");
                assert!(!found.is_grouped && found.left_out.is_empty());
                for link in 0..3 {
                    let (error_mm, turned) = errors(&found, link);
                    assert!(error_mm < 0.2, "{id}, link {link}: {error_mm}");
                    assert!(turned.to_degrees().abs() < 0.25, "{id}, link {link}: {turned}");
                }
            }
        }
    }
}

/// Returns errors and standard errors of the side links' directions, degrees, for synthetic gaits in which the middle
/// link is oblique by a given angle.
fn directions(seeds: std::ops::RangeInclusive<u64>, oblique_deg: f64) -> Vec<[f64; 2]> {
    let mut config = Config::default();
    let gait = config.gait.get_mut("symmetric").unwrap();
    gait.joint1.as_mut().unwrap().offset_deg = Some(oblique_deg);
    gait.joint2.as_mut().unwrap().offset_deg = Some(-oblique_deg);
    config.campaign.retain(|name, _| name == "kinematic-symmetric");
    let of_seed = |seed: u64| {
        let folder = tempfile::tempdir().unwrap();
        let recipe = Recipe { omegas_rad_s: vec![3.0, 5.0], ..Recipe::new(seed) };
        synthesise(&config, folder.path(), &recipe, &|_| Ok(())).unwrap();
        let directions = ["3.00", "5.00"].map(|omega| {
            let id = format!("kinematic-symmetric-{omega}-r1");
            let found = calibrate(&config, folder.path(), &id).unwrap();
            [1, 2].map(|link| {
                [errors(&found, link).1.to_degrees(), of_number(&found, link).direction_se_deg]
            })
        });
        directions.concat()
    };
    seeds.into_par_iter().flat_map_iter(of_seed).collect()
}

/// Returns the fraction of errors within 1.96 standard errors, and the ratio of median standard error to RMS error.
fn evaluate(found: &[[f64; 2]]) -> [f64; 2] {
    let count = found.len() as f64;
    let within = found.iter().filter(|[off, se]| off.abs() < 1.96 * se).count() as f64 / count;
    let rms = (found.iter().map(|[off, _]| off * off).sum::<f64>() / count).sqrt();
    [within, median(found.iter().map(|[_, se]| *se).collect()) / rms]
}

#[test]
fn standard_errors_of_directions_are_right() {
    for oblique_deg in [0.0, 1.5] {
        let found = directions(1..=3, oblique_deg);
        let [within, width] = evaluate(&found);
        println!("{oblique_deg}: {within:.3} within 1.96, stated {width:.2} of the RMS error");
        assert!(within > 0.8 && (0.5..3.5).contains(&width), "{within} {width} {found:?}");
    }
}

#[test]
#[ignore = "60 folders"]
fn standard_errors_of_the_directions_of_thirty_gaits_are_right() {
    for oblique_deg in [0.0, 1.5] {
        let [within, width] = evaluate(&directions(101..=130, oblique_deg));
        println!("{oblique_deg}: {within:.3} within 1.96, stated {width:.2} of the RMS error");
        assert!(within >= 0.9 && (0.7..3.0).contains(&width), "{within} {width}");
    }
}

#[test]
fn standard_errors_of_h_are_right() {
    let mut within = 0;
    let mut count = 0;
    for seed in 11..=16 {
        let folder = trials(&Recipe { omegas_rad_s: vec![3.0, 5.0], ..Recipe::new(seed) });
        for omega in ["3.00", "5.00"] {
            let id = format!("kinematic-symmetric-{omega}-r1");
            let h_mm = calibrate(&Config::default(), folder.path(), &id).unwrap();
            let h_mm = h_mm.layout.h_mm().unwrap();
            within += usize::from((h_mm.value - 144.0).abs() < 2.0 * h_mm.se);
            count += 1;
        }
    }
    assert!(within * 10 >= count * 8, "{within} of {count}");
}

#[test]
fn links_are_found_by_the_motion_of_the_markers_if_their_labels_are_not_configured() {
    let folder = trials(&Recipe { omegas_rad_s: vec![3.9], misplaced: 0.05, ..Recipe::new(7) });
    let mut config = Config::default();
    for link in [&mut config.markers.link0, &mut config.markers.link1, &mut config.markers.link2] {
        *link = link.iter().map(|(label, position)| (format!("old-{label}"), *position)).collect();
    }
    for gait in config.campaign.keys().filter(|gait| *gait != "kinematic-skewed") {
        let id = &format!("{gait}-3.90-r1");
        let found = calibrate(&config, folder.path(), id);
        if gait == "semi-passive-symmetric" {
            // The passive joint swings as far as the driven one.
            let error = found.unwrap_err().to_string();
            assert!(error.contains("which end of the robot is the front"), "{error}");
            continue;
        }
        let found = found.unwrap();
        assert!(found.is_grouped);
        let labels = [0, 1, 2].map(|link| {
            of_number(&found, link)
                .markers
                .iter()
                .map(|marker| marker.label.as_str())
                .collect::<Vec<_>>()
                .join(" ")
        });
        assert_eq!(labels, ["M1 M2 M3 M4", "F1 F2 F3", "R1 R2 R3"]);
        for link in 0..3 {
            let (error_mm, _) = errors(&found, link);
            assert!(error_mm < 0.25, "{id}, link {link}: {error_mm}");
        }
    }
}

#[test]
fn a_trial_that_does_not_determine_the_layout_gives_the_reason() {
    let folder = trials(&Recipe { omegas_rad_s: vec![3.9], ..Recipe::new(1) });
    let message = |config: &Config, id: &str| {
        let error = calibrate(config, folder.path(), id).unwrap_err().to_string();
        error.replace(&folder.path().display().to_string(), "F")
    };
    let config = Config::default();
    assert_eq!(
        message(&config, "kinematic-symetric-3.90-r1"),
        "F: trials.toml has no trial `kinematic-symetric-3.90-r1`; \
         did you mean `kinematic-symmetric-3.90-r1`?"
    );
    let straight = message(&config, "kinematic-coast-down-r1");
    assert!(straight.starts_with("F/kinematic-coast-down-r1.csv: joint 1 turns by only 0."));
    assert!(straight.ends_with("use a trial in which all joints move"), "{straight}");
    let bent = message(&config, "kinematic-skewed-3.90-r1");
    let found = "F/kinematic-skewed-3.90-r1.csv: the gait's mean joint angle is 45.0 degrees";
    assert!(
        bent.starts_with(found)
            && bent.contains("use a trial whose gait oscillates about the straight configuration"),
        "{bent}"
    );
    // The links are bent on average, although the command has no offsets.
    let mut silent = config.clone();
    let gait = silent.gait.get_mut("skewed").unwrap();
    for joint in [&mut gait.joint1, &mut gait.joint2] {
        joint.as_mut().unwrap().offset_deg = None;
    }
    let bent = message(&silent, "kinematic-skewed-3.90-r1");
    assert!(bent.contains("the gait's mean joint angle is "), "{bent}");
    let mut unknown = config;
    unknown.markers.link0.insert("M9".to_owned(), [0.0; 3]);
    let one = message(&unknown, "kinematic-coast-down-r1");
    assert!(one.contains(": found 1 group of markers that move rigidly together ("), "{one}");
    assert!(one.contains("but three groups are needed, one for each link"), "{one}");
}

/// Returns the configuration of a robot of the gallery.
fn gallery(robot: &str) -> Config {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/robots");
    Config::load(&folder.join(robot).with_extension("toml")).unwrap()
}

/// Calibrates the layout of a chain from a synthetic trial of `config`, with another configuration.
fn calibrated_chain(
    config: &Config,
    calibrate_with: &Config,
    omega_rad_s: f64,
) -> Result<Calibration, String> {
    let folder = tempfile::tempdir().unwrap();
    let recipe = Recipe { omegas_rad_s: vec![omega_rad_s], ..Recipe::new(1) };
    let trials = synthesise(config, folder.path(), &recipe, &|_| Ok(())).unwrap();
    calibrate(calibrate_with, folder.path(), &trials[0].id).map_err(|error| error.to_string())
}

#[test]
fn layouts_of_chains_are_found() {
    for (robot, expected) in [
        ("twistcar", &[Direction::Wheel, Direction::Wheel][..]),
        (
            "passive-snake",
            &[Direction::Wheel, Direction::Joints, Direction::Joints, Direction::MeanAngle],
        ),
    ] {
        let config = gallery(robot);
        let found = calibrated_chain(&config, &config, 4.0).unwrap();
        assert!(!found.is_grouped && found.left_out.is_empty(), "{robot}");
        let directions: Vec<Direction> =
            found.layout.links.iter().map(|link| link.direction).collect();
        assert_eq!(directions, expected, "{robot}");
        for (link, places) in found.layout.links.iter().zip(&found.places) {
            let configured_mm = [places.front_joint_mm, places.rear_joint_mm];
            for (joint, configured_mm) in link.joints_mm.iter().zip(configured_mm) {
                let Some(joint) = joint else { continue };
                assert!((joint.value - configured_mm).abs() < 0.15, "{robot}: {joint:?}");
            }
            // The directions of end links are known to half a degree, at 150 mm from the joint.
            for marker in &link.markers {
                let configured = marker.configured_mm.expect("it is configured");
                for (axis, found) in marker.position_mm.iter().enumerate() {
                    let off = (found.value - configured[axis]).abs();
                    assert!(off < 1.3 && found.se < 0.3, "{robot} {}: {found:?}", marker.label);
                }
            }
        }
    }
}

/// Returns the error of the direction of a link of a chain, degrees: the angle by which its markers are turned.
fn turned_deg(link: &LinkCalibration) -> f64 {
    let pairs = link.markers.iter().map(|marker| {
        let [x, y, _] = marker.position_mm.map(|estimate| estimate.value);
        let [own_x, own_y, _] = marker.configured_mm.expect("it is configured");
        ([own_x, own_y], [x, y])
    });
    crate::fit_rigid(pairs).expect("markers apart").theta_rad.to_degrees()
}

#[test]
fn mean_skid_to_one_side_does_not_bias_the_ends_of_chains() {
    for (robot, offsets_deg) in [
        ("elastic-snake", &[1.5, -1.5][..]),
        ("passive-snake", &[2.0, 0.0, -2.0]),
        ("driven-snake", &[2.0, 0.0, 0.0, 0.0, 0.0, -2.0]),
    ] {
        let mut config = gallery(robot);
        let chains = config.robot.values_mut().filter_map(RobotConfig::chain_mut);
        let joints = chains.flat_map(|chain| &mut chain.joints);
        for joint in joints {
            joint.kind = JointKind::Driven;
            (joint.stiffness_nm_rad, joint.damping_nm_s_rad) = (None, None);
        }
        let gait = config.gait.values_mut().next().unwrap();
        let GaitConfig { joint1, joint2, joint3, joint4, joint5, joint6, .. } = gait;
        let commands = [joint1, joint2, joint3, joint4, joint5, joint6];
        for (n, (command, offset_deg)) in commands.into_iter().zip(offsets_deg).enumerate() {
            let wave = CommandConfig {
                amplitude_deg: Some(25.0),
                phase_deg: Some(-80.0 * n as f64),
                ..Default::default()
            };
            let command = command.get_or_insert(wave);
            command.offset_deg = Some(*offset_deg);
        }
        let found = calibrated_chain(&config, &config, 4.0).unwrap();
        let ends = found.layout.links.iter().filter(|link| link.direction == Direction::Wheel);
        for end in ends {
            let (error_deg, skid_deg) = (turned_deg(end), end.skid_deg);
            assert!(error_deg.abs() < 0.15, "{robot}: {error_deg} {skid_deg}");
            assert!((error_deg - skid_deg).abs() > 0.4, "{robot}: {error_deg} {skid_deg}");
            assert!(error_deg.abs() < end.direction_se_deg, "{robot}: {error_deg}");
        }
    }
}

#[test]
fn links_of_chains_are_found_although_the_labels_differ() {
    let config = gallery("passive-snake");
    let mut other = config.clone();
    for markers in other.layout.get_mut("passive").unwrap().values_mut() {
        let renamed = markers.0.iter().map(|(label, at)| (format!("other-{label}"), *at));
        markers.0 = renamed.collect();
    }
    let found = calibrated_chain(&config, &other, 6.0).unwrap();
    assert!(found.is_grouped);
    let first = found.layout.links.iter().map(|link| link.markers[0].label.as_str());
    assert_eq!(first.collect::<Vec<_>>(), ["H1", "B1", "T1", "N1"]);
    // Without a driven joint nothing shows which end is the front.
    for joint in &mut other.robot.get_mut("passive").unwrap().chain_mut().unwrap().joints {
        joint.kind = JointKind::Elastic;
    }
    let error = calibrated_chain(&config, &other, 6.0).unwrap_err();
    assert!(error.contains("which end of the robot is the front"), "{error}");
}

#[test]
fn steered_wheels_do_not_show_the_directions_of_two_links() {
    let config = gallery("roller-racer");
    let error = calibrated_chain(&config, &config, 4.0).unwrap_err();
    assert!(error.contains("link `handlebar` has no wheel that rolls along it"), "{error}");
}
