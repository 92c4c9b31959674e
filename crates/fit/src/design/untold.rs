//! Coefficients that the trials do not tell, why, and which trial would.

use trilink_robot::Parameter;
use trilink_tables::FitRow;

use super::Candidate;
use super::criterion::Criterion;
use crate::FitInformation;

/// Part of what the bounds leave open of a logarithm from which on the trials do not tell it.
const UNTOLD: f64 = 0.5;
/// Change of another coefficient's logarithm with that of one from which on they are exchanged.
const EXCHANGED: f64 = 0.05;

/// A coefficient that the trials so far hardly tell.
#[derive(Debug, Clone, PartialEq)]
pub struct Untold {
    pub parameter: Parameter,
    /// Standard deviation of its logarithm: by the trials so far and its bounds, and with one trial more.
    pub deviation: f64,
    pub deviation_with: f64,
    /// Other coefficients, and how many percent of change make up for one percent of this.
    pub exchanged: Vec<(Parameter, f64)>,
    /// The trial that would tell most of it; `None` where none tells it.
    pub trial: Option<Candidate>,
}

/// Those of a fit; `row` is its.
pub(super) fn untold(
    information: &FitInformation,
    row: &FitRow,
    criterion: &Criterion,
    candidates: &[&Candidate],
) -> Vec<Untold> {
    let (bounds, now) = (criterion.of_bounds(), criterion.covariance(&[]));
    let free: Vec<Parameter> = information.free().map(|(free, _)| free.parameter).collect();
    let deviation = |of: &nalgebra::DMatrix<f64>, i: usize| of[(i, i)].sqrt();
    let is_untold = |i: &usize| {
        row.practically_not.contains(&free[*i])
            || row.structurally_not.contains(&free[*i])
            || deviation(&now, *i) > UNTOLD * bounds[*i]
    };
    let of = |i: usize| {
        let with =
            |candidate: usize| (candidate, deviation(&criterion.covariance(&[candidate]), i));
        let each = (0..candidates.len()).map(with);
        let best = each.min_by(|(_, a), (_, b)| a.total_cmp(b));
        let (number, deviation_with) = best.unwrap_or((0, f64::NAN));
        let tells = deviation_with < UNTOLD * bounds[i];
        let others = (0..free.len()).filter(|other| *other != i);
        let change = |other: usize| (free[other], now[(other, i)] / now[(i, i)]);
        Untold {
            parameter: free[i],
            deviation: deviation(&now, i),
            deviation_with,
            exchanged: others.map(change).filter(|(_, of)| of.abs() > EXCHANGED).collect(),
            trial: candidates.get(number).filter(|_| tells).map(|of| (*of).clone()),
        }
    };
    (0..free.len()).filter(is_untold).map(of).collect()
}
