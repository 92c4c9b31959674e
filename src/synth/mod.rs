//! Trials with a known truth, written as the camera system writes them.
//!
//! The motion is that of `skid-roll` with planted coefficients, from rest, under a servo that
//! does not quite reach its command. Of each robot there is a coast-down too, and a
//! joint-release if one of its joints is passive. The cameras add noise, vibration, tilt and
//! dropouts. The truth goes to `truth.json`, which nothing but the report's comparison reads.

mod c3d;
mod cameras;
mod csv;
mod decay;
mod planted;
mod truth;

use std::collections::{BTreeMap, BTreeSet};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::config::Config;
use crate::files;
use crate::motion::{Laws, MotionError, Problem};
use crate::robot::Robot;
use crate::store::{StoreError, remove_unfinished, write_bytes};
use crate::trial::{TRIALS_FILE, TRUTH_FILE, Trial, TrialKind, TrialList, is_valid_id};

use cameras::{Film, Scene};
pub use cameras::{LabelError, Tilt};
use decay::Decay;
pub use decay::DecayTruth;
pub use truth::{CampaignTruth, TrialTruth, Truth};

/// The paper's frequencies, rad/s: steps of 0.5 and the paper's 3.9.
pub const OMEGAS_RAD_S: [f64; 13] =
    [0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 3.9, 4.0, 4.5, 5.0, 5.5, 6.0];

/// How the marker files are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
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
            Self::Csv => csv::csv(film),
            Self::C3d => c3d::c3d(film),
        }
    }
}

/// More frames, two hours at 120 Hz, may not fit into memory.
const MOST_FRAMES: f64 = 864_000.0;

/// Random numbers of the trials that belong to no campaign.
const DECAY_STREAMS: u64 = 1 << 32;

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
    #[error("trial `{trial}`: {source}")]
    Motion { trial: String, source: MotionError },
    #[error(transparent)]
    Store(#[from] StoreError),
}

/// What is to be made.
#[derive(Debug, Clone)]
pub struct Recipe {
    /// Of everything random; the same seed gives the same bytes.
    pub seed: u64,
    /// Of what the cameras add, if it is not the same: another recording of the same motion.
    pub noise_seed: Option<u64>,
    /// What the planted skid coefficients of wheels 0, 1, 2 are multiplied by.
    pub skid_factors: [f64; 3],
    /// Frequencies of every campaign, rad/s.
    pub omegas_rad_s: Vec<f64>,
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
            skid_factors: [1.0; 3],
            omegas_rad_s: OMEGAS_RAD_S.into(),
            format: Format::Csv,
            misplaced: 0.0,
            tilt: Tilt::default(),
        }
    }

    /// How many trials it makes of a configuration.
    pub fn trials(&self, config: &Config) -> usize {
        config.campaign.len() * self.omegas_rad_s.len() + plan_decays(config, self).len()
    }
}

/// One trial to be made.
struct Plan {
    trial: Trial,
    robot: Robot,
    source: Source,
    seed: ChaCha8Rng,
}

enum Source {
    /// The planted robot under the gait that its servo reaches.
    Gait(Problem),
    /// A motion that gives the robot's own parameters.
    Decay(Decay),
}

/// Writes a trial folder: every campaign of the configuration at every frequency, a coast-down
/// of every robot in them and a release of every passive joint. The same
/// seed gives the same bytes, and the same motion and noise in every format.
///
/// # Errors
/// The folder holds trials that are not synthetic, a planted motion does not exist, or a file
/// cannot be written.
pub fn synthesise(
    config: &Config,
    folder: &Path,
    recipe: &Recipe,
    on_trial: &(dyn Fn(&str) + Sync),
) -> Result<Vec<Trial>, SynthError> {
    let (mut plans, campaigns) = plan_gaits(config, recipe);
    plans.extend(plan_decays(config, recipe));
    let mut ids = BTreeSet::new();
    for Plan { trial: Trial { id, .. }, source, .. } in &plans {
        if !is_valid_id(id) {
            return Err(SynthError::Name { trial: id.clone() });
        }
        if let Source::Gait(Problem { omega_rad_s, .. }) = source
            && planted::least_frames(*omega_rad_s, config.vicon.rate_hz) > MOST_FRAMES
        {
            return Err(SynthError::TooLong { trial: id.clone() });
        }
        if !ids.insert(id) {
            return Err(SynthError::Twice { trial: id.clone() });
        }
    }
    take_over(folder, plans.iter().map(|plan| plan.trial.file.as_str()))?;
    remove_unfinished(&[folder.to_owned()])?;
    let Recipe { seed, format, misplaced, tilt, .. } = *recipe;
    let (rate_hz, layout) = (config.vicon.rate_hz, &config.markers);
    let make = |Plan { trial, robot, source, seed }: &Plan| {
        let scene = Scene { robot, layout, rate_hz, misplaced, tilt };
        let film = |coordinates: &[[f64; 5]]| cameras::film(&scene, coordinates, seed.clone());
        let (film, steady) = match source {
            Source::Gait(problem) => {
                let failed = |source| SynthError::Motion { trial: trial.id.clone(), source };
                let (path, steady) = planted::from_rest(problem, rate_hz).map_err(failed)?;
                (film(&path), Some((problem, steady)))
            }
            Source::Decay(decay) => (film(&decay.coordinates), None),
        };
        write_bytes(&folder.join(&trial.file), &format.bytes(&film))?;
        on_trial(&trial.id);
        let truth = |(Problem { gait, omega_rad_s, .. }, metrics): (&Problem, _)| TrialTruth {
            omega_rad_s: *omega_rad_s,
            metrics,
            gait: gait.joints,
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
    let truth = Truth { synthetic: true, seed, campaigns, trials, robots: robots.collect() };
    write_bytes(&folder.join(TRUTH_FILE), truth.to_json().as_bytes())?;
    // The list comes last: a folder with a list is complete.
    let trial = plans.into_iter().map(|plan| plan.trial).collect();
    let list = TrialList { ignore: Vec::new(), trial };
    let header = "# Synthetic trials, written by `trilink synth`.\n\n";
    let text = header.to_owned() + &toml::to_string(&list).expect("a trial list is plain TOML");
    write_bytes(&folder.join(TRIALS_FILE), text.as_bytes())?;
    Ok(list.trial)
}

/// Any motion, `(x, y, theta, phi1, phi2)` of every frame, as the camera system exports it.
#[cfg(test)]
pub(crate) fn export(
    config: &Config,
    robot: &Robot,
    coordinates: &[[f64; 5]],
    seed: u64,
) -> Vec<u8> {
    let (layout, rate_hz) = (&config.markers, config.vicon.rate_hz);
    let scene = Scene { robot, layout, rate_hz, misplaced: 0.0, tilt: Tilt::default() };
    Format::Csv.bytes(&cameras::film(&scene, coordinates, ChaCha8Rng::seed_from_u64(seed)))
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

/// Draws what is planted and lists the trials.
fn plan_gaits(config: &Config, recipe: &Recipe) -> (Vec<Plan>, BTreeMap<String, CampaignTruth>) {
    let Recipe { seed, ref omegas_rad_s, format, .. } = *recipe;
    let (mut plans, mut campaigns) = (Vec::new(), BTreeMap::new());
    for (number, name) in config.campaign.keys().enumerate() {
        let Some((robot, gait)) = config.campaign_setup(name) else { continue };
        // One stream of random numbers for the campaign and one for each of its trials.
        let stream = |trial: usize| {
            let noise_seed = recipe.noise_seed.filter(|_| trial > 0);
            let mut random = ChaCha8Rng::seed_from_u64(noise_seed.unwrap_or(seed));
            random.set_stream((number * (omegas_rad_s.len() + 1) + trial) as u64);
            random
        };
        let (mut robot, gait) = planted::planted(name, robot, gait, &mut stream(0));
        robot.skid_kg_s = [0, 1, 2].map(|i| robot.skid_kg_s[i] * recipe.skid_factors[i]);
        campaigns.insert(name.clone(), CampaignTruth::new(&robot, &gait));
        for (i, omega_rad_s) in omegas_rad_s.iter().copied().enumerate() {
            let id = format!("{name}-{omega_rad_s:.2}-r1");
            let (campaign, omega) = (Some(name.clone()), Some(omega_rad_s));
            let trial = format.trial(id, TrialKind::Gait);
            let trial = Trial { campaign, omega_rad_s: omega, ..trial };
            let robot = robot.clone();
            let source = Source::Gait(Problem {
                robot: robot.clone(),
                gait,
                laws: Laws::SKID_ROLL,
                omega_rad_s,
            });
            plans.push(Plan { trial, robot, source, seed: stream(i + 1) });
        }
    }
    (plans, campaigns)
}

/// A coast-down of every robot that a campaign names, and a release of its passive joint.
fn plan_decays(config: &Config, recipe: &Recipe) -> Vec<Plan> {
    // The passive joint of each robot: the first campaign that has one says which.
    let mut robots: BTreeMap<&str, Option<usize>> = BTreeMap::new();
    for (name, campaign) in &config.campaign {
        let passive = config.campaign_setup(name).and_then(|(_, gait)| gait.passive_joint());
        let known = robots.entry(&campaign.robot).or_default();
        *known = known.or(passive);
    }
    let mut plans = Vec::new();
    for (i, (name, passive)) in (0..).zip(robots) {
        let Some(robot) = config.robot.get(name).map(|robot| robot.to_robot()) else { continue };
        let rate_hz = config.vicon.rate_hz;
        for (kind, stream) in [(TrialKind::JointRelease, 0), (TrialKind::CoastDown, 1)] {
            let mut seed = ChaCha8Rng::seed_from_u64(recipe.seed);
            seed.set_stream(DECAY_STREAMS + 2 * i + stream);
            let decay = match (kind, passive) {
                (TrialKind::CoastDown, _) => decay::coasting(name, &robot, rate_hz, &mut seed),
                (_, Some(joint)) => decay::released(name, &robot, joint, rate_hz, &mut seed),
                _ => None,
            };
            let id = format!("{name}-{}-r1", kind.name());
            let trial = Trial { robot: Some(name.to_owned()), ..recipe.format.trial(id, kind) };
            if let Some(noise_seed) = recipe.noise_seed {
                let (stream, position) = (seed.get_stream(), seed.get_word_pos());
                seed = ChaCha8Rng::seed_from_u64(noise_seed);
                seed.set_stream(stream);
                seed.set_word_pos(position);
            }
            let robot = robot.clone();
            let source = decay.map(Source::Decay);
            plans.extend(source.map(|source| Plan { trial, robot, source, seed }));
        }
    }
    plans
}
