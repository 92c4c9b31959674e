//! Robots of two to eight links: recordings of simulated steady motions, whose metrics must be found again.

use std::collections::BTreeSet;
use std::path::PathBuf;

use trilink_mechanics::{Problem, REFERENCE_ACCURACY};
use trilink_robot::decay::DecayLaw;
use trilink_robot::{
    Chain, Drag, FreeJoint, Joint, JointCommand, Laws, Link, Pose, TorqueCommand, Wheel,
    WheelFriction, in_world,
};
use trilink_synth::{Recipe, synthesise};
use trilink_tables::config::{RobotConfig, Smoothing};
use trilink_tables::trial::TrialKind;

use super::*;
use crate::calibrate::{Body, JointMisfits, rigid_groups};
use crate::geometry::Geometry;
use crate::identification::floor::estimate_slopes;
use crate::markers::layout::LinkMarker;

const RATE_HZ: f64 = 120.0;
const CYCLES: usize = 14;
/// Standard deviation of the position of link 0's origin due to errors of the joint positions, m. It changes the
/// displacement of a robot that turns, and the standard error of the displacement does not include it.
const ORIGIN_M: f64 = 5e-5;
/// Positions of the markers on every link, mm.
const MARKERS_MM: [[f64; 3]; 4] =
    [[45.0, 30.0, 60.0], [-40.0, 25.0, 62.0], [-35.0, -30.0, 58.0], [30.0, -20.0, 61.0]];

/// Returns a link, given the places of its joints ahead and behind and of its centre of mass, m, its mass, kg, its
/// moment of inertia, kg m^2, and its wheel's resistance to skidding, kg/s.
fn link([front_joint_m, rear_joint_m, com_m, mass_kg, inertia_kg_m2, skid_kg_s]: [f64; 6]) -> Link {
    let friction =
        WheelFriction { skid_kg_s, roll_kg_s: 0.4, ..Robot::kinematic().wheel_friction(0) };
    Link {
        name: String::new(),
        front_joint_m,
        rear_joint_m,
        com_m,
        mass_kg,
        inertia_kg_m2,
        wheel: Some(Wheel { place_m: 0.0, steer_rad: 0.0, friction }),
        drag: Drag::default(),
        rotor: None,
    }
}

const FRONT: [f64; 6] = [0.0, 0.1, -0.04, 0.25, 6e-4, 60.0];
const MIDDLE: [f64; 6] = [0.11, 0.13, 0.01, 0.9, 7e-3, 90.0];
const SECOND: [f64; 6] = [0.12, 0.1, -0.01, 0.6, 4e-3, 70.0];
const REAR: [f64; 6] = [0.12, 0.0, 0.05, 0.22, 5e-4, 50.0];

fn driven(amplitude_deg: f64, phase_deg: f64) -> Joint {
    Joint::Driven(JointCommand::new(0.0, amplitude_deg.to_radians(), phase_deg.to_radians()))
}

fn spring() -> Joint {
    Joint::Free(FreeJoint {
        stiffness_nm_rad: 0.2,
        damping_nm_s_rad: 0.01,
        target: JointCommand::default(),
        torque: TorqueCommand::default(),
    })
}

fn chain<const N: usize>(links: [[f64; 6]; N], joints: &[Joint], reference: usize) -> Chain {
    let links = links.map(link).to_vec();
    Chain { links, joints: joints.to_vec(), reference, skid_length_m: 0.11 }
}

/// Robot with the index of the link that has no markers, and the number of frames per cycle.
struct Case {
    chain: Chain,
    bare: Option<usize>,
    frames: usize,
}

fn cases() -> Vec<(&'static str, Case)> {
    let tractor = [0.0, 0.22, -0.02, 1.1, 9e-3, 120.0];
    let trailer = [0.15, 0.0, 0.05, 0.4, 1.2e-3, 60.0];
    let four = [FRONT, MIDDLE, SECOND, REAR];
    let four_driven = [driven(28.0, 0.0), driven(28.0, -70.0), spring()];
    let six = [FRONT, MIDDLE, SECOND, MIDDLE, SECOND, REAR];
    let six_driven: Vec<Joint> =
        (0..5).map(|joint| driven(22.0, -50.0 * f64::from(joint))).collect();
    let mut steered = chain(four, &four_driven, 1);
    for (link, place_m, steer_rad) in [(0, 0.02, 0.12), (3, -0.03, -0.05)] {
        let wheel = steered.links[link].wheel.as_mut().unwrap();
        (wheel.place_m, wheel.steer_rad) = (place_m, steer_rad);
    }
    let mut wheelless = chain(four, &four_driven, 2);
    wheelless.links[1].wheel = None;
    let case = |chain, bare, frames| Case { chain, bare, frames };
    vec![
        ("two links", case(chain([tractor, trailer], &[driven(35.0, 0.0)], 0), None, 240)),
        ("four links with a free joint", case(chain(four, &four_driven, 1), None, 240)),
        ("six driven links", case(chain(six, &six_driven, 3), None, 240)),
        ("second link without markers", case(chain(four, &four_driven, 2), Some(1), 240)),
        ("reference link without markers", case(chain(four, &four_driven, 1), Some(1), 240)),
        ("steered wheels", case(steered, None, 240)),
        ("link without a wheel", case(wheelless, None, 240)),
    ]
}

impl Case {
    fn problem(&self) -> Problem {
        let omega_rad_s = std::f64::consts::TAU * RATE_HZ / self.frames as f64;
        Problem::new(self.chain.clone(), self.chain.gait(), Laws::SKID_ROLL, omega_rad_s)
    }

    /// Records the markers in several cycles of the steady motion.
    fn recorded(&self, noise_mm: f64, seed: u64) -> (trilink_mocap::Recording, Layout) {
        let samples = self.problem().cycle(REFERENCE_ACCURACY, self.frames).unwrap();
        let order = Geometry::new(&self.chain).order;
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut positions_mm = Vec::new();
        let mut start = Pose { x_m: 0.3, y_m: -0.2, theta_rad: 0.7 };
        for cycle in 0..CYCLES {
            for sample in &samples[..self.frames + usize::from(cycle + 1 == CYCLES)] {
                let mut links = self.chain.link_poses(start * sample.pose, &sample.phi_rad);
                if let Some(bare) = self.bare {
                    links.remove(bare);
                }
                for Pose { x_m, y_m, theta_rad } in links {
                    for [x, y, z] in MARKERS_MM {
                        let [x, y] = in_world([1e3 * x_m, 1e3 * y_m], theta_rad, [x, y]);
                        positions_mm.push([x, y, z].map(|mm| {
                            let noise: f64 = StandardNormal.sample(&mut random);
                            mm + noise_mm * noise
                        }));
                    }
                }
            }
            start = start * samples[self.frames].pose;
        }
        let mut layout = vec![Vec::new(); self.chain.links.len()];
        let mut labels = Vec::new();
        for (place, link) in order.into_iter().enumerate().filter(|(i, _)| Some(*i) != self.bare) {
            for [x, y, height_mm] in MARKERS_MM {
                let column = labels.len();
                labels.push(format!("link{place}-{column}"));
                layout[link].push(LinkMarker { column, local_position_mm: [x, y], height_mm });
            }
        }
        let rows = positions_mm.len() / labels.len();
        let frames = (1..).take(rows).collect();
        (trilink_mocap::Recording::new(Some(RATE_HZ), frames, labels, positions_mm), layout)
    }

    fn processed(
        &self,
        (file, layout): (trilink_mocap::Recording, Layout),
        smoothing_window: Option<usize>,
        settings: &IngestSettings,
    ) -> ProcessedTrial {
        let labels_of = |markers: &Vec<LinkMarker>| {
            markers.iter().map(|marker| file.labels[marker.column].clone()).collect()
        };
        let labels: Vec<Vec<String>> = layout.iter().map(labels_of).collect();
        let geometry = Geometry::new(&self.chain);
        let linkage = Linkage::new(&geometry, |link| layout[link].is_empty());
        let recording =
            TrialRecording { file, settings, layout, missing: None, linkage, rate_hz: RATE_HZ };
        let joints = self.chain.joints.iter().map(|joint| match joint {
            Joint::Driven(command) => Some(*command),
            Joint::Free(_) => None,
        });
        let omega_rad_s = self.problem().omega_rad_s;
        let command = Some(Command { joints: joints.collect(), omega_rad_s });
        let mut trial = gait_trial("a", "chain", omega_rad_s);
        trial.smoothing_window = smoothing_window;
        let subject = Subject { geometry, command, robot: self.chain.clone().into() };
        let mut partial = PartialResult::new(&trial);
        process_markers(recording, &labels, &trial, &subject, &mut partial).unwrap()
    }

    /// Returns the names of the metrics with their true values and those of a row: displacement, rotation, skid ratios
    /// and amplitudes; `sigma` are the skid ratios by link.
    fn metrics(&self, row: &TrialRow, sigma: &[Estimate]) -> Vec<(String, f64, Estimate)> {
        let motion = self.problem().solve(REFERENCE_ACCURACY).unwrap().metrics;
        let (means, errors) = (&row.metrics, &row.metrics_se);
        let of = |value: f64, se: f64| Estimate { value, se };
        let mut metrics = vec![
            ("d".to_owned(), motion.d_m, of(means.d_m, errors.d_m)),
            ("dtheta".to_owned(), motion.dtheta_rad, of(means.dtheta_rad, errors.dtheta_rad)),
        ];
        for (place, link) in Geometry::new(&self.chain).order.into_iter().enumerate() {
            if self.chain.links[place].wheel.is_some() {
                metrics.push((format!("sigma{link}"), motion.sigma[link], sigma[link]));
            } else {
                assert!(sigma[link].value.is_nan());
            }
        }
        for (joint, truth) in motion.alpha_rad[..self.chain.joints.len()].iter().enumerate() {
            let found = of(means.alpha_rad[joint], errors.alpha_rad[joint]);
            metrics.push((format!("alpha{}", joint + 1), *truth, found));
        }
        metrics
    }
}

#[test]
fn metrics_of_chains_are_found_without_noise() {
    let mut config = Config::default();
    config.ingest.smoothing = Smoothing::MovingAverage;
    let settings = IngestSettings::new(&config);
    for (name, case) in cases() {
        let row = case.processed(case.recorded(0.0, 0), Some(1), &settings).row;
        let sigma = row.metrics.sigma.map(|value| Estimate { value, se: f64::NAN });
        for (metric, truth, found) in case.metrics(&row, &sigma) {
            let error = (found.value - truth).abs();
            // The extremes of an angle are those at 360 phases.
            let short = if metric.starts_with("alpha") { 4e-5 * truth } else { 0.0 };
            assert!(error < 1e-6 + short, "{name}: {metric} = {}, not {truth}", found.value);
        }
    }
}

#[test]
fn metrics_of_chains_agree_with_the_simulation_within_their_errors() {
    let config = Config::default();
    let settings = IngestSettings::new(&config);
    let (mut squares, mut count) = (0.0, 0.0);
    for (name, case) in cases() {
        let row = case.processed(case.recorded(0.1, 3), None, &settings).row;
        for (metric, truth, found) in case.metrics(&row, &row.all_debiased()) {
            let dtheta_rad = row.metrics.dtheta_rad;
            let se = if metric == "d" { found.se.hypot(ORIGIN_M * dtheta_rad) } else { found.se };
            let deviation = (found.value - truth) / se;
            assert!(
                deviation.abs() < 4.0,
                "{name}: {metric} = {} +- {se}, not {truth}",
                found.value
            );
            squares += deviation * deviation;
            count += 1.0;
        }
    }
    let rms = f64::sqrt(squares / count);
    assert!((0.3..1.3).contains(&rms), "{rms}");
}

#[test]
fn a_tilted_floor_is_corrected_although_a_link_has_no_markers() {
    let settings = IngestSettings::new(&Config::default());
    for (name, case) in cases().into_iter().filter(|(_, case)| case.bare.is_some()) {
        let (mut file, layout) = case.recorded(0.1, 4);
        let (sin, cos) = 1_f64.to_radians().sin_cos();
        for [_, y, z] in &mut file.positions_mm {
            (*y, *z) = (cos * *y - sin * *z, sin * *y + cos * *z);
        }
        let row = case.processed((file, layout), None, &settings).row;
        assert!(row.message.contains("the floor is tilted by 1.0"), "{name}: {}", row.message);
    }
}

#[test]
fn the_order_of_the_links_is_found_from_the_motion_of_their_markers() {
    for (name, case) in cases().into_iter().filter(|(_, case)| case.bare.is_none()) {
        let (file, _) = case.recorded(0.1, 5);
        let groups = rigid_groups(&file);
        let links = case.chain.links.len();
        // The markers of each link are in neighbouring columns, from front to rear; the bodies are shuffled.
        let of_link: Vec<Vec<usize>> =
            (0..links).map(|link| (4 * link..4 * link + 4).collect()).collect();
        assert_eq!(groups, of_link, "{name}");
        let shuffled: Vec<usize> = (0..links)
            .step_by(2)
            .chain((1..links).step_by(2).collect::<Vec<_>>().into_iter().rev())
            .collect();
        let bodies = shuffled.iter().map(|link| Body::fit(&file, &groups[*link]).unwrap());
        let chain = JointMisfits::new(&bodies.collect::<Vec<_>>()).chain(2.0);
        let mut found: Vec<usize> = chain.into_iter().map(|body| shuffled[body]).collect();
        if found.first() > found.last() {
            found.reverse();
        }
        assert_eq!(found, (0..links).collect::<Vec<_>>(), "{name}");
    }
}

/// Returns the configuration of a robot of the gallery.
fn gallery(robot: &str) -> Config {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../docs/robots");
    Config::load(&folder.join(robot).with_extension("toml")).unwrap()
}

/// Synthesises trials of a configuration and returns those of all kinds but `gait` or, with a frequency, of all kinds,
/// with the rows of each.
fn synthetic(config: &Config, seed: u64, omega_rad_s: Option<f64>) -> Vec<(Trial, Ingested)> {
    let folder = tempfile::tempdir().unwrap();
    let omegas_rad_s = omega_rad_s.into_iter().collect();
    let recipe = Recipe { omegas_rad_s, ..Recipe::new(seed) };
    let trials = synthesise(config, folder.path(), &recipe, &|_| Ok(())).unwrap();
    let rows = trials.iter().map(|trial| check_trial(folder.path(), trial, config));
    trials.iter().cloned().zip(rows).collect()
}

#[test]
fn releases_and_coast_downs_of_chains_give_back_the_planted_numbers() {
    let mut deviations: Vec<(String, f64)> = Vec::new();
    let mut released = BTreeSet::new();
    for robot in ["twistcar", "elastic-snake", "passive-snake", "driven-snake", "rotor-car"] {
        let mut config = gallery(robot);
        if let Some(chain) = config.robot.get_mut("passive").and_then(RobotConfig::chain_mut) {
            // The last joint swings as well.
            chain.joints[2].damping_nm_s_rad = Some(0.002);
        }
        for seed in 1..=3 {
            for (trial, rows) in synthetic(&config, seed, None) {
                let name = &trial.id;
                assert_eq!(rows.trials[0].status, TrialStatus::Ok, "{}", rows.trials[0].message);
                let [row] = &rows.parameters[..] else { panic!("{name}: no parameters") };
                assert_eq!(row.law, Some(DecayLaw::Viscous), "{name}");
                let joint = usize::try_from(row.joint).unwrap();
                let mut add = |what: &str, Estimate { value, se }: Estimate, truth: f64| {
                    assert!((value / truth - 1.0).abs() < 0.03, "{name}: {what} {value} {truth}");
                    deviations.push((format!("{name} {seed}: {what}"), (value - truth) / se));
                };
                let chain = config.robot[trial.robot.as_ref().unwrap()].chain().unwrap();
                if trial.kind == TrialKind::JointRelease {
                    assert!(trial.id.contains(&format!("joint{joint}")), "{name}: joint {joint}");
                    released.insert((robot, joint));
                    let joint = &chain.joints[joint - 1];
                    add("k", row.stiffness_nm_rad, joint.stiffness_nm_rad.unwrap());
                    add("c", row.damping_nm_s_rad, joint.damping_nm_s_rad.unwrap());
                } else {
                    let of_wheels = chain.links.iter().filter_map(|link| link.roll_kg_s);
                    add("roll", row.roll_sum_kg_s, of_wheels.sum());
                    let shares = row.roll_kg_s.iter().chain(&*row.more_roll_kg_s);
                    let shares: Vec<f64> = shares.map(|of| of.value).collect();
                    let has_wheel = chain.links.iter().filter(|link| link.wheel_m.is_some());
                    assert_eq!(shares.iter().filter(|x| !x.is_nan()).count(), has_wheel.count());
                }
            }
        }
    }
    let all = [("elastic-snake", 1), ("elastic-snake", 2), ("passive-snake", 2)];
    assert_eq!(released, all.into_iter().chain([("passive-snake", 3), ("rotor-car", 1)]).collect());
    let squares: f64 = deviations.iter().map(|(_, z)| z * z).sum();
    let rms = (squares / deviations.len() as f64).sqrt();
    let worst = deviations.iter().max_by(|a, b| a.1.abs().total_cmp(&b.1.abs())).unwrap();
    assert!(worst.1.abs() < 4.0 && rms < 1.4, "{rms} {worst:?}");
}

#[test]
fn a_slope_is_told_from_the_dry_friction_of_a_chain() {
    let mut config = gallery("driven-snake");
    for link in &mut config.robot.get_mut("snake").unwrap().chain_mut().unwrap().links {
        link.roll_dry_n = Some(0.02);
    }
    let folder = tempfile::tempdir().unwrap();
    let slope = Some(trilink_synth::Slope { slope_deg: 0.3, direction_deg: 30.0 });
    let recipe = Recipe { omegas_rad_s: Vec::new(), slope, ..Recipe::new(4) };
    let trials = synthesise(&config, folder.path(), &recipe, &|_| Ok(())).unwrap();
    let mut all = Ingested::default();
    for trial in &trials {
        let Ingested { trials, checks, parameters } = check_trial(folder.path(), trial, &config);
        all.trials.extend(trials);
        all.checks.extend(checks);
        all.parameters.extend(parameters);
    }
    let robots = config.robot.iter();
    let roll_kg_s =
        robots.map(|(name, robot)| (name.clone(), robot.to_robot(&Default::default()).roll_kg_s()));
    estimate_slopes(&mut all, &roll_kg_s.collect());
    let row = &all.parameters[0];
    assert_eq!((row.law, row.pooled_trials), (Some(DecayLaw::CoulombViscous), 4));
    for (Estimate { value, se }, truth) in [
        (row.roll_sum_kg_s, 2.1),
        (row.roll_dry_sum_n, 0.14),
        (row.slope_x_rad, 0.3_f64.to_radians() * 30_f64.to_radians().cos()),
    ] {
        assert!(
            (value - truth).abs() < 4.0 * se && se < 0.05 * truth,
            "{value} +- {se}, not {truth}"
        );
    }
    let last = row.more_roll_kg_s.last().expect("seven wheels");
    assert_eq!(row.more_roll_kg_s.len(), 4);
    assert!((7.0 * last.value - row.roll_sum_kg_s.value).abs() < 1e-9);
}

#[test]
fn a_gait_dominated_by_its_second_harmonic_has_the_commanded_frequency() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("pipeline.toml");
    let text = include_str!("../../../../docs/robots/twistcar.toml");
    let gait = "joint1 = { amplitude_deg = 0.1, amplitude2_deg = 25.0 }";
    std::fs::write(&path, text.replace("joint1 = { amplitude_deg = 30.0 }", gait)).unwrap();
    let trials = synthetic(&Config::load(&path).unwrap(), 1, Some(2.0));
    let (trial, rows) = trials.iter().find(|(trial, _)| trial.kind == TrialKind::Gait).unwrap();
    let row = &rows.trials[0];
    assert_eq!((row.status, row.message.as_str()), (TrialStatus::Ok, ""));
    assert!((row.omega_rad_s / trial.omega_rad_s.unwrap() - 1.0).abs() < 1e-3);
    assert!((row.gait[0].amplitude_rad.to_degrees() - 0.1).abs() < 0.02);
    assert!((row.metrics.alpha_rad[0].to_degrees() - 25.0).abs() < 0.5);
}

#[test]
fn standard_deviations_of_a_chain_do_not_concern_the_ingest() {
    let text = include_str!("../../../../docs/robots/twistcar.toml");
    let mass = "mass_kg = 0.3\n";
    let input = |text: &str| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("pipeline.toml");
        std::fs::write(&path, text).unwrap();
        let trial = gait_trial("a", "twistcar", 3.0);
        IngestInput::new(&Config::load(&path).unwrap(), &trial).unwrap()
    };
    let uncertain = text.replacen(mass, "mass_kg = { value = 0.3, sd = \"1 %\" }\n", 1);
    assert_ne!(uncertain, text);
    assert_eq!(input(&uncertain), input(text));
    assert_ne!(input(&text.replacen(mass, "mass_kg = 0.4\n", 1)), input(text));
}

#[test]
fn a_release_of_a_driven_joint_is_refused() {
    let mut config = gallery("passive-snake");
    for joint in &mut config.robot.get_mut("passive").unwrap().chain_mut().unwrap().joints[1..] {
        joint.stiffness_nm_rad = Some(5.0);
    }
    let folder = tempfile::tempdir().unwrap();
    let recipe = Recipe { omegas_rad_s: vec![4.0], ..Recipe::new(1) };
    let trials = synthesise(&config, folder.path(), &recipe, &|_| Ok(())).unwrap();
    let gait = trials.into_iter().find(|trial| trial.kind == TrialKind::Gait).unwrap();
    let robot = Some("passive".to_owned());
    let kind = TrialKind::JointRelease;
    let trial = Trial { kind, robot, campaign: None, omega_rad_s: None, ..gait };
    let row = &check_trial(folder.path(), &trial, &config).trials[0];
    assert_eq!(row.status, TrialStatus::Failed);
    assert!(row.message.contains("joint 1 moves farthest, but it is driven"), "{}", row.message);
}
