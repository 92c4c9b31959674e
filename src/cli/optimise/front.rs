//! What `optimise --pareto` prints and writes.

use trilink_fit::optimise::{Optimum, Search};
use trilink_fit::simulate::Setup;
use trilink_report::{FigureFile, front_drawing, with_unit};
use trilink_tables::{NoIntervalReason, Objective, OptimumRow};

use super::{Optimise, print_table};
use crate::cli::results::write_rows;
use crate::cli::setup::note_extrapolation;
use crate::cli::{Context, Failure, Outcome};
use crate::interrupt;

impl Optimise {
    /// The objective, and the other one of a front.
    pub(super) fn objectives(&self) -> Result<(Objective, Option<Objective>), Failure> {
        let both = match (self.maximise.or(self.minimise), &self.pareto[..]) {
            (Some(objective), []) => return Ok((objective, None)),
            (Some(objective), [other]) => (objective, *other),
            (None, [objective, other]) => (*objective, *other),
            (Some(_), found) => {
                return Err(format!("--pareto: found {}, needed one other", found.len()).into());
            }
            (None, found) => {
                let found = found.len();
                return Err(format!("--pareto: found {found}, needed two: v,work-per-metre").into());
            }
        };
        if both.0.is_like(both.1) {
            let (one, other) = (both.0.name(), both.1.name());
            return Err(format!("--pareto: {one} and {other} have the same optima").into());
        }
        Ok((both.0, Some(both.1)))
    }

    pub(super) fn print_front(
        &self,
        context: &Context,
        setup: &Setup,
        search: &Search,
        other: Objective,
    ) -> Result<Outcome, Failure> {
        let front = search.front(other, interrupt::token())?;
        let objective = search.objective;
        if front.is_empty() {
            let (one, other) = (objective.name(), other.name());
            return Err(format!("no front: {one} or {other} has no optimum that counts").into());
        }
        let row = |(nth, of): (usize, &Optimum)| OptimumRow {
            other_objective: Some(other),
            other_value: of.value_of(other),
            no_interval: Some(NoIntervalReason::Front.into()),
            ..of.row(nth + 1, &self.campaign, setup, search, None)
        };
        let rows: Vec<OptimumRow> = front.iter().enumerate().map(row).collect();
        let problems = front.iter().map(|of| of.problem.clone());
        note_extrapolation(&self.campaign, setup, problems);
        if let Some(path) = &self.files.table {
            write_rows(path, &rows, &format!("{search:?} {other:?}"))?;
        }
        let names = [&*self.campaign, setup.model.name()];
        let point = |row: &OptimumRow| {
            let is_extrapolated = row.extrapolation.extrapolated == Some(true);
            (row.other_value, row.value, is_extrapolated)
        };
        let points: Vec<(f64, f64, bool)> = rows.iter().map(point).collect();
        let labels = [other, objective].map(with_unit);
        let labels = labels.each_ref().map(String::as_str);
        let drawn = |file: FigureFile| front_drawing(names, labels, &points, file);
        self.files.draw(context, self.numbers.fitted, drawn)?;
        if !self.format.rows(&rows) {
            print_table(setup, objective, &front, None);
        }
        Ok(Outcome::Well)
    }
}
