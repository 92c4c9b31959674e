//! `pipeline.toml`: the robots, gaits, campaigns and settings of a run.
//!
//! `defaults.toml` holds the default of every key, which is the paper's experiment; the repository's `pipeline.toml`
//! has the same values.

mod chain;
mod check;
mod compare;
mod error;
mod gait;
mod key;
mod link_layout;
mod marker_layout;
mod model;
mod paths;
mod robot;
mod settings;
mod strict;
mod three_links;

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::LazyLock;

use serde::{Deserialize, Deserializer, Serialize, Serializer};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

pub use chain::{ChainJoint, ChainRobot, GroupNumbers, JointKind, LinkConfig, RobotGroup};
pub use check::one_of;
pub use compare::{Compare, Tolerance, Tolerances, tolerance};
pub use error::ConfigError;
pub use error::{did_you_mean, nearest, parse_toml};
pub use gait::{CommandConfig, GaitConfig};
pub use key::toml_key;
pub use marker_layout::{LinkMarkers, MarkerLayout};
pub use model::{Free, GaitInput, ModelConfig, Models};
pub use paths::{Paths, is_pattern};
pub use robot::RobotConfig;
pub use settings::Setting;
pub use three_links::ThreeLinkRobot;
use trilink_base::LengthUnit;
use trilink_robot::metrics::{Metric, WeightKey};
use trilink_robot::{AnyGait, AnyRobot, Chain, Gait, Model, Quantity, Robot, Unit};

use strict::Strict;

/// Name of the configuration file that is used if no other is given.
pub const CONFIG_FILE: &str = "pipeline.toml";

/// Configuration read from `pipeline.toml`. A key that is left out has its default value. Any entry of
/// `robot`, `gait`, `campaign` or `markers` replaces the whole default table of that name, whereas entries of
/// `model` are added to the default models.
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
    /// Marker layouts of chains, and of robots of three links with another one than `markers`: by the name of the robot,
    /// then by the name of the link or, in the short form, by `link0`, `link1` and `link2`.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub layout: BTreeMap<String, BTreeMap<String, LinkMarkers>>,
    pub report: Report,
    pub compare: Compare,
    pub optimise: Optimise,
}

/// Search space of `trilink optimise`, and limits on the motions that it accepts.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Optimise {
    /// Range of frequencies, rad/s.
    pub omega_rad_s: [f64; 2],
    /// Range of amplitudes of commanded joints, degrees.
    pub amplitude_deg: [f64; 2],
    /// Range of amplitudes of rotors, degrees.
    pub rotor_amplitude_deg: [f64; 2],
    /// Maximum joint angle |offset| + amplitude, degrees.
    pub angle_deg: f64,
    /// Maximum rate of joints and rotors (amplitude times omega), degrees/s.
    pub rate_deg_s: f64,
    /// Maximum mean power of the actuators, W; `None` for no limit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub power_w: Option<f64>,
    /// Maximum torque of an actuator, N m; `None` for no limit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub torque_nm: Option<f64>,
    /// Number of starting points of the search.
    pub starts: usize,
}

/// Properties of the marker files.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Vicon {
    /// Frame rate that the marker files must have, Hz; it is also assumed for files that do not state a frame
    /// rate.
    pub rate_hz: f64,
    /// Whether to use the frame rate stated in each file instead of `rate_hz`; every file must then state
    /// one.
    pub rate_from_file: bool,
    /// Unit of the coordinates in files that do not state a unit.
    pub unit: LengthUnit,
    /// Labels of markers to ignore, such as virtual markers, with or without the subject name; `*` stands for
    /// any number of characters, `?` for exactly one.
    pub ignore: Vec<String>,
}

/// Settings for computing velocities and gait cycles from marker coordinates.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ingest {
    pub poses: Poses,
    pub smoothing: Smoothing,
    pub smoothing_window: SmoothingWindow,
    /// Maximum duration of a gap that is filled, s. Cycles that overlap a longer gap are not used.
    pub max_gap_s: f64,
    /// Mean residual of the rigid fit above which a trial is flagged, mm.
    pub max_residual_mm: f64,
    /// Minimum number of initial cycles that are not used because the motion is still settling.
    pub skip_cycles: usize,
}

/// Method of estimating the poses of the links in a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Poses {
    /// The pose of each link is estimated from its own markers.
    Links,
    /// All poses are estimated from all markers at once, with the links connected at the joints according to
    /// the robot's lengths h and l (multibody optimisation).
    Chain,
}

/// Method of smoothing the coordinates and of differentiating them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Smoothing {
    /// Moving average and central differences, as in the paper.
    MovingAverage,
    /// Kalman smoother of harmonics of the gait and an integrated Wiener process, estimated by maximum likelihood.
    Kalman,
}

/// Width of the moving average that smooths a trial.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SmoothingWindow {
    /// Chosen for each trial from its frequency.
    Auto,
    /// Fixed number of samples, 5 to 30.
    Window(usize),
}

/// Settings for the fits of the free parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fit {
    /// Bounds on each free skid coefficient, kg/s.
    pub skid_bounds_kg_s: [f64; 2],
    /// Bounds on each free roll coefficient, or on their sum, kg/s.
    pub roll_bounds_kg_s: [f64; 2],
    /// Bounds on each free parameter that is a force of dry, static or power-law friction, N.
    pub dry_bounds_n: [f64; 2],
    /// Bounds on the transition speed if it is a free parameter, m/s.
    pub transition_bounds_m_s: [f64; 2],
    /// Bounds on the Stribeck speed if it is a free parameter, m/s.
    pub stribeck_bounds_m_s: [f64; 2],
    /// Bounds on the passive joint's stiffness if it is a free parameter, N m/rad.
    pub stiffness_bounds_nm_rad: [f64; 2],
    /// Bounds on the passive joint's damping if it is a free parameter, N m s/rad.
    pub damping_bounds_nm_s_rad: [f64; 2],
    /// Number of starting points of each fit, spread over the region within the bounds.
    pub starts: usize,
    /// Number of bootstrap replicates for the confidence intervals; 0 for none.
    pub bootstrap: usize,
    /// Relative standard deviation of friction between days, from experience, for campaigns recorded on a single
    /// day; 0 if the fitted coefficients are to be those of that day.
    pub day_sd: f64,
    /// Seed of the random numbers for the bootstrap.
    pub seed: u64,
    /// Whether to compute the profile of the objective along each free parameter.
    pub profiles: bool,
    /// Kind of measured skid ratio to which the models are fitted.
    pub sigma: SigmaKind,
    /// Gait that drives the models at the trials' frequencies: the commanded or the measured gait.
    pub gait_input: GaitInput,
    /// Source of the joint stiffness k_tau, the joint damping c_tau and the roll coefficients, for those of
    /// them that a fit does not estimate.
    pub robot_parameters: ParameterSource,
    /// Fits of shared coefficients to all campaigns of a robot, or of robots with common wheels; `None` if not requested.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shared: Option<SharedFits>,
}

impl Fit {
    /// Returns a mutable reference to the bounds on the free parameters of a quantity; several quantities may
    /// share them. Returns `None` if no key sets these bounds; the bounds are then the permitted range of the
    /// quantity.
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

/// Settings for fits of one set of coefficients to several campaigns.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SharedFits {
    /// Robots for which all campaigns are fitted together, with one set of coefficients for each robot.
    pub robot: Robots,
}

/// Names of robots; a list or a single name in the configuration file.
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

/// Settings of the report.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Report {
    /// Maximum number of trial pages in the report, apart from requested ones; if there are more trials, only
    /// some have a page.
    pub trial_pages: usize,
    /// Width of each figure in print.
    pub width_mm: FigureWidth,
    /// Font size of the figures in print, points.
    pub font_pt: f64,
}

/// Width of figures in print.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FigureWidth {
    /// Width that the figure's panels need.
    Auto,
    /// Width in mm.
    Mm(f64),
}

/// Source of the robot parameters that trials can measure.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ParameterSource {
    /// The values in the configuration.
    Configured,
    /// The trials of kind `joint-release` and `coast-down`; if there are none for a robot, the configuration.
    Measured,
}

/// Kind of measured skid ratio: as defined by eq. 20 of the paper, or corrected for marker noise.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SigmaKind {
    /// Skid ratio as defined by eq. 20 of the paper, which has a positive bias due to marker noise.
    Raw,
    /// Skid ratio as defined by eq. 20 of the paper, corrected for the bias due to marker noise.
    Debiased,
}

/// Campaign: all trials of one robot and gait, over a range of frequencies.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Campaign {
    /// Name of the robot, an entry `[robot.NAME]` of the configuration.
    pub robot: String,
    /// Name of the gait, an entry `[gait.NAME]` of the configuration.
    pub gait: String,
    /// Names of the models that are compared, entries `[model.NAME]` of the configuration.
    #[serde(default)]
    pub models: Vec<Model>,
    /// Weights of the metrics in the objective (Table III of the paper).
    #[serde(default = "Weights::equal")]
    pub weights: Weights,
    /// Free parameters by model, which replace those given in `[model.NAME]` for this campaign.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub free: BTreeMap<Model, Free>,
}

/// Weights of the objective's terms (eq. 22 of the paper).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Weights {
    pub d: f64,
    pub v: f64,
    pub sigma: f64,
    pub alpha: f64,
}

impl Weights {
    /// Weights if none are configured.
    const fn equal() -> Self {
        Self { d: 1.0, v: 1.0, sigma: 1.0, alpha: 1.0 }
    }

    /// Returns the weight of a metric's term in the objective; 0 if the metric has no term.
    pub fn for_metric(self, metric: Metric) -> f64 {
        match metric.definition().weight {
            Some(WeightKey::D) => self.d,
            Some(WeightKey::V) => self.v,
            Some(WeightKey::Sigma) => self.sigma,
            Some(WeightKey::Alpha) => self.alpha,
            None => 0.0,
        }
    }
}

/// Marker layout of each link: positions of the markers by label, mm, in a link frame with its origin on the
/// floor below the wheel axle, x along the wheel's rolling direction t_i, y along n_i (across it) and z
/// upwards. A rigid body, whose entry in the configuration states its pose, is four markers: the points of
/// [`trilink_base::body`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Markers {
    #[serde(with = "link_layout")]
    pub link0: BTreeMap<String, [f64; 3]>,
    #[serde(with = "link_layout")]
    pub link1: BTreeMap<String, [f64; 3]>,
    #[serde(with = "link_layout")]
    pub link2: BTreeMap<String, [f64; 3]>,
}

impl Markers {
    /// Keys of the links by their numbers.
    pub const KEYS: [&str; 3] = ["link0", "link1", "link2"];

    /// Returns the marker layouts of links 0, 1, 2.
    pub fn links(&self) -> [&BTreeMap<String, [f64; 3]>; 3] {
        [&self.link0, &self.link1, &self.link2]
    }
}

/// Entry of a configuration table with its name, such as `[robot.kinematic]`.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedEntry<T, N = String> {
    pub name: N,
    pub value: T,
}

impl<T: Clone, N: Ord + Clone> NamedEntry<T, N> {
    /// Finds the entry with the given name; `None` if there is none.
    pub fn find(entries: &BTreeMap<N, T>, name: &N) -> Option<Self> {
        entries.get(name).map(|value| Self { name: name.clone(), value: value.clone() })
    }

    /// Returns the entry with its value changed by a function.
    pub fn map<U>(self, function: impl FnOnce(T) -> U) -> NamedEntry<U, N> {
        NamedEntry { name: self.name, value: function(self.value) }
    }
}

/// Serializes the entry as in the configuration: as a table with the name as its key.
impl<T: Serialize, N: Serialize> Serialize for NamedEntry<T, N> {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map([(&self.name, &self.value)])
    }
}

/// Default of every key, as TOML.
const DEFAULTS: &str = include_str!("config/defaults.toml");
/// Tables whose defaults are all dropped if the configuration file contains an entry of the table.
const REPLACED_TABLES: [&str; 4] = ["robot", "gait", "campaign", "markers"];

impl Default for Config {
    fn default() -> Self {
        static PARSED: LazyLock<Config> =
            LazyLock::new(|| Config::parse("").expect("the defaults are a complete configuration"));
        PARSED.clone()
    }
}

/// Adds the defaults of keys that are missing in a table or, down to the level `depth`, in its subtables.
fn add_defaults<'t>(table: &mut DeTable<'t>, defaults: DeTable<'t>, depth: usize) {
    for (key, default) in defaults {
        match (table.get_mut(&key).map(Spanned::get_mut), default.get_ref()) {
            (None, _) => {
                table.insert(key, default);
            }
            (Some(DeValue::Table(named)), DeValue::Table(_))
                if depth > 0 && !REPLACED_TABLES.contains(&&**key.get_ref()) =>
            {
                if let DeValue::Table(default) = default.into_inner() {
                    add_defaults(named, default, depth - 1);
                }
            }
            _ => {}
        }
    }
}

/// Parses the text of a configuration file and adds the defaults of missing keys, including the default
/// tolerances of columns that the tables of `[compare]` do not list.
fn parse_with_defaults(text: &str) -> Result<Spanned<DeTable<'_>>, toml::de::Error> {
    let mut table = DeTable::parse(text)?;
    add_defaults(table.get_mut(), DeTable::parse(DEFAULTS)?.into_inner(), 2);
    Ok(table)
}

impl Config {
    fn parse(text: &str) -> Result<Self, toml::de::Error> {
        let mut table = parse_with_defaults(text)?;
        let robots = table.get_mut().get_mut("robot").map(Spanned::get_mut);
        if let Some(DeValue::Table(robots)) = robots {
            for (_, robot) in robots.iter_mut() {
                if let DeValue::Table(robot) = robot.get_mut() {
                    chain::spread(robot)?;
                }
            }
        }
        Self::deserialize(Strict(toml::Deserializer::from(table)))
    }

    /// Reads and checks a configuration file. Paths in the file are relative to its folder.
    ///
    /// # Errors
    /// Returns an error if the file cannot be read, is not TOML, has an unknown key (the error suggests the
    /// most similar one), or has an invalid value (the error names the key, what was found and what is
    /// needed).
    pub fn load(path: &Path) -> Result<Self, ConfigError> {
        let text = trilink_base::files::read_text(path)
            .map_err(|source| ConfigError::Read { path: path.to_owned(), source })?;
        let mut config =
            Self::parse(&text).map_err(|error| ConfigError::toml(path, &text, &error))?;
        if let Err(error) = config.check(path) {
            let keys = settings::unfilled(&text);
            // A single value is described better by the error of the check.
            return Err(if keys.len() > 1 {
                ConfigError::Unfilled { path: path.to_owned(), keys }
            } else {
                error
            });
        }
        config.paths.start_at(path.parent().unwrap_or(Path::new("")));
        Ok(config)
    }

    /// Loads the configuration file `path`. If `path` is `None`, loads [`CONFIG_FILE`] in the current folder,
    /// or the defaults if that file does not exist.
    ///
    /// # Errors
    /// Returns an error in the same cases as [`Config::load`].
    pub fn load_or_default(path: Option<&Path>) -> Result<Self, ConfigError> {
        Self::file(path).map_or_else(|| Ok(Self::default()), Self::load)
    }

    /// Returns the file that [`Config::load_or_default`] loads; `None` if it returns the defaults.
    pub fn file(path: Option<&Path>) -> Option<&Path> {
        if path.is_some() {
            return path;
        }
        let file = Path::new(CONFIG_FILE);
        // A file that exists but cannot be read must be an error, so that the defaults do not replace it silently.
        match file.symlink_metadata() {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => None,
            _ => Some(file),
        }
    }

    /// Returns the default configuration, but with the stiffness and damping of the passive joint in the
    /// paper's simulations (Figs. 3 to 5) instead of those in its experiments; Table II of the paper lists
    /// both.
    pub fn of_simulations() -> Self {
        let mut config = Self::default();
        let simulated = Robot::semi_passive();
        for robot in config.robot.values_mut().filter_map(RobotConfig::three_links_mut) {
            if robot.get(Quantity::Stiffness).is_some() {
                robot.set(Quantity::Stiffness, [simulated.stiffness_nm_rad]);
                robot.set(Quantity::Damping, [simulated.damping_nm_s_rad]);
            }
        }
        config
    }

    /// Returns the campaigns of one or several robots, and the models that all these campaigns list and that have a free
    /// parameter in at least one of them.
    pub fn common(&self, robots: &[String]) -> (Vec<&String>, Vec<Model>) {
        let campaigns = self.campaign.iter().filter(|(_, of)| robots.contains(&of.robot));
        let campaigns: Vec<_> = campaigns.collect();
        let mut models = campaigns.first().map_or(Vec::new(), |(_, of)| of.models.clone());
        models.retain(|model| {
            campaigns.iter().all(|(_, of)| of.models.contains(model))
                && campaigns
                    .iter()
                    .any(|(name, of)| self.has_free_parameter(name, of.free.get(model), *model))
        });
        (campaigns.into_iter().map(|(name, _)| name).collect(), models)
    }

    /// Returns whether a model has a free parameter in a campaign, which may list its own.
    fn has_free_parameter(&self, campaign: &str, listed: Option<&Free>, model: Model) -> bool {
        let config = &self.model[&model];
        let free = listed.map_or_else(|| config.free(), |Free(parameters)| parameters.clone());
        self.setup(campaign).is_some_and(|(robot, gait)| {
            free.iter().any(|parameter| robot.depends_on(*parameter, config.laws(), &gait))
        })
    }

    /// Returns the robot and the commanded gait of a campaign in SI units; `None` if there is no campaign with this name.
    pub fn setup(&self, campaign: &str) -> Option<(AnyRobot, AnyGait)> {
        let Campaign { robot, gait, .. } = self.campaign.get(campaign)?;
        Some(self.robot.get(robot)?.setup(self.gait.get(gait)?))
    }

    /// Returns the robot of three links and the gait of a campaign, in SI units; `None` if there is no campaign with this
    /// name, or if its robot is a chain.
    pub fn campaign_setup(&self, campaign: &str) -> Option<(Robot, Gait)> {
        let (robot, gait) = self.setup(campaign)?;
        Some((robot.three_links()?.clone(), gait.into()))
    }

    /// Returns the robot of a campaign, if it is a chain, with its gait, in SI units.
    pub fn chain_setup(&self, campaign: &str) -> Option<Chain> {
        self.setup(campaign)?.0.chain()
    }

    /// Returns the configuration of a campaign's robot; `None` if there is no campaign with this name.
    pub fn robot_of(&self, campaign: &str) -> Option<&RobotConfig> {
        self.robot.get(&self.campaign.get(campaign)?.robot)
    }

    /// Returns why a campaign cannot be used by a command that knows only the robot with three links; `None` if its
    /// robot is not a chain.
    pub fn chain_notice(&self, campaign: &str) -> Option<String> {
        self.robot_of(campaign)?.chain().map(|_| {
            format!(
                "campaign {campaign}: its robot is a chain, which this command does not support"
            )
        })
    }
}

/// Serializes a value, or `"auto"` for `None`.
fn serialize_or_auto<T: Serialize, S: Serializer>(
    value: Option<T>,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    match value {
        None => serializer.serialize_str(AUTO),
        Some(value) => value.serialize(serializer),
    }
}

const AUTO: &str = "auto";

impl Serialize for SmoothingWindow {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let samples = match self {
            Self::Auto => None,
            Self::Window(samples) => Some(samples),
        };
        serialize_or_auto(samples, serializer)
    }
}

impl<'de> Deserialize<'de> for SmoothingWindow {
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
        serialize_or_auto(self.mm(), serializer)
    }
}

impl<'de> Deserialize<'de> for FigureWidth {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        match toml::Value::deserialize(deserializer)? {
            toml::Value::String(word) if word == AUTO => Ok(Self::Auto),
            toml::Value::Integer(mm) => Ok(Self::Mm(mm as f64)),
            toml::Value::Float(mm) => Ok(Self::Mm(mm)),
            other => Err(serde::de::Error::custom(format!(
                "invalid value: {other}, expected \"auto\" or a number (in millimetres)"
            ))),
        }
    }
}

impl FigureWidth {
    /// Returns the width in mm; `None` if it is automatic.
    pub fn mm(self) -> Option<f64> {
        match self {
            Self::Auto => None,
            Self::Mm(mm) => Some(mm),
        }
    }
}
