//! Synthetic trials with known true values, as files of a motion-capture system.
//!
//! The motion follows a model (`skid-roll` by default) with known coefficients, from rest, with servos that do not
//! follow their commands exactly. For each robot there are also a coast-down and, if the robot has passive joints, a
//! release of each. The cameras add noise, vibration, tilt and dropouts. The true values are written to `truth.json`,
//! which is read only when the report compares results with them.
//!
//! [`synthesise`] writes a trial folder from a [`Recipe`]. Its steps are, in order:
//!
//! - `plan`: the trials with their robots and laws, drawn from the seed.
//! - `planted`, `chain`, `servo` and `decay`: the motion in each trial, with and without a gait.
//! - `cameras`: the recording of the motion; `bodies`: the poses that a camera system fits to it.
//! - `truth`: the true values, [`Truth`].
//!
//! ```
//! use trilink_synth::{Recipe, synthesise};
//! use trilink_tables::config::Config;
//!
//! let mut config = Config::default();
//! config.campaign.retain(|name, _| name == "kinematic-symmetric");
//! let folder = tempfile::tempdir()?;
//! let recipe = Recipe { omegas_rad_s: vec![4.0], ..Recipe::new(1) };
//! let trials = synthesise(&config, folder.path(), &recipe, &|_| Ok(()))?;
//! assert_eq!(trials.len(), recipe.trials(&config));
//! assert!(folder.path().join(&trials[0].file).is_file());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod bodies;
mod cameras;
mod chain;
mod decay;
mod plan;
mod planted;
mod servo;
mod truth;

use std::collections::{BTreeMap, BTreeSet};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use trilink_base::cancel::Cancelled;
use trilink_base::files;
use trilink_mechanics::{MotionError, Posture};
pub use trilink_mocap::Format;
use trilink_mocap::{Recording, csv_bytes};
use trilink_robot::{AnyRobot, MAX_JOINTS, Model, Pose, Robot};
use trilink_tables::config::{Config, ConfigError, MarkerLayout};
use trilink_tables::trial::{TRIALS_FILE, TRUTH_FILE, Trial, TrialKind, TrialList, is_valid_id};
use trilink_tables::{StoreError, remove_unfinished, write_bytes};

pub use bodies::body_layout;
use cameras::{Film, Scene};
pub use cameras::{LabelError, Tilt};
pub use decay::{DecayTruth, Slope};
use plan::{Plan, Source};
pub use servo::Servo;
pub use truth::{CampaignTruth, Law, TrialTruth, Truth, planted_models};

/// Default frequencies, rad/s: the paper's 3.9 rad/s, and the paper's range in steps of 0.5 rad/s.
pub const OMEGAS_RAD_S: [f64; 13] =
    [0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 3.9, 4.0, 4.5, 5.0, 5.5, 6.0];

/// Returns a trial whose file has the given format, with campaign and robot left empty.
fn blank_trial(id: String, format: Format, kind: TrialKind) -> Trial {
    Trial {
        file: format!("{id}.{}", format.extension()),
        id,
        kind,
        campaign: None,
        robot: None,
        omega_rad_s: None,
        day: None,
        smoothing_window: None,
        aliases: BTreeMap::new(),
    }
}

/// Maximum number of frames in a trial: two hours at 120 Hz. More may not fit into memory.
const MAX_FRAMES: f64 = 864_000.0;

/// Error during the generation of synthetic trials.
#[derive(Debug, thiserror::Error)]
pub enum SynthError {
    #[error("{}: contains trials that `trilink synth` did not write; choose another folder", folder.display())]
    NotSynthetic { folder: PathBuf },
    #[error(
        "trial `{trial}`: this name is not valid as a file name; the name of a campaign may consist of at most 52 of \
         the characters A-Z a-z 0-9 . _ -"
    )]
    Name { trial: String },
    #[error("trial `{trial}`: planned twice; frequencies must differ by 0.01 rad/s or more")]
    Twice { trial: String },
    #[error(
        "trial `{trial}`: would have more than {MAX_FRAMES} frames; choose a higher frequency or a lower vicon.rate_hz"
    )]
    TooLong { trial: String },
    #[error("--law: {0}")]
    Law(String),
    #[error(
        "--repeat-omega: found {omega_rad_s} rad/s, needed one of the frequencies of the trials: {}", listed(.known)
    )]
    Repeat { omega_rad_s: f64, known: Vec<f64> },
    #[error(
        "--format: found {markers} markers on link {link} of {robot}, needed three for a rigid body"
    )]
    Body { robot: String, link: usize, markers: usize },
    #[error("campaign {campaign}: needed {needed}")]
    NoLayout { campaign: String, needed: String },
    #[error(transparent)]
    Coefficients(#[from] ConfigError),
    #[error("trial `{trial}`: {source}")]
    Motion { trial: String, source: MotionError },
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

fn listed(omegas_rad_s: &[f64]) -> String {
    omegas_rad_s.iter().map(f64::to_string).collect::<Vec<_>>().join(", ")
}

/// Settings for generating a folder of synthetic trials.
#[derive(Debug, Clone)]
pub struct Recipe {
    /// Seed for all random numbers; the same seed gives identical files.
    pub seed: u64,
    /// Seed for the cameras and the cycle-to-cycle variation, to generate another recording of the same robots; `None`
    /// to use `seed`.
    pub noise_seed: Option<u64>,
    /// Model that generates the motion of each robot, by robot name; `skid-roll` for robots that are not listed.
    pub laws: BTreeMap<String, Model>,
    /// Factors applied to the true skid coefficients of the wheels of links 0, 1, 2.
    pub skid_factors: [f64; 3],
    /// Frequencies at which every campaign has trials, rad/s.
    pub omegas_rad_s: Vec<f64>,
    /// Names of robots with ideal servos, constant friction, and a single trial at each frequency, all on the same
    /// floor.
    pub tidy: BTreeSet<String>,
    /// Number of trials at each of the repeated frequencies.
    pub repeats: usize,
    /// Frequencies with repeated trials, rad/s; all frequencies if empty.
    pub repeated_rad_s: Vec<f64>,
    /// Number of days, each with its own floor friction, over which the trials of a campaign are distributed.
    pub days: usize,
    pub servo: Servo,
    /// Whether the robots are off their configured values by errors drawn from the configured standard deviations.
    pub declared_errors: bool,
    /// Slope of the floor on which the robots coast; gaits are always simulated on a level floor.
    pub slope: Option<Slope>,
    /// Relative standard deviation of the wheels' friction from cycle to cycle.
    pub friction_variation: f64,
    /// Relative standard deviation of the wheels' friction from trial to trial.
    pub trial_variation: f64,
    /// Number of trials of each campaign with 1.5 times the friction of their repeats.
    pub unlike: usize,
    pub format: Format,
    /// Fraction of frames in which two labels of a link are swapped or a marker is displaced by 20 mm.
    pub misplaced: f64,
    pub tilt: Tilt,
}

impl Recipe {
    /// Creates a recipe with the default frequencies, ideal servos, constant friction, CSV files and no label errors.
    pub fn new(seed: u64) -> Self {
        Self {
            seed,
            noise_seed: None,
            laws: BTreeMap::new(),
            skid_factors: [1.0; 3],
            omegas_rad_s: OMEGAS_RAD_S.into(),
            tidy: BTreeSet::new(),
            repeats: 1,
            repeated_rad_s: Vec::new(),
            days: 1,
            servo: Servo::default(),
            declared_errors: false,
            slope: None,
            friction_variation: 0.0,
            trial_variation: 0.0,
            unlike: 0,
            format: Format::Csv,
            misplaced: 0.0,
            tilt: Tilt::default(),
        }
    }

    /// Creates the recipe for the demo. Robots with configured dry friction and without a passive joint move according
    /// to the model `coulomb`, with three trials at some frequencies, floors that differ between days, servos with lag
    /// and compliance, and friction that varies from cycle to cycle. Other robots are listed in `tidy` and move
    /// according to the model `skid-roll`.
    pub fn demo(config: &Config, seed: u64) -> Self {
        let model = Model::new("coulomb");
        let robots = config.campaign.values().map(|campaign| campaign.robot.clone());
        let (dry, tidy): (BTreeSet<_>, _) = robots.partition(|robot| {
            let is_configured = config.check_laws(Path::new("demo"), robot, model).is_ok();
            is_configured && !has_passive_joint(config, robot)
        });
        if dry.is_empty() {
            return Self::new(seed);
        }
        Self {
            laws: dry.into_iter().map(|robot| (robot, model)).collect(),
            tidy,
            repeats: 3,
            repeated_rad_s: vec![2.5, 3.9, 5.0],
            days: 4,
            servo: Servo { lag_s: 0.02, compliance_rad_nm: 0.05 },
            friction_variation: 0.05,
            ..Self::new(seed)
        }
    }

    /// Returns the number of trials that the recipe generates for a configuration.
    pub fn trials(&self, config: &Config) -> usize {
        let mut trials = plan::decays(config, self).len();
        for robot in config.campaign.values().map(|campaign| &campaign.robot) {
            for omega_rad_s in &self.omegas_rad_s {
                trials += self.repeats_of(robot, *omega_rad_s);
            }
        }
        trials
    }

    /// Returns the number of trials at a frequency in each campaign of a robot.
    fn repeats_of(&self, robot: &str, omega_rad_s: f64) -> usize {
        let is_repeated =
            self.repeated_rad_s.is_empty() || self.repeated_rad_s.contains(&omega_rad_s);
        if is_repeated && !self.tidy.contains(robot) { self.repeats } else { 1 }
    }
}

/// Returns whether any campaign of a robot leaves a joint passive, or has a robot that is a chain.
fn has_passive_joint(config: &Config, robot: &str) -> bool {
    let mut campaigns = config.campaign.iter().filter(|(_, one)| one.robot == robot);
    campaigns.any(|(name, _)| {
        config.campaign_setup(name).is_none_or(|(_, gait)| gait.passive_joint().is_some())
    })
}

/// Writes a trial folder and returns its trials: every campaign in the configuration at every frequency of the recipe,
/// and, where the robots in these campaigns permit them, a coast-down of each and a release of every passive joint. The
/// same seed gives identical files, and the same motion and noise in every format. `on_trial` is called with the id of each trial once it is
/// complete.
///
/// # Errors
/// Returns an error if a model is unknown or needs a coefficient that its robot lacks, if the folder contains trials
/// that are not synthetic, if a chain has no marker layout, if a trial would have an invalid or repeated id or too many frames, if the model has no
/// periodic solution for a trial, if a file cannot be written, or if `on_trial` cancels.
pub fn synthesise(
    config: &Config,
    folder: &Path,
    recipe: &Recipe,
    on_trial: &(dyn Fn(&str) -> Result<(), Cancelled> + Sync),
) -> Result<Vec<Trial>, SynthError> {
    plan::check(config, recipe)?;
    let configured = config;
    let with_errors =
        recipe.declared_errors.then(|| plan::with_declared_errors(configured, recipe.seed));
    let config = with_errors.as_ref().unwrap_or(configured);
    let (mut plans, campaigns, days) = plan::gaits(config, recipe);
    plans.extend(plan::decays(config, recipe));
    let mut ids = BTreeSet::new();
    for Plan { trial: Trial { id, .. }, source, .. } in &plans {
        if !is_valid_id(id) {
            return Err(SynthError::Name { trial: id.clone() });
        }
        if let Source::Gait(drive) = source
            && planted::min_frames(drive.problem.omega_rad_s, config.vicon.rate_hz) > MAX_FRAMES
        {
            return Err(SynthError::TooLong { trial: id.clone() });
        }
        if !ids.insert(id) {
            return Err(SynthError::Twice { trial: id.clone() });
        }
    }
    claim_folder(folder, plans.iter().map(|plan| plan.trial.file.as_str()))?;
    remove_unfinished(&[folder.to_owned()])?;
    let trials: Vec<_> = plans
        .par_iter()
        .map(|plan| {
            let truth = write_trial(config, folder, recipe, plan)?;
            on_trial(&plan.trial.id)?;
            Ok(truth.map(|truth| (plan.trial.id.clone(), truth)))
        })
        .collect::<Result<_, SynthError>>()?;
    let trials = trials.into_iter().flatten().collect();
    let mut robots = BTreeMap::new();
    for plan in &plans {
        if let Source::Decay(decay) = &plan.source {
            robots.insert(plan.trial.id.clone(), decay.truth.clone());
        }
    }
    let tidy = config.campaign.iter().filter(|(_, one)| recipe.tidy.contains(&one.robot));
    let tidy = tidy.map(|(name, _)| name.clone()).collect();
    let truth = Truth {
        synthetic: true,
        seed: recipe.seed,
        servo: recipe.servo.if_any(),
        slope: recipe.slope,
        off_configured: truth::off_configured(configured, config),
        friction_variation: recipe.friction_variation,
        days,
        tidy,
        campaigns,
        trials,
        robots,
    };
    write_bytes(&folder.join(TRUTH_FILE), truth.to_json().as_bytes())?;
    // The trial list is written last, so that a folder with a list is complete.
    let trial = plans.into_iter().map(|plan| plan.trial).collect();
    let list = TrialList { trial, ..TrialList::default() };
    let header = "# Synthetic trials, written by `trilink synth`.\n\n";
    let text = header.to_owned()
        + &toml::to_string(&list).expect("a trial list can be serialised as TOML");
    write_bytes(&folder.join(TRIALS_FILE), text.as_bytes())?;
    Ok(list.trial)
}

/// Writes the marker file of a trial and returns the trial's true values; `None` if it is not a gait trial.
fn write_trial(
    config: &Config,
    folder: &Path,
    recipe: &Recipe,
    Plan { trial, source, seed }: &Plan,
) -> Result<Option<TrialTruth>, SynthError> {
    let rate_hz = config.vicon.rate_hz;
    let layout = trial.robot_name(config).and_then(|robot| config.marker_layout(robot));
    let layout = layout.unwrap_or_else(|| (&config.markers).into());
    let scene = Scene {
        layout: &layout,
        rate_hz,
        misplaced: recipe.misplaced,
        tilt: recipe.tilt,
        heading_rad: None,
        as_bodies: recipe.format.has_bodies(),
    };
    let write = |film: &Film| {
        let bytes = encoded(recipe.format, &trial.id, &film.markers, &layout);
        write_bytes(&folder.join(&trial.file), &bytes)
    };
    let drive = match source {
        Source::Gait(drive) => drive,
        Source::Decay(decay) => {
            let scene = Scene { heading_rad: decay.truth.heading_rad, ..scene };
            write(&filmed(&scene, &decay.robot, &decay.frames, seed.clone()))?;
            return Ok(None);
        }
    };
    let failed = |source| SynthError::Motion { trial: trial.id.clone(), source };
    let problem = drive.servo.reached(&drive.problem).map_err(failed)?;
    let motion = planted::from_rest(&problem, drive.variation, &drive.cycles, rate_hz);
    let (frames, metrics) = motion.map_err(failed)?;
    let film = filmed(&scene, &problem.robot, &frames, seed.clone());
    write(&film)?;
    Ok(Some(TrialTruth {
        omega_rad_s: problem.omega_rad_s,
        metrics,
        gait: problem.gait.joints[..problem.robot.joints()].to_vec(),
        day: drive.day,
        friction: drive.friction,
        misplaced: film.label_errors,
    }))
}

/// Simulates the recording of a motion, given for every frame.
fn filmed(scene: &Scene, robot: &AnyRobot, frames: &[Posture], random: ChaCha8Rng) -> Film {
    let poses = |frame: usize| {
        let (reference, phi_rad) = &frames[frame];
        let [links, _] = robot.poses(*reference, phi_rad);
        links
    };
    cameras::film(scene, frames.len(), poses, random)
}

/// Encodes the recorded markers of a trial, or the poses of the links that a camera system fits to them.
fn encoded(format: Format, trial: &str, markers: &Recording, layout: &MarkerLayout) -> Vec<u8> {
    if format.has_bodies() {
        format.encode(trial, &bodies::tracked(markers, layout))
    } else {
        format.encode(trial, markers)
    }
}

/// Returns the CSV file of a synthetic recording of a motion, given as `(x, y, theta, phi1, phi2)` for every frame, m
/// and rad.
pub fn export(config: &Config, robot: &Robot, coordinates: &[[f64; 5]], seed: u64) -> Vec<u8> {
    let scene = Scene {
        layout: &(&config.markers).into(),
        rate_hz: config.vicon.rate_hz,
        misplaced: 0.0,
        tilt: Tilt::default(),
        heading_rad: None,
        as_bodies: false,
    };
    let frames = coordinates.iter().map(|[x_m, y_m, theta_rad, angles_rad @ ..]| {
        let mut phi_rad = [0.0; MAX_JOINTS];
        phi_rad[..2].copy_from_slice(angles_rad);
        (Pose { x_m: *x_m, y_m: *y_m, theta_rad: *theta_rad }, phi_rad)
    });
    let frames: Vec<Posture> = frames.collect();
    csv_bytes(&filmed(&scene, &robot.clone().into(), &frames, plan::random(seed, 0)).markers)
}

/// Checks that no user file would be overwritten, and removes the folder's trial list so that the folder is not taken
/// for a complete one until the new list is written. Until then, the truth file marks the folder as synthetic.
fn claim_folder<'p>(
    folder: &Path,
    mut planned: impl Iterator<Item = &'p str>,
) -> Result<(), SynthError> {
    #[derive(serde::Deserialize)]
    struct Known {
        synthetic: bool,
    }
    let error = |path: &Path, source| StoreError::Read { path: path.to_owned(), source };
    let [list, truth] = [TRIALS_FILE, TRUTH_FILE].map(|name| folder.join(name));
    let is_synthetic = match files::read(&truth, files::TEXT_BYTES) {
        Ok((json, _)) => serde_json::from_slice(&json).is_ok_and(|Known { synthetic }| synthetic),
        Err(found) if found.kind() == ErrorKind::NotFound => {
            let mut paths = planned.by_ref().map(|file| folder.join(file)).chain([list.clone()]);
            let is_free = !paths.any(|path| path.symlink_metadata().is_ok());
            if is_free {
                write_bytes(&truth, b"{ \"synthetic\": true }\n")?;
            }
            is_free
        }
        Err(source) => return Err(error(&truth, source).into()),
    };
    if !is_synthetic {
        return Err(SynthError::NotSynthetic { folder: folder.to_owned() });
    }
    match std::fs::remove_file(&list) {
        Err(source) if source.kind() != ErrorKind::NotFound => {
            Err(StoreError::Remove { path: list, source }.into())
        }
        _ => Ok(()),
    }
}
