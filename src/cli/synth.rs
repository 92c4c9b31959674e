//! `trilink synth`.

use std::path::PathBuf;

use super::omegas::{Omegas, parse_omegas};
use super::output::say;
use super::{Context, Failure, Outcome};
use crate::synth::{Format, OMEGAS_RAD_S, synthesise};

#[derive(clap::Args)]
pub(super) struct Synth {
    /// Trial folder to write.
    folder: PathBuf,
    /// Seed of everything random; the same seed gives the same bytes.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Frequencies of every campaign, rad/s, such as `1,3.9` or `0.5..6/12`; may be given again
    /// [default: 0.5 to 6 in steps of 0.5, and 3.9].
    #[arg(long, allow_hyphen_values = true, value_parser = parse_omegas)]
    omega: Vec<Omegas>,
    /// How the marker files are written.
    #[arg(long, value_enum, default_value_t = Format::Csv)]
    format: Format,
}

impl Synth {
    pub fn run(self, context: Context) -> Result<Outcome, Failure> {
        let mut omegas: Vec<f64> = self.omega.into_iter().flat_map(|omegas| omegas.0).collect();
        if omegas.is_empty() {
            omegas = OMEGAS_RAD_S.into();
        }
        let total = context.config.campaign.len() * omegas.len();
        let stage = context.progress.stage("synth", total);
        let on_trial = |trial: &str| stage.step(trial);
        let (config, folder) = (&context.config, &self.folder);
        let trials = synthesise(config, folder, self.seed, &omegas, self.format, &on_trial)?;
        drop(stage);
        say!("{} synthetic trials in {}", trials.len(), self.folder.display());
        Ok(Outcome::Well)
    }
}
