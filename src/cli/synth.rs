//! `trilink synth`.

use std::path::{Path, PathBuf};

use super::omegas::{Omegas, parse_omegas};
use super::output::say;
use super::{Context, Failure, Outcome};
use crate::synth::{Format, OMEGAS_RAD_S, Recipe, synthesise};

#[derive(clap::Args)]
pub(super) struct Synth {
    /// Trial folder to write.
    folder: PathBuf,
    /// Seed of everything random; the same seed gives the same bytes.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Seed of what the cameras add, for another night of the same laboratory [default: --seed].
    #[arg(long, value_name = "SEED")]
    noise_seed: Option<u64>,
    /// Multiply the planted skid coefficients of wheels 0, 1, 2, to see whether `compare` tells.
    #[arg(long, value_name = "F0,F1,F2", value_parser = parse_factors)]
    skid_factors: Option<[f64; 3]>,
    /// Frequencies of every campaign, rad/s, such as `1,3.9` or `0.5..6/12`; may be given again
    /// [default: 0.5 to 6 in steps of 0.5, and 3.9].
    #[arg(long, allow_hyphen_values = true, value_parser = parse_omegas)]
    omega: Vec<Omegas>,
    /// How the marker files are written.
    #[arg(long, value_enum, default_value_t = Format::Csv)]
    format: Format,
    /// Part of the frames in which one marker is swapped with another of its link or jumps by
    /// 20 mm, 0 to 1, for practice; `truth.json` lists them.
    #[arg(long, value_name = "PART", default_value_t = 0.0, value_parser = parse_part)]
    misplaced: f64,
}

impl Synth {
    pub fn run(self, context: Context) -> Result<Outcome, Failure> {
        let Self { folder, seed, noise_seed, skid_factors, omega, format, misplaced } = self;
        let omegas_rad_s = if omega.is_empty() { OMEGAS_RAD_S.into() } else { omega.concat() };
        let recipe = Recipe {
            noise_seed,
            skid_factors: skid_factors.unwrap_or([1.0; 3]),
            omegas_rad_s,
            format,
            misplaced,
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
        stage.stop_if_asked("trials");
    };
    Ok(synthesise(&context.config, folder, recipe, &on_trial)?.len())
}

fn parse_factors(text: &str) -> Result<[f64; 3], String> {
    let needed = || format!("found `{text}`, needed three numbers above 0, such as 1,1.05,1");
    let factors = text.split(',').map(|factor| factor.trim().parse::<f64>().ok());
    let factors: Option<Vec<f64>> =
        factors.map(|factor| factor.filter(|factor| *factor > 0.0 && factor.is_finite())).collect();
    factors.and_then(|factors| factors.try_into().ok()).ok_or_else(needed)
}

fn parse_part(text: &str) -> Result<f64, String> {
    let needed = || format!("found `{text}`, needed a number from 0 to 1");
    text.parse().ok().filter(|part| (0.0..=1.0).contains(part)).ok_or_else(needed)
}
