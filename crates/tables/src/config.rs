//! `pipeline.toml`: the robots, gaits, campaigns and settings of a run.
//!
//! `defaults.toml` is the paper's experiment; the repository's `pipeline.toml` begins as its copy.

mod check;
mod compare;
mod error;
mod key;
mod model;
mod paths;
mod robot;
mod settings;
mod strict;

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::LazyLock;

use serde::{Deserialize, Deserializer, Serialize, Serializer};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

pub use check::one_of;
pub use compare::{Compare, Tolerance, Tolerances, tolerance};
pub use error::ConfigError;
pub use error::{did_you_mean, nearest, parse_toml};
pub use key::toml_key;
pub use model::{Free, GaitInput, ModelConfig, Models};
pub use paths::{Paths, is_pattern};
pub use robot::RobotConfig;
pub use settings::Setting;
use trilink_base::LengthUnit;
use trilink_robot::metrics::{Metric, WeightKey};
use trilink_robot::{Gait, JointCommand, Model, Quantity, Robot, SecondHarmonic, Unit};

use strict::Strict;

/// The configuration file that is used when none is named.
pub const CONFIG_FILE: &str = "pipeline.toml";

/// Everything `pipeline.toml` can say. A key that is left out has the paper's value; naming
/// any entry of `robot`, `gait`, `campaign` or `markers` replaces that whole family; models stand
/// beside the default ones.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    pub paths: Paths,
    pub vicon: Vicon,
    pub ingest: Ingest,
    pub fit: Fit,
    pub robot: BTreeMap<String, RobotConfig>,
    pub gait: BTreeMap<String, GaitConfig>,
    pub model: Models,
    pub campaign: BTreeMap<String, Campaign>,
    pub markers: Markers,
    pub report: Report,
    pub compare: Compare,
    pub optimise: Optimise,
}

/// Which gaits `optimise` searches.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Optimise {
    /// Frequencies, rad/s.
    pub omega_rad_s: [f64; 2],
    /// Amplitudes of commanded joints, degrees.
    pub amplitude_deg: [f64; 2],
    /// Most of |offset| + amplitude, degrees.
    pub angle_deg: f64,
    /// Most of amplitude times omega, degrees/s.
    pub rate_deg_s: f64,
    /// Most of the actuators' mean power, W.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub power_w: Option<f64>,
    /// Most of an actuator's torque, N m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub torque_nm: Option<f64>,
    /// Places where searches begin.
    pub starts: usize,
}

/// What is known of the cameras.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Vicon {
    /// Frame rate that the marker files must have, Hz; also that of files that do not say one.
    pub rate_hz: f64,
    /// Take each file's own rate instead; then each must say one.
    pub rate_from_file: bool,
    /// Unit of the coordinates in files that do not say theirs.
    pub unit: LengthUnit,
    /// Labels of markers that are left out, such as virtual ones: `*` stands for any characters,
    /// `?` for one; with or without the subject.
    pub ignore: Vec<String>,
}

/// How markers become velocities and cycles.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ingest {
    pub poses: Poses,
    pub smoothing_window: Smoothing,
    /// Longest gap that is filled, s. Cycles that touch a longer one are left out.
    pub max_gap_s: f64,
    /// Mean residual of the rigid fit above which a trial is flagged, mm.
    pub max_residual_mm: f64,
    /// Cycles of transient left out at least.
    pub skip_cycles: usize,
}

/// How the links' poses are found in a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Poses {
    /// Each link's from its own markers.
    Links,
    /// All from all markers at once, with the joints at the robot's h and l.
    Chain,
}

/// Width of the moving average.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Smoothing {
    /// Chosen per trial from its frequency.
    Auto,
    /// Samples, 5 to 30.
    Window(usize),
}

/// Search for the free coefficients.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fit {
    /// Bounds of every free skid coefficient, kg/s.
    pub skid_bounds_kg_s: [f64; 2],
    /// Bounds of every free roll coefficient, or of their sum, kg/s.
    pub roll_bounds_kg_s: [f64; 2],
    /// Bounds of every free coefficient of dry friction, N.
    pub dry_bounds_n: [f64; 2],
    /// Bounds of the transition speed where it is free, m/s.
    pub transition_bounds_m_s: [f64; 2],
    /// Bounds of the Stribeck speed where it is free, m/s.
    pub stribeck_bounds_m_s: [f64; 2],
    /// Bounds of the passive joint's stiffness where it is free, N m/rad.
    pub stiffness_bounds_nm_rad: [f64; 2],
    /// Bounds of the passive joint's damping where it is free, N m s/rad.
    pub damping_bounds_nm_s_rad: [f64; 2],
    /// Starting points, spread over the bounds.
    pub starts: usize,
    /// Replicates of the bootstrap that gives confidence intervals; 0 for none.
    pub bootstrap: usize,
    /// Of the bootstrap's random numbers.
    pub seed: u64,
    /// Whether to follow the objective along every free coefficient.
    pub profiles: bool,
    /// Which measured skid ratios the models are compared with.
    pub sigma: SigmaKind,
    /// Which gait drives the models at the trials' frequencies.
    pub gait_input: GaitInput,
    /// Where k_tau, c_tau and the roll coefficients that are not fitted come from.
    pub robot_parameters: ParameterSource,
    /// What campaigns have in common.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shared: Option<SharedFits>,
}

impl Fit {
    /// Bounds of the free parameters of a quantity, which other quantities may share; `None` where no
    /// key gives any: the quantity's range bounds it then.
    pub fn bounds_mut(&mut self, quantity: Quantity) -> Option<&mut [f64; 2]> {
        match quantity {
            Quantity::Skid => Some(&mut self.skid_bounds_kg_s),
            Quantity::Roll => Some(&mut self.roll_bounds_kg_s),
            Quantity::Stribeck => Some(&mut self.stribeck_bounds_m_s),
            Quantity::Transition => Some(&mut self.transition_bounds_m_s),
            Quantity::Stiffness => Some(&mut self.stiffness_bounds_nm_rad),
            Quantity::Damping => Some(&mut self.damping_bounds_nm_s_rad),
            _ if quantity.definition().unit == Unit::Newton => Some(&mut self.dry_bounds_n),
            _ => None,
        }
    }
}

/// Fits of one set of coefficients to several campaigns.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SharedFits {
    /// The robots of which all campaigns are fitted together.
    pub robot: Robots,
}

/// Names of robots: a list, or one.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Robots(pub Vec<String>);

impl<'de> Deserialize<'de> for Robots {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        match toml::Value::deserialize(deserializer)? {
            toml::Value::String(name) => Ok(Self(vec![name])),
            list @ toml::Value::Array(_) => {
                list.try_into().map(Self).map_err(serde::de::Error::custom)
            }
            other => Err(serde::de::Error::custom(format!(
                "invalid value: {other}, expected the name of a robot or a list of names"
            ))),
        }
    }
}

/// What is written beside the page.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Report {
    /// Most trials of which all get a page.
    pub trial_pages: usize,
    /// Width of every figure in print.
    pub width_mm: FigureWidth,
    /// Size of the text of figures in print, points.
    pub font_pt: f64,
}

/// How wide figures are in print.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FigureWidth {
    /// As wide as a figure's panels need.
    Auto,
    /// mm.
    Mm(f64),
}

/// Where the robots' own parameters come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ParameterSource {
    /// The configuration.
    Configured,
    /// The trials of kind `joint-release` and `coast-down`, where the folder has them for the
    /// robot; else the configuration.
    Measured,
}

/// Measured skid ratios.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SigmaKind {
    /// Eq. 20 as it stands; the markers' noise counts as skid.
    Raw,
    /// Without what the markers' noise makes of it.
    Debiased,
}

/// What the joints are commanded to do; a joint without a command is passive.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GaitConfig {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub joint1: Option<JointConfig>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub joint2: Option<JointConfig>,
}

/// `phi = offset + amplitude cos(omega t + phase) + amplitude2 cos(2 omega t + phase2)`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointConfig {
    #[serde(default)]
    pub offset_deg: f64,
    pub amplitude_deg: f64,
    #[serde(default)]
    pub phase_deg: f64,
    /// Of the second harmonic; without it there is none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub amplitude2_deg: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub phase2_deg: Option<f64>,
}

impl JointConfig {
    /// The command in radians.
    fn to_command(&self) -> JointCommand {
        let phase2_rad = self.phase2_deg.unwrap_or(0.0).to_radians();
        let second =
            |amplitude_deg: f64| SecondHarmonic::new(amplitude_deg.to_radians(), phase2_rad);
        JointCommand {
            offset_rad: self.offset_deg.to_radians(),
            amplitude_rad: self.amplitude_deg.to_radians(),
            phase_rad: self.phase_deg.to_radians(),
            second: self.amplitude2_deg.map(second),
        }
    }
}

/// One robot with one gait, swept over frequency.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Campaign {
    /// Name of a `[robot.*]`.
    pub robot: String,
    /// Name of a `[gait.*]`.
    pub gait: String,
    /// Names of `[model.*]` that compete.
    pub models: Vec<Model>,
    /// Weights of the objective (Table III).
    pub weights: Weights,
    /// What models leave free, if not what they say themselves.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub free: BTreeMap<Model, Free>,
}

/// Weights of eq. 22.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Weights {
    pub d: f64,
    pub v: f64,
    pub sigma: f64,
    pub alpha: f64,
}

impl Weights {
    /// That of a metric's term; 0 of one that has none.
    pub fn of(self, metric: Metric) -> f64 {
        match metric.definition().weight {
            Some(WeightKey::D) => self.d,
            Some(WeightKey::V) => self.v,
            Some(WeightKey::Sigma) => self.sigma,
            Some(WeightKey::Alpha) => self.alpha,
            None => 0.0,
        }
    }
}

/// Marker positions by label, mm in each link's own frame: origin at the link's wheel axle,
/// x along t_i, y along n_i, z up from the floor.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Markers {
    pub link0: BTreeMap<String, [f64; 3]>,
    pub link1: BTreeMap<String, [f64; 3]>,
    pub link2: BTreeMap<String, [f64; 3]>,
}

impl Markers {
    /// The layouts of links 0, 1, 2.
    pub fn links(&self) -> [&BTreeMap<String, [f64; 3]>; 3] {
        [&self.link0, &self.link1, &self.link2]
    }
}

/// One entry of a family of the configuration, such as `[robot.kinematic]`.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedEntry<T, N = String> {
    pub name: N,
    pub value: T,
}

impl<T: Clone, N: Ord + Clone> NamedEntry<T, N> {
    /// The entry of a family that has this name.
    pub fn of(family: &BTreeMap<N, T>, name: &N) -> Option<Self> {
        family.get(name).map(|value| Self { name: name.clone(), value: value.clone() })
    }
}

/// As the configuration has it: a table with the name as its key.
impl<T: Serialize, N: Serialize> Serialize for NamedEntry<T, N> {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map([(&self.name, &self.value)])
    }
}

/// The default of every key.
const DEFAULTS: &str = include_str!("config/defaults.toml");
/// Families of which naming one entry replaces all.
const FAMILIES: [&str; 4] = ["robot", "gait", "campaign", "markers"];

impl Default for Config {
    fn default() -> Self {
        static PARSED: LazyLock<Config> = LazyLock::new(|| {
            Config::parse("").expect("the configuration that comes with the program is complete")
        });
        PARSED.clone()
    }
}

/// Completes a table by the defaults of keys that it does not name, so many tables deep.
fn complete<'t>(table: &mut DeTable<'t>, defaults: DeTable<'t>, depth: usize) {
    for (key, default) in defaults {
        match (table.get_mut(&key).map(Spanned::get_mut), default.get_ref()) {
            (None, _) => {
                table.insert(key, default);
            }
            (Some(DeValue::Table(named)), DeValue::Table(_))
                if depth > 0 && !FAMILIES.contains(&&**key.get_ref()) =>
            {
                if let DeValue::Table(default) = default.into_inner() {
                    complete(named, default, depth - 1);
                }
            }
            _ => {}
        }
    }
}

/// A configuration; keys that it leaves out have their defaults. In `compare`, names of columns
/// stand beside the default ones.
fn with_defaults(text: &str) -> Result<Spanned<DeTable<'_>>, toml::de::Error> {
    let mut table = DeTable::parse(text)?;
    complete(table.get_mut(), DeTable::parse(DEFAULTS)?.into_inner(), 2);
    Ok(table)
}

impl Config {
    fn parse(text: &str) -> Result<Self, toml::de::Error> {
        Self::deserialize(Strict(toml::Deserializer::from(with_defaults(text)?)))
    }

    /// Reads and checks a configuration file and makes its paths relative to where it lies.
    ///
    /// # Errors
    /// The file cannot be read, is not TOML, has an unknown key (the nearest known one is
    /// named), or a value that makes no sense (key, found and needed are named).
    pub fn load(path: &Path) -> Result<Self, ConfigError> {
        let text = trilink_base::files::read_text(path)
            .map_err(|source| ConfigError::Read { path: path.to_owned(), source })?;
        let mut config =
            Self::parse(&text).map_err(|error| ConfigError::toml(path, &text, &error))?;
        config.check(path)?;
        config.paths.start_at(path.parent().unwrap_or(Path::new("")));
        Ok(config)
    }

    /// Loads a configuration file; without a `path` [`CONFIG_FILE`] of the current folder, or the
    /// defaults if there is none.
    ///
    /// # Errors
    /// As [`Config::load`].
    pub fn load_or_default(path: Option<&Path>) -> Result<Self, ConfigError> {
        Self::file(path).map_or_else(|| Ok(Self::default()), Self::load)
    }

    /// The file that [`Config::load_or_default`] loads; `None` where it takes the defaults.
    pub fn file(path: Option<&Path>) -> Option<&Path> {
        let own = Path::new(CONFIG_FILE);
        // Only without a file the defaults count: not where it cannot be read.
        let is_absent = |error: std::io::Error| error.kind() == std::io::ErrorKind::NotFound;
        match path {
            None if own.symlink_metadata().is_err_and(is_absent) => None,
            path => Some(path.unwrap_or(own)),
        }
    }

    /// The defaults, but with the passive joint of the paper's simulations (Figs. 3 to 5), which is
    /// another than its experiments' (Table II has both).
    pub fn of_simulations() -> Self {
        let (mut config, simulated) = (Self::default(), Robot::semi_passive());
        for robot in config.robot.values_mut().filter(|of| of.get(Quantity::Stiffness).is_some()) {
            robot.set(Quantity::Stiffness, [simulated.stiffness_nm_rad]);
            robot.set(Quantity::Damping, [simulated.damping_nm_s_rad]);
        }
        config
    }

    /// The campaigns of a robot, and the models that all of them list and that have something free in
    /// one of them.
    pub fn common(&self, robot: &str) -> (Vec<&String>, Vec<Model>) {
        let campaigns = self.campaign.iter().filter(|(_, campaign)| campaign.robot == robot);
        let (names, campaigns): (Vec<&String>, Vec<&Campaign>) = campaigns.unzip();
        let has_free = |campaign: &Campaign, model: &Model| {
            let (own, gait) = (&self.model[model], self.gait[&campaign.gait].to_gait());
            let free = campaign.free.get(model).map_or_else(|| own.free(), |Free(of)| of.clone());
            free.iter().any(|parameter| own.laws().know(*parameter, &gait))
        };
        let is_common = |model: &&Model| {
            campaigns.iter().all(|campaign| campaign.models.contains(model))
                && campaigns.iter().any(|campaign| has_free(campaign, model))
        };
        let first = campaigns.first().map_or(&[][..], |campaign| &campaign.models);
        let models = first.iter().filter(is_common).copied().collect();
        (names, models)
    }

    /// The robot and gait of a campaign, in SI units. `None` if there is no such campaign.
    pub fn campaign_setup(&self, campaign: &str) -> Option<(Robot, Gait)> {
        let campaign = self.campaign.get(campaign)?;
        let robot = self.robot.get(&campaign.robot)?.to_robot();
        let gait = self.gait.get(&campaign.gait)?.to_gait();
        Some((robot, gait))
    }
}

impl GaitConfig {
    /// The gait in radians.
    pub fn to_gait(&self) -> Gait {
        let command = |joint: &Option<JointConfig>| joint.as_ref().map(JointConfig::to_command);
        Gait { joints: [command(&self.joint1), command(&self.joint2)] }
    }
}

/// A key that is a number or `"auto"`: how it stands in a file.
fn auto_or<T: Serialize, S: Serializer>(
    value: Option<T>,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    match value {
        None => serializer.serialize_str(AUTO),
        Some(value) => value.serialize(serializer),
    }
}

const AUTO: &str = "auto";

impl Serialize for Smoothing {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let samples = match self {
            Self::Auto => None,
            Self::Window(samples) => Some(samples),
        };
        auto_or(samples, serializer)
    }
}

impl<'de> Deserialize<'de> for Smoothing {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        match toml::Value::deserialize(deserializer)? {
            toml::Value::String(word) if word == AUTO => Ok(Self::Auto),
            toml::Value::Integer(samples @ 5..=30) => Ok(Self::Window(samples as usize)),
            other => Err(serde::de::Error::custom(format!(
                "invalid value: {other}, expected \"auto\" or a whole number of samples from 5 to 30"
            ))),
        }
    }
}

impl Serialize for FigureWidth {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        auto_or(self.mm(), serializer)
    }
}

impl<'de> Deserialize<'de> for FigureWidth {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        match toml::Value::deserialize(deserializer)? {
            toml::Value::String(word) if word == AUTO => Ok(Self::Auto),
            toml::Value::Integer(mm) => Ok(Self::Mm(mm as f64)),
            toml::Value::Float(mm) => Ok(Self::Mm(mm)),
            other => Err(serde::de::Error::custom(format!(
                "invalid value: {other}, expected \"auto\" or a number of millimetres"
            ))),
        }
    }
}

impl FigureWidth {
    /// The width if it is a number, mm.
    pub fn mm(self) -> Option<f64> {
        match self {
            Self::Auto => None,
            Self::Mm(mm) => Some(mm),
        }
    }
}
