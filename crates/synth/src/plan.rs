//! Plans the trials, with robots and laws drawn from the seed.

use std::collections::BTreeMap;
use std::path::Path;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, LogNormal, StandardNormal};
use trilink_mechanics::{Laws, Problem};
use trilink_robot::{AnyRobot, Joint, Model};
use trilink_tables::config::{Campaign, Config, GaitConfig, one_of};
use trilink_tables::trial::{Trial, TrialKind};

use super::decay::{self, Decay};
use super::{
    CampaignTruth, Law, Recipe, Servo, Slope, SynthError, blank_trial, bodies, chain, planted,
};

/// First random-number stream for joint releases and coast-downs.
const DECAY_STREAMS: u64 = 1 << 32;
/// First random-number stream for the robots' coefficients.
const ROBOT_STREAMS: u64 = 1 << 33;
/// First random-number stream for the errors of the robots' configured values.
const ERROR_STREAMS: u64 = 1 << 35;
/// Random-number stream for the floor friction of each day.
const DAYS_STREAM: u64 = 1 << 34;
/// Offset between the random-number streams for repeated trials at the same frequency.
const REPEAT_STREAMS: u64 = 1 << 40;
/// Offset from the random-number stream for a trial's cameras to that for the trial's cycle-to-cycle variation.
const CYCLE_STREAMS: u64 = 1 << 60;
/// First stream of the random-number generators for the friction of trials.
const TRIAL_STREAMS: u64 = 1 << 61;
/// Friction of a trial that is unlike its repeats, relative to theirs.
const UNLIKE_FRICTION: f64 = 1.5;
/// Assumed relative standard deviation of friction from day to day, due to dust, cleaning and humidity.
const DAYS_SPREAD: f64 = 0.03;

/// Plan of one synthetic trial.
pub(super) struct Plan {
    pub trial: Trial,
    pub source: Source,
    /// Random-number generator for the cameras.
    pub seed: ChaCha8Rng,
}

/// Source of the motion in a trial.
pub(super) enum Source {
    Gait(Box<Drive>),
    /// Joint release or coast-down.
    Decay(Box<Decay>),
}

/// Commanded robot of a gait trial, with its true coefficients on the floor of the trial's day.
pub(super) struct Drive {
    pub problem: Problem,
    /// Number of the trial's day, counted from 1; `None` if the trials are not distributed over several days, or if the
    /// robot is tidy, so that the day has no effect.
    pub day: Option<usize>,
    /// Friction of the trial relative to that of its day.
    pub friction: f64,
    pub servo: Servo,
    /// Relative standard deviation of friction from cycle to cycle.
    pub variation: f64,
    /// Random-number generator for the variation from cycle to cycle.
    pub cycles: ChaCha8Rng,
}

/// Checks that the robots and models named by the recipe exist, that no model needs measured gaits, that each robot has
/// the coefficients that its model needs, that chains have a marker layout, and that the repeated frequencies are among
/// those of the recipe.
pub(super) fn check(config: &Config, recipe: &Recipe) -> Result<(), SynthError> {
    for (robot, model) in &recipe.laws {
        if !config.robot.contains_key(robot) {
            let needed = one_of(robot, &config.robot, "");
            return Err(SynthError::Law(format!("found robot `{robot}`, needed {needed}")));
        }
        match config.model.get(model) {
            Some(known) if known.is_of_trials() => {
                return Err(SynthError::Law(format!(
                    "model `{model}` is driven by the measured gaits of trials, so it cannot generate motions; choose \
                     a model without input = \"measured\""
                )));
            }
            Some(_) => config.check_laws(Path::new("--law"), robot, *model)?,
            None => {
                let needed = one_of(model.name(), &config.model, "");
                return Err(SynthError::Law(format!("found model `{model}`, needed {needed}")));
            }
        }
    }
    for (campaign, Campaign { robot, .. }) in &config.campaign {
        if config.marker_layout(robot).is_none() {
            let needed = config.needed_layout(robot);
            return Err(SynthError::NoLayout { campaign: campaign.clone(), needed });
        }
    }
    if recipe.format.has_bodies() {
        for robot in config.campaign.values().map(|campaign| &campaign.robot) {
            let Some(layout) = config.marker_layout(robot) else { continue };
            let sizes = layout.links().into_iter().map(BTreeMap::len).enumerate();
            let mut sizes = sizes.filter(|(_, markers)| *markers > 0);
            if let Some((link, markers)) = sizes.find(|(_, size)| *size < bodies::MIN_MARKERS) {
                return Err(SynthError::Body { robot: robot.clone(), link, markers });
            }
        }
    }
    let known = &recipe.omegas_rad_s;
    match recipe.repeated_rad_s.iter().find(|omega| !known.contains(omega)) {
        Some(&omega_rad_s) => Err(SynthError::Repeat { omega_rad_s, known: known.clone() }),
        None => Ok(()),
    }
}

/// Returns the configuration with robots that are off their configured values by errors drawn from the configured
/// standard deviations. An error of more than three standard deviations is drawn again.
pub(super) fn with_declared_errors(config: &Config, seed: u64) -> Config {
    let mut config = config.clone();
    let mut streams = ERROR_STREAMS..;
    let mut draws = || {
        let normal = StandardNormal.sample_iter(random(seed, streams.next().unwrap_or_default()));
        let mut normal = normal.filter(|z: &f64| z.abs() < 3.0);
        move || normal.next().unwrap_or_default()
    };
    config.robot.values_mut().for_each(|robot| *robot = robot.with_errors(draws()));
    config
}

/// Returns the model that the recipe assigns to a robot, with the model's laws; `None` if it assigns none.
fn named_laws(config: &Config, recipe: &Recipe, robot: &str) -> Option<(Model, Laws)> {
    let model = recipe.laws.get(robot)?;
    Some((*model, config.model.get(model)?.laws()))
}

/// Returns the random-number generator for a seed and a stream.
pub(super) fn random(seed: u64, stream: u64) -> ChaCha8Rng {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream(stream);
    random
}

/// Draws the friction of each day's floor relative to that of the population of days, by number of the day; empty if
/// there is a single day.
fn floors(recipe: &Recipe) -> BTreeMap<usize, f64> {
    if recipe.days < 2 {
        return BTreeMap::new();
    }
    let spread = LogNormal::new(0.0, DAYS_SPREAD).expect("a positive deviation");
    let mut random = random(recipe.seed, DAYS_STREAM);
    (1..=recipe.days).map(|day| (day, spread.sample(&mut random))).collect()
}

/// Trials of a campaign, before their motions are known.
struct Schedule<'r> {
    recipe: &'r Recipe,
    /// Friction of each day.
    days: &'r BTreeMap<usize, f64>,
    campaign: &'r str,
    robot: &'r str,
    /// First random-number stream of the campaign, which is its own; one for each of its trials follows.
    first: u64,
}

impl Schedule<'_> {
    /// Returns the plans of the trials. `problem` returns the equations of motion at a frequency with all friction
    /// multiplied by a factor.
    fn plans(&self, problem: impl Fn(f64, f64) -> Problem) -> Vec<Plan> {
        let Self { recipe, days, campaign, robot, first } = *self;
        let is_tidy = recipe.tidy.contains(robot);
        let (servo, variation) =
            if is_tidy { Default::default() } else { (recipe.servo, recipe.friction_variation) };
        let frequencies = recipe.omegas_rad_s.iter().copied().enumerate();
        let trials = frequencies.flat_map(|(i, omega)| {
            (0..recipe.repeats_of(robot, omega)).map(move |repeat| (i, omega, repeat))
        });
        let trials: Vec<(usize, f64, usize)> = trials.collect();
        let spread = LogNormal::new(0.0, if is_tidy { 0.0 } else { recipe.trial_variation });
        let spread = spread.expect("a deviation that is not negative");
        let unlike = if is_tidy { 0 } else { recipe.unlike };
        let trial_count = trials.len();
        let plan = |(index, (i, omega_rad_s, repeat)): (usize, (usize, f64, usize))| {
            let id = format!("{campaign}-{omega_rad_s:.2}-r{}", repeat + 1);
            let stream = first + 1 + i as u64 + REPEAT_STREAMS * repeat as u64;
            let noise_seed = recipe.noise_seed.unwrap_or(recipe.seed);
            let day = 1 + index % recipe.days.max(1);
            let trial = Trial {
                campaign: Some(campaign.to_owned()),
                omega_rad_s: Some(omega_rad_s),
                day: (recipe.days > 1).then(|| format!("day {day}")),
                ..blank_trial(id, recipe.format, TrialKind::Gait)
            };
            let floor = days.get(&day).filter(|_| !is_tidy);
            let mut friction = spread.sample(&mut random(noise_seed, TRIAL_STREAMS + stream));
            // Spread over the trials.
            if index * unlike / trial_count < (index + 1) * unlike / trial_count {
                friction *= UNLIKE_FRICTION;
            }
            let source = Source::Gait(Box::new(Drive {
                problem: problem(omega_rad_s, friction * floor.copied().unwrap_or(1.0)),
                day: floor.map(|_| day),
                friction,
                servo,
                variation,
                cycles: random(noise_seed, CYCLE_STREAMS + stream),
            }));
            Plan { trial, source, seed: random(noise_seed, stream) }
        };
        trials.into_iter().enumerate().map(plan).collect()
    }
}

/// Draws the true parameters and returns the plans of the gait trials, the true coefficients of each campaign, and the
/// friction of each day.
pub(super) fn gaits(
    config: &Config,
    recipe: &Recipe,
) -> (Vec<Plan>, BTreeMap<String, CampaignTruth>, BTreeMap<usize, f64>) {
    let seed = recipe.seed;
    let days = floors(recipe);
    let mut plans = Vec::new();
    let mut campaigns = BTreeMap::new();
    // There is one random-number stream for the campaign and one for each of its trials.
    let first = |number: usize| (number * (recipe.omegas_rad_s.len() + 1)) as u64;
    for (number, (name, campaign)) in config.campaign.iter().enumerate() {
        let Some((configured, gait)) = config.setup(name) else { continue };
        let law = named_laws(config, recipe, &campaign.robot);
        let laws = law.map_or(Laws::SKID_ROLL, |(_, laws)| laws);
        let first = first(number);
        let mut of_campaign = random(seed, first);
        let index = config.robot.keys().position(|known| *known == campaign.robot);
        let mut of_robot = random(seed, ROBOT_STREAMS + index.unwrap_or(0) as u64);
        let schedule =
            Schedule { recipe, days: &days, campaign: name, robot: &campaign.robot, first };
        match configured {
            AnyRobot::ThreeLinks(robot) => {
                let (with_viscous, gait) =
                    planted::planted(name, &robot, gait.into(), &mut of_campaign);
                // Viscous coefficients differ between campaigns, as those fitted in the paper do; other coefficients
                // belong to the robot.
                let mut robot = match laws.are_linear() {
                    true => with_viscous,
                    false => planted::vary_coefficients(robot, &mut of_robot),
                };
                for (parameter, wheel) in planted::skid_resistances() {
                    let value = parameter.value_in(&robot) * recipe.skid_factors[wheel];
                    parameter.set(&mut robot, value);
                }
                let truth = CampaignTruth::new(unusual(law), laws, &robot, &gait);
                campaigns.insert(name.clone(), truth);
                plans.extend(schedule.plans(|omega_rad_s, friction| {
                    let robot = robot.with_friction_scaled(friction);
                    Problem::new(robot, gait, laws, omega_rad_s)
                }));
            }
            AnyRobot::Chain(configured) => {
                let mut robot = match laws.are_linear() {
                    true => chain::planted(configured, &mut of_campaign),
                    false => chain::planted_dry(configured, &mut of_robot, &mut of_campaign),
                };
                chain::change_friction(&mut robot, |link, friction| {
                    let factor = recipe.skid_factors.get(link).copied().unwrap_or(1.0);
                    friction.skid_kg_s *= factor;
                    friction.skid_dry_n *= factor;
                    friction.skid_static_n *= factor;
                });
                let truth = CampaignTruth::of_chain(unusual(law), laws, &robot);
                campaigns.insert(name.clone(), truth);
                plans.extend(schedule.plans(|omega_rad_s, factor| {
                    let mut chain = robot.clone();
                    chain::change_friction(&mut chain, |_, of| *of = of.scaled(factor));
                    let gait = chain.gait();
                    Problem::new(chain, gait, laws, omega_rad_s)
                }));
            }
        }
    }
    (plans, campaigns, days)
}

/// Returns the law of a campaign unless it is that of the model `skid-roll`.
fn unusual(law: Option<(Model, Laws)>) -> Option<Law> {
    let law = law.filter(|(model, laws)| (*model, *laws) != (Model::SKID_ROLL, Laws::SKID_ROLL));
    law.map(|(model, Laws { skid, roll })| Law { model, skid, roll })
}

/// Robot of the trials without a gait.
struct DecayRobot<'c> {
    name: &'c str,
    robot: AnyRobot,
    /// Indices of the joints that are released, with the names that the ids of these trials have for the releases.
    released: Vec<(usize, String)>,
    can_coast: bool,
}

/// Returns the robots named by a campaign, with the resistances of the laws that the recipe assigns to them; without a
/// law, a robot has all its configured resistances.
fn decaying_robots<'c>(config: &'c Config, recipe: &Recipe) -> Vec<DecayRobot<'c>> {
    // The passive joint of each robot is that of the first of its campaigns to have one.
    let mut robots: BTreeMap<&str, Option<usize>> = BTreeMap::new();
    for (name, campaign) in &config.campaign {
        let passive = config.campaign_setup(name).and_then(|(_, gait)| gait.passive_joint());
        let known = robots.entry(&campaign.robot).or_default();
        *known = known.or(passive);
    }
    let laws = |name: &str| named_laws(config, recipe, name).map(|(_, laws)| laws);
    let robots = robots.into_iter().filter_map(|(name, passive)| {
        let configured = config.robot.get(name)?;
        let (robot, released) = match configured.to_robot(&GaitConfig::default()) {
            AnyRobot::ThreeLinks(robot) => {
                let robot = laws(name).map_or(robot.clone(), |laws| laws.effective(&robot));
                let release = TrialKind::JointRelease.to_string();
                let released = passive.map(|joint| (joint, release));
                (robot.into(), released.into_iter().collect())
            }
            AnyRobot::Chain(mut chain) => {
                if let Some(laws) = laws(name) {
                    chain::change_friction(&mut chain, |_, of| *of = of.effective(laws));
                }
                let free = chain.joints.iter().enumerate();
                let free = free.filter(|(_, joint)| matches!(joint, Joint::Free(_)));
                let released =
                    free.map(|(joint, _)| (joint, format!("joint{}-release", joint + 1)));
                let released = released.collect();
                (chain.into(), released)
            }
        };
        let can_coast = configured.check_kind(TrialKind::CoastDown).is_ok();
        Some(DecayRobot { name, robot, released, can_coast })
    });
    robots.collect()
}

/// Returns the plans of the trials without a gait: for every robot named by a campaign, a release of each passive joint
/// and, unless the robot cannot coast, a coast-down (on a sloping floor one in each direction of
/// [`Slope::HEADINGS_RAD`]).
pub(super) fn decays(config: &Config, recipe: &Recipe) -> Vec<Plan> {
    let rate_hz = config.vicon.rate_hz;
    let mut plans = Vec::new();
    for (i, DecayRobot { name, robot, released, can_coast }) in
        (0..).zip(decaying_robots(config, recipe))
    {
        let stream = DECAY_STREAMS + 2 * i;
        for (repeat, (joint, label)) in (0..).zip(released) {
            let mut seed = random(recipe.seed, stream + REPEAT_STREAMS * repeat);
            let decay = decay::released(name, &robot, joint, rate_hz, &mut seed);
            let id = format!("{name}-{label}-r1");
            plans.extend(decay_plan(recipe, id, TrialKind::JointRelease, decay, seed));
        }
        let floors: Vec<Option<(Slope, f64)>> = match recipe.slope {
            Some(slope) => Slope::HEADINGS_RAD.map(|heading_rad| Some((slope, heading_rad))).into(),
            None => vec![None],
        };
        for (repeat, floor) in (0..).zip(floors).filter(|_| can_coast) {
            let mut seed = random(recipe.seed, stream + 1 + REPEAT_STREAMS * repeat);
            let decay = decay::coasting(name, &robot, rate_hz, floor, &mut seed);
            let kind = TrialKind::CoastDown;
            let id = format!("{name}-{}-r{}", kind.name(), repeat + 1);
            plans.extend(decay_plan(recipe, id, kind, decay, seed));
        }
    }
    plans
}

/// Returns the plan of a trial without a gait; `None` without a motion. `seed` has drawn the motion.
fn decay_plan(
    recipe: &Recipe,
    id: String,
    kind: TrialKind,
    decay: Option<Decay>,
    mut seed: ChaCha8Rng,
) -> Option<Plan> {
    let decay = decay?;
    let robot = Some(decay.truth.robot.clone());
    if let Some(noise_seed) = recipe.noise_seed {
        let position = seed.get_word_pos();
        seed = random(noise_seed, seed.get_stream());
        seed.set_word_pos(position);
    }
    Some(Plan {
        trial: Trial { robot, ..blank_trial(id, recipe.format, kind) },
        source: Source::Decay(Box::new(decay)),
        seed,
    })
}
