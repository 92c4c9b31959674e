//! Separates dry rolling friction from gravity along a sloping floor, from the coast-downs of a folder.
//!
//! On a floor that rises by the small angles s = `(s_x, s_y)` along the axes of the laboratory, a straight robot that
//! travels in the direction e decelerates by `m v' = -c v - F - m g s.e`. A coast-down thus measures c and the constant
//! force `F + m g s.e`, with their covariance. From these pairs, which are sufficient for the recording to
//! first order, c and F of every robot and the slope are estimated by generalised least squares. F and
//! the slope are separated only if a robot coasts in opposite directions. The variance of c between coast-downs, which
//! does not depend on the slope, is estimated by moments (Hedges 1983) and added to that of the noise. A scatter beyond
//! both widens the standard errors by the Birge ratio (Birge 1932).

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector, Matrix2, Vector2};
use trilink_base::numbers::with_error;
use trilink_robot::GRAVITY_M_S2;
use trilink_robot::decay::DecayLaw;
use trilink_statistics::{Estimate, c4, fisher, mean, normal_tail};
use trilink_tables::trial::TrialKind;
use trilink_tables::{CheckRow, LawStatus, RobotParameterRow, SlopeStatus};

use super::coast::{WORDS, configured_law, own_resistance, set_resistance};
use super::laws::{checks, decay_check, preferred};
use super::{REJECTION_DEVIATIONS, against_configured, release};
use crate::Ingested;
use crate::checks::{Check, Finding};
use crate::diagnosis::restate;

/// Standard deviation of either component of the slope before any coast-down, rad. It has no effect where the
/// coast-downs determine the slope; it keeps noise in the direction of travel from being explained by a steep floor
/// across it.
const PRIOR_RAD: f64 = 1.0_f64.to_radians();
/// Standard error of a slope, rad, above which the coast-downs are considered not to determine it.
const MAX_SE_RAD: f64 = 0.1_f64.to_radians();
/// Significance level of the test for a scatter of coast-downs beyond their noise.
const SCATTER_TAIL: f64 = 0.01;

/// Estimates the slope of the floor of each folder and what follows from it for the coast-downs, and widens the
/// standard errors of all robot parameters to the scatter between repeats. `roll_kg_s` has the configured roll
/// resistances of each robot. Of an earlier call with other trials only the findings `W029` remain, which
/// [`crate::without_diagnosis`] removes.
pub(crate) fn estimate_slopes(rows: &mut Ingested, roll_kg_s: &BTreeMap<String, Vec<f64>>) {
    let folders: BTreeMap<String, String> = rows
        .trials
        .iter()
        .filter(|trial| trial.status.has_metrics() && trial.kind != TrialKind::Gait)
        .map(|trial| (trial.trial.clone(), trial.folder.clone()))
        .collect();
    let mut floors: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
    for (index, row) in rows.parameters.iter_mut().enumerate() {
        reset(row, roll_kg_s);
        if let Some(folder) = folders.get(&row.trial)
            && row.kind == TrialKind::CoastDown
        {
            floors.entry(folder).or_default().push(index);
        }
    }
    let mut found = Vec::new();
    for indices in floors.values() {
        found.extend(describe_floor(&mut rows.parameters, indices, roll_kg_s));
    }
    include_scatter(&mut rows.parameters, &folders, roll_kg_s);
    for (index, mut findings) in found {
        let row = &rows.parameters[index];
        findings.push(against_configured(row));
        replace_findings(rows, index, &findings);
    }
}

/// Undoes [`estimate_slopes`], apart from the shares of the wheels in the roll resistance, which are missing.
pub(crate) fn forget_slopes(rows: &mut Ingested) {
    for index in 0..rows.parameters.len() {
        let row = &mut rows.parameters[index];
        reset(row, &BTreeMap::new());
        if row.kind == TrialKind::CoastDown {
            let mut findings = checks(row, &WORDS, configured_law(row));
            findings.push(against_configured(row));
            replace_findings(rows, index, &findings);
        }
    }
}

/// Sets the parameters of a row to those that follow from its recording alone.
fn reset(row: &mut RobotParameterRow, roll_kg_s: &BTreeMap<String, Vec<f64>>) {
    let preferred = preferred(row);
    row.law = preferred.ok();
    row.status = preferred.err().unwrap_or(LawStatus::Ok);
    row.repeats = 1;
    if row.kind == TrialKind::CoastDown {
        let [viscous, dry] = own_resistance(row);
        set_resistance(row, shares(row, roll_kg_s), viscous, dry);
        row.pooled_trials = 1;
        row.slope_status = Some(SlopeStatus::NoneFits);
        for slope in [&mut row.slope_along_rad, &mut row.slope_x_rad, &mut row.slope_y_rad] {
            *slope = Estimate::MISSING;
        }
    } else if let Some(law) = row.law {
        let fit = *row.laws()[law as usize].1;
        let own = [fit.stiffness_nm_rad, fit.damping_nm_s_rad, fit.joint_dry_nm];
        release::set_parameters(row, own);
    }
}

/// Returns the configured roll resistances of the robot's wheels, kg/s; none for an unknown robot.
fn shares<'r>(row: &RobotParameterRow, roll_kg_s: &'r BTreeMap<String, Vec<f64>>) -> &'r [f64] {
    roll_kg_s.get(&row.robot).map_or(&[], Vec::as_slice)
}

/// What a coast-down contributes to the estimate of the slope.
struct Run {
    /// Index of the row.
    index: usize,
    /// Number of the robot.
    robot: usize,
    /// Weight of the robot, N.
    weight_n: f64,
    /// Viscous coefficient, kg/s, and constant force, N.
    measured: Vector2<f64>,
    covariance: Matrix2<f64>,
    /// Inverse of `covariance`.
    information: Matrix2<f64>,
    /// Cosine and sine of the direction of travel.
    direction: [f64; 2],
}

impl Run {
    /// Returns the contribution of a coast-down; `None` if its motion follows no law.
    fn new(index: usize, robot: usize, row: &RobotParameterRow) -> Option<Self> {
        let both = &row.coulomb_viscous;
        let [viscous, dry] = [both.roll_sum_kg_s, both.roll_dry_sum_n];
        let covariance = row.roll_correlation * viscous.se * dry.se;
        let covariance = Matrix2::new(viscous.se.powi(2), covariance, covariance, dry.se.powi(2));
        let information = covariance.try_inverse()?;
        let (sin, cos) = row.heading_rad.sin_cos();
        let measured = Vector2::new(viscous.value, dry.value);
        let is_known = information.iter().chain(&measured).all(|x| x.is_finite());
        let follows = both.misfit_over_noise <= row.misfit_over_noise_limit;
        (is_known && follows && sin.is_finite()).then_some(Self {
            index,
            robot,
            weight_n: GRAVITY_M_S2 * row.mass_kg,
            measured,
            covariance,
            information,
            direction: [cos, sin],
        })
    }

    /// Returns the viscous coefficient, kg/s, and the dry friction, N, of this coast-down alone under a law, if gravity
    /// slows the robot down by the force `gravity_n`. The value of a term that the law lacks has no meaning.
    fn resistance(&self, law: DecayLaw, gravity_n: f64) -> [f64; 2] {
        let [viscous, force] = [self.measured[0], self.measured[1] - gravity_n];
        let mixed = self.information[(0, 1)];
        // Without one of the terms, the other one is that with the largest likelihood.
        match law {
            DecayLaw::Viscous => [viscous + mixed / self.information[(0, 0)] * force, force],
            DecayLaw::Coulomb => [viscous, force + mixed / self.information[(1, 1)] * viscous],
            DecayLaw::CoulombViscous => [viscous, force],
        }
    }

    fn is_opposite(&self, other: &Self) -> bool {
        let [x, y] = [0, 1].map(|i| self.direction[i] * other.direction[i]);
        self.robot == other.robot && x + y < 0.0
    }
}

/// Adds the variance of the viscous coefficient between the coast-downs of each robot to the covariance of each.
fn include_variance_of_viscous(runs: &mut [Run], robots: usize) {
    for robot in 0..robots {
        let own = runs.iter().filter(|run| run.robot == robot);
        let values: Vec<f64> = own.clone().map(|run| run.measured[0]).collect();
        if values.len() < 2 {
            continue;
        }
        let noise = mean(own.map(|run| run.covariance[(0, 0)]));
        let between = (variance(&values) - noise).max(0.0);
        for run in runs.iter_mut().filter(|run| run.robot == robot) {
            run.covariance[(0, 0)] += between;
            if let Some(information) = run.covariance.try_inverse() {
                run.information = information;
            }
        }
    }
}

/// Solution of the generalised least squares. The unknowns are c and F of every robot, in turn, and s_x and s_y.
struct Solution {
    /// Index of every unknown in `values`; `None` if it is held at 0.
    columns: Vec<Option<usize>>,
    values: DVector<f64>,
    /// Covariance of `values`, widened to the scatter of the coast-downs.
    covariance: DMatrix<f64>,
    /// Ratio of an estimate to its standard error above which the estimate is significant.
    limit: f64,
}

impl Solution {
    /// Solves for the unknowns that are `free`. `None` if the equations are singular.
    fn new(runs: &[Run], free: &[bool]) -> Option<Self> {
        let mut count = 0;
        let mut columns = Vec::new();
        for is_free in free {
            columns.push(is_free.then_some(count));
            count += usize::from(*is_free);
        }
        let slope = free.len() - 2;
        let mut information = DMatrix::zeros(count, count);
        let mut right = DVector::zeros(count);
        let mut designs = Vec::new();
        for run in runs {
            let mut design = DMatrix::zeros(2, count);
            let [cos, sin] = run.direction;
            for (row, unknown, factor) in [
                (0, 2 * run.robot, 1.0),
                (1, 2 * run.robot + 1, 1.0),
                (1, slope, run.weight_n * cos),
                (1, slope + 1, run.weight_n * sin),
            ] {
                if let Some(column) = columns[unknown] {
                    design[(row, column)] = factor;
                }
            }
            let weighted = design.transpose() * run.information;
            information += &weighted * &design;
            right += weighted * run.measured;
            designs.push(design);
        }
        let mut regular = information.clone();
        for column in columns[slope..].iter().flatten() {
            regular[(*column, *column)] += PRIOR_RAD.powi(-2);
        }
        let factors = regular.cholesky()?;
        let values = factors.solve(&right);
        let covariance = factors.inverse();
        let squares: f64 = runs
            .iter()
            .zip(&designs)
            .map(|(run, design)| {
                let residual = run.measured - design * &values;
                residual.dot(&(run.information * residual))
            })
            .sum();
        let freedom = 2.0 * runs.len() as f64 - (&covariance * information).trace();
        // Below half a degree of freedom there is nothing from which to estimate a scatter.
        let ratio = if freedom < 0.5 { 0.0 } else { squares / freedom };
        let scatters = ratio > fisher(SCATTER_TAIL, [freedom, f64::INFINITY]);
        let tail = 2.0 * normal_tail(REJECTION_DEVIATIONS);
        let freedom = if scatters { freedom } else { f64::INFINITY };
        Some(Self {
            columns,
            values,
            covariance: covariance * ratio.max(1.0),
            limit: fisher(tail, [1.0, freedom]).sqrt(),
        })
    }

    /// Returns a linear combination of the unknowns, given by the factors of some of them.
    fn estimate(&self, factors: &[(usize, f64)]) -> Estimate {
        let mut all = DVector::zeros(self.values.len());
        for (unknown, factor) in factors {
            if let Some(column) = self.columns[*unknown] {
                all[column] += factor;
            }
        }
        Estimate::new(all.dot(&self.values), all.dot(&(&self.covariance * &all)).max(0.0).sqrt())
    }

    /// Returns the slope in a direction, rad; missing if the coast-downs do not determine it.
    fn slope_rad(&self, [x, y]: [f64; 2]) -> Estimate {
        let slope = self.columns.len() - 2;
        let found = self.estimate(&[(slope, x), (slope + 1, y)]);
        if found.se <= MAX_SE_RAD { found } else { Estimate::MISSING }
    }
}

/// Resistance of a robot whose dry friction is separated from the slope.
struct Resistance {
    /// Law that the robot follows, or the reason why there is none.
    law: Result<DecayLaw, LawStatus>,
    /// Squared t values of dry friction and of the viscous coefficient.
    f: [f64; 2],
    f_limit: f64,
}

impl Resistance {
    /// Returns the resistance of a robot; `None` if dry friction is not separated from the slope.
    fn new(solution: &Solution, robot: usize, weight_n: f64) -> Option<Self> {
        let [viscous, dry] =
            [2 * robot, 2 * robot + 1].map(|unknown| solution.estimate(&[(unknown, 1.0)]));
        if dry.se > weight_n * MAX_SE_RAD {
            return None;
        }
        let ratios = [dry, viscous].map(|Estimate { value, se }| value / se);
        let law = match ratios.map(|ratio| ratio > solution.limit) {
            _ if ratios.iter().any(|ratio| *ratio < -solution.limit) => Err(LawStatus::NoneFits),
            [true, true] => Ok(DecayLaw::CoulombViscous),
            [true, false] => Ok(DecayLaw::Coulomb),
            [false, true] => Ok(DecayLaw::Viscous),
            [false, false] => Err(LawStatus::NotDistinguished),
        };
        Some(Self { law, f: ratios.map(|ratio| ratio * ratio), f_limit: solution.limit.powi(2) })
    }
}

/// Estimates the slope of a folder's floor and describes it, with the resistances, in the rows with the given indices.
/// Returns the findings about these rows.
fn describe_floor(
    rows: &mut [RobotParameterRow],
    indices: &[usize],
    roll_kg_s: &BTreeMap<String, Vec<f64>>,
) -> Vec<(usize, Vec<Finding>)> {
    let mut robots: Vec<&str> = indices.iter().map(|&index| rows[index].robot.as_str()).collect();
    robots.sort_unstable();
    robots.dedup();
    let mut runs: Vec<Run> = indices
        .iter()
        .filter_map(|&index| {
            let row = &rows[index];
            Run::new(index, robots.binary_search(&row.robot.as_str()).ok()?, row)
        })
        .collect();
    include_variance_of_viscous(&mut runs, robots.len());
    let unknowns = 2 * robots.len() + 2;
    let mut free = vec![true; unknowns];
    for robot in 0..robots.len() {
        let is_known = runs.iter().any(|run| run.robot == robot);
        free[2 * robot..2 * robot + 2].fill(is_known);
    }
    let mut findings: BTreeMap<usize, Vec<Finding>> = indices
        .iter()
        .map(|&index| (index, checks(&rows[index], &WORDS, configured_law(&rows[index]))))
        .collect();
    let Some(full) = Solution::new(&runs, &free) else { return findings.into_iter().collect() };
    let resistances: Vec<Option<Resistance>> = (0..robots.len())
        .map(|robot| {
            let run = runs.iter().find(|run| run.robot == robot)?;
            Resistance::new(&full, robot, run.weight_n)
        })
        .collect();
    for (robot, resistance) in resistances.iter().enumerate() {
        if let Some(law) = resistance.as_ref().and_then(|of| of.law.ok()) {
            free[2 * robot] &= law.is_viscous();
            free[2 * robot + 1] &= law.is_dry();
        }
    }
    let Some(solution) = Solution::new(&runs, &free) else { return findings.into_iter().collect() };
    for run in &runs {
        let row = &mut rows[run.index];
        row.slope_along_rad = solution.slope_rad(run.direction);
        row.slope_x_rad = solution.slope_rad([1.0, 0.0]);
        row.slope_y_rad = solution.slope_rad([0.0, 1.0]);
        let of_robot = runs.iter().filter(|other| other.robot == run.robot);
        row.slope_status = Some(if row.slope_along_rad.value.is_finite() {
            SlopeStatus::Ok
        } else if of_robot.clone().any(|other| run.is_opposite(other)) {
            SlopeStatus::Imprecise
        } else {
            SlopeStatus::OneDirection
        });
        let shares = shares(row, roll_kg_s);
        let (estimates, law_finding) = match &resistances[run.robot] {
            Some(resistance) => {
                row.law = resistance.law.ok();
                row.status = resistance.law.err().unwrap_or(LawStatus::Ok);
                row.pooled_trials = of_robot.clone().count() as i64;
                let estimates = row.law.map_or([Estimate::MISSING; 2], |law| {
                    let own: Vec<[f64; 2]> = of_robot
                        .map(|run| {
                            run.resistance(
                                law,
                                run.weight_n * solution.slope_rad(run.direction).value,
                            )
                        })
                        .collect();
                    [0, 1].map(|term| {
                        let unknown = 2 * run.robot + term;
                        if !free[unknown] {
                            return Estimate::MISSING;
                        }
                        let Estimate { value, se } = solution.estimate(&[(unknown, 1.0)]);
                        let scatter =
                            deviation(&own.iter().map(|of_run| of_run[term]).collect::<Vec<_>>());
                        Estimate::new(value, se.max(scatter / (own.len() as f64).sqrt()))
                    })
                });
                (estimates, pooled_finding(row, resistance))
            }
            // Without the opposite direction any constant force may be gravity.
            None if row.viscous.f > row.f_limit => {
                row.law = None;
                row.status = LawStatus::DryOrSlope;
                let is_viscous = row.coulomb.f > row.f_limit;
                let viscous = row.coulomb_viscous.roll_sum_kg_s;
                let viscous = if is_viscous { viscous } else { Estimate::MISSING };
                ([viscous, Estimate::MISSING], ambiguous_finding(row, run))
            }
            None => continue,
        };
        let [viscous, dry] = estimates;
        set_resistance(row, shares, viscous, dry);
        let both = DecayLaw::CoulombViscous;
        let of_row = decay_check(row, &WORDS, both).into_iter();
        findings.insert(
            run.index,
            of_row.chain([law_finding]).chain(slope_finding(row, run, solution.limit)).collect(),
        );
    }
    findings.into_iter().collect()
}

/// Checks that the robot follows its configured law once the slope has been subtracted.
fn pooled_finding(row: &RobotParameterRow, resistance: &Resistance) -> Finding {
    let Resistance { law, f: [f_dry, f_viscous], f_limit } = *resistance;
    let configured = configured_law(row);
    let value = match configured {
        DecayLaw::Viscous => f_dry,
        DecayLaw::Coulomb => f_viscous,
        DecayLaw::CoulombViscous => f_dry.min(f_viscous),
    };
    let count = row.pooled_trials;
    let found = match law {
        Ok(law) if law == configured => format!("follows {}", WORDS.laws[law as usize]),
        Ok(law) => format!(
            "follows {}, but is configured with {}",
            WORDS.laws[law as usize], WORDS.laws[configured as usize]
        ),
        Err(LawStatus::NoneFits) => "is driven by a force that is not gravity".to_owned(),
        Err(_) => "shows neither viscous resistance nor dry friction".to_owned(),
    };
    let message = format!(
        "with the slope of the floor subtracted, the robot {found} ({count} coast-downs of this robot; F of dry \
         friction {f_dry:.1}, of viscous resistance {f_viscous:.1}, limit {f_limit:.1})"
    );
    Finding::new(Check::DecayLaw, law == Ok(configured), value, f_limit, message)
}

/// Returns the finding that a constant force is dry friction or gravity.
fn ambiguous_finding(row: &RobotParameterRow, run: &Run) -> Finding {
    let force_n = run.measured[1];
    let slope_deg = (force_n / run.weight_n).abs().to_degrees();
    let cause = if force_n > 0.0 {
        format!(
            "slows the robot down: dry friction, or a floor that rises by {slope_deg:.3} degrees"
        )
    } else {
        format!("drives the robot: a floor that falls by {slope_deg:.3} degrees or more")
    };
    let advice = if row.slope_status == Some(SlopeStatus::Imprecise) {
        "the coast-downs in other directions scatter too much to tell these apart"
    } else {
        "record coast-downs in the opposite direction in the same folder"
    };
    let message = format!(
        "a constant force of {:.4} N {cause} in the direction of travel; {advice}",
        force_n.abs()
    );
    Finding::new(Check::DecayLaw, false, row.viscous.f, row.f_limit, message)
}

/// Checks that the floor is level along the direction of travel; `None` if the slope is not determined.
fn slope_finding(row: &RobotParameterRow, run: &Run, limit: f64) -> Option<Finding> {
    let Estimate { value, se } = row.slope_along_rad;
    if value.is_nan() {
        return None;
    }
    let t = value / se;
    let needed_deg = (limit * se).to_degrees().max(Check::FloorSlope.limit());
    let is_significant = t.abs() > limit;
    let message = format!(
        "the floor {} by {} degrees in the direction of travel ({}significant: t = {t:.1}), which {} the \
         robot by {:.4} N and is subtracted",
        if value > 0.0 { "rises" } else { "falls" },
        with_error(value.abs().to_degrees(), se.to_degrees()),
        if is_significant { "" } else { "not " },
        if value > 0.0 { "slows" } else { "drives" },
        run.weight_n * value.abs(),
    );
    let value_deg = value.abs().to_degrees();
    Some(Finding::new(Check::FloorSlope, value_deg <= needed_deg, value_deg, needed_deg, message))
}

/// Replaces the findings about a coast-down's decay law and resistances, and restates its trial.
fn replace_findings(rows: &mut Ingested, index: usize, findings: &[Finding]) {
    let Ingested { trials, checks, parameters } = rows;
    let name = &parameters[index].trial;
    let replaced =
        [Check::Decay, Check::DecayLaw, Check::RobotParameters].map(|one| one.to_string());
    let is_replaced = |row: &CheckRow| row.trial == *name && replaced.contains(&row.check);
    let place = checks.iter().position(is_replaced).unwrap_or(checks.len());
    checks.retain(|row| !is_replaced(row));
    checks.splice(place..place, findings.iter().map(|finding| finding.row(name)));
    if let Some(trial) = trials.iter_mut().find(|trial| trial.trial == *name) {
        restate(trial, checks);
    }
}

/// Widens the standard errors of all parameters to the scatter between repeats: trials of the same robot, kind and law.
/// Coast-downs whose resistance was estimated jointly count as one.
fn include_scatter(
    rows: &mut [RobotParameterRow],
    folders: &BTreeMap<String, String>,
    roll_kg_s: &BTreeMap<String, Vec<f64>>,
) {
    let mut classes: BTreeMap<_, Vec<usize>> = BTreeMap::new();
    for (index, row) in rows.iter().enumerate() {
        let has_values = row.roll_sum_kg_s.value.is_finite()
            || row.roll_dry_sum_n.value.is_finite()
            || row.stiffness_nm_rad.value.is_finite();
        if has_values && folders.contains_key(&row.trial) {
            let law = row.law.map(DecayLaw::name);
            let class = (row.robot.clone(), row.kind.name(), row.joint, law);
            classes.entry(class).or_default().push(index);
        }
    }
    for indices in classes.into_values().filter(|indices| indices.len() > 1) {
        let scatter = |of: fn(&RobotParameterRow) -> Estimate| {
            let values: BTreeMap<&str, f64> = indices
                .iter()
                .map(|&index| {
                    let row = &rows[index];
                    let unit =
                        if row.pooled_trials > 1 { &folders[&row.trial] } else { &row.trial };
                    (unit.as_str(), of(row).value)
                })
                .collect();
            let values: Vec<f64> = values.into_values().filter(|value| value.is_finite()).collect();
            deviation(&values)
        };
        let of_coast = [scatter(|row| row.roll_sum_kg_s), scatter(|row| row.roll_dry_sum_n)];
        let of_release = [
            scatter(|row| row.stiffness_nm_rad),
            scatter(|row| row.damping_nm_s_rad),
            scatter(|row| row.joint_dry_nm),
        ];
        let widened =
            |Estimate { value, se }: Estimate, scatter: f64| Estimate::new(value, se.max(scatter));
        for &index in &indices {
            let row = &mut rows[index];
            // The slope is fitted to the scatter of coast-downs in different directions.
            let slopes = [row.slope_x_rad, row.slope_y_rad];
            let fitted = slopes.iter().filter(|slope| slope.value.is_finite()).count().max(1);
            let fitted = if row.pooled_trials > 1 { fitted } else { 0 };
            row.repeats = indices.len().saturating_sub(fitted).max(1) as i64;
            if row.kind == TrialKind::CoastDown {
                let viscous = widened(row.roll_sum_kg_s, of_coast[0]);
                let dry = widened(row.roll_dry_sum_n, of_coast[1]);
                set_resistance(row, shares(row, roll_kg_s), viscous, dry);
            } else {
                let own = [row.stiffness_nm_rad, row.damping_nm_s_rad, row.joint_dry_nm];
                let widened = std::array::from_fn(|i| widened(own[i], of_release[i]));
                release::set_parameters(row, widened);
            }
        }
    }
}

/// Returns the unbiased standard deviation of values; 0 for fewer than two values.
fn deviation(values: &[f64]) -> f64 {
    if values.len() < 2 {
        return 0.0;
    }
    variance(values).sqrt() / c4(values.len() as f64 - 1.0)
}

/// Returns the unbiased variance of two or more values.
fn variance(values: &[f64]) -> f64 {
    let middle = mean(values.iter().copied());
    let squares: f64 = values.iter().map(|value| (value - middle).powi(2)).sum();
    squares / (values.len() as f64 - 1.0)
}
