//! `trilink synth`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use trilink_robot::Model;
use trilink_synth::{Format, OMEGAS_RAD_S, Recipe, Servo, SynthError, synthesise};

use super::output::say;
use super::parse::{Omegas, parse_omegas, positive, within};
use super::{Context, Failure, Outcome};
use crate::interrupt;

/// How the marker files are written.
#[derive(Clone, Copy, clap::ValueEnum)]
enum FileFormat {
    /// Text, as Nexus exports `Trajectories`; six significant digits.
    Csv,
    /// Vicon's own binary format.
    C3d,
}

/// Write trials with a known truth, as the camera system would.
#[derive(clap::Args)]
#[command(after_help = include_str!("examples/synth.txt").trim_end())]
pub(super) struct Synth {
    /// Trial folder to write.
    folder: PathBuf,
    /// Seed of everything random; the same seed gives the same bytes.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Seed of what the cameras add and cycles differ by, for another night of the same laboratory
    /// [default: --seed].
    #[arg(long, value_name = "SEED")]
    noise_seed: Option<u64>,
    /// Model whose laws make the motion, of [model.*] in pipeline.toml, for all robots or for one; may
    /// be given again [default: skid-roll].
    #[arg(long, value_name = "[ROBOT=]MODEL")]
    law: Vec<String>,
    /// Multiply the planted skid coefficients of wheels 0, 1, 2, to see whether `compare` tells.
    #[arg(long, value_name = "F0,F1,F2", value_parser = parse_factors)]
    skid_factors: Option<[f64; 3]>,
    /// Frequencies of every campaign, rad/s, such as `1,3.9` or `0.5..6/12`; may be given again
    /// [default: 0.5 to 6 in steps of 0.5, and 3.9].
    #[arg(long, allow_hyphen_values = true, value_parser = parse_omegas)]
    omega: Vec<Omegas>,
    /// Trials of each frequency, 1 to 99.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=99))]
    repeats: u8,
    /// Only these frequencies have repeats, rad/s; may be given again.
    #[arg(long, value_name = "OMEGA", allow_hyphen_values = true, value_parser = parse_omegas)]
    repeat_omega: Vec<Omegas>,
    /// Days over which the trials are dealt in turn, 1 to 99: all friction of a day's floor is
    /// some 3 % more or less.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=99))]
    days: u8,
    /// Time constant of the servos, which lag behind their commands in the first order, s; 0.02 is
    /// that of a hobby servo.
    #[arg(long, value_name = "S", default_value_t = 0.0, value_parser = within(0.0, 1.0, " s"))]
    servo_lag: f64,
    /// By how much the servos give way to the joints' torque, rad/(N m), such as 0.05.
    #[arg(long, value_name = "RAD_PER_NM", default_value_t = 0.0, value_parser = within(0.0, 1.0, " rad/(N m)"))]
    servo_compliance: f64,
    /// Relative standard deviation of all friction from cycle to cycle, 0 to 1.
    #[arg(long, value_name = "PART", default_value_t = 0.0, value_parser = within(0.0, 1.0, ""))]
    friction_variation: f64,
    /// How the marker files are written.
    #[arg(long, value_enum, default_value_t = FileFormat::Csv)]
    format: FileFormat,
    /// Part of the frames in which one marker is swapped with another of its link or jumps by
    /// 20 mm, 0 to 1, for practice; `truth.json` lists them.
    #[arg(long, value_name = "PART", default_value_t = 0.0, value_parser = within(0.0, 1.0, ""))]
    misplaced: f64,
}

impl Synth {
    pub(super) fn run(self, context: Context) -> Result<Outcome, Failure> {
        let Self { folder, seed, omega, .. } = self;
        let robots = context.config.campaign.values().map(|campaign| &campaign.robot);
        let mut laws = BTreeMap::new();
        for law in &self.law {
            match law.split_once('=') {
                Some((robot, model)) => drop(laws.insert(robot.to_owned(), Model::new(model))),
                None => laws.extend(robots.clone().map(|of| (of.clone(), Model::new(law)))),
            }
        }
        let recipe = Recipe {
            noise_seed: self.noise_seed,
            laws,
            skid_factors: self.skid_factors.unwrap_or([1.0; 3]),
            omegas_rad_s: if omega.is_empty() { OMEGAS_RAD_S.into() } else { omega.concat() },
            repeats: self.repeats.into(),
            repeated_rad_s: self.repeat_omega.concat(),
            days: self.days.into(),
            servo: Servo { lag_s: self.servo_lag, compliance_rad_nm: self.servo_compliance },
            friction_variation: self.friction_variation,
            format: match self.format {
                FileFormat::Csv => Format::Csv,
                FileFormat::C3d => Format::C3d,
            },
            misplaced: self.misplaced,
            ..Recipe::new(seed)
        };
        let trials = write_trials(&context, &folder, &recipe)?;
        say!("{trials} synthetic trials in {}", folder.display());
        Ok(Outcome::Well)
    }
}

/// Writes the trials of a recipe and gives how many.
pub(super) fn write_trials(
    context: &Context,
    folder: &Path,
    recipe: &Recipe,
) -> Result<usize, Failure> {
    let stage = context.progress.stage("synth", recipe.trials(&context.config));
    let on_trial = |trial: &str| {
        stage.step(trial);
        interrupt::token().check()
    };
    match synthesise(&context.config, folder, recipe, &on_trial) {
        Err(SynthError::Cancelled(_)) => Err(stage.interrupted("trials").into()),
        made => Ok(made?.len()),
    }
}

fn parse_factors(text: &str) -> Result<[f64; 3], String> {
    let needed = || format!("found `{text}`, needed three numbers above 0, such as 1,1.05,1");
    let factors: Option<Vec<f64>> = text.split(',').map(positive).collect();
    factors.and_then(|factors| factors.try_into().ok()).ok_or_else(needed)
}
