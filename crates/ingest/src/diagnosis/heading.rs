//! Finds out whether the displacement of gaits depends on the direction in which the robot travels, as it does on a
//! sloping floor: gravity drives the robot downhill and slows it down uphill, so that d varies as the cosine of the
//! angle between the direction of travel and the direction in which the floor falls.
//!
//! For the trials of a campaign on one day, `d / mean(d) - 1 = a (cos(psi) - mean(cos(psi))) + b (sin(psi) -
//! mean(sin(psi)))`, with the means over the trials of the same commanded frequency and the direction of travel psi. If
//! the directions hardly vary along one axis, only the component along the other is estimated. An F test compares a and
//! b with the scatter that remains. Nothing is reported if the directions differ too little, or if too few trials
//! remain to estimate the scatter.

use std::collections::BTreeMap;

use nalgebra::{Matrix2, Vector2};
use trilink_statistics::{fisher, mean, normal_tail};
use trilink_tables::TrialRow;

use super::campaigns::insert;
use super::folder::restate;
use crate::Ingested;
use crate::checks::{Check, Finding};

/// Maximum rotation of the robot during the used cycles, rad: a robot that turns further has no direction of travel.
const MAX_TURN_RAD: f64 = 0.5;
/// Minimum variance of a component of the direction of travel within a frequency: directions within 25 degrees of each
/// other have less.
const MIN_VARIANCE: f64 = 0.05;
/// Significance level of the F test, as the two-sided normal deviate with the same probability.
const DEVIATIONS: f64 = 3.0;

/// Adds a finding to the trials of each campaign whose displacement depends on the direction of travel.
pub(super) fn flag_slopes(rows: &mut Ingested) {
    let mut groups: BTreeMap<(&str, &str, &str), Vec<&TrialRow>> = BTreeMap::new();
    for row in rows.trials.iter().filter(|row| has_direction(row)) {
        groups.entry((&row.campaign, &row.folder, &row.day)).or_default().push(row);
    }
    let mut found: BTreeMap<String, Finding> = BTreeMap::new();
    for trials in groups.into_values() {
        let repeated = with_others(&trials);
        let Some(variation) = Variation::new(&repeated) else { continue };
        if variation.f > variation.f_limit {
            let names = repeated.iter().flatten().map(|row| row.trial.clone());
            let count = names.clone().count();
            found.extend(names.map(|name| (name, variation.finding(count))));
        }
    }
    let Ingested { trials, checks, .. } = rows;
    for row in trials {
        if let Some(finding) = found.get(&row.trial) {
            insert(&row.trial, checks, finding);
            restate(row, checks);
        }
    }
}

/// Returns whether a trial has a displacement in a constant direction.
fn has_direction(row: &TrialRow) -> bool {
    let turn_rad = row.metrics.dtheta_rad.abs() * row.cycles as f64;
    row.status.has_metrics()
        && row.metrics.d_m > 0.0
        && row.heading_rad.is_finite()
        && turn_rad <= MAX_TURN_RAD
}

/// Returns the trials by commanded frequency, without those that are alone at their frequency.
fn with_others<'r>(trials: &[&'r TrialRow]) -> Vec<Vec<&'r TrialRow>> {
    let mut trials = trials.to_vec();
    trials.sort_by(|a, b| a.omega_commanded_rad_s.total_cmp(&b.omega_commanded_rad_s));
    let by_frequency = trials.chunk_by(|a, b| a.omega_commanded_rad_s == b.omega_commanded_rad_s);
    by_frequency.filter(|same| same.len() > 1).map(<[&TrialRow]>::to_vec).collect()
}

/// Variation of the displacement with the direction of travel.
struct Variation {
    /// Relative increase of d in the direction in which d is largest, and this direction from the x axis, rad.
    relative: f64,
    largest_rad: f64,
    f: f64,
    f_limit: f64,
}

impl Variation {
    /// Estimates the variation from the trials of each frequency; `None` if they do not determine it.
    fn new(frequencies: &[Vec<&TrialRow>]) -> Option<Self> {
        let mut normal = Matrix2::zeros();
        let mut right = Vector2::zeros();
        let mut squares = 0.0;
        let mut noise = Vec::new();
        for trials in frequencies {
            let mean_d_m = mean(trials.iter().map(|row| row.metrics.d_m));
            let directions: Vec<Vector2<f64>> = trials
                .iter()
                .map(|row| Vector2::new(row.heading_rad.cos(), row.heading_rad.sin()))
                .collect();
            let middle = directions.iter().sum::<Vector2<f64>>() / directions.len() as f64;
            for (row, direction) in trials.iter().zip(&directions) {
                let excess = row.metrics.d_m / mean_d_m - 1.0;
                let direction = direction - middle;
                normal += direction * direction.transpose();
                right += direction * excess;
                squares += excess * excess;
                noise.push((row.metrics_se.d_m / mean_d_m).powi(2));
            }
        }
        let count = noise.len() as f64;
        let axes = normal.symmetric_eigen();
        let mut slope = Vector2::zeros();
        let mut explained = 0.0;
        let mut terms = 0.0;
        for (axis, information) in axes.eigenvectors.column_iter().zip(&axes.eigenvalues) {
            if *information > MIN_VARIANCE * count {
                let along = axis.dot(&right);
                slope += axis * (along / information);
                explained += along * along / information;
                terms += 1.0;
            }
        }
        let freedom = count - frequencies.len() as f64 - terms;
        if terms == 0.0 || freedom < 1.0 {
            return None;
        }
        let scatter = ((squares - explained) / freedom).max(mean(noise));
        Some(Self {
            relative: slope.norm(),
            largest_rad: slope.y.atan2(slope.x),
            f: explained / terms / scatter,
            f_limit: fisher(2.0 * normal_tail(DEVIATIONS), [terms, freedom]),
        })
    }

    fn finding(&self, trials: usize) -> Finding {
        let Self { relative, largest_rad, f, f_limit } = *self;
        let message = format!(
            "d varies with the direction of travel by +-{:.1} % and is largest towards {:.0} degrees from the x axis \
             (F = {f:.1}, limit {f_limit:.1}, {trials} trials): the floor seems to fall towards it; level it, \
             or drive every frequency in opposite directions",
            100.0 * relative,
            largest_rad.to_degrees()
        );
        let limit = relative * (f_limit / f).sqrt();
        Finding::new(Check::FloorSlope, false, relative, limit, message)
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};
    use trilink_tables::Columns as _;
    use trilink_tables::trial::TrialKind;

    use trilink_tables::TrialStatus;

    use super::*;

    /// Returns trials at three frequencies in directions around the mean direction, whose displacement scatters by 1 %
    /// and is larger by the fraction `downhill` towards 200 degrees.
    fn trials(downhill: f64, directions_deg: &[f64], seed: u64) -> Ingested {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut rows = Ingested::default();
        for (omega, d_m) in [(1.0, 0.42), (2.5, 0.45), (4.0, 0.47)] {
            for (number, direction_deg) in directions_deg.iter().enumerate() {
                let normal: f64 = StandardNormal.sample(&mut random);
                let slope = downhill * (direction_deg - 200.0).to_radians().cos();
                let mut row = TrialRow {
                    trial: format!("{omega}-{number}"),
                    campaign: "ours".to_owned(),
                    folder: "raw/day1".to_owned(),
                    kind: TrialKind::Gait,
                    omega_commanded_rad_s: omega,
                    cycles: 8,
                    heading_rad: direction_deg.to_radians(),
                    status: TrialStatus::Ok,
                    ..TrialRow::blank()
                };
                row.metrics.d_m = d_m * (1.0 + slope + 0.01 * normal);
                row.metrics.dtheta_rad = 0.0;
                row.metrics_se.d_m = 1e-4;
                rows.trials.push(row);
            }
        }
        rows
    }

    fn flagged(mut rows: Ingested) -> Vec<String> {
        flag_slopes(&mut rows);
        let flagged = rows.trials.iter().filter(|row| row.status == TrialStatus::Flagged).count();
        assert_eq!(flagged, rows.checks.len());
        rows.checks.into_iter().map(|check| check.message).collect()
    }

    const AROUND: [f64; 4] = [10.0, 95.0, 190.0, -80.0];

    #[test]
    fn a_slope_of_a_tenth_of_a_degree_is_found_and_a_level_floor_is_not_accused() {
        let [mut found, mut accused] = [0, 0];
        for seed in 0..200 {
            found += usize::from(flagged(trials(0.07, &AROUND, seed)).len() == 12);
            accused += usize::from(!flagged(trials(0.0, &AROUND, seed)).is_empty());
        }
        println!("found in {found} of 200, accused in {accused} of 200");
        assert!(found >= 195 && accused <= 3, "{found} {accused}");
    }

    #[test]
    fn the_message_names_the_direction_in_which_the_floor_falls() {
        let messages = flagged(trials(0.2, &AROUND, 1));
        let (_, rest) = messages[0].split_once("is largest towards ").expect("a direction");
        let (direction, _) = rest.split_once(' ').expect("degrees");
        let direction: f64 = direction.parse().expect("a number");
        assert!((direction + 160.0).abs() < 5.0, "{direction}");
        let both_ways = [200.0, 20.0, 200.0, 20.0];
        assert_eq!(flagged(trials(0.2, &both_ways, 2)).len(), 12);
    }

    #[test]
    fn nothing_is_known_from_similar_directions_few_trials_or_a_robot_that_turns() {
        assert!(flagged(trials(0.5, &[0.0, 8.0, -8.0, 4.0], 1)).is_empty());
        assert!(flagged(trials(0.5, &[200.0], 1)).is_empty());
        let mut turning = trials(0.2, &AROUND, 1);
        turning.trials.iter_mut().for_each(|row| row.metrics.dtheta_rad = 0.1);
        assert!(flagged(turning).is_empty());
    }
}
