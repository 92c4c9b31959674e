//! Coefficients that the existing trials do not determine, the reason why, and the trial that would determine them.

use trilink_robot::Parameter;
use trilink_tables::FitRow;

use super::Candidate;
use super::criterion::Criterion;
use crate::FitInformation;

/// Minimum ratio of the standard deviation of a coefficient's logarithm to the one implied by its bounds alone, for the
/// coefficient to count as undetermined by the trials.
const MIN_UNDETERMINED: f64 = 0.5;
/// Minimum change in the logarithm of another coefficient, per unit change in that of the undetermined one, for which
/// the two count as exchangeable.
const MIN_EXCHANGED: f64 = 0.05;

/// Coefficient that the existing trials barely determine.
#[derive(Debug, Clone, PartialEq)]
pub struct Undetermined {
    pub parameter: Parameter,
    /// Standard deviation of the coefficient's logarithm, given the existing trials and the bounds.
    pub deviation: f64,
    /// Standard deviation of the coefficient's logarithm after adding the best single trial.
    pub deviation_with: f64,
    /// Other coefficients that compensate for a change in this one, with their change in percent per percent of this
    /// one.
    pub exchanged: Vec<(Parameter, f64)>,
    /// Trial that reduces the standard deviation most; `None` if no candidate determines the coefficient.
    pub trial: Option<Candidate>,
}

/// Returns the undetermined coefficients of a fit; `row` is the row of the fit in the fit table.
pub(super) fn find_undetermined(
    information: &FitInformation,
    row: &FitRow,
    criterion: &Criterion,
    candidates: &[&Candidate],
) -> Vec<Undetermined> {
    let bounds = criterion.deviations_from_bounds();
    let now = criterion.covariance(&[]);
    let free: Vec<Parameter> = information.free().map(|(free, _)| free.parameter).collect();
    let mut undetermined = Vec::new();
    for (i, &parameter) in free.iter().enumerate() {
        let deviation = now[(i, i)].sqrt();
        let limit = MIN_UNDETERMINED * bounds[i];
        let is_determined = !row.practically_not.contains(&parameter)
            && !row.structurally_not.contains(&parameter)
            && (deviation <= limit || deviation.is_nan());
        if is_determined {
            continue;
        }
        let (best, deviation_with) = (0..candidates.len())
            .map(|candidate| (candidate, criterion.covariance(&[candidate])[(i, i)].sqrt()))
            .min_by(|(_, a), (_, b)| a.total_cmp(b))
            .unwrap_or((0, f64::NAN));
        let exchanged = (0..free.len())
            .filter(|other| *other != i)
            .map(|other| (free[other], now[(other, i)] / now[(i, i)]))
            .filter(|(_, change)| change.abs() > MIN_EXCHANGED);
        let trial = candidates.get(best).filter(|_| deviation_with < limit);
        undetermined.push(Undetermined {
            parameter,
            deviation,
            deviation_with,
            exchanged: exchanged.collect(),
            trial: trial.map(|candidate| (*candidate).clone()),
        });
    }
    undetermined
}
