//! `trilink simulate`.

mod page;
mod sensitivities;
mod table;
mod trajectory;

use std::path::PathBuf;

use rayon::prelude::*;
use trilink_fit::simulate::{Answer, Setup, SimulationRow};
use trilink_robot::Model;
use trilink_tables::config::Config;

use super::output::{note, say, write_json};
use super::parse::{NumberList, parse_omegas};
use super::results::{Format, check_ending};
use super::setup::{Numbers, note_caution, note_extrapolation, note_starting_values};
use super::{Context, Failure, Interrupted, Outcome, candidates};
use sensitivities::Sensitivities;

/// Solve for a model's steady-state motion.
#[derive(clap::Args)]
#[command(after_help = include_str!("examples/simulate.txt").trim_end())]
pub(super) struct Simulate {
    /// Name of a `[campaign.*]` table.
    #[arg(add = candidates::campaigns())]
    campaign: String,
    /// Name of a `[model.*]` table: no-skid, no-skid-damped, no-skid-roll, skid, skid-roll, coulomb, coulomb-viscous or
    /// your own. May be a list, and the option may be given more than once. With `--fitted`, the default is the
    /// preferred model of the comparison.
    #[arg(long, required_unless_present = "fitted", add = candidates::models())]
    model: Vec<String>,
    /// Frequencies, rad/s: `3.9,4`, or `0.5..6/12` for twelve from 0.5 to 6. The option may be given
    /// more than once.
    #[arg(long, required = true, allow_hyphen_values = true, value_parser = parse_omegas)]
    omega: Vec<NumberList>,
    #[command(flatten)]
    numbers: Numbers,
    /// Add 95 % confidence intervals of the metrics, computed from the uncertainty of the fitted coefficients.
    #[arg(long, requires = "fitted")]
    bands: bool,
    /// Solve for the steady-state motion that the robot reaches from rest.
    #[arg(long)]
    from_rest: bool,
    /// Write one steady-state cycle, and with `--from-rest` also the transient before it, to a file; its extension
    /// selects Parquet, CSV or JSON.
    #[arg(long, value_name = "FILE")]
    trajectory: Option<PathBuf>,
    /// Samples per cycle in the file of `--trajectory`.
    #[arg(long, default_value_t = 240, value_parser = clap::value_parser!(u32).range(8..=100_000))]
    samples: u32,
    /// Write a page that animates the motion from rest of one model at one frequency, with the forces
    /// at the wheels.
    #[arg(long, value_name = "FILE")]
    page: Option<PathBuf>,
    #[command(flatten)]
    sensitivities: Sensitivities,
    #[command(flatten)]
    format: Format,
}

impl Simulate {
    pub(super) fn run(self, context: Context) -> Result<Outcome, Failure> {
        let campaign = &self.campaign;
        let config = &context.config;
        let mut models: Vec<Option<String>> =
            models(&self.model, config).into_iter().map(Some).collect();
        if models.is_empty() {
            models.push(None);
        }
        let with_bands = self.bands || self.sensitivities.sensitivities;
        let fits = self.numbers.fits(&context, with_bands)?;
        let setups: Vec<Setup> = models
            .iter()
            .map(|model| {
                self.numbers.setup(config.clone(), campaign, model.as_deref(), fits.as_ref())
            })
            .collect::<Result<_, _>>()?;
        let omegas: Vec<f64> = self.omega.concat();
        if self.page.is_some() {
            page::check(models.len(), omegas.len())?;
        }
        if let Some(path) = &self.trajectory {
            check_ending(path, "--trajectory")?;
        }
        let solved: Vec<(&Setup, f64)> = setups
            .iter()
            .flat_map(|setup| omegas.iter().map(move |omega_rad_s| (setup, *omega_rad_s)))
            .collect();
        for setup in &setups {
            note_caution(campaign, setup.model, setup.fit());
            let problems = omegas.iter().map(|omega_rad_s| setup.problem(*omega_rad_s));
            note_extrapolation(campaign, setup.model, setup.measured_range(), problems);
        }
        if fits.is_none() {
            let robots = setups.iter().map(|setup| (setup.model, setup.robot.clone()));
            note_starting_values(config, campaign, &robots.collect::<Vec<_>>());
        }
        if self.sensitivities.sensitivities {
            return self.print_sensitivities(&context, &setups, &omegas, fits.as_ref());
        }
        let stage = context.progress.stage("simulate", solved.len());
        let mut answers: Vec<Answer> = solved
            .into_par_iter()
            .with_max_len(1)
            .map(|(setup, omega_rad_s)| {
                stage.check("frequencies")?;
                let answer = setup.answer(omega_rad_s, self.from_rest);
                stage.tick();
                Ok(answer)
            })
            .collect::<Result<_, Interrupted>>()?;
        drop(stage);
        if let Some(fits) = fits.as_ref().filter(|_| self.bands) {
            for of_setup in answers.chunk_by_mut(|a, b| a.model == b.model) {
                let setup = of_setup[0].setup;
                setup.add_bands(of_setup, self.from_rest, fits);
            }
        }
        if let (Some(path), Some(setup)) = (&self.trajectory, setups.first()) {
            let samples = self.samples as usize;
            context.say(&trajectory::write(path, setup, &answers, self.from_rest, samples)?);
        }
        if let (Some(path), [answer]) = (&self.page, &answers[..]) {
            let names = (campaign.as_str(), answer.model.name());
            let problem = answer.setup.problem(answer.omega_rad_s);
            context.say(&page::write(path, names, &problem, answer.cycles_to_settle, answer)?);
        }
        let rows: Vec<SimulationRow> = answers.iter().map(Answer::row).collect();
        let legend = setups.first().and_then(legend);
        if self.format.json {
            write_json(&answers)?;
        } else if self.format.rows(&rows) {
            legend.inspect(|legend| note!("{legend}"));
        } else {
            table::print(&answers);
            legend.inspect(|legend| say!("{legend}"));
        }
        Ok(Outcome::well_if(answers.iter().all(|answer| answer.metrics.d_m.is_finite())))
    }
}

/// Returns which link of a chain has which number in the names of the columns; `None` for three links in the short form.
fn legend(setup: &Setup) -> Option<String> {
    let chain = setup.robot.as_chain()?;
    let links = chain.numbering().into_iter().enumerate().map(|(number, link)| {
        let link = &chain.links[link];
        let wheel = if link.wheel.is_some() { "" } else { " (no wheel)" };
        format!("{number} = {}{wheel}", link.name)
    });
    Some(format!("links: {}", links.collect::<Vec<_>>().join(", ")))
}

/// Returns the models named on the command line, each once. An argument is either a model's name, which may contain
/// commas, or a list of names.
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
