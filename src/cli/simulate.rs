//! `trilink simulate`.

mod page;
mod sensitivities;
mod table;
mod trajectory;

use std::path::PathBuf;

use rayon::prelude::*;
use trilink_fit::simulate::{Answer, KnownFits, Setup, SimulationRow};
use trilink_robot::Model;
use trilink_tables::config::Config;

use super::fitted::{note_caution, note_extrapolation, note_starting_values};
use super::omegas::{Omegas, parse_omegas};
use super::output::write_data;
use super::rows_file::print_rows;
use super::{Context, Failure, Interrupted, Outcome};
use sensitivities::{Asked, Sensitivities};

#[derive(clap::Args)]
pub(super) struct Simulate {
    /// Name of a `[campaign.*]`.
    campaign: String,
    /// Name of a `[model.*]`: no-skid, no-skid-damped, no-skid-roll, skid, skid-roll, coulomb, coulomb-viscous or your own.
    /// May be a list, and be given again.
    #[arg(long, required = true)]
    model: Vec<String>,
    /// Frequencies, rad/s: `3.9,4`, or `0.5..6/12` for twelve from 0.5 to 6. May be given again.
    #[arg(long, required = true, allow_hyphen_values = true, value_parser = parse_omegas)]
    omega: Vec<Omegas>,
    /// Numbers of the robot, one or several: `skid_kg_s=104,34,45`, or of one wheel or link, as `--sensitivities` names them,
    /// `skid_dry0_n=1.8`, `mass0_kg=1.05`; and of the gait, of a commanded joint: `offset1_deg=10`, `amplitude2_deg=25`,
    /// `phase2_deg=-80`.
    #[arg(long, num_args = 1.., value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Take the coefficients that were fitted to the campaign's trials, by `trilink fit`, for those of the configuration; the gait is
    /// the commanded one.
    #[arg(long)]
    fitted: bool,
    /// Add the 95 % intervals of the metrics by what the fitted coefficients may be off by.
    #[arg(long, requires = "fitted")]
    bands: bool,
    /// Answer with the motion in which the robot ends that starts from rest.
    #[arg(long)]
    from_rest: bool,
    /// Write one steady cycle, or with `--from-rest` the way there: Parquet, CSV or JSON, by the file's ending.
    #[arg(long, value_name = "FILE")]
    trajectory: Option<PathBuf>,
    /// Moments of a cycle that `--trajectory` writes.
    #[arg(long, default_value_t = 240, value_parser = clap::value_parser!(u32).range(8..=100_000))]
    samples: u32,
    /// Write a page that plays the motion from rest, with the forces at the wheels, of one model at one frequency.
    #[arg(long, value_name = "FILE")]
    page: Option<PathBuf>,
    #[command(flatten)]
    sensitivities: Sensitivities,
    /// Print CSV with every digit.
    #[arg(long, conflicts_with = "json")]
    csv: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl Simulate {
    pub(super) fn run(self, context: Context) -> Result<Outcome, Failure> {
        let models = models(&self.model, &context.config);
        let with_bands = self.bands || self.sensitivities.sensitivities;
        let fits = self.fitted.then(|| KnownFits::read(&context.config, with_bands)).transpose()?;
        let setup = |model: &String| {
            let (config, campaign) = (context.config.clone(), &self.campaign);
            match &fits {
                Some(fits) => Setup::fitted(config, campaign, model, &self.set, fits),
                None => Setup::new(config, campaign, model, &self.set),
            }
        };
        let setups: Vec<Setup> = models.iter().map(setup).collect::<Result<_, _>>()?;
        let omegas: Vec<f64> = self.omega.concat();
        if self.page.is_some() {
            page::check(models.len(), omegas.len())?;
        }
        let trajectory = self.trajectory.as_deref().map(trajectory::File::new).transpose()?;
        let solved: Vec<(&Setup, f64)> = setups
            .iter()
            .flat_map(|setup| omegas.iter().map(move |omega_rad_s| (setup, *omega_rad_s)))
            .collect();
        for setup in &setups {
            note_caution(&self.campaign, setup);
            note_extrapolation(&self.campaign, setup, omegas.iter().map(|of| setup.problem(*of)));
        }
        if fits.is_none() {
            note_starting_values(&context.config, &self.campaign, &setups);
        }
        if self.sensitivities.sensitivities {
            let asked = Asked {
                campaign: &self.campaign,
                setups: &setups,
                omegas_rad_s: &omegas,
                from_rest: self.from_rest,
                fits: fits.as_ref(),
                csv: self.csv,
                json: self.json,
            };
            return self.sensitivities.run(&context, &asked);
        }
        let stage = context.progress.stage("simulate", solved.len());
        let mut solved: Vec<(&Setup, Answer)> = solved
            .into_par_iter()
            .with_max_len(1)
            .map(|(setup, omega_rad_s)| {
                stage.check("frequencies")?;
                let answer = setup.answer(omega_rad_s, self.from_rest);
                stage.tick();
                Ok((setup, answer))
            })
            .collect::<Result<_, Interrupted>>()?;
        drop(stage);
        if let Some(fits) = fits.as_ref().filter(|_| self.bands) {
            for of_setup in solved.chunk_by_mut(|(a, _), (b, _)| a.model == b.model) {
                let setup = of_setup[0].0;
                let mut answers: Vec<&mut Answer> =
                    of_setup.iter_mut().map(|(_, answer)| answer).collect();
                setup.add_bands(&mut answers, self.from_rest, fits);
            }
        }
        if let Some(file) = trajectory {
            let message = file.write(&solved, self.from_rest, self.samples as usize)?;
            context.progress.say(&message);
        }
        if let (Some(path), [(setup, answer)]) = (&self.page, &solved[..]) {
            context.progress.say(&page::write(path, &self.campaign, setup, answer)?);
        }
        let answers: Vec<&Answer> = solved.iter().map(|(_, answer)| answer).collect();
        match (self.csv, self.json) {
            (true, _) => {
                let rows: Vec<SimulationRow> = answers.iter().map(|of| of.row()).collect();
                print_rows(&rows, true, false);
            }
            (_, true) => write_data(&serde_json::to_string_pretty(&answers)?),
            _ => table::print(&answers),
        }
        let all_exist = answers.iter().all(|answer| answer.metrics.d_m.is_finite());
        Ok(if all_exist { Outcome::Well } else { Outcome::NeedsAttention })
    }
}

/// The models that are named, each once: a name may have commas, too.
fn models(named: &[String], config: &Config) -> Vec<String> {
    let mut models: Vec<String> = Vec::new();
    for text in named {
        let is_one = config.model.contains_key(&Model::new(text));
        let names = if is_one { vec![text.as_str()] } else { text.split(',').collect() };
        for name in names.into_iter().map(str::trim) {
            if models.iter().all(|known| known != name) {
                models.push(name.to_owned());
            }
        }
    }
    models
}
