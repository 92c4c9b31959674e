//! Output of `optimise --pareto`.

use trilink_fit::optimise::Search;
use trilink_fit::simulate::Setup;
use trilink_report::{front_drawing, with_unit};
use trilink_tables::{NoIntervalReason, Objective, OptimumRow};

use super::{Optimise, print_table};
use crate::cli::results::write_rows;
use crate::cli::setup::note_extrapolation;
use crate::cli::{Context, Failure, Outcome};

impl Optimise {
    /// Returns the objective and, for a Pareto front, the second objective.
    pub(super) fn objectives(&self) -> Result<(Objective, Option<Objective>), Failure> {
        let both = match (self.maximise.or(self.minimise), &self.pareto[..]) {
            (Some(objective), []) => return Ok((objective, None)),
            (Some(objective), [other]) => (objective, *other),
            (None, [objective, other]) => (*objective, *other),
            (Some(_), found) => {
                return Err(
                    format!("--pareto: found {}, needed one other objective", found.len()).into()
                );
            }
            (None, found) => {
                let found = found.len();
                return Err(format!(
                    "--pareto: found {found}, needed two objectives, such as v,work-per-metre"
                )
                .into());
            }
        };
        if both.0.has_same_optima_as(both.1) {
            let one = both.0.name();
            let other = both.1.name();
            return Err(format!("--pareto: {one} and {other} have the same optima").into());
        }
        Ok((both.0, Some(both.1)))
    }

    /// Computes the Pareto front between two objectives, prints it, and writes its table and figure.
    pub(super) fn print_front(
        &self,
        context: &Context,
        setup: &Setup,
        search: &Search,
        other: Objective,
    ) -> Result<Outcome, Failure> {
        let front = search.front(other, context.cancel())?;
        let objective = search.objective;
        if front.is_empty() {
            let one = objective.name();
            let other = other.name();
            return Err(format!("no Pareto front: {one} or {other} has no usable optimum").into());
        }
        let rows = front.iter().zip(1..).map(|(optimum, number)| OptimumRow {
            other_objective: Some(other),
            other_value: optimum.value_of(other),
            no_interval: Some(NoIntervalReason::Front.into()),
            ..optimum.row(number, &self.campaign, setup, search, None)
        });
        let rows: Vec<OptimumRow> = rows.collect();
        let problems = front.iter().map(|optimum| optimum.problem.clone());
        note_extrapolation(&self.campaign, setup.model, setup.measured_range(), problems);
        if let Some(path) = &self.files.table {
            write_rows(path, &rows, &format!("{search:?} {other:?}"))?;
        }
        let model = setup.model;
        let names = [&*self.campaign, model.name()];
        let points = rows.iter().map(|row| {
            let is_extrapolated = row.extrapolation.extrapolated == Some(true);
            (row.other_value, row.value, is_extrapolated)
        });
        let points: Vec<(f64, f64, bool)> = points.collect();
        let labels = [other, objective].map(with_unit);
        let labels = labels.each_ref().map(String::as_str);
        // For comparison: the current gait at its best frequency.
        let present = match &self.files.figure {
            Some(_) => search.by_omega().present(context.cancel())?,
            None => None,
        };
        let present = present.map(|optimum| (optimum.value_of(other), optimum.value));
        self.files.draw(context, self.numbers.fitted, |file| {
            front_drawing(names, labels, &points, present, file)
        })?;
        if !self.format.rows(&rows) {
            print_table(setup, objective, &front, None);
        }
        Ok(Outcome::Well)
    }
}
