//! `trilink synth`.

use std::path::PathBuf;

use super::{Context, Failure, Outcome};
use crate::synth::{OMEGAS_RAD_S, synthesise};

#[derive(clap::Args)]
pub(super) struct Synth {
    /// Trial folder to write.
    folder: PathBuf,
    /// Seed of everything random; the same seed gives the same bytes.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

impl Synth {
    pub fn run(self, context: Context) -> Result<Outcome, Failure> {
        let total = context.config.campaign.len() * OMEGAS_RAD_S.len();
        let stage = context.progress.stage("synth", total);
        let on_trial = |trial: &str| stage.step(trial);
        let trials = synthesise(&context.config, &self.folder, self.seed, &on_trial)?;
        drop(stage);
        println!("{} synthetic trials in {}", trials.len(), self.folder.display());
        Ok(Outcome::Well)
    }
}
