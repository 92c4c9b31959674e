//! The paper's experiment as the default configuration.

use std::collections::BTreeMap;

use super::*;

impl Default for Config {
    fn default() -> Self {
        Self {
            paths: Paths::default(),
            vicon: Vicon::default(),
            ingest: Ingest::default(),
            fit: Fit::default(),
            robot: robots(),
            gait: gaits(),
            campaign: campaigns(),
            markers: Markers::default(),
            compare: Compare::default(),
        }
    }
}

impl Default for Paths {
    fn default() -> Self {
        Self { raw: "raw/demo".into(), derived: "derived".into(), reports: "reports".into() }
    }
}

impl Default for Vicon {
    fn default() -> Self {
        Self { rate_hz: 120.0, rate_from_file: false, ignore: Vec::new() }
    }
}

impl Default for Ingest {
    fn default() -> Self {
        Self {
            poses: Poses::Chain,
            smoothing_window: Smoothing::Auto,
            max_gap_s: 0.1,
            max_residual_mm: 0.5,
            skip_cycles: 2,
        }
    }
}

impl Default for Fit {
    fn default() -> Self {
        Self {
            skid_bounds_kg_s: [1.0, 1000.0],
            roll_bounds_kg_s: [0.01, 10.0],
            stiffness_bounds_nm_rad: [0.01, 10.0],
            damping_bounds_nm_s_rad: [1e-4, 1.0],
            starts: 8,
            bootstrap: 200,
            seed: 1,
            profiles: true,
            sigma: SigmaKind::Debiased,
            gait_input: GaitInput::Commanded,
            robot_parameters: ParameterSource::Configured,
        }
    }
}

/// Tables I and II with the values used in the paper's simulations.
fn robots() -> BTreeMap<String, RobotConfig> {
    let semi_passive = Robot::semi_passive();
    let spring = RobotConfig {
        stiffness_nm_rad: Some(semi_passive.stiffness_nm_rad),
        damping_nm_s_rad: Some(semi_passive.damping_nm_s_rad),
        rest_angle_deg: Some(semi_passive.rest_angle_rad.to_degrees()),
        ..without_spring(&semi_passive)
    };
    let kinematic = without_spring(&Robot::kinematic());
    BTreeMap::from([("kinematic".into(), kinematic), ("semi-passive".into(), spring)])
}

fn without_spring(robot: &Robot) -> RobotConfig {
    RobotConfig {
        h_m: robot.h_m,
        l_m: robot.l_m,
        b_m: robot.b_m,
        mass_kg: robot.mass_kg,
        inertia_kg_m2: robot.inertia_kg_m2,
        roll_kg_s: robot.roll_kg_s,
        skid_kg_s: robot.skid_kg_s,
        stiffness_nm_rad: None,
        damping_nm_s_rad: None,
        rest_angle_deg: None,
    }
}

/// Eq. 18 and 19.
fn gaits() -> BTreeMap<String, GaitConfig> {
    let joint =
        |offset_deg, phase_deg| Some(JointConfig { offset_deg, amplitude_deg: 30.0, phase_deg });
    BTreeMap::from([
        ("passive-symmetric".into(), GaitConfig { joint1: None, joint2: joint(0.0, 0.0) }),
        ("skewed".into(), GaitConfig { joint1: joint(45.0, 0.0), joint2: joint(-45.0, -90.0) }),
        ("symmetric".into(), GaitConfig { joint1: joint(0.0, 0.0), joint2: joint(0.0, -90.0) }),
    ])
}

/// The three campaigns with the weights of Table III.
fn campaigns() -> BTreeMap<String, Campaign> {
    use Model::{NoSkid, NoSkidDamped, NoSkidMeasured, NoSkidRoll, Skid, SkidRoll};
    let campaign = |robot: &str, gait: &str, models: [Model; 4], sigma, alpha| Campaign {
        robot: robot.into(),
        gait: gait.into(),
        models: models.into(),
        weights: Weights { d: 10.0, v: 1.0, sigma, alpha },
        free: BTreeMap::new(),
    };
    let kinematic = [NoSkid, NoSkidMeasured, Skid, SkidRoll];
    let passive = [NoSkid, NoSkidDamped, NoSkidRoll, SkidRoll];
    BTreeMap::from([
        ("kinematic-skewed".into(), campaign("kinematic", "skewed", kinematic, 1.0, 0.0)),
        ("kinematic-symmetric".into(), campaign("kinematic", "symmetric", kinematic, 0.2, 0.0)),
        (
            "semi-passive-symmetric".into(),
            campaign("semi-passive", "passive-symmetric", passive, 1.0, 50.0),
        ),
    ])
}

/// The layout of the demo's trials: four markers on the middle link, three on each side link,
/// no two links alike.
impl Default for Markers {
    fn default() -> Self {
        let link = |markers: &[(&str, [f64; 3])]| {
            markers.iter().map(|&(label, position)| (label.to_owned(), position)).collect()
        };
        Self {
            link0: link(&[
                ("M1", [110.0, 35.0, 62.0]),
                ("M2", [95.0, -40.0, 62.0]),
                ("M3", [-115.0, 28.0, 62.0]),
                ("M4", [-70.0, -45.0, 80.0]),
            ]),
            link1: link(&[
                ("F1", [45.0, 30.0, 55.0]),
                ("F2", [38.0, -34.0, 55.0]),
                ("F3", [-62.0, 8.0, 70.0]),
            ]),
            link2: link(&[
                ("R1", [-50.0, 26.0, 55.0]),
                ("R2", [-30.0, -36.0, 55.0]),
                ("R3", [58.0, -10.0, 70.0]),
            ]),
        }
    }
}
