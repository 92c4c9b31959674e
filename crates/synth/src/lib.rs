//! Trials with a known truth, written as the camera system writes them.
//!
//! The motion is that of a model, `skid-roll` if no other is named, with planted coefficients, from
//! rest, under a servo that does not quite reach its command. Of each robot there is a coast-down too, and a
//! joint-release if one of its joints is passive. The cameras add noise, vibration, tilt and
//! dropouts. The truth goes to `truth.json`, which nothing but the report's comparison reads.
//!
//! [`synthesise`] makes a trial folder by a [`Recipe`]. In the order of its steps:
//!
//! - `plan`: which trials there are, with their robots and laws, drawn from the seed.
//! - `planted`, `servo` and `decay`: the motion of each, with a gait and without.
//! - `cameras`: what the cameras see of it.
//! - `truth`: what was planted, as [`Truth`].
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

mod cameras;
mod decay;
mod plan;
mod planted;
mod servo;
mod truth;

use std::collections::{BTreeMap, BTreeSet};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use trilink_base::cancel::Cancelled;
use trilink_base::files;
use trilink_mechanics::{MotionError, Problem};
use trilink_mocap::{c3d_bytes, csv_bytes};
use trilink_robot::Model;
use trilink_tables::config::{Config, ConfigError};
use trilink_tables::trial::{TRIALS_FILE, TRUTH_FILE, Trial, TrialKind, TrialList, is_valid_id};
use trilink_tables::{StoreError, remove_unfinished, write_bytes};

use cameras::{Film, Scene};
pub use cameras::{LabelError, Tilt};
pub use decay::DecayTruth;
use plan::{Plan, Source};
pub use servo::Servo;
pub use truth::{CampaignTruth, Law, TrialTruth, Truth, planted_models};

/// The paper's frequencies, rad/s: steps of 0.5 and the paper's 3.9.
pub const OMEGAS_RAD_S: [f64; 13] =
    [0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 3.9, 4.0, 4.5, 5.0, 5.5, 6.0];

/// How the marker files are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// Text, as Nexus exports `Trajectories`; six significant digits.
    Csv,
    /// Vicon's own binary format.
    C3d,
}

impl Format {
    /// A trial in this format, of no campaign or robot yet.
    fn trial(self, id: String, kind: TrialKind) -> Trial {
        let extension = match self {
            Self::Csv => "csv",
            Self::C3d => "c3d",
        };
        Trial {
            file: format!("{id}.{extension}"),
            id,
            kind,
            campaign: None,
            robot: None,
            omega_rad_s: None,
            smoothing_window: None,
        }
    }

    fn bytes(self, film: &Film) -> Vec<u8> {
        match self {
            Self::Csv => csv_bytes(&film.markers),
            Self::C3d => c3d_bytes(&film.markers),
        }
    }
}

/// More frames, two hours at 120 Hz, may not fit into memory.
const MOST_FRAMES: f64 = 864_000.0;

/// Why trials could not be made.
#[derive(Debug, thiserror::Error)]
pub enum SynthError {
    #[error("{}: has trials that were not made by synth; give another folder", folder.display())]
    NotSynthetic { folder: PathBuf },
    #[error(
        "trial `{trial}`: cannot name a file; needed a campaign's name of the characters A-Z a-z 0-9 . _ -, at most 52 of them"
    )]
    Name { trial: String },
    #[error("trial `{trial}`: planned twice; needed frequencies that differ by 0.01 rad/s or more")]
    Twice { trial: String },
    #[error(
        "trial `{trial}`: found more than {MOST_FRAMES} frames, needed a higher frequency or a lower vicon.rate_hz"
    )]
    TooLong { trial: String },
    #[error("--law: {0}")]
    Law(String),
    #[error(
        "--repeat-omega: found {omega_rad_s} rad/s, needed frequencies of the trials: {}", listed(.known)
    )]
    Repeat { omega_rad_s: f64, known: Vec<f64> },
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

/// What is to be made.
#[derive(Debug, Clone)]
pub struct Recipe {
    /// Of everything random; the same seed gives the same bytes.
    pub seed: u64,
    /// Of what the cameras add and cycles differ by, if it is not the same: another recording.
    pub noise_seed: Option<u64>,
    /// The model whose laws make a robot's motion, `skid-roll` of robots that are not named.
    pub laws: BTreeMap<String, Model>,
    /// What the planted skid coefficients of wheels 0, 1, 2 are multiplied by.
    pub skid_factors: [f64; 3],
    /// Frequencies of every campaign, rad/s.
    pub omegas_rad_s: Vec<f64>,
    /// Robots whose trials have no repeats, days, servos or varying friction.
    pub tidy: BTreeSet<String>,
    /// Trials of each frequency.
    pub repeats: usize,
    /// The frequencies that have repeats; all, if it is empty.
    pub repeated_rad_s: Vec<f64>,
    /// Days over which the trials of a campaign are dealt, each with a floor of its own.
    pub days: usize,
    pub servo: Servo,
    /// Relative standard deviation of the wheels' friction from cycle to cycle.
    pub friction_variation: f64,
    pub format: Format,
    /// Part of the frames in which a marker of one link is swapped with another of it, or
    /// jumps by 20 mm.
    pub misplaced: f64,
    pub tilt: Tilt,
}

impl Recipe {
    /// The paper's frequencies as CSV, without misplaced markers.
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
            friction_variation: 0.0,
            format: Format::Csv,
            misplaced: 0.0,
            tilt: Tilt::default(),
        }
    }

    /// The demo's. Robots that have no passive joint and say their dry friction are made with `coulomb`:
    /// three trials of some frequencies, days whose floors differ, servos that lag and give way, friction
    /// that varies from cycle to cycle. Others are tidy and made with `skid-roll`.
    pub fn demo(config: &Config, seed: u64) -> Self {
        let model = Model::new("coulomb");
        let is_passive = |robot: &str| {
            let mut campaigns = config.campaign.iter().filter(|(_, one)| one.robot == robot);
            campaigns.any(|(name, _)| {
                config.campaign_setup(name).is_none_or(|(_, gait)| gait.passive_joint().is_some())
            })
        };
        let is_dry = |robot: &&String| {
            let knows = config.check_laws(Path::new("demo"), robot, model).is_ok();
            knows && !is_passive(robot)
        };
        let robots = config.campaign.values().map(|campaign| campaign.robot.clone());
        let (dry, tidy): (BTreeSet<_>, _) = robots.partition(|robot| is_dry(&robot));
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

    /// How many trials it makes of a configuration.
    pub fn trials(&self, config: &Config) -> usize {
        let of = |robot| self.omegas_rad_s.iter().map(move |omega| self.repeats_of(robot, *omega));
        let gaits: usize = config.campaign.values().flat_map(|campaign| of(&campaign.robot)).sum();
        gaits + plan::decays(config, self).len()
    }

    /// How many trials a frequency has in each of a robot's campaigns.
    fn repeats_of(&self, robot: &str, omega_rad_s: f64) -> usize {
        let Self { repeated_rad_s: of, .. } = self;
        let is_repeated = of.is_empty() || of.contains(&omega_rad_s);
        if is_repeated && !self.tidy.contains(robot) { self.repeats } else { 1 }
    }
}

/// Writes a trial folder: every campaign of the configuration at every frequency, a coast-down
/// of every robot in them and a release of every passive joint. The same
/// seed gives the same bytes, and the same motion and noise in every format.
///
/// # Errors
/// A law is not known or needs what its robot does not say, the folder holds trials that are not
/// synthetic, a planted motion does not exist, or a file cannot be written.
pub fn synthesise(
    config: &Config,
    folder: &Path,
    recipe: &Recipe,
    on_trial: &(dyn Fn(&str) -> Result<(), Cancelled> + Sync),
) -> Result<Vec<Trial>, SynthError> {
    plan::check(config, recipe)?;
    let (mut plans, campaigns, days) = plan::gaits(config, recipe);
    plans.extend(plan::decays(config, recipe));
    let mut ids = BTreeSet::new();
    for Plan { trial: Trial { id, .. }, source, .. } in &plans {
        if !is_valid_id(id) {
            return Err(SynthError::Name { trial: id.clone() });
        }
        if let Source::Gait(drive) = source
            && planted::least_frames(drive.problem.omega_rad_s, config.vicon.rate_hz) > MOST_FRAMES
        {
            return Err(SynthError::TooLong { trial: id.clone() });
        }
        if !ids.insert(id) {
            return Err(SynthError::Twice { trial: id.clone() });
        }
    }
    take_over(folder, plans.iter().map(|plan| plan.trial.file.as_str()))?;
    remove_unfinished(&[folder.to_owned()])?;
    let Recipe { seed, format, misplaced, tilt, servo, friction_variation, .. } = *recipe;
    let (rate_hz, layout) = (config.vicon.rate_hz, &config.markers);
    let make = |Plan { trial, robot, source, seed }: &Plan| {
        let scene = Scene { robot, layout, rate_hz, misplaced, tilt };
        let film = |coordinates: &[[f64; 5]]| cameras::film(&scene, coordinates, seed.clone());
        let (film, steady) = match source {
            Source::Gait(drive) => {
                let failed = |source| SynthError::Motion { trial: trial.id.clone(), source };
                let problem = drive.servo.reached(&drive.problem).map_err(failed)?;
                let made = planted::from_rest(&problem, drive.variation, &drive.cycles, rate_hz);
                let (path, steady) = made.map_err(failed)?;
                (film(&path), Some((problem, drive.day, steady)))
            }
            Source::Decay(decay) => (film(&decay.coordinates), None),
        };
        write_bytes(&folder.join(&trial.file), &format.bytes(&film))?;
        on_trial(&trial.id)?;
        let truth =
            |(Problem { gait, omega_rad_s, .. }, day, metrics): (Problem, _, _)| TrialTruth {
                omega_rad_s,
                metrics,
                gait: gait.joints,
                day,
                misplaced: film.label_errors,
            };
        Ok(steady.map(|steady| (trial.id.clone(), truth(steady))))
    };
    let made: Vec<_> = plans.par_iter().map(make).collect::<Result<_, SynthError>>()?;
    let trials = made.into_iter().flatten().collect();
    let robots = plans.iter().filter_map(|plan| match &plan.source {
        Source::Gait(_) => None,
        Source::Decay(decay) => Some((plan.trial.id.clone(), decay.truth.clone())),
    });
    let robots = robots.collect();
    let is_tidy = |name: &&String| recipe.tidy.contains(&config.campaign[*name].robot);
    let tidy = config.campaign.keys().filter(is_tidy).cloned().collect();
    let (servo, synthetic) = (servo.if_any(), true);
    let truth =
        Truth { synthetic, seed, servo, friction_variation, days, tidy, campaigns, trials, robots };
    write_bytes(&folder.join(TRUTH_FILE), truth.to_json().as_bytes())?;
    // The list comes last: a folder with a list is complete.
    let trial = plans.into_iter().map(|plan| plan.trial).collect();
    let list = TrialList { trial, ..TrialList::default() };
    let header = "# Synthetic trials, written by `trilink synth`.\n\n";
    let text = header.to_owned() + &toml::to_string(&list).expect("a trial list is plain TOML");
    write_bytes(&folder.join(TRIALS_FILE), text.as_bytes())?;
    Ok(list.trial)
}

/// Any motion, `(x, y, theta, phi1, phi2)` of every frame (m and rad), as the camera system exports it to
/// CSV.
pub fn export(
    config: &Config,
    robot: &trilink_robot::Robot,
    coordinates: &[[f64; 5]],
    seed: u64,
) -> Vec<u8> {
    let (layout, rate_hz) = (&config.markers, config.vicon.rate_hz);
    let scene = Scene { robot, layout, rate_hz, misplaced: 0.0, tilt: Tilt::default() };
    Format::Csv.bytes(&cameras::film(&scene, coordinates, plan::random(seed, 0)))
}

/// Makes sure that no file of others is overwritten, and that nobody takes the folder for a
/// folder of trials until it is complete: until then it has no list, and a truth that says what
/// its files are.
fn take_over<'p>(
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
            let mut places = planned.by_ref().map(|file| folder.join(file)).chain([list.clone()]);
            let taken = places.find(|place| place.symlink_metadata().is_ok());
            if taken.is_none() {
                write_bytes(&truth, b"{ \"synthetic\": true }\n")?;
            }
            taken.is_none()
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
