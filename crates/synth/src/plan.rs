//! What is to be made: trials with their robots and laws, drawn from the seed.

use std::collections::BTreeMap;
use std::path::Path;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, LogNormal};
use trilink_mechanics::{Laws, Problem};
use trilink_robot::{Model, Robot};
use trilink_tables::config::{Config, one_of};
use trilink_tables::trial::{Trial, TrialKind};

use super::decay::{self, Decay};
use super::{CampaignTruth, Law, Recipe, Servo, SynthError, planted};

/// Random numbers of the trials that belong to no campaign.
const DECAY_STREAMS: u64 = 1 << 32;
/// Those of a robot's own coefficients, and of the floors of days.
const ROBOT_STREAMS: u64 = 1 << 33;
const DAYS_STREAM: u64 = 1 << 34;
/// Distance of those of the trials that repeat a frequency from the first one's.
const REPEAT_STREAMS: u64 = 1 << 40;
/// Distance of those that a trial's cycles differ by from what its cameras add.
const CYCLE_STREAMS: u64 = 1 << 60;
/// Relative standard deviation of friction from day to day: dust, cleaning, humidity (assumed).
const DAYS_SPREAD: f64 = 0.03;

/// One trial to be made.
pub(super) struct Plan {
    pub trial: Trial,
    pub robot: Robot,
    pub source: Source,
    /// Of what the cameras add.
    pub seed: ChaCha8Rng,
}

pub(super) enum Source {
    Gait(Box<Drive>),
    /// A motion that gives the robot's own parameters.
    Decay(Decay),
}

/// The planted robot on a day's floor under its command.
pub(super) struct Drive {
    pub problem: Problem,
    /// The day from 1 on, where there are several.
    pub day: Option<usize>,
    pub servo: Servo,
    /// Relative standard deviation of friction from cycle to cycle.
    pub variation: f64,
    /// Of what cycles differ by.
    pub cycles: ChaCha8Rng,
}

/// Checks that the laws are there, their robots say what they need, and the repeated frequencies
/// are among those of the trials.
pub(super) fn check(config: &Config, recipe: &Recipe) -> Result<(), SynthError> {
    for (robot, model) in &recipe.laws {
        if !config.robot.contains_key(robot) {
            let needed = one_of(robot, &config.robot, "");
            return Err(SynthError::Law(format!("found robot `{robot}`, needed {needed}")));
        }
        match config.model.get(model) {
            Some(known) if known.is_of_trials() => {
                return Err(SynthError::Law(format!(
                    "model `{model}` is driven by the measured gaits of trials and has no motion of \
                     its own; needed a model without input = \"measured\""
                )));
            }
            Some(_) => config.check_laws(Path::new("--law"), robot, *model)?,
            None => {
                let needed = one_of(model.name(), &config.model, "");
                return Err(SynthError::Law(format!("found model `{model}`, needed {needed}")));
            }
        }
    }
    let known = &recipe.omegas_rad_s;
    match recipe.repeated_rad_s.iter().find(|omega| !known.contains(omega)) {
        Some(&omega_rad_s) => Err(SynthError::Repeat { omega_rad_s, known: known.clone() }),
        None => Ok(()),
    }
}

/// The laws of a robot's wheels that the recipe names.
fn named(config: &Config, recipe: &Recipe, robot: &str) -> Option<(Model, Laws)> {
    let model = recipe.laws.get(robot)?;
    Some((*model, config.model.get(model)?.laws()))
}

pub(super) fn random(seed: u64, stream: u64) -> ChaCha8Rng {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream(stream);
    random
}

/// The friction of each day's floor as a part of the days' mean, by the day's number.
fn floors(recipe: &Recipe) -> BTreeMap<usize, f64> {
    if recipe.days < 2 {
        return BTreeMap::new();
    }
    let spread = LogNormal::new(0.0, DAYS_SPREAD).expect("a positive deviation");
    let mut random = random(recipe.seed, DAYS_STREAM);
    let drawn: Vec<f64> = (0..recipe.days).map(|_| spread.sample(&mut random)).collect();
    let mean = drawn.iter().sum::<f64>() / drawn.len() as f64;
    (1..).zip(drawn.into_iter().map(|one| one / mean)).collect()
}

/// Draws what is planted and lists the trials; with the floors of days.
pub(super) fn gaits(
    config: &Config,
    recipe: &Recipe,
) -> (Vec<Plan>, BTreeMap<String, CampaignTruth>, BTreeMap<usize, f64>) {
    let Recipe { seed, ref omegas_rad_s, format, .. } = *recipe;
    let days = floors(recipe);
    let (mut plans, mut campaigns) = (Vec::new(), BTreeMap::new());
    for (number, (name, campaign)) in config.campaign.iter().enumerate() {
        let Some((robot, gait)) = config.campaign_setup(name) else { continue };
        let law = named(config, recipe, &campaign.robot);
        let laws = law.map_or(Laws::SKID_ROLL, |(_, laws)| laws);
        // One stream of random numbers for the campaign and one for each of its trials.
        let first = (number * (omegas_rad_s.len() + 1)) as u64;
        let (viscous, gait) = planted::planted(name, &robot, gait, &mut random(seed, first));
        // A robot has one floor; the viscous coefficients that the paper fits differ by campaign.
        let mut robot = match laws.are_linear() {
            true => viscous,
            false => {
                let robots = config.robot.keys().position(|known| *known == campaign.robot);
                let stream = ROBOT_STREAMS + robots.unwrap_or(0) as u64;
                planted::floor(robot, &mut random(seed, stream))
            }
        };
        for (of, wheel) in planted::resistances_to_skidding() {
            let value = of.of(&robot) * recipe.skid_factors[wheel];
            of.set(&mut robot, value);
        }
        let law =
            law.filter(|(model, laws)| (*model, *laws) != (Model::SKID_ROLL, Laws::SKID_ROLL));
        let law = law.map(|(model, Laws { skid, roll })| Law { model, skid, roll });
        campaigns.insert(name.clone(), CampaignTruth::new(law, laws, &robot, &gait));
        let (of, is_tidy) = (&*campaign.robot, recipe.tidy.contains(&campaign.robot));
        let (servo, variation) = match is_tidy {
            true => Default::default(),
            false => (recipe.servo, recipe.friction_variation),
        };
        let frequencies = omegas_rad_s.iter().copied().enumerate();
        let trials = frequencies.flat_map(|(i, omega)| {
            (0..recipe.repeats_of(of, omega)).map(move |nth| (i, omega, nth))
        });
        for (place, (i, omega_rad_s, nth)) in trials.enumerate() {
            let id = format!("{name}-{omega_rad_s:.2}-r{}", nth + 1);
            let (campaign, omega) = (Some(name.clone()), Some(omega_rad_s));
            let trial = format.trial(id, TrialKind::Gait);
            let trial = Trial { campaign, omega_rad_s: omega, ..trial };
            let stream = first + 1 + i as u64 + REPEAT_STREAMS * nth as u64;
            let noise_seed = recipe.noise_seed.unwrap_or(seed);
            let day = 1 + place % recipe.days.max(1);
            let floor = days.get(&day).filter(|_| !is_tidy);
            let robot = floor.map_or_else(|| robot.clone(), |floor| robot.resisted(*floor));
            let source = Source::Gait(Box::new(Drive {
                problem: Problem { robot: robot.clone(), gait, laws, omega_rad_s },
                day: floor.map(|_| day),
                servo,
                variation,
                cycles: random(noise_seed, CYCLE_STREAMS + stream),
            }));
            plans.push(Plan { trial, robot, source, seed: random(noise_seed, stream) });
        }
    }
    (plans, campaigns, days)
}

/// A coast-down of every robot that a campaign names, and a release of its passive joint.
pub(super) fn decays(config: &Config, recipe: &Recipe) -> Vec<Plan> {
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
        // What resists a robot of which no law is named is what the configuration says of it.
        let robot = match named(config, recipe, name) {
            Some((_, laws)) => laws.effective(&robot),
            None => robot,
        };
        let rate_hz = config.vicon.rate_hz;
        for (kind, stream) in [(TrialKind::JointRelease, 0), (TrialKind::CoastDown, 1)] {
            let mut seed = random(recipe.seed, DECAY_STREAMS + 2 * i + stream);
            let decay = match (kind, passive) {
                (TrialKind::CoastDown, _) => decay::coasting(name, &robot, rate_hz, &mut seed),
                (_, Some(joint)) => decay::released(name, &robot, joint, rate_hz, &mut seed),
                _ => None,
            };
            let id = format!("{name}-{}-r1", kind.name());
            let trial = Trial { robot: Some(name.to_owned()), ..recipe.format.trial(id, kind) };
            if let Some(noise_seed) = recipe.noise_seed {
                let position = seed.get_word_pos();
                seed = random(noise_seed, seed.get_stream());
                seed.set_word_pos(position);
            }
            let robot = robot.clone();
            let source = decay.map(Source::Decay);
            plans.extend(source.map(|source| Plan { trial, robot, source, seed }));
        }
    }
    plans
}
