//! Campaign of synthetic trials with its fit.

use std::path::Path;
use std::sync::OnceLock;

use serde_json::Value;
use tempfile::TempDir;
use trilink_robot::{Model, Quantity};
use trilink_tables::config::{Config, GaitInput};

use crate::common::{succeed, temporary};

pub const CAMPAIGN: &str = "kinematic-symmetric";
pub const OMEGAS: &str = "1,1.8,2.6,3.4,4.2,5";

/// Returns a shared folder with a fit to synthetic trials, which no test changes.
pub fn folder() -> &'static Path {
    static FOLDER: OnceLock<TempDir> = OnceLock::new();
    FOLDER.get_or_init(|| fitted(0.002)).path()
}

/// Returns a folder with a fit to synthetic trials whose metrics have this relative standard error; with 0, there are
/// neither errors nor standard errors.
pub fn fitted(error: f64) -> TempDir {
    let folder = temporary();
    let mut config = Config::default();
    config.campaign.retain(|name, _| name == CAMPAIGN);
    config.campaign.get_mut(CAMPAIGN).unwrap().models = vec![Model::SKID_ROLL];
    (config.fit.starts, config.fit.bootstrap, config.fit.profiles) = (1, 40, false);
    config.fit.gait_input = GaitInput::Commanded;
    let robot = config.robot.get_mut("kinematic").unwrap().three_links_mut().unwrap();
    robot.set_deviation(Quantity::L, [0.0005]);
    robot.set_deviation(Quantity::Mass, [0.01, 0.0, 0.0]);
    let write = |config: &Config| {
        let text = toml::to_string(config).unwrap();
        std::fs::write(folder.path().join("pipeline.toml"), text).unwrap();
    };
    write(&config);
    let simulate = ["simulate", CAMPAIGN, "--model", "skid-roll", "--omega", OMEGAS, "--json"];
    let simulate = [&simulate[..], &["--set", "skid_kg_s=104,34,45"]].concat();
    let answers: Vec<Value> = serde_json::from_str(&succeed(folder.path(), &simulate)).unwrap();
    let mut csv = "campaign,omega_rad_s,d_m,v_m_s,sigma0,sigma1,sigma2".to_owned();
    csv += if error > 0.0 { ",d_m_se,v_m_s_se,sigma0_se,sigma1_se,sigma2_se\n" } else { "\n" };
    for (nth, answer) in answers.iter().enumerate() {
        let number = |value: &Value| value.as_f64().unwrap();
        let values = ["d_m", "v_m_s"].map(|name| number(&answer[name]));
        let values = values.into_iter().chain((0..3).map(|wheel| number(&answer["sigma"][wheel])));
        let values: Vec<f64> = values.collect();
        csv += &format!("{CAMPAIGN},{}", answer["omega_rad_s"]);
        // Add deterministic errors of up to half of the standard error.
        let off =
            |metric: usize| 1.0 + 0.5 * error * (1.7 * nth as f64 + 2.9 * metric as f64).sin();
        for (metric, value) in values.iter().enumerate() {
            csv += &format!(",{}", value * if metric < 2 { off(0) } else { off(metric) });
        }
        for value in values.iter().filter(|_| error > 0.0) {
            csv += &format!(",{}", error * value);
        }
        csv += "\n";
    }
    std::fs::write(folder.path().join("own.csv"), csv).unwrap();
    succeed(folder.path(), &["fit", "--trials", "own.csv", "--into", "fits"]);
    config.paths.derived = "fits".into();
    write(&config);
    folder
}
