//! `trilink simulate`.

mod table;
mod trajectory;

use std::path::PathBuf;

use rayon::prelude::*;

use super::omegas::{Omegas, parse_omegas};
use super::output::write_data;
use super::{Context, Failure, Outcome};
use crate::report::{SimulationError, simulation_page};
use crate::simulate::{Answer, Setup};
use crate::store::write_if_changed;

#[derive(clap::Args)]
pub(super) struct Simulate {
    /// Name of a `[campaign.*]`.
    campaign: String,
    /// Name of a `[model.*]`: no-skid, no-skid-damped, no-skid-roll, skid, skid-roll, coulomb, coulomb-viscous or your own.
    #[arg(long)]
    model: String,
    /// Frequencies, rad/s: `3.9,4`, or `0.5..6/12` for twelve from 0.5 to 6. May be given again.
    #[arg(long, required = true, allow_hyphen_values = true, value_parser = parse_omegas)]
    omega: Vec<Omegas>,
    /// Parameters of the robot: `skid_kg_s=104,34,45`, or of a wheel `skid_dry0=1.8`, one or several.
    #[arg(long, num_args = 1.., value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Answer with the motion in which the robot ends that starts from rest.
    #[arg(long)]
    from_rest: bool,
    /// Write one steady cycle, or with `--from-rest` the way there, as Parquet.
    #[arg(long, value_name = "FILE")]
    trajectory: Option<PathBuf>,
    /// Moments of a cycle that `--trajectory` writes.
    #[arg(long, default_value_t = 240, value_parser = clap::value_parser!(u32).range(8..=100_000))]
    samples: u32,
    /// Write a page that plays the motion from rest, with the forces at the wheels, at one frequency.
    #[arg(long, value_name = "FILE")]
    page: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl Simulate {
    pub fn run(self, context: Context) -> Result<Outcome, Failure> {
        let setup = Setup::new(context.config, &self.campaign, &self.model, &self.set)?;
        let omegas: Vec<f64> = self.omega.concat();
        if self.page.is_some() && omegas.len() != 1 {
            return Err(format!("--page: found {} frequencies, needed one", omegas.len()).into());
        }
        let stage = context.progress.stage("simulate", omegas.len());
        let answers: Vec<Answer> = omegas
            .par_iter()
            .with_max_len(1)
            .map(|&omega_rad_s| {
                let answer = setup.answer(omega_rad_s, self.from_rest);
                stage.tick();
                stage.stop_if_asked("frequencies");
                answer
            })
            .collect();
        drop(stage);
        if let Some(path) = &self.trajectory {
            let samples = self.samples as usize;
            let message = trajectory::write(path, &setup, &answers, self.from_rest, samples)?;
            context.progress.say(&message);
        }
        if let (Some(path), [answer]) = (&self.page, &answers[..]) {
            let problem = setup.problem(answer.omega_rad_s);
            let names = (self.campaign.as_str(), &*self.model);
            let page = simulation_page(names, &problem, answer.cycles_to_settle, answer);
            let message = match page {
                Ok(page) => {
                    write_if_changed(path, page.as_bytes()).map(|_| path.display().to_string())?
                }
                Err(SimulationError::Motion(error)) => {
                    format!("{}: not written: {error}", path.display())
                }
                Err(error) => return Err(error.into()),
            };
            context.progress.say(&message);
        }
        if self.json {
            write_data(&serde_json::to_string_pretty(&answers)?);
        } else {
            table::print(&answers);
        }
        let all_exist = answers.iter().all(|answer| answer.metrics.d_m.is_finite());
        Ok(if all_exist { Outcome::Well } else { Outcome::NeedsAttention })
    }
}
